"""Files that were cut, overwritten, spliced or are of another version: refused by name, left as they are."""

from __future__ import annotations

import importlib.util
import json
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from dolfinx_frontend.formats.chaos_file import ChaosFile, Field, load_chaos, save_chaos
from dolfinx_frontend.formats.hdf5 import ChaosFileError
from dolfinx_frontend.uncertainty.chaos import Chaos
from dolfinx_frontend.uncertainty.parameters import LogNormal, Uniform
from dolfinx_frontend.uncertainty.space import RandomSpace
from latin_core.checkpoint import Checkpoint, CheckpointError

HEADER = {"run": "fuzz", "points": 4}


def damages(good: bytes, count: int, seed: int) -> Iterator[bytes]:
    """The file cut short, with changed bytes, zeroed, doubled, missing or random blocks."""
    rng = np.random.default_rng(seed)
    n = len(good)
    for k in range(count):
        a, b = sorted(int(v) for v in rng.integers(0, n, 2))
        length = int(rng.integers(1, 600))
        broken = bytearray(good)
        match k % 7:
            case 0:
                broken = broken[: max(a, 1)]
            case 1 | 2:
                broken[a] ^= int(rng.integers(1, 256))
            case 3:
                broken[a : a + length] = bytes(len(broken[a : a + length]))
            case 4:
                broken[a:a] = broken[b : b + length]
            case 5:
                del broken[a : a + length]
            case 6:
                broken[a : a + length] = rng.bytes(len(broken[a : a + length]))
        yield bytes(broken)


def left_alone(folder: Path, path: Path, content: bytes) -> None:
    assert path.read_bytes() == content
    assert [p.name for p in folder.iterdir()] == [path.name]


# ---------------------------------------------------------------------------------------------
# Checkpoints
# ---------------------------------------------------------------------------------------------
def points() -> dict[int, dict[str, np.ndarray]]:
    rng = np.random.default_rng(0)
    return {
        k: {"force": rng.normal(size=200), "status": np.asarray("converged"), "iterations": np.asarray(k)}
        for k in range(4)
    }


def write(path: Path) -> bytes:
    with closing(Checkpoint(path, HEADER)) as file:
        for k, arrays in points().items():
            file.append(k, arrays)
    return path.read_bytes()


def test_damaged_checkpoints(tmp_path: Path) -> None:
    """Refused, or read as what was written (bytes that nobody uses were changed, points lost whole)."""
    path = tmp_path / "points"
    good, truth = write(path), points()
    refused = 0
    for bad in damages(good, 700, 1):
        path.write_bytes(bad)
        try:
            with closing(Checkpoint(path, HEADER)) as file:
                found = dict(file)
        except CheckpointError as error:
            assert "points" in str(error) and "move it away" in str(error)
            refused += 1
        else:
            assert set(found) <= set(truth)
            for k, arrays in found.items():
                assert set(arrays) == set(truth[k])
                assert all(np.array_equal(arrays[name], truth[k][name]) for name in arrays)
        left_alone(tmp_path, path, bad)
    assert refused > 350


@pytest.mark.parametrize("version", [0, 1, 2, 3, None, "two"])
def test_checkpoint_of_another_version(tmp_path: Path, version: object) -> None:
    path = tmp_path / "points"
    write(path)
    with closing(sqlite3.connect(path)) as db, db:
        text = json.loads(db.execute("select text from header").fetchone()[0])
        db.execute("update header set text = ?", (json.dumps(text | {"version": version}, sort_keys=True),))
    before = path.read_bytes()
    with pytest.raises(CheckpointError, match="another run or version"):
        Checkpoint(path, HEADER)
    left_alone(tmp_path, path, before)


def test_points_that_changed_places(tmp_path: Path) -> None:
    """Each is whole, but not where it belongs."""
    path = tmp_path / "points"
    write(path)
    with closing(sqlite3.connect(path)) as db, db:
        db.execute("update point set number = 7 where number = 0")
        db.execute("update point set number = 0 where number = 1")
    with closing(Checkpoint(path, HEADER)) as file, pytest.raises(CheckpointError, match="checksum"):
        list(file)


@pytest.mark.parametrize("value", [None, 3, 2.5, "text", b"", b"short"])
def test_point_that_is_no_archive(tmp_path: Path, value: object) -> None:
    path = tmp_path / "points"
    write(path)
    with closing(sqlite3.connect(path)) as db, db:
        db.execute("update point set arrays = ? where number = 2", (value,))
    with closing(Checkpoint(path, HEADER)) as file, pytest.raises(CheckpointError, match="damaged"):
        list(file)


def test_folder_instead_of_a_checkpoint(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match="is a folder, .*: give the name of a file"):
        Checkpoint(tmp_path, HEADER)


# ---------------------------------------------------------------------------------------------
# Chaos files
# ---------------------------------------------------------------------------------------------
def chaos(path: Path) -> ChaosFile:
    space = RandomSpace([LogNormal("k", 100.0, cov=0.2), Uniform("K", 1.0, 2.0)])
    basis = space.basis(Chaos(order=3))
    save_chaos(path, space, basis, {"w": Field(np.random.default_rng(1).normal(size=(4, len(basis))), "mm")})
    return load_chaos(path)


def has_h5py() -> bool:
    return importlib.util.find_spec("h5py") is not None


FORMATS = (".json", pytest.param(".h5", marks=pytest.mark.skipif(not has_h5py(), reason="no h5py")))


@pytest.mark.parametrize("suffix", FORMATS)
def test_damaged_chaos_files(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    truth, good = chaos(path), path.read_bytes()
    refused = 0
    for bad in damages(good, 350, 2):
        path.write_bytes(bad)
        try:
            found = load_chaos(path)
        except ChaosFileError as error:
            assert path.name in str(error)
            refused += 1
        else:
            assert np.array_equal(found.fields["w"].coefficients, truth.fields["w"].coefficients)
            assert np.array_equal(found.alpha, truth.alpha) and np.array_equal(found.beta, truth.beta)
            assert np.array_equal(found.indices, truth.indices)
        left_alone(tmp_path, path, bad)
    assert refused > 250


@pytest.mark.parametrize(
    "change",
    [
        lambda t: t.update(version=0),
        lambda t: t.update(version=99),
        lambda t: t.update(version=None),
        lambda t: t.update(version=[1]),
        lambda t: t.pop("version"),
        lambda t: t.clear(),
    ],
)
def test_chaos_file_of_another_version(tmp_path: Path, change: Callable[[dict], None]) -> None:
    path = tmp_path / "a.json"
    chaos(path)
    tree = json.loads(path.read_text())
    change(tree)
    path.write_text(json.dumps(tree))
    before = path.read_bytes()
    with pytest.raises(ChaosFileError, match="a.json"):
        load_chaos(path)
    left_alone(tmp_path, path, before)
