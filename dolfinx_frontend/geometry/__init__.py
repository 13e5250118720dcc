"""Meshes and faces of parts: boxes, gmsh, STEP files."""

from dolfinx_frontend.geometry.parts import (
    FREE,
    Assembly,
    BoltedVessel,
    Connection,
    Part,
    VesselShape,
    annulus,
    block_chain,
    bolted_vessel,
    box,
    from_gmsh,
    gmsh_session,
    read_msh,
    two_rings,
)

__all__ = [
    "Assembly",
    "BoltedVessel",
    "Connection",
    "FREE",
    "Part",
    "VesselShape",
    "annulus",
    "block_chain",
    "bolted_vessel",
    "box",
    "from_gmsh",
    "gmsh_session",
    "read_msh",
    "two_rings",
]
