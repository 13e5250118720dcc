"""What is believed of the error of the meshes of a search: estimates, and changes from mesh to mesh."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from itertools import pairwise
from math import isfinite
from time import perf_counter
from typing import Any

import numpy as np
from latin_core import Options

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import agreement, exchanged
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.deferred import special
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.interrupts import Interrupt
from dolfinx_frontend.common.progress import progress as bars
from dolfinx_frontend.estimate.adaptive import NOT_YET
from dolfinx_frontend.estimate.cells import Cells, cells_of
from dolfinx_frontend.estimate.errors import DIGIT, beside_what_acts, errors, over_ranks
from dolfinx_frontend.estimate.finer import MOST_DEGREE
from dolfinx_frontend.estimate.levels import (
    OF_COARSE,
    CoarsePoints,
    FinePoints,
    coarse_points,
    fine_points,
)
from dolfinx_frontend.estimate.mesh_error import (
    DeviationError,
    DiscretisationError,
    deviation_error,
    discretisation_error,
    with_dual,
)
from dolfinx_frontend.estimate.pieces import of_chords_on_ranks
from dolfinx_frontend.estimate.unseen import of_crossing_chords
from dolfinx_frontend.estimate.zones import (
    RESOLVED,
    SEEN,
    acted,
    all_values_of,
    contact_zones,
    loading,
    parts_read,
    places_of,
    values_of,
)
from dolfinx_frontend.evaluate.evaluator import complete
from dolfinx_frontend.evaluate.model import QuantityModel
from dolfinx_frontend.moments.fields import Lost, beside_fields, lost_of_fields
from dolfinx_frontend.moments.search import FEW_GERMS, tolerance_of
from dolfinx_frontend.plan.plan import Method, make_plan
from dolfinx_frontend.plan.random_laws import RandomLaws
from dolfinx_frontend.results.chaos import ChaosResult
from dolfinx_frontend.results.errors import MeshStep, Place
from dolfinx_frontend.results.probes import AtPoint
from dolfinx_frontend.results.result import Result
from dolfinx_frontend.results.resultant import Interest, Resultant, Wanted
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.solvers.deterministic import solve_once
from dolfinx_frontend.solvers.galerkin import chaos_on, solve_chaos
from dolfinx_frontend.uncertainty.chaos import Chaos
from dolfinx_frontend.uncertainty.fields import DiscretisedField
from dolfinx_frontend.uncertainty.statistics import FINEST, Compared, ErrorShare, MeanStd, share_of

__all__ = ["MARGIN", "Judged"]

_log = logging.getLogger(__name__)

SLOWEST, FASTEST = 0.65, 0.2
"""Factors by which the error is taken to have fallen in one step, when its change tells what is left."""

AT_EDGES = 0.6
"""The least of these where a contact zone has an edge, or straight cells round off a face: unseen errors."""

AT_DEGREE, MOST_RAISED = 0.32, 0.8
"""This factor where degree 2 became 3 in parts with most of the error, this share at least: a free corner of
270 degrees keeps (2 / 3)^(4 0.54) = 0.42 of its error then, 0.71 of the change, which is `MARGIN` times what
this factor says; clamped corners keep 0.3, smooth answers less. With less of it in them it is the least."""

BLIND = 3.0
"""Times the estimate before that a change is if estimates do not see what changes."""

RECORD, SURE_OF_RECORD, LEAST_OF_RECORD = 2, 4.0, 0.02
"""Meshes with twice the estimate, and steps that gave contacts more points, that say how much estimates say
too much; times what they say, for half of a change may be left, and the next mesh be as good as the last one;
and the least that is believed of it."""

FEW_UNKNOWNS = {2: 400, 3: 3000}
"""Unknowns by dimension below which one mesh is not believed alone, nor its change to a second one: glue of
layers of a few cells was 3.8 % off where 2.0 % was said."""

SURE = 2.0
"""Times the estimate without cancellation that one mesh alone must be better than asked."""

MARGIN = 1.5
"""What is believed, relative to the larger witness."""

HALVED, RATE = 0.5, 0.71
"""The factors between which an error is taken to fall from mesh to mesh where there is no estimate of it: of
halved cells at a re-entrant corner, and the largest with which changes are taken for those of a sequence that
converges."""

TINY = 0.1
"""Changes below this share of what the meshes may leave need not fall."""

FORGOTTEN = 0.4
"""Weight of a change by those that came after it."""

OF_DEVIATION = 1.5
"""Times the bound of the error of the mean that the one of a deviation is taken for on one mesh."""

ACTS = 2.0
"""How much more must be of the quantity with loads one deviation off their means to look at it there."""

FOLLOWS = 1.5
"""Errors away from the means, relative to the one there, up to which they are taken to follow it."""

LESS = 0.8
"""Share of what the meshes leave of the accuracy that is asked of points."""

LITTLE = 0.03
"""Share of what the meshes may leave up to which it is little that random fields leave out."""

AS_MUCH = 0.05
"""Change of the variance that modes of fields leave out, relative to it, from mesh to mesh, up to which these
are taken for the same."""

ALMOST = 0.85
"""Share of an accuracy up to which meshes may come for points to fit into what is left: the sum is asked for
alone, and one more mesh, with the points on it, costs more than a try."""

ITERATED, OF_ITERATION = 1e-6, 10.0
"""Error of an iteration beside which a value may be none, and how many times the error it may be then."""

LOST_STEPS, LOST_IN = 3, 0.01
"""Meshes after which a value is given up that is below this share of its largest, and below its error."""


class Judged:
    """The search for meshes.

    Attributes
    ----------
    scene
        With the present meshes.
    problem, result
        That of the present meshes, and the answer at the means of what is random.
    acting
        Values of random loads that the answer is for instead of their means, as ``with_laws`` takes them.
    share
        Error of its meshes, as it is believed.
    run, answered
        What holds Ctrl-C back once there is an answer, which has been measured unless it is the first.
    meshes, cells
        Part -> its cells, and what each contributes: of all parts, on all ranks.
    worst
        Point (1, L) of the germs where the meshes do most to the deviation, and the relative error of this by
        an error of 1 there; None: nothing but what they do at the means.
    comm
        The communicator of the user's whose ranks share the parts; None: there is one.
    """

    def __init__(
        self,
        scene: Scene,
        accuracy: float,
        quantity: Interest,
        max_unknowns: int,
        max_seconds: float | None,
        progress: bool,
        comm: Any = None,
    ) -> None:
        self.scene, self.comm = copy(scene), comm
        self.accuracy, self.asked_for = accuracy, quantity
        self.max_unknowns, self.max_seconds, self.shown = max_unknowns, max_seconds, progress
        self.quantity: Wanted | None = None
        self.compared: Compared | None = None
        self.spread: float | None = None
        self.result: Result | None = None
        self.share: ErrorShare | None = None
        self.run = Interrupt(holds=False, alone=comm is None or comm.size == 1)
        self.answered: tuple[Result, ErrorShare] | None = None
        self.target = self.of_meshes = accuracy
        self.steps: list[MeshStep] = []
        self.places: tuple[Place, ...] = ()
        self.notes: list[str] = []
        self.random = self.by_modes = False
        self.problem: Problem | None = None
        self.acting: dict[str, Any] = {}
        self.acting_at: dict[str, float] | None = None
        self.before: Problem | None = None
        self.first: Problem | None = None
        self.of_first: ChaosResult | None = None
        self.chaos: ChaosResult | None = None
        self.lost: tuple[Problem, Lost] | None = None
        self.plain = True
        self.coarse: CoarsePoints | None = None
        self.fine: FinePoints | None = None
        self.worst: tuple[Array, float] | None = None
        self.norms: list[float] = []
        self.largest = 0.0
        self.given_up = False
        self.estimates: list[float] = []
        self.leasts: list[float] = []
        self.read: dict[str, Ints | slice] = {}
        self.weighted, self.cut = True, False
        self.in_whole_numbers = False
        self.by_part: list[dict[str, float]] = []
        self.raised: dict[int, float] = {}
        self.edges: dict[str, Array] = {}
        self.alike: dict[str, list[tuple[int, bytes]]] = {}
        self.points: list[dict[str, int]] = []
        self.of_first_value = ""
        self.of_itself: Wanted | None = None
        self.of_itself_since = 0
        self.few = False
        self.meshes: dict[str, Cells] = {}
        self.cells: dict[str, Array] = {}
        self.unseen: dict[str, float] = {}
        self.stays: dict[str, float] = {}
        self.began = perf_counter()

    def _solve(
        self, problem: Problem, changed: dict[str, str], method: Method, options: Options, **settings: Any
    ) -> None:
        """Solve on the present meshes, and measure."""
        earlier, self.meshes = self.meshes, cells_of(problem)
        self.problem = problem
        result = self._at(problem, self.result, method, options, settings)
        if not self.steps and self._acts_far_from_the_means(result, method, options, settings):
            result = self._at(problem, None, method, options, settings)
        if not self.steps:
            self.of_itself = self.quantity
            self.quantity, notes = self._beside_what_acts(result)
            self.notes += notes
            self.of_first_value = next((note for note in notes if "absolute=" in note), "")
        elif self.of_first_value:
            self._value_now(result)
        if self.answered is None:
            self._answers(result, NOT_YET)
        found = self._measured(result)
        self.result = result
        beside = isinstance(self.quantity, Resultant) and self.quantity.compared.deviation
        if self.random and beside and not self.steps:
            self.of_first = self._first_chaos(problem, method, options, settings)
            self.spread = self.of_first.mean_std(self.quantity).std
        value = None if self.quantity is None else result.mean_std(self.quantity).mean
        of_loads = self._of_random_loads(method, options, settings)
        self.norms.append(found.norm)
        self.largest = max(self.largest, abs(value or 0.0))
        of_quantity = found.quantity is not None
        self.weighted = of_quantity or self.quantity is None
        self.read = self._reads(result)
        cut = all(
            name in earlier and len(self.meshes[name].sizes) > len(earlier[name].sizes) for name in self.read
        )
        self.cut = cut or (self.cut and self.weighted)
        if of_quantity:
            size = self._size(value)
            estimate, least = (share_of(each or 0.0, size) for each in (found.seen, found.quantity))
            sure = share_of(found.uncancelled, size)
        else:
            estimate = sure = found.energy if self.quantity is None else np.nan
            least = 0.0
        self._count_unseen(found, value)
        of_unseen, stays = sum(self.unseen.values()), sum(self.stays.values())
        self.cells = problem.gather(found.cells, parts=True)
        if of_loads is not None and of_quantity:
            # of the deviation, which the answer at the means may know nothing of
            largest = share_of(of_loads.quantity, of_loads.std)
            of_mean, of_std = (share_of(1.0, each) for each in (self._size(value), of_loads.std))
            if largest > estimate or not isfinite(of_mean):
                self.cells = of_loads.cells
            elif isfinite(of_std):
                self.cells = {n: of_mean * c + of_std * of_loads.cells[n] for n, c in self.cells.items()}
            estimate, sure = max(estimate, largest), max(sure, share_of(of_loads.bound, of_loads.std))
        if of_quantity:
            apart = self._apart_from_the_means(result, found, method, options, settings)
            estimate, sure = max(estimate, apart), max(sure, apart)
        estimate, sure = estimate + of_unseen, sure + of_unseen + stays
        self.estimates.append(estimate if isfinite(estimate) else found.energy**2)
        self.by_part.append({name: float(each.sum()) for name, each in self.cells.items()})
        higher = [name for name, how in changed.items() if how == f"degree {MOST_DEGREE}"]
        if higher:  # of the mesh before, what was in parts that have a higher degree now
            old = self.by_part[-2]
            share = sum(old[name] for name in higher) / max(sum(old.values()), 1e-300)
            self.raised[len(self.steps)] = share
        # the edge of a contact zone is in no estimate: a mesh that is finer there shows what it does
        across = self._look_at_contacts(result)
        self.leasts.append(least)
        estimate *= self._over_said(value, self.estimates)
        least *= self._over_said(value, self.leasts)
        seen = self._change(value) if self.weighted else self._change_alone(value)
        said, how = estimate, "recovered stresses"
        if not self.weighted:
            said, how = seen, "the change from mesh to mesh"
        elif isfinite(seen) and seen > estimate:
            said, how = seen, "the change from mesh to mesh"
        elif not self.steps and not SURE * sure <= self.target:
            how = "recovered stresses; no second mesh confirms it"
        # what is added for singular stresses is a margin already
        self.rest = max(MARGIN * said, least + of_unseen)
        if self.raised.get(len(self.steps), 0.0) > MOST_RAISED:  # the shape is as it was before
            self.rest = max(self.rest, MARGIN * seen + of_unseen)
        said = self.rest + MARGIN * stays
        if stays > 0.5 * said:
            how = f"cells on round faces of {max(self.stays, key=lambda n: self.stays[n])}"
        absolute = None if value is None else said * self._size(value)
        energy = said if self.quantity is None else MARGIN * found.energy
        self.sure = sure
        self.share = ErrorShare(energy, absolute, None, how)
        self.places = places_of(result.problem, self.meshes, self.cells)
        self._answers(result, self.share)
        if self.max_seconds is not None:
            self.run.limit(self.max_seconds - self._spent())
        costs = result.solver.costs
        kept = (over_ranks(result, sum(bool(each["kept"]) for each in costs)), over_ranks(result, len(costs)))
        seconds = self._spent()
        unknowns = sum(problem.unknowns.values())
        step = MeshStep(unknowns, value, said, seconds, dict(changed), kept)
        self.steps.append(step)
        # nor is the shape of a part whose cells turn by more than 45 degrees, nor all that means leave out
        enough = SURE * (OF_DEVIATION if self.random else 1.0)
        means = any(
            each.space != "points" and len(each.sides) == 2 and each.law.prescribes is None
            for each in problem.interfaces.values()
        )
        # of few cells stresses that are fitted hide as much as they show, and so may one change
        self.few = unknowns < FEW_UNKNOWNS[problem.dim]
        alone = enough * sure <= self.target and not (
            self.edges or means or self.few or self._of_chords() or self.read
        )
        # a zone of few points is believed where the change since a coarser one fits amply
        second = len(self.steps) > (2 if self.few else 1)
        seen_well = across >= RESOLVED or (second and across >= SEEN and 2.0 * said <= self.target)
        self.confirmed = (self._followed() if self.read else second or alone) and seen_well
        self.confirmed = self.confirmed and self._contacts_followed(value)
        self.said = said
        line = f"mesh {len(self.steps)}: {step}, {seconds:.3g} s"
        if problem.rank == 0:
            _log.info("%s", line)
        if problem.rank == 0 and self.shown and bars() and sys.stderr is not None and sys.stderr.isatty():
            print(line, file=sys.stderr)

    def _beside_what_acts(self, result: Result) -> tuple[Wanted | None, tuple[str, ...]]:
        """The quantity as it was asked for, or relative to what acts if its value is rounding; and a note."""
        quantity, notes = beside_what_acts(result, self.of_itself)
        if notes or not 0.0 < result.error < ITERATED:
            return quantity, notes
        why = "is within the error of the iteration"
        return beside_what_acts(result, self.of_itself, OF_ITERATION * result.error, why)

    def _value_now(self, result: Result) -> None:
        """Look again at a value that was rounding on the first meshes: now it may be more, and errors are
        relative to the value itself, as it was asked."""
        assert self.quantity is not None
        value = result.mean_std(self.quantity).mean
        at = self.notes.index(self.of_first_value)
        quantity, notes = self._beside_what_acts(result)
        if not notes:
            before = self._size(value)
            self.quantity = quantity
            for known in (self.estimates, self.leasts):
                known[:] = [share_of(before * each, self._size(value)) for each in known]
            self.of_first_value, self.of_itself_since = "", len(self.steps)
            del self.notes[at]
            return
        first = self.of_first_value.partition(";")[0]
        now = f"{first}; on the last meshes it is {value:.3g}: give absolute= to say what matters"
        self.notes[at] = self.of_first_value = now

    def _look_at_contacts(self, result: Result) -> float:
        """Find the edges of contact zones, and how many points the one with the fewest has in each direction.

        Where all points do the same with friction that is nearly used up, there may be an edge between them:
        two meshes with different points must agree that there is none.
        """
        zones, problem = contact_zones(result), self.problem
        assert problem is not None
        self.points.append({n: i.num_points for n, i in problem.interfaces.items()})
        self.edges = dict(zones.edges)
        # beside a field a contact has an edge at some of its values, if not at this one
        for (name, _), source in RandomLaws.of(problem).sources.items():
            if isinstance(source, DiscretisedField) and not problem.interfaces[name].law.linear:
                self.edges.setdefault(name, problem.interfaces[name].points)
        for name, (closed, does) in zones.alike.items():
            known = self.alike.setdefault(name, [])
            count = self.points[-1][name]
            if not any(does == before and count > fewer for fewer, before in known):
                self.edges[name] = closed
            known.append((count, does))
        return zones.across

    def _contacts_followed(self, value: float | None) -> bool:
        """Whether some step has given all contacts with an edge more points: a higher degree leaves them as
        they are, and with them what these do not see. And whether two changes fall, where they are much more
        than the estimates say."""
        if not (self.weighted and self._beside_curved()):
            return True
        if not all(self.points[-1][name] > self.points[0][name] for name in self.edges):
            return False
        changes = self._changes(value)
        blind = len(changes) > 0 and changes[-1] > max(BLIND * self.estimates[-2], TINY * self.target)
        return not blind or self._changes_fall(changes)

    def _changes_fall(self, changes: Array) -> bool:
        """Whether the last two of the changes fall as where it converges, or do not count."""
        if len(changes) < 2:
            return False
        before, last = changes[-2:]
        return bool(last <= RATE * before or max(before, last) <= TINY * self.target)

    def _answers(self, result: Result, share: ErrorShare) -> None:
        """What Ctrl-C returns from now on, until there is something better."""
        self.answered = result, share
        self.run.hold()

    def _spent(self) -> float:
        """Seconds since the beginning, the same on all ranks."""
        assert self.problem is not None
        seconds, comm = perf_counter() - self.began, self.problem.comm
        return seconds if comm is None else max(exchanged(comm, seconds))

    def _at(
        self,
        problem: Problem,
        before: Result | None,
        method: Method,
        options: Options,
        settings: Mapping[str, Any],
    ) -> Result:
        """The answer at the means of what is random, or where loads act."""
        if self.acting_at is not None:
            self.acting = _acting(RandomLaws.of(problem), self.acting_at)
            problem = problem.with_laws(values=dict(self.acting))
        vary: Sequence[str] = ()
        linear = all(each.law.linear for each in problem.interfaces.values())
        if self.random and (not linear or isinstance(self.quantity, Resultant)):
            vary = RandomLaws.of(problem).interfaces  # points and chaos have the same factors
        if vary and linear:
            settings = {**settings, "active": self._kept(problem, settings)}
            # where a direct solution would do, changes from mesh to mesh must not be those of the iteration
            options = options.with_(rtol=max(DIGIT * options.rtol, FINEST))
        others = []
        later = self._later(options, before)
        plan = make_plan(problem, method, vary=vary, options=later, **settings)
        if later != options:
            others = [make_plan(problem, method, vary=vary, options=options, **settings)]
        result = solve_once(
            problem, plan, estimator=errors, before=before, progress=self.shown, others=others
        )
        complete(result)
        return result

    def _later(self, options: Options, before: Result | None) -> Options:
        """Without Newton's steps from the second mesh on, unless they were asked for: one is worth many
        iterations by then, and these start near their end."""
        return options if before is None or not self.plain else options.with_(newton=0)

    def _acts_far_from_the_means(
        self, result: Result, method: Method, options: Options, settings: Mapping[str, Any]
    ) -> bool:
        """Whether random loads act far less at their means than one deviation off these, where a law is not
        linear: then meshes are judged there. Sets the values of the loads."""
        problem = result.problem
        random = RandomLaws.of(problem)
        curved = any(not each.law.linear for each in problem.interfaces.values())
        found = loading(random)
        if not (found and curved):
            return False
        columns = sorted({c for _, source in found for c in random.space.columns(source)})
        sign = np.where(np.arange(len(columns)) % 2 == 0, 1.0, -1.0)
        least, farthest = ACTS * acted(result, self.quantity), 0.0
        chosen: dict[str, float] | None = None
        ones = np.ones(len(columns))
        for side in (ones, -ones, sign, -sign)[: 2 if len(columns) == 1 else 4]:
            names = [random.space.germ_names[column] for column in columns]
            self.acting_at = dict(zip(names, map(float, side), strict=True))
            try:
                there = self._at(problem, None, method, options, settings)
            except SceneError:
                continue  # what is pulled off may move freely
            size = acted(there, self.quantity)
            if size > max(least, farthest):
                farthest, chosen = size, self.acting_at
        self.acting_at = chosen
        self.acting = {} if chosen is None else _acting(random, chosen)
        return chosen is not None

    def _apart_from_the_means(
        self,
        result: Result,
        found: DiscretisationError,
        method: Method,
        options: Options,
        settings: Mapping[str, Any],
    ) -> float:
        """Relative error of mean and deviation by errors of the meshes away from the means, 0.0 where they
        follow the one there: a point that sticks has another error than one that slides.

        On the first mesh on both sides of every germ, at the points of a Gauss rule; later only where that is
        worst. What contributes there guides the meshes, too.
        """
        problem = result.problem
        random = RandomLaws.of(problem)
        curved = any(not each.law.linear for each in problem.interfaces.values())
        follows = self.steps and self.worst is None
        few = 0 < random.space.dimension <= FEW_GERMS
        if follows or self.acting or random.of_fields or not (self.random and curved and few):
            return 0.0

        def there(point: Array) -> DiscretisationError | None:
            try:
                made = self._at_values(result, all_values_of(random, point), method, options, settings)
                return self._measured(made) if made.converged else None
            except SceneError:
                return None  # what is pulled off may move freely

        of_mean = share_of(1.0, self._size(found.value))
        if self.worst is None:
            error, at_worst = self._along_germs(random, found, there)
        else:
            at_worst = there(self.worst[0])
            whole = 0.0 if at_worst is None else at_worst.quantity or 0.0
            error = of_mean * found.seen + self.worst[1] * whole
        if at_worst is None or self.worst is None:
            return 0.0
        cells = problem.gather(at_worst.cells, parts=True)
        self.cells = {n: of_mean * c + self.worst[1] * cells[n] for n, c in self.cells.items()}
        return error

    def _along_germs(
        self,
        random: RandomLaws,
        found: DiscretisationError,
        there: Callable[[Array], DiscretisationError | None],
    ) -> tuple[float, DiscretisationError | None]:
        """Relative error of mean and deviation by those at the points of a Gauss rule of three points along
        each germ, and the one that does most to the deviation; None: that at the means says enough.

        Keeps the point of that, and what an error there does to the deviation.
        """
        value, correction = found.value or 0.0, found.correction or 0.0
        largest, variance, of_variance, of_mean = 0.0, 0.0, 0.0, correction
        worst: tuple[Array, float, DiscretisationError] | None = None
        for germ in range(random.space.dimension):
            scores = np.zeros((2, random.space.dimension))
            scores[:, germ] = -np.sqrt(3.0), np.sqrt(3.0)
            points = random.space.from_normal(scores)
            sides = [there(points[k : k + 1]) for k in range(2)]
            if any(each is None for each in sides):
                return 0.0, None
            rule = [(found, 2.0 / 3.0), *((each, 1.0 / 6.0) for each in sides if each is not None)]
            mean = sum(weight * (each.value or 0.0) for each, weight in rule)
            off = [weight * ((each.value or 0.0) - mean) for each, weight in rule]
            variance += sum(weight * ((each.value or 0.0) - mean) ** 2 for each, weight in rule)
            left = sum(w * (each.correction or 0.0) for w, (each, _) in zip(off, rule, strict=True))
            of_variance += abs(left)
            of_mean += sum(weight * ((each.correction or 0.0) - correction) for each, weight in rule)
            for k, (weight, (each, _)) in enumerate(zip(off[1:], rule[1:], strict=True)):
                size = abs(weight * (each.correction or 0.0))
                if size > largest:
                    largest, worst = size, (points[k : k + 1], abs(weight), each)
        if worst is None or not variance > 0.0:
            return 0.0, None
        whole = self._size(value)
        error = max(of_variance / variance, share_of(abs(of_mean), whole))
        if error <= FOLLOWS * share_of(found.quantity or 0.0, whole):
            return 0.0, None
        self.worst = worst[0], worst[1] / variance
        return error, worst[2]

    def _at_values(
        self,
        result: Result,
        values: Mapping[str, Any],
        method: Method,
        options: Options,
        settings: Mapping[str, Any],
    ) -> Result:
        """The answer at values of what is random, from the one at the means."""
        problem = result.problem.with_laws(values=dict(values))
        kept = {**settings, "active": list(result.plan.active)}
        plan = make_plan(problem, method, options=self._later(options, result), **kept)
        found = solve_once(problem, plan, estimator=errors, before=result, progress=False)
        complete(found)
        return found

    def _of_random_loads(
        self, method: Method, options: Options, settings: Mapping[str, Any]
    ) -> DeviationError | None:
        """What the meshes do to the deviation where loads, imposed jumps or the like are random; None: the
        answer at the means tells as much, or it cannot be estimated."""
        assert self.result is not None
        problem = self.problem
        assert problem is not None
        random = RandomLaws.of(problem)
        loads = bool(loading(random))
        linear = all(each.law.linear for each in problem.interfaces.values())
        if not (loads and linear and isinstance(self.quantity, Resultant)):
            return None
        try:
            self.chaos = self._chaos_on(problem, method, options, settings)
            if self.of_first is None:
                self.of_first = self.chaos
            found = deviation_error(self.result, self.chaos, self.quantity)
            self.by_modes = True
            return found
        except SceneError as error:
            note = f"the error of the deviation is not estimated: {str(error).splitlines()[0]}"
            if note not in self.notes:
                self.notes.append(note)
            return None

    def _chaos_on(
        self, problem: Problem, method: Method, options: Options, settings: Mapping[str, Any]
    ) -> ChaosResult:
        """The chaos of order 1 on some meshes, if it is there already that one."""
        for known in (self.chaos, self.of_first):
            if known is not None and known.problem is problem:
                return known
        return self._first_chaos(problem, method, options, settings)

    def _count_unseen(self, found: DiscretisationError, value: float | None) -> None:
        """Relative errors that recovered stresses do not show: of what finer meshes make smaller, and of the
        chords of parts whose cells can only be cut, which stay."""
        whole = 1.0 if self.quantity is None or value is None else self._size(value)
        if found.quantity is None and self.quantity is not None:
            whole = 1.0  # guided by the energy
        if not self.steps:
            assert self.problem is not None
            with agreement(self.problem.comm):
                crossing = of_crossing_chords(self.problem)
            crossing |= of_chords_on_ranks(self.problem)
            # of the ranks on both sides of a cut each knows its own part
            for name, each in self.problem.gather(crossing, parts=True).items():
                if not self.meshes[name].again:
                    self.stays[f"part {name!r}"] = each
        self.unseen = {f"interface {name!r}": share_of(e, whole) for name, e in found.means.items()}
        for name, error in found.round.items():
            each, where = share_of(error, whole), f"part {name!r}"
            if self.meshes[name].again:
                self.unseen[where] = each
            else:  # as on the first mesh: pieces of a chord do not turn
                if not self.steps:
                    self.stays[where] = self.stays.get(where, 0.0) + each

    def _reads(self, result: Result) -> dict[str, Ints | slice]:
        """Part -> its cells that a step must make smaller for its change to say anything."""
        if self.quantity is None or (self.weighted and isinstance(self.quantity, Resultant)):
            return {}
        at = with_dual(result.problem, self.quantity)
        if self.weighted and isinstance(at, AtPoint):
            return {at.part: np.array([at.cell])}
        return dict.fromkeys(sorted(parts_read(result, self.quantity)), slice(None))

    def _beside_curved(self) -> set[str]:
        """Parts beside laws that are not linear."""
        assert self.problem is not None
        curved = [each for each in self.problem.interfaces.values() if not each.law.linear]
        return {side.substructure for each in curved for side in each.sides}

    def to_cut(self) -> set[str]:
        """Parts that get smaller cells and no higher degree, which leaves the points of interfaces as they
        are: those that are read, until their cells were cut once if there is an estimate; and beside laws
        that are not linear."""
        curved = self._beside_curved() if self.read else set()
        return curved.union(() if self.weighted and self.cut and not curved else self.read)

    def _followed(self) -> bool:
        """Whether the step to the last mesh changed all parts that the number is read from, and one cut their
        cells; without an estimate the last two, the last one by more cells, with changes that fall as where
        it converges."""
        count = 1 if self.weighted else 2
        steps = self.steps[-count:] if len(self.steps) > count else []
        if not (steps and self.cut) or any(name not in step.changed for name in self.read for step in steps):
            return False
        if self.weighted:
            return True
        return self._changes_fall(self._changes(self.steps[-1].value))

    def _measured(self, result: Result) -> DiscretisationError:
        if self.quantity is not None and with_dual(result.problem, self.quantity) is not None:
            try:
                return discretisation_error(result, self.quantity)
            except SceneError as error:
                note = f"the energy guides the meshes: {str(error).splitlines()[0]}"
                if note not in self.notes:
                    self.notes.append(note)
        return discretisation_error(result)

    def _size(self, value: float | None) -> float:
        """What an error is relative to: of a deviation, which the first chaos tells, too."""
        assert self.quantity is not None
        std = None
        if self.quantity.compared.deviation and self.spread is not None:
            std = self.spread
        return self.quantity.compared.size(value or 0.0, std)

    def _least(self, share: float) -> float:
        """A deviation that is nothing beside the mean, or beside what it is compared with."""
        assert self.quantity is not None
        return max(share * abs(self.steps[-1].value or 0.0), self.quantity.compared.least)

    def _change(self, value: float | None) -> float:
        """What the changes from mesh to mesh say of the error that is left; NaN: there is one mesh only.

        Changes before the last count as far as the error has fallen since: one change may be small by chance.
        """
        if not self.steps:
            return np.nan
        changes = self._changes(value)
        falls = np.divide(self.estimates[1:], np.maximum(self.estimates[:-1], 1e-300))
        least = np.array([self._fastest_of_step(k + 1) for k in range(len(falls))])
        raised = [self.raised.get(k + 1, 0.0) > MOST_RAISED for k in range(len(falls))]
        most = np.where(raised, AT_DEGREE, SLOWEST)
        falls = np.clip(falls, least, most)
        if self.read and self._beside_curved():  # between the points of an interface nothing is estimated
            falls = np.maximum(falls, HALVED)
        if self.edges:
            falls = np.maximum(falls, AT_EDGES)
        left, since = 0.0, 1.0
        for change, fall in zip(changes[::-1], falls[::-1], strict=True):
            since *= fall if since == 1.0 else fall * FORGOTTEN
            of_one = since / np.sqrt(1.0 - fall**2) if value is None else since / (1.0 - fall)
            left = max(left, float(change * of_one))
        return left

    def _more_points(self) -> list[bool]:
        """Of each step whether it gave some contact more points."""
        return [any(b[name] > a[name] for name in a) for a, b in pairwise(self.points)]

    def _over_said(self, value: float | None, estimates: Sequence[float]) -> float:
        """What the last of the estimates is to be multiplied with, at most 1.

        Coarser meshes may show that they say too much: friction that is used up leaves parts almost free,
        whose dual solutions are large. The error of a mesh with twice the estimate is taken for its distance
        from the present one.
        """
        if value is None or not (self.weighted and self._beside_curved()) or len(self.steps) < RECORD:
            return 1.0
        if self.of_first_value:  # the changes of what is rounding say nothing
            return 1.0
        apart = [HALVED * each >= estimates[-1] for each in estimates[:-1]]  # else the distance is no error
        if min(sum(self._more_points()), sum(apart)) < RECORD:
            return 1.0
        worst = 0.0
        for step, estimate in zip(self.steps, estimates, strict=False):
            if step.value is None or not estimate > 0.0:
                return 1.0
            worst = max(worst, share_of(step.value - value, self._size(value)) / estimate)
        return min(1.0, max(SURE_OF_RECORD * worst, LEAST_OF_RECORD))

    def _changes(self, value: float | None) -> Array:
        """Relative changes from mesh to mesh, to one with this value."""
        if value is None:
            squares = np.array(self.norms) ** 2
            return np.asarray(np.sqrt(np.abs(np.diff(squares)) / max(squares[-1], 1e-300)))
        values = [step.value for step in self.steps]
        if len(values) < len(self.norms):  # of the present meshes there is no step yet
            values.append(value)
        changes = np.diff(np.array(values, dtype=np.float64))
        return np.array([share_of(each, self._size(value)) for each in changes])

    def _change_alone(self, value: float | None) -> float:
        """The same for a number without an estimate, by the rate of the changes themselves."""
        if not self.steps:
            return np.nan
        values = [step.value for step in self.steps]
        self.in_whole_numbers = value is not None and value.is_integer() and set(values) == {value}
        if self.in_whole_numbers:
            self.notes.append(
                f"the value {value:g} does not change with the meshes, and a whole number need not: their "
                "error is not known; ask for the number that it depends on"
            )
            self.given_up = True
            return np.nan
        changes = self._changes(value)
        slow = AT_EDGES if self.edges else HALVED
        if len(changes) < 2:
            return float(changes[-1] * RATE / (1.0 - RATE))
        before, last = changes[-2:]
        fall = float(np.clip(last / max(before, 1e-300), slow, RATE))
        if fall == RATE:
            last = max(last, before)
        return float(max(last, FORGOTTEN * slow * before) * fall / (1.0 - fall))

    def _fastest_of_step(self, mesh: int) -> float:
        """The same of the step to a mesh, by its number, without edges of contact zones."""
        return AT_DEGREE if mesh in self.raised else FASTEST

    def _of_chords(self) -> list[str]:
        """Parts of straight cells that may have another shape."""
        return [name for name, each in self.meshes.items() if each.again and each.straight]

    def _fits(self) -> bool:
        assert self.result is not None
        if self.in_whole_numbers:
            return True
        if not self.result.converged:
            self.notes.append(f"the meshes were not carried on: the iteration ended as {self.result.status}")
            return True
        if MARGIN * sum(self.stays.values()) > self.target and self.rest <= self.said - self.rest:
            worst = max(self.stays, key=lambda n: self.stays[n])
            self.notes.append(
                f"{worst}: its cells keep their chords of round faces however they are cut, which leave "
                f"{self.stays[worst]:.2g}, more than asked; give a part that can be meshed again "
                "(geometry.remeshable), or more and curved cells"
            )
            return True
        if self._cannot_be_told():
            return self._as_far_as_it_acts()
        return self.said <= max(self.target, self._almost()) and self.confirmed

    def _almost(self) -> float:
        """Errors up to which points are tried, of which :meth:`_by_points` says whether they fit."""
        assert self.problem is not None
        curved = any(not each.law.linear for each in self.problem.interfaces.values())
        points = self.random and curved and self.before is not None and isinstance(self.quantity, Resultant)
        return ALMOST * self.accuracy if points else 0.0

    def _not_confirmed(self) -> None:
        """Where a search ends and would fit, with changes that tell no rate, a contact whose edge no other
        mesh has confirmed, or few unknowns: nothing is known."""
        if self.confirmed or self.share is None or not self.said <= self.accuracy:
            return
        if not self.weighted:
            how = "the change from mesh to mesh, of too few meshes, or of changes that do not fall"
        elif self.edges:
            how = f"no other mesh confirms where {', '.join(map(repr, self.edges))} slips or opens"
        elif self.few:
            how = f"{self.steps[-1].unknowns} unknowns, too few to believe without finer meshes"
        else:
            return
        self.share = replace(self.share, energy=np.nan, quantity=np.nan, how=how)
        self.steps[-1] = self.steps[-1]._replace(error=np.nan)

    def _one_mesh_alone(self) -> None:
        """Where a search ends on its first mesh, which is not believed: what it says without cancellation."""
        if len(self.steps) != 1 or self.confirmed or not isfinite(self.sure) or self.share is None:
            return
        said = MARGIN * self.sure
        if not said > self.said or self.quantity is None:
            return
        self.said = said
        absolute = said * self._size(self.steps[-1].value)
        how = "recovered stresses without cancellation; no second mesh confirms less"
        self.share = replace(self.share, quantity=absolute, how=how)
        self.steps[-1] = self.steps[-1]._replace(error=said)

    def _cannot_be_told(self) -> bool:
        """Whether the value is lost in its own error on mesh after mesh: it may be 0."""
        steps = self.steps[self.of_itself_since :]
        if self.quantity is None or len(steps) < LOST_STEPS:
            return False
        values = [abs(step.value or 0.0) for step in steps[-LOST_STEPS:]]
        if min(values) > LOST_IN * max(self.largest, *values) or not self.said > 1.0:
            return False
        return True

    def _as_far_as_it_acts(self) -> bool:
        """Whether the error of a value that may be 0 is small beside what acts; else it is given up."""
        assert self.result is not None and self.share is not None
        why = f"cannot be told from 0 (+- {self.share.quantity:.1g})"
        quantity, notes = beside_what_acts(self.result, self.quantity, LOST_IN, why)
        if not notes:
            self.notes.append(
                f"the value {self.steps[-1].value:.2g} {why}: no error is small relative to it; say what "
                "matters with absolute=, in its unit"
            )
            self.given_up = True
            return True
        before = self._size(self.steps[-1].value)
        self.quantity = quantity
        share = before / self._size(self.steps[-1].value)
        self.notes += notes
        self.said, self.rest, self.sure = (share * each for each in (self.said, self.rest, self.sure))
        for known in (self.estimates, self.leasts):
            known[:] = [share * each for each in known]
        self.steps[-1] = self.steps[-1]._replace(error=self.said)
        return self.said <= self.target and self.confirmed

    def _deviation_fits(self, method: Method, options: Options, settings: Mapping[str, Any]) -> bool:
        """Whether the deviation, of a chaos of order 1, has changed as little since an earlier mesh."""
        assert self.result is not None and self.share is not None
        if not isinstance(self.quantity, Resultant) or not self.result.converged:
            return True
        if self.before is None:
            return self._deviation_alone(method, options, settings)
        try:
            if self.of_first is None:
                assert self.first is not None
                self.of_first = self._first_chaos(self.first, method, options, settings)
            self._leave_room_for_fields(self.of_first)
            assert self.problem is not None
            if self._by_points(method, options, settings):
                whole = self.said + (self.fine.made.total if self.fine is not None else np.inf)
                return self.said <= self.target or whole <= self.accuracy
            old, self.chaos = self.chaos, self._chaos_on(self.problem, method, options, settings)
            self._leave_room_for_fields(self.chaos)
            # the first mesh is the cheapest one, and tells enough if little has changed since
            left = self._left_of_std(self.of_first, 0)
            if left > max(self.target, self.said) * (self.chaos.mean_std(self.quantity).std or 0.0):
                if old is None or old.problem is not self.before:
                    old = self._chaos_on(self.before, method, options, settings)
                left = min(left, self._left_of_std(old, len(self.steps) - 2))
        except SceneError as error:
            self.notes.append(f"the deviation is not compared over meshes: {str(error).splitlines()[0]}")
            return True
        std = self.chaos.mean_std(self.quantity).std or 0.0
        self.share = replace(self.share, std=left)
        # of a deviation that is nothing beside the mean: relative to that
        self.said = max(self.said, share_of(left, max(std, self._least(1e-9))))
        self.steps[-1] = self.steps[-1]._replace(error=self.said)
        return self.said <= self.target

    def _by_points(self, method: Method, options: Options, settings: Mapping[str, Any]) -> bool:
        """Whether points tell of the deviation, where a law is not linear: many of them on the first mesh,
        few on the present one, which are the answer if they fit."""
        assert self.of_first is not None and self.problem is not None and self.result is not None
        assert isinstance(self.quantity, Resultant) and self.share is not None
        if not self.of_first.collocations or self.given_up:
            return False
        settings = {**settings, "active": self._kept(self.problem, settings)}
        of_mean = self.said
        for _ in range(2):  # the deviation may leave less than the mean
            whole_left = min(max(self.accuracy - self.said, 0.3 * self.said), 0.5)
            left = LESS * whole_left
            if self.coarse is None or self.coarse.made.total > OF_COARSE * left:
                self.coarse = coarse_points(self.of_first, left, self.quantity, method, settings)
            if self.coarse is None:
                return False
            self.fine = fine_points(
                self.coarse,
                self.problem,
                self.result.solver,
                left,
                self.quantity,
                method,
                self._later(options, self.result),
                settings,
            )
            if self.fine is None:
                return False
            before = self.coarse.samples.mean_std(self.quantity)
            left_of_std = self._left_of_deviation(before, self.fine.samples.mean_std(self.quantity), of_mean)
            std = self.fine.samples.mean_std(self.quantity).std or 0.0
            self.share = replace(self.share, std=left_of_std)
            self.said = max(of_mean, share_of(left_of_std, max(std, self._least(1e-9))))
            if self.said > self.target or self.fine.made.total + self.said <= self.accuracy:
                break
        self.steps[-1] = self.steps[-1]._replace(error=self.said)
        return True

    def _left_of_std(self, old: ChaosResult, mesh: int) -> float:
        """What the change of the deviation since an earlier mesh, by its number, says of what is left."""
        assert self.chaos is not None and isinstance(self.quantity, Resultant)
        before, after = (each.mean_std(self.quantity) for each in (old, self.chaos))
        return self._left_of_deviation(before, after, self.said, mesh)

    def _left_of_deviation(self, before: MeanStd, after: MeanStd, of_mean: float, mesh: int = 0) -> float:
        """What is left of a deviation, by its change since an earlier mesh.

        As much of it as the mean is off, where the whole number is off by a factor: then only what the
        deviation has changed beside the mean is carried on.
        """
        std, old = after.std or 0.0, before.std or 0.0
        left = self._carried_on(old, std, mesh)
        if before.mean and abs(after.mean - before.mean) < 0.5 * abs(before.mean):
            beside = self._carried_on(old * after.mean / before.mean, std, mesh)
            left = min(left, of_mean * std + beside)
        return max(left, of_mean * std)

    def _carried_on(self, before: float, after: float, mesh: int) -> float:
        """What the change of a deviation since an earlier mesh, by its number, says of what is left."""
        each = AT_EDGES if self.edges else FASTEST
        since = range(mesh + 1, len(self.steps))
        least = float(np.prod([max(each, self._fastest_of_step(k)) for k in since]))
        most = float(np.prod([AT_DEGREE if self.raised.get(k, 0.0) > MOST_RAISED else 1.0 for k in since]))
        most = max(min(most, SLOWEST), least)
        fall = float(np.clip(self.estimates[-1] / max(self.estimates[mesh], 1e-300), least, most))
        return MARGIN * abs(after - before) * fall / (1.0 - fall)

    def _deviation_alone(self, method: Method, options: Options, settings: Mapping[str, Any]) -> bool:
        """Whether one mesh alone is good enough for a deviation, too: of that no estimate is made, and it is
        taken for little worse than a bound of the error of the mean."""
        assert self.result is not None and self.share is not None and isinstance(self.quantity, Resultant)
        assert self.problem is not None
        try:
            self.chaos = self._chaos_on(self.problem, method, options, settings)
            self._leave_room_for_fields(self.chaos)
        except SceneError as error:
            self.notes.append(f"the deviation is not compared over meshes: {str(error).splitlines()[0]}")
            return True
        std = self.chaos.mean_std(self.quantity).std or 0.0
        of_std = max(self.said, OF_DEVIATION * self.sure)
        self.share = replace(self.share, std=of_std * std)
        self.said = max(self.said, of_std)
        self.steps[-1] = self.steps[-1]._replace(error=self.said)
        return self.said <= self.target

    def _leave_room_for_fields(self, chaos: ChaosResult) -> None:
        """What the modes that random fields leave out do on a mesh is no error of it: the meshes may use what
        that leaves of the accuracy. Where it is little on the first mesh, it is not asked of others."""
        little = self.lost is not None and self.target == self.of_meshes
        if little or not chaos.random.of_fields or self.lost_on(chaos.problem) is not None:
            return
        assert isinstance(self.quantity, Resultant)
        value = chaos.mean_std(self.quantity)
        model = QuantityModel.of_chaos(chaos, self.quantity)
        about = value._replace(std=max(value.std or 0.0, self._least(1e-9)))
        rtol = tolerance_of(model, self.accuracy, about)
        full = model.full_fields()
        found = None if full is None else lost_of_fields(model, full, rtol, value, self.accuracy)
        if found is None or not isfinite(found.largest):
            return
        self.lost = chaos.problem, found
        if found.largest > LITTLE * self.of_meshes:
            self.target = beside_fields(self.of_meshes, found)

    def lost_on(self, problem: Problem) -> Lost | None:
        """What the modes that random fields leave out do, as it was measured on these meshes or on others
        whose modes have as much of the variance; None: it was not."""
        if self.lost is None or self.lost[0] is problem:
            return None if self.lost is None else self.lost[1]
        before, now = (RandomLaws.of(each).lost for each in (self.lost[0], problem))
        alike = before.keys() == now.keys()
        if not (alike and all(abs(now[name] - before[name]) <= AS_MUCH * now[name] for name in now)):
            return None
        return self.lost[1]._replace(of=f"{self.lost[1].of}, on other meshes")

    def _first_chaos(
        self, problem: Problem, method: Method, options: Options, settings: Mapping[str, Any]
    ) -> ChaosResult:
        """The chaos of order 1 on some meshes, on the factors of the answer at the means if it has these."""
        if self.result is not None and self.result.problem is problem and self.result.converged:
            given = {name: each for name, each in settings.items() if name != "active"}
            order = Chaos(order=1, check_points=0)
            found = chaos_on(self.result, order, method, options=options, progress=self.shown, **given)
            if found is not None:
                complete(found)
                return found
        active = self._kept(problem, settings)
        chaos = solve_chaos(
            problem,
            Chaos(order=1, check_points=0),
            method,
            options=options,
            progress=self.shown,
            estimator=errors,
            **{**settings, "active": active},
        )
        complete(chaos)
        return chaos

    def _kept(self, problem: Problem, settings: Mapping[str, Any]) -> Any:
        """Interfaces that are kept besides what is random."""
        assert isinstance(self.quantity, Resultant)
        active = settings.get("active")
        if active is None and self.quantity.interface not in RandomLaws.of(problem).interfaces:
            return [self.quantity.interface]
        return active


def _acting(random: RandomLaws, scores: Mapping[str, float]) -> dict[str, Any]:
    """Values of random loads where some germs have these normal scores, all others their medians: of fields
    at the points of these meshes."""
    u = np.full((1, random.space.dimension), 0.5)
    for column, name in enumerate(random.space.germ_names):
        u[0, column] = special.ndtr(scores.get(name, 0.0))
    return values_of(random, random.space.from_uniform(u))
