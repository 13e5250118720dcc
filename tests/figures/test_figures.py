"""Figures of assemblies and results."""

import math
import shutil
import subprocess
import sys

import numpy as np
import pytest
from dolfinx import fem
from dolfinx import mesh as dmesh

import dolfinx_frontend as lf
from dolfinx_frontend import figures, geometry
from dolfinx_frontend.figures import interfaces, render, solids
from dolfinx_frontend.figures.canvas import sheet
from dolfinx_frontend.figures.cuts import as_points, cut_solid
from dolfinx_frontend.figures.solids import skin_of
from parts.rings import two_rings
from parts.vessel import BoltedVessel, VesselShape, bolted_vessel


# --- the vessel ---------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def vessel() -> BoltedVessel:
    return bolted_vessel("coarse")


# --- figures ------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def rings() -> geometry.Assembly:
    return two_rings(1.0, 1.5, 2.0, math.pi / 4, (2, 4))


def displacements(assembly: geometry.Assembly) -> dict[str, fem.Function]:
    """The field u = x / 1000 on every part."""
    fields = {}
    for name, part in assembly.parts.items():
        dim = part.mesh.geometry.dim
        fields[name] = fem.Function(fem.functionspace(part.mesh, ("Lagrange", 2, (dim,))))
        fields[name].interpolate(lambda x, dim=dim: 1e-3 * x[:dim])
    return fields


def is_picture(path) -> bool:
    return path.read_bytes()[:4] == b"\x89PNG" and 2_000 < path.stat().st_size < 500_000


def test_skin_follows_the_part(vessel: BoltedVessel) -> None:
    """The triangles that are drawn have the area of the solid and the values of the function."""
    s = VesselShape()
    head = vessel.parts["head"]
    skin, facets = skin_of(head.mesh, None, displacements(vessel)["head"])
    assert np.array_equal(np.sort(facets), dmesh.exterior_facet_indices(head.mesh.topology))
    assert np.allclose(skin.values, 1e-3 * skin.points, rtol=1e-12, atol=1e-15)
    corner = skin.points[skin.triangles]
    normals = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    area = np.linalg.norm(normals, axis=1).sum() / 2
    exact = s.head_radius * (math.pi * s.head_radius + (math.pi + 2) * s.head_height)
    assert area == pytest.approx(exact, rel=0.02)  # chords of 30 degrees
    # the edges of the half cylinder: two half circles, two diameters, two generators
    pieces = skin.points[skin.segments[skin.border]]
    length = np.linalg.norm(pieces[:, 1] - pieces[:, 0], axis=1).sum() / 2  # each from two sides
    assert length == pytest.approx(
        (2 * math.pi + 4) * s.head_radius + 2 * s.head_height, rel=0.02
    )


def test_figures_of_assemblies(tmp_path, vessel, rings) -> None:
    for assembly, name in ((vessel, "solid"), (rings, "plane")):
        one, two = tmp_path / f"{name}.png", tmp_path / "new folder" / f"moved {name}.png"
        assert figures.assembly_figure(assembly, one, title="t", renderer="matplotlib") == one
        figures.deformed_figure(
            displacements(assembly), two, quantity=lambda u: u[:, 0], renderer="matplotlib"
        )
        assert is_picture(one) and is_picture(two)


@pytest.mark.parametrize("view", [(0.0, 0.0, 1.0), (0.0, 0.0, -2.0)])
def test_a_solid_is_seen_from_above(view, vessel) -> None:
    """Along z, where z is no direction in the picture: x and y keep their lengths."""
    skin, _ = skin_of(vessel.parts["head"].mesh)
    figure = sheet(4.0, 4.0)
    axis = figure.add_subplot()
    solids._draw_with_matplotlib(axis, skin.solid(skin.points, np.ones((len(skin.triangles), 3))), view)
    size = np.ptp(skin.points, axis=0)
    assert np.ptp([axis.get_xlim(), axis.get_ylim()], axis=1) == pytest.approx(size[:2])


def test_figures_by_vtk(tmp_path, vessel) -> None:
    pytest.importorskip("pyvista")
    if shutil.which("xvfb-run") is None:
        pytest.skip("needs xvfb-run")
    figures.assembly_figure(vessel, tmp_path / "vtk.png", renderer="vtk")
    assert is_picture(tmp_path / "vtk.png")


def test_the_process_that_draws_does_not_import_the_package() -> None:
    """The file as the program that VTK runs in: nothing but NumPy, which starts in a tenth of the time."""
    run = [sys.executable, "-P", "-X", "importtime", render.__file__]
    done = subprocess.run(run, capture_output=True, text=True, timeout=60)
    assert "draw() missing 2 required positional arguments" in done.stderr
    named = (line.rpartition("|")[2].strip() for line in done.stderr.splitlines() if "import time:" in line)
    roots = {name.partition(".")[0] for name in named}
    assert "numpy" in roots
    assert not roots & {"dolfinx", "dolfinx_frontend", "basix", "latin_core", "mpi4py", "petsc4py"}


def test_figures_without_vtk(tmp_path, vessel, monkeypatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setattr(solids.shutil, "which", lambda name: None)
    with pytest.raises(figures.RenderError, match="install xvfb"):
        figures.assembly_figure(vessel, tmp_path / "no.png", renderer="vtk")
    figures.assembly_figure(vessel, tmp_path / "yes.png")  # matplotlib takes over
    assert is_picture(tmp_path / "yes.png")
    with pytest.raises(ValueError, match="renderer = 'opengl'"):
        figures.assembly_figure(vessel, tmp_path / "no.png", renderer="opengl")
    monkeypatch.setenv("DISPLAY", ":0")
    failed = subprocess.CompletedProcess([], 1, "", "Traceback\nNo module named 'pyvista'")
    monkeypatch.setattr(solids.subprocess, "run", lambda *a, **k: failed)
    with pytest.raises(figures.RenderError, match="No module named 'pyvista'.*install pyvista"):
        figures.assembly_figure(vessel, tmp_path / "no.png", renderer="vtk")


def test_figures_of_results(tmp_path) -> None:
    rng = np.random.default_rng(1)
    r, t = rng.uniform(1, 2, 200), rng.uniform(0, math.pi / 4, 200)
    points = np.column_stack([r * np.cos(t), r * np.sin(t)])
    grid = np.linspace(-3, 3, 7)
    x = np.linspace(-4, 4, 50)
    made = [
        figures.interface_map(points, r, tmp_path / "1.png", "f (MPa)", mirror=math.pi / 4),
        figures.interface_map(points, np.ones(200), tmp_path / "2.png", "f (MPa)"),
        figures.interface_map(points, r - 1.5, tmp_path / "3.png", "f (MPa)", title="t"),
        figures.convergence_figure(0.5 ** np.arange(20), tmp_path / "4.png", target=1e-3),
        figures.convergence_figure([[1, 0.1], [0.5], []], tmp_path / "5.png"),
        figures.convergence_figure({"a": [1, 0.1], "b": [1, 0.2]}, tmp_path / "6.png"),
        figures.response_surface(
            grid, grid[:3], np.add.outer(grid, grid[:3]), ("x", "y", "z"), tmp_path / "7.png"
        ),
        figures.density_figure(
            {"normal": (x, np.exp(-(x**2) / 2))},
            tmp_path / "8.png",
            "x",
            samples=rng.standard_normal(100),
            threshold=1.0,
        ),
    ]
    assert all(is_picture(path) for path in made)
    with pytest.raises(ValueError, match="3 values for 200 points"):
        figures.interface_map(points, r[:3], tmp_path / "no.png", "f")
    with pytest.raises(ValueError, match="mirror = 1.0"):
        figures.interface_map(points, r, tmp_path / "no.png", "f", mirror=1.0)
    with pytest.raises(ValueError, match="expected"):
        figures.response_surface(grid, grid, np.zeros((2, 2)), ("x", "y", "z"), tmp_path / "no")


# --- cut open, arrows, facets -------------------------------------------------------------------
def areas(triangles) -> np.ndarray:
    """Areas (t,) of triangles (t, 3, 3)."""
    one, other = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    return np.linalg.norm(np.cross(one, other), axis=1) / 2


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_a_cube_cut_through_its_middle_shows_a_hexagon(cell) -> None:
    """Across its diagonal: a regular hexagon with sides of 1/sqrt(2), and half of the surface behind it."""
    part = geometry.box((1.0, 1.0, 1.0), (3, 3, 3), cell=cell)
    u = fem.Function(fem.functionspace(part.mesh, ("Lagrange", 2, (3,))))
    u.interpolate(lambda x: 1e-2 * x)  # grows by 1 %, magnified to 10 %
    normal = np.ones(3) / math.sqrt(3.0)
    solid = cut_solid(u, 10.0, np.full(3, 0.5), normal, np.array([0.2, 0.4, 0.6]))
    triangles = solid.points[solid.triangles]
    section = np.isclose(solid.colours[:, 0], 0.6)  # lighter
    grown = 1.1**2
    assert areas(triangles[section]).sum() == pytest.approx(grown * 3 * math.sqrt(3.0) / 4, rel=1e-12)
    assert areas(triangles[~section]).sum() == pytest.approx(grown * 3.0, rel=1e-12)
    assert (triangles @ normal).max() == pytest.approx(1.1 * 1.5 / math.sqrt(3.0), rel=1e-12)
    pieces = solid.points[solid.thick]
    on = np.all(np.isclose(pieces @ normal, 1.1 * 1.5 / math.sqrt(3.0)), axis=1)
    length = np.linalg.norm(pieces[on, 1] - pieces[on, 0], axis=1).sum()
    assert length == pytest.approx(1.1 * 6 / math.sqrt(2.0), rel=1e-12)
    smooth = as_points(solid)
    assert len(smooth.colours) == len(smooth.points)
    assert areas(smooth.points[smooth.triangles]).sum() == pytest.approx(areas(triangles).sum())
    away = cut_solid(u, 10.0, np.full(3, -1.0), normal, np.zeros(3))
    assert len(away.triangles) == 0  # all of it is taken away


def two_blocks(law: lf.Law, space: str) -> lf.Problem:
    scene = lf.Scene()
    for name, z, count in (("lower", 0.0, 3), ("upper", 1.0, 2)):
        part = geometry.box((1.0, 1.0, 1.0), (count,) * 3, origin=(0, 0, z), cell="tetrahedron")
        scene.substructure(name, part, lf.LinearElastic(E=1.0, nu=0.0), degree=1)
    scene.interface("joint", "lower:z1", "upper:z0", law, space=space)
    scene.fix("lower:z0")
    scene.fix("upper:z1", (0.0, 0.0, -0.1))
    return lf.assemble(scene)


def test_a_field_on_facets_ends_where_they_end() -> None:
    """A linear field at points is met at the corners of the facets, which cover the face."""
    problem = two_blocks(lf.Elastic(normal=1.0, tangential=1.0), "points")
    corners = figures.facet_corners(problem, "joint")
    joint = problem.interfaces["joint"]
    assert areas(corners).sum() == pytest.approx(1.0) and np.allclose(corners[..., 2], 1.0)
    field = 2.0 + joint.points[:, 0] - 3.0 * joint.points[:, 1]
    places, values, triangles = interfaces._on_facets(joint.points[:, :2], field, corners)
    assert np.allclose(values, 2.0 + places[:, 0] - 3.0 * places[:, 1])
    assert len(places) < corners.shape[0] * corners.shape[1] and len(triangles) == len(corners)
    quads = np.array([[[0, 0], [1, 0], [0, 1], [1, 1]], [[1, 0], [2, 0], [1, 1], [2, 1]]], dtype=float)
    at, field = np.array([[0.5, 0.5], [1.2, 0.1]]), np.array([1.0, 3.0])
    places, values, triangles = interfaces._on_facets(at, field, quads)
    assert len(triangles) == 4 and np.allclose(values[places[:, 0] == 1.0], 2.0)  # between one value each


def test_pictures_with_cut_arrows_and_facets(tmp_path) -> None:
    problem = two_blocks(lf.Contact(), "mortar")
    answer = lf.solve(problem)
    down = [((0.5, 0.5, 2.6), (0.5, 0.5, 2.05))]
    cut, low = ((0.5, 0.5, 1.0), (0.0, -1.0, 0.0)), {"renderer": "matplotlib"}
    path = tmp_path / "a.png"
    assert is_picture(figures.interface_figure(answer, "joint", path, cut=cut, arrows=down, **low))
    assert is_picture(figures.deformed_figure(answer, path, arrows=down, **low))
    assert is_picture(figures.stress_figure(answer, path, arrows=down, label="von Mises (MPa)", **low))
    joint = problem.interfaces["joint"]
    corners = figures.facet_corners(problem, "joint")
    assert is_picture(figures.interface_map(joint.points, joint.points[:, 0], path, "x", facets=corners))
    for wrong in (((0, 0, 0), (0, 0, 0)), ((0, 0), (0, 1))):
        with pytest.raises(lf.SceneError, match="interface_figure: cut = "):
            figures.interface_figure(answer, "joint", path, cut=wrong, **low)
    for wrong in (((0, 0, 0), (0, 0, 0)), ((0, 0), (0, 1))):
        with pytest.raises(lf.SceneError, match="arrows.*give .start, end."):
            figures.deformed_figure(answer, path, arrows=[wrong], **low)
    with pytest.raises(lf.SceneError, match="facets of shape"):
        figures.interface_map(joint.points, joint.points[:, 0], path, "x", facets=corners[:, :2])
    with pytest.raises(lf.SceneError, match="facets or mirror, not both"):
        figures.interface_map(joint.points, joint.points[:, 0], path, "x", facets=corners, mirror=math.pi / 4)
    with pytest.raises(lf.SceneError, match="'jiont'"):
        figures.facet_corners(problem, "jiont")
