"""Damaged files, and what their readers make of them."""

from __future__ import annotations

import hashlib
import re
import warnings
from collections.abc import Callable
from contextlib import closing
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import dolfinx_frontend as lf
from dolfinx_frontend import geometry
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.io import ChaosFileError, ResultFileError, load, load_chaos
from faulty.work import GRID, TIGHT, blocks, loose, rough, soft
from latin_core import CheckpointError, Options
from latin_core.checkpoint import Checkpoint

HEADER = {"run": "fuzz", "numbers": [1.0, 2.5, 1e-3], "grid": {"a": [1.0, 2.0]}}


# --- good files ---
def _result(kind: str) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        if kind == "chaos":
            lf.solve(blocks(soft()), chaos=2, options=Options(rtol=1e-4)).save(path)
        elif kind == "samples":
            lf.monte_carlo(blocks(loose()), 4, options=TIGHT, progress=False).save(path)
        elif kind == "sweep":
            lf.sweep(blocks(rough()), GRID, options=TIGHT, progress=False).save(path)
        else:
            lf.solve(blocks(rough()), options=TIGHT).save(path)

    return write


def _chaos(path: Path) -> None:
    lf.solve(blocks(soft()), chaos=2, options=Options(rtol=1e-4)).save_chaos(path)


def _checkpoint(path: Path) -> None:
    random = np.random.default_rng(0)
    with closing(Checkpoint(path, HEADER)) as file:
        for number in range(12):
            file.append(number, {"force": random.normal(size=(2, 90)), "status": np.asarray("converged")})


def _mesh(version: float, binary: int, order: int) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        with geometry.gmsh_session("fuzz", {"Mesh.MshFileVersion": version, "Mesh.Binary": binary}) as gmsh:
            occ, model = gmsh.model.occ, gmsh.model
            boxes = [(3, occ.addBox(0, 0, z, 1, 1, 1)) for z in (0, 1)]
            occ.fragment(boxes[:1], boxes[1:])
            occ.synchronize()
            for name, (_, tag) in zip(("lower", "upper"), boxes, strict=True):
                model.addPhysicalGroup(3, [tag], name=name)
            faces = {round(occ.getCenterOfMass(2, tag)[2], 3): tag for _, tag in model.getEntities(2)}
            model.addPhysicalGroup(2, [faces[0.0]], name="lower:bottom")
            model.addPhysicalGroup(2, [faces[1.0]], name="joint")
            gmsh.option.setNumber("Mesh.MeshSizeMax", 0.7)
            model.mesh.generate(3)
            model.mesh.setOrder(order)
            gmsh.write(str(path))

    return write


# --- what is in them ---
def _numbers(*values: Any) -> str:
    digest = hashlib.sha256()
    for value in values:
        array = np.ascontiguousarray(value)
        data = array.tobytes() if array.dtype.kind in "biufc" else repr(array.tolist()).encode()
        digest.update(f"{array.shape}".encode() + data)
    return digest.hexdigest()


def _in_result(path: Path) -> str:
    found = load(path)
    values: list[Any] = [found.kind, found.status, found.iterations, str(found.table()), str(found.plan)]
    for name in found.known:
        values += [found.force(name), found.jump(name)]
    if found.without_displacements is None:
        values += [found.problem.parts[name].dof_coordinates for name in found.problem.parts]
        if found.kind == "deterministic":
            values += [found.displacements[name] for name in found.problem.parts]
    return _numbers(*values)


def _in_chaos(path: Path) -> str:
    found = load_chaos(path)
    values: list[Any] = [found.alpha, found.beta, found.indices, list(found.germ_names)]
    for name, field in found.fields.items():
        values += [name, field.unit, field.coefficients]
    for name, parameter in found.parameters.items():
        values += [name, parameter.map, parameter.offset, parameter.matrix, parameter.mean]
    return _numbers(*values)


def _in_checkpoint(path: Path) -> str:
    """The points that are there are what was written; how many is for the run to find out."""
    with closing(Checkpoint(path, HEADER)) as file:
        found = dict(file)
    truth = np.random.default_rng(0)
    for number in range(12):
        wanted = truth.normal(size=(2, 90))
        if number in found:
            point = found.pop(number)
            if set(point) != {"force", "status"} or not np.array_equal(point["force"], wanted):
                return "another point"
    return "points" if not found else "too many points"


def _in_mesh(path: Path) -> str:
    """A mesh has no checksum: what a damaged file says may be another mesh, but one that can be used."""
    found = geometry.read_msh(path)
    values: list[Any] = []
    scene = lf.Scene()
    for name, part in found.parts.items():
        tags = part.facet_tags
        values += [name, sorted(part.names), part.mesh.geometry.x, tags.indices, tags.values]
        scene.substructure(name, part, lf.LinearElastic(E=1.0, nu=0.3), degree=1)
        if part.names:
            scene.fix(f"{name}:{sorted(part.names)[0]}", name=f"hold {name}")
    lf.assemble(scene)
    return _numbers(*values)


Kind = tuple[str, Callable[[Path], None], Callable[[Path], str], tuple[type[Exception], ...]]
KINDS: dict[str, Kind] = {
    "result": (".h5", _result("deterministic"), _in_result, (ResultFileError,)),
    "result of a chaos": (".h5", _result("chaos"), _in_result, (ResultFileError,)),
    "result of samples": (".h5", _result("samples"), _in_result, (ResultFileError,)),
    "result of a sweep": (".h5", _result("sweep"), _in_result, (ResultFileError,)),
    "checkpoint": ("", _checkpoint, _in_checkpoint, (CheckpointError,)),
    "chaos, HDF5": (".h5", _chaos, _in_chaos, (ChaosFileError,)),
    "chaos, JSON": (".json", _chaos, _in_chaos, (ChaosFileError,)),
    "mesh 4.1": (".msh", _mesh(4.1, 0, 1), _in_mesh, (SceneError,)),
    "mesh 4.1, binary": (".msh", _mesh(4.1, 1, 2), _in_mesh, (SceneError,)),
    "mesh 2.2": (".msh", _mesh(2.2, 0, 2), _in_mesh, (SceneError,)),
    # STEP files belong here: (".step", writer, digest of the parts, (SceneError,))
}
"""Kind -> ending, how a good file is written, digest of what a file says, errors that refuse one."""


DAMAGES = ("cut", "byte", "bytes", "zeros", "noise", "swapped", "missing", "doubled", "digit")


def damaged(good: bytes, random: np.random.Generator) -> tuple[bytes, str]:
    """A file with one damage, and its name."""
    size = len(good)
    kind = str(random.choice(DAMAGES))
    at = int(random.integers(size))
    length = int(min(2 ** random.integers(0, 13), size - at))
    new = bytearray(good)
    if kind == "cut":
        del new[at:]
    elif kind == "byte":
        new[at] ^= int(random.integers(1, 256))
    elif kind == "bytes":
        for place in random.integers(size, size=int(random.integers(2, 30))):
            new[place] ^= 1 << int(random.integers(8))
    elif kind == "zeros":
        new[at : at + length] = bytes(length)
    elif kind == "noise":
        new[at : at + length] = random.bytes(length)
    elif kind == "swapped":
        other = int(random.integers(size - length + 1))
        new[at : at + length] = good[other : other + length]
        new[other : other + length] = good[at : at + length]
    elif kind == "missing":
        del new[at : at + length]
    elif kind == "doubled":
        new[at:at] = good[at : at + length]
    else:  # another digit: what a checksum or the next check has to notice
        places = [found.start() for found in re.finditer(rb"[0-9]", good)]
        if places:
            new[places[int(random.integers(len(places)))]] = int(random.choice(list(b"0123456789-.e ")))
    return bytes(new), kind


@cache
def good_file(kind: str, folder: Path) -> tuple[Path, bytes, str]:
    """A good file, its content, and what it says."""
    ending, write, read, _ = KINDS[kind]
    path = folder / f"good{ending}"
    path.unlink(missing_ok=True)
    write(path)
    return path, path.read_bytes(), read(path)


def judge(kind: str, seed: int, path: Path, good: bytes, truth: str) -> dict[str, Any]:
    """What the reader makes of one damaged file."""
    _, _, read, refusals = KINDS[kind]
    content, damage = damaged(good, np.random.default_rng(seed))
    about = {"kind": kind, "seed": seed, "damage": damage}
    path.write_bytes(content)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = read(path)
    except refusals as error:
        named = path.name in str(error) or path.suffix == ".msh"
        left = path.read_bytes() == content
        outcome = "refused" if named and left else "unnamed" if left else "changed"
        return {**about, "outcome": outcome, "what": str(error)[:200]}
    except BaseException as error:
        return {**about, "outcome": "raised", "what": f"{type(error).__name__}: {error}"[:300]}
    if found == truth:
        return {**about, "outcome": "right"}
    # no format of meshes has a checksum
    return {**about, "outcome": "another mesh" if path.suffix == ".msh" else "wrong", "what": found[:60]}
