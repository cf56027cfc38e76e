"""Effects of the catalogue as curves: what they depend on, where they sit, their symmetry.

The catalogue's law is the mean of a prior over curves: one coefficient carries it, further ones
let the curve depart from it by a share ``SHAPE`` of its size. Units are those of the effect's
size.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.diagnosis.products import Coefficient
from herringbone_sim.diagnosis.search import Hypothesis
from herringbone_sim.effects.catalogue.tooth_friction import friction_arms
from herringbone_sim.effects.effect import Effect, Locus
from herringbone_sim.effects.registry import effects as known_effects
from herringbone_sim.effects.site import is_ring, planet_angles
from herringbone_sim.gap.observations import balance
from herringbone_sim.gap.observations.basis import LOADS_M, ORDERS, TURNS
from herringbone_sim.gap.observations.common_filter import MOST
from herringbone_sim.gap.observations.gear import Gear
from herringbone_sim.gap.observations.places import Places, Weights
from herringbone_sim.gap.observations.sensor_errors import (
    followed_sensors,
    force_sensors,
    motion_sensors,
)
from herringbone_sim.gap.residuals.balance import inertia_parts

Array = NDArray[np.float64]
GAUGE = 0.05  # gain of a strain gauge, data sheet
SHAPE = 0.25  # departure of a curve from the catalogue's, as a share of its size


@dataclass(frozen=True)
class Term:
    """A coefficient before it has a place.

    Attributes:
        name: of the parameter, or of the departure.
        weights: function of the force law, or (observation, function), -> weight on its rows: a
            number, (rows,) or (runs, rows).
        sd: prior standard deviation in units of the effect's size.
    """

    name: str
    weights: Weights
    sd: float


def tolerances(places: Places) -> tuple[Coefficient, ...]:
    """Coefficients of every hypothesis: k, c, e of both kinds, masses, a common filter."""
    gear = places.gear
    ring = is_ring(gear.model.layout)
    found = []
    for kind, on in (("sp", 1.0 - ring), ("rp", ring)):
        for what, function, bound in (
            ("k", "kappa", 0.02),
            ("c", "gamma", 0.04),
            ("e", "error", 0.02),
        ):
            found.append(
                places.coefficient(f"{what}_{kind}", {function: on}, bound / 3**0.5, bound)
            )
    late = -gear.omegas[:, None]
    for name, function in (("delay of k", "shift k"), ("delay of e", "shift e")):
        found.append(places.coefficient(name, {function: late}, 2.5e-6, 5e-6))
    for i, most in enumerate(MOST):
        name = f"filter {i + 1}"
        found.append(places.coefficient(name, {name: 1.0}, 0.5 * most, most))
    between: Weights = {(balance.NAME, "between"): 1.0}
    found.append(places.coefficient("between", between, 0.3, 1.0))
    for mass in balance.MASSES:
        of_mass: Weights = {(o, mass): 1.0 for o in (balance.NAME, *places.of_windows)}
        found.append(places.coefficient(mass, of_mass, 0.02 / 3**0.5, 0.0205))
    for gauge in gear.gauges:
        name = f"gain of {gauge}"
        of_gauge: Weights = {(o, name): 1.0 for o in places.of_windows}
        found.append(places.coefficient(name, of_gauge, GAUGE / 3**0.5, GAUGE))
    for j, tolerance in enumerate(gear.gain_tolerance):
        if tolerance > 0.0 and not gear.modelled[j] and not gear.by_windows:
            weights = _gain_of(places, j)
            found.append(places.coefficient(f"gain {j}", weights, tolerance / 3**0.5, tolerance))
    return tuple(found)


def _gain_of(places: Places, j: int) -> Weights:
    """A force sensor that reads too much: in the force law, and in the balance less."""
    on = np.zeros(places.gear.model.layout.n_mesh)
    on[j] = 1.0
    reach = inertia_parts(places.gear.model).sum(0)
    return {"F gain": on, (balance.NAME, f"F of {j}"): -reach[:, j]}


def hypotheses(places: Places, only: Collection[str] = ()) -> Iterator[Hypothesis]:
    """Every effect at every place with every option that linear functions can carry.

    Args:
        only: effects in the force law that are asked for; empty for all.
    """
    layout = places.gear.model.layout
    for effect in known_effects().values():
        if only and effect.id not in only:
            continue
        for options, unit, terms, mains in variants(effect, places.gear):
            for locus in effect.candidates(layout):
                if _fits(options, locus):
                    mask = locus.mask(layout)
                    made = tuple(_at(places, t, mask, unit) for t in terms)
                    yield Hypothesis(effect.id, options, locus, made, mains)
    yield from friction(places)
    yield from ripple(places)
    yield from force_sensors(places)
    yield from motion_sensors(places)
    yield from followed_sensors(places)


def _at(places: Places, term: Term, mask: Array, unit: float) -> Coefficient:
    weights: Weights = {f: np.asarray(w) * mask for f, w in term.weights.items()}
    return places.coefficient(term.name, weights, term.sd * unit)


def _fits(options: tuple[tuple[str, object], ...], locus: Locus) -> bool:
    member = dict(options).get("member")
    if member is None:
        return True
    if member == "planet":
        return locus.planet != "all"
    return locus.mesh == {"sun": "sp", "ring": "rp"}[str(member)]


Variant = tuple[tuple[tuple[str, object], ...], float, list[Term], int]


def variants(effect: Effect, gear: Gear) -> Iterator[Variant]:
    """Options, unit, terms and how many are the effect's own, of an effect in the force law."""
    make = MAKERS.get(effect.id)
    if make is not None:
        yield from make(gear)


def _mean_stiffness(gear: Gear) -> Iterator[Variant]:
    yield (), 0.1, [Term("factor", {"kappa": 1.0}, 1.0)], 1


def _waves(
    label: str, unit: float, least: int, sign: float
) -> Callable[[Gear], Iterator[Variant]]:
    def make(gear: Gear) -> Iterator[Variant]:
        for order in ORDERS:
            if order < least:
                continue
            terms = [Term(trig, {f"{label} {order} {trig}": sign}, 1.0) for trig in ("cos", "sin")]
            terms += [
                Term(
                    f"{q} {trig}",
                    {f"{label} {q} {trig}": sign},
                    SHAPE / abs(q / order) if q > order else SHAPE * 0.3,
                )
                for q in ORDERS
                if q != order
                for trig in ("cos", "sin")
            ]
            yield (("order", order),), unit, terms, 2

    return make


def _shift(gear: Gear) -> Iterator[Variant]:
    yield (), 0.1, [Term("phase", {"ahead k": 1.0, "ahead e": 1.0}, 1.0)], 1


def _runout(gear: Gear) -> Iterator[Variant]:
    ring = is_ring(gear.model.layout)
    psi = planet_angles(gear.model)
    for member in ("sun", "planet", "ring"):
        lags = [psi, -psi] if member != "planet" else [np.pi * ring]
        for sense, lag in enumerate(lags):
            terms = []
            for h in TURNS:
                cos, sin = f"{member} {h} cos", f"{member} {h} sin"
                sd = 1.0 if h == 1 else SHAPE / h
                a, b = np.cos(h * lag), np.sin(h * lag)
                terms.append(Term(f"{h} cos", {cos: a, sin: b}, sd))
                terms.append(Term(f"{h} sin", {cos: b, sin: -a}, sd))
            yield (("member", member), ("sense", sense)), 5e-6, terms, 2


def _pin(gear: Gear) -> Iterator[Variant]:
    ring = is_ring(gear.model.layout)
    yield (
        (),
        5e-6,
        [
            Term("offset", {"b_plus": -1.0, "b_minus": 1.0}, 1.0),
            Term("ring share", {"b_plus": -ring, "b_minus": ring}, SHAPE),
        ],
        1,
    )


def _backlash(gear: Gear) -> Iterator[Variant]:
    yield (
        (),
        5e-6,
        [
            Term("offset", {"b_plus": 1.0, "b_minus": 1.0}, 1.0),
            Term("flanks", {"b_plus": 1.0, "b_minus": -1.0}, SHAPE),
        ],
        1,
    )


def _thermal_backlash(gear: Gear) -> Iterator[Variant]:
    T = gear.delta_T
    t, bend = T[:, None] * np.ones(12), (T * (T / 50.0 - 1.0))[:, None] * np.ones(12)
    yield (
        (),
        1e-7,
        [
            Term("rate", {"b_plus": t, "b_minus": t}, 1.0),
            Term("curvature", {"b_plus": bend, "b_minus": bend}, SHAPE),
            Term("flanks", {"b_plus": t, "b_minus": -t}, SHAPE),
        ],
        1,
    )


def _thermal_stiffness(gear: Gear) -> Iterator[Variant]:
    T = gear.delta_T
    t, bend = T[:, None] * np.ones(12), (T * (T / 50.0 - 1.0))[:, None] * np.ones(12)
    yield (
        (),
        2e-3,
        [Term("rate", {"kappa": -t}, 1.0), Term("curvature", {"kappa": -bend}, SHAPE)],
        1,
    )


def _hertz(gear: Gear) -> Iterator[Variant]:
    main: Weights = {f"kappa load {i}": float(np.log(f / 1e-5)) for i, f in enumerate(LOADS_M)}
    bend = [Term(f"load {i}", {f"kappa load {i}": 1.0}, SHAPE) for i in range(len(LOADS_M))]
    yield (), 0.1, [Term("exponent", main, 1.0), Term("level", {"kappa": 1.0}, 1.0), *bend], 1


def _damping(gear: Gear) -> Iterator[Variant]:
    # Damping may go with the load in any way from none to all of it.
    bend = [Term(f"load {i}", {f"gamma load {i}": 1.0}, 0.5) for i in range(len(LOADS_M))]
    yield (("law", "contact"),), 0.3, [Term("share", {"gamma out": -1.0}, 1.0), *bend], 1
    by_load: Weights = {f"gamma load {i}": float(f / 1e-5) - 1.0 for i, f in enumerate(LOADS_M)}
    yield (
        (("law", "load"),),
        0.3,
        [Term("share", {"gamma out": -1.0, **by_load}, 1.0), *bend],
        1,
    )


MAKERS = {
    "mean_stiffness": _mean_stiffness,
    "stiffness_harmonic": _waves("k", 0.05, 1, 1.0),
    "profile_error": _waves("e", 3e-6, 2, 1.0),
    "stagger": _shift,
    "planet_phase": _shift,
    "runout": _runout,
    "pin_position": _pin,
    "backlash_offset": _backlash,
    "thermal_backlash": _thermal_backlash,
    "thermal_stiffness": _thermal_stiffness,
    "contact_nonlinearity": _hertz,
    "damping_law": _damping,
}


def friction(places: Places) -> Iterator[Hypothesis]:
    """Tooth friction: torques of |F| along the flanks; its course over the pitch is free."""
    gear = places.gear
    effect = known_effects()["tooth_friction"]
    layout = gear.model.layout
    to_rows = balance.accelerations(gear.model)
    for locus in effect.candidates(layout):
        constant, lever = friction_arms(gear.model, locus.mask(layout))
        of = {"sign": constant @ to_rows.T, "lever": lever @ to_rows.T}
        weights: Weights = {
            (balance.NAME, f"friction {g} of {j}"): of[g][j]
            for j in range(layout.n_mesh)
            for g in ("sign", "lever")
            if np.any(of[g][j])
        }
        at = np.flatnonzero(locus.mask(layout))
        for o in places.of_windows:
            weights |= {(o, f"friction {g} of {j}"): 1.0 for j in at for g in ("sign", "lever")}
        terms = [places.coefficient("mu", weights, 0.05)]
        for g in balance.FRICTION[2:]:
            bend: Weights = {
                (balance.NAME, f"friction {g} of {j}"): of["sign"][j]
                for j in range(layout.n_mesh)
                if np.any(of["sign"][j])
            }
            for o in places.of_windows:
                bend |= {(o, f"friction {g} of {j}"): 1.0 for j in at}
            terms.append(places.coefficient(g, bend, 0.05 * SHAPE))
        yield Hypothesis("tooth_friction", (), locus, tuple(terms), 1)


def ripple(places: Places) -> Iterator[Hypothesis]:
    """Torque ripple of every order, twice and three times the order with it."""
    gear = places.gear
    push = np.zeros(len(gear.model.layout.bodies))
    push[:2] = 0.5 / gear.model.scales.r_bs
    rows = gear.T_1[:, None] * (balance.accelerations(gear.model) @ push)
    for order in balance.RIPPLES:
        terms = []
        for times, sd in ((1, 1.0), (2, SHAPE), (3, SHAPE / 2)):
            if times * order in balance.RIPPLES:
                for trig in ("cos", "sin"):
                    of: Weights = {(balance.NAME, f"ripple {times * order} {trig}"): rows}
                    for o in places.of_windows:
                        of[o, f"ripple {times * order} {trig}"] = gear.T_1[:, None]
                    terms.append(places.coefficient(f"{times} {trig}", of, 0.2 * sd))
        yield Hypothesis("torque_ripple", (("order", order),), Locus(), tuple(terms), 2)
