"""Raw encoder angles: their deviation from steady rotation, and the mesh phase."""

from __future__ import annotations

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import Model


def unwrapped(values: Array) -> Array:
    """Unwrap angles (n,) [rad] that jump by a turn; monotonic ones are returned as they are."""
    known = np.isfinite(values)
    steps = np.diff(values[known])
    if not (np.abs(steps) > np.pi).any() or (steps > 0.0).all() or (steps < 0.0).all():
        return values
    whole: Array = values.copy()
    whole[known] = np.unwrap(values[known])
    return whole


def with_turns(
    model: Model, shaft: str, phase_offset: float, times: Array, values: dict[str, Array]
) -> dict[str, Array]:
    """Replace ``angle_*`` channels by ``u_*``, and compute the phase from a shaft if one is named.

    Args:
        shaft: angle channel, or empty; with the ring at rest a turn of the carrier is z_r mesh
            cycles, one of the sun z_s z_r / (z_s + z_r).
        phase_offset: mesh phase [rad] at the zero of that angle.
        times, values: (n,) [s]; (n,) by channel, SI.
    """
    p = model.parameters
    made = {name: one for name, one in values.items() if not name.startswith("angle_")}
    for name in sorted(values.keys() - made.keys()):
        body = name.removeprefix("angle_")
        line = steady(times, values[name])
        made[f"u_{body}"] = (values[name] - line) * base_radius(model, body)
        if name == shaft:
            cycles = p.z_r if body == "c" else p.z_s * p.z_r / (p.z_s + p.z_r)
            made["phase"] = np.sign(line[-1] - line[0]) * cycles * line + phase_offset
    return made


def steady(times: Array, angle: Array) -> Array:
    """Line (n,) fitted to an angle (n,): the steady rotation; NaN with fewer than two finite
    values.
    """
    known = np.isfinite(angle)
    t = times - times.mean()
    if np.count_nonzero(known) < 2:
        return np.full_like(angle, np.nan)
    slope, start = np.polyfit(t[known], angle[known], 1)
    line: Array = start + slope * t
    return line


def base_radius(model: Model, body: str) -> float:
    """Base radius of a body [m]."""
    s = model.scales
    return {"s": s.r_bs, "c": s.r_bc, "p": s.r_bp}[body[0]]
