"""Loads of parts, faces that are rigid, remote forces, bolts and axisymmetric parts, against closed forms."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import dolfinx.mesh
import numpy as np
import pytest
import ufl

import dolfinx_frontend as lf
from dolfinx_frontend import geometry
from dolfinx_frontend.reference.galerkin import ssfem
from latin_core import Options
from tests.helpers import block as mapped

E, NU = 200e3, 0.3
BOLT = -100.0 * 0.0 + (23e-6 - 12e-6) * 100.0 / (1.0 / (200e3 * 100.0) + 1.0 / (70e3 * 400.0))
"""12 833.33 N: a steel bolt in an aluminium sleeve, 100 K warmer."""


def bolt_in_sleeve(dT: Any, friction: Any = None, drag: float = 0.0) -> lf.Scene:
    scene = lf.Scene()
    bolt = geometry.box((10, 10, 50), (2, 2, 3))
    sleeve = geometry.box((20, 20, 50), (2, 2, 3), origin=(30, 0, 0))
    scene.substructure("bolt", bolt, lf.LinearElastic(200e3, NU, alpha=12e-6), degree=1)
    scene.substructure("sleeve", sleeve, lf.LinearElastic(70e3, 0.0 if drag else NU), degree=1)
    scene.temperature("bolt", dT, name="warm bolt")
    scene.temperature("sleeve", dT, alpha=23e-6, name="warm sleeve")
    scene.symmetry(["bolt:x0", "bolt:y0", "bolt:z0"])
    scene.plane(["bolt:z1", "sleeve:z1"], tilts=False, name="head")
    if friction is None:
        scene.symmetry(["sleeve:x0", "sleeve:y0", "sleeve:z0"])
    else:
        scene.symmetry("sleeve:y0")
        scene.fix("sleeve:x0", drag, components=0)
        scene.interface("seat", "sleeve:z0", lf.Contact(gap=0.0, friction=friction))
    return scene


def head(result: Any, **settings: Any) -> Any:
    return result.readings("head[bolt:z1]", **settings).interfaces["head[bolt:z1]"].values["force_z"]


def block(degree: int = 2, nu: float = NU, **material: Any) -> lf.Scene:
    scene = lf.Scene()
    scene.substructure(
        "a", geometry.box((2, 3, 5), (2, 2, 3)), lf.LinearElastic(1e3, nu, **material), degree=degree
    )
    return scene


# --- temperature -----------------------------------------------------------------------------------
def test_a_warm_bolt_in_a_sleeve() -> None:
    problem = lf.assemble(bolt_in_sleeve(100.0))
    result = lf.solve(problem)
    assert head(result) == pytest.approx(BOLT, rel=1e-8)
    stress = result.stress("bolt").x.array.reshape(-1, 3, 3)
    assert stress[:, 2, 2] == pytest.approx(BOLT / 100.0, rel=1e-8)
    assert np.abs(stress[:, 0, 0]).max() < 1e-8 * BOLT
    probe = lf.AtPoint(problem, "sleeve", (35.0, 5.0, 25.0), "stress", "zz")
    assert result.quantity(probe).values[0] == pytest.approx(-BOLT / 400.0, rel=1e-8)
    warmer = problem.with_laws(values={"warm bolt.dT": 50.0, "warm sleeve.dT": 50.0})
    assert head(lf.solve(warmer)) == pytest.approx(0.5 * BOLT, rel=1e-8)
    assert problem.load_parameters == {"warm bolt.dT": 100.0, "warm sleeve.dT": 100.0}


def test_a_random_temperature_and_friction() -> None:
    dT, mu = lf.Normal("dT", 100.0, cov=0.1), lf.Uniform("mu", 0.1, 0.2)
    problem = lf.assemble(bolt_in_sleeve(dT))
    chaos = lf.solve(problem, chaos=1)
    germs = np.array([[-1.0], [0.0], [2.0]])
    of_bolt = lf.AtPoint(problem, "bolt", (5.0, 5.0, 25.0), "stress", "zz")
    assert of_bolt(chaos.at(germs)) == pytest.approx(BOLT / 100.0 * np.array([0.9, 1.0, 1.2]), rel=1e-8)
    assert chaos.std("bolt", of="stress").x.array.reshape(-1, 9)[:, 8] == pytest.approx(
        0.1 * BOLT / 100.0, rel=1e-8
    )
    samples = lf.tensor_quadrature(problem, 3, keep_states=True)
    assert samples.std("bolt", of="stress").x.array.reshape(-1, 9)[:, 8] == pytest.approx(
        0.1 * BOLT / 100.0, rel=1e-6
    )
    monolithic = ssfem(problem, lf.Chaos(order=1))
    for part in ("bolt", "sleeve"):
        expected = monolithic.coefficients[part]
        assert chaos.coefficients(part) == pytest.approx(expected, abs=1e-9 * np.abs(expected).max())
    # all of the seat slips: its friction is mu times the clamping force, a product of two random numbers
    sliding = lf.assemble(bolt_in_sleeve(dT, mu, drag=5.0))
    options = Options(rtol=1e-7)
    chaos = lf.solve(sliding, chaos=lf.Chaos(order=2, check_points=0), options=options)
    weights = sliding.interfaces["seat"].weights
    force = chaos.force_coefficients("seat")
    total = np.einsum("p,pk->k", weights, force[:, 1])
    if abs(total[0]) < 1e-3 * BOLT:
        total = np.einsum("p,pk->k", weights, force[:, 2])
    mean, std = 0.15 * BOLT, 0.1 / math.sqrt(12.0)
    spread = BOLT * math.sqrt((0.15**2 + std**2) * (1.0 + 0.1**2) - 0.15**2)
    assert abs(total[0]) == pytest.approx(mean, rel=1e-4)
    assert math.sqrt(np.sum(total[1:] ** 2)) == pytest.approx(spread, rel=1e-3)


def test_free_expansion_has_no_stress() -> None:
    for nu, plane in ((0.3, "strain"), (0.3, "stress")):
        scene = lf.Scene()
        scene.substructure(
            "a", geometry.box((2, 3), (2, 2)), lf.LinearElastic(1e3, nu, plane, alpha=1e-5), degree=2
        )
        scene.temperature("a", 100.0, alpha=(1e-5, 1e-5, 0.0))  # nothing holds across the plane
        scene.fix_point("a", (0, 0), name="one")
        scene.fix_point("a", (2, 0), components=1, name="two")
        result = lf.solve(lf.assemble(scene))
        assert np.abs(result.stress("a").x.array).max() < 1e-10 * 1e3
    scene = block(alpha=1e-5)
    scene.temperature("a", lambda x: 40.0 + 10.0 * x[:, 2])  # a linear field bends without stress
    scene.fix_point("a", (0, 0, 0), name="one")
    scene.fix_point("a", (2, 0, 0), components=(1, 2), name="two")
    scene.fix_point("a", (0, 3, 0), components=2, name="three")
    result = lf.solve(lf.assemble(scene))
    assert np.abs(result.stress("a").x.array).max() < 1e-10
    assert abs(result.readings("one").interfaces["one"].values["force_z"]) < 1e-10


def test_plane_strain_keeps_the_thermal_stress_across() -> None:
    scene = lf.Scene()
    scene.substructure("a", geometry.box((2, 3), (2, 2)), lf.LinearElastic(E, NU, alpha=1e-5), degree=1)
    scene.temperature("a", 100.0)
    scene.symmetry(["a:x0", "a:y0"])
    result = lf.solve(lf.assemble(scene))
    u = result.unknowns("a").reshape(-1, 2)[:, 0].max()
    assert u == pytest.approx((1.0 + NU) * 1e-3 * 2.0, rel=1e-10)
    assert np.abs(result.stress("a").x.array).max() < 1e-9 * E


def test_histories_sweeps_and_samples_of_a_load() -> None:
    ramp = lf.Amplitude([0, 1, 2], [0, 1, 0.5])
    dT = lf.Normal("dT", 100.0, cov=0.1)
    problem = lf.assemble(bolt_in_sleeve(ramp * dT))
    history = lf.solve(problem, times=[0, 1, 2])
    assert head(history) == pytest.approx(BOLT * np.array([0, 1, 0.5]), rel=1e-8, abs=1e-8)
    for times in ([0, 1, 2], [1, 2]):  # superposed patterns, and steps
        chaos = lf.solve(problem, times=times, chaos=1)
        of_bolt = lf.AtPoint(problem, "bolt", (5.0, 5.0, 25.0), "stress", "zz")
        assert of_bolt(chaos.at([[1.0]])) == pytest.approx(1.1 * 0.5 * BOLT / 100.0, rel=1e-8)
    grid: dict[Any, Any] = {("warm bolt.dT", "warm sleeve.dT"): [50.0, 100.0]}
    swept = lf.sweep(problem, grid, times=[0, 1], keep_states=True, progress=False)
    assert head(swept)[:, 1] == pytest.approx([0.5 * BOLT, BOLT], rel=1e-8)
    samples = lf.monte_carlo(problem, 5, times=[0, 1], keep_states=True, progress=False)
    values = samples.space.values(dT, samples.germs)
    assert head(samples)[:, 1] == pytest.approx(BOLT / 100.0 * values, rel=1e-8)
    assert "load columns" in str(samples.plan)


def test_a_sweep_of_a_load_and_a_spring_is_that_of_its_points() -> None:
    """Linear laws, of which many points are solved together; not where loads are swept as well."""
    scene = block(degree=1, alpha=1e-5)
    scene.springs("a:z0", name="g", x=10.0, y=20.0, z=30.0, rx=100.0, ry=200.0, rz=300.0)
    scene.temperature("a", 100.0, name="heat")
    scene.force("a:z1", (0.0, 0.0, 50.0), name="f")
    problem = lf.assemble(scene)
    grid: dict[Any, Any] = {"heat.dT": [50.0, 200.0, 300.0], "g.z.normal": [50.0, 100.0, 400.0]}
    options = Options(rtol=1e-9)
    swept = lf.sweep(problem, grid, options=options, keep_states=True, progress=False)
    assert swept.converged.all() and swept.error.max() <= 1e-9
    for i, dT in enumerate(grid["heat.dT"]):
        for j, k in enumerate(grid["g.z.normal"]):
            changed = problem.with_laws(values={"heat.dT": dT, "g.z.normal": k})
            alone = lf.solve(changed, options=options)
            assert swept.point(i, j).unknowns("a") == pytest.approx(
                alone.unknowns("a"), abs=1e-7 * np.abs(alone.unknowns("a")).max()
            )


def test_a_chaos_tells_what_it_leaves_out_of_a_load() -> None:
    """exp(s x) has the share 1 - s^2 / (exp(s^2) - 1) of its variance beyond the first order."""
    cov = 0.5
    problem = lf.assemble(bolt_in_sleeve(lf.LogNormal("dT", 100.0, cov=cov)))
    first, sixth = (lf.solve(problem, chaos=order) for order in (1, 6))
    left = 1.0 - math.log1p(cov**2) / cov**2
    assert first.misfits is not None and set(first.misfits) == {"warm bolt.dT", "warm sleeve.dT"}
    # 4096 points of a Sobol sequence, of a tail whose fourth moments are in the variance of what is left
    assert first.misfits["warm bolt.dT"] == pytest.approx(left, rel=0.05)
    assert first.trusted is False and "about" in str(first) and sixth.trusted


def test_random_loads_with_springs_contact_and_samples_agree() -> None:
    dT = lf.Normal("dT", 100.0, cov=0.1)
    found = []
    for law in (lf.Elastic(normal=lf.LogNormal("k", 1e4, cov=0.2), tangential=1e4), lf.Contact()):
        scene = lf.Scene()
        for number, part in enumerate("ab"):
            box = geometry.box((10, 10, 50), (1, 1, 3), origin=(0, 0, 50 * number))
            scene.substructure(part, box, lf.LinearElastic(E, 0.0), degree=1)
            scene.temperature(part, dT, alpha=12e-6, name=f"heat {part}")
        scene.interface("joint", "a:z1", "b:z0", law)
        scene.fix(["a:z0", "b:z1"])
        problem = lf.assemble(scene)
        samples = lf.tensor_quadrature(problem, 5, keep_states=True, progress=False)
        chaos = lf.solve(problem, chaos=lf.Chaos(order=4, check_points=0))
        mean, std = samples.moments("joint")
        own_mean, own_std = chaos.moments("joint")
        assert own_mean[:, 0] == pytest.approx(mean[:, 0], rel=1e-4)
        assert own_std[:, 0] == pytest.approx(std[:, 0], rel=2e-3)
        found.append(mean[:, 0].mean() * 100.0)
        if law.linear:
            exact = ssfem(problem, lf.Chaos(order=4)).force_coefficients("joint")[:, 0]
            assert chaos.force_coefficients("joint")[:, 0, 0] == pytest.approx(exact[:, 0], rel=1e-5)
    assert found[1] == pytest.approx(-E * 100.0 * 12e-4, rel=1e-6)


# --- forces of faces -------------------------------------------------------------------------------
def test_any_linear_form_and_body_forces_are_loads() -> None:
    scene = block()
    scene.fix("a:z0", name="foot")
    scene.load("a", lambda v: 3.0 * v[2], name="form")
    scene.load("a", lambda v: ufl.inner(ufl.as_vector((1.0, 0, 0)), v) * ufl.dx, factor=2.0, name="whole")
    scene.body_force("a", (0.0, lf.Normal("g", 2.0, cov=0.1), 0.0), name="weight")
    scene.body_force("a", lambda x: np.stack([0 * x[:, 0], 0 * x[:, 0], x[:, 2]], axis=1), name="field")
    result = lf.solve(lf.assemble(scene))
    values = result.readings("foot").interfaces["foot"].values
    assert [values[f"force_{a}"] for a in "xyz"] == pytest.approx([-60, -60, -90 - 6 * 12.5], rel=1e-10)


def test_forces_at_many_points_are_those_of_one_after_the_other() -> None:
    points = np.array([(0.3, 0.2, 0.7), (0.3, 0.2, 0.7), (1.0, 1.0, 1.0)])
    forces = np.array([(0.0, 2.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -3.0)])
    found = []
    for many in (True, False):
        scene = block()
        scene.fix("a:z0")
        if many:
            scene.point_force("a", points, 0.5 * forces, name="rain", factor=2.0)
        else:
            for point, force in zip(points, forces, strict=True):
                scene.point_force("a", point, force)
        found.append(lf.solve(lf.assemble(scene)).displacement("a").x.array)
    assert found[0] == pytest.approx(found[1], rel=1e-12, abs=1e-12 * np.abs(found[1]).max())


def test_forces_at_many_points_name_what_does_not_fit() -> None:
    scene = block()
    with pytest.raises(lf.SceneError, match=r"points of shape \(2, 3\) and forces of shape \(1, 3\)"):
        scene.point_force("a", np.zeros((2, 3)), np.zeros((1, 3)))
    with pytest.raises(lf.SceneError, match="factor = 2.* of one point"):
        scene.point_force("a", (0, 0, 0), (1.0, 0, 0), factor=2.0)


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_remote_forces_have_their_resultants(cell: str) -> None:
    scene = lf.Scene()
    box = geometry.box((2, 3, 5), (2, 2, 3), cell=cell)
    scene.substructure("a", box, lf.LinearElastic(1e3, NU), degree=2)
    scene.fix("a:z0")
    at = np.array([7.0, -3.0, 9.0])
    scene.force("a:z1", (1.0, 1.0, 1.0), (1.0, 1.0, 1.0), point=at, name="remote")
    scene.point_force("a", (0.3, 1.2, 3.3), (0, 0, 1.0), name="inside")
    scene.bearing("a:x1", (-3.0, 0, 0), name="pin")
    problem = lf.assemble(scene)
    x = problem.substructures["a"].dof_coordinates
    for k, parameter in enumerate(("x", "y", "z", "mx", "my", "mz")):
        f = problem.loads["remote"].on("a", parameter).reshape(-1, 3)
        both = np.concatenate([f.sum(axis=0), np.cross(x - at, f).sum(axis=0)])
        assert both == pytest.approx(np.eye(6)[k], abs=1e-10)
    f = problem.loads["inside"].on("a", "z").reshape(-1, 3)
    assert np.cross(x - [0.3, 1.2, 3.3], f).sum(axis=0) == pytest.approx([0, 0, 0], abs=1e-12)
    assert problem.loads["pin"].on("a", "factor").reshape(-1, 3).sum(axis=0) == pytest.approx(
        [-3, 0, 0], abs=1e-12
    )


def test_random_components_and_random_amplitudes() -> None:
    scene = block()
    scene.fix("a:z0", name="foot")
    F, G = lf.Normal("F", 10.0, cov=0.1), lf.Uniform("G", 1.0, 2.0)
    scene.traction("a:z1", (F, G, 0.0), name="t")
    scene.pressure("a:z1", lf.Amplitude([0, 1], [0, 1]) * F, name="p")
    problem = lf.assemble(scene)
    chaos = lf.solve(problem, chaos=1, times=[0, 1])
    block_ = chaos.at([[1.0, 0.5]])
    for component, expected in (("x", -66.0), ("y", -6.0 * 1.75), ("z", 66.0)):
        assert chaos.reaction("foot", component)(block_) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("kind", ["component", "vector", "whole", "jump", "point"])
@pytest.mark.parametrize("contact", [False, True])
def test_random_displacements_in_time(kind: str, contact: bool) -> None:
    """A bar whose end moves by D / 2 at last: the middle moves by D / 4, or by D / 2 where it lifts."""
    ramp, D = lf.Amplitude([0, 1, 2], [0, 1, 0.5]), lf.Normal("D", 0.1, cov=0.2)
    scene = block(degree=1, nu=0.0)
    if contact:
        scene.symmetry(["a:x0", "a:y0"])
        scene.interface("foot", "a:z0", lf.Contact())
    else:
        scene.fix("a:z0", name="foot")
    if kind == "component":
        scene.fix("a:z1", ramp * D, components=2, name="top")
    elif kind == "vector":
        scene.fix("a:z1", (0.0, 0.0, ramp * D), name="top")
    elif kind == "whole":
        scene.fix("a:z1", ramp * (0.0, 0.0, D), name="top")
    elif kind == "jump":
        scene.interface("top", "a:z1", lf.Elastic(normal=1e9, tangential=1e9, jump=ramp * -D))
    else:
        scene.plane("a:z1", tilts=False, name="lid")
        scene.fix_point("a", (0, 0, 5), (0.0, 0.0, ramp * D), name="top")
    problem = lf.assemble(scene)
    probe = lf.AtPoint(problem, "a", (1, 1.5, 2.5), component="z")
    options = Options(rtol=1e-8)
    for times in ([0, 1, 2], [1, 2]):
        chaos = lf.solve(problem, chaos=lf.Chaos(order=2, check_points=0), times=times, options=options)
        germs = np.array([[1.0], [-0.5]])
        expected = chaos.space.values(D, germs) * (0.5 if contact else 0.25)
        assert probe(chaos.at(germs)) == pytest.approx(expected, rel=1e-5)
        samples = lf.sample(
            problem, germs, times=times, options=options, keep_states=True, progress=False
        )
        assert samples.quantity(probe).values == pytest.approx(expected, rel=1e-5)
        one = lf.solve(problem, times=times, options=options)
        assert one.quantity(probe).values == pytest.approx(0.05 if contact else 0.025, rel=1e-5)


def test_springs_to_the_ground(tmp_path: Path) -> None:
    scene = block()
    stiffness = dict(x=10.0, y=20.0, z=30.0, rx=100.0, ry=200.0, rz=300.0)
    scene.springs("a:z0", name="g", **stiffness)
    scene.force("a:z1", (1, 2, 3), (4, 5, 6))
    problem = lf.assemble(scene)
    expected = dict(x=-1.0, y=-2.0, z=-3.0, rx=6.0, ry=-10.0, rz=-6.0)
    for active in (None, "all"):
        result = lf.solve(problem, active=active)
        for key, force in expected.items():
            assert result.force(f"g.{key}")[0, 0] == pytest.approx(force, rel=1e-6)
    table = result.readings("g.rx").interfaces["g.rx"].values
    assert (table["force_x"], table["moment_x"]) == pytest.approx((0.0, 6.0), rel=1e-6)
    result.save(tmp_path / "springs.h5")
    saved = lf.load(tmp_path / "springs.h5").readings("g.rx").interfaces["g.rx"].values
    assert saved["moment_x"] == pytest.approx(table["moment_x"], rel=1e-12)


# --- rigid faces -----------------------------------------------------------------------------------
def test_rigid_motions_have_no_stress() -> None:
    scene = block()
    motion = dict(x=0.1, y=-0.2, z=0.05, rx=1e-3, ry=2e-3, rz=-3e-3)
    scene.rigid("a:z1", name="head", point=(1, 1, 5), **motion)
    problem = lf.assemble(scene)
    result = lf.solve(problem)
    assert np.abs(result.stress("a").x.array).max() < 1e-10 * 1e3 * 1e-2
    turn, away = np.array([1e-3, 2e-3, -3e-3]), problem.substructures["a"].dof_coordinates - [1, 1, 5]
    assert result.unknowns("a").reshape(-1, 3) == pytest.approx(
        np.array([0.1, -0.2, 0.05]) + np.cross(turn, away), abs=1e-12
    )


@pytest.mark.parametrize("active", [None, ["joint"]])
@pytest.mark.parametrize(
    ("law", "shift", "force"),
    [
        (lf.Elastic(1e5, 1e5), -0.1, -1e5 * 0.1 * 100.0),
        (lf.Contact(friction=0.3), 0.1, 0.0),
        (lf.Contact(friction=0.3), -0.1, None),
    ],
)
def test_between_faces_whose_motions_are_given_the_law_alone_decides(
    law: Any, shift: float, force: float | None, active: Any
) -> None:
    """Nothing is left to move: a law with a stiffness answers, rigid bodies in each other do not converge."""
    scene = lf.Scene()
    for name, z, outer in (("low", 0.0, "z0"), ("up", 10.0, "z1")):
        box = geometry.box((10, 10, 10), (2, 2, 2), (0, 0, z))
        scene.substructure(name, box, lf.LinearElastic(E, NU))
        scene.fix(f"{name}:{outer}", name=f"end of {name}")
    still = dict.fromkeys(["x", "y", "rx", "ry", "rz"], 0.0)
    scene.rigid("low:z1", name="seat", z=0.0, **still)
    scene.rigid("up:z0", name="punch", z=shift, **still)
    scene.interface("joint", "low:z1", "up:z0", law)
    result = lf.solve(lf.assemble(scene), active=active, progress=False)
    if force is None:
        assert result.status != "converged"
    else:
        assert result.status == "converged"
        assert result.table("joint").value("force_z", "joint") == pytest.approx(force, rel=1e-6, abs=1e-6)


def test_a_rigid_face_takes_resultants() -> None:
    scene = block()
    scene.fix("a:z0", name="foot")
    scene.rigid("a:z1", name="head")
    scene.force("a:z1", (1, 2, 3), (4, 5, 6), name="f")
    problem = lf.assemble(scene)
    result = lf.solve(problem)
    values = result.readings("foot").interfaces["foot"].values
    found = [values[f"{what}_{a}"] for what in ("force", "moment") for a in "xyz"]
    assert found == pytest.approx([-1, -2, -3, -4 + 10, -5 - 5, -6], abs=1e-10)
    u = result.unknowns("a").reshape(-1, 3)
    top = np.flatnonzero(problem.substructures["a"].dof_coordinates[:, 2] > 5 - 1e-9)
    x = problem.substructures["a"].dof_coordinates[top]
    d = np.linalg.norm(x[:, None] - x[None], axis=2)
    stretch = np.einsum("ijk,ijk->ij", x[:, None] - x[None], u[top][:, None] - u[top][None])
    assert np.abs(stretch).max() < 1e-12 * (d**2).max()
    # with a support on its edge and an amplitude
    scene = block()
    scene.symmetry("a:x0")
    scene.fix("a:z0", components=(1, 2))
    scene.rigid("a:z1", name="head", z=lf.Amplitude([0, 1], [0, 1]) * 0.1)
    result = lf.solve(lf.assemble(scene), times=[0, 1])
    places = {"x": (0, 3, 5), "z": (1, 1.5, 5)}  # it may turn about x
    probe = [lf.AtPoint(result.problem, "a", place, component=c) for c, place in places.items()]
    assert [float(result.quantity(p).values[0]) for p in probe] == pytest.approx([0.0, 0.1], abs=1e-10)


def test_inertia_relief() -> None:
    scene = lf.Scene()
    scene.inertia_relief(7.8e-9)
    for number, part in enumerate("ab"):
        box = geometry.box((10, 10, 25), (2, 2, 3), origin=(0, 0, 25 * number))
        scene.substructure(part, box, lf.LinearElastic(E, 0.0), degree=2)
    scene.interface("joint", "a:z1", "b:z0", lf.Perfect())
    scene.pressure("a:z0", -100.0)
    problem = lf.assemble(scene)
    result = lf.solve(problem)
    for z in (5.0, 20.0, 30.0, 45.0):
        probe = lf.AtPoint(problem, "a" if z < 25 else "b", (5, 5, z), "stress", "zz")
        assert result.quantity(probe).values[0] == pytest.approx(100.0 * (1 - z / 50), rel=1e-8)
    for name, values in result.readings().interfaces.items():
        if name.startswith("relief"):
            total = [abs(float(values.values[f"force_{a}"])) for a in "xyz"]
            assert max(total) < 1e-10 * 1e4


# --- bolts -----------------------------------------------------------------------------------------
M, PITCH, D = 80e3, 1.75, 12.0


def bar(law: lf.Law) -> lf.Scene:
    scene = lf.Scene()
    for number, part in enumerate("ab"):
        box = geometry.box((10, 10, 20), (1, 1, 2), origin=(0, 0, 20 * number))
        scene.substructure(part, box, lf.LinearElastic(E, 0.0), degree=1)
    scene.fix(["a:z0", "b:z1"])
    scene.interface("bolt", "a:z1", "b:z0", law)
    return scene


def by_torque(mu_thread: Any, mu_head: Any) -> Any:
    flank = 0.5 * (D - 0.6495 * PITCH) / math.cos(math.pi / 6)
    return M / (PITCH / (2 * math.pi) + flank * mu_thread + 0.65 * D * mu_head)


def total(problem: lf.Problem) -> Any:
    weights = problem.interfaces["bolt"].weights
    return lambda fields: fields.force("bolt")[..., 0] @ weights


def test_torque_to_preload() -> None:
    thread, head_ = lf.LogNormal("mu_t", 0.12, cov=0.2), lf.LogNormal("mu_h", 0.14, cov=0.15)
    law = lf.Preload(torque=M, mu_thread=thread, mu_head=head_, d=D, pitch=PITCH)
    problem = lf.assemble(bar(law))
    assert lf.solve(problem).quantity(total(problem)).values[0] == pytest.approx(by_torque(0.12, 0.14))
    chaos = lf.solve(problem, chaos=lf.Chaos(order=3, check_points=0))
    germs = chaos.space.sample_sobol(2**16, 5)
    found = np.concatenate([total(problem)(chaos.at(part)) for part in np.array_split(germs, 16)])
    z, w = np.polynomial.hermite_e.hermegauss(40)
    w = w / w.sum()
    s, t = (math.sqrt(math.log1p(c * c)) for c in (0.2, 0.15))
    exact = by_torque(0.12 * np.exp(s * z - s * s / 2)[:, None], 0.14 * np.exp(t * z - t * t / 2)[None])
    mean = w @ exact @ w
    std = math.sqrt(w @ (exact - mean) ** 2 @ w)
    assert found.mean() == pytest.approx(mean, rel=2e-3)
    assert found.std() == pytest.approx(std, rel=2e-3)
    values = np.random.default_rng(1).standard_normal((2, 2_000_000))
    other = by_torque(0.12 * np.exp(s * values[0] - s * s / 2), 0.14 * np.exp(t * values[1] - t * t / 2))
    for p in (0.05, 0.5, 0.95):
        assert np.quantile(found, p) == pytest.approx(np.quantile(other, p), rel=2e-3)
    swept = lf.sweep(problem, {"bolt.mu_thread": [0.1, 0.2]}, progress=False)
    assert swept.force("bolt")[:, 0, 0] * 100 == pytest.approx(by_torque(np.array([0.1, 0.2]), 0.14))


def test_angle_shortening_and_embedding() -> None:
    stiffness = E * 100.0 / 40.0
    for law, expected in (
        (lf.Preload(shortening=0.01), 0.01 * stiffness),
        (lf.Preload(angle=2.0, pitch=1.8), 0.01 * stiffness),
        (lf.Preload(shortening=0.01, embedding=0.002), 0.008 * stiffness),
        (lf.Preload(shortening=0.01, stiffness=1e6), 0.01 / (1 / stiffness + 1e-6)),
    ):
        problem = lf.assemble(bar(law))
        assert lf.solve(problem).quantity(total(problem)).values[0] == pytest.approx(expected, rel=1e-6)
    loss = lf.Normal("fz", 0.002, std=0.0005)
    problem = lf.assemble(bar(lf.Preload(force=1e4, until=1, embedding=loss)))
    exact = Options(rtol=1e-9)
    mean, std = lf.solve(problem, times=[1, 2], chaos=1, options=exact).moments("bolt")
    assert mean[:, :, 0] * 100 == pytest.approx(
        np.array([[1e4], [1e4 - 0.002 * stiffness]]) * np.ones((1, mean.shape[1])), rel=1e-6
    )
    assert std[1, :, 0] * 100 == pytest.approx(0.0005 * stiffness, rel=1e-3)  # over Sobol points
    law = lf.Preload(torque=M, mu_thread=0.12, mu_head=0.14, d=D, pitch=PITCH, until=1, angle=1.0)
    problem = lf.assemble(bar(law))
    grid: dict[Any, Any] = {"bolt.angle": [0.0, 2.0]}
    swept = lf.sweep(problem, grid, times=[1, 2], progress=False, options=exact)
    force = swept.force("bolt")[:, :, 0, 0] * 100
    snug = by_torque(0.12, 0.14)
    expected = [[snug, snug], [snug, snug + 2.0 / 360 * PITCH * stiffness]]
    assert force == pytest.approx(np.array(expected), rel=1e-6)


def test_bolts_are_tightened_one_after_another_without_amplitudes() -> None:
    problem = lf.assemble(bar(lf.Preload(force=1e4, during=((1, 2),))))
    force = lf.solve(problem, times=[1, 2, 3], options=Options(rtol=1e-9)).force("bolt")[:, 0, 0] * 100
    assert force == pytest.approx([0.0, 1e4, 1e4], abs=1e-3)


def test_bolts_carry_nothing_before_their_turn() -> None:
    """Two bolts on a stiff plate on a bed of springs: a plate that heaves and tilts, in closed form.

    Beams of the bolts bend with the plate; the forces without their bending differ by a tenth.
    """
    length, width, force, bed, reach = 80.0, 10.0, 10e3, 50.0, 42.0
    bolt = lf.BoltStiffness.vdi2230(d=12, pitch=1.75, shank=25, thread=15, E=205e3)
    places = np.array([10.0, 70.0])

    def part(origin: float, height: float, top: float, face: float) -> lf.geometry.Part:
        box = geometry.box((length, width, height), (16, 1, 1), origin=(0, 0, origin), cell="hexahedron")
        mesh = box.mesh
        mesh.topology.create_connectivity(2, 3)
        facets = dolfinx.mesh.exterior_facet_indices(mesh.topology)
        x = dolfinx.mesh.compute_midpoints(mesh, 2, facets)
        tag = np.where(np.abs(x[:, 2] - face) < 1e-6, 3, 0)
        for k, place in enumerate(places):
            tag[(np.abs(x[:, 2] - top) < 1e-6) & (np.abs(x[:, 0] - place) < 5.0)] = k + 1
        tag[np.abs(x[:, 0]) < 1e-6] = 4
        kept = tag > 0
        tags = dolfinx.mesh.meshtags(mesh, 2, facets[kept], tag[kept].astype(np.int32))
        return geometry.Part(mesh, tags, {"b0": 1, "b1": 2, "g": 3, "root": 4})

    scene = lf.Scene()
    rigid = lf.LinearElastic(1e12, 0.0)
    scene.substructure("up", part(0.0, 12.0, 12.0, 0.0), rigid, degree=1)
    scene.substructure("base", part(-30.0, 30.0, -30.0, 0.0), rigid, degree=1)
    scene.interface("gasket", "up:g", "base:g", lf.Elastic(normal=bed, tangential=bed))
    scene.fix("base:root")
    for k in (0, 1):
        turn = lf.Preload(force, during=((float(k), k + 1.0),))
        scene.beam(f"bolt{k}", f"base:b{k}", f"up:b{k}", bolt, turn)
    result = lf.solve(lf.assemble(scene), times=[1.0, 2.0], options=Options(rtol=1e-9))

    # heave, tilt, shift of the plate at the bed; the heads are 12 above, the beams clamped at the base
    area = length * width
    q = bolt.bending
    beam = np.array([[12 * q / reach**2, -6 * q / reach], [-6 * q / reach, 4 * q]])
    moved = np.array([[0.0, 12.0, 1.0], [0.0, 1.0, 0.0]])
    plate = np.diag([bed * area, bed * width * length**3 / 12, bed * area])
    rows = [np.array([1.0, place - length / 2, 0.0]) for place in places]
    # the first one resists what comes after its turn, by all that a beam has; the second one nothing
    stiff = plate + bolt.axial * np.outer(rows[0], rows[0]) + moved.T @ beam @ moved
    last = force - bolt.axial * rows[0] @ np.linalg.solve(stiff, force * rows[1])
    found = [[result.table(step=s).value("normal", f"bolt{k}.axial") for k in (0, 1)] for s in (0, 1)]
    right = np.array([[force, 0.0], [last, force]])
    assert np.array(found) == pytest.approx(right, rel=1e-6, abs=1e-6 * force)


@pytest.mark.parametrize(
    ("law", "words"),
    [
        (lf.Preload(1e3, during=((0.2, 0.3),)), "after 0.2 and not later than 0.3"),
        (lf.Preload(1e3, until=0.5, shortening=1e-4), "not later than 0.5"),
    ],
)
def test_tightening_that_no_step_does_is_refused(law: lf.Preload, words: str) -> None:
    problem = lf.assemble(bar(law))
    refused = f"interface 'bolt': it is tightened {words}, and no step is there"
    with pytest.raises(lf.SceneError, match=refused):
        lf.solve(problem, times=[1.0, 2.0])
    end = 0.3 if "0.3" in words else 0.5
    assert lf.solve(problem, times=[end, 1.0]).converged
    if "0.3" in words:
        assert lf.solve(problem, times=[0.1, 0.2]).converged  # a history that ends before


def pushed(force: object = 1e3) -> lf.Problem:
    """Tightened by a force, and then the ends are pushed together by what makes 2 kN."""
    push = lf.Amplitude([1, 2], [0, 1])
    stiffness = 1.0 / (40.0 / (E * 100.0))
    scene = lf.Scene()
    for name, x in (("left", 0.0), ("right", 20.0)):
        box = geometry.box((20.0, 10.0, 10.0), (1, 1, 1), origin=(x, 0, 0), cell="hexahedron")
        scene.substructure(name, box, lf.LinearElastic(E, 0.0), degree=1)
    scene.interface("bolt", "left:x1", "right:x0", lf.Preload(force, until=1.0))
    scene.fix("left:x0")
    scene.fix("right:x1", push * (-2e3 / stiffness, 0.0, 0.0))
    return lf.assemble(scene)


def test_a_locked_bolt_that_pushes_is_named() -> None:
    with pytest.warns(lf.SceneWarning, match="'bolt': the bolt pushes with 1000 at t = 2: "):
        lf.solve(pushed(), times=[1.0, 2.0])


def test_a_locked_bolt_that_pushes_is_named_once_for_all_points() -> None:
    """2 kN less the preload at every point: the least one pushes hardest, 2.5 kN and more do not."""
    problem = pushed(lf.Uniform("force", 5e2, 3.5e3))
    times, forces = [1.0, 2.0], [3e3, 1.5e3, 1e3, 2.5e3]

    def told(count: int, work: Callable[[], object], match: str) -> None:
        with warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("always")
            work()
        assert len(found) == count
        assert all(re.search(match, str(each.message)) for each in found)

    def swept(values: list[float]) -> Callable[[], object]:
        return lambda: lf.sweep(pushed(), {"bolt.force": values}, times=times, progress=False)

    told(1, swept(forces), "'bolt': .* with 1000 at t = 2 at sweep point 2, the most of 2 of 4 sweep points")
    told(0, swept([2.5e3, 3e3]), "")
    germs = (np.array(forces)[:, None] - 2e3) / 1.5e3
    told(
        1,
        lambda: lf.sample(problem, germs, times=times, progress=False),
        "'bolt': .* with 1000 at t = 2 at sample 2, the most of 2 of 4 samples",
    )
    at = problem.function("bolt", times=times)
    x = np.array(forces)[:, None]
    told(1, lambda: at(x), "'bolt': .* with 1000 at t = 2 at point 2, the most of 2 of 4 points")
    told(0, lambda: at(x - 1.0), "")  # named once


def test_a_bolt_as_a_beam() -> None:
    k = lf.BoltStiffness.of_cylinders([(30.0, 8.0)], E)
    assert k.axial == pytest.approx(E * math.pi * 16 / 30)
    scene = lf.Scene()
    for number, part in enumerate("ab"):
        box = geometry.box((10, 10, 20), (2, 2, 2), origin=(0, 0, 50 * number))
        scene.substructure(part, box, lf.LinearElastic(1e6 * E, 0.0), degree=1)
    scene.fix("a:z0")
    scene.beam("bolt", "a:z1", "b:z0", k)
    scene.force("b:z0", (300.0, 0, 500.0), name="f")
    problem = lf.assemble(scene)
    result = lf.solve(problem)
    inertia = math.pi * 8.0**4 / 64
    ends = [lf.AtPoint(problem, "b", (5, 5, 50), component=c) for c in "xz"]
    moved = [float(result.quantity(p).values[0]) for p in ends]
    assert moved == pytest.approx([300 * 30**3 / (3 * E * inertia), 500 / k.axial], rel=1e-4)
    assert "a beam" in str(result.plan)


def test_a_beam_is_free_before_its_turn_and_unstressed_by_it() -> None:
    """A block on a bed is sheared, bolted down, and sheared and turned more: before its turn the bolt is not
    there, and afterwards it bears its part of what is added, as a beam that was there from the beginning."""
    k = lf.BoltStiffness.of_cylinders([(30.0, 8.0)], E)
    shear = lf.Amplitude([0, 1, 3, 4], [0, 1, 1, 4])

    def solved(preload: Any = None, beam: bool = True, in_time: bool = True) -> lf.Result:
        scene = lf.Scene()
        for number, part in enumerate("ab"):
            box = geometry.box((10, 10, 10), (1, 1, 1), origin=(0, 0, 40 * number), cell="hexahedron")
            scene.substructure(part, box, lf.LinearElastic(E, 0.0), degree=1)
        scene.fix("a:z0")
        scene.interface("bed", "b:z1", lf.Elastic(normal=60.0, tangential=30.0))
        for key, size in (("force", (300.0, 200.0, 0.0)), ("twist", (0.0, 100.0, 0.0))):
            face = "b:z0" if key == "force" else "b:z1"
            scene.force(face, shear * size if in_time else tuple(3.0 * x for x in size), name=key)
        if beam:
            scene.beam("bolt", "a:z1", "b:z0", k, preload)
        kind = {"times": [1.0, 2.0, 3.0, 4.0]} if in_time else {}
        return lf.solve(lf.assemble(scene), options=Options(rtol=1e-9), progress=False, **kind)

    turned = solved(lf.Preload(1e3, during=((2.0, 3.0),)))
    without, added = solved(beam=False), solved(in_time=False)
    size = np.abs(without.unknowns("b")).max()
    for step in (0, 1):
        for part in "ab":
            assert turned.unknowns(part)[step] == pytest.approx(without.unknowns(part)[step], abs=1e-8 * size)
    change = turned.unknowns("b")[3] - turned.unknowns("b")[2]
    assert change == pytest.approx(added.unknowns("b"), abs=1e-7 * size)
    most = abs(added.table().value("normal", "bolt.shear1"))
    for way in ("bending1", "bending2", "shear1", "shear2", "torsion"):
        right = [0.0, 0.0, 0.0, added.table().value("normal", f"bolt.{way}")]
        assert turned.force(f"bolt.{way}")[:, 0, 0] == pytest.approx(right, abs=1e-6 * most)
    assert list(turned.bolts().columns["interface"]) == ["bolt.axial"]


def test_a_preloaded_beam_clamps_a_joint() -> None:
    k = lf.BoltStiffness.of_cylinders([(20.0, 8.0)], E)
    clamped = E * 100.0 / 20.0
    scene = lf.Scene()
    for number, part in enumerate("ab"):
        box = geometry.box((10, 10, 10), (2, 2, 2), origin=(0, 0, 10 * number))
        scene.substructure(part, box, lf.LinearElastic(E, 0.0), degree=1)
    scene.symmetry(["a:x0", "a:y0", "b:x0", "b:y0"])
    scene.fix_point("a", (0, 0, 0), components=2, name="point")
    scene.interface("joint", "a:z1", "b:z0", lf.Contact())
    scene.beam("bolt", "a:z0", "b:z1", k, lf.Preload(force=1e4, until=1))
    scene.force("b:z1", lf.Amplitude([1, 2], [0, 1]) * (0.0, 0.0, 1000.0), name="pull")
    scene.force("a:z0", lf.Amplitude([1, 2], [0, 1]) * (0.0, 0.0, -1000.0), name="other")
    result = lf.solve(lf.assemble(scene), times=[1, 2], options=Options(rtol=1e-9))
    shared = 1000.0 * k.axial / (k.axial + clamped)
    assert result.force("bolt.axial")[:, 0, 0] == pytest.approx([1e4, 1e4 + shared], rel=1e-6)


def heated(**bolt: Any) -> lf.Result:
    """Two blocks that a bolt clamps with 10 kN, then 50 K warmer."""
    scene, warm = lf.Scene(), lf.Amplitude([1, 2], [0, 1])
    for number, part in enumerate("ab"):
        block = geometry.box((10, 10, 10), (1, 1, 1), origin=(0, 0, 10 * number), cell="hexahedron")
        scene.substructure(part, block, lf.LinearElastic(E, 0.0, alpha=1e-5), degree=1)
        scene.symmetry([f"{part}:x0", f"{part}:y0"])
        scene.temperature(part, warm * 50.0)
    scene.fix("a:z0", components=2)
    scene.interface("joint", "a:z1", "b:z0", lf.Contact())
    scene.beam("bolt", "a:z0", "b:z1", lf.BoltStiffness(5e5, 1.0, 1.0), lf.Preload(1e4, until=1, **bolt))
    return lf.solve(lf.assemble(scene), times=[1, 2], options=Options(rtol=1e-9))


def test_a_bolt_stays_cold_and_says_so() -> None:
    """It takes what the blocks grow by, in series with them; one that grows as they do keeps its force."""
    with pytest.warns(lf.SceneWarning, match="beam 'bolt': .* no temperature .*shortening=-alpha"):
        cold = heated().force("bolt.axial")[:, 0, 0]
    grows = 1e-5 * 50.0 * 20.0
    assert cold == pytest.approx([1e4, 1e4 + grows / (1 / 5e5 + 20.0 / (E * 100.0))], rel=1e-6)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warm = heated(shortening=lf.Amplitude([1, 2], [0, 1]) * -grows).force("bolt.axial")[:, 0, 0]
    assert warm == pytest.approx([1e4, 1e4], rel=1e-6)


@pytest.mark.parametrize(
    ("tightened", "said"),
    [
        ({"force": 1.2e5}, r"to 1.2e\+05 the bolt is 0.012 of its length 20 longer, more than 1%"),
        ({"torque": 40.0}, r"is the torque in N m, with a mesh in mm\? Then it is 1000 times as large"),
        ({"torque": 40e3}, ""),
    ],
)
def test_a_preload_that_no_bolt_has_is_told(tightened: dict[str, float], said: str) -> None:
    thread = {"mu_thread": 0.12, "mu_head": 0.12, "d": 10.0, "pitch": 1.5} if "torque" in tightened else {}
    scene = lf.Scene()
    for number, part in enumerate("ab"):
        block = geometry.box((10, 10, 10), (1, 1, 1), origin=(0, 0, 10 * number), cell="hexahedron")
        scene.substructure(part, block, lf.LinearElastic(E, 0.0), degree=1)
    scene.fix(["a:z0", "b:z1"])
    bolt = lf.BoltStiffness(5e5, 1.0, 1.0)
    scene.beam("bolt", "a:z0", "b:z1", bolt, lf.Preload(**tightened, **thread))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        lf.assemble(scene)
    assert len(caught) == bool(said) and (not said or re.search(said, str(caught[0].message)))


@pytest.mark.parametrize(
    ("thread", "said"), [(15.0, ""), (35.0, "clamps 45.5, its faces are 20 apart"), (0.0, "")]
)
def test_a_bolt_of_another_length_is_told(thread: float, said: str) -> None:
    scene = lf.Scene()
    for number, part in enumerate("ab"):
        block = geometry.box((10, 10, 10), (1, 1, 1), origin=(0, 0, 10 * number), cell="hexahedron")
        scene.substructure(part, block, lf.LinearElastic(E, 0.0), degree=1)
    scene.fix(["a:z0", "b:z1"])
    bolt = lf.BoltStiffness.vdi2230(d=8.0, pitch=1.25, shank=10.5, thread=thread, E=E)
    scene.beam("bolt", "a:z0", "b:z1", bolt)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        lf.assemble(scene)
    assert len(caught) == bool(said) and all(said in str(each.message) for each in caught)


def test_a_bolt_that_is_not_square_to_a_face_is_told() -> None:
    """From (5, 5, 0) to (10, 5, 15)."""
    scene = lf.Scene()
    for number, part in enumerate("ab"):
        block = geometry.box((10, 10, 10), (1, 1, 1), origin=(0, 0, 10 * number), cell="hexahedron")
        scene.substructure(part, block, lf.LinearElastic(E, 0.0), degree=1)
    scene.fix(["a:z0", "b:z1"])
    scene.beam("bolt", "a:z0", "b:x1", lf.BoltStiffness(5e5, 1.0, 1.0), lf.Preload(1e4))
    with pytest.warns(lf.SceneWarning, match="'bolt.axial': the bolt is 72 degrees off the normal of 'b:x1'"):
        lf.assemble(scene)


# --- axisymmetric parts ----------------------------------------------------------------------------
def lame(a: float, b: float, inside: float, outside: float, r: Any) -> tuple[Any, Any, Any]:
    """Radial and hoop stress and displacement of a thick cylinder in plane strain."""
    A = (inside * a * a - outside * b * b) / (b * b - a * a)
    B = (inside - outside) * a * a * b * b / (b * b - a * a)
    return A - B / r**2, A + B / r**2, (1 + NU) / E * ((1 - 2 * NU) * A * r + B / r)


def test_a_thick_cylinder() -> None:
    errors = []
    for n in (4, 8):
        scene = lf.Scene(axisymmetric=True)
        box = geometry.box((10, 4), (n, 2), origin=(10, 0))
        scene.substructure("c", box, lf.LinearElastic(E, NU), degree=2)
        scene.pressure("c:x0", 100.0, name="p")
        scene.fix(["c:y0", "c:y1"], components=1)
        problem = lf.assemble(scene)
        result = lf.solve(problem)
        part = problem.substructures["c"]
        assert part.volume == pytest.approx(math.pi * 300 * 4, rel=1e-12)
        u = result.unknowns("c").reshape(-1, 2)[:, 0]
        exact = lame(10, 20, 100, 0, part.dof_coordinates[:, 0])[2]
        errors.append(float(np.abs(u - exact).max() / exact.max()))
        hoop = lf.AtPoint(problem, "c", (15.0, 2.0), "stress", "zz")
        # of quadratic elements at a vertex: (h / r)^2 of the stress
        tolerance = (10.0 / n / 15.0) ** 2
        assert result.quantity(hoop).values[0] == pytest.approx(lame(10, 20, 100, 0, 15.0)[1], rel=tolerance)
    assert errors[1] < errors[0] / 8 and errors[1] < 1e-5


@pytest.mark.parametrize(
    ("law", "other"), [(lf.Contact(gap=-0.02), 8), (lf.Contact(gap=-0.02), 6), (lf.Perfect(jump=0.02), 6)]
)
def test_disc_and_ring(law: lf.Law, other: int) -> None:
    scene = lf.Scene(axisymmetric=True)
    disc = geometry.box((5, 4), (8, 4), origin=(5, 0))
    ring = geometry.box((10, 4), (other, 4 if other == 8 else 3), origin=(10, 0))
    scene.substructure("disc", disc, lf.LinearElastic(E, NU), degree=2)
    scene.substructure("ring", ring, lf.LinearElastic(E, NU), degree=2)
    scene.interface("fit", "disc:x1", "ring:x0", law)
    scene.fix(["disc:y0", "disc:y1", "ring:y0", "ring:y1"], components=1)
    result = lf.solve(lf.assemble(scene))
    pressure = 0.02 / (lame(10, 20, 1, 0, 10.0)[2] - lame(5, 10, 0, 1, 10.0)[2])
    assert -result.force("fit")[:, 0] == pytest.approx(pressure, rel=1e-4)
    total_ = result.readings("fit").interfaces["fit"].values["normal"]
    assert -total_ == pytest.approx(pressure * 2 * math.pi * 10 * 4, rel=1e-4)


def sector(n: int, angle: float) -> Any:
    """A ring of 10 < r < 20, 0 < z < 4 as a sector."""
    part = geometry.box((10, 1, 4), (n, 2, 2), origin=(10, 0, 0))
    x = part.mesh.geometry.x
    r, turn = x[:, 0].copy(), angle * x[:, 1]
    x[:, 0], x[:, 1] = r * np.cos(turn), r * np.sin(turn)
    return part


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_a_cone_of_two_meshes_is_under_uniform_stress(cell: str, degree: int) -> None:
    """A bar of two meshes that meet on a cone, down to the axis: weights 2 pi r within facets, exactly."""
    R, h, p = 5.0, 1.5, 100.0
    scene = lf.Scene(axisymmetric=True)
    for name, n, low in (("a", 3, True), ("b", 5, False)):
        part = geometry.box((R, 4), (n, 3), origin=(0, 0 if low else 4), cell=cell)
        x = part.mesh.geometry.x
        share = x[:, 1] / 4 if low else 2 - x[:, 1] / 4
        x[:, 1] += h * share * x[:, 0] / R
        scene.substructure(name, part, lf.LinearElastic(E, NU), degree=degree)
    scene.interface("joint", "a:y1", "b:y0", lf.Perfect())
    scene.fix("a:y0", components=1)
    scene.pressure("b:y1", p, name="p")
    problem = lf.assemble(scene)
    joint = problem.interfaces["joint"]
    assert joint.matching is None and joint.area == pytest.approx(math.pi * R * math.hypot(R, h), rel=1e-12)
    result = lf.solve(problem, active=["joint"], options=Options(rtol=1e-10))
    for name, part in problem.substructures.items():
        exact = part.dof_coordinates[:, :2] * [NU * p / E, -p / E]
        assert result.unknowns(name).reshape(-1, 2) == pytest.approx(exact, abs=1e-8 * 8 * p / E)
    force = np.einsum("pc,pcd->pd", result.force("joint"), joint.frames)
    normal = np.array([-h, R]) / math.hypot(h, R)
    assert force == pytest.approx(np.tile([0.0, -p * normal[1]], (len(force), 1)), abs=1e-6 * p)
    axial = result.readings("joint").interfaces["joint"].values["force_y"]
    assert abs(axial) == pytest.approx(p * math.pi * R**2, rel=1e-7)


def on_sphere(x: Any) -> Any:
    """Radius and angle above the equator to the section (r, z)."""
    return x[:, :1] * np.column_stack([np.cos(x[:, 1]), np.sin(x[:, 1])])


def test_weights_of_curved_rings() -> None:
    """The zone of a sphere between two meshes of quadratic cells: 2 pi R times its height."""
    errors = []
    for n in (3, 6):
        scene = lf.Scene(axisymmetric=True)
        for name, count, start in (("a", n, 1.0), ("b", n + 1, 2.0)):
            part = mapped("quadrilateral", (2, count), (start, 0), (start + 1, math.pi / 3), on_sphere, 2)
            scene.substructure(name, part, lf.LinearElastic(E, NU), degree=2)
        scene.fix("a:y0", components=1)
        scene.fix("b:x1", components=1)
        scene.interface("joint", "a:x1", "b:x0", lf.Perfect())
        exact = 2 * math.pi * 2.0 * 2.0 * math.sin(math.pi / 3)
        errors.append(abs(lf.assemble(scene).interfaces["joint"].area / exact - 1.0))
    assert errors[1] < errors[0] / 8 and errors[1] < 1e-5


def test_a_flange_is_its_sector() -> None:
    """A ring on its outer edge that is pushed at its inner one, against 6 degrees of it in 3D."""
    angle, n = math.radians(6.0), 6
    flat = lf.Scene(axisymmetric=True)
    flat.substructure("c", geometry.box((10, 4), (n, 2), origin=(10, 0)), lf.LinearElastic(E, NU), degree=2)
    flat.fix("c:x1", components=1)
    flat.force("c:x0", (0.0, -1000.0), name="push")
    turned = lf.assemble(flat)
    solid = lf.Scene()
    solid.substructure("c", sector(n, angle), lf.LinearElastic(E, NU), degree=2)
    solid.symmetry(["c:y0", "c:y1"])
    solid.fix("c:x1", components=2)
    solid.force("c:x0", (0.0, 0.0, -1000.0 * angle / (2 * math.pi)), name="push")
    whole = lf.assemble(solid)
    u = float(lf.solve(turned).quantity(lf.AtPoint(turned, "c", (10, 2), component="y")).values[0])
    v = float(lf.solve(whole).quantity(lf.AtPoint(whole, "c", (10, 0, 2), component="z")).values[0])
    assert u == pytest.approx(v, rel=2e-3)
    assert turned.size * 5 < whole.size


def test_an_axisymmetric_body_moves_along_its_axis_only() -> None:
    scene = lf.Scene(axisymmetric=True)
    box = geometry.box((10, 4), (4, 2))
    scene.substructure("c", box, lf.LinearElastic(E, NU, alpha=1e-5), degree=2)
    scene.temperature("c", 100.0)
    with pytest.raises(lf.SceneError, match="'c' can move freely: translation along y\n"):
        lf.assemble(scene)
    scene.fix("c:y0", components=1)
    result = lf.solve(lf.assemble(scene))
    assert np.abs(result.stress("c").x.array).max() < 1e-10 * E * 1e-3


# --- bad input -------------------------------------------------------------------------------------
def test_bad_loads_are_refused_by_name() -> None:
    scene = block()
    with pytest.raises(lf.SceneError, match="dT = 5.* without a coefficient of expansion: give alpha="):
        scene.temperature("a", 5.0)
    with pytest.raises(lf.SceneError, match="load 'heat': dT = nan"):
        scene.temperature("a", float("nan"), 1e-5, name="heat")
    scene.rigid("a:z1", name="head")
    with pytest.raises(lf.SceneError, match="a:z1 is rigid already by 'head'"):
        scene.plane("a:z1")
    scene.fix("a:z1", name="held")
    with pytest.raises(lf.SceneError, match="interface 'held': a:z1 is rigid by 'head'"):
        lf.assemble(scene)
    with pytest.raises(lf.SceneError, match="mu_thread = 0, mu_head = 0 and pitch = 0"):
        lf.Preload(torque=1.0, mu_thread=0.0, mu_head=0.0, d=12.0, pitch=0.0)
    with pytest.raises(lf.SceneError, match="torque = 1.* needs mu_thread, mu_head, d, pitch"):
        lf.Preload(torque=1.0)
    scene = block()
    scene.fix("a:z0")
    scene.point_force("a", (9, 9, 9), (1, 0, 0), name="far")
    with pytest.raises(lf.SceneError, match=r"load 'far': the point \(9, 9, 9\) is .* outside"):
        lf.assemble(scene)
    scene = block()
    scene.fix_point("a", (0.1, 0, 0), name="point")
    with pytest.raises(lf.SceneError, match="interface 'point': there is no node"):
        lf.assemble(scene)
    with pytest.raises(lf.SceneError, match="load 'w': x = .*; give a finite number"):
        block().body_force("a", ("1", 0, 0), name="w")


@pytest.mark.parametrize("law", [lf.Elastic(1e4, 1e4), lf.Displacement(0.0), lf.Symmetry()])
def test_inertia_balances_what_nothing_holds(law: Any) -> None:
    scene = lf.Scene()
    scene.inertia_relief(7.8e-9)
    scene.substructure("a", geometry.box((10, 10, 25), (1, 1, 2)), lf.LinearElastic(E, 0.0), degree=1)
    scene.interface("bed", "a:z0", law)
    with pytest.raises(lf.SceneError, match="'bed': nothing may hold an assembly whose loads inertia"):
        lf.assemble(scene)


def test_a_point_is_found_again_in_other_meshes() -> None:
    def bar(n: int) -> lf.Problem:
        scene = lf.Scene()
        scene.substructure("a", geometry.box((10, 10, 40), (1, 1, n)), lf.LinearElastic(E, 0.0), degree=2)
        scene.fix("a:z0", components=2)
        scene.symmetry(["a:x0", "a:y0"])
        scene.body_force("a", (0, 0, 1e-2))
        return lf.assemble(scene)

    coarse, fine = bar(2), bar(5)
    exact = 1e-2 / E * (40.0 * 12.0 - 0.5 * 12.0**2)
    for of, component, wanted in (("displacement", "z", exact), ("stress", "zz", 1e-2 * (40.0 - 12.0))):
        probe = lf.AtPoint(coarse, "a", (5, 5, 12.0), of, component)
        assert lf.solve(fine).quantity(probe).values[0] == pytest.approx(wanted, rel=1e-8)


@pytest.mark.parametrize("call", ["force", "body_force", "point_force", "traction", "moment"])
def test_vectors_have_the_components_of_the_space(call: str) -> None:
    scene = lf.Scene()
    scene.substructure("a", geometry.box((10, 10, 25), (1, 1, 2)), lf.LinearElastic(E, 0.0), degree=1)
    short = (lf.Normal("q", 1.0, cov=0.1), 2.0)
    calls = {
        "force": lambda: scene.force("a:z1", short),
        "body_force": lambda: scene.body_force("a", short),
        "point_force": lambda: scene.point_force("a", (5, 5, 25), short),
        "traction": lambda: scene.traction("a:z1", short),
        "moment": lambda: scene.force("a:z1", None, 7.0),
    }
    with pytest.raises(lf.SceneError, match="give 3"):
        calls[call]()


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize(
    "profile", [lambda r: r**2 / 100 - 0.02, lambda r: 0.02 * r - 0.02, lambda r: 0.0 * r - 0.02],
    ids=["ball", "cone", "plate"],
)
def test_an_axisymmetric_block_under_a_rigid_punch(profile: Any, degree: int) -> None:
    """One-sided contact that reaches the axis gives what a punch of a thousand times the stiffness gives."""
    forces = []
    for two in (False, True):
        scene = lf.Scene(axisymmetric=True)
        block = geometry.box((20, 20), (50, 25))
        scene.substructure("block", block, lf.LinearElastic(1000.0, NU), degree=degree)
        scene.fix("block:y0")
        contact = lf.Contact(gap=lambda x: profile(x[:, 0]))
        if two:
            punch = geometry.box((20, 5), (50, 4), origin=(0, 20))
            scene.substructure("punch", punch, lf.LinearElastic(1e8, NU), degree=degree)
            scene.fix("punch:y1")
            scene.interface("stop", "block:y1", "punch:y0", contact)
        else:
            scene.interface("stop", "block:y1", contact)
        problem = lf.assemble(scene)
        stop = problem.interfaces["stop"]
        assert len(stop.points) >= 50  # no multiplier is lost near the axis
        assert stop.weights.sum() == pytest.approx(math.pi * 20**2, rel=1e-9)
        result = lf.solve(problem)
        assert result.converged
        forces.append(float(result.force("stop")[:, 0] @ stop.weights))
    assert forces[0] == pytest.approx(forces[1], rel=1e-3)
