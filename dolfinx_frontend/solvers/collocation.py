"""Chaos through nonlinear laws: the pseudo-spectral local stage.

The chaos modes of the free jump are evaluated at stochastic quadrature points xi_q, the law is resolved there
as if nothing were random, and the forces are projected back:

    f_k = sum_q  B_qk  f( sum_j Psi_j(xi_q) j_j ; parameters(xi_q) ),    B = W Psi G^-1,   G = Psi^T W Psi,

with weights W >= 0, so that the projection of a monotone law stays monotone (the negative weights of a
Smolyak rule do not keep that). G is the identity for a Gauss rule; for Sobol points, B is their least-squares
fit, which leaves a law alone that happens to be linear.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
from latin_core import stochastic

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import check_known
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.groups import grouped
from dolfinx_frontend.kernel.columns import Collocation, nominal_fields
from dolfinx_frontend.plan.random_laws import RandomLaws
from dolfinx_frontend.uncertainty.chaos import Chaos

__all__ = ["MOST_TENSOR", "collocation"]


MOST_TENSOR = 4096
"""Points up to which a tensor Gauss rule is the default, if the memory allows it, see `MOST_BYTES`."""
MOST_BYTES = 1e9
"""Memory that samples and forces of an interface may take with a tensor rule."""
LEAST_LINE = 16
"""Fewest Gauss points of a germ, while all germs together have at most `CHEAP` points: at kinks a coarse rule
is wrong by up to a tenth of a per cent of the mean."""
CHEAP = 256
"""Points up to which every germ gets `LEAST_LINE` of them."""
SOBOL_A_MODE = 16
"""Sobol points taken for each mode that is projected, at least."""
FEWEST_SOBOL = 1024
MOST_SOBOL = 2**16
UNEVEN = 0.5
"""Departure of the Gram matrix from the identity beyond which Sobol points are too few."""


def _reaching(random: RandomLaws, name: str) -> tuple[int, ...]:
    """Germs of all interfaces that are joined to one by parts and interfaces."""
    problem = random.problem
    joined = [(i.sides[0].substructure, i.sides[-1].substructure) for i in problem.interfaces.values()]
    start = problem.interfaces[name].sides[0].substructure
    parts = next(set(group) for group in grouped(list(problem.parts), joined) if start in group)
    germs: set[int] = set()
    for (other, _), source in random.sources.items():
        if any(side.substructure in parts for side in problem.interfaces[other].sides):
            germs.update(random.space.columns(source))
    for part, source in random.parts.items():
        if part in parts:
            germs.update(random.space.columns(source))
    for term, found in random.loads.items():
        if problem.loads[term.load].load.part in parts:
            germs.update(g for source in found for g in random.space.columns(source))
    return tuple(sorted(germs))


def _own(random: RandomLaws, name: str) -> set[int]:
    """Germs of the parameters of an interface itself."""
    return {g for (n, _), s in random.sources.items() if n == name for g in random.space.columns(s)}


def _counts(
    random: RandomLaws, name: str, chaos: Chaos, degrees: npt.NDArray[np.int32], germs: tuple[int, ...]
) -> list[int]:
    """Gauss points in each germ: one where neither the modes nor the law's parameters depend on it."""
    space = random.space
    own = _own(random, name)
    wanted = chaos.quadrature
    given: dict[int, int] = {}
    if isinstance(wanted, Mapping):
        for source_name, count in wanted.items():
            check_known("random parameter", source_name, space.names, "Chaos: quadrature")
        for source in random.every:
            for germ in space.columns(source) if source.name in wanted else ():
                given[germ] = int(wanted[source.name])
    elif wanted is not None:
        given = dict.fromkeys(germs, int(wanted))
    varied = {g for g in germs if degrees[g] > 0 or g in own}
    least = LEAST_LINE if LEAST_LINE ** len(varied) <= CHEAP else 1
    counts = []
    for germ in range(space.dimension):
        if germ not in varied:
            counts.append(1)
            continue
        degree = int(degrees[germ]) if degrees[germ] > 0 else chaos.order
        count = given.get(germ, max(2 * (degree + 1), least))
        atoms = space.germs[germ].capacity
        counts.append(min(count, atoms) if atoms is not None else count)
        if counts[-1] <= degrees[germ]:
            raise SceneError(
                f"interface {name!r}: {counts[-1]} quadrature points in the germ "
                f"{space.germ_names[germ]!r} cannot tell its modes up to degree {degrees[germ]} apart: "
                f"give at least {degrees[germ] + 1}, better {2 * (degrees[germ] + 1)}"
            )
    return counts


def _transforms(
    basis: stochastic.ChaosBasis, rule: stochastic.Rule, reached: npt.NDArray[np.bool_]
) -> tuple[Array, Array, float]:
    """forward, backward, and how far the Gram matrix of the modes at the points is from the identity."""
    both = stochastic.quadrature_transform(basis, rule)
    forward = np.where(reached[:, None], both.forward, 0.0)
    gram = (forward * rule.weights) @ forward.T
    gram[~reached, ~reached] = 1.0
    uneven = float(np.abs(np.linalg.eigvalsh(gram) - 1.0).max())
    backward = np.where(reached[None, :], both.backward, 0.0)
    if 1e-10 < uneven < 1.0:
        backward = np.linalg.solve(gram, backward.T).T
    return np.asfortranarray(forward), np.asfortranarray(backward), uneven


def collocation(
    random: RandomLaws, basis: stochastic.ChaosBasis, chaos: Chaos, name: str, steps: int = 1
) -> Collocation:
    """Quadrature points for an interface whose law is nonlinear.

    A tensor Gauss rule with 2 (p + 1) points in each germ, 16 at least in one or two germs, while that is
    affordable (the response has kinks, where it takes more than p + 1); scrambled Sobol points beyond. Germs
    that do not reach the interface, and those on which neither the modes nor its parameters depend, take one
    point.

    Parameters
    ----------
    steps
        Time steps of a history, each of which is evaluated at all points.

    Raises
    ------
    SceneError
        Too few points for the modes.
    """
    space = random.space
    germs = _reaching(random, name)
    table = basis.indices.table
    others = [g for g in range(space.dimension) if g not in germs]
    reached = ~np.any(table[:, others] > 0, axis=1)
    degrees = table[reached].max(axis=0, initial=0)
    counts = _counts(random, name, chaos, degrees, germs)
    total = float(np.prod(np.array(counts, dtype=float)))
    rows = len(nominal_fields(random, name).frames)
    affordable = total <= MOST_TENSOR and (total <= CHEAP or 16.0 * total * rows * steps <= MOST_BYTES)
    if chaos.sobol_points is None and (chaos.quadrature is not None or affordable):
        rule = space.tensor_gauss(counts)
        forward, backward, uneven = _transforms(basis, rule, reached)
        if uneven > 1e-6:
            raise SceneError(
                f"interface {name!r}: a rule of {' x '.join(map(str, counts))} points is too coarse for the "
                f"products of its modes: give more than the highest degree of each germ"
            )
        varied = [str(c) for c in counts if c > 1] or ["1"]
        text = f"tensor Gauss, {' x '.join(varied)}"
        return Collocation(name, text, rule.points, rule.weights, germs, forward, backward)
    free = [g for g in range(space.dimension) if counts[g] > 1]
    number = chaos.sobol_points
    least = max(FEWEST_SOBOL, SOBOL_A_MODE * int(reached.sum()))
    count = number or min(1 << (least - 1).bit_length(), MOST_SOBOL)
    while True:
        points = np.tile(space.tensor_gauss(1).points, (count, 1))
        points[:, free] = space.sample_sobol(count, 0)[:, free]
        rule = stochastic.Rule(points, np.full(count, 1.0 / count))
        forward, backward, uneven = _transforms(basis, rule, reached)
        if uneven <= UNEVEN:
            return Collocation(
                name, f"{count} Sobol points", rule.points, rule.weights, germs, forward, backward
            )
        if number is not None or count >= MOST_SOBOL:
            raise SceneError(
                f"interface {name!r}: {count} Sobol points are too few for {int(reached.sum())} modes (their "
                f"Gram matrix is off the identity by {uneven:.2g}, more than {UNEVEN:g}): give more "
                "(Chaos(sobol_points=...)), a lower order, or sample"
            )
        count *= 2
