"""The plan and its overrides, one solve, and what can be read from its answer."""

from __future__ import annotations

import os
import signal
import threading
from dataclasses import replace
from time import perf_counter, sleep

import numpy as np
import pytest
from dolfinx import fem

from dolfinx_frontend import geometry
from dolfinx_frontend.assembly.assemble import assemble
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common import interrupts as noted
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.plan.plan import Direction, make_plan
from dolfinx_frontend.reference.direct import monolithic
from dolfinx_frontend.reference.energy import energy_error
from dolfinx_frontend.results.result import phase_seconds
from dolfinx_frontend.scene.laws import Contact, Displacement, Elastic, Law, Perfect, Pressure, Symmetry
from dolfinx_frontend.scene.materials import LinearElastic
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.solving import solve, sweep
from latin_core import InputError, NumericalError, Options, available_backends

pytestmark = pytest.mark.sanitize

TIGHT = Options(rtol=1e-10)
# matrix directions solve this scene in four iterations
DIAGONAL = Options(macro="none", directions="diagonal")
ENDLESS = Options(rtol=1e-15, max_iterations=10**8, stagnation_window=10**8, acceleration=0)
"""Together with `FAR` a run that takes minutes."""
FAR = 1e6


def bars(layer: Law | None = None) -> Problem:
    """Three plates in a row (2D): glue, then an elastic layer; the first is held, the last pulled."""
    scene = Scene()
    for k, name in enumerate("abc"):
        part = geometry.box((1.0, 1.0), (2, 2), (float(k), 0.0))
        scene.substructure(name, part, LinearElastic(100.0, 0.3), degree=2)
    scene.interface("glue", "a:x1", "b:x0", Perfect())
    layer = layer or Elastic(normal=30.0, tangential=10.0, jump=0.01)
    scene.interface("layer", "b:x1", "c:x0", layer)
    scene.fix("a:x0", name="wall")
    scene.traction("c:x1", (1.0, 0.2), name="pull")
    return assemble(scene)


@pytest.fixture(scope="module")
def problem() -> Problem:
    return bars()


@pytest.fixture(scope="module")
def reference(problem):
    return monolithic(problem)


@pytest.fixture
def interrupts() -> None:
    """Ctrl-C is Python's again: OpenTURNS, if another test imported it, ends the process on it."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    noted._last_press = -np.inf  # of another test


# ---------------------------------------------------------------------------------------------
# Plan
# ---------------------------------------------------------------------------------------------
def test_plan_decides_what_is_active(problem):
    auto = make_plan(problem)
    assert auto.method == "direct" and auto.active == ()
    assert auto.eliminated == {
        "glue": "nodes glued",
        "layer": "springs assembled",
        "wall": "unknowns removed",
        "pull": "load assembled",
    }
    assert make_plan(problem, "accelerated").active == ("layer",)
    assert make_plan(problem, vary=["layer"]).active == ("layer",)
    assert make_plan(problem, "accelerated", active=["wall", "glue"]).active == ("glue", "wall")
    paper = make_plan(problem, "latin")
    assert paper.active == tuple(problem.interfaces) and paper.eliminated == {}
    assert paper.options.acceleration == 0 and paper.method == "latin"
    assert make_plan(problem, "latin", active=["layer"]).active == ("layer",)
    assert make_plan(problem, active="all").active == tuple(problem.interfaces)
    no_history = make_plan(problem, active="all", options=Options(acceleration=0))
    assert no_history.method == "latin"


def test_plan_tells_its_reasons(problem):
    text = str(make_plan(problem, "accelerated", direction=2.5))
    for word in ("layer", "nodes glued", "elastic, between two parts", "k = 2.5 E/L", "1e-06"):
        assert word in text
    assert text.count("because") == len(make_plan(problem, "accelerated").decisions)


def test_plan_refuses(problem):
    with pytest.raises(SceneError, match=r"unknown interface 'layr'.*did you mean 'layer'"):
        make_plan(problem, active=["layr"])
    with pytest.raises(SceneError, match=r"search direction: unknown interface 'gleu'.*'glue'"):
        make_plan(problem, direction=Direction(given={"gleu": 1.0}))
    with pytest.raises(SceneError, match=r"'direct' cannot be used: layer must stay active"):
        make_plan(problem, "direct", active=["layer"])
    with pytest.raises(SceneError, match=r"method 'newton' is not known: use 'auto', 'direct'"):
        make_plan(problem, "newton")


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf])
def test_directions_are_positive(problem, bad):
    with pytest.raises(SceneError, match=f"direction = {bad:g}; it must be a positive number"):
        make_plan(problem, direction=bad)
    with pytest.raises(SceneError, match=f"length = {bad:g}"):
        Direction(length=bad)
    with pytest.raises(SceneError, match="'layer': given = .*: it must be positive and finite"):
        Direction(given={"layer": bad})


def test_directions_are_what_was_asked_for(problem):
    """One factor, one length, one interface, one value per point."""
    points = problem.interfaces["glue"].num_points
    rising = np.linspace(1.0, 2.0, points)
    direction = Direction(factor=2.0, length=4.0, given={"layer": 7.0, "glue": rising})
    core = solve(problem, active="all", direction=direction, options=DIAGONAL).solver
    modulus = problem.substructures["a"].modulus
    for name, exact in (
        ("wall", 2.0 * modulus / 4.0), ("layer", 7.0), ("glue", np.repeat(rising, 2))
    ):
        rows = core.first_rows(name)
        assert len(rows) == len(problem.interfaces[name].sides)
        for row in rows:
            values = core.directions[row : row + 2 * problem.interfaces[name].num_points]
            assert values == pytest.approx(exact)
    wrong = Direction(given={"layer": np.ones(points + 1)})
    with pytest.raises(SceneError, match=r"'layer', parameter 'search direction'.*wrong shape"):
        solve(problem, active="all", direction=wrong)


# ---------------------------------------------------------------------------------------------
# Answer
# ---------------------------------------------------------------------------------------------
def test_direct_solution_is_the_monolithic_one(problem, reference):
    result = solve(problem)
    assert result.converged and result.iterations == 0
    assert 0.0 < result.error < 1e-11  # rounding of some hundred unknowns
    assert energy_error(problem, result.displacements, reference.u) < 1e-12


@pytest.mark.parametrize("active", [(), ["layer"], "all"])
def test_energy_is_that_of_the_parts(active):
    """u^T K u, whatever is eliminated (springs that are assembled into a body would count in it)."""
    problem = bars(Perfect()) if not active else bars()
    result = solve(problem, active=active, options=TIGHT)
    exact = sum(
        u @ (problem.substructures[name].matrix @ u) for name, u in monolithic(problem).u.items()
    )
    assert result.summary.energy == pytest.approx(exact, rel=1e-8)


def test_springs_that_are_too_long_store_nothing():
    """Two plates with a spring between them that is 0.1 longer than nothing: both are where it is at rest."""
    scene = Scene()
    for k, name in enumerate("ab"):
        part = geometry.box((1.0, 1.0), (2, 2), (float(k), 0.0))
        scene.substructure(name, part, LinearElastic(100.0, 0.3))
    scene.interface("layer", "a:x1", "b:x0", Elastic(normal=30.0, tangential=10.0, jump=0.1))
    scene.fix("a:x0", name="wall")
    result = solve(assemble(scene))
    moved = result.displacements["b"].reshape(-1, 2)
    assert moved == pytest.approx(np.tile([0.1, 0.0], (len(moved), 1)), abs=1e-13)
    assert abs(result.summary.energy) < 1e-12 * 30.0 * 0.1**2


def test_fields_of_active_and_eliminated_interfaces_agree(problem, reference):
    kept = solve(problem, active="all", options=TIGHT)
    for name in ("layer", "pull", "wall"):
        assert name in kept.plan.active
        gone = solve(problem) if name != "wall" else None
        force, jump = kept.force(name), kept.jump(name)
        assert force.shape == jump.shape == (problem.interfaces[name].num_points, 2)
        if gone is not None:
            assert gone.force(name) == pytest.approx(force, rel=1e-7, abs=1e-8)
            assert gone.jump(name) == pytest.approx(jump, rel=1e-7, abs=1e-9)
    assert kept.force("layer") == pytest.approx(reference.forces["layer"], rel=1e-7)
    assert np.abs(kept.jump("glue")).max() < 1e-9
    # the glue and the wall carry the load: action and reaction over the whole section
    for name in ("glue", "layer", "wall"):
        interface = problem.interfaces[name]
        total = interface.weights @ kept.force(name)
        axes = interface.frames[0] if name != "wall" else np.eye(2)
        assert axes.T @ total == pytest.approx([1.0, 0.2] if name != "wall" else [-1.0, -0.2])


def test_force_of_an_eliminated_perfect_interface_is_not_known(problem):
    result = solve(problem)
    for name in ("glue", "wall"):
        with pytest.raises(SceneError, match=rf"'{name}' was eliminated .*active=\['{name}'\]"):
            result.force(name)
    with pytest.raises(SceneError, match=r"unknown interface 'leyer'.*'layer'"):
        result.force("leyer")
    with pytest.raises(SceneError, match=r"unknown substructure 'd'.*'a', 'b', 'c'"):
        result.displacement("d")


def test_frictionless_interfaces_have_normal_components_only():
    scene = Scene()
    for k, name in enumerate("ab"):
        part = geometry.box((1.0, 1.0), (2, 2), (float(k), 0.0))
        scene.substructure(name, part, LinearElastic(100.0, 0.3), degree=1)
    scene.interface("layer", "a:x1", "b:x0", Elastic(normal=30.0))
    scene.symmetry(["a:y0", "b:y0"])
    scene.fix("a:x0", components=0)
    scene.traction("b:x1", (1.0, 0.0))
    result = solve(assemble(scene), active="all", options=TIGHT)
    assert result.force("layer").shape == (4, 1)
    assert result.force("layer") == pytest.approx(1.0)
    assert result.jump("layer") == pytest.approx(1.0 / 30.0)


def test_displacement_is_a_dolfinx_function(problem, reference):
    result = solve(problem, "accelerated", options=TIGHT)
    u = result.displacement("c")
    assert isinstance(u, fem.Function) and u.function_space == problem.substructures["c"].V
    assert u.x.array == pytest.approx(reference.u["c"], rel=1e-8)
    assert "converged" in repr(result) and f"{result.iterations} iterations" in repr(result)


def test_time_is_accounted_for(problem):
    result = solve(problem, "accelerated")
    phases = phase_seconds(result)
    of_bodies, of_newton = {"assemble", "factorise", "condense", "prepare"}, {"flexibility", "newton"}
    assert set(phases) == of_bodies | of_newton | {"global", "local", "check", "callback", "other", "finish"}
    assert all(value >= 0.0 for value in phases.values())
    assert sum(phases.values()) == pytest.approx(sum(result.seconds.values()), rel=0.03)
    assert phases["check"] > 0.0 and result.summary.callback_s > 0.0
    assert result.summary.history[-1].seconds <= result.seconds["solve"]
    assert sum(cost["unknowns"] for cost in result.solver.costs) == result.solver.unknowns


# ---------------------------------------------------------------------------------------------
# Start
# ---------------------------------------------------------------------------------------------
@pytest.mark.parametrize("active", [None, "all"])
def test_starting_from_the_answer_takes_no_time(problem, active):
    first = solve(problem, "accelerated", active=active, options=TIGHT)
    for start in (first, first.state):
        again = solve(problem, plan=first.plan, start=start)
        assert again.converged and again.iterations <= 2
        for name, u in first.displacements.items():
            assert again.displacements[name] == pytest.approx(u, rel=1e-8, abs=1e-10)


def test_start_does_not_change_the_answer(problem, reference):
    """A state of other search directions, whose data mean something else, is a valid start."""
    other = solve(problem, active="all", direction=30.0, options=TIGHT)
    result = solve(problem, active="all", direction=1.0, options=TIGHT, start=other)
    assert result.converged
    assert energy_error(problem, result.displacements, reference.u) < 1e-8


def test_start_of_another_plan(problem):
    other = solve(problem, active="all")
    with pytest.raises(SceneError, match=r"start has a state of shape \(\d+, 1\), this plan has"):
        solve(problem, "accelerated", start=other)


# ---------------------------------------------------------------------------------------------
# End
# ---------------------------------------------------------------------------------------------
def test_statuses(problem):
    # by its indicator: a run that looks at its error is finished by a check on the assembled structure
    options = DIAGONAL.with_(rtol=1e-12, max_iterations=7, criterion="indicator")
    short = solve(problem, active="all", options=options)
    assert short.status == "max_iterations" and short.iterations == 7 and not short.converged
    assert len(short.summary.history) == 7
    # below rounding nothing can be reached: the run says so instead of going on for ever
    options = DIAGONAL.with_(rtol=1e-13, max_iterations=10**6, stagnation_window=50)
    floor = solve(problem, plan=make_plan(problem, active="all", direction=1e-3, options=options))
    assert floor.status in ("undecided", "inexact") and floor.iterations < 10_000
    # without a plan it is tried in other ways, of which the direct solution is as good as asked for
    assert solve(problem, active="all", direction=1e-3, options=options).status == "converged"
    assert solve(problem, active="all", options=TIGHT).status == "converged"


def test_criterion_is_what_is_stopped_on(problem):
    by_error = solve(problem, active="all", options=DIAGONAL.with_(rtol=1e-5))
    assert by_error.error <= 1e-5
    by_indicator = solve(problem, active="all", options=DIAGONAL.with_(rtol=1e-5, criterion="indicator"))
    assert by_indicator.summary.indicator <= 1e-5
    assert by_indicator.iterations != by_error.iterations
    with pytest.raises(ValueError, match="criterion 'residual' is not known: use 'error' or"):
        Options(criterion="residual")


@pytest.mark.parametrize(
    "change, message",
    [
        ({"rtol": 0.0}, r"rtol is 0\.0: it must lie in \(0, 1\)"),
        ({"rtol": 1.5}, r"rtol is 1\.5"),
        ({"rtol": np.nan}, r"rtol is nan"),
        ({"max_iterations": 0}, r"max_iterations is 0: it must be a whole number, at least 1"),
        ({"acceleration": -1}, r"acceleration is -1: it must be a whole number, in 0\.\.100"),
        ({"acceleration": 101}, r"acceleration is 101"),
        ({"relaxation": 0.0}, r"relaxation is 0\.0: it must lie in \(0, 1\]"),
        ({"relaxation": 1.1}, r"relaxation is 1.1"),
        ({"operator": "inverse"}, r"operator 'inverse' is not known: use 'automatic', 'condensed' or"),
        ({"backend": "lu"}, r"use 'automatic', 'cholmod', 'cholmod64', 'mumps' or 'multigrid'"),
    ],
)
def test_options_out_of_range(problem, change, message):
    with pytest.raises(ValueError, match=message):
        solve(problem, "accelerated", options=Options().with_(**change))


def test_callback_sees_every_iteration(problem):
    seen = []
    result = solve(problem, active="all", callback=seen.append)
    # in between are the stages of checks
    numbers = [each.number for each in seen]
    assert numbers == sorted(set(numbers)) and (numbers[0], numbers[-1]) == (1, result.iterations)
    assert [each.error for each in seen] == [each.error for each in result.summary.history]
    # the result adds what rounding of the bodies' factors leaves
    assert seen[-1].error <= result.error <= result.plan.options.rtol
    assert seen[-1].indicator == result.summary.indicator
    assert all(a.seconds <= b.seconds for a, b in zip(seen, seen[1:], strict=False))
    assert seen[-1].residual < 1e-3 * seen[0].residual


def test_exceptions_of_callbacks_end_the_run(problem):
    class Enough(Exception):
        pass

    seen = []

    def stop(iteration):
        seen.append(iteration.number)
        if iteration.number == 3:
            raise Enough("three")

    with pytest.raises(Enough, match="three"):
        solve(problem, active="all", options=TIGHT, callback=stop)
    assert seen == [1, 2, 3]
    assert solve(problem, active="all", options=TIGHT).converged


def test_interrupt_in_a_callback(problem, interrupts):
    seen = []

    def stop(iteration):
        seen.append(iteration.number)
        if iteration.number == 5:
            signal.raise_signal(signal.SIGINT)

    result = solve(problem, active="all", direction=FAR, options=ENDLESS, callback=stop)
    assert seen == [1, 2, 3, 4, 5]
    assert (result.status, result.converged, result.iterations) == ("interrupted", False, 5)
    assert repr(result).startswith("Result(interrupted, 5 iterations")
    # the last iterate, as a run that was given as many iterations and tries nothing else leaves it
    options = ENDLESS.with_(max_iterations=5, criterion="indicator")
    five = solve(problem, active="all", direction=FAR, options=options)
    assert np.array_equal(result.state.data, five.state.data)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_time_that_is_over_ends_a_run_as_ctrl_c_does(problem):
    """The seconds are those of factorisation and iteration: here over before the first iterate is left."""
    late = solve(problem, active="all", direction=FAR, options=ENDLESS, max_seconds=1e-9)
    none = solve(problem, active="all", direction=FAR, options=ENDLESS, callback=_stop)
    assert (late.status, late.converged, late.iterations) == ("time_limit", False, none.iterations)
    assert np.array_equal(late.state.data, none.state.data)
    assert "allow more with max_seconds" in late.ended and late.statuses == ("time_limit",)
    of_options = solve(problem, active="all", direction=FAR, options=ENDLESS.with_(max_seconds=0.0))
    assert of_options.status == "time_limit"
    assert solve(problem, active="all", options=TIGHT, max_seconds=3600.0).converged
    plan = make_plan(problem, active="all", direction=FAR, options=ENDLESS)
    assert solve(problem, plan=plan, max_seconds=1e-9).status == "time_limit"
    with pytest.raises(SceneError, match="max_seconds"):
        solve(problem, max_seconds=0.0)


def _stop(_iteration):
    raise StopIteration


def test_a_callback_asks_for_what_is_done(problem):
    def enough(iteration):
        if iteration.number == 3:
            raise StopIteration

    result = solve(problem, active="all", direction=FAR, options=ENDLESS, callback=enough)
    assert (result.status, result.iterations) == ("interrupted", 3)


def test_a_second_interrupt_raises(problem, interrupts):
    """In the same call, and soon after in the next one: a loop of solves can be ended."""

    def press(iteration):
        if iteration.number == 2:
            signal.raise_signal(signal.SIGINT)

    def twice(iteration):
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)

    settings = {"active": "all", "direction": FAR, "options": ENDLESS}
    with pytest.raises(KeyboardInterrupt):
        solve(problem, callback=twice, **settings)
    noted._last_press = -np.inf
    assert solve(problem, callback=press, **settings).status == "interrupted"
    with pytest.raises(KeyboardInterrupt):
        solve(problem, callback=press, **settings)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_the_default_that_gmsh_leaves_does_not_end_the_process(problem, interrupts):
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # as gmsh.initialize() does
    try:
        result = solve(
            problem,
            callback=lambda i: signal.raise_signal(signal.SIGINT),
            active="all",
            direction=FAR,
            options=ENDLESS,
        )
        assert signal.getsignal(signal.SIGINT) == signal.SIG_DFL
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    assert result.status == "interrupted"


def test_handlers_of_others_are_left_alone(problem, interrupts):
    heard = []
    signal.signal(signal.SIGINT, lambda number, frame: heard.append(number))
    try:
        result = solve(
            problem, active="all", callback=lambda i: signal.raise_signal(signal.SIGINT), options=TIGHT
        )
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    assert result.converged and len(heard) == len(result.summary.history)


@pytest.mark.parametrize("with_callback", [False, True])
def test_interrupt_from_outside(problem, interrupts, with_callback):
    """Ctrl-C while the kernel computes is answered within one iteration, with or without a callback."""
    pressed: list[float] = []
    seen: list[float] = []

    def press():
        sleep(0.2)
        pressed.append(perf_counter())
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=press)
    thread.start()
    callback = (lambda iteration: seen.append(perf_counter())) if with_callback else None
    result = solve(problem, active="all", direction=FAR, options=ENDLESS, callback=callback)
    assert result.status == "interrupted"
    answered = perf_counter()
    thread.join()
    assert answered - pressed[0] < 1.0
    assert sum(time > pressed[0] for time in seen) <= 2


# ---------------------------------------------------------------------------------------------
# Matrices
# ---------------------------------------------------------------------------------------------
def changed(name, change):
    """The bars with another stiffness of one of them."""
    problem = bars()
    part = problem.substructures[name]
    matrix = part.stiffness.copy()
    change(matrix)
    parts = {**problem.substructures, name: replace(part, stiffness=matrix)}
    return replace(problem, substructures=parts)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_not_a_number_in_a_matrix(value):
    def spoil(matrix):
        matrix.setValue(3, 3, value)
        matrix.assemble()

    with pytest.raises(InputError, match="'b' holds a NaN or infinity in row 3"):
        solve(changed("b", spoil), "accelerated")


def test_indefinite_matrix():
    with pytest.raises(NumericalError, match=r"'c'.*not positive definite"):
        solve(changed("c", lambda matrix: matrix.scale(-1.0)), "accelerated")


def test_matrices_that_somebody_has_written_to():
    """Refused by whatever would use them: what was factorised, and what is read later, belong together."""
    problem = bars()
    result = solve(problem, active="all")
    stiffness = problem.substructures["b"].stiffness
    stiffness.mult(*stiffness.createVecs())
    stiffness.getValuesCSR(), stiffness.norm(), stiffness.isSymmetric(1e-9), stiffness.getDiagonal()
    assert solve(problem, active="all").iterations == result.iterations  # reading is no change
    stiffness.scale(2.0)
    told = "substructure 'b': its stiffness was changed after it was assembled: change a copy"
    for use in (
        lambda: solve(problem),
        lambda: solve(problem.with_laws({})),
        lambda: make_plan(problem),
        lambda: result.errors(),
        lambda: problem.substructures["b"].matrix,
        lambda: sweep(problem, {}),
    ):
        with pytest.raises(SceneError, match=told):
            use()
    other = bars()
    name, interface = next((n, i) for n, i in other.interfaces.items() if len(i.sides) == 2)
    side = interface.sides[1]
    side.trace.zeroEntries()
    told = f"interface '{name}': the trace of {side.substructure}:{side.face} was changed after"
    with pytest.raises(SceneError, match=told):
        solve(other)


def test_unlimited_or_no_memory_for_condensation(problem):
    """A limit of one byte leaves the sparse factor; asking for what a backend cannot do is an error."""
    sparse = solve(problem, active="all", options=TIGHT.with_(memory_limit=1.0))
    dense = solve(problem, active="all", options=TIGHT.with_(memory_limit=0.0))
    assert not any(cost["condensed"] for cost in sparse.solver.costs)
    assert all(cost["condensed"] for cost in dense.solver.costs) == ("cholmod" in available_backends())
    for name, u in dense.displacements.items():
        assert sparse.displacements[name] == pytest.approx(u, rel=1e-7, abs=1e-9)
    with pytest.raises(InputError, match="'mumps' does not condense: use operator 'factored'"):
        solve(problem, active="all", options=Options(operator="condensed", backend="mumps"))


@pytest.mark.parametrize("options", [TIGHT, TIGHT.with_(macro="none", directions="diagonal")])
@pytest.mark.parametrize("operator", ["condensed", "factored"])
def test_a_face_that_is_held_entirely_may_be_kept(operator, options):
    """The kept layer touches no unknown of the body of b and c: b's own are all prescribed."""
    scene = Scene()
    for k, name in enumerate("abc"):
        part = geometry.box((1.0, 1.0), (1, 1), (float(k), 0.0), cell="quadrilateral")
        scene.substructure(name, part, LinearElastic(100.0, 0.3), degree=1)
    scene.interface("layer", "a:x1", "b:x0", Elastic(normal=30.0, tangential=10.0))
    scene.interface("glue", "b:x1", "c:x0", Perfect())
    for face in ("b:y0", "b:y1"):
        scene.fix(face, name=face.replace(":", " "))
    scene.traction("a:x0", (-1.0, 0.2), name="pull")
    scene.traction("c:x1", (1.0, 0.2), name="push")
    problem = assemble(scene)
    result = solve(problem, active=["layer"], options=options.with_(operator=operator))
    assert result.converged
    assert energy_error(problem, result.displacements, monolithic(problem).u) < 3.0 * options.rtol


def test_a_part_that_is_held_everywhere_presses_back():
    """Every node of a straight triangle pair is on a support: the neighbour meets a rigid wall."""
    scene = Scene()
    scene.substructure("held", geometry.box((1.0, 1.0), (1, 1), cell="triangle"), LinearElastic(1.0, 0.3), 1)
    pressed = geometry.box((1.0, 1.0), (4, 1), origin=(1.0, 0.0), cell="triangle")
    scene.substructure("pressed", pressed, LinearElastic(1.0, 0.0), 1)
    scene.interface("below", "held:y0", Displacement(0.0))
    scene.interface("above", "held:y1", Displacement((0.0, 0.0)))
    scene.interface("contact", "held:x1", "pressed:x0", Contact())
    scene.interface("guide", "pressed:y0", Symmetry())
    scene.interface("load", "pressed:x1", Pressure(0.1))
    result = solve(assemble(scene), options=Options(rtol=1e-8))
    assert result.converged
    assert {"below", "above"} & set(result.plan.active)
    # without sideways expansion the pressure is everywhere that of the load
    np.testing.assert_allclose(result.force("contact")[:, 0], -0.1, rtol=1e-4)
    assert np.abs(result.displacement("held").x.array).max() < 1e-6


@pytest.mark.parametrize("directions", ["matrix", "diagonal"])
def test_a_start_under_other_loads(directions):
    """Its displacements are those of other loads: its residual, which is next to nothing, says nothing."""
    problem = bars(Elastic(20.0, 10.0))
    options = Options(rtol=1e-12, directions=directions)
    one = solve(problem, active=["glue", "layer"], options=options)
    pulled = problem.with_laws({"pull": Pressure(-3.0)})
    two = solve(pulled, active=one.plan.active, start=one, options=options.with_(rtol=1e-8))
    exact = monolithic(pulled).u
    assert two.converged
    assert energy_error(pulled, two.displacements, exact) < 3e-8
