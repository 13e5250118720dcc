"""Scenes with random fields solved to an accuracy: what the modes of a field leave out takes its share."""

from __future__ import annotations

import pytest

from dolfinx_frontend import geometry
from dolfinx_frontend.assembly.assemble import assemble
from dolfinx_frontend.results.resultant import Resultant
from dolfinx_frontend.scene.laws import Contact, Elastic
from dolfinx_frontend.scene.materials import LinearElastic
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.solving import solve
from dolfinx_frontend.uncertainty.fields import RandomField
from dolfinx_frontend.uncertainty.parameters import LogNormal

SLIP = Resultant("layer", of="jump", component=1)

MEAN, DEVIATION, KNOWN = 3.608e-3, 1.3480e-3, 3e-4
"""Of the slip with the whole field: on uniform meshes of degree 2 with 16, 32 and 64 cells across and 32, 64
and 128 modes 16384, 16384 and 4096 Sobol points give means of 3.60314, 3.60584 and 3.60667e-3, deviations of
1.34645, 1.34774 and 1.34730e-3; carried on to 3.608 and 1.348 +- 0.001, known to 3e-4."""


def blocks(young: float, height: float, cells: tuple[int, int], field: RandomField, shear: float) -> Scene:
    """Two blocks on each other, pulled, with springs between them that vary from place to place."""
    scene = Scene()
    for name, x0 in (("left", 0.0), ("right", 1.0)):
        part = geometry.box((1.0, height), cells, (x0, 0.0), "triangle")
        scene.substructure(name, part, LinearElastic(E=young, nu=0.3), degree=1)
    scene.fix("left:x0", name="wall")
    scene.traction("right:x1", (1.0, shear), name="pull")
    scene.interface("layer", "left:x1", "right:x0", Elastic(normal=field, tangential=field))
    return scene


def layer(modes: int) -> Scene:
    """Soft ones."""
    field = RandomField("k", mean=100.0, cov=0.5, length=0.5, modes=modes, distribution="lognormal")
    return blocks(30.0, 1.0, (2, 4), field, 0.3)


@pytest.mark.parametrize(("modes", "accuracy"), [(2, 4e-2), (3, 2e-2), (4, 9e-3)])
def test_meshes_leave_room_for_what_fields_leave_out(modes: int, accuracy: float) -> None:
    result = solve(layer(modes), accuracy=accuracy, quantity=SLIP, progress=False)
    made, value = result.errors(), result.mean_std(SLIP)
    assert made.field is not None and value.std is not None
    off = max(abs(value.mean / MEAN - 1.0), abs(value.std / DEVIATION - 1.0))
    assert made.reached and 0.4 * accuracy < off <= made.in_all + KNOWN


def test_what_fields_leave_out_may_be_more_than_is_asked() -> None:
    result = solve(layer(3), accuracy=6e-3, quantity=SLIP, progress=False)
    made = result.errors()
    assert not made.reached and made.dominating == "field"
    assert abs(result.mean_std(SLIP).mean / MEAN - 1.0) <= made.in_all + KNOWN


def test_one_mode_left_out_of_a_long_field() -> None:
    """Stiff blocks: what one mode does goes with its square, of which few draws know little. All modes by
    Sobol points on meshes of 16 and 32 cells across: 1.3e-2 more scatter; 8e-3 was said."""
    field = RandomField(
        "k", mean=105.0, cov=0.49, covariance="gaussian", length=3.37, modes=1, distribution="lognormal"
    )
    scene = blocks(1e4, 1.24, (2, 3), field, 0.4)
    made = solve(scene, accuracy=1e-2, quantity=Resultant("layer", of="jump"), progress=False).errors()
    assert not made.reached and 1.2e-2 <= made.relative("field") <= 3.0 * 1.3e-2


def block(gap: RandomField, cells: tuple[int, int, int], down: float) -> Scene:
    """A stiff block above a bed whose distance varies, moved down."""
    scene = Scene()
    part = geometry.box((4.0, 2.0, 1.0), cells, cell="hexahedron")
    scene.substructure("block", part, LinearElastic(E=1e7, nu=0.0), degree=1)
    scene.symmetry(["block:x0", "block:y0"])
    scene.interface("bed", "block:z0", Contact(gap=gap, stiffness=1000.0))
    scene.fix("block:z1", -down, components=2)
    return scene


def test_a_contact_that_a_field_opens_is_not_believed_on_its_first_points() -> None:
    """At the mean all points touch alike, and nothing tells of the edge that there is elsewhere: 3 % off,
    5e-3 was said. 2048 Sobol points on 16 x 8 cells: -48.93 +- 25.19."""
    gap = RandomField("gap", 0.01, std=0.004, covariance="gaussian", length=2.0, modes=6)
    scene = block(gap, (2, 1, 1), 0.016)
    result = solve(scene, accuracy=2e-2, quantity="bed", progress=False, max_unknowns=3000)
    made, value = result.errors(), result.mean_std("bed")
    assert value.std is not None
    off = max(abs(value.mean / -48.93 - 1.0), abs(value.std / 25.19 - 1.0))
    assert not made.in_all < 0.5 * off and (not made.reached or off <= 2e-2)


def test_values_of_a_field_that_meshes_are_judged_at_are_those_of_their_points() -> None:
    """No point touches at the means: the meshes are judged where the field is one deviation off."""
    gap = RandomField("gap", 0.01, std=0.004, covariance="gaussian", length=4.0, modes=3)
    scene = block(gap, (4, 2, 1), 0.008)
    result = solve(scene, accuracy=1e-1, quantity="bed", progress=False, max_unknowns=2000)
    assert result.mean_std("bed").std


def rod(modes: int) -> Scene:
    """A rod whose modulus varies along it, 0.5 longer than the gap between a wall and a random spring."""
    modulus = RandomField("E", 2.0, cov=0.3, length=5.0, distribution="lognormal", modes=modes)
    scene = Scene()
    part = geometry.box((10.0, 1.0, 1.0), (20, 1, 1))
    scene.substructure("rod", part, LinearElastic(modulus, 0.0), degree=1)
    scene.symmetry(["rod:x0", "rod:y0", "rod:z0"])
    scene.interface("spring", "rod:x1", Elastic(normal=LogNormal("k", 1.0, cov=0.3), jump=-0.5))
    return scene


def test_what_the_field_of_a_modulus_leaves_out_counts() -> None:
    """With all 20 modes 4096 Sobol points give a mean of 7.938e-2; 1.5 % off, 2e-3 was said."""
    made = solve(assemble(rod(2)), accuracy=1e-2, quantity="spring", progress=False, meshes=False).errors()
    assert made.moments is not None and not made.reached
    true = abs(made.moments.mean / 7.938e-2 - 1.0)
    assert true <= made.relative("field") <= 3.0 * true


def test_parts_with_the_field_of_a_modulus_get_smaller_cells() -> None:
    """They work with degree 1 and 2."""
    result = solve(rod(2), accuracy=1e-1, quantity="spring", progress=False, max_unknowns=8000)
    assert result.problem.substructures["rod"].space.element.basix_element.degree <= 2
    assert not result.errors().reached or abs(result.mean_std("spring").mean / 7.938e-2 - 1.0) <= 1e-1
