"""Laws of users: calls of their functions, checks of what they return, and the resolvent of a force law.

The kernel asks for f = R(j0 - c f) with the flexibility c; of a law that is given by R its own
:func:`latin_core.find_roots` finds the answer and calls R here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt
from latin_core import find_roots

from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import checked_reals, refuse_masked
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.scene.laws import Functions

__all__ = ["batched"]

Bools = npt.NDArray[np.bool_]
Batched: TypeAlias = Callable[[Array, Array, dict[str, Array], int], Array]

ANYTHING, FINITE = 1, 2
"""What the kernel allows a force to be, see :func:`latin_core.find_roots`; 0: infinite."""


def batched(law: Functions, interface: Interface) -> Batched:
    """The resolvent of functions as the kernel calls it, with checks that name interface, law and point."""
    asked = _Asked(law, interface)
    if law.resolve is not None:
        return asked.resolve
    return asked.invert


class _Asked:
    """The functions of a law at the points of an interface."""

    def __init__(self, law: Functions, interface: Interface) -> None:
        self.law = law
        self.points = interface.points
        self.who = f"interface {interface.name!r}, law {law.label!r}"

    def resolve(
        self, jump: Array, flexibility: Array, values: dict[str, Array], steps: int
    ) -> Array:
        """The answer of ``law.resolve``."""
        extra = {"steps": steps} if self.law.history else {}
        shape = jump.shape
        given = (jump.copy(), flexibility)
        force = self.call("resolve", self.law.resolve, shape, given, {**values, **extra})
        self.demand(np.isfinite(force), force, jump, "resolve")
        return force

    def call(
        self,
        what: str,
        function: Callable[..., npt.ArrayLike] | None,
        shape: tuple[int, ...],
        given: tuple[Array, ...],
        values: dict[str, Any],
    ) -> Array:
        """What a function of the user returns, as an array of the shape wanted."""
        assert function is not None
        try:
            with np.errstate(over="ignore"):  # far from the answer a law may be anything
                found = function(*given, **values)
                refuse_masked(f"{self.who}: what its {what} returned", found)
                answer: Any = np.asarray(found)
        except SceneError:
            raise
        except Exception as error:
            shapes = ", ".join(f"{name} {np.shape(v)}" for name, v in values.items() if np.ndim(v) == 2)
            hint = f"; values are (points, columns): {shapes}; write value[:, None] beside a jump"
            raise SceneError(
                f"{self.who}: its {what} raised {type(error).__name__}: {error}"
                + (hint if isinstance(error, ValueError) and "broadcast" in str(error) else "")
            ) from error
        if answer.dtype.kind not in "biuf":  # a complex number would lose a part of it
            answer = checked_reals(self.who, f"what its {what} returned", found, "return real numbers")
        numbers: Array = answer.astype(np.float64, copy=False)
        if numbers.shape != shape:
            names = "points, components, columns" if len(shape) == 3 else (
                "points, components, components, columns"
            )
            raise SceneError(
                f"{self.who}: its {what} returned an array of shape {numbers.shape}, expected "
                f"({names}) = {shape}"
            )
        return numbers

    def demand(self, good: Bools, answer: Array, jump: Array, what: str) -> None:
        """Raise at the first point where an answer is not good."""
        bad = ~good.all(axis=tuple(range(1, good.ndim)))
        if not bad.any():
            return
        point = int(np.argmax(bad))
        column = int(np.argmin(good[point].reshape(-1, good.shape[-1]).all(axis=0)))
        raise SceneError(
            f"{self.who}: its {what} returned {_text(answer[point, ..., column])} at point {point} "
            f"{_text(self.points[point])} for the jump {_text(jump[point, :, column])}"
        )

    def invert(
        self, jump: Array, flexibility: Array, values: dict[str, Array], steps: int
    ) -> Array:
        """The resolvent of ``law.force``."""
        points, count, columns = jump.shape

        def flat(field: Array) -> Array:  # (points * columns, components)
            return field.transpose(0, 2, 1).reshape(-1, count)

        def shaped(rows: Array) -> Array:
            return rows.reshape(points, columns, count).transpose(0, 2, 1)

        def force_at(rows: Array, allowed: int) -> Array:
            given = np.ascontiguousarray(shaped(rows))
            quiet: Literal["ignore"] | None = "ignore" if allowed == ANYTHING else None
            with np.errstate(divide=quiet, invalid=quiet):
                answer = self.call("force", self.law.force, jump.shape, (given,), values)
            if allowed != ANYTHING:  # infinite values far from the answer are no mistake
                good = np.isfinite(answer) if allowed == FINITE else ~np.isnan(answer)
                self.demand(good, answer, given, "force")
            return flat(answer)

        def tangent_at(rows: Array) -> Array:
            given = shaped(rows)
            shape = (points, count, count, columns)
            answer = self.call("tangent", self.law.tangent, shape, (given.copy(),), values)
            self.demand(np.isfinite(answer), answer, given, "tangent")
            return answer.transpose(0, 3, 1, 2).reshape(-1, count * count)

        tangent = tangent_at if self.law.tangent is not None else None
        flexible = flat(np.broadcast_to(flexibility, jump.shape))
        found, bad, off = find_roots(force_at, tangent, flat(jump), flexible)
        if any(bad):
            self._fail(np.array(bad).reshape(points, columns), jump, shaped(off))
        return shaped(found)

    def _fail(self, bad: Bools, jump: Array, residual: Array) -> None:
        point = int(np.argmax(bad.any(axis=1)))
        column = int(np.argmax(bad[point]))
        raise SceneError(
            f"{self.who}: no jump was found that its force holds at point {point} "
            f"{_text(self.points[point])}: free jump {_text(jump[point, :, column])}, off by "
            f"{np.abs(residual[point, :, column]).max():.3g}; is it continuous and monotone? Otherwise give "
            "resolve= in place of force="
        )


def _text(values: Array) -> str:
    flat = np.atleast_1d(values).ravel()
    return "(" + ", ".join(f"{value + 0.0:.6g}" for value in flat) + ")"
