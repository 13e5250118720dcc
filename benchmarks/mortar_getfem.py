"""Contact pressures on meshes that do not match, beside GetFEM: errors against unknowns.

``./run bench mortar_getfem --json FILE`` writes a list of rows: ``scene``, ``unknowns`` of the
displacements, and for ``ours`` (space ``"mortar"``) and ``getfem`` (its integral contact brick,
multipliers P1 on the side with the smaller facets) the error of the pressure at the vertices of that side
in L2 and the largest one, relative to the mean pressure. Meshes and displacements (quadratic triangles)
are the same. Where GetFEM is missing its numbers are null and ``reason`` says so. The table of
benchmarks/measured/interfaces.md is the output with ``--markdown``, and one of those of
``./run bench interfaces``.

Scenes: ``patch``, two squares between guides, pressed evenly; ``rings``, a quarter of two rings under an even
pressure (Lame);
``sliding rings``, the same under p (1 + cos(2 theta) / 2) (Michell). Curved cells, no friction.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import basix
import common
import numpy as np
import numpy.typing as npt
from dolfinx_frontend import Scene, assemble, solve
from dolfinx_frontend.assembly.elements import tabulate
from dolfinx_frontend.assembly.facet_map import FacetMap
from dolfinx_frontend.common.compat import cell_nodes
from dolfinx_frontend.geometry.parts import Part
from dolfinx_frontend.scene.laws import Contact
from dolfinx_frontend.scene.materials import LinearElastic
from tests.helpers import block
from tests.verification import nonmatching as nm

Array = npt.NDArray[np.float64]
PEER = Path(__file__).parent / "peers" / "getfem_mortar.py"
SHORT = 0.01


def _cells(part: Part) -> Array:
    """(cells, 3 or 6, 2), nodes in the order of GetFEM's lattice."""
    x = part.mesh.geometry.x[cell_nodes(part.mesh)][:, :, :2]
    if x.shape[1] == 3:
        return np.asarray(x)
    lattice = np.array([[0, 0], [0.5, 0], [1, 0], [0, 0.5], [0.5, 0.5], [0, 1]])
    element = basix.create_element(basix.ElementFamily.P, basix.CellType.triangle, 2)
    return np.einsum("qk,cki->cqi", tabulate(element, 0, lattice)[0], x)


def _nodes(part: Part, face: str) -> Array:
    """(k, 2), nodes of the geometry on a face."""
    facets = FacetMap(part, face, "peer")
    s = np.linspace(0.0, 1.0, facets.order + 1)[:, None]
    return facets.alike(s).reshape(-1, 2)


def scene_of(name: str, n: int) -> tuple[Scene, dict[str, Any], Any]:
    """A scene, the same for the peer, and the exact pressure at points."""
    scene, data = Scene(), {}
    held: list[tuple[int, int, float]] = []
    flat = name == "patch"

    def bend(x: Array) -> Array:
        angle = 0.5 * np.pi * x[:, 1]
        return np.column_stack([x[:, 0] * np.cos(angle), x[:, 0] * np.sin(angle)])

    ends = ((0.0, 1.0), (1.0, 2.0)) if flat else ((nm.INNER, nm.MIDDLE), (nm.MIDDLE, nm.OUTER))
    for k, (label, (low, high), along) in enumerate(zip("ab", ends, (3 * n, 2 * n), strict=True)):
        order = 1 if flat else 2
        part = block("triangle", [n, along], [low, 0.0], [high, 1.0], None if flat else bend, order)
        scene.substructure(label, part, LinearElastic(nm.E, nm.NU), degree=2)
        # bent: at y = 0 the plane y = 0, at the other end x = 0
        planes = [("y0", 1, 0.0), ("y1", 1, 0.0)] if flat else [("y0", 1, 0.0), ("y1", 0, 0.0)]
        if flat:
            planes.append(("x0", 0, 0.0) if k == 0 else ("x1", 0, -SHORT))
        for face, axis, value in planes:
            scene.fix(f"{label}:{face}", value, components=axis)
            data[f"held{len(held)}"] = _nodes(part, face)
            held.append((k, axis, value))
        data |= {f"x{k}": _cells(part), f"material{k}": (nm.E, nm.NU)}
        data[f"face{k}"] = _nodes(part, "x1" if k == 0 else "x0")
        if k == 0 and not flat:
            data["loaded"] = _nodes(part, "x0")
    data["held"] = np.array(held)
    scene.interface("joint", "a:x1", "b:x0", Contact(gap=0.0))
    if flat:
        even = nm.E * (1.0 - nm.NU) / ((1.0 + nm.NU) * (1.0 - 2.0 * nm.NU)) * SHORT / 2.0
        return scene, data, lambda x: np.full(len(x), even)
    mean, wave, in_bore = nm.uneven_pressure()
    if name == "rings":
        wave = in_bore = 0.0
    data["load"] = (nm.BORE, in_bore)

    def cosine(x: Array) -> Array:
        return np.asarray(np.cos(2.0 * np.arctan2(x[:, 1], x[:, 0])))

    scene.pressure("a:x0", lambda x: nm.BORE + in_bore * cosine(x))
    return scene, data, lambda x: mean + wave * cosine(x)


def errors(x: Array, pressure: Array, exact: Any) -> dict[str, float]:
    """In L2, with the trapezoidal rule along the interface, and at the worst vertex; relative to the mean."""
    order = np.argsort(x[:, 1])
    x, off = x[order], (pressure - exact(x))[order]
    steps = np.linalg.norm(np.diff(x, axis=0), axis=1)
    weights = 0.5 * (np.append(steps, 0.0) + np.append(0.0, steps))
    mean = weights @ exact(x) / weights.sum()
    in_l2 = np.sqrt(weights @ off**2 / weights.sum())
    return {"l2": float(in_l2 / mean), "largest": float(np.abs(off).max() / mean)}


def peer(data: dict[str, Any], exact: Any) -> dict[str, Any]:
    """What GetFEM finds, in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        given, found = Path(folder) / "scene.npz", Path(folder) / "answer.npz"
        np.savez(given, **data)
        done = subprocess.run(
            [sys.executable, str(PEER), str(given), str(found)], capture_output=True, text=True, check=False
        )
        if done.returncode != 0:
            missing = "No module named 'getfem'" in done.stderr
            reason = "the Python module getfem is not installed" if missing else done.stderr[-300:]
            return {"l2": None, "largest": None, "reason": reason}
        with np.load(found) as answer:
            return errors(answer["x"], answer["pressure"], exact) | {"steps": int(answer["steps"])}


def measure(quick: bool) -> list[dict[str, Any]]:
    """All scenes on a sequence of meshes."""
    rows = []
    for name in ("patch", "rings", "sliding rings"):
        for n in (4, 8) if quick else (4, 8, 16):
            scene, data, exact = scene_of(name, n)
            problem = assemble(scene)
            result = solve(problem, options=nm.OPTIONS)
            i = problem.interfaces["joint"]
            ours = errors(i.points, -result.force("joint")[:, 0], exact)
            ours |= {"status": result.status, "iterations": result.iterations}
            rows.append({"scene": name, "unknowns": problem.size, "ours": ours, "getfem": peer(data, exact)})
    return rows


def table_of(rows: list[dict[str, Any]]) -> tuple[list[str], list[list[Any]]]:
    """Header and lines."""

    def shown(value: float | None) -> str:
        return "-" if value is None else f"{value:.1e}"

    columns = [(who, key) for key in ("l2", "largest") for who in ("ours", "getfem")]
    table = [[r["scene"], r["unknowns"], *(shown(r[who][key]) for who, key in columns)] for r in rows]
    return ["scene", "unknowns", "in L2", "GetFEM", "largest", "GetFEM"], table


def tell_what_is_missing(rows: list[dict[str, Any]]) -> None:
    """Why there are no numbers of GetFEM."""
    for reason in {r["getfem"]["reason"] for r in rows if "reason" in r["getfem"]}:
        print(f"GetFEM: {reason}")


def main() -> None:
    """Measure and report."""
    parser = common.parser("mortar_getfem", __doc__)
    parser.add_argument("--quick", action="store_true", help="the two coarsest meshes")
    parser.add_argument("--markdown", action="store_true", help="the table of the documentation")
    options = parser.parse_args()
    rows = measure(options.quick)

    header, table = table_of(rows)
    if options.markdown:
        print(common.markdown_table(header, table))
    else:
        for row in [header, *table]:
            print("  ".join(f"{cell!s:>14}" for cell in row))
    tell_what_is_missing(rows)
    common.write_json({"rows": rows}, options.json)


if __name__ == "__main__":
    main()
