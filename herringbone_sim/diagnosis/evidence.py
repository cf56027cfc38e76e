"""What the examination of a campaign found, in numbers: all that a verdict hangs on.

Small enough to be kept for every practice campaign, so that anyone can compute verdicts and their
calibration again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from herringbone_sim.diagnosis.examine import Examined, Found


@dataclass(frozen=True)
class Candidate:
    """An explanation: no effect, one or two.

    Attributes:
        effects: ids; empty for none.
        places: of each effect, as text.
        energy: whitened squares left of runs predicted by the others.
        in_sample: those left with all runs.
        size: number of coefficients.
        strain: how far curves depart from the catalogue's beside the size of the effect: 1 where
            they do as their prior expects; 0 of effects without a shape.
        worst: largest mean square that is left of an observation, over its noise.
    """

    effects: tuple[str, ...]
    places: tuple[str, ...]
    energy: float
    in_sample: float
    size: int
    strain: float
    worst: float


@dataclass(frozen=True)
class Evidence:
    """Numbers of a campaign.

    Attributes:
        count: whitened values.
        candidates: none, single effects, pairs; each kind best first.
        remains: of none, the best single and the best pair: whitened squares that a flexible
            regression predicts of what they leave, out of sample.
        screened: least squares of each effect by the linear screen.
        told: whether the noise was told, so that what is left above it counts in full.
        uneven: largest noise that was found of a row, over the median of its observation's rows.
    """

    count: float
    candidates: tuple[Candidate, ...]
    remains: Mapping[str, float]
    screened: Mapping[str, float]
    told: bool = True
    uneven: float = 1.0

    def written(self) -> dict[str, Any]:
        """As plain data."""
        return asdict(self)

    @classmethod
    def read(cls, data: Mapping[str, Any]) -> Evidence:
        """From plain data."""
        candidates = tuple(
            Candidate(**{**c, "effects": tuple(c["effects"]), "places": tuple(c["places"])})
            for c in data["candidates"]
        )
        remains, screened = dict(data["remains"]), dict(data["screened"])
        told, uneven = bool(data["told"]), float(data["uneven"])
        return cls(float(data["count"]), candidates, remains, screened, told, uneven)


def evidence_of(found: Examined, told: bool = True) -> Evidence:
    """The numbers of an examination; ``told``: whether the noise was."""
    every = (found.none, *found.singles, *found.pairs)
    remains = {name: sum(p.predicted for p in of.values()) for name, of in found.flexible.items()}
    candidates = tuple(_candidate(f, found.counts) for f in every)
    rows = [np.mean(n**2, axis=0) for n in found.noise.values()]
    uneven = max((float(n.max() / np.median(n)) for n in rows), default=1.0)
    return Evidence(found.count, candidates, remains, dict(found.screened), told, uneven)


def _candidate(found: Found, counts: Mapping[str, float]) -> Candidate:
    score = found.score
    return Candidate(
        tuple(h.effect for h in found.hypotheses),
        tuple(str(h.locus) for h in found.hypotheses),
        found.energy,
        score.in_sample,
        sum(len(h.coefficients) for h in found.hypotheses),
        _strain(found),
        max(float(rows.sum()) / counts[o] for o, rows in score.rows.items() if counts[o] > 0.0),
    )


def _strain(found: Found) -> float:
    """Largest ratio of departures to the effect's own parameters, each over its prior."""
    every = [h.coefficients for h in found.hypotheses]
    first = len(found.score.coefficients) - sum(len(c) for c in every)
    strains = [0.0]
    for h, own in zip(found.hypotheses, every, strict=True):
        mean = found.score.mean[first : first + len(own)]
        first += len(own)
        squares = (mean / np.array([c.sd for c in own])) ** 2
        if len(own) > h.mains:
            strains.append(
                float(squares[h.mains :].mean() / max(squares[: h.mains].mean(), 1e-12))
            )
    return max(strains)
