"""Elimination of the interfaces that are linear."""

from __future__ import annotations


import numpy as np
import pytest
import scipy.sparse as sp

import dolfinx_frontend as lf
from dolfinx_frontend import geometry
from dolfinx_frontend.assembly.assemble import assemble
from dolfinx_frontend.plan.reduction import body_load, body_matrix, displacements, reduce
from dolfinx_frontend.reference.cholesky import Cholesky
from dolfinx_frontend.reference.direct import monolithic
from dolfinx_frontend.scene.laws import Perfect
from dolfinx_frontend.scene.materials import LinearElastic
from dolfinx_frontend.scene.scene import Scene
from tests.helpers import block, small_assembly

EPS = np.finfo(float).eps
STEEL = LinearElastic(2e5, 0.3)


def test_elimination_equals_lagrange_multipliers():
    """Z and u0 against a dense saddle-point system with all constraints at the nodes."""
    problem = small_assembly()
    (body,) = reduce(problem, problem.interfaces)
    q = Cholesky(body_matrix(problem, body)).solve(body_load(problem, body))
    u = displacements(body, q)

    a, b = (problem.substructures[n] for n in "ab")
    n = a.size + b.size
    K = sp.block_diag([a.matrix, b.matrix]).toarray()
    F = np.concatenate([a.load, b.load])
    spring = problem.interfaces["spring"]
    T = spring.local_trace(0)
    k = np.repeat(spring.weights, 2) * spring.law.stiffnesses(spring).ravel()
    K[: a.size, : a.size] += (T.T @ sp.diags(k) @ T).toarray()
    F[: a.size] -= T.T @ (k * spring.law.jumps(spring).ravel())
    rows, values = [], []

    def constrain(entries, value):
        row = np.zeros(n)
        for at, c in entries:
            row[at] += c
        rows.append(row)
        values.append(value)

    for i, j in problem.interfaces["glue"].matching:
        for c in range(2):
            constrain([(2 * i + c, 1.0), (a.size + 2 * j + c, -1.0)], 0.0)
    normal = problem.interfaces["oblique"].normals[0]
    for i in problem.interfaces["oblique"].sides[0].nodes:
        constrain([(2 * i, normal[0]), (2 * i + 1, normal[1])], 0.0)
    for i in problem.interfaces["end"].sides[0].nodes:
        for c in range(2):
            constrain([(a.size + 2 * i + c, 1.0)], 0.1 + 0.2 * b.dof_coordinates[i, c])
    C = np.array(rows)
    m = len(C)
    saddle = np.block([[K, C.T], [C, np.zeros((m, m))]])
    exact = np.linalg.solve(saddle, np.concatenate([F, values]))[:n]
    got = np.concatenate([u["a"], u["b"]])
    assert np.abs(got - exact).max() < 1e2 * EPS * np.linalg.cond(saddle)
    assert np.abs(C @ got - values).max() < 1e-14
    assert body.n == n - np.linalg.matrix_rank(C)
    Z = sp.vstack([body.Z["a"], body.Z["b"]])
    assert np.abs(C @ Z).max() < 1e-15


def test_active_interfaces_leave_bodies_apart():
    problem = small_assembly()
    bodies = reduce(problem, {"oblique", "end"})
    assert [b.members for b in bodies] == [("a",), ("b",)]
    assert all(b.springs == () for b in bodies)
    assert bodies[1].offset["b"].any()
    (both,) = reduce(problem, {"glue", "spring"})
    assert both.members == ("a", "b") and both.springs == ("spring",)


def test_axis_aligned_constraints_keep_selections():
    """Three symmetry planes at a corner: Z stays a selection matrix."""
    scene = Scene()
    scene.substructure("a", block("hexahedron", [1, 1, 1]), STEEL, degree=1)
    scene.symmetry(["a:x0", "a:y0", "a:z0"])
    (body,) = reduce(problem := assemble(scene), set(problem.interfaces))
    Z = body.Z["a"]
    assert body.n == 24 - 3 * 4
    assert np.array_equal(np.unique(Z.data), [1.0]) and Z.nnz == body.n


def test_prescribed_jump_of_a_perfect_interface():
    """A wedge of thickness 0.1 between two bars that are held at their ends."""
    scene = Scene()
    for k, name in enumerate(("a", "b")):
        part = geometry.box((1.0, 1.0), (2, 2), (k, 0.0))
        scene.substructure(name, part, LinearElastic(1.0, 0.0), degree=1)
    scene.interface("wedge", "a:x1", "b:x0", Perfect(jump=0.1))
    scene.fix(["a:x0", "b:x1"])
    solution = monolithic(assemble(scene))
    w1, w2 = solution.traces["wedge"]
    assert w2 - w1 == pytest.approx(np.tile([0.1, 0.0], (len(w1), 1)), abs=1e-14)
    assert w1[:, 0] == pytest.approx(-0.05)
    assert solution.energy == pytest.approx(0.05**2, rel=1e-12)


def test_jumps_add_up_through_a_ring_of_parts():
    """Four plates meet at one point; the jumps of the four joints around it have to agree."""
    def plates(last):
        scene = Scene()
        for name, corner in (("a", (0, 0)), ("b", (1, 0)), ("c", (1, 1)), ("d", (0, 1))):
            scene.substructure(name, geometry.box((1.0, 1.0), (1, 1), corner), STEEL, degree=1)
        scene.interface("ab", "a:x1", "b:x0", Perfect(jump=0.1))
        scene.interface("bc", "b:y1", "c:y0", Perfect())
        scene.interface("dc", "d:x1", "c:x0", Perfect(jump=last))
        scene.interface("ad", "a:y1", "d:y0", Perfect())
        scene.fix("a:x0")
        return assemble(scene)

    solution = monolithic(plates(0.1))
    for name in ("b", "c"):
        assert solution.u[name].reshape(-1, 2)[:, 0] == pytest.approx(0.1, abs=1e-13)
    with pytest.raises(ValueError, match="contradicts"):
        monolithic(plates(0.2))


@pytest.mark.parametrize("active", [None, "all", ["glue"], ["ta"]])
def test_contradicting_displacements_are_refused_whatever_is_kept(active):
    """Two glued squares whose tops move differently: at their common corner no displacement is both."""
    scene = Scene()
    in_time = lf.Amplitude([0, 1, 2], [0, 0.9, -0.96])
    for name, x in (("a", 0.0), ("b", 1.0)):
        square = geometry.box((1.0, 1.0), (2, 2), origin=(x, 0.0))
        scene.substructure(name, square, LinearElastic(2e9, 0.2), degree=1)
    scene.interface("glue", "a:x1", "b:x0", Perfect())
    scene.interface("ground", "a:y0", lf.Elastic(normal=1.4e7, tangential=4e6))
    scene.fix("a:y1", in_time * (-1.7e-3, -1.7e-3), name="ta")
    scene.fix("b:y1", in_time * (-3.4e-3, -2.1e-3), name="tb")
    problem = assemble(scene)
    with pytest.raises(lf.SceneError, match="'ta' and 'tb' prescribe different displacements at 1 common"):
        lf.solve(problem, times=[1.0, 2.0], active=active)


@pytest.mark.parametrize("active", [None, "all"])
def test_a_jump_along_a_symmetry_plane_is_no_contradiction(active):
    """A bar between walls, cut and shortened by s in directions that are rounded: E A s / L pulls at them."""
    scene, turn = Scene(), np.array([[np.cos(0.3), np.sin(0.3)], [-np.sin(0.3), np.cos(0.3)]])
    for name, x in (("a", 0.0), ("b", 1.0)):
        half = geometry.box((1.0, 1.0), (2, 2), origin=(x, 0.0))
        half.mesh.geometry.x[:, :2] = half.mesh.geometry.x[:, :2] @ turn
        scene.substructure(name, half, LinearElastic(2e5, 0.0))
    scene.interface("cut", "a:x1", "b:x0", Perfect(jump=-1e-3))
    scene.symmetry(["a:y0", "b:y0"])
    scene.fix(["a:x0", "b:x1"], name="walls")
    result = lf.solve(assemble(scene), active=active)
    assert result.table("cut")["normal"] == pytest.approx([2e5 * 1e-3 / 2.0], rel=1e-6)


@pytest.mark.parametrize("active", [None, "all"])
@pytest.mark.parametrize("off", [0.0, 1e-3])
@pytest.mark.parametrize("support", ["point", "face", "ground"])
@pytest.mark.parametrize("tie", ["rigid", "plane"])
def test_supports_that_contradict_given_motions_are_refused_whatever_is_kept(tie, support, off, active):
    """A block whose right face is moved by 0.02 is held there elsewhere; where both agree it is stretched."""
    scene = Scene()
    scene.substructure("a", geometry.box((1.0, 1.0, 1.0), (2, 2, 2)), LinearElastic(1e5, 0.0), degree=1)
    scene.fix("a:x0")
    if tie == "rigid":
        scene.rigid("a:x1", x=0.02, y=0.0, z=0.0, rx=0.0, ry=0.0, rz=0.0, name="p")
    else:
        scene.plane("a:x1", tilts=False, n=0.02, name="p")
    if support == "point":
        scene.fix_point("a", (1.0, 0.0, 1.0), (0.02 - off, 0.0, 0.0))
    elif support == "face":
        scene.fix("a:z1", lambda x: (0.02 - off) * x[:, [0]] * np.eye(3)[0], components=0)
    else:  # over a part of the face, and an elastic joint beside
        scene.interface("bed", "a:y1", lf.Elastic(normal=0.0, tangential=0.0))
        scene.fix("a:y0", lambda x: (0.02 - off) * x[:, [0]] * np.eye(3)[0], components=(0, 1))
    problem = assemble(scene)
    if off:
        with pytest.raises(lf.SceneError, match=f"{tie} face 'p': its supports and given motions contradict"):
            lf.solve(problem, active=active, progress=False)
        return
    result = lf.solve(problem, active=active, progress=False)
    assert result.converged
    x = problem.substructures["a"].dof_coordinates
    assert result.unknowns("a").reshape(-1, 3)[:, 0] == pytest.approx(0.02 * x[:, 0], abs=1e-7)


def _moved(name):
    return lf.Normal(name, 0.01, std=0.001)


@pytest.mark.parametrize("times", [None, [1.0, 2.0]])
@pytest.mark.parametrize(
    "one, other, agree",
    [
        (_moved("u"), _moved("u"), True),
        (2.0 * _moved("u"), _moved("u") + _moved("u"), True),
        (_moved("u"), _moved("v"), False),
        (_moved("u"), 1.1 * _moved("u") - 0.001, False),
        (_moved("u"), 0.01, False),
        (lf.FromSamples("u", [0.01, 0.03]), lf.FromSamples("v", [0.01, 0.03]), False),
        (lf.RandomField("f", mean=0.01, std=0.001, length=5.0), 0.01, False),
    ],
)
def test_random_displacements_with_the_same_mean_contradict_each_other(one, other, agree, times):
    """Two sides of a square on springs are moved along y: at their corner samples of both have to agree."""
    scene = Scene()
    scene.substructure("a", geometry.box((1.0, 1.0), (2, 2)), LinearElastic(100.0, 0.0), degree=1)
    scene.interface("bed", "a:y0", lf.Elastic(normal=30.0, tangential=10.0))
    if times and not isinstance(one, lf.RandomField):
        one, other = (lf.Amplitude([0, 2], [0, 1]) * each for each in (one, other))
    scene.fix("a:y1", one, components=1, name="top")
    scene.fix("a:x1", other, components=1, name="right")
    scene.fix("a:x0", components=0)
    problem = assemble(scene)
    settings = {"times": times, "progress": False}
    assert lf.solve(problem, **settings).converged  # at the means
    runs = (
        lambda: lf.solve(problem, chaos=1, **settings),
        lambda: lf.quasi_monte_carlo(problem, 4, **settings),
    )
    for run in runs:
        if agree:
            assert run().status == "converged"
            continue
        with pytest.raises(lf.SceneError, match="'right' and 'top' prescribe .* the same random number"):
            run()


RAMP = lf.Amplitude([0, 2], [0, 1])


@pytest.mark.parametrize("active", [None, "all"])
@pytest.mark.parametrize("kind", ["supports", "jumps", "rigid"])
@pytest.mark.parametrize(
    "other, factor, agrees",
    [
        (lf.Amplitude([0, 0.3, 2], [0, 0.15, 1]), 1.0, True),
        (lf.Amplitude([0, 0.5, 2], [0, 0.5, 2]), 0.5, True),
        (lf.Amplitude(lambda t: 0.5 * t), 1.0, True),
        (lf.Amplitude([0, 0.3, 2], [0, 0.2, 1]), 1.0, False),  # at the breakpoint only, where no step is
        (lf.Amplitude(lambda t: 0.5 * t), 1.01, False),
    ],
)
def test_the_same_function_of_time_written_otherwise_is_no_contradiction(other, factor, agrees, kind, active):
    """Blocks between plates that move by 1e-3 t / 2, or with joints that open by that: a uniform strain."""
    scene = Scene()
    for name, corner in (("a", (0, 0)), ("b", (1, 0)), ("c", (1, 1)), ("d", (0, 1))):
        scene.substructure(name, geometry.box((1.0, 1.0), (1, 1), corner), LinearElastic(1e5, 0.0), degree=1)
    first, second = (1e-3 * RAMP, 1e-3 * factor * other) if kind == "jumps" else (0.0, 0.0)
    for name, sides, jump in (("ab", ("a:x1", "b:x0"), 0.0), ("dc", ("d:x1", "c:x0"), 0.0)):
        scene.interface(name, *sides, Perfect(jump=jump))
    scene.interface("ad", "a:y1", "d:y0", Perfect(jump=first))
    scene.interface("bc", "b:y1", "c:y0", Perfect(jump=second))
    scene.fix(["a:y0", "b:y0"])
    if kind == "rigid":
        scene.rigid(["d:y1"], x=0.0, y=1e-3 * RAMP, rz=0.0, name="grip")
    else:
        scene.fix("d:y1", 0.0 if kind == "jumps" else RAMP * (0.0, 1e-3), name="grip")
    scene.fix("c:y1", 0.0 if kind == "jumps" else other * (0.0, 1e-3 * factor), name="other")
    problem = assemble(scene)
    if not agrees:
        with pytest.raises(lf.SceneError, match="contradict|prescribe different"):
            lf.solve(problem, times=[1.0, 1.5, 2.0], active=active, progress=False)
        return
    result = lf.solve(problem, times=[1.0, 1.5, 2.0], active=active, progress=False)
    assert result.converged
    height = problem.substructures["a"].dof_coordinates[:, 1]
    strain = (-0.5e-3 if kind == "jumps" else 0.5e-3) * np.array([0.5, 0.75, 1.0])
    moved = result.unknowns("a").reshape(3, -1, 2)[..., 1]
    assert moved == pytest.approx(strain[:, None] * height, abs=1e-9)


@pytest.mark.parametrize("active", [None, ["joint"], "all"])
@pytest.mark.parametrize("cells", [(2, 2), (3, 3)])
@pytest.mark.parametrize("other", ["support", "plane", "rigid"])
@pytest.mark.parametrize("tie", ["plane", "rigid", "turned"])
@pytest.mark.parametrize("late", [False, True])
def test_given_motions_that_contradict_at_a_glued_joint_are_refused(tie, other, cells, active, late):
    """The faces z = 0 of two glued blocks meet at the joint: one is moved by another displacement."""
    ramp = lf.Amplitude([0, 1, 2], [0, 0, 1]) if late else lf.Amplitude([0, 1, 2], [0, 1, 1])
    scene = Scene()
    for name, x, n in (("a", 0.0, (2, 2)), ("b", 10.0, cells)):
        box = geometry.box((10, 10, 10), (2, *n), (x, 0, 0), cell="hexahedron")
        scene.substructure(name, box, LinearElastic(2e5, 0.3), degree=1)
    scene.interface("joint", "a:x1", "b:x0", Perfect())
    still = dict.fromkeys(["x", "y", "z", "rx", "ry", "rz"], 0.0)
    if other == "support":
        scene.fix("a:z0", name="other")
    elif other == "plane":
        scene.fix("a:x0", name="end")
        scene.plane("a:z0", n=0.0, tilts=False, name="other")
    else:
        scene.rigid("a:z0", name="other", **still)
    if tie == "plane":
        scene.plane("b:z0", n=0.1 * ramp, tilts=False, name="moved")
    elif tie == "rigid":
        scene.rigid("b:z0", name="moved", **{**still, "z": 0.1 * ramp})
    else:  # about an axis that is not the joint's edge
        scene.rigid("b:z0", name="moved", point=(15, 5, 0), **{**still, "ry": 0.01 * ramp})
    problem = assemble(scene)
    with pytest.raises(lf.SceneError, match="prescribe different|contradict|share nodes"):
        lf.solve(problem, times=[0.5, 1.0, 2.0], active=active, progress=False)


def test_a_rigid_face_that_turns_about_the_edge_of_a_glued_joint_contradicts_nothing():
    """The other face is still: along the edge nothing moves."""
    scene = Scene()
    for name, x in (("a", 0.0), ("b", 10.0)):
        box = geometry.box((10, 10, 10), (2, 2, 2), (x, 0, 0), cell="hexahedron")
        scene.substructure(name, box, LinearElastic(2e5, 0.3), degree=1)
    scene.interface("joint", "a:x1", "b:x0", Perfect())
    scene.fix("a:z0", name="other")
    still = dict.fromkeys(["x", "y", "z", "rx", "rz"], 0.0)
    scene.rigid("b:z0", name="moved", point=(10, 5, 0), ry=0.01, **still)
    forces = []
    for active in (None, ["joint"]):
        result = lf.solve(assemble(scene), active=active, options=lf.Options(rtol=1e-9), progress=False)
        assert result.converged
        forces.append(float(np.abs(result.unknowns("b")).max()))
    assert forces[0] == pytest.approx(forces[1], rel=1e-7)
    assert forces[0] == pytest.approx(0.1, rel=0.3)


@pytest.mark.parametrize("active", [None, "all"])
@pytest.mark.parametrize("cells", [(2, 2), (2, 3), (3, 2)])
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("degree", [1, 2])
def test_contradictions_are_refused_whether_meshes_match_or_not(active, cells, dim, degree):
    """Two glued blocks, the second one half as wide: along their common edge no displacement is both."""

    def along(more=0.0):
        def value(x):
            out = np.zeros((len(x), dim))
            out[:, 1] = 1e-3 + x[:, -1] ** 2 + more * (x[:, -1] * (0.5 - x[:, -1]) + (x[:, 0] - 1.0))
            return out

        return value

    def blocks(other, jump=0.0):
        scene = Scene()
        for name, x, n, width in (("a", 0.0, cells[0], 1.0), ("b", 1.0, cells[1], 0.5)):
            box = geometry.box((1.0, 1.0, width)[:dim], (n,) * dim, origin=(x, 0.0, 0.0)[:dim])
            scene.substructure(name, box, LinearElastic(1e5, 0.0), degree=degree)
        scene.interface("glue", "a:x1", "b:x0", Perfect(jump=jump), overlap="partial" if dim == 3 else "full")
        scene.fix(["a:y0", "b:y0"])
        scene.fix("a:y1", along(), (0, 1), "ta")
        scene.fix("b:y1", other, (0, 1), "tb")
        return lf.solve(assemble(scene), active=active, progress=False)

    # 1e-3 apart, at the ends of the common edge not at all
    with pytest.raises(lf.SceneError, match="'ta' and 'tb' prescribe different displacements at"):
        blocks(along(0.016))
    assert blocks(along()).converged
    if cells[0] != cells[1]:  # what a jump allows is not looked at
        assert blocks(along(0.016), (0.0, *(1e-3,) * (dim - 1))).converged
