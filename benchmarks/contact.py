"""Contact and friction: a bolted lap joint over 1 000 parameter sets, and two blocks beside other codes.

``./run bench contact --json FILE`` writes

* ``lap``: the joint of ``demos/bolted_lap_joint.py``, tightened, then sheared (two time steps, five
  contacts with friction on meshes that do not match), swept over friction, shortening and stiffness of the
  bolts. ``dof``; ``sets``; ``seconds`` and ``units`` of all of it, from the matrices of the parts to load,
  slip and preload of every set; ``iterations_first`` and ``iterations_per_set`` (mean of the others),
  ``first_solve_units`` (with factorisation and condensation) and ``per_set_units``; ``error`` of load and
  slip at some sets against tight solutions from nothing, relative to the largest values of the sweep;
  ``k``: iterations from nothing over the factor of the search direction, with the true errors of load and
  slip; ``k_exact``: status and error of what they are compared with (``exact`` for the blocks);
* ``unit_s``: seconds of one analysis, factorisation and solve of the same joint with springs in place of
  the contacts (``unit_solver``, the faster of PETSc's Cholesky solvers); these keys of the lap joint stand
  at the top level too;
* ``blocks``: an elastic block on a softer one, pressed or pressed and sheared in one load step, quadratic
  tetrahedra, meshes that match or do not. ``ours``: ``setup_s`` (assembly of the matrices), ``solve_s``
  (factorisation to displacements of all nodes), ``iterations``, and the true errors ``error_displacement``,
  relative to the largest one, and ``error_force``, against a solution to 1e-10 of the same equations;
* ``joint``: the lap joint with straight cells and bolts shortened by a jump, by us and by CalculiX on the
  same nodes and elements (``_joint.py``); for many sets of CalculiX the time of one run is taken as often;
* ``sector``: the flange sector of ``demos/bolted_vessel.py`` with friction in true contact, its screw
  shortened by a jump, then pressure; by us and by CalculiX on the same nodes and elements (``_sector.py``);
* in ``blocks``, for each of ``peers``: ``seconds`` (``setup_s`` + ``solve_s``: from arrays of nodes and cells
  to the solution; no time to start an interpreter, none to read or write files except for CalculiX, a program
  that reads files), ``max_difference`` of the displacements at all nodes, relative to the largest one, and
  ``force_difference`` of the resultant of the contact, relative to its size. Nodes and elements are the
  same; the discretisation of the contact is each code's own. ``peers`` at the top level has the sum of the
  seconds and the largest differences, beside ``ours_seconds``. Where a program is missing, the numbers are
  null and ``reason`` says so; CalculiX's input deck is written all the same (``--keep FOLDER`` keeps it).
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter
from types import ModuleType
from typing import Any

import _joint
import _sector
import common
import numpy as np
import numpy.typing as npt
from dolfinx import mesh as dmesh
from peers import calculix, exchange
from scipy.spatial import cKDTree

from dolfinx_frontend import (
    Contact,
    Elastic,
    LinearElastic,
    Options,
    Problem,
    Scene,
    assemble,
    geometry,
    solve,
)
from dolfinx_frontend.common import compat
from parts.lap_joint import lap_joint

Array = npt.NDArray[np.float64]

PEERS = ("getfem", "calculix")
MISSING = 3  # exit code of a peer that is not there
RTOL = 1e-5
UPPER, LOWER = (200e3, 0.3), (70e3, 0.3)  # E, nu
PRESS, SHEAR = -0.05, 0.06  # mm
FACTORS = (0.3, 1.0, 3.0, 10.0, 30.0)  # 0.1 to 10 times the default; contacts take a third of it
REASONS = {
    "getfem": "the Python module getfem is not installed",
    "calculix": "there is no program ccx (peers/get_calculix.sh brings one); its input deck was written",
}


# --- the lap joint ---------------------------------------------------------------------------------


def with_springs(problem: Problem) -> Problem:
    """The same parts with springs for the contacts: the matrix that a linear solver would factorise."""
    laws = {name: i.law.nominal for name, i in problem.interfaces.items()}
    springs = Elastic(normal=1e4, tangential=1e4)
    return problem.with_laws({n: springs if isinstance(law, Contact) else law for n, law in laws.items()})


def lap_part(size: str | float, n: int, repeats: int, sets: int) -> dict[str, Any]:
    """The sweep of the lap joint, in units."""
    demo = common.demo("bolted_lap_joint")
    joint = lap_joint(size)
    problem = demo.study_problem(joint)
    unit = common.unit(with_springs(problem), repeats)
    run = common.timed(lambda: demo.study(problem, n, progress=False), repeats, budget=60.0)
    surface = run.value
    counts = surface.points.iterations[surface.points.order]
    first = surface.seconds["setup"] + surface.seconds["first"]
    return {
        "size": size,
        "dof": problem.size,
        "unit_s": unit.seconds,
        "unit_solver": unit.solver,
        "sets": int(counts.size),
        "converged": int(surface.converged.sum()),
        "iterations_first": int(counts[0]),
        "iterations_per_set": float(counts[1:].mean()),
        "iterations_most": int(counts[1:].max()),
        "seconds": run.seconds,
        "units": run.seconds / unit.seconds,
        "first_solve_units": first / unit.seconds,
        "per_set_units": surface.seconds["rest"] / unit.seconds / (counts.size - 1),
        "rtol": surface.plan.options.rtol,
        "error": demo.checked(joint, surface, sets),
        "checked": sets,
        "repeats": run.repeats,
        **directions(demo, problem),
    }


def directions(demo: ModuleType, problem: Problem) -> dict[str, dict[str, Any]]:
    """The mean set of the lap joint from nothing, over the search direction; what it is compared with."""

    def read(result: Any) -> Array:
        return np.array([demo.load(problem, result)[-1], demo.slip(problem, result)[-1]])

    def run(factor: float, rtol: float) -> Any:
        options = Options(rtol=rtol, max_iterations=10000)
        return solve(problem, times=demo.TIMES, direction=factor, options=options)

    tight = solve(problem, times=demo.TIMES, options=Options(rtol=1e-9, max_iterations=20000))
    exact, found = read(tight), {}
    for factor in FACTORS:
        result = run(factor, RTOL)
        found[f"{factor:g}"] = {
            "status": result.status,
            "iterations": result.iterations,
            "newton_steps": result.summary.newton_steps,
            "error": float(np.max(np.abs(read(result) / exact - 1.0))),
        }
    return {"k": found, "k_exact": common.settled(tight, RTOL)}


# --- blocks ----------------------------------------------------------------------------------------


def solid(part: geometry.Part, material: tuple[float, float]) -> exchange.Solid:
    """A part as arrays."""
    mesh = part.mesh
    for low in (0, 1):
        mesh.topology.create_connectivity(mesh.topology.dim - low, 0)
    mesh.topology.create_connectivity(2, 3)
    faces = {
        name: dmesh.entities_to_geometry(mesh, 2, part.facets(name)).astype(np.int64)
        for name in part.faces
    }
    cells = compat.cell_nodes(mesh).astype(np.int64)
    return exchange.Solid(mesh.geometry.x.copy(), cells, *material, faces)


def blocks(n: int, friction: float, matching: bool) -> tuple[exchange.Scene, Problem]:
    """A block on a softer one of the same section, 20 mm x 20 mm; n cells along 10 mm."""
    across = 2 * n if matching else 2 * n - 1
    upper = geometry.box((20, 20, 10), (2 * n, 2 * n, n), (0, 0, 20), cell="tetrahedron")
    lower = geometry.box((20, 20, 20), (across, across, 2 * n), cell="tetrahedron")
    moved = np.array([SHEAR if friction else 0.0, 0.0, PRESS])
    scene = Scene()
    scene.substructure("upper", upper, LinearElastic(*UPPER), degree=2)
    scene.substructure("lower", lower, LinearElastic(*LOWER), degree=2)
    law = Contact(friction=friction or None)
    scene.interface("contact", "upper:z0", "lower:z1", law, space="facets")
    scene.fix("upper:z1", moved, name="head")
    scene.fix("lower:z0", name="ground")
    arrays = exchange.Scene(
        {"upper": solid(upper, UPPER), "lower": solid(lower, LOWER)},
        ("upper:z0", "lower:z1"),
        friction,
        {"upper:z1": moved, "lower:z0": np.zeros(3)},
    )
    return arrays, assemble(scene)


def answer(problem: Problem, rtol: float) -> tuple[dict[str, Array], Array, Any]:
    """Displacements (nodes, 3) of the parts and the force of the contact on the upper block."""
    result = solve(problem, options=Options(rtol=rtol, max_iterations=5000))
    u = {name: field.reshape(-1, 3) for name, field in result.displacements.items()}
    interface = problem.interfaces["contact"]
    force = result.force("contact")
    frames = interface.frames[:, : force.shape[1]]
    return u, np.einsum("p,pci,pc->i", interface.weights, frames, force), result


def differences(
    first: tuple[dict[str, Array], Array], second: tuple[dict[str, Array], Array]
) -> tuple[float, float]:
    """Largest difference of displacement and of force, relative to the largest ones of the second."""
    largest = max(float(np.linalg.norm(u, axis=1).max()) for u in second[0].values())
    apart = max(
        float(np.linalg.norm(first[0][name] - u, axis=1).max()) for name, u in second[0].items()
    )
    return apart / largest, float(np.linalg.norm(first[1] - second[1]) / np.linalg.norm(second[1]))


def by_getfem(arrays: exchange.Scene, folder: Path, repeats: int) -> exchange.Answer | None:
    """The answer of GetFEM, in a separate process; None if it is not installed."""
    script = Path(__file__).parent / "peers" / "getfem_contact.py"
    scene, file = folder / "scene.npz", folder / "getfem.npz"
    arrays.write(scene)
    done = subprocess.run(
        [sys.executable, str(script), str(scene), str(file), str(repeats)],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode == MISSING:
        return None
    if done.returncode:
        raise RuntimeError(f"GetFEM failed:\n{done.stdout[-2000:]}\n{done.stderr[-2000:]}")
    return exchange.read_answer(file)


def by_calculix(problem: Problem, folder: Path, repeats: int) -> exchange.Answer | None:
    """The answer of CalculiX; None if it is not there."""
    found = calculix.run(problem, None, folder / "scene.inp", repeats)
    if found is None:
        return None
    points = {name: part.dof_coordinates for name, part in problem.substructures.items()}
    force = -found.forces[calculix.set_of("head")]
    seconds = {"setup": 0.0, "solve": found.seconds}
    note = "C3D10, surface-to-surface penalty contact"
    return exchange.Answer(points, found.u, force, seconds, found.iterations, note)


def missing(peer: str) -> dict[str, Any]:
    """The record of a peer that is not there."""
    numbers = dict.fromkeys(("seconds", "iterations", "max_difference", "force_difference"))
    return {**numbers, "reason": REASONS[peer]}


def block_part(
    n: int, friction: float, matching: bool, repeats: int, keep: Path | None
) -> dict[str, Any]:
    """One scene by us and by the peers."""
    began = perf_counter()
    arrays, problem = blocks(n, friction, matching)
    setup = perf_counter() - began
    run = common.timed(lambda: answer(problem, RTOL), repeats)
    u, force, result = run.value
    tight = answer(problem, 1e-10)
    errors = differences((u, force), tight[:2])
    force_on_facets = result.force("contact")
    bound = friction * np.abs(force_on_facets[:, 0])
    record: dict[str, Any] = {
        "dof": problem.size,
        "friction": friction,
        "matching": matching,
        "force": force.tolist(),
        "exact": common.settled(tight[2], RTOL),
        "ours": {
            "setup_s": setup,
            "solve_s": run.seconds,
            "seconds": setup + run.seconds,
            "iterations": result.iterations,
            "status": result.status,
            "rtol": RTOL,
            "error_displacement": errors[0],
            "error_force": errors[1],
        },
        "peers": {},
    }
    if friction:
        slips = np.linalg.norm(force_on_facets[:, 1:], axis=1) > bound * (1.0 - 1e-9)
        record["share_of_slip"] = float(slips.mean())
    with tempfile.TemporaryDirectory() as temporary:
        folder = keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        others = {
            "getfem": by_getfem(arrays, folder, repeats), "calculix": by_calculix(problem, folder, repeats)
        }
        for name, found in others.items():
            if found is None:
                record["peers"][name] = missing(name)
                continue
            theirs = {}
            for part, field in u.items():
                nodes = problem.substructures[part].V.tabulate_dof_coordinates()
                apart, place = cKDTree(found.points[part]).query(nodes)
                assert len(nodes) == len(found.points[part]) and apart.max() < 1e-6, "other nodes"
                theirs[part] = found.u[part][place]
                assert theirs[part].shape == field.shape
            moved, pressed = differences((theirs, found.force), (u, force))
            seconds = {f"{phase}_s": value for phase, value in found.seconds.items()}
            record["peers"][name] = {
                "seconds": found.seconds["setup"] + found.seconds["solve"],
                **seconds,
                "iterations": found.iterations,
                "max_difference": moved,
                "force_difference": pressed,
                "note": found.note,
            }
    return record


def report(record: dict[str, Any]) -> None:
    """The record as tables."""
    lap = record["lap"]
    print(
        f"lap joint, {lap['dof']} unknowns, {lap['sets']} sets of 2 steps; unit {lap['unit_s']:.3f} s "
        f"({lap['unit_solver'].upper()}), {record['environment']['threads']} thread(s)\n"
    )
    common.table(
        ["", "iterations", "seconds", "units"],
        [
            [
                "first set, from the matrices",
                lap["iterations_first"],
                f"{lap['first_solve_units'] * lap['unit_s']:.2f}",
                f"{lap['first_solve_units']:.2f}",
            ],
            [
                "each of the others",
                f"{lap['iterations_per_set']:.1f}",
                f"{lap['per_set_units'] * lap['unit_s']:.4f}",
                f"{lap['per_set_units']:.4f}",
            ],
            ["all", "", f"{lap['seconds']:.1f}", f"{lap['units']:.1f}"],
        ],
    )
    print(f"\n  error of load and slip {lap['error']:.1e} of the largest at {lap['checked']} sets\n")
    common.table(
        ["k / (E/L), from nothing", "status", "iterations", "Newton steps", "error"],
        [
            [
                factor,
                each["status"],
                each["iterations"],
                each["newton_steps"],
                f"{each['error']:.0e}",
            ]
            for factor, each in lap["k"].items()
        ],
    )
    print()
    rows = []
    for name, each in record["blocks"].items():
        ours = each["ours"]
        rows.append(
            [
                name,
                "ours",
                ours["iterations"],
                f"{ours['seconds']:.2f}",
                f"{ours['error_displacement']:.0e} (true)",
                f"{ours['error_force']:.0e} (true)",
            ]
        )
        for peer, theirs in each["peers"].items():
            if theirs["seconds"] is None:
                rows.append(["", peer, None, None, None, None])
                continue
            rows.append(
                [
                    "",
                    peer,
                    theirs["iterations"],
                    f"{theirs['seconds']:.2f}",
                    f"{100 * theirs['max_difference']:.2f} %",
                    f"{100 * theirs['force_difference']:.3f} %",
                ]
            )
    common.table(["blocks", "", "iterations", "seconds", "displacement", "force"], rows)
    for peer, theirs in record["peers"].items():
        if "reason" in theirs:
            print(f"\n  {peer}: {theirs['reason']}")


def main() -> None:
    """Measure, print and write."""
    parser = common.parser("contact", "Contact and friction: units of a sweep, and other codes.")
    parser.add_argument("--size", type=common.size, default="medium", help="of the lap joint")
    parser.add_argument("--sets", type=int, default=10, help="values of each of three parameters")
    parser.add_argument("--cells", type=int, default=4, help="cells along 10 mm of the blocks")
    parser.add_argument("--joint", type=common.size, default="coarse", help="size of that of other codes")
    parser.add_argument("--sector", type=common.size, default="paper", help="size of the flange sector")
    parser.add_argument("--checked", type=int, default=6, help="sets solved again, tightly")
    parser.add_argument("--keep", type=Path, help="folder for the scenes, decks and answers of the peers")
    options = parser.parse_args()
    record: dict[str, Any] = {"benchmark": "contact", "environment": common.environment()}
    record["lap"] = lap_part(options.size, options.sets, options.repeats, options.checked)
    for key in (
        "unit_s",
        "first_solve_units",
        "per_set_units",
        "iterations_first",
        "iterations_per_set",
    ):
        record[key] = record["lap"][key]
    record["blocks"] = {}
    for friction in (0.0, 0.3):
        for matching in (True, False):
            kind = "friction" if friction else "frictionless"
            name = f"{kind}, {'matching' if matching else 'not matching'}"
            keep = options.keep and options.keep / name.replace(", ", "_").replace(" ", "_")
            record["blocks"][name] = block_part(
                options.cells, friction, matching, options.repeats, keep
            )
    record["peers"] = {}
    for peer in PEERS:
        found = [each["peers"][peer] for each in record["blocks"].values()]
        lacking = [each for each in found if each["seconds"] is None]
        record["peers"][peer] = (
            lacking[0]
            if lacking
            else {
                "seconds": sum(each["seconds"] for each in found),
                "ours_seconds": sum(each["ours"]["seconds"] for each in record["blocks"].values()),
                "max_difference": max(each["max_difference"] for each in found),
                "force_difference": max(each["force_difference"] for each in found),
            }
        )
    with tempfile.TemporaryDirectory() as temporary:
        demo, folder = common.demo("bolted_lap_joint"), options.keep or Path(temporary)
        record["joint"] = _joint.joint_part(demo, options.joint, options.sets, folder)
        vessel = common.demo("bolted_vessel")
        record["sector"] = _sector.sector_part(vessel, options.sector, options.sets, folder)
    report(record)
    print("\n" + _joint.report(record["joint"]))
    print("\n" + _sector.report(record["sector"]))
    common.write_json(record, options.json)


if __name__ == "__main__":
    main()
