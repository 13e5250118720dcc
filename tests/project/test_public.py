"""Every public name: documented, in the reference, found by completion, and told apart by its repr."""

from __future__ import annotations

import importlib
import inspect
import re
import subprocess
import sys
import tomllib
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

import dolfinx_frontend
import latin_core
from dolfinx_frontend import (
    Amplitude,
    AtPoint,
    BdfDeck,
    Beta,
    BoltStiffness,
    Chaos,
    Contact,
    Correlated,
    Cut,
    Debonding,
    Direction,
    Displacement,
    DistributionFit,
    Elastic,
    FromDistribution,
    FromSamples,
    Gamma,
    InpDeck,
    LinearElastic,
    LogNormal,
    Measure,
    Normal,
    Options,
    OrthotropicElastic,
    Perfect,
    Preload,
    Pressure,
    RandomField,
    Quantile,
    Resultant,
    Response,
    Scene,
    StepAssembly,
    Symmetry,
    Traction,
    TruncatedNormal,
    Uniform,
    UserLaw,
    assemble,
    calibrate,
    compare_ways,
    geometry,
    load,
    make_plan,
    read_bdf,
    read_inp,
    read_step,
    reliability,
    report,
    screen,
    solve,
    sweep,
)
from dolfinx_frontend.kernel import bridge
from dolfinx_frontend.plan import random_laws as stochastic
from dolfinx_frontend.uncertainty.fitting import Candidate
from tests.decks.decks import STEEL, Brick
from tests.kernel import bars

DOCS = Path(__file__).resolve().parents[2] / "docs"
MANY = np.linspace(0.0, 1.0, 500)
LONGEST = 1200
"""Characters that anything may take."""
LINES = 30
HEAVY = (
    *("scipy", "pandas", "matplotlib", "openturns", "h5py", "pyvista", "vtkmodules", "meshio", "sksparse"),
    *("PIL", "IPython", "urllib.request", "dolfinx_frontend.figures", "dolfinx_frontend.sheets"),
)
"""What a plain import does not load."""


def scene_of(law: Any) -> Scene:
    scene = Scene()
    for name, x0 in (("left", 0.0), ("right", 1.0)):
        block = geometry.box((1.0, 1.0), (2, 2), origin=(x0, 0.0))
        scene.substructure(name, block, LinearElastic(100.0, 0.3), degree=2)
    scene.interface("layer", "left:x1", "right:x0", law)
    scene.fix("left:x0")
    scene.traction("right:x1", (1.0, 0.0))
    return scene


def laws() -> list[Any]:
    """Laws and values, some with long arrays in them."""
    ramp = Amplitude(list(MANY), list(MANY))

    def push(jump: Any) -> Any:
        return jump

    return [
        ramp,
        ramp * MANY + 1.0,
        Perfect(),
        Elastic(normal=MANY, tangential=lambda x: x[:, 0]),
        Contact(gap=MANY, friction=0.2),
        Debonding(normal=1.0, strength=1.0, energy=2.0),
        Preload(ramp * 100.0, until=1.0),
        UserLaw(force=push, values={"a": MANY}),
        Displacement((0.0, 1.0), (0,)),
        Symmetry(),
        Pressure(ramp * 2.0),
        Traction(MANY),
    ]


def randoms() -> list[Any]:
    stats = pytest.importorskip("scipy.stats")
    a, b = Normal("a", mean=1.0, std=0.1), Uniform("b", 0.0, 1.0)
    return [
        a,
        b,
        LogNormal("c", mean=1.0, cov=0.1),
        Gamma("d", mean=1.0, cov=0.1),
        Beta("e", a=2.0, b=3.0, lower=0.0, upper=1.0),
        TruncatedNormal("f", mean=1.0, std=0.1, lower=0.0),
        FromSamples("g", 1.0 + MANY),
        FromDistribution("h", stats.expon()),
        Correlated([a, Normal("i", mean=1.0, std=0.1)], [[1.0, 0.5], [0.5, 1.0]]),
        RandomField("j", mean=1.0, cov=0.1, length=1.0),
        Chaos(order=2),
        2 * a + b,
    ]


def step_assembly(folder: Path) -> StepAssembly:
    """Two touching boxes, written and read."""
    with geometry.gmsh_session() as gmsh:
        gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        gmsh.model.occ.addBox(1, 0, 0, 1, 1, 1)
        gmsh.model.occ.synchronize()
        gmsh.write(str(folder / "boxes.step"))
    return read_step(folder / "boxes.step")


def deck(folder: Path) -> InpDeck:
    """A cube."""
    text = Brick("C3D8R", "CUBE", (1.0, 1.0, 1.0), (1, 1, 1)).text() + STEEL
    (folder / "cube.inp").write_text(f"{text}*BOUNDARY\nCUBE_Z0, 1, 3\n*STEP\n*STATIC\n*END STEP\n")
    return read_inp(folder / "cube.inp")


def bulk(folder: Path) -> BdfDeck:
    """A tetrahedron."""
    corners = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
    cards = [f"GRID,{k + 1},,{x}.,{y}.,{z}." for k, (x, y, z) in enumerate(corners)]
    cards += ["CTETRA,1,1,1,2,3,4", "PSOLID,1,1", "MAT1,1,1.,,.3", "SPC1,1,123,1,2,3"]
    (folder / "cell.bdf").write_text("\n".join(["SPC = 1", "BEGIN BULK", *cards]))
    return read_bdf(folder / "cell.bdf")


def kernel() -> list[Any]:
    """Of the kernel without a frontend."""
    structure = bars.chain()
    sides = [bars.side(0, 0), latin_core.Side(member="elsewhere")]
    part = bars.member(0)
    spring = latin_core.Spring(
        name="hold",
        members=[0],
        traces=[bars.at(0)],
        frames=[[1.0]],
        stiffness=[1.0],
        jump=[[0.0]],
    )
    return [
        *(structure, structure.laws(), *sides, bars.interface("wall", "perfect", sides[0])),
        latin_core.Elimination(stiffness=sp.eye_array(4, format="csr"), kept=2, name="bar0"),
        *(part, spring, latin_core.Body(name="bar0", size=bars.NODES, members=[part], springs=[spring])),
        latin_core.python_law(name="own", resolve=lambda *_: None),
    ]


def questions(problem: Any) -> list[Any]:
    """The problem as a function, and what is asked of it."""
    function = problem.function("layer")
    event = Response("layer") > 2.0
    fit = calibrate(problem, "layer", [1.0], 0.1, "least squares", inputs=["k"])
    posterior = calibrate(problem, "layer", [1.0], 0.1, samples=64)
    found = function.evaluate(MANY[1:300, None] * 30.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        rare = reliability(problem, event, "monte carlo", most=100)
    screened = screen(problem, "layer", points=8)
    return [function, found, event, Response("layer"), fit, posterior, rare, screened]


def bound() -> list[Any]:
    """A proven error, and the stress in balance that it is made with."""
    scene = Scene()
    square = geometry.box((1.0, 1.0), (1, 1), cell="triangle")
    scene.substructure("left", square, LinearElastic(100.0, 0.3), degree=1)
    scene.fix("left:x0")
    scene.pressure("left:x1", 1e-3)
    made = latin_core.Equilibration(
        vertices=np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
        corners=np.arange(3),
        stress=np.zeros((3, 3)),
        force=np.zeros((2, 1)),
        compliance=[np.eye(3)],
        material=np.zeros(1, dtype=np.int64),
        rest=np.zeros((0, 0)),
        shift=np.zeros((0, 0)),
        facets=np.arange(2),
        moments=np.zeros((4, 1)),
        held=np.zeros((4, 1)),
    )
    return [solve(assemble(scene)).errors(kind="bound"), made]


@pytest.fixture(scope="module")
def things(tmp_path_factory: Any) -> list[Any]:
    """One of everything that is public."""
    k = LogNormal("k", mean=30.0, cov=0.1)
    scene = scene_of(Elastic(normal=k, tangential=k))
    problem = assemble(scene)
    plan = make_plan(problem, active="all")
    ways = compare_ways(problem, chaos=(2,))
    result = solve(problem, active="all")
    still = assemble(scene_of(Elastic(normal=30.0, tangential=10.0)))
    history = solve(still, times=list(MANY[1:20]), active="all")
    chaos = solve(problem, chaos=2)
    samples = chaos.monte_carlo(50)
    swept = sweep(problem, {"layer.normal": MANY[1:30]})
    result.save(tmp_path_factory.mktemp("public") / "a.h5")
    quantity = chaos.quantity(lambda f: f.force("layer")[:, 0, 0], "force", "N/mm2", samples=1000)
    interface, part = problem.interfaces["layer"], problem.substructures["left"]
    return [
        *laws(),
        *randoms(),
        *(scene, part.part, problem, part, interface, interface.sides[0], plan, plan.cost, result, history),
        *(LinearElastic(1.0, 0.3), Direction(), Options(), Direction(given={"layer": MANY[1:]})),
        *(AtPoint(problem, "left", (0.5, 0.5, 0.5)[: problem.dim]), BoltStiffness(1.0, 2.0, 3.0)),
        *(Resultant("layer"), Measure(len, "count"), Quantile(len, 0.9), Cut("left", normal=(1, 0, 0))),
        step_assembly(tmp_path_factory.mktemp("step")),
        deck(tmp_path_factory.mktemp("deck")),
        bulk(tmp_path_factory.mktemp("bulk")),
        chaos.errors("layer"),
        OrthotropicElastic(E=(10.0, 2.0, 1.0), nu=(0.3, 0.2, 0.1), G=(1.0, 0.7, 0.5)),
        *(result.summary, result.state, result.summary.history[0], result.table()),
        *(result.solver, result.laws, bridge.build(problem, plan).structure),
        *(chaos, chaos.random, chaos.space, chaos.basis, chaos.basis.indices, chaos.space.germs[0]),
        *(chaos.at([[0.0]]), chaos.truncation("layer"), samples, samples.points, swept, swept.points),
        *(load(tmp_path_factory.getbasetemp() / "public0" / "a.h5"), quantity, quantity.mean()),
        stochastic.RandomLaws.of(problem),
        *(ways, ways["chaos=2"], plan.price),
        *questions(problem),
        report(result, pictures=False, errors=False),
        *bound(),
        dolfinx_frontend.Matrix(np.eye(12), [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]),
        DistributionFit("k", 9, (Candidate("normal", None, 1.0, 0.1, 3.0, 3.5, 0.4, 0.3),), ("few values",)),
        result.solver.linearised(result.laws, result.state),
        *kernel(),
        latin_core.SweptParameter("layer", "normal", np.ones((1, 1)), MANY[None]),
        latin_core.Beginning(),
        latin_core.Checkpoint(tmp_path_factory.mktemp("public") / "points", {}),
    ]


def test_representations_help(things: list[Any]) -> None:
    """A few lines with the class or what it is, no addresses, no arrays of hundreds of numbers."""
    for thing in things:
        text = repr(thing)
        assert " at 0x" not in text and "<lambda> at" not in text, text
        assert len(text) <= LONGEST and text.count("\n") <= LINES, text
        own = type(thing).__name__
        words = {"Table": "interface", "Quantity": "samples", "Varying": "Amplitude"}
        words |= {"WitnessedQuantity": "chaos"}
        parameter = type(thing).__module__.startswith("dolfinx_frontend.uncertainty.")
        assert words.get(own, own) in text or parameter, text


def test_every_public_class_is_shown(things: list[Any]) -> None:
    seen = {cls for thing in things for cls in type(thing).__mro__}
    for package in (dolfinx_frontend, latin_core):
        for name in package.__all__:
            cls = getattr(package, name)
            if not inspect.isclass(cls) or issubclass(cls, BaseException) or inspect.isabstract(cls):
                continue
            if getattr(cls, "_is_protocol", False):
                continue
            assert cls in seen, name


def modules() -> list[str]:
    """Modules of the reference."""
    pages = "".join(page.read_text() for page in (DOCS / "api").glob("*.md"))
    return re.findall(r"automodule:: (\S+)", pages)


def members(cls: type) -> Iterator[tuple[str, Any]]:
    """Public methods and properties of ours."""
    for name, value in vars(cls).items():
        if name.startswith("_"):
            continue
        if isinstance(value, (property, staticmethod, classmethod)) or inspect.isfunction(value):
            yield name, value


@pytest.mark.parametrize("module_name", modules())
def test_public_names_are_documented(module_name: str) -> None:
    module = importlib.import_module(module_name)
    assert module.__doc__
    for name in module.__all__:
        thing = getattr(module, name)
        if inspect.isfunction(thing) or inspect.isclass(thing):
            assert inspect.getdoc(thing), f"{module_name}.{name}"
            assert getattr(thing, "__doc__", None) is not None, f"{module_name}.{name}"
        if inspect.isclass(thing) and thing.__module__ == module_name:
            for member, value in members(thing):
                found = inspect.getdoc(getattr(thing, member)) or getattr(value, "__doc__", None)
                assert found, f"{module_name}.{name}.{member}"


def test_completion_finds_every_module_and_name() -> None:
    names = dir(dolfinx_frontend)
    assert set(dolfinx_frontend.__all__) <= set(names)
    assert sorted(dolfinx_frontend.__all__) == dolfinx_frontend.__all__
    for module in modules():
        package, _, name = module.rpartition(".")
        assert not package or name in dir(importlib.import_module(package)), module


def test_what_is_heavy_is_loaded_when_it_is_used() -> None:
    """Importing takes little time: what others load is not there yet, nor what draws and reports."""
    text = (
        "import sys, dolfinx, dolfinx.fem.petsc, gmsh\n"
        "before = set(sys.modules)\n"
        "import dolfinx_frontend as lf\n"
        "new = [f'{each}.' for each in set(sys.modules) - before]\n"
        f"print([each for each in {HEAVY} if any(one.startswith(f'{{each}}.') for one in new)])\n"
        "print(lf.report.__module__, lf.Report.__name__, lf.figures.__name__, lf.sheets.__name__)"
    )
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True)
    own = [f"dolfinx_frontend.{each}" for each in ("sheets.report", "figures", "sheets")]
    assert done.stdout.split("\n")[:2] == ["[]", f"{own[0]} Report {own[1]} {own[2]}"]
    with pytest.raises(AttributeError, match="has no attribute 'reprot'"):
        getattr(dolfinx_frontend, "reprot")


def test_types_are_shipped() -> None:
    for package in (dolfinx_frontend, latin_core):
        assert Path(package.__file__ or "").with_name("py.typed").is_file(), package.__name__
    assert Path(latin_core.__file__).with_name("_core.pyi").is_file()


def test_version_is_that_of_the_project() -> None:
    with (DOCS.parent / "pyproject.toml").open("rb") as file:
        version = tomllib.load(file)["project"]["version"]
    assert latin_core.__version__ == dolfinx_frontend.__version__ == version


def test_import_star_gives_the_public_names() -> None:
    names: dict[str, object] = {}
    exec("from dolfinx_frontend import *", names)
    assert set(names) - {"__builtins__"} == set(dolfinx_frontend.__all__)
