"""Newton's method from the first steps, when the plan says, and never: two blocks, pressed and sheared.

``./run bench newton [--cells N ...] [--sheets N ...] [--json FILE]``

Iterations and processor time of a run (matrices of the parts are there), and the largest difference of the
answers in the energy norm to one at a hundredth of the tolerance. Sheets are loose ones between two plates,
with friction on both sides, N by 2 N cells: Newton's steps of two load steps, in units of the tied scene.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from time import process_time
from typing import Any

import common

from dolfinx_frontend import Options, Perfect, solve
from dolfinx_frontend.plan.cost import interface_unknowns
from dolfinx_frontend.reference import energy_difference
from tests.verification.test_newton import blocks, sandwich

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


def sheet(across: int, rtol: float) -> dict[str, Any]:
    problem = sandwich(across)
    tied = problem.with_laws({"below": Perfect(), "above": Perfect()})
    began = process_time()
    solve(tied, times=[1.0])
    unit = process_time() - began
    began = process_time()
    result = solve(problem, times=TIMES, options=Options(rtol=rtol))
    seconds = process_time() - began
    return {
        "unknowns": interface_unknowns(problem, ["below", "above"]),
        "of all": sum(part.size for part in problem.substructures.values()),
        "status": result.status,
        "steps": result.summary.newton_steps,
        "seconds": seconds,
        "units": seconds / unit,
        "error": float(result.error or 0.0),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cells", type=int, nargs="+", default=[6, 8, 10, 13])
    parser.add_argument("--sheets", type=int, nargs="*", default=[12, 24, 50])
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
    sheets = [sheet(across, given.rtol) for across in given.sheets]
    if sheets:
        shown = [[f"{v:.2g}" if isinstance(v, float) else str(v) for v in row.values()] for row in sheets]
        common.table(list(sheets[0]), shown)
    record = {"environment": common.environment(), "rows": rows, "sheets": sheets}
    common.write_json(record, given.json)


if __name__ == "__main__":
    main()
