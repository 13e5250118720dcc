"""Tables of an answer: rows of interfaces, printed, as CSV or as a data frame."""

from __future__ import annotations

import csv
import io
import math
import textwrap
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from dolfinx_frontend.common import html
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import (
    check_known,
    checked_number,
    checked_numbers,
    checked_path,
)
from dolfinx_frontend.common.describe import columns
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.files import write_text
from dolfinx_frontend.common.frozen import ReadOnlyDict
from dolfinx_frontend.results.readings import Readings
from dolfinx_frontend.scene.amplitudes import check_step

__all__ = ["QUANTILES", "Table", "bolts", "summarise"]

QUANTILES = (0.05, 0.5, 0.95)
ROWS = 40
"""Rows of a printed table, with its blocks below each other."""
WIDTH = 110
"""Characters of a line of a printed table."""
_WORDS = ("interface", "law", "statistic")
"""Columns of words."""
_FORMULA, _BLANKS = ("=", "+", "-", "@"), ("\t", "\r", "\n")
"""What a formula begins with in a spreadsheet."""
ROUNDING = 1e-8
"""What a printed table shows as 0, relative to the largest number of its kind."""


@dataclass(frozen=True)
class Table:
    """Rows of words and numbers: ``print(table)``, ``table["pressure_max"]``, :meth:`value`, :meth:`to_csv`.

    Attributes
    ----------
    columns
        Name -> one entry per row.
    labels
        Columns that name a row: interface, and swept parameters, time, statistic where there are several.
    notes
        What is not in the table, and why.
    """

    columns: Mapping[str, Sequence[Any]]
    labels: tuple[str, ...]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        columns = ReadOnlyDict({name: tuple(entries) for name, entries in self.columns.items()})
        object.__setattr__(self, "columns", columns)

    def __len__(self) -> int:
        return len(self.columns[self.labels[0]])

    def __getitem__(self, column: str) -> npt.NDArray[Any]:
        """Entries of a column."""
        check_known("column", column, self.columns, "table")
        return np.asarray(self.columns[column])

    def value(self, column: str, interface: str, **labels: Any) -> float:
        """The number in the one row of an interface and, as given, its ``time``, ``statistic``, ...

        Raises
        ------
        SceneError
            No such row, or several.
        """
        keep = np.ones(len(self), dtype=bool)
        for name, wanted in {"interface": interface, **labels}.items():
            entries = self[name]
            if len(entries):  # of none the type is not known
                keep &= np.isclose(entries, wanted) if entries.dtype.kind == "f" else entries == wanted
        rows = np.flatnonzero(keep)
        if len(rows) != 1:
            wanted = ", ".join(f"{k} = {v!r}" for k, v in {"interface": interface, **labels}.items())
            raise SceneError(
                f"table: {len(rows)} rows with {wanted}; rows are told apart by {', '.join(self.labels)}"
            )
        return float(self[column][rows[0]])

    def by_time(self, column: str) -> Table:
        """One column of a history beside each other: a row per time (and statistic), a column per interface.

        ``print(result.table("bolt*", step=None).by_time("normal"))``.

        Raises
        ------
        SceneError
            No such column, or no history.
        """
        values = self[column]
        if "time" not in self.labels:
            raise SceneError(
                "by_time: there is no history in the table: solve with times=[...], and ask table(step=None)"
            )
        labels = tuple(name for name in self.labels if name != "interface")
        rows = dict.fromkeys(zip(*(self.columns[name] for name in labels), strict=True))
        names = tuple(dict.fromkeys(self.columns["interface"]))
        keys = zip(*(self.columns[name] for name in ("interface", *labels)), strict=True)
        found = {key: float(value) for key, value in zip(keys, values, strict=True)}
        columns: dict[str, Sequence[Any]] = dict(zip(labels, zip(*rows, strict=True), strict=True))
        columns |= {name: [found.get((name, *row), math.nan) for row in rows] for name in names}
        return Table(columns, labels, (f"{column} of each interface", *self.notes))

    def rows(self) -> Iterator[dict[str, Any]]:
        """One dict per row."""
        for entries in zip(*self.columns.values(), strict=True):
            yield dict(zip(self.columns, entries, strict=True))

    def to_csv(self, path: str | Path | None = None) -> str:
        """Comma-separated, numbers in full, empty where there are none; written to `path` if given.

        A text that a spreadsheet would take for a formula has an apostrophe in front.
        """
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(map(_cell, self.columns))
        for row in zip(*self.columns.values(), strict=True):
            writer.writerow(map(_cell, row))
        if path is not None:
            write_text(checked_path("to_csv", path), text.getvalue())
        return text.getvalue()

    def to_pandas(self) -> Any:
        """As a pandas DataFrame whose index are the labels."""
        try:
            import pandas  # type: ignore[import-untyped,unused-ignore]
        except ImportError as error:
            raise SceneError("to_pandas needs pandas: install it, or use to_csv") from error
        return pandas.DataFrame(self.columns).set_index(list(self.labels))

    def _cells(self) -> tuple[dict[str, list[str]], list[str]]:
        """Columns as they are shown, of a long table its two ends, and notes."""
        largest = self._largest()
        left_out = len(self) - ROWS if len(self) > ROWS + 1 else 0
        keep = [*range(ROWS // 2), *range(len(self) - ROWS // 2, len(self))] if left_out else range(len(self))
        shown = {
            n: [_shown(c[k], 0.0 if n in self.labels else ROUNDING * largest[self._kind(n)]) for k in keep]
            for n, c in self.columns.items()
            if not _empty(c)
        }
        if left_out:
            shown = {n: [*c[: ROWS // 2], "...", *c[ROWS // 2 :]] for n, c in shown.items()}
        more = f"{left_out} rows of {len(self)} are left out: to_csv(), to_pandas() and rows() have all; "
        more += "table(names, step=...) has fewer, by_time(column) puts interfaces beside each other"
        return shown, [*((more,) if left_out else ()), *self.notes]

    def _repr_html_(self) -> str:
        shown, notes = self._cells()
        left = [name in _WORDS for name in shown]
        return html.table(list(shown), list(zip(*shown.values(), strict=True)), left, notes)

    def _kind(self, column: str) -> str:
        return _kind(column) if "interface" in self.labels else ""  # beside each other they are of one kind

    def __str__(self) -> str:
        shown, every = self._cells()
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
        texts = [self._block(shown, [*self.labels, *names]) for names in blocks]
        notes = [line for note in every for line in textwrap.wrap(note, WIDTH)]
        return "\n\n".join(texts) + "".join(f"\n{line}" for line in notes)

    def _largest(self) -> dict[str, float]:
        """Largest number of each kind; of moments at least that of the forces at the size of a face."""
        largest: dict[str, float] = {}
        for name, column in self.columns.items():
            if name in self.labels:
                continue
            numbers = [abs(v) for v in column if isinstance(v, float) and math.isfinite(v)]
            largest[self._kind(name)] = max([largest.get(self._kind(name), 0.0), *numbers])
        if "ratio" in largest:
            largest["ratio"] = 1.0
        if "moment" in largest:
            axes = sum(name.startswith("force_") for name in self.columns)
            size = largest["area"] ** (1.0 / (axes - 1))
            largest["moment"] = max(largest["moment"], largest["force"] * size)
        return largest

    def _block(self, shown: dict[str, list[str]], names: list[str]) -> str:
        sides = "".join("<" if n in _WORDS else ">" for n in names)
        own = [k for k, name in enumerate(names) if name not in self.labels]
        every = list(zip(*(shown[n] for n in names), strict=True))
        rows = [row for row in every if not own or any(row[k] != "-" for k in own)]
        return "\n".join(columns([names, *rows], sides))

    def __repr__(self) -> str:
        return str(self)


def _cell(value: Any) -> Any:
    """What a cell of a CSV file has: nothing for NaN, an apostrophe in front of a text that is a formula."""
    if not isinstance(value, str):
        return "" if isinstance(value, float) and math.isnan(value) else value
    # spreadsheets leave out blanks, and take the wide forms of these signs, too
    begins = unicodedata.normalize("NFKC", value.lstrip()[:1])
    return f"'{value}" if begins in _FORMULA or value[:1] in _BLANKS else value


def _kind(column: str) -> str:
    """Kind of a column; a number far below the others of its kind is rounding."""
    if column in ("normal", "shear", "before", "after", "change", "lowest", "highest"):
        return "force"
    if column in ("slip_use", "slip_share", "slip_safety", "damage", "damaged_share", "broken_share"):
        return "ratio"
    if column == "slip":
        return "length"
    return "pressure" if column == "shear_max" else column.split("_")[0]


def _empty(column: Sequence[Any]) -> bool:
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
    found: dict[str, Array] = {}
    with np.errstate(invalid="ignore"):  # a safety without a load is infinite
        mean = found["mean"] = np.average(values, axis=0, weights=weights)
        if weights is not None:
            # a rule with negative weights may be too coarse for a variance
            square = np.average((values - mean) ** 2, axis=0, weights=weights)
            found["std"] = np.sqrt(np.maximum(square, 0.0))
        else:
            lost = 0 if readings.statistics == "qmc" else 1
            many = len(values) > 1
            found["std"] = np.std(values, axis=0, ddof=lost) if many else np.full_like(mean, np.nan)
            for q in quantiles:
                found[f"{100.0 * q:g} %"] = np.quantile(values, q, axis=0, method="median_unbiased")
    yield from found.items()


def _check_quantiles(quantiles: Sequence[float]) -> None:
    for q in checked_numbers("table", "quantiles", quantiles, "give probabilities", dimensions=1):
        checked_number("table", "quantile", float(q), above=0.0, below=1.0)


def _collect(
    readings: Readings, numbers: Mapping[str, Mapping[str, Array]], quantiles: Sequence[float]
) -> Iterator[tuple[str, dict[str, Any], dict[str, Array]]]:
    """Interface, labels of its rows (point of a sweep, statistic), column -> ([T,]) numbers."""
    for name, values in numbers.items():
        if readings.random:
            each = {column: dict(_statistics(v, readings, quantiles)) for column, v in values.items()}
            for statistic in next(iter(each.values())):
                yield name, {"statistic": statistic}, {c: found[statistic] for c, found in each.items()}
        elif readings.coordinates:
            for point in range(len(next(iter(readings.coordinates.values())))):
                at = {axis: float(v[point]) for axis, v in readings.coordinates.items()}
                yield name, at, {column: v[point] for column, v in values.items()}
        else:
            yield name, {}, dict(values)


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

    Raises
    ------
    SceneError
        No such step, or a quantile that is no probability.
    """
    _check_quantiles(quantiles)
    times = readings.times
    every = range(1 if times is None else len(times))
    chosen = every if step is None else [check_step(times, step, "table")]
    labels = ["interface", *readings.coordinates]
    labels += ["time"] if times is not None else []
    labels += ["statistic"] if readings.random else []
    numbers = {name: m.about(about) for name, m in readings.interfaces.items()}
    columns: dict[str, list[Any]] = {name: [] for name in (*labels, "law")}
    for name, at, values in _collect(readings, numbers, quantiles):
        for k in chosen:
            row = {"interface": name, "law": readings.interfaces[name].law, **at}
            if times is not None:
                row["time"] = float(times[k])
            row |= {column: float(np.atleast_1d(block)[k]) for column, block in values.items()}
            for column, value in row.items():
                columns.setdefault(column, []).append(value)
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
    labels = ("interface", *readings.coordinates, *(("statistic",) if readings.random else ()))
    columns: dict[str, list[Any]] = {name: [] for name in (*labels, "tightened")}
    for name, at, values in _collect(readings, numbers, quantiles):
        step = readings.interfaces[name].bolt
        row: dict[str, Any] = {"interface": name, "tightened": float(readings.times[step or 0])}
        row |= {**at, **{column: float(block) for column, block in values.items()}}
        for column, value in row.items():
            columns.setdefault(column, []).append(value)
    return Table(columns, labels)
