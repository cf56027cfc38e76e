"""A filter that all channels pass: displacements show e(t) late, rotations don't know of it.

Recorded x holds the nominal e(t), Eqs. (15), (16). Where all channels pass one filter, x + e is
not what the rotations give by geometry, but for e(t) late: its sine and cosine there tell the
delay, and k(t) in recorded forces is as late. Only a delay that the data sheet allows is put
right.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from herringbone_sim.gap.data.geometry import bodies_to_coordinates, coordinates_to_meshes
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.data.waves import waves
from herringbone_sim.gap.sensors.consistency import geometry

LONGEST_S = 5e-6  # of a common delay, data sheet
CORNER = 10.0  # omega_n: the lowest corner of a common filter, data sheet
HALF = 0.5  # of what geometry leaves: less is not what a delay explains


def put_right(runs: Sequence[PreparedRun]) -> tuple[PreparedRun, ...]:
    """The runs with k(t) and e(t) late as all channels are; as they were where none is found."""
    delay = common_delay(runs)
    if delay is None:
        return tuple(runs)
    late = tuple(later(run, delay) for run in runs)
    before, after = (sum(_left(run) for run in some) for some in (runs, late))
    return late if after < HALF * before else tuple(runs)


def common_delay(runs: Sequence[PreparedRun]) -> float | None:
    """Delay [s] of e(t) in x against the rotations; None where it can't be told."""
    turns, weights = [], []
    for run in runs:
        if not (run.u.complete and run.x.there.any()):
            continue
        through = coordinates_to_meshes(run.model.layout) @ bodies_to_coordinates(run.model)
        e = (run.u.values @ through.T - run.x.values)[:, run.x.there]
        wave = np.exp(-1j * run.phase)
        shown = np.median((wave @ (e - e.mean(axis=0))).real) + 1j * np.median(
            (wave @ (e - e.mean(axis=0))).imag
        )
        told = np.mean(wave @ run.waves.e[:, run.x.there])
        if abs(told) > 0.0:
            turns.append(-float(np.angle(shown / told)))
            weights.append(run.omega_rad_per_s)
    if not turns:
        return None
    delay = float(np.dot(turns, weights) / np.dot(weights, weights))
    return delay if 0.0 < delay <= longest_delay(runs[0]) else None


def longest_delay(run: PreparedRun) -> float:
    """Of all channels [s]: a filter of second order is late by up to two over its corner."""
    return float(LONGEST_S + 2.0 / (CORNER * run.model.scales.omega_n))


def later(run: PreparedRun, delay: float) -> PreparedRun:
    """A run with k(t) and e(t) late [s]."""
    late = run.omega_rad_per_s * delay
    moved = waves(run.model, run.phase - late, run.omega_rad_per_s)
    return replace(run, waves=moved, late_rad=late)


def _left(run: PreparedRun) -> float:
    left = geometry(run)[0][0]
    return float(np.sum(left**2))
