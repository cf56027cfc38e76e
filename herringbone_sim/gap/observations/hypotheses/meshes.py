"""Hypotheses: effects of the catalogue on the force law as sums of basis functions.

The catalogue's law is the prior mean of a curve: the coefficients of the effect scale it, those of
departures let the curve differ from it, by ``DEPARTURE_SHARE`` of the effect's size a priori.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.diagnosis.coefficients import Coefficient
from herringbone_sim.diagnosis.machine import Hypothesis
from herringbone_sim.effects.effect import Effect, Locus
from herringbone_sim.effects.registry import effects as known_effects
from herringbone_sim.effects.site import is_ring, planet_angles
from herringbone_sim.gap.observations.basis import LOADS_M, ORDERS, TURNS
from herringbone_sim.gap.observations.gear import GearObservations
from herringbone_sim.gap.observations.hypotheses.bodies import friction, ripple
from herringbone_sim.gap.observations.hypotheses.coefficients import (
    DEPARTURE_SHARE,
    CoefficientBuilder,
    Weights,
)
from herringbone_sim.gap.observations.hypotheses.damaged_teeth import tooth_meets
from herringbone_sim.gap.observations.hypotheses.sensors import (
    force_sensor_errors,
    motion_sensor_errors,
    window_sensor_errors,
)


@dataclass(frozen=True)
class Term:
    """A coefficient of an effect before a place is chosen.

    Attributes:
        name: of the parameter, or of the departure.
        weights: by function of the force law, or by (observation, function): a number, (rows,) or
            (runs, rows).
        sd: prior standard deviation over the moderate size of the effect.
    """

    name: str
    weights: Weights
    sd: float


def hypotheses(builder: CoefficientBuilder, only: Collection[str] = ()) -> Iterator[Hypothesis]:
    """Yield every effect of the catalogue at every place with every option.

    Damaged teeth and moving parts are left out: the residual suggests them, see ``proposals``.

    Args:
        only: effects on the force law to include; empty: all. Others are always included.
    """
    layout = builder.gear.model.layout
    for effect in known_effects().values():
        if only and effect.id not in only:
            continue
        for options, unit, terms, mains in variants(effect, builder.gear):
            member = dict(options).get("member")
            for locus in effect.candidates(layout):
                if member is None or tooth_meets(str(member), locus):
                    mask = locus.mask(layout)
                    made = tuple(
                        _placed_term(builder, t, mask, unit)
                        for t in _distinct_terms(terms, mains, mask)
                    )
                    yield Hypothesis(effect.id, options, locus, made, mains)
    yield from friction(builder)
    yield from ripple(builder)
    yield from force_sensor_errors(builder)
    yield from motion_sensor_errors(builder)
    yield from window_sensor_errors(builder)


def _distinct_terms(terms: Sequence[Term], mains: int, mask: Array) -> Iterator[Term]:
    """Yield the terms that add something on the meshes of a mask (n_mesh,).

    The first ``mains`` always do; a later one does if it acts on these meshes, and not in the
    same way as a term before it.
    """
    before: list[dict[Any, bytes]] = []
    for i, term in enumerate(terms):
        on = {f: np.asarray(w) * mask + 0.0 for f, w in term.weights.items()}
        acts = {f: w.tobytes() for f, w in on.items() if np.any(w)}
        if i < mains or (acts and acts not in before):
            before.append(acts)
            yield term


def _placed_term(builder: CoefficientBuilder, term: Term, mask: Array, unit: float) -> Coefficient:
    """Coefficient of a term on the meshes of a mask (n_mesh,); ``unit``: the moderate size."""
    weights: Weights = {f: np.asarray(w) * mask for f, w in term.weights.items()}
    return builder.coefficient(term.name, weights, term.sd * unit)


# Options, moderate size in the effect's unit, terms, and number of the effect's terms, which come
# first (then departures). The moderate sizes are chosen: well visible beside tolerances.
Variant = tuple[tuple[tuple[str, object], ...], float, list[Term], int]


def variants(effect: Effect, gear: GearObservations) -> Iterator[Variant]:
    """Yield the variants of an effect on the force law; none for other effects."""
    make = TERM_BUILDERS.get(effect.id)
    if make is not None:
        yield from make(gear)


def _mean_stiffness(gear: GearObservations) -> Iterator[Variant]:
    """Yield one variant: k(t) changes by a factor. Departure: a further change of ring meshes."""
    ring = Term("ring", {"kappa": is_ring(gear.model.layout)}, DEPARTURE_SHARE)
    yield (), 0.1, [Term("factor", {"kappa": 1.0}, 1.0), ring], 1


def _waves(
    label: str, unit: float, least: int, sign: float
) -> Callable[[GearObservations], Iterator[Variant]]:
    """Return a builder of variants: waves of each mesh order from ``least`` on.

    Departures are waves of the other orders.

    Args:
        label: of the functions: ``k`` or ``e``.
        unit: moderate amplitude.
        sign: of the weights.
    """

    def make(gear: GearObservations) -> Iterator[Variant]:
        for order in ORDERS:
            if order < least:
                continue
            terms = [Term(trig, {f"{label} {order} {trig}": sign}, 1.0) for trig in ("cos", "sin")]
            terms += [
                Term(
                    f"{q} {trig}",
                    {f"{label} {q} {trig}": sign},
                    DEPARTURE_SHARE / abs(q / order) if q > order else DEPARTURE_SHARE * 0.3,
                )
                for q in ORDERS
                if q != order
                for trig in ("cos", "sin")
            ]
            yield (("order", order),), unit, terms, 2

    return make


def _phase(gear: GearObservations) -> Iterator[Variant]:
    """Yield one variant: k(t) and e(t) advance by an angle [rad].

    Departure: a further angle of the ring meshes.
    """
    ring = is_ring(gear.model.layout)
    of_ring = Term("ring", {"advance k": ring, "advance e": ring}, DEPARTURE_SHARE)
    yield (), 0.1, [Term("phase", {"advance k": 1.0, "advance e": 1.0}, 1.0), of_ring], 1


def _runout(gear: GearObservations) -> Iterator[Variant]:
    """Yield the run-out of each member with its harmonics as departures.

    A point of sun or ring may meet the planets in either order: two variants each.
    """
    ring = is_ring(gear.model.layout)
    psi = planet_angles(gear.model)
    for member in ("sun", "planet", "ring"):
        mesh_delays = [psi, -psi] if member != "planet" else [np.pi * ring]
        for sense, lag in enumerate(mesh_delays):
            terms = []
            for h in TURNS:
                cos, sin = f"{member} {h} cos", f"{member} {h} sin"
                sd = 1.0 if h == 1 else DEPARTURE_SHARE
                a, b = np.cos(h * lag), np.sin(h * lag)
                terms.append(Term(f"{h} cos", {cos: -a, sin: -b}, sd))
                terms.append(Term(f"{h} sin", {cos: b, sin: -a}, sd))
            yield (("member", member), ("sense", sense)), 5e-6, terms, 2


def _flanks(name: str, drive: Array | float, back: Array | float) -> Term:
    """Departure: change of the half-backlash on the drive and on the back flank."""
    return Term(name, {"b_plus": drive, "b_minus": back}, DEPARTURE_SHARE)


def _pin(gear: GearObservations) -> Iterator[Variant]:
    """Yield one variant: by a tangential pin offset [m], backlash moves from flank to flank.

    Departures: another offset of ring meshes (pin also off radially), of the right side (tilted).
    """
    ring, right = is_ring(gear.model.layout), Locus(side="R").mask(gear.model.layout)
    departures = [_flanks("ring", ring, -ring), _flanks("right side", right, -right)]
    yield (), 5e-6, [Term("offset", {"b_plus": 1.0, "b_minus": -1.0}, 1.0), *departures], 1


def _backlash(gear: GearObservations) -> Iterator[Variant]:
    """Yield one variant: the half-backlash of both flanks changes by an offset [m].

    Departures: a further change of the back flank, of both flanks of the ring meshes, and of the
    back flank of the ring meshes.
    """
    ring = is_ring(gear.model.layout)
    departures = [
        _flanks("back flank", 0.0, 1.0),
        _flanks("ring", ring, ring),
        _flanks("back flank of the ring", 0.0, ring),
    ]
    yield (), 5e-6, [Term("offset", {"b_plus": 1.0, "b_minus": 1.0}, 1.0), *departures], 1


def _temperatures(gear: GearObservations) -> tuple[Array, Array]:
    """T = delta_T and its curvature T (T / 50 K - 1), (runs, n_mesh) each [K]."""
    T = gear.delta_T[:, None] * np.ones(gear.model.layout.n_mesh)
    return T, T * (T / 50.0 - 1.0)


def _thermal_backlash(gear: GearObservations) -> Iterator[Variant]:
    """Yield one variant: b' of both flanks grows by a rate [m/K] times delta_T.

    Departures: curvature over delta_T; a further change of the back flank; one of ring meshes.
    """
    T, bend = _temperatures(gear)
    ring = is_ring(gear.model.layout)
    departures = [
        _flanks("curvature", bend, bend),
        _flanks("back flank", 0.0, T),
        _flanks("ring", T * ring, T * ring),
    ]
    yield (), 1e-7, [Term("rate", {"b_plus": T, "b_minus": T}, 1.0), *departures], 1


def _thermal_stiffness(gear: GearObservations) -> Iterator[Variant]:
    """Yield one variant: k falls by a fraction of itself per kelvin [1/K].

    Departures: curvature over delta_T; a further fall of the stiffness of ring meshes.
    """
    T, bend = _temperatures(gear)
    of = {"curvature": bend, "ring": T * is_ring(gear.model.layout)}
    departures = [Term(name, {"kappa": -w}, DEPARTURE_SHARE) for name, w in of.items()]
    yield (), 2e-3, [Term("rate", {"kappa": -T}, 1.0), *departures], 1


def _contact_terms(gear: GearObservations) -> Iterator[Variant]:
    """Yield one variant: the contact force has another exponent than 1, linearised.

    k changes by (exponent - 1) log(|f| / 10 um) of itself. Departures: any curve over |f|.
    """
    main: Weights = {f"kappa load {i}": float(np.log(f / 1e-5)) for i, f in enumerate(LOADS_M)}
    bend = [
        Term(f"load {i}", {f"kappa load {i}": 1.0}, DEPARTURE_SHARE) for i in range(len(LOADS_M))
    ]
    yield (), 0.1, [Term("exponent", main, 1.0), Term("level", {"kappa": 1.0}, 1.0), *bend], 1


def _damping(gear: GearObservations) -> Iterator[Variant]:
    """Yield two laws: damping only in contact; damping proportional to the deflection.

    The latter is c v at a deflection of 10 um. Departures: its slope, any curve over |f|.
    """
    # The dependence on the deflection is uncertain by half of the effect.
    bend = [Term(f"load {i}", {f"gamma load {i}": 1.0}, 0.5) for i in range(len(LOADS_M))]
    yield (("law", "contact"),), 0.3, [Term("share", {"gamma free": -1.0}, 1.0), *bend], 1
    slope: Weights = {f"gamma load {i}": float(f / 1e-5) for i, f in enumerate(LOADS_M)}
    by_load = {"gamma free": -1.0, **{name: w - 1.0 for name, w in slope.items()}}
    depth = Term("slope", slope, 0.5)
    yield (("law", "load"),), 0.3, [Term("share", by_load, 1.0), depth, *bend], 1


TERM_BUILDERS = {
    "mean_stiffness": _mean_stiffness,
    "stiffness_harmonic": _waves("k", 0.05, 1, 1.0),
    "profile_error": _waves("e", 3e-6, 2, -1.0),
    "stagger": _phase,
    "planet_phase": _phase,
    "runout": _runout,
    "pin_position": _pin,
    "backlash_offset": _backlash,
    "thermal_backlash": _thermal_backlash,
    "thermal_stiffness": _thermal_stiffness,
    "contact_nonlinearity": _contact_terms,
    "damping_law": _damping,
}
