"""Parts that are given as a matrix: the answer is that of the part which was condensed."""

import shutil
import subprocess

import numpy as np
import pytest
from scipy.sparse.linalg import splu

import dolfinx_frontend as lf

STEEL = lf.LinearElastic(E=200e3, nu=0.3)
TIGHT = lf.Options(rtol=1e-11)


def block(z=0.0, cells=(2, 2, 2), cell="hexahedron"):
    return lf.geometry.box((30.0, 20.0, 20.0), cells, origin=(0.0, 0.0, z), cell=cell)


def condensed(part, kept, material=STEEL, degree=1, body_force=None):
    """K, points, force of a body force on the nodes of some faces, and these by face."""
    scene = lf.Scene()
    scene.substructure("part", part, material, degree=degree, body_force=body_force)
    scene.fix("part:z0")
    s = lf.assemble(scene).substructures["part"]
    x = s.dof_coordinates
    faces = {f: np.flatnonzero(np.abs(x[:, "xyz".index(f[0])] - at) < 1e-9) for f, at in kept.items()}
    nodes = np.unique(np.concatenate(list(faces.values())))
    a = (3 * nodes[:, None] + np.arange(3)).ravel()
    i = np.setdiff1d(np.arange(s.size), a)
    K = s.matrix.tocsc()
    solve = splu(K[i][:, i])
    inner = solve.solve(K[i][:, a].toarray())
    reduced = K[a][:, a].toarray() - K[a][:, i] @ inner
    force = s.load[a] - inner.T @ s.load[i]
    where = {f: np.searchsorted(nodes, n) for f, n in faces.items()}
    return 0.5 * (reduced + reduced.T), x[nodes], force, where


def joint(base, law, force=(2.0, 1.0, -8.0), degree=1, cell="hexahedron", top=(2, 2, 2), **settings):
    """A block on a base, which is a mesh, or a Matrix."""
    scene = lf.Scene()
    if isinstance(base, lf.Matrix):
        scene.substructure("base", base)
        scene.load("base", "weight", name="weight")
    else:
        scene.substructure("base", base, STEEL, degree=degree, body_force=(0.0, 0.0, -2e-3))
    scene.substructure("block", block(20.0, top, cell), STEEL, degree=degree)
    scene.interface("joint", "block:z0", "base:z1", law, **settings)
    scene.fix("base:z0")
    scene.traction("block:z1", force)
    return lf.assemble(scene)


def reduced_base(degree=1, cell="hexahedron"):
    kept = {"z0": 0.0, "z1": 20.0}
    K, x, f, faces = condensed(block(cell=cell), kept, degree=degree, body_force=(0.0, 0.0, -2e-3))
    return lf.Matrix(K, x, {"weight": f}, faces)


@pytest.mark.parametrize(
    ("law", "degree", "cell"),
    [
        (lf.Perfect(), 1, "hexahedron"),
        (lf.Elastic(normal=1e4, tangential=3e3), 1, "hexahedron"),
        (lf.Elastic(normal=1e4, tangential=3e3), 2, "tetrahedron"),
        (lf.Contact(friction=0.32), 1, "hexahedron"),
        (lf.Contact(friction=0.35), 2, "tetrahedron"),
    ],
)
def test_a_condensed_part_gives_the_same_joint(law, degree, cell):
    whole = lf.solve(joint(block(cell=cell), law, degree=degree, cell=cell), options=TIGHT)
    matrix = lf.solve(joint(reduced_base(degree, cell), law, degree=degree, cell=cell), options=TIGHT)
    for read in ("force", "jump"):
        if law == lf.Perfect():
            continue  # it is assembled, and has none
        one, other = (getattr(each, read)("joint") for each in (whole, matrix))
        assert np.abs(one - other).max() < 1e-9 * np.abs(one).max()
    u, v = (each.displacement("block").x.array for each in (whole, matrix))
    assert np.abs(u - v).max() < 1e-9 * np.abs(u).max()
    base = matrix.displacement("base")
    nodes = whole.problem.substructures["base"].dof_coordinates
    near = np.linalg.norm(nodes[None] - base.points[:, None], axis=2).argmin(axis=1)
    wanted = whole.displacement("base").x.array.reshape(-1, 3)[near]
    assert np.abs(base.displacements - wanted).max() < 1e-9 * np.abs(wanted).max()
    assert base.rotations is None


LENGTH, AREA, I, J, G, E = 500.0, 1000.0, 2e5, 4e5, 77e3, 200e3  # mm, mm^2, mm^4, mm^4, MPa, MPa


def beam():
    """Stiffness (12, 12) of a straight beam along x."""
    K = np.zeros((12, 12))
    for ends, k in (((0, 6), E * AREA / LENGTH), ((3, 9), G * J / LENGTH)):
        K[np.ix_(ends, ends)] = k * np.array([[1.0, -1.0], [-1.0, 1.0]])
    L = LENGTH
    bent = np.array(
        [[12, 6 * L, -12, 6 * L], [6 * L, 4 * L**2, -6 * L, 2 * L**2], [-12, -6 * L, 12, -6 * L]]
        + [[6 * L, 2 * L**2, -6 * L, 4 * L**2]]
    )
    turned = np.diag([1.0, -1.0, 1.0, -1.0])
    K[np.ix_((1, 5, 7, 11), (1, 5, 7, 11))] = E * I / L**3 * bent
    K[np.ix_((2, 4, 8, 10), (2, 4, 8, 10))] = E * I / L**3 * turned @ bent @ turned
    return K


ENDS = np.array([[0.0, 0.0, 0.0], [LENGTH, 0.0, 0.0]])
FORCE, MOMENT = np.array([300.0, 40.0, -100.0]), np.array([2e4, 1e4, -3e4])


def cantilever(**settings):
    scene = lf.Scene()
    matrix = lf.Matrix(beam(), ENDS, faces={"root": 0, "tip": 1}, **settings)
    scene.substructure("frame", matrix)
    scene.fix("frame:root")
    return scene


def tip(force, moment):
    """Displacement and rotation of the tip of the beam, from its closed form."""
    bend, L = E * I, LENGTH
    u = [force[0] * L / (E * AREA), 0.0, 0.0]
    u[1] = force[1] * L**3 / (3 * bend) + moment[2] * L**2 / (2 * bend)
    u[2] = force[2] * L**3 / (3 * bend) - moment[1] * L**2 / (2 * bend)
    turn = [moment[0] * L / (G * J), 0.0, 0.0]
    turn[1] = moment[1] * L / bend - force[2] * L**2 / (2 * bend)
    turn[2] = moment[2] * L / bend + force[1] * L**2 / (2 * bend)
    return np.array(u), np.array(turn)


@pytest.mark.parametrize("way", ["face", "point", "loads"])
def test_a_beam_bends_and_turns_as_its_closed_form_says(way):
    scene = cantilever(loads={"both": np.concatenate([np.zeros(6), FORCE, MOMENT])})
    moment = MOMENT
    if way == "face":
        scene.force("frame:tip", FORCE, MOMENT)
    elif way == "loads":
        scene.load("frame", "both", factor=0.5, name="one")
        scene.load("frame", "both", factor=0.5, name="two")
    else:
        moment = np.zeros(3)
        scene.point_force("frame", ENDS[1], FORCE)
    found = lf.solve(lf.assemble(scene)).displacement("frame")
    u, turn = tip(FORCE, moment)
    assert found.displacements[1] == pytest.approx(u, rel=1e-9, abs=1e-12)
    assert found.rotations[1] == pytest.approx(turn, rel=1e-9, abs=1e-14)
    assert not found.displacements[0].any() and not found.rotations[0].any()


@pytest.mark.parametrize("way", ["rigid", "beam", "springs"])
def test_a_point_carries_a_part(way):
    """The wrench of the load of a block on the tip: the block is as if it were rigid there."""
    scene = cantilever()
    near = LENGTH if way != "beam" else LENGTH + 20.0
    part = lf.geometry.box((40.0, 40.0, 40.0), (2, 2, 2), origin=(near, -20.0, -20.0), cell="hexahedron")
    scene.substructure("block", part, STEEL, degree=1)
    scene.traction("block:x1", FORCE / 1600.0)
    if way == "rigid":
        scene.rigid(["block:x0", "frame:tip"])
    elif way == "springs":
        soft = {"x": 1e5, "y": 1e5, "z": 1e5, "rx": 1e8, "ry": 1e8, "rz": 1e8}
        scene.springs("block:x0", "bush", second="frame:tip", **soft)
    else:
        scene.beam("bolt", "frame:tip", "block:x0", lf.BoltStiffness(axial=1e6, bending=1e8, torsion=1e8))
    result = lf.solve(lf.assemble(scene))
    found = result.displacement("frame")
    arm = near + 40.0 - LENGTH
    u, turn = tip(FORCE, np.cross([arm, 0.0, 0.0], FORCE))
    assert found.displacements[1] == pytest.approx(u, rel=1e-8, abs=1e-11)
    assert found.rotations[1] == pytest.approx(turn, rel=1e-8, abs=1e-13)
    if way == "springs":
        assert result.jump("bush.z")[0, 0] == pytest.approx(-FORCE[2] / 1e5, rel=1e-8)


def test_a_grounded_matrix_needs_no_support():
    K = beam() + np.diag([1e6, 1e6, 1e6, 1e12, 1e12, 1e12] + 6 * [0.0])
    matrix = lf.Matrix(K, ENDS, faces={"root": 0, "tip": 1})
    assert matrix.free_motions == 0 and lf.Matrix(beam(), ENDS).free_motions == 6
    scene = lf.Scene()
    scene.substructure("frame", matrix)
    scene.force("frame:tip", FORCE)
    found = lf.solve(lf.assemble(scene)).displacement("frame").displacements[1]
    assert found == pytest.approx(np.linalg.solve(K, np.r_[np.zeros(6), FORCE, np.zeros(3)])[6:9], rel=1e-9)
    free = lf.Scene()
    free.substructure("frame", lf.Matrix(beam(), ENDS))
    free.force("frame:points", FORCE)
    with pytest.raises(lf.SceneError, match="frame"):
        lf.assemble(free)


def test_partly_grounded():
    K = beam()
    K[0, 0] += 1e5
    assert lf.Matrix(K, ENDS).free_motions == 5


def without_turns_of_the_tip():
    """Stiffness (9, 9) of the beam with the rotations of its tip condensed."""
    K, a, i = beam(), np.arange(9), np.arange(9, 12)
    return K[np.ix_(a, a)] - K[np.ix_(a, i)] @ np.linalg.solve(K[np.ix_(i, i)], K[np.ix_(i, a)])


def test_some_points_have_rotations(tmp_path):
    K = without_turns_of_the_tip()
    with pytest.raises(lf.SceneError, match="diagonal of K is 0 at rx of point 0; every"):
        lf.Matrix(np.round(K, 6), ENDS, rotations=[0])  # nothing holds the torsion of the root any more
    K[3, 3] += 1e6
    matrix = lf.Matrix(K, ENDS, {"pull": np.r_[np.zeros(6), FORCE]}, {"root": 0, "tip": 1}, rotations=[0])
    assert matrix.size == 9 and "(and 1 rotations)" in repr(matrix)
    scene = lf.Scene()
    scene.substructure("frame", matrix)
    scene.fix("frame:root")
    scene.load("frame", "pull")
    result = lf.solve(lf.assemble(scene))
    found = result.displacement("frame")
    assert found.displacements[1] == pytest.approx(tip(FORCE, np.zeros(3))[0], rel=1e-9)
    assert not found.rotations[0].any() and np.isnan(found.rotations[1]).all()
    result.save(tmp_path / "frame.h5")
    again = lf.load(tmp_path / "frame.h5").displacement("frame")
    assert again.rotations == pytest.approx(found.rotations, nan_ok=True)


def test_in_two_dimensions():
    rows = [0, 1, 5, 6, 7, 11]
    scene = lf.Scene()
    K = beam()[np.ix_(rows, rows)]
    scene.substructure("frame", lf.Matrix(K, ENDS[:, :2], faces={"root": 0, "tip": 1}))
    scene.fix("frame:root")
    scene.force("frame:tip", FORCE[:2], MOMENT[2])
    found = lf.solve(lf.assemble(scene)).displacement("frame")
    u, turn = tip([*FORCE[:2], 0.0], [0.0, 0.0, MOMENT[2]])
    assert found.displacements[1] == pytest.approx(u[:2], rel=1e-9)
    assert found.rotations[1] == pytest.approx(turn[2:], rel=1e-9)


def test_petsc_and_sparse_matrices_are_alike():
    import scipy.sparse as sp
    from petsc4py import PETSc

    K = sp.csr_matrix(beam())
    made = PETSc.Mat().createAIJ(K.shape, csr=(K.indptr, K.indices, K.data))
    assert (lf.Matrix(made, ENDS).stiffness != lf.Matrix(beam(), ENDS).stiffness).nnz == 0
    assert (lf.Matrix(K.tocoo(), ENDS).stiffness != lf.Matrix(beam(), ENDS).stiffness).nnz == 0


def test_random_stiffness_and_loads():
    """w = F L^3 / 3 E I times a ratio of a normal and a lognormal number."""
    K = lf.LogNormal("frame stiffness", mean=1.0, cov=0.1)
    F = lf.Normal("load", mean=1.0, std=0.2)
    scene = lf.Scene()
    load = np.zeros(12)
    load[8] = -100.0
    matrix = lf.Matrix(beam(), ENDS, {"pull": load}, {"root": 0, "tip": 1})
    scene.substructure("frame", matrix, stiffness=K)
    scene.fix("frame:root")
    scene.load("frame", "pull", factor=F)
    problem = lf.assemble(scene)
    result = lf.solve(problem, chaos=6)
    alone = 100.0 * LENGTH**3 / (3 * E * I)
    log = np.log(1.0 + 0.1**2)
    mean, square = np.exp(log), np.exp(3.0 * log)  # of 1 / K, and of its square
    w = result.displacement("frame").displacements[1, 2]
    deviation = result.std("frame").displacements[1, 2]
    assert w == pytest.approx(-alone * mean, rel=1e-6)
    assert deviation == pytest.approx(alone * np.sqrt(square * (1.0 + 0.2**2) - mean**2), rel=1e-5)
    at = lf.AtPoint(problem, "frame", ENDS[1], component="z")
    assert result.mean_std(at).mean == pytest.approx(w, rel=1e-3)


def test_random_joint_against_the_condensed_part():
    law = lf.Elastic(normal=lf.LogNormal("k", mean=1e4, cov=0.3), tangential=3e3)
    whole = lf.solve(joint(block(), law), chaos=3, options=TIGHT)
    matrix = lf.solve(joint(reduced_base(), law), chaos=3, options=TIGHT)
    for read in (lambda r: r.force("joint"), lambda r: r.std("block").x.array):
        one, other = read(whole), read(matrix)
        assert np.abs(one - other).max() < 1e-8 * np.abs(one).max()


def test_what_is_saved_comes_back(tmp_path):
    scene = cantilever()
    scene.force("frame:tip", FORCE, MOMENT)
    result = lf.solve(lf.assemble(scene))
    result.save(tmp_path / "frame.h5")
    again, found = lf.load(tmp_path / "frame.h5").displacement("frame"), result.displacement("frame")
    for name in ("points", "displacements", "rotations"):
        assert getattr(again, name) == pytest.approx(getattr(found, name), rel=1e-12)
    index = lf.io.write_fields(result, tmp_path / "frame.vtm")
    assert index.exists() and 'NumberOfPoints="2"' in next(tmp_path.rglob("*.vtu")).read_text()


def test_mesh_errors_are_those_of_the_meshes():
    result = lf.solve(joint(reduced_base(), lf.Contact(friction=0.35)))
    error = lf.discretisation_error(result)
    assert error.parts["base"] == 0.0 and 0.0 < error.parts["block"] < 0.5


@pytest.mark.filterwarnings("ignore:.*areas of:dolfinx_frontend.SceneWarning")
def test_part_of_a_face_may_be_joined():
    """Points that are nodes of some facets of a larger face."""
    K, x, f, faces = condensed(
        lf.geometry.box((15.0, 20.0, 20.0), (1, 2, 2), cell="hexahedron"), {"z0": 0.0, "z1": 20.0}
    )
    base = lf.Matrix(K, x, {"weight": f}, faces)
    small = lf.geometry.box((15.0, 20.0, 20.0), (1, 2, 2), cell="hexahedron")
    for first, second in (("block:z0", "base:z1"), ("base:z1", "block:z0")):
        answers = []
        for part in (base, small):
            scene = lf.Scene()
            scene.substructure("base", part, *([] if part is base else [STEEL, 1]))
            scene.substructure("block", block(20.0), STEEL, degree=1)
            partial = "partial" if first == "block:z0" else "full"
            scene.interface("joint", first, second, lf.Contact(friction=0.3), space="mortar", overlap=partial)
            scene.fix("base:z0")
            scene.symmetry(["block:x1"])
            scene.traction("block:z1", (0.0, 0.0, -8.0))
            answers.append(lf.solve(lf.assemble(scene), options=TIGHT).displacement("block").x.array)
        assert np.abs(answers[0] - answers[1]).max() < 1e-9 * np.abs(answers[1]).max()


def unsymmetric():
    K = beam()
    K[1, 7] *= 1.001
    return K


def negative():
    values, modes = np.linalg.eigh(beam())
    return beam() - 1.5 * values[8] * np.outer(modes[:, 8], modes[:, 8])


def mechanism():
    """Two hinges in a beam that has none: it turns about its own axis at one end alone."""
    K = beam()
    K[9], K[:, 9] = 0.0, 0.0
    K[3], K[:, 3] = 0.0, 0.0
    K[[3, 9], [3, 9]] = 1e-3
    return K


@pytest.mark.parametrize(
    ("K", "settings", "said"),
    [
        (np.eye(11), {}, r"K is \(11, 11\) with 2 points in 3 dimensions; give \(6, 6\) or \(12, 12\)"),
        (unsymmetric(), {}, "not symmetric: .* between y of point 0 and y of point 1"),
        (np.triu(beam()), {}, "give both halves"),
        (negative(), {}, "indefinite"),
        (mechanism(), {}, "a motion without stiffness that is not rigid, most of all at rx of point"),
        (np.full((12, 12), np.nan), {}, "NaN or infinite, at x of point 0"),
        (np.zeros((12, 12)), {}, "K is zero"),
        (np.diag([1.0] * 11 + [0.0]), {}, "the diagonal of K is 0 at rz of point 1"),
        ("stiff", {}, "give a dense array"),
        (beam()[:6, :6], {}, "on a line"),
        (beam(), {"faces": {"tip": 2}}, "face 'tip' has the point 2; there are 2"),
        (beam(), {"faces": {"tip": [1, 1]}}, "names a point twice"),
        (beam(), {"faces": {"tip": "last"}}, "give indices of points"),
        (beam(), {"loads": {"pull": [1.0]}}, "load 'pull' has 1 numbers, K 12 rows"),
        (beam(), {"length": -1.0}, "length"),
        (beam(), {"rotations": [0]}, r"give \(9, 9\)"),
        (beam(), {"rotations": [0, 2]}, "has the point 2; there are 2"),
    ],
)
def test_wrong_matrices_are_refused(K, settings, said):
    with pytest.raises(lf.SceneError, match=said):
        lf.Matrix(K, ENDS, **settings)


def test_wrong_points_are_noticed():
    with pytest.raises(lf.SceneError, match="a motion without stiffness that is not rigid"):
        lf.Matrix(beam(), ENDS + [[0.0, 0.0, 0.0], [50.0, 0.0, 0.0]])
    with pytest.warns(lf.SceneWarning, match="rigid motions meet a resistance"):
        lf.Matrix(beam(), ENDS + [[0.0, 0.0, 0.0], [1e-3, 0.0, 0.0]])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda s, m: s.substructure("b", m, STEEL), "a material beside a Matrix"),
        (lambda s, m: s.substructure("b", m, body_force=(0, 0, 1.0)), "body_force beside a Matrix"),
        (lambda s, m: s.substructure("b", block()), "None is not a material"),
        (lambda s, m: s.load("frame", "rain"), "load of the matrix"),
        (lambda s, m: s.load("frame", lambda v: v[0]), "give the name of one of its loads"),
        (lambda s, m: s.temperature("frame", 10.0, alpha=1e-5), "a temperature on 'frame'"),
        (lambda s, m: s.pressure("frame:tip", 1.0), "needs a face with an area"),
        (lambda s, m: s.symmetry("frame:tip"), "needs a face with an area"),
        (lambda s, m: s.fix("frame:top"), "'top'"),
        (lambda s, m: s.point_force("frame", (1.0, 2.0, 3.0), (0, 0, 1.0)), "no point of 'frame'"),
    ],
)
def test_what_a_matrix_cannot_do_is_said(change, said):
    scene = cantilever()
    with pytest.raises(lf.SceneError, match=said):
        change(scene, lf.Matrix(beam(), ENDS))
        lf.assemble(scene)


def test_points_must_be_nodes_of_the_other_face():
    K, x, f, faces = condensed(block(), {"z1": 20.0})
    for shift, said in ((0.5, "are no nodes of block:z0"), (0.0, "some of the nodes of facets")):
        middle = np.argmin(np.linalg.norm(x - [15.0, 10.0, 20.0], axis=1))
        some = np.arange(9) if shift else np.delete(np.arange(9), middle)
        scene = lf.Scene()
        scene.substructure("base", lf.Matrix(K, x + [shift, 0.0, 0.0], faces={"z1": some}))
        scene.substructure("block", block(20.0), STEEL, degree=1)
        scene.interface("joint", "base:z1", "block:z0", lf.Perfect())
        scene.fix("block:z1")
        with pytest.raises(lf.SceneError, match=said):
            lf.assemble(scene)


def test_units_are_compared_with_neighbours():
    K, x, f, faces = condensed(block(), {"z0": 0.0, "z1": 20.0})
    scene = lf.Scene()
    scene.substructure("base", lf.Matrix(1e6 * K, x, faces=faces))
    scene.substructure("block", block(20.0), STEEL, degree=1)
    scene.interface("joint", "block:z0", "base:z1", lf.Perfect())
    scene.fix("base:z0")
    with pytest.warns(lf.SceneWarning, match="same units of force and length"):
        lf.assemble(scene)


def test_two_matrices_have_no_face_between_them():
    scene = cantilever()
    scene.substructure("other", lf.Matrix(beam(), ENDS + ENDS[1], faces={"root": 0, "tip": 1}))
    scene.interface("joint", "frame:tip", "other:root", lf.Perfect())
    with pytest.raises(lf.SceneError, match="both points of a matrix"):
        lf.assemble(scene)


def test_two_matrices_are_joined_rigidly():
    scene = cantilever()
    scene.substructure("other", lf.Matrix(beam(), ENDS + ENDS[1], faces={"root": 0, "tip": 1}))
    scene.rigid(["frame:tip", "other:root"])
    scene.force("other:tip", (0.0, 0.0, -100.0))
    found = lf.solve(lf.assemble(scene)).displacement("other").displacements[1, 2]
    assert found == pytest.approx(-100.0 * (2 * LENGTH) ** 3 / (3 * E * I), rel=1e-9)


@pytest.mark.skipif(shutil.which("latin_run") is None, reason="latin_run was built without HDF5")
def test_the_kernel_alone_solves_what_is_exported(tmp_path):
    problem = joint(reduced_base(), lf.Contact(friction=0.35))
    problem.export(tmp_path / "run")
    command = ["latin_run", str(tmp_path / "run"), "--displacements"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    found = lf.load(tmp_path / "run" / "result.h5").displacement("base").displacements
    assert found == pytest.approx(lf.solve(problem).displacement("base").displacements, rel=1e-12)


def test_a_deck_has_no_words_for_it(tmp_path):
    with pytest.raises(lf.SceneError, match="a deck has no words for a Matrix"):
        cantilever().to_deck(tmp_path / "frame.toml")


def test_what_is_printed():
    matrix = lf.Matrix(beam(), ENDS, faces={"root": 0, "tip": 1})
    assert "6 free rigid motions, faces root, tip" in repr(matrix)
    assert "points of a matrix, 12 unknowns" in repr(cantilever())
