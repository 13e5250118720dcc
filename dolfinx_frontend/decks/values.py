"""From what a deck says to what the scene takes."""

from __future__ import annotations

import difflib
import importlib
import inspect
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from latin_core import InputError

from dolfinx_frontend.common.deferred import stats
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.decks.formulas import evaluated
from dolfinx_frontend.decks.kinds import ANY, misfit, of_type
from dolfinx_frontend.decks.lines import DeckError, Place, Text
from dolfinx_frontend.decks.words import CLASSES, DISTRIBUTIONS, PARTS, Word, words
from dolfinx_frontend.geometry.parts import Assembly
from dolfinx_frontend.scene.amplitudes import Amplitude
from dolfinx_frontend.uncertainty.correlated import Correlated

__all__ = ["Values"]

_CODE = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_][\w.]*")
_OF_VALUES = ("amplitude", "value", "sum")


class Values:
    """Reads values of a deck; knows its random numbers, amplitudes and materials by name.

    Parameters
    ----------
    text
        The deck.
    allow_code
        Whether ``"module:function"`` is imported.
    """

    def __init__(self, text: Text, allow_code: bool) -> None:
        self.text, self.allow_code = text, allow_code
        self.random: dict[str, Any] = {}
        self.amplitudes: dict[str, Amplitude] = {}
        self.materials: dict[str, Any] = {}
        self.warnings: list[str] = []
        self._meshes: dict[tuple[str, Any], Assembly] = {}

    @contextmanager
    def located(self, place: Place) -> Iterator[None]:
        """Errors of what is called get the line of the key that they speak of."""
        try:
            yield
        except DeckError:
            raise
        except (SceneError, InputError) as error:
            raise self.text.within(place, str(error)) from None
        except (TypeError, ValueError, ArithmeticError, RecursionError) as error:
            raise self.text.error(place, f"a value that does not fit: {error}") from None

    def read_named(self) -> None:
        """Random numbers, correlations, amplitudes and materials, which others use by name."""
        for name, value in self.section("amplitude"):
            self.amplitudes[name] = self._amplitude(value, ("amplitude", name))
        for name, value in self.section("random"):
            place: Place = ("random", name)
            if isinstance(value, str):
                self.random[name] = self._formula(value, place)
            else:
                self.random[name] = self._random(self.table(value, place), place, name)
        for k, each in enumerate(self.tables("correlated")):
            place = ("correlated", k)
            given = self.known(each, place, words(Correlated))
            members = given.get("parameters")
            if not isinstance(members, list) or not all(isinstance(m, str) for m in members):
                raise self.text.error((*place, "parameters"), "parameters: give names of random numbers")
            chosen = [self.named("random number", m, self.random, (*place, "parameters")) for m in members]
            with self.located(place):
                self.random |= {m.name: m for m in Correlated(chosen, **{**_without(given, "parameters")})}
        for name, value in self.section("material"):
            self.materials[name], rest = self.object("material", self.table(value, ("material", name)),
                                                     ("material", name))
            made: Any = type(self.materials[name])
            fields = words(made) if made in CLASSES["material"].values() else {}
            self.refuse(rest, ("material", name), ("material", *fields))

    # --- tables ---------------------------------------------------------------------------------
    def section(self, name: str) -> list[tuple[str, Any]]:
        """The entries of a table of named things."""
        found = self.text.data.get(name, {})
        if not isinstance(found, dict):
            raise self.text.error((name,), f"{name} is no list: each has a name, write [{name}.NAME]")
        return list(found.items())

    def tables(
        self, name: str, data: Mapping[str, Any] | None = None, at: Place = ()
    ) -> list[dict[str, Any]]:
        """The tables of an array of them."""
        found = (self.text.data if data is None else data).get(name, [])
        if not isinstance(found, list) or not all(isinstance(each, dict) for each in found):
            path = ".".join([*map(str, at), name])
            raise self.text.error((*at, name), f"{name} is a list of tables: write [[{path}]]")
        return found

    def table(self, value: Any, place: Place) -> dict[str, Any]:
        """A value that is a table."""
        if not isinstance(value, dict):
            shown = ".".join(map(str, place))
            raise self.text.error(place, f"{place[-1]} = {_shown(value)} is no table: write [{shown}]")
        return value

    def named(self, kind: str, name: Any, known: Mapping[str, Any], place: Place) -> Any:
        """What has a name, or an error with the nearest ones."""
        if not isinstance(name, str) or name not in known:
            wrong = f"{place[-1]} = {_shown(name)}: unknown {kind}{nearest(name, known)}"
            raise self.text.error(place, wrong)
        return known[name]

    def refuse(self, rest: Mapping[str, Any], place: Place, known: Any) -> None:
        """Keys that mean nothing."""
        for key in rest:
            wrong = f"unknown key {key!r} in {_title(place)}{nearest(key, known)}"
            raise self.text.error((*place, key), wrong)

    def known(self, table: Mapping[str, Any], place: Place, known: Mapping[str, Word]) -> dict[str, Any]:
        """The arguments of a call from a table with these keys."""
        self.refuse({k: v for k, v in table.items() if k not in known}, place, known)
        for name, word in known.items():
            if word.required and name not in table:
                raise self.text.error(place, f"{_title(place)} has no {name!r}: {word.text or 'give it'}")
        return {name: self.read(table[name], known[name], (*place, name)) for name in table}

    # --- one value ------------------------------------------------------------------------------
    def read(self, value: Any, word: Word, place: Place) -> Any:
        """A value of a key."""
        if word.kind == "value":
            return self.value(value, place)
        if word.kind == "values" and isinstance(value, dict) and not _is_value(value):
            return {name: self.value(each, (*place, name)) for name, each in value.items()}
        if word.kind == "values":
            return self.value(value, place)
        if word.kind == "record":
            return self._record(value, word.hint, place)
        if word.kind == "code":
            return self._code(value, place)
        if word.kind == "distribution":
            return self._distribution(value, place)
        if _CODE.fullmatch(str(value)) and _takes_code(word):
            return self._code(value, place)
        wanted = misfit(value, of_type(word.hint))
        if wanted:
            raise self.text.error(place, f"{place[-1]} = {_shown(value)}: give {wanted}")
        simple = isinstance(value, (list, str, int, float, bool))
        return _plain(value) if simple else self._strange(value, place)

    def _strange(self, value: Any, place: Place) -> Any:
        if isinstance(value, dict):
            return {name: _plain(each) for name, each in value.items()}
        raise self.text.error(place, f"{place[-1]} = {value}: a date or a time is no value here")

    def value(self, value: Any, place: Place) -> Any:
        """A number, vector, random number, or an amplitude times one."""
        if isinstance(value, (bool, int, float)):
            return value
        if isinstance(value, str):
            return self._code(value, place) if _CODE.fullmatch(value) else self._formula(value, place)
        if isinstance(value, list):
            return [self.value(each, place) for each in value]
        table = value if isinstance(value, dict) else self._strange(value, place)
        if "sum" in table:
            self.refuse(_without(table, "sum"), place, ("sum",))
            terms = table["sum"]
            if not isinstance(terms, list) or not terms:
                raise self.text.error(place, "sum = [...] has the terms, one at least")
            with self.located(place):
                total = self.value(terms[0], place)
                for each in terms[1:]:
                    total = total + self.value(each, place)
                return total
        if "amplitude" in table:
            self.refuse(_without(table, "amplitude", "value"), place, ("amplitude", "value"))
            with self.located(place):
                return self._amplitude(table["amplitude"], place) * self.value(table.get("value", 1.0), place)
        return self._random(table, place, ".".join(str(key) for key in place[1:]))

    def _formula(self, text: str, place: Place) -> Any:
        with self.located(place[:-1]):
            return evaluated(text, self.random, f"{place[-1]} = {text!r}")

    def _amplitude(self, value: Any, place: Place) -> Amplitude:
        if isinstance(value, str) and not _CODE.fullmatch(value):
            found: Amplitude = self.named("amplitude", value, self.amplitudes, (*place[:-1], place[-1]))
            return found
        if isinstance(value, str):
            return Amplitude(self._code(value, place))
        given = self.known(self.table(value, place), place, words(Amplitude))
        with self.located(place):
            return Amplitude(**given)

    def _random(self, table: Mapping[str, Any], place: Place, name: str) -> Any:
        keys = {key.lower().replace("_", ""): key for key in table}
        kinds = [key for key in keys if key in DISTRIBUTIONS]
        if len(table) != 1 or not kinds:
            wrong = next(iter(key for key in table if key.lower().replace("_", "") not in DISTRIBUTIONS), "")
            hint = nearest(wrong, [*DISTRIBUTIONS, *_OF_VALUES]) if wrong else ""
            raise self.text.error(
                place,
                f"{place[-1]} = {_shown(table)} is no value{hint or ', which has one distribution'}; "
                "write a number, the name of a random number, {lognormal = {mean = 0.15, cov = 0.1}}, or "
                "{amplitude = \"later\", value = 20.0}"
            )
        kind = DISTRIBUTIONS[kinds[0]]
        inner = self.table(table[keys[kinds[0]]], (*place, keys[kinds[0]]))
        given = self.known({"name": name, **inner}, (*place, keys[kinds[0]]), words(kind))
        with self.located((*place, keys[kinds[0]])):
            made = kind(**given)
        if len(place) > 2 or place[0] != "random":  # written in place: the name is its own
            self.random.setdefault(made.name, made)
        return made

    def _distribution(self, value: Any, place: Place) -> Any:
        """Of scipy.stats, by its name and its shapes."""
        if isinstance(value, str) and _CODE.fullmatch(value):
            return self._code(value, place)
        table = self.table(value, place)
        known = {n: each for n in dir(stats) if isinstance(each := getattr(stats, n), stats.rv_continuous)}
        kind = self.named("distribution of scipy.stats", table.get("name"), known, place)
        rest = {key: self.value(each, place) for key, each in table.items() if key not in ("name", "args")}
        with self.located(place):
            return kind(*table.get("args", ()), **rest)

    def _code(self, value: Any, place: Place) -> Any:
        """A function of Python, by ``"module:function"``."""
        if not isinstance(value, str) or not _CODE.fullmatch(value):
            raise self.text.error(place, f"{place[-1]} = {_shown(value)}: a function is 'module:function'")
        if not self.allow_code:
            raise self.text.error(
                place,
                f"{place[-1]} = {value!r} is code, which is not executed: read decks that you trust with "
                "--allow-code (read_deck(..., allow_code=True))"
            )
        module, _, name = value.partition(":")
        folder = str(self.text.path.parent.resolve())
        sys.path.insert(0, folder)
        try:
            found: Any = importlib.import_module(module)
            for each in name.split("."):
                found = getattr(found, each)
        except (ImportError, AttributeError) as error:
            raise self.text.error(place, f"{place[-1]} = {value!r} is not found: {error}") from None
        finally:
            sys.path.remove(folder)
        return found

    # --- objects --------------------------------------------------------------------------------
    def _record(self, value: Any, kind: Any, place: Place) -> Any:
        if isinstance(value, list):
            return [self._record(each, kind, place) for each in value]
        table = self.table(value, place)
        make: Callable[..., Any] = kind
        if len(table) == 1 and inspect.ismethod(found := getattr(kind, next(iter(table)), None)):
            key = next(iter(table))
            table, place, make = self.table(table[key], (*place, key)), (*place, key), found
        given = self.known(table, place, words(make))
        with self.located(place):
            return make(**given)

    def object(self, kind: str, table: Mapping[str, Any], place: Place) -> tuple[Any, dict[str, Any]]:
        """A law or material that a table names by its class, or a material by its name; and what is left of
        the table without its keys."""
        classes = CLASSES[kind]
        title = table.get(kind)
        if isinstance(title, str) and _CODE.fullmatch(title):
            return self._code(title, (*place, kind)), _without(table, kind)
        if kind == "material" and isinstance(title, str) and title in self.materials:
            return self.materials[title], _without(table, kind)
        if kind not in table:
            raise self.text.error(place, f"{_title(place)} has no {kind!r}: one of {', '.join(classes)}")
        choice = classes if kind == "law" else {**classes, **self.materials}
        made = self.named(kind, title, choice, (*place, kind))
        fields = words(made)
        own = {key: each for key, each in table.items() if key in fields and key != "name"}
        given = self.known(own, place, fields)
        with self.located(place):
            return made(**given), _without(table, kind, *own)

    def part(self, table: Mapping[str, Any], place: Place) -> tuple[Any, dict[str, Any]]:
        """A part of a table that says how its mesh is made, and what is left of the table."""
        ways = [key for key in (*PARTS, "part") if key in table]
        if len(ways) != 1:
            found = " and ".join(ways) or "no mesh"
            raise self.text.error(place, f"{_title(place)} has {found}: give one of "
                                  "box = {...} and msh = {...}, or a [step] file for all parts")
        way = ways[0]
        if way == "part":
            return self._code(table["part"], (*place, "part")), _without(table, way)
        inner = self.table(table[way], (*place, way))
        name = str(place[-1])
        if way == "msh":
            name = inner.get("part", name)
            inner = _without(inner, "part")
        given = self.known(inner, (*place, way), words(PARTS[way]))
        with self.located((*place, way)):
            if way != "msh":
                return PARTS[way](**given), _without(table, way)
            path = self.path(given.pop("path"), (*place, way, "path"))
            key = (str(path), str(sorted(given.items())))
            if key not in self._meshes:
                self._meshes[key] = PARTS[way](path, **given)
        parts = self._meshes[key].parts
        return self.named("part", name, parts, (*place, way, "part")), _without(table, way)

    def path(self, value: Any, place: Place) -> Path:
        """A file beside the deck."""
        if not isinstance(value, str) or not value or "\0" in value:
            raise self.text.error(place, f"{place[-1]} = {_shown(value)}: give the name of a file")
        return self.text.path.parent / value


def nearest(name: Any, known: Any) -> str:
    """The nearest known names, or all of them."""
    near = difflib.get_close_matches(str(name), list(known), n=1, cutoff=0.5)
    lower = {each.lower(): each for each in known}
    if str(name).lower() in lower:
        near = [lower[str(name).lower()]]
    if near:
        return f"; did you mean {near[0]!r}?"
    listed = list(known)
    return f"; known: {', '.join(map(repr, listed))}" if listed else "; there is none"


def _is_value(table: Mapping[str, Any]) -> bool:
    keys = {key.lower().replace("_", "") for key in table}
    return bool(keys & {"amplitude", "sum"}) or (len(keys) == 1 and keys <= set(DISTRIBUTIONS))


def _takes_code(word: Word) -> bool:
    return "Callable" in str(word.hint)


def _plain(value: Any) -> Any:
    """Arrays with None where there is no number."""
    if isinstance(value, list):
        return [None if each == ANY else _plain(each) for each in value]
    return value


def _without(table: Mapping[str, Any], *keys: str) -> dict[str, Any]:
    return {key: value for key, value in table.items() if key not in keys}


def _title(place: Place) -> str:
    """A table for messages."""
    if len(place) > 1 and isinstance(place[1], int):
        return f"[[{place[0]}]]"
    return f"[{'.'.join(map(str, place))}]" if place else "the deck"


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) < 100 else f"{text[:97]}..."
