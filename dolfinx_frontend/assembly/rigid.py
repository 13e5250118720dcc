"""Rigid bodies: their modes, and the search for parts that nothing holds.

Every interface gives a small Gram matrix of the relative rigid motions that it resists.  Parts that
are held completely by one another are merged first, so that what remains is small even for a
thousand parts; its null space is the set of free motions.

What is judged is the discretised structure: a frictionless joint between faceted or parabolic faces
resists turning a little, and is not reported although it would turn freely on a true circle.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.deferred import sp, spla
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.groups import group_labels

__all__ = [
    "FreeMotions",
    "Resistance",
    "check_resistances",
    "check_rigid_bodies",
    "free_motions",
    "quoted",
    "resistance",
    "rigid_modes",
]

_TOLERANCE = 1e-10
"""Eigenvalues of a Gram matrix with unit diagonal below this are zero (thin faces reach 1e-8)."""

_NOISE = 1e-12
"""Diagonal entries below this part of the largest are rounding errors, i.e. zero."""

_DENSE = 1500
"""Largest null-space problem that is solved by a dense eigenvalue decomposition."""


def rigid_modes(x: Array, centre: Array, length: float) -> Array:
    """Rigid motions at points.

    Parameters
    ----------
    x
        (p, d), points.
    centre, length
        Rotations are about the centre and divided by the length.

    Returns
    -------
    Array
        (p, d, r): d translations, then the rotation(s) (about x, y, z in 3D).
    """
    p, d = x.shape
    r = (x - centre) / length
    out = np.zeros((p, d, 3 if d == 2 else 6))
    out[:, :, :d] = np.eye(d)
    if d == 2:
        out[:, 0, 2], out[:, 1, 2] = -r[:, 1], r[:, 0]
    else:
        for k in range(3):  # e_k x r
            after, last = (k + 1) % 3, (k + 2) % 3
            out[:, after, 3 + k], out[:, last, 3 + k] = -r[:, last], r[:, after]
    return out


def _transfer(d: int, old: tuple[Array, float], new: tuple[Array, float]) -> Array:
    """(r, r): coordinates of a motion about `old` -> about `new` (centre, length)."""
    r = 3 if d == 2 else 6
    S = np.eye(r)
    S[d:, d:] *= new[1] / old[1]
    S[:d, d:] = rigid_modes(new[0][None, :], old[0], old[1])[0][:, d:]
    return S


@dataclass
class _Link:
    """What one interface resists: two clusters, and the Gram matrix about its own origin."""

    first: int
    second: int
    gram: Array
    origin: tuple[Array, float]


def _holds_all(gram: Array) -> bool:
    """Whether a Gram matrix has full rank."""
    diagonal = np.diag(gram)
    if diagonal.min() <= _NOISE * diagonal.max():
        return False
    scaled = gram / np.sqrt(np.outer(diagonal, diagonal))
    return bool(np.linalg.eigvalsh(scaled)[0] > _TOLERANCE)


def _merge(links: list[_Link], labels: Ints, d: int) -> Ints:
    """Unite clusters that hold each other completely, until no more do."""
    while True:
        pairs: dict[tuple[int, int], list[_Link]] = {}
        for link in links:
            a, b = sorted((int(labels[link.first]), int(labels[link.second])))
            if a != b:
                pairs.setdefault((a, b), []).append(link)
        united = []
        for pair, members in pairs.items():
            centre = np.mean([m.origin[0] for m in members], axis=0)
            length = max(m.origin[1] + float(np.linalg.norm(m.origin[0] - centre)) for m in members)
            gram = np.zeros_like(members[0].gram)
            for m in members:
                S = _transfer(d, (centre, length), m.origin)
                gram += S.T @ m.gram @ S
            if _holds_all(gram):
                united.append(pair)
        if not united:
            return labels
        # the ground stays cluster 0, as the first member of its group
        labels = group_labels(int(labels.max()) + 1, united)[labels]


def _assembled(blocks: list[tuple[int, int, Array]], clusters: int, r: int) -> sp.csr_matrix:
    """Sum of (r, r) blocks at block rows and columns."""
    n = r * clusters
    if not blocks:
        return sp.csr_matrix((n, n))
    row, column = (np.array([b[k] for b in blocks])[:, None, None] * r for k in (0, 1))
    inner = np.arange(r)
    shape = (len(blocks), r, r)
    i = np.broadcast_to(row + inner[:, None], shape).ravel()
    j = np.broadcast_to(column + inner, shape).ravel()
    return sp.csr_matrix((np.concatenate([b[2] for b in blocks]).ravel(), (i, j)), shape=(n, n))


def _null_space(gram: sp.csr_matrix) -> Array:
    """Null space of a Gram matrix, (n, nullity)."""
    diagonal = gram.diagonal()
    held = diagonal > _NOISE * diagonal.max()
    scale = np.where(held, np.sqrt(np.abs(diagonal)), 1.0)
    D = sp.diags(1.0 / scale)
    scaled = (D @ gram @ D).tocsc()
    n = scaled.shape[0]
    if n <= _DENSE:
        values, vectors = np.linalg.eigh(scaled.toarray())
    else:
        # shift-and-invert just below zero; 24 vectors tell more than a message can hold
        values, vectors = spla.eigsh(scaled, k=24, sigma=-1e-6, which="LM")
    out: Array = vectors[:, values < _TOLERANCE] / scale[:, None]
    return out


def _vector(v: Array) -> str:
    return "(" + ", ".join(f"{0.0 if abs(c) < 5e-4 else c:.3g}" for c in v) + ")"


def _direction(v: Array) -> str:
    v = v / np.linalg.norm(v)
    v = v * np.sign(v[np.argmax(np.abs(v))])
    for k, axis in enumerate("xyz"[: len(v)]):
        if v[k] > 1 - 1e-6:
            return axis
    return _vector(v)


def _echelon(rows: Array) -> Array:
    """Row-reduced basis of the row space: shows coordinate axes where they span it."""
    rows = rows.copy()
    done = 0
    for column in range(rows.shape[1]):
        if done == len(rows):
            break
        pivot = done + int(np.argmax(np.abs(rows[done:, column])))
        if abs(rows[pivot, column]) < 1e-6:
            continue
        rows[[done, pivot]] = rows[[pivot, done]]
        rows[done] /= rows[done, column]
        for other in range(len(rows)):
            if other != done:
                rows[other] -= rows[other, column] * rows[done]
        done += 1
    return rows


def _describe(motions: Array, origin: tuple[Array, float], d: int) -> list[str]:
    """Words for the motions (r, q) of one cluster about its origin."""
    u, s, _ = np.linalg.svd(motions, full_matrices=False)
    span = u[:, s > 1e-6 * s[0]]
    u, s, vt = np.linalg.svd(span[d:], full_matrices=True)
    rank = int(np.count_nonzero(s > 1e-6))
    out = [f"translation along {_direction(v)}" for v in _echelon((span @ vt[rank:].T)[:d].T)]
    translations = (span @ vt[rank:].T)[:d]
    for motion in _echelon((span @ vt[:rank].T)[::-1].T)[:, ::-1]:
        v, w = motion[:d], motion[d:] / origin[1]
        if translations.size:
            v = v - translations @ np.linalg.lstsq(translations, v, rcond=None)[0]
        if d == 2:
            point = origin[0] + np.array([-v[1], v[0]]) / w[0]
            out.append(f"rotation about {_vector(point)}")
        else:
            point = origin[0] + np.cross(w, v) / (w @ w)
            out.append(f"rotation about {_direction(w)} through {_vector(point)}")
    return out


Resistance = tuple[tuple[str, ...], Array, tuple[Array, float]]
"""Names of the parts of an interface, Gram matrix of the rigid motions that it resists, and what about."""


def resistance(sides: tuple[str, ...], x: Array, weights: Array, rows: Array, size: float) -> Resistance:
    """What an interface resists.

    Parameters
    ----------
    sides
        Names of one or two parts.
    x, weights, rows
        Points (m, d), weights (m,), and (m, r, d) directions in which the interface holds.
    size
        Length of the first part.
    """
    share = weights / weights.sum()
    centre = share @ x
    length = float(np.sqrt(share @ np.sum((x - centre) ** 2, axis=1)))
    origin = (centre, max(length, 1e-12 * size))
    G = np.einsum("pri,pij->prj", rows, rigid_modes(x, *origin)) * np.sqrt(share)[:, None, None]
    G = G.reshape(-1, G.shape[2])
    return sides, G.T @ G, origin


@dataclass(frozen=True)
class FreeMotions:
    """Rigid motions that a set of interfaces does not resist.

    Attributes
    ----------
    groups
        Names of parts that hold one another, group by group; groups that are held are absent.
    origins
        (centre, length) of every group: its motion is about the centre, rotations over the length.
    basis
        (groups, r, q), q independent motions; empty if everything is held.
    """

    groups: tuple[tuple[str, ...], ...]
    origins: tuple[tuple[Array, float], ...]
    basis: Array

    def __len__(self) -> int:
        return int(self.basis.shape[2])

    def at(self, part: str, x: Array) -> Array:
        """Displacements (points, d, q) of a part's points (points, d); 0 if it is held."""
        for names, origin, motion in zip(self.groups, self.origins, self.basis, strict=True):
            if part in names:
                return np.asarray(rigid_modes(x, *origin) @ motion)
        return np.zeros((*x.shape, len(self)))

    def describe(self, combination: Array) -> list[tuple[tuple[str, ...], list[str]]]:
        """The groups that move in combinations (q, k) of the motions, with words for how."""
        motion = self.basis @ combination
        sizes = np.abs(motion).max(axis=(1, 2), initial=0.0)
        return [
            (names, _describe(motion[k], self.origins[k], len(self.origins[k][0])))
            for k, names in enumerate(self.groups)
            if sizes[k] > 1e-6 * sizes.max()
        ]


def free_motions(parts: Mapping[str, tuple[Array, float]], resistances: Sequence[Resistance]) -> FreeMotions:
    """Rigid motions of the parts that no interface resists; arguments as check_resistances."""
    names = list(parts)
    first_centre, _ = next(iter(parts.values()))
    d = len(first_centre)
    r = 3 if d == 2 else 6
    nothing = FreeMotions((), (), np.zeros((0, r, 0)))
    number = {name: k + 1 for k, name in enumerate(names)}  # 0 is the ground
    links: list[_Link] = []
    for sides, gram, origin in resistances:
        second = number[sides[1]] if len(sides) == 2 else 0
        links.append(_Link(number[sides[0]], second, gram, origin))
    labels = _merge(links, np.arange(len(names) + 1), d)
    clusters = int(labels.max())
    if clusters == 0:
        return nothing
    origins: dict[int, tuple[Array, float]] = {}
    for c in range(1, clusters + 1):
        members = [parts[n] for n in names if labels[number[n]] == c]
        centre = np.mean([m[0] for m in members], axis=0)
        length = max(m[1] + float(np.linalg.norm(m[0] - centre)) for m in members)
        origins[c] = (centre, length)
    blocks: list[tuple[int, int, Array]] = []
    for link in links:
        ends = [(int(labels[link.first]), 1.0), (int(labels[link.second]), -1.0)]
        if ends[0][0] == ends[1][0]:
            continue
        maps = [(c, sign * _transfer(d, origins[c], link.origin)) for c, sign in ends if c > 0]
        for a, A in maps:
            for b, B in maps:
                blocks.append((a - 1, b - 1, A.T @ link.gram @ B))
    component = group_labels(clusters, [(a, b) for a, b, _ in blocks])
    # motions of every group of clusters that has some
    found: list[tuple[Ints, Array]] = []
    for k in range(int(component.max()) + 1):
        inside = np.flatnonzero(component == k)
        place = {int(c): i for i, c in enumerate(inside)}
        mine = [(place[a], place[b], block) for a, b, block in blocks if a in place]
        null = _null_space(_assembled(mine, len(inside), r))
        if null.size:
            found.append((inside, null))
    if not found:
        return nothing
    groups, about, basis = [], [], []
    start, total = 0, sum(null.shape[1] for _, null in found)
    for inside, null in found:
        blocked = null.reshape(len(inside), r, -1)
        sizes = np.abs(blocked).max(axis=(1, 2))
        for i in np.flatnonzero(sizes > 1e-6 * sizes.max()):
            motion = np.zeros((r, total))
            motion[:, start : start + null.shape[1]] = blocked[i]
            basis.append(motion)
            c = int(inside[i]) + 1
            groups.append(tuple(n for n in names if labels[number[n]] == c))
            about.append(origins[c])
        start += null.shape[1]
    return FreeMotions(tuple(groups), tuple(about), np.array(basis))


def quoted(names: Sequence[str], most: int = 6) -> str:
    """Names in quotes, the first few of them."""
    return ", ".join(repr(n) for n in names[:most]) + (", ..." if len(names) > most else "")


def check_rigid_bodies(
    parts: Mapping[str, tuple[Array, float]],
    interfaces: Mapping[str, tuple[tuple[str, ...], Array, Array, Array]],
) -> None:
    """Raise if parts can move without any resistance.

    Parameters
    ----------
    parts
        Name -> (centre, length).
    interfaces
        Name -> (names of one or two parts, points (m, d), weights (m,), rows (m, r, d) of the
        directions in which the interface holds).

    Raises
    ------
    SceneError
        Names the parts, their free motions and the remedy.
    """
    check_resistances(parts, [resistance(*each, parts[each[0][0]][1]) for each in interfaces.values()])


def check_resistances(parts: Mapping[str, tuple[Array, float]], resistances: Sequence[Resistance]) -> None:
    """Raise if parts can move without any resistance, see :func:`check_rigid_bodies`.

    Parameters
    ----------
    parts
        Name -> (centre, length).
    resistances
        What every interface resists, see :func:`resistance`.
    """
    motions = free_motions(parts, resistances)
    messages = [
        f"{quoted(names)} can move freely: {'; '.join(words)}"
        for names, words in motions.describe(np.eye(len(motions)))
    ]
    if messages:
        shown = "\n".join(f"  {m}" for m in messages[:6])
        if len(messages) > 6:
            shown += f"\n  and {len(messages) - 6} more"
        raise SceneError(
            f"unattached rigid body:\n{shown}\nHold it with scene.fix(...) or "
            "scene.symmetry(...), or join it to another part by Perfect() or by Elastic(...) with "
            "stiffness in that direction."
        )
