"""Pictures of parts, interfaces and results."""

from dolfinx_frontend.figures.assemblies import KIND_COLOURS, assembly_figure, deformed_figure
from dolfinx_frontend.figures.curves import convergence_figure, density_figure, response_surface
from dolfinx_frontend.figures.interfaces import interface_figure, interface_map
from dolfinx_frontend.figures.solids import RenderError

__all__ = [
    "KIND_COLOURS",
    "RenderError",
    "assembly_figure",
    "convergence_figure",
    "deformed_figure",
    "density_figure",
    "interface_figure",
    "interface_map",
    "response_surface",
]
