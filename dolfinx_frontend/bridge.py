"""The crossing into the kernel: the only module that builds its objects.

A planned problem becomes bodies (substructures glued by prolongations) and active interfaces, each
with a kernel law, local frames and search directions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dolfinx_frontend.assembly import Problem, forces, jumps, resolve, stiffnesses
from dolfinx_frontend.errors import SceneError
from dolfinx_frontend.laws import (
    Contact,
    Displacement,
    Elastic,
    Law,
    Perfect,
    Pressure,
    Symmetry,
    Traction,
)
from dolfinx_frontend.pairing import Interface
from dolfinx_frontend.plan import Plan
from dolfinx_frontend.reduction import Body, reduce
from latin_core import NumericalError, _core

__all__ = ["KERNEL_NAMES", "LawFields", "build", "definite", "kernel_parameter", "law_fields"]

Array = npt.NDArray[np.float64]

TOUCHING = 1e-6
"""Interpenetration, as a share of the face's size, that is rounding of the mesh."""

SOFTEST = 1e-3
"""Smallest search direction of an elastic interface, as a share of factor * E / L."""


@dataclass(frozen=True)
class LawFields:
    """A law in the kernel's terms.

    Attributes
    ----------
    kind
        Kernel law: ``"perfect"``, ``"elastic"``, ``"force"``, ``"contact"`` or ``"coulomb"``.
    components
        Unknown components at a point: a frictionless law has one.
    frames
        (components * m, d) rows of the local frame that belong to them.
    parameters
        Kernel parameter -> (rows, 1): one value a point (stiffness), or a point and component.
    """

    kind: str
    components: int
    frames: Array
    parameters: dict[str, Array]


def law_fields(interface: Interface, law: Law | None = None) -> LawFields:
    """Translate a law (the interface's own by default) for the kernel.

    Raises
    ------
    SceneError
        A value of the wrong shape, negative or not finite.
    """
    law = law or interface.law
    d, m = interface.dim, interface.num_points
    own = interface.frames.reshape(d * m, d)
    if isinstance(law, Perfect):
        return LawFields("perfect", d, own, {"jump": jumps(interface, law).reshape(-1, 1)})
    if isinstance(law, Elastic):
        components = 1 if law.tangential is None else d
        stiffness = stiffnesses(interface, law)
        parameters = {
            "normal": stiffness[:, :1],
            "tangential": stiffness[:, 1:2],
            "jump": jumps(interface, law)[:, :components].reshape(-1, 1),
        }
        frames: Array = interface.frames[:, :components].reshape(components * m, d)
        return LawFields("elastic", components, frames, parameters)
    if isinstance(law, Contact):
        return _contact(interface, law)
    if isinstance(law, Displacement):
        axes = list(law.axes(d))
        frames = np.tile(np.eye(d)[axes], (m, 1))
        value = resolve(law.value, interface, d, "all", "value")[:, axes]
        return LawFields("perfect", len(axes), frames, {"jump": -value.reshape(-1, 1)})
    if isinstance(law, Symmetry):
        return LawFields("perfect", 1, interface.normals, {"jump": np.zeros((m, 1))})
    if isinstance(law, Pressure):
        return LawFields("force", 1, interface.normals, {"force": forces(interface, law)[:, :1]})
    if isinstance(law, Traction):
        return LawFields("force", d, own, {"force": forces(interface, law).reshape(-1, 1)})
    raise SceneError(
        f"interface {interface.name!r}: the kernel has no law for {type(law).__name__}"
    )


def _contact(interface: Interface, law: Contact) -> LawFields:
    d, m = interface.dim, interface.num_points
    components = d if law.rubs else 1
    gap = interface.gap[:, None] if law.gap is None else resolve(law.gap, interface, 1, name="gap")
    depth = -float(gap.min())
    if law.gap is None and not law.interference and depth > TOUCHING * np.sqrt(interface.area):
        raise SceneError(
            f"interface {interface.name!r}: the faces are meshed inside each other, by up to {depth:.4g}: "
            "mend the geometry, give the gap, or pass interference=True if that is meant"
        )
    parameters: dict[str, Array] = {"gap": gap, "compliance": np.zeros((m, 1))}
    if law.stiffness is not None:
        stiffness = resolve(law.stiffness, interface, 1, name="stiffness")
        if stiffness.min() <= 0.0:
            raise SceneError(
                f"interface {interface.name!r}: contact stiffness {stiffness.min():g}: it must be > 0"
            )
        parameters["compliance"] = np.reciprocal(stiffness)
    for name in ("friction", "threshold") if law.rubs else ():
        value = getattr(law, name)
        values = np.zeros((m, 1)) if value is None else resolve(value, interface, 1, name=name)
        if values.min() < 0.0:
            raise SceneError(f"interface {interface.name!r}: {name} {values.min():g} is negative")
        parameters[name] = values
    jump = resolve(law.jump, interface, d, "first", "jump")[:, :components]
    parameters["jump"] = jump.reshape(-1, 1)
    frames = interface.frames[:, :components].reshape(components * m, d)
    return LawFields("coulomb" if law.rubs else "contact", components, frames, parameters)


# user's parameter -> kernel's parameter, where the names differ
KERNEL_NAMES = {"p": "force", "t": "force", "value": "jump"}


def kernel_parameter(interface: Interface, parameter: str) -> tuple[str, Array]:
    """Kernel name of a law parameter, and the field that the value 1 stands for.

    Returns
    -------
    tuple
        Name, and (rows, 1) such that ``value * field`` is what the kernel is given.

    Raises
    ------
    SceneError
        The law has no such parameter.
    """
    law = interface.law
    known = law.parameters()
    if parameter not in known:
        raise SceneError(
            f"interface {interface.name!r}: {type(law).__name__} has no parameter {parameter!r}; "
            f"it has: {', '.join(known) or 'none'}"
        )
    if isinstance(law, Contact) and parameter == "stiffness":
        raise SceneError(
            f"interface {interface.name!r}: the stiffness of a contact can be neither swept nor random; "
            "vary its gap, friction, threshold or jump"
        )
    kernel_name = KERNEL_NAMES.get(parameter, parameter)
    unit = law_fields(interface, law.with_(**{parameter: 1.0}))
    return kernel_name, unit.parameters[kernel_name]


def _scale(problem: Problem, plan: Plan) -> float:
    """E / L of the scene: geometric mean of the moduli, over the scene's length."""
    parts = problem.substructures.values()
    modulus = float(np.exp(np.mean([np.log(part.modulus) for part in parts])))
    dim = next(iter(parts)).dim
    length = plan.direction.length or sum(part.volume for part in parts) ** (1.0 / dim)
    return modulus / length


def _direction(problem: Problem, plan: Plan, interface: Interface, fields: LawFields) -> Array:
    """Search direction k of an interface, (components * m,), the same on both sides."""
    given = plan.direction.given.get(interface.name)
    if given is not None:
        per_point = resolve(given, interface, 1, name="search direction")
        return np.repeat(per_point.ravel(), fields.components)
    assert plan.direction.factor is not None  # the plan fills it in
    k: Array = np.full(
        (interface.num_points, fields.components), plan.direction.factor * _scale(problem, plan)
    )
    if isinstance(interface.law, Elastic) and plan.method == "accelerated":
        # a soft interface carries little: the direction that suits it is twice its own stiffness
        kappa = stiffnesses(interface, interface.law)[:, : fields.components]
        k = np.clip(2.0 * kappa, SOFTEST * k, k)
    return k.ravel()


def _spring_stiffness(
    interface: Interface, components: int, floors: Mapping[tuple[str, str], Array]
) -> Array:
    """kappa (m, components), with some of its values replaced."""
    assert isinstance(interface.law, Elastic)  # the reduction leaves no other springs
    stiffness = stiffnesses(interface, interface.law)[:, :components]
    for parameter, where in (("normal", slice(0, 1)), ("tangential", slice(1, None))):
        values = floors.get((interface.name, parameter))
        if values is not None:
            stiffness[:, where] = values[:, None]
    return stiffness


def _body(
    problem: Problem, body: Body, floors: Mapping[tuple[str, str], Array] | None = None
) -> _core.Body:
    members = []
    for name in body.members:
        offset = body.offset[name]
        members.append(
            _core.Member(
                name=name,
                stiffness=problem.substructures[name].stiffness,
                prolongation=body.Z[name],
                load=body.load[name].reshape(-1, 1),
                offset=offset.reshape(-1, 1) if np.any(offset) else None,
            )
        )
    springs = []
    for name in body.springs:
        interface = problem.interfaces[name]
        fields = law_fields(interface)
        stiffness = _spring_stiffness(interface, fields.components, floors or {})
        springs.append(
            _core.Spring(
                name=name,
                members=[body.members.index(side.substructure) for side in interface.sides],
                traces=[side.trace for side in interface.sides],
                frames=fields.frames,
                stiffness=(stiffness * interface.weights[:, None]).ravel(),
                jump=fields.parameters["jump"].ravel(),
            )
        )
    return _core.Body(name="+".join(body.members), size=body.n, members=members, springs=springs)


def definite(problem: Problem, floors: Mapping[tuple[str, str], Array]) -> bool:
    """Whether the whole structure is positive definite with some stiffnesses replaced.

    A Galerkin operator is bounded from below by the deterministic one with every random stiffness at the
    smallest eigenvalue of its Galerkin matrix; one Cholesky factorisation of that one is the proof.

    Parameters
    ----------
    floors
        (interface, ``"normal"`` or ``"tangential"``) -> (m,) stiffness per area, of any sign.
    """
    bodies = [_body(problem, body, floors) for body in reduce(problem, problem.interfaces)]
    try:
        _core.Problem(
            bodies=bodies, interfaces=[], operator="factored", backend="automatic", memory_limit=0.0
        )
    except NumericalError:
        return False
    return True


def build(problem: Problem, plan: Plan) -> _core.Problem:
    """Bodies and active interfaces of a plan, factorised.

    Raises
    ------
    latin_core.NumericalError
        A body's operator is not positive definite.
    """
    bodies = [_body(problem, body) for body in reduce(problem, set(plan.eliminated))]
    scale = _scale(problem, plan)
    interfaces = []
    laws = {}
    for name in plan.active:
        interface = problem.interfaces[name]
        laws[name] = fields = law_fields(interface)
        direction = _direction(problem, plan, interface, fields)
        interfaces.append(
            _core.Interface(
                name=name,
                law=fields.kind,
                weights=interface.weights,
                frames=fields.frames,
                sides=[
                    _core.Side(
                        member=side.substructure, trace=side.trace, direction=direction, scale=scale
                    )
                    for side in interface.sides
                ],
            )
        )
    options = plan.options
    core = _core.Problem(
        bodies=bodies,
        interfaces=interfaces,
        operator=options.operator,
        backend=options.backend,
        memory_limit=options.memory_limit,
    )
    for name, fields in laws.items():
        for parameter, values in fields.parameters.items():
            core.set_parameter(name, parameter, values)
    return core
