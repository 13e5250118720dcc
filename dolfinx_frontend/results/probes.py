"""Displacement and stress at a point of a part, and reactions, as quantities of interest."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from dolfinx import fem

from dolfinx_frontend.assembly.places import Place, place_of
from dolfinx_frontend.assembly.problem import Problem, check_is_problem
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.checks import check_known, checked_numbers, checked_word
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.results.answer import Answer, Block
from dolfinx_frontend.results.reactions import Reaction, reaction
from dolfinx_frontend.results.stress import von_mises

__all__ = ["AtPoint", "reaction_of"]

_AXES = "xyz"


class AtPoint:
    """A number at a point of a part: ``result.quantity(AtPoint(problem, "plate", (0, 0, 5), "stress",
    "zz"))``.

    Parameters
    ----------
    problem
        The assembled scene; the part is on this rank.
    part, point
        Its name, and d coordinates inside it or on its surface.
    of
        ``"displacement"`` (length) or ``"stress"`` (force / area, initial strains taken out; in the cell
        that the point was found in).
    component
        Of the displacement ``"x"``, ``"y"``, ``"z"``; of the stress ``"xx"``, ``"xy"``, ... and ``"mises"``
        (in 3D and of axisymmetric parts, where ``"zz"`` is the hoop stress, x the radius and y the axis).
    step
        Of a load history; the last by default.

    Raises
    ------
    SceneError
        A point outside, a component that there is not, a material that gives no stress.
    """

    def __init__(
        self,
        problem: Problem,
        part: str,
        point: Sequence[float],
        of: str = "displacement",
        component: str = "x",
        step: int = -1,
    ) -> None:
        check_is_problem("AtPoint", problem)
        check_known("substructure", part, problem.substructures, "AtPoint")
        self.problem, self.part, self.step = problem, part, step
        self._s = problem.substructures[part]
        where = f"AtPoint of {part!r}"
        wanted = f"give {self._s.dim} numbers"
        self.point = checked_numbers(where, "point", point, wanted, dimensions=1).copy()
        if self.point.shape != (self._s.dim,):
            raise SceneError(f"{where}: point = {short(point)}; give {self._s.dim} numbers")
        self.of = checked_word(where, "of", of, ("displacement", "stress"))
        self.component = component
        n = 3 if self._s.around else self._s.dim
        if of == "displacement":
            known = list(_AXES[: self._s.dim])
        else:
            known = [a + b for a in _AXES[:n] for b in _AXES[:n]] + (["mises"] if n == 3 else [])
            problem.check_sources(part)
            if getattr(self._s.material, "stress", None) is None:
                raise SceneError(
                    f"{where}: its material is a form that gives no stress: give one with a method stress(u)"
                )
        check_known("component", component, known, where)
        self._place: Place = place_of(where, self._s.part.mesh, self._s.space, self.point)

    def __repr__(self) -> str:
        return f"AtPoint({self.part!r}, {self.point.tolist()}, {self.of} {self.component})"

    def on(self, problem: object) -> AtPoint:
        """The same of another assembled problem: on other meshes the point is looked for again."""
        parts = getattr(problem, "substructures", {})
        if problem is self.problem or not isinstance(problem, Problem) or self.part not in parts:
            return self
        return AtPoint(problem, self.part, [float(x) for x in self.point], self.of, self.component, self.step)

    @property
    def _unknowns(self) -> Ints:
        d = self._s.dim
        unknowns: Ints = (d * self._place.nodes[:, None] + np.arange(d)).ravel()
        return unknowns

    def _evaluated(self, stress: Any) -> Array:
        """A stress, UFL, at the point, (d * d,)."""
        expression = fem.Expression(stress, self._place.reference[None])
        cells = np.array([self._place.cell], dtype=np.int32)
        return np.asarray(expression.eval(self._s.part.mesh, cells)).ravel()

    @cached_property
    def _rows(self) -> Array:
        """(components, unknowns of the cell): the stress at the point."""
        u = fem.Function(self._s.space)
        expression = fem.Expression(self._s.material.stress(u), self._place.reference[None])
        cells = np.array([self._place.cell], dtype=np.int32)
        rows = []
        for unknown in self._unknowns:
            u.x.array[unknown] = 1.0
            rows.append(np.asarray(expression.eval(self._s.part.mesh, cells)).ravel())
            u.x.array[unknown] = 0.0
        return np.array(rows).T

    @cached_property
    def _initial(self) -> list[tuple[str, str, Array]]:
        found = self.problem.initial_stresses(self.part)
        return [(load, parameter, self._evaluated(stress)) for load, parameter, stress in found]

    def __call__(self, block: Block) -> Array:
        """The number in the samples of a block, (n,)."""
        u = block.displacement(self.part, self._unknowns)
        steps = u.ndim == 3
        u = u[:, self.step] if steps else u
        if self.of == "displacement":
            shaped = u.reshape(len(u), -1, self._s.dim)[:, :, _AXES.index(self.component)]
            return np.asarray(shaped @ self._place.shape)
        stress = u @ self._rows.T
        for load, parameter, initial in self._initial:
            number = block.load(load, parameter)
            number = number[:, self.step] if steps else number
            stress = stress - np.broadcast_to(number, (len(u),))[:, None] * initial
        factor = block.factor(self.part)
        stress = (factor[:, None] if factor.ndim == 1 else factor[:, [self._place.cell]]) * stress
        n = round(stress.shape[1] ** 0.5)
        tensor = stress.reshape(-1, n, n)
        if self.component == "mises":
            return von_mises(tensor)
        i, j = (_AXES.index(a) for a in self.component)
        return np.asarray(tensor[:, i, j])


def reaction_of(answer: Answer, interface: str, component: str, step: int = -1) -> Callable[[Block], Array]:
    """The total force that a support or glued face exerts on its first side, as a function of samples.

    Collective, and so is the function.

    Raises
    ------
    SceneError
        Other interfaces hold the same nodes, or its force is known at its points (a :class:`Resultant` has
        it).
    """
    check_known("interface", interface, answer.problem.interfaces, "reaction")
    check_known("component", component, _AXES[: answer.problem.dim], "reaction")
    if interface in answer.known:
        raise SceneError(
            f"reaction: the force of {interface!r} is known at its points: take Resultant({interface!r}) or "
            "its row in "
            "the table"
        )
    held: list[Reaction] = []  # on the rank of the parts

    def is_held() -> bool:
        held.extend(filter(None, [reaction(answer, interface)]))
        return bool(held)

    if not answer.everywhere(interface, is_held):
        raise SceneError(
            f"reaction: other interfaces hold the nodes of {interface!r} in the same directions; their "
            "forces cannot "
            f"be told apart: solve with active=[{interface!r}], or ask for the sum in the table of another "
            "face"
        )
    axis = _AXES.index(component)

    def total(block: Block) -> Array:
        def read() -> Array:
            return np.asarray(held[0].forces(block)[:, step, :, axis].sum(axis=-1))

        return np.asarray(answer.everywhere(interface, read))

    return total
