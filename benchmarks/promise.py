"""Is the accuracy that was asked for kept? Random scenes whose answer is known in closed form, on one mesh.

``./run bench promise [--scenes N] [--seed S] [--json FILE] [--no-cost] [--only FAMILY ...]``

Every scene is a chain of bars without lateral contraction (nu = 0), which elements of degree 1 solve exactly,
so that its mesh has no error: layers in series under a force or an imposed displacement, springs side by
side, contact with a random gap behind random layers (the kink up to 4 standard deviations from the mean), a
preloaded bolt in a joint that opens, and random fields. One to eight germs (fields: more), all laws,
stiffnesses of parts over six decades, units of length and force over six decades. Exact moments are sums over
one-dimensional quadratures that are made here, of scipy's distributions, in normal scores and split at kinks;
those of 1 / (X1 + ... + Xn) are integrals of products of Laplace transforms. Nothing of the chaos or the
rules of the package is used.

A run is one scene at one accuracy (1e-1 .. 1e-4). It is *broken* if the answer says that the accuracy is
reached and the true error (the larger of mean and deviation, each relative to itself) is larger. An answer
that says that it has not reached the accuracy is counted on its own. *Cost* is the time over that of the
cheapest setting of the same problem (orders of chaos, tensor and sparse rules, Sobol points, at several
tolerances) whose true error is small enough.
"""

from __future__ import annotations

import gc
import signal
import statistics
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from time import perf_counter
from typing import Any

import common
import numpy as np
import numpy.typing as npt
from scipy import stats

from dolfinx_frontend import (
    Beta,
    Chaos,
    Contact,
    Elastic,
    FromDistribution,
    FromSamples,
    Gamma,
    LinearElastic,
    LogNormal,
    Normal,
    Options,
    Problem,
    RandomField,
    Resultant,
    Scene,
    TruncatedNormal,
    Uniform,
    assemble,
    geometry,
    quasi_monte_carlo,
    solve,
    sparse_quadrature,
    tensor_quadrature,
)
from dolfinx_frontend.uncertainty.statistics import MeanStd

Array = npt.NDArray[np.float64]
ACCURACIES = (1e-1, 1e-2, 1e-3, 1e-4)
REACH = 9.0
"""Normal scores up to which expectations are integrated."""
NEGLIGIBLE = 1e-9
"""A deviation below this, relative to the mean, is rounding and is compared with the mean."""


# --- random numbers and their exact expectations ----------------------------------------------------
@dataclass(frozen=True)
class Number:
    """A random number of a scene, and the distribution from which its expectations are made."""

    parameter: Any
    law: Any  # of scipy, or the values of a sample

    @property
    def mean(self) -> float:
        """Of the distribution itself."""
        return float(np.mean(self.law) if isinstance(self.law, np.ndarray) else self.law.mean())

    @property
    def std(self) -> float:
        """Of the distribution itself."""
        return float(np.std(self.law) if isinstance(self.law, np.ndarray) else self.law.std())

    def nodes(self, kinks: tuple[float, ...] = (), panels: int = 45) -> tuple[Array, Array]:
        """Values (n,) and weights (n,) of sum 1; panels of the normal score end at the values `kinks`."""
        if isinstance(self.law, np.ndarray):
            return self.law, np.full(len(self.law), 1.0 / len(self.law))
        law = self.law
        ends = np.linspace(-REACH, REACH, panels + 1)
        at = [stats.norm.ppf(law.cdf(k)) if law.cdf(k) < 0.5 else stats.norm.isf(law.sf(k)) for k in kinks]
        ends = np.union1d(ends, [z for z in at if -REACH < z < REACH])
        points, weights = np.polynomial.legendre.leggauss(10)
        half = 0.5 * np.diff(ends)[:, None]
        z = (ends[:-1, None] + half * (1.0 + points)).ravel()
        share = (half * weights).ravel() * stats.norm.pdf(z)
        values = np.where(z < 0.0, law.ppf(stats.norm.cdf(z)), law.isf(stats.norm.sf(z)))
        return values, share / share.sum()

    def expect(self, function: Callable[[Array], Array], kinks: tuple[float, ...] = ()) -> float:
        """E[function(X)]."""
        values, weights = self.nodes(kinks)
        return float(weights @ function(values))


def positive(rng: np.random.Generator, name: str, mean: float, widest: float = 1.0) -> Number:
    """A number > 0 of any law; `widest` scales how much it scatters."""
    kind = rng.choice(["lognormal", "gamma", "uniform", "cut", "beta", "weibull", "samples"])
    cov = float(rng.uniform(0.05, 0.4)) * widest
    if kind == "lognormal":
        cov = float(rng.choice([cov, 2.0 * cov]))
        s = np.sqrt(np.log1p(cov**2))
        return Number(LogNormal(name, mean, cov=cov), stats.lognorm(s, scale=mean * np.exp(-0.5 * s * s)))
    if kind == "gamma":
        return Number(Gamma(name, mean, cov=cov), stats.gamma(cov**-2, scale=mean * cov**2))
    if kind == "uniform":
        lower, upper = mean * (1.0 - np.sqrt(3.0) * cov), mean * (1.0 + np.sqrt(3.0) * cov)
        return Number(Uniform(name, lower, upper), stats.uniform(lower, upper - lower))
    if kind == "cut":
        cov = min(cov, 0.3)
        law = stats.truncnorm(-3.0, 3.0, mean, mean * cov)
        return Number(TruncatedNormal(name, mean, cov=cov, within=3.0), law)
    if kind == "beta":
        a, b = (float(x) for x in rng.uniform(1.0, 5.0, 2))
        lower, upper = mean * (1.0 - 1.5 * cov), mean * (1.0 + 1.5 * cov)
        return Number(Beta(name, a, b, lower, upper), stats.beta(a, b, lower, upper - lower))
    if kind == "weibull":
        law = stats.weibull_min(float(rng.uniform(3.0, 8.0)), scale=mean)
        return Number(FromDistribution(name, law), law)
    values = mean * np.exp(cov * rng.standard_normal(int(rng.integers(6, 40))))
    return Number(FromSamples(name, values), values)


def anything(rng: np.random.Generator, name: str, mean: float, spread: float) -> Number:
    """A number of any sign, of that mean and deviation."""
    kind = rng.choice(["normal", "uniform", "lognormal"] if mean > 0.0 else ["normal", "uniform"])
    if kind == "normal":
        return Number(Normal(name, mean, std=spread), stats.norm(mean, spread))
    if kind == "uniform":
        lower, upper = mean - np.sqrt(3.0) * spread, mean + np.sqrt(3.0) * spread
        return Number(Uniform(name, lower, upper), stats.uniform(lower, upper - lower))
    s = np.sqrt(np.log1p((spread / mean) ** 2))
    return Number(LogNormal(name, mean, std=spread), stats.lognorm(s, scale=mean * np.exp(-0.5 * s * s)))


def sum_of(numbers: list[Number], function: Callable[[Array], Array], shift: float) -> tuple[float, float]:
    """E[S] and E[S^2] of S = shift + sum function(X)."""
    first = [x.expect(function) for x in numbers]
    squares = [x.expect(lambda v, m=m: (function(v) - m) ** 2) for x, m in zip(numbers, first, strict=True)]
    mean = shift + sum(first)
    return mean, mean**2 + sum(squares)


def inverse_of(
    numbers: list[Number], function: Callable[[Array], Array], shift: float
) -> tuple[float, float]:
    """E[1/S] and E[1/S^2] of S = shift + sum function(X) > 0: 1/S = int exp(-t S) dt over t > 0."""
    size, _ = sum_of(numbers, function, shift)
    y = np.arange(-44.0, 12.0, 0.02)
    t = np.exp(y)
    product = np.exp(-t * shift / size)
    for x in numbers:
        values, weights = x.nodes()
        product = product * np.array([weights @ np.exp(-s * function(values) / size) for s in t])
    first, second = (0.02 * float(np.sum(t**n * product)) for n in (1, 2))
    return first / size, second / size**2


def moments(first: float, second: float) -> MeanStd:
    """Mean and deviation of the first two moments."""
    return MeanStd(first, float(np.sqrt(max(second - first**2, 0.0))))


# --- scenes -----------------------------------------------------------------------------------------
@dataclass
class Case:
    """A scene, what is asked of it, and what that is."""

    family: str
    told: str
    problem: Problem
    quantity: Resultant
    exact: MeanStd


@dataclass(frozen=True)
class Units:
    """How long and how strong things are in the units of a scene."""

    length: float
    force: float

    @property
    def pressure(self) -> float:
        """Force per area of the plane: of thickness 1 in any unit."""
        return self.force / self.length

    @property
    def bed(self) -> float:
        """Stiffness of a bed: pressure per length."""
        return self.pressure / self.length


def units(rng: np.random.Generator) -> Units:
    """Millimetres or metres or anything, newtons or kilonewtons or anything."""
    return Units(float(rng.choice([1e-3, 1.0, 1e3])), float(rng.choice([1e-3, 1.0, 1e3])))


LONG, HIGH = 10.0, 4.0


def bars(scene: Scene, count: int, young: float, u: Units) -> None:
    """A row of bars of length LONG and height HIGH, from 0 to the right."""
    for k in range(count):
        box = geometry.box((LONG * u.length, HIGH * u.length), (2, 2), origin=(LONG * k * u.length, 0.0))
        scene.substructure(f"b{k}", box, LinearElastic(E=young * u.pressure, nu=0.0), degree=1)


def chain(rng: np.random.Generator, numbers: list[Number], young: float, u: Units) -> Scene:
    """Bars with layers between them, held at the left; one bar more than layers."""
    scene = Scene()
    bars(scene, len(numbers) + 1, young, u)
    for k, x in enumerate(numbers):
        law = Elastic(normal=x.parameter, tangential=30.0 * u.bed)
        scene.interface(f"l{k}", f"b{k}:x1", f"b{k + 1}:x0", law)
    scene.fix("b0:x0")
    return scene


def stiffness_of_parts(rng: np.random.Generator) -> float:
    """Young's modulus over six decades; layers have some 40 per area, bars young / LONG."""
    return float(10.0 ** rng.uniform(1.5, 7.5))


def layers(rng: np.random.Generator, u: Units, most: int, widest: float = 1.0) -> list[Number]:
    """Stiffnesses of one to `most` layers."""
    count = int(rng.integers(1, most + 1))
    means = [40.0 * 10.0 ** rng.uniform(-0.7, 0.7) * u.bed for _ in range(count)]
    return [positive(rng, f"k{k}", mean, widest) for k, mean in enumerate(means)]


def names(numbers: list[Number]) -> str:
    """Their laws, for a report."""
    return ", ".join(repr(x.parameter) for x in numbers)


def series(rng: np.random.Generator) -> Case:
    """Layers in series under a force: u = p (sum 1/k + L/E)."""
    u, young = units(rng), stiffness_of_parts(rng)
    found = layers(rng, u, 8)
    scene = chain(rng, found, young, u)
    load = 10.0 * u.pressure
    told = f"{names(found)}, E {young:.1e}, {u}"
    if rng.random() < 0.3:
        random = anything(rng, "p", load, 0.2 * load)
        scene.traction(f"b{len(found)}:x1", (random.parameter, 0.0), name="load")
        first, second = sum_of(found[:1], np.reciprocal, 0.0)
        exact = moments(random.mean * first, float(np.hypot(random.mean, random.std)) ** 2 * second)
        told = f"{random.parameter!r}, {told}"
        return Case("series", told, assemble(scene), Resultant("l0", "jump"), exact)
    scene.traction(f"b{len(found)}:x1", (load, 0.0), name="load")
    first, second = sum_of(found, np.reciprocal, (len(found) + 1) * LONG * u.length / (young * u.pressure))
    exact = moments(-load * first, load**2 * second)
    return Case("series", told, assemble(scene), Resultant("load", "jump"), exact)


def gripped(rng: np.random.Generator) -> Case:
    """Layers in series under an imposed displacement: force d A / (sum 1/k + L/E), or the jump of one."""
    u, young = units(rng), stiffness_of_parts(rng)
    found = layers(rng, u, 8)
    scene = chain(rng, found, young, u)
    last, pulled = f"b{len(found)}:x1", 0.05 * u.length
    scene.fix(last, pulled, components=0, name="grip")
    scene.fix(last, components=1)
    soft = (len(found) + 1) * LONG * u.length / (young * u.pressure)
    told = f"{names(found)}, E {young:.1e}, {u}"
    if len(found) == 1 and rng.random() < 0.7:

        def jump(k: Array) -> Array:
            return pulled / (1.0 + soft * k)

        first = found[0].expect(jump)
        exact = MeanStd(first, float(np.sqrt(found[0].expect(lambda k: (jump(k) - first) ** 2))))
        return Case("gripped", f"jump of {told}", assemble(scene), Resultant("l0", "jump"), exact)
    first, second = inverse_of(found, np.reciprocal, soft)
    acts = pulled * HIGH * u.length
    exact = moments(acts * first, acts**2 * second)
    return Case("gripped", told, assemble(scene), Resultant("l0"), exact)


def parallel(rng: np.random.Generator) -> Case:
    """Springs side by side: jump p / sum k."""
    u, young = units(rng), stiffness_of_parts(rng)
    found = layers(rng, u, 5)
    scene = Scene()
    bars(scene, 2, young, u)
    for k, x in enumerate(found):
        scene.interface(f"l{k}", "b0:x1", "b1:x0", Elastic(normal=x.parameter, tangential=30.0 * u.bed))
    scene.fix("b0:x0")
    scene.traction("b1:x1", (10.0 * u.pressure, 0.0), name="load")
    first, second = inverse_of(found, np.positive, 0.0)
    exact = moments(10.0 * u.pressure * first, (10.0 * u.pressure) ** 2 * second)
    told = f"{names(found)}, E {young:.1e}, {u}"
    return Case("parallel", told, assemble(scene), Resultant("l0", "jump"), exact)


def stop(rng: np.random.Generator) -> Case:
    """A row of bars that a displacement moves towards a rigid stop behind a random gap."""
    u = units(rng)
    young = float(10.0 ** rng.uniform(3.0, 6.0))
    found = layers(rng, u, 7, 0.7) if rng.random() < 0.6 else []
    scene = chain(rng, found, young, u)
    move, away = 0.01 * u.length, float(rng.uniform(-4.0, 4.0))
    spread = 0.01 * u.length * float(rng.uniform(0.02, 0.3))
    gap = anything(rng, "gap", move + away * spread, spread)
    if gap.expect(lambda g: np.clip(move - g, 0.0, None), (move,)) < 1e-7 * spread:  # never meets
        gap = anything(rng, "gap", move - away * spread, spread)
    end = f"b{len(found)}:x1"
    # pulled by its left end: the chain is held there
    scene = Scene()
    bars(scene, len(found) + 1, young, u)
    for k, x in enumerate(found):
        scene.interface(f"l{k}", f"b{k}:x1", f"b{k + 1}:x0", Elastic(x.parameter, 30.0 * u.bed))
    scene.fix("b0:x0", (move, 0.0), name="grip")
    scene.interface("stop", end, Contact(gap=gap.parameter))
    scene.fix(end, components=1)
    soft = (len(found) + 1) * LONG * u.length / (young * u.pressure)
    first, second = inverse_of(found, np.reciprocal, soft) if found else (1.0 / soft, soft**-2)
    reach = [gap.expect(lambda g, n=n: np.clip(move - g, 0.0, None) ** n, (move,)) for n in (1, 2)]
    area = HIGH * u.length
    exact = moments(-area * first * reach[0], area**2 * second * reach[1])
    told = f"{gap.parameter!r} with {away:.2f}, {names(found)}, E {young:.1e}, {u}"
    return Case("stop", told, assemble(scene), Resultant("stop"), exact)


def bolt(rng: np.random.Generator) -> Case:
    """A preloaded bolt and an elastic contact, pulled: K j + k min(j - D, 0) = Q."""
    u = units(rng)
    young = float(10.0 ** rng.uniform(2.3, 9.3)) * 5.0
    stiff = 2e5 * u.force / u.length
    held = LogNormal("K", 5e4 * u.force / u.length, cov=0.1), LogNormal("D", 0.2 * u.length, cov=0.1)
    s = np.sqrt(np.log1p(0.01))
    laws = [Number(p, stats.lognorm(s, scale=p.mean * np.exp(-0.5 * s * s))) for p in held]
    # the kink at this many deviations
    away, count = float(rng.uniform(-3.0, 4.0)), int(rng.integers(1, 4))
    pull = 1e4 * u.force * float(np.exp(-0.2 * away))
    load = anything(rng, "Q", pull, 0.15 * pull)
    fixed = [x.parameter if k < count - 1 else x.mean for k, x in enumerate(laws)]
    scene = Scene()
    for k in range(2):
        box = geometry.box((10.0 * u.length, 10.0 * u.length), (2, 2), origin=(10.0 * k * u.length, 0.0))
        scene.substructure(f"b{k}", box, LinearElastic(E=young * u.pressure, nu=0.0), degree=1)
    area = 10.0 * u.length
    scene.interface("joint", "b0:x1", "b1:x0", Contact(gap=0.0, stiffness=stiff / area, jump=fixed[1]))
    side = 1e6 * u.bed
    scene.interface("bolt", "b0:x1", "b1:x0", Elastic(normal=fixed[0], tangential=side * area, total=True))
    scene.fix("b0:x0")
    scene.traction("b1:x1", (load.parameter / area, 0.0), name="load")
    which = str(rng.choice(["joint", "bolt", "jump"]))
    of_k, of_d = (
        x.nodes(panels=9) if k < count - 1 else (np.array([x.parameter.mean]), np.ones(1))
        for k, x in enumerate(laws)
    )
    sums = np.zeros(2)
    for k, share in zip(*of_k, strict=True):
        for d, other in zip(*of_d, strict=True):
            q, weights = load.nodes((k * d,), panels=12)
            j = (q + stiff * d) / (k + stiff)
            j = np.where(j < d, j, q / k)
            value = {"joint": stiff * np.minimum(j - d, 0.0), "bolt": k * j, "jump": j}[which]
            sums += share * other * np.array([weights @ value, weights @ value**2])
    asked = Resultant("joint", "jump") if which == "jump" else Resultant(which)
    told = f"{which}, {count} germs, kink near {away:.2f}, {load.parameter!r}, E {young:.1e}, {u}"
    return Case("bolt", told, assemble(scene), asked, moments(*sums))


def field(rng: np.random.Generator) -> Case:
    """A layer whose stiffness is a field, between all but rigid bars: force d int k."""
    length = LONG * float(10.0 ** rng.uniform(-0.7, 0.7))
    cov, mean = float(rng.uniform(0.1, 0.5)), 50.0
    kind = str(rng.choice(["exponential", "gaussian"]))
    lognormal = bool(rng.random() < 0.7)
    if not lognormal:
        cov = min(cov, 0.15)
    how: dict[str, Any] = {}
    if rng.random() < 0.6:
        how = {"modes": int(rng.integers(1, 7))}
    law = "lognormal" if lognormal else "normal"
    request = RandomField("k", mean=mean, cov=cov, length=length, covariance=kind, distribution=law, **how)
    scene = Scene()
    for name, y0 in (("lo", -2.0), ("up", 0.0)):
        box = geometry.box((LONG, 2.0), (60, 1), origin=(0.0, y0))
        scene.substructure(name, box, LinearElastic(E=1e9, nu=0.0), degree=1)
    scene.interface("line", "lo:y1", "up:y0", Elastic(normal=request, tangential=50.0))
    scene.fix("lo:y0")
    scene.fix("up:y1", (0.0, 1e-3), name="grip")
    problem = assemble(scene)

    def covariance(t: Array) -> Array:
        rho = np.exp(-t / length) if kind == "exponential" else np.exp(-0.5 * (t / length) ** 2)
        return np.expm1(np.log1p(cov**2) * rho) if lognormal else cov**2 * rho

    if kind == "exponential":
        t, w = np.polynomial.legendre.leggauss(200)
        t, w = 0.5 * LONG * (1.0 + t), 0.5 * LONG * w
        variance = 2.0 * float(w @ ((LONG - t) * covariance(t)))
    else:  # smooth: the rule of the interface, which belongs to the mesh
        line = problem.interfaces["line"]
        places = line.points[:, 0]
        variance = float(line.weights @ covariance(abs(places[:, None] - places)) @ line.weights)
    std = mean * np.sqrt(variance)
    told = f"{law}, {kind}, length {length:.3g}, cov {cov:.3g}, {how}"
    return Case("field", told, problem, Resultant("line"), MeanStd(1e-3 * mean * LONG, 1e-3 * std))


FAMILIES: dict[str, Callable[[np.random.Generator], Case]] = {
    "series": series,
    "gripped": gripped,
    "parallel": parallel,
    "stop": stop,
    "bolt": bolt,
    "field": field,
}


# --- runs -------------------------------------------------------------------------------------------
def off(found: MeanStd, exact: MeanStd) -> float:
    """True relative error: the larger of mean and deviation."""
    size = abs(exact.mean)
    whole = exact.std if exact.std is not None and exact.std > NEGLIGIBLE * size else size
    assert found.std is not None and exact.std is not None
    if size == 0.0:
        return max(abs(found.mean), found.std)
    return max(abs(found.mean - exact.mean) / size, abs(found.std - exact.std) / whole)


class TooLong(Exception):
    """A run took longer than it may."""


def limited(seconds: float, call: Callable[[], Any]) -> Any:
    """A call that is ended after so many seconds."""

    def end(*_: Any) -> None:
        raise TooLong

    before = signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        return call()
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def settings(case: Case, germs: int) -> Iterator[tuple[str, Callable[[], Any]]]:
    """What an expert might choose, by method from cheap to expensive."""
    problem = case.problem
    loose = (1e-3, 1e-5, 1e-8)
    curved = case.family in ("stop", "bolt")
    for rtol in loose:
        options = Options(rtol=rtol)
        if not curved:
            for order in range(1, 9 if germs < 4 else 5):
                chaos = Chaos(order=order, check_points=0)
                yield f"chaos {order}, {rtol:g}", lambda c=chaos, o=options: solve(
                    problem, chaos=c, options=o, progress=False
                )
        for points in (3, 5, 7, 9, 12, 16, 24):
            if points**germs <= 2000:
                yield f"tensor {points}, {rtol:g}", lambda n=points, o=options: tensor_quadrature(
                    problem, n, options=o, progress=False
                )
        for level in (1, 2, 3):
            if germs > 1 and germs**level <= 600:
                yield f"sparse {level}, {rtol:g}", lambda n=level, o=options: sparse_quadrature(
                    problem, n, options=o, progress=False
                )
        for count in (64, 512, 4096):
            yield f"Sobol {count}, {rtol:g}", lambda n=count, o=options: quasi_monte_carlo(
                problem, n, options=o, progress=False
            )


def priced(case: Case, germs: int, limit: float) -> list[tuple[str, float, float]]:
    """Setting, seconds and true error of what an expert might choose, until the tightest accuracy is met."""
    found: list[tuple[str, float, float]] = []
    for name, call in settings(case, germs):
        method = name.split()[0], name.split(", ")[1]
        if any((n.split()[0], n.split(", ")[1]) == method and e <= 0.3 * ACCURACIES[-1] for n, _, e in found):
            continue
        try:
            began = perf_counter()
            result = limited(limit, call)
            seconds = perf_counter() - began
            found.append((name, seconds, off(result.mean_std(case.quantity), case.exact)))
        except Exception:
            continue  # indefinite, not integrable, too long
    return found


def measure(case: Case, accuracies: tuple[float, ...], cost: bool, limit: float) -> list[dict[str, Any]]:
    """The runs of one scene."""
    rows: list[dict[str, Any]] = []
    germs = 0
    for accuracy in accuracies:
        row: dict[str, Any] = {"family": case.family, "scene": case.told, "asked": accuracy}
        try:
            began = perf_counter()
            asked = partial(solve, case.problem, accuracy=accuracy, quantity=case.quantity, meshes=False)
            result = limited(limit, asked)
            row["seconds"] = perf_counter() - began
            made = result.errors()
            found = result.mean_std(case.quantity)
            germs = result.space.dimension
            row |= {"true": off(found, case.exact), "said": made.total, "reached": bool(made.reached)}
            row |= {"mean": found.mean, "std": found.std, "exact": list(case.exact), "germs": germs}
            row["how"] = repr(result)
        except TooLong:
            row |= {"true": None, "reached": False, "how": f"more than {limit:g} s"}
        except Exception as error:
            row |= {"true": None, "reached": False, "how": f"{type(error).__name__}: {error}"}
        row["broken"] = bool(row["reached"] and not row["true"] <= accuracy)
        rows.append(row)
    if cost and germs:
        prices = priced(case, germs, limit)
        for row in rows:
            good = [(s, n) for n, s, e in prices if e <= row["asked"]]
            if row["reached"] and good:
                row["best"], row["best_seconds"] = min(good)[1], min(good)[0]
                row["cost"] = row["seconds"] / min(good)[0]
    return rows


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """What the runs come to."""
    said = [r for r in rows if r["reached"]]
    costs = [r["cost"] for r in rows if "cost" in r]
    return {
        "runs": len(rows),
        "broken": sum(r["broken"] for r in rows),
        "worst": max((r["true"] / r["asked"] for r in said), default=None),
        "median_cost": statistics.median(costs) if costs else None,
        "worst_cost": max(costs, default=None),
        "not_reached": sum(not r["reached"] for r in rows),
        "failed": sum(r["true"] is None for r in rows),
    }


def main() -> None:
    """Measure and report."""
    parser = common.parser("promise", __doc__)
    parser.add_argument("--scenes", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="number of the first scene")
    parser.add_argument("--only", nargs="*", choices=list(FAMILIES), default=list(FAMILIES))
    parser.add_argument("--accuracies", nargs="*", type=float, default=list(ACCURACIES))
    parser.add_argument("--no-cost", action="store_true", help="do not look for the cheapest setting")
    parser.add_argument("--limit", type=float, default=100.0, help="seconds of a run at most")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    rows: list[dict[str, Any]] = []
    for number in range(given.first, given.first + given.scenes):
        rng = np.random.default_rng([given.seed, number])
        family = given.only[number % len(given.only)]
        case = FAMILIES[family](rng)
        found = measure(case, tuple(given.accuracies), not given.no_cost, given.limit)
        for row in found:
            row["number"] = number
            mark = "BROKEN" if row["broken"] else "" if row["reached"] else "not reached"
            true, said = row["true"], row.get("said")
            figures = "" if true is None else f"true {true:.1e} said {said:.1e} {row['seconds']:6.2f} s"
            price = f" x{row['cost']:.1f}" if "cost" in row else ""
            ended = f"{figures}{price} {mark} {row['how'][:70]}"
            print(f"{number:4} {family:9} {row['asked']:.0e} {ended}", flush=True)
        if any(r["broken"] or r["true"] is None for r in found):
            print(f"     {case.told}", flush=True)
        rows += found
        del case
        gc.collect()
    total = summary(rows)
    by_family = [(f, summary([r for r in rows if r["family"] == f])) for f in given.only]
    keys = ("runs", "broken", "not_reached", "worst", "median_cost", "worst_cost")
    common.table(
        ("", *(key.replace("_", " ") for key in keys)),
        [[name, *(found[key] for key in keys)] for name, found in [*by_family, ("all", total)]],
    )
    record = {**total, "scenes": given.scenes, "seed": given.seed, "environment": common.environment()}
    common.write_json({**record, "commit": common.commit(), "cases": rows}, given.json)


if __name__ == "__main__":
    main()
