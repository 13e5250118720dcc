"""The limit states on which OpenTURNS compares its algorithms (otbenchmark), in standard normal variables.

Definitions: M. Baudin et al., otbenchmark, most of them after the set of TNO ("RPxx", rprepo). The
probabilities are integrated here: one variable in closed form, what is left by sums on grids or by scrambled
Sobol points. Those that otbenchmark prints with fewer digits (RP31's is that of another factor, RP75's is a
rounded simulation) agree with its simulations of 1e8 to 1e9 points.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import integrate, special, stats

from dolfinx_frontend.rare.design import Cut

Array = npt.NDArray[np.float64]
Function = Callable[[Array], Array]

R2 = math.sqrt(2.0)


class Conditions:
    """Conditions that are functions of standard normal variables (N, L) -> (N,); differences are free."""

    def __init__(self, dimension: int, *functions: Function, cuts: Sequence[Cut] | None = None) -> None:
        self.dimension, self.functions = dimension, functions
        self.points = self.slopes_made = 0
        self.differentiable = True
        self.cuts = cuts or [(k,) for k in range(len(functions))]

    def margins(self, u: Array) -> Array:
        self.points += len(u)
        return np.column_stack([np.broadcast_to(each(u), len(u)) for each in self.functions])

    def slopes(self, u: Array) -> Array:
        away = 1e-6 * np.eye(self.dimension)
        found = (self.margins(u + away) - self.margins(u - away)) / 2e-6
        self.points -= 2 * self.dimension
        self.slopes_made += 1
        return np.asarray(found.T)


@dataclass(frozen=True)
class Published:
    """A limit state: the event g < 0 of one function, or of several joined by cuts, and its probability."""

    dimension: int
    functions: tuple[Function, ...]
    probability: Callable[[], float]
    cuts: tuple[Cut, ...] | None = None

    def system(self) -> Conditions:
        """Conditions joined by cuts."""
        return Conditions(self.dimension, *self.functions, cuts=self.cuts)

    def single(self) -> Conditions:
        """The same as one function, min of max, as otbenchmark has it."""
        cuts = self.cuts or [(k,) for k in range(len(self.functions))]

        def worst(u: Array) -> Array:
            values = [each(u) for each in self.functions]
            ways = [np.max([np.broadcast_to(values[k], len(u)) for k in cut], axis=0) for cut in cuts]
            return np.asarray(np.min(ways, axis=0))

        return Conditions(self.dimension, worst)


# --- marginals as functions of standard normal scores ---------------------------------------------------
def lognormal(mean: float, std: float) -> Function:
    spread = math.sqrt(math.log1p((std / mean) ** 2))
    return lambda z: np.exp(math.log(mean) - 0.5 * spread**2 + spread * z)


def gumbel(mean: float, std: float) -> Function:
    scale = std * math.sqrt(6.0) / math.pi
    mode = mean - np.euler_gamma * scale
    return lambda z: mode - scale * np.log(-special.log_ndtr(z))


def uniform(low: float, high: float) -> Function:
    return lambda z: low + (high - low) * special.ndtr(z)


def exponential(z: Array) -> Array:
    return np.asarray(-special.log_ndtr(-z))


def _columns(u: Array) -> tuple[Array, ...]:
    return tuple(u.T)


# --- integrals ------------------------------------------------------------------------------------------
def one(function: Callable[[float], float], *breaks: float) -> float:
    """Integral of a function of a standard normal variable."""
    ends = sorted({-9.5, 9.5, *breaks})
    found = 0.0
    for low, high in zip(ends, ends[1:], strict=False):
        found += integrate.quad(
            lambda z: function(z) * stats.norm.pdf(z), low, high, epsabs=0.0, epsrel=1e-9, limit=400
        )[0]
    return float(found)


def plane(limit: Published, finest: int = 4001) -> float:
    """Of two variables: along one the signs are followed exactly, by bisection, along the other summed."""
    x = np.linspace(-8.9, 8.9, finest)
    grid = np.linspace(-8.9, 8.9, 1201)
    single = limit.single()
    total = 0.0
    for at in x:
        rows = np.column_stack([np.full(len(grid), at), grid])
        inside = single.margins(rows)[:, 0] < 0.0
        turns = np.flatnonzero(inside[1:] != inside[:-1])
        low, high = grid[turns], grid[turns + 1]
        for _ in range(45 if len(turns) else 0):
            middle = 0.5 * (low + high)
            now = single.margins(np.column_stack([np.full(len(middle), at), middle]))[:, 0] < 0.0
            same = now == inside[turns]
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        edges = special.ndtr(0.5 * (low + high))
        signs = np.where(inside[turns], 1.0, -1.0)  # it ends, or begins
        mass = float(signs @ edges) + float(inside[-1])
        total += mass * stats.norm.pdf(at) * (x[1] - x[0])
    return total


def sobol(dimension: int, chance: Function, log2: int = 19, wider: float = 1.0) -> float:
    """Mean of a conditional probability over scores, which are drawn wider and weighted."""
    found = []
    for seed in range(8):
        points = stats.qmc.Sobol(dimension, seed=seed).random_base2(log2)
        z = wider * special.ndtri(np.clip(points, 1e-15, 1.0 - 1e-15))
        weights = np.prod(stats.norm.pdf(z) / stats.norm.pdf(z / wider) * wider, axis=1)
        found.append(float(np.mean(weights * chance(z))))
    return float(np.mean(found))


# --- the set --------------------------------------------------------------------------------------------
def _rp8() -> Published:
    strong, load, other = lognormal(120.0, 12.0), lognormal(50.0, 10.0), lognormal(40.0, 8.0)

    def g(u: Array) -> Array:
        a, b, c, d, e, f = _columns(u)
        return np.asarray(
            strong(a) + 2.0 * strong(b) + 2.0 * strong(c) + strong(d) - 5.0 * load(e) - 5.0 * other(f)
        )

    def given(z: Array) -> Array:  # the score of the first load at which it fails
        a, b, c, d, f = _columns(z)
        left = (strong(a) + 2.0 * strong(b) + 2.0 * strong(c) + strong(d) - 5.0 * other(f)) / 5.0
        spread = math.sqrt(math.log1p(0.04))
        low = np.log(np.maximum(left, 1e-300))
        return np.asarray(special.ndtr(-(low - math.log(50.0) + 0.5 * spread**2) / spread))

    return Published(6, (g,), lambda: sobol(5, given))


def _rp14() -> Published:
    strength, force = uniform(70.0, 80.0), gumbel(1500.0, 350.0)

    def stress(b: Array, c: Array, d: Array, e: Array) -> Array:
        size, arm, moment = 39.0 + 0.1 * b, 400.0 + 0.1 * d, 250e3 + 35e3 * e
        bend = np.sqrt((force(c) * arm) ** 2 / 16.0 + moment**2)
        return np.asarray(32.0 / (math.pi * size**3) * bend)

    def g(u: Array) -> Array:
        return np.asarray(strength(u[:, 0]) - stress(*_columns(u[:, 1:])))

    def given(z: Array) -> Array:
        return np.asarray(np.clip((stress(*_columns(z)) - 70.0) / 10.0, 0.0, 1.0))

    return Published(5, (g,), lambda: sobol(4, given, wider=1.3))


def _rp38() -> Published:
    means = np.array([350.0, 50.8, 3.81, 173.0, 9.38, 33.1, 0.036])

    def factor(x: Array) -> Array:
        b, c, d, e, f, h = _columns(x)
        above = d**2 - 4.0 * e * f * h**2 + d * (f + 4.0 * e + 2.0 * f * h)
        return np.asarray(b**3 / (2.0 * c**3) * above / (d * e * (d + f + 2.0 * f * h)))

    def g(u: Array) -> Array:
        x = means * (1.0 + 0.1 * u)
        return np.asarray(15.59e4 - x[:, 0] * factor(x[:, 1:]))

    def given(z: Array) -> Array:
        return np.asarray(special.ndtr(-(15.59e4 / factor(means[1:] * (1.0 + 0.1 * z)) / 350.0 - 1.0) / 0.1))

    return Published(7, (g,), lambda: sobol(6, given))


def _rp60() -> Published:
    means = (2200.0, 2100.0, 2300.0, 2000.0)
    parts, load = [lognormal(m, 0.1 * m) for m in means], lognormal(1200.0, 480.0)

    def less(k: int, share: float) -> Function:
        return lambda u: np.asarray(parts[k](u[:, k]) - share * load(u[:, 4]))

    # g1 | ((g2 | g3 | g4) & (g7 & (g5 | g6)))
    functions = (
        less(0, 1.0), less(1, 0.5), less(2, 0.5), less(3, 0.5), less(1, 1.0), less(2, 1.0), less(3, 1.0),
    )  # fmt: skip
    cuts = ((0,), *((half, 6, full) for half in (1, 2, 3) for full in (4, 5)))

    def exact() -> float:
        spread = math.sqrt(math.log1p(0.01))

        def below(k: int, value: float) -> float:
            return float(special.ndtr((math.log(value / means[k]) + 0.5 * spread**2) / spread))

        def given(z: float) -> float:
            # whoever is below the full load is not always below the half, but g7 & (g5|g6) holds with
            # x4 < s and x2 or x3 < s; of x2, x3, x4 one must be below s / 2 as well
            s = float(load(np.array(z)))
            whole, half = ([below(k, share * s) for k in range(4)] for share in (1.0, 0.5))
            pair = whole[3] * (1.0 - (1.0 - whole[1]) * (1.0 - whole[2]))
            # none of the three is below a half: each is between s / 2 and s where it must be below s
            between = [whole[k] - half[k] for k in range(4)]
            over = [1.0 - half[k] for k in range(4)]
            none = between[3] * (over[1] * over[2] - (1.0 - whole[1]) * (1.0 - whole[2]))
            return 1.0 - (1.0 - whole[0]) * (1.0 - (pair - none))

        return one(given)

    return Published(5, functions, exact, cuts)


def _rp91() -> Published:
    def values(u: Array) -> tuple[Array, ...]:
        a, b, c, d, e = _columns(u)
        return (
            0.07433 + 0.005 * a, 0.1 + 0.01 * b, 13.0 + 60.0 * c, 4751.0 + 48.0 * d, -684.0 + 11.0 * e
        )  # fmt: skip

    def first(u: Array) -> Array:
        _, b, c, d, _ = values(u)
        linear = 0.847 + 0.96 * b + 0.986 * c - 0.216 * d + 0.077 * b**2 + 0.11 * c**2
        return np.asarray(linear + 7.0 / 378.0 * d**2 - c * b - 0.106 * b * d - 0.11 * c * d)

    def second(u: Array) -> Array:
        a, _, c, d, e = values(u)
        return np.asarray(84e3 * a / np.sqrt(c**2 + d**2 - c * d + 3.0 * e**2) - 1.0)

    def third(u: Array) -> Array:
        a, _, _, d, _ = values(u)
        return np.asarray(84e3 * a / np.abs(d) - 1.0)

    def given(z: Array) -> Array:
        u = np.column_stack([np.zeros(len(z)), z])
        _, _, c, d, e = values(u)
        needed = np.maximum(np.sqrt(c**2 + d**2 - c * d + 3.0 * e**2), np.abs(d)) / 84e3
        return np.where(first(u) < 0.0, 1.0, special.ndtr((needed - 0.07433) / 0.005))

    return Published(5, (first, second, third), lambda: sobol(4, given))


def _product(limit: float) -> float:
    """P(x y > limit) of two standard normal variables."""
    return 2.0 * one(lambda z: special.ndtr(-limit / z) if z > 0.0 else 0.0, 0.0, 1.0, math.sqrt(limit))


def _rp28() -> float:
    def given(z: float) -> float:
        return float(special.ndtr((146.14 / (78064.0 + 11710.0 * z) / 0.0104 - 1.0) / 0.15))

    return one(lambda z: given(z) if z > -78064.0 / 11710.0 + 1e-3 else 0.0, -5.0, -4.0, -3.0)


def _rp77() -> float:
    def given(z: float) -> float:
        x = 4.0 + z
        if x <= 5.0:
            return float(special.ndtr(-(10.0 - x) / math.hypot(0.5, 1.0)))
        return float(special.ndtr(-x))

    return one(given, 1.0)


def _rp33() -> float:
    both = stats.multivariate_normal(cov=[[1.0, 1.0 / math.sqrt(3.0)], [1.0 / math.sqrt(3.0), 1.0]])
    return float(2.0 * stats.norm.sf(3.0) - both.cdf([-3.0, -3.0]))


def _axial() -> float:
    spread = math.sqrt(math.log1p(0.01))

    def given(z: float) -> float:
        load = (75e3 + 5e3 * z) / (100.0 * math.pi)
        return float(special.ndtr((math.log(load / 300.0) + 0.5 * spread**2) / spread))

    return one(given)


def _rp63() -> float:
    def given(z: float) -> float:
        return float(stats.chi2.cdf(10.0 * (4.5 + z), 99))

    return one(given, 0.0, 2.0, 4.0, 6.0)


def _two(*functions: Callable[[Array, Array], Array], cuts: tuple[Cut, ...] | None = None) -> Published:
    """Of two standard normal variables."""

    def of(function: Callable[[Array, Array], Array]) -> Function:
        return lambda u: np.asarray(function(u[:, 0], u[:, 1]))

    made = Published(2, tuple(of(each) for each in functions), lambda: plane(made), cuts)
    return made


def _rp55() -> Published:
    square = uniform(-1.0, 1.0)

    def away(u: Array) -> Array:
        return np.asarray(square(u[:, 0]) - square(u[:, 1]))

    def exact() -> float:
        # of t = x1 - x2, triangular on (-2, 2), by symmetry t > 0: an island between two roots, and a tail
        roots = np.roots([0.6, 0.0, 0.0, -1.0 / R2, 0.2])
        low, high = sorted(float(r.real) for r in roots if abs(r.imag) < 1e-9)
        end = 5.0 / R2 - 2.2

        def tail(t: float) -> float:
            return 0.5 * (1.0 - 0.5 * t) ** 2

        return 2.0 * (tail(low) - tail(high) + tail(max(end, high)))

    return Published(
        2,
        (
            lambda u: 0.2 + 0.6 * away(u) ** 4 - away(u) / R2,
            lambda u: 0.2 + 0.6 * away(u) ** 4 + away(u) / R2,
            lambda u: away(u) + 5.0 / R2 - 2.2,
            lambda u: -away(u) + 5.0 / R2 - 2.2,
        ),
        exact,
    )


PUBLISHED: dict[str, Published] = {
    "RP8": _rp8(),
    "RP14": _rp14(),
    "RP22": _two(lambda x, y: 2.5 - (x + y) / R2 + 0.1 * (x - y) ** 2),
    "RP24": _two(lambda x, y: 2.5 - 0.2357 * 3.0 * (x - y) + 0.00463 * 81.0 * (x + y) ** 4),
    "RP25": _two(lambda x, y: x**2 - 8.0 * y + 16.0, lambda x, y: -16.0 * x + y + 32.0, cuts=((0, 1),)),
    "RP28": Published(
        2, (lambda u: (78064.0 + 11710.0 * u[:, 0]) * (0.0104 + 0.00156 * u[:, 1]) - 146.14,), _rp28
    ),
    "RP31": Published(
        2, (lambda u: 2.0 - u[:, 1] + 256.0 * u[:, 0] ** 4,),
        lambda: one(lambda z: special.ndtr(-2.0 - 256.0 * z**4), -1.0, -0.2, 0.0, 0.2, 1.0),
    ),
    "RP33": Published(
        3, (lambda u: 3.0 * math.sqrt(3.0) - u.sum(axis=1), lambda u: 3.0 - u[:, 2]), _rp33
    ),
    "RP35": _two(lambda x, y: 2.0 - y + np.exp(-0.1 * x**2) + (0.2 * x) ** 4, lambda x, y: 4.5 - x * y),
    "RP38": _rp38(),
    "RP53": _two(
        lambda x, y: np.sin(2.5 * (x + 1.5)) + 2.0 - ((x + 1.5) ** 2 + 4.0) * (y + 1.5) / 20.0
    ),
    "RP54": Published(
        20, (lambda u: exponential(u).sum(axis=1) - 8.951,), lambda: float(stats.gamma(20).cdf(8.951))
    ),
    "RP55": _rp55(),
    "RP57": _two(
        lambda x, y: -(x**2) + y**3 + 3.0,
        lambda x, y: 2.0 - x - 8.0 * y,
        lambda x, y: (x + 3.0) ** 2 + (y + 3.0) ** 2 - 4.0,
        cuts=((0, 1), (2,)),
    ),
    "RP60": _rp60(),
    "RP63": Published(100, (lambda u: 0.1 * (u[:, 1:] ** 2).sum(axis=1) - 4.5 - u[:, 0],), _rp63),
    "RP75": Published(2, (lambda u: 3.0 - u[:, 0] * u[:, 1],), lambda: _product(3.0)),
    "RP77": Published(
        3,
        (lambda u: np.where(
            u[:, 2] <= 1.0, 6.0 + 0.5 * u[:, 0] - u[:, 1] - u[:, 2], 4.0 + u[:, 2] - u[:, 1]
        ),),
        _rp77,
    ),
    "RP89": _two(lambda x, y: -(x**2) - y + 8.0, lambda x, y: -x / 5.0 - y + 6.0),
    "RP91": _rp91(),
    "RP107": Published(
        10, (lambda u: 5.0 * math.sqrt(10.0) - u.sum(axis=1),), lambda: float(stats.norm.sf(5.0))
    ),
    "RP110": Published(
        2,
        (
            lambda u: np.where(u[:, 0] <= 3.5, 0.85 - 0.1 * u[:, 0], 4.0 - u[:, 0]),
            lambda u: np.where(u[:, 1] <= 2.0, 2.3 - u[:, 1], 0.5 - 0.1 * u[:, 1]),
        ),
        lambda: float(-np.expm1(np.log1p(-stats.norm.sf(4.0)) + np.log1p(-stats.norm.sf(5.0)))),
    ),
    "RP111": Published(2, (lambda u: 12.5 - np.abs(u[:, 0] * u[:, 1]),), lambda: 2.0 * _product(12.5)),
    "four branches": _two(
        lambda x, y: 3.0 + 0.1 * (x - y) ** 2 - (x + y) / R2,
        lambda x, y: 3.0 + 0.1 * (x - y) ** 2 + (x + y) / R2,
        lambda x, y: x - y + 7.0 / R2,
        lambda x, y: y - x + 7.0 / R2,
    ),
    "R - S": Published(
        2, (lambda u: 2.0 + u[:, 0] - u[:, 1],), lambda: float(stats.norm.sf(math.sqrt(2.0)))
    ),
    "axial": Published(
        2,
        (lambda u: lognormal(300.0, 30.0)(u[:, 0]) - (75e3 + 5e3 * u[:, 1]) / (100.0 * math.pi),),
        _axial,
    ),
}  # fmt: skip

PROBABILITIES = {
    "RP8": 0.0007895722,
    "RP14": 0.00077282463,
    "RP22": 0.0042073067,
    "RP24": 0.0028601825,
    "RP25": 4.1488452e-05,
    "RP28": 1.4531627e-07,
    "RP31": 0.0032266812,
    "RP33": 0.0025755978,
    "RP35": 0.003478947,
    "RP38": 0.0080507266,
    "RP53": 0.031320486,
    "RP54": 0.00099060307,
    "RP55": 0.56001443,
    "RP57": 0.028234467,
    "RP60": 0.0448397,
    "RP63": 0.00037694361,
    "RP75": 0.0098192987,
    "RP77": 2.690844e-07,
    "RP89": 0.0054712805,
    "RP91": 0.00070025379,
    "RP107": 2.8665157e-07,
    "RP110": 3.1957884e-05,
    "RP111": 8.035086e-07,
    "four branches": 0.0022227945,
    "R - S": 0.078649604,
    "axial": 0.029198195,
}
"""What :meth:`Published.probability` integrates them to, which takes a few seconds for some."""
