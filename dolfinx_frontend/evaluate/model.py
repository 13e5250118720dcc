"""A number of an assembly as a function of its germs, as :mod:`dolfinx_frontend.moments` knows it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from latin_core import Options

from dolfinx_frontend.assembly.ranks import exchanged
from dolfinx_frontend.common.arrays import Array, Flags
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.statuses import STOPPED
from dolfinx_frontend.evaluate.evaluator import complete
from dolfinx_frontend.evaluate.sampling import sample_on
from dolfinx_frontend.kernel.solver import Solver
from dolfinx_frontend.moments.fields import FullFields
from dolfinx_frontend.moments.model import ContactStates, Evaluations, Guess, Moments
from dolfinx_frontend.plan.plan import Plan
from dolfinx_frontend.plan.price import Way, price, speed
from dolfinx_frontend.plan.random_laws import RandomLaws
from dolfinx_frontend.results.chaos import ChaosResult
from dolfinx_frontend.results.contact import contact_states
from dolfinx_frontend.results.errors import Errors, Estimator, not_measured
from dolfinx_frontend.results.resultant import Resultant, Wanted
from dolfinx_frontend.results.samples import SampleResult
from dolfinx_frontend.uncertainty.fields import DiscretisedField
from dolfinx_frontend.uncertainty.space import RandomSpace
from dolfinx_frontend.uncertainty.statistics import Statistic

__all__ = ["QuantityModel", "errors_of", "samples_of"]

MOST_NOT_RESOLVED, UNRESOLVED, MOST_UNRESOLVED = 3.0, 2.5, 0.5
"""How much more modes that points do not resolve are taken to do at most; and by how much more than they have
of the variance, relative to that, and at most: layers with 8 points over two correlation lengths told 1.4
times too little, with 32 points what they lack."""

MOST_FIELD_MODES, MOST_PART_MODES = 300, 150
"""Modes of the whole fields at most, of interfaces and of parts, which have a point in every cell."""

MANY_ROWS = 300
"""Rows of the interface data from which on a step of Newton's method costs what about 150 iterations do."""

EXACT = "converged", "inexact"
"""Statuses of points that are as right as doubles allow."""


@dataclass(frozen=True, eq=False)
class QuantityModel:
    """A :class:`~dolfinx_frontend.moments.model.PointModel` of an assembly on the factors of a solver.

    Attributes
    ----------
    solver, random, plan
        What is solved.
    quantity
        The number.
    linear
        Whether all laws are linear.
    estimator
        Of the errors of its samples.
    chaos
        An approximation; None: there is none.
    """

    solver: Solver
    random: RandomLaws
    plan: Plan
    quantity: Wanted
    linear: bool
    estimator: Estimator = not_measured
    chaos: ChaosResult | None = None

    @classmethod
    def of_chaos(cls, chaos: ChaosResult, quantity: Wanted) -> QuantityModel:
        """On the factors of a chaos, from which no point is started."""
        linear = not chaos.collocations
        return cls(chaos.solver, chaos.random, chaos.plan, quantity, linear, chaos.estimator, chaos)

    @property
    def space(self) -> RandomSpace:
        """The germs."""
        return self.random.space

    @property
    def statistic(self) -> Statistic:
        """What is asked of the number."""
        return self.quantity.statistic

    @property
    def smooth(self) -> bool:
        """Whether the number is a smooth function of the germs."""
        return self.linear and isinstance(self.quantity, Resultant)

    @property
    def may_open(self) -> bool:
        """Whether there are contacts."""
        return bool(self._contacts)

    @property
    def _contacts(self) -> list[str]:
        """Active interfaces whose points may open."""
        interfaces = self.random.problem.interfaces
        return [n for n, each in interfaces.items() if each.law.unilateral and n in self.plan.active]

    def admissible(self, points: Array) -> Flags:
        """Which points (n, L) make laws."""
        if not len(points) or self.random.make_laws(points):
            return np.ones(len(points), dtype=bool)
        return np.array([self.random.make_laws(point[None]) for point in points])

    def numbers(self, points: Array) -> Array:
        """The random numbers (k, n) of laws and loads."""
        random = self.random
        of_loads = [each for found in random.loads.values() for each in found]
        every = dict.fromkeys([*random.sources.values(), *of_loads, *random.parts.values()])
        return np.concatenate([self.space.values(s, points).reshape(-1, len(points)) for s in every])

    def __call__(self, points: Array, rtol: float, cold: bool = False) -> Evaluations:
        """Solve at points (n, L); the tolerance is relative to the whole.

        What a part scatters by matters as far as the quantity does. Cold, Newton's steps are taken where
        there are many rows once a point has failed without.
        """
        options = self.plan.options.with_(rtol=rtol)
        if not cold:
            return self._read(self._solved(points, options), rtol)
        plain = bool(options.newton) and self.solver.rows >= MANY_ROWS
        found: SampleResult | None = None
        for point in points:
            one = self._solved(point[None], options.with_(newton=0) if plain else options, plain)
            if plain and one.status not in (*EXACT, *STOPPED):
                plain = False
                one = self._solved(point[None], options)
            found = one if found is None else found.joined(one)
            if one.status in STOPPED:
                break
        assert found is not None
        return self._read(found, rtol)

    def _solved(self, points: Array, options: Options, quiet: bool = False) -> SampleResult:
        return sample_on(
            self.solver,
            self.random,
            replace(self.plan, options=options),
            points,
            np.full(len(points), 1.0 / len(points)),
            "quadrature",
            keep_states=self.quantity.needs_states,
            scatter=False,
            told="none" if quiet else "failed",
            estimator=self.estimator,
        )

    def _read(self, samples: SampleResult, rtol: float) -> Evaluations:
        complete(samples)
        exact, seconds = samples.status in EXACT, sum(samples.seconds.values())
        values = self.quantity.at_end(samples, samples)
        return Evaluations(samples.germs, values, np.ravel(samples.error), exact, rtol, seconds, samples)

    def joined(self, first: Evaluations, second: Evaluations) -> Evaluations:
        """The points of both in this order."""
        return Evaluations(
            np.concatenate([first.points, second.points]),
            np.concatenate([first.values, second.values]),
            np.concatenate([first.error, second.error]),
            first.exact and second.exact,
            first.rtol,
            first.seconds + second.seconds,
            first.answer.joined(second.answer),
        )

    def contacts(self, found: Evaluations) -> list[ContactStates]:
        """The contacts at solved points; collective."""
        return [self._contact(found.answer, name) for name in self._contacts]

    def _contact(self, answer: ChaosResult | SampleResult, name: str) -> ContactStates:
        def everywhere(read: Callable[[ChaosResult | SampleResult, str], Array]) -> Array:
            return answer.everywhere(name, partial(read, answer, name))

        count = self.random.problem.interfaces[name].num_points
        pressed, apart = partial(everywhere, _pressed), partial(everywhere, _apart)
        return ContactStates(count, everywhere(_counts), pressed, apart)

    def guess(self) -> Guess | None:
        """What the chaos says of the contacts; collective."""
        if self.chaos is None or not self._contacts:
            return None
        kinds = [self._contact(self.chaos, name).kinds for name in self._contacts]
        return Guess(self.chaos.moment_germs(), np.concatenate(kinds, axis=1))

    def seconds(self, points: int) -> float:
        """Predicted time of so many solves on the core whose rates the plan has; collective."""
        problem, plan = self.random.problem, self.plan
        way, steps = Way(self.random, points=points), plan.amplitudes.shape[1]
        of_all = price(problem, plan.active, self.solver.rows, plan.options, way, steps, bool(plan.macro))
        own = of_all.seconds * speed()
        return own if problem.comm is None else sum(exchanged(problem.comm, own))

    def full_fields(self) -> FullFields | None:
        """The same with all modes that the points of its fields resolve; None: there is no field."""
        full = _fuller(self.random)
        if full is None:
            return None
        of = ", ".join(
            f"{s.name} ({100.0 * s.captured:.4g} % of its variance)" for s in self.random.of_fields
        )
        return FullFields(replace(self, random=full, chaos=None), _not_resolved(self.random, full), of)


def samples_of(found: Moments) -> SampleResult:
    """The points of moments with their weights, for the user."""
    samples: SampleResult = found.evaluations.answer
    return replace(samples, weights=found.weights)


def errors_of(found: Moments, quantity: Wanted) -> Errors:
    """The errors of moments, for the user."""
    return Errors(
        found.algebraic,
        found.truncation,
        None,
        quantity,
        found.value,
        found.whole,
        next_halving=found.next_halving,
    )


def _counts(answer: ChaosResult | SampleResult, name: str) -> Array:
    """Open and slipping points of a contact at the end of every sample, (n, 2)."""
    found = []
    for block in answer.moment_blocks():
        force, contact = np.asarray(block.force(name)), block.contact(name)
        if answer.times is not None:
            force = force[:, -1]
        limits = None if contact is None else contact.limits
        if limits is not None:
            limits = limits[0][:, -1], limits[1][:, -1]
        states = contact_states(force[..., 0], np.linalg.norm(force[..., 1:], axis=-1), limits)
        found.append(np.stack([np.count_nonzero(each, axis=-1) for each in states], axis=-1))
    return np.concatenate(found, dtype=np.float64)


def _pressed(answer: ChaosResult | SampleResult, name: str) -> Array:
    """Force that presses a contact together at the end of every sample, (n,)."""
    force = np.asarray(answer.force(name))
    force = force if answer.times is None else force[:, -1]
    return np.asarray(-force[..., 0] @ answer.problem.interfaces[name].weights)


def _apart(answer: ChaosResult | SampleResult, name: str) -> Array:
    """Least gap of the points of a contact at the end of every sample, (n,): 0 where one is closed."""
    found = []
    for block in answer.moment_blocks():
        jump, contact = np.asarray(block.jump(name))[..., 0], block.contact(name)
        if contact is None:
            return np.zeros(len(jump))
        steps = jump if answer.times is not None else jump[:, None]
        gap = (steps + np.broadcast_to(contact.clearance, steps.shape))[:, -1]
        found.append(np.maximum(gap, 0.0).min(axis=-1))
    return np.concatenate(found)


def _fuller(random: RandomLaws) -> RandomLaws | None:
    """The same with all modes that the points of its fields resolve; None: there is no field."""
    wider: dict[int, DiscretisedField] = {}

    def widen(source: DiscretisedField, most: int, *cell_dimension: int) -> None:
        most = min(len(source.points), most)
        if id(source) in wider or most <= len(source.eigenvalues):
            return
        try:
            field = replace(source.field, modes=most, variance_captured=None)
            wider[id(source)] = field.on(source.points, source.weights, *cell_dimension)
        except SceneError:
            return

    for source in random.sources.values():
        if isinstance(source, DiscretisedField):
            widen(source, MOST_FIELD_MODES)
    for name, of_part in random.fields.items():
        widen(of_part, MOST_PART_MODES, random.problem.cells_of(name)[2])
    if not wider:
        return None
    sources = {key: wider.get(id(s), s) for key, s in random.sources.items()}
    parts = {name: wider.get(id(s), s) for name, s in random.parts.items()}
    of_loads = [each for found in random.loads.values() for each in found]
    space = RandomSpace([*sources.values(), *of_loads, *parts.values()])
    return replace(random, sources=sources, parts=parts, space=space)


def _not_resolved(own: RandomLaws, full: RandomLaws) -> float:
    """Variance that fields have beside their modes, over what of it the points resolve: of the field with
    most."""
    most = 1.0
    pairs = [(s, full.sources[key]) for key, s in own.sources.items()]
    for source, wider in pairs + [(s, full.parts[name]) for name, s in own.parts.items()]:
        if isinstance(source, DiscretisedField) and isinstance(wider, DiscretisedField):
            found = wider.captured - source.captured
            if found > 0.0:
                most = max(most, (1.0 - source.captured) / found)
    most = min(most, MOST_NOT_RESOLVED)
    return most * (1.0 + min(UNRESOLVED * (most - 1.0), MOST_UNRESOLVED))
