"""Two solid brackets bolted to a frame that another department gives as a matrix.

    ./run python demos/frame_as_matrix.py

Problem
    A portal frame of welded box sections, fixed to the ground, carries two brackets. The office that designs
    the frame has a model of beams; what it gives away is the stiffness of the frame at the nodes of the two
    pads on which the brackets lie, after static condensation, and the forces of its own weight there. Here
    that office is the function `frame`.

Parts and interfaces (N, mm, MPa)
    frame       ``lf.Matrix(K, points, loads, faces)``: 2 x 25 points, grounded
    brackets    steel, 80 x 80 x 40, each on a pad: contact with friction
    bolts       one M16 for each bracket, a beam between its upper face and the pad, tightened to 40 kN
    load        3 kN down and 4 kN along the frame beside the middle of one bracket, from t = 1 to 2

Random variables
    Preload (normal, 10 %), friction (lognormal, 20 %) and the stiffness of the whole frame (lognormal, 10 %).

Checks
    The brackets pull at the frame with the load; under the forces of the joints the whole model of the frame
    moves the pads as far as the matrix does.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

import dolfinx_frontend as lf

Array = npt.NDArray[np.float64]
OUTPUT = Path(__file__).resolve().parents[1] / "build" / "output" / "frame_as_matrix"
E, G = 210e3, 81e3  # MPa
AREA, I, J = 2256.0, 3.34e6, 4.98e6  # mm^2, mm^4: boxes of 100 x 100 x 6
WEIGHT = 7.85e-9 * 9810.0 * AREA  # N / mm
KNEES = [(0.0, 0.0, 0.0), (0.0, 0.0, 600.0), (300.0, 0.0, 600.0), (700.0, 0.0, 600.0), (1000.0, 0.0, 600.0)]
PADS = {"left": 2, "right": 3}  # name -> the knee in its middle
PAD_STIFFNESS = 1.6e6  # N / mm, of the wall under one node
BOLT = lf.BoltStiffness.vdi2230(d=16.0, pitch=2.0, shank=20.0, thread=16.0, E=205e3)
PRELOAD, FRICTION = 40e3, 0.18
LOAD, FORCE = lf.Amplitude([1, 2], [0, 1]), (4e3, 0.0, -3e3)


def bar(start: Array, end: Array) -> tuple[Array, Array]:
    """Stiffness (12, 12) of a straight bar between two nodes, and the forces (12,) of its weight."""
    length = float(np.linalg.norm(end - start))
    K = np.zeros((12, 12))
    for ends, k in (((0, 6), E * AREA / length), ((3, 9), G * J / length)):
        K[np.ix_(ends, ends)] = k * np.array([[1.0, -1.0], [-1.0, 1.0]])
    a, b = 6.0 * length, length**2
    bent = np.array([[12, a, -12, a], [a, 4 * b, -a, 2 * b], [-12, -a, 12, -a], [a, 2 * b, -a, 4 * b]])
    turned = np.diag([1.0, -1.0, 1.0, -1.0])
    K[np.ix_((1, 5, 7, 11), (1, 5, 7, 11))] = E * I / length**3 * bent
    K[np.ix_((2, 4, 8, 10), (2, 4, 8, 10))] = E * I / length**3 * turned @ bent @ turned
    along = (end - start) / length
    side = np.cross([0.0, 1.0, 0.0], along)
    axes = np.kron(np.eye(4), np.stack([along, np.cross(side, along), side]))
    weight = np.zeros(12)
    weight[[2, 8]] = -0.5 * WEIGHT * length
    moment = np.cross(along, [0.0, 0.0, -WEIGHT]) * length**2 / 12.0
    weight[3:6], weight[9:12] = moment, -moment
    return axes.T @ K @ axes, weight


class Frame(NamedTuple):
    """The model of the frame: its matrix, the forces of its weight, and which of its unknowns are pads."""

    K: Array
    weight: Array
    points: Array
    pads: npt.NDArray[np.int64]

    def matrix(self) -> lf.Matrix:
        """What is given away: all but the pads condensed."""
        inner = np.setdiff1d(np.arange(len(self.K)), self.pads)
        follow = np.linalg.solve(self.K[np.ix_(inner, inner)], self.K[np.ix_(inner, self.pads)])
        reduced = self.K[np.ix_(self.pads, self.pads)] - self.K[np.ix_(self.pads, inner)] @ follow
        weight = self.weight[self.pads] - follow.T @ self.weight[inner]
        count = len(self.points) // len(PADS)
        faces = {name: np.arange(k * count, (k + 1) * count) for k, name in enumerate(PADS)}
        return lf.Matrix(0.5 * (reduced + reduced.T), self.points, {"weight": weight}, faces)


def frame(pads: dict[str, Array]) -> Frame:
    """Of bars between the knees, whose feet are fixed, and pads of which every node is on a spring.

    Parameters
    ----------
    pads
        Name -> nodes (m, 3) of a pad, which is 50 mm above its knee.
    """
    knees = np.array([*KNEES, (1000.0, 0.0, 0.0)])
    points = np.concatenate([pads[name] for name in PADS])
    first = 6 * len(knees)
    K = np.zeros((first + 3 * len(points), first + 3 * len(points)))
    weight = np.zeros(len(K))
    for k in range(len(knees) - 1):
        stiffness, load = bar(knees[k], knees[k + 1])
        at = np.arange(6 * k, 6 * k + 12)
        K[np.ix_(at, at)] += stiffness
        weight[at] += load
    where = [knee for name, knee in PADS.items() for _ in pads[name]]
    for number, (knee, point) in enumerate(zip(where, points, strict=True)):
        x, y, z = point - knees[knee]
        turned = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])  # theta x (x, y, z)
        moves = np.hstack([np.eye(3), -np.eye(3), -turned])
        node = first + 3 * number
        at = np.r_[node : node + 3, 6 * knee : 6 * knee + 6]
        K[np.ix_(at, at)] += PAD_STIFFNESS * moves.T @ moves
    free = np.r_[6 : 6 * (len(knees) - 1), first : len(K)]
    held = 6 * (len(knees) - 2)
    return Frame(K[np.ix_(free, free)], weight[free], points, np.arange(held, len(free)))


def pad(knee: int) -> Array:
    """Nodes (25, 3) of a pad: those of a bracket with displacements of degree 2."""
    grid = np.meshgrid(np.linspace(-40.0, 40.0, 5), np.linspace(-40.0, 40.0, 5), [50.0], indexing="ij")
    return np.array(KNEES[knee]) + np.stack(grid, axis=3).reshape(-1, 3)


def assembly(matrix: lf.Matrix, preload: Any, friction: Any, stiffness: Any = 1.0) -> lf.Problem:
    """The brackets on the frame."""
    scene = lf.Scene()
    scene.substructure("frame", matrix, stiffness=stiffness)
    scene.load("frame", "weight")
    for name, knee in PADS.items():
        x, y, z = KNEES[knee]
        part = lf.geometry.box((80.0, 80.0, 40.0), (2, 2, 1), (x - 40.0, y - 40.0, z + 50.0), "hexahedron")
        scene.substructure(name, part, lf.LinearElastic(E=210e3, nu=0.3), degree=2)
        law = lf.Contact(friction=friction)
        scene.interface(f"{name} joint", f"frame:{name}", f"{name}:z0", law)
        scene.beam(f"{name} bolt", f"frame:{name}", f"{name}:z1", BOLT, lf.Preload(preload, until=1.0))
    scene.force("right:y1", LOAD * FORCE, point=(700.0, 10.0, 670.0))
    return lf.assemble(scene)


def main() -> None:
    """Load, sample, draw, check."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--output", type=Path, default=OUTPUT)
    parser.add_argument("--no-figures", action="store_true", help="no pictures of solids")
    parser.add_argument("--samples", type=int, default=32)
    given = parser.parse_args()
    whole = frame({name: pad(knee) for name, knee in PADS.items()})
    matrix = whole.matrix()
    print(matrix)

    problem = assembly(matrix, PRELOAD, FRICTION)
    result = lf.solve(problem, times=[1.0, 2.0], options=lf.Options(rtol=1e-8))
    print(result.table(["left joint", "right joint", "left bolt.axial", "right bolt.axial"]))
    moved = result.displacement("frame").displacements
    print(f"\nthe pads move by up to {np.linalg.norm(moved, axis=1).max():.3f} mm")

    # the whole model of the frame, with what the joints and bolts do to it
    u = result.displacements["frame"][-1]
    acting = matrix.stiffness @ u
    full = np.zeros(len(whole.K))
    full[whole.pads] = acting - matrix.loads["weight"]
    alone = np.linalg.solve(whole.K, full + whole.weight)[whole.pads].reshape(-1, 3)
    off = float(np.abs(alone - moved).max() / np.abs(moved).max())
    total = (acting - matrix.loads["weight"]).reshape(-1, 3).sum(axis=0)
    print(f"the whole model of the frame moves them as far, to {off:.1e}; the brackets pull with", end=" ")
    print(", ".join(f"{x:.2f}" for x in total), "N")

    uncertain = assembly(
        matrix,
        lf.Normal("preload", PRELOAD, cov=0.1),
        lf.LogNormal("friction", mean=FRICTION, cov=0.2),
        lf.LogNormal("frame", mean=1.0, cov=0.1),
    )
    loose = lf.Options(rtol=1e-4)
    answer = lf.quasi_monte_carlo(
        uncertain, given.samples, times=[1.0, 2.0], options=loose, progress=False
    )
    slips = answer.quantity("right joint.slip_area", unit="mm^2")
    print(f"\nP(more than half of the right joint slips) = {slips.probability(above=3200.0)}")

    lf.io.write_fields(result, given.output / "frame.vtm")
    if not given.no_figures:
        lf.figures.stress_figure(result, given.output / "brackets_mises.png", label="von Mises stress (MPa)")
    print(f"files are in {given.output}")
    assert result.converged and answer.converged
    assert off < 1e-6 and np.allclose(total, FORCE, atol=1.0)


if __name__ == "__main__":
    main()
