"""All hypotheses on a campaign, scored: none, single effects, pairs, and what is left of them."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.diagnosis.flexible import Predictable, predictable
from herringbone_sim.diagnosis.products import cleared
from herringbone_sim.diagnosis.search import (
    WORTH,
    Hypothesis,
    Machine,
    Score,
    Search,
    amplitudes,
)

Array = NDArray[np.float64]

SCREENED = 6  # places of an effect that are scored linearly on runs left out
REFINED = 6  # hypotheses that are fitted exactly
PLACES = 2  # of them with the same effect
PAIRED = 3  # second effects that are fitted exactly
SAME = 0.01  # of a gap: less between two explanations is no reason for the larger one
FEW = 2  # where nothing is worth explaining
ALIKE = 0.25  # of the rows of an observation have no more than their noise, at the least
FAR_OFF = 1.5  # squares a value: a linear fit that leaves more does not hold, an exact one is
# short of an effect
BLOCK_CYCLES = 6.0  # longer than what a mesh remembers


@dataclass(frozen=True)
class Found:
    """A hypothesis with its fit.

    Attributes:
        hypotheses: one, or two of a pair.
        score: of the fit.
        search: where it was found, whose machine has all its functions; None for the first one.
    """

    hypotheses: tuple[Hypothesis, ...]
    score: Score
    search: Search | None = None

    @property
    def energy(self) -> float:
        return float(self.score.energy.sum())


@dataclass(frozen=True)
class Examined:
    """Scores of a campaign.

    Attributes:
        count: whitened values.
        counts: by observation.
        none: the calibrated machine.
        singles, pairs: best first.
        screened: least linear squares of each effect, those never fitted too.
        flexible: what a flexible regression explains of what is left, by observation, under none,
            the best single and the best pair.
        noise: (runs, R) by observation, over what it was taken for.
    """

    count: float
    counts: dict[str, float]
    none: Found
    singles: tuple[Found, ...]
    pairs: tuple[Found, ...]
    screened: dict[str, float]
    flexible: dict[str, dict[str, Predictable]]
    noise: Mapping[str, Array]


def examine(
    machine: Machine, say: Callable[[str], None] = lambda text: None, told: bool = True
) -> Examined:
    """Score every hypothesis on the runs of a machine.

    Args:
        told: whether the noise is what the machine takes it for; otherwise what nothing measured
            predicts of the calibrated machine's residual is noise too.
    """
    say("calibration")
    search = Search(machine)
    none = Found((), search.settled(search.null))
    left = _left(search, none)
    if not told:
        noise = {o: _noise(p) for o, p in left.items()}
        left = {o: p.for_noise(noise[o]) for o, p in left.items()}
        search = Search(machine, noise, none.score.mean)
        none = Found((), search.settled(search.null))
    catalogue = machine.hypotheses()
    say(f"{len(catalogue)} hypotheses")
    search, ranked = _ranked(search, catalogue, None)
    counts = {
        o: float(sum(r[o].count[_alive(r[o].energy)].sum() for r in search.campaign.runs))
        for o in search.campaign.observations
    }
    count = sum(counts.values())
    say("fits")
    gain = none.energy - min((r[0] for r in ranked), default=none.energy)
    idle = max(gain, _total(left)) < WORTH * count
    singles = _fits(search, ranked, FEW if idle else REFINED, PLACES)
    say("what is left")
    flexible = {"none": left}
    pairs: tuple[Found, ...] = ()
    if singles:
        first = _simplest(none, singles)
        flexible["single"] = _left(search, singles[0], left)
        # What is short, as the contact of a tooth, nothing beside it predicts.
        far_off = first.score.in_sample > FAR_OFF * count
        if far_off or _total(flexible["single"]) > WORTH * count:
            say("pairs")
            pairs = _pairs(search, catalogue, first)
            if pairs:
                flexible["pair"] = _left(search, pairs[0], left)
            second = _alone(search, singles, pairs)
            if second is not None and second.energy < singles[0].energy:
                singles = (second, *singles)
                flexible["single"] = _left(search, second, left)
            elif not (pairs and _astray(first, pairs[0], flexible)):
                second = None
            if second is not None and _total(flexible["pair"]) > WORTH * count:
                more = _pairs(search, catalogue, second)
                pairs = tuple(sorted((*pairs, *more), key=lambda f: f.energy))
                flexible["pair"] = _left(search, pairs[0], left)
    screened: dict[str, float] = {}
    for value, one, _ in ranked:
        screened.setdefault(one.effect, value)
    return Examined(count, counts, none, singles, pairs, screened, flexible, search.noise)


def _noise(found: Predictable) -> Array:
    """(runs, R) noise over what it was taken for: what can't be predicted, less what can.

    Where half can be, the rest need not be noise. Sensors of a kind are alike: what stands out in
    a few rows alone is no noise.
    """
    known = found.count[0] > 0.0
    share = (2.0 * found.left - found.energy) / np.maximum(found.count, 1.0)
    most = np.ones((len(share), 1))
    if known.any():
        most = np.quantile(share[:, known], ALIKE, axis=1)[:, None]
    return np.asarray(np.sqrt(np.clip(share, 1.0, np.maximum(most, 1.0))))


def _alive(energy: Array) -> NDArray[np.bool_]:
    alive: NDArray[np.bool_] = energy != 0.0
    return alive


Ranked = list[tuple[float, Hypothesis, Array]]  # squares left, hypothesis, where a fit starts


def _simplest(none: Found, singles: Sequence[Found]) -> Found:
    """The single with the fewest coefficients of those that explain the same."""
    best = singles[0].energy
    near = [f for f in singles if f.energy - best < SAME * (none.energy - best)]
    return min(near, key=lambda f: len(f.score.coefficients), default=singles[0])


def _total(left: Mapping[str, Predictable]) -> float:
    """Whitened squares that a flexible regression predicts of what is left."""
    return sum(p.predicted for p in left.values())


def _ranked(
    search: Search, catalogue: Sequence[Hypothesis], taken: Score | None
) -> tuple[Search, Ranked]:
    """Scores on top of what was taken, best first, with what the residual proposes.

    Linear ones; where nothing linear explains it, those that were tried, and few others.
    """
    known = search.null if taken is None else taken
    made = amplitudes(known.coefficients, known.mean, search.runs, search.rows)
    machine, proposed = search.machine.proposals(made, known)
    search = search.onwards(machine, taken)
    quick = sorted(((search.quick(one.coefficients), i) for i, one in enumerate(catalogue)))
    chosen: list[Hypothesis] = []
    per: dict[str, int] = {}
    for _, i in quick:
        one = catalogue[i]
        if per.get(one.effect, 0) < SCREENED:
            per[one.effect] = per.get(one.effect, 0) + 1
            chosen.append(one)
    found: Ranked = []
    for one in (*chosen, *proposed):
        score = search.screened(one.coefficients, 0.3)
        left, start = float(score.energy.sum()), score.mean
        if one.removes is not None:
            left = float(search.null.energy.sum()) - one.removes
            start = np.array([*one.known_mean, *(c.center for c in one.coefficients)])
        found.append((left, one, start))
    found.sort(key=lambda f: f[0])
    if found and found[0][0] > FAR_OFF * search.null.count:
        tried = search.machine.tried([(one, start) for _, one, start in found], search.null)
        known_better = {id(one) for _, one, _ in tried}
        rest = [f for f in found if id(f[1]) not in known_better]
        found = [*tried, *(rest[:FEW] if tried else rest)]
    return search, found


def _fits(search: Search, ranked: Ranked, most: int, places: int) -> tuple[Found, ...]:
    fits: list[Found] = []
    per: dict[str, int] = {}
    for _, one, start in ranked:
        if len(fits) == most:
            break
        if per.get(one.effect, 0) < places:
            per[one.effect] = per.get(one.effect, 0) + 1
            fits.append(Found((one,), search.settled(search.refined(one.coefficients, start))))
    return tuple(sorted(fits, key=lambda f: f.energy))


def _pairs(search: Search, catalogue: Sequence[Hypothesis], first: Found) -> tuple[Found, ...]:
    """The best single with the best second effects on what it leaves."""
    own = first.hypotheses[0]
    others = [h for h in catalogue if (h.effect, h.locus) != (own.effect, own.locus)]
    then, ranked = _ranked(search, others, first.score)
    different = [r for r in ranked if r[1].effect != own.effect]
    fits = _fits(then, different, PAIRED, 1)
    return tuple(Found((own, *f.hypotheses), f.score, then) for f in fits)


def _alone(search: Search, singles: Sequence[Found], pairs: Sequence[Found]) -> Found | None:
    """The second effect of the best pair by itself; None where it can't be formed so.

    It need not have been among the few that were fitted. Events and parts that were proposed by
    what the first effect left can't be formed without it.
    """
    if not pairs:
        return None
    one = pairs[0].hypotheses[1]
    if one.maker is not None:
        return None
    key = one.effect, one.options, one.locus
    for f in singles:
        if (f.hypotheses[0].effect, f.hypotheses[0].options, f.hypotheses[0].locus) == key:
            return f
    start = np.concatenate([search.null.mean, pairs[0].score.mean[-len(one.coefficients) :]])
    return Found((one,), search.settled(search.refined(one.coefficients, start)))


def _astray(first: Found, pair: Found, left: Mapping[str, Mapping[str, Predictable]]) -> bool:
    """Whether a second effect takes much of what the first leaves, and half is predicted still.

    The first one was fitted without it, and is far from where it would be beside it.
    """
    half = 0.5 * _total(left["single"])
    return first.energy - pair.energy > half and _total(left["pair"]) > half


def _left(
    search: Search, found: Found, of_none: Mapping[str, Predictable] | None = None
) -> dict[str, Predictable]:
    """What a flexible regression explains of what a hypothesis leaves.

    Args:
        of_none: of the calibrated machine, which holds where the hypothesis changes nothing.
    """
    search = found.search or search
    machine = search.machine.finely()
    fine = copy.copy(search)
    fine.machine = machine
    every = found.score.coefficients
    made = amplitudes(every, found.score.mean, search.runs, search.rows)
    result = {}
    for o in machine.functions:
        if of_none is not None and o in of_none and o not in made:
            result[o] = of_none[o]
            continue
        blocks = fine.blocks(made, {}, (o,))
        if not all(o in b for b in blocks):
            continue
        own = [b[o] for b in blocks]
        residuals, around, numbers = [], [], []
        for r, b in enumerate(own):
            at = b.at if b.at is not None else np.arange(len(b.residual))
            residuals.append(cleared(b))
            around.append(machine.surroundings(o, r, b))
            numbers.append((machine.cycles(o, r)[at] // BLOCK_CYCLES).astype(int))
        result[o] = predictable(residuals, around, numbers, own[0].independent)
    return result
