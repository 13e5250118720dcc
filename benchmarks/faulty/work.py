"""What is disturbed: a sweep, a sampling, ``errors()`` and ``accuracy=``, each of a second or less."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import dolfinx_frontend as lf
from dolfinx_frontend import geometry
from latin_core import Options

RTOL = 1e-8
TIGHT = Options(rtol=RTOL)
GRID = {"layer.friction": [0.1, 0.2, 0.3, 0.5], "layer.stiffness": [50.0, 200.0, 800.0]}
SAMPLES = 12
WITHIN = 30.0 * RTOL
"""Difference of two runs: their errors add up, estimates are within 3 of them, norms differ by 5."""


def blocks(law: Any, comm: Any = None) -> lf.Problem:
    """Two blocks with a layer between them, pushed together and aside."""
    scene = lf.Scene()
    for rank, (name, x0) in enumerate((("left", 0.0), ("right", 1.0))):
        part = geometry.box((1.0, 1.0), (4, 4), origin=(x0, 0.0))
        material = lf.LinearElastic(E=100.0, nu=0.3)
        scene.substructure(name, part, material, degree=1, rank=rank if comm else None)
    # means over the facets: at points, forces that stick are not determined by the two blocks
    scene.interface("layer", "left:x1", "right:x0", law, space="facets")
    scene.fix("left:x0", name="wall")
    scene.interface("bed", "right:x1", lf.Elastic(normal=1.0, tangential=1.0))
    scene.traction("right:y1", (0.2, -0.1), name="push")
    scene.traction("right:x1", (-1.0, 0.2), name="pull")
    return lf.assemble(scene) if comm is None else lf.assemble(scene, comm=comm)


def rough() -> lf.Contact:
    return lf.Contact(friction=0.3, stiffness=200.0)


def soft() -> lf.Elastic:
    return lf.Elastic(normal=lf.LogNormal("k", 30.0, cov=0.3), tangential=lf.Uniform("t", 5.0, 15.0))


def loose() -> lf.Contact:
    return lf.Contact(friction=0.3, stiffness=lf.LogNormal("k", 200.0, cov=0.2))


@dataclass(frozen=True)
class Work:
    """One kind of computation.

    Attributes
    ----------
    build
        Makes the objects that are there before.
    run
        Computes with them; the path is that of a checkpoint.
    numbers
        What came out, name -> array.
    before
        What the objects answer, before as after.
    checkpoint
        Whether a run goes on from a file; the answers agree to the solver's tolerance then, else to the bit.
    """

    build: Callable[[], Any]
    run: Callable[[Any, Path], Any]
    numbers: Callable[[Any], dict[str, np.ndarray]]
    before: Callable[[Any], dict[str, np.ndarray]]
    checkpoint: bool


def _points(answer: Any) -> dict[str, np.ndarray]:
    return {"force": np.array(answer.force("layer")), "jump": np.array(answer.jump("layer"))}


def _solved(law: Callable[[], Any]) -> Callable[[], Any]:
    def build() -> Any:
        problem = blocks(law())
        return problem, lf.solve(problem, options=TIGHT)

    return build


def _of_result(objects: Any) -> dict[str, np.ndarray]:
    problem, result = objects
    again = lf.solve(problem, options=TIGHT)
    out = {f"again {name}": np.array(u) for name, u in again.displacements.items()}
    out |= {f"result {name}": np.array(u) for name, u in result.displacements.items()}
    return out | {"force": np.array(result.force("layer")), "again force": np.array(again.force("layer"))}


def _chaos() -> Any:
    problem = blocks(soft())
    return problem, lf.solve(problem, chaos=2, options=Options(rtol=1e-4))


def _of_chaos(objects: Any) -> dict[str, np.ndarray]:
    _, result = objects
    return {
        "coefficients": np.array(result.force_coefficients("layer")),
        "sample": np.array(result.sample(np.zeros((1, 2))).force("layer")),
        "mean": np.array(result.force("layer")),
    }


def _shares(errors: Any) -> dict[str, np.ndarray]:
    shares = {name: getattr(errors, name) for name in ("algebraic", "truncation", "discretisation")}
    return {
        name: np.array([np.nan if v is None else v for v in (s.energy, s.quantity, s.std)], dtype=float)
        for name, s in shares.items()
        if s is not None
    }


def _asked(objects: Any, path: Path) -> Any:
    return lf.solve(objects[0], accuracy=1e-3, quantity="layer")


def _of_asked(result: Any) -> dict[str, np.ndarray]:
    return {"force": np.array(result.force_coefficients("layer"))}


WORK = {
    "sweep": Work(
        _solved(rough),
        lambda objects, path: lf.sweep(objects[0], GRID, options=TIGHT, checkpoint=path, progress=False),
        _points,
        _of_result,
        True,
    ),
    "sampling": Work(
        _solved(loose),
        lambda objects, path: lf.monte_carlo(
            objects[0], SAMPLES, seed=3, options=TIGHT, checkpoint=path, progress=False
        ),
        _points,
        _of_result,
        True,
    ),
    "errors": Work(_chaos, lambda objects, path: objects[1].errors("layer"), _shares, _of_chaos, False),
    "accuracy": Work(_chaos, _asked, _of_asked, _of_chaos, False),
}


def difference(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> float:
    """Largest relative difference; 0: the same bits, infinity: other names, shapes or places of NaN."""
    worst = 0.0
    if one.keys() != other.keys():
        return np.inf
    for name, values in one.items():
        against = other[name]
        if values.shape != against.shape or not np.array_equal(np.isnan(values), np.isnan(against)):
            return np.inf
        if not np.array_equal(values, against, equal_nan=True):
            size = float(np.linalg.norm(np.nan_to_num(against)))
            gap = float(np.linalg.norm(np.nan_to_num(values - against)))
            worst = max(worst, gap / size if size > 0.0 else np.inf, 1e-300)
    return worst
