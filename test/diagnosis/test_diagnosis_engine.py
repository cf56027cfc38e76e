"""The diagnosis engine against dense linear algebra and references of its own kind."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from scipy.stats import multivariate_normal

from herringbone_sim.diagnosis import regression
from herringbone_sim.diagnosis.coefficients import CampaignProducts, Coefficient, Placement
from herringbone_sim.diagnosis.evidence import Candidate, Evidence
from herringbone_sim.diagnosis.examine import _less_noise, _noise_factors
from herringbone_sim.diagnosis.flexible import Predictable
from herringbone_sim.diagnosis.judge import NAMES, are_true, chances, fit, numbers
from herringbone_sim.diagnosis.machine import Hypothesis
from herringbone_sim.diagnosis.products import (
    Block,
    products,
    recentred,
    residual_without_nuisance,
)
from herringbone_sim.diagnosis.regression import Normal, leave_one_out, solve
from herringbone_sim.diagnosis.score import MAX_DEPARTURE_SD, compute_score
from herringbone_sim.errors import AnalysisError


def density(y, Phi, sd, mean=0.0):
    """log N(y; Phi mean, 1 + Phi sd^2 Phi') relative to log N(y; 0, 1)."""
    n = len(y)
    spread = np.eye(n) + Phi @ np.diag(sd**2) @ Phi.T
    center = Phi @ (np.zeros(Phi.shape[1]) + mean)
    of_model = multivariate_normal(center, spread).logpdf(y)
    return of_model - multivariate_normal(np.zeros(n), np.eye(n)).logpdf(y)


def problem(seed, most=12):
    """Phi, y, sd and bounds of a regression whose columns are correlated."""
    rng = np.random.default_rng(seed)
    p = rng.integers(1, most)
    mixing = np.eye(p) + rng.uniform(0.0, 2.0) * rng.normal(size=(p, p))
    Phi = rng.normal(size=(40, p)) @ mixing
    y = Phi @ rng.normal(size=p) + rng.normal(size=40)
    bound = np.where(rng.random(p) < 0.7, rng.uniform(0.05, 1.5, p), np.inf)
    return Phi, y, rng.uniform(0.3, 3.0, p), bound


def test_a_solution_whose_bounds_never_settle_is_not_taken_for_one(monkeypatch):
    """A solver that always ends outside: bound and free take turns for ever."""
    monkeypatch.setattr(regression, "_solved", lambda factor, right: np.full_like(right, 5.0))
    found = solve(np.eye(1), np.zeros(1), np.ones(1), np.ones(1))
    assert found.log_evidence == -np.inf
    assert (found.mean, found.covariance) == (0.0, 1.0)


@pytest.mark.parametrize("start", range(0, 100, 25))
def test_bounded_solutions_are_those_of_least_squares_in_a_box(start):
    held = 0
    for seed in range(start, start + 25):
        Phi, y, sd, bound = problem(seed)
        found = solve(Phi.T @ Phi, Phi.T @ y, sd, bound)
        tall, right = np.vstack([Phi, np.diag(1.0 / sd)]), np.append(y, np.zeros(len(sd)))
        expected = lsq_linear(tall, right, (-bound, bound), method="bvls", tol=1e-15).x
        np.testing.assert_allclose(found.mean, expected, rtol=0.0, atol=1e-9)
        held += np.sum(np.abs(expected) == bound)
    assert held > 10  # else the bounds are not tried


def test_the_evidence_is_the_density_of_the_data():
    for seed in range(20):
        Phi, y, sd, _ = problem(seed)
        found = solve(Phi.T @ Phi, Phi.T @ y, sd, np.full(len(sd), np.inf))
        assert found.log_evidence == pytest.approx(density(y, Phi, sd), rel=1e-10, abs=1e-8)
        spread = np.linalg.inv(Phi.T @ Phi + np.diag(sd**-2.0))
        np.testing.assert_allclose(found.covariance, spread, rtol=1e-7, atol=1e-10)


def test_the_evidence_with_coefficients_at_their_bounds_is_that_of_the_others():
    for seed in range(20):
        Phi, y, sd, bound = problem(seed)
        found = solve(Phi.T @ Phi, Phi.T @ y, sd, bound)
        held = np.abs(found.mean) == bound
        at = Phi[:, held] @ found.mean[held]
        fixed = y @ at - 0.5 * at @ at - 0.5 * np.sum((found.mean[held] / sd[held]) ** 2)
        rest = density(y - at, Phi[:, ~held], sd[~held]) if not held.all() else 0.0
        assert found.log_evidence == pytest.approx(rest + fixed, rel=1e-10, abs=1e-8)
        assert not found.covariance[held].any()


def test_runs_left_out_are_predicted_by_a_regression_on_the_others():
    rng = np.random.default_rng(5)
    Phi, y = rng.normal(size=(4, 15, 3)), rng.normal(size=(4, 15))
    y += Phi @ [0.5, -1.0, 0.2]
    sd, free = np.array([0.5, 1.0, 2.0]), np.full(3, np.inf)
    A, b = np.einsum("rni,rnj->rij", Phi, Phi), np.einsum("rni,rn->ri", Phi, y)
    found = leave_one_out(Normal(A, b, sd, free))
    for r in range(4):
        others = np.arange(4) != r
        X, z = Phi[others].reshape(-1, 3), y[others].ravel()
        spread = np.linalg.inv(X.T @ X + np.diag(sd**-2.0))
        mean = spread @ X.T @ z
        np.testing.assert_allclose(found.means[r], mean, atol=1e-9)
        fall = y[r] @ y[r] - np.sum((y[r] - Phi[r] @ mean) ** 2)
        assert found.fall[r] == pytest.approx(fall, abs=1e-8)
        roots, turns = np.linalg.eigh(spread)
        predicted = density(y[r], Phi[r] @ turns, np.sqrt(roots), turns.T @ mean)
        assert found.log_density[r] == pytest.approx(predicted, abs=1e-8)


def a_block(seed, name="law", run="a", n=25, rows=2, functions=("f", "g", "h"), kinds=(2, 2)):
    """A random block: nuisances of each row, and some shared by all rows."""
    rng = np.random.default_rng(seed)
    Q, (S, T) = len(functions), kinds
    return Block(
        name,
        run,
        tuple(f"row {i}" for i in range(rows)),
        rng.normal(size=(n, rows)),
        rng.uniform(0.5, 2.0, (n, rows)),
        tuple(functions),
        rng.normal(size=(n, rows, Q)),
        rng.normal(size=(n, rows, S)),
        rng.uniform(0.1, 1.0, (rows, S)),
        rng.normal(size=(T, rows, Q)),
        rng.uniform(0.1, 1.0, T),
        independent_share=0.4,
    )


def dense(block):
    """Covariance of the residual with all nuisances, rows one after the other, and its samples."""
    n, rows, _ = block.columns.shape
    spread = np.diag((block.sigma.T.ravel()) ** 2 / block.independent_share)
    for row in range(rows):
        at, N = slice(row * n, (row + 1) * n), block.nuisance[:, row]
        spread[at, at] += N @ np.diag(block.nuisance_sd[row] ** 2) @ N.T
    shared = np.einsum("nrq,trq->trn", block.columns, block.shared).reshape(-1, rows * n)
    return spread + shared.T @ np.diag(block.shared_sd**2) @ shared


def column(block, coefficient, r):
    """(rows * n,) what a unit of a coefficient adds to the residual of run r."""
    found = np.zeros(block.residual.shape[::-1])
    part = coefficient.placements.get(block.observation)
    if part is not None:
        for row, f, weight in part.entries:
            found[row] += weight[r] * block.columns[:, row, block.functions.index(f)]
    return found.ravel()


def coefficients(rng, runs):
    """Two of the base and two of a hypothesis, over rows and observations with weights by run."""

    def one(name, **parts):
        made = {
            o: Placement(rows, functions, rng.normal(size=(runs, len(rows))))
            for o, (rows, functions) in parts.items()
        }
        return Coefficient(name, 1.0, np.inf, made)

    base = one("k", law=((0, 1), ("f", "f"))), one("m", balance=((0,), ("p",)))
    own = (
        one("d", law=((0, 0, 1), ("g", "h", "h")), balance=((0, 0), ("p", "q"))),
        one("e", balance=((0,), ("q",)), law=((1,), ("g",))),
    )
    return base, own


def test_normal_equations_are_those_of_the_marginal_likelihood():
    rng = np.random.default_rng(1)
    blocks = [
        {
            "law": a_block(10 * r, "law", f"run {r}", n=20 + 5 * r),
            "balance": a_block(10 * r + 1, "balance", f"run {r}", 15, 1, ("p", "q"), (0, 0)),
        }
        for r in range(3)
    ]
    base, own = coefficients(rng, len(blocks))
    made = [{o: products(b) for o, b in of_run.items()} for of_run in blocks]
    campaign = CampaignProducts(made, base)
    A, b = campaign.normal_equations(own)
    for r, of_run in enumerate(blocks):
        expected_A, expected_b, chi2 = 0.0, 0.0, 0.0
        for block in of_run.values():
            Phi = np.stack([column(block, c, r) for c in (*base, *own)], axis=1)
            y, inverse = block.residual.T.ravel(), np.linalg.inv(dense(block))
            expected_A = expected_A + Phi.T @ inverse @ Phi
            expected_b = expected_b + Phi.T @ inverse @ y
            chi2 += y @ inverse @ y
        np.testing.assert_allclose(A[r], expected_A, atol=1e-9)
        np.testing.assert_allclose(b[r], expected_b, atol=1e-9)
        assert campaign.chi2[r] == pytest.approx(chi2, abs=1e-9)


def test_what_nuisances_explain_is_cleared():
    block = a_block(3)
    white = np.linalg.inv(dense(block)) @ block.residual.T.ravel()
    expected = white.reshape(2, -1).T * block.sigma / block.independent_share
    np.testing.assert_allclose(residual_without_nuisance(block), expected, atol=1e-10)


def test_moved_products_are_those_of_the_block_about_the_amplitudes():
    block, a = a_block(4), np.random.default_rng(0).normal(size=(2, 3))
    there = replace(block, residual=block.residual - np.einsum("nrq,rq->nr", block.columns, a))
    found, expected = recentred(products(block), a), products(there)
    for name in ("G", "c", "chi2", "count", "cross", "cross_y"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=1e-10)


def test_noise_is_what_is_not_predictable_of_most_rows():
    """Eight rows: six at twice their noise, one that stands out, one of which half is foreseen."""
    count, chi2 = np.full((1, 8), 100.0), np.array([[4.0] * 6 + [100.0, 4.0]]) * 100.0
    left = chi2.copy()
    left[0, 7] = 0.5 * chi2[0, 7]
    found = _noise_factors(Predictable(chi2, left, count))
    np.testing.assert_allclose(found[0, :6], 2.0)
    assert found[0, 6] == pytest.approx(2.0)  # no more than rows of its kind
    assert found[0, 7] == 1.0


def test_noise_is_no_more_than_what_an_effect_leaves():
    """The calibrated machine left four times the noise, of which an effect takes three."""
    assumed = {"windows": np.full((2, 1), 2.0)}

    def left(chi2, predicted):
        values = np.full((2, 1), chi2)
        return {"windows": Predictable(values, values - predicted, np.full((2, 1), 1000.0))}

    found = _less_noise(assumed, left(250.0, 0.0))
    np.testing.assert_allclose(found["windows"], 1.0)
    found = _less_noise(assumed, left(500.0, 0.0))
    np.testing.assert_allclose(found["windows"], np.sqrt(2.0))
    assert _less_noise(assumed, left(1000.0, 0.0)) is None  # it leaves as much
    assert _less_noise(assumed, left(1500.0, 0.0)) is None  # noise is never more than assumed


def test_a_departure_stays_near_the_curve_it_departs_from():
    """A rival whose own parameter explains nothing can't close by its departure alone."""
    rng = np.random.default_rng(5)
    own, other = rng.normal(size=(2, 400))
    columns = np.stack([own, other], axis=1)[:, None, :]
    blocks = [
        Block(
            "law",
            f"{r}",
            ("row",),
            10.0 * other[:, None] + rng.normal(size=(400, 1)),
            np.ones((400, 1)),
            ("own", "other"),
            columns,
            np.zeros((400, 1, 0)),
            np.zeros((1, 0)),
            np.zeros((0, 1, 2)),
            np.zeros(0),
        )
        for r in range(3)
    ]
    campaign = CampaignProducts([{"law": products(b)} for b in blocks], ())
    part = {name: {"law": Placement((0,), (name,), np.ones((3, 1)))} for name in ("own", "other")}
    hypothesis = Hypothesis(
        "rival", (), "mass",
        (Coefficient("own", 1.0, np.inf, part["own"]),
         Coefficient("other", 0.25, np.inf, part["other"])), 1,
    )  # fmt: skip
    found = compute_score(campaign, hypothesis.coefficients)
    size = abs(found.mean[0])
    # Rounds in which both settle: within a third.
    assert abs(found.mean[1]) <= 1.33 * MAX_DEPARTURE_SD * 0.25 * size
    assert found.in_sample > 0.9 * campaign.chi2.sum()


def test_the_density_knows_what_a_run_does_not_tell_of_another():
    """A coefficient of which one run tells much and the other little, and which is zero.

    What the little run tells predicts the other one badly, which speaks against its own accuracy,
    not against the coefficient.
    """
    rng = np.random.default_rng(6)
    blocks = [
        Block(
            "law",
            name,
            ("row",),
            rng.normal(size=(400, 1)),
            np.ones((400, 1)),
            ("own",),
            size * rng.normal(size=(400, 1, 1)),
            np.zeros((400, 1, 0)),
            np.zeros((1, 0)),
            np.zeros((0, 1, 1)),
            np.zeros(0),
        )
        for name, size in (("much", 30.0), ("little", 0.03))
    ]
    campaign = CampaignProducts([{"law": products(b)} for b in blocks], ())
    own = Coefficient("own", 1.0, np.inf, {"law": Placement((0,), ("own",), np.ones((2, 1)))})
    found = compute_score(campaign, (own,), sizes=(1.0,))
    none = float(campaign.chi2.sum())
    assert found.loss == found.chi2.sum() > 10.0 * none
    assert none < replace(found, by_density=True).loss < none + 20.0


def test_squares_that_rounding_takes_count_as_they_are():
    """At the centre of the prior wild columns leave 1e30 squares, of which none can be told; about
    the fit, a value of one, 200 values leave 200 a run."""
    rng = np.random.default_rng(7)
    blocks = [
        Block(
            "law",
            str(r),
            ("row",),
            rng.normal(size=(200, 1)),
            np.ones((200, 1)),
            ("own",),
            1e14 * rng.normal(size=(200, 1, 1)),
            np.zeros((200, 1, 0)),
            np.zeros((1, 0)),
            np.zeros((0, 1, 1)),
            np.zeros(0),
        )
        for r in range(3)
    ]
    campaign = CampaignProducts([{"law": products(b)} for b in blocks], ())
    own = Coefficient("own", 1.0, np.inf, {"law": Placement((0,), ("own",), np.ones((3, 1)))})
    found = compute_score(campaign, (own,), np.ones(1), sizes=(1.0,))
    np.testing.assert_array_equal(found.chi2, campaign.chi2)
    assert found.in_sample == campaign.chi2.sum()
    assert replace(found, by_density=True).loss == pytest.approx(campaign.chi2.sum())


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

    shares = [pair_given(second) for second in (0.002, 0.02, 0.2)]
    assert shares == sorted(shares)
    assert shares[-1] > 2.0 * shares[0]


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


def test_products_of_columns_that_all_rows_share_are_those_taken_row_by_row() -> None:
    """Noise, own columns and residuals differ by row, nuisances and shared columns do not."""
    rng = np.random.default_rng(0)
    n, rows, q, s = 200, 3, 5, 2
    alike = np.array([True, False, True, True, False])
    columns = rng.normal(size=(n, rows, q))
    columns[:, :, alike] = columns[:, :1, alike]
    slow = np.repeat(rng.normal(size=(n, 1, s)), rows, axis=1)
    sigma = np.broadcast_to(rng.uniform(1.0, 2.0, rows), (n, rows))
    block = Block(
        "o",
        "run",
        ("a", "b", "c"),
        rng.normal(size=(n, rows)),
        sigma,
        tuple("fghij"),
        columns,
        slow,
        np.full((rows, s), 0.5),
        rng.normal(size=(2, rows, q)),
        np.ones(2),
        0.7,
    )
    plain, shared = products(block), products(replace(block, common_columns=alike))
    for name in ("G", "c", "chi2", "cross", "cross_y"):
        np.testing.assert_allclose(getattr(shared, name), getattr(plain, name), rtol=1e-9)


def test_without_a_run_coefficients_move_as_far_as_their_columns_hold() -> None:
    """Three runs, the first alone tells the second coefficient: without it that goes to a prior
    value far away, and the step stops at its reach, the first coefficient at the same share."""
    A = np.array([np.diag([1.0, 1e4]), np.diag([1.0, 0.0]), np.diag([1.0, 0.0])])
    b = np.array([[1.0, 3e4], [2.0, 0.0], [3.0, 0.0]])
    sd, bound = np.array([100.0, 1.0]), np.full(2, np.inf)
    free = leave_one_out(Normal(A, b, sd, bound))
    held = leave_one_out(Normal(A, b, sd, bound, np.array([np.inf, 0.5])))
    assert free.means[0] == pytest.approx([2.5, 0.0], rel=1e-3)
    assert free.whole.mean == pytest.approx([2.0, 3.0], rel=1e-3)
    share = 0.5 / 3.0
    assert held.means[0] == pytest.approx([2.0 + 0.5 * share, 2.5], rel=1e-3)
    np.testing.assert_allclose(held.means[1:], free.means[1:])
