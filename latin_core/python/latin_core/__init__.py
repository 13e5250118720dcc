"""LATIN kernel: substructures, interfaces, local and global stage, stochastic Galerkin blocks.

The package knows PETSc matrices and NumPy arrays, and nothing of how they were made:
``dolfinx_frontend`` assembles scenes into them. In short::

    structure = latin_core.Structure(bodies=[Body(...), ...], interfaces=[Interface(...), ...])
    laws = structure.laws(parameters={"joint": {"normal": 100.0}})
    summary, state = structure.solve(laws)
    u = structure.displacements(laws, state)

``latin_core.__version__`` is the installed version.
"""

from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

# first: it asks MPI for several threads at once, which PETSc would not
from mpi4py import MPI as _MPI  # noqa: F401

# before the extension: it initialises PETSc, which the extension never does
from petsc4py import PETSc

from latin_core import _core
from latin_core._core import (
    STATUSES,
    Beginning,
    Body,
    Elimination,
    Equilibration,
    InputError,
    Interface,
    Iteration,
    Law,
    Laws,
    Linearised,
    Member,
    NumericalError,
    RemoteError,
    Side,
    Spring,
    State,
    Structure,
    Summary,
    available_backends,
    bound_threads,
    compiled_law,
    find_roots,
    python_law,
    snake_order,
)
from latin_core.checkpoint import Checkpoint, CheckpointError, CheckpointWarning
from latin_core.options import Options
from latin_core.points import SweepPoints, SweptParameter
from latin_core.sweep import sweep

try:
    __version__ = metadata.version("latin-core")
except metadata.PackageNotFoundError:  # imported from a build folder that was never installed
    __version__ = "unknown"

_petsc: Any = PETSc  # its stubs know no members
if not np.issubdtype(_petsc.ScalarType, np.floating):
    raise ImportError(
        "latin_core needs a real PETSc, petsc4py here is complex: install the real flavour "
        "(Debian: python3-petsc4py-real; conda: petsc=*=real*)"
    )


def get_include() -> str:
    """Folder of the C++ headers that a compiled law of a user includes (see ``docs/laws.md``)."""
    return str(Path(_core.__file__).with_name("include"))


__all__ = [
    "STATUSES",
    "Beginning",
    "Body",
    "Checkpoint",
    "CheckpointError",
    "CheckpointWarning",
    "Elimination",
    "Equilibration",
    "InputError",
    "Interface",
    "Iteration",
    "Law",
    "Laws",
    "Linearised",
    "Member",
    "NumericalError",
    "Options",
    "RemoteError",
    "Side",
    "Spring",
    "State",
    "Structure",
    "Summary",
    "SweepPoints",
    "SweptParameter",
    "available_backends",
    "bound_threads",
    "compiled_law",
    "find_roots",
    "get_include",
    "python_law",
    "snake_order",
    "sweep",
]
