"""The crossing into the kernel: the only module that builds its objects.

A planned problem becomes bodies (substructures glued by prolongations) and active interfaces, each
with a kernel law, local frames and search directions.
"""

from __future__ import annotations

import logging
from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from latin_core import Laws, NumericalError, Structure, _core

from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.meeting import refuse
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import agreement, exchanged
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.frozen import locked
from dolfinx_frontend.common.threads import alone
from dolfinx_frontend.kernel.motions import motions_of, on_side
from dolfinx_frontend.kernel.user_laws import batched
from dolfinx_frontend.plan.coarse import basis
from dolfinx_frontend.plan.plan import Plan, check_reach
from dolfinx_frontend.plan.prescribed import check_prescribed, moments_of
from dolfinx_frontend.plan.reduction import Body, count_bodies, factorised_stiffness, reduce
from dolfinx_frontend.scene.amplitudes import Amplitude
from dolfinx_frontend.scene.laws import Fields, resolve
from dolfinx_frontend.scene.loads import LoadTerm

__all__ = [
    "Acting",
    "Built",
    "Description",
    "active_fields",
    "build",
    "definite",
    "describe",
    "laws",
    "spring_stiffness",
]


_log = logging.getLogger(__name__)

Pattern = Amplitude | LoadTerm | None
"""What has a load pattern: an amplitude, what is constant in time (None), or a load of a part that varies."""

Values = dict[str, Any]
"""Arguments of one of the kernel's descriptions, by name."""

HELD, PUSHED = 1e3, 1e-3
"""Search direction of a paired boundary interface, relative to factor * E / L: with prescribed
displacements far above the stiffness of any part, with prescribed forces far below."""

# contacts take a third, E / L by default; `./run bench iterations` measures it
CONTACT = 1.0 / 3.0
SOFTEST = 1e-3
"""Smallest search direction of an elastic interface, relative to factor * E / L."""

GIVEN_REACH = 1e10
"""As :data:`dolfinx_frontend.plan.plan.REACH`, of one interface, whose own springs may be soft or stiff."""

LARGEST = 1e300
"""Largest force or displacement of a direct solution: sums of them must fit into double precision."""

RANGE = 1e130
"""Largest strain of an iteration, and the inverse of the smallest: squares, moduli and tolerances must fit
beside it into double precision."""


def _scale(problem: Problem, plan: Plan, interface: Interface) -> float:
    """E / L of the scene, or of one point what takes its place."""
    if interface.one_point:
        return interface.stiffness_unit(problem.parts, problem.modulus)
    return problem.modulus / (plan.direction.length or problem.length)


def _direction(problem: Problem, plan: Plan, interface: Interface, fields: Fields, bodies: int) -> Array:
    """Search direction k of an interface, (components * m,), the same on both sides."""
    given = plan.direction.given.get(interface.name)
    usual = problem.modulus / problem.length
    if interface.one_point:
        usual = _scale(problem, plan, interface)
    if given is not None:
        per_point = resolve(given, interface, 1, name="search direction")
        if per_point.size and per_point.min() > 0.0:  # others are refused by the kernel
            what = f"what is given for interface {interface.name!r}"
            check_reach(what, per_point.min() / usual, per_point.max() / usual, reach=GIVEN_REACH)
        return np.repeat(per_point.ravel(), fields.components)
    assert plan.direction.factor is not None  # the plan fills it in
    law = interface.law
    patch = law.search_direction == "patch"
    unit = plan.direction.factor * _scale(problem, plan, interface)
    if plan.direction.length is not None and not interface.one_point:
        check_reach(f"with length = {plan.direction.length:g} it", unit / usual, reach=GIVEN_REACH)
    if plan.direction.length is None and not interface.one_point:
        shorter = 1.0
        if plan.macro:
            shorter = bodies ** (1.0 / interface.dim)  # E / L of a body instead of the scene
        if patch:
            # a body yields to a contact over the size of the contact, where that is smaller than the body's
            size = interface.area ** (1.0 / (interface.dim - 1))
            shorter = max(shorter, problem.length / size)
        unit *= shorter
    if patch and plan.method == "accelerated" and not plan.macro:
        unit *= CONTACT
    k: Array = np.full((interface.num_points, fields.components), unit)
    if law.search_direction == "springs" and plan.method == "accelerated":
        # a soft interface carries little: the direction that suits it is twice its own stiffness
        kappa = law.nominal.stiffnesses(interface)[:, : fields.components]
        k = np.clip(2.0 * kappa, SOFTEST * k, k)
    if interface.name in plan.paired and len(interface.sides) == 1:
        k *= HELD if law.rigid and not law.unilateral else PUSHED
    if fields.softest is not None:
        k = np.maximum(k, fields.softest)
    return k.ravel()


def _law(interface: Interface, fields: Fields) -> str | _core.Law:
    """The kernel's law: a name, or an object for a law that is given by functions."""
    law = interface.law.functions
    if law is None:
        return fields.kind
    if law.compiled is None:
        names = [(name, -np.inf) for name in law.values]
        return _core.python_law(
            name=law.label,
            parameters=names,
            history=law.history,
            resolve=batched(law, interface),
        )
    compiled = _core.compiled_law(law.compiled)
    wanted = set(compiled.parameters) - {"jump"}
    if set(law.values) != wanted:
        raise SceneError(
            f"interface {interface.name!r}: law {compiled.name!r} takes the values "
            f"{', '.join(sorted(wanted)) or 'none'}, got {', '.join(sorted(law.values)) or 'none'}"
        )
    if compiled.history and not law.history:
        raise SceneError(f"interface {interface.name!r}: law {compiled.name!r} remembers: give history=True")
    return compiled


def spring_stiffness(
    interface: Interface, components: int, floors: Mapping[tuple[str, str], Array]
) -> Array:
    """kappa (m, components), with some of its values replaced."""
    stiffness = interface.law.stiffnesses(interface)[:, :components]
    for parameter, where in interface.law.spans.items():
        values = floors.get((interface.name, parameter))
        if values is not None:
            stiffness[:, where] = values[:, None]
    return stiffness


def _side_by_side(columns: Iterable[Array]) -> Array:
    """Columns (n,) or (n, 1) as a matrix (n, l) in the kernel's storage order."""
    return np.asfortranarray(np.column_stack(list(columns)))


def _body(
    problem: Problem,
    patterns: Mapping[Pattern, Body],
    floors: Mapping[tuple[str, str], Array] | None = None,
    corrected: bool = False,
    scaled: Container[str] = (),
    without: Container[LoadTerm] = (),
    cellwise: Container[str] = (),
) -> Values:
    """A body in the kernel's terms, for :func:`_made_body`; `patterns` are the body under each load pattern.

    Stiffnesses that its factors cannot bear are replaced if the answer is to be corrected. `scaled` are parts
    whose stiffness varies, `cellwise` those where it does so cell by cell, `without` the loads that have a
    pattern of their own.
    """
    body = next(iter(patterns.values()))
    members = []
    for name in body.members:
        offset = _side_by_side(each.offset[name] for each in patterns.values())
        members.append(
            {
                "name": name,
                "stiffness": problem.substructures[name].stiffness,
                "prolongation": body.Z[name],
                "load": _side_by_side(each.load[name] for each in patterns.values()),
                "offset": offset if np.any(offset) else None,
            }
        )
        if name in scaled:
            columns = [_stiffness_load(problem, name, pattern, without) for pattern in patterns]
            members[-1]["of_stiffness"] = _side_by_side(columns)
        if name in cellwise:
            stretch = problem.stretch(name)
            initial = _side_by_side(_initial_stretch(problem, name, each, without) for each in patterns)
            members[-1] |= {
                "stretch": stretch.matrix,
                "stretch_points": len(stretch.weights),
                "initial_stretch": initial if np.any(initial) else None,
            }
    springs = []
    for name in body.springs:
        interface = problem.interfaces[name]
        fields, *others = (interface.law.pattern(a).fields(interface) for a in patterns)
        stiffness = spring_stiffness(interface, fields.components, floors or {})
        if corrected:
            stiffness = factorised_stiffness(problem, interface, stiffness)
        springs.append(
            {
                "name": name,
                "members": [body.members.index(side.substructure) for side in interface.sides],
                "traces": [side.trace for side in interface.sides],
                "frames": fields.frames,
                "stiffness": (stiffness * interface.weights[:, None]).ravel(),
                "jump": _side_by_side(each.parameters["jump"] for each in (fields, *others)),
            }
        )
    return {"name": "+".join(body.members), "size": body.n, "members": members, "springs": springs}


def _stiffness_load(problem: Problem, part: str, pattern: Pattern, without: Container[LoadTerm]) -> Array:
    """The part of a load pattern that comes from the stiffness of a part, (n,)."""
    if not isinstance(pattern, LoadTerm):
        return problem.stiffness_load_on(part, pattern, without)
    load = problem.loads[pattern.load]
    nodal = load.on(part, pattern.parameter) if pattern.parameter in load.stresses else None
    return np.zeros(problem.substructures[part].size) if nodal is None else nodal


def _initial_stretch(
    problem: Problem, part: str, pattern: Pattern, without: Container[LoadTerm]
) -> Array:
    """The same as stretches, see :class:`Stretch`."""
    if not isinstance(pattern, LoadTerm):
        return problem.initial_stretch(part, pattern, without)
    load, stretch = problem.loads[pattern.load], problem.stretch(part)
    if load.load.part != part or pattern.parameter not in load.stresses:
        return np.zeros(stretch.matrix.shape[0])
    return stretch.initial(problem.substructures[part], load.stresses[pattern.parameter])


def initial_stretches(problem: Problem, plan: Plan, part: str) -> Array:
    """Those (rows, l) of all load patterns of a plan."""
    patterns = [*plan.patterns, *plan.loads]
    if not patterns:
        return np.zeros((problem.stretch(part).matrix.shape[0], 0))
    return _side_by_side(_initial_stretch(problem, part, each, plan.loads) for each in patterns)


def _made_body(body: Values) -> _core.Body:
    members = [_core.Member(**each) for each in body["members"]]
    springs = [_core.Spring(**each) for each in body["springs"]]
    return _core.Body(**{**body, "members": members, "springs": springs})


def _made_interface(interface: Values, law: str | _core.Law) -> _core.Interface:
    sides = [_core.Side(**each) for each in interface["sides"]]
    return _core.Interface(**{**interface, "sides": sides, "law": law})


@alone
def definite(problem: Problem, floors: Mapping[tuple[str, str], Array]) -> bool:
    """Whether the whole structure is positive definite with some stiffnesses replaced.

    A Galerkin operator is bounded from below by the deterministic one with every random stiffness at the
    smallest eigenvalue of its Galerkin matrix; one Cholesky factorisation of that one is the proof.

    Parameters
    ----------
    floors
        (interface, ``"normal"`` or ``"tangential"``) -> (m,) stiffness per area, of any sign.
    """
    found = reduce(problem, problem.interfaces, agree=False)
    bodies = [_made_body(_body(problem, {None: body}, floors)) for body in found]
    try:
        Structure(bodies=bodies, operator="factored")
    except NumericalError:
        return False
    return True


@dataclass(frozen=True)
class Acting:
    """What acts on a part, one column a load pattern.

    Attributes
    ----------
    load, offset
        (n, l): forces, and displacements that supports and glue prescribe.
    """

    load: Array
    offset: Array

    def __post_init__(self) -> None:
        locked(self)


class Description(NamedTuple):
    """What the kernel is given of a plan on this rank, as the arguments of its descriptions.

    Attributes
    ----------
    bodies, interfaces
        Of ``latin_core.Body`` with its members and springs, of ``latin_core.Interface`` with its sides.
    fields
        Active interface -> its law for the kernel.
    reduced
        The bodies, each under every load pattern.
    """

    bodies: list[Values]
    interfaces: list[Values]
    fields: dict[str, Fields]
    reduced: list[dict[Pattern, Body]]


class Built(NamedTuple):
    """A structure, and what is known of its parts.

    Attributes
    ----------
    structure
        The kernel's.
    bodies
        Names of the parts of every body on this rank.
    acting
        Part on this rank -> what acts on it; of a plan without active interfaces only.
    """

    structure: Structure
    bodies: tuple[tuple[str, ...], ...]
    acting: dict[str, Acting]


def describe(problem: Problem, plan: Plan, corrected: bool = False) -> Description:
    """Bodies and active interfaces of a plan on this rank; collective.

    Parameters
    ----------
    corrected
        The answer is to be corrected: stiffnesses that the factors cannot bear are replaced.

    Raises
    ------
    SceneError
        What is prescribed contradicts itself.
    """
    check_prescribed(problem, plan.eliminated, moments_of(problem, plan.times))
    with agreement(problem.comm):
        return _described(problem, problem.own, plan, corrected)


def _described(problem: Problem, own: Problem, plan: Plan, corrected: bool) -> Description:
    reduced = _reduced(own, plan)
    bodies = [
        _body(
            own, patterns, corrected=corrected, scaled=plan.scaled, without=plan.loads, cellwise=plan.fields
        )
        for patterns in reduced
    ]
    count = count_bodies(problem, plan.eliminated)
    motions: dict[str, Array] = {}
    if plan.active:
        inside: dict[str, list[Interface]] = {}
        for name in plan.eliminated:
            if name in own.interfaces:
                each = own.interfaces[name]
                inside.setdefault(each.sides[0].substructure, []).append(each)
        for patterns in reduced:
            members = next(iter(patterns.values())).members
            motions |= motions_of(own, members, [each for part in members for each in inside.get(part, ())])
    interfaces, found = [], {}
    for name in plan.active:
        if name not in own.interfaces:
            continue
        interface = own.interfaces[name]
        found[name] = fields = active_fields(interface, plan)
        direction = _direction(problem, plan, interface, fields, count)
        scale = _scale(problem, plan, interface)
        interfaces.append(_interface(own, plan, interface, fields, direction, scale, motions))
    return Description(bodies, interfaces, found, reduced)


@alone
def build(
    problem: Problem, plan: Plan, before: Structure | None = None, described: Description | None = None
) -> Built:
    """Bodies and active interfaces of a plan, factorised: all that does not depend on :func:`laws`.

    Bodies that `before` has, but for their interfaces, keep their factors. `described` is what the kernel is
    given instead of what :func:`describe` says: the same bodies in other unknowns.

    Raises
    ------
    latin_core.NumericalError
        A body's operator is not positive definite.
    """
    own, comm = problem.own, problem.comm
    corrected = plan.method == "direct" and described is None
    bodies, interfaces = [], []
    options, backend = plan.options, plan.options.backend
    if described is not None:
        backend = "automatic"
    elif backend == "multigrid":
        raise SceneError(
            "backend 'multigrid' is for linear laws, and this needs a factor of the parts: use "
            "backend='cholmod'"
        )
    described = described or describe(problem, plan, corrected)
    with agreement(comm):
        bodies = [_made_body(each) for each in described.bodies]
        for each in described.interfaces:
            name = each["name"]
            interfaces.append(_made_interface(each, _law(own.interfaces[name], described.fields[name])))
    grown = max(1.0, float(np.abs(plan.factors()).max(initial=0.0)))
    every = [body for patterns in described.reduced for body in patterns.values()]
    loading = _loading(own, every, described.fields, grown)
    _check_range(loading if comm is None else max(exchanged(comm, loading)))
    began = perf_counter()
    core = Structure(
        bodies=bodies,
        interfaces=interfaces,
        operator=options.operator,
        backend=backend,
        memory_limit=options.memory_limit,
        comm=None if comm is None else comm.py2f(),
        before=before,
    )
    _log.info(
        "factorised %d bodies with %d unknowns (%s), %d rows on %d active interfaces, %.2f s",
        len(bodies),
        core.unknowns,
        ", ".join(sorted({cost["backend"] for cost in core.costs})) or "none here",
        core.rows,
        len(interfaces),
        perf_counter() - began,
    )
    together = [list(patterns.values()) for patterns in described.reduced]
    acting = {
        name: Acting(
            _side_by_side(each.load[name] for each in patterns),
            _side_by_side(each.offset[name] for each in patterns),
        )
        for patterns in (together if corrected else [])
        for name in patterns[0].members
    }
    return Built(core, tuple(patterns[0].members for patterns in together), acting)


def _interface(
    own: Problem,
    plan: Plan,
    interface: Interface,
    fields: Fields,
    direction: Array,
    scale: float,
    motions: Mapping[str, Array],
) -> Values:
    """An active interface for the kernel but for its law; a side on another rank has a name only."""
    sides = [
        {
            "member": side.substructure,
            "trace": side.trace,
            "direction": direction,
            "scale": scale,
            "motions": on_side(motions, side, fields.frames),
            "lever": side.lever,
        }
        if side.substructure in own.substructures
        else {"member": side.substructure}
        for side in interface.sides
    ]
    coarse = interface.name in plan.macro
    return {
        "name": interface.name,
        "weights": interface.weights,
        "frames": fields.frames,
        "sides": sides,
        "basis": basis(interface, fields.frames, fields.components, plan.moments) if coarse else None,
        "paired": interface.name in plan.paired,
    }


def _loading(problem: Problem, bodies: Iterable[Body], laws: Mapping[str, Fields], grown: float) -> float:
    """Largest strain, by order, that a load on bodies or active interfaces makes, with amplitudes of `grown`;
    0 if there is none."""
    if not laws:
        _check_forces(problem, bodies, grown)
        return 0.0  # one solve; no squares, which may overflow
    found = [0.0]

    def add(value: Array, unit: float) -> None:
        found.append(grown * (float(np.abs(value).max(initial=0.0)) / unit))

    parts = problem.substructures
    for body in bodies:
        for name in body.members:
            part = parts[name]
            add(body.load[name], part.modulus * part.length ** (part.dim - 1))
            add(body.offset[name], part.length)
    for name, fields in laws.items():
        interface = problem.interfaces[name]
        sides = [parts[s.substructure] for s in interface.sides if s.substructure in parts]
        part = min(sides, key=lambda each: each.modulus)
        force, jump = part.modulus, part.length
        if interface.one_point:  # of its whole, maybe a rotation
            jump *= max(side.lever for side in interface.sides)
            force = interface.stiffness_unit(parts) * jump
        for parameter, unit in (("force", force), ("jump", jump)):
            if parameter in fields.parameters:
                add(fields.parameters[parameter], unit)
        if "gap" in fields.parameters:  # an interference loads, an opening does not
            add(np.minimum(fields.parameters["gap"], 0.0), part.length)
    return max(found)


def _check_forces(problem: Problem, bodies: Iterable[Body], grown: float) -> None:
    """Refuse loads and prescribed displacements whose forces are no numbers, or whose sums are none."""
    for body in bodies:
        for name in body.members:
            part = problem.substructures[name]
            moved = grown * float(np.abs(body.offset[name]).max(initial=0.0))
            load = grown * float(np.abs(body.load[name]).max(initial=0.0))
            force = moved * (part.modulus * part.length ** (part.dim - 2))
            if not max(moved, load, force) < LARGEST:
                raise SceneError(
                    f"substructure {name!r}: a load of {load:.0e} and a displacement of {moved:.0e} make "
                    f"forces above {LARGEST:.0e}, the largest that can be summed up: scale the loads, or "
                    "choose units that fit them"
                )


def _check_range(strain: float) -> None:
    """Refuse loads whose squares are no numbers: every error would be 0 or infinite."""
    if 0.0 < strain < 1.0 / RANGE or not strain < RANGE:
        raise SceneError(
            f"the loads make strains of about {strain:.0e}; energies, which are their squares, leave the "
            f"range of numbers below {1.0 / RANGE:.0e} and above {RANGE:.0e}: scale the loads, or choose "
            "units that fit them"
        )


def _reduced(problem: Problem, plan: Plan) -> list[dict[Pattern, Body]]:
    """The bodies, each under every load pattern: their loads differ, their prolongations do not."""
    chosen = {name for name in plan.eliminated if name in problem.interfaces}
    moments = moments_of(problem, plan.times)
    found: list[dict[Pattern, Body]] = []
    for amplitude in plan.patterns:
        laws = {name: problem.interfaces[name].law.pattern(amplitude) for name in chosen}
        if len(plan.patterns) == 1 and amplitude is None:
            laws = {}
        bodies = reduce(problem, chosen, laws, amplitude, plan.loads, agree=False)
        found = found or [{} for _ in bodies]
        for known, body in zip(found, bodies, strict=True):
            known[amplitude] = body
    for known in found:
        refuse({a: known[a].off for a in plan.patterns}, moments)
    for term in plan.loads:
        for known in found:
            body = next(iter(known.values()))
            nothing: dict[str, Array] = {
                name: np.zeros(problem.substructures[name].size) for name in body.members
            }
            of_term = {name: problem.loads[term.load].on(name, term.parameter) for name in body.members}
            load = {name: nothing[name] if f is None else f for name, f in of_term.items()}
            known[term] = replace(body, offset=nothing, load=load)
    return found


def laws(structure: Structure, problem: Problem, plan: Plan) -> Laws:
    """The laws of the active interfaces on this rank, what is random at its mean."""
    own = problem.own.interfaces
    parameters = {n: active_fields(own[n], plan).parameters for n in plan.active if n in own}
    return structure.laws(steps=plan.steps, parameters=parameters, in_time=plan.measured_in_time)


def active_fields(interface: Interface, plan: Plan) -> Fields:
    """An active law for the kernel; parameters that change in time have a column per time or load pattern."""
    law = interface.law
    if plan.times is None or plan.history == "none":
        return law.fields(interface)
    if plan.history == "patterns":
        columns = [law.pattern(a).fields(interface) for a in plan.patterns]
    else:
        columns = [law.at(t).fields(interface, t) for t in plan.times]
    first = columns[0]
    parameters = {}
    for name, values in first.parameters.items():
        block = _side_by_side(each.parameters[name] for each in columns)
        constant = np.array_equal(block, np.broadcast_to(values, block.shape))
        parameters[name] = values if constant and plan.history == "steps" else block
    bounds = [each.softest for each in columns if each.softest is not None]
    softest = np.max(bounds, axis=0) if bounds else None
    return replace(first, parameters=parameters, softest=softest)
