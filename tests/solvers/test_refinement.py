"""A direct solution checks and corrects itself: springs and loads of any size, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

import dolfinx_frontend as lf
from dolfinx_frontend import Amplitude, Elastic, LinearElastic, Perfect, Scene, assemble, geometry, solve
from dolfinx_frontend.assembly.problem import Problem
from latin_core import Options

E = 100.0
EPS = 2.0**-52
FACTOR = 3.0
"""An error may be this much larger than what is said of it: the promise of ``converged``."""


def two_blocks(law, moduli=(E, E), pull=1.0, cells=(2, 2), body=None) -> Problem:
    """Two unit squares without Poisson's effect side by side, the left one held, the right one pulled."""
    scene = Scene()
    for number, (name, modulus) in enumerate(zip(("left", "right"), moduli, strict=True)):
        part = geometry.box((1.0, 1.0), cells, origin=(float(number), 0.0))
        scene.substructure(name, part, LinearElastic(modulus, 0.0), degree=1)
    scene.interface("layer", "left:x1", "right:x0", law)
    scene.fix("left:x0", name="wall")
    scene.traction("right:x1", (pull, 0.0), name="pull")
    return assemble(scene)


def strain_error(problem: Problem, result, moduli, opening: float, pull: float = 1.0) -> dict[str, float]:
    """Relative errors of the parts' strain, measured in extended precision."""
    errors = {}
    x0, moved = 0.0, 0.0
    for name, modulus in zip(("left", "right"), moduli, strict=True):
        part = problem.substructures[name]
        x = part.dof_coordinates[:, 0].astype(np.longdouble)
        exact = np.zeros((len(x), 2), dtype=np.longdouble)
        exact[:, 0] = moved + np.longdouble(pull) / modulus * (x - x0)
        error = np.asarray(result.displacements[name].reshape(-1, 2) - exact, dtype=np.float64).ravel()
        rigid = np.linalg.qr(part.rigid_modes)[0]
        error -= rigid @ (rigid.T @ error)
        strain = pull / modulus * part.dof_coordinates[:, 0]
        strained = np.column_stack([strain - strain.mean(), np.zeros_like(strain)]).ravel()
        errors[name] = float(
            np.sqrt(error @ (part.matrix @ error) / (strained @ (part.matrix @ strained)))
        )
        x0, moved = x0 + 1.0, exact[:, 0].max() + np.longdouble(opening)
    return errors


@pytest.mark.parametrize("decade", [*range(-15, -6), -4, 0, 4, 6, *range(7, 24, 2)])
def test_springs_of_any_stiffness(decade):
    kappa = E * 10.0**decade
    problem = two_blocks(Elastic(normal=kappa, tangential=kappa))
    result = solve(problem)
    force, jump = result.force("layer"), result.jump("layer")
    # a force is an unknown or a product of one, never a difference of large ones
    assert force[:, 0] == pytest.approx(1.0, rel=1e-9)
    assert np.abs(force[:, 1]).max() < 1e-9
    assert jump[:, 0] == pytest.approx(1.0 / kappa, rel=1e-6, abs=100.0 * EPS / E)
    table = result.table("layer")
    assert table.value("force_x", "layer") == pytest.approx(1.0, rel=1e-9)
    errors = strain_error(problem, result, (E, E), 1.0 / kappa)
    assert max(errors.values()) <= FACTOR * result.error + 1e-13
    assert result.converged == (result.error <= result.plan.options.rtol)
    # what a double leaves of the strain of a part that has moved by 1 / kappa, and not much more is said
    assert result.error < 100.0 * EPS * max(1.0, E / kappa, min(kappa / E, 1e5))


def test_what_rounding_hides_is_said_with_its_place(caplog):
    problem = two_blocks(Elastic(normal=1e-12 * E, tangential=1e-12 * E))
    result = solve(problem)
    assert result.status == "inexact" and result.place == "part right" and not result.converged
    assert result.statuses == ("inexact",)
    for text in (repr(result), result.ended, caplog.text):
        assert "part right" in text and "inf" not in text.replace("inexact", "").replace("information", "")
    assert "loosen rtol" in result.ended and result.error < 1e-3
    assert solve(problem, options=Options(rtol=1e-3)).status == "converged"


@pytest.mark.parametrize("normal", [1e-13, 1e-5, 1e13])
@pytest.mark.parametrize("tangential", [1e-13, 1e-5, 1e13])
def test_directions_of_a_spring_apart(normal, tangential):
    """Soft along the face and stiff across it, and with a jump that is imposed."""
    law = Elastic(normal=normal * E, tangential=tangential * E, jump=0.01)
    result = solve(two_blocks(law))
    assert result.force("layer")[:, 0] == pytest.approx(1.0, rel=1e-9)
    opening = 0.01 + 1.0 / (normal * E)
    assert result.jump("layer")[:, 0] == pytest.approx(opening, rel=1e-9)


def test_a_part_between_two_soft_springs():
    """What floats is found by the springs together, not one by one."""
    scene = Scene()
    for number, name in enumerate(("a", "b", "c")):
        part = geometry.box((1.0, 1.0), (2, 2), origin=(float(number), 0.0))
        scene.substructure(name, part, LinearElastic(E, 0.3), degree=1)
    scene.fix("a:x0", name="wall")
    scene.fix("c:x1", name="end")
    soft, softer = 1e-12 * E, 1e-15 * E
    scene.interface("one", "a:x1", "b:x0", Elastic(soft, soft))
    scene.interface("two", "b:x1", "c:x0", Elastic(softer, softer))
    scene.traction("b:y1", (1.0, 0.0), name="load")
    result = solve(assemble(scene))
    share = soft / (soft + softer)
    table = result.table()
    # the moment of the load turns b; its resultant is shared by the stiffness of the springs
    assert abs(table.value("force_x", "one")) == pytest.approx(share, rel=1e-9)
    assert abs(table.value("force_x", "two")) == pytest.approx(1.0 - share, rel=1e-6)


def test_prescribed_displacements_and_loads_of_any_size():
    for size in (1e-290, 1e-12, 1.0, 1e12, 1e290):
        result = solve(two_blocks(Elastic(E, E), pull=size))
        assert result.converged and 0.0 < result.error < 1e-13
        assert result.force("layer")[:, 0] == pytest.approx(size, rel=1e-12)
    still = solve(two_blocks(Elastic(E, E), pull=0.0))
    assert still.converged and still.error == 0.0


@pytest.mark.parametrize("contrast", [1e-12, 1e-8, 1e-4, 1e4, 1e8])
def test_contrast_of_glued_parts(contrast):
    problem = two_blocks(Perfect(), (E, contrast * E))
    result = solve(problem)
    errors = strain_error(problem, result, (E, contrast * E), 0.0)
    assert max(errors.values()) <= FACTOR * result.error
    assert result.converged


def test_every_step_has_its_status():
    """A linear history: the error of a step is relative to that step."""
    scene = Scene()
    for number, name in enumerate(("left", "right")):
        part = geometry.box((1.0, 1.0), (2, 2), origin=(float(number), 0.0))
        scene.substructure(name, part, LinearElastic(E, 0.0), degree=1)
    kappa = 1e-11 * E
    scene.interface("layer", "left:x1", "right:x0", Elastic(kappa, kappa))
    scene.fix("left:x0", name="wall")
    scene.traction("left:x1", (1.0, 0.0), name="first")
    scene.traction("right:x1", Amplitude([0.0, 1.0, 2.0], [0.0, 0.0, 1.0]) * (1.0, 0.0), name="pull")
    result = solve(assemble(scene), times=[0.0, 1.0, 2.0])
    assert result.step_errors.shape == (3,)
    assert result.step_errors[1] < 1e-13 and result.step_errors[2] > 1e-6
    assert result.statuses == ("converged", "converged", "inexact")
    assert result.place == "part right, step 2" and result.error == result.step_errors.max()
    assert result.force("layer")[2, :, 0] == pytest.approx(1.0, rel=1e-12)


@pytest.mark.filterwarnings("ignore:(overflow|invalid value) encountered:RuntimeWarning")
@pytest.mark.parametrize(
    "law",
    [lf.Elastic(normal=1e-250, tangential=1.0), lf.Elastic(normal=1.0, tangential=1.0, jump=1e308)],
)
def test_what_is_no_number_is_not_converged(law):
    """Energies, the squares of what these make, are beyond double precision."""
    scene = lf.Scene()
    for name, x in (("a", 0.0), ("b", 1.0)):
        square = lf.geometry.box((1.0, 1.0), (2, 2), origin=(x, 0.0))
        scene.substructure(name, square, lf.LinearElastic(100.0, 0.3), degree=1)
    scene.fix("a:x0", name="wall")
    scene.interface("layer", "a:x1", "b:x0", law)
    scene.traction("b:x1", (1.0, 0.2), name="pull")
    result = lf.solve(lf.assemble(scene))
    assert result.status == "inexact"
    assert np.isnan(result.error)
    assert "not known" in result.ended
