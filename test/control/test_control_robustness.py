"""Unlike halves: starts, gears, and the transverse exponent of what was controlled."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from herringbone_sim.control.amplitude import run_survey
from herringbone_sim.control.robustness import DIFFERENCES, start_shares, survival
from herringbone_sim.control.runs import ALIKE, MotionRunner, Motions, RunSettings
from herringbone_sim.control.starts import Starts, start_states
from herringbone_sim.effects.written import read_effects
from herringbone_sim.errors import ParameterError
from herringbone_sim.recording.parameter_file import load_parameters
from herringbone_sim.sweeps.grid import Axis, with_sweep_steps


@pytest.fixture(scope="module")
def paper():
    path = Path(__file__).resolve().parents[2] / "config" / "paper.yaml"
    return with_sweep_steps(load_parameters(path).changed({"xi": 0.085}), {})


@pytest.mark.parametrize("what", sorted(DIFFERENCES))
@pytest.mark.parametrize("own", [None, 0.8])
def test_a_difference_parts_the_halves_about_their_own_values(what, own, paper):
    gear = paper if own is None else paper.changed({what: [own]})
    unlike = gear.changed(DIFFERENCES[what](gear, 0.1))
    values, mean = np.reshape(getattr(unlike, what), (-1, 2)), np.mean(getattr(gear, what))
    unit = 2.0 * np.pi if what in ("phi_a", "mesh_phase") else mean
    np.testing.assert_allclose(values[:, 0] - values[:, 1], 0.1 * unit)
    np.testing.assert_allclose(values.mean(axis=1), mean, atol=1e-15)


def test_starts_of_a_gear_that_can_not_be_are_nan(paper):
    """A backlash that closes between 0 and 100 K."""
    small = paper.changed({"b": 0.25, "delta_T": 0.0})
    sets = [small, small.changed({"delta_T": 100.0}), small]
    states = start_states(MotionRunner(), sets, Starts(1, 1))
    assert np.isnan(states[1]).all()
    assert np.isfinite(states[[0, 2]]).all()
    with pytest.raises(ParameterError, match="delta_T"):
        start_states(MotionRunner(), sets[1:2], Starts(1, 1))


def test_the_transverse_exponent_says_where_unlike_starts_end(paper):
    """P1 at K 0.5 attracts them all; at K 1 it repels left from right, though it looks as good
    from the zero start."""
    K = np.array([0.5, 1.0])
    axis, alone = Axis("delta_T", (50.0,)), Starts(0, 0, running=False)
    across = run_survey(MotionRunner(), paper, axis, K, alone, RunSettings(600, 200, True))
    assert across.of("period").ravel().tolist() == [1.0, 1.0]
    assert across.of("within").max() < -0.02
    stable, repelling = across.of("transverse").ravel()
    assert stable < -0.02
    assert repelling > 1e-3
    places = [{"delta_T": 50.0, "K": float(one)} for one in K]
    held, lost = start_shares(MotionRunner(), paper, places, [1], 12, RunSettings(1500, 50))
    assert (held.reached, held.parted, held.share) == (12, 0, 1.0)
    assert 0.7 < held.low < 0.8
    assert lost.reached == 0


def test_a_controlled_motion_survives_small_differences_in_proportion(paper):
    """For small differences the distance of left and right grows as the difference."""
    gear = paper.changed({"K": 0.5})
    found = survival(
        MotionRunner(), gear, 1, RunSettings(800, 60), differences=(0.001, 0.01), starts=2
    )
    assert len(found) == 2 * len(DIFFERENCES)
    for small, large in zip(found[::2], found[1::2], strict=True):
        assert small.from_zero
        assert small.from_running
        assert (small.period, small.parted) == (1.0, 2)
        assert large.distance / small.distance == pytest.approx(10.0, rel=0.15)
        assert small.distance < ALIKE


def test_a_motion_shorter_than_the_forcing_repeats_with_it(paper, monkeypatch):
    """One of 9 mesh cycles repeats after the 27 of a tooth of the sun."""
    runner = MotionRunner(actives=read_effects("tooth_crack@sp/all/L:depth=0.3"))

    def run(sets, starts, settings):
        number = np.zeros(len(sets))
        names = [item.name for item in fields(Motions)]
        return Motions(**{**dict.fromkeys(names, number), "period": number + 9.0, "end": starts})

    monkeypatch.setattr(runner, "run", run)
    found = survival(runner, paper, 1, RunSettings(), (0.01,), starts=1)
    assert all((one.from_zero, one.from_running, one.parted) == (True, True, 1) for one in found)


def test_chaos_survives_as_nothing_that_was_wanted(paper):
    found = survival(
        MotionRunner(), paper.changed({"K": 0.1}), 2, RunSettings(300, 80), (0.05,), starts=1
    )
    for one in found:
        assert (one.period, one.from_zero, one.from_running, one.parted) == (0.0, False, False, 0)
        assert np.isnan(one.distance)
