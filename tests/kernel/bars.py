"""Bars end to end, from small PETSc matrices: the kernel without any frontend."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy.sparse as sp
from petsc4py import PETSc as _PETSc

import latin_core
from latin_core import Body, Interface, Laws, Member, Side, Structure

PETSc: Any = _PETSc

NODES = 5
FORCE = 2.0
STIFFNESS = 3.0


def petsc(matrix: Any) -> Any:
    """A sequential AIJ matrix."""
    a = sp.csr_matrix(matrix)
    arrays = (a.indptr.astype(PETSc.IntType), a.indices.astype(PETSc.IntType), a.data.astype(float))
    made = PETSc.Mat().createAIJ(a.shape, csr=arrays, comm=PETSc.COMM_SELF)
    made.assemble()
    return made


def stiffness(nodes: int = NODES) -> np.ndarray:
    """(nodes, nodes) of a bar of unit length and axial stiffness 1 that nothing holds."""
    k = np.zeros((nodes, nodes))
    for i in range(nodes - 1):
        k[i : i + 2, i : i + 2] += (nodes - 1) * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return k


def at(node: int, nodes: int = NODES) -> Any:
    """Trace at one node."""
    return petsc(sp.csr_matrix(([1.0], ([0], [node])), shape=(1, nodes)))


def side(part: int, node: int, **changes: Any) -> Side:
    """The side of a bar at one of its nodes."""
    given = {"member": f"bar{part}", "trace": at(node), "direction": [1.3], "scale": 1.0}
    return Side(**(given | changes))


def interface(name: str, law: Any, *sides: Side, **changes: Any) -> Interface:
    """One point of one component."""
    given = {"name": name, "law": law, "weights": [1.0], "frames": [[1.0]], "sides": sides}
    return Interface(**(given | changes))


def member(part: int, **changes: Any) -> Member:
    """A bar with a load at its end."""
    load = np.zeros((NODES, 1))
    load[-1] = FORCE
    return Member(**({"name": f"bar{part}", "stiffness": petsc(stiffness()), "load": load} | changes))


def chain(law: Any = "elastic", **options: Any) -> Structure:
    """Two bars: the first on a wall, the second pulled, a joint between them."""
    bodies = [
        Body(name="bar0", size=NODES, members=[member(0, load=np.zeros((NODES, 1)))]),
        Body(name="bar1", size=NODES, members=[member(1)]),
    ]
    interfaces = [
        interface("wall", "perfect", side(0, 0)),
        interface("joint", law, side(0, NODES - 1), side(1, 0)),
    ]
    return Structure(bodies=bodies, interfaces=interfaces, **options)


def elastic(structure: Structure, **changes: Any) -> Laws:
    """Laws of the elastic chain."""
    parameters: Mapping[str, Any] = {"joint": {"normal": STIFFNESS}}
    return structure.laws(**({"parameters": parameters} | changes))


def end(structure: Structure, laws: Laws, state: latin_core.State, **how: Any) -> float:
    """Displacement of the pulled end."""
    return float(structure.displacements(laws, state, **how)["bar1"][-1, 0])


def exact(stiffness: float = STIFFNESS, force: float = FORCE) -> float:
    """Bars and joint in series."""
    return force * (2.0 + 1.0 / stiffness)
