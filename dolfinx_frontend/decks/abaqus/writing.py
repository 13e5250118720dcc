"""An assembled scene as a deck of CalculiX: the same meshes, laws and steps, to be checked with that program.

Loads are written as the forces on the nodes that they are here, supports by their nodes. Faces that meet node
for node and are glued get common nodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from dolfinx_frontend.assembly.elements import csr
from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.problem import Problem, check_is_problem
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.checks import checked_path, is_real
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.files import write_text
from dolfinx_frontend.common.groups import group_labels
from dolfinx_frontend.decks.abaqus.elements import listed
from dolfinx_frontend.decks.abaqus.meshed import Meshed
from dolfinx_frontend.scene.amplitudes import Varying, check_times
from dolfinx_frontend.scene.laws import Contact, Elastic, Held, Law, Perfect, Preload
from dolfinx_frontend.scene.laws.base import Elimination
from dolfinx_frontend.scene.laws.rigid import Rigid
from dolfinx_frontend.scene.loads import LoadTerm, is_field
from dolfinx_frontend.scene.materials import LinearElastic, OrthotropicElastic
from dolfinx_frontend.scene.values import evaluate, is_zero

__all__ = ["write_inp"]

STIFFER = 300.0
"""Of a rigid contact: its stiffness per area over E / size of a facet. What overlaps then is 1 / 300 of what
a cell gives way; a stiffer one costs iterations of CalculiX."""

STICK = 0.1
"""Of friction without an elastic slip: stick slope over contact stiffness, with which CalculiX takes fewest
iterations."""

REACH = 10.0
"""Distance, in facets, up to which nodes of a tie are looked for."""

ROUNDING = 1e-12
"""Of the largest coordinate, direction or force: what is 0 but for rounding."""

PARALLEL = 1e-9
"""Of unit directions: what is left of one that the others hold already."""


class _Deck:
    """Lines of a deck, and the numbers of its nodes."""

    def __init__(self, problem: Problem, times: Array | None) -> None:
        self.problem = problem
        self.times: Sequence[float | None] = [None] if times is None else [float(t) for t in times]
        planes = {n: _plane(s) for n, s in problem.substructures.items()}
        self.meshes = {n: Meshed.of(s, planes[n]) for n, s in problem.substructures.items()}
        ends = np.cumsum([0, *(len(m.x) for m in self.meshes.values())])
        self.start = {n: int(end) for n, end in zip(self.meshes, ends, strict=False)}
        self.x = np.concatenate([m.x for m in self.meshes.values()])
        self.x[np.abs(self.x) < ROUNDING * np.ptp(self.x, axis=0).max()] = 0.0
        self.count = len(self.x)
        self.node = self._merged(int(ends[-1]))
        cells = np.cumsum([1, *(len(m.elements) for m in self.meshes.values())])
        self.first_cell = {n: int(first) for n, first in zip(self.meshes, cells, strict=False)}
        self.heated = self._heated()
        self.extra: list[Array] = []
        self.model: list[str] = []
        self.steps: list[list[str]] = [[] for _ in self.times]
        self.held: list[str] = []
        self.given: list[list[str]] = [[] for _ in self.times]
        self.coming: list[list[str]] = [[] for _ in self.times]
        self.staying: list[list[str]] = [[] for _ in self.times]
        self.printed: list[str] = []
        self._surfaces: dict[tuple[str, str], str] = {}
        self._names: set[str] = set()
        self.rows: dict[int, list[tuple[Array, Array]]] = {}
        self.fixed: set[tuple[int, int]] = set()
        self.taken: set[tuple[int, int]] = set()

    # --- nodes and names ------------------------------------------------------------------------------
    def _merged(self, count: int) -> Ints:
        """Number of each node, counted from 1; those that are glued have one."""
        pairs = []
        for i in self.problem.interfaces.values():
            if _glued(i) and i.matching is not None:
                pairs.append(i.matching + [self.start[s.substructure] for s in i.sides])
        if not pairs:
            return np.arange(1, count + 1)
        _, first, group = np.unique(
            group_labels(count, np.concatenate(pairs)), return_index=True, return_inverse=True
        )
        return np.asarray(first[group] + 1)

    def _heated(self) -> dict[str, tuple[float, Array, list[LoadTerm]]]:
        """Part -> coefficient of expansion, temperature at the end of each step, and its terms."""
        found: dict[str, tuple[float, Array, list[LoadTerm]]] = {}
        for name, each in self.problem.loads.items():
            load = each.load
            if not each.stresses:
                continue
            alpha = load.shapes["dT"][1] if load.kind == "temperature" and "dT" in load.values else None
            if alpha is None or not is_real(alpha) or load.part in found:
                raise SceneError(
                    f"write_inp: load {name!r}, {load.kind} of {load.part!r}: in a deck a part has one "
                    "temperature, a number, and one coefficient of expansion; give such, or leave it out"
                )
            at = [load if t is None else load.at(t) for t in self.times]
            values = [sum(term.mean for term in one.terms("dT")) for one in at]
            found[load.part] = (float(alpha), np.array(values), each.keys())
        return found

    def temperatures(self) -> None:
        """What is heated, with all of its nodes."""
        if self.heated:
            self.model += ["*INITIAL CONDITIONS, TYPE=TEMPERATURE", "NALL, 0."]
        every = {n: self.nodes(n, np.arange(len(m.x))) for n, m in self.meshes.items()}
        for part, (_, values, _) in self.heated.items():
            name = self.node_set(f"T {part}", every[part])
            for step, value in zip(self.steps, values, strict=True):
                step += ["*TEMPERATURE", f"{name}, {value:.12g}"]
            for other, nodes in every.items():
                alike = other in self.heated and np.array_equal(values, self.heated[other][1])
                if other != part and not (alike or not values.any()) and np.isin(every[part], nodes).any():
                    raise SceneError(
                        f"write_inp: parts {part!r} and {other!r} share nodes and have different "
                        "temperatures, which are those of nodes in a deck: give their faces meshes that do "
                        "not match"
                    )

    def nodes(self, part: str, own: npt.ArrayLike) -> Ints:
        """Numbers of nodes of a part that belong to elements."""
        used = np.isin(own, self.meshes[part].elements)
        return np.asarray(self.node[self.start[part] + np.asarray(own)[used]])

    def point(self, x: Sequence[float] | Array) -> int:
        """A node of its own."""
        self.extra.append(np.pad(np.asarray(x, dtype=np.float64), (0, 3 - len(x))))
        return self.count + len(self.extra)

    def name(self, text: str) -> str:
        """A name of a set, a surface or a law."""
        base = "".join(c if c.isalnum() and c.isascii() else "_" for c in text).upper()[:60]
        name, number = base, 2
        while name in self._names:
            name, number = f"{base}_{number}", number + 1
        self._names.add(name)
        return name

    def surface(self, part: str, face: str) -> str:
        """A surface of faces of elements."""
        if (part, face) not in self._surfaces:
            self._surfaces[part, face] = name = self.name(f"S {part} {face}")
            first = self.first_cell[part]
            self.model += [f"*SURFACE, NAME={name}, TYPE=ELEMENT"]
            self.model += [f"{first + cell}, S{side}" for cell, side in self.meshes[part].faces(face)]
        return self._surfaces[part, face]

    def node_set(self, label: str, nodes: Ints) -> str:
        """A set of nodes."""
        name = self.name(label)
        self.model += [f"*NSET, NSET={name}", *_rows(np.unique(nodes))]
        return name

    # --- parts ----------------------------------------------------------------------------------------
    def parts(self) -> list[str]:
        """Nodes, elements and materials."""
        used = np.zeros(self.count, dtype=bool)
        blocks = []
        for part, mesh in self.meshes.items():
            rows = self.node[self.start[part] + mesh.elements]
            used[rows - 1] = True
            name = self.name(f"E {part}")
            first = self.first_cell[part]
            blocks += [f"*ELEMENT, TYPE={mesh.kind}, ELSET={name}"]
            for k, row in enumerate(listed(rows), start=first):
                words = [str(k), *map(str, row)]
                lines = [", ".join(words[j : j + 12]) for j in range(0, len(words), 12)]
                blocks += [",\n".join(lines)]
            alpha = self.heated[part][0] if part in self.heated else None
            blocks += _material(self.problem.substructures[part], name, alpha)
        out = ["*NODE, NSET=NALL"]
        out += [f"{n + 1}, {_numbers(self.x[n])}" for n in np.flatnonzero(used)]
        return out + blocks

    # --- supports and loads ---------------------------------------------------------------------------
    def supports(self) -> None:
        """What interfaces with one side prescribe."""
        for i in self.problem.interfaces.values():
            if i.law.elimination is Elimination.REMOVED:
                x, nodes = self._held_by(i)
                found = [_at(i.law, t).constraint(i.name, i.sides[0], x) for t in self.times]
                moved = np.stack([v for _, v in found])  # (steps, nodes, r)
                for k, held in enumerate(listed(nodes)):
                    self.rows.setdefault(held, []).append((found[0][0], moved[:, k]))
        kept: dict[bytes, tuple[list[int], Array, Array]] = {}
        for node, given in sorted(self.rows.items()):
            directions = np.concatenate([each for each, _ in given])
            values: Array = np.concatenate([each for _, each in given], axis=1)
            key = directions.tobytes()
            if key not in kept:
                kept[key] = _reduced(directions)
            pivots, rows, by = kept[key]
            for k, pivot in enumerate(pivots):
                self._support(node, pivot, rows[k], values @ by[k])

    def _held_by(self, i: Interface) -> tuple[Array, Ints]:
        """Places and numbers of the nodes of a support, whose reaction is printed."""
        side = i.sides[0]
        own = side.nodes[np.isin(side.nodes, self.meshes[side.substructure].elements)]
        nodes = self.nodes(side.substructure, own)
        self.printed.append(self.node_set(f"N {i.name}", nodes))
        return self.problem.substructures[side.substructure].dof_coordinates[own], nodes

    def passing(self) -> None:
        """Supports that come and go."""
        for i in self.problem.interfaces.values():
            if not isinstance(i.law, Held):
                continue
            (x, nodes), released = self._held_by(i), False
            for k, t in enumerate(self.times):
                if i.law.controlled(t):
                    released = True
                    continue
                directions, values = _at(i.law, t).constraint(i.name, i.sides[0], x)
                kept = _one(i, _at(i.law, t), "kept") if released else 0.0
                if kept not in (0.0, 1.0) or (kept and isinstance(i.law.value, Varying)):
                    raise _refused(i, f"kept = {kept:g} at t = {t:g}; in a deck 0, or 1 without a change")
                if np.count_nonzero(np.abs(directions) > ROUNDING) > len(directions):
                    raise _refused(i, "its axes are oblique; in a deck equations last")
                lines = (self.staying if kept else self.coming)[k]
                axes = listed(np.abs(directions).argmax(axis=1) + 1)
                along = listed(values * directions.sum(axis=1))  # an axis may point backwards
                for node, row in zip(listed(nodes), along, strict=True):
                    free = [(axis, v) for axis, v in zip(axes, row) if (node, axis) not in self.fixed]
                    lines += [f"{node}, {axis}, {axis}, {value:.12g}" for axis, value in free]

    def _support(self, node: int, pivot: int, row: Array, values: Array) -> None:
        """row . displacement = values (steps,); the entry at the pivot is 1."""
        axes = np.flatnonzero(np.abs(row) > ROUNDING)
        if len(axes) == 1:
            self._give(node, int(axes[0]) + 1, values)
            return
        terms = [(node, int(k) + 1, float(row[k])) for k in (pivot, *axes[axes != pivot])]
        if np.any(values):
            other = self.point(np.zeros(3))
            self._give(other, 1, values)
            terms.append((other, 1, -1.0))
        self._equation(terms)

    def _equation(self, terms: Sequence[tuple[int, int, float]]) -> None:
        """Node, axis and factor; what the first one is follows from the others."""
        self.taken.add(terms[0][:2])
        self.model += ["*EQUATION", str(len(terms)), *(f"{n}, {axis}, {c:.12g}" for n, axis, c in terms)]

    def _give(self, node: int, axis: int, values: Array) -> None:
        """A displacement of a node at the end of each step."""
        self.taken.add((node, axis))
        self.fixed.add((node, axis))
        for lines, value in zip(self.given if np.any(values) else [self.held], values, strict=False):
            lines.append(f"{node}, {axis}, {axis}, {value:.12g}")

    def loads(self) -> None:
        """Forces on nodes at the end of each step."""
        forces = np.zeros((len(self.times), self.count, 3))
        d = self.problem.dim
        amplitudes = dict.fromkeys(self.problem.load_amplitudes)
        hot = [term for _, _, terms in self.heated.values() for term in terms]
        for k, t in enumerate(self.times):
            for part, mesh in self.meshes.items():
                total = self.problem.load_on(part, without=hot).copy()
                for a in amplitudes:
                    total += (1.0 if t is None else a(t)) * self.problem.load_on(part, a, hot)
                for i in self.problem.interfaces.values():
                    side = i.sides[0]
                    if i.law.elimination is Elimination.LOAD and side.substructure == part:
                        local = np.asarray(_at(i.law, t).load(i, t))
                        acting = np.einsum("pij,pi->pj", i.frames, local) * i.weights[:, None]
                        total += csr(side.trace).T @ acting.ravel()
                nodal = mesh.restriction @ total.reshape(-1, d)
                np.add.at(forces[k], self.node[self.start[part] + np.arange(len(nodal))] - 1,
                          np.pad(nodal, ((0, 0), (0, 3 - d))))
        largest = np.abs(forces).max()
        acting_on = listed(np.argwhere(np.any(np.abs(forces) > ROUNDING * largest, axis=0)))
        for k, step in enumerate(self.steps if acting_on else []):
            step += ["*CLOAD", *(f"{n + 1}, {axis + 1}, {forces[k, n, axis]:.12g}" for n, axis in acting_on)]

    # --- joints ---------------------------------------------------------------------------------------
    def joints(self) -> None:
        """Interfaces with two sides, and rigid bodies."""
        bodies: dict[str, list[tuple[Interface, Rigid]]] = {}
        for i in self.problem.interfaces.values():
            law = i.law
            if law.elimination in (Elimination.REMOVED, Elimination.LOAD) and len(i.sides) == 1:
                continue
            if isinstance(law, Rigid) and not law.plane:
                bodies.setdefault(law.group, []).append((i, law))
            elif isinstance(law, Held):
                continue
            elif i.one_point or len(i.sides) == 1:
                raise _refused(i, "CalculiX has no such element here; mesh it, or leave it out")
            elif isinstance(law, Preload):
                self._bolt(i, law)
            elif isinstance(law, Perfect) and not is_zero(law.jump):
                self._shortened(self._section(i), [-_one(i, _at(law, t), "jump") for t in self.times])
            elif isinstance(law, Perfect):
                if not _glued(i):
                    self._tie(i)
            elif isinstance(law, (Contact, Elastic)):
                self._contact(i, law)
            else:
                raise _refused(i, "CalculiX has no such law; replace it or leave it out")
        for group, faces in bodies.items():
            self._body(group, faces)

    def _tie(self, i: Interface) -> None:
        reach = REACH * max(self.meshes[s.substructure].size(s.face) for s in i.sides)
        name = self.name(i.name)
        self.model += [f"*TIE, NAME={name}, POSITION TOLERANCE={reach:.12g}, ADJUST=NO", self._sides(i)]

    def _sides(self, i: Interface) -> str:
        return ", ".join(self.surface(s.substructure, s.face) for s in i.sides)

    def _contact(self, i: Interface, law: Contact | Elastic) -> None:
        size = min(self.meshes[s.substructure].size(s.face) for s in i.sides)
        modulus = max(self.problem.parts[s.substructure].modulus for s in i.sides)
        if isinstance(law, Elastic):
            if law.tangential is None or law.normal is None or not is_zero(law.jump):
                raise _refused(i, "tied contact has a normal and a tangential stiffness and no jump")
            area = i.area if law.total else 1.0
            kind, normal, stick = "TIED", _one(i, law, "normal") / area, _one(i, law, "tangential") / area
            friction = 1.0
        else:
            if not is_zero(law.jump) or not is_zero(law.threshold):
                raise _refused(i, "contact of a deck has no jump and no threshold; leave them out")
            kind = "LINEAR"
            normal = _one(i, law, "stiffness", STIFFER * modulus / size)
            stick = _one(i, law, "tangential_stiffness", STICK * normal)
            friction = _one(i, law, "friction", 0.0)
        name = self.name(f"I {i.name}")
        self.model += [f"*SURFACE INTERACTION, NAME={name}"]
        self.model += [f"*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE={kind}", f"{normal:.12g}"]
        if friction > 0.0:
            self.model += ["*FRICTION", f"{friction:.12g}, {stick:.12g}"]
        sides = self._sides(i)
        self.model += [f"*CONTACT PAIR, INTERACTION={name}, TYPE=SURFACE TO SURFACE", sides]
        gap = _one(i, law, "gap") if isinstance(law, Contact) and law.gap is not None else None
        if i.apart and gap is None:
            gap = 0.0
        if gap is not None:
            slave, master = sides.split(", ")
            self.model += [f"*CLEARANCE, MASTER={master}, SLAVE={slave}, VALUE={gap:.12g}"]

    def _section(self, i: Interface) -> int:
        """A node by whose displacement the nodes of two sides are nearer to each other, along the normal: as
        a pre-tension section has it, which CalculiX cuts through whole layers of elements only."""
        if i.matching is None:
            raise _refused(i, "the two sides of the section do not meet node for node; mesh them alike")
        node, normal = self.point(i.points.mean(axis=0)), i.sides[0].normal
        starts = [self.start[s.substructure] for s in i.sides]
        first, second = (self.node[start + i.matching[:, k]] for k, start in enumerate(starts))
        for here, there in zip(listed(first), listed(second), strict=True):
            for axis, n in enumerate(normal, start=1):
                self._follow(i, (there, axis), (here, axis), (node, float(n)))
        self.printed.append(self.node_set(f"N {i.name}", first))  # of its own node CalculiX prints no force
        return node

    def _shortened(self, node: int, lengths: Sequence[float]) -> None:
        """A section that is shortened by a length at the end of each step."""
        for given, length in zip(self.given, lengths, strict=True):
            given.append(f"{node}, 1, 1, {length:.12g}")

    def _bolt(self, i: Interface, law: Preload) -> None:
        by_force = law.force is not None or law.torque is not None
        if law.stiffness is not None or law.embedding is not None or (
            by_force and (law.shortening is not None or law.angle is not None)
        ):
            raise _refused(i, "a section of a deck has a force or a length, and nothing in series")
        node = self._section(i)
        if not by_force:
            self._shortened(node, [_at(law, t).shortened() for t in self.times])
            return
        locked = False
        for t, step in zip(self.times, self.steps, strict=True):
            if law.controlled(t):
                if locked:
                    raise _refused(i, "a deck cannot tighten a bolt again that was fixed; give one interval")
                force = np.asarray(_at(law, t).load(i, t))
                step += ["*CLOAD", f"{node}, 1, {float(i.weights @ force[:, 0]):.12g}"]
            else:
                step += [] if locked else ["*BOUNDARY, FIXED", f"{node}, 1, 1"]
                locked = True

    def _follow(
        self, i: Interface, one: tuple[int, int], two: tuple[int, int], by: tuple[int, float]
    ) -> None:
        """one + by - two = 0, for displacements (node, axis) of which one may be held."""
        node, n = by
        terms = [(*one, 1.0), (*two, -1.0), *([(node, 1, n)] if abs(n) > ROUNDING else [])]
        free = [each for each in terms[:2] if each[:2] not in self.taken]
        if free:
            self._equation([free[0], *(each for each in terms if each is not free[0])])
        elif not {one, two} <= self.fixed or abs(n) > ROUNDING:
            raise _refused(i, "nodes of the section are held on both sides; leave them free there")

    def _body(self, group: str, faces: list[tuple[Interface, Rigid]]) -> None:
        nodes = np.concatenate([self.nodes(i.sides[0].substructure, i.sides[0].nodes) for i, _ in faces])
        law = next(each for _, each in faces if each.leads)
        x = self.x[np.unique(nodes) - 1].mean(axis=0) if law.point is None else law.point
        reference, turning = self.point(x), self.point(x)
        name = self.node_set(f"N {group}", nodes)
        self.model += [f"*RIGID BODY, NSET={name}, REF NODE={reference}, ROT NODE={turning}"]
        for motion in law.parameters():
            values = np.array([_at(law, t).motions()[motion] for t in self.times])
            self._give(turning if motion[0] == "r" else reference, "xyz".index(motion[-1]) + 1, values)
        if law.parameters():
            self.printed.append(self.node_set(f"N {group} at", np.array([reference])))

    # --- all of it ------------------------------------------------------------------------------------
    def text(self, title: str) -> str:
        """The whole deck."""
        parts = self.parts()
        self.supports()
        self.passing()
        self.joints()
        self.loads()
        self.temperatures()
        points = [f"{self.count + k}, {_numbers(x)}" for k, x in enumerate(self.extra, start=1)]
        out = ["*HEADING", title, *parts, *_card("*NODE", points), *self.model]
        out += _card("*BOUNDARY", self.held)
        before, passing = 0.0, any(map(any, (self.coming, self.staying)))
        of_steps = zip(self.times, self.steps, self.given, self.coming, self.staying, strict=True)
        for t, step, given, coming, staying in of_steps:
            length = 1.0 if t is None or t <= before else t - before
            before = before if t is None else t
            out += ["*STEP, INC=1000", "*STATIC", f"{length:.12g}, {length:.12g}"]
            if passing:
                out += ["*BOUNDARY, OP=NEW", *self.held, *given, *coming]
                out += [*_card("*BOUNDARY, OP=NEW, FIXED", staying), *step]
            else:
                out += [*_card("*BOUNDARY", given), *step]
            for name in self.printed:
                out += [f"*NODE PRINT, NSET={name}, TOTALS=ONLY", "RF"]
            out += ["*NODE FILE", "U", "*EL FILE", "S", "*END STEP"]
        return "\n".join(out) + "\n"


Of = TypeVar("Of", bound=Law)


def _at(law: Of, time: float | None) -> Of:
    """The law at a time; None: it does not change."""
    return law if time is None else law.at(time)


def _glued(interface: Interface) -> bool:
    """Whether its nodes are the same ones."""
    law = interface.law
    return isinstance(law, Perfect) and is_zero(law.jump) and interface.matching is not None


def _refused(interface: Interface, remedy: str) -> SceneError:
    return SceneError(f"write_inp: interface {interface.name!r}, {interface.law.title}: {remedy}")


def _one(interface: Interface, law: Any, name: str, default: float | None = None) -> float:
    """A value that is the same everywhere, of a random one the mean; `default` where None is given."""
    value = getattr(law, name)
    value = default if value is None else value
    if is_field(value) or np.ndim(value):
        raise _refused(interface, f"{name} = {short(value)} is not one number, as a deck has; give one")
    return float(evaluate(value, np.zeros((1, 1)), 1, f"interface {interface.name!r}, {name}")[0, 0])


def _numbers(values: npt.ArrayLike) -> str:
    return ", ".join(f"{v:.12g}" for v in listed(np.asarray(values, dtype=np.float64)))


def _card(keyword: str, lines: list[str]) -> list[str]:
    """A card; without lines none."""
    return [keyword, *lines] if lines else []


def _rows(numbers: Ints) -> list[str]:
    """Whole numbers, some on a line."""
    return [", ".join(map(str, listed(numbers[k : k + 12]))) for k in range(0, len(numbers), 12)]


def _reduced(directions: Array) -> tuple[list[int], Array, Array]:
    """Rows (r, 3) with the places where each has a 1 and all others 0, and what makes them of directions."""
    count, d = directions.shape
    rows = np.hstack([directions, np.zeros((count, 3 - d)), np.eye(count)])
    pivots: list[int] = []
    while len(pivots) < min(count, 3):
        rank = len(pivots)
        left = np.abs(rows[rank:, :3])
        if left.max() < PARALLEL:
            break
        k, pivot = divmod(int(left.argmax()), 3)
        rows[[rank, rank + k]] = rows[[rank + k, rank]]
        rows[rank] /= rows[rank, pivot]
        others = np.arange(count) != rank
        rows[others] -= np.outer(rows[others, pivot], rows[rank])
        rows[others, pivot] = 0.0
        pivots.append(pivot)
    return pivots, rows[: len(pivots), :3], rows[: len(pivots), 3:]


def _plane(part: Any) -> str:
    """What a deck calls the plane of a part; empty: it is in space."""
    if part.dim == 3:
        return ""
    return "axisymmetric" if part.around else str(getattr(part.material, "plane", "strain"))


def _material(part: Any, elements: str, alpha: float | None) -> list[str]:
    """The cards of a material and its section."""
    law, where = part.material, f"write_inp: substructure {part.name!r}"
    name = elements.replace("E_", "M_", 1)
    section = f"*SOLID SECTION, ELSET={elements}, MATERIAL={name}"
    last = [*([] if alpha is None else ["*EXPANSION", f"{alpha:.12g}"]), section]
    last += ["1."] if part.dim == 2 and not part.around else []
    if isinstance(law, LinearElastic) and is_real(law.E) and is_real(law.nu):
        return [f"*MATERIAL, NAME={name}", "*ELASTIC", _numbers([law.E, law.nu]), *last]
    if isinstance(law, OrthotropicElastic) and part.dim == 3 and not callable(law.axes):
        constants = np.concatenate([law.E, np.atleast_1d(law.nu), np.atleast_1d(law.G)])
        axes = np.eye(3) if law.axes is None else np.asarray(law.axes)
        turned = elements.replace("E_", "O_", 1)
        return [
            f"*MATERIAL, NAME={name}", "*ELASTIC, TYPE=ENGINEERING CONSTANTS", _numbers(constants[:8]),
            f"{_numbers(constants[8:])}, 0.", *last[:-1], f"*ORIENTATION, NAME={turned}",
            _numbers(axes[:2].ravel()), f"{section}, ORIENTATION={turned}",
        ]
    raise SceneError(f"{where}: {short(law)} has no cards; give LinearElastic of numbers, or in 3D "
                     "OrthotropicElastic")


def write_inp(problem: Problem, path: str | Path, times: npt.ArrayLike | None = None) -> None:
    """Write an assembled scene as a deck for CalculiX (``.inp``), to check an answer with that program.

    It has the same nodes, loads as forces on these, and random values at their means. Rigid contact becomes a
    stiff one, cells of 27 nodes become elements of 20: displacements and reactions agree to that.

    Parameters
    ----------
    problem
        The assembled scene, on one rank.
    path
        The file, ``"joint.inp"``.
    times
        (T,), as for :func:`solve`: a step of the deck ends at each; None: there is one step.

    Raises
    ------
    SceneError
        What a deck of CalculiX cannot hold, by the name of the part or interface.

    Examples
    --------
    >>> write_inp(assemble(scene), "joint.inp", times=[1.0, 2.0])
    """
    check_is_problem("write_inp", problem)
    file = checked_path("write_inp", path, new=True)
    if problem.comm is not None:
        raise SceneError("write_inp: the problem is on several ranks: assemble it on one")
    deck = _Deck(problem, None if times is None else check_times(times))
    write_text(file, deck.text("by latin-core"))
