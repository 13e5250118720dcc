"""Scenes in which the way to an answer decides, or in which there is none: Newton's method in steps."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
import pytest

import dolfinx_frontend as lf
from dolfinx_frontend import geometry
from parts.rings import annulus

SLOPE = math.radians(10.0)


@pytest.fixture(scope="module")
def wedge() -> Any:
    """A wedge of 10 degrees, held on its straight side in the direction across."""
    with geometry.gmsh_session() as gmsh:
        occ = gmsh.model.occ
        corners = [(0, 0), (5, 0), (5 + 20 * math.tan(SLOPE), 20), (0, 20)]
        points = [occ.addPoint(x, y, 0) for x, y in corners]
        lines = [occ.addLine(points[i], points[(i + 1) % 4]) for i in range(4)]
        face = occ.addPlaneSurface([occ.addCurveLoop(lines)])
        occ.synchronize()
        gmsh.model.addPhysicalGroup(2, [face], name="wedge")
        for line, name in zip(lines, ("tip", "wall", "top", "mid"), strict=True):
            gmsh.model.addPhysicalGroup(1, [line], name=f"wedge:{name}")
        gmsh.option.setNumber("Mesh.MeshSizeMax", 2.0)
        gmsh.model.mesh.generate(2)
        return geometry.from_gmsh(gmsh.model, 2).parts["wedge"]


def pushed(part: Any, path: list[float], times: Any) -> lf.HistoryResult:
    """Pressed down by 1 kN times the path."""
    scene = lf.Scene()
    scene.substructure("wedge", part, lf.LinearElastic(70e3, 0.3))
    scene.fix("wedge:mid", 0.0, components=0)
    scene.interface("wall", "wedge:wall", lf.Contact(gap=0.0, friction=0.3))
    push = lf.Amplitude(list(range(len(path))), path) * -1000.0
    scene.force("wedge:top", (0, push), name="push")
    return lf.solve(lf.assemble(scene), times=times, progress=False)


def wall(result: lf.HistoryResult) -> np.ndarray[Any, Any]:
    """(T, 2): resultants of the wall, normal and tangential."""
    return np.einsum("tpc,p->tc", result.force("wall"), result.problem.interfaces["wall"].weights)


def test_a_jam_outlasts_its_load(wedge: Any) -> None:
    """Too flat to slip out: with no load the wall's force is along the held direction, T / N = tan 10."""
    times = np.linspace(0.25, 2.0, 8)
    little = wall(pushed(wedge, [0, 1, 1e-6], times))
    result = pushed(wedge, [0, 1, 0], times)
    none = wall(result)
    assert result.converged
    assert none[-1, 1] / none[-1, 0] == pytest.approx(math.tan(SLOPE), rel=1e-6)
    assert none[-1] == pytest.approx(little[-1], rel=1e-5)
    again = wall(pushed(wedge, [0, 1, 0, 0.2], np.linspace(0.25, 3.0, 12)))
    assert again[7] == pytest.approx(none[-1], rel=1e-6)
    assert -again[-1, 0] > -none[-1, 0]  # pressed further from where it is


def test_steps_before_one_without_equilibrium_are_answers(wedge: Any) -> None:
    """Pulled out at the end: the steps before are those of the history that ends before."""
    before = pushed(wedge, [0, 1, -0.2], 0.25 * np.arange(1, 8))
    assert before.converged
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        result = pushed(wedge, [0, 1, -0.2], 0.25 * np.arange(1, 9))
    assert result.status == "no_equilibrium"
    assert result.statuses == ("converged",) * 7 + ("no_equilibrium",)
    assert np.isnan(result.step_errors[-1]) and result.step_errors[:-1].max() <= 1e-6
    assert wall(result)[:7] == pytest.approx(wall(before), rel=1e-5, abs=1e-5)
    assert any("'wedge' has lost its support at step 7" in str(each.message) for each in told)


def strap(law: Any, pull: float, steps: int) -> tuple[lf.HistoryResult, float]:
    """A strap glued on a held block, and the force that pulls it."""
    scene = lf.Scene()
    steel = lf.LinearElastic(70e3, 0.3, plane="stress")
    scene.substructure("base", geometry.box((40, 5), (20, 3), origin=(0, -5)), steel)
    scene.substructure("strap", geometry.box((40, 2), (24, 2)), steel)
    scene.interface("bond", "strap:y0", "base:y1", law)
    scene.fix("base:y0")
    scene.fix("strap:x1", lf.Amplitude([0, 1], [0, pull]) * 1.0, components=0, name="pull")
    result = lf.solve(lf.assemble(scene), times=np.linspace(1 / steps, 1, steps), progress=False)
    return result, float(result.table(step=steps - 1).value("force_x", "pull"))


@pytest.mark.parametrize("ratio, share", [(1.5, 0.3), (10.0, 0.6), (30.0, 0.9)])
def test_glue_below_its_strength_stays_whole(ratio: float, share: float) -> None:
    """Until the first point is at the strength the bond is its springs, however far it could open."""
    stiffness, strength = 1e6, 60.0
    springs, force = strap(lf.Elastic(normal=stiffness, tangential=stiffness), 1.0, 1)
    largest = np.linalg.norm(springs.force("bond")[-1], axis=1).max()
    pull = share * strength / largest
    opening = ratio * strength / stiffness
    law = lf.Debonding(normal=stiffness, tangential=stiffness, strength=strength, opening=opening)
    for steps in (1, 4, 16):
        result, found = strap(law, pull, steps)
        assert result.converged
        assert found == pytest.approx(pull * force, rel=1e-6)
        assert result.iterations < 40


def plates(x: float) -> lf.HistoryResult:
    """Three plates under a bolt of 10 kN; the outer ones are pulled by x times what friction holds."""
    scene, steel = lf.Scene(), lf.LinearElastic(200e3, 0.3)
    bolt = lf.BoltStiffness.vdi2230(d=12, pitch=1.75, shank=10, thread=5, E=205e3)
    for k in range(3):
        box = geometry.box((40, 40, 5), (4 + k, 4 + k, 1), origin=(0, 0, 5 * k))
        scene.substructure(f"p{k}", box, steel)
    for k in (0, 1):
        scene.interface(f"j{k}", f"p{k}:z1", f"p{k + 1}:z0", lf.Contact(friction=0.2))
    scene.beam("bolt", "p0:z0", "p2:z1", bolt, lf.Preload(10e3 * lf.Amplitude([0, 1], [0, 1]), until=1.0))
    scene.fix("p1:x0")
    for part in ("p0", "p2"):
        pull = lf.Amplitude([1, 2], [0, 1]) * (x * 0.2 * 10e3 / 200, 0.0, 0.0)
        scene.traction(f"{part}:x1", pull)
    return lf.solve(lf.assemble(scene), times=[1.0, 1.5, 2.0], progress=False)


def test_a_friction_joint_below_and_above_its_limit() -> None:
    """Bending of the plates changes the clamping by a per cent or two: 0.9 holds, 1.2 does not."""
    assert plates(0.9).converged
    with pytest.warns(lf.SceneWarning, match="has lost its support at step 2.*along x"):
        result = plates(1.2)
    assert result.statuses == ("converged", "converged", "no_equilibrium")


def fit(load: float) -> lf.HistoryResult:
    """A shaft pressed into a held hub and turned, by a share of 2 pi r^2 mu p with p of Lame."""
    a, b, c, interference, mu, modulus, nu = 4.0, 10.0, 25.0, 0.01, 0.15, 210e3, 0.3

    def moved(inner: float, outer: float, p_in: float, p_out: float, r: float) -> float:
        square = outer**2 - inner**2
        uniform = (1 - 2 * nu) * (p_in * inner**2 - p_out * outer**2) / square * r
        return (1 + nu) / modulus * (uniform + (p_in - p_out) * inner**2 * outer**2 / (square * r))

    def apart(p: float) -> float:
        rim = moved(b, c, p, 0, c) / moved(b, c, 0, 1, c)
        return moved(a, b, 0, p, b) - moved(b, c, p, -rim, b) + interference

    pressure = -apart(0) / (apart(1) - apart(0))
    shear = load * 2 * math.pi * b * b * mu * pressure / (2 * math.pi * a * a)
    scene, steel = lf.Scene(), lf.LinearElastic(modulus, nu)
    scene.substructure("shaft", annulus(a, b, 2 * math.pi, divisions=(3, 16)), steel)
    scene.substructure("hub", annulus(b, c, 2 * math.pi, divisions=(4, 16)), steel)
    scene.fix("hub:outer")
    scene.interface("fit", "shaft:outer", "hub:inner", lf.Contact(gap=-interference, friction=mu))

    def around(x: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        return np.asarray(shear * np.column_stack([-x[:, 1], x[:, 0]]) / np.hypot(x[:, 0], x[:, 1])[:, None])

    scene.traction("shaft:inner", lf.Amplitude([1, 2], [0, 1]) * around)
    return lf.solve(lf.assemble(scene), times=[1.0, 2.0], progress=False)


def test_a_press_fit_turned_past_its_slip_torque() -> None:
    """Quadratic cells of 22 degrees carry 2 % more or less of Lame's pressure: 0.9 holds, 1.2 slips."""
    assert fit(0.9).converged
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        result = fit(1.2)
    assert result.statuses == ("converged", "no_equilibrium")


@pytest.mark.parametrize("modulus, friction", [(20.0, 0.12), (200.0, 0.5), (2000.0, 0.12)])
def test_a_thin_sheet_between_two_plates(modulus: float, friction: float) -> None:
    """Clamped by 4 x 12 kN, friction on both sides: both faces carry it, without a tangential resultant."""
    scene = lf.Scene()
    plates = (("base", -12, 12, 210e3, 0.3, 2), ("foot", 2, 10, 70e3, 0.33, 2))
    layers = (*plates, ("sheet", 0, 2, modulus, 0.4, 1))
    for name, z, thick, own, nu, cells in layers:
        box = geometry.box((200, 120, thick), (14, 7, cells), origin=(-100, -60, z), cell="hexahedron")
        scene.substructure(name, box, lf.LinearElastic(own, nu), degree=1)
    scene.interface("lower", "base:z1", "sheet:z0", lf.Contact(gap=0.0, friction=friction))
    scene.interface("upper", "sheet:z1", "foot:z0", lf.Contact(gap=0.0, friction=0.12))
    scene.fix("base:x0")

    def heads(x: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        under = (abs(abs(x[:, 0]) - 75) < 12) & (abs(abs(x[:, 1]) - 40) < 12)
        return np.asarray(30.0 * under)

    scene.pressure("foot:z1", heads)
    scene.pressure("base:z0", heads)
    result = lf.solve(lf.assemble(scene), options=lf.Options(newton=1), progress=False)
    assert result.converged
    assert result.summary.newton_steps <= 40
    resultants = [result.problem.interfaces[n].weights @ result.force(n) for n in ("lower", "upper")]
    assert resultants[0] == pytest.approx(resultants[1], abs=1e-4 * abs(resultants[0][0]))
    assert abs(resultants[0][1:]).max() <= 1e-4 * abs(resultants[0][0])


@pytest.mark.parametrize(("degree", "cell"), [(1, "hexahedron"), (2, "tetrahedron")])
def test_what_no_displacement_sees_is_no_pressure(degree: int, cell: str) -> None:
    """A pressed stack: 10 MPa everywhere on welds, beside friction that Newton's method solves."""
    scene = lf.Scene()
    for k in range(4):
        box = geometry.box((20.0, 10.0, 5.0), (4, 2, 1), origin=(0.0, 0.0, 5.0 * k), cell=cell)
        scene.substructure(f"p{k}", box, lf.LinearElastic(210e3, 0.0), degree=degree)
    scene.interface("foot", "p0:z0", lf.Symmetry())
    scene.interface("weld", "p0:z1", "p1:z0", lf.Perfect())
    scene.interface("glue", "p1:z1", "p2:z0", lf.Perfect())
    scene.interface("slide", "p2:z1", "p3:z0", lf.Contact(gap=0.0, friction=0.3))
    scene.interface("side", "p0:x0", lf.Symmetry())
    scene.interface("back", "p0:y0", lf.Symmetry())
    scene.interface("guide", "p3:x0", lf.Symmetry())
    scene.pressure("p3:z1", lf.Amplitude([0.0, 1.0, 2.0], [0.0, 10.0, 5.0]) * 1.0)
    result = lf.solve(
        lf.assemble(scene), active="all", times=[1.0, 2.0], options=lf.Options(rtol=1e-8), progress=False
    )
    assert result.converged
    for name in ("foot", "weld", "glue", "slide"):
        for step, pressure in enumerate((10.0, 5.0)):
            assert result.force(name)[step, :, 0] == pytest.approx(-pressure, rel=1e-9)
