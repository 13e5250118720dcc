"""Engineers' joints, drawn: do they arrive, and is what they answer right?

    ./run bench joints --count 2000 --jobs 2          a night
    ./run bench joints --first 17 --count 1 --show    one of them

Stacks with soft sheets, plates under bolts, blocks in a corner, frames of three blocks, press fits, pins in
holes with clearance; friction up to 1.5, gaps, loads that turn and go to zero, moduli up to 1e6 apart,
units from micrometres to metres. Each answer is judged from the forces and jumps at its points alone, by a
program that knows the scene as it was drawn and nothing of the kernel: law, cone and gap at every point and
step, balance of every part that no support holds; where there is none, a linear programme over all forces
within the cones says so.
"""

from __future__ import annotations

import argparse
import json
import logging
import multiprocessing
import statistics
import sys
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import common  # makes the tests importable
import numpy as np
import numpy.typing as npt
from parts.rings import annulus
from scipy.optimize import linprog
from scipy.sparse import coo_matrix

import dolfinx_frontend as lf
from dolfinx_frontend.common.errors import BalanceError

Array = npt.NDArray[np.float64]
LONG_S = 60.0
"""A scene that takes longer is undecided."""
TOLERANCE = 1e-4
"""Of law, cone, gap and balance, relative to the forces and jumps of the scene; solved to 1e-8."""
MORE = 1.05
"""Pressures of a step without equilibrium over those of the step before, where bolts or walls make them."""
NOTHING = 1e-3
"""Of the displacements: jumps below have no digits left for the tolerance."""
FACETS = 64
"""Of a cone in the linear programme, drawn around it: what these exclude the cone excludes."""


@dataclass
class Pull:
    """A resultant on a part: force and moment about the origin at unit amplitude, amplitude of every step."""

    part: str
    wrench: Array
    amplitude: Array


@dataclass
class Joint:
    """A scene as it was drawn.

    Attributes
    ----------
    contacts
        Interface -> friction, threshold, gap and compliance.
    pulls
        Loads of the parts.
    free
        Parts that no support holds.
    bolts
        Interfaces that carry a force of their own.
    """

    family: str
    scene: lf.Scene
    times: Array
    contacts: dict[str, tuple[float, float, float, float]] = field(default_factory=dict)
    pulls: list[Pull] = field(default_factory=list)
    free: tuple[str, ...] = ()
    bolts: tuple[str, ...] = ()


class Draw:
    """Random numbers of one scene, lengths and forces in its own unit."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng([46, seed])
        self.mm = float(self.rng.choice([1.0, 1.0, 1e-3, 1e3]))
        self.of_force = float(self.rng.choice([1.0, 1.0, 1e-3]))
        self.mpa = self.of_force / self.mm**2

    def one(self, *values: Any) -> Any:
        return values[int(self.rng.integers(len(values)))]

    def friction(self) -> float:
        return float(self.one(0.05, 0.1, 0.2, 0.4, 0.8, 1.5))

    def contact(self, gaps: bool = True) -> tuple[lf.Contact, tuple[float, float, float, float]]:
        mu = self.friction()
        gap = float(self.one(1e-3, 1e-2)) * self.mm if gaps and self.rng.random() < 0.15 else 0.0
        stiffness = float(self.one(1e3, 1e5)) * self.mpa / self.mm if self.rng.random() < 0.2 else None
        settings = {} if stiffness is None else {"stiffness": stiffness}
        law = lf.Contact(friction=mu, gap=gap, **settings) if gap else lf.Contact(friction=mu, **settings)
        return law, (mu, 0.0, gap, 0.0 if stiffness is None else 1.0 / stiffness)

    def solid(self, *moduli: float) -> lf.LinearElastic:
        return lf.LinearElastic(float(self.one(*moduli)) * self.mpa, float(self.one(0.0, 0.3, 0.45)))

    def paths(self) -> tuple[Array, Array, Array]:
        """Times, and amplitudes of what presses and what pushes: to and fro, to zero, in one step or five."""
        press, push = self.one(
            ([1, 1, 1, 0.5, 1], [0, 1, -1, 0.3, 1]),
            ([1, 1, 1, 1, 1], [0, 0.5, 1, 0.5, -1]),
            ([1, 1, 0.3, 1, 1], [0, 0.3, 0.2, 1, 0]),
            ([1, 1, 1, 0, 1], [0, 1, 0, 0, 0.5]),
            ([1], [1]),
            ([1, 1], [0, 1]),
        )
        times = np.arange(1.0, len(press) + 1.0)
        return times, np.array(press, float), np.array(push, float)


def _amplitude(times: Array, values: Array) -> lf.Amplitude:
    return lf.Amplitude([0.0, *times], [0.0, *values])


def _wrench(force: Array, at: Array) -> Array:
    force, at = (np.pad(each, (0, 3 - len(each))) for each in (force, at))
    return np.concatenate([force, np.cross(at, force)])


def _pull(
    joint: Joint, part: str, face: str, area: float, at: Sequence[float], traction: Array, path: Array
) -> None:
    in_time = _amplitude(joint.times, path) * tuple(traction)
    joint.scene.traction(f"{part}:{face}", in_time, name=f"{part}-{face}-{len(joint.pulls)}")
    joint.pulls.append(Pull(part, _wrench(area * traction, np.asarray(at, float)), path))


def stack(draw: Draw) -> Joint:
    """Plates and soft sheets, pressed, then sheared by up to 1.2 times what friction carries."""
    rng, mm, dim = draw.rng, draw.mm, int(draw.one(2, 3))
    length, width = float(draw.one(20.0, 50.0)) * mm, (10.0 * mm if dim == 3 else 1.0)
    times, press, push = draw.paths()
    joint = Joint("stack", lf.Scene(), times)
    count, height, up = int(rng.integers(2, 6)), 0.0, "yz"[dim - 2]
    cells = int(draw.one(4, 8, 12) if dim == 3 else draw.one(8, 16, 32))
    for k in range(count):
        thin = rng.random() < 0.35
        h = float(draw.one(0.2, 0.5, 1.0) if thin else draw.one(4.0, 8.0, 15.0)) * mm
        own = cells + int(rng.integers(0, 3))
        size, divisions = (length, h), (own, 1 if thin else 2)
        origin: tuple[float, ...] = (0.0, height)
        if dim == 3:
            size, divisions = (length, width, h), (own, max(2, own // 2), divisions[1])
            origin = (0.0, 0.0, height)
        kind = "hexahedron" if dim == 3 else draw.one("triangle", "quadrilateral")
        part = lf.geometry.box(size, divisions, origin=origin, cell=kind)
        solid = draw.solid(0.3, 4.0, 2e3, 3e5) if thin else draw.solid(3e3, 70e3, 210e3)
        joint.scene.substructure(f"p{k}", part, solid, degree=int(draw.one(1, 1, 2)))
        height += h
    joint.scene.fix(f"p0:{up}0")
    mu = 9.0
    for k in range(count - 1):
        law, about = draw.contact()
        joint.scene.interface(f"i{k}", f"p{k}:{up}1", f"p{k + 1}:{up}0", law)
        joint.contacts[f"i{k}"], mu = about, min(mu, about[0])
    pressure = float(draw.one(0.1, 1.0, 20.0)) * draw.mpa
    shear = float(rng.uniform(0.1, 1.2)) * mu * pressure
    at, top = (0.5 * length, *([0.5 * width] if dim == 3 else []), height), f"p{count - 1}"
    along, down = np.eye(dim)[0], -np.eye(dim)[-1]
    _pull(joint, top, f"{up}1", length * width, at, pressure * down, press)
    _pull(joint, top, f"{up}1", length * width, at, shear * along, push)
    joint.free = tuple(f"p{k}" for k in range(1, count))
    return joint


def bolted(draw: Draw) -> Joint:
    """Plates under a bolt, with a gasket or without; the last one is pulled to and fro."""
    rng, mm = draw.rng, draw.mm
    count = int(rng.integers(2, 5))
    cells, size, height = int(draw.one(3, 4, 6)), 40.0 * mm, 0.0
    scene, contacts = lf.Scene(), {}
    gasket = rng.random() < 0.5
    for k in range(count):
        thin = gasket and k == 1 and count > 2
        h = (1.0 if thin else 5.0) * mm
        divisions = (cells + k % 2, cells, 1)
        box = lf.geometry.box((size, size, h), divisions, origin=(0, 0, height), cell="hexahedron")
        scene.substructure(f"p{k}", box, draw.solid(5.0, 500.0) if thin else draw.solid(70e3, 210e3))
        height += h
    for k in range(count - 1):
        law, contacts[f"i{k}"] = draw.contact(gaps=False)
        scene.interface(f"i{k}", f"p{k}:z1", f"p{k + 1}:z0", law)
    preload = 10e3 * draw.of_force
    d = 12.0 * mm
    bolt = lf.BoltStiffness.vdi2230(
        d=d, pitch=1.75 * mm, shank=2 * height / 5, thread=height / 5, E=205e3 * draw.mpa
    )
    times = np.array([1.0, 2.0, 3.0, 4.0])
    path = np.array(draw.one([0, 1, -1, 0], [0, 0.5, 1, 0.2], [0, 1, 0, 1]), float)
    joint = Joint("bolted", scene, times, contacts, bolts=("bolt",))
    tension = lf.Preload(preload * lf.Amplitude([0, 1], [0, 1]), until=1.0)
    scene.beam("bolt", "p0:z0", f"p{count - 1}:z1", bolt, tension)
    scene.fix("p0:x0")
    share = float(rng.uniform(0.1, 1.4)) * min(mu for mu, *_ in contacts.values())
    last, area = f"p{count - 1}", size * 5.0 * mm
    at = (size, 0.5 * size, height - 2.5 * mm)
    _pull(joint, last, "x1", area, at, np.array([share * preload / area, 0.0, 0.0]), path)
    joint.free = tuple(f"p{k}" for k in range(1, count))
    return joint


def corner(draw: Draw) -> Joint:
    """A block on the floor and against a wall, pushed into the corner, up and down."""
    mm, size = draw.mm, 20.0 * draw.mm
    cells, degree = int(draw.one(3, 5, 8)), int(draw.one(1, 2))
    times, press, push = draw.paths()
    joint = Joint("corner", lf.Scene(), times)
    block = lf.geometry.box((size, size), (cells, cells + 1), cell=draw.one("triangle", "quadrilateral"))
    floor = lf.geometry.box((size, 5.0 * mm), (cells + 2, 2), origin=(0.0, -5.0 * mm))
    wall = lf.geometry.box((5.0 * mm, size), (2, cells + 1), origin=(-5.0 * mm, 0.0))
    for name, part in (("block", block), ("floor", floor), ("wall", wall)):
        joint.scene.substructure(name, part, draw.solid(3e3, 210e3), degree=degree)
    joint.scene.fix("floor:y0")
    joint.scene.fix("wall:x0")
    for name, one, other in (("foot", "block:y0", "floor:y1"), ("side", "block:x0", "wall:x1")):
        law, joint.contacts[name] = draw.contact()
        joint.scene.interface(name, one, other, law)
    pressure = float(draw.one(0.5, 10.0)) * draw.mpa
    down = float(draw.rng.uniform(-1.0, 1.0))
    _pull(joint, "block", "x1", size, (size, 0.5 * size), np.array([-pressure, 0.0]), press)
    _pull(joint, "block", "y1", size, (0.5 * size, size), np.array([0.0, -pressure]), press)
    _pull(joint, "block", "x1", size, (size, 0.5 * size), np.array([0.0, down * pressure]), push)
    joint.free = ("block",)
    return joint


def frame(draw: Draw) -> Joint:
    """Two posts and a lintel that only contact holds, pushed at its end."""
    rng, mm = draw.rng, draw.mm
    times, press, push = draw.paths()
    joint, wide, high = Joint("frame", lf.Scene(), times), 10.0 * draw.mm, 20.0 * draw.mm
    span, cells = 60.0 * mm, int(draw.one(2, 4))
    boxes = {
        "bed": ((span, 5.0 * mm), (6 * cells, 1), (0.0, -5.0 * mm)),
        "left": ((wide, high), (cells, 2 * cells), (0.0, 0.0)),
        "right": ((wide, high), (cells, 2 * cells), (span - wide, 0.0)),
        "lintel": ((span, wide), (6 * cells, cells), (0.0, high)),
    }
    for name, (size, divisions, origin) in boxes.items():
        box = lf.geometry.box(size, divisions, origin=origin, cell="quadrilateral")
        joint.scene.substructure(name, box, draw.solid(20e3, 210e3))
    joint.scene.fix("bed:y0")
    for post in ("left", "right"):
        ends = ((f"foot-{post}", f"{post}:y0", "bed:y1"), (f"head-{post}", f"{post}:y1", "lintel:y0"))
        for name, one, other in ends:
            law, joint.contacts[name] = draw.contact(gaps=False)
            joint.scene.interface(name, one, other, law)
    pressure = float(draw.one(0.5, 5.0)) * draw.mpa
    side = float(rng.uniform(0.05, 1.2)) * min(mu for mu, *_ in joint.contacts.values())
    at = (0.5 * span, high + wide)
    _pull(joint, "lintel", "y1", span, at, np.array([0.0, -pressure]), press)
    _pull(joint, "lintel", "y1", span, at, np.array([side * pressure, 0.0]), push)
    joint.free = ("left", "right", "lintel")
    return joint


def fit(draw: Draw) -> Joint:
    """A shaft pressed into a hub, turned to and fro by up to 1.2 of what friction carries."""
    rng, mm = draw.rng, draw.mm
    a, b, c = 4.0 * mm, 10.0 * mm, 25.0 * mm
    times, _, push = draw.paths()
    times, push = np.concatenate([[1.0], times + 1.0]), np.concatenate([[0.0], push])
    around, degree = int(draw.one(12, 16, 24)), int(draw.one(1, 2))
    joint = Joint("fit", lf.Scene(), times, free=("shaft",))
    steel, hub = draw.solid(210e3), draw.solid(20e3, 70e3, 210e3)
    joint.scene.substructure("shaft", annulus(a, b, 2 * np.pi, divisions=(2, around)), steel, degree=degree)
    joint.scene.substructure("hub", annulus(b, c, 2 * np.pi, divisions=(3, around)), hub, degree=degree)
    joint.scene.fix("hub:outer")
    interference, mu = float(draw.one(2e-3, 1e-2)) * mm, draw.friction()
    joint.scene.interface("fit", "shaft:outer", "hub:inner", lf.Contact(gap=-interference, friction=mu))
    joint.contacts["fit"] = (mu, 0.0, -interference, 0.0)
    pressure = 0.3 * interference / b * 70e3 * draw.mpa
    shear = float(rng.uniform(0.1, 1.2)) * mu * pressure * (b / a) ** 2

    def turning(x: Array) -> Array:
        return np.asarray(shear * np.column_stack([-x[:, 1], x[:, 0]]) / np.hypot(x[:, 0], x[:, 1])[:, None])

    joint.scene.traction("shaft:inner", _amplitude(times, push) * turning, name="turn")
    joint.pulls.append(Pull("shaft", np.array([0, 0, 0, 0, 0, shear * 2 * np.pi * a * a]), push))
    return joint


def pin(draw: Draw) -> Joint:
    """A pin in a hole with clearance, pressed in a direction that turns."""
    mm, rng = draw.mm, draw.rng
    clearance = float(draw.one(1e-3, 1e-2, 5e-2)) * mm
    b = 10.0 * mm
    times = np.arange(1.0, float(draw.one(2, 4, 7)))
    joint = Joint("pin", lf.Scene(), times, free=("pin",))
    around = int(draw.one(16, 24))
    bar = annulus(2.0 * mm, b, 2 * np.pi, divisions=(3, around))
    joint.scene.substructure("pin", bar, draw.solid(210e3), degree=2)
    ring = annulus(b + clearance, 25.0 * mm, 2 * np.pi, divisions=(3, around))
    joint.scene.substructure("ring", ring, draw.solid(20e3, 210e3), degree=2)
    joint.scene.fix("ring:outer")
    mu = draw.friction()
    joint.scene.interface("hole", "pin:outer", "ring:inner", lf.Contact(gap=clearance, friction=mu))
    joint.contacts["hole"] = (mu, 0.0, clearance, 0.0)
    pressure, turn = float(draw.one(0.5, 10.0)) * draw.mpa, float(rng.uniform(0.0, 0.6))
    for axis, path in enumerate((np.cos(turn * (times - 1.0)), np.sin(turn * (times - 1.0)))):
        traction = np.where(np.arange(2) == axis, -pressure, 0.0)
        joint.scene.traction("pin:inner", _amplitude(times, path) * tuple(traction), name=f"push{axis}")
        joint.pulls.append(Pull("pin", _wrench(2 * np.pi * 2.0 * mm * traction, np.zeros(2)), path))
    return joint


FAMILIES: tuple[Callable[[Draw], Joint], ...] = (stack, stack, bolted, corner, frame, fit, pin)


def drawn(seed: int) -> Joint:
    draw = Draw(seed)
    return FAMILIES[seed % len(FAMILIES)](draw)


@dataclass
class Verdict:
    """right, wrong, undecided, no equilibrium (``none``), or ``none`` that the programme does not confirm."""

    seed: int
    family: str
    word: str
    status: str = ""
    why: str = ""
    steps: int = 0
    seconds: float = 0.0
    units: float = 0.0


def judged(seed: int) -> Verdict:
    """Solve a scene, and judge its answer."""
    warnings.simplefilter("ignore")
    logging.disable(logging.CRITICAL)
    joint = drawn(seed)
    verdict = Verdict(seed, joint.family, "")
    problem = lf.assemble(joint.scene)
    began = process_time()
    options = lf.Options(rtol=1e-8)
    try:
        answer = lf.solve(problem, times=joint.times, options=options, max_seconds=LONG_S, progress=False)
    except BalanceError as error:
        proof = proven(joint, problem, range(len(joint.times)))
        verdict.word, verdict.status = "none" if proof else "not confirmed", "refused"
        verdict.why, verdict.seconds = str(error)[:150], process_time() - began
        return verdict
    except Exception as error:  # noqa: BLE001
        verdict.word, verdict.why = "raised", f"{type(error).__name__}: {error}"[:200]
        verdict.seconds = process_time() - began
        return verdict
    verdict.seconds, verdict.status = process_time() - began, answer.status
    verdict.steps = int(answer.summary.newton_steps)
    verdict.units = verdict.seconds / linear(problem, joint.times)
    good = [each == "converged" for each in answer.statuses]
    wrong = broken(joint, problem, answer, int(np.argmin([*good, False])))
    if wrong:
        verdict.word, verdict.why = "wrong", wrong
    elif all(good):
        verdict.word = "right"
    elif answer.status in ("no_equilibrium", "slides"):
        lost = good.index(False)
        bounds = {name: _normal(joint, problem, answer, name)[max(lost - 1, 0)] for name in joint.contacts}
        proof = proven(joint, problem, [lost])
        held = proof or proven(joint, problem, [lost], bounds)
        verdict.word = "none" if proof else "slides" if held else "not confirmed"
    else:
        verdict.word, verdict.why = "undecided", answer.ended[:150]
    return verdict


def linear(problem: lf.Problem, times: Array) -> float:
    """Seconds of one iteration of the scene with its factorisations: the unit of cost."""
    began = process_time()
    options = lf.Options(max_iterations=1, newton=0, criterion="indicator")
    lf.solve(problem, times=times[:1], options=options, progress=False)
    return process_time() - began


def _normal(joint: Joint, problem: lf.Problem, answer: Any, name: str) -> Array:
    """(T, m) pressures at the points."""
    interface = problem.interfaces[name]
    force = np.reshape(answer.force(name), (len(joint.times), interface.num_points, -1))
    return np.maximum(-force[..., 0], 0.0)


def broken(joint: Joint, problem: lf.Problem, answer: Any, count: int) -> str:
    """What the first `count` steps violate, or nothing."""
    if count == 0:
        return ""
    far = max(float(np.abs(answer.unknowns(name)).max()) for name in problem.substructures)
    sums = {part: np.zeros((count, 6)) for part in joint.free}
    moved = {part: np.zeros(count) for part in joint.free}
    for name, interface in problem.interfaces.items():
        if interface.one_point or name not in joint.contacts:
            continue
        law = joint.contacts[name]
        shape = (len(joint.times), interface.num_points, -1)
        force, jump = (np.reshape(each(name), shape)[:count] for each in (answer.force, answer.jump))
        said = _law(force, jump, law, NOTHING * far)
        if said:
            return f"{name}: {said}"
        frames = interface.frames.copy()
        if interface.mean_normals is not None:
            frames[:, 0] = interface.mean_normals
        whole = np.einsum("tma,mad,m->tmd", force, frames, interface.weights)
        at = interface.points if interface.places is None else interface.places
        for side, sign in zip(interface.sides, (1.0, -1.0), strict=True):
            if side.substructure in sums:
                for t in range(count):
                    wrench = np.sum([_wrench(f, x) for f, x in zip(whole[t], at, strict=True)], axis=0)
                    sums[side.substructure][t] += sign * wrench
                moved[side.substructure] += np.abs(whole).sum(axis=(1, 2))
    if joint.bolts:
        return ""  # they act on mean motions of faces, which are not drawn here
    for pull in joint.pulls:
        sums[pull.part] += pull.amplitude[:count, None] * pull.wrench
        moved[pull.part] += np.abs(pull.amplitude[:count]) * np.abs(pull.wrench[:3]).sum()
    size = max((float(each.max()) for each in moved.values()), default=0.0)
    for part, left in sums.items():
        if np.abs(left[:, :3]).max() > TOLERANCE * size:
            return f"{part} is out of balance by {np.abs(left[:, :3]).max() / size:.1e}"
    return ""


def _law(force: Array, jump: Array, law: tuple[float, float, float, float], nothing: float) -> str:
    mu, tau, gap, compliance = law
    normal, shear = force[..., 0], force[..., 1:]
    size = max(float(np.abs(force).max()), np.finfo(float).tiny)
    opening = jump[..., 0] + gap - compliance * normal
    reach = max(float(np.abs(jump).max()), float(np.abs(opening).max()), nothing)
    if normal.max() > TOLERANCE * size:
        return f"pulls with {normal.max() / size:.1e} of its forces"
    if (-opening).max() > TOLERANCE * reach:
        return f"penetrates by {(-opening).max() / reach:.1e} of its jumps"
    if (np.minimum(-normal / size, opening / reach)).max() > TOLERANCE:
        return "presses where it is open"
    bound = mu * np.maximum(-normal, 0.0) + tau
    length = np.linalg.norm(shear, axis=-1)
    if (length - bound).max() > TOLERANCE * size:
        return f"beyond the cone by {(length - bound).max() / size:.1e}"
    before = np.concatenate([np.zeros_like(jump[:1, :, 1:]), jump[:-1, :, 1:]])
    slip = jump[..., 1:] - before
    far = np.linalg.norm(slip, axis=-1)
    # what slips is on its bound, and friction opposes it: f is on side 1, the jump of side 2 against it
    lost = np.einsum("tma,tma->tm", shear, slip) - bound * far
    closed = -normal > TOLERANCE * size
    if np.where(closed, np.abs(lost), 0.0).max() > TOLERANCE * size * reach * 10.0:
        return f"slips off its bound: {np.abs(lost).max() / (size * reach):.1e}"
    return ""


def proven(
    joint: Joint, problem: lf.Problem, steps: Sequence[int], bounds: dict[str, Array] | None = None
) -> bool:
    """Whether at one of the steps no forces within the cones balance the loads: a linear programme.

    With `bounds` pressures are at most a little more than these, which were reached at the step before.
    """
    if joint.bolts and bounds is None:
        return False
    parts = {name: k for k, name in enumerate(joint.free)}
    dim = problem.dim
    entries: list[tuple[int, int, float]] = []
    columns, upper = 0, []
    size = float(np.ptp(np.concatenate([i.points for i in problem.interfaces.values()]), axis=0).max())
    for name, (mu, _, _, _) in joint.contacts.items():
        interface = problem.interfaces[name]
        at = interface.points if interface.places is None else interface.places
        angles = 2 * np.pi * np.arange(FACETS) / FACETS
        around = [(1.0,), (-1.0,)] if dim == 2 else np.column_stack([np.cos(angles), np.sin(angles)])
        wider = 1.0 if dim == 2 else 1.0 / np.cos(np.pi / FACETS)
        for k in range(interface.num_points):
            most = np.inf if bounds is None else MORE * bounds[name][k] * interface.weights[k]
            for direction in around:
                local = np.array([-1.0, *(mu * wider * np.asarray(direction))])
                wrench = _wrench(local @ interface.frames[k], at[k])
                wrench[3:] /= size
                for side, sign in zip(interface.sides, (1.0, -1.0), strict=True):
                    if side.substructure in parts:
                        row = 6 * parts[side.substructure]
                        entries += [(row + a, columns, sign * w) for a, w in enumerate(wrench) if w]
                columns += 1
                upper.append(most)
    rows, where, values = zip(*entries, strict=True)
    matrix = coo_matrix((values, (rows, where)), shape=(6 * len(parts), columns)).tocsr()
    for step in steps:
        load = np.zeros(6 * len(parts))
        for pull in joint.pulls:
            wrench = pull.amplitude[step] * pull.wrench
            load[6 * parts[pull.part] :][:6] += np.concatenate([wrench[:3], wrench[3:] / size])
        scale = max(float(np.abs(load).max()), np.finfo(float).tiny)
        # the least that is left, in the sum of its components
        left = np.vstack([np.eye(len(load)), -np.eye(len(load))]).T
        found = linprog(
            np.concatenate([np.zeros(columns), np.ones(left.shape[1])]),
            A_eq=np.hstack([matrix.toarray(), left]),
            b_eq=-load / scale,
            bounds=[(0.0, most / scale) for most in upper] + [(0.0, None)] * left.shape[1],
            method="highs",
        )
        if found.status == 0 and found.fun > TOLERANCE:
            return True
    return False


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="./run bench joints",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="number of the first scene")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--show", action="store_true", help="a line for every scene")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    numbers = range(given.first, given.first + given.count)
    began, found = perf_counter(), []
    with multiprocessing.get_context("spawn").Pool(given.jobs, maxtasksperchild=50) as pool:
        for verdict in pool.imap_unordered(judged, numbers):
            found.append(verdict)
            if given.show or verdict.word not in ("right", "none", "slides"):
                print(
                    f"{verdict.seed:6d} {verdict.family:8s} {verdict.word:13s} {verdict.status:15s} "
                    f"{verdict.steps:5d} steps {verdict.seconds:6.1f} s {verdict.units:5.1f} {verdict.why}",
                    flush=True,
                )
    words = Counter(each.word for each in found)
    units = sorted(each.units for each in found if each.word == "right")
    counted = ", ".join(f"{count} {word}" for word, count in words.most_common())
    print(f"{len(found)} scenes in {perf_counter() - began:.0f} s: {counted}")
    if units:
        most = units[int(0.95 * (len(units) - 1))]
        print(f"cost over an iteration: median {statistics.median(units):.1f}, 95 % below {most:.1f}")
    if given.json:
        record = {"environment": common.environment(), "scenes": [vars(each) for each in found]}
        given.json.write_text(json.dumps(record, indent=1) + "\n")
    return int(any(words[word] for word in ("wrong", "undecided", "raised", "not confirmed")))


if __name__ == "__main__":
    sys.exit(main())
