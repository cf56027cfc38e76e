"""The mirror: what is written, what is dropped, and that no viewer gets in the way."""

from __future__ import annotations

import importlib
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from herringbone_sim.core.layout import Layout
from herringbone_sim.errors import ParameterError
from herringbone_sim.views.mirror.block import Drawing, MirrorBlock, Scale
from herringbone_sim.views.mirror.mirror import RerunMirror
from herringbone_sim.views.mirror.target import MirrorTarget

importlib.import_module("rerun")

REDUCED = Layout(1, numbered=False)
FULL = Layout(3, numbered=True)
SCALE = Scale(1e-4, {"sp": 5e-5, "rp": 5e-5}, 3.2e4)
PLAIN = Drawing(REDUCED)
SCALED = Drawing(REDUCED, SCALE)
FREQUENCY_HZ = 5000.0
SAMPLES = 16
TIMELINES = ("sim_time", "wall_time")


def make_block(
    layout: Layout = REDUCED, start: int = 0, cycles: int = 30, K: float = 0.1, **more: object
) -> MirrorBlock:
    """Harmonic motion of amplitude b_c in every mesh, ``start`` in samples."""
    turns = (start + np.arange(cycles * SAMPLES)) / SAMPLES
    rows = np.zeros((len(turns), len(layout.channels)))
    for column, name in enumerate(layout.channels):
        if name[0] in "xvF" and name != "t":
            rows[:, column] = 1e-4 * np.cos(2 * np.pi * turns)
    rows[:, :5] = np.column_stack(
        [turns / FREQUENCY_HZ, 2 * np.pi * turns, *np.outer([K, 50.0, 220.0], np.ones(len(turns)))]
    )
    return MirrorBlock(
        wall_ns=1_700_000_000_000_000_000 + start,
        names=layout.channels,
        rows=rows,
        sections=rows[::SAMPLES],
        parameters={"K": K, "delta_T": 50.0},
        **more,
    )


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


def read(path: Path) -> dict[str, list[dict[str, object]]]:
    """Rows of each entity, static ones included; ``sim_time`` and ``wall_time`` in ns."""
    from rerun.chunk import RrdReader

    rows: dict[str, list[dict[str, object]]] = {}
    for chunk in RrdReader(path).stream():
        batch = chunk.to_record_batch()
        columns = {
            name: (column.cast("int64") if name in TIMELINES else column).to_pylist()
            for name, column in zip(batch.schema.names, batch.columns, strict=True)
        }
        made = [
            dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)
        ]
        rows.setdefault(chunk.entity_path, []).extend(made)
    return rows


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def wait_for(mirror: RerunMirror, start: str) -> None:
    deadline = time.monotonic() + 60
    while not mirror.state.startswith(start) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert mirror.state.startswith(start)


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


def test_dead_address_fails_without_raising_and_close_returns() -> None:
    mirror = RerunMirror(MirrorTarget("connect", f"127.0.0.1:{free_port()}"), PLAIN)
    wait_for(mirror, "failed: no viewer answers")
    before = mirror.dropped
    assert not mirror.put(make_block())
    assert mirror.dropped == before + 1
    mirror.close(60.0)
    assert not mirror._thread.is_alive()


def test_connect_finds_a_viewer_that_starts_later() -> None:
    from herringbone_sim.views.mirror.sink import rerun_binary

    port = free_port()
    mirror = RerunMirror(MirrorTarget("connect", str(port)), PLAIN)
    wait_for(mirror, "failed")
    server = subprocess.Popen(
        [rerun_binary(), "--serve-grpc", "--port", str(port)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        wait_for(mirror, "running")
        assert mirror.put(make_block(), wait_s=30.0)
        server.kill()
        server.wait()
        wait_for(mirror, "failed")
    finally:
        server.kill()
        server.wait()
        mirror.close(60.0)


def read_so_far(path: Path) -> dict[str, list[dict[str, object]]]:
    """Rows of a file that is being written; none before its first message is whole."""
    try:
        return read(path)
    except (ValueError, RuntimeError):
        return {}


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_server_hands_its_blocks_to_a_viewer(tmp_path: Path) -> None:
    from herringbone_sim.views.mirror.sink import answers, rerun_binary

    port = free_port()
    mirror = RerunMirror(MirrorTarget("serve", str(port)), SCALED)
    assert mirror.put(make_block(), wait_s=30.0)
    deadline = time.monotonic() + 60
    while not answers("127.0.0.1", port) and time.monotonic() < deadline:
        time.sleep(0.05)
    path = tmp_path / "copy.rrd"
    url = f"rerun+http://127.0.0.1:{port}/proxy"
    viewer = subprocess.Popen(
        [rerun_binary(), url, "--port", str(free_port()), "--save", str(path)]
    )
    try:
        while "/section/points" not in read_so_far(path) and time.monotonic() < deadline:
            time.sleep(0.1)
        assert "/section/points" in read(path)
    finally:
        mirror.close(60.0)
        viewer.terminate()
        viewer.wait(30)


def test_port_that_is_taken_is_said() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        mirror = RerunMirror(MirrorTarget("serve", str(taken.getsockname()[1])), PLAIN)
        wait_for(mirror, "failed: port")
        mirror.close(60.0)


def listens(host: str, port: int) -> bool:
    from herringbone_sim.views.mirror.sink import answers

    return answers(host, port)


@pytest.mark.parametrize(
    ("address", "open_at"),
    [
        ("{port}", {"127.0.0.1"}),
        ("127.0.0.1:{port}", {"127.0.0.1"}),
        ("localhost:{port}", {"127.0.0.1"}),
        ("127.0.0.2:{port}", {"127.0.0.2"}),
        ("0.0.0.0:{port}", {"127.0.0.1", "127.0.0.2"}),
    ],
)
def test_a_server_listens_where_it_was_asked_to(address: str, open_at: set[str]) -> None:
    port = free_port()
    mirror = RerunMirror(MirrorTarget("serve", address.format(port=port)), PLAIN)
    assert mirror.put(make_block(), wait_s=30.0)
    try:
        deadline = time.monotonic() + 60
        while not any(listens(host, port) for host in open_at) and time.monotonic() < deadline:
            time.sleep(0.1)
        assert mirror.state == "running"
        heard = {host for host in ("127.0.0.1", "127.0.0.2") if listens(host, port)}
    finally:
        mirror.close(60.0)
    assert heard == open_at
    assert not any(listens(host, port) for host in open_at)


@pytest.mark.parametrize("host", ["192.0.2.1", "no.such.host.invalid"])
def test_an_address_of_another_machine_is_not_served_at(host: str) -> None:
    mirror = RerunMirror(MirrorTarget("serve", f"{host}:{free_port()}"), PLAIN)
    wait_for(mirror, "failed")
    mirror.close(60.0)
    assert host in mirror.state


def test_a_server_ends_with_its_program_even_when_that_is_killed() -> None:
    port = free_port()
    program = (
        "import os, signal\n"
        "from herringbone_sim.views.mirror.sink import open_sink\n"
        "from herringbone_sim.views.mirror.target import MirrorTarget\n"
        f"open_sink(MirrorTarget('serve', '{port}'))\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    killed = subprocess.Popen([sys.executable, "-c", program])
    deadline = time.monotonic() + 60
    while killed.poll() is None and time.monotonic() < deadline:
        time.sleep(0.05)
    assert killed.returncode == -signal.SIGKILL
    while listens("127.0.0.1", port) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not listens("127.0.0.1", port)


def test_what_a_viewer_said_lies_in_no_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from herringbone_sim.views.mirror.sink import last_error_line, temporary_file

    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with temporary_file() as errors:
        for text in ("first", "the port is lost"):
            subprocess.run(["sh", "-c", f"echo {text} >&2"], stderr=errors, check=True)
            assert last_error_line(errors) == f": {text}"
        assert list(tmp_path.iterdir()) == []


def test_a_server_that_ends_is_told_and_started_again() -> None:
    port = free_port()
    told: list[str] = []
    mirror = RerunMirror(MirrorTarget("serve", str(port)), PLAIN, report=told.append)
    assert mirror.put(make_block(), wait_s=30.0)
    wait_for(mirror, "running")
    deadline = time.monotonic() + 60
    while not listens("127.0.0.1", port) and time.monotonic() < deadline:
        time.sleep(0.1)
    (server,) = [pid for pid in pids() if f"--port\0{port}\0" in pid[1]]
    os.kill(server[0], signal.SIGKILL)
    wait_for(mirror, "failed")
    wait_for(mirror, "running")
    mirror.close(60.0)
    assert len(told) == 1


def pids() -> list[tuple[int, str]]:
    """Processes of the viewer's program on this machine with their command lines."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if "rerun" in (folder / "exe").readlink().name:
                found.append((int(folder.name), (folder / "cmdline").read_text()))
    return found


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
        (lambda: MirrorTarget("show"), "mode"),
        (lambda: MirrorTarget("save"), "path"),
        (lambda: Drawing(REDUCED, burst_cycles=0), "burst_cycles"),
        (lambda: Drawing(REDUCED, mesh="sp9_L"), "mesh"),
        (lambda: RerunMirror(MirrorTarget("off"), PLAIN, queue_blocks=0), "queue_blocks"),
    ],
)
def test_impossible_options_are_refused(make: Callable[[], object], match: str) -> None:
    with pytest.raises(ParameterError, match=match):
        make()


def test_block_of_wrong_shape_is_refused() -> None:
    with pytest.raises(ParameterError, match="rows"):
        MirrorBlock(0, ("t", "K"), np.zeros((3, 1)), np.zeros((0, 2)))
    with pytest.raises(ParameterError, match="'t'"):
        MirrorBlock(0, ("K",), np.zeros((3, 1)), np.zeros((0, 1)))


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
