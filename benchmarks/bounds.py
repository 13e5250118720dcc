"""Proven bounds of the error in energy against the true one, on drawn assemblies.

    ./run bench bounds --count 500

Stacks of one to three boxes of triangles or tetrahedra, every third time of quadrilaterals or
hexahedra, of degree 1 and 2, in part sheared or, in 2D, trapezoids; glued, on springs, or in
contact without friction, on meshes that match (and every fifth time do not); moduli up to a
thousand apart, Poisson's ratios up to 0.49, cells up to 1 : 4, tractions, pressures, resultants,
weight and temperature, in m or mm. The true error is the distance of potential energies from meshes
of degree 2 with a quarter of the cells' size, and a third of what these changed from those with
half of it. A ratio below 1 is a broken bound.
"""

from __future__ import annotations

import argparse
import itertools
import json
import warnings
from collections import Counter
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import common
import numpy as np

import dolfinx_frontend as lf


class Drawn(NamedTuple):
    """A scene by its number of cells: mesh size n, degree -> scene."""

    dim: int
    degree: int
    divisions: tuple[int, ...]
    lengths: tuple[float, ...]
    moduli: tuple[float, ...]
    ratios: tuple[float, ...]
    laws: tuple[str, ...]
    load: str
    held: str
    unmatched: bool
    unit: float
    cells: tuple[str, ...]
    shear: float
    wedge: float


def drawn(seed: int) -> Drawn:
    """Of a seed."""
    rng = np.random.default_rng([50, seed])
    dim = 2 if rng.uniform() < 0.7 else 3
    parts = int(rng.integers(1, 4)) if dim == 2 else int(rng.integers(1, 3))
    degree = int(rng.integers(1, 3))
    sizes = rng.uniform(0.5, 2.0, dim)
    base = 3 if dim == 2 else 2
    divisions = tuple(int(v) for v in np.maximum(1, np.round(base * rng.uniform(0.4, 1.3, dim))))
    moduli = tuple(float(10.0 ** rng.uniform(0.0, 3.0)) for _ in range(parts))
    ratios = tuple(float(rng.choice([0.0, 0.2, 0.3, 0.45, 0.49])) for _ in range(parts))
    laws = tuple(str(rng.choice(["glued", "springs", "contact", "soft contact"])) for _ in range(parts - 1))
    load = str(rng.choice(["traction", "pressure", "force", "weight", "temperature"]))
    held = str(rng.choice(["sides", "symmetry"]))
    unmatched = bool(rng.uniform() < 0.2)
    unit = float(rng.choice([1.0, 1000.0]))
    lengths = tuple(float(v) for v in sizes)
    simple, square = ("triangle", "quadrilateral") if dim == 2 else ("tetrahedron", "hexahedron")
    cells, shear, wedge = (simple,) * parts, 0.0, 0.0
    if rng.uniform() < 0.33:
        cells = (square,) * parts
        shear = float(rng.choice([0.0, 0.5, 1.5]))
        if dim == 2 and rng.uniform() < 0.3:  # both kinds have the same tractions on edges
            cells = tuple(str(rng.choice([simple, square])) for _ in range(parts))
        elif dim == 2 and rng.uniform() < 0.3:  # trapezoids
            shear, wedge = 0.0, 0.3
    return Drawn(
        dim, degree, divisions, lengths, moduli, ratios, laws, load, held, unmatched, unit, cells, shear,
        wedge,
    )  # fmt: skip


def scene_of(one: Drawn, finer: int, degree: int) -> lf.Scene:
    """With cells divided `finer` times."""
    scene, d = lf.Scene(), one.dim
    size = np.array(one.lengths) * one.unit
    names = "abc"[: len(one.moduli)]
    for k, name in enumerate(names):
        origin = np.zeros(d)
        origin[1] = k * size[1]
        more = 1 if one.unmatched and k % 2 else 0
        divisions = [finer * (v + more) for v in one.divisions]
        start, cell = [*map(float, origin)], one.cells[k]
        mesh = lf.geometry.box([*map(float, size)], divisions, origin=start, cell=cell)
        x = mesh.mesh.geometry.x
        x[:, 0] += one.shear * x[:, 1] + one.wedge * x[:, 0] * x[:, 1] / size[1]
        steel = lf.LinearElastic(E=one.moduli[k], nu=one.ratios[k], alpha=1e-3)
        weight = [0.0, -0.1 / one.unit] + [0.0] * (d - 2) if one.load == "weight" else None
        scene.substructure(name, mesh, steel, degree=degree, body_force=weight)
    for k, law in enumerate(one.laws):
        stiff = 10.0 * min(one.moduli[k : k + 2]) / one.unit
        made = {
            "glued": lf.Perfect(), "springs": lf.Elastic(normal=stiff, tangential=0.5 * stiff),
            "contact": lf.Contact(), "soft contact": lf.Contact(stiffness=stiff),
        }[law]  # fmt: skip
        scene.interface(f"j{k}", f"{names[k]}:y1", f"{names[k + 1]}:y0", made)
    scene.fix("a:y0")
    for name in names[1:]:
        if one.held == "sides":
            scene.fix(f"{name}:x0")
            continue
        for face in ("x0", "z0")[: d - 1]:
            scene.interface(f"{face} of {name}", f"{name}:{face}", lf.Symmetry())
    top, down = names[-1], [0.0, -0.05 * min(one.moduli)] + [0.0] * (d - 2)
    pull = [0.2 * down[1], down[1], *down[2:]]
    if one.load == "traction":
        scene.traction(f"{top}:y1", pull)
    elif one.load == "pressure":
        scene.pressure(f"{top}:y1", -down[1])
    elif one.load == "force":
        scene.force(f"{top}:y1", [v * one.unit ** (d - 1) for v in pull])
    elif one.load == "temperature":
        scene.temperature(top, 20.0)
    return scene


def potential(result: Any) -> float:
    """Of an answer in equilibrium."""
    found = 0.0
    for name, part in result.problem.substructures.items():
        u = result.unknowns(name)
        found -= 0.5 * float(u @ (part.matrix @ u))
    for name, joint in result.problem.interfaces.items():
        if len(joint.sides) < 2 or joint.law.prescribes == "jump":
            continue
        force, jump = result.force(name), result.jump(name)
        work = np.sum(force * jump, axis=1)
        soft = joint.law.fields(joint).parameters.get("compliance", np.zeros((1, 1)))[:, 0]
        energy = 0.5 * work if joint.law.springs else 0.5 * soft * force[:, 0] ** 2
        found += float(joint.weights @ (energy - work))
    return found


def judged(seed: int) -> dict[str, Any]:
    """One scene."""
    one = drawn(seed)
    tight = lf.Options(rtol=1e-9)
    began = perf_counter()
    answer = lf.solve(lf.assemble(scene_of(one, 1, one.degree)), options=tight, progress=False)
    solved = perf_counter() - began
    verdict: dict[str, Any] = {"seed": seed, "dim": one.dim, "degree": one.degree, "laws": one.laws}
    verdict |= {"load": one.load, "cells": one.cells}
    if not answer.converged:
        return verdict | {"word": "not converged"}
    try:
        bound = answer.errors(kind="bound")
    except lf.SceneError as error:
        return verdict | {"word": "refused", "why": str(error)}
    finer = [
        potential(lf.solve(lf.assemble(scene_of(one, k, 2)), options=tight, progress=False)) for k in (2, 4)
    ]
    best = finer[1] - max(finer[0] - finer[1], 0.0) / 3.0
    true = float(np.sqrt(max(2.0 * (potential(answer) - best), 0.0)))
    ratio = bound.total / true if true > 1e-5 * bound.whole else None
    verdict |= {"word": "strict" if bound.strict else "estimate", "notes": bound.notes, "ratio": ratio}
    return verdict | {"said": bound.relative, "seconds": bound.seconds, "solve": solved}


def main() -> None:
    """Judge, print the worst, and the sums."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--json", type=Path, help="file to write the record to")
    parser.add_argument("--show", action="store_true", help="a line for every scene")
    given = parser.parse_args()
    warnings.simplefilter("ignore", lf.SceneWarning)
    verdicts = []
    for seed in range(given.first, given.first + given.count):
        verdict = judged(seed)
        verdicts.append(verdict)
        ratio = verdict.get("ratio")
        if given.show or (ratio is not None and not 1.0 <= ratio <= 4.0) or verdict["word"] == "refused":
            print(verdict, flush=True)
    words = Counter(each["word"] for each in verdicts)
    simple = {"triangle", "tetrahedron"}
    for word, cut in itertools.product(("strict", "estimate"), (False, True)):
        mine = [v for v in verdicts if v["word"] == word and cut != (set(v["cells"]) <= simple)]
        found = np.array([v["ratio"] for v in mine if v.get("ratio") is not None])
        if len(found):
            marks = np.percentile(found, [0, 50, 95, 100])
            kind = "quadrilaterals, hexahedra" if cut else "simplices"
            print(f"{word}, {kind}: {len(mine)}; bound over true: least {marks[0]:.2f}, median "
                  f"{marks[1]:.2f}, 95 % below {marks[2]:.2f}, largest {marks[3]:.2f}")  # fmt: skip
    print(dict(words))
    if given.json is not None:
        record = {"benchmark": "bounds", "environment": common.environment(), "scenes": verdicts}
        given.json.write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
