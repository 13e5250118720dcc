"""Cost against size, chaos modes and number of parts, as tables, figures and fitted exponents.

``./run bench performance --json FILE --keep FOLDER --markdown benchmarks/measured/performance.md`` measures

* ``sizes``: the bolted vessel meshed finer and finer. Each size runs in processes of its own, one for
  a method, so that peak memory is that of the method (of its first run). Seconds begin with the matrices of
  the parts; ``units`` are seconds over the time of one direct solution of the same mesh, ``error`` is true:
  energy norm, against the monolithic solution or SSFEM converged to 1e-11;
* ``modes``: chaos of order 1 to 5 in five germs (6 to 252 modes) on the vessel;
* ``parts``: a chain of N equal parts, all interfaces kept; ``friction``: one whose every fourth joint rubs;
* ``loop``: operations and bytes of the global stage per second, beside what a matrix product and a copy
  of a large array reach on the same machine.
"""

from __future__ import annotations

import argparse
import ctypes
import json
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

import common
import contact
import numpy as np
from matplotlib.figure import Figure

from dolfinx_frontend import (
    Chaos,
    ChaosResult,
    Elastic,
    LinearElastic,
    Normal,
    Options,
    Problem,
    Scene,
    assemble,
    geometry,
    make_plan,
    monte_carlo,
    reference,
    solve,
    sweep,
)
from parts.unit import measure_unit
from tests.verification import test_macro


# mm: about 6, 24, 62, 105, 185 and 510 thousand unknowns
SIZES = ("coarse", "9.6", "6.2", "5", "4", "2.75")
METHODS = ("monolithic", "direct", "latin_pce", "ssfem_cg", "sweep", "monte_carlo")
ORDER = 3
PCE_RTOL = 1e-6  # estimates are up to three times too small: half of it where an error of 1e-6 is asked
SWEEP_RTOL = 3e-5  # forces on the joint are then right to 1e-4
CHAIN = (2, 4, 8, 16, 32, 64, 128)
EXACT_UP_TO = 250_000  # unknowns up to which the chaos is compared with a converged SSFEM
LARGE = 150_000  # unknowns from which a time is taken once
HUGE = 300_000  # unknowns from which SSFEM (memory) and Monte Carlo (time) are left out


class Memory:
    """Largest resident memory from here on beyond what is resident now (Linux; elsewhere 0)."""

    def __init__(self) -> None:
        self.status = Path("/proc/self/status")
        if self.status.exists():
            # what is free goes back (glibc), or it would be taken again unseen
            getattr(ctypes.CDLL(None), "malloc_trim", int)(0)
            Path("/proc/self/clear_refs").write_text("5")  # forget the peak of meshing
        self.before = self._read("VmRSS")

    def _read(self, key: str) -> float:
        text = self.status.read_text() if self.status.exists() else ""
        found = re.search(rf"{key}:\s*(\d+) kB", text)
        return 1024.0 * float(found[1]) if found else 0.0

    def peak(self) -> float:
        """Bytes."""
        return self._read("VmHWM") - self.before


def measured(record: dict[str, Any], call: Callable[[], Any], repeats: int) -> Any:
    """What a call returns; its peak in a first run and the median time of later ones go into the record.

    A first run also pays for memory that the system has not given yet; a unit is taken without it, too.
    """
    memory = Memory()
    call()
    record["peak"] = memory.peak()
    timed = common.timed(call, repeats, budget=90.0)
    record["seconds"] = timed.seconds
    return timed.value


def vessel_problem(size: str) -> tuple[Any, Problem]:
    """The demo's module and the vessel with two random stiffnesses."""
    demo = common.demo("bolted_vessel")
    vessel, _ = demo.build_scene(common.size(size))
    return demo, assemble(demo.random_scene(vessel))


def deterministic(demo: Any, problem: Problem) -> Problem:
    """The same parts and matrices with the mean laws."""
    half = 0.5 * demo.SCREW
    screw = problem.interfaces["screw"].law.with_(normal=half, tangential=half)
    return problem.with_laws({"joint": Elastic(normal=demo.JOINT, tangential=demo.JOINT), "screw": screw})


def chaos_error(problem: Problem, result: ChaosResult, order: Chaos) -> float | None:
    """Energy error of all chaos coefficients against a converged SSFEM, if that is affordable."""
    if problem.size > EXACT_UP_TO:
        return None
    exact = reference.ssfem(problem, order, rtol=1e-11)
    own = {name: result.coefficients(name) for name in problem.substructures}
    return float(reference.energy_error(problem, own, exact.coefficients))


def one(method: str, size: str, repeats: int) -> dict[str, Any]:
    """One method on one mesh, in a process that does nothing else."""
    demo, problem = vessel_problem(size)
    fixed = deterministic(demo, problem)
    order = Chaos(ORDER, check_points=0)
    repeats = repeats if problem.size < LARGE else 1
    record: dict[str, Any] = {"method": method, "size": size, "dof": problem.size}

    measure = partial(measured, record, repeats=repeats)
    if method == "monolithic":
        unit = common.unit(fixed, repeats) if problem.size < LARGE else measure_unit(fixed, 1)
        record |= {"seconds": unit.seconds, "solver": unit.solver}
    elif method in ("cholmod", "mumps"):  # for the peak: a unit tries both, and more than once
        systems = reference.Monolithic(fixed).systems(fixed.laws())
        measure(lambda: [reference.Cholesky(A, method).solve(b, refine=False) for _, A, b in systems])
    elif method == "direct":
        result = measure(lambda: solve(fixed))
        exact = reference.monolithic(fixed)
        record["error"] = reference.energy_error(fixed, result.displacements, exact.u)
        record["iterations"] = result.iterations
        record["phases"] = result.spent()
    elif method == "latin_pce":
        options = Options(rtol=PCE_RTOL)
        result = measure(lambda: solve(problem, chaos=order, options=options))
        record |= {"iterations": result.iterations, "phases": result.spent()}
        record["error"] = chaos_error(problem, result, order)
    elif method == "ssfem_cg":
        found = measure(lambda: reference.ssfem(problem, order, rtol=PCE_RTOL))
        record["iterations"] = found.iterations
        if problem.size <= EXACT_UP_TO:
            exact = reference.ssfem(problem, order, rtol=1e-11)
            record["error"] = float(
                reference.energy_error(problem, found.coefficients, exact.coefficients)
            )
    elif method == "sweep":
        grid = demo.stiffnesses(demo.XI_SCREW, demo.XI_JOINT)
        vary = {name.split(".")[0] for names in grid for name in names}
        plan = make_plan(fixed, vary=vary, options=Options(rtol=SWEEP_RTOL))
        surface = measure(lambda: sweep(fixed, grid, plan=plan, progress=False))
        counts = surface.points.iterations[surface.points.order]
        record |= {"iterations": int(counts.sum()), "first": int(counts[0]), "points": counts.size}
        record["error"] = sweep_error(demo, fixed, grid, surface)
    elif method == "monte_carlo":
        memory = Memory()
        for samples in (200, 1200):  # the difference is what a sample costs
            begin = perf_counter()
            options = Options(rtol=SWEEP_RTOL)
            drawn = monte_carlo(problem, samples, options=options, progress=False)
            record[f"seconds_{samples}"] = perf_counter() - begin
            record |= {"peak": memory.peak(), "iterations": int(drawn.iterations.sum()) / samples}
            del drawn
        each = (record["seconds_1200"] - record["seconds_200"]) / 1000.0
        record["seconds"] = record["seconds_200"] + each * (10_000 - 200)
        record["sample_s"] = each
    return record


def sweep_error(demo: Any, problem: Problem, grid: Any, surface: Any) -> float:
    """Largest relative error of the force on the joint over a sample of points, rms over the interface."""
    tight = make_plan(problem, vary={"joint", "screw"}, options=Options(rtol=1e-10))
    exact = sweep(problem, grid, plan=tight, progress=False)
    weights = problem.interfaces["joint"].weights[:, None]
    own, true = surface.force("joint"), exact.force("joint")
    wrong = np.sqrt((weights * (own - true) ** 2).sum(axis=(-1, -2)))
    whole = np.sqrt((weights * true**2).sum(axis=(-1, -2)))
    return float((wrong / whole).max())


def in_process(arguments: list[str], kept: Path | None) -> dict[str, Any]:
    """Run this file in a process of its own, and read the record that it prints last.

    Records are kept in a folder of the commit, and taken from there by a run of the same commit that goes on.
    """
    name = "_".join(arguments).replace("-", "") + ".json"
    file = None if kept is None else kept / common.commit() / name
    if file is not None and file.exists():
        stored: dict[str, Any] = json.loads(file.read_text())
        return stored
    command = [sys.executable, __file__, *arguments]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{' '.join(arguments)} failed:\n{done.stderr[-2000:]}")
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    if file is not None:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(found))
    return found


def sizes_part(sizes: tuple[str, ...], repeats: int, kept: Path | None) -> list[dict[str, Any]]:
    """All methods on all meshes."""
    rows = []
    for size in sizes:
        row: dict[str, Any] = {"size": size}
        for method in METHODS:
            if method in ("ssfem_cg", "monte_carlo") and row["monolithic"]["dof"] > HUGE:
                continue
            row[method] = in_process(["--one", method, size, "--repeats", str(repeats)], kept)
            if method == "monolithic":
                alone = in_process(["--one", row[method]["solver"], size], kept)
                row[method]["peak"] = alone["peak"]
            seconds = row[method]["seconds"]
            row[method]["units"] = seconds / row["monolithic"]["seconds"]
            print(
                f"  {row[method]['dof']:>7} {method:<12}{seconds:9.3f} s {row[method]['units']:7.2f} units"
                f"  peak {row[method]['peak'] / 1e6:6.0f} MB  error {row[method].get('error')}",
                flush=True,
            )
        row["dof"] = row["monolithic"]["dof"]
        rows.append(row)
    return rows


def modes(order: int, size: str) -> dict[str, Any]:
    """Chaos in five germs on the vessel, in a process that does nothing else."""
    demo, problem = vessel_problem(size)
    unit = common.unit(deterministic(demo, problem), 3)
    law, screw = problem.interfaces["joint"].law, problem.interfaces["screw"].law
    half = 0.5 * demo.SCREW
    laws = {
        "joint": law.with_(
            normal=Normal("joint n", demo.JOINT, cov=0.1),
            tangential=Normal("joint t", demo.JOINT, cov=0.1),
        ),
        "screw": screw.with_(
            normal=Normal("screw n", half, cov=0.1),
            tangential=Normal("screw t", half, cov=0.1),
            jump=Normal("shortening", -demo.SHORTENING, cov=0.1),
        ),
    }
    problem = problem.with_laws(laws)
    chaos = Chaos(order, check_points=0)
    record: dict[str, Any] = {"order": order, "dof": problem.size}
    result = measured(record, lambda: solve(problem, chaos=chaos, options=Options(rtol=PCE_RTOL)), 3)
    record |= {
        "modes": result.modes,
        "iterations": result.iterations,
        "units": record["seconds"] / unit.seconds,
        "error_estimate": result.error,
        "phases": result.spent(),
    }
    if order <= 2:
        record["error"] = chaos_error(problem, result, chaos)
    return record


def chain(parts: int) -> dict[str, Any]:
    """A chain of equal boxes, every interface kept, against the assembled structure."""
    scene = Scene()
    box = (1.0, 1.0, 1.0)
    for k in range(parts):
        part = geometry.box(box, (2, 2, 2), origin=(float(k), 0.0, 0.0), cell="hexahedron")
        scene.substructure(f"p{k}", part, LinearElastic(E=200e3, nu=0.3), degree=2)
    for k in range(parts - 1):
        stiff = Elastic(normal=1e6, tangential=1e6)
        scene.interface(f"i{k}", f"p{k}:x1", f"p{k + 1}:x0", stiff)
    scene.fix("p0:x0")
    scene.traction(f"p{parts - 1}:x1", (1.0, 0.5, 0.0), name="pull")
    problem = assemble(scene)
    options = Options(rtol=1e-6, max_iterations=3000)
    active = [f"i{k}" for k in range(parts - 1)]
    run, record = kept(parts, problem, problem, lambda: solve(problem, active=active, options=options))
    exact = reference.monolithic(problem)
    return record | {"error": reference.energy_error(problem, run.displacements, exact.u)}


def rubbing(parts: int) -> dict[str, Any]:
    """A chain in which every fourth joint has friction and opens, all interfaces kept."""
    problem = test_macro.rubbing(parts)
    run, record = kept(
        parts, problem, contact.with_springs(problem), lambda: test_macro.cut(problem, rtol=3e-7)
    )
    exact = solve(problem, options=Options(rtol=1e-10, max_iterations=2000))
    common.settled(exact, 3e-7)
    return record | {"error": reference.energy_difference(problem, run, exact)}


def kept(
    parts: int, problem: Problem, linear: Problem, call: Callable[[], Any]
) -> tuple[Any, dict[str, Any]]:
    """An answer with all interfaces kept, and its cost beside the assembled structure."""
    unit = common.unit(linear, 3)
    run = common.timed(call, 3, budget=60.0)
    record = {"parts": parts, "dof": problem.size, "iterations": run.value.iterations}
    record |= {"seconds": run.seconds, "units": run.seconds / unit.seconds, "unit_s": unit.seconds}
    return run.value, record


def machine() -> dict[str, float]:
    """Speed of one thread: operations of a matrix product, bytes of a copy."""
    a = np.random.default_rng(0).normal(size=(1500, 1500))
    product = common.timed(lambda: a @ a, 5).seconds
    big = np.zeros(40_000_000)
    copied = np.empty_like(big)
    copy = common.timed(lambda: np.copyto(copied, big), 5).seconds
    return {"flops": 2 * 1500.0**3 / product, "bytes": 16.0 * big.size / copy}


def loop(size: str) -> list[dict[str, Any]]:
    """Rates of the global stage for one column and for ten, twenty-one, fifty-five."""
    demo, problem = vessel_problem(size)
    rows = []
    for order in (0, 3, 5, 9):
        if order:
            chaos = Chaos(order, check_points=0)
            # iterated on, and not solved at once
            result: Any = solve(problem, chaos=chaos, options=Options(rtol=PCE_RTOL, newton=0))
            columns = result.modes
        else:
            fixed = deterministic(demo, problem)
            result = solve(fixed, "accelerated", options=Options(rtol=1e-9))
            columns = 1
        # with each dense factor two triangular solves, or a product with its inverse: as many operations
        solver = result.solver
        active = [c["active"] for c in solver.costs]
        numbers = sum(float(n) ** 2 for n in active)
        dice = np.random.default_rng(0)
        data, amplitudes = (
            np.asfortranarray(dice.normal(size=(rows_of, columns))) for rows_of in (solver.rows, solver.loads)
        )
        seconds = common.timed(partial(solver.global_stage, result.laws, data, amplitudes), 1000).seconds
        total = result.summary.global_s + result.summary.local_s + result.summary.check_s
        total += result.summary.other_s
        rows.append(
            {
                "columns": columns,
                "active": active,
                "stage_s": seconds,
                "flops": 2.0 * numbers * columns / seconds,
                "bytes": 8.0 * numbers / seconds,
                "share_global": result.summary.global_s / total,
                "share_local": result.summary.local_s / total,
            }
        )
    return rows


def exponent(x: list[float], y: list[float], last: int = 4) -> float:
    """Slope of a straight line through the last points, doubly logarithmic."""
    return float(np.polyfit(np.log(x[-last:]), np.log(y[-last:]), 1)[0])


def plot(path: Path, xlabel: str, ylabel: str, x: list[float], lines: dict[str, list[float]]) -> None:
    """One small doubly logarithmic figure, label -> values over x."""
    figure = Figure(figsize=(6.5, 4.2), layout="constrained")
    axis = figure.subplots()
    for (label, y), style in zip(lines.items(), ("o-", "s--"), strict=False):
        axis.loglog(x, y, style, label=label)
    axis.set(xlabel=xlabel, ylabel=ylabel)
    axis.set_xticks(x, labels=[f"{each:g}" for each in x])
    values = [each for y in lines.values() for each in y]
    if max(values) < 10.0 * min(values):  # no decade in it: plain numbers
        axis.yaxis.set_major_formatter("{x:g}")
        axis.yaxis.set_minor_formatter("{x:g}")
    axis.xaxis.minorticks_off()
    axis.legend()
    axis.grid(alpha=0.3, which="both")
    figure.savefig(path, dpi=200)


def plots(record: dict[str, Any], folder: Path) -> dict[str, dict[str, float]]:
    """The three figures; returns the exponents that stand in them."""
    folder.mkdir(parents=True, exist_ok=True)
    found: dict[str, dict[str, float]] = {"sizes": {}, "modes": {}, "parts": {}}
    labels = {
        "monolithic": "one direct solution (the unit)",
        "direct": "deterministic, as planned",
        "latin_pce": f"LATIN-PCE, order {ORDER}",
        "ssfem_cg": f"monolithic SSFEM, order {ORDER}",
        "sweep": "sweep of 91 points",
        "monte_carlo": "10 000 samples",
    }
    figure = Figure(figsize=(11, 4.2), layout="constrained")
    axes = figure.subplots(1, 2)
    units = {row["dof"]: row["monolithic"]["seconds"] for row in record["sizes"]}
    for method, label in labels.items():
        rows = [row for row in record["sizes"] if method in row]
        x = [row["dof"] for row in rows]
        seconds = [row[method]["seconds"] for row in rows]
        peaks = [max(row[method]["peak"], 1.0) for row in rows]
        found["sizes"][f"{method} seconds"] = exponent(x, seconds)
        found["sizes"][f"{method} peak"] = exponent(x, peaks)
        ratio = [s / units[n] for n, s in zip(x, seconds, strict=True)]
        axes[0].loglog(x, ratio, "o-", label=label, markersize=4)
        axes[1].loglog(x, [1e-6 * p for p in peaks], "o-", label=label, markersize=4)
    axes[0].set(xlabel="unknowns", ylabel="time / time of one direct solution")
    axes[1].set(xlabel="unknowns", ylabel="peak memory beyond the matrices (MB)")
    axes[0].legend(fontsize=9)
    for axis in axes:
        axis.grid(alpha=0.3, which="both")
    figure.savefig(folder / "performance_sizes.png", dpi=200)

    x = [row["modes"] for row in record["modes"]]
    y = [row["units"] for row in record["modes"]]
    found["modes"]["units"] = exponent(x, y, 2)
    label = f"order 1 to {len(x)}, last slope {found['modes']['units']:.2f}"
    ylabel = "cost / that of one direct solution"
    plot(folder / "performance_modes.png", "chaos modes (five germs)", ylabel, x, {label: y})

    x = [row["parts"] for row in record["parts"]]
    y = [row["seconds"] for row in record["parts"]]
    units = [row["unit_s"] for row in record["parts"]]
    found["parts"]["seconds"] = exponent(x, y)
    lines = {
        f"LATIN, N^{found['parts']['seconds']:.2f}": y,
        f"one direct solution, N^{exponent(x, units):.2f}": units,
    }
    plot(folder / "performance_parts.png", "parts in a chain, all interfaces kept", "seconds", x, lines)
    return found


def markdown(record: dict[str, Any], path: Path, figures: Path) -> None:
    """The page of the run."""
    shown = os.path.relpath(figures, path.parent)

    def growth(section: str, of: str) -> list[str]:
        found = ", ".join(f"{what} {slope:.2f}" for what, slope in record["exponents"][section].items())
        return [f"Fitted exponents of the growth with {of}: {found}.", ""]

    def number(value: float | None, form: str = ".1e") -> str:
        return "-" if value is None else format(value, form)

    e = record["environment"]
    text = [
        "# Performance, measured",
        "",
        f"Made by `{record['command']}`; the numbers and figures on this page are those of one run.",
        "",
        f"Machine: {e['processor']}, {e['cpus']} cores, {e['threads']} thread(s), shared with other work "
        f"(load {e['load']:.1f} at the end): times are medians, single runs from {LARGE // 1000} 000 "
        "unknowns on, after a first run that is not counted (nor is it in the unit). They vary by some tens "
        "of percent. "
        f"{', '.join(e['blas'])}, dolfinx {e['dolfinx']}, PETSc {e['petsc']}.",
        "",
        "A *unit* is one direct solution (analysis, factorisation, one solve) of the assembled structure "
        "on the same mesh, by the fastest of CHOLMOD, MUMPS and, from 100 000 unknowns on, conjugate "
        "gradients with GAMG to a residual of 1e-6. Seconds do not include the assembly of the "
        "parts' matrices. Errors are true errors: in the energy norm of all chaos coefficients together, "
        "against SSFEM converged to 1e-11; for the sweep, the largest error of the force on the joint (rms "
        "over the interface) among all 91 points. Peak memory is the memory that a process needs in addition "
        "to the matrices of the parts, or, for the direct solution, to the assembled matrix.",
        "",
        "## Against size",
        "",
        "The bolted vessel; two random stiffnesses, order 3 (10 modes); the Monte Carlo row is 10 000 "
        "samples, extrapolated from 1 200 at the tolerance of the sweep.",
        "",
    ]
    rows = []
    for row in record["sizes"]:
        for method in METHODS:
            if method not in row:
                continue
            m = row[method]
            rows.append(
                [
                    f"{m['dof']}",
                    method,
                    f"{m['seconds']:.3g}",
                    f"{m['units']:.2f}",
                    "-" if "iterations" not in m else f"{m['iterations']:.4g}",
                    number(m.get("error")),
                    f"{m['peak'] / 1e6:.0f}",
                ]
            )
    header = ["unknowns", "", "seconds", "units", "iterations", "error", "peak, MB"]
    text += [common.markdown_table(header, rows), ""]
    text += growth("sizes", "the unknowns, over the last four")
    text += [f"![Cost against size]({shown}/performance_sizes.png)", ""]
    text += ["## Against modes", "", "Five random variables (germs) on the vessel, orders 1 to 5.", ""]
    table = common.markdown_table(
        ["order", "modes", "iterations", "seconds", "units", "estimated error", "true error", "peak, MB"],
        [
            [
                str(m["order"]),
                str(m["modes"]),
                str(m["iterations"]),
                f"{m['seconds']:.3g}",
                f"{m['units']:.2f}",
                number(m["error_estimate"]),
                number(m.get("error")),
                f"{m['peak'] / 1e6:.0f}",
            ]
            for m in record["modes"]
        ],
    )
    text += [table, "", *growth("modes", "the modes, over the last two orders")]
    text += [f"![Cost against modes]({shown}/performance_modes.png)", ""]
    text += [
        "## Against the number of parts",
        "",
        "A chain of equal boxes (8 quadratic hexahedra each); all elastic interfaces are kept and iterated "
        "on.",
        "",
    ]

    def chains(rows: list[dict[str, Any]]) -> list[str]:
        cells = [
            [m["parts"], m["dof"], m["iterations"]]
            + [f"{m['seconds']:.3g}", f"{m['units']:.2f}", number(m["error"])]
            for m in rows
        ]
        header = ["parts", "unknowns", "iterations", "seconds", "units", "error"]
        return [common.markdown_table(header, cells), ""]

    text += [*chains(record["parts"]), *growth("parts", "the number of parts, over the last four")]
    text += [f"![Cost against the number of parts]({shown}/performance_parts.png)", ""]
    text += [
        "A chain of cubes in which every fourth joint has friction, opens at its edges and slips; the others "
        "are glued:",
        "",
    ]
    text += chains(record["friction"])
    peak_rates = record["machine"]
    text += [
        "## The loop",
        "",
        f"One thread multiplies matrices at {peak_rates['flops'] / 1e9:.1f} GFlop/s and copies at "
        f"{peak_rates['bytes'] / 1e9:.1f} GB/s. The global stage on the mesh of the paper, called from "
        "Python (the median of 1 000 calls, with the copies in and out):",
        "",
    ]
    table = common.markdown_table(
        ["columns", "one stage, ms", "GFlop/s", "of the product", "GB/s of factors", "of the copy",
         "share of the loop", "local stage"],
        [
            [
                str(m["columns"]),
                f"{1e3 * m['stage_s']:.2f}",
                f"{m['flops'] / 1e9:.1f}",
                f"{100 * m['flops'] / peak_rates['flops']:.0f} %",
                f"{m['bytes'] / 1e9:.1f}",
                f"{100 * m['bytes'] / peak_rates['bytes']:.0f} %",
                f"{100 * m['share_global']:.0f} %",
                f"{100 * m['share_local']:.0f} %",
            ]
            for m in record["loop"]
        ],
    )
    text += [table]
    path.write_text("\n".join(text).rstrip() + "\n", encoding="utf-8")


def main() -> None:
    """Measure, print and write."""
    parser = common.parser("performance", "Cost against size, modes and parts.")
    parser.add_argument("--markdown", type=Path, help="page to write")
    parser.add_argument("--figures", type=Path, default=common.FIGURES, help="folder of its figures")
    parser.add_argument("--keep", type=Path, help="folder of records, to go on with after a stop")
    parser.add_argument("--sizes", nargs="+", default=list(SIZES))
    parser.add_argument("--modes-size", default="paper")
    parser.add_argument("--orders", nargs="+", type=int, default=[1, 2, 3, 4, 5])
    parser.add_argument("--parts", nargs="+", type=int, default=list(CHAIN))
    parser.add_argument("--friction", nargs="*", type=int, default=[8, 32, 64], help="chains that rub")
    parser.add_argument("--one", nargs=2, help=argparse.SUPPRESS)
    parser.add_argument("--order", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        print(json.dumps(one(*options.one, options.repeats)))
        return
    if options.order:
        print(json.dumps(modes(options.order, options.modes_size)))
        return
    record: dict[str, Any] = {
        "benchmark": "performance",
        "command": "./run bench performance " + shlex.join(sys.argv[1:]),
        "machine": machine(),
        "sizes": sizes_part(tuple(options.sizes), options.repeats, options.keep),
    }
    record["modes"] = []
    for order in options.orders:
        arguments = ["--order", str(order), "--modes-size", options.modes_size]
        record["modes"].append(in_process(arguments, options.keep))
        row = record["modes"][-1]
        print(f"  {row['modes']} modes {row['units']:.2f} units, {row['iterations']} iterations", flush=True)
    record["parts"] = [chain(n) for n in options.parts]
    record["friction"] = [rubbing(n) for n in options.friction]
    record["loop"] = loop(options.modes_size)
    record["environment"] = common.environment()
    if options.markdown:
        record["exponents"] = plots(record, options.figures)
        markdown(record, options.markdown, options.figures)
    common.write_json(record, options.json)


if __name__ == "__main__":
    main()
