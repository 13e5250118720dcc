"""A scene as a deck in TOML: its calls, one table each, with every number to the last bit."""

from __future__ import annotations

import dataclasses
import json
import os
import re
import sys
from collections.abc import Mapping
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np

from dolfinx_frontend.common.checks import is_real
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.files import write_text
from dolfinx_frontend.common.recorded import Call, made_by
from dolfinx_frontend.decks.formulas import formula, formula_name
from dolfinx_frontend.decks.words import CLASSES, DISTRIBUTIONS, METHODS, NAMED, OF_STEP, PARTS, words
from dolfinx_frontend.geometry.gmsh import write_msh
from dolfinx_frontend.geometry.parts import Part
from dolfinx_frontend.scene.amplitudes import Amplitude, Varying
from dolfinx_frontend.scene.laws.base import Law
from dolfinx_frontend.scene.materials import Material
from dolfinx_frontend.scene.matrix import Matrix
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.scene.values import is_random_field, is_uncertain

__all__ = ["deck_text", "quoted", "relative", "to_deck", "write_deck"]

WIDTH = 108
"""Characters of a line, beyond which an array has a line for each entry."""

_BARE = re.compile(r"[A-Za-z0-9_-]+")


def write_deck(scene: Scene, path: str | Path, **beside: Any) -> None:
    """Write a scene, see :func:`deck_text`, and the meshes that have no words: into a ``.msh`` beside it.

    Raises
    ------
    SceneError
        What no deck can hold, or a file that cannot be written.
    """
    deck = Path(path)
    meshes = deck.absolute().with_name(f"{deck.name}.msh")  # a name that no mesh of the user's has
    writer = Writer(deck.parent, meshes)
    text = writer.text(scene, **beside)
    if writer.parts:
        if meshes in writer.files:
            raise SceneError(f"to_deck: other parts are read from {meshes.name}: give the deck another name")
        write_msh(meshes, writer.parts)
    write_text(deck, text)


def deck_text(
    scene: Scene, folder: Path, *, run: Mapping[str, Any] | None = None, asked: Any = (),
    units: tuple[str, str] | None = None, title: str = "",
) -> str:
    """A scene as the text of a deck in a folder.

    Parameters
    ----------
    run, asked, units, title
        What stands beside the scene, see :class:`dolfinx_frontend.decks.settings.Deck`.

    Raises
    ------
    SceneError
        Functions that have no name in a module, meshes that were made in Python, a scene that was changed
        without its methods: what has to go first.
    """
    return Writer(folder).text(scene, run=run, asked=asked, units=units, title=title)


class Writer:
    """Turns values into what TOML has; collects the random numbers and amplitudes that they use."""

    def __init__(self, folder: Path, meshes: Path | None = None) -> None:
        self.folder, self.meshes = folder, meshes
        self.parts: dict[str, Part] = {}
        self.files: set[Path] = set()
        self.random: dict[str, Any] = {}
        self.groups: list[Any] = []
        self.amplitudes: dict[Amplitude, str] = {}

    def text(
        self, scene: Scene, *, run: Mapping[str, Any] | None = None, asked: Any = (),
        units: tuple[str, str] | None = None, title: str = "",
    ) -> str:
        """The deck, see :func:`deck_text`."""
        scene.journal.compare(scene.in_journal())
        if not scene.journal.complete:
            raise SceneError("to_deck: the scene was changed without its methods, or in one that failed")
        body = [line for call in scene.journal for line in self.call(call)]
        top: dict[str, Any] = {"title": title or None, "units": list(units) if units else None}
        top["axisymmetric"] = True if scene.axisymmetric else None
        lines = self.keys({key: value for key, value in top.items() if value is not None})
        if run:
            lines += ["", "[run]", *self.keys(run)]
        for each in asked:
            given = {f.name: getattr(each, f.name) for f in dataclasses.fields(each)
                     if getattr(each, f.name) != f.default}
            lines += ["", "[[quantity]]", *self.keys(given)]
        lines += self.named()
        return "\n".join([*lines, *body]).lstrip("\n") + "\n"

    # --- calls ----------------------------------------------------------------------------------
    def call(self, call: Call) -> list[str]:
        """The table of a call of the scene."""
        if call.name == "step":
            return self._step(call.arguments)
        given = self.arguments(call, METHODS[call.name])
        if call.name in NAMED:
            header = f"[{call.name}.{_key(str(given.pop('name')))}]"
        else:
            header = f"[[{call.name}]]"
        return ["", header, *self.keys(given)]

    def arguments(self, call: Call, method: Any) -> dict[str, Any]:
        found: dict[str, Any] = {}
        known = words(method)
        for name, value in call.arguments.items():
            where = f"to_deck: {name} of {call.name} {call.arguments.get('name', '')}".rstrip()
            kind = known[name].kind if name in known else "plain"
            if value is None:
                continue
            if isinstance(value, Law) and kind != "record":
                found |= {"law": type(value).__name__, **self._fields(value, where)}
            elif kind == "material":
                found |= self._material(value, where)
            elif kind == "part":
                found |= self._part(value, str(call.arguments["name"]), where)
            else:
                found[name] = self.value(value, where)
        return found

    def _step(self, given: Mapping[str, Any]) -> list[str]:
        reading = {key: each for key, each in given.items() if key not in ("calls", "mesh")}
        path = relative(reading.pop("path"), self.folder)
        own = {"path": path, **{k: self.value(v, f"to_deck: {k} of read_step") for k, v in reading.items()}}
        lines = ["", "[step]", *self.keys(own), f"mesh = {_text(self.value(given['mesh'], 'to_deck'))}"]
        for call in given["calls"]:
            lines += ["", f"[[step.{call.name}]]", *self.keys(self.arguments(call, OF_STEP[call.name]))]
        return lines

    def _part(self, part: Any, name: str, where: str) -> dict[str, Any]:
        made = made_by(part)
        if made is not None and made.name in PARTS:
            given = dict(made.arguments)
            if "path" in given:
                self.files.add(Path(given["path"]).absolute())
                given["path"] = relative(given["path"], self.folder)
            return {made.name: self.value({k: v for k, v in given.items() if v is not None}, where)}
        if isinstance(part, Part) and self.meshes is not None:
            self.parts[name] = part
            return {"msh": {"path": relative(self.meshes, self.folder), "part": name}}
        if callable(part):
            return {"part": self._code(part, where)}
        if isinstance(part, Matrix):
            raise SceneError(f"{where}: a deck has no words for a Matrix: keep the scene in Python")
        raise SceneError(f"{where}: {short(part)} has no words in a deck: give a geometry.Part")

    def _material(self, material: Any, where: str) -> dict[str, Any]:
        title = type(material).__name__
        if isinstance(material, Material) and title in CLASSES["material"]:
            return {"material": title, **self._fields(material, where)}
        return {"material": self._code(material, where)}

    def _fields(self, record: Any, where: str) -> dict[str, Any]:
        """Fields of a record that differ from their defaults."""
        title = type(record).__name__
        if isinstance(record, Law) and title not in CLASSES["law"]:
            raise SceneError(f"{where}: {title} is a law of your own, which a deck has no word for")
        found = {}
        for each in dataclasses.fields(record):
            value = getattr(record, each.name)
            if value is not None and not _same(value, each):
                found[each.name] = self.value(value, f"{where}, {each.name}")
        return found

    # --- values ---------------------------------------------------------------------------------
    def value(self, value: Any, where: str) -> Any:
        """A value in numbers, texts, arrays and tables."""
        if isinstance(value, (bool, str, int)) and not isinstance(value, np.generic):
            return value
        if is_real(value):
            return float(value)
        if isinstance(value, np.bool_):
            return bool(value)
        if isinstance(value, (np.ndarray, np.generic)):
            return value.tolist()
        if isinstance(value, (list, tuple)):
            return ["any" if each is None else self.value(each, where) for each in value]
        if isinstance(value, Mapping):
            return {str(key): self.value(each, where) for key, each in value.items()}
        if isinstance(value, Varying):
            terms = [self._term(amplitude, each, where) for amplitude, each in value.terms]
            return terms[0] if len(terms) == 1 and isinstance(terms[0], dict) else {"sum": terms}
        if is_random_field(value):
            self._keep(value.name, value, where)
            return formula_name(value.name)
        if is_uncertain(value):
            for name, leaf in value.leaves.items():
                self._keep(name, leaf, where)
            return formula(value, where)
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            return self._fields(value, where)
        return self._code(value, where)

    def _term(self, amplitude: Amplitude | None, value: Any, where: str) -> Any:
        inner = self.value(value, where)
        if amplitude is None:
            return inner
        name = self.amplitudes.setdefault(amplitude, f"a{len(self.amplitudes) + 1}")
        return {"amplitude": name, "value": inner}

    def _keep(self, name: str, leaf: Any, where: str) -> None:
        group = getattr(leaf, "group", None)
        if group is not None:
            for member in group.marginals:
                self._keep_one(member.name, member, where)
            if all(group is not each for each in self.groups):
                self.groups.append(group)
        else:
            self._keep_one(name, leaf, where)

    def _keep_one(self, name: str, leaf: Any, where: str) -> None:
        if self.random.setdefault(name, leaf) != leaf:
            raise SceneError(f"{where}: the random number {name!r} has two definitions: give them two names")

    def named(self) -> list[str]:
        """The tables of random numbers, of their correlations and of amplitudes."""
        lines: list[str] = []
        if self.random:
            lines += ["", "[random]"]
            for name, leaf in self.random.items():
                lines.append(f"{_key(name)} = {_text(self._distribution(name, leaf))}")
        for group in self.groups:
            given = made_by(group)
            assert given is not None
            own = {key: self.value(each, "to_deck: Correlated") for key, each in given.arguments.items()}
            lines += ["", "[[correlated]]", *self.keys(own)]
        for amplitude, name in self.amplitudes.items():
            lines += ["", f"[amplitude.{name}]"]
            if amplitude.times:
                lines += self.keys({"times": list(amplitude.times), "values": list(amplitude.values)})
            else:
                lines += self.keys({"times": self._code(amplitude.function, f"to_deck: amplitude {name}")})
        return lines

    def _distribution(self, name: str, leaf: Any) -> dict[str, Any]:
        where = f"to_deck: random number {name!r}"
        if is_random_field(leaf):
            return {"randomfield": {k: each for k, each in self._fields(leaf, where).items() if k != "name"}}
        made = made_by(leaf)
        if made is None or made.name.lower() not in DISTRIBUTIONS:
            raise SceneError(f"{where}: {short(leaf)} was made in a way that a deck has no word for")
        given = {key: each for key, each in made.arguments.items() if key != "name" and each is not None}
        if "distribution" in given:
            given["distribution"] = self._of_scipy(given["distribution"], where)
        return {made.name.lower(): {key: self.value(each, where) for key, each in given.items()}}

    def _of_scipy(self, frozen: Any, where: str) -> dict[str, Any]:
        kind = getattr(getattr(frozen, "dist", None), "name", None)
        if kind is None:
            raise SceneError(f"{where}: {short(frozen)}: give a frozen, continuous one of scipy.stats")
        args = {"args": [self.value(each, where) for each in frozen.args]} if frozen.args else {}
        return {"name": kind, **args, **{key: self.value(each, where) for key, each in frozen.kwds.items()}}

    def _code(self, value: Any, where: str) -> str:
        """``"module:function"`` of a function that is there under that name."""
        module, name = getattr(value, "__module__", None), getattr(value, "__qualname__", "")
        if callable(value) and module not in (None, "__main__") and "<" not in name:
            try:
                found = reduce(getattr, name.split("."), sys.modules[str(module)])
            except (AttributeError, KeyError):
                found = None
            if found is value:
                return f"{module}:{name}"
        raise SceneError(
            f"{where}: {short(value)} is Python, which a deck cannot hold; only functions with a name in a "
            "module that can be imported ('module:function', read with --allow-code)"
        )

    # --- text -----------------------------------------------------------------------------------
    def keys(self, table: Mapping[str, Any]) -> list[str]:
        """A line for each key."""
        lines = []
        for key, value in table.items():
            line = f"{_key(key)} = {_text(self.value(value, 'to_deck'))}"
            if len(line) > WIDTH and isinstance(value, (list, tuple)):
                inner = "".join(f"    {_text(self.value(each, 'to_deck'))},\n" for each in value)
                line = f"{_key(key)} = [\n{inner}]"
            lines.append(line)
        return lines


def relative(path: str | Path, folder: Path) -> str:
    """The name of a file in a folder."""
    return Path(os.path.relpath(Path(path).absolute(), folder.absolute())).as_posix()


def quoted(text: str) -> str:
    """A text as TOML."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _same(value: Any, each: Any) -> bool:
    """Whether a field has its default."""
    default = each.default
    if each.default_factory is not dataclasses.MISSING:
        default = each.default_factory()
    return type(value) is type(default) and not isinstance(value, np.ndarray) and bool(value == default)


def _key(name: str) -> str:
    return name if _BARE.fullmatch(name) else quoted(name)


def _text(value: Any) -> str:
    """A value as TOML."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return quoted(value)
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(_text, value))}]"
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{_key(k)} = {_text(v)}' for k, v in value.items())} }}" if value else "{}"
    if isinstance(value, int):
        return str(value)
    text = repr(float(value))
    return text if "." in text or "n" in text or "e" not in text else text.replace("e", ".0e", 1)


def to_deck(scene: Scene, path: str | Path, *, units: tuple[str, str] | None = None, title: str = "") -> None:
    """Write the scene as a deck in TOML, which :func:`dolfinx_frontend.read_deck` and ``latin run`` read.

    The deck has every number to the last bit; files of parts are named relative to its folder. Meshes that
    were made in Python, or are those of an ``.inp`` or ``.bdf``, are written into ``joint.toml.msh``.

    Parameters
    ----------
    path
        The file, ``"joint.toml"``.
    units
        Those of length and force, ``("mm", "N")``: a statement.
    title
        One line.

    Raises
    ------
    SceneError
        What no deck can hold: functions that have no name in a module, laws of your own.
    """
    write_deck(scene, path, units=units, title=title)


Scene.to_deck = to_deck
