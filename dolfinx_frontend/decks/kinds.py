"""Types of the values that are passed as they are, as JSON Schema, and whether a value has one."""

from __future__ import annotations

import types
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, Union, get_args, get_origin

import numpy.typing as npt

__all__ = ["ANY", "misfit", "of_type"]

ANY = "any"
"""In an array of plain numbers: no number, None in Python; TOML has no word for that."""


def of_type(hint: Any) -> dict[str, Any]:
    """JSON Schema of a type; empty: anything."""
    simple = {bool: "boolean", int: "integer", float: "number", str: "string", Path: "string"}
    if hint in simple:
        return {"type": simple[hint]}
    origin, inner = get_origin(hint), get_args(hint)
    if hint == npt.ArrayLike:
        return {"type": "array"}
    if origin is Literal:
        return {"enum": list(inner)}
    if origin in (Union, types.UnionType):
        options = [of_type(each) for each in inner if each is not type(None)]
        return {} if {} in options else options[0] if len(options) == 1 else {"anyOf": options}
    if origin in (tuple, list, Sequence):
        items = [of_type(each) for each in inner if each is not Ellipsis]
        return {"type": "array", "items": {} if any(each != items[0] for each in items) else items[0]}
    return {}


def misfit(value: Any, schema: Mapping[str, Any]) -> str:
    """What a value should be by a schema of a plain key; empty: it is."""
    if "anyOf" in schema:
        wanted = [misfit(value, each) for each in schema["anyOf"]]
        return "" if "" in wanted else " or ".join(dict.fromkeys(wanted))
    if "enum" in schema:
        return "" if value in schema["enum"] else f"one of {', '.join(map(repr, schema['enum']))}"
    kind = schema.get("type")
    names = {
        "boolean": "true or false",
        "integer": "a whole number",
        "number": "a number",
        "string": "a text",
        "array": "an array",
    }
    fits = {
        "boolean": isinstance(value, bool),
        "integer": isinstance(value, int) and not isinstance(value, bool),
        "number": isinstance(value, (int, float)) and not isinstance(value, bool),
        "string": isinstance(value, str),
        "array": isinstance(value, list),
    }
    if kind in fits and not fits[kind]:
        return names[str(kind)]
    if kind == "array":
        inner = schema.get("items", {})
        wrong = next((found for each in value if each != ANY and (found := misfit(each, inner))), "")
        return f"an array, each {wrong}" if wrong else ""
    return ""
