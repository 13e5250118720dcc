"""When Newton's method begins beside an accelerated iteration that may not need it.

The dense flexibility of all active unknowns takes their third power, a step of the accelerated iteration
the second one; where that is much beside the factors Newton's method takes the whole bodies, which costs
some more of these. It begins at once where it costs no more than the iterations that it usually saves, or
little beside the factors. Else it waits until the iterations so far have cost as much as it will: at worst
both are paid for.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import log10
from typing import NamedTuple

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import exchanged
from dolfinx_frontend.common.memory import available_memory
from dolfinx_frontend.plan.cost import Body, bodies_of, interface_unknowns, shown
from dolfinx_frontend.plan.price import FACTOR, NONLINEAR, ROW_OF_POINT, speed
from latin_core import Options

__all__ = ["Newton", "fitting", "newton_of"]

_DENSE = 25e9
"""Operations a second of the flexibility and its factors, on the core of the other rates."""
_READ, _SOLVE = 10e9, 12e9
"""Bytes a second of dense factors that solve for one or two columns, operations a second for many."""
_OF_BODY, _OF_SYSTEM = 10.0 / 3.0, 2.0 / 3.0
"""Operations over the third power: of a body (a product, its factor, a solution, and a product), of an LU."""
_SYSTEMS = 2.0
"""LU factorisations for each column: the tangents of a first step, and of a last one."""
_SMALL = 0.1
"""Share of the factorisations of the bodies that is little."""
_FEW, _WHOLE = 500, 10.0
"""Unknowns up to which it is dense (as in the kernel's ``structure.hpp``); factorisations of bodies, else."""


class Newton(NamedTuple):
    """When Newton's method begins.

    Attributes
    ----------
    steps
        Accelerated steps before it, see ``Options.newton``; 0: none is planned.
    dense
        Unknowns of the interfaces of all ranks where it has their dense flexibility, else 0.
    flops, memory
        Operations and bytes of that flexibility and its factors, or of the whole bodies.
    choice, reason
        As the plan says it; empty where nothing is to be said.
    """

    steps: int = 1
    dense: int = 0
    flops: float = 0.0
    memory: float = 0.0
    choice: str = ""
    reason: str = ""


class _Work(NamedTuple):
    """What Newton's method, an accelerated step, and the factors of the bodies take."""

    flops: float
    memory: float
    iteration: float
    factor: float
    numbers: float


def newton_of(problem: Problem, active: Sequence[str], columns: int, options: Options) -> Newton:
    """When Newton's method begins in an accelerated iteration with nonlinear laws. Collective.

    Parameters
    ----------
    active
        Names of the active interfaces.
    columns
        Steps of a history.
    options
        ``newton`` is what was asked for, or ``"automatic"``.
    """
    if options.newton == 0:
        return Newton(0)
    here = tuple(name for name in active if name in problem.own.interfaces)
    bodies = [body for body in bodies_of(problem.own, here) if body.active]
    zone = interface_unknowns(problem, tuple(active))
    work = _work(problem, here, bodies, zone, columns)
    dense = _is_dense(problem, bodies, zone, options)
    little = zone <= _FEW or _OF_SYSTEM * float(zone) ** 3 <= _SMALL * FACTOR * work.factor
    kept = zone > _FEW or 0 < options.memory_limit < 8.0 * float(zone) ** 2
    whole = kept and not (dense and little)
    asked = options.newton != "automatic"
    laws = [problem.interfaces[name].law for name in active]
    if not (dense or whole):
        return Newton(0, choice="none", reason="stiffnesses of faces of the bodies exceed the limit")
    if whole:
        work = work._replace(flops=_WHOLE * work.factor * _DENSE, memory=work.numbers)
    seconds = work.flops / _DENSE
    saved = NONLINEAR * log10(1.0 / options.rtol) / 4.0
    steps = min(max(int(seconds / work.iteration), 1), options.max_iterations // 2)
    # which of several equilibria is the answer is a matter of the way to it: it is marched. Bolts lead to one
    path = any(law.history and (columns > 1 if law.rubs else not law.bolt) for law in laws)
    if asked:
        steps = int(options.newton)
    elif path or steps <= saved or seconds <= _SMALL * work.factor:
        steps = 1
    what = f"with the whole bodies and {zone} unknowns it" if whole else f"the flexibility of {zone} unknowns"
    takes = f"{what} takes about {seconds / speed():.2g} s"
    if asked:
        reason = f"asked for; {takes}"
    elif path:
        reason = f"laws remember: the steps are solved one after the other; {takes}"
    elif steps == 1:
        reason = f"{takes}, no more than the iterations that it usually saves"
    else:
        reason = f"{takes}, an accelerated step {work.iteration / speed():.2g} s"
    return Newton(steps, 0 if whole else zone, work.flops, work.memory, _begins(steps), reason)


def _begins(steps: int) -> str:
    return "from the first steps" if steps == 1 else f"after {steps} accelerated steps, or if they stagnate"


def fitting(problem: Problem, newton: Newton, beside: float) -> Newton:
    """The same, or none where its flexibility has no room. Collective.

    Parameters
    ----------
    beside
        Bytes of the run without it.
    """
    if not newton.memory:
        return newton
    room = beside + newton.memory <= available_memory()
    if problem.comm is not None:
        room = all(exchanged(problem.comm, room))
    if room:
        return newton
    what = "its flexibility" if newton.dense else "it"
    needs = f"{what} would need {shown(newton.memory, 'B')} beside {shown(beside, 'B')}"
    return Newton(0, choice="none", reason=needs)


def _is_dense(problem: Problem, bodies: Sequence[Body], zone: int, options: Options) -> bool:
    """Whether there is a dense flexibility of the interfaces: it and the stiffnesses of the bodies on their
    sides keep to the memory limit (as in the kernel's ``structure.cpp``). Collective."""
    numbers = sum(float(body.active) ** 2 for body in bodies)
    if problem.comm is not None:
        numbers = sum(exchanged(problem.comm, numbers))
    return options.memory_limit <= 0 or 8.0 * (numbers + float(zone) ** 2) <= options.memory_limit


def _work(problem: Problem, here: Sequence[str], bodies: Sequence[Body], zone: int, columns: int) -> _Work:
    """Of the rank that has most to do, where there are several. Collective."""
    rows = 0.0
    for name in here:
        interface = problem.interfaces[name]
        rows += len(interface.sides) * interface.num_points * interface.dim
    flops = _OF_BODY * sum(float(body.active) ** 3 for body in bodies)
    flops += _SYSTEMS * _OF_SYSTEM * columns * float(zone) ** 3
    numbers = [float(body.active) ** 2 for body in bodies]
    # factors without search directions, the flexibility, its LU, and what the largest body is multiplied with
    memory = 8.0 * (sum(numbers) + 2.0 * float(zone) ** 2 + 2.0 * max(numbers, default=0.0))
    iteration = sum(numbers) * max(8.0 / _READ, 2.0 * columns / _SOLVE) + ROW_OF_POINT * rows * columns
    factors = 8.0 * sum(body.entries for body in bodies)
    work = _Work(
        flops, memory, max(iteration, 1e-9), sum(body.flops for body in bodies) / FACTOR, factors
    )
    if problem.comm is not None:
        work = _Work(*map(max, zip(*exchanged(problem.comm, work), strict=True)))
    return work
