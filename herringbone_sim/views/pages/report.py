"""``report.html`` of an analysed run: table of segments, figures, contact, notes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

from markupsafe import Markup

from herringbone_sim.analysis.pipeline import SegmentResult
from herringbone_sim.analysis.segments import FREQUENCY
from herringbone_sim.views.pages.html import Table, number, render
from herringbone_sim.views.picture import Picture

SYMBOLS = {
    "K": Markup("<i>K</i>"),
    "delta_T": Markup("Δ<i>T</i> [K]"),
    "T_1": Markup("<i>T</i><sub>1</sub> [N m]"),
    "xi": Markup("<i>ξ</i>"),
    "control_phase": "control phase [rad]",
    FREQUENCY: "mesh frequency [Hz]",
}
EXPONENT = Markup("<i>λ</i><sub>1</sub> per cycle, ")


@dataclass(frozen=True)
class Report:
    """Content of the page of one run.

    Attributes:
        name: of the run.
        facts: short texts for the head of the page.
        results: one per segment.
        notes: of the recording, a sentence each.
    """

    name: str
    facts: Sequence[str]
    results: Sequence[SegmentResult]
    notes: Sequence[str] = ()


def report_html(report: Report, pictures: Sequence[Picture], files: Sequence[str]) -> str:
    """Return the HTML of the page, with embedded pictures and the names of the files beside it."""
    results = report.results
    names = changing(results)
    return render(
        "report.html",
        title=report.name,
        facts=report.facts,
        constants=[
            Markup("{} = {}").format(_symbol(name), number(value))
            for name, value in results[0].segment.point.items()
            if name not in names
        ],
        segments=_segments(results, names),
        reasons=_reasons(results),
        pictures=pictures,
        contact=_contact(results),
        notes=_notes(report.notes, results),
        files=files,
    )


def _segments(results: Sequence[SegmentResult], names: Sequence[str]) -> Table:
    """Return the table of segments, a ramp as one row, with columns for parameters ``names``."""
    header = [
        *("#", "start [s]", "cycles", "dropped", *(_symbol(name) for name in names)),
        *("motion", EXPONENT + "data", "90 % interval", EXPONENT + "model", "off the lines"),
    ]
    numeric = {i for i, title in enumerate(header) if title != "motion"}
    groups = [list(group) for _, group in groupby(results, lambda r: r.segment.ramp or r.number)]
    rows = [
        _segment_cells(group[0], names) if len(group) == 1 else _ramp_cells(group, names)
        for group in groups
    ]
    return Table(header, rows, numeric)


def changing(results: Sequence[SegmentResult]) -> list[str]:
    """Return the names of the parameters whose values in six digits differ between segments."""
    names = list(results[0].segment.point)
    return [n for n in names if len({number(r.segment.point[n]) for r in results}) > 1]


def _symbol(name: str) -> str:
    return SYMBOLS.get(name, name)


def _ramp_cells(run: Sequence[SegmentResult], names: Sequence[str]) -> list[str]:
    ramp = run[0].segment.ramp
    ends = {ramp: (run[0].segment.ramp_ends[0], run[-1].segment.ramp_ends[1])}
    spans = {name: f"{number(a, 4)} … {number(b, 4)}" for name, (a, b) in ends.items()}
    cycles = sum(result.segment.cycles for result in run)
    values = [spans.get(name, number(run[0].segment.point[name])) for name in names]
    head = [f"{run[0].number}–{run[-1].number}", number(run[0].span_s[0]), f"{cycles:.0f}", "0"]
    return [*head, *values, Markup("<b>ramp</b>"), *["–"] * 4]


def _segment_cells(result: SegmentResult, names: Sequence[str]) -> list[str]:
    e, (model, error) = result.exponent, result.model_exponent
    kind = "periodic" if result.period.value else "chaos" if e.low > 0 else ""
    off = result.off_lines[0] if len(result.off_lines) else math.nan
    return [
        str(result.number),
        number(result.span_s[0]),
        f"{result.segment.cycles:.0f}",
        str(result.dropped_cycles),
        *(number(result.segment.point[name]) for name in names),
        Markup('<b class="{}">{}</b>').format(kind, result.label),
        number(e.value, 3),
        f"{number(e.low, 3)} … {number(e.high, 3)}" if math.isfinite(e.value) else "–",
        f"{number(model, 3)} ± {number(error, 2)}" if math.isfinite(model) else "–",
        f"{off:.1%}" if math.isfinite(off) else "–",
    ]


def _reasons(results: Sequence[SegmentResult]) -> list[str]:
    """Return why the first segments lack a period or, unless periodic, an exponent from data."""
    reasons = [
        f"Segment {r.number}: {reason}"
        for r in results
        if not r.segment.ramp and not r.period.value
        for reason in (r.period.reason if r.period.value is None else "", r.exponent.reason)
        if reason
    ]
    return list(dict.fromkeys(reasons))[:12]


def _contact(results: Sequence[SegmentResult]) -> Table | None:
    """Return a table of the time in drive contact, apart and in back contact, by mesh [%].

    One row per segment in which the contact of the first mesh is known; None without such a
    segment.
    """
    known = [r for r in results if r.contact and math.isfinite(r.contact[0].drive)]
    if not known:
        return None
    header = ["#", *(f"{c.mesh} drive / apart / back" for c in known[0].contact)]
    rows = [
        [str(r.number), *(f"{c.drive:.0%} / {c.separated:.0%} / {c.back:.0%}" for c in r.contact)]
        for r in known
    ]
    return Table(header, rows, range(len(header)))


def _notes(notes: Sequence[str], results: Sequence[SegmentResult]) -> list[str]:
    by_note: dict[str, list[int]] = {}
    for result in results:
        for note in result.notes:
            by_note.setdefault(note, []).append(result.number)
    by_segment = [f"{note} (segment {_spans(numbers)})" for note, numbers in by_note.items()]
    return [*notes, *by_segment]


def _spans(numbers: Sequence[int]) -> str:
    """Return ascending numbers as text with ranges, ``1–4, 7`` for 1, 2, 3, 4, 7."""
    spans: list[list[int]] = []
    for n in numbers:
        if spans and n == spans[-1][1] + 1:
            spans[-1][1] = n
        else:
            spans.append([n, n])
    return ", ".join(f"{a}" if a == b else f"{a}–{b}" for a, b in spans)
