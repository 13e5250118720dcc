"""Interface laws of a scene: frozen records, no numerics.

Notation, for all laws: n is the unit normal out of side 1; f_i the force per area that the
interface exerts on side i; w_i the displacement of side i; j = w_2 - w_1 the jump.  One-sided
interfaces have the ground as side 2, so that j = -w_1.  The frame of a point is (n, t1[, t2]).
Units are the user's own consistent set, e.g. N and mm; then stiffness per area is N/mm^3.

A *value* of a law is a number, an array with one row per interface point, a callable of the points
``x (m, d) -> (m,)`` or ``(m, d)``, an opaque parameter (random, swept) with a ``mean``, or one that
changes in time (:class:`dolfinx_frontend.Amplitude` times a value).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, Protocol, Self, TypeAlias, runtime_checkable

import numpy as np
import numpy.typing as npt

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.describe import record
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.scene.amplitudes import Amplitude, Combination, Varying

__all__ = [
    "Contact",
    "Debonding",
    "Displacement",
    "Elastic",
    "Law",
    "Parameter",
    "Perfect",
    "Preload",
    "Pressure",
    "Symmetry",
    "Traction",
    "UserLaw",
    "Value",
    "evaluate",
    "is_plain",
    "number",
]


SAME_TIME = 1e-9
"""Times that differ by less than this share are the same."""


@runtime_checkable
class Parameter(Protocol):
    """A value that is not known yet (random or swept); deterministic solvers take its mean."""

    @property
    def mean(self) -> float:
        """Nominal value."""


Value: TypeAlias = (
    float | Sequence[float] | Array | Callable[[Array], npt.ArrayLike] | Parameter | Varying
)


def is_plain(value: object) -> bool:
    """Whether a value is a number or an array of numbers."""
    if isinstance(value, (int, float, np.number, np.ndarray)):
        return True
    return isinstance(value, (list, tuple)) and all(is_plain(v) for v in value)


def number(value: object) -> float | None:
    """The value as a float if it is a single plain number, otherwise None."""
    if isinstance(value, (int, float, np.number)):
        return float(value)
    if isinstance(value, np.ndarray) and value.ndim == 0:
        return float(value)
    return None


def evaluate(
    value: Any,
    points: Array,
    components: int,
    what: str,
    scalar: str = "all",
    arrays: bool = True,
) -> Array:
    """Values of a law at points.

    Parameters
    ----------
    value
        Number, array (m,), (m, components) or (components,), callable or parameter with a mean.
        An array of ``components > 1`` numbers is one vector for all points, even if m is the same.
    points
        (m, d), length.
    components
        Number of components wanted.
    what
        What the value is, for messages, e.g. ``"interface 'joint', parameter 'normal'"``.
    scalar
        What a single number (per point) means if ``components > 1``: ``"first"`` sets the first
        component, ``"all"`` sets all of them, ``"zero"`` allows nothing but 0.
    arrays
        False if the points are not the interface points, so that a value per interface point
        cannot be used.

    Returns
    -------
    Array
        (m, components).

    Raises
    ------
    SceneError
        Wrong shape, wrong type, or a number that is not finite.
    """
    m = len(points)
    if isinstance(value, Varying):
        raise SceneError(f"{what}: it changes in time: solve with times=[...]")
    if isinstance(value, Combination):
        total = np.zeros((m, components))
        for coefficient, term in value.terms:
            total += coefficient * evaluate(term, points, components, what, scalar, arrays)
        return total
    origin = "gave"
    if not is_plain(value):
        if callable(value):
            value = value(points)
            origin = "returned"
        elif isinstance(value, Parameter):
            value = value.mean
        else:
            raise SceneError(
                f"{what}: a value of type {type(value).__name__} is not understood; give a number, "
                "an array, a callable of the points (m, d), or a parameter with a mean"
            )
    try:
        data = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as err:
        raise SceneError(f"{what}: {value!r} is not a number or an array of numbers") from err
    if not np.all(np.isfinite(data)):
        raise SceneError(f"{what}: contains NaN or infinity; give finite numbers")
    if components == 1:
        if data.ndim == 0:
            return np.full((m, 1), float(data))
        if data.shape in ((m,), (m, 1)) and (arrays or origin == "returned"):
            return data.reshape(m, 1).copy()
    else:
        if data.shape == (components,):
            return np.tile(data, (m, 1))
        if data.shape == (m, components) and (arrays or origin == "returned"):
            return data.copy()
        per_point = data.ndim == 0 or (
            data.shape == (m,) and (arrays or origin == "returned")
        )
        if per_point and (scalar != "zero" or not np.any(data)):
            out = np.zeros((m, components))
            out[:, slice(0, 1) if scalar == "first" else slice(None)] = (
                data if data.ndim == 0 else data[:, None]
            )
            return out
    wanted = "a number" if components == 1 or scalar != "zero" else f"{components} components"
    if arrays or origin == "returned":
        wanted += f" or {m} rows (one an interface point)" + (
            f" of {components}" if components > 1 else ""
        )
    else:
        wanted += " or a callable of the points (it is needed at nodes, not at interface points)"
    shown = f"shape {data.shape}" if data.ndim else f"the number {float(data):g}"
    raise SceneError(f"{what}: wrong shape: {origin} {shown}, wanted {wanted}")


@dataclass(frozen=True, repr=False)
class Law:
    """Base of all laws."""

    sides: ClassVar[tuple[int, ...]] = (1, 2)
    """Numbers of sides with which the law makes sense."""
    loading: ClassVar[tuple[str, ...]] = ()
    """Parameters that enter the answer of a linear scene linearly."""

    def __repr__(self) -> str:
        return record(self)

    @property
    def history(self) -> bool:
        """Whether the answer at a time depends on those before: such laws need the steps of a history."""
        return False

    def parameters(self) -> dict[str, Any]:
        """Values that may vary or be overridden, by name; those that are None are absent."""
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
                raise SceneError(
                    f"{type(self).__name__} has no parameter {key!r}; it has {', '.join(known)}"
                )
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

    def pattern(self, amplitude: Amplitude | None) -> Self:
        """The law with the part of its loading that one amplitude multiplies (None: the constant part)."""
        changes: dict[str, Any] = {}
        for name in self.loading:
            value = getattr(self, name)
            if isinstance(value, Varying):
                changes[name] = value.pattern(amplitude)
            elif amplitude is not None:
                changes[name] = 0.0
        return self._changed(changes)

    def _changed(self, changes: dict[str, Any]) -> Self:
        return dataclasses.replace(self, **changes) if changes else self

    def holds(self, dim: int) -> tuple[bool, ...]:
        """Which local components (n, t1[, t2]) the law can hold against a rigid motion."""
        return (True,) * dim

    def _check(self, name: str, value: Any, minimum: float | None = None, mend: str = "") -> None:
        """Reject plain numbers that are not finite or lie below a minimum."""
        if isinstance(value, (Varying, Combination)):
            for _, term in value.terms:
                if isinstance(term, Parameter) and not is_plain(term):
                    raise SceneError(
                        f"{type(self).__name__}: {name} is random and changes in time; a random value "
                        "cannot be multiplied by an amplitude, let another parameter carry one of the two"
                    )
                self._check(name, term)
            return
        if isinstance(value, Amplitude):
            raise SceneError(
                f"{type(self).__name__}: {name} is an amplitude; multiply it by a value, e.g. by 1.0"
            )
        if not is_plain(value):
            if callable(value) or isinstance(value, Parameter):
                return
            if isinstance(value, (list, tuple)) and any(
                isinstance(v, Parameter) and not is_plain(v) for v in value
            ):
                raise SceneError(
                    f"{type(self).__name__}: {name} = {value!r}: a vector of random components is not "
                    "supported; a random value is the whole parameter, as in pressure(face, p) or "
                    "fix(face, value, components=0)"
                )
            raise SceneError(
                f"{type(self).__name__}: {name} = {value!r} is not a number, an array, a callable "
                "or a parameter with a mean"
            )
        try:
            data = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            raise SceneError(
                f"{type(self).__name__}: {name} = {value!r} is not a number or an array of numbers"
            ) from None
        end = f"; {mend}" if mend else ""
        if not np.all(np.isfinite(data)):
            raise SceneError(
                f"{type(self).__name__}: {name} = {value!r} is not finite{end or '; give numbers'}"
            )
        if minimum is not None and data.size and data.min() < minimum:
            raise SceneError(
                f"{type(self).__name__}: {name} = {data.min():g} is negative{end}"
            )


@dataclass(frozen=True, repr=False)
class Perfect(Law):
    """Glue: j = Delta, f_2 = -f_1.

    Parameters
    ----------
    jump
        Delta, length: a number is the component along n, d components are in the local frame.
    """

    jump: Any = 0.0
    sides: ClassVar[tuple[int, ...]] = (2,)
    loading: ClassVar[tuple[str, ...]] = ("jump",)

    def __post_init__(self) -> None:
        self._check("jump", self.jump)

    def parameters(self) -> dict[str, Any]:
        return {"jump": self.jump}


@dataclass(frozen=True, repr=False)
class Elastic(Law):
    """Springs between the sides: f_1 = kappa (j - Delta) = -f_2; one-sided: springs to the ground.

    kappa is diagonal in the local frame: ``normal`` along n, ``tangential`` along the others.  A
    bolt that was shortened by 0.2 mm has jump = -0.2.

    Parameters
    ----------
    normal, tangential
        Stiffness per area, force / length^3, >= 0 (of the whole interface, force / length, if
        ``total``).  None leaves the direction free.
    jump
        Delta, length: a number is the component along n, d components are in the local frame.
    total
        Whether the stiffness is that of the whole interface as it is modelled (a half bolt has half
        the stiffness).
    """

    normal: Any = None
    tangential: Any = None
    jump: Any = 0.0
    total: bool = False
    loading: ClassVar[tuple[str, ...]] = ("jump",)

    def __post_init__(self) -> None:
        if self.normal is None and self.tangential is None:
            raise SceneError("Elastic: neither normal nor tangential stiffness is given; give one")
        for name in ("normal", "tangential"):
            value = getattr(self, name)
            if value is not None:
                mend = "stiffness is >= 0 and finite (Perfect() is the infinitely stiff one)"
                self._check(name, value, 0.0, mend)
        self._check("jump", self.jump)

    def parameters(self) -> dict[str, Any]:
        values = {"normal": self.normal, "tangential": self.tangential, "jump": self.jump}
        return {k: v for k, v in values.items() if v is not None}

    def holds(self, dim: int) -> tuple[bool, ...]:
        def some(value: Any) -> bool:
            return value is not None and not (is_plain(value) and not np.any(np.asarray(value)))

        return (some(self.normal),) + (some(self.tangential),) * (dim - 1)


@dataclass(frozen=True, repr=False)
class Contact(Law):
    """Unilateral contact, with or without dry friction; one-sided: against rigid ground.

    With the opening g = j_n - Delta_n + g0: f_n <= 0, g >= 0, f_n g = 0. With friction the tangential
    force is bounded, |f_t| <= mu |f_n| + tau, and slips along its own direction at the bound.

    Parameters
    ----------
    gap
        g0, length; negative: interference. None: the distance of the two faces as they are meshed.
    friction
        mu >= 0. None: no friction, and no tangential unknowns.
    threshold
        tau >= 0, force / area (Tresca's law where mu is 0). None: none.
    stiffness
        Normal stiffness per area in compression, force / length^3. None: rigid.
    jump
        Delta, length: a number is the component along n, d components are in the local frame. A bolt
        that was shortened by 0.2 mm has jump = -0.2.
    interference
        Accept faces that are meshed inside each other as an interference; otherwise that is an error.
    """

    gap: Any = None
    friction: Any = None
    threshold: Any = None
    stiffness: Any = None
    jump: Any = 0.0
    interference: bool = False

    def __post_init__(self) -> None:
        if self.gap is not None:
            self._check("gap", self.gap)
        for name in ("friction", "threshold", "stiffness"):
            value = getattr(self, name)
            if value is not None:
                self._check(name, value, 0.0, f"{name} is >= 0 and finite")
        self._check("jump", self.jump)

    @property
    def rubs(self) -> bool:
        """Whether there are tangential forces."""
        return any(
            value is not None and not (is_plain(value) and not np.any(np.asarray(value)))
            for value in (self.friction, self.threshold)
        )

    @property
    def history(self) -> bool:
        return self.rubs

    def parameters(self) -> dict[str, Any]:
        names = ("gap", "friction", "threshold", "stiffness", "jump")
        return {k: getattr(self, k) for k in names if getattr(self, k) is not None}

    def holds(self, dim: int) -> tuple[bool, ...]:
        # as long as it is closed; whether it is, only the solution tells
        return (True,) + (self.rubs,) * (dim - 1)


@dataclass(frozen=True, repr=False)
class Debonding(Law):
    """Elastic with a limit: a bond that softens linearly and comes apart; contact stays elastic.

    Up to its strength the bond is elastic. Then its damage D grows with the largest opening so far,
    f_n = (1 - D) kappa_n j_n in traction, f_t = (1 - D) kappa_t j_t, until nothing holds; it never heals.
    In compression f_n = kappa_n j_n always. The jumps count as
    lambda^2 = <j_n>^2 + (tangential / normal) |j_t|^2, so that the energy of separation is the same in every
    mode, and the strength in shear is sqrt(tangential / normal) times that in traction (Alfano and
    Crisfield 2001; the equations are in ``latin/interface/debonding.hpp``).

    The law softens: the search direction must be larger than strength / (opening - strength / normal), twice
    that with two sides. The plan's is raised where it is not. Where the structure is softer than that slope,
    the bond snaps back and there is no static answer to find.

    Parameters
    ----------
    normal, tangential
        Stiffness per area of the sound bond, force / length^3; normal > 0, tangential >= 0. None for the
        tangential one: no tangential forces.
    strength
        Largest traction, force / area, > 0.
    opening
        Normal jump at which nothing holds any more, length, > strength / normal; or
    energy
        fracture energy, force / length: opening = 2 energy / strength. Give one of the two.
    jump
        Delta, length: a number is the component along n, d components are in the local frame.
    """

    normal: Any
    tangential: Any = None
    strength: Any = None
    opening: Any = None
    energy: Any = None
    jump: Any = 0.0

    def __post_init__(self) -> None:
        if self.strength is None or (self.opening is None) == (self.energy is None):
            raise SceneError("Debonding: give its strength, and its final opening or its energy")
        for name in ("normal", "tangential", "strength", "opening", "energy"):
            value = getattr(self, name)
            if value is not None:
                self._check(name, value, 0.0, f"{name} is >= 0 and finite")
        self._check("jump", self.jump)

    @property
    def history(self) -> bool:
        return True

    def parameters(self) -> dict[str, Any]:
        names = ("normal", "tangential", "strength", "opening", "energy", "jump")
        return {k: getattr(self, k) for k in names if getattr(self, k) is not None}

    def holds(self, dim: int) -> tuple[bool, ...]:
        return (True,) + (self.tangential is not None,) * (dim - 1)


@dataclass(frozen=True, repr=False)
class Preload(Law):
    """Pretension section of a bolt: by force, then fixed at its length; tied in the tangential directions.

    In the time steps up to `until` the normal force is the given one; afterwards the normal jump of every
    point stays what it was, and the force follows from the structure. Without `until` the force is
    given throughout. With `during` it is given in some intervals only, as where bolts are tightened one after
    another, and again: before the first one the section has its original length (a bolt that just fits). (A
    shortening that is known is ``Elastic(jump=...)`` or ``Contact(jump=...)``.)

    Parameters
    ----------
    force
        Force on the whole section as it is modelled (half of it on half a bolt), > 0 in tension.
    until
        Last time of force control; None: all times.
    total
        False: `force` is per area.
    during
        Intervals (start, end] of force control, in order; instead of `until`.
    """

    force: Any
    until: float | None = None
    total: bool = True
    during: tuple[tuple[float, float], ...] | None = None

    def __post_init__(self) -> None:
        self._check("force", self.force)
        if self.until is not None and number(self.until) is None:
            raise SceneError(f"Preload: until = {self.until!r} is not a time")
        if self.during is None:
            return
        if self.until is not None:
            raise SceneError("Preload: until and during are given: give one")
        try:
            spans = tuple((float(start), float(end)) for start, end in self.during)
        except (TypeError, ValueError):
            raise SceneError(
                f"Preload: during = {self.during!r}; give intervals ((start, end), ...)"
            ) from None
        ends = [t for span in spans for t in span]
        if not ends or not all(map(math.isfinite, ends)) or any(
            b < a or (b == a and k % 2 == 0) for k, (a, b) in enumerate(zip(ends, ends[1:]))
        ):
            raise SceneError(f"Preload: during = {self.during!r}; intervals increase and do not overlap")
        object.__setattr__(self, "during", spans)

    def controlled(self, time: float) -> bool:
        """Whether the force is the given one at a time of a history."""

        def after(moment: float) -> bool:
            # a step that should end the tightening may miss its time by rounding
            return time > moment and not math.isclose(time, moment, rel_tol=SAME_TIME)

        if self.during is not None:
            return any(after(start) and not after(end) for start, end in self.during)
        return self.until is None or not after(self.until)

    @property
    def history(self) -> bool:
        return self.until is not None or self.during is not None

    def parameters(self) -> dict[str, Any]:
        return {"force": self.force}

    def holds(self, dim: int) -> tuple[bool, ...]:
        # while it is tightened, something else must hold the two ends
        return (False,) + (True,) * (dim - 1)


@dataclass(frozen=True, repr=False)
class UserLaw(Law):
    """A law of your own, a batched function of all points and columns (see ``docs/laws.md``).

    Shapes: jumps and forces are (points, components, columns) in the local frame, component 0 is normal;
    each value of the law comes as a keyword argument of shape (points, columns). What a function returns is
    checked. Give one of `force`, `resolve` and `compiled`.

    Parameters
    ----------
    force
        ``force(jump, **values)``: f = R(j), the force on side 1, continuous and monotone
        (its tangent is symmetric or not, but never negative). The kernel's question is answered with Newton's
        method.
    resolve
        ``resolve(jump, flexibility, **values)``: the answer itself, f = R(jump - flexibility f), for laws
        that no function R describes (contact, friction); flexibility (points, components, 1) > 0.
        With `history` it takes ``steps``, too: so many columns follow each other in time.
    compiled
        Capsule of a law written in C++.
    tangent
        ``tangent(jump, **values)``: dR_a / dj_b as (points, components, components, columns); None:
        by differences.
    values
        Values of the law by name; they can be swept, random, or functions of the points.
    components
        ``"normal"``: no tangential unknowns.
    jump
        Delta, length, which the functions never see: f = R(j - Delta).
    history
        Whether the law remembers (`resolve` and `compiled` only).
    name
        For messages; None: that of the function.
    """

    force: Callable[..., npt.ArrayLike] | None = None
    resolve: Callable[..., npt.ArrayLike] | None = None
    compiled: Any = None
    tangent: Callable[..., npt.ArrayLike] | None = None
    values: Mapping[str, Any] = field(default_factory=dict)
    components: Literal["all", "normal"] = "all"
    jump: Any = 0.0
    history: bool = False
    name: str | None = None

    def __post_init__(self) -> None:
        given = [k for k in ("force", "resolve", "compiled") if getattr(self, k) is not None]
        if len(given) != 1:
            raise SceneError(
                f"UserLaw: {' and '.join(given) or 'nothing'} given; give one of force, resolve, compiled"
            )
        for name in ("force", "resolve", "tangent"):
            function = getattr(self, name)
            if function is not None and not callable(function):
                raise SceneError(f"UserLaw: {name} = {function!r} cannot be called")
        if self.force is None and self.tangent is not None:
            raise SceneError("UserLaw: a tangent is of use with force only")
        if self.force is not None and self.history:
            raise SceneError("UserLaw: a law that remembers must be given by resolve or compiled")
        if self.components not in ("all", "normal"):
            raise SceneError(
                f"UserLaw: components = {self.components!r}; give 'all' or 'normal'"
            )
        own = {f.name for f in dataclasses.fields(self)} | {"flexibility", "steps"}
        for name, value in self.values.items():
            if not str(name).isidentifier() or name in own:
                raise SceneError(f"UserLaw: a value cannot have the name {name!r}")
            self._check(name, value)
        self._check("jump", self.jump)
        object.__setattr__(self, "values", dict(self.values))

    @property
    def label(self) -> str:
        """Name for messages."""
        return self.name or str(getattr(self.force or self.resolve, "__name__", "compiled"))

    def parameters(self) -> dict[str, Any]:
        return {**self.values, "jump": self.jump}

    def with_(self, **changes: Any) -> Self:
        values = {k: changes.pop(k, value) for k, value in self.values.items()}
        return super().with_(values=values, **changes)

    def _changed(self, changes: dict[str, Any]) -> Self:
        return self.with_(**changes) if changes else self

    def holds(self, dim: int) -> tuple[bool, ...]:
        return (True,) + (self.components == "all",) * (dim - 1)


@dataclass(frozen=True, repr=False)
class Displacement(Law):
    """Prescribed displacement of a face: w_1 = value in the named global components.

    Parameters
    ----------
    value
        Length.  A vector of d global components (those that are not named are ignored), a callable
        x (m, d) -> (m, d), or a number for all named components.
    components
        Global axes (0 = x) that are prescribed; None: all.
    """

    value: Any = 0.0
    components: tuple[int, ...] | None = None
    sides: ClassVar[tuple[int, ...]] = (1,)
    loading: ClassVar[tuple[str, ...]] = ("value",)

    def __post_init__(self) -> None:
        self._check("value", self.value)
        if self.components is not None:
            try:
                components = tuple(int(c) for c in np.atleast_1d(np.asarray(self.components)))
            except (TypeError, ValueError, OverflowError):
                components = ()
            if not components or len(set(components)) < len(components) or min(components) < 0:
                raise SceneError(
                    f"Displacement: components = {self.components!r}; name different axes, 0 = x"
                )
            object.__setattr__(self, "components", components)

    def parameters(self) -> dict[str, Any]:
        return {"value": self.value}

    def axes(self, dim: int) -> tuple[int, ...]:
        """The prescribed global components in `dim` dimensions."""
        return tuple(range(dim)) if self.components is None else self.components


@dataclass(frozen=True, repr=False)
class Symmetry(Law):
    """Frictionless symmetry plane: w_1 . n = 0, no tangential force."""

    sides: ClassVar[tuple[int, ...]] = (1,)

    def holds(self, dim: int) -> tuple[bool, ...]:
        return (True,) + (False,) * (dim - 1)


@dataclass(frozen=True, repr=False)
class Pressure(Law):
    """Pressure on a face: f_1 = -p n, force / area."""

    p: Any = 0.0
    sides: ClassVar[tuple[int, ...]] = (1,)
    loading: ClassVar[tuple[str, ...]] = ("p",)

    def __post_init__(self) -> None:
        self._check("p", self.p)

    def parameters(self) -> dict[str, Any]:
        return {"p": self.p}

    def holds(self, dim: int) -> tuple[bool, ...]:
        return (False,) * dim


@dataclass(frozen=True, repr=False)
class Traction(Law):
    """Force per area on a face: f_1 = t, a vector of d global components or x (m, d) -> (m, d)."""

    t: Any = 0.0
    sides: ClassVar[tuple[int, ...]] = (1,)
    loading: ClassVar[tuple[str, ...]] = ("t",)

    def __post_init__(self) -> None:
        self._check("t", self.t)

    def parameters(self) -> dict[str, Any]:
        return {"t": self.t}

    def holds(self, dim: int) -> tuple[bool, ...]:
        return (False,) * dim
