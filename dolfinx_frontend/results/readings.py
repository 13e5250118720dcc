"""An answer as a mechanical engineer reads it: resultants, pressures, areas, bolt forces.

Signs: `force` and `moment` are what the interface exerts on its side 1, in global axes; the pressure is
-f_n, positive where the sides press on each other; `normal` is the total of f_n, positive in tension (the
force of a bolt); moments are about the centroid of the interface unless a point is given.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import check_known, checked_names, checked_numbers
from dolfinx_frontend.common.errors import SceneError, unknown_name
from dolfinx_frontend.common.frozen import locked
from dolfinx_frontend.results.answer import Answer, Block, Surface, chunks, stepped
from dolfinx_frontend.results.contact import DAMAGED, contact_states
from dolfinx_frontend.results.reactions import Reaction, reaction
from dolfinx_frontend.uncertainty.quantities import Kind

__all__ = ["Measures", "Readings", "column_of", "known_interfaces", "matched", "measure", "read"]

SHARED = "eliminated, shares nodes with another support or glued face (solve with active=[...] to have it)"
ROUNDED = 1e-14
"""Products of unit vectors up to this are those of orthogonal ones."""
SQUARED = 1e150
"""Forces above it are scaled before they are squared."""
OF_FRICTION = ("slip_area", "slip_use", "slip", "slip_share", "slip_safety")
OF_CONTACT = ("open_area", *OF_FRICTION)
"""Columns of the table that only contacts have."""
OF_BONDS = ("damage", "damaged_share", "broken_share")
"""Columns of the table that only bonds have."""
UNLOADED = 1e-5
"""What acts along an interface below so much of the limit of friction is nothing."""
ACROSS = 1e-2
"""Share (of the square) of a motion along the normals up to which it slides: facets stand for round faces."""
PLANE = 1e-9
"""Normals within this of each other are those of a plane."""


@dataclass(frozen=True)
class Measures:
    """Numbers of one interface, each ([N,] [T]): a number per sample and time step.

    Attributes
    ----------
    centre
        (d,), centroid of the interface, about which the moments are.
    values
        Column of the table -> numbers; NaN where the law has no such thing.
    law
        Name of its law.
    bolt
        The step that ends the tightening if the interface is a bolt in a load history, else None.
    """

    centre: Array
    values: dict[str, Array]
    law: str
    bolt: int | None = None

    def __post_init__(self) -> None:
        locked(self)

    def about(self, point: npt.ArrayLike | None) -> dict[str, Array]:
        """The numbers with moments about a point (d,); None: the centroid."""
        if point is None:
            return self.values
        d = len(self.centre)
        wanted = f"give a point of {d} coordinates"
        to = checked_numbers("table", "about", point, wanted, dimensions=1)
        if to.shape != (d,):
            raise SceneError(f"table: about = {point!r}; {wanted}")
        force = [self.values[f"force_{a}"] for a in "xyz"[:d]]
        values = dict(self.values)
        for name, share in _cross(self.centre - to, force).items():
            values[name] = values[name] + share
        return values


@dataclass(frozen=True)
class Readings:
    """Numbers of all interfaces of an answer, from which the tables are made.

    Attributes
    ----------
    interfaces
        Interface -> numbers.
    statistics
        How the samples are to be read; of a ``"value"`` the numbers have no axis of samples.
    times
        (T,) of a load history, or None.
    weights
        (N,) of a quadrature, or None.
    coordinates
        Of a sweep: swept parameters -> (N,) values.
    missing
        Interface -> why it has no row.
    """

    interfaces: dict[str, Measures]
    statistics: Kind = "value"
    times: Array | None = None
    weights: Array | None = None
    coordinates: Mapping[str, Array] = field(default_factory=dict)
    missing: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        locked(self)

    def select(self, names: Sequence[str] | str | None) -> Readings:
        """Some of the interfaces."""
        if names is None:
            return self
        given = [names] if isinstance(names, str) else names
        names = matched("table", names, [*self.interfaces, *self.missing])
        missing = {name: self.missing[name] for name in names if name in self.missing}
        for name in names:
            if name in missing and name in given:
                raise SceneError(f"table: interface {name!r}: {missing[name]}")
            check_known("interface", name, (*self.interfaces, *missing), "table")
        found = {n: self.interfaces[n] for n in names if n not in missing}
        return replace(self, interfaces=found, missing=missing)

    @property
    def random(self) -> bool:
        """Whether the samples are to be summed up by statistics."""
        return self.statistics not in ("value", "grid")


def _cross(arm: Any, force: Sequence[Array]) -> dict[str, Array]:
    """Moment of a force at an arm, by column name: about z in 2D."""
    if len(force) == 2:
        return {"moment_z": arm[0] * force[1] - arm[1] * force[0]}
    return {
        f"moment_{'xyz'[k]}": arm[i] * force[j] - arm[j] * force[i]
        for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1)))
    }


def _levers(points: Array, centre: Array) -> dict[str, Array]:
    """What a unit force along each axis at each point adds to force and moment: column -> (m, d)."""
    m, d = points.shape
    units: list[Array] = list(np.eye(d)[:, None])  # component a of all unit forces, (1, d)
    rows = {f"force_{'xyz'[a]}": np.repeat(unit, m, axis=0) for a, unit in enumerate(units)}
    return rows | _cross((points - centre).T[:, :, None], units)


def _summed(fields: Array, rows: Mapping[str, Array]) -> dict[str, Array]:
    """Sums of fields (..., m, k) times each of the rows (m, k) over points and components, (...) each."""
    matrix = np.stack([row.ravel() for row in rows.values()], axis=1)
    sums = fields.reshape(*fields.shape[:-2], -1) @ matrix
    return dict(zip(rows, np.moveaxis(sums, -1, 0), strict=True))


def _normal_and_shear(force: Array, out: Array, tangents: Array) -> tuple[Array, Array]:
    """Normal part (..., m) of forces (..., m, components), and size of the tangential one.

    Component by component, because many samples lie side by side in memory; those of local frames are normal
    or tangential, so that most products are nothing.
    """
    size = max(force.max(initial=0.0), -force.min(initial=0.0))
    if SQUARED < size < np.inf:
        normal, shear = _normal_and_shear(force / size, out, tangents)
        return size * normal, size * shear
    each = [force[..., c] for c in range(force.shape[-1])]
    normal, square = np.zeros(force.shape[:-1]), np.zeros(force.shape[:-1])
    for c, f in enumerate(each):
        if np.abs(out[:, c]).max() > ROUNDED:
            normal = normal + f * out[:, c]
    gram = np.einsum("pcd,ped->pce", tangents, tangents)
    if np.abs(gram - gram * np.eye(len(each))).max() <= ROUNDED:
        for c, f in enumerate(each):
            if gram[:, c, c].max() > ROUNDED:
                square = square + gram[:, c, c] * f * f
    else:
        for axis in range(tangents.shape[2]):
            square = square + sum(f * tangents[:, c, axis] for c, f in enumerate(each)) ** 2
    return normal, np.sqrt(square)


def _motions(surface: Surface) -> Array:
    """Rigid motions along an interface, (k, m, d), of mean size 1: in a plane two translations and a rotation
    about the centroid, on a cylinder along and around its axis, on most faces none."""
    roots, places = np.sqrt(surface.weights / surface.area), surface.acting[0] - surface.centre
    d, size = surface.dim, np.sqrt(np.mean(places**2)) or 1.0
    turns = [np.cross(axis, places) if d == 3 else np.column_stack([-places[:, 1], places[:, 0]])
             for axis in np.eye(3)[: 3 if d == 3 else 1]]
    rigid = np.stack([*np.broadcast_to(np.eye(d)[:, None], (d, *places.shape)), *np.array(turns) / size])

    def along(motions: Array) -> Array:
        """Orthonormal ones (m d, k) without a normal part."""
        columns = (roots[:, None] * motions).reshape(len(motions), -1).T
        q, sizes, _ = np.linalg.svd(columns, full_matrices=False)
        q = q[:, sizes > PLANE * sizes[0]]
        across = np.einsum("pdk,pd->pk", q.reshape(*places.shape, -1), surface.normals)
        shares, found = np.linalg.eigh(across.T @ across)
        return np.asarray(q @ found[:, shares < ACROSS])

    moved = along(rigid[:d])
    every = along(rigid)
    rest, sizes, _ = np.linalg.svd(every - moved @ (moved.T @ every), full_matrices=False)
    chosen = np.column_stack([moved, rest[:, sizes > 0.5]])
    return np.asarray(chosen.T.reshape(-1, *places.shape) / roots[:, None])


def _safety(surface: Surface, force: Array, tangents: Array, limit: Array) -> Array:
    """Friction over what acts along the interface, (...,): forces and moments in an ellipse; NaN: it cannot
    slide as a whole. `limit` (..., m) is that of each point per area."""
    motions = _motions(surface)
    if not len(motions):
        return np.full(limit.shape[:-1], np.nan)
    weights = surface.weights
    rows = {str(k): weights[:, None] * np.einsum("pcd,pd->pc", tangents, v) for k, v in enumerate(motions)}
    acts = _summed(force, rows)
    used = np.zeros(limit.shape[:-1])
    for k, motion in enumerate(motions):
        carries = limit @ (weights * np.linalg.norm(motion, axis=1))
        used = used + np.divide(acts[str(k)], carries, out=np.zeros_like(used), where=carries > 0.0) ** 2
    used = np.sqrt(used)
    return np.divide(1.0, used, out=np.full_like(used, np.inf), where=used > UNLOADED)


def _slipping(
    weights: Array, normal: Array, shear: Array, limits: tuple[Array, Array], slipped: Array | None
) -> dict[str, Array]:
    """Columns of friction: of forces (..., m), and how far each point has slipped (..., m), length."""
    open_, slips = contact_states(normal, shear, limits)
    limit = (limits[0] * np.abs(normal) + limits[1]) * ~open_ @ weights
    used, closed, at_limit = (shear * ~open_) @ weights, ~open_ @ weights, slips @ weights
    if slipped is not None:  # by more than the rounding of places
        slipped = slipped * (slipped > ROUNDED * np.sqrt(weights.sum()))

    def share(one: Array, of: Array) -> Array:
        return np.divide(one, of, out=np.zeros_like(of), where=of > 0.0)

    return {
        "slip_area": at_limit,
        "slip_use": share(used, limit),
        "slip": np.full_like(limit, np.nan) if slipped is None else (slipped * ~open_).max(axis=-1),
        "slip_share": share(at_limit, closed),
    }


def measure(
    surface: Surface,
    force: Array,
    limits: tuple[Array, Array] | None = None,
    jump: Array | None = None,
    damage: Array | None = None,
) -> dict[str, Array]:
    """Numbers of an interface from its force per area.

    Parameters
    ----------
    force
        (..., m, components), in the frames of its law.
    limits
        Friction coefficient and threshold, each broadcast to (..., m); None: no friction.
    jump
        As the force, length; None: not known.
    damage
        (..., m) of a bond; None: it is none.

    Returns
    -------
    dict
        Column -> (...,).
    """
    weights, frames = surface.weights, surface.frames
    out = np.einsum("pcd,pd->pc", frames, surface.normals)  # what each component pushes out of side 1
    tangents = frames - out[:, :, None] * surface.normals[:, None]
    axes = {"xyz"[a]: tangents[:, :, a] for a in range(surface.dim)}
    places, acting = surface.acting
    rows = {c: np.einsum("pcd,pd->pc", acting, r) for c, r in _levers(places, surface.centre).items()}
    if surface.wrench is not None:
        first = np.eye(1, len(out[0]))
        rows = {c: value * first for c, value in zip(rows, surface.wrench, strict=True)}
    rows |= {"normal": out} | axes
    sums = _summed(force, {column: weights[:, None] * row for column, row in rows.items()})
    values = {"area": np.full(force.shape[:-2], weights.sum())}
    values |= {column: sum_ for column, sum_ in sums.items() if column not in axes}
    values["shear"] = np.hypot.reduce([sums[axis] for axis in axes], axis=0)
    normal, shear = _normal_and_shear(force, out, tangents)
    values["pressure_min"] = -normal.max(axis=-1)
    values["pressure_mean"] = -values["normal"] / weights.sum()
    values["pressure_max"] = -normal.min(axis=-1)
    values["shear_max"] = shear.max(axis=-1)
    nothing = np.full(force.shape[:-2], np.nan)
    values |= dict.fromkeys((*OF_CONTACT, *OF_BONDS), nothing)
    if damage is not None:
        shares = weights / weights.sum()
        values["damage"] = damage.max(axis=-1)
        values["damaged_share"] = (damage > DAMAGED) @ shares
        values["broken_share"] = (damage > 1.0 - DAMAGED) @ shares
    if surface.contact:
        values["open_area"] = contact_states(normal, shear, None)[0] @ weights
        if limits is not None:
            slipped = None if jump is None else _normal_and_shear(jump, out, tangents)[1]
            values |= _slipping(weights, normal, shear, limits, slipped)
            closed = ~contact_states(normal, shear, None)[0]
            limit = (limits[0] * np.abs(normal) + limits[1]) * closed
            values["slip_safety"] = _safety(surface, force, tangents, limit)
    return values


def _measured(
    answer: Answer, name: str, blocks: Sequence[Block], column: str | None = None
) -> dict[str, Array]:
    """Numbers (N, T) of an interface whose force is known at its points; of one `column` what that takes."""
    surface, given = answer.surface(name), answer.load(name)
    if given is not None:  # the same in all samples
        values = measure(surface, stepped(given, answer.times)[None])
        count = sum(len(block) for block in blocks)
        return {column: np.broadcast_to(v, (count, *v.shape[1:])) for column, v in values.items()}
    found = []
    for block in blocks:
        force = stepped(block.force(name), answer.times, 1)
        of_contact, of_bond = (column in (None, *each) for each in (OF_FRICTION, OF_BONDS))
        contact = block.contact(name) if of_contact and surface.contact else None
        bond = block.bond(name) if of_bond and not surface.contact else None
        rubs = contact is not None and contact.limits is not None
        jump = stepped(block.jump(name), answer.times, 1) if rubs or bond else None
        # the fields of a block are in memory already; what is computed from them is done in parts
        for part in chunks(len(force), force[0].size):
            limits = None if contact is None else contact[part].limits
            moved = None if jump is None else jump[part]
            damage = bond[part].damage(force[part], moved) if bond and moved is not None else None
            found.append(measure(surface, force[part], limits, moved, damage))
    return {column: np.concatenate([each[column] for each in found]) for column in found[0]}


def _balanced(answer: Answer, name: str, blocks: Sequence[Block]) -> dict[str, Array] | None:
    """Numbers (N, T) of an interface that was assembled across, if it has any; on the rank of its parts."""
    held = reaction(answer, name)
    return None if held is None else _reacted(answer.surface(name), held, blocks)


def _reacted(surface: Surface, held: Reaction, blocks: Sequence[Block]) -> dict[str, Array]:
    """Numbers (N, T) of an interface that was assembled across: its resultants."""
    levers = _levers(held.points, surface.centre)
    found = [_summed(held.forces(block), levers) for block in blocks]
    resultants = {column: np.concatenate([each[column] for each in found]) for column in found[0]}
    shape = resultants["force_x"].shape
    nothing = np.full(shape, np.nan)
    rest = (
        "normal", "shear", "pressure_min", "pressure_mean", "pressure_max", "shear_max", *OF_CONTACT,
        *OF_BONDS,
    )  # fmt: skip
    values = {"area": np.full(shape, surface.area)} | resultants | dict.fromkeys(rest, nothing)
    normal = surface.normals[0]
    if np.all(np.abs(surface.normals - normal) < PLANE):  # its total is that of the resultant
        vector = np.stack([resultants[f"force_{a}"] for a in "xyz"[: surface.dim]], axis=-1)
        along = vector @ normal
        values["normal"] = along
        values["shear"] = np.hypot.reduce(vector - along[..., None] * normal, axis=-1)
        values["pressure_mean"] = -along / surface.area
    return values


def column_of(answer: Answer, text: str, step: int = -1) -> Callable[[Block], Array]:
    """A number of the tables as a function of samples: ``"joint.pressure_min"``, ``"bolt.axial.normal"``.

    Raises
    ------
    SceneError
        An interface or a column that there is not, or that can have no number.
    """
    name, _, column = text.rpartition(".")
    where = f"quantity {text!r}"
    check_known("interface", name, answer.problem.interfaces, where)
    surface = answer.surface(name)
    held: list[Reaction | None] = []  # on the rank of the parts

    def is_held() -> bool:
        held.append(reaction(answer, name))
        return held[0] is not None

    if name not in answer.known:
        why = answer.why_unknown(name)
        if why is not None or not answer.everywhere(name, is_held):
            raise SceneError(f"{where}: interface {name!r}: {why or SHARED}")

    def read(block: Block) -> dict[str, Array]:
        if held and held[0]:
            return _reacted(surface, held[0], [block])
        return _measured(answer, name, [block], column)

    def number(block: Block) -> Array:
        values = answer.everywhere(name, partial(read, block))
        check_known("column", column, values, where)
        found: Array = values[column][:, step]
        if np.all(np.isnan(found)):
            raise SceneError(f"{where}: the law of {name!r}, {surface.law}, has no {column}")
        return found

    return number


def known_interfaces(
    answer: Answer, wanted: Sequence[str] | str | None, where: str
) -> list[str]:
    """The wanted interfaces (None: all), whose force is known at their points."""
    if wanted is None:
        return list(answer.known)
    chosen = matched(where, wanted, answer.known)
    for name in chosen:
        check_known("interface with a known force", name, answer.known, where)
    return chosen


def matched(where: str, wanted: Sequence[str] | str, known: Sequence[str]) -> list[str]:
    """Names that were given; one with ``*`` or ``?`` stands for all the known ones that it fits.

    Raises
    ------
    SceneError
        A pattern that none fits. Names are not checked.
    """
    given = [wanted] if isinstance(wanted, str) else checked_names(where, "interfaces", wanted)
    found: dict[str, None] = {}
    for each in given:
        if each in known or not set(each) & set("*?"):
            found[each] = None
            continue
        form = re.compile("".join({"*": ".*", "?": "."}.get(c, re.escape(c)) for c in each), re.DOTALL)
        fits = [name for name in known if form.fullmatch(name)]
        if not fits:
            raise unknown_name("interface", each, known, where)
        found |= dict.fromkeys(fits)
    return list(found)


def read(
    answer: Answer,
    interfaces: Sequence[str] | str | None = None,
    samples: int | None = None,
    seed: int = 0,
) -> Readings:
    """Numbers of interfaces of any answer; collective on several ranks.

    Parameters
    ----------
    interfaces
        Names; None: all.
    samples, seed
        Of a chaos: at this many random samples.

    Raises
    ------
    SceneError
        An interface by name that there is not, or that can have no row.
    """
    every, times = answer.problem.interfaces, answer.times
    wanted = every if interfaces is None else interfaces
    chosen = matched("table", list(wanted) if interfaces is None else wanted, list(every))
    for name in chosen:
        check_known("interface", name, every, "table")
    blocks = list(answer.blocks(samples, seed))
    found: dict[str, Measures] = {}
    missing: dict[str, str] = {}
    for name in chosen:
        surface = answer.surface(name)
        if name in answer.known:
            values = answer.everywhere(name, partial(_measured, answer, name, blocks))
        else:
            why = answer.why_unknown(name)
            balanced = None if why else answer.everywhere(name, partial(_balanced, answer, name, blocks))
            if balanced is None:
                missing[name] = why or SHARED
                continue
            values = balanced
        if times is None:
            values = {column: v[:, 0] for column, v in values.items()}
        if answer.statistics == "value":
            values = {column: v[0] for column, v in values.items()}
        found[name] = Measures(surface.centre, values, surface.law, surface.bolt)
    for name, why in missing.items():
        if interfaces is not None and name in ([interfaces] if isinstance(interfaces, str) else interfaces):
            raise SceneError(f"table: interface {name!r}: {why}")
    weights = [block.weights for block in blocks if block.weights is not None]
    of_rule = np.concatenate(weights) if weights else None
    return Readings(found, answer.statistics, times, of_rule, answer.coordinates, missing)
