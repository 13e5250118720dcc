"""Rigid motions of whole bodies: what errors are measured of beside strains and displacements of faces.

A small face says little of what a motion about it does at the other end of a part, and no strain says it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from dolfinx_frontend.assembly.held import held, own_resistances
from dolfinx_frontend.assembly.interface import Interface, Side
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.rigid import free_motions
from dolfinx_frontend.common.arrays import Array

__all__ = ["motions_of", "on_side"]

LEAST = 1e-12
"""Motions whose mean square is below this, relative to the largest, are none."""


def motions_of(own: Problem, members: Sequence[str], inside: Sequence[Interface]) -> dict[str, Array]:
    """Rigid motions (n, r) of the parts of a body that nothing resists but what the plan keeps.

    They are orthonormal in the mean over the nodes of the body. Empty: the body is held.

    Parameters
    ----------
    inside
        What the plan has eliminated on these parts.
    """
    parts = {name: own.substructures[name] for name in members}
    resisting = [held(own, each) for each in inside]
    resisting += own_resistances({name: own.parts[name] for name in members})
    found = free_motions({n: (p.centre, p.length) for n, p in parts.items()}, resisting)
    if not len(found):
        return {}
    fields = {n: found.at(n, p.dof_coordinates).reshape(p.size, -1) for n, p in parts.items()}
    nodes = sum(len(p.dof_coordinates) for p in parts.values())
    gram = sum(each.T @ each for each in fields.values()) / nodes
    sizes, directions = np.linalg.eigh(gram)
    seen = sizes > LEAST * sizes.max()
    unit = directions[:, seen] / np.sqrt(sizes[seen])
    return {name: each @ unit for name, each in fields.items()}


def on_side(motions: Mapping[str, Array], side: Side, frames: Array) -> Array | None:
    """The motions of a side in the frames (components m, d) of its interface, (components m, r), or None."""
    if side.substructure not in motions:
        return None
    of_nodes = motions[side.substructure]
    points, dim = side.shape.shape[0], frames.shape[1]
    moved = side.shape @ of_nodes.reshape(side.shape.shape[1], -1)
    local = np.einsum("pcd,pdr->pcr", frames.reshape(points, -1, dim), moved.reshape(points, dim, -1))
    return np.asfortranarray(local.reshape(len(frames), -1))
