"""``index.html`` of a reproduction: figures, published and obtained statements, rules."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from herringbone_sim.paper.boundaries import Boundary
from herringbone_sim.paper.checks import RULES
from herringbone_sim.paper.reproduction import Checked, Compared
from herringbone_sim.paper.scenarios import Scenario
from herringbone_sim.views.pages.html import bullets, figure_html, html_page, table

STYLE = """
:root { --red: #D55E00; } body { max-width: 1120px; }
h2 { font-size: 19px; margin: 46px 0 10px; } h3 { font-size: 15px; margin: 26px 0 6px; }
p, li { max-width: 80ch; } th, td { padding: 4px 12px 4px 0; vertical-align: top; }
td.y { color: var(--blue); font-weight: 600; } td.x { color: var(--red); font-weight: 600; }
.pair { display: grid; grid-template-columns: minmax(0, 3fr) minmax(0, 2fr); gap: 26px;
  align-items: start; margin: 0 0 26px; }
.grid { display: grid; grid-template-columns: 1fr 1fr; gap: 18px; }
figure { margin: 0; } img { max-width: none; } .small { color: var(--soft); font-size: 13px; }
@media (max-width: 800px) { .pair, .grid { grid-template-columns: 1fr; } }
"""
RIGHT = {True: ("yes", "y"), False: ("no", "x")}  # text and CSS class


@dataclass(frozen=True)
class ScenarioFigures:
    """Figures of one scenario, file names relative to the page.

    Attributes:
        scenario: published sweep.
        figure: bifurcation diagram.
        motions: (file name, caption) of the four-panel figures.
        raster: comparison of starts and steps; empty if there is none.
    """

    scenario: Scenario
    figure: str
    motions: tuple[tuple[str, str], ...]
    raster: str = ""


def page(
    facts: Sequence[str],
    parts: Sequence[ScenarioFigures],
    checked: Sequence[Checked],
    compared: Sequence[Compared],
) -> str:
    """The complete page; pictures are files beside it.

    Args:
        facts: short texts for its head.
        parts: figures by scenario.
        checked: statements and what was obtained.
        compared: boundaries by start and step; may be empty.
    """
    body = [
        "<h1>The paper's figures and statements, run again</h1>",
        f'<p class="lead">{escape("  ·  ".join(facts))}</p>',
        _summary(parts, checked),
        *(_scenario(part, checked, compared) for part in parts),
        "<h2>When a statement counts as right</h2>",
        bullets(RULES),
        "<footer>Beside this page: statements.csv, dependence.csv, figures/. Misprints and open "
        "parameters of the paper, and how each was settled: docs/paper.md.</footer>",
    ]
    return html_page("Reproduction", body, STYLE)


def _summary(parts: Sequence[ScenarioFigures], checked: Sequence[Checked]) -> str:
    rows = [_count(part.scenario, checked) for part in parts]
    right = sum(c.obtained.ok for c in checked)
    total = ["", "<b>all</b>", str(len(checked)), f"<b>{right}</b>"]
    return table(["", "scenario", "statements", "right"], [*rows, total], numeric=(2, 3))


def _count(scenario: Scenario, checked: Sequence[Checked]) -> list[str]:
    own = [c for c in checked if c.statement.scenario == scenario.key]
    right = sum(c.obtained.ok for c in own)
    name = f"{escape(scenario.title)} ({escape(scenario.figure)})"
    return [scenario.key, name, str(len(own)), str(right)]


def _scenario(
    part: ScenarioFigures, checked: Sequence[Checked], compared: Sequence[Compared]
) -> str:
    scenario = part.scenario
    below = ", largest exponent" if scenario.has_exponents else ""
    caption = (
        f"{scenario.figure}: motions published (hatched: implied) and obtained, section points of "
        f"x_sp_L{below}; dashed: the published boundaries"
    )
    motions = "".join(figure_html(name, text) for name, text in part.motions)
    return "".join(
        [
            f"<h2>{scenario.key}: {escape(scenario.title)} ({escape(scenario.figure)})</h2>",
            f'<div class="pair">{figure_html(part.figure, caption)}',
            f"<div><h3>What the paper says</h3>{bullets(scenario.says)}</div></div>",
            _statements([c for c in checked if c.statement.scenario == scenario.key]),
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
            RIGHT[c.obtained.ok][0],
        ]
        for c in checked
    ]
    classes = {(i, 4): RIGHT[c.obtained.ok][1] for i, c in enumerate(checked)}
    head = ["statement", "published", "obtained", "error", "right"]
    return table(head, rows, numeric=(3,), classes=classes)


def _dependence(part: ScenarioFigures, compared: Sequence[Compared]) -> str:
    """Motions and boundaries of a scenario by each start and step; empty if none were compared."""
    own = [c for c in compared if c.statement.scenario == part.scenario.key]
    if not own:
        return ""
    wanted = list(dict.fromkeys(c.statement for c in own))
    by_way: dict[str, list[str]] = {}
    for c in own:
        by_way.setdefault(c.way, []).append(_boundary_text(c.boundary))
    rows = [[escape(way), *cells] for way, cells in by_way.items()]
    head = ["start, or step", *(f"{escape(w.text)} ({w.published})" for w in wanted)]
    caption = "Motions from other starts, by continuation, and by fixed steps over the kinks"
    return "".join(
        [
            "<h3>Dependence on start and step</h3>",
            figure_html(part.raster, caption) if part.raster else "",
            table(head, rows, numeric=range(1, len(head))),
            '<p class="small">Read off the sweeps; in brackets the shares of the two motions '
            "within 3 % of the range on either side, where they are not 100 %.</p>",
        ]
    )


def _boundary_text(boundary: Boundary) -> str:
    if not math.isfinite(boundary.at):
        return "no such edge"
    shares = (boundary.share_before, boundary.share_after)
    ragged = f" ({shares[0]:.0%}, {shares[1]:.0%})" if min(shares) < 1.0 else ""
    return f"{boundary.at:.4g}{ragged}"
