"""Kinds of noise: parameters of each part of the measuring chain, drawn from a seed.

One function per kind returns the parts that ``chain`` applies: ``drift`` and ``hum`` (with their
fractions of the noise power; the rest is white), ``filter``, ``encoders``, ``gains`` and
``converter``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.random import Generator

from herringbone_sim.errors import ParameterError
from herringbone_sim.practice.channels import PINS
from herringbone_sim.practice.rig_model import BODIES, MESHES

Parts = dict[str, dict[str, Any]]
ARC_SECOND = np.pi / 180.0 / 3600.0
GAIN_TOLERANCE = 0.05  # relative tolerance of the gain of a force gauge
HARD = 0.4  # fraction of the noise power that is not white in ``coloured_hard``


@dataclass(frozen=True)
class Noise:
    """Measuring chain of a campaign.

    Attributes:
        kind: one of ``NOISES``.
        share: RMS of the random noise over the RMS of each channel.
        share_given: whether ``campaign.yaml`` gives ``share``, which implies white noise.
        parts: parameters of each part of the chain.
    """

    kind: str
    share: float
    share_given: bool = False
    parts: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    @property
    def sensors(self) -> dict[str, dict[str, float]]:
        """Sensor data that ``campaign.yaml`` gives: gain tolerances by channel, or nothing."""
        gains = self.parts.get("gains", {})
        given = gains.get("told", False)
        return {name: {"gain_tolerance": GAIN_TOLERANCE} for name in gains.get("of", {}) if given}


def _white(_: Generator) -> Parts:
    return {}


def _coloured(rng: Generator) -> Parts:
    """Draw drift and hum, each with 0.1 to 0.5 of the RMS of the noise."""
    drift, hum = rng.uniform(0.1, 0.5, 2) ** 2
    return _drift_and_hum(rng, float(drift), float(hum), 3)


def _coloured_hard(rng: Generator) -> Parts:
    """Draw drift and hum with together 40 % of the noise power, the hum with seven harmonics."""
    drift = float(HARD * rng.uniform(0.2, 0.8))
    return _drift_and_hum(rng, drift, HARD - drift, 7)


def _drift_and_hum(rng: Generator, drift: float, hum: float, multiples: int) -> Parts:
    """Draw the parameters of drift (spectral law) and hum (amplitudes of its harmonics).

    Args:
        drift, hum: fractions of the noise power; the rest is white.
        multiples: number of harmonics of the mains in the hum.
    """
    heights = rng.uniform(0.2, 1.0, multiples)
    law = str(rng.choice(["walk", "1/f"]))
    lines = (heights / np.linalg.norm(heights)).tolist()
    return {"drift": {"power": drift, "law": law}, "hum": {"power": hum, "lines": lines}}


def _filtered(rng: Generator) -> Parts:
    """Draw one low-pass for all channels: corner at 10 to 32 omega_n, delay of up to 5 us."""
    return {
        "filter": {
            "order": int(rng.integers(1, 3)),
            "corner": float(10.0 ** rng.uniform(1.0, 1.5)),
            "ratio": float(rng.uniform(0.6, 1.0)),
            "delay_s": float(rng.uniform(0.0, 5e-6)),
        }
    }


def _encoders(rng: Generator) -> Parts:
    return {"encoders": _gratings(rng, 1), "gains": _gauges(rng, True)}


def _encoders_two(rng: Generator) -> Parts:
    return {"encoders": _gratings(rng, 2), "gains": _gauges(rng, True)}


def _gratings(rng: Generator, sets: int) -> dict[str, Any]:
    """Draw counts a revolution, and eccentricity [rad] and its angle for each set and body."""
    size = (sets, len(BODIES))
    return {
        "counts": 2 ** int(rng.integers(18, 21)),
        "rate": str(rng.choice(["spline", "central"])),
        "off": (ARC_SECOND * rng.uniform(0.0, 3.0, size)).tolist(),
        "angle": rng.uniform(-np.pi, np.pi, size).tolist(),
    }


def _gauges(rng: Generator, given: bool) -> dict[str, Any]:
    """Draw gains of the force gauges; ``given``: whether ``campaign.yaml`` has their tolerance."""
    low, high = 1.0 - GAIN_TOLERANCE, 1.0 + GAIN_TOLERANCE
    of_meshes = rng.uniform(low, high, len(MESHES))
    of_pins = rng.spawn(1)[0].uniform(low, high, len(PINS))  # what else is drawn stays the same
    names = (*(f"F_{mesh}" for mesh in MESHES), *PINS)
    of = dict(zip(names, [*of_meshes.tolist(), *of_pins.tolist()], strict=True))
    return {"told": given, "of": of}


def _quantised(rng: Generator) -> Parts:
    """Draw converters of 12 to 16 bits over 1.1 to 2 times the largest value of a quantity."""
    bits, room = int(rng.integers(12, 17)), float(rng.uniform(1.1, 2.0))
    return {"converter": {"bits": bits, "room": room}}


def _gains(rng: Generator) -> Parts:
    return {"gains": _gauges(rng, False)}


def _mixture(rng: Generator) -> Parts:
    """Draw two to four of five other kinds at once."""
    among = (_coloured, _filtered, _encoders, _quantised, _gains)
    chosen = rng.choice(len(among), int(rng.integers(2, 5)), replace=False)
    parts: Parts = {}
    for i in sorted(chosen):
        parts |= among[i](rng)
    return parts


NOISES: dict[str, Callable[[Generator], Parts]] = {
    "white": _white,
    "white_untold": _white,
    "coloured": _coloured,
    "coloured_hard": _coloured_hard,
    "filtered": _filtered,
    "encoders": _encoders,
    "encoders_two": _encoders_two,
    "quantised": _quantised,
    "gains": _gains,
    "mixture": _mixture,
}


def draw_noise(rng: Generator, kind: str, share: float) -> Noise:
    """Draw the measuring chain for a kind of noise; ParameterError for an unknown kind."""
    if kind not in NOISES:
        raise ParameterError(f"noise must be one of {', '.join(NOISES)}, got {kind!r}")
    return Noise(kind, share, kind == "white", NOISES[kind](rng))
