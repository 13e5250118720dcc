"""The number of threads changes no bit of an answer."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).with_name("threads_answers.py")


def answers(threads: int) -> str:
    many = {"OMP_NUM_THREADS": str(threads), "OPENBLAS_NUM_THREADS": str(threads)}
    run = subprocess.run([sys.executable, str(SCRIPT)], capture_output=True, text=True, env=os.environ | many)
    assert run.returncode == 0, run.stderr
    return run.stdout


@pytest.mark.slow
@pytest.mark.parametrize("threads", [2, pytest.param(3, marks=pytest.mark.night(guard="two threads"))])
def test_the_number_of_threads_changes_no_bit(threads: int) -> None:
    one = answers(1)
    assert [line.split()[1] for line in one.splitlines()] == ["converged", "converged", "True", "converged"]
    assert answers(threads) == one
