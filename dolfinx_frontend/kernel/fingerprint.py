"""What identifies a run, by name and by value, so that a checkpoint is not carried on with another.

Every array counts with its length, its largest number, its norm and a few random sums, which the file
compares to ten digits: another order of summation is no other run, another number anywhere is.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import latin_core
import numpy as np
import numpy.typing as npt
from latin_core import SweptParameter

from dolfinx_frontend.assembly.elements import csr
from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.part_loads import PartLoad
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.substructure import Substructure
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.codes import code_digest
from dolfinx_frontend.common.deferred import sp
from dolfinx_frontend.plan.plan import Plan

__all__ = ["fingerprint"]

Facts: TypeAlias = dict[str, Any]
"""Name of a fact -> what it is; values that JSON has."""

SUMS = 4
BLOCK = 1 << 20
"""Numbers that are summed at a time."""
INDIFFERENT = ("snapshots", "together", "operator", "backend", "memory_limit", "scatter", "max_seconds")
"""Options that change the work but not what is accepted as an answer."""


def fingerprint(
    problem: Problem,
    plan: Plan,
    parameters: Sequence[SweptParameter],
    outputs: Mapping[str, Callable[..., Any]] | None = None,
    *,
    codes: bool = True,
) -> Facts:
    """All that the answers at the points of a run depend on; functions of the user only with `codes`.

    Raises
    ------
    SceneError
        A function of the user cannot be told apart from another one.
    """
    facts: Facts = {"software": f"latin_core {latin_core.__version__}"}
    for each in dataclasses.fields(plan.options):
        if each.name not in INDIFFERENT:
            facts[f"option {each.name}"] = getattr(plan.options, each.name)
    direction = plan.direction
    facts |= {
        "method": plan.method,
        "active interfaces": list(plan.active),
        "parts whose stiffness varies": [list(plan.scaled), list(plan.fields)],
        "search direction": [_plain(direction.factor), _plain(direction.length)],
        "given search directions": {name: _sums(k) for name, k in direction.given.items()},
        "times": None if plan.times is None else _sums(plan.times),
        "factors of the load patterns": _sums(plan.factors()),
        "loads that vary": [[f"{t.load}.{t.parameter}" for t in plan.loads], _sums(plan.load_factors)],
    }
    facts |= _problem(problem, np.zeros(0) if plan.times is None else plan.times)
    for number, swept in enumerate(parameters):
        name = f"values of {swept.interface}.{swept.parameter}"
        if not swept.interface:
            name = f"values of swept load {number}"
        facts[name] = [_sums(swept.pattern), _sums(swept.values), swept.columns]
    if not codes:
        return facts
    for name, interface in problem.interfaces.items():
        functions = interface.law.functions
        if functions is not None:
            who = f"interface {name!r}, law {functions.label!r}"
            given = (functions.force, functions.resolve, functions.compiled, functions.tangent)
            facts[f"code of the law of {name!r}"] = code_digest(given, who, KNOWN)
    for name, function in (outputs or {}).items():
        facts[f"code of output {name!r}"] = code_digest(function, f"output {name!r}", KNOWN)
    return facts


def _told(facts: Facts) -> str:
    return hashlib.sha256(json.dumps(facts).encode()).hexdigest()


# what a function of the user may refer to
KNOWN: dict[type, Callable[[Any], str]] = {
    Problem: lambda problem: _told(_problem(problem, np.zeros(0))),
    Interface: lambda interface: _told(_interface(interface, np.zeros(0))),
    Substructure: lambda part: _told(_part(part)),
}


def _problem(problem: Problem, times: npt.NDArray[np.float64]) -> Facts:
    facts: Facts = {"parts": list(problem.parts), "interfaces": list(problem.interfaces)}
    for part in problem.substructures.values():
        facts |= _part(part)
    for interface in problem.interfaces.values():
        facts |= _interface(interface, times)
        for number, side in enumerate(interface.sides):
            if side.substructure in problem.substructures:
                matrix = csr(side.trace)
                facts[f"trace {number + 1} of {interface.name!r}"] = [_structure(matrix), _sums(matrix.data)]
    for load in problem.loads.values():
        facts |= _load(load, times)
    return facts


def _load(load: PartLoad, times: npt.NDArray[np.float64]) -> Facts:
    facts: Facts = {}
    for parameter, columns in load.columns.items():
        numbers = [
            [a(t) if (a := n.amplitude) is not None else 1.0 for t in times]
            for n in load.load.terms(parameter)
        ]
        facts[f"load {load.load.name!r}, {parameter}"] = [
            {part: _sums(nodal) for part, nodal in columns.items()},
            [_sums(n.mean) for n in load.load.terms(parameter)],
            [_sums(each) for each in numbers],
        ]
    return facts


def _part(part: Substructure) -> Facts:
    where = f"of part {part.name!r}"
    matrix = part.matrix
    loads = [part.load, *part.varying_loads.values()]
    return {
        f"mesh {where}": [_sums(part.dof_coordinates), part.volume, _structure(matrix)],
        f"stiffness {where}": _sums(matrix.data),
        f"body force {where}": [_sums(load) for load in loads],
    }


def _interface(interface: Interface, times: npt.NDArray[np.float64]) -> Facts:
    law, where = interface.law, f"of {interface.name!r}"
    columns = [law.at(t).fields(interface, t) for t in times]
    if not columns or not (law.varying or law.history):
        columns = [law.nominal.fields(interface)]
    # rows of a trace are found in the frames, so both make the operator that the kernel has
    facts: Facts = {
        f"sides {where}": [f"{side.substructure}:{side.face}" for side in interface.sides],
        f"points {where}": [_sums(interface.points), _sums(interface.weights), _sums(interface.gap)],
        f"frames {where}": _sums(interface.frames),
        f"kind of the law {where}": f"{law.title} {columns[0].kind}, {columns[0].components} components",
        f"rows of the law {where}": _sums(columns[0].frames),
    }
    for name in columns[0].parameters:
        values = np.concatenate([np.ravel(each.parameters[name]) for each in columns])
        facts[f"{name} {where}"] = _sums(values)
    loads = [law.nominal.load(interface)] if not len(times) else [law.at(t).load(interface, t) for t in times]
    given = [np.ravel(load) for load in loads if load is not None]
    if given:
        facts[f"load {where}"] = _sums(np.concatenate(given))
    return facts


def _plain(value: float | None) -> float | None:
    return None if value is None else float(value)


def _structure(matrix: sp.csr_matrix) -> str:
    """Digest of where a sparse matrix has entries."""
    digest = hashlib.sha256(str(matrix.shape).encode())
    for indices in (matrix.indptr, matrix.indices):
        digest.update(np.ascontiguousarray(indices, dtype=np.int64).tobytes())
    return digest.hexdigest()[:16]


def _sums(values: npt.ArrayLike) -> list[float]:
    """Length, logarithm of the largest number, norm relative to it, sums with random factors over the norm.

    Those of the numbers that are finite; if some are not, a sum that says which follows.
    """
    given: Array = np.asarray(values, dtype=np.float64).ravel()
    finite = np.isfinite(given)
    kinds: list[float] = []
    if not finite.all():
        kinds = _sums(np.where(finite, 0.0, np.where(np.isnan(given), 3.0, np.sign(given))))
    data: Array = np.where(finite, given, 0.0)
    size = float(np.abs(data).max(initial=0.0))
    if size == 0.0:
        return [float(data.size), 0.0, 0.0, *kinds]
    norm, sums = 0.0, np.zeros(SUMS)
    random = np.random.Generator(np.random.PCG64(data.size))
    for begin in range(0, data.size, BLOCK):
        block = data[begin : begin + BLOCK] / size
        norm += float(block @ block)
        sums += (random.random((SUMS, block.size)) - 0.5) @ block
    norm = norm**0.5
    return [float(data.size), float(np.log(size)), norm, *map(float, sums / norm), *kinds]
