"""What stands on the answer sheet: numbers with statistics and errors, and what follows from them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from latin_core import STATUSES

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.describe import shown_error
from dolfinx_frontend.common.statuses import NO_EQUILIBRIUM, SLIDES
from dolfinx_frontend.results.answer import SAMPLES, Answer, Block
from dolfinx_frontend.results.readings import Measures
from dolfinx_frontend.results.saved import ResultFileError
from dolfinx_frontend.results.tables import Table
from dolfinx_frontend.sheets.clamping import Bolt
from dolfinx_frontend.sheets.names import BOLT, MARGINS, SEAL, Name
from dolfinx_frontend.sheets.numbers import Numbers, margins_in, numbers_of, steps_of
from dolfinx_frontend.sheets.page import number
from dolfinx_frontend.sheets.seals import Seal, SealNumbers, seal_margin_in, seal_numbers
from dolfinx_frontend.sheets.statistics import Known, below, label, statistics_of
from dolfinx_frontend.uncertainty.quantities import Estimate

__all__ = ["Content", "Row", "Wanted", "content_of", "margins_of", "status_line"]

TEN = 10.0
"""A margin is 0 up to so many errors of the iteration."""
LEAST = 1e-6
AT_END = ("F_S", "F_S min", "F_S max", "F_SA", "F_KR")
"""Forces that the load of the last step makes, or so it is assumed for their errors."""
FORCES = ("F_M", "F_V", "F_S", "F_S min", "F_S max")
MODES = {"m_K": "opening", "m_G": "slip"}


@dataclass(frozen=True)
class Wanted:
    """What was asked for."""

    bolts: Sequence[Bolt]
    seals: Sequence[Seal]
    friction: Mapping[str, float]
    areas: Mapping[str, float]
    quantiles: tuple[float, ...]
    units: Mapping[str, str]
    samples: int | None
    seed: int


@dataclass(frozen=True)
class Row:
    """One number of a bolt or a gasket.

    Attributes
    ----------
    statistics
        Value; lowest and highest; or mean, deviation and quantiles.
    algebra, mesh
        Errors of these, absolute; NaN: not known.
    probability
        Of a margin: that it is used up.
    at
        Where: angle of a ring, points of a sweep.
    goal
        Whether the error of the meshes is that of the bolt force itself, not that in the energy norm.
    """

    section: str
    item: str
    key: str
    name: Name
    statistics: dict[str, float]
    algebra: dict[str, float]
    mesh: dict[str, float]
    probability: Estimate | None = None
    at: str = ""
    goal: bool = False

    def mesh_of(self, statistic: str) -> str:
        """What the error of the meshes was estimated of: ``"energy"``, ``"goal"``, or ``""``: not known."""
        if not np.isfinite(self.mesh[statistic]):
            return ""
        return "goal" if self.goal and statistic != "std" else "energy"

    @property
    def main(self) -> str:
        """The statistic that stands for the number; of a sweep the lowest of a margin or preload."""
        return next(iter(self.statistics))

    @property
    def low(self) -> float:
        """What bolts are sorted by: the value, the lowest one, or the lowest quantile."""
        found = self.statistics
        if "mean" not in found:
            return found[self.main]
        quantiles = [v for k, v in found.items() if k.endswith("%")]
        return min(quantiles) if quantiles else found["mean"] - 2.0 * np.nan_to_num(found["std"])


@dataclass(frozen=True)
class Content:
    """The sheet.

    Attributes
    ----------
    rows
        Of bolts, the weakest first, then of gaskets.
    order
        The bolts, the weakest first.
    limit
        A margin up to this is used up.
    verdicts
        Sentences, and whether each is bad news (None: neither).
    left_out
        What cannot be given, and why.
    """

    wanted: Wanted
    answer: Answer
    numbers: Numbers
    seals: dict[str, SealNumbers]
    known: Known
    rows: list[Row]
    order: list[str]
    limit: float
    verdicts: list[tuple[str, bool | None]] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)

    def row(self, item: str, key: str, section: str = "bolt") -> Row | None:
        """A number; None: it is not there."""
        same = (r for r in self.rows if (r.section, r.item, r.key) == (section, item, key))
        return next(same, None)

    def table(self) -> Table:
        """All numbers, one a line."""
        names = (
            "section", "name", "key", "symbol", "quantity", "unit", "statistic", "value", "error_algebra",
            "error_mesh", "error_mesh_of", "at",
        )  # fmt: skip
        columns: dict[str, list[Any]] = {n: [] for n in names}
        for row in self.rows:
            of = {s: row.mesh_of(s) for s in row.statistics}
            lines = [(s, v, row.algebra[s], row.mesh[s], of[s]) for s, v in row.statistics.items()]
            if row.probability is not None:
                p, nan = row.probability, float("nan")
                lines += [
                    ("P(used up)", p.value, nan, nan, ""),
                    ("P(used up), low", p.low, nan, nan, ""),
                    ("P(used up), high", p.high, nan, nan, ""),
                ]
            unit = self.wanted.units[row.name.of]
            for statistic, *values in lines:
                shown = unit if not statistic.startswith("P(") else ""
                line = (row.section, row.item, row.key, row.name.symbol, row.name.says, shown, statistic)
                for name, entry in zip(names, (*line, *values, row.at), strict=True):
                    columns[name].append(entry)
        return Table(columns, ("section", "name", "key", "statistic"))


def content_of(answer: Answer, wanted: Wanted, known: Known, carried_on: Callable[[], Any]) -> Content:
    """Everything that stands on the sheet.

    Parameters
    ----------
    carried_on
        Makes the answer with its iteration carried on, from which the error of the iteration is measured; of
        None it is not.
    """
    numbers = _numbers(answer, wanted)
    left_out = [f"{why} ({_few(names)})" for why, names in numbers.why.items()]
    seals = _seals(answer, wanted, left_out)
    after: tuple[Numbers, dict[str, SealNumbers]] | None = None
    if numbers.values or seals:
        tight = carried_on()
        if tight is not None:
            after = _numbers(tight, wanted), _seals(tight, wanted, [])
    limit = max(LEAST, TEN * known.algebra) if np.isfinite(known.algebra) else LEAST
    made = _Rows(answer, wanted, known, limit, [b.name for b in wanted.bolts if _by_force(answer, b)])
    by_bolt = {
        name: list(made.of("bolt", name, BOLT, values, None if after is None else after[0].values.get(name)))
        for name, values in numbers.values.items()
    }
    order = sorted(by_bolt, key=lambda name: _rank(by_bolt[name]))
    rows = [row for name in order for row in by_bolt[name]]
    for name, each in seals.items():
        tight_values = None if after is None else after[1][name].values
        rows += made.of("gasket", name, SEAL, each.values, tight_values, each.where)
    found = Content(wanted, answer, numbers, seals, known, rows, order, limit, left_out=left_out)
    found.verdicts.extend(_verdicts(found))
    _explain(found)
    return found


def _by_force(answer: Answer, bolt: Bolt) -> bool:
    """Whether the force of a bolt is given where its tightening ends."""
    controlled = getattr(answer.problem.interfaces[bolt.interface].law, "controlled", None)
    if controlled is None:
        return False
    step, times = answer.surface(bolt.interface).bolt, answer.times
    if times is None or step is None:
        return bool(times is None and controlled(None))
    return bool(controlled(float(times[step])))


def _numbers(answer: Answer, wanted: Wanted) -> Numbers:
    w = wanted
    return numbers_of(answer, w.bolts, w.friction, w.areas, w.samples, w.seed)


def _seals(answer: Answer, wanted: Wanted, left_out: list[str]) -> dict[str, SealNumbers]:
    steps = steps_of(answer, wanted.bolts)
    found = {}
    for seal in wanted.seals:
        try:
            last = None if steps is None else steps[0]
            found[seal.name] = seal_numbers(answer, seal, last, wanted.samples, wanted.seed)
        except ResultFileError as error:
            left_out.append(f"gasket {seal.name}: {error}")
    return found


def _few(names: Sequence[str]) -> str:
    return ", ".join(names[:6]) + (f", ... {len(names)} in all" if len(names) > 6 else "")


def _rank(rows: Sequence[Row]) -> tuple[float, float]:
    """What bolts are sorted by: the least margin, without one the bolt force."""
    by_key = {row.key: row for row in rows}
    margin = by_key["margin"].low if "margin" in by_key else np.inf
    force = next((by_key[k].low for k in ("F_S min", "F_S") if k in by_key), np.inf)
    return margin, force


@dataclass(frozen=True)
class _Rows:
    """Makes rows of numbers."""

    answer: Answer
    wanted: Wanted
    known: Known
    limit: float
    by_force: Sequence[str]

    def of(
        self,
        section: str,
        item: str,
        names: Mapping[str, Name],
        values: Mapping[str, Array],
        tight: Mapping[str, Array] | None,
        angles: Mapping[str, float] | None = None,
    ) -> Iterator[Row]:
        """The numbers of a bolt or gasket, in the order of their names."""
        for key, name in names.items():
            if key not in values:
                continue
            found = self._statistics(values[key])
            given = self._prescribed(item, key, values) if section == "bolt" else {}
            algebra = {s: self._size(key, v, self.known.algebra) for s, v in found.items()}
            if tight is not None and key in tight:
                better = self._statistics(tight[key])
                algebra = {s: _apart(v, better[s]) for s, v in found.items()}
            mesh = {s: self._size(key, v - given.get(s, 0.0), self.known.mesh) for s, v in found.items()}
            by_itself = self._of_goal(item, key) if section == "bolt" else None
            if by_itself is not None:
                mesh = {s: each if s == "std" else by_itself for s, each in mesh.items()}
            chance = None
            if key in MARGINS:
                chance = below(values[key], self.answer.statistics, self.limit)
            at = self._places(values[key])
            if not at and self._ring(item) and np.isfinite((angles or {}).get(key, np.nan)):
                at = f"{(angles or {})[key]:.0f}°"
            yield Row(section, item, key, name, found, algebra, mesh, chance, at, by_itself is not None)

    def _of_goal(self, item: str, key: str) -> float | None:
        """Error of a number that is a force at the end, or made of it; None: not known."""
        error = self.known.goals.get(item)
        if error is None or key not in (*AT_END, "sigma_a"):
            return None
        if key != "sigma_a":
            return error
        bolt = next(each for each in self.wanted.bolts if each.name == item)
        return 0.5 * error / self.wanted.areas.get(item, bolt.area)

    def _prescribed(self, item: str, key: str, values: Mapping[str, Array]) -> dict[str, float]:
        """What of a bolt force is given by the scene, and no mesh can change."""
        if key not in FORCES or item not in self.by_force:
            return {}
        return self._statistics(values["F_M" if "F_M" in values else "F_S"])

    def _ring(self, item: str) -> bool:
        return any(len(s.angles) > 1 for s in self.wanted.seals if s.name == item)

    def _statistics(self, values: Array) -> dict[str, float]:
        weights = None
        if self.answer.statistics == "quadrature":
            weights = self.answer.readings(()).weights  # type: ignore[attr-defined]
        return statistics_of(values, self.answer.statistics, weights, self.wanted.quantiles)

    def _size(self, key: str, value: float, relative: float) -> float:
        """An error that is known relative to the whole."""
        whole = max(abs(value), 1.0) if key in MARGINS else abs(value)
        return relative * whole if np.isfinite(value) else float("nan")

    def _places(self, values: Array) -> str:
        """Of a sweep: its points with the lowest and the highest value."""
        if self.answer.statistics != "grid":
            return ""
        found = []
        for k in (int(values.argmin()), int(values.argmax())):
            point = (f"{name} = {float(v[k]):g}" for name, v in self.answer.coordinates.items())
            found.append(", ".join(point))
        return f"lowest at {found[0]}; highest at {found[1]}"


def _apart(one: float, other: float) -> float:
    return 0.0 if one == other else abs(one - other)


def _verdicts(content: Content) -> Iterator[tuple[str, bool | None]]:
    """The sentences on top."""
    random = content.answer.statistics in ("random", "qmc")
    answer, wanted = content.answer, content.wanted
    yield from _ended(content)
    weakest = content.order[0] if content.order else None
    row = None if weakest is None else content.row(weakest, "margin")
    if weakest is not None and row is not None:
        yield _weakest(content, weakest, row)
    elif weakest is not None:
        lowest = content.row(weakest, "F_S min") or content.row(weakest, "F_S")
        assert lowest is not None  # every bolt has a force
        force = f"{number(lowest.low)} {content.wanted.units['force']}".strip()
        yield f"Lowest bolt force: {weakest}, {force}. No margin can be given, see below.", None
    if random and row is not None and len(content.order) > 1:
        chance = _chance(content, lambda b: margins_in(answer, b, wanted.bolts, wanted.friction))
        yield f"That a joint opens or slips around any bolt has the probability {chance}.", None
    joints = list(dict.fromkeys(joint for bolt in content.wanted.bolts for joint in bolt.joints))
    for joint in joints:
        whole = _whole(content, joint)
        if whole is not None and random:
            chance = _chance(content, _margins_of(content, whole))
            yield f"That all of “{joint}” is open or at its limit of friction: {chance}.", None
        yield from _safety(content, joint)
    for text in content.answer.bridged(joints):
        yield f"{text[:1].upper()}{text[1:]}.", None
    for seal in content.wanted.seals:
        if seal.name in content.seals:
            yield _of_seal(content, seal, random)


def _weakest(content: Content, name: str, row: Row) -> tuple[str, bool | None]:
    """The sentence about the weakest bolt."""
    modes = {k: r.low for k in MODES if (r := content.row(name, k)) is not None}
    mode = MODES[min(modes, key=lambda k: modes[k])]
    joint = content.numbers.joint.get(name, "")
    text = f"Weakest bolt: {name}, margin {number(row.statistics[row.main])} against {mode} of “{joint}”"
    mean = "mean" in row.statistics
    if mean:
        least = [k for k in row.statistics if k.endswith("%")]
        text += f" (mean; {number(row.low)} at {least[0]})" if least else " (mean)"
    elif "lowest" in row.statistics:
        text += f" ({row.at.partition(';')[0]})"
    rest, whole = content.row(name, "F_KR"), content.row(name, "F_KV")
    safety, shear = content.row(name, "S_G"), content.row(name, "F_Q")
    unit = f" {content.wanted.units['force']}".rstrip()
    if mode == MODES["m_G"] and safety is not None and shear is not None:
        text += f": S_G is {number(safety.low)} where the shear force is up to "
        text += f"{number(max(shear.statistics.values()))}{unit}"
    elif rest is not None and whole is not None:
        before, after = (number(each.statistics[each.main]) for each in (whole, rest))
        text += f": {'on average ' if mean else ''}the clamping force falls from {before}{unit} to "
        text += f"{after}{unit}"
    text += "." if mean or row.low > content.limit else f". Nothing is left: {mode}."
    if row.probability is not None:
        answer, wanted = content.answer, content.wanted
        chance = _shown(row.probability)
        if answer.kind == "chaos":  # with solved samples
            own = [bolt for bolt in wanted.bolts if bolt.name == name]
            chance = _chance(content, lambda b: margins_in(answer, b, own, wanted.friction))
        around = " around it" if _whole(content, joint) else ""
        text += f" Probability that “{joint}” opens or slips{around}: {chance}."
    return text, _bad(row, content.limit)


def _ended(content: Content) -> Iterator[tuple[str, bool | None]]:
    """How points ended that did not converge; what slid is an answer, and its margins are used up."""
    answer = content.answer
    if answer.status == "converged":
        return
    statuses = [str(each) for each in np.ravel(answer.statuses)]  # type: ignore[attr-defined]
    slid = sum(each in (SLIDES, NO_EQUILIBRIUM) for each in statuses)
    if slid:
        what = {"history": "steps", "samples": "samples"}.get(answer.kind, "points")
        yield (
            f"In {slid} of {len(statuses)} {what} nothing balances the loads: something slides away, or a "
            "bond has torn. There the margins are used up, and forces are those that are left.",
            True,
        )
    others = [each for each in statuses if each not in ("converged", SLIDES, NO_EQUILIBRIUM)]
    if others:
        ended = max(others, key=STATUSES.index)
        yield f"The run ended as “{ended}”: these numbers are not those of a converged answer.", True


def _safety(content: Content, joint: str) -> Iterator[tuple[str, bool | None]]:
    """Of a joint that several bolts share, against slip as a whole: by its force and moment."""
    if _whole(content, joint) is None:
        return
    answer, steps = content.answer, steps_of(content.answer, content.wanted.bolts)
    read: Measures = answer.readings([joint]).interfaces[joint]  # type: ignore[attr-defined]
    values = read.values.get("slip_safety", np.full(1, np.nan))
    if steps is not None:
        values = values[..., steps[0] :].min(axis=-1)
    if np.isnan(values).any():
        return
    level = min(content.wanted.quantiles, default=0.5)
    lowest = f", {number(float(np.quantile(values, level)))} at {label(level)}" if np.size(values) > 1 else ""
    middle = number(float(np.median(values)))
    text = f"“{joint}” as a whole: its friction is {middle} times the force and moment along it"
    yield f"{text}{' (median' + lowest + ')' if lowest else ''}.", None


def _margins_of(content: Content, bolt: Bolt) -> Callable[[Block], Array]:
    return lambda block: margins_in(content.answer, block, [bolt], content.wanted.friction)


def _whole(content: Content, joint: str) -> Bolt | None:
    """A joint that several bolts share, as if one had all of it; None: it is that of one bolt."""
    shares = [(bolt, bolt.joints[joint]) for bolt in content.wanted.bolts if joint in bolt.joints]
    if len(shares) < 2:
        return None
    bolt, share = shares[0]
    return replace(bolt, joints={joint: np.ones_like(share)})


def _shown(chance: Estimate) -> str:
    """A probability with its interval."""
    return f"{chance.value:.3g} [{chance.low:.2g}, {chance.high:.2g}] ({100.0 * chance.level:g} %)"


def _chance(content: Content, function: Callable[[Block], Array]) -> str:
    """Probability that a margin is used up; of a chaos with contact some samples are solved for it."""
    answer, wanted = content.answer, content.wanted
    samples = wanted.samples or (SAMPLES if answer.kind == "chaos" else None)
    every: Any = answer
    quantity = every.quantity(function, "margin", samples=samples, seed=wanted.seed)
    return _shown(quantity.probability(below=float(np.nextafter(content.limit, np.inf))))


def _of_seal(content: Content, seal: Seal, random: bool) -> tuple[str, bool | None]:
    lowest = content.row(seal.name, "Q_S", "gasket")
    assert lowest is not None
    unit = f" {content.wanted.units['stress']}".rstrip()
    text = f"Gasket “{seal.name}”: lowest pressure {number(lowest.statistics[lowest.main])}{unit}"
    text += f" at {lowest.at}" if lowest.at.endswith("°") else ""
    if "mean" in lowest.statistics and lowest.low != lowest.statistics["mean"]:
        text += f" (mean; low {number(lowest.low)})"
    if seal.service is None:
        return f"{text}; what it needs was not given.", None
    text += f", it needs {number(seal.service)}{unit}."
    row = content.row(seal.name, "m_L", "gasket")
    assert row is not None
    if random:
        last = steps_of(content.answer, content.wanted.bolts)
        step = None if last is None else last[0]
        chance = _chance(content, lambda b: seal_margin_in(content.answer, b, seal, step))
        text += f" Probability that it is less: {chance}."
    return text, _bad(row, 0.0)


def _bad(row: Row, limit: float) -> bool | None:
    """Whether a margin is bad news; None: it is used up in some samples, but in few."""
    if row.low <= limit:
        return True
    return None if row.probability is not None and row.probability.value > 0.0 else False


def _explain(content: Content) -> None:
    """Say what is not on the sheet, and why."""
    say, answer = content.left_out, content.answer
    if not content.wanted.bolts:
        say.append(
            "bolts: none was chosen, or no interface has a preload or an imposed jump, and there is no beam; "
            "name them with bolts=[...]"
        )
    elif answer.times is None:
        say.append(
            "F_M, F_V, Φ, the force range and the margin against opening: there is no load history, solve "
            "with times=[...]"
        )
    elif not any(row.key == "F_S max" for row in content.rows):
        say.append("Φ, F_SA, force range and σ_a: the history has no step after the last tightening")
    bolts = {row.item for row in content.rows if row.section == "bolt"}
    with_joint = [b.name for b in content.wanted.bolts if b.joints and b.name in bolts]
    slip = [name for name in with_joint if content.row(name, "S_G") is None]
    if slip:
        why = "the law of the joint has no friction; give friction="
        say.append(f"safety against slip ({_few(slip)}): {why}")
    no_area = [b.name for b in content.wanted.bolts if b.name in bolts and not np.isfinite(b.area)]
    no_area = [name for name in no_area if name not in content.wanted.areas]
    if no_area:
        say.append(f"stress amplitude ({_few(no_area)}): a beam has no section; give stress_area=")
    if not content.wanted.seals:
        say.append("gaskets: none was named; give seals={interface: pressure that it needs}")
    if not np.isfinite(content.known.mesh):
        say.append(f"error of the meshes: {content.known.mesh_how}")


def status_line(content: Content) -> str:
    """Which answer it is, and how far it is to be believed."""
    answer, known = content.answer, content.known
    kind = {"qmc": "Sobol samples", "random": "samples", "quadrature": "points of a quadrature"}
    what: str = answer.kind
    if answer.kind == "samples":
        what = kind.get(answer.statistics, "samples")
    mesh = shown_error(known.mesh)
    return (
        f"{what}, {answer.status}; relative error of the iteration {shown_error(known.algebra)}, of the "
        f"meshes {mesh}"
    )


def margins_of(content: Content) -> dict[str, Array]:
    """Least margins (N,) of the bolts that have one, the weakest first."""
    values = content.numbers.values
    return {name: values[name]["margin"] for name in content.order if "margin" in values[name]}
