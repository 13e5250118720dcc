"""Faces of the parts of a STEP file: those in interfaces, and those that a user selects."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from dolfinx_frontend.common.checks import checked_number, checked_reals, is_real, is_whole
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.geometry.parts import FREE
from dolfinx_frontend.geometry.solids import Surface

__all__ = ["contact_faces", "is_selected"]

_ANGLE = math.cos(math.radians(1.0))


def contact_faces(touches: Any) -> dict[tuple[str, str], tuple[int, ...]]:
    """(part, face) -> surfaces: one face for what a part shares with another one.

    Interfaces that use the same surface of a part have one face there: a facet has one name.
    """
    uses: dict[str, list[tuple[set[int], list[str]]]] = {}
    for touch in touches:
        suffix = touch.name[len("|".join(touch.parts)) :]
        for side in (0, 1):
            tags, label = set(touch.surfaces[side]), touch.parts[1 - side] + suffix
            groups = uses.setdefault(touch.parts[side], [])
            meets = [g for g in groups if g[0] & tags]
            for g in meets:
                groups.remove(g)
            merged = set().union(tags, *(g[0] for g in meets))
            groups.append((merged, [*(n for g in meets for n in g[1]), label]))
    out = {}
    for part, groups in uses.items():
        several = 0
        for tags, labels in groups:
            name = labels[0]
            if len(labels) > 1:
                several += 1
                name = "contact" if several == 1 else f"contact#{several}"
            unique, number = name, 1
            while (part, unique) in out or unique == FREE:
                number += 1
                unique = f"{name}#{number}"
            out[part, unique] = tuple(sorted(tags))
    return out


def is_selected(
    surface: Surface,
    small: float,
    normal: Sequence[float] | None,
    at: Sequence[float | None] | None,
    radius: float | None,
    tags: Sequence[int] | None,
    where: Callable[[Surface], bool] | None,
) -> bool:
    if normal is not None:
        wanted = checked_reals("face", "normal", normal, "give three numbers")
        length = float(np.linalg.norm(wanted)) if wanted.shape == (3,) else 0.0
        if not length > 0.0:
            raise SceneError(f"normal = {normal!r}; give three numbers")
        if float(surface.normal @ wanted) < _ANGLE * length:
            return False
    if at is not None:
        several = isinstance(at, (list, tuple, np.ndarray)) and len(at) == 3
        if not several or not all(value is None or is_real(value) for value in at):
            raise SceneError(f"at = {at!r}; give three coordinates, None for any")
        for axis, value in enumerate(at):
            if value is None:
                continue
            # a box of OpenCASCADE is a little larger than the face
            if max(abs(surface.low[axis] - value), abs(surface.high[axis] - value)) > small:
                return False
    if radius is not None:
        radius = checked_number("face", "radius", radius, above=0.0)
        own = surface.radius
        if own is None or abs(own - radius) > 1e-6 * max(abs(radius), own):
            return False
    if tags is not None and not (isinstance(tags, Iterable) and all(map(is_whole, tags))):
        raise SceneError(f"face: tags = {short(tags)}; give the numbers of faces, as faces() shows them")
    if tags is not None and surface.tag not in tags:
        return False
    return where is None or bool(where(surface))
