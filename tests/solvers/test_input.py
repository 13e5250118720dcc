"""Whatever a solver is given beside a scene: it is refused with its name, its value and what would do."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import dolfinx_frontend as lf
from latin_core import InputError, Options
from tests.helpers import NO_NUMBERS, NO_WHOLE_NUMBERS, NOT_FINITE, refused

COUNTS = {**NO_WHOLE_NUMBERS, "0": 0, "-3": -3, "4": 4.0}
QUIET: dict[str, Any] = {"progress": False}


def blocks() -> lf.Scene:
    """Two squares, one on the other."""
    scene = lf.Scene()
    for i in (0, 1):
        part = lf.geometry.box((1.0, 1.0), (1, 1), origin=(0.0, float(i)))
        scene.substructure(f"p{i}", part, lf.LinearElastic(1.0, 0.3), degree=1)
    scene.fix("p0:y0", name="foot")
    scene.pressure("p1:y1", 1.0, "top")
    return scene


@pytest.fixture(scope="module")
def problem() -> lf.Problem:
    """Its layer is elastic, with a fixed stiffness."""
    scene = blocks()
    scene.interface("layer", "p0:y1", "p1:y0", lf.Elastic(normal=5.0, tangential=5.0))
    return lf.assemble(scene)


@pytest.fixture(scope="module")
def random() -> lf.Problem:
    """Its layer has a random stiffness."""
    scene = blocks()
    scene.interface("layer", "p0:y1", "p1:y0", lf.Elastic(lf.LogNormal("k", 5.0, cov=0.1), 5.0))
    return lf.assemble(scene)


@pytest.fixture(scope="module")
def moving() -> lf.Problem:
    """Its pressure changes in time."""
    scene = blocks()
    scene.interface("layer", "p0:y1", "p1:y0", lf.Elastic(normal=5.0, tangential=5.0))
    scene.pressure("p1:y1", lf.Amplitude([0.0, 1.0], [0.0, 1.0]) * 1.0, "push")
    return lf.assemble(scene)


# ---------------------------------------------------------------------------------------------
# Options
# ---------------------------------------------------------------------------------------------
OPTIONS: dict[str, dict[str, Any]] = {
    "rtol": {**NO_NUMBERS, **NOT_FINITE, "0.0": 0.0, "-1": -1, "1.0": 1.0, "1e-06": "1e-06"},
    "relaxation": {**NO_NUMBERS, **NOT_FINITE, "0": 0, "1.5": 1.5},
    "memory_limit": {**NO_NUMBERS, "nan": np.nan, "-1": -1},
    "max_iterations": COUNTS,
    "stagnation_window": COUNTS,
    "snapshots": COUNTS,
    "together": COUNTS,
    "acceleration": {**NO_WHOLE_NUMBERS, "-1": -1, "101": 101},
    "newton": {"'yes'": "yes", "None": None, "2.5": 2.5, "-1": -1},
    "scatter": {"'no'": "no", "1": 1, "None": None},
    **{w: {"'x'": "x", "None": None, "['a']": ["a"]} for w in ("criterion", "macro", "directions")},
    **{word: {"'x'": "x", "None": None, "3": 3} for word in ("operator", "precision", "backend")},
}


@pytest.mark.parametrize("name", OPTIONS)
def test_settings_of_the_iteration(name: str) -> None:
    for wrong in OPTIONS[name].values():
        shown = repr(wrong)
        refused(lambda wrong=wrong: Options(**{name: wrong}), name, shown, error=InputError)
        refused(lambda wrong=wrong: Options().with_(**{name: wrong}), name, shown, error=InputError)


def test_settings_that_are_right() -> None:
    assert Options(newton=False).newton == 0 and Options(newton=np.int64(2)).newton == 2
    assert Options(memory_limit=math.inf, rtol=np.float32(0.5), relaxation=1).relaxation == 1
    refused(lambda: Options().with_(rtoll=1.0), "'rtoll'", "rtol", error=InputError)


# ---------------------------------------------------------------------------------------------
# Problems, plans and their settings
# ---------------------------------------------------------------------------------------------
CALLS: dict[str, Callable[..., Any]] = {
    "make_plan": lambda p, **settings: lf.make_plan(p, **settings),
    "solve": lambda p, **settings: lf.solve(p, **QUIET, **settings),
    "chaos": lambda p, **settings: lf.solve(p, chaos=1, **QUIET, **settings),
    "accuracy": lambda p, **settings: lf.solve(p, accuracy=0.1, meshes=False, **QUIET, **settings),
    "sweep": lambda p, **settings: lf.sweep(p, {"layer.tangential": [1.0]}, **QUIET, **settings),
    "sample": lambda p, **settings: lf.sample(p, [[0.0]], **QUIET, **settings),
    "monte_carlo": lambda p, **settings: lf.monte_carlo(p, 1, **QUIET, **settings),
    "quasi_monte_carlo": lambda p, **settings: lf.quasi_monte_carlo(p, 1, **QUIET, **settings),
    "tensor_quadrature": lambda p, **settings: lf.tensor_quadrature(p, 1, **QUIET, **settings),
    "sparse_quadrature": lambda p, **settings: lf.sparse_quadrature(p, 0, **QUIET, **settings),
}
RUNS = [name for name in CALLS if name != "make_plan"]


@pytest.mark.parametrize("call", CALLS)
def test_what_is_no_problem(call: str) -> None:
    if call != "accuracy":  # which makes the meshes of a scene
        refused(lambda: CALLS[call](blocks()), "problem = Scene", "assemble the scene first")
    if call == "solve":
        refused(lambda: lf.solve(blocks(), quantity="layer"), "solve(scene, accuracy=1e-2, quantity=...)")
        refused(lambda: lf.solve(blocks(), accuracy=1e-2, meshes="no"), "meshes = 'no'")
    for wrong in (3, None, "problem", {}):
        refused(lambda wrong=wrong: CALLS[call](wrong), f"problem = {wrong!r}", "assemble")


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize(
    "name, values",
    {
        "options": ({"rtol": 1e-3}, 1e-3, "plain", True),
        "direction": ("x", np.nan, 0.0, -1.0, True, 1j, [1.0], {}),
        "active": (3, "layer", [3], {"layer": 1}.values(), True),
        "times": ("abc", 3.0, [], [1.0, "b"], [0.0, np.nan], [None], [1.0, 1.0], [[0.0]], [True], [1j]),
        "method": (3, None, ["auto"], "magic"),
    }.items(),
)
def test_settings_of_a_plan(call: str, name: str, values: Any, random: lf.Problem) -> None:
    for wrong in values:
        text = refused(lambda wrong=wrong: CALLS[call](random, **{name: wrong}))
        assert name in text or (name == "times" and "times increase" in text), text


@pytest.mark.parametrize("call", RUNS)
def test_settings_of_a_run(call: str, random: lf.Problem, moving: lf.Problem) -> None:
    for wrong in (3, "f", True):
        refused(lambda wrong=wrong: CALLS[call](random, callback=wrong), f"callback = {wrong!r}")
    if call == "accuracy":
        return
    for wrong in (3, "plan", True):
        refused(lambda wrong=wrong: CALLS[call](random, plan=wrong), f"plan = {wrong!r}", "make_plan")
    other = lf.make_plan(moving, times=[1.0])
    refused(lambda: CALLS[call](random, plan=other), "the plan is of another problem", "'push'")
    own = lf.make_plan(random, vary=["layer"]) if "layer" in random.interfaces else lf.make_plan(random)
    wrong_ones = {"method": "latin", "options": lf.Options(), "direction": 3.0, "active": "all"}
    for name, value in wrong_ones.items():
        refused(lambda name=name, value=value: CALLS[call](random, plan=own, **{name: value}), name, "plan=")


def test_settings_of_samplings(random: lf.Problem, tmp_path: Any) -> None:
    for call in ("sweep", "sample", "monte_carlo"):
        refused(
            lambda call=call: CALLS[call](random, keep_states="yes"), "keep_states = 'yes'", "True or False"
        )
        for wrong in (3, True, "", ["a"]):
            refused(lambda call=call, wrong=wrong: CALLS[call](random, checkpoint=wrong), "checkpoint = ")
    refused(lambda: lf.sample(random, [[0.0]], progress="no"), "progress = 'no'")


# ---------------------------------------------------------------------------------------------
# Numbers of samples, points and levels
# ---------------------------------------------------------------------------------------------
@pytest.mark.parametrize("shown, wrong", COUNTS.items())
def test_counts(shown: str, wrong: Any, random: lf.Problem) -> None:
    refused(lambda: lf.monte_carlo(random, wrong), f"samples = {shown}", "whole number >= 1")
    refused(lambda: lf.quasi_monte_carlo(random, wrong), f"samples = {shown}", "whole number >= 1")
    if wrong != [1]:  # one number per germ
        refused(lambda: lf.tensor_quadrature(random, wrong), f"points = {shown}", "whole number >= 1")
    if wrong != 0:
        refused(lambda: lf.sparse_quadrature(random, wrong), f"level = {shown}", "whole number >= 0")
        if wrong is not None:
            refused(lambda: lf.solve(random, chaos=wrong), "order = ", "whole number >= 0")


def test_points_and_seeds(random: lf.Problem) -> None:
    refused(lambda: lf.quasi_monte_carlo(random, 3), "3 Sobol points", "power of two")
    for wrong in ("a", -1, 1.5, [1]):
        refused(lambda wrong=wrong: lf.monte_carlo(random, 1, wrong), "seed = ")
        refused(lambda wrong=wrong: lf.quasi_monte_carlo(random, 1, wrong), "seed = ")
    for wrong in ("abc", [["a"]], [[None]], [[np.nan]], [[1j]], None, 1j, [[True]]):
        refused(lambda wrong=wrong: lf.sample(random, wrong), "germs = ")
    refused(lambda: lf.sample(random, [[0.0, 1.0]]), "1 germs")
    refused(lambda: lf.sample(random, np.zeros((0, 1))), "germs = []")
    for weights in ("a", ["a"], [np.nan], [1.0, 2.0], [None], 1j):
        refused(lambda weights=weights: lf.sample(random, [[0.0]], weights, "quadrature"), "weights")
    refused(lambda: lf.sample(random, [[0.0]], [1.0]), "kind = 'random' with weights")
    refused(lambda: lf.sample(random, [[0.0]], kind="quadrature"), "kind = 'quadrature' without weights")
    for kind in (3, None, ["qmc"], "sobol"):
        refused(lambda kind=kind: lf.sample(random, [[0.0]], kind=kind), "kind", repr(kind))
    refused(lambda: lf.monte_carlo(random, 1, times=[0.0, "b"]), "times = ")


def test_nothing_is_random(problem: lf.Problem) -> None:
    for call in (
        "sample", "monte_carlo", "quasi_monte_carlo", "tensor_quadrature", "sparse_quadrature", "chaos",
    ):
        refused(lambda call=call: CALLS[call](problem), "nothing is random")


# ---------------------------------------------------------------------------------------------
# Sweeps, starts, accuracy
# ---------------------------------------------------------------------------------------------
def test_grids(problem: lf.Problem) -> None:
    for wrong in ([1.0, 2.0], "layer.normal", 3, None, {"layer.normal"}):
        refused(lambda wrong=wrong: lf.sweep(problem, wrong), "grid = ", "'interface.parameter'")
    for wrong in ("a", ["a"], [1.0, None], [np.nan], [1j], 3.0, None, [[1.0]], [True], []):
        grid: Any = {"layer.normal": wrong}
        refused(lambda grid=grid: lf.sweep(problem, grid), "sweep over layer.normal", "values = ")
    for key in (3, None, ("layer.normal", 3)):
        refused(lambda key=key: lf.sweep(problem, {key: [1.0]}), "axis = ")
    refused(lambda: lf.sweep(problem, {}), "the grid is empty")
    refused(lambda: lf.sweep(problem, {"layer.normall": [1.0]}), "'layer.normall'", "'layer.normal'")
    grid = {"layer.normal": [1.0]}
    for outputs in (3, [len], "a", {"a": 3}, {3: len}, {"": len}):
        refused(lambda outputs=outputs: lf.sweep(problem, grid, outputs=outputs), "outputs")
    for returned in ([None], "abc", ["1.0"], [1j], np.array([1j]), np.array(["a"]), [[1.0], None], None):
        refused(
            lambda returned=returned: lf.sweep(problem, grid, outputs={"mine": lambda _: returned}),
            "sweep: outputs: mine(fields) = ", "return real numbers"
        )
    found = lf.sweep(problem, grid, outputs={"mine": lambda _: np.array([True])}, **QUIET)
    assert np.array_equal(found.output("mine"), np.ones(len(grid["layer.normal"])))
    refused(lambda: lf.sweep(problem, grid, keep_fields=3), "keep_fields = 3")  # type: ignore[arg-type]


def test_starts(problem: lf.Problem, random: lf.Problem) -> None:
    options = Options(rtol=1e-3)
    once = lf.solve(problem, active=["layer"], options=options, **QUIET)
    swept = lf.sweep(problem, {"layer.normal": [1.0, 2.0]}, options=options, **QUIET)
    chaos = lf.solve(random, chaos=2, options=options, **QUIET)
    for wrong in (3, "start", [None], {}, swept, problem):
        for p, more in ((problem, {}), (random, {"chaos": 2})):
            refused(lambda p=p, more=more, wrong=wrong: lf.solve(p, start=wrong, **more), "start = ")
    refused(lambda: lf.solve(problem, active=["layer"], start=chaos, **QUIET), "start has a state of shape")
    refused(lambda: lf.solve(random, chaos=2, start=once, **QUIET), "start has a state of shape")
    refused(lambda: lf.solve(problem, start=once, **QUIET), "start has a state of shape")
    assert lf.solve(problem, active=["layer"], options=options, start=once, **QUIET).converged
    assert lf.solve(random, chaos=2, options=options, start=chaos, **QUIET).converged


def test_accuracy(problem: lf.Problem, random: lf.Problem) -> None:
    for shown, wrong in {**NO_NUMBERS, **NOT_FINITE, "0": 0, "1": 1.0, "-0.1": -0.1}.items():
        if wrong is not None:
            shown = "[1]" if shown == "[1.0]" else shown
            refused(
                lambda wrong=wrong: lf.solve(problem, accuracy=wrong), f"accuracy = {shown}", "1e-10..0.5"
            )
    for wrong in (3, ["layer"], 1.0, True):
        refused(lambda wrong=wrong: lf.solve(problem, accuracy=0.1, quantity=wrong), "quantity = ")
    refused(lambda: lf.solve(problem, accuracy=0.1, quantity="layr"), "'layr'", "'layer'")
    refused(lambda: lf.solve(problem, accuracy=0.1, quantity="layr.normal"), "'layr'", "'layer'")
    refused(lambda: lf.solve(problem, accuracy=0.1, quantity="layer.pressur"), "'pressur'", "pressure_max")
    refused(lambda: lf.solve(problem, accuracy=0.1, meshes="no"), "meshes = 'no'")  # type: ignore
    refused(lambda: lf.solve(problem, accuracy="a", chaos=2), "accuracy = 'a'", "chaos")  # type: ignore
    for wrong in (3, None, "x", ["prove"]):
        refused(lambda wrong=wrong: lf.solve(random, chaos=1, indefinite=wrong), f"indefinite = {wrong!r}")
        refused(lambda wrong=wrong: lf.solve(problem, indefinite=wrong), f"indefinite = {wrong!r}")
        refused(lambda wrong=wrong: lf.solve(problem, meshes=wrong), f"meshes = {wrong!r}")


def test_resultants_and_directions() -> None:
    for wrong in (0, 1.5, None, [1], ""):
        refused(lambda wrong=wrong: lf.Resultant(wrong), f"name = {wrong!r}")
    for wrong in (3, None, ["force"], "stress"):
        refused(lambda wrong=wrong: lf.Resultant("j", wrong), f"of={wrong!r}")
    for wrong in (3, "a", None, 1.0, True, -1, [0]):
        refused(lambda wrong=wrong: lf.Resultant("j", component=wrong), f"component {wrong!r}")
    for shown, wrong in {**NO_NUMBERS, **NOT_FINITE, "0": 0, "-1": -1}.items():
        if wrong is None:
            continue
        shown = "[1]" if shown == "[1.0]" else shown
        refused(lambda wrong=wrong: lf.Direction(factor=wrong), f"factor = {shown}")
        refused(lambda wrong=wrong: lf.Direction(length=wrong), f"length = {shown}")
    for wrong in ("a", None, [np.nan], True, -1.0, [1j]):
        refused(lambda wrong=wrong: lf.Direction(given={"layer": wrong}), "'layer'")
    refused(lambda: lf.Direction(given=[1.0]), "given = [1]")  # type: ignore[arg-type]


def test_directions_out_of_reach(problem: lf.Problem) -> None:
    """They left nothing of the answer, and the estimate of its error did not see it."""
    for far in (1e30, 1.1e6, 0.9e-6, 1e-30):
        refused(lambda far=far: lf.Direction(factor=far), f"factor = {far:g}", "1 to 10 E/L")
        refused(lambda far=far: lf.solve(problem, direction=far), f"search direction: direction = {far:g}")
    for far in (1e30, 1e-30):
        given = lf.Direction(given={"layer": far})
        refused(lambda given=given: lf.solve(problem, active="all", direction=given), "interface 'layer'")
        length = lf.Direction(length=far)
        refused(lambda length=length: lf.solve(problem, active="all", direction=length), f"length = {far:g}")


def test_errors_of_what_has_none(problem: lf.Problem) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        swept = lf.sweep(problem, {"layer.normal": [1.0]}, **QUIET)
    for wrong in (3, None, problem, swept):
        refused(lambda wrong=wrong: lf.errors(wrong), "errors: result = ")
    once = lf.solve(problem, **QUIET)
    for wrong in (3, ["layer"], True):
        refused(lambda wrong=wrong: lf.errors(once, wrong), "quantity = ")
        refused(lambda wrong=wrong: lf.discretisation_error(once, wrong), "quantity = ")
    for wrong in (3, None, problem):
        refused(lambda wrong=wrong: lf.discretisation_error(wrong), "result = ")
    for wrong in ("a", 0.5, None, True):
        refused(lambda wrong=wrong: lf.discretisation_error(once, step=wrong), "step = ")
