"""A scene: substructures and the interfaces between them, as the user describes them.

Nothing is computed here; names, dimensions and laws are checked, so that a mistake is reported
where it is made.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar, NoReturn, SupportsIndex

import numpy as np
import numpy.typing as npt

from dolfinx_frontend.common.checks import (
    check_kind,
    check_known,
    check_optional_kind,
    checked_callable,
    checked_flag,
    checked_name,
    checked_names,
    checked_number,
    checked_numbers,
    checked_whole,
    checked_word,
    is_real,
    is_whole,
)
from dolfinx_frontend.common.describe import columns, short
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.frozen import frozen
from dolfinx_frontend.common.html import Shown
from dolfinx_frontend.common.model_limits import LIMITS, beyond
from dolfinx_frontend.common.recorded import Journal, journaled
from dolfinx_frontend.scene.amplitudes import Varying
from dolfinx_frontend.scene.bolts import BoltStiffness
from dolfinx_frontend.scene.laws import (
    Contact,
    Displacement,
    Elastic,
    Elimination,
    Held,
    Law,
    Linked,
    Preload,
    Pressure,
    Rigid,
    Symmetry,
    Traction,
)
from dolfinx_frontend.scene.laws.preload import Seated
from dolfinx_frontend.scene.loads import (
    MOMENTS,
    Load,
    components,
    is_field,
    plain_vector,
    point_forces,
    scattered,
    shaped,
)
from dolfinx_frontend.scene.materials import Material, checked_expansion
from dolfinx_frontend.scene.matrix import Matrix
from dolfinx_frontend.scene.specs import (
    OVERLAPS,
    SPACES,
    Face,
    InterfaceSpec,
    Overlap,
    PartLike,
    Remote,
    Space,
    SubstructureSpec,
    check_face,
)
from dolfinx_frontend.scene.values import Value, is_plain, is_random_field, is_uncertain, is_zero, largest

__all__ = ["Scene"]

_LINE = 1e-6
"""Sine of the angle of three points that are on one line."""


def _doubt(where: str, law: Law) -> None:
    """Warn of values that are probably not meant."""
    if law.doubt:
        beyond(f"{where}: {law.doubt}")


def _check_expansion(where: str, alpha: float, dT: float) -> None:
    """Warn of a thermal strain that no solid has."""
    strain = alpha * dT
    if strain <= LIMITS.thermal_strain:
        return
    cause = f"alpha in 1e-6 per kelvin? {alpha:g}e-6 is one" if alpha >= LIMITS.friction else "alpha, or dT?"
    beyond(f"{where}: alpha dT = {alpha:g} x {dT:g} is a strain of {strain:.3g}, more than "
           f"{LIMITS.thermal_strain:.0%}: {cause}")


def _support(value: Any, components: Any, frame: Any, during: Any, kept: Any) -> Displacement:
    """The law of a support, which may come and go."""
    if during is not None:
        return Held(value, components, frame, during, kept)
    if not is_zero(kept):
        raise SceneError(f"fix: kept = {short(kept)} without during; say when it holds: during=((0, 1),)")
    return Displacement(value, components, frame)


def _components_of(value: Any) -> list[Any] | None:
    """Components of a vector with random ones, or of an amplitude times one; None: it is no such vector."""
    if isinstance(value, Varying) and len(value.terms) == 1 and isinstance(value.terms[0][1], (list, tuple)):
        amplitude, vector = value.terms[0]
        return None if amplitude is None or not scattered(vector) else [amplitude * each for each in vector]
    if not isinstance(value, (list, tuple)):
        return None
    return list(value) if scattered(value) or any(map(scattered, value)) else None


class Scene(Shown):
    """Substructures and interfaces.

    Parameters
    ----------
    axisymmetric
        All parts are sections (r, z) = (x, y) of bodies of revolution about x = 0: areas and volumes are
        those of the full ring, forces are totals, and the only rigid motion is along z.

    Examples
    --------
    >>> scene = Scene()
    >>> scene.substructure("cover", vessel.parts["cover"], LinearElastic(E=200e3, nu=0.3))
    >>> scene.interface("joint", "cylinder:top", "cover:bottom", Elastic(normal=100.0))
    >>> scene.symmetry("cover:side")
    """

    to_deck: ClassVar[Callable[..., None]]  # of decks, which stand above

    def __init__(self, axisymmetric: bool = False) -> None:
        self.axisymmetric = checked_flag("Scene", "axisymmetric", axisymmetric)
        self.substructures: dict[str, SubstructureSpec] = {}
        self.interfaces: dict[str, InterfaceSpec] = {}
        self.loads: dict[str, Load] = {}
        self.densities: Any = None
        self.journal = Journal()

    def in_journal(self) -> tuple[tuple[str, ...], ...]:
        """Names of all that is in the scene, by which its journal sees whether it has all calls."""
        return (tuple(self.substructures), tuple(self.interfaces), tuple(self.loads))

    def __deepcopy__(self, memo: dict[int, Any]) -> Scene:
        """A scene of its own; parts and laws, which never change, are shared."""
        other = Scene(self.axisymmetric)
        other.substructures.update(self.substructures)
        other.interfaces.update(self.interfaces)
        other.loads.update(self.loads)
        other.densities = self.densities
        other.journal = self.journal.copy()
        return other

    def __copy__(self) -> Scene:
        return self.__deepcopy__({})

    def __reduce_ex__(self, protocol: SupportsIndex) -> NoReturn:
        raise TypeError(
            "a Scene cannot be pickled: its meshes live in this process; describe it in the process that "
            "needs it"
        )

    @journaled
    def substructure(
        self,
        name: str,
        part: PartLike | Matrix | Callable[[], PartLike | Matrix],
        material: Material | Callable[[Any, Any], Any] | None = None,
        degree: int = 2,
        body_force: Any = None,
        rank: int | None = None,
        stiffness: Any = 1.0,
    ) -> None:
        """Add a part.

        Parameters
        ----------
        name
            Its name; without a colon.
        part
            Mesh with named faces, or a function that makes it: on several MPI ranks it is called on
            the rank that owns the part only, when the scene is assembled. Or a :class:`Matrix`.
        material
            Object with ``bilinear(u, v)``, or callable (u, v) -> UFL integrand or form; of a matrix none.
        degree
            Degree of the Lagrange displacements, 1 to 3.
        body_force
            Force per volume: d numbers or a UFL vector, or an amplitude times one; None: none.
        rank
            MPI rank that owns the part; None: a share of equal cost.
        stiffness
            What its whole stiffness is multiplied with: 1, or a positive random number with the mean 1, or a
            :class:`RandomField` with the mean 1, which has one value in each cell. Loads
            that come from the stiffness, as thermal ones, are multiplied as well. The E of
            :class:`LinearElastic` may be random instead.

        Raises
        ------
        SceneError
            Name in use, cells or degree that are not supported, a material that does not fit.

        Warns
        -----
        SceneWarning
            A nearly incompressible material with degree 1; curved cells with degree 1, which are made
            straight: linear displacements on curved cells lack the rotations, which would strain the part.
        """
        where = f"substructure {checked_name('substructure', name, colon=False)!r}"
        if name in self.substructures:
            raise SceneError(f"{where}: the name is in use; names are unique")
        spec = SubstructureSpec(name, part, material, degree, body_force, rank, self.axisymmetric, stiffness)
        if is_uncertain(stiffness) or is_random_field(stiffness):
            if abs(stiffness.mean - 1.0) > 1e-9:
                raise SceneError(
                    f"{where}: stiffness = {short(stiffness)} has the mean {stiffness.mean:g}: a factor of a "
                    "part has the mean 1, divide it by its mean and multiply the material"
                )
        elif not (is_real(stiffness) and stiffness == 1.0):
            raise SceneError(
                f"{where}: stiffness = {short(stiffness)}; give 1 or a random number with the mean 1: what "
                "is fixed belongs into the material"
            )
        if not is_whole(degree) or degree not in (1, 2, 3):
            raise SceneError(f"{where}: degree = {short(degree)} is not supported; use 1, 2 or 3")
        if rank is not None:
            checked_whole(where, "rank", rank, 0)
        if not (material is None or isinstance(material, Material) or callable(material)):
            raise SceneError(
                f"{where}: {type(material).__name__} is not a material; give LinearElastic(E, nu) "
                "or a callable (u, v) -> UFL integrand"
            )
        if not spec.lazy:
            spec = spec.made()
            other = next((each for each in self.substructures.values() if not each.lazy), spec)
            if other.dim != spec.dim:
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

    @journaled
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
            open; ``"mortar"`` otherwise. Where the meshes match node for node, `Perfect` ties the nodes
            in any of them, whether the interface is kept or assembled.
        overlap
            ``"partial"``: what the second face does not cover of the first one stays free (not with
            ``space="points"``). ``"full"``: it is an error.

        Raises
        ------
        SceneError
            Name in use, unknown part or face, a law for another number of sides.
        """
        where = f"interface {checked_name('interface', name)!r}"
        if name in self.interfaces or name in self.loads:
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
            raise SceneError(f"{where}: {law.title} takes {wanted}, {len(found)} given")
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
        _doubt(where, law)
        self.interfaces[name] = InterfaceSpec(
            name, found, law, quadrature_degree, max_distance, space, overlap
        )

    def _one_sided(self, kind: str, faces: str | Sequence[str], law: Law, name: str | None) -> None:
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

    @journaled
    def symmetry(self, faces: str | Sequence[str], name: str | None = None) -> None:
        """Symmetry planes: no displacement along the normal.  One interface for each face."""
        self._one_sided("symmetry", faces, Symmetry(), name)

    @journaled
    def pressure(self, faces: str | Sequence[str], p: Value, name: str | None = None) -> None:
        """Pressure p (force / area) against the faces.  One interface for each face.

        A random number times an Amplitude makes a load of the part instead: parameter ``"<name>.p"``.
        """
        if scattered(p) or self.densities is not None:
            self._on_faces("pressure", faces, *shaped("pressure", p, "p", 0), name)
            return
        self._one_sided("pressure", faces, Pressure(p), name)

    @journaled
    def traction(self, faces: str | Sequence[str], t: Value, name: str | None = None) -> None:
        """Force per area t (d global components).  One interface for each face.

        Random components, and random numbers times an Amplitude, make a load of the part instead: parameters
        ``"<name>.x"``, ``y``, ``z``.
        """
        if scattered(t) or self.densities is not None:
            first = faces if isinstance(faces, str) else next(iter(faces), "")
            dim = self._dim(str(first).partition(":")[0])
            self._on_faces("traction", faces, *components("traction", "t", t, count=dim), name)
            return
        self._one_sided("traction", faces, Traction(t), name)

    @journaled
    def fix(
        self,
        faces: str | Sequence[str],
        value: Value = 0.0,
        components: Sequence[int] | int | None = None,
        name: str | None = None,
        frame: Sequence[Sequence[float]] | None = None,
        during: Sequence[tuple[float, float]] | None = None,
        kept: Value = 0.0,
    ) -> None:
        """Prescribe the displacement, of all or of some components (0 is x).

        A vector with random components makes one interface per component, ``"<name>.x"`` and so on. A random
        number may be multiplied by an Amplitude.

        Parameters
        ----------
        frame
            Rows: axes (d, d) in global components along which the components are; None: the global ones.
        during
            Intervals (start, end] of a history in which it holds; outside of them it carries nothing. None:
            at all times.
        kept
            Share of the distance from its value, at the last step before an interval, that is left. 0 brings
            the face to its value, 1 holds it where it was (or moves it on from there with a value that
            changes), an Amplitude times 1 goes from one to the other.
        """
        vector = _components_of(value)
        if vector is not None and components is None:
            for k, each in enumerate(vector):
                self._one_sided(
                    f"displacement.{'xyz'[k]}",
                    faces,
                    _support(each, (k,), frame, during, kept),
                    None if name is None else f"{name}.{'xyz'[k]}",
                )
            return
        self._one_sided("displacement", faces, _support(value, components, frame, during, kept), name)

    @journaled
    def rigid(
        self,
        faces: str | Sequence[str],
        point: Sequence[float] | None = None,
        name: str | None = None,
        **motions: Value,
    ) -> None:
        """Faces that move as one rigid body, of one part or of several (RBE2).

        Their nodes are condensed to the motions of the body: nothing is iterated on, and stiffness is added
        by the constraint only. Forces on it are those on its faces, :meth:`force`. What a face takes of it is
        its row in the table of a result.

        Parameters
        ----------
        faces
            ``"substructure:face"``; their parts are put on one MPI rank.
        point
            Of the body, whose displacement x, y, z are; None: the centroid of its nodes.
        motions
            Given ones, numbers or an Amplitude times one: displacements ``x``, ``y``, ``z`` (length), small
            rotations ``rx``, ``ry``, ``rz`` (radians) about global axes; the others are free.

        Raises
        ------
        SceneError
            A face that is rigid already, or unknown motions.
        """
        for motion in motions:
            check_known("motion", motion, ("x", "y", "z", "rx", "ry", "rz"), "rigid")
        place = None if point is None else plain_vector("rigid", "point", point)
        self._tied("rigid", faces, name, point=place, **motions)

    @journaled
    def plane(
        self, faces: str | Sequence[str], tilts: bool = True, n: Value | None = None, name: str | None = None
    ) -> None:
        """Plane, parallel faces, of one part or of several, that stay in a plane; in it they move freely.

        Parameters
        ----------
        tilts
            Whether the plane may turn.
        n
            Displacement along the normal of the first face, length, if it may not turn; None: free.
        """
        checked_flag("plane", "tilts", tilts)
        if n is not None and tilts:
            raise SceneError(f"plane: n = {short(n)} with tilts = True; a given n goes with tilts=False")
        self._tied("plane", faces, name, plane=True, tilts=tilts, n=n)

    def _tied(self, kind: str, faces: str | Sequence[str], name: str | None, **settings: Any) -> None:
        one = isinstance(faces, str)
        given = [str(faces)] if one else checked_names(kind, "faces", faces, " 'substructure:face'")
        if not given:
            raise SceneError(f"{kind}: no face given; write 'substructure:face'")
        found = [self._face(face, kind) for face in given]
        group = name if name is not None else f"{kind}({given[0]})"
        used = {i.faces[0]: i for i in self.interfaces.values() if i.law.elimination is Elimination.TIED}
        for face in found:
            if face in used:
                raise SceneError(
                    f"{kind} {group!r}: {face} is rigid already by {used[face].name!r}; a rigid face belongs "
                    "to one group: name all of its faces there"
                )
        if len(set(found)) < len(found):
            raise SceneError(f"{kind} {group!r}: faces = {given}: name every face once")
        shared = {key: settings[key] for key in ("plane", "tilts") if key in settings}
        for k, each in enumerate(given):
            law = Rigid(group, found[0].substructure, k == 0, **(settings if k == 0 else shared))
            self.interface(group if len(given) == 1 else f"{group}[{each}]", each, law)

    @journaled
    def fix_point(
        self,
        part: str,
        point: Sequence[float],
        value: Value = 0.0,
        components: Sequence[int] | int | None = None,
        name: str | None = None,
        frame: Sequence[Sequence[float]] | None = None,
        nearest: bool = False,
        during: Sequence[tuple[float, float]] | None = None,
        kept: Value = 0.0,
    ) -> None:
        """Prescribe the displacement of a node of a part, of all or of some components (0 is x).

        Random components make one interface each; `frame`, `during` and `kept` are those of :meth:`fix`.

        Parameters
        ----------
        point
            Where a node is, within 1e-6 of the part's size.
        nearest
            Take the node that is nearest to the point, if it is no farther away than its cells are large; the
            plan of a result says where it is, and how far.
        """
        where = f"fix_point of {part!r}"
        check_known("substructure", part, self.substructures, where)
        place = plain_vector(where, "point", point)
        shown = ", ".join(f"{v:.6g}" for v in place)
        remote = Remote(node=tuple(map(float, place)), nearest=checked_flag(where, "nearest", nearest))
        vector = _components_of(value)
        if vector is not None and components is None:
            for k, each in enumerate(vector):
                own = f"{name or f'point({part}: {shown})'}.{'xyz'[k]}"
                law = _support(each, (k,), frame, during, kept)
                self._remote(own, (Face(part, f"({shown})"),), law, remote)
            return
        law = _support(value, components, frame, during, kept)
        self._remote(name or f"point({part}: {shown})", (Face(part, f"({shown})"),), law, remote)

    @journaled
    def fix_321(
        self, part: str, points: Sequence[Sequence[float]], name: str = "support", nearest: bool = False
    ) -> None:
        """Hold a part at three points so that nothing else is held: 3-2-1.

        The first point is held in all directions, the second one across the line to it, the third one across
        the plane of the three: rigid motions are gone, and the part expands and warps freely. The interfaces
        are ``"<name> 3"``, ``"<name> 2"`` and ``"<name> 1"``.

        Parameters
        ----------
        points
            Three of three coordinates, not on one line.
        nearest
            As of :meth:`fix_point`.
        """
        where = f"fix_321 of {part!r}"
        if not isinstance(points, (list, tuple)) or len(points) != 3:
            raise SceneError(f"{where}: points = {short(points)}; give three points")
        a, b, c = (np.asarray(plain_vector(where, "point", p), dtype=np.float64) for p in points)
        along, normal = b - a, np.cross(b - a, c - a)
        sizes = [float(np.linalg.norm(v)) for v in (along, c - a, normal)]
        if len(a) != 3 or not sizes[2] > _LINE * sizes[0] * sizes[1]:
            raise SceneError(f"{where}: the points {short(points)} are on one line; give others")
        first, third = along / sizes[0], normal / sizes[2]
        frame = [list(map(float, axis)) for axis in (first, np.cross(third, first), third)]
        for point, count in zip(points, (3, 2, 1), strict=True):
            held = tuple(range(3 - count, 3))
            self.fix_point(part, point, 0.0, held, f"{name} {count}", frame, nearest)

    @journaled
    def link(
        self,
        name: str,
        terms: Sequence[tuple[str, Sequence[float], Sequence[float]]],
        value: Value = 0.0,
        stiffness: Value | None = None,
        gap: Value | None = None,
    ) -> None:
        """Give a sum of displacements of nodes, or put a spring or a stop on it: an equation between nodes.

        Parameters
        ----------
        terms
            Part, point where a node of it is, and the vector by which its displacement is multiplied, each;
            of one part or of two.
        value
            What the sum is, length; parameter ``"<name>.value"``.
        stiffness
            Of the spring whose length grows by the sum, force / length; None: it is rigid. With a `value` the
            spring has no force there; parameters ``"<name>.normal"`` and ``"<name>.jump"``.
        gap
            The sum may grow, and fall by so much, length, before something pushes against it, rigidly or with
            the stiffness: a stop, a node that meets a face; parameters ``"<name>.gap"``,
            ``"<name>.stiffness"``.
        """
        where = f"link {checked_name('link', name)!r}"
        sums: dict[str, list[tuple[tuple[float, ...], tuple[float, ...]]]] = {}
        for term in terms:
            if not isinstance(term, (list, tuple)) or len(term) != 3:
                raise SceneError(f"{where}: {short(term)} is no term; give part, point and direction")
            check_known("substructure", term[0], self.substructures, where)
            x, along = (plain_vector(where, *each) for each in (("point", term[1]), ("direction", term[2])))
            sums.setdefault(term[0], []).append((tuple(map(float, x)), tuple(map(float, along))))
        if len(sums) not in (1, 2):
            raise SceneError(f"{where}: nodes of {len(sums)} parts; give terms of one part or of two")
        if not any(any(along) for each in sums.values() for _, along in each):
            raise SceneError(f"{where}: every direction is 0; give one that is not")
        law: Law = Linked(value) if stiffness is None else Elastic(normal=stiffness, jump=value)
        if gap is not None:
            if not is_zero(value):
                raise SceneError(f"{where}: value = {short(value)} and a gap are given: give one")
            law = Contact(gap=gap, stiffness=stiffness)
        remote = Remote(sums=tuple(map(tuple, sums.values())))
        self._remote(name, tuple(Face(part, f"({name})") for part in sums), law, remote)

    def _remote(self, name: str, faces: tuple[Face, ...], law: Law, remote: Remote) -> None:
        where = f"interface {checked_name('interface', name)!r}"
        if name in self.interfaces or name in self.loads:
            raise SceneError(
                f"{where}: the name is in use; names are unique: give name=, or hold all components of a "
                "point at once"
            )
        spec = self.substructures[faces[0].substructure]
        law.check_dimension(3 if spec.lazy else spec.dim, where)
        _doubt(where, law)
        self.interfaces[name] = InterfaceSpec(name, faces, law, None, None, "points", "full", remote)

    @journaled
    def springs(
        self,
        face: str,
        name: str | None = None,
        point: Sequence[float] | None = None,
        second: str | None = None,
        **stiffness: Value,
    ) -> None:
        """Springs from the mean rigid motion of a face to the ground, or to that of another face (RBE3: the
        faces themselves stay as soft as they are).

        Parameters
        ----------
        face
            ``"substructure:face"``.
        name
            Each spring is an interface ``"<name>.x"``, whose stiffness is the parameter
            ``"<name>.x.normal"``; None:
            ``"springs(face)"``.
        point
            Where the springs are; None: the centroid of the face, of the first one.
        second
            The other face; None: the ground.
        stiffness
            ``x``, ``y``, ``z`` (force / length) and ``rx``, ``ry``, ``rz`` (force * length), numbers or
            random; in
            2D x, y and rz.
        """
        where = f"springs of {face!r}"
        found = [self._face(each, where) for each in (face, second) if each is not None]
        if found[0] == found[-1] and second is not None:
            raise SceneError(f"{where}: both ends are {face}; join two different faces")
        place = None if point is None else tuple(map(float, plain_vector(where, "point", point)))
        if not stiffness:
            raise SceneError(f"{where}: no stiffness is given; give x=, y=, z=, rx=, ry= or rz=")
        for key, value in stiffness.items():
            check_known("spring", key, ("x", "y", "z", "rx", "ry", "rz"), where)
            force, moment = np.zeros(3), np.zeros(3)
            (moment if key[0] == "r" else force)["xyz".index(key[-1])] = 1.0
            n = len(found)
            remote = Remote(points=(place,) * n, forces=(tuple(force),) * n, moments=(tuple(moment),) * n)
            self._remote(f"{name or f'springs({face})'}.{key}", tuple(found), Elastic(normal=value), remote)

    @journaled
    def beam(
        self,
        name: str,
        first: str,
        second: str,
        stiffness: BoltStiffness,
        preload: Preload | None = None,
    ) -> None:
        """A straight beam between the centroids of two faces, whose mean motions it joins (RBE3): a bolt
        that is not meshed, between the faces under its head and its nut.

        Each of its deformations is an interface with one point: ``"<name>.axial"`` (tension > 0),
        ``".torsion"``,
        ``".bending1"``, ``".bending2"`` (its ends turn against each other) and ``".shear1"``, ``".shear2"``
        (they turn together); in 2D axial, bending1 and shear1. What tables call the normal force of torsion,
        bending and shear is a moment, of shear the shear force (`force_x`, ...) times the length.

        Parameters
        ----------
        stiffness
            :class:`BoltStiffness`, e.g. ``BoltStiffness.vdi2230(d=12, pitch=1.75, shank=20, thread=10,
            E=205e3)``.
        preload
            How it is tightened, without a `stiffness`, which is the beam's. With `during` the beam carries
            nothing at all before, and resists bending, shear and torsion that come after the first interval.
        """
        where = f"beam {checked_name('beam', name)!r}"
        check_kind(where, "stiffness", stiffness, BoltStiffness, "give BoltStiffness.vdi2230(...)")
        check_optional_kind(where, "preload", preload, Preload, "give Preload(force=...)")
        faces = (self._face(first, where), self._face(second, where))
        if self.axisymmetric:
            raise SceneError(
                f"{where}: a beam in an axisymmetric scene; a single bolt is not axisymmetric: model it in 3D"
            )
        if preload is not None and preload.stiffness is not None:
            raise SceneError(
                f"{where}: its preload has stiffness = {short(preload.stiffness)}; the stiffness of a beam "
                "is that of its BoltStiffness: leave it out of Preload, or add its compliance there"
            )
        if faces[0] == faces[1]:
            raise SceneError(f"{where}: both ends are {faces[0]}; join two different faces")
        spec = self.substructures[faces[0].substructure]
        flat = not spec.lazy and spec.dim == 2
        axial: Law = Elastic(normal=stiffness.axial)
        if preload is not None:
            axial = preload.with_(stiffness=stiffness.axial)
        laws, turns = {"axial": axial}, preload and preload.during
        others = {} if flat else {"torsion": stiffness.torsion}
        for k in (1,) if flat else (1, 2):
            others |= {f"bending{k}": stiffness.bending, f"shear{k}": 12.0 * stiffness.bending}
        for way, value in others.items():
            laws[way] = Seated(0.0, until=turns[0][1], stiffness=value) if turns else Elastic(normal=value)
        for way, law in laws.items():
            remote = Remote(points=(None, None), beam=way, clamped=stiffness.length)
            self._remote(f"{name}.{way}", faces, law, remote)

    # --- loads of parts -------------------------------------------------------------------------
    def _add(
        self,
        kind: str,
        part: str,
        name: str | None,
        values: dict[str, Any],
        shapes: dict[str, Any],
        face: str = "",
    ) -> None:
        where = f"{kind} of {part!r}"
        check_known("substructure", part, self.substructures, where)
        base = f"{kind}({part}:{face})" if face else f"{kind}({part})"
        unique, number = name if name is not None else base, 2
        while name is None and (unique in self.loads or unique in self.interfaces):
            unique, number = f"{base}#{number}", number + 1
        where = f"load {checked_name('load', unique)!r}"
        if unique in self.loads or unique in self.interfaces:
            raise SceneError(f"{where}: the name is in use; names are unique")
        self.loads[unique] = Load(unique, part, kind, values, shapes, face)

    @journaled
    def load(
        self, part: str, form: Callable[[Any], Any] | str, factor: Value = 1.0, name: str | None = None
    ) -> None:
        """Any load of a part: a linear form of the test function.

        Parameters
        ----------
        form
            v -> UFL integrand over the part (force * length / volume), or a whole UFL form with measures of
            the part's mesh, linear in v. Of a :class:`Matrix` the name of one of its loads.
        factor
            A number, random, or an Amplitude times one; parameter ``"<name>.factor"``.
        name
            Under which its parameters are found; None: from kind and part.
        """
        if not isinstance(form, str):
            checked_callable(f"load of {part!r}", "form", form, "give a function v -> UFL integrand or form")
        self._add("load", part, name, {"factor": factor}, {"factor": form})

    @journaled
    def body_force(self, part: str, force: Any, name: str | None = None) -> None:
        """Force per volume of a part.

        Parameters
        ----------
        force
            d components (numbers, random, each times an Amplitude or all of them): parameters
            ``"<name>.x"``, ``y``, ``z``; or a field, a UFL vector or a callable x (m, d) -> (m, d), or an
            Amplitude times one: parameter ``"<name>.factor"``.
        """
        where = f"body_force of {part!r}"
        self._add("body_force", part, name, *components(where, "force", force, count=self._dim(part)))

    def _dim(self, part: str) -> int | None:
        """Dimensions of a part whose mesh is here already; None: not known yet."""
        spec = self.substructures.get(part)
        return None if spec is None or spec.lazy else spec.dim

    @journaled
    def inertia_relief(self, density: Value | Mapping[str, float]) -> None:
        """Balance all loads by the inertia of the assembly, which nothing holds: it accelerates as a rigid
        body.

        What remains is in equilibrium by itself. The assembly is held at nodes of its first part, in as many
        components as it has rigid motions; these supports (``"relief"``) carry nothing, and displacements are
        relative to them. Pressures and tractions that follow are loads of parts.

        Parameters
        ----------
        density
            Mass per volume of all parts, or part -> density.

        Raises
        ------
        SceneError
            Pressures or tractions come before it, which are interfaces already.
        """
        early = [i.name for i in self.interfaces.values() if i.law.elimination is Elimination.LOAD]
        if early:
            raise SceneError(
                f"inertia_relief: {', '.join(map(repr, early))} came before it: call inertia_relief first, "
                "then the loads, which it has to balance"
            )
        if isinstance(density, Mapping):
            for part, each in density.items():
                checked_number("inertia_relief", f"density of {part!r}", each, above=0.0)
            self.densities = frozen(density)
        else:
            self.densities = checked_number("inertia_relief", "density", density, above=0.0)

    def _on_faces(
        self,
        kind: str,
        faces: str | Sequence[str],
        values: dict[str, Any],
        shapes: dict[str, Any],
        name: str | None,
    ) -> None:
        """A load on each of some faces."""
        one = isinstance(faces, str)
        given = [str(faces)] if one else checked_names(kind, "faces", faces, " 'substructure:face'")
        if not given:
            raise SceneError(f"{kind}: no face given; write 'substructure:face'")
        for each in given:
            face = self._face(each, kind)
            own = name if name is None or len(given) == 1 else f"{name}({each})"
            self._add(kind, face.substructure, own, values, shapes, face.face)

    @journaled
    def force(
        self,
        face: str,
        force: Any = None,
        moment: Any = None,
        point: Sequence[float] | None = None,
        name: str | None = None,
    ) -> None:
        """Total force and moment on a face, at a point that may be remote (RBE3).

        It is spread over the face statically, as the traction a + b x (x - centroid) that has this
        resultant: no stiffness is added. On a rigid face it is the force on the rigid body.

        Parameters
        ----------
        face
            ``"substructure:face"``.
        force
            d components, force: numbers, random, or times an Amplitude; parameters ``"<name>.x"``, ``y``,
            ``z``.
        moment
            3 components, in 2D one number, force * length; parameters ``"<name>.mx"``, ``my``, ``mz``.
        point
            Where the force acts: d numbers; None: the centroid of the face.
        """
        where = f"force on {face!r}"
        found = self._face(face, where)
        place = None if point is None else plain_vector(where, "point", point)
        values: dict[str, Any] = {}
        shapes: dict[str, Any] = {}
        if force is not None:
            values, axes = components(where, "force", force, count=self._dim(found.substructure))
            if "factor" in values:
                raise SceneError(
                    f"{where}: force = {short(force)} is a field; a total force is numbers: use traction"
                )
            shapes = {key: ("force", axis, place) for key, axis in axes.items()}
        if moment is not None:
            numbers = [v for _, v in moment.terms] if isinstance(moment, Varying) else [moment]
            flat = self._dim(found.substructure) == 2
            if any(isinstance(v, (list, tuple, np.ndarray)) for v in numbers):
                own, axes = components(where, "moment", moment, MOMENTS, None if flat else 3)
            else:
                if not flat and self._dim(found.substructure) is not None:
                    raise SceneError(f"{where}: moment = {short(moment)}; give 3 components")
                own, axes = {"mz": moment}, {"mz": 2}
            values |= own
            shapes |= {key: ("moment", axis, place) for key, axis in axes.items()}
        if not values:
            raise SceneError(f"{where}: neither a force nor a moment is given; give one")
        self._add("force", found.substructure, name, values, shapes, found.face)

    @journaled
    def bearing(self, face: str, force: Any, factor: Value = 1.0, name: str | None = None) -> None:
        """Force of a pin in a hole: a pressure with the cosine of the angle to it, where the pin presses.

        Parameters
        ----------
        face
            The wall of the hole.
        force
            d numbers: the total force that the pin exerts. What the mesh makes of its transverse resultant is
            taken out, so that the total is exact.
        factor
            A number, random, or an Amplitude times one; parameter ``"<name>.factor"``.
        """
        where = f"bearing on {face!r}"
        found = self._face(face, where)
        vector = plain_vector(where, "force", force)
        if not np.any(vector):
            raise SceneError(f"{where}: force = {short(force)} has no direction; give one that is not 0")
        self._add("bearing", found.substructure, name, {"factor": factor}, {"factor": vector}, found.face)

    @journaled
    def point_force(
        self,
        part: str,
        point: npt.ArrayLike,
        force: Any,
        name: str | None = None,
        factor: Value = 1.0,
    ) -> None:
        """Force at a point of a part, inside or on its surface, or at many points as one load.

        The displacement there grows as the mesh is refined: a concentrated force has infinite stress.

        Parameters
        ----------
        point
            (d,) or (n, d), length.
        force
            At one point d components: numbers, random, or times an Amplitude; parameters ``"<name>.x"``,
            ``y``, ``z``. At n points plain numbers (n, d), force.
        factor
            Of forces at n points: a number, random, or an Amplitude times one; parameter ``"<name>.factor"``.
        """
        where = f"point_force on {part!r}"
        if np.ndim(point) == 2:
            shape = point_forces(where, point, force, self._dim(part))
            self._add("point_force", part, name, {"factor": factor}, {"factor": shape})
            return
        if not (is_real(factor) and factor == 1.0):
            raise SceneError(f"{where}: factor = {short(factor)} of one point; give it with the components")
        place = plain_vector(where, "point", point)
        values, axes = components(where, "force", force, count=self._dim(part))
        self._add("point_force", part, name, values, {key: (axis, place) for key, axis in axes.items()})

    @journaled
    def initial_strain(self, part: str, strain: Any, factor: Value = 1.0, name: str | None = None) -> None:
        """Initial strain of a part: its stress is that of the strain less this one.

        Parameters
        ----------
        strain
            Symmetric, global axes, (d, d) or (3, 3): numbers, or a UFL matrix.
        factor
            A number, random, or an Amplitude times one; parameter ``"<name>.factor"``.
        """
        where = f"initial_strain of {part!r}"
        if not is_field(strain):
            matrix = checked_numbers(where, "strain", strain, "give a symmetric matrix", dimensions=2)
            if matrix.shape not in ((2, 2), (3, 3)) or not (matrix == matrix.T).all():
                raise SceneError(
                    f"{where}: strain = {short(strain)}; give a symmetric matrix (d, d) or (3, 3)"
                )
        self._add("initial_strain", part, name, {"factor": factor}, {"factor": strain})

    @journaled
    def temperature(
        self, part: str, dT: Any, alpha: Any = None, factor: Value = 1.0, name: str | None = None
    ) -> None:
        """Change of temperature of a part, which expands freely by alpha dT.

        The stress that results recover has the thermal part taken out.

        Parameters
        ----------
        dT
            A number (also random, or an Amplitude times one): parameter ``"<name>.dT"``. Or a field: a
            dolfinx
            Function or UFL expression on the part's mesh, or a callable x (m, d) -> (m,), also times an
            Amplitude.
        alpha
            Coefficient of expansion, 1 / temperature: a number, 3 along the global axes (2 in plane stress),
            a symmetric matrix (3, 3), or a UFL expression of these shapes; None: the material's
            ``alpha``.
        factor
            Multiplies a field: a number, random, or an Amplitude times one; parameter ``"<name>.factor"``.

        Raises
        ------
        SceneError
            No coefficient of expansion.
        """
        where = f"temperature of {part!r}"
        check_known("substructure", part, self.substructures, where)
        if alpha is None:
            alpha = getattr(self.substructures[part].material, "alpha", None)
        if alpha is None:
            raise SceneError(
                f"{where}: dT = {short(dT)} without a coefficient of expansion: give alpha=, or a material "
                "that has one, LinearElastic(E, nu, alpha=12e-6)"
            )
        if not is_field(alpha):
            alpha = checked_expansion(where, alpha)
        values, shapes = shaped(where, dT, "dT", 1.0)
        if not (is_real(factor) and factor == 1.0):
            if set(values) != {"factor"} or not is_real(values["factor"]):
                raise SceneError(
                    f"{where}: factor = {short(factor)} multiplies a field; dT = {short(dT)} is a number or "
                    "changes in time: multiply it instead"
                )
            values["factor"] = factor
        if is_plain(alpha):
            _check_expansion(where, largest(alpha), largest(values.get("dT", 0.0)))
        self._add("temperature", part, name, values, {k: (v, alpha) for k, v in shapes.items()})

    def __repr__(self) -> str:
        lines = [
            f"Scene: {len(self.substructures)} substructures, {len(self.interfaces)} interfaces"
            + (f", {len(self.loads)} loads of parts" if self.loads else "")
        ]
        parts = []
        for s in self.substructures.values():
            if s.matrix is not None:
                kind = f"points of a matrix, {s.matrix.size} unknowns"
                parts.append((s.name, str(len(s.matrix.points)), kind))
                continue
            material = type(s.material).__name__ if isinstance(s.material, Material) else "UFL form"
            cells, kind = ("", "not made yet") if s.lazy else (
                str(s.part.mesh.topology.index_map(s.dim).size_local), f"{s.cell}s"
            )
            parts.append((s.name, cells, f"{kind}, degree {s.degree}, {material}"))
        joints = [(i.name, " | ".join(map(str, i.faces)), i.law.title) for i in self.interfaces.values()]
        loads = [
            (n, each.part, ", ".join(f"{k} = {short(v)}" for k, v in each.values.items()))
            for n, each in self.loads.items()
        ]
        tables = columns(parts, "<><") + columns(joints, "<<<") + columns(loads, "<<<")
        return "\n".join(lines + [f"  {line}" for line in tables])
