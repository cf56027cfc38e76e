"""Bearing clearance: a planet's pin moves freely in the carrier within a dead zone.

The pin sits w ahead of its place in the carrier, whose coordinate is y = r_bc theta_c:

    m (w'' + y'') = P - H,  P = cos beta sum F over the meshes of the pin,
    H = k g(w) + c w',      c = 2 damping sqrt(k m),
    (M_c - sum m) y'' = cos beta sum F over all other meshes + sum H - T_2 / r_bc + control.

g is the backlash function whose half-width is the clearance, its corners sharp, or rounded by
ln(1 + e^z) over softness times the clearance. The meshes of the pin get the displacement
d = -w cos beta. Eq. (14) of the carrier holds for rigid pins, on which P acts; it is corrected by
-m w''. I_ce contains m_p once per planet: m = m_p for a pin with both halves, m_p / 2 if one half
alone is free. Torques of other effects on the carrier act as if pins were rigid. Without clearance
the pin is rigid. Source: dead-zone supports as in Guo and Parker (J. Sound Vib. 331, 2012), in
Eqs. (13), (14).
"""

from __future__ import annotations

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import Model
from herringbone_sim.effects.effect import Effect, Options, Parameter
from herringbone_sim.effects.law import CONTROL, PHASE, SHIFT, SHIFT_RATE, TORQUE, law, play
from herringbone_sim.effects.slots import Coordinates, Slots

CLEARANCE, STIFFNESS, DAMPING, SOFTNESS = range(4)
MASK, PIN, MASS, COS_BETA, MULTIPLICITY, CARRIER, BRAKE, DRIVE, ORDER, ANGLE, REST = range(11)


def place(model: Model, mask: Array, options: Options) -> Array:
    """Return ``site``, rows (11, n_mesh).

    1 on both meshes of a free half; index of its pin; mass of the pin [kg] at the index of the
    pin, else 0; cos beta; number of planets that a mesh represents; M_c [kg]; T_2 / r_bc over T_1
    [1/m]; force on the carrier for K = 1 [N]; order and phase [rad] of the control; T_2 / r_bc [N]
    of a gear without T_1, else 0.
    """
    p, s = model.parameters, model.scales
    halves = mask.size // 2
    free = np.maximum(mask[:halves], mask[halves:]).reshape(2, -1)
    pin = np.arange(halves).reshape(2, -1)
    pin[1] = np.where((free > 0.0).all(axis=0), pin[0], pin[1])
    mass = 0.5 * p.m_p * np.bincount(pin.ravel(), free.ravel(), halves)
    brake = s.T_2 / (s.r_bc * p.T_1) if p.T_1 else 2.0 / s.r_bs
    drive = s.M_c * s.acceleration_m_per_s2 / s.cos_beta
    alone = 0.0 if p.T_1 else s.T_2 / s.r_bc
    control = (drive, p.control_order, p.control_phase, alone)
    rest = (s.cos_beta, model.packed.multiplicity, s.M_c, brake, *control)
    rows = [np.tile(row, 2) for row in (free.ravel(), pin.ravel(), mass)]
    return np.stack([*rows, *(np.full(mask.size, value) for value in rest)])


@law
def rise(z):
    """Return ln(1 + e^z), a smooth max(z, 0), computed without overflow."""
    return max(z, 0.0) + np.log1p(np.exp(-abs(z)))


@law
def hold(theta, mass, w, rate):
    """Return the seat force H [N] for a pin of a mass [kg] at displacement w [m] and its rate."""
    width = theta[SOFTNESS] * theta[CLEARANCE]
    b = theta[CLEARANCE]
    g = play(w, b)
    if width > 0.0:
        g = width * (rise((w - b) / width) - rise((-w - b) / width))
    damping = 2.0 * theta[DAMPING] * np.sqrt(theta[STIFFNESS] * mass)
    return theta[STIFFNESS] * g + damping * rate


@law
def carrier_acceleration(theta, site, now, added_states, force):
    """Return the acceleration y'' [m/s^2] of the carrier without its free pins, Eq. (14)."""
    angle = site[ORDER, 0] * now[PHASE] + site[ANGLE, 0]
    load = site[DRIVE, 0] * now[CONTROL] * np.cos(angle) - site[BRAKE, 0] * now[TORQUE]
    load -= site[REST, 0]
    left = site[CARRIER, 0]
    for m in range(force.size):
        if site[MASK, m] == 0.0:
            load += site[MULTIPLICITY, m] * site[COS_BETA, m] * force[m]
    for k in range(force.size // 2):
        mass = site[MASS, k]
        if mass > 0.0:
            load += site[MULTIPLICITY, k] * hold(
                theta, mass, added_states[2 * k], added_states[2 * k + 1]
            )
            left -= site[MULTIPLICITY, k] * mass
    return load / left


@law
def excite(theta, site, gear, now, added_states, law):
    """Add the displacement d = -w cos beta and its rate on all meshes of a free pin."""
    if theta[CLEARANCE] > 0.0:
        for m in range(law.shape[1]):
            if site[MASK, m] != 0.0:
                pin = int(site[PIN, m])
                law[SHIFT, m] -= site[COS_BETA, m] * added_states[2 * pin]
                law[SHIFT_RATE, m] -= site[COS_BETA, m] * added_states[2 * pin + 1]


@law
def react(theta, site, gear, now, added_states, x, v, law, force, torque):
    """Correct the torque on the carrier by -m w'' = H + m y'' - P of each free pin."""
    if theta[CLEARANCE] > 0.0:
        y = carrier_acceleration(theta, site, now, added_states, force)
        for m in range(force.size):
            if site[MASK, m] != 0.0:
                torque[2] -= site[MULTIPLICITY, m] * site[COS_BETA, m] * force[m]
        for k in range(force.size // 2):
            mass = site[MASS, k]
            if mass > 0.0:
                seat = hold(theta, mass, added_states[2 * k], added_states[2 * k + 1])
                torque[2] += site[MULTIPLICITY, k] * (seat + mass * y)


@law
def drive(theta, site, gear, now, added_states, force, slope):
    """Write w' and w'' of each free pin, whose states are 2 pin and 2 pin + 1."""
    half = force.size // 2
    slope[:] = 0.0
    if theta[CLEARANCE] > 0.0:
        y = carrier_acceleration(theta, site, now, added_states, force)
        for m in range(force.size):
            if site[MASK, m] != 0.0:
                slope[2 * int(site[PIN, m]) + 1] += site[COS_BETA, m] * force[m]
        for k in range(half):
            mass = site[MASS, k]
            if mass > 0.0:
                push = slope[2 * k + 1] - hold(
                    theta, mass, added_states[2 * k], added_states[2 * k + 1]
                )
                slope[2 * k] = added_states[2 * k + 1]
                slope[2 * k + 1] = push / mass - y


def fill(slots: Slots, theta: tuple[float, ...], mask: Array, options: Options) -> None:
    """Add w of each free pin as a coordinate, with the correction of the carrier."""
    if theta[CLEARANCE] <= 0.0:
        return
    model = slots.model
    rows = place(model, mask, options)
    T_1, bodies = model.parameters.T_1, len(model.layout.bodies)
    pins = np.flatnonzero(rows[MASS, : mask.size // 2])
    held = rows[MASK] != 0.0
    here = np.array([held & (rows[PIN] == pin) for pin in pins], dtype=float)
    mass, multiplicity, cos_beta = rows[MASS, pins], rows[MULTIPLICITY, pins], rows[COS_BETA, 0]
    free = rows[CARRIER, 0] - np.sum(multiplicity * mass)
    # Acceleration of the carrier without its free pins: by mesh forces, seats and other loads.
    by_mesh = rows[MULTIPLICITY] * cos_beta * ~held / free
    by_seat = multiplicity / free
    by_load = -(rows[BRAKE, 0] * T_1 + rows[REST, 0]) / free
    by_control = rows[DRIVE, 0] / free
    inertia = np.sum(multiplicity * mass)
    carrier = np.eye(bodies)[2]
    width = theta[SOFTNESS] * theta[CLEARANCE]
    seats = [
        (theta[STIFFNESS], 2.0 * theta[DAMPING] * np.sqrt(theta[STIFFNESS] * m)) for m in mass
    ]
    slots.add_coordinates(
        Coordinates(
            shift=-cos_beta * here,
            seat=np.array([(*seat, theta[CLEARANCE], width) for seat in seats]),
            force=cos_beta * here / mass[:, None] - by_mesh,
            hold=-np.diag(1.0 / mass) - by_seat,
            load=np.full(len(pins), -by_load),
            control=np.full(len(pins), -by_control),
            body_force=np.outer(inertia * by_mesh - rows[MULTIPLICITY] * cos_beta * held, carrier),
            body_hold=np.outer(multiplicity + inertia * by_seat, carrier),
            body_load=inertia * by_load * carrier,
            body_control=inertia * by_control * carrier,
        )
    )


EFFECT = Effect(
    id="bearing_clearance",
    text="dead zone in a planet's support",
    level="mesh",
    parameters=(
        Parameter("clearance", "m", "way of the pin to either side", 0.0, 1e-4, 5e-6),
        Parameter("stiffness", "N/m", "of the seat", 1e8, 1e12, 3e10, neutral=None),
        Parameter("damping", "-", "ratio on the seat", 0.0, 1.0, 0.1, neutral=None),
        Parameter("softness", "-", "rounding over clearance", 0.0, 1.0, 0.0, neutral=None),
    ),
    loci=(("all", "*", "all"), ("all", "*", "*")),
    once=True,
    place=place,
    fill=fill,
    excite=excite,
    react=react,
    drive=drive,
    states=lambda model: model.layout.n_mesh,
)
