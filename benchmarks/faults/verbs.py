"""Run verbs of the command line on hostile files, each in a process of its own, fast.

A process that has imported the package forks one child a command, so a trial takes milliseconds;
the child's time, memory, exit code and output are measured.
"""

from __future__ import annotations

import importlib
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.faults.trial import HANG_S

ADDRESS_SPACE = 8 << 30
SHOWN = 20_000


@dataclass(frozen=True)
class Attempt:
    """How a command ended.

    Attributes:
        code: exit code; negative where a signal ended it.
        text: what it printed, the first ``SHOWN`` characters.
        printed: bytes that it printed.
        seconds: wall time; a command is killed a second past ``HANG_S``.
        peak_bytes: its largest resident memory.
    """

    code: int
    text: str
    printed: int
    seconds: float
    peak_bytes: int

    @property
    def traceback(self) -> str:
        """Last line of a traceback, empty if it printed none and no signal ended it."""
        if "Traceback (most recent call last)" in self.text:
            return self.text.strip().splitlines()[-1][:300]
        return f"signal {-self.code}" if self.code < 0 else ""


class Verbs:
    """The command line in a warm process: ``with Verbs() as verbs: verbs(["info", path])``."""

    def __init__(self) -> None:
        self._server = subprocess.Popen(
            [sys.executable, "-c", "from benchmarks.faults.verbs import serve; serve()"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=Path(__file__).parents[2],
        )

    def __call__(self, argv: Sequence[str | Path]) -> Attempt:
        """Run ``python -m herringbone_sim ARGV``."""
        assert self._server.stdin is not None
        assert self._server.stdout is not None
        self._server.stdin.write(json.dumps([str(word) for word in argv]) + "\n")
        self._server.stdin.flush()
        return Attempt(**json.loads(self._server.stdout.readline()))

    def __enter__(self) -> Verbs:
        return self

    def __exit__(self, *_: object) -> None:
        self._server.communicate()


def _attempt(argv: list[str]) -> Attempt:
    with tempfile.TemporaryFile() as output:
        began = time.monotonic()
        child = os.fork()
        if child == 0:
            _become(argv, output.fileno())
        _, status, usage = os.wait4(child, 0)
        seconds = time.monotonic() - began
        printed = output.seek(0, os.SEEK_END)
        output.seek(0)
        text = output.read(SHOWN).decode(errors="replace")
        if printed > SHOWN:
            output.seek(printed - 2000)
            text += output.read().decode(errors="replace")
        code = os.waitstatus_to_exitcode(status)
        return Attempt(code, text, printed, seconds, usage.ru_maxrss * 1024)


def _become(argv: list[str], output: int) -> None:
    """In the child: the command, its output into a file, its time and memory bounded."""
    code = 70
    try:
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.dup2(output, 1)
        os.dup2(output, 2)
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_REAL, HANG_S + 1.0)
        resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
        from herringbone_sim.__main__ import main

        code = main(argv)
    except BaseException:
        import traceback

        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _compile() -> None:
    """Have the kernel at hand, or each child would load it anew."""
    from herringbone_sim.core.integrate import Stepper
    from herringbone_sim.core.model import build
    from herringbone_sim.core.parameters import Parameters

    stepper = Stepper(build(Parameters(z_s=30, z_p=30, z_r=90)))
    stepper.advance(stepper.start(), 1)


def serve() -> None:
    """A command a line from the standard input, what became of it a line to the output."""
    for name in ("analyze", "gap", "info", "parameters", "recover", "replay"):
        importlib.import_module(f"herringbone_sim.cli.{name}")
    _compile()
    for line in sys.stdin:
        print(json.dumps(asdict(_attempt(json.loads(line)))), flush=True)
