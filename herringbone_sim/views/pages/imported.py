"""``import.html``: per imported run its channels, unused columns, remarks and a picture."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
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
from herringbone_sim.views.pages.html import Table, number, render, write_page
from herringbone_sim.views.picture import Picture

DETAIL_CYCLES = 4  # mesh cycles drawn at full resolution, beside the whole run
# Constrained layout takes seconds here; Agg draws lines of a million samples only in parts.
PLAIN = {
    "figure.constrained_layout.use": False,
    "agg.path.chunksize": 10_000,
    "axes.formatter.limits": (-2, 3),
}
HEAD = ["channel", "made of", "rate [Hz]", "least", "largest", "unit"]


def write_import_page(folder: Path, rig: str, runs: Sequence[ImportedRun]) -> Path:
    """Write ``import.html``, with embedded pictures, and ``figures/``; return the page's path.

    Args:
        folder: of the campaign; pictures are drawn from its bags.
        rig: name of the rig.
        runs: imported runs.

    Raises:
        AnalysisError: ``figures/`` can't be created or written.
        RecordingError: the bag of a run can't be read.
        OSError: a picture or the page can't be written.
    """
    make_folder(folder / "figures")
    parts = []
    for run in runs:
        path = folder / "figures" / f"{run.name}.png"
        run_figure(read_recording(folder / run.name).samples).savefig(path)
        picture = Picture(path, f"{run.name}: the whole run, and its first cycles")
        parts.append(_run_values(run, picture))
    html = render("import.html", title=f"Import of {rig}", runs=parts)
    return write_page(folder / "import.html", html)


def _run_values(run: ImportedRun, picture: Picture) -> dict[str, object]:
    """Values of the template for one run."""
    rows = [(t.channel, t.source, *_numbers(t.rate_hz, t.low, t.high), t.unit) for t in run.taken]
    return {
        "name": run.name,
        "facts": f"{run.role}, {run.samples} samples, {run.rate_hz:.6g} Hz, "
        f"{run.cycles:.1f} mesh cycles",
        "remarks": run.remarks,
        "picture": picture,
        "channels": Table(HEAD, rows, (2, 3, 4)),
        "unused": list(unused_texts(run.left)),
    }


def _numbers(*values: float) -> tuple[str, ...]:
    return tuple(number(value, 5) for value in values)


def unused_texts(unused: Sequence[tuple[str, str]]) -> Iterator[str]:
    """Yield a text per reason with the columns not used for it, from pairs (column, reason)."""
    for reason in dict.fromkeys(why for _, why in unused):
        yield f"{listed([name for name, why in unused if why == reason])}: {reason}"


def channels_by_quantity(names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Group channel names by quantity: ``x`` of all meshes, ``u`` of all bodies, ...

    Other channels form groups by themselves; ``t`` is left out.
    """
    groups: dict[str, list[str]] = {}
    for name in names:
        first, _, rest = name.partition("_")
        indexed = rest and len(first) == 1 and first != "T"
        groups.setdefault(first if indexed else name, []).append(name)
    groups.pop("t", None)
    return {quantity: tuple(channels) for quantity, channels in groups.items()}


def run_figure(series: TimeSeries) -> Figure:
    """Draw a row per quantity with all its channels: the whole run, and its first mesh cycles."""
    every = channels_by_quantity(series.names)
    cycles = (series["phase"] - series["phase"][0]) / (2.0 * np.pi)
    first = max(int(np.searchsorted(cycles, DETAIL_CYCLES)), 2)
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


def ranges_by_quantity(run: ImportedRun) -> Mapping[str, tuple[str, float, float]]:
    """Return unit, smallest and largest value of each quantity of a run, over its channels.

    NaN for a quantity without any finite value.
    """
    channels = {channel.channel: channel for channel in run.taken}
    return {
        title: (
            channels[names[0]].unit,
            float(np.fmin.reduce([channels[name].low for name in names])),
            float(np.fmax.reduce([channels[name].high for name in names])),
        )
        for title, names in channels_by_quantity(tuple(channels)).items()
    }
