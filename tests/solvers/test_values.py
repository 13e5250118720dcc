"""A result is a value: nothing that is computed after it changes a bit of it, whether it ends, fails or is
interrupted."""

from __future__ import annotations

import copy
import gc
import logging
import os
import pickle
import signal
from collections.abc import Callable, Iterator
from dataclasses import FrozenInstanceError
from typing import Any

import numpy as np
import pytest
from latin_core import SweptParameter

from dolfinx_frontend import (
    Chaos,
    Contact,
    Elastic,
    LinearElastic,
    LogNormal,
    Options,
    Problem,
    Resultant,
    Scene,
    SceneError,
    Uniform,
    assemble,
    discretisation_error,
    errors,
    geometry,
    monte_carlo,
    quasi_monte_carlo,
    solve,
    sweep,
    tensor_quadrature,
)
from dolfinx_frontend.common import interrupts
from dolfinx_frontend.common.interrupts import Interrupt
from dolfinx_frontend.kernel.solver import Solver
from dolfinx_frontend.scene.amplitudes import Amplitude
from dolfinx_frontend.solvers.galerkin import carry_on

pytestmark = pytest.mark.filterwarnings("ignore::dolfinx_frontend.solvers.galerkin.TruncationWarning")

TIMES = [0.5, 1.0, 1.2]
KINDS = ["deterministic", "history", "chaos", "chaos of a history", "chaos of a contact", "samples", "sweep"]


def pressed(law: Any, pull: Any = (-1.0, 0.2), n: int = 2) -> Problem:
    """Two blocks side by side on a bed of springs, joined by a law."""
    scene = Scene()
    for name, x in (("left", 0.0), ("right", 1.0)):
        part = geometry.box((1.0, 1.0), (n, n), origin=(x, 0.0))
        scene.substructure(name, part, LinearElastic(E=100.0, nu=0.3), degree=1)
    scene.interface("layer", "left:x1", "right:x0", law)
    scene.interface("bed", "right:x1", Elastic(normal=1.0, tangential=1.0))
    scene.fix("left:x0", name="wall")
    scene.traction("right:y1", pull, name="pull")
    return assemble(scene)


def springs() -> Elastic:
    return Elastic(normal=LogNormal("k", mean=30.0, cov=0.3), tangential=Uniform("t", lower=5.0, upper=15.0))


def rough_contact() -> Contact:
    return Contact(friction=0.3, gap=Uniform("c", lower=-0.01, upper=0.002))


def built() -> dict[str, Problem]:
    up = Amplitude(lambda t: t)
    return {
        "random": pressed(springs()),
        "contact": pressed(rough_contact()),
        "history": pressed(springs(), up * (-1.0, 0.2)),
    }


@pytest.fixture(scope="module")
def problems() -> dict[str, Problem]:
    return built()


@pytest.fixture(scope="module")
def results(problems: dict[str, Problem]) -> dict[str, Any]:
    return solved(problems)


def solved(problems: dict[str, Problem]) -> dict[str, Any]:
    random, contact, history = problems["random"], problems["contact"], problems["history"]
    return {
        "deterministic": solve(random, active="all"),
        "history": solve(history, times=TIMES, active=["layer"]),
        "chaos": solve(random, chaos=2),
        "chaos of a history": solve(history, chaos=2, times=TIMES),
        "chaos of a contact": solve(contact, chaos=Chaos(2, check_points=4, tolerance=0.5)),
        "samples": monte_carlo(random, 6, keep_states=True),
        "sweep": sweep(random, {"layer.normal": [10.0, 20.0, 40.0]}, keep_states=True),
    }


def arrays(value: Any) -> Any:
    """Arrays, numbers and strings of an answer, to be compared bit by bit."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, dict) or hasattr(value, "items"):
        return {str(k): arrays(v) for k, v in value.items()}
    if isinstance(value, (tuple, list)):
        return [arrays(v) for v in value]
    if hasattr(value, "x"):  # a function of dolfinx
        return arrays(value.x.array.copy())
    return repr(value)


def read(kind: str, result: Any) -> dict[str, Any]:
    """Everything that a result can be asked."""
    block = next(iter(result.blocks(8)))
    found: dict[str, Callable[[], Any]] = {
        "force": lambda: result.force("layer"),
        "jump": lambda: result.jump("layer"),
        "status": lambda: (result.status, np.asarray(result.converged), np.asarray(result.iterations)),
        "error": lambda: np.asarray(result.error),
        "block": lambda: (block.force("layer"), block.displacement("right")),
        "displacements": lambda: result.displacements,
        "functions": lambda: (result.displacement("right"), result.stress("left")),
        "table": lambda: str(result.table(["layer"])),
        "quantity": lambda: result.quantity(lambda f: _first(f.force("layer")), samples=50).values,
    }
    if kind == "sweep":
        found["a point"] = lambda: result.point(1).displacement("right")
    else:
        found["moments"] = lambda: (result.moments("right"), result.moments("layer"))
        found["deviation"] = lambda: result.std("right")
    if kind not in ("sweep", "samples"):
        found["mesh errors"] = lambda: _mesh_errors(result)
    if kind == "history":
        found["work"] = lambda: result.work("layer")
    if kind.startswith("chaos"):
        germs = result.space.sample(3, 5)
        found |= {
            "coefficients": lambda: (result.coefficients("left"), result.force_coefficients("layer")),
            "jumps": lambda: result.jump_coefficients("layer"),
            "samples": lambda: result.at(germs).both("layer"),
            "checks": lambda: (result.trusted, repr(result.checks)),
        }
        if kind != "chaos of a contact":
            found["sobol"] = lambda: repr(result.sobol("layer"))
    return {name: arrays(call()) for name, call in found.items()}


def _first(block: Any) -> Any:
    return block.reshape(len(block), -1)[:, 0]


def _mesh_errors(result: Any) -> str:
    found = discretisation_error(result, "layer")  # with a dual problem
    return repr((found.energy, found.quantity, found.parts, found.shares))


class Boom(Exception):
    pass


@pytest.fixture
def fails(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Let the run of a given number fail after it was made, as if memory were short."""

    def arm(which: int) -> None:
        count = 0
        for name in ("run", "walk"):
            original = getattr(Solver, name)

            def each(self: Solver, *args: Any, original: Any = original, **settings: Any) -> Any:
                nonlocal count
                count += 1
                done = original(self, *args, **settings)
                if count == which:
                    raise Boom
                return done

            monkeypatch.setattr(Solver, name, each)

    return arm


@pytest.fixture
def ctrl_c(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[int], None]]:
    """Send one SIGINT in the first iteration of the run of a given number."""
    monkeypatch.setattr(interrupts, "_last_press", -np.inf)
    original = Interrupt.watch

    def arm(which: int) -> None:
        count = 0

        def watch(self: Interrupt, callback: Any = None) -> Any:
            nonlocal count
            count += 1
            mine, sent = count, False
            inner = original(self, callback)

            def each(iteration: Any) -> None:
                nonlocal sent
                if mine == which and not sent:
                    sent = True
                    os.kill(os.getpid(), signal.SIGINT)
                inner(iteration)

            return each

        monkeypatch.setattr(Interrupt, "watch", watch)

    yield arm


def shaken(problems: dict[str, Problem], results: dict[str, Any]) -> dict[str, Callable[[], Any]]:
    """What may come after a result, on its problem and on its solver."""
    random, contact, history = problems["random"], problems["contact"], problems["history"]
    chaos, curved = results["chaos"], results["chaos of a contact"]
    timed = results["chaos of a history"]
    return {
        "solve": lambda: solve(random, active="all", options=Options(rtol=1e-3)),
        "a history": lambda: solve(history, times=[0.1, 0.9], start=None),
        "another chaos": lambda: solve(random, chaos=1),
        "chaos of a contact": lambda: solve(contact, chaos=Chaos(1, check_points=0)),
        "a sweep": lambda: sweep(random, {"layer.tangential": [1.0, 3.0]}, progress=False),
        "samples": lambda: quasi_monte_carlo(random, 4, progress=False),
        "a quadrature": lambda: tensor_quadrature(random, 2, progress=False),
        "samples of the chaos": lambda: chaos.monte_carlo(3),
        "samples of the contact": lambda: curved.quasi_monte_carlo(4),
        "samples of the history": lambda: timed.monte_carlo(3),
        "truncation": lambda: chaos.truncation("layer", points=2),
        "errors": lambda: [errors(r, "layer") for r in (results["deterministic"], results["history"])],
        "errors of the chaos": lambda: [errors(r, "layer") for r in (chaos, timed)],
        "errors of the contact": lambda: errors(curved, Resultant("layer")),
        "errors in energy": lambda: [errors(r) for r in (results["deterministic"], chaos)],
        "mesh errors": lambda: [
            discretisation_error(r, Resultant("layer", "jump"))
            for r in (results["deterministic"], chaos, curved)
        ],
        "carried on": lambda: [carry_on(r, Chaos(3, check_points=0), 1e-9) for r in (chaos, curved, timed)],
        "accuracy": lambda: solve(random, accuracy=1e-2, quantity="layer"),
    }


NOTHING: Any = dict.fromkeys(["random", "contact", "history", *KINDS])
SHAKES = list(shaken(NOTHING, NOTHING))


@pytest.fixture(scope="module")
def before(results: dict[str, Any]) -> dict[str, Any]:
    return {kind: read(kind, result) for kind, result in results.items()}


def same(results: dict[str, Any], before: dict[str, Any]) -> None:
    for kind, result in results.items():
        now = read(kind, result)
        for name, value in before[kind].items():
            assert now[name] == value, f"{kind}: {name}"


@pytest.mark.parametrize("shake", SHAKES)
def test_nothing_changes_an_earlier_result(
    shake: str, problems: dict[str, Problem], results: dict[str, Any], before: dict[str, Any]
) -> None:
    shaken(problems, results)[shake]()
    same(results, before)


@pytest.mark.parametrize("run", [1, 2])
@pytest.mark.parametrize("shake", SHAKES)
def test_no_exception_changes_an_earlier_result(
    shake: str,
    run: int,
    problems: dict[str, Problem],
    results: dict[str, Any],
    before: dict[str, Any],
    fails: Callable[[int], None],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fails(run)
    try:
        shaken(problems, results)[shake]()
    except Boom:
        pass
    monkeypatch.undo()
    same(results, before)


@pytest.mark.parametrize("run", [1, 2])
@pytest.mark.parametrize("shake", SHAKES)
def test_no_interruption_changes_an_earlier_result(
    shake: str,
    run: int,
    problems: dict[str, Problem],
    results: dict[str, Any],
    before: dict[str, Any],
    ctrl_c: Callable[[int], None],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ctrl_c(run)
    try:
        shaken(problems, results)[shake]()
    except (KeyboardInterrupt, SceneError):
        pass
    monkeypatch.undo()
    same(results, before)


@pytest.mark.parametrize("fail", [False, True])
def test_a_walk_leaves_no_swept_value_behind(fail: bool, results: dict[str, Any]) -> None:
    """The kernel has the values of the last point then; the next call brings its own."""
    chaos = results["chaos"]
    solver, laws, plan = chaos.solver, chaos.mean_laws, chaos.plan
    wanted = solver.run(laws, plan.options, plan.amplitudes, progress=False)[1]
    values = np.array([[1.0, 2.0, 3.0]])
    swept = [SweptParameter("layer", "normal", np.ones((1, 1)), values)]

    def done(point: int, summary: Any) -> None:
        if fail and point == 1:
            raise Boom

    try:
        solver.walk(laws, plan.amplitudes, swept, [0, 1, 2], plan.options, progress=done)
    except Boom:
        assert fail
    again = solver.run(laws, plan.options, plan.amplitudes, progress=False)[1]
    assert np.array_equal(wanted.data, again.data)


# --- an interrupted measurement says so ----------------------------------------------------------
@pytest.mark.parametrize("kind", ["deterministic", "chaos"])
def test_an_interrupted_measurement_says_so(
    kind: str, problems: dict[str, Problem], ctrl_c: Callable[[int], None]
) -> None:
    if kind == "chaos":
        result: Any = solve(problems["random"], chaos=1, options=Options(rtol=1e-2))
    else:
        result = solve(problems["contact"], options=Options(rtol=3e-2, newton=0))
    ctrl_c(1)
    found = result.errors("layer")
    assert np.isnan(found.algebraic.quantity) and np.isnan(found.relative("algebraic"))
    assert not found.total <= 1.0
    assert found.notes and "interrupted" in found.notes[0] and "interrupted" in str(found)
    assert result.found is None


def test_an_interrupted_truncation_says_so(
    problems: dict[str, Problem], ctrl_c: Callable[[int], None]
) -> None:
    result = solve(problems["random"], chaos=1, options=Options(rtol=1e-2))
    whole = result.errors("layer")
    ctrl_c(2)
    found = result.errors("layer")
    assert found.algebraic == whole.algebraic  # that was measured
    assert found.truncation is not None and found.truncation.quantity is not None
    assert np.isnan(found.truncation.quantity) and "interrupted" in found.notes[0]


@pytest.mark.parametrize("run", [1, 2, 3])
@pytest.mark.parametrize("name", ["random", "contact"])
def test_an_interrupted_accuracy_says_so(
    name: str,
    run: int,
    problems: dict[str, Problem],
    ctrl_c: Callable[[int], None],
    caplog: pytest.LogCaptureFixture,
) -> None:
    ctrl_c(run)
    with caplog.at_level(logging.WARNING):
        answer = solve(problems[name], accuracy=1e-6, quantity="layer")
    found = answer.errors()
    assert found is answer.found
    assert any("interrupted" in note for note in found.notes)
    assert np.isnan(found.total) and not found.reached
    assert any("interrupted" in r.getMessage() for r in caplog.records)


def test_an_answer_as_right_as_asked_knows_its_errors(problems: dict[str, Problem]) -> None:
    answer = solve(problems["random"], accuracy=1e-3, quantity="layer")
    assert answer.found is not None and answer.errors() is answer.found and answer.found.reached
    assert answer.errors("energy") is not answer.found


# --- values ------------------------------------------------------------------------------------
@pytest.mark.parametrize("kind", KINDS)
def test_results_cannot_be_written(kind: str, results: dict[str, Any]) -> None:
    result = results[kind]
    with pytest.raises(FrozenInstanceError):
        result.plan = None
    with pytest.raises(FrozenInstanceError):
        result.found = None
    blocks = [result.solver.weights, result.solver.directions]
    if kind in ("samples", "sweep"):
        blocks += [result.force("layer"), result.points.states, result.points.error]
    else:
        blocks += [result.state.data, result.state.traces]
    for block in blocks:
        with pytest.raises(ValueError, match="read-only"):
            block[...] = 0.0


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_written_is_a_copy_or_cannot_be(
    kind: str, results: dict[str, Any], before: dict[str, Any]
) -> None:
    result = results[kind]
    fields = [result.force("layer"), result.jump("layer"), *result.displacements.values()]
    fields += [result.displacement("right").x.array, *next(iter(result.blocks(4))).both("layer")]
    if kind != "sweep":
        fields += [*result.moments("layer"), *result.moments("right")]
    if kind.startswith("chaos"):
        fields += [result.coefficients("right"), result.force_coefficients("layer")]
    for block in fields:
        try:
            block[...] = 7.0
        except ValueError as error:
            assert "read-only" in str(error)
    same({kind: result}, before)


@pytest.mark.parametrize("kind", KINDS)
def test_a_result_says_why_it_cannot_be_pickled(kind: str, results: dict[str, Any]) -> None:
    result = results[kind]
    with pytest.raises(TypeError, match=f"{type(result).__name__} cannot be pickled.*factorised"):
        pickle.dumps(result)
    assert copy.copy(result) is result and copy.deepcopy([result])[0] is result


@pytest.mark.parametrize("kind", KINDS)
def test_a_result_outlives_its_problem(kind: str, before: dict[str, Any]) -> None:
    result = solved(built())[kind]
    gc.collect()
    now = read(kind, result)
    assert now["force"] == before[kind]["force"] and now["jump"] == before[kind]["jump"]


def test_notes_are_no_other_answer(results: dict[str, Any]) -> None:
    result = results["deterministic"]
    fields = result.unknowns("right")
    noted = result.with_notes(seconds={"solve": 1.0})
    assert np.shares_memory(noted.unknowns("right"), fields) and noted.seconds == {"solve": 1.0}
    assert result.seconds != noted.seconds
    with pytest.raises(TypeError, match="state would make it another answer"):
        result.with_notes(state=None)


def test_a_callback_may_use_other_results_of_the_solver(
    results: dict[str, Any], before: dict[str, Any]
) -> None:
    result, other = results["chaos"], results["deterministic"]

    def peek(iteration: Any) -> None:
        same({"chaos": result, "deterministic": other}, before)

    result.solver.run(
        result.mean_laws,
        result.plan.options.with_(max_iterations=2),
        result.plan.amplitudes,
        callback=peek,
        progress=False,
    )


def test_laws_are_a_value(results: dict[str, Any]) -> None:
    laws = results["deterministic"].laws
    before = laws.parameter("layer", "normal").copy()
    stiff = laws.with_(parameters={"layer": {"normal": np.full((1, 1), 7.0)}})
    assert np.all(stiff.parameter("layer", "normal") == 7.0)
    assert np.array_equal(laws.parameter("layer", "normal"), before) and not np.any(before == 7.0)
    solver, plan = results["deterministic"].solver, results["deterministic"].plan
    first = solver.run(laws, plan.options, plan.amplitudes, progress=False)[1]
    other = solver.run(stiff, plan.options, plan.amplitudes, progress=False)[1]
    again = solver.run(laws, plan.options, plan.amplitudes, progress=False)[1]
    assert np.array_equal(first.data, again.data) and not np.array_equal(first.data, other.data)
