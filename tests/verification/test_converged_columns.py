"""Converged means right in every column: mean and fluctuation of every part, and every step of a history."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import dolfinx_frontend as lf
from tests.verification.judged import Laws, Values, assert_right, connect, judged, row, square

STEEL = 2e5
SETTINGS: Any = pytest.mark.parametrize("newton", [{}, {"newton": 0}], ids=["default", "plain"])


@pytest.mark.parametrize("share", [1.0, 0.1])
@pytest.mark.parametrize("soft", [1e-1, 1e-3, 1e-5])
@pytest.mark.parametrize("rtol", [1e-2, 1e-3, 1e-4, 1e-6])
def test_a_soft_mount_beside_a_stiff_joint(rtol: float, soft: float, share: float) -> None:
    """Linear chaos: a random stiff joint carries 100, a random mount of `soft` E / L so much less."""
    variables = {
        "ka": lf.LogNormal("ka", 0.3 * STEEL, cov=0.2),
        "kb": lf.LogNormal("kb", soft * STEEL, cov=0.2),
    }

    def laws(a: Values, v: Values) -> Laws:
        return {
            "side_a": lf.Symmetry(),
            "side_b": lf.Symmetry(),
            "side_c": lf.Symmetry(),
            "foot": lf.Displacement(0.0),
            "joint": lf.Elastic(normal=v("ka"), tangential=0.3 * STEEL),
            "heavy": lf.Traction(np.array((5.0, 100.0))),
            "mount": lf.Elastic(normal=v("kb"), tangential=soft * STEEL),
            "light": lf.Traction(np.array((0.0, 100.0 * soft * share))),
        }

    def build(laws: Laws) -> lf.Scene:
        scene = lf.Scene()
        for name, x, y in (("a", 0.0, 0.0), ("b", 0.0, 1.0), ("c", 3.0, 0.0)):
            square(scene, name, x, y, STEEL, cells=3)
        faces = {f"side_{name}": [f"{name}:x0"] for name in "abc"}
        faces |= {"foot": ["a:y0"], "joint": ["a:y1", "b:y0"], "heavy": ["b:y1"]}
        return connect(scene, laws, faces | {"mount": ["c:y0"], "light": ["c:y1"]})

    options = lf.Options(rtol=rtol, max_iterations=3000)
    given = {"variables": variables, "random": ["joint", "mount"]}

    def run(problem: lf.Problem) -> Any:
        return lf.solve(problem, chaos=lf.Chaos(3), options=options)

    assert_right(judged("chaos", laws, build, run, rtol, **given))


@pytest.mark.parametrize("rtol", [1e-3, 1e-4, 1e-6])
@pytest.mark.parametrize("cov", [1e-1, 1e-2, 1e-3, 1e-4])
def test_a_small_scatter(cov: float, rtol: float) -> None:
    """Linear chaos: mean and fluctuation have the tolerance each, whatever the coefficient of variation."""
    variables = {"kn": lf.Normal("kn", STEEL, cov=cov), "kt": lf.Normal("kt", STEEL, cov=cov)}

    def laws(a: Values, v: Values) -> Laws:
        return {
            "foot": lf.Displacement(0.0),
            "joint": lf.Elastic(normal=v("kn"), tangential=v("kt")),
            "load": lf.Traction(np.array((50.0, 5.0, 100.0))),
        }

    def build(laws: Laws) -> lf.Scene:
        scene = lf.Scene()
        for k, name in enumerate("ab"):
            part = lf.geometry.box((1.0,) * 3, (2, 2, 2), origin=(0.0, 0.0, float(k)), cell="hexahedron")
            scene.substructure(name, part, lf.LinearElastic(STEEL, 0.3), degree=1)
        return connect(scene, laws, {"foot": ["a:z0"], "joint": ["a:z1", "b:z0"], "load": ["b:z1"]})

    options = lf.Options(rtol=rtol)
    given = {"variables": variables, "random": ["joint"]}

    def run(problem: lf.Problem) -> Any:
        return lf.solve(problem, chaos=lf.Chaos(2), options=options)

    assert_right(judged("chaos", laws, build, run, rtol, **given))


@pytest.mark.parametrize("direction", [None, 10.0, 30.0])
@pytest.mark.parametrize("rtol", [1e-1, 1e-2, 1e-4])
@pytest.mark.parametrize("moduli", [(2e5, 1.0, 1e3), (100.0, 100.0, 100.0)], ids=["unlike", "alike"])
def test_a_large_scatter(moduli: tuple[float, ...], rtol: float, direction: float | None) -> None:
    """Linear chaos of covariances of 1 and 0.8: the means are poor tangents of it."""
    variables = {"k0": lf.LogNormal("k0", 0.01, cov=1.0), "k1": lf.LogNormal("k1", 100.0, cov=0.8)}
    faces = {"wall": ["a:x0"], "j0": ["a:x1", "b:x0"], "j1": ["b:x1", "c:x0"], "pull": ["c:x1"]}

    def laws(a: Values, v: Values) -> Laws:
        beds = {f"bed_{name}": lf.Elastic(normal=0.1, tangential=0.1) for name in "bc"}
        return beds | {
            "wall": lf.Displacement(0.0),
            "j0": lf.Elastic(normal=v("k0"), tangential=0.01),
            "j1": lf.Elastic(normal=v("k1"), tangential=1.0),
            "pull": lf.Traction(np.array((1e-3, 2e-4))),
        }

    def build(laws: Laws) -> lf.Scene:
        scene = lf.Scene()
        for k, (name, E) in enumerate(zip("abc", moduli, strict=True)):
            square(scene, name, float(k), 0.0, E)
        return connect(scene, laws, faces | {f"bed_{name}": [f"{name}:y0"] for name in "bc"})

    def run(problem: lf.Problem) -> Any:
        given = {} if direction is None else {"direction": direction}
        return lf.solve(problem, chaos=lf.Chaos(2), options=lf.Options(rtol=rtol), **given)

    random = {"variables": variables, "random": ["j0", "j1"]}
    assert_right(judged("chaos", laws, build, run, rtol, **random))


@pytest.mark.parametrize("given", [{}, {"macro": "linear"}, {"newton": 0}], ids=["default", "macro", "plain"])
@pytest.mark.parametrize("rtol", [1e-1, 1e-2, 1e-4])
def test_shear_that_flips_in_every_step(rtol: float, given: dict[str, Any]) -> None:
    """Tresca's law under reversing shear: an iteration may jump between the bounds of all points for ever."""
    scene = lf.Scene()
    sizes = {"a": ((7.3466, 10.0), (2, 2), 0.0, 25.0), "b": ((15.895, 10.0), (1, 3), 7.3466, 330.0)}
    for name, (size, cells, x, E) in sizes.items():
        part = lf.geometry.box(size, cells, origin=(x, 0.0))
        scene.substructure(name, part, lf.LinearElastic(E=E, nu=0.3), degree=2)
    scene.fix("a:x0")
    scene.interface("joint", "a:x1", "b:x0", lf.Contact(gap=0.0, threshold=0.002), space="facets")
    scene.interface("bed", "b:y0", lf.Elastic(normal=0.28, tangential=0.28))
    press = lf.Amplitude([0, 1], [0, 1]) * np.array([-0.025406, 0.0])
    shear = lf.Amplitude([1, 2, 3, 4], [0, 1, -1, 0.5]) * np.array([0.0, 0.0013])
    scene.traction("b:x1", press + shear)
    problem, times = lf.assemble(scene), np.linspace(0.5, 4.0, 8)
    exact = lf.solve(problem, times=times, options=lf.Options(rtol=1e-10))
    result = lf.solve(problem, times=times, options=lf.Options(rtol=rtol, **given))
    assert exact.converged and result.converged
    for name, part in problem.substructures.items():
        for u, found in zip(exact.displacements[name], result.displacements[name], strict=True):
            energy, away = (float(w @ (part.matrix @ w)) for w in (u, found - u))
            assert away <= (3.0 * min(rtol, max(result.error, 1e-9))) ** 2 * energy


TINY = lf.Amplitude([0.0, 1.0, 2.0, 3.0], [0.0, 1e-3, 1e-3, 1e-3])
LARGE = lf.Amplitude([1.0, 2.0, 3.0], [0.0, 1.0, 0.0])


@SETTINGS
@pytest.mark.parametrize("rtol", [1e-2, 1e-3, 1e-4, 1e-6])
def test_the_last_steps_of_a_history(rtol: float, newton: dict[str, int]) -> None:
    """Friction under a load that begins and ends at a thousandth of its peak.

    Averages over facets have one answer. Points have several here: the two of a linear edge share its nodes,
    and friction then depends on how they share a pressure.
    """

    def laws(a: Values, v: Values) -> Laws:
        pressed, sheared = np.array((0.0, -20.0)), np.array((10.0, 0.0))
        return {
            "foot": lf.Displacement(0.0),
            "joint": lf.Contact(friction=0.3),
            "guide": lf.Elastic(normal=0.01 * STEEL, tangential=0.002 * STEEL),
            "press": lf.Traction(a(0) * pressed + a(1) * pressed),
            "shear": lf.Traction(a(0) * sheared + a(1) * sheared),
        }

    def build(laws: Laws) -> lf.Scene:
        scene = lf.Scene()
        for k, name in enumerate("ab"):
            part = lf.geometry.box((2.0, 1.0), (8, 4), origin=(0.0, float(k)))
            scene.substructure(name, part, lf.LinearElastic(STEEL, 0.3), degree=1)
        faces = {"foot": ["a:y0"], "joint": ["a:y1", "b:y0"], "guide": ["b:y1"]}
        return connect(scene, laws, faces | {"press": ["b:y1"], "shear": ["b:x1"]}, joint="facets")

    times = np.linspace(0.25, 3.0, 12)
    options = lf.Options(rtol=rtol, max_iterations=3000, **newton)
    run = {"amplitudes": [TINY, LARGE], "times": list(times)}
    found = judged("history", laws, build, lambda p: lf.solve(p, times=times, options=options), rtol, **run)
    assert_right(found)


ROWS: Any = pytest.mark.parametrize(("parts", "bed"), [(2, 0.0), (3, 1.0), (4, 1.0)])


def row_laws(parts: int, bed: float, grip: Any, stiffness: Any = lambda k: 50.0) -> Laws:
    laws: dict[str, Any] = {"wall": lf.Displacement(0.0), "grip": lf.Displacement(grip, components=0)}
    for k in range(1, parts):
        laws[f"j{k}"] = lf.Elastic(normal=stiffness(k), tangential=50.0)
        if bed:
            laws[f"bed{k}"] = lf.Elastic(normal=bed, tangential=bed)
    return laws


@pytest.mark.parametrize("rtol", [1e-2, 1e-4, 1e-6])
@ROWS
def test_a_random_displacement(parts: int, bed: float, rtol: float) -> None:
    """Only the grip is random, so only it is kept."""
    options, variables = lf.Options(rtol=rtol), {"u": lf.Normal("u", 0.01, cov=0.1)}

    def laws(a: Values, v: Values) -> Laws:
        return row_laws(parts, bed, v("u"))

    run = {"variables": variables, "random": ["grip"]}
    build = row(parts, bed)
    assert_right(judged("chaos", laws, build, lambda p: lf.solve(p, chaos=2, options=options), rtol, **run))


@pytest.mark.parametrize("rtol", [1e-2, 1e-3, 1e-6])
@ROWS
def test_a_swept_displacement(parts: int, bed: float, rtol: float) -> None:
    options, grid = lf.Options(rtol=rtol), {"grip.value": [0.01, 0.02]}

    def laws(a: Values, v: Values) -> Laws:
        return row_laws(parts, bed, v("grip.value"))

    def run(problem: lf.Problem) -> Any:
        return lf.sweep(problem, grid, options=options, keep_states=True, progress=False)

    assert_right(judged("sweep", laws, row(parts, bed), run, rtol, grid=grid, random=["grip"]))


@pytest.mark.parametrize("rtol", [1e-2, 1e-4, 1e-6])
@ROWS
def test_a_displacement_beside_random_springs(parts: int, bed: float, rtol: float) -> None:
    """The grip is kept because it is asked for."""
    options = lf.Options(rtol=rtol)
    variables = {f"k{k}": lf.LogNormal(f"k{k}", 50.0, cov=0.2) for k in range(1, min(parts, 3))}

    def laws(a: Values, v: Values) -> Laws:
        return row_laws(parts, bed, 0.01, lambda k: v(f"k{k}") if f"k{k}" in variables else 50.0)

    def run(problem: lf.Problem) -> Any:
        return lf.solve(problem, chaos=2, active=["grip"], options=options)

    random = {"variables": variables, "random": [f"j{k}" for k in range(1, min(parts, 3))]}
    assert_right(judged("chaos", laws, row(parts, bed), run, rtol, **random))
