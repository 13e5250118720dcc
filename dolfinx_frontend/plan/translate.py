"""Laws of a scene in the kernel's terms: its law's name, local frames, parameters by point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.values import forces, jumps, resolve, stiffnesses
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.scene.amplitudes import Varying
from dolfinx_frontend.scene.laws import (
    Contact,
    Debonding,
    Displacement,
    Elastic,
    Law,
    Perfect,
    Preload,
    Pressure,
    Symmetry,
    Traction,
    UserLaw,
)

__all__ = ["KERNEL_NAMES", "LawFields", "kernel_parameter", "kernel_values", "law_fields"]


TOUCHING = 1e-6
"""Interpenetration, as a share of the face's size, that is rounding of the mesh."""

SOFTENING = 2.0
"""Search direction of a law that softens, as a multiple of the smallest one with a unique answer."""


@dataclass(frozen=True)
class LawFields:
    """A law in the kernel's terms.

    Attributes
    ----------
    kind
        Kernel law: ``"perfect"``, ``"elastic"``, ``"force"``, ``"contact"``, ``"coulomb"``,
        ``"debonding"``, ``"preload"``, or ``"user "`` and a name.
    components
        Unknown components at a point: a frictionless law has one.
    frames
        (components * m, d) rows of the local frame that belong to them.
    parameters
        Kernel parameter -> (rows, 1): one value a point (stiffness), or a point and component.
    softest
        Smallest search direction (m, components), force / length^3, with which the law has one answer; None:
        any.
    """

    kind: str
    components: int
    frames: Array
    parameters: dict[str, Array]
    softest: Array | None = None


def law_fields(
    interface: Interface, law: Law | None = None, time: float | None = None
) -> LawFields:
    """Translate a law (the interface's own by default) for the kernel, at a time of a history.

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
    if isinstance(law, Debonding):
        return _debonding(interface, law)
    if isinstance(law, UserLaw):
        return _user(interface, law)
    if isinstance(law, Preload):
        return _preload(interface, law, time)
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
    meshed = interface.gap if law.interference else interface.clearance
    gap = meshed[:, None] if law.gap is None else resolve(law.gap, interface, 1, name="gap")
    depth = -float(gap.min())
    if law.gap is None and not law.interference and depth > TOUCHING * np.sqrt(interface.area):
        raise SceneError(
            f"interface {interface.name!r}: the faces are meshed inside each other, by up to {depth:.4g}: "
            "mend the geometry, give the gap, or pass interference=True if that is meant"
        )
    parameters: dict[str, Array] = {"gap": gap, "compliance": np.zeros((m, 1))}
    if law.stiffness is not None:
        stiffness = _positive(interface, law.stiffness, "contact stiffness")
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


def _positive(interface: Interface, value: object, name: str) -> Array:
    """A law's value that must be positive, (m, 1)."""
    values = resolve(value, interface, 1, name=name)
    if values.min() <= 0.0:
        raise SceneError(
            f"interface {interface.name!r}: {name} {values.min():g}: it must be > 0"
        )
    return values


def _preload(interface: Interface, law: Preload, time: float | None) -> LawFields:
    d, m = interface.dim, interface.num_points
    area = interface.area if law.total else 1.0
    locked = time is not None and not law.controlled(time)
    parameters = {
        "force": np.divide(resolve(law.force, interface, 1, name="force"), area),
        "locked": np.full((m, 1), float(locked)),
    }
    return LawFields("preload", d, interface.frames.reshape(d * m, d), parameters)


def _debonding(interface: Interface, law: Debonding) -> LawFields:
    d, m = interface.dim, interface.num_points
    components = 1 if law.tangential is None else d
    parameters = {
        name: _positive(interface, getattr(law, name), name)
        for name in ("normal", "strength", "opening", "energy")
        if getattr(law, name) is not None
    }
    tangential: Array = np.zeros((m, 1))
    if law.tangential is not None:
        tangential = resolve(law.tangential, interface, 1, name="tangential")
        if tangential.min() < 0.0:
            raise SceneError(
                f"interface {interface.name!r}: tangential stiffness {tangential.min():g} is negative"
            )
    parameters["tangential"] = tangential
    first = parameters["strength"] / parameters["normal"]
    last = parameters.get("opening")
    if last is None:
        last = 2.0 * parameters["energy"] / parameters["strength"]
    if np.any(last <= first):
        worst = int(np.argmin(last - first))
        raise SceneError(
            f"interface {interface.name!r}: the bond ends at an opening of {last[worst, 0]:.4g}, before its "
            f"strength is reached at strength / normal = {first[worst, 0]:.4g}: give a larger opening or "
            "energy, or a stiffer bond"
        )
    # flexibility 1/k1 + 1/k2 below (lambda_f - lambda_0) / strength in the metric of the law
    slope = len(interface.sides) * parameters["strength"] / (last - first)
    softest: Array = np.repeat(SOFTENING * slope, components, axis=1)
    softest[:, 1:] *= tangential / parameters["normal"]
    jump = resolve(law.jump, interface, d, "first", "jump")[:, :components]
    parameters["jump"] = jump.reshape(-1, 1)
    frames = interface.frames[:, :components].reshape(components * m, d)
    return LawFields("debonding", components, frames, parameters, softest)


def _user(interface: Interface, law: UserLaw) -> LawFields:
    d, m = interface.dim, interface.num_points
    components = 1 if law.components == "normal" else d
    parameters = {
        name: resolve(value, interface, 1, name=name) for name, value in law.values.items()
    }
    jump = resolve(law.jump, interface, d, "first", "jump")[:, :components]
    parameters["jump"] = jump.reshape(-1, 1)
    frames = interface.frames[:, :components].reshape(components * m, d)
    return LawFields(f"user {law.label}", components, frames, parameters)


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
        The law has no such parameter, or the kernel's is another function of it.
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
            f"interface {interface.name!r}: the stiffness of a contact does not enter its law linearly"
        )
    if isinstance(law, Debonding) and parameter != "jump":
        # not from a law with the value 1: the values of a bond must fit each other
        return parameter, np.ones((interface.num_points, 1))
    kernel_name = KERNEL_NAMES.get(parameter, parameter)
    unit = law_fields(interface, law.nominal.with_(**{parameter: 1.0}))
    return kernel_name, unit.parameters[kernel_name]


def kernel_values(
    interface: Interface, parameter: str, values: Array
) -> tuple[str, Array, Array]:
    """Kernel name of a law parameter, a field, and what it is multiplied with for given values.

    Parameters
    ----------
    values
        In the units of the law, any shape.

    Returns
    -------
    tuple
        Name, (rows, 1) field, and numbers in the shape of `values`.

    Raises
    ------
    SceneError
        The law has no such parameter, or does not take the values.
    """
    law = interface.law
    if isinstance(law, Contact) and parameter == "stiffness":
        if isinstance(law.stiffness, Varying):
            raise SceneError(
                f"interface {interface.name!r}: the stiffness of a contact changes in time: it cannot be "
                "swept or random as well"
            )
        if values.min() <= 0.0:
            raise SceneError(
                f"interface {interface.name!r}: contact stiffness {values.min():g}: it must be > 0"
            )
        return "compliance", np.ones((interface.num_points, 1)), np.reciprocal(values)
    name, unit = kernel_parameter(interface, parameter)
    return name, unit, values
