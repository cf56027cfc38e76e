"""Campaigns: a folder of runs of one rig with their operating points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import yaml

from herringbone_sim.errors import RecordingError

POINT = ("delta_T", "K", "T_1", "Omega")
ROLES = ("fit", "held_out")
FIELDS = f"path, role ({' or '.join(ROLES)}) and {', '.join(POINT)}"


@dataclass(frozen=True)
class CampaignRun:
    """One run: its folder, operating point (delta_T [K], K, T_1 [N m], Omega) and role."""

    path: Path
    point: Mapping[str, float]
    role: str


@dataclass(frozen=True)
class Campaign:
    """Runs of one rig.

    Attributes:
        rig: name.
        noise_share: RMS of the noise as a share of each channel's RMS; None when unknown.
        runs: in the order of the file.
        faults: (path, reason) of the entries that say nonsense and were left out.
    """

    rig: str
    noise_share: float | None
    runs: tuple[CampaignRun, ...]
    faults: tuple[tuple[str, str], ...] = ()


def read_campaign(folder: Path) -> Campaign:
    """Read ``campaign.yaml`` of a folder.

    An entry without path, role or operating point is left out and told in ``faults``.

    Raises:
        RecordingError: no such file, no runs in it, none of them with operating point and role,
            or a share of noise that can't be one.
    """
    file = folder / "campaign.yaml"
    try:
        content = yaml.safe_load(file.read_text(encoding="utf-8"))
        entries, rig = list(content["runs"]), str(content["rig"])
        noise = dict(content.get("noise") or {})
    except OSError as error:
        raise RecordingError(f"can't read {file}: {error.strerror}: name a campaign") from error
    except (yaml.YAMLError, KeyError, TypeError, ValueError) as error:
        raise RecordingError(f"{file} must list rig and runs: {error!r}: mend it") from error
    if not entries:
        raise RecordingError(f"{file} lists no runs: a campaign has at least one")
    runs, faults = _runs(folder, entries)
    if not runs:
        told = "; ".join(f"{name}: {reason}" for name, reason in faults)
        raise RecordingError(f"{file} lists no run of a campaign that can be used: {told}")
    return Campaign(rig, _noise_share(file, noise), tuple(runs), tuple(faults))


def _runs(folder: Path, entries: Sequence[Any]) -> tuple[list[CampaignRun], list[tuple[str, str]]]:
    runs: list[CampaignRun] = []
    faults = []
    for i, entry in enumerate(entries):
        name = str(entry.get("path", f"entry {i}")) if isinstance(entry, dict) else f"entry {i}"
        try:
            run = _run(folder, entry)
        except (TypeError, ValueError) as error:
            faults.append((name, f"campaign.yaml must give it {FIELDS}, got {entry}: {error}"))
            continue
        if any(run.path == other.path for other in runs):
            faults.append((name, "campaign.yaml lists it twice: the second entry is not used"))
        elif any(run.path.name == other.path.name for other in runs):
            told = f"another run has the folder name {run.path.name}: give it a name of its own"
            faults.append((name, told))
        else:
            runs.append(run)
    return runs, faults


def _run(folder: Path, entry: Mapping[str, Any]) -> CampaignRun:
    if not isinstance(entry, Mapping):
        raise TypeError("an entry is a mapping of names to values")
    lacking = [name for name in ("path", "role", *POINT) if name not in entry]
    if lacking:
        hint = " (K is 0 without control)" if "K" in lacking else ""
        raise ValueError(f"{', '.join(lacking)} is missing{hint}")
    if entry["role"] not in ROLES:
        raise ValueError(f"role {entry['role']!r} is none of {', '.join(ROLES)}")
    point = {name: float(entry[name]) for name in POINT}
    if not all(map(isfinite, point.values())):
        raise ValueError("an operating point must be finite")
    return CampaignRun(folder / str(entry["path"]), point, entry["role"])


def _noise_share(file: Path, noise: Mapping[str, Any]) -> float | None:
    share = noise.get("rms_share")
    if share is None:
        return None
    if isinstance(share, bool) or not isinstance(share, int | float) or not 0.0 < share < 1.0:
        raise RecordingError(
            f"noise.rms_share of {file} must be a share of the RMS between 0 and 1, 0.01 for "
            f"40 dB, got {share!r}: mend it, or leave noise out where it is unknown"
        )
    return float(share)
