"""Points over ranks: the digits of one, errors that end all, a checkpoint that survives a killed rank."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.kernel.test_mpi import holds, launch, pytestmark  # noqa: F401


def test_points_over_ranks_have_the_digits_of_one() -> None:
    holds(3, "same points on rank", "mpi_points.py", "same")


def test_functions_and_probabilities_over_ranks_are_those_of_one(tmp_path: Path) -> None:
    holds(2, "same function on rank", "mpi_points.py", "function", str(tmp_path))


def test_groups_of_ranks_have_the_digits_of_one() -> None:
    holds(4, "same groups on rank", "mpi_points.py", "groups")


def test_a_rank_that_raises_ends_all_and_the_checkpoint_goes_on(tmp_path: Path) -> None:
    holds(3, "stopped on rank", "mpi_points.py", "stop", str(tmp_path))


def test_ranks_with_different_problems_are_refused() -> None:
    holds(2, "refused on rank", "mpi_points.py", "refuse")


@pytest.mark.night(guard="test_mpi.py: test_checkpoints_survive_a_rank_that_ends[kill]")
def test_a_killed_rank_ends_all_and_its_points_are_done_again(tmp_path: Path) -> None:
    file = str(tmp_path / "points")
    assert launch(2, "mpi_points.py", "kill", file).returncode != 0
    holds(2, "resumed on rank", "mpi_points.py", "resume", file)
