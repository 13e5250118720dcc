"""What every answer offers, however it was computed, and what everything that reads answers knows of them.

Tables, files, ParaView and figures take an :class:`Answer` and never ask which one it is. They see it as
blocks of samples: a deterministic answer is one sample, a chaos is evaluated at as many as are wanted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.checks import checked_reals
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.frozen import locked
from dolfinx_frontend.plan.plan import Plan
from dolfinx_frontend.results.contact import BondValues, ContactValues
from dolfinx_frontend.scene.loads import OF_STIFFNESS
from dolfinx_frontend.uncertainty.quantities import Kind

__all__ = [
    "SAMPLES",
    "Answer",
    "AnswerKind",
    "Block",
    "Of",
    "OfPart",
    "Surface",
    "check_answer",
    "chunks",
    "one_number_a_sample",
    "stepped",
    "timed",
]

T = TypeVar("T")
AnswerKind = Literal["deterministic", "history", "chaos", "samples", "sweep"]
Of = Literal["force", "jump", "displacement"]
OfPart = Literal["displacement", "stress", "von Mises", "principal"]

SAMPLES = 4096
"""Samples of a chaos from which a table is made."""
BYTES = 1e8
"""Fields of samples that are evaluated at once."""
CACHED = 1e7
"""The same, where what is read of them is one number: the fields stay in the processor's cache."""


@dataclass(frozen=True)
class Surface:
    """An interface as its answer sees it.

    Attributes
    ----------
    law
        Name of its law.
    points, weights, normals
        (m, d) on side 1, length; (m,) areas; (m, d) out of side 1.
    frames
        (m, components, d), directions of the components of force and jump in global axes.
    contact
        Whether it can open and slip.
    wrench
        Force (d,) and moment of a force 1, of an interface between mean motions of faces; None: it has
        points.
    bolt
        The step that ends the tightening if it is a bolt in a load history, else None.
    places, mean_normals
        (m, d), of which resultants are made, see :class:`Interface`; None: the points, and their normals.
    """

    name: str
    law: str
    points: Array = field(repr=False)
    weights: Array = field(repr=False)
    normals: Array = field(repr=False)
    frames: Array = field(repr=False)
    contact: bool = False
    bolt: int | None = None
    wrench: Array | None = field(default=None, repr=False)
    places: Array | None = field(default=None, repr=False)
    mean_normals: Array | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        locked(self)

    @property
    def acting(self) -> tuple[Array, Array]:
        """(m, d) places, and (m, components, d), what a unit of each component adds to the resultant, per
        area."""
        places = self.points if self.places is None else self.places
        if self.mean_normals is None:
            return places, self.frames
        out = np.einsum("pcd,pd->pc", self.frames, self.normals)
        return places, self.frames + out[:, :, None] * (self.mean_normals - self.normals)[:, None]

    @property
    def dim(self) -> int:
        """Space dimension d."""
        return int(self.points.shape[1])

    @property
    def area(self) -> float:
        """Sum of the weights."""
        return float(self.weights.sum())

    @property
    def centre(self) -> Array:
        """(d,), centroid."""
        centre: Array = self.weights @ self.acting[0] / self.weights.sum()
        return centre

    def vectors(self, values: Array) -> Array:
        """Values (..., m, components) as vectors (..., m, d) in global axes."""
        out: Array = np.einsum("...pc,pcd->...pd", values, self.frames)
        return out


@dataclass(frozen=True, repr=False)
class Block:
    """Some samples of an answer side by side: what a quantity of interest is computed from.

    Over a load history every field has the T time steps after the samples. A deterministic answer is one
    sample without germs.

    Attributes
    ----------
    germs
        (n, L) points, or None.
    weights
        (n,) of a quadrature, or None.
    """

    count: int
    _both: Callable[[str], tuple[Array, Array]]
    _displacement: Callable[[str, Ints | None], Array]
    _contact: Callable[[str], ContactValues | BondValues | None] = lambda _: None
    germs: Array | None = None
    weights: Array | None = None
    _force: Callable[[str], Array] | None = None
    _load: Callable[[str, str], Array] | None = None
    _parts: Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        locked(self)

    def __len__(self) -> int:
        return self.count

    def __repr__(self) -> str:
        where = "" if self.germs is None else f" at points of {self.germs.shape[1]} germs"
        return f"Block({self.count} sample{'s' if self.count != 1 else ''}{where})"

    def force(self, interface: str) -> Array:
        """Force per area on side 1, (n, [T,] m, components), local frame: component 0 is normal.

        A nonlinear law of a chaos is evaluated again at every sample, with the parameters of the
        sample: it holds exactly, so that a contact never pulls.
        """
        return self._both(interface)[0] if self._force is None else self._force(interface)

    def jump(self, interface: str) -> Array:
        """Jump w2 - w1, (n, [T,] m, components), length, local frame."""
        return self._both(interface)[1]

    def both(self, interface: str) -> tuple[Array, Array]:
        """Force and jump, for the work of one."""
        return self._both(interface)

    def displacement(self, part: str, unknowns: Ints | None = None) -> Array:
        """Unknowns (n, [T,] unknowns) of a part, length; of some of them only if their numbers are given."""
        return self._displacement(part, unknowns)

    def space(self, part: str) -> Any:
        """The function space that the unknowns of a part of this rank are of; None: it is not known."""
        return None if self._parts is None or part not in self._parts else self._parts[part].space

    def load(self, load: str, parameter: str) -> Array:
        """What a shape of a load of a part is multiplied with, (n, [T])."""
        assert self._load is not None  # only what is read from files has none, and no parts either
        return self._load(load, parameter)

    def factor(self, part: str) -> Array:
        """What the stiffness of a part is multiplied with, (n,) or (1,); a random field (n, cells)."""
        return np.ones(1) if self._load is None else self._load(OF_STIFFNESS, part)

    def contact(self, interface: str) -> ContactValues | None:
        """Clearance and friction of a contact; None: it is none, or they are not known."""
        values = self._contact(interface)
        return values if isinstance(values, ContactValues) else None

    def bond(self, interface: str) -> BondValues | None:
        """Stiffness of a bond, which tells its damage; None: it is none, or it is not known."""
        values = self._contact(interface)
        return values if isinstance(values, BondValues) else None


class Answer(Protocol):
    """A deterministic answer, a load history, a chaos, samples, a sweep, or one of them read from a file."""

    @property
    def kind(self) -> AnswerKind:
        """What it is."""

    @property
    def status(self) -> str:
        """How the iterations ended, the worst of them."""

    @property
    def times(self) -> Array | None:
        """(T,) of a load history, or None."""

    @property
    def problem(self) -> Any:
        """Parts and interfaces by name."""

    @property
    def plan(self) -> Any:
        """How it was solved."""

    @property
    def known(self) -> tuple[str, ...]:
        """Interfaces whose force is known at their points."""

    @property
    def statistics(self) -> Kind:
        """How the samples are to be read: ``"value"`` is one, not random, ``"grid"`` those of a sweep."""

    @property
    def coordinates(self) -> Mapping[str, Array]:
        """Of a sweep: swept parameters -> their values at all points, (n,)."""

    @property
    def without_displacements(self) -> str | None:
        """Why there are no displacements, and how to get them; None: there are."""

    def surface(self, interface: str) -> Surface:
        """An interface as the answer sees it."""

    def bridged(self, joints: Sequence[str]) -> tuple[str, ...]:
        """What beams carry of the shear of joints whose slip is asked for, a sentence each."""

    def why_unknown(self, interface: str) -> str | None:
        """Why the force of an interface not in `known` cannot follow from equilibrium; None: it may."""

    def load(self, interface: str) -> Array | None:
        """Force ([T,] m, components) that is prescribed, the same in all samples; None: it is an answer."""

    def force(self, interface: str) -> Array:
        """Force per area on side 1, local frame; of a chaos the mean, of samples and sweeps all of them."""

    def jump(self, interface: str) -> Array:
        """Jump w2 - w1, local frame."""

    def displacement(self, part: str, step: int = -1) -> Any:
        """Displacement of a part as a dolfinx function; of a random answer its mean."""

    def stress(self, part: str, step: int = -1, of: str = "tensor") -> Any:
        """Stress of that displacement."""

    def std(self, part: str, step: int = -1, of: OfPart = "displacement") -> Any:
        """Standard deviation of a displacement or a stress."""

    def moments(self, name: str, of: Of | None = None) -> tuple[Array, Array]:
        """Mean and standard deviation."""

    def blocks(self, samples: int | None = None, seed: int = 0) -> Iterator[Block]:
        """The samples, some at a time; of a chaos this many random ones."""

    def moment_blocks(self) -> Iterator[Block]:
        """The samples from which moments of fields are made."""

    def shown(self) -> Block:
        """The one sample that fields are of where there are no moments: of a sweep its last point."""

    def modes_of(self, interface: str) -> tuple[Array, Array] | None:
        """Chaos coefficients (P + 1, [T,] m, components) of force and jump where moments follow from them."""

    def unknowns(self, part: str) -> Array:
        """Unknowns ([T,] n) of the displacement that is shown."""

    def spread(self, part: str) -> Sequence[Array]:
        """Unknowns ([T,] n) whose squares add up to the variance, of fields that are linear in them."""

    def load_number(self, load: str, parameter: str) -> Array:
        """What a shape of a load of a part is multiplied with, ([T]), in what is shown."""

    def load_spread(self, load: str, parameter: str) -> Sequence[Array]:
        """Its modes ([T]) beside the mean, in the order of `spread`."""

    def deviation(self, part: str) -> Array | None:
        """Standard deviation ([T,] n) of the unknowns; None: nothing is random, or it is not known."""

    def function(self, part: str, unknowns: Array, name: str) -> Any:
        """Unknowns (n,) as a dolfinx function."""

    def everywhere(self, interface: str, read: Callable[[], T]) -> T:
        """What the rank of an interface's first side reads, on all ranks; collective."""


def check_answer(where: str, what: str, value: object) -> None:
    """Refuse what is no answer.

    Raises
    ------
    SceneError
        Where it was given, and what would do.
    """
    if not callable(getattr(value, "moment_blocks", None)):
        shown = short(value).partition("\n")[0]
        raise SceneError(f"{where}: {what} = {shown} is no answer; give what solve, a sweep or load returned")


def timed(plan: Plan, block: Array) -> Array:
    """Fields (..., columns of a history) as ([T,] ...): T only where the plan has times."""
    return block[..., 0] if plan.times is None else plan.in_time(block)


def stepped(values: Array, times: Array | None, leading: int = 0) -> Array:
    """Fields with an axis of time steps after this many others, with or without a history."""
    return values if times is not None else np.expand_dims(values, leading)


def chunks(count: int, numbers: int, size: float = BYTES) -> Iterator[slice]:
    """Slices of `count` samples of this many numbers each, whose fields fit into memory, or so many bytes."""
    chunk = max(1, int(size / (32.0 * max(numbers, 1))))
    return (slice(k, min(k + chunk, count)) for k in range(0, count, chunk))


def one_number_a_sample(values: npt.ArrayLike, count: int, name: str) -> Array:
    """Values (n,) of a quantity of interest, or an error that says what its function returned."""
    data = checked_reals(f"quantity {name!r}", "function(fields)", values, "return one number per sample")
    if data.shape != (count,):
        raise SceneError(
            f"quantity {name!r}: the function returned shape {data.shape} for {count} samples; "
            "return one number per sample"
        )
    return data
