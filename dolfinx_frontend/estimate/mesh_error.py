"""Estimated error of the meshes of an assembly: in energy, and in one number of interest.

In energy: recovered gradients, see :mod:`dolfinx_frontend.estimate.recovery`. In a total force or a mean jump
q of an interface (dual-weighted recovery): with z, the answer of the same structure to the load whose work is
q, q(u) - q(u_h) = a(u - u_h, z - z_h), and both errors are recovered (Oden and Prudhomme 2001). For the force
of an interface z is the answer to a unit jump imposed on it, for a mean jump to a unit force spread over it:
one more column of the factorised kernel of the result. For nonlinear laws z is the answer to a small
change, from the solution on: points that touch go on touching.

For a number at a point z is the answer to the load whose work is what the cell with the point gives. That is
a mean over the cell, weighted; how far the stress at the point is from it the recovered gradient there says.

What is not seen: the shape of curved faces that straight cells round off, the error of the law itself
between the points of an interface, and the algebraic error.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import astuple, dataclass, field
from time import perf_counter
from typing import NamedTuple

import numpy as np
from latin_core import Laws, State

from dolfinx_frontend.assembly.interface import Interface, frames
from dolfinx_frontend.assembly.matrix_part import has_mesh
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import agreement, exchanged, together
from dolfinx_frontend.assembly.substructure import Substructure
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.checks import check_known
from dolfinx_frontend.common.describe import short, shown_error
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.frozen import locked
from dolfinx_frontend.common.interrupts import Interrupted, stop_if_pressed
from dolfinx_frontend.common.statuses import STOPPED
from dolfinx_frontend.estimate.pieces import pieces_of, within_cell
from dolfinx_frontend.estimate.recovery import ASTRAY, Doubts, recovery
from dolfinx_frontend.estimate.transposed import Transposed
from dolfinx_frontend.estimate.unseen import of_shapes, of_springs, other_sides, walls_not_seen
from dolfinx_frontend.estimate.zones import contact_zones
from dolfinx_frontend.kernel import bridge
from dolfinx_frontend.kernel.fitting import fitted
from dolfinx_frontend.kernel.solver import Solver
from dolfinx_frontend.results.chaos import ChaosResult
from dolfinx_frontend.results.probes import AtPoint
from dolfinx_frontend.results.reactions import eliminated_fields, reaction
from dolfinx_frontend.results.result import Result
from dolfinx_frontend.results.resultant import (
    Interest,
    Measure,
    Quantile,
    Resultant,
    Wanted,
    interest,
    over_all_ranks,
)
from dolfinx_frontend.scene.amplitudes import check_step
from dolfinx_frontend.scene.laws import Law

__all__ = [
    "DeviationError",
    "DiscretisationError",
    "deviation_error",
    "discretisation_error",
    "with_dual",
]


SMALL = 1e-3
"""Size of the change that gives the tangent of a nonlinear law, relative to the largest displacement."""
MOST_MODES, MOST_VARIANCE = 6, 0.98
"""Modes whose errors are estimated at most; the share of the variance from which on no more are."""
TANGENT_RTOL = 1e-7
"""Tolerance of the two answers whose difference is taken for it."""


@dataclass(frozen=True)
class DiscretisationError:
    """Estimated error of the meshes.

    Attributes
    ----------
    energy
        Relative error in the energy norm of the parts: sqrt(a(u - u_h) / a(u_h)), a(v) = sum of v^T K v.
    parts
        Substructure -> its contribution to that; their squares add up to the square of `energy`.
    quantity
        Size of the error of the quantity of interest, in its unit; None: none was named. The larger of
        |correction| and the root of the sum of the squares of its contributions by cell: where these cancel,
        their sum is no estimate. On simplices of degree 2 and 3 more where few cells have most of it, as at
        singular edges; on such tetrahedra at least half of the sum without signs, on linear hexahedra a tenth
        of what cancels more.
    value
        The quantity in the result.
    correction
        The same error with its sign: value + correction is the better value.
    bound
        sqrt(a(e_u) a(e_z)), which no error exceeds: what is left of it is cancellation, on which to count is
        a risk where stresses are singular. None: not known, as where a contact slips or opens in part: z has
        its slopes at the answer, and the edge of its zone may be elsewhere on another mesh.
    shares
        Substructure -> its contribution to `correction`.
    seconds
        Wall time: ``recovery`` and ``dual`` (the solve for the quantity).
    cells
        Part of this rank -> (cells,), what each contributes without its sign: the square roots of
        a(e_u) a(e_z) by cell, of the energy a(e_u); their sums tell where meshes decide. Of a mesh that is
        spread over the ranks all cells, those of the first rank first.
    norm
        sqrt(a(u_h)), the energy norm of the result.
    round
        Substructure -> error of the quantity by its straight cells on round faces, in its unit; without a
        quantity of the energy, relative. In no other number here.
    means
        Interface -> error of the quantity by springs on means over vertices or facets, likewise.
    seen
        As `quantity`, without what is added for singular stresses.
    uncancelled
        sqrt(a(e_u) a(e_z)), also where it is no bound.
    """

    energy: float
    parts: dict[str, float]
    quantity: float | None = None
    value: float | None = None
    correction: float | None = None
    bound: float | None = None
    shares: dict[str, float] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict, compare=False)
    cells: dict[str, Array] = field(default_factory=dict, repr=False, compare=False)
    norm: float = field(default=0.0, repr=False)
    round: dict[str, float] = field(default_factory=dict, compare=False)
    means: dict[str, float] = field(default_factory=dict, compare=False)
    seen: float = field(default=0.0, repr=False, compare=False)
    uncancelled: float = field(default=0.0, repr=False, compare=False)

    def __post_init__(self) -> None:
        locked(self)

    def relative(self) -> float:
        """Error of the quantity of interest relative to its value.

        Raises
        ------
        SceneError
            No quantity was named.
        """
        if self.quantity is None or self.value is None:
            raise SceneError("no quantity of interest: discretisation_error(result, Resultant('interface'))")
        if self.value == 0.0:
            return 0.0 if self.quantity == 0.0 else float("inf")
        return self.quantity / abs(self.value)

    @property
    def unseen(self) -> float:
        """What `round` and `means` come to."""
        return sum(self.round.values()) + sum(self.means.values())

    def __str__(self) -> str:
        worst = max(self.parts, key=lambda name: self.parts[name])
        text = f"discretisation: {self.energy:.2g} in energy, most of it in {worst}"
        if self.quantity is None:
            return text
        return f"{text}; quantity of interest {self.value:.6g} +- {self.quantity:.2g}"


def with_dual(problem: Problem, quantity: Wanted | None) -> Resultant | AtPoint | None:
    """The quantity, or that of which it is a quantile, if it has a dual problem, at points in the meshes of a
    problem; None: it has none. Collective."""
    if isinstance(quantity, Quantile):
        quantity = quantity.inner
    if isinstance(quantity, Resultant):
        return quantity
    if not isinstance(quantity, Measure) or not isinstance(quantity.function, AtPoint):
        return None
    return quantity.function.on(problem)


@together("discretisation_error")
def discretisation_error(
    result: Result, quantity: Interest = None, step: int = -1
) -> DiscretisationError:
    """Estimate the error of the meshes in a result; collective on several ranks.

    The quantity costs one more solution with the factors of the result; of a chaos, and of laws that are not
    linear, two.

    Parameters
    ----------
    result
        Of :func:`dolfinx_frontend.solve`. Of a chaos: the error of the mean field, with a dual problem at the
        mean of the parameters.
    quantity
        A total force or a mean jump of an interface; a name means its total normal force. Or an
        :class:`AtPoint`, which has its own step.
    step
        Of a load history. Laws with memory: the dual problem is that of a change from the beginning on.

    Raises
    ------
    KeyboardInterrupt
        At Ctrl-C.
    SceneError
        A result without fields, an unknown interface, a quantity with no dual problem, one that did not
        converge, or walls of revolution of one linear cell across.
    """
    if not hasattr(result, "without_recovery"):
        raise SceneError(f"discretisation_error: result = {short(result)}; give a result of solve")
    if result.without_recovery is not None:
        raise SceneError(result.without_recovery)
    if result.plan.varied:
        raise SceneError(
            f"discretisation_error: the stiffness of {', '.join(map(repr, result.plan.varied))} is random; "
            "take the result of solve(problem), at the means"
        )
    check_step(result.times, step, "discretisation_error")
    problem = result.problem
    wanted = interest(problem.interfaces, quantity)
    number = with_dual(problem, wanted)
    if wanted is not None and number is None:
        raise SceneError(
            f"discretisation_error: {wanted} has no dual problem; give a Resultant, an AtPoint, or None for "
            "the energy"
        )
    problem.check_alike("discretisation_error", quantity=wanted, step=step)
    at = number if isinstance(number, AtPoint) else None
    if at is None and (blind := walls_not_seen(problem)):
        raise SceneError(
            f"discretisation_error: substructure {blind[0]!r} is a wall of revolution of one linear cell "
            "across, whose stresses tell nothing of their error; give degree=2, or more cells across"
        )
    if at is not None:
        step = check_step(result.times, at.step, "discretisation_error") if result.times is not None else -1
    with agreement(problem.comm):
        problem.check_sources()
    fields = {name: _at(result, u, step) for name, u in result.displacements.items()}
    began = perf_counter()
    pieces = pieces_of(problem)
    whole_fields = {name: result.displacement(name, step) for name in pieces}
    dual: _Dual | None = None
    value = None
    if number is not None:
        dual = _Dual.of(result, number, step, fields)
        value = _value(result, number, step, fields)
    slopes = None if at is None else _slopes(result, at)
    inside: dict[str, Array] = {}
    if at is not None and at.part in pieces:
        inside[at.part] = over_all_ranks(at.inside, problem)(result.shown())
    z = {} if dual is None else dual.solve()
    solved = perf_counter()
    with agreement(problem.comm), np.errstate(over="ignore", invalid="ignore"):  # told below
        cells: dict[str, Array] = {}
        found = {}
        for name, part in problem.own.substructures.items():
            stop_if_pressed()
            if not has_mesh(part):  # what a matrix has lost is not known
                norm = float(fields[name] @ (part.matrix @ fields[name]))
                found[name], cells[name] = _Errors(norm), np.zeros(0)
            elif name not in pieces:
                found[name], cells[name] = _Errors.of(part, fields[name], z.get(name))
        local = 0.0
        if at is not None and slopes is not None and at.part in cells:
            part, u = at.problem.substructures[at.part], fields[at.part]
            local = within_cell(at, part, at.place, u, u, slopes[1])
            cells[at.part][at.cell] += local
    if at is not None and at.part in pieces:
        local = pieces[at.part].within_cell(at, whole_fields[at.part], inside[at.part])
    if at is not None and problem.comm is not None:
        local = max(exchanged(problem.comm, local))
    shapes: dict[str, float] = {}
    whole_duals = {}
    for name, piece in pieces.items():
        whole_duals[name] = whole_fields[name] if dual is None else piece.whole.answer(z.get(name))
        if name in inside:
            whole_duals[name].x.array[:] += piece.whole.held(inside[name]).x.array
        both = [whole_fields[name]] if dual is None else [whole_fields[name], whole_duals[name]]
        found[name], of_cells = _Errors.summed(*piece.by_cell(*both))
        if name in problem.own.substructures:
            cells[name] = of_cells
            if at is not None and at.part == name:
                cells[name][at.cell] += local
    found = problem.gather(found, parts=True)
    # of rigid motions rounding may leave an energy below 0
    whole = float(np.sqrt(max(sum(each.norm for each in found.values()), 0.0)))
    if not np.isfinite(whole):
        raise SceneError(
            "discretisation_error: the energies of the result leave the range of numbers; scale the loads, "
            "or choose units that fit them"
        )
    parts = {n: float(np.sqrt(each.error)) / whole if whole else 0.0 for n, each in found.items()}
    seconds = {"dual": solved - began, "recovery": perf_counter() - solved}
    total = sum(found.values(), start=_Errors())
    energy = float(np.sqrt(total.error)) / whole if whole else 0.0
    size = value if value is not None else whole**2
    others = other_sides(problem, fields, z or fields)
    for name, piece in pieces.items():
        shapes[name] = piece.of_shape(whole_fields[name], whole_duals[name], size)
    shapes = {name: error for name, error in shapes.items() if error != 0.0}
    with agreement(problem.comm):
        shapes |= of_shapes(problem, fields, z, size)
        means = of_springs(problem, fields, z or fields, others)
    shapes, means = problem.gather(shapes, parts=True), problem.gather(means)
    if number is None:
        squared = max(whole**2, 1e-300)
        shapes, means = ({n: 0.5 * e / squared for n, e in each.items()} for each in (shapes, means))
        return DiscretisationError(
            energy, parts, seconds=seconds, cells=cells, norm=whole, round=shapes, means=means
        )
    zones = contact_zones(result, step)
    moves = bool(zones.edges or zones.alike)
    uncancelled = float(np.sqrt(total.error * total.of_dual)) + local
    seen = max(abs(total.product), float(np.sqrt(total.squares))) + local
    size = max(abs(total.more), total.least, (1.0 - ASTRAY) * abs(total.product) + total.astray) + local
    return DiscretisationError(
        energy,
        parts,
        max(seen, size),
        value,
        total.product,
        None if moves else uncancelled,
        {name: each.product for name, each in found.items()},
        seconds,
        cells,
        whole,
        shapes,
        means,
        seen,
        uncancelled,
    )


def _slopes(result: Result, at: AtPoint) -> tuple[Ints, Array]:
    """See :meth:`AtPoint.slopes`; collective."""
    found: tuple[Ints, Array] = over_all_ranks(at.slopes, result.problem)(result.shown())
    return found


class DeviationError(NamedTuple):
    """Estimated error of a deviation by the meshes; see `DiscretisationError`. `cells` of all parts."""

    std: float
    quantity: float
    bound: float
    cells: dict[str, Array]


def deviation_error(result: Result, chaos: ChaosResult, quantity: Resultant) -> DeviationError:
    """Estimate what the meshes do to the deviation of a quantity; collective.

    Each mode of a chaos is the answer to loads of its own; its error is weighted with the dual solution at
    the means. Errors of modes are added as if none cancelled another: sqrt(sum of squares). How the
    randomness of a stiffness changes the dual solution is left out.

    Parameters
    ----------
    result, chaos
        Of the same problem: with what is random at its mean, and a chaos of order 1.
    """
    fields = {name: _at(result, u, -1) for name, u in result.displacements.items()}
    z = _Dual.of(result, quantity, -1, fields)
    modes = chaos.resultant_coefficients(quantity)[1:]
    std = float(np.sqrt(np.sum(modes**2)))
    order = np.argsort(-(modes**2), kind="stable")
    share = np.cumsum(modes[order] ** 2) / max(std**2, 1e-300)
    count = min(int(np.searchsorted(share, MOST_VARIANCE)) + 1, MOST_MODES, len(modes))
    left_out = 1.0 / max(float(np.sqrt(share[count - 1])), 0.1)
    if z is None or std == 0.0:
        return DeviationError(std, 0.0, 0.0, {})
    dual = z.solve()
    found: dict[str, _OfModes] = {}
    problem = result.problem
    chosen = [int(mode) for mode in order[:count]]
    pieces = pieces_of(problem)
    with agreement(problem.comm):
        for name, part in problem.own.substructures.items():
            if name in pieces or not has_mesh(part):
                continue
            made, block = recovery(part), chaos.coefficients(name)[..., 1:]
            fields_of = (u if u.ndim == 1 else u[-1] for u in (block[..., k] for k in chosen))
            found[name] = _of_modes((made.energies([u, dual[name]]), made.doubts) for u in fields_of)
    for name, piece in pieces.items():
        z_whole = piece.whole.answer(dual.get(name))
        fields_on = (chaos.mode_on_all_ranks(name, mode) for mode in chosen)
        # the norm is of no use here
        found[name] = _of_modes(piece.by_cell(u, z_whole)[1:] for u in fields_on)
    found = problem.gather(found, parts=True)
    cells = {name: of_part.cells for name, of_part in found.items()}
    sums = np.sum([of_part.sums for of_part in found.values()], axis=0)
    whole_dual = sum(of_part.of_dual for of_part in found.values())
    signed = np.abs(sums[:, 1])
    astray = (1.0 - ASTRAY) * signed + sums[:, 4]
    each = np.max([signed, np.sqrt(sums[:, 2]), sums[:, 3], astray], axis=0)
    bound = float(np.sqrt(sums[:, 0].sum() * whole_dual))
    return DeviationError(std, left_out * float(np.linalg.norm(each)), left_out * bound, cells)


class _OfModes(NamedTuple):
    """Of a part: sums (modes, 5), a(e_z), and what each cell contributes."""

    sums: Array
    of_dual: float
    cells: Array


def _of_modes(every: Iterable[tuple[Array, Doubts]]) -> _OfModes:
    """From what :meth:`Recovery.energies` says of each mode and of the dual solution."""
    rows, own, of_dual, more = [], np.zeros(1), np.zeros(1), 1.0
    for by_cell, doubts in every:
        stop_if_pressed()
        sizes = np.sqrt(np.maximum(by_cell[0, 0] * by_cell[1, 1], 0.0))
        more = doubts.missed(sizes)
        of_mode, weighted, of_dual = by_cell[0, 0], by_cell[0, 1], by_cell[1, 1]
        apart, astray = doubts.least * sizes.sum(), doubts.astray * sizes.sum()
        rows.append([more * of_mode.sum(), more * weighted.sum(), np.sum(weighted**2), apart, astray])
        own = own + of_mode
    return _OfModes(np.array(rows), more * float(of_dual.sum()), np.sqrt(np.maximum(own * of_dual, 0.0)))


@dataclass(frozen=True)
class _Errors:
    """Sums over the cells of a part: a(u), a(e_u), a(e_z), a(e_u, e_z), of the squares of its cells, the
    product with what fits do not see, and the shares of sqrt(a(e_u) a(e_z)) of `Doubts`."""

    norm: float = 0.0
    error: float = 0.0
    of_dual: float = 0.0
    product: float = 0.0
    squares: float = 0.0
    more: float = 0.0
    least: float = 0.0
    astray: float = 0.0

    @classmethod
    def of(cls, part: Substructure, u: Array, z: Array | None) -> tuple[_Errors, Array]:
        """The sums, and what each cell contributes without its sign."""
        made = recovery(part)
        by_cell = made.energies([u] if z is None else [u, z])
        return cls.summed(float(u @ (part.matrix @ u)), by_cell, made.doubts)

    @classmethod
    def summed(cls, norm: float, by_cell: Array, doubts: Doubts) -> tuple[_Errors, Array]:
        """The same from what :meth:`Recovery.energies` says of the solution, and of the dual one after it."""
        errors = by_cell[0, 0]
        if len(by_cell) == 1:
            return cls(norm, doubts.missed(errors) * float(errors.sum())), errors
        product, of_dual = by_cell[0, 1], by_cell[1, 1]
        sizes = np.sqrt(np.maximum(errors * of_dual, 0.0))
        more = doubts.missed(sizes)
        sums = cls(
            norm,
            more * float(errors.sum()),
            more * float(of_dual.sum()),
            float(product.sum()),
            float(product @ product),
            more * float(product.sum()),
            doubts.least * float(sizes.sum()),
            doubts.astray * float(sizes.sum()),
        )
        return sums, sizes

    def __add__(self, other: _Errors) -> _Errors:
        return _Errors(*(a + b for a, b in zip(astuple(self), astuple(other), strict=True)))


def _at(result: Result, field: Array, step: int) -> Array:
    """A field of a result at a time step, if it has steps."""
    times = result.plan.times
    if times is None:
        return field
    return np.asarray(field[check_step(times, step, "discretisation error")])


# --- the quantity ----------------------------------------------------------------------------------
def _axes(interface: Interface, normals: Array) -> Array:
    """Directions (components, points, d) of the components of an interface's force."""
    own = interface.law.directions(interface.dim)
    if own is not None:
        return np.repeat(own[:, None], len(normals), axis=1)
    basis, _ = frames(normals, interface.tangent_axis)
    return np.moveaxis(basis[:, : interface.law.count(interface.dim)], 0, 1)


def _reaction(result: Result, quantity: Resultant) -> tuple[int, Array, Array]:
    """Side of an eliminated support or glue, directions (nodes, d), its nodal forces ([T], nodes, d).

    On the rank that has its parts: what lies between ranks is not eliminated.
    """
    name = quantity.interface
    if result.statistics != "value":
        raise SceneError(
            f"interface {name!r} was assembled across, its mean force is not known: solve with "
            f"active=[{name!r}]"
        )
    interface = result.problem.interfaces[name]
    held = reaction(result, name, alone=True)
    if held is None:
        raise SceneError(
            f"interface {name!r} shares nodes with others that hold them, its own force is not known: solve "
            f"with active=[{name!r}]"
        )
    number, nodal = held.side, held.forces(result.shown())[0]
    axes = _axes(interface, (1.0 - 2.0 * number) * interface.sides[number].node_normals)
    if quantity.component >= len(axes):
        raise SceneError(
            f"interface {name!r} carries {len(axes)} component(s), not component {quantity.component}"
        )
    return number, axes[quantity.component], nodal


def _is_reaction(result: Result, name: str) -> bool:
    return name not in result.plan.active and result.problem.interfaces[name].law.prescribes == "jump"


def _value(
    result: Result, quantity: Resultant | AtPoint, step: int, fields: Mapping[str, Array]
) -> float:
    """The quantity in the result, at a step; collective."""
    if isinstance(quantity, AtPoint):
        return float(over_all_ranks(quantity, result.problem)(result.shown())[0])
    name = quantity.interface
    if quantity.of == "force" and _is_reaction(result, name):

        def total() -> float:
            _, along, nodal = _reaction(result, quantity)
            return float(np.sum(along * nodal[step if result.plan.times is not None else 0]))

        return float(result.problem.everywhere(name, total))
    interface = result.problem.interfaces[name]

    def read() -> tuple[Array, Array]:
        if name in result.plan.active:
            return _at(result, result.force(name), step), _at(result, result.jump(name), step)
        law = interface.law if result.plan.times is None else interface.law.at(result.plan.times[step])
        force, jump = eliminated_fields(interface, [law], lambda part, rows: fields[part][None, None, rows])
        return force[0, 0], jump[0, 0]

    force, jump = result.problem.everywhere(name, read)
    return float(quantity.total(force if quantity.of == "force" else jump, interface.weights))


@dataclass(frozen=True)
class _Dual:
    """The dual problem of a quantity: one change of the problem whose answer, per unit, is z.

    Attributes
    ----------
    loads
        Substructure of this rank -> forces (n,) per unit of change.
    jump
        Active interface -> change of its imposed jump (rows, 1).
    lift
        Substructure -> displacements (n,) that come on top of the answer.
    unit
        Size of a change that moves the structure as much as the loads of the scene do.
    column
        Column of the kernel that is asked about.
    size
        Of the displacements.
    """

    result: Result
    loads: dict[str, Array]
    jump: dict[str, Array]
    lift: dict[str, Array]
    unit: float
    column: int
    size: float

    @classmethod
    def of(
        cls, result: Result, quantity: Resultant | AtPoint, step: int, fields: Mapping[str, Array]
    ) -> _Dual | None:
        """The dual problem; None where the scene prescribes the quantity. Collective."""
        if isinstance(quantity, AtPoint):
            return cls._of_point(result, quantity, step, fields)
        problem, plan, name = result.problem, result.plan, quantity.interface
        check_known("interface", name, problem.interfaces, "problem")
        loads: dict[str, Array] = {}
        jump: dict[str, Array] = {}
        lift: dict[str, Array] = {}
        with agreement(problem.comm):
            law, component = problem.interfaces[name].law, quantity.component
            if name in problem.own.interfaces:
                _check_component(problem.interfaces[name], quantity)
            if quantity.of == "jump":
                if law.prescribes == "jump":
                    return None
                loads = _pull(problem, quantity, None)
            elif law.prescribes == "force" or (
                law.controlled(None) and component == 0 and plan.times is None
            ):
                return None
            elif law.controlled(None):
                raise SceneError(
                    f"interface {name!r}: the kernel has no dual problem for {quantity} of a preload; ask "
                    "for the mean jump, or model the bolt as Elastic(jump=...)"
                )
            elif name in plan.active:
                if name in problem.own.interfaces:
                    jump[name] = _unit_jump(result, name, component)
            elif _is_reaction(result, name) and name in problem.own.interfaces:
                number, along, _ = _reaction(result, quantity)
                side = problem.interfaces[name].sides[number]
                part = problem.substructures[side.substructure]
                unit = np.zeros((part.size // part.dim, part.dim))
                unit[side.nodes] = (2.0 * number - 1.0) * along
                lift[part.name] = unit.ravel()
                loads[part.name] = -(part.matrix @ unit.ravel())
            elif not _is_reaction(result, name):
                loads = _pull(problem, quantity, law)
        size = _largest(problem, fields)
        parts = [problem.parts[side.substructure] for side in problem.interfaces[name].sides]
        size = unit_ = size or min(part.length for part in parts)
        if quantity.of == "jump":  # of forces, whose sum is 1
            unit_ *= min(part.modulus * part.length ** (part.dim - 2) for part in parts)
        return cls(result, loads, jump, lift, unit_, _column(result, step), size)

    @classmethod
    def _of_point(cls, result: Result, at: AtPoint, step: int, fields: Mapping[str, Array]) -> _Dual:
        part = result.problem.parts[at.part]
        unknowns, slopes = _slopes(result, at)
        loads: dict[str, Array] = {}
        if at.part in result.problem.substructures:
            loads[at.part] = np.zeros(part.size)
            loads[at.part][unknowns] = slopes
        size = unit = _largest(result.problem, fields) or part.length
        # forces of 1, or slopes of a stress, modulus / length
        unit *= part.length ** (part.dim - 1) * (1.0 if at.of == "stress" else part.modulus / part.length)
        return cls(result, loads, {}, {}, unit, _column(result, step), size)

    @property
    def amount(self) -> float:
        """Size of the change that is solved: a small one where laws are nonlinear."""
        return self.unit if _linear(self.result) else SMALL * self.unit

    def solve(self) -> dict[str, Array]:
        """z by substructure of this rank, (n,); collective."""
        result, plan = self.result, self.result.plan
        solver, laws, amplitudes = result.solver, result.mean_laws, plan.amplitudes
        pattern = int(np.argmax(np.abs(amplitudes[:, self.column])))
        factor = float(amplitudes[pattern, self.column])
        with agreement(result.problem.comm):
            if self.loads and factor == 0.0:
                raise SceneError("no load pattern acts at this time: choose another step")
        if not _linear(result):
            found = self._with_transposed_slopes(laws, pattern, factor)
            if found is not None:
                return found
        before = self._base(laws)
        base: Mapping[str, Array]
        if before is result.state and plan.times is None:
            base = {name: u[:, None] for name, u in result.displacements.items()}
        else:
            base = solver.displacements(laws, before, amplitudes)
        if solver.space is None:
            changed = self._changed(laws, pattern, factor)
            moved = solver.displacements(changed, self._run(changed, [before]), amplitudes)
        else:
            moved = self._in_own_basis()
        out = {}
        for name in result.problem.own.substructures:
            difference = moved[name][:, self.column] - base[name][:, self.column]
            out[name] = difference / self.amount + self.lift.get(name, 0.0)
        return out

    def _with_transposed_slopes(self, laws: Laws, pattern: int, factor: float) -> dict[str, Array] | None:
        """z of nonlinear laws, by their slopes at the answer; None: these leave something free.

        The force of a point that slides follows the pressure, and the pressure not the force: with slopes as
        they are the answer to a jump would say that no error matters to the force.
        """
        result, c = self.result, self.column
        solver, state, amplitudes = result.solver, result.mean_state, result.plan.amplitudes
        if state is None or solver.space is not None or not solver.total_rows:
            return None
        loaded = laws.with_(extra_loads=self._extra(pattern, 1.0 / factor)) if self.loads else None
        made = Transposed(solver, laws, state.data, amplitudes, c, self.size)
        found = made.answer(self.jump, loaded)
        if found is None:
            return None
        base = solver.displacements(laws, State(made.data, made.traces), amplitudes)
        there = State(made.data + found[0], made.traces + found[1])
        moved = solver.displacements(loaded or laws, there, amplitudes)
        own = result.problem.own.substructures
        return {n: moved[n][:, c] - base[n][:, c] + self.lift.get(n, 0.0) for n in own}

    def _base(self, laws: Laws) -> State:
        """The state that the change starts from: that of the result where it is good enough."""
        state = self.result.mean_state
        if state is not None and _linear(self.result):
            return state
        return self._run(laws, [] if state is None else [state])

    def _in_own_basis(self) -> dict[str, Array]:
        """Displacements with the change by multigrid: the basis of the result is not made for them."""
        problem, plan = self.result.problem, self.result.plan
        amplitudes = np.vstack([plan.amplitudes, np.full(plan.amplitudes.shape[1], self.amount)])

        def applied(laws: Laws) -> Laws:
            return laws.with_(parameters=self._jumps(laws))

        solver, start = fitted(problem, plan, applied, amplitudes, amplitudes.shape[1], self.loads)
        laws = applied(solver.laws)
        return solver.displacements(laws, self._run(laws, start, solver, amplitudes), amplitudes)

    def _run(
        self,
        laws: Laws,
        start: list[State],
        solver: Solver | None = None,
        amplitudes: Array | None = None,
    ) -> State:
        solver, options = solver or self.result.solver, self.result.plan.options
        amplitudes = self.result.plan.amplitudes if amplitudes is None else amplitudes
        if not _linear(self.result):
            options = options.with_(rtol=min(options.rtol, TANGENT_RTOL))
        warm = start if solver.total_rows else []
        for states in (warm, []) if warm else ([],):
            summary, state = solver.run(laws, options, amplitudes, states, progress=False)
            if summary.status == "converged":
                return state
            if summary.status in STOPPED:
                raise Interrupted
        raise SceneError(
            f"the dual problem ended as {summary.status} after {summary.iterations} iterations (estimated "
            f"error {shown_error(summary.error)}); without a quantity discretisation_error(result) needs "
            "none, and the same scene "
            "on a finer mesh tells the error of a quantity as well"
        )

    def _changed(self, laws: Laws, pattern: int, factor: float) -> Laws:
        """The laws with the change; loads act by a pattern, which has this factor at the time."""
        extra = self._extra(pattern, self.amount / factor)
        return laws.with_(parameters=self._jumps(laws), extra_loads=extra)

    def _extra(self, pattern: int, factor: float) -> dict[str, Array]:
        """The loads as a pattern with a factor."""
        extra: dict[str, Array] = {}
        for name, load in self.loads.items():
            extra[name] = np.zeros((len(load), self.result.solver.loads), order="F")
            extra[name][:, pattern] = factor * load
        return extra

    def _jumps(self, laws: Laws) -> dict[str, dict[str, Array]]:
        """Jumps with the change."""
        return {
            name: {"jump": laws.parameter(name, "jump") + self.amount * jump}
            for name, jump in self.jump.items()
        }


def _largest(problem: Problem, fields: Mapping[str, Array]) -> float:
    """The largest displacement; collective."""
    size = max((float(np.abs(u).max()) for u in fields.values()), default=0.0)
    return size if problem.comm is None else float(max(exchanged(problem.comm, size)))


def _column(result: Result, step: int) -> int:
    """The column of the kernel that has a step."""
    plan = result.plan
    return step % len(plan.times) if plan.times is not None and plan.history == "steps" else 0


def _linear(result: Result) -> bool:
    """Whether all laws of the iteration are linear."""
    return all(result.problem.interfaces[n].law.linear for n in result.plan.active)


def _check_component(interface: Interface, quantity: Resultant) -> None:
    count = interface.law.count(interface.dim)
    if quantity.component >= count:
        raise SceneError(
            f"interface {interface.name!r} carries {count} component(s), not component {quantity.component}"
        )


def _unit_jump(result: Result, name: str, component: int) -> Array:
    """Imposed jump of 1 in one component of an active interface, (rows, 1)."""
    interface = result.problem.interfaces[name]
    count = bridge.active_fields(interface, result.plan).components
    unit = np.zeros((interface.num_points, count))
    unit[:, component] = 1.0
    return unit.reshape(-1, 1)


def _pull(problem: Problem, quantity: Resultant, springs: Law | None) -> dict[str, Array]:
    """Forces on the sides that are on this rank whose work is the quantity: B^T W k, or B^T W / area."""
    name = quantity.interface
    out: dict[str, Array] = {}
    if name not in problem.own.interfaces:
        return out
    interface = problem.interfaces[name]
    density = np.zeros((interface.num_points, interface.dim))
    if springs is None:
        density[:, quantity.component] = 1.0 / interface.weights.sum()
    else:
        c = quantity.component
        density[:, c] = springs.nominal.stiffnesses(interface)[:, c]
    local = (interface.weights[:, None] * density).ravel()
    for number, side in enumerate(interface.sides):
        if side.substructure in problem.own.substructures:
            pull = (2.0 * number - 1.0) * (interface.local_trace(number).T @ local)
            out[side.substructure] = out.get(side.substructure, 0.0) + pull
    return out
