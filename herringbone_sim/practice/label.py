"""Labels: what the truth is, sealed by a hash, and kept apart from the campaign."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from herringbone_sim.errors import RecordingError
from herringbone_sim.practice.cause import Cause
from herringbone_sim.practice.machine import Constants
from herringbone_sim.practice.measure import RunMeasure, rms
from herringbone_sim.practice.plan import KINDS, Plan
from herringbone_sim.practice.record import (
    CYCLES,
    SAMPLES_PER_CYCLE,
    Motion,
    contact,
    period,
)
from herringbone_sim.recording.campaign import CampaignRun
from herringbone_sim.recording.safe_json import JsonError, json_text, parse_json

SCHEMA = "rig/label/1"
SHORT = 0.8  # of the detectability that was asked for


def label_of(
    plan: Plan,
    solved: Sequence[tuple[Cause, float]],
    runs: Sequence[CampaignRun],
    rig: Constants,
    motions: Sequence[Motion],
    found: Sequence[RunMeasure],
) -> dict[str, Any]:
    """The label of a campaign, plain JSON."""
    told = [
        _run(run, rig, motion, one) for run, motion, one in zip(runs, motions, found, strict=True)
    ]
    aperiodic = float(np.mean([one["period"] == 0 for one in told]))
    return {
        "schema": SCHEMA,
        "seed": plan.seed,
        "truth": sorted({cause.effect for cause, _ in solved}) or ["none"],
        "effects": [_effect(plan, cause, d) for cause, d in solved],
        "d_requested": plan.d,
        "snr_dB": plan.snr_dB,
        "noise": {"kind": plan.noise.kind, "told": plan.noise.told, **plan.noise.parts},
        "law": law_of([cause for cause, _ in solved]),
        "channels": plan.channels,
        "regime": "quiet" if plan.regime == "quiet" else _regime(aperiodic),
        "samples_per_cycle": SAMPLES_PER_CYCLE,
        "cycles": CYCLES,
        "tolerance": plan.factors,
        "operating_points": [
            {"path": run.path.name, **run.point, "role": run.role} for run in runs
        ],
        "runs": told,
    }


def law_of(causes: Sequence[Cause]) -> str:
    """Whose law the causes have: none, catalogue, other (one of them is enough) or outside."""
    if not causes or any(cause.effect == "unknown" for cause in causes):
        return "outside" if causes else "none"
    laws = {cause.shape.get("law", "catalogue") for cause in causes}
    return "other" if "other" in laws else "catalogue"


def _regime(aperiodic: float) -> str:
    return "mostly aperiodic" if aperiodic > 0.5 else "mostly periodic"


def _effect(plan: Plan, cause: Cause, d: float) -> dict[str, Any]:
    told = KINDS[cause.internal].tell(cause)
    return {
        "effect": cause.effect,
        "internal": cause.internal,
        "locus": dict(cause.locus),
        "d": d,
        "capped": d < SHORT * plan.d,
        "size": cause.size,
        "parameters": {
            name: {"value": _plain(value), "unit": unit} for name, (value, unit) in told.items()
        },
        "law": law_of([cause]),
        "shape": {name: _plain(value) for name, value in cause.shape.items()},
    }


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value


def _run(run: CampaignRun, rig: Constants, motion: Motion, one: RunMeasure) -> dict[str, Any]:
    return {
        "path": run.path.name,
        "role": run.role,
        "residual_N": {
            "nominal": one.nominal,
            "nominal_clean": one.nominal_clean,
            "own_constants": one.own,
            "own_constants_clean": one.own_clean,
            "noise_floor": one.floor,
        },
        "rms_F": rms(motion.force),
        "mean_F": float(motion.force.mean()),
        "period": period(motion),
        "contact": contact(rig, run.point, motion),
        "law_d": list(one.d),
    }


def label_text(label: dict[str, Any]) -> str:
    """The label as it stands in its file."""
    return json.dumps(label, indent=1, allow_nan=False) + "\n"


def seal(label: dict[str, Any]) -> str:
    """SHA-256 of the label's file: published before a diagnosis runs, it can't change after."""
    return hashlib.sha256(label_text(label).encode()).hexdigest()


def read_label(path: Path, expected: str | None = None) -> dict[str, Any]:
    """A label file, held against its seal if one is given.

    Raises:
        RecordingError: no label there, or not the one that was sealed.
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
