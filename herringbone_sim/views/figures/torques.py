"""Figures of the study ``control``: torques that realise a control, and its robustness."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from herringbone_sim.control.amplitude import Survey, Target
from herringbone_sim.control.realisation import Actuator, TorqueDemand, smallest_demand
from herringbone_sim.control.robustness import SHARES, StartShares, Survival
from herringbone_sim.views.figures.maps import draw_rates
from herringbone_sim.views.figures.style import BLUE, FRAMED_STYLE, GREEN, ORANGE, parameter_label

COLOURS = (BLUE, ORANGE, GREEN, "#CC79A7", "#E69F00", "#56B4E9")
MESH_LABELS = (
    *(r"$\mathrm{sp}^\mathrm{L}$", r"$\mathrm{sp}^\mathrm{R}$"),
    *(r"$\mathrm{rp}^\mathrm{L}$", r"$\mathrm{rp}^\mathrm{R}$"),
)
MARKS: dict[float, str] = {1.0: "o", 2.0: "s"}  # by period; others: a diamond


def realisation_figure(
    single: Sequence[Actuator],
    substitutes: Sequence[Actuator],
    demands: Sequence[TorqueDemand],
    T_1: float,
) -> Figure:
    """Draw the pattern of each actuator (part of K on each mesh) and the least torque it needs.

    Args:
        single: actuators of one kind of body: carrier, sun, planets, or one side of these.
        substitutes: other actuators with the pattern of the carrier; their torque is scaled from
            the demands of the carrier.
        demands: of ``single``, for P1 and P2 from all starts.
        T_1: rated input torque, on the sun [N m].
    """
    ways = [*single, *substitutes]
    with matplotlib.rc_context(FRAMED_STYLE):
        figure = Figure(figsize=(9.2, 3.7))
        left, right = figure.subplots(1, 2, width_ratios=(1.0, 2.3))
        _draw_patterns(left, ways)
        _draw_torques(right, ways, demands, T_1)
        return figure


def _draw_patterns(axes: Axes, ways: Sequence[Actuator]) -> None:
    patterns = np.array([a.pattern for a in ways])
    axes.imshow(patterns, cmap="RdBu_r", vmin=-1.8, vmax=1.8, aspect="auto")
    for (row, column), value in np.ndenumerate(patterns):
        axes.text(column, row, f"{value:+g}" if value else "0", ha="center", va="center")
    axes.set_xticks(range(4), MESH_LABELS)
    axes.set_yticks(range(len(ways)), [a.name for a in ways])
    axes.tick_params(length=0)
    axes.set_title("share of K on each mesh")


def _draw_torques(
    axes: Axes, ways: Sequence[Actuator], demands: Sequence[TorqueDemand], T_1: float
) -> None:
    marks = ((1, "o", "P1"), (2, "s", "P2 or P1"))
    torques = [abs(T_1)] if T_1 else []  # that the axis must show
    for rated in torques:
        axes.axvline(rated, color=ORANGE, linewidth=1.6)
        words = f"rated $T_1$ = {T_1:g} N m"
        axes.text(rated * 1.08, len(ways) - 0.8, words, color=ORANGE, va="center")
    for row, actuator in enumerate(ways):
        name = actuator.name
        if all(d.actuator.name != name for d in demands):
            name = "carrier"
        scale = actuator.largest_n_m / next(a for a in ways if a.name == name).largest_n_m
        for shift, (wanted, mark, _) in zip((-0.13, 0.13), marks, strict=True):
            target = Target(wanted, "all")
            own = [d for d in demands if (d.actuator.name, d.target) == (name, target)]
            at_zero = min(own, key=lambda n: abs(n.phase))
            for need, fill in ((smallest_demand(own), BLUE), (at_zero, "white")):
                if need is not None and np.isfinite(need.K):
                    x = need.torque_n_m * scale
                    torques.append(x)
                    axes.plot(x, row + shift, mark, mec=BLUE, mew=1.3, ms=6.5, mfc=fill)
    low, high = min(torques, default=1.0), max(torques, default=1.0)
    axes.set(xscale="log", xlim=(0.7 * low, max(3e5, 1.4 * high)), yticks=[])
    axes.set_ylim(len(ways) - 0.5, -0.5)
    axes.set_xlabel("largest torque amplitude on one body [N m]")
    axes.set_title("least torque that reaches the motion from all starts, over 0.1 of K")
    axes.grid(axis="x", color="#e3e5e9", linewidth=0.6)
    axes.set_axisbelow(True)
    handles = [
        Line2D([], [], color="none", mec=BLUE, mew=1.3, marker=m, mfc=fill, label=f"{t}, {phase}")
        for fill, phase in ((BLUE, "best phase"), ("white", "phase 0"))
        for _, m, t in marks
    ]
    axes.legend(handles=handles, loc="lower right", fontsize=8, frameon=True, framealpha=0.9)


def robustness_figure(
    across: Survey, shares: Sequence[StartShares], cases: Sequence[Survival]
) -> Figure:
    """Draw transverse exponents, starts with unequal halves, and gears with unequal halves.

    Args:
        across: survey over a parameter and K; its first start is drawn.
        shares: random starts at several temperature rises and K, for P1 and P2.
        cases: gears with unequal halves, for P1 and P2.
    """
    with matplotlib.rc_context(FRAMED_STYLE):
        figure = Figure(figsize=(9.2, 6.8))
        (a, b), (c, d) = figure.subplots(2, 2)
        label = r"$\lambda_\perp$ per $\tau$"
        draw_rates(a, across.axis.values, across.K, across.of("transverse")[:, :, 0], label)
        a.set(xlabel=parameter_label(across.axis.name), ylabel=parameter_label("K"))
        a.set_title("transverse exponent: red, left and right part")
        _draw_shares(b, shares)
        for axes, wanted in ((c, 1), (d, 2)):
            _draw_survival(axes, [case for case in cases if case.wanted == wanted])
        return figure


def _draw_shares(axes: Axes, shares: Sequence[StartShares]) -> None:
    """Draw over K, for each delta_T, the percentage of starts that end in P1 with equal halves.

    Bars: 95 % interval. Dashed: starts that end in P2 or P1 with unequal halves.
    """
    temperatures = sorted({s.values["delta_T"] for s in shares})
    for colour, delta_T in zip(COLOURS, temperatures, strict=False):
        once, twice = (
            [s for s in shares if (s.values["delta_T"], s.wanted) == (delta_T, wanted)]
            for wanted in (1, 2)
        )
        K = [s.values["K"] for s in once]
        share = 100.0 * np.array([s.share for s in once])
        ends = 100.0 * np.array([[s.share - s.low, s.high - s.share] for s in once]).T
        options: Any = {"color": colour, "marker": "o", "ms": 3.5, "lw": 1.2, "capsize": 2.0}
        label = rf"$\Delta T$ = {delta_T:g} K"
        axes.errorbar(K, share, yerr=np.maximum(ends, 0.0), label=label, **options)
        parted = [100.0 * s.parted / s.starts for s in twice]
        axes.plot(K, parted, color=colour, lw=1.2, ls=(0, (3, 1.5)))
    axes.set(xlabel=parameter_label("K"), ylabel="share of the starts [%]", ylim=(-3.0, 103.0))
    axes.set_title(f"{shares[0].starts} unlike starts: end in P1 alike (broken: P2 or P1 apart)")
    axes.legend(fontsize=8, loc="center", frameon=True, framealpha=0.9)


def _draw_survival(axes: Axes, cases: Sequence[Survival]) -> None:
    """Draw the left-right distance of the motion over the difference of the gear's halves.

    Discs: P1, squares: P2, diamonds: other periods, crosses: reached from neither start.
    """
    for colour, what in zip(COLOURS, dict.fromkeys(c.what for c in cases), strict=False):
        own = [c for c in cases if c.what == what]
        x, y = [100.0 * c.difference for c in own], [c.distance for c in own]
        axes.plot(x, y, color=colour, lw=0.8, alpha=0.5)
        axes.plot([], [], "o", color=colour, ms=5, label=what)
        for place, value, case in zip(x, y, own, strict=True):
            every = case.from_zero and case.from_running and case.parted == case.starts
            fill = colour if every else "white"
            mark = MARKS.get(case.period if case.from_zero else case.wanted, "D")
            axes.plot(place, value, mark, color=colour, mfc=fill, mew=1.3, ms=5)
        lost = [place for place, value in zip(x, y, strict=True) if np.isnan(value)]
        rim = axes.get_xaxis_transform()
        axes.plot(lost, [0.97] * len(lost), "x", color=colour, mew=1.6, transform=rim)
    axes.set(xscale="log", yscale="log", ylabel=r"RMS of left less right / $b_c$")
    axes.set_ylim(4e-4, 0.3)
    ticks = [100.0 * share for share in SHARES]
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.xaxis.set_minor_formatter("")
    axes.set_xlabel("difference of left and right [%]")
    axes.set_title(f"P{cases[0].wanted} with unlike halves (open: not from every start)")
    axes.legend(fontsize=8, ncols=3, loc="lower center")
