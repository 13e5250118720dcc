"""Figures of assemblies, interface fields, convergence, responses and densities, as PNG files.

Every function takes plain arrays, parts or dolfinx functions, writes one file and returns its path;
labels carry the units.  Flat figures are drawn by matplotlib.  Solids are drawn by VTK through
pyvista in a separate process, because VTK ends a process that has no display; if there is none, a virtual
display (``xvfb-run``) is used.  With ``renderer="auto"`` matplotlib draws solids too
where VTK cannot, more coarsely.
"""

from dolfinx_frontend.figures.assemblies import KIND_COLOURS, assembly_figure, deformed_figure
from dolfinx_frontend.figures.curves import convergence_figure, density_figure, response_surface
from dolfinx_frontend.figures.interfaces import facet_corners, interface_figure, interface_map
from dolfinx_frontend.figures.joints import joint_diagram
from dolfinx_frontend.figures.solids import RenderError
from dolfinx_frontend.figures.stresses import stress_figure

__all__ = [
    "KIND_COLOURS",
    "RenderError",
    "assembly_figure",
    "convergence_figure",
    "deformed_figure",
    "density_figure",
    "facet_corners",
    "interface_figure",
    "interface_map",
    "joint_diagram",
    "response_surface",
    "stress_figure",
]
