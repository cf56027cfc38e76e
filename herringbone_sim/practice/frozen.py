"""The weights file of the judge: its hash, and the seeds it was fitted on."""

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
    """Weights file: path, hash, and the seeds it was fitted on as ranges [first, last + 1)."""

    path: Path
    sha256: str
    seeds: tuple[tuple[int, int], ...]


def frozen(file: Path | None = None) -> Frozen | None:
    """Weights file of the package, or the given one; None if there is none.

    Raises:
        AnalysisError: the file does not give its seeds as pairs [first, last + 1].
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
    """The seeds, sorted, that the weights were fitted on."""
    ranges = known.seeds if known else ()
    return sorted(s for s in seeds if any(first <= s < end for first, end in ranges))
