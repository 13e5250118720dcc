"""Meshes of a bolted lap joint: two plates in single shear and two bolts, each part meshed on its own.

Units are those of the dimensions, millimetres by default.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.errors import SceneError, unknown_name
from dolfinx_frontend.geometry.finer import remeshable_model
from dolfinx_frontend.geometry.gmsh import from_gmsh, gmsh_session, refine_around
from dolfinx_frontend.geometry.parts import FREE, Assembly, Connection, Part
from dolfinx_frontend.geometry.sizes import SizeField
from parts.faces import name_faces

__all__ = ["LapJoint", "LapShape", "lap_joint"]


_SIZES = {"coarse": 12.0, "medium": 5.5}  # mm, for bolts of radius 6 mm
_OPTIONS = {
    "Mesh.MeshSizeFromPoints": 0.0,
    "Mesh.MeshSizeFromCurvature": 0.0,
    "Mesh.MeshSizeExtendFromBoundary": 0.0,
    "Mesh.Algorithm": 6.0,
    "Mesh.Algorithm3D": 1.0,
    "Mesh.SecondOrderIncomplete": 0.0,
}


@dataclass(frozen=True)
class LapShape:
    """Dimensions of a lap joint.

    Attributes
    ----------
    thickness
        Of each plate.
    width
        Of the plates; half of it is modelled.
    pitch
        Distance of the two bolts, along the load.
    margin
        From the axis of a bolt to the end of the plate that it is next to.
    free_length
        Of each plate, outside of the overlap.
    bolt_radius, hole_radius, head_radius
        Of shank, clearance hole and of head and nut.
    head_height
        Of head and nut.
    """

    thickness: float = 10.0
    width: float = 40.0
    pitch: float = 40.0
    margin: float = 20.0
    free_length: float = 30.0
    bolt_radius: float = 6.0
    hole_radius: float = 7.0
    head_radius: float = 11.0
    head_height: float = 8.0

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if not (math.isfinite(value) and value > 0.0):
                raise SceneError(f"lap_joint: {name} = {value} must be positive and finite")
        radii = (self.bolt_radius, self.hole_radius, self.head_radius)
        if not radii[0] < radii[1] < radii[2]:
            raise SceneError(f"lap_joint: the radii {radii} of bolt, hole and head must grow")
        room = min(self.pitch / 2, self.margin, self.width / 2)
        if self.head_radius >= room:
            raise SceneError(
                f"lap_joint: head_radius = {self.head_radius} must be below {room:g}, the room that "
                "pitch / 2, margin and width / 2 leave"
            )

    @property
    def overlap(self) -> float:
        """Length of the overlap; its middle is x = 0."""
        return self.pitch + 2 * self.margin

    @property
    def bolts(self) -> tuple[float, float]:
        """x of the two axes."""
        return -self.pitch / 2, self.pitch / 2


@dataclass(frozen=True, eq=False, repr=False)
class LapJoint(Assembly):
    """Half of a bolted lap joint, see :func:`lap_joint`."""

    @property
    def clearance(self) -> float:
        """Distance of a centred shank to the wall of its hole."""
        return float(self.parameters["hole_radius"] - self.parameters["bolt_radius"])


def lap_joint(size: str | float = "coarse", *, geometry_order: int = 2, **dimensions: float) -> LapJoint:
    """Two plates that overlap and two bolts through them: the half y >= 0, by symmetry.

    The plates meet in z = 0 and are pulled along x: ``lower`` reaches to -x, ``upper`` to +x. Each plate
    and each bolt is meshed by itself, so that the meshes of plates, heads and nuts do not match; head,
    shank and nut of a bolt match node for node.

    ==================  =================================================================================
    part                faces besides ``symmetry`` (y = 0) and ``free``
    ==================  =================================================================================
    lower, upper        end (x = -+ far), lap (in z = 0), seat1, seat2 (under nut or head), hole1, hole2
    head1, head2        seat (annulus on the upper plate and its hole), shank (the disc where the shank ends)
    shank1, shank2      top (in the plane of the head's seat), thread (in the nut), side (in the holes)
    nut1, nut2          seat (annulus on the lower plate and its hole), thread
    ==================  =================================================================================

    Interfaces, by name, with their kinds:

    * contact (5): ``plates`` (lower:lap - upper:lap), ``head1``, ``head2`` (upper:seat1 - head1:seat),
      ``nut1``, ``nut2`` (lower:seat1 - nut1:seat);
    * elastic (2): ``cut1``, ``cut2``, shank:top - head:shank, where a bolt is shortened by its preload;
    * perfect (2): ``thread1``, ``thread2``;
    * symmetry (8): ``symmetry PART``;
    * support (2): ``clamp`` (lower:end) and ``grip`` (upper:end).

    Shanks and holes have no interface: they do not touch as long as the slip stays below the clearance.

    Parameters
    ----------
    size
        ``"coarse"``, ``"medium"`` or the size of the plates' cells in the unit of the dimensions; cells
        around the holes and of the bolts are smaller. The names scale with the radius of the bolts.
    geometry_order
        2: cells follow the cylinders; 1: straight cells.
    **dimensions
        Any attribute of :class:`LapShape`.

    Raises
    ------
    SceneError
        Unknown names, dimensions that contradict each other, a size too coarse to mesh.
    """
    if geometry_order not in (1, 2):
        raise SceneError(f"geometry_order = {geometry_order} must be 1 (straight) or 2 (curved)")
    known = [f.name for f in fields(LapShape)]
    for name in dimensions:
        if name not in known:
            raise unknown_name("dimension", name, known, "lap_joint")
    shape = LapShape(**dimensions)
    if isinstance(size, str):
        if size not in _SIZES:
            raise unknown_name("size", size, _SIZES, "lap_joint")
        size = _SIZES[size] * shape.bolt_radius / 6.0
    if not (math.isfinite(size) and size > 0.0):
        raise SceneError(f"lap_joint: size = {size} must be positive and finite")
    parts: dict[str, Part] = {}
    for name in ("lower", "upper"):
        parts |= remeshable_model(partial(_plate, shape, name, size, geometry_order))
    for number in (1, 2):
        parts |= remeshable_model(partial(_bolt, shape, number, size, geometry_order))
    interfaces = [Connection("plates", "contact", "lower:lap", "upper:lap")]
    for n in (1, 2):
        interfaces += [
            Connection(f"head{n}", "contact", f"upper:seat{n}", f"head{n}:seat"),
            Connection(f"nut{n}", "contact", f"lower:seat{n}", f"nut{n}:seat"),
            Connection(f"cut{n}", "elastic", f"shank{n}:top", f"head{n}:shank"),
            Connection(f"thread{n}", "perfect", f"shank{n}:thread", f"nut{n}:thread"),
        ]
    interfaces += [Connection(f"symmetry {name}", "symmetry", f"{name}:symmetry") for name in parts]
    interfaces += [
        Connection("clamp", "support", "lower:end"),
        Connection("grip", "support", "upper:end"),
    ]
    parameters = asdict(shape) | {"mesh_size": size, "geometry_order": geometry_order}
    return LapJoint(parts, tuple(interfaces), MappingProxyType(parameters))


def _plate(
    shape: LapShape, name: str, size: float, order: int, sizes: Mapping[str, SizeField] | None
) -> dict[str, Part]:
    """One plate, in several volumes so that the rim of the seats is a line of the mesh."""
    sign = -1.0 if name == "lower" else 1.0
    half, t, y = shape.overlap / 2, shape.thickness, shape.width / 2
    low = min(0.0, sign * t)
    with gmsh_session(name, _OPTIONS) as gmsh:
        occ = gmsh.model.occ

        def pins(radius: float) -> list[tuple[int, int]]:
            return [
                (3, occ.addCylinder(x, 0, low, 0, 0, t, radius, angle=math.pi)) for x in shape.bolts
            ]

        start = half if sign > 0 else -half - shape.free_length
        arm = (3, occ.addBox(start, 0, low, shape.free_length, y, t))
        lap = occ.cut([(3, occ.addBox(-half, 0, low, 2 * half, y, t))], pins(shape.head_radius))[0]
        rings = occ.cut(pins(shape.head_radius), pins(shape.hole_radius))[0]
        pieces, _ = occ.fragment(lap, [arm, *rings])
        occ.synchronize()
        tags = [tag for _, tag in pieces]
        # the meshes of the two plates shall not match
        return _meshed(gmsh, shape, {name: tags}, size if sign < 0 else 1.2 * size, order, sizes)


def _bolt(
    shape: LapShape, number: int, size: float, order: int, sizes: Mapping[str, SizeField] | None
) -> dict[str, Part]:
    """Head, shank and nut of one bolt; they share the nodes of their common faces."""
    t, x = shape.thickness, shape.bolts[number - 1]
    low, high = -t - shape.head_height, t + shape.head_height
    with gmsh_session(f"bolt{number}", _OPTIONS) as gmsh:
        occ = gmsh.model.occ

        def pin(radius: float, start: float, end: float) -> tuple[int, int]:
            return 3, occ.addCylinder(x, 0, start, 0, 0, end - start, radius, angle=math.pi)

        head = [pin(shape.head_radius, t, high)]
        thread = pin(shape.bolt_radius, low, -t)
        nut = occ.cut([pin(shape.head_radius, low, -t)], [thread], removeTool=False)[0]
        shank = [thread, pin(shape.bolt_radius, -t, t)]
        bodies = [*head, *nut, *shank]
        _, pieces = occ.fragment(bodies[:1], bodies[1:])
        occ.synchronize()
        volumes: dict[str, list[int]] = {}
        names = ["head"] * len(head) + ["nut"] * len(nut) + ["shank"] * len(shank)
        for name, piece in zip(names, pieces, strict=True):
            volumes.setdefault(f"{name}{number}", []).extend(tag for _, tag in piece)
        return _meshed(gmsh, shape, volumes, size, order, sizes)


def _meshed(
    gmsh: Any,
    shape: LapShape,
    volumes: Mapping[str, Sequence[int]],
    size: float,
    order: int,
    sizes: Mapping[str, SizeField] | None,
) -> dict[str, Part]:
    """Mesh the volumes, name their faces, and make parts of them."""
    model = gmsh.model
    for name, tags in volumes.items():
        model.addPhysicalGroup(3, tags, name=name)
    if sizes is None:
        refine_around(
            model,
            shape.bolts,
            shape.head_radius,
            size,
            # at least three cells along a half circle, or curved cells fold
            smallest=min(0.7 * size, 1.05 * shape.bolt_radius),
            reach=shape.head_radius,
        )
    else:
        SizeField.joined(sizes.values()).set(gmsh)
    try:
        model.mesh.generate(3)
        if order == 2:
            model.mesh.setOrder(2)
    except Exception as failure:  # gmsh raises nothing more specific
        raise SceneError(
            f"gmsh cannot mesh {', '.join(volumes)} with size = {size:g} ({failure}); reduce size"
        ) from failure
    worst = min(
        float(model.mesh.getElementQualities(tags, "minSJ").min())
        for tags in model.mesh.getElements(3)[1]
    )
    if worst <= 0.0:
        raise SceneError(
            f"lap_joint: curved cells of {', '.join(volumes)} are folded (scaled Jacobian {worst:.2g}); "
            "reduce size or use geometry_order=1"
        )
    name_faces(model, volumes, lambda part, x: _face(part, shape, x))
    return from_gmsh(model).parts


def _face(part: str, shape: LapShape, x: Array) -> str:
    """Face of the part that a surface with the nodes x, (nodes, 3), belongs to."""
    t = shape.thickness
    small = 1e-6 * shape.overlap
    far = shape.overlap / 2 + shape.free_length
    z = x[:, 2]

    def at(value: Array, target: float) -> bool:
        return bool(np.all(np.abs(value - target) < small))

    def within(value: Array, low: float, high: float) -> bool:
        return bool(value.min() > low - small and value.max() < high + small)

    if at(x[:, 1], 0.0):
        return "symmetry"
    if part in ("lower", "upper"):
        sign = -1.0 if part == "lower" else 1.0
        half = shape.overlap / 2
        if at(sign * x[:, 0], far):
            return "end"
        if at(z, 0.0) and within(x[:, 0], -half, half):
            return "lap"
        for number, axis in enumerate(shape.bolts, start=1):
            r = np.hypot(x[:, 0] - axis, x[:, 1])
            if at(r, shape.hole_radius):
                return f"hole{number}"
            if at(z, sign * t) and within(r, shape.hole_radius, shape.head_radius):
                return f"seat{number}"
        return FREE
    r = np.hypot(x[:, 0] - shape.bolts[int(part[-1]) - 1], x[:, 1])
    seat = within(r, shape.bolt_radius, shape.head_radius)
    tests = {
        "head": {"seat": at(z, t) and seat, "shank": at(z, t) and within(r, 0.0, shape.bolt_radius)},
        "nut": {"seat": at(z, -t) and seat, "thread": at(r, shape.bolt_radius)},
        "shank": {
            "top": at(z, t),
            "side": at(r, shape.bolt_radius) and within(z, -t, t),
            "thread": at(r, shape.bolt_radius) and within(z, -t - shape.head_height, -t),
        },
    }
    return next((face for face, holds in tests[part[:-1]].items() if holds), FREE)
