"""Which faces of solids touch, or nearly do."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Any, Literal

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.clipping import clip
from dolfinx_frontend.common.deferred import spatial
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.groups import grouped
from dolfinx_frontend.common.vectors import unit
from dolfinx_frontend.geometry.solids import (
    Loaded,
    Solid,
    Surface,
    near_pairs,
    nearest,
    outward,
    vector,
)

__all__ = ["Kind", "Touch", "close_faces", "touching"]

Kind = Literal["touching", "near", "cut", "thread"]

_OPPOSED = -0.5
"""Two faces face each other where the product of their outward normals is below this."""

_WEDGE = -0.98
"""Faces whose angle is the same everywhere, planes, cylinders and cones of one axis, meet in an edge only
where the product of their normals is above this: within the gap they are a strip five gaps wide."""

_PARALLEL = 1e-6
"""Sine of the angle of two axes that are parallel."""

_WITHIN_RIMS = ("plane", "cylinder", "cone")
"""Kinds of faces that lie within the hull of their edges."""

_SLIVER = 1e-6
"""Fraction of a face below which a pair of faces makes no interface."""


@dataclass(frozen=True)
class Touch:
    """Faces of two parts that touch or nearly do.

    Attributes
    ----------
    name
        ``"first|second"``; ``"first|second#2"`` for a second group of faces of the same two parts.
    parts
        The two parts; the normal points out of the first.
    kind
        ``"touching"``, ``"near"``, ``"cut"`` for the two halves of a solid, ``"thread"`` for a screw that is
        drawn into the wall of its hole.
    surfaces
        Numbers of the faces of each.
    area
        Area on which they face each other.
    gap, widest
        Mean and largest distance there, length; a thread is drawn into its hole by -gap.
    normal
        Mean unit normal; zero if the face closes on itself.
    shape
        Kind of face, in words.
    """

    name: str
    parts: tuple[str, str]
    kind: Kind
    surfaces: tuple[tuple[int, ...], tuple[int, ...]]
    area: float
    gap: float
    widest: float
    normal: Array = field(repr=False)
    shape: str = ""


def touching(gmsh: Any, loaded: Loaded, solids: Mapping[str, Solid], gap: float) -> list[Touch]:
    """Groups of faces of two parts that touch, or come nearer than `gap`.

    Raises
    ------
    SceneError
        Several parts, and none touches another one.
    """
    model = gmsh.model
    names = list(solids)
    pairs: dict[tuple[str, str], list[Touch]] = {}
    where: dict[int, list[Surface]] = {}
    for solid in solids.values():
        for surface in solid.surfaces:
            where.setdefault(surface.tag, []).append(surface)
    shared: dict[tuple[str, str], list[Surface]] = {}
    for both in where.values():
        if len(both) == 2:
            shared.setdefault((both[0].part, both[1].part), []).append(both[0])
    for (a, b), surfaces in shared.items():
        depth = max(loaded.threads.get(pair, 0.0) for pair in ((a, b), (b, a)))
        if depth:  # where the widened hole ends there is a step, on which nothing rests
            rods = [s for s in surfaces if s.kind == "cylinder"]
            surfaces = [s for s in surfaces if s in rods or not any(_inside(s, rod) for rod in rods)]
        for group in _groups(model, surfaces):
            _refuse_strip(a, b, group)
            kind: Kind = "cut" if (a, b) in loaded.halves else "touching"
            if depth and group[0].kind == "cylinder":
                kind = "thread"
            pairs.setdefault((a, b), []).append(_shared_touch(a, b, kind, group, depth))
    for touch in _near(gmsh, loaded, solids, where, gap):
        key = touch.parts if touch.parts in pairs else touch.parts[::-1]
        pairs.setdefault(key, []).append(touch)
    if not pairs and len(solids) > 1:
        raise SceneError(
            f"no faces touch or come nearer than gap = {gap:.3g}; the nearest parts: "
            f"{'; '.join(nearest(model, loaded, solids, names, gap))}; increase gap, or fix the geometry"
        )
    out = []
    for touches in pairs.values():
        ordered = sorted(touches, key=lambda t: (t.kind == "near", -t.area))
        for number, touch in enumerate(ordered, start=1):
            name = f"{touch.name}#{number}" if number > 1 else touch.name
            out.append(Touch(**{**vars(touch), "name": name}))
    place = {name: i for i, name in enumerate(names)}
    return sorted(out, key=lambda t: (place[t.parts[0]], place[t.parts[1]], t.name))


def _inside(surface: Surface, rod: Surface) -> bool:
    """Whether a face ends within a cylinder."""
    offset = surface.rim - rod.origin
    across = np.linalg.norm(offset - np.outer(offset @ rod.axis, rod.axis), axis=1)
    return bool(across.max() < (rod.radius or 0.0) * (1.0 + _PARALLEL))


def _continue(model: Any, a: Surface, b: Surface, edges: Mapping[int, set[int]]) -> bool:
    """Whether two faces of a part continue each other on the same surface."""
    if a.kind != b.kind:
        return False
    if a.kind == "plane":
        size = math.sqrt(a.area + b.area)
        offset = float(np.dot(a.centre - b.centre, a.normal))
        return float(np.dot(a.normal, b.normal)) > 1.0 - 1e-9 and abs(offset) < 1e-6 * size
    if a.kind == "cylinder" and abs((a.radius or 0.0) - (b.radius or 0.0)) > 1e-6 * (a.radius or 1.0):
        return False
    return bool(edges[a.tag] & edges[b.tag])


def _groups(model: Any, surfaces: Sequence[Surface]) -> list[list[Surface]]:
    """Faces of one part, grouped by the surface on which they lie."""
    edges = {
        s.tag: {abs(t) for _, t in model.getBoundary([(2, s.tag)], oriented=False)} for s in surfaces
    }
    pairs = [(a.tag, b.tag) for a, b in combinations(surfaces, 2) if _continue(model, a, b, edges)]
    by_tag = {s.tag: s for s in surfaces}
    return [[by_tag[tag] for tag in group] for group in grouped(list(by_tag), pairs)]


def _refuse_strip(a: str, b: str, group: Sequence[Surface]) -> None:
    """Refuse what two parts share if it is no wider than rounding: parts that should touch, or should not."""
    low = np.min([s.low for s in group], axis=0)
    high = np.max([s.high for s in group], axis=0)
    length = float(np.linalg.norm(high - low))
    width = sum(s.area for s in group) / length
    if width < _SLIVER * length:
        raise SceneError(
            f"{a!r} and {b!r} touch in a strip that is {width:.3g} wide and {length:.4g} long, at "
            f"{vector(0.5 * (low + high))}; fix the geometry, or give a tolerance or imprint=False"
        )


def _shared_touch(a: str, b: str, kind: Kind, group: Sequence[Surface], depth: float) -> Touch:
    area = sum(s.area for s in group)
    mean = np.asarray(sum(s.area * s.normal for s in group)) / area
    length = float(np.linalg.norm(mean))
    normal = unit(mean) if length > 0.1 else np.zeros(3)
    tags = tuple(s.tag for s in group)
    gap = -depth if kind == "thread" else 0.0
    return Touch(f"{a}|{b}", (a, b), kind, (tags, tags), area, gap, 0.0, normal, group[0].shape)


@dataclass(frozen=True)
class _Facing:
    """What two faces have in common."""

    area: float
    gap: float
    widest: float
    normal: Array


def close_faces(
    gmsh: Any, loaded: Loaded, solids: Mapping[str, Solid], touches: Sequence[Touch], gap: float
) -> list[Touch]:
    """Plane faces within a gap that are in no touch, where one covers half of the other."""
    taken = {tag for touch in touches for side in touch.surfaces for tag in side}
    tags = [f.tag for s in solids.values() for f in s.surfaces]
    taken |= {tag for tag, count in Counter(tags).items() if count > 1}  # shared: they touch, open or not
    plane = {
        name: replace(s, surfaces=tuple(f for f in s.surfaces if f.kind == "plane" and f.tag not in taken))
        for name, s in solids.items()
    }
    where = {f.tag: [f] for s in plane.values() for f in s.surfaces}
    found = _near(gmsh, loaded, plane, where, gap)
    area = {tag: f.area for tag, (f,) in where.items()}
    return [t for t in found if t.area > 0.5 * min(sum(area[n] for n in side) for side in t.surfaces)]


def _near(
    gmsh: Any,
    loaded: Loaded,
    solids: Mapping[str, Solid],
    where: Mapping[int, Sequence[Surface]],
    gap: float,
) -> list[Touch]:
    """Pairs of parts with faces that are not the same, but nearer than `gap`."""
    model = gmsh.model
    listed = list(solids.values())
    candidates: dict[tuple[str, str], list[tuple[Surface, Surface]]] = {}
    for i, j in near_pairs([(s.low, s.high) for s in listed], gap):
        a, b = listed[i], listed[j]
        # faces on which a third part was already found are not used again
        own = [s for s in a.surfaces if len(where[s.tag]) == 1]
        other = [s for s in b.surfaces if len(where[s.tag]) == 1]
        boxes = [(s.low, s.high) for s in own + other]
        for k, m in near_pairs(boxes, gap) if own and other else ():
            if k < len(own) <= m:
                first, second = own[k], other[m - len(own)]
                if _may_face(first, second, gap):
                    candidates.setdefault((a.name, b.name), []).append((first, second))
    if not candidates:
        return []
    tags = sorted({s.tag for pairs in candidates.values() for pair in pairs for s in pair})
    triangles = _triangulate(gmsh, solids, tags)
    found = []
    for names, pairs in candidates.items():
        facing = {}
        for first, second in pairs:
            each = _facing(model, loaded, first, second, triangles, gap)
            if each is not None:
                facing[first.tag, second.tag] = each
        found += _near_touches(
            model,
            solids,
            names,
            facing,
            lambda first, second: _facing(model, loaded, first, second, triangles, gap),
        )
    return found


def _ball(surface: Surface) -> tuple[Array, float]:
    """Centre and radius of a ball around a face."""
    points, room = np.array([surface.low, surface.high]), 1.0
    if surface.kind in ("plane", "cylinder") and len(surface.rim):
        points, room = surface.rim, 1.1  # between the points of a rim it may reach further
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return centre, room * float(np.linalg.norm(points - centre, axis=1).max())


def _reaches(first: Surface, second: Surface, ball: float, gap: float) -> bool:
    """Whether a face comes to the wall of a cylinder: not beyond its ends, nor well inside."""
    if first.kind != "cylinder" or second.kind not in _WITHIN_RIMS:
        return True
    along, other = (first.rim - first.origin) @ first.axis, (second.rim - first.origin) @ first.axis
    slack = gap + 0.1 * ball * (second.kind != "plane")  # between the points of a rim it may reach further
    if other.min() - along.max() > slack or along.min() - other.max() > slack:
        return False
    across = second.rim - first.origin - np.outer(other, first.axis)
    return bool(np.linalg.norm(across, axis=1).max() >= (first.radius or 0.0) - gap - 0.1 * ball)


def _may_face(first: Surface, second: Surface, gap: float) -> bool:
    """False if two faces cannot be closer than the gap: a cheap test for planes and cylinders."""
    kinds = (first.kind, second.kind)
    (here, r1), (there, r2) = _ball(first), _ball(second)
    if float(np.linalg.norm(there - here)) > r1 + r2 + gap:
        return False
    if not _reaches(first, second, r2, gap) or not _reaches(second, first, r1, gap):
        return False
    if (product := _product(first, second)) is not None and product > _WEDGE:
        return False
    small = 1e-9 * (1.0 + float(np.abs(first.centre).max()))
    if kinds == ("plane", "plane"):
        return _within(first, second, gap) and _within(second, first, gap)
    if kinds == ("cylinder", "cylinder"):
        assert first.radius is not None and second.radius is not None
        if np.linalg.norm(np.cross(first.axis, second.axis)) > _PARALLEL:
            return True
        offset = second.origin - first.origin
        apart = float(np.linalg.norm(offset - (offset @ first.axis) * first.axis))
        if first.hollow != second.hollow:
            # a shaft in a hole that is wider, wherever in it
            room = (first.radius - second.radius) * (1.0 if first.hollow else -1.0)
            return abs(room) - apart <= gap + small
        return abs(apart - first.radius - second.radius) <= gap + small
    if set(kinds) == {"plane", "cylinder"}:
        plane, round_ = (first, second) if first.kind == "plane" else (second, first)
        along = float(plane.normal @ round_.axis)
        # normals of a cylinder are across its axis
        return math.sqrt(max(0.0, 1.0 - along**2)) > -_OPPOSED and _within(plane, round_, gap)
    return True


def _product(first: Surface, second: Surface) -> float | None:
    """Of the outward normals of planes, cylinders and cones of one axis, where they face; None: of others."""
    if first.kind == second.kind == "plane":
        return float(first.normal @ second.normal)
    axis = first.axis if second.kind == "plane" else second.axis
    leans = [_lean(s, axis) for s in (first, second)]
    if None in leans or not axis.any():
        return None
    (a, r), (b, s) = (lean for lean in leans if lean is not None)
    offset = second.origin - first.origin
    apart = float(np.linalg.norm(offset - (offset @ axis) * axis)) if r and s else 0.0
    coaxial = apart <= _PARALLEL * (1.0 + float(np.abs(offset).max()))
    return a * b + (r * s if coaxial else -abs(r * s))


def _lean(surface: Surface, axis: Array) -> tuple[float, float] | None:
    """The parts of a normal along an axis and away from it, where they are the same everywhere."""
    if surface.kind not in _WITHIN_RIMS:
        return None
    own = surface.normal if surface.kind == "plane" else surface.axis
    along = float(own @ axis)
    if abs(along) < 1.0 - _PARALLEL:
        return None
    if surface.kind == "plane":
        return along, 0.0
    out = -1.0 if surface.hollow else 1.0
    if surface.kind == "cylinder":
        return 0.0, out
    far, wide = _ray(surface)
    return -out * math.copysign(wide, far) * along, out * abs(far)


def _ray(cone: Surface) -> Array:
    """How far along its axis and away from it a cone goes: its origin is its apex, its rim says the angle."""
    t = (cone.rim - cone.origin) @ cone.axis
    across = np.linalg.norm(cone.rim - cone.origin - np.outer(t, cone.axis), axis=1)
    return unit(np.array([t.sum(), across.sum()]))


def _within(first: Surface, second: Surface, gap: float) -> bool:
    """Whether a plane or cylinder comes within the gap of the plane of another face."""
    slack = gap + 1e-9 * (1.0 + float(np.abs(first.centre).max()))
    points, reach = second.rim, 0.0
    if second.kind == "cylinder":
        t = (points - second.origin) @ second.axis
        points = second.origin + np.outer([t.min(), t.max()], second.axis)
        along = float(first.normal @ second.axis)
        reach = (second.radius or 0.0) * math.sqrt(max(0.0, 1.0 - along**2))
    elif second.kind != "plane":
        points = np.array(np.meshgrid(*zip(second.low, second.high, strict=True))).reshape(3, -1).T
    distance = (points - first.centre) @ first.normal
    return bool(distance.min() - reach <= slack and distance.max() + reach >= -slack)


def _triangulate(gmsh: Any, solids: Mapping[str, Solid], tags: Sequence[int]) -> dict[int, Array]:
    """Face -> triangles (k, 3, 3), fine enough for areas."""
    model = gmsh.model
    low = np.min([s.low for s in solids.values()], axis=0)
    high = np.max([s.high for s in solids.values()], axis=0)
    options = {
        "Mesh.MeshOnlyVisible": 1.0,
        "Mesh.Algorithm": 5.0,  # Delaunay, the fastest
        "Mesh.MeshSizeFromCurvature": 32.0,
        "Mesh.MeshSizeMax": float(np.linalg.norm(high - low)) / 30.0,
    }
    before = {key: gmsh.option.getNumber(key) for key in options}
    try:
        for key, value in options.items():
            gmsh.option.setNumber(key, value)
        model.setVisibility(model.getEntities(), 0)
        model.setVisibility([(2, tag) for tag in tags], 1, recursive=True)
        model.mesh.generate(2)
        # all nodes: a point in which another part touches is no boundary of the face
        nodes, x, _ = model.mesh.getNodes()
        row = np.zeros(int(nodes.max(initial=0)) + 1, dtype=np.int64)
        row[nodes.astype(np.int64)] = np.arange(nodes.size)
        out = {}
        for tag in tags:
            _, corners = model.mesh.getElementsByType(2, tag)
            out[tag] = x.reshape(-1, 3)[row[corners.astype(np.int64)]].reshape(-1, 3, 3)
    finally:
        model.mesh.clear()
        model.setVisibility(model.getEntities(), 1)
        for key, value in before.items():
            gmsh.option.setNumber(key, value)
    return out


def _facing(
    model: Any,
    loaded: Loaded,
    first: Surface,
    second: Surface,
    triangles: Mapping[int, Array],
    gap: float,
) -> _Facing | None:
    """Common area and distance of two faces; None if they have none."""
    one, two = triangles[first.tag], triangles[second.tag]
    if not len(one) or not len(two):
        return None
    c1, c2 = one.mean(axis=1), two.mean(axis=1)
    r1, r2 = (
        np.linalg.norm(t - c[:, None], axis=2).max(axis=1) for t, c in ((one, c1), (two, c2))
    )
    near = spatial.cKDTree(c2).query_ball_point(c1, r1 + r2.max() + gap)
    i = np.repeat(np.arange(len(one)), [len(n) for n in near])
    if not i.size:
        return None
    j = np.concatenate([np.asarray(n, dtype=np.int64) for n in near if len(n)])
    cross = np.cross(one[i, 1] - one[i, 0], one[i, 2] - one[i, 0])
    plane = cross / np.linalg.norm(cross, axis=1)[:, None]
    e1 = one[i, 1] - one[i, 0]
    e1 /= np.linalg.norm(e1, axis=1)[:, None]
    e2 = np.cross(plane, e1)
    axes = np.stack([e1, e2], axis=1)
    origin = one[i, 0][:, None]
    window, subject = (np.einsum("kab,kvb->kva", axes, t - origin) for t in (one[i], two[j]))
    common = clip(subject, window)
    ahead = np.roll(common, -1, axis=1)
    parts = common[..., 0] * ahead[..., 1] - common[..., 1] * ahead[..., 0]
    area = 0.5 * parts.sum(axis=1)
    keep = np.abs(area) > 1e-12 * first.area
    if not keep.any():
        return None
    flat = ((common + ahead) * parts[..., None]).sum(axis=1)[keep] / (6.0 * area[keep])[:, None]
    x = one[i[keep], 0] + np.einsum("kab,ka->kb", axes[keep], flat)
    size = np.abs(area[keep]) * first.area / np.linalg.norm(
        np.cross(one[:, 1] - one[:, 0], one[:, 2] - one[:, 0]), axis=1
    ).sum() * 2.0
    x1, n1 = _on(model, loaded, first, x)
    x2, n2 = _on(model, loaded, second, x1)
    offset = x2 - x1
    distance = np.einsum("ki,ki->k", offset, n1)
    good = (np.einsum("ki,ki->k", n1, n2) < _OPPOSED) & (np.linalg.norm(offset, axis=1) <= gap)
    good &= np.linalg.norm(x2 - c2[j[keep]], axis=1) <= 1.5 * r2[j[keep]] + gap  # not across a cylinder
    if size[good].sum() <= _SLIVER * min(first.area, second.area):
        return None
    weights = size[good]
    mean = (weights[:, None] * n1[good]).sum(axis=0) / weights.sum()
    return _Facing(
        float(weights.sum()),
        float(weights @ distance[good] / weights.sum()),
        float(np.abs(distance[good]).max()),
        mean,
    )


def _on(model: Any, loaded: Loaded, surface: Surface, x: Array) -> tuple[Array, Array]:
    """Closest points (k, 3) of the surface of a face and the normals out of its part there."""
    if surface.kind == "plane":
        return x - np.outer((x - surface.centre) @ surface.normal, surface.normal), surface.normal + 0.0 * x
    if surface.kind in ("cylinder", "cone"):
        along = (x - surface.origin) @ surface.axis
        foot = surface.origin + np.outer(along, surface.axis)
        out = (x - foot) / np.maximum(np.linalg.norm(x - foot, axis=1), np.finfo(np.float64).tiny)[:, None]
        closest = foot + (surface.radius or 0.0) * out
        if surface.kind == "cone":
            ray = _ray(surface)
            edge = ray[0] * surface.axis + ray[1] * out
            closest = surface.origin + np.einsum("ki,ki->k", x - surface.origin, edge)[:, None] * edge
            out = abs(ray[0]) * out - np.sign(ray[0]) * ray[1] * surface.axis
        return closest, -out if surface.hollow else out
    closest, _ = model.getClosestPoint(2, surface.tag, x.ravel().tolist())
    # the parameters that come with the points are zero in gmsh 4.13
    at = model.getParametrization(2, surface.tag, closest)
    normals = np.asarray(model.getNormal(surface.tag, at)).reshape(-1, 3)
    volumes = loaded.volumes[surface.part]
    sign = outward(model, volumes, surface.tag)
    return np.asarray(closest).reshape(-1, 3), sign * normals


def _near_touches(
    model: Any,
    solids: Mapping[str, Solid],
    names: tuple[str, str],
    facing: Mapping[tuple[int, int], _Facing],
    measure: Callable[[Surface, Surface], _Facing | None],
) -> list[Touch]:
    """Face pairs of two parts, grouped; `measure` returns what two faces have in common."""
    if not facing:
        return []
    by_tag = [{s.tag: s for s in solids[name].surfaces} for name in names]
    sides = [[by_tag[k][t] for t in dict.fromkeys(pair[k] for pair in facing)] for k in (0, 1)]
    links = [((0, one), (1, two)) for one, two in facing]
    for k in (0, 1):
        for group in _groups(model, sides[k]):
            links += [((k, group[0].tag), (k, s.tag)) for s in group[1:]]
    out = []
    for faces in grouped([(k, s.tag) for k in (0, 1) for s in sides[k]], links):
        pairs = [pair for pair in facing if (0, pair[0]) in faces]
        tags = [tuple(dict.fromkeys(p[k] for p in pairs)) for k in (0, 1)]
        # the first side is the one of which the other covers the larger fraction
        own = [sum(by_tag[k][t].area for t in tags[k]) for k in (0, 1)]
        order = (0, 1) if own[0] <= own[1] * (1.0 + 1e-9) else (1, 0)
        each = [facing[p] for p in pairs]
        if order == (1, 0):
            turned = [measure(by_tag[1][two], by_tag[0][one]) for one, two in pairs]
            if any(turned):
                each = [f for f in turned if f is not None]
            else:  # as little as the triangles of one side see, and those of the other do not
                order = (0, 1)
        area = sum(f.area for f in each)
        mean = np.asarray(sum(f.area * f.normal for f in each)) / area
        normal = unit(mean) if np.linalg.norm(mean) > 0.1 else np.zeros(3)
        parts = (names[order[0]], names[order[1]])
        out.append(
            Touch(
                f"{parts[0]}|{parts[1]}",
                parts,
                "near",
                (tags[order[0]], tags[order[1]]),
                area,
                sum(f.area * f.gap for f in each) / area,
                max(f.widest for f in each),
                normal,
                by_tag[order[0]][tags[order[0]][0]].shape,
            )
        )
    return out
