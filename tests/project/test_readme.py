"""The example of the README runs as it stands."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

README = Path(__file__).resolve().parents[2] / "README.md"


def test_example(capsys: pytest.CaptureFixture[str]) -> None:
    blocks = re.findall(r"```python\n(.*?)```", README.read_text(), flags=re.S)
    assert len(blocks) == 1
    assert len(blocks[0].splitlines()) <= 30
    exec(compile(blocks[0], str(README), "exec"), {})
    shown = capsys.readouterr().out
    assert all(word in shown for word in ("converged", "(95 %)", "Mat"))
