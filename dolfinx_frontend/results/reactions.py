"""Forces of what was assembled into the parts, from their displacements.

Springs and loads have a force at every point, which follows from the displacement there. Supports and glue
have none: their resultants are reactions, from the equilibrium of one of their parts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from dolfinx_frontend.assembly.elements import csr
from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.substructure import Substructure
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.results.answer import Answer, Block, stepped
from dolfinx_frontend.scene.laws import Law

__all__ = ["Reaction", "eliminated_fields", "prescribed_force", "reaction"]

ALIGNED = 1e-9
"""Directions that differ by less are one."""


# --- springs and loads -----------------------------------------------------------------------------
def prescribed_force(interface: Interface, laws: Sequence[Law]) -> Array:
    """Force (T, m, components) that a load prescribes; `laws` as for :func:`eliminated_fields`."""
    return np.stack(
        [law.fields(interface).parameters["force"].reshape(interface.num_points, -1) for law in laws]
    )


def eliminated_fields(
    interface: Interface,
    laws: Sequence[Law],
    displacement: Callable[[str, Ints | None], Array],
) -> tuple[Array, Array]:
    """Force and jump (n, T, m, components) of a spring or load that was assembled into its parts.

    Parameters
    ----------
    laws
        The law at every time, (T,).
    displacement
        Part and numbers of unknowns -> (n, T, unknowns).
    """
    m, d = interface.num_points, interface.dim
    jump: Array = np.zeros(())
    for number, (side, sign) in enumerate(zip(interface.sides, (-1.0, 1.0), strict=False)):
        trace = interface.local_trace(number)
        columns = np.unique(trace.indices).astype(np.int64)
        u = displacement(side.substructure, columns)
        w = (trace[:, columns] @ u.reshape(-1, len(columns)).T).T
        jump = jump + sign * w.reshape(*u.shape[:-1], m, d)
    components = laws[0].count(d)
    jump = jump[..., :components]
    force = np.empty_like(jump)
    if laws[0].prescribes == "force":
        force[:] = prescribed_force(interface, laws)
        return force, jump
    for step, law in enumerate(laws):
        kappa, imposed = (each(interface)[:, :components] for each in (law.stiffnesses, law.jumps))
        force[:, step] = kappa * (jump[:, step] - imposed)
    return force, jump


# --- supports and glue -----------------------------------------------------------------------------
def _held_directions(interface: Interface) -> Array | None:
    """Orthonormal directions (r, d) along which an interface acts at all of its points; None: they vary."""
    d = interface.dim
    count = interface.law.count(d)
    if count == d:
        return np.eye(d)
    rows = interface.law.rows(interface).reshape(-1, count, d)
    return rows[0].copy() if np.abs(rows - rows[0]).max() < ALIGNED else None


def _apart(one: Array | None, other: Array | None) -> bool:
    """Whether two interfaces are known to hold no direction in common."""
    return one is not None and other is not None and bool(np.abs(one @ other.T).max() < ALIGNED)


@dataclass(frozen=True)
class Reaction:
    """Forces at the nodes of one side of an interface that was assembled across.

    Attributes
    ----------
    side
        Its number.
    nodes
        (k,) of its part.
    points
        (k, d), where they are, length.
    """

    side: int
    nodes: Ints = field(repr=False)
    points: Array = field(repr=False)
    _forces: Callable[[Block], Array] = field(repr=False)

    def forces(self, block: Block) -> Array:
        """Forces that the interface exerts on side 1, (n, T, k, d)."""
        return self._forces(block)


def reaction(answer: Answer, name: str, alone: bool = False) -> Reaction | None:
    """The reaction of an interface from the equilibrium of one of its parts, and of what is glued there.

    None: other interfaces that were assembled across hold the same nodes in the same directions; with `alone`
    glue is one of them.
    """
    problem = answer.problem
    interface = problem.interfaces[name]
    own = _held_directions(interface)
    held = np.eye(interface.dim) if own is None else own.T @ own
    for number, side in enumerate(interface.sides):
        holders = _holders(answer, side.substructure, side.nodes, own, (name,))
        far: list[tuple[Ints, Callable[[Block], Array]]] | None = []
        if holders:
            whole = not alone and len(interface.sides) == 1
            far = _through_glue(answer, side.nodes, own, holders) if whole else None
        if far is None:
            continue
        x = problem.substructures[side.substructure].dof_coordinates[side.nodes]
        near = _residual(answer, side.substructure, side.nodes)
        forces = _added(near, far, (1.0 - 2.0 * number) * held)
        return Reaction(number, side.nodes, x, forces)
    return None


def _holders(
    answer: Answer, part: str, nodes: Ints, directions: Array | None, but: Sequence[str]
) -> list[tuple[Interface, int]]:
    """Interfaces that were assembled across, and their sides, that hold nodes of a part in directions."""
    return [
        (other, k)
        for other in answer.problem.interfaces.values()
        for k, each in enumerate(other.sides)
        if other.name not in but
        and other.name not in answer.known
        and each.substructure == part
        and np.isin(nodes, each.nodes).any()
        and not _apart(directions, _held_directions(other))
    ]


def _through_glue(
    answer: Answer, nodes: Ints, directions: Array | None, holders: Sequence[tuple[Interface, int]]
) -> list[tuple[Ints, Callable[[Block], Array]]] | None:
    """What the parts behind glued nodes need there: places in `nodes`, and forces; None: others hold them."""
    found = []
    for glue, k in holders:
        if glue.matching is None:
            return None
        part = glue.sides[1 - k].substructure
        pairs = glue.matching[np.isin(glue.matching[:, k], nodes)]
        behind = pairs[:, 1 - k].astype(np.int64)
        if part not in answer.problem.substructures or _holders(
            answer, part, behind, directions, (glue.name,)
        ):
            return None
        found.append((np.searchsorted(nodes, pairs[:, k]), _residual(answer, part, behind)))
    return found


def _added(
    near: Callable[[Block], Array], far: Sequence[tuple[Ints, Callable[[Block], Array]]], held: Array
) -> Callable[[Block], Array]:
    """Forces at nodes and behind them together, along what is held."""

    def forces(block: Block) -> Array:
        out = near(block)
        for places, each in far:  # each node is in there once
            out[:, :, places] += each(block)
        return np.asarray(out @ held)

    return forces


def _cellwise(
    problem: Problem, part: Substructure, rows: Ints, columns: Ints, strained: Sequence[tuple[str, str]]
) -> Callable[[Array, Array, Sequence[Array]], Array]:
    """Nodal forces (n, T, rows) of a part with a field, of unknowns, its factors, and numbers of strains."""
    stretch = problem.stretch(part.name)
    left = stretch.matrix.tocsc()[:, rows].tocsr()
    touched = np.flatnonzero(np.diff(left.indptr))
    left, right = left[touched], stretch.matrix[touched][:, columns]
    initial = [stretch.initial(part, problem.loads[a].stresses[b])[touched] for a, b in strained]

    def forces(u: Array, factors: Array, numbers: Sequence[Array]) -> Array:
        moved = (right @ u.reshape(-1, u.shape[-1]).T).T.reshape(*u.shape[:2], -1)
        for number, each in zip(numbers, initial, strict=True):
            moved = moved - number[..., None] * each
        moved = factors[:, touched // stretch.components][:, None] * moved
        out: Array = (left.T @ moved.reshape(-1, len(touched)).T).T.reshape(*moved.shape[:2], -1)
        return out

    return forces


def _residual(answer: Answer, name: str, nodes: Ints) -> Callable[[Block], Array]:
    """Forces (n, T, nodes, d) that balance nodes of a part besides loads and forces that are known."""
    problem, times = answer.problem, answer.times
    part = problem.substructures[name]
    d = part.dim
    rows = (d * nodes[:, None] + np.arange(d)).ravel()
    matrix = part.matrix[rows]
    columns = np.unique(matrix.indices).astype(np.int64)
    matrix = matrix[:, columns]
    load = np.array(
        [
            part.load[rows] + sum(a(0.0 if t is None else t) * f[rows] for a, f in part.varying_loads.items())
            for t in ([None] if times is None else times)
        ]
    )
    of_loads = [
        (name, parameter, nodal[rows], parameter in each.stresses)
        for name, each in problem.loads.items()
        for parameter in each.load.values
        if (nodal := each.on(part.name, parameter)) is not None and np.any(nodal[rows])
    ]
    acting = []
    remote = []
    for other in answer.known:
        for sign, each in zip((1.0, -1.0), problem.interfaces[other].sides, strict=False):
            whole = problem.interfaces[other]
            if each.substructure == part.name and whole.wrench is not None:
                number_of = next(k for k, s in enumerate(whole.sides) if s is each)
                remote.append((sign, other, whole.local_trace(number_of)[0].toarray().ravel()[rows]))
                continue
            if each.substructure == part.name and (trace := csr(each.trace).tocsc()[:, rows]).nnz:
                acting.append((sign, answer.surface(other), trace.T.tocsr()))

    strained = [(name, parameter) for name, parameter, _, of_strain in of_loads if of_strain]
    cellwise = _cellwise(problem, part, rows, columns, strained) if part.name in problem.fields else None

    def forces(block: Block) -> Array:
        u = stepped(block.displacement(part.name, columns), times, 1)
        total = (matrix @ u.reshape(-1, len(columns)).T).T.reshape(*u.shape[:2], -1)
        # loads that come from the stiffness change with it
        for of_stiffness in (True, False):
            for name, parameter, nodal, of_strain in of_loads:
                if of_strain is of_stiffness:
                    total = total - stepped(block.load(name, parameter), times, 1)[..., None] * nodal
            if of_stiffness:
                factor = block.factor(part.name)
                if cellwise is not None and factor.ndim > 1:
                    numbers = [stepped(block.load(*each), times, 1) for each in strained]
                    total = cellwise(u, factor, numbers) - load
                else:
                    total = factor[:, None, None] * total - load
        out: Array = total.reshape(*u.shape[:2], -1, d)
        for sign, surface, trace in acting:
            given = answer.load(surface.name)
            force = block.force(surface.name) if given is None else given[None]
            force = surface.vectors(stepped(force, times, 1))
            weighted = np.moveaxis(sign * surface.weights[:, None] * force, (2, 3), (0, 1))  # (m, d, n, T)
            nodal = trace @ weighted.reshape(trace.shape[1], -1)
            out = out - np.moveaxis(nodal.reshape(-1, d, *weighted.shape[2:]), (0, 1), (2, 3))
        for sign, other, nodal in remote:
            given = answer.load(other)
            force = stepped(block.force(other) if given is None else given[None], times, 1)[..., 0, 0]
            out = out - sign * (force[..., None] * nodal).reshape(out.shape)
        return out

    return forces
