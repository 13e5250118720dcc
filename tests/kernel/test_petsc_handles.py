"""What crosses into the kernel: PETSc matrices are borrowed, anything else is refused."""

from __future__ import annotations

import ast
import gc
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from mpi4py import MPI
from petsc4py import PETSc as _PETSc

import latin_core
from dolfinx_frontend import geometry
from dolfinx_frontend.assembly.assemble import assemble
from dolfinx_frontend.assembly.elements import csr
from dolfinx_frontend.kernel import bridge
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.kernel.bridge import build
from dolfinx_frontend.plan.plan import make_plan
from dolfinx_frontend.scene.laws import Elastic
from dolfinx_frontend.scene.materials import LinearElastic
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.solving import solve
from latin_core import InputError, State, _core

pytestmark = pytest.mark.sanitize

PETSc: Any = _PETSc
EPS = np.finfo(float).eps


@pytest.fixture(scope="module")
def problem() -> Problem:
    scene = Scene()
    for k, name in enumerate(("base", "cover")):
        part = geometry.box((1.0, 1.0, 1.0), (1, 1, 2), (0.0, 0.0, float(k)))
        scene.substructure(name, part, LinearElastic(E=100.0, nu=0.3), degree=1)
    scene.interface("joint", "base:z1", "cover:z0", Elastic(normal=10.0, tangential=10.0))
    scene.fix("base:z0", name="ground")
    scene.traction("cover:z1", (0.0, 0.0, 1.0), name="pull")
    return assemble(scene)


def matrices(problem: Problem) -> list[Any]:
    """All PETSc matrices that a problem owns."""
    stiffnesses = [part.stiffness for part in problem.substructures.values()]
    return stiffnesses + [s.trace for i in problem.interfaces.values() for s in i.sides]


def sequential(dense: np.ndarray) -> Any:
    """A sequential AIJ matrix."""
    a = sp.csr_matrix(dense)
    arrays = (a.indptr.astype(PETSc.IntType), a.indices.astype(PETSc.IntType), a.data)
    matrix = PETSc.Mat().createAIJ(a.shape, csr=arrays, comm=PETSc.COMM_SELF)
    matrix.assemble()
    return matrix


def member(stiffness: Any, **changes: Any) -> Any:
    """A kernel member of two unknowns."""
    given = {
        "name": "bar",
        "stiffness": stiffness,
        "prolongation": None,
        "load": np.zeros((2, 1)),
        "offset": None,
    }
    return _core.Member(**(given | changes))


BAR = np.array([[2.0, -1.0], [-1.0, 1.0]])


# ---------------------------------------------------------------------------------------------
# Ownership
# ---------------------------------------------------------------------------------------------
@pytest.mark.parametrize("active", ["all", ["joint"], ()])
def test_references_are_given_back(problem, active):
    """Neither PETSc's nor Python's counts change, whether a problem is alive or gone."""
    owned = matrices(problem)
    before = [(m.refcount, sys.getrefcount(m)) for m in owned]
    core = build(problem, make_plan(problem, active=active)).structure
    assert [(m.refcount, sys.getrefcount(m)) for m in owned] == before
    core.solve(bridge.laws(core, problem, make_plan(problem, active=active)), amplitudes=np.ones((1, 1)))
    del core
    gc.collect()
    assert [(m.refcount, sys.getrefcount(m)) for m in owned] == before


def test_references_are_given_back_after_an_error(problem):
    matrix = sequential(np.array([[1.0, np.nan], [np.nan, 1.0]]))
    before = matrix.refcount, sys.getrefcount(matrix)
    for _ in range(3):
        with pytest.raises(InputError, match="NaN"):
            member(matrix)
    gc.collect()
    assert (matrix.refcount, sys.getrefcount(matrix)) == before


def test_the_kernel_keeps_what_it_needs(problem):
    """Until the problem is built it holds on to the matrix itself; then the matrix may change."""
    matrix = sequential(BAR)
    before = matrix.getRefCount()
    body = _core.Body(name="bar", size=2, members=[member(matrix)], springs=[])
    assert matrix.getRefCount() > before
    kept = matrix.copy()
    matrix.destroy()
    core = _core.Structure(
        bodies=[body], interfaces=[], operator="automatic", backend="automatic", memory_limit=0.0
    )
    assert core.unknowns == 2 and core.rows == 0
    body = _core.Body(
        name="bar", size=2, members=[member(kept, load=np.array([[0.0], [1.0]]))], springs=[]
    )
    core = _core.Structure(
        bodies=[body], interfaces=[], operator="automatic", backend="automatic", memory_limit=0.0
    )

    def pulled() -> Any:
        one = np.ones((1, 1))
        laws = core.laws()
        _, state = core.solve(laws, amplitudes=one)
        return core.displacements(laws, state, one)["bar"][:, 0]

    assert np.allclose(pulled(), np.linalg.solve(BAR, [0.0, 1.0]))
    kept.scale(-1.0)
    assert np.allclose(pulled(), np.linalg.solve(BAR, [0.0, 1.0]))


def test_states_are_copies(problem):
    result = solve(problem, active="all")
    data = result.state.data.copy()
    again = State(data, result.state.traces)
    data[:] = 0.0
    assert np.array_equal(again.data, result.state.data) and np.any(again.data)


def test_matrices_can_be_inspected(problem):
    """K is a petsc4py matrix of the user: symmetric, rigid motions without force."""
    for name in ("base", "cover"):
        part = problem.substructures[name]
        K = part.stiffness
        assert isinstance(K, PETSc.Mat) and K.getType() == "seqaij"
        assert K.getSize() == (part.size, part.size)
        assert K.isSymmetric(1e-12)
        dense = csr(K).toarray()
        size = np.abs(dense).max()
        assert np.abs(dense - dense.T).max() < 1e2 * EPS * size
        assert np.abs(dense @ part.rigid_modes).max() < 1e3 * EPS * size
        assert np.linalg.eigvalsh(dense).min() > -1e3 * EPS * size
    for side in problem.interfaces["joint"].sides:
        assert isinstance(side.trace, PETSc.Mat)
        points = problem.interfaces["joint"].num_points
        assert side.trace.getSize() == (3 * points, problem.substructures[side.substructure].size)


# ---------------------------------------------------------------------------------------------
# Refusals
# ---------------------------------------------------------------------------------------------
@pytest.mark.parametrize("wrong", [BAR, sp.csr_matrix(BAR), None, "matrix", 3.0])
def test_what_is_no_petsc_matrix(wrong):
    with pytest.raises(TypeError, match=r"petsc4py\.PETSc\.Mat"):
        member(wrong)
    with pytest.raises(TypeError, match=r"petsc4py\.PETSc\.Mat"):
        _core.Side(member="bar", trace=wrong, direction=np.ones(1), scale=1.0)
    with pytest.raises(TypeError, match="spring 'layer': traces must be petsc4py matrices"):
        _core.Spring(
            name="layer",
            members=[0],
            traces=[wrong],
            frames=np.ones((1, 1)),
            stiffness=np.ones(1),
            jump=np.zeros(1),
        )


def test_a_vector_is_no_matrix():
    vector = PETSc.Vec().createSeq(2)
    with pytest.raises(TypeError, match=r"petsc4py\.PETSc\.Mat"):
        member(vector)


def test_a_matrix_that_does_not_exist():
    for empty in (PETSc.Mat(), sequential(BAR).destroy()):
        with pytest.raises((TypeError, ValueError), match=r"petsc4py\.PETSc\.Mat|Mat"):
            member(empty)


def test_dense_and_unassembled_matrices():
    """Any sequential type that has rows will do; one that is not assembled will not."""
    dense = PETSc.Mat().createDense((2, 2), array=BAR.copy(), comm=PETSc.COMM_SELF)
    dense.assemble()
    assert member(dense) is not None
    raw = PETSc.Mat().createAIJ((2, 2), nnz=2, comm=PETSc.COMM_SELF)
    raw.setValue(0, 0, 1.0)
    with pytest.raises((ValueError, RuntimeError), match="PETSc could not|assembled"):
        member(raw)


@pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="needs one rank of many")
def test_a_communicator_of_one_rank_is_sequential():
    """The type may be parallel, as long as all rows are here."""
    a = sp.csr_matrix(BAR)
    arrays = (a.indptr.astype(PETSc.IntType), a.indices.astype(PETSc.IntType), a.data)
    matrix = PETSc.Mat().create(MPI.COMM_WORLD)
    matrix.setSizes((2, 2))
    matrix.setType("mpiaij")
    matrix.setPreallocationCSR(arrays)
    matrix.assemble()
    assert member(matrix) is not None


@pytest.mark.parametrize(
    "change",
    [
        {"load": np.zeros((3, 1))},
        {"offset": np.zeros((3, 1))},
        {"prolongation": sp.csr_matrix(np.ones((3, 2)))},
        {"stiffness": sequential(np.ones((2, 3)))},
    ],
)
def test_shapes_that_disagree(change):
    wrong = member(**({"stiffness": sequential(BAR)} | change))
    body = _core.Body(name="bar", size=2, members=[wrong], springs=[])
    with pytest.raises(InputError, match=r"substructure 'bar': .* do not fit a body of 2 unknowns"):
        _core.Structure(
            bodies=[body],
            interfaces=[],
            operator="automatic",
            backend="automatic",
            memory_limit=0.0,
        )


def interface(trace: Any, **changes: Any) -> Any:
    """A kernel problem of one bar that is held by one spring."""
    side = {"member": "bar", "trace": trace, "direction": np.ones(1), "scale": 1.0}
    given = {
        "name": "wall",
        "law": "perfect",
        "weights": np.ones(1),
        "frames": np.ones((1, 1)),
        "sides": [side],
        "basis": None,
        "paired": False,
    }
    for key, value in changes.items():
        (side if key in side else given)[key] = value
    given["sides"] = [_core.Side(**each) for each in given["sides"]]
    body = _core.Body(name="bar", size=2, members=[member(sequential(BAR))], springs=[])
    return _core.Structure(
        bodies=[body],
        interfaces=[_core.Interface(**given)],
        operator="automatic",
        backend="automatic",
        memory_limit=0.0,
    )


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"sides": []}, "0 sides: give one"),
        ({"weights": np.zeros(1)}, "weights must be positive"),
        ({"weights": np.ones(2)}, "1 frame rows for 2 points"),
        ({"direction": np.ones(2)}, "2 values for 1 rows"),
        ({"direction": np.array([-1.0])}, r"positive and finite \(got -1"),
        ({"direction": np.array([np.inf])}, "positive and finite"),
        ({"scale": 0.0}, "scale is 0"),
        ({"law": "glue"}, "'glue'"),
        ({"member": "rod"}, "unknown substructure 'rod'"),
        ({"trace": sequential(np.ones((2, 2)))}, "wall"),
    ],
)
def test_interfaces_that_make_no_sense(changes, message):
    trace = changes.pop("trace", None) or sequential(np.array([[0.0, 1.0]]))
    with pytest.raises(InputError, match=message):
        interface(trace, **changes)


def test_parameters_are_checked(problem):
    plan = make_plan(problem, active="all")
    laws = bridge.laws(build(problem, plan).structure, problem, plan)

    def changed(interface: str, parameter: str, values: Any) -> Any:
        return laws.with_(parameters={interface: {parameter: values}})

    with pytest.raises(InputError, match="no active interface 'jiont'; active: .*joint"):
        changed("jiont", "normal", np.ones((1, 1)))
    with pytest.raises(InputError, match="interface 'joint': .*'norml'"):
        changed("joint", "norml", np.ones((1, 1)))
    with pytest.raises(InputError, match="'normal' has 2 rows, expected"):
        changed("joint", "normal", np.ones((2, 1)))
    with pytest.raises(InputError, match="interface 'joint': .*normal"):
        changed("joint", "normal", -np.ones((1, 1)))
    assert laws.parameter("joint", "normal") == pytest.approx(10.0)


# ---------------------------------------------------------------------------------------------
# Types
# ---------------------------------------------------------------------------------------------
def test_stub_describes_the_extension():
    """Every class, method and function of the compiled module is in its stub, and nothing else."""
    path = Path(latin_core.__file__).with_name("_core.pyi")
    tree = ast.parse(path.read_text(encoding="utf-8"))
    typing_only = {"BodyCost"}

    def described(body: list[ast.stmt]) -> dict[str, Any]:
        names: dict[str, Any] = {}
        for node in body:
            if isinstance(node, ast.FunctionDef):
                names[node.name] = None
            elif isinstance(node, ast.ClassDef) and node.name not in typing_only:
                names[node.name] = described(node.body)
            elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and node.value is None:
                names[node.target.id] = None
        return names

    def compare(stub: dict[str, Any], real: Any, where: str) -> None:
        public = {name for name in vars(real) if not name.startswith("_")}
        assert {name for name in stub if not name.startswith("_")} == public, where
        for name, inner in stub.items():
            if inner is not None:
                compare(inner, getattr(real, name), f"{where}.{name}")

    compare(described(tree.body), _core, "_core")


def test_bodies_of_a_script_may_outlive_petsc() -> None:
    script = """
import numpy as np
from tests.kernel.bars import chain, elastic, member
from latin_core import Body
from petsc4py import PETSc

bodies = [Body(name="bar", size=5, members=[member(0)])]
structure = chain()
structure.solve(elastic(structure))
PETSc._finalize()
"""
    root = Path(__file__).parents[2]
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and not done.stderr, done.stderr
