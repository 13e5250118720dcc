"""Meshes and faces of parts: boxes, gmsh, STEP files."""

from dolfinx_frontend.geometry.gmsh import from_gmsh, gmsh_session, read_msh
from dolfinx_frontend.geometry.parts import FREE, Assembly, Connection, Part
from dolfinx_frontend.geometry.primitives import box
from dolfinx_frontend.geometry.solids import Cut, Solid, Surface
from dolfinx_frontend.geometry.step import StepAssembly, read_step
from dolfinx_frontend.geometry.touching import Touch

__all__ = [
    "Assembly",
    "Connection",
    "Cut",
    "FREE",
    "Part",
    "Solid",
    "StepAssembly",
    "Surface",
    "Touch",
    "box",
    "from_gmsh",
    "gmsh_session",
    "read_msh",
    "read_step",
]
