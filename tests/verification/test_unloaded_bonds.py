"""Bonds that were at their strength and are unloaded: as they were, whatever the steps.

Secants are straight: what is loaded in proportion unloads in proportion, and comes back to where it was.
"""

from __future__ import annotations

import numpy as np
import pytest

import dolfinx_frontend as lf


def strap(scene: lf.Scene, name: str, pull: lf.Amplitude, y: float = 0.0) -> None:
    """Half of a double lap joint, pulled by a force."""
    for part, at in (("inner", (0.0, y)), ("outer", (35.0, y + 1.5))):
        box = lf.geometry.box((60, 1.5), (60, 2), origin=at, cell="quadrilateral")
        scene.substructure(f"{part} {name}", box, lf.LinearElastic(E=70e3, nu=0.0, plane="stress"))
    law = lf.Debonding(normal=9360.0, tangential=3600.0, strength=30.0, energy=2.0)
    scene.interface(name, f"outer {name}:y0", f"inner {name}:y1", law, overlap="partial")
    scene.fix(f"inner {name}:x0", components=0, name=f"root {name}")
    scene.symmetry(f"inner {name}:y0")
    scene.fix(f"outer {name}:x1", components=1, name=f"guide {name}")
    scene.force(f"outer {name}:x1", (pull * 1.0, 0.0), name=f"pull {name}")


def solved(times: list[float], **pulls: lf.Amplitude) -> lf.HistoryResult:
    scene = lf.Scene()
    for k, (name, pull) in enumerate(pulls.items()):
        strap(scene, name, pull, 50.0 * k)
    result = lf.solve(lf.assemble(scene), times=times, progress=False)
    assert result.converged
    return result


def damage(result: lf.HistoryResult, name: str = "glue") -> np.ndarray:
    return np.asarray(result.table(name, step=None)["damage"])


@pytest.mark.parametrize("load", [184.2, 250.0, 350.0])
@pytest.mark.parametrize("left", [0.99, 0.75, 0.1])
def test_what_is_unloaded_is_not_damaged(load: float, left: float) -> None:
    """From before, at and far behind the point at which damage grows fastest; and loaded again, and on."""
    pull = lf.Amplitude([0, 1, 2, 3, 4], [0, load, left * load, load, 1.05 * load])
    result = solved([0.5, 1.0, 2.0, 3.0, 4.0], glue=pull)
    reached = damage(result)
    assert reached[1] > 0.1
    np.testing.assert_allclose(reached[2:4], reached[1], rtol=1e-5)
    moved = [result.displacement("outer glue", step=step).x.array for step in range(4)]
    size = np.abs(moved[1]).max()
    np.testing.assert_allclose(moved[2], left * moved[1], rtol=0, atol=1e-5 * size)
    np.testing.assert_allclose(moved[3], moved[1], rtol=0, atol=1e-4 * size)
    at_once = solved([1.0], glue=lf.Amplitude([0, 1], [0, 1.05 * load]))
    np.testing.assert_allclose(reached[4], damage(at_once)[0], rtol=1e-3)


def test_a_load_that_turns() -> None:
    """Pushed as far as it was pulled: the most damaged point is no worse, but for what peels elsewhere."""
    result = solved([1.0, 1.5, 2.0, 3.0], glue=lf.Amplitude([0, 1, 2, 3], [0, 250, -250, 250]))
    np.testing.assert_allclose(damage(result)[:3], damage(result)[0], rtol=1e-5)
    np.testing.assert_allclose(damage(result)[3], damage(result)[0], rtol=1e-2)


def test_one_bond_is_unloaded_while_another_is_damaged() -> None:
    """Each as if it were alone, though both are at their strength when the step begins."""
    times = [0.5, 1.0, 2.0, 3.0]
    one = lf.Amplitude([0, 1, 2, 3], [0, 250, 150, 340])
    other = lf.Amplitude([0, 1, 2, 3], [0, 260, 330, 50])
    both = solved(times, one=one, other=other)
    for name, pull in (("one", one), ("other", other)):
        np.testing.assert_allclose(damage(both, name), damage(solved(times, **{name: pull}), name), rtol=1e-4)
