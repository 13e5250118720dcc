"""The kernel from plain dolfinx: own forms, own trace matrices, own PETSc matrices, no frontend.

Two elastic blocks touch. The lower one is clamped; the upper one rests on soft ground springs and is pressed
at one side, so that the other side of the joint opens. The joint is unilateral: elastic with the stiffness
kappa where it is closed, free where it is open. The same system is solved directly, by trying which points
are closed. docs/tutorials/raw_dolfinx.md goes through this script step by step.

    ./run python demos/raw_dolfinx.py [--output DIR]      with a folder: two pictures
"""

import argparse
from pathlib import Path

import basix.ufl
import numpy as np
import scipy.sparse as sp
import ufl
from dolfinx import fem, mesh
from dolfinx.fem import petsc
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse.linalg import spsolve

from latin_core import Body, Interface, Member, Options, Side, Structure

parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
parser.add_argument("--output", type=Path, help="folder of the pictures")
output = parser.parse_args().output

# [parts]
E, nu, kappa, width = 200.0, 0.3, 50.0, 2.0
mu, lam = E / (2 * (1 + nu)), E * nu / (1 - nu**2)  # plane stress


def block(bottom, clamped):
    """Displacement space, stiffness, load and the degrees of freedom at the joint (y = 1) of a block."""
    corners = [[0.0, bottom], [width, bottom + 1.0]]
    domain = mesh.create_rectangle(MPI.COMM_SELF, corners, [16, 8], mesh.CellType.quadrilateral)
    V = fem.functionspace(domain, basix.ufl.element("Lagrange", domain.basix_cell(), 1, shape=(2,)))
    u, v, x = ufl.TrialFunction(V), ufl.TestFunction(V), ufl.SpatialCoordinate(domain)
    strain = ufl.sym(ufl.grad(u))
    stress = 2 * mu * strain + lam * ufl.tr(strain) * ufl.Identity(2)
    form = ufl.inner(stress, ufl.sym(ufl.grad(v))) * ufl.dx
    if not clamped:  # on its whole boundary: it can turn, and lift off
        form += 0.5 * ufl.inner(u, v) * ufl.ds
    push = fem.Constant(domain, 0.0 if clamped else 3.0)  # on the left quarter of the upper block
    pressed = ufl.And(ufl.gt(x[1], bottom + 1.0 - 1e-9), ufl.lt(x[0], 0.5))
    load = fem.form(-ufl.conditional(pressed, push, 0.0) * v[1] * ufl.ds)
    zero = np.zeros(2)
    held = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[1], 0.0) & clamped)
    K = petsc.assemble_matrix(fem.form(form), bcs=[fem.dirichletbc(zero, held, V)])
    K.assemble()
    nodes = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[1], 1.0))
    nodes = nodes[np.argsort(V.tabulate_dof_coordinates()[nodes, 0])]
    return V, K, fem.assemble_vector(load).array, nodes


# [trace]
def trace(nodes, size):
    """T (2 m, size): both components of the displacement at the m nodes of the joint."""
    dofs = (2 * nodes[:, None] + np.arange(2)).ravel()
    T = sp.csr_matrix((np.ones(len(dofs)), (np.arange(len(dofs)), dofs)), shape=(len(dofs), size))
    made = PETSc.Mat().createAIJ(T.shape, csr=(T.indptr, T.indices, T.data), comm=PETSc.COMM_SELF)
    return T, made


# [direct]
def closed_by_hand(stiffness, loads, B, w):
    """Displacement of both blocks: which points of the joint are closed is tried until it fits."""
    K, F = sp.block_diag(stiffness, format="csr"), np.concatenate(loads)
    closed = np.ones(B.shape[0], dtype=bool)
    while True:
        u = spsolve((K + B.T @ sp.diags(kappa * w * closed) @ B).tocsc(), F)
        if np.array_equal(closed, B @ u < 0.0):
            return u
        closed = B @ u < 0.0


# [joint]
parts = {name: block(y, name == "lower") for name, y in (("lower", 0.0), ("upper", 1.0))}
m = len(parts["lower"][3])
weights = np.full(m, width / (m - 1)) * np.where(np.isin(np.arange(m), [0, m - 1]), 0.5, 1.0)
frames = np.tile([[0.0, 1.0]], (m, 1))  # one component: the normal out of the first side

bodies, sides, traces = [], [], []
for name, (V, K, load, nodes) in parts.items():
    T, T_petsc = trace(nodes, len(load))
    traces.append(T)
    bodies.append(Body(name=name, members=[Member(name=name, stiffness=K, load=load)]))
    sides.append(Side(member=name, trace=T_petsc, direction=np.full(m, E / 3.0), scale=E))
joint = Interface(name="joint", law="contact", weights=weights, frames=frames, sides=sides)
structure = Structure(bodies=bodies, interfaces=[joint])

# [solve]
laws = structure.laws(parameters={"joint": {"compliance": 1.0 / kappa}})
summary, state = structure.solve(laws, options=Options(rtol=1e-10))
force, jump = structure.local_fields(laws, "joint", state)  # (m, 1) each
u = structure.displacements(laws, state)
print(f"{summary}\n{(force[:, 0] < 0).sum()} of {m} points closed, press with {-weights @ force[:, 0]:.6f}")

# [check]
normal = sp.kron(sp.eye(m), [[0.0, 1.0]])
stiffness = [sp.csr_matrix(K.getValuesCSR()[::-1], shape=K.size) for _, K, _, _ in parts.values()]
B = sp.hstack([-normal @ traces[0], normal @ traces[1]]).tocsr()
exact = closed_by_hand(stiffness, [load for _, _, load, _ in parts.values()], B, weights)
found = np.concatenate([u["lower"][:, 0], u["upper"][:, 0]])
difference = np.linalg.norm(found - exact) / np.linalg.norm(exact)
print(f"relative difference to the direct solution: {difference:.1e}")
assert summary.status == "converged" and difference < 1e-8 and 0 < (force[:, 0] < 0).sum() < m

# [balance]
ground = (stiffness[1] @ u["upper"][:, 0])[1::2].sum()  # only the springs resist a shift: what they hold
left = ground - parts["upper"][2].sum() + weights @ force[:, 0]
pulls, overlaps = max(force[:, 0].max(), 0.0), max(-(jump - force / kappa).min(), 0.0)
print(f"balance of the upper block {left:.0e}, largest traction {pulls:.0e}, overlap {overlaps:.0e}")
assert abs(left) < 1e-8 and pulls <= 0.0 and overlaps < 1e-9
# [end]


def pictures(folder):
    """What was given, and the answer beside the direct one."""
    from matplotlib.collections import PolyCollection
    from matplotlib.figure import Figure

    x = np.linspace(0.0, width, m)
    given, answer = (Figure(figsize=size, layout="constrained") for size in ((4.6, 4.6), (10.0, 4.4)))
    left, right = answer.subplots(1, 2)
    before = given.add_subplot()
    for axis, scale in ((before, 0.0), (left, 1.0)):
        for (name, (V, *_)), colour in zip(parts.items(), ("#b8c4cf", "#d9c9a8"), strict=True):
            moved = V.tabulate_dof_coordinates()[:, :2] + scale * u[name].reshape(-1, 2)
            cells = moved[V.dofmap.list[:, [0, 1, 3, 2]]]
            axis.add_collection(PolyCollection(cells, facecolors=colour, edgecolors="white", lw=0.6))
            if name == "upper":
                for at in moved[np.isclose(V.tabulate_dof_coordinates()[:, 1], 2.0)]:
                    if at[0] < 0.55:
                        style = {"arrowstyle": "-|>", "color": "#b00020", "lw": 1.6}
                        axis.annotate("", at, at + [0.0, 0.3], arrowprops=style)
        axis.plot([0.0, width], [0.0, 0.0], "k", lw=5)
        axis.set(aspect="equal", xlim=(-0.15, width + 0.15), ylim=(-0.1, 2.5), xlabel="x", ylabel="y")
    before.plot(x, np.ones(m), "o", ms=5, color="#0072b2", label=f"{m} points of the joint")
    before.legend(loc="upper right")
    right.plot(x, kappa * np.maximum(-B @ exact, 0.0), "-", lw=4, color="#c8c8c8", label="direct solution")
    right.plot(x, -force[:, 0], "o", ms=5, color="#0072b2", label="kernel")
    right.set(xlabel="x", ylabel="pressure in the joint", ylim=(0.0, None))
    right.legend()
    right.grid(alpha=0.3)
    folder.mkdir(parents=True, exist_ok=True)
    given.savefig(folder / "raw_dolfinx_given.png", dpi=200)
    answer.savefig(folder / "raw_dolfinx.png", dpi=200)


if output is not None:
    pictures(output)
