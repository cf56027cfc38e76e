"""Effects in the node: at the start, switched live, recorded, and repeated."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from std_msgs.msg import String
from support import LATCHED, Bench, wait_until

from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.effects.evaluate import forces, motion
from herringbone_sim.effects.written import effects_text, read_effects
from herringbone_sim.errors import ParameterError
from herringbone_sim.recording.parameter_file import gear_of_values
from herringbone_sim.recording.reader import Recording, read_recording
from herringbone_sim.replay import verify

CRACK = "tooth_crack@sp/1/L:depth=0.3,member=sun"
RING = "ring_flexibility@rp:stiffness=3e9"
START = {"model": "full", "delta_T": 85.0, "real_time_factor": 0.1}


def go_on(node: object, seconds: float = 0.02) -> None:
    wait_until(lambda: node.loop.ready, 600.0)  # type: ignore[attr-defined]
    reached = node.loop.t_s  # type: ignore[attr-defined]
    wait_until(lambda: node.loop.t_s > reached + seconds, 60.0)  # type: ignore[attr-defined]


def wrong(run: Recording, effects: str, low: float, high: float) -> float:
    """RMS of recorded forces less those of the law with effects, as a share, in a span of time."""
    times = run.samples.times
    part = run.samples.rows(*np.searchsorted(times, np.array([low, high]) - 1e-9))
    parameters, _ = gear_of_values(run.channels.parameters)
    model = build(parameters)
    told = forces(model, read_effects(effects), motion(model, part))
    found = part.columns(tuple(f"F_{m}" for m in model.layout.meshes))
    return float(np.sqrt(np.mean((told - found)[5:] ** 2) / np.mean(found**2)))


def test_effects_are_switched_live_recorded_and_repeated(bench: Bench, tmp_path: Path) -> None:
    node = bench.simulator(record=True, record_dir=str(tmp_path), **START)
    go_on(node)
    told = bench.listen(String, "/herringbone_sim/channels", LATCHED)
    wait_until(lambda: told)  # latched: a listener that is found late gets the last message alone
    texts = (CRACK, f"{CRACK}; sensor_gain@rp:gain=1.1", RING, "")
    for n, text in enumerate(texts, start=1):
        answer = bench.set(effects=text)[0]
        assert answer.successful, answer.reason
        wait_until(lambda t=text: node.loop.actives == read_effects(t), 600.0)
        wait_until(lambda n=n: len(told) > n)
        go_on(node)
    shown = [json.loads(message.data)["parameters"].get("effects", "") for message in told]
    assert effects_text(read_effects(RING)) in shown
    assert bench.call("record/stop").success
    run = read_recording(next(tmp_path.iterdir()))
    assert [made.values["effects"] for made in run.changes] == list(texts)
    at = [made.t_s for made in run.changes]
    assert wrong(run, "", run.samples.times[0], at[0]) < 1e-9
    assert wrong(run, CRACK, at[0], at[1]) < 1e-9 < wrong(run, "", at[0], at[1])
    assert wrong(run, CRACK, at[1], at[2]) > 0.02  # the sensor, not the machine
    assert wrong(run, "", at[3], run.samples.times[-1]) < 1e-9
    no_jump(run)
    verdict = verify(run)
    assert verdict.identical, verdict
    assert verdict.changes == len(texts)


def no_jump(run: Recording) -> None:
    """x follows v across every change."""
    names = ("sp1_L", "rp3_R")
    x = run.samples.columns(tuple(f"x_{name}" for name in names))
    v = run.samples.columns(tuple(f"v_{name}" for name in names))
    usual = np.abs(np.diff(x, axis=0)).max(axis=0)
    for made in run.changes:
        i = int(np.argmin(np.abs(run.samples.times - made.t_s)))
        dt = run.samples.times[i] - run.samples.times[i - 1]
        assert np.all(np.abs(x[i] - x[i - 1] - 0.5 * dt * (v[i] + v[i - 1])) < 0.2 * usual), made


def test_a_run_that_begins_with_effects_holds_them(bench: Bench, tmp_path: Path) -> None:
    text = f"{RING}; clock_drift:ppm=500; sensor_delay@sp:delay=3e-5"
    node = bench.simulator(record=True, record_dir=str(tmp_path), effects=text, **START)
    go_on(node, 0.01)
    assert bench.set(effects="clock_drift:ppm=-300", K=0.1)[0].successful
    wait_until(lambda: len(node.loop.actives) == 1, 600.0)
    go_on(node, 0.01)
    assert bench.call("record/stop").success
    run = read_recording(next(tmp_path.iterdir()))
    parameters, actives = gear_of_values(run.channels.parameters)
    assert actives == read_effects(text)
    assert parameters == Parameters(model="full", delta_T=85.0)
    steps = np.diff(run.samples.times)
    assert steps.min() > 0.0
    np.testing.assert_allclose([steps[0], steps[-1]] / steps[0], [1.0, 0.9997 / 1.0005], rtol=1e-6)
    assert verify(run).identical


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("squeak", "no effect 'squeak'"),
        ("tooth_crack@sp/7/L", "planet of a locus"),
        ("tooth_crack:depth=7", "depth"),
        ("runout@sp:member=ring", "meshes of a ring"),
        ("sensor_gain:channels=F_none", "F_none"),
        ("channel_swap", "two channels"),
        ("runout amplitude", "no effect"),
    ],
)
def test_effects_that_can_not_be_are_refused(bench: Bench, text: str, rule: str) -> None:
    node = bench.simulator(start_paused=True, **START)
    refused = bench.set(effects=text)[0]
    assert not refused.successful
    assert rule in refused.reason
    assert node.get_parameter("effects").value == ""
    with pytest.raises(ParameterError, match=rule):
        bench.simulator(namespace="two", start_paused=True, effects=text, **START)
