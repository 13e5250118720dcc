"""Small scenes that the campaign's judge looks at: is an answer that says ``converged`` right everywhere?

The judge compares with an assembled reference that is not the kernel, in every part, at every step, point
and sample, for mean and fluctuation apart, in the energy norm and in the displacement of the faces. Right is
what is off by at most three tolerances and by at most three times what the result says; forces balance and
hold the laws. What rounding of double precision explains is no error.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import dolfinx_frontend as lf

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

from campaign import judge, measure, scenes  # noqa: E402

__all__ = ["assert_right", "connect", "judged", "measure", "row", "square"]

Values = Callable[[Any], Any]
"""Amplitudes by their number, or values by their name: themselves, or what they are at a time or a point."""
Laws = Mapping[str, Any]


def square(scene: lf.Scene, name: str, x: float, y: float, E: float = 100.0, cells: int = 2) -> None:
    """A unit square with its lower left corner at (x, y), cells x cells quadrilaterals of degree 1."""
    part = lf.geometry.box((1.0, 1.0), (cells, cells), origin=(x, y))
    scene.substructure(name, part, lf.LinearElastic(E=E, nu=0.3), degree=1)


def connect(scene: lf.Scene, laws: Laws, faces: Mapping[str, Sequence[str]], **given: str) -> lf.Scene:
    """The scene with interfaces of these names, faces and laws; the space of some may be given."""
    for name, where in faces.items():
        space = {"space": given[name]} if name in given else {}
        scene.interface(name, *where, laws[name], **space)
    return scene


def row(parts: int, bed: float) -> Callable[[Laws], lf.Scene]:
    """Laws of wall, grip, j1, ... and bed1, ... -> squares b0, b1, ... in a row, beds under all but b0."""

    def build(laws: Laws) -> lf.Scene:
        scene = lf.Scene()
        faces = {"wall": ["b0:x0"]}
        for k in range(parts):
            square(scene, f"b{k}", float(k), 0.0)
        for k in range(1, parts):
            faces[f"j{k}"] = [f"b{k - 1}:x1", f"b{k}:x0"]
            if bed:
                faces[f"bed{k}"] = [f"b{k}:y0"]
        faces["grip"] = [f"b{parts - 1}:x1"]
        return connect(scene, laws, faces)

    return build


def judged(
    kind: str,
    laws: Laws | Callable[[Values, Values], Laws],
    build: Callable[[Laws], lf.Scene],
    run: Callable[[Any], Any],
    rtol: float,
    amplitudes: Sequence[lf.Amplitude] = (),
    times: Sequence[float] | None = None,
    variables: Mapping[str, Any] | None = None,
    grid: Mapping[str, Sequence[float]] | None = None,
    random: Sequence[str] = (),
) -> judge.Verdict:
    """What the judge says of a run.

    Parameters
    ----------
    kind
        ``static``, ``history``, ``chaos``, ``samples`` or ``sweep``.
    laws
        Interface -> law; or a function of the amplitudes and of the random or swept values that returns it.
    build
        Laws -> scene.
    run
        Problem -> result.
    rtol
        The tolerance that the run is given.
    grid
        Values of a sweep, as :func:`dolfinx_frontend.sweep` takes them.
    random
        Interfaces with values that are random or swept.
    """
    given: Callable[[Values, Values], Laws] = laws if callable(laws) else lambda a, v: laws
    space = {
        "laws": given,
        "build": lambda a, v: build(given(a, v)),
        "run": run,
        "AMPLITUDES": list(amplitudes),
        "TIMES": None if times is None else list(times),
        "VARIABLES": dict(variables or {}),
        "GRID": {name: list(values) for name, values in (grid or {}).items()},
        "RANDOM": list(random),
    }
    return judge.one(scenes.Scene(0, "", kind, "", rtol, 1, ""), space=space)


def assert_right(found: judge.Verdict) -> None:
    """It converged and is right everywhere; or did not converge where rounding is above the tolerance."""
    told = "; ".join([found.what, *found.errors])
    assert found.outcome in ("right", "rounding"), f"{found.outcome}, {found.iterations} iterations: {told}"
