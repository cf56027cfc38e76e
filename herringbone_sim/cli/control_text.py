"""What ``control`` found, in lines to print."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from herringbone_sim.control.amplitude import Least, Survey, windows
from herringbone_sim.control.realisation import BODIES, Actuator, Needed, easiest
from herringbone_sim.control.robustness import Gathered, Survival
from herringbone_sim.control.runs import LEAST_EXPONENT
from herringbone_sim.control.shape import Shape, best, cancelling, equivalent_error, quiet
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.core.scaling import scales
from herringbone_sim.sweeps.grid import Axis
from herringbone_sim.sweeps.observe import NO_TIME

ASKED = tuple((wanted, who) for wanted in (1, 2) for who in ("zero", "all"))
SHOWN_HEATS = (20.0, 50.0, 70.0)
MOTIONS = ((1, 0.5), (2, 0.3))  # period and K of the paper's Figs. 19 and 18
Lines = list[str]


def least_lines(axis: Axis, found: Sequence[Least]) -> Lines:
    """Least amplitudes for P1 and P2 at the temperatures shown."""
    return [
        least_line(f"delta_T {one.value:5.1f}", one)
        for one in found
        if one.value in nearest(axis, SHOWN_HEATS) and one.wanted < 4
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


def window_lines(over: Survey) -> Lines:
    """Periods along K from single starts, at the temperatures shown."""
    lines = []
    for i, value in enumerate(over.axis.values):
        for j in (0, 1) if value in nearest(over.axis, SHOWN_HEATS) else ():
            found = windows(over.K, over.of("period")[i, :, j])
            texts = (f"{a:.2f}-{b:.2f} {motion(period)}" for period, a, b in found)
            lines.append(f"delta_T {value:5.1f}  {over.starts.names[j]:8s} {', '.join(texts)}")
    return lines


def motion(period: float) -> str:
    """``P2`` or ``aperiodic``."""
    return f"P{period:g}" if period else "aperiodic"


def contact_lines(over: Survey) -> Lines:
    """What teeth do in the controlled motions of period 1 from the zero start."""
    chosen = (over.of("period")[:, :, 0] == 1) & (over.K > 0.0)
    if not chosen.any():
        return []
    apart, loss = (over.of(name)[:, :, 0][chosen] for name in ("apart", "contact_loss"))
    return [
        f"P1 from the zero start, {chosen.sum()} runs with K > 0: teeth apart {apart.min():.0%} "
        f"to {apart.max():.0%} of the time, mean {apart.mean():.0%}; {np.mean(loss == 2):.0%} of "
        "the runs strike both flanks"
    ]


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
    lines.append(f"the mesh error is cancelled at K {K:g}, phase {phase:+.3f} rad")
    return [*lines, *error_lines(least, base)]


def quiet_lines(near: Survey, share: Gathered) -> Lines:
    """How well the control has to meet the mesh error for teeth to stay in contact, and the share
    of starts with unlike halves that end in P1 where it is met."""
    still = quiet(near)
    middle, phases = len(near.K) // 2, np.array(near.axis.values)
    lines = []
    for kind in dict.fromkeys(near.starts.names):
        own = np.all(still[:, :, [name == kind for name in near.starts.names]], axis=2)
        head = f"quiet (P1, contact never lost) from {kind:8s}"
        if not own[middle, middle]:
            lines.append(f"{head} not even where the mesh error is cancelled")
            continue
        K, turn = near.K[own[middle]], phases[own[:, middle]] - phases[middle]
        lines.append(
            f"{head} within K {K[0]:.4f} to {K[-1]:.4f} at that phase, {turn[0]:+.4f} to "
            f"{turn[-1]:+.4f} rad at that K"
        )
    return [
        *lines,
        f"where the mesh error is cancelled {share.reached} of {share.starts} starts with unlike "
        f"halves end alike in P1 ({share.low:.0%} to {share.high:.0%})",
    ]


def error_lines(least: Sequence[Least], base: Parameters) -> Lines:
    """The mesh error that the gear would need instead of the control, over all phases."""
    lines = []
    for wanted, who in ASKED:
        errors = [
            equivalent_error(base.changed({"K": one.staircase.firm, "control_phase": one.value}))[
                0
            ]
            for one in least
            if (one.wanted, one.who) == (wanted, who) and np.isfinite(one.staircase.firm)
        ]
        if errors:
            lines.append(
                f"repeats after {wanted}  {who:5s} where it is firm, error and control amount to "
                f"a mesh error of {min(errors):.3f} to {max(errors):.3f}, mean "
                f"{np.mean(errors):.3f} b_c; e_m alone is {base.e_m:g}"
            )
    return lines


def order_lines(found: Shape) -> Lines:
    """What each order does, as shares of the values of K."""
    lines = []
    for i, order in enumerate(found.axis.values):
        period, chaotic = found.period[i, 1:], found.chaotic[i, 1:]
        bears = (period > 0) & ~(found.transverse[i, 1:] > LEAST_EXPONENT)
        first = np.flatnonzero(period == 1)
        least = f"{found.K[1 + first[0]]:.2f}" if len(first) else "none"
        still = np.flatnonzero((period > 0) & (found.apart[i, 1:] < NO_TIME))
        quiet_K = f", contact never lost from {found.K[1 + still[0]]:.2f}" if len(still) else ""
        lines.append(
            f"order {order:5.3f}  periodic {np.mean(period > 0):4.0%}, of all and stable "
            f"transversally {np.mean(bears):4.0%}  chaotic {np.mean(chaotic):4.0%}  neither "
            f"{np.mean((period == 0) & ~chaotic):4.0%}  least K with the period of the forcing "
            f"{least}{quiet_K}"
        )
    return lines


def torque_lines(base: Parameters, ways: Sequence[Actuator]) -> Lines:
    """Torques of each actuator at the K of the paper's Fig. 18, and how fast they alternate."""
    frequency = base.control_order * base.Omega * scales(base).omega_n / (2.0 * np.pi)
    head = f"torques alternate at {frequency:.0f} Hz; the rated T_1 is {base.T_1:g} N m"
    return [head] + [
        f"{one.name:20s} K = 0.3: {torques_text(0.3 * np.array(one.torques_n_m))}" for one in ways
    ]


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
            f"{s.difference:.0%} {motion(s.period)} {s.distance:.3f} b_c, {s.parted}/{s.starts}"
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
