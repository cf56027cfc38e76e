"""Score hypotheses on runs that were left out: all of them linearly, the best ones exactly."""

from __future__ import annotations

import copy
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm
from scipy.stats import t as student

from herringbone_sim.diagnosis.flexible import Surroundings
from herringbone_sim.diagnosis.products import (
    Block,
    Campaign,
    Coefficient,
    Products,
    moved,
    products,
)
from herringbone_sim.diagnosis.regression import LeftOut, Normal, leave_one_out, within
from herringbone_sim.diagnosis.threads import each

Array = NDArray[np.float64]
Amplitudes = Mapping[str, Mapping[str, Array]]
FARTHEST = 3.0  # standard deviations of its prior that a departure may reach
BENDINGS = 2  # rounds in which departures of a curve and its size settle
SIZES = (0.03, 0.1, 0.3, 1.0, 3.0)  # of an effect over its moderate one, half a decade apart


class Machine(Protocol):
    """What a machine brings: its observations, linear about any amplitudes of its functions."""

    base: tuple[Coefficient, ...]
    rows: Mapping[str, int]
    runs: int

    @property
    def functions(self) -> Mapping[str, tuple[str, ...]]:
        """Names of the functions of each observation."""

    def hypotheses(self) -> list[Hypothesis]:
        """Every effect at every place with every option that functions can carry."""

    def proposals(self, amplitudes: Amplitudes, known: Score) -> tuple[Machine, list[Hypothesis]]:
        """Hypotheses that the residual suggests beyond the catalogue, such as a damaged tooth.

        Args:
            amplitudes: of the effects found so far; the residual is what they leave.
            known: fit from which ``amplitudes`` were taken.

        Returns:
            A machine extended by the functions of the new hypotheses, or itself if there are none,
            and the new hypotheses.
        """

    def tried(
        self, ranked: Sequence[tuple[Hypothesis, Array]], known: Score
    ) -> list[tuple[float, Hypothesis, Array]]:
        """Hypotheses measured at a size of theirs, where nothing linear explains a gap.

        Args:
            ranked: hypotheses with their linear fits, best first.
            known: fit without any of them.

        Returns:
            squares left, hypothesis, where a fit starts (known coefficients first), best first.
        """

    def finely(self) -> Machine:
        """The same, all its observations formed about the amplitudes themselves."""

    def surroundings(self, observation: str, r: int, block: Block) -> Surroundings:
        """What is measured about the rows of a block of run r."""

    def cycles(self, observation: str, r: int) -> Array:
        """(n,) cycles since the start of run r, of the same samples."""

    def linear(self, amplitudes: Amplitudes) -> tuple[str, ...]:
        """Observations whose residual is linear in the functions as far as these amplitudes."""

    def blocks(
        self,
        amplitudes: Amplitudes,
        wanted: Mapping[str, Sequence[str]] | None,
        observations: Sequence[str],
    ) -> list[dict[str, Block]]:
        """Some observations of all runs; ``wanted`` restricts the columns."""


@dataclass(frozen=True)
class Hypothesis:
    """An effect with its options at a place.

    Attributes:
        effect, options: as in the catalogue.
        locus: (mesh, planet, side), or whatever the machine tells places by.
        coefficients: to fit.
        mains: how many of them, the first ones, are the effect's own parameters.
        maker: what a machine needs to make it again for other runs.
        removes: squares that it removes about its coefficients' centres, where it is so far from
            linear that the machine has measured it; None: the linear screen tells.
        known_mean: values of all coefficients known before it, at which it removes them.
    """

    effect: str
    options: tuple[tuple[str, object], ...]
    locus: Hashable
    coefficients: tuple[Coefficient, ...]
    mains: int
    maker: Any = None
    removes: float | None = None
    known_mean: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        bent = [replace(c, departs=self.mains) for c in self.coefficients[self.mains :]]
        object.__setattr__(self, "coefficients", (*self.coefficients[: self.mains], *bent))


@dataclass(frozen=True)
class Score:
    """How well a set of coefficients predicts.

    Attributes:
        coefficients: the tolerances first.
        mean: (p,) of all runs.
        covariance: (p, p) posterior, for noise as it was taken.
        left_out: (runs, p) means without one run each.
        energy: (runs,) whitened squares that are left of runs predicted by the others.
        in_sample: whitened squares left with all runs.
        log_density: log predictive density of runs left out.
        size: of the prior.
        rows: left in sample by observation: (runs, R).
        count: whitened values of the rows that are there.
    """

    coefficients: tuple[Coefficient, ...]
    mean: Array
    covariance: Array
    left_out: Array
    energy: Array
    in_sample: float
    log_density: float
    size: float
    rows: Mapping[str, Array]
    count: float = 0.0

    def spread(self) -> Array:
        """(p, p) covariance with what differs from run to run: the jackknife over runs.

        Noise is white, what a curve misses is not; the jackknife is widened as Student's
        distribution is for so few runs.
        """
        runs = len(self.left_out)
        if runs < 2:
            return self.covariance
        off = self.left_out - self.left_out.mean(axis=0)
        wide = float(student.ppf(0.95, runs - 1) / norm.ppf(0.95)) ** 2
        jackknife: Array = wide * (runs - 1) / runs * off.T @ off
        return self.covariance + jackknife


def scored(
    campaign: Campaign,
    coefficients: Sequence[Coefficient],
    mean: Array | None = None,
    sizes: Sequence[float] = SIZES,
) -> Score:
    """Score about some mean, at the size of the prior that predicts best."""
    every = (*campaign.base, *coefficients)
    A, b = campaign.normal(coefficients)
    n = len(campaign.base)
    center = np.array([c.center for c in every])
    # About the centre of the prior: squares left there are those at ``mean`` less the step.
    off = center - (np.zeros(len(every)) if mean is None else mean)
    energy = campaign.energy - _fall(A, b, off)
    b = b - A @ off
    prior, bound = np.array([c.sd for c in every]), np.array([c.bound for c in every])
    best: tuple[float, LeftOut, float, Array] | None = None
    sized = np.array([i >= n and c.sized for i, c in enumerate(every)])
    reach = _reach(every)
    for size in sizes if sized.any() else (1.0,):
        sd = prior * np.where(sized, size, 1.0)
        found = leave_one_out(Normal(A, b, sd, bound, reach))
        density = float(found.log_density.sum())
        if best is None or density > best[0]:
            best = density, found, size, sd
    assert best is not None
    density, found, size, sd = best
    bent = np.array([c.departs > 0 for c in every])
    for _ in range(BENDINGS if bent.any() else 0):
        sd = np.where(bent, prior * _own_size(every, center + found.whole.mean), sd)
        found = leave_one_out(Normal(A, b, sd, np.where(bent, FARTHEST * sd, bound), reach))
        density = float(found.log_density.sum())
    whole = found.whole
    return Score(
        every,
        center + whole.mean,
        whole.covariance,
        center + found.means,
        energy - found.fall,
        float(np.sum(energy - _fall(A, b, whole.mean))),
        density - 0.5 * float(energy.sum()),
        size,
        {},
    )


def _reach(coefficients: Sequence[Coefficient]) -> Array:
    """(p,) how far columns hold: as far as the prior where they change with the amplitudes."""
    return np.array([np.inf if c.sized else c.sd for c in coefficients])


def _own_size(coefficients: Sequence[Coefficient], mean: Array) -> Array:
    """(p,) size of the effect that each coefficient belongs to, over its moderate one."""
    found, size = np.ones(len(mean)), 1.0
    for i, c in enumerate(coefficients):
        if c.departs and not coefficients[i - 1].departs:
            own = range(i - c.departs, i)
            size = max(abs(mean[j]) / coefficients[j].sd for j in own)
        if c.departs:
            found[i] = size
    return np.maximum(found, SIZES[0] ** 2)


def _fall(A: Array, b: Array, step: Array) -> Array:
    """(runs,) squares that a step takes off."""
    fall: Array = 2.0 * b @ step - np.einsum("i,rij,j->r", step, A, step)
    return fall


def amplitudes(
    coefficients: Sequence[Coefficient], mean: Array, runs: int, rows: Mapping[str, int]
) -> dict[str, dict[str, Array]]:
    """Amplitudes (runs, rows) of all functions that coefficients use."""
    found: dict[str, dict[str, Array]] = {}
    for c, value in zip(coefficients, mean, strict=True):
        for o, part in c.parts.items():
            of = found.setdefault(o, {})
            for row, f, w in part.entries:
                a = of.setdefault(f, np.zeros((runs, rows[o])))
                a[:, row] += value * w
    return found


def wanted_of(coefficients: Sequence[Coefficient]) -> dict[str, list[str]]:
    """Functions that coefficients use, by observation."""
    found: dict[str, dict[str, None]] = {}
    for c in coefficients:
        for o, part in c.parts.items():
            found.setdefault(o, {}).update(dict.fromkeys(part.functions))
    return {o: list(names) for o, names in found.items()}


ROUNDS = 20
WORTH = 0.02  # squares a value: an effect of a detectability of one on two rows in a hundred
SETTLED = 1e-4  # of the squares left: less between two rounds is nothing,
REFUSED = 4  # steps one after the other, the last one of a hundredth of the first
LIKELIER = 10.0  # and so are as many squares: 150 times as likely, among a thousand hypotheses


class Search:
    """The hypotheses of one campaign.

    Args:
        machine: with its runs.
        noise: (runs, R) by observation: noise over what the machine takes it for; 1 where it is
            left out.
        start: (p,) tolerances to start from.
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
        self.campaign: Campaign

    def about(
        self,
        coefficients: Sequence[Coefficient],
        mean: Array,
        wanted: Mapping[str, Sequence[str]] | None,
    ) -> Campaign:
        """Products of all observations about a solution, linear ones from products at zero."""
        machine, every = self.machine, (*self.base, *coefficients)
        made = amplitudes(every, mean, self.runs, self.rows)
        fixed = machine.linear(made)
        for o in fixed:
            if o not in self._linear:
                blocks = self.blocks({}, None, (o,))
                self._linear[o] = each(products, [b[o] for b in blocks if o in b])
        others = tuple(o for o in machine.functions if o not in fixed)
        blocks = self.blocks(made, wanted, others)
        found = each(lambda of_run: {o: products(b) for o, b in of_run.items()}, blocks)
        for o in fixed:
            for r, p in enumerate(self._linear[o]):
                found[r][o] = moved(p, _matrix(made.get(o, {}), p, r))
        return Campaign(found, self.base)

    def blocks(
        self,
        amplitudes: Amplitudes,
        wanted: Mapping[str, Sequence[str]] | None,
        observations: Sequence[str],
    ) -> list[dict[str, Block]]:
        """Those of the machine with noise as it was found."""
        made = self.machine.blocks(amplitudes, wanted, observations)
        return [
            {
                o: replace(b, sigma=b.sigma * self.noise[o][r]) if o in self.noise else b
                for o, b in of_run.items()
            }
            for r, of_run in enumerate(made)
        ]

    def refined(
        self, coefficients: Sequence[Coefficient], start: Array, rounds: int = ROUNDS
    ) -> Score:
        """Gauss-Newton with the exact observations, then the score about the solution."""
        every = (*self.base, *coefficients)
        wanted = wanted_of(every)
        mean, least = start.copy(), np.inf
        step = np.zeros_like(mean)
        best: tuple[Array, Campaign] | None = None
        sizes: Sequence[float] = SIZES
        reach = _reach(every)
        refused = 0
        for number in range(rounds):
            campaign = self.about(coefficients, mean, wanted)
            now = float(campaign.energy.sum())
            if best is not None and not now < least:
                refused += 1
                if now - least < max(SETTLED * now, LIKELIER) or refused == REFUSED:
                    break
                step = 0.3 * step
                mean = best[0] + step
                continue
            settled = least - now < max(SETTLED * now, LIKELIER)
            refused = 0
            least, best = now, (mean, campaign)
            if settled:
                break
            target = scored(campaign, coefficients, mean, sizes)
            if number and self._promises_nothing(target, coefficients):
                break
            sizes, step = (target.size,), target.mean - mean
            step = within(step, reach)
            mean = mean + step
        assert best is not None
        mean, campaign = best
        found = scored(campaign, coefficients, mean)
        if not all(c.sized for c in every):
            # Where columns change, no further than what was tried.
            left_out = mean + (found.left_out - found.mean)
            exact = self.about(coefficients, left_out.T, wanted_of(self.base)).energy
            tried = float(campaign.energy.sum())
            found = replace(found, mean=mean, left_out=left_out, energy=exact, in_sample=tried)
        rows, count = _rows_left(campaign)
        return replace(found, coefficients=every, rows=rows, count=count)

    def _promises_nothing(self, target: Score, coefficients: Sequence[Coefficient]) -> bool:
        """Whether a fit goes nowhere even where everything is as linear as where it stands.

        It predicts no more than none does; where columns change with the amplitudes that says
        little, and it must take off what is worth explaining.
        """
        if not coefficients:
            return False
        if all(c.sized for c in (*self.base, *coefficients)):
            return float(target.energy.sum()) > float(self.null.energy.sum())
        return self.null.in_sample - target.in_sample < WORTH * self.null.count

    def settled(self, found: Score) -> Score:
        """A score with every observation formed about the solution itself, none linear."""
        fine = copy.copy(self)
        fine.machine = self.machine.finely()
        coefficients = found.coefficients[len(self.base) :]
        return fine.refined(coefficients, found.mean, 1)

    def quick(self, coefficients: Sequence[Coefficient]) -> float:
        """Squares that a hypothesis takes off (negative), in sample and without bounds."""
        n = len(self.base)
        A, b = self.campaign.normal(coefficients)
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
        """The same with further functions of the machine, on top of what was found before."""
        found = copy.copy(self)
        found.machine = machine
        before, after = self.machine.functions, machine.functions
        found._linear = {o: p for o, p in self._linear.items() if before[o] == after[o]}
        if taken is not None:
            known = tuple(
                c if i < len(self.base) else replace(c, sd=c.sd * taken.size)
                for i, c in enumerate(taken.coefficients)
            )
            found.base, found.null = known, replace(taken, coefficients=known)
        found.campaign = found.about((), found.null.mean, wanted=None)
        return found

    def screened(self, coefficients: Sequence[Coefficient], size: float) -> Score:
        """The linear score about the calibrated machine, at one size of the prior."""
        start = np.concatenate([self.null.mean, np.zeros(len(coefficients))])
        return scored(self.campaign, coefficients, start, (size,))


def _matrix(made: Mapping[str, Array], p: Products, r: int) -> Array:
    """Amplitudes (R, Q) of a run."""
    a = np.zeros((len(p.rows), len(p.functions)))
    for name, values in made.items():
        a[:, p.functions.index(name)] = values[r]
    return a


def _rows_left(campaign: Campaign) -> tuple[dict[str, Array], float]:
    """Squares left by observation (runs, R), and the values of rows that are there."""
    every = [p for of_run in campaign.runs for p in of_run.values()]
    left = {
        o: np.stack([r[o].cleared_energy for r in campaign.runs]) for o in campaign.observations
    }
    return left, float(sum(p.count[p.energy != 0.0].sum() for p in every))
