"""A scene: substructures and the interfaces between them, as the user describes them.

Nothing is computed here; names, dimensions and laws are checked, so that a mistake is reported
where it is made.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NoReturn, SupportsIndex

from dolfinx_frontend.common.checks import (
    check_known,
    checked_name,
    checked_names,
    checked_number,
    checked_whole,
    checked_word,
    is_whole,
)
from dolfinx_frontend.common.describe import columns, short
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.scene.laws import Displacement, Law, Pressure, Symmetry, Traction
from dolfinx_frontend.scene.materials import Material
from dolfinx_frontend.scene.specs import (
    OVERLAPS,
    SPACES,
    Face,
    InterfaceSpec,
    Overlap,
    PartLike,
    Space,
    SubstructureSpec,
    check_face,
)
from dolfinx_frontend.scene.values import Value

__all__ = ["Scene"]


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

    def __deepcopy__(self, memo: dict[int, Any]) -> Scene:
        """A scene of its own; parts and laws, which never change, are shared."""
        other = Scene()
        other.substructures.update(self.substructures)
        other.interfaces.update(self.interfaces)
        return other

    def __copy__(self) -> Scene:
        return self.__deepcopy__({})

    def __reduce_ex__(self, protocol: SupportsIndex) -> NoReturn:
        raise TypeError(
            "a Scene cannot be pickled: its meshes live in this process; describe it in the process that "
            "needs it"
        )

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
        where = f"substructure {checked_name('substructure', name, colon=False)!r}"
        if name in self.substructures:
            raise SceneError(f"{where}: the name is in use; names are unique")
        spec = SubstructureSpec(name, part, material, degree, body_force, rank)
        if not is_whole(degree) or degree not in (1, 2, 3):
            raise SceneError(f"{where}: degree = {short(degree)} is not supported; use 1, 2 or 3")
        if rank is not None:
            checked_whole(where, "rank", rank, 0)
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
        check_known("substructure", part, self.substructures, where)
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
        space: Space = "auto",
        overlap: Overlap = "full",
    ) -> None:
        """Join two faces, ``interface(name, "a:top", "b:bottom", law)``, or one to the ground.

        Parameters
        ----------
        name
            Its name; results and parameters are found under it (``"joint.normal"``).
        first, second
            Faces, ``"substructure:face"``.  The normal points out of the first one.  One-sided: the law
            instead of the second.
        law
            Its law.
        quadrature_degree
            Degree that the interface points integrate; None: mass matrices exactly.
        max_distance
            Largest distance between the faces, as a fraction of the largest facet's size; None: 1/4 of a
            facet's size, or 1/20 of the extent of the smaller face if that is more.
        space
            ``"points"``: the law holds at quadrature points of the first face. ``"facets"``: it holds in
            the mean on every facet of it. ``"mortar"``: it holds in the mean about every vertex of one
            face. ``"auto"``: ``"points"`` where the meshes match or there is one side, unless the law may
            open; ``"mortar"`` otherwise.
        overlap
            ``"partial"``: what the second face does not cover of the first one stays free (not with
            ``space="points"``). ``"full"``: it is an error.

        Raises
        ------
        SceneError
            Name in use, unknown part or face, a law for another number of sides.
        """
        where = f"interface {checked_name('interface', name)!r}"
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
        if quadrature_degree is not None:
            checked_whole(where, "quadrature_degree", quadrature_degree, 1, 30)
        if max_distance is not None:
            checked_number(where, "max_distance", max_distance, above=0.0)
        space = checked_word(where, "space", space, SPACES)
        overlap = checked_word(where, "overlap", overlap, OVERLAPS)
        if overlap == "partial" and (space == "points" or len(found) == 1):
            raise SceneError(
                f"{where}: overlap = 'partial' needs two sides and a space that knows what is covered: "
                "'mortar' or 'facets'"
            )
        self.interfaces[name] = InterfaceSpec(
            name, found, law, quadrature_degree, max_distance, space, overlap
        )

    def _one_sided(
        self, kind: str, faces: str | Sequence[str], law: Law, name: str | None
    ) -> None:
        one = isinstance(faces, str)
        given = [str(faces)] if one else checked_names(kind, "faces", faces, " 'substructure:face'")
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
        law = Displacement(value, components)  # type: ignore[arg-type]  # one axis or several
        self._one_sided("displacement", faces, law, name)

    def __repr__(self) -> str:
        lines = [
            f"Scene: {len(self.substructures)} substructures, {len(self.interfaces)} interfaces"
        ]
        parts = []
        for s in self.substructures.values():
            material = type(s.material).__name__ if isinstance(s.material, Material) else "UFL form"
            cells, kind = ("", "not made yet") if s.lazy else (
                str(s.part.mesh.topology.index_map(s.dim).size_local), f"{s.cell}s"
            )
            parts.append((s.name, cells, f"{kind}, degree {s.degree}, {material}"))
        joints = [(i.name, " | ".join(map(str, i.faces)), i.law.title) for i in self.interfaces.values()]
        return "\n".join(lines + [f"  {line}" for line in columns(parts, "<><") + columns(joints, "<<<")])
