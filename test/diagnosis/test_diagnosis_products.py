"""Products of blocks and scores of them against dense linear algebra."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from herringbone_sim.diagnosis.coefficients import CampaignProducts, Coefficient, Placement
from herringbone_sim.diagnosis.machine import Hypothesis
from herringbone_sim.diagnosis.products import (
    Block,
    products,
    recentred,
    residual_without_nuisance,
    shared_nuisances,
)
from herringbone_sim.diagnosis.regression import leave_one_out
from herringbone_sim.diagnosis.score import MAX_DEPARTURE_SD, compute_score


def a_block(seed, name="law", n=25, rows=2, functions=("f", "g", "h"), kinds=(2, 2)):
    """A random block: nuisances of each row, and some shared by all rows."""
    rng = np.random.default_rng(seed)
    Q, (S, T) = len(functions), kinds
    return Block(
        name,
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


def gram_matrices(found):
    """(rows, Q, Q) Gram matrices of products."""
    rows, Q = found.c.shape
    return np.array(
        [
            found.grams.weighted(np.array([row]), np.arange(Q), np.eye(Q)[None])
            for row in range(rows)
        ]
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
            "law": a_block(10 * r, "law", n=20 + 5 * r),
            "balance": a_block(10 * r + 1, "balance", 15, 1, ("p", "q"), (0, 0)),
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
    np.testing.assert_allclose(gram_matrices(found), gram_matrices(expected), atol=1e-10)
    for name in ("c", "chi2", "count", "cross", "cross_y"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=1e-10)


def test_a_departure_stays_near_the_curve_it_departs_from():
    """A rival whose own parameter explains nothing can't close by its departure alone."""
    rng = np.random.default_rng(5)
    own, other = rng.normal(size=(2, 400))
    columns = np.stack([own, other], axis=1)[:, None, :]
    blocks = [
        Block(
            "law",
            10.0 * other[:, None] + rng.normal(size=(400, 1)),
            np.ones((400, 1)),
            ("own", "other"),
            columns,
            np.zeros((400, 1, 0)),
            np.zeros((1, 0)),
            np.zeros((0, 1, 2)),
            np.zeros(0),
        )
        for _ in range(3)
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
            rng.normal(size=(400, 1)),
            np.ones((400, 1)),
            ("own",),
            size * rng.normal(size=(400, 1, 1)),
            np.zeros((400, 1, 0)),
            np.zeros((1, 0)),
            np.zeros((0, 1, 1)),
            np.zeros(0),
        )
        for size in (30.0, 0.03)
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
            rng.normal(size=(200, 1)),
            np.ones((200, 1)),
            ("own",),
            1e14 * rng.normal(size=(200, 1, 1)),
            np.zeros((200, 1, 0)),
            np.zeros((1, 0)),
            np.zeros((0, 1, 1)),
            np.zeros(0),
        )
        for _ in range(3)
    ]
    campaign = CampaignProducts([{"law": products(b)} for b in blocks], ())
    own = Coefficient("own", 1.0, np.inf, {"law": Placement((0,), ("own",), np.ones((3, 1)))})
    found = compute_score(campaign, (own,), np.ones(1), sizes=(1.0,))
    np.testing.assert_array_equal(found.chi2, campaign.chi2)
    assert found.in_sample == campaign.chi2.sum()
    assert replace(found, by_density=True).loss == pytest.approx(campaign.chi2.sum())


def test_products_of_columns_that_all_rows_share_are_those_taken_row_by_row() -> None:
    """Noise, own columns and residuals differ by row, nuisances and shared columns do not."""
    rng = np.random.default_rng(0)
    n, rows, q, s = 200, 3, 5, 2
    common = rng.normal(size=(n, 3))
    own = rng.normal(size=(n, rows, q - 3))
    slow = np.repeat(rng.normal(size=(n, 1, s)), rows, axis=1)
    sigma = np.broadcast_to(rng.uniform(1.0, 2.0, rows), (n, rows))
    block = Block(
        "o",
        rng.normal(size=(n, rows)),
        sigma,
        tuple("fghij"),
        np.concatenate([own, np.repeat(common[:, None], rows, axis=1)], axis=2),
        slow,
        np.full((rows, s), 0.5),
        rng.normal(size=(2, rows, q)),
        np.ones(2),
        0.7,
    )
    with_common = replace(block, columns=own, common_columns=common)
    for of_block in (residual_without_nuisance, shared_nuisances):
        np.testing.assert_allclose(of_block(with_common), of_block(block), rtol=1e-9)
    plain, shared = products(block), products(with_common)
    np.testing.assert_allclose(gram_matrices(shared), gram_matrices(plain), rtol=1e-9)
    every, W = np.array([4, 1, 2]), rng.normal(size=(2, 3))
    for row in range(rows):
        of_plain = plain.grams.times(row, every, W)
        np.testing.assert_allclose(shared.grams.times(row, every, W), of_plain, rtol=1e-9)
    for name in ("c", "chi2", "cross", "cross_y"):
        np.testing.assert_allclose(getattr(shared, name), getattr(plain, name), rtol=1e-9)


def test_without_a_run_coefficients_move_as_far_as_their_columns_hold() -> None:
    """Three runs, the first alone tells the second coefficient: without it that goes to a prior
    value far away, and the step stops at its reach, the first coefficient at the same share."""
    A = np.array([np.diag([1.0, 1e4]), np.diag([1.0, 0.0]), np.diag([1.0, 0.0])])
    b = np.array([[1.0, 3e4], [2.0, 0.0], [3.0, 0.0]])
    sd, bound = np.array([100.0, 1.0]), np.full(2, np.inf)
    free = leave_one_out(A, b, sd, bound)
    held = leave_one_out(A, b, sd, bound, np.array([np.inf, 0.5]))
    assert free.means[0] == pytest.approx([2.5, 0.0], rel=1e-3)
    assert free.whole.mean == pytest.approx([2.0, 3.0], rel=1e-3)
    share = 0.5 / 3.0
    assert held.means[0] == pytest.approx([2.0 + 0.5 * share, 2.5], rel=1e-3)
    np.testing.assert_allclose(held.means[1:], free.means[1:])
