"""Table of a bench: figures and targets beside the baselines, by strata, with reasons."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from herringbone_sim.practice.intervals import IntervalEstimate
from herringbone_sim.practice.outcome import Outcome
from herringbone_sim.practice.reasons import by_cause, reasons
from herringbone_sim.practice.score import (
    CELL,
    METRICS,
    STRATA,
    Outcomes,
    Row,
    rows_of,
    strata,
    target,
)
from herringbone_sim.practice.seeds import SeedOverlap
from herringbone_sim.practice.stored import Bench

REACHED = 2.75  # smallest d that counts as 3, as sizes are solved for to some per cent
AIM = "white noise of 40 dB, all channels, d >= 3"
AT_ONE = "white noise of 40 dB, all channels, d = 1"
OF_CELLS = (
    "false attribution on none",
    "right effect first",
    "right or in the named class",
    "mean probability on the truth",
    "AUROC unknown against known",
    "confident wrong names on unknown",
    "locus",
    "coverage of 90 % intervals",
    "closure, median",
)
FIRST_AT_ONE = replace(next(m for m in METRICS if m.name == "right effect first"), least=0.75)


def aimed(cases: Outcomes) -> list[Outcome]:
    """Return the cases that the targets apply to (``AIM``), rigs without effects included."""
    return [case for case in cases if _usual(case) and case.reached >= REACHED]


def at_one(cases: Outcomes) -> list[Outcome]:
    """Return the cases with d = 1 (``AT_ONE``), causes outside the catalogue included."""
    return [case for case in cases if _usual(case) and case.strata["d"] == "1"]


def _usual(case: Outcome) -> bool:
    """Return whether a case has white noise of 40 dB, all channels, 24 samples of a mesh cycle."""
    usual = {"noise": "white", "snr": "40 dB", "channels": "full", "samples": "24"}
    return all(case.strata[name] == value for name, value in usual.items())


def cells(cases: Outcomes) -> list[tuple[str, list[Outcome]]]:
    """Return name and cases of each combination of noise, law, channels and d."""
    by_cell: dict[str, list[Outcome]] = {}
    for case in cases:
        by_cell.setdefault(" x ".join(case.strata[name] for name in CELL), []).append(case)
    return sorted(by_cell.items())


def bench_rows(bench: Bench) -> list[Row]:
    """Return all figures of the diagnosis and the baselines, as rows of the CSV file."""
    rows = rows_of(aimed(bench.cases), AIM)
    rows += rows_of(at_one(bench.cases), AT_ONE, [FIRST_AT_ONE])
    for name, cases in bench.rivals.items():
        rows += _untargeted(rows_of(aimed(cases), f"{AIM}; {name}"))
    for name, inside in [("all", list(bench.cases)), *strata(bench.cases), *cells(bench.cases)]:
        rows += _untargeted(rows_of(inside, name))
    return rows


def _untargeted(rows: Sequence[Row]) -> list[Row]:
    """Return copies of rows without targets: ``least`` -inf, ``most`` inf."""
    return [replace(row, least=-np.inf, most=np.inf) for row in rows]


def table_markdown(bench: Bench, seed_overlap: SeedOverlap | None = None) -> str:
    """Return the table of a bench as Markdown.

    Args:
        seed_overlap: marks the seeds as seen while calibrating if it holds any; None: not checked.
    """
    cases = bench.cases
    parts = [_title_part(bench, seed_overlap), _aim_part(bench), _one_part(cases)]
    parts += [_why_part(aimed(cases)), _strata_part(cases), _cell_part(cases)]
    parts.append(_cause_part(cases))
    return "\n\n".join(part for part in parts if part) + "\n"


def _title_part(bench: Bench, seed_overlap: SeedOverlap | None) -> str:
    """Return the title as Markdown, then numbers of campaigns, seeds, setting and times."""
    note = bench.note
    frozen = note.get("calibration") or {}
    known = f"{frozen['file']} {frozen['sha256'][:16]}" if frozen else "no file of thresholds"
    failed = sum(bool(case.failed) for case in bench.cases)
    marked = note.get("calibration_family") or bool(seed_overlap and seed_overlap.seeds)
    seeds = "SEEN WHILE CALIBRATING" if marked else "not seen while calibrating"
    lines = [
        "# Withheld effects",
        "",
        f"- {len(bench.cases)} campaigns diagnosed of {bench.sealed} sealed; {failed} diagnoses "
        f"failed (counted as wrong); {bench.left_out} seeds gave no rig",
        f"- seeds: {seeds}; {known}",
        f"- drawn from: {_setting(note.get('setting', {}))}",
    ]
    if bench.durations_s:
        middle, most = np.median(bench.durations_s), max(bench.durations_s)
        lines.append(f"- a diagnosis took {middle:.0f} s in the median, {most:.0f} s at most")
    if len(bench.sources) > 1:
        counts = ", ".join(f"{name}: {n}" for name, n in bench.sources.items())
        lines.append(f"- MIXED: reports of different sources of the diagnosis ({counts})")
    return "\n".join(lines)


def _setting(setting: Mapping[str, Any]) -> str:
    """Return the setting of the bench as text."""
    return "; ".join(
        f"{name} {', '.join(map(str, value)) if isinstance(value, list) else value or 'by shares'}"
        for name, value in setting.items()
    )


def _aim_part(bench: Bench) -> str:
    """Return the section on the cases of ``aimed``, with targets and baselines; empty if none."""
    names = list(bench.rivals)
    inside = aimed(bench.cases)
    if not inside:
        return ""
    others = {name: rows_of(aimed(cases), AIM) for name, cases in bench.rivals.items()}
    head = ["figure", "value", "95 %", "n", "target", "", *names]
    lines = [
        [*_row_cells(row), *(_value(others[name][i].result) for name in names)]
        for i, row in enumerate(rows_of(inside, AIM))
    ]
    return f"## {AIM} ({len(inside)} campaigns)\n\n" + markdown(head, lines)


def _one_part(cases: Outcomes) -> str:
    """Return the section on the cases at d = 1, empty without such cases."""
    inside = at_one(cases)
    if not inside:
        return ""
    lines = [_row_cells(row) for row in rows_of(inside, AT_ONE, [FIRST_AT_ONE])]
    return f"## {AT_ONE} ({len(inside)} campaigns)\n\n" + markdown(
        ["figure", "value", "95 %", "n", "target", ""], lines
    )


def _row_cells(row: Row) -> list[str]:
    """Return the text cells of a row."""
    mark = {True: "met", False: "MISSED", None: ""}[row.met]
    r = row.result
    span = f"{r.low:.3f} .. {r.high:.3f}" if np.isfinite([r.low, r.high]).all() else ""
    return [row.figure, _value(r), span, str(r.n), target(row), mark]


def _value(figure: IntervalEstimate) -> str:
    return f"{figure.value:.3f}" if np.isfinite(figure.value) else "-"


def _why_part(cases: Outcomes) -> str:
    """Return the section on missed targets: strata that miss each, and what is wrong there."""
    lines = []
    for metric, row in zip(METRICS, rows_of(cases, AIM), strict=True):
        if row.met is not False:
            continue
        where = []
        for name, inside in strata(cases):
            stratum_row = rows_of(inside, name, [metric])[0]
            if stratum_row.met is False and len(inside) < len(cases):
                where.append(
                    f"{name} ({stratum_row.result.value:.3f}, n = {stratum_row.result.n})"
                )
        lines.append(f"- {metric.name}: {_value(row.result)}, target {target(row)}")
        lines.append(f"  - missed in: {'; '.join(where) or 'no single stratum'}")
        lines += [f"  - {text}" for text in reasons(metric.name, cases)]
    return "## Why targets are missed\n\n" + "\n".join(lines) if lines else ""


def _strata_part(cases: Outcomes) -> str:
    """Return a table of every figure for each kind of stratum."""
    parts = []
    for name in STRATA:
        values = sorted({case.strata[name] for case in cases})
        columns = [
            rows_of([case for case in cases if case.strata[name] == value], value)
            for value in values
        ]
        lines = [
            [metric.name, *(f"{_value(c[i].result)} ({c[i].result.n})" for c in columns)]
            for i, metric in enumerate(METRICS)
        ]
        title = f"## All campaigns by {name}: value (n)\n\n"
        parts.append(title + markdown(["figure", *values], lines))
    return "\n\n".join(parts)


def _cell_part(cases: Outcomes) -> str:
    """Return the section with a line for each combination of noise, law, channels and d."""
    metrics = [metric for metric in METRICS if metric.name in OF_CELLS]
    lines = []
    for name, inside in cells(cases):
        rows = rows_of(inside, name, metrics)
        figures = [f"{_value(row.result)} ({row.result.n})" for row in rows]
        lines.append([name, str(len(inside)), *figures])
    head = [" x ".join(CELL), "n", *(metric.name for metric in metrics)]
    return "## All campaigns by cell: value (n)\n\n" + markdown(head, lines)


def _cause_part(cases: Outcomes) -> str:
    """Return the table by cause."""
    head = ["cause", "n", "right first", "in class", "locus", "error", "closure", "else named"]
    return "## All campaigns by cause\n\n" + markdown(head, by_cause(cases))


def markdown(head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table with aligned columns."""
    rows = [list(head), *(list(line) for line in lines)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(head))]
    texts = [
        "| " + " | ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)) + " |"
        for row in rows
    ]
    texts.insert(1, "|" + "|".join("-" * (w + 2) for w in widths) + "|")
    return "\n".join(texts)


def write_cases(cases: Outcomes, file: Path) -> None:
    """Write one row per campaign to a CSV file."""
    with file.open("w", newline="", encoding="utf-8") as handle:
        table = csv.writer(handle)
        rows = [_case_row(case) for case in cases]
        table.writerow(rows[0])
        table.writerows(row.values() for row in rows)


def _case_row(case: Outcome) -> dict[str, Any]:
    """Return the cells of a case by column."""
    texts = {name: " + ".join(getattr(case, name)) for name in ("truth", "internal", "said")}
    rest = {name: value for name, value in vars(case).items() if name not in ("strata", *texts)}
    given = {name: value for name, value in case.strata.items() if name != "truth"}
    covered = " ".join("yes" if held else "no" for held in case.covered)
    return {"name": case.name, **texts, **given, **rest, "covered": covered}
