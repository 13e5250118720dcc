"""From what the parts of a STEP file are taken for to a scene: cuts, laws, materials, each with its reason.

Heads, nuts and joints are in contact with friction, threads are tied, shanks are free, bolts are cut at half
of their grip for their preload; gaskets are in contact on both sides. Supports and loads stay the user's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dolfinx_frontend.common.checks import checked_flag
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.recorded import made_by
from dolfinx_frontend.geometry.recognition import Finding, threads
from dolfinx_frontend.geometry.solids import Cut
from dolfinx_frontend.geometry.step import StepAssembly, read_step
from dolfinx_frontend.geometry.threads import HEAD, JOINT, TIGHTENING, Span, preload
from dolfinx_frontend.geometry.touching import Touch
from dolfinx_frontend.scene.laws import Contact, Law, Perfect, Preload
from dolfinx_frontend.scene.materials import LinearElastic
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.uncertainty.parameters import LogNormal, Normal

__all__ = ["proposal", "propose"]

STEEL = LinearElastic(E=210e3, nu=0.3)
SOFT = LinearElastic(E=1e3, nu=0.3)
"""Of gaskets, MPa: a value to be replaced by that of the maker."""


@dataclass(frozen=True)
class _Choice:
    """What holds for all proposals."""

    grade: str
    tightening: str
    scatter: bool

    def friction(self, name: str, span: Span) -> Any:
        """A coefficient of friction of a table."""
        return LogNormal(name, span.mean, cov=span.cov) if self.scatter else span.mean


def proposal(
    step: StepAssembly, *, grade: str = "8.8", tightening: str = "torque", scatter: bool = True
) -> StepAssembly:
    """The file read again with cuts for its bolts, and with a material, sizes and laws for everything.

    What was given by :meth:`StepAssembly.material`, `size`, `face`, `join` and `leave` before holds; it may
    also be given afterwards. ``proposal.why`` says for each law and material where it comes from.

    Parameters
    ----------
    grade
        Property class of all bolts, ISO 898-1.
    tightening
        How they are tightened, which makes the scatter of their preload (VDI 2230, table A8): "torque",
        "torque, tested", "angle", "yield", "hydraulic", "impact".
    scatter
        Preloads and friction are random; False: they are their means.

    Raises
    ------
    SceneError
        A class or way of tightening that is not in the tables; a file that has changed.
    """
    choice = _Choice(grade, tightening, checked_flag("proposal", "scatter", scatter))
    found = step.found
    cuts = tuple(c for c in (_section(f) for f in found.values() if f.part in step.solids) if c is not None)
    new = _read_again(step, cuts)
    new.take(found)
    for name, f in found.items():
        soft = f.kind == "gasket"
        for part in _pieces(new, name):
            new.material(part, SOFT if soft else STEEL)
            new.why["material", part] = "assumed: the maker knows it" if soft else "assumed: steel, MPa"
            if f.shank is not None:
                new.size(part, 0.5 * f.shank.d)
    of = {part: name for name in found for part in _pieces(new, name)}
    bolts = [{p.part for p in f.passages} for f in found.values() if f.kind in ("bolt", "stud")]
    for name, touch in new.touches.items():
        parts = {of[p] for p in touch.parts}
        clamped = any(parts <= through for through in bolts)
        law, why = _law(choice, touch, [found[of[p]] for p in touch.parts], clamped)
        if law is None:
            new.leave(name)
        else:
            new.join(name, law)
        new.why["join", name] = why
    _carry(step, new, of)
    return new


def propose(
    step: StepAssembly,
    *,
    grade: str = "8.8",
    tightening: str = "torque",
    scatter: bool = True,
    **settings: Any,
) -> Scene:
    """The scene of :func:`proposal`; `settings` are those of :meth:`StepAssembly.mesh`.

    Bolts are tightened up to the time 1; loads come after it. Supports and loads are added to the scene.
    """
    return proposal(step, grade=grade, tightening=tightening, scatter=scatter).scene(**settings)


def _pieces(step: StepAssembly, name: str) -> list[str]:
    """A part, or the halves that it was cut into."""
    return [name] if name in step.solids else [each for each in (f"{name}-", f"{name}+")
                                               if each in step.solids]


def _section(found: Finding) -> Cut | None:
    """Where a bolt is cut: half-way between what holds it, where nothing does."""
    shank = found.shank
    if found.kind not in ("bolt", "stud") or shank is None:
        return None
    low, high = _grip(found)
    if not high - low > 0.0:
        return None
    way = -1.0 if 1 in shank.heads and -1 not in shank.heads else 1.0  # from the head to the tip
    through = found.origin + 0.5 * (low + high) * found.axis
    x, y, z = (way * float(v) + 0.0 for v in found.axis)
    px, py, pz = (float(v) for v in through)
    return Cut(found.part, (x, y, z), (px, py, pz))


def _grip(found: Finding) -> tuple[float, float]:
    """Between heads and threads, along the axis of a bolt."""
    shank = found.shank
    assert shank is not None
    held = threads(found)
    low = max((p.high for p in held[-1]), default=shank.low)
    high = min((p.low for p in held[1]), default=shank.high)
    return low, high


def _read_again(step: StepAssembly, cuts: Sequence[Cut]) -> StepAssembly:
    """The same file with more cuts, and with the names that its parts have now."""
    call = made_by(step)
    assert call is not None
    given = dict(call.arguments)
    own = given.pop("cuts", ())
    own = (own,) if isinstance(own, Cut) else tuple(own)
    of_file = {name: body.label for name, body in step._recognised[0].items()}
    more = [replace(cut, parts=of_file[cut.parts]) for cut in cuts]
    new = read_step(**{**given, "cuts": (*own, *more)})
    names = {label: name for name, label in of_file.items() if label != name}
    if names:
        new.rename(names)
    return new


def _law(choice: _Choice, touch: Touch, found: Sequence[Finding], clamped: bool) -> tuple[Law | None, str]:
    """The law of a pair of faces, None: open; and why. `clamped`: one bolt goes through both parts."""
    kinds = {f.kind for f in found}
    round_ = "cylinder" in touch.shape
    if touch.kind == "cut":
        return _tightened(choice, found[0])
    if touch.kind == "thread":
        return Perfect(), f"a thread, drawn {-touch.gap:.3g} mm into its hole: tied over its length"
    for one, other in (found, found[::-1]):
        if one.kind in ("bolt", "stud") and round_ and not np.any(touch.normal):
            held = {p.part for each in threads(one).values() for p in each}
            if other.part in held and touch.kind == "touching":
                return Perfect(), "a thread: tied"
            return None, "a shank in its hole: free"
        if one.kind == "dowel" and round_:
            first = next((p.part for p in one.passages if p.fits), "")
            if other.part == first:
                return Perfect(), "a dowel, pressed in here"
            return Contact(gap=0.0), "a dowel in its other hole"
    if round_ and kinds & {"nut", "washer"} and touch.kind == "near":
        return None, "room around a shank"
    gap = 0.0 if touch.kind == "touching" else None
    if "gasket" in kinds:
        mu = choice.friction("mu_gasket", JOINT)
        return Contact(gap=gap, friction=mu), "gasket: friction as of a dry joint, VDI 2230 table A6"
    if kinds & {"bolt", "nut", "washer", "stud"}:
        mu = choice.friction("mu_head", HEAD)
        return Contact(gap=gap, friction=mu), "under a head, nut or washer: VDI 2230 table A5, class B"
    if not clamped:
        return Perfect(), "no bolt clamps these two: tied"
    mu = choice.friction("mu_joint", JOINT)
    return Contact(gap=gap, friction=mu), "clamped joint: dry steel, VDI 2230 table A6"


def _tightened(choice: _Choice, bolt: Finding) -> tuple[Law, str]:
    """The pretension section of a bolt."""
    if bolt.size is None:
        raise SceneError(
            f"propose: {bolt.part!r} has no size of ISO 261: say which thread it is, "
            f"step.is_bolt({bolt.part!r}, \"M12\"), or step.is_not({bolt.part!r})"
        )
    span = preload(bolt.size, choice.grade, choice.tightening)
    force = Normal(f"F {bolt.part}", span.mean, cov=span.cov) if choice.scatter else span.mean
    why = (
        f"{bolt.size.name}, class {choice.grade}, {TIGHTENING[choice.tightening][1]}: "
        f"{1e-3 * span.low:.3g} to {1e-3 * span.high:.3g} kN, VDI 2230 tables A1 and A8"
    )
    return Preload(force, until=1.0), why


def _carry(step: StepAssembly, new: StepAssembly, of: Mapping[str, str]) -> None:
    """What the user has said of the parts and faces before holds for the new reading as well."""
    for name, body in step._bodies.items():
        for part in _pieces(new, name):
            new.material(part, body.material, body.degree, body.body_force)
            new.why["material", part] = "as given"
    for name, size in step._sizes.items():
        for part in _pieces(new, name):
            new.size(part, size)
    old = {name: _place(step, touch, lambda p: p) for name, touch in step.touches.items()}
    now: dict[str, list[str]] = {}
    for name, touch in new.touches.items():
        place = _place(new, touch, lambda p: of[p])
        now.setdefault(next((n for n, at in old.items() if _alike(at, place)), ""), []).append(name)
    for name, size in step._local.items():
        for each in now.get(name, ()):
            new.size(each, size)
    for name, join in step._joins.items():
        for each in now.get(name, ()):
            if join is None:
                new.leave(each)
            else:
                new.join(each, join.law, space=join.space, overlap=join.overlap, **join.settings)
            new.why["join", each] = "as given"
    for (part, face), tags in step._named.items():
        surfaces = [s for s in step.solids[part].surfaces if s.tag in tags]
        for piece in _pieces(new, part):
            same = [
                s.tag for s in new.solids[piece].surfaces
                if any(abs(s.area - o.area) < 1e-6 * o.area
                       and np.linalg.norm(s.centre - o.centre) < 1e-5 * np.sqrt(o.area) for o in surfaces)
            ]
            if same:
                new.face(f"{piece}:{face}", tags=same)


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


StepAssembly.proposal = proposal
StepAssembly.propose = propose
