"""Apply the effects of the catalogue to a rig model, by the catalogue's law or a drawn curve.

Each function of an effect returns a changed copy of the rig model.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.practice.cause import Cause, Point
from herringbone_sim.practice.laws import contact, damping_factor, friction, warm, window
from herringbone_sim.practice.rig_model import N_MESH, RigModel
from herringbone_sim.practice.tables import GRID, table, wave

CYCLES = {"sun": 27, "planet": 25, "ring": 77}  # mesh cycles a revolution against the carrier
SEAT = (3e11, 0.1)  # stiffness [N/m] and damping ratio of a pin's seat
RING_LOAD = 1e5  # load [N] at whose deflection a drawn hardening is defined


def _curve(c: Cause) -> dict[str, Any]:
    """Return the drawn curve of a cause, empty for the catalogue's law."""
    curve: dict[str, Any] = c.shape.get("curve", {})
    return curve


def _padded(rows: Array, count: int) -> Array:
    """Return harmonics (h, 12) with zero rows appended up to ``count`` rows."""
    return np.concatenate([rows, np.zeros((max(count - len(rows), 0), rows.shape[1]))])


def _harmonics(c: Cause) -> tuple[Array, Array]:
    """Return cosines and sines (h,) by mesh order of the labelled harmonic and drawn ones.

    The labelled harmonic has amplitude 1; additional ones of the same order are omitted.
    """
    order, angle = int(c.shape["order"]), float(c.shape["angle"])
    riders = [rider for rider in _curve(c).get("riders", ()) if int(rider[0]) != order]
    parts = [(order, 1.0, angle), *riders]
    return wave(parts, max(int(part[0]) for part in parts))


def _added(c: Cause, cos: Array, sin: Array) -> tuple[Array, Array]:
    """Return cosines and sines (h, 12) of a rig model plus those of a cause."""
    additions = [c.size * amplitudes[:, None] * c.meshes for amplitudes in _harmonics(c)]
    count = max(len(cos), len(additions[0]))
    sums = [
        _padded(a, count) + _padded(b, count) for a, b in zip((cos, sin), additions, strict=True)
    ]
    return sums[0], sums[1]


def mean_stiffness(p: RigModel, c: Cause, _: Point) -> RigModel:
    """Scale the stiffness of the meshes of the locus by 1 + signed size."""
    return p._replace(stiffness=p.stiffness * (1.0 + c.sign * c.size * c.meshes))


def stiffness_harmonic(p: RigModel, c: Cause, _: Point) -> RigModel:
    """Add harmonics of the mesh phase to the stiffness."""
    cos, sin = _added(c, p.k_cos, p.k_sin)
    return p._replace(k_cos=cos, k_sin=sin)


def profile_error(p: RigModel, c: Cause, _: Point) -> RigModel:
    """Add harmonics of the mesh phase to the mesh error."""
    cos, sin = _added(c, p.p_cos, p.p_sin)
    return p._replace(p_cos=cos, p_sin=sin)


def advance_phase(p: RigModel, c: Cause, _: Point) -> RigModel:
    """Advance the phase of stiffness and error of the meshes by the signed size [rad]."""
    turn = c.sign * c.size * c.meshes
    cos = p.shift_cos * np.cos(turn) - p.shift_sin * np.sin(turn)
    sin = p.shift_sin * np.cos(turn) + p.shift_cos * np.sin(turn)
    return p._replace(shift_cos=cos, shift_sin=sin)


def lateness(member: str) -> Array:
    """Return the delay (12,), in revolutions of a member, with which its tooth meets each mesh.

    For ``sun`` and ``ring`` relative to the mesh of planet 1, for ``planet`` to its sun mesh.
    """
    mesh = np.arange(float(N_MESH))
    third, ring = mesh % 3.0 / 3.0, np.where(mesh > 5.0, 1.0, 0.0)
    return {"sun": third, "ring": -third, "planet": 0.5 * ring}[member]


def event(p: RigModel, c: Cause, row: int) -> RigModel:
    """Return the rig model with a damaged tooth at the meshes of the cause.

    A rig has one such tooth: begin and width at these meshes, and the window, are overwritten.

    Args:
        p: is not changed.
        c: cause, with member, begin and width of the event.
        row: row of ``RigModel.event`` for the size: 3 depth of a crack [-], 4 height of a spall
            [m].
    """
    member, curve = str(c.shape["member"]), _curve(c)
    late = np.rint(lateness(member) * CYCLES[member])
    if member == "planet" and curve:
        late = np.where(late > 0.0, float(curve["ring_after"]), 0.0)
    hit = c.meshes > 0.0
    events = p.event.copy()
    events[0, hit] = float(CYCLES[member])
    events[1, hit] = ((c.shape["at"] + late) % CYCLES[member])[hit]
    events[2, hit] = float(curve.get("width", c.shape["width"]))
    events[row, hit] = c.size
    shape = window(curve) if curve else 0.5 - 0.5 * np.cos(2.0 * np.pi * GRID)
    return p._replace(event=events, window=table(shape))


def runout(p: RigModel, c: Cause, _: Point) -> RigModel:
    """Add run-out of a member: size * sin(revolution angle + phase), delayed by ``lateness``."""
    member, cycles = str(c.shape["member"]), p.turn_cycles.copy()
    late = 2.0 * np.pi * lateness(member)
    parts = [(1.0, 1.0, 0.5 * np.pi - float(c.shape["phase"])), *_curve(c).get("riders", ())]
    count = max(int(part[0]) for part in parts)
    cos, sin = np.zeros((2, count, N_MESH))
    for m in np.flatnonzero(c.meshes):
        delayed = [(order, amount, angle + order * late[m]) for order, amount, angle in parts]
        cos[:, m], sin[:, m] = (c.size * amplitudes for amplitudes in wave(delayed, count))
        cycles[m] = float(CYCLES[member])
    return p._replace(turn_cycles=cycles, turn_cos=cos, turn_sin=sin)


def _of_meshes(c: Cause) -> Array:
    """Return weights (12,) of the meshes: 0 outside the locus, else 1 or factors of a drawn curve.

    The factors are on ring meshes if the locus has both kinds, on right ones if it has both sides.
    """
    mesh, shares = np.arange(N_MESH), c.meshes
    for part, name, there in (("mesh", "ring", mesh > 5), ("side", "right", mesh // 3 % 2 == 1)):
        if c.locus[part] == "all":
            shares = np.where(there, float(_curve(c).get(name, 1.0)) * shares, shares)
    return shares


def pin_position(p: RigModel, c: Cause, _: Point) -> RigModel:
    """Add the constant displacement of meshes by a pin that is off its position."""
    return p._replace(offset=p.offset + c.sign * c.size * _of_meshes(c))


def backlash_offset(p: RigModel, c: Cause, _: Point) -> RigModel:
    """Change the half-backlash; the labelled offset is the mean of both flanks."""
    back = float(_curve(c).get("back", 1.0))
    more = 2.0 * c.sign * c.size * _of_meshes(c) / (1.0 + back)
    return p._replace(
        half_backlash=np.maximum(p.half_backlash + more, 0.0),
        half_back=np.maximum(p.half_back + back * more, 0.0),
        rounding=p.rounding + float(_curve(c).get("corner", 0.0)) * c.size * c.meshes,
    )


def thermal_backlash(p: RigModel, c: Cause, point: Point) -> RigModel:
    """Change the half-backlash of both flanks by a rate times delta_T, down to 0 at most.

    Args:
        p: rig model without the effect.
        c: cause; its signed size is the rate [m/K] on the meshes of its locus, and its drawn curve
            turns delta_T into an effective one, see ``laws.warm``.
        point: operating point; delta_T [K] is used.

    Returns:
        Changed copy of the rig model.
    """
    more = c.sign * c.size * warm(_curve(c), point["delta_T"]) * c.meshes
    return p._replace(
        half_backlash=np.maximum(p.half_backlash + more, 0.0),
        half_back=np.maximum(p.half_back + more, 0.0),
    )


def thermal_stiffness(p: RigModel, c: Cause, point: Point) -> RigModel:
    """Reduce the stiffness in proportion to delta_T or by a drawn curve; at least 5 % remain."""
    left = np.maximum(1.0 - c.size * warm(_curve(c), point["delta_T"]) * c.meshes, 0.05)
    return p._replace(stiffness=p.stiffness * left)


def tooth_friction(p: RigModel, c: Cause, _: Point) -> RigModel:
    """Add sliding friction with the size as coefficient, by sign of sliding or a drawn curve."""
    p = p._replace(friction=c.size * c.meshes)
    curve = _curve(c)
    return p._replace(pitch=curve["pitch"], rub=table(friction(curve))) if curve else p


def contact_nonlinearity(p: RigModel, c: Cause, _: Point) -> RigModel:
    """Make the mesh springs nonlinear: exponent 1 + size, or a drawn curve."""
    if not _curve(c):
        return p._replace(hertz=p.hertz + c.size * c.meshes)
    return p._replace(bent=1.0 * c.meshes, bend=table(contact(_curve(c), c.size)))


def damping_law(p: RigModel, c: Cause, _: Point) -> RigModel:
    """Make a fraction of the damping (the size) depend on contact or load."""
    p = p._replace(c_share=c.size * c.meshes)
    curve = _curve(c)
    if curve:
        return p._replace(c_curve=table(damping_factor(curve)), c_out=float(curve["out"]))
    return p._replace(c_power=np.array([c.shape["power"], c.shape["depth"]]))


def ring_flexibility(p: RigModel, c: Cause, _: Point) -> RigModel:
    """Let both ring halves move on springs; the size is the compliance [m/N]."""
    free = p.free.copy()
    free[9:11] = 1.0
    damper = 2.0 * c.shape["ratio"] * np.sqrt(p.mass[9] / c.size)
    growth = float(_curve(c).get("growth", 0.0)) / (RING_LOAD * c.size) ** 2
    drag = float(_curve(c).get("drag", 0.0)) / (RING_LOAD * c.size * p.omega)
    return p._replace(free=free, ring=np.array([1.0 / c.size, damper, growth, drag]))


def bearing_clearance(p: RigModel, c: Cause, _: Point) -> RigModel:
    """Let a planet pin move in the carrier by a clearance, the size [m], on a flexible seat."""
    pin = 11 + int(c.locus["planet"]) - 1
    free, mass = p.free.copy(), p.mass.copy()
    free[pin] = 1.0
    mass[2] -= mass[pin]
    curve = _curve(c)
    stiffness, ratio = (curve["stiffness"], curve["ratio"]) if curve else SEAT
    damper = 2.0 * ratio * np.sqrt(stiffness * mass[pin])
    width = float(curve.get("softness", 0.0)) * c.size
    growth = float(curve.get("growth", 0.0)) / (RING_LOAD / stiffness) ** 2
    film = float(curve.get("film", 1.0))
    support = np.array([c.size, stiffness, damper, width, growth, film])
    return p._replace(free=free, mass=mass, support=support)


def torque_ripple(p: RigModel, c: Cause, _: Point) -> RigModel:
    """Add harmonics of the sun's revolution to the input torque; the size is relative to T_1."""
    parts = [(1.0, 1.0, 0.5 * np.pi - float(c.shape["phase"])), *_curve(c).get("riders", ())]
    waves = wave(parts, max(int(part[0]) for part in parts))
    return p._replace(ripple_order=float(c.shape["order"]), ripple=c.size * np.stack(waves))
