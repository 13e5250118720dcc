"""Sweeps: every point is a solve of its own, and no finished point is lost or solved again."""

from __future__ import annotations

import io
import shutil
import sqlite3
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

from dolfinx_frontend import geometry
from dolfinx_frontend.assembly.assemble import assemble
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.evaluate.sweep import sweep
from dolfinx_frontend.plan.plan import make_plan
from dolfinx_frontend.reference.direct import Monolithic
from dolfinx_frontend.results.sweep import SweepResult
from dolfinx_frontend.scene.amplitudes import Amplitude
from dolfinx_frontend.scene.laws import Contact, Elastic
from dolfinx_frontend.scene.materials import LinearElastic
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.solving import solve
from latin_core import CheckpointError, InputError, Options, snake_order
from latin_core.checkpoint import _digest

pytestmark = pytest.mark.sanitize

TIGHT = Options(rtol=1e-10)
SOFT, STIFF = 5.0, 200.0
GRID = {"layer.normal": np.geomspace(SOFT, STIFF, 4), "bolt.jump": [-0.02, -0.01, 0.0]}


def plates(
    load: float = 1.0, body_force: tuple[float, float] | None = None, normal: float = 30.0
) -> Problem:
    """Three plates in a row (2D): an elastic layer, then a bolt that is given by its total stiffness."""
    scene = Scene()
    for k, name in enumerate("abc"):
        part = geometry.box((1.0, 2.0), (2, 2), (float(k), 0.0))
        scene.substructure(name, part, LinearElastic(100.0, 0.3), 1, body_force)
    scene.interface("layer", "a:x1", "b:x0", Elastic(normal=normal, tangential=10.0))
    bolt = Elastic(normal=60.0, tangential=60.0, jump=-0.01, total=True)
    scene.interface("bolt", "b:x1", "c:x0", bolt)
    scene.fix("a:x0", name="wall")
    scene.traction("c:x1", (load, 0.2), name="pull")
    return assemble(scene)


@pytest.fixture(scope="module")
def problem() -> Problem:
    return plates()


@pytest.fixture(scope="module")
def whole(problem) -> SweepResult:
    """The grid, swept without interruption."""
    return sweep(problem, GRID, options=TIGHT, progress=False)


def check(problem: Problem, result: SweepResult) -> None:
    """Forces and jumps of every point against monolithic solves, to a hundred times the tolerance."""
    oracle = Monolithic(problem)
    keys = [key.split(", ") for key in result.axes]
    for at in np.ndindex(result.shape):
        values = {
            name: axis[i]
            for names, axis, i in zip(keys, result.axes.values(), at, strict=True)
            for name in names
        }
        exact = oracle.solve(values=values)
        for name in result.plan.active:
            if name not in exact.forces:
                continue
            force = result.force(name)[at]
            assert np.abs(force - exact.forces[name]).max() < 1e-8 * np.abs(force).max()
            w1, w2 = exact.traces[name] if len(exact.traces[name]) == 2 else (*exact.traces[name], 0)
            assert np.abs(result.jump(name)[at] - (w2 - w1)).max() < 1e-8 * np.abs(w1).max()


# ---------------------------------------------------------------------------------------------
# Points
# ---------------------------------------------------------------------------------------------
def test_points_equal_monolithic_solves(problem, whole):
    assert whole.shape == (4, 3) and whole.converged.all()
    assert whole.iterations.shape == whole.error.shape == (4, 3)
    assert whole.plan.active == ("layer", "bolt")
    assert (whole.error <= TIGHT.rtol).all() and (whole.iterations >= 0).all()
    check(problem, whole)
    assert "4 x 3 points, 12 solved, 12 converged" in repr(whole)
    assert set(whole.seconds) == {"setup", "first", "rest"}


def test_order_is_the_snake(problem):
    one_by_one = sweep(problem, GRID, options=TIGHT.with_(together=1), progress=False)
    assert one_by_one.points.order == snake_order([4, 3])
    steps = np.abs(np.diff(np.array(np.unravel_index(one_by_one.points.order, (4, 3))), axis=1)).sum(0)
    assert (steps == 1).all()
    check(problem, one_by_one)


def test_linear_laws_are_solved_from_the_middle(whole):
    assert sorted(whole.points.order) == list(range(12))
    assert whole.points.order[0] in (4, 7)  # the two in the middle of the grid


@pytest.mark.parametrize("values", [np.geomspace(1e-3, 1e8, 6), [0.0, 1e-3, 1e3, 1e6]])
def test_linear_laws_from_loose_to_rigid(problem, values):
    grid = {("layer.normal", "layer.tangential"): values, "bolt.jump": [-0.01, 0.0]}
    result = sweep(problem, grid, options=Options(rtol=1e-9), progress=False)
    for i, value in enumerate(values):
        for j, jump in enumerate(grid["bolt.jump"]):
            changed = {"layer.normal": value, "layer.tangential": value, "bolt.jump": jump}
            if not result.converged[i, j]:
                continue  # a loose part has no answer; what is said to be one is right
            exact = Monolithic(problem).solve(values=changed)  # which loses digits with the contrast
            force = result.force("bolt")[i, j]
            assert np.abs(force - exact.forces["bolt"]).max() < 1e-6 * np.abs(exact.forces["bolt"]).max()
    assert result.converged[1:].all()


def test_later_points_profit_from_earlier_ones(problem):
    options = Options(rtol=1e-6)
    grid = {"layer.normal": np.linspace(20.0, 40.0, 9)}
    warm = sweep(problem, grid, active="all", options=options, progress=False)
    cold = sum(
        solve(plates(normal=k), active="all", options=options).iterations
        for k in grid["layer.normal"][1:]
    )
    rest = warm.points.iterations[warm.points.order[1:]].sum()
    assert rest < 0.6 * cold
    nearest = options.with_(snapshots=1)
    single = sweep(problem, grid, active="all", options=nearest, progress=False)
    assert single.converged.all() and rest <= single.iterations.sum()


@pytest.mark.parametrize("criterion", ["error", "indicator"])
def test_points_are_tried_side_by_side(problem, criterion):
    grid = {"layer.normal": np.linspace(20.0, 40.0, 12), "bolt.jump": np.linspace(-0.02, 0.01, 12)}
    options = Options(rtol=1e-7, criterion=criterion, newton=0)
    alone = sweep(problem, grid, options=options.with_(together=1), progress=False)
    beside = sweep(problem, grid, options=options, progress=False, keep_states=True)
    exact = sweep(problem, grid, options=TIGHT, progress=False)
    assert beside.converged.all() and (criterion == "indicator" or beside.error.max() <= 1e-7)
    assert sorted(beside.points.order) == list(range(144))
    for name in ("layer", "bolt"):
        size = np.abs(exact.force(name)).max()
        for each in (alone, beside):
            assert np.abs(each.force(name) - exact.force(name)).max() < 3e-6 * size
        # the law of a point holds with the values of that point
    force, jump = beside.force("layer"), beside.jump("layer")
    stiffness = grid["layer.normal"][:, None, None]
    assert np.allclose(force[..., 0], stiffness * jump[..., 0], rtol=1e-12)
    if criterion == "error":  # the indicator accepts combinations without any iteration
        assert beside.points.iterations.sum() <= 1.2 * alone.points.iterations.sum()


def test_side_by_side_in_time():
    """Columns of a point are its time steps, and what changes in time is the same for all points."""
    scene = Scene()
    scene.substructure("a", geometry.box((1.0, 1.0), (2, 2)), LinearElastic(100.0, 0.3), 1)
    turn = Amplitude([0.0, 1.0, 3.0], [0.0, 1.0, -1.0])
    scene.interface("ground", "a:y0", Contact(stiffness=500.0, friction=0.4, threshold=0.01))
    scene.interface("drive", "a:y1", Elastic(normal=0.0, tangential=20.0, jump=turn * (0.0, 0.02)))
    scene.traction("a:y1", (0.0, -1.0), name="weight")
    problem = assemble(scene)
    grid = {"ground.friction": np.linspace(0.3, 0.4, 30)}
    times = np.linspace(0.0, 3.0, 7)
    options = Options(rtol=1e-8, max_iterations=2000)
    beside = sweep(problem, grid, times=times, options=options, progress=False)
    alone = sweep(problem, grid, times=times, options=options.with_(together=1), progress=False)
    assert beside.converged.all() and alone.converged.all()
    shape = (30, 7, problem.interfaces["ground"].num_points, 2)
    assert beside.force("ground").shape == shape
    assert np.allclose(beside.force("ground"), alone.force("ground"), atol=1e-6)


def test_tuple_is_one_axis(problem):
    """Normal and tangential stiffness together, and a load along the other axis."""
    grid = {("layer.normal", "layer.tangential"): [10.0, 20.0], "bolt.normal": [30.0, 90.0, 150.0]}
    result = sweep(problem, grid, options=TIGHT, progress=False)
    assert result.shape == (2, 3)
    assert list(result.axes) == ["layer.normal, layer.tangential", "bolt.normal"]
    check(problem, result)


def test_totals_are_swept_as_totals(problem):
    """A total stiffness K stands for K / area at every point."""
    area = problem.interfaces["bolt"].area
    result = sweep(problem, {"bolt.normal": [40.0, 80.0]}, options=TIGHT, progress=False)
    for i, total in enumerate((40.0, 80.0)):
        force, jump = result.force("bolt")[i], result.jump("bolt")[i]
        assert force[:, 0] == pytest.approx(total / area * (jump[:, 0] + 0.01), rel=1e-8)
    check(problem, result)


def test_loads_and_supports_can_be_swept(problem):
    """A prescribed displacement of the wall moves all plates; it stays active for it."""
    result = sweep(problem, {"wall.value": [0.0, 0.5]}, options=TIGHT, progress=False)
    assert result.plan.active == ("wall",)
    assert result.jump("wall")[1] - result.jump("wall")[0] == pytest.approx(-0.5, rel=1e-8)
    force = result.force("wall")
    assert np.abs(force[1] - force[0]).max() < 1e-8 * np.abs(force).max()


def test_zero_stiffness_is_admissible(problem):
    """Springs without stiffness carry nothing; the wall and the other law still hold the plates."""
    result = sweep(problem, {"layer.tangential": [0.0, 10.0]}, options=TIGHT, progress=False)
    assert result.force("layer")[0][:, 1] == pytest.approx(0.0, abs=1e-12)


def test_points_that_do_not_converge_are_told(problem, caplog):
    # by the indicator: points that look at their error are finished by a check on the assembled structure
    options = Options(rtol=1e-12, max_iterations=2, criterion="indicator")
    with caplog.at_level("WARNING"):
        result = sweep(problem, {"layer.normal": [10.0, 20.0]}, options=options, progress=False)
        assert not result.converged.any()
        assert "sweep point 0 ended as max_iterations after 2 iterations" in caplog.text
        caplog.clear()
        sweep(problem, {"layer.normal": np.linspace(10.0, 20.0, 7)}, options=options, progress=False)
    *few, last = [record.getMessage() for record in caplog.records]
    assert len(few) == 3 and last == "and 4 more sweep points that ended as max_iterations"


def test_the_status_is_that_of_the_worst_point(whole):
    """In the order of the kernel's outcomes, whichever point comes first; an unknown one is no success."""
    count = whole.points.status.size
    assert whole.status == "converged" and whole.finished.shape == whole.converged.shape == whole.shape

    def among(*found):
        status = np.array([*found, *["converged"] * (count - len(found))])
        return replace(whole, points=replace(whole.points, status=status)).status

    assert among("max_iterations") == "max_iterations"
    assert among("max_iterations", "slides", "undecided") == "slides"
    assert among("slides", "") == "interrupted"  # a point that was not reached
    with pytest.raises(ValueError, match="not in"):
        among("unknown")


# ---------------------------------------------------------------------------------------------
# Mistakes
# ---------------------------------------------------------------------------------------------
def test_mistakes(problem):
    def refuse(grid, words, **how):
        with pytest.raises(SceneError, match=words):
            sweep(problem, grid, progress=False, **how)

    refuse({}, "grid is empty")
    refuse({"layer.normal": []}, r"layer\.normal: values = \[\]: give a list of finite numbers")
    refuse({"layer.normal": [1.0, np.nan]}, "list of finite numbers")
    refuse({"layer.normal": [[1.0]]}, "list of finite numbers")
    refuse({"layer.norml": [1.0]}, r"unknown parameter 'layer\.norml'; did you mean 'layer\.normal'")
    refuse({"leyer.normal": [1.0]}, r"'leyer\.normal'; did you mean 'layer\.normal'")
    refuse({"normal": [1.0]}, r"unknown parameter 'normal'")
    refuse({"layer.normal": [1.0, -2.0]}, r"'layer\.normal' takes the value -2: .* must be >= 0")
    refuse({"layer.normal": [1.0], ("layer.normal", "bolt.normal"): [2.0]}, "on two axes")
    plan = make_plan(problem, active=["bolt"])
    refuse({"layer.normal": [1.0]}, "eliminates the interface of layer.normal", plan=plan)
    with pytest.raises(SceneError, match="'direct' cannot be used: layer must stay active"):
        sweep(problem, {"layer.normal": [1.0]}, method="direct", progress=False)


def test_unknown_fields(whole):
    with pytest.raises(SceneError, match=r"'wall' was eliminated \(.*\), its force is not an unknown"):
        whole.force("wall")


# ---------------------------------------------------------------------------------------------
# Checkpoint
# ---------------------------------------------------------------------------------------------
class Stop(Exception):
    """Ends a sweep from a callback."""


def interrupted(problem, path, iterations, grid=None):
    """A sweep that is ended after so many iterations."""
    left = iter(range(iterations))

    def callback(_):
        if next(left, None) is None:
            raise Stop

    with pytest.raises(Stop):
        sweep(
            problem,
            grid or GRID,
            options=TIGHT,
            progress=False,
            checkpoint=path,
            callback=callback,
        )


def equal(a: SweepResult, b: SweepResult) -> None:
    """Two runs to the same tolerance."""
    for name in a.plan.active:
        for one, other in ((a.force(name), b.force(name)), (a.jump(name), b.jump(name))):
            assert np.abs(one - other).max() < 1e-8 * np.abs(one).max()


def test_points_that_time_did_not_reach_say_so(problem, whole):
    late = sweep(problem, GRID, options=TIGHT.with_(max_seconds=0.0), progress=False)
    assert not late.complete and late.status == "time_limit" and (late.statuses == "time_limit").all()
    long = sweep(problem, GRID, options=TIGHT.with_(max_seconds=3600.0), progress=False)
    assert long.complete and (long.statuses == whole.statuses).all()


def test_interrupted_sweep_goes_on(problem, whole, tmp_path):
    path = tmp_path / "points"
    interrupted(problem, path, int(whole.iterations.sum() * 0.6))
    resumed = sweep(problem, GRID, options=TIGHT, progress=False, checkpoint=path)
    assert resumed.converged.all()
    assert 0 < len(resumed.points.order) < 12  # some were finished, some were not
    finished = [p for p in whole.points.order if p not in resumed.points.order]
    assert finished == whole.points.order[: len(finished)]
    # points of the first run keep their digits
    for point in finished:
        assert point not in resumed.points.histories
        assert resumed.points.iterations[point] == whole.points.iterations[point]
        at = np.unravel_index(point, (4, 3))
        assert np.array_equal(resumed.force("layer")[at], whole.force("layer")[at])
    # the first new point starts from them
    assert resumed.points.iterations[resumed.points.order[0]] <= whole.points.iterations.max()
    equal(resumed, whole)
    third = sweep(problem, GRID, options=TIGHT, progress=False, checkpoint=path)
    assert third.points.order == []
    assert np.array_equal(third.force("bolt"), resumed.force("bolt"))
    assert np.array_equal(third.iterations, resumed.iterations)


def test_checkpoint_of_another_run_is_left_alone(problem, tmp_path):
    path = tmp_path / "points"
    grid = {"layer.normal": [10.0, 20.0]}
    sweep(problem, grid, options=TIGHT, progress=False, checkpoint=path)
    before = path.read_bytes()
    others = (
        (problem, {"layer.normal": [10.0, 30.0]}, {}),
        (problem, grid, {"options": TIGHT.with_(rtol=1e-6)}),
        (problem, grid, {"options": TIGHT.with_(criterion="indicator")}),
        (problem, grid, {"direction": 7.0}),
        (problem, grid, {"direction": 3.0, "method": "latin", "active": ["layer"]}),
        (problem, grid, {"active": "all"}),
        (plates(load=2.0), grid, {}),
        (plates(body_force=(0.0, -1.0)), grid, {}),
    )
    for other, points, how in others:
        with pytest.raises(CheckpointError, match="belongs to another run"):
            sweep(
                other, points, **({"options": TIGHT} | how), progress=False, checkpoint=path
            )
        assert path.read_bytes() == before


@pytest.mark.parametrize("damage", ["truncated", "text", "scrambled"])
def test_damaged_checkpoint_is_left_alone(problem, tmp_path, damage):
    path = tmp_path / "points"
    grid = {"layer.normal": [10.0, 20.0, 30.0]}
    sweep(problem, grid, options=TIGHT, progress=False, checkpoint=path)
    good = path.read_bytes()
    page = len(good) // 2
    bad = {
        "truncated": good[:page],
        "text": b"not a checkpoint of anything\n",
        "scrambled": good[:4096] + b"\xa5" * 2048 + good[4096 + 2048 :],
    }[damage]
    path.write_bytes(bad)
    with pytest.raises(CheckpointError, match="move it away to start from the beginning"):
        sweep(problem, grid, options=TIGHT, progress=False, checkpoint=path)
    assert path.read_bytes() == bad


def test_damaged_point_is_noticed(problem, tmp_path):
    """Bytes inside of a point's arrays, which the database itself does not check."""
    path = tmp_path / "points"
    grid = {"layer.normal": [10.0, 20.0]}
    sweep(problem, grid, options=TIGHT, progress=False, checkpoint=path)
    good = path.read_bytes()
    at = good.rindex(b"force:layer.npy")  # the directory of the archive
    path.write_bytes(good[:at] + b"force:lxyer.npy" + good[at + 15 :])
    with pytest.raises(CheckpointError, match="damaged"):
        sweep(problem, grid, options=TIGHT, progress=False, checkpoint=path)


def test_database_of_somebody_else_is_left_alone(problem, tmp_path):
    path = tmp_path / "addresses"
    with closing(sqlite3.connect(path)) as other, other:
        other.execute("create table person (name text)")
    before = path.read_bytes()
    with pytest.raises(CheckpointError, match="database of another program"):
        sweep(problem, {"layer.normal": [10.0]}, progress=False, checkpoint=path)
    assert path.read_bytes() == before


def test_empty_file_and_missing_folder(problem, tmp_path):
    grid = {"layer.normal": [10.0]}
    empty = tmp_path / "empty"
    empty.touch()
    result = sweep(problem, grid, options=TIGHT, progress=False, checkpoint=empty)
    assert result.points.order == [0] and empty.stat().st_size > 0
    with pytest.raises(CheckpointError, match="folder .* does not exist: make it first"):
        sweep(problem, grid, progress=False, checkpoint=tmp_path / "no" / "points")


def test_checkpoint_may_be_moved(problem, tmp_path):
    """The name of the file is no part of the run."""
    grid = {"layer.normal": [10.0, 20.0]}
    sweep(problem, grid, options=TIGHT, progress=False, checkpoint=tmp_path / "here")
    shutil.copy(tmp_path / "here", tmp_path / "there")
    again = sweep(problem, grid, options=TIGHT, progress=False, checkpoint=str(tmp_path / "there"))
    assert again.points.order == []


def test_outputs_cannot_change_the_sweep(problem):
    """What a function does to the arrays it is given would be seen by the next one, and by the sweep."""

    def spoil(fields):
        force = fields.force("layer")
        with pytest.raises(ValueError, match="read-only"):
            force *= 0.0
        return force.sum(axis=(1, 2))

    surface = sweep(problem, {"layer.normal": [10.0, 20.0]}, outputs={"spoil": spoil}, progress=False)
    assert np.abs(surface.force("layer")).min() > 0.0


@pytest.mark.parametrize(
    ("function", "said"),
    [
        (lambda: np.ones(1), "cannot be called with one argument .*; give a function of the fields"),
        (lambda fields, other: np.ones(1), "cannot be called with one argument .*'other'"),
        (lambda *, fields: np.ones(1), "cannot be called with one argument"),
        (lambda fields: 1.0, r"returned shape \(\) for 1 sample; return one number or array a sample"),
        (lambda fields: np.ones(2), r"returned shape \(2,\) for 1 sample"),
        (lambda fields: None, "= None: return real numbers"),
        (lambda fields: np.array([1j]), "return real numbers"),
        (lambda fields: 1 / 0, "the function raised ZeroDivisionError"),
    ],
)
def test_outputs_that_do_not_fit_are_named(problem, function, said):
    with pytest.raises(SceneError, match=f"(?s)sweep: outputs.*total.*{said}"):
        sweep(problem, {"layer.normal": [10.0]}, outputs={"total": function}, progress=False)


def test_outputs_have_one_shape(problem):
    lengths = iter((1, 2))

    def growing(fields):
        return np.ones((1, next(lengths)))

    with pytest.raises(InputError, match=r"outputs: 'total' has shape .2,. at point .*return one shape"):
        sweep(problem, {"layer.normal": [10.0, 20.0]}, outputs={"total": growing}, progress=False)


def test_callbacks_are_called_with_an_iteration(problem):
    for wrong in (lambda: None, lambda one, other: None):
        with pytest.raises(SceneError, match="callback = .* with one argument .*of an Iteration"):
            sweep(problem, {"layer.normal": [10.0]}, callback=wrong, progress=False)


def edited(path, number, change):
    """A point of a checkpoint changed, its checksum made anew."""
    with closing(sqlite3.connect(path)) as file, file:
        (blob,) = file.execute("select arrays from point where number = ?", (number,)).fetchone()
        with np.load(io.BytesIO(blob[32:])) as stored:
            arrays = dict(stored)
        change(arrays)
        buffer = io.BytesIO()
        np.savez(buffer, **arrays)
        body = buffer.getvalue()
        (run,) = file.execute("select text from header").fetchone()
        seal = _digest(number, body, run)
        file.execute("update point set arrays = ? where number = ?", (seal + body, number))


@pytest.mark.parametrize(
    "name", ["iterations", "status", "column", "part", "force:layer", "data:layer:0", "output:total"]
)
@pytest.mark.parametrize("how", ["removed", "renamed", "another kind", "another shape"])
def test_edited_points_are_refused(problem, tmp_path, name, how):
    """A seal that is right does not tell that all is there."""
    path = tmp_path / "points"
    run = {"options": TIGHT, "progress": False, "checkpoint": path}
    run |= {"outputs": {"total": lambda fields: fields.force("layer").sum(axis=(1, 2))}}
    grid = {"layer.normal": [10.0, 20.0]}
    sweep(problem, grid, **run)

    def change(arrays):
        before = arrays.pop(name)
        if how == "renamed":
            arrays[f"{name}_"] = before
        elif how == "another kind":
            arrays[name] = np.asarray(3.0 if name in ("status", "part") else "x")
        elif how == "another shape":
            arrays[name] = np.stack([before, before])

    edited(path, 1, change)
    left = path.read_bytes()
    with pytest.raises(CheckpointError, match=f"points was edited: point 1: '{name}' .*move it away"):
        sweep(problem, grid, **run)
    assert path.read_bytes() == left


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_converged_point_is_finite(problem, tmp_path, value):
    path = tmp_path / "points"
    run = {"options": TIGHT, "progress": False, "checkpoint": path}
    sweep(problem, {"layer.normal": [10.0, 20.0]}, **run)
    edited(path, 1, lambda arrays: arrays["data:layer:0"].fill(value))
    with pytest.raises(CheckpointError, match="points was edited: point 1: it is converged, and its"):
        sweep(problem, {"layer.normal": [10.0, 20.0]}, **run)
