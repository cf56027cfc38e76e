"""Commands of a page, run as a user types them."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
BLOCK = re.compile(r"^```sh\n(.*?)^```", re.MULTILINE | re.DOTALL)


def run_page(page: Path, folder: Path, timeout_s: float) -> str:
    """What all ``sh`` blocks of a page print, run by one shell in a folder that sees ``config/``.

    The shell has job control, as a terminal's has, and ends at the first command that fails.
    """
    (folder / "config").symlink_to(ROOT / "config")
    script = "\n".join(BLOCK.findall(page.read_text(encoding="utf-8")))
    here = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    done = subprocess.run(
        ["bash", "-e", "-m", "-c", script],
        cwd=folder,
        env=os.environ | {"PATH": here, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=timeout_s,
        check=False,
    )
    assert done.returncode == 0, done.stdout
    return done.stdout
