"""The plan's prediction against what a run takes."""

from __future__ import annotations

import pytest
from latin_core import Options

from dolfinx_frontend import geometry
from dolfinx_frontend.assembly.assemble import assemble
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.plan.cost import predict, shown
from dolfinx_frontend.scene.laws import Elastic
from dolfinx_frontend.scene.materials import LinearElastic
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.solving import solve


def pair(cells: int, dim: int) -> Problem:
    """Two blocks with springs between them."""
    scene = Scene()
    for name, x0 in (("left", 0.0), ("right", 1.0)):
        box = geometry.box(
            (1.0,) * dim,
            (cells,) * dim,
            origin=(x0, *(0.0,) * (dim - 1)),
            cell="hexahedron" if dim == 3 else "quadrilateral",
        )
        scene.substructure(name, box, LinearElastic(E=1.0, nu=0.3), degree=2)
    scene.interface("layer", "left:x1", "right:x0", Elastic(normal=1.0, tangential=1.0))
    scene.fix("left:x0")
    scene.traction("right:x1", (1.0,) + (0.0,) * (dim - 1))
    return assemble(scene)


@pytest.mark.parametrize(("cells", "dim"), [(4, 3), (7, 3), (20, 2), (60, 2)])
@pytest.mark.parametrize("active", [(), ("layer",)])
def test_predictions_hold_within_a_factor(cells: int, dim: int, active: tuple[str, ...]) -> None:
    problem = pair(cells, dim)
    result = solve(problem, active=active, options=Options(rtol=1e-3))
    cost = result.plan.cost
    assert cost is not None
    spent = sum(c["factor_numbers"] for c in result.solver.costs)
    assert cost.unknowns == result.solver.unknowns  # nothing is glued twice here
    assert cost.active == result.solver.active_unknowns
    assert cost.rows == result.solver.rows
    assert 1 / 2.5 < cost.factor_numbers / spent < 2.5
    assert "factorise" in result.spent() and "cost" in str(result.plan)


def test_columns_cost_operations_and_memory_but_no_factorisation() -> None:
    problem = pair(4, 3)
    one, ten = (predict(problem, ["layer"], columns, Options()) for columns in (1, 10))
    assert ten.factor_flops == one.factor_flops and ten.iteration_flops == 10 * one.iteration_flops
    assert one.memory < ten.memory < 10 * one.memory
    assert predict(problem, [], 1, Options()).iteration_flops == 0.0
    assert shown(2.4e8, "Flop") == "240 MFlop" and shown(3.0, "B") == "3 B"
