"""What chaos, rules and samples of a problem would cost, before any of them starts."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import prod
from typing import Any, Literal, NamedTuple

import numpy.typing as npt

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.checks import check_kind, checked_whole
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.memory import available_memory
from dolfinx_frontend.plan.cost import shown
from dolfinx_frontend.plan.plan import Direction, Method, Plan, check_problem, make_plan
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


@dataclass(frozen=True)
class Ways:
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
        First one solution with what is random at its mean, then those asked for. Estimates of processor time and
        memory within a factor of two where all laws are linear; where a law is not, the time is a guess.

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

    def plan_of(way: Way) -> Plan:
        of_chaos = {"random": random, "columns": way.modes} if way.modes else {}
        varied = {"vary": random.interfaces, "loads": random.loads}
        parts = {"scaled": random.scaled, "fields": random.fields}
        return make_plan(problem, way=way, **varied, **parts, **of_chaos, **settings)

    def priced(name: str, of: Callable[[], Way]) -> PricedWay:
        way = Way()
        try:
            way = of()
            price = plan_of(way).price if way.random is not None else make_plan(problem, **settings).price
        except SceneError as error:
            return PricedWay(name, way.modes or way.points, None, False, str(error).splitlines()[0])
        assert price is not None  # every plan that is made has one
        fits = price.memory <= free
        why = "" if fits else f"{shown(free, 'B')} are free"
        return PricedWay(name, way.modes or way.points or 1, price, fits, why)

    def of_chaos(each: int | Chaos) -> Way:
        wanted = each if isinstance(each, Chaos) else Chaos(order=each)
        return Way(random, len(space.basis(wanted)), wanted.order, wanted.check_points)

    def of_tensor(count: int) -> Way:
        counts = [count if g.capacity is None else min(count, g.capacity) for g in space.germs]
        return Way(random, points=prod(counts))

    found = [priced("solve at the means", Way)]
    for each in chaos:
        check_kind("compare_ways", "chaos", each, (int, Chaos), "give orders, or Chaos(...)")
        name = f"chaos={each}" if isinstance(each, int) else str(each)
        found.append(priced(name, lambda each=each: of_chaos(each)))  # type: ignore[misc]
    for count in tensor:
        points = checked_whole("compare_ways", "tensor", count, 1)
        found.append(priced(f"tensor_quadrature {points}", lambda n=points: of_tensor(n)))  # type: ignore[misc]
    for level in sparse:
        level = checked_whole("compare_ways", "sparse", level, 0)
        found.append(
            priced(
                f"sparse_quadrature {level}",
                lambda k=level: Way(random, points=len(space.sparse_gauss(k).points)),  # type: ignore[misc]
            )
        )
    for count in samples:
        count = checked_whole("compare_ways", "samples", count, 1)
        found.append(priced(f"samples {count}", lambda n=count: Way(random, points=n)))  # type: ignore[misc]
    return Ways(tuple(found), free)
