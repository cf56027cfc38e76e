"""Ways of getting to a value: the paper's gear keeps to period 1 when it is led there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from sweep_support import axis, gear, run, small

from herringbone_sim.core.batch import run_batch
from herringbone_sim.core.integrate import Stepper, change
from herringbone_sim.core.model import build, carry_over
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.effects.written import read_effects
from herringbone_sim.errors import AnalysisError
from herringbone_sim.sweeps.chains import ramp
from herringbone_sim.sweeps.diagram import Branch, diagram_of
from herringbone_sim.sweeps.grid import Axis, Observation, Sweep, with_sweep_steps
from herringbone_sim.sweeps.observe import section_displacements
from herringbone_sim.sweeps.store import load_result, open_store
from herringbone_sim.views.figures.diagram import _spans, draw_exponents

WARM = axis("delta_T", 70.0, 90.0, 5)
LOOK = Observation(150, 80, 80, False, "sp_L")


@pytest.fixture(scope="module")
def ways(tmp_path_factory: pytest.TempPathFactory):
    folder = tmp_path_factory.mktemp("ways")
    starts = ("fixed", "up", "down", "ramp_up", "ramp_down")
    sweeps = [Sweep(gear(), (WARM,), LOOK, start) for start in starts]
    return diagram_of([run(folder / s.start, s, workers=1) for s in sweeps])


def branches_of(diagram):
    return {branch.start: branch for branch in diagram.branches}


def test_the_ways_differ_where_motions_coexist(ways) -> None:
    """From rest period 2 up to 80 K, but period 1 goes on when one comes from above."""
    branches = branches_of(ways)
    fixed, down = branches["fixed"], branches["down"]
    assert fixed.period.tolist() == [2, 2, 2, 1, 1]
    assert down.period.tolist() == [1, 1, 1, 1, 1]
    assert branches["up"].period.tolist() == [2, 2, 2, 1, 1]
    assert ways.hysteresis().tolist() == [True, True, True, False, False]


def test_a_slow_ramp_follows_the_continuation(ways) -> None:
    branches = branches_of(ways)
    ramped, held = branches["ramp_down"], branches["down"]
    assert ramped.point_values[0, -1] == 70.0
    assert ramped.point_values[-1].tolist() == [90.0] * 80
    assert ramped.point_values[2, 0] == pytest.approx(85.0 - 5.0 / 80)
    assert ramped.points[:, -1] == pytest.approx(held.points[:, -1], abs=0.02)
    assert np.isnan(ramped.period).all()


def test_motions_that_differ_in_their_points_alone_are_told_apart(ways) -> None:
    fixed = branches_of(ways)["fixed"]
    moved = replace(fixed, start="up", points=fixed.points + 0.02)
    assert replace(ways, branches=(fixed, moved)).hysteresis().all()
    shifted = replace(fixed, start="up", points=np.roll(fixed.points, 1, axis=1))
    assert not replace(ways, branches=(fixed, shifted)).hysteresis().any()


@pytest.mark.parametrize("start", ["up", "down"])
def test_a_continuation_starts_where_the_neighbour_ended(tmp_path: Path, start: str) -> None:
    """Over Omega the relative motion is carried over, as in the node."""
    values = axis("Omega", 0.9, 1.0, 3)
    sweep = Sweep(gear(delta_T=90.0), (values,), Observation(5, 5, 5, False, "rp_R"), start)
    found = run(tmp_path, sweep, workers=1)
    models = [build(sweep.parameters_at(i)) for i in range(3)]
    before = None
    for i in (0, 1, 2) if start == "up" else (2, 1, 0):
        starts = None if before is None else carry_over(*before[:1], models[i], before[1], 0.0)
        batch = run_batch([models[i]], None if starts is None else starts[None], 5, 5, 5)
        before = models[i], batch.end[0]
        table = open_store(tmp_path, sweep).read_part(0)
        assert np.array_equal(table["end"][i], batch.end[0])
    assert np.isfinite(found["points"]).all()


def test_a_ramp_goes_through_the_change_of_the_node() -> None:
    path = [gear(K=value) for value in (0.0, 0.1, 0.2)]
    states, model = ramp(path)
    stepper = Stepper(build(path[0]))
    state = stepper.advance(stepper.start(), 1).end
    for one in path[1:]:
        new = build(one)
        state = Stepper(new).advance(change(stepper.model, new, state), 1).end
        stepper = Stepper(new)
    assert np.array_equal(states[-1], state.y)
    assert model.parameters.K == 0.2


def test_a_broken_chain_begins_anew(tmp_path: Path) -> None:
    """Downwards from heat that leaves no backlash, to where there is a gear again."""
    axes = (axis("delta_T", 60.0, 360.0, 3),)
    for start in ("down", "ramp_down"):
        sweep = Sweep(gear(), axes, Observation(5, 5, 5, False, "sp_L"), start)
        found = run(tmp_path / start, sweep, workers=1)
        assert (found.reasons != "").tolist() == [False, True, True]
        fixed = run(tmp_path / "fixed", replace(sweep, start="fixed"), workers=1)
        assert found["points"][0] == pytest.approx(fixed["points"][0], rel=1e-9)


def test_what_is_no_diagram_is_told(tmp_path: Path) -> None:
    result = load_result(open_store(tmp_path, small()))
    with pytest.raises(AnalysisError, match="same values of one parameter"):
        diagram_of([result])


# Nothing hangs on this once a chain goes on: the sweep is one long run of one gear.
STILL = axis("initial_noise", 0.0, 0.1, 3)


@pytest.mark.parametrize("order", [0.5, 0.618])
@pytest.mark.parametrize("start", ["up", "down", "ramp_up", "ramp_down"])
def test_the_control_keeps_its_phase_from_value_to_value(
    tmp_path: Path, start: str, order: float
) -> None:
    base = gear(K=0.3, control_order=order, xi=0.15, delta_T=85.0)
    sweep = Sweep(base, (STILL,), Observation(20, 11, 11, False, "sp_L"), start, chunk=1)
    found = run(tmp_path, sweep, workers=1)["points"][:: -1 if sweep.downwards else 1]
    first = sweep.parameters_at(2 if sweep.downwards else 0)
    whole = run_batch([build(first)], None, 0, 93, 93).sections[0]
    length = 11 if sweep.ramped else 31
    for place, points in enumerate(found):
        end = 31 + place * length
        assert points == pytest.approx(
            section_displacements(sweep, [build(first)], whole[None, end - 11 : end])[0], abs=1e-6
        )


def test_a_ramp_that_stands_still_is_the_motion_itself() -> None:
    p = gear(K=0.3, control_order=0.618, xi=0.15, delta_T=85.0)
    states, _ = ramp([p] * 30)
    assert states[:-1] == pytest.approx(run_batch([build(p)], None, 0, 30, 30).sections[0])


def test_contact_by_runge_kutta_is_that_of_the_series(tmp_path: Path) -> None:
    shares = []
    for method in ("taylor", "rk4"):
        changes = {"method": method, "steps_per_cycle": 400, "samples_per_cycle": 16}
        base = with_sweep_steps(gear().changed(changes), {})
        look = Observation(200, 20, 20, False)
        found = run(tmp_path / method, Sweep(base, (Axis("delta_T", (85.0,)),), look))
        names = ("sun_separated", "sun_drive", "ring_separated", "ring_drive")
        shares.append([found[name][0] for name in names])
    assert 0.2 < shares[0][0] < 0.3
    np.testing.assert_allclose(*shares, atol=0.02)


def test_an_axis_may_replace_what_leaves_the_base_no_backlash(tmp_path: Path) -> None:
    base, look = gear(b=0.1, delta_T=300.0), Observation(5, 5, 5, False)
    found = run(tmp_path, Sweep(base, (Axis("delta_T", (0.0, 10.0)),), look, "up"))
    assert found.reasons[0] == ""
    crack = read_effects("tooth_crack@sp/all/L:depth=0.3")
    Sweep.of_gear(base, crack, (Axis("delta_T", (0.0,)),), look)


def test_periods_do_not_depend_on_the_values_beside(tmp_path: Path) -> None:
    base = with_sweep_steps(Parameters(K=0.3, delta_T=20.0), {})
    orders, look = Axis("control_order", (1.0, 1.02)), Observation(100, 100, 100, False)
    alone, together = (
        run(tmp_path / str(chunk), Sweep(base, (orders,), look, "fixed", chunk))["period"]
        for chunk in (1, 256)
    )
    np.testing.assert_array_equal(alone, together)
    assert np.isfinite(alone[0])


def test_a_ramp_that_begins_anew_after_a_failure_is_drawn_at_its_value(tmp_path: Path) -> None:
    values, look = Axis("delta_T", (80.0, 100.0, 200.0)), Observation(20, 10, 10, False, "sp_L")
    (branch,) = diagram_of([run(tmp_path, Sweep(gear(), (values,), look, "ramp_down"))]).branches
    assert branch.reasons[2]
    assert not branch.reasons[1]
    assert (branch.point_values[1] == 100.0).all()
    assert (branch.point_values[0][0], branch.point_values[0][-1]) == (98.0, 80.0)


def test_grey_reaches_half_way_to_the_neighbours_on_uneven_axes() -> None:
    chosen = np.array([False, True, False, False, False])
    assert _spans((0.0, 0.01, 0.02, 0.03, 1.0), chosen) == [pytest.approx((0.005, 0.015))]


def test_no_legend_names_a_curve_that_is_not_there() -> None:
    """As of gears whose halves are unlike, which have no exponent of left against right."""
    x, none = np.arange(3.0), np.full(3, np.nan)
    columns = x[:, None], x[:, None], x, x, none, none, x
    axes = Figure().subplots()
    draw_exponents(axes, [Branch("fixed", x, *columns, ("",) * 3)])
    assert [t.get_text() for t in axes.get_legend().get_texts()] == ["of all perturbations"]
