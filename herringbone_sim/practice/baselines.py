"""Simple baselines that report in the schema of the diagnosis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.practice.measure import rms
from herringbone_sim.practice.record import law_force
from herringbone_sim.practice.rig_model import MESHES, NOMINAL
from herringbone_sim.recording.campaign import Campaign

SCHEMA = "herringbone_sim/gap-report/1"
NOTABLE = 1.3  # residual over the median of its kind from which a single mesh is blamed
LOUD = 6.0  # relative residual over the noise share from which a mesh kind is blamed


def always_none(campaign: Campaign) -> dict[str, Any]:
    """Report with the verdict ``none``."""
    return _report(campaign, "none", [("none", None)])


def largest_residual(campaign: Campaign, series: Sequence[TimeSeries]) -> dict[str, Any]:
    """Baseline diagnosis: blame mean stiffness of the mesh whose force residual is largest.

    Compares RMS residual / RMS force of each mesh, median over the fit runs: one mesh is blamed
    from ``NOTABLE`` times the median of its kind (sun-planet or ring-planet), else all meshes of
    the larger kind from ``LOUD`` times the noise, else none; none also if x, v or F is missing.

    Args:
        series: recorded samples, one per run of the campaign; only runs with role ``fit`` count.

    Returns:
        A gap report (dict of schema ``SCHEMA``).
    """
    fit = [
        _relative_residuals(one, run.point)
        for one, run in zip(series, campaign.runs, strict=True)
        if run.role == "fit" and all(f"{a}_{m}" in one for a in "xvF" for m in MESHES)
    ]
    if not fit:
        return always_none(campaign)
    kinds = np.median(fit, axis=0).reshape(2, 6)
    ratio = kinds / np.median(kinds, axis=1, keepdims=True)
    worst = MESHES[int(ratio.argmax())]
    if ratio.max() >= NOTABLE:
        return _blame(campaign, {"mesh": worst[:2], "planet": worst[2], "side": worst[4]})
    if kinds.max() >= LOUD * (campaign.noise_share or np.inf):
        loudest = MESHES[int(kinds.argmax())][:2]
        return _blame(campaign, {"mesh": loudest, "planet": "all", "side": "all"})
    return always_none(campaign)


def _blame(campaign: Campaign, locus: Mapping[str, str]) -> dict[str, Any]:
    """Report that blames the mean stiffness at a locus."""
    return _report(campaign, "mean_stiffness", [("mean_stiffness", locus)])


def _relative_residuals(series: TimeSeries, point: Mapping[str, float]) -> list[float]:
    """RMS force-law residual over RMS force (12 values) of each mesh, with nominal constants."""
    x, v, force = (series.columns(tuple(f"{a}_{m}" for m in MESHES)) for a in "xvF")
    residual = force - law_force(NOMINAL, point, series["phase"], x, v)
    return [rms(residual[:, j]) / rms(force[:, j]) for j in range(len(MESHES))]


def _report(
    campaign: Campaign, verdict: str, causes: Sequence[tuple[str, Mapping[str, str] | None]]
) -> dict[str, Any]:
    """Gap report with equal certainty on each cause."""
    listed = [
        {"effect": effect, "locus": locus or {}, "probability": 1.0, "parameters": {}}
        for effect, locus in causes
    ]
    return {
        "schema": SCHEMA,
        "campaign": campaign.rig,
        "verdict": verdict,
        "effects": [] if verdict == "none" else [verdict],
        "causes": listed,
        "ambiguous_with": [],
        "gap": {"closure": 0.0},
    }
