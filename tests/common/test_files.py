"""Files are replaced whole, keep their permissions and links, and errors name them."""

from __future__ import annotations

import os
import resource
import shutil
import signal
import socket
import stat
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dolfinx_frontend import (
    Elastic,
    LinearElastic,
    ResultFileError,
    Scene,
    SceneError,
    assemble,
    export,
    figures,
    geometry,
    io,
    load,
    report,
    solve,
)
from dolfinx_frontend.assembly.elements import csr
from dolfinx_frontend.common.files import FileError, Files, replaced, write_text
from dolfinx_frontend.formats.chaos_file import Field, save_chaos
from dolfinx_frontend.uncertainty.chaos import Chaos
from dolfinx_frontend.uncertainty.parameters import Uniform
from dolfinx_frontend.uncertainty.space import RandomSpace


@pytest.fixture(scope="module")
def result() -> Any:
    scene = Scene()
    for name, x0 in (("left", 0.0), ("right", 1.0)):
        part = geometry.box((1.0, 1.0), (2, 2), origin=(x0, 0.0))
        scene.substructure(name, part, LinearElastic(E=100.0, nu=0.3), degree=1)
    scene.interface("layer", "left:x1", "right:x0", Elastic(normal=30.0, tangential=10.0))
    scene.fix("left:x0")
    scene.traction("right:x1", (1.0, 0.2))
    return solve(assemble(scene))


@contextmanager
def full_disk(size: int) -> Iterator[None]:
    """No file may become larger than so many bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


WRITERS = {
    "result.h5": lambda result, path: result.save(path),
    "parts.vtm": io.write_fields,
    "table.csv": lambda result, path: result.table().to_csv(path),
    "figure.png": lambda result, path: figures.interface_figure(result, "layer", path),
    "sheet.html": lambda result, path: report(result, path, pictures=False, errors=False, units=("mm", "N")),
    "sheet": lambda result, path: report(result, path, pictures=False, errors=False, units=("mm", "N")),
    "chaos.json": lambda result, path: save_chaos(path, SPACE, SPACE.basis(Chaos(order=1)), FIELDS),
}
MAKE_FOLDERS = ("figure.png", "sheet.html", "sheet")
SPACE = RandomSpace([Uniform("K", 1.0, 2.0)])
FIELDS = {"w": Field(np.arange(40.0).reshape(20, 2), "mm")}


@pytest.mark.parametrize("name", ["result.h5", "table.csv"])
def test_permissions_and_links_stay(name: str, result: Any, tmp_path: Path) -> None:
    real, link = tmp_path / "real" / name, tmp_path / name
    real.parent.mkdir()
    real.write_bytes(b"before")
    real.chmod(0o640)
    link.symlink_to(real)
    WRITERS[name](result, link)
    assert link.is_symlink() and real.read_bytes()[:6] != b"before"
    assert stat.S_IMODE(real.stat().st_mode) == 0o640
    assert sorted(os.listdir(real.parent)) == [name]


@pytest.mark.parametrize("name", WRITERS)
def test_a_full_disk_leaves_what_was_there(name: str, result: Any, tmp_path: Path) -> None:
    path = tmp_path / "first" / name
    path.parent.mkdir()
    WRITERS[name](result, path)  # what is compiled for it needs no room afterwards
    path.write_bytes(b"before")
    before = {each: each.read_bytes() for each in tmp_path.rglob("*") if each.is_file()}
    for target in (path, tmp_path / "second" / name if name in MAKE_FOLDERS else tmp_path / name):
        with full_disk(100), pytest.raises(FileError, match=f"{name}.* cannot be written.*has room"):
            WRITERS[name](result, target)
    assert {each: each.read_bytes() for each in tmp_path.rglob("*") if each.is_file()} == before
    assert os.listdir(tmp_path) == ["first"]


@pytest.mark.parametrize("name", WRITERS)
def test_where_nothing_can_be_written(name: str, result: Any, tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("no folder")
    with pytest.raises(FileError, match="file"):
        WRITERS[name](result, blocked / name)
    (tmp_path / name).mkdir()
    with pytest.raises(FileError, match=name):
        WRITERS[name](result, tmp_path / name)


def test_read_only_files_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "kept"
    path.write_text("before")
    monkeypatch.setattr(os, "access", lambda *_: False)  # for root, all is writable
    with pytest.raises(FileError, match="kept cannot be written.*write-protected"):
        write_text(path, "after")
    assert path.read_text() == "before"


def test_an_interrupted_write_changes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "kept"
    path.write_text("before")
    with pytest.raises(KeyboardInterrupt), replaced(path) as new:
        new.write_text("half")
        raise KeyboardInterrupt
    assert path.read_text() == "before" and os.listdir(tmp_path) == ["kept"]


@pytest.mark.parametrize("name", WRITERS)
def test_pipes_sockets_and_circles_are_refused(name: str, result: Any, tmp_path: Path) -> None:
    """Nothing waits for a reader, and nothing takes their place."""
    pipe, door, circle = (tmp_path / part / name for part in ("pipe", "socket", "circle"))
    for each in (pipe, door, circle):
        each.parent.mkdir()
    os.mkfifo(pipe)
    with socket.socket(socket.AF_UNIX) as open_door:
        open_door.bind(str(door))
    circle.symlink_to(circle.with_name("other"))
    circle.with_name("other").symlink_to(circle)
    for each, why in ((pipe, "pipe"), (door, "socket"), (circle, "leads back to itself")):
        before = os.lstat(each)
        with pytest.raises(FileError, match=f"{name} cannot be written.*{why}"):
            WRITERS[name](result, each)
        assert os.lstat(each).st_ino == before.st_ino
    for reader in (load, io.load_chaos) if name == "chaos.json" else (load,):
        for each in (pipe, door, circle):
            with pytest.raises(FileError, match="does not exist|it is a folder, a pipe|Too many levels"):
                reader(each)
    for device in ("null", "full"):
        (tmp_path / name).symlink_to(f"/dev/{device}")
        with pytest.raises(FileError, match=f"{name} cannot be written.*device"):
            WRITERS[name](result, tmp_path / name)
        (tmp_path / name).unlink()
    assert [each for each in tmp_path.rglob("*") if each.is_file()] == []


@pytest.mark.parametrize("device", ["/dev/null", "/dev/full"])
def test_no_name_is_derived_from_a_device(device: str, result: Any) -> None:
    with pytest.raises(FileError, match=f"{device} cannot be written.*device"):
        WRITERS["sheet"](result, device)
    with pytest.raises(FileError, match=f"{device} cannot be written.*device"):
        write_text(Path(device), "nowhere")
    with pytest.raises(FileError, match=f"{device}/matrices cannot be made"):
        export(result.problem, device)
    assert not Path(f"{device}.html").exists() and not Path(f"{device}.csv").exists()


def test_several_files_or_none(result: Any, tmp_path: Path) -> None:
    """The second of two cannot be written: the first is as it was."""
    (tmp_path / "sheet.html").write_text("before")
    (tmp_path / "sheet.csv").mkdir()
    with pytest.raises(FileError, match=r"sheet.csv cannot be written.*folder"):
        WRITERS["sheet"](result, tmp_path / "sheet")
    with pytest.raises(KeyboardInterrupt), Files() as files:
        files.write(files.folder(tmp_path / "a" / "b") / "c", "half")
        raise KeyboardInterrupt
    assert (tmp_path / "sheet.html").read_text() == "before"
    assert sorted(os.listdir(tmp_path)) == ["sheet.csv", "sheet.html"]


@pytest.mark.parametrize("name", ["no.h5", "x" * 300 + ".h5"])
def test_names_that_cannot_be_read(name: str, tmp_path: Path) -> None:
    with pytest.raises(ResultFileError, match="does not exist|File name too long"):
        load(tmp_path / name)
    with pytest.raises(io.ChaosFileError, match="does not exist|File name too long"):
        io.load_chaos(tmp_path / name)


def test_names_that_are_none(tmp_path: Path) -> None:
    for read in (load, io.load_chaos):
        with pytest.raises(SceneError, match="give the name of a file"):
            read(tmp_path / "nul\0.h5")


def test_a_file_that_cannot_be_opened(result: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "result.h5"
    result.save(path)

    def refuse(*_: Any, **__: Any) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "open", refuse)
    with pytest.raises(ResultFileError, match="result.h5 cannot be read.*Permission denied"):
        load(path)


def test_a_failed_export_leaves_the_problem_as_it_was(tmp_path: Path) -> None:
    """PETSc's own viewer swaps the bytes of a matrix while it writes, and leaves them so on a full disk."""
    scene = Scene()
    for name, x0 in (("a", 0.0), ("b", 1.0)):
        part = geometry.box((1.0, 1.0), (12, 12), origin=(x0, 0.0))
        scene.substructure(name, part, LinearElastic(E=100.0, nu=0.3), degree=1)
    scene.fix("a:x0")
    scene.traction("b:x1", (-1.0, 0.1))
    scene.interface("layer", "a:x1", "b:x0", Elastic(normal=30.0, tangential=10.0))
    problem = assemble(scene)
    before = {name: csr(part.stiffness) for name, part in problem.substructures.items()}
    for size in (10, 4096, 20_000, 60_000):
        with full_disk(size), pytest.raises(FileError, match="cannot be written.*choose a folder that"):
            export(problem, tmp_path / "out")
        for name, part in problem.substructures.items():
            assert (csr(part.stiffness) != before[name]).nnz == 0
        assert not (tmp_path / "out" / "problem.h5").exists()
        assert not [each for each in tmp_path.rglob("*") if each.name.startswith(".")]
    fresh = solve(assemble(scene)).displacements["b"]
    assert np.array_equal(solve(problem).displacements["b"], fresh)
    with pytest.raises(FileError, match="cannot be made"):
        (tmp_path / "file").write_text("no folder")
        export(problem, tmp_path / "file" / "out")


def test_temporary_files_are_made_exclusively(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A link that somebody has put under the temporary name is not written through."""
    monkeypatch.setattr(uuid, "uuid4", lambda: SimpleNamespace(hex="known"))
    precious = tmp_path / "precious"
    precious.write_text("precious")
    (tmp_path / ".known.txt").symlink_to(precious)
    with pytest.raises(FileError, match="a.txt cannot be written"):
        write_text(tmp_path / "a.txt", "text")
    assert precious.read_text() == "precious" and not (tmp_path / "a.txt").exists()


def test_a_folder_that_vanishes(tmp_path: Path) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    with pytest.raises(FileError, match="kept cannot be written"), replaced(folder / "kept") as new:
        new.write_text("half")
        shutil.rmtree(folder)
    assert os.listdir(tmp_path) == []


def test_a_reader_that_goes_away() -> None:
    """PETSc's handler of signals would end this process."""
    reader, writer = os.pipe()
    os.close(reader)
    try:
        with pytest.raises(BrokenPipeError):
            os.write(writer, b"x")
    finally:
        os.close(writer)
