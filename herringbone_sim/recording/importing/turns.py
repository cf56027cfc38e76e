"""Convert raw encoder angles to deviations from steady rotation, and to the mesh phase."""

from __future__ import annotations

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import Model


def unwrapped(values: Array) -> Array:
    """Unwrap angles (n,) [rad] that jump by 2 pi; monotonic angles are returned unchanged."""
    known = np.isfinite(values)
    steps = np.diff(values[known])
    if not (np.abs(steps) > np.pi).any() or (steps > 0.0).all() or (steps < 0.0).all():
        return values
    whole: Array = values.copy()
    whole[known] = np.unwrap(values[known])
    return whole


def span(values: Array) -> float:
    """Return the largest minus the smallest finite one of values (n,); 0 if none is finite."""
    known = values[np.isfinite(values)]
    return float(np.ptp(known)) if len(known) else 0.0


def with_turns(
    model: Model, shaft: str, phase_offset: float, times: Array, values: dict[str, Array]
) -> dict[str, Array]:
    """Replace each channel ``angle_*`` by the rotation ``u_*``; compute the mesh phase if asked.

    A rotation u [m] is the angle minus its steady rotation, times the base radius of the body. The
    phase [rad] is the steady rotation of the shaft, counted positive, times its mesh cycles per
    revolution: with the ring at rest z_r for the carrier, z_s z_r / (z_s + z_r) for the sun.

    Args:
        model: nominal model.
        shaft: angle channel that gives the phase, or empty: no phase is computed.
        phase_offset: mesh phase [rad] at the zero of that angle.
        times: (n,) [s].
        values: channel -> (n,), SI; angles are unwrapped.

    Returns:
        Channel -> (n,), SI.
    """
    p = model.parameters
    converted = {name: column for name, column in values.items() if not name.startswith("angle_")}
    for name in sorted(values.keys() - converted.keys()):
        body = name.removeprefix("angle_")
        line = steady(times, values[name])
        converted[f"u_{body}"] = (values[name] - line) * model.scales.base_radius(body)
        if name == shaft:
            cycles = p.z_r if body == "c" else p.z_s * p.z_r / (p.z_s + p.z_r)
            converted["phase"] = np.sign(line[-1] - line[0]) * cycles * line + phase_offset
    return converted


def steady(times: Array, angle: Array) -> Array:
    """Fit a line to an angle (n,) over times (n,): the steady rotation (n,), in the unit of angle.

    It is NaN if fewer than two angles are finite.
    """
    known = np.isfinite(angle)
    t = times - times.mean()
    if np.count_nonzero(known) < 2:
        return np.full_like(angle, np.nan)
    slope, start = np.polyfit(t[known], angle[known], 1)
    line: Array = start + slope * t
    return line
