"""Damaged STEP and mesh files, and what reading them comes to.

``make(kind, folder)`` writes sound files; ``damaged(text, rng)`` breaks one; ``judge(kind, file, sound)``
reads it and says in a word what happened. ``./run bench fuzz_geometry`` does so thousands of times.
"""

from __future__ import annotations

import io
import json
import pickle
import re
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gmsh
import numpy as np

from dolfinx_frontend import read_step
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.geometry import away as away_module
from dolfinx_frontend.geometry import gmsh as gmsh_module
from dolfinx_frontend.geometry import gmsh_session, read_msh
from dolfinx_frontend.geometry import step as step_module

TIMEOUT = 60.0
"""Seconds after which reading is given up."""


# --- sound files ------------------------------------------------------------------------------------
def _blocks(occ: Any) -> None:
    occ.addBox(0, 0, 0, 20, 10, 10)
    occ.addBox(5, 2, 10, 8, 6, 4)


def _pin(occ: Any) -> None:
    occ.cut([(3, occ.addBox(-10, -10, 0, 20, 20, 6))], [(3, occ.addCylinder(0, 0, 0, 0, 0, 6, 4.0))])
    occ.addCylinder(0, 0, 0, 0, 0, 9, 4.0)


def _round(occ: Any) -> None:
    occ.addBox(-5, -5, -10, 10, 10, 10)
    occ.addSphere(0, 0, 0, 3, angle1=0)
    occ.addCone(0, 0, -14, 0, 0, 4, 1, 3)


def _meshes(folder: Path) -> list[Path]:
    """Meshes of the formats 4.1 and 2.2 as text, and 4.1 binary; of triangles and of tetrahedra."""
    out = []
    for dim, order, version, binary in ((2, 1, 4.1, 0), (2, 2, 2.2, 0), (3, 1, 4.1, 0), (3, 2, 4.1, 1)):
        options = {"Mesh.MeshSizeMax": 0.7, "Mesh.Binary": binary, "Mesh.MshFileVersion": version}
        with gmsh_session("made", options):
            add = gmsh.model.occ.addRectangle if dim == 2 else gmsh.model.occ.addBox
            shape = [(dim, add(x, 0, 0, *([1] * dim))) for x in (0, 1)]
            gmsh.model.occ.fragment(shape[:1], shape[1:])
            gmsh.model.occ.synchronize()
            sides = [{t for _, t in gmsh.model.getBoundary([s], oriented=False)} for s in shape]
            for name, (_, tag) in zip(("left", "right"), shape, strict=True):
                gmsh.model.addPhysicalGroup(dim, [tag], name=name)
            gmsh.model.addPhysicalGroup(dim - 1, sorted(sides[0] & sides[1]), name="joint")
            gmsh.model.mesh.generate(dim)
            gmsh.model.mesh.setOrder(order)
            out.append(folder / f"mesh{dim}_{order}_{version}_{binary}.msh")
            gmsh.write(str(out[-1]))
    return out


def make(kind: str, folder: Path) -> list[Path]:
    """Sound files of a kind, ``"step"`` or ``"msh"``."""
    if kind == "msh":
        return _meshes(folder)
    out = []
    for build in (_blocks, _pin, _round):
        with gmsh_session("made"):
            build(gmsh.model.occ)
            gmsh.model.occ.synchronize()
            out.append(folder / f"{build.__name__[1:]}.step")
            gmsh.write(str(out[-1]))
    return out


# --- damage -----------------------------------------------------------------------------------------
def _cut_off(data: bytes, rng: np.random.Generator) -> bytes:
    return data[: rng.integers(len(data))]


def _other_bytes(data: bytes, rng: np.random.Generator) -> bytes:
    out = bytearray(data)
    for at in rng.integers(len(data), size=rng.integers(1, 20)):
        out[at] = rng.integers(256)
    return bytes(out)


def _hole(data: bytes, rng: np.random.Generator) -> bytes:
    at = int(rng.integers(len(data)))
    return data[:at] + data[at + int(rng.integers(1, 500)) :]


def _twice(data: bytes, rng: np.random.Generator) -> bytes:
    at, width = int(rng.integers(len(data))), int(rng.integers(1, 500))
    return data[: at + width] + data[at:]


def _lines(data: bytes, rng: np.random.Generator) -> bytes:
    """Lines are missing, or in another order."""
    lines = data.split(b"\n")
    for _ in range(rng.integers(1, 4)):
        i, j = (int(k) for k in rng.integers(len(lines), size=2))
        if rng.random() < 0.5:
            lines[i], lines[j] = lines[j], lines[i]
        elif len(lines) > 1:
            del lines[i]
    return b"\n".join(lines)


def _numbers(data: bytes, rng: np.random.Generator) -> bytes:
    """Numbers become other ones: coordinates, counts, references."""
    found = list(re.finditer(rb"-?\d+(\.\d*)?([eE][-+]?\d+)?", data))
    values = [b"0", b"-1", b"1", b"1e300", b"nan", b"999999", b"-2147483649", b"18446744073709551615", b""]
    out, moved = bytearray(data), 0
    for at in sorted(int(k) for k in rng.integers(len(found), size=rng.integers(1, 4))):
        new = values[rng.integers(len(values))]
        if rng.random() < 0.5:
            new = found[rng.integers(len(found))][0]
        start, end = found[at].start() + moved, found[at].end() + moved
        out[start:end] = new
        moved += len(new) - (end - start)
    return bytes(out)


DAMAGES: tuple[Callable[[bytes, np.random.Generator], bytes], ...] = (
    _cut_off,
    _other_bytes,
    _hole,
    _twice,
    _lines,
    _numbers,
    _numbers,
)


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """A file that was damaged in one way."""
    return DAMAGES[rng.integers(len(DAMAGES))](data, rng)


# --- many files, quickly ----------------------------------------------------------------------------
_FORKING = """
import json, os, pickle, runpy, select, sys
worker = runpy.run_path(sys.argv[1])
worker["light_package"]()
worker["no_core_file"]()
answers, sys.path[:] = os.fdopen(os.dup(1), "wb"), json.loads(sys.argv[2])
os.dup2(2, 1)
import gmsh
import dolfinx_frontend.geometry.reading
while True:
    try:
        task, arguments, timeout = pickle.load(sys.stdin.buffer)
    except EOFError:
        break
    out, into = os.pipe()
    child = os.fork()
    if child == 0:
        with os.fdopen(into, "wb") as messages:
            worker["attempt"](task, arguments, lambda *m: (pickle.dump(m, messages), messages.flush()))
        os._exit(0)
    os.close(into)
    data, late = b"", False
    while True:
        late = not select.select([out], [], [], timeout)[0]
        piece = b"" if late else os.read(out, 1 << 20)
        if not piece:
            break
        data += piece
    os.close(out)
    if late:
        os.kill(child, 9)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    pickle.dump((data, late, code), answers)
    answers.flush()
"""


class Forking:
    """Stands in for :func:`away`: one process, which starts once and forks for every file.

    What reads a file is the same; starting it, which takes most of the time for a small file, is left out.
    """

    def __init__(self) -> None:
        line = [sys.executable, "-P", "-c", _FORKING, str(away_module._PROGRAM), json.dumps(sys.path)]
        self.process = subprocess.Popen(
            line, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        )

    def __call__(
        self,
        task: str,
        file: Path,
        failed: str,
        remedy: str,
        timeout: float,
        each: Any = None,
        **arguments: Any,
    ) -> Any:
        assert self.process.stdin is not None and self.process.stdout is not None
        pickle.dump((task, arguments, timeout), self.process.stdin)
        self.process.stdin.flush()
        data, late, code = pickle.load(self.process.stdout)
        kind, answer, stage, stream = "", None, "starting", io.BytesIO(data)
        while stream.tell() < len(data):
            try:
                kind, answer = pickle.load(stream)
            except (EOFError, pickle.UnpicklingError):
                break
            stage = answer if kind == "next" else stage
        if kind == "done":
            return answer
        if kind == "broken":
            raise RuntimeError(answer)
        what = f"timeout, {stage}" if late else f"gmsh ended with {code}, {stage}"
        raise SceneError(f"{file.name!r}: " + (answer if kind in ("refused", "failed") else what))

    def __enter__(self) -> Forking:
        self._before = step_module.away, gmsh_module.away
        step_module.away = gmsh_module.away = self  # type: ignore[assignment]
        return self

    def __exit__(self, *_: object) -> None:
        step_module.away, gmsh_module.away = self._before
        self.process.communicate()


# --- verdicts ---------------------------------------------------------------------------------------
def content(kind: str, file: Path) -> Any:
    """What is in a file, to be compared: names and volumes of the parts; it is meshed as well."""
    if kind == "step":
        step = read_step(file, timeout=TIMEOUT)
        found = sorted((name, round(solid.volume, 6)) for name, solid in step.solids.items())
        step.mesh(order=1, progress=False, timeout=TIMEOUT)
        return found
    parts = read_msh(file, timeout=TIMEOUT).parts
    # volumes would compile forms; corners of the coordinates do
    return sorted((name, part.num_cells, float(part.mesh.geometry.x.sum())) for name, part in parts.items())


def judge(kind: str, file: Path, sound: Any) -> tuple[str, str]:
    """(verdict, message).

    ``refused``, ``late``, ``crash``: one error that names the file; ``same``, ``changed``: it was read.
    ``lost`` (fewer parts, and no word), ``nameless`` and ``wrong error`` are defects.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            found = content(kind, file)
        except SceneError as error:
            text = str(error)
            if file.name not in text:
                return "nameless", text
            return ("late" if "timeout" in text else "crash" if "gmsh ended" in text else "refused"), text
        except Exception as error:
            return "wrong error", f"{type(error).__name__}: {error}"
    if len(found) < len(sound):
        return "lost", f"{sound} became {found}"
    return ("same" if found == sound else "changed"), ""


DEFECTS = ("lost", "nameless", "wrong error", "interpreter ended")
"""Verdicts that must not come up; the last one is given by who runs the interpreter."""
