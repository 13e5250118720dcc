"""Scenes of the verification, in any system of units."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import numpy as np
import numpy.typing as npt

from dolfinx_frontend import geometry
from dolfinx_frontend.assembly.assemble import assemble
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.scene.laws import Elastic, Law, Perfect, Pressure, Symmetry
from dolfinx_frontend.scene.materials import LinearElastic
from dolfinx_frontend.scene.scene import Scene
from parts.blocks import block_chain
from parts.rings import two_rings
from parts.vessel import BoltedVessel

Array = npt.NDArray[np.float64]

DEMOS = Path(__file__).resolve().parents[2] / "demos"
SCREW = 2.5e4
"""Axial stiffness of the half screw that a sector holds, N/mm."""
JOINT = 100.0
"""Stiffness of the joint, N/mm^3."""


def demo(name: str) -> ModuleType:
    """A script of ``demos`` as a module."""
    spec = importlib.util.spec_from_file_location(f"{name}_demo", DEMOS / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # its dataclasses look themselves up
    spec.loader.exec_module(module)
    return module


@dataclass(frozen=True)
class Units:
    """How many units of length and of force make one mm and one N."""

    length: float = 1.0
    force: float = 1.0

    def __call__(self, value: float, length: int, force: int = 1) -> float:
        """A value in N^force mm^length, in these units."""
        return value * self.length**length * self.force**force


MM = Units()
UNITS = {"N-mm": MM, "N-m": Units(1e-3), "kN-m": Units(1e-3, 1e-3)}


@contextmanager
def in_units(parts: dict[str, geometry.Part], units: Units) -> Iterator[None]:
    """Coordinates of the parts in other units, as long as the context lasts."""
    nodes = {name: part.mesh.geometry.x.copy() for name, part in parts.items()}
    for part in parts.values():
        part.mesh.geometry.x[:] *= units.length
    try:
        yield
    finally:  # to the last bit: other tests share the meshes
        for name, part in parts.items():
            part.mesh.geometry.x[:] = nodes[name]


def vessel(shape: BoltedVessel, units: Units = MM) -> Problem:
    """The bolted vessel of the paper: six parts, twenty interfaces."""
    steel = LinearElastic(E=units(200e3, -2), nu=0.3)
    screw = units(SCREW, -1)
    joint = units(JOINT, -3)
    laws: dict[str, Law] = {
        "joint": Elastic(normal=joint, tangential=joint),
        "screw": Elastic(normal=screw, tangential=screw, jump=units(-0.2, 1, 0), total=True),
    }
    kinds: dict[str, Law] = {
        "perfect": Perfect(),
        "symmetry": Symmetry(),
        "support": Symmetry(),
        "pressure": Pressure(units(1.6, -2)),
    }
    scene = Scene()
    with in_units(shape.parts, units):
        for name, part in shape.parts.items():
            scene.substructure(name, part, steel, degree=2)
        for c in shape.interfaces:
            faces = [face for face in (c.face1, c.face2) if face]
            scene.interface(c.name, *faces, laws.get(c.name) or kinds[c.kind])
        return assemble(scene)


def chain(parts: int = 5) -> Problem:
    """Blocks end to end, pulled, sheared and preloaded; their joints are in turn perfect and elastic."""
    blocks = block_chain(parts, (20.0, 10.0, 10.0), (3, 2, 2))
    scene = Scene()
    for name, part in blocks.parts.items():
        scene.substructure(name, part, LinearElastic(E=200e3, nu=0.3), degree=2)
    for i, c in enumerate(blocks.interfaces):
        law = Perfect() if i % 2 == 0 else Elastic(normal=2e3, tangential=500.0, jump=-0.01)
        scene.interface(c.name, c.face1, c.face2, law)
    scene.fix("block0:x0", name="wall")
    scene.traction(f"block{parts - 1}:x1", (10.0, 0.0, -2.0), name="pull")
    return assemble(scene)


@dataclass(frozen=True)
class SplitRing:
    """Two rings with springs between them under inner pressure, plane strain (mm, N)."""

    a: float = 100.0
    c: float = 150.0
    b: float = 200.0
    E: float = 2e5
    nu: float = 0.3
    p: float = 1.6
    k: float = 2e3

    def displacement(self, r: float, low: float, high: float, inside: float, outside: float) -> float:
        """Radial displacement of a ring between two pressures (Lame)."""
        factor = (1.0 + self.nu) / (self.E * (high**2 - low**2))
        uniform = (1.0 - 2.0 * self.nu) * (inside * low**2 - outside * high**2)
        return factor * (uniform * r + (inside - outside) * low**2 * high**2 / r)

    def pressure(self, k: float | None = None) -> float:
        """Pressure at r = c, from equal displacements plus the compression p_c / k of the springs."""
        c = self.c
        compliance = (
            self.displacement(c, c, self.b, 1.0, 0.0)
            - self.displacement(c, self.a, c, 0.0, 1.0)
            + 1.0 / (k or self.k)
        )
        return self.displacement(c, self.a, c, self.p, 0.0) / compliance

    def problem(self, divisions: tuple[int, int] = (8, 16)) -> Problem:
        """A quarter of the rings."""
        rings = two_rings(self.a, self.c, self.b, divisions=divisions)
        scene = Scene()
        for name, part in rings.parts.items():
            scene.substructure(name, part, LinearElastic(self.E, self.nu), degree=2)
        scene.interface("joint", "inner:outer", "outer:inner", Elastic(normal=self.k))
        scene.pressure("inner:inner", self.p, name="bore")
        for part in rings.parts:
            scene.symmetry([f"{part}:theta0", f"{part}:theta1"])
        return assemble(scene)
