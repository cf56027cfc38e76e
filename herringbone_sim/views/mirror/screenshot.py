"""Picture of a .rrd file, drawn by the Rerun viewer without a screen."""

from __future__ import annotations

import os
import socket
import subprocess
import tempfile
import time
from pathlib import Path

from rerun.experimental import ViewerClient

from herringbone_sim.errors import RecordingError
from herringbone_sim.views.mirror.sink import (
    HOST,
    ViewerError,
    await_answer,
    rerun_binary,
    temporary_file,
)

SETTLE_S = 1.0
TIMEOUT_S = 90.0
VULKAN_HINT = "the viewer draws with Vulkan: without a GPU `apt install mesa-vulkan-drivers` helps"


def take_screenshot(rrd: Path, png: Path, size: tuple[int, int] = (1400, 900)) -> None:
    """Write a PNG of a .rrd file as the viewer shows it once it has loaded everything.

    Args:
        rrd: the file to show.
        png: the picture to write.
        size: of the window, in points; the picture has two pixels a point.

    Raises:
        ViewerError: no viewer, no Vulkan driver, or no picture in time.
    """
    port = free_port()
    command = [rerun_binary(), "--headless", "--bind", HOST, "--port", str(port)]
    command += ["--hide-welcome-screen", "--window-size", f"{size[0]}x{size[1]}", str(rrd)]
    with temporary_file() as errors:
        viewer = subprocess.Popen(
            command,
            stdout=subprocess.DEVNULL,
            stderr=errors,
            env={**os.environ, "RUST_LOG": "error"},
        )
        try:
            await_answer(viewer, "viewer", errors, HOST, port)
            picture = stable_screenshot(port)
        except (ViewerError, RuntimeError, OSError) as error:
            raise ViewerError(f"no picture of {rrd} ({error}): {VULKAN_HINT}") from error
        finally:
            viewer.kill()
            viewer.wait()
    try:
        png.parent.mkdir(parents=True, exist_ok=True)
        png.write_bytes(picture)
    except OSError as error:
        raise RecordingError(
            f"can't write {png} ({error.strerror}): choose another file"
        ) from error


def stable_screenshot(port: int) -> bytes:
    """Return the PNG of the viewer once two in a row are equal, as it loads in the background.

    Raises:
        ViewerError: they were not within ``TIMEOUT_S`` seconds.
    """
    client = ViewerClient.connect(f"rerun+http://{HOST}:{port}/proxy")
    deadline = time.monotonic() + TIMEOUT_S
    before = b""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "picture.png"
        while time.monotonic() < deadline:
            time.sleep(SETTLE_S)
            client.save_screenshot(str(file))
            picture = file.read_bytes()
            if picture == before:
                return picture
            before = picture
    raise ViewerError(f"the viewer was not done within {TIMEOUT_S:g} s")


def free_port() -> int:
    """Return a free TCP port of the local host."""
    with socket.socket() as probe:
        probe.bind((HOST, 0))
        return int(probe.getsockname()[1])
