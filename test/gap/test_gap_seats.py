"""Parts on their own seats: motion by another integrator, a hardening spring, no forces; teeth."""

from __future__ import annotations

import numpy as np
import pytest
from gap_support import NOMINAL, POINTS, no_effect, prepared, rig, sampled, with_few_runs
from scipy.integrate import solve_ivp
from scipy.special import expit

from herringbone_sim.diagnosis.coefficients import amplitudes
from herringbone_sim.diagnosis.machine import Hypothesis
from herringbone_sim.diagnosis.products import products
from herringbone_sim.diagnosis.search import MIN_GAIN_PER_VALUE, Search
from herringbone_sim.effects.effect import Locus
from herringbone_sim.gap.diagnose import diagnose, machine_of
from herringbone_sim.gap.observations.body_motion import body_loads
from herringbone_sim.gap.observations.gear import GearObservations
from herringbone_sim.gap.observations.gear_machine import GearMachine
from herringbone_sim.gap.observations.hypotheses import moving_part_motion
from herringbone_sim.gap.observations.hypotheses.moving_part_motion import (
    DIVERGED_M,
    MeshLoads,
    SeatSpring,
    motion_with_slopes,
    motions,
)
from herringbone_sim.gap.observations.hypotheses.moving_parts import MovingPart, PartDrive
from herringbone_sim.gap.observations.runs import gear_run
from herringbone_sim.gap.observations.searches.moving_part_grid import (
    GRIDS,
    PartTrial,
    best_parts,
    proposals,
)
from herringbone_sim.gap.residuals.mesh_law import LawChange, law
from herringbone_sim.gap.sensor_calibration import calibrated_sensors
from herringbone_sim.practice.arrays import as_prepared
from herringbone_sim.practice.campaign import make_campaign
from herringbone_sim.practice.trial import Setting, plan_of

COS_BETA = 0.96
OMEGA = 6000.0  # [rad/s] of the motion that drives


SEATS = pytest.mark.parametrize(
    "spring",
    [
        SeatSpring(20.0, np.inf, 1e10, 2e4, growth=4e9, drag=3.0),
        SeatSpring(4.0, 30.0, 1e11, 1e5, play=5e-6, width=1e-6),
        SeatSpring(4.0, 30.0, 1e11, 1e5, play=5e-6, width=1e-6, film=0.2),
        SeatSpring(4.0, 30.0, 1e11, 5e5, play=5e-6, width=1e-6, film=20.0),
    ],
    ids=["ring", "pin", "pin in thin oil", "pin in thick oil"],
)


def driving_meshes(n: int) -> MeshLoads:
    """Two meshes of sinusoidal motion that loses contact, at 128 samples a period."""
    step = 2.0 * np.pi / OMEGA / 128.0
    t, one = np.arange(n) * step, np.ones((n, 2))
    return MeshLoads(
        6e-5 + 4e-5 * np.cos(OMEGA * t)[:, None] * np.array([1.0, 0.8]),
        -4e-5 * OMEGA * np.sin(OMEGA * t)[:, None] * np.array([1.0, 0.8]),
        np.array([1.5e9, 1.2e9]) * one,
        2e3 * one,
        4e-5 * one,
        4e-5 * one,
        0.0 * one,
        np.full(2, 1e-12),
        -3e4 + 0.0 * t,
        step,
    )


@SEATS
def test_a_part_moves_as_its_equation_says(spring: SeatSpring) -> None:
    """DOP853 on the same equation, meshes that lose contact: equal to a part in a hundred."""
    meshes = driving_meshes(1500)
    t, rest = np.arange(1500) * meshes.step, meshes.rest[0]
    b, k, c = meshes.plus[0, 0], meshes.k[0], meshes.c[0]
    softer = spring._replace(stiffness=0.5 * spring.stiffness)
    found, other = motions(meshes, [spring, softer], COS_BETA)
    assert not np.allclose(other, found, rtol=0.05)

    def seat(q: float, rate: float) -> float:
        if spring.width:
            ends = np.logaddexp(0.0, (np.array([q, -q]) - spring.play) / spring.width)
            g = spring.width * float(ends[0] - ends[1])
        else:
            g = max(q - spring.play, 0.0) - max(-q - spring.play, 0.0)
        hold = spring.stiffness * g * (1.0 + spring.growth * g * g)
        damping = spring.damping * (1.0 + spring.drag * abs(rate))
        if spring.film != 1.0:
            held = np.sum(expit((np.array([q, -q]) - spring.play) / spring.width))
            damping *= spring.film + (1.0 - spring.film) * held
        return hold + damping * rate

    def slope(time: float, y: np.ndarray) -> list[float]:
        q, rate = y
        at = 4e-5 * np.array([1.0, 0.8])
        depth = 6e-5 + at * np.cos(OMEGA * time) - COS_BETA * q
        f = np.maximum(depth - b, 0.0) - np.maximum(-depth - b, 0.0)
        w = -at * OMEGA * np.sin(OMEGA * time) - COS_BETA * rate
        hold = seat(q, rate)
        push = (COS_BETA * float(k @ f + c @ w) - hold) / spring.mass
        return [rate, push - (rest + hold) / spring.under]

    true = solve_ivp(slope, (0.0, t[-1]), found[0], "DOP853", t, rtol=1e-9, atol=1e-14).y.T
    size = np.sqrt(np.mean(true**2, axis=0))
    off = np.sqrt(np.mean((found - true) ** 2, axis=0))
    assert (off < 0.01 * size).all()


@SEATS
def test_steps_err_by_less_than_the_noise(
    spring: SeatSpring, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Against small steps, at noise of 1 % of x; slopes, of order 1, err by less than a fifth."""
    meshes = driving_meshes(1500)
    noisy = meshes._replace(noise=np.full(2, 6e-7))
    along = SeatSpring(*np.zeros(len(SeatSpring._fields)))._replace(stiffness=spring.stiffness)
    found = motion_with_slopes(noisy, spring, [along], COS_BETA)[:, :, 0]
    monkeypatch.setattr(moving_part_motion, "STEP_ERROR", 1e-4)
    true = motion_with_slopes(noisy, spring, [along], COS_BETA)[:, :, 0]
    off = np.sqrt(np.mean((found - true) ** 2, axis=1))
    assert 0.0 < off[0] < 0.2 * 6e-7
    assert off[1] < 0.2 * np.sqrt(np.mean(true[1] ** 2))


@SEATS
def test_the_slopes_of_a_motion_are_its_differences(
    spring: SeatSpring, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Central differences of motions on seats that differ by 0.01 % in one property, small steps:
    slopes are of order 1, motions of order 3."""
    monkeypatch.setattr(moving_part_motion, "LEAST_NOISE", 0.0)
    meshes, fields = driving_meshes(600), ("stiffness", "damping", "play", "width", "film")
    fields = (*fields, "growth", "drag")
    used = [name for name in fields if getattr(spring, name)]
    nothing = SeatSpring(*np.zeros(len(SeatSpring._fields)))
    changes = [nothing._replace(**{name: getattr(spring, name)}) for name in used]
    slopes = motion_with_slopes(meshes, spring, changes, COS_BETA)
    np.testing.assert_array_equal(slopes[0], motions(meshes, [spring], COS_BETA)[0])
    for name, slope in zip(used, slopes[1:], strict=True):
        near = [spring._replace(**{name: f * getattr(spring, name)}) for f in (0.9999, 1.0001)]
        below, above = motions(meshes, near, COS_BETA)
        expected = (above - below) / 2e-4
        off = np.sqrt(np.mean((slope - expected) ** 2, axis=0))
        assert (off <= 0.02 * np.sqrt(np.mean(expected**2, axis=0)) + 1e-12).all(), name


def test_the_slopes_of_a_chaotic_motion_stay_finite() -> None:
    """A loose pin that is hardly damped; its tangents grow with every mesh cycle."""
    meshes = driving_meshes(20000)
    t = np.arange(20000) * meshes.step
    x = meshes.x + 2e-5 * np.cos(0.37 * OMEGA * t)[:, None]
    meshes = meshes._replace(x=x, v=np.gradient(x, meshes.step, axis=0), noise=np.full(2, 6e-7))
    pin = SeatSpring(4.0, 30.0, 1e10, 1.2e3, play=2e-5, width=4e-7, film=0.05)
    along = SeatSpring(*np.zeros(len(SeatSpring._fields)))._replace(stiffness=pin.stiffness)
    motion, slope = motion_with_slopes(meshes, pin, [along], COS_BETA)
    assert np.isfinite(motion).all()
    assert np.abs(slope[:, 0]).max() <= DIVERGED_M


def test_the_carrier_of_a_pin_is_driven_by_the_control_of_the_gear() -> None:
    """Of any order and phase, beside the output torque and the forces of the other meshes."""
    nominal = NOMINAL.changed({"control_order": 2.0, "control_phase": 0.7})
    run = prepared(sampled({}, POINTS[2], 10), POINTS[2], nominal=nominal)
    m, locus = gear_run(run, 1).motion, Locus("all", "2", "all")
    drive = PartDrive(run.model, locus, "bearing_clearance", m, LawChange())
    others = law(m).force @ (1.0 - locus.mask(run.model.layout))
    rest = drive._meshes[0].rest - run.model.scales.cos_beta * others
    np.testing.assert_allclose(rest, body_loads(run.model, m.phase)[:, 2], rtol=1e-9)


@pytest.fixture(scope="module")
def ring_campaign():  # type: ignore[no-untyped-def]
    """A rig whose ring's spring hardens by 10 to 100 % at 100 kN, and its damper as well."""
    setting = Setting(truth="ring_flexibility", law="other", d=(10.0,))
    return make_campaign(plan_of(setting, 1))


def test_a_ring_on_a_hardening_spring_is_named_sized_and_closed(ring_campaign) -> None:  # type: ignore[no-untyped-def]
    """The catalogue's spring is linear; the rig's own growth is not in it."""
    found = diagnose(with_few_runs(as_prepared(ring_campaign)), senses=False).report.to_dict()
    assert found["effects"] == ["ring_flexibility"]
    assert found["gap"]["closure"] > 0.95
    true = ring_campaign.label["effects"][0]["parameters"]["stiffness"]["value"]
    size = found["causes"][0]["parameters"]["stiffness"]["value"]
    assert size == pytest.approx(true, rel=0.15)


def proposed_without_forces(truth: str) -> tuple[dict, list[Hypothesis]]:  # type: ignore[type-arg]
    """The effect of a rig without force sensors, and what its calibrated residual proposes."""
    setting = Setting(truth=truth, law="catalogue", channels=("no_force",), d=(10.0,))
    made = make_campaign(plan_of(setting, 1))
    machine = machine_of(calibrated_sensors(as_prepared(made)), ())
    found = Search(machine).null
    about = amplitudes(found.coefficients, found.mean, machine.runs, machine.rows)
    return made.label["effects"][0], machine.proposals(about, found)[1]


def test_a_tooth_is_found_by_folding_the_balance_where_no_forces_are_recorded() -> None:
    true, found = proposed_without_forces("tooth_spall")
    spalls = [h for h in found if h.effect == "tooth_spall"]
    places = [(vars(h.locus), dict(h.options)["member"]) for h in spalls]
    assert (true["locus"], true["parameters"]["member"]["value"]) in places


def test_a_ring_on_its_spring_removes_most_where_no_forces_are_recorded() -> None:
    """The grid has four stiffnesses a decade: the best is within a step or so of the true one."""
    true, found = proposed_without_forces("ring_flexibility")
    best = max(
        (h for h in found if h.measured_gain is not None), key=lambda h: h.measured_gain or 0.0
    )
    assert best.effect == "ring_flexibility"
    ratio = dict(best.options)["stiffness"] / true["parameters"]["stiffness"]["value"]
    assert 0.4 < ratio < 2.5


def test_a_part_that_could_explain_nothing_relevant_is_not_refined() -> None:
    """Of a rig without effect; the grids are tried all the same."""
    gear = GearObservations(list(rig({}, cycles=20).runs))
    known = Search(GearMachine(gear)).null
    unrefined = proposals(gear, {}, known)
    thetas = {theta for effect, grid in GRIDS for theta in grid}
    assert len(unrefined) == len(GRIDS)
    assert {part.theta for part in unrefined} <= thetas
    trial = PartTrial(gear, {}, known)
    refined = best_parts(trial, -np.inf)
    assert {part.theta for part in refined} - thetas
    relevant = MIN_GAIN_PER_VALUE * known.count
    assert max(part.measured_gain for part in refined) < relevant


def test_the_grids_miss_little_of_a_part_that_is_there(ring_campaign) -> None:  # type: ignore[no-untyped-def]
    """Less than half of the gain comes from refinement, so that a part that matters is refined."""
    machine = machine_of(calibrated_sensors(as_prepared(ring_campaign)), ())
    null = Search(machine)
    about = amplitudes(null.base, null.null.mean, null.runs, null.rows)
    trial = PartTrial(machine.gear, about, null.null)
    unrefined, refined = (
        max(part.measured_gain for part in best_parts(trial, least)) for least in (np.inf, -np.inf)
    )
    assert unrefined < refined < 2.0 * unrefined


def test_two_parts_at_one_place_are_driven_each_by_its_own_meshes() -> None:
    """Of a planet a ring takes the ring meshes, a pin all; the same part again is not formed."""
    gear = GearObservations(list(rig({}, cycles=20).runs[:1]))
    trial = PartTrial(gear, {}, no_effect(GearMachine(gear)))
    place = Locus("all", "2", "all")
    ring = MovingPart("ring_flexibility", place, (1e10, 0.05, 0.3, 0.3))
    pin = MovingPart("bearing_clearance", place, (1e-5, 1e11, 0.1, 0.05, 0.3, 1.0))
    (run,) = trial._runs
    of_ring, of_pin = (trial._drive(run, part) for part in (ring, pin))
    assert (of_ring.meshes_mask.sum(), of_pin.meshes_mask.sum()) == (2.0, 4.0)
    assert trial._drive(run, ring) is of_ring


def test_a_part_is_scored_at_what_the_other_runs_say_of_it(ring_campaign) -> None:  # type: ignore[no-untyped-def]
    """Squares left of a run, formed anew with the law at the means without it."""
    machine = machine_of(calibrated_sensors(as_prepared(ring_campaign)), ())
    null = Search(machine)
    about = amplitudes(null.base, null.null.mean, null.runs, null.rows)
    more, proposed = machine.proposals(about, null.null)
    ring = max(
        (h for h in proposed if h.measured_gain is not None), key=lambda h: h.measured_gain or 0.0
    )
    search = null.onwards(more)
    start = np.array([*ring.base_mean, *(c.center for c in ring.coefficients)])
    score = search.refined(ring.coefficients, start, 3)
    assert not np.allclose(score.leave_one_out_means[0], score.mean, rtol=1e-6, atol=0.0)
    for r in range(2):
        made = amplitudes(
            score.coefficients, score.leave_one_out_means[r], search.runs, search.rows
        )
        blocks = search.blocks(made, {}, tuple(search.machine.functions))[r]
        squares = sum(float(products(b).chi2_without_nuisance.sum()) for b in blocks.values())
        assert squares == pytest.approx(score.chi2[r], rel=1e-6)
