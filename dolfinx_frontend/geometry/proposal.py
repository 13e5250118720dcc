"""From what the parts of a STEP file are taken for to a scene: cuts, laws, materials, each with its reason.

Heads, nuts and joints are in contact with friction, threads are tied, shanks are free, bolts are cut at half
of their grip for their preload; gaskets and sheets between parts are in contact on both sides. Supports and
loads stay the user's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.geometry.findings import Finding, play, threads
from dolfinx_frontend.geometry.solids import Cut
from dolfinx_frontend.geometry.threads import HEAD, JOINT, TIGHTENING, Span, preload
from dolfinx_frontend.geometry.touching import Touch
from dolfinx_frontend.scene.laws import Contact, Law, Perfect, Preload
from dolfinx_frontend.scene.materials import LinearElastic
from dolfinx_frontend.uncertainty.parameters import LogNormal, Normal

__all__ = ["Choice", "clamped_by", "room", "section"]

STEEL = LinearElastic(E=210e3, nu=0.3)
SOFT = LinearElastic(E=1e3, nu=0.3)
"""Of gaskets, MPa: a value to be replaced by that of the maker."""

_ROOM = 1.01
"""Distance up to which a thread is looked for, over the room around it."""


@dataclass(frozen=True)
class Choice:
    """What is proposed, given what holds for all bolts.

    Attributes
    ----------
    grade, tightening, scatter
        See :meth:`StepAssembly.proposal`.
    """

    grade: str
    tightening: str
    scatter: bool

    def friction(self, name: str, span: Span) -> Any:
        """A coefficient of friction of a table."""
        return LogNormal(name, span.mean, cov=span.cov) if self.scatter else span.mean

    def material(self, found: Finding) -> tuple[LinearElastic, str]:
        """Of a part, and why."""
        if found.kind == "gasket":
            return SOFT, "assumed: the maker knows it"
        if found.missing and found.kind:
            return STEEL, f"assumed: steel, MPa; it {found.missing}: a gasket has some 1 GPa"
        return STEEL, "assumed: steel, MPa"

    def law(self, touch: Touch, found: Sequence[Finding], clamped: bool) -> tuple[Law | None, str]:
        """The law of a pair of faces, None: open; and why. `clamped`: one bolt goes through both parts."""
        kinds = {f.kind for f in found}
        round_ = "cylinder" in touch.shape
        if touch.kind == "cut":
            return self.tightened(found[0])
        if touch.kind == "thread":
            return Perfect(), f"a thread, drawn {-touch.gap:.3g} mm into its hole: tied over its length"
        for one, other in (found, found[::-1]):
            if one.kind in ("bolt", "stud") and round_ and not np.any(touch.normal):
                held = {p.part for each in threads(one).values() for p in each}
                if other.part in held and touch.gap <= _ROOM * play(one, other.part):
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
            mu = self.friction("mu_gasket", JOINT)
            return Contact(gap=gap, friction=mu), "gasket: friction as of a dry joint, VDI 2230 table A6"
        if kinds & {"bolt", "nut", "washer", "stud"}:
            mu = self.friction("mu_head", HEAD)
            return Contact(gap=gap, friction=mu), "under a head, nut or washer: VDI 2230 table A5, class B"
        between = any(one.part in other.between for one, other in (found, found[::-1]))
        if not clamped and not between:
            return Perfect(), "no bolt clamps these two: tied"
        mu = self.friction("mu_joint", JOINT)
        joint = "clamped joint" if clamped else "a thin sheet between two parts"
        return Contact(gap=gap, friction=mu), f"{joint}: dry steel, VDI 2230 table A6"

    def tightened(self, bolt: Finding) -> tuple[Law, str]:
        """The pretension section of a bolt."""
        if bolt.size is None:
            raise SceneError(
                f"propose: {bolt.part!r} has no size of ISO 261: say which thread it is, "
                f"step.is_bolt({bolt.part!r}, \"M12\"), or step.is_not({bolt.part!r})"
            )
        span = preload(bolt.size, self.grade, self.tightening)
        force = Normal(f"F {bolt.part}", span.mean, cov=span.cov) if self.scatter else span.mean
        why = (
            f"{bolt.size.name}, class {self.grade}, {TIGHTENING[self.tightening][1]}: "
            f"{1e-3 * span.low:.3g} to {1e-3 * span.high:.3g} kN, VDI 2230 tables A1 and A8"
        )
        return Preload(force, until=1.0), why


def room(found: Mapping[str, Finding]) -> float:
    """Up to which faces have to count as nearly touching, for all threads to be tied."""
    return _ROOM * max(map(play, found.values()), default=0.0)


def clamped_by(found: Mapping[str, Finding], parts: Sequence[str]) -> bool:
    """Whether one bolt goes through all of these parts."""
    bolts = ({p.part for p in f.passages} for f in found.values() if f.kind in ("bolt", "stud"))
    return any(set(parts) <= through for through in bolts)


def section(found: Finding) -> Cut | None:
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
