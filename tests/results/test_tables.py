"""Tables against closed forms; saved results against what was saved, read by a fresh process and by h5py."""

from __future__ import annotations

import csv
import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import dolfinx_frontend as lf
from dolfinx_frontend import (
    Amplitude,
    Chaos,
    Contact,
    Displacement,
    Elastic,
    LinearElastic,
    LogNormal,
    Options,
    Perfect,
    Preload,
    Scene,
    SceneError,
    Uniform,
    assemble,
    discretisation_error,
    geometry,
    io,
    load,
    monte_carlo,
    solve,
    tensor_quadrature,
)
from dolfinx_frontend.results import saved, tables
from dolfinx_frontend.results.answer import Surface
from dolfinx_frontend.results.readings import measure
from dolfinx_frontend.scene.laws import Law

E, LENGTH, WIDTH = 200e3, 20.0, 10.0  # MPa, mm
AREA = WIDTH**2
TIGHT = Options(rtol=1e-10)


def two_blocks(law: Law, nu: float = 0.0, dim: int = 3) -> Scene:
    """Two bars in line along x, joined at x = 20; the left end is fixed."""
    scene = Scene()
    for name, x0 in (("left", 0.0), ("right", LENGTH)):
        size = (LENGTH, WIDTH, WIDTH)[:dim]
        cell = "hexahedron" if dim == 3 else "quadrilateral"
        block = geometry.box(size, (2,) * dim, origin=(x0, 0.0, 0.0)[:dim], cell=cell)
        scene.substructure(name, block, LinearElastic(E=E, nu=nu), degree=1)
    scene.interface("joint", "left:x1", "right:x0", law)
    scene.fix("left:x0")
    return scene


# --- deterministic ---------------------------------------------------------------------------------
@pytest.mark.parametrize("active", [None, ["joint"], "all"])
def test_resultants_are_those_of_the_load(active: Any) -> None:
    """Force and moment at every section of a cantilever, however the plan treats its interfaces."""
    scene = two_blocks(Elastic(normal=50.0, tangential=20.0), nu=0.3)
    scene.traction("right:x1", (10.0, 3.0, -2.0))
    result = solve(assemble(scene), active=active, options=TIGHT)
    table = result.table()
    force = AREA * np.array([10.0, 3.0, -2.0])
    arms = {"joint": LENGTH, "displacement(left:x0)": 2 * LENGTH, "traction(right:x1)": 0.0}
    signs = {"joint": 1.0, "displacement(left:x0)": -1.0, "traction(right:x1)": 1.0}
    # 100 times the tolerance of the iteration, relative to the largest moment
    near = dict(rtol=1e-8, atol=1e-8 * 2 * LENGTH * 300.0)
    for name, arm in arms.items():
        found = [table.value(f"force_{a}", name) for a in "xyz"]
        np.testing.assert_allclose(found, signs[name] * force, **near)
        found = [table.value(f"moment_{a}", name) for a in "xyz"]
        exact = signs[name] * np.cross([arm, 0.0, 0.0], force)
        np.testing.assert_allclose(found, exact, **near)
        assert table.value("area", name) == pytest.approx(AREA)
        assert table.value("normal", name) == pytest.approx(1000.0)
        assert table.value("shear", name) == pytest.approx(np.hypot(300.0, 200.0))
        assert table.value("pressure_mean", name) == pytest.approx(-10.0)
    # about one point, support and load balance
    table = result.table(about=(1.0, 2.0, 3.0))
    for column in ("force_x", "force_y", "force_z", "moment_x", "moment_y", "moment_z"):
        total = table.value(column, "displacement(left:x0)") + table.value(column, "traction(right:x1)")
        assert abs(total) < near["atol"]


def test_plane_problem_has_one_moment() -> None:
    scene = two_blocks(Elastic(normal=50.0, tangential=20.0), dim=2)
    scene.traction("right:x1", (0.0, 3.0))
    table = solve(assemble(scene)).table("joint")
    assert table.value("force_y", "joint") == pytest.approx(3.0 * WIDTH)
    assert table.value("moment_z", "joint") == pytest.approx(3.0 * WIDTH * LENGTH)
    assert "moment_x" not in table.columns and "force_z" not in table.columns


def test_pressure_is_positive_in_compression() -> None:
    scene = two_blocks(Elastic(normal=50.0))
    scene.pressure("right:x1", 7.0)
    for side in ("left", "right"):
        scene.symmetry(f"{side}:y0")
        scene.symmetry(f"{side}:z0")
    table = solve(assemble(scene)).table("joint")
    for column in ("pressure_min", "pressure_mean", "pressure_max"):
        assert table.value(column, "joint") == pytest.approx(7.0)
    assert table.value("shear_max", "joint") == pytest.approx(0.0, abs=1e-10)
    assert np.isnan(table.value("open_area", "joint"))


def test_reactions_that_share_nodes_are_told_apart_by_their_directions() -> None:
    """Symmetry planes share edges, but each pushes along its own normal only."""
    scene = two_blocks(Perfect(), nu=0.3)
    scene.symmetry("left:y0")
    scene.symmetry("left:z0")
    scene.fix("right:x1", (0.01, 0.0, 0.0))
    table = solve(assemble(scene)).table()
    # the clamped face holds y and z as well, which its edges share with the planes
    assert "displacement(left:x0)" not in table["interface"]
    assert "displacement(left:x0)" in str(table) and "shares nodes" in str(table)
    assert table.value("force_x", "joint") > 0.0
    scene = Scene()
    block = geometry.box((LENGTH, WIDTH, WIDTH), (2, 2, 2), cell="hexahedron")
    scene.substructure("bar", block, LinearElastic(E=E, nu=0.3), degree=1)
    for face in ("x0", "y0", "z0"):
        scene.symmetry(f"bar:{face}")
    scene.fix("bar:x1", 0.01, components=0)
    table = solve(assemble(scene)).table()
    by = {name: table.value("force_x", name) for name in table["interface"]}
    exact = E * 0.01 / LENGTH * AREA
    assert by["symmetry(bar:x0)"] == pytest.approx(-exact)
    assert by["displacement(bar:x1)"] == pytest.approx(exact)
    for name in ("symmetry(bar:y0)", "symmetry(bar:z0)"):
        each = [table.value(f"force_{a}", name) for a in "xyz"]
        np.testing.assert_allclose(each, 0.0, atol=1e-9 * exact)


def test_open_area_is_where_there_is_a_gap() -> None:
    scene = two_blocks(Contact(gap=lambda x: np.where(x[:, 1] > WIDTH / 2, 1.0, 0.0)))
    scene.fix("right:x1", (-0.01, 0.0, 0.0))
    result = solve(assemble(scene), options=TIGHT)
    table = result.table("joint")
    open_ = table.value("open_area", "joint")
    joint = result.problem.interfaces["joint"]
    apart = joint.weights[joint.points[:, 1] > WIDTH / 2].sum()
    # the rim of the pressed half lifts off, too
    assert apart <= open_ < AREA
    pressed = result.force("joint")[:, 0] < 0.0
    assert open_ == pytest.approx(AREA - result.problem.interfaces["joint"].weights[pressed].sum())
    assert table.value("pressure_min", "joint") == 0.0
    assert table.value("pressure_max", "joint") > 0.0
    assert np.isnan(table.value("slip_area", "joint"))  # no friction, nothing to slip against


def sheared(friction: Any) -> Scene:
    """Pressed together until t = 1, then pulled far enough sideways to slip everywhere at t = 2."""
    scene = two_blocks(Contact(friction=friction))
    press, shear = Amplitude([0, 1], [0, 1]), Amplitude([1, 2], [0, 1])
    move = press * (-0.01, 0.0, 0.0) + shear * (0.0, 0.2, 0.0)
    scene.fix("right:x1", move, name="grip")
    return scene


def test_slipping_area_and_time() -> None:
    table = solve(assemble(sheared(0.05)), times=[1.0, 2.0], options=TIGHT).table("joint", step=None)
    assert list(table["time"]) == [1.0, 2.0]
    assert table.value("slip_area", "joint", time=1.0) == 0.0
    closed = AREA - table.value("open_area", "joint", time=2.0)
    assert table.value("slip_area", "joint", time=2.0) == pytest.approx(closed)
    normal = table.value("normal", "joint", time=2.0)
    assert table.value("shear", "joint", time=2.0) == pytest.approx(-0.05 * normal, rel=1e-3)
    assert len(solve(assemble(sheared(0.05)), times=[1.0, 2.0]).table("joint")) == 1


def bolted() -> Scene:
    """A bolt tightened to 500 N until t = 1, its end pulled by 0.01 mm until t = 2."""
    scene = two_blocks(Preload(500.0, until=1.0))
    pull = Amplitude([1, 2], [0, 1])
    scene.fix("right:x1", pull * (0.01, 0.0, 0.0), name="grip")
    return scene


def test_bolt_before_and_after_loading() -> None:
    result = solve(assemble(bolted()), times=[0.5, 1.0, 1.5, 2.0], options=TIGHT)
    table = result.bolts()
    after = 500.0 + E * AREA * 0.01 / (2 * LENGTH)
    assert list(table["interface"]) == ["joint"] and list(table["tightened"]) == [1.0]
    for column, exact in (("before", 500.0), ("after", after), ("change", after - 500.0)):
        assert table.value(column, "joint") == pytest.approx(exact, rel=1e-7)
    assert table.value("highest", "joint") == table.value("after", "joint")


def test_bolt_by_shortening_is_tight_when_the_jump_is_constant() -> None:
    tighten, pull = Amplitude([0, 1], [0, 1]), Amplitude([1, 2], [0, 1])
    scene = two_blocks(Elastic(normal=50.0, tangential=50.0, jump=tighten * -0.02))
    scene.fix("right:x1", pull * (0.01, 0.0, 0.0), name="grip")
    table = solve(assemble(scene), times=[0.5, 1.0, 2.0]).bolts()
    stiffness = AREA / (1 / 50.0 + 2 * LENGTH / E)
    assert table.value("tightened", "joint") == 1.0
    assert table.value("before", "joint") == pytest.approx(0.02 * stiffness)
    assert table.value("after", "joint") == pytest.approx(0.03 * stiffness)


# --- random ----------------------------------------------------------------------------------------
STRETCH = 0.05


def layered() -> Scene:
    """The end is pulled by 0.05 mm, the layer has a random stiffness: N = A u / (2 L / E + 1 / k)."""
    k = LogNormal("k", mean=50.0, cov=0.2)
    scene = two_blocks(Elastic(normal=k, tangential=50.0))
    scene.fix("right:x1", (STRETCH, 0.0, 0.0))
    return scene


def force_of(k: Any) -> Any:
    return AREA * STRETCH / (2 * LENGTH / E + 1 / k)


def test_statistics_of_samples_and_quadrature() -> None:
    problem = assemble(layered())
    result = monte_carlo(problem, 40, options=TIGHT)
    exact = force_of(np.exp(np.log(50.0 / np.sqrt(1.04)) + np.sqrt(np.log(1.04)) * result.germs[:, 0]))
    table = result.table(quantiles=(0.1, 0.5))
    assert table.value("normal", "joint", statistic="mean") == pytest.approx(exact.mean(), rel=1e-8)
    assert table.value("normal", "joint", statistic="std") == pytest.approx(exact.std(ddof=1), rel=1e-6)
    for q in (0.1, 0.5):
        found = table.value("normal", "joint", statistic=f"{100 * q:g} %")
        assert found == pytest.approx(np.quantile(exact, q, method="median_unbiased"), rel=1e-8)
    rule = tensor_quadrature(problem, 8, options=TIGHT).table()
    assert set(rule["statistic"]) == {"mean", "std"}
    x, w = np.polynomial.hermite_e.hermegauss(40)
    w /= w.sum()
    values = force_of(np.exp(np.log(50.0 / np.sqrt(1.04)) + np.sqrt(np.log(1.04)) * x))
    mean = w @ values
    assert rule.value("normal", "joint", statistic="mean") == pytest.approx(mean, rel=1e-6)
    deviation = np.sqrt(w @ (values - mean) ** 2)
    assert rule.value("normal", "joint", statistic="std") == pytest.approx(deviation, rel=1e-4)
    chaos = solve(problem, chaos=Chaos(order=5), options=TIGHT)
    table = chaos.table(samples=2000)
    # 4 standard errors of 2 000 samples
    found = table.value("normal", "joint", statistic="mean")
    assert found == pytest.approx(mean, abs=4 * deviation / np.sqrt(2000))
    median = force_of(50.0 / np.sqrt(1.04))
    # the density of a quantile by that of the normal law: 1.25 standard errors of the mean
    found = table.value("normal", "joint", statistic="50 %")
    assert found == pytest.approx(median, abs=5 * deviation / np.sqrt(2000))


def test_a_load_is_the_same_in_all_samples_and_needs_no_displacements() -> None:
    p = 3.0
    scene = two_blocks(Elastic(normal=Uniform("k", 40.0, 60.0), tangential=50.0))
    scene.pressure("right:y1", p, name="press")
    result = solve(assemble(scene), chaos=Chaos(2))
    rows = result.table(["joint", "press"], samples=64).columns
    assert "_blocks" not in vars(result)  # interior unknowns of all modes
    at = [k for k, name in enumerate(rows["interface"]) if name == "press"]
    pressed = {rows["statistic"][k]: rows["force_y"][k] for k in at}
    assert pressed["mean"] == pytest.approx(-p * LENGTH * WIDTH, rel=1e-12) and pressed["std"] == 0.0
    assert {pressed[key] for key in pressed if key.endswith("%")} == {pressed["mean"]}
    force = next(result.blocks(8)).force("press")
    assert len(force) == 8 and (force == result.load("press")).all() and result.load("joint") is None


@pytest.mark.parametrize(("dim", "components"), [(2, 1), (2, 2), (3, 1), (3, 2), (3, 3)])
def test_measures_are_sums_over_the_points(dim: int, components: int) -> None:
    """Against the same numbers vector by vector, in frames that need not begin with the normal."""
    rng = np.random.default_rng(10 * dim + components)
    count, samples = 7, 5
    points, weights = rng.standard_normal((count, dim)), rng.uniform(0.5, 1.5, count)
    frames, normals = (np.linalg.qr(rng.standard_normal((count, dim, dim)))[0] for _ in range(2))
    surface = Surface("a", "Law", points, weights, normals[:, 0], frames[:, :components])
    force = rng.standard_normal((samples, count, components))
    found = measure(surface, force)
    centre = weights @ points / weights.sum()
    for s in range(samples):
        vectors = np.array([f @ axes for f, axes in zip(force[s], surface.frames, strict=True)])
        normal = np.array([v @ n for v, n in zip(vectors, surface.normals, strict=True)])
        along = vectors - normal[:, None] * surface.normals
        moment = sum(np.cross(*np.pad([x - centre, w * v], ((0, 0), (0, 3 - dim)))) for x, w, v in
                     zip(points, weights, vectors, strict=True))
        wanted = {f"force_{'xyz'[a]}": weights @ vectors[:, a] for a in range(dim)}
        wanted |= {f"moment_{'xyz'[a]}": moment[a] for a in range(2 if dim == 2 else 0, 3)}
        wanted |= {"normal": weights @ normal, "shear": np.linalg.norm(weights @ along)}
        wanted |= {"pressure_max": -normal.min(), "pressure_mean": -(weights @ normal) / weights.sum()}
        wanted |= {"shear_max": np.linalg.norm(along, axis=1).max()}
        for column, value in wanted.items():
            assert found[column][s] == pytest.approx(value, rel=1e-12, abs=1e-13), column


def test_random_friction_slips_at_its_own_limit() -> None:
    """At every sample the shear force is its own friction times the pressure."""
    problem = assemble(sheared(Uniform("mu", 0.02, 0.06)))
    result = monte_carlo(problem, 4, times=[1.0, 2.0], options=TIGHT)
    table = result.table()
    closed = AREA - table.value("open_area", "joint", statistic="mean")
    assert table.value("slip_area", "joint", statistic="mean") == pytest.approx(closed)
    mu = 0.04 + 0.02 * result.germs[:, 0]
    force = result.force("joint")[:, -1]
    weights = problem.interfaces["joint"].weights
    np.testing.assert_allclose(force[..., 1] @ weights, -mu * (force[..., 0] @ weights), rtol=1e-2)


# --- forms of a table ------------------------------------------------------------------------------
def test_csv_and_pandas_and_text(tmp_path: Path) -> None:
    scene = two_blocks(Elastic(normal=50.0, tangential=20.0), nu=0.3)
    scene.traction("right:x1", (10.0, 3.0, 0.0))
    table = solve(assemble(scene)).table()
    table.to_csv(tmp_path / "table.csv")
    with (tmp_path / "table.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["interface"] for row in rows] == list(table["interface"])
    assert float(rows[0]["force_y"]) == table.value("force_y", "joint")
    assert rows[0]["open_area"] == ""
    pandas = pytest.importorskip("pandas")
    frame = table.to_pandas()
    assert isinstance(frame, pandas.DataFrame)
    assert frame.loc["joint", "force_y"] == table.value("force_y", "joint")
    text = str(table)
    assert max(map(len, text.splitlines())) <= 110
    # rounding is shown as nothing
    assert text.splitlines()[1].split()[:6] == ["joint", "Elastic", "100", "1000", "300", "0"]


def test_bad_questions() -> None:
    scene = two_blocks(Elastic(normal=50.0, tangential=20.0))
    scene.traction("right:x1", (10.0, 0.0, 0.0))
    problem = assemble(scene)
    result = solve(problem)
    with pytest.raises(SceneError, match="unknown interface 'jiont'; did you mean 'joint'"):
        result.table("jiont")
    with pytest.raises(SceneError, match="there is no step 3, the history has 1"):
        result.table(step=3)
    with pytest.raises(SceneError, match="a point of 3 coordinates"):
        result.table(about=(0.0, 0.0))
    with pytest.raises(SceneError, match="no load history"):
        result.bolts()
    with pytest.raises(SceneError, match="no interface of the table is a bolt"):
        solve(problem, times=[0.0, 1.0]).bolts()
    with pytest.raises(SceneError, match="unknown column 'force_q'"):
        result.table()["force_q"]
    with pytest.raises(SceneError, match="0 rows with interface = 'j'"):
        result.table().value("force_x", "j")
    with pytest.raises(SceneError, match=r"quantile = 1.5; it must be in \(0, 1\)"):
        monte_carlo(assemble(layered()), 2).table(quantiles=[1.5])


# --- files -----------------------------------------------------------------------------------------
def in_fresh_process(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_history_is_read_by_a_fresh_process(tmp_path: Path) -> None:
    path = tmp_path / "bolt.h5"
    result = solve(assemble(bolted()), times=[1.0, 2.0], options=TIGHT)
    result.save(path)
    printed = in_fresh_process(
        "from dolfinx_frontend import load\n"
        f"result = load({str(path)!r})\n"
        "print(result.table(step=None), result.bolts(), result.plan, sep='\\n')\n"
    )
    assert printed == f"{result.table(step=None)}\n{result.bolts()}\n{result.plan}\n"
    found = load(path)
    assert found.kind == "history" and found.converged and found.iterations == result.iterations
    np.testing.assert_array_equal(found.times, [1.0, 2.0])
    np.testing.assert_array_equal(found.force("joint"), result.force("joint"))
    np.testing.assert_array_equal(found.jump("joint"), result.jump("joint"))
    part = result.problem.substructures["right"]
    np.testing.assert_array_equal(found.nodes["right"], part.dof_coordinates)
    values = found.displacements["right"]
    np.testing.assert_array_equal(values, result.displacements["right"])
    assert [str(side) for side in found.interfaces["joint"].sides] == ["left:x1", "right:x0"]
    assert "kind" not in found.interfaces["joint"].law and "Preload" in repr(found.interfaces["joint"])


def test_file_is_plain_hdf5(tmp_path: Path) -> None:
    path = tmp_path / "bolt.hdf5"
    result = solve(assemble(bolted()), times=[1.0, 2.0])
    result.save(path)
    with h5py.File(path) as file:
        assert file.attrs["format"] == "latin-result" and file.attrs["version"] == 3
        joint = file["interfaces/joint"]
        np.testing.assert_array_equal(joint["force"], result.force("joint"))
        total = joint["force"][..., 0] @ joint["weights"][()]
        np.testing.assert_allclose(total, joint["measures/normal"])
        np.testing.assert_array_equal(file["times"], [1.0, 2.0])


def test_chaos_and_samples_are_read_again(tmp_path: Path) -> None:
    problem = assemble(layered())
    chaos = solve(problem, chaos=Chaos(order=3))
    chaos.save(tmp_path / "chaos.h5", samples=200)
    found = load(tmp_path / "chaos.h5")
    assert str(found.table()) == str(chaos.table(samples=200))
    assert found.chaos is not None
    germs = chaos.space.sample(3, 1)
    np.testing.assert_allclose(
        found.chaos.evaluate("force:joint", germs), chaos.at(germs).force("joint"), rtol=1e-12
    )
    mean = chaos.mean("left").x.array
    np.testing.assert_allclose(found.displacements["left"].ravel(), mean)
    samples = monte_carlo(problem, 5)
    ended = np.array(samples.points.status)
    ended[1:4] = ["max_iterations", "slides", "undecided"]
    samples = replace(samples, points=replace(samples.points, status=ended))
    samples.save(tmp_path / "samples.h5")
    found = load(tmp_path / "samples.h5")
    assert found.status == samples.status == "slides" and not found.converged
    assert str(found.table(quantiles=[0.3])) == str(samples.table(quantiles=[0.3]))
    np.testing.assert_array_equal(found.force("joint"), samples.force("joint"))
    np.testing.assert_array_equal(found.germs, samples.germs)
    rule = tensor_quadrature(problem, 3)
    rule.save(tmp_path / "rule.h5", fields=False)
    found = load(tmp_path / "rule.h5")
    assert str(found.table()) == str(rule.table())
    with pytest.raises(saved.ResultFileError, match="saved without fields"):
        found.force("joint")


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("saved") / "small.h5"
    scene = two_blocks(Elastic(normal=50.0, tangential=20.0))
    scene.interface("extra", "right:y0", Displacement(0.0, (1,)))
    scene.traction("right:x1", (10.0, 0.0, 0.0))
    solve(assemble(scene)).save(path)
    return path


def test_damaged_files_are_refused(small: Path, tmp_path: Path) -> None:
    content = small.read_bytes()
    bad = tmp_path / "bad.h5"
    rng = np.random.default_rng(0)
    for place in rng.integers(0, len(content), 20):
        changed = bytearray(content)
        changed[place] ^= 0x55
        bad.write_bytes(changed)
        if bad.read_bytes()[:100] == content[:100] and place < 512:
            continue  # unused bytes of the head
        with pytest.raises(saved.ResultFileError, match="damaged"):
            load(bad)
    for size in (0, 10, 600, len(content) // 2, len(content) - 1):
        bad.write_bytes(content[:size])
        with pytest.raises(saved.ResultFileError, match="truncated"):
            load(bad)


def test_other_files_are_refused(
    small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = two_blocks(Elastic(normal=LogNormal("k", mean=50.0, cov=0.2), tangential=1.0))
    scene.traction("right:x1", (10.0, 0.0, 0.0))
    problem = assemble(scene)
    solve(problem, chaos=1).save_chaos(tmp_path / "chaos.h5")
    with pytest.raises(saved.ResultFileError, match="is a chaos file: read it with"):
        load(tmp_path / "chaos.h5")
    with pytest.raises(saved.ResultFileError, match="does not exist"):
        load(tmp_path / "nothing.h5")
    with pytest.raises(saved.ResultFileError, match=r"saved as \.h5 or \.hdf5, not '\.txt'"):
        solve(problem).save(tmp_path / "result.txt")
    with pytest.raises(saved.ResultFileError, match="cannot be written .* choose a folder"):
        solve(problem).save(tmp_path / "nowhere" / "result.h5")
    kept = tmp_path / "kept" / "result.h5"
    kept.parent.mkdir()
    kept.write_bytes(b"before")

    def full(temporary: Path, *_: Any) -> None:
        temporary.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(saved.hdf5, "write_tree", full)
        with pytest.raises(saved.ResultFileError, match="cannot be written .*No space left.*has room"):
            solve(problem).save(kept)
    assert [each.read_bytes() for each in kept.parent.iterdir()] == [b"before"]
    with h5py.File(tmp_path / "foreign.h5", "w") as file:
        file["x"] = 1.0
    with pytest.raises(saved.ResultFileError, match="no saved result"):
        load(tmp_path / "foreign.h5")
    monkeypatch.setattr(saved, "OLDEST", 4)
    monkeypatch.setattr(saved, "VERSION", 5)
    with pytest.raises(saved.ResultFileError, match="of version 3; this software reads versions 4 to 5"):
        load(small)


# made by the software that wrote version 1
OLD = Path(__file__).parent.parent / "data"


def test_deterministic_files_of_version_1_are_read() -> None:
    found = load(OLD / "contact_1.h5")
    assert found.kind == "deterministic" and found.converged and "Contact" in found.interfaces["joint"].law
    # 0.01 is taken up by a gap of 0.002, k = 100 and two bars of 20 with E = 200 000: k_bar = 1e4
    pressure = 0.008 / (1.0 / 100.0 + 2 * LENGTH / E)
    assert found.table().value("pressure_mean", "joint") == pytest.approx(pressure, rel=1e-6)
    np.testing.assert_allclose(found.force("joint")[:, 0], -pressure, rtol=1e-6)
    np.testing.assert_allclose(found.displacements["right"].reshape(-1, 2)[:, 0].min(), -0.01)
    assert float(found.quantity(lambda f: f.force("joint")[..., 0].min(axis=1)).values[0]) < 0.0
    with pytest.raises(saved.ResultFileError, match="has no mesh here: it was saved by an older software"):
        found.displacement("right")


def test_files_of_version_2_are_read(tmp_path: Path) -> None:
    """Two bars end to end with a gap of 0.002, pushed by 0.01; made before points had several facets."""
    found = load(OLD / "contact_2.h5")
    joint = found.interfaces["joint"]
    pressure = E * (0.01 - 0.002) / 40.0
    np.testing.assert_allclose(found.force("joint")[:, 0], -pressure, rtol=1e-6)
    assert found.converged and joint.carrier == 0
    assert found.table().value("pressure_mean", "joint") == pytest.approx(pressure, rel=1e-6)
    # each point has its facet, with all of its area
    areas = joint.areas.toarray()
    assert areas.shape == (2, 2) and areas.sum() == pytest.approx(5.0)
    assert sorted(areas.max(axis=1)) == pytest.approx(sorted(joint.weights))
    facets, fields = io.facet_fields(found, "joint")
    assert len(facets) == 2 and fields["pressure"] == pytest.approx(pressure)
    assert io.write(found, tmp_path / "fields")
    with h5py.File(OLD / "contact_2.h5") as file:
        assert file.attrs["version"] == 2


def test_random_files_of_version_1_are_read() -> None:
    found = load(OLD / "chaos_1.h5")
    assert found.kind == "chaos" and found.chaos is not None
    mean, deviation = found.moments("joint")
    np.testing.assert_allclose(mean, found.force("joint"), rtol=1e-12)
    assert found.table().value("force_x", "joint", statistic="std") == pytest.approx(1.0861, rel=1e-4)
    np.testing.assert_allclose(deviation, found.chaos.std("force:joint"), rtol=1e-12)
    found = load(OLD / "samples_1.h5")
    assert found.table().value("force_x", "joint", statistic="mean") == pytest.approx(-4.0373, rel=1e-4)
    area = found.interfaces["joint"].weights
    total = found.quantity(lambda f: f.force("joint")[..., 0] @ area)
    assert len(total) == 4 and total.mean().value == pytest.approx(-4.0373, rel=1e-4)


@pytest.mark.parametrize("size", [1e-150, 1e160, 1e290])
def test_forces_whose_squares_are_no_numbers(size: float) -> None:
    """Tables have no squares to overflow; what has some says so."""
    scene = Scene()
    for name, x0 in (("left", 0.0), ("right", 1.0)):
        part = geometry.box((1.0, 1.0), (2, 2), origin=(x0, 0.0))
        scene.substructure(name, part, LinearElastic(E=100.0, nu=0.3), degree=2)
    scene.fix("left:x0", name="wall")
    scene.interface("joint", "left:x1", "right:x0", Elastic(normal=50.0, tangential=20.0))
    scene.traction("right:x1", (3.0 * size, 4.0 * size))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = solve(assemble(scene))
        table = result.table()
        for name in ("wall", "joint"):
            assert abs(table.value("shear", name) - 4.0 * size) < 1e-9 * size
        assert abs(table.value("shear_max", "joint") / size) < 50.0
        if size > 1.0:
            with pytest.raises(SceneError, match="the energies of the result leave the range of numbers"):
                discretisation_error(result)
            assert result.errors().discretisation is None


def test_no_text_of_a_csv_file_is_a_formula(tmp_path: Path) -> None:
    texts = ["=cmd|'/C calc'!A0", "+1+cmd", "-2+3", "@SUM(1)", " =1+1", "\uff1d1+1", "\t=1", "a=1", "", "- b"]
    numbers = [-1.5, -2, float("nan"), 3, -0.0, 1e300, -1e-300, 7, -8, 9]
    table = tables.Table({"=name": texts, "value": numbers}, ("=name",))
    table.to_csv(tmp_path / "table.csv")
    with (tmp_path / "table.csv").open(newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    assert head == ["'=name", "value"]
    assert [row[0] for row in rows] == [f"'{each}" if each not in ("a=1", "") else each for each in texts]
    assert [row[1] for row in rows] == ["-1.5", "-2", "", "3", "-0.0", "1e+300", "-1e-300", "7", "-8", "9"]


def rubbing(side: float, times: Any = (1.0, 2.0)) -> Any:
    """Two squares of 1 that are pressed by 1, then pulled sideways, the upper one through a spring of 10."""
    scene = lf.Scene()
    steel = lf.LinearElastic(1e3, 0.0)
    for name, y in (("low", 0.0), ("high", 1.0)):
        scene.substructure(name, lf.geometry.box((1.0, 1.0), (2, 2), origin=(0.0, y)), steel, degree=1)
    scene.fix("low:y0")
    scene.interface("joint", "high:y0", "low:y1", lf.Contact(friction=0.4))
    scene.fix("high:y1", -2e-3, components=1, name="press")
    scene.interface("grip", "high:y1", lf.Elastic(normal=0.0, tangential=10.0))
    scene.traction("high:y1", (lf.Amplitude([1, 2], [0, 1]) * side, 0.0), name="pull")
    return lf.solve(lf.assemble(scene), times=list(times), progress=False)


def test_columns_of_friction_are_those_of_a_block_that_slides() -> None:
    """Its limit is 0.4; at a pull of 0.2 it sticks, at 0.9 it slides until the spring takes 0.5."""
    stuck, slides = (rubbing(side).table() for side in (0.2, 0.9))
    assert stuck.value("slip", "joint") == stuck.value("slip_share", "joint") == 0.0
    limit = -0.4 * stuck.value("normal", "joint")
    assert limit == pytest.approx(0.4, rel=1e-3)
    assert stuck.value("slip_safety", "joint") == pytest.approx(limit / stuck.value("shear", "joint"))
    bends = 0.1 * stuck.value("shear", "grip") / stuck.value("shear", "joint")  # by a shear of 1
    assert slides.value("slip", "joint") == pytest.approx(0.05 - 0.4 * bends, rel=1e-4)
    assert slides.value("slip_share", "joint") == pytest.approx(1.0)
    assert slides.value("slip_safety", "joint") == pytest.approx(1.0)
    assert rubbing(0.2).table("joint", step=0).value("slip_safety", "joint") == np.inf


def test_a_pattern_stands_for_the_interfaces_that_it_fits() -> None:
    result = rubbing(0.2)
    assert list(result.table("j*")["interface"]) == ["joint"]
    assert set(result.table(["?o*", "grip"])["interface"]) == {"joint", "grip"}
    with pytest.raises(lf.SceneError, match="table: unknown interface 'bolt.'.*'grip'"):
        result.table("bolt*")


def test_a_history_beside_each_other() -> None:
    table = rubbing(0.2, (1.0, 1.5, 2.0)).table(["joint", "grip"], step=None)
    shown = table.by_time("shear")
    assert shown.labels == ("time",) and list(shown["time"]) == [1.0, 1.5, 2.0]
    assert shown["joint"][1] == table.value("shear", "joint", time=1.5)
    with pytest.raises(lf.SceneError, match="no history"):
        lf.Table({"interface": ("a",), "normal": (1.0,)}, ("interface",)).by_time("normal")


def test_a_long_table_is_cut_and_says_so() -> None:
    """60 rows, of which the second has no shear: its line has a place in the first block only."""
    table = rubbing(0.2, np.linspace(1.0, 2.0, 60)).table("joint", step=None)
    lines = str(table).splitlines()
    assert sum(line.startswith("...") for line in lines) >= 1
    assert "20 rows of 60 are left out" in str(table)
    assert len(table.to_csv().splitlines()) == 61


def test_the_reaction_of_a_support_that_ends_at_glue() -> None:
    """A block stands on a support that shares an edge with the glue to another one: 3 on it, 1 beside it."""
    scene = lf.Scene()
    steel = lf.LinearElastic(1e3, 0.3)
    for name, x in (("a", 0.0), ("b", 1.0)):
        scene.substructure(name, lf.geometry.box((1.0, 1.0), (2, 2), origin=(x, 0.0)), steel)
    scene.interface("glue", "a:x1", "b:x0", lf.Perfect())
    scene.fix("a:y0", name="stand")
    scene.traction("a:y1", (0.5, -3.0))
    scene.traction("b:y1", (0.0, -1.0))
    table = lf.solve(lf.assemble(scene)).table()
    assert table.value("force_x", "stand") == pytest.approx(-0.5)
    assert table.value("force_y", "stand") == pytest.approx(4.0)
    centre = 0.5  # of the support, about which 3 turn by 0 and 1 by 1, and the shear at the top by 1
    assert table.value("moment_z", "stand") == pytest.approx(1.0 * (1.5 - centre) + 0.5 * 1.0)


def face(points: Any, normals: Any) -> Surface:
    """Points of area 1 with force components n, t1, t2."""
    normals = np.asarray(normals, float)
    along_x = np.abs(normals[:, :1]) > 0.9
    first = np.cross(normals, np.where(along_x, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]]))
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    frames = np.stack([normals, first, np.cross(normals, first)], axis=1)
    ones = np.ones(len(points))
    return Surface("joint", "Contact", np.asarray(points), ones, normals, frames, contact=True)


def test_safety_against_slip_counts_forces_and_moments() -> None:
    """A shaft in a hub under torque and thrust; a square under a force and a moment; the corner of a box."""
    angles = np.repeat(np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False), 5)
    heights = np.tile(np.linspace(0.0, 30.0, 5), 24)
    out = np.column_stack([np.cos(angles), np.sin(angles), 0.0 * angles])
    shaft = face(20.0 * out + heights[:, None] * [0.0, 0.0, 1.0], out)
    around, up = np.cross([0.0, 0.0, 1.0], out), np.array([0.0, 0.0, 1.0])
    limits = np.full((1, 1, 120), 0.2), np.zeros((1, 1, 120))

    def safety(surface: Surface, traction: Any, pressure: float = 50.0) -> float:
        vectors = traction - pressure * surface.normals
        force = np.einsum("pcd,pd->pc", surface.frames, vectors)[None, None]
        few = tuple(each[..., : len(vectors)] for each in limits)
        return float(measure(surface, force, few)["slip_safety"][0, 0])

    assert safety(shaft, 4.0 * around) == pytest.approx(10.0 / 4.0)  # mu p = 10
    assert safety(shaft, 3.0 * around + 4.0 * up) == pytest.approx(10.0 / 5.0)
    assert safety(shaft, 0.0 * out) == np.inf
    x, y = (each.ravel() for each in np.meshgrid(np.arange(-4.5, 5.0), np.arange(-4.5, 5.0)))
    plate = face(np.column_stack([x, y, 0.0 * x]), np.tile([0.0, 0.0, 1.0], (100, 1)))
    turned = 0.1 * np.column_stack([-y, x, 0.0 * x])
    carries, acts = 10.0 * np.hypot(x, y).sum(), 0.1 * (x**2 + y**2).sum()
    assert safety(plate, np.tile([3.0, 4.0, 0.0], (100, 1))) == pytest.approx(2.0)
    assert safety(plate, turned) == pytest.approx(carries / acts)
    both = safety(plate, turned + [3.0, 4.0, 0.0])
    assert both == pytest.approx(1.0 / np.hypot(0.5, acts / carries))
    some = plate.points[np.maximum(np.abs(x), np.abs(y)) < 3.0]  # 36
    corner = np.concatenate([some, some[:, ::-1] + [5.0, 0.0, 0.0], some[:, [0, 2, 1]] + [0.0, 5.0, 0.0]])
    normals = np.repeat([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], 36, axis=0)
    assert np.isnan(safety(face(corner, normals), np.zeros((108, 3))))  # three planes hold each other


def torn(strength: Any, pull: float = 0.0) -> lf.Problem:
    """Two blocks whose bond is opened by an end that moves by 0.05 and back to 0.02, or by a traction."""
    scene = two_blocks(lf.Debonding(normal=1e3, tangential=4e2, strength=strength, energy=0.5))
    if pull:
        scene.traction("right:x1", lf.Amplitude([0.0, 1.0], [0.0, 1.0]) * (pull, 0.0, 0.0))
    else:
        scene.fix("right:x1", lf.Amplitude([0.0, 1.0, 2.0], [0.0, 0.05, 0.02]) * (1.0, 0.3, 0.0), name="end")
    return assemble(scene)


def test_damage_of_a_bond_is_that_of_its_largest_jump() -> None:
    """When it is unloaded it stays."""
    problem = torn(10.0)
    result = solve(problem, times=[0.5, 1.0, 2.0], options=TIGHT, progress=False)
    table = result.table("joint", step=None)
    joint = problem.interfaces["joint"]
    each = [joint.law.damage(joint, jump) for jump in result.jump("joint")]
    expected = np.maximum.accumulate([d.max() for d in each])
    assert table["damage"] == pytest.approx(expected, abs=1e-6) and expected[1] == expected[2] > 0.5
    broken = [np.mean(d > 1e-3) for d in each]
    assert table["damaged_share"][:2] == pytest.approx(broken[:2], abs=1e-9)
    assert np.all(table["broken_share"] == 0.0)


def test_damage_of_samples_is_that_of_their_own_bond() -> None:
    strength = lf.Uniform("s", 8.0, 12.0)
    problem = torn(strength)
    samples = lf.monte_carlo(problem, 5, seed=1, times=[1.0, 2.0], options=TIGHT, progress=False)
    found = samples.quantity("joint.damage").values
    for k, each in enumerate(10.0 + 2.0 * samples.germs[:, 0]):  # uniform on [-1, 1]
        one = solve(torn(float(each)), times=[1.0, 2.0], options=TIGHT, progress=False)
        assert found[k] == pytest.approx(one.table("joint").value("damage", "joint"), abs=1e-5)
    assert "damage" in str(samples.table("joint"))


def test_a_sound_bond_has_no_damage() -> None:
    """Not even rounding: P(damage > 0) is that of what is pulled beyond its strength."""
    strength = lf.Uniform("s", 8.0, 12.0)
    samples = lf.quasi_monte_carlo(torn(strength, pull=9.0), 16, times=[0.5, 1.0], progress=False)
    broken = 10.0 + 2.0 * samples.germs[:, 0] < 9.0
    found = samples.quantity("joint.damage").values
    assert np.array_equal(found > 0.0, broken) and 0 < broken.sum() < 16


def test_a_bond_that_is_torn_off_is_told_to_be_stronger() -> None:
    """No preload and no friction is there to be raised."""
    result = solve(torn(10.0, pull=15.0), times=[0.5, 1.0], progress=False)
    assert result.status == "slides"
    assert result.table("joint").value("broken_share", "joint") == pytest.approx(1.0)
    assert "raise the strength of the bond" in result.ended and "preload" not in result.ended
    assert "preload" not in str(result.table())
