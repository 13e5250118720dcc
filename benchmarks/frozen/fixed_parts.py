"""What the scenes of ``fixed_*.py`` are made of: rows of bars, blocks on each other, laws in closed form."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import dolfinx_frontend as lf
import numpy as np
from scipy import integrate, stats

from frozen.registry import Right

LENGTH, HEIGHT, FORCE = 10.0, 4.0, 10.0
CLOSED = "closed form"
STEEL = 2e5


class Known(NamedTuple):
    """Mean and deviation that are known."""

    mean: float
    std: float | None = None


def right(accuracy: float, source: str = CLOSED, **known: Known) -> dict[str, Right]:
    """Right values of answers of :func:`asked` by their names; ``whole`` for an answer alone."""
    out = {}
    for name, values in known.items():
        key = "" if name == "whole" else f"{name}."
        for what, value in values._asdict().items():
            if value is not None:
                out[f"{key}errors.{what}"] = Right(value, accuracy, source)
    return out


def asked(problem: Any, accuracy: float, quantity: Any = None, **settings: Any) -> dict[str, Any]:
    """What an accuracy gives: mean, deviation and errors by their sources."""
    if isinstance(problem, lf.Problem):
        settings.setdefault("meshes", False)
    result = lf.solve(problem, accuracy=accuracy, quantity=quantity, progress=False, **settings)
    made = result.errors()
    return {"errors": made, "reached": bool(made.reached), "status": str(result.status)}


def within(value: float, error: float) -> lf.Estimate:
    """A number that may be off by an error: of a later state, too."""
    value = float(value)
    return lf.Estimate(value=value, low=value - error, high=value + error, level=1.0)


def beyond(value: float, limit: float) -> float:
    """Zero where a difference is within its limit: below it there is rounding, which any change changes."""
    return value if not value <= limit else 0.0


def options(rtol: float, **settings: Any) -> lf.Options:
    """Of a scene that may take many iterations."""
    return lf.Options(rtol=rtol, **{"max_iterations": 3000, **settings})


def refusal(call: Any) -> str:
    """The kind of the exception that a call raises."""
    try:
        call()
    except (lf.SceneError, ValueError, ArithmeticError, RuntimeError) as error:
        return type(error).__name__
    return "none"


def box(
    scene: lf.Scene,
    name: str,
    size: Sequence[float],
    cells: Sequence[int],
    at: Sequence[float],
    material: Any,
    degree: int = 1,
    cell: str | None = None,
) -> None:
    """A box of its name in a scene."""
    given = {} if cell is None else {"cell": cell}
    part = lf.geometry.box(tuple(size), tuple(cells), origin=tuple(at), **given)
    scene.substructure(name, part, material, degree=degree)


def row(count: int, young: float, cells: tuple[int, int] = (2, 2)) -> lf.Scene:
    """Bars b0, b1, ... end to end, without lateral contraction."""
    scene = lf.Scene()
    for n in range(count):
        box(scene, f"b{n}", (LENGTH, HEIGHT), cells, (LENGTH * n, 0.0), lf.LinearElastic(young, 0.0))
    return scene


def layers(*stiffnesses: Any, young: float = 200.0, pulled: float | None = None) -> lf.Problem:
    """Bars in a row with layers between them, pulled by a force per area: u = FORCE (sum 1/k + L/E)."""
    scene = row(len(stiffnesses) + 1, young)
    for n, k in enumerate(stiffnesses):
        scene.interface(f"l{n}", f"b{n}:x1", f"b{n + 1}:x0", lf.Elastic(normal=k, tangential=10.0))
    scene.fix("b0:x0")
    last = f"b{len(stiffnesses)}:x1"
    if pulled is not None:
        scene.fix(last, (pulled, 0.0), name="grip")
    else:
        scene.traction(last, (FORCE, 0.0), name="load")
    return lf.assemble(scene)


def beside(means: Sequence[float], scale: float) -> lf.Problem:
    """Springs of gamma laws of one scale side by side between two stiff bars."""
    scene = row(2, 1e5)
    for n, mean in enumerate(means):
        law = lf.Elastic(normal=lf.Gamma(f"k{n}", mean, cov=np.sqrt(scale / mean)), tangential=30.0)
        scene.interface(f"l{n}", "b0:x1", "b1:x0", law)
    scene.fix("b0:x0")
    scene.traction("b1:x1", (FORCE, 0.0), name="load")
    return lf.assemble(scene)


MOVE = 0.01


def stop(*stiffnesses: Any, gap: Any, young: float = 1e5) -> lf.Problem:
    """Bars with layers between them, moved by MOVE towards a rigid stop behind a gap."""
    scene = row(len(stiffnesses) + 1, young)
    for n, k in enumerate(stiffnesses):
        scene.interface(f"l{n}", f"b{n}:x1", f"b{n + 1}:x0", lf.Elastic(normal=k, tangential=30.0))
    end = f"b{len(stiffnesses)}:x1"
    scene.fix("b0:x0", (MOVE, 0.0), name="grip")
    scene.interface("stop", end, lf.Contact(gap=gap))
    scene.fix(end, components=1)
    return lf.assemble(scene)


def stopped(law: Any, young: float) -> Known:
    """Force of one bar on the stop behind a gap of a law of scipy."""
    stiff, lowest = young * HEIGHT / LENGTH, law.ppf(1e-15)
    first, second = (
        integrate.quad(lambda g, n=n: (stiff * (MOVE - g)) ** n * law.pdf(g), lowest, MOVE, epsabs=0,
                       limit=400)[0]
        for n in (1, 2)
    )
    return Known(-first, float(np.sqrt(second - first**2)))


def stopped_behind(away: float, covs: Sequence[float], spread: float, young: float,
                   mean: float = 2e4) -> Known:
    """The same behind lognormal layers, a normal gap whose mean is `away` deviations beyond MOVE."""
    z, w = np.polynomial.hermite_e.hermegauss(60)
    w = w / w.sum()
    soft, weight = np.array([(len(covs) + 1) * LENGTH / young]), np.ones(1)
    for cov in covs:
        s = np.sqrt(np.log1p(cov**2))
        soft = (soft[:, None] + np.exp(-(s * z - 0.5 * s * s)) / mean).ravel()
        weight = (weight[:, None] * w).ravel()
    reach = [stats.norm.expect(lambda t, n=n: (t - away) ** n, lb=away, ub=12.0) for n in (1, 2)]
    first, second = HEIGHT * spread * (weight @ (1.0 / soft)), (HEIGHT * spread) ** 2 * (weight @ soft**-2.0)
    found = first * reach[0]
    return Known(-found, float(np.sqrt(second * reach[1] - found**2)))


def inverse_gamma(cov: float) -> tuple[float, float]:
    """Mean and variance of 1/x, x of Gamma's law with mean 1."""
    first = 1.0 / (1.0 - cov**2)
    return first, first / (1.0 - 2.0 * cov**2) - first**2


def inverse_lognormal(cov: float) -> tuple[float, float]:
    """The same of the lognormal law."""
    return 1.0 + cov**2, (cov * (1.0 + cov**2)) ** 2


def in_series(laws: Sequence[tuple[float, tuple[float, float]]], bars: int, young: float = 200.0) -> Known:
    """Jump at the load of layers in series: of each its scale, and mean and variance of the inverse."""
    mean = bars * LENGTH / young + sum(first / scale for scale, (first, _) in laws)
    return Known(-FORCE * mean, FORCE * float(np.sqrt(sum(v / scale**2 for scale, (_, v) in laws))))


def line(young: float = 1e9, **settings: Any) -> lf.Problem:
    """A layer with a random field between all but rigid bars, pulled by 1e-3."""
    field = lf.RandomField("k", mean=50.0, cov=0.3, length=5.0, distribution="lognormal", **settings)
    scene = lf.Scene()
    for name, y in (("lo", -2.0), ("up", 0.0)):
        box(scene, name, (LENGTH, 2.0), (40, 1), (0.0, y), lf.LinearElastic(young, 0.0))
    scene.interface("line", "lo:y1", "up:y0", lf.Elastic(normal=field, tangential=50.0))
    scene.fix("lo:y0")
    scene.fix("up:y1", (0.0, 1e-3), name="grip")
    return lf.assemble(scene)


def line_force() -> Known:
    """Of the whole field: std^2 = 2 int_0^L (L - t) C(t) dt."""
    s = np.log1p(0.09)
    whole = 2.0 * integrate.quad(lambda t: (LENGTH - t) * np.expm1(s * np.exp(-t / 5.0)), 0.0, LENGTH)[0]
    return Known(1e-3 * 50.0 * LENGTH, float(50.0 * 1e-3 * np.sqrt(whole)))


# -- squares ---------------------------------------------------------------------------------------
def square(scene: lf.Scene, name: str, x: float, y: float, E: float = 100.0, cells: int = 2) -> None:
    """A unit square with its lower left corner at (x, y)."""
    box(scene, name, (1.0, 1.0), (cells, cells), (x, y), lf.LinearElastic(E, 0.3))


def joined(scene: lf.Scene, laws: Mapping[str, Any], faces: Mapping[str, Sequence[str]],
           **space: str) -> lf.Problem:
    """The problem with interfaces of these names, faces and laws; the space of some is given."""
    for name, where in faces.items():
        scene.interface(name, *where, laws[name], **({"space": space[name]} if name in space else {}))
    return lf.assemble(scene)


def pair_and_light(ratio: float, gap: float, moduli: Any = (STEEL, STEEL, STEEL)) -> lf.Problem:
    """a and b are pressed together with friction; c is alone, flies through a gap and is pressed less."""
    made = lf.Scene()
    for modulus, name, x, y in zip(moduli, "abc", (0.0, 0.0, 3.0), (0.0, 1.0, 0.0), strict=True):
        square(made, name, x, y, modulus, cells=3)
    faces = {"side_a": ["a:x0"], "side_b": ["b:x0"], "side_c": ["c:x0"], "foot": ["a:y0"],
             "joint": ["a:y1", "b:y0"],
             "heavy": ["b:y1"], "stop": ["c:y0"], "light": ["c:y1"]}
    laws = {name: lf.Symmetry() for name in ("side_a", "side_b", "side_c")} | {
        "foot": lf.Displacement(0.0),
        "joint": lf.Contact(friction=0.2),
        "heavy": lf.Traction(np.array((5.0, -100.0))),
        "stop": lf.Contact(gap=gap),
        "light": lf.Traction(np.array((0.0, -100.0 * ratio))),
    }
    return joined(made, laws, faces)


def squares_in_a_row(parts: int, bed: float, joint: Any = None, grip: Any = None) -> lf.Problem:
    """Squares b0, b1, ... with springs between, beds under all but the first one, moved at the end."""
    scene = lf.Scene()
    for k in range(parts):
        square(scene, f"b{k}", float(k), 0.0)
    laws: dict[str, Any] = {"wall": lf.Displacement(0.0)}
    faces: dict[str, list[str]] = {"wall": ["b0:x0"]}
    for k in range(1, parts):
        laws[f"j{k}"] = joint(k) if joint else lf.Elastic(normal=50.0, tangential=50.0)
        faces[f"j{k}"] = [f"b{k - 1}:x1", f"b{k}:x0"]
        if bed:
            laws[f"bed{k}"], faces[f"bed{k}"] = lf.Elastic(normal=bed, tangential=bed), [f"b{k}:y0"]
    laws["grip"], faces["grip"] = grip or lf.Displacement((0.01, 0.02)), [f"b{parts - 1}:x1"]
    return joined(scene, laws, faces)
