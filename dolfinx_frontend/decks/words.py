"""The words of a deck: what the public classes and functions take, by their signatures.

Nothing is listed here that a signature says. A method of the scene is a table of the deck, its arguments are
the keys; a law, material or distribution is named by its class, and its fields are keys, too.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args, get_origin, get_type_hints

from dolfinx_frontend.common.recorded import is_journaled
from dolfinx_frontend.geometry.gmsh import read_msh
from dolfinx_frontend.geometry.primitives import box
from dolfinx_frontend.geometry.solids import Cut
from dolfinx_frontend.geometry.step import StepAssembly, read_step
from dolfinx_frontend.scene import laws
from dolfinx_frontend.scene.amplitudes import Amplitude, Varying
from dolfinx_frontend.scene.bolts import BoltStiffness
from dolfinx_frontend.scene.laws.base import Law
from dolfinx_frontend.scene.laws.rigid import MOTIONS
from dolfinx_frontend.scene.materials import LinearElastic, Material, OrthotropicElastic
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.scene.specs import PartLike
from dolfinx_frontend.scene.values import Parameter
from dolfinx_frontend.uncertainty import parameters
from dolfinx_frontend.uncertainty.correlated import Correlated
from dolfinx_frontend.uncertainty.fields import RandomField

__all__ = [
    "CLASSES", "DISTRIBUTIONS", "METHODS", "NAMED", "OF_STEP", "PARTS", "RECORDS", "Kind", "Word", "kind_of",
    "words",
]

Kind = Literal["value", "plain", "law", "material", "part", "record", "code", "values", "distribution"]
"""How a key is read: numbers that may be random or vary, what is passed as it is, or an object."""


@dataclass(frozen=True)
class Word:
    """A key of a table.

    Attributes
    ----------
    name, kind
        Its name, and how its value is read.
    hint
        Type of a value of kind "plain", class of one of kind "record".
    required
        Whether it must be there.
    default
        What it is without.
    text
        What it means, from the documentation of the class or function.
    """

    name: str
    kind: Kind
    hint: Any
    required: bool
    default: Any
    text: str


def _public(module: Any, base: type) -> dict[str, Any]:
    found = {name: getattr(module, name) for name in module.__all__}
    return {n: c for n, c in found.items() if inspect.isclass(c) and issubclass(c, base) and c is not base}


CLASSES: Mapping[str, Mapping[str, Any]] = {
    "law": {name: each for name, each in _public(laws, Law).items() if name not in ("Linked", "Rigid")},
    "material": {each.__name__: each for each in (LinearElastic, OrthotropicElastic)},
}
"""Objects that are named by their class in a table that has their fields as well; what `scene.rigid`,
`scene.plane` and `scene.link` make has no name of its own."""

DISTRIBUTIONS: Mapping[str, Callable[..., Any]] = {
    name.lower(): getattr(parameters, name) for name in parameters.__all__ if name != "RandomParameter"
} | {"randomfield": RandomField}
"""Random numbers and fields, by the name of their function in lower case."""

PARTS: Mapping[str, Callable[..., Any]] = {"box": box, "msh": read_msh}
"""Parts, by what makes their meshes."""

RECORDS = (BoltStiffness, laws.Preload, Cut)
"""Objects whose class is known from the key."""


def _calls(of: type) -> dict[str, Callable[..., Any]]:
    """Public methods whose calls are kept in a journal, in the order of the source."""
    return {
        name: each
        for base in reversed(of.__mro__)
        for name, each in vars(base).items()
        if not name.startswith("_") and is_journaled(each)
    }


METHODS: Mapping[str, Callable[..., Any]] = _calls(Scene)
OF_STEP: Mapping[str, Callable[..., Any]] = _calls(StepAssembly)
NAMED = tuple(
    name
    for name, each in METHODS.items()
    if (given := inspect.signature(each).parameters.get("name")) and given.default is inspect.Parameter.empty
)
"""Methods whose things have a name always: tables by name; those of others are arrays of tables."""


def kind_of(hint: Any) -> tuple[Kind, Any]:
    """How a value of a type is read."""
    options = _within(hint)
    outer = {get_origin(each) or each for each in (hint, *get_args(hint)) if not isinstance(each, list)}
    if Mapping in outer and options & {Any, Parameter}:
        return "values", hint
    if Law in options:
        return "law", hint
    if Material in options:
        return "material", hint
    if PartLike in options:
        return "part", hint
    for record in RECORDS:
        if record in options:
            return "record", record
    if hint is Any or Parameter in options or Varying in options:
        return "value", hint
    if Callable in outer and str not in outer:
        return "code", hint
    return "plain", hint


def _within(hint: Any) -> set[Any]:
    """A type, what it is a union of, and what these hold."""
    found = {hint, get_origin(hint)}
    for each in get_args(hint):
        if get_origin(hint) is not Literal:
            found |= {Any} if isinstance(each, list) else _within(each)
    return found


def _documented(of: Any) -> dict[str, str]:
    """Sentences of the sections Parameters and Attributes of a docstring, by name."""
    found: dict[str, str] = {}
    names: list[str] = []
    for row in inspect.cleandoc(of.__doc__ or "").splitlines():
        if re.fullmatch(r"[A-Za-z_][\w, ]*", row) and not row.startswith(("Raises", "Returns", "Warns")):
            names = [each.strip() for each in row.split(",")]
        elif row.startswith("    ") and names:
            for name in names:
                found[name] = f"{found.get(name, '')} {row.strip()}".strip()
        elif row.strip():
            names = []
    return {name: re.sub(r":\w+:`~?([^`]+)`", r"\1", text.replace("``", "")) for name, text in found.items()}


@functools.cache
def words(of: Any) -> Mapping[str, Word]:
    """The keys of a method, function or class, by name."""
    made = inspect.unwrap(of)
    plain_class = inspect.isclass(made) and not dataclasses.is_dataclass(made)
    hints = get_type_hints(made.__init__ if plain_class else made)
    documented = _documented(made)
    found: dict[str, Word] = {}
    for name, each in inspect.signature(of).parameters.items():
        if each.kind is inspect.Parameter.VAR_POSITIONAL or name == "self":
            continue
        hint = hints.get(name, Any)
        if each.kind is inspect.Parameter.VAR_KEYWORD:
            found |= _open(made, hint, documented.get(name, ""))
            continue
        required = each.default is inspect.Parameter.empty
        kind, of_kind = kind_of(hint)
        found[name] = Word(name, kind, of_kind, required, None if required else each.default,
                           documented.get(name, ""))
    if made in (Amplitude, Correlated):
        found = {k: dataclasses.replace(w, kind="plain") for k, w in found.items()}
    if "distribution" in found and made is inspect.unwrap(parameters.FromDistribution):
        found["distribution"] = dataclasses.replace(found["distribution"], kind="distribution")
    if made is inspect.unwrap(Scene.interface):  # a law is one, wherever it stands
        found["second"] = dataclasses.replace(found["second"], kind="plain", hint=str, required=False)
        found["law"] = dataclasses.replace(found["law"], required=True)
    return found


def _open(of: Any, hint: Any, text: str) -> dict[str, Word]:
    """The keys of `**settings`: what a method hands on to `Scene.interface`, or motions."""
    if of is inspect.unwrap(StepAssembly.join):
        own = set(inspect.signature(of).parameters) | {"name", "first", "second"}
        return {name: each for name, each in words(Scene.interface).items() if name not in own}
    return {name: Word(name, kind_of(hint)[0], hint, False, None, text) for name in MOTIONS if name != "n"}


READ_STEP = words(read_step)
