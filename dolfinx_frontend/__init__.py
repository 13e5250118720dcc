"""Assemblies of elastic parts joined by uncertain interfaces, on dolfinx.

Data flows one way: geometry -> scene -> :func:`assemble` -> :func:`make_plan` -> :func:`solve` or
:func:`sweep` -> results. The iterations are the kernel's (:mod:`latin_core`); nothing iterates here.
"""

from dolfinx_frontend import geometry, reference
from dolfinx_frontend.assembly import Problem, Substructure, assemble
from dolfinx_frontend.errors import SceneError
from dolfinx_frontend.laws import Displacement, Elastic, Law, Perfect, Pressure, Symmetry, Traction
from dolfinx_frontend.materials import LinearElastic, Material, OrthotropicElastic
from dolfinx_frontend.pairing import Interface
from dolfinx_frontend.plan import Direction, Plan, make_plan
from dolfinx_frontend.scene import Scene
from dolfinx_frontend.solve import Result, solve
from dolfinx_frontend.sweep import SweepResult, sweep
from latin_core import Options

__all__ = [
    "Direction",
    "Displacement",
    "Elastic",
    "Interface",
    "Law",
    "LinearElastic",
    "Material",
    "Options",
    "OrthotropicElastic",
    "Perfect",
    "Plan",
    "Pressure",
    "Problem",
    "Result",
    "Scene",
    "SceneError",
    "Substructure",
    "SweepResult",
    "Symmetry",
    "Traction",
    "assemble",
    "geometry",
    "make_plan",
    "reference",
    "solve",
    "sweep",
]
