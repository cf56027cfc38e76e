"""Unknown causes: a random smooth function of the mesh state that changes one quantity.

The function has one to three inputs and is a sum of cosines with random directions and wavelengths
in their space (A. Rahimi, B. Recht, NIPS 20 (2007) 1177). Its target is a stiffness, a damping, a
force, a displacement, or a torque on a body that no force sensor measures. Combinations that the
catalogue contains (stiffness by phase alone, by load alone, ...) are not drawn.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.random import Generator

from herringbone_sim.arrays import Array
from herringbone_sim.practice.apply_causes import CYCLES
from herringbone_sim.practice.cause import (
    Cause,
    Drawn,
    Kind,
    Point,
    at,
    draw_kind_locus,
    draw_locus,
)
from herringbone_sim.practice.rig_model import BODIES, RigModel

# "turn": angle of a member's revolution; "own": memory state that follows an input with a lag.
INPUTS = ("deflection", "rate", "phase", "load", "temperature", "turn", "time", "own")
TARGETS = ("none", "stiffness", "damping", "force", "displacement", "torque")
# RMS at size 1; up to size 8 stiffness and damping stay positive nearly everywhere.
UNITS = {"stiffness": 0.04, "damping": 0.06, "force": 2e3, "displacement": 2e-6, "torque": 3e3}
UNIT_NAMES = {"stiffness": "-", "damping": "-", "force": "N", "displacement": "m", "torque": "N"}
WAVES = ("phase", "turn")  # angles: the function contains integer multiples of them
FOLLOWED = ("deflection", "rate")  # inputs that a memory state can follow
COSINES = 5
HIGHEST = {"phase": 3, "turn": 4}
# Inputs of a displacement: known functions of time, as its rate is needed.
CLOCKED = ("phase", "temperature", "turn", "time")
# Sets of inputs with which the function would be an effect of the catalogue.
KNOWN = {
    "stiffness": ({"phase"}, {"load"}, {"deflection"}, {"temperature"}, {"load", "deflection"}),
    "damping": ({"load"}, {"deflection"}, {"load", "deflection"}),
    "force": ({"phase"}, {"turn"}, {"temperature"}, {"time"}, {"deflection"}, {"load"}, {"rate"}),
    "displacement": ({"phase"}, {"turn"}, {"temperature"}),
    "torque": ({"phase"}, {"temperature"}),
}


def _draw(rng: Generator, _: tuple[str, ...]) -> Drawn:
    """Draw locus and shape: target, inputs and cosines; member, memory and body where needed."""
    target = str(rng.choice(TARGETS[1:]))
    inputs = _inputs(rng, target)
    heights, weights, angles = _cosines(rng, inputs)
    shape: dict[str, Any] = {"target": target, "inputs": list(inputs)}
    if "turn" in inputs:
        shape["member"] = str(rng.choice(list(CYCLES)))
    if "own" in inputs:
        cycles = float(10.0 ** rng.uniform(-1.0, 1.0))
        shape |= {"follows": str(rng.choice(FOLLOWED)), "memory_cycles": cycles}
    locus = _place(rng)
    if target == "torque":
        locus, shape["body"] = _torque_place(rng)
    cosines = {"heights": heights, "weights": weights, "angles": angles}
    return locus, shape | {name: values.tolist() for name, values in cosines.items()}


def _inputs(rng: Generator, target: str) -> tuple[str, ...]:
    """Draw one to three inputs, such that the function is no effect of the catalogue."""
    among = CLOCKED if target == "displacement" else INPUTS
    while True:
        chosen = rng.choice(len(among), int(rng.integers(1, 4)), replace=False)
        inputs = tuple(among[i] for i in sorted(chosen))
        if set(inputs) not in KNOWN[target] and set(inputs) != {"temperature"}:
            return inputs


def _cosines(rng: Generator, inputs: tuple[str, ...]) -> tuple[Array, Array, Array]:
    """Draw heights (h,), weights (h, inputs) and angles (h,) of the cosines.

    Weights of angles are non-zero integers. Those of other inputs are normal, with a length scale
    of half to twice the range of the input.
    """
    weights = np.empty((COSINES, len(inputs)))
    for i, name in enumerate(inputs):
        if name in WAVES:
            weights[:, i] = rng.integers(1, HIGHEST[name] + 1, COSINES)
            weights[:, i] *= rng.choice([-1.0, 1.0], COSINES)
        else:
            weights[:, i] = rng.normal(size=COSINES) / _length(name, rng)
    return rng.normal(size=COSINES), weights, rng.uniform(0.0, 2.0 * np.pi, COSINES)


def _length(name: str, rng: Generator) -> float:
    """Draw the length scale of an input in the unit of ``RandomFunction``'s inputs."""
    span = {"time": 0.4, "temperature": 0.6}.get(name, 1.5)
    return float(span * 2.0 ** rng.uniform(-1.0, 1.0))


def _place(rng: Generator) -> dict[str, Any]:
    """Draw a locus: a mesh kind or both, a planet, a side, or one mesh."""
    planet, side = int(rng.integers(1, 4)), str(rng.choice(["L", "R"]))
    places = (draw_kind_locus(rng), at(planet=planet), at(side=side), draw_locus(rng))
    return places[int(rng.integers(len(places)))]


def _torque_place(rng: Generator) -> tuple[dict[str, Any], str]:
    """Draw a body, and return the locus of its meshes with its name."""
    body = str(rng.choice(BODIES))
    if body == "c":
        return at(), body
    side = body[-1]
    return (at("sp", side=side) if body[0] == "s" else at("all", int(body[1]), side)), body


def _samples(inputs: tuple[str, ...]) -> Array:
    """Return fixed samples (n, inputs) of typical inputs, to centre and scale a function."""
    rng = np.random.default_rng(0)
    n = 4000
    drawn = {name: rng.uniform(0.0, 2.0 * np.pi, n) for name in WAVES}
    drawn |= {"time": rng.uniform(0.4, 1.0, n), "temperature": rng.uniform(0.2, 1.8, n)}
    return np.stack([drawn.get(name, 1.5 * rng.normal(size=n)) for name in inputs], axis=1)


def function(shape: Any) -> tuple[Array, Array, Array, float]:
    """Return heights (h,), weights (h, 8), angles (h,) and mean of the function of a shape.

    They are scaled so that the function less ``mean`` has mean 0 and RMS 1 on typical inputs.
    """
    inputs = tuple(shape["inputs"])
    heights, weights, angles = (np.array(shape[n]) for n in ("heights", "weights", "angles"))
    values = np.cos(_samples(inputs) @ weights.T + angles) @ heights
    scale = 1.0 / float(np.std(values))
    wide = np.zeros((COSINES, len(INPUTS)))
    wide[:, [INPUTS.index(name) for name in inputs]] = weights
    return heights * scale, wide, angles, float(np.mean(values)) * scale


def _apply(p: RigModel, c: Cause, _: Point) -> RigModel:
    """Return the rig model with the random function."""
    heights, weights, angles, mean = function(c.shape)
    unit = UNITS[str(c.shape["target"])]
    own = "own" in c.shape["inputs"]
    memory = 2.0 * np.pi * float(c.shape.get("memory_cycles", 1.0)) / p.omega
    return p._replace(
        random=p.random._replace(
            target=TARGETS.index(c.shape["target"]),
            size=c.size * unit * c.meshes,
            heights=heights,
            weights=weights,
            angles=angles,
            mean=mean,
            cycles=float(CYCLES[c.shape.get("member", "sun")]),
            body=BODIES.index(c.shape.get("body", "s_L")),
            own_rate=1.0 / memory if own else 0.0,
            own_input=FOLLOWED.index(c.shape.get("follows", "deflection")),
        )
    )


RANDOM_PHYSICS: dict[str, Kind] = {
    "random_physics": Kind(
        "law",
        1.0,
        8.0,
        _draw,
        _apply,
        lambda c: {"rms": (c.size * UNITS[c.shape["target"]], UNIT_NAMES[c.shape["target"]])},
    )
}
