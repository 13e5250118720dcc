"""A direct solution that checks and corrects itself.

One solve with a Cholesky factor has a relative error of about 1e-16 times the condition of the whole
assembly: a part on a soft spring, a stiff spring between soft parts or a contrast of materials lose digits,
and nothing in the solution says so. Here its residual is formed with the matrices of the parts and the
springs as they are given, before they are added up, and solved for again:

* A rigid motion strains no part. What assembly and rounding make of it is a false stiffness, as strong as a
  spring of 1e-16 E / L; the rigid part of a displacement is therefore taken away before it meets the
  stiffness.
* A spring too soft for the factors (below 1e-8 E / L) was factorised with more stiffness. The motions that
  such springs alone resist are rigid; their amplitudes follow from a small system of the springs alone.
* The force of a spring too stiff for them (above 1e5 E / L) is an unknown of its own, as in the method of
  augmented Lagrangians: it never is a difference of displacements.

Both make every correction smaller by many digits than the one before. What is left is reported: the last
correction times its rate, and the answer to the rounding errors of the matrices, of which one random sample
is solved for beside the correction. Where both together are far below the tolerance, no correction is made.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from latin_core import State

from dolfinx_frontend.assembly.held import held
from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import agreement, exchanged
from dolfinx_frontend.assembly.rigid import free_motions
from dolfinx_frontend.assembly.substructure import Substructure
from dolfinx_frontend.common.arrays import Array, Flags
from dolfinx_frontend.common.deferred import sp
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

AT_REST = 30.0
"""Strains below so many times those that rounding of the displacements makes are none where nothing acts."""
RESOLVED = 0.03
"""An error above this, relative to what a part or a spring does itself, is taken relative to the whole: what
it does may be nothing but rounding."""

Blocks = dict[str, Array]


@dataclass(frozen=True)
class _Part:
    """A part: stiffness, its diagonal, motions that do not strain it, inverse of their products, loads."""

    matrix: sp.csr_matrix
    diagonal: Array
    rigid: Array
    inverse: Array
    load: Array
    offset: Array
    dim: int

    @classmethod
    def of(cls, part: Substructure, load: Array, offset: Array) -> _Part:
        return cls(part.matrix, part.diagonal, *part.strainless, load, offset, part.dim)

    def strained(self, u: Array) -> Array:
        """A displacement less its rigid part."""
        return u - self.rigid @ (self.inverse @ (self.rigid.T @ u))

    def rounding(self, u: Array) -> Array:
        """Size of the forces that rounding errors of the stiffness make of a strained displacement.

        The squares of a row's other entries add up to about that of the diagonal.
        """
        node = np.sqrt(np.sum(u.reshape(-1, self.dim, u.shape[1]) ** 2, axis=1))
        size: Array = ROUNDING * np.sqrt(2.0) * self.diagonal[:, None] * np.repeat(node, self.dim, axis=0)
        return size


@dataclass(frozen=True)
class _Spring:
    """An eliminated spring: signed traces of its sides, stiffness times area as given and as factorised."""

    traces: tuple[tuple[str, sp.csr_matrix], ...]
    stiffness: Array
    factorised: Array
    jump: Array
    weights: Array
    softer: Flags = field(init=False)
    stiffer: Flags = field(init=False)

    def __post_init__(self) -> None:
        """Rows that were factorised with more stiffness than they have, and with less."""
        object.__setattr__(self, "softer", self.factorised > self.stiffness)
        object.__setattr__(self, "stiffer", self.factorised < self.stiffness)

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

    def of_parts(self, u: Blocks) -> Array:
        """Jumps (rows, columns) of displacements."""
        return sum((trace @ u[name] for name, trace in self.traces), start=np.zeros(()))

    def of_floating(self, motions: Blocks) -> Array:
        """Those of motions that its firm rows do not allow: what these see of them is rounding."""
        return np.where(self.softer[:, None], self.of_parts(motions), 0.0)

    def rounding(self, u: Blocks) -> Array:
        """Size of the rounding errors of these jumps."""
        levers = [(name, np.asarray(abs(trace).sum(axis=1))) for name, trace in self.traces]
        sizes: Array = np.sum([lever * np.abs(u[name]).max(axis=0) for name, lever in levers], axis=0)
        return ROUNDING * sizes

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
        self.floating: Array = np.zeros((self.soft.shape[0], len(plan.patterns)))
        self.strained: Blocks = {}
        self.reactions: Blocks = {}

    def _scale(self) -> None:
        """Make forces of about 1 of all that acts, in steps without rounding: squares stay numbers."""
        sizes = [part.load for part in self.parts.values()]
        moved = [part for part in self.parts.values() if part.offset.any()]
        sizes += [part.matrix @ part.strained(part.offset) for part in moved]
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
                holds = np.flatnonzero(interface.law.nominal.holds(interface.dim))
                firm = ~self.springs[name].softer.reshape(interface.num_points, -1)[:, holds]
            resisting.append(held(own, interface, firm))
        found = free_motions(sizes, resisting)
        if not len(found):
            return
        for name, part in own.substructures.items():
            self.motions[name] = found.at(name, part.dof_coordinates).reshape(part.size, -1)
        self.soft = np.zeros((len(found),) * 2)
        for name in soft:
            jumps = self.springs[name].of_floating(self.motions)
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
            jump = jump + spring.of_floating(self.motions) @ self.floating
        return jump

    def spring_force(self, name: str) -> Array:
        """Force of a spring times area, (rows, columns)."""
        spring = self.springs[name]
        if spring.stiffer.all():
            return self.forces[name]
        force = spring.stiffness[:, None] * self.free_jump(name)
        return np.where(spring.stiffer[:, None], self.forces[name], force)

    def residual(self) -> tuple[Blocks, Blocks]:
        """Forces on the parts that are not balanced; of stiff springs, jumps that do not fit their force."""
        self.strained = {n: p.strained(self.u[n]) for n, p in self.parts.items()}
        self.reactions = {n: p.matrix @ self.strained[n] for n, p in self.parts.items()}
        forces = {n: p.load - self.reactions[n] for n, p in self.parts.items()}
        gaps = {}
        for name, spring in self.springs.items():
            stiff = spring.stiffer[:, None]
            force = self.spring_force(name)
            gaps[name] = np.zeros_like(force)
            if spring.stiffer.any():
                np.divide(self.forces[name], spring.stiffness[:, None], out=gaps[name], where=stiff)
                gaps[name] = np.where(stiff, self.free_jump(name) - gaps[name], 0.0)
                force = force + spring.factorised[:, None] * gaps[name]
            spring.push(forces, force)
        return forces, gaps

    def rounding(self) -> tuple[Blocks, Blocks]:
        """A sample of what rounding of the matrices does: forces on the parts, and those of the springs."""
        random = np.random.default_rng(0)
        forces, of_springs = {}, {}
        for name, part in self.parts.items():
            size = part.rounding(self.strained[name])
            forces[name] = size * random.standard_normal(size.shape)
        for name, spring in self.springs.items():
            size = spring.rounding(self.displacements()) * random.standard_normal(spring.jump.shape)
            of_springs[name] = np.minimum(spring.stiffness, spring.factorised)[:, None] * size
            spring.push(forces, np.where(spring.stiffer[:, None], 0.0, of_springs[name]))
        return forces, of_springs

    @property
    def loaded(self) -> bool:
        """Whether anything acts beside displacements that are given."""
        acting = [p.load for p in self.parts.values()] + [s.jump for s in self.springs.values()]
        return any(each.any() for each in acting)

    @property
    def replaced(self) -> bool:
        """Whether stiffnesses were replaced for the factors."""
        return any(each.softer.any() or each.stiffer.any() for each in self.springs.values())

    def start(self) -> None:
        """From the solution that the factors give as it is."""
        kernel, amplitudes = self.solver, self.solver.plan.amplitudes
        nothing = np.zeros((0, amplitudes.shape[1]))
        fields = kernel.displacements(kernel.laws, State(nothing, nothing), amplitudes)
        self.u = {name: u / self.unit for name, u in fields.items()}

    def add(self, u: Blocks, floating: Array, spring_forces: Blocks) -> None:
        """Add a correction."""
        for name in self.u:
            self.u[name] = self.u[name] + u[name]
        self.floating = self.floating + floating
        for name, spring in self.springs.items():
            sum_of_both = self.forces[name] + spring_forces[name]
            self.forces[name] = np.where(spring.stiffer[:, None], sum_of_both, 0.0)

    def solve(self, forces: Blocks) -> tuple[Array, Blocks]:
        """Floating motions and displacements that answer forces, all but exactly."""
        if not self.motions:
            columns = next(iter(forces.values())).shape[1]
            return np.zeros((0, columns)), self.solver.response_to(forces)
        work = sum((self.motions[name].T @ force for name, force in forces.items()), start=np.zeros(()))
        scale = 1.0 / np.sqrt(np.diag(self.soft))
        scaled = scale[:, None] * self.soft * scale
        floating = scale[:, None] * np.linalg.lstsq(scaled, scale[:, None] * work, rcond=1e-14)[0]
        rest = {name: force.copy() for name, force in forces.items()}
        for spring in self.springs.values():
            if spring.softer.any():
                jump = spring.of_floating(self.motions) @ floating
                spring.push(rest, spring.stiffness[:, None] * jump)
        return floating, self.solver.response_to(rest)


@dataclass
class _Sizes:
    """Inner products (columns, columns) of what each part and spring does: in strain energy, in displacement,
    and of springs in their own energy."""

    strain: Blocks
    moved: Blocks
    spring: Blocks

    def of(self, columns: slice) -> _Sizes:
        """Of some of the columns."""
        blocks = (self.strain, self.moved, self.spring)
        return _Sizes(*({name: gram[columns, columns] for name, gram in each.items()} for each in blocks))


def _sizes(
    state: _Corrections, u: Blocks, strained: Blocks, reactions: Blocks, floating: Array, forces: Blocks
) -> _Sizes:
    """Sizes of displacements and floating motions, their strained parts and reactions, and spring forces."""
    strain = {name: strained[name].T @ reactions[name] for name in state.parts}
    moved, spring = {}, {}
    for name in state.parts:
        own = u[name] + state.motions[name] @ floating if state.motions else u[name]
        moved[name] = own.T @ own / len(own)
    for name, each in state.springs.items():
        acts = each.stiffness > 0.0
        force = forces[name][acts]
        spring[name] = force.T @ (force / each.stiffness[acts, None])
    return _Sizes(strain, moved, spring)


def _sizes_now(state: _Corrections) -> _Sizes:
    """Of the solution whose residual was formed last."""
    forces = {name: state.spring_force(name) for name in state.springs}
    return _sizes(state, state.u, state.strained, state.reactions, state.floating, forces)


def _sizes_of_change(state: _Corrections, u: Blocks, floating: Array, forces: Blocks) -> _Sizes:
    strained = {n: p.strained(u[n]) for n, p in state.parts.items()}
    reactions = {n: p.matrix @ strained[n] for n, p in state.parts.items()}
    return _sizes(state, u, strained, reactions, floating, forces)


def _representable(state: _Corrections) -> Blocks:
    """Inner products of the strain that rounding a displacement to a double makes."""
    out = {}
    for name, u in state.displacements().items():
        size = ROUNDING * np.sqrt(state.parts[name].diagonal)[:, None] * u
        out[name] = size.T @ size
    return out


def _quadratic(gram: Array, factors: Array) -> Array:
    """Sizes (T,) of combinations (columns, T) of columns."""
    squares: Array = np.einsum("at,ab,bt->t", factors, gram, factors)
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)), dtype=np.float64)


def _relative(errors: dict[str, Array], sizes: dict[str, Array], whole: Array) -> dict[str, Array]:
    """Errors (T,) relative to what each does itself, or to the whole where that may be rounding."""
    out = {}
    for name, error in errors.items():
        own = sizes[name]
        against = np.where(error <= RESOLVED * own, own, np.maximum(whole, own))
        # what is no number is not 0
        out[name] = np.divide(error, against, out=np.zeros_like(error), where=~(against <= 0.0))
    return out


def _errors(
    state: _Corrections, parts_of_it: list[tuple[float, _Sizes]], factors: Array, representable: bool = False
) -> dict[str, Array]:
    """Place -> relative errors (T,), of sizes times factors that are independent of each other."""
    now = _sizes_now(state)
    unloaded = not state.loaded
    rounded = _representable(state) if representable or unloaded else {}

    def size(kind: str, of: _Sizes) -> dict[str, Array]:
        return {name: _quadratic(block, factors) for name, block in getattr(of, kind).items()}

    out: dict[str, Array] = {}
    for kind, label in (("strain", "part"), ("moved", "part"), ("spring", "interface")):
        own = size(kind, now)
        left: dict[str, Array] = {name: np.zeros(factors.shape[1]) for name in own}
        for rate, of in parts_of_it:
            for name, each in size(kind, of).items():
                left[name] = np.hypot(left[name], rate * each)
        if kind == "strain" and representable:
            for name, block in rounded.items():
                left[name] = np.hypot(left[name], _quadratic(block, factors))
        blocks = list(own.values())
        if kind == "moved":
            whole = np.max(blocks, axis=0, initial=0.0) if blocks else np.zeros(factors.shape[1])
        else:
            energies = list(size("strain", now).values())
            if kind == "spring":  # soft ones hold far more energy than parts, which must not hide these
                energies += blocks
            whole = np.sqrt(np.sum(np.square(energies), axis=0))
            if unloaded:  # parts that are moved as they are strain by rounding alone: nothing is wrong then
                least = np.sqrt(sum(_quadratic(block, factors) ** 2 for block in rounded.values()))
                left = {name: np.where(whole <= AT_REST * least, 0.0, each) for name, each in left.items()}
        for name, each in _relative(left, own, whole).items():
            place = f"{label} {name}"
            out[place] = np.maximum(out[place], each) if place in out else each
    return out


def _largest(errors: dict[str, Array]) -> float:
    return float(np.max([each.max(initial=0.0) for each in errors.values()], initial=0.0))


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
    every = [each for each in exchanged(comm, found.accuracy) if each.places]
    values = np.hstack([each.values for each in every])
    places = tuple(place for each in every for place in each.places)
    return replace(found, accuracy=replace(every[0], values=values, places=places))


def _corrected(solver: Solver) -> Corrected:
    state, plan = _Corrections(solver), solver.plan
    if not state.parts:  # a rank without parts
        return Corrected(Accuracy(np.zeros((1, 0)), ("",), ()), {}, {})
    errors, count = _refine(state, plan.factors(), ENOUGH * plan.options.rtol)
    displacements = {name: state.unit * u for name, u in state.displacements().items()}
    springs = {}
    for name, spring in state.springs.items():
        per_area = state.unit * state.spring_force(name) / spring.weights[:, None]
        springs[name] = (per_area, state.unit * (state.free_jump(name) + spring.jump))
    return Corrected(_accuracy(plan, errors), displacements, springs, count)


def _refine(state: _Corrections, factors: Array, enough: float) -> tuple[dict[str, Array], int]:
    """Solve, and correct until `enough` or rounding is reached; errors left, and number of corrections."""
    columns = len(factors)
    if state.replaced:
        forces, gaps = state.residual()
        floating, u = state.solve(forces)
        state.add(u, floating, _spring_changes(state, u, floating, gaps))
        forces, gaps = state.residual()
    else:
        state.start()
        forces, gaps = state.residual()
        # residual and rounding at once: most solutions are right, and stay as they are
        of_rounding, of_springs = state.rounding()
        floating, u = state.solve({name: each + of_rounding[name] for name, each in forces.items()})
        changes = _spring_changes(state, u, floating, gaps)
        change = _sizes_of_change(state, u, floating, {n: c + of_springs[n] for n, c in changes.items()})
        errors = _errors(state, [(1.0, change)], factors, True)
        if _largest(errors) <= enough:
            return errors, 0
    before, number = 1.0, 0
    while True:
        number += 1
        of_rounding, of_springs = state.rounding()
        floating, u = state.solve(_together(forces, of_rounding))
        gaps = {name: np.hstack([gap, np.zeros_like(gap)]) for name, gap in gaps.items()}
        changes = _spring_changes(state, u, floating, gaps)
        for name, each in of_springs.items():
            changes[name][:, columns:] += each
        change = _sizes_of_change(state, u, floating, changes)
        found, noise = change.of(slice(columns)), change.of(slice(columns, None))
        now = _largest(_errors(state, [(1.0, found)], factors))
        first = {name: each[:, :columns] for name, each in u.items()}
        state.add(first, floating[:, :columns], {name: each[:, :columns] for name, each in changes.items()})
        forces, gaps = state.residual()
        # one correction does not say how fast they fall
        rate = min(now / before, 1.0) if number > 1 else 1.0
        left = now * rate
        if left <= enough or (number > 1 and rate > FALLING) or not np.isfinite(now) or number == MOST:
            return _errors(state, [(rate, found), (1.0, noise)], factors, True), number
        before = now


def _spring_changes(state: _Corrections, u: Blocks, floating: Array, gaps: Blocks) -> Blocks:
    """Changes of the forces of the springs that go with those of the displacements."""
    out = {}
    for name, spring in state.springs.items():
        jump = spring.of_parts(u)
        if state.motions and spring.softer.any():
            jump = jump + spring.of_floating(state.motions) @ floating
        stiff = spring.stiffer[:, None]
        force = spring.factorised[:, None] * (jump + gaps[name])
        out[name] = np.where(stiff, force, spring.stiffness[:, None] * jump)
    return out


def _accuracy(plan: Plan, errors: dict[str, Array]) -> Accuracy:
    values = np.array(list(errors.values())).T
    if plan.times is None:
        return Accuracy(values[:1], ("",), tuple(errors))
    groups = tuple(f"step {k}" for k in range(len(plan.times)))
    if len(values) == 1:  # nothing changes in time
        values = np.repeat(values, len(groups), axis=0)
    return Accuracy(values, groups, tuple(errors), tuple(range(len(groups))))
