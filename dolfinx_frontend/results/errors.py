"""Errors of an answer by their source, as values; :mod:`dolfinx_frontend.estimate` measures them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple, Protocol, get_args, overload

import numpy as np
import numpy.typing as npt

from dolfinx_frontend.common.describe import shown_error
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.html import Shown
from dolfinx_frontend.results.resultant import Interest, Wanted
from dolfinx_frontend.uncertainty.statistics import Compared, ErrorShare, MeanStd, share_of

__all__ = [
    "Continuation",
    "EnergyBound",
    "Errors",
    "Estimator",
    "Kind",
    "MeshStep",
    "Place",
    "Source",
    "not_continued",
    "not_measured",
]

Kind = Literal["estimate", "bound"]
Source = Literal["algebraic", "truncation", "field", "discretisation"]


class Place(NamedTuple):
    """Where an error of the meshes is from.

    Attributes
    ----------
    part
        Its name.
    share
        What its cells contribute, of all that cells contribute: 0..1.
    at
        Where in it, (d,): the middle of the cell that contributes most.
    cells, size
        How many cells it has, and the length of the edges of the smallest one.
    """

    part: str
    share: float
    at: tuple[float, ...]
    cells: int
    size: float


class MeshStep(NamedTuple):
    """One mesh on the way to an accuracy.

    Attributes
    ----------
    unknowns
        Of all parts.
    value
        The quantity, at the means of what is random; None: the energy norm was asked for.
    error
        Relative error of the meshes, as it is believed.
    seconds
        Wall time from the beginning until it was known.
    changed
        Parts that had got new meshes for it, and how.
    kept
        Bodies whose factors were kept, of how many.
    """

    unknowns: int
    value: float | None
    error: float
    seconds: float
    changed: dict[str, str]
    kept: tuple[int, int]

    def __str__(self) -> str:
        value = "" if self.value is None else f", value {self.value:.6g}"
        changed = ", ".join(f"{name} {how}" for name, how in self.changed.items())
        kept = f" (factors kept: {self.kept[0]} of {self.kept[1]})" if changed and self.kept[0] else ""
        text = f"{self.unknowns} unknowns{value}, meshes {shown_error(self.error)}"
        return text + (f"; {changed}{kept}" if changed else "")


@dataclass(frozen=True, repr=False)
class EnergyBound(Shown):
    """How far an answer is from the exact one in energy, at most: ``result.errors(kind="bound")``.

    Attributes
    ----------
    total
        Square root of the energy (twice the strain energy) of the error, at most: sqrt(force * length).
    whole
        The same of the answer.
    parts, interfaces
        What each part, each law of an interface contributes: the root of the sum of their squares is `total`.
    notes
        Why it is an estimate and no bound; empty: it is proven, but for rounding and the answer's `error`.
    seconds
        Wall time.
    cells
        Part -> squares (cells,) that its cells contribute.
    """

    total: float
    whole: float
    parts: dict[str, float]
    interfaces: dict[str, float]
    notes: tuple[str, ...] = ()
    seconds: float = field(default=0.0, compare=False)
    cells: dict[str, npt.NDArray[np.float64]] = field(default_factory=dict, repr=False, compare=False)

    @property
    def strict(self) -> bool:
        """Whether it is proven."""
        return not self.notes

    @property
    def relative(self) -> float:
        """`total` over `whole`."""
        return share_of(self.total, self.whole)

    def __repr__(self) -> str:
        return f"EnergyBound({'at most' if self.strict else 'about'} {shown_error(self.relative)} in energy)"

    def __str__(self) -> str:
        lines = [f"error in energy: {'at most' if self.strict else 'about'} {shown_error(self.relative)}"]
        for name, value in sorted({**self.parts, **self.interfaces}.items(), key=lambda each: -each[1]):
            lines.append(f"  {name:<24}{shown_error(share_of(value, self.whole)):>9}")
        return "\n".join([*lines, *(f"  no bound: {note}" for note in self.notes)])


@dataclass(frozen=True, repr=False)
class Errors(Shown):
    """Errors of an answer by their source.

    Attributes
    ----------
    algebraic, truncation, discretisation
        Of the iteration, of the chaos or the samples (None: nothing is random), of the meshes (None: not
        estimated).
    field
        Of the modes that random fields leave out (None: there are none, or it was not measured).
    quantity, moments
        What they are measured in (None: the energy norm), and its value.
    whole
        What an error of the standard deviation is relative to: the deviation, or the mean where it is noise.
    asked
        The accuracy that was asked for, or None.
    next_halving
        What would halve the dominating error, and its predicted cost.
    notes
        What a reader must know: sources that could not be reduced as asked.
    places
        Parts that the error of the meshes is from, the largest share first (``solve(scene, accuracy=...)``).
    steps
        The meshes on the way to the answer, of the same.
    """

    algebraic: ErrorShare
    truncation: ErrorShare | None
    discretisation: ErrorShare | None
    quantity: Wanted | None
    moments: MeanStd | None
    whole: float | None = None
    asked: float | None = None
    next_halving: str = ""
    notes: tuple[str, ...] = ()
    field: ErrorShare | None = None
    places: tuple[Place, ...] = ()
    steps: tuple[MeshStep, ...] = ()

    def relative(self, source: Source) -> float:
        """One error, relative: the larger of mean and deviation, or that in the energy norm; 0: none."""
        share: ErrorShare | None = getattr(self, source)
        if share is None:
            return 0.0
        if self.quantity is None or self.moments is None or share.quantity is None:
            return share.energy
        parts = [share_of(share.quantity, self.quantity.compared.size(*self.moments))]
        if share.std is not None and self.whole is not None:
            parts.append(share_of(share.std, self.whole))
        return max(parts)

    @property
    def dominating(self) -> Source:
        """The largest source."""
        return max(get_args(Source), key=lambda s: np.nan_to_num(self.relative(s)))

    @property
    def total(self) -> float:
        """Relative error of the answer on its meshes: algebraic, truncation and field together."""
        return self.relative("algebraic") + self.relative("truncation") + self.relative("field")

    @property
    def in_all(self) -> float:
        """The same with the error of the meshes, as far as it is known."""
        return self.total + self.relative("discretisation")

    @property
    def reached(self) -> bool:
        """Whether the accuracy that was asked for is reached; the meshes count as far as they are known."""
        return self.asked is None or self.in_all <= self.asked

    def __repr__(self) -> str:
        of = "the energy norm" if self.quantity is None else str(self.quantity)
        return f"Errors(of {of}: {shown_error(self.in_all)} in all, most of it {self.dominating})"

    def __str__(self) -> str:
        where = "energy norm" if self.quantity is None else str(self.quantity)
        lines = [f"errors in the {where}" + (f", asked {self.asked:g}" if self.asked else "")]
        if self.quantity is not None and self.quantity.compared != Compared():
            lines[0] += f" {self.quantity.compared}"
        if self.moments is not None:
            spread = "" if self.moments.std is None else f", standard deviation {self.moments.std:.6g}"
            lines[0] += f" (value {self.moments.mean:.6g}{spread})"
        for source in get_args(Source):
            share: ErrorShare | None = getattr(self, source)
            if share is not None:
                mark = "  <- dominates" if source == self.dominating else ""
                relative = self.relative(source)
                lines.append(f"  {source:<15}{shown_error(relative):>9}  ({share.how}){mark}")
        for place in self.places:
            at = ", ".join(f"{v:.4g}" for v in place.at)
            lines.append(
                f"    {100.0 * place.share:3.0f} % of it in {place.part}, {place.cells} cells down to "
                f"{place.size:.3g}, most near ({at})"
            )
        lines += [f"  mesh {number}: {step}" for number, step in enumerate(self.steps, start=1)]
        if self.next_halving:
            lines.append(f"  half of it: {self.next_halving}")
        return "\n".join(lines + [f"  {note}" for note in self.notes])


class Estimator(Protocol):
    """Measures the errors of a result, see :meth:`dolfinx_frontend.Result.errors`."""

    @overload
    def __call__(
        self, result: Any, quantity: Interest = None, kind: Literal["estimate"] = "estimate"
    ) -> Errors: ...

    @overload
    def __call__(self, result: Any, quantity: Interest = None, *, kind: Literal["bound"]) -> EnergyBound: ...


def not_measured(result: Any, quantity: Interest = None, kind: str = "estimate") -> Any:
    """The estimator of a result that was made without one."""
    raise SceneError(
        "this result was made without an estimator: dolfinx_frontend.errors(result) measures its errors"
    )


class Continuation(Protocol):
    """Carries the run of a result on to another tolerance, on the same factors."""

    def __call__(self, result: Any, rtol: float) -> Any: ...


def not_continued(result: Any, rtol: float) -> Any:
    """The continuation of a result that was made without one."""
    raise SceneError("this result was made without a continuation: solve again, with start=result")
