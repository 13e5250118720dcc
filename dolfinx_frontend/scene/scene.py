"""A scene: substructures and the interfaces between them, as the user describes them.

Nothing is computed here; names, dimensions and laws are checked, so that a mistake is reported
where it is made.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol, cast

from dolfinx import mesh as dmesh

from dolfinx_frontend.common.errors import SceneError, SceneWarning, unknown_name
from dolfinx_frontend.common.frozen import frozen
from dolfinx_frontend.scene.amplitudes import Varying
from dolfinx_frontend.scene.laws import Displacement, Law, Pressure, Symmetry, Traction
from dolfinx_frontend.scene.materials import Material
from dolfinx_frontend.scene.values import Parameter, Value, is_plain

if TYPE_CHECKING:
    from dolfinx_frontend.geometry.step import StepAssembly

__all__ = [
    "CELLS",
    "Face",
    "InterfaceSpec",
    "Overlap",
    "PartLike",
    "Scene",
    "Space",
    "SubstructureSpec",
    "check_face",
]

Overlap = Literal["full", "partial"]
"""Whether the second face covers the first one."""

Space = Literal["points", "facets"]
"""Where the law of an interface holds."""

CELLS = ("triangle", "quadrilateral", "tetrahedron", "hexahedron")
"""Cells that a part may have."""


class PartLike(Protocol):
    """One mesh with named faces (geometry.Part, or anything alike)."""

    @property
    def mesh(self) -> dmesh.Mesh:
        """Cells of this part only, on one process."""

    @property
    def facet_tags(self) -> Any:
        """Tags of the exterior facets (dolfinx MeshTags)."""

    @property
    def names(self) -> dict[str, int]:
        """Face name -> tag."""


@dataclass(frozen=True)
class SubstructureSpec:
    """A part with its material; see :meth:`Scene.substructure`."""

    name: str
    source: PartLike | Callable[[], PartLike]
    material: Material | Callable[[Any, Any], Any]
    degree: int
    body_force: Any
    rank: int | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "body_force", frozen(self.body_force))

    @property
    def lazy(self) -> bool:
        """Whether the part is still to be made."""
        return callable(self.source)

    @property
    def part(self) -> PartLike:
        """The part, once it is made."""
        assert not self.lazy
        return cast(PartLike, self.source)

    @property
    def dim(self) -> int:
        """Space dimension."""
        return int(self.part.mesh.geometry.dim)

    @property
    def cell(self) -> str:
        """Cell name."""
        return str(self.part.mesh.topology.cell_name())

    def made(self) -> SubstructureSpec:
        """The same with its part made, and checked.

        Raises
        ------
        SceneError
            What is no part, or does not fit the material.
        """
        spec = replace(self, source=self.source()) if callable(self.source) else self
        where, part = f"substructure {self.name!r}", spec.source
        for attribute in ("mesh", "facet_tags", "names"):
            if not hasattr(part, attribute):
                raise SceneError(
                    f"{where}: {type(part).__name__} is not a part (it has no {attribute!r}); pass "
                    "one of the parts that a geometry function returns"
                )
        if spec.cell not in CELLS:
            raise SceneError(
                f"{where}: cells of type {spec.cell!r} are not supported; use {', '.join(CELLS)}"
            )
        if int(spec.part.mesh.topology.dim) != spec.dim:
            raise SceneError(
                f"{where}: {spec.cell} cells in {spec.dim} dimensions (a shell); use solid cells"
            )
        if spec.part.mesh.comm.size != 1:
            raise SceneError(f"{where}: its mesh is spread over processes; make it on COMM_SELF")
        check = getattr(spec.material, "check", None)
        if check is not None:
            try:
                check(spec.dim)
            except SceneError as err:
                raise SceneError(f"{where}: {err}") from None
        locks = getattr(spec.material, "locks", None)
        if spec.degree == 1 and locks is not None and locks(spec.dim):
            warnings.warn(
                f"{where}: nu = {getattr(spec.material, 'nu', None):g} with degree=1: linear elements lock "
                "near nu = 1/2 (too stiff by any factor unless the stress is uniform); give degree=2",
                SceneWarning,
                stacklevel=3,
            )
        varies = isinstance(spec.body_force, Varying)
        for force in [v for _, v in spec.body_force.terms] if varies else [spec.body_force]:
            if isinstance(force, Parameter) and not is_plain(force):
                raise SceneError(
                    f"{where}: body_force = {force!r} is random; a part has no random values: give "
                    "numbers, or a random pressure, traction or stiffness of a law"
                )
            if is_plain(force) and not (isinstance(force, (int, float)) and force == 0):
                if not hasattr(force, "__len__") or len(force) != spec.dim:
                    raise SceneError(f"{where}: body_force = {force!r}; give {spec.dim} numbers")
        return spec


@dataclass(frozen=True)
class Face:
    """A named face of a substructure, written ``"substructure:face"``."""

    substructure: str
    face: str

    def __str__(self) -> str:
        return f"{self.substructure}:{self.face}"


@dataclass(frozen=True)
class InterfaceSpec:
    """One or two faces with a law; see :meth:`Scene.interface`."""

    name: str
    faces: tuple[Face, ...]
    law: Law
    quadrature_degree: int | None
    max_distance: float | None
    space: Space = "points"
    overlap: Overlap = "full"


def check_face(spec: SubstructureSpec, face: Face, where: str) -> None:
    """Raise SceneError unless the part has the face."""
    names = spec.part.names
    if face.face not in names:
        raise unknown_name("face", face.face, names, f"{where}, substructure {spec.name!r}")


class Scene:
    """Substructures and interfaces.

    Examples
    --------
    >>> scene = Scene()
    >>> scene.substructure("cover", vessel.parts["cover"], LinearElastic(E=200e3, nu=0.3))
    >>> scene.interface("joint", "cylinder:top", "cover:bottom", Elastic(normal=100.0))
    >>> scene.symmetry("cover:side")
    """

    def __init__(self) -> None:
        self.substructures: dict[str, SubstructureSpec] = {}
        self.interfaces: dict[str, InterfaceSpec] = {}

    @staticmethod
    def from_step(path: str | Path, **settings: Any) -> StepAssembly:
        """Parts of a STEP file and the interfaces where they touch, to be completed and meshed.

        Settings and errors are those of :func:`dolfinx_frontend.geometry.step.read_step`.

        Examples
        --------
        >>> step = Scene.from_step("flange.step")
        >>> print(step)
        >>> step.material("*", LinearElastic(E=200e3, nu=0.3))
        >>> step.join("*", Perfect())
        >>> scene = step.scene()
        """
        from dolfinx_frontend.geometry.step import read_step  # which builds on this module

        return read_step(path, **settings)

    def substructure(
        self,
        name: str,
        part: PartLike | Callable[[], PartLike],
        material: Material | Callable[[Any, Any], Any],
        degree: int = 2,
        body_force: Any = None,
        rank: int | None = None,
    ) -> None:
        """Add a part.

        Parameters
        ----------
        name
            Its name; without a colon.
        part
            Mesh with named faces, or a function that makes it: on several MPI ranks it is called on
            the rank that owns the part only, when the scene is assembled.
        material
            Object with ``bilinear(u, v)``, or callable (u, v) -> UFL integrand or form.
        degree
            Degree of the Lagrange displacements, 1 to 3.
        body_force
            Force per volume: d numbers or a UFL vector, or an amplitude times one; None: none.
        rank
            MPI rank that owns the part; None: a share of equal cost.

        Raises
        ------
        SceneError
            Name in use, cells or degree that are not supported, a material that does not fit.

        Warns
        -----
        SceneWarning
            A nearly incompressible material with degree 1.
        """
        where = f"substructure {name!r}"
        if not isinstance(name, str) or not name or ":" in name:
            raise SceneError(f"{where}: a name is a string, not empty, without a colon")
        if name in self.substructures:
            raise SceneError(f"{where}: the name is in use; names are unique")
        spec = SubstructureSpec(name, part, material, degree, body_force, rank)
        if isinstance(degree, bool) or degree not in (1, 2, 3):
            raise SceneError(f"{where}: degree {degree!r} is not supported; use 1, 2 or 3")
        if not isinstance(material, Material) and not callable(material):
            raise SceneError(
                f"{where}: {type(material).__name__} is not a material; give LinearElastic(E, nu) "
                "or a callable (u, v) -> UFL integrand"
            )
        if not spec.lazy:
            spec = spec.made()
            for other in self.substructures.values():
                if not other.lazy and other.dim != spec.dim:
                    raise SceneError(
                        f"{where} has {spec.dim} dimensions, {other.name!r} has {other.dim}; "
                        "a scene has one dimension"
                    )
        self.substructures[name] = spec

    def _face(self, text: str, where: str) -> Face:
        if not isinstance(text, str) or text.count(":") != 1:
            raise SceneError(f"{where}: {text!r} is not a face; write 'substructure:face'")
        part, face = text.split(":")
        if part not in self.substructures:
            raise unknown_name("substructure", part, self.substructures, where)
        found = Face(part, face)
        if not self.substructures[part].lazy:
            check_face(self.substructures[part], found, where)
        return found

    def interface(
        self,
        name: str,
        first: str,
        second: str | Law,
        law: Law | None = None,
        *,
        quadrature_degree: int | None = None,
        max_distance: float | None = None,
        space: Space = "points",
        overlap: Overlap = "full",
    ) -> None:
        """Join two faces, ``interface(name, "a:top", "b:bottom", law)``, or one to the ground.

        Parameters
        ----------
        name
            Its name; results and parameters are found under it (``"joint.normal"``).
        first, second
            Faces, ``"substructure:face"``.  Interface points are those of the first, and the normal
            points out of it: choose the finer mesh.  One-sided: the law instead of the second.
        law
            Its law.
        quadrature_degree
            Degree that the interface points integrate; None: mass matrices exactly.
        max_distance
            Largest distance between the faces, as a fraction of the facet size; None: 1/4.
        space
            ``"points"``: the law holds at quadrature points. ``"facets"``: it holds in the mean on
            every facet of the first face; for Perfect and contact on meshes that do not match.
        overlap
            ``"partial"``: what the second face does not cover of the first one stays free (with
            ``space="facets"`` only). ``"full"``: it is an error.

        Raises
        ------
        SceneError
            Name in use, unknown part or face, a law for another number of sides.
        """
        where = f"interface {name!r}"
        if not isinstance(name, str) or not name:
            raise SceneError(f"{where}: a name is a string and not empty")
        if name in self.interfaces:
            raise SceneError(f"{where}: the name is in use; names are unique")
        if law is None:
            faces: tuple[str, ...] = (first,)
            if isinstance(second, str):
                raise SceneError(f"{where}: no law; give one, e.g. Perfect()")
            law = second
        else:
            if not isinstance(second, str):
                raise SceneError(f"{where}: {second!r} is not a face; write 'substructure:face'")
            faces = (first, second)
        if not isinstance(law, Law):
            raise SceneError(f"{where}: {law!r} is not a law; give one, e.g. Perfect()")
        found = tuple(self._face(f, where) for f in faces)
        if len(found) not in law.sides:
            wanted = " or ".join("one side" if s == 1 else "two sides" for s in law.sides)
            raise SceneError(
                f"{where}: {law.title} takes {wanted}, {len(found)} given"
            )
        if len(found) == 2 and found[0] == found[1]:
            raise SceneError(f"{where}: both sides are {found[0]}; join two different faces")
        spec = self.substructures[found[0].substructure]
        law.check_dimension(3 if spec.lazy else spec.dim, where)
        if quadrature_degree is not None and not 1 <= quadrature_degree <= 30:
            raise SceneError(f"{where}: quadrature_degree = {quadrature_degree}; admissible: 1..30")
        if max_distance is not None and not max_distance > 0.0:
            raise SceneError(f"{where}: max_distance = {max_distance}; it is positive")
        if space not in ("points", "facets"):
            raise SceneError(f"{where}: space = {space!r}; use 'points' or 'facets'")
        if overlap not in ("full", "partial"):
            raise SceneError(f"{where}: overlap = {overlap!r}; use 'full' or 'partial'")
        if overlap == "partial" and (space != "facets" or len(found) == 1):
            raise SceneError(
                f"{where}: overlap = 'partial' needs two sides and space = 'facets', which knows "
                "what is covered"
            )
        self.interfaces[name] = InterfaceSpec(
            name, found, law, quadrature_degree, max_distance, space, overlap
        )

    def _one_sided(
        self, kind: str, faces: str | Sequence[str], law: Law, name: str | None
    ) -> None:
        given = [faces] if isinstance(faces, str) else list(faces)
        if not given:
            raise SceneError(f"{kind}: no face given; write 'substructure:face'")
        for face in given:
            base = name if name is not None and len(given) == 1 else f"{name or kind}({face})"
            unique, number = base, 2
            while name is None and unique in self.interfaces:
                unique, number = f"{base}#{number}", number + 1
            self.interface(unique, face, law)

    def symmetry(self, faces: str | Sequence[str], name: str | None = None) -> None:
        """Symmetry planes: no displacement along the normal.  One interface for each face."""
        self._one_sided("symmetry", faces, Symmetry(), name)

    def pressure(self, faces: str | Sequence[str], p: Value, name: str | None = None) -> None:
        """Pressure p (force / area) against the faces.  One interface for each face."""
        self._one_sided("pressure", faces, Pressure(p), name)

    def traction(self, faces: str | Sequence[str], t: Value, name: str | None = None) -> None:
        """Force per area t (d global components).  One interface for each face."""
        self._one_sided("traction", faces, Traction(t), name)

    def fix(
        self,
        faces: str | Sequence[str],
        value: Value = 0.0,
        components: Sequence[int] | int | None = None,
        name: str | None = None,
    ) -> None:
        """Prescribe the displacement, of all or of some global components (0 is x)."""
        axes = (components,) if isinstance(components, int) else components
        law = Displacement(value, None if axes is None else tuple(axes))
        self._one_sided("displacement", faces, law, name)

    def __repr__(self) -> str:
        lines = [
            f"Scene: {len(self.substructures)} substructures, {len(self.interfaces)} interfaces"
        ]
        for s in self.substructures.values():
            material = type(s.material).__name__ if isinstance(s.material, Material) else "UFL form"
            what = "        not made yet"
            if not s.lazy:
                what = f"{s.part.mesh.topology.index_map(s.dim).size_local:>8} {s.cell}s"
            lines.append(f"  {s.name:<16} {what}, degree {s.degree}, {material}")
        for i in self.interfaces.values():
            sides = " | ".join(str(f) for f in i.faces)
            lines.append(f"  {i.name:<24} {sides:<36} {i.law.title}")
        return "\n".join(lines)
