"""Several ranks: the same digits as one rank, neighbours only, errors that end all ranks with a message."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
MPIRUN = shutil.which("mpirun") or shutil.which("mpiexec")

pytestmark = pytest.mark.skipif(MPIRUN is None, reason="no mpirun in this environment")


def launch(ranks: int, program: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a program of this folder on some ranks; a run that hangs fails the test."""
    assert MPIRUN is not None
    version = subprocess.run([MPIRUN, "--version"], capture_output=True, text=True, check=False)
    flags = ["--allow-run-as-root", "--oversubscribe"] if "Open MPI" in version.stdout else []
    # the variables of a launcher that may have started the tests are not for this one
    keep = {k: v for k, v in os.environ.items() if not k.startswith(("PMIX_", "PMI_", "OMPI_COMM_"))}
    return subprocess.run(
        [MPIRUN, *flags, "-n", str(ranks), sys.executable, str(HERE / program), *arguments],
        capture_output=True,
        encoding="utf-8",
        errors="replace",
        timeout=60,
        env={**keep, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        check=False,
    )


@pytest.mark.parametrize("ranks", [2, 3])
def test_bars_over_ranks_have_the_digits_of_one_rank(ranks: int) -> None:
    run = launch(ranks, "mpi_kernel.py", "same")
    assert run.returncode == 0, run.stderr
    assert run.stdout.count("same on rank") == ranks


@pytest.mark.parametrize("what", ["same", "history", "facets"])
def test_blocks_over_two_ranks_have_the_digits_of_one_rank(what: str) -> None:
    run = launch(2, "mpi_chain.py", what)
    assert run.returncode == 0, run.stderr
    assert run.stdout.count("same on rank") == 2


@pytest.mark.parametrize(
    ("program", "what", "message"),
    [
        ("mpi_kernel.py", "stop", "the callback of rank 1 stops here"),
        ("mpi_kernel.py", "refuse", "interface 'joint4': search direction has 1 values for 2 rows"),
        ("mpi_chain.py", "fail", "rank 1 failed: ZeroDivisionError"),
        ("mpi_chain.py", "missing", "interface 'j2', substructure 'b3': unknown face 'nowhere'"),
        ("mpi_chain.py", "free", "unattached rigid body"),
        ("mpi_chain.py", "lost", "no equilibrium: 'b3', 'b4' has lost its support"),
        ("mpi_chain.py", "crash", "RuntimeError: only here"),
    ],
)
def test_an_error_on_one_rank_ends_all_with_its_message(
    program: str, what: str, message: str
) -> None:
    run = launch(2, program, what)
    assert run.returncode != 0
    assert message in run.stderr + run.stdout, run.stderr
