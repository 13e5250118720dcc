"""Displacement and stress at a point of a part, and reactions, as quantities of interest."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from dolfinx import fem

from dolfinx_frontend.assembly.places import Place, place_in, place_on_ranks
from dolfinx_frontend.assembly.problem import Problem, check_is_problem
from dolfinx_frontend.assembly.ranks import agreement, one_call
from dolfinx_frontend.assembly.spread import Condensed
from dolfinx_frontend.assembly.substructure import Substructure
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

    Collective on several ranks, and so is a quantity of it: all ranks make it alike, whoever has the part,
    and all get its value.

    Parameters
    ----------
    problem
        The assembled scene.
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
        A point outside, a component that there is not, a material that gives no stress; on all ranks.
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
        with one_call(problem.comm, "AtPoint"):
            check_known("substructure", part, problem.parts, "AtPoint")
            self.problem, self.part, self.step = problem, part, step
            where, dim = f"AtPoint of {part!r}", problem.parts[part].dim
            wanted = f"give {dim} numbers"
            self.point = checked_numbers(where, "point", point, wanted, dimensions=1).copy()
            if self.point.shape != (dim,):
                raise SceneError(f"{where}: point = {short(point)}; give {dim} numbers")
            self.of = checked_word(where, "of", of, ("displacement", "stress"))
            self.component = component
            n = 3 if problem.parts[part].around else dim
            if of == "displacement":
                known = list(_AXES[:dim])
            else:
                known = [a + b for a in _AXES[:n] for b in _AXES[:n]] + (["mises"] if n == 3 else [])
            check_known("component", component, known, where)
            picked = list(range(n * n)) if component == "mises" else [known.index(component)]
            problem.check_alike("AtPoint", point=self._definition)
            self._place: Place | None = None
            self._inside: Array | None = None
            self._rows = self._found(where, picked)

    def __repr__(self) -> str:
        return f"AtPoint({self.part!r}, {self.point.tolist()}, {self.of} {self.component})"

    @property
    def _definition(self) -> tuple[object, ...]:
        """What makes two of them the same, whatever rank they are on."""
        return self.part, tuple(float(x) for x in self.point), self.of, self.component, self.step

    def on(self, problem: object) -> AtPoint:
        """The same of another assembled problem: on other meshes the point is looked for again."""
        if problem is self.problem or not isinstance(problem, Problem) or self.part not in problem.parts:
            return self
        here = problem.substructures.get(self.part)
        if here is not None and here.part is None:  # it was gathered from ranks: the unknowns are the same
            return self
        return AtPoint(problem, self.part, [float(x) for x in self.point], self.of, self.component, self.step)

    def _found(self, where: str, picked: Sequence[int]) -> _Rows:
        """What the number is made of, on all ranks."""
        problem, part = self.problem, self.part
        whole = problem.spread.get(part)
        if whole is not None:
            return self._found_on_ranks(where, picked, whole)
        comm, found = problem.comm, None
        with agreement(comm):
            if part in problem.substructures:
                s = problem.substructures[part]
                place = self._place = place_in(where, s, self.point)
                loads: list[tuple[str, str, Array]] = []
                if self.of == "stress":
                    problem.check_sources(part)
                    initial = problem.initial_stresses(part)
                    loads = [(a, b, _at(s, stress, place, True)[picked]) for a, b, stress in initial]
                rows = self._cell_rows(where, s, place, True)[picked]
                found = _Rows(_unknowns(place, s.dim), rows, place.cell, loads)
        if problem.distribution is None:
            assert found is not None
            return found
        shared: _Rows = comm.bcast(found, root=problem.distribution.owner[part])
        return shared

    def _found_on_ranks(self, where: str, picked: Sequence[int], whole: Condensed) -> _Rows:
        """As `_found`, of a part whose mesh is spread over the ranks: in terms of its unknowns on faces."""
        problem, part = self.problem, self.part
        if whole.varying:
            raise SceneError(
                f"{where}: its mesh is spread over the ranks, and its body force changes in time: give it by "
                "scene.body_force"
            )
        comm = problem.comm
        rank, place = place_on_ranks(where, whole.part.mesh, whole.space, self.point)
        here = comm.rank == rank
        initial: dict[tuple[str, str], Array] = {}
        with agreement(comm):
            of_cell = self._cell_rows(where, whole, place, here)[picked]
            if self.of == "stress":
                initial = {key: _at(whole, s, place, here)[picked] for key, s in whole.stresses.items()}
        functionals = self._inside = np.zeros((len(picked), whole.size))
        if here:
            functionals[:, _unknowns(place, whole.dim)] = of_cell
            self._place = place
        cells = int(whole.part.mesh.topology.index_map(whole.part.mesh.topology.dim).size_local)
        cell = sum(comm.allgather(cells)[:rank]) + int(comm.bcast(place.cell, root=rank))
        rows = [whole.reduced(row, problem.parts[part].size) for row in functionals]
        inner = {key: functionals @ whole.held(f).x.array for key, f in whole.loads.items()}
        constant = functionals @ whole.held(whole.load).x.array
        constant, inner, initial = comm.bcast((constant, inner, initial), root=rank)
        found = None
        if whole.rows is not None:
            every = np.array(rows)[:, whole.rows]
            # what a load moves with the faces at rest: of an initial strain whatever the stiffness is
            softly = [(*key, v) for key, v in inner.items() if key not in whole.stresses]
            moved = [(*key, -inner[key]) for key in inner if key in whole.stresses]
            loads = [*moved, *((*key, v) for key, v in initial.items())]
            found = _Rows(whole.rows, every, cell, loads, constant, softly)
        shared: _Rows = comm.bcast(found, root=whole.owner)
        return shared

    def _cell_rows(self, where: str, s: Substructure | Condensed, place: Place, here: bool) -> Array:
        """(components, unknowns of the cell): the field at the point; of a stress zeros elsewhere."""
        if self.of == "displacement":
            return np.asarray(np.kron(place.shape, np.eye(s.dim)), dtype=np.float64)
        if getattr(s.material, "stress", None) is None:
            raise SceneError(
                f"{where}: its material is a form that gives no stress: give one with a method stress(u)"
            )
        u = fem.Function(s.space)
        stress = s.material.stress(u)
        expression = fem.Expression(stress, place.reference[None])
        rows = []
        for unknown in _unknowns(place, s.dim) if here else ():
            u.x.array[unknown] = 1.0
            rows.append(_evaluated(expression, s, place))
            u.x.array[unknown] = 0.0
        return np.array(rows).T if here else np.zeros((int(np.prod(stress.ufl_shape)), 0))

    @property
    def place(self) -> Place:
        """Where the point is in the mesh, if this rank has the part, or its cell."""
        assert self._place is not None
        return self._place

    @property
    def unknowns(self) -> Ints:
        """Unknowns (k,) of its cell, on the rank that has it."""
        return _unknowns(self.place, len(self.point))

    @property
    def is_here(self) -> bool:
        """Whether this rank has the part, or of one on all ranks the cell."""
        return self._place is not None

    @property
    def cell(self) -> int:
        """Number of the cell that it is in, of a mesh on all ranks among all of its cells, those of the first
        rank first; all ranks know it."""
        return self._rows.cell

    def slopes(self, block: Block) -> tuple[Ints, Array]:
        """Unknowns (k,) of the cell, and the derivatives (k,) of the number by them at one sample."""
        return self._rows.unknowns, self._along(block) @ self._rows.matrix

    def inside(self, block: Block) -> Array:
        """The same derivatives (n,) by the unknowns that this rank knows of a part on all ranks."""
        assert self._inside is not None
        return np.asarray(self._along(block) @ self._inside)

    def _along(self, block: Block) -> Array:
        """Derivatives (components,) by what the number is made of."""
        if self.of == "displacement":
            return np.ones(1)
        values, factor = (each[0] for each in self._components(block))
        along = np.ones(1)
        if self.component == "mises":
            tensor = values.reshape(3, 3)
            deviator = tensor - np.trace(tensor) / 3.0 * np.eye(3)
            along = (1.5 * deviator / max(float(von_mises(tensor[None])[0]), 1e-300)).ravel()
        return np.asarray(float(factor[0]) * along)

    def moved(self, u: Array, gradient: Array) -> Array:
        """Unknowns (k,) of the cell for those (n,) of the part, with the same displacement at the point and
        another gradient (d, d) everywhere; on the rank that has the cell."""
        whole, place = self.problem.spread.get(self.part), self.place
        s = self.problem.substructures[self.part] if whole is None else whole
        nodes = s.space.tabulate_dof_coordinates()[place.nodes, : s.dim]
        there = place.shape @ u.reshape(-1, s.dim)[place.nodes]
        return np.asarray(there + (nodes - self.point) @ gradient.T).ravel()

    def __call__(self, block: Block) -> Array:
        """The number in the samples of a block, (n,)."""
        value, _ = self._components(block)
        if self.component != "mises":
            return np.asarray(value[:, 0])
        return von_mises(value.reshape(-1, 3, 3))

    def _components(self, block: Block) -> tuple[Array, Array]:
        """What the number is made of in the samples of a block (n, components), and what the stiffness is
        multiplied with there, (n, 1)."""
        rows, there = self._rows, block.space(self.part)
        here = self.problem.substructures.get(self.part)
        if not (here is None or here.part is None or there is None or there is here.space):
            raise SceneError(
                f"{self} was made for other meshes than those that it is read from: give it as the quantity "
                "itself, which finds the point again, or read displacements in the function"
            )
        u = block.displacement(self.part, rows.unknowns)
        steps = u.ndim == 3
        u = u[:, self.step] if steps else u

        def numbers(load: str, parameter: str) -> Array:
            number = block.load(load, parameter)
            number = number[:, self.step] if steps else number
            return np.broadcast_to(number, (len(u),))[:, None]

        factor = block.factor(self.part)
        factor = factor[:, None] if factor.ndim == 1 else factor[:, [rows.cell]]
        value = u @ rows.matrix.T + rows.constant / factor
        for load, parameter, inner in rows.inner:
            value = value + numbers(load, parameter) * inner / factor
        for load, parameter, initial in rows.loads:
            value = value - numbers(load, parameter) * initial
        return np.asarray(factor * value if self.of == "stress" else value), factor


class _Rows(NamedTuple):
    """What a number at a point is made of."""

    unknowns: Ints
    """(k,) of the part."""
    matrix: Array
    """(components, k), what they are multiplied with."""
    cell: int
    loads: list[tuple[str, str, Array]]
    """Load, its parameter, and what is taken away (components,) for its number 1."""
    constant: Array | float = 0.0
    """(components,) by constant forces inside, with the stiffness as it was assembled."""
    inner: Sequence[tuple[str, str, Array]] = ()
    """As `loads`, of forces inside; is added."""


def _unknowns(place: Place, dim: int) -> Ints:
    """Unknowns of the cell of a place."""
    return np.asarray((dim * place.nodes[:, None] + np.arange(dim)).ravel(), dtype=np.int64)


def _evaluated(expression: Any, s: Substructure | Condensed, place: Place) -> Array:
    return np.asarray(expression.eval(s.part.mesh, np.array([place.cell], dtype=np.int32))).ravel()


def _at(s: Substructure | Condensed, stress: Any, place: Place, here: bool) -> Array:
    """A stress, UFL, at a place, (d * d,); zeros elsewhere."""
    expression = fem.Expression(stress, place.reference[None])  # all ranks compile it
    return _evaluated(expression, s, place) if here else np.zeros(int(np.prod(stress.ufl_shape)))


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
