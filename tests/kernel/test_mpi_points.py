"""Points over ranks: the digits of one, errors that end all, a checkpoint that survives a killed rank."""

from __future__ import annotations

from pathlib import Path

from tests.kernel.test_mpi import launch, pytestmark  # noqa: F401


def test_points_over_ranks_have_the_digits_of_one() -> None:
    run = launch(3, "mpi_points.py", "same")
    assert run.returncode == 0, run.stdout + run.stderr
    assert run.stdout.count("same points on rank") == 3


def test_functions_and_probabilities_over_ranks_are_those_of_one(tmp_path: Path) -> None:
    run = launch(2, "mpi_points.py", "function", str(tmp_path))
    assert run.returncode == 0, run.stdout + run.stderr
    assert run.stdout.count("same function on rank") == 2


def test_groups_of_ranks_have_the_digits_of_one() -> None:
    run = launch(4, "mpi_points.py", "groups")
    assert run.returncode == 0, run.stdout + run.stderr
    assert run.stdout.count("same groups on rank") == 4


def test_a_rank_that_raises_ends_all_and_the_checkpoint_goes_on(tmp_path: Path) -> None:
    run = launch(3, "mpi_points.py", "stop", str(tmp_path))
    assert run.returncode == 0, run.stdout + run.stderr
    assert run.stdout.count("stopped on rank") == 3


def test_ranks_with_different_problems_are_refused() -> None:
    run = launch(2, "mpi_points.py", "refuse")
    assert run.returncode == 0, run.stdout + run.stderr
    assert run.stdout.count("refused on rank") == 2


def test_a_killed_rank_ends_all_and_its_points_are_done_again(tmp_path: Path) -> None:
    file = str(tmp_path / "points")
    assert launch(2, "mpi_points.py", "kill", file).returncode != 0
    run = launch(2, "mpi_points.py", "resume", file)
    assert run.returncode == 0, run.stdout + run.stderr
    assert run.stdout.count("resumed on rank") == 2
