"""The four parts of ``control``: run, write tables, draw; each gives lines to print."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from herringbone_sim.cli import control_tables as tables
from herringbone_sim.cli import control_text as text
from herringbone_sim.cli.control_text import ASKED, MOTIONS, SHOWN_HEATS, Lines
from herringbone_sim.control.amplitude import FROM, least_amplitudes, survey
from herringbone_sim.control.realisation import needed, single_actuators, substitutes
from herringbone_sim.control.robustness import gathered, survival, transverse_map
from herringbone_sim.control.runs import Look, Runs
from herringbone_sim.control.shape import ORDERS, around_cancelling, cancelling, phases, shape_map
from herringbone_sim.control.starts import Starts
from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.sweeps.grid import Axis
from herringbone_sim.views.figures import control as control_figures
from herringbone_sim.views.figures import torques as torque_figures
from herringbone_sim.views.figures.style import save

LONG = 3  # times the transient, where left and right have to find each other


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


FULL = Size(41, 51, 32, ORDERS, 100, Look())
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
    tables.write_runs(out / "amplitude.csv", over)
    tables.write_least(out / "least.csv", "delta_T", found)
    torque = build(base).scales.control_torque_n_m(1.0)
    save(control_figures.amplitude_figure(over, found, torque), out, "control_amplitude")
    lines = [*text.least_lines(size.delta_T, found), *text.window_lines(over)]
    return [*lines, *text.contact_lines(over)]


def shape(runs: Runs, base: Parameters, size: Size, out: Path) -> Lines:
    """``phase.csv``, ``order.csv``: maps; ``phase_least.csv``, ``quiet.csv``; a figure."""
    K, turn = size.K(), Axis("control_phase", phases(size.phases))
    by_phase = shape_map(runs, base, turn, K, size.longer(exponents=True))
    tried = survey(runs, base, turn, K, Starts(alike=1, parted=1), size.look)
    least = [one for wanted, who in ASKED for one in least_amplitudes(runs, tried, wanted, who)]
    # Orders of eighths repeat after 8 mesh cycles, so there must be time for a few of those.
    look = Look(size.look.transient, 4 * size.look.cycles, True, max_period=64)
    by_order = shape_map(runs, base, Axis("control_order", size.orders), K, look)
    tables.write_shape(out / "phase.csv", by_phase)
    tables.write_shape(out / "order.csv", by_order)
    tables.write_least(out / "phase_least.csv", "control_phase", least)
    near = around_cancelling(runs, base, size.phases // 4 * 2 + 1, size.look)
    tables.write_runs(out / "quiet.csv", near)
    middle = dict(zip(("K", "control_phase"), cancelling(base), strict=True))
    (share,) = gathered(runs, base, [middle], (1,), size.starts, size.longer(times=LONG))
    figure = control_figures.shape_figure(by_phase, by_order, least, cancelling(base))
    save(figure, out, "control_shape")
    lines = [*text.phase_lines(turn, least, base), *text.quiet_lines(near, share)]
    return [*lines, *text.order_lines(by_order)]


def realisation(runs: Runs, base: Parameters, size: Size, out: Path) -> Lines:
    """``actuators.csv``: patterns and torques; ``needed.csv``; ``control_realisation.png``."""
    model = build(base)
    single, other = single_actuators(model), substitutes(model)
    turn, K = Axis("control_phase", phases(size.phases // 2)), size.K(2.0)
    starts = Starts(alike=1, parted=1)
    found = [
        one for a in single for one in needed(runs, base, a, turn, K, ASKED, starts, size.look)
    ]
    tables.write_actuators(out / "actuators.csv", (*single, *other))
    tables.write_needed(out / "needed.csv", found)
    figure = torque_figures.realisation_figure(single, other, found, base.T_1)
    save(figure, out, "control_realisation")
    return [*text.torque_lines(base, (*single, *other)), *text.needed_lines(found, base.T_1)]


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
    tables.write_runs(out / "transverse.csv", across)
    tables.write_shares(out / "starts.csv", shares)
    tables.write_survival(out / "survival.csv", lasting)
    save(torque_figures.robustness_figure(across, shares, lasting), out, "control_robustness")
    lines = [*text.transverse_lines(across), *text.share_lines(shares)]
    return [*lines, *text.survival_lines(lasting)]


Part = Callable[[Runs, Parameters, Size, Path], Lines]
PARTS: dict[str, Part] = {
    "amplitude": amplitude,
    "shape": shape,
    "realisation": realisation,
    "robustness": robustness,
}
