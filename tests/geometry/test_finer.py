"""Finer meshes of a part: the same body with the same faces, smaller cells where they are asked for."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from dolfinx import mesh as dmesh

from dolfinx_frontend.common.compat import cell_nodes
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.geometry import (
    SizeField,
    box,
    from_gmsh,
    gmsh_session,
    remeshable,
    remeshable_model,
)
from dolfinx_frontend.geometry.finer import OfModel, bisected, cell_sizes, halved, size_field
from dolfinx_frontend.geometry.parts import Part
from tests.helpers import DIMENSION, block

RADIUS = 2.0


def bent(x: np.ndarray) -> np.ndarray:
    """A box as a piece of a ring, nodes of second order off the chords."""
    out = x.copy()
    r, angle = 1.0 + x[:, 0], 0.9 * x[:, 1]
    out[:, 0], out[:, 1] = r * np.cos(angle), r * np.sin(angle)
    return out


def same_body(one: Part, other: Part) -> None:
    assert other.volume() == pytest.approx(one.volume(), rel=1e-11)
    # the length of a parabola is no polynomial: quadrature leaves 1e-7 of it
    tolerance = 1e-11 if one.order == 1 else 1e-5
    assert other.faces == one.faces
    for face in one.faces:
        assert other.face_area(face) == pytest.approx(one.face_area(face), rel=tolerance)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("cell", ["triangle", "tetrahedron"])
def test_cells_that_are_cut(cell: str, order: int) -> None:
    part = block(cell, (2,) * DIMENSION[cell], mapping=bent, order=order, seed=3)
    x = part.mesh.geometry.x
    middles = np.array([x[nodes].mean(axis=0) for nodes in cell_nodes(part.mesh)])
    chosen = np.linalg.norm(middles - x[0], axis=1).argmin()
    ratios = np.ones(part.num_cells)
    ratios[chosen] = 0.25
    fine = bisected(part, ratios)
    same_body(part, fine)
    assert fine.order == order and fine.num_cells > part.num_cells
    # halved twice, there
    now = fine.mesh.geometry.x
    after = np.array([now[nodes].mean(axis=0) for nodes in cell_nodes(fine.mesh)])
    near = np.linalg.norm(after - middles[chosen], axis=1).argmin()
    assert cell_sizes(fine.mesh)[near] < 0.36 * cell_sizes(part.mesh)[chosen]
    # and nothing where nothing is wanted
    assert bisected(part, np.ones(part.num_cells)).mesh is part.mesh


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("cell", ["quadrilateral", "hexahedron"])
def test_cells_that_are_all_cut(cell: str, order: int) -> None:
    part = block(cell, (2,) * DIMENSION[cell], mapping=bent, order=order, seed=5)
    fine = halved(part)
    same_body(part, fine)
    assert fine.order == order
    assert fine.num_cells == 2 ** DIMENSION[cell] * part.num_cells
    for face in part.faces:
        assert len(fine.facets(face)) == 2 ** (DIMENSION[cell] - 1) * len(part.facets(face))


def disc(size: SizeField | None) -> Part:
    """A disc of gmsh."""
    with gmsh_session() as gmsh:
        face = gmsh.model.occ.addDisk(0.0, 0.0, 0.0, RADIUS, RADIUS)
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(2, [face], name="disc")
        gmsh.model.addPhysicalGroup(1, [t for _, t in gmsh.model.getEntities(1)], name="disc:rim")
        if size is None:
            gmsh.option.setNumber("Mesh.MeshSizeMax", 1.0)
        else:
            size.set(gmsh)
        gmsh.model.mesh.generate(2)
        return from_gmsh(gmsh.model, gdim=2).parts["disc"]


def test_a_part_that_is_meshed_again_is_on_its_true_geometry() -> None:
    part = remeshable(disc)
    wanted = np.full(part.num_cells, 0.25)
    again = part.again(size_field(part.mesh, wanted))
    true = np.pi * RADIUS**2
    # a polygon of n chords lacks about 2 pi^2 / (3 n^2) of the area
    n = len(again.facets("rim"))
    assert n > 2 * len(part.facets("rim"))
    assert again.volume() / true - 1.0 == pytest.approx(-2.0 * np.pi**2 / (3.0 * n**2), rel=0.1)
    assert abs(np.median(cell_sizes(again.mesh)) / 0.25 - 1.0) < 0.2


def test_sizes_differ_from_place_to_place() -> None:
    part = remeshable(disc)
    x = part.mesh.geometry.x[cell_nodes(part.mesh)].mean(axis=1)
    again = part.again(size_field(part.mesh, np.where(x[:, 0] > 0.0, 0.1, 0.6)))
    at = again.mesh.geometry.x[cell_nodes(again.mesh)].mean(axis=1)
    sizes = cell_sizes(again.mesh)
    assert np.median(sizes[at[:, 0] > 1.0]) < 0.15
    assert np.median(sizes[at[:, 0] < -1.0]) > 0.4


def test_a_function_that_makes_no_part_is_refused() -> None:
    with pytest.raises(SceneError, match="make"):
        remeshable(3)
    with pytest.raises(SceneError, match="return a Part"):
        remeshable(lambda size: None)


def test_a_size_field_tells_sizes_at_points() -> None:
    part = box((1.0, 1.0), (4, 4), cell="triangle")
    field = size_field(part.mesh, np.full(part.num_cells, 0.3))
    assert field(np.array([[0.2, 0.7], [2.0, 0.0]])) == pytest.approx([0.3, 0.3])
    assert "0.3" in repr(field)


def two_bars(sizes: Mapping[str, SizeField] | None) -> dict[str, Part]:
    """Two rectangles of one model, which share the nodes of an edge."""
    with gmsh_session() as gmsh:
        occ = gmsh.model.occ
        both = [(2, occ.addRectangle(x, 0, 0, 1, 1)) for x in (0, 1)]
        _, pieces = occ.fragment(both[:1], both[1:])
        occ.synchronize()
        for name, piece in zip(("left", "right"), pieces, strict=True):
            gmsh.model.addPhysicalGroup(2, [tag for _, tag in piece], name=name)
            for _, edge in gmsh.model.getBoundary(piece, oriented=False):
                x0, _, _, x1, _, _ = gmsh.model.getBoundingBox(1, edge)
                if abs(x0 - 1.0) < 1e-3 and abs(x1 - 1.0) < 1e-3:
                    gmsh.model.addPhysicalGroup(1, [edge], name=f"{name}:middle")
        if sizes is None:
            gmsh.option.setNumber("Mesh.MeshSizeMax", 0.5)
        else:
            SizeField.joined(sizes.values()).set(gmsh)
        gmsh.model.mesh.generate(2)
        return dict(from_gmsh(gmsh.model, gdim=2).parts)


def test_parts_of_one_model_are_meshed_together() -> None:
    parts = remeshable_model(two_bars)
    fields = {
        name: size_field(part.mesh, cell_sizes(part.mesh) * (0.25 if name == "left" else 1.0))
        for name, part in parts.items()
    }
    again = parts["left"].again
    assert isinstance(again, OfModel) and parts["right"].again is not None
    finer = again.model.parts(fields)
    assert finer["left"].num_cells > 6 * parts["left"].num_cells
    assert finer["left"].num_cells > 2 * finer["right"].num_cells
    # the smaller size holds where they meet, and their nodes are the same ones
    ends = []
    for part in finer.values():
        facets = part.facets("middle")
        nodes = np.unique(dmesh.entities_to_geometry(part.mesh, 1, facets))
        ends.append(np.sort(part.mesh.geometry.x[nodes][:, 1]))
    assert len(ends[0]) > 6 and np.allclose(ends[0], ends[1], atol=1e-12)
    assert finer["left"].again.model is again.model  # type: ignore[union-attr]


def test_fields_of_parts_are_joined() -> None:
    one = SizeField(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), np.array([[0, 1, 2]]), np.full(3, 0.5))
    other = SizeField(np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]), np.array([[0, 1, 2]]), np.full(3, 0.2))
    both = SizeField.joined([one, other])
    assert both(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])) == pytest.approx(
        [0.5, 0.2, 0.2, 0.2]
    )
    squares = SizeField(one.x, np.array([[0, 1, 2, 2]]), one.sizes)
    with pytest.raises(SceneError, match="cells of one kind"):
        SizeField.joined([one, squares])


def test_what_a_model_must_return() -> None:
    with pytest.raises(SceneError, match="remeshable_model"):
        remeshable_model(lambda sizes: [])  # type: ignore[arg-type,return-value]
    with pytest.raises(SceneError, match="part 'a'"):
        remeshable_model(lambda sizes: {"a": 1})  # type: ignore[dict-item,arg-type]
