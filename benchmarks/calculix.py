"""Scenes by us and by CalculiX, through ``write_inp``: displacements and reactions on the same nodes.

``./run bench calculix [NAME ...] [--json FILE] [--keep FOLDER]`` writes, for each scene, how far apart
displacements at the nodes of the elements are: root mean square over that of the displacements
(``displacement``), the largest over the largest (``largest``); the same of reactions and bolt forces
(``reaction``), and the seconds of both. It needs ``ccx``, which ``peers/get_calculix.sh`` brings; without it
the decks are written, and the numbers are null.

What differs: contact here is a multiplier in the mean (mortar), there a penalty at points; hexahedra here
have 27 nodes, there 20; ties there hold nodes. Loads do not act on nodes that are held: CalculiX leaves them
out of what it prints as reaction.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from typing import Any

import common
import numpy as np
from peers import calculix

import dolfinx_frontend as lf
from dolfinx_frontend import geometry
from dolfinx_frontend.scene import laws

STEEL, SOFT = lf.LinearElastic(E=210e3, nu=0.3), lf.LinearElastic(E=70e3, nu=0.33)
LATER = lf.Amplitude([1, 2], [0, 1])
History = tuple[lf.Scene, list[float] | None]


def blocks(
    n: int = 4, m: int = 4, cell: str = "tetrahedron", size: float = 10.0, shift: float = 0.0, degree: int = 2
) -> lf.Scene:
    """A block on a harder one, which is held."""
    scene = lf.Scene()
    for name, count, z, material in (("lower", m, 0.0, STEEL), ("upper", n, size, SOFT)):
        inset = shift if name == "upper" else 0.0
        sides = (size - 2 * inset, size - 2 * inset, size)
        box = geometry.box(sides, (count, count, count), origin=(inset, inset, z), cell=cell)
        scene.substructure(name, box, material, degree=degree)
    scene.fix("lower:z0", name="ground")
    return scene


def pressed(cell: str, friction: float | None, n: int = 4, m: int = 4, shift: float = 0.0) -> History:
    """Pressed and sheared."""
    scene = blocks(n, m, cell, shift=shift)
    scene.interface("joint", "upper:z0", "lower:z1", lf.Contact(friction=friction))
    scene.fix("upper:z1", (0.03 if friction else 0.0, 0.0, -0.02), name="head")
    return scene, None


def glued(n: int, m: int) -> History:
    """A tie of meshes that match, or do not."""
    scene = blocks(n, m)
    scene.interface("glue", "upper:z0", "lower:z1", lf.Perfect())
    scene.traction("upper:x1", (5.0, 0.0, 40.0))
    return scene, None


def layer() -> History:
    """An elastic layer."""
    scene = blocks()
    scene.interface("layer", "upper:z0", "lower:z1", lf.Elastic(normal=2e4, tangential=5e3))
    scene.traction("upper:z1", (20.0, 5.0, 30.0))
    return scene, None


def slipping() -> History:
    """A plate under a held block is pulled, back and forth, with friction below and a soft stick slope."""
    scene = blocks(cell="hexahedron", n=3, m=3)
    scene.interface("joint", "upper:z0", "lower:z1", lf.Contact(friction=0.2, tangential_stiffness=2e4))
    scene.fix("upper:z1", lf.Amplitude([0, 1, 4], [0, 1, 1]) * (0.0, 0.0, -0.02) + lf.Amplitude(
        [1, 2, 3, 4], [0, 1, -1, 0]) * (0.03, 0.0, 0.0), name="head")
    return scene, [1.0, 2.0, 3.0, 4.0]


def bolted() -> History:
    """Two plates on a bolt that is cut, tightened by a force and fixed; then the plates are pulled apart."""
    scene = lf.Scene()
    for name, z in (("lower", 0.0), ("upper", 10.0)):
        plate = geometry.box((30, 30, 10), (6, 6, 2), origin=(0, 0, z), cell="tetrahedron")
        scene.substructure(name, plate, STEEL)
    for name, z in (("shank", 0.0), ("head", 10.0)):
        bolt = geometry.box((10, 10, 10), (2, 2, 3), origin=(40, 10, z), cell="tetrahedron")
        scene.substructure(name, bolt, STEEL)
    scene.interface("joint", "upper:z0", "lower:z1", lf.Contact(friction=0.15))
    scene.interface("bolt", "shank:z1", "head:z0", lf.Preload(force=5e3, until=1.0))
    scene.rigid(["head:z1", "upper:z1"], name="top", rx=0.0, ry=0.0, rz=0.0, x=0.0, y=0.0)
    scene.fix(["shank:z0", "lower:z0"], name="ground")
    scene.force("upper:z1", (0.0, 0.0, LATER * 3e3))
    return scene, [1.0, 2.0]


def shortened() -> History:
    """A bar that is cut and shortened between two walls."""
    scene = lf.Scene()
    for name, z in (("left", 0.0), ("right", 10.0)):
        half = geometry.box((4, 4, 10), (2, 2, 5), origin=(0, 0, z), cell="tetrahedron")
        scene.substructure(name, half, STEEL)
    scene.interface("cut", "left:z1", "right:z0", lf.Preload(shortening=0.02))
    scene.fix(["left:z0", "right:z1"], name="walls")
    return scene, None


def oblique() -> History:
    """A support along an oblique frame, and a symmetry plane."""
    scene = lf.Scene()
    scene.substructure("block", geometry.box((10, 10, 10), (4, 4, 4), cell="tetrahedron"), STEEL)
    c, s = math.cos(0.4), math.sin(0.4)
    axes = [[c, s, 0], [-s, c, 0], [0, 0, 1]]
    scene.fix("block:z0", (0.0, 0.0, 0.01), components=[0, 2], frame=axes, name="z")
    scene.symmetry("block:x0", name="x")
    scene.fix("block:y0", components=1, name="y")
    scene.pressure("block:z1", lambda x: 10.0 + x[:, 0])
    return scene, None


def remote() -> History:
    """A remote force and moment on a bar that is heated."""
    scene = lf.Scene()
    hot = lf.LinearElastic(E=210e3, nu=0.3, alpha=12e-6)
    scene.substructure("bar", geometry.box((10, 10, 30), (2, 2, 6), cell="tetrahedron"), hot)
    scene.fix("bar:z0", name="ground")
    scene.force("bar:z1", (300.0, 0.0, 0.0), moment=(0.0, 0.0, 2e3), point=(5.0, 5.0, 50.0))
    scene.temperature("bar", 30.0)
    return scene, None


def turned() -> History:
    """A rigid end is turned and shifted."""
    scene = lf.Scene()
    scene.substructure("bar", geometry.box((10, 10, 30), (3, 3, 8), cell="tetrahedron"), STEEL)
    scene.fix("bar:z0", name="ground")
    scene.rigid("bar:z1", point=(0.0, 0.0, 30.0), name="end", x=0.02, y=0.0, z=0.0, rx=0.0, ry=0.0, rz=0.002)
    return scene, None


def wood() -> History:
    """An orthotropic block in axes that are turned, compressed."""
    c, s = math.cos(0.5), math.sin(0.5)
    law = lf.OrthotropicElastic(E=(12e3, 1e3, 600.0), nu=(0.4, 0.4, 0.3), G=(800.0, 700.0, 60.0),
                                axes=[[c, s, 0], [-s, c, 0], [0, 0, 1]])
    scene = lf.Scene()
    scene.substructure("wood", geometry.box((10, 10, 10), (4, 4, 4), cell="tetrahedron"), law)
    scene.fix("wood:x0", name="ground")
    scene.fix("wood:x1", (-0.1, 0.0, 0.0), name="head")
    return scene, None


def plane(state: str) -> History:
    """Two plates in the plane, pressed on each other."""
    scene = lf.Scene(axisymmetric=state == "axisymmetric")
    law = lf.LinearElastic(E=210e3, nu=0.3, **({} if state == "axisymmetric" else {"plane": state}))
    for name, y, n in (("lower", 0.0, 6), ("upper", 10.0, 4)):
        scene.substructure(name, geometry.box((10, 10), (n, n), origin=(5, y), cell="triangle"), law)
    scene.interface("joint", "upper:y0", "lower:y1", lf.Contact())
    scene.fix("lower:y0", name="ground")
    scene.fix("upper:y1", (0.0, -0.02), name="head")
    return scene, None


def gap() -> History:
    """A gap that is closed in part."""
    scene = blocks()
    scene.interface("joint", "upper:z0", "lower:z1", lf.Contact(gap=0.004))
    scene.fix("upper:x0", components=[0, 1, 2], name="clamp")
    scene.traction("upper:x1", (0.0, 0.0, -60.0))
    return scene, None


SCENES: dict[str, Callable[[], History]] = {
    "pressed, tetrahedra": lambda: pressed("tetrahedron", None),
    "pressed, hexahedra": lambda: pressed("hexahedron", None),
    "sheared, tetrahedra": lambda: pressed("tetrahedron", 0.2),
    "sheared, hexahedra": lambda: pressed("hexahedron", 0.2),
    "meshes that do not match": lambda: pressed("tetrahedron", 0.2, n=5, shift=1.5),
    "glued": lambda: glued(4, 4),
    "glued, meshes that do not match": lambda: glued(6, 4),
    "elastic layer": layer,
    "back and forth": slipping,
    "gap": gap,
    "bolt": bolted,
    "shortened bar": shortened,
    "oblique supports": oblique,
    "remote force, temperature": remote,
    "rigid end": turned,
    "orthotropic": wood,
    "plane strain": lambda: plane("strain"),
    "plane stress": lambda: plane("stress"),
    "axisymmetric": lambda: plane("axisymmetric"),
}


def compared(scene: lf.Scene, times: list[float] | None, deck: Path) -> dict[str, Any]:
    """Differences of a scene, relative."""
    problem = lf.assemble(scene)
    began = perf_counter()
    given = {} if times is None else {"times": times}
    result = lf.solve(problem, progress=False, options=lf.Options(rtol=1e-8), **given)
    seconds = perf_counter() - began
    found = calculix.run(problem, times, deck)
    record: dict[str, Any] = {"unknowns": problem.size, "status": result.status, "seconds": seconds}
    if found is None:
        return record | dict.fromkeys(("displacement", "largest", "reaction", "ccx_seconds"))
    record["ccx_seconds"] = found.seconds
    fields = [result.unknowns(name).reshape(-1, *u.shape)[-1] for name, u in found.u.items()]
    ours = np.concatenate(fields)
    off = np.concatenate(list(found.u.values())) - ours
    there = ~np.isnan(off)  # hexahedra have fewer nodes there
    record["largest"] = float(np.abs(off[there]).max() / np.abs(ours).max())
    record["displacement"] = float(np.linalg.norm(off[there]) / np.linalg.norm(ours[there]))
    table = result.table()
    rows = {name: row for row, name in enumerate(table["interface"])}
    read = (laws.Displacement, laws.Symmetry, laws.Preload)
    held = [n for n, i in scene.interfaces.items() if isinstance(i.law, read)]
    forces = {}
    for name in held:
        if name in rows:
            force = [table[f"force_{axis}"][rows[name]] for axis in "xyz"[: problem.dim]]
            forces[calculix.set_of(name)] = np.array(force)
    # of a ring there two degrees are printed, along the radius without what hoop stresses do
    ring, kept = (180.0, slice(1, 2)) if scene.axisymmetric else (1.0, slice(0, problem.dim))
    largest = max((np.abs(f[kept]).max() for f in forces.values()), default=0.0)
    away = [np.abs(ring * found.forces[key][kept] - f[kept]).max() for key, f in forces.items()]
    record["reaction"] = float(max(away) / largest) if away and largest > 0.0 else None
    return record


def main() -> None:
    """All scenes, or those that are named."""
    parser = common.parser("calculix", __doc__)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--keep", type=Path, help="folder of the decks")
    given = parser.parse_args()
    unknown = set(given.names) - set(SCENES)
    if unknown:
        parser.error(f"unknown: {', '.join(sorted(unknown))}; there are: {', '.join(SCENES)}")
    record: dict[str, Any] = {"environment": common.environment(), "scenes": {}}
    with tempfile.TemporaryDirectory() as scratch:
        folder = given.keep or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        for name in given.names or SCENES:
            deck = folder / f"{name.replace(', ', '_').replace(' ', '_')}.inp"
            found = record["scenes"][name] = compared(*SCENES[name](), deck)
            keys = ("displacement", "largest", "reaction")
            shown = [f"{found[key]:8.1e}" if found[key] is not None else "     -  " for key in keys]
            print(f"{name:35} {found['unknowns']:7} {found['status']:10} {' '.join(shown)}", flush=True)
    common.write_json(record, given.json)


if __name__ == "__main__":
    main()
