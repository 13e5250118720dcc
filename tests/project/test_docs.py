"""The examples of the documentation run as they stand, and its pages build."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import subprocess
import sys
from pathlib import Path

import make_bracket_step
import pytest

import dolfinx_frontend
from dolfinx_frontend.results.accuracy import remedy
from latin_core import STATUSES
from tests.helpers import printed_as_shown, shown_blocks

DOCS = Path(__file__).resolve().parents[2] / "docs"


# laws.md: test_user_laws; chaos_file.md: test_chaos_file; step.md: test_step
PAGES = [
    "axisymmetry.md",
    "bolts.md",
    "certificate.md",
    "contact.md",
    "decks.md",
    "loads.md",
    "parallel.md",
    "random_stiffness.md",
    "reliability.md",
    "report.md",
    "results.md",
    "running.md",
    "scatter.md",
    "scene.md",
    "start.md",
    "temperature.md",
]


PAGE, ALL = 3_000, 45_000
"""Words that a page, and all of them, may have."""
# pages that take long -> tests of what they show; test_examples_use_what_there_is sees names that are no more
LONG = {"report.md": "tests/sheets/test_report.py", "results.md": "tests/results/test_tables.py"}


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, marks=[pytest.mark.night(guard=LONG[page])] if page in LONG else [])
        for page in PAGES
    ],
)
def test_examples(page: str, capsys: pytest.CaptureFixture[str]) -> None:
    """They run, and print what the block behind them shows."""
    names: dict[str, object] = {"__name__": "docs"}
    blocks = re.findall(r"```python\n(.*?)```(?:\s*```\n(.*?)```)?", (DOCS / page).read_text(), flags=re.S)
    assert blocks
    for block, shown in blocks:
        capsys.readouterr()
        exec(compile(block, page, "exec"), names)
        printed_as_shown(capsys.readouterr().out, shown)


@pytest.mark.parametrize("page", PAGES)
def test_examples_use_what_there_is(page: str) -> None:
    """Names of the package in all examples, also in those of pages that run at night only."""
    found = 0
    for block in re.findall(r"```python\n(.*?)```", (DOCS / page).read_text(), flags=re.S):
        for node in ast.walk(ast.parse(block)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("dolfinx_frontend"):
                module = importlib.import_module(str(node.module))
                assert all(hasattr(module, each.name) for each in node.names), (page, node.module)
                found += len(node.names)
            elif isinstance(node, ast.Attribute) and ast.unparse(node.value) == "lf":
                assert hasattr(dolfinx_frontend, node.attr), (page, node.attr)
                found += 1
    assert found


def test_examples_of_the_kernel_page(capsys: pytest.CaptureFixture[str]) -> None:
    """They run and print what is said; the demo of its tutorial stays short."""
    demo = (DOCS.parent / "demos" / "raw_dolfinx.py").read_text().splitlines()
    page = (DOCS / "kernel.md").read_text()
    blocks = re.findall(r"```python\n(.*?)```", page, flags=re.S)
    assert demo.index("# [end]") < 120 and len(blocks) == 2
    for block in blocks:
        capsys.readouterr()
        exec(compile(block, "kernel.md", "exec"), {"__name__": "docs"})
        for line in capsys.readouterr().out.splitlines() if "print(" in block else ():
            assert f"    {line}\n" in page


def test_tutorial_of_the_kernel_shows_what_its_demo_prints(tmp_path: Path) -> None:
    page = (DOCS / "tutorials" / "raw_dolfinx.md").read_text()
    demo = DOCS.parent / "demos" / "raw_dolfinx.py"
    command = [sys.executable, str(demo), "--output", str(tmp_path)]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    shown = "\n".join(shown_blocks(page)).splitlines()
    numbers = re.compile(r"-?\d\.?\d*e[+-]?\d+")  # residuals: rounding, which differs
    assert [numbers.sub("#", line) for line in printed] == [numbers.sub("#", line) for line in shown]
    assert all(float(each) < 1e-8 for line in printed for each in numbers.findall(line))
    assert (tmp_path / "raw_dolfinx.png").exists() and (tmp_path / "raw_dolfinx_given.png").exists()


def test_pages_are_short() -> None:
    """Words (what has a letter or a digit in it: no bars of tables) of a page, and of all with the README."""
    pages = [DOCS.parent / "README.md", *DOCS.rglob("*.md")]
    words = {page: sum(any(map(str.isalnum, each)) for each in page.read_text().split()) for page in pages}
    longest = max(words, key=words.__getitem__)
    assert words[longest] <= PAGE, f"{longest.name} has {words[longest]} words: split it by its subject"
    assert sum(words.values()) <= ALL, f"{sum(words.values())} words: say each thing once, and link"


def test_every_public_name_is_in_the_reference() -> None:
    pages = "".join(page.read_text() for page in (DOCS / "api").glob("*.md"))
    documented = set(re.findall(r"automodule:: (\S+)", pages))
    for name in dolfinx_frontend.__all__:
        thing = getattr(dolfinx_frontend, name)
        module = thing.__name__ if inspect.ismodule(thing) else thing.__module__
        assert module in documented, f"{name} of {module}"


def test_every_public_name_has_a_task() -> None:
    named = set(re.findall(r"`(\w+)", (DOCS / "api" / "index.md").read_text()))
    assert set(dolfinx_frontend.__all__) - {"geometry"} <= named


def test_messages_are_those_of_the_code() -> None:
    """Every message of the page is in a text of the frontend, so that a search for it ends there."""
    found = []
    for file in Path(dolfinx_frontend.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.JoinedStr):
                parts = (v.value if isinstance(v, ast.Constant) else "#" for v in node.values)
                found.append("".join(map(str, parts)))
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                found.append(node.value)
    texts = "\n".join(found)
    messages = re.findall(r"^\| `([^`]+)`", (DOCS / "messages.md").read_text(), flags=re.M)
    assert len(messages) > 25
    for message in messages:
        assert all(piece in texts for piece in message.split(" ... ")), message


def test_tutorials_show_their_demos() -> None:
    """What a tutorial shows of a script stands there, and is readable where directives are not."""
    demos = "\n".join(demo.read_text() for demo in (DOCS.parent / "demos").glob("*.py"))
    shown = 0
    for page in sorted((DOCS / "tutorials").glob("*.md")):
        text = page.read_text()
        assert "{figure}" not in text and ":start-after:" not in text, page
        for block in re.findall(r"^```python\n(.*?)^```$", text, flags=re.M | re.S):
            if not block.startswith("import "):  # a script of its own
                assert block in demos, f"{page.name} shows what is in no demo:\n{block}"
                shown += 1
    assert shown > 10


@pytest.mark.night(guard="test_step.py: test_the_page_of_the_documentation")
def test_script_for_a_file_of_ones_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (DOCS / "tutorials" / "bracket.md").read_text()
    (script,) = re.findall(r"^```python\n(import .*?)^```$", text, flags=re.M | re.S)
    monkeypatch.chdir(tmp_path)
    make_bracket_step.make_bracket("bracket.step")
    exec(compile(script, "bracket.md", "exec"), {"__name__": "docs"})
    printed = capsys.readouterr().out
    assert "bracket|base " in printed and "P(slip) = " in printed and "bolt 2-|bolt 2+" in printed


def test_every_demo_is_a_tutorial() -> None:
    pages = "".join(page.read_text() for page in (DOCS / "tutorials").glob("*.md"))
    for demo in (DOCS.parent / "demos").glob("*.py"):
        assert f"demos/{demo.name}" in pages


@pytest.mark.night(guard="test_every_public_name_is_in_the_reference, test_tutorials_show_their_demos")
@pytest.mark.slow
def test_pages_build_without_warnings(tmp_path: Path) -> None:
    pytest.importorskip("sphinx")
    pytest.importorskip("myst_parser")
    pytest.importorskip("furo")
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html", "-d"]
    command += [str(tmp_path / "doctrees"), str(DOCS), str(tmp_path / "html")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "html" / "api" / "laws.html").read_text()
    assert 'id="dolfinx_frontend.scene.laws.contact.Contact"' in page and "|f_t| &lt;= mu |f_n| + tau" in page


def test_statuses_are_those_of_the_code() -> None:
    """The page has every status, from the best to the worst; a solution ends as the kernel says."""
    page = (DOCS / "statuses.md").read_text()
    rows = re.findall(r"^\| `(\w+)` \| (\w+) \| (\w+) \| .+ \| .+ \|$", page, re.M)
    assert tuple(status for status, _, _ in rows) == STATUSES
    root = DOCS.parent
    header = (root / "latin_core" / "include" / "latin" / "iteration" / "summary.hpp").read_text()
    enum = header.split("enum class Status {")[1].split("}")[0]
    of_kernel = set(re.findall(r"^  (\w+),? +///<", enum, re.M))
    assert {status for status, of_solution, _ in rows if of_solution == "yes"} == of_kernel - {"undetermined"}
    stub = (root / "latin_core" / "python" / "latin_core" / "_core.pyi").read_text()
    typed = re.search(r"^Status: TypeAlias = Literal\[(.*?)\]", stub, re.M | re.S)
    assert typed is not None and set(re.findall(r'"(\w+)"', typed[1])) == of_kernel
    assert {status for status, _, of_point in rows if of_point == "yes"} == set(STATUSES)
    assert all(bool(remedy(status)) == (status != "converged") for status in STATUSES)
