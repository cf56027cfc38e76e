"""The steps before attribution, in order: check, sensors, fusion, recalibration, residuals."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from herringbone_sim.gap.balance import (
    Balance,
    measured_force,
    quadrature,
    torque_balance,
    window_of,
)
from herringbone_sim.gap.checks import check
from herringbone_sim.gap.fusion import Fused, fuse
from herringbone_sim.gap.motion import fused_noise, motion_balance, recalibrate_motion
from herringbone_sim.gap.prepared import PreparedCampaign, PreparedRun
from herringbone_sim.gap.recalibrate import (
    Calibration,
    Inertias,
    Law,
    fine_law,
    force_law,
    recalibrate,
    recalibrate_inertias,
)
from herringbone_sim.gap.screen import Finding
from herringbone_sim.gap.sensors import SensorCheck, drop, find_sensor_errors


@dataclass(frozen=True)
class Examined:
    """A campaign after recalibration; one entry a run, in the order of the campaign.

    Attributes:
        campaign: without runs and channels that can't be used or were found wrong.
        findings: what was wrong with the input.
        sensors: consistency of x, v and u over the fit runs.
        fused: best x and v.
        calibration, inertias: nominal parameters inside their tolerance.
        laws: force law with its residual; empty without forces.
        balances: torque balance, with the law's forces where none were measured.
    """

    campaign: PreparedCampaign
    findings: tuple[Finding, ...]
    sensors: SensorCheck
    fused: tuple[Fused, ...]
    calibration: Calibration
    inertias: Inertias
    laws: tuple[Law, ...]
    balances: tuple[Balance, ...]


def examine(campaign: PreparedCampaign, rng: np.random.Generator) -> Examined:
    """Take a campaign up to the residuals that an effect must explain.

    Only fit runs enter a choice or a fit. The coordinates must be seen in every run: without v,
    or without x and u, the residuals are NaN.
    """
    campaign, findings = check(campaign)
    sensors = find_sensor_errors(campaign.of_role("fit"))
    runs = tuple(drop(run, sensors.wrong) for run in campaign.runs)
    campaign = replace(campaign, runs=runs)
    fused = tuple(fuse(run) for run in runs)
    if all(run.F.complete for run in runs):
        calibration = recalibrate(runs, fused)
        first = [_balance(run, f, calibration) for run, f in zip(runs, fused, strict=True)]
        inertias = recalibrate_inertias(runs, first)
        balances = tuple(replace(b, factors=inertias.inverse) for b in first)
        pairs = zip(runs, fused, strict=True)
        laws = tuple(force_law(run, f, calibration.factors) for run, f in pairs)
    else:
        calibration, inertias = recalibrate_motion(runs, fused, rng)
        balances = tuple(
            motion_balance(run, f, fused_noise(run, rng), calibration.factors, inertias.inverse)
            for run, f in zip(runs, fused, strict=True)
        )
        laws = ()
    return Examined(campaign, findings, sensors, fused, calibration, inertias, laws, balances)


def _balance(run: PreparedRun, fused: Fused, calibration: Calibration) -> Balance:
    extra = quadrature(run, fused, fine_law(run, calibration.factors))
    return torque_balance(run, fused, force=measured_force(run, window_of(run), extra))
