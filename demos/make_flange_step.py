"""A pipe flange with gasket and eight stud bolts as a STEP file, made with gmsh's OpenCASCADE.

    ./run python demos/make_flange_step.py flange.step

27 solids: two weld-neck flanges, a ring gasket between their raised faces, and eight studs with two
hexagonal nuts each. The dimensions are near those of DN 100, in mm; the axis is z, the middle of the gasket
z = 0, bolt 1 on the x-axis.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from parts.step_file import write_step


@dataclass(frozen=True)
class FlangeShape:
    """Dimensions of the joint, mm.

    Attributes
    ----------
    bore, pipe, raised, outer
        Radii of the bore, the neck, the raised face and the flange.
    thickness, step, neck
        Thickness of the flange without its raised face, height of the raised face, length of the neck.
    gasket_inner, gasket_outer, gasket_thickness
        The gasket.
    bolts, bolt_circle, bolt, hole
        Number of bolts, and radii of their circle, the stud and its hole.
    nut_height, nut_width
        Height and width across flats of a nut.
    """

    bore: float = 51.5
    pipe: float = 65.0
    raised: float = 78.0
    outer: float = 120.0
    thickness: float = 22.0
    step: float = 3.0
    neck: float = 40.0
    gasket_inner: float = 58.0
    gasket_outer: float = 78.0
    gasket_thickness: float = 3.0
    bolts: int = 8
    bolt_circle: float = 97.0
    bolt: float = 9.2
    hole: float = 11.0
    nut_height: float = 18.0
    nut_width: float = 30.0

    @property
    def levels(self) -> tuple[float, float, float, float]:
        """|z| of the gasket's face, the flange's front and back, and the end of the pipe."""
        seat = self.gasket_thickness / 2
        front = seat + self.step
        back = front + self.thickness
        return seat, front, back, back + self.neck


def make_flange(path: str | Path, shape: FlangeShape | None = None) -> Path:
    """Write the STEP file.

    Parameters
    ----------
    path
        File to write.
    shape
        Dimensions; the default ones if not given.
    """
    shape = shape or FlangeShape()

    def build(occ: Any) -> dict[str, int]:
        solids = {
            "lower flange": _flange(occ, shape, -1.0),
            "upper flange": _flange(occ, shape, 1.0),
            "gasket": _ring(occ, shape.gasket_inner, shape.gasket_outer, -shape.levels[0], shape.levels[0]),
        }
        back = shape.levels[2]
        end = back + shape.nut_height
        for k in range(shape.bolts):
            angle = 2.0 * math.pi * k / shape.bolts
            x, y = shape.bolt_circle * math.cos(angle), shape.bolt_circle * math.sin(angle)
            solids[f"stud {k + 1}"] = occ.addCylinder(x, y, -end, 0, 0, 2 * end, shape.bolt)
            for side, low in (("lower", -end), ("upper", back)):
                solids[f"{side} nut {k + 1}"] = _nut(occ, shape, x, y, low, angle)
        return solids

    return write_step(path, build)


def _ring(occ: Any, inner: float, outer: float, low: float, high: float) -> int:
    body = occ.addCylinder(0, 0, low, 0, 0, high - low, outer)
    hole = occ.addCylinder(0, 0, low, 0, 0, high - low, inner)
    return int(occ.cut([(3, body)], [(3, hole)])[0][0][1])


def _flange(occ: Any, shape: FlangeShape, sign: float) -> int:
    """One flange, on the side of the sign of z."""
    seat, front, back, end = (sign * z for z in shape.levels)

    def pin(x: float, y: float, start: float, stop: float, radius: float) -> tuple[int, int]:
        return 3, occ.addCylinder(x, y, start, 0, 0, stop - start, radius)

    body = [
        pin(0, 0, seat, front, shape.raised),
        pin(0, 0, front, back, shape.outer),
        pin(0, 0, back, end, shape.pipe),
    ]
    fused = occ.fuse(body[:1], body[1:])[0]
    holes = [pin(0, 0, seat, end, shape.bore)]
    for k in range(shape.bolts):
        angle = 2.0 * math.pi * k / shape.bolts
        x, y = shape.bolt_circle * math.cos(angle), shape.bolt_circle * math.sin(angle)
        holes.append(pin(x, y, front, back, shape.hole))
    return int(occ.cut(fused, holes)[0][0][1])


def _nut(occ: Any, shape: FlangeShape, x: float, y: float, low: float, angle: float) -> int:
    """A hexagonal nut with the hole of its thread; one of its flats faces the axis of the pipe."""
    radius = shape.nut_width / math.sqrt(3.0)
    corners = []
    for k in range(6):
        at = angle + math.pi / 6 + k * math.pi / 3
        corners.append(occ.addPoint(x + radius * math.cos(at), y + radius * math.sin(at), low))
    lines = [occ.addLine(corners[k], corners[(k + 1) % 6]) for k in range(6)]
    base = occ.addPlaneSurface([occ.addCurveLoop(lines)])
    body = [each for each in occ.extrude([(2, base)], 0, 0, shape.nut_height) if each[0] == 3]
    hole = (3, occ.addCylinder(x, y, low, 0, 0, shape.nut_height, shape.bolt))
    return int(occ.cut(body, [hole])[0][0][1])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("path", nargs="?", type=Path, default=Path("flange.step"))
    print(f"wrote {make_flange(parser.parse_args().path)}")
