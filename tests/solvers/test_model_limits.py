"""Where the model ends it is said, once, with the place and the cause: closed forms of bars and blocks."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import dolfinx_frontend as lf
from dolfinx_frontend.results.deformation import deformations

STEEL = lf.LinearElastic(210e3, 0.0)


def said(call: Callable[[], Any]) -> list[str]:
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        call()
    return [str(each.message) for each in found]


def bar(strain: float, material: lf.LinearElastic = STEEL, s: float = 1.0, E: float = 210e3) -> lf.Problem:
    """A bar of 100 x 10 mm that is stretched."""
    scene = lf.Scene()
    scene.substructure("bar", lf.geometry.box((100 * s, 10 * s), (10, 2)), material)
    scene.fix("bar:x0")
    scene.traction("bar:x1", (strain * E, 0.0))
    return lf.assemble(scene)


def solved(problem: lf.Problem) -> list[str]:
    return said(lambda: lf.solve(problem))


def test_nothing_is_said_within_the_model() -> None:
    assert solved(bar(0.009)) == []


def test_a_strain_above_one_per_cent_is_said_with_its_place() -> None:
    """The bar has the strain everywhere; its end moves by 1.1 of 100.5 mm."""
    [text] = solved(bar(0.011))
    assert text.startswith("beyond the model: strain 0.011, part 'bar' at (")
    assert "stress of 2.31e+03" in text


def test_a_displacement_of_five_per_cent_is_said() -> None:
    texts = solved(bar(0.06))
    assert [text.split()[3] for text in texts] == ["displacement", "strain"]
    assert "displacement 6 is 0.06 of the size of the assembly, part 'bar' at (100, " in texts[0]


@pytest.mark.parametrize(
    ("s", "E", "unit"),
    [(1e-3, 210e3, "E in MPa with a mesh in m?"), (1.0, 0.21, "E in GPa? Then E is 210 with a mesh in mm")],
)
def test_a_mistake_of_units_is_named_and_nothing_else(s: float, E: float, unit: str) -> None:
    """A stress of 210 MPa in the other unit: a strain of 1e-3 becomes one of 1e3 and 1e3."""
    texts = solved(bar(1e3, lf.LinearElastic(E, 0.0), s, E))
    assert len(texts) == 1 and unit in texts[0] and "displacement 995 times the assembly" in texts[0]


def test_a_modulus_in_pascals_with_a_mesh_in_millimetres_is_named() -> None:
    [text] = solved(bar(1e-10, lf.LinearElastic(210e9, 0.0), E=210e9))
    assert "E in Pa with a mesh in mm? Then E is 2.1e+05" in text


@pytest.mark.parametrize(("degrees", "count"), [(4.5, 0), (5.5, 1)])
def test_a_rotation_above_five_degrees_is_said(degrees: float, count: int) -> None:
    """A small block on a long bed is turned: its linear rotation is exact."""
    phi = np.radians(degrees)
    scene = lf.Scene()
    scene.substructure("bed", lf.geometry.box((100.0, 10.0), (4, 1)), STEEL)
    scene.substructure("block", lf.geometry.box((10.0, 10.0), (2, 2), origin=(0.0, 20.0)), STEEL)
    scene.fix("bed:y0")
    for face in ("x0", "x1", "y0", "y1"):
        scene.fix(f"block:{face}", lambda x: phi * np.column_stack([25.0 - x[:, 1], x[:, 0] - 5.0]))
    texts = solved(lf.assemble(scene))
    assert len(texts) == count
    assert all(f"rotation by {degrees:.2g} degrees, part 'block'" in text for text in texts)


def pulled(yield_stress: float) -> lf.Problem:
    """A bar under a tension of 210 MPa, which is its von Mises stress."""
    scene = lf.Scene()
    steel = lf.LinearElastic(210e3, 0.0, yield_stress=yield_stress)
    scene.substructure("bar", lf.geometry.box((4.0, 1.0, 1.0), (2, 1, 1)), steel, degree=1)
    scene.fix("bar:x0")
    scene.traction("bar:x1", (210.0, 0.0, 0.0))
    return lf.assemble(scene)


def test_yielding_is_said_where_a_yield_stress_is_given() -> None:
    assert solved(pulled(215.0)) == []
    [text] = solved(pulled(200.0))
    assert "von Mises stress 210 above the yield stress 200, part 'bar'" in text and "1 of its cells" in text
    with pytest.raises(lf.SceneError, match="yield_stress"):
        lf.LinearElastic(1.0, 0.3, yield_stress=-1.0)


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_deformations_of_a_linear_field_are_exact(cell: str) -> None:
    scene = lf.Scene()
    scene.substructure("a", lf.geometry.box((3.0, 2.0), (3, 2), cell=cell), STEEL)
    scene.fix("a:x0")
    part = lf.assemble(scene).substructures["a"]
    gradient = np.array([[0.01, 0.03], [-0.01, -0.02]])
    found = deformations(part, (part.dof_coordinates @ gradient.T).reshape(1, -1), np.ones(1, bool))
    principal = np.linalg.eigvalsh(0.5 * (gradient + gradient.T))
    assert found.strain.value == pytest.approx(np.abs(principal).max(), rel=1e-12)
    assert found.rotation.value == pytest.approx(0.02, rel=1e-12)
    assert found.displacement.value == pytest.approx(np.linalg.norm(gradient @ (3.0, 2.0)), rel=1e-12)


def test_a_friction_in_per_cent_is_said_when_it_is_declared() -> None:
    scene = lf.Scene()
    for name, y in (("low", 0.0), ("high", 1.0)):
        scene.substructure(name, lf.geometry.box((1.0, 1.0), (1, 1), origin=(0.0, y)), STEEL)
    with pytest.warns(lf.SceneWarning, match="'joint': Contact: friction = 20 .* friction = 0.2"):
        scene.interface("joint", "low:y1", "high:y0", lf.Contact(friction=20))
    with pytest.warns(lf.SceneWarning, match="mu_thread = .* is beyond 1.5"):
        mu = lf.LogNormal("mu", 12.0, cov=0.1)
        law = lf.Preload(torque=1e3, mu_thread=mu, mu_head=0.1, d=10.0, pitch=1.5)
        scene.interface("bolt", "low:x1", "high:x0", law)


def test_a_scatter_in_per_cent_is_said_when_it_is_declared() -> None:
    with pytest.warns(lf.SceneWarning, match="'F': cov = 15 .* cov=0.15"):
        lf.Normal("F", 20e3, cov=15)
    assert said(lambda: lf.Normal("gap", 0.01, std=0.02)) == []
    assert len(said(lambda: lf.RandomField("k", 1.0, cov=15, length=1.0).deviation)) == 1


def test_a_thermal_strain_that_no_solid_has_is_said() -> None:
    scene = lf.Scene()
    scene.substructure("bar", lf.geometry.box((1.0, 1.0), (1, 1)), lf.LinearElastic(1e3, 0.0, alpha=11.5))
    with pytest.warns(lf.SceneWarning, match=r"temperature of 'bar': .* 11.5e-6 is one"):
        scene.temperature("bar", lf.Amplitude([0, 1], [0, 1]) * lf.Normal("dT", 80.0, cov=0.1))
    assert said(lambda: scene.temperature("bar", 80.0, alpha=12e-6)) == []


def tightened(force: Any) -> lf.Problem:
    scene = lf.Scene()
    for name, x in (("left", 0.0), ("right", 10.0)):
        scene.substructure(name, lf.geometry.box((10.0, 10.0), (1, 1), origin=(x, 0.0)), STEEL)
    scene.interface("bolt", "left:x1", "right:x0", lf.Preload(force, until=1.0))
    scene.fix("left:x0")
    scene.fix("right:x1", name="wall")
    return lf.assemble(scene)


def test_samples_that_tighten_with_a_negative_force_are_counted() -> None:
    """cov = 0.8: 1.25 deviations lie between the mean and 0."""
    problem = tightened(lf.Normal("F", 100.0, cov=0.8))
    germs = np.array([[-2.0], [-1.3], [-1.2], [0.0]])
    texts = said(lambda: lf.sample(problem, germs, times=[1.0, 2.0], progress=False))
    assert len(texts) == 1
    assert "'bolt': 2 of 4 samples tighten the bolt with a negative force (the least -60)" in texts[0]


def soft(E: Any) -> lf.Problem:
    """A bar whose end is pulled through a spring by 210 MPa."""
    scene = lf.Scene()
    scene.substructure("bar", lf.geometry.box((100.0, 10.0), (10, 2)), lf.LinearElastic(E, 0.0))
    scene.fix("bar:x0")
    scene.interface("side", "bar:y0", lf.Elastic(normal=1e-3))
    scene.traction("bar:x1", (210.0, 0.0))
    return lf.assemble(scene)


def test_of_samples_the_one_that_moves_most_is_looked_at() -> None:
    """A strain of 210 / E: beyond 1 % where E is below 21 000."""
    problem = soft(lf.Uniform("E", 15e3, 45e3))
    germs = np.array([[0.5], [-0.9], [-0.5], [0.9]])  # 37 500, 16 500, 22 500, 43 500
    [text] = said(lambda: lf.sample(problem, germs, progress=False))
    assert "strain 0.013, part 'bar' at (" in text and "sample 1" in text
    assert said(lambda: lf.sample(problem, germs[[0, 3]], progress=False)) == []


def test_of_a_sweep_too() -> None:
    """Where a mistake of units is named."""
    problem = soft(0.21)
    [text] = said(lambda: lf.sweep(problem, {"side.normal": [1e-9, 2e-9]}, progress=False))
    assert "E in GPa?" in text and "sweep point" in text


def test_a_warning_is_given_once_in_a_call() -> None:
    """accuracy= solves many times."""
    texts = said(lambda: lf.solve(bar(0.02), accuracy=0.1, quantity="energy"))
    assert len([text for text in texts if "strain 0.02" in text]) == 1
