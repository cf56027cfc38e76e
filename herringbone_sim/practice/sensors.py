"""Faults of sensors: effects on the recording, not on the gear."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import Any

import numpy as np
from numpy.random import Generator

from herringbone_sim.arrays import Array, rms
from herringbone_sim.core.layout import PREFIX_UNITS
from herringbone_sim.practice.cause import Cause, Drawn, Kind, at, draw_sign, size_as
from herringbone_sim.practice.channels import channels_of
from herringbone_sim.practice.record import Motion
from herringbone_sim.practice.rig_model import BODIES, MESHES

Channels = dict[str, Array]
UNITS_OF_BIAS = {"x": 5e-5, "u": 5e-5, "v": 1.5, "F": 3e4, "a": 5e4}


def channel_locus(channels: tuple[str, ...]) -> dict[str, Any]:
    """Return the locus of some channels: the mesh of the first channel, and the names of all."""
    first = channels[0]
    prefix, _, place = first.partition("_")
    mesh = prefix in "xvF" and place in MESHES
    where = at(place[:2], place[2], place[4]) if mesh else at()
    return {**where, "channels": list(channels)}


def draw_channel(rng: Generator, among: tuple[str, ...]) -> Drawn:
    """Draw one of the channels, and sign, unit and frequency [Hz] of its fault."""
    name = str(rng.choice(list(among)))
    shape = {"sign": draw_sign(rng), "unit_of_size": UNITS_OF_BIAS[name[0]]}
    return channel_locus((name,)), shape | {"hertz": float(rng.uniform(900.0, 1900.0))}


def draw_swap(rng: Generator, among: tuple[str, ...]) -> Drawn:
    """Draw two channels of one quantity to swap; the shape is empty.

    They are those of carrier and a sun, or of sun and ring mesh of a planet; where these are not
    recorded, any two of the quantity.
    """
    quantities = sorted({name[0] for name in among})
    quantity = str(rng.choice(quantities))
    if quantity in "ua":
        suns = [b for b in BODIES[:2] if f"{quantity}_{b}" in among]
        pair = [f"{quantity}_c", f"{quantity}_{rng.choice(suns)}"]
    else:
        i, s = rng.integers(1, 4), rng.choice(["L", "R"])
        pair = [f"{quantity}_sp{i}_{s}", f"{quantity}_rp{i}_{s}"]
    if not set(pair) <= set(among):
        alike = [name for name in among if name[0] == quantity]
        pair = [str(name) for name in rng.choice(alike, 2, replace=False)]
    return channel_locus(tuple(pair)), {}


def draw_recorder(rng: Generator, among: tuple[str, ...]) -> Drawn:
    """Draw a group of channels that has a separate clock, and the sign of its drift.

    The group has one quantity, one or both mesh kinds and one or both sides, but not all recorded
    channels, as a common drift is not visible. If only one channel is recorded, it is drawn.
    """
    groups: dict[tuple[str, ...], dict[str, Any]] = {}
    quantities = sorted({name[0] for name in among})
    for quantity, kind, side in product(quantities, ("all", "sp", "rp"), ("all", "L", "R")):
        inside = tuple(name for name in among if name[0] == quantity and _of(name, kind, side))
        if inside and (len(inside) < len(among) or len(among) == 1):
            groups.setdefault(inside, at(kind, "all", side))
    chosen = list(groups)[int(rng.integers(len(groups)))]
    return groups[chosen] | {"channels": list(chosen)}, {"sign": draw_sign(rng)}


def _of(name: str, kind: str, side: str) -> bool:
    """Return whether a channel is of a mesh kind (``all``: or of bodies) and of a side."""
    mesh = "sp" if "_sp" in name else "rp" if "_rp" in name else ""
    return kind in ("all", mesh) and (side == "all" or name.endswith(f"_{side}"))


def distort(c: Cause, now: Motion, before: Motion | None, exact: Mapping[str, Array]) -> Channels:
    """Return all channels with the fault of a sensor.

    Gains and biases vary slowly over the run. Channels with a separate clock show the motion later
    by ``ppm`` millionths of the time since the first sample, earlier if that is negative.

    Args:
        before: the motion earlier by a delay, or by the separate clock; None for other faults.
        exact: channels (n,) without the fault, by name.
    """
    seen: Channels = dict(exact)
    names = c.locus["channels"]
    by = c.sign * c.size
    ramp = np.linspace(0.0, 1.0, len(now.times))
    if c.internal == "channel_swap":
        seen[names[0]], seen[names[1]] = exact[names[1]], exact[names[0]]
    elif c.internal == "sensor_gain":
        seen[names[0]] = exact[names[0]] * (1.0 + by * (0.95 + 0.1 * ramp))
    elif c.internal == "sensor_bias":
        unit = float(c.shape["unit_of_size"])
        seen[names[0]] = exact[names[0]] + by * unit * (1.0 - 0.3 * np.exp(-12.0 * ramp))
    elif c.internal in ("sensor_delay", "clock_drift") and before is not None:
        then, true = channels_of(before), channels_of(now)
        seen |= {name: exact[name] + (then[name] - true[name]) for name in names}
    elif c.internal == "missing_codes":
        seen[names[0]] = _missing_codes(exact[names[0]], c.size)
    elif c.internal == "mains_hum":
        hum = np.sin(float(c.shape["hertz"]) * 2.0 * np.pi * now.times)
        seen[names[0]] = exact[names[0]] + by * rms(exact[names[0]]) * hum
    elif c.internal == "crosstalk":
        seen[names[0]] = exact[names[0]] + by * exact[_neighbour(names[0], exact)]
    elif c.internal == "soft_saturation":
        level = rms(exact[names[0]]) / c.size
        seen[names[0]] = level * np.tanh(exact[names[0]] / level)
    return seen


def _neighbour(name: str, among: Mapping[str, Array]) -> str:
    """Return the name of the next channel, cyclically, with the same first letter as ``name``."""
    alike = [other for other in among if other[0] == name[0]]
    return alike[(alike.index(name) + 1) % len(alike)]


def _missing_codes(values: Array, size: float) -> Array:
    """Return values rounded to steps of ``size`` times their RMS, every third code missing."""
    step = size * rms(values)
    code = np.floor(values / step)
    lost = np.mod(code, 3.0) == 1.0
    shown: Array = (code + np.where(lost, -0.5, 0.5)) * step
    return shown


def sensor_kind(
    start: float, cap: float, parameters: Any, draw: Any = draw_channel, least: float = 0.0
) -> Kind:
    """Return a fault of sensors as ``Kind``, which leaves the rig model as it is."""
    return Kind("sensor", start, cap, draw, lambda p, c, _: p, parameters, least)


def _bias_parameter(c: Cause) -> dict[str, tuple[Any, str]]:
    unit = PREFIX_UNITS[c.locus["channels"][0][0]]
    return {"bias": (c.sign * c.size * c.shape["unit_of_size"], unit)}


SENSORS: dict[str, Kind] = {
    "sensor_gain": sensor_kind(0.02, 0.6, lambda c: {"gain": (1.0 + c.sign * c.size, "-")}),
    "sensor_bias": sensor_kind(0.02, 2.0, _bias_parameter),
    "sensor_delay": sensor_kind(1e-7, 4e-5, lambda c: {"delay": (c.size, "s")}),
    "clock_drift": sensor_kind(50.0, 2e4, size_as("ppm", "1e-6"), draw_recorder),
    "channel_swap": sensor_kind(1.0, 1.0, lambda c: {}, draw_swap, 1.0),
}
OUTSIDE_SENSORS: dict[str, Kind] = {
    "missing_codes": sensor_kind(0.05, 1.5, lambda c: {"size": (c.size, "-")}),
    "mains_hum": sensor_kind(0.02, 1.0, lambda c: {"size": (c.size, "-")}),
}
