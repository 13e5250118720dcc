"""A contact scene in CalculiX: ``python calculix_contact.py SCENE ANSWER [REPEATS]``.

It needs ``ccx``, which ``get_calculix.sh`` brings.

Ten-node tetrahedra (C3D10), surface-to-surface penalty contact with a stiff linear overclosure and, with
friction, a stick slope ten times lower; small displacements, one increment. The penetration that a penalty
leaves is STIFFER times smaller than the displacement of a cell under the same pressure. With the same stick
slope as overclosure slope ccx takes 1.6 to 4 times the iterations, for a force that differs by 4e-4.

``solve`` is the whole run of ccx, reading and writing included. Without ccx the input deck is still written,
beside the answer, and the exit code is 3.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from time import perf_counter

import numpy as np
from exchange import Answer, Array, Ints, Scene, Solid, read_scene

STIFFER = 300.0
STICK = 0.1
MISSING = 3
# where get_calculix.sh puts it
CACHE = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "latin" / "calculix"
# corners of the edges whose middles are nodes 5 to 10 of C3D10
EDGES = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))
# corners of the faces S1 to S4
FACES = ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0))


def find() -> str | None:
    """The program, if there is one."""
    return shutil.which("ccx") or shutil.which("ccx", path=CACHE)


def quadratic(body: Solid) -> tuple[Array, Ints]:
    """Nodes (n, 3) with those in the middle of edges, and cells (c, 10) of them."""
    cells = body.cells.copy()
    a, b, c, d = (body.x[cells[:, i]] for i in range(4))
    turned = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) < 0.0
    cells[np.ix_(turned, [0, 1])] = cells[np.ix_(turned, [1, 0])]
    edges = np.sort(cells[:, np.array(EDGES)], axis=2)
    unique, place = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True)
    nodes = np.vstack([body.x, body.x[unique].mean(axis=1)])
    return nodes, np.hstack([cells, len(body.x) + place.reshape(-1, 6)])


def lines(numbers: Iterable[int], width: int = 12) -> str:
    """Numbers, some on a line."""
    each = [str(n) for n in numbers]
    return "\n".join(", ".join(each[i : i + width]) for i in range(0, len(each), width))


def deck(scene: Scene) -> tuple[str, dict[str, Array], dict[str, int]]:
    """Input deck, nodes by body and number of the first node of each body."""
    text: list[str] = []
    nodes: dict[str, Array] = {}
    first: dict[str, int] = {}
    count = cell_count = 0
    for name, body in scene.bodies.items():
        x, cells = quadratic(body)
        nodes[name], first[name] = x, count + 1
        text.append(f"*NODE, NSET=N_{name}")
        text += [f"{count + i}, {p[0]:.12g}, {p[1]:.12g}, {p[2]:.12g}" for i, p in enumerate(x, 1)]
        text.append(f"*ELEMENT, TYPE=C3D10, ELSET=E_{name}")
        text += [
            f"{cell_count + i}, " + ", ".join(str(count + 1 + n) for n in cell)
            for i, cell in enumerate(cells, 1)
        ]
        text.append(f"*MATERIAL, NAME=M_{name}\n*ELASTIC\n{body.E:.12g}, {body.nu:.12g}")
        text.append(f"*SOLID SECTION, ELSET=E_{name}, MATERIAL=M_{name}")
        for face, facets in body.faces.items():
            wanted = {tuple(row) for row in np.sort(facets, axis=1).tolist()}
            text.append(f"*SURFACE, NAME=S_{name}_{face}, TYPE=ELEMENT")
            for number, corners in enumerate(FACES, 1):
                keys = np.sort(cells[:, list(corners)], axis=1)
                text += [
                    f"{cell_count + i}, S{number}"
                    for i, key in enumerate(keys.tolist(), 1)
                    if tuple(key) in wanted
                ]
            # a face of these scenes is plane: its nodes, middles included, lie in the plane of its corners
            corner = body.x[np.unique(facets)]
            normal = np.linalg.svd(corner - corner.mean(axis=0))[2][2]
            on = np.abs((x - corner.mean(axis=0)) @ normal) < 1e-9 * np.ptp(body.x)
            text.append(f"*NSET, NSET=N_{name}_{face}\n" + lines(count + 1 + np.flatnonzero(on)))
        count, cell_count = count + len(x), cell_count + len(cells)
    names = [face.replace(":", "_") for face in scene.contact]
    body = scene.bodies[scene.contact[0].partition(":")[0]]
    facets = body.faces[scene.contact[0].partition(":")[2]]
    size = float(np.linalg.norm(body.x[facets[:, 0]] - body.x[facets[:, 1]], axis=1).min())
    stiffness = STIFFER * max(each.E for each in scene.bodies.values()) / size
    text.append("*SURFACE INTERACTION, NAME=CONTACT\n*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR")
    text.append(f"{stiffness:.6g}")
    if scene.friction > 0.0:
        text.append(f"*FRICTION\n{scene.friction:.12g}, {STICK * stiffness:.6g}")
    text.append("*CONTACT PAIR, INTERACTION=CONTACT, TYPE=SURFACE TO SURFACE")
    text.append(", ".join(f"S_{name}" for name in names))
    text.append("*STEP, INC=100\n*STATIC\n1., 1.\n*BOUNDARY")
    held = []
    for where, values in scene.given.items():
        name = where.replace(":", "_")
        held.append(name)
        text += [f"N_{name}, {axis}, {axis}, {v:.12g}" for axis, v in enumerate(values, 1)]
    text += [f"*NODE PRINT, NSET=N_{name}\nU" for name in scene.bodies]
    text += [f"*NODE PRINT, NSET=N_{name}, TOTALS=ONLY\nRF" for name in held]
    text.append("*END STEP\n")
    return "\n".join(text), nodes, first


def read(path: Path, count: int) -> tuple[Array, dict[str, Array]]:
    """Displacements (count, 3) and total reactions by set, of the last increment in a .dat file."""
    u = np.full((count, 3), np.nan)
    totals: dict[str, Array] = {}
    mode = name = ""
    for line in path.read_text().splitlines():
        words = line.split()
        if line.lstrip().startswith("displacements"):
            mode = "u"
        elif line.lstrip().startswith("total force"):
            mode, name = "total", line.partition("for set")[2].split()[0]
        elif mode == "u" and len(words) == 4:
            u[int(words[0]) - 1] = [float(w) for w in words[1:]]
        elif mode == "total" and len(words) == 3:
            totals[name] = np.array([float(w) for w in words])
    return u, totals


def run_deck(text: str, answer: Path) -> tuple[Path, str, float]:
    """Its file of results, what ccx printed, and seconds; ends with MISSING where there is no ccx."""
    program = find()
    if program is None:
        print("ccx is not installed", file=sys.stderr)
        raise SystemExit(MISSING)
    job = answer.with_suffix(".ccx")
    job.mkdir(exist_ok=True)
    (job / "scene.inp").write_text(text)
    start = perf_counter()
    done = subprocess.run(
        [program, "-i", "scene"],
        cwd=job,
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"CCX_NPROC_STIFFNESS": os.environ.get("OMP_NUM_THREADS", "1")},
    )
    seconds = perf_counter() - start
    if done.returncode or "Job finished" not in done.stdout:
        raise SystemExit(f"ccx failed: {done.stdout[-2000:]}")
    return job / "scene.dat", done.stdout, seconds


def main() -> None:
    """Write the deck, run, read."""
    scene, answer = read_scene(Path(sys.argv[1])), Path(sys.argv[2])
    start = perf_counter()
    text, nodes, first = deck(scene)
    setup = perf_counter() - start
    runs = [run_deck(text, answer) for _ in range(int(sys.argv[3]) if len(sys.argv) > 3 else 1)]
    file, printed, _ = runs[-1]
    solve = min(seconds for *_, seconds in runs)
    all_u, totals = read(file, sum(len(x) for x in nodes.values()))
    u = {name: all_u[first[name] - 1 :][: len(x)] for name, x in nodes.items()}
    body = scene.contact[0].partition(":")[0]
    force = np.zeros(3)
    for where in scene.given:
        if where.startswith(f"{body}:"):
            force -= totals["N_" + where.replace(":", "_").upper()]
    steps = printed.count("iteration ")
    note = "C3D10, surface-to-surface penalty contact"
    Answer(nodes, u, force, {"setup": setup, "solve": solve}, steps, note).write(answer)


if __name__ == "__main__":
    main()
