"""``index.html`` of a reproduction: figures, published and obtained statements, rules."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from herringbone_sim.paper.boundaries import Boundary
from herringbone_sim.paper.checks import RULES
from herringbone_sim.paper.reproduction import CheckedStatement, Compared
from herringbone_sim.paper.scenarios import Scenario
from herringbone_sim.views.pages.html import Table, render

RIGHT = {True: ("yes", "y"), False: ("no", "x")}  # text and CSS class


@dataclass(frozen=True)
class ScenarioFigures:
    """Figures of one scenario, file names relative to the page.

    Attributes:
        scenario: published sweep.
        figure: bifurcation diagram.
        motions: (file name, caption) of the four-panel figures.
        raster: comparison of starts and step sizes; empty if there is none.
    """

    scenario: Scenario
    figure: str
    motions: tuple[tuple[str, str], ...]
    raster: str = ""


def page(
    facts: Sequence[str],
    parts: Sequence[ScenarioFigures],
    checked: Sequence[CheckedStatement],
    compared: Sequence[Compared],
) -> str:
    """Return the HTML of the page, which refers to pictures as files beside it.

    Args:
        facts: short texts for the head of the page.
        parts: figures of each scenario.
        checked: published statements with the results obtained.
        compared: boundaries obtained with other starts and step sizes; may be empty.
    """
    return render(
        "paper.html",
        title="Reproduction",
        facts=facts,
        summary=_summary(parts, checked),
        scenarios=[_scenario_values(part, checked, compared) for part in parts],
        rules=RULES,
    )


def _summary(parts: Sequence[ScenarioFigures], checked: Sequence[CheckedStatement]) -> Table:
    rows = [_count(part.scenario, checked) for part in parts]
    bold = Markup("<b>{}</b>").format
    right = sum(c.obtained.ok for c in checked)
    total = ["", bold("all"), str(len(checked)), bold(right)]
    return Table(["", "scenario", "statements", "right"], [*rows, total], numeric=(2, 3))


def _count(scenario: Scenario, checked: Sequence[CheckedStatement]) -> list[str]:
    own = [c for c in checked if c.statement.scenario == scenario.key]
    right = sum(c.obtained.ok for c in own)
    name = f"{scenario.title} ({scenario.figure})"
    return [scenario.key, name, str(len(own)), str(right)]


def _scenario_values(
    part: ScenarioFigures, checked: Sequence[CheckedStatement], compared: Sequence[Compared]
) -> dict[str, object]:
    """Return the template values of one scenario."""
    scenario = part.scenario
    below = ", largest exponent" if scenario.has_exponents else ""
    return {
        "title": f"{scenario.key}: {scenario.title} ({scenario.figure})",
        "figure": part.figure,
        "caption": f"{scenario.figure}: motions published (hatched: implied) and obtained, "
        f"section points of x_sp_L{below}; dashed: the published boundaries",
        "says": scenario.says,
        "statements": _statements([c for c in checked if c.statement.scenario == scenario.key]),
        "motions": part.motions,
        "raster": part.raster,
        "dependence": _dependence(part, compared),
    }


def _statements(checked: Sequence[CheckedStatement]) -> Table:
    rows = [
        [
            c.statement.text,
            c.statement.published,
            c.obtained.text,
            f"{c.obtained.error:+.3g}" if math.isfinite(c.obtained.error) else "–",
            RIGHT[c.obtained.ok][0],
        ]
        for c in checked
    ]
    classes = {(i, 4): RIGHT[c.obtained.ok][1] for i, c in enumerate(checked)}
    return Table(["statement", "published", "obtained", "error", "right"], rows, (3,), classes)


def _dependence(part: ScenarioFigures, compared: Sequence[Compared]) -> Table | None:
    """Return the table of a scenario's boundaries by start and step size; None if not compared."""
    own = [c for c in compared if c.statement.scenario == part.scenario.key]
    if not own:
        return None
    wanted = list(dict.fromkeys(c.statement for c in own))
    by_way: dict[str, list[str]] = {}
    for c in own:
        by_way.setdefault(c.way, []).append(_boundary_text(c.boundary))
    rows = [[way, *cells] for way, cells in by_way.items()]
    head = ["start, or step", *(f"{w.text} ({w.published})" for w in wanted)]
    return Table(head, rows, numeric=range(1, len(head)))


def _boundary_text(boundary: Boundary) -> str:
    if not math.isfinite(boundary.at):
        return "no such edge"
    shares = (boundary.share_before, boundary.share_after)
    ragged = f" ({shares[0]:.0%}, {shares[1]:.0%})" if min(shares) < 1.0 else ""
    return f"{boundary.at:.4g}{ragged}"
