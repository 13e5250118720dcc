"""Which rank a part belongs to: equal shares, and glued bodies that stay whole where these are as even."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

import dolfinx_frontend as lf
from dolfinx_frontend.assembly.assemble import placed
from dolfinx_frontend.geometry import box

ELASTIC = lf.Elastic(normal=1e4, tangential=1e4)


class Ranks:
    """As much of a communicator as placing asks for."""

    def __init__(self, size: int) -> None:
        self.size = size


def row(laws: Sequence[lf.Law], ranks: Sequence[int | None] | None = None) -> lf.Scene:
    """Alike blocks b0, b1, ... with these laws between them."""
    scene = lf.Scene()
    for k in range(len(laws) + 1):
        block = box((1.0, 1.0), (2, 2), origin=(float(k), 0.0))
        rank = None if ranks is None else ranks[k]
        scene.substructure(f"b{k}", block, lf.LinearElastic(E=1.0, nu=0.3), degree=1, rank=rank)
    scene.fix("b0:x0")
    for k, law in enumerate(laws):
        scene.interface(f"j{k}", f"b{k}:x1", f"b{k + 1}:x0", law)
    return scene


@pytest.mark.parametrize(
    ("laws", "ranks", "expected"),
    [
        ([ELASTIC] * 3, 2, [0, 0, 1, 1]),
        ([lf.Perfect(), ELASTIC, lf.Perfect()], 2, [0, 0, 1, 1]),
        # 3 : 3 as without glue, though the middle of the row is glued
        ([ELASTIC, ELASTIC, lf.Perfect(), ELASTIC, ELASTIC], 2, [0, 0, 0, 1, 1, 1]),
        # 5 : 4 instead of the same with the glue in the middle cut
        ([ELASTIC, ELASTIC, ELASTIC, lf.Perfect(), ELASTIC, ELASTIC, ELASTIC, ELASTIC], 2, [0] * 5 + [1] * 4),
        # all glued: no share would be even
        ([lf.Perfect()] * 3, 2, [0, 0, 1, 1]),
    ],
)
def test_glued_bodies_stay_whole_where_shares_are_as_even(
    laws: Sequence[lf.Law], ranks: int, expected: Sequence[int]
) -> None:
    owner = placed(row(laws), Ranks(ranks))
    assert [owner[f"b{k}"] for k in range(len(laws) + 1)] == expected


def test_a_glued_body_that_is_not_contiguous_stays_whole() -> None:
    """As of the vessel: what is glued need not be side by side in the scene."""
    scene = row([ELASTIC] * 3)
    scene.interface("glue", "b0:y1", "b2:y1", lf.Perfect())
    scene.interface("glue 2", "b1:y1", "b3:y1", lf.Perfect())
    owner = placed(scene, Ranks(2))
    assert owner["b0"] == owner["b2"] != owner["b1"] == owner["b3"]


def test_ranks_by_hand_are_kept() -> None:
    scene = row([lf.Perfect(), ELASTIC, lf.Perfect()], ranks=[None, 1, None, None])
    owner = placed(scene, Ranks(2))
    assert owner["b1"] == 1 and owner["b0"] == 0
