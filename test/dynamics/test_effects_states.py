"""Gears whose effects add states, as a flexible ring or a loose pin: all methods take them."""

from __future__ import annotations

import csv
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from gears import PAPER, dimensionless, samples, state_at

from herringbone_sim.__main__ import main
from herringbone_sim.cli.control_parts import Size
from herringbone_sim.control.runs import MotionRunner, RunSettings
from herringbone_sim.control.starts import Starts, start_states
from herringbone_sim.core.batch import run_batch
from herringbone_sim.core.model import divergence
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.dynamics.basins import explore, gear_sections, random_starts
from herringbone_sim.dynamics.exponent_methods import compare_exponents
from herringbone_sim.dynamics.flow import GearFlow, settle, symmetry
from herringbone_sim.dynamics.gear_family import gear_family
from herringbone_sim.dynamics.portraits import portrait
from herringbone_sim.dynamics.turning import _trajectory, border_passes, section
from herringbone_sim.effects.assemble import build_with, by_laws
from herringbone_sim.effects.written import read_effects

RING, PIN = "ring_flexibility@rp:stiffness=3e9", "bearing_clearance:clearance=5e-6"
CRACK = "tooth_crack@sp/all/L:depth=0.3"
TINY = Size(2, 3, 4, (0.5, 1.0), 2, RunSettings(transient=40, cycles=40))


def gear(text: str, **values: object):
    return build_with(Parameters(**{"delta_T": 85.0, **values}), read_effects(text))


@pytest.mark.parametrize(("text", "own_laws"), [(RING, False), (PIN, False), (RING, True)])
def test_the_flow_leads_from_each_section_point_to_the_next(text: str, own_laws: bool) -> None:
    model = gear(text)
    model = by_laws(model, model.effects) if own_laws else model
    batch = run_batch([model], transient=20, cycles=5, points=5)
    points, flow = [*batch.sections[0], batch.end[0]], GearFlow(model, 1)
    assert np.abs(points[0][model.layout.n_state :]).max() > 1e-4
    for cycle, (now, then) in enumerate(pairwise(points), start=20):
        found, _ = flow.advance(now, np.zeros((0, flow.n)), cycle)
        np.testing.assert_allclose(found, then, atol=1e-8)


@pytest.mark.parametrize("text", [RING, PIN])
def test_halves_that_are_alike_stay_so_to_the_bit(text: str) -> None:
    flow = GearFlow(gear(text, delta_T=20.0), 1)
    exchange = symmetry(flow.model)
    y = settle(flow, flow.start(), 300)
    assert np.array_equal(y, y[exchange])
    lopsided = gear(text.replace(":", "/all/L:") if text == RING else f"{CRACK}; {text}")
    assert symmetry(lopsided) is None


@pytest.mark.parametrize("text", [RING, PIN])
def test_basins_of_a_gear_with_states_of_effects(text: str) -> None:
    """All starts lead to the motion from rest, whose portrait goes on where the section ends."""
    model, rng = gear(text, xi=0.17), np.random.default_rng(0)
    found = explore(gear_sections(model, 400, 60), random_starts(model, 3, rng), symmetry(model))
    (attractor,) = found.attractors
    assert attractor.symmetry == "left = right"
    assert attractor.points.shape == (attractor.period, model.n_state)
    shown = portrait(model, attractor.points[-1], 459)
    assert np.ptp(shown.left[:: 64 * attractor.period], axis=0).max() < 1e-2


@pytest.mark.parametrize("text", [RING, PIN])
def test_the_sum_of_the_exponents_is_the_loss_by_all_damping(text: str) -> None:
    found = compare_exponents(gear(text), 300, 100)
    assert float(found.spectrum.exponents.sum()) == pytest.approx(found.divergence, rel=1e-8)
    assert found.symmetric is not None


def test_a_loss_that_hangs_on_the_motion_is_not_told() -> None:
    for text in ("tooth_friction:mu=0.08", "damping_law:share=0.4,power=0,depth=1e-5"):
        assert np.isnan(divergence(gear(text)))


@pytest.mark.parametrize("text", [RING, PIN])
def test_an_orbit_is_in_contact_as_the_kernel_says(text: str) -> None:
    """The deflections along it contain what a ring or a pin moves away."""
    model = gear(text)
    flow = GearFlow(model)
    points = settle(flow, flow.start(), 400)[None]
    x, _ = _trajectory(flow, points)
    batch = run_batch([model], points, transient=0, cycles=1, points=1)
    np.testing.assert_allclose(
        (x > model.packed.b).mean(axis=0), batch.contact[0, :, 2], atol=0.02
    )
    assert sum(border_passes(flow, points, symmetry(model)).values()) > 0
    channels = dimensionless(model, samples(model, 1, state_at(points[0])).rows[0])
    np.testing.assert_allclose(np.hstack(section(flow, points)), channels[None], atol=1e-12)


def test_a_family_is_symmetric_only_if_it_is_so_within_its_range_too() -> None:
    """Softening of one half by (delta_T / 25 K - 1) delta_T vanishes at both ends of the range."""
    p = Parameters()
    assert gear_family(p, "delta_T", 0.0, 25.0, read_effects(RING))[0].mirror is not None
    soft = read_effects("thermal_stiffness@all/all/L:rate=1e-3,curvature=2")
    assert gear_family(p, "delta_T", 0.0, 25.0, soft)[0].mirror is None


def test_the_survival_of_a_motion_with_a_flexible_ring(tmp_path: Path) -> None:
    command = ["survival", "--over=xi", "--from=0.17", "--to=0.18", "--values=2", "--starts=2"]
    options = ["--transient=300", "--workers=1", f"--parameters={PAPER}", "--set=delta_T=85"]
    assert main([*command, *options, f"--effects={RING}", f"--out={tmp_path}"]) == 0
    with (tmp_path / "survival.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["motion"] for row in rows] == ["P1", "P1"]
    assert all(float(row["transverse"]) < 0.0 for row in rows)


def test_control_of_a_gear_with_a_flexible_ring(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("herringbone_sim.cli.control.QUICK", TINY)
    command = ["control", "--only=amplitude,robustness", "--quick", "--workers=1"]
    assert main([*command, f"--effects={RING}", f"--out={tmp_path}"]) == 0
    assert "ring_flexibility" in capsys.readouterr().out
    assert (tmp_path / "amplitude.csv").is_file()


@pytest.mark.parametrize("text", [RING, CRACK])
def test_a_running_gear_goes_on_when_the_control_is_switched_on(text: str) -> None:
    """With the states of its effects, and at their phase: a periodic motion stays as it is."""
    runner, p = MotionRunner(actives=read_effects(text)), Parameters(delta_T=85.0)
    starts = start_states(runner, [p], Starts(0, 0))[0]
    model = runner.build(p)
    assert starts.shape == (2, model.n_state)
    flow = GearFlow(model)
    once, _ = flow.advance(starts[1], np.zeros((0, flow.n)))
    np.testing.assert_allclose(once, starts[1], atol=1e-3)
