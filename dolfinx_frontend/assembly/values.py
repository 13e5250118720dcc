"""Parameters of laws at the points of an interface."""

from __future__ import annotations

from typing import Any

import numpy as np

from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.scene.laws import Elastic, Perfect, Pressure, Traction, evaluate

__all__ = ["forces", "jumps", "resolve", "stiffnesses"]


def resolve(
    value: Any, interface: Interface, components: int, scalar: str = "all", name: str = "value"
) -> Array:
    """Values of a law parameter at the interface points.

    Parameters
    ----------
    value
        Number, array, callable of the points, or parameter with a mean (which is taken).
    interface
        The interface.
    components
        Components wanted at each point.
    scalar
        Meaning of one number per point if ``components > 1``, see :func:`laws.evaluate`.
    name
        Name of the parameter, for messages.

    Returns
    -------
    Array
        (m, components).

    Raises
    ------
    SceneError
        Wrong shape or type, NaN; the message names the interface.
    """
    what = f"interface {interface.name!r}, parameter {name!r}"
    return evaluate(value, interface.points, components, what, scalar)


def stiffnesses(interface: Interface, law: Elastic) -> Array:
    """kappa (m, d) in the local frame, force / length^3; free directions are 0.

    Raises
    ------
    SceneError
        Negative values or wrong shapes.
    """
    d = interface.dim
    out = np.zeros((interface.num_points, d))
    for name, value, where in (
        ("normal", law.normal, slice(0, 1)),
        ("tangential", law.tangential, slice(1, d)),
    ):
        if value is None:
            continue
        kappa = resolve(value, interface, 1, name=name)
        if kappa.min() < 0.0:
            raise SceneError(
                f"interface {interface.name!r}: {name} stiffness {kappa.min():g} is negative; "
                "stiffness is >= 0"
            )
        out[:, where] = kappa / interface.area if law.total else kappa
    return out


def jumps(interface: Interface, law: Elastic | Perfect) -> Array:
    """Imposed jump Delta (m, d) in the local frame, length."""
    return resolve(law.jump, interface, interface.dim, "first", "jump")


def forces(interface: Interface, law: Pressure | Traction) -> Array:
    """Prescribed force per area f_1 (m, d) in the local frame."""
    d = interface.dim
    if isinstance(law, Pressure):
        out = np.zeros((interface.num_points, d))
        out[:, :1] = -resolve(law.p, interface, 1, name="p")
        return out
    vector = resolve(law.t, interface, d, "zero", "t")
    local: Array = np.einsum("pij,pj->pi", interface.frames, vector)
    return local
