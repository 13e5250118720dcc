"""A motor mount as a STEP file, made with gmsh's OpenCASCADE.

    ./run python demos/make_mount_step.py mount.step

Eleven solids, in mm: a base of 200 x 120 x 12, its top at z = 0; a gasket of 2 mm; a foot with a floor of
10 mm, two walls of 60 mm and a rib outside of each; four M10 bolts with discs as heads, and their nuts.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from parts.step_file import write_step

BOLTS = ((-75.0, -40.0), (75.0, -40.0), (-75.0, 40.0), (75.0, 40.0))


def make_mount(path: str | Path) -> Path:
    """Write the STEP file."""
    return write_step(path, _solids)


def _solids(occ: Any) -> dict[str, int]:
    def pin(x: float, y: float, low: float, high: float, radius: float) -> tuple[int, int]:
        return 3, occ.addCylinder(x, y, low, 0, 0, high - low, radius)

    def bored(body: tuple[int, int], low: float, high: float) -> int:
        return int(occ.cut([body], [pin(x, y, low - 1, high + 1, 5.5) for x, y in BOLTS])[0][0][1])

    base = bored((3, occ.addBox(-100, -60, -12, 200, 120, 12)), -12, 0)
    gasket = bored((3, occ.addBox(-100, -60, 0, 200, 120, 2)), 0, 2)
    floor = (3, occ.addBox(-100, -60, 2, 200, 120, 10))
    more = [(3, occ.addBox(x, -60, 12, 10, 120, 60)) for x in (-50, 40)]
    more += [(3, occ.addBox(x, -5, 12, 20, 10, 30)) for x in (-70, 50)]
    foot = bored(occ.fuse([floor], more)[0][0], 2, 12)
    solids = {"base": base, "gasket": gasket, "foot": foot}
    for k, (x, y) in enumerate(BOLTS, start=1):
        solids[f"bolt {k}"] = int(occ.fuse([pin(x, y, -20, 12, 5)], [pin(x, y, 12, 18.4, 8)])[0][0][1])
        solids[f"nut {k}"] = int(occ.cut([pin(x, y, -20, -12, 8)], [pin(x, y, -21, -11, 5)])[0][0][1])
    return solids


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("path", nargs="?", type=Path, default=Path("mount.step"))
    print(f"wrote {make_mount(parser.parse_args().path)}")
