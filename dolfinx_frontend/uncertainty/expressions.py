"""Expressions of random numbers: ``2 * k``, ``k1 + k2``, ``np.sqrt(k)``, any function of several.

An expression has no germ of its own. It is known exactly in samples; its chaos is its projection by a Gauss
rule in the germs that it depends on. Expressions of the same random number are fully correlated, so that one
of them may drive several parameters.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Mapping
from typing import Any, cast

import numpy as np

from dolfinx_frontend.common.arithmetic import SIGNS, Arithmetic
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import checked_callable, checked_name, is_real, told_call
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.frozen import ReadOnlyDict

__all__ = ["ByName", "Expression", "Operand", "expression"]

_SIGNS = {
    **SIGNS,
    np.add: "+",
    np.subtract: "-",
    np.multiply: "*",
    np.divide: "/",
    np.power: "**",
}


class Operand(Arithmetic):
    """A random number that one can calculate with."""

    name: str

    @property
    def leaves(self) -> Mapping[str, Any]:
        """Name -> random parameter, of all that it depends on."""
        return ReadOnlyDict({self.name: self})

    def at(self, values: Mapping[str, Array]) -> Array:
        """Its value (N,) at values (N,) of the random parameters that it depends on, by name."""
        return np.asarray(values[self.name], dtype=np.float64)

    def _with(self, function: Callable[..., Any], *operands: Any) -> Any:
        if all(is_real(each) or isinstance(each, Operand) for each in operands):
            return Expression(function, *operands)
        for each in operands:
            if isinstance(each, np.ndarray) or type(each) in (list, tuple):
                raise SceneError(
                    f"{short(each)} and {self.name!r} in one expression: it is one random number, also where "
                    "it is a component of a vector; write (a * k, b * k)"
                )
        return NotImplemented

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **settings: Any) -> Any:
        if method != "__call__" or settings or ufunc.nout != 1:
            raise SceneError(
                f"{ufunc.__name__}.{method} of {self.name!r}: an expression takes functions of numbers, as "
                "np.exp; use lf.expression(function, ...) for others"
            )
        single = (x.item() if isinstance(x, np.ndarray) and x.ndim == 0 else x for x in inputs)
        return self._with(ufunc, *single)


class ByName:
    """A function of a mapping, name -> (N,), as a function of arrays in the order of the names."""

    def __init__(self, function: Callable[[Mapping[str, Array]], Array], names: Iterable[str]) -> None:
        self.function, self.names = function, tuple(names)

    def __call__(self, *values: Array) -> Array:
        return self.function(dict(zip(self.names, values, strict=True)))


class Expression(Operand):
    """A function of random numbers; made by their operators, by NumPy's functions and by :func:`expression`.

    Attributes
    ----------
    name
        How it is written.
    function, operands
        Arrays (N,) or numbers for the operands -> (N,); random numbers, expressions of them, and numbers.
    leaves
        Name -> random parameter, of all that it depends on.
    """

    def __init__(self, function: Callable[..., Any], *operands: Any, name: str | None = None) -> None:
        self.function, self.operands = function, operands
        self.name = self._shown() if name is None else name
        leaves: dict[str, Any] = {}
        for each in operands:
            for key, leaf in each.leaves.items() if isinstance(each, Operand) else ():
                known = leaves.setdefault(key, leaf)
                if known != leaf:
                    raise SceneError(
                        f"expression {self.name!r}: random parameter {key!r} has two definitions: {known!r} "
                        f"and {leaf!r}; give them different names, or use one object in both places"
                    )
        self._leaves = ReadOnlyDict(leaves)
        self._definition = ("expression", function, *operands)
        found = self.at({key: np.full(2, leaf.mean) for key, leaf in leaves.items()})
        if not np.isfinite(found[0]):
            raise SceneError(
                f"expression {self.name!r} is {found[0]:g} at {self._where(leaves)}, the means: give one "
                "that is finite wherever its parameters can be"
            )
        self.mean = float(found[0])
        """Its value where all parameters are at their means, with which deterministic solvers work."""

    @property
    def leaves(self) -> Mapping[str, Any]:
        return self._leaves

    def at(self, values: Mapping[str, Array]) -> Array:
        given = [each.at(values) if isinstance(each, Operand) else each for each in self.operands]
        where = f"expression {self.name!r}"
        with np.errstate(all="ignore"):
            found = told_call(where, self.function, *given)
        shape = np.shape(next(iter(values.values()))) if values else ()
        try:
            result = np.broadcast_to(np.asarray(found, dtype=np.float64), shape)
        except (TypeError, ValueError):
            raise SceneError(
                f"{where}: its function returned {short(found)} for arrays of shape {shape}; it takes "
                "arrays, one number a sample, and returns such an array: use functions of NumPy"
            ) from None
        return result

    def check(self, values: Mapping[str, Array]) -> Array:
        """Its values (N,), or an error that says where they are not finite.

        Raises
        ------
        SceneError
            NaN or infinite.
        """
        found = self.at(values)
        bad = np.flatnonzero(~np.isfinite(found))
        if bad.size:
            at = ", ".join(f"{key} = {np.ravel(values[key])[bad[0]]:.6g}" for key in self._leaves)
            raise SceneError(
                f"expression {self.name!r} is {found[bad[0]]:g} at {at}: give a function that is finite "
                "wherever its parameters can be, or distributions that keep away from there"
            )
        return found

    def _where(self, leaves: Mapping[str, Any]) -> str:
        return ", ".join(f"{key} = {leaf.mean:.6g}" for key, leaf in leaves.items())

    def _shown(self) -> str:
        parts = [each.name if isinstance(each, Operand) else f"{float(each):g}" for each in self.operands]
        sign = _SIGNS.get(self.function)
        if sign is not None and len(parts) == 2:
            nested = [
                f"({p})" if isinstance(o, Expression) and _SIGNS.get(o.function) is not None else p
                for p, o in zip(parts, self.operands, strict=True)
            ]
            return f"{nested[0]} {sign} {nested[1]}"
        if self.function in (operator.neg, np.negative):
            return f"-{parts[0]}" if not isinstance(self.operands[0], Expression) else f"-({parts[0]})"
        label = getattr(self.function, "__name__", type(self.function).__name__)
        return f"{label}({', '.join(parts)})"

    @property
    def affine(self) -> bool:
        """Whether it is a linear function of the germs of parameters that are."""
        return _affine(self)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Expression) and self._definition == other._definition

    def __hash__(self) -> int:
        return hash(self._definition)

    def __repr__(self) -> str:
        of = ", ".join(map(repr, self._leaves.values()))
        return f"{self.name} of {of}" if of else self.name


def _affine(value: Any) -> bool:
    """Whether a value is a linear combination of parameters that are linear in their germs."""
    if not isinstance(value, Expression):
        return not isinstance(value, Operand) or bool(cast(Any, value).affine)
    if not all(map(_affine, value.operands)):
        return False
    function, fixed = value.function, [not isinstance(each, Operand) for each in value.operands]
    if function in (operator.add, operator.sub, operator.neg, np.add, np.subtract, np.negative):
        return True
    if function in (operator.mul, np.multiply):
        return any(fixed)
    return function in (operator.truediv, np.divide) and fixed[1]


def expression(function: Callable[..., Any], *operands: Any, name: str | None = None) -> Expression:
    """A function of random numbers as one: ``lf.expression(lambda E, t: E * t**3, E, t)``.

    Parameters
    ----------
    function
        Of arrays (N,), one number a sample, in the order of the operands, returns (N,).
    operands
        Random numbers, expressions of them, and plain numbers.
    name
        Shown in tables and messages; None: that of the function.

    Raises
    ------
    SceneError
        Nothing random among the operands, or a value at their means that is not finite.
    """
    for each in operands:
        if not is_real(each) and not isinstance(each, Operand):
            raise SceneError(
                f"expression: operand = {short(each)}; give random numbers (Normal, LogNormal, ...), "
                "expressions of them, or numbers"
            )
    if not any(isinstance(each, Operand) for each in operands):
        raise SceneError("expression: no operand is random; give one at least, or the number itself")
    checked_callable("expression", "function", function, "give a function of arrays (N,)", len(operands))
    if name is not None:
        checked_name("expression", name)
    return Expression(function, *operands, name=name)
