"""The effects of the catalogue as a practice rig has them: other shapes than a textbook's.

Harmonics leak into the next order, a crack is a skewed raised cosine, a spall an asymmetric bump,
friction turns smoothly and falls with speed (``kernel``), clearance has rounded ends.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.random import Generator

from herringbone_sim.practice.cause import ALL, Cause, Kind, Point, anywhere, at, by_kind, sign
from herringbone_sim.practice.machine import N_MESH, Array, Machine

Drawn = tuple[dict[str, Any], dict[str, Any]]
Told = dict[str, tuple[Any, str]]
EVENT_CYCLES = {"sun": 27, "planet": 25, "ring": 77}
PIN_STIFFNESS = 3e11


def _angle(rng: Generator) -> float:
    return float(rng.uniform(-np.pi, np.pi))


def _mean_stiffness(p: Machine, c: Cause, _: Point) -> Machine:
    return p._replace(stiffness=p.stiffness * (1.0 + c.sign * c.size * c.meshes))


def _harmonic(p: Machine, c: Cause, _: Point) -> Machine:
    k_cos, k_sin = _waves(c, p.k_cos, p.k_sin)
    return p._replace(k_cos=k_cos, k_sin=k_sin)


def _profile(p: Machine, c: Cause, _: Point) -> Machine:
    p_cos, p_sin = _waves(c, p.p_cos, p.p_sin)
    return p._replace(p_cos=p_cos, p_sin=p_sin)


def _waves(c: Cause, cos: Array, sin: Array) -> tuple[Array, Array]:
    cos, sin = cos.copy(), sin.copy()
    order, angle = int(c.shape["order"]), float(c.shape["angle"])
    for step, share in ((0, 1.0), (1, 0.1)):
        cos[order - 1 + step] += share * c.size * np.cos(angle) * c.meshes
        sin[order - 1 + step] += share * c.size * np.sin(angle) * c.meshes
    return cos, sin


def _shift(p: Machine, c: Cause, _: Point) -> Machine:
    turn = c.sign * c.size * c.meshes
    cos = p.shift_cos * np.cos(turn) - p.shift_sin * np.sin(turn)
    sin = p.shift_sin * np.cos(turn) + p.shift_cos * np.sin(turn)
    return p._replace(shift_cos=cos, shift_sin=sin)


def _event(p: Machine, c: Cause, row: int) -> Machine:
    event = p.event.copy()
    hit = c.meshes > 0.0
    period = float(EVENT_CYCLES[c.shape["member"]])
    apart = np.rint(np.arange(N_MESH) % 3 * period / 3.0)
    apart *= -1.0 if c.shape["member"] == "ring" else 1.0
    event[0, hit] = period
    event[1, hit] = ((c.shape["at"] + apart * c.shape["passes"]) % period)[hit]
    event[2, hit], event[3, hit] = c.shape["width"], c.shape["skew"]
    event[row, hit] = c.size
    return p._replace(event=event)


def _draw_event(rng: Generator, _: tuple[str, ...]) -> Drawn:
    member = str(rng.choice(list(EVENT_CYCLES)))
    mesh = {"sun": "sp", "ring": "rp"}.get(member) or str(rng.choice(["sp", "rp"]))
    passes = member != "planet" and rng.random() < 0.7
    side = str(rng.choice(["L", "R"]))
    shape = {
        "member": member,
        "passes": bool(passes),
        "at": float(rng.uniform(0.0, EVENT_CYCLES[member])),
        "width": float(rng.uniform(0.8, 1.6)),
        "skew": float(rng.uniform(0.7, 1.4)),
    }
    return at(mesh, "all" if passes else int(rng.integers(1, 4)), side), shape


def _tell_event(c: Cause, name: str, unit: str) -> Told:
    member = c.shape["member"]
    told: Told = {name: (c.size, unit), "member": (member, "-")}
    return told | ({"order": (EVENT_CYCLES[member], "-")} if name == "depth" else {})


def _draw_runout(rng: Generator, _: tuple[str, ...]) -> Drawn:
    member = str(rng.choice(list(EVENT_CYCLES)))
    shape = {"member": member, "phase": _angle(rng), "second": 0.12, "turn": _angle(rng)}
    side = str(rng.choice(["L", "R", "all"]))
    if member == "planet":
        return at("all", int(rng.integers(1, 4)), side), shape
    return at("sp" if member == "sun" else "rp", "all", side), shape


def _runout(p: Machine, c: Cause, _: Point) -> Machine:
    third, half = 2.0 * np.pi / 3.0 * (np.arange(N_MESH) % 3), np.pi * (np.arange(N_MESH) > 5)
    late = {"sun": third, "ring": -third, "planet": half}[str(c.shape["member"])]
    runout = p.runout.copy()
    hit = c.meshes > 0.0
    runout[0, hit] = c.size
    runout[1, hit] = float(EVENT_CYCLES[c.shape["member"]])
    runout[2, hit] = (c.shape["phase"] - late)[hit]
    runout[3, hit], runout[4, hit] = c.shape["second"], c.shape["turn"]
    return p._replace(runout=runout)


def _pin(p: Machine, c: Cause, _: Point) -> Machine:
    share = np.where(np.arange(N_MESH) < 6, 1.0, 0.94)
    return p._replace(offset=p.offset + c.sign * c.size * c.meshes * share)


def _backlash(p: Machine, c: Cause, _: Point) -> Machine:
    half = p.half_backlash + c.sign * c.size * c.meshes
    return p._replace(half_backlash=np.maximum(half, 0.0), rounding=0.1 * c.size * c.meshes)


def _thermal_backlash(p: Machine, c: Cause, point: Point) -> Machine:
    grown = point["delta_T"] * (1.0 + 0.1 * (point["delta_T"] / 60.0 - 1.0))
    half = p.half_backlash + c.sign * c.size * grown * c.meshes
    return p._replace(half_backlash=np.maximum(half, 0.0))


def _thermal_stiffness(p: Machine, c: Cause, point: Point) -> Machine:
    softer = np.exp(-c.size * point["delta_T"] * c.meshes)
    return p._replace(stiffness=p.stiffness * softer)


def _friction(p: Machine, c: Cause, _: Point) -> Machine:
    return p._replace(friction=c.size * c.meshes, pitch=c.shape["pitch"])


def _hertz(p: Machine, c: Cause, _: Point) -> Machine:
    return p._replace(hertz=p.hertz + c.size * c.meshes)


def _damping(p: Machine, c: Cause, _: Point) -> Machine:
    return p._replace(c_share=c.size * c.meshes, c_load=c.shape["by_load"])


def _ring(p: Machine, c: Cause, _: Point) -> Machine:
    free = p.free.copy()
    free[9:11] = 1.0
    damper = 2.0 * c.shape["ratio"] * np.sqrt(p.mass[9] / c.size)
    return p._replace(free=free, ring=np.array([1.0 / c.size, damper]))


def _bearing(p: Machine, c: Cause, _: Point) -> Machine:
    pin = 11 + int(c.locus["planet"]) - 1
    free, mass = p.free.copy(), p.mass.copy()
    free[pin] = 1.0
    mass[2] -= mass[pin]
    damper = 2.0 * 0.1 * np.sqrt(PIN_STIFFNESS * mass[pin])
    return p._replace(
        free=free, mass=mass, support=np.array([c.size / 2.0, PIN_STIFFNESS, damper])
    )


def _ripple(p: Machine, c: Cause, _: Point) -> Machine:
    s = c.shape
    return p._replace(ripple=np.array([c.size, s["order"], s["phase"], 0.12]))


def _ripple_draw(rng: Generator, _: tuple[str, ...]) -> Drawn:
    return dict(ALL), {"order": int(rng.integers(1, 61)), "phase": _angle(rng)}


def _told(name: str, unit: str, signed: bool = False) -> Any:
    return lambda c: {name: (c.size * (c.sign if signed else 1.0), unit)}


def _tell_waves(unit: str) -> Any:
    return lambda c: {
        "order": (c.shape["order"], "-"),
        "cos": (c.size * np.cos(c.shape["angle"]), unit),
        "sin": (c.size * np.sin(c.shape["angle"]), unit),
    }


def _draw_waves(least: int) -> Any:
    return lambda rng, _: (
        anywhere(rng),
        {"order": int(rng.integers(least, 5)), "angle": _angle(rng)},
    )


def _signed(locus: Any) -> Any:
    return lambda rng, _: (locus(rng), {"sign": sign(rng)})


def _one_planet(rng: Generator) -> dict[str, Any]:
    return at("all", int(rng.integers(1, 4)))


CATALOGUE: dict[str, Kind] = {
    "mean_stiffness": Kind(
        "law",
        0.05,
        0.5,
        _signed(anywhere),
        _mean_stiffness,
        lambda c: {"factor": (1.0 + c.sign * c.size, "-")},
    ),
    "stiffness_harmonic": Kind("law", 0.05, 0.5, _draw_waves(1), _harmonic, _tell_waves("-")),
    "stagger": Kind(
        "law",
        0.05,
        1.0,
        _signed(lambda rng: at(side=str(rng.choice(["L", "R"])))),
        _shift,
        _told("phase", "rad", True),
    ),
    "planet_phase": Kind(
        "law", 0.05, 1.0, _signed(_one_planet), _shift, _told("phase", "rad", True)
    ),
    "tooth_crack": Kind(
        "law",
        0.3,
        0.9,
        _draw_event,
        lambda p, c, _: _event(p, c, 4),
        lambda c: _tell_event(c, "depth", "-"),
    ),
    "tooth_spall": Kind(
        "law",
        5e-6,
        6e-5,
        _draw_event,
        lambda p, c, _: _event(p, c, 5),
        lambda c: _tell_event(c, "height", "m"),
    ),
    "runout": Kind(
        "law",
        2e-6,
        4e-5,
        _draw_runout,
        _runout,
        lambda c: {
            "amplitude": (c.size, "m"),
            "phase": (c.shape["phase"], "rad"),
            "member": (c.shape["member"], "-"),
        },
    ),
    "pin_position": Kind(
        "law", 2e-6, 3e-5, _signed(_one_planet), _pin, _told("offset", "m", True)
    ),
    "backlash_offset": Kind(
        "law", 2e-6, 2e-5, _signed(anywhere), _backlash, _told("offset", "m", True)
    ),
    "thermal_backlash": Kind(
        "law", 4e-8, 3e-7, _signed(by_kind), _thermal_backlash, _told("rate", "m/K", True)
    ),
    "thermal_stiffness": Kind(
        "law",
        1e-3,
        1e-2,
        lambda rng, _: (by_kind(rng), {}),
        _thermal_stiffness,
        _told("rate", "1/K"),
    ),
    "tooth_friction": Kind(
        "body",
        0.05,
        0.4,
        lambda rng, _: (by_kind(rng), {"pitch": _angle(rng) * 0.1}),
        _friction,
        _told("mu", "-"),
    ),
    "contact_nonlinearity": Kind(
        "law",
        0.03,
        0.5,
        lambda rng, _: (by_kind(rng), {}),
        _hertz,
        lambda c: {"exponent": (1.0 + c.size, "-")},
    ),
    "damping_law": Kind(
        "law",
        0.3,
        1.0,
        lambda rng, _: (by_kind(rng), {"by_load": float(rng.choice([0.15, 0.85]))}),
        _damping,
        _told("share", "-"),
    ),
    "profile_error": Kind("law", 2e-6, 3e-5, _draw_waves(2), _profile, _tell_waves("m")),
    "ring_flexibility": Kind(
        "law",
        1e-11,
        2e-9,
        lambda rng, _: (at("rp"), {"ratio": float(rng.uniform(0.03, 0.1))}),
        _ring,
        lambda c: {"stiffness": (1.0 / c.size, "N/m"), "damping": (c.shape["ratio"], "-")},
    ),
    "bearing_clearance": Kind(
        "law",
        2e-6,
        5e-5,
        lambda rng, _: (_one_planet(rng), {}),
        _bearing,
        _told("clearance", "m"),
        least=1e-6,
    ),
    "torque_ripple": Kind(
        "body",
        0.2,
        1.5,
        _ripple_draw,
        _ripple,
        lambda c: {"amplitude": (c.size, "-"), "order": (c.shape["order"], "-")},
    ),
}
