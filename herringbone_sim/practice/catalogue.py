"""Effects of the catalogue on a practice rig: how each is drawn, applied and labelled."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.random import Generator

from herringbone_sim.practice import apply_causes
from herringbone_sim.practice.apply_causes import CYCLES
from herringbone_sim.practice.cause import (
    ALL,
    Cause,
    Drawn,
    Kind,
    angle,
    at,
    by_kind,
    draw_kind_locus,
    draw_locus,
    signed,
    size_as,
)

Parameters = dict[str, tuple[Any, str]]


def _draw_event(rng: Generator, _: tuple[str, ...]) -> Drawn:
    """Draw locus and shape of a tooth event: member, begin ``at`` and width [mesh cycles].

    A tooth of sun or ring meets every planet of its side. One of a planet is damaged on the flank
    to the sun, to the ring, or both.
    """
    member, side = str(rng.choice(list(CYCLES))), str(rng.choice(["L", "R"]))
    shape = {
        "member": member,
        "at": float(rng.uniform(0.0, CYCLES[member])),
        "width": float(rng.uniform(0.8, 1.6)),
    }
    if member == "planet":
        mesh = str(rng.choice(["all", "sp", "rp"]))
        return at(mesh, int(rng.integers(1, 4)), side), shape
    return at("sp" if member == "sun" else "rp", "all", side), shape


def _event_parameters(c: Cause, name: str, unit: str) -> Parameters:
    """Return the label parameters of a tooth event, with its size as ``name``."""
    member = c.shape["member"]
    parameters: Parameters = {name: (c.size, unit), "member": (member, "-")}
    return parameters | ({"order": (CYCLES[member], "-")} if name == "depth" else {})


def _draw_runout(rng: Generator, _: tuple[str, ...]) -> Drawn:
    """Draw locus, member and phase [rad] of a run-out."""
    member = str(rng.choice(list(CYCLES)))
    shape = {"member": member, "phase": angle(rng)}
    side = str(rng.choice(["L", "R", "all"]))
    if member == "planet":
        return at("all", int(rng.integers(1, 4)), side), shape
    return at("sp" if member == "sun" else "rp", "all", side), shape


def _draw_damping(rng: Generator, _: tuple[str, ...]) -> Drawn:
    """Draw locus and shape of a damping law.

    ``power`` of the deflection: 0 is by contact alone, else by load; ``depth``: deflection [m] at
    which the damping is nominal.
    """
    power = float(rng.choice([0.0, 1.0, rng.uniform(0.2, 1.0)]))
    return draw_kind_locus(rng), {"power": power, "depth": float(rng.uniform(1.5e-5, 4e-5))}


def _ripple_draw(rng: Generator, _: tuple[str, ...]) -> Drawn:
    """Draw order, per sun revolution, and phase [rad] of a torque ripple."""
    return dict(ALL), {"order": int(rng.integers(1, 61)), "phase": angle(rng)}


def _wave_parameters(unit: str) -> Any:
    """Return a ``Kind.parameters`` function that gives order, cosine and sine of a harmonic."""
    return lambda c: {
        "order": (c.shape["order"], "-"),
        "cos": (c.size * np.cos(c.shape["angle"]), unit),
        "sin": (c.size * np.sin(c.shape["angle"]), unit),
    }


def _draw_waves(least: int) -> Any:
    """Return a ``Kind.draw`` for a harmonic: meshes, order (``least`` to 4) and angle [rad]."""
    return lambda rng, _: (
        draw_locus(rng),
        {"order": int(rng.integers(least, 5)), "angle": angle(rng)},
    )


def _anywhere_or_all(rng: Generator) -> dict[str, Any]:
    return dict(ALL) if rng.random() < 0.25 else draw_locus(rng)


def _one_planet(rng: Generator) -> dict[str, Any]:
    return at("all", int(rng.integers(1, 4)))


CATALOGUE: dict[str, Kind] = {
    "mean_stiffness": Kind(
        "law",
        0.05,
        0.5,
        signed(draw_locus),
        apply_causes.mean_stiffness,
        lambda c: {"factor": (1.0 + c.sign * c.size, "-")},
    ),
    "stiffness_harmonic": Kind(
        "law", 0.05, 0.5, _draw_waves(1), apply_causes.stiffness_harmonic, _wave_parameters("-")
    ),
    "stagger": Kind(
        "law",
        0.05,
        1.0,
        signed(lambda rng: at(side=str(rng.choice(["L", "R"])))),
        apply_causes.advance_phase,
        size_as("phase", "rad"),
    ),
    "planet_phase": Kind(
        "law", 0.05, 1.0, signed(_one_planet), apply_causes.advance_phase, size_as("phase", "rad")
    ),
    "tooth_crack": Kind(
        "law",
        0.3,
        0.9,
        _draw_event,
        lambda p, c, _: apply_causes.event(p, c, 3),
        lambda c: _event_parameters(c, "depth", "-"),
    ),
    "tooth_spall": Kind(
        "law",
        5e-6,
        6e-5,
        _draw_event,
        lambda p, c, _: apply_causes.event(p, c, 4),
        lambda c: _event_parameters(c, "height", "m"),
    ),
    "runout": Kind(
        "law",
        2e-6,
        4e-5,
        _draw_runout,
        apply_causes.runout,
        lambda c: {
            "amplitude": (c.size, "m"),
            "phase": (c.shape["phase"], "rad"),
            "member": (c.shape["member"], "-"),
        },
    ),
    "pin_position": Kind(
        "law",
        2e-6,
        3e-5,
        signed(_one_planet),
        apply_causes.pin_position,
        size_as("offset", "m"),
    ),
    "backlash_offset": Kind(
        "law",
        2e-6,
        2e-5,
        signed(_anywhere_or_all),
        apply_causes.backlash_offset,
        size_as("offset", "m"),
    ),
    "thermal_backlash": Kind(
        "law",
        4e-8,
        3e-7,
        signed(draw_kind_locus),
        apply_causes.thermal_backlash,
        size_as("rate", "m/K"),
    ),
    "thermal_stiffness": Kind(
        "law",
        1e-3,
        1e-2,
        by_kind,
        apply_causes.thermal_stiffness,
        size_as("rate", "1/K"),
    ),
    "tooth_friction": Kind(
        "body",
        0.05,
        0.4,
        by_kind,
        apply_causes.tooth_friction,
        size_as("mu", "-"),
    ),
    "contact_nonlinearity": Kind(
        "law",
        0.03,
        0.5,
        by_kind,
        apply_causes.contact_nonlinearity,
        lambda c: {"exponent": (1.0 + c.size, "-")},
    ),
    "damping_law": Kind(
        "law",
        0.3,
        1.0,
        _draw_damping,
        apply_causes.damping_law,
        size_as("share", "-"),
    ),
    "profile_error": Kind(
        "law", 2e-6, 3e-5, _draw_waves(2), apply_causes.profile_error, _wave_parameters("m")
    ),
    "ring_flexibility": Kind(
        "law",
        1e-11,
        2e-9,
        lambda rng, _: (at("rp"), {"ratio": float(rng.uniform(0.03, 0.1))}),
        apply_causes.ring_flexibility,
        lambda c: {"stiffness": (1.0 / c.size, "N/m"), "damping": (c.shape["ratio"], "-")},
    ),
    "bearing_clearance": Kind(
        "law",
        1e-6,
        2.5e-5,
        lambda rng, _: (_one_planet(rng), {}),
        apply_causes.bearing_clearance,
        size_as("clearance", "m"),
        least=5e-7,
    ),
    "torque_ripple": Kind(
        "body",
        0.2,
        1.5,
        _ripple_draw,
        apply_causes.torque_ripple,
        lambda c: {"amplitude": (c.size, "-"), "order": (c.shape["order"], "-")},
    ),
}
