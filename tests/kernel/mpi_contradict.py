"""Program of test_mpi.py: prescribed displacements that contradict each other over ranks, against one rank.

``mpirun -n 2 python mpi_contradict.py``; prints a line a rank.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from blocks import RANK, WORLD
from mpi4py import MPI

from dolfinx_frontend import (
    Amplitude,
    Elastic,
    LinearElastic,
    Options,
    Perfect,
    Scene,
    SceneError,
    Uniform,
    assemble,
    geometry,
    monte_carlo,
    solve,
    sweep,
)

OPTIONS = Options(rtol=1e-8, max_iterations=400)
Call = Callable[[Any, Any], Any]


def pair(
    top: Any,
    other: Any,
    cells: tuple[int, int] = (2, 2),
    jump: Any = 0.0,
    tie: str = "",
    bed: bool = False,
    swapped: bool = False,
    spread: bool = True,
) -> Scene:
    """Two glued squares, one a rank, whose tops are moved: where they meet both have to be the same."""
    scene = Scene()
    for name, x, n in (("a", 0.0, cells[0]), ("b", 1.0, cells[1])):
        square = geometry.box((1.0, 1.0), (n, n), origin=(x, 0.0))
        rank = int(name == "b") ^ swapped
        scene.substructure(name, square, LinearElastic(1e5, 0.0), degree=1, rank=rank if spread else None)
    scene.interface("glue", "a:x1", "b:x0", Perfect(jump=jump))
    if bed:
        scene.interface("bed", "a:y0", Elastic(normal=1e4, tangential=1e4))
    else:
        scene.fix(["a:y0", "b:y0"])
    scene.fix("a:y1", top, components=None if bed else 1, name="ta")
    if tie:
        still = {"x": 0.0, "y": other, "rz": 0.0} if tie == "rigid" else {"n": other, "tilts": False}
        {"rigid": scene.rigid, "plane": scene.plane}[tie]("b:y1", name="tb", **still)
    else:
        scene.fix("b:y1", other, components=None if bed else 1, name="tb")
    return scene


def ring(last: float, spread: bool = True) -> Scene:
    """Four plates around a point, in turn on the ranks: the jumps of their joints have to agree there."""
    scene = Scene()
    for k, (name, corner) in enumerate((("a", (0, 0)), ("b", (1, 0)), ("c", (1, 1)), ("d", (0, 1)))):
        square = geometry.box((1.0, 1.0), (1, 1), origin=corner)
        scene.substructure(name, square, LinearElastic(1e5, 0.2), degree=1, rank=k % 2 if spread else None)
    scene.interface("ab", "a:x1", "b:x0", Perfect(jump=0.1))
    scene.interface("bc", "b:y1", "c:y0", Perfect())
    scene.interface("dc", "d:x1", "c:x0", Perfect(jump=last))
    scene.interface("ad", "a:y1", "d:y0", Perfect())
    scene.fix("a:x0")
    scene.traction("c:x1", (50.0, 0.0))
    return scene


def through(other: float, spread: bool = True) -> Scene:
    """Three parts at one point; the two that are held share no face, but that of the third between them."""
    scene = Scene()
    parts = {"a": (0.0, 0.0), "b": (1.0, 0.0), "c": (1.0, 1.0)}
    for name, corner in parts.items():
        square = geometry.box((1.0, 1.0), (2, 2), origin=corner)
        rank = int(name == "b") if spread else None
        scene.substructure(name, square, LinearElastic(1e5, 0.2), degree=1, rank=rank)
    scene.interface("ab", "a:x1", "b:x0", Perfect())
    scene.interface("bc", "b:y1", "c:y0", Perfect())
    scene.fix("a:y1", 0.01, components=1, name="ta")
    scene.fix("a:y0")
    scene.fix("c:x0", other, components=1, name="tc")
    return scene


def verdict(call: Callable[[], Any]) -> str:
    """What is said, without the words that say on how many ranks."""
    try:
        found = call()
    except SceneError as error:
        return str(error)
    return str(getattr(found, "statuses", found.status))


def same(scene: Callable[..., Scene], call: Call, wanted: str, **settings: Any) -> None:
    """Both ranks say the same sentence, which is that of one rank."""
    settings["options"] = OPTIONS
    problem = assemble(scene(), comm=WORLD)
    told = WORLD.allgather(verdict(lambda: call(problem, settings)))
    alone = verdict(lambda: call(assemble(scene(spread=False), comm=MPI.COMM_SELF), settings))
    assert told[0] == told[1], told
    assert told[0] == alone, (told[0], alone)
    assert wanted in alone, alone


def solved(problem: Any, settings: dict[str, Any]) -> Any:
    return solve(problem, progress=False, **settings)


def fails() -> None:
    """A value that cannot be computed at the nodes of one rank ends all of them, and the next call works."""

    assembled: list[bool] = []

    def value(x: Any) -> Any:
        if assembled and np.any(x[:, 0] > 1.5):
            raise ArithmeticError("no value here")
        return np.full_like(x, 0.01)

    problem = assemble(pair(0.01, value), comm=WORLD)
    assembled.append(True)
    error = ""
    try:
        solve(problem, progress=False)
    except Exception as failure:  # that of a user's function on one rank
        error = str(failure)
    assert all("no value here" in each for each in WORLD.allgather(error)), error


CONTRADICT = "prescribe different displacements at"


def main() -> None:
    fails()
    # 1e-18 at the corner, of 0.01 elsewhere
    same(partial(pair, lambda x: [0.0, 0.01] * np.sin(np.pi * x[:, :1]), 0.0), solved, "converged")
    for active in (None, "all"):
        for cells in ((2, 2), (2, 3), (3, 2)):
            for swapped in (False, True):
                moved = partial(pair, 0.01, cells=cells, swapped=swapped)
                same(partial(moved, 0.02), solved, f"'ta' and 'tb' {CONTRADICT}", active=active)
                same(partial(moved, 0.01), solved, "converged", active=active)
            for tie in ("rigid", "plane"):
                text = "face" if cells == (2, 2) else CONTRADICT
                same(partial(pair, 0.01, 0.02, cells, tie=tie), solved, text, active=active)
                same(partial(pair, 0.01, 0.01, cells, tie=tie), solved, "converged", active=active)
        # a jump of 0.01 along y makes both right
        same(partial(pair, 0.01, 0.02, jump=(0.0, 0.01), bed=True), solved, CONTRADICT, active=active)
        in_time = Amplitude([0, 1, 2], [0, 0.9, -0.96])
        for other, said in ((0.02, CONTRADICT), (0.01, "converged")):
            moved = partial(pair, in_time * 0.01, in_time * other)
            same(moved, solved, said, active=active, times=[1.0, 2.0])
        same(partial(ring, 0.2), solved, "contradicts", active=active)
        same(partial(ring, 0.1), solved, "converged", active=active)
        same(partial(through, 0.02), solved, CONTRADICT, active=active)
        same(partial(through, 0.01), solved, "converged", active=active)

        one, other = Uniform("one", 0.01, 0.02), Uniform("other", 0.01, 0.02)
        for second, said in ((other, "random ones agree"), (one, "converged")):
            random = partial(pair, one, second)
            same(random, lambda p, s: solve(p, chaos=1, progress=False, **s), said, active=active)
            same(random, lambda p, s: monte_carlo(p, 4, progress=False, **s), said, active=active)
        values = [0.01, 0.02, 0.03]
        swept = partial(pair, 0.01, 0.01, bed=True)
        grid = {"ta.value": values, "tb.value": values[:2]}
        same(swept, lambda p, s: sweep(p, grid, progress=False, **s), "no_equilibrium", active=active)
        both: Any = {("ta.value", "tb.value"): values}
        same(swept, lambda p, s: sweep(p, both, progress=False, **s), "converged", active=active)
    print(f"rank {RANK}: as on one")


if __name__ == "__main__":
    main()
