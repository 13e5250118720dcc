"""Random numbers one calculates with, as text: ``"2 * k"``, ``"sqrt(a) + b"``.

A formula has numbers, names, + - * / **, brackets and functions of NumPy of one or two numbers. It is not
executed as Python: what is no formula is refused. Names that are no words of Python stand in backquotes.
"""

from __future__ import annotations

import ast
import keyword
import operator
import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from dolfinx_frontend.common.arithmetic import SIGNS
from dolfinx_frontend.common.checks import is_real
from dolfinx_frontend.common.errors import SceneError, unknown_name
from dolfinx_frontend.uncertainty.expressions import Expression

__all__ = ["evaluated", "formula", "formula_name"]

MOST_CHARACTERS = 2000
_OPERATORS: Mapping[type, Any] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
_QUOTED = re.compile(r"`([^`]+)`")
_UFUNCS = {operator.add: np.add, operator.sub: np.subtract, operator.mul: np.multiply,
           operator.truediv: np.divide, operator.pow: np.power}
_SIGNS = {**SIGNS, **{_UFUNCS[each]: sign for each, sign in SIGNS.items()}}


def evaluated(text: str, known: Mapping[str, Any], where: str) -> Any:
    """What a formula is, with the random numbers of these names.

    Raises
    ------
    SceneError
        It is no formula, or a name is not known.
    """
    if text in known:
        return known[text]
    if len(text) > MOST_CHARACTERS:
        raise SceneError(f"{where}: a formula of {len(text)} characters; {MOST_CHARACTERS} at most")
    quoted: list[str] = []

    def placed(match: re.Match[str]) -> str:
        quoted.append(match[1])
        return f"_quoted_{len(quoted) - 1}"

    try:
        tree = ast.parse(_QUOTED.sub(placed, text.strip()), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise _no_formula(text, known, where) from None
    names = dict(known) | {f"_quoted_{k}": known.get(name) for k, name in enumerate(quoted)}
    missing = [name for name in quoted if name not in known]
    if missing:
        raise unknown_name("random number", missing[0], known, where)
    try:
        return _value(tree, names, text, known, where)
    except RecursionError:
        raise _no_formula(text, known, where) from None
    except (ArithmeticError, TypeError) as error:
        raise SceneError(f"{where}: {text!r} has no value ({error})") from None


def _no_formula(text: str, known: Mapping[str, Any], where: str) -> SceneError:
    names = f"the random numbers {', '.join(map(repr, known))}" if known else "random numbers"
    return SceneError(f"{where}: {text!r} is neither a number nor a formula of {names}")


def _value(node: ast.expr, names: Mapping[str, Any], text: str, known: Mapping[str, Any], where: str) -> Any:
    def inner(each: ast.expr) -> Any:
        return _value(each, names, text, known, where)

    if isinstance(node, ast.Constant) and is_real(node.value):
        return float(node.value)
    if isinstance(node, ast.Name):
        if node.id not in names:
            raise unknown_name("random number", node.id, known, f"{where}: formula {text!r}")
        return names[node.id]
    if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
        return _OPERATORS[type(node.op)](inner(node.left), inner(node.right))
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.UAdd)):
        operand = inner(node.operand)
        return -operand if isinstance(node.op, ast.USub) else operand
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        function = getattr(np, node.func.id, None)
        if node.func.id == "abs" or (isinstance(function, np.ufunc) and function.nin == len(node.args)):
            found = (abs if node.func.id == "abs" else function)(*map(inner, node.args))  # type: ignore[misc]
            return float(found) if isinstance(found, np.generic) else found
        raise SceneError(f"{where}: formula {text!r}: {node.func.id!r} is no function of NumPy of "
                         f"{len(node.args)} number(s), as sqrt, exp, log or maximum")
    raise _no_formula(text, known, where)


def formula_name(name: str) -> str:
    """A name in a formula."""
    plain = name.isidentifier() and not keyword.iskeyword(name) and not name.startswith("_quoted_")
    return name if plain else f"`{name}`"


def formula(value: Any, where: str) -> str:
    """The text of a random number, or of an expression of some.

    Raises
    ------
    SceneError
        A function that has no name in a formula.
    """
    if is_real(value):
        return repr(float(value)) if value >= 0 else f"({float(value)!r})"
    if not isinstance(value, Expression):
        return formula_name(str(value.name))
    parts = [formula(each, where) for each in value.operands]
    sign = _SIGNS.get(value.function)
    if sign is not None and len(parts) == 2:
        return f"({parts[0]} {sign} {parts[1]})"
    if value.function in (operator.neg, np.negative):
        return f"(-{parts[0]})"
    name = getattr(value.function, "__name__", "")
    if value.function is operator.abs:
        return f"abs({parts[0]})"
    if isinstance(value.function, np.ufunc) and getattr(np, name, None) is value.function:
        return f"{name}({', '.join(parts)})"
    raise SceneError(
        f"{where}: {value.name!r} is Python, which a deck cannot hold: write it with + - * / ** "
        "and functions of NumPy"
    )
