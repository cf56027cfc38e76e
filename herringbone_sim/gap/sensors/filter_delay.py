"""Delay and attenuation by a low-pass filter that is common to all channels.

Recorded x contains the nominal e(t), Eqs. (15), (16), but the rotations u don't. After a common
filter, D B u - x is e(t) with a delay and an attenuation that grows with the square of the
frequency; both are estimated from its component at the mesh frequency. They are applied to the
nominal k(t) and e(t) instead of the channels, if they are within the bounds of the data sheet.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.gap.data.kinematics import bodies_to_meshes
from herringbone_sim.gap.data.prepared import PreparedRun, deciding

LONGEST_S = 5e-6  # longest common delay in addition to that of the filter, data sheet
CORNER = 10.0  # lowest corner frequency of a common filter in omega_n, data sheet
MOST_UNEXPLAINED = 0.5  # fraction of the squared error of e(t) that may remain with the delay


def compensate_filter(runs: Sequence[PreparedRun]) -> tuple[PreparedRun, ...]:
    """Delay and attenuate the nominal waves of the runs as a filter common to all channels does.

    Delay and attenuation are estimated from the fit runs. Without rotations and displacements, or
    if no permitted delay explains most of their difference, the runs are returned unchanged.
    """
    known = [run for run in deciding(runs) if run.u.complete and run.x.recorded.any()]
    ratios = [(run, s) for run in known for s in (e_ratio(run),) if s.size]
    if not ratios:
        return tuple(runs)
    omegas = np.array([run.omega_rad_per_s for run, _ in ratios])
    middle = np.array([np.median(s.real) + 1j * np.median(s.imag) for _, s in ratios])
    turns = -np.angle(middle)
    delay = float(omegas @ turns / (omegas @ omegas))
    if not 0.0 < delay <= longest_delay(runs[0]):
        return tuple(runs)
    before = sum(float(np.sum(np.abs(s - 1.0) ** 2)) for _, s in ratios)
    after = sum(
        float(np.sum(np.abs(s - np.exp(-1j * run.omega_rad_per_s * delay)) ** 2))
        for run, s in ratios
    )
    if after >= MOST_UNEXPLAINED * before:
        return tuple(runs)
    squares = omegas**2
    fall = float(squares @ (1.0 - np.abs(middle)) / (squares @ squares))
    most = 1.0 / (CORNER * runs[0].model.scales.omega_n) ** 2
    fall = float(np.clip(fall, -most, most))
    return tuple(
        with_delayed_waves(run, delay, 1.0 - fall * run.omega_rad_per_s**2) for run in runs
    )


def e_ratio(run: PreparedRun) -> NDArray[np.complex128]:
    """Return the component of D B u - x at the mesh frequency over that of the nominal e(t).

    Complex (k,), for the k recorded x whose e(t) has a first harmonic; 1 without filter.
    """
    through = bodies_to_meshes(run.model)
    e = (run.u.values @ through.T - run.x.values)[:, run.x.recorded]
    nominal = run.waves.e[:, run.x.recorded]
    p = run.model.packed
    first = p.orders == 1.0
    amplitude = np.abs(p.e_cos[first]) + np.abs(p.e_sin[first])
    varies = amplitude.sum(axis=0)[run.x.recorded] > 0.0
    e, nominal = e[:, varies], nominal[:, varies]
    wave = np.exp(-1j * run.phase)
    return np.asarray(wave @ (e - e.mean(axis=0)) / (wave @ (nominal - nominal.mean(axis=0))))


def longest_delay(run: PreparedRun) -> float:
    """Return the longest common delay [s]; a second-order filter delays by 2 / corner."""
    return float(LONGEST_S + 2.0 / (CORNER * run.model.scales.omega_n))


def with_delayed_waves(run: PreparedRun, delay: float, e_share: float = 1.0) -> PreparedRun:
    """Copy of a run with nominal k(t), e(t) and control torque delayed by ``delay`` [s].

    Channels are not changed; an earlier delay and factor are replaced.

    Args:
        e_share: factor on the harmonics of e(t), not on its mean.
    """
    late = replace(run, delay_rad=run.omega_rad_per_s * delay, e_share=e_share)
    return replace(late, waves=late.waves_at(run.phase))
