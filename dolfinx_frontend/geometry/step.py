"""From a STEP file to a scene: parts, proposed interfaces, then laws, materials and mesh sizes by pattern.

>>> step = read_step("flange.step")
>>> print(step)                                   # the parts, and where they touch
>>> step.material("*", LinearElastic(E=200e3, nu=0.3))
>>> step.size("gasket", 5.0)
>>> step.join("*", Perfect())                     # later calls override earlier ones
>>> step.join("gasket|upper flange", Contact(gap=0.0))
>>> step.face("lower flange:end", normal=(0, 0, -1), at=(None, None, -60.0))
>>> scene = step.scene()                          # meshes; from here on an ordinary scene
>>> scene.fix("lower flange:end")

Lengths are millimetres: OpenCASCADE converts from the unit of the file.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, cast

import numpy as np

from dolfinx_frontend.common.checks import (
    check_kind,
    check_known,
    checked_flag,
    checked_number,
    checked_path,
    checked_reals,
    is_real,
    is_whole,
)
from dolfinx_frontend.common.describe import columns, short
from dolfinx_frontend.common.errors import SceneError, SceneWarning, unknown_name, warn
from dolfinx_frontend.common.frozen import ReadOnlyDict
from dolfinx_frontend.common.progress import Bar
from dolfinx_frontend.common.recorded import Call, Journal, journaled, made_by, recorded
from dolfinx_frontend.geometry.away import TIMEOUT, alone, away, check_timeout
from dolfinx_frontend.geometry.exchange import check_begin
from dolfinx_frontend.geometry.fits import misfits
from dolfinx_frontend.geometry.gmsh import assembled
from dolfinx_frontend.geometry.meshing import FLAT, some
from dolfinx_frontend.geometry.parts import FREE, Assembly, Connection, Part
from dolfinx_frontend.geometry.reading import Recipe, Source, Survey
from dolfinx_frontend.geometry.recognition import KINDS, Finding, forced, recognised
from dolfinx_frontend.geometry.renaming import (
    in_words,
    new_names,
    renamed_finding,
    renamed_solid,
    renamed_touch,
)
from dolfinx_frontend.geometry.shapes import Body, bodies
from dolfinx_frontend.geometry.sizes import SizeField
from dolfinx_frontend.geometry.solids import Cut, Solid, Surface, matching, vector
from dolfinx_frontend.geometry.threads import size_of
from dolfinx_frontend.geometry.touching import Touch
from dolfinx_frontend.scene.laws import Law
from dolfinx_frontend.scene.materials import Material
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.scene.specs import Overlap, Space

__all__ = ["StepAssembly", "read_step"]


_ANGLE = math.cos(math.radians(1.0))


_CROSSING = "PLC Error"
"""What gmsh says of edges and faces that cross each other."""
_FINER_TURNS = 8


@dataclass(frozen=True)
class _Join:
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
class StepAssembly:
    """The parts of a STEP file and where they touch, to be completed and meshed; see :func:`read_step`.

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
    _joins: dict[str, _Join | None] = field(default_factory=dict)
    _named: dict[tuple[str, str], tuple[int, ...]] = field(default_factory=dict)
    _faces: dict[str, tuple[str, str]] = field(default_factory=dict)
    _alone: tuple[str, ...] = ()
    _close: tuple[Touch, ...] = ()
    _overruled: dict[str, Finding] = field(default_factory=dict)

    proposal: ClassVar[Callable[..., StepAssembly]]  # of the module of that name, which stands above
    propose: ClassVar[Callable[..., Scene]]

    def __post_init__(self) -> None:
        self.journal = Journal()
        self.why: dict[tuple[str, str], str] = {}
        self._name_faces()

    def _name_faces(self) -> None:
        """Names of the faces in interfaces, which are those of the other parts."""
        self._faces.clear()
        self._taken = _contact_faces(self.touches.values())
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
            self._joins[name] = _Join(law, space, overlap, dict(settings))

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
            fits = [s for s in free if _fits(s, self._small(), normal, at, radius, tags, where)]
            if not fits:
                raise SceneError(
                    f"face {name!r}: no free face of {part!r} fits; its free faces are:\n"
                    + _surface_table(free)
                )
            if (part, face) in self._taken or face == FREE:
                raise SceneError(f"face {name!r}: the name is in use on {part!r}; choose another one")
            old = self._named.get((part, face), ())
            self._named[part, face] = (*old, *(s.tag for s in fits))
            found.append(f"{part}:{face}")
        return tuple(found)

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
        clash = sorted(_contact_faces(touches.values()).keys() & named.keys())
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
        found = forced(known[part], kind, None if size is None else size_of(size, f"is_{kind} {part!r}"))
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
        return misfits(self.found, self.touches.values(), self._close)

    @cached_property
    def _recognised(self) -> tuple[dict[str, Body], dict[str, Finding]]:
        whole = bodies(self.solids, self.touches.values())
        return whole, recognised(whole, self.touches.values())

    def take(self, found: Mapping[str, Finding]) -> None:
        """Parts are what another reading of the file has found."""
        self._overruled |= found

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
            blocks.append(f"{part}\n{_surface_table(surfaces, names)}")
        return "\n".join(blocks)

    def __str__(self) -> str:
        volume = sum(s.volume for s in self.solids.values())
        lines = [
            f"{self.path.name}: {len(self.solids)} parts, {volume:.5g} mm^3, "
            f"{len(self.touches)} interfaces proposed (gap up to {self.gap:.3g} mm)",
            "",
        ]
        rows: list[tuple[str, ...]] = [("part", "volume mm^3", "cells mm", "faces", "material")]
        for name, solid in self.solids.items():
            body = self._bodies.get(name)
            material = "-" if body is None else type(body.material).__name__
            size = f"{self._size(name):.3g}"
            rows.append((name, f"{solid.volume:.5g}", size, str(len(solid.surfaces)), material))
        lines += columns(_merged(rows), "<>>><")
        contacts: list[tuple[str, ...]] = [("interface", "kind", "area mm^2", "gap mm", "face", "law")]
        for name, touch in self.touches.items():
            join = self._joins.get(name)
            law = "-" if name not in self._joins else "left open"
            law = join.law.title if join is not None else law
            sizes = (f"{touch.area:.5g}", f"{touch.gap:.3g}")
            contacts.append((name, touch.kind, *sizes, _shape(touch), law))
        if len(contacts) > 1:
            lines += ["", *columns(_merged(contacts), "<<>><<")]
        lines += [f"nothing touches: {text}" for text in self._alone]
        taken: list[tuple[str, ...]] = [("part", "taken for", "why")]
        taken += [(n, f.title, "; ".join(f.reasons)) for n, f in self.found.items() if f.kind]
        if len(taken) > 1:
            lines += ["", *columns(_merged(taken), "<<<")]
        lines += [f"does not fit: {text}" for text in self.misfits]
        return "\n".join(lines)

    def __repr__(self) -> str:
        return f"StepAssembly({self.path.name}: {len(self.solids)} parts, {len(self.touches)} interfaces)"

    # -- from here to a scene --------------------------------------------------------------------
    def mesh(
        self, *, per_turn: int = 8, order: int = 2, progress: bool = True, timeout: float | None = TIMEOUT
    ) -> Assembly:
        """Mesh the parts, in a process of its own.

        Parameters
        ----------
        per_turn
            Least number of cells around a full circle. Where chords of circles that are close to each other
            (a pin in a narrow clearance) cross, up to eight times as many are taken.
        order
            2: cells follow round faces; 1: straight cells.
        progress
            A progress bar if on a terminal.
        timeout
            Seconds after which meshing is given up (ten minutes if not given); None: never.

        Raises
        ------
        SceneError
            gmsh cannot mesh a part, or curved cells are folded.
        """
        if not is_whole(order) or order not in (1, 2):
            raise SceneError(f"order = {order!r} must be 1 (straight) or 2 (curved)")
        if not is_whole(per_turn) or per_turn < 3:
            raise SceneError(f"per_turn = {per_turn!r}: a circle needs three cells at least")
        checked_flag("mesh", "progress", progress)
        faces = {f"{part}:{face}": tags for (part, face), tags in {**self._taken, **self._named}.items()}
        local = [
            (tuple(sorted({*self.touches[n].surfaces[0], *self.touches[n].surfaces[1]})), size)
            for n, size in self._local.items()
        ]
        sizes = {name: self._size(name) for name in self.solids}
        with Bar(3 + (order == 2), "mesh", "stage", progress) as bar:

            def each(stage: str) -> None:
                if stage.startswith(("meshing", "curving")):
                    bar.step()

            finest = _FINER_TURNS * per_turn
            while True:
                recipe = Recipe(self.solids, faces, sizes, local, per_turn, order)
                try:
                    with _copied(self._source) as source:
                        model = away(
                            "mesh",
                            self.path,
                            "cannot be meshed",
                            "give smaller sizes, or fix the geometry",
                            timeout,
                            each,
                            source=source,
                            recipe=recipe,
                        )
                    break
                except SceneError as error:
                    # chords of two circles that are close to each other cross, or leave no room: more of them
                    # do not
                    told = any(each in str(error) for each in (_CROSSING, FLAT))
                    if not told or per_turn >= finest:
                        raise
                    per_turn *= 2
        parts = {
            name: replace(part, again=_MeshedAgain(self.path, self._source, recipe, name, timeout))
            for name, part in assembled(model).parts.items()
        }
        kinds = {name: j.law.drawn for name, j in self._joins.items() if j is not None}
        connections = tuple(Connection(n, kinds[n], *self._faces[n]) for n in self.touches if n in kinds)
        parameters = {"path": str(self.path), "per_turn": per_turn, "order": order}
        return Assembly({n: parts[n] for n in self.solids}, connections, MappingProxyType(parameters))

    def scene(self, assembly: Assembly | None = None, **settings: Any) -> Scene:
        """The scene: every part with its material, every interface with its law.

        Parameters
        ----------
        assembly
            From :meth:`mesh`, to use a mesh again with other laws; None: mesh now, with `settings`.

        Raises
        ------
        SceneError
            A part without a material, an interface without a law.
        """
        lacking = [n for n in self.solids if n not in self._bodies]
        if lacking:
            raise SceneError(
                f"no material for {some(lacking)}; give one: step.material({lacking[0]!r}, ...)"
            )
        lacking = [n for n in self.touches if n not in self._joins]
        if lacking:
            raise SceneError(
                f"no law for {some(lacking)}; give one, step.join({lacking[0]!r}, Perfect()), or leave it "
                f"open, step.leave({lacking[0]!r})"
            )
        meshed = assembly or self.mesh(**settings)
        for name in self.solids:
            check_known("part", name, meshed.parts, "step.scene: this mesh has other names; mesh again")
        scene = Scene()
        for name in self.solids:
            body = self._bodies[name]
            scene.substructure(name, meshed.parts[name], body.material, body.degree, body.body_force)
        for name, touch in self.touches.items():
            join = self._joins[name]
            if join is None:
                continue
            matches = touch.kind != "near"
            settings = dict(join.settings)
            if not matches and "max_distance" not in settings:
                # relative to the largest facet; the usual one, which refining keeps, if it is enough
                size = min(self._size(p) for p in touch.parts)
                if 4.0 * touch.widest > 0.25 * size:
                    settings["max_distance"] = 4.0 * touch.widest / size
            space: Space = join.space or "auto"
            partial = not matches and space != "points"
            scene.interface(
                name,
                *self._faces[name],
                join.law,
                space=space,
                overlap=join.overlap or ("partial" if partial else "full"),
                **settings,
            )
        read = made_by(self)
        if read is not None:  # in place of the parts one by one
            of_mesh = {key: meshed.parameters[key] for key in ("per_turn", "order")}
            given = {**read.arguments, "calls": tuple(self.journal), "mesh": of_mesh}
            scene.journal.calls = [Call("step", ReadOnlyDict(given))]
        return scene

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

    def _small(self) -> float:
        """A length that is rounding."""
        low = np.min([s.low for s in self.solids.values()], axis=0)
        high = np.max([s.high for s in self.solids.values()], axis=0)
        return 1e-6 * float(np.linalg.norm(high - low))

    def _size(self, part: str) -> float:
        return self._sizes.get(part, self.solids[part].thickness)

    def _in_contact(self, surface: Surface) -> bool:
        return any(p == surface.part and surface.tag in tags for (p, _), tags in self._taken.items())

    def _free(self, part: str) -> list[Surface]:
        """Faces of a part that are in no interface and have no name."""
        named = {t for (p, _), tags in self._named.items() if p == part for t in tags}
        return [
            s for s in self.solids[part].surfaces if s.tag not in named and not self._in_contact(s)
        ]


@recorded
def read_step(
    path: str | Path,
    *,
    gap: float | None = None,
    cuts: Sequence[Cut] | Cut = (),
    imprint: bool = True,
    tolerance: float | None = None,
    partial: bool = False,
    timeout: float | None = TIMEOUT,
) -> StepAssembly:
    """Parts of a STEP file, and where they touch.

    A copy of the file is read in a process of its own: OpenCASCADE may end it if the file is damaged. Other
    files that it refers to are not opened; a warning names them.

    Parameters
    ----------
    path
        The file; every solid becomes a part. Its name is that of its product, numbered where several
        solids have the same; without one it is ``part``.
    gap
        Distance up to which faces count as nearly touching, mm. None: 1e-4 of the diagonal of the assembly.
    cuts
        Planes that cut solids in two, for the pretension sections of bolts.
    imprint
        Divide touching faces where the others end, so that both sides are the same face and their meshes
        match. False: every part keeps its faces and gets a mesh of its own.
    tolerance
        Distance up to which OpenCASCADE merges points when it divides faces, mm; None: its default.
    partial
        Go on without solids that cannot be read; a warning names them. False: an error names them.
    timeout
        Seconds after which reading is given up (ten minutes if not given); None: never. OpenCASCADE may be
        busy for ever with a damaged file.

    Returns
    -------
    StepAssembly
        To be printed, completed and meshed.

    Raises
    ------
    SceneError
        A file that cannot be read as STEP or holds no solid; a solid that cannot be read; solids that
        overlap (which, and how much); parts that do not touch (with the nearest distances); a cut that
        does not cut in two.
    """
    file = checked_path("read_step", path)
    several = isinstance(cuts, Sequence) and not isinstance(cuts, (str, Cut))
    planes = tuple(cast(Sequence[Cut], cuts)) if several else (cast(Cut, cuts),)
    for each in planes:
        check_kind("read_step", "cuts", each, Cut, "give Cut(parts, normal), or several")
    checked_flag("read_step", "imprint", imprint)
    for name, value in (("gap", gap), ("tolerance", tolerance)):
        if value is not None:
            checked_number("read_step", name, value, least=0.0)
    checked_flag("read_step", "partial", partial)
    check_timeout(timeout)
    source = Source(file.absolute(), file.name, planes, imprint, tolerance, partial)
    with _copied(source) as copy:
        found: Survey = away(
            "survey", file, "cannot be read as STEP", "export it again", timeout, source=copy, gap=gap
        )
    if found.outside:
        others = ", ".join(map(repr, found.outside))
        warn(
            f"{file.name!r} refers to other files, which are not opened ({others}); export the assembly as "
            "one file",
            SceneWarning,
        )
    if found.lost:
        warn(
            f"{file.name!r}: solids that cannot be read, or not in full: {'; '.join(found.lost)}",
            SceneWarning,
        )
    touches = {t.name: t for t in found.touches}
    alone, close = found.alone, found.close
    return StepAssembly(file, found.solids, touches, found.gap, source, _alone=alone, _close=close)


@contextmanager
def _copied(source: Source) -> Iterator[Source]:
    """The source with a copy of its file, see :func:`alone`."""
    with alone(source.path, "file.step", check_begin) as copy:
        yield replace(source, path=copy)


@dataclass(frozen=True)
class _MeshedAgain:
    """Meshes one part of a file with other sizes, in a process of its own."""

    path: Path
    source: Source
    recipe: Recipe
    part: str
    timeout: float | None

    def __call__(self, size: SizeField | None) -> Part:
        if size is None:
            raise SceneError(f"part {self.part!r}: step.mesh() makes its first mesh; give a SizeField")
        with _copied(self.source) as source:
            model = away(
                "mesh",
                self.path,
                f"cannot be meshed again in part {self.part!r}",
                "give smaller sizes, or fix the geometry",
                self.timeout,
                source=source,
                recipe=replace(self.recipe, again=(self.part, size)),
            )
        return replace(assembled(model).parts[self.part], again=self)


def _contact_faces(touches: Any) -> dict[tuple[str, str], tuple[int, ...]]:
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


def _fits(
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


def _shape(touch: Touch) -> str:
    return f"normal {vector(touch.normal)}" if np.any(touch.normal) else touch.shape


def _merged(rows: Sequence[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """Rows that differ only in the number of ``nut 1``, ``nut 2``, ... as one row, ``nut 1 .. 8``."""
    out: list[tuple[str, ...]] = []
    counts: list[int] = []
    for row in rows:
        stem = _stem(row[0])
        same = [
            k for k, other in enumerate(out) if other[1:] == row[1:] and _stem(other[0]) == stem
        ]
        if same and stem != row[0]:
            counts[same[0]] += 1
        else:
            out.append(row)
            counts.append(1)
    return [
        (row[0] if count == 1 else f"{_stem(row[0])}  ({count})", *row[1:])
        for row, count in zip(out, counts, strict=True)
    ]


def _stem(name: str) -> str:
    """A name without its numbers."""
    return re.sub(r"\d+", "*", name)


def _surface_table(surfaces: Sequence[Surface], names: Mapping[int, str] | None = None) -> str:
    rows = [("tag", "area mm^2", "centre mm", "face", "name")]
    for s in surfaces:
        centre = vector(np.round(s.centre, 2))
        rows.append((str(s.tag), f"{s.area:.5g}", centre, s.shape, (names or {}).get(s.tag, "")))
    return "\n".join("  " + line for line in columns(rows, ">>><<"))
