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

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, cast

import numpy as np

from dolfinx_frontend.common.checks import (
    check_kind,
    check_known,
    checked_flag,
    checked_number,
    checked_path,
    is_whole,
)
from dolfinx_frontend.common.errors import SceneError, SceneWarning, warn
from dolfinx_frontend.common.frozen import ReadOnlyDict
from dolfinx_frontend.common.progress import Bar
from dolfinx_frontend.common.recorded import Call, made_by, recorded
from dolfinx_frontend.geometry.away import TIMEOUT, alone, away, check_timeout
from dolfinx_frontend.geometry.exchange import check_begin
from dolfinx_frontend.geometry.gmsh import assembled
from dolfinx_frontend.geometry.meshing import FLAT, some
from dolfinx_frontend.geometry.parts import Assembly, Connection, Part
from dolfinx_frontend.geometry.proposal import Choice, clamped_by, room, section
from dolfinx_frontend.geometry.reading import Recipe, Source, Survey
from dolfinx_frontend.geometry.sizes import SizeField
from dolfinx_frontend.geometry.solids import Cut
from dolfinx_frontend.geometry.step_parts import StepParts
from dolfinx_frontend.geometry.touching import Touch
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.scene.specs import Space

__all__ = ["StepAssembly", "read_step"]

_CROSSING = "PLC Error"
"""What gmsh says of edges and faces that cross each other."""
_FINER_TURNS = 8
_STAGES = 5
"""Of reading a file: read, checked, divided, measured, compared."""


class StepAssembly(StepParts):
    """The parts of a STEP file and where they touch, to be completed and meshed; see :func:`read_step`."""

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

    # -- what is proposed ------------------------------------------------------------------------
    def proposal(
        self,
        *,
        grade: str = "8.8",
        tightening: str = "torque",
        scatter: bool = True,
        accuracy: float = 0.05,
    ) -> StepAssembly:
        """The file read again with cuts for its bolts, and with a material, sizes and laws for everything.

        What was given by `material`, `size`, `face`, `join` and `leave` before holds; it may also be given
        afterwards. ``proposal.why`` says for each law and material where it comes from.

        Parameters
        ----------
        grade
            Property class of all bolts, ISO 898-1.
        tightening
            How they are tightened, which makes the scatter of their preload (VDI 2230, table A8): "torque",
            "torque, tested", "angle", "yield", "hydraulic", "impact".
        scatter
            Preloads and friction are random; False: they are their means.
        accuracy
            For the sizes of cells, see :meth:`sizes`.

        Raises
        ------
        SceneError
            A class or way of tightening that is not in the tables; a file that has changed.
        """
        choice = Choice(grade, tightening, checked_flag("proposal", "scatter", scatter))
        found = self.found
        cuts = [c for f in found.values() if f.part in self.solids and (c := section(f))]
        new = self._read_again(cuts, room(found))
        new._overruled |= found
        of = {part: name for name in found for part in new._pieces(name)}
        for part, name in of.items():
            material, new.why["material", part] = choice.material(found[name])
            new.material(part, material)
        new.sizes(accuracy)
        for name, touch in new.touches.items():
            parts = [of[p] for p in touch.parts]
            clamped = clamped_by(found, parts)
            law, new.why["join", name] = choice.law(touch, [found[p] for p in parts], clamped)
            if law is None:
                new.leave(name)
            else:
                new.join(name, law)
        self._carry(new, of)
        return new

    def propose(
        self,
        *,
        grade: str = "8.8",
        tightening: str = "torque",
        scatter: bool = True,
        accuracy: float = 0.05,
        **settings: Any,
    ) -> Scene:
        """The scene of :meth:`proposal`; `settings` are those of :meth:`mesh`.

        Bolts are tightened up to the time 1; loads come after it. Supports and loads are added to the scene.
        """
        made = self.proposal(grade=grade, tightening=tightening, scatter=scatter, accuracy=accuracy)
        return made.scene(**settings)

    def _pieces(self, name: str) -> list[str]:
        """A part, or the halves that it was cut into."""
        return [each for each in (name, f"{name}-", f"{name}+") if each in self.solids]

    def _read_again(self, cuts: Sequence[Cut], gap: float) -> StepAssembly:
        """The same file with more cuts, at least this gap, and with the names that its parts have now."""
        call = made_by(self)
        assert call is not None
        given = dict(call.arguments)
        own = given.pop("cuts", ())
        if gap > self.gap:
            given["gap"] = gap
        of_file = {name: body.label for name, body in self._recognised[0].items()}
        more = [replace(cut, parts=of_file[cut.parts]) for cut in cuts]
        new = read_step(**{**given, "cuts": (*((own,) if isinstance(own, Cut) else own), *more)})
        if names := {label: name for name, label in of_file.items() if label != name}:
            new.rename(names)
        return new

    def _carry(self, new: StepAssembly, of: Mapping[str, str]) -> None:
        """What the user has said of the parts and faces before holds for the new reading as well."""
        for name, body in self._bodies.items():
            for part in new._pieces(name):
                new.material(part, body.material, body.degree, body.body_force)
                new.why["material", part] = "as given"
        for name, size in self._sizes.items():
            for part in new._pieces(name):
                new.size(part, size)
        old = {name: _place(self, touch, lambda p: p) for name, touch in self.touches.items()}
        now: dict[str, list[str]] = {}
        for name, touch in new.touches.items():
            place = _place(new, touch, lambda p: of[p])
            now.setdefault(next((n for n, at in old.items() if _alike(at, place)), ""), []).append(name)
        for name, size in self._local.items():
            for each in now.get(name, ()):
                new.size(each, size)
        for name, join in self._joins.items():
            for each in now.get(name, ()):
                if join is None:
                    new.leave(each)
                else:
                    new.join(each, join.law, space=join.space, overlap=join.overlap, **join.settings)
                new.why["join", each] = "as given"
        for (part, face), tags in self._named.items():
            surfaces = [s for s in self.solids[part].surfaces if s.tag in tags]
            for piece in new._pieces(part):
                same = [
                    s.tag for s in new.solids[piece].surfaces
                    if any(abs(s.area - o.area) < 1e-6 * o.area
                           and np.linalg.norm(s.centre - o.centre) < 1e-5 * np.sqrt(o.area) for o in surfaces)
                ]
                if same:
                    new.face(f"{piece}:{face}", tags=same)


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
    with _copied(source) as copy, Bar(_STAGES, f"read {file.name}", "stage") as bar:
        found: Survey = away(
            "survey", file, "cannot be read as STEP", "export it again", timeout, lambda _: bar.step(),
            source=copy, gap=gap,
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


def _place(step: StepAssembly, touch: Touch, name: Any) -> tuple[frozenset[str], str, Any, Any]:
    """What tells faces of two parts from others of these: kind, direction, and where."""
    solid = step.solids[touch.parts[0]]
    surfaces = [s for s in solid.surfaces if s.tag in touch.surfaces[0]]
    centre = sum(s.area * s.centre for s in surfaces) / sum(s.area for s in surfaces)
    return frozenset(map(name, touch.parts)), touch.shape.partition(",")[0], touch.normal, centre


def _alike(a: Any, b: Any) -> bool:
    """Whether one is a piece of the other: the same two parts, and on one plane if they are plane."""
    if a[:2] != b[:2]:
        return False
    return not np.any(a[2]) or abs(float((a[3] - b[3]) @ a[2])) < 1e-6 * (1.0 + float(np.abs(a[3]).max()))
