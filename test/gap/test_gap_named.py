"""A named effect is what was fitted: its law in the gear gives the force of its hypothesis."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from gap_support import NOMINAL, POINTS, prepared, sampled

from herringbone_sim.core.model import Model, build
from herringbone_sim.diagnosis.coefficients import amplitudes
from herringbone_sim.diagnosis.machine import Hypothesis
from herringbone_sim.diagnosis.score import Score
from herringbone_sim.effects.effect import Locus
from herringbone_sim.effects.evaluate import Motion, forces
from herringbone_sim.effects.written import effects_text, read_effects
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.named_effects import NamedEffect, name_effects
from herringbone_sim.gap.observations import force_law
from herringbone_sim.gap.observations.friction import (
    ELASTIC,
    FRICTION,
    NEAR,
    OF_COULOMB,
    friction_of_mesh,
    friction_shapes,
)
from herringbone_sim.gap.observations.gear import GearObservations
from herringbone_sim.gap.observations.hypotheses.coefficients import CoefficientBuilder
from herringbone_sim.gap.observations.hypotheses.damaged_teeth import (
    KNOTS,
    Event,
    event_columns,
    mesh_delays,
)
from herringbone_sim.gap.observations.hypotheses.meshes import TERM_BUILDERS, hypotheses
from herringbone_sim.gap.residuals.mesh_law import MeshMotion

SIZES = np.array([0.9, 0.4])  # of the moderate size, of an effect's own coefficients
# Effects of which hypothesis and law of the gear are one function; those of the others are tables
# of few loads (`LOADS_M`) or knots.
EXACT = set(TERM_BUILDERS) - {"contact_nonlinearity", "damping_law"}


@pytest.fixture(scope="module")
def run() -> PreparedRun:
    """A run almost without noise, so that contact is hardly smoothed by it."""
    return prepared(sampled({}, POINTS[0], 80), POINTS[0], share=1e-9)


@pytest.fixture(scope="module")
def gear(run: PreparedRun) -> GearObservations:
    return GearObservations([run])


def named(h: Hypothesis, mean: np.ndarray) -> NamedEffect:
    k = len(mean)
    score = Score(h.coefficients, mean, 0.0 * np.eye(k), mean[None], mean[:1], 0.0, 0.0, 1.0, {})
    [found] = name_effects((h,), score)
    return found


def both(
    gear: GearObservations,
    h: Hypothesis,
    main: np.ndarray,
    departures: Mapping[str, float] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Force [N] that the hypothesis adds to the law, and its named effect to the gear.

    Departures are told by name, in standard deviations of their priors.
    """
    off = departures or {}
    mean = np.array([off.get(c.name, 0.0) * c.sd for c in h.coefficients])
    mean[: len(main)] = main * [c.sd for c in h.coefficients[: len(main)]]
    rows = {force_law.NAME: gear.model.layout.n_mesh}
    made = amplitudes(h.coefficients, mean, 1, rows)[force_law.NAME]
    m = gear.runs[0].motion
    fitted = gear.law_of(m, {f: a[0] for f, a in made.items()}).force - gear.law_of(m, {}).force
    model = gear.runs[0].run.model
    moved = motion_of(m, model)
    one = named(h, mean)
    of_gear = forces(model, [one.active, *one.departures], moved)
    return fitted, of_gear - forces(model, [], moved)


def motion_of(m: MeshMotion, model: Model) -> Motion:
    p = model.parameters
    now = np.tile([0.0, m.omega, p.delta_T, p.T_1, p.K], (len(m.times), 1))
    now[:, 0] = m.phase
    return Motion(m.times, now, m.x, m.v, None)


def slope(fitted: np.ndarray, of_gear: np.ndarray) -> float:
    """Share of the fitted force that the gear has, by least squares."""
    return float(np.vdot(fitted, of_gear) / np.vdot(fitted, fitted))


@pytest.mark.parametrize("name", sorted(TERM_BUILDERS))
def test_a_named_effect_gives_the_force_of_its_hypothesis(
    gear: GearObservations, name: str
) -> None:
    """To 2 % where both are one function, else to a fifth; run-out: planets one way round."""
    every = [h for h in hypotheses(CoefficientBuilder(gear), {name}) if h.effect == name]
    found: dict[object, float] = {}
    for h in {h.options: h for h in every}.values():
        fitted, of_gear = both(gear, h, SIZES[: h.n_own] if name in EXACT else SIZES[:1])
        if name in EXACT:
            error = float(np.abs(fitted - of_gear).max() / np.abs(fitted).max())
        else:
            error = abs(slope(fitted, of_gear) - 1.0)
        one = tuple(o for o in h.options if o[0] != "sense")
        found[one] = min(error, found.get(one, np.inf))
    assert found
    assert max(found.values()) < (0.02 if name in EXACT else 0.2), found


@pytest.mark.parametrize(
    ("name", "off"),
    [
        ("mean_stiffness", {"ring": 0.8}),
        ("stagger", {"ring": -1.0}),
        ("planet_phase", {"ring": 1.0}),
        ("pin_position", {"ring": -1.0, "right side": 0.7}),
        ("backlash_offset", {"back flank": 1.0, "ring": -0.5, "back flank of the ring": 0.9}),
        ("thermal_backlash", {"ring": 1.0}),
        ("thermal_backlash", {"curvature": 0.5}),
        ("thermal_stiffness", {"ring": 1.0}),
        ("thermal_stiffness", {"curvature": -0.5}),
        ("runout", {"3 cos": 1.0, "5 sin": -1.5}),
        ("profile_error", {"3 cos": 1.0, "5 sin": -1.5}),
    ],
)
def test_departures_of_a_curve_are_effects_of_the_gear(
    gear: GearObservations, name: str, off: dict[str, float]
) -> None:
    """To 5 % of the force that they add; run-out: planets one way round."""
    every = [h for h in hypotheses(CoefficientBuilder(gear), {name}) if h.effect == name]
    found: dict[object, float] = {}
    for h in (h for h in every if set(off) <= {c.name for c in h.coefficients}):
        main = 0.1 * SIZES[: h.n_own]  # small: laws are linear
        plain, with_departures = both(gear, h, main), both(gear, h, main, off)
        added, of_gear = (b - a for a, b in zip(plain, with_departures, strict=True))
        error = float(np.linalg.norm(added - of_gear) / np.linalg.norm(added))
        one = (h.locus, tuple(o for o in h.options if o[0] != "sense"))
        found[one] = min(error, found.get(one, np.inf))
    assert found
    assert max(found.values()) < 0.05, found


def test_a_cold_rig_has_all_hypotheses_too() -> None:
    """At delta_T = 0 nothing thermal can be seen, and its coefficient fits as zero."""
    cold = {**POINTS[0], "delta_T": 0.0}
    gear = GearObservations([prepared(sampled({}, cold, 30), cold)])
    for h in hypotheses(CoefficientBuilder(gear)):
        assert len(h.coefficients) >= h.n_own, h.effect
        named(h, np.zeros(len(h.coefficients)))


def test_what_is_named_can_be_written_and_read(gear: GearObservations) -> None:
    for h in hypotheses(CoefficientBuilder(gear)):
        one = named(h, np.array([c.sd for c in h.coefficients]))
        every = (one.active, *one.departures)
        back = read_effects(effects_text(every))
        assert [b.effect.id for b in back] == [a.effect.id for a in every]
        assert [b.theta for b in back] == [a.theta for a in every]


@pytest.mark.parametrize("name", ["tooth_crack", "tooth_spall"])
def test_a_named_tooth_gives_the_force_of_its_event(gear: GearObservations, name: str) -> None:
    """Of the same sign and size; the windows differ as straight lines from a cosine."""
    _, late = next(mesh_delays(gear, "sun"))
    event = Event(name, Locus("sp", "all", "L"), "sun", 27.0, 16.0, tuple(late.tolist()))
    with_event = gear.with_functions(event.functions(gear, "event"))
    h = event.hypothesis(CoefficientBuilder(with_event), "event")
    fitted, of_gear = both(with_event, h, np.array([0.8]))
    assert np.abs(fitted - of_gear).max() < 0.2 * np.abs(fitted).max()
    assert slope(fitted, of_gear) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize(("z_p", "places"), [(24, 1), (25, 3)])
def test_no_place_of_a_tooth_is_proposed_twice(
    gear: GearObservations, monkeypatch: pytest.MonkeyPatch, z_p: int, places: int
) -> None:
    """Half a turn of a planet with an even number of teeth is a whole number of mesh cycles."""
    monkeypatch.setattr(gear, "model", build(NOMINAL.changed({"z_p": z_p, "z_r": 27 + 2 * z_p})))
    delays = {tuple(late) for _, late in mesh_delays(gear, "planet")}
    assert len(delays) == len(list(mesh_delays(gear, "planet"))) == places


def test_the_position_of_a_tooth_is_within_a_turn_of_its_member(gear: GearObservations) -> None:
    """A peak half a mesh cycle before the start of a turn of the sun is in the 27th."""
    event = Event("tooth_crack", Locus("sp", "1", "L"), "sun", 27.0, 0.1, (0.0,) * 12)
    with_event = gear.with_functions(event.functions(gear, "event"))
    h = event.hypothesis(CoefficientBuilder(with_event), "event")
    curve = np.where(np.isclose(KNOTS, -0.5), 1.0, 0.0)
    assert curve.any()
    found = named(h, np.array([0.0, *curve]))
    i = [p.name for p in found.active.effect.parameters].index("position")
    assert found.active.theta[i] == pytest.approx(26.6)


def test_the_interval_of_a_position_does_not_go_round(gear: GearObservations) -> None:
    event = Event("tooth_crack", Locus("sp", "1", "L"), "sun", 27.0, 0.02, (0.0,) * 12)
    with_event = gear.with_functions(event.functions(gear, "event"))
    h = event.hypothesis(CoefficientBuilder(with_event), "event")
    mean = np.array([c.sd for c in h.coefficients[:1]] + [0.0] * (len(h.coefficients) - 1))
    spread = np.diag(np.full(len(mean), 0.02**2))
    score = Score(h.coefficients, mean, spread, mean[None], mean[:1], 0.0, 0.0, 1.0, {})
    [found] = name_effects((h,), score)
    i = [p.name for p in found.active.effect.parameters].index("position")
    low, high = found.intervals[i]
    assert high - low < 2.0


PINS = "; ".join(f"pin_position@all/{planet}/all:offset=1e-9" for planet in (1, 2, 3))


@pytest.mark.parametrize(
    ("kind", "always", "size"),
    [("tooth_spall", PINS, 1e-9), ("tooth_crack", "mean_stiffness:factor=0.999999", 1e-6)],
)
def test_an_event_is_sought_by_the_force_that_it_adds(
    gear: GearObservations, kind: str, always: str, size: float
) -> None:
    """Per unit of size: of a spall as all pins 1 nm off, of a crack as all k a millionth less."""
    m, model = gear.runs[0].motion, gear.runs[0].run.model
    moved = motion_of(m, model)
    change = forces(model, read_effects(always), moved) - forces(model, [], moved)
    column = event_columns(m, gear.law_of(m, {}))[kind]
    assert slope(column, change / size) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("pitch", [-0.1, -0.05, 0.05, 0.1])
def test_friction_can_turn_beside_the_pitch_point(pitch: float) -> None:
    """Its shapes follow sliding that reverses ``pitch`` cycles late to a quarter of the RMS.

    Both at the pitch point and half a cycle later; without the shapes near these a third is left.
    """
    phase = np.linspace(-np.pi, np.pi, 480, endpoint=False)
    shapes = friction_shapes(phase)
    turned = np.sign(np.sin(phase - 2.0 * np.pi * pitch))
    left = []
    for names in (FRICTION, [f for f in FRICTION if f not in NEAR]):
        columns = np.stack([shapes[f] for f in names if f in shapes and f != "lever"], axis=1)
        fitted = columns @ np.linalg.lstsq(columns, turned, rcond=None)[0]
        left.append(float(np.sqrt(np.mean((turned - fitted) ** 2))))
    assert left[0] < 0.27
    assert left[1] > 0.33


def test_the_coefficient_of_friction_is_that_of_the_whole_curve() -> None:
    """Departures have no part of the sign over a mesh cycle."""
    shapes = friction_shapes((np.arange(4800) + 0.5) * 2.0 * np.pi / 4800)
    for name in FRICTION[len(OF_COULOMB) : -1]:
        assert np.mean(shapes[name] * shapes["sign"]) == pytest.approx(0.0, abs=1e-4)


def test_hat_functions_about_reversals_have_no_spikes() -> None:
    """At the pitch point and at the change of teeth themselves as beside them."""
    beside = friction_shapes(np.array([1e-9, np.pi - 1e-9]))
    on = friction_shapes(np.array([0.0, -np.pi]))
    for name in NEAR:  # but for their part of the sign, 0.06, that jumps
        assert np.max(np.abs(on[name] - beside[name])) < 0.13


def test_friction_can_follow_the_spring_force_alone() -> None:
    """The shape ``ELASTIC`` beside that of the sign: |k f| takes the place of |F|."""
    phase = np.linspace(-np.pi, np.pi, 48, endpoint=False)
    shapes, force, spring = friction_shapes(phase), np.cos(phase), 0.9 * np.sin(phase)
    both = [friction_of_mesh(shape, shapes, force, spring) for shape in ("sign", ELASTIC)]
    np.testing.assert_allclose(sum(both), np.abs(spring) * np.sign(phase), atol=1e-12)


@pytest.mark.parametrize("slope_share", [-0.4, 0.0, 1.0])
def test_the_depth_of_a_damping_law_is_where_it_is_c_v(
    gear: GearObservations, slope_share: float
) -> None:
    """Its curve is -share in the gap and crosses zero at the depth that is named."""
    share = 0.3
    h = next(
        one
        for one in hypotheses(CoefficientBuilder(gear))
        if one.effect == "damping_law" and dict(one.options) == {"law": "load"}
    )
    mean = np.zeros(len(h.coefficients))
    mean[[c.name for c in h.coefficients].index("share")] = share
    mean[[c.name for c in h.coefficients].index("slope")] = slope_share * share
    found = named(h, mean)
    named_share, power, depth = found.active.theta
    assert (named_share, power) == pytest.approx((share, 1.0))
    assert depth == pytest.approx(1e-5 / (1.0 + slope_share))
    assert found.law is not None
    np.testing.assert_allclose(found.law.y, share * (found.law.x / depth - 1.0))
