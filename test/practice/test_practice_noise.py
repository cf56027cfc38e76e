"""Each kind of noise of a practice rig is what it says: its spectrum, steps, lines, delay."""

from __future__ import annotations

import numpy as np
import pytest

from herringbone_sim.errors import ParameterError
from herringbone_sim.practice.campaign import make_campaign
from herringbone_sim.practice.chain import (
    deterministic,
    encoded,
    low_pass,
    measured,
    random_part,
    turns,
)
from herringbone_sim.practice.channels import channels_of
from herringbone_sim.practice.noise import NOISES, Noise, draw_noise
from herringbone_sim.practice.plan import RequestedNoise, draw_plan
from herringbone_sim.practice.record import COS_BETA, Sampling, geometry, simulate_motion
from herringbone_sim.practice.rig_model import BODIES, MESHES, NOMINAL, omega_n, radii, rig_model

POINT = {"delta_T": 84.3, "K": 0.0, "T_1": 819.0, "Omega": 1.0}
TIMES = np.arange(50_000) / 1e5


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.fixture(scope="module")
def motion():
    return simulate_motion(rig_model(NOMINAL, POINT), 0.4, np.zeros(30), Sampling(20, 120)).now


def rng():
    return np.random.default_rng(7)


@pytest.mark.parametrize("share", [0.1, 1e-3])
def test_white_noise_has_its_share_and_the_converter_its_steps(share):
    exact = {"F_sp1_L": 1e4 + 2e4 * np.sin(np.arange(4000.0))}
    noisy = measured(Noise("white", share), exact, TIMES[:4000], rng(), {"F": 3e4})["F_sp1_L"]
    sigma = share * rms(exact["F_sp1_L"])
    off = noisy - exact["F_sp1_L"]
    assert np.std(off) == pytest.approx(sigma, rel=0.05)
    step = np.diff(np.unique(noisy)).min()
    assert sigma / 16 < step <= sigma / 8
    assert np.log2(step) == round(np.log2(step))
    power = np.abs(np.fft.rfft(off)) ** 2
    assert power[1:1000].mean() == pytest.approx(power[1000:2000].mean(), rel=0.2)


@pytest.mark.parametrize("kind", ["coloured", "coloured_hard"])
def test_coloured_noise_is_slow_by_its_share_and_has_the_lines_of_the_mains(kind):
    noise = draw_noise(rng(), kind, 0.01)
    slow = sum(noise.parts[name]["power"] for name in ("drift", "hum"))
    total = random_part(noise, TIMES, rng(), 0.3)
    assert rms(total) == pytest.approx(1.0, rel=0.05)
    power = np.abs(np.fft.rfft(total)) ** 2
    hertz = np.fft.rfftfreq(len(total), 1e-5)
    top = power[hertz > 5000.0].mean()
    assert top * len(power) / power.sum() == pytest.approx(1.0 - slow, abs=0.08)
    lines = [power[hertz == 50.0 * (k + 1)][0] for k in range(len(noise.parts["hum"]["lines"]))]
    assert sum(lines) / power.sum() == pytest.approx(noise.parts["hum"]["power"], rel=0.3)
    if kind == "coloured_hard":
        assert slow == pytest.approx(0.4)
    else:
        assert all(noise.parts[name]["power"] <= 0.25 for name in ("drift", "hum"))


def test_hum_of_all_channels_comes_from_one_mains():
    noise = Noise("coloured", 0.01, parts={"hum": {"power": 1.0, "lines": [1.0]}})
    one, other = (random_part(noise, TIMES, np.random.default_rng(i), 0.3) for i in (1, 2))
    assert abs(one @ other) == pytest.approx(one @ one, rel=1e-9)


@pytest.mark.parametrize(("order", "gain", "turn"), [(1, 0.5**0.5, 45.0), (2, 0.625, 90.0)])
def test_a_filter_answers_a_sine_at_its_corner_as_it_must(order, gain, turn):
    part = {"order": order, "corner": 10.0, "ratio": 0.8}
    corner = 10.0 * omega_n()
    times = np.arange(20_000) * 0.02 / corner
    passed = low_pass(np.exp(1j * corner * times)[:, None].real, times[1], part)[-5000:, 0]
    wave = np.exp(1j * corner * times[-5000:])
    found = np.linalg.lstsq(np.stack([wave.real, wave.imag], axis=1), passed, rcond=None)[0]
    assert np.hypot(*found) == pytest.approx(gain, rel=1e-3)
    assert np.degrees(np.arctan2(found[1], found[0])) == pytest.approx(turn, abs=0.1)


def test_a_filtered_run_is_late_by_its_delay_and_its_filter():
    part = {"order": 1, "corner": 20.0, "ratio": 1.0, "delay_s": 4e-6}
    late = part["delay_s"] + 1.0 / (part["corner"] * omega_n())
    watch = Sampling(20, 30, (late,), part["delay_s"])
    found = simulate_motion(rig_model(NOMINAL, POINT), 0.4, np.zeros(30), watch)
    seen, same = deterministic(
        Noise("filtered", 0.01, parts={"filter": part}), found.now, found.fine
    )
    assert same is seen
    exact, before = channels_of(found.now), channels_of(found.before[0])
    for name in ("x_sp1_L", "v_rp2_R", "F_sp3_R"):
        assert rms(seen[name] - before[name]) < 0.05 * rms(seen[name] - exact[name])
        assert rms(seen[name] - before[name]) > 1e-6 * rms(exact[name])


def test_gratings_off_centre_show_once_a_turn_to_ground(motion):
    off = np.full((1, 9), 1e-5)
    part = {"counts": 2**18, "rate": "spline", "off": off.tolist(), "angle": (0.0 * off).tolist()}
    exact = channels_of(motion)
    smooth = encoded(exact, motion, part, counted=False)
    r_s, r_p, _, r_c = radii()
    cycles = motion.phase / (2.0 * np.pi)
    for body, radius, period in (("s_L", r_s, 19.9904), ("p2_R", r_p, 37.0192), ("c", r_c, 77.0)):
        error = smooth[f"u_{body}"] - exact[f"u_{body}"]
        turn = 2.0 * np.pi * cycles / period
        columns = np.stack([np.cos(turn), np.sin(turn), cycles**0, cycles], axis=1)
        fit, left, *_ = np.linalg.lstsq(columns, error, rcond=None)
        assert np.hypot(*fit[:2]) == pytest.approx(1e-5 * radius, rel=0.3)
        assert left[0] < 0.2 * np.sum(error**2) or body == "c"
    assert turns()[3] < 0.0 < turns()[0]


@pytest.mark.parametrize("counts", [2**18, 2**20])
def test_encoders_count_in_steps_and_x_and_v_come_from_the_counts(motion, counts):
    part = {"counts": counts, "rate": "central", "off": np.zeros((1, 9)).tolist()}
    part["angle"] = part["off"]
    seen = encoded(channels_of(motion), motion, part, counted=True)
    u = np.stack([seen[f"u_{b}"] for b in BODIES], axis=1)
    x = geometry(u) * COS_BETA - NOMINAL.e_sp * np.sin(motion.phase)[:, None]
    for j, m in enumerate(MESHES):
        np.testing.assert_allclose(seen[f"x_{m}"], x[:, j], atol=1e-19)
    step = 2.0 * np.pi / counts * radii()[0]
    off = seen["u_s_L"] - motion.u[:, 0]
    assert rms(off - off.mean()) == pytest.approx(step / np.sqrt(12.0), rel=0.1)
    slope = np.gradient(x[:, 0] + NOMINAL.e_sp * np.sin(motion.phase), motion.times)
    v = slope - NOMINAL.e_sp * rig_model(NOMINAL, POINT).omega * np.cos(motion.phase)
    np.testing.assert_allclose(seen["v_sp1_L"], v, atol=1e-6 * rms(v))
    np.testing.assert_array_equal(seen["F_sp1_L"], motion.force[:, 0])


def test_a_second_set_of_encoders_gives_x_and_not_u(motion):
    part = draw_noise(rng(), "encoders_two", 0.01).parts["encoders"]
    assert part["counts"] in (2**18, 2**19, 2**20)
    assert 0.0 <= np.min(part["off"]) <= np.max(part["off"]) <= 3.0 / 3600.0 * np.pi / 180.0
    seen = encoded(channels_of(motion), motion, part, counted=True)
    u = np.stack([seen[f"u_{b}"] for b in BODIES], axis=1)
    x = geometry(u) * COS_BETA - NOMINAL.e_sp * np.sin(motion.phase)[:, None]
    off = rms(seen["x_sp1_L"] - x[:, 0])
    assert 1e-8 < off < 5e-6
    assert rms(seen["x_sp1_L"] - motion.x[:, 0]) < 5e-6


def test_a_converter_spans_the_campaign_by_its_bits():
    noise = draw_noise(rng(), "quantised", 1e-4)
    part = noise.parts["converter"]
    assert 12 <= part["bits"] <= 16
    exact = {"F_sp1_L": 1e4 * np.sin(0.01 * np.arange(20_000.0))}
    shown = measured(noise, exact, TIMES[:20_000], rng(), {"F": 5e4})["F_sp1_L"]
    step = 2.0 * part["room"] * 5e4 / 2 ** part["bits"]
    np.testing.assert_allclose(shown / step, np.round(shown / step), atol=1e-6)
    assert np.diff(np.unique(shown)).min() == pytest.approx(step, rel=1e-6)


def test_gauges_are_off_by_five_per_cent_and_told_where_calibrated():
    made = make_campaign(draw_plan(3, "none", noise=RequestedNoise("gains")))
    plain = make_campaign(draw_plan(3, "none"))
    gains = made.label["noise"]["gains"]["of"]
    for name in ("F_sp1_L", "F_rp3_R"):
        ratio = rms(made.series[0][name]) / rms(plain.series[0][name])
        assert ratio == pytest.approx(gains[name], rel=1e-3)
    assert 0.95 <= min(gains.values()) < 0.98 < 1.02 < max(gains.values()) <= 1.05
    assert made.campaign.noise_share is None
    assert plain.campaign.noise_share == pytest.approx(0.01)
    assert not made.sensors
    by_counts = make_campaign(
        draw_plan(3, "none", noise=RequestedNoise("encoders"), channels="half_forces")
    )
    assert by_counts.campaign.noise_share is None
    forces = {name for name in by_counts.series[0].names if name.startswith("F_")}
    assert len(forces) == 6
    assert by_counts.sensors == {name: {"gain_tolerance": 0.05} for name in forces}


def test_kinds_are_drawn_from_the_seed_and_told_only_if_white():
    for kind in NOISES:
        one, other = (draw_plan(11, "none", noise=RequestedNoise(kind)).noise for _ in range(2))
        assert one == other
        assert one.share_given is (kind == "white")
        assert (
            draw_plan(12, "none", noise=RequestedNoise(kind)).noise.parts != one.parts
            or not one.parts
        )
    mixed = [
        draw_plan(seed, "none", noise=RequestedNoise("mixture")).noise.parts for seed in range(30)
    ]
    assert all(len(parts) >= 2 for parts in mixed)
    assert set().union(*mixed) == {"drift", "hum", "filter", "encoders", "gains", "converter"}
    with pytest.raises(ParameterError, match="noise must be one of"):
        draw_noise(rng(), "pink", 0.01)


def test_gauges_in_pins_are_off_too() -> None:
    """Each by the gain of the label, within the tolerance of strain gauges."""
    noise, channels = RequestedNoise("gains"), "shafts_pins"
    made = make_campaign(draw_plan(3, "none", noise=noise, channels=channels))
    plain = make_campaign(draw_plan(3, "none", channels=channels))
    gains = made.label["noise"]["gains"]["of"]
    for name in ("F_pin1", "F_pin2", "F_pin3"):
        ratio = rms(made.series[0][name]) / rms(plain.series[0][name])
        assert ratio == pytest.approx(gains[name], rel=1e-3)
    assert max(abs(gains[f"F_pin{i}"] - 1.0) for i in (1, 2, 3)) > 0.01
