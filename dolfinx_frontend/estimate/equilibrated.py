"""A proven bound of the error of the meshes: a stress in balance beside the answer.

If s is a stress in balance with the loads and u a displacement that the supports admit, the distance of s
from the stress of u in energy is at least the error of u (W. Prager and J. L. Synge, Quart. Appl. Math. 5
(1947) 241); of laws of interfaces that have an energy, what Fenchel's inequality leaves of forces and jumps
is added (P. Ladeveze and D. Leguillon, SIAM J. Numer. Anal. 20 (1983) 485). The kernel makes s from the
answer, see ``latin::equilibration``; here is what it needs of the parts, and the interfaces. Nothing is
fitted or believed.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import permutations, product
from time import perf_counter
from typing import Any

import dolfinx.fem as fem
import numpy as np

from dolfinx_frontend.assembly.held import held
from dolfinx_frontend.assembly.interface import Interface, PointFrames, frames
from dolfinx_frontend.assembly.part_loads import PartLoad, traction_on
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.rigid import free_motions
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.deferred import sp
from dolfinx_frontend.common.interrupts import stop_if_pressed
from dolfinx_frontend.estimate.balanced_cells import cut
from dolfinx_frontend.estimate.balanced_faces import OnFace
from dolfinx_frontend.estimate.balanced_laws import (
    contact_pressure,
    gap_of_contact,
    gap_of_friction,
    gap_of_springs,
)
from dolfinx_frontend.estimate.balanced_parts import (
    SETTINGS,
    Body,
    Inputs,
    between_cells,
    correct,
    lifted,
    refused,
)
from dolfinx_frontend.results.balance import eliminated, held_by_nodes, nodal_forces
from dolfinx_frontend.results.errors import EnergyBound
from dolfinx_frontend.scene.laws import Elimination, Law
from dolfinx_frontend.scene.loads import is_field
from dolfinx_frontend.scene.materials import VOIGT

__all__ = ["energy_bound"]

_ACROSS = (1.0, 0.618, 0.271)
"""Of a direction along which vertices of cells are seldom side by side."""

_SAMPLED = "it is given by a function of the place, which is known at points only"


def energy_bound(result: Any, step: int = -1) -> EnergyBound:
    """Bound of the energy of the error of an answer, of one step.

    Parameters
    ----------
    result
        Deterministic, or a history.

    Raises
    ------
    SceneError
        No stress in balance is made for such a part or load, by its name.
    """
    began = perf_counter()
    problem: Problem = result.problem
    if result.kind not in ("deterministic", "history"):
        raise refused(f"the answer is a {result.kind}: solve it with numbers, at a point of interest")
    if problem.comm is not None:
        raise refused("its parts are on several ranks: solve it on one")
    time = None if result.times is None else float(result.times[step])
    moment = problem if time is None else problem.at(time)
    work = _Work(result, moment, step)
    for load in moment.loads.values():  # first: of what supports take, initial stresses are a part
        work.add_load(load)
    for interface in problem.interfaces.values():
        stop_if_pressed()
        work.add(interface, interface.law if time is None else interface.law.at(time))
    return work.bound(began)


@dataclass(frozen=True)
class _Points(PointFrames):
    """Points of a face, for the load of a law."""

    name: str
    points: Array
    weights: Array
    frames: Array


@dataclass
class _Work:
    """What is gathered of an answer on the way to its bound."""

    result: Any
    problem: Problem
    step: int
    notes: list[str] = field(default_factory=list)
    gaps: dict[str, float] = field(default_factory=dict)
    joints: list[tuple[Interface, Law]] = field(default_factory=list)
    glued: list[Interface] = field(default_factory=list)
    supports: list[Interface] = field(default_factory=list)

    def __post_init__(self) -> None:
        fields = {n: self._at(self.result.unknowns(n)) for n in self.problem.substructures}
        self.bodies = {n: Body(part, fields[n]) for n, part in self.problem.substructures.items()}
        self._number()
        for name, body in self.bodies.items():
            if not body.straight():
                self.notes.append(f"{name!r} has curved cells")
            if np.any(body.askew):
                why = "integrals of their stress are not exact"
                self.notes.append(f"{name!r} has cells that are no parallelograms: {why}")
            body.acting += self.problem.load_on(name).reshape(body.u.shape)
            self._own_force(body)

    def _at(self, values: Array) -> Array:
        return np.asarray(values if self.result.times is None else values[self.step])

    def add(self, interface: Interface, law: Law) -> None:
        """What an interface exerts on its parts, or joins of them."""
        name, two = interface.name, len(interface.sides) == 2
        if any(map(is_field, law.parameters().values())):
            self.notes.append(f"{name!r}: {_SAMPLED}")
        if interface.law.history and self.result.times is not None:
            self.notes.append(f"{name!r} remembers steps before, whose errors are in no bound")
        if held_by_nodes(self.result, interface):
            if not two:
                self._support(interface, law)
            elif interface.matching is not None and eliminated(self.result, interface) is Elimination.GLUED:
                self.glued.append(interface)
            else:
                raise refused(
                    f"interface {name!r} ties meshes that do not match inside the parts: solve with "
                    f"active=[{name!r}], which leaves its tractions to be known"
                )
            return
        if law.elimination is Elimination.LOAD:
            self._loaded(interface, law)
            return
        if not two and law.elimination is Elimination.REMOVED and interface.wrench is None:
            self._support(interface, law)
            return
        self.joints.append((interface, law))  # when all supports are known

    def add_load(self, load: PartLoad) -> None:
        """What a load of the scene exerts."""
        body = self.bodies[load.load.part]
        for parameter in load.load.values:
            number = load.mean(parameter, None)
            if number == 0.0:
                continue
            shape = load.load.shapes[parameter]
            if any(map(is_field, shape if isinstance(shape, tuple) else (shape,))):
                self.notes.append(f"{load.load.where}: {_SAMPLED}")
            if parameter in load.stresses:
                self._initial(body, load, parameter, number)
                continue
            found = traction_on(
                load.load, body.part, shape, lambda: OnFace(body, load.load.face, load.load.where)
            )
            if found is None:
                self._inside(body, load, parameter, number)
                continue
            self._exert(found[0], number * found[1], load.load.where)

    def _own_force(self, body: Body) -> None:
        """The constant body force of a part, told by its nodal forces."""
        nodal = body.part.load.reshape(body.u.shape)
        if not nodal.any():
            return
        force = nodal.sum(axis=0) / body.spread(np.ones(1)).sum()
        if np.abs(nodal - body.spread(force)).max() > SETTINGS.rounding * np.abs(nodal).max():
            raise refused(f"substructure {body.part.name!r}: its body force is not the same everywhere")
        body.force += force

    def _exert(self, face: OnFace, traction: Array, where: str) -> None:
        if face.misfit(traction) > SETTINGS.rounding:
            self.notes.append(f"{where}: its traction is no polynomial of the degree of the cells")
        face.exert(traction)

    def _initial(self, body: Body, load: PartLoad, parameter: str, number: float) -> None:
        """Stress of an initial strain, linear in each cell."""
        mesh = body.part.part.mesh
        points = np.vstack([body.corners, body.corners.mean(axis=0)])
        expression = fem.Expression(load.stresses[parameter], points)
        d, cells = body.part.dim, np.arange(len(body.dofs), dtype=np.int32)
        values = expression.eval(mesh, cells).reshape(len(cells), len(points), d, d)
        own = number * np.stack([values[..., i, j] for i, j in VOIGT[d]], axis=-1)
        linear = np.column_stack([np.ones(len(points)), points])
        bent = np.abs(own - np.einsum("ij,cjk->cik", linear @ np.linalg.pinv(linear), own)).max()
        if bent > SETTINGS.rounding * np.abs(own).max():
            self.notes.append(f"{load.load.where}: its stress is not linear in the cells")
        body.initial += own[:, :-1]

    def _inside(self, body: Body, load: PartLoad, parameter: str, number: float) -> None:
        """A force per volume, the same everywhere."""
        shape = load.load.shapes[parameter]
        if load.load.kind != "body_force" or not isinstance(shape, int):
            raise refused(f"{load.load.where}: a {load.load.kind} is no traction and no constant body force")
        body.force[:, shape] += number

    def _support(self, interface: Interface, law: Law) -> None:
        side = interface.sides[0]
        body = self.bodies[side.substructure]
        self.supports.append(interface)
        if law.elimination is Elimination.TIED:
            raise refused(f"interface {interface.name!r}: {law.title} ties its nodes to rigid motions")
        face = OnFace(body, side.face, f"interface {interface.name!r}")
        directions, values = law.constraint(interface.name, side, face.x)
        off = np.abs(face.shape @ body.u @ directions.T - values).max()
        if off > SETTINGS.rounding * np.abs(body.u).max(initial=0.0):
            self.notes.append(f"{interface.name!r} is not held as it should be between nodes")
        projector = directions.T @ directions
        face.exert(np.zeros_like(face.x), projector)
        body.held[np.unique(face.nodes)] += projector

    def _loaded(self, interface: Interface, law: Law) -> None:
        """A pressure or traction of a law."""
        side = interface.sides[0]
        body = self.bodies[side.substructure]
        face = OnFace(body, side.face, f"interface {interface.name!r}")
        axes, _ = frames(face.normals, None)
        points: Any = _Points(interface.name, face.x, face.weights, axes)
        traction = np.einsum("pij,pi->pj", axes, np.asarray(law.load(points)))
        self._exert(face, traction, f"interface {interface.name!r}")
        body.acting += face.forces(traction)

    def _joint(self, interface: Interface, law: Law, rests: bool) -> None:
        """Forces of a law, as tractions that exert the same at nodes; `rests`: supports hold its parts."""
        name, side = interface.name, interface.sides[0]
        alone = interface.wrench is not None  # a joint of mean motions: what it sees of a part is exact
        if len(interface.sides) == 2 and interface.matching is None and not alone:
            self.notes.append(f"{name!r} joins meshes that do not match")
        if interface.one_point and not alone:
            self.notes.append(f"{name!r} acts at a point")
        body = self.bodies[side.substructure]
        face = OnFace(body, side.face, f"interface {name!r}")
        traction = face.traction(self._nodal(interface, 0, body))
        presses = law.unilateral and not alone
        if presses:
            traction = self._contact(interface, law, face, traction, rests)
        elif law.springs and not alone:
            jump = face.shape @ self._jump(interface)
            gap, why = gap_of_springs(interface, law, face, face.pull @ traction, jump)
            self.gaps[name] = gap
            self.notes += [why] if why else []
        elif law.elimination is Elimination.GLUED and not alone:
            self._kept_glue(interface, law, face)
        elif not alone:
            self.notes.append(f"{name!r}: of its law {law.title} forces and jumps have no bound")
        self._pull(body, face, traction)
        for number, other in enumerate(interface.sides[1:], start=1):
            body = self.bodies[other.substructure]
            on = OnFace(body, other.face, f"interface {name!r}")
            if interface.matching is None:
                self._pull(body, on, on.traction(self._nodal(interface, number, body)))
                continue
            opposite = np.zeros_like(body.u)
            opposite[interface.matching[:, 1]] = -traction[interface.matching[:, 0]]
            self._pull(body, on, opposite)

    def _kept_glue(self, interface: Interface, law: Law, face: OnFace) -> None:
        """Glue that is iterated on holds means of the jump: whether it holds the jump itself."""
        imposed = np.ravel(law.fields(interface).parameters["jump"])[: interface.dim] @ interface.frames[0]
        off = np.abs(face.shape @ self._jump(interface) - imposed).max()
        moved = max(np.abs(self.bodies[side.substructure].u).max(initial=0.0) for side in interface.sides)
        if off > SETTINGS.rounding * moved:
            self.notes.append(f"{interface.name!r} is glued in the mean only: let the plan assemble it")

    def _nodal(self, interface: Interface, number: int, body: Body) -> Array:
        """Forces (nodes, d) of an interface on one of its sides."""
        return np.asarray(nodal_forces(self.result, interface, number)[self.step].reshape(body.u.shape))

    def _pull(self, body: Body, face: OnFace, traction: Array) -> None:
        """A traction (nodes, d) on a face."""
        values = face.pull @ traction
        face.exert(values)
        body.acting += face.forces(values)

    def _jump(self, interface: Interface) -> Array:
        """w2 - w1 (nodes, d) at the nodes of side 1."""
        one = self.bodies[interface.sides[0].substructure].u
        jump = -one
        if len(interface.sides) == 2 and interface.matching is not None:
            mine, theirs = interface.matching.T
            jump[mine] += self.bodies[interface.sides[1].substructure].u[theirs]
        return jump

    def _contact(
        self, interface: Interface, law: Law, face: OnFace, traction: Array, rests: bool
    ) -> Array:
        """The traction of contact (nodes, d) that never pulls, with its gap; what overlaps is lifted."""
        name = interface.name
        fields = law.fields(interface)
        given = [np.ravel(fields.parameters[each]) for each in ("gap", "jump", "compliance")]
        if not face.flat or any(np.ptp(each) > SETTINGS.rounding * np.abs(each).max() for each in given):
            self.notes.append(f"{name!r}: contact on a face that is not flat, or with a gap that varies")
            return traction
        start, imposed, compliance = (float(each[0]) for each in given)
        normal = face.normals[0]
        pressed = contact_pressure(face, traction @ normal, rests)
        if pressed is None:
            self.notes.append(f"no pressure of {name!r} that never pulls has its resultant")
            pressed = traction @ normal
        opening = self._jump(interface) @ normal + start - imposed
        if compliance == 0.0:
            inside = np.zeros_like(opening)
            nodes = np.unique(face.nodes)
            inside[nodes] = np.minimum(face.hull_of_jumps.coefficients(opening)[nodes], 0.0)
            if -inside.min(initial=0.0) > SETTINGS.rounding * np.abs(self._jump(interface)).max(initial=0.0):
                lift = -face.hull_of_jumps.values(inside)
                opening = opening + lift
                self._lift(interface, face, lift, normal)
        forces = face.pull @ pressed
        self.gaps[name] = gap_of_contact(face, forces, face.shape @ opening, compliance)
        whole = np.outer(pressed, normal)
        if law.rubs:
            along = traction - np.outer(traction @ normal, normal)
            whole += along
            self._rub(name, fields, face, forces, face.pull @ along, self._jump(interface))
        return whole

    def _rub(
        self, name: str, fields: Any, face: OnFace, forces: Array, traction: Array, jump: Array
    ) -> None:
        """Friction: Tresca's is bounded, of others and of slips before this step nothing is proven."""
        given = [np.ravel(fields.parameters.get(each, [0.0])) for each in ("friction", "threshold")]
        if any(np.ptp(each) > SETTINGS.rounding * np.abs(each).max() for each in given):
            self.notes.append(f"{name!r}: its friction varies")
            return
        friction, threshold = (float(each[0]) for each in given)
        moved = face.shape @ jump
        slip = moved - np.sum(moved * face.normals, axis=1, keepdims=True) * face.normals
        gap, holds = gap_of_friction(face, threshold - friction * forces, traction, slip)
        self.gaps[name] += gap
        tresca = friction == 0.0 and self.result.times is None and bool(np.all(forces < 0.0))
        if not (tresca and holds) or "tangential_compliance" in fields.parameters:
            self.notes.append(f"{name!r}: friction that depends on pressure, or has a history, has no bound")

    def _lift(self, interface: Interface, face: OnFace, lift: Array, normal: Array) -> None:
        """Move a side of contact out of the other one, by a length (nodes,) at nodes of side 1."""
        sides = interface.sides
        softer = min(range(len(sides)), key=lambda k: self.bodies[sides[k].substructure].part.modulus)
        body = self.bodies[sides[softer].substructure]
        nodes = np.unique(face.nodes)
        mine = nodes
        if softer == 1 and interface.matching is not None:
            at = {int(one): int(other) for one, other in interface.matching}
            mine = np.array([at[int(k)] for k in nodes])
        fixed = np.zeros(len(body.u), dtype=bool)
        joined = [each for each, _ in self.joints] + self.glued
        for other in joined:
            for side in other.sides if other is not interface else ():
                if side.substructure == body.part.name:
                    fixed[side.nodes] = True
        barred = np.einsum("i,nij,j->n", normal, body.held, normal) > SETTINGS.rounding
        if np.any(lift[nodes][(fixed | barred)[mine]] > SETTINGS.rounding * lift.max()):
            self.notes.append(f"{interface.name!r}: its faces are inside each other where another one begins")
        sign = 1.0 if softer == 1 else -1.0
        body.lifted += lifted(body, mine, sign * lift[nodes], normal, fixed)

    def _number(self) -> None:
        """Number the nodes of all parts: the same where parts are glued, and along a line across all of them.

        So like cells are cut alike, and both sides of an interface whose nodes match.
        """
        first = np.cumsum([0, *(len(body.u) for body in self.bodies.values())])
        self.own = {n: slice(a, b) for n, a, b in zip(self.bodies, first[:-1], first[1:], strict=True)}
        pairs: dict[bool, list[Array]] = {True: [], False: []}
        for interface in self.problem.interfaces.values():
            if len(interface.sides) == 2 and interface.matching is not None:
                starts = [self.own[side.substructure].start for side in interface.sides]
                glued = eliminated(self.result, interface) is Elimination.GLUED
                pairs[glued].append(interface.matching + np.array(starts))

        def joined(ties: list[Array]) -> Ints:
            flat = np.concatenate([np.zeros((0, 2), dtype=np.int64), *ties])
            graph = sp.coo_matrix((np.ones(len(flat)), flat.T), shape=(first[-1],) * 2)
            return np.asarray(sp.csgraph.connected_components(graph, directed=False)[1])

        places = np.concatenate([body.part.dof_coordinates for body in self.bodies.values()])
        together = joined(pairs[True] + pairs[False])
        along = np.zeros(int(together.max()) + 1)
        along[together] = places @ self._direction()
        rank = np.argsort(np.argsort(along))[together]
        key = np.stack([rank, joined(pairs[True])], axis=1)
        self.numbers = np.unique(key, axis=0, return_inverse=True)[1].ravel().astype(np.int64)
        for name, body in self.bodies.items():
            body.number(self.numbers[self.own[name]])

    def _direction(self) -> Array:
        """That of vertices with ascending numbers, along which cells are cut into the roundest simplices."""
        d = self.problem.dim
        signs = np.array(list(product([1.0, -1.0], repeat=d - 1)))
        every = [np.array(turned) * (1.0, *sign) for turned in permutations(_ACROSS[:d]) for sign in signs]
        cells = [body for body in self.bodies.values() if body.is_cut]
        some = [(body.cell, body.x[:: 1 + len(body.x) // SETTINGS.looked_at]) for body in cells]

        def length(direction: Array) -> float:
            found = 0.0
            for cell, x in some:
                local = cut(cell, np.argsort(np.argsort(x @ direction, axis=1), axis=1))
                corners = np.take_along_axis(x, local.reshape(len(x), -1)[..., None], axis=1)
                corners = corners.reshape(-1, d + 1, d)
                found += float(((corners - corners.mean(axis=1, keepdims=True)) ** 2).sum())
            return found

        lengths = np.array([length(each) for each in every])  # the first of equal ones, whatever is rounded
        best: Array = every[int(np.argmax(lengths <= lengths.min() * (1.0 + SETTINGS.rounding)))]
        return best

    def bound(self, began: float) -> EnergyBound:
        """The stress in balance, and its distance."""
        d, bodies = self.problem.dim, list(self.bodies.values())
        count = int(self.numbers.max()) + 1
        rigid = free_motions(
            {n: (part.centre, part.length) for n, part in self.problem.parts.items()},
            [held(self.problem, each) for each in (*self.supports, *self.glued)],
        )
        moving = {name for group in rigid.groups for name in group}
        for interface, law in self.joints:
            stop_if_pressed()
            self._joint(interface, law, all(side.substructure not in moving for side in interface.sides))
        motions = np.zeros((count, d, len(rigid)))
        for name, body in self.bodies.items():
            motions[body.numbers] = rigid.at(name, body.part.dof_coordinates)
        correct(bodies, count, np.linalg.qr(motions.reshape(count * d, -1)).Q)
        inputs = Inputs(d)
        for body, more in zip(bodies, between_cells(bodies), strict=True):
            inputs.add(body, more)
        stop_if_pressed()
        made = inputs.made(count)
        if not self.result.converged:
            self.notes.append("the answer has not converged")
        elif not made.defect * inputs.left() <= SETTINGS.rounding + self.result.error:
            self.notes.append(f"balance at nodes is off by {made.defect:.1g}")
        energies = made.relax(SETTINGS.sweeps, SETTINGS.enough)
        cells = dict(zip(self.bodies, inputs.by_cells(energies), strict=True))
        squares = {n: max(float(e.sum()), 0.0) + self.bodies[n].energy_of_change() for n, e in cells.items()}
        strain = sum(body.energy(body.u) for body in self.bodies.values())
        lift = np.sqrt(sum(body.energy(body.lifted) for body in self.bodies.values()))
        total = float(np.sqrt(sum(squares.values()) + sum(self.gaps.values())) + lift)
        parts = {n: float(np.sqrt(square)) for n, square in squares.items()}
        laws = {n: float(np.sqrt(max(gap, 0.0))) for n, gap in self.gaps.items()}
        whole = float(np.sqrt(max(strain, 0.0)))
        notes = tuple(dict.fromkeys(self.notes))
        return EnergyBound(total, whole, parts, laws, notes, perf_counter() - began, cells)
