"""Labels: the truth of each campaign, sealed by a hash and stored apart from the recordings."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from herringbone_sim.arrays import rms
from herringbone_sim.errors import RecordingError
from herringbone_sim.practice.cause import Cause
from herringbone_sim.practice.measure import RunMeasure
from herringbone_sim.practice.plan import KINDS, Plan
from herringbone_sim.practice.record import (
    CYCLES,
    Motion,
    contact,
    period,
)
from herringbone_sim.practice.rig_model import Constants
from herringbone_sim.recording.campaign import CampaignRun
from herringbone_sim.recording.safe_json import JsonError, json_text, parse_json

SCHEMA = "rig/label/1"
SHORT = 0.8  # fraction of the requested detectability below which a cause counts as capped


def label_of(
    plan: Plan,
    solved: Sequence[tuple[Cause, float]],
    runs: Sequence[CampaignRun],
    rig: Constants,
    motions: Sequence[Motion],
    measures: Sequence[RunMeasure],
) -> dict[str, Any]:
    """Return the label of a campaign as plain JSON: causes, settings, and measures of each run.

    Args:
        solved: causes with their detectability.
        rig: constants of the rig within its tolerances.
        motions, measures: of each run.
    """
    entries = [
        _run(plan, run, rig, motion, measure)
        for run, motion, measure in zip(runs, motions, measures, strict=True)
    ]
    aperiodic = float(np.mean([entry["period"] == 0 for entry in entries]))
    return {
        "schema": SCHEMA,
        "seed": plan.seed,
        "truth": sorted({cause.effect for cause, _ in solved}) or ["none"],
        "effects": [_effect(plan, cause, d) for cause, d in solved],
        "d_requested": plan.d,
        "snr_dB": plan.snr_dB,
        "noise": {"kind": plan.noise.kind, "told": plan.noise.share_given, **plan.noise.parts},
        "law": law_of([cause for cause, _ in solved]),
        "channels": plan.channels,
        "regime": "quiet" if plan.regime == "quiet" else _regime(aperiodic),
        "samples_per_cycle": plan.samples_per_cycle,
        "cycles": CYCLES,
        "tolerance": plan.factors,
        "operating_points": [
            {"path": run.path.name, **run.point, "role": run.role} for run in runs
        ],
        "runs": entries,
    }


def law_of(causes: Sequence[Cause]) -> str:
    """Return the law of the causes as a label states it.

    It is ``none`` without causes, ``outside`` if a cause is unknown, ``other`` if a cause has a
    drawn curve, else ``catalogue``.
    """
    if not causes or any(cause.effect == "unknown" for cause in causes):
        return "outside" if causes else "none"
    laws = {cause.shape.get("law", "catalogue") for cause in causes}
    return "other" if "other" in laws else "catalogue"


def _regime(aperiodic: float) -> str:
    """Return the regime of a campaign from its fraction of aperiodic runs."""
    return "mostly aperiodic" if aperiodic > 0.5 else "mostly periodic"


def _effect(plan: Plan, cause: Cause, d: float) -> dict[str, Any]:
    """Return the label entry of a cause with detectability ``d``."""
    parameters = KINDS[cause.internal].parameters(cause)
    return {
        "effect": cause.effect,
        "internal": cause.internal,
        "locus": dict(cause.locus),
        "d": d,
        "capped": d < SHORT * plan.d,
        "size": cause.size,
        "parameters": {
            name: {"value": _plain(value), "unit": unit}
            for name, (value, unit) in parameters.items()
        },
        "law": law_of([cause]),
        "shape": {name: _plain(value) for name, value in cause.shape.items()},
    }


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value


def _run(
    plan: Plan, run: CampaignRun, rig: Constants, motion: Motion, measure: RunMeasure
) -> dict[str, Any]:
    """Return the label entry of a run."""
    return {
        "path": run.path.name,
        "role": run.role,
        "residual_N": {
            "nominal": measure.nominal,
            "nominal_clean": measure.nominal_clean,
            "own_constants": measure.own,
            "own_constants_clean": measure.own_clean,
            "noise_floor": measure.floor,
        },
        "rms_F": rms(motion.force),
        "mean_F": float(motion.force.mean()),
        "period": period(motion, plan.samples_per_cycle),
        "contact": contact(rig, run.point, motion),
        "law_d": list(measure.d),
    }


def label_text(label: dict[str, Any]) -> str:
    """Return the text of the label file."""
    return json.dumps(label, indent=1, allow_nan=False) + "\n"


def seal(label: dict[str, Any]) -> str:
    """Return the SHA-256 of the label file; published before a diagnosis to prove it unchanged."""
    return hashlib.sha256(label_text(label).encode()).hexdigest()


def read_label(path: Path, expected: str | None = None) -> dict[str, Any]:
    """Read a label file and compare its SHA-256 with the expected seal, if one is given.

    Raises:
        RecordingError: no readable label, or not the sealed one.
    """
    try:
        text = json_text(path)
        label = parse_json(text)
    except (OSError, JsonError) as error:
        raise RecordingError(f"can't read the label {path}: {error}: name a label file") from None
    got = hashlib.sha256(text.encode()).hexdigest()
    if expected is not None and got != expected:
        raise RecordingError(
            f"the label {path} must have the seal {expected}, got {got}: it was changed after "
            "it was sealed; make the campaign again from its seed"
        )
    return label
