"""`tools/mutants.py`: where operators apply, and where they do not."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tools"))

import mutants  # noqa: E402
import mutation  # noqa: E402

PYTHON = '''
"""Not 1e-3 < x, and not here."""
LIMIT: float = 1e-3
def f(a: Literal[1], x=[0], *, t=0.05):
    """x < 1."""
    assert a < 3 and not x
    if not a <= LIMIT or (x is None):  # a < b
        raise ValueError(f"{a - 1} < 0")
    é = "é"; y = -x[0] + min(a, 2.0)
    y -= x[1:]
    return a not in x and "a" + é and [1] + x and np.minimum(y, -1)
'''
CPP = '''
#include "latin/min.hpp"  // a < b
#define TWICE(x) x + x
template <int N, typename T> T f(const std::vector<T>& x, Index i) {
  static_assert(N < 3 && N > 0);
  for (Index k = 0; k < i + 1; ++k) {
    if (!x[k] || x[k + 1] <= 1e-9 * std::max<double>(a, -b)) { throw Error("a < b", a - b); }
  }
  /* a && b */ const auto text = "x" + name; auto g = [k](int j) { return -j - 1; };
  const char c = '<'; const double d = 1'000.0 + values.minCoeff() * 2.0 + R"(a < b)"[i];
  return a == b ? static_cast<T>(1) : x->y;
}
'''


def found(path: str, text: str) -> set[tuple[str, str, str]]:
    """Operator, old and new text of all sites; each mutant differs where it says."""
    sites = mutation.sites(path, text)
    for site in sites:
        assert text[site.begin : site.end] == site.old
        mutant = mutation.applied(site, text)
        assert mutant[: site.begin] == text[: site.begin]
        assert mutant[site.begin + len(site.new) :] == text[site.end :]
        if path.endswith(".py"):
            ast.parse(mutant)
    assert len({(each.begin, each.new) for each in sites}) == len(sites)
    return {(each.operator, each.old.strip(), each.new) for each in sites}


def test_python() -> None:
    assert found("a.py", PYTHON) == {
        ("tolerance", "1e-3", "0.01"),
        ("tolerance", "0.05", "0.5"),
        ("not", "not", ""),
        ("comparison", "<=", ">"),
        ("comparison", "is", "is not"),
        ("comparison", "not in", "in"),
        ("and-or", "or", "and"),
        ("and-or", "and", "or"),
        ("sign", "-", ""),
        ("sign", "+", "-"),
        ("sign", "-=", "+="),
        ("index", "0", "1"),
        ("index", "1", "2"),
        ("extreme", "min", "max"),
        ("extreme", "minimum", "maximum"),
    }


def test_cpp() -> None:
    assert found("a.cpp", CPP) == {
        ("not", "!", ""),
        ("index", "k", "k + 1"),
        ("and-or", "||", "&&"),
        ("comparison", "<=", ">"),
        ("comparison", "==", "!="),
        ("tolerance", "1e-9", "1e-08"),
        ("tolerance", "1'000.0", "10000.0"),
        ("extreme", "max", "min"),
        ("extreme", "minCoeff", "maxCoeff"),
        ("sign", "-", ""),
        ("sign", "-", "+"),
        ("sign", "+", "-"),
    }


@pytest.mark.parametrize("path", ["a.py", "a.cpp"])
def test_nothing_decides_in_comments_and_texts(path: str) -> None:
    text = {
        "a.py": '# a < b\n"""1e-3 and not"""\n',
        "a.cpp": "// a < b\n/* !a\n && b */\n#if A < 1\n#endif\n",
    }
    assert mutation.sites(path, text[path]) == []


def test_the_draw_is_repeatable_and_even() -> None:
    texts = {"k/a.cpp": CPP, "s/a.py": PYTHON}
    first, again = (mutation.drawn(texts, ["k", "s"], 10, seed=5) for _ in range(2))
    assert first == again and len(set(first.values())) == 10
    assert [each.path for each in first.values()] == ["k/a.cpp", "s/a.py"] * 5
    assert first != mutation.drawn(texts, ["k", "s"], 10, seed=6)
    everything = mutation.drawn(texts, ["k", "s"], 1000, seed=5)
    assert len(everything) == sum(len(mutation.sites(*each)) for each in texts.items())


def test_a_fault_is_found_again_where_its_line_stands() -> None:
    before = mutation.drawn({"k/a.cpp": CPP, "s/a.py": PYTHON}, ["k", "s"], 14, seed=5)
    otherwise = PYTHON.replace("if not a <= LIMIT", "if a <= LIMIT")
    moved = {"k/a.cpp": "int more = 0;\n" + CPP, "s/a.py": otherwise}
    after = mutation.drawn(moved, ["k", "s"], 14, seed=5, kept=list(before))
    gone = {mark for mark in before if "if not a <= LIMIT" in mark[2]}
    assert gone and gone.isdisjoint(after)
    assert set(before) - gone <= set(after) and len(after) == 14
    for mark, site in after.items():
        assert mutation.line_of(site, moved[mark[0]]) == mark[2]
        assert mutation.line_of(site, mutation.applied(site, moved[mark[0]])) == mark[3]


def test_equal_lines_have_marks_of_their_own() -> None:
    text = "def f(a, b):\n    a += 1\n    a += 1\n"
    assert [mark[-1] for mark in mutation.marks("a.py", text)] == [0, 1]


def test_every_folder_has_sites_and_tests_of_its_own() -> None:
    for folder in mutants.FOLDERS:
        path = min((ROOT / folder).glob("[a-z]*.cpp" if folder in mutants.KERNEL else "[a-z]*.py"))
        assert mutation.sites(path.name, path.read_text(encoding="utf-8"))
        name = str(path.relative_to(ROOT))
        own = mutants.cpp_filter(ROOT, name) if path.suffix == ".cpp" else mutants.python_tests(ROOT, name)
        assert own


def test_the_share_leaves_out_what_says_nothing() -> None:
    says_nothing = ["equivalent", "broken", "unjudged"]
    share, low, high = mutants.share_of(["killed", "killed", "killed", "survived", *says_nothing])
    assert (share, low, high) == pytest.approx((0.75, 0.3006, 0.9544), abs=1e-4)  # Wilson's for 3 of 4
    assert mutants.share_of(["broken"]) is None


def test_what_was_killed_must_not_survive() -> None:
    a, b, c = (("a.py", "sign", f"a + {k}", f"a - {k}", 0) for k in range(3))
    before = {a: "killed", b: "survived", c: "killed"}
    assert mutants.lost(before, {a: "killed", b: "survived"}) == []
    assert mutants.lost(before, {a: "survived", b: "killed", c: "broken"}) == [a]


def test_the_first_failure_is_named() -> None:
    pytest_says = "x\nFAILED tests/a/test_b.py::test_c - assert 1\nFAILED d"
    assert mutants.first_failure(pytest_says) == "tests/a/test_b.py::test_c"
    assert mutants.first_failure("[ RUN ]\n[  FAILED  ] Stepper.Ends (0 ms)\n") == "Stepper.Ends"


LAW = """
def positive(x):
    return x > 0

def unseen(x):
    return not x

def counted_down(x):
    while x:
        x -= 1
    return x
"""
TESTS = """
from law import counted_down, positive

def test_positive():
    assert positive(1)

def test_end():
    assert counted_down(3) == 0
"""


def project_of_a_law(root: Path, tests: str) -> mutants.Bench:
    """A project with a module of a sub-package and its tests, whose `run` calls this Python."""
    run = f'exec "{sys.executable}" -m pytest "$@"'
    for name, text in {
        "run": f"#!/bin/sh\nshift\nexport PYTHONPATH=dolfinx_frontend/uncertainty\n{run}\n",
        "dolfinx_frontend/uncertainty/law.py": LAW,
        "tests/uncertainty/test_law.py": tests,
    }.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    (root / "run").chmod(0o755)
    return mutants.Bench(root)


def test_seen_unseen_and_endless_faults(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LATIN_ENVIRONMENT", "any")
    monkeypatch.setattr(mutants, "LEAST_S", 1.0)
    bench = project_of_a_law(tmp_path, TESTS)
    name = "dolfinx_frontend/uncertainty/law.py"
    found = {site.operator: bench.judged(site) for site in mutation.sites(name, LAW)}
    assert found["comparison"] == ("killed", "tests/uncertainty/test_law.py::test_positive")
    assert found["not"] == ("survived", "")
    assert found["sign"][0] == "killed" and "longer" in found["sign"][1]
    assert (tmp_path / name).read_text() == LAW


def test_tests_that_fail_anyway_judge_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LATIN_ENVIRONMENT", "any")
    bench = project_of_a_law(tmp_path, TESTS + "    assert positive(-1)\n")
    [site, *_] = mutation.sites("dolfinx_frontend/uncertainty/law.py", LAW)
    assert bench.judged(site)[0] == "unjudged"
