"""Faces that are tied to rigid motions: what is left of the unknowns of a body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.meeting import Differing, Off
from dolfinx_frontend.assembly.part_loads import fitting
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.rigid import rigid_modes
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.deferred import sp
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.scene.amplitudes import Amplitude
from dolfinx_frontend.scene.laws import Rigid

__all__ = ["Ties", "differing_ties", "given_at", "given_motions", "ties_of"]

_LEVEL = 1e-6
"""Sines of angles below this are rounding of the mesh."""


@dataclass(frozen=True)
class Ties:
    """Unknowns of a body before = left @ (unknowns after) + given; (before, after) and (before,)."""

    left: sp.csr_matrix
    given: Array


@dataclass(frozen=True)
class _Group:
    """A group of faces: its leading law, nodes of the body (p,), their classes and coordinates (p, d)."""

    law: Rigid
    normal: Array
    nodes: Ints
    classes: Ints
    x: Array
    around: bool

    @property
    def where(self) -> str:
        """What it is in a message."""
        return f"{'plane' if self.law.plane else 'rigid'} face {self.law.group!r}"


def given_motions(law: Rigid, centre: Array, length: float) -> tuple[Array, Array]:
    """Rows (k, r) and values (k,) of the motions that are given, about a centre; rotations over the
    length."""
    d = len(centre)
    place = centre if law.point is None else fitting(f"rigid face {law.group!r}", "point", law.point, d)
    at = rigid_modes(place[None], centre, length)[0]
    rows, values = [], []
    for name, value in law.motions().items():
        if name == "n":
            continue
        if name[0] == "r":
            row = np.zeros(at.shape[1])
            row[-1 if d == 2 else d + "xyz".index(name[1])] = 1.0 / length
        else:
            row = at["xyz".index(name)]
        rows.append(row)
        values.append(value)
    return np.reshape(rows, (len(rows), at.shape[1])), np.array(values)


def _frame(x: Array) -> tuple[Array, float]:
    """Centre of points (p, d), whatever meshes have in common there, and their distance from it."""
    places = np.unique(x, axis=0)
    centre = places.mean(axis=0)
    return centre, max(float(np.sqrt(((places - centre) ** 2).sum(axis=1).mean())), 1e-300)


def given_at(
    problem: Problem, interface: Interface, amplitude: Amplitude | None, x: Array
) -> tuple[Array, Array, float]:
    """What the given motions of a rigid or plane face make of points x (m, d): directions (k, d) along which
    they alone prescribe displacements, those (m, k), and how far the whole face is moved."""
    law, d = cast(Rigid, interface.law), x.shape[1]
    group = [i for i in problem.interfaces.values() if isinstance(i.law, Rigid) and i.law.group == law.group]
    lead = next((i for i in group if cast(Rigid, i.law).leads), interface)
    own = cast(Rigid, lead.law.pattern(amplitude))
    if own.plane:
        given = np.array([] if own.tilts else list(own.motions().values()), dtype=np.float64)
        moved = float(np.abs(given).sum())
        return lead.sides[0].normal[None][: len(given)], np.tile(given, (len(x), 1)), moved
    nodes = [problem.substructures[i.sides[0].substructure].dof_coordinates[i.sides[0].nodes] for i in group]
    centre, length = _frame(np.concatenate(nodes))
    rows, values = given_motions(own, centre, length)
    known, modes = np.linalg.pinv(rows), rigid_modes(x, centre, length)
    motion = known @ values
    axes = [c for c in range(d) if np.abs(modes[:, c] - modes[:, c] @ known @ rows).max() < _LEVEL]
    return np.eye(d)[axes], modes[:, axes] @ motion, float(np.abs(motion).max(initial=0.0))


def _groups(
    problem: Problem, tied: Sequence[tuple[Interface, Rigid]], start: dict[str, int], label: Ints
) -> list[_Group]:
    by_name: dict[str, list[tuple[Interface, Rigid]]] = {}
    for each in tied:
        by_name.setdefault(each[1].group, []).append(each)
    groups = []
    for name, members in by_name.items():
        law = next((law for _, law in members if law.leads), members[0][1])
        normal = members[0][0].sides[0].normal
        nodes, x = [], []
        for interface, _ in members:
            side = interface.sides[0]
            if law.plane:
                off = float(np.linalg.norm(side.normal - np.sign(side.normal @ normal) * normal))
                if side.flatness > _LEVEL or off > _LEVEL:
                    raise SceneError(
                        f"interface {interface.name!r}: {side.substructure}:{side.face} cannot be kept plane "
                        f"with group {name!r}: it is curved or not parallel to the first face (off by "
                        f"{max(off, side.flatness):.3g}); use scene.rigid"
                    )
            nodes.append(side.nodes + start[side.substructure])
            x.append(problem.substructures[side.substructure].dof_coordinates[side.nodes])
        every = np.concatenate(nodes)
        classes, first = np.unique(label[every], return_index=True)
        around = problem.substructures[members[0][0].sides[0].substructure].around
        groups.append(_Group(law, normal, every[first], classes, np.concatenate(x)[first], around))
    seen: dict[int, str] = {}
    for group in groups:
        for c in group.classes:
            other = seen.setdefault(int(c), group.law.group)
            if other != group.law.group:
                raise SceneError(
                    f"rigid faces {other!r} and {group.law.group!r} share nodes: make them one group, or "
                    "shrink one"
                )
    return groups


def ties_of(
    problem: Problem,
    tied: Sequence[tuple[Interface, Rigid]],
    start: dict[str, int],
    bases: Sequence[Array],
    kind: Ints,
    fixed: Array,
    shift: Array,
    label: Ints,
    columns: Ints,
    off: Differing,
) -> Ties | None:
    """What the tied faces of a body leave of its unknowns; None: there are none.

    Parameters
    ----------
    bases, kind, fixed
        Of the classes of glued nodes: free displacements, and what supports prescribe.
    shift
        (nodes, d) of nodes from their classes.
    label, columns
        Class of every node, and first unknown of every class.
    off
        What supports and given motions prescribe differently is added to it.
    """
    if not tied:
        return None
    count = np.diff(columns)
    left = count.copy()
    own: dict[int, tuple[Array, Array, Array]] = {}  # class -> (f, kept), (f, modes), (f,)
    masters: list[tuple[_Group, Array]] = []
    for group in _groups(problem, tied, start, label):
        motions, found = _of_group(group, bases, kind, fixed, shift, off)
        for c, each in found.items():
            own[c] = each
            left[c] = each[0].shape[1]
        masters.append((group, motions))
    first = np.concatenate([[0], np.cumsum(left)])
    row: list[int] = []
    column: list[int] = []
    value: list[float] = []
    given = np.zeros(int(columns[-1]))
    free = np.ones(len(count), dtype=bool)
    free[list(own)] = False
    for c in np.flatnonzero(free):
        row.extend(range(columns[c], columns[c + 1]))
        column.extend(range(first[c], first[c + 1]))
    value.extend([1.0] * len(row))

    def put(at: int, to: int, block: Array) -> None:
        r, c = np.nonzero(block)
        row.extend(at + r)
        column.extend(to + c)
        value.extend(block[r, c])

    last = int(first[-1])
    for group, motions in masters:
        for c in group.classes:
            kept, of_motions, constant = own[int(c)]
            put(columns[c], int(first[c]), kept)
            put(columns[c], last, of_motions)
            given[columns[c] : columns[c + 1]] = constant
        last += motions.shape[1]
    matrix = sp.csr_matrix((value, (row, column)), shape=(int(columns[-1]), last))
    return Ties(matrix, given)


def differing_ties(
    problem: Problem,
    tied: Sequence[tuple[Interface, Rigid]],
    start: dict[str, int],
    bases: Sequence[Array],
    kind: Ints,
    fixed: Array,
    shift: Array,
    label: Ints,
    off: Differing,
) -> None:
    """Add to `off` what supports and given motions prescribe differently; arguments as :func:`ties_of`."""
    for group in _groups(problem, tied, start, label):
        _solved(group, *_equations(group, bases, kind, fixed, shift)[1:], off)


def _equations(
    group: _Group, bases: Sequence[Array], kind: Ints, fixed: Array, shift: Array
) -> tuple[Array, Array, Array]:
    """What the motions (r,) of a group make of its points, (p, d, r) or (p, r) along the normal, and what is
    given of them: rows (k, r) and values (k,)."""
    law, x = group.law, group.x
    d = x.shape[1]
    centre, length = _frame(x)
    modes = rigid_modes(x, centre, length)
    if law.plane:
        along = np.einsum("i,pir->pr", group.normal, modes)
        _, s, vt = np.linalg.svd(along, full_matrices=False)
        span = vt[s > 1e-9 * s[0]].T
        if not law.tilts:
            span = np.concatenate([group.normal, np.zeros(modes.shape[2] - d)])[:, None]
        modes = along @ span
        rows = np.eye(1) if "n" in law.motions() else np.zeros((0, span.shape[1]))
        values = np.array([*law.motions().values()])
    else:
        rows, values = given_motions(law, centre, length)
    if group.around:  # the only rigid motion is that along the axis
        if law.plane and not law.tilts and abs(group.normal[1]) < 1.0 - _LEVEL:
            pass  # all points move alike along the radius
        elif law.plane:
            rows, values = np.vstack([rows, span[2:]]), np.append(values, np.zeros(len(span[2:])))
        else:
            rows = np.vstack([rows, np.eye(3)[[0, 2]]])
            values = np.append(values, np.zeros(2))
    # what supports leave of the displacements of a node has to be a displacement of the rigid motion
    equations, wanted = [rows], [values]
    for k, c in enumerate(group.classes):
        basis = bases[kind[c]]
        base = fixed[c] + shift[group.nodes[k]]
        if law.plane and np.linalg.norm(basis.T @ group.normal) < _LEVEL:
            equations.append(modes[k][None])
            wanted.append(np.array([group.normal @ base]))
        elif not law.plane and basis.shape[1] < d:
            held = np.eye(d) - basis @ basis.T
            equations.append(held @ modes[k])
            wanted.append(held @ base)
    return modes, np.concatenate(equations), np.concatenate(wanted)


def _of_group(
    group: _Group, bases: Sequence[Array], kind: Ints, fixed: Array, shift: Array, off: Differing
) -> tuple[Array, dict[int, tuple[Array, Array, Array]]]:
    """Motions (k, free) that are left to a group, and what its classes make of them."""
    modes, rows, values = _equations(group, bases, kind, fixed, shift)
    motions, constant = _solved(group, rows, values, off)
    found = {}
    for k, c in enumerate(group.classes):
        first = bases[kind[c]]
        f = first.shape[1]
        base = fixed[c] + shift[group.nodes[k]]
        if not group.law.plane:
            along_basis = first.T @ modes[k]
            found[int(c)] = (np.zeros((f, 0)), along_basis @ motions, along_basis @ constant - first.T @ base)
            continue
        share = first.T @ group.normal
        size = float(np.linalg.norm(share))
        if size < _LEVEL:
            found[int(c)] = (np.eye(f), np.zeros((f, motions.shape[1])), np.zeros(f))
            continue
        if size < 1.0 - _LEVEL:
            raise SceneError(
                f"{group.where}: a support holds some of its nodes at an angle to its normal; shrink one of "
                "the faces"
            )
        share = share / size
        _, _, vt = np.linalg.svd(share[None])
        moved = share * (modes[k] @ constant - group.normal @ base)
        found[int(c)] = (vt[1:].T, np.outer(share, modes[k] @ motions), moved)
    return motions, found


def _solved(group: _Group, rows: Array, values: Array, off: Differing) -> tuple[Array, Array]:
    """Motions (k, free) that satisfy homogeneous equations, and a particular one (k,)."""
    if not len(rows):
        return np.eye(rows.shape[1]), np.zeros(rows.shape[1])
    _, s, vt = np.linalg.svd(rows, full_matrices=True)
    rank = int(np.count_nonzero(s > _LEVEL * max(1.0, float(s[0]))))
    constant = np.linalg.pinv(rows, rcond=_LEVEL / max(1.0, float(s[0])) if s[0] > 0 else 1.0) @ values

    def said(wrong: Array) -> str:
        return (
            f"{group.where}: its supports and given motions contradict each other, by {wrong.max():.4g}: no "
            "rigid motion does both; give others or shrink a face"
        )

    off[group.where] = Off((rows @ constant - values)[:, None], float(np.abs(values).max()), said)
    return vt[rank:].T, constant
