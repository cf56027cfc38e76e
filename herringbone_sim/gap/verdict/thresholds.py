"""Thresholds of the verdict, frozen on practice campaigns whose seeds are named with them."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

FILE = Path(__file__).with_name("calibration.json")


@dataclass(frozen=True)
class Thresholds:
    """Where probabilities turn, and how sharply.

    Attributes:
        share: of chi2 explained above which there is an effect.
        excess_consistency, excess_force_law, excess_torque_balance, excess_motion: excess of chi2
            above which something is there, named or not; the last without force sensors.
        misfit: of the excess of the law, added to that of the balance.
        settled: of the excess that the best law takes off the balance, likewise.
        pinned: of the part of that which a free pin takes off, besides: another pin than the
            catalogue's leaves some; as much must an effect on the bodies explain beside it.
        between: of what the sensors' disagreement has beyond geometry, added to the excess of the
            motion: where v is not followed between samples, accelerations are not either.
        noise: added to all those where nobody tells the noise: it is known to that.
        peak: residual of the balance over its floor above which something is there.
        floor, floor_consistency: excess below which two hypotheses can't be told apart; all
            channels share the second, so an error of one is small there.
        left, left_exact: part of the excess left at which known and unknown are equally likely,
            of effects with a shape of their own and of those without.
        by_time: part of the excess, and by_load: part of what is left, that the best effect wins
            where it may vary with them, at which known and unknown are equally likely; an effect
            with a shape of its own may come with the load in another way.
        second, second_share: of the excess left, and of all chi2, that a second effect must take
            away: less may be the shape of the first one.
        sharp_gap, sharp_unknown, sharp_load, sharp_effect: powers of the odds.
        stage: odds of each later stage against the one before.
        unsure_exact, unsure_shape: share of an effect's size by which its law may be off.
        same, alike: |cos| of the changes of two hypotheses that are one class, and the ratio of
            excess within which its members are not told apart.
    """

    share: float
    excess_consistency: float
    excess_force_law: float
    excess_torque_balance: float
    excess_motion: float
    misfit: float
    settled: float
    pinned: float
    between: float
    noise: float
    peak: float
    floor: float
    floor_consistency: float
    left: float
    left_exact: float
    by_time: float
    by_load: float
    second: float
    second_share: float
    sharp_gap: float
    sharp_unknown: float
    sharp_load: float
    sharp_effect: float
    stage: float
    unsure_exact: float
    unsure_shape: float
    same: float
    alike: float


@cache
def frozen_thresholds() -> Thresholds:
    """Those of the package."""
    return Thresholds(**json.loads(FILE.read_text(encoding="utf-8"))["thresholds"])
