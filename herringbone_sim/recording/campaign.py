"""Campaigns: a folder of runs of one rig with their operating points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from herringbone_sim.errors import RecordingError

POINT = ("delta_T", "K", "T_1", "Omega")
ROLES = ("fit", "held_out")


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
    """

    rig: str
    noise_share: float | None
    runs: tuple[CampaignRun, ...]


def read_campaign(folder: Path) -> Campaign:
    """Read ``campaign.yaml`` of a folder.

    Raises:
        RecordingError: no such file, no runs in it, or a run without operating point or role.
    """
    file = folder / "campaign.yaml"
    try:
        content = yaml.safe_load(file.read_text(encoding="utf-8"))
        runs = tuple(_run(folder, entry) for entry in content["runs"])
        rig = str(content["rig"])
    except OSError as error:
        raise RecordingError(f"can't read {file}: {error.strerror}: name a campaign") from error
    except (yaml.YAMLError, KeyError, TypeError, ValueError) as error:
        raise RecordingError(
            f"{file} must list rig and runs with path, role, {', '.join(POINT)}: {error!r}"
        ) from error
    if not runs:
        raise RecordingError(f"{file} lists no runs: a campaign has at least one")
    noise = content.get("noise") or {}
    return Campaign(rig, noise.get("rms_share"), runs)


def _run(folder: Path, entry: Mapping[str, Any]) -> CampaignRun:
    if entry["role"] not in ROLES:
        raise ValueError(f"role {entry['role']!r} of {entry['path']} is none of {ROLES}")
    point = {name: float(entry[name]) for name in POINT}
    return CampaignRun(folder / entry["path"], point, entry["role"])
