"""Sphinx settings; `./run docs` builds into build/docs, warnings are errors."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

from docutils.nodes import SkipNode
from docutils.utils.math import latex2mathml

ROOT = Path(__file__).resolve().parents[1]
with (ROOT / "pyproject.toml").open("rb") as file:
    release = tomllib.load(file)["project"]["version"]

project = "latin-core"
author = "the latin-core developers"
project_copyright = author
version = release

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["figures"]
myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 3

highlight_language = "none"
html_math_renderer = "mathml"
html_theme = "furo"
html_theme_options = {"light_css_variables": {"code-font-size": "0.74rem"}}
html_title = f"latin-core {release}"
html_show_sourcelink = False

autodoc_default_options = {"members": True, "show-inheritance": True}
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
autodoc_type_aliases = {"Array": "Array", "npt.ArrayLike": "ArrayLike", "Value": "Value"}
python_maximum_signature_line_length = 90
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
napoleon_attr_annotations = False  # they are in the signature; "numpy.str_" would be a link
# one class name in two packages
suppress_warnings = ["ref.python"]

_LITERAL = re.compile(r"(``.*?``|:\w+:`[^`]*`|`[^`]*`|(?<!\w)\*\w[\w ]*\*(?!\w))")
_COLON = "\ue000"  # stands for a colon while napoleon reads
_BULLET = re.compile(r"\s*\* ")


def _plain(line: str) -> str:
    """A line of a docstring whose bars, lone stars and trailing underscores are no markup."""
    bullet = _BULLET.match(line)
    start = bullet.end() if bullet else 0
    parts = _LITERAL.split(line[start:])
    for k in range(0, len(parts), 2):
        part = re.sub(r"(?<!\\)(\||\*(?! )|(?<! )\*)", r"\\\1", parts[k])
        parts[k] = re.sub(r"(?<=\w)_(?=\W|$)", r"\\_", part)
    return line[:start] + "".join(parts)


def _escape(app, what, name, obj, options, lines):  # type: ignore[no-untyped-def]
    """Docstrings have mathematics in them, |f_t| <= mu |f_n|, which is no substitution of RST's."""
    code = table = False
    for k, line in enumerate(lines):
        stripped = line.strip()
        if stripped.startswith("===="):  # the last rule of a table is followed by an empty line
            table = k + 1 < len(lines) and bool(lines[k + 1].strip())
            continue
        if code and stripped and not line.startswith(" "):
            code = False
        if not (code or table or stripped.startswith(">>>")):
            lines[k] = _plain(line)
        if stripped.endswith("::"):
            code = True
    if what in ("attribute", "data", "property") and lines:
        # napoleon takes what comes before a colon in the first line for a type
        lines[0] = lines[0].replace(": ", _COLON)


def _restore(app, what, name, obj, options, lines):  # type: ignore[no-untyped-def]
    lines[:] = [line.replace(_COLON, ": ") for line in lines]


def _signature(app, what, name, obj, options, signature, annotation):  # type: ignore[no-untyped-def]
    """Defaults that are no Python keep a signature from being parsed."""
    return (signature or "").replace("<factory>", "...") or signature, annotation


def _formula(display):  # type: ignore[no-untyped-def]
    """A renderer of formulas as MathML, which browsers show without scripts from elsewhere."""

    def visit(translator, node):  # type: ignore[no-untyped-def]
        translator.body.append(latex2mathml.tex2mathml(node.astext().strip(), as_block=display))
        raise SkipNode

    return visit, None


def _skip(app, what, name, obj, skip, options):  # type: ignore[no-untyped-def]
    """Fields of named tuples, which are in the signature, have no text of their own."""
    return True if type(obj).__name__ == "_tuplegetter" else None


def setup(app):  # type: ignore[no-untyped-def]
    """Around napoleon, which turns sections into fields."""
    app.connect("autodoc-process-docstring", _escape, priority=100)
    app.connect("autodoc-process-docstring", _restore, priority=900)
    app.connect("autodoc-process-signature", _signature)
    app.connect("autodoc-skip-member", _skip)
    app.add_html_math_renderer("mathml", _formula(False), _formula(True))
