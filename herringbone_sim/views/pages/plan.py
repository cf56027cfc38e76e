"""``plan.html``: size from which a diagnosis with given sensors names each effect."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib
import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure

from herringbone_sim.gap.planning.plan import NAMED, SIZES, Plan
from herringbone_sim.gap.planning.summary import (
    effect_summaries,
    named_effects,
    place_text,
    ranked_runs,
    sensors_text,
    size_reduction,
)
from herringbone_sim.recording.campaign import POINT
from herringbone_sim.sweeps.output import make_folder
from herringbone_sim.views.figures.style import BLUE, DPI, GREEN, GREY, INK, ORANGE, STYLE
from herringbone_sim.views.pages.html import Table, number, render, write_page
from herringbone_sim.views.picture import Picture

COLOURS = (ORANGE, GREEN, "#CC79A7", "#E69F00", "#56B4E9")
HEAD = [
    "effect",
    "named from, at the best place",
    "best place",
    "at half of its places",
    "at the worst place",
    "place named",
    "followed best by",
    "which leaves",
    "run that tells most",
]
RUNS_HEAD = [
    *("run", "ΔT [K]", "K", Markup("T<sub>1</sub> [N m]"), "Ω", "told of every effect"),
]
CAPTION = (
    "Sizes over a moderate one; line: from the best to the worst place, dot: half of the places; "
    "an arrow: never named."
)
LEAD = (
    "Sizes from which on a diagnosis of runs at these operating points would name the effect with "
    f"a probability of {NAMED:.0%}, linear about the nominal gear; the probability is that of the "
    "judge that a diagnosis has. Places: meshes, planets, sides and options of the catalogue. "
    "What would be taken for something else is followed best by an effect that leaves next to "
    "nothing of its squares."
)


def write_plan_page(
    folder: Path,
    plan: Plan,
    points: Sequence[Mapping[str, float]],
    also: Mapping[str, Plan],
    noise: str,
) -> Path:
    """Write ``plan.html``, with its picture embedded, and ``plan.png``; return the page's path.

    Args:
        folder: created if missing.
        plan: of the given sensors.
        points: operating points of the runs.
        also: name of an additional sensor -> plan with it.
        noise: of the sensors, in words.

    Raises:
        AnalysisError: the folder can't be written.
    """
    make_folder(folder)
    picture = folder / "plan.png"
    plan_figure(plan, also).savefig(picture)
    named = f"{named_effects(plan)} of {len(plan.effects)} effects are named at a moderate size"
    facts = f"{', '.join(plan.observations)}, {plan.count:.0f} values, noise {noise}"
    html = render(
        "plan.html",
        title=f"What {sensors_text(plan)} would tell",
        named=f"{named}; {facts}.",
        lead=LEAD,
        drawing=Picture(picture, CAPTION),
        effects=Table(HEAD, effect_rows(plan), (1, 3, 4, 5, 7)),
        others=_others(plan),
        sensors=_sensors(plan, also),
        runs=Table(RUNS_HEAD, point_rows(plan, points), (1, 2, 3, 4, 5)),
        length=_length(plan),
    )
    return write_page(folder / "plan.html", html)


def size(value: float, unit: str) -> str:
    """Return a size with its unit as text; ``never`` if it is not finite."""
    if not math.isfinite(value):
        return "never"
    plain_unit = unit.replace("unit of the channel", "SI").replace("1e-6", "ppm")
    return f"{number(value, 3)} {plain_unit}".removesuffix(" -")


def by_gain(plan: Plan, also: Mapping[str, Plan]) -> list[tuple[str, Plan, float]]:
    """Return additional sensors, the most useful first: name, plan with it, ``size_reduction``."""
    every = [(name, more, size_reduction(plan, more)) for name, more in also.items()]
    return sorted(every, key=lambda entry: (-named_effects(entry[1]), -np.nan_to_num(entry[2])))


def effect_rows(plan: Plan) -> list[list[str]]:
    """Return the rows of the table of effects, columns as in ``HEAD``."""
    return [
        [
            row.effect,
            size(row.best, row.unit),
            place_text(row.best_place),
            size(row.median, row.unit),
            size(row.worst, row.unit),
            f"{row.placed_share:.0%}",
            row.rival,
            f"{row.rival_leaves:.1%}",
            f"run {row.best_run + 1}",
        ]
        for row in effect_summaries(plan)
    ]


def point_rows(plan: Plan, points: Sequence[Mapping[str, float]]) -> list[list[str]]:
    """Return the rows of the table of runs: operating point and information, as in ``RUNS_HEAD``.

    The information is cumulative, see ``ranked_runs``.
    """
    return [
        [
            f"run {r + 1}",
            *(number(points[r][n], 4) for n in POINT),
            f"{share:.0%}",
        ]
        for r, share in ranked_runs(plan)
    ]


def _others(plan: Plan) -> list[str]:
    lines = []
    if plan.not_sought:
        names = ", ".join(plan.not_sought)
        lines.append(f"These sensors give the diagnosis no way to seek {names}.")
    if plan.not_planned:
        names = ", ".join(plan.not_planned)
        lines.append(f"Sought in a diagnosis, but not linear, so not planned: {names}.")
    return lines


def _sensors(plan: Plan, also: Mapping[str, Plan]) -> Table | None:
    """Return the table of additional sensors, the most useful first; None if there are none."""
    if not also:
        return None
    rows = [
        [
            name,
            f"{named_effects(more)} of {len(more.effects)}",
            number(gain, 3),
            ", ".join(more.observations),
        ]
        for name, more, gain in by_gain(plan, also)
    ]
    head = ["one sensor more", "named at a moderate size", "sizes fall by a factor of", "rests on"]
    return Table(head, rows, (1, 2))


def _length(plan: Plan) -> str:
    if plan.observations == ("trajectory",):
        return (
            "A diagnosis of these sensors follows the motion over a few windows of each run: "
            "further runs at other points tell more, longer runs do not."
        )
    return "Sizes fall with the root of the length of the runs."


def plan_figure(plan: Plan, also: Mapping[str, Plan]) -> Figure:
    """Draw the size from which each effect is named, over a moderate size, for each plan.

    Line: from the best to the worst place; dot: median; arrow: not named at the worst place.
    """
    plans = [(sensors_text(plan), plan), *((f"+ {n}", p) for n, p in also.items())]
    order = [row.effect for row in effect_summaries(plan)]
    order += [e for _, p in plans[1:] for e in p.effects if e not in order]
    order = list(dict.fromkeys(order))
    colours = (BLUE, *COLOURS)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(9.0, 0.9 + 0.13 * len(order) * (1 + len(plans))), dpi=DPI)
        panel = figure.subplots()
        panel.axvline(1.0, color=GREY, lw=0.8)
        last = float(SIZES[-1])
        for k, (name, sensor_plan) in enumerate(plans):
            colour = colours[k % len(colours)]
            offset = (k - 0.5 * (len(plans) - 1)) / (1.0 + len(plans))
            panel.plot([], [], "o-", color=colour, label=name, ms=4)
            for row in effect_summaries(sensor_plan):
                y = order.index(row.effect) + offset
                sizes = np.array([row.best, row.median, row.worst]) / row.moderate
                low, half, high = np.minimum(sizes, 1.3 * last)
                panel.plot([low, high], [y, y], color=colour, lw=1.2)
                if sizes[1] <= last:
                    panel.plot(half, y, "o", color=colour, ms=4)
                if sizes[2] > last:
                    panel.plot(1.3 * last, y, ">", color=colour, ms=4)
        panel.set_xscale("log")
        panel.set_yticks(range(len(order)), order, color=INK)
        panel.set_ylim(len(order) - 0.4, -0.6)
        panel.set_xlabel("size from which on it is named, over a moderate one")
        panel.legend(loc="lower left", fontsize=8)
    return figure
