"""What interfaces and cells tell a search for meshes: soft springs, contact zones, places of errors."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.spatial import cKDTree

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.compat import cell_nodes
from dolfinx_frontend.estimate.unseen import extent
from dolfinx_frontend.geometry.finer import cell_sizes
from dolfinx_frontend.results.errors import Place
from dolfinx_frontend.results.result import Result
from dolfinx_frontend.scene.laws import Elimination
from dolfinx_frontend.scene.scene import Scene

__all__ = ["RESOLVED", "SEEN", "contact_edges", "places_of", "soft_springs"]

COARSER = 1.5
"""Facets of the side with the points, relative to those of the other side, at most."""

RESOLVED, SEEN = 6.0, 3.0
"""Closed points of a contact zone with an edge, in each direction, at least: to be believed as any other zone,
and if what is said of its mesh fits twice."""

COVERED = 0.99
"""Share of a face from which on all of it counts as covered."""

CLOSED = 1e-6
"""Pressure relative to the largest above which a point of an interface counts as closed."""


def soft_springs(scene: Scene, problem: Problem) -> list[str]:
    """Interfaces of springs that are softer than the cells beside them, whose space was left open.

    At points these hold exactly, whatever the meshes; means about vertices leave out how jumps vary between
    them, which no estimate sees. Stiff springs would lock at points.
    """
    found = []
    for name, spec in scene.interfaces.items():
        if spec.space != "auto" or spec.overlap != "full" or spec.remote is not None or len(spec.faces) != 2:
            continue
        interface, law = problem.interfaces[name], spec.law.nominal
        if law.elimination is not Elimination.SPRINGS or law.unilateral or not law.linear:
            continue
        first, second = (len(_facets(problem, side.substructure, side.face)) for side in interface.sides)
        size = (extent(problem, interface) / first) ** (1.0 / (interface.dim - 1))
        other = (extent(problem, interface, 1) / second) ** (1.0 / (interface.dim - 1))
        if np.any(interface.chords):
            continue  # points on one polygon are not on the other
        if size > COARSER * other:
            continue  # between the points nothing would hold the second side
        modulus = min(problem.parts[side.substructure].modulus for side in interface.sides)
        if float(law.stiffnesses(interface).max(initial=0.0)) * size < modulus:
            found.append(name)
    return found


def _facets(problem: Problem, part: str, face: str) -> Ints:
    """Facets of a face."""
    each = problem.substructures[part].part
    return np.asarray(each.facet_tags.find(each.names[face]), dtype=np.int64)


def contact_edges(result: Result) -> tuple[dict[str, Array], float]:
    """Active interface that may open -> its points (k, d) with closed and open ones around; and how many closed
    points the zone with the fewest has in each direction, infinite where none has an edge."""
    out, across = {}, np.inf
    for name in result.plan.active:
        interface = result.problem.interfaces[name]
        if not interface.law.unilateral:
            continue
        force = np.asarray(result.force(name))
        normal = force.reshape(-1, *force.shape[-2:])[-1][:, 0]
        closed = normal < -CLOSED * float(np.abs(normal).max(initial=0.0))
        if not closed.any() or (closed.all() and interface.covered > COVERED):
            continue
        own = float(np.count_nonzero(closed) ** (1.0 / (interface.dim - 1)))
        across = min(across, own)
        if own < RESOLVED - 1e-9:
            out[name] = interface.points[closed]
            continue
        count = min(interface.num_points, 3 if interface.dim == 2 else 7)
        _, around = cKDTree(interface.points).query(interface.points, k=count)
        mixed = closed[around].any(axis=1) & ~closed[around].all(axis=1)
        if mixed.any():
            out[name] = interface.points[mixed]
    return out, across


def places_of(problem: Problem, cells: Mapping[str, Array]) -> tuple[Place, ...]:
    """Parts by what their cells contribute, the largest first; those below a hundredth are left out."""
    sums = {name: float(each.sum()) for name, each in cells.items()}
    total = sum(sums.values())
    out = []
    for name in sorted(sums, key=lambda n: -sums[n]):
        if not sums[name] > 0.01 * total:
            break
        mesh = problem.substructures[name].part.mesh
        worst = int(cells[name].argmax())
        nodes = np.asarray(mesh.geometry.x)[np.asarray(cell_nodes(mesh))[worst], : mesh.geometry.dim]
        at = tuple(float(v) for v in nodes.mean(axis=0))
        size = float(cell_sizes(mesh).min())
        out.append(Place(name, sums[name] / total, at, len(cells[name]), size))
    return tuple(out)
