"""Where meshes must become finer for an accuracy, and how each part can.

A part whose geometry is known (:attr:`Part.again`) is meshed again with the sizes that its estimate wants;
triangles and tetrahedra are cut, quadrilaterals and hexahedra raised in degree, then all cut.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import ufl
from basix.ufl import element
from ufl.domain import extract_domains

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import agreement
from dolfinx_frontend.assembly.taken import on_one_rank, spread_over
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.checks import is_real
from dolfinx_frontend.common.compat import coordinate_map
from dolfinx_frontend.common.deferred import spatial
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.interrupts import stop_if_pressed
from dolfinx_frontend.estimate.cells import Cells
from dolfinx_frontend.geometry.finer import (
    SIMPLICES,
    Model,
    OfModel,
    bisected,
    cell_sizes,
    halved,
    size_field,
)
from dolfinx_frontend.geometry.parts import Part
from dolfinx_frontend.geometry.sizes import SizeField
from dolfinx_frontend.scene.materials import LinearElastic, OrthotropicElastic
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.scene.specs import SubstructureSpec
from dolfinx_frontend.scene.values import is_random_field

__all__ = ["MOST_DEGREE", "Finer", "finer"]

MOST_DEGREE, MOST_WITH_FIELD = 3, 2
"""Highest degree, and that of a part whose stiffness is a random field."""

ORDER = 3.0
"""Power of the size that contributions are taken to fall with: less than smooth ones do, as those at corners
and edges decide."""

GROWTH = {2: 5.0, 3: 4.0}
"""Cells of a part grow by about this factor in one step at most, by dimension: sizes follow from estimates,
which are the worse the coarser the mesh is."""

SMALLER = 0.6
"""Size of the cells of a part whose shape is in doubt, relative to those before."""

ROUNDER = 0.75
"""The same of curved cells whose degree is raised, too: their shape is better by its fourth power, 0.3."""

MANY = 0.06
"""Share of the cells of a part of which it is said that they are many."""

CLOSURE = 1.2
"""Cells of a finer mesh over those that sizes ask for: neighbours follow."""

SAME_COUNT, SAME_FROM = 1.2, 0.6
"""Size that gives a coarse model about as many cells again, relative to what they have, and the relative size
from which on none is needed (measured with the vessel: 2.1 times the cells otherwise, and 1.05 times as many
as were asked for). Parts alone are meshed again for cells that they need, in contact zones above all."""

FORESEEN = 1.2
"""Unknowns foreseen from sizes over those that are too many, from which on no mesh is made to see."""

LEFT_ALONE = 0.5
"""Parts keep their meshes while together they contribute at most this share of what may be left."""

SMALLEST, LARGEST = 0.15, 1.25
"""Sizes of one step, relative to those before."""

UNWEIGHTED = 0.02
"""The same where contributions are of the energy, for a number that has no dual problem."""

WORTH = 0.7
"""A part keeps its mesh if no cell is to become smaller than this, relative to what it is."""

HALF = 0.5
"""If that were so of all parts, the cell that decides most is to have this size."""


@dataclass(frozen=True)
class Finer:
    """New meshes of some parts.

    Attributes
    ----------
    specs
        Part -> what it is now.
    how
        Part -> what was done, in words.
    stuck
        Parts that should have become finer and cannot, and why.
    growth
        Part -> number of its new unknowns, about, over that of the old ones.
    too_large
        Unknowns that there would be, where these are more than were allowed: then nothing is meshed.
    """

    specs: dict[str, SubstructureSpec]
    how: dict[str, str]
    stuck: dict[str, str]
    growth: dict[str, float]
    too_large: float = 0.0


def finer(
    scene: Scene,
    problem: Problem,
    meshes: Mapping[str, Cells],
    cells: Mapping[str, Array],
    fall: float,
    edges: Mapping[str, Array],
    unseen: Collection[str] = (),
    means: Collection[str] = (),
    most: float = np.inf,
    read: Mapping[str, Ints | slice] = MappingProxyType({}),
    cut: Collection[str] = (),
    weighted: bool = True,
) -> Finer:
    """Finer meshes of those parts that decide; collective: a part is meshed on its rank, and all ranks know
    what was done.

    Parameters
    ----------
    meshes
        Part -> the cells that it has.
    cells
        Part -> (cells,), what each contributes, in any unit.
    fall
        Factor by which their sum is to fall, < 1.
    edges
        Interface -> places (k, d) beside which cells are halved in any case: edges of contact zones.
    unseen
        Parts that get smaller cells everywhere in any case: what is wrong with their shape nothing tells.
    means
        Interfaces whose cells are halved if a part beside decides: what their means leave out nothing tells.
    most
        Unknowns of all parts, about, above which nothing is meshed.
    read
        Parts that a number is read from -> their cells that are halved in any case.
    cut
        Parts that get smaller cells, not a higher degree.
    weighted
        Whether contributions are of the number that is asked for.
    """
    most_alone = LEFT_ALONE * fall if weighted else UNWEIGHTED
    sums = {name: float(each.sum()) for name, each in cells.items()}
    total = sum(sums.values())
    left, alone = 0.0, []
    # those first whose finer meshes would cost most for what they bring
    for name in sorted(sums, key=lambda n: sums[n] / problem.unknowns[n]):
        if name in read:
            continue
        if left + sums[name] > most_alone * total:
            break
        left += sums[name]
        alone.append(name)
    touched = [name for name in cells if name not in alone]
    ratios = _ratios(problem.dim, {n: cells[n] for n in touched}, fall * total - left)
    for name in unseen:
        ratios[name] = np.minimum(ratios.get(name, np.ones(len(cells[name]))), SMALLER)
    for name, where in read.items():
        each = ratios.setdefault(name, np.ones(len(cells[name])))
        each[where] = np.minimum(each[where], HALF)
    ratios = {name: each for name, each in ratios.items() if each.size}  # a matrix has no cells
    least = min((float(each.min()) for each in ratios.values()), default=1.0)
    if least > WORTH:
        ratios = {name: each * (HALF / least) for name, each in ratios.items()}
    # a higher degree leaves the points of interfaces as they are, and with them what these do not see
    at_edges = set(cut)
    beside_touched = {
        name: problem.interfaces[name].points
        for name in means
        if any(side.substructure in touched for side in problem.interfaces[name].sides)
    }
    for name, places in (beside_touched | dict(edges)).items():
        for number, side in enumerate(problem.interfaces[name].sides):
            if side.face not in meshes[side.substructure].faces:  # nodes
                continue
            # smaller cells of the side with the points show what the edge does; the other may be raised
            if number == 0 or name not in edges or problem.dim == 2:
                at_edges.add(side.substructure)
            if not len(cells[side.substructure]):
                continue
            each = ratios.setdefault(side.substructure, np.ones(len(cells[side.substructure])))
            beside, at = meshes[side.substructure].faces[side.face]
            size = meshes[side.substructure].sizes[beside]
            distance, _ = spatial.cKDTree(places).query(at)
            near = beside[distance <= 1.5 * size]
            each[near] = np.minimum(each[near], 0.5)
    _as_fine_as_the_other_side(problem, meshes, ratios)
    facing = _facing_matrices(scene)
    models = {name: first for name, first in _models(scene, problem).items() if name not in facing}
    wanted = {name: ratio for name, ratio in ratios.items() if not ratio.min() > WORTH}
    raised = {
        name
        for name, ratio in wanted.items()
        if name not in at_edges
        and scene.substructures[name].degree < _most_degree(scene.substructures[name])
        and (name not in unseen or name in models)
        and _better_raised(problem.dim, scene.substructures[name].degree, cells[name], ratio)
    }
    raised |= _with_their_models(scene, models, wanted, raised, at_edges | set(unseen))
    about = _about(scene, problem, wanted, raised)
    if about > FORESEEN * most:
        return Finer({}, {}, {}, {}, too_large=about)
    made: dict[str, tuple[SubstructureSpec, str]] = {}
    stuck: dict[str, str] = {}
    asked: dict[str, str] = {}
    on_ranks: dict[str, str] = {}
    with agreement(problem.comm):
        for name, ratio in wanted.items():
            stop_if_pressed()
            spec = scene.substructures[name]
            if not (name in problem.own.substructures or spec.spread):
                continue
            way, how = _way(spec, name in raised, name in at_edges)
            try:
                if way is None:
                    stuck[name] = how
                elif way == "cells" and name in facing:
                    stuck[name] = "its nodes are points of a matrix, which cannot follow them"
                elif way == "degree":
                    made[name] = replace(spec, degree=spec.degree + 1), how
                elif spec.spread:
                    on_ranks[name] = how
                elif name not in models:
                    made[name] = _meshed(spec, ratio, how)
            except SceneError as error:
                stuck[name] = str(error).splitlines()[0]
            # a higher degree does not change the shape
            if name in models and (way == "cells" or (name in unseen and name in made)):
                asked[name] = models[name]
    for name, how in on_ranks.items():
        try:
            owner = problem.spread[name].owner
            made[name] = _meshed_on_ranks(scene.substructures[name], owner, wanted[name], how)
        except SceneError as error:
            stuck[name] = str(error).splitlines()[0]
    again = set(problem.gather(asked, parts=True).values())
    _meshed_together(scene, problem, {n: m for n, m in models.items() if m in again}, ratios, unseen, made)
    own = {name: _Done(why) for name, why in stuck.items()}
    for name, (new, how) in made.items():
        spec = scene.substructures[name]
        growth = _count(new) / _count(spec) * (new.degree / spec.degree) ** spec.dim
        own[name] = _Done(how, new.degree, growth)
    found = Finer({}, {}, {}, {})
    for name, done in problem.gather(own, parts=True).items():
        if done.degree is None:
            found.stuck[name] = done.how
            continue
        # of a part of another rank its degree is all that is known here
        spec = made[name][0] if name in made else replace(scene.substructures[name], degree=done.degree)
        found.specs[name], found.how[name], found.growth[name] = spec, done.how, done.growth
    return found


class _Done(NamedTuple):
    """What was done to a part, or, without a degree, why nothing was."""

    how: str
    degree: int | None = None
    growth: float = 1.0


def _sizes(mesh: Any, ratio: Array, count: float) -> SizeField:
    """Sizes for a mesh generator: where nothing is to change cells of the size of the present ones would be
    more of them, as a coarse mesh has its cells from its edges."""
    same = np.clip((ratio - SAME_FROM) / (1.0 - SAME_FROM), 0.0, 1.0)
    return size_field(mesh, cell_sizes(mesh) * ratio * (1.0 + (count - 1.0) * same))


def _models(scene: Scene, problem: Problem) -> dict[str, str]:
    """Part -> the first part of the model that it is meshed again with, if there is one; collective."""
    first: dict[Model, str] = {}
    own: dict[str, str] = {}
    with agreement(problem.comm):
        for name, spec in scene.substructures.items():
            again = None if spec.lazy else getattr(spec.part, "again", None)
            if isinstance(again, OfModel) and not spec.spread:
                key = first.setdefault(again.model, name)
                if name in problem.own.substructures and not _tied(spec):
                    own[name] = key
    return problem.gather(own, parts=True)


def _facing_matrices(scene: Scene) -> set[str]:
    """Parts of which a face is joined to points of a matrix, node by node."""
    found = set()
    for joint in scene.interfaces.values():
        parts = [face.substructure for face in joint.faces]
        if joint.remote is None and any(scene.substructures[name].matrix is not None for name in parts):
            found.update(parts)
    return found


def _about(scene: Scene, problem: Problem, wanted: Mapping[str, Array], raised: Collection[str]) -> float:
    """Unknowns that there will be, as far as sizes tell."""
    total = 0.0
    for name, size in problem.unknowns.items():
        degree, growth = scene.substructures[name].degree, 1.0
        if name in raised or (name in wanted and degree == 1):
            growth = ((degree + 1) / degree) ** problem.dim
        elif name in wanted:
            growth = float(np.mean(wanted[name] ** -problem.dim))
        total += size * growth
    return total


def _with_their_models(
    scene: Scene,
    models: Mapping[str, str],
    wanted: Collection[str],
    raised: Collection[str],
    smaller: Collection[str],
) -> set[str]:
    """Parts that get a higher degree as others of their model do: smaller cells of one would be new meshes of
    all, unless there are parts that need these in any case."""
    held = {models[name] for name in wanted if name in smaller and name in models}
    some = {models[name] for name in raised if name in models} - held
    low = [n for n in wanted if scene.substructures[n].degree < _most_degree(scene.substructures[n])]
    return {name for name in low if models.get(name) in some}


def _meshed_together(
    scene: Scene,
    problem: Problem,
    models: Mapping[str, str],
    ratios: Mapping[str, Array],
    unseen: Collection[str],
    made: dict[str, tuple[SubstructureSpec, str]],
) -> None:
    """All parts of models meshed again, put into `made`; those that get a higher degree keep their sizes, but
    for what their shape needs. Collective: a model is meshed on every rank that has parts of it."""
    fields: dict[str, tuple[str, list[SizeField]]] = {}
    here = [name for name in models if name in problem.own.substructures]
    with agreement(problem.comm):
        for name in here:
            ratio: Array | float = ratios.get(name, 1.0)
            if name in made:  # raised
                ratio = ROUNDER if name in unseen else 1.0
            # no cell gets larger: round faces that are coarse as they are must not fold
            spec = scene.substructures[name]
            each = np.minimum(ratio, np.ones(_count(spec)))
            # more cells fold less
            fields[name] = _of_model(spec).name, [_sizes(spec.part.mesh, each, c) for c in (SAME_COUNT, 1.0)]
    fields = problem.gather(fields, parts=True)
    with agreement(problem.comm):
        for key in dict.fromkeys(models[name] for name in here):
            members = [name for name in here if models[name] == key]
            model = _of_model(scene.substructures[members[0]]).model
            sizes = [{fields[n][0]: fields[n][1][k] for n in models if models[n] == key} for k in range(2)]
            specs = {n: made[n][0] if n in made else scene.substructures[n] for n in members}
            parts = _parts_of(model, specs, sizes)
            for name in members:
                spec = scene.substructures[name]
                if parts is not None:
                    new = replace(specs[name], source=parts[fields[name][0]])
                    how = f"{made[name][1]}, meshed again" if name in made else "meshed again"
                    made[name] = new, _told(how, new, spec)
                # cells that fold, as where sizes change fast around a hole: those that there are, cut
                elif name in ratios and name not in made and ratios[name].min() <= WORTH:
                    new = replace(spec, source=bisected(spec.part, ratios[name]))
                    made[name] = new, _told("cells cut", new, spec)


def _of_model(spec: SubstructureSpec) -> OfModel:
    again = getattr(spec.part, "again", None)
    assert isinstance(again, OfModel)
    return again


def _parts_of(
    model: Model, specs: Mapping[str, SubstructureSpec], sizes: Sequence[Mapping[str, SizeField]]
) -> dict[str, Part] | None:
    """The parts of a model with the first sizes with which it can be meshed; None: with none."""
    for each in sizes:
        try:
            parts = model.parts(each)
            for spec in specs.values():
                _check_same(spec, parts.get(_of_model(spec).name))
        except SceneError:
            continue
        return parts
    return None


def _count(spec: SubstructureSpec) -> int:
    topology = spec.part.mesh.topology
    return int(topology.index_map(topology.dim).size_global)


def _ratios(dim: int, cells: Mapping[str, Array], wanted: float) -> dict[str, Array]:
    """Part -> (cells,) sizes relative to those before that leave the sum `wanted` with the fewest cells.

    With a contribution eta of a cell that falls like size^(q + d), eta r^q is left of it by r^-d cells:
    fewest with r^(q + d) ~ 1 / eta.
    """
    floor = 1e-12 * max((float(each.max()) for each in cells.values()), default=0.0)

    def sizes(scale: float) -> dict[str, Array]:
        power = 1.0 / (ORDER + dim)
        return {
            n: np.clip((scale / np.maximum(each, floor)) ** power, SMALLEST, LARGEST)
            for n, each in cells.items()
        }

    def left(ratios: Mapping[str, Array]) -> float:
        return sum(float(cells[n] @ ratios[n] ** ORDER) for n in cells)

    if not floor > 0.0:
        return {n: np.ones(len(each)) for n, each in cells.items()}
    low, high = np.log(floor), np.log(1e14 * floor)
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if left(sizes(np.exp(middle))) > wanted else (middle, high)
    found = sizes(np.exp(low))
    for name, ratio in found.items():
        for _ in range(40):
            if float(np.sum(ratio**-dim)) <= GROWTH[dim] * len(ratio):
                break
            ratio = np.minimum(ratio * 1.05, LARGEST)
        found[name] = ratio
    return found


def _as_fine_as_the_other_side(
    problem: Problem, meshes: Mapping[str, Cells], ratios: dict[str, Array]
) -> None:
    """Where an interface holds at the points of its first side, this side must be as fine as the second one:
    between the points nothing would hold that."""
    wanted = {name: each.sizes * ratios.get(name, 1.0) for name, each in meshes.items()}
    for _ in range(2):  # a part may pass it on
        for name, interface in problem.interfaces.items():
            if interface.space != "points" or len(interface.sides) != 2 or interface.one_point:
                continue
            (first, at_first), (second, at_second) = (
                meshes[side.substructure].faces[side.face] for side in interface.sides
            )
            if not (len(first) and len(second)):
                continue
            one, other = (wanted[side.substructure] for side in interface.sides)
            _, near = spatial.cKDTree(at_first).query(at_second)
            np.minimum.at(one, first[near], other[second])
    for name, sizes in wanted.items():
        own = meshes[name].sizes
        if len(own) and (name in ratios or (sizes < own / np.sqrt(2.0)).any()):
            ratios[name] = sizes / own


def _spread(contributions: Array) -> bool:
    """Whether many cells make half of what all contribute: then a higher degree does more."""
    ranked = np.cumsum(np.sort(contributions)[::-1])
    half = int(np.searchsorted(ranked, 0.5 * ranked[-1])) + 1
    return half > MANY * len(contributions)


def _better_raised(dim: int, degree: int, cells: Array, ratio: Array) -> bool:
    """Whether a higher degree does more than smaller cells: many of these decide, or, in space, where edges
    take many cells, it asks for fewer unknowns."""
    if _spread(cells):
        return True
    growth = CLOSURE * float(np.mean(np.minimum(ratio, 1.0) ** -dim))
    return dim == 3 and growth > ((degree + 1) / degree) ** dim


def _way(spec: SubstructureSpec, raised: bool, cut: bool) -> tuple[str | None, str]:
    """How a part becomes finer, ``"degree"`` or ``"cells"``, and that in words; None: not at all, and why.

    `raised`: a higher degree is better. `cut`: smaller cells are, as at the edge of a contact zone.
    """
    tied = _tied(spec)
    again = getattr(spec.part, "again", None)
    # straight cells may be off a round face, which smaller ones tell
    raised = raised and (again is None or int(coordinate_map(spec.part.mesh).degree) > 1)
    alone = tied or raised or (spec.cell not in SIMPLICES and again is None and not cut)
    if spec.degree == 1 or (alone and spec.degree < _most_degree(spec)):
        return "degree", f"degree {spec.degree + 1}"
    if tied:
        return None, f"{tied}, which cannot follow it to another mesh, and its degree is {spec.degree}"
    if again is not None:
        return "cells", "meshed again"
    return "cells", "cells cut" if spec.cell in SIMPLICES else "all cells cut"


def _most_degree(spec: SubstructureSpec) -> int:
    varies = is_random_field(spec.with_mean_stiffness().stiffness)
    return MOST_WITH_FIELD if varies else MOST_DEGREE


def _meshed(spec: SubstructureSpec, ratio: Array, how: str) -> tuple[SubstructureSpec, str]:
    """A part with smaller cells, and that in words."""
    again = getattr(spec.part, "again", None)
    if again is not None:
        part = again(size_field(spec.part.mesh, cell_sizes(spec.part.mesh) * ratio))
        _check_same(spec, part)
    elif spec.cell in SIMPLICES:
        part = bisected(spec.part, ratio)
    else:
        part = halved(spec.part)
    new = replace(spec, source=part)
    return new, _told(how, new, spec)


def _meshed_on_ranks(
    spec: SubstructureSpec, owner: int, ratio: Array, how: str
) -> tuple[SubstructureSpec, str]:
    """The same of a mesh that is spread over the ranks: its owner cuts all cells, and they are spread again,
    in pieces of about as many. Collective."""
    comm, again = spec.part.mesh.comm, getattr(spec.part, "again", None)
    whole = on_one_rank(spec.part, owner)
    made: Any = None
    with agreement(comm):
        if whole is not None:
            alone, number = replace(spec, source=whole[0]), ratio[whole[1]]
            if again is None:
                made = _meshed(alone, number, how)[0].part
            else:
                made = size_field(alone.part.mesh, cell_sizes(alone.part.mesh) * number)
    if again is None:
        part = spread_over(comm, owner, made)
    else:
        sizes = comm.bcast(made, root=owner)
        with agreement(comm):
            part = again(sizes)
            _check_same(spec, part)
    new = replace(spec, source=part)
    return new, _told(how, new, spec)


def _told(how: str, new: SubstructureSpec, old: SubstructureSpec) -> str:
    return f"{how}, {_count(new)} instead of {_count(old)}"


def _check_same(spec: SubstructureSpec, part: Any) -> None:
    """Refuse what is not the same part meshed again."""
    where = f"substructure {spec.name!r}: the function that meshes it again returned"
    if not isinstance(part, Part):
        raise SceneError(f"{where} {type(part).__name__}; return a Part")
    lost = [name for name in spec.part.names if name not in part.names]
    if lost:
        raise SceneError(f"{where} a part without the face {lost[0]!r}; return the same faces each time")
    if part.again is None:
        object.__setattr__(part, "again", getattr(spec.part, "again", None))


def _tied(spec: SubstructureSpec) -> str:
    """What binds a part to its mesh, in words: fields on it; empty: nothing does."""
    force = spec.body_force
    if any(extract_domains(each) for each in _expressions(force)):
        return "its body force is a field on its mesh"
    material = spec.material
    if isinstance(material, (LinearElastic, OrthotropicElastic)) and all(
        is_real(value) for value in vars(material).values() if isinstance(value, (int, float))
    ):
        if not any(True for each in vars(material).values() for _ in _expressions(each)):
            return ""
    domain = ufl.Mesh(element("Lagrange", spec.cell, 1, shape=(spec.dim,)))
    space = ufl.FunctionSpace(domain, element("Lagrange", spec.cell, spec.degree, shape=(spec.dim,)))
    integrand: Any = getattr(material, "bilinear", material)
    try:
        form = integrand(ufl.TrialFunction(space), ufl.TestFunction(space))
        domains = set(form.ufl_domains() if isinstance(form, ufl.Form) else extract_domains(form))
    except Exception:  # whatever a function of the user's needs of a mesh
        return "its material is made for its mesh"
    return "its material has fields or constants on its mesh" if domains - {domain} else ""


def _expressions(value: Any) -> Iterator[Any]:
    """The UFL expressions in a value."""
    if isinstance(value, ufl.core.expr.Expr):
        yield value
    elif isinstance(value, (list, tuple)):
        for each in value:
            yield from _expressions(each)
    elif hasattr(value, "terms"):
        yield from _expressions([each for _, each in value.terms])
