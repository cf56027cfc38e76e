"""Recalibration inside the tolerance: planted factors come back, effects do not bend them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gap_support import rig

from herringbone_sim.gap.residuals.fusion import fuse
from herringbone_sim.gap.residuals.recalibrate import (
    BOUNDS,
    force_function,
    force_law,
    recalibrate,
)
from herringbone_sim.gap.residuals.torque_balance import (
    averaged_measured_force,
    quadrature_correction,
    torque_balance,
    window_of,
)

OWN = {
    "k_m_sp": 1.5e9 * 1.012,
    "k_m_rp": 1.2e9 * 0.985,
    "e_factor": [0.983] * 6 + [1.011] * 6,
    "I_s": 0.008 * 0.988,
    "I_p": 0.007 * 1.015,
}


@pytest.fixture(scope="module")
def drifted() -> tuple:
    campaign = rig(OWN)
    return campaign, [fuse(run) for run in campaign.runs]


def test_planted_drift_comes_back_and_leaves_the_noise_floor(drifted: tuple) -> None:
    campaign, fused = drifted
    found = recalibrate(campaign.runs, fused)
    np.testing.assert_allclose(found[[0, 1]], [1.012, 0.985], atol=1e-3)
    np.testing.assert_allclose(found[[4, 5]], [0.983, 1.011], atol=1e-3)
    for run, one in zip(campaign.runs, fused, strict=True):
        before = force_law(run, one, np.ones(6)).reduced_chi2
        after = force_law(run, one, found).reduced_chi2
        np.testing.assert_allclose(after, 1.0, atol=0.2)
        assert before.max() > 1.3


def test_the_balance_holds_with_the_inertias_of_the_rig(drifted: tuple) -> None:
    campaign, fused = drifted
    found = recalibrate(campaign.runs, fused)
    balances = []
    for run, one in zip(campaign.runs, fused, strict=True):
        extra = quadrature_correction(run, one, force_function(run, found))
        force = averaged_measured_force(run, window_of(run), extra)
        balances.append(torque_balance(run, one, force=force))
    inverse = 1.0 / np.array([0.988, 1.015, 1.0])
    for balance in balances:
        np.testing.assert_allclose(replace(balance, factors=inverse).reduced_chi2, 1.0, atol=0.4)
        assert balance.reduced_chi2.max() > 1.5


def test_a_gap_on_one_mesh_does_not_bend_the_others() -> None:
    factor = [1.0] * 12
    factor[2] = 1.3
    campaign = rig({"k_factor": factor})
    fused = [fuse(run) for run in campaign.runs]
    found = recalibrate(campaign.runs, fused)
    np.testing.assert_allclose(found, 1.0, atol=4e-3)
    reduced = force_law(campaign.runs[0], fused[0], found).reduced_chi2
    assert reduced[2] > 20.0
    np.testing.assert_allclose(np.delete(reduced, 2), 1.0, atol=0.25)


def test_tolerance_is_a_hard_bound() -> None:
    campaign = rig({"k_m_sp": 1.5e9 * 1.1})
    found = recalibrate(campaign.runs, [fuse(run) for run in campaign.runs])
    assert found[0] == pytest.approx(1.0 + BOUNDS[0])
    assert np.all(np.abs(found - 1.0) <= BOUNDS + 1e-9)


def test_held_out_runs_are_not_looked_at(drifted: tuple) -> None:
    campaign, fused = drifted
    spoilt = replace(
        campaign.runs[2], F=replace(campaign.runs[2].F, values=np.full((960, 12), 1e9))
    )
    again = recalibrate((*campaign.runs[:2], spoilt), fused)
    np.testing.assert_array_equal(again, recalibrate(campaign.runs, fused))
