"""Meshes of the parts: closed-form sizes, complete face names, matching nodes, clear errors."""

import math
from pathlib import Path
from typing import Any

import gmsh
import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh
from scipy.spatial import cKDTree

from dolfinx_frontend import geometry
from dolfinx_frontend.common.errors import SceneError, SceneWarning
from dolfinx_frontend.geometry.parts import FREE, Part
from parts.blocks import block_chain
from parts.rings import annulus, two_rings
from parts.vessel import BoltedVessel, VesselShape, bolted_vessel

ROUND = 1e-12  # relative, for sums over a few thousand facets


def face_coordinates(part: Part, face: str, degree: int = 2) -> np.ndarray:
    """Coordinates of the Lagrange nodes on a face, (nodes, 3)."""
    space = fem.functionspace(part.mesh, ("Lagrange", degree))
    dim = part.mesh.topology.dim
    nodes = fem.locate_dofs_topological(space, dim - 1, part.facets(face))
    return space.tabulate_dof_coordinates()[nodes]


def dofs(assembly: geometry.Assembly, degree: int = 2) -> int:
    """Degrees of freedom of a Lagrange displacement on all parts."""
    total = 0
    for part in assembly.parts.values():
        space = fem.functionspace(part.mesh, ("Lagrange", degree, (part.mesh.geometry.dim,)))
        total += space.dofmap.index_map.size_local * space.dofmap.index_map_bs
    return total


def check_names(part: Part) -> None:
    """Every exterior facet has exactly one face, and no other facet has one."""
    topology = part.mesh.topology
    topology.create_connectivity(topology.dim - 1, topology.dim)
    facets = np.concatenate([part.facets(name) for name in part.faces])
    assert np.array_equal(np.sort(facets), dmesh.exterior_facet_indices(topology))
    assert all(part.facets(name).size for name in part.faces)


def check_matching(assembly: geometry.Assembly) -> None:
    """The nodes of every two-sided interface coincide."""
    for connection in assembly.interfaces:
        if connection.face2 is None:
            continue
        x1, x2 = (
            face_coordinates(*assembly.face(f)) for f in (connection.face1, connection.face2)
        )
        assert x1.shape == x2.shape, connection
        distance, nearest = cKDTree(x2).query(x1)
        assert distance.max() <= 1e-12 * np.abs(x1).max(), connection
        assert np.unique(nearest).size == len(x1)


# --- blocks -----------------------------------------------------------------------------------
@pytest.mark.parametrize(
    "cell, dim", [("triangle", 2), ("quadrilateral", 2), ("tetrahedron", 3), ("hexahedron", 3)]
)
def test_box(cell: str, dim: int) -> None:
    lengths, origin = [2.0, 3.0, 0.5][:dim], [-1.0, 7.0, 0.25][:dim]
    part = geometry.box(lengths, [2, 3, 4][:dim], origin, cell)
    volume = math.prod(lengths)
    assert part.cell == cell
    assert part.volume() == pytest.approx(volume, rel=ROUND)
    assert part.faces == tuple(f"{a}{end}" for a in "xyz"[:dim] for end in (0, 1))
    for axis, name in enumerate("xyz"[:dim]):
        for end in (0, 1):
            face = f"{name}{end}"
            assert part.face_area(face) == pytest.approx(volume / lengths[axis], rel=ROUND)
            plane = origin[axis] + end * lengths[axis]
            assert np.allclose(face_coordinates(part, face)[:, axis], plane, rtol=1e-14, atol=0)
    check_names(part)
    assert "tri" not in repr(part) or cell == "triangle"


@pytest.mark.parametrize("scale", [1e-9, 1e6])
def test_box_of_any_size_and_shape(scale: float) -> None:
    part = geometry.box([scale, 1e4 * scale], [3, 2], cell="triangle")
    check_names(part)
    assert FREE not in part.names
    assert part.face_area("x1") == pytest.approx(1e4 * scale, rel=ROUND)


def test_block_chain() -> None:
    chain = block_chain(3, (1.0, 2.0), (2, 4), axis=1)
    assert list(chain.parts) == ["block0", "block1", "block2"]
    assert chain.interfaces[1][1:] == ("perfect", "block1:y1", "block2:y0")
    check_matching(chain)
    uneven = block_chain(2, (1.0, 1.0, 1.0), [(1, 2, 2), (1, 3, 3)])
    assert uneven.parts["block1"].facets("x0").size == 9


# --- rings ------------------------------------------------------------------------------------
@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
@pytest.mark.parametrize("angle", [math.pi / 6, math.pi, 2 * math.pi])
def test_annulus_area_converges_to_the_circle(cell: str, angle: float) -> None:
    exact = 0.5 * angle * (4.0 - 1.0)
    for order, slope in ((1, 2), (2, 4)):
        errors = []
        for n in (8, 16):
            part = annulus(1.0, 2.0, angle, (2, n), cell, order)
            check_names(part)
            assert part.order == order
            errors.append(abs(part.volume() / exact - 1))
        assert math.log2(errors[0] / errors[1]) == pytest.approx(slope, abs=0.1)
        assert part.face_area("outer") == pytest.approx(2 * angle, rel=2 * errors[1])
    whole = angle == 2 * math.pi
    assert ("theta0" in part.names) != whole
    assert FREE not in part.names


def test_two_rings() -> None:
    rings = two_rings(1.0, 1.5, 2.0, math.pi / 4, (2, 4))
    check_matching(rings)
    assert [c.kind for c in rings.interfaces].count("symmetry") == 4
    apart = two_rings(1.0, 1.5, 2.0, divisions=(2, 4), outer_divisions=(1, 3))
    assert apart.parts["outer"].facets("inner").size == 3


# --- the vessel ---------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def vessel() -> BoltedVessel:
    return bolted_vessel("coarse")


def test_vessel_has_the_parts_and_interfaces_of_the_paper(vessel: BoltedVessel) -> None:
    assert list(vessel.parts) == ["cylinder", "flange", "ring", "cover", "shank", "head"]
    assert len(vessel.interfaces) == len({c.name for c in vessel.interfaces}) == 20
    kinds = [c.kind for c in vessel.interfaces]
    expected = {"perfect": 4, "elastic": 2, "pressure": 3, "symmetry": 10, "support": 1}
    assert {kind: kinds.count(kind) for kind in kinds} == expected
    used = [f for c in vessel.interfaces for f in (c.face1, c.face2) if f is not None]
    assert len(used) == len(set(used))  # no face carries two interfaces
    named = {f"{p}:{f}" for p, part in vessel.parts.items() for f in part.faces if f != FREE}
    assert named == set(used)


def test_vessel_names_and_nodes(vessel: BoltedVessel) -> None:
    for part in vessel.parts.values():
        check_names(part)
    check_matching(vessel)


def test_vessel_sizes(vessel: BoltedVessel) -> None:
    """Volumes and areas of the solids, up to the parabolas that stand for circles."""
    s = VesselShape()
    a, b, sector = s.bore_radius, s.wall, s.angle / 2
    half = math.pi / 2
    volumes = {
        "cylinder": sector * (b**2 - a**2) * s.height,
        "flange": (sector * (s.flange_radius**2 - b**2) - half * s.screw_radius**2)
        * s.flange_thickness,
        "ring": sector * (b**2 - a**2) * s.ring_thickness,
        "cover": (sector * s.flange_radius**2 - half * s.hole_radius**2) * s.cover_thickness,
        "shank": half * s.screw_radius**2 * (s.levels[3] - s.levels[0]),
        "head": half * s.head_radius**2 * s.head_height,
    }
    areas = {
        "ring:top": sector * (b**2 - a**2),
        "cover:inner": sector * a**2,
        "cylinder:inner": s.angle * a * s.height,
        "cylinder:bottom": sector * (b**2 - a**2),
        "flange:thread": math.pi * s.screw_radius * s.flange_thickness,
        "shank:top": vessel.screw_area / 2,
        "head:seat": half * (s.head_radius**2 - s.hole_radius**2),
        "cover:theta1": s.flange_radius * s.cover_thickness,
        "head:theta0": 2 * s.head_radius * s.head_height,
    }
    # arcs of 60 degrees: a parabola through three points encloses 0.25 % less of the sector
    for name, volume in volumes.items():
        assert vessel.parts[name].volume() == pytest.approx(volume, rel=3e-3), name
    for name, area in areas.items():
        part, face = vessel.face(name)
        assert part.face_area(face) == pytest.approx(area, rel=3e-3), name
    assert vessel.pressure_force == pytest.approx(2 * areas["cover:inner"], rel=1e-12)


def test_vessel_presets(vessel: BoltedVessel) -> None:
    assert 4_000 < dofs(vessel) < 6_500
    paper = bolted_vessel("paper")
    assert 22_000 < dofs(paper) < 26_000
    check_matching(paper)
    assert "20 interfaces" in repr(paper)


def test_vessel_of_other_dimensions() -> None:
    straight = bolted_vessel(25.0, geometry_order=1, n_screws=6, cover_thickness=40.0)
    assert straight.parts["cover"].order == 1
    check_matching(straight)
    scaled = bolted_vessel(
        "coarse",
        **{
            name: value if name == "n_screws" else 1e-3 * value
            for name, value in vars(VesselShape()).items()
        },
    )
    for part in scaled.parts.values():
        check_names(part)
    assert scaled.parts["cover"].face_area("inner") == pytest.approx(
        math.pi / 16 * 0.09**2, rel=2e-3
    )


# --- gmsh ---------------------------------------------------------------------------------------
def two_squares(model, order: int = 1, recombine: bool = False) -> None:
    """Two unit squares side by side, sharing the line x = 1."""
    left = model.occ.addRectangle(0, 0, 0, 1, 1)
    right = model.occ.addRectangle(1, 0, 0, 1, 1)
    model.occ.fragment([(2, left)], [(2, right)])
    model.occ.synchronize()
    model.addPhysicalGroup(2, [left], name="left")
    model.addPhysicalGroup(2, [right], name="right")
    eps = 1e-6
    middle = model.getEntitiesInBoundingBox(1 - eps, -eps, -eps, 1 + eps, 2, eps, 1)
    shared = [tag for _, tag in middle]
    model.addPhysicalGroup(1, shared, name="left:to the right")
    model.addPhysicalGroup(1, shared, name="right:to the left")
    below = [t for _, t in model.getEntitiesInBoundingBox(-eps, -eps, -eps, 3, eps, eps, 1)]
    model.addPhysicalGroup(1, below, name="bottom")
    if recombine:
        for tag in (left, right):
            model.mesh.setTransfiniteSurface(tag)
            model.mesh.setRecombine(2, tag)
    model.mesh.generate(2)
    model.mesh.setOrder(order)


@pytest.mark.parametrize("recombine, cell", [(False, "triangle"), (True, "quadrilateral")])
@pytest.mark.parametrize("order", [1, 2])
def test_from_gmsh(recombine: bool, cell: str, order: int) -> None:
    with geometry.gmsh_session("squares", {"Mesh.MeshSizeMax": 0.4}) as g:
        two_squares(g.model, order, recombine)
        assembly = geometry.from_gmsh(g.model)
    assert not gmsh.isInitialized()
    assert list(assembly.parts) == ["left", "right"]
    for name, other in (("left", "to the right"), ("right", "to the left")):
        part = assembly.parts[name]
        check_names(part)
        assert (part.cell, part.order, part.mesh.geometry.dim) == (cell, order, 2)
        assert set(part.faces) == {other, "bottom", FREE}
        assert part.volume() == pytest.approx(1, rel=ROUND)
        assert part.face_area(other) == pytest.approx(1, rel=ROUND)
        assert part.face_area("bottom") == pytest.approx(1, rel=ROUND)
    heights = [
        np.sort(face_coordinates(*assembly.face(face))[:, 1])
        for face in ("left:to the right", "right:to the left")
    ]
    assert np.allclose(*heights, rtol=0, atol=1e-14)


@pytest.mark.parametrize("dim", [2, 3])
def test_from_gmsh_curves_cells_along_the_model(dim: int) -> None:
    """Straight cells of a disc or a cylinder lack h^2, curved ones h^4 of its area."""
    areas = []
    for order in (None, 2, 1):
        with geometry.gmsh_session("round", {"Mesh.MeshSizeMax": 0.5}) as g:
            occ = g.model.occ
            tag = occ.addDisk(0, 0, 0, 1, 1) if dim == 2 else occ.addCylinder(0, 0, 0, 0, 0, 1, 1)
            g.model.occ.synchronize()
            g.model.addPhysicalGroup(dim, [tag], name="disc")
            g.model.mesh.generate(dim)
            part = geometry.from_gmsh(g.model, order=order).parts["disc"]
        assert part.order == (order or 1)
        areas.append(part.volume() / np.pi)
    assert areas[0] == areas[2] < 0.995
    assert abs(areas[1] - 1.0) < 1e-3


def test_gmsh_hexahedra_of_second_order() -> None:
    """Node order of the cells with most nodes, through a volume that depends on all of them."""
    with geometry.gmsh_session() as g:
        square = g.model.occ.addRectangle(1, 0, 0, 1, 1)
        turned = g.model.occ.revolve([(2, square)], 0, 0, 0, 0, 1, 0, 1.0, [3], recombine=True)
        g.model.occ.synchronize()
        g.model.mesh.setTransfiniteSurface(square)
        g.model.mesh.setRecombine(2, square)
        g.model.addPhysicalGroup(3, [t for d, t in turned if d == 3], name="sector")
        g.model.mesh.generate(3)
        g.model.mesh.setOrder(2)
        part = geometry.from_gmsh(g.model).parts["sector"]
    assert (part.cell, part.order) == ("hexahedron", 2)
    assert part.volume() == pytest.approx(1.5, rel=1e-4)
    assert part.faces == (FREE,)


def test_open_gmsh_session_is_left_as_it_was(tmp_path) -> None:
    gmsh.initialize(argv=[], interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add("mine")
        size = gmsh.option.getNumber("Mesh.MeshSizeFromPoints")
        bolted_vessel(40.0)
        assert gmsh.isInitialized() and gmsh.model.getCurrent() == "mine"
        assert "bolted_vessel" not in gmsh.model.list()
        assert gmsh.option.getNumber("Mesh.MeshSizeFromPoints") == size
        two_squares(gmsh.model)
        gmsh.write(str(tmp_path / "squares.msh"))
    finally:
        gmsh.finalize()
    assembly = geometry.read_msh(tmp_path / "squares.msh")
    assert set(assembly.parts["left"].faces) == {"to the right", "bottom", FREE}


# --- errors -------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    "build, message",
    [
        (lambda: geometry.box([1.0, -1.0], [1, 1]), r"lengths\[1\] = -1.0 must be positive"),
        (lambda: geometry.box([1.0], [1]), "must hold 2 or 3"),
        (lambda: geometry.box([1.0, 1.0], [1, 0]), r"divisions = .1, 0."),
        (lambda: geometry.box([1.0, 1.0], [1, 1.5]), r"divisions = .1, 1.5."),
        (lambda: geometry.box([1.0, 1.0], [1, 1], cell="tetrahedron"), "'triangle'"),
        (lambda: geometry.box([1.0, 1.0], [1, 1], origin=[0.0]), "2 coordinates"),
        (lambda: block_chain(0), "n = 0"),
        (lambda: block_chain(2, axis=3), "axis = 3"),
        (lambda: block_chain(3, divisions=[(1, 1, 1)] * 2), "3 rows of 3"),
        (lambda: annulus(2.0, 1.0), "outer = 1.0 must exceed"),
        (lambda: annulus(1.0, 2.0, angle=7.0), "2 pi"),
        (lambda: annulus(1.0, 2.0, angle=2 * math.pi, divisions=(1, 2)), "3 cells"),
        (lambda: annulus(1.0, 2.0, geometry_order=3), "geometry_order = 3"),
        (lambda: bolted_vessel("huge"), "unknown size 'huge'"),
        (lambda: bolted_vessel(-1.0), "size = -1.0"),
        (lambda: bolted_vessel(math.nan), "size = nan"),
        (lambda: bolted_vessel(bore_radios=1.0), "did you mean 'bore_radius'"),
        (lambda: bolted_vessel(n_screws=2.5), "n_screws = 2.5"),
        (lambda: bolted_vessel(hole_radius=8.0), "screw_radius < hole_radius"),
        (lambda: bolted_vessel(n_screws=40), "head_radius < bolt_circle sin"),
        (lambda: geometry.read_msh("nowhere.msh"), "nowhere.msh does not exist"),
    ],
)
def test_wrong_arguments(build, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        build()


def test_unknown_faces(vessel: BoltedVessel) -> None:
    with pytest.raises(SceneError, match="did you mean 'theta1'"):
        vessel.parts["ring"].facets("theta2")
    with pytest.raises(SceneError, match="unknown part 'rong'"):
        vessel.face("rong:top")


def test_wrong_gmsh_models() -> None:
    def rejects(message: str, prepare) -> None:
        with geometry.gmsh_session("wrong", {"Mesh.MeshSizeMax": 0.5}) as g:
            prepare(g.model)
            with pytest.raises(SceneError, match=message):
                geometry.from_gmsh(g.model)

    def square(model, *, parts=("plate",), faces=(), mesh=True) -> None:
        tag = model.occ.addRectangle(0, 0, 0, 1, 1)
        model.occ.synchronize()
        for name in parts:
            model.addPhysicalGroup(2, [tag], name=name)
        for name, lines in faces:
            model.addPhysicalGroup(1, lines, name=name)
        if mesh:
            model.mesh.generate(2)

    def mixed(model) -> None:
        two = [model.occ.addRectangle(x, 0, 0, 1, 1) for x in (0, 1)]
        model.occ.synchronize()
        model.addPhysicalGroup(2, two, name="plate")
        model.mesh.setTransfiniteSurface(two[0])
        model.mesh.setRecombine(2, two[0])
        model.mesh.generate(2)

    def inside(model) -> None:
        two_squares(model)
        model.removePhysicalGroups([])
        surfaces = [t for _, t in model.getEntities(2)]
        model.addPhysicalGroup(2, surfaces, name="both")
        lines = [t for _, t in model.getEntities(1)]
        model.addPhysicalGroup(1, lines, name="all")

    def cubic(model) -> None:
        square(model)
        model.mesh.setOrder(3)

    rejects("no physical group", lambda m: square(m, parts=()))
    rejects("a name of its own", lambda m: square(m, parts=("",)))
    rejects("no cells; call gmsh.model.mesh.generate", lambda m: square(m, mesh=False))
    rejects("'plaat:edge' belongs to no part", lambda m: square(m, faces=[("plaat:edge", [1])]))
    rejects("share facets", lambda m: square(m, faces=[("a", [1]), ("plate:b", [1, 2])]))
    rejects("mixes cells", mixed)
    rejects("runs inside the part", inside)
    rejects("order 1 or 2", cubic)


# --- figures ------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def rings() -> geometry.Assembly:
    return two_rings(1.0, 1.5, 2.0, math.pi / 4, (2, 4))


def curved(dim: int) -> Part:
    """A disk or a ball of curved cells, half of whose surface has a name."""
    with geometry.gmsh_session("round") as session:
        model = session.model
        (model.occ.addDisk(0, 0, 0, 1, 1) if dim == 2 else model.occ.addSphere(0, 0, 0, 1))
        model.occ.synchronize()
        model.addPhysicalGroup(dim, [1], name="a")
        model.addPhysicalGroup(dim - 1, [1], name="a:skin")
        gmsh.option.setNumber("Mesh.MeshSizeMin", 0.5)
        model.mesh.generate(dim)
        return geometry.from_gmsh(model, order=2).parts["a"]


@pytest.mark.parametrize("shape", ["triangle", "quadrilateral", "tetrahedron", "hexahedron", 2, 3])
def test_a_written_mesh_is_read_again(shape: str | int, tmp_path: Path) -> None:
    dim = shape if isinstance(shape, int) else 2 if shape in ("triangle", "quadrilateral") else 3
    box = (0.1, 0.2, 0.3)[:dim], (2, 1, 3)[:dim]
    part = curved(shape) if isinstance(shape, int) else geometry.box(*box, cell=shape)
    file = tmp_path / "two.msh"
    geometry.write_msh(file, {"a": part, "b #2": part})
    assembly = geometry.read_msh(file)
    assert list(assembly.parts) == ["a", "b #2"]

    def sizes(each: Part) -> list[float]:
        over = ufl.Measure("ds", each.mesh, subdomain_data=each.facet_tags)
        measures = [ufl.dx(each.mesh), *(over(each.names[face]) for face in part.faces)]
        return [fem.assemble_scalar(fem.form(fem.Constant(each.mesh, 1.0) * measure)) for measure in measures]

    for other in assembly.parts.values():
        x, y = (each[np.lexsort(each.T)] for each in (part.mesh.geometry.x, other.mesh.geometry.x))
        assert np.array_equal(x, y)  # to the last bit
        assert sizes(other) == pytest.approx(sizes(part), rel=ROUND)


def test_names_that_no_file_of_gmsh_has(tmp_path: Path) -> None:
    part = geometry.box((1, 1), (1, 1))
    for name in ('a "b"', "a\nb", "a:b"):
        with pytest.raises(SceneError, match="rename"):
            geometry.write_msh(tmp_path / "x.msh", {name: part})
    assert not (tmp_path / "x.msh").exists()


def test_a_face_is_cut_out_of_another_one() -> None:
    """A washer of 20 x 10 on a plate: what is left of its face, and both loads."""
    plate = geometry.box((40.0, 30.0, 5.0), (8, 6, 1))
    cut = plate.with_face("washer", lambda x: (np.abs(x[0] - 20) < 10.1) & (np.abs(x[1] - 15) < 5.1), of="z1")
    assert cut.faces == (*plate.faces, "washer")
    assert cut.face_area("washer") == pytest.approx(200.0) and cut.face_area("z1") == pytest.approx(1000.0)
    assert plate.face_area("z1") == pytest.approx(1200.0) and cut.face_area("z0") == pytest.approx(1200.0)
    whole = plate.with_face("rim", lambda x: x[0] < 1e-9)
    assert "x0" not in whole.faces and whole.face_area("rim") == pytest.approx(150.0)
    for name, where, of, text in (
        ("z0", lambda x: x[0] < 9, "z1", "in use"),
        ("pin", lambda x: x[0] < 1, "z1", "no facet of face 'z1' has all its corners"),
        ("pin", lambda x: x[0] < 9, "top", "unknown face 'top'"),
        ("pin", "x < 1", "z1", "give a function of coordinates"),
    ):
        with pytest.raises(SceneError, match=text):
            plate.with_face(name, where, of)


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_a_face_that_cells_do_not_show_is_told(cell: str) -> None:
    """A head of radius 9 on cells of 5 mm is a square of 10: 100 instead of 254."""

    def head(x: Any) -> Any:
        return np.hypot(x[0] - 20, x[1] - 15) < 9

    with pytest.warns(SceneWarning, match="face 'head': .* cover 100 of about 25[0-9]: smaller cells"):
        geometry.box((40.0, 30.0, 5.0), (8, 6, 1), cell=cell).with_face("head", head, of="z1")
    fine = geometry.box((40.0, 30.0, 5.0), (40, 30, 1), cell=cell).with_face("head", head, of="z1")
    assert 0.8 < fine.face_area("head") / (np.pi * 81.0) < 1.0
    with pytest.raises(SceneError, match=r"no facet of face 'z1' .* \(about 2[0-9]{2} of 1200 in "):
        geometry.box((40.0, 30.0, 5.0), (1, 1, 1), cell=cell).with_face("head", head, of="z1")
