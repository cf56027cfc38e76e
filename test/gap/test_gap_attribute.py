"""What a hypothesis expects of forces: at the samples, between them, and beside what is wild."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from herringbone_sim.core.model import build
from herringbone_sim.effects.effect import Active, Locus, active
from herringbone_sim.effects.registry import effect
from herringbone_sim.gap.attribution.effect_forces import (
    FusedRun,
    effect_contributions,
    expected_forces,
    force_function_with_effects,
    fused_run,
    instants,
)
from herringbone_sim.gap.data.mesh_excitation import waves
from herringbone_sim.gap.data.prepared import Measured, PreparedRun
from herringbone_sim.gap.residuals.fusion import Fused
from herringbone_sim.gap.residuals.recalibrate import force_law
from herringbone_sim.gap.sensors.filter_delay import with_delayed_waves
from herringbone_sim.recording.parameter_file import load_parameters

NOMINAL = Path(__file__).resolve().parents[2] / "config" / "rig.yaml"
POINTS = (
    {"delta_T": 20.0, "K": 0.0, "T_1": 300.0, "Omega": 1.0},
    {"delta_T": 90.0, "K": 0.0, "T_1": 2000.0, "Omega": 0.4},
    {"delta_T": 50.0, "K": 0.2, "T_1": 900.0, "Omega": 0.8},
)
TOLERANCE = np.array([1.01, 0.99, 1.0, 1.01, 0.99, 1.012])


def made(actives: tuple[Active, ...], seed: int = 1) -> list[FusedRun]:
    """Runs of random smooth motion whose forces are those of a rig with effects and noise."""
    rng = np.random.default_rng(seed)
    return [_made(point, actives, rng, i) for i, point in enumerate(POINTS)]


def _made(
    point: dict[str, float], actives: tuple[Active, ...], rng: np.random.Generator, number: int
) -> FusedRun:
    model = build(load_parameters(NOMINAL).changed({"model": "full"}).changed(point))
    n, per = 1200, 24
    omega = point["Omega"] * model.scales.omega_n
    phase = 2.0 * np.pi * np.arange(n) / per
    times = phase / omega
    x, v = np.zeros((n, 12)), np.zeros((n, 12))
    for order in (0.13, 0.5, 1.0, 2.0):
        size, shift = rng.normal(size=12) * 6e-5, rng.uniform(0, 6, 12)
        x += size * np.cos(order * phase[:, None] + shift)
        v -= size * order * omega * np.sin(order * phase[:, None] + shift)
    x += rng.choice([-3e-5, 6e-5], 12)
    nothing = Measured(np.zeros((n, 9)), np.ones(9, dtype=bool), np.ones(9))
    seen = np.ones(12, dtype=bool)
    run = PreparedRun(
        f"run_{number}",
        "fit",
        point,
        times,
        phase,
        Measured(x, seen, np.full(12, 1e-9)),
        Measured(v, seen, np.full(12, 1e-5)),
        Measured(np.zeros((n, 12)), seen, np.ones(12)),
        nothing,
        unseen(9),
        unseen(3),
        model,
        waves(model, phase, omega),
    )
    none = np.zeros((n, 8))
    sigma_x, sigma_v = np.full(12, 1e-9), np.full(12, 1e-5)
    fused = Fused(none, none, np.eye(8), np.eye(8), x, v, sigma_x, sigma_v)
    bare = fused_run(run, fused)
    force = expected_forces(bare, TOLERANCE, actives)
    noise = 0.01 * np.sqrt(np.mean(force**2, axis=0))
    force = force + noise * rng.normal(size=force.shape)
    return fused_run(replace(run, F=Measured(force, seen, noise)), fused)


def unseen(k: int) -> Measured:
    return Measured(np.full((1, k), np.nan), np.zeros(k, dtype=bool), np.full(k, np.nan))


def planted(name: str, locus: Locus, **values: object) -> Active:
    return active(effect(name), locus, values)


CRACK = planted("tooth_crack", Locus("sp", "1", "L"), depth=0.4, position=11.2, width=1.3)


def test_a_late_sensor_beside_a_force_that_no_step_follows_is_no_crash() -> None:
    one = made(())[0]
    late = planted("sensor_delay", Locus(), delay=1e-6, channels=("F",))
    wild = one.run.F.values.copy()
    wild[600, 3] = np.inf
    law = replace(force_law(one.run, one.fused, np.ones(6)), modelled_n=wild)
    force = expected_forces(one, np.ones(6), (late,), law)
    assert np.isnan(force[600, 3])
    assert np.isfinite(np.delete(force, 3, axis=1)).all()


def test_effects_between_samples_are_those_at_the_samples() -> None:
    one = made((CRACK,))[0]
    run, factors = one.run, np.ones(6)
    law = force_function_with_effects(one, factors, (CRACK,))
    deflection = one.fused.x + run.waves.e
    rate = one.fused.v + run.waves.e_rate
    change = law(run.phase, deflection, rate) - force_function_with_effects(one, factors, ())(
        run.phase, deflection, rate
    )
    at_samples = effect_contributions(one, factors, force_law(run, one.fused, factors), (CRACK,))[
        0
    ]
    assert np.abs(at_samples).max() > 100.0
    assert change == pytest.approx(at_samples, abs=1e-3)


@pytest.mark.parametrize("actives", [(), (CRACK,)], ids=["plain", "crack"])
def test_a_common_filter_acts_on_the_law_between_samples_as_at_them(
    actives: tuple[Active, ...],
) -> None:
    plain, factors = made(())[0], np.ones(6)
    late = with_delayed_waves(plain.run, 2e-5, 0.8)
    one = replace(plain, run=late, now=instants(late))
    x, v, run = one.fused.x, one.fused.v, one.run
    found = force_function_with_effects(one, factors, actives)(
        run.phase, x + run.waves.e, v + run.waves.e_rate
    )
    at_samples = expected_forces(one, factors, actives)
    assert np.abs(at_samples - expected_forces(plain, factors, actives)).max() > 100.0
    np.testing.assert_allclose(found, at_samples, atol=2.0)  # noise of x: 1e-9 m
