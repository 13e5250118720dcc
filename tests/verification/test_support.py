"""Parts that lose their support: closed forms of rigid statics, and linear programming as reference."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
from latin_core import Options
from scipy.optimize import linprog

import dolfinx_frontend as lf
from dolfinx_frontend import geometry
from dolfinx_frontend.assembly.assemble import assemble
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.errors import SceneError, SceneWarning
from dolfinx_frontend.evaluate import sampling
from dolfinx_frontend.evaluate.support import _Grip, _driven
from dolfinx_frontend.reference.galerkin import ssfem
from dolfinx_frontend.results.result import Result
from dolfinx_frontend.scene.amplitudes import Amplitude
from dolfinx_frontend.scene.laws import Contact, Elastic
from dolfinx_frontend.scene.materials import LinearElastic
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.solving import solve

SIDE = 10.0  # mm, cubes of steel
SHORT = Options(max_iterations=150)


def cube(
    scene: Scene,
    name: str,
    z: float = 0.0,
    divisions: Any = (2, 2, 2),
    nu: float = 0.3,
    body_force: Any = None,
) -> None:
    part = geometry.box((SIDE,) * 3, divisions, origin=(0.0, 0.0, z), cell="hexahedron")
    scene.substructure(name, part, LinearElastic(E=200e3, nu=nu), degree=1, body_force=body_force)


def on_the_floor(traction: Any, law: Contact, guided: bool = False, **options: Any) -> Scene:
    scene = Scene()
    cube(scene, "block", **options)
    scene.interface("floor", "block:z0", law)
    if guided:
        scene.symmetry(["block:x0", "block:y0"])
    scene.traction("block:z1", traction, name="load")
    return scene


def silently(scene: Scene, options: Options = SHORT) -> Result:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return solve(assemble(scene), options=options)


def lost(scene: Scene, *words: str) -> None:
    with pytest.raises(SceneError) as caught:
        solve(assemble(scene), options=SHORT)
    for word in ("no equilibrium", "lost its support", *words):
        assert word in str(caught.value), str(caught.value)


def test_block_pulled_off_a_frictionless_support() -> None:
    words = ("'block'", "translation along z", "'floor' opens everywhere", "scene.fix")
    lost(on_the_floor((0.0, 0.0, 5.0), Contact(), guided=True), *words)
    assert silently(on_the_floor((0.0, 0.0, -5.0), Contact(), guided=True)).converged


def test_the_smallest_pull_is_too_much() -> None:
    """Rounding does not count as a load; a millionth of the other loads does."""
    scene = on_the_floor((0.0, 0.0, 0.0), Contact(), guided=True)
    scene.traction("block:x1", (-100.0, 0.0, 1e-3), name="side")
    lost(scene, "translation along z")


@pytest.mark.parametrize("threshold", [None, 0.5])
@pytest.mark.parametrize("share", [0.5, 0.95, 1.05, 1.5])
def test_block_pushed_sideways(share: float, threshold: float | None) -> None:
    """It holds iff Q <= mu N + tau A; pushed in its middle, so that it does not tip."""
    push = share * (0.3 * 10.0 + (threshold or 0.0))
    law = Contact(friction=0.3, threshold=threshold)
    scene = on_the_floor((0.0, 0.0, -10.0), law, nu=0.0, body_force=(push / SIDE, 0.0, 0.0))
    if share > 1.0:
        lost(scene, "'block'", "translation along x", "'floor' slips")
    else:
        silently(scene, Options(max_iterations=400))


@pytest.mark.parametrize(("push", "holds"), [(4.5, True), (5.5, False)])
def test_block_that_tips(push: float, holds: bool) -> None:
    """Pushed at its top, which is as high as it is wide: it tips over if Q > N / 2."""
    scene = on_the_floor((push, 0.0, -10.0), Contact(friction=50.0), divisions=(8, 2, 4))
    if holds:
        # the resultant is at (0.5 + push / 10) of the width; quadrature points end at 1/2 - 1/sqrt(12)
        # of a facet from the edge
        assert 0.5 + push / 10.0 < 1.0 - (0.5 - 1 / np.sqrt(12)) / 8
        silently(scene, Options(max_iterations=30))
    else:
        lost(scene, "'block'", "rotation about y through", "'floor' opens on")


def clamped(shear: float, friction: float = 0.3, tangential: float | None = None) -> Scene:
    """Two blocks held together by a bolt with clearance; the upper one is sheared."""
    scene = Scene()
    cube(scene, "lower")
    cube(scene, "upper", SIDE)
    scene.fix("lower:z0")
    scene.interface("joint", "lower:z1", "upper:z0", Contact(friction=friction))
    bolt = Elastic(normal=1e3, tangential=tangential, jump=-0.01)  # 10 MPa of preload
    scene.interface("bolt", "lower:z1", "upper:z0", bolt)
    scene.traction("upper:z1", (shear, 0.0, 0.0), name="shear")
    return scene


def test_preload_that_does_not_hold_by_friction(caplog: pytest.LogCaptureFixture) -> None:
    """Rigid statics cannot exclude it, as the force of a bolt is not bounded: the final forces decide."""
    assert silently(clamped(2.8), Options(max_iterations=300)).converged
    with pytest.warns(SceneWarning, match="'upper' has lost its support.*along x: 'joint' slips.*preload"):
        result = solve(assemble(clamped(3.6)), options=SHORT)
    assert not result.converged
    # a bolt without clearance carries what friction does not
    silently(clamped(3.6, tangential=1e3))
    # far beyond the limit the best iterate may have flown so far that its forces are all but balanced
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", SceneWarning)
        assert not solve(assemble(clamped(0.5, friction=0.01)), options=SHORT).converged
    slips = any("'joint' slips" in str(each.message) for each in told)
    assert slips or "moved 'upper' by translation along x" in caplog.text


def test_preload_lost_is_no_support_lost() -> None:
    """TARGETS 2.6 beyond Q = K D: the joint is open, but the bolt still holds."""
    scene = Scene()
    cube(scene, "lower")
    cube(scene, "upper", SIDE)
    scene.fix("lower:z0")
    scene.interface("joint", "lower:z1", "upper:z0", Contact(stiffness=50.0))
    scene.interface("bolt", "lower:z1", "upper:z0", Elastic(normal=1e3, tangential=1e3, jump=-0.01))
    scene.traction("upper:z1", (0.0, 0.0, 15.0), name="pull")
    result = silently(scene, Options(max_iterations=300))
    assert result.converged and not np.any(result.force("joint"))


def gapped(load: float, gap: float = 0.01) -> Scene:
    scene = Scene()
    cube(scene, "lower")
    cube(scene, "upper", SIDE + gap)
    scene.fix("lower:z0")
    scene.symmetry(["upper:x0", "upper:y0"])
    scene.interface("joint", "lower:z1", "upper:z0", Contact())
    scene.traction("upper:z1", (0.0, 0.0, load), name="load")
    scene.traction("lower:x1", (1.0, 0.0, 0.0), name="other")
    return scene


def test_part_held_by_a_contact_that_is_open_at_first() -> None:
    silently(gapped(-5.0))  # converged or not: there is an equilibrium
    lost(gapped(5.0), "'upper'", "'joint' opens everywhere")


def test_free_part_without_a_load() -> None:
    with pytest.warns(SceneWarning, match="'upper'.*'joint' is open everywhere; no load.*along z"):
        assert solve(assemble(gapped(0.0)), options=SHORT).converged


def test_the_step_of_a_history_is_named() -> None:
    """Pressed at first, lifted from t = 1 on: the first step with a pull has no equilibrium."""
    scene = on_the_floor(Amplitude([0, 1, 2], [0, -1, 1]) * (0.0, 0.0, 5.0), Contact(), guided=True)
    said = r"no equilibrium at step 4, t = 2: .*'floor' opens everywhere.*the last loads.* at t = 1\.5;"
    with pytest.warns(SceneWarning, match=said):
        over = solve(assemble(scene), times=[0.0, 0.5, 1.0, 1.5, 2.0], options=SHORT)
    assert over.statuses == (*("converged",) * 4, "no_equilibrium") and not over.converged
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # unloaded at t = 0 and 1.5, but it lies on the floor
        assert solve(assemble(scene), times=[0.0, 0.5, 1.0, 1.5], options=SHORT).converged


@pytest.mark.parametrize("over", [1.02, 2.0])
def test_the_last_loads_that_friction_carries_are_named(over: float) -> None:
    """Pressed by 5 MPa, then pulled to `over` times mu p; a step within the limit costs no less than half."""
    scene = on_the_floor(Amplitude([0, 1, 2], [0, 1, 1]) * (0.0, 0.0, -5.0), Contact(friction=0.3))
    scene.traction("block:z1", Amplitude([1, 2], [0, over]) * (1.5, 0.0, 0.0), name="pull")
    problem = assemble(scene)
    within = solve(problem, times=[1.0, 1.4, 1.45])
    with pytest.warns(SceneWarning, match=f"the last loads.* at t = {1.0 + 1.0 / over:.4g};"):
        beyond = solve(problem, times=[1.0, 1.4, 2.0])
    assert beyond.statuses == ("converged", "converged", "no_equilibrium")
    assert np.allclose(beyond.force("floor")[:2], within.force("floor")[:2], rtol=0.0, atol=5e-6)
    assert beyond.summary.newton_steps <= 2 * within.summary.newton_steps


def test_a_whole_chain_is_named() -> None:
    """Two blocks glued to each other and lifted off a third one by the load on the upper one."""
    scene = gapped(5.0, 0.0)
    cube(scene, "top", 2 * SIDE)
    scene.interface("glue", "upper:z1", "top:z0", Elastic(normal=1e5, tangential=1e5))
    lost(scene, "'upper', 'top'", "translation along z")


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("case", ["cone", "bounded"])
def test_the_search_agrees_with_linear_programming(dim: int, case: str) -> None:
    """Random contacts of a rigid body: balance is a linear programme if circles are polygons.

    Polygons of 128 corners, inscribed and circumscribed, are two programmes that bracket the truth.
    """
    rng = np.random.default_rng(dim)
    q, verdicts = (3 if dim == 2 else 6), []
    for _ in range(60):
        m = int(rng.integers(2, 7))
        frames = np.linalg.qr(rng.standard_normal((m, dim, dim)))[0].transpose(0, 2, 1)
        x = rng.standard_normal((m, dim))
        rigid = np.zeros((m, dim, q))
        rigid[:, :, :dim] = np.eye(dim)
        if dim == 2:
            rigid[:, :, 2] = np.stack([-x[:, 1], x[:, 0]], axis=1)
        else:
            rigid[:, :, 3:] = np.stack([np.cross(e, x) for e in np.eye(3)], axis=2)
        jump = np.einsum("pij,pjq->piq", frames, rigid)
        mu = rng.uniform(0.0, 1.0, m) if case == "cone" else np.zeros(m)
        tau = np.zeros(m) if case == "cone" else rng.uniform(0.0, 2.0, m)
        work = rng.standard_normal(q)
        if rng.random() < 0.5:  # loads that some forces balance, shortened or not
            p = rng.uniform(0.0, 1.0, m)
            work = -np.einsum("p,pq->q", p, jump[:, 0]) + 0.2 * rng.standard_normal(q)
        grips = {"i": _Grip(np.ones(m), jump[:, 0], jump[:, 1:], mu, tau)}
        mine = _driven(work, grips, 1e-6)

        angle = np.arange(128) * np.pi / 64
        e = np.array([[1.0], [-1.0]]) if dim == 2 else np.stack([np.cos(angle), np.sin(angle)], axis=1)
        balance = []
        for radius in (1.0, 1.0 if dim == 2 else 1.0 / np.cos(np.pi / 128)):
            # pressures, then weights of the corners; their sum at a point is <= mu p + tau
            A = np.hstack(
                [-jump[:, 0].T, radius * np.einsum("ki,piq->qpk", e, jump[:, 1:]).reshape(q, -1)]
            )
            limit = np.hstack([-np.diag(mu), np.kron(np.eye(m), np.ones(len(e)))])
            found = linprog(np.zeros(A.shape[1]), limit, tau, A, work, method="highs")
            balance.append(found.status == 0)
        if balance[0] == balance[1]:
            verdicts.append(balance[0])
            assert (mine is None) == balance[0]
        if mine is not None:
            # a proof: no admissible force works against it as the loads do
            speed = np.linalg.norm(jump[:, 1:] @ mine, axis=1)
            assert np.all(jump[:, 0] @ mine - mu * speed > -1e-5)
            assert work @ mine > tau @ speed
    assert len(verdicts) > 50 and 5 < sum(verdicts) < len(verdicts) - 5


def between_plates(friction: float, shear: float) -> Problem:
    """A block between two that press it and move apart sideways by 2 `shear`."""
    scene = Scene()
    for name, y in (("low", 0.0), ("mid", 4.0), ("top", 8.0)):
        part = geometry.box((20.0, 4.0), (8, 2), (0.0, y))
        scene.substructure(name, part, LinearElastic(E=1e3, nu=0.2), degree=1)
    scene.interface("under", "low:y1", "mid:y0", Contact(friction=0.3))
    scene.interface("over", "mid:y1", "top:y0", Contact(friction=friction))
    press, aside = Amplitude([0.0, 1.0], [0.0, 1.0]), Amplitude([1.0, 2.0], [0.0, 1.0])
    scene.fix("low:y0", aside * (-shear, 0.0))
    scene.fix("top:y1", press * (0.0, -0.01) + aside * (shear, 0.0), name="grip")
    return assemble(scene)


def test_a_place_that_only_friction_that_is_used_up_holds_is_one_of_many():
    """Both faces slide: friction stays as it is when the block moves. With more above it follows.

    The iteration may stagnate: which of the places it finds is up to rounding.
    """
    for shear in (0.0150, 0.0152, 0.0165):
        with pytest.warns(SceneWarning, match="'mid' slips at step 1, t = 2 .*translation along x"):
            assert solve(between_plates(0.3, shear), times=[1.0, 2.0]).status in ("converged", "undecided")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        solve(between_plates(0.5, 0.02), times=[1.0, 2.0])
        solve(between_plates(0.3, 0.004), times=[1.0, 2.0])


def square_pair(law: Any, pull: tuple[float, float]) -> Problem:
    """Two unit squares side by side, the left one held at its outer edge, the right one pulled at its."""
    scene = Scene()
    for name, x in (("a", 0.0), ("b", 1.0)):
        square = geometry.box((1.0, 1.0), (2, 2), origin=(x, 0.0))
        scene.substructure(name, square, LinearElastic(100.0, 0.3), degree=1)
    scene.fix("a:x0", name="wall")
    scene.traction("b:x1", pull, name="pull")
    scene.interface("layer", "a:x1", "b:x0", law)
    return assemble(scene)


@pytest.mark.parametrize("rtol", [1e-2, 1e-4])
def test_samples_that_slide_away_are_named_one_by_one(rtol: float) -> None:
    """1 pushes and 0.2 shears: what has a friction coefficient below 0.2 slides, whatever the tolerance."""
    problem = square_pair(Contact(friction=lf.Uniform("mu", 0.1, 0.5)), (-1.0, 0.2))
    answer = lf.monte_carlo(problem, 40, options=Options(rtol=rtol), progress=False)
    slides = 0.3 + 0.2 * answer.germs[:, 0] < 0.2
    assert slides.any()
    assert ((answer.statuses == "no_equilibrium") == slides).all()
    assert answer.status == "no_equilibrium"
    told = f"{slides.sum()} of 40 points have no equilibrium"
    assert told in repr(answer)
    assert any(told in note for note in answer.table().notes)
    force = answer.force("layer")[~slides][..., 1] @ problem.interfaces["layer"].weights
    assert np.abs(force) == pytest.approx(0.2, rel=20.0 * rtol)


def test_swept_loads_that_nothing_balances_are_named() -> None:
    """With mu = 0.3 a pressure of 1 bears a shear of 0.3, and a pull nothing at all."""
    scene = Scene()
    for name, x in (("a", 0.0), ("b", 1.0)):
        square = geometry.box((1.0, 1.0), (2, 2), origin=(x, 0.0))
        scene.substructure(name, square, LinearElastic(100.0, 0.3), degree=1)
    scene.fix("a:x0", name="wall")
    scene.interface("layer", "a:x1", "b:x0", Contact(friction=0.3))
    scene.pressure("b:x1", 1.0, name="push")
    scene.force("b:x1", (0.0, 0.2), name="shear")
    problem = assemble(scene)
    parameter = next(name for name in problem.law_parameters | problem.load_parameters if "push" in name)
    grid: dict[Any, Any] = {parameter: [1.0, 0.5, -0.5]}
    found = lf.sweep(problem, grid, options=Options(rtol=1e-3), progress=False)
    assert found.statuses.tolist() == ["converged", "no_equilibrium", "no_equilibrium"]
    function = problem.function("layer", [parameter], options=Options(rtol=1e-3))
    with pytest.warns(SceneWarning, match="did not converge"):
        values = function(np.array([[1.0], [0.5]]))
    assert values[0, 0] == pytest.approx(-1.0, rel=1e-2)
    assert np.isnan(values[1, 0])


@pytest.mark.parametrize("iterations", [1, 200])
def test_points_that_were_not_reached_are_not_asked(
    iterations: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whether friction holds what is random; of many samples most were not come to."""
    scene = lf.Scene()
    for k, name in enumerate("ab"):
        square = lf.geometry.box((1.0, 1.0), (1, 1), origin=(float(k), 0.0))
        scene.substructure(name, square, LinearElastic(100.0, 0.3), degree=1)
    scene.fix("a:x0", name="wall")
    scene.interface("layer", "a:x1", "b:x0", Contact(friction=0.3))
    scene.pressure("b:x1", lf.Uniform("p", 1.0, 2.0), name="push")
    seen = 0

    def stop(_: object) -> None:
        nonlocal seen
        seen += 1
        if seen >= iterations:
            raise StopIteration

    asked = []
    problem_at = sampling.problem_at
    monkeypatch.setattr(sampling, "problem_at", lambda *given: asked.append(given) or problem_at(*given))
    found = lf.quasi_monte_carlo(assemble(scene), 1024, callback=stop, progress=False)
    assert found.status == "interrupted" and len(asked) == found.reached.sum() < 1024
    if iterations == 1:
        with pytest.raises(SceneError, match="'layer': no point was reached"):
            found.force("layer")


@pytest.mark.parametrize("rtol", [1e-2, 1e-6])
def test_a_law_that_becomes_0_is_checked_as_a_new_one(rtol: float) -> None:
    problem = square_pair(Elastic(normal=30.0, tangential=10.0), (1.0, 0.2))
    options = Options(rtol=rtol)
    with pytest.raises(SceneError, match="'b' can move freely: translation along x"):
        solve(problem.with_laws(values={"layer.normal": 0.0}), options=options)
    found = lf.sweep(problem, {"layer.normal": [0.0, 30.0]}, options=options, progress=False)
    assert found.statuses.tolist() == ["no_equilibrium", "converged"]
    function = problem.function("layer", ["layer.normal"], options=options)
    with pytest.warns(SceneWarning, match="did not converge"):
        values = function(np.array([[30.0], [0.0]]))
    assert values[0, 0] == pytest.approx(1.0, rel=2.0 * rtol)
    assert np.isnan(values[1, 0])
    # what something else holds may become 0
    scene = Scene()
    for name, x in (("a", 0.0), ("b", 1.0)):
        square = geometry.box((1.0, 1.0), (2, 2), origin=(x, 0.0))
        scene.substructure(name, square, LinearElastic(100.0, 0.3), degree=1)
    scene.fix(["a:x0", "b:x1"])
    scene.interface("layer", "a:x1", "b:x0", Elastic(normal=30.0, tangential=10.0))
    scene.traction("b:y1", (1.0, 0.2))
    free = lf.sweep(assemble(scene), {"layer.normal": [0.0, 30.0]}, options=options, progress=False)
    assert free.status == "converged"
    assert free.force("layer")[0, :, 0] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("parameter", ["friction", "threshold"])
@pytest.mark.parametrize("shear", [0.0, 0.05])
def test_no_friction_is_what_a_scene_without_it_is(parameter: str, shear: float, caplog: Any) -> None:
    """1 pushes. What friction alone holds is free without it: with a shear nothing balances that, without
    one there is an equilibrium, of which only the place is not known."""
    with pytest.raises(SceneError, match="'b' can move freely: translation along y") as new:
        square_pair(Contact(), (-1.0, shear))
    zeros = Contact(**{parameter: lambda x: 0.0 * x[:, 0]})
    with pytest.raises(SceneError, match="'b' can move freely: translation along y"):
        square_pair(zeros, (-1.0, shear))
    status = "no_equilibrium" if shear else "undetermined"
    uncertain = square_pair(Contact(**{parameter: lf.Uniform("bound", 0.0, 0.6)}), (-1.0, shear))
    germs = np.array([[-1.0], [1.0]])
    swept = {f"layer.{parameter}": [0.0, 0.6]}
    for answer in (
        lf.sweep(square_pair(Contact(**{parameter: 0.3}), (-1.0, shear)), swept, progress=False),
        lf.sample(uncertain, germs, progress=False),
        lf.sample(uncertain, germs, times=[1.0, 2.0], progress=False),
        uncertain.function("layer").evaluate(np.array([[0.0], [0.6]])),
    ):
        assert answer.statuses.tolist() == [status, "converged"]
    assert caplog.text.count(str(new.value)) == 4
    in_time = lf.Amplitude([1, 2, 3], [1, 0, 1])
    problem = square_pair(Contact(**{parameter: 0.3 * in_time}), (-1.0, shear))
    if shear:
        with pytest.warns(SceneWarning, match="no equilibrium at step 1, t = 2: 'b' has lost its support"):
            over = solve(problem, times=[1.0, 2.0, 3.0])
        assert over.statuses == ("converged", "no_equilibrium", "no_equilibrium")
    else:
        with pytest.warns(SceneWarning, match="'b' has lost its support at step 1, t = 2; no load acts"):
            solve(problem, times=[1.0, 2.0, 3.0])


def test_a_loose_spring_without_a_load_is_undetermined() -> None:
    for pull, status in (((1.0, 0.0), "undetermined"), ((1.0, 0.2), "no_equilibrium")):
        problem = square_pair(Elastic(normal=30.0, tangential=10.0), pull)
        found = lf.sweep(problem, {"layer.tangential": [0.0, 10.0]}, progress=False)
        assert found.statuses.tolist() == [status, "converged"]
        force = found.force("layer")[:, :, 0] @ problem.interfaces["layer"].weights
        assert force[1] == pytest.approx(1.0)


OVER = {"lower": 0.0, "upper": 20.0}


@pytest.mark.parametrize(
    ("law", "missing"),
    [
        (lf.Uniform("k", **OVER), "mean"),
        (2.0 * lf.Uniform("k", **OVER), "mean"),
        (20.0 - lf.Uniform("k", **OVER), "mean"),
        (lf.TruncatedNormal("k", 10.0, std=5.0, **OVER), "mean"),
        (lf.Gamma("k", 10.0, cov=1.0), "mean"),  # an exponential law
        (lf.Beta("k", 2.0, 2.0, **OVER), "standard deviation"),
        (lf.Gamma("k", 10.0, cov=0.8), "standard deviation"),  # of the shape 1.56
        (lf.Gamma("k", 10.0, cov=0.7), ""),  # 2.04
        (lf.Beta("k", 2.1, 2.0, **OVER), ""),
        (lf.Uniform("k", 1.0, 20.0), ""),
        (lf.LogNormal("k", 10.0, cov=0.5), ""),
    ],
)
def test_a_chaos_over_a_spring_that_comes_too_near_zero_names_what_is_free(law: Any, missing: str) -> None:
    """The inverse of a stiffness whose probability falls as x^n has moments below the n-th."""
    problem = square_pair(Elastic(normal=30.0, tangential=law), (1.0, 0.2))
    chaos = lf.Chaos(order=2)
    for call in (solve, ssfem):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            call(problem, chaos=chaos)
        said = [str(each.message) for each in caught if each.category is SceneWarning]
        if missing:
            assert len(said) == 1
            assert f"tangential of interface 'layer' = {law!r} comes so near 0" in said[0]
            assert f"has no {missing}" in said[0]
            assert "'b' can move freely: translation along y" in said[0]
        else:
            assert not said


@pytest.mark.filterwarnings("error::dolfinx_frontend.SceneWarning")
def test_a_chaos_over_a_spring_that_may_be_zero_is_quiet_where_it_is_right() -> None:
    """No load drives the motion that is free at 0, hardly anything is near 0, or another spring holds."""
    rare = lf.TruncatedNormal("k", 10.0, cov=0.2, lower=0.0)
    for law, pull in ((lf.Uniform("k", **OVER), (1.0, 0.0)), (rare, (1.0, 0.2))):
        assert solve(square_pair(Elastic(normal=30.0, tangential=law), pull), chaos=4).trusted
    scene = Scene()
    scene.substructure("a", geometry.box((1.0, 1.0), (2, 2)), LinearElastic(100.0, 0.3), degree=1)
    scene.fix("a:x0", components=0)
    for name in ("y0", "y1"):
        scene.interface(name, f"a:{name}", Elastic(normal=lf.Uniform(name, **OVER), tangential=1.0))
    scene.traction("a:x1", (0.0, 1.0))
    assert solve(assemble(scene), chaos=2).converged
    one = lf.Uniform("one", **OVER)  # both springs are 0 together
    both = assemble(scene).with_laws({n: Elastic(normal=one, tangential=1.0) for n in ("y0", "y1")})
    with pytest.raises(SceneWarning, match="normal of interface 'y0' = .* and normal of interface 'y1'"):
        solve(both, chaos=2)


@pytest.mark.parametrize("active", [None, "all"])
@pytest.mark.parametrize("times", [None, [0.5, 1.0]])
def test_swept_displacements_that_contradict_each_other_are_named(
    times: Any, active: Any, caplog: Any
) -> None:
    """Two sides of a square on springs are moved along y: at their corner both have to be the same."""
    scene = Scene()
    square = geometry.box((1.0, 1.0), (2, 2))
    scene.substructure("a", square, LinearElastic(100.0, 0.0), degree=1)
    scene.interface("bed", "a:y0", Elastic(normal=30.0, tangential=10.0))
    one: Any = 1.0 if times is None else Amplitude([0, 1], [0, 1])
    scene.fix("a:y1", one * 0.01, components=1, name="top")
    scene.fix("a:x1", one * 0.01, components=1, name="right")
    scene.fix("a:x0", components=0)
    problem = assemble(scene)
    settings = {"active": active, "times": times}
    values = [0.01, 0.02, 0.03]
    for kept in (True, False):
        grid = {"top.value": values, "right.value": values[:2]}
        found = lf.sweep(problem, grid, progress=False, keep_fields=kept, **settings)
        agree = np.equal.outer(values, values[:2])
        assert ((found.statuses == "converged") == agree).all()
        assert (found.statuses[~agree] == "no_equilibrium").all()
    # of the four points of each sweep three are told in full
    assert caplog.text.count("'right' and 'top' prescribe different displacements at 1 common nodes") == 6
    assert caplog.text.count("and 1 more sweep points that nothing balances or holds") == 2
    both = lf.sweep(problem, {("top.value", "right.value"): values}, progress=False, **settings)
    assert both.status == "converged"
    function = problem.function("bed", ["top.value"], **settings)
    assert function.evaluate([[0.01], [0.02]]).statuses.tolist() == ["converged", "no_equilibrium"]


def test_swept_jumps_that_contradict_supports_are_named() -> None:
    scene = Scene()
    for name, x in (("a", 0.0), ("b", 1.0)):
        square = geometry.box((1.0, 1.0), (2, 2), origin=(x, 0.0))
        scene.substructure(name, square, LinearElastic(100.0, 0.3), degree=1)
    scene.interface("glue", "a:x1", "b:x0", lf.Perfect(jump=0.0))
    scene.fix(["a:y0", "b:y0"])
    found = lf.sweep(assemble(scene), {"glue.jump": [0.0, 0.01]}, progress=False)
    assert found.statuses.tolist() == ["converged", "no_equilibrium"]
