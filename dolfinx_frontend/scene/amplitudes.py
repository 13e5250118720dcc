"""Values that change in time: loads, jumps and preloads of a load history.

A history is quasi-static: time is only the order in which loads come (its unit is whatever the
amplitudes are given in). Its time steps are columns of the LATIN iteration, which works on the whole
history at once (P. Ladeveze, Nonlinear Computational Structural Mechanics, 1999: large time increment).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import checked_numbers, checked_whole, is_real
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.frozen import frozen

__all__ = ["Amplitude", "Combination", "Varying", "amplitudes_of", "check_step", "check_times"]


class Amplitude:
    """A factor that changes in time; ``amplitude * value`` is a value of a law that does.

    Parameters
    ----------
    times
        Increasing times; or a function time -> factor, and no `values`.
    values
        Factors at the times: linear in between, constant before the first and after the last.

    Raises
    ------
    SceneError
        Times that do not increase, another number of values, numbers that are not finite.

    Examples
    --------
    >>> tighten = Amplitude([0, 1], [0, 1])
    >>> shear = Amplitude([1, 2, 4, 6], [0, 1, -1, 1])
    >>> scene.traction("plate:end", shear * (20.0, 0.0, 0.0))
    """

    __array_ufunc__ = None  # NumPy leaves array * amplitude to __rmul__

    def __init__(
        self,
        times: Sequence[float] | Array | Callable[[float], float],
        values: Sequence[float] | Array | None = None,
    ) -> None:
        self._function: Callable[[float], float] | None = None
        if callable(times):
            if values is not None:
                raise SceneError("Amplitude: a function of time and values are given: give one")
            self._function = times
            return
        wanted = "give increasing numbers, one value per time"
        self._times = checked_numbers("Amplitude", "times", times, wanted).ravel()
        given = [] if values is None else values
        self._values = checked_numbers("Amplitude", "values", given, wanted).ravel()
        if len(self._times) != len(self._values) or not len(self._times):
            raise SceneError(
                f"Amplitude: {len(self._times)} times and {len(self._values)} values; give one value per time"
            )
        if np.any(np.diff(self._times) <= 0.0):
            where = int(np.argmax(np.diff(self._times) <= 0.0))
            raise SceneError(
                f"Amplitude: times increase, but {self._times[where]:g} is followed by "
                f"{self._times[where + 1]:g}"
            )

    @property
    def times(self) -> tuple[float, ...]:
        """Times between which it is linear; of a function of time, of which nothing is known, none."""
        return tuple(() if self._function else self._times.tolist())

    @property
    def values(self) -> tuple[float, ...]:
        """Factors at the times."""
        return tuple(() if self._function else self._values.tolist())

    @property
    def function(self) -> Callable[[float], float] | None:
        """The function of time, if it is one."""
        return self._function

    def __call__(self, time: float) -> float:
        """The factor at a time."""
        if not is_real(time):
            raise SceneError(f"Amplitude: time = {short(time)} is not a number")
        if self._function is None:
            return float(np.interp(time, self._times, self._values))
        factor = self._function(time)
        if not is_real(factor) or not np.isfinite(factor):
            raise SceneError(
                f"Amplitude: the function returned {short(factor)} at time {time:g}; return a finite number"
            )
        return float(factor)

    def __mul__(self, value: Any) -> Varying:
        if isinstance(value, (Amplitude, Varying)):
            raise SceneError(
                "Amplitude: multiply an amplitude by a value; use Amplitude(function) for products"
            )
        return Varying(((self, value),))

    __rmul__ = __mul__

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        if not isinstance(other, Amplitude) or self._function or other._function:
            return False
        return np.array_equal(self._times, other._times) and np.array_equal(self._values, other._values)

    def __hash__(self) -> int:
        if self._function is not None:
            return hash(self._function)
        return hash((self._times.tobytes(), self._values.tobytes()))

    def __repr__(self) -> str:
        if self._function is not None:
            return f"Amplitude({short(self._function)})"
        return f"Amplitude({short(self._times.tolist())}, {short(self._values.tolist())})"


def _times(value: Any, factor: Any) -> Any:
    """A value times a number: a vector by components, a function by what it returns."""
    if isinstance(value, (list, tuple)):
        return tuple(_times(each, factor) for each in value)
    if callable(value) and not hasattr(value, "__mul__"):
        return lambda *at: factor * value(*at)
    return value * factor


@dataclass(frozen=True)
class Combination:
    """Sum of coefficient * value; what a varying value is at one time."""

    terms: tuple[tuple[float, Any], ...]


@dataclass(frozen=True, repr=False)
class Varying:
    """Sum of amplitude * value; None is the constant amplitude 1.

    Built by ``amplitude * value`` and ``+``; the values are those that laws take (numbers, vectors, arrays
    by point, callables of the points).
    """

    terms: tuple[tuple[Amplitude | None, Any], ...]

    __array_ufunc__ = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "terms", tuple((a, frozen(value)) for a, value in self.terms))

    def __add__(self, other: Any) -> Varying:
        if isinstance(other, Varying):
            return Varying(self.terms + other.terms)
        return Varying((*self.terms, (None, other)))

    __radd__ = __add__

    def __mul__(self, factor: Any) -> Varying:
        if isinstance(factor, (Amplitude, Varying)):
            raise SceneError(
                f"Amplitude: {short(factor)} is a factor of a value that changes in time; use "
                "Amplitude(function) for products"
            )
        try:
            return Varying(tuple((a, _times(value, factor)) for a, value in self.terms))
        except TypeError:
            raise SceneError(f"Amplitude: {self!r} times {short(factor)}; multiply it by a number") from None

    __rmul__ = __mul__

    def __truediv__(self, divisor: float) -> Varying:
        return self * (1.0 / divisor)

    def __neg__(self) -> Varying:
        return self * -1.0

    def __sub__(self, other: Any) -> Varying:
        return self.__add__(-other if isinstance(other, Varying) else _times(other, -1.0))

    def __rsub__(self, other: Any) -> Varying:
        return (-self).__add__(other)

    def __repr__(self) -> str:
        return " + ".join(short(v) if a is None else f"{a!r} * {short(v)}" for a, v in self.terms)

    def at(self, time: float) -> Combination:
        """The value at a time."""
        return Combination(tuple((1.0 if a is None else a(time), v) for a, v in self.terms))

    @property
    def nominal(self) -> Combination:
        """The value with every amplitude at 1."""
        return Combination(tuple((1.0, v) for _, v in self.terms))

    def pattern(self, amplitude: object) -> Combination:
        """What is multiplied by one amplitude."""
        return Combination(tuple((1.0, v) for a, v in self.terms if a == amplitude))


def amplitudes_of(values: Sequence[Any]) -> list[Amplitude]:
    """The different amplitudes of some values, in order of appearance."""
    found: list[Amplitude] = []
    for value in values:
        for amplitude, _ in value.terms if isinstance(value, Varying) else ():
            if amplitude is not None and amplitude not in found:
                found.append(amplitude)
    return found


def check_times(times: npt.ArrayLike) -> Array:
    """Times of a history as an array (T,).

    Raises
    ------
    SceneError
        No times, or times that do not increase.
    """
    data = checked_numbers("history", "times", times, "give a list of increasing numbers", dimensions=1)
    if not data.size:
        raise SceneError("history: times = []: give a list of increasing numbers")
    if np.any(np.diff(data) <= 0.0):
        where = int(np.argmax(np.diff(data) <= 0.0))
        raise SceneError(f"times increase, but {data[where]:g} is followed by {data[where + 1]:g}")
    data.setflags(write=False)
    return data


def check_step(times: Array | None, step: int, where: str) -> int:
    """A step of a history counted from its beginning; without a history (None) there is one, 0 or -1.

    Raises
    ------
    SceneError
        No such step.
    """
    count = 1 if times is None else len(times)
    step = checked_whole(where, "step", step)
    if not -count <= step < count:
        raise SceneError(f"{where}: there is no step {step}, the history has {count}")
    return step % count
