"""Pages that need nothing but themselves: style, tables and figures as HTML text."""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

STYLE = """
:root{--ink:#1c2430;--soft:#5b6675;--line:#dde2e9;--ground:#f5f7fa;--card:#fff;--blue:#1f6fb2;
--red:#c8352b;--amber:#b26a00;--green:#1b7f4b}
*{box-sizing:border-box}
body{margin:0;background:var(--ground);color:var(--ink);font:15px/1.5 system-ui,"Segoe UI",
Roboto,"Helvetica Neue",Arial,sans-serif}
main{max-width:1180px;margin:0 auto;padding:28px 24px 60px}
header{margin-bottom:20px}
h1{font-size:27px;line-height:1.2;margin:0 0 4px}
h2{font-size:19px;margin:34px 0 10px}
h3{font-size:14px;margin:0 0 6px;font-weight:600}
p{margin:6px 0}
.sub,.note{color:var(--soft)}
.note{font-size:13px}
.card{background:var(--card);border:1px solid var(--line);border-radius:10px;padding:16px 18px;
margin:0 0 16px}
.verdict{border-left:6px solid var(--green)}
.verdict.look{border-left-color:#e39a1f}
.verdict b{font-size:17px}
.verdict ul{margin:6px 0 0;padding-left:20px}
.facts{display:grid;grid-template-columns:repeat(auto-fit,minmax(128px,1fr));gap:12px;
margin:0 0 16px}
.fact{background:var(--card);border:1px solid var(--line);border-radius:10px;padding:10px 14px}
.fact b{display:block;font-size:22px;line-height:1.25;font-variant-numeric:tabular-nums}
.fact span{color:var(--soft);font-size:13px}
.camera{display:grid;grid-template-columns:minmax(0,1.25fr) minmax(0,1fr);gap:8px 26px}
.camera>.wide{grid-column:1/-1}
@media (max-width:820px){.camera{grid-template-columns:1fr}}
figure{margin:0 0 8px}
.narrow svg{max-width:400px}
svg{display:block;width:100%;height:auto}
svg text{font:11px system-ui,"Segoe UI",Roboto,Arial,sans-serif;fill:var(--soft)}
.scroll{overflow-x:auto}
table{border-collapse:collapse;font-size:14px;font-variant-numeric:tabular-nums;width:100%}
th,td{padding:4px 10px;border-bottom:1px solid var(--line);text-align:right;white-space:nowrap}
th{color:var(--soft);font-weight:600;font-size:13px}
th:first-child,td:first-child,.l{text-align:left}
td.why{white-space:normal;text-align:left;color:var(--soft)}
tr:last-child td{border-bottom:0}
.off td{color:var(--soft)}
.bad{color:var(--red)}
details summary{cursor:pointer;font-weight:600}
pre{white-space:pre-wrap;word-break:break-word;font-size:12.5px;margin:8px 0 0}
@media print{body{background:#fff}.card,.fact{break-inside:avoid}}
"""


@dataclass(frozen=True)
class Cell:
    """A table's cell with a class of the style: ``l`` left, ``why`` a sentence, ``bad`` red."""

    text: str
    style: str = ""
    background: str = ""


@dataclass(frozen=True)
class Figure:
    """A drawing with its title and, below, what is to be seen in it."""

    title: str
    svg: str
    note: str = ""


def escape(text: Any) -> str:
    """Text as it may stand in HTML and SVG, in attributes too."""
    return html.escape(str(text), quote=True)


def page(title: str, body: str, style: str = "") -> str:
    """A whole page; ``style`` adds to the style of all pages."""
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{STYLE}{style}</style></head>\n"
        f"<body><main>\n{body}</main></body></html>\n"
    )


def table(
    header: Sequence[str | Cell],
    rows: Iterable[Sequence[str | Cell]],
    row_styles: Sequence[str] | None = None,
) -> str:
    """An HTML table; the first column to the left, the others to the right."""
    head = "".join(_cell(cell, "th") for cell in header)
    lines = []
    for number, row in enumerate(rows):
        style = row_styles[number] if row_styles else ""
        cells = "".join(_cell(cell, "td") for cell in row)
        lines.append(f'<tr class="{style}">{cells}</tr>' if style else f"<tr>{cells}</tr>")
    return (
        f'<div class="scroll"><table><thead><tr>{head}</tr></thead>\n<tbody>'
        + "\n".join(lines)
        + "</tbody></table></div>\n"
    )


def _cell(cell: str | Cell, tag: str) -> str:
    if isinstance(cell, str):
        return f"<{tag}>{escape(cell)}</{tag}>"
    style = f' class="{cell.style}"' if cell.style else ""
    colour = f' style="background:{cell.background}"' if cell.background else ""
    return f"<{tag}{style}{colour}>{escape(cell.text)}</{tag}>"


def facts(items: Mapping[str, str]) -> str:
    """Large numbers with what they are below."""
    boxes = [
        f'<div class="fact"><b>{escape(value)}</b><span>{escape(name)}</span></div>'
        for name, value in items.items()
    ]
    return f'<div class="facts">{"".join(boxes)}</div>\n'


def figure(title: str, svg: str, note: str = "", style: str = "") -> str:
    """A drawing with its title and a note below."""
    below = f'<p class="note">{escape(note)}</p>' if note else ""
    head = f'<figure class="{style}">' if style else "<figure>"
    above = f"<h3>{escape(title)}</h3>" if title else ""
    return f"{head}{above}{svg}{below}</figure>\n"


def number(value: float, sigma: float | None = None) -> str:
    """A value with as many digits as its standard deviation bears (two of that), else six.

    Examples
    --------
    >>> number(2640.1234, 0.31), number(-7.412e-7, 2.2e-8), number(0.0)
    ('2640.12', '-7.41e-07', '0')
    >>> number(12345.678, 250.0)
    '12346'
    """
    if not math.isfinite(value):
        return "-"
    if sigma is None or not math.isfinite(sigma) or sigma <= 0:
        return f"{value:.6g}"
    last = math.floor(math.log10(sigma)) - 1  # place of the sigma's second digit
    if abs(value) >= 1e-3 or (value == 0 and last > -6):
        return f"{value:.{max(0, -last)}f}"
    if value == 0:
        return "0"
    digits = math.floor(math.log10(abs(value))) - last
    return f"{value:.{max(0, digits)}e}"


def deviation(sigma: float) -> str:
    """A standard deviation with two digits.

    Examples
    --------
    >>> deviation(7e-6), deviation(0.065), deviation(12.3)
    ('7.0e-06', '0.065', '12')
    """
    return f"{sigma:.0f}" if sigma >= 10 else f"{sigma:#.2g}"


def count(value: int) -> str:
    """A whole number in groups of three.

    Examples
    --------
    >>> count(12345)
    '12 345'
    """
    return f"{value:,}".replace(",", "\u2009" if value >= 10_000_000 else " ")
