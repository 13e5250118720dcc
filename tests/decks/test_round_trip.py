"""A scene, its deck, and the scene of the deck: the same calls, and answers of the same bits."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

import bonded_lap_joint
import dolfinx_frontend as lf
import first_bolt
import loads_and_scatter
from dolfinx_frontend import geometry

LATER = lf.Amplitude([1, 2], [0, 1])


def again(scene: lf.Scene, folder: Path, **settings: Any) -> lf.Scene:
    """The scene of the deck of a scene, whose own deck is the same text."""
    deck, other = folder / "scene.toml", folder / "again.toml"
    scene.to_deck(deck)
    read = lf.read_deck(deck, **settings).scene
    read.to_deck(other)
    assert other.read_text() == deck.read_text()
    return read


def assert_same(scene: lf.Scene, other: lf.Scene, **settings: Any) -> None:
    """Solved once each, alike to the last bit."""
    one, two = (lf.solve(lf.assemble(each), progress=False, **settings) for each in (scene, other))
    assert one.status == two.status
    for name in one.known:
        assert np.array_equal(one.force(name), two.force(name)), name
    for part in scene.substructures:
        assert np.array_equal(one.unknowns(part), two.unknowns(part)), part


def scenes_of(function: Any, monkeypatch: pytest.MonkeyPatch) -> list[lf.Scene]:
    """The scenes that a demo assembles."""
    found: list[lf.Scene] = []
    assemble = lf.assemble

    def kept(scene: lf.Scene, *given: Any, **named: Any) -> lf.Problem:
        found.append(scene)
        return assemble(scene, *given, **named)

    with monkeypatch.context() as patch:
        patch.setattr(lf, "assemble", kept)
        function()
    return found


DEMOS = {
    "bolt": (lambda: first_bolt.joint(20e3, 16e3), {"times": [1.0, 2.0]}),
    "random bolt": (lambda: first_bolt.joint(lf.Normal("F_V", 2e4, cov=0.15), 16e3), {"times": [1.0, 2.0]}),
    "temperature": (lambda: loads_and_scatter.temperature(None), {}),
    "remote force": (lambda: loads_and_scatter.remote_force(None), {}),
    "tightening": (lambda: loads_and_scatter.tightening(None), {}),
    "lap joint": (lambda: bonded_lap_joint.bonded(lf.LogNormal("k", 4500.0, cov=0.3), 2000.0), {}),
}


@pytest.mark.parametrize("demo", DEMOS)
def test_demos_have_equal_bits(demo: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    function, settings = DEMOS[demo]
    (scene,) = scenes_of(function, monkeypatch)
    assert_same(scene, again(scene, tmp_path), **settings)


def blocks(**settings: Any) -> lf.Scene:
    """Two cubes side by side, the left one held."""
    scene = lf.Scene()
    for name, x in (("left", 0.0), ("right", 1.0)):
        box = geometry.box((1, 1, 1), (1, 1, 1), origin=(x, 0, 0))
        scene.substructure(name, box, lf.LinearElastic(E=settings.get("E", 100.0), nu=0.3, alpha=1e-3))
    scene.fix("left:x0", name="root")
    return scene


def every_word() -> lf.Scene:
    """Each method of the scene once, with whatever it takes."""
    k, c = lf.Correlated([lf.Normal("k", 100.0, cov=0.1), lf.LogNormal("c", 0.1 + 0.2, std=0.01)],
                         [[1.0, 0.3], [0.3, 1.0]])
    weibull = lf.FromDistribution("w", stats.weibull_min(2.0, scale=3.0))
    field = lf.RandomField("E", mean=100.0, cov=0.2, length=2.0, modes=2, distribution="lognormal")
    scene = blocks(E=field)
    spring = lf.Elastic(normal=np.exp(k / 50.0) * 2 - c, tangential=30.0)
    scene.interface("joint", "left:x1", "right:x0", spring, quadrature_degree=3, space="points")
    scene.interface("bolt", "right:y0", lf.Preload(force=lf.Uniform("F", 1.0, 2.0), during=((0, 1),)))
    scene.symmetry(["left:z0", "right:z0"], name="sym")
    scene.pressure("right:z1", lf.Gamma("p", 1.0, cov=0.1) * LATER)
    scene.traction("left:z1", LATER * (1.0, 0.0, 0.0) + (0.0, 0.1, 0.0))
    scene.rigid("right:x1", point=(2.0, 0.5, 0.5), rx=0.0)
    scene.springs("right:y1", name="bed", x=3.0, rz=lf.Beta("b", 2.0, 3.0, upper=4.0))
    turned = [[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]]
    scene.fix_point("left", (0.0, 0.0, 0.0), components=[0, 1], frame=turned)
    terms = [("left", (0.0, 1.0, 0.0), (1.0, 0.1, 0.0)), ("right", (2.0, 0.0, 0.0), (0.0, 0.0, -1.0))]
    scene.link("tie", terms)
    scene.link("rod", [("left", (0.0, 1.0, 1.0), (0.0, 1.0, 0.0))], 0.1, k)
    scene.body_force("left", (0.0, 0.0, lf.TruncatedNormal("g", 1.0, cov=0.1, within=2.0)))
    scene.force("right:x1", (1.0, LATER * 2.0, 0.0), moment=(0.0, 0.0, 1.0), name="pull")
    scene.bearing("left:y1", (0.0, 1.0, 0.0), factor=weibull)
    scene.point_force("right", (2.0, 1.0, 1.0), (0.0, 0.0, 1.0))
    scene.initial_strain("left", np.diag([1e-3, 0.0, 0.0]), factor=lf.FromSamples("s", [1.0, 2.0, 4.0]))
    scene.temperature("right", 20.0 * LATER)
    scene.plane("left:y0", tilts=False, n=0.25)
    return scene


def test_every_method_and_value_is_written_and_read(tmp_path: Path) -> None:
    scene = every_word()
    read = again(scene, tmp_path)
    assert list(read.interfaces) == list(scene.interfaces) and list(read.loads) == list(scene.loads)
    for name, one in scene.interfaces.items():
        other = read.interfaces[name]
        assert type(one.law) is type(other.law) and (one.faces, one.space) == (other.faces, other.space)
        for key, value in one.law.parameters().items():
            assert repr(value) == repr(other.law.parameters()[key]), (name, key)
    for name, load in scene.loads.items():
        assert repr(load) == repr(read.loads[name])


def test_expressions_and_correlations_keep_their_values(tmp_path: Path) -> None:
    scene = every_word()
    one, other = (s.interfaces["joint"].law.parameters()["normal"] for s in (scene, again(scene, tmp_path)))
    at = {"k": np.array([90.0, 120.0]), "c": np.array([0.3, 0.31])}
    assert np.array_equal(one.at(at), other.at(at))
    groups = [each.leaves["k"].group.normal_correlation for each in (one, other)]
    assert np.array_equal(*groups)


def test_mesh_files_are_named_beside_the_deck(tmp_path: Path) -> None:
    with geometry.gmsh_session("two") as gmsh:
        model = gmsh.model
        for k, name in enumerate(("left", "right")):
            model.occ.addBox(float(k), 0.0, 0.0, 1.0, 1.0, 1.0)
        model.occ.synchronize()
        for (dim, tag), name in zip(model.getEntities(3), ("left", "right"), strict=True):
            model.addPhysicalGroup(dim, [tag], name=name)
        for name, x in (("left:x0", 0.0), ("right:x1", 2.0)):
            (face,) = [t for d, t in model.getEntitiesInBoundingBox(x - 1e-3, -1, -1, x + 1e-3, 2, 2, 2)]
            model.addPhysicalGroup(2, [face], name=name)
        model.mesh.generate(3)
        gmsh.write(str(tmp_path / "two.msh"))
    parts = geometry.read_msh(tmp_path / "two.msh").parts
    scene = lf.Scene()
    for name, part in parts.items():
        scene.substructure(name, part, lf.LinearElastic(E=10.0, nu=0.2), degree=1)
    scene.fix(["left:x0", "right:x1"])
    scene.body_force("left", (1.0, 0.0, 0.0))
    (tmp_path / "below").mkdir()
    deck = tmp_path / "below" / "two.toml"
    scene.to_deck(deck)
    assert 'path = "../two.msh"' in deck.read_text()
    assert_same(scene, lf.read_deck(deck).scene)


def test_what_is_python_is_refused_by_name(tmp_path: Path) -> None:
    scene = blocks()
    scene.pressure("right:x1", lambda x: x[:, 0])
    with pytest.raises(lf.SceneError, match="p of pressure.*Python"):
        scene.to_deck(tmp_path / "x.toml")
    assert not (tmp_path / "x.toml").exists()


def own_mesh(*sizes: float) -> geometry.Part:
    """A box that has no call which made it."""
    made = geometry.box(sizes, [2] * len(sizes))
    return geometry.Part(made.mesh, made.facet_tags, made.names)


def test_meshes_of_python_are_written_beside_the_deck(tmp_path: Path) -> None:
    scene = lf.Scene()
    for name, part in (("a", own_mesh(1, 1, 1)), ("b #2", own_mesh(1, 1, 1))):
        scene.substructure(name, part, lf.LinearElastic(E=1.0, nu=0.2))
        scene.fix(f"{name}:x0", name=f"wall {name}")
        scene.traction(f"{name}:x1", (0.1, 0.2, 0.0), name=f"pull {name}")
    other = again(scene, tmp_path)
    assert (tmp_path / "scene.toml.msh").exists() and not (tmp_path / "again.toml.msh").exists()
    one, two = (lf.solve(lf.assemble(each), progress=False) for each in (scene, other))
    for name in one.known:
        assert two.force(name).sum(axis=0) == pytest.approx(one.force(name).sum(axis=0), rel=1e-12), name
    # a mesh that the scene reads is not written over
    other.substructure("c", own_mesh(1, 1, 1), lf.LinearElastic(E=1.0, nu=0.2))
    before = (tmp_path / "scene.toml.msh").read_bytes()
    with pytest.raises(lf.SceneError, match="give the deck another name"):
        other.to_deck(tmp_path / "scene.toml")
    assert (tmp_path / "scene.toml.msh").read_bytes() == before


def test_a_scene_that_was_changed_in_other_ways_is_refused(tmp_path: Path) -> None:
    scene = blocks()
    del scene.interfaces["root"]
    with pytest.raises(lf.SceneError, match="changed without its methods"):
        scene.to_deck(tmp_path / "x.toml")
    scene = blocks()
    with pytest.raises(lf.SceneError):
        scene.symmetry(["right:y0", "right:yy"])
    scene.symmetry("right:z0")
    with pytest.raises(lf.SceneError, match="in one that failed"):
        scene.to_deck(tmp_path / "x.toml")


def uneven(x: Any) -> Any:
    """A pressure that depends on the place."""
    return 1.0 + x[:, 1]


def test_code_is_executed_only_if_allowed(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("def p(x):\n    return 1.0 + x[:, 1]\n")
    scene = blocks()
    scene.interface("joint", "left:x1", "right:x0", lf.Perfect())
    scene.to_deck(tmp_path / "x.toml")
    with (tmp_path / "x.toml").open("a") as file:
        file.write('\n[[pressure]]\nfaces = "right:x1"\np = "mine:p"\n')
    with pytest.raises(lf.SceneError, match=r"x.toml:\d+: p = 'mine:p' is code.*--allow-code"):
        lf.read_deck(tmp_path / "x.toml")
    scene.pressure("right:x1", uneven)
    assert_same(scene, lf.read_deck(tmp_path / "x.toml", allow_code=True).scene)
