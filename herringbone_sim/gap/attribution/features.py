"""What each effect would add to the forces of every mesh, to first order: the regressors.

An effect is local: its response with the widest locus holds that of every narrower one. Three
ways, by what its parameters are:

- derivatives by the parameters that have a neutral value; with a ``phase`` beside them, a cosine
  and a sine;
- whole responses over a grid, for effects with states of their own;
- events at a ``position``: see ``events``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.model import Model
from herringbone_sim.effects.effect import Active, Effect, Parameter, active
from herringbone_sim.gap.attribution.hypothesis import everywhere

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Feature:
    """Columns that stand for an effect with some options.

    Attributes:
        start: the effect everywhere, with the parameters that say how it lies.
        probes: (effect, step): a column is the change by the probe over the step.
        kind: ``slope``, ``wave`` (cosine and sine of an amplitude and a phase) or ``whole``.
    """

    start: Active
    probes: tuple[tuple[Active, float], ...]
    kind: str

    def theta(self, coefficients: Array) -> Array:
        """Parameters (p,) inside their bounds that coefficients of the columns stand for."""
        effect = self.start.effect
        theta = np.array(self.start.theta)
        if self.kind == "wave":
            theta[:2] = np.hypot(*coefficients), np.arctan2(-coefficients[1], coefficients[0])
        elif self.kind == "slope":
            at = _sized(effect)
            theta[at] = effect.neutral[at] + coefficients
        inside: Array = np.clip(theta, *effect.bounds)
        return inside


def features(model: Model, effects: Sequence[Effect]) -> list[Feature]:
    """Regressors of all effects that show in the forces, but events."""
    found: list[Feature] = []
    for effect in effects:
        if effect.level == "body" or not effect.parameters or is_event(effect):
            continue
        for options in all_options(effect):
            start = active(effect, values=options)
            start = Active(effect, start.theta, everywhere(start), start.options)
            found += _whole(start) if effect.states(model) else [_local(start)]
    return found


def of_level(effects: Sequence[Effect], level: str) -> list[Feature]:
    """Regressors of all effects of a level without states of their own."""
    found = []
    for effect in effects:
        if effect.level == level:
            for options in all_options(effect):
                found.append(_local(active(effect, values=options)))
    return found


def is_event(effect: Effect) -> bool:
    """Whether it comes at a position once a revolution."""
    return any(p.name == "position" for p in effect.parameters)


def all_options(effect: Effect) -> list[dict[str, Any]]:
    """Every combination of an effect's options that can be told beforehand."""
    names = [option.name for option in effect.options if option.choices]
    choices = [option.choices for option in effect.options if option.choices]
    return [dict(zip(names, values, strict=True)) for values in product(*choices)]


def step_of(p: Parameter) -> float:
    """A small step of a parameter: a thousandth of a moderate value of it."""
    neutral = 0.0 if p.neutral is None or np.isinf(p.neutral) else p.neutral
    size = abs(p.start - neutral)
    return 1e-3 * size if size > 0.0 else min(1.0, 1e-4 * (p.high - p.low))


def _sized(effect: Effect) -> list[int]:
    return [i for i, p in enumerate(effect.parameters) if p.neutral is not None]


def _local(start: Active) -> Feature:
    effect = start.effect
    rest = start.with_theta(effect.neutral)
    names = [p.name for p in effect.parameters]
    if names == ["amplitude", "phase"]:
        h = step_of(effect.parameters[0])
        probes = tuple((rest.with_theta((h, angle)), h) for angle in (0.0, -0.5 * np.pi))
        # cos(a + phase) = cos phase cos a - sin phase sin a; the probe at -pi/2 is sin a.
        return Feature(rest, probes, "wave")
    probes = ()
    for i in _sized(effect):
        theta, h = effect.neutral.copy(), step_of(effect.parameters[i])
        theta[i] += h
        probes += ((rest.with_theta(theta), h),)
    return Feature(rest, probes, "slope")


def _whole(start: Active) -> list[Feature]:
    tried = sum(p.unit != "-" for p in start.effect.parameters)
    grids = [_grid(p, alone=tried == 1) for p in start.effect.parameters]
    cases = [start.with_theta(theta) for theta in product(*grids)]
    return [Feature(one, ((one, 1.0),), "whole") for one in cases]


def _grid(p: Parameter, alone: bool) -> list[float]:
    """Values to try; of a spring alone so near each other that none misses its resonance."""
    if p.neutral is None and p.unit == "-":
        # A fit moves to both sides; from the end of its range (sharp corners) it could not.
        return [p.start or 0.1 * p.high]
    if p.unit == "N/m":
        powers = np.linspace(-1.5, 2.2, 38) if alone else np.linspace(-1.5, 1.5, 7)
        return [float(v) for v in p.start * 10.0**powers]
    return [p.start * s for s in (0.3, 1.0, 3.0)]
