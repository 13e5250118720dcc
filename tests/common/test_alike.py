"""What ranks compare of what they were given."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from dolfinx_frontend.common.alike import digest


def made(text: str, **space: Any) -> Callable[..., Any]:
    """The function f of a text, with these globals."""
    known: dict[str, Any] = {"__name__": "scene", "np": np, "math": math, **space}
    exec(text, known)
    found: Callable[..., Any] = known["f"]
    return found


LAW = "def f(x): return 80.0 + 400.0 * r"
DEEP = "def f(x): return [r * each for each in x]"
HELPED = "def help(x): return r * x\ndef f(x): return help(x)"
TABLE = "def f(x): return r['a'] * x"


@pytest.mark.parametrize("text", [LAW, DEEP, HELPED])
def test_globals_that_differ_are_seen(text: str) -> None:
    assert digest(made(text, r=1.0)) == digest(made(text, r=1.0))
    assert digest(made(text, r=1.0)) != digest(made(text, r=2.0))
    assert digest(made(text, r=1.0)) == digest(made(text, r=1.0, other=3.0))


def test_containers_and_libraries() -> None:
    assert digest(made(TABLE, r={"a": 1})) != digest(made(TABLE, r={"a": 2}))
    root = "def f(x): return r(x)"
    assert digest(made(root, r=math.sqrt)) == digest(made(root, r=math.sqrt))
    assert digest(made(root, r=np.linalg.norm)) == digest(made(root, r=np.linalg.norm))


def test_circles_end() -> None:
    text = "def f(x): return x and f(x - 1)"
    assert digest(made(text)) == digest(made(text))
