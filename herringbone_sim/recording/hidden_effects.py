"""Draw the effects of a rig whose label is hidden from who diagnoses it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.random import Generator

from herringbone_sim.core.model import Model
from herringbone_sim.effects.effect import Active, active
from herringbone_sim.effects.registry import effects


def hidden_effects(seed: int, model: Model) -> tuple[Active, ...]:
    """Draw 0, 1 or 2 effects with probability 0.2, 0.6, 0.2; ``model`` gives the possible loci."""
    rng = np.random.default_rng([seed, 1])
    number = int(rng.choice((0, 1, 2), p=(0.2, 0.6, 0.2)))
    names = rng.choice(list(effects()), size=number, replace=False)
    return tuple(_drawn(str(name), model, rng) for name in names)


def _drawn(name: str, model: Model, rng: Generator) -> Active:
    """Draw locus, options and parameters of the effect with the id ``name``."""
    effect = effects()[name]
    if name == "channel_swap":
        planets = rng.permutation(len(model.layout.planets))[:2]
        prefix, side = rng.choice(("x", "v", "F")), rng.choice(("L", "R"))
        swapped = tuple(f"{prefix}_sp{model.layout.planets[i]}_{side}" for i in planets)
        return active(effect, values={"channels": swapped})
    places = effect.candidates(model.layout)
    members = [o for o in effect.options if o.name == "member"]
    places = tuple(p for p in places if p.mesh != "all") or places if members else places
    place = places[int(rng.integers(len(places)))]
    values: dict[str, Any] = {
        o.name: o.choices[int(rng.integers(len(o.choices)))]
        for o in effect.options
        if o.choices and not o.bends
    }
    if members:
        values["member"] = rng.choice(("sun" if place.mesh == "sp" else "ring", "planet")).item()
    for p in (p for p in effect.parameters if not p.bends):
        if p.neutral is None:
            values[p.name] = (
                p.start if p.start else float(rng.uniform(max(p.low, -3.0), min(p.high, 3.0)))
            )
            continue
        neutral = p.neutral if np.isfinite(p.neutral) else 0.0
        size = (p.start - neutral) * float(rng.uniform(0.7, 2.0))
        sign = rng.choice((-1.0, 1.0)) if p.low < neutral - abs(size) else 1.0
        values[p.name] = float(np.clip(neutral + sign * size, p.low, p.high))
    return active(effect, place, values)
