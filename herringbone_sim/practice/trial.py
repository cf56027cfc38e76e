"""One case of the bench: its plan, its label, and the reports of diagnosis and baselines.

``label_of_seed`` and ``diagnose_case`` run in worker processes and return texts; they write no
files.
"""

from __future__ import annotations

import functools
import hashlib
import json
import time
import traceback
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from herringbone_sim.core import cache
from herringbone_sim.core.parameters import ParameterWarning
from herringbone_sim.diagnosis.judge import relative_error
from herringbone_sim.errors import DivergenceError, ParameterError, RecordingError
from herringbone_sim.gap.diagnose import diagnose
from herringbone_sim.practice.arrays import as_prepared
from herringbone_sim.practice.baselines import always_none, largest_residual, report_of, rivals
from herringbone_sim.practice.campaign import (
    PracticeCampaign,
    make_campaign,
    run_plan,
    solved_as,
)
from herringbone_sim.practice.label import label_text, seal
from herringbone_sim.practice.noise import NOISES
from herringbone_sim.practice.outcome import RELATIVE_ERROR
from herringbone_sim.practice.plan import Plan, RequestedNoise, check_names, draw_plan
from herringbone_sim.practice.record import SAMPLES_PER_CYCLE

FAILED = "failed"
LEAST_SAMPLES = 4  # fewest samples of a mesh cycle


@dataclass(frozen=True)
class Setting:
    """Values that campaigns are drawn from; each seed draws one value of each tuple.

    Attributes:
        snr_dB, noise: level and kind of the noise, see ``plan.RequestedNoise``.
        channels, d, regime, truth, law: as in ``plan.draw_plan``.
        samples_per_cycle: as in ``plan.Plan``.

    Raises:
        ParameterError: an empty tuple, or a value out of range.
    """

    snr_dB: tuple[float, ...] = (40.0,)
    channels: tuple[str, ...] = ("full",)
    d: tuple[float, ...] = (3.0, 10.0)
    regime: tuple[str, ...] = ("varied",)
    truth: str | None = None
    noise: tuple[str, ...] = ("white",)
    law: str = "both"
    samples_per_cycle: tuple[int, ...] = (SAMPLES_PER_CYCLE,)

    def __post_init__(self) -> None:
        lists = (self.snr_dB, self.channels, self.d, self.regime, self.noise)
        if not all(lists) or min(self.d) <= 0.0:
            raise ParameterError(
                f"snr, channels, d, regime and noise need one value or more, d above 0, got {self}"
            )
        if not self.samples_per_cycle or min(self.samples_per_cycle) < LEAST_SAMPLES:
            raise ParameterError(
                f"samples of a mesh cycle must be {LEAST_SAMPLES} or more, the fewest of real "
                f"recordings, got {self.samples_per_cycle}"
            )
        for noise in self.noise:
            if noise not in NOISES:
                raise ParameterError(f"noise must be one of {', '.join(NOISES)}, got {noise!r}")
        for channels, regime in product(self.channels, self.regime):
            check_names(self.truth, channels, regime, self.law)


def plan_of(setting: Setting, seed: int) -> Plan:
    """Draw the plan of a seed; ParameterError for an unknown value."""
    rng = np.random.default_rng([seed, 0xBE])
    # The order of the draws decides what a seed means.
    d, snr_dB = float(rng.choice(setting.d)), float(rng.choice(setting.snr_dB))
    channels, regime = str(rng.choice(setting.channels)), str(rng.choice(setting.regime))
    noise = RequestedNoise(str(rng.choice(setting.noise)), snr_dB)
    samples = int(rng.choice(setting.samples_per_cycle))
    plan = draw_plan(seed, setting.truth, d, noise, channels, regime, setting.law)
    return replace(plan, samples_per_cycle=samples)


def label_of_seed(seed: int, setting: Setting) -> tuple[str | None, str]:
    """Return the text of the label of a seed and ``""``, or None and why its rig diverges."""
    try:
        return label_text(make_campaign(plan_of(setting, seed)).label), ""
    except DivergenceError as error:
        return None, str(error)


def remade(seed: int, setting: Setting, label: Mapping[str, Any], sealed: str) -> PracticeCampaign:
    """Make the campaign of a sealed label again, without solving for sizes.

    Raises:
        RecordingError: its seal differs: the generator changed, or the machine.
    """
    plan = plan_of(setting, seed)
    made = run_plan(plan, solved_as(plan, label))
    if seal(made.label) != sealed:
        raise RecordingError(
            f"the campaign of seed {seed} must come out as it was sealed, got another: the "
            "generator or the machine is not the one of then; start in another folder"
        )
    return made


def diagnose_case(
    seed: int, setting: Setting, label: Mapping[str, Any], sealed: str
) -> dict[str, str]:
    """Diagnose a campaign, and return the texts of its files by name, ``report.json`` last.

    The label is used to make the campaign; the diagnosis gets the recordings only. If it fails,
    the report says ``failed`` with certainty, which counts as wrong, and there is no evidence.
    """
    practice_campaign = remade(seed, setting, label, sealed)
    plain = {
        "always none": always_none(practice_campaign.campaign),
        "largest residual": largest_residual(practice_campaign.campaign, practice_campaign.series),
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ParameterWarning)
        campaign = as_prepared(practice_campaign)
        del practice_campaign
        start = time.monotonic()
        case: dict[str, Any] = {"sources": sources(), RELATIVE_ERROR: relative_error()}
        try:
            diagnosis = diagnose(campaign, senses=False)
            case["seconds"] = time.monotonic() - start
        except Exception as error:  # in a bench failure is data
            case["failure"] = "".join(traceback.format_exception(error))
            failure = {"failure": f"{type(error).__name__}: {error}"}
            found = {"report.json": report_of(campaign.rig, (FAILED,)) | failure}
        else:
            plain |= rivals(campaign.rig, diagnosis.evidence)
            evidence = {} if diagnosis.evidence is None else diagnosis.evidence.written()
            found = {"evidence.json": evidence, "report.json": diagnosis.report.to_dict()}
    files = {"baselines.json": plain, "case.json": case, **found}
    return {name: json.dumps(content) + "\n" for name, content in files.items()}


@functools.cache
def sources() -> str:
    """Return a digest of the code and weights of the package on which a verdict depends.

    Computed once per process, as loaded modules do not change with their files.
    """
    package = Path(__file__).parents[1]
    files = sorted(
        file
        for room in ("diagnosis", "gap", "recording")
        for end in ("py", "json", "yaml")
        for file in (package / room).rglob(f"*.{end}")
    )
    files.append(package / "arrays.py")
    parts = [cache.digest(package / "core", package / "effects").encode()]
    parts += [hashlib.sha256(file.read_bytes()).digest() for file in files]
    return hashlib.sha256(b"".join(parts)).hexdigest()[:16]
