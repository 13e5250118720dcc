"""The answer sheet as one HTML file that needs nothing else."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from html import escape
from typing import NamedTuple

__all__ = ["Cell", "figure", "listing", "number", "page", "paragraph", "rich", "symbol", "table"]

_SYMBOL = re.compile(r"\b([A-Za-zσ])_([A-Za-z]+(?: max| min| mean)?)")

_STYLE = """
:root{--red:#c2410c;--ok:#15803d;--line:#d4d9df;--grey:#5f6b7a}
body{font:14px/1.4 system-ui,-apple-system,"Segoe UI","DejaVu Sans",Arial,sans-serif;
color:#16202c;max-width:88em;margin:1.5em auto;padding:0 1.2em}
h1{font-size:1.6em;margin:0}h2{font-size:1.15em;margin:1.8em 0 .5em;border-bottom:2px solid var(--line)}
h3{font-size:1em;margin:1.2em 0 .3em}
.sub,.note,.err{color:var(--grey)}.sub{margin:.2em 0 1em}
.err{font-size:.78em;display:block;white-space:pre}
.low{display:block;font-size:.82em;color:#394656;white-space:nowrap}
.verdict{border-left:6px solid var(--ok);background:#f1f8f3;padding:.7em 1em;margin:.5em 0;font-size:1.12em}
.verdict.bad{border-color:var(--red);background:#fdf1ea}
.verdict.plain{border-color:var(--grey);background:#f4f6f8}
table{border-collapse:collapse;margin:.4em 0;font-variant-numeric:tabular-nums}
.wide{overflow-x:auto}
th,td{border-bottom:1px solid var(--line);padding:.25em .5em;text-align:right;vertical-align:top}
th{white-space:nowrap;background:#eef1f4;border-bottom:2px solid #b9c2cc;font-weight:600}
td.l,th.l{text-align:left}td.n{white-space:nowrap}
tr.weak td{background:#fde3d3}tr.weak td.l{font-weight:700}
tr.head td{background:#f4f6f8;font-weight:600;text-align:left}
.fail{color:var(--red);font-weight:700}
figure{margin:.8em 0;display:inline-block;max-width:49%;vertical-align:top}
figure img,figure canvas{max-width:100%;height:auto}figcaption{color:var(--grey);font-size:.9em}
pre{background:#f4f6f8;padding:.8em;overflow-x:auto;font-size:.8em;white-space:pre-wrap}
@media print{body{margin:0;max-width:none;font-size:10px}.wide{overflow:visible}
h2{break-after:avoid}tr,figure,.verdict{break-inside:avoid}
thead{display:table-header-group}
*{print-color-adjust:exact;-webkit-print-color-adjust:exact}@page{size:A4 landscape;margin:12mm}}
@media screen and (max-width:60em){figure{max-width:100%}}
"""


class Cell(NamedTuple):
    """A cell: what it says, and below it, smaller, more and errors; plain text."""

    text: str
    more: str = ""
    error: str = ""
    left: bool = False
    fails: bool = False
    ours: bool = False  # with symbols


def number(value: float, zero: float = 0.0) -> str:
    """A number in four digits; thousands are apart."""
    if math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    if abs(value) <= zero:
        return "0"
    power = math.floor(math.log10(abs(value)))
    if power < -4 or power > 7:
        mantissa, exponent = f"{value:.3e}".split("e")
        return f"{mantissa}·10^{int(exponent)}".replace("-", "−")
    rounded = round(value, 3 - power)
    return f"{rounded:,.{max(3 - power, 0)}f}".replace(",", "\u202f").replace("-", "−")


def symbol(text: str) -> str:
    """HTML of a symbol: what follows ``_`` is an index."""
    return rich(text) if "_" in text else f"<i>{escape(text)}</i>"


def rich(text: str) -> str:
    """HTML of our own words, with the symbols in them."""
    return _SYMBOL.sub(r"<i>\1</i><sub>\2</sub>", escape(text))


def table(
    head: Sequence[str], rows: Iterable[Sequence[Cell] | str], weak: int | None = None, left: int = 1
) -> str:
    """A table; `head` is HTML, a row that is a text is a heading, `weak` is the row that stands out."""
    parts = ["<div class='wide'><table><thead><tr>"]
    parts += [f"<th class='l'>{h}</th>" if k < left else f"<th>{h}</th>" for k, h in enumerate(head)]
    parts.append("</tr></thead><tbody>")
    for number_, row in enumerate(rows):
        if isinstance(row, str):
            parts.append(f"<tr class='head'><td colspan='{len(head)}'>{escape(row)}</td></tr>")
            continue
        parts.append("<tr class='weak'>" if number_ == weak else "<tr>")
        parts += [_cell(each, k < left or each.left) for k, each in enumerate(row)]
        parts.append("</tr>")
    return "".join([*parts, "</tbody></table></div>"])


def _cell(cell: Cell, left: bool) -> str:
    kinds = [k for k, wanted in (("l", left), ("fail", cell.fails), ("n", not left)) if wanted]
    text = rich(cell.text) if cell.ours else escape(cell.text)
    start = f"<td class='{' '.join(kinds)}'>" if kinds else "<td>"
    more = f"<span class='low'>{escape(cell.more)}</span>" if cell.more else ""
    error = f"<span class='err'>{escape(cell.error)}</span>" if cell.error else ""
    return f"{start}{text}{more}{error}</td>"


def paragraph(text: str, kind: str = "note") -> str:
    """Plain text as a paragraph."""
    return f"<p class='{kind}'>{escape(text)}</p>"


def listing(items: Iterable[str]) -> str:
    """HTML items as a list."""
    return "<ul>" + "".join(f"<li>{each}</li>" for each in items) + "</ul>"


def figure(title: str, data: str) -> str:
    """A picture, base64 of a PNG."""
    shown = escape(title)
    source = f"data:image/png;base64,{data}"
    return f"<figure><img src='{source}' alt='{shown}'><figcaption>{shown}</figcaption></figure>"


def page(title: str, parts: Iterable[str]) -> str:
    """The whole file."""
    return (
        "<!DOCTYPE html>\n<html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width,initial-scale=1'>"
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head><body>\n"
        + "\n".join(parts)
        + "\n</body></html>\n"
    )
