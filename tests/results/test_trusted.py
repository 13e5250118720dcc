"""A linear chaos knows its own truncation: compared with a Gauss rule that integrates the answer."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dolfinx_frontend import (
    Elastic,
    LinearElastic,
    LogNormal,
    Options,
    Scene,
    assemble,
    geometry,
    solve,
    tensor_quadrature,
)


def joined(cov: float, stiffness: float) -> Any:
    """Two blocks that are pulled apart through a spring that is random; E / L = 1000."""
    scene = Scene()
    for k in range(2):
        box = geometry.box((1.0, 1.0), (1, 1), origin=(float(k), 0.0))
        scene.substructure(f"b{k}", box, LinearElastic(E=1000.0, nu=0.25), degree=1)
    scene.fix("b0:x0")
    scene.fix("b1:x1", (1e-3, 2e-4))
    law = Elastic(normal=LogNormal("k", stiffness, cov=cov), tangential=0.3 * stiffness)
    scene.interface("joint", "b0:x1", "b1:x0", law)
    return assemble(scene)


@pytest.mark.parametrize("stiffness", [30.0, 1e3, 3e4])
@pytest.mark.parametrize(("cov", "order"), [(0.1, 2), (0.3, 3), (1.0, 2), (2.0, 2), (3.0, 1)])
def test_a_linear_chaos_is_trusted_only_if_its_moments_are_right(
    cov: float, order: int, stiffness: float
) -> None:
    problem = joined(cov, stiffness)
    result = solve(problem, chaos=order)
    exact = tensor_quadrature(problem, 48, progress=False)
    wrong = [
        float(np.linalg.norm(one - other) / np.linalg.norm(other))
        for one, other in zip(result.moments("joint"), exact.moments("joint"), strict=True)
    ]
    assert result.misfits is not None
    if result.trusted:
        assert max(wrong) < result.chaos.tolerance, (wrong, result.misfits)
    else:
        assert "NOT TRUSTED" in repr(result)
    # it is no empty word either way
    assert result.trusted == (cov < 1.0), (wrong, result.misfits)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_a_force_that_hardly_varies_is_not_distrusted(order: int) -> None:
    """Pulled by a load, the total force is given and the parts only share it out: the jump varies."""
    scene = Scene()
    for k in range(2):
        box = geometry.box((1.0, 1.0), (3, 3), origin=(float(k), 0.0))
        scene.substructure(f"b{k}", box, LinearElastic(E=100.0, nu=0.3), degree=1)
    scene.fix("b0:x0")
    scene.traction("b1:x1", (3.0, 0.5))
    law = Elastic(normal=LogNormal("k", 50.0, cov=0.2), tangential=20.0)
    scene.interface("joint", "b0:x1", "b1:x0", law)
    problem, options = assemble(scene), Options(rtol=1e-10)
    result = solve(problem, chaos=order, options=options)
    exact = tensor_quadrature(problem, 24, options=options, progress=False)
    (_, own), (_, deviation) = result.moments("joint"), exact.moments("joint")
    wrong = float(np.linalg.norm(own - deviation) / np.linalg.norm(deviation))
    assert result.misfits is not None
    # the deviation itself errs by less: what the chaos lacks is orthogonal to it
    assert wrong < 2.0 * result.misfits["joint"]
    truth = result.truncation("joint", points=32).std
    assert truth / 10.0 < result.misfits["joint"] < 10.0 * truth
    assert result.trusted == (order > 1)
