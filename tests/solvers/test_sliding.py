"""Where small sliding ends, it is said: rigid blocks, whose slip is what is given."""

from __future__ import annotations

import warnings
from typing import Any

import pytest

import dolfinx_frontend as lf


def dragged(by: float, unit: float = 1.0, cells: int = 4) -> lf.Problem:
    """A block of 10 mm on a bed, pressed at first, then dragged along by so many mm."""
    scene, steel = lf.Scene(), lf.LinearElastic(210e3 / unit**2, 0.0)
    ten = 10 * unit
    scene.substructure("bed", lf.geometry.box((3 * ten, ten), (3 * cells, 2), origin=(-ten, -ten)), steel)
    scene.substructure("block", lf.geometry.box((ten, ten), (cells, 2)), steel)
    scene.fix("bed:y0")
    scene.interface("joint", "block:y0", "bed:y1", lf.Contact(friction=0.01), overlap="partial")
    scene.fix("block:y1", lf.Amplitude([0, 1], [0, -1e-4 * ten]) * 1.0, components=1, name="press")
    scene.fix("block:y1", lf.Amplitude([1, 2], [0, by * unit]) * 1.0, components=0, name="drag")
    return lf.assemble(scene)


def said(problem: lf.Problem, **settings: Any) -> list[str]:
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        lf.solve(problem, times=[1.0, 2.0], progress=False, **settings)
    return [text for each in found if "'joint': its faces" in (text := str(each.message))]


@pytest.mark.parametrize("unit", [1.0, 1e-3])
def test_a_slip_beyond_a_share_of_the_face_is_said(unit: float) -> None:
    """5 % of 10 mm; what presses moves 1e-3 mm on the way."""
    assert said(dragged(0.45, unit)) == []
    [text] = said(dragged(0.55, unit))
    assert f"slide by {0.55 * unit:.2g}" in text.replace("0.549", "0.55") and "at t = 2" in text
    assert f"further than {0.5 * unit:.3g}" in text


def test_a_slip_beyond_a_facet_is_said() -> None:
    """On 40 facets of .25 mm."""
    assert said(dragged(0.2, cells=40)) == []
    assert "further than 0.25" in said(dragged(0.3, cells=40))[0]


def test_the_point_that_slides_furthest_is_named() -> None:
    problem = dragged(0.3)
    with pytest.warns(lf.SceneWarning, match="slide by .* at t = 2 at sweep point 1"):
        lf.sweep(problem, {"drag.value": [0.1, 3.0]}, times=[1.0, 2.0], progress=False)
