"""Whatever a scene is given: what is no number, name or law is refused with name, value and remedy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import dolfinx_frontend as lf
from tests.helpers import NO_NAMES, NO_NUMBERS, NO_WHOLE_NUMBERS, NOT_FINITE, refused

pytestmark = pytest.mark.sanitize

LAWS: dict[str, tuple[Callable[..., Any], dict[str, Any], tuple[str, ...]]] = {
    "Elastic": (lf.Elastic, {"normal": 1.0}, ("normal", "tangential", "jump")),
    "Contact": (
        lf.Contact,
        {},
        ("gap", "friction", "threshold", "stiffness", "tangential_stiffness", "jump"),
    ),
    "Debonding": (
        lf.Debonding,
        {"normal": 1.0, "strength": 1.0, "opening": 1.0},
        ("normal", "tangential", "strength", "opening", "jump"),
    ),
    "Preload": (lf.Preload, {"force": 1.0}, ("force", "until")),
    "Displacement": (lf.Displacement, {}, ("value",)),
    "Pressure": (lf.Pressure, {}, ("p",)),
    "Traction": (lf.Traction, {}, ("t",)),
    "Perfect": (lf.Perfect, {}, ("jump",)),
}
VALUES = [(law, name) for law, (_, _, names) in LAWS.items() for name in names]
TEXTS = {k: v for k, v in NO_NUMBERS.items() if k not in ("None", "[1.0]")}
PART = lf.geometry.box((1.0, 1.0), (1, 1))
STEEL = lf.LinearElastic(1.0, 0.3)


def scene() -> lf.Scene:
    """One part that is fixed."""
    made = lf.Scene()
    made.substructure("a", PART, STEEL, degree=1)
    made.fix("a:x0", name="foot")
    return made


@pytest.mark.parametrize("law, name", VALUES)
def test_numbers_of_laws(law: str, name: str) -> None:
    make, rest, _ = LAWS[law]
    for shown, wrong in {**TEXTS, **NOT_FINITE}.items():
        refused(lambda wrong=wrong: make(**{**rest, name: wrong}), law, f"{name} = {shown}")
    refused(lambda: make(**{**rest, name: [1.0, "b"]}), law, f"{name} = [1", "'b']")
    refused(lambda: make(**{**rest, name: np.array(["x", "y"])}), law, name, "'x'")
    refused(lambda: make(**{**rest, name: np.array([1j, 2.0])}), law, name, "j")
    refused(lambda: make(**{**rest, name: object()}), law, name, "object")


@pytest.mark.parametrize("law, name", [*VALUES, ("Debonding", "energy")])
@pytest.mark.parametrize("empty", [[], (), np.zeros(0), np.zeros((0, 2))], ids=repr)
def test_empty_values(law: str, name: str, empty: Any) -> None:
    make, rest, _ = LAWS[law]
    if name == "energy":
        rest = {"normal": 1.0, "strength": 1.0}
    refused(lambda: make(**{**rest, name: empty}), law, name)


def test_a_bond_has_a_stiffness() -> None:
    refused(lambda: lf.Debonding(normal=None, strength=1.0, opening=1.0), "Debonding: normal = None: a bond")
    user = lf.UserLaw(force=lambda jump, *, k: jump, values={"k": 1.0})
    refused(lambda: user.with_(k=[]), "UserLaw: k = [] is empty")


@pytest.mark.parametrize(
    "make, flag",
    [
        (lambda v: lf.Elastic(normal=1.0, total=v), "total"),
        (lambda v: lf.Contact(interference=v), "interference"),
        (lambda v: lf.Preload(1.0, total=v), "total"),
        (lambda v: lf.UserLaw(resolve=lambda jump, flexibility: jump, history=v), "history"),
    ],
)
def test_flags_of_laws(make: Callable[[Any], Any], flag: str) -> None:
    for shown, wrong in {"'yes'": "yes", "1": 1, "None": None, "[]": []}.items():
        refused(lambda wrong=wrong: make(wrong), f"{flag} = {shown}", "True or False")


def test_intervals_and_components() -> None:
    for wrong in ("ab", 3, [1.0, 2.0], [(0.0, "b")], [(0.0, 1.0, 2.0)], [(0.0, None)], [(1.0, 0.0)], []):
        refused(lambda wrong=wrong: lf.Preload(1.0, during=wrong), "Preload", "during = ")
    for wrong in ("xy", 1.5, [0.5], True, [True], -1, [], (0, 0), [None], 1j):
        refused(lambda wrong=wrong: lf.Displacement(0.0, components=wrong), "Displacement", "components = ")
        refused(lambda wrong=wrong: scene().fix("a:x1", components=wrong), "components = ")
    assert lf.Displacement(0.0, components=1).components == (1,)  # type: ignore[arg-type]


def test_laws_of_users() -> None:
    def force(jump: Any) -> Any:
        return jump

    refused(lambda: lf.UserLaw(force=3), "UserLaw", "force = 3")  # type: ignore[arg-type]
    refused(lambda: lf.UserLaw(force=force, values=[1.0]), "values = [1]")  # type: ignore[arg-type]
    refused(lambda: lf.UserLaw(force=force, values={"k": "a"}), "k = 'a'")
    refused(lambda: lf.UserLaw(force=force, values={3: 1.0}), "3")  # type: ignore[dict-item]
    refused(lambda: lf.UserLaw(force=force, components=3), "components = 3")  # type: ignore[arg-type]
    refused(lambda: lf.UserLaw(force=force, name=3), "name = 3")  # type: ignore[arg-type]


def test_values_that_functions_return() -> None:
    for wrong, shown in ((lambda x: "one", "'one'"), (lambda x: x[:, 0] + 1j, "j"), (lambda x: None, "None")):
        made = scene()
        made.pressure("a:x1", wrong, "load")
        refused(lambda made=made: lf.assemble(made), "'load'", "'p'", shown)
    made = scene()
    made.pressure("a:x1", lambda x: x[:, 0] > 0.5, "load")  # truth values are 0 and 1 there
    assert lf.assemble(made).interfaces["load"].num_points


def test_amplitudes() -> None:
    for shown, wrong in NO_NUMBERS.items():
        if shown != "[1.0]":
            refused(
                lambda wrong=wrong: lf.Amplitude([0.0, wrong], [0.0, 1.0]), "Amplitude", "times = ", shown
            )
            refused(
                lambda wrong=wrong: lf.Amplitude([0.0, 1.0], [0.0, wrong]), "Amplitude", "values = ", shown
            )
        refused(lambda wrong=wrong: lf.Amplitude(lambda t: wrong)(1.0), "time 1")
    for shown, wrong in NOT_FINITE.items():
        refused(lambda wrong=wrong: lf.Amplitude([0.0, 1.0], [0.0, wrong]), "values = ", shown)
        refused(lambda wrong=wrong: lf.Amplitude(lambda t: wrong)(1.0), f"returned {shown} at time 1")
    refused(lambda: lf.Amplitude("abc", [1.0]), "times = 'abc'")
    refused(lambda: lf.Amplitude([[0.0], [1.0, 2.0]], [1.0]), "times = ")  # type: ignore[list-item]


@pytest.mark.parametrize("shown, wrong", {**NO_NUMBERS, **NOT_FINITE}.items())
def test_materials(shown: str, wrong: Any) -> None:
    refused(lambda: lf.LinearElastic(wrong, 0.3), "LinearElastic: E = ")
    refused(lambda: lf.LinearElastic(1.0, wrong), "LinearElastic: nu = ")
    three = (1.0, 1.0, 1.0)
    for name in ("E", "nu", "G"):
        given = {"E": three, "nu": (0.0, 0.0, 0.0), "G": three}
        given[name] = (1.0, wrong, 1.0)
        refused(lambda given=given: lf.OrthotropicElastic(**given), f"OrthotropicElastic: {name} = ")
    axes = [[1.0, 0.0], [0.0, wrong]]
    refused(lambda: lf.OrthotropicElastic(three, (0.0, 0.0, 0.0), three, axes), "axes")


def test_planes() -> None:
    for wrong in (3, None, ["strain"], "x"):
        refused(lambda wrong=wrong: lf.LinearElastic(1.0, 0.3, wrong), "plane = ", repr(wrong))


@pytest.mark.parametrize("shown, wrong", NO_NAMES.items())
def test_names(shown: str, wrong: Any) -> None:
    shown = repr(wrong)
    made = scene()
    refused(lambda: made.substructure(wrong, PART, STEEL), "substructure", f"name = {shown}", "a string")
    refused(lambda: made.interface(wrong, "a:x1", lf.Symmetry()), "interface", f"name = {shown}")
    if wrong is not None:
        refused(lambda: made.pressure("a:x1", 1.0, wrong), f"name = {shown}")
    refused(lambda: made.interface("j", wrong, lf.Symmetry()), "'j'")
    refused(lambda: made.fix(wrong), "displacement" if not isinstance(wrong, (str, list)) else "face")
    assert list(made.interfaces) == ["foot"]


def test_settings_of_parts_and_interfaces() -> None:
    made = scene()
    for shown, wrong in NO_WHOLE_NUMBERS.items():
        refused(lambda wrong=wrong: made.substructure("b", PART, STEEL, degree=wrong), "degree = ")
        if wrong is None:
            continue
        refused(lambda wrong=wrong: made.substructure("b", PART, STEEL, rank=wrong), f"rank = {shown}")
        law = lf.Symmetry()
        refused(
            lambda wrong=wrong: made.interface("j", "a:x1", law, quadrature_degree=wrong),
            f"quadrature_degree = {shown}",
        )
    refused(lambda: made.substructure("b", PART, STEEL, rank=-1), "rank = -1", ">= 0")
    for shown, wrong in {**NO_NUMBERS, **NOT_FINITE, "0": 0.0, "-1": -1}.items():
        if wrong is None:
            continue
        shown = "[1]" if shown == "[1.0]" else shown
        refused(
            lambda wrong=wrong: made.interface("j", "a:x1", lf.Symmetry(), max_distance=wrong),
            f"max_distance = {shown}",
        )
    for wrong in (3, None, ["points"]):
        refused(lambda wrong=wrong: made.interface("j", "a:x1", lf.Symmetry(), space=wrong), "space = ")
        refused(lambda wrong=wrong: made.interface("j", "a:x1", lf.Symmetry(), overlap=wrong), "overlap = ")
    for wrong in ("ab", ["a", "b"], [1.0], [1.0, 1j], [1.0, np.nan], [1.0, None], 3.0, True):
        refused(
            lambda wrong=wrong: made.substructure("b", PART, STEEL, body_force=wrong), "'b'", "body_force"
        )
    for wrong in (3, None, "steel"):
        refused(lambda wrong=wrong: made.substructure("b", PART, wrong), "'b'", "not a material")
        refused(lambda wrong=wrong: made.substructure("b", wrong, STEEL), "'b'", "not a part")


def test_values_of_a_problem() -> None:
    problem = lf.assemble(scene())
    refused(lambda: problem.laws(values={"foot.value": "a"}), "value = 'a'")
    refused(lambda: problem.laws(values={3: 1.0}), "3")  # type: ignore[dict-item]
    refused(lambda: problem.laws({"foot": 3}), "'foot'", "law = 3")  # type: ignore[dict-item]
    for wrong in (3, None, "scene", problem):
        refused(lambda wrong=wrong: lf.assemble(wrong), "assemble", "scene = ", type(wrong).__name__)
    refused(lambda: lf.assemble(scene(), progress=3), "progress = 3")  # type: ignore[arg-type]
    refused(lambda: lf.assemble(scene(), comm="world"), "comm = 'world'")
