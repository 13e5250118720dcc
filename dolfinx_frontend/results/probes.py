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

    @property
    def place(self) -> Place:
        """Where the point is in the mesh."""
        return self._place

    def slopes(self, block: Block) -> tuple[Ints, Array]:
        """Unknowns (k,) of the cell, and the derivatives (k,) of the number by them at one sample."""
        if self.of == "displacement":
            rows = np.zeros((len(self._place.nodes), self._s.dim))
            rows[:, _AXES.index(self.component)] = self._place.shape
            return self._unknowns, rows.ravel()
        tensor, factor = (each[0] for each in self._tensors(block))
        along = np.zeros_like(tensor)
        if self.component == "mises":
            deviator = tensor - np.trace(tensor) / 3.0 * np.eye(3)
            along = 1.5 * deviator / max(float(von_mises(tensor[None])[0]), 1e-300)
        else:
            along[tuple(_AXES.index(a) for a in self.component)] = 1.0
        return self._unknowns, factor * (along.ravel() @ self._rows)

    def moved(self, u: Array, gradient: Array) -> Array:
        """Unknowns (k,) of the cell for those (n,) of the part, with the same displacement at the point and
        another gradient (d, d) everywhere."""
        nodes = self._s.space.tabulate_dof_coordinates()[self._place.nodes, : self._s.dim]
        there = self._place.shape @ u.reshape(-1, self._s.dim)[self._place.nodes]
        return np.asarray(there + (nodes - self.point) @ gradient.T).ravel()

    def __call__(self, block: Block) -> Array:
        """The number in the samples of a block, (n,)."""
        if self.of == "displacement":
            u = self._read(block).reshape(-1, len(self._place.nodes), self._s.dim)
            return np.asarray(u[:, :, _AXES.index(self.component)] @ self._place.shape)
        tensor, _ = self._tensors(block)
        if self.component == "mises":
            return von_mises(tensor)
        i, j = (_AXES.index(a) for a in self.component)
        return np.asarray(tensor[:, i, j])

    def _read(self, block: Block) -> Array:
        """Unknowns of the cell (n, k)."""
        u = block.displacement(self.part, self._unknowns)
        return u[:, self.step] if u.ndim == 3 else u

    def _tensors(self, block: Block) -> tuple[Array, Array]:
        """Stresses (n, d, d), and what the stiffness is multiplied with there, (n,)."""
        u = self._read(block)
        stress = u @ self._rows.T
        for load, parameter, initial in self._initial:
            number = block.load(load, parameter)
            number = number[:, self.step] if number.ndim == 2 else number
            stress = stress - np.broadcast_to(number, (len(u),))[:, None] * initial
        factor = block.factor(self.part)
        factor = factor if factor.ndim == 1 else factor[:, self._place.cell]
        n = round(stress.shape[1] ** 0.5)
        return (factor[:, None] * stress).reshape(-1, n, n), factor


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
