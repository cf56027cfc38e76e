"""Score hypotheses by leave-one-run-out prediction, in a linear screen or by exact fits."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.diagnosis.coefficients import (
    CampaignProducts,
    Coefficient,
    amplitudes,
    functions_used,
)
from herringbone_sim.diagnosis.damped_steps import DampedSteps
from herringbone_sim.diagnosis.machine import Amplitudes, Machine
from herringbone_sim.diagnosis.parallel import parallel_map
from herringbone_sim.diagnosis.products import (
    Block,
    Products,
    products,
    recentred,
    with_offsets,
)
from herringbone_sim.diagnosis.score import (
    PRIOR_SCALES,
    Score,
    chi2_reduction,
    compute_score,
)

# Settings of the fits and of the search, chosen, not fitted:
MAX_ROUNDS = 20
# Chi2 per value worth explaining: an effect at the noise level (d = 1) on 2 % of the rows.
MIN_GAIN_PER_VALUE = 0.02
RELATIVE_TOLERANCE = 1e-4  # relative change of the chi2 at which a fit has converged
MAX_REFUSED = 4  # successive refused steps, of which the last ends the fit
# Chi2 difference that chance gives the best of some thousand hypotheses: a likelihood ratio of
# exp(5), 150. Also absolute tolerance of fits.
CHANCE_CHI2 = 10.0


class Search:
    """Fits and scores of hypotheses on the runs of one machine; fits the tolerances when created.

    Args:
        machine: with its runs.
        noise: (runs, R) factor on the machine's noise, by observation; 1 where none is given.
        start: (p,) start values of the tolerances; None: zero.
        offsets: (R,) prior standard deviation of a constant in each row of each run, in units of
            the machine's noise, by observation; no constant where none is given.

    Attributes:
        base: coefficients of every fit: the tolerances, or those of the fit given to ``onwards``.
        null: score of the fit of the base alone.
        campaign: products linearised about ``null``; set by ``onwards``.
    """

    def __init__(
        self,
        machine: Machine,
        noise: Mapping[str, Array] | None = None,
        start: Array | None = None,
        offsets: Mapping[str, Array] | None = None,
    ) -> None:
        self.machine, self.base = machine, machine.base
        self.rows, self.runs = machine.rows, machine.runs
        self.noise = noise or {}
        self.offsets = offsets or {}
        self._linear: dict[str, list[Products]] = {}
        start = np.zeros(len(self.base)) if start is None else start
        self.null = self.refined((), start)
        self.campaign: CampaignProducts

    def about(
        self,
        coefficients: Sequence[Coefficient],
        mean: Array,
        wanted: Mapping[str, Sequence[str]] | None,
    ) -> CampaignProducts:
        """Products of all observations, linearised about values of the coefficients.

        Observations that are linear up to these values are computed once at zero and shifted.

        Args:
            coefficients: of a hypothesis, beyond the base.
            mean: (p,) or (p, runs) values, those of the base first.
            wanted: functions whose columns are formed, by observation; None: all.
        """
        machine, with_base = self.machine, (*self.base, *coefficients)
        given_amplitudes = amplitudes(with_base, mean, self.runs, self.rows)
        fixed = machine.linear_observations(given_amplitudes)
        for o in fixed:
            if o not in self._linear:
                blocks = self.blocks({}, None, (o,))
                self._linear[o] = parallel_map(products, [b[o] for b in blocks if o in b])
        others = tuple(o for o in machine.functions if o not in fixed)
        blocks = self.blocks(given_amplitudes, wanted, others)
        by_run = parallel_map(lambda of_run: {o: products(b) for o, b in of_run.items()}, blocks)
        for o in fixed:
            for r, p in enumerate(self._linear[o]):
                by_run[r][o] = recentred(p, _amplitude_matrix(given_amplitudes.get(o, {}), p, r))
        return CampaignProducts(by_run, self.base)

    def blocks(
        self,
        amplitudes: Amplitudes,
        wanted: Mapping[str, Sequence[str]] | None,
        observations: Sequence[str],
    ) -> list[dict[str, Block]]:
        """``Machine.blocks`` with the offsets of this search, and the noise times its factors."""
        made = self.machine.blocks(amplitudes, wanted, observations)
        return [
            {
                o: with_offsets(
                    b, self.offsets.get(o), self.noise[o][r] if o in self.noise else None
                )
                for o, b in of_run.items()
            }
            for r, of_run in enumerate(made)
        ]

    def refined(
        self, coefficients: Sequence[Coefficient], start: Array, rounds: int = MAX_ROUNDS
    ) -> Score:
        """Fit a hypothesis by Levenberg-Marquardt, then score it about the solution.

        It ends where a step gains no more, or promises less (without the prior) than the mean chi2
        of a value: then it is less than a standard deviation.

        Where a run diverges at ``start``, it starts from ``null`` and the centres of the priors.

        Args:
            coefficients: of a hypothesis, beyond the base.
            start: (p,) start values, those of the base first.
            rounds: largest number of steps.
        """
        with_base, by_density = (*self.base, *coefficients), self.machine.estimates_states
        wanted = functions_used(with_base)
        mean, least = start.copy(), np.inf
        sd = np.array([c.sd for c in with_base])
        steps = DampedSteps(with_base)
        best: tuple[Array, CampaignProducts] | None = None
        sizes: Sequence[float] = PRIOR_SCALES
        refused, promised = 0, np.inf
        for number in range(rounds):
            campaign = self.about(coefficients, mean, wanted)
            now = float(campaign.chi2.sum()) if campaign.is_finite else np.inf
            if best is None and coefficients and not np.isfinite(now):
                mean = np.concatenate([self.null.mean, [c.center for c in coefficients]])
                campaign = self.about((), self.null.mean, wanted)
                now = float(campaign.chi2.sum())
            if best is not None and not now < least:
                refused += 1
                by_chance = max(RELATIVE_TOLERANCE * least, CHANCE_CHI2)
                if min(now - least, promised) < by_chance or refused == MAX_REFUSED:
                    break
                mean = steps.shorter()
                continue
            settled = least - now < max(RELATIVE_TOLERANCE * now, CHANCE_CHI2)
            refused = 0
            least, best = now, (mean, campaign)
            if settled:
                break
            target = compute_score(campaign, coefficients, mean, sizes, by_density)
            if number and self._cannot_improve(target, coefficients):
                break
            sizes, newton = (target.prior_scale,), target.mean - mean
            A, b = campaign.normal_equations(coefficients)
            promised = float(chi2_reduction(A, b, newton).sum())
            if promised < now / sum(campaign.counts.values()):
                break
            sized = [i >= len(self.base) and c.scales_with_effect for i, c in enumerate(with_base)]
            scaled = sd * np.where(sized, target.prior_scale, 1.0)
            whole = A.sum(axis=0) + np.diag(scaled**-2.0)
            mean = steps.onwards(mean, newton, whole)
        assert best is not None
        mean, campaign = best
        score = compute_score(campaign, coefficients, mean, by_density=by_density)
        # The mean found is one more, untried, step away: keep the last point that was evaluated.
        off = score.leave_one_out_means - score.mean
        if all(c.scales_with_effect for c in with_base):
            A, b = campaign.normal_equations(coefficients)
            gained = 2.0 * np.einsum("rp,rp->r", b, off) - np.einsum("rp,rpq,rq->r", off, A, off)
            chi2 = campaign.chi2 - gained
        else:  # columns change with the amplitudes: evaluate exactly
            used = functions_used(self.base)
            chi2 = self.about(coefficients, (mean + off).T, used).chi2
            diverged = self.null.chi2 if coefficients else campaign.chi2
            chi2 = np.where(np.isfinite(chi2), chi2, diverged)
        in_sample = float(campaign.chi2.sum())
        density = score.log_density + 0.5 * float((score.chi2 - chi2).sum())
        # Far from linear, the density may come out higher than the fit to all runs allows: then
        # its term by the variance of the coefficients is left out.
        if density > -0.5 * in_sample:
            density = -0.5 * max(in_sample, float(chi2.sum()))
        return replace(
            score,
            mean=mean,
            leave_one_out_means=mean + off,
            chi2=chi2,
            log_density=density,
            in_sample=in_sample,
            chi2_by_row={
                o: np.stack([r[o].chi2_without_nuisance for r in campaign.runs])
                for o in campaign.observations
            },
            count=sum(p.values for of_run in campaign.runs for p in of_run.values()),
        )

    def _cannot_improve(self, target: Score, coefficients: Sequence[Coefficient]) -> bool:
        """Whether the next step of a fit, predicted linearly, is no better than ``null``.

        Judged by the loss; where columns change with the amplitudes, by the chi2 gained in sample.
        """
        if not coefficients:
            return False
        if all(c.scales_with_effect for c in (*self.base, *coefficients)):
            return target.loss > self.null.loss
        return self.null.in_sample - target.in_sample < self.worth

    @property
    def worth(self) -> float:
        """Smallest relevant decrease of chi2: ``MIN_GAIN_PER_VALUE`` times the values compared.

        ``CHANCE_CHI2`` if the machine estimates states, see ``Machine.estimates_states``.
        """
        if self.machine.estimates_states:
            return CHANCE_CHI2
        return MIN_GAIN_PER_VALUE * self.null.count

    def settled(self, score: Score) -> Score:
        """Score of a fit with all observations exact; the given one where they were."""
        exact = self.machine.without_linearisation() is self.machine
        return score if exact else self.refitted(score)

    def refitted(self, score: Score) -> Score:
        """Score of a fit with all observations exact, after one more step if it helps."""
        fine = copy.copy(self)
        fine.machine = self.machine.without_linearisation()
        coefficients = score.coefficients[len(self.base) :]
        return fine.refined(coefficients, score.mean, 2)

    def quick(self, coefficients: Sequence[Coefficient]) -> float:
        """Minus the fall of chi2 with priors by a hypothesis, in a linear fit without bounds."""
        n = len(self.base)
        A, b = self.campaign.normal_equations(coefficients)
        sd = np.array([c.sd for c in (*self.base, *coefficients)])
        center = np.array([c.center for c in coefficients])
        off = np.concatenate([np.zeros(n), center])
        A, b = A.sum(0), b.sum(0)
        right = b - A @ off
        whole = A + np.diag(sd**-2.0)
        of_base, across = whole[:n, :n], whole[n:, :n]
        own = whole[n:, n:] - across @ np.linalg.solve(of_base, across.T)
        left = right[n:] - across @ np.linalg.solve(of_base, right[:n])
        known = [y @ np.linalg.solve(of_base, y) for y in (b[:n], right[:n])]
        gained = known[1] - known[0] + left @ np.linalg.solve(own, left)
        return float(off @ A @ off - 2.0 * b @ off - gained)

    def onwards(self, machine: Machine, base_fit: Score | None = None) -> Search:
        """Copy for the same machine or one extended by functions, linearised about ``null``.

        Args:
            base_fit: score that becomes ``null`` and its coefficients the base; None: both stay.
        """
        search = self.with_machine(machine)
        if base_fit is not None:
            known = tuple(
                c if i < len(self.base) else replace(c, sd=c.sd * base_fit.prior_scale)
                for i, c in enumerate(base_fit.coefficients)
            )
            search.base, search.null = known, replace(base_fit, coefficients=known)
        search.campaign = search.about((), search.null.mean, wanted=None)
        return search

    def with_machine(self, machine: Machine) -> Search:
        """Copy for another machine with the same base; linear scores stay those of the present."""
        search = copy.copy(self)
        search.machine = machine
        before, after = self.machine.functions, machine.functions
        search._linear = {o: p for o, p in self._linear.items() if before[o] == after[o]}
        return search

    def screened(self, coefficients: Sequence[Coefficient], size: float) -> Score:
        """Leave-one-run-out score at prior scale ``size`` by a linear fit about ``null``."""
        start = np.concatenate([self.null.mean, np.zeros(len(coefficients))])
        by_density = self.machine.estimates_states
        return compute_score(self.campaign, coefficients, start, (size,), by_density)


def _amplitude_matrix(made: Mapping[str, Array], p: Products, r: int) -> Array:
    """(R, Q) amplitudes ``made`` of run r, in the order of the functions of ``p``."""
    a = np.zeros(p.c.shape)
    for name, values in made.items():
        a[:, p.functions.index(name)] = values[r]
    return a
