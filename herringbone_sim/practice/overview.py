"""Main figures of several benches side by side, one row per bench."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain

import numpy as np

from herringbone_sim.practice.intervals import IntervalEstimate, bootstrap
from herringbone_sim.practice.score import METRICS, Metric, Outcomes, rows_of
from herringbone_sim.practice.stored import Bench
from herringbone_sim.practice.table import REACHED, markdown

COLUMNS = (
    "healthy called none",
    "right or in the named class",
    "both effects of a pair",
    "confident wrong names on unknown",
    "locus",
    "parameter error, median",
    "coverage of 90 % intervals",
)


def overview_markdown(benches: Mapping[str, Bench]) -> str:
    """Return a Markdown table of benches: ``COLUMNS`` with 95 % intervals, and median time.

    Figures are of healthy rigs and of rigs whose effects all reach d = 3; the last row is of all
    benches together.
    """
    rows = {name: (list(bench.cases), bench.durations_s) for name, bench in benches.items()}
    cases, durations = zip(*rows.values(), strict=True)
    rows["all"] = [case for some in cases for case in some], tuple(chain(*durations))
    metrics = [metric for metric in METRICS if metric.name in COLUMNS]
    lines = [[name, *_cells(*row, metrics)] for name, row in rows.items()]
    head = ["bench", "campaigns", "failed", *(m.name for m in metrics), "time of all, median [s]"]
    return "## Rigs of d >= 3: value (95 % interval; number)\n\n" + markdown(head, lines) + "\n"


def _cells(cases: Outcomes, durations_s: Sequence[float], metrics: Sequence[Metric]) -> list[str]:
    """Return the cells of a row: numbers of campaigns and of failed ones, figures, median time."""
    aimed = [case for case in cases if case.reached >= REACHED]
    failed = sum(bool(case.failed) for case in aimed)
    figures = [_cell(row.result, 3) for row in rows_of(aimed, "", metrics)]
    time = _cell(bootstrap(np.array(durations_s), np.median), 0)
    return [str(len(aimed)), str(failed), *figures, time]


def _cell(figure: IntervalEstimate, digits: int) -> str:
    """Return a value with its interval and number of cases as text, ``-`` without cases."""
    if not figure.n:
        return "-"
    value, low, high = (f"{v:.{digits}f}" for v in (figure.value, figure.low, figure.high))
    return f"{value} ({low} .. {high}; {figure.n})"
