"""Answers of scenes of many parts, printed as digests: run by test_threads on several numbers of threads."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Iterable

import numpy as np

import dolfinx_frontend as lf


def digest(blocks: Iterable[np.ndarray]) -> str:
    return hashlib.sha256(b"".join(np.ascontiguousarray(each).tobytes() for each in blocks)).hexdigest()[:16]


def stack(law: lf.Law, parts: int = 3, cells: int = 6, push: object = (1.0, 0.0, -20.0)) -> lf.Problem:
    """Blocks on top of each other with joints of one law, pressed and sheared."""
    scene = lf.Scene()
    for k in range(parts):
        # not all alike: what is done first must not matter
        counts = (cells, cells, 1 + k % 3)
        mesh = lf.geometry.box((10.0, 10.0, 6.0), counts, origin=(0.0, 0.0, 6.0 * k), cell="hexahedron")
        scene.substructure(f"b{k}", mesh, lf.LinearElastic(E=200e3 / (1 + k), nu=0.3), degree=1)
    scene.fix("b0:z0")
    for k in range(1, parts):
        scene.interface(f"j{k}", f"b{k - 1}:z1", f"b{k}:z0", law)
    scene.traction(f"b{parts - 1}:z1", push)
    return lf.assemble(scene, progress=lambda line: None)


def main() -> None:
    quiet = lf.Options(rtol=1e-5, max_iterations=400)
    on = lf.Amplitude([1.0, 2.0, 3.0], [0.3, 1.0, 0.5])
    rubs = stack(lf.Contact(friction=0.3), push=on * (1.0, 0.0, -20.0))
    result = lf.solve(rubs, times=np.array([1.0, 2.0, 3.0]), options=quiet, progress=False)
    print("friction", result.status, digest(result.displacements.values()))

    spring = lf.Elastic(normal=lf.LogNormal("k", 1e4, cov=0.3), tangential=5e3)
    chaos = lf.solve(stack(spring), chaos=lf.Chaos(order=3), options=quiet, progress=False)
    print("chaos", chaos.status, digest(chaos.force(f"j{k}") for k in range(1, 3)))

    sets = stack(lf.Contact(friction=lf.Uniform("mu", 0.1, 0.4)), push=(1.0, 0.0, -20.0))
    drawn = lf.monte_carlo(sets, 6, seed=1, options=quiet, progress=False)
    print("samples", drawn.converged, digest(drawn.force(f"j{k}") for k in range(1, 3)))

    asked = set()

    def rubber(jump: np.ndarray, *, stiffness: np.ndarray) -> np.ndarray:
        asked.add(threading.get_ident())
        return stiffness[:, None] * jump * (1.0 + np.sum(jump**2, axis=1))[:, None]

    soft = lf.UserLaw(force=rubber, values={"stiffness": 1e3})
    result = lf.solve(stack(soft), options=quiet, progress=False)
    assert asked == {threading.get_ident()}, "a function of the user is called on the thread of the call"
    print("law", result.status, digest(result.displacements.values()))


if __name__ == "__main__":
    main()
