"""Convert fitted hypotheses to effects of the catalogue with parameters and 90 % intervals."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.diagnosis.judge import HALF_90, relative_error
from herringbone_sim.diagnosis.machine import Hypothesis, with_slices
from herringbone_sim.diagnosis.score import Score
from herringbone_sim.effects.effect import Active, Effect, Locus, Parameter
from herringbone_sim.effects.registry import effects as known_effects
from herringbone_sim.gap.learned_law import LearnedLaw, learned_law
from herringbone_sim.gap.observations.hypotheses.damaged_teeth import BUMP, KNOTS, Event
from herringbone_sim.gap.observations.hypotheses.moving_parts import MovingPart

DRAWS = 400  # random draws of the coefficients, for the intervals
SEED = 13
# Effects whose departures are waves of other orders.
WAVES = ("stiffness_harmonic", "profile_error", "torque_ripple", "runout")
OPTIONS = ("order", "member", "channels")  # options of hypotheses that the effect has as well
Options = tuple[tuple[str, object], ...]


@dataclass(frozen=True)
class NamedEffect:
    """A fitted effect of the catalogue.

    Attributes:
        active: effect with parameters.
        intervals: 90 % interval (low, high) of each parameter.
        law: learned curve; None without a free shape.
        departures: difference of the learned curve from the catalogue's, as further effects.
    """

    active: Active
    intervals: tuple[tuple[float, float], ...]
    law: LearnedLaw | None
    departures: tuple[Active, ...] = ()


def name_effects(hypotheses: tuple[Hypothesis, ...], score: Score) -> tuple[NamedEffect, ...]:
    """Convert the fitted hypotheses of an explanation to effects of the catalogue, in order.

    Args:
        hypotheses: of the explanation.
        score: of the fit; its last coefficients are those of the hypotheses, in order.
    """
    spread = score.covariance_with_jackknife()
    slices = with_slices(hypotheses, len(score.mean))
    return tuple(_named_effect(h, score.mean[at], spread[at, at]) for h, at in slices)


def _named_effect(h: Hypothesis, mean: Array, spread: Array) -> NamedEffect:
    """Convert a hypothesis, given the mean (k,) and covariance (k, k) of its coefficients."""
    effect = known_effects()[h.effect]
    rng = np.random.default_rng(SEED)
    svd = np.linalg.svd(spread)
    draws = mean + rng.normal(size=(DRAWS, len(mean))) * np.sqrt(svd[1]) @ svd[2]
    theta, options = _theta(h, mean)
    low, high = effect.bounds
    thetas = np.clip([_theta(h, draw)[0] for draw in draws], low, high)
    inside = np.clip(theta, low, high)
    spans = []
    for i, p in enumerate(effect.parameters):
        off = thetas[:, i] - inside[i]
        if p.unit == "rad":
            off = np.angle(np.exp(1j * off))
        elif p.name == "position" and isinstance(h.source, Event):
            turn = h.source.turn
            off = (off + 0.5 * turn) % turn - 0.5 * turn
        a, b = np.quantile(off, [0.05, 0.95])
        model_error = HALF_90 * relative_error() * _size(effect, p, inside)
        a, b = inside[i] - np.hypot(a, model_error), inside[i] + np.hypot(b, model_error)
        spans.append((float(min(a, inside[i])), float(max(b, inside[i]))))
    locus = h.locus if isinstance(h.locus, Locus) else Locus()
    active = Active(effect, tuple(inside.tolist()), locus, options)
    law = learned_law(h, mean, draws)
    return NamedEffect(active, tuple(spans), law, _departures(active, h, mean))


def _departures(active: Active, h: Hypothesis, mean: Array) -> tuple[Active, ...]:
    """Departures from the catalogue's curve as further effects, where the catalogue has such.

    Other harmonics of waves, additional size at ring meshes or the right side, and, beside a
    backlash offset, an additional shift of the back flank: half as backlash, half as pin position.
    """
    c = {
        coefficient.name: float(value)
        for coefficient, value in zip(h.coefficients, mean, strict=True)
    }
    departures = [*_harmonics(active, h, c)]
    of_ring = replace(active, locus=replace(active.locus, mesh="rp"))
    of_right = replace(active, locus=replace(active.locus, side="R"))
    for name, at in (("ring", of_ring), ("right side", of_right)):
        size = c.get(name, 0.0)
        if h.effect == "mean_stiffness":  # factors multiply: 1 + a + b = (1 + a) (1 + b / (1 + a))
            size /= 1.0 + float(mean[0])
        if size:
            theta = np.array([active.effect.neutral[0] + size, *active.effect.neutral[1:]])
            departures.append(at.with_theta(_clipped(active.effect, theta)))
    if h.effect == "backlash_offset":
        for name, at in (("back flank", active), ("back flank of the ring", of_ring)):
            (half,) = _clipped(active.effect, [0.5 * c.get(name, 0.0)]).tolist()
            departures.append(at.with_theta([half]))
            departures.append(replace(at, effect=known_effects()["pin_position"], theta=(-half,)))
    return tuple(
        departure
        for departure in departures
        if np.any(np.array(departure.theta) != departure.effect.neutral)
    )


def _harmonics(active: Active, h: Hypothesis, c: Mapping[str, float]) -> Iterator[Active]:
    """Other harmonics of an effect in ``WAVES``, by values of coefficients such as ``2 cos``."""
    main_order = dict(active.options).get("order", 1)
    pairs: dict[int, Array] = {}
    for coefficient in h.coefficients[h.n_own :] if h.effect in WAVES else ():
        order, _, trig = coefficient.name.partition(" ")
        at = int(order) * (int(str(main_order)) if h.effect == "torque_ripple" else 1)
        pairs.setdefault(at, np.zeros(2))[int(trig == "sin")] = c[coefficient.name]
    for at, pair in pairs.items():
        options = tuple({**dict(active.options), "order": at}.items())
        if np.any(pair):
            theta = _clipped(active.effect, THETA[h.effect](pair))
            yield replace(active, options=options).with_theta(theta)


def _clipped(effect: Effect, c: Sequence[float] | Array) -> Array:
    """Parameters ``c`` of an effect, clipped to its bounds."""
    return np.clip(c, *effect.bounds)


def _size(effect: Effect, p: Parameter, theta: Array) -> float:
    """Size of an effect to which the relative model error of parameter ``p`` refers.

    The norm of the deviations from neutral of all parameters with the unit of ``p``. If the
    neutral value is infinite, as of a stiffness, the value itself. For the phase of a wave 1 rad,
    as an error of the wave shifts its phase by at most the error over the amplitude; 0 for other
    parameters of the shape.
    """
    if p.neutral is None:
        return 1.0 if p.unit == "rad" else 0.0
    if np.isinf(p.neutral):
        return float(abs(theta[effect.parameters.index(p)]))
    same = [i for i, q in enumerate(effect.parameters) if q.unit == p.unit]
    return float(np.linalg.norm((theta - effect.neutral)[same]))


def _theta(h: Hypothesis, c: Array) -> tuple[Array, Options]:
    """Parameters (p,) and options of the effect of a hypothesis with coefficients c (k,)."""
    options = tuple((k, v) for k, v in h.options if k in OPTIONS)
    make = THETA.get(h.effect)
    if make is not None:
        return np.array(make(c)), options
    if h.effect in ("tooth_crack", "tooth_spall"):
        return _event(h, c), options
    if h.effect in ("thermal_backlash", "thermal_stiffness"):
        bend = sum(
            v
            for coefficient, v in zip(h.coefficients, c, strict=True)
            if coefficient.name == "curvature"
        )
        return np.array([c[0], bend / c[0] if c[0] else 0.0]), options
    own_options = dict(h.options)
    if isinstance(h.source, MovingPart):
        part = h.source.with_log_offsets(c[1:])
        values = dict(zip(part.names, part.theta, strict=True))
        return np.array([values[p.name] for p in known_effects()[h.effect].parameters]), ()
    if h.effect == "damping_law":
        if own_options["law"] == "contact":
            return np.array([c[0], 0.0, 1e-5]), ()
        slope = c[0] + c[1]  # share over depth [1 / 10 um]
        return np.array([c[0], 1.0, 1e-5 * c[0] / slope if slope * c[0] > 0.0 else 1.0]), ()
    return np.zeros(len(known_effects()[h.effect].parameters)), options


def moderate_size(h: Hypothesis) -> tuple[float, str]:
    """Size of a moderate effect, and its unit.

    Of the first parameter with a neutral value, the deviation from it when the first coefficient
    is at the standard deviation of its prior and all others are zero.
    """
    c = np.zeros(len(h.coefficients))
    c[0] = h.coefficients[0].sd
    every = zip(known_effects()[h.effect].parameters, _theta(h, c)[0], strict=True)
    return next((abs(v - p.neutral), p.unit) for p, v in every if p.neutral is not None)


def _event(h: Hypothesis, c: Array) -> Array:
    """Peak, position and width (both in mesh cycles) of a tooth event from its coefficients."""
    assert isinstance(h.source, Event)
    curve = _window(c)
    top = int(np.argmax(np.abs(curve)))
    above = np.abs(curve) > 0.5 * abs(curve[top])
    width = 2.0 * float(above.sum()) * float(KNOTS[1] - KNOTS[0])
    position = (h.source.middle + KNOTS[top]) % h.source.turn
    return np.array([curve[top], position, np.clip(width, 0.2, 4.0)])


def _window(c: Array) -> Array:
    """Curve of a tooth event over ``KNOTS``."""
    curve: Array = c[0] * BUMP + c[1:]
    return curve


def _cosine_wave(c: Array) -> list[float]:
    """Amplitude and phase of c_0 cos + c_1 sin = amplitude cos(angle + phase)."""
    return [float(np.hypot(c[0], c[1])), float(np.arctan2(-c[1], c[0]))]


def _sine_wave(c: Array) -> list[float]:
    """Amplitude and phase of c_0 cos + c_1 sin = amplitude sin(angle + phase)."""
    return [float(np.hypot(c[0], c[1])), float(np.arctan2(c[0], c[1]))]


# Functions from the coefficients of a hypothesis to the parameters of its effect.
THETA: Mapping[str, Callable[[Array], list[float]]] = {
    "mean_stiffness": lambda c: [1.0 + c[0]],
    "stiffness_harmonic": lambda c: [c[0], c[1]],
    "profile_error": lambda c: [c[0], c[1]],
    "stagger": lambda c: [c[0]],
    "planet_phase": lambda c: [c[0]],
    "runout": _sine_wave,
    "pin_position": lambda c: [c[0]],
    "backlash_offset": lambda c: [c[0]],
    "contact_nonlinearity": lambda c: [1.0 + c[0]],
    "tooth_friction": lambda c: [c[0]],
    "torque_ripple": _cosine_wave,
    "sensor_gain": lambda c: [1.0 + c[0]],
    "sensor_bias": lambda c: [c[0]],
    "sensor_delay": lambda c: [c[0]],
    "clock_drift": lambda c: [-1e6 * c[0]],
    "channel_swap": lambda c: [],
}
