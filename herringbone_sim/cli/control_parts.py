"""The four parts of ``control``: each writes tables and figures and returns summary lines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from herringbone_sim.cli import control_tables as tables
from herringbone_sim.cli import control_text as text
from herringbone_sim.cli.control_text import MOTIONS, PRINTED_DELTA_T, TARGETS, Lines
from herringbone_sim.control.amplitude import START_GROUPS, Target, least_amplitudes, run_survey
from herringbone_sim.control.realisation import (
    single_actuators,
    substitutes,
    torque_demands,
    torques_for,
)
from herringbone_sim.control.robustness import start_shares, survival
from herringbone_sim.control.runs import MotionRunner, RunSettings
from herringbone_sim.control.shape import (
    ORDERS,
    around_cancelling,
    cancelling,
    cancels,
    phases,
    shape_map,
)
from herringbone_sim.control.starts import Starts
from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.sweeps.grid import Axis
from herringbone_sim.views.figures import control as control_figures
from herringbone_sim.views.figures import torques as torque_figures
from herringbone_sim.views.figures.style import save

LONG = 3  # factor on the transient for starts whose halves differ


@dataclass(frozen=True)
class Size:
    """Resolution of the four parts.

    Attributes:
        temperatures: number of values of delta_T from 0 to 100 K.
        steps: number of values of K, from 0 to 1, for single actuators from 0 to 2.
        phases: number of control phases over 2 pi; half as many for actuators.
        orders: orders of the control, its frequency over the mesh frequency.
        starts: number of random starts with unequal halves at each operating point.
        settings: length of the runs.
    """

    temperatures: int
    steps: int
    phases: int
    orders: tuple[float, ...]
    starts: int
    settings: RunSettings

    @property
    def delta_T(self) -> Axis:
        return Axis("delta_T", tuple(map(float, np.linspace(0.0, 100.0, self.temperatures))))

    def K(self, largest: float = 1.0) -> Any:
        return np.linspace(0.0, largest, self.steps)

    def longer(self, exponents: bool = False, times: int = 1) -> RunSettings:
        return RunSettings(times * self.settings.transient, self.settings.cycles, exponents)


FULL = Size(41, 51, 32, ORDERS, 100, RunSettings())
QUICK = Size(3, 11, 4, (0.5, 0.6180339887498949, 1.0), 8, RunSettings(transient=200, cycles=80))


def amplitude(runner: MotionRunner, base: Parameters, size: Size, out: Path) -> Lines:
    """Find the least K that reaches a motion of period 1, 2 or 4 at each delta_T.

    Writes ``amplitude.csv`` (every run), ``least.csv`` (least K) and the figure
    ``control_amplitude``; returns the summary lines.
    """
    survey = run_survey(runner, base, size.delta_T, size.K(), settings=size.settings)
    targets = [Target(period, starts) for period in (1, 2, 4) for starts in START_GROUPS]
    least = [a for target in targets for a in least_amplitudes(runner, survey, target)]
    tables.write_runs(out / "amplitude.csv", survey)
    tables.write_least(out / "least.csv", "delta_T", least)
    torque = float(abs(torques_for(build(base), base.control_on, ("c",))[2]))
    save(control_figures.amplitude_figure(survey, least, torque), out, "control_amplitude")
    lines = [*text.least_lines(size.delta_T, least), *text.window_lines(survey)]
    return [*lines, *text.contact_lines(survey)]


def shape(runner: MotionRunner, base: Parameters, size: Size, out: Path) -> Lines:
    """Map the motions over phase and over order of the control, each with K.

    Writes ``phase.csv`` and ``order.csv`` (the maps), ``phase_least.csv`` (least K at each phase),
    ``quiet.csv`` (runs near the control that cancels the mesh error, if one does) and the figure
    ``control_shape``; returns the summary lines.
    """
    K, turn = size.K(), Axis("control_phase", phases(size.phases))
    by_phase = shape_map(runner, base, turn, K, size.longer(exponents=True))
    survey = run_survey(runner, base, turn, K, Starts(alike=1, parted=1), size.settings)
    least = [a for target in TARGETS for a in least_amplitudes(runner, survey, target)]
    # Orders of eighths repeat after 8 mesh cycles, of which several must be observed.
    settings = RunSettings(size.settings.transient, 4 * size.settings.cycles, True, max_period=64)
    by_order = shape_map(runner, base, Axis("control_order", size.orders), K, settings)
    tables.write_shape(out / "phase.csv", by_phase)
    tables.write_shape(out / "order.csv", by_order)
    tables.write_least(out / "phase_least.csv", "control_phase", least)
    lines = text.phase_lines(turn, least)
    ring = cancelling(base) if cancels(base, runner.build(base)) else None
    if ring is None:
        lines.append("no control of this gear cancels its mesh error")
    else:
        near = around_cancelling(runner, base, size.phases // 4 * 2 + 1, size.settings)
        tables.write_runs(out / "quiet.csv", near)
        middle = dict(zip(("K", "control_phase"), ring, strict=True))
        (share,) = start_shares(runner, base, [middle], (1,), size.starts, size.longer(times=LONG))
        lines += [*text.cancelling_lines(least, base), *text.quiet_lines(near, share)]
    save(control_figures.shape_figure(by_phase, by_order, least, ring), out, "control_shape")
    return [*lines, *text.order_lines(by_order)]


def realisation(runner: MotionRunner, base: Parameters, size: Size, out: Path) -> Lines:
    """Find torques on the bodies that realise the control, and those that a motion needs.

    Writes ``actuators.csv`` (fractions of K and torques of each actuator), ``needed.csv`` (torque
    by actuator, target and phase) and the figure ``control_realisation``; returns the summary
    lines.
    """
    model = build(base)
    single, other = single_actuators(model), substitutes(model)
    turn, K = Axis("control_phase", phases(size.phases // 2)), size.K(2.0)
    starts = Starts(alike=1, parted=1)
    demands = []
    for actuator in single:
        gear = actuator.controlled(base)
        survey = run_survey(runner, gear, turn, K, starts, size.settings)
        demands += torque_demands(runner, survey, actuator, TARGETS)
    tables.write_actuators(out / "actuators.csv", (*single, *other))
    tables.write_demands(out / "needed.csv", demands)
    figure = torque_figures.realisation_figure(single, other, demands, base.T_1)
    save(figure, out, "control_realisation")
    return [*text.torque_lines(base, (*single, *other)), *text.demand_lines(demands, base.T_1)]


def robustness(runner: MotionRunner, base: Parameters, size: Size, out: Path) -> Lines:
    """Test whether controlled motions persist when left and right differ.

    Writes ``transverse.csv`` (transverse exponents over delta_T and K), ``starts.csv`` (random
    starts with unequal halves), ``survival.csv`` (gears with unequal halves) and the figure
    ``control_robustness``; returns the summary lines.
    """
    settings = size.longer(times=LONG)
    alike = Starts(0, 0, running=False)
    across = run_survey(runner, base, size.delta_T, size.K(), alike, size.longer(exponents=True))
    places = [
        {"delta_T": delta_T, "K": float(K)}
        for delta_T in PRINTED_DELTA_T
        for K in np.arange(2, 11) / 10
    ]
    places = [one for one in places if runner.built(base.changed(one)) is not None] or places
    shares = start_shares(runner, base, places, (1, 2), size.starts, settings)
    cases = [
        case
        for wanted, K in MOTIONS
        for case in survival(runner, base.changed({"K": K}), wanted, settings)
    ]
    tables.write_runs(out / "transverse.csv", across)
    tables.write_shares(out / "starts.csv", shares)
    tables.write_survival(out / "survival.csv", cases)
    save(torque_figures.robustness_figure(across, shares, cases), out, "control_robustness")
    lines = [*text.transverse_lines(across), *text.share_lines(shares)]
    return [*lines, *text.survival_lines(cases)]


Part = Callable[[MotionRunner, Parameters, Size, Path], Lines]
PARTS: dict[str, Part] = {
    "amplitude": amplitude,
    "shape": shape,
    "realisation": realisation,
    "robustness": robustness,
}
