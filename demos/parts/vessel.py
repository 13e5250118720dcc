"""The bolted vessel: a body, its cover, and the screws that hold it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.errors import SceneError, unknown_name
from dolfinx_frontend.geometry.finer import remeshable_model
from dolfinx_frontend.geometry.gmsh import curve_elements, from_gmsh, gmsh_session, refine_around
from dolfinx_frontend.geometry.parts import (
    FREE,
    Assembly,
    Connection,
    Part,
    check_order,
    check_positive,
)
from dolfinx_frontend.geometry.sizes import SizeField
from parts.faces import name_faces

__all__ = ["BoltedVessel", "VesselShape", "bolted_vessel"]


@dataclass(frozen=True, eq=False, repr=False)
class BoltedVessel(Assembly):
    """Sector of a pressurised vessel with half a screw, see :func:`bolted_vessel`."""

    @property
    def screw_area(self) -> float:
        """Cross-section of a whole screw; the sector holds half of it."""
        return math.pi * float(self.parameters["screw_radius"]) ** 2

    @property
    def pressure_force(self) -> float:
        """Axial force of a unit pressure on the cover, per whole screw."""
        p = self.parameters
        return math.pi * float(p["bore_radius"]) ** 2 / int(p["n_screws"])


@dataclass(frozen=True)
class VesselShape:
    """Dimensions of :func:`bolted_vessel`, in mm.

    Attributes
    ----------
    n_screws
        Number of screws; the sector modelled opens by pi / n_screws.
    bore_radius, wall_thickness, height
        The cylinder, from its cut (z = 0) to the seat of the joint ring (z = height).
    flange_thickness, flange_radius
        The flange around the upper end of the cylinder, its top flush with it; the cover has the
        same outer radius.
    ring_thickness
        The joint ring, as wide as the wall.
    cover_thickness
        The cover, a full disc.
    bolt_circle, screw_radius, hole_radius, head_radius, head_height
        Radius of the circle of the screw axes, the shank, the clearance hole in the cover, the
        head.

    Raises
    ------
    SceneError
        A dimension that is not positive, or two that contradict each other.
    """

    n_screws: int = 8
    bore_radius: float = 90.0
    wall_thickness: float = 20.0
    height: float = 100.0
    flange_thickness: float = 30.0
    flange_radius: float = 160.0
    ring_thickness: float = 6.0
    cover_thickness: float = 30.0
    bolt_circle: float = 135.0
    screw_radius: float = 9.0
    hole_radius: float = 11.0
    head_radius: float = 16.0
    head_height: float = 14.0

    def __post_init__(self) -> None:
        check_positive(**asdict(self))
        if self.n_screws != int(self.n_screws) or self.n_screws < 3:
            raise SceneError(f"n_screws = {self.n_screws} must be a whole number of at least 3")
        hole_inside = self.bolt_circle - self.hole_radius
        head_outside = self.bolt_circle + self.head_radius
        to_plane = self.bolt_circle * math.sin(self.angle)
        for rule, low, high in (
            ("flange_thickness < height", self.flange_thickness, self.height),
            ("screw_radius < hole_radius", self.screw_radius, self.hole_radius),
            ("hole_radius < head_radius", self.hole_radius, self.head_radius),
            ("bore_radius + wall_thickness < bolt_circle - hole_radius", self.wall, hole_inside),
            ("bolt_circle + head_radius < flange_radius", head_outside, self.flange_radius),
            ("head_radius < bolt_circle sin(pi / n_screws)", self.head_radius, to_plane),
        ):
            if not low < high:
                raise SceneError(f"the vessel needs {rule}, but {low:g} >= {high:g}")

    @property
    def angle(self) -> float:
        """Opening of the sector in radians."""
        return math.pi / self.n_screws

    @property
    def wall(self) -> float:
        """Outer radius of the cylinder."""
        return self.bore_radius + self.wall_thickness

    @property
    def levels(self) -> tuple[float, float, float, float, float]:
        """z of the flange's bottom, ring's bottom, ring's top, cover's top and head's top."""
        cover = self.height + self.ring_thickness
        seat = cover + self.cover_thickness
        low = self.height - self.flange_thickness
        return low, self.height, cover, seat, seat + self.head_height


_VESSEL_SIZES = {"coarse": 28.0, "paper": 9.6}  # mm, for a flange radius of 160 mm

_VESSEL_INTERFACES = (
    Connection("weld", "perfect", "cylinder:weld", "flange:weld"),
    Connection("ring seat", "perfect", "cylinder:top", "ring:bottom"),
    Connection("thread", "perfect", "flange:thread", "shank:thread"),
    Connection("head seat", "perfect", "cover:seat", "head:seat"),
    Connection("joint", "elastic", "ring:top", "cover:joint"),
    Connection("screw", "elastic", "shank:top", "head:shank"),
    *(Connection(f"pressure {p}", "pressure", f"{p}:inner") for p in ("cylinder", "ring", "cover")),
    *(
        Connection(f"symmetry {p} {face}", "symmetry", f"{p}:{face}")
        for p in ("cylinder", "flange", "ring", "cover", "shank", "head")
        for face in (("theta0",) if p in ("shank", "head") else ("theta0", "theta1"))
    ),
    Connection("support", "support", "cylinder:bottom"),
)


def bolted_vessel(
    size: str | float = "coarse", *, geometry_order: int = 2, **dimensions: float
) -> BoltedVessel:
    """A pressurised cylinder closed by a screwed cover: the sector that holds half a screw.

    The example of Blanze, Champaney and Boucard (ECCOMAS 2004, section 5) in six parts and twenty
    interfaces.  The axis of the vessel is z, the axis of the screw lies in the symmetry plane
    theta = 0, the other symmetry plane is theta = pi / n_screws.

    ==========  ===========================  ============================================
    part        what it is                   faces besides ``theta0``, ``theta1``, ``free``
    ==========  ===========================  ============================================
    cylinder    the wall, up to the joint    bottom, inner, top, weld
    flange      welded around its end        weld, thread
    ring        seat of the joint            bottom, inner, top
    cover       full disc, clearance hole    inner, joint, seat
    shank       half the screw's body        thread, top
    head        half the screw's head        shank, seat
    ==========  ===========================  ============================================

    The interfaces are in ``vessel.interfaces``:

    * perfect (4): cylinder:weld - flange:weld, cylinder:top - ring:bottom,
      flange:thread - shank:thread, cover:seat - head:seat;
    * elastic (2): the joint ring:top - cover:joint and the screw shank:top - head:shank;
    * pressure (3): cylinder:inner, ring:inner, cover:inner;
    * symmetry (10): theta0 of every part, theta1 of every part but shank and head;
    * support (1): cylinder:bottom, held along z.

    The meshes are tetrahedra and match node for node across every pair of faces.  The sector
    carries half a screw: a whole-screw stiffness K is K / ``vessel.screw_area`` per unit area.

    Parameters
    ----------
    size
        ``"coarse"``, ``"paper"`` or the cell size in the unit of the dimensions; cells on the
        screw are smaller.  The two names scale with the flange radius.  Degrees of freedom of
        quadratic displacements, all parts together, default dimensions (the paper has 23 760):

        =========  =======  =======  =======  ========  ========
        size       coarse   paper    6        5         3
        h (mm)     28       9.6      6        5         3
        dof        5 800    24 400   67 000   105 000   403 000
        =========  =======  =======  =======  ========  ========
    geometry_order
        2: cells follow the cylinders (default); 1: straight cells, whose polygons lose a few
        percent of the screw's section on a coarse mesh.
    **dimensions
        Any attribute of :class:`VesselShape`.

    Notes
    -----
    The dimensions of the paper are in a figure that is not legible, so the defaults are a choice:
    with E = 200 GPa, nu = 0.3, 1.6 MPa inside, screws of 5e4 N/mm shortened by 0.2 mm and a joint
    of 100 N/mm^3 in all directions, the joint is in compression everywhere (-2.25 to -0.54 MPa),
    least at the bore between two screws.  With independent standard normal germs, coefficients of
    variation 0.1 (screw) and 0.2 (joint), it is in traction somewhere with a probability of about
    4 %.

    Raises
    ------
    SceneError
        Unknown names, dimensions that contradict each other, a size too coarse to mesh.
    """
    order = check_order(geometry_order)
    known = [f.name for f in fields(VesselShape)]
    for name in dimensions:
        if name not in known:
            raise unknown_name("dimension", name, known, "bolted_vessel")
    shape = VesselShape(**dimensions)  # type: ignore[arg-type]
    if isinstance(size, str):
        if size not in _VESSEL_SIZES:
            raise unknown_name("size", size, _VESSEL_SIZES, "bolted_vessel")
        size = _VESSEL_SIZES[size] * shape.flange_radius / 160.0
    check_positive(size=size)
    parts = remeshable_model(partial(_meshed, shape, float(size), order))
    parameters = asdict(shape) | {"mesh_size": size, "geometry_order": order}
    return BoltedVessel(parts, _VESSEL_INTERFACES, MappingProxyType(parameters))


def _meshed(
    shape: VesselShape, size: float, order: int, sizes: Mapping[str, SizeField] | None
) -> dict[str, Part]:
    """All parts, with their own sizes or with others."""
    options = {
        "Mesh.MeshSizeFromPoints": 0.0,
        "Mesh.MeshSizeFromCurvature": 0.0,
        "Mesh.MeshSizeExtendFromBoundary": 0.0,
        "Mesh.Algorithm": 6.0,
        "Mesh.Algorithm3D": 1.0,
        "Mesh.SecondOrderIncomplete": 0.0,
    }
    with gmsh_session("bolted_vessel", options) as gmsh:
        volumes = _vessel_volumes(gmsh.model, shape)
        if sizes is None:
            refine_around(
                gmsh.model,
                [shape.bolt_circle],
                shape.head_radius,
                size,
                # at least three cells along a half circle, or curved cells fold
                smallest=min(0.6 * size, 1.05 * shape.screw_radius),
                reach=2 * shape.head_radius,
            )
        else:
            SizeField.joined(sizes.values()).set(gmsh)
        try:
            gmsh.model.mesh.generate(3)
        except Exception as failure:  # gmsh raises nothing more specific
            raise SceneError(
                f"gmsh cannot mesh the vessel with size = {size:g} ({failure}); reduce size"
            ) from failure
        if order == 2 and sizes is None:
            curve_elements(gmsh.model)
        elif order == 2:
            _curve_graded(gmsh.model)
        name_faces(gmsh.model, volumes, lambda part, x: _vessel_face(part, shape, x))
        return from_gmsh(gmsh.model).parts


def _curve_graded(model: Any) -> None:
    """Second order for a mesh of other sizes; to optimise its folded cells may end the process."""
    mesh = model.mesh

    def folded() -> bool:
        return min(mesh.getElementQualities(t, "minSJ").min() for t in mesh.getElements(3)[1]) <= 0.0

    mesh.setOrder(2)
    if folded():
        mesh.optimize("HighOrderElastic")
        if folded():
            raise SceneError("bolted_vessel: curved cells of these sizes are folded; ask for smaller ones")


def _vessel_volumes(model: Any, shape: VesselShape) -> dict[str, list[int]]:
    """Build the solids with shared surfaces; part name -> volume tags, also as groups."""
    occ = model.occ
    flange, ring, cover, seat, end = shape.levels
    bore, wall, outer = shape.bore_radius, shape.wall, shape.flange_radius
    solid = tuple[int, int]

    def disc(radius: float, low: float, high: float) -> solid:
        return 3, occ.addCylinder(0, 0, low, 0, 0, high - low, radius, angle=shape.angle)

    def pin(radius: float, low: float, high: float) -> solid:
        x = shape.bolt_circle
        return 3, occ.addCylinder(x, 0, low, 0, 0, high - low, radius, angle=math.pi)

    def cut(body: solid, *tools: solid) -> solid:
        dimension, tag = occ.cut([body], list(tools))[0][0]
        return dimension, tag

    bodies = {
        "cylinder": cut(disc(wall, 0, ring), disc(bore, 0, ring)),
        "flange": cut(
            disc(outer, flange, ring),
            disc(wall, flange, ring),
            pin(shape.screw_radius, flange, ring),
        ),
        "ring": cut(disc(wall, ring, cover), disc(bore, ring, cover)),
        "cover": cut(disc(outer, cover, seat), pin(shape.hole_radius, cover, seat)),
        "shank": pin(shape.screw_radius, flange, seat),
        "head": pin(shape.head_radius, seat, end),
    }
    first, *others = bodies.values()
    _, pieces = occ.fragment([first], others)
    occ.synchronize()
    volumes = {name: [tag for _, tag in piece] for name, piece in zip(bodies, pieces)}
    for name, tags in volumes.items():
        model.addPhysicalGroup(3, tags, name=name)
    return volumes


def _vessel_face(part: str, shape: VesselShape, x: Array) -> str:
    """Face of the part that a surface with the nodes x, (nodes, 3), belongs to."""
    flange, ring, cover, seat, _ = shape.levels
    cos, sin = math.cos(shape.angle), math.sin(shape.angle)
    small = 1e-6 * shape.flange_radius
    z = x[:, 2]
    r = np.hypot(x[:, 0], x[:, 1])  # from the axis of the vessel
    d = np.hypot(x[:, 0] - shape.bolt_circle, x[:, 1])  # from the axis of the screw

    def at(value: Array, target: float) -> bool:
        return bool(np.all(np.abs(value - target) < small))

    def below(value: Array, limit: float) -> bool:
        return bool(value.max() < limit + small)

    def above(value: Array, limit: float) -> bool:
        return bool(value.min() > limit - small)

    if at(x[:, 1], 0.0):
        return "theta0"
    if at(cos * x[:, 1] - sin * x[:, 0], 0.0):
        return "theta1"
    tests = {
        "cylinder": {
            "bottom": at(z, 0.0),
            "inner": at(r, shape.bore_radius),
            "top": at(z, ring),
            "weld": at(r, shape.wall) and above(z, flange),
        },
        "flange": {"weld": at(r, shape.wall), "thread": at(d, shape.screw_radius)},
        "ring": {"bottom": at(z, ring), "inner": at(r, shape.bore_radius), "top": at(z, cover)},
        "cover": {
            "inner": at(z, cover) and below(r, shape.bore_radius),
            "joint": at(z, cover) and above(r, shape.bore_radius) and below(r, shape.wall),
            "seat": at(z, seat) and below(d, shape.head_radius),
        },
        "shank": {"thread": at(d, shape.screw_radius) and below(z, ring), "top": at(z, seat)},
        "head": {
            "shank": at(z, seat) and below(d, shape.screw_radius),
            "seat": at(z, seat) and above(d, shape.hole_radius),
        },
    }
    return next((face for face, holds in tests[part].items() if holds), FREE)
