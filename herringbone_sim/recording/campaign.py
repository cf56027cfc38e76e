"""Read and write ``campaign.yaml``: the runs of one rig with operating points and roles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Any

import yaml

from herringbone_sim.errors import RecordingError, shown
from herringbone_sim.recording.safe_yaml import YamlError, read_yaml

POINT = ("delta_T", "K", "T_1", "Omega")
ROLES = ("fit", "held_out")
# Number of invalid entries that an error message lists with their reason.
MOST_LISTED = 3
# Longest file name of common file systems.
MOST_OF_A_NAME = 255
FIELDS = f"path, role ({' or '.join(ROLES)}) and {', '.join(POINT)}"


@dataclass(frozen=True)
class CampaignRun:
    """Folder, operating point (delta_T [K], K, T_1 [N m], Omega) and role of a run."""

    path: Path
    point: Mapping[str, float]
    role: str


@dataclass(frozen=True)
class Campaign:
    """Runs of one rig.

    Attributes:
        rig: name of the rig.
        noise_share: RMS of the noise over the RMS of a channel, the same for all channels; None
            if unknown.
        runs: valid runs in the order of the file.
        faults: (path, reason) of each invalid entry; it is not in ``runs``.
        sensors: channel -> known values of its sensor, such as ``rms`` of the noise [SI unit of
            the channel] and the relative ``gain_tolerance``.
    """

    rig: str
    noise_share: float | None
    runs: tuple[CampaignRun, ...]
    faults: tuple[tuple[str, str], ...] = ()
    sensors: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


def read_campaign(folder: Path) -> Campaign:
    """Read ``campaign.yaml`` of a folder.

    An entry with an invalid path, role or operating point, or with a path or folder name that
    occurred before, is left out and listed in ``faults``.

    Raises:
        RecordingError: no such file, no valid run in it, or invalid noise or sensor data.
    """
    file = folder / "campaign.yaml"
    try:
        content = read_yaml(file)
        lacking = [name for name in ("rig", "runs") if name not in content]
        if lacking:
            raise ValueError(f"{' and '.join(lacking)} is missing")
        entries, rig = content["runs"], _name(content["rig"])
        if not isinstance(entries, list):
            raise ValueError(f"runs must be a list, got {shown(entries)}")
    except OSError as error:
        raise RecordingError(f"can't read {file}: {error.strerror}: name a campaign") from error
    except YamlError as error:
        raise RecordingError(f"{file}: {error}: mend it") from None
    except ValueError as error:
        raise RecordingError(f"{file} must list rig and runs: {error}: mend it") from None
    share = noise_share(str(file), content.get("noise"))
    if not entries:
        raise RecordingError(f"{file} lists no runs: a campaign has at least one")
    runs, faults = _runs(folder, entries)
    if not runs:
        fault_text = "; ".join(f"{name}: {reason}" for name, reason in faults[:MOST_LISTED])
        fault_text += (
            f"; and {len(faults) - MOST_LISTED} more" if len(faults) > MOST_LISTED else ""
        )
        raise RecordingError(f"{file} lists no run of a campaign that can be used: {fault_text}")
    sensors = sensor_values(str(file), content.get("sensors"))
    return Campaign(rig, share, tuple(runs), tuple(faults), sensors)


def write_campaign(
    folder: Path,
    rig: str,
    entries: Sequence[Mapping[str, Any]],
    noise: Mapping[str, Any] | None = None,
    sensors: Mapping[str, Any] | None = None,
) -> None:
    """Write ``campaign.yaml`` into a folder; raises OSError.

    Args:
        folder: existing folder of the campaign.
        rig: name of the rig.
        entries: for each run a mapping with ``path``, ``role`` and the names in ``POINT``.
        noise, sensors: values of these keys; None to leave the key out.
    """
    content = {"rig": rig, "noise": noise, "sensors": sensors, "runs": list(entries)}
    content = {name: value for name, value in content.items() if value is not None}
    text = yaml.safe_dump(content, sort_keys=False, default_flow_style=None)
    (folder / "campaign.yaml").write_text(text, encoding="utf-8")


def _runs(folder: Path, entries: Sequence[Any]) -> tuple[list[CampaignRun], list[tuple[str, str]]]:
    """Return the valid runs, and (name, reason) of each invalid or repeated entry."""
    runs: list[CampaignRun] = []
    faults = []
    for i, entry in enumerate(entries):
        name = _entry_name(entry, i)
        try:
            run = _run(folder, entry)
        except (TypeError, ValueError) as error:
            faults.append(
                (name, f"campaign.yaml must give it {FIELDS}, got {shown(entry)}: {error}")
            )
            continue
        if any(run.path == other.path for other in runs):
            faults.append((name, "campaign.yaml lists it twice: the second entry is not used"))
        elif any(run.path.name == other.path.name for other in runs):
            reason = f"another run has the folder name {run.path.name}: give it a name of its own"
            faults.append((name, reason))
        else:
            runs.append(run)
    return runs, faults


def _entry_name(entry: Any, i: int) -> str:
    """Return the name of entry i for messages: its path, or its number without a valid path."""
    path = entry.get("path") if isinstance(entry, dict) else None
    try:
        return f"entry {i}" if path in (None, "") else _name(path)
    except ValueError:
        return f"entry {i}"


def _name(value: object) -> str:
    """Return a value as the name of a rig or of a run folder; ValueError if it is invalid."""
    odd = value is None or isinstance(value, (bool, list, dict))
    if odd or len(str(value)) > MOST_OF_A_NAME or not str(value).isprintable():
        raise ValueError(
            f"a name must be a text of {MOST_OF_A_NAME} characters that can be printed, got "
            f"{shown(value)}"
        )
    return str(value)


def _run(folder: Path, entry: Mapping[str, Any]) -> CampaignRun:
    """Parse one entry; TypeError or ValueError if it is invalid."""
    if not isinstance(entry, Mapping):
        raise TypeError("an entry is a mapping of names to values")
    lacking = [name for name in ("path", "role", *POINT) if name not in entry]
    if lacking:
        hint = " (K is 0 without control)" if "K" in lacking else ""
        raise ValueError(f"{', '.join(lacking)} is missing{hint}")
    if entry["role"] not in ROLES:
        raise ValueError(f"role {shown(entry['role'])} is none of {', '.join(ROLES)}")
    point = {name: float(entry[name]) for name in POINT}
    if not all(map(isfinite, point.values())):
        raise ValueError("an operating point must be finite")
    return CampaignRun(folder / _path_inside(entry["path"]), point, entry["role"])


def _path_inside(value: object) -> Path:
    """Return the path of a run in the folder of a campaign; ValueError if it leads elsewhere."""
    path = Path(_name(value))
    if path.is_absolute() or ".." in path.parts or not path.parts:
        raise ValueError(
            "path must lead to a folder inside that of campaign.yaml, got "
            f"{shown(value)}: move the run there"
        )
    return path


def sensor_values(place: str, given: Any) -> dict[str, dict[str, float]]:
    """Return the values of each sensor as floats, none if missing.

    Args:
        place: where they are written, for the message.
        given: value of the key ``sensors``.

    Raises:
        RecordingError: they are not numbers, or an rms is not above 0.
    """
    given = given or {}
    try:
        by_channel = {
            str(name): {str(key): float(value) for key, value in values.items()}
            for name, values in given.items()
        }
        for name, values in by_channel.items():
            if not values.get("rms", 1.0) > 0.0:
                raise ValueError(f"the rms of {name} must be above 0")
        return by_channel
    except (AttributeError, TypeError, ValueError) as error:
        raise RecordingError(
            f"sensors of {place} must be channels with numbers, as {{F_rp1_L: {{gain_tolerance: "
            f"0.05}}}}, got {shown(given)} ({error}): mend it"
        ) from None


def noise_share(place: str, noise: Any) -> float | None:
    """Return ``rms_share`` of the key ``noise``, None if missing.

    Args:
        place: where it is written, for the message.
        noise: value of the key.

    Raises:
        RecordingError: noise is no mapping, or the share is not between 0 and 1.
    """
    noise = noise or {}
    if not isinstance(noise, dict):
        raise RecordingError(
            f"noise of {place} must be a mapping, got {shown(noise)}: write {{rms_share: 0.01}}"
        )
    share = noise.get("rms_share")
    if share is None:
        return None
    if isinstance(share, bool) or not isinstance(share, int | float) or not 0.0 < share < 1.0:
        raise RecordingError(
            f"noise.rms_share of {place} must be a share of the RMS between 0 and 1, 0.01 for "
            f"40 dB, got {shown(share)}: mend it, or leave noise out where it is unknown"
        )
    return float(share)
