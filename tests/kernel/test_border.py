"""The border of the kernel: what cannot be used is refused and named, what can gives the right answer."""

from __future__ import annotations

import copy
import pickle
import threading
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

import latin_core
from latin_core import (
    Body,
    InputError,
    NumericalError,
    Options,
    Side,
    Spring,
    State,
    Structure,
    SweptParameter,
    python_law,
)
from latin_core._core import Laws
from tests.kernel.bars import (
    FORCE,
    NODES,
    STIFFNESS,
    at,
    chain,
    elastic,
    end,
    exact,
    interface,
    member,
    petsc,
    side,
    stiffness,
)

pytestmark = pytest.mark.sanitize

TIGHT = Options(rtol=1e-10)
BACKENDS = latin_core.available_backends().split(", ")


@pytest.fixture(scope="module")
def structure() -> Structure:
    return chain()


@pytest.fixture(scope="module")
def laws(structure: Structure) -> Laws:
    return elastic(structure)


@pytest.fixture(scope="module")
def state(structure: Structure, laws: Laws) -> State:
    return structure.solve(laws, options=TIGHT)[1]


def refuses(call: Callable[[], object], *words: str, error: Any = (InputError, TypeError)) -> None:
    """The call raises, and says all of the words."""
    with pytest.raises(error) as caught:
        call()
    for word in words:
        assert word in str(caught.value), f"{caught.value!s}\nlacks {word}"


# ---------------------------------------------------------------------------------------------
# The right answer
# ---------------------------------------------------------------------------------------------
def test_a_chain_in_a_few_lines(structure: Structure) -> None:
    laws = structure.laws(parameters={"joint": {"normal": STIFFNESS, "jump": 0.1}})
    summary, state = structure.solve(laws)
    assert summary.status == "converged"
    assert end(structure, laws, state) == pytest.approx(exact() + 0.1, rel=1e-6)
    force, jump = structure.local_fields(laws, "joint", state)
    assert force == pytest.approx(np.array([[2.0]]), rel=1e-6) and force.shape == jump.shape == (1, 1)
    assert structure.interfaces == ["wall", "joint"]
    assert laws.interfaces == {"wall": "perfect", "joint": "elastic"}
    assert structure.rows == structure.total_rows == 3 and structure.first_rows("joint") == [1, 2]
    assert structure.flexibility("joint") == pytest.approx([2.0 / 1.3])
    assert latin_core.__version__


def test_laws_are_values(structure: Structure, laws: Laws) -> None:
    soft = laws.with_(parameters={"joint": {"normal": 1.0}})
    assert laws.parameter("joint", "normal") == STIFFNESS and soft.parameter("joint", "normal") == 1.0
    for each, k in ((soft, 1.0), (laws, STIFFNESS), (soft, 1.0)):
        _, state = structure.solve(each, options=TIGHT)
        assert end(structure, each, state) == pytest.approx(exact(k), rel=1e-8)
    handed = laws.parameter("joint", "normal")
    handed[:] = 7.0
    assert laws.parameter("joint", "normal") == STIFFNESS
    steps = laws.with_(steps=4)
    assert (laws.steps, steps.steps) == (1, 4)
    assert copy.copy(laws).parameter("joint", "normal") == STIFFNESS


def test_extra_loads_belong_to_laws(structure: Structure, laws: Laws) -> None:
    more = np.zeros((NODES, 1))
    more[-1] = 1.0
    pulled = laws.with_(extra_loads={"bar1": more})
    more[:] = 0.0
    for each, force in ((pulled, 3.0), (laws, 2.0), (pulled.with_(extra_loads={}), 2.0)):
        summary, state = structure.solve(each, options=TIGHT)
        assert end(structure, each, state) == pytest.approx(exact(force=force), rel=1e-8)
        # energy: both bars under the force
        assert summary.energy == pytest.approx(2.0 * force**2, rel=1e-8)


@pytest.mark.parametrize(
    "given",
    [
        np.array([[3]]),
        np.array([3], dtype=np.int8),
        np.float32(3.0),
        3,
        [[3.0]],
        np.array([[3.0]], order="C"),
        np.array([[3.0]], dtype=">f8"),
        np.asfortranarray(np.full((1, 1), 3.0)),
        np.full((4, 4), 3.0)[::4, ::4],
    ],
)
def test_numbers_of_any_make(structure: Structure, given: Any) -> None:
    laws = structure.laws(parameters={"joint": {"normal": given}})
    assert laws.parameter("joint", "normal") == 3.0


def test_blocks_of_any_order(structure: Structure, laws: Laws) -> None:
    data = np.arange(6.0).reshape(3, 2)
    one = np.ones((1, 2))
    traces = structure.global_stage(laws, data, one)
    strided = np.repeat(data, 2, axis=1)[:, ::2]
    for same in (np.asfortranarray(data), data.astype(int), strided, data.tolist()):
        assert np.array_equal(structure.global_stage(laws, same, one), traces)
        assert structure.local_stage(laws, same, traces).shape == (3, 2)


def test_parameters_reach_transformed_columns(structure: Structure, laws: Laws) -> None:
    group: dict[str, Any] = {"begin": 0, "end": 1, "forward": [np.eye(1)], "backward": [np.eye(1)]}
    transformed = laws.with_(columns={"joint": [group]})
    soft = transformed.with_(parameters={"joint": {"normal": 1.0}})
    _, state = structure.solve(soft, options=TIGHT)
    assert end(structure, soft, state) == pytest.approx(exact(1.0), rel=1e-8)
    given = laws.with_(columns={"joint": [group | {"parameters": {"normal": 2.0}}]})
    _, state = structure.solve(given, options=TIGHT)
    assert end(structure, given, state) == pytest.approx(exact(2.0), rel=1e-8)
    alone = structure.laws(columns={"joint": [group | {"parameters": {"normal": 2.0}}]})
    assert alone.parameter("joint", "normal") == 2.0  # the tangents start from it
    refuses(
        lambda: given.with_(parameters={"joint": {"normal": 1.0}}),
        "interface 'joint': parameter 'normal' is given by the transforms of its columns",
    )
    again = given.with_(columns={"joint": [group]}, parameters={"joint": {"normal": 1.0}})
    _, state = structure.solve(again, options=TIGHT)
    assert end(structure, again, state) == pytest.approx(exact(1.0), rel=1e-8)


def test_a_start_that_is_none(structure: Structure, laws: Laws) -> None:
    """Zeros satisfy the laws, not equilibrium: a state is not believed to be one."""
    for start in (np.zeros((3, 1)), np.ones((3, 1))):
        summary, state = structure.solve(laws, options=TIGHT, start=[State(start, start)])
        assert summary.status == "converged"
        assert end(structure, laws, state) == pytest.approx(exact(), rel=1e-8)


# ---------------------------------------------------------------------------------------------
# Arrays
# ---------------------------------------------------------------------------------------------
WRONG = [
    np.ones((1, 1), dtype=complex),
    np.array([[object()]]),
    np.array([["1.0"]]),
    None,
    "text",
    object(),
    np.ma.masked_array([[1.0]], mask=[[True]]),
    np.array([["2000-01-01"]], dtype="M8[D]"),
]


@pytest.mark.parametrize("wrong", WRONG, ids=lambda value: f"{type(value).__name__}")
def test_what_is_no_array_of_numbers(structure: Structure, laws: Laws, wrong: Any) -> None:
    one = np.ones((3, 1))
    refuses(lambda: structure.laws(parameters={"joint": {"normal": wrong}}), "['joint']['normal']")
    refuses(lambda: structure.local_stage(laws, wrong, one), "data")
    refuses(lambda: structure.local_stage(laws, one, wrong), "traces")
    refuses(lambda: structure.global_stage(laws, wrong), "data")
    refuses(lambda: structure.resolve_samples(laws, "joint", wrong), "free_jump")
    refuses(lambda: State(wrong, one), "data")
    refuses(lambda: member(0, load=wrong), "load")
    refuses(lambda: interface("joint", "elastic", side(0, 0), weights=wrong), "weights")
    if wrong is not None:
        refuses(lambda: structure.solve(laws, amplitudes=wrong), "amplitudes")
        refuses(lambda: side(0, 0, direction=wrong), "direction")


def test_shapes(structure: Structure, laws: Laws, state: State) -> None:
    one, big = np.ones((1, 1)), np.ones((3, 4000))
    tall = State(np.zeros((4, 1)), np.zeros((4, 1)))
    refuses(lambda: structure.local_stage(laws, one, one), "data: shape (3, any) is wanted, got (1, 1)")
    refuses(lambda: structure.local_stage(laws, big, big[:, :1]), "traces: shape (3, 4000)")
    refuses(lambda: structure.local_stage(laws, np.ones((3, 1, 1)), big), "(3, 1, 1)")
    refuses(lambda: structure.global_stage(laws, big, np.ones((1, 5))), "data: shape (3, 5)")
    refuses(lambda: structure.global_stage(laws, big, np.ones((41, 4000))), "amplitudes: shape (1, any)")
    refuses(lambda: structure.displacements(laws, tall), "(4, 1)", "(3, 1)")
    refuses(lambda: structure.displacements(laws, state, np.ones((1, 3))), "(3, 1)", "(3, 3)")
    refuses(lambda: structure.local_fields(laws, "joint", tall), "(4, 1)", "(3, any)")
    refuses(lambda: State(big, big[:, :1]), "traces: shape (3, 4000)")
    refuses(lambda: structure.resolve_samples(laws, "joint", np.ones((2, 1))), "'joint'", "2 rows")
    refuses(lambda: structure.solve(laws, amplitudes=np.ones((2, 1))), "amplitudes")
    refuses(lambda: structure.solve(laws, amplitudes=np.ones((1, 0))), "at least one column")
    refuses(lambda: structure.solve(laws, amplitudes=[[np.nan]]), "amplitudes: finite")
    for what in ("local_fields", "resolve_samples", "first_rows", "flexibility"):
        given = {"local_fields": (laws, "roof", state), "resolve_samples": (laws, "roof", one)}
        refuses(
            lambda what=what, given=given: getattr(structure, what)(*given.get(what, ("roof",))),
            "no active interface 'roof'; active: wall, joint",
        )


def test_starts(structure: Structure, laws: Laws, state: State) -> None:
    for wrong in ([None], [state, 3], [np.zeros((3, 1))]):
        refuses(lambda wrong=wrong: structure.solve(laws, start=wrong), "start[", "a State is wanted")
    for wrong in (state, None, 3, "state", {0: state}):
        refuses(lambda wrong=wrong: structure.solve(laws, start=wrong), "start")
    refuses(
        lambda: structure.solve(laws, start=[State(np.zeros((2, 1)), np.zeros((2, 1)))]),
        "start[0]: a start state has shape (2, 1), this problem needs (3, 1)",
    )
    assert structure.solve(laws, start=(s for s in [state]))[0].status == "converged"
    lost = State(np.full((3, 1), np.nan), np.full((3, 1), np.nan))
    assert structure.solve(laws, start=[lost])[0].status == "undecided"


# ---------------------------------------------------------------------------------------------
# Laws
# ---------------------------------------------------------------------------------------------
def test_parameters(structure: Structure, laws: Laws) -> None:
    for wrong, words in (
        ({"jiont": {"normal": 1.0}}, "no active interface 'jiont'"),
        ({"joint": {"norml": 1.0}}, "interface 'joint': law 'elastic' has no parameter 'norml'"),
        ({"joint": {"normal": -1.0}}, "interface 'joint': parameter 'normal' of law 'elastic' is -1"),
        ({"joint": {"normal": np.nan}}, "NaN"),
        ({"joint": {"normal": np.ones((2, 1))}}, "'normal' has 2 rows, expected 1"),
        ({"joint": {"normal": np.ones((1, 0))}}, "is empty"),
        ({"joint": 3.0}, "parameters['joint']: a mapping is wanted"),
        ({3: {}}, "a text is wanted"),
        ([("joint", 1)], "parameters: a mapping is wanted, got list"),
    ):
        refuses(lambda wrong=wrong: structure.laws(parameters=wrong), words)
        refuses(lambda wrong=wrong: laws.with_(parameters=wrong), words)
    three = laws.with_(parameters={"joint": {"normal": np.ones((1, 3))}})
    refuses(lambda: structure.solve(three), "interface 'joint': parameter 'normal' has 3 columns")
    refuses(lambda: laws.parameter("joint", "norml"), "norml")
    refuses(lambda: laws.parameter("roof", "normal"), "roof")


@pytest.mark.parametrize("steps", [0, -1, 2.0, "1", None, 10**30, [1]])
def test_steps(structure: Structure, steps: Any) -> None:
    if steps is None:
        assert structure.laws(steps=None).steps == 1
    else:
        refuses(lambda: structure.laws(steps=steps), "step")


def test_steps_must_fit_columns(structure: Structure, laws: Laws, state: State) -> None:
    three = laws.with_(steps=3)
    one = np.ones((3, 1))
    for call in (
        lambda: structure.solve(three),
        lambda: structure.local_stage(three, one, one),
        lambda: structure.local_fields(three, "joint", state),
        lambda: structure.resolve_samples(three, "joint", [[1.0]]),
    ):
        refuses(call, "1 columns are no whole number of histories of 3 time steps")


def test_columns(structure: Structure, laws: Laws) -> None:
    eye = np.eye(2)
    good: dict[str, Any] = {"begin": 0, "end": 1, "forward": [eye], "backward": [eye], "parameters": {}}
    for change, words in (
        ({"begin": 1}, "groups must cover"),
        ({"end": 2}, "groups must cover"),
        ({"end": 0}, "groups must cover"),
        ({"backward": []}, "one 'backward' for each 'forward'"),
        ({"forward": [eye, eye], "backward": [eye, eye]}, "2 matrices for 1 points"),
        ({"forward": [np.ones((2, 3))]}, "forward is (c, q)"),
        ({"forward": [eye * np.nan]}, "finite"),
        ({"forward": eye[0, 0]}, "forward"),
        ({"begin": 0.5}, "an integer is wanted"),
        ({"parameters": {"norml": 1.0}}, "norml"),
        ({"colour": 1}, "unknown key 'colour'"),
    ):
        wrong = [good | change]
        refuses(lambda wrong=wrong: laws.with_(columns={"joint": wrong}), words, "joint")
    refuses(lambda: laws.with_(columns={"joint": [{}]}), "'begin', 'end'")
    refuses(lambda: laws.with_(columns={"joint": good}), "columns['joint']: a sequence is wanted")
    refuses(lambda: laws.with_(columns={"roof": [good]}), "roof")
    transformed = laws.with_(columns={"joint": [good]})
    refuses(
        lambda: structure.solve(transformed, amplitudes=np.ones((1, 3))),
        "interface 'joint': column transforms of 2 modes do not fit 3",
    )
    tall = laws.with_(columns={"joint": [good | {"parameters": {"normal": np.ones((7, 1))}}]})
    refuses(lambda: structure.solve(tall, amplitudes=np.ones((1, 2))), "interface 'joint'", "7 rows")


def test_extra_loads(laws: Laws) -> None:
    for wrong, words in (
        ({"rod": np.ones((NODES, 1))}, "'rod' is not on this rank"),
        ({"bar1": np.ones((3, 1))}, "3 x 1, expected 5 x 1"),
        ({"bar1": np.ones((NODES, 2))}, "extra_loads['bar1']: shape (any, 1)"),
        ({"bar1": np.full((NODES, 1), np.inf)}, "'bar1' is not finite"),
        ([1.0], "extra_loads: a mapping"),
    ):
        refuses(lambda wrong=wrong: laws.with_(extra_loads=wrong), words)


def test_laws_of_another_structure(structure: Structure, state: State) -> None:
    other = elastic(chain())
    one = np.ones((3, 1))
    for call in (
        lambda: structure.solve(other),
        lambda: structure.global_stage(other, one),
        lambda: structure.local_stage(other, one, one),
        lambda: structure.local_fields(other, "joint", state),
        lambda: structure.displacements(other, state),
        lambda: structure.resolve_samples(other, "joint", [[1.0]]),
        lambda: structure.sweep(other, parameters=[], order=[0]),
    ):
        refuses(call, "laws: they belong to another structure")
    refuses(lambda: structure.solve(None))


def test_laws_keep_their_structure_alive() -> None:
    laws = elastic(chain())
    soft = laws.with_(parameters={"joint": {"normal": 1.0}})
    assert soft.parameter("joint", "normal") == 1.0


# ---------------------------------------------------------------------------------------------
# Options and callbacks
# ---------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    "change, words",
    [
        ({"rtol": 0.0}, "rtol is 0"),
        ({"rtol": np.nan}, "rtol is nan"),
        ({"rtol": 1.0}, "rtol is 1"),
        ({"rtol": "small"}, "options.rtol: a number is wanted"),
        ({"max_iterations": 0}, "max_iterations is 0"),
        ({"max_iterations": 2.5}, "options.max_iterations: an integer is wanted"),
        ({"acceleration": -1}, "acceleration is -1"),
        ({"relaxation": 2.0}, "relaxation is 2"),
        ({"snapshots": 0}, "snapshots is 0"),
        ({"newton": -1}, "newton is -1"),
        ({"newton": "yes"}, "options.newton: an integer is wanted"),
        ({"together": 0}, "together is 0"),
        ({"stagnation_window": 0}, "stagnation_window is 0"),
        ({"scatter": "no"}, "options.scatter: True or False is wanted"),
        ({"precision": "half"}, "options.precision is 'half'"),
    ],
)
def test_options(structure: Structure, laws: Laws, change: dict[str, Any], words: str) -> None:
    """Whatever has the attributes of options is looked at by the kernel again."""
    settings = SimpleNamespace(**{**vars(Options()), **change})
    refuses(lambda: structure.solve(laws, options=settings), words)


def test_what_is_no_options(structure: Structure, laws: Laws) -> None:
    for wrong in ({"rtol": 1e-3}, 1e-3, "plain"):
        refuses(lambda wrong=wrong: structure.solve(laws, options=wrong), "a latin_core.Options is wanted")


def test_callbacks(structure: Structure, laws: Laws) -> None:
    refuses(lambda: structure.solve(laws, callback=3), "callback: a function or None is wanted")
    seen: list[int] = []
    structure.solve(laws, callback=lambda i: seen.append(i.number))
    assert seen == sorted(seen) and len(seen) > 2

    def stop(iteration: Any) -> None:
        if iteration.number == 2:
            raise StopIteration

    assert structure.solve(laws, options=TIGHT, callback=stop)[0].status == "interrupted"

    def fail(iteration: Any) -> None:
        raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        structure.solve(laws, callback=fail)


# ---------------------------------------------------------------------------------------------
# Sweeps
# ---------------------------------------------------------------------------------------------
VALUES = np.linspace(1.0, 5.0, 40)[None, :]
SWEPT = SweptParameter("joint", "normal", np.ones((1, 1)), VALUES)


def swept(structure: Structure, laws: Laws, **how: Any) -> latin_core.SweepPoints:
    """A sweep of the joint's stiffness."""
    given: dict[str, Any] = {"parameters": [SWEPT], "order": range(40), "interfaces": ["joint"]}
    given.update(how)
    points: latin_core.SweepPoints = latin_core.sweep(structure, laws, np.ones((1, 1)), **given)
    return points


def test_sweep_with_and_without_transforms(structure: Structure, laws: Laws) -> None:
    group = {"begin": 0, "end": 1, "forward": [np.eye(1)], "backward": [np.eye(1)], "parameters": {}}
    for options in (Options(rtol=1e-9), Options(rtol=1e-9, together=1)):
        for each in (laws, laws.with_(columns={"joint": [group]})):
            points = swept(structure, each, options=options)
            assert set(points.status) == {"converged"}
            # a force of 2 goes through the joint whatever its stiffness
            assert points.jumps["joint"][:, 0, 0] == pytest.approx(2.0 / VALUES[0], rel=1e-7)
    given = laws.with_(columns={"joint": [group | {"parameters": {"normal": 2.0}}]})
    refuses(lambda: swept(structure, given), "'joint': parameter 'normal' is given by the transforms")


def test_a_beginning_is_that_of_its_laws_and_structure() -> None:
    kept = latin_core.Beginning()
    for nodes, soft in ((NODES, 1.0), (12 * NODES, 1.0), (2 * NODES, 0.5)):
        # what was kept is that of a structure which is gone, smaller or larger
        bodies = [
            Body(name=f"bar{part}", size=nodes, members=[long_member(part, nodes, soft)]) for part in (0, 1)
        ]
        faces = [(0, 0), (0, nodes - 1), (1, 0)]
        given = [{"member": f"bar{part}", "trace": at(node, nodes)} for part, node in faces]
        wall, left, right = (Side(**each, direction=[1.3], scale=1.0) for each in given)
        interfaces = [interface("wall", "perfect", wall), interface("joint", "elastic", left, right)]
        structure = Structure(bodies=bodies, interfaces=interfaces)
        for normal in (3.0, 1e-4):
            laws = structure.laws(parameters={"joint": {"normal": normal}})
            points = swept(structure, laws, options=Options(rtol=1e-9, together=8), beginning=kept)
            assert set(points.status) == {"converged"}
            assert points.jumps["joint"][:, 0, 0] == pytest.approx(FORCE / VALUES[0], rel=1e-7)
        del structure, laws


def long_member(part: int, nodes: int, soft: float) -> Any:
    load = np.zeros((nodes, 1))
    load[-1] = FORCE * part
    return member(part, stiffness=petsc(soft * stiffness(nodes)), load=load)


def test_sweep_positions(structure: Structure, laws: Laws, state: State) -> None:
    for order in ([0, -1], [40], [0, 10**9], [0.5], [None], ["0"]):
        refuses(lambda order=order: swept(structure, laws, order=order))
        words = "is none of 40 points" if isinstance(order[-1], int) else "order[0]: an integer is wanted"
        refuses(lambda order=order: structure.sweep(laws, parameters=[SWEPT], order=order), words)
    small = State(np.zeros((2, 1)), np.zeros((2, 1)))
    for start in ({-1: state}, {10**8: state}, {0: small}, {0: None}):
        refuses(lambda start=start: swept(structure, laws, start=start))
    for known, points, words in (
        ([state], [99], "99"),
        ([state], [], "1 states for 0 points"),
        ([None], [0], "known[0]"),
        ([small], [0], "a known state of shape (2, 1), expected (3, 1)"),
    ):
        given: dict[str, Any] = {"parameters": [SWEPT], "order": [0], "known": known, "known_points": points}
        refuses(lambda given=given: structure.sweep(laws, **given), words)


def test_swept_parameters(structure: Structure, laws: Laws) -> None:
    one = np.ones((1, 1))
    for wrong, words in (
        (("roof", "normal", one, VALUES), "roof"),
        (("joint", "norml", one, VALUES), "norml"),
        (("joint", "normal", np.ones((1, 2)), VALUES), "pattern of 2 columns"),
        (("joint", "normal", np.ones((3, 1)), VALUES), "3 rows"),
        (("joint", "normal", one, VALUES, 0), "pattern of 1 rows for 0 columns"),
        (("joint", "normal", one, -VALUES), "'normal' of law 'elastic' is -"),
        (("joint", "normal", one, VALUES * np.nan), "finite"),
    ):
        refuses(lambda wrong=wrong: swept(structure, laws, parameters=[SweptParameter(*wrong)]), words)
    refuses(lambda: SweptParameter("joint", "normal", one, VALUES[0]), "values has shape (40,)")
    wanted = "parameters[0]: a latin_core.SweptParameter"
    refuses(lambda: structure.sweep(laws, parameters=[3], order=[0]), wanted)
    refuses(lambda: structure.sweep(laws, parameters=SWEPT, order=[0]), "parameters: a sequence is wanted")


@pytest.mark.parametrize("where", ["progress", "callback", "outputs"])
def test_stop_iteration_ends_a_sweep_with_what_is_finished(
    structure: Structure, laws: Laws, where: str
) -> None:
    calls: list[int] = []

    def stop(*_: Any) -> float:
        calls.append(1)
        if len(calls) == 12:
            raise StopIteration
        return 0.0

    how: dict[str, Any] = {"outputs": {"mine": stop}} if where == "outputs" else {where: stop}
    points = swept(structure, laws, **how)
    reached = points.status == "converged"
    assert 0 < reached.sum() < 40 and list(np.flatnonzero(reached)) == sorted(points.order)


def test_point_callback_gets_the_laws_of_the_point(structure: Structure, laws: Laws) -> None:
    seen = {}

    def finished(point: int, of_point: Laws, summary: Any, state: State) -> None:
        seen[point] = of_point.parameter("joint", "normal")[0, 0], end(structure, of_point, state)

    structure.sweep(laws, parameters=[SWEPT], order=[3, 1], point_callback=finished)
    assert {p: v[0] for p, v in seen.items()} == {3: VALUES[0, 3], 1: VALUES[0, 1]}
    assert laws.parameter("joint", "normal") == STIFFNESS
    wrong: Any = {"parameters": [SWEPT], "order": [0], "point_callback": 1}
    refuses(lambda: structure.sweep(laws, **wrong), "point_callback: a function")


# ---------------------------------------------------------------------------------------------
# Bodies
# ---------------------------------------------------------------------------------------------
def body(**changes: Any) -> Structure:
    """One bar, held by a spring."""
    spring = {
        "name": "hold",
        "members": [0],
        "traces": [at(0)],
        "frames": [[1.0]],
        "stiffness": [1.0],
        "jump": [[0.0]],
    }
    given = {"members": [member(0)], "size": NODES}
    for key, value in changes.items():
        (spring if key in spring else given)[key] = value
    return Structure(bodies=[Body(name="bar0", springs=[Spring(**spring)], **given)])


def test_a_body_alone() -> None:
    structure = body()
    laws = structure.laws()
    summary, state = structure.solve(laws)
    assert summary.status == "converged" and structure.rows == 0
    assert structure.displacements(laws, state)["bar0"][-1, 0] == pytest.approx(4.0)


@pytest.mark.parametrize(
    "change, words",
    [
        ({"members": [7]}, "spring 'hold': member 7 of a body of 1"),
        ({"members": [-1]}, "spring 'hold': member -1"),
        ({"members": []}, "0 members and 1 traces"),
        ({"traces": [at(0), at(1)]}, "1 members and 2 traces"),
        ({"traces": [petsc(np.ones((1, 9)))]}, "spring 'hold': a trace 1 x 9, expected 1 x 5"),
        ({"stiffness": [1.0, 2.0]}, "spring 'hold'"),
        ({"stiffness": [np.inf]}, "finite"),
        ({"jump": [[0.0, 0.0]]}, "spring 'hold': jump 1 x 2"),
        ({"frames": np.ones((1, 0))}, "hold"),
        ({"size": -1}, "-1"),
        ({"size": 4}, "do not fit a body of 4 unknowns"),
        ({"size": 5.0}, "body 'bar0': size: an integer is wanted"),
        ({"size": 10**9}, "do not fit"),
    ],
)
def test_springs_and_sizes(change: dict[str, Any], words: str) -> None:
    refuses(lambda: body(**change), words)


def test_members() -> None:
    crooked = stiffness()
    crooked[0, 1] = -3.0
    for change, words in (
        ({"stiffness": petsc(crooked)}, "substructure 'bar0': its stiffness is not symmetric (row 0"),
        ({"stiffness": petsc(np.ones((2, 3)))}, "do not fit"),
        ({"load": np.full((NODES, 1), np.nan)}, "load: finite"),
        ({"load": np.ones((NODES, 2)), "offset": np.ones((NODES, 1))}, "do not fit"),
        ({"prolongation": sp.csr_matrix(np.ones((NODES, 7)))}, "do not fit"),
        ({"prolongation": np.eye(NODES)}, "prolongation"),
        ({"stiffness": stiffness()}, "petsc4py.PETSc.Mat"),
    ):
        refuses(
            lambda change=change: Structure(
                bodies=[Body(name="bar0", size=NODES, members=[member(0, **change)])]
            ),
            words,
        )
    broken = sp.csr_matrix(np.eye(NODES))
    broken.indices = np.full_like(broken.indices, 99)
    refuses(lambda: member(0, prolongation=broken), "no CSR matrix")
    refuses(lambda: Body(name="b", size=NODES, members=[None]), "members[0]: a Member is wanted")
    refuses(lambda: Structure(bodies=[None]), "bodies[0]: a Body is wanted")
    refuses(lambda: Structure(bodies=3), "bodies: a sequence is wanted")


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("nodes", [3, 40, 41])
def test_a_bar_that_nothing_holds(backend: str, nodes: int) -> None:
    for factor in (1.0, np.pi, 0.1, 1e5 / 3.0):
        load = np.zeros((nodes, 1))
        load[0] = 1.0
        free = member(0, stiffness=petsc(factor * stiffness(nodes)), load=load)
        refuses(
            lambda free=free: Structure(
                bodies=[Body(name="bar0", size=nodes, members=[free])], backend=backend
            ),
            "'bar0' is not positive definite",
            "can move rigidly",
            error=NumericalError,
        )


def test_interfaces() -> None:
    bodies = [Body(name="bar0", size=NODES, members=[member(0)])]

    def build(*sides: Any, law: Any = "perfect", **changes: Any) -> Structure:
        return Structure(bodies=bodies, interfaces=[interface("wall", law, *sides, **changes)])

    for call, words in (
        (lambda: build(), "0 sides"),
        (lambda: build(side(0, 0), side(0, 1), side(0, 2)), "3 sides"),
        (lambda: build(side(0, 0, trace=petsc(np.ones((1, 9))))), "a trace 1 x 9, expected 1 x 5"),
        (lambda: build(side(0, 0, trace=petsc(np.ones((2, NODES))))), "wall"),
        (lambda: build(side(0, 0), frames=[[np.nan]]), "frames: finite"),
        (lambda: build(side(0, 0), frames=np.ones((1, 0))), "wall"),
        (lambda: build(side(0, 0), frames=[[0.0]]), "no unit vectors"),
        (lambda: build(side(0, 0), frames=[[2.0]]), "no unit vectors"),
        (lambda: build(side(0, 0), weights=[]), "weights"),
        (lambda: build(side(0, 0), weights=[1.0, 1.0]), "1 frame rows for 2 points"),
        (lambda: build(side(0, 0), basis=np.ones((3, 1))), "a coarse basis of 3 rows"),
        (lambda: build(side(0, 0), law="glue"), "'glue'"),
        (lambda: build(side(0, 0), law=None), "law"),
        (lambda: build(None), "sides[0]: a Side is wanted"),
        (lambda: build(side(1, 0)), "unknown substructure 'bar1'"),
        (lambda: build(side(0, 0, scale=np.inf)), "scale"),
        (lambda: build(side(0, 0, direction=[0.0])), "positive and finite"),
    ):
        refuses(call, words)
    twice = [interface("wall", "perfect", side(0, 0))] * 2
    refuses(lambda: Structure(bodies=bodies, interfaces=twice), "two of this name")
    refuses(lambda: Structure(bodies=bodies * 2), "'bar0' is in two bodies")


def test_settings_of_a_structure() -> None:
    refuses(lambda: chain(operator="dense"), "operator 'dense': use 'automatic'")
    refuses(lambda: chain(backend="pardiso"), "backend 'pardiso'")
    refuses(lambda: chain(memory_limit=-1.0), "memory_limit is -1")
    refuses(lambda: chain(memory_limit="8 GB"), "memory_limit: a number is wanted")
    limit = latin_core._core.default_options()["memory_limit"]
    assert f"memory_limit: object = {limit}" in (Structure.__init__.__doc__ or "")
    refuses(lambda: chain(comm="world"), "comm: an integer is wanted")
    refuses(lambda: chain(comm=10**6), "is no communicator")
    from mpi4py import MPI

    assert chain(comm=MPI.COMM_SELF).rows == chain(comm=MPI.COMM_SELF.py2f()).rows == 3
    empty = Structure(bodies=[])
    assert empty.solve(empty.laws())[0].status == "converged"


# ---------------------------------------------------------------------------------------------
# Laws of a user
# ---------------------------------------------------------------------------------------------
def spring_law(**changes: Any) -> Any:
    """An elastic joint in Python."""

    def resolve(jump: Any, flexibility: Any, values: dict[str, Any], steps: int) -> Any:
        k = values["k"][:, None, :]
        return k * jump / (1.0 + k * flexibility)

    return python_law(**({"name": "spring", "parameters": [("k", 0.0)], "resolve": resolve} | changes))


def test_python_law() -> None:
    structure = chain(spring_law())
    laws = structure.laws(parameters={"joint": {"k": STIFFNESS}})
    _, state = structure.solve(laws, options=TIGHT)
    assert end(structure, laws, state) == pytest.approx(exact(), rel=1e-8)
    refuses(lambda: structure.laws(parameters={"joint": {"k": -1.0}}), "'k' of law 'spring'")
    refuses(lambda: spring_law(resolve=3), "resolve must be a function")
    refuses(lambda: spring_law(parameters=[("k", 0.0), ("k", 0.0)]), "two parameters 'k'")
    refuses(lambda: spring_law(parameters=[("jump", 0.0)]), "two parameters 'jump'")
    for wrong, words in (
        (lambda *_: None, "array of numbers"),
        (lambda *_: np.ones((1, 1, 1)) * 1j, "array of numbers"),
        (lambda *_: np.ones((1, 1)), "shape (1, 1)"),
        (lambda *_: np.full((1, 1, 1), np.nan), "nan at point 0"),
    ):
        bad = chain(spring_law(resolve=wrong))
        refuses(lambda bad=bad: bad.solve(bad.laws()), "interface 'joint', law 'spring'", words)


# ---------------------------------------------------------------------------------------------
# Threads
# ---------------------------------------------------------------------------------------------
def together(work: Callable[[int], None], count: int = 4) -> None:
    """Run in so many threads, and raise what any of them raised."""
    errors: list[BaseException] = []

    def guarded(number: int) -> None:
        try:
            work(number)
        except BaseException as error:
            errors.append(error)

    threads = [threading.Thread(target=guarded, args=(i,)) for i in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(timeout=120.0)
        assert not thread.is_alive(), "a thread hangs"
    if errors:
        raise errors[0]


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("law", ["elastic", "python"])
def test_threads_on_one_structure(backend: str, law: str) -> None:
    name = "normal" if law == "elastic" else "k"
    structure = chain("elastic" if law == "elastic" else spring_law(), operator="factored", backend=backend)

    def work(number: int) -> None:
        k = 1.0 + number
        for _ in range(15):
            laws = structure.laws(parameters={"joint": {name: k}})
            summary, state = structure.solve(laws, options=TIGHT, callback=lambda _: None)
            assert summary.status == "converged"
            assert end(structure, laws, state) == pytest.approx(exact(k), rel=1e-8)

    together(work)


@pytest.mark.parametrize("backend", BACKENDS)
def test_threads_with_a_structure_each(backend: str) -> None:
    def work(number: int) -> None:
        for _ in range(5):
            structure = chain(backend=backend)
            laws = elastic(structure)
            _, state = structure.solve(laws, options=TIGHT)
            assert end(structure, laws, state) == pytest.approx(exact(), rel=1e-8)

    together(work)


def test_threads_sweep_one_structure(structure: Structure, laws: Laws) -> None:
    def work(number: int) -> None:
        points = swept(structure, laws, options=Options(rtol=1e-9))
        assert points.jumps["joint"][:, 0, 0] == pytest.approx(2.0 / VALUES[0], rel=1e-7)

    together(work)


# ---------------------------------------------------------------------------------------------
# What may be kept and sent
# ---------------------------------------------------------------------------------------------
def test_states_and_summaries_pickle(structure: Structure, laws: Laws, state: State) -> None:
    again = pickle.loads(pickle.dumps(state))
    assert np.array_equal(again.data, state.data) and np.array_equal(again.traces, state.traces)
    summary, _ = structure.solve(laws)
    same = pickle.loads(pickle.dumps(summary))
    assert repr(same) == repr(summary) and len(same.history) == len(summary.history)
    assert same.history[-1].residual == summary.history[-1].residual
    assert copy.deepcopy(state).data is not state.data


def test_structures_and_laws_do_not_pickle(structure: Structure, laws: Laws) -> None:
    refuses(lambda: pickle.dumps(structure), "cannot be pickled", error=TypeError)
    refuses(lambda: pickle.dumps(laws), "cannot be pickled", error=TypeError)
    refuses(lambda: copy.copy(structure), "cannot be pickled", error=TypeError)


def test_arrays_that_are_handed_out_are_read_only_or_copies(structure: Structure, state: State) -> None:
    for array in (structure.weights, structure.directions, state.data, state.traces):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 7.0
    flexibility = structure.flexibility("joint")
    flexibility[:] = 0.0
    assert structure.flexibility("joint") == pytest.approx([2.0 / 1.3])
    weights = chain().weights  # outlives its structure
    assert weights == pytest.approx(np.ones(3))
