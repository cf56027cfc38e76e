"""States of short windows that fit three rotations, and what a change of the law does to them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gap_support import column_of

from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.diagnosis.search import Search
from herringbone_sim.gap.data.kinematics import inverse_masses
from herringbone_sim.gap.data.rotations import (
    detrended_rotations,
    with_rotations,
    without_angles_not_in_rad,
)
from herringbone_sim.gap.observations.body_motion import static_rotations
from herringbone_sim.gap.observations.friction import OF_COULOMB
from herringbone_sim.gap.observations.gear import GearObservations
from herringbone_sim.gap.observations.gear_machine import GearMachine
from herringbone_sim.gap.observations.law_changes import NO_LAW
from herringbone_sim.gap.observations.windows import starts as window_starts
from herringbone_sim.gap.observations.windows import trajectory as trajectory_module
from herringbone_sim.gap.observations.windows import windows
from herringbone_sim.gap.observations.windows.channels import channel_outputs, window_channels
from herringbone_sim.gap.observations.windows.columns import (
    body_forces,
    nuisance_columns,
)
from herringbone_sim.gap.observations.windows.elimination import StateElimination
from herringbone_sim.gap.observations.windows.integrator import STATES, Forcing
from herringbone_sim.gap.observations.windows.restarts import misfits, restarted
from herringbone_sim.gap.observations.windows.shooting import (
    WindowSolution,
    evaluated,
    fitted_loosely_first,
    fitted_windows,
    stacked_residual,
    symmetric_starts,
    window_jacobian,
)
from herringbone_sim.gap.observations.windows.starts import filter_and_fit
from herringbone_sim.gap.observations.windows.trajectory import (
    MAX_FAILED,
    STATE_PRECISION,
    Trajectory,
)
from herringbone_sim.gap.observations.windows.windows import JUMP_SD, Windows
from herringbone_sim.gap.residuals.mesh_law import LawChange, law, select_meshes
from herringbone_sim.gap.sensors.detrended import with_nominal_means
from herringbone_sim.practice.arrays import as_prepared
from herringbone_sim.practice.campaign import make_campaign
from herringbone_sim.practice.plan import draw_plan


@pytest.fixture(scope="module")
def gear() -> GearObservations:
    """A healthy practice rig of which three rotations are recorded, at a hundredth of noise."""
    made = as_prepared(make_campaign(draw_plan(600001, "none", channels="few")))
    return GearObservations(made.of_role("fit"))


@pytest.fixture(scope="module")
def one(gear: GearObservations) -> tuple[Trajectory, WindowSolution]:
    """A run whose planets move in step, at the states that fit it."""
    trajectory = gear.trajectories[1]
    return trajectory, trajectory.nominal


def rows(shot: WindowSolution) -> np.ndarray:
    return stacked_residual(shot)


def test_windows_are_formed_where_nothing_else_is(gear: GearObservations) -> None:
    assert gear.observation_names == ("trajectory",)


def test_rotations_without_mean_and_trend_are_followed_as_well(gear: GearObservations) -> None:
    """Raw angles lack the wind-up under the load; it is found with the motion.

    The nominal gear tells it 8.6 um off, of 79 um; what is estimated is right within 1 um.
    """
    trajectory, run = gear.trajectories[2], gear.runs[2].run
    at = run.times - run.times.mean()
    lines = np.polynomial.polynomial.polyfit(at, run.u.values[:, :3], 1)
    values = run.u.values.copy()
    values[:, :3] -= np.polynomial.polynomial.polyval(at, lines).T
    raw = replace(run, u=replace(run.u, values=values), detrended=("u_s_L", "u_s_R", "u_c"))
    nominal = with_nominal_means(raw)
    found = Trajectory(nominal)
    assert found.nominal.cost == pytest.approx(trajectory.nominal.cost, rel=0.1)
    mean = found.recorded.trend_values(found.nominal.trends).mean(axis=(0, 1))
    wind_up = np.array([0.5, 0.5, -2.0])
    right, guess = (wind_up @ one.u.values[:, :3].mean(axis=0) for one in (run, nominal))
    assert abs(guess - right) > 5e-6
    assert guess - wind_up @ mean == pytest.approx(right, abs=1e-6)


def test_raw_angles_become_rotations_about_the_steady_one(gear: GearObservations) -> None:
    """Wrapped or not, from any mark; a rotation that is recorded too stays as it is."""
    run, sc = gear.runs[0].run, gear.model.scales
    turn = run.phase / gear.model.parameters.z_r
    angle = turn + run.u.values[:, 2] / sc.r_bc + 1.7
    names = ("phase", "angle_c", "angle_s_L", "u_s_L")
    wrapped = np.mod(angle, 2.0 * np.pi)
    columns = np.column_stack([run.phase, wrapped, angle, run.u.values[:, 0]])
    series, made = with_rotations(gear.model, TimeSeries(run.times, columns, names))
    assert (made, series.names) == (("u_c",), ("phase", "angle_s_L", "u_s_L", "u_c"))
    line = np.polynomial.Polynomial.fit(run.times, run.u.values[:, 2], 1)(run.times)
    np.testing.assert_allclose(series["u_c"], run.u.values[:, 2] - line, atol=1e-10)
    assert detrended_rotations(series, ("u_c",)) == ("u_c",)
    assert detrended_rotations(series, ("u_c", "u_s_L")) == ()
    rounded = TimeSeries(run.times, np.round(1e9 * series["u_c"])[:, None] / 1e9, ("u_c",))
    assert detrended_rotations(rounded, ("u_c",)) == ("u_c",)
    assert detrended_rotations(rounded, ("u_s_R",)) == ()


def test_angles_in_other_units_are_named_each_with_its_own() -> None:
    """Those without a unit, or in rad, stay."""
    names = ("phase", "angle_s_L", "angle_s_R", "angle_c", "angle_p1_L")
    series = TimeSeries(np.arange(3.0), np.zeros((3, 5)), names)
    units = {"angle_s_L": "deg", "angle_s_R": "rad", "angle_c": "turns"}
    left, (finding,) = without_angles_not_in_rad("run_00", series, units)
    assert left.names == ("phase", "angle_s_R", "angle_p1_L")
    assert finding.channels == ("angle_s_L", "angle_c")
    assert "angle_s_L in deg, angle_c in turns" in finding.text


def test_states_of_a_healthy_rig_leave_the_noise(one: tuple[Trajectory, WindowSolution]) -> None:
    """72 numbers of a window for 18 states: a fourth of the noise is taken up by the states."""
    _, shot = one
    assert 0.6 < np.mean(shot.residuals**2) < 1.1
    assert np.sqrt(np.mean(shot.jumps**2)) < JUMP_SD


@pytest.fixture(scope="module", params=[(0, 0), (10, 0), (10, 1), (21, 0)])
def stuck(
    one: tuple[Trajectory, WindowSolution], request: pytest.FixtureRequest
) -> WindowSolution:
    """Three windows whose planets are far from their states: the fit does not find back."""
    trajectory, shot = one
    s, planets = trajectory.recorded, np.array([*range(3, 9), *range(12, 18)])
    first, seed = request.param
    starts = shot.starts.copy()
    off = np.random.default_rng(seed).standard_normal((3, len(planets)))
    starts[first : first + 3, planets] += 3.0 * off * s.scale[planets]
    fit = fitted_windows(s, starts, shot.integrator.forcing, trends=shot.trends)
    assert fit.cost > 2.0 * shot.cost
    return fit


def test_windows_in_a_local_minimum_are_restarted(
    one: tuple[Trajectory, WindowSolution], stuck: WindowSolution
) -> None:
    trajectory, shot = one
    (group,) = misfits(trajectory.recorded, stuck)
    anew = restarted(trajectory.recorded, stuck, group, 0)
    assert anew is not None
    assert anew.cost == pytest.approx(shot.cost, rel=0.02)


def test_the_fits_of_a_run_restart_such_windows(
    one: tuple[Trajectory, WindowSolution],
    stuck: WindowSolution,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Under the nominal law from the first states, and under a change from those fitted last."""
    trajectory, shot = one
    monkeypatch.setattr(trajectory_module, "filter_and_fit", lambda *windows: stuck)
    monkeypatch.setattr(trajectory_module, "misses_much", lambda *fit: False)  # no new pass
    other = Trajectory(trajectory.run)
    assert other.nominal.cost == pytest.approx(shot.cost, rel=0.02)
    other.memory.known(("same",)).best = stuck.fitted
    again = other.fitted_states(("same",), lambda motion: LawChange(), {})
    assert again.cost == pytest.approx(shot.cost, rel=0.02)


def test_noise_makes_no_window_a_misfit(gear: GearObservations) -> None:
    """Nor does a law off by its tolerances: no fit of the nominal law has one to be restarted."""
    for trajectory in gear.trajectories:
        t, lead = trajectory, trajectory._with_lead
        forcing = [w.forcing(LawChange(), np.ones(9), ()) for w in (t, lead)]
        fit = filter_and_fit(t.recorded, forcing[0], lead.recorded, forcing[1])
        assert not misfits(t.recorded, fit)


def test_restarts_that_gain_nothing_are_not_repeated(gear: GearObservations) -> None:
    """One reading that no state explains: a try at every fit would cost more than the fits."""
    run = gear.runs[1].run
    values = run.u.values.copy()
    t = Trajectory(run)
    at = (t.lead_windows + 5) * t.recorded.samples_per_window + 3
    values[at, 0] += 30.0 / t.recorded.weight[5, 3, 0]
    spoiled = Trajectory(replace(run, u=replace(run.u, values=values)))
    assert misfits(spoiled.recorded, spoiled.nominal)[0] == (5, 5)
    assert len(spoiled.memory.failures) == 1
    for i in range(MAX_FAILED + 1):
        spoiled.fitted_states((str(i),), lambda motion: LawChange(), {})
    assert len(spoiled.memory.failures) == MAX_FAILED


def test_steps_miss_no_more_than_is_counted_as_noise(
    one: tuple[Trajectory, WindowSolution], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Against steps of an eighth; noise of less than that would make a healthy rig look sick."""
    trajectory, shot = one
    s = trajectory.recorded
    monkeypatch.setattr(windows, "STEP_RAD", windows.STEP_RAD / 8.0)
    finely = Trajectory(trajectory.run)
    drive = finely.forcing(LawChange(), np.ones(9), ())
    again = evaluated(finely.recorded, shot.starts, drive, shot.trends)
    off = again.residuals - shot.residuals
    size = np.sqrt(np.nanmean(s.channels.values**2, axis=0))
    missed = np.sqrt(np.mean((off / s.weight) ** 2, axis=(0, 1))) / size
    assert 1e-5 < missed.max() < windows.INTEGRATION_ERROR


def dense_jacobian(s: Windows, shot: WindowSolution) -> np.ndarray:
    n = s.n_windows * STATES
    return window_jacobian(s, shot).times(np.eye(n).reshape(s.n_windows, STATES, n))


def test_the_jacobian_of_windows_is_that_of_differences(
    one: tuple[Trajectory, WindowSolution],
) -> None:
    """A window's start moves its readings and the ties at both of its ends, nothing else."""
    s = one[0].windows
    forcing = one[0].forcing(LawChange(), np.ones(9), ())
    shot = evaluated(s, symmetric_starts(s), forcing)
    J, step = dense_jacobian(s, shot), 1e-7
    for window, state in ((0, 2), (3, 11)):
        starts = shot.starts.copy()
        starts[window, state] += step * s.scale[state]
        moved = (rows(evaluated(s, starts, forcing)) - rows(shot)) / step
        column = J[:, window * STATES + state]
        np.testing.assert_allclose(-moved, column, atol=1e-3 * abs(column).max())


def test_states_are_eliminated_as_by_a_dense_solution(
    one: tuple[Trajectory, WindowSolution],
) -> None:
    """Products of what is left are those with states and nuisances marginalised."""
    trajectory, shot = one
    s, J = trajectory.windows, dense_jacobian(trajectory.windows, shot)
    waves, sizes = nuisance_columns(s)
    states = StateElimination(window_jacobian(s, shot), waves, sizes, STATE_PRECISION)
    values = np.random.default_rng(0).normal(size=(len(J), 3))
    N = np.hstack([J, waves])
    prior = np.append(np.full(J.shape[1], STATE_PRECISION), sizes**-2.0)
    normal = N.T @ N + np.diag(prior)
    expected = values.T @ values - values.T @ N @ np.linalg.solve(normal, N.T @ values)
    cleared = states.clear(values)
    np.testing.assert_allclose(cleared.T @ cleared, expected, rtol=1e-6, atol=1e-3)
    read = J[: s.measured.size]
    of_states = J.T @ J + STATE_PRECISION * np.eye(J.shape[1])
    used = np.trace(read @ np.linalg.solve(of_states, read.T))
    assert states.leverage() == pytest.approx(used, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "step", "within"),
    [
        ("kappa", 1e-3, 0.01),
        ("gamma", 1e-3, 0.01),
        ("k 2 sin", 1e-3, 0.03),
        # Contact is met within a step, and these act while it lasts alone.
        ("b_plus", 1e-8, 0.15),
        ("e 3 cos", 1e-9, 0.15),
    ],
)
def test_columns_of_the_law_are_differences(
    gear: GearObservations,
    one: tuple[Trajectory, WindowSolution],
    name: str,
    step: float,
    within: float,
) -> None:
    trajectory, shot = one
    amplitudes = np.zeros(12)
    amplitudes[7] = step
    change = gear.change_of(trajectory._motion_at_half_steps(shot), {name: amplitudes})
    drive = trajectory.forcing(change, np.ones(9), ())
    check(trajectory, gear, shot, f"{name} of 7", step, within, drive)


def test_a_law_that_drifts_within_a_run_is_predicted(
    gear: GearObservations, one: tuple[Trajectory, WindowSolution]
) -> None:
    """A stiffness that grows with time adds what one of the responses is, but for its size."""
    trajectory, shot = one
    m = trajectory._motion_at_half_steps(shot)
    forcing = trajectory.forcing(LawChange(), np.ones(9), ())
    k = forcing.k.copy()
    k[:, 7] *= 1.0 + 1e-3 * ((m.times - m.times[0]) / np.ptp(m.times) - 0.5)
    constant, drifting = (
        rows(evaluated(trajectory.windows, shot.starts, f))
        for f in (forcing, forcing._replace(k=k))
    )
    block = trajectory.block(shot, lambda m: LawChange(), gear.law_functions, ())
    added = trajectory.last_elimination.clear((constant - drifting)[:, None])[:, 0]
    responses = trajectory.regression_inputs(block, gear.law_functions).responses
    assert responses is not None
    made = responses[:, 0]
    alike = (added @ made) / np.linalg.norm(added) / np.maximum(np.linalg.norm(made, axis=0), 1e-9)
    assert np.max(alike) > 0.98


@pytest.mark.parametrize(
    ("name", "step"),
    [(f"friction {shape} of 2", 1e-4) for shape in ("sign", "sin 1", "lever", "load", "elastic")]
    + [("friction lever of 8", 1e-4), ("ripple 3 cos", 0.1)]
    + [(f"M_{body}", 1e-4) for body in "spc"],
)
def test_columns_of_bodies_are_differences(
    gear: GearObservations, one: tuple[Trajectory, WindowSolution], name: str, step: float
) -> None:
    trajectory, shot = one
    m = trajectory._motion_at_half_steps(shot)
    pushes = [(push, step) for push in body_forces(trajectory.run, m, lambda: law(m), [name])]
    drive = trajectory.forcing(LawChange(), trajectory.masses({name: step}), pushes)
    check(trajectory, gear, shot, name, step, 0.01, drive)


def test_functions_say_whether_they_depend_on_the_law(
    gear: GearObservations, one: tuple[Trajectory, WindowSolution]
) -> None:
    """Without the law, those that say that they don't give what they give with it."""
    m = one[0].motion(one[1].states_of_all, one[0].windows.phase[::2])
    now, by_law = law(m, LawChange(kappa=0.1, b_plus=1e-6)), set()
    for f in gear.law_functions:
        if f.by_law:
            by_law.add(f.name)
            continue
        for values in (f.values, f.rate):
            if values is not None:
                np.testing.assert_array_equal(values(m, NO_LAW), values(m, now))
    assert {"kappa load 0", "gamma load 0", "gamma free", "F gain"} <= by_law


def test_friction_does_not_slow_the_gear_down(one: tuple[Trajectory, WindowSolution]) -> None:
    """Coulomb's friction and the load that goes with it do no work on the rigid rotation."""
    trajectory, shot = one
    m = trajectory._motion_at_half_steps(shot)
    names = [f"friction {shape} of 1" for shape in OF_COULOMB]
    pushes = body_forces(trajectory.run, m, lambda: law(m), names)
    work = {p.name: p.size.mean() * (p.direction @ [2, 2, *[1] * 7]) for p in pushes}
    assert work[names[0]] == pytest.approx(0.0, abs=1e-9)  # no sliding at the pitch point
    assert work[names[1]] < -0.1
    assert sum(work.values()) == pytest.approx(0.0, abs=1e-9)


def test_rotations_may_lack_a_common_parabola(gear: GearObservations) -> None:
    s = gear.trajectories[0].recorded
    (wave,) = (w.reshape(-1, len(s.channels.names)) for w in s.trends.wave)
    np.testing.assert_allclose(np.diff(wave, 3, axis=0), 0.0, atol=1e-12)
    assert np.all(np.diff(wave, 2, axis=0) > 0.0)
    sun, carrier = (s.channels.names.index(name) for name in ("u_s_L", "u_c"))
    np.testing.assert_allclose(wave[:, sun], 2.0 * wave[:, carrier])


def test_what_channels_show_changes_with_the_state_as_told(gear: GearObservations) -> None:
    made = as_prepared(make_campaign(draw_plan(600001, "none", channels="shafts_pins")))
    run = made.of_role("fit")[0]
    c = window_channels(replace(run, a=replace(run.u)))  # accelerations where rotations are
    trajectory = gear.trajectories[0]
    drive = trajectory.forcing(LawChange(), np.ones(9), ())
    at = np.zeros((1, 1), dtype=np.int64)
    rng = np.random.default_rng(0)
    state = 3e-5 * np.repeat([1.0, 1e4], 9) * rng.normal(size=18)
    value, slope = channel_outputs(c, state[None, None], drive, at)
    step = 1e-9 * np.repeat([1.0, 1e4], 9) * rng.normal(size=18)
    after, _ = channel_outputs(c, (state + step)[None, None], drive, at)
    np.testing.assert_allclose((after - value)[0, 0], slope[0, 0] @ step, rtol=1e-6)
    assert [name[0] for name in c.names] == ["u"] * 3 + ["F"] * 3 + ["a"] * 3


def check(
    trajectory: Trajectory,
    gear: GearObservations,
    shot: WindowSolution,
    name: str,
    step: float,
    within: float,
    forcing: Forcing,
) -> None:
    """A column against the motion from the same states under a small change."""
    s = trajectory.windows
    base = evaluated(s, shot.starts, trajectory.forcing(LawChange(), np.ones(9), ()))
    moved = evaluated(s, shot.starts, forcing)
    difference = (rows(base) - rows(moved)) / step
    column = column_of(trajectory, gear, base, name)
    off = np.linalg.norm(difference - column)
    assert off < within * np.linalg.norm(difference)


def test_more_windows_tell_the_tolerances_more_closely(gear: GearObservations) -> None:
    """Three times the values: standard deviations fall by the root of 3 at most."""
    few = GearMachine(gear.for_runs([g.run for g in gear.runs[1:3]]))
    many = few.with_more_values()
    assert many.gear.trajectory_of(0).recorded.n_windows == windows.MORE_WINDOWS
    assert many.with_more_values() is None
    known = [np.sqrt(np.diag(Search(one).null.covariance)) for one in (few, many)]
    ratio = known[1] / known[0]
    assert ratio.max() < 1.02
    assert 0.5 < ratio.min() < 0.75


def test_windows_are_made_once_for_all_copies_of_a_gear(gear: GearObservations) -> None:
    """A second making costs a second a run and throws away the states that were found."""
    made = gear.trajectories
    whole = gear.for_runs([gear.runs[1].run, gear.runs[0].run])
    assert whole.trajectory_of(0) is made[1]
    assert (
        gear.with_functions([]).trajectory_of(0) is gear.trajectory_of(0) is whole.trajectory_of(1)
    )


def test_a_change_under_which_the_motion_diverges_explains_nothing(gear: GearObservations) -> None:
    """A million times the stiffness: no state follows the readings, and nothing ends."""
    trajectory = Trajectory(gear.runs[1].run)
    found = trajectory.fitted_states(("absurd",), lambda _: LawChange(kappa=np.array(1e6)), {})
    assert found is trajectory.nominal
    block = trajectory.block(found, lambda _: LawChange(), (), ())
    assert np.isfinite(block.residual).all()


def test_states_far_apart_are_eliminated_all_the_same(
    one: tuple[Trajectory, WindowSolution],
) -> None:
    """Entries that differ by forty orders leave the normal matrix indefinite by rounding."""
    trajectory, shot = one
    s = trajectory.windows
    wild = replace(shot, slope=shot.slope * np.logspace(0, 20, STATES))
    states = StateElimination(window_jacobian(s, wild), *nuisance_columns(s), STATE_PRECISION)
    assert np.isfinite(states.clear(rows(shot)[:, None])).all()


def test_static_rotations_are_those_about_which_rotations_are_recorded(
    gear: GearObservations,
) -> None:
    """Planets follow from shafts as in ``symmetric_starts``, at rest."""
    run = gear.runs[0].run
    u, M = static_rotations(run), 1.0 / inverse_masses(run.model)
    planets = -(2.0 * u[:2] @ M[:2] + u[2] * M[2]) / M[3:].sum()
    assert u[3:] == pytest.approx(planets)


def test_noise_of_single_samples_is_selected_with_its_mesh(gear: GearObservations) -> None:
    m = gear.runs[0].motion
    noise = np.arange(m.x.size, dtype=float).reshape(m.x.shape)
    some, _ = select_meshes(replace(m, sigma_x=noise), LawChange(), np.array([2, 5]))
    np.testing.assert_array_equal(some.sigma_x, noise[:, [2, 5]])


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_states_in_a_local_minimum_are_fitted_with_loose_ties_first(
    one: tuple[Trajectory, WindowSolution], seed: int
) -> None:
    """All windows start 0.3 of the motion off; tied at once, they hinder one another."""
    trajectory, shot = one
    s, forcing = trajectory.recorded, shot.integrator.forcing
    off = np.random.default_rng(seed).standard_normal(shot.starts.shape)
    tied = fitted_windows(s, shot.starts + 0.3 * off * s.scale, forcing, trends=shot.trends)
    assert tied.cost > 1.1 * shot.cost
    loose = fitted_loosely_first(s, tied, forcing)
    assert loose.cost == pytest.approx(shot.cost, rel=0.02)
    assert loose.jump_sd == JUMP_SD


@pytest.mark.parametrize(("factor", "tried"), [(1.0, 1), (-5.0, 3)])
def test_where_much_is_missed_the_run_is_filtered_with_more_noise(
    one: tuple[Trajectory, WindowSolution],
    factor: float,
    tried: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Starts of the first filter are multiplied; where they are right, their fit is taken."""
    trajectory, shot = one
    lead = trajectory._with_lead
    forcing = [w.forcing(LawChange(), np.ones(9), ()) for w in (trajectory, lead)]
    filtered, passes = window_starts.filtered_starts, []

    def astray(s: Windows, drive: Forcing, first: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        passes.append(s.jump_sd)
        starts, cost = filtered(s, drive, first)
        return starts * (factor if s.jump_sd == JUMP_SD else 1.0), cost

    monkeypatch.setattr(window_starts, "filtered_starts", astray)
    fit = filter_and_fit(trajectory.recorded, forcing[0], lead.recorded, forcing[1])
    assert fit.cost < 1.2 * shot.cost
    assert passes == [JUMP_SD, *window_starts.FILTER_JUMP_SD][:tried]


def test_a_run_whose_fits_all_diverge_keeps_the_first(
    one: tuple[Trajectory, WindowSolution], monkeypatch: pytest.MonkeyPatch
) -> None:
    trajectory, shot = one
    lead = trajectory._with_lead
    forcing = [w.forcing(LawChange(), np.ones(9), ()) for w in (trajectory, lead)]
    lost = replace(shot, residuals=np.full_like(shot.residuals, np.nan))
    monkeypatch.setattr(window_starts, "fitted_windows", lambda *windows, **trends: lost)
    fit = filter_and_fit(trajectory.recorded, forcing[0], lead.recorded, forcing[1])
    assert fit is lost
