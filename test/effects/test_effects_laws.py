"""Each effect against its equation, written out by hand for a few recorded instants."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import Model, build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.effects.effect import Locus, active
from herringbone_sim.effects.evaluate import Motion, evaluate
from herringbone_sim.effects.registry import effect

OMEGA, HOT, T_1 = 3.1e4, 35.0, 400.0
N = 40


@pytest.fixture(scope="module")
def rig() -> Model:
    return build(Parameters(model="full", delta_T=HOT, T_1=T_1))


@pytest.fixture(scope="module")
def moved() -> Motion:
    """Instants over 80 mesh cycles, in contact, out of it and on the back."""
    rng = np.random.default_rng(3)
    phase = np.sort(rng.uniform(0.0, 160.0 * np.pi, N))
    rows = [phase, *(np.full(N, value) for value in (OMEGA, HOT, T_1, 0.0))]
    x, v = rng.normal(scale=1e-4, size=(N, 12)), rng.normal(scale=1.0, size=(N, 12))
    return Motion(phase / OMEGA, np.stack(rows, axis=1), x, v, None)


def k(rig: Model, phase: Array) -> Array:
    k_m = np.repeat([1.5e9, 1.2e9], 6)
    found: Array = k_m * (1.0 + 0.25 * np.cos(np.atleast_1d(phase))[:, None])
    return found


def f(x: Array, b: Array) -> Array:
    found: Array = np.sign(x) * np.maximum(np.abs(x) - b, 0.0)
    return found


def law(
    rig: Model,
    moved: Motion,
    k_of: Callable[[Array], Array] = lambda k: k,
    b: float | Array = 0.0,
    d: float | Array = 0.0,
    rate: float | Array = 0.0,
) -> Array:
    x, v = moved.x + d, moved.v + rate
    spring = k_of(k(rig, moved.now[:, 0])) * f(x, rig.half_backlash_m + b)
    found: Array = spring + rig.damping_n_s_per_m * v
    return found


def on(mesh: str, planet: str = "all", side: str = "all") -> tuple[Locus, Array]:
    names = [f"{kind}{i}_{s}" for kind in ("sp", "rp") for s in "LR" for i in "123"]
    chosen = [
        mesh in ("all", n[:2]) and planet in ("all", n[2]) and side in ("all", n[4]) for n in names
    ]
    return Locus(mesh, planet, side), np.array(chosen, dtype=float)


def phase_of(moved: Motion) -> Array:
    column: Array = moved.now[:, :1]
    return column


def ahead(rig: Model, moved: Motion, on_mesh: Array) -> dict[str, Any]:
    phi, e_m, angle = phase_of(moved), 0.35e-4, 0.4
    k_m = np.repeat([1.5e9, 1.2e9], 6)
    more = 0.25 * k_m * on_mesh * (np.cos(phi + angle) - np.cos(phi))
    return {
        "k_of": lambda k: k + more,
        "d": -e_m * (np.sin(phi + angle) - np.sin(phi)) * on_mesh,
        "rate": -e_m * OMEGA * (np.cos(phi + angle) - np.cos(phi)) * on_mesh,
    }


def since(moved: Motion, period: float, late: Array, position: float) -> Array:
    """Mesh cycles (n, n_mesh) from the nearest event."""
    cycles = phase_of(moved) / (2.0 * np.pi) - position - late
    found: Array = (cycles + period / 2.0) % period - period / 2.0
    return found


def window(s: Array, width: float) -> Array:
    found: Array = np.where(np.abs(s) < width / 2.0, np.cos(np.pi * s / width) ** 2, 0.0)
    return found


PLANETS = np.tile([0.0, 1.0, 2.0], 4) / 3.0


def mean_stiffness(rig: Model, moved: Motion) -> tuple[Any, Array]:
    place, mask = on("sp", "2", "R")
    wanted = law(rig, moved, lambda k: k * np.where(mask, 1.2, 1.0))
    return active(effect("mean_stiffness"), place, {"factor": 1.2}), wanted


def stiffness_harmonic(rig: Model, moved: Motion) -> tuple[Any, Array]:
    place, mask = on("rp")
    phi = 3.0 * phase_of(moved)
    more = 1.2e9 * mask * (0.1 * np.cos(phi) - 0.05 * np.sin(phi))
    values = {"cos": 0.1, "sin": -0.05, "order": 3}
    return active(effect("stiffness_harmonic"), place, values), law(rig, moved, lambda k: k + more)


def stagger(rig: Model, moved: Motion) -> tuple[Any, Array]:
    place, mask = on("all", "all", "R")
    one = active(effect("stagger"), place, {"phase": 0.4})
    return one, law(rig, moved, **ahead(rig, moved, mask))


def planet_phase(rig: Model, moved: Motion) -> tuple[Any, Array]:
    place, mask = on("all", "3")
    one = active(effect("planet_phase"), place, {"phase": 0.4})
    return one, law(rig, moved, **ahead(rig, moved, mask))


def tooth_crack(rig: Model, moved: Motion) -> tuple[Any, Array]:
    place, mask = on("sp", "all", "L")
    lost = 0.3 * window(since(moved, 27.0, 27.0 * PLANETS, 2.0), 4.0) * mask
    values = {"depth": 0.3, "position": 2.0, "width": 4.0, "member": "sun"}
    wanted = law(rig, moved, lambda k: k * (1.0 - lost))
    return active(effect("tooth_crack"), place, values), wanted


def tooth_spall(rig: Model, moved: Motion) -> tuple[Any, Array]:
    place, mask = on("all", "1", "R")
    late = np.repeat([0.0, 12.0], 6)
    s = since(moved, 25.0, late, 4.0)
    values = {"height": 2e-5, "position": 4.0, "width": 4.0, "member": "planet"}
    d = 2e-5 * mask * window(s, 4.0)
    step = 1e-6
    slope = (window(s + step, 4.0) - window(s - step, 4.0)) / (2.0 * step)
    rate = 2e-5 * mask * slope * OMEGA / (2.0 * np.pi)
    return active(effect("tooth_spall"), place, values), law(rig, moved, d=-d, rate=-rate)


def runout(rig: Model, moved: Motion) -> tuple[Any, Array]:
    place, mask = on("rp")
    angle = phase_of(moved) / 77.0 + 2.0 * np.pi * PLANETS + 0.6
    values = {"amplitude": 3e-5, "phase": 0.6, "member": "ring"}
    d, rate = 3e-5 * mask * np.sin(angle), 3e-5 * mask * np.cos(angle) * OMEGA / 77.0
    return active(effect("runout"), place, values), law(rig, moved, d=-d, rate=-rate)


def pin_position(rig: Model, moved: Motion) -> tuple[Any, Array]:
    place, mask = on("all", "2")
    one = active(effect("pin_position"), place, {"offset": -2e-5})
    return one, law(rig, moved, d=2e-5 * mask)


def backlash_offset(rig: Model, moved: Motion) -> tuple[Any, Array]:
    place, mask = on("sp", "1", "L")
    one = active(effect("backlash_offset"), place, {"offset": 7e-6})
    return one, law(rig, moved, b=7e-6 * mask)


def thermal_backlash(rig: Model, moved: Motion) -> tuple[Any, Array]:
    place, mask = on("rp")
    one = active(effect("thermal_backlash"), place, {"rate": 1e-7})
    return one, law(rig, moved, b=1e-7 * HOT * mask)


def thermal_stiffness(rig: Model, moved: Motion) -> tuple[Any, Array]:
    one = active(effect("thermal_stiffness"), values={"rate": 2e-3})
    return one, law(rig, moved, lambda k: k * (1.0 - 2e-3 * HOT))


def contact_nonlinearity(rig: Model, moved: Motion) -> tuple[Any, Array]:
    gap = f(moved.x, rig.half_backlash_m)
    bent = np.sign(gap) * 1e-5 * (np.abs(gap) / 1e-5) ** 1.3
    wanted = k(rig, moved.now[:, 0]) * bent + rig.damping_n_s_per_m * moved.v
    return active(effect("contact_nonlinearity"), values={"exponent": 1.3}), wanted


def damping_law_contact(rig: Model, moved: Motion) -> tuple[Any, Array]:
    out = f(moved.x, rig.half_backlash_m) == 0.0
    lost = np.where(out, 0.4, 0.0) * rig.damping_n_s_per_m * moved.v
    one = active(effect("damping_law"), values={"share": 0.4, "power": 0.0})
    return one, law(rig, moved) - lost


def damping_law_load(rig: Model, moved: Motion) -> tuple[Any, Array]:
    gap = np.abs(f(moved.x, rig.half_backlash_m)) / 1e-5
    more = 0.4 * (gap - 1.0) * rig.damping_n_s_per_m * moved.v
    one = active(effect("damping_law"), values={"share": 0.4, "power": 1.0, "depth": 1e-5})
    return one, law(rig, moved) + more


def profile_error(rig: Model, moved: Motion) -> tuple[Any, Array]:
    place, mask = on("sp")
    phi = 4.0 * phase_of(moved)
    d = (4e-6 * np.cos(phi) + 2e-6 * np.sin(phi)) * mask
    rate = 4.0 * OMEGA * (2e-6 * np.cos(phi) - 4e-6 * np.sin(phi)) * mask
    values = {"cos": 4e-6, "sin": 2e-6, "order": 4}
    return active(effect("profile_error"), place, values), law(rig, moved, d=-d, rate=-rate)


CASES = [
    *(mean_stiffness, stiffness_harmonic, stagger, planet_phase, tooth_crack, tooth_spall),
    *(runout, pin_position, backlash_offset, thermal_backlash, thermal_stiffness),
    *(contact_nonlinearity, damping_law_contact, damping_law_load, profile_error),
]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.__name__)
def test_the_force_is_that_of_the_equation(
    rig: Model, moved: Motion, case: Callable[[Model, Motion], tuple[Any, Array]]
) -> None:
    one, wanted = case(rig, moved)
    found = evaluate(rig, [one], moved)
    largest = np.abs(wanted).max()
    assert np.abs(wanted - law(rig, moved)).max() > 1e-4 * largest
    np.testing.assert_allclose(found.force, wanted, rtol=0.0, atol=1e-8 * largest)
    assert not found.torque.any()


def test_friction_takes_energy_and_leaves_the_normal_force(rig: Model, moved: Motion) -> None:
    found = evaluate(rig, [active(effect("tooth_friction"), values={"mu": 0.1})], moved)
    assert np.array_equal(found.force, evaluate(rig, [], moved).force)
    work = found.torque @ np.array([2.0, 2.0, 1.0, *[1.0] * 6])  # the rotation that keeps every x
    assert work.max() <= 1e-9 * np.abs(work).max()
    assert work.min() < 0.0


def test_friction_by_its_lever_arms(rig: Model, moved: Motion) -> None:
    mu = 0.08
    found = evaluate(rig, [active(effect("tooth_friction"), Locus("sp"), {"mu": mu})], moved)
    s, p = rig.scales, rig.parameters
    alpha_t = np.arctan(np.tan(np.radians(p.alpha_n)) / s.cos_beta)
    turn = moved.now[:, 0] / (2.0 * np.pi)
    at = (turn - np.round(turn)) * 2.0 * np.pi * s.r_bs / p.z_s
    g = mu * np.abs(found.force[:, :6]) * s.cos_beta * np.sign(at)[:, None]
    sun = -(g * (np.tan(alpha_t) + at[:, None] / s.r_bs)).reshape(-1, 2, 3).sum(axis=2)
    planets = g * (np.tan(alpha_t) - at[:, None] / s.r_bp)
    carrier = g.sum(axis=1) * np.tan(alpha_t)
    wanted = np.column_stack([sun, carrier, planets])
    np.testing.assert_allclose(found.torque, wanted, rtol=1e-9, atol=1e-6)


def test_a_ripple_is_a_share_of_the_input_torque_on_both_halves_of_the_sun(
    rig: Model, moved: Motion
) -> None:
    values = {"amplitude": 0.2, "phase": 0.3, "order": 7}
    found = evaluate(rig, [active(effect("torque_ripple"), values=values)], moved)
    input_angle = moved.now[:, 0] * (27.0 + 77.0) / (27.0 * 77.0)
    share = 0.2 * np.cos(7.0 * input_angle + 0.3)
    wanted = T_1 / 2.0 / rig.scales.r_bs * share
    np.testing.assert_allclose(found.torque[:, :2], np.stack([wanted] * 2, axis=1), rtol=1e-9)
    assert not found.torque[:, 2:].any()


def still(rig: Model, force: float, n: int = 3000) -> Motion:
    """A constant measured force on all meshes, long enough for own states to settle.

    T_1 is such that T_2 holds the carrier.
    """
    times = np.arange(n) * 5e-6
    held = 6.0 * force * rig.scales.cos_beta * rig.scales.r_bs
    now = np.tile([0.0, OMEGA, HOT, held, 0.0], (n, 1))
    return Motion(times, now, np.zeros((n, 12)), np.zeros((n, 12)), np.full((n, 12), force))


def settled(rig: Model, one: Any, force: float) -> Array:
    """d (n_mesh,) by the damping-free inverse of the law: x = 0, so F shows f(d) alone."""
    stiff = build(rig.parameters.changed({"b": 0.0, "delta_T": 0.0}))
    found: Array = evaluate(stiff, [one], still(stiff, force)).force[-1] / k(stiff, np.zeros(1))[0]
    return found


def test_a_ring_on_its_spring_gives_way_by_the_load_over_the_stiffness(rig: Model) -> None:
    values = {"stiffness": 2e9, "damping": 0.3}
    one = active(effect("ring_flexibility"), Locus("rp", "all", "L"), values)
    beta = rig.scales.cos_beta
    wanted = np.repeat([0.0, 0.0, -3.0 * 5e3 / 2e9 * beta**2, 0.0], 3)
    np.testing.assert_allclose(settled(rig, one, 5e3), wanted, atol=1e-12)


def test_a_ring_swings_at_its_own_frequency(rig: Model) -> None:
    one = active(effect("ring_flexibility"), Locus("rp"), {"stiffness": 2e9, "damping": 0.0})
    stiff = build(rig.parameters.changed({"b": 0.0, "delta_T": 0.0, "xi": 0.0}))
    d = evaluate(stiff, [one], still(stiff, 5e3, 2000)).force[:, 6] / k(stiff, np.zeros(1))[0, 6]
    beta, t = rig.scales.cos_beta, np.arange(2000) * 5e-6
    swing = 1.0 - np.cos(np.sqrt(2e9 / rig.scales.M_r) * t)
    np.testing.assert_allclose(d, -3.0 * 5e3 / 2e9 * beta**2 * swing, atol=1e-9)


def test_a_planet_leans_on_the_end_of_its_clearance(rig: Model) -> None:
    values = {"clearance": 1e-5, "stiffness": 5e9, "softness": 2e-3}
    one = active(effect("bearing_clearance"), Locus("all", "2", "all"), values)
    beta = rig.scales.cos_beta
    w = 1e-5 + 4.0 * 5e3 * beta / 5e9
    wanted = np.tile([0.0, -w * beta, 0.0], 4)
    np.testing.assert_allclose(settled(rig, one, 5e3), wanted, atol=1e-9)
    np.testing.assert_allclose(settled(rig, one, -5e3), -wanted, atol=1e-9)
