"""One point of a sweep or a sampling, with everything that a deterministic answer offers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import checked_whole
from dolfinx_frontend.common.describe import shown_error
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.results.answer import AnswerKind, Block, Surface
from dolfinx_frontend.results.face import Face

__all__ = ["OnePoint", "point_number"]


def point_number(index: Sequence[int], shape: tuple[int, ...]) -> int:
    """Number of a point of a grid, the last one for no index.

    Raises
    ------
    SceneError
        There is no such point.
    """
    at = tuple(checked_whole("point", "index", i) for i in index) or (-1,) * len(shape)
    if not shape or len(at) != len(shape) or any(not -n <= i < n for i, n in zip(at, shape, strict=True)):
        raise SceneError(f"point: there is no point {at}, there are {' x '.join(map(str, shape)) or 'none'}")
    return int(np.ravel_multi_index([i % n for i, n in zip(at, shape, strict=True)], shape))


class OnePoint(Face):
    """The answer at one point, as a deterministic one.

    Attributes
    ----------
    whole
        Of which it is a point.
    status, iterations, error, place
        How its iteration ended, global stages, estimated relative error (NaN: not known) and where it is
        largest.
    kept
        Whether its state is known, whatever the whole has of others.
    """

    status: str = ""

    def __init__(
        self,
        whole: Any,
        block: Callable[[], Block],
        status: str,
        iterations: int,
        error: float,
        place: str = "",
        kept: bool = False,
    ) -> None:
        self._kept = kept
        self.whole, self._block = whole, block
        self.problem, self.plan, self.seconds = whole.problem, whole.plan, whole.seconds
        self.status, self.iterations, self.error, self.place = status, iterations, error, place

    def __repr__(self) -> str:
        where = f" in {self.place}" if self.place and not self.converged else ""
        error = shown_error(self.error)
        return f"OnePoint({self.status}, {self.iterations} iterations, estimated error {error}{where})"

    @property
    def kind(self) -> AnswerKind:
        """``"deterministic"``, or ``"history"`` of a load history."""
        return "deterministic" if self.times is None else "history"

    @property
    def statuses(self) -> tuple[str, ...]:
        """Status of every time step, of a static answer one: that of the point."""
        return (self.status,) * (1 if self.times is None else len(self.times))

    @property
    def converged(self) -> bool:
        """Whether the tolerance was reached."""
        return self.status == "converged"

    @property
    def known(self) -> tuple[str, ...]:
        """Interfaces whose force is known at their points."""
        known: tuple[str, ...] = self.whole.known
        return known

    @property
    def without_displacements(self) -> str | None:
        """Why there are no displacements, and how to get them; None: there are."""
        if self._kept:
            return None
        why: str | None = self.whole.without_displacements
        return why

    def surface(self, interface: str) -> Surface:
        """An interface as tables and figures see it."""
        found: Surface = self.whole.surface(interface)
        return found

    def load(self, interface: str) -> Array | None:
        """Force of a load that was assembled into its part, as of the whole; None: it is no such load."""
        found: Array | None = self.whole.load(interface)
        return found

    def why_unknown(self, interface: str) -> str | None:
        """Why the force of an interface not in `known` cannot follow from equilibrium; None: it may."""
        why: str | None = self.whole.why_unknown(interface)
        return why

    def function(self, part: str, unknowns: Array, name: str) -> Any:
        """Unknowns (n,) as a dolfinx function."""
        return self.whole.function(part, unknowns, name)

    @cached_property
    def _one(self) -> Block:
        one = self._block()
        # no sample any more
        return Block(1, one._both, one._displacement, one._contact, _load=one._load, _parts=one._parts)

    def blocks(self, samples: int | None = None, seed: int = 0) -> Iterator[Block]:
        """The point as one sample."""
        yield self._one

    def force(self, interface: str) -> Array:
        """Force per area on side 1, ([T,] m, components), local frame: component 0 is normal."""
        self._check_interface(interface)
        force: Array = self._one.force(interface)[0]
        return force

    def jump(self, interface: str) -> Array:
        """Jump w2 - w1, ([T,] m, components), length, local frame."""
        self._check_interface(interface)
        jump: Array = self._one.jump(interface)[0]
        return jump

    def unknowns(self, part: str) -> Array:
        """Unknowns ([T,] n) of a part, length."""
        self._check_part(part)
        u: Array = self._one.displacement(part)[0]
        return u
