"""What a plan says of cost and memory, beside what ways took: chaos, rules and samples on many scenes.

``./run bench plan [--json FILE] [--markdown benchmarks/measured/plan.md] [--only SCENE ...]``

Every run is a process of its own, forked from one that has assembled the scene. Cost is processor time (what
other programs do on the machine does not count), in *units*: of a direct solve of the scene with all that is
random at its mean, measured in the same way (with contact: of factorising its parts). Memory is the peak of
the resident set over what the assembled scene had.
"""

from __future__ import annotations

import ctypes
import gc
import json
import os
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from time import process_time
from typing import Any

import common
import numpy as np

import dolfinx_frontend as lf
from dolfinx_frontend import Contact, Elastic, Gamma, LinearElastic, LogNormal, Normal, Options, Problem
from dolfinx_frontend import RandomField, Scene, Uniform, assemble
from dolfinx_frontend.geometry import box
from dolfinx_frontend.kernel.solver import Solver
from benchmarks import tradeoff

Run = Callable[[Problem, Mapping[str, Any]], Any]


# %% Scenes


def row(
    parts: int,
    cells: Sequence[int],
    law: Callable[[int], Any],
    cell: str,
    force: Sequence[Any],
    material: Callable[[int], LinearElastic] | None = None,
    degree: int = 2,
) -> Scene:
    """Blocks of 10 one after the other, with an interface between each two."""
    scene, dim = Scene(), len(cells)
    steel = LinearElastic(E=200e3, nu=0.3)
    for k in range(parts):
        shape = box((10.0,) * dim, tuple(cells), (10.0 * k, *(0.0,) * (dim - 1)), cell=cell)
        scene.substructure(f"b{k}", shape, material(k) if material else steel, degree=degree)
    for k in range(parts - 1):
        scene.interface(f"i{k}", f"b{k}:x1", f"b{k + 1}:x0", law(k))
    scene.fix("b0:x0")
    scene.traction(f"b{parts - 1}:x1", tuple(force))
    return scene


def springs(kind: Any, cov: float, mean: float = 2e4) -> Callable[[int], Elastic]:
    """Springs with a random stiffness each."""

    def law(k: int) -> Elastic:
        value = kind(f"k{k}", mean=mean, cov=cov)
        return Elastic(normal=value, tangential=value)

    return law


def field(modes: int, cov: float, length: float = 5.0, mean: float = 2e4) -> RandomField:
    """A lognormal field."""
    return RandomField(
        "k",
        mean=mean,
        cov=cov,
        covariance="exponential",
        length=length,
        modes=modes,
        distribution="lognormal",
    )


def of_field(modes: int) -> Callable[[int], Elastic]:
    """Springs whose stiffness is one field."""
    each = field(modes, 0.4)
    return lambda k: Elastic(normal=each, tangential=each)


def gaps() -> Scene:
    """Three blocks that rest on rollers, pressed together over random gaps."""
    scene = row(
        3, (12, 12), lambda k: Contact(gap=Normal(f"g{k}", mean=0.0, std=1e-4), friction=0.3),
        "quadrilateral", (-5.0, 0.0),
    )
    for name in ("b1:y0", "b2:y0"):
        scene.symmetry(name)
    return scene


def inside() -> Scene:
    """One plate whose stiffness is a field."""
    scene = Scene()
    steel = LinearElastic(E=field(4, 0.3, mean=200e3), nu=0.3)
    scene.substructure("b0", box((20.0, 10.0), (24, 12), cell="quadrilateral"), steel)
    scene.fix("b0:x0")
    scene.traction("b0:x1", (1.0, 0.2))
    return scene


def moduli(k: int) -> LinearElastic:
    """Random moduli of all blocks but the first."""
    return LinearElastic(E=LogNormal(f"E{k}", mean=200e3, cov=0.2) if k else 200e3, nu=0.3)


SCENES: dict[str, tuple[Callable[[], Problem], str]] = {
    "2 cubes": (lambda: assemble(row(2, (6,) * 3, springs(LogNormal, 0.3), "hexahedron", (1, 0.3, 0))),
                "chaos 1, chaos 3, chaos 6, tensor 3, tensor 6, samples 64, samples 512"),
    "2 fine cubes": (lambda: assemble(row(2, (11,) * 3, springs(LogNormal, 0.3), "hexahedron", (1, 0.3, 0))),
                     "chaos 2, chaos 6, tensor 6, samples 256"),
    "6 cubes": (lambda: assemble(row(6, (4,) * 3, springs(Gamma, 0.3), "hexahedron", (1, 0.3, 0))),
                "chaos 1, chaos 2, chaos 3, sparse 2, samples 256"),
    "5 squares": (lambda: assemble(row(5, (12, 12), springs(Gamma, 0.4), "quadrilateral", (1, 0.3))),
                  "chaos 1, chaos 4, tensor 3, sparse 2, samples 64, samples 512"),
    "4 squares, stiff layers": (
        lambda: assemble(row(4, (20, 20), springs(LogNormal, 0.5, 2e6), "quadrilateral", (1, 0.3))),
        "chaos 2, chaos 4, sparse 2, samples 128"),
    "9 squares": (lambda: assemble(row(9, (6, 6), springs(LogNormal, 0.3), "quadrilateral", (1, 0.3))),
                  "chaos 1, chaos 2, chaos 3, sparse 2, samples 512"),
    "2 squares, field of 10": (lambda: assemble(row(2, (30, 30), of_field(10), "quadrilateral", (1, 0.3))),
                               "chaos 1, chaos 2, chaos 3, sparse 2, samples 256"),
    "plate, field inside": (lambda: assemble(inside()), "chaos 1, chaos 2, sparse 1, samples 32"),
    "random moduli": (
        lambda: assemble(row(3, (16, 16), lambda k: Elastic(normal=2e4, tangential=1e4), "quadrilateral",
                             (1, 0.2), moduli)),
        "chaos 2, chaos 4, tensor 4, samples 64"),
    "random load": (
        lambda: assemble(row(2, (6,) * 3, lambda k: Elastic(normal=2e4, tangential=1e4), "hexahedron",
                             (Normal("p", 5.0, cov=0.2), 0.0, 0.0))),
        "chaos 2, tensor 5, samples 64"),
    "vessel, coarse": (lambda: tradeoff.vessel(tradeoff.Mesh("coarse")),
                       "chaos 1, chaos 5, tensor 5, samples 64, samples 512"),
    "vessel, paper": (
        lambda: tradeoff.vessel(tradeoff.Mesh("paper")),
        "chaos 1, chaos 3, tensor 3, samples 64",
    ),
    "vessel, field of 6": (lambda: tradeoff.field_joint(tradeoff.Mesh("coarse")),
                           "chaos 1, chaos 2, chaos 3, sparse 2, samples 64"),
    "contact, random gaps": (lambda: assemble(gaps()), "chaos 2, chaos 4, tensor 4, samples 64"),
    "contact, random friction": (
        lambda: assemble(row(2, (5,) * 3, lambda k: Contact(friction=Uniform("mu", 0.2, 0.4)), "hexahedron",
                             (-5.0, 1.0, 0.0))),
        "chaos 2, chaos 4, tensor 4, tensor 8, samples 64"),
    "lap joint, friction, 2 times": (lambda: tradeoff.lap(tradeoff.Mesh("coarse", 2, "facets")),
                                     "chaos 1, chaos 2, tensor 2, tensor 3, samples 16"),
    # constants of the prices were not fitted to these
    "3 tetrahedral cubes": (
        lambda: assemble(row(3, (7,) * 3, springs(Gamma, 0.2), "tetrahedron", (1, 0.3, 0))),
        "chaos 2, chaos 4, sparse 2, samples 128"),
    "2 cubes of degree 1": (
        lambda: assemble(row(2, (12,) * 3, springs(LogNormal, 0.4), "hexahedron", (1, 0.3, 0), degree=1)),
        "chaos 2, chaos 5, tensor 4, samples 128"),
    "thin plates": (
        lambda: assemble(row(3, (14, 14, 2), springs(LogNormal, 0.3), "hexahedron", (1, 0.3, 0))),
        "chaos 2, chaos 4, sparse 2, samples 64"),
    "6 triangulated squares": (
        lambda: assemble(row(6, (10, 10), springs(LogNormal, 0.5), "triangle", (1, 0.3), degree=3)),
        "chaos 1, chaos 3, sparse 2, samples 256"),
    "cubes, field of 15": (lambda: assemble(row(2, (5,) * 3, of_field(15), "hexahedron", (1, 0.3, 0))),
                           "chaos 1, chaos 2, sparse 1, samples 128"),
    "squares, random gap and friction": (
        lambda: assemble(row(2, (16, 16), lambda k: Contact(gap=0.0, friction=Uniform("mu", 0.3, 0.5)),
                             "quadrilateral", (-5.0, 0.5))),
        "chaos 3, tensor 5, samples 64"),
}
TIMES = {"lap joint, friction, 2 times": (1.0, 2.0)}


# %% Runs


def run(problem: Problem, way: str, times: Any) -> Any:
    """A way by its name."""
    kind, _, number = way.partition(" ")
    n = int(number)
    options = Options(rtol=1e-4, max_iterations=3000)
    more: dict[str, Any] = {"options": options, "progress": False}
    if times is not None:
        more["times"] = times
    if kind == "chaos":
        return lf.solve(problem, chaos=lf.Chaos(order=n, check_points=0), **more)
    ways = {"tensor": lf.tensor_quadrature, "sparse": lf.sparse_quadrature, "samples": lf.quasi_monte_carlo}
    return ways[kind](problem, n, **more)


def _status(key: str) -> float:
    text = Path("/proc/self/status").read_text(encoding="ascii")
    return 1024.0 * float(next(line.split()[1] for line in text.splitlines() if line.startswith(key)))


def measured(call: Callable[[], Any]) -> tuple[Any, dict[str, float]]:
    """What a call returns, its processor time, and the peak of the memory over what there was."""
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    before, began = _status("VmRSS:"), process_time()
    result = call()
    return result, {"seconds": process_time() - began, "memory": _status("VmHWM:") - before}


def apart(call: Callable[[], Any]) -> Any:
    """What a call returns (as JSON has it) in a process of its own."""
    read, write = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of forks beside the threads of libraries
        child = os.fork()
    if child == 0:
        os.close(read)
        try:
            text = json.dumps(call())
        except Exception as error:  # pylint: disable=broad-except
            text = json.dumps({"failed": f"{type(error).__name__}: {error}"})
        with os.fdopen(write, "w", encoding="utf-8") as pipe:
            pipe.write(text)
        os._exit(0)
    os.close(write)
    with os.fdopen(read, encoding="utf-8") as pipe:
        text = pipe.read()
    os.waitpid(child, 0)
    return json.loads(text) if text else {"failed": "it died"}


def unit(problem: Problem, times: Any) -> dict[str, float]:
    """A direct solve, or the factors of parts in contact."""
    if lf.make_plan(problem, times=times).active:
        return measured(lambda: Solver(problem, lf.make_plan(problem, times=times)))[1]
    return measured(lambda: lf.solve(problem, progress=False))[1]


def one(problem: Problem, way: str, times: Any) -> dict[str, Any]:
    """What a run took, and what its plan had said."""
    result, spent = measured(lambda: run(problem, way, times))
    said = result.plan.price
    assert said is not None
    return {**spent, "said_units": said.units, "said_seconds": said.seconds, "said_memory": said.memory}


def scene_runs(name: str) -> list[dict[str, Any]]:
    """All ways on a scene."""
    make, ways = SCENES[name]
    problem, times = make(), TIMES.get(name)
    of_unit = apart(lambda: unit(problem, times))
    runs = []
    for way in ways.split(", "):
        found = apart(lambda way=way: one(problem, way, times))  # type: ignore[misc]
        runs.append({"scene": name, "way": way, "unit": of_unit["seconds"], **found})
        _say(runs[-1])
    return runs


def _say(each: Mapping[str, Any]) -> None:
    if "failed" in each:
        print(each, flush=True)
        return
    units = each["seconds"] / each["unit"]
    print(
        f"{each['scene']:<33}{each['way']:<13}units {units:6.2f} said {each['said_units']:6.2f}"
        f"   s {each['seconds']:7.3f} said {each['said_seconds']:7.3f}"
        f"   MB {1e-6 * each['memory']:6.1f} said {1e-6 * each['said_memory']:6.1f}",
        flush=True,
    )


# %% Table


def off(runs: Sequence[Mapping[str, Any]], said: str, true: Callable[[Mapping[str, Any]], float]) -> float:
    """The largest factor between what was said and what was true."""
    ratios = np.array([each[said] / true(each) for each in runs])
    return float(np.exp(np.abs(np.log(ratios)).max()))


def table(runs: Sequence[Mapping[str, Any]]) -> str:
    """One row for each scene."""
    rows = []
    for name in dict.fromkeys(each["scene"] for each in runs):
        own = [each for each in runs if each["scene"] == name and "failed" not in each]
        units = [each["seconds"] / each["unit"] for each in own]
        megabytes = [1e-6 * each["memory"] for each in own]
        rows.append(
            [
                name,
                ", ".join(each["way"] for each in own),
                f"{min(units):.1f} .. {max(units):.1f}",
                f"{off(own, 'said_units', lambda e: e['seconds'] / e['unit']):.2f}",
                f"{off(own, 'said_seconds', lambda e: e['seconds']):.2f}",
                f"{min(megabytes):.0f} .. {max(megabytes):.0f} MB",
                f"{off(own, 'said_memory', lambda e: e['memory']):.2f}",
            ]
        )
    header = ["scene", "ways", "direct solves", "off by", "seconds off by", "memory", "off by"]
    return common.markdown_table(header, rows)


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = common.parser("plan", __doc__)
    parser.add_argument("--markdown", type=Path)
    parser.add_argument("--only", nargs="*", choices=list(SCENES), default=list(SCENES))
    given = parser.parse_args(arguments)
    warnings.simplefilter("ignore")
    runs = []
    for name in given.only:
        found = apart(lambda name=name: scene_runs(name))  # type: ignore[misc]
        if isinstance(found, dict):
            print(name, found, file=sys.stderr)
            continue
        runs += found
    text = table(runs)
    print(text)
    common.write_json({"environment": common.environment(), "runs": runs}, given.json)
    if given.markdown is not None:
        common.between_marks(given.markdown, "prices", text)


if __name__ == "__main__":
    main()
