"""Remove sensor effects of known size from the motion channels and the clock of a run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.layout import QUANTITIES
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.effects.channels import between, channels_of
from herringbone_sim.effects.effect import Active
from herringbone_sim.gap.data.prepared import Measured, PreparedRun

Undo = Callable[[float, Array, Array], Array]  # size, times, values -> corrected values

UNDO: Mapping[str, Undo] = {
    "sensor_gain": lambda size, times, values: values / size,
    "sensor_bias": lambda size, times, values: values - size,
    "sensor_delay": lambda size, times, values: between(times, values, times + size),
    "clock_drift": lambda ppm, times, values: between(times, values, times * (1.0 - 1e-6 * ppm)),
}


def correct_sensors(run: PreparedRun, actives: Sequence[Active]) -> PreparedRun:
    """Remove sensor effects from x, v, u, a and the clock of a run.

    Forces are not changed: effects on force sensors are part of ``expected_forces``. Channels x,
    v, u and a with an effect that can't be undone are marked as not recorded. A ``clock_drift``
    without channels is that of the whole recording and changes its time stamps.
    """
    for active in actives:
        if active.effect.id == "clock_drift" and not active.chosen.get("channels"):
            run = _with_times(run, run.times / (1.0 + 1e-6 * active.theta[0]))
        elif active.effect.level == "sensor":
            names = _affected_channels(run, active)
            if active.effect.id == "channel_swap":
                run = _swapped(run, names)
            elif active.effect.id in UNDO:
                undo = UNDO[active.effect.id]
                for name in names:
                    run = _with_undo(run, name, undo, active.theta[0])
            else:
                run = without_channels(run, names)
    return run


def correct_motion_sensors(run: PreparedRun, actives: Sequence[Active]) -> PreparedRun:
    """Remove those effects from a run that ``is_motion_sensor_effect`` accepts."""
    return correct_sensors(run, [active for active in actives if is_motion_sensor_effect(active)])


def without_sensor_error(
    run: PreparedRun, kind: str, names: Sequence[str], size: float
) -> PreparedRun:
    """Remove an error of one channel, or undo a swap of two.

    Args:
        run: the run.
        kind: ``gain``, ``bias``, ``delay``, ``clock`` or ``swap``.
        names: name of the channel; two for a swap.
        size: relative error of the gain, bias [SI], delay [s] or relative error of the clock;
            ignored for a swap.
    """
    if kind == "swap":
        return _swapped(run, names)
    if kind == "clock":
        return _with_undo(run, names[0], UNDO["clock_drift"], -1e6 * size)
    undo = UNDO[f"sensor_{kind}"]
    return _with_undo(run, names[0], undo, 1.0 + size if kind == "gain" else size)


def is_motion_sensor_effect(active: Active) -> bool:
    """Whether an effect is one of sensors or clock, and not of force sensors (F) alone."""
    channels = active.chosen.get("channels", ())
    names = (channels,) if isinstance(channels, str) else tuple(channels)
    return active.effect.level == "sensor" and not (
        names and all(name.split("_")[0] == "F" for name in names)
    )


def _affected_channels(run: PreparedRun, active: Active) -> tuple[str, ...]:
    """Return the names of the channels x, v, u and a that a sensor effect acts on."""
    names = tuple(n for q in QUANTITIES for n in run.model.layout.channels_of(q))
    empty = TimeSeries(run.times, np.zeros((len(run), len(names))), names)
    return tuple(n for n in channels_of(empty, active) if not n.startswith("F"))


def _column(run: PreparedRun, name: str) -> tuple[str, int]:
    """Return the quantity of a channel, and its column in the values of that quantity."""
    quantity, _, rest = name.partition("_")
    layout = run.model.layout
    if name in (pins := layout.channels_of("pin")):
        return "pin", pins.index(name)
    return quantity, (layout.bodies if quantity in "ua" else layout.meshes).index(rest)


def _with_undo(run: PreparedRun, name: str, undo: Undo, size: float) -> PreparedRun:
    """Apply ``undo`` to one channel; a gain scales its noise too. No change if not recorded."""
    quantity, j = _column(run, name)
    measured: Measured = getattr(run, quantity)
    if not measured.recorded[j]:
        return run
    values, sigma = measured.values.copy(), measured.sigma.copy()
    values[:, j] = undo(size, run.times, values[:, j])
    if undo is UNDO["sensor_gain"]:
        sigma[j] /= abs(size)
    return run.with_measured(quantity, replace(measured, values=values, sigma=sigma))


def _swapped(run: PreparedRun, names: Sequence[str]) -> PreparedRun:
    """Exchange two channels, noise included; a run that lacks one of them stays as it is."""
    if len(names) != 2:
        return run
    (first, i), (second, j) = (_column(run, name) for name in names)
    a, b = getattr(run, first), getattr(run, second)
    if not (a.recorded[i] and b.recorded[j]):
        return run
    shown = (first, i, b.values[:, j], b.sigma[j]), (second, j, a.values[:, i], a.sigma[i])
    for quantity, column, of_other, noise in shown:
        measured: Measured = getattr(run, quantity)
        values, sigma = measured.values.copy(), measured.sigma.copy()
        values[:, column], sigma[column] = of_other, noise
        run = run.with_measured(quantity, replace(measured, values=values, sigma=sigma))
    return run


def _with_times(run: PreparedRun, times: Array) -> PreparedRun:
    """Replace the time stamps (n,) of a run, and compute its nominal waves anew."""
    run = replace(run, times=times)
    return replace(run, waves=run.waves_at(run.phase))


def without_channels(run: PreparedRun, channels: Sequence[str]) -> PreparedRun:
    """Return a copy of a run with some channels marked as not recorded, their values NaN.

    Args:
        channels: names, such as ``x_sp1_L``, of displacements x, rates v, rotations u or
            accelerations a; other names, of forces too, are ignored.
    """
    for q in "xvua":
        off = [name in channels for name in run.model.layout.channels_of(q)]
        run = run.without(q, np.array(off))
    return run
