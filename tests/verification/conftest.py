"""The coarse vessel, meshed and assembled once."""

from __future__ import annotations

import pytest

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.reference.direct import ReferenceSolution, monolithic
from parts.vessel import BoltedVessel, bolted_vessel
from tests.verification import scenes


@pytest.fixture(scope="session")
def vessel_shape() -> BoltedVessel:
    """Mesh of the coarse vessel, mm."""
    return bolted_vessel("coarse")


@pytest.fixture(scope="session")
def vessel(vessel_shape: BoltedVessel) -> Problem:
    """The coarse vessel in N and mm."""
    return scenes.vessel(vessel_shape)


@pytest.fixture(scope="session")
def vessel_reference(vessel: Problem) -> ReferenceSolution:
    """Its monolithic solution."""
    return monolithic(vessel)
