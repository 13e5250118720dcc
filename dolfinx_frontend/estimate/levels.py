"""A chaos that is found on a coarse mesh and solved once on a fine one.

How many modes a quantity needs hardly depends on the mesh: the search for them, with its witnesses, is made
where points are cheap. What it says of the error is carried over relative to mean and deviation.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

from dolfinx_frontend.estimate.adaptive import solve_to_accuracy
from dolfinx_frontend.estimate.errors import complete, next_halving, size_of, whole_of
from dolfinx_frontend.plan.plan import Method
from dolfinx_frontend.results.chaos import ChaosResult
from dolfinx_frontend.results.errors import Errors, ErrorShare, MeanStd, share_of
from dolfinx_frontend.results.resultant import Resultant
from dolfinx_frontend.solvers.galerkin import carry_on
from dolfinx_frontend.uncertainty.fields import DiscretisedField

__all__ = ["of_two_meshes"]

LESS = 0.7
"""Share of what the meshes leave of the accuracy that the search on the coarse mesh may use."""


def of_two_meshes(
    coarse: ChaosResult,
    fine: ChaosResult,
    accuracy: float,
    quantity: Resultant,
    known: ErrorShare,
    method: Method,
    settings: Mapping[str, Any],
) -> ChaosResult | None:
    """The chaos of a fine mesh with the modes of a coarse one; None: it has to be found on the fine mesh.

    Parameters
    ----------
    coarse, fine
        Of order 1, on the first and on the last mesh.
    known
        Error of the last mesh.

    Random fields have other modes on other meshes, and where laws are nonlinear points answer.
    """
    fields = any(isinstance(s, DiscretisedField) for s in fine.random.sources.values())
    if fields or coarse.collocations or fine.collocations or coarse.problem is fine.problem:
        return None
    if coarse.space.germ_names != fine.space.germ_names:
        return None
    value = fine.mean_std(quantity)
    whole = max(value.std or 0.0, quantity.compared.least)
    of_mean = share_of(known.quantity or 0.0, size_of(value, quantity))
    of_meshes = max(of_mean, share_of(known.std or 0.0, whole))
    left = min(max(0.1 * of_meshes, accuracy - of_meshes), 0.5)
    found = solve_to_accuracy(
        coarse.problem, max(LESS * left, 1e-10), quantity, method, meshes=False, first=coarse, **settings
    )
    if not isinstance(found, ChaosResult) or found.status != "converged":
        return None
    of_coarse = found.errors()
    if not of_coarse.reached or of_coarse.moments is None:
        return None
    result = carry_on(fine, found.chaos, found.plan.options.rtol)
    complete(result)
    if result.status != "converged":
        return None
    after = result.mean_std(quantity)
    falls = max(result.error / max(found.error, 1e-300), 1.0)
    made = Errors(
        _carried(of_coarse.algebraic, of_coarse, after, falls),
        _carried(of_coarse.truncation, of_coarse, after),
        known,
        quantity,
        after,
        whole_of(after, max(result.error, 1e-13), quantity),
        asked=accuracy,
        notes=of_coarse.notes,
    )
    return result.with_notes(found=replace(made, next_halving=partial(next_halving, result)(made)))


def _carried(share: ErrorShare | None, before: Errors, after: MeanStd, factor: float = 1.0) -> Any:
    """An error of the coarse mesh relative to the answer on the fine one."""
    if share is None or before.moments is None:
        return None
    assert before.quantity is not None
    size, whole = size_of(before.moments, before.quantity), before.whole or 1.0
    mean = factor * share_of(share.quantity or 0.0, size) * size_of(after, before.quantity)
    std = factor * share_of(share.std or 0.0, whole) * max(after.std or 0.0, before.quantity.compared.least)
    return ErrorShare(factor * share.energy, mean, std, f"{share.how}, on the first mesh")
