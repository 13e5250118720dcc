"""Elimination of linear, fixed interfaces by prolongations: u_e = Z_e q + u0_e.

Substructures that eliminated interfaces connect form a *body* with the unknowns q.  Glued nodes
share their unknowns, prescribed displacements and symmetry planes remove directions, all exactly.
Elastic interfaces stay as springs between members, prescribed forces go into the loads.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import cast

import numpy as np

from dolfinx_frontend.assembly.interface import Interface, frames
from dolfinx_frontend.assembly.meeting import Differing, Off, refuse
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.checks import check_known
from dolfinx_frontend.common.deferred import sp
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.groups import group_labels, grouped
from dolfinx_frontend.plan.ties import differing_ties, ties_of
from dolfinx_frontend.scene.amplitudes import Amplitude
from dolfinx_frontend.scene.laws import Elimination, Law, Rigid
from dolfinx_frontend.scene.loads import LoadTerm

__all__ = [
    "Body",
    "body_load",
    "body_matrix",
    "count_bodies",
    "differ",
    "disagree",
    "displacements",
    "factorised_stiffness",
    "members_of_bodies",
    "reduce",
    "spring_jump",
    "spring_operator",
    "wholly_held",
]


@dataclass(frozen=True)
class Body:
    """Substructures glued together, with n unknowns q.

    Attributes
    ----------
    members
        Names of the substructures.
    n
        Number of unknowns.
    Z
        Member -> Z_e (n_e, n), no unit.
    offset
        Member -> u0_e (n_e,), length.
    load
        Member -> F_e (n_e,), force: body forces and eliminated Pressure and Traction.
    springs
        Names of the eliminated Elastic interfaces on the members.
    off
        What is prescribed differently at common nodes.
    """

    members: tuple[str, ...]
    n: int
    Z: dict[str, sp.csr_matrix] = field(repr=False)
    offset: dict[str, Array] = field(repr=False)
    load: dict[str, Array] = field(repr=False)
    springs: tuple[str, ...]
    off: Differing = field(repr=False)


def _constraint(problem: Problem, interface: Interface, law: Law) -> tuple[Ints, Array, Array]:
    """Nodes, directions (r, d) and values (nodes, r) that a one-sided interface prescribes."""
    side = interface.sides[0]
    x = problem.substructures[side.substructure].dof_coordinates[side.nodes]
    return side.nodes, *law.constraint(interface.name, side, x)


def _nodal_jump(problem: Problem, interface: Interface, law: Law) -> Array:
    """Delta (pairs, d) in global components at the nodes of side 1."""
    side = interface.sides[0]
    x = problem.substructures[side.substructure].dof_coordinates[side.nodes]
    local = law.nodal_jumps(interface.name, x)
    if not np.any(local):
        return local
    basis, _ = frames(side.node_normals, interface.tangent_axis)
    out: Array = np.einsum("pij,pi->pj", basis, local)
    return out


def _free_basis(rows: Array) -> Array:
    """Orthonormal columns (d, f) that span the null space of rows (r, d).

    Coordinate axes come first where they lie in it, so that prolongations stay selections.
    """
    d = rows.shape[1]
    _, s, vt = np.linalg.svd(rows)
    rank = int(np.count_nonzero(s > 1e-6))
    projector = vt[rank:].T @ vt[rank:]
    basis = np.zeros((d, d - rank))
    for k in range(d - rank):
        axis = int(np.argmax(np.round(np.linalg.norm(projector, axis=0), 9)))
        v = projector[:, axis] / np.linalg.norm(projector[:, axis])
        v[np.abs(v) < 1e-15] = 0.0
        unit = np.eye(d)[axis]
        basis[:, k] = unit if np.abs(v - unit).max() < 1e-12 else v
        projector = projector - np.outer(v, v)
    return basis


def members_of_bodies(problem: Problem, eliminate: Container[str]) -> list[list[str]]:
    """Substructures of this rank by body, in the order of the problem."""
    return _grouped(problem, problem.substructures, eliminate)


def count_bodies(problem: Problem, eliminate: Container[str]) -> int:
    """Bodies on all ranks."""
    return len(_grouped(problem, problem.parts, eliminate))


def _grouped(problem: Problem, parts: Mapping[str, object], eliminate: Container[str]) -> list[list[str]]:
    sides = [
        [*(s.substructure for s in i.sides), *i.law.partners]
        for i in problem.interfaces.values()
        if i.name in eliminate
    ]
    pairs = [(s[0], other) for s in sides if parts.keys() >= set(s) for other in s]
    return grouped(list(parts), pairs)


def wholly_held(problem: Problem, removed: Container[str]) -> dict[str, list[str]]:
    """Parts of which removed supports prescribe every displacement -> names of these supports."""
    d = problem.dim
    supports: dict[str, list[Interface]] = {}
    for name, interface in problem.interfaces.items():
        if name in removed:
            supports.setdefault(interface.sides[0].substructure, []).append(interface)
    found = {}
    for name, own in supports.items():
        count = problem.substructures[name].size // d
        # nearly every part has a node on no support, and pays for no more than that
        if sum(len(i.sides[0].nodes) for i in own) < count:
            continue
        if len(np.unique(np.concatenate([i.sides[0].nodes for i in own]))) < count:
            continue
        held = np.zeros((count, d, d))
        for interface in own:
            nodes, directions, _ = _constraint(problem, interface, interface.law.nominal)
            held[nodes] += directions.T @ directions
        if np.linalg.eigvalsh(held).min() > 1e-6:
            found[name] = [i.name for i in own]
    return found


def _check(interface: Interface, law: Law) -> None:
    if law.elimination is None:
        raise SceneError(f"interface {interface.name!r}: {law.title} cannot be eliminated; it is iterated on")
    if law.elimination is Elimination.GLUED and interface.matching is None:
        raise SceneError(
            f"interface {interface.name!r}: {law.title} on meshes that do not match cannot be "
            "eliminated; make the meshes match, keep the interface active, or use a stiff Elastic"
        )


def _shifts(
    problem: Problem, glued: list[tuple[Interface, Law]], start: Mapping[str, int], nodes: int, off: Differing
) -> Array:
    """Offsets (nodes, d) of glued nodes from their common unknowns, that make the jumps Delta."""
    d = problem.dim
    shift = np.zeros((nodes, d))
    parts = [(i, _nodal_jump(problem, i, law)) for i, law in glued]
    if not any(np.any(jump) for _, jump in parts):
        return shift
    first, second, delta, owner = [], [], [], []
    for k, (i, jump) in enumerate(parts):
        assert i.matching is not None
        first.append(i.matching[:, 0] + start[i.sides[0].substructure])
        second.append(i.matching[:, 1] + start[i.sides[1].substructure])
        delta.append(jump)
        owner.append(np.full(len(jump), k))
    a, b = np.concatenate(first), np.concatenate(second)
    step, who = np.concatenate(delta), np.concatenate(owner)
    label = group_labels(nodes, np.stack([a, b], axis=1))
    known = np.zeros(nodes, dtype=bool)
    known[np.unique(label, return_index=True)[1]] = True  # first node of each class
    while True:  # one sweep per link between parts: not more than parts that meet at a node
        forward, backward = known[a] & ~known[b], known[b] & ~known[a]
        if not (forward.any() or backward.any()):
            break
        shift[b[forward]] = shift[a[forward]] + step[forward]
        known[b[forward]] = True
        backward &= ~known[a]
        shift[a[backward]] = shift[b[backward]] - step[backward]
        known[a[backward]] = True

    def said(wrong: Array) -> str:
        names = sorted({glued[k][0].name for k in np.unique(who[wrong.any(axis=1)])})
        return (
            f"interface {names[0]!r}: its jump contradicts those of the interfaces it meets, by "
            f"{wrong.max():.4g}; jumps add up to zero around a common edge"
        )

    off["jumps"] = Off(shift[b] - shift[a] - step, float(np.abs(step).max()), said)
    return shift


@dataclass(frozen=True)
class _Classes:
    """Classes of nodes that are glued to each other, and what supports take from them.

    Attributes
    ----------
    bases
        Bases (d, q) of the displacements that are left free; the first is that of free nodes.
    kind
        (classes,) number of the basis of each class.
    fixed
        (classes, d) displacement that is prescribed.
    """

    bases: list[Array]
    kind: Ints
    fixed: Array


def _held_classes(
    problem: Problem,
    held: Sequence[tuple[Interface, Law]],
    start: Mapping[str, int],
    shift: Array,
    label: Ints,
    off: Differing,
) -> _Classes:
    """The classes (`label` of each node) with the displacements that supports prescribe."""
    d = problem.dim
    classes_count = int(label.max()) + 1
    basis_of = [np.eye(d)]  # basis 0: free nodes
    kind = np.zeros(classes_count, dtype=np.int64)
    fixed = np.zeros((classes_count, d))
    if not held:
        return _Classes(basis_of, kind, fixed)
    # constraints: (node, which interface), directions of each interface, values of each pair
    who, what, rows, values = [], [], [], []
    for k, (i, law) in enumerate(held):
        local, directions, value = _constraint(problem, i, law)
        who.append(local + start[i.sides[0].substructure])
        what.append(np.full(len(local), k))
        rows.append(directions)
        values.append(value - shift[who[-1]] @ directions.T)
    # a jump along a support leaves no more than its rounding there
    largest = max(float(np.abs(each).max(initial=0.0)) for each in (shift, *values))
    node, index = np.concatenate(who), np.concatenate(what)
    place = np.concatenate([np.arange(len(w)) for w in who])
    # entries of a class in the order of interfaces: nodes with the same set form one group
    order = np.lexsort((index, label[node]))
    node, index, place = node[order], index[order], place[order]
    classes, first, length = np.unique(label[node], return_index=True, return_counts=True)
    widest = int(length.max())
    key = np.full((len(classes), widest), -1)
    spot = np.zeros_like(key)
    row = np.repeat(np.arange(len(classes)), length)
    column = np.arange(len(node)) - np.repeat(first, length)
    key[row, column], spot[row, column] = index, place
    # rows that are equal have the same number (np.unique by rows is slow)
    number = np.zeros(len(key), dtype=np.int64)
    for c in range(widest):
        _, number = np.unique(number * (len(held) + 1) + key[:, c] + 1, return_inverse=True)
    _, chosen_rows, group = np.unique(number, return_index=True, return_inverse=True)
    sets = key[chosen_rows]
    for g, keys in enumerate(sets):
        used = [int(k) for k in keys if k >= 0]
        D = np.concatenate([rows[k] for k in used])
        chosen = np.flatnonzero(group == g)
        target = np.concatenate([values[k][spot[chosen, c]] for c, k in enumerate(used)], axis=1)
        value = target @ np.linalg.pinv(D, rcond=1e-6).T
        if len(used) > 1:
            quoted = " and ".join(sorted({repr(held[k][0].name) for k in used}))
            off[str(used)] = Off(value @ D.T - target, largest, partial(differ, quoted, "nodes"))
        kind[classes[chosen]] = len(basis_of)
        fixed[classes[chosen]] = value
        basis_of.append(_free_basis(D))
    return _Classes(basis_of, kind, fixed)


def differ(quoted: str, what: str, wrong: Array) -> str:
    return (
        f"interfaces {quoted} prescribe different displacements at {np.count_nonzero(wrong.any(axis=1))} "
        f"common {what} (up to {wrong.max():.4g} off their compromise); make them agree or shrink a face"
    )


def _prolongation(classes: _Classes, own: Ints, columns: Ints) -> sp.csr_matrix:
    """Z (d * nodes, unknowns) of a member with nodes in the classes `own`; unknowns start at `columns`."""
    d = classes.fixed.shape[1]
    entries: list[tuple[Ints, Ints, Array]] = [(np.zeros(0, int), np.zeros(0, int), np.zeros(0))]
    for k, basis in enumerate(classes.bases):
        chosen = np.flatnonzero(classes.kind[own] == k)
        r, c = np.nonzero(basis)
        if not chosen.size or not r.size:
            continue
        at_row = (d * chosen[:, None] + r).ravel()
        at_column = (columns[own[chosen]][:, None] + c).ravel()
        entries.append((at_row, at_column, np.tile(basis[r, c], len(chosen))))
    row, column, value = (np.concatenate(t) for t in zip(*entries, strict=True))
    return sp.csr_matrix((value, (row, column)), shape=(d * len(own), int(columns[-1])))


def _joined(
    problem: Problem,
    inside: Iterable[Interface],
    laws: Mapping[str, Law],
    start: Mapping[str, int],
    nodes: int,
    off: Differing,
) -> tuple[Ints, Array, _Classes]:
    """Class of each of the nodes that interfaces glue, its offset from that class, and what supports take;
    where they disagree a compromise, and how far it is `off`."""
    glued = [(i, laws[i.name]) for i in inside if laws[i.name].elimination is Elimination.GLUED]
    held = [(i, laws[i.name]) for i in inside if laws[i.name].elimination is Elimination.REMOVED]
    pairs = [
        i.matching + [start[s.substructure] for s in i.sides] for i, _ in glued if i.matching is not None
    ]
    label = group_labels(nodes, np.concatenate(pairs) if pairs else [])
    shift = _shifts(problem, glued, start, nodes, off)
    return label, shift, _held_classes(problem, held, start, shift, label, off)


def disagree(
    problem: Problem,
    members: list[str],
    inside: list[Interface],
    laws: Mapping[str, Law],
    off: Differing,
) -> None:
    """Add to `off` what the interfaces inside a body prescribe differently."""
    ends = np.cumsum([0, *(len(problem.substructures[m].dof_coordinates) for m in members)])
    start = {m: int(end) for m, end in zip(members, ends, strict=False)}
    label, shift, classes = _joined(problem, inside, laws, start, int(ends[-1]), off)
    tied = [(i, cast(Rigid, laws[i.name])) for i in inside if i.law.elimination is Elimination.TIED]
    differing_ties(problem, tied, start, classes.bases, classes.kind, classes.fixed, shift, label, off)


def _body(
    problem: Problem,
    members: list[str],
    laws: Mapping[str, Law],
    inside: list[Interface],
    amplitude: Amplitude | None,
    without: Container[LoadTerm],
) -> Body:
    counts = np.array([len(problem.substructures[m].dof_coordinates) for m in members])
    starts = np.concatenate([[0], np.cumsum(counts)])
    start = {m: int(s) for m, s in zip(members, starts, strict=False)}
    by_way: dict[Elimination | None, list[Interface]] = {way: [] for way in Elimination}
    for i in inside:
        by_way[laws[i.name].elimination].append(i)
    off: Differing = {}
    label, shift, classes = _joined(problem, inside, laws, start, int(starts[-1]), off)

    # columns: the unknowns of a class are consecutive
    free = np.array([basis.shape[1] for basis in classes.bases])[classes.kind]
    columns = np.concatenate([[0], np.cumsum(free)])
    prolongation: dict[str, sp.csr_matrix] = {}
    offset: dict[str, Array] = {}
    tied = [(i, cast(Rigid, laws[i.name])) for i in by_way[Elimination.TIED]]
    of_classes = (classes.bases, classes.kind, classes.fixed, shift, label, columns)
    ties = ties_of(problem, tied, start, *of_classes, off)
    size = int(columns[-1]) if ties is None else ties.left.shape[1]
    if size == 0:
        raise SceneError(f"{', '.join(members)}: every displacement is prescribed; nothing is left")
    for m, count, s in zip(members, counts, starts, strict=False):
        own = label[s : s + count]
        prolongation[m] = _prolongation(classes, own, columns)
        offset[m] = (classes.fixed[own] + shift[s : s + count]).ravel()
        if ties is not None:
            offset[m] = offset[m] + prolongation[m] @ ties.given
            prolongation[m] = (prolongation[m] @ ties.left).tocsr()

    load = {m: problem.load_on(m, amplitude, without) for m in members}
    for i in by_way[Elimination.LOAD]:
        given = laws[i.name].load(i)
        if given is not None:
            f = (i.weights[:, None] * given).ravel()
            load[i.sides[0].substructure] += i.local_trace(0).T @ f
    springs = tuple(i.name for i in by_way[Elimination.SPRINGS])
    return Body(tuple(members), size, prolongation, offset, load, springs, off)


def reduce(
    problem: Problem,
    eliminate: Iterable[str],
    laws: Mapping[str, Law] | None = None,
    amplitude: Amplitude | None = None,
    without: Container[LoadTerm] = (),
    agree: bool = True,
) -> list[Body]:
    """Bodies that remain when interfaces are assembled across.

    Parameters
    ----------
    problem
        Assembled scene.
    eliminate
        Names of the interfaces; the others stay active and restrict nothing here.
    laws
        Laws to use instead of those of the problem.
    amplitude
        Amplitude whose part of the body forces is taken; None: the constant part.
    without
        Numbers of loads of parts that are left out.
    agree
        False: what is prescribed at common nodes may differ, as of one of several load patterns.

    Returns
    -------
    list of Body
        In the order of their first members.  Every substructure belongs to one.

    Raises
    ------
    SceneError
        Perfect interfaces on non-matching meshes, nonlinear laws or not fixed, curved
        symmetry faces, prescribed displacements or jumps that contradict each other.
    """
    chosen = set(eliminate)
    current = {name: i.law for name, i in problem.interfaces.items()} | dict(laws or {})
    for name in chosen:
        check_known("interface", name, problem.interfaces)
        _check(problem.interfaces[name], current[name])
    bodies = []
    for members in members_of_bodies(problem, chosen):
        inside = [
            i
            for i in problem.interfaces.values()
            if i.name in chosen and i.sides[0].substructure in members
        ]
        bodies.append(_body(problem, members, current, inside, amplitude, without))
        if agree:
            refuse({None: bodies[-1].off}, [0.0])
    return bodies


def spring_operator(problem: Problem, body: Body, name: str, law: Law) -> tuple[sp.csr_matrix, Array, Array]:
    """Jump operator of a spring between members.

    Returns
    -------
    B, B0, stiffness
        j = B q + B0 (d*m rows, local frame) and kappa times weight (d*m,).
    """
    i = problem.interfaces[name]
    B = sp.csr_matrix((i.dim * i.num_points, body.n))
    B0 = np.zeros(B.shape[0])
    for k, side in enumerate(i.sides):
        T = i.local_trace(k)
        sign = 1.0 if k == 1 else -1.0
        B = B + sign * (T @ body.Z[side.substructure])
        B0 = B0 + sign * (T @ body.offset[side.substructure])
    return B.tocsr(), B0, (i.weights[:, None] * law.stiffnesses(i)).ravel()


def spring_jump(problem: Problem, name: str, u: Mapping[str, Array]) -> Array:
    """Jump j = w_2 - w_1 (m, d[, columns]) in the local frame, of displacements (n[, columns]) by part."""
    i = problem.interfaces[name]
    jump = -(i.local_trace(0) @ u[i.sides[0].substructure])
    if len(i.sides) == 2:
        jump = jump + i.local_trace(1) @ u[i.sides[1].substructure]
    out: Array = jump.reshape(i.num_points, i.dim, *jump.shape[1:])
    return out


SOFT, STIFF = 1e-8, 1e5
"""Range of kappa, relative to the stiffness of the softer part, that is factorised as it is where corrections
follow: beyond it rounding would take more than corrections give back."""


def factorised_stiffness(problem: Problem, interface: Interface, kappa: Array) -> Array:
    """kappa of a spring as it is factorised where corrections follow: brought into that range."""
    unit = interface.stiffness_unit(problem.substructures)
    return np.where(kappa > 0.0, np.clip(kappa, SOFT * unit, STIFF * unit), kappa)


def _law(problem: Problem, laws: Mapping[str, Law] | None, name: str) -> Law:
    return laws[name] if laws is not None and name in laws else problem.interfaces[name].law


def body_matrix(problem: Problem, body: Body, laws: Mapping[str, Law] | None = None) -> sp.csr_matrix:
    """sum Z^T K Z over the members, plus the springs; (n, n), force / length."""
    K = sp.csr_matrix((body.n, body.n))
    for m in body.members:
        Z = body.Z[m]
        K = K + Z.T @ problem.substructures[m].matrix @ Z
    for name in body.springs:
        B, _, k = spring_operator(problem, body, name, _law(problem, laws, name))
        K = K + B.T @ sp.diags(k) @ B
    return K.tocsr()


def body_load(problem: Problem, body: Body, laws: Mapping[str, Law] | None = None) -> Array:
    """Right-hand side that belongs to :func:`body_matrix`, (n,), force."""
    f = np.zeros(body.n)
    for m in body.members:
        K = problem.substructures[m].matrix
        f += body.Z[m].T @ (body.load[m] - K @ body.offset[m])
    for name in body.springs:
        law = _law(problem, laws, name)
        B, B0, k = spring_operator(problem, body, name, law)
        f += B.T @ (k * (law.jumps(problem.interfaces[name]).ravel() - B0))
    return f


def displacements(body: Body, q: Array) -> dict[str, Array]:
    """u_e = Z_e q + u0_e of the members."""
    return {m: body.Z[m] @ q + body.offset[m] for m in body.members}
