"""What values a key may have, as JSON Schema: for editors, and for the first check of a deck.

``latin schema > deck.schema.json``; an editor with a language server for TOML completes and checks decks.
"""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import Any

from dolfinx_frontend.decks.kinds import of_type
from dolfinx_frontend.decks.settings import ASKED, RUN, TOP
from dolfinx_frontend.decks.words import (
    CLASSES,
    DISTRIBUTIONS,
    METHODS,
    NAMED,
    OF_STEP,
    PARTS,
    READ_STEP,
    RECORDS,
    Word,
    words,
)
from dolfinx_frontend.scene.amplitudes import Amplitude
from dolfinx_frontend.uncertainty.correlated import Correlated

__all__ = ["json_schema"]


def _reference(name: str) -> dict[str, str]:
    return {"$ref": f"#/$defs/{name}"}


def _of_word(word: Word) -> dict[str, Any]:
    found: dict[str, Any] = {
        "plain": of_type(word.hint),
        "value": _reference("value"),
        "values": {"anyOf": [_reference("value"), {"type": "object"}]},
        "record": _reference(getattr(word.hint, "__name__", "")),
        "code": {"type": "string", "pattern": "^[\\w.]+:[\\w.]+$"},
        "distribution": {"type": "object", "required": ["name"]},
    }.get(word.kind, {})
    if word.name == "cuts":
        found = {"anyOf": [found, {"type": "array", "items": found}]}
    said = {"description": word.text} if word.text else {}
    return {"allOf": [found], **said} if "$ref" in found else {**found, **said}


def _of_call(known: Mapping[str, Word], given: tuple[str, ...] = ()) -> dict[str, Any]:
    """A table with the arguments of a call; laws and materials stand in it with their fields."""
    own = {name: word for name, word in known.items() if name not in given}
    properties: dict[str, Any] = {}
    variants: list[dict[str, Any]] = []
    for name, word in own.items():
        if word.kind in CLASSES:
            classes = CLASSES[word.kind]
            properties[name] = {"enum": list(classes)} if word.kind == "law" else {"type": "string"}
            for title, kind in classes.items():
                fields = {key: _of_word(each) for key, each in words(kind).items() if key != "name"}
                needed = [key for key, each in words(kind).items() if each.required]
                variants.append({"if": {"properties": {name: {"const": title}}, "required": [name]},
                                 "then": {"properties": fields, "required": needed}})
        elif word.kind == "part":
            properties |= {way: _of_call(words(make)) for way, make in PARTS.items()}
            properties["msh"]["properties"]["part"] = {"type": "string"}
        else:
            properties[name] = _of_word(word)
    needed = [name for name, word in own.items() if word.required and word.kind != "part"]
    found: dict[str, Any] = {"type": "object", "properties": properties, "required": needed}
    if variants:
        found["allOf"] = variants
    else:
        found["additionalProperties"] = False
    return found


def _one_of(makers: Mapping[str, Any], given: tuple[str, ...]) -> list[dict[str, Any]]:
    return [
        {"type": "object", "properties": {name: _of_call(words(make), given)}, "required": [name],
         "additionalProperties": False}
        for name, make in makers.items()
    ]


def json_schema() -> dict[str, Any]:
    """JSON Schema (draft 2020-12) of a deck."""
    value = [
        {"type": "number"}, {"type": "string", "description": "a random number, or a formula of some"},
        {"type": "array"},
        {"type": "object", "properties": {"amplitude": {}, "value": {}}, "required": ["amplitude"]},
        {"type": "object", "properties": {"sum": {"type": "array"}}, "required": ["sum"]},
    ]
    random = _one_of(DISTRIBUTIONS, ("name",))
    formula = {"type": "string"}
    defs: dict[str, Any] = {"value": {"anyOf": value + random}, "random": {"anyOf": [*random, formula]}}
    for record in RECORDS:
        makers = {n: getattr(record, n) for n in vars(record) if inspect.ismethod(getattr(record, n, None))
                  and not n.startswith("_")}
        defs[record.__name__] = {"anyOf": [_of_call(words(record)), *_one_of(makers, ())]}
    many = {name: {"type": "array", "items": _of_call(words(each))} for name, each in METHODS.items()
            if name not in NAMED}
    named = {name: {"type": "object", "additionalProperties": _of_call(words(METHODS[name]), ("name",))}
             for name in NAMED}
    step = _of_call(READ_STEP)
    for name, each in OF_STEP.items():
        step["properties"][name] = {"type": "array", "items": _of_call(words(each))}
    step["properties"]["mesh"] = {"type": "object"}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "deck of an assembly",
        "type": "object",
        "additionalProperties": False,
        "properties": {
            **{name: _of_word(word) for name, word in TOP.items()},
            "run": _of_call(RUN),
            "quantity": {"type": "array", "items": _of_call(ASKED)},
            "random": {"type": "object", "additionalProperties": _reference("random")},
            "amplitude": {"type": "object", "additionalProperties": _of_call(words(Amplitude))},
            "correlated": {"type": "array", "items": _of_call(words(Correlated))},
            "material": {"type": "object"},
            "step": step,
            **named,
            **many,
        },
        "$defs": defs,
    }
