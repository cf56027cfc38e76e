"""Score hypotheses by leave-one-run-out prediction: all of them linearly, the best ones exactly.

Longer than 300 lines: ``Machine``, ``Hypothesis``, ``Score`` and ``Search`` are the interface that
a machine implements and are read together.

Energy means whitened sum of squares (chi2) throughout. Amplitudes are the values at which
functions act: observation -> function -> (runs, rows).
"""

from __future__ import annotations

import copy
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

from herringbone_sim.arrays import Array
from herringbone_sim.diagnosis.flexible import RegressionInputs
from herringbone_sim.diagnosis.products import (
    Block,
    CampaignProducts,
    Coefficient,
    Products,
    products,
    recentred,
)
from herringbone_sim.diagnosis.regression import LeftOut, Normal, leave_one_out, within
from herringbone_sim.diagnosis.threads import parallel_map

Amplitudes = Mapping[str, Mapping[str, Array]]
# Chosen, not fitted: bound of a departure from the catalogue's curve, in its prior standard
# deviations.
MAX_DEPARTURE_SD = 3.0
# Iterations between the size of an effect and the prior of its departures; chosen.
DEPARTURE_ROUNDS = 2
# Factors tried on the prior of an effect's size (1: moderate effect), half a decade apart; chosen.
PRIOR_SCALES = (0.03, 0.1, 0.3, 1.0, 3.0)


class Machine(Protocol):
    """Interface of a machine: observations of its runs, linearised about any amplitudes.

    Attributes:
        base: coefficients that every hypothesis contains: the tolerances.
        rows: number of rows of each observation.
        runs: number of runs.
    """

    base: tuple[Coefficient, ...]
    rows: Mapping[str, int]
    runs: int

    @property
    def functions(self) -> Mapping[str, tuple[str, ...]]:
        """Names of the functions (columns) of each observation."""

    def hypotheses(self) -> list[Hypothesis]:
        """The catalogue: every effect at every place with every option."""

    def proposals(self, amplitudes: Amplitudes, known: Score) -> tuple[Machine, list[Hypothesis]]:
        """Hypotheses suggested by the residual beyond the catalogue, such as a damaged tooth.

        Args:
            amplitudes: of the current fit; its residual is searched.
            known: the current fit.

        Returns:
            Machine extended by the functions of the new hypotheses (itself if there are none),
            and the new hypotheses.
        """

    def nonlinear_trials(
        self, ranked: Sequence[tuple[Hypothesis, Array]], known: Score
    ) -> list[tuple[float, Hypothesis, Array]]:
        """Evaluate hypotheses at finite sizes, for gaps that no linear fit explains.

        Args:
            ranked: hypotheses with the mean of their linear fits, best first.
            known: fit without any of them.

        Returns:
            Energy, hypothesis and start of its fit (coefficients of ``known`` first), best first.
        """

    def without_linearisation(self) -> Machine:
        """Copy whose blocks are computed exactly at the amplitudes, none extrapolated linearly."""

    def regression_inputs(self, observation: str, r: int, block: Block) -> RegressionInputs:
        """Measured quantities that an unknown law of these rows may depend on, for run r."""

    def cycles(self, observation: str, r: int) -> Array:
        """(n,) cycles since the start of run r at every sample."""

    def linear_observations(self, amplitudes: Amplitudes) -> tuple[str, ...]:
        """Observations whose residual is linear in the functions up to these amplitudes."""

    def blocks(
        self,
        amplitudes: Amplitudes,
        wanted: Mapping[str, Sequence[str]] | None,
        observations: Sequence[str],
    ) -> list[dict[str, Block]]:
        """Residuals and columns of all runs about some amplitudes.

        Args:
            wanted: functions whose columns are formed, by observation; None: all.
            observations: names of those that are formed.

        Returns:
            For each run, its blocks by observation.
        """


@dataclass(frozen=True)
class Hypothesis:
    """An effect with its options at a place.

    Attributes:
        effect, options: as in the catalogue.
        locus: place, such as (mesh, planet, side).
        coefficients: to fit; the effect's own parameters first, then departures from its curve.
        n_own: number of own parameters.
        source: object from which the machine rebuilds the hypothesis for other runs; None for
            those of the catalogue.
        measured_gain: energy removed at the centres of its coefficients, evaluated by the machine
            where the effect is strongly nonlinear; None: the linear screen decides.
        base_mean: values of all other coefficients at ``measured_gain``.
    """

    effect: str
    options: tuple[tuple[str, object], ...]
    locus: Hashable
    coefficients: tuple[Coefficient, ...]
    n_own: int
    source: Any = None
    measured_gain: float | None = None
    base_mean: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        departures = [replace(c, departs_from=self.n_own) for c in self.coefficients[self.n_own :]]
        object.__setattr__(self, "coefficients", (*self.coefficients[: self.n_own], *departures))


@dataclass(frozen=True)
class Score:
    """Fit of p coefficients and its leave-one-run-out prediction error.

    Attributes:
        coefficients: tolerances first.
        mean: (p,) posterior mean from all runs.
        covariance: (p, p) posterior covariance for the assumed noise.
        leave_one_out_means: (runs, p) posterior means without one run each.
        energy: (runs,) energy left of each run when predicted from the others.
        in_sample: energy left when all runs are fitted.
        log_density: sum of log predictive densities of the left-out runs.
        prior_scale: factor on the priors that predicted best, see ``PRIOR_SCALES``.
        energy_by_row: (runs, R) energy left in sample, by observation.
        count: number of whitened values.
    """

    coefficients: tuple[Coefficient, ...]
    mean: Array
    covariance: Array
    leave_one_out_means: Array
    energy: Array
    in_sample: float
    log_density: float
    prior_scale: float
    energy_by_row: Mapping[str, Array]
    count: float = 0.0

    def covariance_with_jackknife(self) -> Array:
        """(p, p) posterior covariance plus the jackknife covariance over runs.

        The posterior assumes white noise; the jackknife also contains model error that differs
        between runs. It is widened by the ratio of Student's to normal 95 % quantiles.
        """
        runs = len(self.leave_one_out_means)
        if runs < 2:
            return self.covariance
        off = self.leave_one_out_means - self.leave_one_out_means.mean(axis=0)
        wide = float(student.ppf(0.95, runs - 1) / norm.ppf(0.95)) ** 2
        jackknife: Array = wide * (runs - 1) / runs * off.T @ off
        return self.covariance + jackknife


def compute_score(
    campaign: CampaignProducts,
    coefficients: Sequence[Coefficient],
    mean: Array | None = None,
    sizes: Sequence[float] = PRIOR_SCALES,
) -> Score:
    """Score of the linearised campaign, at the prior scale with the best predictive density.

    Args:
        campaign: products formed about ``mean``.
        coefficients: of a hypothesis, beyond the tolerances.
        mean: (p,) point of linearisation; None: zero.
        sizes: prior scales to try.
    """
    every = (*campaign.base, *coefficients)
    A, b = campaign.normal_equations(coefficients)
    n = len(campaign.base)
    center = np.array([c.center for c in every])
    # Shift the origin from ``mean`` to the centre of the prior.
    off = center - (np.zeros(len(every)) if mean is None else mean)
    energy = campaign.energy - _energy_reduction(A, b, off)
    b = b - A @ off
    prior, bound = np.array([c.sd for c in every]), np.array([c.bound for c in every])
    best: tuple[float, LeftOut, float, Array] | None = None
    sized = np.array([i >= n and c.scales_with_effect for i, c in enumerate(every)])
    reach = _trust_region(every)
    for size in sizes if sized.any() else (1.0,):
        sd = prior * np.where(sized, size, 1.0)
        found = leave_one_out(Normal(A, b, sd, bound, reach))
        density = float(found.log_density.sum())
        if best is None or density > best[0]:
            best = density, found, size, sd
    assert best is not None
    density, found, size, sd = best
    bent = np.array([c.departs_from > 0 for c in every])
    for _ in range(DEPARTURE_ROUNDS if bent.any() else 0):
        sd = np.where(bent, prior * _effect_sizes(every, center + found.whole.mean), sd)
        found = leave_one_out(
            Normal(A, b, sd, np.where(bent, MAX_DEPARTURE_SD * sd, bound), reach)
        )
        density = float(found.log_density.sum())
    whole = found.whole
    return Score(
        every,
        center + whole.mean,
        whole.covariance,
        center + found.means,
        energy - found.fall,
        float(np.sum(energy - _energy_reduction(A, b, whole.mean))),
        density - 0.5 * float(energy.sum()),
        size,
        {},
    )


def _trust_region(coefficients: Sequence[Coefficient]) -> Array:
    """(p,) largest steps for which columns hold: the prior where they change with amplitudes."""
    return np.array([np.inf if c.scales_with_effect else c.sd for c in coefficients])


def _effect_sizes(coefficients: Sequence[Coefficient], mean: Array) -> Array:
    """(p,) size of the effect that each departure belongs to, 1 for a moderate one; else 1."""
    found, size = np.ones(len(mean)), 1.0
    for i, c in enumerate(coefficients):
        if c.departs_from and not coefficients[i - 1].departs_from:
            own = range(i - c.departs_from, i)
            size = max(abs(mean[j]) / coefficients[j].sd for j in own)
        if c.departs_from:
            found[i] = size
    return np.maximum(found, PRIOR_SCALES[0] ** 2)


def _energy_reduction(A: Array, b: Array, step: Array) -> Array:
    """(runs,) decrease of the energy by a step (p,) of the coefficients."""
    fall: Array = 2.0 * b @ step - np.einsum("i,rij,j->r", step, A, step)
    return fall


def amplitudes(
    coefficients: Sequence[Coefficient], mean: Array, runs: int, rows: Mapping[str, int]
) -> dict[str, dict[str, Array]]:
    """Amplitudes of all functions at values ``mean`` (p,) of the coefficients."""
    found: dict[str, dict[str, Array]] = {}
    for c, value in zip(coefficients, mean, strict=True):
        for o, placement in c.placements.items():
            of = found.setdefault(o, {})
            for row, f, w in placement.entries:
                a = of.setdefault(f, np.zeros((runs, rows[o])))
                a[:, row] += value * w
    return found


def functions_used(coefficients: Sequence[Coefficient]) -> dict[str, list[str]]:
    """Names of the functions that coefficients use, by observation."""
    found: dict[str, dict[str, None]] = {}
    for c in coefficients:
        for o, placement in c.placements.items():
            found.setdefault(o, {}).update(dict.fromkeys(placement.functions))
    return {o: list(names) for o, names in found.items()}


# Settings of Gauss-Newton and of the search, chosen, not fitted:
MAX_ROUNDS = 20
# Energy per value worth explaining: an effect at the noise level (d = 1) on 2 % of the rows.
MIN_GAIN_PER_VALUE = 0.02
RELATIVE_TOLERANCE = 1e-4  # relative change of the energy at which a fit has converged
MAX_STEP_CUTS = 4  # successive step reductions by 0.3, together to 0.8 %
# Energy difference that chance gives the best of some thousand hypotheses: a likelihood ratio of
# exp(5), 150. Also absolute tolerance of fits.
CHANCE_CHI2 = 10.0


class Search:
    """Fits and scores of hypotheses on the runs of one machine.

    Args:
        machine: with its runs.
        noise: (runs, R) factor on the machine's noise, by observation; 1 where none is given.
        start: (p,) start values of the tolerances; None: zero.

    Attributes:
        null: score of the calibrated machine, or of the fit that ``onwards`` was given.
        campaign: products about ``null``; set by ``onwards``.
    """

    def __init__(
        self,
        machine: Machine,
        noise: Mapping[str, Array] | None = None,
        start: Array | None = None,
    ) -> None:
        self.machine, self.base = machine, machine.base
        self.rows, self.runs = machine.rows, machine.runs
        self.noise = noise or {}
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
        """Products of all observations about a solution.

        Observations that are linear up to there are computed once at zero and shifted.

        Args:
            coefficients: of a hypothesis, beyond the base.
            mean: (p,) values, those of the base first.
            wanted: functions whose columns are formed, by observation; None: all.
        """
        machine, every = self.machine, (*self.base, *coefficients)
        made = amplitudes(every, mean, self.runs, self.rows)
        fixed = machine.linear_observations(made)
        for o in fixed:
            if o not in self._linear:
                blocks = self.blocks({}, None, (o,))
                self._linear[o] = parallel_map(products, [b[o] for b in blocks if o in b])
        others = tuple(o for o in machine.functions if o not in fixed)
        blocks = self.blocks(made, wanted, others)
        found = parallel_map(lambda of_run: {o: products(b) for o, b in of_run.items()}, blocks)
        for o in fixed:
            for r, p in enumerate(self._linear[o]):
                found[r][o] = recentred(p, _amplitude_matrix(made.get(o, {}), p, r))
        return CampaignProducts(found, self.base)

    def blocks(
        self,
        amplitudes: Amplitudes,
        wanted: Mapping[str, Sequence[str]] | None,
        observations: Sequence[str],
    ) -> list[dict[str, Block]]:
        """Blocks of the machine with its noise times ``noise``."""
        made = self.machine.blocks(amplitudes, wanted, observations)
        return [
            {
                o: replace(b, sigma=b.sigma * self.noise[o][r]) if o in self.noise else b
                for o, b in of_run.items()
            }
            for r, of_run in enumerate(made)
        ]

    def refined(
        self, coefficients: Sequence[Coefficient], start: Array, rounds: int = MAX_ROUNDS
    ) -> Score:
        """Fit by Gauss-Newton, then score about the solution.

        Args:
            coefficients: of a hypothesis, beyond the base.
            start: (p,) start values, those of the base first.
            rounds: largest number of steps.
        """
        every = (*self.base, *coefficients)
        wanted = functions_used(every)
        mean, least = start.copy(), np.inf
        step = np.zeros_like(mean)
        best: tuple[Array, CampaignProducts] | None = None
        sizes: Sequence[float] = PRIOR_SCALES
        reach = _trust_region(every)
        refused = 0
        for number in range(rounds):
            campaign = self.about(coefficients, mean, wanted)
            now = float(campaign.energy.sum())
            if best is not None and not now < least:
                refused += 1
                if (
                    now - least < max(RELATIVE_TOLERANCE * now, CHANCE_CHI2)
                    or refused == MAX_STEP_CUTS
                ):
                    break
                step = 0.3 * step
                mean = best[0] + step
                continue
            settled = least - now < max(RELATIVE_TOLERANCE * now, CHANCE_CHI2)
            refused = 0
            least, best = now, (mean, campaign)
            if settled:
                break
            target = compute_score(campaign, coefficients, mean, sizes)
            if number and self._cannot_improve(target, coefficients):
                break
            sizes, step = (target.prior_scale,), target.mean - mean
            step = within(step, reach)
            mean = mean + step
        assert best is not None
        mean, campaign = best
        found = compute_score(campaign, coefficients, mean)
        # The last step was not tried: stay at the solution.
        off = found.leave_one_out_means - found.mean
        if all(c.scales_with_effect for c in every):
            A, b = campaign.normal_equations(coefficients)
            gained = 2.0 * np.einsum("rp,rp->r", b, off) - np.einsum("rp,rpq,rq->r", off, A, off)
            energy = campaign.energy - gained
        else:  # columns change with the amplitudes: evaluate exactly
            used = functions_used(self.base)
            energy = self.about(coefficients, (mean + off).T, used).energy
        found = replace(
            found,
            mean=mean,
            leave_one_out_means=mean + off,
            energy=energy,
            in_sample=float(campaign.energy.sum()),
        )
        energy_by_row, count = _energy_by_row(campaign)
        return replace(found, coefficients=every, energy_by_row=energy_by_row, count=count)

    def _cannot_improve(self, target: Score, coefficients: Sequence[Coefficient]) -> bool:
        """Whether the linear prediction of a fit is no better than the calibrated machine.

        Where columns change with the amplitudes, whether it gains too little in sample.
        """
        if not coefficients:
            return False
        if all(c.scales_with_effect for c in (*self.base, *coefficients)):
            return float(target.energy.sum()) > float(self.null.energy.sum())
        return self.null.in_sample - target.in_sample < MIN_GAIN_PER_VALUE * self.null.count

    def settled(self, found: Score) -> Score:
        """Score with one more step if it helps, all observations computed exactly at the fit."""
        fine = copy.copy(self)
        fine.machine = self.machine.without_linearisation()
        coefficients = found.coefficients[len(self.base) :]
        return fine.refined(coefficients, found.mean, 2)

    def quick(self, coefficients: Sequence[Coefficient]) -> float:
        """Minus the energy that a hypothesis removes: linear, in sample, without bounds."""
        n = len(self.base)
        A, b = self.campaign.normal_equations(coefficients)
        sd = np.array([c.sd for c in (*self.base, *coefficients)])
        center = np.array([c.center for c in coefficients])
        off = np.concatenate([np.zeros(n), center])
        A, b = A.sum(0), b.sum(0)
        right = b - A @ off
        whole = A + np.diag(sd**-2.0)
        own = whole[n:, n:] - whole[n:, :n] @ np.linalg.solve(whole[:n, :n], whole[:n, n:])
        left = right[n:] - whole[n:, :n] @ np.linalg.solve(whole[:n, :n], right[:n])
        return float(-(2.0 * b @ off - off @ A @ off) - left @ np.linalg.solve(own, left))

    def onwards(self, machine: Machine, taken: Score | None = None) -> Search:
        """Copy for a machine with further functions, linearised about ``null``.

        Args:
            machine: the same or an extended one.
            taken: fit whose coefficients become part of the base; None: keep base and ``null``.
        """
        found = copy.copy(self)
        found.machine = machine
        before, after = self.machine.functions, machine.functions
        found._linear = {o: p for o, p in self._linear.items() if before[o] == after[o]}
        if taken is not None:
            known = tuple(
                c if i < len(self.base) else replace(c, sd=c.sd * taken.prior_scale)
                for i, c in enumerate(taken.coefficients)
            )
            found.base, found.null = known, replace(taken, coefficients=known)
        found.campaign = found.about((), found.null.mean, wanted=None)
        return found

    def screened(self, coefficients: Sequence[Coefficient], size: float) -> Score:
        """Linear leave-one-run-out score about ``null``, at one prior scale."""
        start = np.concatenate([self.null.mean, np.zeros(len(coefficients))])
        return compute_score(self.campaign, coefficients, start, (size,))


def _amplitude_matrix(made: Mapping[str, Array], p: Products, r: int) -> Array:
    """Amplitudes (R, Q) of run r in the order of the functions of ``p``."""
    a = np.zeros((len(p.rows), len(p.functions)))
    for name, values in made.items():
        a[:, p.functions.index(name)] = values[r]
    return a


def _energy_by_row(campaign: CampaignProducts) -> tuple[dict[str, Array], float]:
    """Energy (runs, R) by observation, and the number of values in rows that are recorded."""
    every = [p for of_run in campaign.runs for p in of_run.values()]
    left = {
        o: np.stack([r[o].energy_without_nuisance for r in campaign.runs])
        for o in campaign.observations
    }
    return left, float(sum(p.count[p.energy != 0.0].sum() for p in every))
