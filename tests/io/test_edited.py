"""Files that were edited by hand and sealed again: one clear error, or all of the file can be read."""

from __future__ import annotations

import copy
import pickle
import shutil
import subprocess
import warnings
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dolfinx_frontend import (
    Amplitude,
    Contact,
    Elastic,
    LinearElastic,
    LogNormal,
    Options,
    Preload,
    Scene,
    SceneError,
    assemble,
    geometry,
    load,
    monte_carlo,
    solve,
    sweep,
)
from dolfinx_frontend.formats import hdf5
from dolfinx_frontend.io import FileError, facet_fields, load_chaos

h5py = pytest.importorskip("h5py")

TEXT = h5py.string_dtype()
ALIKE = ("interfaces/push", "interfaces/wall", "interfaces/bed", "substructures/right")
"""Places that are as others are."""
SAME = (
    "substructures/left/mesh",
    *(f"interfaces/layer/{each}" for each in ("places", "mean_normals", "vertices", "sides", "points")),
    *(f"interfaces/layer/{each}" for each in ("weights", "frames", "directions", "normal", "facets")),
    *(f"interfaces/layer/{each}" for each in ("areas", "trace")),
)
"""Places that are the same in all results."""
OPTIONS = Options(rtol=1e-4)
ROUGH = Contact(friction=0.3, stiffness=200.0)
LOOSE = Contact(friction=0.3, stiffness=LogNormal("k", 200.0, cov=0.2))


def blocks(law: Any) -> Any:
    scene = Scene()
    for name, x0 in (("left", 0.0), ("right", 1.0)):
        part = geometry.box((1.0, 1.0), (1, 1), origin=(x0, 0.0))
        scene.substructure(name, part, LinearElastic(E=100.0, nu=0.3), degree=1)
    scene.fix("left:x0", name="wall")
    scene.interface("layer", "left:x1", "right:x0", law)
    scene.interface("bed", "right:x1", Elastic(normal=1.0, tangential=1.0))
    scene.traction("right:x1", (-1.0, 0.2), name="push")
    return assemble(scene)


def deterministic(path: Path) -> None:
    solve(blocks(ROUGH), options=OPTIONS).save(path)


def history(path: Path) -> None:
    law = Preload(Amplitude([0.0, 1.0], [0.0, 1.0]) * 5.0, until=1.0)
    solve(blocks(law), times=[0.5, 1.0, 1.5], options=OPTIONS).save(path)


def chaos(path: Path) -> None:
    solve(blocks(LOOSE), chaos=2, options=OPTIONS).save(path, samples=5)


def samples(path: Path) -> None:
    monte_carlo(blocks(LOOSE), 3, options=OPTIONS, progress=False, keep_states=True).save(path)


def grid(path: Path) -> None:
    axes = {"layer.friction": [0.1, 0.2], "layer.stiffness": [50.0, 200.0, 800.0]}
    sweep(blocks(ROUGH), axes, options=OPTIONS, progress=False, keep_states=True).save(path)


def chaos_file(path: Path) -> None:
    solve(blocks(LOOSE), chaos=2, options=OPTIONS).save_chaos(path)


def program(path: Path) -> None:
    """What latin_run writes of a chaos."""
    folder = path.with_suffix("")
    blocks(Elastic(normal=LogNormal("k", 200.0, cov=0.2), tangential=50.0)).export(folder, chaos=2)
    command = ["latin_run", str(folder), "--output", str(path)]
    assert subprocess.run(command, check=False, capture_output=True).returncode == 0


def read_run(path: Path) -> None:
    found = load(path)
    for name in found.known:
        found.force(name), found.jump(name)
    found.displacement("left")


def read_result(path: Path) -> None:
    """All that a file can be asked for."""
    found = load(path)
    found.table(), repr(found), found.readings()
    if found.times is not None:
        found.bolts()
    for name, each in found.interfaces.items():
        found.table(name), each.areas, each.facets, each.vertices
        if name in found.known:
            found.force(name), found.jump(name), facet_fields(found, name)
            if found.kind != "sweep":
                found.moments(name)
    for name in found.problem.parts:
        if found.without_displacements is None:
            found.displacement(name)
            if found.problem.substructures[name].material is not None:
                found.stress(name)
            if found.kind != "sweep":
                found.std(name)
    if found.kind in ("sweep", "samples"):
        found.point(*(0 for _ in found.shape)).table()
    found.save(path.with_name("again.h5"))


def read_chaos(path: Path) -> None:
    found = load_chaos(path)
    for name in found.fields:
        found.mean(name), found.std(name), found.sobol(name)
        found.evaluate(name, np.zeros((2, found.dimension)))
    for name in found.parameters:
        found.parameter(name, np.zeros((2, found.dimension)))


def places(path: Path) -> list[tuple[str, str]]:
    """All groups and datasets, and all attributes as (group, name)."""
    found: list[tuple[str, str]] = []
    with h5py.File(path) as file:
        found += [("", name) for name in file.attrs]

        def visit(name: str, node: Any) -> None:
            found.extend([(name, ""), *((name, each) for each in node.attrs)])

        file.visititems(visit)
    return found


Edit = Callable[[Any], None]


def edits(path: Path, place: str, name: str) -> Iterator[tuple[str, Edit]]:
    """What is done to an entry: renamed (one is missing, one too much), of another kind, of another shape."""
    with h5py.File(path) as file:
        node = file[place] if place else file
        value = node.attrs[name] if name else None if isinstance(node, h5py.Group) else node[()]

    def put(new: Any) -> Edit:
        def edit(file: Any) -> None:
            if name:
                (file[place] if place else file).attrs[name] = new
                return
            del file[place]
            if isinstance(new, dict):
                file.create_group(place)
            else:
                file.create_dataset(place, data=new, dtype=TEXT if isinstance(new, list) else None)

        return edit

    def rename(file: Any) -> None:
        if name:
            attributes = (file[place] if place else file).attrs
            attributes[f"{name}_"] = attributes[name]
            del attributes[name]
        else:
            file.move(place, f"{place}_")

    yield "renamed", rename
    if name:
        yield "another kind", put(7 if isinstance(value, str) else "x")
    elif value is None:
        yield "emptied", put({})
        yield "another kind", put(np.zeros(3))
    elif value.dtype.kind == "O":
        yield "another kind", put(np.zeros(len(value)))
        yield "one more", put([*map(bytes.decode, value), "x"])
    else:
        yield "another kind", put(["a"] * max(1, len(value) if value.ndim else 1))
        yield "complex", put(value + 1j)
        yield "an axis more", put(value[..., None])
        if value.size:
            yield "one less", put(value.ravel()[:-1].reshape(-1) if value.ndim < 2 else value[:-1])
        if value.ndim > 1:
            yield "one column less", put(value[..., :-1])


WRITERS = (deterministic, history, chaos, samples, grid, chaos_file, program)
THINNED = {deterministic: 3, program: 3}
"""Every which edit is made; of other files every sixth: results have most places in common."""


@pytest.mark.parametrize(
    ("write", "thinned"),
    [
        *((each, THINNED.get(each, 6)) for each in WRITERS),
        *(pytest.param(each, 1, marks=pytest.mark.night(guard="every sixth edit")) for each in WRITERS),
    ],
)
@pytest.mark.filterwarnings("ignore:.*its faces (slide|move) by")
def test_what_is_missing_or_malformed_is_said(
    write: Callable[[Path], None], thinned: int, tmp_path: Path
) -> None:
    good, path = tmp_path / "good.h5", tmp_path / "edited.h5"
    if write is program and shutil.which("latin_run") is None:
        pytest.skip("latin_run was built without HDF5")
    write(good)
    whole = good.read_bytes()
    form = whole.split(maxsplit=1)[0].decode()
    read = {chaos_file: read_chaos, program: read_run}.get(write, read_result)
    read(good)
    refused = tried = 0
    turns = count(WRITERS.index(write))
    for place, name in places(good):
        if place.startswith(ALIKE if write is deterministic else ALIKE + SAME):
            continue
        for kind, edit in edits(good, place, name):
            if next(turns) % thinned:
                continue
            path.write_bytes(whole)
            with h5py.File(path, "r+") as file:
                edit(file)
            hdf5.seal(path, form)
            tried += 1
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    read(path)
            except FileError as error:
                refused += 1
                assert str(path) in str(error), (place, name, kind)
                # not in the words of Python, but for the file of a chaos alone
                assert "Error:" not in str(error) or write is chaos_file, (place, name, kind, str(error))
            except Exception as error:
                raise AssertionError(f"{place} {name} {kind}: {type(error).__name__}: {error}") from error
    # what may be missing is, and names may be others
    assert refused > 0.8 * tried


@pytest.mark.parametrize(
    ("place", "new", "said"),
    [
        ("interfaces/layer/points", None, "interfaces/layer/points is missing"),
        ("interfaces/layer/weights", np.ones(7), r"interfaces/layer/weights has shape \(7,\), shape \(2\)"),
        ("interfaces/layer/force", np.ones((2, 3)), r"layer/force has shape \(2, 3\), shape \(2, 2\)"),
        ("interfaces/layer/sides", ["left:x1", "right:y7"], "names 'right:y7', which is not in the file"),
        ("interfaces/layer/trace/nodes", np.array([0, 99]), "numbers from 0 to 99, 0 to 3 are wanted"),
        ("interfaces/layer/areas/starts", np.array([1, 2]), "does not ascend from 0 to 2"),
        ("interfaces/layer/facets", np.array([[0, 4]]), "has a facet that is none of left:x1"),
        ("substructures/left/displacement", None, "substructures/left/displacement is missing"),
        ("substructures/left/mesh/tags", np.ones(4, dtype=int), "two faces have one name or one tag"),
        ("active", ["nowhere"], "active names 'nowhere', which is not in the file"),
        ("substructures/left/displacement", np.full((4, 2), np.nan), "left/displacement has .* not finite"),
    ],
)
def test_places_are_named(place: str, new: Any, said: str, tmp_path: Path) -> None:
    path = tmp_path / "edited.h5"
    deterministic(path)
    with h5py.File(path, "r+") as file:
        del file[place]
        if new is not None:
            file.create_dataset(place, data=new, dtype=TEXT if isinstance(new, list) else None)
    hdf5.seal(path, "latin-result")
    with pytest.raises(FileError, match=f"was edited: .*{said}.*save it again"):
        load(path)


@pytest.mark.parametrize(
    ("write", "place", "at"),
    [
        (grid, "axes/layer.friction", 0),
        (grid, "substructures/left/displacement", 1),
        (samples, "germs", 0),
        (history, "substructures/left/displacement", 1),
    ],
)
@pytest.mark.filterwarnings("ignore:.*its faces (slide|move) by")
def test_numbers_that_are_none(write: Callable[[Path], None], place: str, at: int, tmp_path: Path) -> None:
    path = tmp_path / "edited.h5"
    write(path)
    for value in (np.nan, np.inf):
        with h5py.File(path, "r+") as file:
            file[place][at] = value
        hdf5.seal(path, "latin-result")
        with pytest.raises(FileError, match=f"was edited: {place} has numbers that are not finite; save it"):
            load(path)
    if write is grid and place != "axes/layer.friction":  # where a point has not arrived nothing is known
        with h5py.File(path, "r+") as file:
            file["points/status"][at] = "diverged"  # as its words were before
        hdf5.seal(path, "latin-result")
        assert load(path).point(0, at).status == "undecided"


@pytest.mark.parametrize(("write", "at"), [(samples, (1,)), (grid, (0, 2))])
@pytest.mark.filterwarnings("ignore:.*its faces (slide|move) by")
def test_a_point_of_a_file_is_read_as_the_whole(
    write: Callable[[Path], None], at: tuple[int, ...], tmp_path: Path
) -> None:
    """Springs and loads that are not iterated on have laws in words only."""
    path = tmp_path / "points.h5"
    write(path)
    whole = load(path)
    point = whole.point(*at)
    number = int(np.ravel_multi_index(at, whole.shape))
    assert set(point.table()["interface"]) == {"layer", "bed", "push"} == set(whole.known)
    for name in whole.known:
        every = whole.readings(name).interfaces[name].values["force_x"]
        assert point.table().value("force_x", name) == pytest.approx(every[number], rel=1e-12, abs=1e-12)


def test_loaded_files_are_copied_and_asked_for_samples(tmp_path: Path) -> None:
    path = tmp_path / "chaos.h5"
    chaos(path)
    found = load(path)
    found.displacement("left")  # its mesh is made
    for copied in (copy.deepcopy(found), pickle.loads(pickle.dumps(found))):
        assert str(copied.table()) == str(found.table())
        assert np.array_equal(copied.unknowns("left"), found.unknowns("left"))
    for wrong in ("a", -3, 0, 2.5):
        with pytest.raises(SceneError, match="samples = "):
            list(found.blocks(wrong))  # type: ignore[arg-type]
        with pytest.raises(SceneError, match="samples = "):
            found.table(samples=wrong)  # type: ignore[arg-type]
    with pytest.raises(SceneError, match="germ_points = 'a'"):
        found.at("a")  # type: ignore[arg-type]
