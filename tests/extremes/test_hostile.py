"""Hostile input: whatever the public API is given, it answers or raises an error of its own.

Values are drawn by Hypothesis, always the same ones (``derandomize``): a failure is one for everybody.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

pytest.importorskip("hypothesis")

from hypothesis import HealthCheck, Phase, given, settings  # noqa: E402
from hypothesis import strategies as st  # noqa: E402

import dolfinx_frontend as api  # noqa: E402
from dolfinx_frontend.common.errors import SceneError  # noqa: E402
from dolfinx_frontend.kernel.solver import Solver  # noqa: E402
from dolfinx_frontend.uncertainty.space import RandomSpace  # noqa: E402
from latin_core import NumericalError, Options, State, _core  # noqa: E402
from tests.extremes import cases  # noqa: E402


def examples(count: int) -> Any:
    """Settings of a property."""
    return settings(
        max_examples=count,
        deadline=None,
        derandomize=True,
        database=None,
        phases=[Phase.explicit, Phase.generate],
        suppress_health_check=list(HealthCheck),
    )


NUMBERS = st.one_of(
    st.floats(),
    st.integers(-(10**30), 10**30),
    st.sampled_from([0.0, -0.0, 1e-320, 1e308, -1.0, 0.5, 1.0, 2, True, np.float32(0.1), np.int64(3)]),
)
JUNK = st.one_of(
    st.none(),
    st.text(max_size=3),
    st.binary(max_size=2),
    st.complex_numbers(),
    st.lists(st.floats(), max_size=4),
    st.tuples(st.floats(), st.text(max_size=1)),
    st.dictionaries(st.text(max_size=1), st.floats(), max_size=1),
    st.sampled_from([object(), float, np.zeros((0, 2)), np.array(["a"]), np.full((2, 2), np.nan)]),
    st.just([[1], [2, 3]]),
)
ANY = st.one_of(NUMBERS, NUMBERS, JUNK)


def attempt(call: Callable[[], Any], *values: Any) -> Any:
    """What a call returns, or None if it refuses.

    A number is refused in the words of the project (SceneError, or ValueError of the settings, which name
    the thing and the value); what is no number at all may end in Python's own TypeError or ValueError.
    """
    numbers = all(isinstance(v, (int, float, np.number)) for v in values)
    own = (SceneError, NumericalError, _core.InputError)
    allowed = own if numbers else (*own, TypeError, ValueError, OverflowError, AttributeError)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return call()
        except allowed as error:
            assert str(error), repr(error)
            return None


# ---------------------------------------------------------------------------------------------
# Records: laws, materials, random parameters, amplitudes, settings
# ---------------------------------------------------------------------------------------------
LAWS = {
    "Perfect": ("jump",),
    "Elastic": ("normal", "tangential", "jump"),
    "Contact": ("gap", "friction", "threshold", "stiffness", "tangential_stiffness", "jump"),
    "Debonding": ("normal", "tangential", "strength", "opening", "energy", "jump"),
    "Preload": ("force", "until", "during"),
    "Displacement": ("value", "components"),
    "Pressure": ("p",),
    "Traction": ("t",),
}


@pytest.mark.parametrize("name", LAWS)
@examples(150)
@given(data=st.data())
def test_laws(name: str, data: st.DataObject) -> None:
    values = {key: data.draw(ANY, key) for key in LAWS[name] if data.draw(st.booleans())}
    if name == "Preload":
        values.setdefault("force", 1.0)
    if name == "Debonding":
        values.setdefault("normal", 1.0)
    law = attempt(lambda: getattr(api, name)(**values), *values.values())
    if law is None:
        return
    sides = 1 if 2 not in law.sides else 2
    attempt(lambda: scene_with(law, sides), *values.values())


def scene_with(law: Any, sides: int) -> Any:
    """Assemble two blocks with a law between them or on one of them."""
    scene = api.Scene()
    for i in (0, 1):
        part = api.geometry.box((1.0, 1.0), (1, 1), origin=(0.0, float(i)))
        scene.substructure(f"p{i}", part, api.LinearElastic(1.0, 0.3), degree=1)
        scene.fix(f"p{i}:x0")
    faces = ("p0:y1", "p1:y0")[:sides]
    scene.interface("j", *faces, law)
    problem = api.assemble(scene)
    return api.make_plan(problem)


@examples(200)
@given(E=ANY, nu=ANY, plane=st.one_of(st.sampled_from(["strain", "stress"]), JUNK))
def test_materials(E: Any, nu: Any, plane: Any) -> None:
    material = attempt(lambda: api.LinearElastic(E, nu, plane), E, nu)
    if material is None:
        return
    scene = api.Scene()
    attempt(lambda: scene.substructure("a", api.geometry.box((1.0, 1.0), (1, 1)), material, degree=2), E, nu)
    if scene.substructures:
        scene.fix("a:x0")
        scene.traction("a:x1", (1.0, 0.0))
        problem = attempt(lambda: api.assemble(scene), E, nu)
        if problem is not None:
            result = attempt(lambda: api.solve(problem), E, nu)
            assert result is None or np.all(np.isfinite(result.displacements["a"]))


@pytest.mark.parametrize("name", ["Normal", "TruncatedNormal", "LogNormal", "Uniform", "Gamma"])
@examples(100)
@given(mean=ANY, cov=ANY)
def test_random_parameters(name: str, mean: Any, cov: Any) -> None:
    call = getattr(api, name)
    keys = {"mean": mean, "cov": cov}
    parameter = attempt(lambda: call("k", **keys), mean, cov)
    if parameter is not None:
        assert np.isfinite(parameter.mean) and 0.0 < parameter.std < np.inf


@examples(150)
@given(a=ANY, b=ANY, lower=ANY, upper=ANY)
def test_beta_and_uniform(a: Any, b: Any, lower: Any, upper: Any) -> None:
    for call in (lambda: api.Beta("b", a, b, lower, upper), lambda: api.Uniform("u", lower, upper)):
        parameter = attempt(call, a, b, lower, upper)
        if parameter is not None:
            assert np.isfinite(parameter.mean) and 0.0 < parameter.std < np.inf


@examples(100)
@given(samples=ANY)
def test_samples(samples: Any) -> None:
    parameter = attempt(lambda: api.FromSamples("s", samples), samples)
    if parameter is not None:
        assert np.isfinite(parameter.mean) and 0.0 < parameter.std < np.inf


@examples(150)
@given(data=st.data())
def test_chaos_settings(data: st.DataObject) -> None:
    keys = ("order", "index_set", "q", "weights", "max_interaction", "quadrature", "sobol_points")
    values = {key: data.draw(ANY, key) for key in keys if data.draw(st.booleans())}
    values.setdefault("order", 2)
    chaos = attempt(lambda: api.Chaos(**values), *(None if v is None else v for v in values.values()))
    if chaos is not None and chaos.order <= 5:
        space = RandomSpace([api.Uniform("u", 1.0, 2.0), api.LogNormal("l", 1.0, cov=0.2)])
        attempt(lambda: space.basis(chaos), *values.values())


@examples(150)
@given(times=ANY, values=ANY)
def test_amplitudes(times: Any, values: Any) -> None:
    amplitude = attempt(lambda: api.Amplitude(times, values), times, values)
    if amplitude is not None and not callable(times):
        attempt(lambda: amplitude(0.5), times, values)


@examples(150)
@given(lengths=st.one_of(ANY, st.lists(NUMBERS, min_size=1, max_size=4)),
       divisions=st.one_of(ANY, st.lists(st.one_of(st.integers(-2, 3), NUMBERS), min_size=1, max_size=4)),
       cell=st.one_of(st.none(), JUNK, st.sampled_from(["triangle", "hexahedron", "quadrilateral"])))
def test_boxes(lengths: Any, divisions: Any, cell: Any) -> None:
    attempt(lambda: api.geometry.box(lengths, divisions, cell=cell), None)


# ---------------------------------------------------------------------------------------------
# Scenes
# ---------------------------------------------------------------------------------------------
PART = api.geometry.box((1.0, 1.0), (1, 1))


@examples(200)
@given(name=ANY, degree=ANY, force=ANY, face=ANY, other=ANY, law=ANY)
def test_scenes(name: Any, degree: Any, force: Any, face: Any, other: Any, law: Any) -> None:
    scene = api.Scene()
    steel = api.LinearElastic(1.0, 0.3)
    attempt(lambda: scene.substructure(name, PART, steel), name)
    attempt(lambda: scene.substructure("a", PART, steel, degree=degree), degree)
    attempt(lambda: scene.substructure("b", PART, steel, body_force=force), None)
    attempt(lambda: scene.substructure("c", face, steel), None)
    attempt(lambda: scene.substructure("d", PART, law), None)
    attempt(lambda: scene.interface("i", face, other, law), None)
    attempt(lambda: scene.interface(name, "a:x0", "b:x0", api.Perfect()), None)
    attempt(lambda: scene.interface("k", "a:x0", "b:x0", api.Perfect(), quadrature_degree=degree), degree)
    attempt(lambda: scene.interface("l", "a:x0", "b:x0", api.Perfect(), max_distance=degree), None)
    attempt(lambda: scene.interface("m", "a:x0", "b:x0", api.Perfect(), space=law, overlap=other), None)
    for call in (scene.symmetry, scene.fix):
        attempt(lambda c=call: c(face), None)
    attempt(lambda: scene.pressure(face, force), None)
    attempt(lambda: scene.fix("a:x1", force, components=degree), None)


@pytest.fixture(scope="module")
def joined() -> Any:
    """Two blocks with springs."""
    return cases.stack([api.Elastic(cases.E, cases.E)])


@pytest.fixture(scope="module")
def uncertain() -> Any:
    """Two blocks with random springs."""
    return cases.stack([api.Elastic(normal=api.LogNormal("k", cases.E, cov=0.2))])


SETTINGS = tuple(Options.__dataclass_fields__)


@examples(200)
@given(data=st.data())
def test_settings_of_the_iteration(joined: Any, data: st.DataObject) -> None:
    key = data.draw(st.sampled_from(SETTINGS))
    value = data.draw(ANY, key)
    # an iteration without end is what was asked for
    huge = isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) > 1e4
    if huge and key in ("max_iterations", "acceleration", "stagnation_window", "snapshots", "together"):
        return
    result = attempt(
        lambda: api.solve(joined, active="all", options=Options(**{key: value})), None
    )
    if result is not None and result.converged and key not in ("rtol", "criterion"):
        assert cases.stack_error(result, [cases.PULL / cases.E]) < 1e-4


@examples(150)
@given(method=ANY, active=ANY, times=ANY, direction=ANY, chaos=ANY)
def test_arguments_of_solve(
    joined: Any, uncertain: Any, method: Any, active: Any, times: Any, direction: Any, chaos: Any
) -> None:
    options = Options(max_iterations=20)
    directed = {"direction": direction, "active": "all"}
    for how in ({"method": method}, {"active": active}, {"times": times}, directed):
        attempt(lambda h=how: api.solve(joined, **h, options=options), None)
    small = not (isinstance(chaos, (int, float)) and chaos == chaos and abs(chaos) > 8)
    if small and chaos is not None:
        attempt(lambda: api.solve(uncertain, chaos=chaos, options=options), None)


@examples(100)
@given(
    values=ANY,
    key=st.one_of(st.sampled_from(["j0.normal", ("j0.normal", "j0.tangential")]), st.text(max_size=4)),
)
def test_sweeps(joined: Any, values: Any, key: Any) -> None:
    options = Options(max_iterations=20)
    attempt(lambda: api.sweep(joined, {key: values}, progress=False, options=options), None)


# ---------------------------------------------------------------------------------------------
# Scenes that are right: closed forms over wide ranges
# ---------------------------------------------------------------------------------------------
POWERS = st.floats(-6.0, 6.0)


@examples(60)
@given(a=POWERS, b=POWERS, k=POWERS, pull=POWERS, nu=st.floats(-0.9, 0.44), cut=st.booleans())
def test_any_stack(a: float, b: float, k: float, pull: float, nu: float, cut: bool) -> None:
    """Any moduli, stiffness and load: the closed form, as far as conditioning allows."""
    moduli, kappa, load = [10.0**a, 10.0**b], 10.0**k, 10.0**pull
    problem = cases.stack([api.Elastic(normal=kappa)], moduli, nu=nu, pull=load)
    result = api.solve(problem, active="all" if cut else None, options=cases.TIGHT)
    if not result.converged:
        assert result.status == "inexact" or (cut and result.status == "undecided")
    span = max(*moduli, kappa) / min(*moduli, kappa)
    bound = cases.ROUND * cases.EPS * (1.0 + span) / (1.0 - 2.0 * nu) / (1.0 + nu) + cases.LEFT * cut
    error = cases.stack_error(result, [load / kappa], moduli, nu, pull=load, whole=cut)
    said = 0.0 if result.converged else 3.0 * result.error
    assert error <= max(bound, said), (error, bound, result.error)


@examples(60)
@given(gap=st.floats(-1e-3, 1e-3), press=st.floats(0.0, 1e-3))
def test_any_gap(gap: float, press: float) -> None:
    """Closed or open, whatever gap and displacement: the pressure is (E / 2) <press - gap>."""
    try:
        result, error, bound = cases.closing(gap, press)
    except SceneError as refusal:
        assert "range of numbers" in str(refusal) and press < 1e-129 and gap > -1e-129
        return
    assert result.converged and error <= bound
    force, jump = result.force("joint"), result.jump("joint")
    assert np.all(force <= 0.0) and np.all(jump + gap >= -1e-9 * max(abs(gap), press, 1e-300))


@examples(40)
@given(share=st.floats(0.0, 3.0), stiff=st.booleans())
def test_any_bolt(share: float, stiff: bool) -> None:
    try:
        result, error, bound = cases.bolted(share, stiff)
    except SceneError as refusal:
        assert "range of numbers" in str(refusal) and 0.0 < share < 1e-125
        return
    # at share 0 on a rigid joint the answer is right, but its estimate does not know (undecided)
    assert result.status in ("converged", "inexact", "undecided")
    assert error <= bound, (result, error, bound)


# ---------------------------------------------------------------------------------------------
# The kernel of a result, and an interrupt within an estimate
# ---------------------------------------------------------------------------------------------
def joined_blocks(law: Any, n: int = 4) -> Any:
    """Two blocks with a layer between them, pulled."""
    scene = api.Scene()
    for name, x0 in (("left", 0.0), ("right", 1.0)):
        part = api.geometry.box((1.0, 1.0), (n, n), origin=(x0, 0.0))
        scene.substructure(name, part, api.LinearElastic(E=100.0, nu=0.3), degree=1)
    scene.interface("layer", "left:x1", "right:x0", law)
    scene.fix("left:x0", name="wall")
    scene.traction("right:x1", (1.0, 0.2), name="pull")
    return api.assemble(scene)


def test_what_is_not_of_this_problem() -> None:
    """States, laws, plans and numbers of another one, from the solver of a result: named, never used."""
    quiet: dict[str, Any] = {"progress": False}
    problem = joined_blocks(api.Elastic(normal=30.0, tangential=10.0))
    result = api.solve(problem, active=["layer"], **quiet)
    other = api.solve(joined_blocks(api.Elastic(normal=1.0, tangential=1.0), 2), active=["layer"], **quiet)
    solver, laws, rows = result.solver, result.laws, result.solver.rows
    tiny = State(np.zeros((1, 1)), np.zeros((1, 1)))
    many = {"layer": {"normal": np.ones((1, 3000))}}
    for call, told in (
        (lambda: solver.local_fields(laws, "layer", tiny), rf"state: it has shape \(1, 1\).*\({rows}, any\)"),
        (lambda: solver.local_fields(laws, "layr", result.state), "no active interface 'layr'"),
        (lambda: solver.displacements(laws, tiny, np.ones((1, 1))), r"state: it has shape \(1, 1\)"),
        (lambda: solver.displacements(laws, result.state, np.ones((5, 3))), r"amplitudes: .*\(5, 3\)"),
        (lambda: solver.global_stage(laws, np.zeros((1, 1)), np.ones((1, 1))), r"data: .*got \(1, 1\)"),
        (lambda: solver.local_fields(other.laws, "layer", result.state), "laws: they belong to another"),
        (lambda: solver.run(other.laws, Options(), np.ones((1, 1))), "laws: they belong to another"),
        (lambda: State(np.zeros((rows, 4000)), np.zeros((rows, 1))), "traces: shape"),
        (lambda: solver.local_fields(laws.with_(parameters=many), "layer", result.state), "3000 columns"),
    ):
        with pytest.raises(_core.InputError, match=told):
            call()
    for start in (tiny, other, State(np.zeros((rows, 2)), np.zeros((rows, 2))), "state"):
        with pytest.raises(SceneError, match="solve: start .*give a result of the same plan"):
            api.solve(problem, active=["layer"], start=start, **quiet)
    contact = joined_blocks(api.Contact(friction=0.3))
    with pytest.raises(SceneError, match="'layer': Contact cannot be eliminated"):
        api.solve(contact, plan=api.make_plan(problem), **quiet)


def test_any_start_leads_to_the_answer() -> None:
    problem = joined_blocks(api.Elastic(normal=30.0, tangential=10.0))
    tight: dict[str, Any] = {"active": ["layer"], "options": Options(rtol=1e-10), "progress": False}
    exact = api.solve(problem, **tight)
    data, traces = np.random.default_rng(0).normal(size=(2, exact.solver.rows, 1))
    found = api.solve(problem, start=State(data, traces), **tight)
    size = np.abs(exact.displacements["right"]).max()
    # twice the tolerance of each, relative to the answer
    assert np.abs(found.displacements["right"] - exact.displacements["right"]).max() < 4e-10 * size


def test_a_plan_that_fixes_what_is_random() -> None:
    """It gave a chaos whose variance is 0."""
    problem = joined_blocks(api.Elastic(normal=api.LogNormal("k", 30.0, cov=0.3), tangential=10.0))
    plan = api.make_plan(problem)
    told = "the plan eliminates 'layer', whose law is random: leave the plan out, or make it with vary="
    with pytest.raises(SceneError, match=f"chaos: {told}"):
        api.solve(problem, chaos=2, plan=plan, progress=False)
    with pytest.raises(SceneError, match=f"sampling: {told}"):
        api.monte_carlo(problem, 4, plan=plan, progress=False)
    plan = api.make_plan(problem, vary=["layer"])
    assert api.solve(problem, chaos=2, plan=plan, progress=False).moments("right")[1].max() > 0.0


@pytest.mark.parametrize("ends", [KeyboardInterrupt, MemoryError])
def test_errors_that_end_early(ends: type[BaseException], monkeypatch: pytest.MonkeyPatch) -> None:
    """Whichever of its runs ends: the result answers as before, and the next measurement is whole."""
    problem = joined_blocks(api.Elastic(normal=api.LogNormal("k", 30.0, cov=0.3), tangential=10.0))
    result = api.solve(problem, chaos=2, progress=False)
    force, table = result.force_coefficients("layer").copy(), str(result.table())
    sobol = str(result.sobol("layer"))
    whole = str(result.errors("layer"))
    run, done = Solver.run, [0]
    for last in range(1, 20):
        done[0] = 0

        def ended(self: Solver, *rest: Any, **named: Any) -> Any:
            out = run(self, *rest, **named)
            done[0] += 1
            if done[0] == last:  # noqa: B023
                raise ends
            return out

        monkeypatch.setattr(Solver, "run", ended)
        raised = False
        try:
            result.errors("layer")
        except ends:
            raised = True
        monkeypatch.setattr(Solver, "run", run)
        assert np.array_equal(result.force_coefficients("layer"), force)
        assert str(result.table()) == table and str(result.sobol("layer")) == sobol
        if not raised:
            break
    assert 1 < last < 19 and str(result.errors("layer")) == whole
