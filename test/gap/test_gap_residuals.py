"""Recalibration and residuals with forces and without, on rigs within and beyond tolerance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gap_support import NOMINAL, rig

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import build
from herringbone_sim.core.right_hand_side import accelerate
from herringbone_sim.gap.data.prepared import Measured, PreparedCampaign
from herringbone_sim.gap.residuals.balance_without_forces import (
    fused_noise,
    motion_balance,
    recalibrate_motion,
)
from herringbone_sim.gap.residuals.fusion import fuse
from herringbone_sim.gap.residuals.recalibrate import (
    force_function,
    force_law,
    recalibrate,
)
from herringbone_sim.gap.residuals.torque_balance import (
    Balance,
    averaged_measured_force,
    inertia_parts,
    quadrature_correction,
    torque_balance,
)
from herringbone_sim.gap.residuals.torque_balance import window_of as look_of

OWN = {"k_m_sp": 1.5e9 * 1.012, "e_factor": [0.983] * 6 + [1.011] * 6, "I_p": 0.007 * 1.015}


def without_forces(campaign: PreparedCampaign) -> PreparedCampaign:
    runs = tuple(
        replace(
            run,
            F=Measured(
                np.full_like(run.F.values, np.nan),
                np.zeros_like(run.F.recorded),
                np.full_like(run.F.sigma, np.nan),
            ),
        )
        for run in campaign.runs
    )
    return replace(campaign, runs=runs)


def by_motion(campaign: PreparedCampaign) -> tuple[Array, Array, list[Balance]]:
    rng = np.random.default_rng(0)
    fused = [fuse(run) for run in campaign.runs]
    factors, inverse_inertias = recalibrate_motion(campaign.runs, fused, rng)
    balances = [
        motion_balance(run, f, fused_noise(run, rng), factors, inverse_inertias)
        for run, f in zip(campaign.runs, fused, strict=True)
    ]
    return factors, inverse_inertias, balances


def test_a_rig_within_tolerance_is_at_the_noise_floor() -> None:
    runs = rig(OWN).runs
    fused = [fuse(run) for run in runs]
    factors: Array = recalibrate(runs, fused)
    balances = []
    for run, f in zip(runs, fused, strict=True):
        extra = quadrature_correction(run, f, force_function(run, factors))
        force = averaged_measured_force(run, look_of(run), extra)
        balances.append(torque_balance(run, f, force=force))
        np.testing.assert_allclose(force_law(run, f, factors).reduced_chi2, 1.0, atol=0.4)
    inverse = 1.0 / np.array([1.0, 1.015, 1.0])
    for balance in balances:
        np.testing.assert_allclose(replace(balance, factors=inverse).reduced_chi2, 1.0, atol=0.6)


def test_motion_alone_gives_the_drift_and_the_floor() -> None:
    factors, inverse_inertias, balances = by_motion(without_forces(rig(OWN, cycles=80)))
    np.testing.assert_allclose(factors[4:], [0.983, 1.011], atol=1.5e-3)
    np.testing.assert_allclose(factors[:2], [1.012, 1.0], atol=6e-3)
    np.testing.assert_allclose(inverse_inertias[1], 1.0 / 1.015, atol=6e-3)
    reduced = np.array([balance.reduced_chi2 for balance in balances])
    assert np.median(reduced) == pytest.approx(1.0, abs=0.3)


def test_motion_alone_shows_a_gap() -> None:
    balances = by_motion(without_forces(rig({"k_factor": [1.0] * 6 + [1.15] * 6})))[2]
    planets = [balance.reduced_chi2[2:].mean() for balance in balances]
    assert max(planets) > 5.0


def test_few_channels_end_in_nan() -> None:
    campaign = rig({})
    bare = Measured(np.full((960, 12), np.nan), np.zeros(12, dtype=bool), np.full(12, np.nan))
    runs = tuple(replace(run, x=bare, v=bare, F=bare) for run in campaign.runs)
    factors, _, balances = by_motion(replace(campaign, runs=runs))
    assert all(np.isnan(balance.reduced_chi2).all() for balance in balances)
    np.testing.assert_array_equal(factors, 1.0)


@pytest.mark.parametrize("projection", ["mesh_and_torque", "torque"])
@pytest.mark.parametrize("model", ["full", "reduced"])
def test_a_mesh_force_accelerates_as_in_the_simulation(model: str, projection: str) -> None:
    gear = build(NOMINAL.changed({"model": model, "projection": projection}))
    m, n = gear.layout.n_coordinate, gear.layout.n_mesh
    expected = np.zeros((m, n))
    for j, force in enumerate(np.eye(n)):
        column = np.zeros(m)
        accelerate(gear.packed, force, column)
        expected[:, j] = gear.scales.projection * column
    np.testing.assert_allclose(inertia_parts(gear).sum(axis=0), expected, rtol=1e-12)
