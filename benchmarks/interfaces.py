"""Interface spaces on meshes that do not match: rates of convergence and patch tests, measured.

``./run bench interfaces --json FILE`` writes a list of rows: ``scene`` (blocks: plane interface, smooth
solution; rings: split Lame ring or tube), ``cell``, ``law``, ``degree``, ``space``, ``finer_first`` (whether
the facets of side 1, on which the law holds, are the smaller ones), ``n`` of the meshes, and by mesh
``energy`` (error of the displacement in the energy norm), ``force`` (rms over the interface), ``resultant``,
all relative, ``status`` and ``iterations``; ``patch``, ``uneven``, ``overlap`` and ``getfem``
(:mod:`mortar_getfem`) likewise. The tables of benchmarks/measured/interfaces.md are the output of
``./run bench interfaces --markdown``.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import common
import mortar_getfem
import numpy as np

from dolfinx_frontend.scene.laws import Contact, Perfect
from dolfinx_frontend.solving import solve
from latin_core import Options
from tests.assembly import test_averages as patch
from tests.verification import nonmatching

SIZES = {2: {"blocks": (4, 8, 16, 32), "rings": (2, 4, 8, 16)}, 3: {"blocks": (2, 4, 6), "rings": (2, 4, 6)}}
MEASURES = ("energy", "force", "resultant")


def run(scene: Callable[..., nonmatching.Errors], quick: bool, *args: Any) -> dict[str, Any]:
    """One row: a scene on a sequence of meshes."""
    cell, space, law, degree, finer_first = args
    sizes = SIZES[nonmatching.DIMENSION[cell]][scene.__name__][: 2 if quick else None]
    row: dict[str, Any] = {
        "scene": scene.__name__,
        "cell": cell,
        "law": law,
        "degree": degree,
        "space": space,
        "finer_first": finer_first,
        "n": sizes,
    }
    extra = (finer_first,) if scene is nonmatching.blocks else ()
    errors = [scene(cell, space, law, degree, n, *extra) for n in sizes]
    for name in (*MEASURES, "status", "iterations"):
        row[name] = [getattr(each, name) for each in errors]
    for name in MEASURES:
        (n0, n1), (e0, e1) = sizes[-2:], row[name][-2:]
        row[f"{name}_rate"] = float(np.log(e0 / e1) / np.log(n1 / n0))
    return row


def convergence(quick: bool) -> list[dict[str, Any]]:
    """All spaces, all laws; where what is asked for is refused, that is the row."""
    rows = []
    for scene in (nonmatching.blocks, nonmatching.rings):
        for cell in ("triangle", "tetrahedron", "hexahedron"):
            for degree in (1, 2):
                if cell == "hexahedron" and degree == 1:
                    continue
                for space in ("points", "facets", "mortar"):
                    for law in ("elastic", "contact", "perfect"):
                        if (space, law) == ("points", "perfect"):
                            continue  # refused: it would lock
                        if space == "facets" and law != "elastic" and (cell, degree) == ("tetrahedron", 1):
                            continue  # refused likewise
                        rows.append(run(scene, quick, cell, space, law, degree, True))
    for space in ("facets", "mortar"):
        for law in ("elastic", "contact", "perfect"):
            rows.append(run(nonmatching.blocks, quick, "triangle", space, law, 2, False))
    return rows


def uneven(quick: bool) -> list[dict[str, Any]]:
    """Contact pressure p(theta) of two rings that slide on each other."""
    rows = []
    cases = [("facets", "triangle"), ("mortar", "triangle"), ("mortar", "quadrilateral")]
    for space, cell in cases:
        for n in (4, 8) if quick else (4, 8, 16, 32):
            in_l2, largest, unknowns, result = nonmatching.uneven_rings(space, n, cell)
            rows.append(
                {
                    "cell": cell,
                    "space": space,
                    "unknowns": unknowns,
                    "l2": in_l2,
                    "largest": largest,
                    "status": result.status,
                    "iterations": result.iterations,
                }
            )
    return rows


def patches(quick: bool) -> list[dict[str, Any]]:
    """Two compressed blocks, TARGETS 2.3: the largest errors of displacement and pressure."""
    rows = []
    laws = {"elastic": patch.LAYER, "contact": Contact(), "perfect": Perfect()}
    for space in ("points", "facets", "mortar"):
        for cell in patch.CELLS:
            for name, law in laws.items():
                if (space, name) == ("points", "perfect"):
                    continue
                for k in (1,) if quick or patch.DIMENSION[cell] == 3 else (1, 2, 4):
                    counts = {"first": [3 * k, 4 * k, 2], "second": [2 * k, 3 * k, 2]}
                    problem, exact, _ = patch.compressed(cell, 0.3, law, 2, space, angle=0.4, **counts)
                    options = Options(rtol=1e-12, max_iterations=500)
                    result = solve(problem, method="accelerated", active=["joint"], options=options)
                    moved = max(
                        float(np.abs(u.reshape(-1, problem.dim) - exact[n](p.dof_coordinates)).max())
                        for n, p in problem.substructures.items()
                        for u in (result.displacements[n],)
                    )
                    pressure = result.force("joint")[:, 0] / -1e5 - 1.0
                    weights = problem.interfaces["joint"].weights
                    rows.append(
                        {
                            "space": space,
                            "cell": cell,
                            "law": name,
                            "refined": k,
                            "displacement": moved / 0.1,
                            "pressure": float(np.abs(pressure).max()),
                            "resultant": float(abs(weights @ pressure) / weights.sum()),
                            "status": result.status,
                            "iterations": result.iterations,
                        }
                    )
    return rows


def overlaps(quick: bool) -> list[dict[str, Any]]:
    """Two squares, one of them shifted by 0.37, in contact where they overlap."""
    sizes = (6, 12) if quick else (6, 12, 24, 48)
    rows = []
    for degree in (1, 2):
        exact = nonmatching.overlapping(degree, 3 * sizes[-1], aligned=True)
        for space in ("facets", "mortar"):
            errors = [abs(nonmatching.overlapping(degree, n, space=space) / exact - 1.0) for n in sizes]
            rate = float(np.log(errors[-2] / errors[-1]) / np.log(sizes[-1] / sizes[-2]))
            rows.append({"degree": degree, "space": space, "n": sizes, "energy": errors, "rate": rate})
    return rows


def _show(title: str, header: Sequence[str], rows: Sequence[Sequence[Any]], markdown: bool) -> None:
    print(f"\n{title}\n")
    if markdown:
        print(common.markdown_table(header, rows))
    else:
        common.table(header, rows)


def report(record: dict[str, Any], markdown: bool) -> None:
    """The tables."""
    header = ["cell", "law", "degree", "space", "displacement", "rate", "force", "rate", "resultant", "rate"]
    for scene, title in (("blocks", "Plane interface"), ("rings", "Split ring and tube (curved)")):
        rows = []
        for r in record["convergence"]:
            if r["scene"] != scene:
                continue
            name = r["space"] + ("" if r["finer_first"] else ", coarser side first")
            done = all(s == "converged" for s in r["status"])
            cells = [f"{r[m][-1]:.1e} | {r[m + '_rate']:.1f}".split(" | ") for m in MEASURES]
            rows.append(
                [r["cell"], r["law"], r["degree"], name, *(c for pair in cells for c in pair)]
                + [f"{r['iterations'][-1]}{'' if done else ' (stopped)'}"]
            )
        _show(title, [*header, "iterations"], rows, markdown)
    rows = [
        [
            r["cell"],
            r["law"],
            r["space"],
            r["refined"],
            f"{r['displacement']:.1e}",
            f"{r['pressure']:.1e}",
            f"{r['resultant']:.1e}",
            f"{r['iterations']}{'' if r['status'] == 'converged' else ' (stopped)'}",
        ]
        for r in record["patch"]
    ]
    header = ["cell", "law", "space", "refined", "displacement", "pressure", "resultant", "iterations"]
    _show("Patch test: largest errors", header, rows, markdown)
    rows = [
        [
            r["cell"],
            r["space"],
            r["unknowns"],
            f"{r['l2']:.1e}",
            f"{r['largest']:.1e}",
            f"{r['iterations']}{'' if r['status'] == 'converged' else ' (stopped)'}",
        ]
        for r in record["uneven"]
    ]
    header = ["cell", "space", "unknowns", "in L2", "largest", "iterations"]
    _show("Pressure of rings that slide: errors relative to its mean", header, rows, markdown)
    header, lines = mortar_getfem.table_of(record["getfem"])
    _show("Beside GetFEM: errors of the pressure relative to its mean", header, lines, markdown)
    mortar_getfem.tell_what_is_missing(record["getfem"])
    rows = [
        [r["degree"], r["space"], *(f"{e:.1e}" for e in r["energy"]), f"{r['rate']:.1f}"]
        for r in record["overlap"]
    ]
    header = ["degree", "space", *(f"n = {n}" for n in record["overlap"][0]["n"]), "rate"]
    _show("Partly overlapping faces: error of the energy", header, rows, markdown)


def main() -> None:
    """Measure and report."""
    parser: argparse.ArgumentParser = common.parser("interfaces", __doc__)
    parser.add_argument("--quick", action="store_true", help="two meshes each")
    parser.add_argument("--markdown", action="store_true", help="tables in Markdown")
    options = parser.parse_args()
    warnings.simplefilter("ignore")  # of locking: that is what is measured
    record: dict[str, Any] = {"environment": common.environment()}
    parts: tuple[tuple[str, Callable[[bool], Any]], ...] = (
        ("convergence", convergence),
        ("patch", patches),
        ("uneven", uneven),
        ("getfem", mortar_getfem.measure),
        ("overlap", overlaps),
    )
    for name, measure in parts:
        record[name] = measure(options.quick)
    report(record, options.markdown)
    common.write_json(record, options.json)


if __name__ == "__main__":
    main()
