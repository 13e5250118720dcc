"""One scene, from its script to its verdict."""

from __future__ import annotations

import itertools
import math
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from time import perf_counter
from typing import Any

import numpy as np

import dolfinx_frontend as lf
from campaign import measure, scenes
from campaign.measure import Error
from campaign.points import Array
from campaign.reference import (
    Answer,
    Contradiction,
    Inadmissible,
    Model,
    Unsolved,
    galerkin,
    given_loads,
    histories,
)

FACTOR = 3.0
"""An error of more than this times the tolerance, or times what the result says, is wrong."""
BALANCE = 30.0
"""Resultants and laws may be this many tolerances off, for they have no norm in common with the error; not
more than `LARGE` in all, nor less than `FACTOR` tolerances."""
LARGE = 0.1
PATH = 8
"""Increments of a step along which a bond that softens is followed."""
BRANCH = 0.01
"""Damages that differ by more are of two branches."""
ATTEMPTS = 12
TIGHT = 1e-11


@dataclass
class Verdict:
    """What came of a scene.

    Attributes
    ----------
    outcome
        ``right``, ``wrong`` (converged), ``not_converged``, ``raised``, ``crashed``; ``refused`` (an
        exception at a scene that has no answer), ``rounding`` (not converged where rounding alone is above
        the tolerance), ``several`` (friction allows more than one answer, this is another one than the
        reference's), ``unjudged`` (no reference).
    what
        In one line.
    why
        Of a wrong one: ``tolerance`` (above three of them), ``fluctuation`` and ``scatter of samples`` (the
        same, but only there), ``estimate`` (only above three times what the result says), ``law``,
        ``equilibrium``, ``no answer`` (nothing balances the loads), ``mean`` and ``deviation`` (as they are
        read). Of one that did not converge: its status, and whether it was accelerated.
    ratio
        Said over true, of converged iterations whose true error is above rounding, and what they say above
        the resolution of estimates (docs/limits.md); None otherwise.
    true, said
        The largest true error, and what the result says.
    whole
        The largest error of a run in one number for all parts, steps and columns.
    reference
        How the truth was found.
    family, kind, about, attempt, seconds, script
        Of the scene.
    errors
        The worst few, in words.
    """

    seed: int
    outcome: str
    what: str = ""
    why: str = ""
    ratio: float | None = None
    true: float | None = None
    said: float | None = None
    whole: float | None = None
    rtol: float = 0.0
    status: str = ""
    iterations: int = 0
    reference: str = ""
    rounding: float = 0.0
    family: str = ""
    kind: str = ""
    about: str = ""
    attempt: int = 0
    seconds: dict[str, float] = field(default_factory=dict)
    errors: list[str] = field(default_factory=list)
    script: str = ""

    def record(self) -> dict[str, Any]:
        return asdict(self)


@dataclass
class Found:
    """What a run of the library gave, in one shape for all kinds.

    Attributes
    ----------
    fields
        Run (one, or one per sample or point) -> step -> part -> (n, columns).
    said, status
        One each run.
    acting
        Interface -> force and jump (runs, steps, m, components) as a user reads them, of a chaos their means;
        what the run does not know is missing.
    """

    plan: Any
    fields: list[list[dict[str, Array]]]
    said: list[float]
    status: list[str]
    iterations: int
    direct: bool
    result: Any
    acting: dict[str, tuple[Array, Array]] = field(default_factory=dict)


class Case:
    """A scene's script, executed.

    Parameters
    ----------
    source
        Defines ``build(a, v)``, ``laws(a, v)``, ``run(problem)``, ``AMPLITUDES``, ``TIMES``, ``VARIABLES``,
        ``GRID`` and ``RANDOM``.
    """

    def __init__(self, source: str | Mapping[str, Any], kind: str) -> None:
        self.kind = kind
        self.space: Mapping[str, Any] = source if not isinstance(source, str) else {}
        if isinstance(source, str):
            self.space = space = {"__name__": "scene"}
            exec(compile(source, "<scene>", "exec"), space)  # the campaign's own text
        self.times = self.space["TIMES"]
        self.variables = self.space["VARIABLES"]
        self.grid: dict[str, list[float]] = self.space["GRID"]
        self.random: list[str] = self.space["RANDOM"]

    def nominal(self, name: str) -> Any:
        """A random variable, or the first value of a sweep."""
        return self.variables[name] if name in self.variables else self.grid[name][0]

    def assemble(self, comm: Any = None) -> Any:
        amplitudes = self.space.get("AMPLITUDES", [])
        return lf.assemble(self.space["build"](lambda k: amplitudes[k], self.nominal), comm=comm)

    def laws(self, time: float | None = None, values: Mapping[str, float] | None = None) -> dict[str, Any]:
        """Laws with numbers, at a time and for values of what is random or swept (its mean otherwise)."""
        amplitudes = self.space.get("AMPLITUDES", [])

        def number(name: str) -> float:
            if values is not None and name in values:
                return float(values[name])
            each = self.nominal(name)
            return float(each if isinstance(each, (int, float)) else each.mean)

        return dict(self.space["laws"](lambda k: amplitudes[k](0.0 if time is None else time), number))

    def run(self, problem: Any, script: Callable[[Any], Any] | None = None) -> Found:
        result = (script or self.space["run"])(problem)
        parts = list(problem.substructures)
        if self.kind in ("static", "history"):
            fields = [self._steps({p: result.displacements[p] for p in parts})]
            status, said = [result.status], [result.error]
        elif self.kind == "chaos":
            fields = [[{p: result.coefficients(p) for p in parts}]]
            status, said = [result.status], [result.error]
        elif self.kind == "samples":
            fields = []
            for block in result.blocks():
                moved = {p: block.displacement(p) for p in parts}
                count = len(next(iter(moved.values())))
                fields += [[{p: moved[p][k][:, None] for p in parts}] for k in range(count)]
            status, said = list(map(str, result.points.status)), list(result.error.ravel())
        else:
            fields = []
            for index in np.ndindex(*result.shape):
                fields.append(self._steps(result.point(*index).displacements))
            status, said = list(map(str, result.points.status)), list(result.error.ravel())
        iterations = int(np.sum(result.iterations))
        direct = result.plan.method == "direct"
        said = [float(s) for s in said]
        acting = self._acting(problem, result)
        return Found(result.plan, fields, said, status, iterations, direct, result, acting)

    def _acting(self, problem: Any, result: Any) -> dict[str, tuple[Array, Array]]:
        out = {}
        for name in problem.interfaces:
            try:
                if self.kind == "chaos":
                    both = [result.force_coefficients(name)[..., 0], result.jump_coefficients(name)[..., 0]]
                else:
                    both = [np.asarray(result.force(name)), np.asarray(result.jump(name))]
            except lf.SceneError:
                continue
            shapes = [(-1, len(self.times or [0]), *each.shape[-2:]) for each in both]
            force, jump = (each.reshape(shape) for each, shape in zip(both, shapes, strict=True))
            out[name] = force, jump
        return out

    def _steps(self, fields: Mapping[str, Array]) -> list[dict[str, Array]]:
        if self.times is None:
            return [{p: u[:, None] for p, u in fields.items()}]
        return [{p: u[k][:, None] for p, u in fields.items()} for k in range(len(self.times))]

    def values(self, found: Found) -> tuple[list[dict[str, float]], Array | None]:
        """Of each run: values of what is random or swept; probabilities of samples."""
        if self.kind == "samples":
            names = found.result.space.names
            columns = [found.result.space.germ_names.index(n) for n in names]
            germs = found.result.germs
            where = list(zip(names, columns, strict=True))
            rows = [{n: float(self.variables[n].value(g[c])) for n, c in where} for g in germs]
            return rows, found.result.probabilities
        if self.kind == "sweep":
            points = itertools.product(*self.grid.values())
            return [dict(zip(self.grid, map(float, point), strict=True)) for point in points], None
        return [{}], None


def model_of(case: Case, problem: Any, active: Any) -> Model:
    """The reference's model of a scene."""
    time = None if case.times is None else float(case.times[0])
    laws = case.laws(time)
    return Model(problem, laws, active, case.random)


def starts(found: Found, run: int, model: Model) -> Callable[[int], Any]:
    """Forces and jumps of a run, for the reference to begin from."""

    def begin(step: int) -> Any:
        known = {}
        for row in model.rows:
            force, jump = found.acting.get(row.name, (np.zeros(0), None))
            if force.shape[-1] == row.components:
                known[row.name] = force[run, step], jump[run, step]
        return known

    return begin


def at_rest(problem: Any, near: list[dict[str, Array]], start: Callable[[int], Any],
            cold: Sequence[Answer]) -> tuple[list[dict[str, Array]], Callable[[int], Any]]:
    """Fields and forces to begin from, zero where an answer has rounding at most."""
    still = []
    for answer in cold:
        size = {name: float(np.abs(u).max()) for name, u in answer.fields.items()}
        still.append({name for name, s in size.items() if s <= 1e-13 * max(size.values())})

    def begin(step: int) -> Any:
        known = start(step)
        for name in known:
            if {side.substructure for side in problem.interfaces[name].sides} <= still[step]:
                known[name] = tuple(np.zeros_like(each) for each in known[name])
        return known

    fields = [{n: 0.0 * u if n in each else u for n, u in step.items()}
              for step, each in zip(near, still, strict=True)]
    return fields, begin


def truth(case: Case, problem: Any, found: Found, model: Model, run: int, values: Mapping[str, float],
          warm: bool = False, cold: Sequence[Answer] = ()) -> list[Answer]:
    """The reference's steps for one run; a warm one begins from the run's own answer.

    Parts that nothing moves in the reference's first answer (`cold`) begin at rest: from rounding they
    would not come to it. A bond that softens has the damage that it comes to while the loads of a step grow:
    the step begins from there. Its damage is not known where it cannot be followed.
    """

    def laws_at(time: float | None) -> Mapping[str, Any]:
        return case.laws(time, values)

    if warm:
        near, start = found.fields[run], starts(found, run, model)
        if cold:
            near, start = at_rest(problem, near, start, cold)
        return histories(model, laws_at, case.times, start, near)
    answers = histories(model, laws_at, case.times)
    if any(np.any(damage) for answer in answers for damage in answer.damage.values()):
        try:
            path = histories(model, laws_at, case.times, increments=PATH)

            def grown(step: int) -> dict[str, tuple[Array, Array]]:
                return {name: (force, path[step].jumps[name]) for name, force in path[step].forces.items()}

            answers = histories(model, laws_at, case.times, grown, [answer.fields for answer in path])
        except Unsolved:
            for answer in answers:
                answer.damage.clear()
    return answers


def same_branch(first: Sequence[Answer], second: Sequence[Answer]) -> bool:
    """Whether two answers have the damage of one branch, as far as it is known."""
    return all(
        np.abs(damage - b.damage[name]).max() <= BRANCH
        for a, b in zip(first, second, strict=True)
        for name, damage in a.damage.items()
    )


def galerkin_truth(case: Case, problem: Any, found: Found, model: Model) -> list[Answer]:
    """The reference of a linear chaos."""
    result = found.result
    basis, space = result.basis, result.space
    names = space.names
    columns = [space.germ_names.index(n) for n in names]
    rule = space.tensor_gauss({1: 40, 2: 16}.get(space.dimension, 10))
    points = np.asarray(rule.points)
    psi = np.asarray(basis.evaluate(points))

    def laws_of(point: Array) -> dict[str, Any]:
        where = zip(names, columns, strict=True)
        return case.laws(None, {n: float(case.variables[n].value(point[c])) for n, c in where})

    return [galerkin(model, laws_of, case.random, points, np.asarray(rule.weights), psi)]


def tight_truth(
    case: Case, problem: Any, found: Found, same: bool = False
) -> list[list[Answer]]:
    """Where no reference exists: runs of the library at a tolerance of 1e-11, two that agree.

    Their search directions (and coarse problem) are not those of the run, or the same: a nonlinear law
    is projected on the chaos in the variables of the search direction, so that truncated chaoses of two
    directions differ by some of the truncation.

    Raises
    ------
    Unsolved
        None converged, or they differ.
    """
    got: list[Found] = []
    result = found.result
    active = list(found.plan.active)
    own = found.plan.direction
    options = lf.Options(rtol=TIGHT, max_iterations=4000, directions="diagonal", macro="none", newton=0)
    if same:
        options = options.with_(directions=found.plan.options.directions, macro=found.plan.options.macro)
    others = [(f, None) for f in (4.0, 0.7, 1.7, 12.0)]
    for factor, start in [(own, None), (own, result)] if same else others:

        def again(problem: Any, factor: Any = factor, start: Any = start) -> Any:
            return lf.solve(
                problem, chaos=result.chaos, active=active, direction=factor, options=options, start=start
            )

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            tight = case.run(problem, again)
        if tight.status == ["converged"]:
            got.append(tight)
        if len(got) == 2:
            break
    if len(got) < 2:
        raise Unsolved("no two tight runs converged")
    answers = []
    parts = list(problem.substructures)
    from campaign.reference import Norms

    norms = Norms(problem, found.plan.active)
    for run in range(len(found.fields)):
        steps = []
        for k in range(len(found.fields[run])):
            one, two = (g.fields[run][k] for g in got)
            floors = {
                p: np.stack(
                    [norms.of(p, (one[p] - two[p])[:, g]) for g in measure.columns(case.kind)]
                    + ([np.zeros(2)] if case.kind != "chaos" else []),
                    axis=1,
                )
                for p in parts
            }
            steps.append(Answer(dict(one), floors))
        answers.append(steps)
    return answers


TOLD = (lf.Contact, lf.Debonding, lf.UserLaw)
"""Laws whose forces an answer has."""


def offences(case: Case, problem: Any, found: Found) -> Iterator[tuple[str, str, float]]:
    """What breaks a law or the balance of a part in the answers that have converged: why, where, how much."""
    for k, values in enumerate(case.values(found)[0]):
        if found.status[k] != "converged":
            continue
        memory: dict[str, Any] = {}
        for step, fields in enumerate(found.fields[k]):
            time = None if case.times is None else float(case.times[step])
            laws = case.laws(time, values)
            both = {name: (f[k, step], j[k, step]) for name, (f, j) in found.acting.items()}
            mean = {name: u[:, :1] for name, u in fields.items()}
            loads = given_loads(problem, laws, time)
            broken = {}
            if case.kind != "chaos":  # the mean of a force is not the force of the mean
                broken = measure.broken_laws(problem, laws, both, mean, time, memory)
            forces = {name: force for name, (force, _) in both.items()}
            left = measure.unbalanced(problem, laws, forces, loads, mean)
            untold = [name for name, law in laws.items() if isinstance(law, TOLD) and name not in both]
            broken |= dict.fromkeys(untold, math.inf)
            for why, each in (("law", broken), ("equilibrium", left)):
                for name, size in each.items():
                    yield why, f"{name}, run {k}, step {step}", size


def misread(case: Case, found: Found) -> Iterator[tuple[str, str, float]]:
    """Means and deviations that are not those of the columns or samples they are of: why, where, how much."""
    if case.kind not in ("chaos", "samples"):
        return
    weights = case.values(found)[1]
    for name in found.fields[0][0]:
        if weights is None:
            mean, rest = found.fields[0][0][name][:, 0], found.fields[0][0][name][:, 1:]
        else:
            each = np.stack([fields[0][name][:, 0] for fields in found.fields], axis=1)
            mean = each @ weights
            rest = (each - mean[:, None]) * np.sqrt(weights)
            if found.result.weights is None and found.result.statistics != "qmc":
                rest *= np.sqrt(len(weights) / (len(weights) - 1))
        deviation = np.linalg.norm(rest, axis=1)
        for why, read, own in (
            ("mean", found.result.unknowns(name), mean),
            ("deviation", found.result.deviation(name), deviation),
        ):
            least = measure.SCATTER * np.abs(mean).max()
            yield why, name, float(np.abs(np.ravel(read) - own).max() / max(np.abs(own).max(), least, 1e-300))


def has_answer(case: Case, problem: Any, found: Found) -> bool:
    """Whether something can balance the loads of each run that has converged."""
    for k, values in enumerate(case.values(found)[0]):
        for time in case.times or [None]:
            laws = case.laws(time, values)
            loads = given_loads(problem, laws, time)
            if found.status[k] == "converged" and not measure.has_balance(problem, laws, loads, time):
                return False
    return True


def compare(
    case: Case, problem: Any, found: Found, rtol: float, phase: Callable[[str], None] = lambda _: None
) -> tuple[list[Error], str, float, float]:
    """All errors of a run, how the truth was found, what rounding explains, and the error in one number.

    Where friction allows several answers, the nearest counts: it is found from the run's own.

    Raises
    ------
    Inadmissible, Unsolved
        There is no truth to compare with.
    """
    phase("reference")
    how = "assembled"
    model = model_of(case, problem, found.plan.active)
    values, probabilities = case.values(found)
    all_errors: list[Error] = []
    every: list[list[Answer]] = []
    largest = 0.0
    if case.kind == "chaos":
        linear = all(isinstance(law, LINEAR) for law in case.laws().values())
        if linear:
            every = [galerkin_truth(case, problem, found, model)]
            how = "Galerkin"
        else:
            every, how = tight_truth(case, problem, found), "two tight runs"
    else:
        for k, value in enumerate(values):
            try:
                every.append(truth(case, problem, found, model, k, value))
            except Unsolved:
                # friction may hide its answers: look next to the one that is claimed (torn glue claims all)
                glue = any(isinstance(law, lf.Debonding) for law in case.laws().values())
                if glue or found.status[k] != "converged":
                    raise
                every.append(truth(case, problem, found, model, k, value, warm=True))
                how = "assembled, from the answer that is judged"
    for k, answers in enumerate(every):
        if found.status[k] != "converged":
            continue
        label = ""
        if case.kind in ("samples", "sweep"):
            label = f"{'sample' if case.kind == 'samples' else 'point'} {k}"
        kind = "chaos" if case.kind == "chaos" else ""

        def errors_of(answers: list[Answer], k: int = k, label: str = label, kind: str = kind) -> list[Error]:
            steps = case.times is not None
            return measure.errors(model.norms, found.fields[k], answers, found.said[k], kind, label, steps)

        mine = errors_of(answers)
        largest = max(largest, measure.whole(model.norms, found.fields[k], answers))
        nonlinear = how == "two tight runs" if case.kind == "chaos" else bool(model.rows)
        if nonlinear and max((e.true for e in mine), default=0.0) > 0.3 * FACTOR * max(found.said[k], 1e-14):
            # where friction or softening allow several answers, the nearest counts
            for cold in ((), answers) if case.kind != "chaos" else ((),):
                try:
                    if case.kind == "chaos":
                        nearest = tight_truth(case, problem, found, same=True)[k]
                    else:
                        nearest = truth(case, problem, found, model, k, values[k], warm=True, cold=cold)
                    warm = errors_of(nearest)
                except Unsolved:
                    continue
                closer = max((e.true for e in warm), default=0.0) < 0.5 * max(e.true for e in mine)
                if closer and same_branch(answers, nearest):
                    how = how.split(",")[0] + ", nearest to the run"
                    if too_large(mine, rtol) and not too_large(warm, rtol):
                        how = SEVERAL
                    mine = warm
                    every[k] = nearest
                    largest = measure.whole(model.norms, found.fields[k], nearest)
                    break
        all_errors += mine
    if case.kind == "samples" and all(s == "converged" for s in found.status):
        said = found.result.scatter_error
        single = [fields[0] for fields in found.fields]
        exact = [answers[0] for answers in every]
        all_errors += measure.spread(
            model.norms, single, exact, np.asarray(probabilities), said, "samples"
        )
    rounding = 0.0
    for answers in every:
        exact = [answer.fields for answer in answers]
        kind = "chaos" if case.kind == "chaos" else ""
        floors = [e.floor for e in measure.errors(model.norms, exact, answers, 0.0, kind)]
        # what is mostly rounding is no size to be right about, but a reason to say so
        inexact = "inexact" in found.status
        rounding = max([rounding] + [f for f in floors if f < 0.1 or inexact])
    if case.kind == "samples":
        exact = [answers[0].fields for answers in every]
        first = [answers[0] for answers in every]
        scatter = measure.spread(model.norms, exact, first, np.asarray(probabilities), 0.0, "samples")
        rounding = max([rounding] + [e.floor for e in scatter if e.floor < 0.1 or inexact])
    return all_errors, how, rounding, largest


RESOLUTION = 2e-9
"""Estimates of nonlinear laws below this are bounds."""
LINEAR = (lf.Elastic, lf.Perfect, lf.Displacement, lf.Symmetry, lf.Pressure, lf.Traction)


SEVERAL = "one of several answers"


def too_large(errors: list[Error], rtol: float) -> list[Error]:
    """Those that make an answer wrong."""
    return [e for e in errors if e.true > FACTOR * rtol or e.true > FACTOR * e.said]


def judged(verdict: Verdict, errors: list[Error], rtol: float, direct: bool) -> None:
    """Whether a converged run is right."""
    bad = too_large(errors, rtol)
    worst = sorted(bad or errors, key=lambda e: -e.true)
    verdict.errors = [str(e) for e in worst[:6]]
    if errors:
        top = max(errors, key=lambda e: e.true)
        verdict.true, verdict.said = top.true, top.said
        plain = [e for e in errors if not e.place.startswith("samples")]
        top = max(plain, key=lambda e: e.true, default=top)
        bounded = top.true <= top.said <= RESOLUTION
        if not direct and top.true > 0.0 and not bounded:
            # an estimate includes rounding, and cannot be too large by what is not known of the truth
            found = max(e.raw for e in plain) if plain else top.raw
            verdict.ratio = top.said / top.true
            verdict.ratio = min(verdict.ratio, max(top.said / found, 1.0))
    if bad:
        verdict.outcome = "wrong"
        large = [e for e in bad if e.true > FACTOR * rtol]
        verdict.why = "tolerance" if large else "estimate"
        if large and all("fluctuation" in e.place for e in large):
            verdict.why = "scatter of samples" if "samples" in large[0].place else "fluctuation"
        verdict.what = f"{len(bad)} of {len(errors)} errors too large: {worst[0]}"
    else:
        verdict.outcome = "several" if verdict.reference == SEVERAL else "right"


def judge(seed: int, phase: Callable[[str], None] = lambda _: None, kind: str | None = None) -> Verdict:
    """Draw, solve, compare; a scene that turns out to be inadmissible is drawn again.

    Parameters
    ----------
    seed
        Of the scene.
    phase
        Told what begins: for whoever watches the time.
    """
    for attempt in range(ATTEMPTS):
        phase(f"attempt {attempt}")
        verdict = one(scenes.scene(seed, attempt, kind, 1), phase)
        verdict.attempt = attempt
        if verdict.outcome != "inadmissible":
            break
    return verdict


def judge_ranked(seed: int, comm: Any, phase: Callable[[str], None] = lambda _: None) -> Verdict:
    """As :func:`judge`, on all ranks of a communicator; the first one has the verdict."""
    for attempt in range(ATTEMPTS):
        verdict = one(scenes.scene(seed, attempt, None, comm.size), phase, comm=comm)
        verdict.attempt = attempt
        if comm.bcast(verdict.outcome, root=0) != "inadmissible":
            break
    return verdict


def show(space: Mapping[str, Any], kind: str, rtol: float) -> None:
    """What a scene's script prints: true errors beside what the result says."""
    from mpi4py import MPI

    comm = MPI.COMM_WORLD if MPI.COMM_WORLD.size > 1 else None
    drawn = scenes.Scene(0, "", kind, "", rtol, 1 if comm is None else comm.size, "")
    verdict = one(drawn, lambda _: None, comm=comm, space=space)
    if comm is not None and comm.rank > 0:
        return
    print(f"{verdict.status} after {verdict.iterations} iterations")
    print(f"asked for {rtol:.0e}, says {verdict.said}")
    print(f"{verdict.outcome} (reference: {verdict.reference}): {verdict.what}")
    for line in verdict.errors:
        print("  " + line)


def one(
    drawn: scenes.Scene,
    phase: Callable[[str], None] = lambda _: None,
    perturb: float = 0.0,
    comm: Any = None,
    space: Mapping[str, Any] | None = None,
) -> Verdict:
    """One scene as it was drawn.

    Parameters
    ----------
    perturb
        Relative error that is added to the answer: a test of the campaign itself.
    comm
        Communicator of several ranks; None: one.
    space
        Names of a script that has run already, instead of the drawn text.
    """
    verdict = Verdict(
        drawn.seed, "crashed", family=drawn.family, kind=drawn.kind, about=drawn.about, rtol=drawn.rtol
    )
    verdict.script = scenes.script(drawn)
    began = perf_counter()

    def spent(what: str) -> None:
        verdict.seconds[what] = round(perf_counter() - began - sum(verdict.seconds.values()), 3)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        case = Case(drawn.source if space is None else space, drawn.kind)
        phase("assemble")
        try:
            problem = case.assemble(comm)
        except lf.SceneError as error:
            verdict.outcome, verdict.what = "inadmissible", f"assemble: {type(error).__name__}: {error}"
            return verdict
        spent("assemble")
        phase("solve")
        problem_here, failure, found = problem, None, None
        try:
            found = case.run(problem) if comm is None else ranked(case, problem, comm)
        except Exception as error:  # whatever it is, it is a finding
            failure = error
            verdict.what = f"{type(error).__name__}: {error}"[:600]
            verdict.errors = traceback.format_exc().splitlines()[-4:]
        spent("solve")
        if comm is not None:
            if comm.rank > 0:
                return verdict
            problem_here = case.assemble()
        if found is None:
            assert failure is not None
            _exception(case, problem_here, verdict, failure)
            spent("reference")
            return verdict
        if perturb:
            for run in found.fields:
                for step in run:
                    for name in step:
                        step[name] = step[name] * (1.0 + perturb)
        told = len(found.fields), len(found.status), len(found.said)
        if set(told) != {len(case.values(found)[0])}:
            verdict.outcome, verdict.why = "wrong", "lost"
            verdict.what = f"{told} fields, statuses and errors of {len(case.values(found)[0])} runs"
            return verdict
        verdict.status = max(found.status, key=lambda s: ("converged", s).index(s))
        verdict.said, verdict.iterations = max(found.said), found.iterations
        rtol, lost = drawn.rtol, False
        try:
            compared = compare(case, problem_here, found, rtol, phase)
            errors, verdict.reference, verdict.rounding, verdict.whole = compared
            judged(verdict, errors, rtol, found.direct)
        except (Inadmissible, Unsolved) as reason:
            verdict.outcome = "inadmissible" if isinstance(reason, Inadmissible) else "unjudged"
            verdict.what = f"{verdict.status}; reference: {reason}"
            lost = isinstance(reason, Contradiction) or not has_answer(case, problem_here, found)
        both = zip(found.status, found.said, strict=True)
        unknown = any(status == "converged" and not 0.0 <= error < np.inf for status, error in both)
        if unknown and verdict.outcome != "wrong":
            verdict.outcome, verdict.why = "wrong", "estimate"
            verdict.what = "converged, and the error that is said is no number"
        if comm is None and verdict.outcome != "wrong" and "converged" in found.status:
            _side_conditions(case, problem_here, found, verdict, rtol)
            if lost and verdict.outcome != "wrong":
                verdict.outcome, verdict.why = "wrong", "no answer"
        spent("reference")
        if verdict.outcome == "inadmissible":
            return verdict
        if verdict.outcome in ("right", "several") and verdict.status != "converged":
            stuck = sum(s != "converged" for s in found.status)
            verdict.outcome = "rounding" if verdict.rounding > rtol / FACTOR else "not_converged"
            verdict.what = f"{verdict.status}: {stuck} of {len(found.status)}, said {verdict.said:.1e}"
            verdict.what += f", {found.iterations} iterations"
            plain = found.plan.options.acceleration == 0
            verdict.why = verdict.status + (", not accelerated" if plain else "")
            verdict.ratio = None
    return verdict


def _side_conditions(case: Case, problem: Any, found: Found, verdict: Verdict, rtol: float) -> None:
    """Laws and balance of each step, and what is read of a scatter: they need no reference."""
    least = max(FACTOR * verdict.rounding, 1e-9)
    allowed = max(FACTOR * rtol, min(BALANCE * rtol, LARGE), least)
    for (why, where, size), most in (
        *((each, allowed) for each in offences(case, problem, found)),
        *((each, least) for each in misread(case, found)),
    ):
        if not size <= most:
            verdict.outcome, verdict.why = "wrong", why
            verdict.errors.append(f"{why}: {where}: {size:.2e}")
    if verdict.outcome == "wrong":
        verdict.what = verdict.errors[-1]


def _exception(case: Case, problem: Any, verdict: Verdict, failure: Exception) -> None:
    """An exception is right only where there is no answer."""
    verdict.outcome = "raised"
    if isinstance(failure, lf.IndefiniteError):
        verdict.outcome = "refused"
        return
    try:
        perfect = {n: i for n, i in problem.interfaces.items() if isinstance(i.law, lf.Perfect)}
        active = [n for n, i in perfect.items() if i.matching is None]
        model = model_of(case, problem, active)
        histories(model, case.laws, case.times)
    except Inadmissible:
        verdict.outcome = "inadmissible"
    except Unsolved:
        verdict.outcome = "refused" if isinstance(failure, lf.SceneError) else "raised"


def ranked(case: Case, problem: Any, comm: Any) -> Found | None:
    """A run on several ranks, its displacements gathered on the first."""
    result = case.space["run"](problem)
    own = {name: np.asarray(result.displacements[name]) for name in problem.substructures}
    gathered = comm.gather(own, root=0)
    if comm.rank > 0:
        return None
    fields = case._steps({name: u for each in gathered for name, u in each.items()})
    said = [float(result.error)]
    return Found(result.plan, [fields], said, [result.status], result.iterations, False, result)
