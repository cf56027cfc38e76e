"""What each residual shows, with the ways to explain it: sensors, force law, torque balance.

With thousands of samples a likelihood names something on every healthy rig. What counts instead
is the share of chi2 that an effect explains on runs left out, and what it leaves unexplained.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.effects.effect import Active
from herringbone_sim.gap.attribution.bodies import BodyFit
from herringbone_sim.gap.attribution.constancy import Varying
from herringbone_sim.gap.attribution.fit import Fit
from herringbone_sim.gap.attribution.hypothesis import name_of
from herringbone_sim.gap.verdict.balance import unsettled
from herringbone_sim.gap.verdict.evidence import Evidence
from herringbone_sim.gap.verdict.thresholds import Thresholds

Array = NDArray[np.float64]

Spans = tuple[tuple[float, float], ...]

NORMAL_90 = 1.645
STEADY = Varying(0.0, 0.0)
SLIGHT = 5e-4  # part of the excess, added to what is left before a share of it counts


@dataclass(frozen=True)
class Option:
    """One way to explain what a stage shows.

    Attributes:
        stage: ``consistency``, ``force_law`` or ``torque_balance``.
        actives: one or two effects with parameters.
        excess: chi2 above 1 that it leaves on runs left out.
        fit: of the force law, if it is one.
        intervals: 90 % interval of each parameter of each effect.
    """

    stage: str
    actives: tuple[Active, ...]
    excess: float
    fit: Fit | None = None
    intervals: tuple[Spans, ...] = ()


@dataclass(frozen=True)
class Stage:
    """What one residual shows: its excess without effects, and the options, best first.

    Attributes:
        least: excess at which something is there as likely as not.
        least_share: part of all chi2 likewise, that an effect explains.
        peak: largest residual over the one at which something is there as likely as not.
        varying: chi2 that the best option wins where its effects may vary with time or load.
    """

    name: str
    nominal: float
    options: tuple[Option, ...]
    thresholds: Thresholds
    least: float
    least_share: float
    peak: float = 0.0
    varying: Varying = STEADY

    @property
    def floor(self) -> float:
        """Excess below which two options can't be told apart."""
        t = self.thresholds
        return t.floor_consistency if self.name == "consistency" else t.floor

    @property
    def best(self) -> float:
        """Excess that the best option leaves."""
        return self.options[0].excess if self.options else self.nominal

    @property
    def share(self) -> float:
        """Share of chi2 that the best option explains."""
        return max(self.nominal - self.best, 0.0) / (1.0 + self.nominal)

    @property
    def gap(self) -> float:
        """Probability that there is anything at all."""
        t = self.thresholds
        size = max(self.share / self.least_share, self.nominal / self.least, self.peak**2)
        return float(size**t.sharp_gap / (1.0 + size**t.sharp_gap))

    @property
    def unknown(self) -> float:
        """Probability that it is none of the catalogue, if there is anything."""
        odds = sum(self.strangeness.values())
        return float(odds / (1.0 + odds))

    @property
    def strangeness(self) -> dict[str, float]:
        """Odds of ``unknown`` by what the best option leaves, and wins by time and by load."""
        t = self.thresholds
        best = max(self.best, 0.0) + self.floor
        whole = self.nominal + self.floor
        shaped = not self.options or has_shape(self.options[0].actives)
        most = t.left if shaped else t.left_exact
        load = self.varying.by_load / (best + SLIGHT * whole)
        return {
            "left": (best / whole / most) ** t.sharp_unknown,
            "time": (self.varying.by_time / whole / t.by_time) ** t.sharp_unknown,
            "load": 0.0 if shaped else (load / t.by_load) ** t.sharp_load,
        }

    @property
    def weights(self) -> Array:
        """Relative odds (options,) by what each leaves."""
        t = self.thresholds
        odds = np.array([self.floor + max(o.excess, 0.0) for o in self.options]) ** -t.sharp_effect
        weights: Array = odds / odds.sum() if len(odds) else odds
        return weights


def has_shape(actives: Sequence[Active]) -> bool:
    """Whether an effect has a shape of its own, which the real one may not have quite."""
    return any(
        a.effect.level == "body" or any(p.neutral is None for p in a.effect.parameters)
        for a in actives
    )


def stages_of(evidence: Evidence, thresholds: Thresholds) -> tuple[Stage, ...]:
    """The residuals that these data give, in the order in which they are asked."""
    found = (
        _sensors(evidence, thresholds),
        _law(evidence, thresholds),
        _bodies(evidence, thresholds),
    )
    return tuple(stage for stage in found if stage is not None)


def _sensors(evidence: Evidence, t: Thresholds) -> Stage | None:
    """Sensors by consistency: the errors found, put right, as one option.

    Where none is found, what geometry alone says; the rest is motion that v does not follow
    between samples.
    """
    check = evidence.check
    if not np.isfinite(check.before):
        return None
    rest = max(check.geometry - 1.0, 0.0)
    nominal, options = rest, []
    for finding in check.findings[:1]:
        nominal = max(check.before - check.after, 0.0) + rest
        half = NORMAL_90 * finding.sigma
        one = finding.active
        wide = _widened(one, tuple((v - half, v + half) for v in one.theta), t)
        left = max(check.corrected - check.after, 0.0) + rest
        options.append(Option("consistency", (one,), left, None, (wide,)))
    least = t.excess_consistency + _unsure(evidence, t)
    return Stage("consistency", nominal, tuple(options), t, least, t.share)


def _law(evidence: Evidence, t: Thresholds) -> Stage | None:
    nominal = evidence.nominal
    if nominal is None:
        return None
    excess = max(nominal.left_out - 1.0, 0.0) + unsettled(
        nominal, evidence.balance_excess, evidence.by_force
    )
    singles = [_option(evidence, one, t) for one in evidence.fits]
    least = min((o.excess for o in singles), default=excess)
    pairs = [
        o
        for o in (_option(evidence, one, t) for one in evidence.pairs)
        if o.excess < (1.0 - t.second) * least
        and least - o.excess > t.second_share * (1.0 + excess)
    ]
    options = tuple(sorted((*singles, *pairs), key=lambda o: o.excess))
    named = name_of(options[0].actives) if options else ""
    steady = evidence.varying.get(named, STEADY)
    least_excess = t.excess_force_law + _unsure(evidence, t)
    return Stage("force_law", excess, options, t, least_excess, t.share, varying=steady)


def _option(evidence: Evidence, one: Fit, t: Thresholds) -> Option:
    """A fit; with a force sensor in it, the balance speaks as well."""
    excess = max(one.left_out - 1.0, 0.0) + unsettled(
        one, evidence.balance_excess, evidence.by_force
    )
    spans = tuple(
        _widened(a, tuple(one.interval(i, k) for k in range(len(a.theta))), t)
        for i, a in enumerate(one.actives)
    )
    return Option("force_law", one.actives, excess, one, spans)


def _bodies(evidence: Evidence, t: Thresholds) -> Stage | None:
    """The balance; how forces run between samples is known as well as the law is."""
    if not evidence.bodies:
        return None
    nominal, *rest = evidence.bodies
    options = tuple(
        Option("torque_balance", b.actives, max(b.left_out - 1.0, 0.0), None, (_spans(b, t),))
        for b in rest
    )
    laws = [one.left_out for one in (*evidence.fits, *evidence.pairs)]
    misfit = max(min(laws) - 1.0, 0.0) if laws else 0.0
    moving = evidence.motion is not None
    settled = t.settled * evidence.balance_settled + t.pinned * evidence.balance_pinned
    floor = t.excess_motion if moving else t.excess_torque_balance
    unsure = _unsure(evidence, t)
    least = floor + t.misfit * misfit + settled + unsure
    if moving and evidence.check.after > evidence.check.geometry:
        least += t.between * (evidence.check.after - evidence.check.geometry)
    high = t.peak * np.sqrt(1.0 + misfit + settled + unsure)
    excess = max(nominal.left_out - 1.0, 0.0)
    share = t.share * least / floor + t.pinned * evidence.balance_pinned / (1.0 + excess)
    return Stage("torque_balance", excess, options, t, least, share, evidence.balance_peak / high)


def _unsure(evidence: Evidence, t: Thresholds) -> float:
    """Excess that a noise which nobody tells may make."""
    return 0.0 if evidence.noise_known else t.noise


def _spans(fit: BodyFit, t: Thresholds) -> Spans:
    one = fit.actives[0]
    half = [NORMAL_90 * float(s) for s in fit.sigma]
    plain = tuple((v - h, v + h) for v, h in zip(one.theta, half, strict=True))
    return _widened(one, plain, t)


def _widened(one: Active, spans: Spans, t: Thresholds) -> Spans:
    """Intervals of the noise with what the law of an effect may be off, inside its bounds.

    A rig's effect has another shape than the catalogue's, and its size answers for that.
    """
    share = t.unsure_shape if has_shape((one,)) else t.unsure_exact
    sized = [p.neutral is not None for p in one.effect.parameters]
    rest = np.where(np.isfinite(one.effect.neutral), one.effect.neutral, 0.0)
    size = float(np.linalg.norm((np.array(one.theta) - rest)[sized]))
    single = sum(sized) < 2 or len({p.unit for p in one.effect.parameters}) > 1
    found = []
    for k, (low, high) in enumerate(spans):
        value = one.theta[k]
        off = share * (abs(value - rest[k]) if single else size) if sized[k] else 0.0
        least, most = (float(bound[k]) for bound in one.effect.bounds)
        down, up = float(np.hypot(value - low, off)), float(np.hypot(high - value, off))
        found.append((max(value - down, min(least, value)), min(value + up, max(most, value))))
    return tuple(found)
