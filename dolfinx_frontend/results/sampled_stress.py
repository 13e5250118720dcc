"""Stresses of a part sample by sample: their moments, and those of what is no linear function of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np
from dolfinx import fem

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.results.answer import Answer, Block, stepped
from dolfinx_frontend.results.moments import Accumulator
from dolfinx_frontend.results.stress import broken_space, principal, stress_of, von_mises

__all__ = ["MADE_OF_STRESS", "PartStress", "made_of_stress", "moments_of_stress", "number_of_stress"]

MADE_OF_STRESS = ("von Mises", "principal")
"""Numbers that are made of a stress: one, and three, the largest first."""

OF_A_CHAOS = 512
"""Sobol points of a chaos at which they are computed."""


class PartStress:
    """Stress of a part of an answer at one step, from unknowns and numbers of initial stresses."""

    def __init__(self, answer: Answer, part: str, step: int) -> None:
        self._answer, self._part, self._step = answer, part, step
        self._u = answer.displacement(part, step)
        problem = answer.problem
        self._loads = [(load, parameter) for load, parameter, _ in problem.initial_stresses(part)]
        degree = int(self._u.function_space.element.basix_element.degree)
        initial = [stress for _, _, stress in problem.initial_stresses(part)]
        material = problem.substructures[part].material
        self._at = stress_of(self._u, material, degree, initial)
        self.function: fem.Function = self._at([0.0] * len(initial)).copy()
        nodes = np.asarray(self.function.function_space.dofmap.list, dtype=np.int64)
        size = self.function.function_space.dofmap.index_map_bs
        self.of_cells = (size * nodes[:, :, None] + np.arange(size)).reshape(len(nodes), -1)

    def __call__(self, unknowns: Array, numbers: Sequence[float]) -> Array:
        """(n,), all components at all nodes of the cells."""
        self._u.x.array[:] = self._answer.function(self._part, unknowns, "").x.array
        return np.array(self._at(numbers).x.array)

    def samples(self, blocks: Iterable[Block]) -> Iterator[tuple[Array, Array | None]]:
        """Stresses (samples, n) of blocks, the stiffness of the sample in them, and weights."""
        times, step = self._answer.times, self._step
        for block in blocks:
            fields = stepped(block.displacement(self._part), times, 1)[:, step]
            factors = np.asarray(block.factor(self._part))
            if factors.ndim > 1:
                every_one = np.empty((len(factors), len(self.function.x.array)))
                every_one[:, self.of_cells] = factors[:, :, None]
                factors = np.broadcast_to(every_one, (len(fields), every_one.shape[1]))
            else:
                factors = np.broadcast_to(factors, (len(fields),))
            sampled = [stepped(block.load(*key), times, 1)[:, step] for key in self._loads]
            rows: Array = np.reshape(
                [np.broadcast_to(each, (len(fields),)) for each in sampled], (len(self._loads), len(fields))
            ).T
            stresses = [factors[n] * self(fields[n], list(rows[n])) for n in range(len(fields))]
            yield np.array(stresses), block.weights


def _blocks(answer: Answer, most: int | None = None) -> Iterator[Block]:
    """Of all samples, of a sweep of its last point; of a chaos of `most` at least."""
    if answer.statistics in ("grid", "value"):
        yield answer.shown()
        return
    count = 0
    for block in answer.moment_blocks():
        yield block
        count += len(block)
        if answer.kind == "chaos" and most is not None and count >= most:
            return


def moments_of_stress(stress: PartStress, answer: Answer) -> tuple[Array, Array]:
    """Mean and deviation (n,) over the samples of an answer; of a sweep of its last point."""
    sums = Accumulator(answer.statistics != "qmc")
    for values, weights in stress.samples(_blocks(answer)):
        sums.add({"stress": values}, weights)
    return sums.found()["stress"]


def made_of_stress(answer: Answer, part: str, step: int, of: str) -> tuple[fem.Function, fem.Function]:
    """Mean and deviation of a number made of the stress, computed sample by sample, cell by cell.

    Raises
    ------
    SceneError
        A plane part, whose stress out of the plane is not known.
    """
    stress = PartStress(answer, part, step)
    number = _number_of(part, stress.function, of)
    sums = Accumulator(answer.statistics != "qmc")
    for values, weights in stress.samples(_blocks(answer, OF_A_CHAOS)):
        numbers = number(values.reshape(-1, 3, 3)).reshape(len(values), -1)
        sums.add({of: numbers}, weights)
    out = [_function_of(stress.function, of, values) for values in sums.found()[of]]
    return out[0], out[1]


def number_of_stress(part: str, stress: fem.Function, of: str) -> fem.Function:
    """A number made of one stress, cell by cell; raises as :func:`made_of_stress`."""
    number = _number_of(part, stress, of)
    return _function_of(stress, of, number(stress.x.array.reshape(-1, 3, 3)).ravel())


def _number_of(part: str, stress: fem.Function, of: str) -> Callable[[Array], Array]:
    if int(stress.function_space.value_shape[0]) != 3:
        raise SceneError(
            f"stress of {part!r}: of = {of!r} needs all three axes, a plane part has the stress in its plane"
        )
    return von_mises if of == "von Mises" else principal


def _function_of(stress: fem.Function, of: str, values: Array) -> fem.Function:
    """A function of a number made of a stress, with its values at the nodes of the cells."""
    degree = int(stress.function_space.element.basix_element.degree)
    function = fem.Function(broken_space(stress, () if of == "von Mises" else (3,), degree), name=of)
    function.x.array[:] = values
    return function
