"""``index.html`` of a reproduction: statements, rules, figures beside what the paper says."""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass
from html import escape

from herringbone_sim.paper.checks import RULES
from herringbone_sim.paper.reproduction import Checked, Compared
from herringbone_sim.paper.scenarios import Scenario

CSS = """
:root { --ink: #22262c; --soft: #5d6570; --line: #dde1e6; --blue: #0072B2; --red: #D55E00; }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 1120px; padding: 40px 28px 64px; color: var(--ink);
  background: #fff; font: 15px/1.5 system-ui, "Segoe UI", "DejaVu Sans", sans-serif; }
h1 { font-size: 26px; margin: 0 0 4px; } h2 { font-size: 19px; margin: 46px 0 10px; }
h3 { font-size: 15px; margin: 26px 0 6px; }
p, li { max-width: 80ch; } .lead { color: var(--soft); margin: 0 0 18px; }
.scroll { overflow-x: auto; } table { border-collapse: collapse; font-size: 13px; width: 100%; }
th { text-align: left; font-weight: 600; color: var(--soft); vertical-align: bottom; }
th, td { padding: 4px 12px 4px 0; border-bottom: 1px solid var(--line); vertical-align: top; }
td.n, th.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
td.y { color: var(--blue); font-weight: 600; } td.x { color: var(--red); font-weight: 600; }
.pair { display: grid; grid-template-columns: minmax(0, 3fr) minmax(0, 2fr); gap: 26px;
  align-items: start; margin: 0 0 26px; }
.grid { display: grid; grid-template-columns: 1fr 1fr; gap: 18px; }
figure { margin: 0; } img { width: 100%; height: auto; }
figcaption, .small, footer { color: var(--soft); font-size: 13px; } ul { padding-left: 20px; }
footer { margin-top: 44px; border-top: 1px solid var(--line); padding-top: 12px; }
@media (max-width: 800px) { .pair, .grid { grid-template-columns: 1fr; } }
"""


@dataclass(frozen=True)
class Part:
    """What the page shows of one scenario.

    Attributes:
        scenario: which.
        figure: file name of the diagram, relative to the page.
        motions: (file name, caption) of the four-panel figures.
        raster: file name of the comparison of starts and steps; empty when there is none.
    """

    scenario: Scenario
    figure: str
    motions: tuple[tuple[str, str], ...]
    raster: str = ""


def page(
    facts: Sequence[str],
    parts: Sequence[Part],
    checked: Sequence[Checked],
    compared: Sequence[Compared],
) -> str:
    """The whole page; pictures are files beside it."""
    body = [
        "<h1>The paper's figures and statements, run again</h1>",
        f'<p class="lead">{escape("  ·  ".join(facts))}</p>',
        _summary(parts, checked),
        *(_scenario(part, checked, compared) for part in parts),
        "<h2>When a statement counts as right</h2>",
        _list(RULES),
        "<footer>Beside this page: statements.csv, dependence.csv, figures/. Misprints and open "
        "parameters of the paper, and how each was settled: docs/paper.md.</footer>",
    ]
    head = f'<meta charset="utf-8"><title>Reproduction</title><style>{CSS}</style>'
    return f'<!doctype html><html lang="en"><head>{head}</head><body>{"".join(body)}</body></html>'


def _summary(parts: Sequence[Part], checked: Sequence[Checked]) -> str:
    rows = [_count(f"{part.scenario.key}", part.scenario, checked) for part in parts]
    right = sum(one.obtained.ok for one in checked)
    return _table(
        ["", "scenario", "statements", "right"],
        [*rows, ["", "<b>all</b>", str(len(checked)), f"<b>{right}</b>"]],
        numeric=(2, 3),
    )


def _count(key: str, one: Scenario, checked: Sequence[Checked]) -> list[str]:
    own = [c for c in checked if c.statement.scenario == key]
    right = sum(c.obtained.ok for c in own)
    return [key, f"{escape(one.title)} ({escape(one.figure)})", str(len(own)), str(right)]


def _scenario(part: Part, checked: Sequence[Checked], compared: Sequence[Compared]) -> str:
    one = part.scenario
    below = ", largest exponent" if one.has_exponents else ""
    caption = (
        f"{one.figure}: motions published (hatched: implied) and obtained, section points of "
        f"x_sp_L{below}; dashed: the published boundaries"
    )
    motions = "".join(_figure(name, text) for name, text in part.motions)
    return "".join(
        [
            f"<h2>{one.key}: {escape(one.title)} ({escape(one.figure)})</h2>",
            f'<div class="pair">{_figure(part.figure, caption)}<div><h3>What the paper says</h3>',
            f"{_list(one.says)}</div></div>",
            _statements([c for c in checked if c.statement.scenario == one.key]),
            f'<h3>Single motions</h3><div class="grid">{motions}</div>' if motions else "",
            _dependence(part, compared),
        ]
    )


def _statements(checked: Sequence[Checked]) -> str:
    rows = [
        [
            escape(c.statement.text),
            escape(c.statement.published),
            escape(c.obtained.text),
            f"{c.obtained.error:+.3g}" if math.isfinite(c.obtained.error) else "–",
            "yes" if c.obtained.ok else "no",
        ]
        for c in checked
    ]
    return _table(["statement", "published", "obtained", "error", "right"], rows, numeric=(3,))


def _dependence(part: Part, compared: Sequence[Compared]) -> str:
    """Raster, and every boundary by every way."""
    own = [c for c in compared if c.wanted.scenario == part.scenario.key]
    if not own:
        return ""
    wanted = list(dict.fromkeys(c.wanted for c in own))
    by_way: dict[str, list[str]] = {}
    for one in own:
        by_way.setdefault(one.way, []).append(_place(one))
    rows = [[escape(way), *cells] for way, cells in by_way.items()]
    head = ["start, or step", *(f"{escape(w.text)} ({w.published})" for w in wanted)]
    caption = "Motions from other starts, by continuation, and by fixed steps over the kinks"
    return "".join(
        [
            "<h3>What it hangs on</h3>",
            _figure(part.raster, caption) if part.raster else "",
            _table(head, rows, numeric=range(1, len(head))),
            '<p class="small">Read off the sweeps; in brackets the shares of the two motions '
            "within 3 % of the range on either side, where they are not 100 %.</p>",
        ]
    )


def _place(one: Compared) -> str:
    found = one.found
    if not math.isfinite(found.at):
        return "no such edge"
    shares = (found.share_before, found.share_after)
    ragged = f" ({shares[0]:.0%}, {shares[1]:.0%})" if min(shares) < 1.0 else ""
    return f"{found.at:.4g}{ragged}"


def _figure(name: str, caption: str) -> str:
    text = escape(caption)
    return (
        f'<figure><img alt="{text}" src="{escape(name)}"><figcaption>{text}</figcaption></figure>'
    )


def _table(
    header: Sequence[str], rows: Iterable[Sequence[str]], numeric: Container[int] = ()
) -> str:
    def cells(tag: str, row: Sequence[str]) -> str:
        return "".join(f"<{tag}{_kind(i, c, numeric)}>{c}</{tag}>" for i, c in enumerate(row))

    lines = "".join(f"<tr>{cells('td', row)}</tr>" for row in rows)
    return f'<div class="scroll"><table><tr>{cells("th", header)}</tr>{lines}</table></div>'


def _kind(column: int, cell: str, numeric: Container[int]) -> str:
    kinds = {"yes": ' class="y"', "no": ' class="x"'}
    return kinds.get(cell) or (' class="n"' if column in numeric else "")


def _list(items: Sequence[str]) -> str:
    return f"<ul>{''.join(f'<li>{escape(item)}</li>' for item in items)}</ul>" if items else ""
