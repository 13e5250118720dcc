"""Random fields of stiffness inside parts, against closed forms, samples and monolithic SSFEM."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import dolfinx.fem as fem
import numpy as np
import pytest
from scipy.integrate import quad

import dolfinx_frontend as lf
from dolfinx_frontend import geometry
from dolfinx_frontend.reference.galerkin import ssfem
from latin_core import Options

LENGTH, FORCE, COV = 10.0, 0.1, 0.3
TIGHT = Options(rtol=1e-10)


def rod(field: Any, cells: int = 40) -> lf.Problem:
    """A rod along x with the section 1, pulled at its end; nu = 0."""
    scene = lf.Scene()
    part = geometry.box((LENGTH, 1, 1), (cells, 1, 1))
    scene.substructure("rod", part, lf.LinearElastic(field, 0.0), degree=1)
    scene.symmetry(["rod:x0", "rod:y0", "rod:z0"])
    scene.force("rod:x1", (FORCE, 0, 0), name="pull")
    return lf.assemble(scene)


def lognormal(length: float, **modes: Any) -> lf.RandomField:
    return lf.RandomField("E", 2.0, cov=COV, length=length, distribution="lognormal", **modes)


def end_of_rod(relative_length: float) -> tuple[float, float]:
    """Mean and deviation of the end of a rod with exp(-|dx| / l), in F L / E A.

    1 / E is lognormal with the mean 1 + cov^2 and the covariance (1 + cov^2)^2 ((1 + cov^2)^exp(-r) - 1).
    """
    both, _ = quad(lambda r: 2.0 * (1.0 - r) * ((1.0 + COV**2) ** math.exp(-r / relative_length) - 1.0), 0, 1)
    return 1.0 + COV**2, (1.0 + COV**2) * math.sqrt(both)


def test_a_rod_with_a_lognormal_modulus() -> None:
    """Mean and deviation of its end within 0.5 %: by chaos for l = L / 2, by samples for l = L / 10."""
    assert end_of_rod(0.5) == pytest.approx((1.09, 0.244586), abs=5e-7)
    assert end_of_rod(0.1) == pytest.approx((1.09, 0.137322), abs=5e-7)
    unit = FORCE * LENGTH / 2.0
    problem = rod(lognormal(0.5 * LENGTH, variance_captured=0.95), 30)
    end = lf.AtPoint(problem, "rod", (LENGTH, 0.0, 0.0), component="x")
    chaos = lf.solve(problem, chaos=3)
    found, (mean, deviation) = chaos.quantity(end), end_of_rod(0.5)
    assert found.mean().value == pytest.approx(mean * unit, rel=5e-3)
    assert found.std().value == pytest.approx(deviation * unit, rel=5e-3)
    # what the modes lose is named, by the plan and with the errors
    lost = chaos.random.lost["E"]
    assert 0.02 < lost < 0.05
    assert f"lose {100 * lost:.3g} % of its variance" in str(chaos.plan)
    assert f"random field 'E': its modes lose {100 * lost:.3g} %" in str(chaos.errors())
    # the mean of 1 / E at a point is exp(variance that is left): less by what is lost
    fewer = (1.0 + COV**2) ** (1.0 - lost)
    assert found.mean().value == pytest.approx(fewer * unit, rel=1e-3)

    problem = rod(lognormal(0.1 * LENGTH, variance_captured=0.97), 60)
    end = lf.AtPoint(problem, "rod", (LENGTH, 0.0, 0.0), component="x")
    samples = lf.quasi_monte_carlo(problem, 2048, keep_states=True, progress=False)
    found, (mean, deviation) = samples.quantity(end), end_of_rod(0.1)
    assert found.mean().value == pytest.approx(mean * unit, rel=5e-3)
    assert found.std().value == pytest.approx(deviation * unit, rel=5e-3)
    lost = samples.random.lost["E"]
    assert f"lose {100 * lost:.3g} %" in str(samples.plan) and lost < 0.03


def test_the_stress_of_a_rod_is_not_random() -> None:
    """It is statically determinate: F / A in every cell, whatever its modulus."""
    problem = rod(lognormal(0.5 * LENGTH, modes=3), 12)
    chaos = lf.solve(problem, chaos=2)
    stress = chaos.stress("rod").x.array.reshape(-1, 9)[:, 0]
    assert stress == pytest.approx(FORCE, rel=1e-9)
    assert np.abs(chaos.std("rod", of="stress").x.array).max() < 1e-9
    germs = chaos.space.sample(5, 0)
    samples = lf.sample(problem, germs, keep_states=True, progress=False)
    probe = lf.AtPoint(problem, "rod", (2.3, 0.5, 0.5), "stress", "xx")
    assert samples.quantity(probe).values == pytest.approx(FORCE, rel=1e-9)
    assert samples.stress("rod").x.array.reshape(-1, 9)[:, 0] == pytest.approx(FORCE, rel=1e-9)
    name = next(n for n in problem.interfaces if "x0" in n)
    assert samples.quantity(samples.reaction(name, "x")).values == pytest.approx(-FORCE, rel=1e-9)
    assert chaos.at(germs).displacement("rod") == pytest.approx(
        next(samples.blocks()).displacement("rod"), rel=0.1
    )


def beam(
    field: Any,
    law: Any,
    other: Any = 2e3,
    cell: str = "hexahedron",
    degree: int = 1,
    moved: tuple[float, ...] = (0.0, 0.0, 0.0),
) -> lf.Scene:
    """Two blocks, one of them with a field, that are bent, heated and displaced."""
    scene = lf.Scene()
    for k, modulus in enumerate((field, other)):
        box = geometry.box((3, 2, 2), (3, 1, 1), origin=(3 * k, 0, 0), cell=cell)
        scene.substructure("ab"[k], box, lf.LinearElastic(modulus, 0.3, alpha=1e-4), degree=degree)
    scene.interface("joint", "a:x1", "b:x0", law)
    scene.fix("a:x0", moved, name="foot")
    return scene


E_A = lf.RandomField("E", 1e3, cov=COV, length=(2.0, 3.0, 3.0), modes=3, distribution="lognormal")


@pytest.mark.parametrize(
    ("law", "cell", "degree"),
    [
        (lf.Perfect(), "tetrahedron", 2),
        (lf.Elastic(normal=lf.Gamma("k", 3000.0, cov=0.2), tangential=1000.0), "hexahedron", 1),
    ],
)
def test_chaos_is_ssfem(law: Any, cell: str, degree: int) -> None:
    """With a random temperature, body forces, and prescribed displacements: one Galerkin solution."""
    scene = beam(E_A, law, cell=cell, degree=degree, moved=(0.01, 0.0, -0.02))
    scene.temperature("a", lf.Normal("dT", 100.0, cov=0.1), name="heat")
    scene.body_force("a", (0.0, 0.0, -1.0), name="weight")
    scene.rigid("b:x1", x=0.02, name="head")
    problem = lf.assemble(scene)
    chaos = lf.solve(problem, chaos=lf.Chaos(order=2), options=TIGHT)
    assert chaos.plan.fields == ("a",) and chaos.plan.active == (() if degree == 2 else ("joint",))
    for solver in ("cg", "direct"):
        exact = ssfem(problem, lf.Chaos(order=2), solver=solver)
        for part in "ab":
            expected = exact.coefficients[part]
            assert chaos.coefficients(part) == pytest.approx(expected, abs=2e-8 * np.abs(expected).max())
    germs = chaos.space.sample(3, 1)
    samples = lf.sample(problem, germs, options=TIGHT, keep_states=True, progress=False)
    finer = lf.solve(problem, chaos=lf.Chaos(order=5), options=TIGHT)
    for probe in (
        lf.AtPoint(problem, "b", (6.0, 1.0, 1.0), component="z"),
        lf.AtPoint(problem, "a", (1.5, 1.0, 1.0), "stress", "xx"),
    ):
        assert probe(finer.at(germs)) == pytest.approx(samples.quantity(probe).values, rel=2e-2)


SPRING = lf.Elastic(normal=3e3, tangential=1e3)


@pytest.mark.parametrize("law", [lf.Perfect(), lf.Contact(friction=0.3), SPRING])
def test_samples_are_solutions_with_that_modulus(law: Any) -> None:
    """Free of anything that the field is made of: the same scene with the modulus of a sample in cells."""

    def heated(modulus: Any) -> lf.Problem:
        scene = beam(modulus, law)
        scene.temperature("a", lambda x: 20.0 * x[:, 0], name="heat")
        scene.body_force("b", (0.0, 0.0, -1.0), name="weight")
        scene.fix("b:x1", (-0.02, 0.0, 0.01), name="head")
        return lf.assemble(scene)

    problem = heated(E_A)
    germs = np.array([[-1.5, 0.5, 1.0], [0.0, 0.0, 0.0], [2.0, -1.0, 0.3]])
    samples = lf.sample(problem, germs, options=TIGHT, keep_states=True, progress=False)
    reactions = samples.quantity(samples.reaction("foot", "x")).values
    probe = lf.AtPoint(problem, "a", (1.2, 1.0, 1.0), "stress", "xx")
    stresses = samples.quantity(probe).values
    moduli = 1e3 * samples.random.factors("a", germs)
    block = next(samples.blocks())
    for n in range(len(germs)):
        mesh = problem.substructures["a"].part.mesh
        modulus = fem.Function(fem.functionspace(mesh, ("DG", 0)))
        modulus.x.array[:] = moduli[n]
        scene = lf.Scene()
        for name in "ab":
            part = problem.substructures[name].part
            scene.substructure(
                name, part, lf.LinearElastic(modulus if name == "a" else 2e3, 0.3, alpha=1e-4), degree=1
            )
        scene.interface("joint", "a:x1", "b:x0", law)
        scene.fix("a:x0", name="foot")
        scene.temperature("a", lambda x: 20.0 * x[:, 0], name="heat")
        scene.body_force("b", (0.0, 0.0, -1.0), name="weight")
        scene.fix("b:x1", (-0.02, 0.0, 0.01), name="head")
        alone = lf.assemble(scene)
        expected = lf.solve(alone, options=TIGHT)
        for part in "ab":
            size = np.abs(expected.unknowns(part)).max()
            assert block.displacement(part)[n] == pytest.approx(expected.unknowns(part), abs=1e-7 * size)
        reaction = expected.quantity(expected.reaction("foot", "x")).values[0]
        assert reactions[n] == pytest.approx(reaction, rel=1e-6)
        there = lf.AtPoint(alone, "a", (1.2, 1.0, 1.0), "stress", "xx")
        assert stresses[n] == pytest.approx(expected.quantity(there).values[0], rel=1e-6)


def test_histories_and_contact() -> None:
    """A history of a linear scene is its load times the amplitude; a chaos with contact meets its samples."""
    scene = beam(E_A, lf.Elastic(normal=3e3, tangential=1e3))
    scene.force("b:x1", (0.0, 0.0, 1.0), name="push")
    once = lf.solve(lf.assemble(scene), chaos=2, options=TIGHT)
    scene = beam(E_A, lf.Elastic(normal=3e3, tangential=1e3))
    ramp = lf.Amplitude((0.0, 1.0, 2.0), (0.0, 1.0, 0.5))
    scene.traction("b:x1", ramp * (0.0, 0.0, 0.25), name="push")
    history = lf.solve(lf.assemble(scene), chaos=2, times=[0.0, 1.0, 2.0], options=TIGHT)
    late = history.coefficients("b")
    assert late[0] == pytest.approx(0.0, abs=1e-12)
    assert late[2] == pytest.approx(0.5 * late[1], rel=1e-7, abs=1e-9 * np.abs(late).max())
    assert np.abs(late[1, :, 0]).max() == pytest.approx(np.abs(once.coefficients("b")[:, 0]).max(), rel=0.05)

    scene = beam(E_A, lf.Contact())
    scene.fix("b:x1", (-0.02, 0.0, 0.0), name="head")
    problem = lf.assemble(scene)
    chaos = lf.solve(problem, chaos=lf.Chaos(order=3, check_points=8, tolerance=0.05))
    assert chaos.trusted and chaos.plan.active == ("joint",)


def test_bad_fields(tmp_path: Path) -> None:
    normal = lf.RandomField("E", 1e3, cov=0.5, length=3.0, modes=2)
    scene = beam(normal, lf.Perfect())
    scene.force("b:x1", (0.0, 0.0, 1.0))
    problem = lf.assemble(scene)
    indefinite = r"substructure 'a', random field 'E'.* is indefinite, smallest eig.*lognormal"
    with pytest.raises(lf.SceneError, match=indefinite):
        lf.solve(problem, chaos=4)
    with pytest.raises(lf.SceneError, match="operator is not positive definite.*'a'"):
        ssfem(problem, lf.Chaos(4))
    negative = r"substructure 'a': 1 of 2 samples .*smallest factor -.*E\[0\] = -9"
    with pytest.raises(lf.SceneError, match=negative):
        lf.sample(problem, np.array([[0.0, 0.0], [-9.0, 0.0]]), progress=False)
    with pytest.raises(lf.SceneError, match="export: the stiffness of 'a' varies"):
        problem.export(tmp_path / "folder", chaos=1)
    chaos = lf.solve(problem, chaos=1)
    assert chaos.errors().discretisation is None
    chaos.save(tmp_path / "field.h5")
    with pytest.raises(lf.SceneError, match="random stiffness.*compute stresses before save"):
        lf.load(tmp_path / "field.h5").stress("a")
    with pytest.raises(lf.SceneError, match="mean = -2"):
        lf.LinearElastic(lf.RandomField("E", -2.0, std=0.1), 0.3)
    with pytest.raises(lf.SceneError, match="substructure 'b': the random field 'E' is that of 'a', too"):
        lf.solve(lf.assemble(beam(E_A, lf.Perfect(), E_A)), chaos=1)
    with pytest.raises(lf.SceneError, match="substructure 'a'.*degree 1 and 2; it has 3"):
        lf.solve(lf.assemble(beam(E_A, lf.Perfect(), degree=3)), chaos=1)
    with pytest.raises(lf.SceneError, match="mean 2: a factor of a part has the mean 1"):
        lf.Scene().substructure(
            "a",
            geometry.box((1, 1, 1), (1, 1, 1)),
            lf.LinearElastic(1.0, 0.0),
            stiffness=lf.RandomField("f", 2.0, cov=0.1),
        )
