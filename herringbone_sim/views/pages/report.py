"""One page of HTML that holds an analysis: table of segments, figures, notes; nothing outside."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from itertools import groupby
from pathlib import Path

from herringbone_sim.analysis.pipeline import SegmentResult
from herringbone_sim.analysis.segments import FREQUENCY

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
SYMBOLS = {
    "K": "<i>K</i>",
    "delta_T": "Δ<i>T</i> [K]",
    "T_1": "<i>T</i><sub>1</sub> [N m]",
    "xi": "<i>ξ</i>",
    "control_phase": "control phase [rad]",
    FREQUENCY: "mesh frequency [Hz]",
}


@dataclass(frozen=True)
class Picture:
    """A PNG file and what it shows."""

    path: Path
    caption: str


def report_html(
    name: str,
    facts: Sequence[str],
    results: Sequence[SegmentResult],
    pictures: Sequence[Picture],
    notes: Sequence[str],
    files: Sequence[str],
) -> str:
    """The page: facts on the run, segments, pictures (in the page), notes, names of the files."""
    body = [
        f"<h1>{escape(name)}</h1>",
        f'<p class="lead">{escape("  ·  ".join(facts))}</p>',
        _section("Segments", [_segments(results), _legend(results)]),
        _section("Figures", [picture_html(picture) for picture in pictures]),
        _section("Contact, share of time", [_contact(results)]),
        _section("Notes", [_notes(notes, results)]),
        f"<footer>Beside this page: {escape(', '.join(files))}.</footer>",
    ]
    head = f'<meta charset="utf-8"><title>{escape(name)}</title><style>{CSS}</style>'
    return f'<!doctype html><html lang="en"><head>{head}</head><body>{"".join(body)}</body></html>'


def _section(title: str, parts: Sequence[str]) -> str:
    content = "".join(parts)
    return f"<h2>{title}</h2>{content}" if content else ""


def _segments(results: Sequence[SegmentResult]) -> str:
    """Table of the segments; what never changes stands above it, the bins of a ramp as one row."""
    names = changing(results)
    header = [
        *("#", "start [s]", "cycles", "dropped", *(_symbol(name) for name in names)),
        *("motion", "<i>λ</i><sub>1</sub> per cycle, data", "90 % interval"),
        *("<i>λ</i><sub>1</sub> per cycle, model", "off the lines"),
    ]
    runs = [list(run) for _, run in groupby(results, lambda r: r.segment.ramp or r.number)]
    rows = [
        _segment_cells(run[0], names) if len(run) == 1 else _ramp_cells(run, names) for run in runs
    ]
    fixed = [
        f"{_symbol(name)} = {number(value)}"
        for name, value in results[0].segment.point.items()
        if name not in names
    ]
    return f"<p>{',&ensp; '.join(fixed)}</p>{_table(header, rows, 'motion')}"


def changing(results: Sequence[SegmentResult]) -> list[str]:
    """Parameters that differ between segments, to 6 digits."""
    names = list(results[0].segment.point)
    return [n for n in names if len({number(r.segment.point[n]) for r in results}) > 1]


def _symbol(name: str) -> str:
    return SYMBOLS.get(name, escape(name))


def _ramp_cells(run: Sequence[SegmentResult], names: Sequence[str]) -> list[str]:
    ramp = run[0].segment.ramp
    ends = {ramp: (run[0].segment.ramp_ends[0], run[-1].segment.ramp_ends[1])}
    spans = {name: f"{number(a, 4)} … {number(b, 4)}" for name, (a, b) in ends.items()}
    cycles = sum(result.segment.cycles for result in run)
    values = [spans.get(name, number(run[0].segment.point[name])) for name in names]
    head = [f"{run[0].number}–{run[-1].number}", number(run[0].span_s[0]), f"{cycles:.0f}", "0"]
    return [*head, *values, "<b>ramp</b>", *["–"] * 4]


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
        f'<b class="{kind}">{result.label}</b>',
        number(e.value, 3),
        f"{number(e.low, 3)} … {number(e.high, 3)}" if math.isfinite(e.value) else "–",
        f"{number(model, 3)} ± {number(error, 2)}" if math.isfinite(model) else "–",
        f"{off:.1%}" if math.isfinite(off) else "–",
    ]


def _legend(results: Sequence[SegmentResult]) -> str:
    reasons = {
        f"{r.number}: {reason}"
        for r in results
        for reason in (r.period.reason if r.period.value is None else "", r.exponent.reason)
        if reason and not r.segment.ramp and not r.period.value
    }
    told = sorted(reasons, key=lambda text: int(text.split(":")[0]))
    return _list([f"Segment {text}" for text in told[:12]])


def _contact(results: Sequence[SegmentResult]) -> str:
    known = [r for r in results if r.contact and math.isfinite(r.contact[0].drive)]
    if not known:
        return "<p>Unknown: the half-backlash is not in the recording (give --parameters).</p>"
    header = ["#", *(f"{escape(c.mesh)} drive / apart / back" for c in known[0].contact)]
    rows = (
        [str(r.number), *(f"{c.drive:.0%} / {c.separated:.0%} / {c.back:.0%}" for c in r.contact)]
        for r in known
    )
    return _table(header, rows, "")


def _notes(notes: Sequence[str], results: Sequence[SegmentResult]) -> str:
    by_note: dict[str, list[int]] = {}
    for result in results:
        for note in result.notes:
            by_note.setdefault(note, []).append(result.number)
    told = [f"{note} (segment {_spans(numbers)})" for note, numbers in by_note.items()]
    return _list([*notes, *told])


def _spans(numbers: Sequence[int]) -> str:
    """``1-4, 7`` for 1, 2, 3, 4, 7."""
    spans: list[list[int]] = []
    for one in numbers:
        if spans and one == spans[-1][1] + 1:
            spans[-1][1] = one
        else:
            spans.append([one, one])
    return ", ".join(f"{a}" if a == b else f"{a}–{b}" for a, b in spans)


def picture_html(picture: Picture) -> str:
    """The picture in the page, with its caption."""
    data = base64.b64encode(picture.path.read_bytes()).decode()
    caption = escape(picture.caption)
    image = f'<img alt="{caption}" src="data:image/png;base64,{data}">'
    return f"<figure>{image}<figcaption>{caption}</figcaption></figure>"


def _table(header: Sequence[str], rows: Iterable[Sequence[str]], words: str) -> str:
    def cells(tag: str, row: Sequence[str]) -> str:
        kinds = ("" if title == words else ' class="n"' for title in header)
        return "".join(f"<{tag}{k}>{c}</{tag}>" for k, c in zip(kinds, row, strict=True))

    lines = "".join(f"<tr>{cells('td', row)}</tr>" for row in rows)
    return f'<div class="scroll"><table><tr>{cells("th", header)}</tr>{lines}</table></div>'


def _list(items: Sequence[str]) -> str:
    return f"<ul>{''.join(f'<li>{escape(item)}</li>' for item in items)}</ul>" if items else ""


def number(value: float, digits: int = 6) -> str:
    """Short decimal, a dash for NaN."""
    return f"{value:.{digits}g}" if math.isfinite(value) else "–"
