"""Points of parts by geometry, supports 3-2-1, and sizes of cells with what they cost."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dolfinx_frontend as lf
from dolfinx_frontend.common.errors import SceneError

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "demos"))

from make_bracket_step import make_bracket  # noqa: E402
from parts.step_file import write_step  # noqa: E402


def lug(occ: Any) -> dict[str, int]:
    """A plate of 60 x 30 x 10 with a hole of 8 at (15, 15) and one of 12 at (45, 15)."""
    tools = [(3, occ.addCylinder(x, 15, -1, 0, 0, 12, r)) for x, r in ((15, 4), (45, 6))]
    return {"lug": int(occ.cut([(3, occ.addBox(0, 0, 0, 60, 30, 10))], tools)[0][0][1])}


@pytest.fixture(scope="module")
def plate(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_step(tmp_path_factory.mktemp("places") / "lug.step", lug)


def test_nearest_corner_edge_and_hole(plate: Path) -> None:
    step = lf.read_step(plate)
    assert np.allclose(step.point("lug", near=(59, 1, 12)), (60, 0, 10))
    assert np.allclose(step.point("lug", near=(20, -3, 9), on="edge"), (20, 0, 10))
    # the rim of the hole of 12, from a point in the direction (3, 4): an arc, not its chords
    on = step.point("lug", near=(45 + 4.5, 15 + 6.0, 11), on="edge")
    assert np.allclose(on, (45 + 3.6, 15 + 4.8, 10), atol=1e-9)
    assert np.allclose(step.point("lug", near=(44, 14, 4), on="hole"), (45, 15, 4))
    assert np.allclose(step.point("lug", near=(16, 14, 40), on="hole"), (15, 15, 10))
    with pytest.raises(SceneError, match="unknown part 'lugg'; did you mean 'lug'"):
        step.point("lugg", near=(0, 0, 0))
    with pytest.raises(SceneError, match="kind of place 'holes'.*'hole'"):
        step.point("lug", near=(0, 0, 0), on="holes")
    with pytest.raises(SceneError, match="near = .*three coordinates"):
        step.point("lug", near=(0, 0))


def test_the_nearest_face(plate: Path) -> None:
    step = lf.read_step(plate)
    step.face("lug:eye", near=(45, 15, 5), where=lambda s: s.kind == "cylinder")
    step.face("lug:end", near=(-9, 15, 5))
    radii = {face: {s.radius and round(s.radius, 9) for s in step.solids["lug"].surfaces if s.tag in tags}
             for (_, face), tags in step._named.items()}
    assert radii == {"eye": {6.0}, "end": {None}}


def test_a_remote_load_at_a_hole_with_supports_3_2_1(plate: Path) -> None:
    """Reactions by hand: moments about the three points."""
    step = lf.read_step(plate)
    step.material("*", lf.LinearElastic(E=210e3, nu=0.3, alpha=1e-5))
    step.face("lug:eye", near=(45, 15, 5), where=lambda s: s.kind == "cylinder")
    scene = step.scene(progress=False)
    points = [step.point("lug", near=p) for p in ((0, 0, 0), (60, 0, 0), (0, 30, 0))]
    scene.fix_321("lug", points)
    scene.force("lug:eye", (0.0, 0.0, -900.0), point=step.point("lug", near=(45, 15, 0), on="hole"))
    scene.temperature("lug", 50.0)  # it expands freely: no reaction
    result = lf.solve(lf.assemble(scene))
    names = ["support 3", "support 2", "support 1"]
    held = [[result.table(names).value(f"force_{x}", n) for x in "xyz"] for n in names]
    # about y: 60 b = 45 * 900; about x: 30 c = 15 * 900; a is the rest
    assert np.allclose(held, [[0, 0, -225.0], [0, 0, 675.0], [0, 0, 450.0]], atol=1e-6)


def test_supports_3_2_1_want_a_triangle() -> None:
    scene = lf.Scene()
    scene.substructure("b", lf.geometry.box((4, 2, 2), (2, 1, 1)), lf.LinearElastic(E=1.0, nu=0.3))
    with pytest.raises(SceneError, match="fix_321 of 'b': the points .* are on one line"):
        scene.fix_321("b", ((0, 0, 0), (2, 0, 0), (4, 0, 0)))
    with pytest.raises(SceneError, match="give three points"):
        scene.fix_321("b", ((0, 0, 0), (2, 0, 0)))


def test_sizes_follow_from_the_accuracy(tmp_path: Path) -> None:
    """Thickness, shank, ring; half as large for a quarter of the error; the forecast is near what comes."""
    step = lf.read_step(make_bracket(tmp_path / "bracket.step"))
    step.sizes()
    coarse = dict(step._sizes)
    assert math.isclose(coarse["bracket"], step.solids["bracket"].thickness) and coarse["bolt 1"] <= 4.0
    # under the head: a ring from the hole of 9 to the head of 13
    assert math.isclose(step._local["bracket|bolt 1"], 2.0, rel_tol=1e-6)
    step.sizes(accuracy=0.0125)
    assert all(math.isclose(step._sizes[n], 0.5 * size) for n, size in coarse.items())
    step.sizes()
    table = str(step).splitlines()
    (told,) = (row.split() for row in table if row.startswith("all, about"))
    meshed = step.mesh(progress=False)
    cells = sum(part.mesh.topology.index_map(3).size_local for part in meshed.parts.values())
    assert 0.67 < float(told[2]) / cells < 1.5
    with pytest.raises(SceneError, match="accuracy = 0"):
        step.sizes(accuracy=0.0)
