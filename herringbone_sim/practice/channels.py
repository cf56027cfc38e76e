"""Channels of a practice rig: sets that are recorded, and their exact values before noise."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.random import Generator
from scipy.signal import detrend

from herringbone_sim.arrays import Array
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.practice.record import Motion
from herringbone_sim.practice.rig_model import BODIES, MESHES

HEAD = ("t", "phase", "K", "delta_T", "T_1")
_X, _V, _F = (tuple(f"{a}_{m}" for m in MESHES) for a in "xvF")
_U = tuple(f"u_{b}" for b in BODIES)
_SHAFTS = ("s_L", "s_R", "c")
_FEW = tuple(f"u_{b}" for b in _SHAFTS)
_RINGS = tuple(f"F_{m}" for m in MESHES if m.startswith("rp"))
PINS = ("F_pin1", "F_pin2", "F_pin3")
GAUGES = 4  # ring gauges; each sees a planet for PASSES mesh cycles
PASSES = 4.0
RING_CYCLES = 77.0  # mesh cycles of a revolution of the carrier against the ring
CHANNEL_SETS = {
    "full": (*_X, *_V, *_F, *_U),
    "no_force": (*_X, *_V),
    "few": _FEW,
    "raw_shafts": _FEW,
    "rotations": _U,
    "accelerometers": tuple(f"a_{b}" for b in _SHAFTS),
    "shafts_rings": (*_FEW, *_RINGS),
    "shafts_pins": (*_FEW, *PINS),
    "x_and_F": (*_X, *_F),
    "half_forces": (*_X, *_V, *_F, *_U),
}


def drawn_channels(rng: Generator, name: str) -> tuple[str, ...]:
    """Return the channels of a set, of ``half_forces`` with a random half of the forces."""
    missing: set[str] = set()
    if name == "half_forces":
        missing = {str(channel) for channel in rng.choice(_F, len(_F) // 2, replace=False)}
    return tuple(channel for channel in CHANNEL_SETS[name] if channel not in missing)


def channels_of(motion: Motion) -> dict[str, Array]:
    """Return all exact channels (n,) by name, except time, phase and operating point."""
    named = {f"x_{m}": motion.x[:, j] for j, m in enumerate(MESHES)}
    named |= {f"v_{m}": motion.v[:, j] for j, m in enumerate(MESHES)}
    named |= {f"F_{m}": motion.force[:, j] for j, m in enumerate(MESHES)}
    named |= {f"u_{b}": motion.u[:, j] for j, b in enumerate(BODIES)}
    named |= {f"a_{b}": motion.a[:, j] for j, b in enumerate(BODIES)}
    on_pins = motion.force.reshape(-1, 4, 3).sum(axis=1)
    return named | {name: on_pins[:, i] for i, name in enumerate(PINS)}


def gated(name: str, phase: Array, values: Array) -> Array:
    """Return the force of one planet's ring mesh as the ``GAUGES`` gauges on the ring read it.

    Args:
        name: channel, such as ``F_rp1_L``; its digit is the planet.
        phase: (n,) mesh phase [rad].
        values: (n,) force [N] at all samples.

    Returns:
        ``values``; NaN except in the ``PASSES`` mesh cycles in which the planet passes a gauge.
    """
    turn = phase / (2.0 * np.pi) + RING_CYCLES * (int(name[4]) - 1) / 3.0
    seen = turn % (RING_CYCLES / GAUGES) < PASSES
    return np.where(seen, values, np.nan)


def series_of(
    motion: Motion,
    measured: Mapping[str, Array],
    point: Mapping[str, float],
    names: tuple[str, ...],
    channels: str,
) -> TimeSeries:
    """Return the recording: time, phase, operating point and the channels of a set.

    Args:
        names: channels of the set.
        channels: name of the set. Gauges of ``shafts_rings`` only see passing planets; angles of
            ``raw_shafts`` lack their mean and linear trend.
    """
    n = len(motion.times)
    if channels == "raw_shafts":
        measured = {name: detrend(measured[name]) for name in names}
    if channels == "shafts_rings":
        measured = {
            name: gated(name, motion.phase, values) if name in _RINGS else values
            for name, values in measured.items()
        }
    set_to = [np.full(n, float(point[name])) for name in HEAD[2:]]
    head = [motion.times, motion.phase, *set_to]
    columns = np.stack([*head, *(measured[name] for name in names)], axis=1)
    return TimeSeries(motion.times, columns, (*HEAD, *names))
