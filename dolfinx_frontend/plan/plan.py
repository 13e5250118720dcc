"""The plan: what of a scene is modelled, and how, decided before anything is factorised.

Interfaces that are linear and fixed are assembled across, so that they cost nothing afterwards, and the
iteration runs on the others. Every decision carries its reason and can be overridden.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from dolfinx_frontend.assembly.held import check_determined, check_held
from dolfinx_frontend.assembly.problem import Problem, check_is_problem
from dolfinx_frontend.assembly.ranks import exchanged, together
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import (
    check_kind,
    check_known,
    check_optional_kind,
    checked_names,
    checked_number,
    checked_numbers,
)
from dolfinx_frontend.common.describe import record, short
from dolfinx_frontend.common.errors import MemoryLimitError, SceneError
from dolfinx_frontend.common.frozen import frozen, locked
from dolfinx_frontend.common.html import table
from dolfinx_frontend.common.memory import available_memory
from dolfinx_frontend.plan.coarse import Moments
from dolfinx_frontend.plan.cost import (
    Cost,
    blocks_fit,
    bodies_of,
    predict,
    shown,
)
from dolfinx_frontend.plan.newton import Newton, fitting, newton_of
from dolfinx_frontend.plan.prescribed import check_prescribed, moments_of, spanning
from dolfinx_frontend.plan.price import Price, Way, price
from dolfinx_frontend.plan.random_laws import RandomLaws
from dolfinx_frontend.plan.reduction import members_of_bodies, wholly_held
from dolfinx_frontend.scene.amplitudes import Amplitude, Varying, amplitudes_of, check_times
from dolfinx_frontend.scene.laws import Elimination, Law
from dolfinx_frontend.scene.loads import LoadTerm
from dolfinx_frontend.scene.values import is_plain, is_zero
from dolfinx_frontend.uncertainty.chaos import Chaos
from dolfinx_frontend.uncertainty.fields import DiscretisedField
from latin_core import Options, stochastic

__all__ = [
    "Decision",
    "Direction",
    "Method",
    "Plan",
    "check_problem",
    "check_settings",
    "make_plan",
    "plan_for",
    "plan_of_random",
]

_log = logging.getLogger(__name__)
Method = Literal["auto", "direct", "accelerated", "latin"]

_PLAIN_FACTOR = 2.0
_ACCELERATED_FACTOR = 3.0
_MACRO_FACTOR = 10.0
_FEW, _MANY = 2, 3
"""Fewest interfaces between parts for which a coarse problem pays: with matrix directions, and without."""
_UNMATCHED = "its meshes do not match"
_UNGLUED, _JOINS = "its jump cannot be glued", "it joins several nodes"
_ASKED = "asked for"
_PAPER = "the paper keeps them all"
_RANKS = "its sides lie on two ranks"
_CUT = (_UNMATCHED, _UNGLUED, _ASKED, _PAPER, _RANKS)
"""Reasons to keep an interface whose law is linear and fixed."""
_DRAWS = 64
"""Samples among which some span what random displacements can be."""


class Decision(NamedTuple):
    """One line of the plan."""

    what: str
    choice: str
    reason: str


REACH = 1e6
"""Factors of E / L up to which, and 1 / which down to which, a search direction leaves digits to an answer.
At 1e10 six of them are left, at 1e12 none."""


def check_reach(what: str, *factors: float, reach: float = REACH) -> None:
    """Refuse search directions so far from E / L that rounding takes the answer.

    Raises
    ------
    SceneError
        A factor of E / L beyond `reach`.
    """
    for factor in factors:
        if not 1.0 / reach <= factor <= reach:
            raise SceneError(
                f"search direction: {what} is {factor:.1g} E/L; beyond {1.0 / reach:g} to {reach:g} E/L "
                "rounding takes the answer: leave it out, or stay near 1 to 10 E/L"
            )


@dataclass(frozen=True, repr=False)
class Direction:
    """Search direction k of every interface, force / length^3: a parameter of the method, not of the model.

    Attributes
    ----------
    factor
        k = factor * E / L; None: 2 for the plain iteration, 3 for the accelerated one, 10 with a coarse
        problem (measured).
        When accelerated, elastic interfaces softer than that take twice their own stiffness; contacts take
        a third of it where there is no coarse problem.
    length
        L; None: the size of the scene, (sum of volumes)^(1/d), or of a contact, area^(1/(d-1)), if that is
        smaller; with a coarse problem, which sees the scene as a whole, the mean size of a body.
    given
        Interface name -> k, a number or one value per point; goes before the factor.
    """

    factor: float | None = None
    length: float | None = None
    given: Mapping[str, Any] = field(default_factory=dict)

    def __repr__(self) -> str:
        return record(self)

    def __post_init__(self) -> None:
        for name, value in (("factor", self.factor), ("length", self.length)):
            if value is not None:
                checked_number("search direction", name, value, above=0.0)
        if self.factor is not None:
            check_reach(f"factor = {self.factor:g}", self.factor)
        check_kind("search direction", "given", self.given, Mapping, "give {interface: number or numbers}")
        for name, value in self.given.items():
            where, wanted = f"search direction of interface {name!r}", "it must be positive and finite"
            if not np.all(checked_numbers(where, "given", value, wanted) > 0.0):
                raise SceneError(f"{where}: given = {value!r}: {wanted}")
        object.__setattr__(self, "given", frozen(self.given))


@dataclass(frozen=True, repr=False)
class Plan:
    """What will be done with a problem.

    Attributes
    ----------
    method
        ``"direct"`` (no iteration), ``"accelerated"`` or ``"latin"`` (the plain iteration of 2004).
    active
        Interfaces that the iteration runs on, in the scene's order.
    eliminated
        Interface -> how it is assembled into the bodies.
    columns
        Columns of every field: 1 when nothing is random and nothing has a history.
    direction, options
        Search direction and settings of the iteration.
    macro, moments
        Interfaces in the coarse problem, and whether it balances resultants or linear moments.
    paired
        Linear, fixed interfaces whose step is solved for with both of their parts.
    decisions
        All of it with reasons; ``print(plan)`` shows them.
    times
        (T,) of a load history; None: there is none.
    patterns
        The amplitudes of the load patterns; None stands for what is constant in time.
    history
        What a history needs: ``"none"`` (nothing changes in time: one column answers for all times),
        ``"patterns"`` (linear: one column per load pattern, superposed) or ``"steps"`` (one column per time).
    loads, load_means
        Numbers of loads of parts that vary, each with a load pattern of its own, and their means.
    scaled
        Parts whose stiffness varies by a factor.
    fields
        Parts with a random field in their stiffness.
    cost
        Predicted operations and bytes; ``result.spent()`` sets them beside what was spent.
    price
        Predicted processor time and memory of the run as a whole, in direct solves, too.
    """

    method: Literal["direct", "accelerated", "latin"]
    active: tuple[str, ...]
    eliminated: dict[str, str]
    columns: int
    direction: Direction
    options: Options
    decisions: tuple[Decision, ...]
    times: npt.NDArray[np.float64] | None = None
    patterns: tuple[Amplitude | None, ...] = (None,)
    history: Literal["none", "patterns", "steps"] = "none"
    cost: Cost | None = None
    macro: tuple[str, ...] = ()
    moments: Moments = "linear"
    paired: tuple[str, ...] = ()
    loads: tuple[LoadTerm, ...] = ()
    load_means: tuple[float, ...] = ()
    scaled: tuple[str, ...] = ()
    fields: tuple[str, ...] = ()
    price: Price | None = None

    def __post_init__(self) -> None:
        locked(self)

    @property
    def steps(self) -> int:
        """Columns that are the time steps of one history."""
        return len(self.times) if self.history == "steps" and self.times is not None else 1

    def shares_factors(self, other: Plan) -> bool:
        """Whether both keep the same interfaces and load the parts alike: one factorisation serves both."""
        names = [
            *("method", "active", "eliminated", "direction", "patterns", "history", "macro", "moments"),
            *("paired", "loads", "scaled", "fields"),
        ]
        times = self.times is other.times or np.array_equal(np.asarray(self.times), np.asarray(other.times))
        return times and all(getattr(self, n) == getattr(other, n) for n in names)

    def factors(self) -> npt.NDArray[np.float64]:
        """Factor of every load pattern at every time, (l, T); (1, 1) without a history."""
        times = [0.0] if self.times is None else self.times
        return np.array([[1.0 if a is None else a(t) for t in times] for a in self.patterns])

    @property
    def measured_by_step(self) -> bool:
        """Whether errors are estimated at every time, of columns or of sums of load patterns."""
        return self.history == "steps" or self._measures_sums

    @property
    def measured_in_time(self) -> npt.NDArray[np.float64] | None:
        """Factors (l, T) of load patterns whose sums at the times are what errors are estimated of.

        None: they are estimated of the columns.
        """
        return np.asfortranarray(self.factors()) if self._measures_sums else None

    @property
    def amplitudes(self) -> npt.NDArray[np.float64]:
        """Amplitudes (l, columns) of the load patterns, for columns that are no chaos modes.

        First those of the amplitudes, then those of the loads that vary, at their means.
        """
        base = self.fixed_amplitudes
        if self.loads:
            base = np.vstack([base, np.reshape(self.load_means, (-1, 1)) * self.load_factors])
        return np.asfortranarray(base)

    @property
    def fixed_amplitudes(self) -> npt.NDArray[np.float64]:
        """Those of the loads that do not vary, (patterns, columns)."""
        return self.factors() if self.history == "steps" else np.eye(len(self.patterns))

    @property
    def varied(self) -> tuple[str, ...]:
        """Parts whose stiffness varies."""
        return (*self.scaled, *self.fields)

    @property
    def load_factors(self) -> npt.NDArray[np.float64]:
        """What a number 1 of every load that varies is in the columns, (loads, columns)."""
        if self.history == "patterns":
            rows = [[float(a == term.amplitude) for a in self.patterns] for term in self.loads]
        elif self.history == "steps" and self.times is not None:
            rows = [
                [1.0 if (a := term.amplitude) is None else a(t) for t in self.times] for term in self.loads
            ]
        else:
            rows = [[1.0] for _ in self.loads]
        columns = self.fixed_amplitudes.shape[1]
        return np.reshape(np.array(rows, dtype=np.float64), (len(self.loads), columns))

    def column_factors(self, amplitude: Amplitude) -> npt.NDArray[np.float64]:
        """What an amplitude is in the columns of a history, (columns,)."""
        if self.history == "patterns":
            return np.array([float(a == amplitude) for a in self.patterns])
        return np.array([amplitude(t) for t in ([] if self.times is None else self.times)])

    def in_time(self, block: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Columns of a field (..., columns) as its values at all times, (T, ...)."""
        if self.history != "steps":
            block = block @ (self.factors() if self.history == "patterns" else np.ones((1, self._count)))
        return np.moveaxis(block, -1, 0)

    @property
    def _measures_sums(self) -> bool:
        return self.history == "patterns" and len(self.patterns) > 1 and not self.fields

    @property
    def _count(self) -> int:
        return 1 if self.times is None else len(self.times)

    def __repr__(self) -> str:
        return (
            f"Plan({self.method}, active: {', '.join(self.active) or 'nothing'}; {len(self.eliminated)} "
            f"interfaces eliminated, {self.columns} columns; print it for the reasons)"
        )

    def _repr_html_(self) -> str:
        rows = [(d.what, d.choice, d.reason) for d in self.decisions]
        return table(("decision", "choice", "because"), rows, (True,) * 3, ())

    def __str__(self) -> str:
        width = max(len(d.what) for d in self.decisions)
        lines = ["Plan"]
        for d in self.decisions:
            lines.append(f"  {d.what:<{width}}  {d.choice}")
            lines.append(f"  {'':<{width}}    because {d.reason}")
        return "\n".join(lines)


def check_problem(where: str, problem: object, plan: object = None) -> None:
    """Refuse what is no problem (a scene that was not assembled), no plan, or a plan of another problem.

    Raises
    ------
    SceneError
        Which of them, and what would do.
    """
    check_is_problem(where, problem)
    check_optional_kind(where, "plan", plan, Plan, "give what make_plan(problem) returned")
    if isinstance(plan, Plan) and isinstance(problem, Problem):
        for name in (*plan.active, *plan.eliminated):
            check_known("interface", name, problem.interfaces, f"{where}: the plan is of another problem")


def check_keeps(
    where: str,
    plan: Plan,
    interfaces: Iterable[str],
    loads: Iterable[LoadTerm] = (),
    parts: Iterable[str] = (),
) -> None:
    """Refuse a plan that eliminates interfaces whose laws are random: at their means nothing would vary."""
    fixed = [f"{term.load}.{term.parameter}" for term in loads if term not in plan.loads]
    if fixed:
        raise SceneError(
            f"{where}: the plan has no column for {', '.join(fixed)}, which is random: leave the plan out, "
            "or make it for what is random"
        )
    stiff = [name for name in parts if name not in plan.varied]
    if stiff:
        raise SceneError(
            f"{where}: the plan has no factor for the stiffness of {', '.join(map(repr, stiff))}, which is "
            "random: leave the plan out, or make it with scaled=[...]"
        )
    lost = [name for name in interfaces if name in plan.eliminated]
    if lost:
        raise SceneError(
            f"{where}: the plan eliminates {', '.join(map(repr, lost))}, whose law is random: leave the plan "
            f"out, or make it with vary={lost}"
        )


def check_settings(where: str, plan: Plan | None, method: object = "auto", **given: object) -> None:
    """Refuse settings beside a plan, which has its own."""
    if plan is None:
        return
    asked = {"method": None if method == "auto" else method, **given}
    for name, value in asked.items():
        if value is not None:
            raise SceneError(
                f"{where}: {name} = {short(value)} beside plan=; give it to make_plan, or leave plan out"
            )


def _names(problem: Problem, given: Iterable[str], where: str) -> set[str]:
    names = checked_names(where, "interfaces", given)
    for name in names:
        check_known("interface", name, problem.interfaces, where)
    return set(names)


def _one_column(problem: Problem) -> str:
    """Why a run without chaos has one column."""
    random = [
        f"{name}.{parameter}"
        for name, interface in problem.interfaces.items()
        for parameter, value in interface.law.parameters().items()
        if not is_plain(value) and hasattr(value, "mean")
    ]
    random += [f"stiffness of {name}" for name in problem.factors]
    random += dict.fromkeys(
        f"{term.load}.{term.parameter}"
        for term in problem.load_terms
        if not all(is_plain(n.number) for n in problem.numbers_of(term))
    )
    if random:
        return f"no chaos was asked for: {', '.join(random)} at the mean"
    return "nothing is random and no law has a history"


def plan_for(random: RandomLaws, way: Way, **settings: Any) -> Plan:
    """The plan of a way to moments, with the settings of :func:`make_plan`; it need not fit."""
    settings["way"] = way._replace(random=random)
    if way.modes:
        settings |= {"random": random, "columns": way.modes}
    return make_plan(
        random.problem,
        vary=random.interfaces,
        loads=random.loads,
        scaled=random.scaled,
        fields=random.fields,
        **settings,
    )


def plan_of_random(where: str, random: RandomLaws, given: Plan | None, way: Way, **settings: Any) -> Plan:
    """A given plan that keeps what is random, or one made for it with the settings of :func:`make_plan`.

    Raises
    ------
    SceneError
        The given one eliminates something random, random displacements contradict others, or the way needs
        more memory than there is.
    """
    if given is not None:
        check_keeps(where, given, random.interfaces, random.loads, random.parts)
    plan = plan_for(random, way, **settings) if given is None else given
    _check_random(random, plan.eliminated, plan.times)
    if given is not None:
        return given
    free = available_memory() if random.problem.comm is None else np.inf  # ranks would not decide alike
    price = plan.price
    if price is not None and price.memory > _SURE * free and plan.options.backend != "multigrid":
        what = f"{way.modes} modes" if way.modes else f"{way.points} points"
        raise MemoryLimitError(
            f"{where}: {what} need about {shown(price.memory, 'B')}, and {shown(free, 'B')} are free: take "
            "fewer of them; compare_ways(problem) says what fits"
        )
    return plan


def checked_chaos(chaos: Chaos | int) -> Chaos:
    """A chaos, or that of an order."""
    return chaos if isinstance(chaos, Chaos) else Chaos(order=chaos)


def plan_of_chaos(
    random: RandomLaws, chaos: Chaos, given: Plan | None, *, options: Options | None, **settings: Any
) -> tuple[stochastic.ChaosBasis, Plan]:
    """The modes of a chaos, and a given plan that keeps what is random, or one made for it.

    Raises
    ------
    SceneError
        As of :func:`plan_of_random`, or nothing is random.
    """
    if not random.every:
        raise SceneError(
            "chaos: nothing is random: give a law or a load a random parameter, or solve without chaos"
        )
    problem, times = random.problem, settings["times"]
    options = options or (Options.plain() if settings["method"] == "latin" else Options())
    rows = sum(2 * problem.dim * problem.interfaces[n].num_points for n in random.interfaces)
    history = len(check_times(times)) if times is not None and problem.amplitudes else 1
    basis = random.space.basis(chaos, rows=history * (problem.size + rows * (4 + 3 * options.acceleration)))
    way = Way(None, len(basis), chaos.order, chaos.check_points)
    return basis, plan_of_random("chaos", random, given, way, options=options, **settings)


def _check_random(random: RandomLaws, eliminated: Container[str], times: Array | None) -> None:
    """As :func:`check_prescribed`, of samples of what is random; a random field counts as one number, which
    agrees with no other; collective."""
    problem = random.problem
    laws = {name: problem.interfaces[name].law for name in random.interfaces}
    given = {key: s for key, s in random.sources.items() if laws[key[0]].prescribes == "jump"}
    if not given:
        return
    points = random.space.sample(_DRAWS, 0)
    values = np.array([np.atleast_2d(random.space.values(s, points))[0] for s in given.values()])
    for k in spanning(values):
        now: dict[str, Law] = {}
        for (name, parameter), value in zip(given, values[:, k].tolist(), strict=True):
            amplitude = random.amplitude(name, parameter)
            changed = {parameter: value if amplitude is None else amplitude * value}
            now[name] = now.get(name, laws[name]).with_(**changed)
        one = problem.with_laws(now)
        try:
            check_prescribed(one, eliminated, moments_of(one, times))
        except SceneError as failure:
            raise SceneError(f"{failure}; random ones agree where they are the same random number") from None


@together("make_plan")
def make_plan(
    problem: Problem,
    method: Method = "auto",
    active: Sequence[str] | Literal["all"] | None = None,
    vary: Iterable[str] = (),
    direction: Direction | float | None = None,
    options: Options | None = None,
    random: RandomLaws | None = None,
    columns: int = 1,
    times: npt.ArrayLike | None = None,
    loads: Iterable[LoadTerm] = (),
    scaled: Iterable[str] = (),
    fields: Mapping[str, DiscretisedField] | None = None,
    way: Way | None = None,
    chaos: Chaos | int | None = None,
) -> Plan:
    """Decide what is modelled.

    Parameters
    ----------
    problem
        The assembled problem.
    method
        ``"latin"``: the paper's iteration, every interface kept, no acceleration.
        ``"accelerated"``: elastic two-sided interfaces kept. ``"direct"``: nothing kept.
        ``"auto"``: only what varies is kept, so that a fixed linear scene is solved directly.
    active
        Interfaces to keep in any case, or ``"all"``.
    vary
        Interfaces whose law varies (swept or random parameters): they stay active.
    direction
        Search direction; a number is its factor.
    options
        Settings of the iteration.
    random, columns
        What is random, and the number of chaos modes.
    times
        Times (T,) of a load history, increasing; the state before the first is unloaded and unslipped.
    loads
        Numbers of loads of parts that vary: each has a load pattern of its own.
    scaled
        Parts whose stiffness varies by a factor: what joins them to others stays active.
    fields
        Parts with a random field in their stiffness: what joins them to others may be eliminated.
    way
        Modes or points, of which the price is told; None: of one solution.
    chaos
        As for :func:`dolfinx_frontend.solve`: the plan, and the price, of a chaos of all that is random.

    Raises
    ------
    SceneError
        Unknown method or interface, or an interface that cannot be modelled as asked.
    """
    _check_request(problem, method, options)
    if chaos is not None:
        told: dict[str, Any] = {"method": method, "active": active, "direction": direction, "times": times}
        return plan_of_chaos(RandomLaws.of(problem), checked_chaos(chaos), None, options=options, **told)[1]
    if problem.loosened:
        check_held(problem)
    check_determined(problem)
    moments = _moments_in_time(problem, times)
    varying = tuple(vary)
    factors = tuple(dict.fromkeys(scaled))
    reasons, eliminated = _split(problem, _wanted(problem, method, active, varying, factors))
    kept = tuple(name for name in problem.interfaces if name in reasons)
    if method == "direct" and kept:
        raise SceneError(
            f"method 'direct' cannot be used: {', '.join(kept)} must stay active "
            f"({reasons[kept[0]]}); use 'auto'"
        )
    chosen, options, reason = _iteration(kept, method, options)
    blocks = factors or (fields and random is not None)  # what they are solved with needs dense blocks
    if blocks and options.operator == "automatic" and blocks_fit(problem, kept, options):
        options = options.with_(operator="condensed")
    cut = [n for n in kept if reasons[n] in _CUT and problem.interfaces[n].law.superposes]
    varied = tuple(loads)
    constant = any(term.amplitude is None for term in varied)
    patterns, history, why = _history(problem, kept, moments, problem.amplitudes, constant)
    steps = len(moments) if history == "steps" and moments is not None else 1
    curved = random is None and chosen == "accelerated" and _is_nonlinear(problem, kept)
    newton = newton_of(problem, kept, steps, options) if curved else Newton()
    early = newton.steps == 1
    zone = newton.dense if early else 0
    macro, balanced, paired, reach = _reach(problem, kept, cut, chosen, options, early and newton.memory > 0)
    direction = _search_direction(problem, direction, chosen, bool(macro))
    columns, of_columns = _columns(problem, random, columns, history, steps, len(patterns), why)

    decisions = [*_of_interfaces(kept, reasons, eliminated), *_of_spaces(problem), *of_columns]
    if varied:
        names = ", ".join(dict.fromkeys(f"{t.load}.{t.parameter}" for t in varied))
        decisions.append(
            Decision(
                "load columns", names, "loads that vary: a column of the right-hand side, no factorisation"
            )
        )
    if factors:
        decisions.append(
            Decision(
                "stiffness factors",
                ", ".join(factors),
                "they vary: diagonal in the modes of the coupling of a part, no second factorisation",
            )
        )
    for name, of_part in (fields or {}).items():
        decisions.append(_of_field(name, of_part, random is not None))
    decisions.append(Decision("iteration", chosen, reason))
    if problem.distribution is not None:
        decisions.append(Decision("ranks", *_ranks(problem)))
    if kept:
        tolerance = Decision("tolerance", f"{options.rtol:g}", "on the estimated relative error")
        decisions += [_of_direction(direction, chosen), *reach, tolerance]
    here = [name for name in kept if name in problem.own.interfaces]
    pairs = [name for name in paired if name in here]
    cost = predict(problem.own, here, columns, options, pairs, early and curved, zone)
    if options.newton == "automatic":
        newton = fitting(problem, newton, cost.direct)
        options = options.with_(newton=newton.steps)
    if newton.choice:
        decisions.append(Decision("Newton's method", newton.choice, newton.reason))
    cost = replace(cost, newton_flops=newton.flops)
    suits = not (factors or fields) and all(problem.interfaces[n].law.superposes for n in kept)
    of_way = way or Way(random, columns if random is not None else 0)

    def priced(backend: Options) -> Price:
        return price(problem, here, cost.rows, backend, of_way, steps, bool(macro))

    options, of_bodies = _backend(problem, kept, options, cost, suits, priced)
    decisions += of_bodies
    decisions.append(Decision("cost", str(cost), f"{cost.unknowns} unknowns, {cost.active} of them active"))
    total = priced(options)
    decisions.append(_of_price(total, of_way))
    _log.info("plan: %s, %d columns, active: %s; %s", chosen, columns, ", ".join(kept) or "nothing", cost)
    return Plan(
        chosen,
        kept,
        eliminated,
        columns,
        direction,
        options,
        tuple(decisions),
        moments,
        patterns,
        history,
        cost,
        macro,
        balanced,
        paired,
        varied,
        tuple(sum(n.mean for n in problem.numbers_of(term)) for term in varied),
        factors,
        tuple(fields or ()),
        total,
    )


def _of_price(total: Price, way: Way) -> Decision:
    """What the run costs as a whole."""
    what = f"{way.points} points" if way.points else f"{way.modes} modes" if way.modes else "one solution"
    known = "as all laws are linear, within a factor of two"
    if not total.sure:
        known = "a nonlinear law may take more or fewer iterations than most do"
    return Decision("price", str(total), f"{what}; {known}")


def _backend(
    problem: Problem,
    kept: Sequence[str],
    options: Options,
    cost: Cost,
    suits: bool,
    priced: Callable[[Options], Price],
) -> tuple[Options, list[Decision]]:
    """How the inside of the bodies is solved for where their factors may not fit into the memory, or take
    long, and why.

    Raises
    ------
    SceneError
        Nothing fits; it says what would.
    """
    multigrid = options.with_(backend="multigrid")
    direct, by_cycles, free, where = _needed(problem, cost)
    if options.backend == "multigrid":
        needs = f"about {shown(by_cycles, 'B')}; factors would need {shown(direct, 'B')}{where}"
        return options, [Decision("bodies", "multigrid, a basis of fields", f"asked for: {needs}")]
    # glue that stays active takes many more cycles
    glue = any(_is_glue(problem, name) for name in kept)
    may = options.backend == "automatic" and suits and not glue
    if direct <= free:
        # of ranks the prices differ, and they must decide alike
        large = cost.unknowns >= _LARGE and problem.distribution is None
        if not may or not large or by_cycles > free:
            return options, []
        by_factors, other = priced(options), priced(multigrid)
        if _WORTH * other.seconds > by_factors.seconds:
            return options, []
        what = f"multigrid, about {other.seconds:.2g} s of processor time and {shown(by_cycles, 'B')}"
        why = f"factors would take {by_factors.seconds:.2g} s and {shown(direct, 'B')}"
        return multigrid, [Decision("bodies", what, why)]
    if may and by_cycles <= _SURE * free:
        return multigrid, [
            Decision(
                "bodies",
                f"multigrid, about {priced(multigrid).seconds:.2g} s of processor time and "
                f"{shown(by_cycles, 'B')}",
                f"factors would need {shown(direct, 'B')}, and {shown(free, 'B')} are free{where}",
            )
        ]
    text = f"factors of {cost.unknowns} unknowns need about {shown(direct, 'B')}"
    if suits:
        text += f", multigrid about {shown(by_cycles, 'B')}"
    text += f", and {shown(free, 'B')} are free{where}"
    if direct > _SURE * free and problem.distribution is None:
        raise MemoryLimitError(f"plan: {text}: {_what_would_do(problem, kept, cost, suits, free)}")
    return options, [Decision("memory", "factors may not fit", text)]


def _is_glue(problem: Problem, name: str) -> bool:
    """Whether an interface joins two parts so that nothing moves between them."""
    interface = problem.interfaces[name]
    return len(interface.sides) == 2 and interface.law.prescribes == "jump"


def _needed(problem: Problem, cost: Cost) -> tuple[float, float, float, str]:
    """Bytes of factors and of multigrid, those that are free, and where; of ranks, on the machine that has
    least for its ranks together, the same on all. Collective."""
    free = available_memory()
    if problem.comm is None:
        return cost.direct, cost.multigrid, free, ""
    machines: dict[str, list[tuple[float, float, float]]] = {}
    mine = MPI.Get_processor_name(), (cost.direct, cost.multigrid, free)
    for name, of_rank in exchanged(problem.comm, mine):
        machines.setdefault(name, []).append(of_rank)
    sums = []
    for every in machines.values():
        direct, multigrid, left = zip(*every, strict=True)
        sums.append((sum(direct), sum(multigrid), min(left), f" for {len(every)} ranks on a machine"))
    return max(sums, key=lambda each: each[0] / max(each[2], 1.0))


_LARGE, _WORTH = 300_000, 2.0
"""Unknowns from which on multigrid may be the faster way, and how many times faster it must be predicted to
be."""


def _what_would_do(problem: Problem, kept: Sequence[str], cost: Cost, suits: bool, free: float) -> str:
    """Remedies where factors do not fit into the memory."""
    bodies = list(bodies_of(problem, tuple(kept)))
    groups = members_of_bodies(problem, set(problem.interfaces).difference(kept))
    each = 8.0 * np.array([body.entries for body in bodies])
    largest = int(np.argmax(each))
    parts, size = groups[largest], shown(float(each[largest]), "B")
    machines = int(np.ceil(cost.direct / max(free, 1.0)))
    found = "take a coarser mesh or a machine with more memory, "
    if len(parts) > 1:
        found += f"keep the {len(parts)} parts around {parts[0]!r} apart (active='all'), "
    else:
        found += f"cut {parts[0]!r}, whose factor needs {size}, into parts with Perfect() between them, "
    found += f"or spread the parts over MPI ranks of {machines} machines like this one"
    if not suits:
        nonlinear = [n for n in kept if not problem.interfaces[n].law.superposes]
        why = f"the laws of {', '.join(map(repr, nonlinear[:3]))} are nonlinear" if nonlinear else (
            "the stiffness of a part varies"
        )
        found += f"; backend='multigrid', about {shown(cost.multigrid, 'B')}, does not suit: {why}"
    return found


_SURE = 1.5
"""Predictions of memory are right within this factor."""


def _of_field(part: str, source: DiscretisedField, chaos: bool) -> Decision:
    """What a random field in a part is modelled by, and what it costs."""
    lost = 100.0 * (1.0 - source.captured)
    how = (
        "conjugate gradients over the modes in every global stage, preconditioned by the factor of the means"
        if chaos
        else "a sample is one factorisation of the body"
    )
    return Decision(
        f"stiffness of {part}",
        f"{source.name}: {len(source.eigenvalues)} modes at {len(source.points)} cells, which lose "
        f"{lost:.3g} % of its variance",
        f"a random field: {how}",
    )


def _check_request(problem: Problem, method: object, options: object) -> None:
    check_problem("plan", problem)
    if not isinstance(method, str) or method not in get_args(Method):
        raise SceneError(f"method {method!r} is not known: use 'auto', 'direct', 'accelerated' or 'latin'")
    check_optional_kind("plan", "options", options, Options, "give Options(rtol=...)")


def _moments_in_time(problem: Problem, times: npt.ArrayLike | None) -> Array | None:
    """Times (T,) of a load history; None: there is none, and nothing that would need one."""
    if times is not None:
        moments = check_times(times)
        for name, interface in problem.interfaces.items():
            skipped = interface.law.skipped(moments)
            if skipped:
                raise SceneError(f"interface {name!r}: {skipped}: add such a time to times=[...]")
        return moments
    passing = [name for name, i in problem.interfaces.items() if i.law.released is not i.law]
    if problem.amplitudes or passing:
        changing = [name for name, i in problem.interfaces.items() if i.law.varying or name in passing]
        changing += [name for name, s in problem.substructures.items() if s.varying_loads]
        changing += dict.fromkeys(t.load for t in problem.load_terms if t.amplitude is not None)
        raise SceneError(
            f"{', '.join(repr(n) for n in changing)}: values change in time: solve with times=[...]"
        )
    return None


def _is_nonlinear(problem: Problem, kept: Sequence[str]) -> bool:
    return not all(problem.interfaces[n].law.superposes for n in kept)


def _search_direction(
    problem: Problem, given: Direction | float | None, chosen: str, macro: bool
) -> Direction:
    """The search direction with its factor, for an iteration with or without a coarse problem."""
    if not isinstance(given, Direction):
        if given is not None:
            checked_number("plan", "direction", given, above=0.0)
            check_reach(f"direction = {given:g}", given)
        given = Direction(factor=given)
    _names(problem, given.given, "search direction")
    if given.factor is not None:
        return given
    factor = _PLAIN_FACTOR if chosen == "latin" else _ACCELERATED_FACTOR
    return Direction(_MACRO_FACTOR if macro else factor, given.length, given.given)


def _wanted(
    problem: Problem,
    method: Method,
    active: Sequence[str] | Literal["all"] | None,
    vary: Iterable[str],
    scaled: Sequence[str] = (),
) -> dict[str, str]:
    """Interfaces that are kept whatever their law allows -> why."""
    reasons = dict.fromkeys(problem.cuts, _RANKS)
    reasons |= _around(problem, scaled)
    for name in _names(problem, vary, "plan"):
        reasons[name] = "its law varies"
    for name, interface in problem.interfaces.items():
        if set(interface.law.varying) - set(interface.law.loading) and reasons.get(name, _RANKS) == _RANKS:
            reasons[name] = "its law changes in time"
    tied = [n for n in reasons if problem.interfaces[n].law.elimination is Elimination.TIED]
    if tied:
        raise SceneError(
            f"plan: {', '.join(map(repr, tied))} ties nodes to a rigid motion and cannot vary: its motion is "
            "no parameter; vary a load or a spring on it"
        )
    everything = isinstance(active, str) and active == "all"
    if everything or (active is None and method == "latin"):
        for name in problem.interfaces:
            reasons.setdefault(name, _ASKED if everything else _PAPER)
    elif active is not None:
        for name in _names(problem, checked_names("plan", "active", active, ", or 'all'"), "plan"):
            reasons.setdefault(name, _ASKED)
    elif method == "accelerated":
        for name, interface in problem.interfaces.items():
            if interface.law.springs and len(interface.sides) == 2:
                reasons.setdefault(name, "elastic, between two parts")
    return reasons


def _around(problem: Problem, scaled: Sequence[str]) -> dict[str, str]:
    """What joins parts whose stiffness varies to others, or to springs -> why it is kept."""
    found = {}
    for name in scaled:
        check_known("substructure", name, problem.parts, "plan: scaled")
    for name, interface in problem.interfaces.items():
        parts = dict.fromkeys([*(side.substructure for side in interface.sides), *interface.law.partners])
        varying = [part for part in parts if part in scaled]
        if not varying:
            continue
        how = interface.law.elimination
        if how is Elimination.TIED and len(parts) > 1:
            raise SceneError(
                f"interface {name!r} ties {varying[0]!r}, whose stiffness varies, to {len(parts) - 1} other "
                "parts in one rigid group, which a factor of one part does not go through: give its modulus "
                "as RandomField(name, mean, cov, length=..., modes=1), of a length far above that of the part"
            )
        if how is Elimination.SPRINGS or len(parts) > 1:
            found[name] = f"the stiffness of {varying[0]!r} varies"
    return found


def _split(problem: Problem, wanted: Mapping[str, str]) -> tuple[dict[str, str], dict[str, str]]:
    """Interfaces that are kept -> why, and those that are eliminated -> how."""
    reasons = dict(wanted)
    eliminated: dict[str, str] = {}
    for name, interface in problem.interfaces.items():
        law = interface.law
        glues = law.elimination is Elimination.GLUED
        unmatched = glues and interface.matching is None
        if unmatched and interface.space == "points":
            raise SceneError(
                f"interface {name!r}: a perfect connection needs meshes that match node for node, and "
                "these do not: give it space='facets', mesh both parts together, or use Elastic with a "
                "stiffness well above modulus / length"
            )
        if law.elimination is Elimination.TIED:
            reasons.pop(name, None)  # it is never iterated on
        if name in reasons:
            continue
        how = law.eliminated(interface.matching is not None)
        if how is not None:
            eliminated[name] = how
        elif unmatched:
            reasons[name] = _UNMATCHED
        else:
            reasons[name] = _UNGLUED if glues else _JOINS if law.linear else "its law is nonlinear"
    _free_held_parts(problem, reasons, eliminated)
    return reasons, eliminated


def _free_held_parts(problem: Problem, reasons: dict[str, str], eliminated: dict[str, str]) -> None:
    """Keep a support of a part that would have no unknown left, where it touches what is kept."""
    if not reasons or problem.distribution is not None:
        return
    alone = {names[0] for names in members_of_bodies(problem, eliminated) if len(names) == 1}
    removed = {n for n in eliminated if problem.interfaces[n].law.elimination is Elimination.REMOVED}
    for part, supports in wholly_held(problem, removed).items():
        if part in alone:
            name = min(supports, key=lambda n: problem.interfaces[n].num_points)
            reasons[name] = f"nothing else is free in {part!r}"
            del eliminated[name]


def _iteration(
    kept: Sequence[str], method: Method, options: Options | None
) -> tuple[Literal["direct", "accelerated", "latin"], Options, str]:
    """Which iteration there is, its settings, and why."""
    options = options or (Options.plain() if method == "latin" else Options())
    if not kept:
        return "direct", options, "no interface is active: one solve gives the answer"
    if options.acceleration == 0 or method == "latin":
        return "latin", options.with_(acceleration=0), "asked for"
    return "accelerated", options, "Anderson needs 4 to 8 times fewer iterations than the plain one"


def _of_interfaces(
    kept: Sequence[str], reasons: Mapping[str, str], eliminated: Mapping[str, str]
) -> list[Decision]:
    """What becomes of the interfaces."""
    why = "; ".join(sorted({reasons[name] for name in kept})) or "all are linear and fixed"
    by_how: dict[str, list[str]] = {}
    for name, way in eliminated.items():
        by_how.setdefault(way, []).append(name)
    return [
        Decision("active interfaces", ", ".join(kept) or "none", why),
        *(Decision(way, ", ".join(names), "linear and fixed") for way, names in by_how.items()),
    ]


def _of_spaces(problem: Problem) -> list[Decision]:
    """Where laws hold that are not imposed point by point, and why."""
    why: dict[tuple[str, str], list[str]] = {}
    remote: dict[str, list[str]] = {}
    for name, interface in problem.interfaces.items():
        if interface.one_point:
            remote.setdefault(interface.why, []).append(name)
        if interface.space != "points":
            reason = interface.why or "asked for"
            why.setdefault((interface.space, reason), []).append(name)
    found = [Decision(f"space {space}", ", ".join(names), reason) for (space, reason), names in why.items()]
    return [*found, *(Decision("one point", ", ".join(names), reason) for reason, names in remote.items())]


def _columns(
    problem: Problem,
    random: RandomLaws | None,
    modes: int,
    history: Literal["none", "patterns", "steps"],
    steps: int,
    patterns: int,
    why: str,
) -> tuple[int, list[Decision]]:
    """Number of columns of every field, and what they are; `why` a history needs them."""
    if random is not None:
        germs = random.space.germ_names
        why = f"{len(germs)} germs: {', '.join(germs)}" + (f"; {why}" if why else "")
        what = f"{modes} chaos modes" + (f" x {steps} time steps" if steps > 1 else "")
        dropped = [text.partition(": ") for text in random.dropped]
        return modes * steps, [
            Decision("columns", what, why),
            *(Decision("dropped", name, reason) for name, _, reason in dropped),
        ]
    if history == "none":
        return modes, [Decision("columns", "1", why or _one_column(problem))]
    count, what = (patterns, "load patterns") if history == "patterns" else (steps, "time steps")
    return count, [Decision("columns", f"{count} {what}", why)]


def _of_direction(direction: Direction, chosen: str) -> Decision:
    """The search direction of a run with active interfaces."""
    text = f"k = {direction.factor:g} E/L"
    if chosen == "accelerated":
        text += ", at most 2 kappa where elastic"
    if direction.given:
        text += f", given for {', '.join(direction.given)}"
    return Decision(
        "search direction", text, "the answer does not depend on it, the number of iterations does"
    )


def _ranks(problem: Problem) -> tuple[str, str]:
    """How a problem is spread over ranks, and what follows from that."""
    assert problem.distribution is not None
    spread = problem.distribution
    sizes = [0] * spread.comm.size
    for name, part in problem.parts.items():
        sizes[spread.owner[name]] += part.size
    cuts = ", ".join(problem.cuts) or "no interface"
    return (
        f"{len(sizes)}, {min(sizes)} to {max(sizes)} unknowns each; cut at {cuts}",
        "a part belongs to one rank",
    )


def _reach(
    problem: Problem,
    kept: Sequence[str],
    cut: Sequence[str],
    chosen: str,
    options: Options,
    dense_newton: bool,
) -> tuple[tuple[str, ...], Moments, tuple[str, ...], list[Decision]]:
    """Interfaces in the coarse problem, its moments, interfaces with matrix directions, and why."""
    decisions: list[Decision] = []
    paired: tuple[str, ...] = ()
    if options.directions != "diagonal" and cut:
        if chosen == "accelerated" or options.directions == "matrix":
            paired = tuple(cut)
            decisions.append(
                Decision(
                    "matrix directions",
                    f"{len(paired)} interfaces",
                    "linear and fixed but kept: solved with both of their parts at every iteration",
                )
            )
    between = [n for n in kept if len(problem.interfaces[n].sides) == 2]
    why = "asked for"
    if options.macro == "automatic":
        wanted = (
            chosen == "accelerated"
            and len(between) >= (_FEW if paired else _MANY)
            and not dense_newton
        )
        why = f"{len(between)} interfaces between parts: else an iteration reaches the next part only"
    else:
        wanted = options.macro != "none"
    if not (wanted and between):
        return (), "linear", paired, decisions
    loaded = [n for n in kept if problem.interfaces[n].law.prescribes == "force"]
    moments: Moments = "resultants" if options.macro == "resultants" else "linear"
    decisions.append(
        Decision(
            "coarse problem",
            f"{'resultants' if moments == 'resultants' else 'linear moments'} of "
            f"{len(between) + len(loaded)} interfaces",
            why,
        )
    )
    return (*between, *loaded), moments, paired, decisions


def _history(
    problem: Problem,
    kept: Sequence[str],
    times: npt.NDArray[np.float64] | None,
    amplitudes: Sequence[Amplitude],
    constant_loads: bool = False,
) -> tuple[tuple[Amplitude | None, ...], Literal["none", "patterns", "steps"], str]:
    """Load patterns, what a history needs of columns, and why."""
    if times is None:
        return (None,), "none", ""
    if not amplitudes and not any(i.law.timed for i in problem.interfaces.values()):
        return (None,), "none", "nothing changes in time: one column answers for all times"
    constant = (None,) if constant_loads or _constant_loads(problem) else ()
    patterns: tuple[Amplitude | None, ...] = (*constant, *amplitudes)
    nonlinear = [n for n in kept if not problem.interfaces[n].law.superposes]
    # a direct solution is checked and corrected pattern by pattern
    prescribed = [i.law for n, i in problem.interfaces.items() if n in kept and i.law.prescribes == "jump"]
    factors = [[1.0 if a is None else a(t) for t in times] for a in patterns]
    # of patterns that depend on each other, displacements that are kept may agree in their sum only
    apart = not any(law.varying for law in prescribed) or np.linalg.matrix_rank(factors) == len(patterns)
    if not nonlinear and (not kept or (len(patterns) < len(times) and apart)):
        why = "the scene is linear: its history is a superposition of load patterns"
        return patterns, "patterns", why
    # active interfaces are told their values at every time; only what is assembled has patterns
    assembled = [i.law for n, i in problem.interfaces.items() if n not in kept]
    values = [v for law in assembled for v in law.varying.values()]
    loads = [Varying(((a, 0.0),)) for a in problem.load_amplitudes]
    patterns = (*constant, *amplitudes_of([*values, *loads])) or (None,)
    why = "there are not more time steps than load patterns"
    if nonlinear:
        why = f"the answer of {', '.join(nonlinear)} is no superposition"
    return patterns, "steps", why


def _constant_loads(problem: Problem) -> bool:
    """Whether any loading is constant in time and not zero."""
    if problem.has_constant_loads:
        return True
    for interface in problem.interfaces.values():
        law = interface.law
        if not law.linear:
            continue  # its loading is not a load of a body
        for name in law.loading:
            value = getattr(law, name)
            terms = [v for a, v in value.terms if a is None] if isinstance(value, Varying) else [value]
            if not all(is_zero(v) for v in terms):
                return True
    return False
