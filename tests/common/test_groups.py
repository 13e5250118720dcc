"""Groups of connected things, directions of vectors, and columns of text."""

import numpy as np

from dolfinx_frontend.common.describe import columns
from dolfinx_frontend.common.groups import group_labels, grouped
from dolfinx_frontend.common.vectors import unit


def test_groups_are_numbered_by_their_first_members():
    assert group_labels(6, [(5, 1), (4, 0), (1, 3)]).tolist() == [0, 1, 2, 1, 0, 1]
    assert group_labels(3, []).tolist() == [0, 1, 2]
    assert group_labels(0, []).shape == (0,)
    for seed in range(20):  # against a search by hand
        rng = np.random.default_rng(seed)
        count = int(rng.integers(1, 40))
        pairs = rng.integers(0, count, (int(rng.integers(0, 40)), 2))
        label = np.arange(count)
        for _ in range(count):
            for a, b in pairs:
                label[a] = label[b] = min(label[a], label[b])
        names = sorted(set(label.tolist()))
        assert group_labels(count, pairs).tolist() == [names.index(k) for k in label]


def test_things_keep_their_order():
    assert grouped(["d", "b", "a", "c"], [("a", "d"), ("c", "b")]) == [["d", "a"], ["b", "c"]]
    assert grouped(["x"], [("x", "x")]) == [["x"]]
    assert grouped([], []) == []


def test_directions_of_axes_are_exact():
    assert unit(np.array([0.0, -2.0, 1e-12])).tolist() == [0.0, -1.0, 0.0]
    assert not np.signbit(unit(np.array([-1e-13, 3.0]))).any()
    v = np.array([1.0, 2.0, -2.0])
    assert np.allclose(unit(v), v / 3.0, rtol=1e-15)


def test_columns_are_aligned():
    assert columns([("name", "n"), ("a", "100")], "<>") == ["name    n", "a     100"]
    assert columns([("a", ""), ("bc", "")], "<<") == ["a", "bc"]
    assert columns([], "<>") == []
