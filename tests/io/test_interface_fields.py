"""Files of interfaces, of histories and of random answers, read back with public libraries."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dolfinx import fem
from dolfinx.mesh import compute_midpoints
from matplotlib import colormaps

from dolfinx_frontend import (
    Amplitude,
    Contact,
    Elastic,
    LinearElastic,
    LogNormal,
    Scene,
    SceneError,
    assemble,
    figures,
    geometry,
    io,
    load,
    quasi_monte_carlo,
    solve,
)
from dolfinx_frontend.figures import interfaces as interface_figures
from dolfinx_frontend.io import facets
from parts.rings import two_rings

pyvista = pytest.importorskip("pyvista")
meshio = pytest.importorskip("meshio")

ROUNDING = 1e-12


def blocks(joint: Any, space: str = "points", nu: float = 0.3, d: int = 3) -> Scene:
    """Two blocks on each other, the lower one on springs; 0 <= x <= 20, the joint at height 10."""
    scene = Scene()
    for name, height in (("low", 0.0), ("top", 10.0)):
        origin = (0.0,) * (d - 1) + (height,)
        block = geometry.box((20.0, 10.0, 10.0)[3 - d :], (4, 2, 2)[3 - d :], origin=origin)
        scene.substructure(name, block, LinearElastic(E=200e3, nu=nu), degree=2)
    z = "zy"[3 - d]
    scene.interface("joint", f"low:{z}1", f"top:{z}0", joint, space=space)
    scene.interface("springs", f"low:{z}0", Elastic(normal=100.0, tangential=50.0))
    scene.fix(f"top:{z}1", components=tuple(range(d - 1)), name="guide")
    return scene


@pytest.fixture(scope="module")
def history() -> Any:
    """Pressed, then pushed until a part of the joint slips."""
    scene = blocks(Contact(gap=0.0, friction=0.2))
    scene.pressure("top:z1", Amplitude([0, 1, 2], [0, 1, 1]) * 10.0, name="weight")
    scene.traction("low:x1", Amplitude([1, 2], [0, 1]) * (5.0, 0.0, 0.0), name="push")
    return solve(assemble(scene), times=[0.5, 1.0, 2.0])


def test_a_history_that_cannot_be_written_leaves_the_older_one(history: Any, tmp_path: Path) -> None:
    """Its files take the places of the older ones together."""
    io.write(history, tmp_path)
    before = {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()}
    steps = sorted((tmp_path / "parts").glob("step_*/*.vtu"))
    steps[-1].unlink()
    steps[-1].mkdir()
    other = blocks(Contact(gap=0.0, friction=0.2))
    other.pressure("top:z1", Amplitude([0, 2], [0, 1]) * 20.0, name="weight")
    with pytest.raises(SceneError, match=f"{steps[-1].name} cannot be written"):
        io.write_fields(solve(assemble(other), times=history.times, progress=False), tmp_path / "parts.pvd")
    del before[steps[-1]]
    assert {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()} == before


def series(path: Path) -> dict[float, Any]:
    reader = pyvista.PVDReader(path)
    out = {}
    for time in reader.time_values:
        reader.set_active_time_value(time)
        out[time] = reader.read()[0]
    return out


def test_history_of_a_contact(history: Any, tmp_path: Path) -> None:
    """Every number at every point and time is that of the result, in global axes."""
    parts, interfaces = io.write(history, tmp_path / "deep" / "out")
    assert (parts.name, interfaces.name) == ("parts.pvd", "interfaces.pvd")
    read = series(interfaces)
    assert list(read) == [0.5, 1.0, 2.0]
    interface = history.problem.interfaces["joint"]
    force, jump = history.force("joint"), history.jump("joint")
    for k, found in enumerate(read.values()):
        assert found.keys() == ["facets", "points"]
        assert found["points"].keys() == ["joint", "springs", "weight", "push"]  # all but the guide
        cloud = found["points"]["joint"]
        assert np.array_equal(cloud.points, interface.points)
        assert np.array_equal(cloud["area"], interface.weights)
        assert cloud["pressure"] == pytest.approx(-force[k, :, 0], rel=ROUNDING)
        for name, values, size in (("shear", force, 10.0), ("slip", jump, 0.1)):
            vector = np.einsum("pc,pcd->pd", values[k, :, 1:], interface.frames[:, 1:])
            assert cloud[name] == pytest.approx(vector, abs=ROUNDING * size)
        assert np.abs(cloud["shear"][:, 2]).max() < ROUNDING  # tangential to a level face
        assert np.array_equal(cloud["gap"], cloud["opening"])  # meshed without a distance
        side = interface.sides[0].shape @ history.displacements["low"][k].reshape(-1, 3)
        assert cloud["displacement"] == pytest.approx(side, rel=ROUNDING)
        # states: as the law has them
        limit, shear = 0.2 * cloud["pressure"], np.linalg.norm(cloud["shear"], axis=1)
        slips = cloud["state"] == 2
        assert np.all(shear[slips] > 0.99999 * limit[slips])
        assert np.all(shear[cloud["state"] == 1] < limit[cloud["state"] == 1])
        table = history.table("joint", step=k)
        assert cloud["area"] @ slips == pytest.approx(table.value("slip_area", "joint"), abs=1e-9)
    assert 0 < np.count_nonzero(slips) < len(slips)


def test_facets_have_the_means_of_their_points(history: Any, tmp_path: Path) -> None:
    path = io.write_interfaces(history, tmp_path / "joint.vtm", interfaces="joint")
    found = pyvista.read(path)
    surface, cloud = found["facets"]["joint"], found["points"]["joint"]
    assert surface.n_cells == 8 and cloud.n_points == 72
    assert surface["area"] == pytest.approx(surface.compute_cell_sizes()["Area"], rel=ROUNDING)
    owner = surface.find_containing_cell(cloud.points + [0.0, 0.0, 0.0])
    for cell in range(8):
        mine = owner == cell
        assert np.count_nonzero(mine) == 9
        weights = cloud["area"][mine] / cloud["area"][mine].sum()
        assert surface["pressure"][cell] == pytest.approx(weights @ cloud["pressure"][mine], rel=ROUNDING)
        assert surface["shear"][cell] == pytest.approx(weights @ cloud["shear"][mine], abs=ROUNDING * 10.0)
        slips = weights @ (cloud["state"][mine] == 2)
        assert surface["slip share"][cell] == pytest.approx(slips, abs=ROUNDING)
    total = surface["pressure"] @ surface["area"]
    assert total == pytest.approx(-history.table().value("normal", "joint"), rel=1e-10)
    # the displacement of side 1 at the nodes of the facets is that of the part
    nodes = history.problem.substructures["low"].dof_coordinates
    for x, u in zip(surface.points, surface.point_data["displacement"], strict=True):
        at = int(np.argmin(np.linalg.norm(nodes - x, axis=1)))
        assert u == pytest.approx(history.displacements["low"][-1].reshape(-1, 3)[at], rel=1e-10)


def test_the_surface_is_made_once_for_all_steps(history: Any, tmp_path: Path, monkeypatch: Any) -> None:
    made = []

    class Counted(facets.FacetMap):
        def __init__(self, *given: Any) -> None:
            made.append(given)
            super().__init__(*given)

    monkeypatch.setattr(facets, "FacetMap", Counted)
    io.write_interfaces(history, tmp_path / "a.pvd", interfaces=["joint", "springs"])
    assert len(made) == 2


def test_parts_over_a_history(history: Any, tmp_path: Path) -> None:
    read = series(io.write_fields(history, tmp_path / "parts.pvd"))
    nodes = history.problem.substructures["top"].dof_coordinates
    for k, found in enumerate(read.values()):
        grid = found["top"]
        assert {"displacement", "stress", "von Mises"} <= set(grid.point_data)
        at = np.argmin(np.linalg.norm(grid.points[:, None] - nodes, axis=2), axis=1)
        expected = history.displacements["top"][k].reshape(-1, 3)[at]
        assert grid["displacement"] == pytest.approx(expected, rel=1e-10, abs=1e-15)
    first = io.write_fields(history, tmp_path / "first.vtm", step=0)
    assert np.array_equal(pyvista.read(first)["top"]["stress"], read[0.5]["top"]["stress"])


def test_other_readers(history: Any, tmp_path: Path) -> None:
    """meshio reads the grids, which the index names."""
    io.write_interfaces(history, tmp_path / "all.vtm")
    grid = meshio.read(tmp_path / "all" / "4_joint.vtu")
    assert grid.cells[0].type == "vertex" and len(grid.points) == 72
    pressure = -history.force("joint")[-1, :, 0]
    assert grid.point_data["pressure"] == pytest.approx(pressure, rel=ROUNDING)
    surface = meshio.read(tmp_path / "all" / "0_joint.vtu")
    assert surface.cells[0].type == "quad"
    assert surface.cell_data["pressure"][0] @ surface.cell_data["area"][0] == pytest.approx(
        pressure @ grid.point_data["area"], rel=1e-12
    )
    tetrahedra = geometry.box((1.0, 1.0, 1.0), (1, 1, 1), cell="tetrahedron")
    u = fem.Function(fem.functionspace(tetrahedra.mesh, ("Lagrange", 2, (3,))))
    u.interpolate(lambda x: x)
    io.write_fields({"a": u}, tmp_path / "a.vtm")
    part = meshio.read(tmp_path / "a" / "0_a.vtu")
    assert part.point_data["displacement"] == pytest.approx(part.points, abs=1e-14)


def test_facet_space_has_its_values_on_the_facets(tmp_path: Path) -> None:
    """Half a face over another one: only what is covered, and its values as they are."""
    scene = Scene()
    for name, size, z in (("low", 20.0, 0.0), ("top", 10.0, 10.0)):
        block = geometry.box((size, 10.0, 10.0), (int(size / 5), 2, 2), origin=(0.0, 0.0, z))
        scene.substructure(name, block, LinearElastic(E=200e3, nu=0.0), degree=2)
    scene.interface("joint", "low:z1", "top:z0", Contact(gap=0.0), space="facets", overlap="partial")
    scene.fix("low:z0")
    scene.fix("top:z1", components=(0, 1))
    scene.pressure("top:z1", 8.0)
    result = solve(assemble(scene))
    found = pyvista.read(io.write_interfaces(result, tmp_path / "a.vtm", interfaces=["joint"]))
    surface, cloud = found["facets"]["joint"], found["points"]["joint"]
    assert surface.n_cells == cloud.n_points == 4
    assert surface.points[:, 0].max() == pytest.approx(10.0)
    assert np.array_equal(np.sort(surface["pressure"]), np.sort(-result.force("joint")[:, 0]))
    assert surface["pressure"] @ surface["area"] == pytest.approx(800.0, rel=1e-6)
    assert np.array_equal(surface["state"], np.ones(4))  # closed, without friction
    assert "slip" not in surface.cell_data  # a law without tangential components does not know it
    centres = surface.cell_centers().points
    assert {tuple(np.round(x, 9)) for x in centres} == {tuple(np.round(x, 9)) for x in cloud.points}


def test_an_open_contact_and_its_gap(tmp_path: Path) -> None:
    """Blocks that are pulled apart: no pressure, and the gap that is prescribed, plus g0."""
    scene = blocks(Contact(gap=0.25), nu=0.0)
    scene.fix("top:z1", (0.0, 0.0, 0.5), components=(2,), name="lift")
    result = solve(assemble(scene))
    cloud = pyvista.read(io.write_interfaces(result, tmp_path / "a.vtm"))["points"]["joint"]
    assert np.all(cloud["state"] == 0) and np.abs(cloud["pressure"]).max() < 1e-9
    assert cloud["opening"] == pytest.approx(np.full(cloud.n_points, 0.5), rel=1e-6)
    assert cloud["gap"] == pytest.approx(np.full(cloud.n_points, 0.75), rel=1e-6)


def test_curved_facets_in_the_plane(tmp_path: Path) -> None:
    """Rings pressed by a pressure: on quadratic facets, whose nodes lie on the circle."""
    rings = two_rings(10.0, 20.0, 30.0)
    scene = Scene()
    for name, part in rings.parts.items():
        scene.substructure(name, part, LinearElastic(E=200e3, nu=0.3), degree=2)
    joint = rings.interfaces[0]
    scene.interface("joint", joint.face1, joint.face2, Elastic(normal=1e4, tangential=1e4))
    for connection in rings.interfaces[1:]:
        if connection.kind == "symmetry":
            scene.symmetry(connection.face1)
    inner = next(c for c in rings.interfaces if c.kind == "pressure")
    scene.pressure(inner.face1, 10.0)
    result = solve(assemble(scene), active=["joint"])
    found = pyvista.read(io.write_interfaces(result, tmp_path / "a.vtm", interfaces="joint"))
    surface, cloud = found["facets"]["joint"], found["points"]["joint"]
    radius = np.linalg.norm(surface.points, axis=1)
    assert np.ptp(radius) < 1e-9 * radius.max()
    assert cloud["pressure"] == pytest.approx(-result.force("joint")[:, 0], rel=ROUNDING)
    assert np.all(surface["pressure"] > 0.0)
    assert np.all(surface.point_data["displacement"][:, 2] == 0.0)


# --- random answers --------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def random() -> Any:
    """Blocks with random springs between them, pulled by a prescribed displacement."""
    k = LogNormal("k", mean=100.0, cov=0.2)
    scene = blocks(Elastic(normal=k, tangential=k), nu=0.0)
    scene.fix("top:z1", (0.0, 0.0, 0.5), components=(2,), name="lift")
    return solve(assemble(scene), chaos=3)


def test_chaos_of_linear_interfaces(random: Any, tmp_path: Path) -> None:
    parts, interfaces = io.write(random, tmp_path, modes=[0, 2])
    found = pyvista.read(interfaces)
    assert found["points"].keys() == list(random.known) == ["joint", "springs"]
    assert random.plan.active == ("joint",)
    cloud = found["points"]["joint"]
    mean, std = random.moments("joint")
    assert cloud["pressure"] == pytest.approx(-mean[:, 0], rel=ROUNDING)
    assert cloud["pressure std"] == pytest.approx(std[:, 0], rel=ROUNDING)
    assert cloud["opening"] == pytest.approx(random.jump("joint")[:, 0], rel=ROUNDING)
    assert "state" not in cloud.point_data
    grid = pyvista.read(parts)["top"]
    nodes = random.problem.substructures["top"].dof_coordinates
    at = np.argmin(np.linalg.norm(grid.points[:, None] - nodes, axis=2), axis=1)
    u, u_std = (block.reshape(-1, 3)[at] for block in random.moments("top"))
    assert grid["displacement"] == pytest.approx(u, abs=1e-12)
    assert grid["displacement std"] == pytest.approx(u_std, abs=1e-12)
    assert np.array_equal(grid["displacement u0"], grid["displacement"])
    assert grid["displacement u2"] == pytest.approx(
        random.coefficients("top")[:, 2].reshape(-1, 3)[at], abs=1e-12
    )
    # without lateral contraction the bar has the stress of the joint, everywhere
    assert grid["stress"][:, 2] == pytest.approx(np.full(grid.n_points, mean[:, 0].mean()), rel=1e-5)
    assert grid["stress std"][:, 2] == pytest.approx(np.full(grid.n_points, std[:, 0].mean()), rel=1e-5)


def test_chaos_and_samples_of_a_contact(tmp_path: Path) -> None:
    """A gap that closes in about half of all cases."""
    scene = blocks(Contact(gap=LogNormal("g", mean=0.02, cov=0.3)), nu=0.0)
    scene.fix("top:z1", (0.0, 0.0, -0.02), components=(2,), name="press")
    problem = assemble(scene)
    samples = quasi_monte_carlo(problem, 64, keep_states=True)
    cloud = pyvista.read(io.write(samples, tmp_path)[1])["points"]["joint"]
    mean, std = samples.moments("joint")
    size = float(np.abs(mean).max())
    assert cloud["pressure"] == pytest.approx(-mean[:, 0], rel=1e-9)
    assert cloud["pressure std"] == pytest.approx(std[:, 0], abs=1e-9 * size)
    force = samples.force("joint")[..., 0]
    is_open = (force >= -1e-9 * np.abs(force).max(axis=1, keepdims=True)).mean(axis=0)
    assert 0.2 < is_open.min() < 0.8
    assert cloud["open probability"] == pytest.approx(is_open, abs=1e-12)
    assert np.all(cloud["slip probability"] == 0.0)
    # gap = opening + g0, sample by sample
    germs = samples.germs
    g0 = samples.random.sampled("joint", "gap", germs).values[0]
    gap = samples.jump("joint")[..., 0] + g0[:, None]
    assert cloud["gap"] == pytest.approx(gap.mean(axis=0), rel=1e-9)
    assert cloud["gap std"] == pytest.approx(gap.std(axis=0), rel=1e-6)
    with pytest.warns(UserWarning, match="not proven converged"):
        chaos = solve(problem, chaos=4)
    cloud = pyvista.read(io.write_interfaces(chaos, tmp_path / "c.vtm"))["points"]["joint"]
    mean, std = chaos.moments("joint")
    assert cloud["pressure"] == pytest.approx(-mean[:, 0], rel=1e-9)
    assert cloud["pressure std"] == pytest.approx(std[:, 0], rel=1e-6)
    assert np.all(cloud["gap"] > -1e-9)  # a contact does not penetrate, in the mean neither
    at_samples = chaos.at(chaos.moment_germs()).force("joint")[..., 0]
    assert cloud["open probability"] == pytest.approx((at_samples == 0.0).mean(axis=0), abs=1e-12)


# --- loaded results --------------------------------------------------------------------------------
def same_data(mine: Any, theirs: Any) -> None:
    assert np.array_equal(mine.points, theirs.points)
    assert set(mine.point_data) == set(theirs.point_data) and set(mine.cell_data) == set(theirs.cell_data)
    for one, other in ((mine.point_data, theirs.point_data), (mine.cell_data, theirs.cell_data)):
        for key in one:
            size = float(np.abs(one[key]).max())
            assert other[key] == pytest.approx(one[key], rel=1e-9, abs=1e-9 * size)


def by_place(grid: Any) -> Any:
    """Point data in an order that does not depend on that of the cells."""
    # by VTK: pyvista has given the property another name
    offsets = pyvista.convert_array(grid.GetCells().GetOffsetsArray())
    middle = np.repeat(grid.cell_centers().points, np.diff(offsets), axis=0)
    order = np.lexsort(np.round(np.hstack([middle, grid.points]), 6).T)
    return {key: values[order] for key, values in grid.point_data.items()}


def test_a_loaded_result_has_the_same_fields(history: Any, random: Any, tmp_path: Path) -> None:
    for number, result in enumerate((history, random)):
        result.save(tmp_path / f"{number}.h5")
        again = load(tmp_path / f"{number}.h5")
        own, loaded = tmp_path / f"own{number}.vtm", tmp_path / f"loaded{number}.vtm"
        names = list(result.plan.active)
        io.write_interfaces(result, own, interfaces=names)
        io.write_interfaces(again, loaded, interfaces=names)
        for group in ("points", "facets"):
            for name in names:
                mine, theirs = (pyvista.read(path)[group][name] for path in (own, loaded))
                if group == "points":
                    same_data(mine, theirs)
                else:
                    assert sorted(mine.cell_data["area"]) == pytest.approx(sorted(theirs.cell_data["area"]))
        mine, theirs = (
            by_place(pyvista.read(io.write_fields(one, tmp_path / f"parts{number}.vtm", shared=False))["low"])
            for one in (result, again)
        )
        assert set(mine) == set(theirs) and "stress" in mine
        for key, values in mine.items():
            assert theirs[key] == pytest.approx(values, abs=1e-9 * float(np.abs(values).max()))
    assert len(series(io.write(load(tmp_path / "0.h5"), tmp_path / "s")[1])) == 3


# --- pictures --------------------------------------------------------------------------------------
@pytest.mark.parametrize("space", ["points", "facets"])
@pytest.mark.parametrize("d", [2, 3])
def test_every_facet_has_its_own_colour(d: int, space: str, tmp_path: Path, monkeypatch: Any) -> None:
    """A shear stiffness that grows with x: the facet at x, wherever it is in the mesh, is coloured by x."""
    scene = blocks(Elastic(normal=lambda x: 10.0 + x[:, 0], tangential=1.0), space, nu=0.0, d=d)
    scene.fix(f"top:{'zy'[3 - d]}1", -1.0, components=d - 1, name="press")
    result = solve(assemble(scene))
    numbers, found = io.facet_fields(result, "joint")
    part = result.problem.substructures["low"].part
    middles = compute_midpoints(part.mesh, d - 1, numbers.astype(np.int32))[:, :d]
    interface, force = result.problem.interfaces["joint"], result.force("joint")[:, 0]
    owner = np.argmin(np.linalg.norm(interface.points - middles[:, None], axis=2), axis=0)  # equal rectangles
    share = interface.weights * (owner == np.arange(len(numbers))[:, None])
    p = found["pressure"]
    assert p == pytest.approx(-share @ force / share.sum(axis=1), rel=1e-12)
    assert np.corrcoef(p, middles[:, 0])[0, 1] > 0.9
    seen: list[Any] = []
    monkeypatch.setattr(interface_figures, "draw_solid", lambda *given: seen.append(given[2]) or 1.0)
    monkeypatch.setattr(interface_figures, "save", lambda figure, path, **how: seen.append(figure))
    figures.interface_figure(result, "joint", tmp_path / "a.png", scale=0.0)
    wanted = colormaps["viridis"]((p - p.min()) / np.ptp(p))[:, :3]
    if d == 2:
        lines = seen[0].axes[0].collections[-1]
        assert np.mean(lines.get_segments(), axis=1) == pytest.approx(middles)
        assert lines.get_colors()[:, :3] == pytest.approx(wanted)
        return
    drawn = np.flatnonzero(np.ptp(seen[0].colours, axis=1) > 0.1)  # the others are grey
    centres = seen[0].points[seen[0].triangles[drawn]].mean(axis=1)
    owner = np.argmin(np.linalg.norm(centres - middles[:, None], axis=2), axis=0)
    assert np.all(np.bincount(owner) == 8)  # triangles a facet
    assert seen[0].colours[drawn] == pytest.approx(wanted[owner])


@pytest.mark.parametrize("d", [2, 3])
def test_mortar_fields_are_drawn_without_steps(d: int, tmp_path: Path, monkeypatch: Any) -> None:
    """A pressure that grows with x is coloured point by point, by x, and states have three colours."""
    scene = blocks(Contact(gap=0.0, stiffness=lambda x: 10.0 + x[:, 0]), "mortar", nu=0.0, d=d)
    scene.fix(f"top:{'zy'[3 - d]}1", -1.0, components=d - 1, name="press")
    result = solve(assemble(scene))
    numbers, found = facets.corner_fields(result, "joint")
    i = result.problem.interfaces["joint"]
    assert found["pressure"].shape == (len(numbers), 2 if d == 2 else found["pressure"].shape[1])
    nodal = i.vertices.nodal @ -result.force("joint")[:, 0]
    assert found["pressure"] == pytest.approx(nodal[i.vertices.corners])
    seen: list[Any] = []
    monkeypatch.setattr(interface_figures, "draw_solid", lambda *given: seen.append(given[2]) or 1.0)
    monkeypatch.setattr(interface_figures, "save", lambda figure, path, **how: seen.append(figure))
    figures.interface_figure(result, "joint", tmp_path / "a.png", scale=0.0)
    if d == 2:
        lines = seen[0].axes[0].collections[-1]
        x, colours = np.mean(lines.get_segments(), axis=1)[:, 0], lines.get_colors()[:, :3]
        assert len(x) == 4 * len(numbers)
    else:
        drawn = np.flatnonzero(np.ptp(seen[0].colours, axis=1) > 0.1)  # the others are grey
        x, colours = seen[0].points[drawn, 0], seen[0].colours[drawn]
    order = np.argsort(x)
    green = colours[order, 1]  # rises all along viridis
    assert np.corrcoef(x[order], green)[0, 1] > 0.97
    assert len(np.unique(np.round(green, 6))) > len(np.unique(np.round(i.points[:, 0], 6)))
    seen.clear()
    figures.interface_figure(result, "joint", tmp_path / "b.png", quantity="state", scale=0.0)
    figure = seen[-1]
    assert [t.get_text() for t in figure.axes[-1].get_yticklabels()] == ["open", "closed", "slips"]


@pytest.mark.parametrize("renderer", ["vtk", "matplotlib"])
def test_picture_of_the_pressure(history: Any, renderer: str, tmp_path: Path) -> None:
    """The colours of the lowest and of the highest facet, and no others at these places, are in it."""
    image = pytest.importorskip("PIL.Image")
    if renderer == "vtk" and shutil.which("xvfb-run") is None:
        pytest.skip("needs xvfb-run")
    path = figures.interface_figure(history, "joint", tmp_path / "a.png", renderer=renderer)
    pixels = np.asarray(image.open(path).convert("RGB"), dtype=int)[:, :800]  # without the colour bar
    for colour in ((68, 1, 84), (253, 231, 37)):  # ends of viridis
        near = np.abs(pixels - colour).max(axis=2) < 30
        assert near.sum() > 5000
    # pressed hardest on the left
    assert np.nonzero(near)[1].mean() < 0.5 * pixels.shape[1]


def test_picture_in_the_plane_and_mistakes(tmp_path: Path) -> None:
    scene = blocks(Contact(gap=0.0), d=2)
    scene.pressure("top:y1", 10.0)
    result = solve(assemble(scene))
    assert figures.interface_figure(result, "joint", tmp_path / "a.png").stat().st_size > 5000
    with pytest.raises(SceneError, match="pressur"):
        figures.interface_figure(result, "joint", tmp_path / "b.png", quantity="presure")
    with pytest.raises(SceneError, match="guide"):
        figures.interface_figure(result, "guide", tmp_path / "b.png")
    with pytest.raises(SceneError, match=r"hide: unknown part 'tip'.*'low', 'top'"):
        figures.interface_figure(result, "joint", tmp_path / "b.png", hide=["tip"])


def test_no_vtk_is_said(history: Any, tmp_path: Path, monkeypatch: Any) -> None:
    (tmp_path / "pyvista.py").write_text("raise ImportError('no pyvista here')\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with pytest.raises(figures.RenderError, match=r"no pyvista here.*install pyvista"):
        figures.interface_figure(history, "joint", tmp_path / "a.png", renderer="vtk")


# --- mistakes --------------------------------------------------------------------------------------
def test_mistakes(history: Any, random: Any, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"ends in \.vtm, or in \.pvd"):
        io.write_interfaces(history, tmp_path / "a.vtu")
    with pytest.raises(ValueError, match="there is no load history"):
        io.write_interfaces(random, tmp_path / "a.pvd")
    with pytest.raises(SceneError, match="no step 3, the history has 3"):
        io.write_fields(history, tmp_path / "a.vtm", step=3)
    with pytest.raises(SceneError, match="guide"):
        io.write_interfaces(history, tmp_path / "a.vtm", interfaces="guide")
    with pytest.raises(SceneError, match="no mode 4, the chaos has 4"):
        io.write_fields(random, tmp_path / "a.vtm", modes=[4])
    with pytest.raises(SceneError, match="only the result of a chaos"):
        io.write_fields(history, tmp_path / "a.vtm", modes=[1])
    samples = random.quasi_monte_carlo(4)
    with pytest.raises(SceneError, match="keep_states=True"):
        io.write_fields(samples, tmp_path / "a.vtm")
    io.write_interfaces(samples, tmp_path / "b.vtm")  # needs no states
    assert not (tmp_path / "a.vtm").exists()
