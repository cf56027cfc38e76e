"""The score of many reports: every figure of the check, with intervals, by strata."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from herringbone_sim.errors import AnalysisError
from herringbone_sim.practice.intervals import (
    Figure,
    auroc,
    bootstrap,
    calibration_error,
    share,
)
from herringbone_sim.practice.label import read_label
from herringbone_sim.practice.outcome import Outcome, outcome
from herringbone_sim.recording.safe_json import read_json

Outcomes = Sequence[Outcome]
STRATA = ("truth", "d", "noise", "snr", "law", "channels", "regime")
CELL = ("noise", "law", "channels", "d")


@dataclass(frozen=True)
class Question:
    """A figure: what is asked, of the outcomes, and the range that is aimed at."""

    name: str
    ask: Callable[[Outcomes], Figure]
    least: float = -np.inf
    most: float = np.inf


@dataclass(frozen=True)
class Row:
    """A figure in a stratum; ``met`` is None without cases or without a target."""

    figure: str
    stratum: str
    result: Figure
    least: float
    most: float

    @property
    def met(self) -> bool | None:
        if self.result.n == 0 or not np.isfinite([self.least, self.most]).any():
            return None
        return bool(self.least <= self.result.value <= self.most)


def of_kind(cases: Outcomes, *kinds: str) -> list[Outcome]:
    """Outcomes whose truth is of these kinds."""
    return [case for case in cases if case.kind in kinds]


def _false_attribution(cases: Outcomes) -> Figure:
    return share([case.named for case in of_kind(cases, "none")])


def _right_first(cases: Outcomes) -> Figure:
    return share([case.right for case in of_kind(cases, "single", "pair")])


def _in_class(cases: Outcomes) -> Figure:
    return share([case.in_class for case in of_kind(cases, "single", "pair")])


def _in_three(cases: Outcomes) -> Figure:
    return share([case.in_three for case in of_kind(cases, "single", "pair")])


def _both(cases: Outcomes) -> Figure:
    return share([case.both for case in of_kind(cases, "pair")])


def _mean_p(cases: Outcomes) -> Figure:
    return bootstrap(np.array([case.p_truth for case in cases]), _mean)


def _brier(cases: Outcomes) -> Figure:
    values = [case.brier for case in of_kind(cases, "none", "single", "unknown")]
    return bootstrap(np.array(values), _mean)


def _calibration(cases: Outcomes) -> Figure:
    rows = [(case.sure, float(case.held)) for case in cases]
    return bootstrap(np.array(rows).reshape(-1, 2), calibration_error)


def _unknown(cases: Outcomes) -> Figure:
    known = of_kind(cases, "single", "pair", "unknown")
    rows = [(case.p_unknown, float(case.kind == "unknown")) for case in known]
    figure = bootstrap(np.array(rows).reshape(-1, 2), auroc)
    return figure if np.isfinite(figure.value) else share([])


def _wrong_names(cases: Outcomes) -> Figure:
    return share([case.wrong_name for case in of_kind(cases, "unknown")])


def _locus(cases: Outcomes) -> Figure:
    return share([case.locus for case in cases if case.locus is not None])


def _error(cases: Outcomes) -> Figure:
    return bootstrap(np.array([case.error for case in cases if case.error is not None]), _median)


def _coverage(cases: Outcomes) -> Figure:
    return share([held for case in cases for held in case.covered])


def _closures(cases: Outcomes) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Of rigs with a known effect; a report without one closes nothing."""
    return np.array([case.closure or 0.0 for case in of_kind(cases, "single", "pair")])


def _mean(values: np.ndarray[Any, np.dtype[np.float64]]) -> float:
    return float(np.mean(values))


def _median(values: np.ndarray[Any, np.dtype[np.float64]]) -> float:
    return float(np.median(values))


def _tenth(values: np.ndarray[Any, np.dtype[np.float64]]) -> float:
    return float(np.percentile(values, 10.0))


QUESTIONS = (
    Question("false attribution on none", _false_attribution, most=0.02),
    Question("right effect first", _right_first, least=0.90),
    Question("right or in the named class", _in_class, least=0.97),
    Question("among the first three", _in_three, least=0.98),
    Question("both effects of a pair", _both, least=0.70),
    Question("mean probability on the truth", _mean_p, least=0.85),
    Question("Brier score", _brier, most=0.25),
    Question("calibration error", _calibration, most=0.05),
    Question("AUROC unknown against known", _unknown, least=0.90),
    Question("confident wrong names on unknown", _wrong_names, most=0.05),
    Question("locus", _locus, least=0.95),
    Question("parameter error, median", _error, most=0.05),
    Question("coverage of 90 % intervals", _coverage, least=0.85, most=0.95),
    Question("closure, median", lambda c: bootstrap(_closures(c), _median), least=0.90),
    Question("closure, tenth percentile", lambda c: bootstrap(_closures(c), _tenth), least=0.70),
)


def score(cases: Outcomes) -> tuple[Row, ...]:
    """All figures over all cases, then over each stratum, with 95 % intervals.

    Calibration is that of what a report says, all of which must be there.

    Raises:
        AnalysisError: no cases.
    """
    if not cases:
        raise AnalysisError("a score needs cases, got none: name folders with reports and labels")
    rows = [_row(question, "all", cases) for question in QUESTIONS]
    for name in STRATA:
        for value in sorted({case.strata[name] for case in cases}):
            inside = [case for case in cases if case.strata[name] == value]
            rows += [_row(question, f"{name}: {value}", inside) for question in QUESTIONS]
    return tuple(rows)


def _row(question: Question, stratum: str, cases: Outcomes) -> Row:
    return Row(question.name, stratum, question.ask(cases), question.least, question.most)


def read_cases(reports: Path, labels: Path, seals: dict[str, str]) -> tuple[Outcome, ...]:
    """Outcomes of ``reports/NAME/report.json`` against ``labels/NAME.json``, for every seal.

    Args:
        seals: NAME to seal of its label; a report that is missing counts as a case lost.

    Raises:
        RecordingError: a label that is missing or not the one sealed.
        AnalysisError: a report that is missing or breaks the schema; its name is said.
    """
    cases = []
    for name, sealed in seals.items():
        label = read_label(labels / f"{name}.json", sealed)
        file = reports / name / "report.json"
        try:
            cases.append(outcome(label, read_json(file), name))
        except (OSError, ValueError) as error:
            raise AnalysisError(f"{file}: {error}: write a report for each label") from error
    return tuple(cases)


def write_table(rows: Sequence[Row], file: Path) -> None:
    """The figures as CSV."""
    with file.open("w", newline="", encoding="utf-8") as handle:
        table = csv.writer(handle)
        table.writerow(["stratum", "figure", "value", "low_95", "high_95", "n", "target", "met"])
        for row in rows:
            numbers = (row.result.value, row.result.low, row.result.high)
            met = "" if row.met is None else ("yes" if row.met else "no")
            texts = [f"{number:.4g}" for number in numbers]
            table.writerow([row.stratum, row.figure, *texts, row.result.n, target(row), met])


def target(row: Row) -> str:
    """The aim of a row as text, as ``0.85 .. 0.95`` or ``<= 0.02``."""
    least, most = np.isfinite(row.least), np.isfinite(row.most)
    if least and most:
        return f"{row.least:g} .. {row.most:g}"
    return f">= {row.least:g}" if least else (f"<= {row.most:g}" if most else "")


def table_text(rows: Sequence[Row]) -> str:
    """The figures as lines to print."""
    lines = []
    for row in rows:
        if row.result.n:
            r = row.result
            mark = {True: "met", False: "missed", None: ""}[row.met]
            lines.append(
                f"{row.stratum:24s} {row.figure:34s} {r.value:7.3f} [{r.low:6.3f}, {r.high:6.3f}] "
                f"n = {r.n:4d}  {target(row):12s} {mark}"
            )
    return "\n".join(lines)
