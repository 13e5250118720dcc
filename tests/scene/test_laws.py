"""The record of a law: laws that only this file knows go everywhere, and no array of a user is shared."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt
import pytest

import dolfinx_frontend as lf
from dolfinx_frontend.reference import monolithic, ssfem
from dolfinx_frontend.scene.laws import Elimination, Fields, Functions, Points, resolve

Array = npt.NDArray[np.float64]
TIGHT = lf.Options(rtol=1e-11, max_iterations=500)
E, DEPTH = 100.0, 1.0


# --- two laws of this file --------------------------------------------------------------------------


@dataclass(frozen=True, repr=False)
class Bedding(lf.Law):
    """A face on soil: f_n = soil (j_n - lift), free along it. Linear, so that it can be assembled."""

    soil: Any
    lift: Any = 0.0
    sides: ClassVar[tuple[int, ...]] = (1,)
    loading: ClassVar[tuple[str, ...]] = ("lift",)
    linear: ClassVar[bool] = True
    elimination: ClassVar[Elimination | None] = Elimination.SPRINGS
    kernel_names: ClassVar[Mapping[str, str]] = {"soil": "normal", "lift": "jump"}
    not_negative: ClassVar[tuple[str, ...]] = ("soil",)
    spans: ClassVar[Mapping[str, slice]] = {"soil": slice(0, 1)}
    search_direction: ClassVar[Literal["parts", "patch", "springs"]] = "springs"

    def parameters(self) -> dict[str, Any]:
        return {"soil": self.soil, "lift": self.lift}

    def count(self, dim: int) -> int:
        return 1

    def stiffnesses(self, points: Points) -> Array:
        out = super().stiffnesses(points)
        out[:, :1] = resolve(self.soil, points, 1, name="soil")
        return out

    def jumps(self, points: Points) -> Array:
        return resolve(self.lift, points, points.dim, "first", "lift")

    def fields(self, points: Points, time: float | None = None) -> Fields:
        kappa = self.stiffnesses(points)
        values = {"normal": kappa[:, :1], "tangential": kappa[:, 1:2], "jump": self.imposed(points)}
        return Fields("elastic", 1, self.rows(points), values)

    def holds(self, dim: int) -> tuple[bool, ...]:
        return (True,) + (False,) * (dim - 1)


def stiffening(jump: Array, *, stiffness: Array) -> Array:
    return stiffness[:, None] * jump * (1.0 + jump**2)


@dataclass(frozen=True, repr=False)
class Rubber(lf.Law):
    """f = stiffness (j + j^3) in every component: a law that the kernel does not know by name."""

    stiffness: Any
    search_direction: ClassVar[Literal["parts", "patch", "springs"]] = "patch"
    not_negative: ClassVar[tuple[str, ...]] = ("stiffness",)

    def parameters(self) -> dict[str, Any]:
        return {"stiffness": self.stiffness}

    def fields(self, points: Points, time: float | None = None) -> Fields:
        stiffness = resolve(self.stiffness, points, 1, name="stiffness")
        values = {"stiffness": stiffness, "jump": self.imposed(points)}
        return Fields("user rubber", points.dim, self.rows(points), values)

    @property
    def functions(self) -> Functions | None:
        return Functions("rubber", ("stiffness",), force=stiffening)


def on_ground(law: lf.Law, load: Any = -1.0) -> lf.Problem:
    """A block on a law, pressed down: f_n = load everywhere."""
    scene = lf.Scene()
    scene.substructure("block", lf.geometry.box((1.0, DEPTH), (2, 2)), lf.LinearElastic(E, 0.0), degree=1)
    scene.interface("ground", "block:y0", law)
    scene.symmetry("block:x0", name="mirror")
    scene.pressure("block:y1", 1.0, name="weight")
    return lf.assemble(scene)


def two(law: lf.Law, pull: Any = (1.0, 0.2), extra: Callable[[lf.Scene], None] | None = None) -> lf.Problem:
    """Two squares with a law between them; the left one is held, the right one pulled."""
    scene = lf.Scene()
    for name, x0 in (("left", 0.0), ("right", 1.0)):
        box = lf.geometry.box((1.0, 1.0), (2, 2), origin=(x0, 0.0))
        scene.substructure(name, box, lf.LinearElastic(E, 0.3), degree=1)
    scene.interface("layer", "left:x1", "right:x0", law)
    scene.fix("left:x0", name="wall")
    if pull is not None:
        scene.traction("right:x1", pull, name="pull")
    if extra is not None:
        extra(scene)
    return lf.assemble(scene)


def test_a_linear_law_of_this_file_goes_everywhere() -> None:
    own, known = on_ground(Bedding(20.0)), on_ground(lf.Elastic(normal=20.0))
    assert str(lf.make_plan(own)) == str(lf.make_plan(known))
    assert "springs assembled" in str(lf.make_plan(own))
    for active in (None, ["ground"]):
        result, same = (lf.solve(p, active=active, options=TIGHT) for p in (own, known))
        assert np.allclose(result.displacements["block"], same.displacements["block"], rtol=1e-9)
        assert np.allclose(result.force("ground"), -1.0)  # pressed
        assert np.allclose(result.jump("ground"), -1.0 / 20.0)
    assert np.allclose(monolithic(own).u["block"], monolithic(known).u["block"])
    assert "Bedding" in str(result.table()) and "Bedding" in str(own)
    surface = lf.sweep(own, {"ground.soil": [10.0, 40.0]}, progress=False)
    assert np.allclose(np.ravel(surface.jump("ground")).reshape(2, -1), [[-0.1], [-0.025]])


def test_a_linear_law_of_this_file_may_be_random() -> None:
    soil = lf.Uniform("soil", 10.0, 40.0)
    own, known = on_ground(Bedding(soil)), on_ground(lf.Elastic(normal=soil))
    chaos, same = (lf.solve(p, chaos=lf.Chaos(order=4), options=TIGHT) for p in (own, known))
    assert np.allclose(chaos.jump_coefficients("ground"), same.jump_coefficients("ground"), atol=1e-12)
    exact = ssfem(own, lf.Chaos(order=4))
    assert np.allclose(exact.coefficients["block"], ssfem(known, lf.Chaos(order=4)).coefficients["block"])
    drawn = lf.monte_carlo(own, 5, seed=1, progress=False)
    values = drawn.random.space.values(drawn.random.source("ground", "soil"), drawn.germs)
    assert np.allclose(drawn.jump("ground").reshape(5, -1), -1.0 / np.reshape(values, (5, 1)))
    with pytest.raises(lf.SceneError, match="'ground'.*negative soil"):
        lf.monte_carlo(on_ground(Bedding(lf.Uniform("soil", -10.0, 30.0))), 20, progress=False)


def test_a_nonlinear_law_of_this_file_goes_everywhere() -> None:
    own = two(Rubber(50.0))
    known = two(lf.UserLaw(force=stiffening, values={"stiffness": 50.0}))
    assert str(lf.make_plan(own)) == str(lf.make_plan(known)) and "nonlinear" in str(lf.make_plan(own))
    result, same = (lf.solve(p, options=TIGHT) for p in (own, known))
    assert result.converged and np.allclose(result.force("layer"), same.force("layer"), rtol=1e-9)
    jump = result.jump("layer")
    assert np.allclose(result.force("layer"), 50.0 * (jump + jump**3), atol=1e-9)
    assert "Rubber" in str(result.table())
    surface = lf.sweep(own, {"layer.stiffness": [25.0, 50.0]}, options=TIGHT, progress=False)
    assert np.allclose(surface.jump("layer").reshape(2, *jump.shape)[1], jump, rtol=1e-8)


def test_a_nonlinear_law_of_this_file_may_be_random() -> None:
    own = two(Rubber(lf.Uniform("k", 40.0, 60.0)))
    drawn = lf.monte_carlo(own, 4, seed=1, progress=False, options=TIGHT)
    values = np.reshape(
        drawn.random.space.values(drawn.random.source("layer", "stiffness"), drawn.germs), (4, 1, 1)
    )
    jump = drawn.jump("layer")
    assert np.allclose(drawn.force("layer"), values * (jump + jump**3), atol=1e-8)
    options = lf.Options(rtol=1e-9, max_iterations=300)
    chaos = lf.solve(own, chaos=lf.Chaos(order=3, tolerance=0.5), options=options)
    assert np.allclose(chaos.sample(drawn.germs).jump("layer"), jump, rtol=1e-3, atol=1e-5)
    with pytest.raises(lf.SceneError, match="'layer'.*negative stiffness"):
        lf.monte_carlo(two(Rubber(lf.Uniform("k", -1.0, 3.0))), 20, seed=1, progress=False)


def test_a_value_may_not_hide_a_question() -> None:
    with pytest.raises(TypeError, match="Heavy: every law has a 'load'"):

        class Heavy(lf.Law):
            load: float

    with pytest.raises(lf.SceneError, match="'layer'.*no law for Law"):
        lf.solve(two(lf.Law(), extra=lambda scene: scene.fix("right:x1", name="end"), pull=None))


# --- the record of the built-in laws ----------------------------------------------------------------

LAWS = (
    lf.Perfect(),
    lf.Elastic(normal=2.0),
    lf.Elastic(tangential=2.0, jump=-0.1),
    lf.Contact(),
    lf.Contact(friction=0.2),
    lf.Contact(friction=0.2, stiffness=3.0, tangential_stiffness=2.0),
    lf.Debonding(normal=2.0, strength=1.0, opening=3.0),
    lf.Preload(force=1.0),
    lf.UserLaw(force=stiffening, values={"stiffness": 1.0}),
    lf.UserLaw(force=stiffening, values={"stiffness": 1.0}, components="normal"),
    lf.Displacement(0.0, components=(1,)),
    lf.Symmetry(),
    lf.Pressure(1.0),
    lf.Traction((1.0, 2.0)),
)


@pytest.fixture(scope="module")
def points() -> lf.Interface:
    return two(lf.Perfect()).interfaces["layer"]


@pytest.mark.parametrize("law", LAWS, ids=repr)
def test_a_record_agrees_with_itself(law: lf.Law, points: lf.Interface) -> None:
    fields = law.fields(points)
    m, d = points.num_points, points.dim
    assert fields.components == law.count(d) and fields.frames.shape == (m * law.count(d), d)
    linear = fields.kind in ("perfect", "elastic", "force")
    assert law.linear == linear == law.superposes == (law.elimination is not None)
    assert (law.functions is not None) == fields.kind.startswith("user ")
    assert (law.prescribes == "jump") == (fields.kind == "perfect")
    assert (law.prescribes == "force") == (fields.kind == "force")
    assert law.springs == (fields.kind == "elastic") == bool(law.spans)
    assert set(law.loading) <= set(law.parameters())
    assert set(law.inverse) <= {"stiffness", "tangential_stiffness"}
    names = {law.kernel_name(name) for name in law.parameters()}
    assert names <= set(fields.parameters)
    assert law.held_rows(points).shape[::2] == (m, d)
    assert law.removed(d) == (law.count(d) if law.prescribes == "jump" else 0)
    if law.load(points) is not None:
        assert law.load(points).shape == (m, d)  # type: ignore[union-attr]


# --- arrays of the user -----------------------------------------------------------------------------


@pytest.mark.parametrize("active", [None, ["layer"]])
def test_a_stiffness_is_copied(active: list[str] | None) -> None:
    kappa = np.full(two(lf.Perfect()).interfaces["layer"].num_points, 30.0)
    problem = two(lf.Elastic(normal=kappa, tangential=10.0))
    result = lf.solve(problem, active=active)
    force, moved = result.force("layer").copy(), result.displacements["right"].copy()
    kappa *= 2.0
    assert np.array_equal(result.force("layer"), force)
    assert np.array_equal(lf.solve(problem, active=active).displacements["right"], moved)


def test_a_gap_is_copied() -> None:
    gap = np.zeros(two(lf.Contact(friction=1.0)).interfaces["layer"].num_points)
    bed = lf.Elastic(normal=1.0, tangential=1.0)
    law = lf.Contact(gap=gap, stiffness=100.0)
    problem = two(law, (-1.0, 0.0), lambda scene: scene.interface("bed", "right:x1", bed))
    result = lf.solve(problem)
    before = str(result.table())
    gap -= 0.05
    assert str(result.table()) == before


def test_loads_and_supports_are_copied() -> None:
    pull, law = np.array([1.0, 0.2]), lf.Elastic(normal=30.0, tangential=10.0)
    result = lf.solve(two(law, pull))
    before, force = str(result.table("pull")), result.force("pull").copy()
    pull *= 5.0
    assert str(result.table("pull")) == before and np.array_equal(result.force("pull"), force)
    grip = np.array([0.01, 0.0])
    problem = two(law, None, lambda scene: scene.fix("right:x1", grip, name="grip"))
    first, late = lf.solve(problem), lf.solve(problem)
    table, moved = str(first.table()), first.displacements["right"].copy()
    grip *= 3.0
    assert str(first.table()) == table
    assert np.array_equal(late.displacements["right"], moved)  # recovered only now
    assert np.array_equal(lf.solve(problem).displacements["right"], moved)


def test_a_body_force_is_copied() -> None:
    for amplitude in (None, lf.Amplitude([0.0, 1.0], [0.0, 1.0])):
        weight = np.array([0.0, -1.0])
        scene = lf.Scene()
        given = weight if amplitude is None else amplitude * weight
        square = lf.geometry.box((1.0, 1.0), (2, 2))
        scene.substructure("a", square, lf.LinearElastic(E, 0.3), degree=1, body_force=given)
        scene.fix("a:x0")
        weight *= 7.0
        part = lf.assemble(scene).substructures["a"]
        load = part.load if amplitude is None else part.varying_loads[amplitude]
        assert load[1::2].sum() == pytest.approx(-1.0)


def test_values_of_functions_and_amplitudes_are_copied() -> None:
    values, rows = {"stiffness": 50.0}, np.full(4, 50.0)
    law = lf.UserLaw(force=stiffening, values=values)
    values["stiffness"] = 1.0
    assert law.values["stiffness"] == 50.0
    law = lf.UserLaw(force=stiffening, values={"stiffness": rows})
    steps, factors, vector, row = np.array([0.0, 1.0]), np.array([0.0, 1.0]), np.array([1.0, 2.0]), [3.0, 4.0]
    load = lf.Traction(lf.Amplitude(steps, factors) * vector + row)
    for array in (rows, steps, factors, vector):
        array *= 9.0
    row[0] = 0.0
    assert np.array_equal(law.values["stiffness"], np.full(4, 50.0))
    (amplitude, moving), (_, constant) = load.t.terms
    assert amplitude(0.5) == 0.5 and np.array_equal(moving, [1.0, 2.0]) and constant == (3.0, 4.0)
    with pytest.raises(ValueError, match="read-only"):
        moving[0] = 5.0


def test_times_are_copied() -> None:
    times = np.array([0.5, 1.0])
    push = lf.Amplitude([0, 1], [0, 1]) * (-0.01, 0.002)
    problem = two(lf.Contact(friction=0.3), None, lambda scene: scene.fix("right:x1", push, name="grip"))
    result = lf.solve(problem, times=times)
    times *= 2.0
    assert result.plan.times is not None and np.array_equal(result.plan.times, [0.5, 1.0])


def test_axes_and_directions_are_copied() -> None:
    stiffness, law = np.array([10.0, 20.0]), lf.Elastic(normal=30.0, tangential=10.0)
    surface = lf.sweep(two(law), {"layer.normal": stiffness}, progress=False)
    given = {"layer": np.full(4, 50.0)}
    direction = lf.Direction(given=given)
    stiffness *= 2.0
    given["layer"] *= 2.0
    given.clear()
    assert np.array_equal(surface.axes["layer.normal"], [10.0, 20.0])
    assert np.array_equal(direction.given["layer"], np.full(4, 50.0))


def test_a_copy_is_made_once() -> None:
    law = lf.Elastic(normal=np.ones(3))
    assert dataclasses.replace(law, jump=1.0).normal is law.normal
