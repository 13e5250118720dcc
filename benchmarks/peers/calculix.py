"""CalculiX beside us: the deck that ``write_inp`` makes of a problem, run by ``ccx``, and what it prints.

It needs ``ccx``, which ``get_calculix.sh`` brings; without it the deck is still written.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np
import numpy.typing as npt

from dolfinx_frontend import Problem, write_inp

Array = npt.NDArray[np.float64]
# where get_calculix.sh puts it
CACHE = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "latin" / "calculix"


@dataclass(frozen=True)
class Answer:
    """What CalculiX says.

    Attributes
    ----------
    u
        Part -> displacements (nodes, d) at the end, at the nodes of the part; NaN where elements have none.
    forces
        Set of nodes, see :func:`set_of` -> total reaction (3,).
    seconds, iterations
        Of the whole run, reading and writing included.
    """

    u: dict[str, Array]
    forces: dict[str, Array]
    seconds: float
    iterations: int


def find() -> str | None:
    """The program, if there is one."""
    return shutil.which("ccx") or shutil.which("ccx", path=CACHE)


def set_of(interface: str) -> str:
    """The set of nodes of a support or a section."""
    return "".join(c if c.isalnum() else "_" for c in f"N {interface}").upper()[:60]


def run(problem: Problem, times: Sequence[float] | None, deck: Path, repeats: int = 1) -> Answer | None:
    """Write the deck and solve it; None: there is no ccx. The shortest of some runs counts."""
    write_inp(problem, deck, times)
    if find() is None:
        return None
    deck.write_text(deck.read_text().replace("*END STEP", "*NODE PRINT, NSET=NALL\nU\n*END STEP"))
    runs = [_run(deck) for _ in range(repeats)]
    sizes = {name: len(part.dof_coordinates) for name, part in problem.substructures.items()}
    u, forces = _read(deck.with_suffix(".dat"), sum(sizes.values()))
    ends = np.cumsum(list(sizes.values()))[:-1]
    fields = dict(zip(sizes, np.split(u[:, : problem.dim], ends), strict=True))
    return Answer(fields, forces, min(seconds for _, seconds in runs), runs[-1][0].count("iteration "))


def _run(deck: Path) -> tuple[str, float]:
    """What ccx prints, and seconds."""
    start = perf_counter()
    done = subprocess.run(
        [find() or "ccx", "-i", deck.stem],
        cwd=deck.parent,
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"CCX_NPROC_STIFFNESS": os.environ.get("OMP_NUM_THREADS", "1")},
    )
    seconds = perf_counter() - start
    if done.returncode or "Job finished" not in done.stdout:
        raise SystemExit(f"ccx failed: {done.stdout[-2000:]}")
    return done.stdout, seconds


def _read(path: Path, count: int) -> tuple[Array, dict[str, Array]]:
    """Displacements (count, 3) and total reactions by set, of the last increment in a .dat file."""
    u = np.full((count, 3), np.nan)
    totals: dict[str, Array] = {}
    where = name = ""
    for line in path.read_text().splitlines():
        words = line.split()
        if line.lstrip().startswith(("displacements", "total force")):
            where = words[0]
            name = (re.search(r"for set (\S+)", line) or ["", ""])[1]
        elif where == "displacements" and len(words) == 4:
            u[int(words[0]) - 1] = [float(w) for w in words[1:]]
        elif where == "total" and len(words) == 3:
            totals[name] = np.array([float(w) for w in words])
    return u, totals
