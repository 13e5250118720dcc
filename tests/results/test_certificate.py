"""Certificates of answers: valid ones pass the program, spoiled ones do not."""

import importlib.util
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gmsh
import numpy as np
import pytest

import dolfinx_frontend as lf

TOOL = Path(__file__).resolve().parents[2] / "tools" / "check_certificate.py"
found = importlib.util.spec_from_file_location("check_certificate", TOOL)
assert found is not None and found.loader is not None
tool = importlib.util.module_from_spec(found)
sys.modules["check_certificate"] = tool
found.loader.exec_module(tool)

STEEL = lf.LinearElastic(E=200e3, nu=0.3)
GROWS = lf.Amplitude([0, 1, 2, 3], [0.0, 1.0, -1.0, 0.5])
LATER = lf.Amplitude([1, 2], [0, 1])


def stack(law: Any, cell: str = "quadrilateral", degree: int = 1, material: Any = STEEL) -> lf.Scene:
    """Two squares on each other, the lower one fixed; unlike meshes."""
    scene = lf.Scene()
    scene.substructure("low", lf.geometry.box((10, 10), (3, 2), cell=cell), material, degree=degree)
    top = lf.geometry.box((10, 10), (2, 2), origin=(0, 10), cell=cell)
    scene.substructure("top", top, material, degree=degree)
    scene.interface("joint", "low:y1", "top:y0", law)
    scene.fix("low:y0")
    return scene


def friction(law: Any = None, degree: int = 1, push: float = 8.0, **how: Any) -> Any:
    scene = stack(law or lf.Contact(friction=0.3), degree=degree)
    scene.pressure("top:y1", 50.0)
    scene.traction("top:x1", GROWS * (push, 0.0))
    return lf.solve(lf.assemble(scene), times=[0.5, 1.0, 2.0, 3.0], **how)


def tresca() -> Any:
    return friction(lf.Contact(friction=0.1, threshold=9.0, gap=-0.01, tangential_stiffness=1e4))


def bolted() -> Any:
    scene = lf.Scene()
    for name, z in (("lower", 0.0), ("upper", 20.0)):
        plate = lf.geometry.box((30, 30, 20), (2, 2, 1), origin=(0, 0, z), cell="hexahedron")
        scene.substructure(name, plate, STEEL, degree=2)
    scene.interface("joint", "lower:z1", "upper:z0", lf.Contact(friction=0.2))
    m12 = lf.BoltStiffness.vdi2230(d=12, pitch=1.75, shank=25, thread=15, E=205e3)
    scene.beam("bolt", "lower:z0", "upper:z1", m12, lf.Preload(20e3, until=1.0))
    scene.fix("lower:z0")
    scene.traction("upper:x1", LATER * (0, 0, 8e3 / 600))
    return lf.solve(lf.assemble(scene), times=[1.0, 1.5, 2.0])


def lap() -> Any:
    """Unlike meshes of two cells, glued."""
    scene = lf.Scene()
    one = lf.geometry.box((40, 10, 4), (4, 2, 1), cell="tetrahedron")
    scene.substructure("one", one, STEEL, degree=2)
    other = lf.geometry.box((40, 10, 4), (3, 1, 1), origin=(20, 0, 4), cell="hexahedron")
    scene.substructure("two", other, lf.LinearElastic(E=70e3, nu=0.33), degree=1)
    scene.interface("glue", "one:z1", "two:z0", lf.Perfect(), overlap="partial")
    scene.fix("one:x0")
    scene.traction("two:x1", (100.0, 0.0, 0.0))
    return lf.solve(lf.assemble(scene))


def matching() -> Any:
    """Glued node by node, with a prescribed displacement along own axes and a body force."""
    scene = lf.Scene()
    turned = np.array([[0.6, 0.8], [-0.8, 0.6]])
    plane = lf.LinearElastic(E=70e3, nu=0.3, plane="stress")
    for name, x in (("a", 0.0), ("b", 10.0)):
        part = lf.geometry.box((10, 5), (4, 2), origin=(x, 0), cell="triangle")
        scene.substructure(name, part, plane, degree=2, body_force=(0.0, -2.0))
    scene.interface("glue", "a:x1", "b:x0", lf.Perfect())
    scene.fix("a:x0")
    scene.interface("pull", "b:x1", lf.Displacement(0.01, components=(0,), frame=turned))
    return lf.solve(lf.assemble(scene))


def springs() -> Any:
    scene = stack(lf.Elastic(normal=5e3, tangential=1e3, jump=-0.02), "triangle", 2)
    scene.symmetry("top:x0")
    scene.pressure("top:y1", 30.0)
    return lf.solve(lf.assemble(scene))


def bond() -> Any:
    glue = lf.Debonding(normal=1e4, tangential=5e3, strength=15.0, energy=0.5)
    scene = stack(glue)
    scene.fix("top:y1", lf.Amplitude([0, 1], [0, 1]) * np.array([0.004, 0.012]))
    return lf.solve(lf.assemble(scene), times=[0.2, 0.4, 0.6, 0.8])


def section() -> Any:
    """A pretension section that is meshed, and a bond in three dimensions."""
    scene = lf.Scene()
    for k, name in enumerate(("foot", "shank", "head")):
        part = lf.geometry.box((4, 4, 8), (1, 1, 2), origin=(0, 0, 8 * k), cell="hexahedron")
        scene.substructure(name, part, STEEL)
    scene.interface("bolt", "foot:z1", "shank:z0", lf.Preload(force=800.0, until=1.0))
    glue = lf.Debonding(normal=1e5, tangential=5e4, strength=100.0, energy=0.5)
    scene.interface("glue", "shank:z1", "head:z0", glue)
    scene.fix("foot:z0")
    scene.fix("head:z1")
    scene.traction("shank:x1", LATER * (0.0, 10.0, 0.0))
    return lf.solve(lf.assemble(scene), times=[1.0, 1.5, 2.0])


def soft_contact() -> Any:
    scene = stack(lf.Contact(gap=lambda x: 1e-4 * x[:, 0], stiffness=1e5), degree=2)
    scene.interface("bed", "top:x0", lf.Elastic(normal=10.0, tangential=10.0))
    scene.pressure("top:y1", 20.0)
    return lf.solve(lf.assemble(scene))


def orthotropic() -> Any:
    wood = lf.OrthotropicElastic(E=(12e3, 0.8e3, 0.6e3), nu=(0.4, 0.3, 0.3), G=(0.7e3, 0.6e3, 0.1e3))
    scene = stack(lf.Contact(), material=wood)
    scene.pressure("top:y1", 2.0)
    scene.fix("top:x0", components=0)
    return lf.solve(lf.assemble(scene))


def heated() -> Any:
    scene = stack(lf.Contact(friction=0.4), material=lf.LinearElastic(E=200e3, nu=0.3, alpha=1.2e-5))
    scene.pressure("top:y1", 10.0)
    scene.interface("bed", "top:x0", lf.Elastic(normal=1.0))
    scene.temperature("top", LATER * 50.0)
    return lf.solve(lf.assemble(scene), times=[1.0, 1.5, 2.0])


def curved() -> Any:
    """A quarter of a ring pressed onto a shaft, on curved cells."""
    scene = lf.Scene()
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    for name, inner, outer, size in (("shaft", 5.0, 10.0, 2.0), ("ring", 10.0, 15.0, 3.0)):
        gmsh.clear()
        disc = gmsh.model.occ.addDisk(0, 0, 0, outer, outer)
        hole = gmsh.model.occ.addDisk(0, 0, 0, inner, inner)
        square = gmsh.model.occ.addRectangle(0, 0, 0, 20, 20)
        ring, _ = gmsh.model.occ.cut([(2, disc)], [(2, hole)])
        quarter, _ = gmsh.model.occ.intersect(ring, [(2, square)])
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(2, [quarter[0][1]], name="body")
        middles = {c[1]: gmsh.model.occ.getCenterOfMass(1, c[1]) for c in gmsh.model.getEntities(1)}
        for number, (x, y, _) in middles.items():
            bent = "out" if np.hypot(x, y) > 0.5 * (inner + outer) else "in"
            face = "x0" if x < 1e-6 else "y0" if y < 1e-6 else bent
            gmsh.model.addPhysicalGroup(1, [number], name=face)
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        gmsh.model.mesh.generate(2)
        part = lf.geometry.from_gmsh(gmsh.model, gdim=2, order=2).parts["body"]
        scene.substructure(name, part, STEEL, degree=2)
        scene.symmetry(f"{name}:x0")
        scene.symmetry(f"{name}:y0")
    gmsh.finalize()
    scene.interface("fit", "shaft:out", "ring:in", lf.Contact(gap=-0.02))
    return lf.solve(lf.assemble(scene))


SCENES: list[Callable[[], Any]] = [
    friction, tresca, bolted, lap, matching, springs, bond, section, soft_contact, orthotropic, heated,
    curved,
]  # fmt: skip


@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.__name__)
def test_valid(scene: Callable[[], Any], tmp_path: Path) -> None:
    answer = scene()
    assert answer.converged
    path = tmp_path / "answer.npz"
    answer.certificate(path)
    checked = tool.check(str(path))
    assert checked.failed == [], checked.used
    assert checked.error == answer.error and max(checked.used.values()) < 1.0


def test_quadratic_cells_with_friction(tmp_path: Path) -> None:
    friction(degree=2).certificate(tmp_path / "answer.npz")
    assert tool.check(str(tmp_path / "answer.npz")).failed == []


@pytest.fixture(scope="module")
def certified(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    path = tmp_path_factory.mktemp("certificate") / "answer.npz"
    friction(options=lf.Options(rtol=1e-4, newton=0)).certificate(path)
    with np.load(path, allow_pickle=False) as file:
        return {name: file[name] for name in file.files}


def failed(arrays: dict[str, Any], path: Path) -> set[str]:
    """Statements that fail."""
    np.savez(path, **arrays)
    return {each.split(",")[0] for each in tool.check(str(path)).failed}


def spoiled(arrays: dict[str, Any], name: str, change: Callable[[Any], Any]) -> dict[str, Any]:
    return {**arrays, name: change(np.array(arrays[name]))}


def joint_of(arrays: dict[str, Any]) -> tuple[int, float]:
    """Number of the joint, and ten times the stated error."""
    head = json.loads(str(arrays["certificate"]))
    return [i["name"] for i in head["interfaces"]].index("joint"), 10.0 * head["error"]


def test_ten_times_the_error_is_seen(certified: dict[str, Any], tmp_path: Path) -> None:
    """Displacements, forces, gap, sign, cone, balance and the error itself."""
    k, ten = joint_of(certified)
    path = tmp_path / "spoiled.npz"
    assert failed(certified, path) == set()
    force = f"interface{k}.force"

    def grown(values: Any) -> Any:
        return values * (1.0 + ten)

    assert "error" in failed(spoiled(certified, "part0.displacement", grown), path)
    assert "equilibrium" in failed(spoiled(certified, force, grown), path)

    def pulled(f: Any) -> Any:
        f[1, 0, 0] = ten * np.abs(f).max()
        return f

    assert "cone" in failed(spoiled(certified, force, pulled), path)

    def beyond(f: Any) -> Any:
        f[2, :, 1] = -0.3 * f[2, :, 0] * (1.0 + ten)
        return f

    assert "cone" in failed(spoiled(certified, force, beyond), path)

    def shifted(gap: Any) -> Any:
        return gap + 10.0 * ten * np.abs(certified["part1.displacement"]).max()

    assert failed(spoiled(certified, f"interface{k}.law.gap", shifted), path)

    def loaded(load: Any) -> Any:
        load[:, 0::2] += ten * 1000.0 / (load.shape[1] / 2.0)
        return load

    assert {"force", "equilibrium"} <= failed(spoiled(certified, "part1.load", loaded), path)
    head = json.loads(str(certified["certificate"]))
    small = {**certified, "certificate": np.array(json.dumps({**head, "error": 1e-4 * head["error"]}))}
    assert "error" in failed(small, path)


def test_a_support_that_gives_way_is_seen(certified: dict[str, Any], tmp_path: Path) -> None:
    _, ten = joint_of(certified)
    nodes = np.flatnonzero(certified["part0.nodes"][:, 1] < 1e-9)

    def sunk(u: Any) -> Any:
        u[:, 2 * nodes + 1] -= ten * np.abs(u).max()
        return u

    assert "held" in failed(spoiled(certified, "part0.displacement", sunk), tmp_path / "spoiled.npz")


def test_friction_that_forgets_its_slip_is_seen(tmp_path: Path) -> None:
    """A step left out of a history: the slip that it left is missing."""
    path = tmp_path / "answer.npz"
    friction(push=10.0).certificate(path)
    with np.load(path, allow_pickle=False) as file:
        certified = {name: file[name] for name in file.files}
    of_steps = ("load", "displacement", "reaction", "force", "values")
    without = {
        name: np.delete(values, 1, axis=0) if name.endswith(of_steps) or ".law." in name else values
        for name, values in certified.items()
    }
    assert {"law at every point"} <= failed(without, tmp_path / "spoiled.npz")


def test_what_cannot_be_certified_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "answer.npz"

    def refused(answer: Any, *words: str) -> None:
        with pytest.raises(lf.SceneError) as error:
            answer.certificate(path)
        assert all(word in str(error.value) for word in words), error.value
        assert not path.exists()

    scene = stack(lf.UserLaw(force=lambda jump: 1e3 * jump, name="rubber"))
    scene.pressure("top:y1", 1.0)
    refused(lf.solve(lf.assemble(scene)), "'joint'", "UserLaw")
    scene = stack(lf.Elastic(normal=1e3, tangential=1e3))
    scene.rigid("top:y1", y=-0.01)
    refused(lf.solve(lf.assemble(scene)), "rigid")
    scene = stack(lf.Elastic(normal=lf.LogNormal("k", 1e3, cov=0.1), tangential=1e3))
    scene.pressure("top:y1", 1.0)
    problem = lf.assemble(scene)
    refused(lf.solve(problem, chaos=2), "chaos")
    with pytest.raises(lf.SceneError, match="npz"):
        friction().certificate(tmp_path / "answer.h5")


def test_the_command(certified: dict[str, Any], tmp_path: Path) -> None:
    """VALID and 0, NOT VALID and 1, NOT READABLE and 2; it imports nothing of the package."""
    good, bad, none = (tmp_path / name for name in ("good.npz", "bad.npz", "none.npz"))
    np.savez(good, **certified)
    np.savez(bad, **spoiled(certified, "part1.displacement", lambda u: 1.1 * u))
    none.write_bytes(b"nothing")

    def run(*paths: Path) -> subprocess.CompletedProcess[str]:
        call = [sys.executable, "-I", "-X", "importtime", str(TOOL), *map(str, paths)]
        return subprocess.run(call, capture_output=True, text=True, check=False)

    valid = run(good)
    assert valid.returncode == 0 and "VALID" in valid.stdout and "NOT" not in valid.stdout
    imported = {line.rpartition("|")[2].strip() for line in valid.stderr.splitlines()}
    assert "scipy.sparse" in imported
    assert not imported & {"dolfinx", "dolfinx_frontend", "latin_core", "petsc4py", "ufl", "basix", "h5py"}
    wrong = run(good, bad)
    assert wrong.returncode == 1 and "NOT VALID" in wrong.stdout and "error, step" in wrong.stdout
    assert run(none, bad).returncode == 2
