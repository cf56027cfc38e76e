"""What the examination of a campaign found, in numbers: all that a verdict hangs on.

Small enough to be kept for every practice campaign, so that anyone can compute verdicts and their
calibration again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from herringbone_sim.diagnosis.examine import Examined, Found


@dataclass(frozen=True)
class Candidate:
    """An explanation: no effect, one or two.

    Attributes:
        effects: ids; empty for none.
        places: of each effect, as text.
        energy: whitened squares left of runs predicted by the others.
    """

    effects: tuple[str, ...]
    places: tuple[str, ...]
    energy: float


@dataclass(frozen=True)
class Evidence:
    """Numbers of a campaign.

    Attributes:
        count: whitened values.
        candidates: none, single effects, pairs; each kind best first.
        remains: of none, the best single and the best pair: whitened squares that a flexible
            regression predicts of what they leave, out of sample.
        screened: least squares of each effect by the linear screen.
    """

    count: float
    candidates: tuple[Candidate, ...]
    remains: Mapping[str, float]
    screened: Mapping[str, float]

    def written(self) -> dict[str, Any]:
        """As plain data."""
        return asdict(self)

    @classmethod
    def read(cls, data: Mapping[str, Any]) -> Evidence:
        """From plain data."""
        candidates = tuple(
            Candidate(tuple(c["effects"]), tuple(c["places"]), float(c["energy"]))
            for c in data["candidates"]
        )
        return cls(float(data["count"]), candidates, dict(data["remains"]), dict(data["screened"]))


def evidence_of(found: Examined) -> Evidence:
    """The numbers of an examination."""
    every = (found.none, *found.singles, *found.pairs)
    remains = {
        name: sum(
            max(0.0, float((p.energy - p.left)[p.count > 0.0].sum()))
            * found.counts[o]
            / max(float(p.count.sum()), 1.0)
            for o, p in of.items()
        )
        for name, of in found.flexible.items()
    }
    candidates = tuple(_candidate(f) for f in every)
    return Evidence(found.count, candidates, remains, dict(found.screened))


def _candidate(found: Found) -> Candidate:
    return Candidate(
        tuple(h.effect for h in found.hypotheses),
        tuple(str(h.locus) for h in found.hypotheses),
        found.energy,
    )
