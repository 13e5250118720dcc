"""Monolithic SSFEM: against closed forms, tensor quadrature of deterministic solves, and itself.

With affine parameters the Galerkin matrices of a tensor basis of order p are all diagonal in one
basis, that of the (p + 1)^L Gauss points.  So SSFEM equals the tensor Gauss quadrature of
deterministic solves to rounding, products of random stiffnesses, jumps and loads included: no
tolerance for the order is needed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from latin_core import stochastic as core
from petsc4py import PETSc
from scipy import integrate, linalg, stats

from dolfinx_frontend import geometry
from dolfinx_frontend.assembly.assemble import assemble
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.reference.direct import Monolithic, monolithic
from dolfinx_frontend.reference.energy import energy_error
from dolfinx_frontend.reference.galerkin import (
    SSFEMSolution,
    _System,
    smallest_eigenvalue,
    ssfem,
)
from dolfinx_frontend.scene.laws import Displacement, Elastic, Perfect, Pressure, Symmetry, Traction
from dolfinx_frontend.scene.materials import LinearElastic
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.uncertainty.chaos import Chaos
from dolfinx_frontend.uncertainty.correlated import Correlated
from dolfinx_frontend.uncertainty.fields import RandomField
from dolfinx_frontend.uncertainty.parameters import Gamma, LogNormal, Normal, TruncatedNormal, Uniform
from parts.rings import two_rings
from parts.vessel import bolted_vessel
from tests.helpers import block, lame

pytestmark = pytest.mark.sanitize

Array = npt.NDArray[np.float64]

E, LENGTH, PULL, KBAR = 200e3, 20.0, 10.0, 50.0  # MPa, mm, MPa, N/mm^3


@pytest.fixture(scope="module")
def bars() -> Problem:
    """Two bars with a layer between them, held on the left and pulled on the right; nu = 0."""
    scene = Scene()
    for name, x0 in (("left", 0.0), ("right", LENGTH)):
        part = geometry.box((LENGTH, 10.0), (2, 2), origin=(x0, 0.0), cell="quadrilateral")
        scene.substructure(name, part, LinearElastic(E, 0.0), degree=1)
    scene.interface("layer", "left:x1", "right:x0", Elastic(normal=KBAR, tangential=KBAR))
    scene.interface("wall", "left:x0", Displacement())
    scene.interface("pull", "right:x1", Traction((PULL, 0.0)))
    return assemble(scene)


@pytest.fixture(scope="module")
def frame() -> Problem:
    """Blocks that are sheared and squeezed: every kind of interface, nothing symmetric."""
    scene = Scene()
    for name, x0, y0, n in (("a", 0, 0, (3, 2)), ("b", 1, 0, (2, 2)), ("c", 1, 1, (2, 3))):
        part = block("quadrilateral", n, (x0, y0), (x0 + 1.0, y0 + 1.0))
        scene.substructure(name, part, LinearElastic(1e3, 0.3), degree=2)
    scene.interface("joint", "a:x1", "b:x0", Elastic(normal=2e3, tangential=900.0, jump=-0.01))
    scene.interface("glue", "b:y1", "c:y0", Perfect())
    scene.interface("wall", "a:x0", Displacement())
    scene.interface("bed", "b:y0", Elastic(normal=500.0, tangential=50.0))
    scene.interface("roof", "c:y1", Pressure(3.0))
    scene.interface("side", "c:x1", Displacement(components=(0,)))
    return assemble(scene)


def kappa(value: Any) -> Elastic:
    return Elastic(normal=value, tangential=value)


def stretch(problem: Problem, solution: SSFEMSolution) -> Array:
    """Chaos (P + 1,) of the displacement of the pulled end."""
    x = problem.substructures["right"].dof_coordinates
    ends = solution.coefficients["right"][::2][x[:, 0] > 2 * LENGTH - 1e-9]
    assert np.ptp(ends, axis=0).max() < 1e-10 * abs(ends).max()
    return ends[0]


def by_quadrature(problem: Problem, solution: SSFEMSolution, counts: Any) -> dict[str, Array]:
    """Coefficients on the same basis by tensor Gauss quadrature of deterministic solves."""
    rule = solution.space.tensor_gauss(counts)
    psi = solution.basis.evaluate(rule.points)
    solver = Monolithic(problem)
    out = {name: np.zeros_like(u) for name, u in solution.coefficients.items()}
    for point, weight, modes in zip(rule.points, rule.weights, psi, strict=True):
        u = solver.solve(solution.random.at(point)).u
        for name in out:
            out[name] += weight * u[name][:, None] * modes
    return out


def same(problem: Problem, solution: SSFEMSolution, other: dict[str, Array], rtol: float) -> None:
    assert energy_error(problem, solution.coefficients, other) < rtol


def field_errors(problem: Problem, solution: SSFEMSolution, exact: dict[str, Array]) -> Array:
    """Errors of the mean (energy norm) and of the standard deviation (Euclidean), relative."""
    first = {name: u[:, :1] for name, u in solution.coefficients.items()}
    mean = energy_error(problem, first, {name: u[:, :1] for name, u in exact.items()})
    std = np.concatenate([np.linalg.norm(u[:, 1:], axis=1) for u in exact.values()])
    got = np.concatenate([solution.std(name) for name in exact])
    return np.array([mean, np.linalg.norm(got - std) / np.linalg.norm(std)])


# ---------------------------------------------------------------------------------------------
# Random spring between two bars: u = PULL (2 L / E + 1 / k)
# ---------------------------------------------------------------------------------------------
BARS = 2 * PULL * LENGTH / E


def moments(
    problem: Problem, parameter: Any, order: int, solver: Any = "cg"
) -> tuple[float, float]:
    """Mean and variance of kbar / k that the displacement of the end tells."""
    chain = problem.with_laws({"layer": kappa(parameter)})
    u = stretch(chain, ssfem(chain, Chaos(order), solver)) * KBAR / PULL
    return float(u[0] - BARS * KBAR / PULL), float(u[1:] @ u[1:])


@pytest.mark.parametrize(("order", "mean"), [(2, 1.04545455), (3, 1.04602510), (4, 1.04615385)])
def test_normal_spring(bars: Problem, order: int, mean: float) -> None:
    """Mean and variance are the values of the (p + 1)-point Gauss-Hermite rule."""
    x, w = np.polynomial.hermite_e.hermegauss(order + 1)
    w = w / w.sum()
    first, second = w @ (1 / (1 + 0.2 * x)), w @ (1 / (1 + 0.2 * x) ** 2)
    for solver in ("cg", "direct"):
        got = moments(bars, Normal("k", KBAR, cov=0.2), order, solver)
        assert got[0] == pytest.approx(mean, abs=1e-8)
        assert got == pytest.approx((first, second - first**2), rel=1e-10)


def truncated_moments() -> tuple[float, float]:
    law = stats.truncnorm(-3, 3)

    def moment(power: int) -> float:
        return float(
            integrate.quad(lambda x: law.pdf(x) / (1 + 0.2 * x) ** power, -3, 3, epsabs=1e-13)[0]
        )

    return moment(1), moment(2) - moment(1) ** 2


D2, S = 0.04, 0.2 * np.sqrt(3.0)
LOG = np.log((1 + S) / (1 - S)) / (2 * S)


CLOSED_FORMS = {
    "lognormal": (LogNormal("k", KBAR, cov=0.2), 1 + D2, (1 + D2) ** 2 * D2),
    "gamma": (
        Gamma("k", KBAR, cov=0.2),
        1 / (1 - D2),
        1 / ((1 - D2) * (1 - 2 * D2)) - 1 / (1 - D2) ** 2,
    ),
    "uniform": (Uniform("k", mean=KBAR, cov=0.2), LOG, 1 / (1 - S**2) - LOG**2),
    "truncated": (TruncatedNormal("k", KBAR, cov=0.2, within=3.0), *truncated_moments()),
}


@pytest.mark.parametrize(
    ("law", "target", "decay", "last"),
    [
        ("lognormal", 1.04, 25.0, (1e-11, 5e-8)),
        ("gamma", 1 / 0.96, 4.0, (3e-6, 1e-3)),
        ("uniform", 1.04315242, 15.0, (5e-9, 1e-6)),
        ("truncated", 1.04414285, 5.0, (2e-6, 3e-4)),
    ],
)
def test_positive_springs(
    bars: Problem, law: str, target: float, decay: float, last: tuple[float, float]
) -> None:
    """E[kbar/k] and Var[kbar/k] in closed form; both errors fall by a factor from order to order.

    A Gauss rule is behind both (order p: p + 1 points), so the factor is the square of the distance
    of the pole k = 0 from the range of k: algebraic for gamma, whose range touches it.
    """
    parameter, mean, variance = CLOSED_FORMS[law]
    assert mean == pytest.approx(target, abs=1e-8)
    got = np.array([moments(bars, parameter, order) for order in (1, 2, 3, 4, 5)])
    errors = np.abs(got - [mean, variance]) / [mean, variance]
    assert np.all(errors[:-1] / errors[1:] > decay)
    assert np.all(errors[-1] < last)


def test_coefficients_of_a_lognormal_spring(bars: Problem) -> None:
    """1 / k is lognormal too: kbar / k = 1.04 sum (-s)^j / sqrt(j!) psi_j, s^2 = log(1 + cov^2)."""
    chain = bars.with_laws({"layer": kappa(LogNormal("k", KBAR, cov=0.2))})
    u = stretch(chain, ssfem(chain, Chaos(6))) * KBAR / PULL
    s = np.sqrt(np.log1p(0.04))
    k = np.arange(1, 4)
    exact = 1.04 * (-s) ** k / np.sqrt([1.0, 2.0, 6.0])
    assert u[1:4] == pytest.approx(exact, rel=1e-6)


def test_chaos_of_order_zero_is_the_mean(bars: Problem) -> None:
    chain = bars.with_laws({"layer": kappa(LogNormal("k", KBAR, cov=0.2))})
    solution = ssfem(chain, Chaos(0))
    reference = monolithic(chain)
    assert energy_error(chain, {n: solution.mean(n) for n in reference.u}, reference.u) < 1e-10
    moved = {name: 1.001 * u for name, u in solution.coefficients.items()}
    one = energy_error(chain, {name: u[:, 0] for name, u in moved.items()}, reference.u)
    assert energy_error(chain, moved, solution.coefficients) == pytest.approx(one, rel=1e-6)


def test_total_stiffness_is_shared_out(bars: Problem) -> None:
    """total=True: the same random stiffness, said for the whole layer."""
    area = bars.interfaces["layer"].area
    k, K = Normal("k", KBAR, cov=0.2), Normal("k", KBAR * area, cov=0.2)
    one = ssfem(bars.with_laws({"layer": kappa(k)}), Chaos(3))
    two = ssfem(bars.with_laws({"layer": Elastic(normal=K, tangential=K, total=True)}), Chaos(3))
    same(bars, one, two.coefficients, 1e-12)


# ---------------------------------------------------------------------------------------------
# Split ring: p_c = c_0 / (c_1 + 1 / k)
# ---------------------------------------------------------------------------------------------
def test_split_ring_with_a_random_joint() -> None:
    """Pressure and jump at the joint: moments by Gauss quadrature of the closed form."""
    a, c, b, p, kbar, nu = 100.0, 150.0, 200.0, 1.6, 2e3, 0.3
    rings = two_rings(a, c, b, divisions=(6, 8))
    scene = Scene()
    for name, part in rings.parts.items():
        scene.substructure(name, part, LinearElastic(E, nu), degree=2)
    scene.interface("joint", "inner:outer", "outer:inner", Elastic(normal=kbar))
    scene.pressure("inner:inner", p)
    scene.symmetry([f"{part}:{face}" for part in rings.parts for face in ("theta0", "theta1")])
    problem = assemble(scene)
    rigid = float(lame(c, c, b, 1, 0, E, nu) - lame(c, a, c, 0, 1, E, nu))
    bore = float(lame(c, a, c, p, 0, E, nu))
    cases: list[tuple[Any, int, float]] = [
        (Normal("k", kbar, cov=0.2), 4, 5e-5),  # exact: the 5-point rule
        (LogNormal("k", kbar, cov=0.3), 40, 5e-5),
    ]
    for parameter, count, rtol in cases:
        joint = problem.with_laws({"joint": Elastic(normal=parameter)})
        solution = ssfem(joint, Chaos(3 if count == 4 else 5))
        points, w = solution.space.tensor_gauss(count)
        k = parameter.value(points[:, 0])
        pressure = bore / (rigid + 1 / k)
        i = problem.interfaces["joint"]
        share = i.weights / i.area
        for sign, exact, modes in (
            (-1.0, pressure, solution.force_coefficients("joint")),
            (-1.0, pressure / k, solution.jump_coefficients("joint")),
        ):
            total = sign * share @ modes[:, 0]
            mean = w @ exact
            assert total[0] == pytest.approx(mean, rel=rtol)
            variance = w @ (exact - mean) ** 2
            assert total[1:] @ total[1:] == pytest.approx(variance, rel=40 * rtol)
        assert not np.any(solution.force_coefficients("joint")[:, 1])


# ---------------------------------------------------------------------------------------------
# Against tensor Gauss quadrature, exact for affine parameters on a tensor basis
# ---------------------------------------------------------------------------------------------
def both(problem: Problem, order: int, counts: Any = None, rtol: float = 1e-10) -> SSFEMSolution:
    """CG = direct = quadrature."""
    chaos = Chaos(order, "tensor")
    cg, direct = ssfem(problem, chaos), ssfem(problem, chaos, "direct")
    assert cg.converged and cg.residual < 1e-9 and direct.residual < 1e-9
    same(problem, cg, direct.coefficients, rtol)
    same(problem, cg, by_quadrature(problem, cg, counts or order + 1), rtol)
    return cg


def test_two_stiffnesses(frame: Problem) -> None:
    """Normal and tangential stiffness of a joint and a bed to the ground."""
    joint = Elastic(
        normal=Normal("kn", 2e3, cov=0.2), tangential=Uniform("kt", 500.0, 1300.0), jump=-0.01
    )
    bed = Elastic(normal=500.0, tangential=Normal("kn", 2e3, cov=0.2))
    solution = both(frame.with_laws({"joint": joint, "bed": bed}), 3)
    assert solution.space.germ_names == ("kn", "kt")
    assert len(solution.basis) == 16


def test_random_jump_times_random_stiffness(frame: Problem) -> None:
    """A(k) applied to the coefficients of the jump is the product at the Gauss points."""
    joint = Elastic(
        normal=Normal("k", 2e3, cov=0.2), tangential=900.0, jump=Normal("g", -0.01, cov=0.5)
    )
    problem = frame.with_laws({"joint": joint})
    solution = both(problem, 2)
    rule = solution.space.tensor_gauss(3)
    psi = solution.basis.evaluate(rule.points)
    force = solution.force_coefficients("joint") @ psi.T
    for q, point in enumerate(rule.points):
        exact = Monolithic(problem).solve(solution.random.at(point)).forces["joint"]
        assert np.abs(force[:, :, q] - exact).max() < 1e-9 * np.abs(exact).max()


def test_one_variable_for_stiffness_and_jump(frame: Problem) -> None:
    """Correlated because they are the same: the square of a germ in the loads is projected."""
    k = Normal("k", 2.0, cov=0.1)
    problem = frame.with_laws({"joint": Elastic(normal=k, tangential=900.0, jump=k)})
    assert both(problem, 3).space.dimension == 1


def test_random_loads_and_prescribed_displacements(frame: Problem) -> None:
    """Pressure, displacement and shrink fit go into the right-hand side, with full coupling."""
    u = Normal("u", 0.02, std=0.01)
    laws = {
        "roof": Pressure(Uniform("p", 2.0, 4.0)),
        "wall": Displacement(u, components=(0,)),
        "side": Displacement(u, components=(0,)),
        "glue": Perfect(Normal("shrink", 0.0, std=0.01)),
        "bed": Elastic(normal=Normal("k", 500.0, cov=0.2), tangential=50.0),
    }
    problem = frame.with_laws(laws)
    solution = both(problem, 1)
    assert solution.space.dimension == 4
    wall = problem.interfaces["wall"].sides[0].nodes
    prescribed = solution.coefficients["a"].reshape(-1, 2, 16)[wall, 0]
    assert prescribed[:, 0] == pytest.approx(0.02, rel=1e-12)
    assert np.sqrt(np.sum(prescribed[:, 1:] ** 2, axis=1)) == pytest.approx(0.01, rel=1e-12)


def test_random_field_of_stiffness(frame: Problem) -> None:
    """Another stiffness at every point: one Galerkin matrix a point."""
    k = RandomField("k", 2e3, cov=0.2, covariance="exponential", length=0.5, modes=2)
    problem = frame.with_laws({"joint": Elastic(normal=k, tangential=900.0, jump=-0.01)})
    solution = both(problem, 3)
    force = solution.force_coefficients("joint")[:, 0]
    assert np.ptp(np.sqrt(np.sum(force[:, 1:] ** 2, axis=1))) > 0.0
    # the coefficients of the force at a point are those of samples
    xi = solution.space.tensor_gauss(4).points
    stiffness = k.on(problem.interfaces["joint"].points, problem.interfaces["joint"].weights)
    jump = solution.jump_coefficients("joint")[:, 0] @ solution.basis.evaluate(xi).T
    product = stiffness.value(xi) * (jump + 0.01)
    assert np.allclose(force @ solution.basis.evaluate(xi).T, product, rtol=1e-9, atol=1e-12)


def test_random_field_in_a_load(frame: Problem) -> None:
    p = RandomField("p", 3.0, cov=0.3, covariance="gaussian", length=0.5, modes=2)
    joint = Elastic(normal=Normal("k", 2e3, cov=0.2), jump=p)
    problem = frame.with_laws({"roof": Pressure(p), "joint": joint})
    # the field lives on two interfaces at once, that is two fields of one name
    with pytest.raises(SceneError, match="'p' has two definitions"):
        ssfem(problem, Chaos(1))
    both(frame.with_laws({"roof": Pressure(p), "joint": kappa(Normal("k", 2e3, cov=0.2))}), 1)


def test_lognormal_field_and_correlated_parameters_converge(frame: Problem) -> None:
    """Full coupling: errors of mean and standard deviation fall by 5 from order to order."""
    field = RandomField(
        "k", 2e3, cov=0.3, covariance="exponential", modes=2, distribution="lognormal"
    )
    pair = Correlated(
        [LogNormal("kn", 2e3, cov=0.3), LogNormal("kt", 900.0, cov=0.2)], [[1.0, 0.6], [0.6, 1.0]]
    )
    for joint in (
        Elastic(normal=field, tangential=900.0, jump=-0.01),
        Elastic(normal=pair["kn"], tangential=pair["kt"], jump=-0.01),
    ):
        problem = frame.with_laws({"joint": joint})
        high = ssfem(problem, Chaos(7))
        exact = by_quadrature(problem, high, 9)
        errors = []
        for order in (1, 2, 3, 4):
            cg = ssfem(problem, Chaos(order))
            same(problem, cg, ssfem(problem, Chaos(order), "direct").coefficients, 1e-10)
            errors.append(field_errors(problem, cg, exact))
        assert np.all(np.array(errors[:-1]) > 5 * np.array(errors[1:]))
        same(problem, high, exact, 1e-5)


# ---------------------------------------------------------------------------------------------
# The vessel
# ---------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def vessel() -> Problem:
    """The paper's scene, coarse."""
    shape = bolted_vessel("coarse")
    kinds = {"perfect": Perfect(), "pressure": Pressure(1.6), "elastic": kappa(1.0)}
    scene = Scene()
    for name, part in shape.parts.items():
        scene.substructure(name, part, LinearElastic(E, 0.3), degree=2)
    for c in shape.interfaces:
        faces = [face for face in (c.face1, c.face2) if face]
        scene.interface(c.name, *faces, kinds.get(c.kind, Symmetry()))
    return assemble(scene)


def bolted(vessel: Problem, joint: Any, screw: Any) -> Problem:
    law = Elastic(normal=screw, tangential=screw, jump=-0.2, total=True)
    return vessel.with_laws({"joint": kappa(joint), "screw": law})


def test_vessel_iterations(vessel: Problem) -> None:
    """The paper's parameters: about eight iterations to 1e-6; the direct solver agrees."""
    joint, screw = Normal("joint", 100.0, cov=0.2), Normal("screw", 2.5e4, cov=0.1)
    problem = bolted(vessel, joint, screw)
    solution = ssfem(problem, Chaos(3))
    same(problem, solution, ssfem(problem, Chaos(3), "direct").coefficients, 1e-10)
    quick = ssfem(problem, Chaos(3), rtol=1e-6)
    assert quick.iterations <= 12
    assert energy_error(problem, quick.coefficients, solution.coefficients) < 1e-6
    # the share of the springs in the mean energy is below 1
    reach = 0.2 / core.critical_cov(core.Germ.hermite(), 3)
    assert 1 - reach < solution.spectrum[0] < solution.spectrum[1] < 1 + reach


def test_vessel_against_quadrature(vessel: Problem) -> None:
    """Errors of the fields of mean and standard deviation fall by 10 from order to order.

    Normal laws cut at +-3: a plain normal one has no limit, its 11-point rule a negative stiffness.
    """
    joint = TruncatedNormal("joint", 100.0, cov=0.2, within=3.0)
    screw = TruncatedNormal("screw", 2.5e4, cov=0.1, within=3.0)
    problem = bolted(vessel, joint, screw)
    exact = by_quadrature(problem, ssfem(problem, Chaos(7)), 8)
    errors = [field_errors(problem, ssfem(problem, Chaos(p)), exact) for p in (1, 2, 3, 4)]
    assert np.all(np.array(errors[:-1]) > 10 * np.array(errors[1:]))


# ---------------------------------------------------------------------------------------------
# Definiteness
# ---------------------------------------------------------------------------------------------
def test_smallest_eigenvalue(frame: Problem) -> None:
    """Against the dense generalised eigenproblem."""
    problem = frame.with_laws({"joint": kappa(Normal("k", 2e3, cov=0.4))})
    system = _System(problem, Chaos(3))
    A = system.matrices()[0].toarray()
    M = np.kron(system.mean[0].toarray(), np.eye(system.columns))
    exact = linalg.eigh(A, M, eigvals_only=True, subset_by_index=[0, 0])[0]
    assert smallest_eigenvalue(problem, Chaos(3)) == pytest.approx(exact, rel=1e-7)
    assert exact > 1 - 0.4 / core.critical_cov(core.Germ.hermite(), 3)
    assert smallest_eigenvalue(frame, Chaos(3)) == 1.0


def test_loss_of_definiteness(bars: Problem) -> None:
    """cov = 0.2 is refused from order 10 on: the right bar hangs on the spring alone."""
    germ = core.Germ.hermite()
    chain = bars.with_laws({"layer": kappa(Normal("k", KBAR, cov=0.2))})
    for order in (9, 10):
        expected = 1 - 0.2 / core.critical_cov(germ, order)
        assert smallest_eigenvalue(chain, Chaos(order)) == pytest.approx(expected, rel=1e-6)
    assert ssfem(chain, Chaos(9)).spectrum[0] > 0.0
    blamed = r"'layer', normal stiffness 'k': smallest eigenvalue -1\.88"
    for solver in ("cg", "direct"):
        with pytest.raises(SceneError, match=blamed):
            ssfem(chain, Chaos(10), solver)


def test_indefinite_spring_in_a_definite_structure(frame: Problem) -> None:
    """A soft joint may be indefinite in a definite structure; loads of 0 hide no indefinite one."""
    joint = kappa(Normal("k", 30.0, cov=0.6))
    problem = frame.with_laws({"joint": joint})
    assert 0.0 < smallest_eigenvalue(problem, Chaos(3)) < 1.0
    solution = ssfem(problem, Chaos(3))
    same(problem, solution, ssfem(problem, Chaos(3), "direct").coefficients, 1e-10)
    wild = frame.with_laws({"joint": kappa(Normal("k", 2e3, cov=2.0)), "roof": Pressure(0.0)})
    for solver in ("cg", "direct"):
        with pytest.raises(SceneError, match="not positive definite"):
            ssfem(wild, Chaos(3), solver)


def test_smallest_over_the_points_of_a_field(frame: Problem) -> None:
    field = RandomField("k", 1.0, cov=0.5, covariance="exponential", length=0.3, modes=3)
    system = _System(frame.with_laws({"joint": Elastic(normal=field)}), Chaos(2))
    product = system.springs["joint"].random[0][2]
    space, source = system.random.space, system.random.source("joint", "normal")
    assert source is not None
    matrices = [
        space.galerkin_matrix(source, system.basis, row).toarray()
        for row in range(product.kernel.points)
    ]
    for row, matrix in enumerate(matrices):
        assert np.allclose(product.matrix(row), matrix, atol=1e-14)
    exact = min(np.linalg.eigvalsh(m)[0] for m in matrices)
    assert product.smallest == pytest.approx(exact, abs=1e-13)
    assert product.definite == (exact > 0.0)


# ---------------------------------------------------------------------------------------------
# The solver
# ---------------------------------------------------------------------------------------------
def test_history_and_callback(frame: Problem) -> None:
    problem = frame.with_laws({"joint": kappa(Normal("k", 2e3, cov=0.3))})
    seen: list[tuple[int, float]] = []
    solution = ssfem(problem, Chaos(3), callback=lambda n, r: seen.append((n, r)))
    assert [n for n, _ in seen] == list(range(solution.iterations + 1))
    assert np.array([r for _, r in seen]) == pytest.approx(solution.residuals, rel=1e-12)
    assert solution.residuals[0] == 1.0 and solution.residuals[-1] < 1e-12
    assert set(solution.seconds) == {"assembly", "factor", "iterations"}
    # the residual in the inverse of the mean block is the energy error up to sqrt(cond)
    low, high = solution.spectrum
    for rtol in (1e-2, 1e-4, 1e-6):
        rough = ssfem(problem, Chaos(3), rtol=rtol)
        size = energy_error(problem, rough.coefficients, solution.coefficients)
        assert size < 2 * rough.residuals[-1] * np.sqrt(high / low)

    def stop(n: int, r: float) -> None:
        if n == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ssfem(problem, Chaos(3), callback=stop)


def test_too_few_iterations(frame: Problem) -> None:
    problem = frame.with_laws({"joint": kappa(Normal("k", 2e3, cov=0.3))})
    solution = ssfem(problem, Chaos(3), max_iterations=2)
    assert not solution.converged and solution.iterations == 2


def test_options_prefix(frame: Problem) -> None:
    problem = frame.with_laws({"joint": kappa(Normal("k", 2e3, cov=0.3))})
    options = PETSc.Options("latin_ssfem_")
    options["ksp_max_it"] = 3
    try:
        assert ssfem(problem, Chaos(3)).iterations == 3
    finally:
        options.delValue("ksp_max_it")


def test_nothing_random_and_nothing_loaded(frame: Problem) -> None:
    solution = ssfem(frame, Chaos(3))
    reference = monolithic(frame)
    assert len(solution.basis) == 1 and solution.iterations <= 1
    assert energy_error(frame, {n: solution.mean(n) for n in reference.u}, reference.u) < 1e-10
    assert not any(np.any(solution.std(n)) for n in reference.u)
    quiet = frame.with_laws({"roof": Pressure(0.0), "joint": kappa(Normal("k", 2e3, cov=0.3))})
    still = ssfem(quiet, Chaos(2))
    assert still.converged and still.residual == 0.0
    assert not any(np.any(u) for u in still.coefficients.values())


def test_two_bodies() -> None:
    """Structures that nothing connects are solved in one run."""
    part = geometry.box((LENGTH, 10.0), (2, 2), cell="quadrilateral")
    scene = Scene()
    laws = Normal("k", KBAR, cov=0.2), LogNormal("K", KBAR, cov=0.2)
    for name in ("one", "two"):
        scene.substructure(name, part, LinearElastic(E, 0.0), degree=1)
        scene.interface(f"foot {name}", f"{name}:x0", kappa(KBAR))
        scene.traction(f"{name}:x1", (PULL, 0.0))
    problem = assemble(scene)
    problem = problem.with_laws({"foot one": kappa(laws[0]), "foot two": kappa(laws[1])})
    solution = ssfem(problem, Chaos(3))
    same(problem, solution, ssfem(problem, Chaos(3), "direct").coefficients, 1e-10)
    for name, mean in (("one", 1.04602510), ("two", 1.04)):
        jump = solution.jump_coefficients(f"foot {name}")[:, 0, 0] * KBAR / PULL
        assert jump == pytest.approx(mean, abs=1e-6)


def test_mean_and_std(bars: Problem) -> None:
    chain = bars.with_laws({"layer": kappa(LogNormal("k", KBAR, cov=0.2))})
    solution = ssfem(chain, Chaos(5))
    x = bars.substructures["right"].dof_coordinates[:, 0]
    std = solution.std("right").reshape(-1, 2)[:, 0]
    assert std == pytest.approx(PULL / KBAR * 1.04 * 0.2, rel=1e-6)
    mean = solution.mean("right").reshape(-1, 2)[:, 0]
    assert mean == pytest.approx(PULL * (x / E + 1.04 / KBAR), rel=1e-8)


def test_bad_input(frame: Problem) -> None:
    with pytest.raises(SceneError, match="unknown solver 'gmres'"):
        ssfem(frame, Chaos(1), "gmres")  # type: ignore[arg-type]
    field = RandomField("g", 0.0, std=0.01, modes=2)
    for law in ({"glue": Perfect(field)}, {"wall": Displacement(field)}):
        with pytest.raises(SceneError, match="random field 'g' cannot be prescribed"):
            ssfem(frame.with_laws(law), Chaos(1))
    solution = ssfem(frame, Chaos(1))
    with pytest.raises(SceneError, match="'glue' is Perfect; only elastic"):
        solution.force_coefficients("glue")
    with pytest.raises(SceneError, match="unknown interface 'joints'"):
        solution.force_coefficients("joints")
    with pytest.raises(SceneError, match="unknown substructure 'd'"):
        solution.mean("d")
