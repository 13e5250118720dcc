"""A law of the user, given by functions."""

from __future__ import annotations

import dataclasses
import pickle
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, Self, SupportsIndex

import numpy.typing as npt

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import check_kind, checked_name
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.frozen import by_value
from dolfinx_frontend.scene.laws.base import Fields, Functions, Law, Points, resolve

__all__ = ["UserLaw"]


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
        With `history` it takes ``steps``, too: this many columns follow each other in time.
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
    search_direction: ClassVar[Literal["parts", "patch", "springs"]] = "patch"

    def validate(self) -> None:
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
        if not isinstance(self.components, str) or self.components not in ("all", "normal"):
            raise SceneError(f"UserLaw: components = {self.components!r}; give 'all' or 'normal'")
        check_kind("UserLaw", "values", self.values, Mapping, "give {name: value}")
        if self.name is not None:
            checked_name("UserLaw", self.name)
        own = {f.name for f in dataclasses.fields(self)} | {"flexibility", "steps"}
        for name, value in self.values.items():
            if not str(name).isidentifier() or name in own:
                raise SceneError(f"UserLaw: a value cannot have the name {name!r}")
            self.check_value(name, value)
        self.check_value("jump", self.jump)

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

    def count(self, dim: int) -> int:
        return 1 if self.components == "normal" else dim

    def jumps(self, points: Points) -> Array:
        return resolve(self.jump, points, points.dim, "first", "jump")

    def fields(self, points: Points, time: float | None = None) -> Fields:
        parameters = {name: resolve(value, points, 1, name=name) for name, value in self.values.items()}
        parameters["jump"] = self.imposed(points)
        return Fields(f"user {self.label}", self.count(points.dim), self.rows(points), parameters)

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self

    def __reduce_ex__(self, protocol: SupportsIndex) -> Any:
        for name in ("force", "resolve", "tangent", "compiled"):
            try:
                pickle.dumps(getattr(self, name))
            except Exception as error:
                if by_value():
                    break
                raise pickle.PicklingError(
                    f"UserLaw {self.label!r}: its {name} cannot be pickled ({error}): give a function of a "
                    "module, by name, instead of a lambda or one inside another function"
                ) from error
        return super().__reduce_ex__(protocol)

    @property
    def functions(self) -> Functions | None:
        return Functions(
            label=self.label,
            values=tuple(self.values),
            force=self.force,
            resolve=self.resolve,
            compiled=self.compiled,
            tangent=self.tangent,
            history=self.history,
        )

    def holds(self, dim: int) -> tuple[bool, ...]:
        return (True,) + (self.components == "all",) * (dim - 1)
