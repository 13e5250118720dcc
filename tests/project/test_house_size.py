"""What tools/house_size.py counts, by hand, and that its budget only falls."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tools"))

import house_size as tool  # noqa: E402

PYTHON = '''"""A module
of two lines."""
# no code

LIMIT = -1e-3  # 10, 0.5 and 2 decide nothing
TEXT = """

# code, for it is a string
"""


def f(x: float = 2.0) -> float:
    """Docstring, 7."""
    return 10 * x if True else 4 / 3
'''

CPP = """#pragma once
// no code
#include "a.hpp"  // 1.5
namespace a {
template <class T = int>
struct A : B<std::function<void(int)>> {
  A(int b) : b_{b}, c_(b) { d = {0.5, 1'000.5}; }
  std::string s{"f(7.5) { // no comment"};
 private:
  int size() const noexcept { return 0x10 + 3 + '7'; }
};
/* no
   code 2.5 */
auto f(std::vector<int> v = {}) -> std::vector<double> {
  if (v.empty()) {
    return {1e-12, 2.};
  }
  return g([](int i) { return 9 * i; });
}
}  // namespace a
"""


def test_python_by_hand() -> None:
    assert tool.python_counted(PYTHON) == tool.Counted(7, 2, 0, [3])


def test_cpp_by_hand() -> None:
    found = tool.cpp_counted(CPP)
    assert found == tool.Counted(17, 2, 2, [1, 1, 6])  # 1000.5, 1e-12; 0x10, 9
    assert tool.cpp_counted(CPP.replace("{ d = {0.5, 1'000.5}; }", "{\n}")).functions == [2, 1, 6]


def test_data_by_hand() -> None:
    assert tool.data_counted(b"# 5\na = [1, 0.25]\n\nb1 = 1e-3\n")[:2] == (2, 2)
    assert tool.data_counted(b"#define A 0.37\n#if B\n# 0.3\n#\n")[:2] == (2, 1)
    assert tool.data_counted(b"\xff" * 32)[:2] == (0, 4)


def test_chains_and_circles() -> None:
    arrows = {"a": {"b", "c"}, "b": {"d"}, "c": {"b"}, "e": set()}
    assert tool.longest(arrows) == 4
    arrows["d"] = {"c"}  # b, c and d are one link now
    assert sorted(map(sorted, tool.components(arrows))) == [["a"], ["b", "c", "d"], ["e"]]
    assert tool.longest(arrows) == 2


def write(root: Path, name: str, text: str) -> None:
    path = root / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def test_imports_are_followed(tmp_path: Path) -> None:
    """An arrow that points upward makes a circle, and does not lengthen the chain."""
    write(tmp_path, "dolfinx_frontend/scene/specs.py", "")
    write(tmp_path, "dolfinx_frontend/assembly/problem.py",
          "from ..scene import specs\ndef f():\n    from ..solvers import export\n")
    write(tmp_path, "dolfinx_frontend/solvers/export.py", "from dolfinx_frontend.assembly import problem\n")
    write(tmp_path, "latin_core/include/latin/common/a.hpp", '#include "latin/common/b.hpp"\n')
    write(tmp_path, "latin_core/include/latin/common/b.hpp", "")
    found = tool.measured(tmp_path)[tool.IMPORTS]
    assert found == {"import_chain": 3, "include_chain": 2, "circles": 2, "upward": 1}


def test_nothing_is_hidden(tmp_path: Path) -> None:
    """Neither in a folder at the top, nor behind a link, nor by importing at run time."""
    write(tmp_path, "dolfinx_frontend/scene/specs.py", 'import_module("dolfinx_frontend.solvers.export")\n')
    write(tmp_path, "dolfinx_frontend/solvers/export.py", "")
    write(tmp_path, "more/inside/a.py", "A = 7\n")
    write(tmp_path, "tests/b.py", "B = 7\n")
    found = tool.measured(tmp_path)
    assert found["more/inside"]["numbers"] == 1 and "tests" not in found
    assert found[tool.IMPORTS]["upward"] == 1
    (tmp_path / "dolfinx_frontend/scene/extra").symlink_to(tmp_path / "more")
    with pytest.raises(SystemExit, match="extra is a link"):
        tool.measured(tmp_path)


def test_budget_only_falls(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene, kernel = "dolfinx_frontend/scene/specs.py", "latin_core/program/main.cpp"
    budget = tmp_path / tool.BUDGET

    def run(*arguments: str) -> int:
        return tool.main([*arguments, str(tmp_path)])

    write(tmp_path, scene, "A = 7\nB = 8\n")
    write(tmp_path, kernel, "int main() {\n  return 7;\n}\n")
    write(tmp_path, str(tool.BUDGET), "")
    budget.unlink()
    assert run("--check") == 1  # no budget allows nothing
    assert run("--write") == 0
    assert run("--check") == 0
    first = budget.read_text()

    write(tmp_path, scene, "A = 7\nB = 8\nC = 9\n")
    write(tmp_path, "dolfinx_frontend/scene/data.toml", "a = 0.25\n")
    write(tmp_path, "latin_core/bindings/more.cpp", "".join(f"int f{k}();\n" for k in range(601)))
    capsys.readouterr()
    assert run("--check") == 1
    said = capsys.readouterr().out
    assert "dolfinx_frontend/scene: code 4, budget 2" in said
    assert "dolfinx_frontend/scene: numbers 4, budget 2" in said
    assert "latin_core/bindings: long_files 1, budget 0" in said
    assert "by hand in a commit of its own that says what it buys" in said
    assert run("--write") == 1
    assert budget.read_text() == first

    (tmp_path / "latin_core/bindings/more.cpp").unlink()
    (tmp_path / "dolfinx_frontend/scene/data.toml").unlink()
    write(tmp_path, scene, "A = 7\n")
    assert run("--write") == 0
    write(tmp_path, scene, "A = 7\nB = 8\n")
    assert run("--check") == 1
