"""Common to the benchmarks: timing, the unit of cost, the environment, JSON files and tables.

Times are compared within one run: same machine, same libraries, same number of threads.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import shutil
import statistics
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any, Generic, TypeVar

import dolfinx
import numpy as np
from petsc4py import PETSc

from dolfinx_frontend import Problem

ROOT = Path(__file__).resolve().parents[1]
FIGURES = ROOT / "docs" / "figures"
"""Folder of the figures that benchmarks draw for the documentation."""
sys.path[:0] = [str(ROOT), str(ROOT / "demos")]

from parts.text import table as table  # noqa: E402, F401
from parts.unit import Unit, measure_unit  # noqa: E402
from tests.verification.scenes import demo as demo  # noqa: E402, F401

T = TypeVar("T")


@dataclass(frozen=True)
class Timed(Generic[T]):
    """Return value of a timed call, its median wall time and the number of runs."""

    value: T
    seconds: float
    repeats: int


def timed(call: Callable[[], T], repeats: int = 3, budget: float = 120.0) -> Timed[T]:
    """Median wall time of a call that runs `repeats` times, fewer if `budget` seconds are over."""
    seconds: list[float] = []
    while True:
        start = perf_counter()
        value = call()
        seconds.append(perf_counter() - start)
        if len(seconds) >= repeats or sum(seconds) >= budget:
            return Timed(value, statistics.median(seconds), len(seconds))


def settled(result: Any, rtol: float) -> dict[str, Any]:
    """Status and error of a solution that others are compared with, down to a tolerance `rtol` of theirs."""
    if not (result.converged or result.error <= 0.05 * rtol):
        raise RuntimeError(f"a reference ended as {result.status} at an error of {result.error:.1e}")
    return {"status": result.status, "error": result.error}


def unit(problem: Problem, repeats: int) -> Unit:
    """The unit of cost; measured twice, because the first run of a solver initialises libraries."""
    measured = [measure_unit(problem, max(3, repeats)) for _ in range(2)]
    return min(measured, key=lambda each: each.seconds)


def _loaded(pattern: str) -> list[str]:
    """Names of the shared libraries in this process that match a pattern (Linux; else none)."""
    maps = Path("/proc/self/maps")
    if not maps.exists():
        return []
    names = {Path(line.split()[-1]).name for line in maps.read_text().splitlines() if "/" in line}
    return sorted(name for name in names if re.search(pattern, name, re.IGNORECASE))


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    text = info.read_text() if info.exists() else ""
    found = re.search(r"model name\s*:\s*(.+)", text)
    return found[1].strip() if found else platform.processor() or platform.machine()


def environment() -> dict[str, Any]:
    """What the times depend on."""
    affinity = getattr(os, "sched_getaffinity", None)
    return {
        "processor": _processor(),
        "cpus": len(affinity(0)) if affinity else os.cpu_count(),
        "threads": os.environ.get("OMP_NUM_THREADS", "not set"),
        "blas": _loaded(r"^lib(open)?blas|mkl|blis"),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "dolfinx": dolfinx.__version__,
        "petsc": ".".join(str(n) for n in PETSc.Sys.getVersion()),
        "load": os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
    }


def launch(script: str, ranks: int, *arguments: str) -> None:
    """A file with ``--work`` on some ranks of the environment's mpirun."""
    mpirun = shutil.which("mpirun") or shutil.which("mpiexec")
    if mpirun is None:
        raise FileNotFoundError("no mpirun in this environment")
    version = subprocess.run([mpirun, "--version"], capture_output=True, text=True, check=False)
    flags = ["--allow-run-as-root", "--oversubscribe"] if "Open MPI" in version.stdout else []
    threads = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    # the benchmark itself has initialised MPI as a process of its own
    inherited = {k: v for k, v in os.environ.items() if not k.startswith(("PMIX_", "OMPI_COMM_"))}
    subprocess.run(
        [mpirun, *flags, "-n", str(ranks), sys.executable, script, "--work", *arguments],
        env={**inherited, **threads},
        check=True,
    )


def commit() -> str:
    """The commit that is measured, and whether files that count were changed since."""

    def git(*arguments: str) -> str:
        return subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True).stdout.strip()

    counts = ("latin_core", "dolfinx_frontend", "demos", "benchmarks")
    dirty = "-dirty" if git("status", "--porcelain", *counts) else ""
    return (git("rev-parse", "--short", "HEAD") or "unknown") + dirty


def size(text: str) -> str | float:
    """A named size of a mesh, or the size of its cells."""
    try:
        return float(text)
    except ValueError:
        return text


def parser(name: str, description: str | None) -> argparse.ArgumentParser:
    """Options that all benchmarks have."""
    made = argparse.ArgumentParser(prog=f"./run bench {name}", description=description)
    made.add_argument("--json", type=Path, help="file to write the record to")
    made.add_argument("--repeats", type=int, default=3, help="timed runs; the median counts")
    return made


def write_json(record: dict[str, Any], path: Path | None) -> None:
    """Write a record, if a file is wanted."""
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")
        print(f"\nwritten to {path}")


def markdown_table(header: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """A table for a page."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(str(c).replace("|", "/") for c in line) + " |" for line in lines)


def between_marks(path: Path, name: str, text: str) -> None:
    """Put a text between ``<!-- name -->`` and ``<!-- end of name -->`` (``name: begin``, ``name: end``)."""
    page = path.read_text(encoding="utf-8")
    marks = rf"(<!-- {name}(?:: begin)? -->\n).*?(<!-- (?:end of {name}|{name}: end) -->)"
    path.write_text(
        re.sub(marks, lambda m: f"{m[1]}\n{text}\n\n{m[2]}", page, flags=re.DOTALL), encoding="utf-8"
    )
