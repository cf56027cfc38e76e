"""Seeds of campaigns: parsed from text, and compared with those of the weights of the judge."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from herringbone_sim.diagnosis.judge import FILE
from herringbone_sim.errors import AnalysisError, ParameterError, shown
from herringbone_sim.recording.safe_yaml import read_yaml

MOST = 1_000_000  # seeds of a command


@dataclass(frozen=True)
class Frozen:
    """Weights file: path, SHA-256, and the seeds it was fitted on as ranges [first, last + 1)."""

    path: Path
    sha256: str
    seeds: tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class SeedOverlap:
    """Seeds of a bench that the weights of the judge were fitted on.

    Attributes:
        frozen: the weights file, None if there is none.
        seeds: the seeds in common.
    """

    frozen: Frozen | None
    seeds: tuple[int, ...]


def parse_seeds(text: str) -> tuple[int, ...]:
    """Return the seeds of ``2000:2200`` (end excluded), ``1,5,9``, or both; each once, sorted.

    Raises:
        ParameterError: another form, a range of none, a negative seed, or more than 1000000.
    """
    ranges = []
    try:
        for part in text.split(","):
            first, colon, end = part.strip().partition(":")
            ranges.append(range(int(first), int(end) if colon else int(first) + 1))
    except ValueError:
        raise ParameterError(
            f"seeds are numbers and ranges, got {shown(text)}: write them like 2000:2200 or 1,5,9"
        ) from None
    if not all(ranges):
        raise ParameterError(f"ranges of seeds must grow, got {shown(text)}: write 2000:2200")
    count = sum(one.stop - one.start for one in ranges)
    if count > MOST:
        raise ParameterError(f"up to {MOST} seeds at a time, got {shown(count)}: name fewer")
    seeds = {seed for one in ranges for seed in one}
    if min(seeds) < 0:
        raise ParameterError(f"seeds may not be below 0, got {shown(text)}")
    return tuple(sorted(seeds))


def frozen() -> Frozen | None:
    """Read path, hash and seeds of the weights of the judge; None if the file is missing.

    Raises:
        AnalysisError: the file does not give its seeds as pairs [first, last + 1].
    """
    if not FILE.is_file():
        return None
    try:
        seeds = tuple((int(first), int(end)) for first, end in read_yaml(FILE)["seeds"])
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise AnalysisError(
            f"{FILE} must have seeds: [[FIRST, LAST + 1], ...], got {shown(error)}: say which "
            "seeds the thresholds were frozen on"
        ) from None
    return Frozen(FILE, hashlib.sha256(FILE.read_bytes()).hexdigest(), seeds)


def check_seeds(seeds: Sequence[int], calibration_family: bool) -> SeedOverlap:
    """Compare seeds with those that the weights of the judge were fitted on.

    Args:
        calibration_family: accept an overlap; it is then marked in the table.

    Raises:
        AnalysisError: an overlap that was not accepted.
    """
    known = frozen()
    ranges = known.seeds if known else ()
    used = sorted(s for s in seeds if any(first <= s < end for first, end in ranges))
    if used and not calibration_family:
        raise AnalysisError(
            f"{len(used)} of the seeds, {used[0]} .. {used[-1]}, are among those that the "
            f"thresholds in {known.path.name if known else ''} were frozen on: report on others, "
            "or give --calibration-family, which marks the table"
        )
    return SeedOverlap(known, tuple(used))
