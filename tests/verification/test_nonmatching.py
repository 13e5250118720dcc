"""Rates of the interface spaces on meshes that do not match, plane and curved, in 2D and 3D.

Expected: displacements of degree p have the order p in the energy norm, whatever the law. Forces that are
constant on facets and exact in the mean would be off by h^2 at centroids; with rigid laws the multiplier of
degree 0 allows for h^(p - 1/2), at most h^2 (measured: benchmarks/measured/interfaces.md).
"""

from __future__ import annotations

import numpy as np
import pytest

from dolfinx_frontend import Contact, LinearElastic, Perfect, Scene, assemble, geometry, solve
from dolfinx_frontend.common.errors import SceneError, SceneWarning
from dolfinx_frontend.scene.specs import Space
from tests.helpers import block
from tests.verification.nonmatching import Errors, blocks, overlapping, rings, uneven_rings

# rings of degree 1 are made straight, with a word
pytestmark = pytest.mark.filterwarnings("ignore:substructure .*degree=1 on curved cells")


def rates(coarse: Errors, fine: Errors) -> tuple[float, float, float]:
    """Of energy, force and resultant when the cells are halved."""
    pairs = ((getattr(coarse, k), getattr(fine, k)) for k in ("energy", "force", "resultant"))
    energy, force, resultant = (float(np.log2(a / b)) for a, b in pairs)
    return energy, force, resultant


@pytest.mark.parametrize("finer_first", [True, False])
@pytest.mark.parametrize("law", ["elastic", "contact", "perfect"])
@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_plane_facets(cell: str, law: str, finer_first: bool) -> None:
    space: Space = "facets"
    coarse, fine = (blocks(cell, space, law, 2, n, finer_first) for n in (4, 8))
    assert coarse.status == fine.status == "converged"
    energy, force, resultant = rates(coarse, fine)
    assert energy > (1.9 if finer_first else 1.4)  # facets larger than cells behind them: h^(3/2)
    # constant pressures on facets larger than the cells that press on them: at least h
    assert force > (1.4 if finer_first else 0.9) and resultant > 1.4


@pytest.mark.parametrize("law", ["elastic", "contact", "perfect"])
def test_plane_facets_of_degree_1(law: str) -> None:
    coarse, fine = (blocks("triangle", "facets", law, 1, n) for n in (4, 8))
    energy, force, _ = rates(coarse, fine)
    assert energy > 0.9 and force > (1.8 if law == "elastic" else 0.9)


@pytest.mark.parametrize("law", ["elastic", "contact", "perfect"])
@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_curved_facets(cell: str, law: str) -> None:
    """A split Lame ring."""
    coarse, fine = (rings(cell, "facets", law, 2, n) for n in (2, 4))
    assert coarse.status == fine.status == "converged"
    energy, force, resultant = rates(coarse, fine)
    assert energy > 1.85 and force > 1.4 and resultant > 1.8


@pytest.mark.parametrize("law", ["elastic", "contact"])
@pytest.mark.parametrize("scene", [blocks, rings])
@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_solids_facets(cell: str, scene: object, law: str) -> None:
    assert callable(scene)
    coarse, fine = (scene(cell, "facets", law, 2, n) for n in (2, 4))
    assert coarse.status == fine.status == "converged"
    energy, force, resultant = rates(coarse, fine)
    assert energy > 1.8 and force > 1.2 and resultant > 1.4


@pytest.mark.parametrize("law", ["contact", "perfect"])
def test_facets_on_linear_tetrahedra_lock(law: str) -> None:
    """Two facets per node: rigid laws (not springs) would lock, and are refused; the default does not."""
    with pytest.raises(SceneError, match="locks there; use space='mortar'"):
        blocks("tetrahedron", "facets", law, 1, 4)
    assert blocks("tetrahedron", "facets", "elastic", 1, 4).force < 0.01
    assert blocks("tetrahedron", "auto", law, 1, 4).force < 0.05


def test_points_keep_displacements_in_contact_but_not_pressures() -> None:
    """Kinks of side 2 within a facet: springs lose the order of degree 2, contact its pressures."""
    coarse, fine = (blocks("triangle", "points", "elastic", 2, n) for n in (4, 8))
    assert 0.3 < rates(coarse, fine)[0] < 1.0
    with pytest.warns(SceneWarning, match="contact in the space 'points' on meshes that do not match"):
        coarse, fine = (blocks("triangle", "points", "contact", 2, n) for n in (4, 8))
    energy, _, resultant = rates(coarse, fine)
    assert energy > 1.8 and resultant > 0.9
    assert fine.force > 0.3


@pytest.mark.parametrize("space", ["auto", "facets"])
@pytest.mark.parametrize("degree", [1, 2])
def test_partly_overlapping_faces(degree: int, space: Space) -> None:
    """Stresses are singular where the overlap ends: energies have the order 1 or more, not 2 p."""
    exact = overlapping(degree, 48, aligned=True)
    errors = [abs(overlapping(degree, n, space=space) / exact - 1.0) for n in (6, 12)]
    assert np.log2(errors[0] / errors[1]) > 0.9 and errors[1] < 0.05


# ---------------------------------------------------------------------------------------------
# The default: mortar
# ---------------------------------------------------------------------------------------------
@pytest.mark.parametrize("finer_first", [True, False])
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("law", ["elastic", "contact", "perfect"])
@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_plane_default(cell: str, law: str, degree: int, finer_first: bool) -> None:
    """Any law, degree and order of the sides: the order of the elements, as few iterations as with facets."""
    coarse, fine = (blocks(cell, "auto", law, degree, n, finer_first) for n in (4, 8))
    assert coarse.status == fine.status == "converged" and fine.iterations <= 21
    energy, force, resultant = rates(coarse, fine)
    assert energy > degree - 0.1
    assert force > (1.7 if degree == 2 else 0.9) and resultant > 1.4


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("law", ["elastic", "contact", "perfect"])
@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_curved_default(cell: str, law: str, degree: int) -> None:
    """A split Lame ring."""
    coarse, fine = (rings(cell, "auto", law, degree, n) for n in (2, 4))
    assert coarse.status == fine.status == "converged"
    energy, force, resultant = rates(coarse, fine)
    assert energy > degree - 0.15
    # stresses of linear parts have the order 1/2 at least
    assert force > (1.7 if degree == 2 else 0.5) and resultant > (1.7 if degree == 2 else 0.9)


@pytest.mark.parametrize("law", ["elastic", "contact", "perfect"])
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_solids_default(cell: str, degree: int, law: str) -> None:
    coarse, fine = (blocks(cell, "auto", law, degree, n) for n in (2, 4))
    assert coarse.status == fine.status == "converged"
    energy, force, _ = rates(coarse, fine)
    assert energy > degree - 0.15 and force > (1.7 if degree == 2 else 1.4)


def test_uneven_contact_pressure() -> None:
    """Two rings with p(theta), which slide on each other as the bore's pressure bends them: order 2 in L2."""
    coarse, fine = (uneven_rings("auto", n) for n in (8, 16))
    assert coarse[3].converged and fine[3].converged
    assert np.log2(coarse[0] / fine[0]) > 1.9 and np.log2(coarse[1] / fine[1]) > 1.8
    assert fine[1] < 0.003
    assert fine[0] < uneven_rings("facets", 16)[0]


def test_uneven_contact_pressure_at_all_points() -> None:
    """The same with quadrilaterals: below 0.1 % everywhere with less than 3 000 unknowns."""
    coarse, fine = (uneven_rings("auto", n, "quadrilateral") for n in (8, 16))
    assert fine[3].converged and fine[2] < 3000
    assert fine[1] < 1e-3 and fine[0] < 5e-4
    assert np.log2(coarse[1] / fine[1]) > 1.6 and np.log2(coarse[0] / fine[0]) > 1.6


@pytest.mark.parametrize("law", ["contact", "perfect"])
def test_round_face_of_linear_tetrahedra(law: str) -> None:
    """A tied or pressed tube of straight linear cells: as accurate as the one whose meshes match."""
    coarse, fine = (rings("tetrahedron", "auto", law, 1, n, order=1) for n in (2, 4))
    assert coarse.status == fine.status == "converged"
    assert rates(coarse, fine)[0] > 0.85
    matching = rings("tetrahedron", "auto", law, 1, 4, order=1, along=(2, 2), height=(2, 2))
    assert fine.energy < 1.3 * matching.energy


def test_bent_beam_of_linear_tetrahedra() -> None:
    """A cantilever glued across, meshes 4 : 6: as stiff as in between, and with the stress of beam theory."""
    length, load, modulus = 10.0, 100.0, 200e3

    def cantilever(*counts: int) -> tuple[float, object]:
        scene = Scene()
        for name, n, x in (("a", counts[0], 0.0), ("b", counts[-1], length / 2)):
            part = geometry.box((length / 2, 1.0, 1.0), (5 * n, n, n), (x, 0.0, 0.0), cell="tetrahedron")
            scene.substructure(name, part, LinearElastic(modulus, 0.3), degree=1)
        scene.fix("a:x0")
        scene.traction("b:x1", (0.0, 0.0, -load))
        scene.interface("glue", "a:x1", "b:x0", Perfect())
        result = solve(assemble(scene), active=["glue"])
        assert result.converged
        u = result.displacement("b")
        tip = np.isclose(u.function_space.tabulate_dof_coordinates()[:, 0], length)
        return -float(u.x.array.reshape(-1, 3)[tip, 2].mean()), result

    tip, result = cantilever(4, 6)
    assert cantilever(4, 4)[0] < tip < cantilever(6, 6)[0]
    joint = result.problem.interfaces["glue"]
    force = result.force("glue")
    assert joint.weights @ force == pytest.approx([0.0, 0.0, -load], abs=1e-3 * load)
    # sigma = M / W (z - 1/2) / (1/2), smeared by h; linear tetrahedra are off by as much as in one piece
    stress = 6.0 * load * length / 2 * (1.0 - 2.0 * joint.points[:, 2])
    error = np.sqrt(joint.weights @ (force[:, 0] + stress) ** 2 / (joint.weights @ stress**2))
    one = cantilever(6, 6)[1]
    glued, same = one.problem.interfaces["glue"], one.force("glue")[:, 0]
    exact = 6.0 * load * length / 2 * (1.0 - 2.0 * glued.points[:, 2])
    size = np.sqrt(glued.weights @ exact**2)
    assert error < 2.0 * np.sqrt(glued.weights @ (same + exact) ** 2) / size


@pytest.mark.parametrize(
    ("cell", "degree", "n"),
    [
        ("triangle", 1, 8),
        ("triangle", 2, 8),
        ("quadrilateral", 2, 16),
        ("hexahedron", 1, 6),
        ("tetrahedron", 1, 6),
        ("tetrahedron", 2, 4),
    ],
)
@pytest.mark.parametrize("long", [False, True])
def test_friction_on_the_ground(cell: str, degree: int, n: int, long: bool) -> None:
    """A block, and a bar, pressed on rigid ground and pushed, with default settings."""
    d = 3 if cell in ("hexahedron", "tetrahedron") else 2
    size = ([40.0, 5.0] if long else [10.0, 10.0])[: d - 1]
    counts = ([3 * n, 2] if long else [n, n])[: d - 1]
    scene = Scene()
    part = block(cell, [*counts, n // 2], np.zeros(d), np.array([*size, 5.0]))
    scene.substructure("block", part, LinearElastic(200e3, 0.3), degree=degree)
    end = "xyz"[d - 1]
    scene.interface("ground", f"block:{end}0", Contact(friction=0.3))
    scene.pressure(f"block:{end}1", 50.0)
    push = 60.0 if long else 20.0
    scene.traction("block:x1", (push, *[0.0] * (d - 1)))
    result = solve(assemble(scene))
    assert result.converged and result.iterations <= 60
    joint = result.problem.interfaces["ground"]
    force = result.force("ground")
    vector = joint.weights @ np.einsum("pij,pi->pj", joint.frames, force)
    area = float(np.prod(size))
    section = 5.0 * area / size[0]
    assert vector[-1] == pytest.approx(50.0 * area, rel=1e-5)
    assert vector[0] == pytest.approx(-push * section, rel=1e-5)
    shear = np.linalg.norm(force[:, 1:], axis=1)
    assert force[:, 0].max() <= 0.0 and np.all(shear <= 0.3 * -force[:, 0] * (1 + 1e-9))
