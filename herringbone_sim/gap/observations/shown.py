"""Noise of every channel, as the recording shows it beside what is told.

What geometry leaves of a displacement or a rotation, and the force law of a force, is noise but
for what is wrong; its spectrum tells colour and lines.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.layout import PREFIX_UNITS
from herringbone_sim.gap.data.noise import resolution
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.observations.law import law
from herringbone_sim.gap.observations.runs import GearRun

Array = NDArray[np.float64]

MAINS_HZ = (50.0, 100.0, 150.0)
BELOW_HZ = 150.0  # drift and hum lie below the third harmonic of the mains
RISEN = 4.0  # times the mean of the spectrum: one in fifty of single values of white noise


def noise_shown(runs: Sequence[GearRun], told: bool) -> dict[str, dict[str, Any]]:
    """By channel: rms, unit, colour, lines_hz, step, delay_s, told; see the report's contract."""
    found: dict[str, dict[str, Any]] = {}
    first = runs[0].run
    layout = first.model.layout
    for quantity, names in (
        ("x", layout.meshes),
        ("v", layout.meshes),
        ("F", layout.meshes),
        ("u", layout.bodies),
        ("a", layout.bodies),
    ):
        for j, name in enumerate(names):
            there = [g for g in runs if getattr(g.run, quantity).there[j]]
            if there:
                found[f"{quantity}_{name}"] = _channel(there, quantity, j, told)
    for j, planet in enumerate(layout.planets):
        there = [g for g in runs if g.run.pin.there[j]]
        if there:
            found[f"F_pin{planet}"] = _channel(there, "pin", j, told)
    return found


def _channel(runs: Sequence[GearRun], quantity: str, j: int, told: bool) -> dict[str, Any]:
    measured = [getattr(g.run, quantity) for g in runs]
    sigma = float(np.sqrt(np.mean([m.sigma[j] ** 2 for m in measured])))
    left = [_left(g, quantity, j) for g in runs]
    colour, lines = "white", []
    if all(values is not None for values in left):
        spectra = [_risen(v, g.run) for v, g in zip(left, runs, strict=True) if v is not None]
        colour = "1/f" if float(np.median([s[0] for s in spectra])) > RISEN else "white"
        lines = [
            f for i, f in enumerate(MAINS_HZ) if np.median([s[1][i] for s in spectra]) > RISEN
        ]
    step = float(np.median([resolution(m.values[:, [j]])[0] for m in measured]))
    return {
        "rms": sigma,
        "unit": PREFIX_UNITS["F" if quantity == "pin" else quantity],
        "colour": colour,
        "lines_hz": lines,
        "step": step,
        "delay_s": float(np.mean([g.run.late_rad / g.run.omega_rad_per_s for g in runs])),
        "told": sigma if told else None,
    }


def _left(g: GearRun, quantity: str, j: int) -> Array | None:
    """What other channels leave of a channel (n,); None where none of them tells."""
    run = g.run
    if quantity == "x":
        values = run.x.values[:, j] - g.fused.x[:, j]
    elif quantity == "v":
        values = run.v.values[:, j] - g.fused.v[:, j]
    elif quantity == "F":
        values = run.F.values[:, j] - law(g.motion).force[:, j]
    else:
        return None
    return values if np.isfinite(values).all() and np.any(values) else None


def _risen(values: Array, run: PreparedRun) -> tuple[float, list[float]]:
    """Power of drift, and at the mains, over the mean of the spectrum."""
    centred = (values - values.mean()) * np.hanning(len(values))
    power = np.abs(np.fft.rfft(centred)) ** 2
    hz = np.fft.rfftfreq(len(values), run.step_s)
    mean = float(np.median(power[1:]) / np.log(2.0))
    slow = float(power[(hz > 0.0) & (hz < BELOW_HZ)].mean()) / mean if hz[1] < BELOW_HZ else 1.0
    lines = []
    for f in MAINS_HZ:
        near = int(np.argmin(np.abs(hz - f)))
        beside = np.r_[power[max(1, near - 4) : max(1, near - 1)], power[near + 2 : near + 5]]
        alone = beside.size and hz[1] < 0.2 * f
        lines.append(float(power[near] / max(beside.mean(), mean)) if alone else 0.0)
    return slow, lines
