"""An event of an assembly in the space of independent standard normal variables."""

from __future__ import annotations

import numpy as np

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.evaluate.events import Event
from dolfinx_frontend.evaluate.function import ProblemFunction, problem_function
from dolfinx_frontend.rare.design import LOST, Cut
from dolfinx_frontend.uncertainty.fields import DiscretisedField

__all__ = ["ProblemLimit"]

MOST_LOST = 0.05
"""Share of points that do not converge from which on nothing can be said."""
SOME = 100


class ProblemLimit:
    """The conditions of an event, solved where they are asked for.

    Attributes
    ----------
    event, function
        What happens, and its conditions as a function of standard normal scores.
    lost
        Samples that did not converge: the event is taken to happen there.
    points, slopes_made
        Points and derivatives that were asked for.
    """

    def __init__(self, problem: Problem, event: Event, **settings: object) -> None:
        self.event = event
        names = {f"condition {k + 1}": each for k, each in enumerate(event.conditions)}
        self.function: ProblemFunction = problem_function(
            problem, names, None, coordinates="normal", **settings  # type: ignore[arg-type]
        )
        self.lost = 0
        self.places: set[str] = set()
        self.points = 0
        self.slopes_made = 0
        self.kinks = 0

    @property
    def differentiable(self) -> bool:
        """Whether derivatives can be had: on any number of ranks."""
        return True

    @property
    def dimension(self) -> int:
        """Germs."""
        return self.function.dimension

    @property
    def cuts(self) -> tuple[Cut, ...]:
        """Of the event."""
        return self.event.cuts

    def margins(self, u: Array) -> Array:
        """The conditions (N, k) at scores (N, L), negative where they hold."""
        found = self.function.evaluate(u)
        self.points += len(u)
        good = found.converged
        values = found.values
        if not np.all(np.isfinite(values[good])):
            row, column = np.argwhere(good[:, None] & ~np.isfinite(values))[0]
            raise SceneError(
                f"reliability: event {self.event.name} is {values[row, column]:g} at {self.where(u[row])}: "
                "let its "
                "quantities be finite wherever the random numbers can be"
            )
        values[~good] = LOST
        if not good.all() and len(u) > 1:  # a search, point by point, keeps away
            self.lost += int((~good).sum())
            self.places |= {str(each) for each in found.places[~good] if each}
            if self.lost > max(MOST_LOST * self.points, 5):
                raise SceneError(
                    f"reliability: {self.lost} of {self.points} points did not converge"
                    + (f" (in {', '.join(sorted(self.places)[:3])})" if self.places else "")
                    + f", the last at {self.where(u[np.flatnonzero(~good)[-1]])}: raise "
                    "options=Options(max_iterations=...) or lower rtol"
                )
        return values

    def slopes(self, u: Array) -> Array:
        """Derivatives (k, L) of the conditions at scores (L,); NaN where the solve did not converge."""
        if not self.function.evaluate(u[None]).converged[0]:
            return np.full((len(self.event.conditions), self.dimension), np.nan)
        found = self.function.derivatives(u)
        self.slopes_made += 1
        self.kinks += int(found.kinks.any())
        return found.values

    def values(self, u: Array) -> dict[str, float]:
        """The random numbers at scores (L,)."""
        found = self.function._inputs.values(u[None])
        return {name: float(value[0]) for name, value in found.items()}

    def where(self, u: Array) -> str:
        """The same in words."""
        shown = [f"{name} = {value:.6g}" for name, value in self.values(u).items()]
        space = self.function._inputs.random.space
        shown += [
            f"field {name}" for name in space.names if isinstance(space._sources[name], DiscretisedField)
        ]
        return ", ".join(shown)

    def importance(self, alpha: Array) -> dict[str, float]:
        """Random source -> share of the squared distance of a design point, sum 1."""
        space = self.function._inputs.random.space
        return {name: float(np.sum(alpha[list(columns)] ** 2)) for name, columns in space.groups.items()}
