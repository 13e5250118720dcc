"""Scenes of other mended faults: faces whose meshes do not match, events, posteriors, gradients, many
parts."""

from __future__ import annotations

import math
import warnings
from typing import Any

import dolfinx_frontend as lf
import numpy as np
from scipy import stats

from frozen.fixed_parts import (
    STEEL,
    Known,
    asked,
    beyond,
    box,
    joined,
    layers,
    options,
    pair_and_light,
    right,
    square,
    within,
)
from frozen.registry import Right, scene

GROUP = "fixed"
CLOSED, BALANCE = "closed form", "balance of forces"
STRESS = "uniform stress"


# -- faces -----------------------------------------------------------------------------------------
BRICKS = {
    "base": ("quadrilateral", (12, 1), (0.0, 0.4), (1.0, 0.5), "x0 x1"),
    "floor": ("triangle", (3, 2), (0.0, 0.0), (1.0, 0.4), "x0 x1 y0"),
    "west": ("triangle", (5, 4), (0.0, 0.5), (0.5, 1.0), "x0 y1"),
    "east": ("quadrilateral", (1, 1), (0.5, 0.5), (1.0, 1.0), "x1 y1"),
}
LAYERS = {
    "wall": ("tetrahedron", (5, 5, 5), (0.0, 1.5, 0.0), (3.0, 3.0, 1.0), "x0 x1 y1 z0 z1"),
    "low": ("tetrahedron", (4, 3, 1), (0.0, 0.0, 0.0), (3.0, 1.5, 0.5), "x0 x1 y0 z0"),
    "high": ("hexahedron", (5, 4, 1), (0.0, 0.0, 0.5), (3.0, 1.5, 1.0), "x0 x1 y0 z1"),
}
QUARTERS = {
    "roof": ("triangle", (5, 4), (0.0, 1.5), (3.0, 3.0), "x0 x1 y1"),
    "west": ("triangle", (2, 3), (0.0, 0.0), (0.75, 1.5), "x0 y0"),
    "middle": ("triangle", (12, 12), (0.75, 0.0), (1.5, 1.5), "y0"),
    "east": ("triangle", (12, 12), (1.5, 0.0), (3.0, 1.5), "x1 y0"),
}
# ties and contacts (with !): parts that meet, in the order of names
MEETING = {
    "bricks": (BRICKS, "west:x1-east:x0 floor:y1-base:y0 west:y0-base:y1 east:y0-base:y1"),
    "turned": (BRICKS, "east:y0-base:y1 west:y0-base:y1 floor:y1-base:y0 west:x1-east:x0"),
    "layers": (LAYERS, "low:y1-wall:y0! low:z1-high:z0 wall:y0-high:y1!"),
    "quarters": (QUARTERS,
                 "east:y1-roof:y0! west:y1-roof:y0 west:x1-middle:x0! middle:y1-roof:y0 middle:x1-east:x0"),
}
PRESSED = np.array((0.5, 1.0, 0.7)) * -1e8


def meeting(name: str, rtol: float) -> Any:
    """Parts of one material under uniform compression."""
    parts, joints = MEETING[name]
    made, d = lf.Scene(), len(next(iter(parts.values()))[2])
    E, nu = 2e11, 0.45
    stress = PRESSED[:d]
    strain = (stress - (nu if d == 2 else nu / (1.0 + nu)) * stress.sum()) * (1.0 + nu) / E
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # degree 1 with this nu, and faces that differ
        for part, (cell, n, low, high, held) in parts.items():
            box(made, part, np.subtract(high, low).tolist(), n, low, lf.LinearElastic(E, nu), cell=cell)
            made.fix([f"{part}:{face}" for face in held.split()], value=lambda x: x[:, :d] * strain)
        for k, joint in enumerate(joints.split()):
            law = lf.Contact() if "!" in joint else lf.Perfect()
            made.interface(f"j{k}", *joint.strip("!").split("-"), law, overlap="partial")
        return lf.solve(lf.assemble(made), options=options(rtol))


@scene(GROUP, {
    "layers.j0.normal": Right(1.5 * PRESSED[1], 1e-6, STRESS),
    "layers.j2.normal": Right(1.5 * PRESSED[1], 1e-6, STRESS),
    "quarters.j0.normal": Right(1.5 * PRESSED[1], 1e-6, STRESS),
    "quarters.j2.normal": Right(1.5 * PRESSED[0], 1e-6, STRESS),
})
def parts_that_meet(rtol: float) -> Any:
    """"Mortar where many parts meet": forces were not unique, pressures nine times too large."""
    return {name: meeting(name, rtol) for name in MEETING}


@scene(GROUP, {"gap.normal": Right(-30e9 * (1e-3 - 2e-4) / (3.0 - 2e-4) * 0.16, 1e-6, CLOSED)})
def facets_of_one_and_seven(rtol: float) -> Any:
    """Space `mortar`, "chosen by default where meshes do not match": a column with a gap, shortened."""
    made = lf.Scene()
    for name, n, low, high in (("foot", 1, 0.0, 1.0), ("head", 7, 1.0002, 3.0)):
        box(made, name, (0.4, 0.4, high - low), (n, n, 2), (0.0, 0.0, low), lf.LinearElastic(30e9, 0.0),
            cell="tetrahedron")
    made.interface("gap", "foot:z1", "head:z0", lf.Contact())
    made.fix("foot:z0")
    made.fix("head:z1", value=(0.0, 0.0, -1e-3))
    made.symmetry(["head:x0", "head:y0"])
    return lf.solve(lf.assemble(made), options=options(rtol))


@scene(GROUP)
def a_beam_on_supports_that_it_covers_partly(rtol: float) -> Any:
    """"vertices outside of what is common have none (their pressures were up to nine times too large)"."""
    made = lf.Scene()
    for name, n, low, high in (("beam", (23, 3), (0.0, 0.0), (10.0, 1.0)),
                               ("post", (5, 4), (-0.5, -2.0), (0.7, 0.0)),
                               ("pier", (4, 3), (8.3, -2.0), (10.9, 0.0))):
        box(made, name, np.subtract(high, low).tolist(), n, low, lf.LinearElastic(7.0, 0.3), degree=2,
            cell="triangle")
    made.interface("tie", "post:y1", "beam:y0", lf.Perfect(), overlap="partial")
    made.interface("rest", "beam:y0", "pier:y1", lf.Contact(gap=0.0), overlap="partial")
    made.fix(["post:y0", "pier:y0"])
    made.traction("beam:y1", lambda x: np.column_stack([0.0 * x[:, 0], -1e-3 * x[:, 0]]))
    return lf.solve(lf.assemble(made), active=["tie", "rest"], options=options(rtol))


SPACES = ("points", "facets", "mortar")


@scene(GROUP, {f"{space}.joint.normal": Right(-6.0, 1e-6, BALANCE) for space in SPACES})
def spaces_of_an_interface(rtol: float) -> Any:
    """"Interface space facets", "mortar": an uneven pressure between meshes that do not match."""
    out = {}
    for space in SPACES:
        made = lf.Scene()
        for name, y, n in (("low", 0.0, (4, 3)), ("up", 1.0, (7, 3))):
            box(made, name, (3.0, 1.0), n, (0.0, y), lf.LinearElastic(100.0, 0.3), degree=2,
                cell="quadrilateral")
        made.fix("low:y0")
        made.symmetry("up:x0")
        made.traction("up:y1", lambda x: np.column_stack([0.0 * x[:, 0], -3.0 + 2.0 * x[:, 0] / 3.0]))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of points
            made.interface("joint", "low:y1", "up:y0", lf.Contact(friction=0.2), space=space)
            out[space] = lf.solve(lf.assemble(made), options=options(rtol))
    return out


# -- many parts ------------------------------------------------------------------------------------
def chain(count: int, nu: float, friction: float | None) -> lf.Problem:
    """Blocks in a row, each on a bed; friction in every fourth joint."""
    made = lf.Scene()
    for k in range(count):
        box(made, f"b{k}", (10.0, 10.0), (3, 3), (10.0 * k, 0.0), lf.LinearElastic(200e3, nu), degree=2)
        made.interface(f"bed{k}", f"b{k}:y0", lf.Elastic(normal=300.0, tangential=300.0))
    made.fix("b0:x0")
    for k in range(1, count):
        law: Any = lf.Elastic(normal=2e4,
                              tangential=5e3) if friction is None or k % 4 else lf.Contact(friction=friction)
        made.interface(f"j{k}", f"b{k - 1}:x1", f"b{k}:x0", law)
    made.traction(f"b{count - 1}:x1", (-20.0, 3.0))
    return lf.assemble(made)


@scene(GROUP, limit=120.0)
def chains_of_many_parts(rtol: float) -> Any:
    """"the number of iterations does not depend on the number of parts or on nu, and hardly on k"; "from a
    state of other meshes or loads, the coarse problem made accelerated steps that undid each other"."""
    plain = options(rtol, newton=0)
    return {
        "eight": lf.solve(chain(8, 0.3, 0.3), options=plain),
        "many": lf.solve(chain(32, 0.3, 0.3), options=plain),
        "rubber": lf.solve(chain(8, 0.49, None), active="all", options=plain),
        "stiff": lf.solve(chain(8, 0.3, 0.3), direction=100.0, options=plain),
        "single": lf.solve(chain(8, 0.3, None), active="all", options=options(rtol, precision="single")),
    }


@scene(GROUP, {"opened.stop.normal": Right(0.0, 1e-6, "nothing touches")}, limit=120.0)
def rows_that_open(rtol: float) -> Any:
    """"The search for parts without support starts from the forces that were reached"; a wall of parts with
    friction."""
    made = lf.Scene()
    for k in range(24):
        square(made, f"b{k}", float(k), 0.0, 2e5)
    laws: dict[str, Any] = {"wall": lf.Displacement(0.0), "push": lf.Traction(np.array((-10.0, 1.0)))}
    faces = {"wall": ["b0:x0"], "push": ["b23:x1"]}
    for k in range(1, 24):
        laws[f"j{k}"], faces[f"j{k}"] = lf.Contact(friction=0.4), [f"b{k - 1}:x1", f"b{k}:x0"]
        laws[f"bed{k}"], faces[f"bed{k}"] = lf.Contact(friction=0.1), [f"b{k}:y0"]
    laws["top"], faces["top"] = lf.Traction(np.array((0.0, -5.0))), ["b23:y1"]
    apart = lf.Scene()
    square(apart, "a", 0.0, 0.0)
    apart.fix("a:x0")
    apart.interface("stop", "a:x1", lf.Contact(gap=0.1))
    apart.traction("a:y1", (1.0, 0.0))
    return {"row": lf.solve(joined(made, laws, faces), options=options(rtol)),
            "opened": lf.solve(lf.assemble(apart), options=options(rtol))}


@scene(GROUP, limit=120.0)
def bodies_without_a_factor(rtol: float) -> Any:
    """`Options(backend="multigrid")`: a direct solution, an active joint, a chaos and a sweep."""
    made = lf.Scene()
    for k in range(3):
        box(made, f"b{k}", (10.0,) * 3, (3, 3, 3), (10.0 * k, 0.0, 0.0), lf.LinearElastic(200e3, 0.3),
            degree=2, cell="hexahedron")
    made.interface("ground", "b0:x0", lf.Elastic(normal=2e4, tangential=1e4))
    stiffness = lf.LogNormal("k", 1e4, cov=0.2)
    made.interface("joint", "b0:x1", "b1:x0", lf.Elastic(normal=stiffness, tangential=5e3))
    made.interface("glue", "b1:x1", "b2:x0", lf.Perfect())
    made.fix("b2:x1", (0.0, 0.0, -0.01))
    made.pressure("b1:z1", 20.0)
    problem = lf.assemble(made)
    multigrid = lf.Options(rtol=max(rtol, 1e-7), backend="multigrid")
    return {
        "direct": lf.solve(problem, options=multigrid),
        "factor": lf.solve(problem, options=options(rtol)),
        "active": lf.solve(problem, active=["joint"], options=multigrid),
        "chaos": lf.solve(problem, chaos=2, options=multigrid),
        "sweep": lf.sweep(problem, {"joint.normal": [1e2, 1e4, 1e6]}, options=multigrid, progress=False),
    }


# -- random parts and expressions ------------------------------------------------------------------
RODS = 10.0 * (10.0 / 200.0 * (1.0 + 0.2**2) + 10.0 / 200.0 + 1.0 / 40.0)
"""End of a rod of a lognormal modulus, one that is known and a layer: E[1/x] = 1 + cov^2."""


@scene(GROUP, {"moved": Right(RODS, 1e-5, CLOSED)})
def random_moduli(rtol: float) -> Any:
    """"A linear chaos in which stiffnesses of parts vary is solved at once"; samples; a modulus after
    assembly."""
    made = lf.Scene()
    for k, E in enumerate((lf.LogNormal("E", 200.0, cov=0.2), 200.0)):
        box(made, f"b{k}", (10.0, 4.0), (2, 2), (10.0 * k, 0.0), lf.LinearElastic(E, 0.0))
    made.interface("l0", "b0:x1", "b1:x0", lf.Elastic(normal=40.0, tangential=10.0))
    made.fix("b0:x0")
    made.traction("b1:x1", (10.0, 0.0), name="load")
    problem = lf.assemble(made)
    chaos = lf.solve(problem, chaos=8, options=options(rtol))
    return {
        "chaos": chaos,
        "moved": within(float(chaos.displacements["b1"].reshape(-1, 2)[:, 0].max()), 1e-8),
        "samples": lf.quasi_monte_carlo(problem, 32, options=options(rtol), keep_states=True, progress=False),
    }


@scene(GROUP, {"before": Right(10.0, 1e-9, STRESS), "after": Right(10.0, 1e-9, STRESS),
               "ratio": Right(0.5, 1e-9, CLOSED)})
def a_modulus_after_assembly(rtol: float) -> Any:
    """"stresses of such a part after with_laws(values={"body.E": ...}) were those of the old modulus"."""
    made = lf.Scene()
    box(made, "body", (10.0, 4.0), (2, 2), (0.0, 0.0), lf.LinearElastic(200.0, 0.0))
    made.fix("body:x0")
    made.traction("body:x1", (10.0, 0.0), name="load")
    problem = lf.assemble(made)
    out, ends = {}, []
    for name, each in (("before", problem), ("after", problem.with_laws(values={"body.E": 400.0}))):
        result = lf.solve(each, options=options(rtol))
        at = lf.AtPoint(each, "body", (5.0, 2.0), "stress", "xx")
        out[name] = float(result.quantity(at).mean().value)
        ends.append(float(result.displacements["body"].max()))
    return {**out, "ratio": ends[1] / ends[0]}


@scene(GROUP, {"errors.mean": Right(40.0 / 40.0 + 0.5 * 10.0 * 1.16 + 0.25 * 10.0, 1e-3, CLOSED)})
def strains_that_scatter(_: float) -> Any:
    """"The truncation of a chaos counts in the strains of parts whose stiffness varies": their forces are
    given."""
    made = lf.Scene()
    for k, E in enumerate((lf.LogNormal("E", 200.0, cov=0.4), 400.0)):
        box(made, f"b{k}", (10.0, 4.0), (2, 2), (10.0 * k, 0.0), lf.LinearElastic(E, 0.0))
    made.interface("l0", "b0:x1", "b1:x0", lf.Elastic(normal=100.0, tangential=100.0))
    made.fix("b0:x0")
    made.traction("b1:x1", (100.0, 0.0), name="load")
    problem = lf.assemble(made)
    return asked(problem, 1e-3, lf.AtPoint(problem, "b1", (20.0, 2.0), component="x"))


@scene(GROUP)
def trust_of_a_chaos(rtol: float) -> Any:
    """"trusted of a linear chaos says whether its truncation is within the tolerance"."""
    out: dict[str, Any] = {}
    for cov, order in ((0.1, 2), (0.3, 3), (2.0, 2)):
        made = lf.Scene()
        for k in range(2):
            box(made, f"b{k}", (1.0, 1.0), (1, 1), (float(k), 0.0), lf.LinearElastic(1000.0, 0.25))
        made.fix("b0:x0")
        made.fix("b1:x1", (1e-3, 2e-4))
        law = lf.Elastic(normal=lf.LogNormal("k", 1e3, cov=cov), tangential=300.0)
        made.interface("joint", "b0:x1", "b1:x0", law)
        result = lf.solve(lf.assemble(made), chaos=order, options=options(rtol))
        out[f"{cov:g}"] = {"result": result, "trusted": bool(result.trusted)}
    return out


@scene(GROUP, {"held.contact.normal": Right(-0.1, 1e-6, BALANCE),
               "moved.a.u_x": Right(0.25, 1e-9, "a rigid motion"),
               "turned": Right(0.0, 1e-12, "a rigid motion")})
def parts_that_are_held_or_moved_as_a_whole(rtol: float) -> Any:
    """"A part whose supports leave nothing free keeps one of them"; "A part that is moved as a whole
    converges"."""
    held = lf.Scene()
    box(held, "held", (1.0, 1.0), (1, 1), (0.0, 0.0), lf.LinearElastic(1.0, 0.3), cell="triangle")
    box(held, "pressed", (1.0, 1.0), (4, 1), (1.0, 0.0), lf.LinearElastic(1.0, 0.0), cell="triangle")
    held.interface("below", "held:y0", lf.Displacement(0.0))
    held.interface("above", "held:y1", lf.Displacement((0.0, 0.0)))
    held.interface("contact", "held:x1", "pressed:x0", lf.Contact())
    held.interface("guide", "pressed:y0", lf.Symmetry())
    held.interface("load", "pressed:x1", lf.Pressure(0.1))
    whole = lf.Scene()
    box(whole, "a", (30.0, 10.0, 10.0), (6, 2, 2), (0.0,) * 3, lf.LinearElastic(200e3, 0.3),
        cell="hexahedron")
    given = {"x": 0.25, "y": 0.0, "z": 0.0, "rx": 0.01, "ry": 0.0, "rz": 0.0}
    whole.rigid("a:x0", point=(0, 0, 0), **given)
    problem = lf.assemble(whole)
    moved = lf.solve(problem, options=options(rtol))
    exact = np.array((0.25, 0.0, 0.0)) + np.cross((0.01, 0.0, 0.0),
                                                  problem.substructures["a"].dof_coordinates)
    off = float(np.abs(moved.unknowns("a").reshape(-1, 3) - exact).max())
    turned = beyond(off, 1e-12)
    return {"held": lf.solve(lf.assemble(held), options=options(rtol)), "moved": moved, "turned": turned}


@scene(GROUP, right(1e-3, sum=Known(10.0 / 40.0 * 1.04 + 0.1 * 10.0)))
def expressions(_: float) -> Any:
    """"Expressions of random numbers": twice a half, and a load that is a sum."""
    k, q = lf.LogNormal("k", 20.0, cov=0.2), lf.Normal("q", 0.0, std=1.0)
    made = lf.Scene()
    for n in range(2):
        box(made, f"b{n}", (10.0, 4.0), (2, 2), (10.0 * n, 0.0), lf.LinearElastic(200.0, 0.0))
    made.interface("l0", "b0:x1", "b1:x0", lf.Elastic(normal=2.0 * k, tangential=10.0))
    made.fix("b0:x0")
    made.traction("b1:x1", (10.0 + 0.1 * q, 0.0), name="load")
    quantity = lf.AtPoint(problem := lf.assemble(made), "b1", (20.0, 2.0), component="x")
    return {"sum": asked(problem, 1e-3, quantity)}


# -- events, data, gradients -----------------------------------------------------------------------
K, D, K_COV, D_COV, Q_COV = 5e4, 0.2, 0.1, 0.1, 0.15
AREA, JOINT = 600.0, 4e5
RARE, LESS_RARE, TAIL = 3772.905, 4500.0, 5200.0


def joints(load: float) -> lf.Problem:
    """A joint with a bolt and a layer that bears, pulled by a random load: it opens where Q > K D."""
    made = lf.Scene()
    for level, name in enumerate(("base", "cover")):
        box(made, name, (20.0, 30.0, 10.0), (2, 2, 1), (0.0, 0.0, 10.0 * level), lf.LinearElastic(200e3, 0.0))
    made.fix("base:z0", name="foot")
    made.symmetry(["cover:x0", "cover:y0"])
    sides = "base:z1", "cover:z0"
    made.interface("joint", *sides, lf.Contact(stiffness=JOINT / AREA))
    stiffness, short = lf.LogNormal("K", K, cov=K_COV), lf.LogNormal("D", D, cov=D_COV)
    made.interface("bolt", *sides, lf.Elastic(normal=stiffness, jump=-short, total=True))
    made.force("cover:z1", (0.0, 0.0, lf.LogNormal("Q", load, cov=Q_COV)), name="load")
    return lf.assemble(made)


def lognormal(mean: float, cov: float) -> tuple[float, float]:
    """Mean and deviation of the logarithm."""
    deviation = math.sqrt(math.log1p(cov * cov))
    return math.log(mean) - 0.5 * deviation**2, deviation


def opens(load: float) -> float:
    """P(Q > K D)."""
    (k, s), (d, t), (q, r) = lognormal(K, K_COV), lognormal(D, D_COV), lognormal(load, Q_COV)
    return float(stats.norm.sf((k + d - q) / math.sqrt(s * s + t * t + r * r)))


@scene(GROUP, {f"{name}.{what}": Right(opens(load), tolerance, CLOSED) for name,
               load in (("rare", RARE), ("less", LESS_RARE))
               for what, tolerance in (("first_order", 2e-3), ("probability", 0.25))}, limit=120.0)
def a_joint_that_opens_rarely(rtol: float) -> Any:
    """"Reliability ...: samples beyond fitted paraboloids", "rounds with polynomials": probabilities of
    1e-6, 5e-5."""
    event = lf.Response.opening("joint") > 0.0
    return {name: lf.reliability(joints(load), event, seed=1, options=lf.Options(rtol=rtol))
            for name, load in (("rare", RARE), ("less", LESS_RARE))}


@scene(GROUP, {"tail": Right(opens(TAIL), 1.0, CLOSED)}, limit=120.0)
def a_tail_of_contact(rtol: float) -> Any:
    """"Probabilities and quantiles of a chaos with contact solve some of its samples": alone twice too
    large."""
    problem = joints(TAIL)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", lf.TruncationWarning)
        result = lf.solve(problem, chaos=5, options=options(rtol))
    weights = problem.interfaces["joint"].weights
    force = result.quantity(lambda block: block.force("joint")[..., 0] @ weights, "force")
    return {"tail": force.probability(above=-1e-6, level=0.99), "quantile": force.quantile(0.999)}


def bars(layer: Any, force: Any = 1000.0, more: Any = None) -> lf.Problem:
    """Two bars with a layer between them: the end moves by F / A (2 L / E + 1 / k)."""
    made = lf.Scene()
    for n, name in enumerate(("first", "second")):
        box(made, name, (20.0, 10.0, 10.0), (2, 1, 1), (20.0 * n, 0.0, 0.0), lf.LinearElastic(200e3, 0.0),
            cell="hexahedron")
    made.fix("first:x0")
    made.interface("layer", "first:x1", "second:x0", lf.Elastic(normal=layer, tangential=100.0))
    if more is not None:
        made.interface("beside", "first:x1", "second:x0", lf.Elastic(normal=more, tangential=100.0))
    made.force("second:x1", (force, 0.0, 0.0), name="pull")
    return lf.assemble(made)


def end(problem: lf.Problem) -> Any:
    """Displacement of the end."""
    return lf.AtPoint(problem, "second", (40.0, 5.0, 5.0), component="x")


def moved(k: float) -> float:
    """The same in closed form."""
    return 10.0 * (40.0 / 200e3 + 1.0 / k)


@scene(GROUP, {
    "layer.mean": Right(47.1444, 5e-3, "an integral over the prior"),
    "layer.std": Right(0.6412, 5e-2, "an integral over the prior"),
    "fit": Right(1.0 / (float(np.mean((0.2105, 0.2180, 0.2141))) / 10.0 - 2e-4), 1e-6, CLOSED),
    "ridge.sum": Right(47.0, 5e-3, CLOSED),
}, limit=180.0)
def posteriors(rtol: float) -> Any:
    """"calibrate samples several maxima and follows ridges"; "germs of random fields were left out of a
    posterior"."""
    data, noise, tight = [0.2105, 0.2180, 0.2141], 0.005, lf.Options(rtol=rtol)
    layer = bars(lf.LogNormal("k", 50.0, cov=0.3))
    found = lf.calibrate(layer, end(layer), data, noise, options=tight)
    plain = bars(50.0)
    fit = lf.calibrate(plain, end(plain), data, noise, "least squares", inputs=["layer.normal"],
                       options=tight)
    both = bars(lf.LogNormal("a", 25.0, cov=0.3), more=lf.LogNormal("b", 25.0, cov=0.3))
    ridge = lf.calibrate(both, end(both), [moved(47.0)], 2e-4, options=tight)
    made = lf.Scene()
    for level, name in enumerate(("base", "cover")):
        box(made, name, (20.0, 30.0, 10.0), (4, 4, 1), (0.0, 0.0, 10.0 * level), lf.LinearElastic(200e3, 0.3),
            cell="hexahedron")
    made.fix("base:z0")
    gap = lf.RandomField("g", mean=0.0, std=1e-4, length=8.0, modes=3)
    made.interface("joint", "base:z1", "cover:z0", lf.Contact(stiffness=1e4, gap=gap))
    made.interface("spring", "base:z1", "cover:z0", lf.Elastic(normal=1.0, tangential=5.0))
    made.force("cover:z1", (0.0, 0.0, -9000.0), name="press")
    rough = lf.assemble(made)
    corner = lf.AtPoint(rough, "cover", (20.0, 30.0, 20.0), component="z")
    germs = lf.calibrate(rough, corner, rough.function(corner, options=tight)([0.5, 0.0, 0.0]), 2e-6,
                         options=tight)
    summed, spread = float(ridge.weights @ ridge.samples.sum(axis=1)), float(ridge.std("a"))
    return {
        "layer": {"mean": found.mean("k"), "std": within(found.std("k"), 1e-2 * found.std("k"))},
        "evidence": within(found.evidence, 1e-2),
        "fit": within(fit.values["layer.normal"], 1e-6 * fit.values["layer.normal"]),
        "ridge": {"sum": within(summed, 1e-3 * summed), "std": within(spread, 5e-2 * spread)},
        "germs": {name: within(each, 1e-2 * each) for name, each in germs.laplace.items()},
    }


def of_prior(levels: tuple[float, ...], data: tuple[float, ...], noise: float) -> list[float]:
    """Quantiles of the stiffness of a layer after measurements of the end, by an integral over its prior."""
    germ = np.linspace(-8.0, 8.0, 400_001)
    spread = math.sqrt(math.log(1.0 + 0.3**2))
    stiffness = 50.0 * np.exp(spread * germ - spread**2 / 2)
    misfit = sum((each - moved(stiffness)) ** 2 for each in data)
    density = np.exp(-(germ**2) / 2 - misfit / (2 * noise**2))
    share = np.cumsum(density) / density.sum()
    return [float(np.interp(level, share, stiffness)) for level in levels]


LEVELS, MEASURED = (0.05, 0.5, 0.95), (0.2105, 0.2180, 0.2141)


@scene(GROUP, {
    f"layer.{level:g}": Right(value, 3e-3, "an integral over the prior")
    for level, value in zip(LEVELS, of_prior(LEVELS, MEASURED, 0.005), strict=True)
}, limit=120.0)
def quantiles_of_a_posterior(rtol: float) -> Any:
    """"calibrate(...).quantile": of a stiffness that three measurements narrow."""
    layer = bars(lf.LogNormal("k", 50.0, cov=0.3))
    found = lf.calibrate(layer, end(layer), list(MEASURED), 0.005, options=lf.Options(rtol=rtol))
    quantiles = {f"{level:g}": found.quantile("k", level) for level in LEVELS}
    return {"layer": {key: within(each, 2e-3 * each) for key, each in quantiles.items()}}


@scene(GROUP, {"stop": Right(-1e-3, 1e-4, BALANCE)})
def a_light_part_with_random_moduli(rtol: float) -> Any:
    """"a light part that lands": the mean force of its stop, where the iteration alone gives up."""
    first, light = (lf.LogNormal(name, STEEL, cov=0.3) for name in ("Ea", "Ec"))
    problem = pair_and_light(1e-5, 0.01, (first, STEEL, light))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        chaos = lf.solve(problem, chaos=lf.Chaos(1, check_points=0), options=options(rtol))
    weights = problem.interfaces["stop"].weights
    force = chaos.quantity(lambda block: block.force("stop")[..., 0] @ weights, "force")
    return {"chaos": str(chaos.status), "stop": within(force.mean().value, 1e-7)}


def on_each_other(law: Any, stiffness: Any = 1.0) -> lf.Scene:
    """Two blocks with a law and weak springs between."""
    made = lf.Scene()
    for level, name in enumerate(("base", "cover")):
        part = lf.geometry.box((20.0, 30.0, 10.0), (3, 3, 2), (0.0, 0.0, 10.0 * level))
        steel = lf.LinearElastic(200e3, 0.3, alpha=1e-5)
        made.substructure(name, part, steel, degree=1, stiffness=stiffness if level else 1.0)
    made.fix("base:z0")
    made.interface("joint", "base:z1", "cover:z0", law)
    made.interface("spring", "base:z1", "cover:z0", lf.Elastic(normal=1.0, tangential=5.0))
    return made


def of_function(function: Any, at: Any) -> dict[str, Any]:
    """Values, and slopes: those of a dual problem, to 1e-6 of themselves."""
    slopes = np.ravel(function.gradient(at))
    return {
        "values": {str(n): within(value, 1e-7 * abs(value)) for n,
                   value in enumerate(np.ravel(function(at)))},
        "slopes": {str(n): within(value, 1e-5 * abs(value)) for n, value in enumerate(slopes)},
    }


def by_bearing() -> dict[str, Right]:
    """Slopes of the force of the joint, -k (K D - Q) / (K + k), with respect to K, D and Q."""
    k = 0.9 * K
    bears = JOINT * (k * D - RARE) / (k + JOINT)
    slopes = (JOINT * D - bears) / (k + JOINT), JOINT * k / (k + JOINT), -JOINT / (k + JOINT)
    return {f"joint.slopes.{n}": Right(-slope, 1e-6, CLOSED) for n, slope in enumerate(slopes)}


@scene(GROUP, by_bearing(), limit=120.0)
def gradients(rtol: float) -> Any:
    """"Adjoint gradients", "gradients with respect to germs of a stiffness that varies inside a part"; a
    history."""
    tight, out = lf.Options(rtol=rtol, max_iterations=4000), {}
    at = np.array([0.9 * K, D, RARE])
    out["joint"] = of_function(joints(RARE).function("joint", options=tight), at)
    factor = lf.RandomField("a", mean=1.0, cov=0.2, length=20.0, modes=3, distribution="lognormal")
    made = on_each_other(lf.Contact(friction=0.2, stiffness=1e4), stiffness=factor)
    made.force("cover:z1", (300.0, 0.0, -1500.0), name="push")
    made.temperature("cover", 20.0, name="heat")
    problem = lf.assemble(made)
    corner = lf.AtPoint(problem, "cover", (20.0, 30.0, 20.0), component="x")
    inputs = ["joint.friction", "push.x", "heat.dT", "a[0]", "a[1]", "a[2]"]
    field = problem.function({"u": corner}, inputs, options=tight)
    x = np.where(field.nominal == 0.0, 0.3, field.nominal)
    out["moduli"] = of_function(field, x)
    made = on_each_other(lf.Contact(friction=0.15, stiffness=1e4))
    cycle = lf.Amplitude([0.0, 1.0, 2.0], [0.0, 1.0, -0.5])
    made.force("cover:z1", (0.0, 0.0, -1500.0), name="press")
    made.force("cover:z1", (cycle * 270.0, 0.0, 0.0), name="shear")
    problem = lf.assemble(made)
    inputs = ["joint.friction", "press.z", "shear.x", "joint.stiffness"]
    slip = lf.Resultant("joint", "jump", 1)
    history = problem.function({"slip": slip}, inputs, times=[0.5, 1.0, 1.5, 2.0], options=tight)
    out["history"] = of_function(history, history.nominal)
    return out


@scene(GROUP, {"off": Right(0.0, 1e-7, CLOSED)})
def many_points_of_springs(rtol: float) -> Any:
    """"problem.function of springs only: many points are combinations of a few solved ones"."""
    problem = layers(lf.LogNormal("a", 40.0, cov=0.3), lf.LogNormal("b", 60.0, cov=0.3))
    function = problem.function({"end": lf.Resultant("load", "jump")}, options=lf.Options(rtol=rtol))
    x = function.nominal * np.exp(0.3 * np.sin(np.arange(400.0)[:, None] * np.array((1.0, 2.3))))
    exact = -10.0 * (30.0 / 200.0 + (1.0 / x).sum(axis=1))
    return {"off": beyond(float(np.abs(function(x).ravel() / exact - 1.0).max()), 1e-7)}
