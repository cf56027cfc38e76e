"""Effects outside the catalogue, which a diagnosis should call unknown.

Effects in ``OUTSIDE`` were known when the verdict ``unknown`` was developed. No rule or weight was
ever tuned on those in ``UNSEEN``, so they show how it treats a cause that nobody anticipated.
"""

from __future__ import annotations

import numpy as np

from herringbone_sim.practice.cause import (
    ALL,
    Cause,
    Kind,
    Point,
    anywhere,
    at,
    by_kind,
    draw_locus,
    on_meshes,
    signed,
    size_as,
)
from herringbone_sim.practice.kernel import SHOCK_PEAK
from herringbone_sim.practice.rig_model import RigModel
from herringbone_sim.practice.sensors import sensor_kind


def _plate(p: RigModel, c: Cause, _: Point) -> RigModel:
    """Let the right plate of the carrier move on a spring; the size is the compliance [m/N]."""
    free, mass = p.free.copy(), p.mass.copy()
    free[14] = 1.0
    mass[2] -= mass[14]
    damper = 2.0 * 0.05 * np.sqrt(mass[14] / c.size)
    return p._replace(free=free, mass=mass, plate=np.array([1.0 / c.size, damper]))


def _stick_slip(p: RigModel, c: Cause, _: Point) -> RigModel:
    """Add dry friction at the output whose force falls with speed, so that it can stick."""
    return p._replace(output=np.array([c.size, c.shape["speed"]]))


def _shock(p: RigModel, c: Cause, _: Point) -> RigModel:
    """Add periodic shocks to the carrier, and their mean to the load, so that the speed holds."""
    cycles, width = c.shape["cycles"], c.shape["width"]
    mean = c.size * width / cycles / 60.0 / SHOCK_PEAK  # 1 / 60: integral of z^2 (1 - z)^3
    return p._replace(shock=np.array([c.size, cycles, width]), brake=p.brake + mean)


OUTSIDE: dict[str, Kind] = {
    "phase_by_load": Kind(
        "law", 0.1, 1.2, by_kind, on_meshes("phase_by_load"), size_as("size", "rad")
    ),
    "half_order_stiffness": Kind(
        "law", 0.05, 0.5, anywhere, on_meshes("k_half"), size_as("size", "-")
    ),
    "drifting_stiffness": Kind(
        "law",
        0.1,
        0.6,
        signed(draw_locus),
        on_meshes("k_drift"),
        lambda c: {"size": (c.size, "-")},
    ),
    "side_coupling": Kind("law", 0.05, 0.5, by_kind, on_meshes("cross"), size_as("size", "-")),
    "carrier_flexibility": Kind(
        "law", 1e-12, 5e-10, lambda rng, _: (at(side="R"), {}), _plate, size_as("size", "m/N")
    ),
    "output_stick_slip": Kind(
        "body",
        1e3,
        3e4,
        lambda rng, _: (dict(ALL), {"speed": float(rng.uniform(0.02, 0.1))}),
        _stick_slip,
        size_as("size", "N"),
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
        size_as("size", "N"),
    ),
    "gyroscopic_coupling": Kind(
        "body",
        1e3,
        2e4,
        lambda rng, _: (at("sp", 1, "L"), {}),
        lambda p, c, _: p._replace(gyro=c.size),
        size_as("size", "N s/m"),
    ),
}
UNSEEN: dict[str, Kind] = {
    "material_hysteresis": Kind(
        "law", 0.05, 0.6, by_kind, on_meshes("hysteresis"), size_as("size", "-")
    ),
    "square_damping": Kind(
        "law", 0.1, 50.0, by_kind, on_meshes("c_square"), size_as("size", "s/m")
    ),
    "squeeze_film": Kind("law", 0.5, 50.0, by_kind, on_meshes("film"), size_as("size", "-")),
    "stiffness_by_turn": Kind(
        "law", 0.05, 0.5, anywhere, on_meshes("k_turn"), size_as("size", "-")
    ),
    "second_pair": Kind("law", 0.1, 2.0, by_kind, on_meshes("k_second"), size_as("size", "-")),
    "torsion_bar": Kind(
        "body",
        1e7,
        2e9,
        lambda rng, _: (at("sp"), {}),
        lambda p, c, _: p._replace(bar=c.size),
        size_as("size", "N/m"),
    ),
    "windage": Kind(
        "body",
        1e2,
        1e5,
        lambda rng, _: (dict(ALL), {}),
        lambda p, c, _: p._replace(windage=c.size),
        size_as("size", "N s2/m2"),
    ),
    "crosstalk": sensor_kind(0.02, 0.6, lambda c: {"size": (c.size, "-")}),
    "soft_saturation": sensor_kind(0.02, 1.0, lambda c: {"size": (c.size, "-")}),
}
