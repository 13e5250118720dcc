"""The direct solve of all parts, against exact solutions."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter

import numpy as np
import pytest

from dolfinx_frontend import geometry
from dolfinx_frontend.assembly.assemble import assemble
from dolfinx_frontend.assembly.rigid import check_rigid_bodies
from dolfinx_frontend.plan.reduction import reduce
from dolfinx_frontend.reference.cholesky import solvers
from dolfinx_frontend.reference.direct import Monolithic, monolithic
from dolfinx_frontend.reference.energy import energy_error
from dolfinx_frontend.scene.laws import Elastic, Perfect, Pressure
from dolfinx_frontend.scene.materials import LinearElastic
from dolfinx_frontend.scene.scene import Scene
from parts.rings import annulus, two_rings
from parts.unit import measure_unit
from tests.helpers import block, lame, small_assembly, wavy

EPS = np.finfo(float).eps
STEEL = LinearElastic(2e5, 0.3)


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_patch(cell):
    """Uniform tension passes through a glued interface of distorted meshes."""
    n = [2, 2, 2]
    scene = Scene()
    lower = block(cell, n, mapping=wavy(0.08, 2), seed=5)
    upper = block(cell, n, [0, 0, 1], [1, 1, 2], mapping=wavy(0.08, 2), seed=6)
    for name, part in (("a", lower), ("b", upper)):
        scene.substructure(name, part, STEEL, degree=2)
    scene.interface("glue", "a:z1", "b:z0", Perfect())
    scene.symmetry(["a:x0", "a:y0", "a:z0", "b:x0", "b:y0"])
    scene.traction("b:z1", (0.0, 0.0, 10.0))
    problem = assemble(scene)
    solution = monolithic(problem)
    for name, u in solution.u.items():
        x = problem.substructures[name].dof_coordinates
        exact = 10.0 / 2e5 * x * np.array([-0.3, -0.3, 1.0])
        assert np.abs(u.reshape(-1, 3) - exact).max() < 1e-10 * np.abs(exact).max()


def ring(n, nu=0.3):
    scene = Scene()
    part = annulus(100.0, 200.0, divisions=(n, 2 * n))
    scene.substructure("ring", part, LinearElastic(2e5, nu), degree=2)
    scene.symmetry(["ring:theta0", "ring:theta1"])
    scene.pressure("ring:inner", 1.6, "bore")
    return assemble(scene)


def test_lame_ring_converges():
    """u(a), u(b) of TARGETS and the rate of the energy, twice the degree."""
    exact_a, exact_b = (lame(r, 100, 200, 1.6, 0, 2e5, 0.3) for r in (100.0, 200.0))
    assert exact_a == pytest.approx(1.525333e-3, abs=5e-10)
    assert exact_b == pytest.approx(9.706667e-4, abs=5e-11)
    energy = 0.5 * 1.6 * exact_a * np.pi / 2 * 100
    errors = []
    for n in (2, 4, 8):
        problem = ring(n)
        solution = monolithic(problem)
        errors.append(abs(solution.energy - energy) / energy)
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert rates[-1] == pytest.approx(4.0, abs=0.1)
    s = problem.substructures["ring"]
    r = np.linalg.norm(s.dof_coordinates, axis=1)
    radial = np.einsum("ni,ni->n", solution.u["ring"].reshape(-1, 2), s.dof_coordinates) / r
    assert radial == pytest.approx(lame(r, 100, 200, 1.6, 0, 2e5, 0.3), rel=2 * errors[-1] ** 0.5)
    assert radial[r < 100.001] == pytest.approx(exact_a, rel=10 * errors[-1])


def test_oblique_symmetry():
    """A sector of 22.5 degrees behaves like the whole ring, and w . n = 0 on its oblique side."""
    scene = Scene()
    part = annulus(100.0, 200.0, np.pi / 8, (4, 2))
    scene.substructure("ring", part, STEEL, degree=2)
    scene.symmetry(["ring:theta0", "ring:theta1"])
    scene.pressure("ring:inner", 1.6)
    problem = assemble(scene)
    solution = monolithic(problem)
    u = solution.u["ring"].reshape(-1, 2)
    for name in ("symmetry(ring:theta0)", "symmetry(ring:theta1)"):
        assert np.abs(solution.traces[name][0][:, 0]).max() < 20 * EPS * np.abs(u).max()
    x = problem.substructures["ring"].dof_coordinates
    inside = np.linalg.norm(x, axis=1) < 100.001
    exact = lame(100.0, 100, 200, 1.6, 0, 2e5, 0.3)
    assert np.linalg.norm(u[inside], axis=1) == pytest.approx(exact, rel=2e-4)


@pytest.mark.parametrize("outer", [None, (8, 24)])
def test_split_lame_ring(outer):
    """Jump p_c / k across an elastic joint at r = c, on meshes that match and that do not."""
    a, c, b, p, k, E, nu = 100.0, 150.0, 200.0, 1.6, 2e3, 2e5, 0.3
    rings = two_rings(a, c, b, divisions=(8, 16), outer_divisions=outer)
    scene = Scene()
    for name, part in rings.parts.items():
        scene.substructure(name, part, LinearElastic(E, nu), degree=2)
    # across facets that do not match the integrand has kinks: a finer rule
    degree = None if outer is None else 12
    law = Elastic(normal=k)
    scene.interface("joint", "inner:outer", "outer:inner", law, quadrature_degree=degree)
    scene.pressure("inner:inner", p)
    scene.symmetry([f"{part}:{face}" for part in rings.parts for face in ("theta0", "theta1")])
    problem = assemble(scene)
    solver = Monolithic(problem)
    for stiffness in (k, 10 * k):
        solution = solver.solve(values={"joint.normal": stiffness})
        compliance = lame(c, c, b, 1, 0, E, nu) - lame(c, a, c, 0, 1, E, nu) + 1 / stiffness
        contact = lame(c, a, c, p, 0, E, nu) / compliance
        force = solution.forces["joint"]
        assert np.abs(force[:, 0] + contact).max() < 2e-3 * contact
        i = problem.interfaces["joint"]
        assert i.weights @ -force[:, 0] / i.area == pytest.approx(contact, rel=2e-5)
        w1, w2 = solution.traces["joint"]
        jump = i.weights @ (w2 - w1)[:, 0] / i.area
        assert jump == pytest.approx(-contact / stiffness, rel=2e-5)
        assert np.array_equal(force[:, 1], np.zeros(i.num_points))


def test_bolted_pair_of_springs():
    """Joint force k (K D - Q) / (K + k), bolt tension N + Q, whatever the blocks are made of."""
    K, k, D, Q = 50.0, 400.0, 0.2, 6.0
    scene = Scene()
    for level, name in enumerate(("base", "cover")):
        part = geometry.box((2.0, 3.0, 1.0), (2, 2, 1), (0, 0, level))
        scene.substructure(name, part, LinearElastic(30.0, 0.0), degree=1)
    scene.fix("base:z0")
    scene.symmetry(["cover:x0", "cover:y0"])
    scene.interface("joint", "base:z1", "cover:z0", Elastic(normal=k, total=True))
    scene.interface("bolt", "base:z1", "cover:z0", Elastic(normal=K, jump=-D, total=True))
    scene.traction("cover:z1", (0.0, 0.0, Q / 6.0))
    problem = assemble(scene)
    for pull in (Q, 9.0):
        solution = monolithic(problem, values={"traction(cover:z1).t": (0.0, 0.0, pull / 6.0)})
        area = problem.interfaces["joint"].weights
        joint, bolt = (area @ solution.forces[n][:, 0] for n in ("joint", "bolt"))
        N = k * (K * D - pull) / (K + k)
        assert -joint == pytest.approx(N, rel=1e-12)
        assert bolt == pytest.approx(N + pull, rel=1e-12)


def test_energy_error():
    problem = small_assembly(glue=Elastic(normal=5.0, tangential=5.0))
    reference = monolithic(problem)
    assert energy_error(problem, reference.u, reference.u) == 0.0
    error = {n: 1e-3 * u for n, u in reference.u.items()}
    u = {n: reference.u[n] + e for n, e in error.items()}
    parts = sum(e @ (problem.substructures[n].matrix @ e) for n, e in error.items())
    whole = sum(w @ (problem.substructures[n].matrix @ w) for n, w in reference.u.items())
    assert energy_error(problem, u, reference.u, springs=False) == pytest.approx(
        np.sqrt(parts / whole), rel=1e-9
    )
    assert energy_error(problem, u, reference.u) > 0.0


def test_solvers_agree_and_the_unit_is_measured():
    problem = ring(3)
    u = [monolithic(problem, solver=s).u["ring"] for s in solvers()]
    for other in u[1:]:
        assert np.abs(other - u[0]).max() < 1e-11 * np.abs(u[0]).max()
    measured = measure_unit(problem)
    (body,) = reduce(problem, problem.interfaces)
    assert measured.dof == body.n and measured.seconds > 0 and measured.solver in solvers()


def test_laws_are_overridden():
    problem = ring(2)
    once = monolithic(problem)
    twice = monolithic(problem, values={"bore.p": 3.2})
    varying = monolithic(problem, laws={"bore": Pressure(lambda x: 1.6 + 0.0 * x[:, 0])})
    assert twice.u["ring"] == pytest.approx(2 * once.u["ring"], rel=1e-10, abs=1e-15)
    assert varying.u["ring"] == pytest.approx(once.u["ring"], rel=1e-12, abs=1e-16)
    law = Elastic(normal=1.0)
    assert law.with_(normal=2.0) == replace(law, normal=2.0)
    assert law.parameters() == {"normal": 1.0, "jump": 0.0}


def test_units_do_not_matter():
    """Pairing, elimination and rigid-body checks are the same in any unit of length and force."""
    shortening = []
    for length, stress in ((1.0, 1.0), (1e-3, 1e6), (1e6, 1e-9), (1e-9, 1.0)):
        scene = Scene()
        for k, name in enumerate(("a", "b")):
            part = geometry.box((length,) * 3, (2, 2, 1), (0, 0, k * length))
            scene.substructure(name, part, LinearElastic(2e5 * stress, 0.3), degree=1)
        scene.interface("joint", "a:z1", "b:z0", Elastic(normal=1e5 * stress / length))
        scene.fix("a:z0")
        scene.symmetry(["b:x0", "b:y0"])
        scene.pressure("b:z1", 10.0 * stress)
        solution = monolithic(assemble(scene))
        shortening.append(solution.u["b"].reshape(-1, 3)[:, 2].min() / length)
    assert shortening == pytest.approx([shortening[0]] * 4, rel=1e-9)


def chain(n, d=3):
    """Synthetic parts in a row with the points of their common faces."""
    parts = {f"p{k}": (np.eye(d)[0] * (k + 0.5), 1.0) for k in range(n)}
    grid = np.array([[0.0, y, z] for y in (0.1, 0.5, 0.9) for z in (0.1, 0.5, 0.9)])
    return parts, grid


@pytest.mark.parametrize("directions", [3, 1])
def test_a_thousand_parts(directions):
    """Glued parts merge; frictionless ones leave 6 unknowns a part for the sparse null space."""
    parts, grid = chain(1000)
    rows = np.tile(np.eye(3)[:directions], (9, 1, 1))
    weights = np.full(9, 1 / 9)
    links = {
        f"i{k}": ((f"p{k - 1}", f"p{k}"), grid + [k, 0, 0], weights, rows) for k in range(1, 1000)
    }
    links["end"] = (("p0",), grid, weights, np.tile(np.eye(3), (9, 1, 1)))
    begin = perf_counter()
    if directions == 3:
        check_rigid_bodies(parts, links)
    else:
        with pytest.raises(ValueError, match="translation along y"):
            check_rigid_bodies(parts, links)
    assert perf_counter() - begin < 20.0
