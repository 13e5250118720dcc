"""Meshes that follow the question: a scene solved to an accuracy, its meshes included.

Solve, estimate where the error of the meshes is from (recovery, weighted with the dual solution of the
quantity), give new meshes to the parts that decide, and go on: only these are assembled and factorised again.
What is random is at its mean meanwhile; the last meshes then get what is left of the accuracy.

Two witnesses say how large the error of the meshes is: the estimate, and by how much the answer changed from
mesh to mesh. The larger one is believed, and one mesh alone only if its estimate without cancellation does.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import replace
from math import isfinite
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from latin_core import Options

from dolfinx_frontend.assembly.assemble import assemble, assembled_again, placed
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import agreement, check_alike, exchanged, own_communicator
from dolfinx_frontend.common.checks import check_optional_kind, checked_number, checked_whole, is_real
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import BalanceError, SceneError
from dolfinx_frontend.common.interrupts import Interrupted
from dolfinx_frontend.estimate.adaptive import (
    as_solved,
    kept_for,
    so_far,
    solve_to_accuracy,
    tight_enough,
    with_errors,
)
from dolfinx_frontend.estimate.cells import cells_of
from dolfinx_frontend.estimate.errors import compared_with, why_stopped
from dolfinx_frontend.estimate.finer import finer
from dolfinx_frontend.estimate.judged import MARGIN, Judged
from dolfinx_frontend.estimate.unseen import one_cell_across
from dolfinx_frontend.estimate.zones import soft_springs
from dolfinx_frontend.plan.plan import Direction, Method
from dolfinx_frontend.plan.random_laws import RandomLaws
from dolfinx_frontend.results.result import Result
from dolfinx_frontend.results.resultant import Interest, interest
from dolfinx_frontend.results.samples import SampleResult
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.scene.specs import SubstructureSpec
from dolfinx_frontend.uncertainty.statistics import FINEST, Compared, ErrorShare

__all__ = ["solve_scene"]

_log = logging.getLogger(__name__)

OF_MESHES, OF_MESHES_RANDOM = 0.95, 0.8
"""Shares of an accuracy that the meshes may use, which cost most; and where points answer what is random:
with a kink the next digit costs them more than a finer mesh."""

OF_ITERATION = 0.02
"""Tolerance of the runs on the way, relative to the accuracy: changes must be those of the meshes."""

FALL = 0.1
"""Factor by which the error is to fall in one step at most."""

AIM = 0.36
"""What a step aims at, relative to what the meshes may leave: one more step costs more than a finer one."""

LOST = 1e-5
"""Share of a face that its new mesh does not cover any more, of which it is told."""

MATTERS = 0.2
"""Share of what the meshes may use from which on what is in no stress gets smaller cells."""

WORTH_IT = 1.2
"""Unknowns of the next meshes over those before, below which a budget ends the search."""

MOST_TRIES, HALF = 4, 0.5
"""Finer meshes that are tried at most where nothing balances the loads, and their cells beside contacts,
relative to those before."""

STEPS = 12

MOST_UNKNOWNS = 400_000


def solve_scene(
    scene: Scene,
    accuracy: float,
    quantity: Interest = None,
    method: Method = "auto",
    *,
    times: npt.ArrayLike | None = None,
    active: Sequence[str] | Literal["all"] | None = None,
    direction: Direction | float | None = None,
    options: Options | None = None,
    max_unknowns: int | None = None,
    max_seconds: float | None = None,
    progress: bool = True,
    compared: Compared | None = None,
    comm: Any = None,
) -> Result | SampleResult:
    """Solve a scene until the error of a quantity is at most `accuracy`, that of its meshes included.

    Parameters
    ----------
    scene
        Its parts get finer meshes where these decide; the scene itself stays as it is.
    accuracy, quantity, method, times, active, direction, options
        As for :func:`dolfinx_frontend.estimate.adaptive.solve_to_accuracy`.
    max_unknowns
        Most unknowns of all parts; None: 400 000.
    max_seconds
        No new mesh that would take longer in all, as far as the last ones tell, and once there is an answer
        everything ends then, as with Ctrl-C; None: no limit.
    progress
        A line for each mesh, if on a terminal.
    compared
        What errors are relative to; None: as the quantity says.
    comm
        mpi4py communicator over which the parts are spread, as for :func:`assemble`; collective. A part is
        meshed again on its rank, which it has from the beginning.

    Returns
    -------
    Result
        On the last meshes, ``result.problem``. ``result.errors()`` has all errors, where those of the meshes
        are from, and the meshes on the way; its notes say what could not be reached, and why.
    """
    if not is_real(accuracy) or not 1e-10 <= accuracy <= 0.5:
        raise SceneError(f"accuracy = {short(accuracy)}: it must lie in 1e-10..0.5")
    check_optional_kind("solve", "options", options, Options, "give Options(rtol=...)")
    if max_unknowns is not None:
        checked_whole("solve", "max_unknowns", max_unknowns, 1)
    if max_seconds is not None:
        checked_number("solve", "max_seconds", max_seconds, above=0.0)
    if comm is not None and comm.size > 1:
        given = {"accuracy": accuracy, "quantity": quantity, "method": method, "compared": compared}
        budget = {"max_unknowns": max_unknowns, "max_seconds": max_seconds}
        settings = {"times": times, "active": active, "direction": direction, "options": options}
        check_alike(own_communicator(comm), "solve", given | budget | settings)
    search = _Meshes(scene, accuracy, quantity, max_unknowns or MOST_UNKNOWNS, max_seconds, progress, comm)
    search.compared = compared
    return search.answer(method, times=times, active=active, direction=direction, options=options)


class _Meshes(Judged):
    """The search for meshes."""

    def answer(self, method: Method, **settings: Any) -> Result | SampleResult:
        """The answer on meshes that fit; after Ctrl-C the last one that there is."""
        with self.run:
            try:
                found = self._answer(method, settings)
            except Interrupted:
                if self.answered is None:
                    raise
                found = self._so_far(*self.answered)
        self._budgets_that_were_exceeded()
        made = found.errors()
        steps, notes = tuple(self.steps), (*self.notes, *made.notes)
        return found.with_notes(found=replace(made, places=self.places, steps=steps, notes=notes))

    def _answer(self, method: Method, settings: Mapping[str, Any]) -> Result | SampleResult:
        options = self._adapt(method, **settings)
        self._not_confirmed()
        problem = self.problem
        assert self.result is not None and problem is not None
        if not RandomLaws.of(problem).every:
            return tight_enough(self.result, self.accuracy, self.quantity, known=self.share)
        known: Result | SampleResult | None = self._of_points(method, options, settings)
        return known or solve_to_accuracy(
            problem,
            self.accuracy,
            self.quantity,
            method,
            known=self._of_random(),
            first=self.chaos if self.chaos is not None and self.chaos.problem is problem else None,
            lost=self.lost_on(problem),
            **settings,
        )

    def _so_far(self, result: Result, share: ErrorShare) -> Result | SampleResult:
        """The last mesh that is measured: points, a chaos, or the answer at the means of what is random."""
        same = result is self.result and self.share is not None
        self.share = self.share if same else share  # which may know of the deviation, too
        known = self._of_random()
        assert known is not None
        problem = self.problem if same else None
        notes: tuple[str, ...] = (why_stopped(),)
        if self.fine is not None and self.fine.samples.problem is problem:
            made = self.fine.made
            return with_errors(self.fine.samples, made, self.accuracy, known, (*made.notes, *notes))
        if self.chaos is not None and self.chaos.problem is problem:
            return so_far(self.chaos, self.accuracy, self.quantity, known)
        made = as_solved(result, self.quantity)
        if self.random:
            at = "the means of what is random"
            if self.acting:
                values = [f"{k} = {v:.4g}" for k, v in self.acting.items() if isinstance(v, float)]
                at = ", ".join(values) or "other values of random loads"
            notes += (f"the scatter is not computed: the answer is that at {at}",)
            nan = None if self.quantity is None else np.nan
            made = replace(made, truncation=ErrorShare(np.nan, nan, None, "the scatter is not computed"))
        return with_errors(result, made, self.accuracy, self.share, notes)

    def _budgets_that_were_exceeded(self) -> None:
        """A word of what the first meshes take more than a budget: they are solved on in any case."""
        assert self.problem is not None
        if len(self.steps) == 1 and self.steps[0].unknowns > self.max_unknowns:
            self.notes.append(
                f"the first meshes have {self.steps[0].unknowns} unknowns, more than the budget of "
                f"{self.max_unknowns}; give coarser ones, or max_unknowns="
            )
        spent = self._spent()
        if self.max_seconds is not None and spent > self.max_seconds:
            if not any(f"budget of {self.max_seconds:g} s" in note for note in self.notes):
                self.notes.append(
                    f"it took {spent:.3g} s, more than the budget of {self.max_seconds:g} s: a mesh that "
                    "was begun, or the first answer, ends first"
                )

    def _of_points(
        self, method: Method, options: Options, settings: Mapping[str, Any]
    ) -> SampleResult | None:
        """The points of the last mesh, if few of them are enough; of linear laws its chaos is kept."""
        if self.fine is None or self.fine.samples.problem is not self.problem:
            # a budget has ended the search for meshes
            measured = self.chaos is not None and self.chaos.problem is self.problem
            if self.before is None or self.given_up or measured:
                return None
            others = {name: value for name, value in settings.items() if name != "options"}
            self._deviation_fits(method, options, others)
        if self.fine is None or self.fine.samples.problem is not self.problem:
            return None
        made = self.fine.made
        return with_errors(self.fine.samples, made, self.accuracy, self._of_random(), made.notes)

    def _of_random(self) -> ErrorShare | None:
        """The error of the meshes, for an answer with a deviation."""
        share = self.share
        if share is None:
            return None
        where = "at the means and mode by mode" if self.by_modes else "at the means of what is random"
        if self.acting:
            where = "where random loads are one deviation off their means"
        return replace(share, how=f"{share.how}, {where}")

    def _adapt(self, method: Method, **settings: Any) -> Options:
        """Solve on finer and finer meshes; returns the options of the way."""
        self._make_parts()
        problem = assemble(self.scene, comm=self.comm)
        for name, joint in self.scene.interfaces.items():
            if joint.space == "points" and len(joint.faces) == 2 and joint.law.rigid:
                # which asks for meshes that match, and these may not any more
                self.scene.interfaces[name] = replace(joint, space="auto")
        soft = soft_springs(self.scene, problem, cells_of(problem))
        for name in soft:
            self.scene.interfaces[name] = replace(self.scene.interfaces[name], space="points")
        if any(problem.interfaces[name].space != "points" for name in soft):
            others = {name: each for name, each in problem.interfaces.items() if name not in soft}
            problem = assembled_again(self.scene, replace(problem, interfaces=others), comm=self.comm)
        self.quantity = compared_with(interest(problem.interfaces, self.asked_for), self.compared)
        settings["active"] = kept_for(self.quantity, method, settings["active"])
        self.random = bool(RandomLaws.of(problem).every)
        self.first = problem
        curved = any(not each.law.linear for each in problem.interfaces.values())
        self.of_meshes = (OF_MESHES_RANDOM if self.random and curved else OF_MESHES) * self.accuracy
        self.target = self.of_meshes
        self.plain = settings["options"] is None
        options = settings.pop("options") or (Options.plain() if method == "latin" else Options())
        options = options.with_(rtol=max(OF_ITERATION * self.accuracy, FINEST))
        changed: dict[str, str] = {}
        tries = 0
        while True:
            try:
                self._solve(problem, changed, method, options=options, **settings)
            except SceneError as error:
                lost = isinstance(error, BalanceError)
                if problem.comm is not None:  # which the first rank finds
                    lost = any(exchanged(problem.comm, lost))
                if not lost:
                    raise
                tries += 1
                if tries <= MOST_TRIES:
                    problem = self._wider_support(problem)
                    continue
                if self.result is None:
                    raise
                self._go_back(problem)
                return options
            if self._fits() and (
                not self.random or self.given_up or self._deviation_fits(method, options, settings)
            ):
                return options
            following = self._finer(problem)
            if following is None:
                self._one_mesh_alone()
                return options
            scene, changed = following
            together = self._assembled(scene, changed, problem)
            if together is None:
                return options
            self.before, (self.scene, problem) = problem, together

    def _wider_support(self, problem: Problem) -> Problem:
        """The same meshes with smaller cells beside contacts, whose points reach closer to the rims of their
        faces then: a part that is about to tip has lost its support on coarse ones, and with a higher degree
        on the same cells."""
        contacts = {n: i.points for n, i in problem.interfaces.items() if i.law.unilateral}
        nothing = {name: np.zeros(len(each.sizes)) for name, each in self.meshes.items()}
        found = finer(self.scene, problem, self.meshes, nothing, HALF, contacts, most=self.max_unknowns)
        self.scene = copy(self.scene)
        self.scene.substructures.update(found.specs)
        wider = assembled_again(self.scene, problem, comm=self.comm)
        if not self.steps:
            self.first = wider
        return wider

    def _go_back(self, problem: Problem) -> None:
        """End the search on the meshes before those on which nothing balances the loads."""
        assert self.result is not None
        self.notes.append(
            f"on the next meshes, of {sum(problem.unknowns.values())} unknowns, no forces of the interfaces "
            "balance the loads: a part is about to lose its support; give finer cells beside its contacts"
        )
        self.given_up = True
        self.problem = self.result.problem
        self.meshes = cells_of(self.problem)

    def _make_parts(self) -> None:
        """Make the parts of this rank, which keeps them."""
        spread = self.comm if self.comm is not None and self.comm.size > 1 else None
        ranks = None if spread is None else own_communicator(spread)
        owner = placed(self.scene, spread)
        with agreement(ranks):
            for name, spec in self.scene.substructures.items():
                here = ranks is None or owner[name] == ranks.rank or spec.spread
                spec = _seen_across(spec.made()) if here else spec.made_elsewhere()
                if ranks is not None:
                    spec = replace(spec, rank=owner[name])
                self.scene.substructures[name] = spec

    def _assembled(
        self, scene: Scene, changed: Mapping[str, str], before: Problem
    ) -> tuple[Scene, Problem] | None:
        """The next meshes put together; None: they do not fit, and a note says why.

        Two meshes of one round face cover each other but for what lies between their chords: that stays free.
        """
        try:
            return scene, assembled_again(scene, before, comm=self.comm)
        except SceneError as error:
            _log.info("the faces of the next meshes may overlap partly: %s", error)
        for name, joint in scene.interfaces.items():
            touched = any(face.substructure in changed for face in joint.faces)
            if touched and len(joint.faces) == 2 and joint.remote is None:
                space = "auto" if joint.space == "points" else joint.space
                scene.interfaces[name] = replace(joint, space=space, overlap="partial")
        try:
            problem = assembled_again(scene, before, comm=self.comm)
        except SceneError as error:
            said = str(error).splitlines()[0]
            if before.comm is not None:  # the error of one rank, of which the others know by its message
                said = min(exchanged(before.comm, said), key=len)
            self.notes.append(f"the next meshes do not fit together: {said}")
            return None
        for name, interface in problem.interfaces.items():
            lost = before.interfaces[name].covered - interface.covered
            if lost > LOST:
                where = f"interface {name!r}"
                self.stays[where] = self.stays.get(where, 0.0) + lost
                self.notes.append(
                    f"{where}: two meshes of its round faces do not cover each other; the {100 * lost:.2g} % "
                    "that are left are free, and count as that much of an error"
                )
        return scene, problem

    def _finer(self, problem: Problem) -> tuple[Scene, dict[str, str]] | None:
        """The scene with its next meshes, and what was changed; None: it ends, and a note says why."""
        if len(self.steps) >= STEPS:
            self.notes.append(f"no answer fitted after {STEPS} meshes")
            return None
        said = self.said if isfinite(self.said) and self.said > 0.0 else np.inf
        fall = float(np.clip(AIM * self.target / said, FALL, 0.5))
        if len(self.steps) > 1 and MARGIN * self.estimates[-1] <= AIM * self.target:
            fall = 0.5  # one more mesh confirms it, if only the change to this one says otherwise
        if self.quantity is None:
            fall *= fall  # squares of the energy norm
        large = [name for name, each in self.unseen.items() if each > MATTERS * self.target]
        unseen = {n for n in self.scene.substructures if f"part {n!r}" in large}
        unseen |= set(self._of_chords() if len(self.steps) == 1 else [])
        means = [n for n in self.scene.interfaces if f"interface {n!r}" in large]
        unknowns = problem.unknowns
        now, first = sum(unknowns.values()), 0
        for milder in (1.0, 0.5, 0.25):  # what the budget leaves
            step = fall**milder
            most = self.max_unknowns
            found = finer(
                self.scene,
                problem,
                self.meshes,
                self.cells,
                step,
                self.edges,
                unseen,
                means,
                most,
                self.read,
                self.to_cut(),
                self.weighted,
            )
            size = int(sum(each * found.growth.get(name, 1.0) for name, each in unknowns.items()))
            size = max(size, int(found.too_large))
            first = first or size
            if size <= most:
                break
        for name, why in found.stuck.items():
            note = f"part {name!r} keeps its mesh: {why}"
            if note not in self.notes:
                self.notes.append(note)
        if not found.specs and not found.too_large:
            self.notes.append("no part can get a finer mesh")
            return None
        # what is left of a budget may change little
        if size > self.max_unknowns or (milder < 1.0 and size < WORTH_IT * now):
            self.notes.append(
                f"the budget of {self.max_unknowns} unknowns ends it: the next meshes would have about "
                f"{first}; give max_unknowns="
            )
            return None
        if self.max_seconds is not None:
            spent = self._spent()
            last = spent - (self.steps[-2].seconds if len(self.steps) > 1 else 0.0)
            wanted = spent + last * (size / now) ** 1.5
            if wanted > self.max_seconds:
                self.notes.append(
                    f"the budget of {self.max_seconds:g} s ends it: {spent:.3g} s are spent, the next meshes "
                    f"would make it about {wanted:.3g} s; give max_seconds="
                )
                return None
        scene = copy(self.scene)
        scene.substructures.update(found.specs)
        return scene, dict(found.how)


def _seen_across(spec: SubstructureSpec) -> SubstructureSpec:
    """A part, of degree 2 if it is a wall of revolution of one linear cell across."""
    if not spec.axisymmetric or spec.degree != 1 or spec.spread:
        return spec
    return replace(spec, degree=2) if one_cell_across(spec.part.mesh) else spec
