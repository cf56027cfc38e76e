"""Families of curves from which the laws of effects are drawn.

The catalogue's law of an effect is one curve. With ``law: other`` a curve is drawn from a family
to which the effect's id still applies. A curve is a mapping that is stored in the label.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.random import Generator

from herringbone_sim.arrays import Array
from herringbone_sim.practice.cause import angle
from herringbone_sim.practice.tables import GRID, deflections

Curve = Mapping[str, Any]
LAWS = ("catalogue", "other")
F_0 = 1e-5  # deflection [m] at which all contact laws have the factor 1
FROM, TO = 5e-6, 4e-5  # deflections [m] under 7 and 60 kN, between which a size is defined
WARM = 50.0  # temperature rise [K] at which all temperature laws agree
HIGHEST = 8  # highest order of an additional harmonic


def _riders(rng: Generator, orders: Array) -> list[list[float]]:
    """Draw additional harmonics ``[order, amplitude, angle]`` beside the labelled one.

    The root sum of squares of the amplitudes is 0.25 to 0.7 of the labelled one.
    """
    count = int(rng.integers(2, 5))
    chosen = rng.choice(orders, count, replace=False)
    shares = rng.dirichlet(np.ones(count)) ** 0.5 * rng.uniform(0.25, 0.7)
    return [[float(o), float(s), angle(rng)] for o, s in zip(chosen, shares, strict=True)]


def _waves(rng: Generator) -> Curve:
    """Draw additional harmonics of the mesh phase; the labelled order is excluded when applied."""
    return {"riders": _riders(rng, np.arange(1.0, HIGHEST + 1.0))}


def _turns(rng: Generator) -> Curve:
    """Draw multiples (2 to 5) of the labelled order of a revolution."""
    return {"riders": _riders(rng, np.arange(2.0, 6.0))}


def _event(rng: Generator) -> Curve:
    """Draw the window of a tooth event: width, plateau, exponents of its ramps, depth of a dip."""
    return {
        "width": float(rng.uniform(0.5, 2.2)),
        "peak": float(rng.uniform(0.15, 0.85)),
        "plateau": float(rng.choice([0.0, rng.uniform(0.1, 0.7)])),
        "rise": float(rng.uniform(1.0, 2.5)),
        "fall": float(rng.uniform(1.0, 2.5)),
        "dip": float(rng.choice([0.0, rng.uniform(0.1, 0.5)])),
        "ring_after": float(rng.choice([12.0, 12.5, 13.0])),
    }


def window(curve: Curve) -> Array:
    """Return the strength (n,) of an event over its width, 0 at both ends, 1 at its peak."""
    flat = float(curve["plateau"])
    start = float(curve["peak"]) * (1.0 - flat)
    up = np.clip(GRID / start, 0.0, 1.0)
    down = np.clip((1.0 - GRID) / (1.0 - start - flat), 0.0, 1.0)
    ramps = [
        (0.5 - 0.5 * np.cos(np.pi * part)) ** float(curve[name])
        for part, name in ((up, "rise"), (down, "fall"))
    ]
    shape = ramps[0] * ramps[1] * (1.0 - float(curve["dip"]) * np.sin(np.pi * GRID) ** 2)
    values: Array = shape / shape.max()
    return values


def _flanks(rng: Generator) -> Curve:
    """Draw offsets of back flanks and ring meshes, relative to drive flanks of sun meshes.

    ``corner``: width of rounded corners of the contact over the offset.
    """
    return {
        "back": float(rng.uniform(0.2, 1.5)),
        "ring": float(rng.uniform(0.5, 1.4)),
        "corner": float(rng.choice([0.0, rng.uniform(0.02, 0.3)])),
    }


def _pin(rng: Generator) -> Curve:
    """Draw relative displacements of ring and right meshes by a pin off radially and tilted."""
    return {"ring": float(rng.uniform(0.3, 1.5)), "right": float(rng.uniform(0.6, 1.4))}


def _temperature(rng: Generator) -> Curve:
    """Draw a curve of delta_T: saturating to quadratic growth, beginning at 0 K or at an onset."""
    return {
        "bend": float(rng.uniform(-0.45, 0.9)),
        "curl": float(rng.uniform(-0.25, 0.25)),
        "onset": float(rng.choice([0.0, rng.uniform(5.0, 35.0)])),
    }


def warm(curve: Curve, delta_T: float) -> float:
    """Return the effective delta_T [K] by a curve; equal to delta_T at 50 K or without curve."""
    onset = float(curve.get("onset", 0.0))
    above = WARM * max(delta_T - onset, 0.0) / (WARM - onset)
    off = delta_T / WARM - 1.0
    bend, curl = float(curve.get("bend", 0.0)), float(curve.get("curl", 0.0))
    return above * (1.0 + bend * off + curl * off**2)


def _friction(rng: Generator) -> Curve:
    """Draw Stribeck friction with a smooth change of sign at a shifted pitch point."""
    return {
        "pitch": float(rng.uniform(-0.6, 0.6)),
        "softness": float(rng.uniform(0.01, 0.15)),
        "rise": float(rng.uniform(0.0, 1.0)),
        "speed": float(rng.uniform(0.05, 0.3)),
        "uneven": float(rng.uniform(-0.3, 0.3)),
    }


def friction(curve: Curve) -> Array:
    """Return friction (n,) over a mesh cycle, with the pitch point in the middle and RMS 1."""
    s = GRID - 0.5
    sign = np.tanh(s / float(curve["softness"]))
    stribeck = 1.0 + float(curve["rise"]) * np.exp(-np.abs(s) / float(curve["speed"]))
    shape = sign * stribeck * (1.0 + float(curve["uneven"]) * sign)
    values: Array = shape / np.sqrt(np.mean(shape**2))
    return values


def _contact(rng: Generator) -> Curve:
    """Draw a contact law of one of four forms."""
    form = str(rng.choice(["rounded power", "polynomial", "saturating", "second stage"]))
    return {
        "form": form,
        "depth": float(10.0 ** rng.uniform(-5.3, -4.5)),
        "share": float(rng.uniform(0.0, 1.0)),
    }


def contact(curve: Curve, size: float) -> Array:
    """Return the factor (n,) on the spring force at ``tables.deflections()``; 1 at ``F_0``.

    The size is the growth of the factor over the logarithm of the deflection between ``FROM`` and
    ``TO``; for a power law that is nearly its exponent less 1. The factor is at least 0.1.
    """
    low, middle, high = _stiffening(curve, np.array([FROM, F_0, TO]))
    steep = (high - low) / np.log(TO / FROM)
    grown = (_stiffening(curve, deflections()) - middle) / steep
    factor: Array = np.maximum(1.0 + size * grown, 0.1)
    return factor


def _stiffening(curve: Curve, f: Array) -> Array:
    """Return an increasing function of the deflection f [m], by the form of the curve."""
    at = f / float(curve["depth"])
    share = float(curve["share"])
    form = curve["form"]
    if form == "rounded power":
        return np.asarray(0.5 * np.log(at**2 + 0.2 + share))
    if form == "polynomial":  # bounded far beyond usual deflections
        q = at / (1.0 + 0.1 * at)
        return np.asarray(q + share * q**2)
    if form == "saturating":
        return np.asarray(np.tanh(at) + share * np.tanh(0.3 * at))
    return np.asarray(np.logaddexp(0.0, (at - 1.0) / (0.1 + 0.4 * share)) + 0.02 * at)


def _damping(rng: Generator) -> Curve:
    """Draw damping that increases with the deflection in steps of random height."""
    steps = rng.dirichlet(np.full(6, 0.6)) * rng.uniform(1.2, 3.0)
    return {
        "out": float(rng.choice([0.0, rng.uniform(0.0, 0.3)])),
        "steps": [float(step) for step in steps],
    }


def damping_factor(curve: Curve) -> Array:
    """Return the factor (n,) on the load-dependent part of a damper, at ``tables.deflections()``.

    The force of the damper is c v (1 - c_share (1 - factor)).

    Args:
        curve: from ``_damping``: ``out``, the factor out of contact, and ``steps`` by which it
            increases with the deflection.
    """
    knots = float(curve["out"]) + np.concatenate([[0.0], np.cumsum(curve["steps"])])
    values: Array = np.interp(GRID, np.linspace(0.0, 1.0, len(knots)), knots)
    width = len(GRID) // 12
    even = np.pad(values, width, mode="edge")
    mean = np.full(2 * width + 1, 1.0 / (2 * width + 1))
    return np.asarray(np.convolve(even, mean, mode="valid"))


def _ring(rng: Generator) -> Curve:
    """Draw relative hardening of the ring's spring and drag at the deflection under 100 kN."""
    return {"growth": float(rng.uniform(0.1, 1.0)), "drag": float(rng.uniform(0.0, 1.0))}


def _bearing(rng: Generator) -> Curve:
    """Draw the law of a planet pin's seat.

    ``softness``: width over which the pin meets the seat, over the clearance, 0 = sharp;
    ``stiffness`` [N/m] of the seat; ``ratio``: its damping ratio; ``growth``: relative growth of
    the stiffness at the deflection under 100 kN; ``film``: damping inside the clearance over that
    on the seat.
    """
    return {
        "softness": float(rng.choice([0.0, rng.uniform(0.1, 0.8)])),
        "stiffness": float(10.0 ** rng.uniform(11.0, 11.7)),
        "ratio": float(rng.uniform(0.03, 0.25)),
        "growth": float(rng.uniform(0.0, 1.0)),
        "film": float(rng.uniform(0.0, 1.0)),
    }


FAMILIES: dict[str, Callable[[Generator], Curve]] = {
    "stiffness_harmonic": _waves,
    "profile_error": _waves,
    "tooth_crack": _event,
    "tooth_spall": _event,
    "runout": _turns,
    "pin_position": _pin,
    "backlash_offset": _flanks,
    "thermal_backlash": _temperature,
    "thermal_stiffness": _temperature,
    "tooth_friction": _friction,
    "contact_nonlinearity": _contact,
    "damping_law": _damping,
    "ring_flexibility": _ring,
    "bearing_clearance": _bearing,
    "torque_ripple": _turns,
}


def draw_law(rng: Generator, name: str, law: str) -> dict[str, Any]:
    """Draw entries of ``Cause.shape``: ``law`` and, unless it is the catalogue's, ``curve``.

    Args:
        name: key of ``plan.KINDS``; without a family of laws there are no entries.
        law: catalogue, other, or both (either at random).
    """
    other = rng.random() < 0.5 if law == "both" else law == "other"
    if name not in FAMILIES:
        return {}
    return {"law": "other", "curve": FAMILIES[name](rng)} if other else {"law": "catalogue"}
