"""Blocks in a row over the ranks, for the programs of test_mpi.py."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from mpi4py import MPI

from dolfinx_frontend import Elastic, LinearElastic, Scene, geometry

WORLD = MPI.COMM_WORLD
RANK = WORLD.rank


def row(
    laws: Callable[[int], Any],
    moduli: Sequence[float],
    load: Any,
    cells: Sequence[tuple[int, int]] | None = None,
    degree: int = 1,
    ranks: Sequence[int | None] | None = None,
    tower: bool = False,
) -> Scene:
    """Blocks b0, b1, ... side by side, or one on another, on a soft bed, pushed at the last one.

    Parameters
    ----------
    laws
        Number k of a joint -> law of the interface jk between the blocks k - 1 and k.
    moduli
        One for each block.
    cells, ranks
        Of each block; None: 2 x 2, and wherever there is room.
    """
    scene = Scene()
    for k, modulus in enumerate(moduli):
        origin = (0.0, 10.0 * k) if tower else (10.0 * k, 0.0)
        divisions = (2, 2) if cells is None else cells[k]
        scene.substructure(
            f"b{k}",
            lambda o=origin, c=divisions: geometry.box((10.0, 10.0), c, origin=o),
            LinearElastic(E=modulus, nu=0.3),
            degree=degree,
            rank=None if ranks is None else ranks[k],
        )
    far, near, side = ("y1", "y0", "x0") if tower else ("x1", "x0", "y0")
    scene.fix(f"b0:{near}", name="wall")
    for k in range(1, len(moduli)):
        scene.interface(f"j{k}", f"b{k - 1}:{far}", f"b{k}:{near}", laws(k))
        scene.interface(f"bed{k}", f"b{k}:{side}", Elastic(normal=3.0, tangential=3.0))
    scene.traction(f"b{len(moduli) - 1}:{far}", load, name="pull")
    return scene
