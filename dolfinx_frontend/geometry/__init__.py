"""Meshes of the parts of an assembly, with named faces.

Every part is a mesh of its own on ``MPI.COMM_SELF``, because a substructure belongs to one process.
Parts that touch have coinciding nodes on the faces they share (unless asked otherwise), but share
no degree of freedom: what connects them is an interface of the scene.

========================  =========================================================================
:func:`box`               one block in two or three dimensions
:func:`from_gmsh`         any gmsh model with physical groups
:func:`read_msh`          the same from a file; :func:`write_msh` writes one
:func:`read_step`         the solids of a STEP file, and where they touch
:func:`remeshable`        a function that can mesh its part again with other sizes
:func:`remeshable_model`  one that makes several parts whose meshes match
========================  =========================================================================

Lengths are in the unit of the coordinates.
"""

from dolfinx_frontend.geometry.finer import remeshable, remeshable_model
from dolfinx_frontend.geometry.gmsh import from_gmsh, read_msh, write_msh
from dolfinx_frontend.geometry.parts import FREE, Assembly, Connection, Part
from dolfinx_frontend.geometry.primitives import box
from dolfinx_frontend.geometry.session import gmsh_session
from dolfinx_frontend.geometry.sizes import SizeField
from dolfinx_frontend.geometry.solids import Cut, Solid, Surface
from dolfinx_frontend.geometry.step import StepAssembly, read_step
from dolfinx_frontend.geometry.touching import Touch

__all__ = [
    "Assembly",
    "Connection",
    "Cut",
    "FREE",
    "Part",
    "SizeField",
    "Solid",
    "StepAssembly",
    "Surface",
    "Touch",
    "box",
    "from_gmsh",
    "gmsh_session",
    "read_msh",
    "write_msh",
    "read_step",
    "remeshable",
    "remeshable_model",
]
