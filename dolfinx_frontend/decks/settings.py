"""What a deck says beside the scene: units, how it is run, what is asked."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from latin_core import Options

from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.decks.words import Word, words
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.solving import quasi_monte_carlo, solve

__all__ = ["ASKED", "RUN", "TOP", "Asked", "Deck"]

LENGTHS = ("m", "cm", "mm", "um", "in", "ft")
FORCES = ("N", "kN", "MN", "mN", "lbf", "kip")


@dataclass(frozen=True)
class Asked:
    """A number that the report has.

    Attributes
    ----------
    of
        A number of the tables, ``"joint.pressure_max"``, or ``"module:function"`` of the fields.
    name
        For tables; None: `of`.
    unit
        Its unit.
    step
        Of a load history.
    above, below
        The probability that it is more, or less, than this.
    quantiles
        Probabilities of its quantiles.
    """

    of: str
    name: str | None = None
    unit: str = ""
    step: int = -1
    above: float | None = None
    below: float | None = None
    quantiles: tuple[float, ...] = ()


def _run_words() -> dict[str, Word]:
    """Keys of [run]: those of `solve` that a text can give, of samplings, and all options."""
    objects = ("problem", "plan", "start", "callback", "progress", "comm", "options", "direction")
    found = {name: word for name, word in words(solve).items() if name not in objects}
    found["chaos"] = dataclasses.replace(found["chaos"], kind="plain", hint=int)
    found["quantity"] = dataclasses.replace(found["quantity"], kind="plain", hint=str)
    sampling = words(quasi_monte_carlo)
    found |= {name: dataclasses.replace(sampling[name], required=False) for name in ("samples", "seed")}
    found["samples"] = dataclasses.replace(found["samples"], text="Sobol points, a power of two.")
    found["direction"] = Word("direction", "plain", float, False, None, "Factor of search directions.")
    return found | {name: word for name, word in words(Options).items() if name not in found}


RUN: Mapping[str, Word] = _run_words()
ASKED: Mapping[str, Word] = words(Asked)
TOP: Mapping[str, Word] = {
    "title": Word("title", "plain", str, False, "", "One line that says what it is."),
    "units": Word("units", "plain", tuple[str, ...], False, None,
                  "Length and force that all numbers are in, [\"mm\", \"N\"]: nothing is converted. "
                  f"Lengths: {', '.join(LENGTHS)}; forces: {', '.join(FORCES)}."),
    "axisymmetric": dataclasses.replace(words(Scene)["axisymmetric"], required=False),
}
OPTIONS = tuple(words(Options))

Way = Literal["solve", "accuracy", "samples", "chaos"]


@dataclass
class Deck:
    """A scene, how it is run, and what is asked: what a deck describes.

    Attributes
    ----------
    scene
        The scene.
    run
        Settings of :func:`solve`, of samplings and :class:`Options`, by name.
    asked
        Numbers of the report.
    units
        Those of length and force, or None.
    title
        One line.
    path
        The file.
    notes
        What was read in another way than it is written, a sentence each.
    """

    scene: Scene
    run: dict[str, Any] = field(default_factory=dict)
    asked: tuple[Asked, ...] = ()
    units: tuple[str, str] | None = None
    title: str = ""
    path: Path | None = None
    notes: tuple[str, ...] = ()

    @property
    def way(self) -> Way:
        """How it is solved: once, to an accuracy, by samples, or in a chaos."""
        ways: tuple[Way, ...] = ("accuracy", "samples", "chaos")
        given = [way for way in ways if self.run.get(way) is not None]
        if len(given) > 1:
            raise SceneError(f"run: {' and '.join(given)} are given: give one; an accuracy chooses all")
        return given[0] if given else "solve"

    @property
    def options(self) -> Options:
        """Options of the kernel; the seconds of a search for an accuracy are not those of each run."""
        own = {name: value for name, value in self.run.items() if name in OPTIONS}
        if self.way == "accuracy":
            own.pop("max_seconds", None)
        return Options(**own)
