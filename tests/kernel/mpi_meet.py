"""Program of test_mpi.py: parts that meet around an edge, of which no rank has all, against one rank.

``mpirun -n 2 python mpi_meet.py``
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from mpi4py import MPI

from dolfinx_frontend import Contact, LinearElastic, Options, Perfect, Scene, assemble, solve

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tests.helpers import block  # noqa: E402

BOXES = {
    "roof": ((0.0, 1.5), (3.0, 3.0), (5, 4), "x0 x1 y1"),
    "west": ((0.0, 0.0), (0.75, 1.5), (2, 3), "x0 y0"),
    "middle": ((0.75, 0.0), (1.5, 1.5), (12, 12), "y0"),
    "east": ((1.5, 0.0), (3.0, 1.5), (12, 12), "x1 y0"),
}
JOINTS = {
    "east roof": ("east:y1", "roof:y0", Contact()),
    "west roof": ("west:y1", "roof:y0", Perfect()),
    "west middle": ("west:x1", "middle:x0", Contact()),
    "middle roof": ("middle:y1", "roof:y0", Perfect()),
    "middle east": ("middle:x1", "east:x0", Perfect()),  # its meshes match
}


def meeting() -> Scene:
    """Four parts, pressed together."""
    scene = Scene()
    for name, (low, high, counts, held) in BOXES.items():
        scene.substructure(name, block("triangle", counts, low, high), LinearElastic(1.0, 0.3), degree=1)
        scene.fix([f"{name}:{face}" for face in held.split()], value=lambda x: x * [-1e-3, -2e-3])
    for name, (first, second, law) in JOINTS.items():
        scene.interface(name, first, second, law, overlap="partial")
    return scene


def main() -> None:
    spread, alone = assemble(meeting(), comm=MPI.COMM_WORLD), assemble(meeting(), comm=MPI.COMM_SELF)
    for name, one in alone.interfaces.items():
        here = spread.interfaces[name]
        for own, whole in zip(here.sides, one.sides, strict=True):
            if own.substructure in spread.substructures:
                assert np.array_equal(here.points, one.points), name
                assert abs(own.shape - whole.shape).max() < 1e-14, name
    result = solve(spread, options=Options(rtol=1e-9, max_iterations=1000))
    assert result.converged
    for name, part in spread.substructures.items():
        exact = part.dof_coordinates * [-1e-3, -2e-3]
        assert np.abs(result.displacements[name].reshape(-1, 2) - exact).max() < 1e-7 * 6e-3, name
    print(f"rank {MPI.COMM_WORLD.rank}: as on one")


if __name__ == "__main__":
    main()
