"""Is an accuracy kept with the meshes in it? Random plane scenes that no one has looked at.

``./run bench heldout [--scenes N] [--first K] [--seed S] [--json FILE]``

Two to four blocks in a row, of triangles or quadrilaterals of degree 1 or 2, their moduli over a decade;
between them springs over three decades, glue, or contact that may open; each on a bed of springs, the first
one clamped. The quantity is the normal force or the mean jump of one of the interfaces. The reference is the
same scene asked for 2e-4 within 60 000 unknowns; an answer is *broken* if it says *reached* and is off by
more than was asked and the reference says of itself.
"""

from __future__ import annotations

import logging
import warnings
from typing import Any

import common
import numpy as np

from dolfinx_frontend import Contact, Elastic, LinearElastic, Perfect, Resultant, Scene, geometry, solve
from dolfinx_frontend.scene.laws import Law

ACCURACIES = (5e-2, 1e-2, 3e-3)
YOUNG = 1e3
BUDGET = {"max_unknowns": 60_000, "max_seconds": 30.0, "progress": False}


def scene(seed: int, number: int) -> tuple[Scene, Resultant]:
    """A scene and what is asked of it."""
    rng = np.random.default_rng([seed, number])
    made, x, heights = Scene(), 0.0, []
    count, degree = int(rng.integers(2, 5)), 0
    cell = str(rng.choice(["triangle", "quadrilateral"]))
    degree = int(rng.integers(1, 3))
    for k in range(count):
        length, height = float(rng.uniform(0.6, 2.5)), float(rng.uniform(0.5, 1.5))
        m = int(rng.integers(2, 4))
        cells = max(2, int(m * length)), max(2, int(m * height))
        part = geometry.box((length, height), cells, (x, 0.0), cell=cell)
        steel = LinearElastic(E=YOUNG * 10.0 ** rng.uniform(-0.5, 0.5), nu=0.3)
        made.substructure(f"p{k}", part, steel, degree=degree)
        heights.append(height)
        x += length
    kinds = []
    for k in range(count - 1):
        kinds.append(str(rng.choice(["springs", "springs", "glue", "contact"])))
        normal, tangential = (YOUNG * 10.0 ** rng.uniform(-1.5, 1.5) for _ in range(2))
        laws: dict[str, Law] = {
            "springs": Elastic(normal=float(normal), tangential=float(tangential)),
            "glue": Perfect(),
            "contact": Contact(),
        }
        faces = [f"p{k}:x1", f"p{k + 1}:x0"]
        made.interface(f"j{k}", *(faces if heights[k] <= heights[k + 1] else faces[::-1]), laws[kinds[-1]])
    for k in range(count):
        made.interface(f"bed{k}", f"p{k}:y0", Elastic(normal=0.05 * YOUNG, tangential=0.05 * YOUNG))
    made.fix("p0:x0")
    made.traction(f"p{count - 1}:x1", (-1.0, float(rng.uniform(-0.3, 0.3))))
    made.traction("p0:y1", (0.0, float(rng.uniform(-1.0, 0.3))))
    which = int(rng.integers(count - 1))
    of = "force" if kinds[which] != "springs" or rng.random() < 0.5 else "jump"
    return made, Resultant(f"j{which}", of)  # type: ignore[arg-type]


def answer(seed: int, number: int, accuracy: float) -> Any:
    """A scene solved to an accuracy."""
    made, quantity = scene(seed, number)
    return solve(made, accuracy=accuracy, quantity=quantity, active=[quantity.interface], **BUDGET), quantity


def main() -> None:
    """Measure and report."""
    parser = common.parser("heldout", __doc__)
    parser.add_argument("--scenes", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    logging.disable(logging.CRITICAL)
    rows = []
    for number in range(given.first, given.first + given.scenes):
        reference, quantity = answer(given.seed, number, 2e-4)
        exact, own = reference.mean_std(quantity).mean, reference.errors().in_all
        for accuracy in ACCURACIES:
            result, _ = answer(given.seed, number, accuracy)
            made = result.errors()
            off = abs(result.mean_std(quantity).mean - exact) / max(abs(exact), 1e-300)
            reached = bool(made.reached)
            broken = reached and off > accuracy + min(own, accuracy)
            rows.append({"number": number, "asked": accuracy, "true": off, "said": made.in_all, "own": own})
            rows[-1] |= {"reached": reached, "broken": broken, "unknowns": result.problem.size}
            mark = "BROKEN" if broken else "" if reached else "not reached"
            print(f"{number:4} {accuracy:.0e} true {off:.1e} said {made.in_all:.1e} {mark}", flush=True)
    said = [r for r in rows if r["reached"]]
    total = {
        "runs": len(rows),
        "reached": len(said),
        "broken": sum(r["broken"] for r in rows),
        "worst": max((r["true"] / r["asked"] for r in said), default=None),
    }
    print(total)
    record = {**total, "seed": given.seed, "environment": common.environment(), "rows": rows}
    common.write_json(record, given.json)


if __name__ == "__main__":
    main()
