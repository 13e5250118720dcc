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

pytestmark = [
    pytest.mark.mpi,
    pytest.mark.skipif(MPIRUN is None, reason="no mpirun in this environment"),
]


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


def holds(ranks: int, said: str | tuple[str, ...], program: str, *arguments: str) -> None:
    """A program ends well and every rank of it says so."""
    run = launch(ranks, program, *arguments)
    assert run.returncode == 0, run.stdout + run.stderr
    for each in (said,) if isinstance(said, str) else said:
        assert run.stdout.count(each) == ranks, each


def test_bars_over_three_ranks_have_the_digits_of_one_and_fail_together() -> None:
    holds(3, ("same on rank", "failed together on rank"), "mpi_kernel.py")


def test_blocks_over_two_ranks_have_the_digits_of_one() -> None:
    run = launch(2, "mpi_chain.py", "same")
    assert run.returncode == 0, run.stderr
    assert run.stdout.count("same on rank") == 2 * 3


def test_a_matrix_on_one_rank_and_a_mesh_on_the_other_are_as_on_one() -> None:
    holds(2, "same matrix on rank", "mpi_matrix.py")


def test_columns_of_two_ranks_have_the_digits_of_one_and_what_stops_one_stops_all() -> None:
    """Sweeps, samples and chaos; one set of files; a mistake that one rank sees is raised on all."""
    said = tuple(f"{what} on rank" for what in ("same columns", "stopped", "refused"))
    holds(2, said, "mpi_chain.py", "columns", "stop", "refuse")


def test_an_error_that_is_not_caught_ends_all_ranks_with_its_message() -> None:
    run = launch(2, "mpi_chain.py", "crash")
    assert run.returncode != 0
    assert "rank 1 of 2:" in run.stderr and "RuntimeError: only here" in run.stderr


def test_an_interrupt_of_one_rank_ends_all_with_what_is_done_or_its_reason() -> None:
    run = launch(2, "mpi_interrupt.py", "parts", "points", "outside")
    assert run.stdout.count("parts on rank") == run.stdout.count("points on rank") == 2, run.stderr
    assert run.returncode != 0
    assert "rank 1 of 2:" in run.stderr and "KeyboardInterrupt" in run.stderr


def test_an_interrupt_of_a_rank_that_waits_for_the_first_one_ends_all() -> None:
    run = launch(2, "mpi_interrupt.py", "waiting")
    assert run.returncode != 0
    assert "rank 1 of 2:" in run.stderr and "KeyboardInterrupt" in run.stderr and "Timeout" not in run.stderr


def test_quantities_of_one_rank_are_known_to_all() -> None:
    holds(2, ("same answer on rank", "failed together on rank"), "mpi_quantity.py")


NIGHT = pytest.mark.night(guard="the other cases of the same test")
"""Of repetitions that take long: with more ranks, or by another way through the same code."""


@pytest.mark.parametrize(("ranks", "first"), [(2, 0), pytest.param(3, 7, marks=NIGHT)])
def test_random_scenes_over_ranks_have_the_answers_of_one(ranks: int, first: int) -> None:
    run = launch(ranks, "mpi_random.py", str(first), str(first + 4))
    assert run.returncode == 0, run.stdout + run.stderr
    assert run.stdout.count("same scene") == 4


def test_what_differs_or_is_refused_on_one_rank_is_raised_on_all_and_estimates_are_checked() -> None:
    calls = "differ", "refused", "check"
    holds(2, tuple(f"{call}: agreed on rank" for call in calls), "mpi_agree.py", *calls)


def test_a_body_that_fails_between_two_reductions_fails_on_all_ranks() -> None:
    holds(2, "fail: agreed on rank", "mpi_agree.py", "fail")


def test_ranks_without_parts_are_quiet() -> None:
    run = launch(3, "mpi_agree.py", "idle")
    assert run.returncode == 0, run.stderr
    assert run.stdout.count("idle: agreed on rank") == 3
    assert "On entry to" not in run.stdout + run.stderr, "BLAS complains of empty blocks"


def test_parts_that_meet_on_several_ranks_have_the_traces_of_one() -> None:
    holds(2, "as on one", "mpi_meet.py")


def test_contradictions_between_ranks_are_refused_in_the_words_of_one() -> None:
    holds(2, "as on one", "mpi_contradict.py")


def test_coarse_problem_newton_and_matrix_directions_are_those_of_one_rank() -> None:
    holds(3, "all reached", "mpi_reach.py")


def test_searches_and_reactions_are_those_of_one_rank() -> None:
    holds(3, tuple(f"same {what} on rank" for what in ("search", "reactions", "sides")), "mpi_lifted.py")


def test_points_side_by_side_and_derivatives_are_those_of_one_rank() -> None:
    holds(2, "same derivatives", "mpi_together.py")


def test_results_and_chaos_files_of_ranks_are_those_of_one(tmp_path: Path) -> None:
    holds(3, "written", "mpi_files.py", "write", str(tmp_path))


@pytest.mark.parametrize("how", ["raise", "kill"])
def test_checkpoints_survive_a_rank_that_ends(how: str, tmp_path: Path) -> None:
    ended = launch(2, "mpi_files.py", how, str(tmp_path))
    if how == "raise":
        assert ended.returncode == 0 and ended.stdout.count("raised") == 2, ended.stdout + ended.stderr
    else:
        assert ended.returncode != 0 and "signal 9" in (ended.stdout + ended.stderr).lower()
    holds(2, "resumed", "mpi_files.py", "resume", str(tmp_path))


@pytest.mark.night(guard="test_checkpoints_survive_a_rank_that_ends")
def test_checkpoints_go_on_with_any_number_of_ranks(tmp_path: Path) -> None:
    for ranks, what, told in ((2, "some", "begun"), (3, "more", "gone on"), (1, "all", "gone on")):
        run = launch(ranks, "mpi_files.py", what, str(tmp_path))
        assert run.returncode == 0, run.stdout + run.stderr
        assert run.stdout.count(told) == ranks


def test_stiffnesses_of_parts_vary_over_ranks() -> None:
    what = "random parts", "swept parts", "heat", "errors"
    holds(2, tuple(f"same {each} on rank" for each in what), "mpi_stiffness.py")


def test_what_the_first_rank_does_for_all(tmp_path: Path) -> None:
    what = "folder", "proof", "function", "sheet", "support", "reference"
    holds(2, tuple(f"same {each} on rank" for each in what), "mpi_gather.py", str(tmp_path))


@pytest.mark.parametrize(
    ("ranks", "call", "said"),
    [
        pytest.param(2, "inside", ("same inside", "refused"), marks=NIGHT),
        (3, "columns", ("same part", "same columns")),
        pytest.param(2, "points", ("same points",), marks=NIGHT),
        pytest.param(3, "numbers", ("same estimates",), marks=NIGHT),
        (2, "meshes", ("same meshes",)),
    ],
)
def test_a_part_whose_mesh_is_spread_over_the_ranks(ranks: int, call: str, said: tuple[str, ...]) -> None:
    holds(ranks, tuple(f"{what} on rank" for what in said), "mpi_spread.py", call)


@pytest.mark.parametrize(
    ("ranks", "call", "what"), [(3, "same", "meshes"), pytest.param(2, "laws", "laws", marks=NIGHT)]
)
def test_meshes_follow_the_question_over_ranks_as_on_one(ranks: int, call: str, what: str) -> None:
    holds(ranks, f"same {what} on rank", "mpi_meshes.py", call)


@pytest.mark.night(guard="test_meshes_follow_the_question_over_ranks_as_on_one")
def test_meshes_of_random_scenes_over_ranks() -> None:
    holds(2, "same scatter on rank", "mpi_meshes.py", "random")


def test_a_rank_that_cannot_mesh_its_part_again_ends_all() -> None:
    holds(2, "failed together on rank", "mpi_meshes.py", "fail")
    run = launch(2, "mpi_meshes.py", "kill")
    assert run.returncode != 0 and "signal 9" in (run.stdout + run.stderr).lower()


@pytest.mark.parametrize(
    ("ranks", "calls"),
    [
        (2, {"solve": "same solutions", "fail": "failed together"}),
        pytest.param(2, {"points": "same points", "shared": "shared points"}, marks=NIGHT),
        pytest.param(3, {"solve": "same solutions"}, marks=NIGHT),
    ],
)
def test_multigrid_over_ranks_has_the_answers_of_factors(ranks: int, calls: dict[str, str]) -> None:
    """With three ranks one has no part."""
    holds(ranks, tuple(f"{said} on rank" for said in calls.values()), "mpi_multigrid.py", *calls)
