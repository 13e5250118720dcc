"""Results as a mechanical engineer reads them: resultants, pressures, areas, bolt forces, as tables.

Signs: `force` and `moment` are what the interface exerts on its side 1, in global axes; the pressure is
-f_n, positive where the sides press on each other; `normal` is the total of f_n, positive in tension (the
force of a bolt); moments are about the centroid of the interface unless a point is given.
"""

from __future__ import annotations

import csv
import io
import math
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.substructure import Substructure
from dolfinx_frontend.assembly.values import resolve
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.errors import SceneError, unknown_name
from dolfinx_frontend.plan.plan import Plan
from dolfinx_frontend.plan.random_laws import RandomLaws
from dolfinx_frontend.results.surfaces import (
    chunks,
    contact_states,
    contact_values,
    law_frames,
    sampled_contact_values,
    vectors,
)
from dolfinx_frontend.results.uncertain import StochasticResult
from dolfinx_frontend.scene.amplitudes import check_step
from dolfinx_frontend.scene.laws import Contact, Displacement, Elastic, Law, Perfect, Preload, Symmetry
from dolfinx_frontend.uncertainty.quantities import Kind

if TYPE_CHECKING:
    from dolfinx_frontend.results.result import Result
    from dolfinx_frontend.solvers.chaos import ChaosResult
    from dolfinx_frontend.solvers.sampling import SampleResult

__all__ = [
    "Measures",
    "Readings",
    "Table",
    "bolts",
    "is_glue",
    "known_forces",
    "nodal_reaction",
    "read",
    "read_chaos",
    "read_samples",
    "summarise",
    "with_known_force",
]


QUANTILES = (0.05, 0.5, 0.95)
ELIMINATED = "eliminated, the force is not an unknown (solve with active=[...] to have it)"
SHARED = "eliminated, shares nodes with another support or glued face (solve with active=[...] to have it)"
SAMPLES = 4096
"""Samples of a chaos from which a table is made."""
WIDTH = 110
"""Characters of a line of a printed table."""
ROUNDING = 1e-8
"""What a printed table shows as 0, as a share of the largest number of its kind."""
ALIGNED = 1e-9
"""A normal within this of a global axis is that axis."""


# --- one interface ---------------------------------------------------------------------------------
@dataclass(frozen=True)
class Measures:
    """Numbers of one interface, each ([N,] [T]): a number a sample and a time step.

    Attributes
    ----------
    centre
        (d,), centroid of the interface, about which the moments are.
    values
        Column of the table -> numbers; NaN where the law has no such thing.
    law
        Name of its law.
    bolt
        The step that ends the tightening if the interface is a bolt in a load history, else None.
    """

    centre: Array
    values: dict[str, Array]
    law: str
    bolt: int | None = None

    def about(self, point: npt.ArrayLike | None) -> dict[str, Array]:
        """The numbers with moments about a point (d,); None: the centroid."""
        if point is None:
            return self.values
        d = len(self.centre)
        to = np.asarray(point, dtype=np.float64)
        if to.shape != (d,) or not np.all(np.isfinite(to)):
            raise SceneError(f"table: about = {point!r}; give a point of {d} coordinates")
        arm = self.centre - to
        force = [self.values[f"force_{a}"] for a in "xyz"[:d]]
        values = dict(self.values)
        for name, part in _cross(arm, force).items():
            values[name] = values[name] + part
        return values


def _cross(arm: Any, force: Sequence[Array]) -> dict[str, Array]:
    """Moment of a force at an arm, by column name: about z in 2D."""
    if len(force) == 2:
        return {"moment_z": arm[0] * force[1] - arm[1] * force[0]}
    return {
        f"moment_{'xyz'[k]}": arm[i] * force[j] - arm[j] * force[i]
        for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1)))
    }


def _resultants(points: Array, centre: Array, nodal: Array) -> dict[str, Array]:
    """Force and moment of forces (..., m, d) at points (m, d)."""
    arm = (points - centre).T
    parts = [nodal[..., a] for a in range(points.shape[1])]
    values = {f"force_{'xyz'[a]}": f.sum(axis=-1) for a, f in enumerate(parts)}
    return values | {k: v.sum(axis=-1) for k, v in _cross(arm, parts).items()}


def _centre(interface: Interface) -> Array:
    total: Array = interface.weights @ interface.points / interface.weights.sum()
    return total


def _vectors(interface: Interface, force: Array) -> Array:
    """Force per area (..., m, components) in the law's frames as vectors (..., m, d) in global axes."""
    return vectors(law_frames(interface), force)


def measure(
    interface: Interface, force: Array, limits: tuple[Array, Array] | None = None
) -> dict[str, Array]:
    """Numbers of an interface from its force per area.

    Parameters
    ----------
    force
        (..., m, components), in the frames of its law.
    limits
        Friction coefficient and threshold, each broadcast to (..., m); None: no friction.

    Returns
    -------
    dict
        Column -> (...,).
    """
    weights = interface.weights
    vector = _vectors(interface, force)
    values = {"area": np.full(force.shape[:-2], weights.sum())}
    values |= _resultants(interface.points, _centre(interface), weights[:, None] * vector)
    normal = np.einsum("...pd,pd->...p", vector, interface.normals)
    along = vector - normal[..., None] * interface.normals
    shear = np.sqrt(np.sum(along**2, axis=-1))
    values["normal"] = normal @ weights
    values["shear"] = np.linalg.norm(np.einsum("...pd,p->...d", along, weights), axis=-1)
    values["pressure_min"] = -normal.max(axis=-1)
    values["pressure_mean"] = -(normal @ weights) / weights.sum()
    values["pressure_max"] = -normal.min(axis=-1)
    values["shear_max"] = shear.max(axis=-1)
    nothing = np.full(force.shape[:-2], np.nan)
    values["open_area"] = values["slip_area"] = nothing
    if isinstance(interface.law, Contact):
        open_, slips = contact_states(normal, shear, limits)
        values["open_area"] = open_ @ weights
        values["slip_area"] = slips @ weights if limits is not None else nothing
    return values


def _tightened(interface: Interface, times: Array | None) -> int | None:
    """The step of a history that ends the tightening of a bolt; None if the interface is none."""
    law = interface.law
    if times is None or not _is_bolt(law):
        return None
    if isinstance(law, Preload):
        controlled = [k for k, t in enumerate(times) if law.controlled(t)]
        if law.until is None and law.during is None:
            return _settled([resolve(law.at(t).force, interface, 1, name="force") for t in times])
        return controlled[-1] if controlled else 0
    d = interface.dim
    return _settled([resolve(law.at(t).parameters()["jump"], interface, d, "first", "jump") for t in times])


def _settled(values: Sequence[Array]) -> int:
    """The first step from which nothing changes any more."""
    last = len(values) - 1
    while last > 0 and np.array_equal(values[last - 1], values[last]):
        last -= 1
    return last


def _is_bolt(law: Law) -> bool:
    if isinstance(law, Preload):
        return True
    if not isinstance(law, (Elastic, Contact)):
        return False
    try:
        return bool(np.any(np.asarray(law.jump, dtype=np.float64)))
    except (TypeError, ValueError):
        return True


# --- reactions of what was assembled across --------------------------------------------------------
def is_glue(law: Law) -> bool:
    """Whether the force of an eliminated interface is no unknown, but a reaction."""
    return isinstance(law, (Perfect, Displacement, Symmetry))


def _held_axes(interface: Interface) -> set[int] | None:
    """Global axes along which an interface of this kind acts; None: they are none of these."""
    d, law = interface.dim, interface.law
    if isinstance(law, Displacement):
        return set(law.axes(d))
    if isinstance(law, Symmetry):
        axis = int(np.argmax(np.abs(interface.normals[0])))
        flat = np.all(np.abs(np.abs(interface.normals[:, axis]) - 1.0) < ALIGNED)
        return {axis} if flat else None
    return set(range(d))


def _reaction(
    result: Result, name: str, steps: Sequence[float | None], forces: Mapping[str, Array]
) -> dict[str, Array] | None:
    """Resultants of an eliminated interface, see :func:`nodal_reaction`; None: not separable."""
    found = nodal_reaction(result, name, steps, forces)
    if found is None:
        return None
    number, nodal = found
    interface = result.problem.interfaces[name]
    side = interface.sides[number]
    x = result.problem.substructures[side.substructure].dof_coordinates[side.nodes]
    return _resultants(x, _centre(interface), nodal)


def nodal_reaction(
    result: Result, name: str, steps: Sequence[float | None], forces: Mapping[str, Array]
) -> tuple[int, Array] | None:
    """Forces of an eliminated interface on side 1 from the equilibrium of one of its parts.

    Parameters
    ----------
    steps
        Times; (None,) without a history.
    forces
        Force per area (T, m, components) of every interface whose force is an unknown.

    Returns
    -------
    tuple or None
        Number of the side, and (T, its nodes, d); None: another interface holds the same nodes.
    """
    problem = result.problem
    interface = problem.interfaces[name]
    own = _held_axes(interface)
    for number, side in enumerate(interface.sides):
        sign, mine = 1.0 - 2.0 * number, side.nodes
        part = problem.substructures[side.substructure]
        others = [
            (other, each)
            for other in problem.interfaces.values()
            for each in other.sides
            if other.name != name and other.name not in forces and each.substructure == part.name
        ]
        clash = [
            other.name
            for other, each in others
            if np.isin(mine, each.nodes).any()
            and (own is None or (axes := _held_axes(other)) is None or own & axes)
        ]
        if clash:
            continue
        nodal = sign * _residual(problem, part, result, steps, forces)
        away = sorted(set(range(interface.dim)) - (own or set(range(interface.dim))))
        nodal[..., away] = 0.0
        return number, nodal[:, mine]
    return None


def _residual(
    problem: Problem,
    part: Substructure,
    result: Result,
    steps: Sequence[float | None],
    forces: Mapping[str, Array],
) -> Array:
    """What holds a part beside its loads and the forces that are known, (T, nodes, d)."""
    d = part.dim
    u = np.atleast_2d(result.displacements[part.name])
    total = (part.matrix @ u.T).T - part.load
    for k, t in enumerate(steps):
        for amplitude, load in part.varying_loads.items():
            total[k] -= amplitude(t if t is not None else 0.0) * load
    out: Array = total.reshape(len(steps), -1, d)
    for name, force in forces.items():
        interface = problem.interfaces[name]
        for sign, side in zip((1.0, -1.0), interface.sides, strict=False):
            if side.substructure == part.name:
                weighted = sign * interface.weights[:, None] * _vectors(interface, force)
                out -= np.stack([side.shape.T @ each for each in weighted])
    return out


# --- all interfaces of a result --------------------------------------------------------------------
@dataclass(frozen=True)
class Readings:
    """Numbers of all interfaces of an answer, from which the tables are made.

    Attributes
    ----------
    interfaces
        Interface -> numbers.
    times
        (T,) of a load history, or None.
    kind
        How the samples are to be read; None: the answer is not random.
    weights
        (N,) of a quadrature, or None.
    missing
        Interface -> why it has no row.
    """

    interfaces: dict[str, Measures]
    times: Array | None = None
    kind: Kind | None = None
    weights: Array | None = None
    missing: dict[str, str] = field(default_factory=dict)

    def select(self, names: Sequence[str] | str | None) -> Readings:
        """Some of the interfaces."""
        if names is None:
            return self
        names = [names] if isinstance(names, str) else names
        for name in names:
            if name in self.missing:
                raise SceneError(f"table: interface {name!r}: {self.missing[name]}")
            if name not in self.interfaces:
                raise unknown_name("interface", name, self.interfaces, "table")
        return replace(self, interfaces={n: self.interfaces[n] for n in names})


def with_known_force(result: Result | SampleResult) -> list[str]:
    """Interfaces whose force is known at their points.

    Those that are active; of a deterministic answer also springs and loads that were assembled across, whose
    force follows from the displacements.
    """
    interfaces, active = result.problem.interfaces, result.plan.active
    if isinstance(result, StochasticResult):
        return list(active)
    return [name for name, each in interfaces.items() if name in active or not is_glue(each.law)]


def known_forces(result: Result) -> dict[str, Array]:
    """Force per area (T, m, components) of every interface whose force is known; collective."""
    forces: dict[str, Array] = {}
    for name in with_known_force(result):
        force = result.problem.everywhere(name, partial(result.force, name))
        forces[name] = force[None] if result.plan.times is None else force
    return forces


def read(result: Result) -> Readings:
    """Numbers of all interfaces of a deterministic answer; collective on several ranks."""
    problem, times = result.problem, result.plan.times
    steps: Sequence[float | None] = (None,) if times is None else list(times)
    forces = known_forces(result)
    found: dict[str, Measures] = {}
    missing: dict[str, str] = {}
    for name, interface in problem.interfaces.items():
        if name in forces:
            contact = contact_values(interface, times)
            values = measure(interface, forces[name], contact.limits if contact is not None else None)
        else:
            values = _of_reaction(result, name, steps, forces, missing)
            if not values:
                continue
        if times is None:
            values = {k: v[0] for k, v in values.items()}
        law_name = type(interface.law).__name__
        found[name] = Measures(_centre(interface), values, law_name, _tightened(interface, times))
    return Readings(found, times, missing=missing)


def _of_reaction(
    result: Result,
    name: str,
    steps: Sequence[float | None],
    forces: Mapping[str, Array],
    missing: dict[str, str],
) -> dict[str, Array]:
    """Numbers of an interface that was assembled across: its resultants; {} with the reason in `missing`."""
    interface = result.problem.interfaces[name]
    if result.problem.distribution is not None:
        missing[name] = ELIMINATED
        return {}
    resultants = _reaction(result, name, steps, forces)
    if resultants is None:
        missing[name] = SHARED
        return {}
    nothing = np.full(len(steps), np.nan)
    rest = (
        "normal", "shear", "pressure_min", "pressure_mean", "pressure_max", "shear_max", "open_area",
        "slip_area",
    )  # fmt: skip
    values = {"area": np.full(len(steps), interface.area)} | resultants | dict.fromkeys(rest, nothing)
    normal = interface.normals[0]
    if np.all(np.abs(interface.normals - normal) < ALIGNED):  # plane: its total is that of the resultant
        vector = np.stack([resultants[f"force_{a}"] for a in "xyz"[: interface.dim]], axis=-1)
        along = vector @ normal
        values["normal"] = along
        values["shear"] = np.linalg.norm(vector - along[:, None] * normal, axis=-1)
        values["pressure_mean"] = -along / interface.area
    return values


def _limits(random: RandomLaws, plan: Plan, name: str, germs: Array) -> tuple[Array, Array] | None:
    """Friction and threshold at points of the germs, what broadcasts to (N, [T,] m)."""
    contact = sampled_contact_values(random, plan, name, germs)
    limits = None if contact is None else contact.limits
    if limits is None or plan.times is not None:
        return limits
    return limits[0][:, 0], limits[1][:, 0]


def _in_chunks(
    interface: Interface,
    count: int,
    steps: int,
    at: Callable[[slice], tuple[Array, tuple[Array, Array] | None]],
) -> dict[str, Array]:
    """Numbers of an interface, some samples at a time."""
    numbers = interface.num_points * interface.dim * steps
    parts = [measure(interface, *at(part)) for part in chunks(count, numbers)]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _of_random(
    problem: Problem,
    plan: Plan,
    random: RandomLaws,
    germs: Array,
    at: Callable[[str, slice], Array],
    weights: Array | None,
    kind: Kind,
) -> Readings:
    steps = 1 if plan.times is None else len(plan.times)
    found = {}
    for name in plan.active:
        interface = problem.interfaces[name]

        def fields(part: slice, name: str = name) -> tuple[Array, tuple[Array, Array] | None]:
            return at(name, part), _limits(random, plan, name, germs[part])

        values = problem.everywhere(
            name,
            lambda i=interface, f=fields: _in_chunks(i, len(germs), steps, f),  # type: ignore[misc]
        )
        law_name = type(interface.law).__name__
        tightened = _tightened(interface, plan.times)
        found[name] = Measures(_centre(interface), values, law_name, tightened)
    missing = {name: ELIMINATED for name in problem.interfaces if name not in found}
    return Readings(found, plan.times, kind, weights, missing)


def read_chaos(result: ChaosResult, samples: int = SAMPLES, seed: int = 0) -> Readings:
    """Numbers of all active interfaces at random samples of a chaos."""
    germs = result.space.sample(samples, seed)
    return _of_random(
        result.problem,
        result.plan,
        result.random,
        germs,
        lambda name, part: result.at(germs[part]).force(name),
        None,
        "random",
    )


def read_samples(result: SampleResult) -> Readings:
    """Numbers of all active interfaces at the points of a sampling."""
    result.check_complete()
    return _of_random(
        result.problem,
        result.plan,
        result.random,
        result.germs,
        lambda name, part: result.force(name)[part],
        result.weights,
        result.kind,
    )


# --- tables ----------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Table:
    """Rows of words and numbers: ``print(table)``, ``table["pressure_max"]``, :meth:`value`, :meth:`to_csv`.

    Attributes
    ----------
    columns
        Name -> one entry a row.
    labels
        Columns that name a row: interface, and time, statistic where there are several.
    notes
        What is not in the table, and why.
    """

    columns: dict[str, list[Any]]
    labels: tuple[str, ...]
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.columns[self.labels[0]])

    def __getitem__(self, column: str) -> npt.NDArray[Any]:
        """Entries of a column."""
        if column not in self.columns:
            raise unknown_name("column", column, self.columns, "table")
        return np.asarray(self.columns[column])

    def value(self, column: str, interface: str, **labels: Any) -> float:
        """The number in the one row of an interface and, as given, its ``time`` and ``statistic``.

        Raises
        ------
        SceneError
            No such row, or several.
        """
        keep = np.ones(len(self), dtype=bool)
        for name, wanted in {"interface": interface, **labels}.items():
            entries = self[name]
            same = np.isclose(entries, wanted) if entries.dtype.kind == "f" else entries == wanted
            keep &= same
        rows = np.flatnonzero(keep)
        if len(rows) != 1:
            wanted = ", ".join(f"{k} = {v!r}" for k, v in {"interface": interface, **labels}.items())
            raise SceneError(
                f"table: {len(rows)} rows with {wanted}; rows are told apart by {', '.join(self.labels)}"
            )
        return float(self[column][rows[0]])

    def rows(self) -> Iterator[dict[str, Any]]:
        """One dict a row."""
        for entries in zip(*self.columns.values(), strict=True):
            yield dict(zip(self.columns, entries, strict=True))

    def to_csv(self, path: str | Path | None = None) -> str:
        """Comma-separated, numbers in full, empty where there are none; written to `path` if given."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(self.columns)
        for row in zip(*self.columns.values(), strict=True):
            writer.writerow(["" if isinstance(v, float) and math.isnan(v) else v for v in row])
        if path is not None:
            Path(path).write_text(text.getvalue(), encoding="utf-8")
        return text.getvalue()

    def to_pandas(self) -> Any:
        """As a pandas DataFrame whose index are the labels."""
        try:
            import pandas  # type: ignore[import-untyped,unused-ignore]
        except ImportError as error:
            raise SceneError("to_pandas needs pandas: install it, or use to_csv") from error
        return pandas.DataFrame(self.columns).set_index(list(self.labels))

    def __str__(self) -> str:
        largest = self._largest()
        shown = {
            n: [_shown(v, ROUNDING * largest[_kind(n)]) for v in c]
            for n, c in self.columns.items()
            if not _empty(c)
        }
        widths = {n: max(len(n), *(len(v) for v in c)) if c else len(n) for n, c in shown.items()}
        blocks: list[list[str]] = [[]]
        fixed = sum(widths[n] + 2 for n in self.labels)
        room = WIDTH - fixed
        for name in shown:
            if name in self.labels:
                continue
            if room < widths[name] + 2 and blocks[-1]:
                blocks.append([])
                room = WIDTH - fixed
            blocks[-1].append(name)
            room -= widths[name] + 2
        texts = [self._block(shown, widths, [*self.labels, *names]) for names in blocks]
        notes = [line for note in self.notes for line in textwrap.wrap(note, WIDTH)]
        return "\n\n".join(texts) + "".join(f"\n{line}" for line in notes)

    def _largest(self) -> dict[str, float]:
        """Largest number of each kind; of moments at least that of the forces at the size of a face."""
        largest: dict[str, float] = {}
        for name, column in self.columns.items():
            numbers = [abs(v) for v in column if isinstance(v, float) and math.isfinite(v)]
            largest[_kind(name)] = max([largest.get(_kind(name), 0.0), *numbers])
        if "moment" in largest:
            axes = sum(name.startswith("force_") for name in self.columns)
            size = largest["area"] ** (1.0 / (axes - 1))
            largest["moment"] = max(largest["moment"], largest["force"] * size)
        return largest

    def _block(self, shown: dict[str, list[str]], widths: dict[str, int], names: list[str]) -> str:
        def line(cells: Iterable[str]) -> str:
            padded = (
                c.ljust(widths[n]) if n in ("interface", "law", "statistic") else c.rjust(widths[n])
                for n, c in zip(names, cells, strict=True)
            )
            return "  ".join(padded).rstrip()

        rows = zip(*(shown[n] for n in names), strict=True)
        return "\n".join([line(names), *(line(row) for row in rows)])

    def __repr__(self) -> str:
        return str(self)


def _kind(column: str) -> str:
    """Columns of one kind are of one size: a number far below the others of its kind is rounding."""
    if column in ("normal", "shear", "before", "after", "change", "lowest", "highest"):
        return "force"
    return "pressure" if column == "shear_max" else column.split("_")[0]


def _empty(column: list[Any]) -> bool:
    return bool(column) and all(isinstance(v, float) and math.isnan(v) for v in column)


def _shown(value: Any, zero: float) -> str:
    if not isinstance(value, float):
        return str(value)
    if math.isnan(value):
        return "-"
    return "0" if abs(value) <= zero else f"{value:.5g}"


def _statistics(
    values: Array, readings: Readings, quantiles: Sequence[float]
) -> Iterator[tuple[str, Array]]:
    """Statistics over the samples, the first axis of the values."""
    weights = readings.weights
    mean = np.average(values, axis=0, weights=weights)
    yield "mean", mean
    if weights is not None:
        # a rule with negative weights may be too coarse for a variance
        yield "std", np.sqrt(np.maximum(np.average((values - mean) ** 2, axis=0, weights=weights), 0.0))
        return
    many = len(values) > 1
    yield "std", np.std(values, axis=0, ddof=1) if many else np.full_like(mean, np.nan)
    for q in quantiles:
        yield f"{100.0 * q:g} %", np.quantile(values, q, axis=0, method="median_unbiased")


def _check_quantiles(quantiles: Sequence[float]) -> None:
    for q in quantiles:
        if not 0.0 < q < 1.0:
            raise SceneError(f"table: quantile {q:g} must be between 0 and 1")


def _collect(
    readings: Readings, numbers: Mapping[str, Mapping[str, Array]], quantiles: Sequence[float]
) -> Iterator[tuple[str, str, dict[str, Array]]]:
    """Interface, statistic, column -> ([T,]) numbers."""
    for name, values in numbers.items():
        if readings.kind is None:
            yield name, "", dict(values)
            continue
        each = {column: dict(_statistics(v, readings, quantiles)) for column, v in values.items()}
        for statistic in next(iter(each.values())):
            yield name, statistic, {column: found[statistic] for column, found in each.items()}


def summarise(
    readings: Readings,
    step: int | None = -1,
    about: npt.ArrayLike | None = None,
    quantiles: Sequence[float] = QUANTILES,
) -> Table:
    """The table of the interfaces.

    Parameters
    ----------
    step
        Of a load history; None: all steps, one row each.
    about
        Point (d,) of the moments; None: the centroid of each interface.
    quantiles
        Probabilities, where the answer is random.
    """
    _check_quantiles(quantiles)
    times = readings.times
    every = range(1 if times is None else len(times))
    chosen = every if step is None else [check_step(times, step, "table")]
    labels = ["interface"]
    labels += ["time"] if times is not None else []
    labels += ["statistic"] if readings.kind is not None else []
    numbers = {name: m.about(about) for name, m in readings.interfaces.items()}
    columns: dict[str, list[Any]] = {name: [] for name in (*labels, "law")}
    for name, statistic, values in _collect(readings, numbers, quantiles):
        for k in chosen:
            columns["interface"].append(name)
            columns["law"].append(readings.interfaces[name].law)
            if times is not None:
                columns["time"].append(float(times[k]))
            if readings.kind is not None:
                columns["statistic"].append(statistic)
            for column, block in values.items():
                columns.setdefault(column, []).append(float(np.atleast_1d(block)[k]))
    reasons: dict[str, list[str]] = {}
    for name, why in readings.missing.items():
        reasons.setdefault(why, []).append(name)
    notes = tuple(f"no row for {', '.join(names)}: {why}" for why, names in reasons.items())
    return Table(columns, tuple(labels), notes)


def bolts(readings: Readings, quantiles: Sequence[float] = QUANTILES) -> Table:
    """Force of every bolt (tension > 0) when it is tightened and at the end of a load history.

    A bolt is an interface with :class:`Preload`, or with an `Elastic` or `Contact` law that has a jump (a
    shortening). `before`: at the last step of force control, or the first step from which force or jump are
    constant; `after`: at the last step; `lowest`, `highest`: in between; `change`: after - before.

    Raises
    ------
    SceneError
        There is no history, or no bolt in it.
    """
    _check_quantiles(quantiles)
    if readings.times is None:
        raise SceneError(
            "bolts: there is no load history to have a before and an after: solve with times=[...]; the "
            "force of a bolt is the column 'normal' of table()"
        )
    numbers = {}
    for name, each in readings.interfaces.items():
        if each.bolt is None:
            continue
        force = each.values["normal"]
        since = force[..., each.bolt :]
        before, after = force[..., each.bolt], force[..., -1]
        numbers[name] = {
            "before": before,
            "after": after,
            "change": after - before,
            "lowest": since.min(axis=-1),
            "highest": since.max(axis=-1),
        }
    if not numbers:
        raise SceneError(
            "bolts: no interface of the table is a bolt: a law Preload, or Elastic or Contact with a jump"
        )
    labels = ("interface",) if readings.kind is None else ("interface", "statistic")
    columns: dict[str, list[Any]] = {name: [] for name in (*labels, "tightened")}
    for name, statistic, values in _collect(readings, numbers, quantiles):
        step = readings.interfaces[name].bolt
        columns["interface"].append(name)
        columns["tightened"].append(float(readings.times[step]))
        if readings.kind is not None:
            columns["statistic"].append(statistic)
        for column, block in values.items():
            columns.setdefault(column, []).append(float(block))
    return Table(columns, labels)
