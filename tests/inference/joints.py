"""A bolted joint that opens where the load exceeds the preload, whatever is elastic beside: Q > K D."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from scipy import stats

import dolfinx_frontend as lf
from dolfinx_frontend import geometry

Array = npt.NDArray[np.float64]

K, D, K_COV, D_COV, Q_COV = 5e4, 0.2, 0.1, 0.1, 0.15
AREA, JOINT = 600.0, 4e5  # mm^2, N/mm
RARE, LESS_RARE = 3772.905, 4500.0
"""Mean loads, N, with the probabilities 1.000e-6 and 4.90905e-5."""


def joints(load: float, count: int = 1) -> lf.Problem:
    """So many joints with a bolt and a layer that bears each, pulled by the same random load."""
    scene = lf.Scene()
    pull = lf.LogNormal("Q", load, cov=Q_COV)
    for number in range(count):
        tag = "" if count == 1 else str(number + 1)
        for level, name in enumerate(("base", "cover")):
            origin = (40.0 * number, 0.0, 10.0 * level)
            part = geometry.box((20.0, 30.0, 10.0), (2, 2, 1), origin)
            scene.substructure(name + tag, part, lf.LinearElastic(200e3, 0.0), degree=1)
        scene.fix(f"base{tag}:z0", name="foot" + tag)
        scene.symmetry([f"cover{tag}:x0", f"cover{tag}:y0"])
        sides = f"base{tag}:z1", f"cover{tag}:z0"
        scene.interface("joint" + tag, *sides, lf.Contact(stiffness=JOINT / AREA))
        stiffness = lf.LogNormal("K" + tag, K, cov=K_COV)
        short = lf.LogNormal("D" + tag, D, cov=D_COV)
        scene.interface("bolt" + tag, *sides, lf.Elastic(normal=stiffness, jump=-short, total=True))
        scene.force(f"cover{tag}:z1", (0.0, 0.0, pull), name="load" + tag)
    return lf.assemble(scene)


def lognormal(mean: float, cov: float) -> tuple[float, float]:
    """Mean and deviation of the logarithm."""
    deviation = math.sqrt(math.log1p(cov * cov))
    return math.log(mean) - 0.5 * deviation**2, deviation


def exact(load: float, count: int = 1) -> float:
    """P(Q > K_i D_i of any i): 1 - E[(1 - p(Q))^n], p lognormal, by a sum over the score of Q."""
    (k, s), (d, t), (q, r) = lognormal(K, K_COV), lognormal(D, D_COV), lognormal(load, Q_COV)
    z = np.linspace(-9.0, 9.0, 20001)
    below = stats.norm.cdf((q + r * z - k - d) / math.hypot(s, t))
    density = stats.norm.pdf(z) * (z[1] - z[0])
    return float(density @ -np.expm1(count * np.log1p(-below)))
