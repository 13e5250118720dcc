"""How far the model of the package goes, small displacements of elastic parts, and what is no value.

What lies beyond is computed all the same, and a warning says so: its text begins with ``beyond the model:``.
"""

from __future__ import annotations

from dataclasses import dataclass

from dolfinx_frontend.common.errors import SceneWarning, warn

__all__ = ["LIMITS", "Settings", "beyond"]


@dataclass(frozen=True)
class Settings:
    """Beyond them an answer, or a value that is given, is probably not what was meant."""

    displacement: float = 0.05
    """Of the size of the assembly: loads act on the shape before it moves, lever arms change by as much."""
    strain: float = 0.01
    """Largest principal strain: what the linear measure leaves out is of its own size, 1 % of it."""
    rotation: float = 5.0
    """Degrees: a rotation phi makes a strain of phi^2 / 2 that is none, here 0.4 %."""
    sliding: float = 0.05
    """Share of a face that its points may slide along: pressures are where the faces were."""
    misread: float = 1.0
    """Displacement over the size of the assembly from which on a unit is wrong, and no load too large."""
    nothing: float = 1e-9
    """Strain below which a modulus is too large rather than a load small: 200 Pa in steel."""
    units: float = 1e6
    """Pa in a MPa."""
    moduli: tuple[float, float] = (1e3, 1e6)
    """MPa, from polymers to carbides: what is named as a mistake of units is a modulus in the other one."""
    metres: float = 10.0
    """Size of an assembly, in its unit, below which metres are meant rather than millimetres."""
    friction: float = 1.5
    """Coefficient of friction: rubber on dry concrete has 1, clean metal in vacuum more."""
    cov: float = 1.0
    """Standard deviation over mean: what scatters by more than its mean is rather a percentage."""
    thermal_strain: float = 0.01
    """alpha dT: metals melt at 1 to 2 %; plastics reach it within 100 K."""
    slack: float = 2e-5
    """Strain of a bolt by its torque below which nobody tightened it: 4 MPa in steel."""
    numbers: float = 2e7
    """Displacements (unknowns times steps, 8 bytes each) that are recovered only to look at them."""


LIMITS = Settings()


def beyond(text: str, key: str = "") -> None:
    """Warn that an answer or a value is beyond the model; see :func:`dolfinx_frontend.common.errors.warn`."""
    warn(f"beyond the model: {text}", SceneWarning, key)
