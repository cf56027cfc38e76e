"""Many values at once: the same motion as one at a time, whoever the neighbours are."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import gears
import numpy as np
import pytest

from herringbone_sim.core.batch import run_batch
from herringbone_sim.core.integrate import Stepper, largest_exponent
from herringbone_sim.core.mirror import layout_mirror
from herringbone_sim.core.model import build, relative
from herringbone_sim.core.packed import LIMIT
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.core.sensitivity import Directions
from herringbone_sim.effects.sensitivity import directions

FAST = {"samples_per_cycle": 1, "order": 14, "steps_per_cycle": 8}

PERIODIC = [
    pytest.param({"delta_T": 85.0}, id="as the paper"),
    pytest.param({"xi": 0.2, "Omega": 1.3}, id="another frequency"),
    pytest.param({"xi": 0.17, "e_amp": (1.0, 0.2), "k_amp": (0.25, 0.1, 0.05)}, id="harmonics"),
    pytest.param({"xi": 0.085, "K": 0.5, "control_phase": 0.3}, id="control"),
    pytest.param({"xi": 0.2, "K": 0.1, "control_order": 0.5}, id="slow control"),
    pytest.param({"xi": 0.2, "phi_a": (0.1, 0.0, 0.2, 0.0)}, id="halves that differ"),
    pytest.param({"xi": 0.2, "control_on": (1.0, 0.0, 1.0, 0.0), "K": 0.1}, id="one half driven"),
    pytest.param({"model": "full", "xi": 0.2, "phasing": "geometric"}, id="full"),
]


def paper(**values):
    return gears.paper(**FAST | values)


def one_by_one(model, cycles, y=None):
    """States (cycles, n_state) at phase 0, by the stepper."""
    stepper = Stepper(model)
    state = stepper.start() if y is None else replace(stepper.start(), y=y)
    found = []
    for _ in range(cycles):
        found.append(state.y)
        state = stepper.advance(state, model.parameters.samples_per_cycle).end
    return np.array(found)


@pytest.mark.parametrize("values", PERIODIC)
def test_motion_is_that_of_the_stepper(values):
    model = paper(**values)
    found = run_batch([model], transient=100, cycles=40, points=40).sections[0]
    assert np.abs(found - one_by_one(model, 140)[100:]).max() < 1e-9


def test_planets_and_halves_that_all_differ():
    model = build(Parameters(**gears.UNEVEN | FAST | {"xi": 0.2}))
    start = Stepper(model).start().y
    found = run_batch([model], start[None], transient=0, cycles=12, points=12).sections[0]
    assert np.abs(found - one_by_one(model, 12)).max() < 1e-9


def test_meshes_that_start_on_their_border():
    model = paper(b=0.0, delta_T=0.0, xi=0.1)
    found = run_batch([model], transient=0, cycles=12, points=12).sections[0]
    assert np.abs(found - one_by_one(model, 12)).max() < 1e-9


def test_asymmetric_start_is_that_of_the_stepper():
    model = paper(delta_T=30.0)
    y = np.random.default_rng(1).normal(size=8) * 0.1
    found = run_batch([model], y[None], transient=0, cycles=12, points=12).sections[0]
    assert np.abs(found - one_by_one(model, 12, y)).max() < 1e-9


def test_a_value_is_the_same_to_the_bit_among_any_others():
    models = [paper(delta_T=float(d), K=0.1) for d in np.linspace(0.0, 90.0, 21)]
    together = run_batch(models, transient=30, cycles=20, points=5, exponents=True)
    backwards = run_batch(models[::-1], transient=30, cycles=20, points=5, exponents=True)
    alone = run_batch([models[7]], transient=30, cycles=20, points=5, exponents=True)
    for name in ("sections", "end", "exponents", "exponent_errors", "within", "contact"):
        here = getattr(together, name)
        assert np.array_equal(here, getattr(backwards, name)[::-1])
        assert np.array_equal(here[7], getattr(alone, name)[0])


def test_neighbours_of_another_kind_change_nothing():
    plain, uneven = paper(delta_T=40.0), paper(delta_T=40.0, phi_a=(0.1, 0.0, 0.0, 0.0))
    controlled = paper(delta_T=40.0, K=0.2)
    alone = run_batch([plain], transient=30, cycles=20, points=20)
    mixed = run_batch([uneven, controlled, plain], transient=30, cycles=20, points=20)
    assert np.array_equal(alone.sections[0], mixed.sections[2])


@pytest.mark.parametrize(("delta_T", "tolerance"), [(20.0, 0.012), (70.0, 1e-3), (85.0, 1e-3)])
def test_largest_exponent_is_that_of_the_tangent_flow(delta_T, tolerance):
    model = paper(delta_T=delta_T)
    batch = run_batch([model], transient=500, cycles=1500, points=0, exponents=True)
    expected = largest_exponent(model, 1500, 500)[0]
    assert batch.exponents[0] == max(batch.within[0], batch.transverse[0])
    assert batch.exponents[0] == pytest.approx(expected, abs=tolerance)


def test_halves_that_differ_have_one_exponent_and_no_manifold():
    model = paper(xi=0.17, phi_a=(0.1, 0.0, 0.2, 0.0))
    batch = run_batch([model], transient=300, cycles=500, points=0, exponents=True)
    assert batch.exponents[0] == pytest.approx(largest_exponent(model, 500, 300)[0], abs=1e-3)
    assert np.isnan(batch.within[0])
    assert np.isnan(batch.transverse[0])


def test_contact_is_shared_as_a_fine_sampling_sees_it():
    model = paper(delta_T=85.0)
    batch = run_batch([model], transient=500, cycles=10, points=0)
    fine = build(model.parameters.changed({"samples_per_cycle": 1000}))
    stepper = Stepper(fine)
    block = stepper.advance(stepper.advance(stepper.start(), 500_000).end, 10_000)
    assert batch.contact[0].sum(axis=1) == pytest.approx(1.0)
    assert np.abs(batch.contact[0] - block.contact / 10_000).max() < 1e-3


def test_a_value_that_diverges_is_nan_with_its_reason_and_alone():
    good, starts = paper(delta_T=85.0), np.zeros((3, 8))
    starts[1] = 1e7
    batch = run_batch([good] * 3, starts, transient=5, cycles=5, points=5, exponents=True)
    expected = run_batch([good], starts[:1], transient=5, cycles=5, points=5, exponents=True)
    assert batch.reasons == ("", "diverged", "")
    for name in ("sections", "end", "exponents", "contact"):
        assert np.isnan(getattr(batch, name)[1]).all()
        assert np.array_equal(getattr(batch, name)[0], getattr(expected, name)[0])
        assert np.array_equal(getattr(batch, name)[2], getattr(expected, name)[0])


@pytest.mark.parametrize("method", ["taylor", "rk4"])
def test_a_value_diverges_where_the_stepper_says_so(method):
    """By its deflections, not by its velocities or by the sums that the coordinates are."""
    model = paper(delta_T=85.0, method=method)
    starts = np.random.default_rng(2).uniform(-2e6, 2e6, (200, 8))
    starts = starts[[np.abs(relative(model, y, 0.0)[0]).max() < LIMIT for y in starts]]
    batch = run_batch([model] * len(starts), starts, transient=0, cycles=1, points=1)
    stepper = Stepper(model)
    expected = [stepper.advance(replace(stepper.start(), y=y), 2).diverged for y in starts]
    assert [reason != "" for reason in batch.reasons] == expected
    assert 0 < sum(expected) < len(starts)


def test_the_papers_method_gives_the_same_orbit():
    taylor = run_batch([paper(delta_T=85.0)], transient=400, cycles=5, points=5)
    rk4 = paper(delta_T=85.0, method="rk4", steps_per_cycle=800)
    found = run_batch([rk4], transient=400, cycles=5, points=5, exponents=True)
    assert np.abs(found.sections - taylor.sections).max() < 1e-4
    assert np.isnan(found.exponents[0])
    assert found.contact[0].sum(axis=1) == pytest.approx(1.0)


def test_continuation_from_the_end_is_one_long_run():
    models = [paper(delta_T=20.0), paper(delta_T=85.0)]
    first = run_batch(models, transient=10, cycles=10, points=1)
    second = run_batch(models, first.end, transient=0, cycles=10, points=10)
    whole = run_batch(models, transient=10, cycles=20, points=10)
    assert np.array_equal(second.sections, whole.sections)


@pytest.mark.parametrize("cycles", [7, 25, 40])
def test_the_error_of_an_even_growth_is_none_whatever_the_number_of_cycles(cycles):
    """Batches of cycles may differ by one cycle in length."""

    class Even:
        @staticmethod
        def run_batch(models, starts, before, look, tangents):
            return SimpleNamespace(
                sections=np.zeros((1, 0, 8)),
                end=starts,
                growth=np.full((1, cycles, tangents), 0.3),
                contact=np.ones((1, 4, 3)),
                failed=np.array([False]),
            )

    model = replace(paper(), integrator=Even)
    found = run_batch([model], transient=0, cycles=cycles, points=0, exponents=True)
    assert found.exponents[0] == pytest.approx(0.3 * model.packed.Omega / (2.0 * np.pi))
    assert found.exponent_errors[0] < 1e-12


@pytest.mark.parametrize(
    "lengths", [{"transient": -1}, {"cycles": 0, "points": 0}, {"cycles": 5, "points": 6}]
)
def test_lengths_that_make_no_sense_are_refused(lengths):
    with pytest.raises(ValueError, match="transient >= 0, cycles >= 1"):
        run_batch([paper()], **lengths)


def test_models_of_several_layouts_are_refused():
    with pytest.raises(ValueError, match="one layout"):
        run_batch([paper(), paper(model="full")])
    with pytest.raises(ValueError, match="got 1 Directions among 2"):
        run_batch([Directions(*directions(paper(), ("xi",))), paper()])


def test_mirror_exchanges_the_halves():
    layout = paper(model="full").layout
    names = np.array(layout.state_names)
    swapped = [name.translate(str.maketrans("LR", "RL")) for name in names]
    assert list(names[layout_mirror(layout)]) == swapped


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_the_exponent_of_a_single_cycle_has_no_error():
    batch = run_batch([gears.make()], transient=5, cycles=1, points=1, exponents=True)
    assert np.isfinite(batch.exponents).all()
    assert np.isnan(batch.exponent_errors).all()
