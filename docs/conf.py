"""Sphinx settings; `./run docs` builds into build/docs, warnings are errors."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
with (ROOT / "pyproject.toml").open("rb") as file:
    release = tomllib.load(file)["project"]["version"]

project = "latin-core"
author = "the latin-core developers"
project_copyright = author
version = release

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.mathjax", "sphinx.ext.napoleon"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["figures"]
myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 3

html_theme = "furo"
html_title = f"latin-core {release}"
html_show_sourcelink = False

autodoc_default_options = {"members": True, "show-inheritance": True}
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
python_maximum_signature_line_length = 90
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
# generics, overloads and private names of annotations have no page to link to
nitpicky = False

_LITERAL = re.compile(r"(``.*?``|:\w+:`[^`]*`|`[^`]*`)")


def _plain(line: str) -> str:
    """A line of a docstring whose bars, stars and trailing underscores are no markup."""
    parts = _LITERAL.split(line)
    for k in range(0, len(parts), 2):
        part = re.sub(r"(?<!\\)([|*])", r"\\\1", parts[k])
        parts[k] = re.sub(r"(?<=\w)_(?=\W|$)", r"\\_", part)
    return "".join(parts)


def _escape(app, what, name, obj, options, lines):  # type: ignore[no-untyped-def]
    """Docstrings are plain text with mathematics in it, |f_t| <= mu |f_n|: not RST's substitutions."""
    code = False
    for k, line in enumerate(lines):
        stripped = line.lstrip()
        if code and stripped and not line.startswith(" "):
            code = False
        if stripped.startswith(">>>"):
            continue
        if not code:
            lines[k] = _plain(line)
        if stripped.endswith("::"):
            code = True


def setup(app):  # type: ignore[no-untyped-def]
    """Before napoleon, which turns sections into fields."""
    app.connect("autodoc-process-docstring", _escape, priority=100)
