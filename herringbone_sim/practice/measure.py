"""Detectability of causes in a recording, and residuals of the force law."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from herringbone_sim.arrays import Array, rms
from herringbone_sim.practice.cause import Cause
from herringbone_sim.practice.channels import channels_of
from herringbone_sim.practice.record import Motion, law_force, own_error_shift
from herringbone_sim.practice.rig_model import MESHES, N_BODY, NOMINAL, Constants

_NAMES = tuple(tuple(f"{a}_{m}" for m in MESHES) for a in "xvF")


@dataclass(frozen=True)
class RunMeasure:
    """Residuals of the force law in one run, and detectability of its causes.

    Attributes:
        nominal, nominal_clean: RMS residual [N] over all meshes by nominal constants, with and
            without noise.
        own, own_clean: the same by the constants of the rig.
        floor: the same of noise alone.
        d: detectability of each cause: RMS of its force over the RMS of the floor, where it acts.
    """

    nominal: float
    nominal_clean: float
    own: float
    own_clean: float
    floor: float
    d: tuple[float, ...]


def measure_run(
    rig: Constants,
    point: Mapping[str, float],
    motion: Motion,
    seen: Mapping[str, Array],
    quiet: Mapping[str, Array],
    measured: Mapping[str, Array],
    causes: tuple[Cause, ...],
) -> RunMeasure:
    """Return the residuals of a run and the detectability of its causes.

    Args:
        rig: constants of the rig.
        motion: true motion.
        seen: true channels with the faults of sensors.
        quiet: the same after filters, gauges and eccentric gratings.
        measured: the same with noise and quantisation; its difference from ``quiet`` is the floor.
    """
    phase = motion.phase
    off = own_error_shift(rig, point, phase)
    clean = _residual(rig, point, phase, seen, off)
    noisy = _residual(rig, point, phase, measured, off)
    nominal = _residual(NOMINAL, point, phase, measured, (0.0, 0.0))
    nominal_clean = _residual(NOMINAL, point, phase, seen, (0.0, 0.0))
    floor = noisy - _residual(rig, point, phase, quiet, off)
    detectabilities = tuple(
        _d(cause, motion, clean, floor, (seen, quiet, measured)) for cause in causes
    )
    return RunMeasure(
        rms(nominal), rms(nominal_clean), rms(noisy), rms(clean), rms(floor), detectabilities
    )


def _residual(
    c: Constants,
    point: Mapping[str, float],
    phase: Array,
    channels: Mapping[str, Array],
    off: tuple[Array | float, Array | float],
) -> Array:
    """Return the residual (n, 12) [N] of the force law, with ``off`` subtracted from x and v."""
    x, v, force = (np.stack([channels[name] for name in names], axis=1) for names in _NAMES)
    residual: Array = force - law_force(c, point, phase, x - off[0], v - off[1])
    return residual


def _d(
    cause: Cause,
    motion: Motion,
    clean: Array,
    floor: Array,
    channels: tuple[Mapping[str, Array], ...],
) -> float:
    """Return the detectability of a cause: RMS of its effect over RMS of the noise there."""
    if "channels" in cause.locus:
        return _d_of_sensor(cause, motion, *channels)
    where = cause.meshes > 0.0
    if np.abs(motion.extra).max() > 0.0:
        return _d_of_bodies(motion, floor)
    return rms(clean[:, where]) / rms(floor[:, where])


def _d_of_bodies(motion: Motion, floor: Array) -> float:
    """Return RMS additional body forces over the noise of the mesh forces summed on each body."""
    mesh = np.mean(floor**2, axis=0)
    sun, ring = mesh[:6].reshape(2, 3), mesh[6:].reshape(2, 3)
    noise = np.empty(N_BODY)
    noise[:2] = sun.sum(axis=1)
    noise[2] = mesh.sum()
    noise[3:] = (sun + ring).ravel()
    acts = np.abs(motion.extra).max(axis=0) > 0.0
    return rms(motion.extra[:, acts]) / float(np.sqrt(noise[acts].mean()))


def _d_of_sensor(
    cause: Cause,
    motion: Motion,
    seen: Mapping[str, Array],
    quiet: Mapping[str, Array],
    measured: Mapping[str, Array],
) -> float:
    """Return the RMS fault of the channels over the RMS of their noise."""
    true = channels_of(motion)
    names = cause.locus["channels"]
    faults = [rms(seen[name] - true[name]) for name in names]
    noises = [rms(measured[name] - quiet[name]) for name in names]
    return float(np.sqrt(np.mean(np.square(faults)) / np.mean(np.square(noises))))
