"""From a fitted hypothesis to an effect of the catalogue with intervals, and its learned law."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.model import Model
from herringbone_sim.diagnosis.judge import HALF_90, relative_error
from herringbone_sim.diagnosis.search import Hypothesis, Score
from herringbone_sim.effects.effect import Active, Effect, Locus, Parameter
from herringbone_sim.effects.registry import effects as known_effects
from herringbone_sim.gap.observations import balance
from herringbone_sim.gap.observations.basis import LOADS_M
from herringbone_sim.gap.observations.events import BUMP, KNOTS, Event
from herringbone_sim.gap.observations.seats import Seat

Array = NDArray[np.float64]
DRAWS = 400
SEED = 13


@dataclass(frozen=True)
class LearnedLaw:
    """The curve that the data show.

    Attributes:
        effect: id.
        x_name, x_unit, y_name, y_unit: of its axes.
        x, y, low, high: (n,) values, curve and its 90 % band.
    """

    effect: str
    x_name: str
    x_unit: str
    y_name: str
    y_unit: str
    x: Array
    y: Array
    low: Array
    high: Array

    def written(self) -> dict[str, object]:
        """As the report has it."""
        return {
            "effect": self.effect,
            "x": {"name": self.x_name, "unit": self.x_unit, "values": self.x.tolist()},
            "y": {
                "name": self.y_name,
                "unit": self.y_unit,
                "values": self.y.tolist(),
                "low": self.low.tolist(),
                "high": self.high.tolist(),
            },
        }


@dataclass(frozen=True)
class Named:
    """An effect of the catalogue.

    Attributes:
        active: with its parameters.
        intervals: 90 % interval of each.
        law: as learned, if it has a shape.
        harmonics: the learned law's other orders, as effects of the catalogue.
    """

    active: Active
    intervals: tuple[tuple[float, float], ...]
    law: LearnedLaw | None
    harmonics: tuple[Active, ...] = ()


def named(hypotheses: tuple[Hypothesis, ...], score: Score, model: Model) -> tuple[Named, ...]:
    """Every effect of an explanation."""
    own = sum(len(h.coefficients) for h in hypotheses)
    first = len(score.coefficients) - own
    spread = score.covariance_with_jackknife()
    found = []
    for h in hypotheses:
        at = slice(first, first + len(h.coefficients))
        first += len(h.coefficients)
        found.append(_named(h, score.mean[at], spread[at, at], model))
    return tuple(found)


def _named(h: Hypothesis, mean: Array, spread: Array, model: Model) -> Named:
    effect = known_effects()[h.effect]
    rng = np.random.default_rng(SEED)
    root = np.linalg.svd(spread)
    draws = mean + rng.normal(size=(DRAWS, len(mean))) * np.sqrt(root[1]) @ root[2]
    theta, options = _theta(h, mean, model)
    low, high = effect.bounds
    every = np.clip([_theta(h, one, model)[0] for one in draws], low, high)
    inside = np.clip(theta, low, high)
    spans = []
    for i, p in enumerate(effect.parameters):
        off = every[:, i] - inside[i]
        if p.unit == "rad":
            off = np.angle(np.exp(1j * off))
        a, b = np.quantile(off, [0.05, 0.95])
        missed = HALF_90 * relative_error() * _size(effect, p, inside)
        a, b = inside[i] - np.hypot(a, missed), inside[i] + np.hypot(b, missed)
        spans.append((float(min(a, inside[i])), float(max(b, inside[i]))))
    locus = h.locus if isinstance(h.locus, Locus) else Locus()
    active = Active(effect, tuple(inside.tolist()), locus, options)
    return Named(active, tuple(spans), _law(h, mean, draws), _harmonics(active, h, mean))


def _harmonics(active: Active, h: Hypothesis, mean: Array) -> tuple[Active, ...]:
    """Orders that ride along with a wave of the mesh or of the input shaft."""
    own = dict(active.options).get("order")
    if h.effect not in WAVES or own is None:
        return ()
    of: dict[int, Array] = {}
    for c, value in zip(h.coefficients[h.n_own :], mean[h.n_own :], strict=True):
        order, _, trig = c.name.partition(" ")
        at = int(order) * (int(own) if h.effect == "torque_ripple" else 1)
        of.setdefault(at, np.zeros(2))[int(trig == "sin")] = value
    make, bounds = THETA[h.effect], active.effect.bounds
    return tuple(
        replace(active, options=(("order", order),)).with_theta(np.clip(make(c), *bounds))
        for order, c in of.items()
        if np.any(c)
    )


WAVES = ("stiffness_harmonic", "profile_error", "torque_ripple")


def _size(effect: Effect, p: Parameter, theta: Array) -> float:
    """Size of the effect in the unit of a parameter; of a stiffness that is rigid else, itself."""
    if p.neutral is None:
        return 0.0
    if np.isinf(p.neutral):
        return float(abs(theta[effect.parameters.index(p)]))
    same = [i for i, q in enumerate(effect.parameters) if q.unit == p.unit]
    return float(np.linalg.norm((theta - effect.neutral)[same]))


Told = tuple[Array, tuple[tuple[str, object], ...]]


def _theta(h: Hypothesis, c: Array, model: Model) -> Told:
    """Parameters of the catalogue and options."""
    kept = tuple((k, v) for k, v in h.options if k in OPTIONS)
    make = THETA.get(h.effect)
    if make is not None:
        return np.array(make(c)), kept
    if h.effect in ("tooth_crack", "tooth_spall"):
        return _event(h, c), kept
    options = dict(h.options)
    if isinstance(h.source, Seat):
        seat = h.source.with_log_offsets(c[1:])
        own = dict(zip(seat.names, seat.theta, strict=True))
        return np.array([own[p.name] for p in known_effects()[h.effect].parameters]), ()
    if h.effect == "damping_law":
        power = 0.0 if options["law"] == "contact" else 1.0
        return np.array([c[0], power, 1e-5]), ()
    return np.zeros(len(known_effects()[h.effect].parameters)), kept


def moderate_size(h: Hypothesis, model: Model) -> tuple[float, str]:
    """What the first parameter of an effect is off its neutral value at the size that counts as
    one, and its unit."""
    c = np.zeros(len(h.coefficients))
    c[0] = h.coefficients[0].sd
    every = zip(known_effects()[h.effect].parameters, _theta(h, c, model)[0], strict=True)
    return next((abs(v - p.neutral), p.unit) for p, v in every if p.neutral is not None)


def _event(h: Hypothesis, c: Array) -> Array:
    """Height or depth, position and width of the window: its own peak and its half width."""
    assert isinstance(h.source, Event)
    curve = _window(c)
    top = int(np.argmax(np.abs(curve)))
    above = np.abs(curve) > 0.5 * abs(curve[top])
    width = 2.0 * float(above.sum()) * float(KNOTS[1] - KNOTS[0])
    position = (h.source.middle + KNOTS[top]) % 77.0
    return np.array([curve[top], position, np.clip(width, 0.2, 4.0)])


def _window(c: Array) -> Array:
    curve: Array = c[0] * BUMP + c[1:]
    return curve


def _wave(c: Array) -> list[float]:
    """Amplitude and phase of c_0 cos + c_1 sin = amplitude cos(angle + phase)."""
    return [float(np.hypot(c[0], c[1])), float(np.arctan2(-c[1], c[0]))]


OPTIONS = ("order", "member", "channels")
THETA: Mapping[str, Callable[[Array], list[float]]] = {
    "mean_stiffness": lambda c: [1.0 + c[0]],
    "stiffness_harmonic": lambda c: [c[0], c[1]],
    "profile_error": lambda c: [c[0], c[1]],
    "stagger": lambda c: [c[0]],
    "planet_phase": lambda c: [c[0]],
    "runout": _wave,
    "pin_position": lambda c: [c[0]],
    "backlash_offset": lambda c: [c[0]],
    "thermal_backlash": lambda c: [c[0]],
    "thermal_stiffness": lambda c: [c[0]],
    "contact_nonlinearity": lambda c: [1.0 + c[0]],
    "tooth_friction": lambda c: [c[0]],
    "torque_ripple": _wave,
    "sensor_gain": lambda c: [1.0 + c[0]],
    "sensor_bias": lambda c: [c[0]],
    "sensor_delay": lambda c: [c[0]],
    "clock_drift": lambda c: [-1e6 * c[0]],
    "channel_swap": lambda c: [],
}


def _law(h: Hypothesis, mean: Array, draws: Array) -> LearnedLaw | None:
    """The curve of an effect that has a shape."""
    make = CURVES.get(h.effect)
    if make is None:
        return None
    x, matrix, axes = make(h)
    y = matrix @ mean
    band = np.quantile(draws @ matrix.T, [0.05, 0.95], axis=0)
    return LearnedLaw(h.effect, *axes, x, y, np.minimum(band[0], y), np.maximum(band[1], y))


Curve = tuple[Array, Array, tuple[str, str, str, str]]
PHASES = np.linspace(0.0, 2.0 * np.pi, 97)


def _trig(name: str) -> Array:
    """cos or sin of the order that a coefficient's name tells."""
    order, _, trig = name.partition(" ")
    return np.asarray({"cos": np.cos, "sin": np.sin}[trig](float(order) * PHASES))


def _over_phase(y_name: str, y_unit: str) -> Callable[[Hypothesis], Curve]:
    def make(h: Hypothesis) -> Curve:
        order = dict(h.options)["order"]
        names = [c.name if " " in c.name else f"{order} {c.name}" for c in h.coefficients]
        matrix = np.stack([_trig(n) for n in names], axis=1)
        return PHASES, matrix, ("mesh phase", "rad", y_name, y_unit)

    return make


def _over_turn(h: Hypothesis) -> Curve:
    matrix = np.stack([_trig(c.name) for c in h.coefficients], axis=1)
    member = str(dict(h.options)["member"])
    return PHASES, matrix, (f"turn of the {member}", "rad", "displacement", "m")


def _over_shaft(h: Hypothesis) -> Curve:
    matrix = np.stack([_trig(c.name) for c in h.coefficients], axis=1)
    order = dict(h.options)["order"]
    return (
        PHASES,
        matrix,
        (f"{order} times the turn of the input shaft", "rad", "torque share", "-"),
    )


def _over_window(y_name: str, y_unit: str) -> Callable[[Hypothesis], Curve]:
    def make(h: Hypothesis) -> Curve:
        matrix: Array = np.column_stack([BUMP, np.eye(len(KNOTS))])
        return KNOTS, matrix, ("mesh cycles from the event", "cycles", y_name, y_unit)

    return make


def _over_load(h: Hypothesis) -> Curve:
    slope = np.log(LOADS_M / 1e-5)
    matrix = np.column_stack([slope, np.ones(len(LOADS_M)), np.eye(len(LOADS_M))])
    return LOADS_M, matrix, ("deflection", "m", "stiffness factor less 1", "-")


def _damping(h: Hypothesis) -> Curve:
    main = np.zeros(len(LOADS_M)) if dict(h.options)["law"] == "contact" else LOADS_M / 1e-5 - 1.0
    matrix = np.column_stack([main, np.eye(len(LOADS_M))])
    return LOADS_M, matrix, ("deflection", "m", "damping factor less 1", "-")


TEMPERATURES = np.linspace(0.0, 100.0, 21)


def _over_temperature(y_name: str, y_unit: str, sign: float) -> Callable[[Hypothesis], Curve]:
    def make(h: Hypothesis) -> Curve:
        T = TEMPERATURES
        columns = [T, T * (T / 50.0 - 1.0), *(0.0 * T for _ in h.coefficients[2:])]
        matrix = sign * np.stack(columns, axis=1)
        return T, matrix, ("temperature rise", "K", y_name, y_unit)

    return make


def _friction(h: Hypothesis) -> Curve:
    s = np.linspace(-np.pi, np.pi, 96)
    shapes = {
        "sin 1": np.sin(s),
        "sin 2": np.sin(2 * s),
        "sin 3": np.sin(3 * s),
        "cos 1": np.cos(s),
        "cos 2": np.cos(2 * s),
    }
    columns = [np.sign(s), *(shapes[g] for g in balance.FRICTION[2:])]
    matrix = np.stack(columns, axis=1)
    return s, matrix, ("mesh phase from the pitch point", "rad", "coefficient of friction", "-")


CURVES: Mapping[str, Callable[[Hypothesis], Curve]] = {
    "stiffness_harmonic": _over_phase("stiffness share of the mean", "-"),
    "profile_error": _over_phase("displacement", "m"),
    "runout": _over_turn,
    "torque_ripple": _over_shaft,
    "tooth_crack": _over_window("stiffness share lost", "-"),
    "tooth_spall": _over_window("displacement", "m"),
    "contact_nonlinearity": _over_load,
    "damping_law": _damping,
    "thermal_backlash": _over_temperature("half-backlash", "m", 1.0),
    "thermal_stiffness": _over_temperature("stiffness factor less 1", "-", -1.0),
    "tooth_friction": _friction,
}
