"""Errors of encoders once a revolution, off centre as the data sheet allows, are taken off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from herringbone_sim.arrays import rms
from herringbone_sim.gap.data.kinematics import bodies_to_meshes, cycles_per_shaft_turn
from herringbone_sim.gap.data.prepared import Measured, PreparedRun
from herringbone_sim.gap.observations import force_law
from herringbone_sim.gap.observations.calibration.encoder_error import without_encoder_errors
from herringbone_sim.gap.observations.gear import GearObservations
from herringbone_sim.gap.observations.runs import gear_run
from herringbone_sim.gap.residuals.mesh_law import law
from herringbone_sim.gap.sensor_calibration import STRIDE, without_copies
from herringbone_sim.practice.arrays import as_prepared
from herringbone_sim.practice.campaign import make_campaign
from herringbone_sim.practice.trial import Setting, plan_of


def misfit(run: PreparedRun) -> float:
    """RMS of measured minus nominal force."""
    m = gear_run(run, 1).motion
    return rms(m.F - law(m).force)


def test_errors_of_encoders_are_found_and_taken_off() -> None:
    """A healthy rig by its encoders: amplitudes are those of the label to a fifth, in the RMS over
    runs and bodies, and the law fits better; displacements without rotations are corrected alike.
    """
    made = make_campaign(plan_of(Setting(noise=("encoders",), truth="none"), 5))
    campaign = without_copies(as_prepared(made))
    runs = campaign.runs[:3]
    assert all(run.u.complete and not run.x.recorded.any() for run in runs)
    model = runs[0].model
    off = np.array(made.label["noise"]["encoders"]["off"][0])
    true = off * [model.scales.base_radius(body) for body in model.layout.bodies]
    assert true.max() > 5e-7  # far above what is asked for

    corrected = without_encoder_errors(runs, campaign.gain_tolerance, STRIDE)
    taken = [run.u.values - new.u.values for run, new in zip(runs, corrected, strict=True)]
    amplitude = np.array([np.ptp(values, axis=0) / 2.0 for values in taken])
    assert rms(amplitude - true) < 0.2 * rms(true)
    for run, new in zip(runs, corrected, strict=True):
        assert misfit(new) < misfit(run)

    fused = gear_run(runs[0], 1).fused
    by_mesh = replace(
        runs[0],
        x=Measured(fused.x, np.ones(fused.x.shape[1], dtype=bool), fused.sigma_x),
        u=runs[0].u.without(np.ones(len(true), dtype=bool)),
    )
    (alone,) = without_encoder_errors([by_mesh], campaign.gain_tolerance, STRIDE)
    expected = taken[0] @ bodies_to_meshes(model).T
    assert rms(by_mesh.x.values - alone.x.values - expected) < 0.2 * rms(expected)
    # Where both are measured, they tell the errors themselves; others are corrected all the same.
    both = replace(by_mesh, u=runs[0].u)
    same, new = without_encoder_errors([both, runs[1]], campaign.gain_tolerance, STRIDE)
    assert same is both
    assert new.encoder_errors == pytest.approx(corrected[1].encoder_errors)


def test_nothing_is_taken_off_exact_displacements() -> None:
    """Rotations of a healthy rig with white noise of 60 dB: at most half of their noise."""
    plan = plan_of(Setting(snr_dB=(60.0,), truth="none"), 5)
    campaign = without_copies(as_prepared(make_campaign(plan)))
    runs = [
        replace(run, x=run.x.without(np.ones(run.x.values.shape[1], dtype=bool)))
        for run in campaign.runs[:2]
    ]
    for run, new in zip(
        runs, without_encoder_errors(runs, campaign.gain_tolerance, STRIDE), strict=True
    ):
        assert np.abs(run.u.values - new.u.values).max() < 0.5 * np.max(run.u.sigma)


def test_the_residual_is_that_without_the_errors() -> None:
    """About any errors that leave a mesh in deep contact, where the law is linear, the block is
    the same as about none: the prior of the errors stays about 0."""
    plan = plan_of(Setting(truth="none"), 5)
    run = as_prepared(make_campaign(plan)).runs[0]
    gear = GearObservations([run])
    motion, model = gear.runs[0].strided, gear.model
    errors = np.full(2 * len(model.layout.bodies), 3e-7)
    turns = motion.phase[:, None] / [
        cycles_per_shaft_turn(model)[b[0]] for b in model.layout.bodies
    ]
    of_bodies = 3e-7 * (np.cos(turns) + np.sin(turns))
    rate = 3e-7 * motion.omega * np.gradient(np.cos(turns) + np.sin(turns), motion.phase, axis=0)
    G = bodies_to_meshes(model)
    about = replace(
        motion, x=motion.x - of_bodies @ G.T, v=motion.v - rate @ G.T, encoder_errors=errors
    )
    chosen = gear.law_functions
    plain, moved = (force_law.block(m, law(m), model, chosen) for m in (motion, about))
    deep = np.abs(motion.x) > motion.b + 5e-6
    shift = np.abs(law(about).force - law(motion).force)[deep].max()
    assert np.abs(plain.residual - moved.residual)[deep].max() < 1e-3 * shift


def test_an_effect_is_not_taken_for_an_error_of_encoders() -> None:
    """Backlash that shrinks at another rate, d = 10: the nominal law fits badly: none changes."""
    setting = Setting(noise=("encoders",), truth="thermal_backlash", d=(10.0,))
    campaign = without_copies(as_prepared(make_campaign(plan_of(setting, 5))))
    runs = campaign.runs[:3]
    assert without_encoder_errors(runs, campaign.gain_tolerance, STRIDE) == runs
