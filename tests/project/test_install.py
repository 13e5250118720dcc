"""What is installed: the range of dolfinx that is accepted, the package pip makes, and the recipes."""

from __future__ import annotations

import importlib.metadata
import os
import re
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import zipfile
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from dolfinx_frontend.common import release as _release

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PACKAGING = ROOT / "packaging"

BLOCKS = """
import numpy as np
from pathlib import Path
import dolfinx_frontend as lt
import latin_core

scene = lt.Scene()
for name, x0 in (("left", 0.0), ("right", 1.0)):
    block = lt.geometry.box((1.0, 1.0, 1.0), (1, 1, 1), origin=(x0, 0, 0), cell="hexahedron")
    scene.substructure(name, block, lt.LinearElastic(E=1.0, nu=0.0), degree=1)
scene.interface("layer", "left:x1", "right:x0", lt.Elastic(normal=1.0, tangential=1.0))
scene.fix("left:x0")
scene.fix("right:x1", (0.3, 0.0, 0.0))
result = lt.solve(lt.assemble(scene))
# three unit springs in a row share the elongation: force 0.1
assert np.allclose(result.force("layer")[:, 0], 0.1, rtol=1e-4), result.force("layer")
assert (Path(latin_core.get_include()) / "latin" / "interface" / "law.hpp").is_file()
print(latin_core.__file__, lt.__file__, sep="\\n")
"""


# --- range of releases -----------------------------------------------------------------------------


def pretend(monkeypatch: pytest.MonkeyPatch, version: str) -> None:
    module = ModuleType("dolfinx")
    module.__version__, module.__file__ = version, "/somewhere/dolfinx/__init__.py"
    monkeypatch.setitem(sys.modules, "dolfinx", module)


@pytest.mark.parametrize("version", ["0.9.0", "0.9.0.post1", "0.10.0.post5", "0.11.0.dev0", "unknown"])
def test_tried_releases_are_accepted_in_silence(
    monkeypatch: pytest.MonkeyPatch, recwarn: pytest.WarningsRecorder, version: str
) -> None:
    pretend(monkeypatch, version)
    _release.check()
    assert not recwarn.list


@pytest.mark.parametrize("version", ["0.5.2", "0.8.0", "0.8.0.post1"])
def test_old_release_is_refused(monkeypatch: pytest.MonkeyPatch, version: str) -> None:
    pretend(monkeypatch, version)
    found = rf"dolfinx {re.escape(version)} is installed \(in /somewhere/dolfinx/__init__.py\)"
    needed = r", dolfinx_frontend needs 0\.9 or newer\. conda: "
    with pytest.raises(ImportError, match=found + needed) as error:
        _release.check()
    assert error.value.name == "dolfinx"


def test_missing_dolfinx_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(name: str) -> ModuleType:
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)

    monkeypatch.setattr(_release.importlib, "import_module", absent)
    with pytest.raises(ImportError, match=r"dolfinx is not installed, .* needs 0\.9 or newer\. conda: "):
        _release.check()


def test_what_dolfinx_itself_misses_is_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(name: str) -> ModuleType:
        raise ModuleNotFoundError("No module named 'basix'", name="basix")

    monkeypatch.setattr(_release.importlib, "import_module", broken)
    with pytest.raises(ModuleNotFoundError, match="basix"):
        _release.check()


@pytest.mark.parametrize("version", ["0.12.0", "0.12.0.dev0", "1.0.0"])
def test_newer_release_warns(monkeypatch: pytest.MonkeyPatch, version: str) -> None:
    pretend(monkeypatch, version)
    found = rf"dolfinx {re.escape(version)} is installed, dolfinx_frontend was tried with 0\.9 to 0\.11"
    with pytest.warns(UserWarning, match=found):
        _release.check()


def imported_with(version: str) -> subprocess.CompletedProcess[str]:
    """Import the frontend twice under a dolfinx that says it is `version`."""
    script = f"import dolfinx; dolfinx.__version__ = {version!r}\n"
    script += "import dolfinx_frontend, dolfinx_frontend.solving\nfrom dolfinx_frontend import *"
    return subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)


def test_import_of_the_package_refuses_an_old_release() -> None:
    done = imported_with("0.8.0")
    assert done.returncode and "ImportError: dolfinx 0.8.0 is installed (in " in done.stderr


def test_import_of_the_package_warns_once_of_a_new_one() -> None:
    done = imported_with("0.99.0")
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("dolfinx 0.99.0 is installed") == 1


# --- pip -------------------------------------------------------------------------------------------


def call(command: list[str], cwd: Path, **variables: str) -> str:
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    done = subprocess.run(
        command, cwd=cwd, capture_output=True, text=True, check=False, env=environment | variables
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return done.stdout


@pytest.fixture(scope="module")
def sdist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The source distribution, unpacked."""
    pytest.importorskip("scikit_build_core")
    folder = tmp_path_factory.mktemp("a folder with spaces")
    script = f"import scikit_build_core.build as backend; print(backend.build_sdist({str(folder)!r}))"
    call([sys.executable, "-c", script], ROOT)
    (archive,) = folder.glob("*.tar.gz")
    with tarfile.open(archive) as opened:
        opened.extractall(folder, filter="data")
    (tree,) = (path for path in folder.iterdir() if path.is_dir())
    return tree


def test_source_distribution_is_complete(sdist: Path) -> None:
    def files(root: Path) -> set[str]:
        names: set[str] = set()
        for part in ("latin_core", "dolfinx_frontend", "tests", "demos", "docs"):
            inside = (path for path in (root / part).rglob("*") if path.is_file())
            names |= {str(path.relative_to(root)) for path in inside if "__pycache__" not in path.parts}
        return names

    assert {f for f in files(ROOT) if not f.endswith(".so")} <= files(sdist)
    for name in ("CMakeLists.txt", "pyproject.toml", "README.md", "LICENSE", "run", "PKG-INFO"):
        assert (sdist / name).is_file(), name
    assert not (sdist / "build").exists() and not (sdist / ".git").exists()


def environment_below(folder: Path) -> Path:
    """The interpreter of a new virtual environment that has dolfinx but not this project."""
    base = Path(getattr(sys, "_base_executable", sys.executable))
    call([str(base), "-m", "venv", "--without-pip", "--system-site-packages", str(folder)], folder.parent)
    python = folder / "bin" / "python"
    for module in ("dolfinx", "pip", "scikit_build_core", "pybind11"):
        done = subprocess.run([python, "-c", f"import {module}"], capture_output=True, check=False)
        if done.returncode:
            pytest.skip(f"{base}, on which this environment stands, has no {module}")
    return python


def wheel_of(name: str, folder: Path) -> None:
    """Pack an installed pure Python distribution again: what an index would have offered."""
    module = name.replace("-", "_")
    found = importlib.metadata.distribution(name)
    stem = f"{re.sub('[-_.]+', '_', name).lower()}-{found.version}"
    root = Path(str(found.locate_file("")))
    record = f"{stem}.dist-info/RECORD"
    with zipfile.ZipFile(folder / f"{stem}-py3-none-any.whl", "w") as wheel:
        for path in sorted((root / module).rglob("*")):
            if path.is_file() and "__pycache__" not in path.parts:
                wheel.write(path, str(path.relative_to(root)))
        wheel.writestr(f"{stem}.dist-info/METADATA", found.read_text("METADATA") or "")
        wheel.writestr(
            f"{stem}.dist-info/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
        )
        entries = found.read_text("entry_points.txt")
        if entries:
            wheel.writestr(f"{stem}.dist-info/entry_points.txt", entries)
        wheel.writestr(record, "".join(f"{each},,\n" for each in [*wheel.namelist(), record]))


@pytest.mark.night(guard="test_source_distribution_is_complete")
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("isolation", [False, True], ids=["no-build-isolation", "isolated"])
def test_pip_installs(sdist: Path, tmp_path: Path, isolation: bool) -> None:
    if isolation and not os.environ.get("LATIN_TEST_ISOLATED"):
        pytest.skip("compiles for minutes, the cache cannot help: set LATIN_TEST_ISOLATED=1")
    python = environment_below(tmp_path / "venv")
    recipe = conda_recipe(PYTHON=str(python))
    options = ["--no-index"]
    command = [str(python), "-m", "pip", "install", str(sdist)]
    if isolation:
        wheels = tmp_path / "wheels"
        wheels.mkdir()
        for name in ("scikit-build-core", "pybind11", "packaging", "pathspec"):
            wheel_of(name, wheels)
        options += ["--find-links", str(wheels)]
    else:  # as the conda recipe does
        command = shlex.split(recipe["build"]["script"])
    # paths and options as in `./run`: the compiler cache can be of use
    werror = "ON" if os.environ.get("LATIN_ENVIRONMENT", "").startswith("trixie-") else "OFF"
    build = sdist / "build" / ("isolated" if isolation else "installed") / "cmake"
    options += [f"--config-settings=build-dir={build}"]
    options += [f"--config-settings=cmake.define.LATIN_WERROR={werror}"]
    call(
        [*command, *options],
        tmp_path if isolation else sdist,
        CCACHE_BASEDIR=str(sdist),
        CCACHE_NOHASHDIR="1",
    )
    away = tmp_path / "elsewhere"
    away.mkdir()
    for printed in call([str(python), "-c", BLOCKS], away).splitlines()[-2:]:
        assert Path(printed).is_relative_to(tmp_path / "venv")
    installed = Path(printed).parent
    assert (installed / "py.typed").is_file() and (installed.parent / "latin_core" / "_core.pyi").is_file()
    if not isolation:
        as_the_recipe_tests(recipe, python, sdist, away)


def as_the_recipe_tests(recipe: Any, python: Path, tree: Path, away: Path) -> None:
    """Its tests, with nothing but the files that it names."""
    imports, script = (each[key] for each, key in zip(recipe["tests"], ("python", "script"), strict=True))
    call([str(python), "-c", "\n".join(f"import {name}" for name in imports["imports"])], away)
    for name in recipe["tests"][1]["files"]["source"]:
        (away / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(tree / name, away / name)
    for line in script:
        call(shlex.split(line.replace("python ", f"{shlex.quote(str(python))} ", 1)), away)


# --- the C++ library -------------------------------------------------------------------------------


INCLUDE = ROOT / "latin_core" / "include"


def headers(include: Path) -> set[str]:
    """What a folder of headers holds."""
    return {str(each.relative_to(include)) for each in include.rglob("*") if each.is_file()}


def law_headers() -> set[str]:
    """Those that a compiled law includes."""
    text = (ROOT / "CMakeLists.txt").read_text(encoding="utf-8")
    return {f"latin/{each}" for each in re.findall(r"set\(law_headers\s([^)]*)\)", text)[0].split()}


@pytest.mark.parametrize(
    ("installed", "first"), [(law_headers(), "interface/pointwise"), (headers(INCLUDE), "latin")]
)
def test_installed_headers_are_few_and_include_no_others(installed: set[str], first: str) -> None:
    """All of them are reached from one."""
    laws = {f"latin/interface/{each}.hpp" for each in ("law", "pointwise")}
    assert laws <= installed and len(installed - laws) <= 15
    reached: set[str] = set()
    ahead = {f"latin/{first}.hpp"}
    while ahead:
        reached |= ahead
        texts = [(INCLUDE / each).read_text(encoding="utf-8") for each in ahead]
        ahead = {each for text in texts for each in re.findall(r'#include "(latin/.*?)"', text)} - reached
    assert reached == installed


@pytest.mark.night(guard="test_source_distribution_is_complete")
@pytest.mark.timeout(1200)
def test_cmake_installs_the_library(sdist: Path, tmp_path: Path) -> None:
    """A program that knows nothing but the prefix finds the library; the wheel's part stays away."""
    variables = {"CCACHE_BASEDIR": str(sdist), "CCACHE_NOHASHDIR": "1"}
    # the compiler that pip takes: the compiler cache tells them apart by their names
    compiler = (os.environ.get("CXX") or sysconfig.get_config_var("CXX") or "").split()
    if compiler and shutil.which(compiler[0]):
        variables["CXX"] = compiler[0]
    first, build = tmp_path / "first prefix", sdist / "build" / "library" / "cmake"
    werror = "ON" if os.environ.get("LATIN_ENVIRONMENT", "").startswith("trixie-") else "OFF"
    options = [f"-DCMAKE_INSTALL_PREFIX={first}", f"-DLATIN_WERROR={werror}", "-DLATIN_BUILD_PYTHON=OFF"]
    call(["cmake", "-S", str(sdist), "-B", str(build), *options], tmp_path, **variables)
    call(["cmake", "--build", str(build)], tmp_path, **variables)
    call(["cmake", "--install", str(build)], tmp_path)
    prefix = first.rename(tmp_path / "a prefix that was moved")
    assert headers(prefix / "include") == headers(INCLUDE)
    assert not list(prefix.rglob("_core*")) and not (prefix / "latin_core").exists()

    def built(source: Path, *given: str) -> Path:
        target, build = tmp_path / f"my {source.name}", tmp_path / f"build of {source.name}"
        shutil.copytree(source, target)
        given = (f"-DCMAKE_PREFIX_PATH={prefix}", *given)
        call(["cmake", "-S", str(target), "-B", str(build), *given], tmp_path)
        call(["cmake", "--build", str(build)], tmp_path)
        return build

    demos = built(ROOT / "demos" / "cpp")
    for demo, lines in (("bars", 12), ("friction", 11)):
        printed = call([str(demos / demo)], tmp_path).splitlines()
        assert len(printed) == lines and float(printed[-1].split()[-1]) < 1e-8
    consumer = built(ROOT / "tests" / "project" / "consumer", f"-DHEADERS={';'.join(sorted(headers))}")
    call([str(consumer / "user_laws")], tmp_path)

    program = prefix / "bin" / "latin_run"
    if program.exists():  # where there is HDF5
        assert "usage: " in call([str(program), "--help"], tmp_path)


# --- recipes ---------------------------------------------------------------------------------------


def name_of(requirement: str) -> str:
    """Name of a requirement."""
    return re.split(r"[ <>=]", requirement)[0]


def conda_recipe(**variables: str) -> Any:
    """The recipe with its ``${{ ... }}`` filled in; an unknown name is an error."""
    yaml, jinja2 = pytest.importorskip("yaml"), pytest.importorskip("jinja2")
    recipe = yaml.safe_load((PACKAGING / "conda" / "recipe.yaml").read_text(encoding="utf-8"))
    marks = {"variable_start_string": "${{", "variable_end_string": "}}"}
    fill = jinja2.Environment(undefined=jinja2.StrictUndefined, autoescape=False, **marks)
    names = {"PYTHON": "python", **recipe["context"], **variables}
    names |= {name: partial("{1}-{0}".format, name) for name in ("compiler", "stdlib")}

    def filled(node: Any) -> Any:
        if isinstance(node, dict):
            return {key: filled(value) for key, value in node.items()}
        if isinstance(node, list):
            return [filled(each) for each in node]
        return fill.from_string(node).render(names) if isinstance(node, str) else node

    return filled(recipe)


# conda's names -> Debian's; None: what another package of the list brings
DEBIAN = {
    "c-compiler": "g++",
    "cxx-compiler": "g++",
    "c-stdlib": None,
    "cmake": "cmake",
    "ninja": "ninja-build",
    "pkg-config": "pkgconf",
    "python": None,
    "pip": "python3-pip",
    "scikit-build-core": "python3-scikit-build-core",
    "pybind11": "python3-pybind11",
    "mpich": None,
    "petsc": "libpetsc-real-dev",
    "petsc4py": "python3-petsc4py",
    "eigen": "libeigen3-dev",
    "libcholmod": "libsuitesparse-dev",
    "libblas": "libopenblas-pthread-dev",
    "liblapack": "libopenblas-pthread-dev",
    "numpy": None,
    "scipy": "python3-scipy",
    "mpi4py": "python3-mpi4py",
    "fenics-dolfinx": "python3-dolfinx",
    "python-gmsh": "python3-gmsh",
    "h5py": "python3-h5py",
    "matplotlib-base": "python3-matplotlib",
}


def test_conda_recipe_is_well_formed() -> None:
    """Keys of the schema, specifications that can be read, nothing that is not filled in."""
    recipe = conda_recipe()
    assert set(recipe) == {"context", "package", "source", "build", "requirements", "tests", "about"}
    assert set(recipe["requirements"]) == {"build", "host", "run"}
    assert set(recipe["build"]) <= {"number", "skip", "script", "noarch"}
    assert set(recipe["about"]) <= {"homepage", "repository", "summary", "license", "license_file"}
    bound = r"[<>=!]=?[0-9.]+"
    specification = re.compile(rf"[a-z0-9][a-z0-9._-]*( (\*|{bound}(,{bound})*)( [a-z0-9_*]+)?)?")
    for section in recipe["requirements"].values():
        for each in section:
            assert specification.fullmatch(each), each
    folder = PACKAGING / "conda"
    assert (folder / recipe["source"]["path"] / "pyproject.toml").resolve() == ROOT / "pyproject.toml"
    assert (ROOT / recipe["about"]["license_file"]).is_file()


def test_what_conda_needs_is_what_debian_needs() -> None:
    """The recipe, the page on installation and the packages of the private root name the same things."""
    lines = (ROOT / "tools" / "env" / "packages.txt").read_text(encoding="utf-8").splitlines()
    packages = {line for line in lines if line and not line.startswith("#")}
    sections = conda_recipe()["requirements"].values()
    conda = {name_of(each) for section in sections for each in section}
    assert conda == set(DEBIAN), "a name that is new or gone: adapt DEBIAN"
    assert {each for each in DEBIAN.values() if each} <= packages
    page = (ROOT / "docs" / "install.md").read_text(encoding="utf-8")
    (apt,) = re.findall(r"`apt-get install ([^`]*)`", page)
    assert set(apt.split()) <= packages
    (named,) = re.findall(r"`conda install -c conda-forge ([^`]*)`", page)
    assert set(named.split()) <= conda
    for extra in PROJECT["project"]["optional-dependencies"]["test"]:
        assert f"python3-{name_of(extra)}" in packages


def test_conda_recipe_agrees_with_the_project() -> None:
    recipe = conda_recipe()
    project = PROJECT["project"]
    assert recipe["context"]["version"] == recipe["package"]["version"] == project["version"]
    assert recipe["package"]["name"] == project["name"]
    assert recipe["about"]["summary"] == project["description"]
    requirements = recipe["requirements"]
    for each in PROJECT["build-system"]["requires"]:
        assert each.replace(">=", " >=") in requirements["host"]
    run = {name_of(each) for each in requirements["run"]}
    assert {name_of(each) for each in project["dependencies"]} <= run
    oldest, newest = _release.OLDEST, _release.NEWEST_TRIED
    assert f"fenics-dolfinx >={oldest[0]}.{oldest[1]},<{newest[0]}.{newest[1] + 1}" in requirements["run"]
    for path in recipe["tests"][1]["files"]["source"]:
        assert (ROOT / path).is_file()


def test_container_file_copies_what_there_is() -> None:
    lines = (ROOT / "packaging" / "Containerfile").read_text(encoding="utf-8").splitlines()
    assert any(line.startswith("FROM docker.io/dolfinx/dolfinx:") for line in lines)
    copied = [name for line in lines if line.startswith("COPY ") for name in line.split()[1:-1]]
    assert {"CMakeLists.txt", "pyproject.toml", "latin_core", "dolfinx_frontend"} <= set(copied)
    assert all((ROOT / name).exists() for name in copied)


@pytest.mark.night(guard="test_container_file_copies_what_there_is")
def test_what_the_container_copies_is_enough(tmp_path: Path) -> None:
    """CMake configures, and the package's metadata can be made, from these files alone."""
    pytest.importorskip("scikit_build_core")
    text = (PACKAGING / "Containerfile").read_text(encoding="utf-8")
    target = tmp_path / "latin-core"
    target.mkdir()
    for line in re.findall(r"^COPY (.*)$", text, flags=re.M):
        *names, there = line.split()
        base = target / Path(there).relative_to("/opt/latin-core")
        for name in names:
            if (ROOT / name).is_dir():
                shutil.copytree(ROOT / name, base, ignore=shutil.ignore_patterns("__pycache__", "*.so"))
            else:
                shutil.copy(ROOT / name, base)
    python = f"-DPython_EXECUTABLE={sys.executable}"
    call(["cmake", "-S", str(target), "-B", str(tmp_path / "build"), python], tmp_path)
    script = "import scikit_build_core.build as b; print(b.prepare_metadata_for_build_wheel('.'))"
    call([sys.executable, "-c", script], target)
    (metadata,) = target.glob("*.dist-info")
    assert f"Version: {PROJECT['project']['version']}" in (metadata / "METADATA").read_text()
