"""The file of what a function was asked for, so that a long run goes on where it was ended.

An entry is a batch of points that were solved together, with the states from which later ones are started, or
a derivative. The same call over again asks for the same points in the same order; it is answered from the
file, down to the starts, and goes on with the same digits.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from latin_core.checkpoint import CheckpointError, edited

from dolfinx_frontend.assembly.ranks import exchanged
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.evaluate.events import Response
from dolfinx_frontend.evaluate.gradients import Derivatives
from dolfinx_frontend.evaluate.inputs import Inputs
from dolfinx_frontend.evaluate.system import laws_at_sets
from dolfinx_frontend.kernel.fingerprint import Facts, fingerprint
from dolfinx_frontend.kernel.solver import Solver
from dolfinx_frontend.plan.plan import Plan

__all__ = ["BATCH", "Journal", "Solved", "facts_of", "settle"]

BATCH = 256
"""Points of a batch, which Ctrl-C loses, at most."""
SETTLED = 3000
"""Rows up to which the kernel is made to decide how it applies the bodies before the first point."""


@dataclass(frozen=True, eq=False)
class Solved:
    """A batch of points.

    Attributes
    ----------
    x, values
        (n, inputs) and (n, quantities).
    statuses, places, error, iterations
        (n,) as of :class:`Evaluation`.
    kept
        Numbers of the points whose states are there.
    data, traces
        (kept, rows, columns).
    """

    x: Array
    values: Array
    statuses: npt.NDArray[np.str_]
    places: npt.NDArray[np.str_]
    error: Array
    iterations: npt.NDArray[np.int64]
    kept: npt.NDArray[np.int64]
    data: Array
    traces: Array


_BATCH = tuple(each.name for each in fields(Solved))
_SLOPES = ("x", "slopes", "kinks", "places", "residual")
_FORM = {"states": "by interface and side"}
"""What files of earlier versions do not have."""


class Journal:
    """Entries of a checkpoint file, those of an earlier run first.

    Where the parts are spread over ranks, all of them make all calls; each has the states of its parts. The
    file has them by interface and side, and is that of any number of ranks.

    Raises
    ------
    SceneError
        The file is damaged, or of another function.
    """

    def __init__(self, path: Path, facts: Facts, solver: Solver) -> None:
        try:
            self._file = solver.checkpoint(path, facts)
            self._batches: dict[bytes, Solved] = {}
            self._slopes: dict[bytes, Derivatives] = {}
            self._next = 0
            for number, arrays in self._file:
                self._next = max(self._next, number + 1)
                names = _SLOPES if "slopes" in arrays else _BATCH
                with self._file.agreement():
                    lacking = [name for name in names if name not in arrays]
                    if lacking:
                        raise edited(path, number, f"{lacking[0]!r} is missing")
                x = arrays["x"].tobytes()
                if names is _BATCH:
                    self._batches[x] = Solved(**{name: arrays[name] for name in names})
                else:
                    places = tuple(str(each) for each in arrays["places"])
                    self._slopes[x] = Derivatives(
                        arrays["slopes"], arrays["kinks"], places, float(arrays["residual"])
                    )
        except CheckpointError as error:
            raise SceneError(f"function: {error}") from error

    @classmethod
    def of(cls, path: Path, inputs: Inputs, outputs: Mapping[str, Response], solver: Solver) -> Journal:
        """The file of a function, refused if it is of another one."""
        return cls(path, {**facts_of(inputs, outputs, solver.plan), **_FORM}, solver)

    def batch(self, x: Array) -> Solved | None:
        """Points (n, inputs) that were solved together; None: they were not."""
        return self._batches.get(x.tobytes())

    def slopes(self, x: Array) -> Derivatives | None:
        """Derivatives at a point (inputs,) that were worked out; None: they were not."""
        return self._slopes.get(x.tobytes())

    def add(self, entry: Solved) -> None:
        """Write a batch."""
        self._append(vars(entry))

    def add_slopes(self, x: Array, found: Derivatives) -> None:
        """Write derivatives at a point (inputs,)."""
        places = np.array(found.places, dtype="<U64")
        self._append(
            {"x": x, "slopes": found.values, "kinks": found.kinks, "places": places,
             "residual": found.residual}
        )  # fmt: skip

    def _append(self, arrays: Mapping[str, Any]) -> None:
        self._file.append(self._next, arrays)
        self._next += 1

    def close(self) -> None:
        """Release the file."""
        self._file.close()


def facts_of(inputs: Inputs, outputs: Mapping[str, Response], plan: Plan, codes: bool = True) -> Facts:
    """What a function is, by name and value; the code of the user's functions only with `codes`."""
    probe = inputs.nominal()[None]
    if inputs.coordinates != "physical":
        away = np.where([name in inputs.germs for name in inputs.names], 0.5, 0.0)
        probe = np.vstack([probe, probe + away, probe - away])
    functions: dict[str, Callable[..., Any]] = {}
    for name, each in outputs.items():
        for k, leaf in enumerate(each.readings):
            if callable(leaf._of):
                functions[f"{name} {k}"] = leaf._of
    return {
        "run": "function",
        "inputs": list(inputs.names),
        "coordinates": inputs.coordinates,
        "quantities": {name: each.recipe() for name, each in outputs.items()},
        "random numbers": {name: each.tolist() for name, each in inputs.values(probe).items()},
        **fingerprint(inputs.problem, plan, inputs.parameters(plan, probe), functions, codes=codes),
    }


def settle(solver: Solver) -> None:
    """Apply the bodies to nothing until the kernel has formed what it forms of bodies that are often applied.

    It rounds differently before and after, and a run that goes on starts after. Above `SETTLED` rows that
    would be dear: there a run that goes on has the same digits up to rounding, which the tolerance of the
    solves may blow up.
    """
    columns, rows, comm = solver.plan.amplitudes.shape[1], solver.rows, solver.problem.comm
    most = rows if comm is None else max(exchanged(comm, rows))
    if not 0 < most <= SETTLED:
        return
    sets = max(1, -(-512 // columns))
    laws = solver.laws if columns == 1 else laws_at_sets(solver, solver.laws, sets)
    data = np.zeros((rows, sets * columns), order="F")
    loads = np.zeros((len(solver.plan.amplitudes), sets * columns), order="F")
    for _ in range(-(-4 * most // (sets * columns))):
        solver.global_stage(laws, data, loads)
