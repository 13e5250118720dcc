"""What identifies a problem and its plan, so that a checkpoint is not carried on with another."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from latin_core import SweptParameter

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.kernel import bridge
from dolfinx_frontend.plan.plan import Plan


def fingerprint(problem: Problem, plan: Plan, parameters: Sequence[SweptParameter]) -> str:
    """Hash of what makes two runs the same: parts, loads, interfaces, laws, times, plan, swept values.

    Numbers count with nine digits, so that another order of summation is no other run.
    """
    digest = hashlib.sha256()

    def add(name: str, values: npt.ArrayLike) -> None:
        data = np.asarray(values, dtype=np.float64).ravel()
        size = float(np.abs(data).max(initial=0.0))
        digits = np.round(data / (size or 1.0), 9) + 0.0  # no negative zeros
        digest.update(f"{name} {data.size} {size:.9e}".encode() + digits.tobytes())

    for part in problem.substructures.values():
        add(part.name, part.size)
        for what in (part.volume, part.stiffness.norm(), part.load, *part.varying_loads.values()):
            add("part", what)
    moments = np.zeros(0) if plan.times is None else plan.times
    add("times", moments)
    add("factors", plan.factors())
    for name, interface in problem.interfaces.items():
        law = interface.law
        kind = bridge.law_fields(interface, law.nominal).kind
        add(f"{name} {type(law).__name__} {kind}", interface.weights)
        columns = [bridge.law_fields(interface, law.at(t), t) for t in moments]
        if not columns or not (law.varying or law.history):
            columns = [bridge.law_fields(interface)]
        for fields in columns:
            for parameter, values in sorted(fields.parameters.items()):
                add(parameter, values)
    for each in parameters:
        add(f"{each.interface} {each.parameter}", each.pattern)
        add("values", each.values)
    digest.update(f"{plan.method} {plan.active} {plan.direction}".encode())
    return digest.hexdigest()
