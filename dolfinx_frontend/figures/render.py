"""The program that draws a solid with VTK, in a process of its own.

VTK ends the process that has no display. This file is run, and imports nothing of the package.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt


def up(view: Sequence[float] | npt.NDArray[np.float64]) -> tuple[float, float, float]:
    """What is up in a picture: z, and y where one looks along z."""
    return (0.0, 0.0, 1.0) if np.hypot(view[0], view[1]) > 1e-6 * abs(view[2]) else (0.0, 1.0, 0.0)


def draw(data: str, out: str) -> None:
    """The program of the other process."""
    import pyvista

    with np.load(data) as file:
        solid = {name: file[name] for name in file.files}
    points = solid["points"]
    count = len(solid["triangles"])
    faces = np.column_stack([np.full(count, 3), solid["triangles"]])
    surface = pyvista.PolyData(points, faces.reshape(-1))
    colours = (255 * solid["colours"]).astype(np.uint8)

    def lines(segments: npt.NDArray[np.int64]) -> Any:
        cells = np.column_stack([np.full(len(segments), 2), segments]).reshape(-1)
        return pyvista.PolyData(points, lines=cells)

    images = []
    width = int(solid["width"])
    for view in solid["views"]:
        plotter = pyvista.Plotter(off_screen=True, window_size=(width, width))
        plotter.set_background("white")
        plotter.add_mesh(surface, scalars=colours, rgb=True, ambient=0.72, diffuse=0.3)
        for name, colour, thickness in (("thin", "#777777", 1.0), ("thick", "black", 3.0)):
            if len(solid[name]):
                actor = plotter.add_mesh(lines(solid[name]), color=colour, line_width=thickness)
                # lines lie on the surface: bring them forward, or it hides parts of them
                actor.mapper.SetResolveCoincidentTopologyToPolygonOffset()
                actor.mapper.SetRelativeCoincidentTopologyLineOffsetParameters(0.0, -8.0)
        plotter.enable_parallel_projection()
        plotter.enable_anti_aliasing("ssaa")
        plotter.view_vector(view, viewup=up(view))
        plotter.reset_camera()
        images.append(plotter.screenshot(None, return_img=True))
        plotter.close()
    np.savez_compressed(out, *images)


if __name__ == "__main__":
    draw(*sys.argv[1:])
