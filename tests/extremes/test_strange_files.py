"""Every reader, given what is no file of its own: a sentence that names the file and the fix, or its content.

What is in a file is data. Nothing that it holds is executed, waited for, or believed before it is compared
with the size of the file.
"""

from __future__ import annotations

import gzip
import hashlib
import json
import os
import re
import shutil
import sqlite3
import subprocess
import zipfile
from collections.abc import Callable, Iterator
from contextlib import closing
from functools import cache
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
import pytest

import dolfinx_frontend as lf
from dolfinx_frontend.common import files
from dolfinx_frontend.formats import hdf5
from dolfinx_frontend.formats.chaos_file import Field, load_chaos, save_chaos
from dolfinx_frontend.geometry import gmsh_session, read_msh, read_step
from dolfinx_frontend.geometry.msh import checked_copy
from dolfinx_frontend.uncertainty.chaos import Chaos
from dolfinx_frontend.uncertainty.parameters import Uniform
from dolfinx_frontend.uncertainty.space import RandomSpace
from latin_core.checkpoint import Checkpoint, CheckpointError, _digest
from tests.geometry.fuzz import Forking

h5py = pytest.importorskip("h5py")
gmsh = pytest.importorskip("gmsh")

HEADER = {"run": "strange"}
REFUSED = (lf.SceneError, CheckpointError)
FIX = r"check|give|write|export|save|unpack|move|copy|mesh it|use |read it with"
MESH = """$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
1
2 1 "a"
$EndPhysicalNames
$Nodes
3
1 0 0 0
2 1 0 0
3 1 1 0
$EndNodes
$Elements
1
1 2 2 1 1 1 2 3
$EndElements
"""
SCRIPT = '\n\n// not a mesh\nSystemCall "touch executed";\nPrintf("x") > "executed";\n'


def write_step(path: Path) -> None:
    with gmsh_session("made"):
        gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        gmsh.model.occ.synchronize()
        gmsh.write(str(path))


def write_result(path: Path) -> None:
    scene = lf.Scene()
    scene.substructure("l", lf.geometry.box((1.0, 1.0), (1, 1)), lf.LinearElastic(100.0, 0.3))
    scene.fix("l:x0")
    scene.traction("l:x1", (-1.0, 0.0))
    lf.solve(lf.assemble(scene), progress=False).save(path)


def write_chaos(path: Path) -> None:
    space = RandomSpace([Uniform("K", 1.0, 2.0)])
    basis = space.basis(Chaos(order=1))
    save_chaos(path, space, basis, {"w": Field(np.arange(4.0).reshape(2, 2), "mm")})


def write_checkpoint(path: Path) -> None:
    with closing(Checkpoint(path, HEADER)) as file:
        file.append(0, {"force": np.arange(3.0), "status": "converged"})


def read_checkpoint(path: Any) -> list[Any]:
    with closing(Checkpoint(path, HEADER)) as file:
        return [(number, arrays["force"].tolist()) for number, arrays in file]


@cache
def problem() -> lf.Problem:
    scene = lf.Scene()
    for name, x in (("l", 0.0), ("r", 1.0)):
        box = lf.geometry.box((1.0, 1.0), (1, 1), origin=(x, 0.0))
        scene.substructure(name, box, lf.LinearElastic(100.0, 0.3), degree=1)
    scene.fix("l:x0")
    scene.traction("r:x1", (-1.0, 0.0))
    scene.interface("j", "l:x1", "r:x0", lf.Elastic(normal=10.0, tangential=10.0))
    return lf.assemble(scene)


def write_folder(path: Path) -> Path:
    """What `latin_run` is given."""
    return problem().export(path)


def write_problem(path: Path) -> None:
    (write_folder(path.with_suffix(".folder")) / "problem.h5").rename(path)


def write_matrix(path: Path) -> None:
    (write_folder(path.with_suffix(".folder")) / "matrices" / "0000.petsc").rename(path)


def run(name: str, path: Path) -> lf.SavedResult:
    """What `latin_run` makes of a folder that has this file under that name."""
    with TemporaryDirectory() as place:
        folder = write_folder(Path(place, "folder"))
        given = folder / name
        if name != "problem.h5":
            with h5py.File(folder / "problem.h5", "r+") as file:
                sums = list(file["matrices/sha256"].asstr()[()])
                small = path.is_file() and 0 < path.stat().st_size < 2**20
                sums[0] = hashlib.sha256(path.read_bytes()).hexdigest() if small else "none"
                file["matrices/sha256"][...] = sums
            hdf5.seal(folder / "problem.h5", "latin-problem")
        given.unlink()
        if os.path.lexists(path) and not path.is_symlink() and not path.is_dir():
            os.link(path, given)
        else:
            given.symlink_to(path.absolute())
        command = [str(PROGRAM), str(folder)]
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
        if done.returncode:
            assert done.returncode in (2, 4) and done.stderr.count("\n") == 1, done.stdout + done.stderr
            said = done.stderr.strip().replace(str(given), str(path))
            raise lf.SceneError(f"{said}; check it, or export the problem again")
        return lf.load(folder / "result.h5")


def unknowns(found: lf.SavedResult) -> Any:
    return found.unknowns("r").tolist()


class Reader(NamedTuple):
    suffix: str
    write: Callable[[Path], Any]
    read: Callable[[Any], Any]
    shown: Callable[[Any], Any]


READERS = {
    "mesh": Reader(".msh", lambda p: p.write_text(MESH), read_msh, lambda found: list(found.parts)),
    "STEP": Reader(".step", write_step, read_step, lambda found: list(found.solids)),
    "result": Reader(".h5", write_result, lf.load, lambda found: str(found.table())),
    "chaos": Reader(".h5", write_chaos, load_chaos, lambda f: f.fields["w"].coefficients.tolist()),
    "chaos as text": Reader(".json", write_chaos, load_chaos, lambda f: f.fields["w"].coefficients.tolist()),
    "checkpoint": Reader("", write_checkpoint, read_checkpoint, lambda found: found),
}
PROGRAM = shutil.which("latin_run")
if PROGRAM is not None:  # built with HDF5
    READERS |= {
        "problem": Reader(".h5", write_problem, lambda p: run("problem.h5", Path(p)), unknowns),
        "matrix": Reader(".petsc", write_matrix, lambda p: run("matrices/0000.petsc", Path(p)), unknowns),
    }


def edited(path: Path, edit: Callable[[Any], None], form: str) -> None:
    """An HDF5 file that was changed, and sealed as if that were meant."""
    with h5py.File(path, "r+") as file:
        edit(file)
    hdf5.seal(path, form)


def claims(kind: str, path: Path) -> None:
    """Make a file claim a million millions of something."""
    many = 10**12
    if kind == "mesh":
        path.write_text(MESH.replace("$Nodes\n3", f"$Nodes\n{many}"))
    elif kind == "STEP":
        path.write_text(re.sub(r"#\d+ = (?=MANIFOLD)", f"#{many} = ", path.read_text()))
    elif kind == "chaos as text":
        path.write_text(re.sub(r'"shape": \[2\]', f'"shape": [{many}]', path.read_text()))
    elif kind == "matrix":  # as many as its numbers can count
        path.write_bytes(path.read_bytes()[:12] + (2**31 - 1).to_bytes(4) + path.read_bytes()[16:])
    elif kind == "checkpoint":
        with closing(sqlite3.connect(path)) as db, db:
            blob = db.execute("select arrays from point").fetchone()[0][32:]
            run = db.execute("select text from header").fetchone()[0]
            changed = repacked(blob, lambda data: data.replace(b"(3,), }" + b" " * 12, b"(%d,), }" % many))
            db.execute("update point set arrays = ?", (_digest(0, changed, run) + changed,))
    else:
        form = path.read_bytes().split(maxsplit=1)[0].decode()

        def claim(file: Any) -> None:
            name = "amplitudes" if kind == "problem" else "claimed"  # the program reads what it needs
            if name in file:
                del file[name]
            file.create_dataset(name, (many, 1), "f8")

        edited(path, claim, form)


def repacked(blob: bytes, change: Callable[[bytes], bytes], how: int = zipfile.ZIP_STORED) -> bytes:
    """An archive with its first entry changed."""
    out = BytesIO()
    with zipfile.ZipFile(BytesIO(blob)) as old, zipfile.ZipFile(out, "w", how) as new:
        for k, name in enumerate(old.namelist()):
            new.writestr(name, old.read(name) if k else change(old.read(name)))
    return out.getvalue()


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("good")
    out = {}
    for kind, reader in READERS.items():
        out[kind] = folder / f"{kind}{reader.suffix}"
        reader.write(out[kind])
    return out


@pytest.fixture
def forking() -> Iterator[None]:
    """Stands in for the process that every mesh and STEP file gets: its start takes most of the time."""
    with Forking():
        yield


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def refuse(kind: str, path: Any) -> None:
    with pytest.raises(REFUSED) as error:
        READERS[kind].read(path)
    said = str(error.value)
    assert Path(path).name in said and re.search(FIX, said), said
    assert len(said.splitlines()) == 1, said
    assert not Path("executed").exists()


@pytest.mark.usefixtures("forking")
@pytest.mark.parametrize("kind", READERS)
def test_the_wrong_kind_of_file(kind: str, good: dict[str, Path], folder: Path) -> None:
    path = folder / f"file{READERS[kind].suffix}"
    whole = good[kind].read_bytes()
    strange = {
        "script": SCRIPT.encode(),
        "picture": b"\x89PNG\r\n\x1a\n" + bytes(500),
        "packed": gzip.compress(whole),
        "half": whole[: len(whole) // 2],
        "with a word in front": b"x" * 5000 + whole,
        "deep": b"[" * 200_000,
        **{other: each.read_bytes() for other, each in good.items() if other.split()[0] != kind.split()[0]},
    }
    if kind != "checkpoint":  # SQLite takes an empty file for an empty database
        strange["empty"] = b""
    if kind == "matrix":  # it has a checksum, and is as long as it says
        strange = {key: each for key, each in strange.items() if len(each) < 2**20}
    for content in strange.values():
        path.write_bytes(content)
        refuse(kind, path)


@pytest.mark.parametrize("kind", READERS)
def test_a_million_millions(kind: str, good: dict[str, Path], folder: Path) -> None:
    path = folder / f"file{READERS[kind].suffix}"
    path.write_bytes(good[kind].read_bytes())
    before = path.read_bytes()
    claims(kind, path)
    assert path.read_bytes() != before
    refuse(kind, path)


@pytest.mark.parametrize("kind", READERS)
def test_what_is_no_file(kind: str, good: dict[str, Path], folder: Path) -> None:
    reader = READERS[kind]
    pipe, circle, directory = (folder / f"{name}{reader.suffix}" for name in ("pipe", "circle", "folder"))
    os.mkfifo(pipe)
    circle.symlink_to(circle)
    directory.mkdir()
    strange = ["/dev/zero", "/dev/full", "/proc/kmsg", "/proc/version", "/proc/self/mem", "/sys/kernel/notes"]
    for path in (pipe, circle, directory, *filter(os.path.exists, strange)):
        if str(path) in strange:
            link = folder / f"{Path(path).name}{reader.suffix}"
            link.symlink_to(path)
            path = link
        refuse(kind, path)
    if kind != "checkpoint":  # of which there may be none
        refuse(kind, folder / f"nothing{reader.suffix}")
    link = folder / f"link{reader.suffix}"
    link.symlink_to(good[kind])
    if kind == "matrix":  # of a problem, which has all of its own
        refuse(kind, link)
    else:
        assert reader.shown(reader.read(link)) == reader.shown(reader.read(good[kind]))


@pytest.mark.parametrize("kind", READERS)
def test_sparse_files(
    kind: str, good: dict[str, Path], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Eight gigabytes of nothing behind a good beginning, or from the first byte on."""
    monkeypatch.setattr(files, "available_memory", lambda: 16e9)
    reader = READERS[kind]
    path = folder / f"file{reader.suffix}"
    path.write_bytes(good[kind].read_bytes())
    os.truncate(path, 2**28 if kind in ("problem", "matrix") else 2**33)  # whose checksum is made of all
    if kind == "checkpoint":  # what is behind the last page is no part of it
        assert reader.shown(reader.read(path)) == reader.shown(reader.read(good[kind]))
    else:
        refuse(kind, path)
    path.write_bytes(b"")
    os.truncate(path, 2**28)
    refuse(kind, path)


def test_the_largest_file_is_what_memory_is_free_for(
    good: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    size = good["mesh"].stat().st_size
    monkeypatch.setattr(files, "available_memory", lambda: files.OBJECTS * size - 1.0)
    with pytest.raises(lf.SceneError, match="mesh.msh has .* GB, more than the .* can be read here.*memory"):
        read_msh(good["mesh"])
    monkeypatch.setattr(files, "available_memory", lambda: files.OBJECTS * size)
    assert list(read_msh(good["mesh"]).parts) == ["a"]


@pytest.mark.parametrize("kind", READERS)
def test_odd_names(kind: str, good: dict[str, Path], folder: Path) -> None:
    reader = READERS[kind]
    for name in ("-o 'my \"file\"';$(touch executed)`touch executed`\nn", "...", "\u202egnp.h5"):
        path = Path(f"{name}{reader.suffix}")  # relative: the name begins with a dash
        path.write_bytes(good[kind].read_bytes())
        assert reader.shown(reader.read(str(path))) == reader.shown(reader.read(good[kind]))
        if kind in ("problem", "matrix"):
            continue
        path.write_bytes(SCRIPT.encode())
        with pytest.raises(REFUSED) as error:  # what is said is one line, in the order of its characters
            reader.read(str(path))
        assert str(error.value).isprintable() and re.search(FIX, str(error.value))
    assert not Path("executed").exists()


# -- neighbours --------------------------------------------------------------------------------------


@pytest.mark.usefixtures("forking")
def test_what_stands_beside_a_file_is_not_executed(folder: Path) -> None:
    """gmsh executes NAME.opt beside whatever it is given, and a script behind blank lines or a comment."""
    Path("good.msh").write_text(MESH)
    for beside in ("good.msh.opt", "good.opt", "default.geo", ".gmshrc", ".gmsh-options", "gmsh.py"):
        Path(beside).write_text(SCRIPT)
    assert list(read_msh("good.msh").parts) == ["a"]
    for suffix in (".msh", ".geo", ".pos", ".opt", ".txt", ".inp", ".key", ".rad", ".su2", ".obj", ""):
        Path(f"script{suffix}").write_text(SCRIPT)
        refuse("mesh", f"script{suffix}")
    assert not Path("executed").exists()


def test_a_journal_that_names_another_file(folder: Path) -> None:
    """SQLite deletes the file that the end of a journal names, once it has played it back."""
    write_checkpoint(folder / "points")
    page = (folder / "points").read_bytes()[:4096]
    name, nonce = os.fsencode(folder / "precious"), 1
    (folder / "precious").write_text("precious")
    whole = bytes.fromhex("d9d505f920a163d7")
    numbers = [1, nonce, (folder / "points").stat().st_size // 4096, 512, 4096]
    head = (whole + b"".join(each.to_bytes(4) for each in numbers)).ljust(512, b"\0")
    check = (nonce + sum(page[k] for k in range(4096 - 200, 0, -200))) % 2**32
    end = (2**30 // 4096 + 1).to_bytes(4) + name + len(name).to_bytes(4) + sum(name).to_bytes(4) + whole
    journal = head + (1).to_bytes(4) + page + check.to_bytes(4) + end
    (folder / "link").symlink_to("points")
    for path in ("points", "link"):
        (folder / "points-journal").write_bytes(journal)
        refuse("checkpoint", folder / path)
    assert (folder / "precious").exists()
    # one of a run that was killed is played back
    (folder / "points-journal").write_bytes(journal[: -len(end)])
    assert read_checkpoint(folder / "points") == [(0, [0.0, 1.0, 2.0])]
    # SQLite itself does what is refused here
    (folder / "points-journal").write_bytes(journal)
    with closing(sqlite3.connect(folder / "points")) as db:
        db.execute("select * from sqlite_master").fetchall()
    assert not (folder / "precious").exists()


# -- small files that are large ----------------------------------------------------------------------


def test_links_and_texts_that_share_what_they_hold(good: dict[str, Path], folder: Path) -> None:
    def links(file: Any) -> None:
        a = file.create_group("zz")
        b = a.create_group("b0")
        b["c0"] = np.zeros(1)
        for k in range(1, 160):
            b[f"c{k}"] = b["c0"]
            a[f"b{k}"] = b

    def circle(file: Any) -> None:
        file["zz"] = file["interfaces"]

    def numbers(file: Any) -> None:
        file["zz"] = np.zeros(100_000)
        file["zy"] = file["zz"]

    def ragged(file: Any) -> None:
        file.create_dataset("zz", (2,), dtype=h5py.vlen_dtype(np.int64))

    def records(file: Any) -> None:
        file["zz"] = np.zeros(3, dtype=[("a", "f8")])

    def many(file: Any) -> None:
        file.attrs["zz"] = np.zeros(5)

    def kept_type(file: Any) -> None:
        file["zz"] = np.dtype("f8")

    for edit in (links, circle, numbers, ragged, records, many, kept_type):
        path = folder / "result.h5"
        path.write_bytes(good["result"].read_bytes())
        edited(path, edit, "latin-result")
        with pytest.raises(lf.SceneError, match="two links|no array|no single|neither numbers nor"):
            lf.load(path)


def test_texts_that_are_one_text(good: dict[str, Path], folder: Path) -> None:
    """Each of 20 000 points to the same megabyte: 20 GB."""
    path = folder / "result.h5"
    path.write_bytes(good["result"].read_bytes())
    with h5py.File(path, "r+") as file:
        file.create_dataset("zz", data=["x" * 1_000_000] + ["y"] * 20_000, dtype=h5py.string_dtype())
        at = file["zz"].id.get_offset()
    content = bytearray(path.read_bytes())
    one = bytes(content[at : at + 16])
    assert int.from_bytes(one[:4], "little") == 1_000_000  # length, then where it is
    content[at : at + 16 * 20_001] = one * 20_001
    path.write_bytes(content)
    hdf5.seal(path, "latin-result")
    with pytest.raises(lf.SceneError, match="with 'zz' it is larger than the file, of"):
        lf.load(path)
    # a length that is not that of the text: HDF5 would write behind what it has asked for
    content[at : at + 16 * 20_001] = ((5).to_bytes(4, "little") + one[4:]) * 20_001
    path.write_bytes(content)
    hdf5.seal(path, "latin-result")
    with pytest.raises(lf.SceneError, match="'zz' has texts of other lengths than it says"):
        lf.load(path)


def test_points_that_no_run_has_written(folder: Path) -> None:
    path = folder / "points"
    write_checkpoint(path)
    before = path.read_bytes()

    def pickled(data: bytes) -> bytes:
        out = BytesIO()
        np.lib.format.write_array(out, np.array([{}], dtype=object))
        return out.getvalue()

    def grown(data: bytes) -> bytes:
        return data + bytes(8)

    def called(data: bytes) -> bytes:
        return data.replace(b"(3,)", b"(__import__('os').getpid(),)")

    cases = [
        (zipfile.ZIP_DEFLATED, bytes, "its arrays are compressed"),
        (zipfile.ZIP_STORED, pickled, "is no array of numbers"),
        (zipfile.ZIP_STORED, called, "is no array of numbers"),
        (zipfile.ZIP_STORED, grown, "has not the numbers that it claims"),
    ]
    for how, change, said in cases:
        path.write_bytes(before)
        with closing(sqlite3.connect(path)) as db, db:
            run = db.execute("select text from header").fetchone()[0]
            blob = repacked(db.execute("select arrays from point").fetchone()[0][32:], change, how)
            db.execute("update point set arrays = ?", (_digest(0, blob, run) + blob,))
        with pytest.raises(CheckpointError, match=f"is damaged .*{said}.*: move it away"):
            read_checkpoint(path)


def test_a_point_of_another_problem(folder: Path) -> None:
    """It is whole, and its checksum is right where it comes from."""
    write_checkpoint(folder / "points")
    with closing(Checkpoint(folder / "other", {"run": "another"})) as file:
        file.append(0, {"force": np.full(3, 1e300), "status": "converged"})
    with closing(sqlite3.connect(folder / "other")) as db:
        (blob,) = db.execute("select arrays from point").fetchone()
    with closing(sqlite3.connect(folder / "points")) as db, db:
        db.execute("update point set arrays = ?", (blob,))
    with pytest.raises(CheckpointError, match="point 0: its checksum is another one"):
        read_checkpoint(folder / "points")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("3 1 1 0", "2 1 1 0", r"its section \$Nodes has node 2 twice"),
        ("1 2 3\n$End", "1 2 4\n$End", r"its element 1 has node 4, which is not in its section \$Nodes"),
        ("1\n1 2 2 1 1 1 2 3", "2\n1 2 2 1 1 1 2 3\n1 2 2 1 1 1 2 3", "has element 1 twice"),
        ("1\n1 2 2 1 1 1 2 3", "2\n1 2 2 1 1 1 2 3\n2 2 2 1 1 3 1 2", "1 cells have the nodes of others"),
        ("3 1 1 0", "3 1 1 1", "is not in a plane of constant z"),
    ],
)
def test_contradictions_in_a_mesh(old: str, new: str, said: str, folder: Path) -> None:
    """gmsh takes the last of two, or leaves out what it does not know; dolfinx crashes on two equal cells."""
    assert old in MESH
    Path("file.msh").write_text(MESH.replace(old, new))
    with pytest.raises(lf.SceneError, match=f"'file.msh': .*{said}.*; (write|mesh|turn)"):
        read_msh("file.msh")


@pytest.mark.usefixtures("forking")
@pytest.mark.parametrize("binary", [0, 1])
@pytest.mark.parametrize("version", [2.2, 4.1])
def test_numbers_that_come_twice_in_a_mesh_of_gmsh(version: float, binary: int, folder: Path) -> None:
    whole = written(Path("file.msh"), version, binary).encode("latin1")
    begin = whole.index(b"$Nodes\n") + len(b"$Nodes\n")
    if binary:  # behind a first node: its number and place, and of version 4 the heads of section and blocks
        at = begin + 32 + 52 + 20 if version == 4.1 else whole.index(b"\n", begin) + 1 + 28
    else:
        second = re.compile(rb"(?m)^2(?=\n| .* .* .*\n)").search(whole, begin)
        assert second is not None
        at = second.start()
    assert whole[at] in b"\2" + b"2"
    changed = bytearray(whole)
    changed[at] -= 1
    Path("file.msh").write_bytes(changed)
    with pytest.raises(lf.SceneError, match="its section .Nodes has node 1 twice"):
        read_msh("file.msh")


@pytest.mark.usefixtures("forking")
@pytest.mark.parametrize("number", ["NAN", "-nan", "+Inf", "INFINITY", "1.E999"])
def test_numbers_of_step_are_finite(number: str, good: dict[str, Path], folder: Path) -> None:
    """OpenCASCADE computes with some of them for ever."""
    text = good["STEP"].read_text()
    found = list(re.finditer(r"CARTESIAN_POINT\('',\((-?[\d.E+-]+)", text))[3]
    Path("file.step").write_text(text[: found.start(1)] + number + text[found.end(1) :])
    said = rf"'file.step'.*: {re.escape(number)} in line \d+ is no finite number; export"
    with pytest.raises(lf.SceneError, match=said):
        read_step("file.step", timeout=20)
    Path("file.step").write_text(text.replace("''", "'nan inf 1.E999'"))
    assert len(read_step("file.step").solids) == 1


ENDLESS = "with recursive c(n, a) as (values(1, x'00') union all select n + 1, a from c) select n, a from c"


@pytest.mark.parametrize(
    "strange",
    [
        f"alter table point rename to p; create view point(number, arrays) as {ENDLESS}",
        "create trigger t after insert on point begin delete from point; end",
        f"create trigger t before insert on header begin insert into point {ENDLESS}; end",
        "create index i on point(arrays)",
        "create table more(x)",
        "drop table point; create table point (number integer primary key, arrays blob check (1))",
    ],
)
def test_databases_that_would_run_something(strange: str, folder: Path) -> None:
    """Nothing of them is met by a statement: some never end, and are deaf to Ctrl-C."""
    path = folder / "points"
    write_checkpoint(path)
    with closing(sqlite3.connect(path)) as db:
        db.executescript(strange)
    before = path.read_bytes()
    with pytest.raises(CheckpointError, match="is a database of another program .its tables: .*: give"):
        read_checkpoint(path)
    assert path.read_bytes() == before


def test_numbers_of_nodes_may_be_large(folder: Path) -> None:
    """A table of them would take 34 GB."""
    large = 2**32 + 5
    text = MESH.replace("\n3 1 1 0", f"\n{large} 1 1 0").replace("1 2 3\n$End", f"1 2 {large}\n$End")
    Path("large.msh").write_text(text)
    assert read_msh("large.msh").parts["a"].volume() == pytest.approx(0.5, rel=1e-12)


MANY = 2_000_000_000
LEFT_OUT = {
    "NodeData": f'1\n"x"\n1\n0\n3\n0\n1\n{MANY}',
    "ElementData": f'1\n"x"\n1\n0\n3\n0\n1\n{MANY}',
    "ElementNodeData": f"{MANY}",
    "Periodic": f"1\n1 1 1\n{MANY}",
    "GhostElements": f"{MANY}",
    "NodesToo": f"1 {MANY} 1 {MANY}",
}


def written(path: Path, version: float, binary: int) -> str:
    """A square as gmsh writes it."""
    with gmsh_session("made") as made:
        made.model.occ.addRectangle(0, 0, 0, 1, 1)
        made.model.occ.synchronize()
        made.model.addPhysicalGroup(2, [1], name="a")
        made.model.mesh.generate(2)
        made.option.setNumber("Mesh.MshFileVersion", version)
        made.option.setNumber("Mesh.Binary", binary)
        made.write(str(path))
    return path.read_bytes().decode("latin1")


@pytest.mark.usefixtures("forking")
@pytest.mark.parametrize(("version", "binary"), [(2.2, 0), (2.2, 1), (4.0, 0), (4.1, 0), (4.1, 1)])
def test_sections_that_no_mesh_needs_are_left_out(version: float, binary: int, folder: Path) -> None:
    """gmsh asks for 11 GB for what some of them count."""
    whole = written(Path("good.msh"), version, binary)
    more = "".join(f"${name}\n{text}\n$End{name}\n" for name, text in LEFT_OUT.items())
    Path("more.msh").write_bytes((whole + more).encode("latin1"))
    assert read_msh("more.msh", timeout=60).parts["a"].volume() == pytest.approx(1.0, rel=1e-12)
    assert checked_copy(Path("more.msh"), Path("copy.msh"), {1: 2, 2: 3, 15: 1}.__getitem__) == [(2, 1, "a")]
    kept = re.findall(rb"(?m)^\$(?!End)(\w+)\n", Path("copy.msh").read_bytes())
    assert set(kept) <= {b"MeshFormat", b"PhysicalNames", b"Entities", b"Nodes", b"Elements"}
    Path("cut.msh").write_bytes(whole[: whole.index("$EndElements") - 20].encode("latin1"))
    refuse("mesh", "cut.msh")


PARTITIONED = f"$PartitionedEntities\n1\n{MANY}\n$EndPartitionedEntities\n$Nodes"
SQUARE = """$MeshFormat
4.1 0 8
$EndMeshFormat
$PhysicalNames
1
2 1 "a"
$EndPhysicalNames
$Entities
0 0 1 0
1 0 0 0 1 1 0 1 1 0
$EndEntities
$Nodes
1 3 1 3
2 1 0 3
1
2
3
0 0 0
1 0 0
1 1 0
$EndNodes
$Elements
1 1 1 1
2 1 2 1
1 1 2 3
$EndElements
"""


@pytest.mark.usefixtures("forking")
@pytest.mark.parametrize(
    ("section", "old", "new"),
    [
        ("Entities", "0 0 1 0", f"0 0 1 {MANY}"),
        ("Entities", "1 1 0 1 1 0", f"1 1 0 {MANY} 1 0"),
        ("Nodes", "1 3 1 3", f"1 {MANY} 1 3"),
        ("Nodes", "1 3 1 3", f"{MANY} 3 1 3"),
        ("Nodes", "2 1 0 3", f"2 1 0 {MANY}"),
        ("Nodes", "2 1 0 3", "2 1 0 -3"),
        ("Nodes", "2\n3\n", "2.5\n3\n"),  # gmsh would read 2, and go on at .5
        ("Nodes", "1 1 0\n$EndN", "1 1 0.5.5\n$EndN"),
        ("Nodes", "1 1 0\n$EndN", f"1 1 0\n$NodeData\n{MANY}\n$EndN"),
        ("Elements", "1 1 1 1", f"1 {MANY} 1 1"),
        ("Elements", "2 1 2 1", f"2 1 2 {MANY}"),
        ("Elements", "2 1 2 1", "2 1 11 1"),
        ("PartitionedEntities", "$Nodes", PARTITIONED),
        ("Nodes", "$EndNodes\n", ""),
    ],
)
def test_counts_of_a_mesh_are_those_of_its_numbers(section: str, old: str, new: str, folder: Path) -> None:
    Path("file.msh").write_text(SQUARE)
    assert read_msh("file.msh").parts["a"].volume() == pytest.approx(0.5, rel=1e-12)
    assert old in SQUARE
    Path("file.msh").write_text(SQUARE.replace(old, new))
    said = rf"'file.msh': its section \${section} is damaged.*; write it again"
    with pytest.raises(lf.SceneError, match=said):
        read_msh("file.msh")


def test_a_chaos_file_as_text_is_checked(good: dict[str, Path], folder: Path) -> None:
    content = json.loads(good["chaos as text"].read_text())
    for value in (10**400, 1e400, "1", None, [[1]], {}):
        changed = content | {"indices": value}
        (folder / "a.json").write_text(json.dumps(changed))
        refuse("chaos as text", folder / "a.json")
