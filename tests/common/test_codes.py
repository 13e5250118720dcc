"""Functions are told apart by what they do, not by their names."""

from __future__ import annotations

import functools
import math
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dolfinx_frontend import SceneError
from dolfinx_frontend.common import codes
from dolfinx_frontend.common.codes import code_digest

NAMES = """
import math
import numpy as np

class Spring:
    def __init__(self, k):
        self.k = k
    def __call__(self, x):
        return self.k * x

"""


def made(text: str) -> Any:
    """The function f of a script."""
    names: dict[str, Any] = {"__name__": "__main__"}
    exec(NAMES + text, names)
    return names["f"]


def digest(value: Any) -> str:
    return code_digest(value, "f")


DATA = """
import abc, dataclasses
class Base(abc.ABC):
    @abc.abstractmethod
    def __call__(self, x): ...
@dataclasses.dataclass
class Data(Base):
    k: float
    more: list = dataclasses.field(default_factory=list)
    def __call__(self, x):
        return self.k * x
"""
KIND = """
import enum
class Kind(enum.Enum):
    SOFT = 1
    HARD = 2
"""

SAME = [
    ("f = lambda x: 2 * x", "f = lambda x: 2 * x"),
    ("def f(x):\n    return 2 * x", "\n\n# further down\ndef f(x):\n    # said\n    return 2 * x"),
    ("f = Spring(2.0)", "f = Spring(2.0)"),
    ("def f(x):\n    return np.max(x)", "def f(x):\n    return np.max(x)\n\nunused = 3"),
    (DATA + "f = Data(1.0, [1, 2])", DATA + "f = Data(1.0, [1, 2])"),
    (KIND + "f = Kind.SOFT", KIND + "f = Kind.SOFT"),
]
DIFFERENT = [
    ("f = lambda x: 2 * x", "f = lambda x: 3 * x"),
    ("f = lambda x: x[..., 0]", "f = lambda x: x[..., 1]"),
    ("f = lambda x: x.max()", "f = lambda x: x.min()"),
    ("f = lambda x, a=1: a * x", "f = lambda x, a=2: a * x"),
    ("f = lambda x, *, a=1: a * x", "f = lambda x, *, a=2: a * x"),
    ("k = 1\nf = lambda x: k * x", "k = 2\nf = lambda x: k * x"),
    ("k = np.zeros(3)\nf = lambda x: k * x", "k = np.ones(3)\nf = lambda x: k * x"),
    (
        "def g(x):\n    return x\ndef f(x):\n    return [g(y) for y in x]",
        "def g(x):\n    return -x\ndef f(x):\n    return [g(y) for y in x]",
    ),
    ("def f(x):\n    return np.max(x)", "def f(x):\n    return np.min(x)"),
    ("f = Spring(2.0)", "f = Spring(3.0)"),
    ("f = Spring(2.0).__call__", "f = Spring(3.0).__call__"),
    ("f = Spring(2.0)", "Spring.__call__ = lambda self, x: x\nf = Spring(2.0)"),
    ("def h(a):\n    return lambda x: a * x\nf = h(1)", "def h(a):\n    return lambda x: a * x\nf = h(2)"),
    ("def f(x):\n    return (lambda y: y + 1)(x)", "def f(x):\n    return (lambda y: y + 2)(x)"),
    ("def f(x):\n    return x in {1, 2}", "def f(x):\n    return x in {1, 3}"),
    ("def f(x):\n    try:\n        return g\n    finally:\n        return x", "def f(x):\n    return x"),
    (
        "import functools\n@functools.lru_cache\ndef f(x):\n    return x",
        "import functools\n@functools.lru_cache\ndef f(x):\n    return -x",
    ),
    (
        "import functools\nW = lambda g: functools.wraps(g)(lambda x: g(x))\n@W\ndef f(x):\n    return x",
        "import functools\nW = lambda g: functools.wraps(g)(lambda x: g(x))\n@W\ndef f(x):\n    return -x",
    ),
    (DATA + "f = Data(1.0, [1, 2])", DATA + "f = Data(1.0, [1, 3])"),
    (DATA + "f = Data(1.0, [1, 2])", DATA.replace("self.k", "2 * self.k") + "f = Data(1.0, [1, 2])"),
    (KIND + "f = Kind.SOFT", KIND + "f = Kind.HARD"),
    ("f = abs", "f = max"),
    ("f = np.sin", "f = np.cos"),
    ("f = math.sin", "f = math.cos"),
]


@pytest.mark.parametrize(("one", "other"), SAME)
def test_the_same(one: str, other: str) -> None:
    assert digest(made(one)) == digest(made(other))


@pytest.mark.parametrize(("one", "other"), DIFFERENT)
def test_another(one: str, other: str) -> None:
    assert digest(made(one)) != digest(made(other))


def test_other_ways_to_make_a_function() -> None:
    assert digest(functools.partial(max, 1)) != digest(functools.partial(max, 2))
    assert digest(functools.partial(max, 1)) == digest(functools.partial(max, 1))
    assert digest(np.random.default_rng(0)) != digest(np.random.default_rng(1))
    assert digest({"a": [1, 2]}) != digest({"a": [1, 3]})
    assert digest({3, 1, 2}) == digest({1, 2, 3})
    assert digest(math) != digest(np)


def test_functions_that_call_themselves() -> None:
    text = "def f(x):\n    return {} if x < 1 else f(x - 1)"
    assert digest(made(text.format(1))) == digest(made(text.format(1))) != digest(made(text.format(2)))


def test_functions_of_a_users_module(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is taken from it counts, what else is in it does not."""

    def module(k: int, other: int) -> Callable[[float], float]:
        helpers = types.ModuleType("helpers_of_a_user")
        exec(f"k = {k}\nother = {other}\ndef g(x):\n    return k * x", helpers.__dict__)
        monkeypatch.setitem(__import__("sys").modules, "helpers_of_a_user", helpers)
        names = {"helpers": helpers, "__name__": "__main__"}
        exec("def f(x):\n    return helpers.g(x)", names)
        function: Callable[[float], float] = names["f"]  # type: ignore[assignment]
        return function

    assert digest(module(1, 1)) == digest(module(1, 2)) != digest(module(2, 1))


def test_what_cannot_be_told_apart_is_refused() -> None:
    lock = __import__("threading").Lock()
    with pytest.raises(SceneError, match=r"output 'q', its variable 'lock': a lock cannot be told apart"):
        code_digest(lambda x: (lock, x), "output 'q'")


def test_attributes_of_a_function_tell_it_apart() -> None:
    def scaled(x: float) -> float:
        return x * scaled.factor  # type: ignore[attr-defined, no-any-return]

    scaled.factor = 2.0  # type: ignore[attr-defined]
    before = code_digest(scaled, "f")
    assert code_digest(scaled, "f") == before
    scaled.factor = 3.0  # type: ignore[attr-defined]
    assert code_digest(scaled, "f") != before


def test_a_module_that_a_function_imports_itself_counts_by_its_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))

    def late() -> float:
        import late_settings  # type: ignore[import-not-found]

        return late_settings.factor  # type: ignore[no-any-return]

    def digest_of(text: str) -> str:
        (tmp_path / "late_settings.py").write_text(text)
        codes._file_digest.cache_clear()
        return codes.code_digest(late, "f")

    assert digest_of("factor = 2.0\n") == digest_of("factor = 2.0\n") != digest_of("factor = 3.0\n")
