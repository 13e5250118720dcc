"""How far an answer is from the reference, for every part, step, mean and fluctuation.

Parts that a run has glued (their interfaces were eliminated) are one part with their springs, as they are for
its estimate. Two norms of a part's error, each relative to the part's own answer in the same norm:

* *energy*: sqrt(e K e) over sqrt(u K u): strains and forces, where the part is strained;
* *displacement*: the root of the integral of e^2 over its interfaces, over that of u^2: where the part is.

A part's error is the larger of the two. Neither is enough alone: a part on soft springs may carry the right
force at the wrong place, and a part that flies far may be nearly unstrained. What double precision leaves
(`floors` of the reference, ten times; ten rounding errors of the largest displacement of the parts it is
connected with, for an iteration passes on displacements and forces that differ by them; 1e-10 in any case,
of a scatter 1e-10 of the mean) is no error, so that a part without a load is not wrong by 1e-16 of its
neighbour's motion. What is nothing but rounding, or moves by less than thirty such errors, has no size of
its own: a scatter is then compared with the mean, the displacement of a part that stays where it is with
the largest one of the scene, and strains are not compared. The fluctuation of a chaos is all its columns
but the first; that of samples is what is left without their mean. A step is compared with itself, but with
no less than 1e-9 of the part's largest step, and faces that are held with no less than 1e-4 of the part's
largest displacement, for a soft part that is glued on a rock has none to speak of there; a scatter with
itself, below 1e-6 of the mean with the mean: it is not worth an order of a chaos or a sample.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import dolfinx_frontend as lf
import numpy as np

from campaign.points import Array
from campaign.reference import EPS, Answer, Norms

FLOORS = 10.0
"""So many times the estimated rounding error is still rounding."""
LEAST = 1e-10
"""Errors below this are rounding in any case: an iteration's own is not known to the reference."""
NOISE = 30.0
"""Displacements of so many rounding errors of those of connected parts are none."""
QUIET = 1e-9
"""A step is compared with this fraction of the part's largest step at least."""
HELD = 1e-4
"""The displacement of faces is compared with this fraction of the largest one of the part at least."""
SCATTER = 1e-6
"""A scatter below this fraction of the part's mean is none, and is compared with the mean."""
NAMES = ("energy", "displacement")


@dataclass(frozen=True)
class Error:
    """One error of one part.

    Attributes
    ----------
    part, place, norm
        Which; the place is the step, the point of a sweep, and ``mean`` or ``fluctuation`` where it applies.
    true
        Relative; 0 if rounding explains it.
    raw, floor
        Relative error as found, and what of it rounding explains.
    said
        What the result says of it.
    """

    part: str
    place: str
    norm: str
    true: float
    raw: float
    floor: float
    said: float

    def __str__(self) -> str:
        where = f", {self.place}" if self.place else ""
        return f"{self.part}{where}, {self.norm}: true {self.true:.2e}, said {self.said:.2e}"


def columns(what: str) -> tuple[slice, ...]:
    """Which columns are measured together."""
    return (slice(0, 1), slice(1, None)) if what == "chaos" else (slice(0, 1),)


def errors(
    norms: Norms,
    found: Sequence[Mapping[str, Array]],
    answers: list[Answer],
    said: float,
    kind: str = "",
    label: str = "",
    steps: bool = False,
) -> list[Error]:
    """Errors of the steps of one history (or of one answer).

    Parameters
    ----------
    found
        Step -> part -> (n, columns).
    answers
        The reference's.
    said
        What the result says.
    kind
        ``"chaos"``: columns are modes.
    label, steps
        For the place.
    """
    out: list[Error] = []
    groups = columns(kind)
    sizes: dict[tuple[str, int, int], Array] = {}
    spans = {name: 0.0 for name in norms.stiffness}
    for k, answer in enumerate(answers):
        for name in spans:
            spans[name] = max(spans[name], float(np.abs(answer.fields[name]).max(initial=0.0)))
        for name, parts in norms.components.items():
            for g, group in enumerate(groups):
                sizes[name, k, g] = norms.over(parts, {p: answer.fields[p][:, group] for p in parts})
    for k, answer in enumerate(answers):
        for name, parts in norms.components.items():
            faces = sum(norms.on_faces[p].diagonal().sum() for p in parts)
            reach = max(spans[p] for p in norms.islands[parts[0]])
            least = sum(
                10.0 * EPS * reach
                * np.sqrt([norms.stiffness[p].diagonal().sum(), norms.on_faces[p].diagonal().sum()])
                for p in parts
            )
            least = least + 10.0 * EPS * reach * np.array([norms.of_springs(parts), 0.0])
            for g, group in enumerate(groups):
                wrong = {
                    p: np.asarray(found[k][p])[:, group] - answer.fields[p][:, group] for p in parts
                }
                away = norms.over(parts, wrong)
                if not np.all(np.isfinite(away)):
                    away = np.array([np.inf, np.inf])
                size = sizes[name, k, g]
                peak = np.max([sizes[name, j, g] for j in range(len(answers))], axis=0)
                floor = FLOORS * sum(answer.floors[p][:, g] for p in parts) + least
                place = [label] if label else []
                place += [f"step {k}"] if steps else []
                place += [("mean", "fluctuation")[g]] if kind == "chaos" else []
                for i, norm in enumerate(NAMES):
                    whole = max(size[i], QUIET * peak[i])
                    if norm == "displacement" and not g:
                        largest = max(float(np.abs(answer.fields[p][:, group]).max()) for p in parts)
                        whole = max(whole, HELD * largest * np.sqrt(faces))
                    if g and whole < SCATTER * sizes[name, k, 0][i]:
                        whole = sizes[name, k, 0][i]
                    if whole <= max(floor[i], NOISE * EPS * reach * np.sqrt(faces) if i else 0.0):
                        # nothing but rounding: no strain, or what should not move (or scatter) at all
                        if norm == "energy":
                            continue
                        whole = sizes[name, k, 0][i] if g else reach * np.sqrt(faces)
                        if whole <= floor[i]:  # nothing is known of it
                            out.append(Error(name, ", ".join(place), norm, 0.0, 0.0, 1.0, said))
                            continue
                    raw, rounding = away[i] / whole, floor[i] / whole
                    of_mean = LEAST * sizes[name, k, 0][i] if g else 0.0
                    true = raw if away[i] > max(floor[i], of_mean) and raw > LEAST else 0.0
                    out.append(Error(name, ", ".join(place), norm, true, raw, rounding, said))
    return out


def whole(norms: Norms, found: Sequence[Mapping[str, Array]], answers: Sequence[Answer]) -> float:
    """The larger of the two norms, in one number for all parts, steps and columns."""
    away, size = np.zeros(2), np.zeros(2)
    for mine, answer in zip(found, answers, strict=True):
        for name, exact in answer.fields.items():
            away += norms.of(name, np.asarray(mine[name]) - exact) ** 2
            size += norms.of(name, exact) ** 2
    return float(np.sqrt(np.max(away / np.maximum(size, 1e-300))))


def spread(
    norms: Norms,
    found: Sequence[Mapping[str, Array]],
    answers: list[Answer],
    weights: Array,
    said: float,
    label: str,
) -> list[Error]:
    """Errors of mean and fluctuation of samples: (n, 1) each, with weights of sum 1."""
    out = []
    for name, parts in norms.components.items():
        exact = {p: np.stack([a.fields[p][:, 0] for a in answers], axis=1) for p in parts}
        mine = {p: np.stack([np.asarray(f[p])[:, 0] for f in found], axis=1) for p in parts}
        means = [{p: u @ weights for p, u in fields.items()} for fields in (exact, mine)]
        rest = [
            {p: (u - m[p][:, None]) * np.sqrt(weights) for p, u in fields.items()}
            for fields, m in zip((exact, mine), means, strict=True)
        ]
        bound = sum(
            FLOORS * np.max([a.floors[p][:, 0] for a in answers], axis=0)
            + EPS * 10.0 * float(np.abs(exact[p]).max())
            * np.sqrt([norms.stiffness[p].diagonal().sum(), norms.on_faces[p].diagonal().sum()])
            for p in parts
        )
        reach = max(float(np.abs(exact[p]).max()) for p in parts)
        bound = bound + 10.0 * EPS * reach * np.array([norms.of_springs(parts), 0.0])
        mean_size = norms.over(parts, means[0])
        for what, (e, m) in (("mean", means), ("fluctuation", rest)):
            size, away = norms.over(parts, e), norms.over(parts, {p: m[p] - e[p] for p in parts})
            for i, norm in enumerate(NAMES):
                whole = size[i]
                if what == "fluctuation" and whole < SCATTER * mean_size[i]:
                    whole = mean_size[i]
                if whole <= bound[i]:
                    # what should not scatter
                    whole = mean_size[i]
                    if norm == "energy" or whole <= bound[i]:
                        continue
                least = max(bound[i], LEAST * mean_size[i], LEAST * whole)
                true = away[i] / whole if away[i] > least else 0.0
                place = f"{label}, {what}" if label else what
                out.append(Error(name, place, norm, true, away[i] / whole, bound[i] / whole, said))
    return out


def broken_laws(
    problem: Any,
    laws: Mapping[str, Any],
    forces: Mapping[str, tuple[Array, Array]],
    fields: Mapping[str, Array],
) -> dict[str, float]:
    """How far forces and jumps of contacts are from complementarity and friction's cone, relative.

    Parameters
    ----------
    forces
        Interface -> force and jump (m, components) of the result.
    fields
        Part -> displacements (n, 1).
    """
    from campaign.points import Friction, point_law

    out = {}
    for name, (force, jump) in forces.items():
        law = laws[name]
        if not isinstance(law, lf.Contact):
            continue
        interface = problem.interfaces[name]
        point = point_law(interface, law, None, None)
        assert isinstance(point, Friction)
        w = interface.weights
        opening = jump[:, 0] - point.delta[:, 0] + point.gap - point.compliance * force[:, 0]
        size = np.sqrt(w @ np.sum(force**2, axis=1))
        d = interface.dim
        moved = [side.shape @ fields[side.substructure].reshape(-1, d) for side in interface.sides]
        far = max([np.sqrt(w @ np.sum(u**2, axis=1)) for u in moved] + [np.sqrt(w @ point.gap**2), 1e-300])
        out[f"{name}: pulls"] = float(np.sqrt(w @ np.maximum(force[:, 0], 0.0) ** 2) / max(size, 1e-300))
        out[f"{name}: penetrates"] = float(np.sqrt(w @ np.minimum(opening, 0.0) ** 2) / far)
        pressed = np.maximum(-force[:, 0], 0.0) / max(size, 1e-300)
        both = np.minimum(np.maximum(opening, 0.0) / far, pressed)
        out[f"{name}: presses where open"] = float(np.sqrt(w @ both**2))
        if force.shape[1] > 1:
            over = np.maximum(np.linalg.norm(force[:, 1:], axis=1) - point.bound(force), 0.0)
            out[f"{name}: leaves the cone"] = float(np.sqrt(w @ over**2) / max(size, 1e-300))
    return out


def nodal(interface: Any, law: Any, force: Array) -> list[Array]:
    """Nodal forces (nodes of the part, d) of an interface on its sides; its force is (m, components)."""

    d = interface.dim
    frames = interface.frames[:, : force.shape[1]]
    if isinstance(law, lf.Displacement):
        axes = list(range(d) if law.components is None else law.components)
        frames = np.broadcast_to(np.eye(d)[axes], (len(force), len(axes), d))
    at_points = interface.weights[:, None] * np.einsum("mk,mkd->md", force, frames)
    signs = zip(interface.sides, (1.0, -1.0), strict=False)
    return [sign * (side.shape.T @ at_points) for side, sign in signs]


def unbalanced(
    problem: Any,
    laws: Mapping[str, Any],
    forces: Mapping[str, Array],
    body: Mapping[str, Array],
    reach: float,
) -> dict[str, float]:
    """Resultants that are left over on every part whose forces are all known, relative to all that act on it.

    Parameters
    ----------
    forces
        Interface -> force (m, components); those that are missing are not known.
    body
        Part -> nodal body forces (n,).
    reach
        Largest displacement of the scene; what its rounding does to the forces of a part, of its neighbours
        and of springs between them, whose stiffness it is multiplied by, is no imbalance. Neither is that of
        parts that springs join it to: they may be one body for the run.
    """
    stiffest = {name: float(part.matrix.diagonal().sum()) for name, part in problem.substructures.items()}
    near = dict(stiffest)
    for label, interface in problem.interfaces.items():
        sides = [side.substructure for side in interface.sides]
        spring = 0.0
        if isinstance(laws[label], lf.Elastic):
            spring = float((laws[label].stiffnesses(interface) * interface.weights[:, None]).sum())
        for name in sides:
            near[name] = max(near[name], spring, *(stiffest[other] for other in sides))
    joined = [
        {side.substructure for side in interface.sides}
        for label, interface in problem.interfaces.items()
        if isinstance(laws[label], lf.Elastic | lf.Perfect)
    ]
    for _ in near:  # to the ends of a chain
        for names in joined:
            near.update(dict.fromkeys(names, max(near[name] for name in names)))
    left: dict[str, Any] = {name: [body[name].reshape(-1, problem.dim)] for name in problem.substructures}
    for name, interface in problem.interfaces.items():
        known = nodal(interface, laws[name], forces[name]) if name in forces else None
        for i, side in enumerate(interface.sides):
            acts = left[side.substructure]
            if acts is not None and known is not None:
                acts.append(known[i])
            else:
                left[side.substructure] = None
    out = {}
    for name, acts in left.items():
        if acts is None:
            continue
        part = problem.substructures[name]
        each = np.array([part.rigid_modes.T @ act.ravel() for act in acts])
        size = max(float(np.abs(act).sum()) for act in acts)
        left_over = float(np.abs(each.sum(axis=0)).max())
        if left_over > 20.0 * EPS * reach * near[name]:
            out[name] = left_over / size
    return out
