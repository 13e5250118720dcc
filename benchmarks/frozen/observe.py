"""What is kept of an answer: numbers with the error they may have, words, errors said, counts.

Only the public names of the library are used, and none is taken for granted: what cannot be read is listed in
``missing``. Fields are condensed by sums that do not depend on how nodes and points are numbered.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

BALANCE = 30.0
"""Forces and extremes may be so many errors off: they have no norm in common with what is said."""
ROUNDING = 1e-12
"""Of the largest number of its kind in the scene: less is nothing (a thousand units of double precision)."""
SAMPLES = 256
"""Samples of a chaos that tables are made of."""
SHORT = 6
"""Arrays of so many numbers are kept as they are."""
DEEP = 6
"""Levels of objects in objects."""

FEW_COLUMNS = ("normal", "shear", "pressure_max", "shear_max")
LOADS = ("Pressure", "Traction")
"""Laws whose force is given: of many scenes it is not kept."""
COUNTING = ("open_area", "slip_area")
"""Areas of points beyond a threshold: they jump where a point is at the edge; forces say the same."""
FEW_STATISTICS = ("mean", "std", "95 %")
LABELS = ("interface", "law", "time", "statistic")
COUNTS = ("runs", "gradients", "kinks", "points", "iterations", "lost", "count")
"""Whole numbers in records of the library that say how much was done."""
SKIPPED = (
    "seconds",
    "problem",
    "plan",
    "solver",
    "laws",
    "summary",
    "state",
    "how",
    "why",
    "notes",
    "next_halving",
)
"""Not values: times, objects that made an answer, and sentences."""


@dataclass
class Observation:
    """What is kept.

    Attributes
    ----------
    values
        Key -> number, and the error it may have, absolute.
    words
        Key -> status, or another word that is compared as it is.
    said
        Key -> error said, and the floor below which it says nothing.
    counts
        Key -> how much was done.
    missing
        What could not be read, and why.
    """

    values: dict[str, tuple[float, float]] = field(default_factory=dict)
    words: dict[str, str] = field(default_factory=dict)
    said: dict[str, tuple[float, float]] = field(default_factory=dict)
    counts: dict[str, float] = field(default_factory=dict)
    missing: list[str] = field(default_factory=list)


def observe(result: Any, rtol: float, few: bool = False) -> Observation:
    """What is kept of what a scene returned.

    Parameters
    ----------
    result
        Any result of the library, a number, a word, or a mapping or sequence of these.
    rtol
        That was asked for: no error is taken for smaller.
    few
        Fewer columns of tables: for scenes that there are many of.
    """
    observer = _Observer(rtol, few)
    observer.anything("", result, 0)
    return observer.seen


def probe(places: Array) -> Array:
    """A smooth function (n,) of places (n, d): odd and even parts, of size 1, without an axis of its own."""
    if not len(places):
        return np.zeros(0)
    middle, size = places.mean(axis=0), float(np.ptp(places, axis=0).max()) or 1.0
    x = (places - middle) @ np.array((1.0, 0.7, 0.4))[: places.shape[1]] / size
    return np.asarray(np.cos(2.0 * x) + np.sin(3.0 * x)) / 2.0


def displacements(
    places: Array, unknowns: Array, key: str, error: float, floor: float = 0.0
) -> dict[str, tuple[float, float]]:
    """Numbers of a displacement (n d,) at its nodes (n, dim): root mean square, largest, means and probes.

    `error` is relative to the root mean square, `floor` absolute.
    """
    u = unknowns.reshape(len(places), -1)
    size = float(np.sqrt(np.mean(np.sum(u**2, axis=1)))) if u.size else 0.0
    largest = float(np.abs(u).max(initial=0.0))
    allowed = max(error * size, floor)
    out = {f"{key}.u": (size, allowed), f"{key}.u_max": (largest, BALANCE * allowed)}
    phi = probe(places)
    for axis in range(u.shape[1]):
        out[f"{key}.u_{'xyz'[axis]}"] = (float(u[:, axis].mean()), allowed)
        out[f"{key}.u_{'xyz'[axis]} probe"] = (float(phi @ u[:, axis]) / len(phi), allowed)
    return out


def nodes(part: Any) -> Array:
    """Places (n, dim) of the unknowns of a part."""
    places: Array = np.asarray(part.V.tabulate_dof_coordinates())
    return places


def _counted(words: list[str]) -> str:
    """Statuses in short: how many of each, and which are not as the first ones."""
    if len(set(words)) <= 1:
        return words[0] if words else ""
    out, start = [], 0
    for k in range(1, len(words) + 1):
        if k == len(words) or words[k] != words[start]:
            out.append(f"{words[start]} {start}" + (f"-{k - 1}" if k - 1 > start else ""))
            start = k
    return ", ".join(out)


class _Observer:
    def __init__(self, rtol: float, few: bool) -> None:
        self.rtol, self.few = rtol, few
        self.given: set[str] = set()  # interfaces whose force is a load
        self.seen = Observation()

    # -- anything -----------------------------------------------------------------------------------
    def anything(self, key: str, thing: Any, level: int) -> None:
        seen = self.seen
        if level > DEEP:
            seen.missing.append(f"{key}: too deep")
        elif thing is None or isinstance(thing, (str, bool, np.bool_)):
            seen.words[key] = str(thing)
        elif isinstance(thing, (int, float, np.integer, np.floating)):
            self.number(key, float(thing))
        elif isinstance(thing, np.ndarray):
            self.array(key, thing)
        elif callable(getattr(thing, "table", None)) and hasattr(thing, "kind"):
            self.answer(key, thing)
        elif all(hasattr(thing, name) for name in ("value", "low", "high", "level")):
            self.estimate(key, thing)
        elif (
            callable(getattr(thing, "quantile", None))
            and hasattr(thing, "values")
            and hasattr(thing, "weights")
        ):
            self.quantity(key, thing)
        elif callable(getattr(thing, "relative", None)) and hasattr(thing, "algebraic"):
            self.errors(key, thing)
        elif hasattr(thing, "columns") and hasattr(thing, "labels"):
            self.read(key, lambda: self.table(key, thing))
        elif isinstance(thing, Mapping):
            for name, each in thing.items():
                self.anything(_joined(key, str(name)), each, level + 1)
        elif isinstance(thing, (list, tuple)) and not hasattr(thing, "_fields"):
            for k, each in enumerate(thing):
                self.anything(_joined(key, str(k)), each, level + 1)
        else:
            self.record(key, thing, level)

    def record(self, key: str, thing: Any, level: int) -> None:
        """Any other object of the library by its public fields."""
        names = getattr(thing, "_fields", ())
        if dataclasses.is_dataclass(thing):
            names = tuple(each.name for each in dataclasses.fields(thing))
        self.seen.words[_joined(key, "type")] = type(thing).__name__
        for name in names:
            if name.startswith("_") or name in SKIPPED:
                continue
            each = getattr(thing, name)
            if name in COUNTS and isinstance(each, (int, np.integer)):
                self.seen.counts[_joined(key, name)] = float(each)
            elif not callable(each):
                self.anything(_joined(key, name), each, level + 1)
        for name in ("status", "error"):
            if name not in names and isinstance(getattr(thing, name, None), (str, float)):
                self.anything(_joined(key, name), getattr(thing, name), level + 1)

    def read(self, what: str, read: Callable[[], Any]) -> Any:
        """What is read, or None and an entry in `missing`."""
        try:
            return read()
        except Exception as error:  # whatever a later state says: it is told, and the rest is read
            self.seen.missing.append(f"{what}: {type(error).__name__}: {str(error)[:120]}")
            return None

    def number(self, key: str, value: float, scale: float | None = None, error: float | None = None) -> None:
        error = self.rtol if error is None or not math.isfinite(error) else max(error, self.rtol)
        size = abs(value) if scale is None or not math.isfinite(scale) else scale
        self.seen.values[key] = (value, error * size if math.isfinite(size) else 0.0)

    def array(self, key: str, thing: npt.NDArray[Any]) -> None:
        if thing.dtype.kind in "US":
            self.seen.words[key] = _counted([str(each) for each in thing.ravel()])
            return
        if thing.dtype.kind not in "fiub":
            self.seen.missing.append(f"{key}: an array of {thing.dtype}")
            return
        self.series(key, np.asarray(thing, dtype=np.float64).ravel())

    def series(self, key: str, values: Array, errors: Array | None = None) -> None:
        """Numbers in a row: as they are if few, else the last, the largest, norm, alternating sum."""
        size = float(np.abs(values[np.isfinite(values)]).max(initial=0.0))
        allowed = np.full(len(values), self.rtol * size) if errors is None else errors
        if len(values) <= (1 if self.few and errors is not None else SHORT):
            for k, each in enumerate(values):
                name = key if len(values) == 1 else f"{key}@{k}"
                self.seen.values[name] = (float(each), float(allowed[k]))
            return
        known = np.isfinite(values)
        v, e = values[known], allowed[known]
        if errors is not None:
            self.seen.values[key] = (float(values[-1]), float(allowed[-1]))
        if not len(v):
            return
        signs = np.cos(1.0 + np.arange(len(v)))
        whole = float(np.linalg.norm(e))
        self.seen.values[f"{key} probe"] = (float(signs @ v), whole)
        if not self.few:
            self.seen.values[f"{key} norm"] = (float(np.linalg.norm(v)), whole)
        if errors is None:
            self.seen.values[f"{key} max"] = (float(v.max()), float(e.max()))
            self.seen.values[f"{key} min"] = (float(v.min()), float(e.max()))

    # -- statistics ---------------------------------------------------------------------------------
    def estimate(self, key: str, thing: Any, strict: bool = False) -> None:
        """A number with an interval: with one of its own it may be as far off as that says."""
        ways = [abs(thing.high - thing.value), abs(thing.value - thing.low)]
        finite = [each for each in ways if math.isfinite(each)]
        floor = self.rtol * abs(thing.value)
        self.seen.values[key] = (float(thing.value), floor if strict else max([floor, *finite]))
        if finite:
            self.seen.said[f"{key} interval"] = (max(finite), floor)

    def quantity(self, key: str, thing: Any) -> None:
        values = np.asarray(thing.values, dtype=np.float64).ravel()
        if thing.kind in ("value", "grid"):
            self.series(key, values)
            return
        size = float(np.sqrt(np.mean(values**2)))
        for name, read in (
            ("mean", thing.mean),
            ("std", thing.std),
            *((f"{q:g}", lambda q=q: thing.quantile(q)) for q in (0.05, 0.5, 0.95)),
        ):
            found = (
                self.read(f"{key}.{name}", read) if thing.weights is None or name in ("mean", "std") else None
            )
            if found is not None:
                self.estimate(_joined(key, name), found, strict=True)
                value, error = self.seen.values[_joined(key, name)]
                self.seen.values[_joined(key, name)] = (value, max(error, self.rtol * size))

    def errors(self, key: str, thing: Any) -> None:
        """Errors by their source."""
        for source in ("algebraic", "truncation", "field", "discretisation"):
            found = self.read(f"{key}.{source}", lambda source=source: float(thing.relative(source)))
            if found is not None:
                self.seen.said[_joined(key, source)] = (found, self.rtol)
        moments = getattr(thing, "moments", None)
        if moments is not None:
            error = max((e for e, _ in self.seen.said.values() if math.isfinite(e)), default=0.0)
            for name in ("mean", "std"):
                if getattr(moments, name, None) is not None:
                    self.number(_joined(key, name), float(getattr(moments, name)), error=error)

    # -- answers ------------------------------------------------------------------------------------
    def answer(self, key: str, result: Any) -> None:
        seen, kind = self.seen, str(result.kind)
        seen.words[_joined(key, "kind")] = kind
        statuses = self.read(f"{key} statuses", lambda: result.statuses)
        if statuses is None:
            statuses = self.read(f"{key} status", lambda: [str(result.status)]) or []
        seen.words[_joined(key, "status")] = _counted([str(each) for each in np.ravel(np.asarray(statuses))])
        errors = self.said(key, result, kind)
        self.counts(key, result)
        fields = self.fields(key, result, kind, errors)
        table = self.read(
            f"{key} table",
            lambda: result.table(step=None, **({"samples": SAMPLES} if kind == "chaos" else {})),
        )
        neighbours = self.read(f"{key} sides", lambda: _neighbours(result.problem))
        self.given = {n for n in neighbours or {} if type(result.problem.interfaces[n].law).__name__ in LOADS}
        if table is not None:
            self.table(key, table, errors, neighbours or {})
        self.interfaces(key, result, kind, errors, fields)

    def said(self, key: str, result: Any, kind: str) -> Array:
        """Errors said: of every step, or point; one of a chaos."""
        name = "step_errors" if kind in ("deterministic", "history") else "error"
        found = self.read(
            f"{key} {name}", lambda: np.ravel(np.asarray(getattr(result, name), dtype=np.float64))
        )
        if found is None or not len(found):
            return np.array([self.rtol])
        largest = float(np.max(found)) if np.all(np.isfinite(found)) else math.nan
        self.seen.said[_joined(key, "error")] = (largest, self.rtol)
        if kind == "samples":
            scatter = self.read(f"{key} scatter", lambda: float(result.scatter_error))
            if scatter is not None:
                self.seen.said[_joined(key, "scatter error")] = (scatter, self.rtol)
        if kind == "chaos":
            for name, each in (getattr(result, "misfits", None) or {}).items():
                self.seen.said[_joined(key, f"{name} misfit")] = (float(each), self.rtol)
            for name, each in (getattr(result, "checks", None) or {}).items():
                self.seen.said[_joined(key, f"{name} truncation")] = (float(each.error), self.rtol)
        return np.maximum(np.where(np.isfinite(found), found, 1.0), self.rtol)

    def counts(self, key: str, result: Any) -> None:
        counts = self.seen.counts
        found = self.read(f"{key} iterations", lambda: float(np.sum(result.iterations)))
        if found is not None:
            counts[_joined(key, "iterations")] = found
        summary = getattr(result, "summary", None)
        for name in ("newton_steps", "restarts"):
            if summary is not None:
                found = self.read(f"{key} {name}", lambda name=name: float(getattr(summary, name)))
                if found is not None:
                    counts[_joined(key, name)] = found
        costs = self.read(f"{key} costs", lambda: list(result.solver.costs))
        if costs is not None:
            counts[_joined(key, "factorisations")] = float(sum(not each["kept"] for each in costs))
            counts[_joined(key, "factor numbers")] = float(sum(each["factor_numbers"] for each in costs))
            counts[_joined(key, "dense numbers")] = float(sum(each["dense_numbers"] for each in costs))
        modes = getattr(result, "modes", None)
        if isinstance(modes, int):
            counts[_joined(key, "modes")] = float(modes)

    def fields(self, key: str, result: Any, kind: str, errors: Array) -> dict[str, float]:
        """Displacements of the parts at the end, and deviations; returns how far each part moves."""
        moved: dict[str, float] = {}
        if getattr(result, "without_displacements", None) is not None:
            return moved
        found = self.read(f"{key} displacements", lambda: dict(result.displacements))
        if found is None:
            return moved
        last = {name: u if u.ndim == 1 else u[-1] for name, u in found.items()}
        moved = {name: float(np.abs(u).max(initial=0.0)) for name, u in found.items()}
        floor = ROUNDING * max(moved.values(), default=0.0)
        error = float(errors[-1]) if kind in ("history", "sweep") else float(errors.max())
        for name, u in last.items():
            places = self.read(
                f"{key} nodes of {name}", lambda name=name: nodes(result.problem.substructures[name])
            )
            if places is None:
                continue
            self.seen.values.update(displacements(places, u, _joined(key, name), error, floor))
            if found[name].ndim == 2:
                whole = float(np.linalg.norm(found[name]))
                allowed = max(float(errors.max()) * whole, floor * math.sqrt(found[name].size))
                self.seen.values[f"{_joined(key, name)}.u all steps"] = (whole, allowed)
            if kind not in ("chaos", "samples"):
                continue
            deviation = self.read(f"{key} deviation of {name}", lambda name=name: result.deviation(name))
            if deviation is not None:
                # an error of the fluctuation is one of the whole field
                size = float(np.sqrt(np.mean(u**2 + np.atleast_2d(deviation)[-1] ** 2))) if u.size else 0.0
                std = np.atleast_2d(deviation)[-1]
                at = probe(places) @ std.reshape(len(places), -1).sum(axis=1) / max(len(places), 1)
                allowed = max(error * size, floor)
                self.seen.values[f"{_joined(key, name)}.u std"] = (float(np.sqrt(np.mean(std**2))), allowed)
                self.seen.values[f"{_joined(key, name)}.u std probe"] = (
                    float(at),
                    u.size / len(places) * allowed,
                )
        return moved

    def table(
        self,
        key: str,
        table: Any,
        errors: Array | None = None,
        neighbours: Mapping[str, set[str]] | None = None,
    ) -> None:
        """Numbers of the interfaces, ``interface.column``, of several rows the last one and sums of all."""
        columns = {name: list(entries) for name, entries in table.columns.items()}
        names = [str(each) for each in columns.get("interface", [])]
        statistics = [str(each) for each in columns.get("statistic", [])] or [""] * len(names)
        numbers = {
            name: np.array([float(v) for v in entries])
            for name, entries in columns.items()
            if name not in LABELS and name not in table.labels
        }
        rows: dict[tuple[str, str], list[int]] = {}
        for k, both in enumerate(zip(names, statistics, strict=True)):
            rows.setdefault(both, []).append(k)
        scales = _Scales(numbers, rows, neighbours or {})
        for (name, statistic), which in rows.items():
            if self.few and (name in self.given or (statistic and statistic not in FEW_STATISTICS)):
                continue
            for column, values in numbers.items():
                if column in COUNTING or (self.few and column not in FEW_COLUMNS):
                    continue
                series = values[which]
                if np.all(np.isnan(series)):
                    continue
                said = np.full(len(which), self.rtol) if errors is None else np.resize(errors, len(which))
                if statistic or errors is None or len(errors) not in (1, len(which)):
                    said = np.full(len(which), self.rtol if errors is None else errors.max())
                allowed = BALANCE * said * scales.of(name, column, len(which))
                words = f"{name}.{column}" + (f" {statistic}" if statistic else "")
                self.series(
                    _joined(key, words), series, np.maximum(allowed, said * np.nan_to_num(np.abs(series)))
                )

    def interfaces(self, key: str, result: Any, kind: str, errors: Array, moved: Mapping[str, float]) -> None:
        """Probes of forces, and extremes of jumps, of all steps and points."""
        known = self.read(f"{key} known", lambda: tuple(result.known)) or ()
        forces: dict[str, Array] = {}
        jumps: dict[str, Array] = {}
        for name in known:
            both = self.read(
                f"{key} force of {name}",
                lambda name=name: (np.asarray(result.force(name)), np.asarray(result.jump(name))),
            )
            if both is not None:
                forces[name], jumps[name] = both
        error = float(errors.max())
        largest = {name: float(np.abs(f).max(initial=0.0)) for name, f in forces.items()}
        neighbours = self.read(f"{key} sides", lambda: _neighbours(result.problem)) or {}
        interfaces = self.read(f"{key} interfaces", lambda: dict(result.problem.interfaces)) or {}
        reach = max(moved.values(), default=0.0)
        for name, force in forces.items():
            if self.few and name in self.given:
                continue
            each, jump = interfaces[name], jumps[name]
            near = [other for other in neighbours.get(name, {name}) if other in largest] or [name]
            area = float(np.sum(each.weights))
            scale = max(
                max(largest[other] for other in near), ROUNDING / error * max(largest.values(), default=0.0)
            )
            phi = probe(np.asarray(each.points)) * np.asarray(each.weights)
            normal = force[..., 0] @ phi
            shear = np.linalg.norm(force[..., 1:], axis=-1) @ phi
            here = _joined(key, name)
            for what, value in (("normal", normal), ("shear", shear)):
                if what == "shear" and force.shape[-1] == 1:
                    continue
                count = max(np.size(value), 1)
                number = float(np.linalg.norm(value)) if count > 1 else float(np.ravel(value)[0])
                self.seen.values[f"{here}.{what} probe"] = (
                    number,
                    BALANCE * error * scale * area * math.sqrt(count),
                )
            sides = [side.substructure for side in each.sides]
            size = max([moved.get(part, 0.0) for part in sides] + [float(np.abs(jump).max(initial=0.0))])
            allowed = BALANCE * max(error * size, ROUNDING * reach)
            self.seen.values[f"{here}.opening max"] = (float(jump[..., 0].max(initial=0.0)), allowed)
            if not self.few:
                self.seen.values[f"{here}.opening min"] = (float(jump[..., 0].min(initial=0.0)), allowed)
            if jump.shape[-1] > 1:
                slip = np.linalg.norm(jump[..., 1:], axis=-1)
                self.seen.values[f"{here}.slip max"] = (float(slip.max(initial=0.0)), allowed)
            if kind in ("chaos", "samples"):
                self.moments(here, result, name, error, scale * area)

    def moments(self, here: str, result: Any, name: str, error: float, scale: float) -> None:
        """Mean and deviation of the normal force, as the answer itself says them."""
        found = self.read(f"{here} mean_std", lambda: result.mean_std(name))
        if found is not None:
            size = max(scale, abs(found.mean), found.std or 0.0)
            self.seen.values[f"{here}.normal mean_std mean"] = (float(found.mean), BALANCE * error * size)
            if found.std is not None:
                self.seen.values[f"{here}.normal mean_std std"] = (float(found.std), BALANCE * error * size)


class _Scales:
    """What numbers of an interface are compared with: the largest of their kind at the same parts, by row."""

    def __init__(
        self,
        numbers: Mapping[str, Array],
        rows: Mapping[tuple[str, str], list[int]],
        neighbours: Mapping[str, set[str]],
    ) -> None:
        self.neighbours = neighbours
        self.forces: dict[str, Array] = {}
        self.pressures: dict[str, Array] = {}
        self.areas: dict[str, Array] = {}
        self.plane = "force_z" not in numbers
        for (name, _), which in rows.items():
            area = numbers.get("area", np.ones(max(which) + 1))[which]
            self.areas[name] = _larger(self.areas.get(name), np.where(area > 0.0, area, 0.0))
        for (name, _), which in rows.items():
            found = {column: np.nan_to_num(np.abs(values[which])) for column, values in numbers.items()}
            nothing, area = np.zeros(len(which)), self.areas[name]
            area = np.where(area > 0.0, area, 1.0)
            total = [found[c] for c in found if c in ("normal", "shear") or c.startswith("force_")]
            total += [found[c] / self.length(area) for c in found if c.startswith("moment_")]
            local = [found.get(c, nothing) for c in ("pressure_min", "pressure_max", "shear_max")]
            force = np.max([nothing, *total], axis=0)
            self.forces[name] = _larger(self.forces.get(name), force)
            self.pressures[name] = _larger(self.pressures.get(name), np.max([force / area, *local], axis=0))

    def length(self, area: Array) -> Array:
        return area if self.plane else np.sqrt(area)

    def of(self, name: str, column: str, count: int) -> Array:
        force, pressure, area = (self.near(name, of) for of in (self.forces, self.pressures, None))
        if column.startswith("pressure") or column == "shear_max":
            return pressure
        if column.startswith("moment"):
            return force * self.length(area)
        if column == "area":
            return self.areas[name]
        if column == "slip_use":
            own = np.where(self.forces[name] > 0.0, self.forces[name], 1.0)
            return np.maximum(force / own, 1.0)
        return force

    def near(self, name: str, of: Mapping[str, Array] | None) -> Array:
        if of is None:
            return self.areas[name]
        mine = of[name]
        for other in self.neighbours.get(name, ()):
            if other in of and len(of[other]) == len(mine):
                mine = np.maximum(mine, of[other])
        whole = np.max([each for each in of.values() if len(each) == len(mine)], axis=0)
        return np.maximum(mine, ROUNDING * whole)


def _larger(first: Array | None, second: Array) -> Array:
    return second if first is None or len(first) != len(second) else np.maximum(first, second)


def _neighbours(problem: Any) -> dict[str, set[str]]:
    """Interface -> interfaces at the same parts, itself among them."""
    parts = {name: {side.substructure for side in each.sides} for name, each in problem.interfaces.items()}
    return {name: {other for other in parts if parts[other] & mine} for name, mine in parts.items()}


def _joined(key: str, name: str) -> str:
    return f"{key}.{name}" if key else name


def keys(seen: Observation) -> Iterator[str]:
    """All that is compared."""
    yield from (*seen.values, *seen.words, *seen.said)
