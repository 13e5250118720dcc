"""Newton's method from the first steps, when the plan says, and never: two blocks, pressed and sheared.

``./run bench newton [--cells N ...] [--json FILE]``

Iterations and processor time of a run (matrices of the parts are there), and the largest difference of the
answers in the energy norm to one at a hundredth of the tolerance.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from time import process_time
from typing import Any

import common

from dolfinx_frontend import Options, solve
from dolfinx_frontend.plan.cost import interface_unknowns
from dolfinx_frontend.reference import energy_difference
from tests.verification.test_newton import blocks

WAYS: tuple[tuple[str, Any], ...] = (("at once", 1), ("default", "automatic"), ("never", 0))
TIMES, MOST = [1.0, 2.0], 2000


def measure(cells: int, rtol: float) -> dict[str, Any]:
    problem = blocks(cells)
    row: dict[str, Any] = {"cells": cells, "unknowns": interface_unknowns(problem, ["joint"])}
    row["error"] = 0.0
    options = Options(rtol=rtol, max_iterations=MOST)
    exact = solve(problem, times=TIMES, options=options.with_(rtol=0.01 * rtol))
    for name, newton in WAYS:
        began = process_time()
        result = solve(problem, times=TIMES, options=options.with_(newton=newton))
        row[name] = {"iterations": result.iterations, "seconds": process_time() - began}
        row[name]["status"] = result.status
        row["error"] = max(row["error"], energy_difference(problem, result, exact))
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cells", type=int, nargs="+", default=[6, 8, 10, 13])
    parser.add_argument("--rtol", type=float, default=1e-6)
    parser.add_argument("--json", type=Path, help="file to write the record to")
    given = parser.parse_args()
    rows = [measure(cells, given.rtol) for cells in given.cells]
    header = ("unknowns", *(f"{name}: iterations, s" for name, _ in WAYS), "error")
    table = []
    for row in rows:
        ways = [f"{row[name]['iterations']}, {row[name]['seconds']:.2g}" for name, _ in WAYS]
        table.append([row["unknowns"], *ways, f"{row['error']:.1e}"])
    common.table(header, table)
    common.write_json({"environment": common.environment(), "rows": rows}, given.json)


if __name__ == "__main__":
    main()
