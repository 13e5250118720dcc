"""Checkpoints: never those of another problem, and never the end of a run that cannot write them."""

from __future__ import annotations

import logging
import os
import resource
import signal
import socket
import sqlite3
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dolfinx_frontend as lf
from dolfinx_frontend import geometry
from latin_core import CheckpointError, CheckpointWarning, Options
from latin_core.checkpoint import Checkpoint

GRID = {"layer.normal": [10.0, 20.0, 30.0]}
FRICTION = {"layer.friction": [0.1, 0.3]}


def plates(
    law: Any = None,
    pull: tuple[str, Any] = ("right:x1", (1.0, 0.2)),
    held: str = "left:x0",
    material: Any = None,
    n: int = 2,
    cell: str = "quadrilateral",
    shift: float = 0.0,
    **more: Any,
) -> lf.Problem:
    scene = lf.Scene()
    for name, x0 in (("left", 0.0), ("right", 1.0)):
        part = geometry.box((1.0, 1.0), (n, n), origin=(x0 + shift, shift), cell=cell)
        scene.substructure(name, part, material or lf.LinearElastic(E=100.0, nu=0.3), degree=1, **more)
    scene.interface("layer", "left:x1", "right:x0", law or lf.Elastic(normal=30.0, tangential=10.0))
    scene.fix(held, name="wall")
    scene.traction(pull[0], pull[1], name="pull")
    return lf.assemble(scene)


def swept(problem: lf.Problem, path: Path | None, grid: Any = None, **how: Any) -> lf.SweepResult:
    return lf.sweep(problem, GRID if grid is None else grid, checkpoint=path, progress=False, **how)


def orthotropic(E: tuple[float, ...]) -> Any:
    return lf.OrthotropicElastic(E=E, nu=(0.0, 0.0, 0.0), G=5.0)


# --- another problem -----------------------------------------------------------------------------
def hardening(h: float) -> lf.UserLaw:
    def rubber(jump: Any, *, normal: Any) -> Any:
        return normal[:, None] * jump * (1.0 + h * np.abs(jump))

    return lf.UserLaw(force=rubber, values={"normal": 20.0})


def resolved(limit: float) -> lf.UserLaw:
    def slider(jump: Any, flexibility: Any, *, normal: Any) -> Any:
        return np.clip(normal[:, None] * jump / (1.0 + normal[:, None] * flexibility), -limit, limit)

    return lf.UserLaw(resolve=slider, values={"normal": 20.0})


FIELD = np.linspace(1.0, 2.0, 4)
OTHERS: dict[str, tuple[Callable[[], lf.Problem], Callable[[], lf.Problem], str]] = {
    "load on another face": (
        lambda: plates(pull=("right:x1", (1.0, 0.0))),
        lambda: plates(pull=("right:y1", (0.0, 1.0))),
        "sides of 'pull'; points of 'pull'",
    ),
    "load on the opposite face": (
        lambda: plates(pull=("right:y1", (0.3, -1.0))),
        lambda: plates(pull=("right:y0", (-0.3, 1.0))),
        "sides of 'pull'",
    ),
    "another load": (plates, lambda: plates(pull=("right:x1", (1.0, 0.3))), "in: .* of 'pull'"),
    "body force": (plates, lambda: plates(body_force=(0.0, -1.0)), "body force of part 'left'"),
    "support on another face": (plates, lambda: plates(held="left:y0"), "sides of 'wall'"),
    "law of a user": (
        lambda: plates(hardening(0.0)),
        lambda: plates(hardening(50.0)),
        "in: code of the law of 'layer':",
    ),
    "resolvent of a user": (
        lambda: plates(resolved(0.1)),
        lambda: plates(resolved(0.2)),
        "in: code of the law of 'layer':",
    ),
    "stiffness": (
        lambda: plates(lf.Elastic(normal=30.0, tangential=FIELD)),
        lambda: plates(lf.Elastic(normal=30.0, tangential=FIELD[::-1].copy())),
        "in: tangential of 'layer':",
    ),
    "material": (
        plates,
        lambda: plates(material=lf.LinearElastic(E=100.0, nu=0.31)),
        "stiffness of part 'left'",
    ),
    "axes of a material": (
        lambda: plates(material=orthotropic((100.0, 10.0, 10.0))),
        lambda: plates(material=orthotropic((10.0, 100.0, 10.0))),
        "in: stiffness of part 'left'; stiffness of part 'right':",
    ),
    "mesh": (plates, lambda: plates(n=3), "mesh of part 'left'"),
    "cells": (plates, lambda: plates(cell="triangle"), "mesh of part 'left'"),
    "place": (plates, lambda: plates(shift=1.0), "mesh of part 'left'"),
}


@pytest.mark.parametrize("name", OTHERS)
def test_another_problem_is_told(name: str, tmp_path: Path) -> None:
    one, other, told = OTHERS[name]
    path = tmp_path / "points"
    swept(one(), path)
    before = path.read_bytes()
    with pytest.raises(CheckpointError, match=f"points belongs to another run or version, .*{told}"):
        swept(other(), path)
    assert path.read_bytes() == before
    assert swept(one(), path).points.order == []  # made anew, it is the same


def test_options_are_told_with_their_values(tmp_path: Path) -> None:
    path, problem = tmp_path / "points", plates()
    swept(problem, path, options=Options(rtol=1e-8))
    told = r"in: option rtol \(in the file 1e-08, in this run 1e-06\): give another file"
    with pytest.raises(CheckpointError, match=told):
        swept(problem, path, options=Options(rtol=1e-6))
    with pytest.raises(CheckpointError, match=r"option max_iterations \(in the file 500, in this run 9\)"):
        swept(problem, path, options=Options(rtol=1e-8, max_iterations=9))
    again = swept(problem, path, options=Options(rtol=1e-8, together=1, snapshots=3))  # only the way there
    assert again.points.order == []


def test_another_output_of_the_same_name(tmp_path: Path) -> None:
    path, problem = tmp_path / "points", plates()

    def output(component: int) -> dict[str, Any]:
        return {"outputs": {"q": lambda block: block.force("layer")[..., component].max(axis=1)}}

    first = swept(problem, path, **output(0))
    assert np.array_equal(swept(problem, path, **output(0)).output("q"), first.output("q"))
    with pytest.raises(CheckpointError, match="in: code of output 'q':"):
        swept(problem, path, **output(1))
    with pytest.raises(CheckpointError, match="in: outputs; code of output 'r'"):
        swept(problem, path, outputs={"q": output(0)["outputs"]["q"], "r": output(1)["outputs"]["q"]})


def resultant_of(block: Any, weights: Any) -> Any:
    return block.force("layer")[..., 0] @ weights


def test_outputs_may_know_the_problem(tmp_path: Path) -> None:
    """A function that uses the areas of an interface has the problem in it."""

    def resultant(problem: lf.Problem) -> dict[str, Any]:
        def total(block: Any) -> Any:
            return resultant_of(block, problem.interfaces["layer"].weights)

        return {"outputs": {"total": total}}

    def mean(interface: Any, part: Any) -> dict[str, Any]:
        return {"outputs": {"mean": lambda block: resultant_of(block, interface.weights) / part.volume}}

    path, problem = tmp_path / "points", plates()
    one, other = problem.interfaces["layer"], problem.interfaces["pull"]
    swept(problem, tmp_path / "mean", **mean(one, problem.substructures["left"]))
    again = plates()
    known = mean(again.interfaces["layer"], again.substructures["left"])
    assert swept(problem, tmp_path / "mean", **known).points.order == []
    for changed in (mean(other, problem.substructures["left"]), mean(one, problem.substructures["right"])):
        with pytest.raises(CheckpointError, match="in: code of output 'mean':"):
            swept(problem, tmp_path / "mean", **changed)
    swept(problem, path, **resultant(problem))
    assert swept(problem, path, **resultant(plates())).points.order == []
    with pytest.raises(CheckpointError, match="code of output 'total'"):
        swept(problem, path, **resultant(plates(n=3)))


def test_outputs_that_cannot_be_told_apart(tmp_path: Path) -> None:
    lock = threading.Lock()

    def locked(block: Any) -> Any:
        with lock:
            return block.force("layer").max(axis=(1, 2))

    with pytest.raises(lf.SceneError, match=r"output 'q', its variable 'lock': a lock cannot be told apart"):
        swept(plates(), tmp_path / "points", outputs={"q": locked})
    assert not (tmp_path / "points").exists()
    assert swept(plates(), None, outputs={"q": locked}).output("q").shape == (3,)


def test_another_sampling(tmp_path: Path) -> None:
    path = tmp_path / "points"

    def drawn(cov: float = 0.3, count: int = 4, seed: int = 0) -> lf.SampleResult:
        law = lf.Elastic(normal=lf.LogNormal("k", 30.0, cov=cov), tangential=10.0)
        return lf.monte_carlo(plates(law), count, seed=seed, checkpoint=path, progress=False)

    first = drawn()
    assert np.array_equal(drawn().force("layer"), first.force("layer"))
    for change in ({"cov": 0.2}, {"count": 5}, {"seed": 1}):
        with pytest.raises(CheckpointError, match="in: values of layer.normal"):
            drawn(**change)  # type: ignore[arg-type]
    with pytest.raises(CheckpointError, match=r"in: run \(in the file sampling, in this run sweep\)"):
        swept(plates(), path)


def test_another_field_inside_a_part(tmp_path: Path) -> None:
    """Another correlation, another spread, a factor in place of a field: other samples."""
    path = tmp_path / "points"

    def drawn(inside: bool = True, cov: float = 0.2, length: float = 1.0) -> lf.SampleResult:
        field = lf.RandomField("E", 100.0, cov=cov, length=length, modes=2, distribution="lognormal")
        scene = lf.Scene()
        modulus = field if inside else lf.LogNormal("E", 100.0, cov=cov)
        part = geometry.box((1.0, 1.0), (2, 2), cell="quadrilateral")
        scene.substructure("left", part, lf.LinearElastic(modulus, 0.3), degree=1)
        scene.fix("left:x0", name="wall")
        scene.force("left:x1", (1.0, 0.2), name="pull")
        return lf.monte_carlo(lf.assemble(scene), 3, seed=0, checkpoint=path, progress=False)

    first = drawn()
    assert first.plan.fields == ("left",) and drawn().points.order == []
    for change in ({"cov": 0.3}, {"length": 2.0}):
        with pytest.raises(CheckpointError, match="in: values of left.part.stiffness"):
            drawn(**change)  # type: ignore[arg-type]
    with pytest.raises(CheckpointError, match="in: .*parts whose stiffness varies"):
        drawn(inside=False)


# --- the file while the run goes on --------------------------------------------------------------
@pytest.fixture
def at_write(monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[int, Callable[[], Any]]]:
    """Things to do before the points of those numbers are written, counted from 0."""
    todo: dict[int, Callable[[], Any]] = {}
    before, count = Checkpoint.append, [0]

    def append(self: Checkpoint, *what: Any) -> None:
        count[0] += 1
        todo.get(count[0] - 1, lambda: None)()
        before(self, *what)

    monkeypatch.setattr(Checkpoint, "append", append)
    monkeypatch.setattr("latin_core.checkpoint._PATIENCE", 0.05)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield todo
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


MANY = {"layer.normal": [float(k) for k in range(1, 13)]}


def disturbed(path: Path, told: str) -> None:
    """A run whose file fails says so once, and has all of its results."""
    problem = plates()
    truth = swept(problem, None, MANY)
    with pytest.warns(CheckpointWarning, match=told) as seen:
        found = swept(problem, path, MANY)
    assert len([each for each in seen if each.category is CheckpointWarning]) == 1
    assert found.complete and np.array_equal(found.force("layer"), truth.force("layer"))


def left(path: Path) -> int:
    """Points in the file that a new run does not solve again."""
    found = swept(plates(), path, MANY)
    assert found.complete
    return 12 - len(found.points.order)


def test_a_locked_file(tmp_path: Path, at_write: dict[int, Callable[[], Any]]) -> None:
    path, held = tmp_path / "points", []

    def lock() -> None:
        held.append(sqlite3.connect(path))
        held[0].execute("begin immediate")

    at_write[4] = lock
    disturbed(path, "points cannot be written .another program has locked it.: the run goes on")
    held[0].close()
    assert left(path) == 4


def test_a_file_that_was_locked_for_a_time(
    tmp_path: Path, at_write: dict[int, Callable[[], Any]]
) -> None:
    path, held = tmp_path / "points", []

    def lock() -> None:
        held.append(sqlite3.connect(path))
        held[0].execute("begin immediate")

    at_write |= {4: lock, 8: lambda: held[0].close()}
    disturbed(path, "locked")
    assert left(path) == 12


@pytest.mark.parametrize("again", [False, True])
def test_a_full_disk(again: bool, tmp_path: Path, at_write: dict[int, Callable[[], Any]]) -> None:
    path = tmp_path / "points"

    def limit(size: int) -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))

    at_write[4] = lambda: limit(path.stat().st_size)
    if again:
        at_write[8] = lambda: limit(resource.RLIM_INFINITY)
    disturbed(path, "cannot be written .*the run goes on, its points are kept")
    limit(resource.RLIM_INFINITY)
    assert left(path) == 12 if again else 3 <= left(path) <= 5


def test_a_removed_file_is_made_again(
    tmp_path: Path, at_write: dict[int, Callable[[], Any]], caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "points"
    at_write[4] = path.unlink
    with caplog.at_level(logging.WARNING):
        assert swept(plates(), path, MANY).complete
    assert "points was removed while the run goes on: it is there again, whole" in caplog.text
    assert left(path) == 12 and os.listdir(tmp_path) == ["points"]


def test_a_removed_folder(tmp_path: Path, at_write: dict[int, Callable[[], Any]]) -> None:
    path = tmp_path / "folder" / "points"
    path.parent.mkdir()
    at_write[4] = lambda: path.parent.rename(tmp_path / "elsewhere")
    disturbed(path, "cannot be written")
    assert not path.parent.exists() and left(tmp_path / "elsewhere" / "points") == 4


def test_another_file_in_its_place_is_left_alone(
    tmp_path: Path, at_write: dict[int, Callable[[], Any]]
) -> None:
    path = tmp_path / "points"

    def replace() -> None:
        path.unlink()
        path.write_text("mine")

    at_write[4] = replace
    disturbed(path, "another file has taken its place")
    assert path.read_text() == "mine"


def test_links_to_a_file(tmp_path: Path) -> None:
    path, link = tmp_path / "points", tmp_path / "link"
    path.touch(mode=0o640)
    link.symlink_to(path)
    swept(plates(), link)
    assert link.is_symlink() and path.stat().st_mode & 0o777 == 0o640
    assert swept(plates(), path).points.order == []


def test_a_file_that_can_only_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run that is finished is read from it; one that is not says so and ends with its results."""
    path, before = tmp_path / "points", os.open
    swept(plates(), path)

    def refused(name: Any, flags: int, *mode: int) -> int:
        if flags & os.O_RDWR:
            raise PermissionError(13, "Permission denied")
        return before(name, flags, *mode)

    monkeypatch.setattr(os, "open", refused)
    assert swept(plates(), path).points.order == []
    with pytest.raises(CheckpointError, match="new cannot be written .*Permission denied"):
        swept(plates(), tmp_path / "new")
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("name", [":memory:", "./:memory:"])
def test_memory_is_no_file(name: str) -> None:
    with pytest.raises(CheckpointError, match="would be gone with the run: give the name of a file"):
        swept(plates(), Path(name))


@pytest.mark.parametrize("name", ["file::memory:?cache=shared", "file:points?mode=memory"])
def test_an_address_is_no_file(name: str) -> None:
    with pytest.raises(CheckpointError, match="file:.* is an address: give the name of a file"):
        swept(plates(), name)  # type: ignore[arg-type]


def test_pipes_sockets_and_circles_are_no_files(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with socket.socket(socket.AF_UNIX) as door:
        door.bind(str(tmp_path / "socket"))
    for each in ("pipe", "socket"):
        with pytest.raises(CheckpointError, match=f"{each} is a folder, a pipe, .*: give the name of a file"):
            swept(plates(), tmp_path / each)
    (tmp_path / "circle").symlink_to(tmp_path / "back")
    (tmp_path / "back").symlink_to(tmp_path / "circle")
    with pytest.raises(CheckpointError, match="circle is a link that leads back to itself: give"):
        swept(plates(), tmp_path / "circle")


@pytest.mark.parametrize(
    "table",
    ["moz_places (url text)", "header (title text)", "point (number integer primary key, arrays blob)"],
)
def test_the_database_of_another_program(table: str, tmp_path: Path) -> None:
    path = tmp_path / "places.sqlite"
    with closing(sqlite3.connect(path)) as db, db:
        db.execute(f"create table {table}")
    before = path.read_bytes()
    told = f"is a database of another program .its tables: '{table.split()[0]}'.: give another file name"
    with pytest.raises(CheckpointError, match=told):
        swept(plates(), path)
    assert path.read_bytes() == before


# --- two runs on one file ------------------------------------------------------------------------
def test_two_runs_of_one_program(tmp_path: Path) -> None:
    path = tmp_path / "points"
    told = "another run in this program: wait"
    with closing(Checkpoint(path, {})), pytest.raises(CheckpointError, match=told):
        Checkpoint(path, {})
    Checkpoint(path, {}).close()


HOLDER = """
import sys
from latin_core.checkpoint import Checkpoint
file = Checkpoint(sys.argv[1], {})
file.append(0, {"x": 1.0})
print("there", flush=True)
sys.stdin.read()
"""


@pytest.mark.skipif(sys.platform != "linux", reason="locks of open files")
def test_two_programs(tmp_path: Path) -> None:
    """The second is told, whatever the first does; a first that was killed holds nothing."""
    path = tmp_path / "points"
    call = [sys.executable, "-c", HOLDER, str(path)]
    with subprocess.Popen(call, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as first:
        assert first.stdout is not None and first.stdout.readline() == b"there\n"
        with pytest.raises(CheckpointError, match="in use by another run of another program: wait"):
            Checkpoint(path, {})
        first.kill()
        first.wait()
    with closing(Checkpoint(path, {})) as file:
        assert [number for number, _ in file] == [0]
