"""Trends: what readings hold or lack beside the model: constants, lines, parabolas, the swing."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.observations.body_motion import rigid_mode, rigid_swing
from herringbone_sim.gap.observations.windows.channels import WindowChannels


class Trends(NamedTuple):
    """Waveforms that readings may contain or lack: constant, line and parabola, and the swing.

    An encoder that counts from an arbitrary mark lacks the wind-up under the load, and a line that
    was subtracted as the steady rotation takes a part of the motion with it; an accelerometer that
    is AC-coupled lacks its mean. Where a gear loses power, the load holds its speed but for an
    error, by which all bodies slow down together, a parabola. A simulator in relative coordinates
    leaves out the rigid oscillation under the control (amplitude 1), a rig does not (0).

    Attributes:
        wave: (m, W, samples, k) part of the readings of all channels by a unit amplitude of each.
        size: (m,) largest expected amplitude, in the unit of the channel; 1 of the swing.
    """

    wave: Array
    size: Array


def trends_of(
    run: PreparedRun, channels: WindowChannels, motion: float, shape: tuple[int, int]
) -> Trends:
    """Trends of a run: of detrended rotations, accelerations, slowing, with a control the swing.

    Args:
        motion: RMS of the shafts' motion [m].
        shape: number of windows, and of samples in each.
    """
    W, samples = shape
    times = run.times[: W * samples].reshape(W, samples)
    waves = (np.ones_like(times), 2.0 * times / run.times[-1] - 1.0)
    largest = {
        "u": float(np.max(run.model.half_backlash_m)),
        "a": 2.0 * motion * run.omega_rad_per_s / (run.times[-1] - run.times[0]),
    }
    trends, size = [], []
    for channel, name in zip(np.eye(len(channels.names)), channels.names, strict=True):
        if name in run.detrended or name[0] == "a":
            trends += [wave[..., None] * channel for wave in waves]
            size += [largest[name[0]]] * len(waves)
    if np.any(channels.of_u):
        # The second Legendre polynomial: neither mean nor slope, which readings lack anyway.
        parabola = (1.5 * waves[1] ** 2 - 0.5)[..., None]
        trends.append(parabola * (channels.of_u @ rigid_mode(run.model)))
        size.append(largest["u"])
    if run.model.packed.K and np.any(channels.of_u):
        swing = rigid_swing(run)[: W * samples] @ channels.of_u.T
        trends.append(-swing.reshape(W, samples, -1))
        size.append(1.0)
    return Trends(
        np.array(trends).reshape(-1, W, samples, len(channels.names)), np.array(size, dtype=float)
    )
