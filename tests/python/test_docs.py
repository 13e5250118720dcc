"""The examples of the documentation run as they stand."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[2] / "docs"


@pytest.mark.parametrize("page", ["contact.md", "parallel.md"])  # laws.md: test_user_laws; chaos_file.md: test_chaos_file
def test_examples(page: str) -> None:
    names: dict[str, object] = {"__name__": "docs"}
    blocks = re.findall(r"```python\n(.*?)```", (DOCS / page).read_text(), flags=re.S)
    assert blocks
    for block in blocks:
        exec(compile(block, page, "exec"), names)
