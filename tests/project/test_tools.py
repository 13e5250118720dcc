"""The tools of the project: the check of the layers, and the pure functions of `run`."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def check_layers(root: Path) -> tuple[int, list[str]]:
    """Exit code and lines of tools/check_layers.py for the project in `root`."""
    command = [sys.executable, str(ROOT / "tools" / "check_layers.py"), str(root)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert not done.stderr
    return done.returncode, done.stdout.splitlines()


def write(root: Path, name: str, text: str) -> None:
    path = root / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def test_project_keeps_its_layers() -> None:
    assert check_layers(ROOT) == (0, [])


INCLUDE = "latin_core/include/latin"


@pytest.mark.parametrize(
    ("name", "text"),
    [
        (f"{INCLUDE}/interface/law.hpp", '#include "latin/algebra/mat.hpp"\n'),
        (f"{INCLUDE}/interface/law.hpp", '#include "latin/interface/points.hpp"\n'),
        (f"{INCLUDE}/algebra/mat.hpp", '#include "latin/common/types.hpp"\n'),
        ("latin_core/src/iteration/solver.cpp", '#include "substructure/body.hpp"\n'),
        ("latin_core/src/iteration/solver.cpp", '#include "detail.hpp"\n'),
        ("latin_core/bindings/core.cpp", '#include "iteration/solver.hpp"\n'),
        (f"{INCLUDE}/all.hpp", '#include "latin/iteration/solver.hpp"\n'),
        ("latin_core/python/latin_core/run.py", "from . import _core\n"),
        ("dolfinx_frontend/kernel/bridge.py", "from latin_core import _core\n"),
        ("dolfinx_frontend/solving.py", "import latin_core\n"),
        ("dolfinx_frontend/kernel/bridge.py", "import dolfinx\nfrom .user_laws import batched\n"),
        ("dolfinx_frontend/kernel/bridge.py", "from ..scene.laws import Law\nfrom ..scene import laws\n"),
        ("dolfinx_frontend/scene/scene.py", "from dolfinx_frontend.scene import laws, specs\n"),
        ("dolfinx_frontend/scene/__init__.py", "from dolfinx_frontend.scene.scene import Scene\n"),
        ("dolfinx_frontend/io/paraview.py", "from dolfinx_frontend import geometry, solving\n"),
        ("dolfinx_frontend/__init__.py", "from dolfinx_frontend.figures import curves\n"),
    ],
)
def test_uses_along_the_arrow_pass(tmp_path: Path, name: str, text: str) -> None:
    write(tmp_path, name, text)
    assert check_layers(tmp_path) == (0, [])


@pytest.mark.parametrize(
    ("name", "text", "offence"),
    [
        (
            f"{INCLUDE}/algebra/mat.hpp",
            '#pragma once\n#include "latin/interface/law.hpp"\n',
            "2: layer algebra must not include latin/interface/law.hpp (layer interface)",
        ),
        (
            "latin_core/src/interface/law.cpp",
            "#include <latin/iteration/options.hpp>\n",
            "1: layer interface must not include latin/iteration/options.hpp (layer iteration)",
        ),
        (
            "latin_core/src/interface/law.hpp",
            '#include "iteration/solver.hpp"\n',
            "1: layer interface must not include iteration/solver.hpp (layer iteration)",
        ),
        (
            f"{INCLUDE}/iteration/state.hpp",
            '#include "iteration/run.hpp"\n',
            "1: iteration/run.hpp is not installed, what include/ holds must not use it",
        ),
        (
            f"{INCLUDE}/iteration/state.hpp",
            '#include "../../../src/iteration/run.hpp"\n',
            "1: ../../../src/iteration/run.hpp is not installed, what include/ holds must not use it",
        ),
        (
            "latin_core/src/stochastic/chaos.cpp",
            '#include "../substructure/body.hpp"\n',
            "1: layer stochastic must not include ../substructure/body.hpp (layer substructure)",
        ),
        (
            f"{INCLUDE}/common/types.hpp",
            '#include "latin/algebra/mat.hpp"\n',
            "1: layer common must not include latin/algebra/mat.hpp (layer algebra)",
        ),
        (
            "latin_core/src/iteration/solver.cpp",
            '#include "latin/all.hpp"\n',
            "1: layer iteration must not include latin/all.hpp (layer study)",
        ),
        (
            "latin_core/src/iteration/solver.cpp",
            '#include "latin/extras/x.hpp"\n',
            "1: latin/extras/x.hpp belongs to no known layer",
        ),
        (
            "latin_core/src/extras/x.cpp",
            "",
            "1: folder extras is no layer; the layers are "
            "common, algebra, interface, stochastic, mortar, equilibration, substructure, iteration, study",
        ),
        (
            "latin_core/bindings/core.cpp",
            "\n\n// as in DOLFINx\n",
            "3: the kernel must not mention dolfinx",
        ),
        (
            "latin_core/python/latin_core/run.py",
            "def f():\n    from dolfinx import fem\n",
            "2: the kernel must not import dolfinx.fem",
        ),
        (
            "latin_core/python/latin_core/run.py",
            "import dolfinx_frontend.scene.scene\n",
            "1: the kernel must not import dolfinx_frontend.scene.scene",
        ),
        (
            "dolfinx_frontend/solving.py",
            "from latin_core import _core\n",
            "1: only kernel/bridge.py may import latin_core._core",
        ),
        (
            "dolfinx_frontend/kernel/running.py",
            "import latin_core._core as kernel\n",
            "1: only kernel/bridge.py may import latin_core._core",
        ),
        (
            "dolfinx_frontend/scene/laws.py",
            "from latin_core import Options\n",
            "1: scene must not import latin_core",
        ),
        (
            "dolfinx_frontend/scene/laws.py",
            "from dolfinx_frontend.geometry.parts import Part\n",
            "1: scene.laws must not import geometry.parts, which stands above it",
        ),
        (
            "dolfinx_frontend/scene/laws.py",
            "import dolfinx_frontend.plan\n",
            "1: scene.laws must not import plan, which stands above it",
        ),
        (
            "dolfinx_frontend/scene/laws.py",
            "from dolfinx_frontend import Scene\n",
            "1: scene.laws must not import dolfinx_frontend, which stands above it",
        ),
        (
            "dolfinx_frontend/scene/laws.py",
            "from ..solving import solve\n",
            "1: scene.laws must not import solving, which stands above it",
        ),
        (
            "dolfinx_frontend/scene/laws.py",
            "from .materials import Material\n",
            "1: scene.laws must not import scene.materials, which stands above it",
        ),
        (
            "dolfinx_frontend/scene/laws.py",
            "from . import scene\n",
            "1: scene.laws must not import scene.scene, which stands above it",
        ),
        (
            "dolfinx_frontend/scene/laws.py",
            "from dolfinx_frontend.scene import Scene\n",
            "1: scene.laws must not import scene, which stands above it",
        ),
        (
            "dolfinx_frontend/scene/laws.py",
            "def f():\n    from dolfinx_frontend.assembly.pairing import make_interface\n",
            "2: scene.laws must not import assembly.pairing, which stands above it",
        ),
        (
            "dolfinx_frontend/scene/laws.py",
            "if TYPE_CHECKING:\n    from dolfinx_frontend.scene.scene import Scene\n",
            "2: scene.laws must not import scene.scene, which stands above it",
        ),
        (
            "dolfinx_frontend/scene/__init__.py",
            "from dolfinx_frontend.uncertainty.space import RandomSpace\n",
            "1: scene must not import uncertainty.space, which stands above it",
        ),
        (
            "dolfinx_frontend/moments/rules.py",
            "from dolfinx_frontend.assembly.problem import Problem\n",
            "1: moments.rules must not import assembly.problem, which stands above it",
        ),
        (
            "dolfinx_frontend/rare/design.py",
            "from mpi4py import MPI\n",
            "1: rare must not import mpi4py.MPI",
        ),
        (
            "dolfinx_frontend/estimate/levels.py",
            "from dolfinx_frontend.kernel.fitting import walked\n",
            "1: points are solved in evaluate only",
        ),
        (
            "dolfinx_frontend/scene/more.py",
            "",
            "1: scene.more is not in the table FRONTEND of tools/check_layers.py",
        ),
        (
            "dolfinx_frontend/extras/__init__.py",
            "",
            "1: extras is not in the table FRONTEND of tools/check_layers.py",
        ),
    ],
)
def test_uses_against_the_arrow_are_reported(
    tmp_path: Path, name: str, text: str, offence: str
) -> None:
    write(tmp_path, name, text)
    assert check_layers(tmp_path) == (1, [f"{name}:{offence}"])


def test_circles_are_reported(tmp_path: Path) -> None:
    scene, plan = "dolfinx_frontend/scene/specs.py", "dolfinx_frontend/plan/plan.py"
    write(tmp_path, scene, "def f():\n    from dolfinx_frontend.plan import plan\n")
    write(tmp_path, plan, "if TYPE_CHECKING:\n    from ..scene.specs import PartLike\n")
    assert check_layers(tmp_path) == (
        1,
        [
            f"{scene}:2: scene.specs must not import plan.plan, which stands above it",
            f"{plan}:2: circle: plan.plan -> scene.specs -> plan.plan",
        ],
    )


def test_pending_arrows_are_still_there(tmp_path: Path) -> None:
    """The list of arrows up that are left only gets shorter."""
    sys.path.insert(0, str(ROOT / "tools"))
    try:
        import check_layers as tool
    finally:
        sys.path.pop(0)
    for module, used in tool.PENDING:
        before, after = tool.place_of(module), tool.place_of(used)
        assert before is not None and after is not None and before < after
    for module, used in sorted(tool.PENDING)[:1]:
        name = f"dolfinx_frontend/{module.replace('.', '/')}.py"
        write(tmp_path, name, "")
        _, lines = check_layers(tmp_path)
        assert f"{name}:1: {used} is imported no more: take it out of PENDING" in lines


def shell(script: str, home: Path = ROOT, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run `script` after the functions of `run` have been read; `home` stands for the project."""
    text = f'source "{ROOT}/run"; latin_home="{home}"; {script}'
    environment = {**os.environ, **variables}
    return subprocess.run(
        ["bash", "-c", text], capture_output=True, text=True, check=False, env=environment
    )


def answer(script: str, home: Path = ROOT, **variables: str) -> str:
    done = shell(script, home, **variables)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_package_list_has_no_comments_and_a_fixed_order(tmp_path: Path) -> None:
    write(tmp_path, "tools/env/packages.txt", "# a comment\nzlib\n\n  g++  # why\nzlib\n")
    assert answer("package_list", tmp_path).split() == ["g++", "zlib"]


def test_suite_may_have_packages_of_its_own(tmp_path: Path) -> None:
    write(tmp_path, "tools/env/packages.txt", "zlib\n")
    alone = [answer(f"root_key {suite}", tmp_path) for suite in ("trixie", "sid")]
    write(tmp_path, "tools/env/packages.sid.txt", "# not in trixie\na\n")
    assert answer("package_list sid", tmp_path).split() == ["a", "zlib"]
    assert answer("package_list trixie", tmp_path) == answer("package_list", tmp_path) == "zlib"
    assert answer("root_key trixie", tmp_path) == alone[0]
    assert answer("root_key sid", tmp_path) != alone[1]


def test_key_of_the_root_follows_packages_and_suite(tmp_path: Path) -> None:
    keys = set()
    for packages in ("a\nb\n", "a\nb\nc\n"):
        for suite in ("trixie", "sid"):
            write(tmp_path, "tools/env/packages.txt", packages)
            key = answer(f"root_key {suite}", tmp_path)
            assert key.startswith(f"{suite}-")
            keys.add(key)
    assert len(keys) == 4
    write(tmp_path, "tools/env/packages.txt", "# other words, same packages\nb\na\n")
    assert answer("root_key trixie", tmp_path) in keys


def test_only_sid_may_be_past_its_date() -> None:
    assert "Check-Valid-Until" in answer("root_options sid")
    assert "Check-Valid-Until" not in answer("root_options trixie")


@pytest.mark.parametrize(
    ("version", "expected"),
    [
        ("0.9.0", True),
        ("1:0.9.0-7", True),
        ("0.11.0.post0", True),
        ("1.0.0", True),
        ("0.8.0", False),
        ("1:0.5.2-2", False),
        ("(none)", False),
        ("", False),
    ],
)
def test_versions_of_dolfinx(version: str, expected: bool) -> None:
    assert (shell(f"is_new_enough '{version}'").returncode == 0) is expected


@pytest.mark.parametrize(
    ("folder", "expected"),
    [
        ("/", True),
        ("/usr/lib", True),
        ("/etc/x", True),
        ("/var/lib", True),
        ("/home/me/latin", False),
        ("/usr/src/latin", False),
        ("/var/lib/ci/work", False),
        ("/opt/latin", False),
    ],
)
def test_folders_of_the_system_are_never_covered(folder: str, expected: bool) -> None:
    assert (shell(f"is_system_folder '{folder}'").returncode == 0) is expected


def test_variables_handed_on() -> None:
    """The user's own, and none that tells of the host's programs and libraries."""
    mine = ["LATIN_X", "HYPOTHESIS_PROFILE", "PYTEST_ADDOPTS", "MY_DATA", "OMP_NUM_THREADS"]
    foreign = ["PYTHONPATH", "LD_LIBRARY_PATH", "PETSC_DIR", "CXXFLAGS", "OMPI_COMM_WORLD_SIZE"]
    names = set(answer("handed_on", **dict.fromkeys(mine + foreign, "2")).split())
    assert set(mine) <= names
    assert not {"HOME", "PATH", "PWD", "LATIN_PYTHON", *foreign} & names


def test_folders_of_the_user(tmp_path: Path) -> None:
    system = ("etc", "usr", "lib64", "lost+found", "var/lib", "run/x")
    for name in (*system, "home", "my data", "var/tmp", "run/media", ".store"):
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / "file").touch()
    (tmp_path / "link").symlink_to("home")
    (tmp_path / "gone").symlink_to("nowhere")
    found = answer(f'user_folders "{tmp_path}" | tr "\\0" "\\n"').splitlines()
    names = {"home", "my data", "link", ".store", "var/tmp", "run/media"}
    assert sorted(found) == sorted(str(tmp_path / name) for name in names)


def test_message_names_three_ways_to_dolfinx() -> None:
    done = shell("explain_and_stop")
    assert done.returncode == 1
    assert all(way in done.stderr for way in ("conda", "dolfinx/dolfinx", "Debian 13"))


def test_build_is_repeated_when_its_sources_change(tmp_path: Path) -> None:
    for name in ("latin_core/src/algebra/a.cpp", "dolfinx_frontend/a.py", "CMakeLists.txt"):
        write(tmp_path, name, "")
    built = "is_built out && echo yes || echo no"
    stamp = f'cd "{tmp_path}"; mkdir -p out; build_inputs > out/stamp; {built}'
    assert answer(f'cd "{tmp_path}"; {built}', tmp_path) == "no"
    assert answer(stamp, tmp_path) == "yes"
    later = (tmp_path / "out/stamp").stat().st_mtime + 10
    os.utime(tmp_path / "dolfinx_frontend/a.py", (later, later))
    assert answer(f'cd "{tmp_path}"; {built}', tmp_path) == "yes", "Python files are only linked"
    os.utime(tmp_path / "latin_core/src/algebra/a.cpp", (later, later))
    assert answer(f'cd "{tmp_path}"; {built}', tmp_path) == "no"
    write(tmp_path, "dolfinx_frontend/b.py", "")
    os.utime(tmp_path / "latin_core/src/algebra/a.cpp", (0, 0))
    assert answer(f'cd "{tmp_path}"; {built}', tmp_path) == "no"


def test_unknown_benchmark_is_named() -> None:
    done = shell("run_benchmark nonsense")
    assert done.returncode == 1
    assert "no benchmark named nonsense; ./run bench lists them" in done.stderr


def test_help_needs_no_environment() -> None:
    command, bare = [str(ROOT / "run"), "help"], {"PATH": "/usr/bin:/bin"}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=bare)
    assert done.returncode == 0
    for verb in ("demo", "test", "bench", "python", "shell", "lint", "docs"):
        assert f"./run {verb}" in done.stdout


def test_environment_with_several_builds_of_petsc_is_found(tmp_path: Path) -> None:
    """As in the dolfinx container: petsc4py names all of them, PETSC_ARCH or the first is meant."""
    config = {"PETSC_DIR": str(tmp_path), "PETSC_ARCH": f"real{os.pathsep}complex"}
    write(tmp_path, "petsc4py/__init__.py", f"def get_config():\n    return {config}\n")
    write(tmp_path, "fenics_dolfinx-0.10.0.dist-info/METADATA", "Name: fenics-dolfinx\nVersion: 0.10.0\n")
    write(tmp_path, "real/include/petscconf.h", "")

    def found(**variables: str) -> bool:
        script = f'"{sys.executable}" -c "$latin_probe" >/dev/null && echo yes || echo no'
        unset = "unset PETSC_DIR; [[ -n ${wanted:-} ]] && export PETSC_ARCH=$wanted || unset PETSC_ARCH; "
        return answer(unset + script, PYTHONPATH=str(tmp_path), **variables) == "yes"

    assert found() and found(wanted="real") and not found(wanted="complex")


def test_only_compat_asks_what_dolfinx_renamed() -> None:
    """These work on the oldest release and warn on the newest; Eigen 5 has no ``Eigen::all``."""
    renamed = re.compile(r"\.geometry\.(cmap|dofmap)\b|io\.gmsh(io)?\b|\bEigen::all\b")
    folders = ("dolfinx_frontend", "latin_core", "demos", "benchmarks", "tests/cpp")
    files = [path for folder in folders for path in (ROOT / folder).rglob("*.[pch]*")]
    sources = [path for path in files if path.suffix in {".py", ".cpp", ".hpp"} and path.name != "compat.py"]
    assert sources
    assert not [str(path) for path in sources if renamed.search(path.read_text(encoding="utf-8"))]


def test_ranks_come_alone_and_last_and_wait_for_the_sanitized_build(tmp_path: Path) -> None:
    """What fails before does not stop them; of the short tests there are none."""
    write(tmp_path, "build/sanitize/busy", "")
    stubs = "run_cpp_tests() { true; }; pytest_on_cores() { echo \"shared: $*\"; false; }; "
    stubs += "attend() { echo \"alone: $*\"; }; flock() { echo \"waits: $(basename \"$1\")\"; }; "
    outcomes = {}
    for options in ("", "--night", "--fast"):
        call = f'run_tests "{tmp_path}/build" {options} || echo "ended with $?"'
        outcomes[options] = shell(stubs + call, tmp_path).stdout.splitlines()
    for options in ("", " --night"):
        assert outcomes[options.strip()] == [
            f"shared: tests --ranks none{options}",
            "waits: busy",
            f"alone: python -m pytest tests --ranks only{options}",
            "ended with 1",
        ]
    assert outcomes["--fast"] == ["shared: tests --ranks none --fast", "ended with 1"]


def test_a_night_goes_on_after_failures_and_says_so(tmp_path: Path) -> None:
    """Each step's outcome is printed, and what failed is what the night ends with."""
    write(tmp_path, "run", '#!/bin/sh\ntest "$1" != lint\n')
    (tmp_path / "run").chmod(0o755)
    write(tmp_path, "demos/a.py", "")
    stubs = "run_tests() { true; }; python() { true; }"
    done = shell(f'{stubs}; cd "{tmp_path}"; run_night build || echo "ended with $?"', tmp_path)
    said = done.stdout.splitlines()
    assert said[-1] == "ended with 1"
    outcomes = {line.split(",")[0].strip() for line in said if line.startswith("  ")}
    assert {"FAILED  lint", "ok      demos/a.py", "ok      documentation"} <= outcomes
    assert not any("mutants" in each or "frozen" in each for each in outcomes)
