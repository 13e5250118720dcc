"""A deck in TOML: read into a scene, and written from one.

Methods of the scene are tables: ``[interface.foot]`` where things have a name always, ``[[fix]]`` otherwise;
they are called in the order of the text. Values are described in ``docs/command.md``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from dolfinx_frontend.decks.lines import Place, Text, read_text
from dolfinx_frontend.decks.settings import ASKED, FORCES, LENGTHS, RUN, TOP, Asked, Deck
from dolfinx_frontend.decks.values import Values, nearest
from dolfinx_frontend.decks.words import CLASSES, METHODS, NAMED, OF_STEP, READ_STEP, words
from dolfinx_frontend.geometry.step import StepAssembly, read_step
from dolfinx_frontend.scene.scene import Scene

__all__ = ["read"]

SECTIONS = ("run", "quantity", "random", "amplitude", "correlated", "material", "step")


def read(path: Path, allow_code: bool = False) -> Deck:
    """A deck of a file.

    Raises
    ------
    DeckError
        With file, line, value and the nearest right word.
    """
    text = read_text(path)
    values = Values(text, allow_code)
    known = (*TOP, *SECTIONS, *METHODS)
    for key in text.data:
        if key not in known:
            raise text.error((key,), f"unknown key {key!r}{nearest(key, known)}")
    top = values.known({k: v for k, v in text.data.items() if k in TOP}, (), TOP)
    units = _units(text, top.get("units"))
    run = values.known(values.table(text.data.get("run", {}), ("run",)), ("run",), RUN)
    asked = []
    for k, each in enumerate(values.tables("quantity")):
        given = values.known(each, ("quantity", k), ASKED)
        asked.append(Asked(**given))
    values.read_named()
    scene = _scene(values, top)
    deck = Deck(scene, run, tuple(asked), units, top.get("title", ""), path, tuple(values.warnings))
    with values.located(("run",)):
        deck.way, deck.options  # noqa: B018
    for k, one in enumerate(asked):
        _check_asked(text, scene, one, ("quantity", k))
    return deck


def _check_asked(text: Text, scene: Scene, asked: Asked, place: Place) -> None:
    """Whether there is an interface of the name."""
    name, dot, _ = asked.of.rpartition(".")
    if ":" not in asked.of.rpartition(".")[2] and dot and name not in scene.interfaces:
        raise text.error((*place, "of"), f"of = {asked.of!r}: unknown interface {name!r}"
                         f"{nearest(name, scene.interfaces)}")


def _units(text: Text, units: Any) -> tuple[str, str] | None:
    if units is None:
        return None
    if len(units) != 2:
        raise text.error(("units",), f"units = {units}: give those of length and force, [\"mm\", \"N\"]")
    for unit, known in zip(units, (LENGTHS, FORCES), strict=True):
        if unit not in known:
            raise text.error(("units",), f"units = {units}: unknown unit {unit!r}{nearest(unit, known)}")
    return units[0], units[1]


def _scene(values: Values, top: Mapping[str, Any]) -> Scene:
    text = values.text
    calls: list[tuple[int, Place, Callable[[Scene], None]]] = []
    for name, method in METHODS.items():
        found: list[tuple[Place, Mapping[str, Any], dict[str, Any]]]
        if name in NAMED:
            found = [((name, key), values.table(each, (name, key)), {"name": key})
                     for key, each in values.section(name)]
        else:
            found = [((name, k), each, {}) for k, each in enumerate(values.tables(name))]
        for place, table, given in found:
            calls.append((text.line(place), place, partial(_call, values, method, table, place, given)))
    if "step" in text.data:
        scene = _of_step(values, values.table(text.data["step"], ("step",)))
        if top.get("axisymmetric"):
            raise text.error(("axisymmetric",), "axisymmetric = true: the parts of a STEP file are solids")
    else:
        scene = Scene(top.get("axisymmetric", False))
    for _, place, call in sorted(calls, key=lambda each: each[0]):
        with values.located(place):
            call(scene)
    if not scene.substructures:
        raise text.error((), "there are no parts: give [substructure.NAME] tables, or a [step] file")
    return scene


def _call(
    values: Values,
    method: Callable[..., Any],
    table: Mapping[str, Any],
    place: Place,
    given: Mapping[str, Any],
    of: Any,
) -> None:
    """A method of a scene or a STEP assembly with the arguments of its table."""
    known = words(method)
    found: dict[str, Any] = dict(given)
    rest: dict[str, Any] = dict(table)
    fields: Mapping[str, Any] = {}
    for name, word in known.items():
        if word.kind in CLASSES:
            found[name], rest = values.object(word.kind, rest, place)
            kind: Any = type(found[name])
            fields = words(kind) if kind in CLASSES[word.kind].values() else {}
        elif word.kind == "part":
            found[name], rest = values.part(rest, place)
    own = {name: word for name, word in known.items() if name not in found}
    values.refuse({k: v for k, v in rest.items() if k not in own}, place, (*own, *fields))
    found |= values.known(rest, place, own)
    if "law" in found and "first" in found and "second" not in found:
        found["second"] = found.pop("law")
    method(of, **found)


def _of_step(values: Values, table: Mapping[str, Any]) -> Scene:
    """The scene of a STEP file, with its materials, sizes, laws and faces in the order of the text."""
    text, place = values.text, ("step",)
    mesh = words(StepAssembly.mesh)
    known = (*READ_STEP, *OF_STEP, "mesh")
    values.refuse({k: v for k, v in table.items() if k not in known}, place, known)
    reading = {key: each for key, each in table.items() if key not in (*OF_STEP, "mesh")}
    given = values.known(reading, place, READ_STEP)
    of_mesh = values.table(table.get("mesh", {}), ("step", "mesh"))
    meshing = values.known(of_mesh, ("step", "mesh"), mesh)
    with values.located(place):
        step = read_step(values.path(given.pop("path"), ("step", "path")), **given)
    calls = []
    for name, method in OF_STEP.items():
        for k, each in enumerate(values.tables(name, table, place)):
            at = ("step", name, k)
            calls.append((text.line(at), at, partial(_call, values, method, each, at, {})))
    for _, at, call in sorted(calls, key=lambda each: each[0]):
        with values.located(at):
            call(step)
    with values.located(place):
        return step.scene(**meshing)
