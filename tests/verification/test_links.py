"""Sums of displacements of nodes, given or with a spring, and supports along own axes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import dolfinx_frontend as lf

E, L = 1000.0, 10.0


def rods(*names: str) -> lf.Scene:
    """Rods of 1 x 1 x L side by side along x, nu = 0; they are held but for the displacement along x."""
    scene = lf.Scene()
    for k, name in enumerate(names):
        rod = lf.geometry.box((L, 1.0, 1.0), (4, 1, 1), origin=(0.0, 2.0 * k, 0.0), cell="hexahedron")
        scene.substructure(name, rod, lf.LinearElastic(E, 0.0), degree=1)
        scene.rigid(f"{name}:x1", name=f"{name} end", y=0.0, z=0.0, rx=0.0, ry=0.0, rz=0.0)
    return scene


def solved(scene: lf.Scene, **options: object) -> lf.Result:
    result = lf.solve(lf.assemble(scene), progress=False, options=lf.Options(rtol=1e-10), **options)
    assert result.status == "converged"
    return result


def moved(result: lf.Result, part: str, point: object, axis: str = "x") -> float:
    probe = lf.AtPoint(result.problem, part, point, "displacement", axis)
    return float(np.ravel(result.quantity(probe).values)[0])


@pytest.mark.parametrize("stiffness", [50.0, None])
def test_two_rods_and_a_link(stiffness: float | None) -> None:
    """The ends of two rods, one is pulled: a spring in series, or u_2 - u_1 = 0.01."""
    scene = rods("one", "two")
    scene.fix(["one:x0", "two:x0"])
    scene.traction("two:x1", (3.0, 0.0, 0.0))
    terms = [("one", (L, 0.0, 0.0), (-1.0, 0.0, 0.0)), ("two", (L, 2.0, 0.0), (1.0, 0.0, 0.0))]
    scene.link("link", terms, 0.0 if stiffness else 0.01, stiffness)
    k = E / L
    result = solved(scene)
    assert stiffness or "it joins several nodes" in str(result.plan)
    if stiffness:  # k u1 = s (u2 - u1), k u2 + s (u2 - u1) = 3
        u1, u2 = np.linalg.solve([[k + stiffness, -stiffness], [-stiffness, k + stiffness]], [0.0, 3.0])
    else:  # k u1 + k (u1 + 0.01) = 3
        u1 = (3.0 - 0.01 * k) / (2.0 * k)
        u2 = u1 + 0.01
    assert moved(result, "one", (L, 0.0, 0.0)) == pytest.approx(u1, rel=1e-7)
    assert moved(result, "two", (L, 2.0, 0.0)) == pytest.approx(u2, rel=1e-7)
    assert float(np.ravel(result.force("link"))[0]) == pytest.approx(k * u1, rel=1e-7)


@pytest.mark.parametrize("force", [-10.0, -3.0, 10.0])
@pytest.mark.parametrize("stiffness", [50.0, None])
def test_a_stop_between_two_rods(force: float, stiffness: float | None) -> None:
    """The end of one may come .05 nearer to that of the other: then P (2 / k + 1 / s) = F / k - .05."""
    scene = rods("one", "two")
    scene.fix(["one:x0", "two:x0"])
    scene.traction("two:x1", (force, 0.0, 0.0))
    terms = [("one", (L, 0.0, 0.0), (-1.0, 0.0, 0.0)), ("two", (L, 2.0, 0.0), (1.0, 0.0, 0.0))]
    scene.link("stop", terms, stiffness=stiffness, gap=0.05)
    k = E / L
    pressed = max(-force / k - 0.05, 0.0) / (2.0 / k + (1.0 / stiffness if stiffness else 0.0))
    result = solved(scene)
    assert moved(result, "one", (L, 0.0, 0.0)) == pytest.approx(-pressed / k, abs=1e-9)
    assert moved(result, "two", (L, 2.0, 0.0)) == pytest.approx((force + pressed) / k, abs=1e-9)
    assert float(np.ravel(result.force("stop"))[0]) == pytest.approx(-pressed, abs=1e-7)


def test_a_random_gap() -> None:
    """Forces of a stop that closes in all samples: (F / k - gap) k / 2."""
    scene = rods("one", "two")
    scene.fix(["one:x0", "two:x0"])
    scene.traction("two:x1", (-10.0, 0.0, 0.0))
    terms = [("one", (L, 0.0, 0.0), (-1.0, 0.0, 0.0)), ("two", (L, 2.0, 0.0), (1.0, 0.0, 0.0))]
    scene.link("stop", terms, gap=lf.Uniform("gap", 0.02, 0.06))
    chaos = lf.solve(lf.assemble(scene), chaos=1, progress=False, options=lf.Options(rtol=1e-10))
    assert float(np.ravel(chaos.force("stop"))[0]) == pytest.approx(-3.0, abs=1e-6)
    with pytest.raises(lf.SceneError, match="value = 0.1 and a gap are given: give one"):
        scene.link("other", terms, 0.1, gap=0.0)


def test_an_equation_holds_a_part() -> None:
    """Nothing but u(0) - 2 u(L) = d holds a rod along x: f at 0 and -2 f at L, so that f = F."""
    scene = rods("rod")
    scene.rigid("rod:x0", y=0.0, z=0.0, rx=0.0, ry=0.0, rz=0.0)
    scene.traction("rod:x1", (3.0, 0.0, 0.0))
    terms = [("rod", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), ("rod", (L, 0.0, 0.0), (-2.0, 0.0, 0.0))]
    scene.link("held", terms, 0.5)
    result = solved(scene)
    force = float(np.ravel(result.force("held"))[0])
    assert abs(force) == pytest.approx(3.0, rel=1e-7)
    u0, u1 = moved(result, "rod", (0.0, 0.0, 0.0)), moved(result, "rod", (L, 0.0, 0.0))
    assert u0 - 2.0 * u1 == pytest.approx(0.5, abs=1e-7)
    assert u1 - u0 == pytest.approx(-3.0 * L / E, rel=1e-6)


def test_history_and_random_stiffness_of_a_link() -> None:
    scene = rods("rod")
    scene.fix("rod:x0")
    ramp = lf.Amplitude([0, 1, 2], [0, 1, 0])
    scene.link("end", [("rod", (L, 0.0, 0.0), (1.0, 0.0, 0.0))], ramp * 0.02)
    result = solved(scene, times=[1.0, 1.5, 2.0])
    values = result.quantity(lf.AtPoint(result.problem, "rod", (L, 0, 0), "displacement", "x", 1)).values
    assert float(np.ravel(values)[0]) == pytest.approx(0.01, rel=1e-7)

    scene = rods("rod")
    scene.fix("rod:x0")
    scene.traction("rod:x1", (3.0, 0.0, 0.0))
    scene.link("end", [("rod", (L, 0.0, 0.0), (1.0, 0.0, 0.0))], stiffness=lf.Uniform("k", 80.0, 120.0))
    problem = lf.assemble(scene)
    result = lf.solve(problem, chaos=lf.Chaos(order=6), progress=False)
    mean = result.quantity(lf.AtPoint(problem, "rod", (L, 0, 0), "displacement", "x"))
    assert mean.mean().value == pytest.approx(3.0 / 40.0 * np.log(220.0 / 180.0), rel=3e-4)


@pytest.mark.parametrize("turn", [0.0, 0.5])
def test_supports_along_own_axes(turn: float) -> None:
    """A bar turned about z, held along its own axis on a face and across it at nodes: F L / E A."""
    c, s = np.cos(turn), np.sin(turn)
    frame = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    part = lf.geometry.box((L, 1.0, 1.0), (4, 1, 1), cell="hexahedron")
    x = part.mesh.geometry.x
    x[:] = x @ frame
    scene = lf.Scene()
    scene.substructure("bar", part, lf.LinearElastic(E, 0.3))
    scene.fix("bar:x0", components=0, name="root", frame=frame.tolist())
    for name, point, components in (("a", (0, 0, 0), (1, 2)), ("b", (0, 1, 0), 2)):
        scene.fix_point("bar", np.array(point) @ frame, 0.0, components, name, frame=frame.tolist())
    scene.traction("bar:x1", tuple(2.0 * frame[0]))
    result = solved(scene)
    end = np.array([L, 0.0, 0.0]) @ frame
    found = np.array([moved(result, "bar", end, axis) for axis in "xyz"])
    assert frame @ found == pytest.approx([2.0 * L / E, 0.0, 0.0], abs=1e-9)
    (row,) = result.table("root").rows()
    along = np.array([row["force_x"], row["force_y"], row["force_z"]])
    assert frame @ along == pytest.approx([-2.0, 0.0, 0.0], abs=1e-8)


@pytest.mark.parametrize("unit", [1.0, 1e-3])
@pytest.mark.parametrize("turn", [0.0, 0.5])
def test_three_two_one_near_points_of_the_drawing(unit: float, turn: float) -> None:
    """A loose block, pulled at both ends, held 3-2-1 near its corners: u = (s / E) (x, -nu y, -nu z) from the
    first one, no reactions; in mm and N, in m and N, turned about z or not."""
    c, s = np.cos(turn), np.sin(turn)
    frame = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    part = lf.geometry.box((10 * unit, 6 * unit, 4 * unit), (3, 2, 2))
    x = part.mesh.geometry.x
    x[:] = x @ frame
    young, stress = 1000.0 / unit**2, 2.0 / unit**2
    scene = lf.Scene()
    scene.substructure("block", part, lf.LinearElastic(young, 0.3))
    off = np.array([0.2, -0.3, 0.1])
    held = (("3", (0, 0, 0), (0, 1, 2)), ("2", (10, 0, 0), (1, 2)), ("1", (0, 6, 0), 2))
    for name, corner, components in held:
        point = (np.array(corner) + off) * unit @ frame
        scene.fix_point("block", point, 0.0, components, name, frame.tolist(), nearest=True)
    for end, sign in (("x0", -1.0), ("x1", 1.0)):
        scene.traction(f"block:{end}", tuple(sign * stress * frame[0]))
    result = solved(scene)
    assert f"{np.linalg.norm(off) * unit:.4g} from its point" in str(result.plan)
    for (row,) in (result.table(name).rows() for name in "321"):
        assert max(abs(row[f"force_{axis}"]) for axis in "xyz") < 1e-8 * stress * 24 * unit**2
    u = result.unknowns("block").reshape(-1, 3) @ frame.T
    own = result.problem.substructures["block"].dof_coordinates @ frame.T
    exact = stress / young * own * [1.0, -0.3, -0.3]
    assert u == pytest.approx(exact, abs=1e-9 * float(np.abs(exact).max()))


def test_a_point_far_from_all_nodes_is_refused() -> None:
    scene = rods("rod")
    scene.fix("rod:x0")
    scene.fix_point("rod", (L, 1.0, 1.0 + L), nearest=True)
    words = r"at \(10, 1, 1\), 10 away, more than its cells are large \(2.872\)"
    with pytest.raises(lf.SceneError, match=words):
        lf.assemble(scene)
    with pytest.raises(lf.SceneError, match="nearest"):
        scene.fix_point("rod", (L, 1.0, 1.0), nearest=1)  # type: ignore[arg-type]


@pytest.mark.parametrize(("call", "words"), [
    (lambda s: s.link("k", [("rod", (0, 0, 0))]), "no term"),
    (lambda s: s.link("k", [("bar", (0, 0, 0), (1, 0, 0))]), "unknown substructure"),
    (lambda s: s.link("k", []), "0 parts"),
    (lambda s: s.link("k", [("rod", (0, 0, 0), (0, 0, 0))]), "every direction is 0"),
    (lambda s: s.link("k", [("rod", (0, 0, float("nan")), (1, 0, 0))]), "finite"),
    (lambda s: s.link("k", [("rod", (0, 0, 0), (1, 0, 0))], stiffness=-1.0), "negative"),
    (lambda s: s.fix("rod:x0", frame=[[1, 0, 0], [1, 0, 0], [0, 0, 1]]), "orthonormal"),
    (lambda s: s.fix("rod:x0", frame=[[1, 0], [0, 1]]), "3 dimensions"),
])
def test_refused(call: object, words: str) -> None:
    scene = lf.Scene()
    part = lf.geometry.box((L, 1.0, 1.0), (4, 1, 1), cell="hexahedron")
    scene.substructure("rod", part, lf.LinearElastic(E, 0.0))
    with pytest.raises(lf.SceneError, match=words):
        call(scene)  # type: ignore[operator]


def test_a_link_between_no_nodes_is_refused() -> None:
    scene = rods("rod")
    scene.fix("rod:x0")
    scene.link("end", [("rod", (L, 0.3, 0.0), (1.0, 0.0, 0.0))])
    with pytest.raises(lf.SceneError, match="no node of 'rod'"):
        lf.assemble(scene)


def test_results_with_nodes_are_kept(tmp_path: Path) -> None:
    """Files, pictures' data, sweeps and finer meshes of a scene whose interfaces join nodes."""
    scene = rods("one", "two")
    scene.fix(["one:x0", "two:x0"])
    scene.traction("two:x1", (3.0, 0.0, 0.0))
    scene.fix_point("one", (L / 2, 1.0, 0.0), 0.0, 2, name="node")
    terms = [("one", (L, 0.0, 0.0), (-1.0, 0.0, 0.0)), ("two", (L, 2.0, 0.0), (1.0, 0.0, 0.0))]
    scene.link("link", terms, 0.01)
    scene.link("spring", terms, stiffness=10.0)
    result = solved(scene)
    result.save(tmp_path / "result.h5")
    loaded = lf.load(tmp_path / "result.h5")
    for each in (result, loaded):
        (row,) = each.table("link").rows()
        assert row["force_x"] == pytest.approx(0.9, rel=1e-6)
        lf.io.write(each, tmp_path / f"{type(each).__name__}")
    outputs = {"force": lambda f: f.force("link")[..., 0].sum(axis=-1)}
    surface = lf.sweep(result.problem, {"link.value": [0.0, 0.02]}, outputs=outputs, progress=False)
    # both ends carry 3 in two equal springs of 100; the spring beside takes .01 * 10 of the link
    assert surface.output("force") == pytest.approx([1.5, 0.3], rel=1e-5)
    fine = lf.solve(scene, accuracy=1e-2, quantity="link", progress=False)
    assert float(np.ravel(fine.force("link"))[0]) == pytest.approx(0.9, rel=1e-2)
