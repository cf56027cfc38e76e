"""Fault campaigns: what is done to recordings, files, disks and the node, seed by seed."""

from __future__ import annotations

from pathlib import Path

from benchmarks.faults.disk import disk
from benchmarks.faults.mcap_files import mcap
from benchmarks.faults.parts import sweep_parts
from benchmarks.faults.recording_kill import recording_kill
from benchmarks.faults.recovery import recover_kill
from benchmarks.faults.trial import Campaign, Trial
from benchmarks.faults.vanish import vanish
from benchmarks.faults.yaml_files import yaml_files


def _messages(seed: int, folder: Path) -> Trial:
    """Malformed messages; ROS is loaded where this campaign runs, and nowhere else."""
    from benchmarks.faults.at_node import messages

    return messages(seed, folder)


# name -> one trial of a seed; small seeded versions of these are the tests in test/faults/.
CAMPAIGNS: dict[str, Campaign] = {
    "mcap": mcap,
    "yaml": yaml_files,
    "messages": _messages,
    "recover kill": recover_kill,
    "recording kill": recording_kill,
    "disk": disk,
    "vanish": vanish,
    "sweep parts": sweep_parts,
}
