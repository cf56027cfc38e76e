"""One trial of a fault campaign, and what a campaign promises."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

# The benchmark promises 10; a busy machine may take longer.
HANG_S = float(os.environ.get("HERRINGBONE_HANG_S", "10"))
MOST_BYTES = 1 << 30
MOST_LOST_S = 0.5


@dataclass(frozen=True)
class Trial:
    """What one fault did.

    Attributes:
        fault: what was done, with all that repeats it.
        seconds: wall time of the slowest process; 0 where none was measured.
        peak_bytes: largest resident memory of a process; 0 where none was started.
        traceback: text of a traceback that a user would see, empty if there is none.
        lost_s: wall time of recording that is gone [s]; 0 where nothing is recorded.
        altered: values that came back other than they were written, without an error.
        broken: other promises that did not hold, a sentence each.
    """

    fault: str
    seconds: float = 0.0
    peak_bytes: int = 0
    traceback: str = ""
    lost_s: float = 0.0
    altered: int = 0
    broken: tuple[str, ...] = ()

    def failures(self) -> list[str]:
        """A sentence on each promise that this trial broke; empty where it survived."""
        said = list(self.broken)
        if self.traceback:
            said.append(f"a traceback: {self.traceback}")
        if self.seconds > HANG_S:
            said.append(f"took {self.seconds:.1f} s, more than {HANG_S:g} s")
        if self.peak_bytes > MOST_BYTES:
            said.append(
                f"took {self.peak_bytes / 2**20:.0f} MiB, more than {MOST_BYTES >> 20} MiB"
            )
        if self.lost_s > MOST_LOST_S:
            said.append(f"lost {self.lost_s:.2f} s, more than {MOST_LOST_S:g} s")
        if self.altered:
            said.append(f"{self.altered} altered values were accepted")
        return said


# A campaign makes one trial of a seed in a new, empty folder; the same seed makes the same fault.
Campaign = Callable[[int, Path], Trial]
