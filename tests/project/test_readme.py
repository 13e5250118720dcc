"""The README: its example runs as it stands and prints what is shown, and its links lead somewhere."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from tests.helpers import printed_as_shown

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text()


def test_example(capsys: pytest.CaptureFixture[str]) -> None:
    blocks = re.findall(r"```python\n(.*?)```\s*```\n(.*?)```", README, flags=re.S)
    assert len(blocks) == README.count("```python") == 1
    code, shown = blocks[0]
    assert len(code.splitlines()) <= 20
    exec(compile(code, "README.md", "exec"), {})
    printed_as_shown(capsys.readouterr().out, shown)


def test_its_two_commands_are_there() -> None:
    assert "./run test " in README and "./run demo " in README


def test_links_of_the_pages_lead_somewhere() -> None:
    """Of README and docs: every file that a link names is there."""
    for page in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")]:
        for target in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", page.read_text()):
            if not target.startswith(("http", "mailto")):
                assert (page.parent / target).exists(), f"{page.name}: {target}"
