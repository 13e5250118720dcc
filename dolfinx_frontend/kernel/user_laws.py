"""Laws of users: calls of their functions, checks of what they return, and the resolvent of a force law.

The kernel asks for f = R(j0 - c f) with the flexibility c. With j = j0 - c f and y = j / sqrt(c) that is

    G(y) = y + sqrt(c) R(sqrt(c) y) - j0 / sqrt(c) = 0,      G(y) . (y - z) >= |y - z|^2 at the root z

if R is monotone. So every value of G cuts off a half-space, and the first one leaves a ball for the root.
Newton's method is tried from the last point; where it leaves the ellipsoid that encloses what is left, or
does not halve |G|, the next point is the ellipsoid's centre. The ellipsoid shrinks whatever R is; see Bland,
Goldfarb and Todd, Operations Research 29 (1981) 1039-1091. Where the components of a law do not depend on
each other, each is a problem of its own, and the centre of its interval is bisection.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import checked_reals, refuse_masked
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.scene.laws import Functions

__all__ = ["batched"]

Bools = npt.NDArray[np.bool_]
Batched: TypeAlias = Callable[[Array, Array, dict[str, Array], int], Array]

EPSILON = float(np.finfo(np.float64).eps)
SETTLED = 8 * EPSILON
"""Residual, over the terms that it is the sum of, at which nothing is left but rounding."""
GOOD_ENOUGH = 1e-10
"""The same, after the last step."""
STEPS = 500
DEEPEST = 0.9
"""Deepest cut of an ellipsoid that is accepted; a cut of depth 1 removes all of it."""


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

        root = np.sqrt(flat(np.broadcast_to(flexibility, jump.shape)))
        free = flat(jump) / root

        def force_at(y: Array, nan: bool = False) -> Array:
            given = np.ascontiguousarray(shaped(root * y))
            answer = self.call("force", self.law.force, jump.shape, (given,), values)
            if not nan:  # infinite values far from the answer are no mistake
                self.demand(~np.isnan(answer), answer, given, "force")
            return flat(answer)

        # where the force at the free jump overflows, begin at jump 0
        y, force = free, force_at(free)
        far = _any(_endless(force))
        if far.any():
            y = np.where(far[:, None], 0.0, free)
            force = force_at(y)
            answer = shaped(force)
            self.demand(~_endless(answer), answer, shaped(root * y), "force")
        start = (y, force)
        for split in (True, False) if count > 1 else (True,):
            found = self._search(start, free, root, force_at, values, split)
            if found is not None:
                break
        assert found is not None
        y, force, bad = found
        if bad.any():
            off = shaped(root * (y + root * force - free))
            self._fail(_any(bad).reshape(points, columns), jump, off)
        # of the two ways to the force, the one that does not cancel
        way = np.abs(free - y) >= np.abs(y)
        return shaped(np.where(way, (free - y) / root, force))

    def _search(
        self,
        start: tuple[Array, Array],
        free: Array,
        root: Array,
        force_at: Callable[..., Array],
        values: dict[str, Array],
        split: bool,
    ) -> tuple[Array, Array, Bools] | None:
        """The root y, its force, and where none was found; None if `split` components are coupled."""
        y, force = start
        count = 1 if split else y.shape[1]
        diagonal = np.eye(y.shape[1], dtype=bool)

        def rows(field: Array) -> Array:
            return field.reshape(-1, count)

        def length(field: Array) -> Array:
            return np.asarray(np.linalg.norm(rows(field), axis=1), dtype=np.float64)

        residual = y + root * force - free
        norm = length(residual)
        region = (_Intervals if count == 1 else _Ellipsoids)(rows(y), rows(residual))
        done: Bools = np.zeros(len(norm), dtype=bool)
        fast: Bools = np.ones(len(norm), dtype=bool)
        size = norm
        for _ in range(STEPS):
            size = length(np.abs(y) + np.abs(root * force) + np.abs(free))
            done |= norm <= SETTLED * size
            if done.all():
                break
            tangent = self._tangent(y, force, free, root, force_at, values)
            if split and np.any(tangent[:, ~diagonal]):
                return None
            if split:
                step = _newton(tangent[:, diagonal].reshape(-1, 1, 1), rows(residual), rows(root))
            else:
                step = _newton(tangent, residual, root)
            # the force is taken from whichever of y and free - y is the smaller
            least = SETTLED * rows(np.maximum(np.abs(y), np.abs(free)))
            done |= ~_any(~(np.abs(step) <= least)) | ~_any(region.extent() > least)
            newton = fast & region.hold(rows(y) + step)
            following = np.where(newton[:, None], rows(y) + step, region.centre)
            y = np.where(done[:, None], rows(y), following).reshape(y.shape)
            force = force_at(y)
            with np.errstate(over="ignore", invalid="ignore"):
                residual = y + root * force - free
                before, norm = norm, length(residual)
            region.cut(rows(y), rows(residual), ~done)
            fast = ~newton | (norm <= 0.5 * before)
        bad = ~(done | (norm <= GOOD_ENOUGH * size))
        return y, force, np.broadcast_to(bad[:, None], rows(y).shape).reshape(y.shape)

    def _tangent(
        self,
        y: Array,
        force: Array,
        free: Array,
        root: Array,
        force_at: Callable[..., Array],
        values: dict[str, Array],
    ) -> Array:
        """dR_a / dj_b, (points * columns, a, b)."""
        rows, count = y.shape
        if self.law.tangent is not None:
            columns = rows // len(self.points)
            shape = (len(self.points), count, count, columns)
            given = (root * y).reshape(-1, columns, count).transpose(0, 2, 1)
            answer = self.call("tangent", self.law.tangent, shape, (given.copy(),), values)
            self.demand(np.isfinite(answer), answer, given, "tangent")
            return answer.transpose(0, 3, 1, 2).reshape(rows, count, count)
        tangent = np.empty((rows, count, count))
        size = np.maximum(np.abs(y), np.abs(free))
        size = np.maximum(size, 1e-3 * float(size.max()))
        if not size.any():
            size = np.abs(root * force)  # no jump at all: what the force would make of it
        for b in range(count):
            moved = y.copy()
            moved[:, b] += np.sqrt(EPSILON) * size[:, b]
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                step = root[:, b] * (moved[:, b] - y[:, b])
                tangent[:, :, b] = (force_at(moved, nan=True) - force) / step[:, None]
        return tangent

    def _fail(self, bad: Bools, jump: Array, residual: Array) -> None:
        point = int(np.argmax(bad.any(axis=1)))
        column = int(np.argmax(bad[point]))
        raise SceneError(
            f"{self.who}: no jump was found that its force holds at point {point} "
            f"{_text(self.points[point])}: free jump {_text(jump[point, :, column])}, off by "
            f"{np.abs(residual[point, :, column]).max():.3g}; is it continuous and monotone? Otherwise give "
            "resolve= in place of force="
        )


def _newton(tangent: Array, residual: Array, root: Array) -> Array:
    """Newton's step for G; not a number where there is none."""
    with np.errstate(over="ignore", invalid="ignore"):
        matrix = np.eye(root.shape[1]) + root[:, :, None] * tangent * root[:, None, :]
        usable = ~_any(_endless(matrix)) & ~_any(_endless(residual))
        matrix = np.where(usable[:, None, None], matrix, np.eye(root.shape[1]))
        usable &= np.asarray(np.linalg.det(matrix)) != 0.0
        matrix = np.where(usable[:, None, None], matrix, np.eye(root.shape[1]))
        step = np.asarray(np.linalg.solve(matrix, -residual[..., None]), dtype=np.float64)[..., 0]
    return np.where(usable[:, None], step, np.nan)


class _Intervals:
    """Regions [low, high] that enclose the roots of one component, one per row."""

    def __init__(self, y: Array, residual: Array) -> None:
        self.low = np.full_like(y, -np.inf)
        self.high = np.full_like(y, np.inf)
        self.cut(y, residual, np.ones(len(y), dtype=bool))

    @property
    def centre(self) -> Array:
        """Midpoints."""
        return np.asarray(0.5 * self.low + 0.5 * self.high, dtype=np.float64)

    def extent(self) -> Array:
        """Half the width."""
        return np.asarray(0.5 * self.high - 0.5 * self.low, dtype=np.float64)

    def hold(self, y: Array) -> Bools:
        """Whether points lie inside."""
        inside = np.logical_and(y >= self.low, y <= self.high)
        return np.asarray(inside[:, 0], dtype=np.bool_)

    def cut(self, y: Array, residual: Array, where: Bools) -> None:
        """Keep what lies on the side of y that the residual G points away from, at most |G| far."""
        far = y - (1.0 + 8 * EPSILON) * residual
        here = where[:, None]
        low = np.where(residual < 0.0, y, far)
        high = np.where(residual > 0.0, y, far)
        self.low = np.where(here, np.fmax(self.low, low), self.low)
        self.high = np.where(here, np.fmin(self.high, high), self.high)


class _Ellipsoids:
    """Regions {centre + B u, |u| <= 1} that enclose the roots, one per row."""

    def __init__(self, y: Array, residual: Array) -> None:
        count = y.shape[1]
        self.centre = y - 0.5 * residual
        radius = np.maximum(0.5 * np.linalg.norm(residual, axis=1), 1e-300)
        self.rounding = 8 * EPSILON * radius
        self.shape: Array = radius[:, None, None] * np.eye(count)
        self.inverse: Array = np.eye(count) / radius[:, None, None]

    def extent(self) -> Array:
        """Half the width along each axis."""
        width = np.linalg.norm(self.shape, axis=2) + self.rounding[:, None]
        return np.asarray(width, dtype=np.float64)

    def hold(self, y: Array) -> Bools:
        """Whether points lie inside."""
        with np.errstate(invalid="ignore", over="ignore"):
            u = np.einsum("qab,qb->qa", self.inverse, y - self.centre)
            slack = self.rounding * np.linalg.norm(self.inverse, axis=(1, 2))
            return np.asarray(np.linalg.norm(u, axis=1) <= 1.0 + 1e-9 + slack, dtype=np.bool_)

    def cut(self, y: Array, normal: Array, where: Bools) -> None:
        """Keep the smallest ellipsoids around what is left of them where normal . (z - y) <= 0."""
        count = y.shape[1]
        # an infinite force has a direction, and nothing else
        infinite = _endless(normal)
        endless = infinite.any(axis=1, keepdims=True)
        normal = np.where(endless, np.sign(normal) * infinite, normal)
        normal = np.nan_to_num(normal) / np.maximum(np.abs(normal).max(axis=1, keepdims=True), 1e-300)
        u = np.einsum("qba,qb->qa", self.shape, normal)
        length = np.linalg.norm(u, axis=1)
        where = where & (length > 0.0)
        length = np.where(where, length, 1.0)
        u /= length[:, None]
        depth = np.einsum("qa,qa->q", normal, self.centre - y) / length
        where &= depth > -1.0 / count
        depth = np.where(where, np.minimum(depth, DEEPEST), 0.0)
        along = np.einsum("qab,qb->qa", self.shape, u)
        # semi-axes: along u, and across it
        axis = (1.0 - depth) * count / (count + 1.0)
        across = count * np.sqrt((1.0 - depth**2) / (count**2 - 1.0))
        moved = self.centre - ((1.0 + count * depth) / (count + 1.0))[:, None] * along
        pair = u[:, :, None] * u[:, None, :]
        shape = across[:, None, None] * self.shape + np.einsum(
            "qab,qbc->qac", (axis - across)[:, None, None] * self.shape, pair
        )
        inverse = self.inverse / across[:, None, None] + np.einsum(
            "qab,qbc->qac", (1.0 / axis - 1.0 / across)[:, None, None] * pair, self.inverse
        )
        self.centre = np.where(where[:, None], moved, self.centre)
        self.shape = np.where(where[:, None, None], shape, self.shape)
        self.inverse = np.where(where[:, None, None], inverse, self.inverse)


def _endless(values: Array) -> Bools:
    return np.asarray(np.logical_not(np.isfinite(values)), dtype=np.bool_)


def _any(flags: Bools) -> Bools:
    """Whether any is set in a row."""
    return np.asarray(flags.reshape(len(flags), -1).any(axis=1), dtype=np.bool_)


def _text(values: Array) -> str:
    flat = np.atleast_1d(values).ravel()
    return "(" + ", ".join(f"{value + 0.0:.6g}" for value in flat) + ")"
