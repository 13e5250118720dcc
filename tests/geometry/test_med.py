"""Meshes of Salome: the same parts and faces as those of the same mesh written by gmsh."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

import dolfinx_frontend as lf
from dolfinx_frontend import geometry
from dolfinx_frontend.geometry import gmsh_session


def written(folder: Path, dim: int, order: int, quads: bool = False) -> tuple[Path, Path]:
    """Two unit blocks side by side as ``two.msh`` and ``two.med``."""
    with gmsh_session("two") as gmsh:
        model = gmsh.model
        for x in (0.0, 1.0):
            _ = model.occ.addBox(x, 0, 0, 1, 1, 1) if dim == 3 else model.occ.addRectangle(x, 0, 0, 1, 1)
        model.occ.synchronize()
        for (d, tag), name in zip(model.getEntities(dim), ("left", "right"), strict=True):
            model.addPhysicalGroup(d, [tag], name=name)
        for name, x in (("left:x0", 0.0), ("left:x1", 1.0), ("right:x0", 1.0), ("right:x1", 2.0)):
            box = model.getEntitiesInBoundingBox(x - 1e-3, -1, -1, x + 1e-3, 2, 2, dim - 1)
            mine = [t for d, t in box if d == dim - 1]
            near = mine[:1] if name.startswith("left") or x > 1.5 else mine[1:]
            model.addPhysicalGroup(dim - 1, near, name=name)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.6)
        gmsh.option.setNumber("Mesh.RecombineAll", float(quads))
        model.mesh.generate(dim)
        model.mesh.setOrder(order)
        gmsh.write(str(folder / "two.msh"))
    mesh = meshio.read(folder / "two.msh")
    names = {(int(d), int(tag)): name for name, (tag, d) in mesh.field_data.items()}
    dims = {"line": 1, "line3": 1, "triangle": 2, "triangle6": 2, "quad": 2, "tetra": 3, "tetra10": 3}
    physical = mesh.cell_data["gmsh:physical"]
    kept = [(c, t) for c, t in zip(mesh.cells, physical, strict=True) if c.type in dims]
    tags = [np.array([-(10 * dims[c.type] + int(each)) for each in t]) for c, t in kept]
    merged: dict[str, list[Any]] = {}
    for (c, _), t in zip(kept, tags, strict=True):  # MED has one block of a kind
        merged.setdefault(c.type, []).append((c.data, t))
    cells = [(kind, np.concatenate([data for data, _ in own])) for kind, own in merged.items()]
    of_cells = [np.concatenate([t for _, t in own]) for own in merged.values()]
    out = meshio.Mesh(mesh.points[:, :dim], cells, cell_data={"cell_tags": of_cells})
    out.cell_tags = {-(10 * d + tag): [name, "all"] for (d, tag), name in names.items() if d == dim}
    out.cell_tags |= {-(10 * d + tag): [name] for (d, tag), name in names.items() if d == dim - 1}
    meshio.med.write(str(folder / "two.med"), out)
    return folder / "two.msh", folder / "two.med"


@pytest.mark.parametrize(
    ("dim", "order", "quads"), [(3, 1, False), (3, 2, False), (2, 2, False), (2, 1, True)]
)
def test_parts_and_faces_are_those_of_gmsh(dim: int, order: int, quads: bool, tmp_path: Path) -> None:
    ours, theirs = (geometry.read_msh(file).parts for file in written(tmp_path, dim, order, quads))
    assert set(theirs) == {*ours, "all"}  # a group of all parts is a part, too
    for name, part in ours.items():
        other = theirs[name]
        assert part.num_cells == other.num_cells and set(part.faces) == set(other.faces)
        for face in part.faces:
            assert len(part.facets(face)) == len(other.facets(face))


def test_a_bar_of_salome_is_pulled(tmp_path: Path) -> None:
    """E A u / L on curved tetrahedra, from a deck."""
    written(tmp_path, 3, 2)
    parts = "".join(
        f'[substructure.{name}]\nmsh = {{ path = "two.med", part = "{name}" }}\n'
        'material = "LinearElastic"\nE = 100.0\nnu = 0.0\n' for name in ("left", "right")
    )
    joint = '[interface.joint]\nfirst = "left:x1"\nsecond = "right:x0"\nlaw = "Perfect"\n'
    held = '[[fix]]\nfaces = "left:x0"\n[[fix]]\nfaces = "right:x1"\nname = "head"\n'
    held += "value = [0.02, 0.0, 0.0]\n"
    (tmp_path / "bar.toml").write_text(parts + joint + held)
    result = lf.solve(lf.assemble(lf.read_deck(tmp_path / "bar.toml").scene), progress=False)
    assert result.table("head")["force_x"] == pytest.approx([1.0], rel=1e-9)


def test_what_is_no_mesh_with_groups_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "x.med"
    begun = b"\x89HDF\r\n\x1a\n" + bytes(2000)
    for content, said in ((b"", "no MED file"), (begun, "x.med.*cannot be read")):
        file.write_bytes(content)
        with pytest.raises(lf.SceneError, match=said):
            geometry.read_msh(file)
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]])
    for cells, tags, said in (
        ([("wedge", [[0, 1, 2, 3, 4, 5]])], {-1: ["a"]}, "'a' has cells 'wedge'"),
        ([("tetra", [[0, 1, 2, 3]])], {}, "no group has its cells"),
        ([("tetra", [[0, 1, 2, 2]])], {-1: ["a"]}, "the part 'a' has 1 cells with the same node twice"),
        ([("line", [[0, 1]])], {-1: ["a"]}, "no cells of dimension 2 or 3"),
    ):
        mesh = meshio.Mesh(points, cells, cell_data={"cell_tags": [np.array([-1])]})
        mesh.cell_tags = tags
        meshio.med.write(str(file), mesh)
        with pytest.raises(lf.SceneError, match=said):
            geometry.read_msh(file)


def test_damaged_files_are_refused(tmp_path: Path) -> None:
    """Bytes changed, and files cut short: an error that names the file, or the parts."""
    _, med = written(tmp_path, 2, 1)
    whole, rng = med.read_bytes(), np.random.default_rng(1)
    for k in range(6):
        damaged = bytearray(whole)
        for at in rng.integers(8, len(whole), size=40):
            damaged[at] = int(rng.integers(256))
        med.write_bytes(bytes(damaged) if k % 2 else whole[: int(rng.integers(8, len(whole)))])
        try:
            assert geometry.read_msh(med, timeout=60.0).parts
        except lf.SceneError as error:
            assert "two.med" in str(error)
