"""Pockets, firm and held amplitudes on planted staircases; the paper's K from its zero start."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from gears import PAPER

from herringbone_sim.control.amplitude import (
    Target,
    least_amplitudes,
    refined,
    run_survey,
    staircase,
    target_cycles,
    windows,
)
from herringbone_sim.control.runs import MotionRunner, Motions, RunSettings, repeats
from herringbone_sim.control.starts import Starts, start_states
from herringbone_sim.core.mirror import layout_mirror
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.recording.parameter_file import load_parameters
from herringbone_sim.sweeps.grid import Axis, with_sweep_steps

K = np.linspace(0.0, 1.0, 11)


@pytest.fixture(scope="module")
def paper():
    path = Path(__file__).resolve().parents[2] / "config" / "paper.yaml"
    return with_sweep_steps(load_parameters(path).changed({"xi": 0.085}), {})


def flags(*reached):
    return np.isin(np.arange(len(K)), reached)


def test_a_pocket_is_least_but_neither_firm_nor_held():
    found = staircase(K, flags(2, 5, 6, 7, 10))
    assert (found.least, found.firm, found.held) == pytest.approx((0.2, 0.5, 1.0))
    assert found.pockets == ((K[2], K[2]), (K[5], K[7]), (K[10], K[10]))
    assert found.share == pytest.approx(5 / 11)


def test_what_is_lost_at_the_largest_value_is_not_held():
    found = staircase(K, flags(3, 4, 5))
    assert (found.least, found.firm) == pytest.approx((0.3, 0.3))
    assert np.isnan(found.held)


def test_never_and_always():
    never, always = staircase(K, flags()), staircase(K, flags(*range(11)))
    assert np.isnan([never.least, never.firm, never.held]).all()
    assert never.pockets == ()
    assert (always.least, always.firm, always.held) == (0.0, 0.0, 0.0)


def test_bisection_finds_the_planted_edges():
    """Three rows, each with its own edges, one of them a pocket that is lost again."""
    edges = np.array([[0.234, 0.61], [0.05, 0.761], [0.512, 0.97]])

    def reached(rows, at):
        pocket = (at > edges[rows, 0]) & (at < edges[rows, 0] + 0.07)
        return pocket | (at > edges[rows, 1])

    rows = np.array([reached(np.full(11, i), K) for i in range(3)])
    found = refined(K, rows, reached, halvings=12)
    half = 0.1 / 2**12
    assert found[0].least == pytest.approx(0.234, abs=half)
    assert found[0].held == found[0].firm == pytest.approx(0.61, abs=half)
    assert found[1].least == pytest.approx(0.05, abs=half)
    assert found[1].firm == pytest.approx(0.761, abs=half)
    assert found[2].held == pytest.approx(0.97, abs=half)
    assert np.isnan(found[2].firm)


def test_windows_of_a_staircase():
    found = windows(K, np.array([0, 0, 4, 4, 2, np.nan, 2, 1, 1, 1, 1.0]))
    expected = [(0, 0, 1), (4, 2, 3), (2, 4, 4), (2, 6, 6), (1, 7, 10)]
    assert found == [(p, K[a], K[b]) for p, a, b in expected]


def test_what_repeats():
    periods = np.array([0.0, 1.0, 2.0, 3.0, 4.0, np.nan])
    assert repeats(periods, 2).tolist() == [False, True, True, False, False, False]
    assert not repeats(periods, 0).any()


def test_the_common_period_of_mesh_and_control():
    gear = Parameters(K=0.1)
    orders = (1.0, 2.0, 0.5, 1.5, 0.375, 2.0**0.5)
    found = [target_cycles(gear.changed({"control_order": one}), 2) for one in orders]
    assert found == [2, 2, 4, 4, 16, 0]


def test_starts_are_of_the_kinds_they_say(paper):
    starts = Starts(alike=2, parted=2)
    states = start_states(MotionRunner(), [paper, paper.changed({"delta_T": 20.0})], starts)
    assert states.shape == (2, 6, 8)
    gap = np.abs(states - states[..., layout_mirror(paper.layout)]).max(axis=2)
    assert gap[:, :4].max() == 0.0
    assert gap[:, 4:].min() > 0.01
    np.testing.assert_array_equal(states[0, 2:], states[1, 2:])
    assert np.abs(states[0, 1] - states[1, 1]).max() > 1e-3
    assert not np.array_equal(states[0, 2], states[0, 3])


def test_the_motions_of_the_paper_from_its_zero_start(paper):
    """Figs. 16, 18, 19: chaos at K 0.1, P2 at 0.3, P1 at 0.5; section 4 at xi 0.085."""
    axis, values = Axis("delta_T", (50.0,)), np.array([0.1, 0.3, 0.5])
    found = run_survey(
        MotionRunner(), paper, axis, values, Starts(0, 0), RunSettings(600, 100, True)
    )
    period = found.of("period")[0]
    assert period[:, 0].tolist() == [0.0, 2.0, 1.0]
    assert period[2, 1] == 1.0
    exponent = found.of("exponent")[0, :, 0]
    assert exponent[0] > 0.03
    assert (exponent[1:] < 0.0).all()


def test_least_amplitudes_of_the_paper(paper):
    """K 0.315 for P1 by another bisection from the zero start, whatever lies below in pockets."""
    axis, values = Axis("delta_T", (50.0,)), np.linspace(0.2, 0.5, 7)
    survey = run_survey(MotionRunner(), paper, axis, values, Starts(1, 1), RunSettings(600, 100))
    (zero,) = least_amplitudes(MotionRunner(), survey, Target(1, "zero"))
    (every,) = least_amplitudes(MotionRunner(), survey, Target(1, "all"))
    (twice,) = least_amplitudes(MotionRunner(), survey, Target(2, "zero"))
    assert zero.staircase.firm == pytest.approx(0.316, abs=0.01)
    assert zero.half_width == pytest.approx(0.05 / 32)
    assert every.staircase.least >= zero.staircase.least
    assert twice.staircase.firm < zero.staircase.firm - 0.03


def test_what_was_done_is_read_and_not_run_again(paper, tmp_path, monkeypatch):
    axis, values = Axis("delta_T", (50.0,)), np.array([0.4, 0.5])
    ask = (paper, axis, values, Starts(0, 0), RunSettings(50, 50))
    first = run_survey(MotionRunner(tmp_path), *ask)
    (tmp_path / "torn.part").write_bytes(b"half")
    monkeypatch.setattr("herringbone_sim.control.runs.run_batch", None)
    again = run_survey(MotionRunner(tmp_path), *ask)
    for name in Motions.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(first.motions, name), getattr(again.motions, name))


def test_a_gear_that_cannot_be_is_nan_and_the_others_are_not(paper):
    hot = Axis("delta_T", (50.0, 900.0))
    gears = [paper.changed({"delta_T": value, "K": 0.5}) for value in hot.values]
    found = MotionRunner().run(gears, np.zeros((2, 8)), RunSettings(300, 50))
    assert found.period[0] == 1.0
    assert np.isnan(found.period[1])
    assert not repeats(found.period, 1)[1]


def test_without_control_its_order_does_not_count() -> None:
    gear = load_parameters(PAPER).changed({"xi": 0.085, "control_order": 0.6180339887498949})
    axis, K = Axis("delta_T", (100.0,)), np.array([0.0, 0.4])
    survey = run_survey(
        MotionRunner(), gear, axis, K, Starts(0, 0, running=False), RunSettings(200, 80)
    )
    assert survey.reached(Target(1, "zero")).tolist() == [[True, False]]
