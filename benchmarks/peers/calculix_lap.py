"""A bolted joint in CalculiX: ``python calculix_lap.py SCENE ANSWER``; needs ``ccx`` (``get_calculix.sh``).

The scene (npz) has the bodies as in ``exchange``, and as json in ``joint``: ``contacts``, ``glued`` and
``cuts`` (pairs of faces "body:face"; glued ones and cuts match node for node), ``friction``, ``shortening``
of the cuts along z in the first step, ``planes`` (faces held along y), ``oblique`` (``faces`` held along
the normal of the plane at ``angle`` to x), ``supports`` (faces held along z), ``held`` (faces held); for the
second step ``pulled`` (a face held, and moved by ``pull`` along x) and ``pressures`` (of faces). What is
glued and cut is tied by equations, node by node; the shortening belongs to a node of its own in those of the
cuts.

Elements and contact are those of ``calculix_contact``.

Answer: ``NAME_points``, ``NAME_u`` of every body at the end, ``load`` (reaction of the pulled face along x),
``bolt`` (force along z in each of the cuts), ``seconds`` of the whole run of ccx, ``iterations``. Exit code 3
without ccx.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
from calculix_contact import FACES, STICK, STIFFER, lines, quadratic, read, run_deck
from exchange import Array, Ints, Solid, bodies_of
from scipy.spatial import cKDTree


def on_facets(x: Array, cells: Ints, facets: Ints, first: int) -> Ints:
    """Numbers of all nodes on some facets, those on edges included."""
    edges = np.vstack([facets[:, pair] for pair in ([0, 1], [1, 2], [2, 0])])
    middles = 0.5 * (x[edges[:, 0]] + x[edges[:, 1]])
    apart, near = cKDTree(x).query(middles)
    assert apart.max() < 1e-9 * np.ptp(x)
    return np.unique(np.concatenate([facets.ravel(), near])) + first


def roots_of(pairs: list[tuple[int, int]]) -> dict[int, int]:
    """Node -> the node that stands for all that are glued to it."""
    parent: dict[int, int] = {}

    def root(n: int) -> int:
        while parent.setdefault(n, n) != n:
            n = parent[n]
        return n

    for a, b in pairs:
        one, other = sorted((root(a), root(b)))
        parent[other] = one
    return {n: root(n) for n in parent}


def deck(
    bodies: dict[str, Solid], joint: dict[str, Any]
) -> tuple[str, dict[str, Array], dict[str, int]]:
    """Input deck, nodes by body and number of the first node of each body."""
    text: list[str] = []
    nodes: dict[str, Array] = {}
    first: dict[str, int] = {}
    members: dict[str, Ints] = {}
    sides: dict[str, list[str]] = {}  # "element, side" of the facets of a face
    count = cell_count = 0
    for name, body in bodies.items():
        x, cells = quadratic(body)
        nodes[name], first[name] = x, count + 1
        text.append(f"*NODE, NSET=N_{name}")
        text += [f"{count + i}, {p[0]:.12g}, {p[1]:.12g}, {p[2]:.12g}" for i, p in enumerate(x, 1)]
        text.append(f"*ELEMENT, TYPE=C3D10, ELSET=E_{name}")
        text += [f"{cell_count + i}, " + lines(count + 1 + c) for i, c in enumerate(cells, 1)]
        text.append(f"*MATERIAL, NAME=M_{name}\n*ELASTIC\n{body.E:.12g}, {body.nu:.12g}")
        text.append(f"*SOLID SECTION, ELSET=E_{name}, MATERIAL=M_{name}")
        for face, facets in body.faces.items():
            members[f"{name}:{face}"] = on_facets(x, cells, facets, count + 1)
            wanted = {tuple(row) for row in np.sort(facets, axis=1).tolist()}
            text.append(f"*SURFACE, NAME=S_{name}_{face}, TYPE=ELEMENT")
            sides[f"{name}:{face}"] = []
            for number, corners in enumerate(FACES, 1):
                keys = np.sort(cells[:, list(corners)], axis=1).tolist()
                found = [i for i, key in enumerate(keys, 1) if tuple(key) in wanted]
                text += [f"{cell_count + i}, S{number}" for i in found]
                sides[f"{name}:{face}"] += [f"{cell_count + i}, P{number}" for i in found]
            text.append(f"*NSET, NSET=N_{name}_{face}\n" + lines(members[f"{name}:{face}"]))
        count, cell_count = count + len(x), cell_count + len(cells)
    where = {first[name] + i: p for name, x in nodes.items() for i, p in enumerate(x.tolist())}
    shortened = count + 1
    text.append(f"*NODE, NSET=N_shortening\n{shortened}, 0., 0., 0.")
    in_plane = {n for face in joint["planes"] for n in members[face].tolist()}
    oblique = joint.get("oblique", {"faces": [], "angle": 0.0})
    slanted = {n for face in oblique["faces"] for n in members[face].tolist()}
    slope = math.tan(oblique["angle"])  # u_y / u_x in that plane

    def tied(kind: str) -> list[tuple[int, int]]:
        found: list[tuple[int, int]] = []
        for one, other in joint[kind]:
            here, there = members[one], members[other]
            apart, near = cKDTree([where[n] for n in there]).query([where[n] for n in here])
            assert apart.max() < 1e-9 * np.ptp(nodes[one.partition(":")[0]])
            found += list(zip(here.tolist(), there[near].tolist(), strict=True))
        return found

    def equation(*terms: tuple[int, int, float]) -> None:
        each = ", ".join(f"{n}, {axis}, {factor:.12g}" for n, axis, factor in terms)
        text.append(f"*EQUATION\n{len(terms)}\n{each}")

    roots = roots_of(tied("glued"))
    for b, a in roots.items():
        for axis in (1, 2, 3):
            if a == b or (axis == 2 and b in in_plane):
                continue  # it stands for itself, or both are held
            turned = axis == 2 and b in slanted
            equation((b, axis, 1.0), (a, 1 if turned else axis, -slope if turned else -1.0))
    for n in sorted(slanted - in_plane):
        if roots.get(n, n) == n:
            equation((n, 2, 1.0), (n, 1, -slope))
    for a, b in tied("cuts"):
        for axis in (1, 2, 3):
            if axis == 2 and a in in_plane:
                continue
            equation((b, axis, 1.0), (a, axis, -1.0), *([(shortened, 3, -1.0)] if axis == 3 else []))
    size = np.inf
    for pair in joint["contacts"]:
        part, _, face = pair[0].partition(":")
        ends = bodies[part].x[bodies[part].faces[face]]
        size = min(size, float(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).min()))
    stiffness = STIFFER * max(each.E for each in bodies.values()) / size
    text.append("*SURFACE INTERACTION, NAME=CONTACT\n*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR")
    text.append(f"{stiffness:.6g}\n*FRICTION\n{joint['friction']}, {STICK * stiffness:.6g}")
    for pair in joint["contacts"]:
        text.append("*CONTACT PAIR, INTERACTION=CONTACT, TYPE=SURFACE TO SURFACE")
        text.append(", ".join(f"S_{face.replace(':', '_')}" for face in pair))
    held = [face.replace(":", "_") for face in joint["held"]]
    pulled = str(joint.get("pulled", "")).replace(":", "_")
    text.append("*BOUNDARY")
    text += [f"N_{face.replace(':', '_')}, 2, 2" for face in joint["planes"]]
    text += [f"N_{face.replace(':', '_')}, 3, 3" for face in joint.get("supports", [])]
    text += [f"{n}, 1, 1" for n in sorted(slanted & in_plane)]  # where two planes meet
    text += [f"N_{name}, 1, 3" for name in held]
    for last in (False, True):
        text.append("*STEP, INC=100\n*STATIC\n1., 1.\n*BOUNDARY")
        text.append(f"N_shortening, 3, 3, {-float(joint['shortening']):.12g}")
        if pulled:
            text.append(f"N_{pulled}, 1, 1, {last * joint['pull']:.12g}\nN_{pulled}, 2, 3, 0.")
        if last:
            for face, pressure in joint.get("pressures", {}).items():
                text.append("*DLOAD\n" + "\n".join(f"{each}, {pressure:.12g}" for each in sides[face]))
            text += [f"*NODE PRINT, NSET=N_{name}\nU" for name in bodies]
            read_off = [other.replace(":", "_") for _, other in joint["cuts"]] + ([pulled] if pulled else [])
            text += [f"*NODE PRINT, NSET=N_{name}, TOTALS=ONLY\nRF" for name in read_off]
        text.append("*END STEP")
    return "\n".join(text) + "\n", nodes, first


def main() -> None:
    """Write the deck, run, read."""
    answer = Path(sys.argv[2])
    with np.load(sys.argv[1]) as data:
        bodies, joint = bodies_of(data), json.loads(str(data["joint"]))
    text, nodes, first = deck(bodies, joint)
    file, printed, seconds = run_deck(text, answer)
    u, totals = read(file, sum(len(x) for x in nodes.values()))
    out: dict[str, Any] = {"seconds": seconds, "iterations": printed.count("iteration ")}
    out["bolt"] = [abs(totals["N_" + other.replace(":", "_").upper()][2]) for _, other in joint["cuts"]]
    if "pulled" in joint:
        out["load"] = totals["N_" + str(joint["pulled"]).replace(":", "_").upper()][0]
    for name, x in nodes.items():
        out |= {f"{name}_points": x, f"{name}_u": u[first[name] - 1 :][: len(x)]}
    np.savez(answer, **out)


if __name__ == "__main__":
    main()
