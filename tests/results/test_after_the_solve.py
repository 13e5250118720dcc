"""What a person asks after the solve: stresses made of components, the use of friction, numbers by name."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyvista
from dolfinx import fem

import dolfinx_frontend as lf
from dolfinx_frontend.results.stress import Shared, broken_space

BOLT = lf.BoltStiffness.vdi2230(d=12.0, pitch=1.75, shank=25.0, thread=15.0, E=205e3)
AREA, E = 900.0, 200e3


def bolted(preload: Any, load: float, shear: float = 0.0) -> lf.Problem:
    """Two plates of 30 x 30 x 20 clamped by a bolt, pulled apart and pushed aside after the tightening."""
    scene = lf.Scene()
    for name, z in (("lower", 0.0), ("upper", 20.0)):
        plate = lf.geometry.box((30, 30, 20), (2, 2, 1), origin=(0, 0, z), cell="hexahedron")
        scene.substructure(name, plate, lf.LinearElastic(E=E, nu=0.0), degree=1)
    scene.interface("joint", "lower:z1", "upper:z0", lf.Contact(friction=0.2))
    scene.beam("bolt", "lower:z0", "upper:z1", BOLT, lf.Preload(preload, until=1.0))
    scene.fix("lower:z0")
    later = lf.Amplitude([1, 2], [0, 1])
    scene.traction("upper:z1", later * (0.0, 0.0, load / AREA), name="pull")
    if shear:
        scene.traction("upper:z0", later * (shear / AREA, 0.0, 0.0), name="push")
    return lf.assemble(scene)


@pytest.fixture(scope="module")
def samples() -> Any:
    problem = bolted(lf.Normal("F_V", 20e3, cov=0.1), 9e3)
    return lf.quasi_monte_carlo(problem, 32, times=[1.0, 2.0], keep_states=True, progress=False)


def test_columns_of_the_table_are_quantities(samples: Any) -> None:
    table = samples.table()
    for text, column in (("joint.pressure_min", "pressure_min"), ("bolt.axial.normal", "normal")):
        quantity = samples.quantity(text, unit="N")
        name = text.rpartition(".")[0]
        assert quantity.name == text and len(quantity.values) == 32
        assert quantity.mean().value == pytest.approx(table.value(column, name, statistic="mean"), rel=1e-12)
    before = samples.quantity("bolt.axial.normal", step=0)
    preloads = 20e3 * (1.0 + 0.1 * samples.germs[:, 0])
    assert before.values == pytest.approx(preloads, rel=1e-6)
    with pytest.raises(lf.SceneError, match="'joint.pressure'"):
        samples.quantity("joint.pressure")
    with pytest.raises(lf.SceneError, match="joints"):
        samples.quantity("joints.normal")
    with pytest.raises(lf.SceneError, match="no slip_use"):
        samples.quantity("bolt.axial.slip_use")


def test_a_reaction_is_a_quantity() -> None:
    """Of a support the balance: what is pulled."""
    result = lf.solve(bolted(20e3, 9e3), times=[1.0, 2.0], options=lf.Options(rtol=1e-9))
    support = next(n for n in result.problem.interfaces if "lower:z0" in n)
    pulled = result.table(support).value("force_z", support)
    assert result.quantity(f"{support}.force_z").values == pytest.approx([pulled])


def test_stress_made_of_samples_is_that_of_each(samples: Any) -> None:
    """Uniaxial: stress = -clamping / area, and von Mises its size; the deviation that of the clamping."""
    clamping = -samples.quantity("joint.normal").values / AREA
    tensor = samples.stress("upper")
    mises, deviation = samples.stress("upper", of="von Mises"), samples.std("upper", of="von Mises")
    first = samples.stress("upper", of="principal").x.array.reshape(-1, 3)
    assert tensor.x.array.reshape(-1, 9)[:, 8] == pytest.approx(-clamping.mean(), rel=1e-6)
    assert mises.x.array == pytest.approx(clamping.mean(), rel=1e-6)
    assert deviation.x.array == pytest.approx(clamping.std(), rel=1e-5)
    assert first[:, 2] == pytest.approx(-clamping.mean(), rel=1e-6)
    assert first[:, :2] == pytest.approx(0.0, abs=1e-5 * clamping.mean())
    with pytest.raises(lf.SceneError, match="of = 'mises'"):
        samples.stress("upper", of="mises")


def test_stress_made_of_a_chaos() -> None:
    """A bar under a random pull t: the mean of |t| is its mean, and far from that of a rounded number."""
    scene = lf.Scene()
    bar = lf.geometry.box((20, 10, 10), (2, 1, 1), cell="hexahedron")
    scene.substructure("bar", bar, lf.LinearElastic(E=E, nu=0.0), degree=1)
    scene.fix("bar:x0", components=0)
    scene.fix_point("bar", (0, 0, 0))
    scene.fix_point("bar", (0, 10, 0), components=2)
    scene.traction("bar:x1", (lf.Normal("t", 0.0, std=3.0), 0.0, 0.0))
    chaos = lf.solve(lf.assemble(scene), chaos=1)
    assert np.abs(chaos.stress("bar").x.array).max() < 1e-9  # the mean of the stress is 0
    # E |t| = sqrt(2 / pi) std; 512 Sobol points have it to 1 %
    assert chaos.stress("bar", of="von Mises").x.array == pytest.approx(3.0 * np.sqrt(2 / np.pi), rel=0.01)


def test_slip_use() -> None:
    """Of a joint that is pushed by F: F / (mu N), point by point and as one number."""
    push = 1500.0
    result = lf.solve(bolted(20e3, 0.0, push), times=[1.0, 2.0], options=lf.Options(rtol=1e-9))
    table = result.table("joint")
    normal, shear = -table.value("normal", "joint"), table.value("shear", "joint")
    assert table.value("slip_area", "joint") == 0.0
    fields = lf.io.facets.interface_fields(result, "joint")
    weights = result.problem.interfaces["joint"].weights
    use = fields["slip use"][-1]
    force = np.linalg.norm(fields["shear"][-1], axis=1)
    assert use == pytest.approx(force / (0.2 * fields["pressure"][-1]), rel=1e-12)
    expected = weights @ force / (0.2 * normal)
    assert table.value("slip_use", "joint") == pytest.approx(expected, rel=1e-9)
    assert shear / (0.2 * normal) <= expected < 1.0  # it is a resultant, parts of which may cancel


def test_cells_share_nodes_in_files(tmp_path: Path) -> None:
    """The surface of a shared grid is that of the box; at a node the mean of the cells, by volume."""
    part = lf.geometry.box((3.0, 1.0, 1.0), (3, 1, 1), cell="hexahedron")
    u = fem.Function(fem.functionspace(part.mesh, ("Lagrange", 2, (3,))))
    u.interpolate(lambda x: 1e-3 * x)
    shared = pyvista.read(lf.io.write_fields({"a": u}, tmp_path / "s.vtm"))["a"]
    own = pyvista.read(lf.io.write_fields({"a": u}, tmp_path / "o.vtm", shared=False))["a"]
    assert (shared.n_points, own.n_points) == (7 * 9, 3 * 27)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a default that newer releases of pyvista will change
        counts = [mesh.extract_surface(nonlinear_subdivision=0).n_cells for mesh in (shared, own)]
    assert counts == [14, 18]
    assert shared["displacement"] == pytest.approx(1e-3 * shared.points, abs=1e-12)

    mesh = lf.geometry.box((3.0, 1.0, 1.0), (3, 1, 1), cell="hexahedron").mesh
    mesh.geometry.x[:, 0] = np.interp(mesh.geometry.x[:, 0], [0, 1, 2, 3], [0, 2, 3, 6])
    flat = fem.Function(fem.functionspace(mesh, ("Lagrange", 1)))
    steps = fem.Function(broken_space(flat, (), 1))
    steps.interpolate(lambda x: np.zeros(x.shape[1]))
    x = steps.function_space.tabulate_dof_coordinates()
    cells = steps.function_space.dofmap.list
    for cell in cells:
        steps.x.array[cell] = x[cell, 0].mean()
    found = Shared(steps).function(steps)
    at = found.function_space.tabulate_dof_coordinates()[:, 0]
    expected = np.select(
        [at < 1, at < 2.5, at < 4], [1.0, (2 * 1.0 + 2.5) / 3, (2.5 + 3 * 4.5) / 4], default=4.5
    )
    assert found.x.array == pytest.approx(expected, rel=1e-12)


def test_pictures(samples: Any, tmp_path: Path) -> None:
    path = lf.figures.stress_figure(samples, tmp_path / "a.png", limits=(0, 20), renderer="matplotlib")
    assert path.stat().st_size > 2000
    plain = {"parts": "upper", "renderer": "matplotlib"}
    path = lf.figures.stress_figure(samples, tmp_path / "b.png", of="zz", deviation=True, **plain)
    assert path.stat().st_size > 2000
    with pytest.raises(lf.SceneError, match="low < high"):
        lf.figures.stress_figure(samples, tmp_path / "c.png", limits=(2, 1))
    with pytest.raises(lf.SceneError, match="middle"):
        lf.figures.stress_figure(samples, tmp_path / "c.png", parts=["middle"])
    with pytest.raises(lf.SceneError, match="of = 'mises'"):
        lf.figures.stress_figure(samples, tmp_path / "c.png", of="mises")
    load = np.linspace(0.0, 3.0, 4)
    bolt, clamped = 2.0 + 0.1 * load, 2.0 - 0.9 * load
    path = lf.figures.joint_diagram(load, bolt, clamped, tmp_path / "d.png", stiffness=1.0)
    assert path.stat().st_size > 2000
    with pytest.raises(lf.SceneError, match=r"bolt \(3,\)"):
        lf.figures.joint_diagram(load, load[:3], load, tmp_path / "d.png", stiffness=1.0)


def springs_in_series() -> lf.Problem:
    """Three blocks in a row with two random springs between them, pulled by a force."""
    scene = lf.Scene()
    for k in range(3):
        block = lf.geometry.box((1.0, 1.0), (1, 1), origin=(float(k), 0.0))
        scene.substructure(f"p{k}", block, lf.LinearElastic(E=1e4, nu=0.0), degree=1)
        scene.symmetry(f"p{k}:y0")
    scene.interface("soft", "p0:x1", "p1:x0", lf.Elastic(normal=lf.LogNormal("k1", 10.0, cov=0.3)))
    scene.interface("hard", "p1:x1", "p2:x0", lf.Elastic(normal=lf.LogNormal("k2", 20.0, cov=0.2)))
    scene.fix("p0:x0", components=0)
    scene.traction("p2:x1", (5.0, 0.0), name="pull")
    return lf.assemble(scene)


def test_sobol_indices_of_any_quantity() -> None:
    """The end moves by p (1 / k1 + 1 / k2): Var(1 / k) = cov^2 (1 + cov^2)^2 / mean^2. The force is given."""
    problem = springs_in_series()

    def longer(block: Any) -> Any:
        return sum(block.jump(name)[..., 0].mean(axis=-1) for name in ("soft", "hard"))

    own = np.array([(c * (1.0 + c**2) / k) ** 2 for c, k in ((0.3, 10.0), (0.2, 20.0))])
    truth = dict(zip(("k1", "k2"), own / own.sum(), strict=True))
    chaos = lf.solve(problem, chaos=6, progress=False)
    for answer in (chaos, lf.quasi_monte_carlo(problem, 128, progress=False)):
        found = answer.quantity(longer).sobol()
        for name, share in truth.items():
            assert [each.value for each in found[name]] == pytest.approx([share, share], abs=1e-5)
            assert all(each.low - 1e-5 <= share <= each.high + 1e-5 for each in found[name])
        assert "no variance" in str(answer.quantity("soft.normal").sobol())
    assert all(np.isnan(each.total).all() for each in chaos.sobol("soft").values())
    with pytest.raises(lf.SceneError, match="Sobol"):
        lf.solve(springs_at_means()).quantity("soft.normal").sobol()


def springs_at_means() -> lf.Problem:
    return springs_in_series().with_laws(values={"soft.normal": 10.0, "hard.normal": 20.0})
