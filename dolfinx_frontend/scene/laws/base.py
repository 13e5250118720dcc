"""What a law is: one frozen record that answers all that others ask of it.

Plan, cost, assembly, reduction, chaos, tables and figures ask the record and never its class. A new law is
a new class with its file (or in a script): it derives from :class:`Law`, names its parameters, and says what
the kernel is given (:meth:`Law.fields`). Everything else has a default.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence, Sized
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, ClassVar, Literal, Protocol, Self

import numpy as np
import numpy.typing as npt

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import checked_flag, checked_reals
from dolfinx_frontend.common.describe import record, short
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.frozen import ReadOnlyDict, frozen
from dolfinx_frontend.common.model_limits import LIMITS
from dolfinx_frontend.scene.amplitudes import Amplitude, Combination, Varying
from dolfinx_frontend.scene.values import Parameter, evaluate, is_plain, is_uncertain, largest

__all__ = ["Elimination", "Face", "Fields", "Functions", "Law", "Points", "positive", "resolve", "settled"]


class Points(Protocol):
    """The points of an interface, at which a law has its values; m points in d dimensions."""

    @property
    def name(self) -> str:
        """Name of the interface."""

    @property
    def dim(self) -> int:
        """Space dimension d."""

    @property
    def num_points(self) -> int:
        """Number of points m."""

    @property
    def points(self) -> Array:
        """(m, d), length."""

    @property
    def weights(self) -> Array:
        """(m,), areas > 0."""

    @property
    def area(self) -> float:
        """Sum of the weights."""

    @property
    def frames(self) -> Array:
        """(m, d, d), rows n (out of side 1), t1[, t2]."""

    @property
    def normals(self) -> Array:
        """(m, d), unit normals out of side 1."""

    @property
    def gap(self) -> Array:
        """(m,), distance from side 1 to side 2 along n as meshed, length."""

    @property
    def clearance(self) -> Array:
        """(m,), the gap without what the facets of curved faces make of it, length."""

    @property
    def sides(self) -> Sized:
        """One or two."""


class Face(Protocol):
    """The face of a part that an interface lies on."""

    @property
    def substructure(self) -> str:
        """Name of the part."""

    @property
    def face(self) -> str:
        """Name of the face."""

    @property
    def flatness(self) -> float:
        """Largest difference between a facet normal and their mean; 0 for a plane face."""

    @property
    def normal(self) -> Array:
        """(d,), mean unit normal out of the part."""


class Elimination(StrEnum):
    """How a linear, fixed interface is assembled into the bodies."""

    GLUED = "nodes glued"
    REMOVED = "unknowns removed"
    TIED = "nodes tied to rigid motions"
    SPRINGS = "springs assembled"
    LOAD = "load assembled"


@dataclass(frozen=True)
class Fields:
    """A law at the points of an interface in the kernel's terms.

    Attributes
    ----------
    kind
        Kernel law: ``"perfect"``, ``"elastic"``, ``"force"``, ``"contact"``, ``"coulomb"``,
        ``"debonding"``, ``"held"``, ``"preload"``; or ``"user "`` and a name, if the law has functions.
    components
        Unknown components at a point: a frictionless law has one.
    frames
        (components * m, d) rows of the local frame that belong to them.
    parameters
        Kernel parameter -> (rows, 1): one value per point (stiffness), or per point and component.
    softest
        Smallest search direction (m, components), force / length^3, with which the law has one answer; None:
        any.
    """

    kind: str
    components: int
    frames: Array
    parameters: Mapping[str, Array]
    softest: Array | None = None


@dataclass(frozen=True)
class Functions:
    """A law that is no kernel law, as functions; see :class:`dolfinx_frontend.UserLaw` for what they take.

    Attributes
    ----------
    label
        Name for messages.
    values
        Names of the values that the functions take, as in :attr:`Fields.parameters` (without ``"jump"``).
    force, resolve, compiled
        One of them: f = R(j), the kernel's question itself, or a capsule of a law written in C++.
    tangent
        Of `force`; None: by differences.
    history
        Whether the law remembers.
    """

    label: str
    values: tuple[str, ...]
    force: Callable[..., npt.ArrayLike] | None = None
    resolve: Callable[..., npt.ArrayLike] | None = None
    compiled: Any = None
    tangent: Callable[..., npt.ArrayLike] | None = None
    history: bool = False


def resolve(value: Any, points: Points, components: int, scalar: str = "all", name: str = "value") -> Array:
    """A value at the points of an interface.

    Parameters
    ----------
    value
        Number, array, callable of the points, or parameter with a mean (which is taken).
    points
        The interface.
    components
        Components wanted at each point.
    scalar
        Meaning of one number per point if ``components > 1``, see
        :func:`dolfinx_frontend.scene.values.evaluate`.
    name
        Name of the parameter, for messages.

    Returns
    -------
    Array
        (m, components).

    Raises
    ------
    SceneError
        Wrong shape or type, NaN; the message names the interface.
    """
    what = f"interface {points.name!r}, parameter {name!r}"
    return evaluate(value, points.points, components, what, scalar)


def positive(points: Points, value: object, name: str) -> Array:
    """A value that must be positive, (m, 1)."""
    values = resolve(value, points, 1, name=name)
    if values.min() <= 0.0:
        raise SceneError(f"interface {points.name!r}: {name} {values.min():g}: it must be > 0")
    return values


@dataclass(frozen=True, repr=False)
class Law:
    """Base of all laws: a frozen record with its values, and what others ask of it.

    A law of your own is a frozen dataclass that derives from this one. It defines :meth:`parameters`,
    :meth:`fields`, and what differs from the defaults below; arrays that it is given are copied.
    """

    sides: ClassVar[tuple[int, ...]] = (1, 2)
    """Numbers of sides with which the law makes sense."""
    loading: ClassVar[tuple[str, ...]] = ()
    """Parameters that enter the answer of a linear scene linearly."""
    linear: ClassVar[bool] = False
    """Whether its force is an affine function of the jump: the only place that says so."""
    elimination: ClassVar[Elimination | None] = None
    """How it is assembled into the bodies where it is fixed; None: it is always iterated on."""
    unilateral: ClassVar[bool] = False
    """Whether it may open: what it holds is known with the answer only."""
    kernel_names: ClassVar[Mapping[str, str]] = ReadOnlyDict()
    """Parameter -> kernel parameter, where the names differ."""
    inverse: ClassVar[tuple[str, ...]] = ()
    """Parameters of which the kernel is given 1 / value; all others enter it linearly."""
    not_negative: ClassVar[tuple[str, ...]] = ()
    frictions: ClassVar[tuple[str, ...]] = ()
    """Parameters with which it is no law if they are negative."""
    spans: ClassVar[Mapping[str, slice]] = ReadOnlyDict()
    """Stiffness parameter -> components of the force that it makes, of springs."""
    search_direction: ClassVar[Literal["parts", "patch", "springs"]] = "parts"
    """Where the default search direction comes from: E / L of the parts, at most that of its own patch (for
    laws with zones that open or slip), or at most twice its stiffness."""
    drawn: ClassVar[str] = "elastic"
    """Kind by which figures colour its faces."""

    def __init_subclass__(cls, **keywords: Any) -> None:
        super().__init_subclass__(**keywords)
        for name, kind in cls.__dict__.get("__annotations__", {}).items():
            if hasattr(Law, name) and name != "history" and "ClassVar" not in str(kind):
                raise TypeError(f"{cls.__name__}: every law has a {name!r}: give the value another name")

    def __post_init__(self) -> None:
        for each in dataclasses.fields(self):
            if each.type in ("bool", bool):
                checked_flag(self.title, each.name, getattr(self, each.name))
        self.validate()
        for each in dataclasses.fields(self):
            given = getattr(self, each.name)
            own = frozen(given)
            if own is not given:
                object.__setattr__(self, each.name, own)

    def __repr__(self) -> str:
        return record(self)

    # --- its values -------------------------------------------------------------------------------
    def validate(self) -> None:
        """Check the values as they were given.

        Raises
        ------
        SceneError
            A value that makes no law.
        """

    def check_dimension(self, dim: int, where: str) -> None:
        """Check the values that make sense in some dimensions only; SceneError as in :meth:`validate`."""

    def parameters(self) -> dict[str, Any]:
        """Values that may vary or be overridden, by name; those that are None are absent."""
        return {}

    def derived(self) -> dict[str, tuple[tuple[str, ...], Callable[[Mapping[str, Array]], Array]]]:
        """Parameters that follow from others of them: name -> the names of these, and arrays (N,) of those
        that vary -> (N,)."""
        return {}

    def with_(self, **changes: Any) -> Self:
        """Copy of the law with other values.

        Raises
        ------
        SceneError
            Unknown parameter or inadmissible value.
        """
        known = [f.name for f in dataclasses.fields(self)]
        for key in changes:
            if key not in known:
                raise SceneError(f"{self.title} has no parameter {key!r}; it has {', '.join(known)}")
        return dataclasses.replace(self, **changes)

    @property
    def varying(self) -> dict[str, Varying]:
        """Parameters that change in time, by name."""
        return {k: v for k, v in self.parameters().items() if isinstance(v, Varying)}

    def at(self, time: float) -> Self:
        """The law at a time of a load history."""
        return self._changed({k: v.at(time) for k, v in self.varying.items()})

    @property
    def nominal(self) -> Self:
        """The law with all amplitudes at 1."""
        return self._changed({k: v.nominal for k, v in self.varying.items()})

    def pattern(self, amplitude: object) -> Self:
        """The law with the part of its loading that one amplitude multiplies (None: the constant part; what
        is no amplitude: nothing)."""
        changes: dict[str, Any] = {}
        for name in self.loading:
            value = getattr(self, name)
            if isinstance(value, Varying):
                changes[name] = value.pattern(amplitude)
            elif amplitude is not None and value is not None:
                changes[name] = 0.0
        return self._changed(changes)

    def _changed(self, changes: dict[str, Any]) -> Self:
        return dataclasses.replace(self, **changes) if changes else self

    def matters(self, parameter: str) -> bool:
        """Whether any answer depends on a parameter, whatever its value is."""
        return True

    def per_area(self, parameter: str, area: float) -> float:
        """What turns a value of a parameter into one per area of an interface."""
        return 1.0

    # --- what kind of law it is -------------------------------------------------------------------
    @property
    def title(self) -> str:
        """Its name in tables, figures and messages."""
        return type(self).__name__

    @property
    def partners(self) -> tuple[str, ...]:
        """Parts beside those of its sides that its elimination joins to them."""
        return ()

    @property
    def history(self) -> bool:
        """Whether the answer at a time depends on those before: such laws need the steps of a history."""
        return False

    @property
    def timed(self) -> bool:
        """Whether it changes in time without an amplitude, as a bolt does that is tightened at its turn."""
        return False

    @property
    def superposes(self) -> bool:
        """Whether the answer is linear in the loading: a linear law with constant stiffness."""
        return self.linear and not set(self.varying) - set(self.loading)

    @property
    def rubs(self) -> bool:
        """Whether it has friction: tangential forces with a bound."""
        return False

    @property
    def springs(self) -> bool:
        """Whether it is a linear spring: f_1 = kappa (j - Delta)."""
        return self.elimination is Elimination.SPRINGS

    @property
    def prescribes(self) -> Literal["jump", "force"] | None:
        """Whether it prescribes the jump, so that its force is a reaction; or the force."""
        if self.elimination in (Elimination.GLUED, Elimination.REMOVED, Elimination.TIED):
            return "jump"
        return "force" if self.elimination is Elimination.LOAD else None

    @property
    def rigid(self) -> bool:
        """Whether it prescribes jumps, where it is closed: what it holds must not be held twice."""
        return self.prescribes == "jump" or self.unilateral

    @property
    def bolt(self) -> bool:
        """Whether it pulls its sides together, as bolts do: a preload or an imposed jump."""
        return False

    def skipped(self, times: Array) -> str:
        """What no step of a history (T,) does although it ends later, in words; empty: nothing."""
        return ""

    @property
    def may_loosen(self) -> bool:
        """Whether it is a bolt that loses length after it is tightened."""
        return False

    @property
    def softens(self) -> bool:
        """Whether it comes apart, as a bond does: :meth:`damage` and :meth:`process_zone` say how far."""
        return False

    def damage(self, points: Points, jump: Array) -> Array:
        """Share of the stiffness that is lost (m,) where a jump (m, components) is the largest so far."""
        return np.zeros(points.num_points)

    def process_zone(self, points: Points, modulus: Array) -> Array:
        """Length (m,) over which it softens ahead of a crack, between parts of a modulus (m,)."""
        return np.full(points.num_points, np.inf)

    @property
    def doubt(self) -> str:
        """What is probably not meant with its values; empty: nothing."""
        for name, value in self.given(*self.frictions).items():
            size = largest(value)
            if size > LIMITS.friction:
                meant = f"{size:g} %, {name} = {size / 100.0:g}" if size >= 2.0 else "0.15, as between steel"
                return f"{self.title}: {name} = {short(value)} is beyond {LIMITS.friction:g}: is it {meant}?"
        return ""

    def count(self, dim: int) -> int:
        """Unknown components of the force at a point."""
        return dim

    def directions(self, dim: int) -> Array | None:
        """Of its components (count, dim), in global ones; None: they are those of the local frame."""
        return None

    # --- at the points of an interface ------------------------------------------------------------
    def fields(self, points: Points, time: float | None = None) -> Fields:
        """The law in the kernel's terms, at a time of a history.

        Raises
        ------
        SceneError
            A value of the wrong shape, negative or not finite.
        """
        raise SceneError(f"interface {points.name!r}: the kernel has no law for {self.title}")

    @property
    def functions(self) -> Functions | None:
        """The law as functions, if it is none that the kernel knows by name."""
        return None

    def stiffnesses(self, points: Points) -> Array:
        """kappa (m, d) of springs in the local frame, force / length^3; free directions are 0.

        Raises
        ------
        SceneError
            Negative values or wrong shapes.
        """
        return np.zeros((points.num_points, points.dim))

    def jumps(self, points: Points) -> Array:
        """Imposed jump Delta (m, d) in the local frame, length."""
        return np.zeros((points.num_points, points.dim))

    def load(self, points: Points, time: float | None = None) -> Array | None:
        """Force per area f_1 (m, d) in the local frame that it gives at a time; None: it gives none."""
        return None

    def rows(self, points: Points) -> Array:
        """(components * m, d): rows of the local frames that belong to its components."""
        components = self.count(points.dim)
        rows: Array = points.frames[:, :components].reshape(components * points.num_points, points.dim)
        return rows

    def imposed(self, points: Points) -> Array:
        """Imposed jump of its components as the kernel takes it, (components * m, 1)."""
        return self.jumps(points)[:, : self.count(points.dim)].reshape(-1, 1)

    # --- how a parameter enters the kernel --------------------------------------------------------
    def kernel_name(self, parameter: str) -> str:
        """Kernel name of a parameter."""
        return self.kernel_names.get(parameter, parameter)

    def kernel_unit(self, points: Points, parameter: str) -> tuple[str, Array]:
        """Kernel name of a parameter, and the field that the value 1 stands for.

        Returns
        -------
        tuple
            Name, and (rows, 1) such that ``value * field`` is what the kernel is given.

        Raises
        ------
        SceneError
            The law has no such parameter, or the kernel's is another function of it.
        """
        known = self.parameters()
        if parameter not in known:
            raise SceneError(
                f"interface {points.name!r}: {self.title} has no parameter {parameter!r}; "
                f"it has: {', '.join(known) or 'none'}"
            )
        if parameter in self.inverse:
            raise SceneError(
                f"interface {points.name!r}: the {parameter} of a {self.title.lower()} does not enter its "
                "law linearly"
            )
        return self.kernel_name(parameter), self._unit(points, parameter)

    def _unit(self, points: Points, parameter: str) -> Array:
        one = self.nominal.with_(**{parameter: 1.0})
        return one.fields(points).parameters[self.kernel_name(parameter)]

    def kernel_values(self, points: Points, parameter: str, values: Array) -> tuple[str, Array, Array]:
        """Kernel name of a parameter, a field, and what it is multiplied with for given values.

        Parameters
        ----------
        values
            In the units of the law, any shape.

        Returns
        -------
        tuple
            Name, (rows, 1) field, and numbers in the shape of `values`.

        Raises
        ------
        SceneError
            The law has no such parameter, or does not take the values.
        """
        if parameter not in self.inverse:
            return *self.kernel_unit(points, parameter), values
        what = f"{self.title.lower()} {parameter}"
        if parameter in self.varying:
            raise SceneError(
                f"interface {points.name!r}: the {parameter} of a {self.title.lower()} changes in time: it "
                "cannot be swept or random as well"
            )
        if values.min() <= 0.0:
            raise SceneError(f"interface {points.name!r}: {what} {values.min():g}: it must be > 0")
        return self.kernel_name(parameter), np.ones((points.num_points, 1)), np.reciprocal(values)

    # --- assembled into the bodies ----------------------------------------------------------------
    def eliminated(self, matching: bool) -> Elimination | None:
        """How it is eliminated where it is fixed, on meshes that match node for node or do not."""
        return self.elimination

    def removed(self, dim: int) -> int:
        """Unknowns at a node that its elimination takes out."""
        return 0

    def constraint(self, name: str, face: Face, nodes: Array) -> tuple[Array, Array]:
        """Directions (r, d) and values (nodes, r), length, of the displacements that it prescribes at nodes.

        Raises
        ------
        SceneError
            It prescribes none on this face.
        """
        raise SceneError(f"interface {name!r}: {self.title} prescribes no displacement")

    def nodal_jumps(self, name: str, nodes: Array) -> Array:
        """Imposed jump (nodes, d) in the local frame of glued nodes, length."""
        return np.zeros_like(nodes)

    def check_faces(self, points: Points, sag: Array, chords: Array, apart: float = 0.0) -> None:
        """Raise or warn if the faces as meshed cannot tell what the law takes from them.

        Parameters
        ----------
        sag
            (m,), how far they may be from the smooth ones, length.
        chords
            (m,), the same where facets are straight and the face is not; 0 elsewhere.
        apart
            How far faces are apart that are taken as touching, length; 0: they touch.
        """

    # --- what it holds ----------------------------------------------------------------------------
    def holds(self, dim: int) -> tuple[bool, ...]:
        """Which local components (n, t1[, t2]) the law can hold against a rigid motion."""
        return (True,) * dim

    def held_rows(self, points: Points) -> Array:
        """(m, r, d): directions in which it holds at each point, in global components."""
        return points.frames[:, list(np.flatnonzero(self.holds(points.dim))), :].copy()

    def controlled(self, time: float | None) -> bool:
        """Whether a preload gives its normal force at a time of a history (None: a static answer)."""
        return False

    @property
    def locked(self) -> Law:
        """The law that holds in its place while its force is not controlled."""
        return self

    def prescribed(self, time: float) -> Law | None:
        """The law that prescribes displacements in its place at a time; None: it does not, or always."""
        return None

    @property
    def released(self) -> Law:
        """The law that holds in its place while its force is controlled."""
        return self

    def tightened(self, points: Points, times: Array) -> int | None:
        """The step of a history that ends its tightening; None: it is no bolt."""
        if not self.bolt:
            return None
        return settled([self.at(t).jumps(points) for t in times])

    # --- checks of values -------------------------------------------------------------------------
    def check_value(self, name: str, value: Any, minimum: float | None = None, remedy: str = "") -> None:
        """Reject plain numbers that are not finite or lie below a minimum."""
        if isinstance(value, (Varying, Combination)):
            for _, term in value.terms:
                if isinstance(term, Parameter) and not is_plain(term):
                    if self.linear and name in self.loading and len(value.terms) == 1 and is_uncertain(term):
                        continue
                    raise SceneError(
                        f"{self.title}: {name} is random and changes in time; only a single amplitude times "
                        "a random number that loads a linear law can be, as a displacement or the jump of a "
                        "spring: let another parameter carry one of the two"
                    )
                self.check_value(name, term)
            return
        if isinstance(value, Amplitude):
            raise SceneError(f"{self.title}: {name} is an amplitude; multiply it by a value, e.g. by 1.0")
        if not is_plain(value):
            if callable(value) or isinstance(value, Parameter):
                return
            if isinstance(value, (list, tuple)) and any(
                isinstance(v, Parameter) and not is_plain(v) for v in value
            ):
                raise SceneError(
                    f"{self.title}: {name} = {value!r}: a vector of random components is not "
                    "supported; a random value is the whole parameter, as in pressure(face, p) or "
                    "fix(face, value, components=0)"
                )
            raise SceneError(
                f"{self.title}: {name} = {value!r} is not a number, an array, a callable "
                "or a parameter with a mean"
            )
        data = checked_reals(self.title, name, value, "give a number or an array of numbers")
        end = f"; {remedy}" if remedy else ""
        if not data.size:
            raise SceneError(f"{self.title}: {name} = {short(value)} is empty{end or '; give numbers'}")
        if not np.all(np.isfinite(data)):
            raise SceneError(f"{self.title}: {name} = {short(value)} is not finite{end or '; give numbers'}")
        if minimum is not None and data.min() < minimum:
            raise SceneError(f"{self.title}: {name} = {data.min():g} is negative{end}")

    def given(self, *names: str) -> dict[str, Any]:
        """Those of some values that are not None."""
        return {k: v for k in names if (v := getattr(self, k)) is not None}


def settled(values: Sequence[Array]) -> int:
    """The first step from which nothing changes any more."""
    last = len(values) - 1
    while last > 0 and np.array_equal(values[last - 1], values[last]):
        last -= 1
    return last
