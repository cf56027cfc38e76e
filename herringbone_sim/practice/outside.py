"""Effects outside the catalogue, which a diagnosis should call unknown."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.random import Generator

from herringbone_sim.practice.cause import ALL, Cause, Kind, Point, at, draw_kind_locus, draw_locus
from herringbone_sim.practice.rig_model import RigModel


def _phase_by_load(p: RigModel, c: Cause, _: Point) -> RigModel:
    """Shift the phase of the stiffness with the load."""
    return p._replace(phase_by_load=c.size * c.meshes)


def _half_order(p: RigModel, c: Cause, _: Point) -> RigModel:
    """Add a stiffness harmonic of half the mesh order."""
    return p._replace(k_half=c.size * c.meshes)


def _drift(p: RigModel, c: Cause, _: Point) -> RigModel:
    """Let the stiffness grow during the run."""
    return p._replace(k_drift=c.sign * c.size * c.meshes)


def _cross(p: RigModel, c: Cause, _: Point) -> RigModel:
    """Couple the spring forces of the left and right side."""
    return p._replace(cross=c.size * c.meshes)


def _plate(p: RigModel, c: Cause, _: Point) -> RigModel:
    """Let the right plate of the carrier move on a spring; the size is the compliance [m/N]."""
    free, mass = p.free.copy(), p.mass.copy()
    free[14] = 1.0
    mass[2] -= mass[14]
    damper = 2.0 * 0.05 * np.sqrt(mass[14] / c.size)
    return p._replace(free=free, mass=mass, plate=np.array([1.0 / c.size, damper]))


def _stick_slip(p: RigModel, c: Cause, _: Point) -> RigModel:
    """Add dry friction with stick-slip to the output."""
    return p._replace(output=np.array([c.size, c.shape["speed"]]))


def _shock(p: RigModel, c: Cause, _: Point) -> RigModel:
    """Add periodic shocks to the carrier."""
    return p._replace(shock=np.array([c.size, c.shape["cycles"], c.shape["width"]]))


def _gyro(p: RigModel, c: Cause, _: Point) -> RigModel:
    """Couple sun and planet 1 on the left by a skew-symmetric damping."""
    return p._replace(gyro=c.size)


def _size(unit: str) -> Any:
    return lambda c: {"size": (c.size, unit)}


def _drift_draw(rng: Generator, _: tuple[str, ...]) -> tuple[dict[str, Any], dict[str, Any]]:
    return draw_locus(rng), {"sign": float(rng.choice([-1.0, 1.0]))}


OUTSIDE: dict[str, Kind] = {
    "phase_by_load": Kind(
        "law", 0.1, 1.2, lambda rng, _: (draw_kind_locus(rng), {}), _phase_by_load, _size("rad")
    ),
    "half_order_stiffness": Kind(
        "law", 0.05, 0.5, lambda rng, _: (draw_locus(rng), {}), _half_order, _size("-")
    ),
    "drifting_stiffness": Kind("law", 0.1, 0.6, _drift_draw, _drift, _size("-")),
    "side_coupling": Kind(
        "law", 0.05, 0.5, lambda rng, _: (draw_kind_locus(rng), {}), _cross, _size("-")
    ),
    "carrier_flexibility": Kind(
        "law", 1e-12, 5e-10, lambda rng, _: (at(side="R"), {}), _plate, _size("m/N")
    ),
    "output_stick_slip": Kind(
        "body",
        1e3,
        3e4,
        lambda rng, _: (dict(ALL), {"speed": float(rng.uniform(0.02, 0.1))}),
        _stick_slip,
        _size("N"),
    ),
    "output_shock": Kind(
        "body",
        2e3,
        1e5,
        lambda rng, _: (
            dict(ALL),
            {"cycles": float(rng.uniform(6.0, 16.0)), "width": float(rng.uniform(0.5, 2.0))},
        ),
        _shock,
        _size("N"),
    ),
    "gyroscopic_coupling": Kind(
        "body", 1e3, 2e4, lambda rng, _: (at("sp", 1, "L"), {}), _gyro, _size("N s/m")
    ),
}
