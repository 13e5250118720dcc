"""An L-bracket with two bolts on a base plate as a STEP file, made with gmsh's OpenCASCADE.

    ./run python demos/make_bracket_step.py bracket.step

Four solids, in mm: the base, its top at z = 0; the bracket, a foot of 12 mm and a wall of 10 mm with a
fillet of 6 mm between them; two M8 bolts through clearance holes of 9 mm into the base.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from parts.step_file import write_step

FOOT, WALL, HEIGHT, WIDTH, LENGTH = 12.0, 10.0, 70.0, 60.0, 60.0
FILLET = 6.0
BOLTS = ((40.0, -16.0), (40.0, 16.0))
BOLT, HOLE, HEAD, HEAD_HEIGHT, DEPTH = 4.0, 4.5, 6.5, 8.0, 14.0  # radii, and lengths


def make_bracket(path: str | Path) -> Path:
    """Write the STEP file."""
    return write_step(path, _solids)


def _solids(occ: Any) -> dict[str, int]:
    def pin(x: float, y: float, low: float, high: float, radius: float) -> tuple[int, int]:
        return 3, occ.addCylinder(x, y, low, 0, 0, high - low, radius)

    foot = (3, occ.addBox(0, -WIDTH / 2, 0, LENGTH, WIDTH, FOOT))
    wall = (3, occ.addBox(0, -WIDTH / 2, 0, WALL, WIDTH, HEIGHT))
    bracket = occ.fuse([foot], [wall])[0][0][1]
    occ.synchronize()
    e = 1e-3
    inside = occ.getEntitiesInBoundingBox(WALL - e, -WIDTH, FOOT - e, WALL + e, WIDTH, FOOT + e, 1)
    bracket = occ.fillet([bracket], [tag for _, tag in inside], [FILLET])[0][1]
    bracket = occ.cut([(3, bracket)], [pin(x, y, 0, FOOT, HOLE) for x, y in BOLTS])[0][0][1]
    base = occ.cut(
        [(3, occ.addBox(-15, -45, -20, 90, 90, 20))], [pin(x, y, -DEPTH - 3, 0, BOLT) for x, y in BOLTS]
    )[0][0][1]
    solids = {"base": base, "bracket": bracket}
    for k, (x, y) in enumerate(BOLTS, start=1):
        shank, head = pin(x, y, -DEPTH, FOOT, BOLT), pin(x, y, FOOT, FOOT + HEAD_HEIGHT, HEAD)
        solids[f"bolt {k}"] = occ.fuse([shank], [head])[0][0][1]
    return {name: int(tag) for name, tag in solids.items()}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("path", nargs="?", type=Path, default=Path("bracket.step"))
    print(f"wrote {make_bracket(parser.parse_args().path)}")
