"""The four parts of ``control``: run, write tables, draw; each gives lines to print."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from herringbone_sim.control.amplitude import FROM, Least, Survey, least_amplitudes, survey
from herringbone_sim.control.realisation import (
    BODIES,
    MESHES,
    Needed,
    easiest,
    needed,
    single_actuators,
    substitutes,
)
from herringbone_sim.control.robustness import (
    Gathered,
    Survival,
    gathered,
    survival,
    transverse_map,
)
from herringbone_sim.control.runs import LEAST_EXPONENT, Look, Runs
from herringbone_sim.control.shape import ORDERS, Shape, best, cancelling, phases, shape_map
from herringbone_sim.control.starts import Starts
from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.sweeps.grid import Axis
from herringbone_sim.views import control_figures
from herringbone_sim.views.figures import save

ASKED = tuple((wanted, who) for wanted in (1, 2) for who in ("zero", "all"))
SHOWN_HEATS = (20.0, 50.0, 70.0)
MOTIONS = ((1, 0.5), (2, 0.3))  # period and K of the paper's Figs. 19 and 18
LONG = 3  # times the transient, where left and right have to find each other
Lines = list[str]


@dataclass(frozen=True)
class Size:
    """How fine all is asked.

    Attributes:
        heats: values of delta_T from 0 to 100 K.
        steps: values of K from 0 to 1, and to 2 for single actuators.
        phases: of the control, round the circle; half as many for each actuator.
        orders: of the control.
        starts: random ones with unlike halves at each place.
        look: how long each motion is looked at.
    """

    heats: int
    steps: int
    phases: int
    orders: tuple[float, ...]
    starts: int
    look: Look

    @property
    def delta_T(self) -> Axis:
        return Axis("delta_T", tuple(map(float, np.linspace(0.0, 100.0, self.heats))))

    def K(self, largest: float = 1.0) -> Any:
        return np.linspace(0.0, largest, self.steps)

    def longer(self, exponents: bool = False, times: int = 1) -> Look:
        return Look(times * self.look.transient, self.look.cycles, exponents)


FULL = Size(26, 51, 32, ORDERS, 100, Look())
QUICK = Size(3, 11, 4, (0.5, 0.6180339887498949, 1.0), 8, Look(transient=200, cycles=80))


def amplitude(runs: Runs, base: Parameters, size: Size, out: Path) -> Lines:
    """``amplitude.csv``: every run; ``least.csv``: the least K; ``control_amplitude.png``."""
    over = survey(runs, base, size.delta_T, size.K(), look=size.look)
    found = [
        one
        for wanted in (1, 2, 4)
        for who in FROM
        for one in least_amplitudes(runs, over, wanted, who)
    ]
    write_runs(out / "amplitude.csv", over)
    write_least(out / "least.csv", "delta_T", found)
    torque = build(base).scales.control_torque_n_m(1.0)
    save(control_figures.amplitude_figure(over, found, torque), out, "control_amplitude")
    return [
        least_line(f"delta_T {one.value:5.1f}", one)
        for one in found
        if one.value in nearest(size.delta_T, SHOWN_HEATS) and one.wanted < 4
    ]


def nearest(axis: Axis, values: Sequence[float]) -> set[float]:
    """The values of an axis that are nearest to some."""
    return {min(axis.values, key=lambda v: abs(v - value)) for value in values}


def least_line(place: str, one: Least) -> str:
    """A least amplitude in words."""
    stairs = one.staircase
    pockets = " ".join(f"{a:.2f}-{b:.2f}" for a, b in stairs.pockets) or "none"
    return (
        f"{place}  repeats after {one.wanted}  {one.who:8s} least {stairs.least:6.3f}  "
        f"firm {stairs.firm:6.3f}  held {stairs.held:6.3f}  pockets {pockets}"
    )


def shape(runs: Runs, base: Parameters, size: Size, out: Path) -> Lines:
    """``phase.csv``, ``order.csv``: maps; ``phase_least.csv``; ``control_shape.png``."""
    K, turn = size.K(), Axis("control_phase", phases(size.phases))
    by_phase = shape_map(runs, base, turn, K, size.longer(exponents=True))
    tried = survey(runs, base, turn, K, Starts(alike=1, parted=1), size.look)
    least = [one for wanted, who in ASKED for one in least_amplitudes(runs, tried, wanted, who)]
    # Orders of eighths repeat after 8 mesh cycles, so there must be time for a few of those.
    look = Look(size.look.transient, 4 * size.look.cycles, True, max_period=64)
    by_order = shape_map(runs, base, Axis("control_order", size.orders), K, look)
    write_shape(out / "phase.csv", by_phase)
    write_shape(out / "order.csv", by_order)
    write_least(out / "phase_least.csv", "control_phase", least)
    figure = control_figures.shape_figure(by_phase, by_order, least, cancelling(base))
    save(figure, out, "control_shape")
    return [*phase_lines(turn, least, base), *order_lines(by_order)]


def phase_lines(turn: Axis, least: Sequence[Least], base: Parameters) -> Lines:
    """The best phase for each motion, beside phase 0, and the phase that cancels the error."""
    lines = []
    for wanted, who in ASKED:
        firm = [one.staircase.firm for one in least if (one.wanted, one.who) == (wanted, who)]
        phase, K = best(np.array(turn.values), np.array(firm))
        at_zero = firm[int(np.argmin(np.abs(turn.values)))]
        lines.append(
            f"repeats after {wanted}  {who:5s} best phase {phase:+.3f} rad: firm from K "
            f"{K:.3f}; phase 0: {at_zero:.3f}"
        )
    K, phase = cancelling(base)
    return [*lines, f"the mesh error is cancelled at K {K:g}, phase {phase:+.3f} rad"]


def order_lines(found: Shape) -> Lines:
    """What each order does, as shares of the values of K."""
    lines = []
    for i, order in enumerate(found.axis.values):
        period, chaotic = found.period[i, 1:], found.chaotic[i, 1:]
        bears = (period > 0) & ~(found.transverse[i, 1:] > LEAST_EXPONENT)
        first = np.flatnonzero(period == 1)
        least = f"{found.K[1 + first[0]]:.2f}" if len(first) else "none"
        lines.append(
            f"order {order:5.3f}  periodic {np.mean(period > 0):4.0%}, of all and stable "
            f"transversally {np.mean(bears):4.0%}  chaotic {np.mean(chaotic):4.0%}  neither "
            f"{np.mean((period == 0) & ~chaotic):4.0%}  least K with the period of the forcing "
            f"{least}"
        )
    return lines


def realisation(runs: Runs, base: Parameters, size: Size, out: Path) -> Lines:
    """``actuators.csv``: patterns and torques; ``needed.csv``; ``control_realisation.png``."""
    model = build(base)
    single, other = single_actuators(model), substitutes(model)
    turn, K = Axis("control_phase", phases(size.phases // 2)), size.K(2.0)
    starts = Starts(alike=1, parted=1)
    found = [
        one for a in single for one in needed(runs, base, a, turn, K, ASKED, starts, size.look)
    ]
    head = ["actuator", *(f"share_{m}" for m in MESHES), *(f"n_m_per_K_{b}" for b in BODIES)]
    rows = ([a.name, *a.pattern, *a.torques_n_m] for a in (*single, *other))
    write(out / "actuators.csv", head, rows)
    write_needed(out / "needed.csv", found)
    figure = control_figures.realisation_figure(single, other, found, base.T_1)
    save(figure, out, "control_realisation")
    torques = [
        f"{a.name:20s} K = 0.3: " + torques_text(0.3 * np.array(a.torques_n_m))
        for a in (*single, *other)
    ]
    return [*torques, *needed_lines(found, base.T_1)]


def torques_text(torques_n_m: Any) -> str:
    """Torques on the bodies that are driven."""
    pairs = zip(BODIES, torques_n_m, strict=True)
    return ", ".join(f"{body} {torque:+.0f} N m" for body, torque in pairs if torque)


def needed_lines(found: Sequence[Needed], T_1: float) -> Lines:
    """Torque that each actuator needs at phase 0 and at its best phase."""
    lines = []
    for name in dict.fromkeys(one.actuator.name for one in found):
        for wanted, who in ASKED:
            own = [n for n in found if (n.actuator.name, n.wanted, n.who) == (name, wanted, who)]
            at_zero = min(own, key=lambda n: abs(n.phase))
            texts = [needed_text(one, T_1) for one in (at_zero, easiest(own)) if one]
            lines.append(f"{name:14s} repeats after {wanted}  {who:5s} {'; '.join(texts)}")
    return lines


def needed_text(one: Needed, T_1: float) -> str:
    """A need in words."""
    if not np.isfinite(one.K):
        return f"phase {one.phase:+.2f}: nothing firm up to K = {one.largest:g}"
    times = one.torque_n_m / T_1
    return (
        f"phase {one.phase:+.2f}: K {one.K:.3f}, {one.torque_n_m:.0f} N m on one body, "
        f"{times:.0f} times T_1"
    )


def robustness(runs: Runs, base: Parameters, size: Size, out: Path) -> Lines:
    """``transverse.csv``, ``starts.csv``, ``survival.csv``; ``control_robustness.png``."""
    look = size.longer(times=LONG)
    across = transverse_map(runs, base, size.delta_T, size.K(), size.longer(exponents=True))
    places = [
        {"delta_T": heat, "K": float(K)} for heat in SHOWN_HEATS for K in np.arange(2, 11) / 10
    ]
    shares = gathered(runs, base, places, (1, 2), size.starts, look)
    lasting = [
        one
        for wanted, K in MOTIONS
        for one in survival(runs, base.changed({"K": K}), wanted, look)
    ]
    write_runs(out / "transverse.csv", across)
    head = ["delta_T", "K", "wanted", "starts", "reached", "parted", "share", "low", "high"]
    counts = (
        [*s.values.values(), s.wanted, s.starts, s.reached, s.parted, s.share, s.low, s.high]
        for s in shares
    )
    write(out / "starts.csv", head, counts)
    write(out / "survival.csv", list(vars(lasting[0])), (vars(one).values() for one in lasting))
    save(control_figures.robustness_figure(across, shares, lasting), out, "control_robustness")
    return [*transverse_lines(across), *share_lines(shares), *survival_lines(lasting)]


def share_lines(shares: Sequence[Gathered]) -> Lines:
    """A line a place: shares of starts with unlike halves."""
    lines = []
    for place in dict.fromkeys((s.values["delta_T"], s.values["K"]) for s in shares):
        texts = [
            f"after {s.wanted}: {s.share:4.0%} ({s.low:.0%} to {s.high:.0%}) and {s.parted} apart"
            for s in shares
            if (s.values["delta_T"], s.values["K"]) == place
        ]
        head = f"delta_T {place[0]:g} K {place[1]:.1f}  of {shares[0].starts} unlike starts alike"
        lines.append(f"{head} {'; '.join(texts)}")
    return lines


def survival_lines(lasting: Sequence[Survival]) -> Lines:
    """A line a motion and kind of difference: distance, and starts that do not lead there."""
    lines = []
    for wanted, what in dict.fromkeys((s.wanted, s.what) for s in lasting):
        texts = [
            f"{s.difference:.0%} P{s.period:g} {s.distance:.3f} b_c, {s.parted}/{s.starts}"
            + ("" if s.from_running else ", not from running")
            for s in lasting
            if (s.wanted, s.what) == (wanted, what)
        ]
        lines.append(f"K {dict(MOTIONS)[wanted]}  {what:10s} {'; '.join(texts)}")
    return lines


def transverse_lines(across: Survey) -> Lines:
    """Where a periodic motion with equal halves is stable across them."""
    lines = []
    periodic = across.of("period")[:, :, 0] > 0
    transverse = across.of("transverse")[:, :, 0]
    for heat, row, rates in zip(across.axis.values, periodic, transverse, strict=True):
        if heat in nearest(across.axis, SHOWN_HEATS) and row.any():
            stable, lost = across.K[row & (rates < 0.0)], across.K[row & (rates > 0.0)]
            span = f"K {stable[0]:.2f} to {stable[-1]:.2f}" if len(stable) else "nowhere"
            more = f"; unstable from K {lost[0]:.2f} to {lost[-1]:.2f}" if len(lost) else ""
            lines.append(
                f"delta_T {heat:5.1f}  periodic and transversally stable {span}{more}; "
                f"strongest {np.nanmin(rates[row]):+.4f} per tau"
            )
    return lines


Part = Callable[[Runs, Parameters, Size, Path], Lines]
PARTS: dict[str, Part] = {
    "amplitude": amplitude,
    "shape": shape,
    "realisation": realisation,
    "robustness": robustness,
}


def write(path: Path, head: Sequence[str], rows: Iterable[Iterable[Any]]) -> None:
    """A table; floats short, NaN empty."""
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(head)
        table.writerows([_short(value) for value in row] for row in rows)


def _short(value: Any) -> Any:
    if not isinstance(value, (float, np.floating)):
        return value
    return f"{value:.6g}" if np.isfinite(value) else ""


def write_runs(path: Path, over: Survey) -> None:
    """A row a run of a survey."""
    names = ("period", "exponent", "within", "transverse", "asymmetry", "contact_loss", "apart")
    columns = [getattr(over.motions, name) for name in names]
    places = (
        (value, K, f"{kind} {i}")
        for value in over.axis.values
        for K in over.K
        for i, kind in enumerate(over.starts.names)
    )
    rows = ((*p, *c) for p, c in zip(places, zip(*columns, strict=True), strict=True))
    write(path, [over.axis.name, "K", "start", *names], rows)


def write_least(path: Path, name: str, found: Sequence[Least]) -> None:
    """A row a least amplitude; pockets as ``first-last`` on the grid of K."""
    rows = (
        [
            *(one.value, one.wanted, one.who, one.staircase.least, one.staircase.firm),
            *(one.staircase.held, one.half_width, one.staircase.share),
            ";".join(f"{a:g}-{b:g}" for a, b in one.staircase.pockets),
        ]
        for one in found
    )
    head = [name, "wanted", "starts", "least_K", "firm_from_K", "held_from_K", "half_width"]
    head += ["share", "pockets"]
    write(path, head, rows)


def write_shape(path: Path, found: Shape) -> None:
    """A row a value and K."""
    names = ("period", "exponent", "exponent_error", "transverse", "chaotic", "apart")
    rows = (
        [value, K, *(getattr(found, name)[i, j] for name in names)]
        for i, value in enumerate(found.axis.values)
        for j, K in enumerate(found.K)
    )
    write(path, [found.axis.name, "K", *names], rows)


def write_needed(path: Path, found: Sequence[Needed]) -> None:
    """A row an actuator, motion, kind of starts and phase."""
    rows = (
        [n.actuator.name, n.wanted, n.who, n.phase, n.K, n.largest, n.torque_n_m] for n in found
    )
    head = ["actuator", "wanted", "starts", "phase", "K", "largest_K", "torque_n_m"]
    write(path, head, rows)
