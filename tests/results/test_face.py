"""One face for all answers: the same accessors with the same arguments, also after saving and loading."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest

from dolfinx_frontend import figures, geometry, io
from dolfinx_frontend.assembly.assemble import assemble
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.results.result import Result
from dolfinx_frontend.results.saved import load
from dolfinx_frontend.results.writing import ResultFileError
from dolfinx_frontend.scene.amplitudes import Amplitude
from dolfinx_frontend.scene.laws import Contact, Elastic
from dolfinx_frontend.scene.materials import LinearElastic, OrthotropicElastic
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.solving import monte_carlo, solve, sweep, tensor_quadrature
from dolfinx_frontend.uncertainty.chaos import Chaos
from dolfinx_frontend.uncertainty.parameters import LogNormal
from latin_core import Options

matplotlib.use("Agg")

E, LENGTH = 200.0, 2.0
TIGHT = Options(rtol=1e-10)
GERMS = 3
KINDS = ("deterministic", "history", "chaos", "samples", "quadrature", "sweep")


def problem(random: bool = False, d: int = 3, varying: bool = False, contact: bool = False) -> Problem:
    """Two bars in line, joined by springs or a contact, on springs at one end, pushed at the other."""
    scene = Scene()
    material: Any = LinearElastic(E, 0.3)
    if d == 2:
        material = OrthotropicElastic((E, E, E), (0.3, 0.3, 0.3), (E / 2.6,) * 3)
    for name, x0 in (("left", 0.0), ("right", LENGTH)):
        cell = "tetrahedron" if d == 3 else "quadrilateral"
        block = geometry.box((LENGTH, 1.0, 1.0)[:d], (2, 1, 1)[:d], (x0, 0.0, 0.0)[:d], cell)
        scene.substructure(name, block, material, degree=2)
    k: Any = LogNormal("k", 30.0, cov=0.2) if random else 30.0
    law = Contact(gap=0.001, stiffness=k) if contact else Elastic(normal=k, tangential=10.0)
    scene.interface("joint", "left:x1", "right:x0", law)
    scene.interface("ground", "left:x0", Elastic(normal=50.0, tangential=20.0))
    push = Amplitude([0.0, 2.0], [0.0, 1.0]) * -0.02 if varying else -0.02
    scene.fix("right:x1", push, components=0, name="push")
    for axis in range(1, d):
        scene.fix("right:x1", components=axis, name=f"hold{axis}")
    return assemble(scene)


def of_kind(kind: str, **settings: Any) -> Any:
    times = [1.0, 2.0] if kind == "history" or settings.pop("timed", False) else None
    made = problem(kind in ("chaos", "samples", "quadrature"), varying=times is not None, **settings)
    how: dict[str, Any] = {"times": times, "options": TIGHT}
    if kind == "chaos":
        return solve(made, chaos=Chaos(order=3, check_points=0), **how)
    if kind == "samples":
        return monte_carlo(made, 5, keep_states=True, **how)
    if kind == "quadrature":
        return tensor_quadrature(made, GERMS, keep_states=True, **how)
    if kind == "sweep":
        law = made.interfaces["joint"].law
        name = "joint.normal" if "normal" in law.parameters() else "joint.stiffness"
        return sweep(made, {name: [20.0, 30.0]}, keep_states=True, **how)
    return solve(made, **how)


@pytest.fixture(scope="module")
def answers(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[Any, Any]]:
    """Kind -> answer, and the same from its file."""
    folder = tmp_path_factory.mktemp("answers")
    out = {}
    for kind in KINDS:
        answer = of_kind(kind)
        answer.save(folder / f"{kind}.h5", samples=50)
        out[kind] = answer, load(folder / f"{kind}.h5")
    return out


def pull(answer: Any) -> Callable[[Any], Any]:
    area = answer.problem.interfaces["joint"].weights
    return lambda f: f.force("joint")[..., 0].reshape(len(f), -1, len(area))[:, -1] @ area


READ: dict[str, Callable[[Any, Path], Any]] = {
    "kind": lambda a, _: np.array([a.kind]),
    "status": lambda a, _: np.array([a.status]),
    "times": lambda a, _: np.zeros(0) if a.times is None else a.times,
    "known": lambda a, _: np.array(a.known),
    "force": lambda a, _: a.force("joint"),
    "jump": lambda a, _: a.jump("joint"),
    "force of springs that were assembled": lambda a, _: a.force("ground"),
    "displacements": lambda a, _: a.displacements["left"],
    "displacement": lambda a, _: by_node(a, a.displacement("left", step=-1)),
    "mean": lambda a, _: by_node(a, a.mean("left")),
    "stress": lambda a, _: by_node(a, a.stress("right", step=-1)),
    "quantity": lambda a, _: a.quantity(pull(a), "pull", "N", samples=50).values,
    "table": lambda a, _: np.array([a.table(samples=50).to_csv()]),
    "table of some": lambda a, _: np.array(
        [a.table("joint", step=-1, about=(1.0, 2.0, 3.0), samples=50).to_csv()]
    ),
    "paraview": lambda a, folder: np.array([p.name for p in io.write(a, folder)]),
    "facets": lambda a, _: np.sort(np.array(io.facet_fields(a, "joint", step=-1)[1]["pressure"])),
    "deformed_figure": lambda a, folder: drawn(
        figures.deformed_figure(a, folder / "a.png", renderer="matplotlib")
    ),
    "interface_figure": lambda a, folder: drawn(
        figures.interface_figure(a, "joint", folder / "b.png", renderer="matplotlib")
    ),
    "save": lambda a, folder: saved_again(a, folder),
}
RANDOM: dict[str, Callable[[Any, Path], Any]] = {
    "moments of a force": lambda a, _: np.array(a.moments("joint")),
    "moments of a jump": lambda a, _: np.array(a.moments("joint", "jump")),
    "moments of a part": lambda a, _: np.array(a.moments("left")),
    "std": lambda a, _: by_node(a, a.std("left", step=-1)),
}


def by_node(_: Any, function: Any) -> Any:
    """Values in an order that does not depend on that of the cells: dolfinx renumbers a loaded mesh."""
    x = function.function_space.tabulate_dof_coordinates()
    values = function.x.array.reshape(len(x), -1)
    mesh = function.function_space.mesh
    if values.shape[1] > 3:  # a stress has nodes of its own in every cell
        dofs = function.function_space.dofmap.list
        middle = x[dofs].mean(axis=1)
        where = np.zeros_like(x)
        where[dofs] = middle[:, None]
        x = np.hstack([where, x])
    assert mesh is not None
    return values[np.lexsort(np.round(x, 6).T)]


def drawn(path: Path) -> Any:
    assert path.stat().st_size > 1000
    return np.zeros(1)


def saved_again(answer: Any, folder: Path) -> Any:
    answer.save(folder / "again.h5", samples=50)
    return np.array([load(folder / "again.h5").table(samples=50).to_csv()])


@pytest.mark.parametrize("name", READ)
@pytest.mark.parametrize("kind", KINDS)
def test_every_answer_offers_it_also_from_a_file(
    kind: str, name: str, answers: dict[str, tuple[Any, Any]], tmp_path: Path
) -> None:
    own, loaded = (READ[name](each, tmp_path) for each in answers[kind])
    assert own.shape == loaded.shape and own.size + (name == "times")
    if own.dtype.kind == "f":
        np.testing.assert_allclose(loaded, own, rtol=1e-9, atol=1e-9 * np.abs(own).max(initial=0.0))
    else:
        assert np.array_equal(own, loaded)


@pytest.mark.parametrize("name", RANDOM)
@pytest.mark.parametrize("kind", KINDS)
def test_moments_are_of_all_but_a_sweep(
    kind: str, name: str, answers: dict[str, tuple[Any, Any]], tmp_path: Path
) -> None:
    if kind == "sweep":
        for each in answers[kind]:
            with pytest.raises(SceneError, match=r"points of a sweep have no probability: .*point\(\.\.\.\)"):
                RANDOM[name](each, tmp_path)
        return
    own, loaded = (RANDOM[name](each, tmp_path) for each in answers[kind])
    np.testing.assert_allclose(loaded, own, rtol=1e-9, atol=1e-9 * np.abs(own).max())
    spread = own[1] if "moments" in name else own
    assert (np.abs(spread).max() > 0.0) == (kind in ("chaos", "samples", "quadrature"))


@pytest.mark.parametrize("kind", KINDS)
def test_steps_and_names_that_there_are_not(kind: str, answers: dict[str, tuple[Any, Any]]) -> None:
    last = 2 if kind == "history" else 1
    for each in answers[kind]:
        for read in (each.displacement, each.stress):
            with pytest.raises(SceneError, match=f"there is no step 5, the history has {last}"):
                read("left", step=5)
            with pytest.raises(SceneError, match="unknown substructure 'middle'"):
                read("middle")
        with pytest.raises(SceneError, match=f"there is no step 5, the history has {last}"):
            each.table(step=5)
        with pytest.raises(SceneError, match="unknown interface 'join'.*'joint'"):
            each.table("join")
        with pytest.raises(SceneError, match="unknown interface"):
            each.force("join")


# --- numbers -----------------------------------------------------------------------------------------
def test_a_deterministic_quantity_is_one_value(answers: dict[str, tuple[Any, Any]]) -> None:
    for each in answers["deterministic"]:
        found = each.quantity(pull(each))
        area = each.problem.interfaces["joint"].weights
        assert len(found) == 1 and found.values[0] == pytest.approx(each.force("joint")[:, 0] @ area)
        assert found.mean().value == found.quantile(0.3).value == found.values[0] and found.std().value == 0.0


def test_a_sweep_has_a_row_and_a_value_a_point(answers: dict[str, tuple[Any, Any]]) -> None:
    for each in answers["sweep"]:
        found, table = each.quantity(pull(each)), each.table()
        area = each.problem.interfaces["joint"].weights
        np.testing.assert_allclose(found.values, each.force("joint")[..., 0] @ area)
        for k, stiffness in enumerate((20.0, 30.0)):
            row = {"joint.normal": stiffness}
            assert table.value("normal", "joint", **row) == pytest.approx(found.values[k])
            # the support that was assembled pushes the right part as the joint pushes the left one
            assert table.value("force_x", "push", **row) == pytest.approx(found.values[k], rel=1e-6)
            one = each.point(k)
            assert one.kind == "deterministic" and one.converged
            assert np.array_equal(one.force("joint"), each.force("joint")[k])
            assert one.table("joint").value("normal", "joint") == pytest.approx(found.values[k])
        with pytest.raises(SceneError, match="no statistics .* of a sweep"):
            found.mean()
        with pytest.raises(SceneError, match=r"there is no point \(2,\), there are 2"):
            each.point(2)


def test_points_of_a_sweep_are_those_of_single_solves(answers: dict[str, tuple[Any, Any]]) -> None:
    made = problem()
    for k, stiffness in enumerate((20.0, 30.0)):
        alone = solve(made.with_laws(values={"joint.normal": stiffness}), active=["joint"], options=TIGHT)
        for each in answers["sweep"]:
            u, one = alone.displacements["left"], each.point(k).displacements["left"]
            np.testing.assert_allclose(one, u, rtol=0.0, atol=1e-7 * np.abs(u).max())
            np.testing.assert_allclose(each.force("ground")[k], alone.force("ground"), rtol=1e-6, atol=1e-9)


def test_moments_of_samples_are_those_of_single_points(answers: dict[str, tuple[Any, Any]]) -> None:
    own, loaded = answers["samples"]
    points = np.array([own.point(k).force("ground") for k in range(5)])
    for each in (own, loaded):
        mean, deviation = each.moments("ground")
        np.testing.assert_allclose(mean, points.mean(axis=0), rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(deviation, points.std(axis=0, ddof=1), rtol=1e-6, atol=1e-9)
    stresses = np.array([own.point(k).stress("left").x.array for k in range(5)])
    found = own.std("left", of="stress").x.array
    np.testing.assert_allclose(found, stresses.std(axis=0, ddof=1), rtol=1e-6, atol=1e-9)
    with pytest.raises(ResultFileError, match="at single samples are not in the file"):
        loaded.std("left", of="stress")


@pytest.mark.parametrize("kind", ["chaos", "quadrature"])
def test_random_answers_have_reactions(kind: str, answers: dict[str, tuple[Any, Any]]) -> None:
    """What the joint carries, the springs on the ground and the support carry, in every statistic."""
    for each in answers[kind]:
        table = each.table(samples=50)
        assert not table.notes
        for statistic in ("mean", "std"):
            carried = table.value("normal", "joint", statistic=statistic)
            for name in ("ground", "push"):
                normal = table.value("normal", name, statistic=statistic)
                assert normal == pytest.approx(carried, rel=1e-6, abs=1e-9)


def test_a_chaos_agrees_with_its_own_samples(answers: dict[str, tuple[Any, Any]]) -> None:
    own, loaded = answers["chaos"]
    rule, _ = answers["quadrature"]
    for each in (own, loaded):
        for name in ("joint", "ground"):
            for one, other in zip(each.moments(name), rule.moments(name), strict=True):
                np.testing.assert_allclose(one, other, atol=2e-3 * np.abs(rule.force(name)).max())
        mine, theirs = (a.std("left", of="stress").x.array for a in (own, rule))
        np.testing.assert_allclose(mine, theirs, atol=2e-2 * np.abs(theirs).max())


# --- what cannot be given ------------------------------------------------------------------------------
def test_samples_without_states(tmp_path: Path) -> None:
    made = problem(random=True)
    drawn_ = monte_carlo(made, 3, options=TIGHT)
    drawn_.save(tmp_path / "a.h5")
    for each in (drawn_, load(tmp_path / "a.h5")):
        for read in (each.displacement, each.stress, each.moments, each.std):
            with pytest.raises(SceneError, match="the states of the points were not kept.*keep_states=True"):
                read("left")
        assert each.known == ("joint",) and "keep_states=True" in str(each.table())
        assert len(each.quantity(pull(each))) == 3
    swept = sweep(problem(), {"joint.normal": [20.0]}, options=TIGHT)
    with pytest.raises(SceneError, match="keep_states=True"):
        swept.displacement("left")
    assert len(swept.table("joint")) == 1


@pytest.mark.parametrize("kind", KINDS)
def test_files_without_fields(kind: str, answers: dict[str, tuple[Any, Any]], tmp_path: Path) -> None:
    own, loaded = answers[kind]
    for number, each in enumerate((own, loaded)):
        each.save(tmp_path / f"{number}.h5", fields=False, samples=50)
        bare = load(tmp_path / f"{number}.h5")
        assert bare.table().to_csv() == loaded.table().to_csv()
        for read in (bare.displacement, bare.stress):
            with pytest.raises(SceneError, match="saved without fields: save it with fields=True"):
                read("left")
        with pytest.raises(ResultFileError, match="saved without fields"):
            bare.force("joint")


def test_a_loaded_chaos_of_a_contact_knows_what_it_does_not_know(tmp_path: Path) -> None:
    chaos = of_kind("chaos", contact=True)
    chaos.save(tmp_path / "a.h5", samples=30)
    found = load(tmp_path / "a.h5")
    assert found.table().to_csv() == chaos.table(samples=30).to_csv()
    assert found.quantity(lambda f: f.displacement("left").max(axis=1)).std().value > 0.0
    with pytest.raises(ResultFileError, match="its law is nonlinear and not in the file"):
        found.quantity(pull(found))
    with pytest.raises(ResultFileError, match="60 samples are not in the file, it has 30"):
        found.quantity(pull(found), samples=60)


# --- histories, planes, contacts -------------------------------------------------------------------------
@pytest.mark.parametrize("kind", ["chaos", "samples", "sweep"])
def test_load_histories_of_all_kinds(kind: str, tmp_path: Path) -> None:
    answer = of_kind(kind, timed=True)
    answer.save(tmp_path / "a.h5", samples=50)
    found = load(tmp_path / "a.h5")
    for each in (answer, found):
        assert each.times.tolist() == [1.0, 2.0] and each.displacements["left"].shape[0] == 2
        half, whole = (each.displacement("right", step).x.array for step in (0, 1))
        np.testing.assert_allclose(half, 0.5 * whole, atol=1e-7 * np.abs(whole).max())
        table = each.table("joint", step=None, samples=50)
        assert sorted(set(table["time"])) == [1.0, 2.0]
    assert found.table(step=None).to_csv() == answer.table(step=None, samples=50).to_csv()
    assert io.write(found, tmp_path / "fields")[0].suffix == ".pvd"


@pytest.mark.parametrize("kind", ["deterministic", "samples", "sweep"])
def test_contacts_in_the_plane(kind: str, tmp_path: Path) -> None:
    answer = of_kind(kind, contact=True, d=2)
    answer.save(tmp_path / "a.h5")
    found = load(tmp_path / "a.h5")
    assert found.table().to_csv() == answer.table().to_csv()
    mine, theirs = (io.facet_fields(each, "joint")[1] for each in (answer, found))
    assert set(mine) == set(theirs) >= {"pressure", "gap"}
    for name, values in mine.items():
        np.testing.assert_allclose(np.sort(theirs[name], axis=0), np.sort(values, axis=0), atol=1e-12)
    u = answer.stress("left"), found.stress("left")
    np.testing.assert_allclose(by_node(0, u[1]), by_node(0, u[0]), atol=1e-9)
    assert figures.interface_figure(found, "joint", tmp_path / "a.png").exists()


def test_what_is_random_only_says_so() -> None:
    answer = solve(problem(), options=TIGHT)
    assert isinstance(answer, Result)
    with pytest.raises(AttributeError, match="has no 'sobol': the answer is deterministic"):
        _ = answer.sobol


def test_a_result_with_a_held_node_is_saved(tmp_path: Path) -> None:
    """A node is no face: it has no facets in the file."""
    scene = Scene()
    scene.substructure("b", geometry.box((1.0, 1.0, 1.0), (2, 2, 2)), LinearElastic(1.0, 0.3), degree=1)
    scene.fix_point("b", (0.0, 0.0, 0.0), name="root")
    scene.fix_point("b", (1.0, 0.0, 0.0), components=(1, 2))
    scene.fix_point("b", (0.0, 1.0, 0.0), components=2)
    for face, sign in (("b:z1", 1.0), ("b:z0", -1.0)):
        scene.traction(face, (0.0, 0.0, sign))
    result = solve(assemble(scene), active=["root"])
    result.save(tmp_path / "a.h5")
    again = load(tmp_path / "a.h5")
    assert again.force("root") == pytest.approx(result.force("root"))
    assert io.write_interfaces(result, tmp_path / "a.vtm").exists()
