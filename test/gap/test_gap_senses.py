"""Prediction and attractor: the planted gear is at the floor, nominal and wrong ones are not."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from gap_support import NOMINAL, OMEGA_N, POINTS, prepared, rig, sampled, senses_errors

from herringbone_sim.core.integrate import largest_exponent as by_tangent_flow
from herringbone_sim.core.model import build
from herringbone_sim.effects.effect import Locus, active
from herringbone_sim.effects.registry import effect
from herringbone_sim.gap.data.prepared import PreparedCampaign
from herringbone_sim.gap.residuals.fusion import fuse
from herringbone_sim.gap.sensors.correction import without_channels
from herringbone_sim.gap.verdict.augmented import Augmented, nominal_model
from herringbone_sim.gap.verification.residual_gap import residual_gap
from herringbone_sim.gap.verification.senses import Senses, measure_senses
from herringbone_sim.gap.verification.serialise import gap_to_dict, senses_to_dict
from herringbone_sim.gap.verification.short_prediction import (
    LYAPUNOV_TIMES,
    horizon_of,
    largest_exponent,
)
from herringbone_sim.gap.verification.simulator import simulator_of

SIZE = 1.12
TRUTH = Augmented(
    np.ones(6), np.ones(3), (active(effect("mean_stiffness"), Locus("sp"), {"factor": SIZE}),)
)
WRONG = replace(TRUTH, actives=(active(effect("mean_stiffness"), Locus("rp"), {"factor": SIZE}),))


@cache
def campaign() -> PreparedCampaign:
    return rig({"k_m_sp": SIZE * NOMINAL.k_m_sp, "c_factor": _damping()})


def _damping() -> list[float]:
    """The effect leaves the damping as it is; a stiffer mean stiffness alone would not."""
    return [SIZE**-0.5] * 6 + [1.0] * 6


@cache
def found() -> Senses:
    runs = campaign().runs
    residual = residual_gap(runs, lambda run: run, "force_law", TRUTH)
    control = residual_gap(runs, lambda run: run, "force_law", WRONG)
    pairs = zip(residual.runs, control.runs, strict=True)
    runner_up = tuple(replace(run, runner_up=other.augmented) for run, other in pairs)
    return measure_senses(runs, lambda run: run, replace(residual, runs=runner_up), TRUTH, WRONG)


@pytest.mark.parametrize("sense", ["residual", "prediction", "attractor"])
def test_the_planted_effect_closes_the_gap_and_a_wrong_one_does_not(sense: str) -> None:
    gap = getattr(found(), sense)
    # Of twenty chaotic cycles against twenty the floor of the attractor is high.
    for role in ("held_out",) if sense == "attractor" else ("held_out", None):
        assert gap.rms("nominal", role) > 2.0 * gap.rms("floor", role)
        assert gap.closed("augmented", role) > 0.9
        assert gap.closed("runner_up", role) < 0.5


def test_prediction_of_the_planted_gear_ends_at_the_floor_of_the_noise() -> None:
    for run in found().prediction.runs:
        assert run.augmented == pytest.approx(run.floor, rel=0.35)
        assert run.nominal > 2.0 * run.floor


def test_no_prediction_reaches_beyond_half_a_lyapunov_time() -> None:
    for name, cycles in found().horizon_cycles.items():
        value, _ = found().exponents[name]
        assert 0.0 < cycles <= 1.0 + 1e-9
        assert value <= 0.0 or cycles <= LYAPUNOV_TIMES / value + 1e-9
    assert horizon_of(campaign().runs[0], 2.0).cycles == pytest.approx(0.25)


@pytest.mark.parametrize(
    "point",
    [POINTS[0], {"delta_T": 72.0, "K": 0.0, "T_1": 220.0, "Omega": 0.6}],
)
def test_the_exponent_agrees_with_the_tangent_flow(point: dict[str, float]) -> None:
    run = prepared(sampled({}, point, 200), point, share=1e-4)
    machine = simulator_of(run, nominal_model())
    value, error = largest_exponent(run, fuse(run), machine, np.random.default_rng(0))
    model = build(NOMINAL.changed({**point, "omega_n": OMEGA_N}))
    expected, its_error = (one * 2 * np.pi / point["Omega"] for one in by_tangent_flow(model, 400))
    assert value == pytest.approx(expected, abs=4.0 * np.hypot(error, its_error) + 0.02)


def test_without_rates_neither_prediction_nor_attractor_is_claimed() -> None:
    names = tuple(f"v_{m}" for m in NOMINAL.layout.meshes)
    runs = [without_channels(run, names) for run in campaign().runs[:1]]
    residual = residual_gap(runs, lambda run: run, "consistency", TRUTH)
    told = measure_senses(runs, lambda run: run, residual, TRUTH)
    assert not np.isfinite(told.prediction.rms("nominal", None))
    assert "v must give every coordinate" in told.unknown[0]


def test_a_report_of_senses_is_held_to_its_form() -> None:
    made = gap_to_dict(found().residual) | {"senses": senses_to_dict(found())}
    assert senses_errors(made) == []
    assert made["senses"]["prediction"]["unit"] == "m"
    first = made["senses"]["prediction"]["runs"][0]
    assert first["horizon_cycles"] <= 1.0 + 1e-9
    assert np.isfinite(first["runner_up"])
    made["senses"]["prediction"]["runs"].pop()
    del made["senses"]["attractor"]["noise_floor"]
    assert len(senses_errors(made)) == 2
