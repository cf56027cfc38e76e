"""All steps before attribution, with forces and without, on rigs within and beyond tolerance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gap_support import rig

from herringbone_sim.gap.examine import examine
from herringbone_sim.gap.prepared import Measured, PreparedCampaign

pytestmark = pytest.mark.filterwarnings("ignore::herringbone_sim.core.parameters.ParameterWarning")
OWN = {"k_m_sp": 1.5e9 * 1.012, "e_factor": [0.983] * 6 + [1.011] * 6, "I_p": 0.007 * 1.015}


def without_forces(campaign: PreparedCampaign) -> PreparedCampaign:
    runs = tuple(
        replace(
            run,
            F=Measured(
                np.full_like(run.F.values, np.nan),
                np.zeros_like(run.F.there),
                np.full_like(run.F.sigma, np.nan),
            ),
        )
        for run in campaign.runs
    )
    return replace(campaign, runs=runs)


def test_a_rig_within_tolerance_is_at_the_noise_floor() -> None:
    found = examine(rig(OWN), np.random.default_rng(0))
    assert found.findings == ()
    assert found.sensors.findings == ()
    for law, balance in zip(found.laws, found.balances, strict=True):
        np.testing.assert_allclose(law.chi2, 1.0, atol=0.4)
        np.testing.assert_allclose(balance.chi2, 1.0, atol=0.6)


def test_motion_alone_gives_the_drift_and_the_floor() -> None:
    found = examine(without_forces(rig(OWN, cycles=80)), np.random.default_rng(0))
    assert {f.what for f in found.findings} == {"scope"}
    assert found.laws == ()
    factors = found.calibration.factors
    np.testing.assert_allclose(factors[4:], [0.983, 1.011], atol=1.5e-3)
    np.testing.assert_allclose(factors[:2], [1.012, 1.0], atol=6e-3)
    np.testing.assert_allclose(found.inertias.factors[1], 1.015, atol=6e-3)
    chi2 = np.array([balance.chi2 for balance in found.balances])
    assert np.median(chi2) == pytest.approx(1.0, abs=0.3)


def test_motion_alone_shows_a_gap() -> None:
    found = examine(
        without_forces(rig({"k_factor": [1.0] * 6 + [1.15] * 6})), np.random.default_rng(0)
    )
    planets = [balance.chi2[2:].mean() for balance in found.balances]
    assert max(planets) > 5.0


def test_few_channels_are_told_and_end_in_nan() -> None:
    campaign = rig({})
    bare = Measured(np.full((960, 12), np.nan), np.zeros(12, dtype=bool), np.full(12, np.nan))
    runs = tuple(replace(run, x=bare, v=bare, F=bare) for run in campaign.runs)
    found = examine(replace(campaign, runs=runs), np.random.default_rng(0))
    assert len([f for f in found.findings if f.what == "scope"]) == 3
    assert all(np.isnan(balance.chi2).all() for balance in found.balances)
    np.testing.assert_array_equal(found.calibration.factors, 1.0)
