"""Engineers' joints of the frozen corpus: sheets and plates on each other, clamped by heads or bolts."""

from __future__ import annotations

from typing import Any

import numpy as np

import dolfinx_frontend as lf

from .registry import Right, scene
from .shapes import ALUMINIUM, BALANCE, STEEL, Array, arrived, patched, ramp, read, solved

HEADS = 48e3
"""N: four heads of 25 x 30 mm, 16 MPa each."""
PRESSED = {
    "upper.normal": Right(-HEADS, BALANCE, "balance of the foot"),
    "lower.normal": Right(-HEADS, BALANCE, "balance of foot and sheet"),
}
STAGNATES = "stagnates: the loose sheet between plates"


def under_heads(pressure: float, mm: float) -> Any:
    """A pressure under four heads, whose edges lie on the nodes of 8 x 4 cells and of their refinements."""

    def field(x: Array) -> Array:
        a, b = np.abs(x[:, 0]) / mm, np.abs(x[:, 1]) / mm
        return np.asarray(pressure * ((a > 50) & (a < 75) & (b > 30)))

    return field


def sandwich(
    cells: tuple[int, int] = (8, 4),
    degree: int = 1,
    E: float = 200.0,
    mu: tuple[float, float] = (0.12, 0.12),
    thickness: float = 2.0,
    tresca: float | None = None,
    clamp: lf.Amplitude | None = None,
    shear: Any = None,
    gap: float = 0.0,
    mm: float = 1.0,
) -> lf.Problem:
    """A loose sheet between a steel base, held at one end, and an aluminium foot; ``mm``: a millimetre in
    units of length, forces in N. ``shear``: N that push the foot along x."""
    assembly = lf.Scene()
    MPa = 1.0 / mm**2
    layers = (
        ("base", -12.0, 12.0, lf.LinearElastic(210e3 * MPa, 0.3), 2),
        ("sheet", 0.0, thickness, lf.LinearElastic(E * MPa, 0.4), 1),
        ("foot", thickness, 10.0, lf.LinearElastic(70e3 * MPa, 0.33), 2),
    )
    for name, z, height, material, n in layers:
        box = lf.geometry.box(
            (200 * mm, 120 * mm, height * mm), (*cells, n), (-100 * mm, -60 * mm, z * mm), "hexahedron"
        )
        assembly.substructure(name, box, material, degree=degree)
    threshold = None if tresca is None else tresca * MPa
    for k, (name, first, second) in enumerate(
        (("lower", "base:z1", "sheet:z0"), ("upper", "sheet:z1", "foot:z0"))
    ):
        friction = None if threshold is not None else mu[k]
        assembly.interface(
            name, first, second, lf.Contact(gap=gap * mm, friction=friction, threshold=threshold)
        )
    assembly.fix("base:x0")
    heads = under_heads(16.0 * MPa, mm)
    for face in ("foot:z1", "base:z0"):
        assembly.pressure(face, heads if clamp is None else clamp * heads, name=f"heads {face}")
    if shear is not None:
        assembly.force("foot:x1", (shear * 1.0, 0.0, 0.0), point=(100 * mm, 0.0, thickness * mm), name="push")
    return lf.assemble(assembly)


@scene("joints", right=PRESSED)
def sandwich_coarse(rtol: float) -> Any:
    return read(solved(sandwich(), rtol), *PRESSED)


@scene("joints", right=PRESSED)
def sandwich_fine(rtol: float) -> Any:
    return read(solved(sandwich((16, 8)), rtol), *PRESSED)


@scene("joints", right=PRESSED)
def sandwich_quadratic(rtol: float) -> Any:
    return read(solved(sandwich(degree=2, mu=(0.3, 0.3)), rtol), *PRESSED)


@scene("joints", right=PRESSED, limit=20.0, known_bad="no answer in 25 s: the loose sheet between plates")
def sandwich_large(rtol: float) -> Any:
    """22 000 unknowns."""
    return read(solved(sandwich((16, 8), degree=2), rtol), *PRESSED)


@scene("joints", right=PRESSED)
def sandwich_soft(rtol: float) -> Any:
    """A film a million times softer than the base, rubbing hard."""
    return read(solved(sandwich(E=0.2, mu=(1.0, 1.0), thickness=0.5), rtol), *PRESSED)


@scene("joints", right=PRESSED)
def sandwich_stiff(rtol: float) -> Any:
    return read(solved(sandwich(E=2e5, mu=(0.5, 0.05)), rtol), *PRESSED)


@scene("joints", right=PRESSED)
def sandwich_tresca(rtol: float) -> Any:
    return read(solved(sandwich(tresca=1.0), rtol), *PRESSED)


@scene("joints", right={"upper.normal@3": PRESSED["upper.normal"], "lower.normal@7": PRESSED["lower.normal"]})
def sandwich_tightened_and_let_go(rtol: float) -> Any:
    """Tightened in four steps, let go to a quarter and tightened again."""
    times = np.arange(1, 9) / 4
    r = solved(sandwich(clamp=lf.Amplitude([0, 1, 1.5, 2], [0, 1, 0.25, 1])), rtol, times)
    return read(r, "upper.normal@3", "lower.normal@7")


CYCLE = {
    f"{name}.force_x@{k}": Right(load, BALANCE, "balance of what lies above")
    for name in ("upper", "lower")
    for k, load in ((0, 0.0), (1, 4e3), (3, -4e3), (4, 0.0))
}


@scene("joints", right=CYCLE)
def sandwich_sheared_to_and_fro(rtol: float) -> Any:
    """70 % of the friction limit, reversal, and back to no load."""
    shear = lf.Amplitude([1, 2, 4, 5], [0, 4e3, -4e3, 0])
    r = solved(sandwich(clamp=ramp(0, 1), shear=shear), rtol, [1.0, 2.0, 3.0, 4.0, 5.0])
    return read(r, *CYCLE)


@scene(
    "joints",
    right={"steps": Right(2, 0.0, "friction limit of the lower joint, 0.12 x 48 kN = 5.76 kN")},
    known_bad="the steps below the limit are refused with the one above it",
)
def sandwich_over_its_limit(rtol: float) -> Any:
    """Pushed to 0.6 and 1.2 of the limit: the last step has no equilibrium."""
    problem = sandwich(clamp=ramp(0, 1), shear=lf.Amplitude([1, 2], [0, 1.2 * 0.12 * HEADS]))
    return arrived(problem, rtol, [1.0, 1.5, 2.0])


@scene("joints", right=PRESSED)
def sandwich_in_metres(rtol: float) -> Any:
    """N and m."""
    return read(solved(sandwich(mm=1e-3), rtol), *PRESSED)


@scene("joints", right=PRESSED)
def sandwich_too_thick(rtol: float) -> Any:
    """The sheet is 0.02 mm thicker than it is meshed; only its place changes, not the forces."""
    return read(solved(sandwich(E=2e3, mu=(0.3, 0.3), gap=-0.01), rtol), *PRESSED)


def heap(
    count: int,
    cells: int,
    mu: float,
    pressure: float,
    push: dict[str, Any],
    size: tuple[float, ...] = (40.0, 40.0, 1.0),
    degree: int = 1,
    materials: tuple[Any, ...] = (STEEL,),
    times: Any = None,
) -> lf.Problem:
    """``count`` loose sheets on a held plate, pressed from above; ``push``: force along x by sheet."""
    assembly = lf.Scene()
    length, width, height = size
    assembly.substructure(
        "plate", lf.geometry.box((length, width, 4.0), (cells, cells, 1), (0, 0, -4.0)), STEEL, degree=degree
    )
    assembly.fix("plate:z0", name="ground")
    below = "plate"
    for k in range(count):
        n = cells + k % 2
        box = lf.geometry.box(size, (n, n, 1), (0, 0, k * height))
        assembly.substructure(f"s{k}", box, materials[k % len(materials)], degree=degree)
        assembly.interface(f"j{k}", f"{below}:z1", f"s{k}:z0", lf.Contact(gap=0.0, friction=mu))
        below = f"s{k}"
    clamp = ramp(0, 1) if push else 1.0
    assembly.pressure(f"{below}:z1", clamp * pressure, name="press")
    for name, load in push.items():
        assembly.force(
            f"{name}:x1",
            (load * 1.0, 0.0, 0.0),
            point=(length, width / 2, int(name[1:]) * height),
            name=f"push {name}",
        )
    return lf.assemble(assembly)


LATER = lf.Amplitude([1, 2, 3, 4], [0, 1, -1, 0])


@scene("joints", right={f"j{k}.normal": Right(-16e3, BALANCE, "pressure x area") for k in (0, 4, 8)})
def nine_sheets(rtol: float) -> Any:
    r = solved(heap(9, 5, 0.1, 10.0, {}), rtol)
    return read(r, "j0.normal", "j4.normal", "j8.normal")


FIVE = {
    f"j{k}.force_x@{step}": Right(load, BALANCE, "balance of what lies above")
    for k, share in ((0, 1.0), (2, 1.0), (3, 0.0))
    for step, load in ((1, share * 1e3), (3, 0.0))
}


@scene("joints", right=FIVE)
def five_sheets_pushed(rtol: float) -> Any:
    """The third sheet is pushed to and fro at 30 % of what friction holds, and let go."""
    return read(solved(heap(5, 4, 0.2, 10.0, {"s2": LATER * 1e3}), rtol, [1.0, 2.0, 3.0, 4.0]), *FIVE)


@scene(
    "joints",
    right={"steps": Right(2, 0.0, "mu p A = 3.2 kN")},
    limit=20.0,
    known_bad="no answer in 25 s where one step has no equilibrium",
)
def five_sheets_over_the_limit(rtol: float) -> Any:
    push = lf.Amplitude([1, 2], [0, 3.6e3])
    return arrived(heap(5, 4, 0.2, 10.0, {"s2": push}), rtol, [1.0, 1.5, 2.0])


@scene("joints", right={f"j{k}.normal": Right(-16e3, BALANCE, "pressure x area") for k in (0, 1, 2)})
def sheets_of_six_orders(rtol: float) -> Any:
    """Steel, rubber and a film a million times softer than steel, mu = 1.5."""
    film, rubber = lf.LinearElastic(0.21, 0.3), lf.LinearElastic(5.0, 0.45)
    r = solved(heap(3, 6, 1.5, 10.0, {}, materials=(rubber, STEEL, film)), rtol)
    return read(r, "j0.normal", "j1.normal", "j2.normal")


def flat_heap(count: int, n: int, mu: float, degree: int, push: float, thickness: float = 0.5) -> lf.Problem:
    """The same in the plane: thin sheets on a held block, the upper one pushed."""
    assembly = lf.Scene()
    assembly.substructure("block", lf.geometry.box((60, 10), (n, 3), (0, -10)), STEEL, degree=degree)
    assembly.fix("block:y0")
    below = "block"
    for k in range(count):
        box = lf.geometry.box((60, thickness), (n + 3 * (k % 2), 1), (0, k * thickness))
        assembly.substructure(f"s{k}", box, ALUMINIUM if k % 2 else STEEL, degree=degree)
        assembly.interface(f"j{k}", f"{below}:y1", f"s{k}:y0", lf.Contact(gap=0.0, friction=mu))
        below = f"s{k}"
    assembly.pressure(f"{below}:y1", ramp(0, 1) * 20.0, name="press")
    assembly.traction(
        f"{below}:x1", lf.Amplitude([1, 2, 3], [0, 1, 0]) * (push / thickness, 0.0), name="push"
    )
    return lf.assemble(assembly)


THIN = {
    "j0.force_x@2": Right(200.0, BALANCE, "balance"),
    "j5.normal@2": Right(-1200.0, BALANCE, "pressure x length"),
    "j3.force_x@4": Right(0.0, 1e-3, "balance, of a load of 0"),
}


@scene("joints", right=THIN)
def six_thin_sheets(rtol: float) -> Any:
    """0.5 mm on 60 mm, pushed at 28 % of the limit and let go."""
    return read(solved(flat_heap(6, 30, 0.6, 1, 200.0), rtol, [1.0, 1.5, 2.0, 2.5, 3.0]), *THIN)


@scene("joints", right={"j1.force_x@2": Right(60.0, BALANCE, "balance")})
def two_thin_sheets_quadratic(rtol: float) -> Any:
    return read(solved(flat_heap(2, 40, 0.1, 2, 60.0), rtol, [1.0, 1.5, 2.0, 3.0]), "j1.force_x@2")


M12 = lf.BoltStiffness.vdi2230(d=12, pitch=1.75, shank=10, thread=5, E=205e3)


def bolted(
    plates: int,
    cells: int,
    load: Any,
    newton: float,
    *,
    force: Any = 10e3,
    mu: Any = 0.2,
    degree: int = 1,
    held: str = "p1:x0",
    pulled: tuple[str, ...] = ("p0", "p2"),
    component: int = 0,
    material: Any = STEEL,
    bolts: int = 1,
) -> lf.Problem:
    """Plates of 40 x 40 x 5 mm under bolts that are tightened until t = 1, some of them pulled then."""
    assembly = lf.Scene()
    for k in range(plates):
        n = cells + k % 3
        box = lf.geometry.box((40, 40, 5), (n, n, 2), (0, 0, 5.0 * k))
        if bolts > 1 and k in (0, plates - 1):
            n = cells
            box = lf.geometry.box((40, 40, 5), (n, n, 2), (0, 0, 5.0 * k))
            face = "z1" if k else "z0"
            spots = {
                f"head{i}": (
                    face,
                    (20.0 * (i % 2), 20.0 * (i // 2), 5.0 * (k + bool(k))),
                    (20.0 * (i % 2) + 20.0, 20.0 * (i // 2) + 20.0, 5.0 * (k + bool(k))),
                )
                for i in range(bolts)
            }
            box = patched(box, spots)
        assembly.substructure(f"p{k}", box, material, degree=degree)
    for k in range(plates - 1):
        assembly.interface(f"j{k}", f"p{k}:z1", f"p{k + 1}:z0", lf.Contact(friction=mu))
    last = f"p{plates - 1}"
    for i in range(bolts):
        faces = (f"p0:head{i}", f"{last}:head{i}") if bolts > 1 else ("p0:z0", f"{last}:z1")
        tightened = lf.Preload(force, until=1.0)
        assembly.beam(f"bolt{i}", *faces, M12, tightened)
    assembly.fix(held, name="ground")
    for name in pulled:
        value = [0.0, 0.0, 0.0]
        value[component] = newton / (40.0 * 5.0)
        assembly.traction(f"{name}:x1", load * tuple(value), name=f"pull {name}")
    return lf.assemble(assembly)


TIGHT = {
    "bolt0.axial.normal@0": Right(10e3, BALANCE, "the preload that was asked for"),
    "j0.normal@0": Right(-10e3, BALANCE, "balance of preload"),
    "j1.normal@0": Right(-10e3, BALANCE, "balance of preload"),
}
PULL = lf.Amplitude([1, 2], [0, 1])


@scene("joints", right=TIGHT)
def three_plates_at_60_percent(rtol: float) -> Any:
    """The middle plate is held, the outer ones are pulled by 60 % of mu F each."""
    return read(solved(bolted(3, 8, PULL, 1200.0), rtol, [1.0, 1.5, 2.0]), *TIGHT)


@scene("joints", right=TIGHT)
def three_plates_at_95_percent(rtol: float) -> Any:
    return read(solved(bolted(3, 8, PULL, 1900.0), rtol, [1.0, 1.5, 2.0]), *TIGHT)


@scene(
    "joints",
    right={"steps": Right(2, 0.0, "mu F = 2 kN a joint")},
    known_bad="the steps below the limit stagnate with the one above it",
)
def three_plates_over_the_limit(rtol: float) -> Any:
    """120 % of mu F at the end."""
    return arrived(bolted(3, 8, PULL, 2400.0), rtol, [1.0, 1.5, 2.0])


@scene("joints", right=TIGHT)
def three_plates_large(rtol: float) -> Any:
    """Quadratic cells, 60 %."""
    return read(solved(bolted(3, 10, PULL, 1200.0, degree=2), rtol, [1.0, 2.0]), *TIGHT)


FOUR = {f"bolt{i}.axial.normal@0": Right(2.5e3, BALANCE, "the preload that was asked for") for i in range(4)}
FOUR |= {"j0.normal@0": Right(-10e3, BALANCE, "balance"), "j1.normal@0": Right(-10e3, BALANCE, "balance")}


@scene("joints", right=FOUR)
def three_plates_four_bolts(rtol: float) -> Any:
    """Four bolts, pulled to and fro and let go."""
    load = lf.Amplitude([1, 2, 3, 4], [0, 1, -1, 0])
    return read(solved(bolted(3, 8, load, 1000.0, force=2.5e3, bolts=4), rtol, [1.0, 2.0, 3.0, 4.0]), *FOUR)


def apart(
    load: Any, *, mm: float = 1.0, preload: Any = 20e3, mu: Any = 0.2, degree: int = 1, nu: float = 0.0
) -> lf.Problem:
    """Two plates of 30 x 30 x 20 mm under an M12, pulled off each other; forces in N."""
    assembly = lf.Scene()
    m12 = lf.BoltStiffness.vdi2230(
        d=12 * mm, pitch=1.75 * mm, shank=25 * mm, thread=15 * mm, E=205e3 / mm**2
    )
    for name, z in (("lower", 0.0), ("upper", 20.0)):
        box = lf.geometry.box((30 * mm, 30 * mm, 20 * mm), (4, 4, 2), (0, 0, z * mm))
        assembly.substructure(name, box, lf.LinearElastic(200e3 / mm**2, nu), degree=degree)
    assembly.interface("joint", "lower:z1", "upper:z0", lf.Contact(friction=mu))
    assembly.beam("bolt", "lower:z0", "upper:z1", m12, lf.Preload(preload, until=1.0))
    assembly.fix("lower:z0")
    assembly.traction("upper:z1", load * (0.0, 0.0, 1.0 / (30 * mm) ** 2), name="pull")
    return lf.assemble(assembly)


K_BOLT = lf.BoltStiffness.vdi2230(d=12, pitch=1.75, shank=25, thread=15, E=205e3).axial
SHARE = K_BOLT / (K_BOLT + 200e3 * 900 / 40)
VDI = "load factor k / (k + E A / L) of VDI 2230, exact with nu = 0 and a load spread over the face"
JOINT = {
    "bolt.axial.normal@0": Right(20e3, BALANCE, "preload"),
    "bolt.axial.normal@1": Right(20e3 + SHARE * 15e3, BALANCE, VDI),
    "joint.normal@1": Right(-20e3 + (1 - SHARE) * 15e3, BALANCE, VDI),
    "bolt.axial.normal@2": Right(30e3, BALANCE, "the joint is open"),
    "joint.normal@2": Right(0.0, 1e-3, "open"),
    "bolt.axial.normal@3": Right(20e3, BALANCE, "let go: elastic"),
}
OPENS = lf.Amplitude([1, 2, 3, 4], [0, 15e3, 30e3, 0])


@scene("joints", right=JOINT)
def plates_pulled_apart(rtol: float) -> Any:
    return read(solved(apart(OPENS), rtol, [1.0, 2.0, 3.0, 4.0]), *JOINT)


@scene("joints", right=JOINT)
def plates_pulled_apart_in_metres(rtol: float) -> Any:
    return read(solved(apart(OPENS, mm=1e-3, degree=2), rtol, [1.0, 2.0, 3.0, 4.0]), *JOINT)


@scene("joints", right={"opened": Right(3 / 8, 0.0, "preloads below (1 - share) 18 kN = 16.71 kN")})
def plates_pulled_apart_samples(rtol: float) -> Any:
    """Eight samples of preload, of which three open."""
    preload = lf.FromSamples("F_V", PRELOADS)
    problem = apart(lf.Amplitude([1, 2], [0, 18e3]), preload=preload)
    answer = lf.sweep(
        problem.with_laws(values={}),
        {"bolt.axial.force": PRELOADS},
        times=[1.0, 2.0],
        options=lf.Options(rtol=rtol),
        progress=False,
    )
    area = problem.interfaces["joint"].weights
    normal = answer.force("joint")[:, -1, :, 0] @ area
    return {"answer": answer, "opened": float(np.mean(normal > -1e-3))}


PRELOADS = [12e3, 14e3, 16e3, 17e3, 18e3, 20e3, 22e3, 24e3]


SLAB = 2.4e-5 * 60 * 40 * 10
"""N: weight of a slab of concrete."""
SLOPE = np.array((np.sin(0.2), 0.0, -np.cos(0.2)))
WEIGHT = {
    # on the first side, which is the upper one of j0 alone
    f"j{k}.{column}": Right((3 - k if k else -3) * SLAB * float(SLOPE[axis]), BALANCE, "weight of the slabs")
    for k in range(3)
    for column, axis in (("force_x", 0), ("force_z", 2))
}


@scene("joints", right=WEIGHT)
def slabs_on_a_slope(rtol: float) -> Any:
    """Three slabs on a slope of 0.2, mu = 0.5: nothing but their weight loads them."""
    made = lf.Scene()
    for k in range(3):
        slab = lf.geometry.box((60, 40, 10), (6, 4, 2), (0, 0, 10 * k), cell="hexahedron")
        weight = tuple(2.4e-5 * SLOPE)
        made.substructure(f"slab{k}", slab, lf.LinearElastic(30.0, 0.2), degree=1, body_force=weight)
    made.interface("j0", "slab0:z0", lf.Contact(friction=0.5))
    for k in (1, 2):
        made.interface(f"j{k}", f"slab{k - 1}:z1", f"slab{k}:z0", lf.Contact(friction=0.5))
    return read(solved(lf.assemble(made), rtol), *WEIGHT)
