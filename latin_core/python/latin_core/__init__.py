"""LATIN kernel: substructures, interfaces, local and global stage, stochastic Galerkin blocks.

The package knows PETSc matrices and NumPy arrays, and nothing of how they were made:
``dolfinx_frontend`` assembles scenes into them. ``latin_core.__version__`` is the installed version.
"""

from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

# before the extension: it initialises MPI and PETSc, which the extension never does
from petsc4py import PETSc

from latin_core import _core
from latin_core._core import (
    InputError,
    Iteration,
    NumericalError,
    Problem,
    RemoteError,
    State,
    Summary,
)
from latin_core.checkpoint import Checkpoint, CheckpointError
from latin_core.options import Options
from latin_core.sweep import SweepPoints, SweptParameter, sweep

try:
    __version__ = version("latin-core")
except PackageNotFoundError:  # imported from a build folder that was never installed
    __version__ = "unknown"

_petsc: Any = PETSc  # its stubs know no members
if not np.issubdtype(_petsc.ScalarType, np.floating):
    raise ImportError(
        "latin_core needs a real PETSc, petsc4py here is complex: install the real flavour "
        "(Debian: python3-petsc4py-real; conda: petsc=*=real*)"
    )

bound_threads = _core.bound_threads
snake_order = _core.snake_order
available_backends = _core.available_backends


def get_include() -> str:
    """Folder of the C++ headers that a compiled law of a user includes (see ``docs/laws.md``)."""
    return str(Path(_core.__file__).with_name("include"))


__all__ = [
    "Checkpoint",
    "CheckpointError",
    "InputError",
    "Iteration",
    "NumericalError",
    "Options",
    "Problem",
    "RemoteError",
    "State",
    "Summary",
    "SweepPoints",
    "SweptParameter",
    "available_backends",
    "bound_threads",
    "get_include",
    "snake_order",
    "sweep",
]
