"""Program of test_mpi.py: a part that is a matrix on one rank, joined to a mesh on the other.

``mpirun -n 2 python mpi_matrix.py``; prints a line a rank.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from blocks import RANK, WORLD
from mpi4py import MPI

import dolfinx_frontend as lf

TIGHT = lf.Options(rtol=1e-11)


def block(z: float) -> Any:
    """Of two by two cells in each direction."""
    return lf.geometry.box((30.0, 20.0, 20.0), (2, 2, 2), (0.0, 0.0, z), "hexahedron")


def matrix() -> lf.Matrix:
    """All nodes of a block: nothing is condensed, inner nodes are points as well."""
    scene = lf.Scene()
    scene.substructure("base", block(0.0), lf.LinearElastic(E=200e3, nu=0.3), degree=1)
    scene.fix("base:z0")
    part = lf.assemble(scene, comm=MPI.COMM_SELF).substructures["base"]
    x = part.dof_coordinates
    faces = {f"z{k}": np.flatnonzero(np.abs(x[:, 2] - 20.0 * k) < 1e-9) for k in (0, 1)}
    return lf.Matrix(part.matrix, x, faces=faces)


def joined(base: lf.Matrix, law: lf.Law, ranks: tuple[int, int], first: bool, comm: Any) -> lf.Problem:
    """A block on the matrix."""
    scene = lf.Scene()
    scene.substructure("base", base, rank=ranks[0])
    scene.substructure("block", block(20.0), lf.LinearElastic(E=200e3, nu=0.3), degree=1, rank=ranks[1])
    faces = ("base:z1", "block:z0") if first else ("block:z0", "base:z1")
    scene.interface("joint", *faces, law)
    scene.fix("base:z0")
    scene.traction("block:z1", (2.0, 1.0, -8.0))
    return lf.assemble(scene, comm=comm)


def main() -> None:
    """Both parts on either rank, seen from either side."""
    base = matrix()
    laws = (lf.Perfect(), lf.Elastic(normal=1e4, tangential=3e3), lf.Contact(friction=0.35))
    for law in laws:
        for first in (False, True):
            alone = lf.solve(joined(base, law, (0, 0), first, MPI.COMM_SELF), options=TIGHT)
            wanted = alone.displacement("base").displacements
            for ranks in ((0, 1), (1, 0)):
                result = lf.solve(joined(base, law, ranks, first, WORLD), options=TIGHT)
                if RANK == ranks[0]:
                    found = result.displacement("base").displacements
                    assert np.abs(found - wanted).max() < 1e-9 * np.abs(wanted).max()
    print(f"same matrix on rank {RANK}", flush=True)


if __name__ == "__main__":
    main()
