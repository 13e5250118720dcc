"""Supports, forces, pressures, body forces and temperatures of a deck, put into a scene."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from dolfinx import fem, geometry
from dolfinx import mesh as dmesh
from scipy.spatial import cKDTree

from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.compat import coordinate_map
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.decks.abaqus.cards import placed
from dolfinx_frontend.decks.abaqus.elements import listed
from dolfinx_frontend.decks.abaqus.faces import Faces
from dolfinx_frontend.decks.abaqus.history import DIGITS, Curve, Given, History, Hold, combined
from dolfinx_frontend.decks.abaqus.links import Links, unused
from dolfinx_frontend.decks.abaqus.materials import thickness_of
from dolfinx_frontend.decks.abaqus.pieces import Mesh, Pairs, Piece
from dolfinx_frontend.scene.amplitudes import Amplitude, Varying
from dolfinx_frontend.scene.scene import Scene

__all__ = ["Loads"]

_NEAR = 1e-6
"""Distance, relative to the part, within which a point is a node."""

_VARIES = -2
"""In place of the number of a support, less the first one that comes and goes alike: the nodes of a face have
several values."""


class Nodal:
    """Values at the nodes of a part as a function of points: what its cells make of them."""

    def __init__(self, mesh: dmesh.Mesh, x: Array, values: Array) -> None:
        size = float(np.ptp(x, axis=0).max())
        tree, d = cKDTree(x), x.shape[1]

        def at(points: Array) -> Array:
            away, row = tree.query(points[:d].T)
            assert away.max(initial=0.0) <= _NEAR * size
            return np.asarray(values[row].T)

        order = int(coordinate_map(mesh).degree)
        self._field = fem.Function(fem.functionspace(mesh, ("Lagrange", order, (values.shape[1],))))
        self._field.interpolate(at)
        self._tree = geometry.bb_tree(mesh, mesh.topology.dim, padding=_NEAR * size)
        self._mesh = mesh

    def __call__(self, x: Array) -> Array:
        points = np.zeros((len(x), 3))
        points[:, : x.shape[1]] = x
        candidates = geometry.compute_collisions_points(self._tree, points)
        inside = geometry.compute_colliding_cells(self._mesh, candidates, points)
        cells = np.empty(len(x), dtype=np.int32)
        for k in range(len(x)):
            found = inside.links(k) if len(inside.links(k)) else candidates.links(k)
            if not len(found):
                raise SceneError("the values of a deck are asked for outside of its part: keep its meshes")
            cells[k] = found[0]
        return np.reshape(self._field.eval(points, cells), (len(x), -1))


class Loads:
    """All that acts on the pieces of a deck."""

    def __init__(self, mesh: Mesh, history: History, faces: Faces, links: Links) -> None:
        self.mesh, self.history, self.faces, self.links = mesh, history, faces, links
        self.model = mesh.model
        self.dim = mesh.pieces[0].kind.dim
        self._pressures: list[tuple[Curve, Given, int]] = []
        self._supports: list[tuple[int, str, tuple[int, ...], Hold, Given, Array]] = []
        self._points: list[tuple[int, int, tuple[int, ...], Hold, Given, Array]] = []
        self._used: set[str] = set()
        self._held = np.full((0, 3), -1, dtype=np.int64)
        self._holds: list[Hold] = []
        self._timing: Ints = np.zeros(0, dtype=np.int64)
        self._givers: dict[int, Given] = {}

    # --- faces that are needed --------------------------------------------------------------------
    def ask(self) -> None:
        """Ask for the faces of pressures."""
        groups: dict[tuple[int, Curve, str], Pairs] = {}
        for key, curve in self.history.curves.items():
            if key[0] != "p" or not any(v for _, v in curve):
                continue
            given = self.history.given[key]
            if not self.mesh.outside((key[1], key[2])):
                raise given.error("a pressure on a face inside of a part; give outer faces")
            p = int(self.mesh.of_element[key[1]])
            groups.setdefault((p, curve, given.target), []).append((key[1], key[2]))
        for (p, curve, target), pairs in groups.items():
            given = self.history.given["p", *pairs[0]]
            self._pressures.append((curve, given, self.faces.ask(target, {p: pairs})))

    def divide(self) -> None:
        """Make faces of the nodes that are held, outside of those that joints and pressures have."""
        number: dict[Hold, int] = {}
        self._held = np.full((len(self.model.x), 3), -1, dtype=np.int64)
        for key in self.history.curves:
            if key[0] != "u" or key[1] in self.history.references or key[2] > self.dim:
                continue
            hold = self.history.hold(key)
            self._held[key[1], key[2] - 1] = number.setdefault(hold, len(number))
            self._givers[key[1]] = self.history.given[key]
        self._holds = list(number)
        timings = [hold[1:] for hold in self._holds]
        self._timing = np.array([timings.index(each) for each in timings], dtype=np.int64)
        taken = self.faces.taken()
        for p, piece in enumerate(self.mesh.pieces):
            held = [n for n in listed(piece.nodes) if n in self._givers]
            if not held:
                continue
            covered = self._held_faces(p, piece, taken)
            for node in held:
                self._held_point(p, node, covered)
            self._held_middles(p, piece, covered)

    def _axes(self, node: int, like: int | None = None) -> Array:
        """Directions (dim, dim) of the components of a node; of one that was added, as of another."""
        own = self.model.transforms.get(node if like is None else like)
        rows: Array = np.eye(3) if own is None else own.at(self.mesh.x[node])
        return rows[: self.dim, : self.dim]

    def _held_faces(self, p: int, piece: Piece, taken: set[tuple[int, int]]) -> dict[int, set[int]]:
        """Faces of which all nodes are held along one direction; returns the components held at each node."""
        count = len(self._held)
        clamps = (not h.during and not any(v for _, v in h.curve) for h in self._holds)
        rest = next((k for k, clamps_it in enumerate(clamps) if clamps_it), -1)
        groups: dict[tuple[tuple[int, ...], tuple[float, ...]], Pairs] = {}
        for side in piece.exterior:
            if side in taken:
                continue
            nodes = [n for n in self.mesh.face(side) if n < count]
            found = self._held[nodes]
            alike, key = np.ones(3, dtype=bool), ()
            clamped = rest >= 0 and (found[:, : self.dim] == rest).all()  # along any axes
            if not clamped and any(n in self.model.transforms for n in nodes):
                every = np.array([self._axes(n) for n in nodes])
                alike = np.abs(every - every[0]).max(axis=(0, 2)) < _NEAR
                key = tuple(listed(np.round(every[0].ravel(), 12)))
            timing = np.append(self._timing, -1)[found]
            varies = np.where((timing != timing[0]).any(axis=0), -1, _VARIES - timing[0])
            own = np.where((found != found[0]).any(axis=0), varies, found[0])
            signature = tuple(listed(np.where((found >= 0).all(axis=0) & np.resize(alike, 3), own, -1)))
            if any(s != -1 for s in signature):
                groups.setdefault((signature, key), []).append(side)
        covered: dict[int, set[int]] = {}
        for (signature, _), pairs in groups.items():
            on = [n for side in pairs for n in (*self.mesh.face(side), *self.mesh.between(side))]
            label = Counter(self._givers[n].target for n in on if n < count).most_common(1)[0][0]
            given = next(self._givers[n] for n in on if n < count and self._givers[n].target == label)
            name = self.faces.add(p, label, pairs)
            for n in on:
                covered.setdefault(n, set()).update(c for c in range(3) if signature[c] != -1)
            axes = self._axes(on[0])
            for s, components in _alike(signature).items():
                hold = self._holds[s] if s >= 0 else self._holds[_VARIES - s]._replace(curve=())
                self._supports.append((p, name, components, hold, given, axes))
        return covered

    def _held_middles(self, p: int, piece: Piece, covered: Mapping[int, set[int]]) -> None:
        """Hold the nodes that displacements have between those that are held, but by no support of a face."""
        found = {n: own for side in piece.exterior for n, own in self.mesh.between(side).items()}
        for node, shares in found.items():
            parents = list(shares)
            if not all(n in self._givers for n in parents):
                continue
            held = self._held[parents]
            for c in np.flatnonzero((held >= 0).all(axis=0)):
                holds = [self._holds[k] for k in held[:, c]]
                hold = holds[0] if len(set(holds)) == 1 else _between(list(shares.values()), holds)
                if hold is not None and c not in covered.get(node, ()):
                    axes = self._axes(node, parents[0])
                    self._points.append((p, node, (int(c),), hold, self._givers[parents[0]], axes))

    def _held_point(self, p: int, node: int, covered: Mapping[int, set[int]]) -> None:
        done, given = covered.get(node, set()), self._givers[node]
        rest = tuple(-1 if c in done else s for c, s in enumerate(listed(self._held[node])))
        for s, components in _alike(rest).items():
            self._points.append((p, node, components, self._holds[s], given, self._axes(node)))

    def _nodal(self, scene: Scene, piece: Piece, curves: Mapping[int, tuple[Curve, ...]], count: int) -> Any:
        """A field of some components, of node -> curves: a function of the points, or a sum of amplitudes
        times some."""
        history, rest = self.history, (((0.0, 0.0),),) * count
        total = len(self.model.x)
        own = {n: curves.get(n, rest) for n in listed(piece.nodes[piece.nodes < total])}
        distinct = {curve for each in own.values() for curve in each}
        times = sorted({t for curve in distinct for t, _ in curve})
        if history.static:
            times = times[-1:]
        mesh, x = scene.substructures[piece.name].part.mesh, self.mesh.x[piece.nodes][:, : self.dim]
        terms: list[tuple[Amplitude, Nodal]] = []
        for k, t in enumerate(times):
            at = {curve: float(np.interp(t, *np.array(curve).T)) for curve in distinct}
            values = np.zeros((total, count))
            for n, each in own.items():
                values[n] = [at[curve] for curve in each]
            field = Nodal(mesh, x, self.mesh.extended(values)[piece.nodes])
            if len(times) == 1:
                return field
            near = range(max(k - 1, 0), min(k + 2, len(times)))
            terms.append((Amplitude([times[j] for j in near], [float(j == k) for j in near]), field))
        return Varying(tuple(terms))

    def _timed(self, hold: Hold) -> tuple[Any, Any]:
        """When a support holds, and what of the way to its value is left, as a scene takes them."""
        return (hold.during, self.history.value(hold.kept)) if hold.during else (None, 0.0)

    # --- into a scene ---------------------------------------------------------------------------------
    def _name(self, label: str) -> str:
        return unused(label, self._used)

    def put(self, scene: Scene, densities: Mapping[str, float], alphas: Mapping[str, Any]) -> None:
        """Add all to a scene that has the parts and the joints."""
        self._used = set(scene.interfaces) | set(scene.loads)
        zero: Curve = ((0.0, 0.0),)
        by_node: dict[int, tuple[Curve, ...]] = {
            n: tuple(self._holds[k].curve if k >= 0 else zero for k in listed(self._held[n, : self.dim]))
            for n in self._givers
        }
        for p, name, components, hold, given, axes in self._supports:
            with placed(given.row.where, given.card.keyword):
                value = (
                    self.history.value(hold.curve) if hold.curve
                    else self._nodal(scene, self.mesh.pieces[p], by_node, self.dim)
                )
                own = self._name(name), _unless_global(axes), *self._timed(hold)
                scene.fix(self.faces.text(p, name), value, components, *own)
        for p, node, components, hold, given, axes in self._points:
            x = listed(self.mesh.x[node, : self.dim])
            with placed(given.row.where, given.card.keyword):
                value = self.history.value(hold.curve)
                part, name = self.mesh.pieces[p].name, self._name(f"{given.target} node")
                timed = self._timed(hold)
                scene.fix_point(part, x, value, components, name, _unless_global(axes), False, *timed)
        for curve, given, asked in self._pressures:
            for p, face, _ in self.faces.named(asked):
                with placed(given.row.where, given.card.keyword):
                    value = self.history.value(curve) * thickness_of(self.mesh.pieces[p])
                    scene.pressure(self.faces.text(p, face), value, self._name(f"pressure {given.target}"))
        self._forces(scene)
        self._body_forces(scene, densities)
        self._temperatures(scene, alphas)

    def _forces(self, scene: Scene) -> None:
        by_node: dict[int, dict[int, Curve]] = {}
        givers: dict[int, Given] = {}
        for key, curve in self.history.curves.items():
            if key[0] == "f" and key[1] not in self.links.others and any(v for _, v in curve):
                by_node.setdefault(key[1], {})[key[2]] = curve
                givers[key[1]] = self.history.given[key]
        groups: dict[tuple[int, str, Curve], dict[int, Array]] = {}
        first: dict[int, Given] = {}
        for node, curves, given in self.links.forces(by_node, givers):
            if max(curves) > self.dim:
                raise given.error(f"component {max(curves)} of a node of a solid; give forces along axes")
            first[node] = given
            of_set = "" if given.target.rpartition(".")[2].isdigit() else given.target
            for component, curve in curves.items():
                most = max((v for _, v in curve), key=abs)
                if most:  # what grows alike on one set, or on single nodes, is one load
                    alike = tuple((t, round(v / most, DIGITS)) for t, v in curve)
                    group = groups.setdefault((self.mesh.pieces_of_node[node][0], of_set, alike), {})
                    group.setdefault(node, np.zeros(self.dim))[component - 1] += most
        for (p, of_set, curve), forces in groups.items():
            nodes, given = list(forces), first[next(iter(forces))]
            label = of_set or ("of nodes" if len({first[n].target for n in nodes}) > 1 else given.target)
            with placed(given.row.where, given.card.keyword):
                x, name = self.mesh.x[nodes, : self.dim], self._name(f"force {label}")
                every, value = np.array(list(forces.values())), self.history.value(curve)
                scene.point_force(self.mesh.pieces[p].name, x, every, name, value)

    def _body_forces(self, scene: Scene, densities: Mapping[str, float]) -> None:
        groups: dict[tuple[Any, ...], set[int]] = {}
        for key, curve in self.history.curves.items():
            if key[0] == "b" and any(v for _, v in curve):
                p = int(self.mesh.of_element[key[3]])
                groups.setdefault((p, key[1], key[2], curve), set()).add(key[3])
        for (p, label, axis, curve), members in groups.items():
            piece = self.mesh.pieces[p]
            given = self.history.given["b", label, axis, min(members)]
            density = densities.get(piece.name)
            if density is None:
                raise given.error(f"{label} on {piece.name!r}, whose material has no *DENSITY; give it one")
            if len(members) < len(piece.elements):
                raise given.error(f"{label} on some elements of {piece.name!r}: give it to all of them, or "
                                  "the others a *SOLID SECTION of their own")
            value, name = self.history.value(curve), self._name(f"{label} {piece.name}")
            density *= thickness_of(piece)
            direction = np.array(axis[-3:]) / np.linalg.norm(axis[-3:])
            if label == "GRAV":
                force = tuple(value * float(density * c) for c in direction[: self.dim])
                scene.body_force(piece.name, force, name)
            else:
                field = _outward(density, np.array(axis[:3]), direction)
                scene.body_force(piece.name, _times(value, field), name)

    def _temperatures(self, scene: Scene, alphas: Mapping[str, Any]) -> None:
        curves = {key[1]: curve for key, curve in self.history.curves.items() if key[0] == "T"}
        if not curves:
            return
        start = self.history.start_temperatures
        rest: Curve = ((0.0, 0.0),)
        rises = {n: tuple((t, v - start.get(n, 0.0)) for t, v in curve) for n, curve in curves.items()}
        for piece in self.mesh.pieces:
            own = listed(piece.nodes[piece.nodes < len(self.model.x)])
            found = {rises.get(n, rest) for n in own}
            if not any(v for curve in found for _, v in curve):
                continue
            alpha = alphas.get(piece.name)
            if alpha is None:  # it does not expand
                continue
            name = self._name(f"temperature {piece.name}")
            if len(found) == 1:
                scene.temperature(piece.name, self.history.value(found.pop()), alpha, name=name)
                continue
            field = self._nodal(scene, piece, {n: (curve,) for n, curve in rises.items()}, 1)
            scene.temperature(piece.name, _first_of(field), alpha, name=name)


def _between(shares: list[float], holds: list[Hold]) -> Hold | None:
    """Of a node between others: held while all of these are; None: never."""
    timed = [hold for hold in holds if hold.during] or holds[:1]
    during = timed[0].during
    for other in timed[1:]:
        both = ((max(a, c), min(b, d)) for a, b in during for c, d in other.during)
        during = tuple((start, end) for start, end in both if end > start)
        if not during:
            return None
    return Hold(combined([(w, hold.curve) for w, hold in zip(shares, holds)]), during, timed[0].kept)


def _alike(signature: tuple[int, ...]) -> dict[int, tuple[int, ...]]:
    """Components by number, without those of -1."""
    found = {s: tuple(c for c, other in enumerate(signature) if other == s) for s in signature}
    return {s: components for s, components in found.items() if s != -1}


def _unless_global(axes: Array) -> Any:
    """Axes that a support takes; None: the global ones."""
    return None if np.array_equal(axes, np.eye(len(axes))) else listed(axes)


def _outward(weight: float, origin: Array, axis: Array) -> Callable[[Array], Array]:
    """Density times the distance from an axis, outward."""

    def force(x: Array) -> Array:
        d = x.shape[1]
        arm = np.zeros((len(x), 3))
        arm[:, :d] = x
        arm -= origin
        return np.asarray(weight * (arm - np.outer(arm @ axis, axis))[:, :d])

    return force


def _times(value: Any, shape: Callable[[Array], Array]) -> Any:
    """A number, or an amplitude times one, times a function of the points."""
    if isinstance(value, Varying):
        ((amplitude, size),) = value.terms
        assert amplitude is not None
        return amplitude * (lambda x: float(size) * shape(x))
    return lambda x: float(value) * shape(x)


def _first_of(field: Any) -> Any:
    """The only component of a field, or of each term of a sum."""
    if isinstance(field, Varying):
        terms = tuple((amplitude, _first_of(each)) for amplitude, each in field.terms)
        return Varying(terms)
    return lambda x: field(x)[:, 0]
