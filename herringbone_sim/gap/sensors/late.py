"""A filter that all channels pass: displacements show e(t) late, rotations don't know of it.

Recorded x holds the nominal e(t), Eqs. (15), (16). Where all channels pass one filter, x + e is
not what the rotations give by geometry, but for e(t) late: its sine and cosine there tell the
delay, and k(t) in recorded forces is as late; their amplitude tells how much of e(t) the filter
leaves, less by the square of the frequency. Only what the data sheet allows is put right.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.gap.data.geometry import bodies_to_coordinates, coordinates_to_meshes
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.data.waves import waves

LONGEST_S = 5e-6  # of a common delay, data sheet
CORNER = 10.0  # omega_n: the lowest corner of a common filter, data sheet
HALF = 0.5  # of the error of e(t) at the mesh frequency: less is not what a delay explains


def put_right(runs: Sequence[PreparedRun]) -> tuple[PreparedRun, ...]:
    """The runs with k(t) and e(t) late as all channels are; as they were where none is found."""
    seen = [(run, _shown(run)) for run in runs if run.u.complete and run.x.there.any()]
    if not seen:
        return tuple(runs)
    omegas = np.array([run.omega_rad_per_s for run, _ in seen])
    middle = np.array([np.median(s.real) + 1j * np.median(s.imag) for _, s in seen])
    turns = -np.angle(middle)
    delay = float(omegas @ turns / (omegas @ omegas))
    if not 0.0 < delay <= longest_delay(runs[0]):
        return tuple(runs)
    before = sum(float(np.sum(np.abs(s - 1.0) ** 2)) for _, s in seen)
    after = sum(
        float(np.sum(np.abs(s - np.exp(-1j * run.omega_rad_per_s * delay)) ** 2))
        for run, s in seen
    )
    if after >= HALF * before:
        return tuple(runs)
    squares = omegas**2
    fall = float(squares @ (1.0 - np.abs(middle)) / (squares @ squares))
    most = 1.0 / (CORNER * runs[0].model.scales.omega_n) ** 2
    fall = float(np.clip(fall, -most, most))
    return tuple(later(run, delay, 1.0 - fall * run.omega_rad_per_s**2) for run in runs)


def _shown(run: PreparedRun) -> NDArray[np.complex128]:
    """Wave at the mesh frequency of e(t) in x against the rotations, over the nominal one."""
    through = coordinates_to_meshes(run.model.layout) @ bodies_to_coordinates(run.model)
    e = (run.u.values @ through.T - run.x.values)[:, run.x.there]
    wave = np.exp(-1j * run.phase)
    return np.asarray(wave @ (e - e.mean(axis=0)) / (wave @ run.waves.e[:, run.x.there]))


def longest_delay(run: PreparedRun) -> float:
    """Of all channels [s]: a filter of second order is late by up to two over its corner."""
    return float(LONGEST_S + 2.0 / (CORNER * run.model.scales.omega_n))


def later(run: PreparedRun, delay: float, e_share: float = 1.0) -> PreparedRun:
    """A run with k(t) and e(t) late [s], and less e(t) in its displacements."""
    late = run.omega_rad_per_s * delay
    moved = waves(run.model, run.phase - late, run.omega_rad_per_s, e_share)
    return replace(run, waves=moved, late_rad=late, e_share=e_share)
