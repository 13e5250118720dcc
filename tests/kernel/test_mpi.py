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
        timeout=120,
        env={
            **keep,
            "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
            "OMPI_MCA_mpi_yield_when_idle": "1",
        },
        check=False,
    )


def test_bars_over_three_ranks_have_the_digits_of_one_and_fail_together() -> None:
    run = launch(3, "mpi_kernel.py")
    assert run.returncode == 0, run.stderr
    assert run.stdout.count("same on rank") == run.stdout.count("failed together on rank") == 3


def test_blocks_over_two_ranks_have_the_digits_of_one() -> None:
    run = launch(2, "mpi_chain.py", "same")
    assert run.returncode == 0, run.stderr
    assert run.stdout.count("same on rank") == 2 * 3


def test_sweeps_samples_and_chaos_over_two_ranks_have_the_digits_of_one() -> None:
    run = launch(2, "mpi_chain.py", "columns")
    assert run.returncode == 0, run.stderr
    assert run.stdout.count("same columns on rank") == 2


def test_one_rank_stops_all_and_all_write_one_set_of_files() -> None:
    run = launch(2, "mpi_chain.py", "stop")
    assert run.returncode == 0, run.stderr
    assert run.stdout.count("stopped on rank") == 2


def test_a_mistake_that_one_rank_sees_is_raised_on_all() -> None:
    run = launch(2, "mpi_chain.py", "refuse")
    assert run.returncode == 0, run.stderr
    assert run.stdout.count("refused on rank") == 2


def test_an_error_that_is_not_caught_ends_all_ranks_with_its_message() -> None:
    run = launch(2, "mpi_chain.py", "crash")
    assert run.returncode != 0
    assert "rank 1 of 2:" in run.stderr and "RuntimeError: only here" in run.stderr


def test_quantities_of_one_rank_are_known_to_all() -> None:
    run = launch(2, "mpi_quantity.py")
    assert run.returncode == 0, run.stderr
    assert run.stdout.count("same answer on rank") == run.stdout.count("failed together on rank") == 2


@pytest.mark.parametrize("ranks", [2, 3])
def test_random_scenes_over_ranks_have_the_answers_of_one(ranks: int) -> None:
    run = launch(ranks, "mpi_random.py", "0", "14")
    assert run.returncode == 0, run.stdout + run.stderr
    assert run.stdout.count("same scene") == 14


def test_calls_and_arguments_that_differ_between_ranks_are_raised_on_all() -> None:
    run = launch(2, "mpi_agree.py", "differ")
    assert run.returncode == 0, run.stderr
    assert run.stdout.count("agreed on rank") == 2


def test_what_one_rank_is_refused_is_raised_on_all() -> None:
    run = launch(2, "mpi_agree.py", "refused")
    assert run.returncode == 0, run.stderr
    assert run.stdout.count("agreed on rank") == 2


def test_ranks_without_parts_are_quiet() -> None:
    run = launch(3, "mpi_agree.py", "idle")
    assert run.returncode == 0, run.stderr
    assert run.stdout.count("agreed on rank") == 3
    assert "On entry to" not in run.stdout + run.stderr, "BLAS complains of empty blocks"


def test_estimates_are_checked_over_ranks() -> None:
    run = launch(2, "mpi_agree.py", "check")
    assert run.returncode == 0, run.stderr
    assert run.stdout.count("agreed on rank") == 2


def test_parts_that_meet_on_several_ranks_have_the_traces_of_one() -> None:
    run = launch(2, "mpi_meet.py")
    assert run.returncode == 0, run.stdout + run.stderr
    assert run.stdout.count("as on one") == 2


def test_coarse_problem_newton_and_matrix_directions_are_those_of_one_rank() -> None:
    run = launch(3, "mpi_reach.py")
    assert run.returncode == 0, run.stdout + run.stderr
    assert run.stdout.count("all reached") == 3


@pytest.mark.parametrize("ranks", [2, 3])
def test_searches_and_reactions_are_those_of_one_rank(ranks: int) -> None:
    run = launch(ranks, "mpi_lifted.py")
    assert run.returncode == 0, run.stdout + run.stderr
    for what in ("search", "reactions", "sides"):
        assert run.stdout.count(f"same {what} on rank") == ranks


def test_points_side_by_side_and_derivatives_are_those_of_one_rank() -> None:
    run = launch(2, "mpi_together.py")
    assert run.returncode == 0, run.stdout + run.stderr
    assert run.stdout.count("same derivatives") == 2


def test_results_and_chaos_files_of_ranks_are_those_of_one(tmp_path: Path) -> None:
    run = launch(3, "mpi_files.py", "write", str(tmp_path))
    assert run.returncode == 0, run.stdout + run.stderr
    assert run.stdout.count("written") == 3


@pytest.mark.parametrize("how", ["raise", "kill"])
def test_checkpoints_survive_a_rank_that_ends(how: str, tmp_path: Path) -> None:
    ended = launch(2, "mpi_files.py", how, str(tmp_path))
    if how == "raise":
        assert ended.returncode == 0 and ended.stdout.count("raised") == 2, ended.stdout + ended.stderr
    else:
        assert ended.returncode != 0 and "signal 9" in (ended.stdout + ended.stderr).lower()
    run = launch(2, "mpi_files.py", "resume", str(tmp_path))
    assert run.returncode == 0, run.stdout + run.stderr
    assert run.stdout.count("resumed") == 2


def test_checkpoints_go_on_with_any_number_of_ranks(tmp_path: Path) -> None:
    for ranks, what, told in ((2, "some", "begun"), (3, "more", "gone on"), (1, "all", "gone on")):
        run = launch(ranks, "mpi_files.py", what, str(tmp_path))
        assert run.returncode == 0, run.stdout + run.stderr
        assert run.stdout.count(told) == ranks


def test_stiffnesses_of_parts_vary_over_ranks() -> None:
    run = launch(2, "mpi_stiffness.py")
    assert run.returncode == 0, run.stdout + run.stderr
    for what in ("random parts", "swept parts", "heat", "errors"):
        assert run.stdout.count(f"same {what} on rank") == 2


def test_what_the_first_rank_does_for_all(tmp_path: Path) -> None:
    run = launch(2, "mpi_gather.py", str(tmp_path))
    assert run.returncode == 0, run.stdout + run.stderr
    for what in ("folder", "proof", "function", "sheet", "support"):
        assert run.stdout.count(f"same {what} on rank") == 2


@pytest.mark.parametrize("ranks", [2, 3])
@pytest.mark.parametrize(
    ("call", "said"),
    [
        ("columns", ("same part", "same columns")),
        ("inside", ("same inside", "refused")),
        ("numbers", ("same estimates",)),
    ],
)
def test_a_part_whose_mesh_is_spread_over_the_ranks(ranks: int, call: str, said: tuple[str, ...]) -> None:
    run = launch(ranks, "mpi_spread.py", call)
    assert run.returncode == 0, run.stdout + run.stderr
    for what in said:
        assert run.stdout.count(f"{what} on rank") == ranks


@pytest.mark.parametrize(("ranks", "what"), [(2, "meshes"), (3, "meshes"), (2, "laws"), (3, "laws")])
def test_meshes_follow_the_question_over_ranks_as_on_one(ranks: int, what: str) -> None:
    run = launch(ranks, "mpi_meshes.py", "laws" if what == "laws" else "same")
    assert run.returncode == 0, run.stdout + run.stderr
    assert run.stdout.count(f"same {what} on rank") == ranks


def test_meshes_of_random_scenes_over_ranks() -> None:
    run = launch(2, "mpi_meshes.py", "random")
    assert run.returncode == 0, run.stdout + run.stderr
    assert run.stdout.count("same scatter on rank") == 2


def test_a_rank_that_cannot_mesh_its_part_again_ends_all() -> None:
    run = launch(2, "mpi_meshes.py", "fail")
    assert run.returncode == 0, run.stdout + run.stderr
    assert run.stdout.count("failed together on rank") == 2
    run = launch(2, "mpi_meshes.py", "kill")
    assert run.returncode != 0 and "signal 9" in (run.stdout + run.stderr).lower()
