"""Write a practice campaign to disk as bags, its label apart."""

from __future__ import annotations

from pathlib import Path

from herringbone_sim.core.layout import unit_of
from herringbone_sim.errors import RecordingError
from herringbone_sim.practice.campaign import PracticeCampaign
from herringbone_sim.practice.label import label_text, seal
from herringbone_sim.practice.record import SAMPLES_PER_CYCLE
from herringbone_sim.recording import campaign
from herringbone_sim.recording.writer import RunWriter

PREFIX = "/rig"
START_NS = 1_700_000_000_000_000_000


def write_campaign(folder: Path, labels: Path, made: PracticeCampaign) -> str:
    """Write runs and ``campaign.yaml`` into a folder, the label to ``labels/FOLDER.json``.

    Returns:
        The seal of the label.

    Raises:
        RecordingError: the folder of labels lies inside the campaign, a run exists, or the disk
            fails.
    """
    if labels.absolute().is_relative_to(folder.absolute()):
        raise RecordingError(
            f"labels must lie apart from the campaign {folder}, got {labels}: name another folder"
        )
    for run, series in zip(made.campaign.runs, made.series, strict=True):
        units = [{"name": name, "unit": unit_of(name)} for name in series.names]
        content = {
            "channels": units,
            "source": "rig",
            "samples_per_mesh_cycle": SAMPLES_PER_CYCLE,
        }
        writer = RunWriter.create(folder, run.path.name, PREFIX, content, series.names, START_NS)
        writer.write_samples(series.data)
        writer.close()
    entries = [{"path": r.path.name, **r.point, "role": r.role} for r in made.campaign.runs]
    share = made.campaign.noise_share
    noise = None if share is None else {"kind": "white", "rms_share": share}
    sensors = {name: dict(told) for name, told in made.sensors.items()} or None
    campaign.write_campaign(folder, made.campaign.rig, entries, noise, sensors)
    labels.mkdir(parents=True, exist_ok=True)
    (labels / f"{folder.name}.json").write_text(label_text(made.label), encoding="utf-8")
    return seal(made.label)
