"""Parts that all HTML pages share: the page around its content, tables, lists, pictures.

Texts are inserted as they are, so callers escape what comes from outside; ``bullets``, ``section``
with its title, and ``picture_html`` escape or fix their texts themselves.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

CSS = """
:root { --ink: #22262c; --soft: #5d6570; --line: #dde1e6; --wash: #f6f7f9; --blue: #0072B2; }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 1060px; padding: 40px 28px 64px; color: var(--ink);
  background: #fff; font: 15px/1.5 system-ui, "Segoe UI", "DejaVu Sans", sans-serif; }
h1 { font-size: 26px; margin: 0 0 4px; } h2 { font-size: 17px; margin: 38px 0 10px; }
p, li { max-width: 76ch; } .lead { color: var(--soft); margin: 0 0 18px; }
.scroll { overflow-x: auto; } table { border-collapse: collapse; font-size: 13px; width: 100%; }
th { text-align: left; font-weight: 600; color: var(--soft); vertical-align: bottom; }
th, td { padding: 5px 10px 5px 0; border-bottom: 1px solid var(--line); }
td.n, th.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
td.why { color: var(--soft); font-size: 12px; min-width: 15ch; }
b.chaos { color: #D55E00; } b.periodic { color: var(--blue); }
figure { margin: 0 0 22px; } img { width: 100%; max-width: 980px; height: auto; }
figcaption, footer { color: var(--soft); font-size: 13px; } ul { padding-left: 20px; }
footer { margin-top: 44px; border-top: 1px solid var(--line); padding-top: 12px; }
"""


@dataclass(frozen=True)
class Picture:
    """A PNG file and its caption."""

    path: Path
    caption: str


def html_page(title: str, body: Iterable[str], style: str = "") -> str:
    """A complete page.

    Args:
        title: plain text.
        body: HTML.
        style: CSS after that of all pages.
    """
    head = f'<meta charset="utf-8"><title>{escape(title)}</title><style>{CSS}{style}</style>'
    return f'<!doctype html><html lang="en"><head>{head}</head><body>{"".join(body)}</body></html>'


def section(title: str, content: str) -> str:
    """Content under a heading; empty if there is no content."""
    return f"<h2>{title}</h2>{content}" if content else ""


def table(
    head: Sequence[str],
    rows: Iterable[Sequence[str]],
    numeric: Container[int] = (),
    classes: Mapping[tuple[int, int], str] | None = None,
) -> str:
    """A table that scrolls sideways.

    Args:
        head, rows: cells as HTML.
        numeric: columns that are set flush right.
        classes: further CSS classes of cells, by row and column.
    """

    def line(tag: str, cells: Sequence[str], row: int = -1) -> str:
        parts = []
        for column, cell in enumerate(cells):
            names = ["n"] if column in numeric else []
            names += [classes[row, column]] if classes and (row, column) in classes else []
            kind = f' class="{" ".join(names)}"' if names else ""
            parts.append(f"<{tag}{kind}>{cell}</{tag}>")
        return f"<tr>{''.join(parts)}</tr>"

    lines = "".join(line("td", cells, row) for row, cells in enumerate(rows))
    return f'<div class="scroll"><table>{line("th", head)}{lines}</table></div>'


def bullets(items: Iterable[str]) -> str:
    """A list of plain texts; empty without any."""
    lines = "".join(f"<li>{escape(item)}</li>" for item in items)
    return f"<ul>{lines}</ul>" if lines else ""


def folded(title: str, content: str) -> str:
    """Content that a reader unfolds."""
    return f"<details><summary>{title}</summary>{content}</details>"


def picture_html(picture: Picture) -> str:
    """A picture with its caption; the PNG is part of the page."""
    data = base64.b64encode(picture.path.read_bytes()).decode()
    return figure_html(f"data:image/png;base64,{data}", picture.caption)


def figure_html(source: str, caption: str) -> str:
    """An image from a URL or a file beside the page, with its caption."""
    text = escape(caption)
    image = f'<img alt="{text}" src="{escape(source)}">'
    return f"<figure>{image}<figcaption>{text}</figcaption></figure>"


def number(value: float, digits: int = 6) -> str:
    """A number with some significant digits; a dash for one that is not finite."""
    return f"{value:.{digits}g}" if math.isfinite(value) else "–"
