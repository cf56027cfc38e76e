"""The residual is found where it was planted: mesh, tooth, shaft order; noise is nowhere."""

from __future__ import annotations

import numpy as np
import pytest
from gap_support import rig

from herringbone_sim.gap.data.prepared import PreparedCampaign
from herringbone_sim.gap.residuals.fusion import fuse
from herringbone_sim.gap.residuals.locate import Location, locate, shaft_order_periodicity
from herringbone_sim.gap.residuals.recalibrate import ForceLaw, force_law, recalibrate

pytestmark = pytest.mark.filterwarnings("ignore::herringbone_sim.core.parameters.ParameterWarning")
TURN = 27 * 77 / 104


def laws_of(campaign: PreparedCampaign) -> list[ForceLaw]:
    fused = [fuse(run) for run in campaign.runs]
    factors = recalibrate(campaign.runs, fused).factors
    return [force_law(r, f, factors) for r, f in zip(campaign.runs, fused, strict=True)][:2]


def place(campaign: PreparedCampaign, laws: list[ForceLaw]) -> Location:
    return locate(campaign.runs[:2], laws, campaign.meshes, np.random.default_rng(0))


def test_a_stiffer_mesh_holds_the_energy() -> None:
    factor = [1.0] * 12
    factor[4] = 1.2  # sp2_R
    campaign = rig({"k_factor": factor})
    found = place(campaign, laws_of(campaign))
    shares = found.shares
    assert shares["mesh"].labels[int(shares["mesh"].share.argmax())] == "sp2_R"
    assert shares["mesh"].share.max() > 0.98
    assert shares["kind"].share[0] > 0.98
    assert shares["planet"].share[1] > 0.98
    assert shares["side"].share[1] > 0.98
    assert shares["contact"].share[1] < 0.05


def test_noise_is_nowhere_and_a_tooth_on_its_mesh() -> None:
    campaign = rig({}, cycles=110)
    laws = laws_of(campaign)
    found = place(campaign, laws)
    assert found.shares["mesh"].reduced_chi2 == pytest.approx(np.ones(12), abs=0.25)
    assert all(member.beyond == () for member in found.teeth.values())
    for run, law in zip(campaign.runs, laws, strict=False):
        cycle = np.floor(run.phase / (2 * np.pi)).astype(int)
        law.residual_n[cycle % 25 == 7, 3] += 4.0 * law.sigma_n[cycle % 25 == 7, 3]
    assert place(campaign, laws).teeth["planet"].beyond == ("sp1_R",)


def test_a_shaft_order_is_told_from_coloured_noise() -> None:
    rng = np.random.default_rng(3)
    phases = [2 * np.pi * np.arange(2880) / 24 + rng.uniform(0, 6) for _ in range(5)]
    noise = [np.cumsum(rng.normal(size=(2880, 8)), axis=0) for _ in phases]
    assert shaft_order_periodicity(phases, noise, TURN).beyond == ()
    wave = [n + 40.0 * np.sin(7 * p / TURN)[:, None] for n, p in zip(noise, phases, strict=True)]
    assert shaft_order_periodicity(phases, wave, TURN).beyond == ("7",)
