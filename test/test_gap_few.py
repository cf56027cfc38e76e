"""Diagnosis from sun and carrier displacements alone: filter, innovations, attribution."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gap_support import POINTS, noisy, prepared, rig, sampled
from herringbone_sim.gap.filtering.few import few
from herringbone_sim.gap.filtering.filter import Filtered, filtered, innovations
from herringbone_sim.gap.filtering.linear import accelerations, linear, responses
from herringbone_sim.gap.filtering.runs import following, left, settled

from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.effects.effect import Locus, active
from herringbone_sim.effects.registry import effect
from herringbone_sim.gap.attribution.channel_sets import (
    FEW,
    FULL,
    NO_FORCE,
    cannot_tell,
    channel_set,
)
from herringbone_sim.gap.attribution.hypothesis import case
from herringbone_sim.gap.data.prepared import Measured, PreparedRun
from herringbone_sim.gap.residuals.fusion import fuse

pytestmark = pytest.mark.filterwarnings("ignore::herringbone_sim.core.parameters.ParameterWarning")
KEPT = ("t", "phase", "K", "delta_T", "T_1", "u_s_L", "u_s_R", "u_c")
ONE = np.ones(9)
STIFF = {"k_factor": [1.15] * 6 + [1.0] * 6}


def seen_by_few(
    own: dict[str, object], at: int = 0, cycles: int = 60
) -> tuple[PreparedRun, TimeSeries]:
    """A run with rotations of suns and carrier alone, and all that it was without noise."""
    exact = sampled(own, POINTS[at], cycles)
    kept = TimeSeries(exact.times, exact.columns(KEPT), KEPT)
    return prepared(noisy(kept, 0.01, 3 + at), POINTS[at]), exact


def first_filter(run: PreparedRun) -> Filtered:
    return filtered(run, ONE[:6], ONE[6:], np.array([0.0] * 4 + [0.003] * 4 + [0.0, 1e-5]))


@pytest.mark.parametrize("at", [0, 1])
def test_the_filter_finds_planets_that_nobody_measured(at: int) -> None:
    run, exact = seen_by_few({}, at)
    by, _ = following(run, first_filter(run), ONE)
    start = settled(run)
    ring = (exact["x_rp1_L"] + run.waves.e[:, 6])[start:] / run.model.scales.b_c
    error = by.state[start:, 2] - ring
    assert np.std(ring) > 0.05
    assert np.std(error) < 0.05 * np.std(ring)
    assert abs(np.mean(error)) < 0.05 * np.std(ring)


@pytest.mark.parametrize("at", [0, 1])
def test_a_nominal_gear_surprises_the_filter_as_noise_does(at: int) -> None:
    run, _ = seen_by_few({}, at)
    white = following(run, first_filter(run), ONE)[0].white[settled(run) :]
    assert 0.6 < np.mean(white**2) < 1.2
    lag = np.sum(white[1:] * white[:-1], axis=0) / np.sum(white**2, axis=0)
    assert np.abs(lag).max() < 0.3


def test_a_stiffer_gear_surprises_it_more_and_no_longer_once_that_is_known() -> None:
    run, _ = seen_by_few(STIFF)
    by = first_filter(run)
    known = active(effect("mean_stiffness"), Locus("sp"), {"factor": 1.15})
    without, with_it = (left(run, by, ONE, actives) for actives in ((), (known,)))
    assert np.mean(without**2) > 1.5
    assert np.mean(with_it**2) < 1.2


@pytest.mark.parametrize(
    "planted",
    [
        ("mean_stiffness", Locus("rp"), {"factor": 1.0005}),
        ("tooth_friction", Locus("sp"), {"mu": 5e-4}),
        ("torque_ripple", Locus(), {"amplitude": 1e-3, "order": 7}),
        ("profile_error", Locus("sp"), {"cos": 1e-9, "order": 2}),
    ],
    ids=lambda one: one[0],
)
def test_derivatives_along_the_run_are_those_of_the_exact_gear(
    planted: tuple[str, Locus, dict[str, object]],
) -> None:
    run, _ = seen_by_few({}, cycles=40)
    by = first_filter(run)
    name, locus, values = planted
    one = active(effect(name), locus, values)
    exact = innovations(run, by, ONE[:6], ONE[6:], (one,), True) - innovations(
        run, by, ONE[:6], ONE[6:], (), True
    )
    line = linear(run, by, ONE[:6], ONE[6:])
    found = responses(line, accelerations(line, (one,))[:, :, None])[:, :, 0]
    start = settled(run)
    a, b = exact[start:].ravel(), found[start:].ravel()
    assert a @ b / np.linalg.norm(a) / np.linalg.norm(b) > 0.99
    assert np.linalg.norm(b) == pytest.approx(np.linalg.norm(a), rel=0.1)


def test_stiffness_is_named_from_suns_and_carrier() -> None:
    runs = [seen_by_few(STIFF, at)[0] for at in (0, 1, 2)]
    effects = [effect(n) for n in ("mean_stiffness", "damping_law", "backlash_offset")]
    found = few([case(r, fuse(r)) for r in runs], effects)
    assert found.filtered
    best = found.fits[1]
    assert (best.actives[0].effect.id, best.actives[0].locus.mesh) == ("mean_stiffness", "sp")
    assert best.actives[0].locus.planet == "all"
    assert best.actives[0].theta[0] == pytest.approx(1.15, abs=0.03)
    assert best.chi2 < 0.8 * found.fits[0].chi2
    assert best.left_out < found.fits[0].left_out


def test_each_set_of_channels_says_what_it_cannot_decide() -> None:
    whole = rig({}, cycles=10).runs[0]
    without = replace(whole, F=prepared_without(whole))
    run, _ = seen_by_few({}, cycles=10)
    kinds = []
    for one in (whole, without, run):
        cases = [case(one, fuse(one))]
        kinds.append((channel_set(cases), " ".join(cannot_tell(cases))))
    assert [kind for kind, _ in kinds] == [FULL, NO_FORCE, FEW]
    assert kinds[0][1] == ""
    assert "force" in kinds[1][1]
    assert "tooth_crack" not in kinds[1][1]
    assert "tooth_crack" in kinds[2][1]
    assert "planet" in kinds[2][1]


def prepared_without(run: PreparedRun) -> Measured:
    gone = np.zeros_like(run.F.there)
    return replace(
        run.F, values=np.full_like(run.F.values, np.nan), there=gone, sigma=run.F.sigma * np.nan
    )
