"""Arrays of a user are copied on the way in; what is handed out is a copy, or cannot be written to.

On the way in: no array that can be reached from an object, by whatever private way, is one that was given.
On the way out: every array that can be reached by public names is written to, and nothing has changed after.
"""

from __future__ import annotations

import gc
import types
from collections.abc import Callable, Iterator, Mapping
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dolfinx_frontend as lf
from dolfinx_frontend import geometry
from dolfinx_frontend.io import load_chaos
from latin_core import SweptParameter

POINTS = 8
"""Interface points of the layer."""


# --- in ----------------------------------------------------------------------------------------------
def reachable(root: Any) -> Iterator[np.ndarray]:
    """Arrays that an object holds, directly or not."""
    seen: set[int] = set()
    todo = [root]
    while todo:
        each = todo.pop()
        if id(each) in seen or isinstance(each, (type, types.ModuleType, types.FrameType, types.CodeType)):
            continue
        seen.add(id(each))
        if isinstance(each, np.ndarray):
            yield each
        elif isinstance(each, types.FunctionType):
            todo += [each.__closure__, each.__defaults__, each.__kwdefaults__]
        else:
            todo += gc.get_referents(each)


def blocks(
    law: Any = None, pull: Any = (1.0, 0.2), held: Any = 0.0, force: Any = None, bed: bool = False
) -> lf.Scene:
    scene = lf.Scene()
    for name, x0 in (("left", 0.0), ("right", 1.0)):
        part = geometry.box((1.0, 1.0), (2, 4), origin=(x0, 0.0))
        material = lf.LinearElastic(E=100.0, nu=0.3)
        scene.substructure(name, part, material, degree=1, body_force=force)
    scene.interface("layer", "left:x1", "right:x0", lf.Elastic(30.0, 10.0) if law is None else law)
    scene.fix("left:x0", held, name="wall")
    scene.traction("right:y1" if bed else "right:x1", pull, name="pull")
    if bed:
        scene.interface("bed", "right:x1", lf.Elastic(normal=1.0, tangential=1.0))
    return scene


def joined(law: Any = None, **more: Any) -> lf.Problem:
    return lf.assemble(blocks(law, **more))


def springs() -> lf.Elastic:
    return lf.Elastic(normal=lf.LogNormal("k", 30.0, cov=0.3), tangential=lf.Uniform("t", 5.0, 15.0))


def array(*shape: int) -> np.ndarray:
    return np.random.default_rng(len(shape)).uniform(1.0, 2.0, shape)


Given = tuple[np.ndarray, ...]
INPUTS: dict[str, tuple[Given, Callable[..., Any]]] = {
    "Elastic": ((array(POINTS), array(POINTS)), lf.Elastic),
    "Elastic.jump": ((array(POINTS),), lambda a: lf.Elastic(1.0, 1.0, jump=a)),
    "Contact.gap": ((array(POINTS),), lambda a: lf.Contact(gap=a)),
    "Contact.friction": ((array(POINTS),), lambda a: lf.Contact(friction=a, stiffness=a)),
    "Contact.threshold": ((array(POINTS),), lambda a: lf.Contact(threshold=a)),
    "Debonding": ((array(POINTS),), lambda a: lf.Debonding(normal=a, strength=a, opening=10.0 * a)),
    "Displacement": ((array(2),), lf.Displacement),
    "Traction": ((array(2),), lf.Traction),
    "Pressure": ((array(POINTS),), lf.Pressure),
    "calibrate": (
        (array(2, 1), array(1)),
        lambda data, noise: lf.calibrate(joined(springs()), "layer", 0.0 * data, 1e3 * noise, samples=64),
    ),
    "UserLaw.values": (
        (array(POINTS),),
        lambda a: lf.UserLaw(force=lambda jump, k: k[:, None] * jump, values={"k": a}),
    ),
    "law.with_": ((array(POINTS),), lambda a: lf.Elastic(1.0, 1.0).with_(normal=a)),
    "Amplitude": ((np.array([0.0, 1.0]), array(2)), lf.Amplitude),
    "Amplitude * array": ((array(2),), lambda a: lf.Amplitude([0.0, 1.0], [0.0, 1.0]) * a),
    "OrthotropicElastic": (
        (np.array([9.0, 8.0, 7.0]), np.full(3, 0.1), np.full(3, 3.0), np.eye(3)),
        lambda e, nu, g, a: lf.OrthotropicElastic(E=e, nu=nu, G=g, axes=a),
    ),
    "Matrix": (
        (np.eye(12), array(2, 3), array(12), np.array([0, 1])),
        lambda K, x, f, some: lf.Matrix(K, x, {"pull": f}, {"ends": some}, rotations=some),
    ),
    "body force": ((array(2),), lambda a: blocks(force=a)),
    "traction of a scene": ((array(2),), lambda a: blocks(pull=a)),
    "displacement of a scene": ((array(2),), lambda a: blocks(held=a)),
    "assembled loads": ((array(2), array(2), array(2)), lambda a, b, c: joined(pull=a, held=b, force=c)),
    "assembled law": ((array(POINTS),), lambda a: joined(lf.Elastic(a, a))),
    "problem.with_laws": ((array(POINTS),), lambda a: joined().with_laws(values={"layer.normal": a})),
    "solve": ((array(POINTS),), lambda a: lf.solve(joined(lf.Elastic(a, a)))),
    "solve, active": ((array(POINTS),), lambda a: lf.solve(joined(lf.Elastic(a, a)), active=["layer"])),
    "solve(times=)": ((np.array([1.0, 2.0]),), lambda a: history(a)),
    "solve(direction=)": (
        (array(POINTS),),
        lambda a: lf.solve(joined(), active=["layer"], direction=lf.Direction(given={"layer": a})),
    ),
    "Chaos.indices": ((np.array([[0, 0], [1, 0]]),), lambda a: lf.Chaos(order=1, indices=a)),
    "sweep": ((array(3),), lambda a: lf.sweep(joined(), {"layer.normal": a}, progress=False)),
    "sample": (
        (array(3, 2), array(3)),
        lambda a, b: lf.sample(joined(springs()), a, b, "quadrature", progress=False),
    ),
    "chaos.sample": ((array(3, 2), array(3)), lambda a, b: chaos().sample(a, b, "quadrature")),
    "FromSamples": ((array(60),), lambda a: lf.FromSamples("k", a)),
    "fit_distribution": ((array(60),), lambda a: lf.fit_distribution("k", a, ["normal"], resamples=19)),
    "Correlated": (
        (np.array([[1.0, 0.5], [0.5, 1.0]]),),
        lambda a: lf.Correlated([lf.Normal("a", 1.0, cov=0.1), lf.Normal("b", 1.0, cov=0.1)], a),
    ),
}
NO_ARRAYS = (
    "AtPoint BoltStiffness Expression PricedWay Ways compare_ways expression "
    "Beta Cut EnergyBound Errors Estimate FromDistribution Gamma IndefiniteError Interface Law LinearElastic "
    "LogNormal "
    "Material NearlyIndefiniteWarning Normal Options Perfect Plan Preload Quantity RandomField RandomLaws "
    "ResultFileError Resultant SavedResult SceneError SceneWarning StochasticResult Substructure Symmetry "
    "Table TruncatedNormal TruncationError TruncationWarning Uniform discretisation_error errors figures "
    "export geometry io "
    "load make_plan monte_carlo progress quasi_monte_carlo read_step reference sparse_quadrature "
    "BdfDeck InpDeck read_bdf read_deck read_inp read_matrix write_inp "
    "DistributionFit Report Screening report screen "
    "Evaluation Event Fit KinkWarning Posterior ProblemFunction Reliability Response reliability "
    "debug Measure Quantile tensor_quadrature ChaosResult HistoryResult Result SampleResult SweepResult"
)
"""Public names that take no arrays of a user, or are made by what is tried here."""


def chaos() -> Any:
    return lf.solve(joined(springs()), chaos=2)


@pytest.mark.parametrize("name", INPUTS)
def test_what_is_given_is_copied(name: str) -> None:
    given, make = INPUTS[name]
    given = tuple(each.copy() for each in given)
    kept = make(*given)
    for held in reachable(kept):
        for each in given:
            assert not np.shares_memory(held, each), f"{name} keeps what it was given"


def test_every_public_name_is_tried() -> None:
    tried = {name.split(".")[0].split(" ")[0].split("(")[0].split(",")[0] for name in INPUTS}
    tried |= set(NO_ARRAYS.split()) | {"Scene", "Problem", "Direction", "assemble"}
    assert not set(lf.__all__) - tried


def test_swept_parameters_of_the_kernel_are_copied() -> None:
    values = np.array([[10.0, 20.0, 30.0]])
    swept = SweptParameter("layer", "normal", np.ones((1, 1)), values)
    values *= 3.0
    assert np.array_equal(swept.values, [[10.0, 20.0, 30.0]])


# --- out ---------------------------------------------------------------------------------------------
OURS = ("dolfinx_frontend", "latin_core")


def public(root: Any) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Path -> array, and path -> dict or list, for all that public names lead to without arguments."""
    found: dict[str, np.ndarray] = {}
    containers: dict[str, Any] = {}
    seen: dict[int, Any] = {}

    def walk(value: Any, path: str, depth: int) -> None:
        if isinstance(value, np.ndarray):
            found[path] = value
            return
        if depth > 4 or id(value) in seen:
            return
        if isinstance(value, (dict, list)) and (isinstance(value, dict) or "points." not in path):
            containers[path] = value  # lists of a sweep say how it went: nothing is computed from them
        if isinstance(value, Mapping):
            for key, each in value.items():
                walk(each, f"{path}[{key!r}]", depth + 1)
        elif isinstance(value, (list, tuple)):
            for number, each in enumerate(value):
                walk(each, f"{path}[{number}]", depth + 1)
        if not type(value).__module__.startswith(OURS) and not (is_dataclass(value) and depth == 0):
            if all(hasattr(value, what) for what in ("indptr", "indices", "data")):
                for what in ("indptr", "indices", "data"):
                    found[f"{path}.{what}"] = getattr(value, what)
            return
        seen[id(value)] = value
        for name in dir(value):
            if name.startswith("_"):
                continue
            try:
                each = getattr(value, name)
            except Exception:  # what it does not have here, it says so
                continue
            if not callable(each) or isinstance(each, np.ndarray):
                walk(each, f"{path}.{name}", depth + 1)

    walk(root, "it", 0)
    return found, containers


def history(times: Any = (1.0, 2.0)) -> Any:
    push = lf.Amplitude([0.0, 1.0, 2.0], [0.0, 1.0, 0.5]) * (-1.0, 0.2)
    return lf.solve(joined(lf.Contact(friction=0.3, stiffness=100.0), pull=push, bed=True), times=times)


def saved(folder: Path, result: Any) -> Any:
    result.save(folder / "result.h5")
    return lf.load(folder / "result.h5")


def chaos_file(folder: Path) -> Any:
    chaos().save_chaos(folder / "chaos.json")
    return load_chaos(folder / "chaos.json")


OUTPUTS: dict[str, Callable[[Path], Any]] = {
    "problem": lambda _: joined(lf.Elastic(array(POINTS), 1.0)),
    "plan": lambda _: lf.make_plan(joined(lf.Contact(friction=0.3)), times=[1.0, 2.0]),
    "result": lambda _: lf.solve(joined(), active=["layer"]),
    "direct": lambda _: lf.solve(joined()),
    "history": lambda _: history(),
    "chaos": lambda _: chaos(),
    "samples": lambda _: lf.monte_carlo(joined(springs()), 4, progress=False),
    "sweep": lambda _: lf.sweep(joined(), {"layer.normal": [10.0, 20.0]}, progress=False, keep_states=True),
    "space": lambda _: chaos().space,
    "basis": lambda _: chaos().basis,
    "random laws": lambda _: chaos().random,
    "amplitude": lambda _: lf.Amplitude([0.0, 1.0], [0.0, 1.0]),
    "law": lambda _: lf.Elastic(array(POINTS), array(POINTS)),
    "from samples": lambda _: lf.FromSamples("k", array(60)),
    "block": lambda _: next(iter(chaos().blocks(4))),
    "quantity": lambda _: chaos().quantity(lambda block: block.force("layer")[..., 0].max(axis=1)),
    "table": lambda _: lf.solve(joined()).table(),
    "errors": lambda _: chaos().errors("layer"),
    "saved result": lambda folder: saved(folder, lf.solve(joined())),
    "saved chaos": lambda folder: saved(folder, chaos()),
    "chaos file": chaos_file,
}


@pytest.mark.parametrize("name", OUTPUTS)
def test_what_is_handed_out_cannot_change_the_object(name: str, tmp_path: Path) -> None:
    thing = OUTPUTS[name](tmp_path)
    arrays, containers = public(thing)
    before = {path: values.copy() for path, values in arrays.items()}
    sizes = {path: len(each) for path, each in containers.items()}
    for path, values in public(thing)[0].items():
        if values.size and values.dtype.kind in "fiub":
            try:
                values[...] = 1 - values if values.dtype.kind == "b" else values + 1
            except ValueError as error:
                assert "read-only" in str(error), path
    for path, each in public(thing)[1].items():
        try:
            each.clear()
        except TypeError as error:
            assert "read-only" in str(error), path
    after, containers = public(thing)
    assert {path: len(each) for path, each in containers.items()} == sizes
    assert after.keys() == before.keys()
    for path, values in after.items():
        assert np.array_equal(values, before[path], equal_nan=values.dtype.kind == "f"), path
