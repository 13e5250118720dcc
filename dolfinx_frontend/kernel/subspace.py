"""Bodies that move in a few displacement fields only, which are found without a factor of their matrices.

A linear answer needs far fewer displacements of a body than it has unknowns: those that its load patterns and
the forces of its interfaces make, in all columns together. They are collected in a basis V of every body. The
kernel is given V^T K V, V^T F and T V in place of K, F and T, and iterates as usual, on a body of some dozen
unknowns. What its answer leaves of the equations of the body itself,

    r = F + T^T W f - K V y,

says how good the basis is, and one cycle of multigrid on the columns of r that matter says what to add to it:
a block Krylov method whose projected problem, with all its laws and columns, the kernel solves. In the energy
norm the answer is the best one in the basis.

Over ranks, every rank has the basis of its own bodies; the blocks of multigrid have the rows of its bodies.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from latin_core import Laws, State, Structure

from dolfinx_frontend.assembly.elements import csr, petsc_matrix
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import agreement
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.deferred import sp
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.memory import available_memory
from dolfinx_frontend.kernel import bridge
from dolfinx_frontend.kernel.multigrid import (
    GLUE,
    Multigrid,
    Spring,
    jumps,
    linear_shapes,
    multiplied,
    rigid_motions,
)
from dolfinx_frontend.kernel.rows import Rows, placed
from dolfinx_frontend.plan.cost import lower_level

__all__ = ["Answer", "Bodies", "Subspace"]

Values = dict[str, Any]

DEPENDENT = 1e-10
"""A field that is left of so little by those before it is one of them."""


@dataclass(frozen=True)
class _Piece:
    """A body: which of the unknowns are its, and its kernel description.

    Attributes
    ----------
    own
        Its unknowns among all.
    values
        Its members, springs and loads.
    load
        (n_b, l) right-hand sides of the load patterns.
    reaction, energy
        (n_b, l) Z^T K u0 and (l, l) u0^T K u0 of the members alone.
    """

    own: slice
    values: Values
    load: Array = field(repr=False)
    reaction: Array = field(repr=False)
    energy: Array = field(repr=False)


class Answer(NamedTuple):
    """What the bodies do in a basis, and what acts on them.

    Attributes
    ----------
    moved
        (m, c) unknowns of all bodies in the basis, one body after the other.
    force
        (rows, c) of the interfaces on the bodies, times their areas.
    amplitudes
        (load patterns, c).
    """

    moved: Array
    force: Array
    amplitudes: Array


class Bodies:
    """All bodies of a description, as one multigrid problem; over ranks, those of this rank.

    Parameters
    ----------
    problem
        Assembled scene.
    described
        What the kernel is given of them.
    floors
        (interface, parameter) -> (points,) stiffness of an active spring in the matrix, in place of its mean.

    Raises
    ------
    SceneError
        The stiffness of a part varies, which a fixed basis does not know; or glue is active at several
        interfaces, or between linear elements.
    """

    def __init__(
        self,
        problem: Problem,
        described: bridge.Description,
        floors: Mapping[tuple[str, str], Array] | None = None,
    ) -> None:
        self.problem, self.described, self.floors = problem, described, floors or {}
        self.interfaces = interfaces = described.interfaces
        self.rows = rows = Rows(problem.comm)
        rows.tidy()
        bodies = described.bodies
        sizes = np.cumsum([0] + [each["size"] for each in bodies])
        self.size = int(sizes[-1])
        self.place = {
            member["name"]: (b, member) for b, each in enumerate(bodies) for member in each["members"]
        }
        heads = {part: bodies[b]["members"][0]["name"] for part, (b, _) in self.place.items()}
        loads = [each["members"][0]["load"].shape[1] for each in bodies]
        every = rows.every((loads, heads))
        self.loads = max(count for counts, _ in every for count in counts)
        self.heads = {part: head for _, of_rank in every for part, head in of_rank.items()}
        self.pieces: list[_Piece] = []
        with agreement(problem.comm):
            blocks = []
            for each, first, last in zip(bodies, sizes, sizes[1:], strict=False):
                blocks.append(self._add_body(each, slice(int(first), int(last))))
            matrix = _diagonal(blocks)
            del blocks
            self.traces = {each["name"]: self._traces(each) for each in interfaces}
            self.between = [self._spring(each) for each in interfaces]
            matrix.eliminate_zeros()
            self.matrix = petsc_matrix(matrix)
            del matrix
            prolongations = {
                member["name"]: placed(member["prolongation"], piece.own.start, self.size)
                for piece in self.pieces
                for member in piece.values["members"]
            }
            shapes = linear_shapes(problem, prolongations, self.size)
        self.rigid = rigid_motions(problem, prolongations, self.size, rows)
        if rows.any(shapes is None):
            shapes = None
        self._check_glue(shapes is None)
        needed = 8.0 * lower_level(problem, self.size).entries
        fits = not rows.any(needed > available_memory())
        self.multigrid = Multigrid(self.matrix, shapes, self.rigid, self.between, rows, fits)

    def _check_glue(self, linear: bool) -> None:
        """Refuse glue whose rounds do not converge: at several interfaces, or by aggregation, whose lower
        level does not know all that glue touches."""
        own = [each["name"] for each, s in zip(self.interfaces, self.between, strict=True) if s.glue]
        names = list(dict.fromkeys(name for of_rank in self.rows.every(own) for name in of_rank))
        if len(names) > 1 or (names and linear):
            raise SceneError(
                f"interface {names[0]!r}: glue that stays active, or lies between ranks, is answered by "
                "backend 'multigrid' at one interface, between elements of degree 2 and higher; it is active "
                f"at {', '.join(names)}: give both of its parts the same rank=, or take backend='cholmod'"
            )

    # -- pieces --------------------------------------------------------------------------------
    def _add_body(self, values: Values, own: slice) -> sp.csr_matrix:
        """The matrix of a body with the springs inside it."""
        size, loads = own.stop - own.start, self.loads
        total = sp.csr_matrix((size, size))
        load, reaction, energy = np.zeros((size, loads)), np.zeros((size, loads)), np.zeros((loads, loads))
        for member in values["members"]:
            if "of_stiffness" in member or "stretch" in member:
                raise SceneError(
                    f"backend 'multigrid': the stiffness of substructure {member['name']!r} varies, which "
                    "its basis does not know: use backend 'cholmod'"
                )
            Z, K = member["prolongation"], csr(member["stiffness"])
            load += Z.T @ member["load"]
            if member["offset"] is not None:
                pulled = K @ member["offset"]
                reaction += Z.T @ pulled
                energy += member["offset"].T @ pulled
            own_part = Z.T @ (K @ Z)
            del K
            total = own_part if total.nnz == 0 else total + own_part
            del own_part
        load -= reaction
        for spring in values["springs"]:
            jump, offset = sp.csr_matrix((len(spring["stiffness"]), size)), np.zeros_like(spring["jump"])
            for side, trace in enumerate(local_traces(spring)):
                member = values["members"][spring["members"][side]]
                sign = 1.0 if side else -1.0
                jump = jump + sign * (trace @ member["prolongation"])
                if member["offset"] is not None:
                    offset = offset + sign * (trace @ member["offset"])
            stiffness = spring["stiffness"]
            total = total + jump.T @ sp.diags(stiffness) @ jump
            load += jump.T @ (stiffness[:, None] * (spring["jump"] - offset))
        self.pieces.append(_Piece(own, values, load, reaction, energy))
        return total.tocsr()

    def _traces(self, interface: Values) -> dict[int, sp.csr_matrix]:
        """Side on this rank -> its local trace (rows, n) on the unknowns of all bodies."""
        found = {}
        for number, side in enumerate(interface["sides"]):
            if side["member"] in self.place:
                body, member = self.place[side["member"]]
                trace = _local(interface["frames"], len(interface["weights"]), side["trace"])
                trace = trace @ member["prolongation"]
                found[number] = placed(trace, self.pieces[body].own.start, self.size)
        return found

    def _spring(self, interface: Values) -> Spring:
        """What an active interface is in the matrix: its stiffness, stiff springs for glue, else its search
        direction."""
        scene, traces = self.problem.interfaces[interface["name"]], self.traces[interface["name"]]
        points, sides = len(interface["weights"]), interface["sides"]
        components = len(interface["frames"]) // points
        weights = np.repeat(interface["weights"], components)
        glue = len(sides) == 2 and scene.law.prescribes == "jump"
        if not (scene.law.springs or glue):
            stiff = np.concatenate([weights * sides[s]["direction"] for s in traces])
            return Spring(sp.vstack(list(traces.values()), format="csr"), stiff)
        if glue:
            kappa = GLUE * sides[next(iter(traces))]["direction"]
        else:
            kappa = bridge.spring_stiffness(scene, components, self.floors).ravel()
        jump = sum(trace if side else -trace for side, trace in traces.items()).tocsr()
        if len(traces) == 2 or len(sides) == 1:
            return Spring(jump, weights * kappa, glue=glue)
        away = next(side["member"] for s, side in enumerate(sides) if s not in traces)
        assert self.problem.distribution is not None
        return Spring(jump, weights * kappa, self.problem.distribution.owner[away], glue)

    # -- products ------------------------------------------------------------------------------
    def product(self, block: Array) -> Array:
        """The matrices of the bodies, with the springs inside them and without those between, times (n,
        c)."""
        return multiplied(self.matrix, block)


@dataclass(frozen=True)
class Subspace:
    """A basis of the displacements of every body.

    Attributes
    ----------
    bodies
        What they are bodies of.
    fields, products
        For every body: V (n_b, m) and K V with the springs inside the body.
    """

    bodies: Bodies
    fields: tuple[Array, ...] = field(repr=False)
    products: tuple[Array, ...] = field(repr=False)

    @classmethod
    def of(cls, bodies: Bodies) -> Subspace:
        """Rigid motions, and what the load patterns do to all bodies joined by springs."""
        load = np.concatenate([np.zeros((0, bodies.loads)), *(piece.load for piece in bodies.pieces)])
        empty = tuple(np.zeros((piece.own.stop - piece.own.start, 0), order="F") for piece in bodies.pieces)
        found = cls(bodies, empty, empty).with_fields(bodies.rigid)
        loaded = np.flatnonzero(np.any(bodies.rows.every(np.any(load, axis=0)), axis=0))
        return found.with_fields(bodies.multigrid.cycle(load[:, loaded])) if loaded.size else found

    @property
    def count(self) -> int:
        """Fields of all bodies on this rank."""
        return sum(each.shape[1] for each in self.fields)

    def with_fields(self, block: Array) -> Subspace:
        """The basis and what a block of displacements (n, c) adds to it, orthonormal in energy.

        What the basis has is taken out before anything is multiplied by K: what is left may be small beside
        it.
        """
        bodies = self.bodies
        block = np.array(block, order="F")
        springs = [[each.of_body(piece.own) for each in bodies.between] for piece in bodies.pieces]
        taken = []
        for b, piece in enumerate(bodies.pieces):
            V, X = self.fields[b], block[piece.own]
            shares = self.products[b].T @ X
            for each in springs[b]:
                shares += each.forces(V).T @ X
            block[piece.own] = X - V @ shares
            taken.append(np.einsum("ij,ij->j", shares, shares))
        product = bodies.product(block)
        fields, products = [], []
        for b, piece in enumerate(bodies.pieces):
            V, KV, X, KX = self.fields[b], self.products[b], block[piece.own], product[piece.own]
            pulled = KX + sum(each.forces(X) for each in springs[b])
            shares = V.T @ pulled
            gram = X.T @ pulled - shares.T @ shares
            scale = np.sqrt(np.maximum(taken[b] + np.abs(np.diag(gram)), np.finfo(float).tiny))
            values, vectors = np.linalg.eigh(0.5 * (gram + gram.T) / np.outer(scale, scale))
            chosen = values > DEPENDENT
            turned = (vectors[:, chosen] / np.sqrt(values[chosen])) / scale[:, None]
            shares = shares @ turned
            fields.append(np.asfortranarray(np.hstack([V, X @ turned - V @ shares])))
            products.append(np.asfortranarray(np.hstack([KV, KX @ turned - KV @ shares])))
        return Subspace(bodies, tuple(fields), tuple(products))

    # -- for the kernel ------------------------------------------------------------------------
    def described(self) -> tuple[list[Values], list[Values]]:
        """Bodies and interfaces for the kernel, as those that the basis is of."""
        names = [piece.values["members"][0]["name"] for piece in self.bodies.pieces]
        found = [self._body(b, name) for b, name in enumerate(names)]
        interfaces = []
        for each in self.bodies.interfaces:
            sides = []
            for side in each["sides"]:
                sides.append({**side, "member": self.bodies.heads[side["member"]]})
                if side["member"] in self.bodies.place:
                    trace = csr(side["trace"]) @ self._motions(*self.bodies.place[side["member"]])
                    sides[-1]["trace"] = petsc_matrix(sp.csr_matrix(trace))
            interfaces.append({**each, "sides": sides})
        return found, interfaces

    def _given(self, body: int) -> bool:
        members = self.bodies.pieces[body].values["members"]
        return any(member["offset"] is not None for member in members)

    def _motions(self, body: int, member: Values) -> Array:
        """[Z V, u0] (n_e, m [+ l]) of a member."""
        moved = member["prolongation"] @ self.fields[body]
        if not self._given(body):
            return np.asarray(moved)
        offset = member["offset"]
        nothing = np.zeros((len(moved), self.bodies.loads))
        return np.hstack([moved, nothing if offset is None else offset])

    def _body(self, body: int, name: str) -> Values:
        piece, V = self.bodies.pieces[body], self.fields[body]
        m, loads, given = V.shape[1], self.bodies.loads, self._given(body)
        stiffness = V.T @ self.products[body]
        springs = []
        for each in piece.values["springs"]:
            members = [piece.values["members"][at] for at in each["members"]]
            motions = [self._motions(body, member) for member in members]
            traces = [sp.csr_matrix(csr(t) @ u) for t, u in zip(each["traces"], motions, strict=True)]
            local = [
                _local(each["frames"], _points(each), petsc_matrix(trace))[:, :m] for trace in traces
            ]
            jump = -local[0] if len(local) == 1 else local[1] - local[0]
            stiffness -= (jump.T @ sp.diags(each["stiffness"]) @ jump).toarray()
            own = {"members": [0] * len(traces), "traces": [petsc_matrix(t) for t in traces]}
            springs.append({**each, **own})
        on_body = [member["prolongation"].T @ member["load"] for member in piece.values["members"]]
        load: Array = V.T @ sum(on_body)
        made: Values = {"name": name, "prolongation": None, "offset": None}
        if given:
            mixed = V.T @ piece.reaction
            stiffness = np.block([[stiffness, mixed], [mixed.T, piece.energy]])
            of_given = sum(
                member["offset"].T @ member["load"]
                for member in piece.values["members"]
                if member["offset"] is not None
            )
            load = np.vstack([load, of_given])
            made["prolongation"] = sp.eye(m + loads, m, format="csr")
            made["offset"] = np.asfortranarray(np.eye(m + loads, loads, -m))
        made["stiffness"] = petsc_matrix(sp.csr_matrix(0.5 * (stiffness + stiffness.T)))
        made["load"] = np.asfortranarray(load)
        return {"name": piece.values["name"], "size": m, "members": [made], "springs": springs}

    def expanded(self, fields: Mapping[str, Array]) -> dict[str, Array]:
        """Displacements (n, c) of the parts, of what the kernel says of its bodies."""
        out = {}
        for body, piece in enumerate(self.bodies.pieces):
            own = fields[piece.values["members"][0]["name"]]
            m = self.fields[body].shape[1]
            moved = self.fields[body] @ own[:m]
            for member in piece.values["members"]:
                u = member["prolongation"] @ moved
                if member["offset"] is not None:
                    u += member["offset"] @ own[m:]
                out[member["name"]] = np.asfortranarray(u)
        return out

    # -- how good it is ------------------------------------------------------------------------
    def answer(self, core: Structure, laws: Laws, state: State, amplitudes: Array) -> Answer:
        """A state as the bodies see it."""
        fields = core.displacements(laws, state, amplitudes)
        names = [piece.values["members"][0]["name"] for piece in self.bodies.pieces]
        # of the body, not of the law: they are in equilibrium with the basis, however far the iteration is
        force = core.global_stage(laws, np.asfortranarray(state.data), np.asfortranarray(amplitudes))
        force = state.data - np.asarray(core.directions)[:, None] * force
        return Answer(
            np.vstack([np.zeros((0, amplitudes.shape[1])), *(fields[name] for name in names)]),
            np.asarray(core.weights)[:, None] * force,
            np.asarray(amplitudes),
        )

    @cached_property
    def _places(self) -> list[tuple[slice, slice]]:
        """Of every body: its rows in :attr:`Answer.moved`, and those of them that are no given motions."""
        found, first = [], 0
        for body, fields in enumerate(self.fields):
            own = fields.shape[1]
            last = first + own + (self.bodies.loads if self._given(body) else 0)
            found.append((slice(first, last), slice(first, first + own)))
            first = last
        return found

    @cached_property
    def _strained(self) -> list[Array]:
        """Stiffness of every body in the basis, given motions included."""
        count = range(len(self.fields))
        return [csr(self._body(b, "")["members"][0]["stiffness"]).toarray() for b in count]

    @cached_property
    def _jumps(self) -> list[Array]:
        """Jumps of the springs between the bodies under the fields of the basis of this rank."""
        found = []
        for spring in self.bodies.between:
            own = [
                spring.jump[:, piece.own] @ V
                for piece, V in zip(self.bodies.pieces, self.fields, strict=True)
            ]
            found.append(np.hstack(own))  # where there are springs there is a body
        return found

    def energies(self, answer: Answer, of_springs: float = 1.0) -> Array:
        """Strain energies (c) of an answer: those of the bodies, and a share of those of the springs of the
        multigrid."""
        found = np.zeros(answer.moved.shape[1])
        for (rows, _), strained in zip(self._places, self._strained, strict=True):
            found += np.einsum("ij,ij->j", answer.moved[rows], strained @ answer.moved[rows])
        free, between = self.free(answer), self.bodies.between
        own = [jump @ free for jump in self._jumps]
        for spring, jump in zip(between, jumps(between, own, self.bodies.rows), strict=True):
            found += of_springs * spring.counted * (spring.stiffness @ jump**2)
        return np.abs(self.bodies.rows.sum(found))

    def free(self, answer: Answer) -> Array:
        """The unknowns (fields, c) of an answer on this rank, without motions that are given."""
        return np.concatenate([answer.moved[:0], *(answer.moved[own] for _, own in self._places)])

    def residual(self, core: Structure, answer: Answer) -> Array:
        """What an answer leaves of the equations of the bodies, (n, c); linear in the answer."""
        bodies = self.bodies
        out = np.empty((bodies.size, answer.moved.shape[1]), order="F")
        for piece, product, (_, own) in zip(bodies.pieces, self.products, self._places, strict=True):
            out[piece.own] = piece.load @ answer.amplitudes - product @ answer.moved[own]
        for each in bodies.interfaces:
            first = core.first_rows(each["name"])
            for side, trace in bodies.traces[each["name"]].items():
                out += trace.T @ answer.force[first[side] : first[side] + trace.shape[0]]
        return out


def _points(spring: Values) -> int:
    return int(spring["traces"][0].getSize()[0] // spring["frames"].shape[1])


def local_traces(spring: Values) -> list[sp.csr_matrix]:
    """The traces of a spring in its local frame."""
    return [_local(spring["frames"], _points(spring), trace) for trace in spring["traces"]]


def _local(frames: Array, points: int, trace: Any) -> sp.csr_matrix:
    """A trace (d points, n) of global components in the frames (components points, d)."""
    d = frames.shape[1]
    components = len(frames) // points
    blocks = frames.reshape(points, components, d)
    turned = sp.bsr_matrix((blocks, np.arange(points), np.arange(points + 1)), (len(frames), d * points))
    return (turned.tocsr() @ csr(trace)).tocsr()


def _diagonal(blocks: list[sp.csr_matrix]) -> sp.csr_matrix:
    """Blocks on the diagonal of one matrix; SciPy's own way takes ten times its memory."""
    if len(blocks) == 1:
        return blocks[0]
    if not blocks:
        return sp.csr_matrix((0, 0))
    sizes = np.cumsum([0] + [block.shape[0] for block in blocks])
    counts = np.cumsum([0] + [block.nnz for block in blocks])
    starts = [block.indptr[1:].astype(np.int64) + count for block, count in zip(blocks, counts, strict=False)]
    columns = [block.indices + size for block, size in zip(blocks, sizes, strict=False)]
    data = np.concatenate([block.data for block in blocks])
    parts = (data, np.concatenate(columns), np.concatenate([[0], *starts]))
    return sp.csr_matrix(parts, shape=(sizes[-1], sizes[-1]))
