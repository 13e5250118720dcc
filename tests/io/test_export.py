"""Problems as folders, solved by ``latin_run`` without Python: the same digits, or one clear error."""

from __future__ import annotations

import hashlib
import os
import random
import re
import resource
import shutil
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dolfinx_frontend as lt
from dolfinx_frontend.formats import hdf5
from tests.verification.scenes import demo

h5py = pytest.importorskip("h5py")
PROGRAM = shutil.which("latin_run")
pytestmark = pytest.mark.skipif(PROGRAM is None, reason="latin_run was built without HDF5")

FUZZED = int(os.environ.get("LATIN_FUZZED_FOLDERS", "24"))
"""Damaged folders of each kind."""


def run(folder: Path, *more: str, ranks: int = 1) -> subprocess.CompletedProcess[str]:
    start = [] if ranks == 1 else ["mpirun", "-n", str(ranks)]
    environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    command = [*start, str(PROGRAM), str(folder), *more]
    return subprocess.run(command, capture_output=True, text=True, check=False, env=environment, timeout=120)


def solved(folder: Path, *more: str, ranks: int = 1) -> lt.SavedResult:
    done = run(folder, *more, ranks=ranks)
    assert done.returncode == 0, done.stdout + done.stderr
    return lt.load(folder / "result.h5")


def blocks(law: Any = None, count: int = 3, force: Any = 0.2) -> lt.Scene:
    """Blocks in a row, clamped at the left and pulled, or pushed, at the right."""
    scene = lt.Scene()
    for k in range(count):
        block = lt.geometry.box((1.0, 1.0, 1.0), (2, 2, 2), origin=(k, 0, 0), cell="hexahedron")
        scene.substructure(f"block {k}", block, lt.LinearElastic(E=1.0, nu=0.2), degree=1)
    for k in range(count - 1):
        last = k == count - 2 and law is not None
        joint = law if last else lt.Elastic(normal=1.0, tangential=0.5)
        scene.interface(f"joint/{k}", f"block {k}:x1", f"block {k + 1}:x0", joint)
    scene.fix("block 0:x0")
    scene.pressure(f"block {count - 1}:x1", force)
    if law is not None:
        scene.interface("ground", f"block {count - 1}:x1", lt.Elastic(normal=0.1, tangential=0.1))
    return scene


def same(reference: Any, found: lt.SavedResult, tolerance: float = 0.0, parts: bool = True) -> None:
    """Force, jump and displacements agree, relative to the largest of each field."""

    def close(one: Any, other: Any) -> None:
        assert one.shape == other.shape
        assert np.abs(one - other).max() <= tolerance * np.abs(one).max()

    for name in reference.plan.active:
        close(reference.force(name), found.force(name))
        close(reference.jump(name), found.jump(name))
    for name in reference.problem.substructures if parts else ():
        close(reference.unknowns(name), found.unknowns(name))


@pytest.fixture(scope="module")
def elastic() -> lt.Problem:
    return lt.assemble(blocks())


# --- the same digits -------------------------------------------------------------------------------


def test_one_solution(elastic: lt.Problem, tmp_path: Path) -> None:
    assert elastic.export(tmp_path / "made" / "here", "accelerated") == tmp_path / "made" / "here"
    reference, found = lt.solve(elastic, "accelerated"), solved(tmp_path / "made" / "here")
    same(reference, found)
    assert (found.kind, found.status) == ("deterministic", "converged")
    assert found.iterations == reference.iterations
    assert found.error == reference.error
    # the same row of the table, and a displacement on the mesh
    (row,), (wanted,) = (each.table("joint/0").rows() for each in (found, reference))
    assert row == pytest.approx(wanted, rel=1e-10, abs=1e-14, nan_ok=True)
    assert found.displacement("block 1").x.array.shape == reference.displacement("block 1").x.array.shape


def test_direct_solution(elastic: lt.Problem, tmp_path: Path) -> None:
    """Without the corrections that solve makes: rounding differs by the condition number, here some 1e4."""
    elastic.export(tmp_path)
    reference = lt.solve(elastic)
    assert reference.plan.method == "direct"
    same(reference, solved(tmp_path), 1e-11)


@pytest.mark.mpi
def test_ranks_share_the_bodies(elastic: lt.Problem, tmp_path: Path) -> None:
    elastic.export(tmp_path, "accelerated", options=lt.Options(rtol=1e-12))
    reference = lt.solve(elastic, "accelerated", options=lt.Options(rtol=1e-12))
    for ranks in (2, 3):
        same(reference, solved(tmp_path, ranks=ranks), 1e-11)


def test_friction_over_time(tmp_path: Path) -> None:
    times = np.linspace(0.0, 1.0, 4)
    ramp = lt.Amplitude([0.0, 1.0], [0.0, 1.0])
    scene = blocks(lt.Contact(friction=0.3, gap=0.01), force=ramp * 0.2)
    problem = lt.assemble(scene)
    problem.export(tmp_path, times=times)
    reference, found = lt.solve(problem, times=times), solved(tmp_path)
    same(reference, found)
    assert found.kind == "history" and np.array_equal(found.times, times)


def test_linear_history(elastic: lt.Problem, tmp_path: Path) -> None:
    """Load patterns are superposed by the reader, as by the result."""
    scene = blocks(force=lt.Amplitude([0.0, 1.0, 2.0], [0.0, 1.0, 4.0]) * 0.2)
    problem = lt.assemble(scene)
    times = [0.5, 1.0, 2.0]
    problem.export(tmp_path, "accelerated", times=times)
    same(lt.solve(problem, "accelerated", times=times), solved(tmp_path))


def test_sweep(elastic: lt.Problem, tmp_path: Path) -> None:
    grid = {"joint/0.normal": [1.0, 2.0, 4.0], "joint/1.normal": [0.5, 1.5]}
    elastic.export(tmp_path, grid=grid)
    reference, found = lt.sweep(elastic, grid, progress=False), solved(tmp_path)
    same(reference, found, parts=False)
    assert found.shape == (3, 2) and list(found.axes) == list(grid)
    assert found.iterations == reference.iterations.sum()
    assert found.point(1, 1).status == "converged"


def test_sweep_of_the_command_line(elastic: lt.Problem, tmp_path: Path) -> None:
    """A uniform stiffness per area: for faces of area 1 what the scene's sweep takes."""
    elastic.export(tmp_path, "accelerated", active=["joint/0", "joint/1"])
    found = solved(tmp_path, "--sweep", "joint/0.normal=1,2,4")
    plan = lt.make_plan(elastic, "accelerated", active=["joint/0", "joint/1"])
    reference = lt.sweep(elastic, {"joint/0.normal": [1.0, 2.0, 4.0]}, plan=plan, progress=False)
    same(reference, found, parts=False)


def test_displacements_of_a_sweep(elastic: lt.Problem, tmp_path: Path) -> None:
    grid = {"joint/0.normal": [1.0, 2.0, 4.0], "joint/1.normal": [0.5, 1.5]}
    elastic.export(tmp_path, grid=grid)
    assert "--displacements" in str(solved(tmp_path).without_displacements)
    reference = lt.sweep(elastic, grid, progress=False, keep_states=True)
    reference.save(tmp_path / "kept.h5")
    kept, found = lt.load(tmp_path / "kept.h5"), solved(tmp_path, "--displacements")
    same(reference, found, parts=False)
    for one, other in zip(kept.blocks(), found.blocks(), strict=True):
        for part in elastic.substructures:
            here, there = one.displacement(part, None), other.displacement(part, None)
            assert here.shape == there.shape and here.shape[0] == 6
            assert np.abs(here - there).max() <= 1e-13 * np.abs(here).max()


def test_displacements_of_a_sweep_over_loads(tmp_path: Path) -> None:
    """They are those under the loads of the point."""
    scene = blocks()
    scene.point_force("block 2", (3.0, 1.0, 1.0), (1e-3, 0.0, 0.0), name="push")
    problem, grid = lt.assemble(scene), {"push.x": [0.0, 1e-3, 3e-3]}
    problem.export(tmp_path, grid=grid)
    reference = lt.sweep(problem, grid, progress=False, keep_states=True)
    found = solved(tmp_path, "--displacements")
    (one,), (other,) = list(reference.blocks()), list(found.blocks())
    for part in problem.substructures:
        here, there = one.displacement(part, None), other.displacement(part, None)
        assert np.abs(here[2] - here[0]).max() > 1e-4 * np.abs(here).max()
        assert np.abs(here - there).max() <= 1e-13 * np.abs(here).max()


def test_displacements_of_a_sweep_in_time(tmp_path: Path) -> None:
    problem = lt.assemble(blocks(force=lt.Amplitude([0.0, 1.0, 2.0], [0.0, 1.0, 4.0]) * 0.2))
    grid, times = {"joint/0.normal": [1.0, 2.0, 4.0]}, [0.5, 1.0, 2.0]
    problem.export(tmp_path, grid=grid, times=times)
    reference = lt.sweep(problem, grid, times=times, progress=False, keep_states=True)
    found = solved(tmp_path, "--displacements")
    (one,), (other,) = list(reference.blocks()), list(found.blocks())
    for part in problem.substructures:
        here, there = one.displacement(part, None), other.displacement(part, None)
        assert here.shape == there.shape
        assert np.abs(here - there).max() <= 1e-13 * np.abs(here).max()


def random_scene(law: Any) -> lt.Problem:
    return lt.assemble(blocks(law))


def test_chaos(tmp_path: Path) -> None:
    stiffness = lt.LogNormal(mean=1.0, cov=0.2, name="stiffness")
    problem = random_scene(lt.Elastic(normal=stiffness, tangential=0.5))
    problem.export(tmp_path, chaos=3)
    reference, found = lt.solve(problem, chaos=3), solved(tmp_path)
    same(reference, found)
    points = reference.space.sample(7, 1)
    name = "joint/1"
    for what in ("force", "jump"):
        here, there = (getattr(each.at(points), what)(name) for each in (reference, found))
        assert np.allclose(here, there, rtol=1e-13, atol=0.0)
    assert np.allclose(reference.deviation("block 2"), found.deviation("block 2"), rtol=1e-13, atol=0.0)
    assert found.table(name, samples=50).columns


def test_chaos_of_a_nonlinear_law(tmp_path: Path) -> None:
    gap = lt.Normal(mean=0.02, std=0.005, name="gap")
    problem = random_scene(lt.Contact(gap=gap))
    chaos = lt.Chaos(2, check_points=0)
    problem.export(tmp_path, chaos=chaos)
    same(lt.solve(problem, chaos=chaos), solved(tmp_path))


# --- what cannot be exported -----------------------------------------------------------------------


def test_laws_of_users_are_named(tmp_path: Path) -> None:
    law = lt.UserLaw(force=lambda jump, k: k[:, None] * jump, values={"k": 1.0}, name="mine")
    problem = lt.assemble(blocks(law))
    with pytest.raises(lt.SceneError, match=r"interface 'joint/1': its law 'mine' is written in Python"):
        problem.export(tmp_path)


def test_one_computation_a_folder(elastic: lt.Problem, tmp_path: Path) -> None:
    with pytest.raises(lt.SceneError, match="chaos and grid are two computations"):
        elastic.export(tmp_path, chaos=2, grid={"joint/0.normal": [1.0]})


def refused(done: subprocess.CompletedProcess[str]) -> str:
    """What the program says: one line."""
    assert done.returncode == 2, (done.returncode, done.stdout, done.stderr[-2000:])
    assert done.stderr.startswith("latin_run: ") and done.stderr.count("\n") == 1, done.stderr[-2000:]
    return done.stderr


# --- exit codes ------------------------------------------------------------------------------------


def sliding(shear: float) -> lt.Scene:
    """A block on a block, which friction of 0.2 holds against a shear below 0.2 of the pressure."""
    scene = lt.Scene()
    for k in range(2):
        block = lt.geometry.box((1.0, 1.0, 1.0), (1, 1, 1), origin=(k, 0, 0), cell="hexahedron")
        scene.substructure(f"block {k}", block, lt.LinearElastic(E=100.0, nu=0.0), degree=1)
    scene.interface("joint", "block 0:x1", "block 1:x0", lt.Contact(friction=0.2))
    scene.fix("block 0:x0")
    press, push = lt.Amplitude([0, 1], [0, 1]), lt.Amplitude([1, 2], [0, 1])
    scene.traction("block 1:x1", press * (-1.0, 0.0, 0.0), name="press")
    scene.traction("block 1:x1", push * (0.0, shear, 0.0), name="push")
    return scene


def endless(problem: lt.Problem, folder: Path) -> Path:
    """With a search direction so far off that it hardly moves."""
    options = lt.Options(rtol=1e-15, max_iterations=10**9, stagnation_window=10**9, newton=0)
    return problem.export(folder, "latin", direction=1e-6, active="all", options=options)


def test_exit_codes_by_faults(elastic: lt.Problem, tmp_path: Path) -> None:
    """As those of `latin run`; an answer that is not right is written with its status."""
    folder = elastic.export(tmp_path / "right", "accelerated")
    assert run(folder).returncode == 0
    times = [1.0, 2.0]
    assert run(lt.assemble(sliding(0.05)).export(tmp_path / "held", times=times)).returncode == 0
    lost = lt.assemble(sliding(1.0)).export(tmp_path / "lost", times=times)
    done = run(lost)
    assert done.returncode == 3, done.stdout + done.stderr
    assert lt.load(lost / "result.h5").status == "slides"
    few = elastic.export(tmp_path / "few", "latin", options=lt.Options(max_iterations=1, newton=0))
    assert run(few).returncode == 4 and lt.load(few / "result.h5").status == "max_iterations"
    late = run(few, "--max-seconds", "1e-9")
    assert late.returncode == 5 and lt.load(few / "result.h5").status == "time_limit"


def test_out_of_memory(elastic: lt.Problem, tmp_path: Path) -> None:
    """Ten million points, whose fields have no room in 3 GB."""
    folder = elastic.export(tmp_path, "accelerated")
    axes = [f"joint/{k}.{name}={','.join(['1'] * 56)}" for k in (0, 1) for name in ("normal", "tangential")]
    command = [str(PROGRAM), str(folder), *(each for axis in axes for each in ("--sweep", axis))]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, timeout=120,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (3 * 10**9, 3 * 10**9)),
    )
    assert done.returncode == 5, done.stdout + done.stderr
    assert done.stderr.count("\n") == 1 and "not enough memory" in done.stderr


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_with_what_is_known(elastic: lt.Problem, tmp_path: Path, number: int) -> None:
    folder = endless(elastic, tmp_path)
    process = subprocess.Popen([str(PROGRAM), str(folder)], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    caught = 0
    while process.poll() is None and not caught >> (number - 1) & 1:
        status = Path(f"/proc/{process.pid}/status").read_text()
        caught = int(re.search(r"SigCgt:\s*(\w+)", status)[1], 16)  # type: ignore[index]
    process.send_signal(number)
    _, said = process.communicate(timeout=120)
    assert process.returncode == 130, said
    assert lt.load(folder / "result.h5").status == "interrupted"


# --- one clear error -------------------------------------------------------------------------------


def test_an_older_problem_stays_until_the_new_one_is_whole(
    elastic: lt.Problem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = elastic.export(tmp_path / "folder", "accelerated")
    before = {each: each.read_bytes() for each in folder.rglob("*") if each.is_file()}

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    other = lt.assemble(blocks(count=2))
    with monkeypatch.context() as patch:
        patch.setattr(hdf5, "write_tree", full)
        with pytest.raises(lt.io.FileError, match="No space left on device"):
            other.export(folder, "accelerated")
    assert {each: each.read_bytes() for each in folder.rglob("*") if each.is_file()} == before
    same(lt.solve(elastic, "accelerated"), solved(folder))
    # and the new one leaves nothing of it
    other.export(folder, "accelerated")
    same(lt.solve(other, "accelerated"), solved(folder))
    assert not {each for each in before if each.suffix == ".petsc"} & set(folder.rglob("*"))


def test_what_an_answer_may_replace(elastic: lt.Problem, tmp_path: Path) -> None:
    """As what Python writes: a file, or the one that a link leads to; nothing of the problem."""
    folder = elastic.export(tmp_path / "folder", "accelerated")
    pipe, link, circle, victim = (tmp_path / name for name in ("pipe", "link", "circle", "victim"))
    os.mkfifo(pipe)
    victim.write_text("old")
    link.symlink_to("victim")
    circle.symlink_to(circle)
    (tmp_path / "own").symlink_to(folder / "problem.h5")
    (tmp_path / "new").symlink_to("made.h5")
    before = (folder / "problem.h5").read_bytes()
    matrix = next((folder / "matrices").iterdir())
    for target, said in (
        (pipe, "it is a pipe, a socket or a device"),
        (tmp_path, "it is a folder"),
        (circle, "leads back to itself"),
        (folder / "problem.h5", "is a file of the problem itself"),
        (tmp_path / "own", "is a file of the problem itself"),
        (matrix, "is a file of the problem itself"),
    ):
        assert said in refused(run(folder, "--output", str(target)))
    assert pipe.is_fifo() and (folder / "problem.h5").read_bytes() == before
    for name, file in (("link", victim), ("new", tmp_path / "made.h5")):
        assert run(folder, "--output", str(tmp_path / name)).returncode == 0
        assert (tmp_path / name).is_symlink() and lt.load(file).converged


def test_errors_are_one_line_that_names_the_file(elastic: lt.Problem, tmp_path: Path) -> None:
    folder = elastic.export(tmp_path / "folder", "accelerated")
    path = folder / "problem.h5"
    whole = path.read_bytes()
    odd = (("interfaces/0", "law"), ("laws/parameters/0", "interface"), ("interfaces/0", "name"))
    for place, name in odd:
        path.write_bytes(whole)
        with h5py.File(path, "r+") as file:
            file[place].attrs[name] = "a\nb"
        hdf5.seal(path, "latin-problem")
        said = refused(run(folder))
        assert str(path) in said and "a b" in said
    path.write_bytes(whole)
    assert "problem.h5: no active interface 'nothere'" in refused(run(folder, "--sweep", "nothere.normal=1"))
    axes = [f"joint/{k}.{name}={','.join(['1'] * 3000)}" for k in (0, 1) for name in ("normal", "tangential")]
    many = run(folder, *(each for axis in axes for each in ("--sweep", axis)))
    assert "more than 10000000 points: give fewer values" in refused(many)


def test_wrong_calls(elastic: lt.Problem, tmp_path: Path) -> None:
    elastic.export(tmp_path, "accelerated")
    assert "is no folder" in refused(run(tmp_path / "nothing"))
    (tmp_path / "empty").mkdir()
    assert "does not exist" in refused(run(tmp_path / "empty"))
    assert "no option --fast" in refused(run(tmp_path, "--fast"))
    for axis in ("joint", "joint/0.normal=", "joint/0.normal=1,,2", "joint/0.normal=nan", ".=1"):
        assert "INTERFACE.PARAMETER=VALUE" in refused(run(tmp_path, "--sweep", axis))
    assert "nothere" in refused(run(tmp_path, "--sweep", "nothere.normal=1"))
    for seconds in ("", "-1", "nan", "1s"):
        assert "give a number > 0" in refused(run(tmp_path, "--max-seconds", seconds))
    assert "strength" in refused(run(tmp_path, "--sweep", "joint/0.strength=1"))
    assert "cannot be written" in refused(run(tmp_path, "--output", str(tmp_path / "no" / "x.h5")))
    assert "usage:" in run(tmp_path, "--help").stdout


@pytest.mark.mpi
def test_too_many_ranks(elastic: lt.Problem, tmp_path: Path) -> None:
    elastic.export(tmp_path, "accelerated")
    done = run(tmp_path, ranks=4)
    assert done.returncode and "bodies, each on one rank" in done.stderr
    assert done.stderr.count("latin_run:") == 1


def test_foreign_files(elastic: lt.Problem, tmp_path: Path) -> None:
    elastic.export(tmp_path / "folder", "accelerated")
    lt.solve(elastic).save(tmp_path / "result.h5")
    shutil.copy(tmp_path / "result.h5", tmp_path / "folder" / "problem.h5")
    assert "no latin-problem file" in refused(run(tmp_path / "folder"))
    with pytest.raises(lt.ResultFileError):
        lt.load(tmp_path / "folder" / "matrices" / "0000.petsc")


DAMAGES: dict[str, Callable[[Path], object]] = {
    "no folder": shutil.rmtree,
    "an empty folder": lambda f: [shutil.rmtree(f / "matrices"), (f / "problem.h5").unlink()],
    "no description": lambda f: (f / "problem.h5").unlink(),
    "an empty description": lambda f: (f / "problem.h5").write_bytes(b""),
    "half a description": lambda f: halve(f / "problem.h5"),
    "a text as description": lambda f: (f / "problem.h5").write_text("a problem"),
    "a seal without content": lambda f: (f / "problem.h5").write_bytes((f / "problem.h5").read_bytes()[:512]),
    "content without a seal": lambda f: (f / "problem.h5").write_bytes((f / "problem.h5").read_bytes()[512:]),
    "a folder as description": lambda f: as_folder(f / "problem.h5"),
    "the seal of another content": lambda f: (f / "problem.h5").write_bytes(
        (f / "problem.h5").read_bytes()[:-1] + b"!"
    ),
    "a result as description": lambda f: (f / "problem.h5").write_bytes(
        b"latin-run" + (f / "problem.h5").read_bytes()[9:]
    ),
    "a newer version": lambda f: rewrite(f, lambda file: file.attrs.__setitem__("version", 99)),
    "no matrices": lambda f: shutil.rmtree(f / "matrices"),
    "a matrix less": lambda f: matrix(f).unlink(),
    "half a matrix": lambda f: halve(matrix(f)),
    "an empty matrix": lambda f: matrix(f).write_bytes(b""),
    "a longer matrix": lambda f: matrix(f).write_bytes(matrix(f).read_bytes() + b"more"),
    "a text as matrix": lambda f: matrix(f).write_text("a matrix"),
    "a folder as matrix": lambda f: as_folder(matrix(f)),
    "another number in a matrix": lambda f: matrix(f).write_bytes(matrix(f).read_bytes()[:-8] + bytes(8)),
    "matrices that are exchanged": lambda f: swap(*sorted((f / "matrices").iterdir())[:2]),
    "no bodies": lambda f: rewrite(f, lambda file: file.__delitem__("bodies")),
    "no options": lambda f: rewrite(f, lambda file: file.__delitem__("options")),
    "a matrix outside": lambda f: rewrite(f, outside),
    "a matrix that is a link": lambda f: linked(matrix(f), f.parent),
    "matrices behind a link": lambda f: linked(f / "matrices", f.parent),
    "a group of another file": lambda f: rewrite(f, lambda file: external(f, file, "options")),
    "numbers of another file": lambda f: rewrite(f, lambda file: external(f, file, "amplitudes")),
    "a group by a soft link": lambda f: rewrite(f, softly),
    "a group of two names": lambda f: rewrite(f, lambda file: file.__setitem__("again", file["options"])),
    "numbers of two names": lambda f: rewrite(f, lambda file: file.__setitem__("again", file["amplitudes"])),
    "numbers that are stored elsewhere": lambda f: rewrite(f, lambda file: stored_elsewhere(f, file)),
    **{
        f"{index} as index of a column": lambda f, index=index: change_matrix(f, indices=index)
        for index in (-5, 2**30, "columns", "unsorted")
    },
    "a row of negative length": lambda f: change_matrix(f, lengths=-1),
    "more rows than the file has": lambda f: change_matrix(f, rows=2_000_000_000),
    "more entries than the file has": lambda f: change_matrix(f, entries=2_000_000_000),
    "NaN in a matrix": lambda f: change_matrix(f, values=np.nan),
}


def linked(path: Path, outside: Path) -> None:
    path.rename(outside / "elsewhere")
    path.symlink_to(outside / "elsewhere")


def external(folder: Path, file: Any, name: str) -> None:
    with h5py.File(folder.parent / "other.h5", "w") as other:
        file.copy(name, other)
    del file[name]
    file[name] = h5py.ExternalLink(str(folder.parent / "other.h5"), "/" + name)


def softly(file: Any) -> None:
    file.move("options", "settings")
    file["options"] = h5py.SoftLink("/settings")


def stored_elsewhere(folder: Path, file: Any) -> None:
    values = file["amplitudes"][()]
    del file["amplitudes"]
    (folder.parent / "raw").write_bytes(values.tobytes())
    place = [(str(folder.parent / "raw"), 0, values.nbytes)]
    file.create_dataset("amplitudes", values.shape, values.dtype, external=place)


def change_matrix(folder: Path, **changes: Any) -> None:
    """A matrix of several entries a row with another number, and the checksum that goes with it."""
    with h5py.File(folder / "problem.h5", "r+") as file:
        files = list(file["matrices/files"].asstr()[()])
        for number, name in enumerate(files):
            data = (folder / name).read_bytes()
            head = np.frombuffer(data, ">i4", 4).copy()
            _, rows, columns, entries = (int(each) for each in head)
            if entries > 2 * rows:
                break
        lengths = np.frombuffer(data, ">i4", rows, 16).copy()
        indices = np.frombuffer(data, ">i4", entries, 16 + 4 * rows).copy()
        values = np.frombuffer(data, ">f8", entries, 16 + 4 * (rows + entries)).copy()
        for what, value in changes.items():
            if value == "unsorted":
                indices[:2] = indices[1::-1]
            elif what == "lengths":
                lengths[:2] = value, lengths[:2].sum() - value
            elif what in ("rows", "entries"):
                head[1 if what == "rows" else 3] = value
            else:
                (indices if what == "indices" else values)[-1] = columns if value == "columns" else value
        data = b"".join(each.tobytes() for each in (head, lengths, indices, values))
        (folder / files[number]).write_bytes(data)
        sums = list(file["matrices/sha256"].asstr()[()])
        sums[number] = hashlib.sha256(data).hexdigest()
        file["matrices/sha256"][...] = sums
    seal(folder / "problem.h5")


def matrix(folder: Path) -> Path:
    return min((folder / "matrices").iterdir())


def as_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def halve(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def swap(one: Path, other: Path) -> None:
    kept = one.read_bytes()
    one.write_bytes(other.read_bytes())
    other.write_bytes(kept)


def rewrite(folder: Path, change: Callable[[Any], object]) -> None:
    with h5py.File(folder / "problem.h5", "r+") as file:
        change(file)
    seal(folder / "problem.h5")


def outside(file: Any) -> None:
    files = file["matrices/files"][()]
    files[0] = "../../secret"
    file["matrices/files"][...] = files


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_each_damage_is_one_error(
    elastic: lt.Problem, tmp_path: Path, damage: Callable[[Path], object]
) -> None:
    folder = elastic.export(tmp_path / "folder", "accelerated")
    damage(folder)
    done = run(folder)
    assert "folder" in refused(done) and done.stderr.count("\n") == 1
    assert not (folder / "result.h5").exists()


def test_names_of_matrices_reach_no_shell(elastic: lt.Problem, tmp_path: Path) -> None:
    folder = elastic.export(tmp_path / "folder", "accelerated")
    name = "matrices/a.gz;touch executed;"
    with h5py.File(folder / "problem.h5", "r+") as file:
        files = list(file["matrices/files"].asstr()[()])
        (folder / files[0]).rename(folder / name)
        file["matrices/files"][...] = [name, *files[1:]]
    seal(folder / "problem.h5")
    done = subprocess.run([str(PROGRAM), str(folder)], capture_output=True, check=False, cwd=tmp_path)
    assert done.returncode == 0 and not (tmp_path / "executed").exists()


def test_options_of_petsc_are_not_read(tmp_path: Path) -> None:
    (tmp_path / "evil.c").write_text(
        "#include <stdio.h>\n"
        '__attribute__((constructor)) static void f(void) { fclose(fopen("executed", "w")); }\n'
    )
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("no C compiler")
    subprocess.run([compiler, "-shared", "-fPIC", "-o", "evil.so", "evil.c"], check=True, cwd=tmp_path)
    option = "-dll_prepend ./evil.so"
    for home, variables in (("home", {}), (".", {}), ("none", {"PETSC_OPTIONS": option})):
        (tmp_path / "home").mkdir(exist_ok=True)
        if not variables:
            (tmp_path / home / ".petscrc").write_text(option + "\n")
        environment = {**os.environ, "HOME": str(tmp_path / home), **variables}
        how: dict[str, Any] = {"cwd": tmp_path, "env": environment, "capture_output": True, "text": True}
        done = subprocess.run([str(PROGRAM), "nothing"], check=False, **how)
        assert done.returncode == 2 and "is no folder" in done.stderr
        assert not (tmp_path / "executed").exists(), home
        (tmp_path / home / ".petscrc").unlink(missing_ok=True)


def test_nothing_is_written_through_links(elastic: lt.Problem, tmp_path: Path) -> None:
    folder = elastic.export(tmp_path / "folder", "accelerated")
    precious = tmp_path / "precious"
    precious.write_text("precious")
    (folder / "result.h5").symlink_to(precious)
    # the names that it had once: those of the next processes
    last = int(Path("/proc/sys/kernel/ns_last_pid").read_text())
    for number in range(last, last + 400):
        (folder / f"result.h5.{number}.part").symlink_to(precious)
    assert run(folder).returncode == 0
    assert precious.read_text() == "precious" and not (folder / "result.h5").is_symlink()
    assert not [each for each in folder.glob("*.part") if not each.is_symlink()]


@pytest.mark.mpi
def test_a_rank_that_fails_alone_ends_all(elastic: lt.Problem, tmp_path: Path) -> None:
    folder = elastic.export(tmp_path / "folder", "accelerated")
    wrong = f'[ "$OMPI_COMM_WORLD_RANK$PMI_RANK" = 0 ] || set -- --nonsense; exec {PROGRAM} {folder} "$@"'
    command = ["mpirun", "-n", "2", "sh", "-c", wrong]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode and "latin_run: there is no option --nonsense" in done.stderr


@pytest.mark.mpi
@pytest.mark.parametrize("damage", ["half a matrix", "half a description", "no options"])
def test_all_ranks_say_one_error(elastic: lt.Problem, tmp_path: Path, damage: str) -> None:
    folder = elastic.export(tmp_path / "folder", "accelerated")
    DAMAGES[damage](folder)
    done = run(folder, ranks=2)
    assert done.returncode == 2 and done.stderr.count("latin_run:") == 1


@pytest.mark.mpi
def test_all_ranks_have_one_exit_code(elastic: lt.Problem, tmp_path: Path) -> None:
    lost = lt.assemble(sliding(1.0)).export(tmp_path / "lost", times=[1.0, 2.0])
    assert run(lost, ranks=2).returncode == 3
    folder = elastic.export(tmp_path / "folder", "latin", options=lt.Options(max_iterations=1, newton=0))
    assert run(folder, ranks=2).returncode == 4
    assert run(endless(elastic, tmp_path / "slow"), "--max-seconds", "0.1", ranks=2).returncode == 5


def flip(path: Path, dice: random.Random) -> None:
    data = bytearray(path.read_bytes())
    for _ in range(dice.choice((1, 1, 8, 64))):
        data[dice.randrange(len(data))] ^= 1 << dice.randrange(8)
    path.write_bytes(data)


def cut(path: Path, dice: random.Random) -> None:
    data = path.read_bytes()
    path.write_bytes(data[: dice.randrange(len(data))])


def lengthen(path: Path, dice: random.Random) -> None:
    path.write_bytes(path.read_bytes() + dice.randbytes(dice.randrange(1, 99)))


def lose(path: Path, dice: random.Random) -> None:
    path.unlink()


@pytest.mark.night(guard="test_each_damage_is_one_error")
@pytest.mark.slow
def test_damaged_folders(elastic: lt.Problem, tmp_path: Path) -> None:
    """Any bit that changes anywhere is found before PETSc or HDF5 see it."""
    whole = elastic.export(tmp_path / "whole", "accelerated")
    dice = random.Random(5)
    for _ in range(FUZZED):
        folder = tmp_path / "damaged"
        shutil.copytree(whole, folder)
        files = sorted(path for path in folder.rglob("*") if path.is_file())
        path = dice.choice([folder / "problem.h5", *files])
        damage: Callable[[Path, random.Random], None] = dice.choice((flip, cut, lengthen, lose))
        damage(path, dice)
        # a flip may be undone by the next, and some bytes of the first 512 say nothing
        if damage is flip and run(folder).returncode == 0:
            before, after = (each.read_bytes() for each in (whole / path.relative_to(folder), path))
            assert before[:90] == after[:90] and before[512:] == after[512:]
        else:
            refused(run(folder))
        shutil.rmtree(folder)


def seal(path: Path) -> None:
    """As if the content were meant."""
    data = path.read_bytes()
    line = f"latin-problem sha256 {hashlib.sha256(data[512:]).hexdigest()}\n".encode()
    path.write_bytes(line + data[len(line) :])


def places(file: Any) -> list[tuple[str, str | None]]:
    """Groups and datasets without those of the frontend, and attributes."""
    found: list[tuple[str, str | None]] = []

    def visit(name: str, node: Any) -> None:
        if not name.startswith("face"):
            found.append((name, None))
            found.extend((name, key) for key in node.attrs)

    file.visititems(visit)
    return found


def mutate(file: Any, dice: random.Random) -> str:
    """Change one thing of a file; what it was."""
    name, key = dice.choice(places(file))
    node = file[name]
    kind = dice.randrange(4)
    if key is not None:
        value = dice.choice((-1, 2**40, 7, "word", 1.5e300, float("nan"), "", -1e-3))
        if kind == 0:
            del node.attrs[key]
        else:
            node.attrs[key] = value
        return f"{name}@{key} {kind} {value}"
    if isinstance(node, h5py.Group) or kind == 0:
        del file[name]
        return f"{name} deleted"
    values = np.array(node[()])
    del file[name]
    if kind == 1 or values.dtype.kind == "O":
        file[name] = values[: len(values) // 2]
        return f"{name} halved"
    if kind == 2:
        file[name] = values[None]
        return f"{name} with another axis"
    flat = values.reshape(-1)
    if flat.size:
        flat[dice.randrange(flat.size)] = dice.choice((-1, 2**31, 7)) if flat.dtype.kind == "i" else (
            dice.choice((np.nan, np.inf, -1e300, 1e300, 0.0))
        )
    file[name] = values
    return f"{name} with a wrong number"


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind",
    [
        "sweep",
        pytest.param("solution", marks=pytest.mark.night(guard="those of a sweep")),
        pytest.param("chaos", marks=pytest.mark.night(guard="those of a sweep")),
    ],
)
def test_contradictory_folders(elastic: lt.Problem, tmp_path: Path, kind: str) -> None:
    """Files that are whole but say what cannot be: an error or an answer, no crash."""
    whole = tmp_path / "whole"
    if kind == "chaos":
        stiffness = lt.LogNormal(mean=1.0, cov=0.2, name="stiffness")
        random_scene(lt.Elastic(normal=stiffness, tangential=0.5)).export(whole, chaos=2)
    else:
        grid = {"joint/0.normal": [1.0, 2.0]} if kind == "sweep" else None
        elastic.export(whole, "accelerated", grid=grid)
    dice = random.Random(7)
    for _ in range(FUZZED):
        folder = tmp_path / "changed"
        shutil.copytree(whole, folder)
        with h5py.File(folder / "problem.h5", "r+") as file:
            what = mutate(file, dice)
        seal(folder / "problem.h5")
        done = run(folder)
        assert done.returncode in (0, 2, 3, 4, 5), (what, done.returncode, done.stderr[-2000:])
        if done.stderr or done.returncode == 2:
            assert "latin_run: " in done.stderr and done.stderr.count("\n") == 1, (what, done.stderr)
        shutil.rmtree(folder)


# --- the vessel, on one rank and on two --------------------------------------------------------------


@pytest.fixture(scope="module")
def vessel() -> Any:
    return demo("bolted_vessel")


RANKS = [1, pytest.param(2, marks=pytest.mark.mpi)]
NIGHTLY_RANKS = [1, pytest.param(2, marks=[pytest.mark.mpi, pytest.mark.night(guard="test_vessel[2]")])]
TIGHT = lt.Options(rtol=1e-11)
TOLERANCE = 1e-9
"""Between ranks: what runs of 1e-11, whose steps differ, leave of forces that are a tenth of the largest."""


@pytest.mark.slow
@pytest.mark.parametrize("ranks", RANKS)
def test_vessel(vessel: Any, tmp_path: Path, ranks: int) -> None:
    problem = lt.assemble(vessel.build_scene("coarse")[1])
    problem.export(tmp_path, "accelerated", options=TIGHT)
    reference = lt.solve(problem, "accelerated", options=TIGHT)
    same(reference, solved(tmp_path, ranks=ranks), TOLERANCE if ranks > 1 else 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("ranks", NIGHTLY_RANKS)
def test_sweep_of_the_vessel(vessel: Any, tmp_path: Path, ranks: int) -> None:
    problem = lt.assemble(vessel.build_scene("coarse")[1])
    grid = vessel.stiffnesses(vessel.XI_SCREW, vessel.XI_JOINT)
    problem.export(tmp_path, grid=grid, options=TIGHT)
    reference = lt.sweep(problem, grid, options=TIGHT, progress=False, keep_states=True)
    found = solved(tmp_path, "--displacements", ranks=ranks)
    assert reference.shape == found.shape == (13, 7)
    same(reference, found, TOLERANCE if ranks > 1 else 0.0, parts=False)
    last = reference.point(12, 6)
    for part in problem.substructures:
        here, there = last.unknowns(part), found.unknowns(part)
        assert np.abs(here - there).max() <= TOLERANCE * np.abs(here).max()


@pytest.mark.slow
@pytest.mark.parametrize("ranks", NIGHTLY_RANKS)
def test_chaos_of_the_vessel(vessel: Any, tmp_path: Path, ranks: int) -> None:
    problem = lt.assemble(vessel.random_scene(vessel.build_scene("coarse")[0]))
    problem.export(tmp_path, chaos=3, options=TIGHT)
    reference, found = lt.solve(problem, chaos=3, options=TIGHT), solved(tmp_path, ranks=ranks)
    same(reference, found, TOLERANCE if ranks > 1 else 0.0)
    for part in problem.substructures:
        here, there = reference.deviation(part), found.deviation(part)
        assert np.abs(here - there).max() <= TOLERANCE * np.abs(here).max()
