"""Viewers that the mirror connects to or serves: they come late, go, or are not there."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from mirror_support import (
    PLAIN,
    SCALED,
    make_block,
    read,
    wait_for,
)

from herringbone_sim.views.mirror.mirror import RerunMirror
from herringbone_sim.views.mirror.target import MirrorTarget


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


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
        port = taken.getsockname()[1]
        mirror = RerunMirror(MirrorTarget("serve", str(port)), PLAIN)
        wait_for(mirror, f"failed: port {port} is taken")
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


def test_no_viewer_is_started_for_an_address_of_another_machine() -> None:
    from herringbone_sim.views.mirror.sink import ViewerError, open_sink

    port = free_port()
    with pytest.raises(ViewerError, match=r"nothing can listen at 192\.0\.2\.1"):
        open_sink(MirrorTarget("spawn", f"192.0.2.1:{port}"))
    assert not listens("127.0.0.1", port)


@pytest.mark.parametrize("mode", ["serve", "spawn"])
def test_what_does_not_answer_in_time_is_ended(mode: str, monkeypatch: pytest.MonkeyPatch) -> None:
    from herringbone_sim.views.mirror import sink

    port, opened = free_port(), []
    monkeypatch.setattr(sink, "START_S", 0.0)
    monkeypatch.setattr(sink, "answers", lambda *_: False)
    temporary_file = sink.temporary_file
    monkeypatch.setattr(
        sink, "temporary_file", lambda: opened.append(temporary_file()) or opened[-1]
    )
    with pytest.raises(sink.ViewerError, match="did not answer within 0 s"):
        sink.open_sink(MirrorTarget(mode, str(port)))
    assert opened[0].closed
    assert not [pid for pid in pids() if f"--port\0{port}\0" in pid[1]]


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
