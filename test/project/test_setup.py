"""``scripts/setup.sh bench``: the peers that install are installed, the others are named."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
# Stands for the interpreter of .venv: notes what pip is asked for, and can't install some.
PYTHON = """#!/usr/bin/env bash
printf '%s\\n' "$*" >>"$(dirname "$0")/asked"
case "$*" in
  *sysconfig*) dirname "$0" ;;
  *-r\\ requirements-bench.txt*) exit 1 ;;
  *install*"{broken}"*) echo 'ERROR: CMake must be installed to build it'; exit 1 ;;
esac
"""


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A copy of what the script reads, with an interpreter that only pretends."""
    shutil.copytree(ROOT / "scripts", tmp_path / "scripts")
    for file in ROOT.glob("requirements*.txt"):
        shutil.copy(file, tmp_path)
    for folder in ("core", "core/lanes"):
        (tmp_path / "herringbone_sim" / folder).mkdir(parents=True)
        (tmp_path / "herringbone_sim" / folder / "a.py").write_text("")
    (tmp_path / ".venv" / "bin").mkdir(parents=True)
    return tmp_path


def set_up(project: Path, broken: str) -> subprocess.CompletedProcess[str]:
    python = project / ".venv" / "bin" / "python"
    python.write_text(PYTHON.replace("{broken}", broken))
    python.chmod(0o755)
    nothing = project / "nothing"  # no apt-get is reached from the test
    nothing.mkdir(exist_ok=True)
    for name in ("apt-get", "sudo"):
        (nothing / name).write_text("#!/bin/sh\nexit 1\n")
        (nothing / name).chmod(0o755)
    return subprocess.run(
        ["bash", str(project / "scripts" / "setup.sh"), "bench"],
        env={**os.environ, "PATH": f"{nothing}:{os.environ['PATH']}"},
        capture_output=True,
        text=True,
        timeout=60,
    )


def test_a_peer_that_cannot_be_built_is_named_and_the_rest_is_there(project: Path) -> None:
    done = set_up(project, "numbalsoda")
    assert done.returncode == 0, done.stderr
    asked = (project / ".venv" / "bin" / "asked").read_text()
    assert "-r requirements.txt" in asked
    assert "heyoka>=" in asked
    assert "pynamicalsys>=" in asked
    (line,) = [line for line in done.stdout.splitlines() if "not installed" in line]
    assert "numbalsoda" in line
    assert "CMake must be installed" in line
    assert "heyoka" not in line


def test_all_peers_are_installed_once(project: Path) -> None:
    done = set_up(project, "no such peer")
    assert done.returncode == 0, done.stderr
    assert "not installed" not in done.stdout
    asked = project / ".venv" / "bin" / "asked"
    asked.unlink()
    assert set_up(project, "no such peer").returncode == 0
    assert not asked.exists() or "pip install" not in asked.read_text()


def test_without_the_package_itself_there_is_an_error(project: Path) -> None:
    done = set_up(project, "-r requirements.txt")
    assert done.returncode != 0
    assert "requirements.txt" in done.stderr


def test_what_pip_takes_as_a_whole_has_a_wheel_for_each() -> None:
    whole, built = (ROOT / f"requirements-{name}.txt" for name in ("bench", "bench-built"))
    assert "numbalsoda" not in whole.read_text()
    assert "numbalsoda" in built.read_text()
