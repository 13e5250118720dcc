"""The parts of a STEP file, and what a user says of them: materials, sizes, laws, faces, kinds, names."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import check_known, checked_number, checked_reals
from dolfinx_frontend.common.errors import SceneError, unknown_name
from dolfinx_frontend.common.recorded import Journal, journaled
from dolfinx_frontend.geometry.cells import fineness, forecast, layer, ring_width
from dolfinx_frontend.geometry.findings import CLAMPING, FLAT, KINDS, Finding
from dolfinx_frontend.geometry.fits import misfits
from dolfinx_frontend.geometry.listing import finding_table, interface_table, part_table, surface_table
from dolfinx_frontend.geometry.parts import FREE
from dolfinx_frontend.geometry.places import PLACES
from dolfinx_frontend.geometry.reading import Source
from dolfinx_frontend.geometry.recognition import forced, recognised
from dolfinx_frontend.geometry.renaming import (
    in_words,
    new_names,
    renamed_finding,
    renamed_solid,
    renamed_touch,
)
from dolfinx_frontend.geometry.selecting import contact_faces, is_selected
from dolfinx_frontend.geometry.shapes import Body, bodies
from dolfinx_frontend.geometry.solids import Solid, Surface, matching
from dolfinx_frontend.geometry.threads import size_of
from dolfinx_frontend.geometry.touching import Touch
from dolfinx_frontend.scene.laws import Law
from dolfinx_frontend.scene.materials import Material
from dolfinx_frontend.scene.specs import Overlap, Space

__all__ = ["Join", "StepParts"]


@dataclass(frozen=True)
class Join:
    """What an interface of the scene is made of."""

    law: Law
    space: Space | None
    overlap: Overlap | None
    settings: dict[str, Any]


@dataclass(frozen=True)
class _Body:
    """What a substructure of the scene is made of."""

    material: Material | Callable[[Any, Any], Any]
    degree: int
    body_force: Any


@dataclass(eq=False, repr=False)
class StepParts:
    """The parts of a STEP file and where they touch, and what a user says of them.

    Attributes
    ----------
    path
        The file.
    solids
        Name -> part.
    touches
        Name -> proposed interface.
    gap
        Distance up to which faces count as nearly touching, length.
    """

    path: Path
    solids: dict[str, Solid]
    touches: dict[str, Touch]
    gap: float
    _source: Source
    _bodies: dict[str, _Body] = field(default_factory=dict)
    _sizes: dict[str, float] = field(default_factory=dict)
    _local: dict[str, float] = field(default_factory=dict)
    _joins: dict[str, Join | None] = field(default_factory=dict)
    _named: dict[tuple[str, str], tuple[int, ...]] = field(default_factory=dict)
    _faces: dict[str, tuple[str, str]] = field(default_factory=dict)
    _alone: tuple[str, ...] = ()
    _close: tuple[Touch, ...] = ()
    _overruled: dict[str, Finding] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.journal = Journal()
        self.why: dict[tuple[str, str], str] = {}
        self._name_faces()

    def _name_faces(self) -> None:
        """Names of the faces in interfaces, which are those of the other parts."""
        self._faces.clear()
        self._taken = contact_faces(self.touches.values())
        for (part, face), tags in self._taken.items():
            for name, touch in self.touches.items():
                for side in (0, 1):
                    if touch.parts[side] == part and set(touch.surfaces[side]) <= set(tags):
                        old = self._faces.get(name, ("", ""))
                        new = f"{part}:{face}"
                        self._faces[name] = (new, old[1]) if side == 0 else (old[0], new)

    def in_journal(self) -> None:
        """Nothing but its methods changes it."""

    # -- what the user adds ----------------------------------------------------------------------
    @journaled
    def material(
        self,
        pattern: str,
        material: Material | Callable[[Any, Any], Any],
        degree: int = 2,
        body_force: Any = None,
    ) -> None:
        """Material and degree of the parts of a name or glob pattern; as :meth:`Scene.substructure`."""
        for name in matching(pattern, self.solids, "part", "material"):
            self._bodies[name] = _Body(material, degree, body_force)

    @journaled
    def size(self, pattern: str, size: float) -> None:
        """Cell size (length) of parts, or of the cells at interfaces, by name or glob pattern.

        Where two parts share a face the smaller of their sizes holds on it. The default of a part is
        2 volume / area: the thickness of a plate, the radius of a bar.
        """
        size = checked_number(f"size of {pattern!r}", "size", size, above=0.0)
        if isinstance(pattern, str) and "|" in pattern:
            self._local |= dict.fromkeys(self._interfaces(pattern, "size"), float(size))
        else:
            names = matching(pattern, self.solids, "part", "size")
            self._sizes |= dict.fromkeys(names, float(size))

    @journaled
    def sizes(self, accuracy: float = 0.05) -> None:
        """Cell sizes for an accuracy: by the thickness of parts, the shanks of bolts, the rings under heads.

        Cells of gaskets and sheets are flat, and no larger than their neighbours are thick.

        What it costs is in the table of :func:`print`, before anything is meshed; sizes that are given
        afterwards override it.

        Parameters
        ----------
        accuracy
            Relative, of forces in the joints: a rule for a first mesh. An answer has its own estimate
            (`errors`), and ``solve(accuracy=...)`` refines where it matters.
        """
        fine = fineness(checked_number("sizes", "accuracy", accuracy, above=0.0))
        of = {part: name for name, body in self._recognised[0].items() for part in body.parts}
        found = self.found
        beside = {part: [self.solids[p].thickness for t in self.touches.values() if part in t.parts
                         for p in t.parts if p != part] for part in self.solids}
        for part, solid in self.solids.items():
            shank, size = found[of[part]].shank, solid.thickness
            if found[of[part]].kind in FLAT:
                size = min(layer(size), max([size, *beside[part]]))
            self._sizes[part] = fine * min(size, 0.5 * shank.d if shank else math.inf)
        for name, touch in self.touches.items():
            fastened = any(found[of[p]].kind in CLAMPING for p in touch.parts)
            if fastened and touch.shape.startswith("plane") and touch.kind == "touching":
                self._local[name] = fine * ring_width(self.solids[touch.parts[0]], touch.surfaces[0])

    @journaled
    def join(
        self,
        pattern: str,
        law: Law,
        *,
        space: Space | None = None,
        overlap: Overlap | None = None,
        **settings: Any,
    ) -> None:
        """Give the interfaces of a name or glob pattern a law; later calls override earlier ones.

        Parameters
        ----------
        pattern
            ``"gasket|upper flange"``, ``"*|nut*"``, ``"*"``; the two parts in either order.
        law
            Its law.
        space, overlap
            As for :meth:`Scene.interface`. None: ``"auto"``; ``"partial"`` if faces nearly touch.
        settings
            Other settings of :meth:`Scene.interface`.
        """
        if not isinstance(law, Law):
            raise SceneError(f"join {pattern!r}: {law!r} is not a law; give one, e.g. Perfect()")
        for name in self._interfaces(pattern, "join"):
            self._joins[name] = Join(law, space, overlap, dict(settings))

    @journaled
    def leave(self, pattern: str) -> None:
        """Leave the proposed interfaces of a name or glob pattern open: their faces stay free."""
        for name in self._interfaces(pattern, "leave"):
            self._joins[name] = None

    @journaled
    def face(
        self,
        name: str,
        *,
        normal: Sequence[float] | None = None,
        at: Sequence[float | None] | None = None,
        radius: float | None = None,
        tags: Sequence[int] | None = None,
        where: Callable[[Surface], bool] | None = None,
        near: Sequence[float] | None = None,
    ) -> tuple[str, ...]:
        """Name faces that are in no interface, to fix or to load them.

        Parameters
        ----------
        name
            ``"part:face"``; the part may be a glob pattern. All faces that fit the conditions get the name.
        normal
            Outward normal of a plane face, within one degree.
        at
            Coordinates (x, y, z) that every point of the face has, None for any.
        radius
            Of a cylinder.
        tags
            Numbers, as :meth:`faces` shows them.
        where
            Any other condition on a :class:`Surface`.
        near
            Of the faces that fit, the one whose centre is nearest to this point, of a hole its axis; with all
            that it is divided into.

        Returns
        -------
        tuple
            The faces, ``("part:face", ...)``, as :meth:`Scene.fix` takes them.

        Raises
        ------
        SceneError
            No part, or no face of a part, fits; a face has a name already.
        """
        pattern, colon, face = name.partition(":") if isinstance(name, str) else ("", "", "")
        if not colon or not face or ":" in face:
            raise SceneError(f"face {name!r}: write 'part:face'")
        found = []
        for part in matching(pattern, self.solids, "part", f"face {name!r}"):
            free = self._free(part)
            fits = [s for s in free if is_selected(s, self._small(), normal, at, radius, tags, where)]
            if not fits:
                raise SceneError(
                    f"face {name!r}: no free face of {part!r} fits; its free faces are:\n"
                    + surface_table(free)
                )
            if (part, face) in self._taken or face == FREE:
                raise SceneError(f"face {name!r}: the name is in use on {part!r}; choose another one")
            fits = fits if near is None else self._nearest(part, fits, self._place("face", near))
            old = self._named.get((part, face), ())
            self._named[part, face] = (*old, *(s.tag for s in fits))
            found.append(f"{part}:{face}")
        return tuple(found)

    def point(self, part: str, near: Sequence[float], on: str = "corner") -> tuple[float, float, float]:
        """The point of a part that is nearest to a given one: a support or a load goes there.

        Parameters
        ----------
        near
            Three coordinates, length.
        on
            "corner" (meshes have a node there), "edge", or "hole": on the axis of a hole, between its ends.

        Raises
        ------
        SceneError
            A part or kind of place that there is not; a part without holes.
        """
        known, x = self._recognised[0], self._place("point", near)
        whole = next((n for n, body in known.items() if part in (n, *body.parts)), "")
        if not whole:
            raise unknown_name("part", part, self.solids, "point")
        if on not in PLACES:
            raise unknown_name("kind of place", on, PLACES, f"point of {part!r}")
        found = PLACES[on](known[whole], x)
        if not len(found):
            raise SceneError(f"point of {part!r}: it has no {on}; give on='corner' or 'edge'")
        a, b, c = found[np.argmin(np.linalg.norm(found - x, axis=1))].tolist()
        return a, b, c

    @journaled
    def rename(self, part: str | Mapping[str, str], name: str | None = None) -> None:
        """Give a part another name, or several: ``rename({"part 3": "bolt", "part 4": "nut"})``.

        What was said of it before holds, its interfaces and faces follow, and its pieces ``"bolt-"`` and
        ``"bolt+"`` if it was cut. What it is taken for stays: that goes by the name in the file.

        Raises
        ------
        SceneError
            A part that there is not, with near ones; a name that is none, or in use.
        """
        bodies = self._recognised[0]
        whole, pieces = new_names(part, name, bodies)
        touches = {n: renamed_touch(t, pieces) for n, t in self.touches.items()}
        named = {(pieces[p], face): tags for (p, face), tags in self._named.items()}
        clash = sorted(contact_faces(touches.values()).keys() & named.keys())
        if clash:
            raise SceneError(
                f"rename: the face {':'.join(clash[0])!r} has its name from you, and would have it from the "
                "part beside it; choose another name"
            )
        of_file = {p: body.label + p[len(n) :] for n, body in bodies.items() for p in body.parts}
        labels = {p: body.label for body in bodies.values() for p in body.parts}
        joints = {old: touch.name for old, touch in touches.items()}
        self._source = replace(self._source, names={of_file[p]: new for p, new in pieces.items()})
        self.solids = {pieces[n]: renamed_solid(s, pieces, labels[n]) for n, s in self.solids.items()}
        self.touches = {touch.name: touch for touch in touches.values()}
        self._bodies = {pieces[n]: body for n, body in self._bodies.items()}
        self._sizes = {pieces[n]: size for n, size in self._sizes.items()}
        self._local = {joints[n]: size for n, size in self._local.items()}
        self._joins = {joints[n]: join for n, join in self._joins.items()}
        self._named = named
        self._alone = tuple(in_words(text, pieces) for text in self._alone)
        self._close = tuple(renamed_touch(touch, pieces) for touch in self._close)
        self._overruled = {whole[n]: renamed_finding(f, whole) for n, f in self._overruled.items()}
        self.why = {(kind, {**pieces, **joints}[n]): text for (kind, n), text in self.why.items()}
        del self._recognised
        self._name_faces()

    # -- what parts are taken for ----------------------------------------------------------------
    def is_bolt(self, part: str, size: str | None = None) -> None:
        """A part is a bolt or stud, whatever it was taken for; `size` is its thread, ``"M12"``."""
        self.is_a(part, "bolt", size)

    def is_gasket(self, part: str) -> None:
        """A part is a gasket, whatever it was taken for; its material is proposed as soft."""
        self.is_a(part, "gasket")

    def is_a(self, part: str, kind: str, size: str | None = None) -> None:
        """A part is of a kind ("bolt", "stud", "nut", "washer", "dowel", "gasket", "sheet").

        Raises
        ------
        SceneError
            A part, kind or size that there is not, with near ones; a bolt without a shank.
        """
        known = self._recognised[0]
        if part not in known:
            raise unknown_name("part", part, known, f"is_{kind}" if kind == "bolt" else "is_a")
        if kind not in KINDS:
            raise unknown_name("kind of part", kind, KINDS, f"is_a {part!r}")
        found = forced(known, part, kind, None if size is None else size_of(size, f"is_{kind} {part!r}"))
        found = replace(found, between=self._recognised[1][part].between)
        if found.shank is None and kind in ("bolt", "stud", "dowel"):
            raise SceneError(f"{part!r} cannot be a {kind}: it has no round shank; name another part")
        self._overruled[part] = found

    def is_not(self, part: str) -> None:
        """A part is no fastener, gasket or sheet, whatever it was taken for."""
        if part not in self._recognised[0]:
            raise unknown_name("part", part, self._recognised[0], "is_not")
        self._overruled[part] = Finding(part, reasons=("said so",))

    @property
    def found(self) -> dict[str, Finding]:
        """Part -> what it is taken for, and why; halves of a part that was cut are one."""
        return {**self._recognised[1], **self._overruled}

    @property
    def misfits(self) -> list[str]:
        """Sentences that say what does not fit, and what may be done about it."""
        told = {n: replace(f, missing="") for n, f in self.found.items() if f.kind and n in self._bodies}
        return misfits({**self.found, **told}, self.touches.values(), self._close)

    @cached_property
    def _recognised(self) -> tuple[dict[str, Body], dict[str, Finding]]:
        whole = bodies(self.solids, self.touches.values())
        return whole, recognised(whole, self.touches.values())

    # -- what the user sees ----------------------------------------------------------------------
    @property
    def interfaces(self) -> tuple[str, ...]:
        """Names of the proposed interfaces."""
        return tuple(self.touches)

    def sides(self, interface: str) -> tuple[str, str]:
        """The two faces of a proposed interface, ``"part:face"``."""
        check_known("interface", interface, self.touches, str(self.path.name))
        return self._faces[interface]

    def faces(self, pattern: str = "*") -> str:
        """Free faces of parts as a table: number, name, shape, area, centre."""
        blocks = []
        for part in matching(pattern, self.solids, "part", "faces"):
            names = {t: face for (p, face), tags in self._named.items() if p == part for t in tags}
            surfaces = [s for s in self.solids[part].surfaces if not self._in_contact(s)]
            blocks.append(f"{part}\n{surface_table(surfaces, names)}")
        return "\n".join(blocks)

    def __str__(self) -> str:
        volume = sum(s.volume for s in self.solids.values())
        local = self._on_faces()
        cells = {}
        for name, solid in self.solids.items():
            degree = self._bodies[name].degree if name in self._bodies else 2
            cells[name] = (self._size(name), *forecast(solid, self._size(name), local[name], degree))
        materials = {name: type(body.material).__name__ for name, body in self._bodies.items()}
        laws = {name: join.law.title if join else "left open" for name, join in self._joins.items()}
        lines = [
            f"{self.path.name}: {len(self.solids)} parts, {volume:.5g} mm^3, "
            f"{len(self.touches)} interfaces proposed (gap up to {self.gap:.3g} mm)", "",
            *part_table(self.solids, cells, materials), *interface_table(self.touches, laws),
            *(f"nothing touches: {text}" for text in self._alone), *finding_table(self.found),
            *(f"does not fit: {text}" for text in self.misfits),
        ]
        return "\n".join(lines)

    def __repr__(self) -> str:
        counts = f"{len(self.solids)} parts, {len(self.touches)} interfaces"
        return f"{type(self).__name__}({self.path.name}: {counts})"

    # -- inside ----------------------------------------------------------------------------------
    def _interfaces(self, pattern: str, where: str) -> list[str]:
        """Interfaces of a pattern; the two parts may come in either order."""
        both = {name: name for name in self.touches}
        for name, touch in self.touches.items():
            rest = name[len("|".join(touch.parts)) :]
            both.setdefault("|".join(reversed(touch.parts)) + rest, name)
        try:
            found = matching(pattern, both, "interface", where)
        except SceneError:
            raise unknown_name("interface", pattern, self.touches, where) from None
        return list(dict.fromkeys(both[name] for name in found))

    @staticmethod
    def _place(where: str, near: Sequence[float]) -> Array:
        x = checked_reals(where, "near", near, "give three coordinates")
        if x.shape != (3,):
            raise SceneError(f"{where}: near = {near!r}; give three coordinates")
        return x

    def _nearest(self, part: str, among: Sequence[Surface], x: Array) -> list[Surface]:
        """The face that is nearest to a point, with all of its pieces."""
        def off(s: Surface) -> float:
            if s.kind != "cylinder":
                return float(np.linalg.norm(x - s.centre))
            t = (s.rim - s.origin) @ s.axis
            along = np.clip((x - s.origin) @ s.axis, t.min(), t.max())
            return float(np.linalg.norm(x - s.origin - along * s.axis))

        first = min(among, key=off)
        pieces = {t for body in self._recognised[0].values() for f in body.faces if first.tag in f.tags
                  for t in f.tags}
        return [s for s in among if s.tag in pieces or s is first]

    def _small(self) -> float:
        """A length that is rounding."""
        low = np.min([s.low for s in self.solids.values()], axis=0)
        high = np.max([s.high for s in self.solids.values()], axis=0)
        return 1e-6 * float(np.linalg.norm(high - low))

    def _size(self, part: str) -> float:
        return self._sizes.get(part, self.solids[part].thickness)

    def _on_faces(self) -> dict[str, dict[int, float]]:
        """Part -> number of a face -> largest cells there, by its interfaces and the parts beside it."""
        out: dict[str, dict[int, float]] = {name: {} for name in self.solids}
        for name, touch in self.touches.items():
            for k in (0, 1):
                beside = math.inf if touch.kind == "near" else self._size(touch.parts[1 - k])
                for tag in touch.surfaces[k]:
                    own = out[touch.parts[k]]
                    own[tag] = min(own.get(tag, math.inf), beside, self._local.get(name, math.inf))
        return out

    def _in_contact(self, surface: Surface) -> bool:
        return any(p == surface.part and surface.tag in tags for (p, _), tags in self._taken.items())

    def _free(self, part: str) -> list[Surface]:
        """Faces of a part that are in no interface and have no name."""
        named = {t for (p, _), tags in self._named.items() if p == part for t in tags}
        return [
            s for s in self.solids[part].surfaces if s.tag not in named and not self._in_contact(s)
        ]
