"""Stacks of parts as a STEP file would have them, with the pairs that touch known from how they were made.

Plates, halves side by side, blocks that share only an edge, rings with a pin in a clearance hole; they touch,
are 0.1 mm apart, overlap by 0.1 mm, or float. ``made(seed, parts)`` makes one, ``judged(stack, folder)``
reads and solves it. ``./run bench stacks`` does so a hundred times.
"""

from __future__ import annotations

import logging
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

import dolfinx_frontend as lf

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "demos"))

GAP = 0.15
"""What counts as nearly touching, mm."""
NEAR, APART, OVERLAP = 0.1, 0.4, -0.1
"""Distances of levels, mm."""
RASTER = 0.25
SMALL = 60
"""Pairs with fewer points of the raster than this in common are not made."""


@dataclass(frozen=True)
class Solid:
    """A prism along z: its outline, and how OpenCASCADE makes it."""

    name: str
    low: float
    high: float
    inside: Callable[[np.ndarray, np.ndarray], np.ndarray]
    make: Callable[[Any], int]


@dataclass
class Stack:
    """Solids, and the pairs that an exact eye finds: name of a pair -> "touching" or "near"."""

    solids: list[Solid] = field(default_factory=list)
    pairs: dict[frozenset[str], str] = field(default_factory=dict)
    overlap: frozenset[str] | None = None
    loose: bool = False

    @property
    def top(self) -> Solid:
        """The plate that is loaded."""
        return next(s for s in reversed(self.solids) if s.name.startswith("plate"))


def _box(name: str, x: tuple[float, float], y: tuple[float, float], low: float, high: float) -> Solid:
    def inside(px: np.ndarray, py: np.ndarray) -> np.ndarray:
        return (px > x[0]) & (px < x[1]) & (py > y[0]) & (py < y[1])

    def make(occ: Any) -> int:
        return int(occ.addBox(x[0], y[0], low, x[1] - x[0], y[1] - y[0], high - low))

    return Solid(name, low, high, inside, make)


def _disc(name: str, outer: float, low: float, high: float, inner: float = 0.0) -> Solid:
    def inside(px: np.ndarray, py: np.ndarray) -> np.ndarray:
        r = np.hypot(px, py)
        return (r < outer) & (r >= inner)

    def make(occ: Any) -> int:
        body = occ.addCylinder(0, 0, low, 0, 0, high - low, outer)
        if inner > 0.0:
            hole = occ.addCylinder(0, 0, low, 0, 0, high - low, inner)
            body = occ.cut([(3, body)], [(3, hole)])[0][0][1]
        return int(body)

    return Solid(name, low, high, inside, make)


def _level(rng: np.random.Generator, number: int, low: float, stack: Stack, plain: bool) -> list[Solid]:
    """The solids of one level, from `low` upwards; pairs within the level are noted."""
    high = low + rng.uniform(3.0, 8.0)
    kind = "plate" if plain else str(rng.choice(["plate", "plate", "halves", "edge", "ring"]))
    w, d = rng.uniform(12.0, 20.0, 2)
    x0, y0 = rng.uniform(-3.0, 3.0, 2)
    if kind == "plate":
        return [_box(f"plate {number}", (x0 - w, x0 + w), (y0 - d, y0 + d), low, high)]
    if kind == "halves":
        slot = rng.choice([0.0, NEAR, APART])
        names = (f"left {number}", f"right {number}")
        if slot <= GAP:
            stack.pairs[frozenset(names)] = "near" if slot else "touching"
        left = _box(names[0], (x0 - w, x0 - 0.5 * slot), (y0 - d, y0 + d), low, high)
        return [left, _box(names[1], (x0 + 0.5 * slot, x0 + w), (y0 - d, y0 + d), low, high)]
    if kind == "edge":  # share an edge, which is no pair
        first = _box(f"corner {number}", (x0 - w, x0), (y0 - d, y0), low, high)
        return [first, _box(f"across {number}", (x0, x0 + w), (y0, y0 + d), low, high)]
    clearance = rng.choice([NEAR, 0.5])
    pin, outer = rng.uniform(3.0, 5.0), rng.uniform(11.0, 18.0)
    if clearance <= GAP:
        stack.pairs[frozenset((f"ring {number}", f"pin {number}"))] = "near"
    ring = _disc(f"ring {number}", outer, low, high, pin + clearance)
    return [ring, _disc(f"pin {number}", pin, low, high - 0.5)]


def _facing(lower: list[Solid], upper: list[Solid], distance: float) -> dict[frozenset[str], str] | None:
    """Pairs of two levels; None: one of them is too small to be fair."""
    axis = np.arange(-25.0, 25.0, RASTER) + 0.5 * RASTER
    px, py = np.meshgrid(axis, axis)
    found = {}
    for below in lower:
        for above in upper:
            if above.low - below.high > distance + 1e-9:
                continue  # a pin that is shorter than its ring
            under = below.inside(px, py)
            common = int(np.count_nonzero(under & above.inside(px, py)))
            # nothing in common, but less than a step of the raster away: who could say
            away = (-2 * RASTER, 0.0, 2 * RASTER)
            steps = [(dx, dy) for dx in away for dy in away]
            close = not common and any(np.any(under & above.inside(px + dx, py + dy)) for dx, dy in steps)
            if 0 < common < SMALL or close:
                return None
            if common:
                found[frozenset((below.name, above.name))] = "near" if distance > 0 else "touching"
    return found


def made(seed: int, parts: int) -> Stack:
    """A stack of about so many parts; the first and the last level are plates."""
    rng = np.random.default_rng(seed)
    stack = Stack()
    level = _level(rng, 0, 0.0, stack, plain=True)
    stack.solids += level
    odd = rng.uniform()  # one stack in ten overlaps somewhere, one in ten floats
    at = int(rng.integers(1, max(2, parts // 2)))
    number, top = 0, level[0].high
    last = False
    while not last:
        number += 1
        distance = float(rng.choice([0.0, 0.0, 0.0, NEAR]))
        last = len(stack.solids) >= parts - 1
        if number == at and odd < 0.2:
            distance = OVERLAP if odd < 0.1 else APART
        for _ in range(100):
            before = dict(stack.pairs)
            above = _level(rng, number, top + distance, stack, plain=last or distance in (OVERLAP, APART))
            pairs = {} if distance in (OVERLAP, APART) else _facing(level, above, distance)
            held = {name for pair in pairs or {} for name in pair}
            if pairs is not None and (pairs or distance) and ({s.name for s in above} <= held or distance):
                break
            stack.pairs = before
        else:
            raise AssertionError("no level fits")
        if distance == OVERLAP:
            stack.overlap = frozenset((level[0].name, above[0].name))
        stack.loose |= distance == APART
        stack.pairs |= pairs
        stack.solids += above
        level, top = above, above[0].high
    return stack


def _laws(step: lf.StepAssembly, stack: Stack, rng: np.random.Generator) -> None:
    for name in step.interfaces:
        pair = frozenset(name.partition("#")[0].split("|"))
        contact = lf.Contact(friction=0.2)
        if stack.pairs.get(pair) == "near":
            step.join(name, contact)
        else:
            laws = [lf.Perfect(), lf.Perfect(), contact, lf.Elastic(normal=1e5, tangential=1e5)]
            step.join(name, laws[int(rng.integers(len(laws)))])


@dataclass(frozen=True)
class Verdict:
    """What became of a stack: "converged", "named" or "refused" as it should be, or a defect."""

    word: str
    said: str
    seconds: float
    missed: tuple[str, ...] = ()
    false: tuple[str, ...] = ()

    @property
    def good(self) -> bool:
        """Whether that is right."""
        return self.word in ("converged", "named", "refused") and not (self.missed or self.false)


@contextmanager
def _told(lines: list[str]) -> Iterator[None]:
    """Warnings and the log, as texts."""

    class Kept(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            lines.append(record.getMessage())

    handler, root = Kept(), logging.getLogger()
    root.addHandler(handler)
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            yield
        lines += [str(each.message) for each in caught]
    finally:
        root.removeHandler(handler)


def judged(stack: Stack, folder: Path, seed: int = 0, solve: bool = True) -> Verdict:
    """Write, read, and solve a stack under a pressure from above and a little shear."""
    from parts.step_file import write_step

    began, said = perf_counter(), list[str]()
    file = write_step(folder / "stack.step", lambda occ: {s.name: s.make(occ) for s in stack.solids})

    def verdict(word: str, missed: tuple[str, ...] = (), false: tuple[str, ...] = ()) -> Verdict:
        return Verdict(word, "\n".join(said), perf_counter() - began, missed, false)

    def names_a_part() -> bool:
        return any(s.name in text for s in stack.solids for text in said)

    try:
        with _told(said):
            step = lf.read_step(file, gap=GAP)
    except lf.SceneError as error:
        said.append(str(error))
        right = stack.overlap is not None and all(name in str(error) for name in stack.overlap)
        return verdict("refused" if right else "wrongly refused")
    if stack.overlap is not None:
        return verdict("an overlap was not seen")
    found = {frozenset(name.partition("#")[0].split("|")) for name in step.interfaces}
    missed, false = stack.pairs.keys() - found, found - stack.pairs.keys()
    lost = tuple("|".join(sorted(p)) for p in missed), tuple("|".join(sorted(p)) for p in false)
    if any(lost) or not solve:
        return verdict("read", *lost)
    top = stack.top
    try:
        with _told(said):
            step.material("*", lf.LinearElastic(E=200e3, nu=0.3))
            step.size("*", 12.0)
            _laws(step, stack, np.random.default_rng(seed))
            step.face(f"{stack.solids[0].name}:below", normal=(0, 0, -1), at=(None, None, 0.0))
            step.face(f"{top.name}:above", normal=(0, 0, 1), at=(None, None, top.high))
            scene = step.scene()
            scene.fix(f"{stack.solids[0].name}:below")
            scene.traction(f"{top.name}:above", (0.02, 0.0, -1.0))
            result = lf.solve(lf.assemble(scene))
    except lf.SceneError as error:
        said.append(str(error))
        if not any(word in str(error) for word in ("unattached", "no equilibrium")):
            return verdict("failed")
        return verdict("named" if names_a_part() else "failed without a name")
    if result.converged:
        return verdict("converged")
    return verdict("gave up, a part named" if names_a_part() else f"{result.status} without a name")
