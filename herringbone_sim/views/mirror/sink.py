"""Targets of a Rerun recording: a new viewer, a running one, a server, or a file."""

from __future__ import annotations

import errno
import os
import signal
import socket
import subprocess
import tempfile
import time
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path
from shutil import which
from typing import IO, Any
from urllib.parse import urlsplit

import rerun as rr

from herringbone_sim.errors import HerringboneError, ParameterError, RecordingError
from herringbone_sim.views.mirror.target import MirrorTarget

APPLICATION = "herringbone_sim"
HOST, PORT = "127.0.0.1", 9876
START_S = 20.0
PROBE_S = 1.0
STALL_S = 5.0
LAST_BYTES = 4096  # read at the end of an error output to find its last line


# Shell script that runs a command until it ends or its standard input is closed. The input is a
# pipe of this program, which the system closes even if the program is killed.
RUN_WHILE_INPUT_OPEN = (
    'exec 3<&0; "$@" 3<&- </dev/null & running=$!; (read _ <&3; kill $running) & holder=$!; '
    "exec 3<&-; wait $running; ended=$?; kill $holder 2>/dev/null; exit $ended"
)
# Local address of a server that listens on all interfaces.
LOOPBACK_OF = {"0.0.0.0": HOST, "::": "::1"}


class ViewerError(HerringboneError):
    """A viewer can't be started, does not answer, or takes no data."""


@dataclass
class Sink:
    """An open Rerun recording, and the means to notice that its receiver has gone.

    Attributes:
        recording: the stream to log to.
        address: of the receiver, for messages.
        endpoint: host and port of a viewer that must answer, or None.
        viewer: the viewer's process if it was started by ``open_sink``.
        server: the process that serves viewers, if one was started; it ends with this program.
        errors: file with the error output of the viewer or server.
    """

    recording: Any
    address: str
    endpoint: tuple[str, int] | None = None
    viewer: subprocess.Popen[bytes] | None = None
    server: subprocess.Popen[bytes] | None = None
    errors: IO[bytes] | None = None
    _checked: float = field(default_factory=time.monotonic)

    def deliver(self) -> None:
        """Wait until the receiver has the logged data, so that a frozen one does not fill memory.

        Raises:
            ViewerError: the viewer or server has gone (its port is probed once a second at most).
            RuntimeError: the receiver takes no more data.
        """
        self.recording.flush(timeout_sec=STALL_S)
        for name, process in (("viewer", self.viewer), ("server", self.server)):
            if process and process.poll() is not None:
                raise ViewerError(f"the {name} ended{last_error_line(self.errors)}")
        if self.endpoint and time.monotonic() - self._checked > PROBE_S:
            self._checked = time.monotonic()
            if not answers(*self.endpoint):
                raise ViewerError(f"the viewer at {self.address} has gone")

    def close(self, timeout_s: float) -> None:
        """Send the remaining data, disconnect, and end the server if one was started.

        Args:
            timeout_s: longest wait [s] for the data, then again for the server, which is then
                killed.

        Raises:
            RuntimeError: from Rerun, if remaining data can't be sent; all is closed nevertheless.
        """
        try:
            self.recording.flush(timeout_sec=timeout_s)
        finally:
            self.recording.disconnect()
            if self.server:
                end_process(self.server, timeout_s)
            if self.errors:
                self.errors.close()


def open_sink(target: MirrorTarget) -> Sink:
    """Open the sink of a target that is not ``off``.

    For ``spawn``, a viewer that answers at the address is used instead of a new one.

    Raises:
        ParameterError: the address is not of the form ``HOST:PORT``.
        ViewerError: no viewer answers or starts, the port is taken, or a viewer or server is to
            be started at an address of another machine.
        RecordingError: the file can't be written.
    """
    recording = rr.RecordingStream(APPLICATION)
    if target.mode == "save" and target.path is not None:
        return save_to(recording, target.path)
    host, port = parse_address(target.address)
    if target.mode == "serve":
        return serve_at(recording, host, port, target.memory_limit)
    if target.mode == "spawn" and not answers(host, port):
        return spawn_viewer(recording, host, port, target.memory_limit)
    return connect_to(recording, host, port)


def save_to(recording: Any, path: Path) -> Sink:
    """Write a recording to a .rrd file, emptied first; RecordingError if that is impossible."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.open("wb").close()
    except OSError as error:
        raise RecordingError(
            f"can't write {path} ({error.strerror}): choose another file"
        ) from error
    recording.save(path)
    return Sink(recording, str(path))


def serve_at(recording: Any, host: str, port: int, memory_limit: str) -> Sink:
    """Start a server for viewers at a local address, and send it the recording.

    Rerun's server within this process would listen on all interfaces, whatever the address.
    """
    address = own_address(host, port)
    command = [rerun_binary(), "--serve-grpc", "--bind", address, "--port", str(port)]
    command += ["--server-memory-limit", memory_limit]
    command = ["sh", "-c", RUN_WHILE_INPUT_OPEN, "sh", *command]
    return start(recording, "server", command, address, port)


def start(recording: Any, name: str, command: list[str], address: str, port: int) -> Sink:
    """Start a ``server`` or ``viewer`` and send to it once it answers; if it does not, end it.

    It has a session of its own, so that Ctrl-C does not end it.
    """
    near, errors, serves = LOOPBACK_OF.get(address, address), temporary_file(), name == "server"
    process = subprocess.Popen(
        command,
        stdin=subprocess.PIPE if serves else None,
        stdout=subprocess.DEVNULL,
        stderr=errors,
        start_new_session=True,
    )
    try:
        await_answer(process, name, errors, near, port)
        sink = connect_to(recording, near, port)
    except BaseException:
        end_process(process, STALL_S)
        errors.close()
        raise
    viewer, server = (None, process) if serves else (process, None)
    return replace(sink, viewer=viewer, server=server, errors=errors)


def end_process(process: subprocess.Popen[bytes], timeout_s: float) -> None:
    """End a server by closing its input, a viewer by a signal; kill it if it takes too long."""
    if process.stdin:
        process.stdin.close()
    elif process.poll() is None:
        os.killpg(process.pid, signal.SIGTERM)  # with what a script has started
    try:
        process.wait(timeout_s)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def own_address(host: str, port: int) -> str:
    """Return the IP address of a host name; ViewerError if nothing here can listen there."""
    try:
        choices = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
        family, _, _, _, address = min(choices, key=lambda choice: choice[0] != socket.AF_INET)
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            raise ViewerError(f"port {port} is taken: choose another address") from error
        raise ViewerError(
            f"nothing can listen at {host}:{port} ({error.strerror}): name an address of this "
            f"machine, {HOST} for itself alone, 0.0.0.0 for all that reach it"
        ) from error
    return str(address[0])


def connect_to(recording: Any, host: str, port: int) -> Sink:
    """Send to a running viewer or server; ViewerError if none answers.

    The port is probed first, as Rerun itself would wait seconds for one that does not answer.
    """
    if not answers(host, port):
        raise ViewerError(
            f"no viewer answers at {host}:{port}: start one with `rerun --port {port}`"
        )
    url = f"rerun+http://{f'[{host}]' if ':' in host else host}:{port}/proxy"
    recording.connect_grpc(url)
    return Sink(recording, url, endpoint=(host, port))


def spawn_viewer(recording: Any, host: str, port: int, memory_limit: str) -> Sink:
    """Start a viewer at a local address, and send it the recording."""
    address = own_address(host, port)
    command = [rerun_binary(), "--bind", address, "--port", str(port)]
    command += ["--memory-limit", memory_limit, "--expect-data-soon"]
    return start(recording, "viewer", command, address, port)


def await_answer(
    process: subprocess.Popen[bytes], name: str, errors: IO[bytes], host: str, port: int
) -> None:
    """Wait until a process answers at its port; ViewerError if it ends or takes too long."""
    deadline = time.monotonic() + START_S
    while not answers(host, port):
        if process.poll() is not None:
            raise ViewerError(f"the {name} did not start{last_error_line(errors)}")
        if time.monotonic() > deadline:
            raise ViewerError(f"the {name} did not answer within {START_S:g} s")
        time.sleep(0.1)


def rerun_binary() -> str:
    """Return the path of the viewer's program; ViewerError if there is none.

    A ``rerun`` script on the path is a last resort: it starts the program as a child, which would
    continue when the script is ended.
    """
    package = find_spec("rerun_cli")
    folders = package.submodule_search_locations if package else None
    inside = [Path(folder) / "rerun" for folder in folders or []]
    binary = next((str(path) for path in inside if path.exists()), which("rerun"))
    if binary is None:
        raise ViewerError("no `rerun` program found: install it with `pip install rerun-sdk`")
    return binary


def temporary_file() -> IO[bytes]:
    """Open a file without a name; it is deleted when the last program that has it open ends."""
    return tempfile.TemporaryFile()


def last_error_line(errors: IO[bytes] | None) -> str:
    """Return a colon and the last line of a program's error output; empty if there is none.

    Reads without moving the position at which the program writes.
    """
    if errors is None:
        return ""
    size = os.fstat(errors.fileno()).st_size
    tail = os.pread(errors.fileno(), LAST_BYTES, max(size - LAST_BYTES, 0))
    lines = [line for line in tail.decode(errors="replace").splitlines() if line.strip()]
    return f": {lines[-1].strip()}" if lines else ""


def parse_address(address: str) -> tuple[str, int]:
    """Return host and port of ``HOST:PORT``, ``PORT`` or a Rerun URL, with defaults if missing.

    Raises:
        ParameterError: the address has another form.
    """
    text = address.strip()
    if not text:
        return HOST, PORT
    if text.isdigit():
        text = f"{HOST}:{text}"
    try:
        parts = urlsplit(text if "://" in text else f"//{text}")
        return parts.hostname or HOST, parts.port or PORT
    except ValueError as error:
        raise ParameterError(
            f"address must read HOST:PORT, got {address!r}: try {HOST}:{PORT}"
        ) from error


def answers(host: str, port: int) -> bool:
    """Return whether anything listens at a port."""
    try:
        socket.create_connection((host, port), timeout=PROBE_S).close()
    except OSError:
        return False
    return True
