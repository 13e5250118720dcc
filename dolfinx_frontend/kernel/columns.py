"""What is random, in the terms of the kernel: parameters in the columns of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.plan.random_laws import RandomLaws, sampled_parameters
from dolfinx_frontend.scene.laws import Fields

__all__ = ["Collocation", "ColumnGroup", "nominal_fields"]


@dataclass(frozen=True, eq=False, repr=False)
class ColumnGroup:
    """Some components of an active interface in other columns than those of the run.

    Attributes
    ----------
    begin, end
        The components.
    forward, backward
        None, one for all points, or one per point: (columns, q) into the columns of the law, (q, columns)
        back; without `backward` by the transposes, because the matrices are orthogonal.
    parameters
        Kernel parameter -> (rows, q * steps) in the columns of the law.
    """

    begin: int
    end: int
    forward: Sequence[Array]
    backward: Sequence[Array] | None
    parameters: Mapping[str, Array]

    def kernel(self) -> dict[str, Any]:
        """As the kernel takes it."""
        return {name: value for name, value in vars(self).items() if value is not None}


@dataclass(frozen=True)
class Collocation:
    """Stochastic quadrature points at which one interface law is evaluated.

    Attributes
    ----------
    interface
        Its name.
    rule
        What the points are, in words.
    points, weights
        (q, L) germ space, and (q,) >= 0 with sum 1; germs that do not reach the interface stay at one value.
    germs
        Numbers of the germs that reach it.
    forward, backward
        (P + 1, q) and (q, P + 1); zero for modes in other germs.
    """

    interface: str
    rule: str
    points: Array = field(repr=False)
    weights: Array = field(repr=False)
    germs: tuple[int, ...]
    forward: Array = field(repr=False)
    backward: Array = field(repr=False)

    def __len__(self) -> int:
        return len(self.weights)

    def group(self, random: RandomLaws, fields: Fields, steps: int = 1) -> ColumnGroup:
        """The columns of the interface as the kernel takes them.

        Parameters
        ----------
        fields, steps
            The law with its random values at their means; parameters that change in time have a column a
            step.

        Raises
        ------
        SceneError
            A random value at a point makes no law.
        """
        parameters = sampled_parameters(random, self.interface, self.points, fields, steps)
        return ColumnGroup(0, fields.components, (self.forward,), (self.backward,), parameters)

    def bytes(self, random: RandomLaws, steps: int = 1) -> float:
        """Memory of the local stage of the interface: transforms, samples, forces, random parameters."""
        fields = nominal_fields(random, self.interface)
        law = random.problem.interfaces[self.interface].law
        names = [law.kernel_name(p) for (name, p) in random.sources if name == self.interface]
        rows = sum(len(fields.parameters[name]) for name in names if name in fields.parameters)
        block = steps * (2 * len(fields.frames) + rows)
        return 8.0 * len(self) * (2 * len(self.forward) + block)


def nominal_fields(random: RandomLaws, name: str) -> Fields:
    """Law of an interface in kernel terms, with what varies at nominal values."""
    interface = random.problem.interfaces[name]
    return interface.law.nominal.fields(interface)
