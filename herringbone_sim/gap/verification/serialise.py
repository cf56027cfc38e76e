"""Gaps and mesh forces as plain data for the report."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from herringbone_sim.gap.observations.reconstructed_forces import ReconstructedForces
from herringbone_sim.gap.verification.attractor import UNITS as DISTANCE_UNITS
from herringbone_sim.gap.verification.residual_gap import Gap
from herringbone_sim.gap.verification.senses import Senses

ROLE = "held_out"
NUMBERS = ("nominal", "augmented", "noise_floor", "closure")


def gap_to_dict(gap: Gap, role: str | None = ROLE) -> dict[str, Any]:
    """Return the gap over runs of a role (None: all), and of each run, by the report's keys."""
    return {
        **asdict(gap.numbers(role)),
        "runs": [
            {
                "path": run.name,
                "role": run.role,
                "nominal": run.nominal,
                "augmented": run.augmented,
                "noise_floor": run.floor,
                "runner_up": run.runner_up,
                "recalibrated": run.recalibrated,
            }
            for run in gap.runs
        ],
    }


def senses_to_dict(senses: Senses, role: str | None = ROLE) -> dict[str, Any]:
    """Return the gap in each sense as ``gap_to_dict``; predictions with horizon and exponent."""
    data = {name: gap_to_dict(gap, role) for name, gap in senses.gaps.items()}
    for run in data["prediction"]["runs"]:
        value, sigma = senses.exponents.get(run["path"], (float("nan"),) * 2)
        run["horizon_cycles"] = senses.horizon_cycles.get(run["path"], float("nan"))
        run["exponent"] = {"value": value, "sigma": sigma, "unit": "1/mesh cycle"}
    return data


def attractor_to_dict(senses: Senses | None) -> dict[str, Any]:
    """Return statistics of the long motions of rig and models, as plain data for the report.

    Returns:
        By name, then by run: ``measured`` (the rig), ``nominal``, ``augmented`` and, if there is
        one, ``runner_up`` have contact and load sharing of every mesh; models also have the
        distance of their motion from the rig's, and ``floor`` has the distance between the two
        halves of the recording. ``measured`` and ``augmented`` have the largest Lyapunov exponent.
        ``units`` holds those of distances and exponents. Without senses, only empty ``nominal``
        and ``augmented``.
    """
    if senses is None:
        return {"nominal": {}, "augmented": {}}
    return {
        **{"nominal": {}, "augmented": {}},
        **{name: dict(runs) for name, runs in senses.numbers.items()},
        "units": {**DISTANCE_UNITS, "exponent": "1/mesh cycle"},
    }


def forces_to_dict(forces: ReconstructedForces | None) -> dict[str, Any]:
    """Return RMS, 90 % half-width and contact of the reconstructed force of each mesh, or {}."""
    if forces is None:
        return {}
    size = np.sqrt(np.mean(forces.force**2, axis=0))
    values = (size, np.median(forces.half, axis=0), np.mean(forces.contact, axis=0))
    keys = ("rms", "half_width_90", "contact")
    return {
        "run": forces.run,
        "role": forces.role,
        "effects": list(forces.effects),
        "planets_alike": forces.planets_alike,
        "unit": "N",
        "meshes": {
            name: dict(zip(keys, map(float, row), strict=True))
            for name, *row in zip(forces.meshes, *values, strict=True)
        },
    }
