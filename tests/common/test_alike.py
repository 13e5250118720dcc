"""What ranks compare of what they were given."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from dolfinx_frontend import Elastic, LogNormal, UserLaw, geometry
from dolfinx_frontend.common.alike import described, difference, digest


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


def test_what_cannot_be_told_apart_counts_by_its_kind() -> None:
    """Where a checkpoint refuses; a rank has locks, meshes and communicators of its own."""
    assert digest(threading.Lock()) == digest(threading.Lock())
    assert digest([threading.Lock(), 1.0]) != digest([threading.Lock(), 2.0])
    assert digest(made("def f(x): return r", r=threading.Lock())) == digest(
        made("def f(x): return r", r=threading.Lock())
    )
    boxes = [geometry.box((1.0, 1.0), (n, n)) for n in (1, 2)]
    assert digest(boxes[0].mesh) == digest(boxes[1].mesh)


def test_records_and_random_variables() -> None:
    assert digest(LogNormal("k", 30.0, cov=0.3)) == digest(LogNormal("k", 30.0, cov=0.3))
    assert digest(LogNormal("k", 30.0, cov=0.3)) != digest(LogNormal("k", 31.0, cov=0.3))
    assert digest(Elastic(normal=np.ones(3))) == digest(Elastic(normal=np.ones(3)))
    assert digest(Elastic(normal=np.ones(3))) != digest(Elastic(normal=np.arange(3.0)))
    assert digest({"a": np.float64(1.0)}) == digest({"a": 1.0}) != digest({"b": 1.0})


def test_circles_end() -> None:
    text = "def f(x): return x and f(x - 1)"
    assert digest(made(text)) == digest(made(text))


def test_what_differs_in_a_function_is_named() -> None:
    """A variable that it has caught, a global of its helper, its code: by name, value and place."""

    def caught(R: float) -> Callable[..., Any]:
        return lambda x: R * x

    one, other = (described(UserLaw(force=caught(r), name="pad")) for r in (1.0, 2.0))
    first, second = difference(one, other)
    assert first.startswith("force, its variable 'R' = 1.0 in <function <lambda>, line ")
    assert first.endswith("of test_alike.py>") and "'R' = 2.0" in second
    first, second = difference(*(described(made(HELPED, r=r)) for r in (1.0, 2.0)))
    assert first.startswith("its global 'help', its global 'r' = 1.0 in <function help, line 1 of <string>>")
    first, second = difference(described(made(LAW, r=1.0)), described(made(DEEP, r=1.0)))
    assert "<function f, line 1" in first and second.endswith("of other content,")
    assert difference(described(2), described(3)) == ("2", "3")
    assert difference(described(LogNormal("k", 1.0, cov=0.3)), described(None))[1] == "None"
    many = [np.arange(100.0), np.arange(100.0) + (np.arange(100) == 50)]
    assert difference(*(described(each) for each in many))[1].endswith(", of other content,")
