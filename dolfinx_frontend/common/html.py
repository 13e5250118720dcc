"""What notebooks show: texts as they are printed, and tables as tables."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

__all__ = ["Shown", "table"]


class Shown:
    """A class whose printed text notebooks show, in columns."""

    def _repr_html_(self) -> str:
        return f"<pre>{escape(str(self))}</pre>"


def table(
    names: Sequence[str], rows: Sequence[Sequence[str]], left: Sequence[bool], notes: Sequence[str]
) -> str:
    """A table, its columns to the left or the right, with notes below."""

    def line(cells: Sequence[str], tag: str) -> str:
        sides = ("left" if each else "right" for each in left)
        return "<tr>" + "".join(
            f'<{tag} style="text-align:{side}">{escape(cell)}</{tag}>'
            for cell, side in zip(cells, sides, strict=True)
        ) + "</tr>"

    body = "".join(line(row, "td") for row in rows)
    below = "".join(f"<br>{escape(note)}" for note in notes)
    return f"<table><thead>{line(names, 'th')}</thead><tbody>{body}</tbody></table><small>{below}</small>"
