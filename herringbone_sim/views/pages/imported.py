"""``import.html``: what an import took and left, a picture of every run, and what looks odd."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.errors import listed
from herringbone_sim.recording.importing.campaign import ImportedRun
from herringbone_sim.recording.importing.units import si_unit
from herringbone_sim.recording.reader import read_recording
from herringbone_sim.sweeps.output import make_folder
from herringbone_sim.views.figures.style import DPI, GREY, STYLE
from herringbone_sim.views.pages.compare import table
from herringbone_sim.views.pages.report import CSS, Picture, number, picture_html

SHOWN_CYCLES = 4  # mesh cycles that are seen in full, beside the whole run
# Constrained layout takes seconds here; Agg draws lines of a million samples in parts alone.
PLAIN = {
    "figure.constrained_layout.use": False,
    "agg.path.chunksize": 10_000,
    "axes.formatter.limits": (-2, 3),
}
HEAD = ["channel", "made of", "rate [Hz]", "least", "largest", "unit"]


def write_import_page(folder: Path, rig: str, runs: Sequence[ImportedRun]) -> Path:
    """Write ``import.html`` (nothing outside it) and ``figures/``; returns the page.

    Args:
        folder: campaign that was made; pictures show what its bags hold.
        rig: name.
        runs: what came in.

    Raises:
        AnalysisError: the folder can't be written.
    """
    make_folder(folder / "figures")
    parts = []
    for run in runs:
        path = folder / "figures" / f"{run.name}.png"
        run_figure(read_recording(folder / run.name).samples).savefig(path)
        parts.append(_run(run, Picture(path, f"{run.name}: the whole run, and its first cycles")))
    title = f"Import of {escape(rig)}"
    lead = f'<p class="lead">{len(runs)} runs, in SI, each on one clock.</p>'
    head = f'<meta charset="utf-8"><title>{title}</title><style>{CSS}</style>'
    body = f"<h1>{title}</h1>{lead}{''.join(parts)}"
    page = folder / "import.html"
    html = f'<!doctype html><html lang="en"><head>{head}</head><body>{body}</body></html>'
    page.write_text(html, encoding="utf-8")
    return page


def _run(run: ImportedRun, picture: Picture) -> str:
    rows = [
        [escape(c) for c in (t.channel, t.source, *_numbers(t.rate_hz, t.low, t.high), t.unit)]
        for t in run.taken
    ]
    told = f"{run.role}, {run.samples} samples, {run.rate_hz:.6g} Hz, {run.cycles:.1f} mesh cycles"
    odd = "".join(f"<li>{escape(text)}</li>" for text in run.remarks)
    left = "".join(f"<li>{escape(text)}</li>" for text in left_words(run.left))
    return (
        f'<h2>{escape(run.name)}</h2><p class="lead">{escape(told)}</p>'
        + (f"<p>To look at:</p><ul>{odd}</ul>" if odd else "")
        + picture_html(picture)
        + table(HEAD, rows, (2, 3, 4))
        + (f"<p>Left:</p><ul>{left}</ul>" if left else "")
    )


def _numbers(*values: float) -> tuple[str, ...]:
    return tuple(number(value, 5) for value in values)


def left_words(left: Sequence[tuple[str, str]]) -> Iterator[str]:
    """What was left, once for each reason."""
    for reason in dict.fromkeys(why for _, why in left):
        yield f"{listed([what for what, why in left if why == reason])}: {reason}"


def kinds(names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Channels by quantity: those of meshes and bodies together, each of the others alone."""
    found: dict[str, list[str]] = {}
    for name in names:
        first, _, rest = name.partition("_")
        many = rest and len(first) == 1 and first != "T"
        found.setdefault(first if many else name, []).append(name)
    found.pop("t", None)
    return {title: tuple(channels) for title, channels in found.items()}


def run_figure(series: TimeSeries) -> Figure:
    """A row a quantity: left the whole run, right its first mesh cycles, all channels in it."""
    every = kinds(series.names)
    turned = (series["phase"] - series["phase"][0]) / (2.0 * np.pi)
    first = max(int(np.searchsorted(turned, SHOWN_CYCLES)), 2)
    with matplotlib.rc_context(STYLE | PLAIN):
        height = 0.6 + 1.2 * len(every)
        figure = Figure(figsize=(9.6, height), dpi=DPI)
        figure.subplots_adjust(0.09, 0.5 / height, 0.99, 1.0 - 0.25 / height, 0.16, 0.3)
        panels = figure.subplots(len(every), 2, squeeze=False, sharex="col")
        for row, (title, names) in zip(panels, every.items(), strict=True):
            for panel, rows in zip(row, (slice(None), slice(first)), strict=True):
                for name in names:
                    panel.plot(1e3 * series.times[rows], series[name][rows], lw=0.6)
            row[0].set_ylabel(f"{title} [{si_unit(names[0])}]")
            many = f"{len(names)} channels" if len(names) > 1 else ""
            row[1].set_title(many, color=GREY, fontsize=7, loc="right", pad=1)
        for panel in panels[-1]:
            panel.set_xlabel("time [ms]")
    return figure


def by_kind(run: ImportedRun) -> Mapping[str, tuple[str, float, float]]:
    """Unit and range of each quantity of a run."""
    taken = {one.channel: one for one in run.taken}
    return {
        title: (
            taken[names[0]].unit,
            min(taken[name].low for name in names),
            max(taken[name].high for name in names),
        )
        for title, names in kinds(tuple(taken)).items()
    }
