"""Tolerances of gear and sensors: coefficients contained in every hypothesis."""

from __future__ import annotations

import numpy as np

from herringbone_sim.diagnosis.coefficients import Coefficient
from herringbone_sim.effects.site import is_ring
from herringbone_sim.gap.observations import torque_balance
from herringbone_sim.gap.observations.common_filter import MAX_FILTER_COEFFICIENTS
from herringbone_sim.gap.observations.hypotheses.coefficients import CoefficientBuilder, Weights
from herringbone_sim.gap.residuals.torque_balance import control_directions, inertia_parts
from herringbone_sim.gap.sensors.filter_delay import CORNER

GAUGE_GAIN_TOLERANCE = 0.05  # gain of a strain gauge, by data sheet


def tolerances(builder: CoefficientBuilder) -> tuple[Coefficient, ...]:
    """Coefficients of every hypothesis: departures of a healthy rig from its data sheet.

    They are k, c and e of sun and ring meshes, delays of k and e, common filter, its delay and
    attenuation against the control, quadrature error of the balance, masses, gains of force
    channels. Bounds: data sheet, or campaign (force gains).
    """
    gear = builder.gear
    ring = is_ring(gear.model.layout)
    coefficients = []
    for kind, on in (("sp", 1.0 - ring), ("rp", ring)):
        for what, function, bound in (
            ("k", "kappa", 0.02),
            ("c", "gamma", 0.04),
            ("e", "error", 0.02),
        ):
            coefficients.append(
                builder.coefficient(f"{what}_{kind}", {function: on}, bound / 3**0.5, bound)
            )
    late = -gear.omegas[:, None]
    for name, function in (("delay of k", "shift k"), ("delay of e", "shift e")):
        coefficients.append(builder.coefficient(name, {function: late}, 2.5e-6, 5e-6))
    for i, largest in enumerate(MAX_FILTER_COEFFICIENTS):
        name = f"filter {i + 1}"
        coefficients.append(builder.coefficient(name, {name: 1.0}, 0.5 * largest, largest))
    coefficients += _filtered_control(builder)
    of_quadrature: Weights = {(torque_balance.NAME, "quadrature"): 1.0}
    coefficients.append(builder.coefficient("quadrature", of_quadrature, 0.3, 1.0))
    for mass in torque_balance.MASSES:
        of_mass: Weights = {
            (o, mass): 1.0 for o in (torque_balance.NAME, *builder.window_observation)
        }
        coefficients.append(builder.coefficient(mass, of_mass, 0.02 / 3**0.5, 0.0205))
    for gauge in gear.gauges:
        name = f"gain of {gauge}"
        of_gauge: Weights = {(o, name): 1.0 for o in builder.window_observation}
        coefficients.append(
            builder.coefficient(
                name, of_gauge, GAUGE_GAIN_TOLERANCE / 3**0.5, GAUGE_GAIN_TOLERANCE
            )
        )
    for j, tolerance in enumerate(gear.gain_tolerance):
        if tolerance > 0.0 and gear.force_known[j] and not gear.uses_windows:
            weights = _force_gain(builder, j)
            coefficients.append(
                builder.coefficient(f"gain {j}", weights, tolerance / 3**0.5, tolerance)
            )
    return tuple(coefficients)


def _filtered_control(builder: CoefficientBuilder) -> list[Coefficient]:
    """Coefficients of delay and attenuation by a filter of all channels: control is not filtered.

    The attenuation is that of a filter of first order with the lowest corner of the data sheet.
    """
    gear, packed = builder.gear, builder.gear.model.packed
    along = control_directions(gear.model)
    turn = gear.omegas[:, None] * packed.control_order
    share = 0.5 * (turn / (CORNER * gear.model.scales.omega_n)) ** 2
    wave, late = torque_balance.CONTROL
    delay: Weights = {(torque_balance.NAME, late): turn * along}
    fall: Weights = {(torque_balance.NAME, wave): -share * along}
    for o in builder.window_observation:
        delay[o, late], fall[o, wave] = turn, -share
    return [
        builder.coefficient("delay of K", delay, 2.5e-6, 5e-6),
        builder.coefficient("share of K", fall, 0.5, 1.0),
    ]


def _force_gain(builder: CoefficientBuilder, j: int) -> Weights:
    """Weights of a gain error of force sensor j: force law, and balance with opposite sign.

    It does not act in a balance that takes the force of the mesh from the law.
    """
    on = np.zeros(builder.gear.model.layout.n_mesh)
    on[j] = 1.0
    if builder.gear.modelled[j]:
        return {"F gain": on}
    reach = inertia_parts(builder.gear.model).sum(0)
    return {"F gain": on, (torque_balance.NAME, f"F of {j}"): -reach[:, j]}
