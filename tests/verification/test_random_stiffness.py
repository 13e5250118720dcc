"""Random stiffness of parts, against closed forms, quadrature, samples and monolithic SSFEM."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dolfinx_frontend as lf
from dolfinx_frontend import geometry
from dolfinx_frontend.reference.galerkin import ssfem
from latin_core import Options

FORCE, AREA, LENGTH = 50.0, 2.0, 5.0
E1, E2 = lf.LogNormal("E1", 1e3, cov=0.2), lf.LogNormal("E2", 2e3, cov=0.3)
TIGHT = Options(rtol=1e-9)


def bars(first: Any, second: Any, law: Any = None, held: bool = False, **materials: Any) -> lf.Scene:
    """Two bars end to end along z, nu = 0, so that every displacement is that of a rod."""
    scene = lf.Scene()
    for number, (part, modulus) in enumerate((("a", first), ("b", second))):
        box = geometry.box((1, 2, LENGTH), (1, 1, 3), origin=(0, 0, LENGTH * number))
        scene.substructure(part, box, lf.LinearElastic(modulus, 0.0, alpha=1e-5), degree=1)
        scene.symmetry([f"{part}:x0", f"{part}:y0"])
    scene.interface("joint", "a:z1", "b:z0", lf.Perfect() if law is None else law)
    scene.fix("a:z0", name="foot", components=2)
    if held:
        scene.fix("b:z1", name="head", components=2)
    return scene


def pulled(*moduli: Any) -> lf.Problem:
    scene = bars(*moduli)
    scene.force("b:z1", (0.0, 0.0, FORCE), name="pull")
    return lf.assemble(scene)


def end(problem: lf.Problem, z: float = 2.0 * LENGTH) -> lf.AtPoint:
    return lf.AtPoint(problem, "b", (0.5, 1.0, z), component="z")


def inverse(parameter: Any) -> tuple[float, float]:
    """Mean and deviation of 1 / E of a lognormal E."""
    mean = (1.0 + parameter.cov**2) / parameter.mean
    return mean, mean * parameter.cov


def test_two_bars() -> None:
    """u = F L / A (1 / E1 + 1 / E2): mean and deviation to 1e-6 by quadrature and by chaos."""
    problem = pulled(E1, E2)
    assert problem.part_parameters == {"a.E": 1e3, "a.stiffness": 1.0, "b.E": 2e3, "b.stiffness": 1.0}
    scale = FORCE * LENGTH / AREA
    (m1, s1), (m2, s2) = inverse(E1), inverse(E2)
    mean, std = scale * (m1 + m2), scale * math.hypot(s1, s2)
    at_means = next(lf.solve(problem).blocks())
    assert end(problem)(at_means) == pytest.approx(scale * (1e-3 + 0.5e-3), rel=1e-8)
    rule = lf.tensor_quadrature(problem, 12, options=TIGHT, keep_states=True, progress=False)
    found = rule.quantity(end(problem))
    weights = rule.weights
    values = found.values
    assert weights @ values == pytest.approx(mean, rel=1e-6)
    assert math.sqrt(weights @ (values - mean) ** 2) == pytest.approx(std, rel=1e-6)
    xi = rule.germs
    exact = scale * (1.0 / rule.space.values(E1, xi) + 1.0 / rule.space.values(E2, xi))
    assert values == pytest.approx(exact, rel=1e-6)
    chaos = lf.solve(problem, chaos=lf.Chaos(order=9), options=TIGHT)
    assert "stiffness factors" in str(chaos.plan) and chaos.plan.active == ("joint",)
    node = np.argmax(problem.substructures["b"].dof_coordinates[:, 2])
    modes = chaos.coefficients("b").reshape(-1, 3, len(chaos.basis))[node, 2]
    assert modes[0] == pytest.approx(mean, rel=1e-6)
    assert np.linalg.norm(modes[1:]) == pytest.approx(std, rel=1e-6)


def test_chaos_is_ssfem() -> None:
    """With loads inside, a thermal load, a prescribed displacement and a spring: one Galerkin solution."""
    scene = bars(E1, E2, lf.Elastic(normal=lf.Gamma("k", 500.0, cov=0.2), tangential=100.0), held=True)
    scene.temperature("a", lf.Normal("dT", 100.0, cov=0.1), name="heat")
    scene.body_force("b", (0.0, 0.0, lf.Uniform("g", 1.0, 2.0)), name="weight")
    scene.fix("b:x1", 0.01, components=0, name="side")
    problem = lf.assemble(scene)
    chaos = lf.solve(problem, chaos=lf.Chaos(order=3), options=TIGHT)
    for solver in ("cg", "direct"):
        exact = ssfem(problem, lf.Chaos(order=3), solver=solver)
        for part in "ab":
            expected = exact.coefficients[part]
            assert chaos.coefficients(part) == pytest.approx(expected, abs=2e-8 * np.abs(expected).max())
    # and the chaos tends to the samples
    germs = chaos.space.sample(6, 4)
    samples = lf.sample(problem, germs, options=TIGHT, keep_states=True, progress=False)
    finer = lf.solve(problem, chaos=lf.Chaos(order=6), options=TIGHT)
    for z in (LENGTH, 1.4 * LENGTH):
        probe = end(problem, z)
        assert probe(finer.at(germs)) == pytest.approx(samples.quantity(probe).values, rel=1e-3)


@pytest.mark.parametrize("law", [None, lf.Contact(), lf.Contact(friction=0.3)])
def test_samples_are_solutions_with_that_stiffness(law: Any) -> None:
    """Free of anything that the factor is made of: the same scene assembled with the moduli of the sample."""

    def heated(first: Any, second: Any) -> lf.Problem:
        scene = bars(first, second, law, held=True)
        scene.temperature("a", 100.0, name="heat")
        scene.temperature("b", lambda x: 10.0 * x[:, 2], name="field")
        scene.body_force("b", (0.0, 0.0, -3.0), name="weight")
        return lf.assemble(scene)

    problem = heated(E1, E2)
    germs = np.array([[-1.5, 0.5], [0.0, 0.0], [2.0, -1.0]])
    samples = lf.sample(problem, germs, options=TIGHT, keep_states=True, progress=False)
    reactions = samples.quantity(samples.reaction("foot", "z")).values
    stress = lf.AtPoint(problem, "a", (0.5, 1.0, 2.0), "stress", "zz")
    stresses = samples.quantity(stress).values
    for n, xi in enumerate(germs):
        at = xi[None]
        moduli = [float(samples.space.values(each, at)[0]) for each in (E1, E2)]
        alone = lf.solve(heated(*moduli), options=TIGHT)
        for part in "ab":
            expected = alone.unknowns(part)
            u = list(samples.blocks())[0].displacement(part)[n]
            assert u == pytest.approx(expected, abs=1e-6 * np.abs(expected).max())
        block = next(alone.blocks())
        assert reactions[n] == pytest.approx(float(alone.reaction("foot", "z")(block)[0]), rel=1e-6)
        own = lf.AtPoint(alone.problem, "a", (0.5, 1.0, 2.0), "stress", "zz")
        assert stresses[n] == pytest.approx(float(own(block)[0]), rel=1e-6)


@pytest.mark.parametrize("kind", ["factor", "field"])
def test_plates_that_are_all_interface(kind: str) -> None:
    """More active unknowns than a dense block is used for otherwise: solved at once, as by SSFEM."""
    scene = lf.Scene()
    law = lf.Perfect() if kind == "factor" else lf.Elastic(lf.LogNormal("k", 100.0, cov=0.2), 50.0)
    for part, modulus, z in (("a", E1, 0.0), ("b", E2, 2.0)):
        plate = geometry.box((10, 10, 2), (12, 12, 1), origin=(0, 0, z), cell="hexahedron")
        if kind == "field":
            settings = {"cov": modulus.cov, "length": 20.0, "modes": 1, "distribution": "lognormal"}
            modulus = lf.RandomField(modulus.name, modulus.mean, **settings)
        scene.substructure(part, plate, lf.LinearElastic(modulus, 0.3), degree=1)
    scene.interface("joint", "a:z1", "b:z0", law)
    scene.fix("a:z0")
    scene.force("b:z1", (5.0, 0.0, 50.0))
    problem = lf.assemble(scene)
    chaos = lf.solve(problem, chaos=2, options=Options(rtol=1e-8))
    assert chaos.converged and chaos.iterations <= 4
    exact = ssfem(problem, lf.Chaos(order=2))
    for part in "ab":
        expected = exact.coefficients[part]
        assert chaos.coefficients(part) == pytest.approx(expected, abs=1e-8 * np.abs(expected).max())
    samples = lf.sample(problem, np.zeros((1, chaos.space.dimension)), progress=False)
    assert samples.converged


def test_a_held_bar_that_is_warm() -> None:
    """Both ends held: stress = -E alpha dT, of a random E the factor of it; free of stress otherwise."""
    dT = lf.Normal("dT", 100.0, cov=0.1)
    scene = lf.Scene()
    box = geometry.box((1, 2, LENGTH), (1, 1, 3))
    scene.substructure("a", box, lf.LinearElastic(E1, 0.0, alpha=1e-5), degree=1)
    scene.symmetry(["a:x0", "a:y0"])
    scene.fix("a:z0", name="foot", components=2)
    scene.fix("a:z1", name="head", components=2)
    scene.temperature("a", dT, name="heat")
    problem = lf.assemble(scene)
    chaos = lf.solve(problem, chaos=4)
    assert not chaos.plan.active and chaos.plan.method == "direct"
    mean, spread = -1e3 * 1e-3, 1e3 * 1e-3 * math.sqrt(1.04 * 1.01 - 1.0)
    assert chaos.stress("a").x.array.reshape(-1, 9)[:, 8] == pytest.approx(mean, rel=1e-9)
    assert chaos.std("a", of="stress").x.array.reshape(-1, 9)[:, 8] == pytest.approx(spread, rel=1e-5)
    samples = lf.tensor_quadrature(problem, 6, keep_states=True, progress=False)
    assert samples.stress("a").x.array.reshape(-1, 9)[:, 8] == pytest.approx(mean, rel=1e-9)
    assert samples.std("a", of="stress").x.array.reshape(-1, 9)[:, 8] == pytest.approx(spread, rel=1e-6)
    xi = np.array([[1.0, -1.0]])
    names = chaos.space.germ_names
    E, warm = (chaos.space.values(each, xi)[0] for each in (E1, dT))
    assert set(names) == {"E1", "dT"}
    one = lf.sample(problem, xi, keep_states=True, progress=False)
    assert one.quantity(one.reaction("foot", "z")).values == pytest.approx(E * 1e-5 * warm * AREA, rel=1e-9)


def test_sweeps_over_moduli() -> None:
    problem = pulled(1e3, 2e3)
    grid: dict[Any, Any] = {"a.E": [500.0, 1e3, 4e3], "b.stiffness": [0.5, 2.0], "pull.z": [FORCE, 2 * FORCE]}
    swept = lf.sweep(problem, grid, options=TIGHT, keep_states=True, progress=False)
    found = np.array([end(problem)(block) for block in swept.blocks()]).reshape(swept.shape)
    for i, E in enumerate(grid["a.E"]):
        for j, factor in enumerate(grid["b.stiffness"]):
            for k, force in enumerate(grid["pull.z"]):
                exact = force * LENGTH / AREA * (1.0 / E + 1.0 / (2e3 * factor))
                assert found[i, j, k] == pytest.approx(exact, rel=1e-6)
    last = swept.stress("a").x.array.reshape(-1, 9)[:, 8]
    assert last == pytest.approx(2 * FORCE / AREA, rel=1e-6)


def test_moduli_of_an_assembled_problem() -> None:
    """As assembled with them: loads of temperatures and stresses, too; numbers, random ones, and fields."""

    def warm(first: Any, second: Any) -> lf.Problem:
        scene = bars(first, second, held=True)
        scene.temperature("a", 100.0, name="heat")
        return lf.assemble(scene)

    old = warm(1e3, 2e3)
    values = {"a.E": 3e3, "b.E": 500.0, "heat.dT": 50.0}
    new, fresh = old.with_laws(values=values), warm(3e3, 500.0).with_laws(values={"heat.dT": 50.0})
    found, expected = lf.solve(new, options=TIGHT), lf.solve(fresh, options=TIGHT)
    assert found.unknowns("b") == pytest.approx(expected.unknowns("b"), rel=1e-9)
    assert found.stress("a").x.array == pytest.approx(expected.stress("a").x.array, rel=1e-8, abs=1e-9)
    swept = lf.sweep(old, {"a.E": [3e3], "b.E": [500.0], "heat.dT": [50.0]}, options=TIGHT, keep_states=True)
    assert next(swept.blocks()).displacement("b")[0] == pytest.approx(found.unknowns("b"), rel=1e-7)
    chaos = lf.solve(old.with_laws(values={"a.E": E1, "b.stiffness": E2 / 2e3}), chaos=2, options=TIGHT)
    assert chaos.unknowns("b") == pytest.approx(
        lf.solve(warm(E1, E2), chaos=2, options=TIGHT).unknowns("b"), rel=1e-7
    )
    field = lf.RandomField("F", 1e3, cov=0.2, length=3.0, modes=2, distribution="lognormal")
    assert lf.solve(old.with_laws(values={"a.E": field}), chaos=1).plan.fields == ("a",)
    for value, text in ((-1.0, "stiffness is positive"), ("x", "give a number")):
        with pytest.raises(lf.SceneError, match=f"a.E = .*{text}"):
            old.with_laws(values={"a.E": value})
    with pytest.raises(lf.SceneError, match="a factor has the mean 1: change a.E"):
        old.with_laws(values={"a.stiffness": 2.0})


def test_histories() -> None:
    ramp = lf.Amplitude([0, 1, 2], [0, 1, 0.5])
    for law in (lf.Perfect(), lf.Contact()):
        scene = bars(E1, E2, law, held=True)
        scene.temperature("a", ramp * lf.Normal("dT", 100.0, cov=0.1), name="heat")
        problem = lf.assemble(scene)
        germs = np.array([[0.5, -0.5, 1.0]])
        samples = lf.sample(problem, germs, times=[0, 1, 2], options=TIGHT, keep_states=True, progress=False)
        E, F, warm = (
            float(samples.space.values(each, germs)[0]) for each in (E1, E2, lf.Normal("dT", 100.0, cov=0.1))
        )
        force = -AREA * 1e-5 * warm / (1.0 / E + 1.0 / F)
        found = samples.force("joint")[0, :, :, 0] @ problem.interfaces["joint"].weights
        assert found == pytest.approx(force * np.array([0.0, 1.0, 0.5]), rel=1e-6, abs=1e-9)
        if law.linear:
            chaos = lf.solve(problem, chaos=lf.Chaos(order=8), times=[0, 1, 2], options=TIGHT)
            found = chaos.at(germs).force("joint")[0, :, :, 0] @ problem.interfaces["joint"].weights
            assert found == pytest.approx(force * np.array([0.0, 1.0, 0.5]), rel=1e-4, abs=1e-9)


def test_a_chaos_with_contact() -> None:
    scene = bars(E1, E2, lf.Contact(), held=True)
    scene.temperature("a", 100.0, name="heat")
    problem = lf.assemble(scene)
    chaos = lf.solve(problem, chaos=lf.Chaos(order=5, check_points=0), options=Options(rtol=1e-7))
    germs = chaos.space.sample(5, 1)
    E, F = (chaos.space.values(each, germs) for each in (E1, E2))
    force = -AREA * 1e-3 / (1.0 / E + 1.0 / F)
    found = chaos.at(germs).force("joint")[..., 0] @ problem.interfaces["joint"].weights
    assert found == pytest.approx(force, rel=1e-3)


def test_one_number_in_two_parts() -> None:
    """Parts whose factors are the same number stretch as one: u = F L / A (1 / E + 1 / (2 E))."""
    problem = pulled(E1, 2 * E1)
    chaos = lf.solve(problem, chaos=lf.Chaos(order=8), options=TIGHT)
    assert chaos.space.germ_names == ("E1",)
    E = chaos.space.values(E1, [[0.7]])[0]
    assert end(problem)(chaos.at([[0.7]])) == pytest.approx(FORCE * LENGTH / AREA * 1.5 / E, rel=1e-6)


def test_bad_stiffness() -> None:
    with pytest.raises(lf.SceneError, match="E = .* has the mean -1000; Young's modulus is positive"):
        lf.LinearElastic(lf.Normal("E", -1e3, cov=0.1), 0.3)
    with pytest.raises(lf.SceneError, match="nu = .*only the E of LinearElastic may be random"):
        lf.LinearElastic(1e3, lf.Uniform("nu", 0.2, 0.3))
    scene, box = lf.Scene(), geometry.box((1, 1, 1), (1, 1, 1))
    for value, text in ((2.0, "give 1 or a random number"), (lf.Normal("a", 2.0, cov=0.1), "has the mean 2")):
        with pytest.raises(lf.SceneError, match=f"stiffness = .*{text}"):
            scene.substructure("a", box, lf.LinearElastic(1.0, 0.3), stiffness=value)
    wide = pulled(lf.Normal("E", 1e3, cov=0.4), 2e3)
    with pytest.raises(lf.SceneError, match="'a': 1 of 1 samples give it a stiffness that is not positive"):
        lf.sample(wide, [[-3.0]], progress=False)
    with pytest.raises(lf.IndefiniteError, match="substructure 'a', factor .* indefinite"):
        lf.solve(wide, chaos=9)
    with pytest.raises(lf.SceneError, match="'a.E' takes the value -1: a stiffness is positive"):
        lf.sweep(wide, {"a.E": [1.0, -1.0]}, progress=False)
    with pytest.raises(lf.SceneError, match="two axes"):
        lf.sweep(wide, {"a.E": [1.0], "a.stiffness": [1.0]}, progress=False)
    with pytest.raises(lf.SceneError, match="the plan has no factor for the stiffness of 'a'"):
        lf.solve(wide, chaos=1, plan=lf.make_plan(wide))
    with pytest.raises(lf.SceneError, match="ties 'a'"):
        scene = bars(E1, 1e3)
        scene.plane(["a:x1", "b:x1"], name="side")
        lf.solve(lf.assemble(scene), chaos=1)


def test_errors_and_files(tmp_path: Path) -> None:
    """Errors have no share of the meshes, and a file no stress, which it says; both at the means as ever."""
    problem = pulled(E1, E2)
    chaos = lf.solve(problem, chaos=lf.Chaos(order=2))
    found = chaos.errors("joint")
    assert found.discretisation is None and found.truncation is not None
    chaos.save(tmp_path / "bars.h5")
    loaded = lf.load(tmp_path / "bars.h5")
    assert loaded.unknowns("b") == pytest.approx(chaos.unknowns("b"), rel=1e-12)
    with pytest.raises(lf.SceneError, match="random stiffness.*compute stresses before save"):
        loaded.stress("a")
    with pytest.raises(lf.SceneError, match="export: the stiffness of 'a', 'b' varies"):
        problem.export(tmp_path / "folder", chaos=1)
    accurate = lf.solve(problem, accuracy=1e-2, quantity="joint", meshes=False)
    assert accurate.converged
    warm = bars(1e3, 2e3, held=True)
    warm.temperature("a", 100.0, name="heat")
    result = lf.solve(lf.assemble(warm))
    result.save(tmp_path / "warm.h5")
    with pytest.raises(lf.SceneError, match="initial strains .temperatures.*compute stresses before save"):
        lf.load(tmp_path / "warm.h5").stress("a")
    for where in ("a", "b"):
        assert chaos.std(where, of="stress").x.array.reshape(-1, 9)[:, 8] == pytest.approx(0.0, abs=1e-3)


def light_part_with_a_gap(first: Any, light: Any) -> lf.Problem:
    """Two squares pressed together, and a third one of 1e-5 of their load that flies through a gap."""
    scene, E = lf.Scene(), 2e5
    for part, modulus, x, y in (("a", first, 0.0, 0.0), ("b", E, 0.0, 1.0), ("c", light, 3.0, 0.0)):
        box = geometry.box((1.0, 1.0), (3, 3), origin=(x, y))
        scene.substructure(part, box, lf.LinearElastic(modulus, 0.3), degree=1)
        scene.symmetry(f"{part}:x0", name=f"side_{part}")
    scene.fix("a:y0", name="foot")
    scene.interface("joint", "a:y1", "b:y0", lf.Contact(friction=0.2))
    scene.interface("heavy", "b:y1", lf.Traction(np.array((5.0, -100.0))))
    scene.interface("stop", "c:y0", lf.Contact(gap=0.01))
    scene.interface("light", "c:y1", lf.Traction(np.array((0.0, -1e-3))))
    return lf.assemble(scene)


@pytest.mark.parametrize("field", [False, True])
def test_a_light_part_lands_whatever_the_moduli(field: bool) -> None:
    """Where the iteration gives up the answer is found as with fixed moduli: c rests at -gap."""
    light: Any = lf.LogNormal("Ec", 2e5, cov=0.3)
    if field:
        light = lf.RandomField("Ec", 2e5, cov=0.3, length=2.0, modes=1, distribution="lognormal")
    problem = light_part_with_a_gap(lf.LogNormal("Ea", 2e5, cov=0.3), light)
    germs = np.array([[0.0, 0.0], [1.2, -1.0]])
    samples = lf.sample(problem, germs, keep_states=True, progress=False)
    assert set(samples.points.status) == {"converged"}
    block = next(samples.blocks())
    for n in range(2):
        height = block.displacement("c")[n].reshape(-1, 2)[:, 1]
        assert height == pytest.approx(-0.01, abs=1e-6 * 0.01 + 3e-3 / 1e5)
    balance = samples.force("stop")[:, :, 0] @ problem.interfaces["stop"].weights
    assert balance == pytest.approx(-1e-3, rel=1e-5)
    if not field:
        chaos = lf.solve(problem, chaos=lf.Chaos(1, check_points=0), progress=False)
        assert chaos.converged


def test_rigid_joints_of_varying_parts_are_solved_at_once() -> None:
    """A factor, a field and a rigid joint, to SSFEM, in a few rounds, at any tolerance."""
    scene = lf.Scene()
    field = lf.RandomField("F", 1e3, cov=0.3, length=2.0, modes=2, distribution="lognormal")
    for number, (part, modulus) in enumerate((("a", field), ("b", lf.LogNormal("Eb", 2e3, cov=0.3)))):
        box = geometry.box((3, 2, 2), (3, 1, 1), origin=(3 * number, 0, 0), cell="hexahedron")
        scene.substructure(part, box, lf.LinearElastic(modulus, 0.3, alpha=1e-4), degree=1)
    scene.interface("joint", "a:x1", "b:x0", lf.Perfect())
    scene.fix("a:x0", name="foot")
    scene.temperature("a", lf.Normal("dT", 10.0, cov=0.3), name="heat")
    scene.force("b:x1", (10.0, 5.0, 1.0), name="pull")
    problem = lf.assemble(scene)
    exact = ssfem(problem, lf.Chaos(2), rtol=1e-12).coefficients
    for rtol in (1e-3, 1e-6, 1e-9):
        chaos = lf.solve(problem, chaos=lf.Chaos(2), options=Options(rtol=rtol), progress=False)
        assert chaos.converged and chaos.iterations <= 15 and chaos.plan.active == ("joint",)
        for part in "ab":
            off = np.abs(chaos.coefficients(part) - exact[part]).max() / np.abs(exact[part]).max()
            assert off < 3 * max(rtol, 1e-11)


def test_the_truncation_counts_where_statics_decides_the_forces() -> None:
    """The force of a rod does not scatter with its modulus; its strain does."""
    scene = bars(lf.LogNormal("E1", 1e3, cov=0.4), 2e3, lf.Elastic(100.0, 100.0))
    scene.force("b:z1", (0.0, 0.0, FORCE), name="pull")
    problem = lf.assemble(scene)
    end = lf.AtPoint(problem, "a", (0.5, 1, LENGTH), component="z")
    coarse = lf.solve(problem, chaos=2)
    assert coarse.errors().truncation.energy > 1e-2
    found = lf.solve(problem, accuracy=1e-3, meshes=False)
    mean = FORCE * LENGTH / AREA * (1.0 + 0.4**2) / 1e3
    assert found.quantity(end).mean().value == pytest.approx(mean, rel=5e-3)  # 100 000 samples
    values = found.coefficients("a")
    exact = lf.solve(problem, chaos=8).coefficients("a").copy()
    exact[:, : values.shape[1]] -= values
    assert np.linalg.norm(exact) < 3e-3 * np.linalg.norm(values)
