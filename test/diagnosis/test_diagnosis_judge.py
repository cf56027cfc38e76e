"""Probabilities that the judge gives to explanations, and the fit of its weights."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from herringbone_sim.diagnosis.evidence import Candidate, Evidence
from herringbone_sim.diagnosis.judge import NAMES, chances, numbers
from herringbone_sim.diagnosis.judge_weights import (
    LabelledCampaign,
    are_true,
    fit,
    fit_labelled,
    log_loss,
)
from herringbone_sim.errors import AnalysisError


def some_evidence(rng):
    """Numbers of a campaign of no meaning: chi2 fall with effects and with pairs."""
    count, gap = 1e4, 10.0 ** rng.uniform(-3.0, 1.0)
    singles = sorted(count * (1.0 + gap * rng.uniform(0.02, 1.0, 3) ** 2))
    pairs = [singles[0] - count * gap * u for u in sorted(rng.uniform(0.0, 0.02, 2))[::-1]]
    left = {(): count * (1.0 + gap)}
    left |= {(e,): x for e, x in zip("abc", singles, strict=True)}
    left |= {("a", e): x for e, x in zip("bc", pairs, strict=True)}
    candidates = []
    for effects, chi2 in left.items():
        other = {name: rng.uniform(0.0, 2.0) for name in ("in_sample", "size", "strain", "worst")}
        known = {"effects": effects, "places": ("",) * len(effects), "chi2": chi2}
        candidates.append(Candidate(**{**other, **known}))
    remains = {"none": 0.9 * gap, "single": rng.uniform(0.0, 0.1) * gap, "pair": 0.0}
    remains = {name: count * value for name, value in remains.items()}
    return Evidence(count, tuple(candidates), remains, {})


def test_a_second_effect_that_takes_little_is_believed_less():
    """All else equal, with the weights of the package; little of what the pair takes in sample."""

    def pair_given(second):
        """Probability of a pair whose second effect takes a share of what the pair takes."""
        rest = {"size": 1, "strain": 0.1, "worst": 1.01}
        chi2 = {(): 3.0e5, ("a",): 1.05e5, ("a", "b"): 1.0e5}
        in_sample = {(): 3.0e5, ("a",): 1.0e5 + 2.0e5 * second, ("a", "b"): 1.0e5}
        candidates = [Candidate(e, ("",) * len(e), chi2[e], in_sample[e], **rest) for e in chi2]
        remains = {"none": 2.0e5, "single": 2.0e3, "pair": 0.0}
        given = chances(Evidence(1.0e5, tuple(candidates), remains, {}))
        return sum(c.probability for c in given if c.effects == ("a", "b"))

    p = np.array([pair_given(second) for second in (0.002, 0.02, 0.2)])
    odds = p / (1.0 - p)
    assert np.all(np.diff(odds) > 0.0)
    assert odds[-1] > 2.0 * odds[0]


def test_what_is_lost_where_runs_are_left_out_is_believed_less():
    """Two effects that leave as much of left-out runs: one fits all runs no better than that."""

    def probability(in_sample):
        rest = {"size": 1, "strain": 0.1, "worst": 1.01}
        losses = {(): (3.0e5, 2.9e5), ("a",): (1.2e5, in_sample), ("b",): (1.2e5, 1.0e5)}
        candidates = [Candidate(e, ("",) * len(e), *losses[e], **rest) for e in losses]
        remains = {"none": 2.0e5, "single": 2.0e3}
        given = chances(Evidence(1.0e5, tuple(candidates), remains, {}))
        return next(c.probability for c in given if c.effects == ("a",))

    assert probability(1.19e5) > 1.2 * probability(1.0e5)


def test_evidence_that_is_not_finite_gives_no_probabilities():
    """A report with none of them would say nothing, and look like one."""
    evidence = some_evidence(np.random.default_rng(0))
    spoilt = replace(evidence.candidates[1], chi2=np.nan)
    evidence = replace(evidence, candidates=(evidence.candidates[0], spoilt))
    with pytest.raises(AnalysisError, match="evidence must be finite, got nan"):
        chances(evidence)


def drawn(rng, evidence, weights):
    """A truth with the probabilities of some weights."""
    every, table = numbers(evidence)
    score = table @ weights
    p = np.exp(score - score.max())
    chosen = every[rng.choice(len(p), p=p / p.sum())]
    return ("unknown",) if chosen is None else chosen.effects


def told(given, truth):
    """Logarithm of the probability of the truth."""
    return np.log(sum(c.probability for c in given if c.effects == truth))


def test_fitted_probabilities_come_true():
    rng = np.random.default_rng(8)
    true = rng.normal(size=len(NAMES))
    true[0] = -1.0  # less left is more probable
    practice = [some_evidence(rng) for _ in range(2400)]
    weights = fit(practice, [drawn(rng, e, true) for e in practice], 1e-3)
    said, came, lost = [], [], []
    for _ in range(800):
        evidence = some_evidence(rng)
        truth = drawn(rng, evidence, true)
        given = chances(evidence, weights)
        assert sum(c.probability for c in given) == pytest.approx(1.0)
        said += [c.probability for c in given]
        came += [c.effects == truth for c in given]
        lost.append(told(chances(evidence, true), truth) - told(given, truth))
    assert np.mean(lost) < 0.02  # the truth tells hardly more
    said, came = np.array(said), np.array(came)
    edges = np.quantile(said, np.linspace(0.0, 1.0, 7))
    for low, high in pairwise(edges):
        of = (said >= low) & (said <= high)
        spread = np.sqrt(np.mean(said[of] * (1.0 - said[of])) / of.sum())
        assert abs(said[of].mean() - came[of].mean()) < 4.0 * spread + 0.01


def test_a_truth_that_was_never_tried_teaches_nothing():
    rng = np.random.default_rng(9)
    evidence = [some_evidence(rng) for _ in range(5)]
    assert not fit(evidence, [("z",)] * 5, 1.0).any()


def test_a_pair_of_which_one_effect_was_tried_is_that_with_something_beside_it():
    """Its probability comes true as the others do."""
    rng = np.random.default_rng(10)
    evidence = [some_evidence(rng) for _ in range(400)]
    every, table = numbers(evidence[0])
    assert [e.effects for e in every if not e.whole] == [(x, "unknown") for x in "abc"]
    assert table.shape == (len(every), len(NAMES))
    true = are_true(every, ("c", "z"))
    assert [e.effects for e, on in zip(every, true, strict=True) if on] == [("c", "unknown")]
    tried = are_true(every, ("b", "a"))
    assert [e.effects for e, on in zip(every, tried, strict=True) if on] == [("a", "b")]
    assert not are_true(every, ("y", "z")).any()
    truths = [("a", "z") if i % 4 == 0 else ("a",) for i in range(len(evidence))]
    weights = fit(evidence, truths, 1e-3)
    beside = [told_of(chances(e, weights), ("a", "unknown")) for e in evidence]
    assert np.mean(beside) == pytest.approx(0.25, abs=0.02)


def told_of(given, effects):
    """Probability of an explanation."""
    return sum(c.probability for c in given if c.effects == effects)


def test_no_weights_near_those_of_a_fit_are_better():
    """Penalised log loss in every direction, by differences; some campaigns with two truths."""
    rng = np.random.default_rng(3)
    labelled = [
        LabelledCampaign(rng.normal(size=(9, len(NAMES))), np.arange(9) < 1 + i % 2)
        for i in range(60)
    ]
    for penalty in (0.01, 1.0, 100.0):
        best = fit_labelled(labelled, penalty)

        def loss(w, penalty=penalty):
            return log_loss(labelled, w) + 0.5 * penalty * w @ w

        step = 1e-4
        for direction in np.eye(len(NAMES)):
            ahead, behind = (loss(best + sign * step * direction) for sign in (1.0, -1.0))
            assert abs(ahead - behind) / (2.0 * step) < 1e-3
            assert ahead + behind > 2.0 * loss(best)
