"""Random scenes, each written as a script: what the campaign runs and what it prints is the same text.

A scene is drawn from its seed alone. Lengths, moduli and loads are drawn in units of their own and scaled at
the end. Two families share nothing but the laws of a joint: ``dev`` has chains, grids and islands,
``held-out`` has hubs with arms, sandwiches of pads between plates, shifted towers and bolted pairs; the
second also has orthotropic parts, user laws with memory, faces that overlap partly and other distributions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

FAMILIES = ("dev", "held-out")
AXES = "xyz"
KINDS = ("static", "history", "chaos", "samples", "sweep")


def family_of(seed: int) -> str:
    """Even seeds are dev, odd ones held out."""
    return FAMILIES[seed % 2]


class Draw:
    """Random numbers with few digits, so that a script is short."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)

    def chance(self, p: float) -> bool:
        return bool(self.rng.random() < p)

    def pick(self, values: Sequence[Any], weights: Sequence[float] | None = None) -> Any:
        p = None if weights is None else np.asarray(weights) / np.sum(weights)
        return values[int(self.rng.choice(len(values), p=p))]

    def whole(self, low: int, high: int) -> int:
        """Both ends included."""
        return int(self.rng.integers(low, high + 1))

    def between(self, low: float, high: float) -> float:
        return short(self.rng.uniform(low, high))

    def power(self, low: float, high: float) -> float:
        """10 to a uniform exponent."""
        return short(10.0 ** self.rng.uniform(low, high))

    def direction(self, dim: int) -> list[float]:
        v = self.rng.standard_normal(dim)
        return [short(x) for x in v / np.linalg.norm(v)]


def short(value: float, digits: int = 4) -> float:
    """Few digits."""
    return float(f"{value:.{digits}g}")


def show(value: Any, digits: int = 4) -> str:
    """A number or nested numbers as Python text."""
    if isinstance(value, (list, tuple)):
        inner = ", ".join(show(v, digits) for v in value)
        return f"({inner},)" if len(value) == 1 else f"({inner})"
    return repr(short(float(value), digits) if isinstance(value, float) else value)


@dataclass
class Block:
    """One part."""

    name: str
    origin: list[float]
    lengths: list[float]
    modulus: float
    divisions: list[int]
    cell: str
    degree: int
    free: list[str] = field(default_factory=list)  # faces nothing is at
    load: float = 1.0  # scale of its loads: strains of 1e-3 of its own
    island: int = 0
    body: str | None = None
    nu: float = 0.3
    ortho: bool = False

    @property
    def dim(self) -> int:
        return len(self.lengths)

    @property
    def size(self) -> float:
        return float(np.prod(self.lengths) ** (1.0 / self.dim))

    def face(self, axis: int, end: int) -> str:
        return f"{self.name}:{AXES[axis]}{end}"

    def take(self, axis: int, end: int) -> str:
        face = f"{AXES[axis]}{end}"
        if face in self.free:
            self.free.remove(face)
        return f"{self.name}:{face}"


@dataclass(frozen=True)
class Touch:
    """Two blocks that touch: the second lies beyond the first along an axis (or before it)."""

    first: int
    second: int
    axis: int
    end: int  # which end of the first block
    partial: bool = False


@dataclass
class Scene:
    """A scene and how it is solved.

    Attributes
    ----------
    seed, family, kind, source
        What it is; the source defines ``build()``, ``laws(a, v)`` and ``run(problem)``.
    rtol
        What is asked for.
    ranks
        1 or 2.
    random, times, grid
        Interfaces with random or swept values; whether there is a history; the swept values.
    about
        One line.
    """

    seed: int
    family: str
    kind: str
    source: str
    rtol: float
    ranks: int
    about: str


class Maker:
    """Draws one scene."""

    def __init__(self, seed: int, attempt: int, kind: str | None, ranks: int | None) -> None:
        self.seed, self.family = seed, family_of(seed)
        self.draw = Draw(seed if attempt == 0 else seed + (attempt << 64))
        self.held_out = self.family == "held-out"
        d = self.draw
        drawn = d.pick(KINDS, (0.5, 0.17, 0.11, 0.11, 0.11))
        # a scene drawn again keeps its ranks, and what runs on several of them
        self.kind = kind or (drawn if ranks in (None, 1) or drawn in ("static", "history") else "static")
        self.linear = d.chance({"static": 0.45, "history": 0.15, "chaos": 0.75}.get(self.kind, 0.4))
        self.dim = 2 if d.chance(0.75) else 3
        several = d.chance(0.03) and self.kind in ("static", "history")
        self.ranks = ranks or (2 if several else 1)
        self.laws: dict[str, str] = {}
        self.lines: list[str] = []
        self.joints: list[str] = []
        self.random: list[str] = []
        self.variables: dict[str, tuple[str, float]] = {}
        self.grid: dict[str, list[float]] = {}
        self.amplitudes: list[tuple[list[float], list[float]]] = []
        self.user: set[str] = set()
        self.words: list[str] = []
        # scales of length and stress; a third of the scenes is in plain numbers
        self.length, self.stress = (1.0, 1.0) if d.chance(0.35) else (d.power(-5, 5), d.power(-3, 9))
        self.contrast = d.chance(0.2)
        self.spring_decades = d.pick(((-1.5, 1.5), (-3.0, 3.0), (-6.0, 6.0)), (0.6, 0.25, 0.15))
        self.load_decades = d.pick((0.0, 2.0, 5.0, 8.0), (0.5, 0.2, 0.15, 0.15))
        self.matching = d.chance(0.5)
        self.degree = d.pick((1, 2), (0.75, 0.25)) if self.dim == 3 else d.pick((1, 2, 3), (0.7, 0.25, 0.05))
        self.rotated = d.chance(0.25)
        self.perfect_ok = True

    # -- blocks -------------------------------------------------------------------------------------
    def cell(self) -> str:
        two, three = ("quadrilateral", "triangle"), ("hexahedron", "tetrahedron")
        return str(self.draw.pick(two if self.dim == 2 else three))

    def block(self, number: int, origin: Sequence[float], lengths: Sequence[float], island: int = 0) -> Block:
        d = self.draw
        few = (1, 3) if self.dim == 2 else (1, 2)
        degree = self.degree if self.matching or d.chance(0.7) else d.pick((1, 2))
        if self.dim == 3 and degree == 2:
            few = (1, 1)
        if self.matching:
            divisions = [self.common] * self.dim
            cell = self.common_cell
        else:
            divisions = [d.whole(*few) for _ in range(self.dim)]
            cell = self.cell()
        modulus = d.power(-6, 6) if self.contrast else d.power(-0.7, 0.7)
        made = Block(
            f"p{number}", list(origin), list(lengths), modulus, divisions, cell, degree, island=island
        )
        made.free = [f"{AXES[a]}{e}" for a in range(self.dim) for e in (0, 1)]
        made.nu = d.pick((0.3, 0.0, 0.2, 0.45))
        made.ortho = self.held_out and d.chance(0.1)
        made.load = 10.0 ** -d.between(0.0, self.load_decades) if self.load_decades and d.chance(0.5) else 1.0
        return made

    def layout(self) -> tuple[list[Block], list[Touch]]:
        d = self.draw
        few = (1, 3) if self.dim == 2 else (1, 2)
        if self.dim == 3 and self.degree == 2:
            few = (1, 1)
        self.common, self.common_cell = d.whole(*few), self.cell()
        small = self.kind in ("chaos", "samples", "sweep") or self.dim == 3
        most = 5 if small else 12
        if self.held_out:
            return d.pick((self.hub, self.sandwich, self.tower, self.pair))(most)
        return d.pick((self.chain, self.grid_of, self.islands))(most)

    def chain(
        self, most: int, start: int = 0, at: float = 0.0, island: int = 0
    ) -> tuple[list[Block], list[Touch]]:
        d = self.draw
        n = d.whole(2 if start == 0 and island == 0 else 1, most)
        blocks, touches, x = [], [], at
        rest = [d.between(0.5, 2.0) if d.chance(0.3) else 1.0 for _ in range(self.dim - 1)]
        for k in range(n):
            length = d.between(0.5, 2.0) if d.chance(0.3) else 1.0
            blocks.append(self.block(start + k, [x] + [0.0] * (self.dim - 1), [length, *rest], island))
            if k:
                touches.append(Touch(start + k - 1, start + k, 0, 1))
            x = short(x + length, 9)
        self.words.append(f"chain of {n}")
        return blocks, touches

    def grid_of(self, most: int) -> tuple[list[Block], list[Touch]]:
        d = self.draw
        nx, ny = d.pick([(2, 2), (3, 2), (2, 3), (4, 2), (3, 3), (4, 3)][: 2 if most < 12 else 6])
        if most < 6:
            nx, ny = 2, 2
        blocks, touches = [], []
        for j in range(ny):
            for i in range(nx):
                number = len(blocks)
                corner = [float(i), float(j), 0.0][: self.dim]
                blocks.append(self.block(number, corner, [1.0] * self.dim))
                if i:
                    touches.append(Touch(number - 1, number, 0, 1))
                if j:
                    touches.append(Touch(number - nx, number, 1, 1))
        self.words.append(f"grid {nx} x {ny}")
        return blocks, touches

    def islands(self, most: int) -> tuple[list[Block], list[Touch]]:
        blocks: list[Block] = []
        touches: list[Touch] = []
        count = self.draw.whole(2, 3)
        scale = [1.0] + [self.draw.power(-8, 0) for _ in range(count - 1)]
        for k in range(count):
            more, their = self.chain(max(1, min(3, most - 2)), len(blocks), 20.0 * k, k)
            for b in more:
                b.load *= scale[k]
            blocks += more
            touches += their
        self.words = [f"{count} islands, {len(blocks)} parts"]
        return blocks, touches

    def hub(self, most: int) -> tuple[list[Block], list[Touch]]:
        d = self.draw
        arms = d.whole(2, 2 * self.dim)
        blocks = [self.block(0, [0.0] * self.dim, [1.0] * self.dim)]
        touches = []
        places = [(a, e) for a in range(self.dim) for e in (0, 1)]
        d.rng.shuffle(places)
        for axis, end in places[:arms]:
            length = d.between(0.5, 3.0)
            lengths = [1.0] * self.dim
            lengths[axis] = length
            origin = [0.0] * self.dim
            origin[axis] = 1.0 if end else -length
            blocks.append(self.block(len(blocks), origin, lengths))
            touches.append(Touch(0, len(blocks) - 1, axis, end))
        self.words.append(f"hub with {arms} arms")
        return blocks, touches

    def sandwich(self, most: int) -> tuple[list[Block], list[Touch]]:
        d = self.draw
        pads = d.whole(1, 3 if self.dim == 2 else 2)
        wide = 2.0 * pads - 1.0
        self.matching = False
        flat = [1.0] * (self.dim - 2)
        tall = self.dim - 1

        def at(x: float, y: float) -> list[float]:
            return [x, *([0.0] * (self.dim - 2)), y]

        blocks = [self.block(0, at(0.0, 0.0), [wide, *flat, 0.5])]
        touches = []
        for k in range(pads):
            blocks.append(self.block(k + 1, at(2.0 * k, 0.5), [1.0, *flat, 0.25]))
            touches.append(Touch(k + 1, 0, tall, 0))
        blocks.append(self.block(pads + 1, at(0.0, 0.75), [wide, *flat, 0.5]))
        touches += [Touch(k + 1, pads + 1, tall, 1) for k in range(pads)]
        for b in blocks:
            b.divisions[0] = max(b.divisions[0], 2 if len(b.lengths) == 2 else 1)
        self.words.append(f"sandwich of {pads} pads")
        return blocks, touches

    def tower(self, most: int) -> tuple[list[Block], list[Touch]]:
        d = self.draw
        n = d.whole(2, min(most, 6))
        blocks, touches = [], []
        up = self.dim - 1
        self.matching = False
        for k in range(n):
            origin = [0.0] * self.dim
            origin[up] = float(k)
            shifted = k > 0 and d.chance(0.5)
            origin[0] = short(blocks[-1].origin[0] + d.between(0.05, 0.45), 9) if shifted else (
                blocks[-1].origin[0] if blocks else 0.0
            )
            blocks.append(self.block(k, origin, [1.0] * self.dim))
            if k:
                touches.append(Touch(k - 1, k, up, 1, partial=shifted))
        self.words.append(f"tower of {n}")
        return blocks, touches

    def pair(self, most: int) -> tuple[list[Block], list[Touch]]:
        self.bolted = True
        n = self.draw.whole(2, 3)
        blocks, touches = [], []
        for k in range(n):
            origin = [0.0] * self.dim
            origin[1] = float(k)
            width = self.draw.pick((1.0, 2.0)) if k == 0 else blocks[0].lengths[0]
            blocks.append(self.block(k, origin, [width, *[1.0] * (self.dim - 1)]))
            if k:
                touches.append(Touch(k - 1, k, 1, 1))
        self.words.append(f"bolted stack of {n}")
        return blocks, touches

    bolted = False

    # -- values -------------------------------------------------------------------------------------
    def stiffness(self, softer: Block, decades: tuple[float, float] | None = None) -> float:
        return short(self.draw.power(*(decades or self.spring_decades)) * softer.modulus / softer.size
                     * self.stress / self.length)

    def pressure_of(self, block: Block) -> float:
        return 1e-3 * block.modulus * block.load * self.stress

    def moved(self, block: Block) -> float:
        """Displacement under its own load."""
        return 1e-3 * block.load * block.size * self.length

    def random_value(self, name: str, law: str, mean: float, positive: bool = True) -> str:
        """A random variable in the place of a number."""
        key = f"v{len(self.variables)}"
        cov = self.draw.pick((0.2, 0.1, 0.01, 1e-3, 1e-4))
        kinds = ["LogNormal"] if positive else ["Normal"]
        if positive and self.held_out:
            kinds += ["Gamma", "Uniform"]
        if positive and cov <= 0.01:
            kinds.append("Normal")
        kind = self.draw.pick(kinds)
        if kind == "Uniform":
            ends = show(mean * (1 - 1.7 * cov), 9), show(mean * (1 + 1.7 * cov), 9)
            text = f'lf.Uniform("{key}", {ends[0]}, {ends[1]})'
        elif mean < 0.0 or not positive:
            text = f'lf.Normal("{key}", {show(mean)}, std={show(abs(mean) * cov)})'
        else:
            text = f'lf.{kind}("{key}", {show(mean)}, cov={show(cov)})'
        self.variables[key] = (text, mean)
        if name not in self.random:
            self.random.append(name)
        return f'v("{key}")'

    def swept_value(self, name: str, parameter: str, mean: float) -> str:
        d = self.draw
        count = d.whole(2, 4)
        if mean == 0.0:
            values = [0.0] * count
        elif d.chance(0.5):
            values = [short(mean * f) for f in np.geomspace(0.3, 3.0, count)]
        else:
            values = [short(mean * f) for f in np.linspace(0.8, 1.3, count)]
        self.grid[f"{name}.{parameter}"] = values
        if name not in self.random:
            self.random.append(name)
        return f'v("{name}.{parameter}")'

    def value(self, name: str, parameter: str, mean: float, positive: bool = True) -> str:
        """A number, or what takes its place where something varies."""
        room = len(self.variables) + len(self.grid) < 2
        if mean == 0.0:
            return "0.0"
        if self.kind in ("chaos", "samples") and room and self.draw.chance(self.eager):
            return self.random_value(name, parameter, mean, positive)
        if self.kind == "sweep" and room and mean != 0.0 and self.draw.chance(self.eager):
            return self.swept_value(name, parameter, mean)
        return show(short(mean))

    eager = 0.6

    def factor(self, slow: bool = False) -> str:
        """An amplitude in front of a value, in a history; `slow`: the one that only grows."""
        if self.kind != "history":
            return ""
        if slow:
            return "a(0) * "
        if self.draw.chance(0.15):
            return ""
        return f"a({self.draw.whole(0, len(self.amplitudes) - 1)}) * "

    # -- joints -------------------------------------------------------------------------------------
    def law_between(self, name: str, parent: Block, child: Block, tree: bool, leaf: bool) -> tuple[str, str]:
        """Text of a law, and how it holds the child: ``all``, ``normal`` (also in traction), ``push`` or
        ``bond``.

        A part whose bond has come off must be held by something else, or its place would be anywhere.
        """
        d = self.draw
        softer = parent if parent.modulus / parent.size < child.modulus / child.size else child
        linear = ["Elastic"] * 5 + ["Perfect"] * 2
        other = ["Contact"] * 5 + ["Friction"] * 4 + ["Debonding", "Rubber", "Tresca", "Wire"]
        if self.held_out:
            other += ["Yield", "Yield"]
        pool = linear if self.linear or d.chance(0.35) else other
        kind = d.pick(pool)
        if kind == "Perfect" and (not self.perfect_ok or (self.kind == "sweep" and not self.grid)):
            kind = "Elastic"
        if kind == "Elastic":
            normal = self.stiffness(softer)
            tangential = self.stiffness(softer)
            jump = short(self.moved(child) * d.between(-1.0, 1.0)) if d.chance(0.2) else 0.0
            text = f'normal={self.value(name, "normal", normal)}'
            both = tree or d.chance(0.8)
            if both:
                text += f', tangential={self.value(name, "tangential", tangential)}'
            if jump:
                text += f", jump={self.factor()}{show(jump)}"
            return f"lf.Elastic({text})", "all" if both else "normal"
        if kind == "Perfect":
            return "lf.Perfect()", "all"
        if kind in ("Contact", "Friction", "Tresca"):
            return self.contact(name, child, softer, kind)
        size = child.modulus / child.size * self.stress / self.length
        move = self.moved(child)
        if kind == "Debonding":
            normal = short(size * d.power(-1, 1))
            strength = short(self.pressure_of(child) * d.power(-0.5, 1))
            last = strength / normal * d.between(3.0, 20.0)
            last = short(last + 10.0 * strength / size * d.between(1.0, 3.0))
            text = f"normal={show(normal)}, tangential={show(short(normal * d.between(0.3, 1.0)))}, "
            return f"lf.Debonding({text}strength={show(strength)}, opening={show(last)})", "bond"
        if kind == "Rubber":
            self.user.add("rubber")
            stiffness = short(size * d.power(-2, 1))
            move = max(move, self.moved(parent))
            hard = short(stiffness / move**2 * d.power(-2, 1))
            values = f'"stiffness": {show(stiffness)}, "hardening": {show(hard)}'
            return f'lf.UserLaw(force=rubber, name="rubber", values={{{values}}})', "all"
        if kind == "Wire":
            self.user.add("wire")
            values = f'"stiffness": {show(short(size * d.power(-1, 1)))}, '
            values += f'"slack": {show(short(move * d.power(-2, 0)))}'
            text = f'lf.UserLaw(resolve=wire, name="wire", values={{{values}}}, components="normal")'
            return text, "push"
        self.user.add("yielding")
        limit = self.pressure_of(child) * d.power(-0.5, 1)
        values = f'"stiffness": {show(short(size * d.power(-1, 1)))}, "limit": {show(short(limit))}'
        text = f'lf.UserLaw(resolve=yielding, name="yield", values={{{values}}}, components="normal", '
        return text + "history=True)", "push"

    def contact(self, name: str, child: Block, softer: Block, kind: str) -> tuple[str, str]:
        d = self.draw
        move = self.moved(child)
        gap = d.pick((0.0, -1.0, 1.0), (0.45, 0.15, 0.4)) * move * d.power(-2, 2)
        if gap < 0.0:
            gap = max(gap, -10.0 * move)
        bound = kind == "Tresca" or (kind == "Friction" and d.chance(0.1))
        if bound:
            # where faces touch without pressing, a bound that is not the pressure's has no unique answer
            gap = -move * d.power(-0.5, 1.0)
        parts = []
        if d.chance(0.15) and gap >= 0.0:
            slope = short(abs(gap or move) * d.between(0.1, 1.0) / self.length)
            parts.append(f"gap=lambda x: {show(short(gap))} + {show(slope)} * np.abs(x[:, 0] - x[0, 0])")
        elif gap or d.chance(0.5):
            parts.append(f'gap={self.value(name, "gap", short(gap), positive=False)}')
        if kind == "Friction":
            parts.append(f'friction={self.value(name, "friction", d.between(0.05, 0.6))}')
        if bound:
            parts.append(f"threshold={show(short(self.pressure_of(child) * d.power(-1, 0.5)))}")
        if d.chance(0.35):
            parts.append(f'stiffness={self.value(name, "stiffness", self.stiffness(softer, (-2.0, 4.0)))}')
        return f"lf.Contact({', '.join(parts)})", "push"

    def join(self, name: str, first: str, second: str | None, law: str, extra: str = "") -> None:
        self.laws[name] = law
        faces = f'"{first}"' if second is None else f'"{first}", "{second}"'
        self.lines.append(f'    scene.interface("{name}", {faces}, law["{name}"]{extra})')

    def bed(self, block: Block, name: str, decades: tuple[float, float]) -> bool:
        """Springs to the ground on a free face."""
        if not block.free:
            return False
        face = self.draw.pick(block.free)
        block.free.remove(face)
        normal, tangential = self.stiffness(block, decades), self.stiffness(block, decades)
        values = f'normal={self.value(name, "normal", normal)}, tangential={show(tangential)}'
        self.join(name, f"{block.name}:{face}", None, f"lf.Elastic({values})")
        return True

    def guides(self, block: Block, axis: int) -> bool:
        """Symmetry planes that leave only the motion along an axis."""
        wanted = []
        for a in range(self.dim):
            if a != axis:
                free = [f for f in block.free if f[0] == AXES[a]]
                if not free:
                    return False
                wanted.append(free[0])
        for face in wanted:
            block.free.remove(face)
            self.join(f"guide_{block.name}_{face}", f"{block.name}:{face}", None, "lf.Symmetry()")
        return True

    def load(self, block: Block, name: str, face: str, push: float | None = None) -> None:
        """A load on a face; with `push` a pressure of that share and a little shear."""
        d = self.draw
        p = self.pressure_of(block)
        axis, end = AXES.index(face[0]), int(face[1])
        where = f"{block.name}:{face}"
        if push is not None or d.chance(0.35):
            size = short(p * (push if push is not None else d.pick((1.0, -1.0))))
            text = self.factor(push is not None) + self.value(name, "p", size, False)
            self.join(name, where, None, f"lf.Pressure({text})")
            return
        if d.chance(0.8) or self.rotated or not self.can_move:
            t = [short(p * x) for x in d.direction(self.dim)]
            self.join(name, where, None, f"lf.Traction({self.factor()}np.array({show(t)}))")
            return
        del axis, end
        u = [short(self.moved(block) * x) for x in d.direction(self.dim)]
        self.join(name, where, None, f"lf.Displacement({self.factor()}np.array({show(u)}))")

    can_move = True

    # -- the scene ------------------------------------------------------------------------------------
    def make(self) -> Scene:
        d = self.draw
        if self.kind == "history":
            self._amplitudes()
        blocks, touches = self.layout()
        for block in blocks:
            block.load = short(block.load)
        self._interfaces(blocks, touches)
        if self.kind in ("chaos", "samples") and not self.variables:
            self._surely_random(blocks)
        if self.kind == "sweep" and not self.grid:
            self._surely_swept(blocks)
        rtol = 10.0 ** -d.pick((2, 3, 4, 5, 6, 7, 8), (0.22, 0.2, 0.2, 0.13, 0.13, 0.06, 0.06))
        source = self._source(blocks, rtol)
        what = "linear" if self.linear else "nonlinear"
        about = f"{self.family}, {self.dim}D, {', '.join(self.words)}, {self.kind}, {what}, rtol {rtol:.0e}"
        if self.ranks > 1:
            about += ", 2 ranks"
        return Scene(self.seed, self.family, self.kind, source, rtol, self.ranks, about)

    def _amplitudes(self) -> None:
        d = self.draw
        steps = d.whole(3, 8)
        self.times = [short(0.5 * (k + 1)) for k in range(steps)]
        end = self.times[-1]
        self.amplitudes.append(([0.0, end / 3.0], [0.0, 1.0]))
        knots = [0.0, end / 3.0, 2.0 * end / 3.0, end]
        tiny = d.pick((1.0, 1.0, 1e-1, 1e-3))
        self.amplitudes.append(
            (knots, [0.0, d.between(0.2, 1.0), d.between(-1.0, 1.0), short(tiny * d.between(0.3, 1.0))])
        )

    def _interfaces(self, blocks: list[Block], touches: list[Touch]) -> None:
        d = self.draw
        neighbours: dict[int, list[Touch]] = {k: [] for k in range(len(blocks))}
        for t in touches:
            neighbours[t.first].append(t)
            neighbours[t.second].append(t)
            blocks[t.first].take(t.axis, t.end)
            if not t.partial:
                blocks[t.second].take(t.axis, 1 - t.end)
            else:
                face = f"{AXES[t.axis]}{1 - t.end}"
                if face in blocks[t.second].free:
                    blocks[t.second].free.remove(face)
        # Perfect closes a loop without contradiction only where nothing is prescribed but zero
        parent: dict[int, Touch | None] = {}
        order: list[int] = []
        roots = []
        for island in sorted({b.island for b in blocks}):
            mine = [k for k, b in enumerate(blocks) if b.island == island]
            with_room = [k for k in mine if blocks[k].free]
            root = d.pick(with_room)
            roots.append(root)
            parent[root] = None
            queue = [root]
            while queue:
                k = queue.pop(0)
                order.append(k)
                for t in neighbours[k]:
                    other = t.second if t.first == k else t.first
                    if other not in parent:
                        parent[other] = t
                        queue.append(other)
        for root in roots:
            block = blocks[root]
            face = d.pick(block.free)
            if d.chance(0.75):
                block.free.remove(face)
                self.join(f"wall_{block.name}", f"{block.name}:{face}", None, "lf.Displacement(0.0)")
            else:
                self.bed(block, f"bed_{block.name}", (-2.0, 1.0))
        used = set()
        loaded: set[int] = set()
        for k in order:
            touch = parent[k]
            if touch is None:
                continue
            used.add(touch)
            other = touch.second if touch.first == k else touch.first
            leaf = len(neighbours[k]) == 1
            self._joint(blocks, touch, other, k, True, leaf, loaded)
        for touch in touches:
            if touch not in used:
                self._joint(blocks, touch, touch.first, touch.second, False, False, loaded)
        if self.bolted or (not self.held_out and not self.linear and d.chance(0.1)):
            for t in touches[: 1 if d.chance(0.5) else None]:
                self._bolt(blocks, t)
        # loads: some parts, in any case one an island
        for island in sorted({b.island for b in blocks}):
            mine = [k for k, b in enumerate(blocks) if b.island == island]
            some = [k for k in mine if k not in loaded and blocks[k].free and d.chance(0.5)]
            if not some and not any(k in loaded for k in mine):
                some = [k for k in mine if blocks[k].free][-1:] or []
            for k in some:
                face = d.pick(blocks[k].free)
                blocks[k].free.remove(face)
                self.load(blocks[k], f"load_{blocks[k].name}", face)
        if d.chance(0.1):
            block = d.pick(blocks)
            size = 1e-4 * self.stress * block.modulus * block.load / self.length
            weight = [short(size * x) for x in d.direction(self.dim)]
            block.body = f"{self.factor() if self.kind == 'history' else ''}np.array({show(weight)})"

    def _joint(
        self, blocks: list[Block], touch: Touch, other: int, k: int, tree: bool, leaf: bool, loaded: set[int]
    ) -> None:
        """The interface between part `k` and one nearer to the ground, and what else holds part `k`."""
        d = self.draw
        name = f"j{touch.first}_{touch.second}"
        first, second = blocks[touch.first], blocks[touch.second]
        match = self.alike(first, second) and not touch.partial and self.matching
        self.perfect_ok = tree
        law, holds = self.law_between(name, blocks[other], blocks[k], tree, leaf)
        rigid = law.startswith("lf.Perfect") or (law.startswith("lf.Contact") and "stiffness" not in law)
        space = "points"
        tied = law.startswith("lf.Perfect")
        if touch.partial or (tied and not match) or (rigid and not match and d.chance(0.7)):
            space = "facets"
        elif d.chance(0.15):
            space = "facets"
        if space == "facets":
            # the mean over one facet holds no rotation
            for a in range(self.dim):
                if a != touch.axis and first.divisions[a] < 2:
                    if match:
                        space = "points"
                    else:
                        first.divisions[a] = 2
        extra = f', space="{space}"' if space != "points" else ""
        if touch.partial:
            extra += ', overlap="partial"'
        self.join(name, first.face(touch.axis, touch.end), second.face(touch.axis, 1 - touch.end), law, extra)
        block = blocks[k]
        if not tree or holds == "all":
            return
        # what a push or a frictionless joint does not hold
        toward = f"{AXES[touch.axis]}{touch.end if touch.second == k else 1 - touch.end}"  # the far face
        if leaf and holds == "push" and law.startswith("lf.Contact") and toward in block.free:
            rubs = "friction=" in law and "threshold" not in law and "gap=lambda" not in law
            if rubs and d.chance(0.25) and not self.random_in(law):
                block.free.remove(toward)
                mu = float(law.split("friction=")[1].split(",")[0].rstrip(")"))
                p = self.pressure_of(block)
                n = [0.0] * self.dim
                n[touch.axis] = -1.0 if toward[1] == "1" else 1.0
                t = [0.0] * self.dim
                t[(touch.axis + 1) % self.dim] = d.pick((0.2, 0.5, 0.8)) * min(mu, 0.3) * d.pick((1.0, -1.0))
                push = f"np.array({show([short(p * x) for x in n])})"
                shear = f"np.array({show([short(p * x) for x in t])})"
                both = f"a(0) * {push} + a(1) * {shear}" if self.kind == "history" else f"{push} + {shear}"
                self.join(f"load_{block.name}", f"{block.name}:{toward}", None, f"lf.Traction({both})")
                loaded.add(k)
                self.words.append("held by friction")
                return
            if d.chance(0.6) and self.guides(block, touch.axis):
                block.free.remove(toward)
                self.load(block, f"load_{block.name}", toward, push=d.pick((1.0, 0.3, 3.0)))
                loaded.add(k)
                self.words.append("flies")
                return
        decades = (-3.0, 0.0) if d.chance(0.7) else (-6.0, -2.0)
        if not self.bed(block, f"bed_{block.name}", decades):
            # no room: hold it by springs at the joint itself
            normal, tangential = self.stiffness(block, decades), self.stiffness(block, decades)
            self.join(
                f"spring_{name}",
                first.face(touch.axis, touch.end),
                second.face(touch.axis, 1 - touch.end),
                f"lf.Elastic(normal={show(normal)}, tangential={show(tangential)})",
                extra if touch.partial or space == "facets" else "",
            )

    @staticmethod
    def random_in(law: str) -> bool:
        return "v(" in law

    def _bolt(self, blocks: list[Block], touch: Touch) -> None:
        d = self.draw
        first, second = blocks[touch.first], blocks[touch.second]
        name = f"bolt{touch.first}_{touch.second}"
        area = self.length ** (self.dim - 1) * first.lengths[0]
        force = short(self.pressure_of(second) * d.power(-0.5, 1.0) * area)
        law = self.laws[f"j{touch.first}_{touch.second}"]
        if not law.startswith("lf.Contact") or self.linear or touch.partial:
            return
        if self.kind == "history" and d.chance(0.5):
            text = f"lf.Preload(a(0) * {show(force)}, until={show(self.amplitudes[0][0][-1])})"
        else:
            k = self.stiffness(second, (-2.0, 0.0))
            jump = self.factor() + show(short(-self.pressure_of(second) / k))
            text = f'lf.Elastic(normal={self.value(name, "normal", k)}, jump={jump})'
        # a bolt's section ties the faces sideways
        ties = text.startswith("lf.Preload") and not self.alike(first, second)
        faces = first.face(touch.axis, touch.end), second.face(touch.axis, 1 - touch.end)
        self.join(name, *faces, text, ', space="facets"' if ties else "")

    @staticmethod
    def alike(first: Block, second: Block) -> bool:
        """Whether the faces of two blocks have the same nodes."""
        same = first.divisions == second.divisions and first.cell == second.cell
        return same and first.degree == second.degree

    def _surely_random(self, blocks: list[Block]) -> None:
        """Where chance gave nothing random: springs on the first free face, or the first load."""
        self.eager = 1.0
        for block in blocks:
            if self.bed(block, f"mount_{block.name}", (-3.0, 1.0)):
                return
        for name, law in self.laws.items():
            if law.startswith("lf.Pressure(") and "a(" not in law:
                value = float(law[len("lf.Pressure(") : -1])
                self.laws[name] = f"lf.Pressure({self.random_value(name, 'p', value, False)})"
                return
        raise Undrawn

    def _surely_swept(self, blocks: list[Block]) -> None:
        self.eager = 1.0
        for block in blocks:
            if self.bed(block, f"mount_{block.name}", (-3.0, 1.0)):
                return
        raise Undrawn

    # -- knobs and text --------------------------------------------------------------------------------
    def _knobs(self, rtol: float) -> tuple[str, list[str]]:
        d = self.draw
        settings = [f"rtol={rtol!r}"]
        method = d.pick(("auto", "accelerated", "latin"), (0.8, 0.1, 0.1))
        plain = method == "latin"
        if self.ranks > 1:
            method, plain = "auto", False
        if not plain:
            if d.chance(0.3):
                settings.append(f"acceleration={d.pick((0, 2, 5, 20))}")
            if d.chance(0.35):
                settings.append(f"newton={d.pick((0, 0, 20, 5000))}")
            if d.chance(0.4):
                settings.append(f"max_iterations={d.pick((1000, 3000))}")
        elif self.kind != "static":
            settings.append("max_iterations=1500")
        if self.ranks == 1:
            if d.chance(0.35):
                settings.append(f'macro="{d.pick(("none", "resultants", "linear"))}"')
            if d.chance(0.25):
                settings.append(f'directions="{d.pick(("diagonal", "matrix"))}"')
            if d.chance(0.1):
                settings.append('precision="single"')
        if d.chance(0.15):
            settings.append(f'operator="{d.pick(("condensed", "factored"))}"')
        if self.kind in ("samples", "sweep"):
            if d.chance(0.3):
                settings.append(f"together={d.pick((1, 4))}")
            if d.chance(0.3):
                settings.append(f"snapshots={d.pick((1, 4))}")
        options = f"lf.Options{'.plain' if plain else ''}({', '.join(settings)})"
        others = [f"options={options}"]
        if d.chance(0.5):
            others.append(f"direction={d.power(-2, 2)}")
        names = list(self.laws)
        choice = d.pick(("none", "some", "all"), (0.3, 0.3, 0.4) if self.linear else (0.5, 0.3, 0.2))
        if choice == "all":
            others.append('active="all"')
        elif choice == "some":
            some = [n for n in names if d.chance(0.4)]
            if some:
                others.append(f"active={some!r}")
        return method, others

    def _source(self, blocks: list[Block], rtol: float) -> str:
        d = self.draw
        method, others = self._knobs(rtol)
        out = ["import numpy as np", "", "import dolfinx_frontend as lf", ""]
        for name in sorted(self.user):
            out += ["", USER_LAWS[name], ""]
        if self.amplitudes:
            shown = ", ".join(
                f"lf.Amplitude({[short(t) for t in times]}, {[short(x) for x in values]})"
                for times, values in self.amplitudes
            )
            out.append(f"AMPLITUDES = [{shown}]")
        out.append(f"TIMES = {self.times if self.kind == 'history' else None}")
        shown = ", ".join(f'"{k}": {text}' for k, (text, _) in self.variables.items())
        out.append(f"VARIABLES = {{{shown}}}")
        out.append(f"GRID = {self.grid}")
        out.append(f"RANDOM = {self.random}")
        out += ["", "", "def laws(a, v):"]
        out.append('    """Laws; a(k): amplitude or its value, v(name): random, swept, or its value."""')
        out.append("    return {")
        out += [f'        "{name}": {text},' for name, text in self.laws.items()]
        out += ["    }", "", ""]
        out += ["def build(a, v):", "    law, scene = laws(a, v), lf.Scene()"]
        turn = self._rotation()
        for b in blocks:
            # faces must meet: all digits
            lengths = [x * self.length for x in b.lengths]
            origin = [x * self.length for x in b.origin]
            out.append(
                f"    part = lf.geometry.box({show(lengths, 15)}, {show(b.divisions)}, "
                f'origin={show(origin, 15)}, cell="{b.cell}")'
            )
            if turn:
                out.append(f"    part.mesh.geometry.x[:] = part.mesh.geometry.x @ np.array({turn}).T")
            modulus = short(b.modulus * self.stress)
            material = f"lf.LinearElastic(E={show(modulus)}, nu={b.nu})"
            if b.ortho:
                material = self._orthotropic(b, modulus)
            body = f", body_force={b.body}" if b.body else ""
            out.append(f'    scene.substructure("{b.name}", part, {material}, degree={b.degree}{body})')
        out += self.lines
        out += ["    return scene", "", "", "def run(problem):"]
        text = ", ".join(others)
        if self.kind in ("samples", "sweep"):
            out.append(f'    plan = lf.make_plan(problem, "{method}", vary=RANDOM, {text})')
            if self.kind == "sweep":
                out.append("    return lf.sweep(problem, GRID, plan=plan, keep_states=True, progress=False)")
            else:
                call = d.pick(("monte_carlo", "quasi_monte_carlo", "tensor_quadrature"))
                if call == "tensor_quadrature":
                    what = "3" if len(self.variables) > 1 else "5"
                else:
                    what = f"{d.pick((8, 16))}, seed={d.whole(0, 99)}"
                kept = "plan=plan, keep_states=True, progress=False"
                out.append(f"    return lf.{call}(problem, {what}, {kept})")
        else:
            call = f'    return lf.solve(problem, "{method}", {text}'
            if self.kind == "history":
                call += ", times=TIMES"
            if self.kind == "chaos":
                shape = d.pick(("total", "tensor", "hyperbolic"), (0.7, 0.15, 0.15))
                order = d.whole(1, 4) if len(self.variables) < 2 else d.whole(1, 2)
                call += f', chaos=lf.Chaos({order}, index_set="{shape}", check_points=0)'
            out.append(call + ")")
        return "\n".join(out) + "\n"

    def _orthotropic(self, b: Block, modulus: float) -> str:
        e2, e3 = short(0.5 * modulus), short(0.3 * modulus)
        g = short(0.2 * modulus)
        if self.dim == 2:
            return f"lf.OrthotropicElastic(E=({modulus}, {e2}, {e3}), nu=(0.2, 0.2, 0.2), G={g})"
        return f"lf.OrthotropicElastic(E=({modulus}, {e2}, {e3}), nu=(0.2, 0.2, 0.2), G=({g}, {g}, {g}))"

    def _rotation(self) -> str:
        if not self.rotated or self.ranks > 1:
            return ""
        if self.dim == 2:
            c, s = np.cos(0.4), np.sin(0.4)
            matrix = [[float(c), -float(s), 0.0], [float(s), float(c), 0.0], [0.0, 0.0, 1.0]]
        else:
            q, _ = np.linalg.qr(np.random.default_rng(self.seed % 2**32).standard_normal((3, 3)))
            q[:, 0] *= np.linalg.det(q)
            matrix = q.tolist()
        return repr(matrix)


class Undrawn(Exception):
    """Nothing came of a draw: take the next attempt."""


USER_LAWS = {
    "rubber": '''def rubber(jump, *, stiffness, hardening):
    square = np.sum(jump**2, axis=1)
    return (stiffness + hardening * square)[:, None] * jump''',
    "wire": '''def wire(jump, flexibility, *, stiffness, slack):
    return np.maximum(0.0, (jump - slack[:, None]) / (flexibility + 1.0 / stiffness[:, None]))''',
    "yielding": '''def yielding(jump, flexibility, *, stiffness, limit, steps):
    force = np.zeros_like(jump)
    for column in range(jump.shape[-1]):
        if column % steps == 0:
            p = np.zeros_like(jump[..., 0])
        k, y = stiffness[:, None, column], limit[:, None, column]
        c = flexibility[..., 0]
        f = np.clip((jump[..., column] - p) / (c + 1.0 / k), -y, y)
        p = jump[..., column] - c * f - f / k
        force[..., column] = f
    return force''',
}


TAIL = """

if __name__ == "__main__":
    import sys
    from pathlib import Path

    sys.path.insert(0, str(Path(lf.__file__).resolve().parents[1] / "benchmarks"))
    from campaign.judge import show

    show(globals(), kind="{kind}", rtol={rtol!r})
"""


def script(drawn: Scene) -> str:
    """The scene as a program that solves it and prints its true errors and what the result says."""
    call = "mpirun -n 2 python" if drawn.ranks > 1 else "python"
    head = f'"""Seed {drawn.seed}: {drawn.about}.\n\nRun it with ./run {call} FILE.\n"""\n\n'
    return head + drawn.source + TAIL.format(kind=drawn.kind, rtol=drawn.rtol)


def scene(seed: int, attempt: int = 0, kind: str | None = None, ranks: int | None = None) -> Scene:
    """The scene of a seed; `attempt` counts the draws that were inadmissible."""
    while True:
        try:
            return Maker(seed, attempt, kind, ranks).make()
        except Undrawn:
            attempt += 100
