"""Compare imported channels with the sizes expected by the data sheet; nothing is rejected.

Expected sizes: displacements as the mesh error, velocities and accelerations as that times the
mesh frequency, mean forces as the load.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import Model, mean_sun_force
from herringbone_sim.recording.importing.units import si_unit

# Factor beyond which another unit prefix, a factor of 1000 away, fits better.
FAR = 10.0**1.5
SPEED = 0.05  # larger relative deviations mean a wrong Omega, slip or another gear


def remarks(model: Model, times: Array, values: Mapping[str, Array]) -> list[str]:
    """Return sentences on a wrong speed, NaN, and channels far from their nominal size.

    Args:
        model: nominal model at the operating point.
        times: (n,) [s].
        values: channel -> (n,), SI.
    """
    sentences = _speed(model, times, values["phase"])
    far: dict[str, list[str]] = {}
    for name, samples in values.items():
        known = samples[np.isfinite(samples)]
        if len(known) < len(samples):
            sentences.append(
                f"{name} has no number in {1 - len(known) / len(samples):.1%} of the samples"
            )
        expected, size = _sizes(model, name, known)
        if len(known) and expected > 0.0 and not expected / FAR < size < expected * FAR:
            size_text = f"about {expected:.3g} {si_unit(name)}, got {size:.3g}"
            far.setdefault(size_text, []).append(name)
    return sentences + [
        f"{', '.join(names)} should be {size_text}: another unit, scale or sensor than the "
        "spec says?"
        for size_text, names in far.items()
    ]


def _speed(model: Model, times: Array, phase: Array) -> list[str]:
    """Return a sentence if the mesh frequency by phase differs from Omega by more than 5 %."""
    p = model.parameters
    nominal = p.Omega * (p.omega_n or model.scales.omega_n)
    known = np.flatnonzero(np.isfinite(phase))
    if len(known) < 2:
        return []
    first, last = known[0], known[-1]
    got = float((phase[last] - phase[first]) / (times[last] - times[first]))
    if abs(got / nominal - 1.0) < SPEED:
        return []
    return [
        f"the mesh turns at {got:.6g} rad/s by phase, at {nominal:.6g} rad/s by "
        f"Omega = {p.Omega:g}: mend Omega, the unit of phase or time, or the nominal file"
    ]


def _sizes(model: Model, name: str, values: Array) -> tuple[float, float]:
    """Return expected and actual size of a channel, SI; expected is 0 where it is not known."""
    p, s = model.parameters, model.scales
    omega, error = p.Omega * (p.omega_n or s.omega_n), p.e_m * s.b_c
    load = abs(mean_sun_force(model))
    kind = name.split("_")[0]
    moved = {"x": error, "u": error, "v": error * omega, "a": error * omega**2}
    if not len(values):
        return 0.0, 0.0
    if kind in moved:
        return moved[kind], float(values.std())
    mean = float(abs(values.mean()))
    if name.startswith("F_pin"):
        return 4.0 * load, mean  # sun and ring meshes of both sides
    loads = {"F": load, "delta": abs(p.delta_T)}
    torques = {"T_1": abs(p.T_1), "T_in": abs(p.T_1), "T_out": abs(s.T_2)}
    return torques.get(name, loads.get(kind, 0.0)), mean
