"""The file of frozen thresholds, as far as a bench needs it: its hash, and whose seeds it saw."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from herringbone_sim.errors import AnalysisError, shown
from herringbone_sim.recording.safe_yaml import read_yaml

FILES = ("calibration.json", "calibration.yaml")


@dataclass(frozen=True)
class Frozen:
    """Thresholds: where, their hash, and the seeds they were set on as [first, last + 1)."""

    path: Path
    sha256: str
    seeds: tuple[tuple[int, int], ...]


def frozen(file: Path | None = None) -> Frozen | None:
    """The thresholds of the package, or those of a file; None where there are none.

    Raises:
        AnalysisError: a file that does not say its seeds as pairs [first, last + 1].
    """
    here = Path(__file__).parents[1] / "diagnosis"
    files = [file] if file is not None else [here / name for name in FILES]
    found = next((one for one in files if one.is_file()), None)
    if found is None:
        return None
    try:
        seeds = tuple((int(first), int(end)) for first, end in read_yaml(found)["seeds"])
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise AnalysisError(
            f"{found} must have seeds: [[FIRST, LAST + 1], ...], got {shown(error)}: say which "
            "seeds the thresholds were frozen on"
        ) from None
    return Frozen(found, hashlib.sha256(found.read_bytes()).hexdigest(), seeds)


def overlap(known: Frozen | None, seeds: Sequence[int]) -> list[int]:
    """Those of the seeds that thresholds were frozen on, sorted."""
    ranges = known.seeds if known else ()
    return sorted(s for s in seeds if any(first <= s < end for first, end in ranges))
