"""What the fit runs say: sensors by consistency, then the force law, then the torque balance.

Every effect at every locus is tried by linear regression, the best few by the exact laws, and a
second one on top of the first. All scores are those of operating points that were left out.
Held-out runs are refused.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.effects.effect import Effect
from herringbone_sim.effects.registry import effects as known_effects
from herringbone_sim.errors import AnalysisError
from herringbone_sim.gap.attribution.bodies import BodyFit
from herringbone_sim.gap.attribution.channel_sets import FEW, channel_set
from herringbone_sim.gap.attribution.constancy import Varying, varying
from herringbone_sim.gap.attribution.fit import Fit, fit
from herringbone_sim.gap.attribution.hypothesis import Case, case, name_of
from herringbone_sim.gap.attribution.shortlist import Base, Candidate, base, choose, shortlist
from herringbone_sim.gap.attribution.unforced import Unforced, moving, unforced
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.filtering.few import few
from herringbone_sim.gap.residuals.fusion import fuse
from herringbone_sim.gap.residuals.recalibrate import recalibrate
from herringbone_sim.gap.sensors.clock import set_right
from herringbone_sim.gap.sensors.corrected import drop
from herringbone_sim.gap.sensors.find import SensorCheck, find_sensor_errors
from herringbone_sim.gap.verdict.balance import balance_evidence

Array = NDArray[np.float64]
Say = Callable[[str], None]

SINGLES = 8
SECONDS = 4
SEED = 20  # of the noise that gives the floor of the accelerations
CLOSE = 1.5  # times the excess of the best one: another first of a pair
MORE_FIRSTS = 2
POOR = 0.1  # of the excess left by the best pair: other effects may go first
WORTH_A_SECOND = 0.03  # excess of chi2 that a second effect is looked for in


@dataclass(frozen=True)
class Evidence:
    """All that the fit runs say.

    Attributes:
        check: sensors against each other.
        cases: fit runs, without what the sensors were found to add.
        nominal: the calibrated law without effects; None when no mesh has x, v and F.
        candidates: linear shortlist, the best first.
        fits: nonlinear fits of single effects, the best on runs left out first, with what forces
            put right leave in the balance.
        pairs: fits of two effects, likewise.
        bodies: balance without effects and with each one on the bodies, with the forces as the
            best fit has them; empty when unknown.
        balance_excess: chi2 above 1 of the balance with the forces as measured, between samples by
            the best law of the machine, and without an effect on the bodies that is clear.
        by_force: per name of a fit with a force sensor: the same with its forces corrected.
        balance_peak: largest residual of the balance without effects, over its floor; 0 unknown.
        balance_settled: excess that the best fit takes off the balance: by a force put right, by
            what a free pin does to the carrier, or between samples.
        balance_pinned: part of that which a free pin takes off.
        varying: per name of the best fits: what they win where effects may vary.
        noise_known: whether the campaign tells its noise.
        motion: without force sensors, calibration and fits of the accelerations.
    """

    check: SensorCheck
    cases: tuple[Case, ...]
    nominal: Fit | None
    candidates: tuple[Candidate, ...]
    fits: tuple[Fit, ...]
    pairs: tuple[Fit, ...]
    bodies: tuple[BodyFit, ...]
    balance_excess: float
    by_force: dict[str, float]
    motion: Unforced | None = None
    balance_peak: float = 0.0
    balance_settled: float = 0.0
    balance_pinned: float = 0.0
    varying: dict[str, Varying] = field(default_factory=dict)
    noise_known: bool = True


def gather(runs: Sequence[PreparedRun], say: Say = lambda text: None) -> Evidence:
    """Evidence of the fit runs of a rig.

    Args:
        runs: all with role ``fit``.
        say: told of the progress.

    Raises:
        AnalysisError: no runs, or one that was to be held out.
    """
    if not runs or any(run.role != "fit" for run in runs):
        roles = ", ".join(f"{run.name}: {run.role}" for run in runs) or "no run"
        raise AnalysisError(f"only runs of role fit may enter a choice, got {roles}: mark some")
    effects = tuple(known_effects().values())
    say("sensors against each other")
    check = find_sensor_errors(runs)
    cases = tuple(case(run, fuse(run)) for run in (mended(run, check) for run in runs))
    if not any(c.usable.any() for c in cases) and moving(cases):
        say("every effect at every place, by accelerations alone")
        motion = unforced(cases, effects, np.random.default_rng(SEED))
        return Evidence(check, cases, None, (), (), (), motion.fits, 0.0, {}, motion)
    if not all(c.usable.any() for c in cases):
        if channel_set(cases) != FEW:
            return Evidence(check, cases, None, (), (), (), (), 0.0, {})
        say("every effect by a filter of the few channels")
        seen = few(cases, effects)
        return Evidence(check, cases, None, (), (), (), seen.fits, 0.0, {}, seen)
    say("recalibration")
    nominal = fit(cases, recalibrate([c.run for c in cases], [c.fused for c in cases]).factors, ())
    say("every effect at every place")
    start = base(cases, nominal.factors)
    candidates = tuple(shortlist(start, effects))
    fits = _singles(cases, nominal, candidates, say)
    pairs = _pairs(start, nominal, fits, effects, say)
    balance = balance_evidence(cases, (nominal, *fits, *pairs), effects, say)
    fits, pairs = (tuple(sorted(some, key=balance.left)) for some in (fits, pairs))
    return Evidence(
        check,
        cases,
        nominal,
        candidates,
        fits,
        pairs,
        balance.fits,
        balance.excess,
        balance.by_force,
        balance_peak=balance.peak,
        balance_settled=balance.settled,
        balance_pinned=balance.pinned,
        varying=_varying(cases, (fits, pairs)),
    )


def mended(run: PreparedRun, check: SensorCheck) -> PreparedRun:
    """A run without the channels found wrong, or with its clock put right."""
    for finding in check.findings:
        if finding.effect == "clock_drift" and finding.group.quantity == "xvu":
            run = set_right(run, finding.value)
        else:
            run = drop(run, finding.group.names)
    return run


def _singles(
    cases: Sequence[Case], nominal: Fit, candidates: Sequence[Candidate], say: Say
) -> tuple[Fit, ...]:
    found = []
    for one in choose(candidates, SINGLES):
        say(f"fit {name_of((one.active,))}")
        found.append(fit(cases, nominal.factors, (one.active,)))
    return tuple(sorted(found, key=lambda f: f.left_out))


def _pairs(
    start: Base,
    nominal: Fit,
    fits: Sequence[Fit],
    effects: Sequence[Effect],
    say: Say,
) -> tuple[Fit, ...]:
    """The best single effects with each of the best seconds on what they leave.

    Of two effects on many meshes the best single one is often neither; so where all pairs leave
    much, further ones go first.
    """
    if not fits or fits[0].left_out - 1.0 < WORTH_A_SECOND:
        return ()
    found: dict[frozenset[str], Fit] = {}
    firsts = _firsts(fits)
    for first in firsts:
        _add_pairs(found, start, first, effects, say)
    excess = min(one.left_out for one in found.values()) - 1.0 if found else np.inf
    if excess > POOR * (nominal.left_out - 1.0):
        for first in [one for one in fits if all(one is not first for first in firsts)][
            :MORE_FIRSTS
        ]:
            _add_pairs(found, start, first, effects, say)
    return tuple(sorted(found.values(), key=lambda f: f.left_out))


def _add_pairs(
    found: dict[frozenset[str], Fit], start: Base, first: Fit, effects: Sequence[Effect], say: Say
) -> None:
    """A single effect with each of the best seconds on what it leaves, added by their names."""
    rest = base(start.cases, first.factors, first.actives, start)
    for one in choose(shortlist(rest, effects), SECONDS):
        both = (*first.actives, one.active)
        names = frozenset(name_of((a,)) for a in both)
        if one.active.effect.id != first.actives[0].effect.id and names not in found:
            say(f"fit {name_of(both)}")
            found[names] = fit(start.cases, first.factors, both)


def _firsts(fits: Sequence[Fit]) -> list[Fit]:
    """The best single effect, and the best other one where it leaves hardly more."""
    best = fits[0]
    others = [f for f in fits if f.actives[0].effect.id != best.actives[0].effect.id]
    near = others and others[0].left_out - 1.0 < CLOSE * (best.left_out - 1.0)
    return [best, others[0]] if near else [best]


def _varying(cases: Sequence[Case], ranked: Sequence[Sequence[Fit]]) -> dict[str, Varying]:
    """Whether the best fits of one and of two effects hold at all times and loads."""
    best = [fits[0] for fits in ranked if fits]
    return {name_of(one.actives): varying(cases, one) for one in best}
