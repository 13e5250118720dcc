"""How far an answer is from the reference, for every part, step, mean and fluctuation.

Parts that a run has glued (their interfaces were eliminated) are one part with their springs, as they are for
its estimate. Two norms of a part's error, each relative to the part's own answer in the same norm:

* *energy*: sqrt(e K e) over sqrt(u K u): strains and forces, where the part is strained;
* *displacement*: the root of the integral of e^2 over its interfaces, over that of u^2: where the part is.

A part's error is the larger of the two. Neither is enough alone: a part on soft springs may carry the right
force at the wrong place, and a part that flies far may be nearly unstrained. What double precision leaves
(`floors` of the reference, ten times; ten rounding errors of the largest displacement of the scene, for an
iteration passes on displacements and forces that differ by them; 1e-10 in any case, of a scatter 1e-10 of
the mean) is no error, so that a part without a load is not wrong by 1e-16 of its neighbour's motion. What is
nothing but rounding, or moves by less than thirty such errors, has no size of
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
import scipy.sparse as sp
from scipy.optimize import linprog

from campaign.points import Array, Bond, Friction, Springs, Wire, Yield, point_law
from campaign.reference import EPS, LOADS, RIGID, Answer, Norms

FLOORS = 10.0
"""So many times the estimated rounding error is still rounding."""
LEAST = 1e-10
"""Errors below this are rounding in any case: an iteration's own is not known to the reference."""
MISREAD = 10.0
"""Jumps of an iterate, which are those of its laws, may be so much further from its displacements."""
NOISE = 30.0
"""Displacements of so many rounding errors of those of connected parts are none."""
QUIET = 1e-9
"""A step is compared with this fraction of the part's largest step at least."""
HELD = 1e-4
"""The displacement of faces is compared with this fraction of the largest one of the part at least."""
SCATTER = 1e-6
"""A scatter below this fraction of the part's mean is none, and is compared with the mean."""
SLACK = 1.0 + 1e-6
"""What laws allow is widened by this, so that no rounding denies an answer."""
INFEASIBLE = 2
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
    reach = max(float(np.abs(u).max(initial=0.0)) for answer in answers for u in answer.fields.values())
    for k, answer in enumerate(answers):
        for name, parts in norms.components.items():
            for g, group in enumerate(groups):
                sizes[name, k, g] = norms.over(parts, {p: answer.fields[p][:, group] for p in parts})
    for k, answer in enumerate(answers):
        for name, parts in norms.components.items():
            faces = sum(norms.on_faces[p].diagonal().sum() for p in parts)
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
    reach = max(float(np.abs(u).max(initial=0.0)) for answer in answers for u in answer.fields.values())
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
            + EPS * 10.0 * reach
            * np.sqrt([norms.stiffness[p].diagonal().sum(), norms.on_faces[p].diagonal().sum()])
            for p in parts
        )
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


def rounding(problem: Any, fields: Mapping[str, Array]) -> tuple[float, float]:
    """What rounding does to displacements and to forces of the scene: it passes from part to part."""
    moved = max(float(np.abs(u).max(initial=0.0)) for u in fields.values())
    parts = problem.substructures.items()
    terms = max(float((abs(part.matrix) @ np.abs(fields[name]).ravel()).sum()) for name, part in parts)
    return NOISE * EPS * moved, NOISE * EPS * terms


def broken_laws(
    problem: Any,
    laws: Mapping[str, Any],
    forces: Mapping[str, tuple[Array, Array]],
    fields: Mapping[str, Array],
    time: float | None = None,
    memory: dict[str, Any] | None = None,
) -> dict[str, float]:
    """How far forces and jumps are from the laws of their interfaces, and jumps from displacements, relative.

    A force f and a jump j hold a law if f is what its resolvent R gives of z = j + c f, whatever c is:
    complementarity, cone, slip along the force and the memory of what came before are all in it. Here c is
    the interface's displacement over its force, so that what is left of f - R(z) is relative to both; where
    there is no force, over the largest of the scene.

    Parameters
    ----------
    forces
        Interface -> force and jump (m, components) of the result.
    fields
        Part -> displacements (n, 1).
    time, memory
        Of a step, and what the laws remember of those before; this one is added.
    """
    out = {}
    memory = {} if memory is None else memory
    of_motion, of_forces = rounding(problem, fields)
    reach = max(float(np.abs(u).max(initial=0.0)) for u in fields.values())
    weights = {name: problem.interfaces[name].weights for name in forces}
    pressures = [
        float(np.sqrt(weights[n] @ np.sum(f**2, axis=1) / weights[n].sum())) for n, (f, _) in forces.items()
    ]
    for name, (force, jump) in forces.items():
        if isinstance(laws[name], RIGID + LOADS):
            continue
        interface = problem.interfaces[name]
        point = point_law(interface, laws[name], time, memory.get(name))
        k, w, d = point.components, interface.weights, interface.dim
        f, j = force[:, :k], jump[:, :k]

        def norm(values: Array, w: Array = w) -> float:
            return float(np.sqrt(w @ np.sum(values.reshape(len(w), -1) ** 2, axis=1)))

        moved = [side.shape @ fields[side.substructure].reshape(-1, d) for side in interface.sides]
        gap = getattr(point, "gap", np.zeros(len(w)))
        relative = moved[-1] - moved[0] if len(moved) == 2 else -moved[0]
        seen = np.einsum("mkd,md->mk", frames_of(interface, laws[name], k), relative.reshape(len(w), d))
        apart = norm(seen - j)
        area = float(np.sqrt(w.sum()))
        far = max(*map(norm, (*moved, gap)), of_motion * area, np.finfo(np.float64).tiny)
        size = norm(f)
        if not size > of_forces / area:
            size = max(area * max(pressures), of_forces / area, np.finfo(np.float64).tiny)
        c = np.full(f.shape, far / size)
        if hasattr(point, "flexibility"):
            c = point.flexibility(c)
        left = f - point.resolve(j + c * f, c)[0]
        if not (norm(left) <= of_forces / area or norm(c * left) <= of_motion * area):
            out[name] = norm(left) / max(size, far / float(c.max()))
        if apart > of_motion * area:
            out[name] = max(out.get(name, 0.0), apart / (MISREAD * reach * area))
        memory[name] = point.remember(j, f)
    return out


def frames_of(interface: Any, law: Any, components: int) -> Array:
    """Directions (m, components, d) of the components of an interface's force."""
    d = interface.dim
    if isinstance(law, lf.Displacement):
        axes = list(range(d) if law.components is None else law.components)
        return np.broadcast_to(np.eye(d)[axes], (interface.num_points, len(axes), d))
    return interface.frames[:, :components]


def nodal(interface: Any, law: Any, force: Array) -> list[Array]:
    """Nodal forces (nodes of the part, d) of an interface on its sides; its force is (m, components)."""
    frames = frames_of(interface, law, force.shape[1])
    at_points = interface.weights[:, None] * np.einsum("mk,mkd->md", force, frames)
    signs = zip(interface.sides, (1.0, -1.0), strict=False)
    return [sign * (side.shape.T @ at_points) for side, sign in signs]


def allowed_forces(interface: Any, law: Any, time: float | None) -> tuple[Array, Array, Array, Array]:
    """Bounds (m, k) of the components of a force that a law allows, and friction mu and threshold (m,)."""
    m, d = interface.num_points, interface.dim
    free, none = np.full((m, d), np.inf), np.zeros(m)
    if isinstance(law, RIGID):
        k = 1 if isinstance(law, lf.Symmetry) else d
        if isinstance(law, lf.Displacement) and law.components is not None:
            k = len(law.components)
        return -free[:, :k], free[:, :k], none, none
    point = point_law(interface, law, time, None)
    low, high, mu, tau = -free[:, : point.components], free[:, : point.components].copy(), none, none
    if isinstance(point, Springs):
        low, high = np.where(point.kappa > 0.0, low, 0.0), np.where(point.kappa > 0.0, high, 0.0)
    elif isinstance(point, Friction):
        high[:, 0], mu, tau = 0.0, SLACK * point.mu, SLACK * point.tau
    elif isinstance(point, Bond):
        high[:, 0] = SLACK * point.strength
    elif isinstance(point, Wire):
        low = np.zeros_like(low)
    elif isinstance(point, Yield):
        low, high = -SLACK * point.limit[:, None], SLACK * point.limit[:, None]
    return low, high, mu, tau


def has_balance(
    problem: Any, laws: Mapping[str, Any], loads: Mapping[str, Array], time: float | None
) -> bool:
    """Whether forces that the laws allow balance the loads (n,) of all parts: if not, there is no answer.

    A linear programme for the resultants; in 3D an octagon stands around friction's circle.
    """
    parts = problem.substructures
    ends = np.cumsum([0, *(part.rigid_modes.shape[1] for part in parts.values())])
    places = {name: slice(*ends[k : k + 2]) for k, name in enumerate(parts)}
    right = -np.concatenate([part.rigid_modes.T @ loads[name] for name, part in parts.items()])
    largest = float(np.abs(right).max(initial=0.0))
    if largest == 0.0:
        return True
    acts, bounds, cones, most = [], [], [], []
    for name, interface in problem.interfaces.items():
        if isinstance(laws[name], LOADS):
            continue
        low, high, mu, tau = allowed_forces(interface, laws[name], time)
        (m, k), d = low.shape, interface.dim
        share = interface.weights / largest
        bounds += zip((share[:, None] * low).ravel(), (share[:, None] * high).ravel(), strict=True)
        act = np.zeros((ends[-1], m, k))
        frames = frames_of(interface, laws[name], k)
        for side, sign in zip(interface.sides, (1.0, -1.0), strict=False):
            modes = parts[side.substructure].rigid_modes
            moved = (side.shape @ modes.reshape(-1, d * modes.shape[1])).reshape(m, d, -1)
            act[places[side.substructure]] += sign * np.einsum("mdr,mkd->rmk", moved, frames)
        acts.append(act.reshape(ends[-1], -1))
        cone = [sp.csr_matrix((0, m * k))]
        if isinstance(laws[name], lf.Contact) and k > 1:
            corners = np.arange(2) if k == 2 else np.arange(8) / 4
            for angle in np.pi * corners:
                along = np.array([0.0, np.cos(angle), np.sin(angle)])[:k]
                first = sp.csr_matrix(np.eye(1, k))
                cone.append(sp.kron(sp.diags(mu), first) + sp.kron(sp.eye(m), sp.csr_matrix(along)))
                most.append(share * tau)
        cones.append(sp.vstack(cone))
    A, cone = np.hstack(acts), sp.block_diag(cones)
    limits = {"A_ub": cone, "b_ub": np.concatenate(most)} if most else {}
    found = linprog(np.zeros(A.shape[1]), A_eq=A, b_eq=right / largest, bounds=bounds, **limits)
    return bool(found.status != INFEASIBLE)


def unbalanced(
    problem: Any,
    laws: Mapping[str, Any],
    forces: Mapping[str, Array],
    loads: Mapping[str, Array],
    fields: Mapping[str, Array],
) -> dict[str, float]:
    """Resultants that are left over on every part whose forces are all known, relative to all that act on it.

    Parameters
    ----------
    forces
        Interface -> force (m, components); those that are missing are not known.
    loads
        Part -> nodal forces (n,) that are given.
    fields
        Part -> displacements (n, 1).
    """
    _, of_forces = rounding(problem, fields)
    left: dict[str, Any] = {name: [load] for name, load in loads.items()}
    for name, interface in problem.interfaces.items():
        if isinstance(laws[name], LOADS):
            continue
        known = nodal(interface, laws[name], forces[name]) if name in forces else None
        for i, side in enumerate(interface.sides):
            acts = left[side.substructure]
            if acts is not None and known is not None:
                acts.append(known[i].ravel())
            else:
                left[side.substructure] = None
    out = {}
    for name, acts in left.items():
        if acts is None:
            continue
        modes = problem.substructures[name].rigid_modes
        over = float(np.abs(modes.T @ np.sum(acts, axis=0)).max())
        if not over <= of_forces:
            out[name] = over / max(float(np.abs(act).sum()) for act in acts)
    return out
