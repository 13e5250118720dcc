"""The answer of a scene without the kernel: one assembled system, a dense factorisation, semi-smooth Newton.

The stiffness of all parts and all springs are one matrix. Rigid linear interfaces are solved for exactly (a
basis of the null space of their rows). What is left on the nodes of nonlinear interfaces is a Schur
complement, and there the laws hold by the method of multipliers: with f from the round before and a small
flexibility c find the equilibrium under R_c(j + c f), by Newton with an exact line search, and repeat until
nothing moves. For convex laws this converges from anywhere; Coulomb's falls back on bounds that are held
fixed. Time steps follow one another.

Every answer comes with what rounding may have done to it: the response to residuals of the size of the
rounding errors of its own terms, measured on the tangent at the solution (`floors`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

import dolfinx_frontend as lf
from campaign.points import Array, Bond, PointLaw, Springs, point_law, spring_rows, vector

EPS = float(np.finfo(np.float64).eps)
RIGID = (lf.Displacement, lf.Symmetry, lf.Perfect)
LOADS = (lf.Traction, lf.Pressure)
STIFF = 1e3
"""Springs above this multiple of the softer side's E / L are kept as rows: assembled ones would cancel."""
DAMPING = (0.0, 1e-11, 1e-8, 1e-5)
"""Shares of its diagonal that are added to a tangent as long as it is singular: something flies."""
PATIENCE = 10.0
"""Seconds for one step."""
Laws = Mapping[str, Any]


class Inadmissible(Exception):
    """The scene has no unique answer, or contradicts itself."""


class Contradiction(Inadmissible):
    """Supports contradict one another: no answer is right."""


class Unsolved(Exception):
    """The reference found no answer."""


@dataclass
class Answer:
    """Displacements and what is known of them.

    Attributes
    ----------
    fields
        Part -> (n, columns): columns are one, or the modes of a chaos.
    floors
        Part -> (2, 2): rounding of the energy norm and of the displacement, of the first column and of the
        rest.
    forces, jumps
        Nonlinear interface -> (m, components).
    damage
        Bond -> (m,), 0 where it is whole and 1 where it is torn.
    """

    fields: dict[str, Array]
    floors: dict[str, Array]
    forces: dict[str, Array] = field(default_factory=dict)
    jumps: dict[str, Array] = field(default_factory=dict)
    damage: dict[str, Array] = field(default_factory=dict)


@dataclass
class Row:
    """A nonlinear interface: its place among the rows, its traces G (k m, n), weights and flexibilities."""

    name: str
    interface: Any
    components: int
    trace: sp.csr_matrix
    weights: Array
    softness: float
    rows: slice = slice(0)


class Norms:
    """Energy norm and displacement of the interfaces, for every part.

    Parameters
    ----------
    kept
        Interfaces that a run kept: parts that are joined by others are one for its estimate (`components`).
    """

    def __init__(self, problem: Any, kept: Sequence[str] | None = None) -> None:
        self.components = _components(problem, kept)
        self.springs: list[tuple[dict[str, sp.csr_matrix], Array]] = []
        self.stiffness = {name: part.matrix.tocsr() for name, part in problem.substructures.items()}
        self.rigid = {name: part.strainless for name, part in problem.substructures.items()}
        self.on_faces = {}
        for name, part in problem.substructures.items():
            gram = sp.csr_matrix((part.size, part.size))
            for interface in problem.interfaces.values():
                for side in interface.sides:
                    if side.substructure == name:
                        shape = side.shape
                        one = (shape.T @ sp.diags(interface.weights) @ shape).tocsr()
                        gram = gram + sp.kron(one, sp.eye(interface.dim), format="csr")
            self.on_faces[name] = gram.tocsr()

    def of(self, name: str, block: Array) -> Array:
        """Energy norm and displacement of a field (n, columns), summed over its columns, (2,)."""
        block = block.reshape(len(block), -1)
        # what a rigid motion leaves of its zero energy would be far more than strains beside it
        motions, inverse = self.rigid[name]
        strained = block - motions @ (inverse @ (motions.T @ block))
        energy = np.einsum("ic,ic->", strained, self.stiffness[name] @ strained)
        moved = np.einsum("ic,ic->", block, self.on_faces[name] @ block)
        return np.sqrt(np.maximum([energy, moved], 0.0))

    def over(self, names: Sequence[str], fields: Mapping[str, Array]) -> Array:
        """The same of several parts, (2,)."""
        squares = sum(self.of(name, np.asarray(fields[name])) ** 2 for name in names)
        for jumps, stiffness in self.springs:
            if next(iter(jumps)) in names:
                jump = sum(of_part @ np.asarray(fields[name]) for name, of_part in jumps.items())
                squares[0] += np.einsum("i,ic->", stiffness, jump.reshape(len(stiffness), -1) ** 2)
        return np.sqrt(squares)

    def of_springs(self, names: Sequence[str]) -> float:
        """Square root of the energy of assembled springs whose ends move by one against each other."""
        energy = 0.0
        for jumps, stiffness in self.springs:
            if next(iter(jumps)) in names:
                reach = sum(np.asarray(abs(of_part).sum(axis=1)).ravel() for of_part in jumps.values())
                energy += float(stiffness @ reach**2)
        return float(np.sqrt(energy))

    def add_springs(self, jumps: Mapping[str, sp.csr_matrix], stiffness: Array) -> None:
        """Springs (m,) that a run has assembled into its parts, by the jump (m, n) of every part."""
        self.springs.append((dict(jumps), stiffness))


def _components(problem: Any, kept: Sequence[str] | None) -> dict[str, list[str]]:
    """Parts that are joined by interfaces that were not kept, by their names; without `kept` single ones."""
    of_part = {name: {name} for name in problem.substructures}
    for name, interface in problem.interfaces.items():
        if kept is not None and name not in kept:
            joined = set().union(*(of_part[side.substructure] for side in interface.sides))
            of_part.update(dict.fromkeys(joined, joined))
    found = {}
    for name in problem.substructures:
        names = [each for each in problem.substructures if each in of_part[name]]
        found["+".join(names)] = names
    return found


def force_on(interface: Any, law: Any) -> tuple[str, Array]:
    """The part that a pressure or traction acts on, and its nodal forces (n,)."""
    side, d, x = interface.sides[0], interface.dim, interface.points
    if isinstance(law, lf.Pressure):
        p = np.broadcast_to(law.p(x) if callable(law.p) else law.p, len(x))
        t = -p[:, None] * interface.normals
    else:
        t = vector(law.t, x, d, "all")
    return side.substructure, (side.shape.T @ (interface.weights[:, None] * t)).ravel()


def given_loads(problem: Any, laws: Laws, time: float | None) -> dict[str, Array]:
    """Part -> nodal forces (n,) of body forces, pressures and tractions."""
    now = problem if time is None else problem.at(time)
    out = {name: np.array(part.load, dtype=np.float64) for name, part in now.substructures.items()}
    for name, law in laws.items():
        if isinstance(law, LOADS):
            part, forces = force_on(problem.interfaces[name], law)
            out[part] += forces
    return out


class Model:
    """A scene's linear part, condensed on the nodes of its nonlinear interfaces.

    Parameters
    ----------
    problem
        Assembled, on one rank.
    laws
        Interface -> law with numbers for values, at one time.
    active
        What the run that is judged kept: glued faces that it eliminated are joined node by node.
    varies
        Interfaces whose stiffness is not always the same.
    """

    def __init__(self, problem: Any, laws: Laws, active: Sequence[str], varies: Sequence[str] = ()) -> None:
        self.problem, self.norms = problem, Norms(problem, active)
        self.parts = list(problem.substructures)
        sizes = [problem.substructures[name].size for name in self.parts]
        ends = np.cumsum([0, *sizes])
        self.of_part = {name: slice(ends[i], ends[i + 1]) for i, name in enumerate(self.parts)}
        self.size = int(ends[-1])
        self.rigid: list[tuple[str, sp.csr_matrix, bool]] = []
        self.springs: list[tuple[str, sp.csr_matrix, Array]] = []
        self.rows: list[Row] = []
        self.loaded: list[str] = []
        total = 0
        for name, interface in problem.interfaces.items():
            law = laws[name]
            if isinstance(law, LOADS):
                self.loaded.append(name)
            elif isinstance(law, RIGID):
                glued = isinstance(law, lf.Perfect) and name not in active
                self.rigid.append((name, self._rigid_rows(name, law, glued), glued))
            else:
                softness = self._softness(interface)
                if isinstance(law, lf.Elastic) and name not in varies:
                    kappa = spring_rows(interface, law)
                    trace = self._trace(name, kappa.shape[1])
                    if name not in active:
                        sides = {side.substructure for side in interface.sides}
                        weights = np.repeat(interface.weights, kappa.shape[1])
                        jumps = {part: trace[:, self.of_part[part]] for part in sides}
                        self.norms.add_springs(jumps, weights * kappa.ravel())
                    if np.max(kappa) * softness <= STIFF:
                        self.springs.append((name, trace, kappa))
                        continue
                components = point_law(interface, law, None, None).components
                row = Row(name, interface, components, self._trace(name, components), np.zeros(0), softness)
                row.weights = np.repeat(interface.weights, components)
                row.rows = slice(total, total + len(row.weights))
                total += len(row.weights)
                self.rows.append(row)
        self._factor()

    # -- rows -------------------------------------------------------------------------------------
    def _softness(self, interface: Any) -> float:
        parts = [self.problem.substructures[side.substructure] for side in interface.sides]
        return float(sum(part.length / part.modulus for part in parts))

    def _trace(self, name: str, components: int) -> sp.csr_matrix:
        """Jump in the local frame, the first components of each point, (components m, n)."""
        interface = self.problem.interfaces[name]
        d, m = interface.dim, interface.num_points
        keep = (np.arange(m)[:, None] * d + np.arange(components)[None]).ravel()
        blocks = []
        for part in self.parts:
            block = sp.csr_matrix((len(keep), self.problem.substructures[part].size))
            for i, side in enumerate(interface.sides):
                if side.substructure == part:
                    block = block + (-1.0, 1.0)[i] * interface.local_trace(i)[keep]
            blocks.append(block)
        return sp.hstack(blocks, format="csr")

    def _rigid_rows(self, name: str, law: Any, glued: bool) -> sp.csr_matrix:
        interface = self.problem.interfaces[name]
        d = interface.dim
        first = interface.sides[0]
        if glued:
            if interface.matching is None:
                raise Inadmissible(f"{name} was glued though its meshes do not match")
            pairs = interface.matching
            out = sp.lil_matrix((d * len(pairs), self.size))
            for k, (a, b) in enumerate(pairs):
                for i in range(d):
                    out[d * k + i, self.of_part[first.substructure].start + d * a + i] = -1.0
                    out[d * k + i, self.of_part[interface.sides[1].substructure].start + d * b + i] = 1.0
            return out.tocsr()
        if isinstance(law, lf.Symmetry):
            return -self._trace(name, 1)
        if isinstance(law, lf.Perfect):
            return self._trace(name, d)
        axes = range(d) if law.components is None else law.components
        pick = sp.csr_matrix(np.eye(d)[list(axes)])
        local = sp.kron(first.shape, pick, format="csr")
        out = sp.lil_matrix((local.shape[0], self.size))
        out[:, self.of_part[first.substructure]] = local
        return out.tocsr()

    # -- factorisation ----------------------------------------------------------------------------
    def _factor(self) -> None:
        matrix = sp.block_diag([self.problem.substructures[n].matrix for n in self.parts], format="csr")
        for name, trace, kappa in self.springs:
            weights = np.repeat(self.problem.interfaces[name].weights, kappa.shape[1])
            matrix = matrix + trace.T @ sp.diags(weights * kappa.ravel()) @ trace
        self.matrix = matrix.tocsr()
        self._null_space()
        G = [row.trace for row in self.rows]
        self.trace = sp.vstack(G, format="csr") if G else sp.csr_matrix((0, self.size))
        self.weights = np.concatenate([row.weights for row in self.rows]) if G else np.zeros(0)
        reduced = (self.Z.T @ self.matrix @ self.Z).toarray()
        reduced = 0.5 * (reduced + reduced.T)
        H = (self.trace @ self.Z).tocsc()
        touched = np.diff(H.indptr) > 0
        self.b, self.i = np.flatnonzero(touched), np.flatnonzero(~touched)
        inner = reduced[np.ix_(self.i, self.i)]
        diagonal = np.diag(inner)
        if len(self.i) and diagonal.min() <= 0.0:
            raise Inadmissible("a node is held by nothing")
        self.scale = 1.0 / np.sqrt(diagonal)
        try:
            self.inner = la.cho_factor(inner * self.scale[:, None] * self.scale, lower=True)
        except la.LinAlgError as err:
            raise Inadmissible("parts are held by nothing") from err
        if len(self.i) and np.abs(np.diag(self.inner[0])).min() < 1e-8:
            raise Inadmissible("parts are held by nothing, up to rounding")
        self.coupling = reduced[np.ix_(self.i, self.b)]
        self.spread = self._inner(self.coupling)
        self.S = reduced[np.ix_(self.b, self.b)] - self.coupling.T @ self.spread
        self.S = 0.5 * (self.S + self.S.T)
        self.H = H[:, self.b].toarray()

    def _inner(self, right: Array) -> Array:
        scale = self.scale.reshape(-1, *[1] * (right.ndim - 1))
        if not len(self.i):
            return np.zeros_like(right)
        return scale * la.cho_solve(self.inner, scale * right)

    def _null_space(self) -> None:
        """u = Z y + P c: what the rigid rows leave free, and what they prescribe."""
        C = sp.vstack([rows for _, rows, _ in self.rigid], format="csr") if self.rigid else None
        held: list[tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], Array]] = []
        columns, entries, count = [], [], 0
        rest = np.ones(self.size, dtype=bool)
        stiffness = self.matrix.diagonal()
        if C is not None and C.nnz:
            C = sp.diags(1.0 / np.maximum(abs(C).max(axis=1).toarray().ravel(), 1e-300)) @ C
            C.data[np.abs(C.data) < 1e-14] = 0.0
            C.eliminate_zeros()
            used = np.flatnonzero(np.diff(C.tocsc().indptr))
            rest[used] = False
            graph = abs(C).T @ abs(C)
            _, labels = connected_components(graph[used][:, used], directed=False)
            row_label = np.full(C.shape[0], -1)
            label_of = np.full(self.size, -1)
            label_of[used] = labels
            filled = np.diff(C.indptr) > 0
            row_label[filled] = label_of[C.indices[C.indptr[:-1][filled]]]
            for label in range(labels.max() + 1):
                mine, who = used[labels == label], np.flatnonzero(row_label == label)
                block = C[who][:, mine].toarray()
                U, s, Vt = np.linalg.svd(block, full_matrices=False)
                rank = int(np.sum(s > 1e-9 * s[0]))
                held.append((who, mine, (Vt[:rank].T / s[:rank]) @ U[:, :rank].T))
                if rank == len(mine):
                    continue
                # soft nodes follow stiff ones: a basis that mixed them would lose the soft part's digits
                soft = 1.0 / np.sqrt(stiffness[mine])
                _, R, order = la.qr(block * soft, mode="economic", pivoting=True)
                follow, lead = order[:rank], order[rank:]
                follows = -la.solve_triangular(R[:rank, :rank], R[:rank, rank:])
                follows *= soft[follow][:, None] / soft[lead]
                follows[np.abs(follows) < 1e-13] = 0.0
                free = np.zeros((len(mine), len(lead)))
                free[lead, range(len(lead))] = 1.0
                free[follow] = follows
                columns.append((mine, free, lead))
        identity = np.flatnonzero(rest)
        leads = [identity]
        row_index, column_index, entries = [identity], [np.arange(len(identity))], [np.ones(len(identity))]
        count = len(identity)
        for mine, free, first in columns:
            leads.append(mine[first])
            r, c = np.nonzero(free)
            row_index.append(mine[r])
            column_index.append(count + c)
            entries.append(free[r, c])
            count += free.shape[1]
        where = (np.concatenate(row_index), np.concatenate(column_index))
        self.Z = sp.csr_matrix((np.concatenate(entries), where), shape=(self.size, count))
        self.held, self.C = held, C
        self.leads = np.concatenate(leads)  # the unknown of u that each y is

    # -- what changes in time ----------------------------------------------------------------------
    def prescribed(self, laws: Laws) -> Array:
        """The particular displacement (n,) of the rigid interfaces."""
        out = np.zeros(self.size)
        if self.C is None:
            return out
        values = []
        for name, rows, glued in self.rigid:
            law, interface = laws[name], self.problem.interfaces[name]
            d, x = interface.dim, interface.points
            if glued or isinstance(law, lf.Symmetry):
                values.append(np.zeros(rows.shape[0]))
            elif isinstance(law, lf.Perfect):
                values.append(vector(law.jump, x, d, "first").ravel())
            else:
                axes = list(range(d) if law.components is None else law.components)
                values.append(vector(law.value, x, d, "all")[:, axes].ravel())
        size = np.concatenate([abs(rows).max(axis=1).toarray().ravel() for _, rows, _ in self.rigid])
        c = np.concatenate(values) / np.maximum(size, 1e-300)
        for who, mine, inverse in self.held:
            out[mine] = inverse @ c[who]
        left = np.abs(self.C @ out - c).max(initial=0.0)
        if left > 1e-9 * np.abs(c).max(initial=0.0):
            raise Contradiction("supports contradict one another")
        return out

    def loads(self, laws: Laws, time: float | None) -> Array:
        """Nodal forces (n,) of body forces, pressures, tractions and imposed jumps of assembled springs."""
        given = given_loads(self.problem, laws, time)
        out = np.concatenate([given[name] for name in self.parts])
        for name, trace, kappa in self.springs:
            interface = self.problem.interfaces[name]
            delta = vector(laws[name].jump, interface.points, interface.dim, "first")[:, : kappa.shape[1]]
            out += trace.T @ (np.repeat(interface.weights, kappa.shape[1]) * (kappa * delta).ravel())
        return out

    def force_on(self, name: str, law: Any) -> Array:
        """Nodal forces (n,) of one pressure or traction."""
        out = np.zeros(self.size)
        part, forces = force_on(self.problem.interfaces[name], law)
        out[self.of_part[part]] = forces
        return out

    # -- one step ----------------------------------------------------------------------------------
    def condensed(self, right: Array) -> tuple[Array, Array]:
        """Of nodal forces (n, ...): those on y_b, condensed, and those on y_i."""
        y = self.Z.T @ right
        inside = y[self.i]
        return y[self.b] - self.spread.T @ inside, inside

    def recovered(self, y_b: Array, inside: Array) -> Array:
        """Displacements (n, ...) without the prescribed ones."""
        y = np.zeros((self.Z.shape[1], *y_b.shape[1:]))
        y[self.b] = y_b
        y[self.i] = self._inner(inside) - self.spread @ y_b
        return self.Z @ y

    def solve(
        self,
        laws: Laws,
        time: float | None = None,
        memory: Mapping[str, Any] | None = None,
        start: Mapping[str, tuple[Array, Array]] | None = None,
        near: Mapping[str, Array] | None = None,
        share: float = 1.0,
    ) -> tuple[Answer, dict[str, Any]]:
        """The answer at one time, and what the next step must remember.

        Parameters
        ----------
        start
            Interface -> force and jump to begin from.
        near
            Part -> displacements (n, 1) to begin from.
        share
            Of the loads and of what supports prescribe.

        Raises
        ------
        Unsolved
            No answer was found.
        """
        fixed, load = share * self.prescribed(laws), share * self.loads(laws, time)
        right, inside = self.condensed(load - self.matrix @ fixed)
        known = memory or {}
        each = [point_law(r.interface, laws[r.name], time, known.get(r.name)) for r in self.rows]
        newton = _Newton(self, each, self.trace @ fixed, right)
        terms = abs(self.matrix) @ np.abs(fixed) + np.abs(load)
        newton.terms = (abs(self.Z).T @ terms)[self.b]
        if self.rows:
            newton.y = np.array(known.get("", newton.y))
            if near is not None:
                guess = np.concatenate([np.asarray(near[name]).ravel() for name in self.parts])
                newton.y = (guess - fixed)[self.leads][self.b]
            newton.run(start)
        u = fixed + self.recovered(newton.y, inside)
        for _ in range(3):
            # the condensed matrix has rounded: what its answer leaves in the whole one
            left = load - self.matrix @ u - self.trace.T @ (self.weights * newton.law_force(self.trace @ u))
            last, left_inside = self.condensed(left)
            last = self.recovered(newton.respond(last), left_inside)
            u = u + last
        floors = self._floors(newton, u, load, last)
        jump = self.trace @ u
        forces, jumps, damage = {}, {}, {}
        remembered: dict[str, Any] = {"": newton.y}
        for row, law in zip(self.rows, each, strict=True):
            shape = (-1, row.components)
            forces[row.name] = newton.force[row.rows].reshape(shape)
            jumps[row.name] = jump[row.rows].reshape(shape)
            remembered[row.name] = law.remember(jumps[row.name], forces[row.name])
            if isinstance(law, Bond):
                damage[row.name] = law.damage(remembered[row.name])
        fields = {name: u[where][:, None] for name, where in self.of_part.items()}
        return Answer(fields, floors, forces, jumps, damage), remembered

    def _floors(self, newton: _Newton, u: Array, load: Array, corrected: Array) -> dict[str, Array]:
        """What rounding of the terms of equilibrium does to every part."""
        rng = np.random.default_rng(0)
        terms = abs(self.matrix) @ np.abs(u) + np.abs(load)
        terms = terms + abs(self.trace).T @ (self.weights * np.abs(newton.force))
        moves = abs(self.trace) @ np.abs(u)
        found = {name: np.zeros((2, 2)) for name in self.parts}
        for _ in range(3):
            right, inside = self.condensed(EPS * terms * rng.standard_normal(len(terms)))
            right = right - newton.pull(EPS * moves * rng.standard_normal(len(moves)))
            away = self.recovered(newton.respond(right), inside)
            for name, where in self.of_part.items():
                found[name][:, 0] = np.maximum(found[name][:, 0], self.norms.of(name, away[where]))
        last = self.recovered(newton.last, np.zeros(len(self.i)))
        for name, where in self.of_part.items():
            more = self.norms.of(name, last[where]) + self.norms.of(name, corrected[where])
            if np.any((more > 1e-4 * self.norms.of(name, u[where])) & (more > 30.0 * found[name][:, 0])):
                raise Unsolved(f"the answer of {name} does not settle")
            found[name][:, 0] += more
        return found


class _Newton:
    """The method of multipliers on the nodes of the nonlinear interfaces."""

    def __init__(self, model: Model, laws: list[PointLaw], jump: Array, right: Array) -> None:
        self.model, self.laws, self.jump, self.right = model, laws, jump, right
        self.S, self.H, self.w = model.S, model.H, model.weights
        self.y = np.zeros(len(model.b))
        self.force = np.zeros(len(self.w))
        self.terms = np.abs(right)
        self.signs = np.random.default_rng(1).choice((-1.0, 1.0), (len(right), 2))
        self.noise = np.zeros((len(right), 2))
        self.last = np.zeros(len(right))
        self._set_c(1.0)
        self._lu: Any = None
        self.singular = False
        # nodes of each part, for relative changes
        self.who, self.columns = [], []
        Zb = model.Z[:, model.b]
        for where in model.of_part.values():
            block = Zb[where]
            if block.nnz:
                self.who.append(block)
                self.columns.append(np.flatnonzero(np.diff(block.tocsc().indptr)))

    def _set_c(self, factor: float) -> None:
        self.factor = factor
        self.c = []
        for row, law in zip(self.model.rows, self.laws, strict=True):
            m = len(row.weights) // row.components
            c = np.full((m, row.components), 3e-3 * factor * row.softness)
            self.c.append(law.flexibility(c) if hasattr(law, "flexibility") else c)

    def _resolve(self, z: Array) -> tuple[Array, list[Array]]:
        force, slopes = np.empty(len(self.w)), []
        for row, law, c in zip(self.model.rows, self.laws, self.c, strict=True):
            f, slope = law.resolve(z[row.rows].reshape(c.shape), c)
            force[row.rows] = f.ravel()
            slopes.append(slope)
        return force, slopes

    def _flat_c(self) -> Array:
        return np.concatenate([c.ravel() for c in self.c])

    def _through(self, slopes: list[Array], H: Array) -> Array:
        """D H."""
        out = np.empty_like(H)
        for row, slope in zip(self.model.rows, slopes, strict=True):
            m, k, _ = slope.shape
            block = H[row.rows].reshape(m, k, -1)
            out[row.rows] = np.einsum("mab,mbn->man", slope, block).reshape(m * k, -1)
        return out

    def _tangent(self, slopes: list[Array]) -> Array:
        return self.S + self.H.T @ (self.w[:, None] * self._through(slopes, self.H))

    def _solve(self, matrix: Array, right: Array, least: int = 0) -> Array:
        scale = 1.0 / np.sqrt(np.maximum(np.abs(np.diag(matrix)), 1e-300))
        scaled = matrix * scale[:, None] * scale
        right = scale.reshape(-1, *[1] * (right.ndim - 1)) * right
        for damping in DAMPING[least:]:
            lu = la.lu_factor(scaled + damping * np.eye(len(scaled)), check_finite=False)
            if np.abs(np.diag(lu[0])).min() > 3e-15:
                break
        self._lu, self.singular = (lu, scale), damping > 0.0
        found: Array = scale.reshape(-1, *[1] * (right.ndim - 1)) * la.lu_solve(lu, right, check_finite=False)
        return found

    def respond(self, right: Array) -> Array:
        """Linear response at the answer."""
        if self._lu is None:
            return np.zeros(len(self.y))
        lu, scale = self._lu
        return scale * la.lu_solve(lu, scale * right, check_finite=False)

    def law_force(self, jump: Array) -> Array:
        """The law's force at jumps close to the answer's."""
        if not self.model.rows:
            return np.zeros(0)
        return self._resolve(jump + self._flat_c() * self.known)[0]

    def pull(self, jump: Array) -> Array:
        """Forces on the nodes of a change of the jumps."""
        if not self.model.rows:
            return np.zeros(len(self.y))
        return self.H.T @ (self.w * self._through(self.slopes, jump[:, None])[:, 0])

    def _inner(self, limit: int) -> bool:
        """Equilibrium for the multipliers at hand."""
        H, w = self.H, self.w
        offset = self.jump + self._flat_c() * self.force
        convex = all(law.convex or law.frozen is not None for law in self.laws)
        best, since = np.inf, 0
        size_S, size_H = np.abs(self.S), np.abs(H).T
        for _ in range(limit):
            z = H @ self.y + offset
            force, slopes = self._resolve(z)
            residual = self.S @ self.y + H.T @ (w * force) - self.right
            forces = size_H @ (w * np.abs(force)) + self.terms
            # the same factorisation says what rounding of these terms is worth
            noise = EPS * (size_S @ np.abs(self.y) + forces)[:, None] * self.signs
            tangent = self._tangent(slopes)
            for least in range(len(DAMPING)):
                found = self._solve(tangent, np.column_stack([-residual, noise]), least)
                step, self.noise = found[:, 0], found[:, 1:]
                if not convex or step @ residual <= 0.0:
                    break
            if not np.all(np.isfinite(step)):
                return False
            acts = size_H @ (w * np.abs(force)) + np.abs(self.right)
            if self._change(step) < 1e-13 and self._balanced(residual, acts):
                self.y = self.y + step
                return True
            Hs, Ss = H @ step, self.S @ step

            def slope_at(alpha: float, z=z, Hs=Hs, Ss=Ss, residual=residual, force=force) -> float:
                moved, _ = self._resolve(z + alpha * Hs)
                return float(Hs @ (w * (moved - force)) + alpha * (step @ Ss) + step @ residual)

            alpha = 1.0
            start = float(step @ residual)
            if convex and start < 0.0:
                end = slope_at(1.0)
                if end > 0.1 * abs(start):
                    low, high, f_low, f_high = 0.0, 1.0, start, end
                    for k in range(40):
                        alpha = low - f_low * (high - low) / (f_high - f_low)
                        if k % 3 == 2:
                            alpha = 0.5 * (low + high)
                        value = slope_at(alpha)
                        if abs(value) <= 1e-2 * abs(start):
                            break
                        if value > 0.0:
                            high, f_high = alpha, value
                        else:
                            low, f_low = alpha, value
            elif not convex:
                size = np.sqrt(1.0 / np.maximum(np.diag(self.S), 1e-300))
                base = float(np.linalg.norm(size * residual))
                best, since = (base, 0) if base < 0.9 * best else (best, since + 1)
                if since > 12:
                    return False
                for _ in range(10):
                    moved, _ = self._resolve(z + alpha * Hs)
                    new = residual + alpha * Ss + H.T @ (w * (moved - force))
                    if np.linalg.norm(size * new) <= (1.0 - 1e-4 * alpha) * base:
                        break
                    alpha *= 0.5
                else:
                    alpha = 0.3
            self.y = self.y + alpha * step
        return False

    def _balanced(self, residual: Array, forces: Array) -> bool:
        """Whether what is left over is small beside the forces on every part: in flight it is not."""
        whole = np.linalg.norm(forces)
        for columns in self.columns:
            # a part without a load has forces that may be nothing but rounding
            least = 0.0 if np.linalg.norm(self.right[columns]) > 1e-12 * whole else 1e-6 * whole
            size = np.linalg.norm(forces[columns])
            if np.linalg.norm(residual[columns]) > max(1e-4 * size, least):
                return False
        return True

    def _change(self, step: Array) -> float:
        """Largest change of a part relative to its own displacement; what rounding may have done is none."""
        worst = 0.0
        for block in self.who:
            size, moved = np.linalg.norm(block @ self.y), np.linalg.norm(block @ step)
            moved -= 30.0 * float(np.linalg.norm(block @ self.noise, axis=0).max())
            if moved > 0.0:
                worst = max(worst, float(moved / max(size, 1e-300)))
        return worst

    def run(self, start: Mapping[str, tuple[Array, Array]] | None) -> None:
        rows, laws = self.model.rows, self.laws
        if start is not None:
            for row in rows:
                if row.name in start:
                    self.force[row.rows] = start[row.name][0].ravel()
        odd = [(row, law) for row, law in zip(rows, laws, strict=True) if not law.convex]
        held: list[Array | None] = [None] * len(odd)
        wait, frozen_rounds, history, began = 6, 0, [], perf_counter()
        rounds, solved = 0, False
        for rounds in range(300):
            if perf_counter() - began > PATIENCE:
                break
            before, known, frozen = self.y.copy(), self.force.copy(), frozen_rounds > 0
            settled = True
            if frozen:
                jump = self.H @ self.y + self.jump
                for k, (row, law) in enumerate(odd):
                    shape = (-1, row.components)
                    law.freeze(jump[row.rows].reshape(shape), self.force[row.rows].reshape(shape), held[k])
                    last, held[k] = held[k], law.frozen
                    size = 1e-11 * np.abs(law.frozen).max()
                    settled = settled and last is not None and np.abs(last - law.frozen).max() <= size
                frozen_rounds -= 1
            good = self._inner(60)
            for _, law in odd:
                law.frozen = None
            if not good and not frozen and odd:
                self.y, self.force = before, known
                frozen_rounds, held = wait, [None] * len(odd)
                wait = min(2 * wait, 100)
                continue
            self.known = self.force
            z = self.H @ self.y + self.jump + self._flat_c() * self.force
            self.force, self.slopes = self._resolve(z)
            change = self._change(self.y - before)
            history.append(change)
            # in rounds without any change what is held fixed is settled up to rounding
            settled = settled or history[-6:] == [0.0] * 6
            if good and settled and change < 1e-11:
                # one more round, and what it still changes is the reference's own error
                self.last = self.y - before
                if solved:
                    break
                solved = True
                continue
            if good and not frozen and rounds % 8 == 7 and len(history) > 1 and change > 0.1 * history[-2]:
                if self.factor > 1e-5:
                    self._set_c(0.1 * self.factor)
        if not solved:
            last_change = history[-1] if history else np.inf
            raise Unsolved(f"no answer after {rounds + 1} rounds, last change {last_change:.1e}")
        self._solve(self._tangent(self.slopes), self.right)
        if self.singular:
            raise Unsolved("something moves freely at the answer")


def histories(
    model: Model,
    laws_at: Callable[[float | None], Laws],
    times: Sequence[float] | None,
    start: Callable[[int], Mapping[str, tuple[Array, Array]]] | None = None,
    near: Sequence[Mapping[str, Array]] | None = None,
    increments: int = 1,
) -> list[Answer]:
    """One step after the other; each begins from the one before, or from what `start` gives.

    Parameters
    ----------
    times
        None: one step without a time.
    increments
        Of each step, in which the loads grow from those before; of the first one from none.
    """
    answers: list[Answer] = []
    last: Answer | None = None
    memory: dict[str, Any] = {}
    for k, time in enumerate([None] if times is None else map(float, times)):
        guess = None if near is None else near[k]
        begin = None if start is None else start(k)
        for share in np.arange(1, increments + 1) / increments:
            now = time if not k or time is None else times[k - 1] + share * (time - times[k - 1])
            if start is None and last is not None:
                begin = {n: (f, last.jumps[n]) for n, f in last.forces.items()}
            last, memory = model.solve(laws_at(now), now, memory, begin, guess, 1.0 if k else share)
        answers.append(last)
    return answers


def galerkin(
    model: Model,
    laws_of: Callable[[Array], Laws],
    random: Sequence[str],
    points: Array,
    weights: Array,
    psi: Array,
    time: float | None = None,
) -> Answer:
    """Chaos coefficients of a linear scene by Galerkin's projection, its integrals by quadrature.

    Parameters
    ----------
    model
        With the random interfaces among its rows.
    laws_of
        Point of the germs (L,) -> laws with numbers.
    random
        Interfaces with random values.
    points, weights, psi
        Quadrature (q, L), (q,), and the polynomials there, (q, P + 1).
    """
    modes = psi.shape[1]
    nominal = laws_of(points[0])
    known = [name for name in random if name in dict.fromkeys(random)]
    F, fixed = np.zeros((model.size, modes)), np.zeros((model.size, modes))
    rows = {row.name: row for row in model.rows}
    first = {row.name: point_law(row.interface, nominal[row.name], time, None) for row in model.rows}
    for law in first.values():
        if not isinstance(law, Springs):
            raise Unsolved("Galerkin's reference is for linear scenes")
    coupling = {n: np.zeros((modes, modes, law.components)) for n, law in first.items()}
    imposed = {n: np.zeros((*first[n].delta.shape, modes)) for n in first}  # type: ignore[attr-defined]
    wpsi = weights[:, None] * psi
    for n, law in first.items():
        if n not in known:
            kappa = law.kappa[0]  # type: ignore[attr-defined]
            coupling[n] += np.eye(modes)[:, :, None] * kappa
            imposed[n][..., 0] = law.delta  # type: ignore[attr-defined]
    rigid = [n for n, _, _ in model.rigid]
    moving = [n for n in known if n in rigid]
    pressed = [n for n in known if n in model.loaded]
    base = model.loads(nominal, time)
    for n in pressed:
        base -= model.force_on(n, nominal[n])
    F[:, 0] = base
    if not moving:
        fixed[:, 0] = model.prescribed(nominal)
    for q, point in enumerate(points):
        laws = laws_of(point)
        for n in known:
            if n in rows:
                law = point_law(rows[n].interface, laws[n], time, None)
                coupling[n] += weights[q] * np.outer(psi[q], psi[q])[:, :, None] * law.kappa[0]
                imposed[n] += law.delta[..., None] * wpsi[q]
        for n in pressed:
            F += np.outer(model.force_on(n, laws[n]), wpsi[q])
        if moving:
            fixed += np.outer(model.prescribed(laws), wpsi[q])
    right, inside = model.condensed(F - model.matrix @ fixed)
    nb = len(model.b)
    system = np.einsum("ab,ij->aibj", model.S, np.eye(modes))
    offset = model.trace @ fixed
    for n, row in rows.items():
        k = row.components
        H = model.H[row.rows].reshape(-1, k, nb)
        w = row.weights.reshape(-1, k)
        for c in range(k):
            gram = H[:, c].T @ (w[:, c, None] * H[:, c])
            system += np.einsum("ab,ij->aibj", gram, coupling[n][:, :, c])
            away = offset[row.rows].reshape(-1, k, modes)[:, c] - imposed[n][:, c]
            right -= H[:, c].T @ (w[:, c, None] * (away @ coupling[n][:, :, c]))
    matrix = system.reshape(nb * modes, nb * modes)
    floors = {name: np.zeros((2, 2)) for name in model.parts}
    if nb:
        scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        lu = la.lu_factor(matrix * scale[:, None] * scale)

        def respond(block: Array) -> Array:
            return (scale * la.lu_solve(lu, scale * block.ravel())).reshape(nb, modes)
    else:

        def respond(block: Array) -> Array:
            return block

    u = fixed + model.recovered(respond(right), inside)
    last = np.zeros_like(u)
    for _ in range(3):
        left = F - model.matrix @ u
        for n, row in rows.items():
            jump = (row.trace @ u).reshape(-1, row.components, modes) - imposed[n]
            force = np.stack([jump[:, c] @ coupling[n][:, :, c] for c in range(row.components)], axis=1)
            left -= row.trace.T @ (row.weights[:, None] * force.reshape(-1, modes))
        edge, middle = model.condensed(left)
        last = model.recovered(respond(edge), middle)
        u = u + last
    rng = np.random.default_rng(0)
    terms = abs(model.matrix) @ np.abs(u) + np.abs(F)
    for n, row in rows.items():
        # forces of the springs: of the size of stiffness times motion
        stiff = np.abs(coupling[n]).max(axis=(0, 1))
        stiff = row.weights * np.tile(stiff, len(row.weights) // len(stiff))
        terms += abs(row.trace).T @ (stiff[:, None] * (abs(row.trace) @ np.abs(u)))
    for _ in range(3):
        noise, inside_noise = model.condensed(EPS * terms * rng.standard_normal(terms.shape))
        away = model.recovered(respond(noise), inside_noise)
        for name, where in model.of_part.items():
            found = [model.norms.of(name, away[where][:, s]) for s in (slice(0, 1), slice(1, None))]
            floors[name] = np.maximum(floors[name], np.array(found).T)
    for name, where in model.of_part.items():
        found = [model.norms.of(name, last[where][:, s]) for s in (slice(0, 1), slice(1, None))]
        floors[name] += np.array(found).T
    return Answer({name: u[where] for name, where in model.of_part.items()}, floors)
