"""Where meshes must become finer for an accuracy, and how each part can.

A part whose geometry is known (:attr:`Part.again`) is meshed again with the sizes that its estimate wants;
triangles and tetrahedra are cut, quadrilaterals and hexahedra raised in degree, then all cut.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import ufl
from basix.ufl import element
from dolfinx.mesh import compute_midpoints as midpoints
from scipy.spatial import cKDTree
from ufl.domain import extract_domains

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.checks import is_real
from dolfinx_frontend.common.compat import coordinate_map
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.geometry.finer import (
    SIMPLICES,
    Model,
    OfModel,
    bisected,
    cell_sizes,
    halved,
    size_field,
)
from dolfinx_frontend.geometry.sizes import SizeField
from dolfinx_frontend.geometry.parts import Part
from dolfinx_frontend.scene.materials import LinearElastic, OrthotropicElastic
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.scene.specs import SubstructureSpec

__all__ = ["MOST_DEGREE", "Finer", "finer"]

MOST_DEGREE = 3

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
    cells: Mapping[str, Array],
    fall: float,
    edges: Mapping[str, Array],
    unseen: Collection[str] = (),
    means: Collection[str] = (),
    most: float = np.inf,
) -> Finer:
    """Finer meshes of those parts that decide.

    Parameters
    ----------
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
    """
    sums = {name: float(each.sum()) for name, each in cells.items()}
    total = sum(sums.values())
    left, alone = 0.0, []
    # those first whose finer meshes would cost most for what they bring
    for name in sorted(sums, key=lambda n: sums[n] / problem.substructures[n].size):
        if left + sums[name] > LEFT_ALONE * fall * total:
            break
        left += sums[name]
        alone.append(name)
    touched = [name for name in cells if name not in alone]
    ratios = _ratios(problem.dim, {n: cells[n] for n in touched}, fall * total - left)
    for name in unseen:
        ratios[name] = np.minimum(ratios.get(name, np.ones(len(cells[name]))), SMALLER)
    least = min((float(each.min()) for each in ratios.values()), default=1.0)
    if least > WORTH:
        ratios = {name: each * (HALF / least) for name, each in ratios.items()}
    at_edges = set()
    beside_touched = {
        name: problem.interfaces[name].points
        for name in means
        if any(side.substructure in touched for side in problem.interfaces[name].sides)
    }
    for name, places in (beside_touched | dict(edges)).items():
        for number, side in enumerate(problem.interfaces[name].sides):
            # smaller cells of the side with the points show what the edge does; the other may be raised
            if number == 0 or name not in edges or problem.dim == 2:
                at_edges.add(side.substructure)
            each = ratios.setdefault(side.substructure, np.ones(len(cells[side.substructure])))
            beside, at = _face_cells(problem, side.substructure, side.face)
            size = cell_sizes(scene.substructures[side.substructure].part.mesh)[beside]
            distance, _ = cKDTree(places).query(at)
            near = beside[distance <= 1.5 * size]
            each[near] = np.minimum(each[near], 0.5)
    _as_fine_as_the_other_side(scene, problem, ratios)
    found = Finer({}, {}, {}, {})
    together: dict[Model, None] = {}
    wanted = {name: ratio for name, ratio in ratios.items() if not ratio.min() > WORTH}
    smaller = at_edges | set(unseen)
    raised = {
        name
        for name, ratio in wanted.items()
        if name not in at_edges
        and (name not in unseen or _model(scene.substructures[name]) is not None)
        and _better_raised(scene.substructures[name], cells[name], ratio)
    }
    raised |= _with_their_models(scene, wanted, raised, smaller)
    about = _about(scene, problem, wanted, raised)
    if about > FORESEEN * most:
        return replace(found, too_large=about)
    for name, ratio in wanted.items():
        spec = scene.substructures[name]
        way, how = _way(spec, name in raised, name in at_edges)
        try:
            if way is None:
                found.stuck[name] = how
            elif way == "degree":
                found.specs[name], found.how[name] = replace(spec, degree=spec.degree + 1), how
            elif (model := _model(spec)) is not None:
                together[model] = None
            else:
                found.specs[name] = _meshed(spec, ratio)
                found.how[name] = _told(how, found.specs[name], spec)
        except SceneError as error:
            found.stuck[name] = str(error).splitlines()[0]
    for name in unseen:  # a higher degree does not change the shape
        model = _model(scene.substructures[name])
        if name in found.specs and model is not None:
            together[model] = None
    for model in together:
        _meshed_together(scene, model, ratios, unseen, found)
    for name, new in found.specs.items():
        spec = scene.substructures[name]
        found.growth[name] = _count(new) / _count(spec) * (new.degree / spec.degree) ** spec.dim
    return found


def _sizes(mesh: Any, ratio: Array, count: float) -> SizeField:
    """Sizes for a mesh generator: where nothing is to change cells of the size of the present ones would be
    more of them, as a coarse mesh has its cells from its edges."""
    same = np.clip((ratio - SAME_FROM) / (1.0 - SAME_FROM), 0.0, 1.0)
    return size_field(mesh, cell_sizes(mesh) * ratio * (1.0 + (count - 1.0) * same))


def _model(spec: SubstructureSpec) -> Model | None:
    """The model that a part is meshed again with; None: it is not."""
    again = getattr(spec.part, "again", None)
    return again.model if isinstance(again, OfModel) and not _tied(spec) else None


def _about(scene: Scene, problem: Problem, wanted: Mapping[str, Array], raised: Collection[str]) -> float:
    """Unknowns that there will be, as far as sizes tell."""
    total = 0.0
    for name, part in problem.substructures.items():
        spec, growth = scene.substructures[name], 1.0
        if name in raised or (name in wanted and spec.degree == 1):
            growth = ((spec.degree + 1) / spec.degree) ** spec.dim
        elif name in wanted:
            growth = float(np.mean(wanted[name] ** -spec.dim))
        total += part.size * growth
    return total


def _with_their_models(
    scene: Scene, wanted: Collection[str], raised: Collection[str], smaller: Collection[str]
) -> set[str]:
    """Parts that get a higher degree as others of their model do: smaller cells of one would be new meshes of
    all, unless there are parts that need these in any case."""
    models = {name: _model(scene.substructures[name]) for name in wanted}
    held = {models[name] for name in wanted if name in smaller}
    some = {models[name] for name in raised} - held - {None}
    low = [n for n in wanted if scene.substructures[n].degree < MOST_DEGREE]
    return {name for name in low if models[name] in some}


def _meshed_together(
    scene: Scene, model: Model, ratios: Mapping[str, Array], unseen: Collection[str], found: Finer
) -> None:
    """All parts of a model meshed again; those that get a higher degree keep their sizes, but for what their
    shape needs."""
    of_model: dict[str, str] = {}
    for name, spec in scene.substructures.items():
        again = getattr(spec.part, "again", None)
        if _model(spec) is model and again is not None:
            of_model[name] = again.name
    wanted: dict[str, tuple[Any, Array]] = {}
    for name, own in of_model.items():
        ratio: Array | float = ratios.get(name, 1.0)
        if name in found.specs:  # raised
            ratio = ROUNDER if name in unseen else 1.0
        # no cell gets larger: round faces that are coarse as they are must not fold
        spec = scene.substructures[name]
        wanted[own] = spec.part.mesh, np.minimum(ratio, np.ones(_count(spec)))
    try:
        try:
            parts = model.parts({own: _sizes(*each, SAME_COUNT) for own, each in wanted.items()})
        except SceneError:  # more cells fold less
            parts = model.parts({own: _sizes(*each, 1.0) for own, each in wanted.items()})
        for name, own in of_model.items():
            spec = found.specs.get(name, scene.substructures[name])
            _check_same(spec, parts.get(own))
            found.specs[name] = replace(spec, source=parts[own])
            how = f"{found.how[name]}, meshed again" if name in found.how else "meshed again"
            found.how[name] = _told(how, found.specs[name], scene.substructures[name])
    except SceneError:  # cells that fold, as where sizes change fast around a hole: those that there are, cut
        for name in of_model:
            spec = scene.substructures[name]
            if name in ratios and name not in found.specs and ratios[name].min() <= WORTH:
                found.specs[name] = replace(spec, source=bisected(spec.part, ratios[name]))
                found.how[name] = _told("cells cut", found.specs[name], spec)


def _count(spec: SubstructureSpec) -> int:
    topology = spec.part.mesh.topology
    return int(topology.index_map(topology.dim).size_local)


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


def _as_fine_as_the_other_side(scene: Scene, problem: Problem, ratios: dict[str, Array]) -> None:
    """Where an interface holds at the points of its first side, this side must be as fine as the second one:
    between the points nothing would hold that."""
    wanted = {}
    for name in problem.substructures:
        own = cell_sizes(scene.substructures[name].part.mesh)
        wanted[name] = own * ratios.get(name, np.ones(len(own)))
    for _ in range(2):  # a part may pass it on
        for name, interface in problem.interfaces.items():
            if interface.space != "points" or len(interface.sides) != 2:
                continue
            (first, at_first), (second, at_second) = (
                _face_cells(problem, side.substructure, side.face) for side in interface.sides
            )
            one, other = (wanted[side.substructure] for side in interface.sides)
            _, near = cKDTree(at_first).query(at_second)
            np.minimum.at(one, first[near], other[second])
    for name, sizes in wanted.items():
        own = cell_sizes(scene.substructures[name].part.mesh)
        if name in ratios or (sizes < own / np.sqrt(2.0)).any():
            ratios[name] = sizes / own


def _face_cells(problem: Problem, part: str, face: str) -> tuple[Ints, Array]:
    """Cells (k,) beside the facets of a face, and the middles of these facets (k, d)."""
    each = problem.substructures[part].part
    facets = np.asarray(each.facet_tags.find(each.names[face]), dtype=np.int32)
    d = each.mesh.topology.dim
    each.mesh.topology.create_connectivity(d - 1, d)
    links = each.mesh.topology.connectivity(d - 1, d)
    cells = np.array([links.links(int(facet))[0] for facet in facets], dtype=np.int64)
    return cells, np.asarray(midpoints(each.mesh, d - 1, facets))[:, : each.mesh.geometry.dim]


def _spread(contributions: Array) -> bool:
    """Whether many cells make half of what all contribute: then a higher degree does more."""
    ranked = np.cumsum(np.sort(contributions)[::-1])
    half = int(np.searchsorted(ranked, 0.5 * ranked[-1])) + 1
    return half > MANY * len(contributions)


def _better_raised(spec: SubstructureSpec, cells: Array, ratio: Array) -> bool:
    """Whether a higher degree does more than smaller cells: many of these decide, or, in space, where edges
    take many cells, it asks for fewer unknowns."""
    if _spread(cells):
        return True
    growth = CLOSURE * float(np.mean(np.minimum(ratio, 1.0) ** -spec.dim))
    return spec.dim == 3 and growth > ((spec.degree + 1) / spec.degree) ** spec.dim


def _way(spec: SubstructureSpec, raised: bool, cut: bool) -> tuple[str | None, str]:
    """How a part becomes finer, ``"degree"`` or ``"cells"``, and that in words; None: not at all, and why.

    `raised`: a higher degree is better. `cut`: smaller cells are, as at the edge of a contact zone.
    """
    tied = _tied(spec)
    again = getattr(spec.part, "again", None)
    # straight cells may be off a round face, which smaller ones tell
    raised = raised and (again is None or int(coordinate_map(spec.part.mesh).degree) > 1)
    alone = tied or raised or (spec.cell not in SIMPLICES and again is None and not cut)
    if spec.degree == 1 or (alone and spec.degree < MOST_DEGREE):
        return "degree", f"degree {spec.degree + 1}"
    if tied:
        return None, f"{tied}, which cannot follow it to another mesh, and its degree is {spec.degree}"
    if again is not None:
        return "cells", "meshed again"
    return "cells", "cells cut" if spec.cell in SIMPLICES else "all cells cut"


def _meshed(spec: SubstructureSpec, ratio: Array) -> SubstructureSpec:
    """A part with smaller cells."""
    again = getattr(spec.part, "again", None)
    if again is not None:
        part = again(size_field(spec.part.mesh, cell_sizes(spec.part.mesh) * ratio))
        _check_same(spec, part)
    elif spec.cell in SIMPLICES:
        part = bisected(spec.part, ratio)
    else:
        part = halved(spec.part)
    return replace(spec, source=part)


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
