"""Laws of a scene in the kernel's terms: its law's name, local frames, parameters by point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dolfinx_frontend.assembly import forces, jumps, resolve, stiffnesses
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

__all__ = ["KERNEL_NAMES", "LawFields", "kernel_parameter", "law_fields"]

Array = npt.NDArray[np.float64]

TOUCHING = 1e-6
"""Interpenetration, as a share of the face's size, that is rounding of the mesh."""


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
    unit = law_fields(interface, law.nominal.with_(**{parameter: 1.0}))
    return kernel_name, unit.parameters[kernel_name]
