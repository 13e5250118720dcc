"""Parts whose meshes are spread over the ranks, for the estimates: what each rank has of them.

Every rank fits stresses to its own cells and those around them, which gives the fits of one rank with the
whole mesh; what cells contribute is put together.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import basix
import dolfinx.fem as fem
import numpy as np
import ufl
from ufl.algorithms.analysis import extract_coefficients, extract_constants, extract_type
from ufl.geometry import GeometricQuantity

from dolfinx_frontend.assembly.places import Place, place_of
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import agreement
from dolfinx_frontend.assembly.spread import Condensed
from dolfinx_frontend.assembly.substructure import Substructure
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.estimate.recovery import Doubts, recovery
from dolfinx_frontend.estimate.unseen import CROSSING, Longer, of_chords, of_shape
from dolfinx_frontend.results.probes import AtPoint

__all__ = ["Piece", "of_chords_on_ranks", "pieces_of", "within_cell"]


@dataclass(frozen=True, eq=False)
class Piece:
    """What a rank has of a part that is spread over the ranks.

    Attributes
    ----------
    whole
        The part.
    part
        Its own cells with those around them; None: it has none.
    own
        (k,) the number of each of its own cells, in their order, among those of `part`.
    points
        (m, d) of the interfaces of the part.
    """

    whole: Condensed
    part: Substructure | None
    own: Ints
    points: Array

    def by_cell(self, *functions: Any) -> tuple[float, Array, Doubts]:
        """Of functions on the whole mesh: energy of the first one, and what :meth:`Recovery.energies` says of
        all cells, those of the first rank first, with its `doubts`; collective."""
        comm, values = self._values(functions)
        mine = None
        with agreement(comm), np.errstate(over="ignore", invalid="ignore"):
            if self.part is not None:
                made = recovery(self.part)
                norm = float(made.products(values[0], values[0])[self.own].sum())
                mine = norm, made.energies(values)[:, :, self.own], made.doubts
        every = [each for each in comm.allgather(mine) if each is not None]
        together = np.concatenate([each[1] for each in every], axis=2)
        return sum(each[0] for each in every), together, every[0][2]

    def of_shape(self, u: Any, z: Any, value: float) -> float:
        """What its cells on round faces do to a quantity of that value, see :func:`of_shapes`; collective."""
        comm, (one, other) = self._values((u, z))
        with agreement(comm):
            mine = 0.0, Longer()
            if self.part is not None:
                mine = of_shape(self.part, one, other, self.points, self.own)
        every = comm.allgather(mine)
        longer = Longer.together([each[1] for each in every])
        return float(abs(sum(each[0] for each in every)) + longer.share * abs(value))

    def within_cell(self, at: AtPoint, u: Any, slopes: Array) -> float:
        """See :func:`within_cell`, of a function on the whole mesh; 0 but on the rank that has the cell.
        Collective.

        Parameters
        ----------
        slopes
            Derivatives of the number by the unknowns that this rank knows.
        """
        comm, (values,) = self._values((u,))
        found = 0.0
        with agreement(comm):
            if at.is_here:
                assert self.part is not None
                place = place_of(str(at), self.part, at.point)
                own = np.asarray(u.x.array)
                found = within_cell(at, self.part, place, values, own, slopes[at.unknowns])
        return found

    def of_chords(self, points: Array) -> float:
        """What its chords beside points do, see :func:`of_crossing_chords`; collective."""
        comm = self.whole.space.mesh.comm
        with agreement(comm):
            mine = Longer() if self.part is None else of_chords(self.part, points, self.own)
        return CROSSING * Longer.together(comm.allgather(mine)).share

    def _values(self, functions: Any) -> tuple[Any, list[Array]]:
        around = self.whole.surroundings
        return self.whole.space.mesh.comm, [around.values(each) for each in functions]


def pieces_of(problem: Problem) -> Mapping[str, Piece]:
    """The pieces of all parts that are spread over the ranks; collective.

    Raises
    ------
    SceneError
        A material with what cannot be moved from the whole mesh to cells of it.
    """
    found = {}
    for name, whole in problem.spread.items():
        kept = vars(whole)  # as cached_property does with what is frozen
        around = whole.surroundings
        if "_around" not in kept:
            material = whole.material if _is_plain(whole.material) else _moved(whole)
            summary = problem.parts[name]
            part: Substructure | None = None
            if around.part is not None:
                count = around.space.dofmap.index_map.size_local * whole.dim
                part = Substructure(
                    name=name,
                    part=around.part,
                    space=around.space,
                    stiffness=None,
                    load=np.zeros(count),
                    rigid_modes=np.zeros((count, 0)),
                    modulus=summary.modulus,
                    length=summary.length,
                    volume=summary.volume,
                    centre=summary.centre,
                    dof_coordinates=around.space.tabulate_dof_coordinates()[:, : whole.dim],
                    material=material,
                )
            kept["_around"] = part
        faces = [
            each.points
            for each in problem.interfaces.values()
            if any(side.substructure == name for side in each.sides)
        ]
        points = np.concatenate([np.zeros((0, whole.dim)), *faces])
        found[name] = Piece(whole, kept["_around"], around.own, points)
    return found


def within_cell(
    at: AtPoint, part: Substructure, place: Place, values: Array, u: Array, slopes: Array
) -> float:
    """How far a stress at a point is from the one with the recovered gradient there, in its unit.

    Of displacements that fill the same cell with the recovered gradient: the number at the point is what
    the derivatives give of the difference.

    Parameters
    ----------
    part, place, values
        What gradients are recovered from: cells, the place of the point there, unknowns (n,).
    u, slopes
        Unknowns of the mesh that the number is read from, and its derivatives (k,) by those of the cell.
    """
    if at.of == "displacement":
        return 0.0
    d = part.dim
    field = recovery(part).gradient_field(values)
    nodes = np.asarray(field.function_space.dofmap.list)[place.cell]
    gradient = (place.shape @ field.x.array.reshape(-1, d * d)[nodes]).reshape(d, d)
    return abs(float(slopes @ (at.moved(u, gradient) - u[at.unknowns])))


def of_chords_on_ranks(problem: Problem) -> dict[str, float]:
    """As :func:`of_crossing_chords`, of parts that are spread over the ranks; collective."""
    out: dict[str, float] = {}
    for name, piece in pieces_of(problem).items():
        for interface in problem.interfaces.values():
            named = any(side.substructure == name for side in interface.sides)
            if named and len(interface.sides) == 2 and interface.matching is None:
                out[name] = max(out.get(name, 0.0), piece.of_chords(interface.points))
    return out


def _moved(whole: Condensed) -> Callable[[Any, Any], Any] | None:
    """A material that is a form or has fields on the cells that this rank has, None where it has none;
    collective.

    Raises
    ------
    SceneError
        Fields whose unknowns are not values at points, or on another mesh; integrals over subdomains.
    """
    around, mesh = whole.surroundings, whole.part.mesh
    integrand: Callable[[Any, Any], Any] = getattr(whole.material, "bilinear", whole.material)
    u, v = ufl.TrialFunction(whole.space), ufl.TestFunction(whole.space)
    found = integrand(u, v)
    integrals = found.integrals() if isinstance(found, ufl.Form) else ()
    terms = [each.integrand() for each in integrals] or [found]
    wrong = ""
    if any(each.subdomain_id() != "everywhere" for each in integrals):
        wrong = "integrals over subdomains"
    coefficients = {f: None for term in terms for f in extract_coefficients(term)}
    for f in coefficients:
        if f.function_space.mesh != mesh:
            wrong = f"the field {f.name!r} on another mesh"
        elif f.function_space.num_sub_spaces and not f.function_space.dofmap.bs > 1:
            wrong = f"the field {f.name!r} of a mixed element"
        elif f.function_space.element.basix_element.family != basix.ElementFamily.P:
            wrong = f"the field {f.name!r}, whose unknowns are not values at points"
    if wrong:
        raise SceneError(
            f"the mesh of {whole.name!r} is spread over the ranks, and its material has {wrong}: the energy "
            "of an error is not known; make the mesh on COMM_SELF"
        )
    fields = {f: around.field(f) for f in coefficients}
    if around.part is None:
        return None
    here = around.part.mesh
    swap: dict[Any, Any] = dict(fields)
    for term in terms:
        swap |= {c: fem.Constant(here, c.value) for c in extract_constants(term)}
        swap |= {g: type(g)(here.ufl_domain()) for g in extract_type(term, GeometricQuantity)}

    def on_cells(w: Any, z: Any) -> Any:
        every = swap | {u: w, v: z}
        if not isinstance(found, ufl.Form):
            return ufl.replace(found, every)
        return ufl.Form(
            [
                each.reconstruct(integrand=ufl.replace(each.integrand(), every), domain=here.ufl_domain())
                for each in integrals
            ]
        )

    return on_cells


def _is_plain(material: Any) -> bool:
    """Whether a material consists of numbers, which are the same on every mesh."""
    if material is None or isinstance(material, (bool, int, float, str, np.ndarray, np.generic)):
        return True
    if isinstance(material, (tuple, list)):
        return all(map(_is_plain, material))
    if not is_dataclass(material) or isinstance(material, type):
        return False
    return all(_is_plain(getattr(material, each.name)) for each in fields(material))
