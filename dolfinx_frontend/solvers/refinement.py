"""A direct solution that checks and corrects itself.

One solve with a Cholesky factor has a relative error of about 1e-16 times the condition of the whole assembly: a
part on a soft spring, a stiff spring between soft parts or a contrast of materials lose digits, and nothing in the
solution says so. Here its residual is formed with the matrices of the parts and the springs as they are given,
before they are added up, and solved for again:

* A rigid motion strains no part. What assembly and rounding make of it is a false stiffness, as strong as a spring
  of 1e-16 E / L; the rigid part of a displacement is therefore taken away before it meets the stiffness.
* A spring too soft for the factors (below 1e-8 E / L) was factorised with more stiffness. The motions that such
  springs alone resist are rigid; their amplitudes follow from a small system of the springs alone.
* The force of a spring too stiff for them (above 1e8 E / L) is an unknown of its own, as in the method of augmented
  Lagrangians: it never is a difference of displacements.

Both make every correction smaller by many digits than the one before. What is left is reported: the last correction
times its rate, and the answer to the rounding errors of the matrices, of which one random sample is solved for
beside the correction.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from dolfinx_frontend.assembly.held import held
from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import agreement
from dolfinx_frontend.assembly.rigid import free_motions
from dolfinx_frontend.assembly.substructure import Substructure
from dolfinx_frontend.common.arrays import Array, Flags
from dolfinx_frontend.kernel.solver import Solver
from dolfinx_frontend.plan.plan import Plan
from dolfinx_frontend.plan.reduction import factorised_stiffness
from dolfinx_frontend.results.accuracy import Accuracy, Corrected

__all__ = ["corrected"]

MOST = 8
"""Corrections at most."""

ENOUGH = 1e-2
"""Corrections end when what they leave is below this, relative to the tolerance."""

FALLING = 0.5
"""Corrections that fall by less from one to the next are rounding."""

ROUNDING = 2.0**-53

STRAINLESS = 1e-10
"""A rigid motion that the stiffness resists less than so, relative to its entries, is one that strains nothing."""

RESOLVED = 0.03
"""An error above this, relative to what a part or a spring does itself, is relative to the whole: what it does may
be nothing but rounding."""

Blocks = dict[str, Array]


@dataclass(frozen=True)
class _Part:
    """A part: stiffness, its squared entries, and an orthonormal basis of the motions that do not strain it."""

    matrix: sp.csr_matrix
    squared: sp.csr_matrix
    rigid: Array
    load: Array
    offset: Array

    @classmethod
    def of(cls, part: Substructure, load: Array, offset: Array) -> _Part:
        matrix = part.matrix
        squared = sp.csr_matrix((matrix.data**2, matrix.indices, matrix.indptr), shape=matrix.shape)
        modes = part.rigid_modes
        resisted = np.abs(matrix @ modes).max(axis=0)
        size = np.sqrt(squared @ modes**2).max(axis=0)
        return cls(matrix, squared, np.linalg.qr(modes[:, resisted <= STRAINLESS * size])[0], load, offset)

    def strained(self, u: Array) -> Array:
        """A displacement less its rigid part."""
        return u - self.rigid @ (self.rigid.T @ u)


@dataclass(frozen=True)
class _Spring:
    """An eliminated spring: signed traces of its sides, stiffness times area as given and as factorised, jumps."""

    traces: tuple[tuple[str, sp.csr_matrix], ...]
    stiffness: Array
    factorised: Array
    jump: Array
    weights: Array

    @classmethod
    def of(cls, problem: Problem, interface: Interface, plan: Plan) -> _Spring:
        kappa = interface.law.stiffnesses(interface)
        weights = np.repeat(interface.weights, interface.dim)
        traces = tuple(
            (side.substructure, (1.0 if k else -1.0) * interface.local_trace(k))
            for k, side in enumerate(interface.sides)
        )
        jumps = [interface.law.pattern(a).jumps(interface).ravel() for a in plan.patterns]
        return cls(
            traces,
            kappa.ravel() * weights,
            factorised_stiffness(problem, interface, kappa).ravel() * weights,
            np.column_stack(jumps),
            weights,
        )

    @property
    def softer(self) -> Flags:
        """Rows that were factorised with more stiffness than they have."""
        return self.factorised > self.stiffness

    @property
    def stiffer(self) -> Flags:
        """Rows that were factorised with less."""
        return self.factorised < self.stiffness

    def of_parts(self, u: Blocks) -> Array:
        """Jumps (rows, columns) of displacements."""
        return sum((trace @ u[name] for name, trace in self.traces), start=np.zeros(()))

    def rounding(self, u: Blocks) -> Array:
        """Size of the rounding errors of these jumps."""
        return ROUNDING * sum((abs(trace) @ np.abs(u[name]) for name, trace in self.traces), start=np.zeros(()))

    def push(self, forces: Blocks, force: Array) -> None:
        """Add what a force of the spring does to its parts."""
        for name, trace in self.traces:
            forces[name] -= trace.T @ force


class _Corrections:
    """The solution so far, and the next correction of it.

    `floating` are amplitudes of rigid motions that only springs too soft for the factors resist; `u` is the
    rest of the displacement: a sum of both would lose the strain in the motion.
    """

    def __init__(self, solver: Solver) -> None:
        own, plan = solver.problem.own, solver.plan
        self.solver = solver
        self.parts = {n: _Part.of(own.substructures[n], a.load, a.offset) for n, a in solver.acting.items()}
        names = [n for n in plan.eliminated if n in own.interfaces and own.interfaces[n].law.springs]
        self.springs = {n: _Spring.of(own, own.interfaces[n], plan) for n in names}
        self._scale()
        self.u = {name: part.offset.copy() for name, part in self.parts.items()}
        self.forces = {n: np.zeros_like(each.jump) for n, each in self.springs.items()}
        self._find_floating(own)
        self.floating = np.zeros((self.soft.shape[0], len(plan.patterns)))

    def _scale(self) -> None:
        """Make forces of about 1 of all that acts, in steps without rounding: squares stay numbers."""
        sizes = [part.load for part in self.parts.values()]
        sizes += [part.matrix @ part.strained(part.offset) for part in self.parts.values()]
        sizes += [np.minimum(s.stiffness, s.factorised)[:, None] * s.jump for s in self.springs.values()]
        largest = max((float(np.abs(each).max(initial=0.0)) for each in sizes), default=0.0)
        self.unit = 2.0 ** np.floor(np.log2(largest)) if largest > 0.0 else 1.0
        self.parts = {
            n: replace(p, load=p.load / self.unit, offset=p.offset / self.unit) for n, p in self.parts.items()
        }
        self.springs = {n: replace(s, jump=s.jump / self.unit) for n, s in self.springs.items()}

    def _find_floating(self, own: Problem) -> None:
        """Motions that nothing but soft springs resists, (n, q) of every part, and their stiffness (q, q)."""
        self.motions: Blocks = {}
        self.soft: Array = np.zeros((0, 0))
        soft = [name for name, each in self.springs.items() if each.softer.any()]
        if not soft:
            return
        sizes = {n: (p.centre, p.length) for n, p in own.substructures.items()}
        resisting = []
        for name, interface in own.interfaces.items():
            firm = None
            if name in soft:
                firm = ~self.springs[name].softer.reshape(interface.num_points, -1).any(axis=1)
            resisting.append(held(own, interface, firm))
        found = free_motions(sizes, resisting)
        if not len(found):
            return
        for name, part in own.substructures.items():
            self.motions[name] = found.at(name, part.dof_coordinates).reshape(part.size, -1)
        self.soft = np.zeros((len(found),) * 2)
        for name in soft:
            jumps = self.springs[name].of_parts(self.motions)
            self.soft += jumps.T @ (self.springs[name].stiffness[:, None] * jumps)

    # --- the equations --------------------------------------------------------------------------
    def displacements(self) -> Blocks:
        """Of the parts, (n, columns)."""
        if not self.motions:
            return self.u
        return {name: u + self.motions[name] @ self.floating for name, u in self.u.items()}

    def free_jump(self, name: str) -> Array:
        """Jump of a spring less that which is imposed; firm springs do not see the floating motions."""
        spring = self.springs[name]
        jump = spring.of_parts(self.u) - spring.jump
        if self.motions and spring.softer.any():
            jump = jump + spring.of_parts(self.motions) @ self.floating
        return jump

    def spring_force(self, name: str) -> Array:
        """Force of a spring times area, (rows, columns)."""
        spring = self.springs[name]
        return np.where(spring.stiffer[:, None], self.forces[name], spring.stiffness[:, None] * self.free_jump(name))

    def residual(self) -> tuple[Blocks, Blocks]:
        """Forces on the parts that are not balanced; of stiff springs, jumps that do not fit their force."""
        forces = {n: p.load - p.matrix @ p.strained(self.u[n]) for n, p in self.parts.items()}
        gaps = {}
        for name, spring in self.springs.items():
            stiff = spring.stiffer[:, None]
            force = self.spring_force(name)
            gaps[name] = np.zeros_like(force)
            if stiff.any():
                np.divide(self.forces[name], spring.stiffness[:, None], out=gaps[name], where=stiff)
                gaps[name] = np.where(stiff, self.free_jump(name) - gaps[name], 0.0)
                force = force + spring.factorised[:, None] * gaps[name]
            spring.push(forces, force)
        return forces, gaps

    def rounding(self) -> tuple[Blocks, Blocks]:
        """A sample of what rounding errors of the matrices do: forces on the parts, and those of the springs."""
        random = np.random.default_rng(0)
        forces, of_springs = {}, {}
        for name, part in self.parts.items():
            size = np.sqrt(part.squared @ part.strained(self.u[name]) ** 2)
            forces[name] = ROUNDING * size * random.standard_normal(size.shape)
        for name, spring in self.springs.items():
            size = spring.rounding(self.displacements()) * random.standard_normal(spring.jump.shape)
            of_springs[name] = np.where(spring.stiffer[:, None], 0.0, spring.stiffness[:, None] * size)
            spring.push(forces, of_springs[name])
        return forces, of_springs

    def solve(self, forces: Blocks) -> tuple[Array, Blocks]:
        """Floating motions and displacements that answer forces, all but exactly."""
        if not self.motions:
            return np.zeros((0, next(iter(forces.values()), np.zeros((0, 0))).shape[1])), self.solver.response_to(forces)
        work = sum((self.motions[name].T @ force for name, force in forces.items()), start=np.zeros(()))
        scale = 1.0 / np.sqrt(np.diag(self.soft))
        scaled = scale[:, None] * self.soft * scale
        floating = scale[:, None] * np.linalg.lstsq(scaled, scale[:, None] * work, rcond=1e-14)[0]
        rest = {name: force.copy() for name, force in forces.items()}
        for spring in self.springs.values():
            if spring.softer.any():
                jump = spring.of_parts(self.motions) @ floating
                spring.push(rest, spring.stiffness[:, None] * jump)
        return floating, self.solver.response_to(rest)


@dataclass
class _Gram:
    """Inner products (columns, columns) of what each part and spring does, in strain energy and displacement."""

    strain: Blocks
    moved: Blocks
    spring: Blocks


def _products(
    state: _Corrections, u: Blocks, floating: Array, forces: Blocks, first: int, last: int
) -> _Gram:
    """Of the columns first:last of displacements, floating motions and spring forces."""
    strain, moved, spring = {}, {}, {}
    for name, part in state.parts.items():
        own = u[name][:, first:last]
        strained = part.strained(own)
        strain[name] = strained.T @ (part.matrix @ strained)
        if state.motions:
            own = own + state.motions[name] @ floating[:, first:last]
        moved[name] = own.T @ own / len(own)
    for name, each in state.springs.items():
        acts = each.stiffness > 0.0
        force = forces[name][acts, first:last]
        spring[name] = force.T @ (force / each.stiffness[acts, None])
    return _Gram(strain, moved, spring)


def _representable(state: _Corrections) -> Blocks:
    """Inner products of the strain that rounding a displacement to a double makes."""
    out = {}
    for name, u in state.displacements().items():
        part = state.parts[name]
        size = ROUNDING * np.sqrt(part.matrix.diagonal())[:, None] * u
        out[name] = size.T @ size
    return out


def _quadratic(gram: Array, factors: Array) -> Array:
    """Sizes (T,) of combinations (columns, T) of columns."""
    return np.sqrt(np.maximum(np.einsum("at,ab,bt->t", factors, gram, factors), 0.0))


def _relative(errors: dict[str, Array], sizes: dict[str, Array], whole: Array) -> dict[str, Array]:
    """Errors (T,) relative to what each does itself, or to the whole where that may be rounding."""
    out = {}
    for name, error in errors.items():
        own = sizes[name]
        against = np.where(error <= RESOLVED * own, own, np.maximum(whole, own))
        out[name] = np.divide(error, against, out=np.zeros_like(error), where=against > 0.0)
    return out


def _together(first: Blocks, second: Blocks) -> Blocks:
    return {name: np.hstack([block, second[name]]) for name, block in first.items()}


def corrected(solver: Solver) -> Corrected:
    """Solve a plan without active interfaces, correct the solution and say what is left; collective.

    Parameters
    ----------
    solver
        Of that plan.
    """
    comm = solver.problem.comm
    with agreement(comm):
        found = _corrected(solver)
    if comm is None:
        return found
    every = [each for each in comm.allgather(found.accuracy) if each.places]
    values = np.hstack([each.values for each in every])
    places = tuple(place for each in every for place in each.places)
    return replace(found, accuracy=replace(every[0], values=values, places=places))


def _corrected(solver: Solver) -> Corrected:
    state, plan, columns = _Corrections(solver), solver.plan, len(solver.plan.patterns)
    if not state.parts:  # a rank without parts
        return Corrected(Accuracy(np.zeros((1, 0)), ("",), ()), {}, {})
    factors = plan.factors()
    before, rate, count = 1.0, 1.0, 0
    errors: dict[str, Array] = {}
    for number in range(MOST + 1):
        forces, gaps = state.residual()
        of_rounding, direct = state.rounding() if number else (forces, {})
        floating, u = state.solve(_together(forces, of_rounding) if number else forces)
        changes = _spring_changes(state, u, floating, gaps, direct, bool(number))
        found = _products(state, u, floating, changes, 0, columns)
        noise = _products(state, u, floating, changes, columns, 2 * columns) if number else found
        for name, each in state.u.items():
            each += u[name][:, :columns]
        state.floating += floating[:, :columns]
        for name, force in state.forces.items():
            stiff = state.springs[name].stiffer[:, None]
            force += np.where(stiff, changes[name][:, :columns], 0.0)
        if not number:
            continue
        count = number
        whole = _products(state, state.u, state.floating, {n: state.spring_force(n) for n in state.springs}, 0, columns)
        errors = _errors(state, found, noise, whole, factors, 1.0, False)
        now = max((float(e.max(initial=0.0)) for e in errors.values()), default=0.0)
        rate = min(now / before, 1.0) if before > 0.0 else 0.0
        errors = _errors(state, found, noise, whole, factors, rate, True)
        if now * rate <= ENOUGH * plan.options.rtol or rate > FALLING or not np.isfinite(now):
            break
        before = now
    displacements = {name: state.unit * u for name, u in state.displacements().items()}
    springs = {}
    for name, spring in state.springs.items():
        per_area = state.unit * state.spring_force(name) / spring.weights[:, None]
        springs[name] = (per_area, state.unit * (state.free_jump(name) + spring.jump))
    return Corrected(_accuracy(plan, errors), displacements, springs, count)


def _spring_changes(
    state: _Corrections, u: Blocks, floating: Array, gaps: Blocks, direct: Blocks, sampled: bool
) -> Blocks:
    """Changes of the forces of the springs that go with those of the displacements."""
    out = {}
    for name, spring in state.springs.items():
        jump = spring.of_parts(u)
        if state.motions and spring.softer.any():
            jump = jump + spring.of_parts(state.motions) @ floating
        gap = gaps[name]
        if sampled:
            gap = np.hstack([gap, np.zeros_like(gap)])
        stiff = spring.stiffer[:, None]
        out[name] = np.where(stiff, spring.factorised[:, None] * (jump + gap), spring.stiffness[:, None] * jump)
        if sampled:
            out[name][:, jump.shape[1] // 2 :] += direct[name]
    return out


def _errors(
    state: _Corrections, found: _Gram, noise: _Gram, whole: _Gram, factors: Array, rate: float, all_of_it: bool
) -> dict[str, Array]:
    """Place -> relative errors (T,): those of the correction times a rate, with or without rounding."""
    rounded = _representable(state) if all_of_it else {}

    def size(kind: str, gram: _Gram) -> dict[str, Array]:
        return {name: _quadratic(block, factors) for name, block in getattr(gram, kind).items()}

    out: dict[str, Array] = {}
    for kind, label in (("strain", "part"), ("moved", "part"), ("spring", "interface")):
        left = {name: rate * each for name, each in size(kind, found).items()}
        if all_of_it:
            for name, each in size(kind, noise).items():
                left[name] = np.hypot(left[name], each)
                if kind == "strain":
                    left[name] = np.hypot(left[name], _quadratic(rounded[name], factors))
        own = size(kind, whole)
        blocks = list(own.values())
        if kind == "moved":
            total = np.max(blocks, axis=0) if blocks else np.zeros(factors.shape[1])
        else:
            energies = list(size("strain", whole).values())
            if kind == "spring":  # soft ones hold far more energy than parts, which must not hide these
                energies += blocks
            total = np.sqrt(np.sum(np.square(energies), axis=0))
        for name, each in _relative(left, own, total).items():
            place = f"{label} {name}"
            out[place] = np.maximum(out[place], each) if place in out else each
    return out


def _accuracy(plan: Plan, errors: dict[str, Array]) -> Accuracy:
    values = np.array(list(errors.values())).T
    if plan.times is None:
        return Accuracy(values[:1], ("",), tuple(errors))
    groups = tuple(f"step {k}" for k in range(len(plan.times)))
    if len(values) == 1:  # nothing changes in time
        values = np.repeat(values, len(groups), axis=0)
    return Accuracy(values, groups, tuple(errors), tuple(range(len(groups))))
