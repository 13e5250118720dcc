"""Checks of what users give: numbers, counts, words, names and kinds of things.

Each returns what was given in the type that is wanted, or raises a :class:`SceneError` that says where it was
given, the name of the argument, the value, and what would do. Texts, truth values and complex numbers are no
numbers, whatever Python converts them to.
"""

from __future__ import annotations

import inspect
import math
import os
import unicodedata
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, TypeGuard, TypeVar

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import SceneError, unknown_name

__all__ = [
    "check_kind",
    "check_known",
    "check_optional_kind",
    "checked_axes",
    "checked_callable",
    "checked_flag",
    "checked_name",
    "checked_names",
    "checked_number",
    "checked_numbers",
    "checked_path",
    "checked_reals",
    "checked_seed",
    "checked_whole",
    "checked_word",
    "is_list",
    "is_masked",
    "is_real",
    "is_whole",
    "refuse_masked",
    "told_call",
]

T = TypeVar("T")
W = TypeVar("W", bound=str)

_NOT_IN_NAMES = ("Cc", "Cs", "Zl", "Zp")
"""Control characters, halves of surrogate pairs, separators of lines and paragraphs."""
_TURNS = ("LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI")
"""Unicode's marks that turn the direction of what follows: a table would show other words than it has."""


_LONGEST = 255
"""Bytes of the name of a file or folder."""


def is_masked(value: object) -> bool:
    """Whether a value is a masked array or has one in it: all its numbers would be read as valid."""
    if isinstance(value, (list, tuple)):
        return any(map(is_masked, value))
    return isinstance(value, np.ma.MaskedArray)


def refuse_masked(where: str, value: object) -> None:
    """Refuse masked arrays: NumPy forgets the mask where they are converted."""
    if is_masked(value):
        raise SceneError(
            f"{where} = {short(value)} is a masked array, whose mask would be ignored: give plain numbers, "
            "e.g. values.compressed() or values.filled(...)"
        )


def is_real(value: object) -> bool:
    """Whether a value is a single real number: no truth value, no text, not complex."""
    if is_masked(value):
        return False
    if isinstance(value, np.ndarray):
        return value.ndim == 0 and value.dtype.kind in "iuf"
    return isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)


def is_whole(value: object) -> bool:
    """Whether a value is a whole number, by its type: 2.0 is none."""
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool)


def _refuse(where: str, what: str, value: Any, wanted: str) -> SceneError:
    return SceneError(f"{where}: {what} = {short(value)}{wanted}")


def checked_number(
    where: str,
    what: str,
    value: Any,
    *,
    above: float = -math.inf,
    least: float = -math.inf,
    below: float = math.inf,
    most: float = math.inf,
) -> float:
    """A finite number within bounds: > `above`, >= `least`, < `below`, <= `most`."""
    refuse_masked(f"{where}: {what}", value)
    if not is_real(value):
        raise _refuse(where, what, value, " is not a number")
    try:
        number = float(value)
    except OverflowError as error:
        raise _refuse(where, what, value, " is not a number that fits") from error
    if math.isfinite(number) and above < number < below and least <= number <= most:
        return number
    low, high = max(above, least), min(below, most)
    if math.isfinite(low) and math.isfinite(high):
        wanted = f"in {'(' if above >= least else '['}{low:g}, {high:g}{')' if below <= most else ']'}"
    elif (low, high) == (0.0, math.inf) and above >= least:
        wanted = "a positive number"
    else:
        limits = ((">", above), (">=", least), ("<", below), ("<=", most))
        wanted = " ".join(["a finite number", *(f"{s} {v:g}" for s, v in limits if math.isfinite(v))])
    raise _refuse(where, what, value, f"; it must be {wanted}")


def checked_whole(
    where: str, what: str, value: Any, least: int | None = None, most: int | None = None
) -> int:
    """A whole number, from `least` to `most`."""
    if is_whole(value) and (least is None or value >= least) and (most is None or value <= most):
        return int(value)
    limits = "" if least is None else f" >= {least}" if most is None else f" in {least}..{most}"
    raise _refuse(where, what, value, f"; give a whole number{limits}")


def checked_seed(where: str, value: Any) -> Any:
    """What starts a random generator: a whole number >= 0, a generator, or None."""
    if value is None or isinstance(value, np.random.Generator):
        return value
    return checked_whole(where, "seed", value, 0)


def checked_numbers(where: str, what: str, values: Any, wanted: str, dimensions: int | None = None) -> Array:
    """A copy of finite numbers as an array; `wanted` says which, e.g. ``"give a list of numbers"``."""
    data = checked_reals(where, what, values, wanted)
    if np.all(np.isfinite(data)) and (dimensions is None or data.ndim == dimensions):
        return data
    raise _refuse(where, what, values, f": {wanted}")


def checked_axes(where: str, what: str, values: Any, dimensions: int = 2) -> Array:
    """A copy of orthonormal rows (d, d), in 2 or 3 dimensions, or of (m, d, d), as an array."""
    wanted = "give orthonormal rows (d, d)"
    axes = checked_numbers(where, what, values, wanted, dimensions)
    if axes.shape[-2:] in ((2, 2), (3, 3)):
        if np.abs(axes @ np.swapaxes(axes, -1, -2) - np.eye(axes.shape[-1])).max() < 1e-9:
            return axes
    raise _refuse(where, what, values, f": {wanted}")


def checked_reals(where: str, what: str, values: Any, wanted: str) -> Array:
    """As :func:`checked_numbers`, finite or not, of any shape."""
    refuse_masked(f"{where}: {what}", values)
    if _all_real(values):
        try:
            return np.array(values, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):  # rows of different lengths, very large integers
            pass
    raise _refuse(where, what, values, f": {wanted}")


def _all_real(values: Any) -> bool:
    if isinstance(values, np.ndarray):
        return values.dtype.kind in "iuf" or (values.dtype.kind == "O" and all(map(is_real, values.flat)))
    if isinstance(values, (list, tuple, range)):
        return all(map(_all_real, values))
    if is_real(values):
        return True
    # a column of a data frame, an array of another library
    return hasattr(values, "__array__") and np.asarray(values).dtype.kind in "iuf"


def checked_flag(where: str, what: str, value: Any) -> bool:
    """True or False."""
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    raise _refuse(where, what, value, "; give True or False")


def checked_word(where: str, what: str, value: W, words: Sequence[W]) -> W:
    """One of some words."""
    if isinstance(value, str) and value in words:
        return value
    raise _refuse(where, what, value, f"; use {' or '.join(map(repr, words))}")


def checked_name(where: str, value: Any, colon: bool = True) -> str:
    """A name: a text that is not empty, without control characters; `colon`: it may have one."""
    if isinstance(value, str) and value.strip() and not any(
        (each == ":" and not colon)
        or unicodedata.category(each) in _NOT_IN_NAMES
        or unicodedata.bidirectional(each) in _TURNS
        for each in value
    ):
        return value
    wanted = "; a name is a string, not empty, without control characters"
    raise _refuse(where, "name", value, wanted if colon else f"{wanted} and without a colon")


def check_known(kind: str, name: Any, known: Iterable[str], where: str = "") -> None:
    """Refuse what is not one of the known names, see :func:`unknown_name`."""
    if not isinstance(name, str) or name not in known:
        raise unknown_name(kind, name, known, where)


def is_list(value: Any) -> TypeGuard[Sequence[Any]]:
    """Whether a value is a list, a tuple, or an array that has one axis at least."""
    return isinstance(value, (list, tuple)) or (isinstance(value, np.ndarray) and value.ndim > 0)


def checked_names(where: str, what: str, given: Any, others: str = "") -> list[str]:
    """A list of names; `others` is what else would do."""
    # an array without axes says that it can be gone through, and cannot
    listed = is_list(given) if isinstance(given, np.ndarray) else isinstance(given, Iterable)
    if listed and not isinstance(given, (str, bytes)):
        names = list(given)
        if all(isinstance(name, str) for name in names):
            return names
    raise _refuse(where, what, given, f"; give a list of names{others}")


def check_kind(where: str, what: str, value: Any, kind: type | tuple[type, ...], wanted: str) -> None:
    """Refuse what is not of a kind; `wanted` says what would do, e.g. ``"give a Chaos or its order"``."""
    if not isinstance(value, kind):
        shown = short(value).partition("\n")[0]
        raise SceneError(f"{where}: {what} = {shown} is of type {type(value).__name__}; {wanted}")


def check_optional_kind(
    where: str, what: str, value: Any, kind: type | tuple[type, ...], wanted: str
) -> None:
    """As :func:`check_kind`, where None means that nothing was given."""
    if value is not None:
        check_kind(where, what, value, kind, wanted)


def checked_callable(where: str, what: str, value: Any, wanted: str, arguments: int = 1) -> Any:
    """A function that can be called with so many arguments; `wanted` says which."""
    if not callable(value):
        raise _refuse(where, what, value, f" cannot be called; {wanted}")
    try:
        signature = inspect.signature(value)
    except (TypeError, ValueError):  # of some functions in C nothing is known
        return value
    try:
        signature.bind(*[None] * arguments)
    except TypeError as error:
        count = "one argument" if arguments == 1 else f"{arguments} arguments"
        raise _refuse(where, what, value, f" cannot be called with {count} ({error}); {wanted}") from error
    return value


def told_call(where: str, function: Callable[..., T], *given: Any) -> T:
    """What a user's function returns; what it raises becomes a :class:`SceneError` that says where.

    Errors of this project pass as they are: they are clear already.
    """
    try:
        return function(*given)
    except Exception as error:
        if type(error).__module__.partition(".")[0] in ("dolfinx_frontend", "latin_core"):
            raise
        reason = f"{type(error).__name__}: {error}".rstrip(": ")
        raise SceneError(f"{where}: the function raised {reason}") from error


def checked_path(where: str, value: Any, what: str = "path", new: bool = False) -> Path:
    """The path of a file or folder; `new`: it may be made, so that its name has to fit a file system."""
    given = os.fspath(value) if isinstance(value, os.PathLike) else value
    if not isinstance(given, str) or not given or "\0" in given:
        raise _refuse(where, what, value, "; give the name of a file")
    try:
        longest = max((len(os.fsencode(part)) for part in Path(given).parts), default=0)
    except UnicodeEncodeError as error:
        shown = ascii(given)
        raise SceneError(f"{where}: {what} = {shown} has characters that no file name can have") from error
    if new and longest > _LONGEST:
        raise SceneError(
            f"{where}: {what} = {short(given[:40])}... has a name of {longest} bytes; file systems allow "
            f"{_LONGEST}: give a shorter one"
        )
    return Path(given)
