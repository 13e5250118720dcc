"""Loads of parts, assembled: nodal forces of every shape, and the initial stresses that they stand for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, cast

import dolfinx.fem as fem
import numpy as np
import ufl

from dolfinx_frontend.assembly.facet_map import FacetMap
from dolfinx_frontend.assembly.matrix_part import PointsOf, frames_of
from dolfinx_frontend.assembly.places import place_in, place_on_ranks
from dolfinx_frontend.assembly.ranks import agreement
from dolfinx_frontend.assembly.spread import Condensed
from dolfinx_frontend.assembly.substructure import Sources, Substructure, ring
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.frozen import locked
from dolfinx_frontend.scene.amplitudes import Amplitude
from dolfinx_frontend.scene.loads import AXES, Load, LoadTerm
from dolfinx_frontend.scene.materials import strain
from dolfinx_frontend.scene.values import is_zero

__all__ = ["FaceOf", "PartLoad", "cross", "face_of", "fitting", "part_load", "spread_load", "traction_on"]


@dataclass(frozen=True, repr=False)
class PartLoad:
    """A load, discretised.

    Attributes
    ----------
    load
        As the scene has it.
    columns
        Parameter -> part -> nodal forces (n,) of the number 1; of the parts on this rank.
    stresses
        Parameter -> initial stress of the number 1, UFL (d, d), force / area; of its part on this rank.
    sources
        What its shapes were assembled from, and what was in it then; on the rank of its part.
    """

    load: Load
    columns: Mapping[str, Mapping[str, Array]] = field(repr=False)
    stresses: Mapping[str, Any] = field(repr=False)
    sources: tuple[Sources, ...] = field(default=(), repr=False)

    def __post_init__(self) -> None:
        locked(self)

    def __repr__(self) -> str:
        return repr(self.load)

    def on(self, part: str, parameter: str) -> Array | None:
        """Nodal forces (n,) of a number 1 on a part; None: there are none."""
        return self.columns[parameter].get(part)

    def strained(self, part: str, ratio: float) -> PartLoad:
        """The load where the stiffness of a part is this times what it was: initial stresses follow it."""
        if part != self.load.part or not self.stresses:
            return self
        columns = {
            parameter: {n: ratio * f if parameter in self.stresses else f for n, f in own.items()}
            for parameter, own in self.columns.items()
        }
        return replace(self, columns=columns, stresses={p: ratio * s for p, s in self.stresses.items()})

    def check_sources(self) -> None:
        """Raise SceneError if what its shapes depend on was changed since it was assembled."""
        for each in self.sources:
            each.check_values(self.load.where)

    def with_values(self, values: Mapping[str, Any]) -> PartLoad:
        """The same shapes with other numbers."""
        return replace(self, load=self.load.with_values(values))

    def at(self, time: float) -> PartLoad:
        """The load at a time of a history."""
        return replace(self, load=self.load.at(time))

    def keys(self) -> list[LoadTerm]:
        """Its numbers with their amplitudes, each once."""
        of = ((p, t.amplitude) for p in self.load.values for t in self.load.terms(p))
        return list(dict.fromkeys(LoadTerm(self.load.name, p, a) for p, a in of))

    def mean(self, parameter: str, amplitude: Amplitude | None) -> float:
        """What one amplitude multiplies of a number, random ones at their means."""
        return sum(t.mean for t in self.load.terms(parameter) if t.amplitude == amplitude)


class _Shape(NamedTuple):
    """Nodal forces (n,) of a shape, its initial stress (UFL), and the form that it was assembled from."""

    nodal: Array
    stress: Any = None
    form: Any = None


def _assembled(where: str, s: Substructure, integrand: Any, stress: Any = None) -> _Shape:
    """A shape that is a form, or an integrand over the part."""
    if not isinstance(integrand, ufl.Form):
        if integrand is None or getattr(integrand, "ufl_shape", None) != ():
            raise SceneError(
                f"{where}: the form returned {type(integrand).__name__}; it returns a scalar UFL integrand "
                "or a form, linear in the test function"
            )
        around = ring(s.part.mesh) if s.around else 1.0
        integrand = around * integrand * ufl.dx(domain=s.part.mesh)
    if len(integrand.arguments()) != 1 and not integrand.empty():
        raise SceneError(f"{where}: what the form returned is not linear in the test function alone")
    meshes = {d.ufl_cargo() for d in integrand.ufl_domains()} if not integrand.empty() else set()
    if meshes - {s.part.mesh.ufl_domain().ufl_cargo()}:
        raise SceneError(f"{where}: its form is on another mesh than that of part {s.name!r}; use that one")
    if integrand.empty():
        return _Shape(np.zeros(s.size), stress)
    _check_linear(where, integrand)
    nodal = fem.assemble_vector(fem.form(integrand))
    return _Shape(np.array(nodal.array[: s.size], dtype=np.float64), stress, integrand)


def _check_linear(where: str, form: Any) -> None:
    """Before anything is compiled: UFL finds out what is not linear, and raises ValueError for some of it."""
    expanded = ufl.algorithms.apply_derivatives.apply_derivatives(
        ufl.algorithms.apply_algebra_lowering.apply_algebra_lowering(form)
    )
    try:
        ufl.algorithms.check_arities.check_form_arity(expanded, form.arguments())
    except (ufl.algorithms.check_arities.ArityMismatch, ValueError) as err:
        why = f": {err}" if isinstance(err, ufl.algorithms.check_arities.ArityMismatch) else ""
        raise SceneError(
            f"{where}: what the form returned is not linear in the test function{why}; every term has it "
            "once, as in lambda v: ufl.inner(b, v)"
        ) from None


def _on_mesh(where: str, s: Substructure, value: Any, shape: tuple[int, ...]) -> Any:
    """A field as UFL on the part's mesh; callables of the points are interpolated in the part's degree."""
    mesh, d = s.part.mesh, s.dim
    if not isinstance(value, ufl.core.expr.Expr):
        degree = int(s.space.element.basix_element.degree)
        function = fem.Function(fem.functionspace(mesh, ("Lagrange", degree, shape)))
        wanted = ", ".join(map(str, ("m", *shape)))

        def at(x: Array) -> Array:
            found = np.asarray(value(x[:d].T), dtype=np.float64)
            if found.shape != (x.shape[1], *shape):
                raise SceneError(
                    f"{where}: the function of the points returned shape {found.shape} for m = {x.shape[1]} "
                    f"points; return ({wanted})"
                )
            return found.T

        function.interpolate(at)
        if not np.all(np.isfinite(function.x.array)):
            raise SceneError(f"{where}: the function of the points is NaN or infinite somewhere")
        return function
    if value.ufl_shape != shape:
        raise SceneError(f"{where}: the field has shape {value.ufl_shape}, {shape} is wanted")
    domain = ufl.domain.extract_unique_domain(value)
    if domain is not None and domain.ufl_cargo() is not mesh.ufl_domain().ufl_cargo():
        raise SceneError(
            f"{where}: the field is on another mesh than that of part {s.name!r}; interpolate it there first"
        )
    return value


def _form(load: Load, s: Substructure, shape: Any) -> _Shape:
    frames = frames_of(s)
    if frames is not None:
        return _Shape(frames.loads(shape, load.where))
    return _assembled(load.where, s, shape(ufl.TestFunction(s.space)))


def _body_force(load: Load, s: Substructure, shape: Any) -> _Shape:
    v = ufl.TestFunction(s.space)
    if isinstance(shape, int):
        if shape >= s.dim:
            raise SceneError(
                f"{load.where}: the force has a component {AXES[shape]!r}, the part {s.dim} dimensions; give "
                f"{s.dim} numbers"
            )
        return _assembled(load.where, s, v[shape])
    return _assembled(load.where, s, ufl.inner(_on_mesh(load.where, s, shape, (s.dim,)), v))


def _from_strain(load: Load, s: Substructure, initial: Any) -> _Shape:
    """Forces and stress of an initial strain, UFL (3, 3)."""
    stress_of = getattr(s.material, "stress_of", None)
    if stress_of is None:
        raise SceneError(
            f"{load.where}: the material of part {s.name!r} is a form, of which the stress of an initial "
            "strain is not known: give LinearElastic or OrthotropicElastic, a material with a method "
            "stress_of(strain, mesh), or the load itself by scene.load"
        )
    stress = stress_of(initial, s.part.mesh)
    v = ufl.TestFunction(s.space)
    own = getattr(s.material, "strain", strain)
    return _assembled(load.where, s, ufl.inner(stress, own(v)), stress)


def _initial_strain(load: Load, s: Substructure, shape: Any) -> _Shape:
    if isinstance(shape, ufl.core.expr.Expr):
        domain = ufl.domain.extract_unique_domain(shape)
        if domain is not None and domain.ufl_cargo() is not s.part.mesh.ufl_domain().ufl_cargo():
            raise SceneError(f"{load.where}: the strain is on another mesh than that of part {s.name!r}")
        size = shape.ufl_shape
    else:
        shape = np.asarray(shape)
        size = shape.shape
        shape = fem.Constant(s.part.mesh, np.array(shape))
    if size not in ((s.dim, s.dim), (3, 3)):
        raise SceneError(f"{load.where}: the strain has shape {size}; give ({s.dim}, {s.dim}) or (3, 3)")
    n = size[0]
    rows = [[shape[i, j] if i < n and j < n else 0.0 for j in range(3)] for i in range(3)]
    return _from_strain(load, s, ufl.as_matrix(rows))


def _temperature(load: Load, s: Substructure, shape: Any) -> _Shape:
    dT, alpha = shape
    mesh, where = s.part.mesh, load.where
    warm = fem.Constant(mesh, np.float64(1.0)) if isinstance(dT, float) else _on_mesh(where, s, dT, ())
    if not isinstance(alpha, ufl.core.expr.Expr):
        alpha = fem.Constant(mesh, np.array(alpha, dtype=np.float64))
    shape = alpha.ufl_shape
    flat = s.dim == 2 and getattr(s.material, "plane", "") == "stress"
    if shape in ((), (1,)):
        one = alpha[0] if shape else alpha
        alpha = ufl.as_matrix([[one if i == j else 0.0 for j in range(3)] for i in range(3)])
    elif shape == (3,) or (shape == (2,) and flat):
        n = shape[0]
        alpha = ufl.as_matrix([[alpha[i] if i == j and i < n else 0.0 for j in range(3)] for i in range(3)])
    elif shape == (2, 2) and flat:
        alpha = ufl.as_matrix([[alpha[i, j] if max(i, j) < 2 else 0.0 for j in range(3)] for i in range(3)])
    elif shape != (3, 3):
        raise SceneError(
            f"{where}: alpha has the shape {shape}; give one number, one along each of x, y and z, or a "
            "symmetric matrix (3, 3)"
            + (", of which the last holds across the plane" if s.dim == 2 else "")
        )
    return _from_strain(load, s, ufl.as_matrix([[warm * alpha[i, j] for j in range(3)] for i in range(3)]))


class FaceOf:
    """A face of a part with its points: weights (m,), shape functions (m, nodes), resultants of tractions."""

    def __init__(self, s: Substructure, face: str, where: str) -> None:
        facets = FacetMap(s.part, face, where)
        degree = int(s.space.element.basix_element.degree)
        index, at, w = self._points(facets, degree)
        self.x, self.normals, area = facets.surface(index, at)
        self.weights = w * area
        self.shape = facets.trace(s.space, index, at, s.space.dofmap.index_map.size_local)
        self.area = float(self.weights.sum())
        self.centre: Array = np.asarray(self.weights @ self.x / self.area, dtype=np.float64)
        self.arms = self.x - self.centre
        self.dim = s.dim
        self.around, self.where = facets.around, where

    def _points(self, facets: FacetMap, degree: int) -> tuple[Ints, Array, Array]:
        """Facets, facet coordinates and reference weights of the points, for shape functions of a degree."""
        return facets.quadrature(2 * degree)

    def nodal(self, traction: Array) -> Array:
        """Nodal forces (n,) of a traction (m, d)."""
        return np.asarray(self.shape.T @ (self.weights[:, None] * traction)).ravel()

    def spread(self, force: Array, moment: Array) -> Array:
        """The traction (m, d), linear in x, with a resultant: a force and a moment about the centroid."""
        r, w = self.arms, self.weights
        if self.dim == 2:
            turn = np.stack([-r[:, 1], r[:, 0]], axis=1)
            return np.asarray(force / self.area + moment[0] / (w @ (r**2).sum(axis=1)) * turn)
        inertia = (w @ (r**2).sum(axis=1)) * np.eye(3) - (r * w[:, None]).T @ r
        return np.asarray(force / self.area + np.cross(np.linalg.solve(inertia, moment), r))


def face_of(s: Substructure, face: str, where: str) -> FaceOf | PointsOf:
    """A face of a part, or points of a matrix, for forces and mean motions."""
    return FaceOf(s, face, where) if frames_of(s) is None else PointsOf(s, face, where)


def cross(a: Array, b: Array) -> Array:
    """Cross product of vectors (..., 2), a number, or (..., 3)."""
    if a.shape[-1] == 2:
        return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
    return np.asarray(np.cross(a, b), dtype=np.float64)


def fitting(where: str, what: str, vector: Any, d: int) -> Array:
    if len(vector) != d:
        raise SceneError(f"{where}: {what} has {len(vector)} numbers, the part {d} dimensions; give {d}")
    return np.asarray(vector, dtype=np.float64)


def _wrench(face: FaceOf | PointsOf, kind: str, axis: int, point: Array) -> Array:
    """Traction (m, d) whose resultant is a unit force at a point, or a unit moment, along an axis."""
    d = face.dim
    if face.around:
        if kind == "moment" or axis != 1:
            raise SceneError(
                f"{face.where}: a {kind} along {AXES[axis]!r} on an axisymmetric part, which has total "
                "forces along y (its axis) only; use a pressure or a traction for radial ones"
            )
        return np.tile([0.0, 1.0 / face.area], (len(face.x), 1))
    if kind == "moment":
        moment = np.ones(1) if d == 2 else np.eye(3)[axis]
        return face.spread(np.zeros(d), moment)
    force = np.eye(d)[axis]
    return face.spread(force, np.reshape(cross(point - face.centre, force), -1))


def _force(load: Load, s: Substructure, face: Any, shape: Any) -> Array:
    kind, axis, point = shape
    if axis >= s.dim and (kind == "force" or s.dim == 3):
        raise SceneError(f"{load.where}: a {kind} along {AXES[axis]!r} on a part of {s.dim} dimensions")
    if kind == "moment" and s.dim == 2 and axis != 2:
        raise SceneError(f"{load.where}: a part in two dimensions has a moment about z only; give a number")
    place = face.centre if point is None else fitting(load.where, "point", point, s.dim)
    return _wrench(face, kind, axis, place)


def _bearing(load: Load, s: Substructure, face: Any, shape: Any) -> Array:
    if face.around:
        raise SceneError(
            f"{load.where}: a bearing load on an axisymmetric part; it is not axisymmetric: model it in 3D"
        )
    vector = fitting(load.where, "force", shape, s.dim)
    size = float(np.linalg.norm(vector))
    cosine = np.maximum(-face.normals @ vector / size, 0.0)
    total = float(face.weights @ cosine**2)
    if total <= 1e-9 * face.area:
        raise SceneError(
            f"{load.where}: no part of the face looks against the force {vector.tolist()}: a pin presses on "
            "a wall whose outward normal is opposite to its force; turn the force round, or use scene.force"
        )
    traction = -size / total * cosine[:, None] * face.normals
    # a mesh that is not symmetric leaves a transverse resultant
    return np.asarray(traction + (vector - face.weights @ traction) / face.area)


def _pressure(load: Load, s: Substructure, face: Any, shape: Any) -> Array:
    values = np.ones(len(face.x)) if isinstance(shape, int) else np.asarray(shape(face.x), dtype=np.float64)
    if values.shape != (len(face.x),):
        raise SceneError(
            f"{load.where}: the function of the points returned shape {values.shape}, ({len(face.x)},) is "
            "wanted"
        )
    return np.asarray(-values[:, None] * face.normals)


def _traction(load: Load, s: Substructure, face: Any, shape: Any) -> Array:
    if not isinstance(shape, int):
        values = np.asarray(shape(face.x), dtype=np.float64)
        if values.shape != face.x.shape:
            raise SceneError(
                f"{load.where}: the function of the points returned shape {values.shape}, {face.x.shape} is "
                "wanted"
            )
        return values
    if shape >= s.dim:
        raise SceneError(f"{load.where}: a component {AXES[shape]!r} on a part of {s.dim} dimensions")
    return np.tile(np.eye(s.dim)[shape], (len(face.x), 1))


_TRACTIONS: dict[str, Callable[[Load, Substructure, Any, Any], Array]] = {
    "force": _force,
    "bearing": _bearing,
    "pressure": _pressure,
    "traction": _traction,
}


def traction_on(
    load: Load, s: Substructure, shape: Any, at: Callable[[], FaceOf | PointsOf]
) -> tuple[Any, Array] | None:
    """The face of a load and the traction (m, d) at its points of the number 1; None: it acts elsewhere."""
    if load.kind not in _TRACTIONS:
        return None
    face = at()
    return face, _TRACTIONS[load.kind](load, s, face, shape)


def _on_face(load: Load, s: Substructure, shape: Any) -> _Shape:
    found = traction_on(load, s, shape, lambda: face_of(s, load.face, load.where))
    assert found is not None  # as its kind has one
    face, traction = found
    return _Shape(face.nodal(traction))


def _point_force(load: Load, s: Substructure, shape: Any) -> _Shape:
    first, second = shape
    where, d = load.where, s.dim
    if isinstance(first, int):  # one component at one point
        if first >= d:
            raise SceneError(f"{where}: a component {AXES[first]!r} on a part of {d} dimensions")
        points, forces = np.atleast_2d(second), np.eye(d)[[first]]
    else:
        points, forces = first, second
    nodal = np.zeros((s.size // d, d))
    for point, force in zip(points, forces, strict=True):
        place_at, here = fitting(where, "point", point, d), True
        if isinstance(s, Condensed):
            mesh = s.part.mesh
            rank, place = place_on_ranks(where, mesh, s.space, place_at)
            here = rank == mesh.comm.rank
        else:
            place = place_in(where, s, place_at)
        if here:
            np.add.at(nodal, place.nodes, np.outer(place.shape, force))
    return _Shape(nodal.ravel())


_KINDS: dict[str, Callable[[Load, Substructure, Any], _Shape]] = {
    "load": _form,
    "body_force": _body_force,
    "initial_strain": _initial_strain,
    "temperature": _temperature,
    "point_force": _point_force,
} | dict.fromkeys(_TRACTIONS, _on_face)


_OF_POINTS = ("load", "force", "point_force")
"""Loads of parts that are a matrix."""


def _check_kind(load: Load, s: Substructure) -> None:
    """Refuse loads that a part without a mesh, or with one, cannot have."""
    if frames_of(s) is None:
        if load.kind == "load" and any(isinstance(shape, str) for shape in load.shapes.values()):
            raise SceneError(
                f"{load.where}: a name is a load of a Matrix; give a function v -> UFL integrand or form"
            )
    elif load.kind not in _OF_POINTS:
        raise SceneError(
            f"{load.where}: a {load.kind} on {s.name!r}, which is a Matrix: give it as one of its "
            f"loads={{name: forces}} and scene.load(part, name), or use scene.force or scene.point_force"
        )
    elif load.kind == "load" and not all(isinstance(shape, str) for shape in load.shapes.values()):
        raise SceneError(
            f"{load.where}: a form on {s.name!r}, which is a Matrix: give the name of one of its loads"
        )


def part_load(load: Load, s: Substructure | None) -> PartLoad:
    """A load on a part of this rank; None: the part is on another one.

    Raises
    ------
    SceneError
        A shape that does not fit the part, with the load's name.
    """
    columns: dict[str, dict[str, Array]] = {parameter: {} for parameter in load.values}
    stresses: dict[str, Any] = {}
    sources: list[Sources] = []
    if s is not None:
        _check_kind(load, s)
    for parameter, shape in load.shapes.items() if s is not None else ():
        assert s is not None
        if s.around and load.kind == "force" and shape[0] == "force" and shape[1] != 1:
            if is_zero(load.values[parameter]):  # a vector with nothing along the radius
                columns[parameter][s.name] = np.zeros(s.size)
                continue
        nodal, stress, form = _KINDS[load.kind](load, s, shape)
        if not np.all(np.isfinite(nodal)):
            raise SceneError(f"{load.where}: {parameter}: its nodal forces are NaN or infinite")
        columns[parameter][s.name] = nodal
        if stress is not None:
            stresses[parameter] = stress
        if form is not None:
            sources.append(Sources.of(s.part.mesh, form, "what it is made of"))
    return PartLoad(load, columns, stresses, tuple(sources))


_OF_FACES = ("force", "bearing", "pressure", "traction")


def spread_load(load: Load, whole: Condensed, s: Substructure | None) -> PartLoad:
    """A load on a part whose mesh is spread over the ranks; collective.

    Parameters
    ----------
    whole
        What all ranks have of it.
    s
        The condensed part, on its owner.

    Raises
    ------
    SceneError
        As for :func:`part_load`.
    """
    comm = whole.space.mesh.comm
    if load.kind in _OF_FACES:  # whose unknowns are all kept
        with agreement(comm):
            return part_load(load, s)
    with agreement(comm):
        own = part_load(load, cast(Substructure, whole))
    columns: dict[str, dict[str, Array]] = {parameter: {} for parameter in load.values}
    for parameter in load.shapes:
        nodal = own.columns[parameter][whole.name]
        whole.loads[load.name, parameter] = nodal
        reduced = whole.reduced(nodal, 0 if s is None else s.size)
        if reduced is not None:
            columns[parameter][whole.name] = reduced
        if parameter in own.stresses:
            whole.stresses[load.name, parameter] = own.stresses[parameter]
    stresses = own.stresses if s is not None else {}
    return PartLoad(load, columns, stresses, own.sources)
