"""The mirror: what is written, what is dropped, and that no viewer gets in the way."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mirror_support import (
    FREQUENCY_HZ,
    PLAIN,
    REDUCED,
    SAMPLES,
    SCALE,
    SCALED,
    make_block,
    read,
    wait_for,
)

from herringbone_sim.core.layout import Layout
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.errors import ParameterError
from herringbone_sim.views.mirror.block import Drawing, MirrorBlock
from herringbone_sim.views.mirror.mirror import RerunMirror
from herringbone_sim.views.mirror.replay import at_temperature
from herringbone_sim.views.mirror.target import MirrorTarget

FULL = Layout(3, numbered=True)


def save(path: Path, blocks: list[MirrorBlock], drawing: Drawing = SCALED) -> None:
    mirror = RerunMirror(MirrorTarget("save", path=path), drawing)
    for block in blocks:
        assert mirror.put(block, wait_s=30.0)
    mirror.close(60.0)
    assert mirror.state == "off"
    assert mirror.dropped == 0


def rrd(command: str, path: Path) -> str:
    from herringbone_sim.views.mirror.sink import rerun_binary

    arguments = [rerun_binary(), "rrd", command, str(path)]
    done = subprocess.run(arguments, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


@pytest.mark.parametrize("layout", [REDUCED, FULL], ids=["reduced", "full"])
def test_saved_file_is_read_by_rerun_and_holds_every_view(tmp_path: Path, layout: Layout) -> None:
    path = tmp_path / "deep" / "run.rrd"
    blocks = [make_block(layout, 480 * i, events=(f"block {i}",)) for i in range(3)]
    save(path, blocks, Drawing(layout, SCALE))
    rrd("verify", path)
    assert "no footer" not in rrd("stats", path).lower()
    found = read(path)
    courses = [f"/{a}/{b}" for a in ("displacement", "force") for b in ("sp", "rp")]
    planes = ["/portrait/orbit", "/section/points", "/bifurcation/points/21", "/contact/lanes"]
    for entity in [*courses, *planes, "/displacement/sp/backlash", "/status", "/events"]:
        assert entity in found, sorted(found)


def test_time_courses_hold_the_last_cycles_in_micrometres(tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    save(path, [make_block(cycles=30)], Drawing(REDUCED, SCALE, burst_cycles=10))
    rows = [row for row in read(path)["/displacement/sp"] if row.get("Scalars:scalars")]
    assert len(rows) == 10 * SAMPLES + 1
    last = rows[-1]["sim_time"]
    values = np.array([row["Scalars:scalars"] for row in rows])
    assert values.shape[1] == 2
    assert values.max() == pytest.approx(100.0)
    assert last == pytest.approx((30 * SAMPLES - 1) / SAMPLES / FREQUENCY_HZ * 1e9)


def test_only_what_is_there_is_shown(tmp_path: Path) -> None:
    block = make_block()
    pick = [block.names.index(name) for name in ("t", "x_sp_L", "F_rp_R")]
    names = tuple(block.names[i] for i in pick)
    path = tmp_path / "run.rrd"
    save(path, [MirrorBlock(0, names, block.rows[:, pick], np.empty((0, 3)))])
    found = {entity for entity in read(path) if entity != "/__properties"}
    assert {"/displacement/sp", "/force/rp", "/status"} <= found
    for missing in ("/displacement/rp", "/force/sp", "/section", "/bifurcation", "/portrait"):
        assert not [entity for entity in found if entity.startswith(missing)]


def test_time_that_starts_again_goes_on_and_is_told(tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    save(path, [make_block(), make_block()])
    found = read(path)
    times = [row["sim_time"] for row in found["/status"]]
    assert times[1] - times[0] == pytest.approx(30 / FREQUENCY_HZ * 1e9)
    assert "starts again" in str(found["/events"])


@pytest.mark.parametrize("value", [0.0, 5e-324, 1e300, np.nan, np.inf])
def test_single_samples_of_anything_are_shown(tmp_path: Path, value: float) -> None:
    """A slow simulation hands over a sample at a time, the first of them at rest."""
    blocks = []
    for i in range(3 * SAMPLES):
        whole = make_block(start=i, cycles=1)
        rows = whole.rows[:1].copy()
        rows[:, 5:] = value
        blocks.append(replace(whole, rows=rows, sections=rows[: i % SAMPLES == 0]))
    save(tmp_path / "run.rrd", blocks)
    assert "/section/frame/ticks" in read(tmp_path / "run.rrd")


def test_times_that_are_no_numbers_are_shown_somehow(tmp_path: Path) -> None:
    whole = make_block()
    rows = whole.rows.copy()
    rows[100:200, :2] = np.nan
    save(tmp_path / "run.rrd", [whole, replace(whole, rows=rows), make_block(start=480)])


def test_a_block_that_fails_is_told_once_and_the_next_is_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from herringbone_sim.views.mirror import stream as rerun_stream

    send = rerun_stream.RerunStream.send
    seen: list[int] = []

    def fragile(self: rerun_stream.RerunStream, block: MirrorBlock) -> None:
        seen.append(block.wall_ns)
        if len(seen) in (2, 3, 4):
            raise ValueError("math domain error")
        send(self, block)

    monkeypatch.setattr(rerun_stream.RerunStream, "send", fragile)
    told: list[str] = []
    path = tmp_path / "run.rrd"
    mirror = RerunMirror(MirrorTarget("save", path=path), SCALED, report=told.append)
    for i in range(8):
        assert mirror.put(make_block(start=480 * i, events=(f"block {i}",)), wait_s=30.0)
        if i == 3:
            wait_for(mirror, "failed: math domain error")
    mirror.close(60.0)
    assert mirror.state == "off"
    assert mirror.dropped == 3
    assert len(told) == 1
    assert "math domain error" in told[0]
    events = str(read(path)["/events"])
    assert "block 0" in events
    assert "block 3" not in events
    assert all(f"block {i}" in events for i in (4, 5, 6, 7))


def test_a_file_that_can_be_written_later_is_written(tmp_path: Path) -> None:
    (tmp_path / "here").write_text("in the way")
    told: list[str] = []
    path = tmp_path / "here" / "run.rrd"
    mirror = RerunMirror(MirrorTarget("save", path=path), PLAIN, report=told.append)
    wait_for(mirror, "failed")
    (tmp_path / "here").unlink()
    deadline = time.monotonic() + 30
    while not mirror.put(make_block()) and time.monotonic() < deadline:
        time.sleep(0.1)
    mirror.close(60.0)
    assert mirror.state == "off"
    assert len(told) == 1
    assert "/displacement/sp" in read(path)


def test_full_queue_drops_and_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from threading import Event

    from herringbone_sim.views.mirror.stream import RerunStream

    taken, go_on = Event(), Event()
    seen = []

    def slow(self: RerunStream, block: MirrorBlock) -> None:
        seen.append(block)
        taken.set()
        go_on.wait(60)

    monkeypatch.setattr(RerunStream, "send", slow)
    mirror = RerunMirror(MirrorTarget("save", path=tmp_path / "run.rrd"), PLAIN, queue_blocks=2)
    assert mirror.put(make_block())
    assert taken.wait(60)
    assert [mirror.put(make_block(start=i)) for i in range(5)] == [True, True, False, False, False]
    assert mirror.dropped == 3
    go_on.set()
    mirror.close(60.0)
    assert len(seen) == 3


def test_file_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    mirror = RerunMirror(MirrorTarget("save", path=tmp_path / "file" / "run.rrd"), PLAIN)
    wait_for(mirror, "failed: can't write")
    mirror.close(60.0)
    assert mirror.state.startswith("failed")


def test_off_takes_nothing_and_counts_nothing() -> None:
    mirror = RerunMirror(MirrorTarget("off"), PLAIN)
    assert not mirror.put(make_block())
    assert (mirror.state, mirror.dropped) == ("off", 0)
    mirror.close()


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: Drawing(REDUCED, burst_cycles=0), "burst_cycles"),
        (lambda: Drawing(REDUCED, mesh="sp9_L"), "mesh"),
    ],
)
def test_impossible_options_are_refused(make: Callable[[], object], match: str) -> None:
    with pytest.raises(ParameterError, match=match):
        make()


def test_a_failure_that_repeats_is_told_rarely_with_its_count(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from herringbone_sim.views.mirror import mirror as rerun_mirror

    now = [100.0]
    monkeypatch.setattr(rerun_mirror, "monotonic", lambda: now[0])
    lines: list[str] = []
    told = rerun_mirror.FailureReporter(lines.append)
    for _ in range(25):
        told("failed: a")
        now[0] += 1.0
    told("failed: b")
    assert lines == ["failed: a", "failed: a (11 times)", "failed: a (21 times)", "failed: b"]


def test_a_temperature_that_is_not_finite_leaves_the_gear_as_it_is() -> None:
    """As a NaN at the end of a block of a recording."""
    gear = Parameters(delta_T=40.0)
    assert at_temperature(gear, {"delta_T": float("nan")}) is gear
    assert at_temperature(gear, {"delta_T": 50.0}) == gear.changed({"delta_T": 50.0})


def test_nothing_of_before_a_restart_is_in_the_portrait_and_the_lanes(monkeypatch) -> None:
    from unittest.mock import MagicMock

    from herringbone_sim.views.mirror.lanes import ContactLanes
    from herringbone_sim.views.mirror.stream import RerunStream

    seen = []
    monkeypatch.setattr(ContactLanes, "send", lambda self, times, x, b: seen.append(times))
    stream = RerunStream(MagicMock(), SCALED)
    for start in (80000, 80160, 0, 160):
        stream.send(make_block(start=start, cycles=10))
    assert [len(times) for times in seen] == [160, 320, 160, 320]
    assert all((np.diff(times) > 0.0).all() for times in seen)


def test_a_hole_in_the_phase_does_not_shorten_the_last_cycles() -> None:
    from herringbone_sim.views.mirror.stream import last_cycles

    block = make_block(cycles=30)
    rows = block.rows.copy()
    rows[-1, block.names.index("phase")] = np.nan
    assert last_cycles(rows, block.names, 20) == pytest.approx(159, abs=1)
