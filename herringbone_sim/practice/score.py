"""Figures of merit of a bench from many scored reports: each with its interval, by strata."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.practice.intervals import (
    NOTHING,
    IntervalEstimate,
    auroc,
    bootstrap,
    calibration_error,
    share,
)
from herringbone_sim.practice.outcome import Outcome

Outcomes = Sequence[Outcome]
STRATA = ("truth", "d", "noise", "snr", "law", "channels", "samples", "regime")
CELL = ("noise", "law", "channels", "d")


@dataclass(frozen=True)
class Metric:
    """A figure of merit, computed from the outcomes, and its target range ``least .. most``."""

    name: str
    compute: Callable[[Outcomes], IntervalEstimate]
    least: float = -np.inf
    most: float = np.inf


@dataclass(frozen=True)
class Row:
    """A figure of merit in a stratum, with its target range ``least .. most``."""

    figure: str
    stratum: str
    result: IntervalEstimate
    least: float
    most: float

    @property
    def met(self) -> bool | None:
        """Whether the target is met; None without cases or without a target."""
        if self.result.n == 0 or not np.isfinite([self.least, self.most]).any():
            return None
        return bool(self.least <= self.result.value <= self.most)


def of_kind(cases: Outcomes, *kinds: str) -> list[Outcome]:
    """Return the outcomes whose truth is of the given kinds, see ``Outcome.kind``."""
    return [case for case in cases if case.kind in kinds]


def _share(name: str, *kinds: str) -> Callable[[Outcomes], IntervalEstimate]:
    """Return a function: fraction of outcomes of some kinds whose attribute ``name`` is true."""
    return lambda cases: share([getattr(case, name) for case in of_kind(cases, *kinds)])


def _mean_p(cases: Outcomes) -> IntervalEstimate:
    return bootstrap(np.array([case.p_truth for case in cases]), np.mean)


def _brier(cases: Outcomes) -> IntervalEstimate:
    values = [case.brier for case in of_kind(cases, "none", "single", "unknown")]
    return bootstrap(np.array(values), np.mean)


def _calibration(cases: Outcomes) -> IntervalEstimate:
    rows = [(case.sure, float(case.held)) for case in cases]
    return bootstrap(np.array(rows).reshape(-1, 2), calibration_error)


def _unknown(cases: Outcomes) -> IntervalEstimate:
    known = of_kind(cases, "single", "pair", "unknown")
    rows = [(case.p_unknown, float(case.kind == "unknown")) for case in known]
    figure = bootstrap(np.array(rows).reshape(-1, 2), auroc)
    return figure if np.isfinite(figure.value) else NOTHING


def _locus(cases: Outcomes) -> IntervalEstimate:
    return share([case.locus for case in cases if case.locus is not None])


def _error(cases: Outcomes) -> IntervalEstimate:
    return bootstrap(np.array([case.error for case in cases if case.error is not None]), np.median)


def _coverage(cases: Outcomes) -> IntervalEstimate:
    return share([held for case in cases for held in case.covered])


def _closures(cases: Outcomes) -> Array:
    """Return the closure (n,) of rigs with a known effect; 0 if the report has none."""
    return np.array([case.closure or 0.0 for case in of_kind(cases, "single", "pair")])


def _tenth(values: Array) -> Any:
    return np.percentile(values, 10.0)


METRICS = (
    Metric("healthy called none", _share("right", "none"), least=0.95),
    Metric("false attribution on none", _share("named", "none"), most=0.02),
    Metric("right effect first", _share("right", "single", "pair"), least=0.90),
    Metric("right or in the named class", _share("in_class", "single", "pair"), least=0.97),
    Metric("among the first three", _share("in_three", "single", "pair"), least=0.98),
    Metric("both effects of a pair", _share("both", "pair"), least=0.70),
    Metric("mean probability on the truth", _mean_p, least=0.85),
    Metric("Brier score", _brier, most=0.25),
    Metric("calibration error", _calibration, most=0.05),
    Metric("AUROC unknown against known", _unknown, least=0.90),
    Metric("confident wrong names on unknown", _share("wrong_name", "unknown"), most=0.05),
    Metric("locus", _locus, least=0.95),
    Metric("parameter error, median", _error, most=0.05),
    Metric("coverage of 90 % intervals", _coverage, least=0.85, most=0.95),
    Metric("closure, median", lambda c: bootstrap(_closures(c), np.median), least=0.90),
    Metric("closure, tenth percentile", lambda c: bootstrap(_closures(c), _tenth), least=0.70),
)


def strata(cases: Outcomes) -> list[tuple[str, list[Outcome]]]:
    """Return name and cases of each stratum."""
    return [
        (f"{name}: {value}", [case for case in cases if case.strata[name] == value])
        for name in STRATA
        for value in sorted({case.strata[name] for case in cases})
    ]


def rows_of(cases: Outcomes, stratum: str, metrics: Sequence[Metric] = METRICS) -> list[Row]:
    """Return the figures of a stratum, with 95 % intervals.

    The calibration error compares the probability of all that a report says with its truth.
    """
    return [Row(m.name, stratum, m.compute(cases), m.least, m.most) for m in metrics]


def write_table(rows: Sequence[Row], file: Path) -> None:
    """Write the figures to a CSV file."""
    with file.open("w", newline="", encoding="utf-8") as handle:
        table = csv.writer(handle)
        table.writerow(["stratum", "figure", "value", "low_95", "high_95", "n", "target", "met"])
        for row in rows:
            numbers = (row.result.value, row.result.low, row.result.high)
            met = "" if row.met is None else ("yes" if row.met else "no")
            texts = [f"{number:.4g}" for number in numbers]
            table.writerow([row.stratum, row.figure, *texts, row.result.n, target(row), met])


def target(row: Row) -> str:
    """Return the target of a row as text, ``0.85 .. 0.95`` or ``<= 0.02``; empty if none."""
    least, most = np.isfinite(row.least), np.isfinite(row.most)
    if least and most:
        return f"{row.least:g} .. {row.most:g}"
    return f">= {row.least:g}" if least else (f"<= {row.most:g}" if most else "")
