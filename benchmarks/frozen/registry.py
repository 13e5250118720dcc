"""Scenes of the frozen corpus that are written by hand.

A scene is a function of the tolerance ``rtol`` of the iteration. It builds, solves and returns one result of
the library or a mapping from names to results, quantities and numbers; what is kept of them is found by
``observe``. A scene must be deterministic and independent of its neighbours::

    @scene("joints", right={"clamp.normal": Right(48e3, 1e-6, "balance of the press force")})
    def sandwich(rtol: float) -> Any:
        ...
        return lf.solve(problem, rtol=rtol)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Right:
    """A value that is known from outside the solver.

    ``tolerance`` is relative to ``value`` (absolute where that is zero); ``source`` names the closed form,
    reference or independent program.
    """

    value: float
    tolerance: float
    source: str


@dataclass(frozen=True)
class FrozenScene:
    """A scene, unsolved after `limit` seconds. `known_bad`: why it is unsolved or wrong at the freeze."""

    name: str
    group: str
    function: Callable[[float], Any]
    right: Mapping[str, Right] = field(default_factory=dict)
    limit: float = 60.0
    known_bad: str = ""


SCENES: dict[str, FrozenScene] = {}


def scene(
    group: str, right: Mapping[str, Right] | None = None, limit: float = 60.0, known_bad: str = ""
) -> Callable[[Callable[[float], Any]], Callable[[float], Any]]:
    """Enters a function into ``SCENES`` as ``group/name of the function``."""

    def enter(function: Callable[[float], Any]) -> Callable[[float], Any]:
        name = f"{group}/{function.__name__}"
        if name in SCENES:
            raise ValueError(f"two scenes are named {name}")
        SCENES[name] = FrozenScene(name, group, function, right or {}, limit, known_bad)
        return function

    return enter
