"""Main figures of several benches side by side, a row each."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from herringbone_sim.practice.intervals import IntervalEstimate, bootstrap
from herringbone_sim.practice.score import METRICS, rows_of
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
    """Table of benches by name: value, 95 % interval and number of each of ``COLUMNS``; time.

    Of rigs whose effects all reach d = 3, and of healthy ones.
    """
    metrics = [metric for metric in METRICS if metric.name in COLUMNS]
    lines = []
    for name, bench in benches.items():
        aimed = [case for case in bench.cases if case.reached >= REACHED]
        figures = [row.result for row in rows_of(aimed, name, metrics)]
        figures.append(bootstrap(np.array(bench.durations_s), np.median))
        failed = sum(bool(case.failed) for case in aimed)
        texts = [_cell(one, 3) for one in figures[:-1]] + [_cell(figures[-1], 0)]
        lines.append([name, str(len(aimed)), str(failed), *texts])
    head = ["bench", "campaigns", "failed", *(m.name for m in metrics), "time, median [s]"]
    return "## Rigs of d >= 3: value (95 % interval; number)\n\n" + markdown(head, lines) + "\n"


def _cell(figure: IntervalEstimate, digits: int) -> str:
    """Value with its interval and number."""
    if not figure.n:
        return "-"
    value, low, high = (f"{v:.{digits}f}" for v in (figure.value, figure.low, figure.high))
    return f"{value} ({low} .. {high}; {figure.n})"
