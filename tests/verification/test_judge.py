"""The judge judged: answers that are wrong in known ways are called wrong, right ones right."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import dolfinx_frontend as lf
from tests.verification.judged import connect, judged
from tests.verification.test_campaign import PULL, PUSH, given, judge, scenes

Found = judge.Found
Spoil = Callable[[Found], Found]
OBLIQUE = "lf.Traction(np.array((-1.0, 0.2)))"
GROWING = "lf.Traction(a(0) * np.array((0.1, 0.05)))"
STEPS = "[0.5, 1.0, 1.5, 2.0]"
HARD = "lf.Elastic(normal=1e6, tangential=1e6)"
NOTHING = "lf.Debonding(normal=80.0, tangential=40.0, strength=1e-4, opening=1e-3)"
SOFT = "lf.Elastic(normal=0.5, tangential=0.2)"


def glue(strength: float) -> str:
    return f"lf.Debonding(normal=80.0, tangential=40.0, strength={strength}, opening=0.05)"


def swept(value: str, grid: str, rtol: str = "1e-12") -> dict[str, str]:
    """Changes that sweep a value of the joint."""
    options = f"options=lf.Options(rtol={rtol}), keep_states=True, progress=False"
    return {"joint": value, "grid": grid, "run": f"return lf.sweep(problem, GRID, {options})"}


FRICTION = 'lf.Contact(friction=v("joint.friction"))'
SCENES: dict[str, tuple[str, dict[str, str]]] = {
    "springs": ("springs", {}),
    "springs kept": ("springs kept", {}),
    "contact": ("contact", {}),
    "stiff contact": ("stiff contact, gap", {}),
    "friction": ("friction", {}),
    "bond": ("bond", {}),
    "bolt": ("bolt", {}),
    "chaos": ("chaos", {}),
    "samples": ("samples", {}),
    "sweep": ("sweep", {}),
    "stuck": ("contact", {"joint": "lf.Contact(friction=0.5)"}),
    "bond with damage": ("bond", {"load": "lf.Displacement(np.array((0.01, 0.002)))"}),
    "glue at 30 %": ("bond", {"joint": glue(0.33), "bed": SOFT}),
    "glue in steps": (
        "bond",
        {"times": STEPS, "joint": glue(0.33), "bed": SOFT, "load": GROWING},
    ),
    "carries nothing": ("contact", {"load": PULL}),
    "carries nothing, friction": ("contact", {"load": PULL, "joint": "lf.Contact(friction=0.3)"}),
    "unloaded in steps": ("friction", {"times": "[1.0, 2.0, 5.0]"}),
    "no load in the first step": ("friction", {"times": "[0.0, 1.0, 2.0]"}),
    "sweep of friction": ("sweep", {**swept(FRICTION, '{"joint.friction": [0.3, 0.5]}'), "load": PUSH}),
    "glued": ("springs", {"joint": "lf.Perfect()"}),
    "press fit": ("contact", {"joint": "lf.Contact(gap=-0.002, friction=0.2)", "load": PULL}),
}


def drawn(name: str, rtol: float = 1e-6, **changes: str) -> scenes.Scene:
    base, own = SCENES[name]
    scene = given(base, **{**own, **changes})
    source = scene.source.replace("rtol=1e-6", f"rtol={rtol}")
    return scenes.Scene(0, "", scene.kind, source, rtol, 1, name)


@pytest.mark.parametrize("rtol", [1e-4, 1e-8])
@pytest.mark.parametrize("name", [name for name in SCENES if name != "glue at 30 %"])
def test_a_right_answer_is_right(name: str, rtol: float) -> None:
    verdict = judge.one(drawn(name, rtol))
    assert verdict.outcome == "right", (verdict.what, verdict.errors)


def part(name: str, change: Callable[[Any], Any], step: int = -1, run: int = -1) -> Spoil:
    """Changes the displacements of a part at one step of one run."""

    def spoilt(found: Found) -> Found:
        fields = found.fields[run][step]
        fields[name] = change(np.array(fields[name]))
        return found

    return spoilt


def force(change: Callable[[Any], Any], *names: str, step: int | None = None) -> Spoil:
    """Changes the forces of some interfaces, or of all."""

    def spoilt(found: Found) -> Found:
        for name in names or list(found.acting):
            f, jump = found.acting[name]
            f = np.array(f)
            where = slice(None) if step is None else slice(step, step + 1)
            f[:, where] = change(f[:, where])
            found.acting[name] = f, jump
        return found

    return spoilt


def scaled(by: float) -> Callable[[Any], Any]:
    return lambda values: by * values


def moved(values: Any) -> Any:
    """Slid along y by a hundredth of the largest displacement."""
    values[1::2] += 0.01 * np.abs(values).max()
    return values


def turned(values: Any) -> Any:
    """Friction the other way."""
    values[..., 1:] *= -1.0
    return values


def jump(found: Found) -> Found:
    f, j = found.acting["joint"]
    found.acting["joint"] = f, 1.01 * j
    return found


def said(found: Found) -> Found:
    """An error that is within the tolerance and above what is said."""
    found.said[0] = 1e-8
    return part("p1", scaled(1.0 + 1e-6))(found)


def unknown(found: Found) -> Found:
    """Converged, without a number for the error."""
    found.said[0] = float("nan")
    return found


def unread(found: Found) -> Found:
    """A force that the answer does not tell."""
    del found.acting["joint"]
    return found


def lost(found: Found) -> Found:
    """The last sample is not there."""
    found.fields.pop()
    return found


def both(change: Callable[[Any], Any], name: str) -> Spoil:
    """Changes forces and jumps alike: a linear law holds as before."""

    def spoilt(found: Found) -> Found:
        f, moved = found.acting[name]
        found.acting[name] = change(np.array(f)), change(np.array(moved))
        return found

    return spoilt


def steps(order: list[int]) -> Spoil:
    """Answers of other steps."""

    def spoilt(found: Found) -> Found:
        found.fields[0] = [found.fields[0][k] for k in order]
        found.acting = {name: (f[:, order], j[:, order]) for name, (f, j) in found.acting.items()}
        return found

    return spoilt


def points(order: list[int]) -> Spoil:
    """Answers of other points."""

    def spoilt(found: Found) -> Found:
        found.fields = [found.fields[k] for k in order]
        found.acting = {name: (f[order], j[order]) for name, (f, j) in found.acting.items()}
        return found

    return spoilt


def mode(columns: slice, by: float) -> Spoil:
    def spoilt(found: Found) -> Found:
        fields = found.fields[0][0]
        fields["p1"] = np.array(fields["p1"])
        fields["p1"][:, columns] *= by
        return found

    return spoilt


def read(what: str, by: float) -> Spoil:
    """A statistic that is not that of the answer."""

    class Read:
        def __init__(self, result: Any) -> None:
            self.result = result

        def __getattr__(self, name: str) -> Any:
            value = getattr(self.result, name)
            return (lambda part: by * value(part)) if name == what else value

    def spoilt(found: Found) -> Found:
        found.result = Read(found.result)
        return found

    return spoilt


def other(name: str, **changes: str) -> Spoil:
    """The answer of another scene."""

    def spoilt(found: Found) -> Found:
        scene = drawn(name, **changes)
        case = judge.Case(scene.source, scene.kind)
        return RUN(case, case.assemble())

    return spoilt


RUN = judge.Case.run
MANY = "lf.Contact(friction=10.0)"
WRONG: dict[str, tuple[str, Spoil]] = {
    "a part is stretched": ("springs", part("p1", scaled(1.001))),
    "a part is nowhere": ("springs", part("p0", scaled(np.nan))),
    "a part is shifted": ("springs", part("p1", moved)),
    "a kept part is stretched": ("springs kept", part("p0", scaled(1.001))),
    "a force is out of balance": ("springs", force(scaled(1.01), "joint")),
    "a support is out of balance": ("springs", force(scaled(0.99), "bed")),
    "all forces are doubled": ("springs", force(scaled(2.0))),
    "a force is not a number": ("springs", force(scaled(np.nan), "joint")),
    "a jump is not the force's": ("springs", jump),
    "other springs": ("springs", other("springs", joint="lf.Elastic(normal=51.0, tangential=20.0)")),
    "the error said is too small": ("springs", said),
    "torn glue": ("glued", other("glued", joint=NOTHING)),
    "penetrates": ("contact", other("contact", joint="lf.Contact(stiffness=50.0)")),
    "stands off": ("contact", other("contact", joint="lf.Contact(gap=-0.001)")),
    "loses contact": ("contact", other("contact", joint=NOTHING)),
    "a force that cannot be read": ("contact", unread),
    "pulls": ("contact", force(scaled(-1.0), "joint")),
    "contact forces are doubled": ("contact", force(scaled(2.0))),
    "contact slides": ("contact", part("p1", moved)),
    "sticks without friction": ("contact", other("contact", joint=HARD)),
    "pulls though it carries nothing": ("carries nothing", other("carries nothing", joint=HARD)),
    "another stiffness": ("stiff contact", other("stiff contact", joint="lf.Contact(gap=0.005)")),
    "another gap": ("stiff contact", other("stiff contact", joint="lf.Contact(gap=0.004, stiffness=200.0)")),
    "slid though it sticks": ("stuck", other("stuck", joint="lf.Contact()")),
    "sticks beyond the cone": ("friction", other("friction", joint=MANY)),
    "slips below the cone": ("friction", other("friction", joint="lf.Contact(friction=0.05)")),
    "slips the other way": ("friction", force(turned, "joint")),
    "a wrong step": ("friction", part("p1", scaled(1.001), step=2)),
    "steps in another order": ("friction", steps([0, 2, 1, 3])),
    "the step before": ("friction", steps([0, 1, 2, 2])),
    "a force of one step": ("friction", force(scaled(1.01), "joint", step=1)),
    "friction forces are doubled": ("friction", force(scaled(2.0))),
    "torn at 30 % of the strength": ("glue at 30 %", other("glue at 30 %", joint=NOTHING)),
    "a bond without damage": (
        "bond with damage",
        other("bond with damage", joint="lf.Elastic(normal=80.0, tangential=40.0)"),
    ),
    "a bond with other damage": ("bond with damage", other("bond with damage", joint=glue(0.049))),
    "glue is torn in the first step": ("glue in steps", other("glue in steps", joint=NOTHING)),
    "a gasket that carries nothing": ("stiff contact", force(scaled(0.0), "joint")),
    "a spring that gives twice as much under twice the force": ("springs kept", both(scaled(2.0), "joint")),
    "an opening that is misread": ("carries nothing", both(scaled(0.5), "joint")),
    "an error that is no number": ("springs kept", unknown),
    "another bolt force": ("bolt", other("bolt", joint="lf.Preload(a(0) * 0.051, until=1.0)")),
    "a bolt that gives": ("bolt", other("bolt", joint="lf.Preload(a(0) * 0.05)")),
    "a wrong mean": ("chaos", mode(slice(0, 1), 1.001)),
    "a wrong deviation": ("chaos", mode(slice(1, None), 1.01)),
    "a mean that is misread": ("chaos", read("unknowns", 1.001)),
    "a deviation that is misread": ("chaos", read("deviation", 1.01)),
    "mean forces are doubled": ("chaos", force(scaled(2.0))),
    "a wrong sample": ("samples", part("p1", scaled(1.001), run=1)),
    "samples in another order": ("samples", points([1, 0, 2, 3])),
    "a sample that is lost": ("samples", lost),
    "samples that do not scatter": ("samples", points([0, 0, 0, 0])),
    "a sampled mean that is misread": ("samples", read("unknowns", 1.001)),
    "a sampled deviation that is misread": ("samples", read("deviation", 1.01)),
    "sampled forces are doubled": ("samples", force(scaled(2.0))),
    "a wrong point": ("sweep", part("p1", scaled(1.001), run=1)),
    "points in another order": ("sweep", points([2, 1, 0])),
    "swept forces are doubled": ("sweep of friction", force(scaled(2.0))),
}


@pytest.mark.parametrize("name", list(WRONG))
def test_a_wrong_answer_is_wrong(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, spoil = WRONG[name]

    def run(case: judge.Case, problem: Any, script: Any = None) -> Found:
        found = RUN(case, problem, script)
        return spoil(found) if script is None else found

    monkeypatch.setattr(judge.Case, "run", run)
    verdict = judge.one(drawn(scene))
    assert verdict.outcome == "wrong", (verdict.outcome, verdict.reference, verdict.what)


LOOSE = {"bed": "lf.Pressure(0.0)", "load": OBLIQUE}
NO_ANSWER: dict[str, tuple[str, dict[str, str], dict[str, str]]] = {
    "supports contradict each other": (
        "springs",
        {"load": "lf.Displacement(np.array((0.01, 0.0)))", "bed": "lf.Displacement(0.0)"},
        {"load": "lf.Displacement(np.array((0.01, 0.0)))"},
    ),
    "a spring vanishes": (
        "sweep",
        {"bed": "lf.Pressure(0.0)", "grid": '{"joint.normal": [50.0, 0.0]}'},
        {"bed": "lf.Pressure(0.0)", "grid": '{"joint.normal": [50.0, 20.0]}'},
    ),
    "friction is below the load": (
        "springs",
        {**LOOSE, "joint": "lf.Contact(friction=0.15)"},
        {**LOOSE, "joint": "lf.Contact(friction=0.5)"},
    ),
}


LONG = pytest.mark.night(guard="the other scenes without an answer")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[LONG] if name.startswith("friction") else []) for name in NO_ANSWER]
)
def test_no_answer_is_right_where_there_is_none(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The answer of a scene that has one, also at a tolerance of a tenth."""
    scene, changes, others = NO_ANSWER[name]
    monkeypatch.setattr(judge.Case, "run", lambda case, problem: other(scene, **others)(None))
    verdict = judge.one(drawn(scene, 0.1, **changes))
    assert verdict.outcome == "wrong", (verdict.outcome, verdict.reference, verdict.what)


def test_a_jam_that_is_gone_is_one_of_several_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    """A wedge of 10 degrees, pressed into friction of 0.3 and let go: it stays jammed, or lies free."""
    run = judge.Case.run

    def freed(case: judge.Case, problem: Any, script: Any = None) -> Found:
        found = run(case, problem, script)
        found.fields[0][-1] = {name: 0.0 * u for name, u in found.fields[0][-1].items()}
        for force, jump in (pair for pair in found.acting.values()):
            force.flags.writeable = jump.flags.writeable = True
            force[:, -1] = jump[:, -1] = 0.0
        return found

    slope = np.tan(np.radians(10.0))
    push = lf.Amplitude([0.0, 1.0, 2.0], [0.0, -0.1, 0.0])

    def laws(a: Any, v: Any) -> dict[str, Any]:
        return {
            "mid": lf.Displacement(0.0, components=[0]),
            "wall": lf.Contact(friction=0.3),
            "bed": lf.Elastic(normal=1e-2),
            "push": lf.Traction(a(0) * np.array((0.0, 1.0))),
        }

    def build(given: Any) -> lf.Scene:
        scene = lf.Scene()
        part = lf.geometry.box((1.0, 1.0), (2, 2))
        part.mesh.geometry.x[:, 0] *= 1.0 + slope * part.mesh.geometry.x[:, 1]
        scene.substructure("wedge", part, lf.LinearElastic(E=100.0, nu=0.3), degree=1)
        faces = {"mid": "x0", "wall": "x1", "bed": "y0", "push": "y1"}
        return connect(scene, given, {name: [f"wedge:{face}"] for name, face in faces.items()})

    def verdict() -> judge.Verdict:
        return judged(
            "history", laws, build, lambda problem: lf.solve(problem, times=[1.0, 1.5, 2.0]), 1e-6,
            amplitudes=[push], times=[1.0, 1.5, 2.0],
        )

    jammed = verdict()
    monkeypatch.setattr(judge.Case, "run", freed)
    free = verdict()
    assert "several" in {jammed.outcome, free.outcome} <= {"right", "several"}, (jammed, free)


def test_what_cannot_be_judged_is_neither_right_nor_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    def unsolved(*given: Any) -> None:
        raise judge.Unsolved("no answer after 300 rounds")

    monkeypatch.setattr(judge, "histories", unsolved)
    assert judge.one(drawn("contact")).outcome == "unjudged"
