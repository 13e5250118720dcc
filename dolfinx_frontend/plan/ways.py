"""What chaos, rules and samples of a problem would cost, before any of them starts."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from math import prod
from typing import Any, Literal, NamedTuple

import numpy.typing as npt

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.checks import check_kind, checked_whole
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.html import Shown
from dolfinx_frontend.common.memory import available_memory
from dolfinx_frontend.plan.cost import shown
from dolfinx_frontend.plan.plan import Direction, Method, check_problem, make_plan, plan_for
from dolfinx_frontend.plan.price import Price, Way
from dolfinx_frontend.plan.random_laws import RandomLaws
from dolfinx_frontend.uncertainty.chaos import Chaos
from latin_core import Options

__all__ = ["PricedWay", "Ways", "compare_ways"]


class PricedWay(NamedTuple):
    """A way to an answer, and its price.

    Attributes
    ----------
    name
        As it is asked for, e.g. ``"chaos=2"`` or ``"tensor_quadrature 3"``.
    size
        Modes or points; 0: not known, see `why`.
    price
        None: it cannot be run.
    fits
        Whether it fits into the memory that is free.
    why
        Why it does not.
    """

    name: str
    size: int
    price: Price | None
    fits: bool
    why: str = ""


@dataclass(frozen=True, repr=False)
class Ways(Shown):
    """Ways to an answer with their prices; ``print`` shows a table.

    Attributes
    ----------
    every
        In the order asked for.
    free
        Bytes that are free.
    """

    every: tuple[PricedWay, ...]
    free: float

    def __repr__(self) -> str:
        return f"Ways({', '.join(each.name for each in self.every)}; print it for the prices)"

    def __iter__(self) -> Iterator[PricedWay]:
        return iter(self.every)

    def __len__(self) -> int:
        return len(self.every)

    def __getitem__(self, name: str) -> PricedWay:
        for each in self.every:
            if each.name == name:
                return each
        raise SceneError(f"no way {name!r}: they are {', '.join(each.name for each in self.every)}")

    def __str__(self) -> str:
        width = max(len(each.name) for each in self.every)
        lines = [f"{'way':<{width}}  {'size':>6}  {'direct solves':>13}  {'seconds':>8}  {'memory':>8}"]
        for name, size, price, fits, why in self.every:
            if price is None:
                lines.append(f"{name:<{width}}  {size or '-':>6}  not possible: {why}")
                continue
            line = f"{name:<{width}}  {size:>6}  {price.units:>13.2g}  {price.seconds:>8.2g}"
            line += f"  {shown(price.memory, 'B'):>8}"
            lines.append(line if fits else f"{line}  does not fit: {why}")
        if not all(each.price is None or each.price.sure for each in self.every):
            lines.append("with nonlinear laws the numbers of iterations are typical ones, not known")
        return "\n".join(lines)


def compare_ways(
    problem: Problem,
    chaos: Sequence[int | Chaos] = (1, 2, 3, 4),
    tensor: Sequence[int] = (3, 5),
    sparse: Sequence[int] = (1, 2, 3),
    samples: Sequence[int] = (64, 1024),
    *,
    method: Method = "auto",
    times: npt.ArrayLike | None = None,
    active: Sequence[str] | Literal["all"] | None = None,
    direction: Direction | float | None = None,
    options: Options | None = None,
) -> Ways:
    """Say what ways to the moments of a problem would cost, without running any of them.

    Parameters
    ----------
    chaos
        Orders, or requests.
    tensor, sparse
        Points per germ of tensor rules, and levels of sparse ones.
    samples
        Numbers of samples.
    method, times, active, direction, options
        As for :func:`dolfinx_frontend.solve`.

    Returns
    -------
    Ways
        First one solution with what is random at its mean, then those asked for. Estimates: of
        the time within a factor of two where all laws are linear, else with typical numbers of iterations.

    Raises
    ------
    SceneError
        Nothing is random.
    """
    check_problem("compare_ways", problem)
    random = RandomLaws.of(problem)
    if not random.every:
        raise SceneError("compare_ways: nothing is random: give a law or a load a random parameter")
    settings: dict[str, Any] = {"times": times, "active": active, "direction": direction, "options": options}
    settings["method"] = method
    free = available_memory()
    space = random.space

    def priced(name: str, of: Callable[[], Way]) -> PricedWay:
        way = Way()
        try:
            way = of()
            single = not (way.modes or way.points)
            plan = make_plan(problem, **settings) if single else plan_for(random, way, **settings)
        except SceneError as error:
            return PricedWay(name, way.modes or way.points, None, False, str(error).splitlines()[0])
        assert plan.price is not None  # every plan that is made has one
        fits = plan.price.memory <= free
        why = "" if fits else f"{shown(free, 'B')} are free"
        return PricedWay(name, way.modes or way.points or 1, plan.price, fits, why)

    def of_chaos(wanted: Chaos) -> Way:
        return Way(None, len(space.basis(wanted)), wanted.order, wanted.check_points)

    def of_tensor(count: int) -> Way:
        return Way(points=prod(count if g.capacity is None else min(count, g.capacity) for g in space.germs))

    def of_sparse(level: int) -> Way:
        return Way(points=len(space.sparse_gauss(level).points))

    found = [priced("solve at the means", Way)]
    for each in chaos:
        check_kind("compare_ways", "chaos", each, (int, Chaos), "give orders, or Chaos(...)")
        wanted = each if isinstance(each, Chaos) else Chaos(order=each)
        name = str(each) if isinstance(each, Chaos) else f"chaos={each}"
        found.append(priced(name, partial(of_chaos, wanted)))
    for each in tensor:
        count = checked_whole("compare_ways", "tensor", each, 1)
        found.append(priced(f"tensor_quadrature {count}", partial(of_tensor, count)))
    for each in sparse:
        level = checked_whole("compare_ways", "sparse", each, 0)
        found.append(priced(f"sparse_quadrature {level}", partial(of_sparse, level)))
    for each in samples:
        count = checked_whole("compare_ways", "samples", each, 1)
        found.append(priced(f"samples {count}", partial(Way, points=count)))
    return Ways(tuple(found), free)
