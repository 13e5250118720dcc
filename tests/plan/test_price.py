"""Prices of ways before they start: they grow as the work does, and what does not fit is refused."""

from __future__ import annotations

import ctypes
import gc

import pytest

from dolfinx_frontend import (
    Chaos,
    Contact,
    Elastic,
    LinearElastic,
    LogNormal,
    Problem,
    Scene,
    Uniform,
    assemble,
    compare_ways,
    geometry,
    make_plan,
    quasi_monte_carlo,
    solve,
)
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.plan import plan as planning
from dolfinx_frontend.plan import ways as pricing
from dolfinx_frontend.plan.price import Way, price
from dolfinx_frontend.plan.random_laws import RandomLaws
from dolfinx_frontend.scene.laws import Law


def problem_of(law: Law) -> Problem:
    scene = Scene()
    for k in range(2):
        box = geometry.box((1.0, 1.0, 1.0), (3, 3, 3), (float(k), 0.0, 0.0), "hexahedron")
        scene.substructure(f"b{k}", box, LinearElastic(E=200e3, nu=0.3), degree=2)
    scene.fix("b0:x0")
    scene.fix("b1:y0")
    scene.interface("joint", "b0:x1", "b1:x0", law)
    scene.traction("b1:x1", (-1.0, 0.0, 0.0))
    return assemble(scene)


@pytest.fixture(scope="module")
def problem() -> Problem:
    stiffness = LogNormal("k", mean=1e5, cov=0.3)
    return problem_of(Elastic(normal=stiffness, tangential=stiffness))


class _Heap(ctypes.Structure):
    """``struct mallinfo2`` of glibc."""

    names = "arena ordblks smblks hblks hblkhd usmblks fsmblks uordblks fordblks keepcost"
    _fields_ = [(name, ctypes.c_size_t) for name in names.split()]


@pytest.mark.parametrize(("across", "layers"), [(4, 3), (5, 8)])
def test_tangents_that_a_solver_keeps(across: int, layers: int) -> None:
    """They are in the price of points of linear laws, within a factor of two."""
    libc = ctypes.CDLL(None)
    if not hasattr(libc, "mallinfo2"):
        pytest.skip("no mallinfo2 here")
    libc.mallinfo2.restype = _Heap

    def used() -> int:
        gc.collect()
        heap = libc.mallinfo2()
        return int(heap.uordblks + heap.hblkhd)

    scene = Scene()
    for k in range(layers):
        box = geometry.box((10.0, 10.0, 2.0), (across, across, 1), (0.0, 0.0, 2.0 * k), cell="hexahedron")
        scene.substructure(f"b{k}", box, LinearElastic(E=1e5, nu=0.3), degree=1)
    scene.fix("b0:z0")
    for k in range(1, layers):
        law = Elastic(normal=LogNormal(f"k{k}", 1e4, cov=0.3), tangential=5e3)
        scene.interface(f"j{k}", f"b{k - 1}:z1", f"b{k}:z0", law, space="facets")
    scene.traction(f"b{layers - 1}:z1", (1.0, 0.0, 5.0))
    problem = assemble(scene)
    samples = quasi_monte_carlo(problem, 16, active="all", progress=False)
    before = used()
    samples.solver._beginning = None
    kept = before - used()
    plan, rows = samples.plan, samples.solver.rows
    ways = [Way(RandomLaws.of(problem), modes=1), Way(RandomLaws.of(problem), points=1)]
    of_chaos, of_points = (price(problem, plan.active, rows, plan.options, way).memory for way in ways)
    fields = 40.0 * 8.0 * rows, 16.0 * rows  # of one mode, and of one point: what else differs
    counted = of_points - of_chaos + fields[0] - fields[1]
    assert kept > 1e6 and 0.5 * kept < counted < 2.0 * kept


def test_ways_side_by_side(problem: Problem) -> None:
    ways = compare_ways(problem, chaos=(1, Chaos(3)), tensor=(3,), sparse=(2,), samples=(64, 4096))
    sizes = {way.name: way.size for way in ways}
    assert sizes["solve at the means"] == 1 and sizes["chaos=1"] == 2 and sizes["tensor_quadrature 3"] == 3
    prices = [way.price for way in ways]
    assert len(ways) == 7 and all(price is not None and price.sure for price in prices)
    few, many = ways["samples 64"].price, ways["samples 4096"].price
    assert few is not None and many is not None
    assert many.units > 4.0 * few.units and many.memory > few.memory and many.seconds > few.seconds
    assert all(way.fits for way in ways)
    for name in sizes:
        assert name in str(ways)
    with pytest.raises(SceneError, match="no way 'chaos=7'"):
        ways["chaos=7"]
    with pytest.raises(SceneError, match="nothing is random"):
        compare_ways(problem_of(Elastic(normal=1e5, tangential=1e5)))


def test_a_run_has_the_price_that_was_told(problem: Problem) -> None:
    ways = compare_ways(problem, chaos=(2,), tensor=(), sparse=(), samples=(8,))
    chaos, samples = solve(problem, chaos=2), quasi_monte_carlo(problem, 8)
    for name, plan in (("chaos=2", chaos.plan), ("samples 8", samples.plan)):
        told = ways[name].price
        assert told is not None and plan.price is not None
        assert (plan.price.units, plan.price.memory) == (told.units, told.memory)
        line = plan.decisions[-1]
        assert line.what == "price" and "direct solve" in line.choice
    assert make_plan(problem).price is not None


def test_what_does_not_fit(problem: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    number = 2**17

    def ways() -> pricing.Ways:
        return compare_ways(problem, chaos=(1,), tensor=(), sparse=(), samples=(number,))

    one, many = ways()["chaos=1"].price, ways()[f"samples {number}"].price
    assert one is not None and many is not None and many.memory > 2.0 * one.memory
    free = 1.1 * one.memory
    for module in (planning, pricing):
        monkeypatch.setattr(module, "available_memory", lambda: free)
    again = ways()
    assert again["chaos=1"].fits and not again[f"samples {number}"].fits
    assert "does not fit" in str(again)
    with pytest.raises(SceneError, match=rf"{number} points need about .*B, and .*B are free.*compare_ways"):
        quasi_monte_carlo(problem, number)


def test_nonlinear_laws_have_a_typical_price() -> None:
    ways = compare_ways(problem_of(Contact(friction=Uniform("mu", 0.2, 0.4))), chaos=(2,), tensor=(3,))
    assert "typical" in str(ways)
    price = ways["chaos=2"].price
    assert price is not None and not price.sure
