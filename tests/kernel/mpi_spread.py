"""Program of test_mpi.py: a part whose mesh is spread over the ranks, against the same on one.

``mpirun -n N python mpi_spread.py (columns | inside | points | numbers | meshes)``
"""

from __future__ import annotations

import faulthandler
import sys
from typing import Any

import dolfinx.fem as fem
import dolfinx.mesh as dmesh
import numpy as np
import ufl
from blocks import RANK, WORLD
from mpi4py import MPI
from petsc4py import PETSc

import dolfinx_frontend as lf
from dolfinx_frontend.assembly import assemble as assembly
from dolfinx_frontend import Contact, Elastic, LinearElastic, LogNormal, Normal, Options, Resultant, Scene
from dolfinx_frontend.estimate.mesh_error import deviation_error
from dolfinx_frontend.geometry.parts import Part, located

TESTED = 1e-10
TIGHT = Options(rtol=1e-13, max_iterations=2000)
FACES = {"z0": 0.0, "z1": 1.0}


def block(comm: Any, cells: int, low: float, hexahedra: bool) -> Part:
    """A unit cube with the faces z0 and z1, on a communicator."""
    kind = dmesh.CellType.hexahedron if hexahedra else dmesh.CellType.tetrahedron
    ends = [[0.0, 0.0, low], [1.0, 1.0, low + 1.0]]
    mesh = dmesh.create_box(comm, ends, [cells] * 3, kind)
    facets, tags = [], []
    for tag, at in enumerate(FACES.values(), start=1):
        found = dmesh.locate_entities_boundary(mesh, 2, lambda x, at=at: np.isclose(x[2], low + at))
        facets.append(found)
        tags.append(np.full(len(found), tag, dtype=np.int32))
    order = np.argsort(np.concatenate(facets))
    marked = np.concatenate(facets)[order], np.concatenate(tags)[order]
    return Part(mesh, dmesh.meshtags(mesh, 2, *marked), {name: n for n, name in enumerate(FACES, start=1)})


STEEL = LinearElastic(E=200e3, nu=0.3)


def scene(
    comm: Any, law: Any, degree: int, hexahedra: bool, other: int = 3, cells: int = 3, material: Any = STEEL
) -> Scene:
    """A cube on one rank, on a cube that may be spread; both heavy, pressed together. The material of the
    lower one may be a function of its mesh."""
    made = Scene()
    large = block(comm, cells, 0.0, hexahedra)
    lower = material if isinstance(material, LinearElastic) else material(large.mesh)
    made.substructure("lower", large, lower, degree=degree, body_force=(0, 0, -5.0))
    made.substructure("upper", block(MPI.COMM_SELF, other, 1.0, hexahedra), STEEL, degree=degree)
    made.interface("joint", "upper:z0", "lower:z1", law)
    made.fix("lower:z0")
    made.traction("upper:z1", (12.0, 3.0, -100.0), name="push")
    return made


def same(what: str, one: Any, other: Any) -> None:
    """Refuse digits that differ."""
    one, other = np.asarray(one), np.asarray(other)
    assert one.shape == other.shape, what
    off = np.abs(one - other).max() / np.abs(other).max()
    assert off < TESTED, (what, off)


def sorted_field(x: Any, u: Any) -> Any:
    """Values at places in the order of these."""
    order = np.lexsort(np.round(x, 9).T)
    return u[order]


def answers() -> None:
    """One answer, with springs and with friction, on matching meshes and others; the field in the part."""
    cases = [
        (Elastic(normal=1e5, tangential=4e4), 1, True, 3, 3),
        (Elastic(normal=1e5, tangential=4e4), 1, True, 3, 1),  # ranks without cells
        (Contact(friction=0.2), 2, False, 3, 3),
        (Contact(friction=0.2, stiffness=1e5), 1, True, 4, 3),
    ]
    for law, degree, hexahedra, other, cells in cases:
        given = law, degree, hexahedra, other, cells
        spread = lf.assemble(scene(WORLD, *given), comm=WORLD)
        whole = lf.assemble(scene(MPI.COMM_SELF, *given), comm=MPI.COMM_SELF)
        found, exact = (lf.solve(p, active=["joint"], options=TIGHT) for p in (spread, whole))
        # which of both, rounding decides; it is the same on all ranks of a run
        assert found.status in ("converged", "inexact"), found.status
        assert len(set(WORLD.allgather(found.status))) == 1
        points = [p.interfaces["joint"].points for p in (spread, whole)]
        fields = exact.force("joint"), exact.jump("joint")
        for one, two in zip(found.gathered("joint"), fields, strict=True):
            same(f"{law}", *map(sorted_field, points, (one, two)))
        own = found.displacements.get("lower")
        field = spread.spread["lower"].displacement(own)
        V = field.function_space
        count = V.dofmap.index_map.size_local
        pieces = WORLD.allgather((V.tabulate_dof_coordinates()[:count], field.x.array[: 3 * count]))
        x = np.concatenate([each[0] for each in pieces])
        u = np.concatenate([each[1].reshape(-1, 3) for each in pieces])
        alone = exact.displacements["lower"].reshape(-1, 3)
        there = np.column_stack([whole.substructures["lower"].dof_coordinates])
        same("field", sorted_field(x, u), sorted_field(there, alone))
    print(f"same part on rank {RANK}", flush=True)


def whole_field(field: Any) -> tuple[Any, Any]:
    """Places and values (nodes, components) of a function on the mesh of all ranks."""
    V = field.function_space
    count, size = V.dofmap.index_map.size_local, V.dofmap.bs
    pieces = WORLD.allgather((V.tabulate_dof_coordinates()[:count], field.x.array[: size * count]))
    return np.concatenate([p[0] for p in pieces]), np.concatenate([p[1].reshape(-1, size) for p in pieces])


def loaded(comm: Any, hexahedra: bool) -> Scene:
    """The cubes with loads in the lower one: heat that varies, a force on a face, a form, growing weight."""
    made = scene(comm, Elastic(normal=1e5, tangential=4e4), 2 - hexahedra, hexahedra)
    made.temperature("lower", lambda x: 40.0 + 10.0 * x[:, 2], 1e-5, name="heat")
    made.initial_strain("lower", np.diag([1e-5, 0.0, -2e-5]), name="grown")
    made.body_force("lower", (1.0, 0.0, 3.0), name="wind")
    made.force("lower:z1", (4.0, -2.0, 7.0), name="hand")
    return made


def inside() -> None:
    """Loads inside the part, its displacement and stress, and the way by one factor of PETSc's."""
    options = PETSc.Options()
    for hexahedra, petsc in ((False, False), (True, False), (True, True)):
        if petsc:
            options["latin_part_pc_factor_mat_solver_type"] = "mumps"
        spread = lf.assemble(loaded(WORLD, hexahedra), comm=WORLD)
        if petsc:
            del options["latin_part_pc_factor_mat_solver_type"]
        whole = lf.assemble(loaded(MPI.COMM_SELF, hexahedra), comm=MPI.COMM_SELF)
        found, exact = (lf.solve(p, active=["joint"], options=TIGHT) for p in (spread, whole))
        fields = exact.force("joint"), exact.jump("joint")
        points = [p.interfaces["joint"].points for p in (spread, whole)]
        for one, two in zip(found.gathered("joint"), fields, strict=True):
            same("loads inside", *map(sorted_field, points, (one, two)))
        x, u = whole_field(found.displacement("lower"))
        there = whole.substructures["lower"].dof_coordinates
        alone = exact.displacement("lower").x.array.reshape(-1, 3)
        same("displacement", sorted_field(x, u), sorted_field(there, alone))
        stress, other = found.stress("lower"), exact.stress("lower")
        parts = [each.function_space.mesh.comm.allreduce(moment(each)) for each in (stress, other)]
        same("stress", *parts)
        hot = spread.with_laws(values={"heat.factor": 2.0}), whole.with_laws(values={"heat.factor": 2.0})
        again = [lf.solve(p, active=["joint"], options=TIGHT).displacement("lower") for p in hot]
        x, u = whole_field(again[0])
        same("hotter", sorted_field(x, u), sorted_field(there, again[1].x.array.reshape(-1, 3)))
        settings: dict[str, Any] = {"active": ["joint"], "options": TIGHT, "progress": False}
        sweeps = [lf.sweep(p, {"lower.E": [150e3, 250e3]}, **settings) for p in (spread, whole)]
        forces = [np.moveaxis(each.gathered("joint")[0], 1, 0) for each in sweeps]
        same("swept", *map(sorted_field, points, forces))
    print(f"same inside on rank {RANK}", flush=True)


def moment(stress: Any) -> Any:
    """Integrals of the stress, and of it times x, over the own cells, so that they can be added up."""
    mesh = stress.function_space.mesh
    x = ufl.SpatialCoordinate(mesh)
    each = [stress[i, j] * w for i in range(3) for j in range(3) for w in (1.0, x[0] * x[2])]
    return np.array([fem.assemble_scalar(fem.form(f * ufl.dx)) for f in each])


def pushed(comm: Any, hexahedra: bool) -> Scene:
    """The cubes between two walls, with a random force and random heat in the lower one."""
    made = scene(comm, Elastic(normal=1e5, tangential=4e4), 2 - hexahedra, hexahedra)
    made.fix("upper:z1", name="held")
    made.temperature("lower", Normal("heat", 40.0, cov=0.3), 1e-5, name="heat")
    made.body_force("lower", (1.0, 0.0, Normal("wind", 30.0, cov=0.5)), name="wind")
    return made


PLACES = {"displacement": ("x", "z"), "stress": ("xx", "xz", "mises")}


def estimates() -> None:
    """Errors of the meshes, numbers at points, a force at a point, and the same with another modulus."""
    for degree, hexahedra in ((1, True), (2, False)):
        numbers = []
        for comm in (WORLD, MPI.COMM_SELF):
            made = loaded(comm, hexahedra)
            made.fix("upper:z1", name="held")  # what the joint bears is no matter of statics alone
            made.point_force("lower", (0.4, 0.45, 0.55), (3.0, 1.0, 30.0), name="finger")
            problem = lf.assemble(made, comm=comm)
            result = lf.solve(problem, active=["joint"], options=TIGHT)
            own: list[float] = []
            for quantity in (None, Resultant("joint")):
                found = lf.discretisation_error(result, quantity)
                of_quantity = found.quantity, found.correction, found.bound
                own += [found.energy, *found.parts.values(), *(n for n in of_quantity if n is not None)]
            softer = problem.with_laws(values={"lower.E": 120e3})
            others = (result, lf.solve(softer, active=["joint"], options=TIGHT))
            for answer, of in ((a, of) for a in others for of in PLACES):
                for component in PLACES[of]:
                    probe = lf.AtPoint(problem, "lower", (0.52, 0.41, 0.57), of, component)
                    own.append(float(answer.quantity(probe).values[0]))
            for answer in others:
                most = answer.stress("lower", of="von Mises")
                own.append(most.function_space.mesh.comm.allreduce(most.x.array.max(), op=MPI.MAX))
            probe = lf.AtPoint(problem, "lower", (0.52, 0.41, 0.57), "stress", "zz")
            samples = lf.sweep(
                problem, {"heat.factor": [1.0, 2.0]}, active=["joint"], options=TIGHT, keep_states=True,
                progress=False,
            )  # fmt: skip
            own += samples.quantity(probe).values.tolist()
            # another rank has it, or the same one: all know its number
            upper = lf.AtPoint(problem, "upper", (0.5, 0.5, 1.4), "stress", "zz")
            both = lf.Measure(lambda f, a=probe, b=upper: a(f) + b(f), "both")
            own.append(result.mean_std(both).mean)
            if degree == 1:
                found = lf.discretisation_error(result, upper)
                own += [found.quantity, found.uncancelled]
                problem = lf.assemble(pushed(comm, hexahedra), comm=comm)
                mean, chaos = (lf.solve(problem, active=["joint"], options=TIGHT, chaos=c) for c in (None, 1))
                off = deviation_error(mean, chaos, Resultant("joint"))
                own += [off.std, off.quantity, off.bound]
            numbers.append(own)
        for one, other in zip(*numbers, strict=True):
            same("estimates", one, other)
    print(f"same estimates on rank {RANK}", flush=True)


def random() -> None:
    """Chaos, samples, and a modulus that varies."""
    law = Elastic(normal=LogNormal("k", 1e5, cov=0.2), tangential=4e4)
    problems = [
        lf.assemble(scene(comm, law, 1, True), comm=comm) for comm in (WORLD, MPI.COMM_SELF)
    ]
    chaos = [lf.solve(p, chaos=2, active=["joint"], options=TIGHT) for p in problems]
    means = [each.gathered("joint")[0] for each in chaos]
    same("chaos", *means)
    settings: dict[str, Any] = {"active": ["joint"], "options": TIGHT, "progress": False}
    samples = [lf.sample(p, [[0.3], [-1.0]], **settings) for p in problems]
    same("samples", *(each.gathered("joint")[0] for each in samples))
    sweeps = [lf.sweep(p, {"lower.E": [150e3, 250e3]}, **settings) for p in problems]
    same("sweep", *(each.gathered("joint")[0] for each in sweeps))
    same("reaction", *(each.mean_std(Resultant("joint")).mean for each in chaos))
    print(f"same columns on rank {RANK}", flush=True)


def halves(low: float) -> Part:
    """The unit cube without its middle layer of cells: the upper half hangs in the air."""
    ends = [[0.0, 0.0, low], [1.0, 1.0, low + 1.0]]
    mesh = dmesh.create_box(WORLD, ends, [3, 3, 5], dmesh.CellType.hexahedron)
    count = mesh.topology.index_map(3).size_local
    x = dmesh.compute_midpoints(mesh, 3, np.arange(count, dtype=np.int32))
    kept = np.flatnonzero(np.abs(x[:, 2] - low - 0.5) > 0.05).astype(np.int32)
    own = dmesh.create_submesh(mesh, 3, kept)[0]
    found = dmesh.locate_entities_boundary(own, 2, lambda x: np.isclose(x[2], low))
    return Part(own, dmesh.meshtags(own, 2, found, np.full(len(found), 1, dtype=np.int32)), {"z0": 1})


L_FORCE = 0.0052855607
"""Force on the joint of :func:`corner` with springs, on one rank, solved to 1e-5 (1e-4: 8e-6 off)."""


def corner(comm: Any, law: Any, kind: str, spread: str = "L", degree: int = 1) -> Scene:
    """An L with a re-entrant corner below a block, one of which may be spread."""
    cell = dmesh.CellType.quadrilateral if kind == "quadrilateral" else dmesh.CellType.triangle
    made = Scene()
    for name, low, high, cells in (("L", 0.0, (2.0, 2.0), [4, 4]), ("block", 2.0, (1.0, 3.0), [2, 2])):
        of = comm if name == spread else MPI.COMM_SELF
        mesh = dmesh.create_rectangle(of, [[0.0, low], high], cells, cell)
        count = mesh.topology.index_map(2).size_local
        x = dmesh.compute_midpoints(mesh, 2, np.arange(count, dtype=np.int32))
        kept = np.flatnonzero((x[:, 0] < 1.0) | (x[:, 1] < 1.0) | (low > 0.0)).astype(np.int32)
        part = dmesh.create_submesh(mesh, 2, kept)[0]
        faces = {
            "low": lambda x, at=low: np.isclose(x[1], at),
            "high": lambda x, at=high[1]: np.isclose(x[1], at),
            "far": lambda x: np.isclose(x[0], 2.0),
        }
        made.substructure(name, located(part, faces), LinearElastic(E=1000.0, nu=0.3), degree=degree)
    made.fix("L:low")
    made.fix("block:high")
    made.interface("joint", "L:high", "block:low", law)
    made.traction("L:far", (0.3, -1.0) if law.unilateral else (0.3, 1.0))
    return made


def meshes() -> None:
    """Meshes that follow the question: those of one rank, whichever of two parts is spread; a part that does
    not decide is condensed once."""
    soft = Elastic(500.0, 500.0)
    cases: list[tuple[str, str, Any, int, float]] = [
        ("triangle", "L", soft, 1, 2e-2),
        ("triangle", "block", Elastic(5.0, 5.0), 2, 5e-2),
        ("quadrilateral", "L", Contact(), 3, 0.1),
    ]
    condensed: list[str] = []
    way = assembly.condensed

    def counted(spec: Any, *args: Any) -> Any:
        condensed.append(spec.name)
        return way(spec, *args)

    assembly.condensed = counted
    for kind, spread, law, degree, accuracy in cases:
        condensed.clear()
        results = []
        for comm in (WORLD, MPI.COMM_SELF):
            made = corner(comm, law, kind, spread, degree)
            results.append(lf.solve(made, accuracy=accuracy, quantity="joint", comm=comm, progress=False))
        found, exact = (each.errors() for each in results)
        what = kind, spread, law
        assert found.reached and exact.reached, (what, str(found), str(exact))
        for one, other in zip(found.steps, exact.steps, strict=True):
            assert (one.unknowns, one.changed) == (other.unknowns, other.changed), (what, one, other)
        assert [(p.part, p.cells) for p in found.places] == [(p.part, p.cells) for p in exact.places], what
        for one, other in zip(found.moments, exact.moments, strict=True):
            assert one == other or abs(one - other) <= 0.02 * accuracy * abs(other), (what, one, other)
        assert len(set(WORLD.allgather(found.moments))) == 1
        if law is soft:
            assert abs(found.moments.mean / L_FORCE - 1.0) <= accuracy, (what, found.moments)
        changed = [step.changed[spread] for step in found.steps if spread in step.changed]
        assert len(condensed) == 1 + len(changed), (what, condensed, changed)
        assert any("cut" in each for each in changed) if spread == "L" else not changed, (what, changed)
        if RANK == 0:
            print(what, len(found.steps), changed, flush=True)
    assembly.condensed = way
    print(f"same meshes on rank {RANK}", flush=True)


def loose() -> None:
    """A piece of the mesh that hangs on nothing, and a stiffness that is no number."""
    for name in ("loose", "nan"):
        made = Scene()
        part = halves(0.0) if name == "loose" else block(WORLD, 3, 0.0, True)
        modulus = fem.Constant(part.mesh, 200e3 if name == "loose" else np.nan)
        made.substructure("b", part, LinearElastic(E=modulus, nu=0.3), degree=1)
        made.fix("b:z0")
        try:
            lf.assemble(made, comm=WORLD)
        except lf.SceneError as error:
            assert "positive definite" in str(error) if name == "loose" else "finite" in str(error), error
        else:
            raise AssertionError(name)


def graded(mesh: Any) -> Any:
    """A form with fields, a constant and a place in it."""
    soft, steps = (fem.Function(fem.functionspace(mesh, each)) for each in (("Lagrange", 2), ("DG", 0)))
    soft.interpolate(lambda x: 1.0 + x[0] * x[2])
    steps.interpolate(lambda x: 1.0 + x[1] ** 2)
    modulus = fem.Constant(mesh, 100e3) * soft * steps * (2.0 + ufl.SpatialCoordinate(mesh)[1])
    material = LinearElastic(E=modulus, nu=0.3)
    return lambda u, v: material.bilinear(u, v) * ufl.dx(domain=mesh)


def tagged(mesh: Any) -> Any:
    """A form over tagged cells, which are all."""
    count = mesh.topology.index_map(3).size_local
    cells = np.arange(count, dtype=np.int32)
    of_cells = ufl.Measure("dx", mesh, subdomain_data=dmesh.meshtags(mesh, 3, cells, cells * 0 + 7))
    return lambda u, v: STEEL.bilinear(u, v) * of_cells(7)


def fields() -> None:
    """The mesh errors of a part whose material is a form with fields."""
    law = Elastic(normal=1e5, tangential=4e4)
    for degree, hexahedra in ((1, True), (2, False)):
        numbers = []
        for comm in (WORLD, MPI.COMM_SELF):
            made = scene(comm, law, degree, hexahedra, material=graded)
            made.fix("upper:z1", name="held")
            result = lf.solve(lf.assemble(made, comm=comm), active=["joint"], options=TIGHT)
            found = lf.discretisation_error(result, Resultant("joint"))
            numbers.append([found.energy, *found.parts.values(), found.quantity, found.bound])
        same("fields", *numbers)


def points() -> None:
    """The mesh errors of numbers inside of a part, and where they come from."""
    law = Contact(stiffness=1e5, friction=0.3)
    for degree, hexahedra in ((1, True), (2, False)):
        found = []
        for comm in (WORLD, MPI.COMM_SELF):
            made = scene(comm, law, degree, hexahedra)
            made.fix("upper:z1", name="held")
            problem = lf.assemble(made, comm=comm)
            result = lf.solve(problem, active=["joint"], options=TIGHT)
            for of, component in (("displacement", "z"), ("stress", "zz"), ("stress", "mises")):
                at = lf.AtPoint(problem, "lower", (0.52, 0.41, 0.57), of, component)
                found.append(lf.discretisation_error(result, at))
        for one, other in zip(found[:3], found[3:], strict=True):
            assert other.quantity > 1e-3 * abs(other.value)
            for read in ("energy", "quantity", "correction", "value", "seen", "uncancelled"):
                same(read, getattr(one, read), getattr(other, read))
            if "lower" in one.cells:
                same("cells", np.sort(one.cells["lower"]), np.sort(other.cells["lower"]))
    steps = []
    for comm in (WORLD, MPI.COMM_SELF):
        made = corner(comm, Elastic(normal=1e3, tangential=1e3), "triangle")
        at = lf.AtPoint(lf.assemble(made, comm=comm), "L", (0.3, 0.31), "stress", "yy")
        result = lf.solve(made, accuracy=5e-2, quantity=at, comm=comm, progress=False)
        steps.append([(each.unknowns, each.changed) for each in result.errors().steps])
    assert steps[0] == steps[1] and any("cut" in str(each) for each in steps[0]), steps
    print(f"same points on rank {RANK}", flush=True)


def refused() -> None:
    """What such a part cannot have."""
    law = Elastic(normal=1e5, tangential=4e4)
    made = scene(WORLD, law, 1, True)
    for wrong, comm, text in (
        (made, None, "assemble(scene, comm=...)"),
    ):
        try:
            lf.assemble(wrong, comm=comm)
        except lf.SceneError as error:
            assert text in str(error), error
        else:
            raise AssertionError(text)
    made = scene(WORLD, law, 1, True, material=tagged)
    result = lf.solve(lf.assemble(made, comm=WORLD), active=["joint"])
    try:
        lf.discretisation_error(result)
    except lf.SceneError as error:
        assert "is spread over the" in str(error) and "subdomains" in str(error), error
    else:
        raise AssertionError("the stress of a form")
    found = result.errors("joint")
    assert np.isnan(found.in_all) and found.discretisation is not None, found
    assert "not known" in found.discretisation.how, found.discretisation
    for point in ((0.5, 0.5, 1.5), (0.5, -0.1, 0.5)):
        try:
            lf.AtPoint(result.problem, "lower", point)
        except lf.SceneError as error:
            assert "outside the part" in str(error), error
        else:
            raise AssertionError("a point outside")
    print(f"refused on rank {RANK}", flush=True)


if __name__ == "__main__":
    faulthandler.dump_traceback_later(100, exit=True)
    calls: dict[str, Any] = {"columns": (answers, random), "inside": (inside, loose, fields, refused)}
    calls |= {"points": (points,), "numbers": (estimates,), "meshes": (meshes,)}
    for each in calls[sys.argv[1]]:
        each()
