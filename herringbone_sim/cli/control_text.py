"""Text lines that summarise the results of ``control``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from herringbone_sim.control.amplitude import LeastAmplitude, Survey, Target, windows
from herringbone_sim.control.realisation import BODIES, Actuator, TorqueDemand, smallest_demand
from herringbone_sim.control.robustness import StartShares, Survival
from herringbone_sim.control.runs import LEAST_EXPONENT
from herringbone_sim.control.shape import ShapeMap, best, cancelling, equivalent_error, quiet
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.core.scaling import scales
from herringbone_sim.sweeps.compare import motion
from herringbone_sim.sweeps.grid import Axis
from herringbone_sim.sweeps.observe import NO_TIME

TARGETS = tuple(Target(period, starts) for period in (1, 2) for starts in ("zero", "all"))
PRINTED_DELTA_T = (20.0, 50.0, 70.0)
MOTIONS = ((1, 0.5), (2, 0.3))  # period and K of the paper's Figs. 19 and 18
Lines = list[str]


def least_lines(axis: Axis, amplitudes: Sequence[LeastAmplitude]) -> Lines:
    """Lines on the least K for periods 1 and 2, at the values nearest to ``PRINTED_DELTA_T``."""
    return [
        least_line(f"delta_T {a.value:5.1f}", a)
        for a in amplitudes
        if a.value in nearest(axis, PRINTED_DELTA_T) and a.target.period < 4
    ]


def nearest(axis: Axis, values: Sequence[float]) -> set[float]:
    """For each given value, the nearest value of an axis."""
    return {min(axis.values, key=lambda v: abs(v - value)) for value in values}


def target_text(target: Target, width: int = 5) -> str:
    """Text of a target, such as ``repeats after 2  all``; its starts padded to ``width``."""
    return f"repeats after {target.period}  {target.starts:{width}s}"


def least_line(place: str, amplitude: LeastAmplitude) -> str:
    """Text line on the least amplitudes K of the control torque that reach a target motion.

    Args:
        place: begins the line: the other parameter and its value, such as ``delta_T  20.0``.
        amplitude: the result there; see ``Staircase`` on least, firm, held and pockets.
    """
    stairs = amplitude.staircase
    pockets = " ".join(f"{a:.2f}-{b:.2f}" for a, b in stairs.pockets) or "none"
    return (
        f"{place}  {target_text(amplitude.target, 8)} least {stairs.least:6.3f}  "
        f"firm {stairs.firm:6.3f}  held {stairs.held:6.3f}  pockets {pockets}"
    )


def window_lines(survey: Survey) -> Lines:
    """Lines on the ranges of K of equal period, from the first two starts, at few delta_T.

    P1 has the period of the forcing, that of effects and control together; if these have none in
    common, of the effects.
    """
    lines = []
    for i, value in enumerate(survey.axis.values):
        forcing = int(survey.forcing_cycles[i]) or survey.forcing
        for j in (0, 1) if value in nearest(survey.axis, PRINTED_DELTA_T) else ():
            ranges = windows(survey.K, survey.of("period")[i, :, j])
            texts = (f"{a:.2f}-{b:.2f} {motion(period, forcing)}" for period, a, b in ranges)
            lines.append(f"delta_T {value:5.1f}  {survey.starts.names[j]:8s} {', '.join(texts)}")
    return lines


def contact_lines(survey: Survey) -> Lines:
    """Line on the loss of contact in controlled P1 motions from the zero start, if any."""
    chosen = survey.reached(Target(1, "zero")) & (survey.K > 0.0)
    if not chosen.any():
        return []
    apart, loss = (survey.of(name)[:, :, 0][chosen] for name in ("apart", "contact_loss"))
    return [
        f"P1 from the zero start, {chosen.sum()} runs with K > 0: teeth apart {apart.min():.0%} "
        f"to {apart.max():.0%} of the time, mean {apart.mean():.0%}; {np.mean(loss == 2):.0%} of "
        "the runs strike both flanks"
    ]


def phase_lines(turn: Axis, amplitudes: Sequence[LeastAmplitude]) -> Lines:
    """Lines on the best control phase per target."""
    lines = []
    for target in TARGETS:
        firm = [a.staircase.firm for a in amplitudes if a.target == target]
        phase, K = best(np.array(turn.values), np.array(firm))
        at_zero = firm[int(np.argmin(np.abs(turn.values)))]
        lines.append(
            f"{target_text(target)} best phase {phase:+.3f} rad: firm from K {K:.3f}; phase 0: "
            f"{at_zero:.3f}"
        )
    return lines


def cancelling_lines(amplitudes: Sequence[LeastAmplitude], base: Parameters) -> Lines:
    """Lines on the control that cancels the mesh error, and ``error_lines``; see ``cancels``."""
    K, phase = cancelling(base)
    line = f"the mesh error is cancelled at K {K:g}, phase {phase:+.3f} rad"
    return [line, *error_lines(amplitudes, base)]


def quiet_lines(near: Survey, share: StartShares) -> Lines:
    """Lines on the range of K and phase, near the cancelling control, where contact is kept.

    Args:
        near: survey about the cancelling control, see ``shape.around_cancelling``.
        share: random starts with unequal halves that reach P1 at the cancelling control.
    """
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


def error_lines(amplitudes: Sequence[LeastAmplitude], base: Parameters) -> Lines:
    """Lines on the mesh error [b_c] that acts as error and firm control together, per target.

    Args:
        amplitudes: over the control phase; those without a firm K are left out.
        base: the gear.
    """
    lines = []
    for target in TARGETS:
        gears = [
            base.changed({"K": a.staircase.firm, "control_phase": a.value})
            for a in amplitudes
            if a.target == target and np.isfinite(a.staircase.firm)
        ]
        errors = [equivalent_error(gear)[0] for gear in gears]
        if errors:
            lines.append(
                f"{target_text(target)} where it is firm, error and control amount to a mesh "
                f"error of {min(errors):.3f} to {max(errors):.3f}, mean "
                f"{np.mean(errors):.3f} b_c; the mesh error alone is "
                f"{equivalent_error(base.changed({'K': 0.0}))[0]:g}"
            )
    return lines


def order_lines(shape: ShapeMap) -> Lines:
    """Line per control order: fractions of the K with each kind of motion, and the least K."""
    lines = []
    for i, order in enumerate(shape.axis.values):
        period, chaotic = shape.period[i, 1:], shape.chaotic[i, 1:]
        bears = (period > 0) & ~(shape.transverse[i, 1:] > LEAST_EXPONENT)
        first = np.flatnonzero(period == 1)
        least = f"{shape.K[1 + first[0]]:.2f}" if len(first) else "none"
        still = np.flatnonzero((period > 0) & (shape.apart[i, 1:] < NO_TIME))
        quiet_K = f", contact never lost from {shape.K[1 + still[0]]:.2f}" if len(still) else ""
        lines.append(
            f"order {order:5.3f}  periodic {np.mean(period > 0):4.0%}, of all and stable "
            f"transversally {np.mean(bears):4.0%}  chaotic {np.mean(chaotic):4.0%}  neither "
            f"{np.mean((period == 0) & ~chaotic):4.0%}  least K with the period of the forcing "
            f"{least}{quiet_K}"
        )
    return lines


def torque_lines(base: Parameters, actuators: Sequence[Actuator]) -> Lines:
    """Lines on the torques of each actuator at K = 0.3 (Fig. 18), and their frequency."""
    frequency = base.control_order * base.Omega * scales(base).omega_n / (2.0 * np.pi)
    head = f"torques alternate at {frequency:.0f} Hz; the rated T_1 is {base.T_1:g} N m"
    return [head] + [
        f"{a.name:20s} K = 0.3: {torques_text(0.3 * np.array(a.torques_n_m))}" for a in actuators
    ]


def torques_text(torques_n_m: Any) -> str:
    """Text of torque amplitudes (5,) [N m], without the bodies that are not driven."""
    pairs = zip(BODIES, torques_n_m, strict=True)
    return ", ".join(f"{body} {torque:+.0f} N m" for body, torque in pairs if torque)


def demand_lines(demands: Sequence[TorqueDemand], T_1: float) -> Lines:
    """Lines on the torque that each actuator needs for each target, at phase 0 and at the best."""
    lines = []
    for name in dict.fromkeys(demand.actuator.name for demand in demands):
        for target in TARGETS:
            own = [d for d in demands if (d.actuator.name, d.target) == (name, target)]
            at_zero = min(own, key=lambda demand: abs(demand.phase))
            texts = [demand_text(d, T_1) for d in (at_zero, smallest_demand(own)) if d]
            lines.append(f"{name:14s} {target_text(target)} {'; '.join(texts)}")
    return lines


def demand_text(demand: TorqueDemand, T_1: float) -> str:
    """Text of phase, K and torque of a demand; the torque also over the rated T_1 [N m]."""
    if not np.isfinite(demand.K):
        return f"phase {demand.phase:+.2f}: nothing firm up to K = {demand.largest:g}"
    times = f", {demand.torque_n_m / abs(T_1):.0f} times T_1" if T_1 else ""
    return (
        f"phase {demand.phase:+.2f}: K {demand.K:.3f}, {demand.torque_n_m:.0f} N m on one body"
        f"{times}"
    )


def share_lines(shares: Sequence[StartShares]) -> Lines:
    """Line per delta_T and K: fractions of starts with unequal halves that reach each motion."""
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


def survival_lines(cases: Sequence[Survival]) -> Lines:
    """Line per motion and differing parameter: period, left-right distance, starts reaching it."""
    lines = []
    for wanted, what in dict.fromkeys((s.wanted, s.what) for s in cases):
        texts = [
            f"{s.difference:.0%} {motion(s.period)} {s.distance:.3f} b_c, {s.parted}/{s.starts}"
            + ("" if s.from_running else ", not from running")
            + (" (distance of that from running)" if s.from_running and not s.from_zero else "")
            for s in cases
            if (s.wanted, s.what) == (wanted, what)
        ]
        lines.append(f"K {dict(MOTIONS)[wanted]}  {what:10s} {'; '.join(texts)}")
    return lines


def transverse_lines(across: Survey) -> Lines:
    """Lines on the transverse stability of periodic motions over K, one for each printed delta_T.

    A line gives the lowest and the highest K with a transversally stable periodic motion, the
    same of unstable ones, and the least transverse exponent [1/tau]. Between two such K not every
    motion need be periodic, or of that stability.

    Args:
        across: survey over delta_T and K with exponents; its first start is used, the initial
            state of the gear. Lines are for the delta_T nearest to ``PRINTED_DELTA_T``, where any
            motion is periodic.
    """
    lines = []
    transverse = across.of("transverse")[:, :, 0]
    periodic = (across.of("period")[:, :, 0] > 0) & np.isfinite(transverse)
    for delta_T, row, rates in zip(across.axis.values, periodic, transverse, strict=True):
        if delta_T in nearest(across.axis, PRINTED_DELTA_T) and row.any():
            stable, lost = across.K[row & (rates < 0.0)], across.K[row & (rates > 0.0)]
            span = f"K {stable[0]:.2f} to {stable[-1]:.2f}" if len(stable) else "nowhere"
            more = f"; unstable from K {lost[0]:.2f} to {lost[-1]:.2f}" if len(lost) else ""
            lines.append(
                f"delta_T {delta_T:5.1f}  periodic and transversally stable {span}{more}; "
                f"strongest {np.nanmin(rates[row]):+.4f} per tau"
            )
    return lines
