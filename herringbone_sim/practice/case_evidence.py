"""Evidence and truth of practice campaigns, stored to fit the weights of the judge again.

Each campaign is one line of JSON: seed, truth, stratum, evidence, sizes.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from herringbone_sim.diagnosis.evidence import Evidence
from herringbone_sim.errors import AnalysisError
from herringbone_sim.practice.stored import stored_evidence
from herringbone_sim.practice.true_effects import size_errors


@dataclass(frozen=True)
class CaseEvidence:
    """Evidence and truth of a practice campaign.

    Attributes:
        seed: of the campaign.
        truth: effects; empty for none, ``("unknown",)`` for a cause outside the catalogue.
        stratum: kind of noise, law, channel set and requested detectability d.
        evidence: numbers that the judge uses.
        sizes: (error, standard deviation, true size of the effect) of each parameter, see
            ``outcome.size_errors``.
    """

    seed: int
    truth: tuple[str, ...]
    stratum: tuple[str, str, str, float]
    evidence: Evidence
    sizes: tuple[tuple[float, float, float], ...] = ()

    def written(self) -> dict[str, Any]:
        """Return the content of the campaign's line of JSON."""
        return {
            "seed": self.seed,
            "truth": list(self.truth),
            "stratum": list(self.stratum),
            "evidence": self.evidence.written(),
            "sizes": [list(row) for row in self.sizes],
        }


def bench_evidence(folder: Path) -> list[CaseEvidence]:
    """Return the evidence of the finished campaigns of a bench; raises as ``stored_evidence``."""
    return [
        case_evidence(label, report, evidence, relative_error)
        for label, report, evidence, relative_error in stored_evidence(folder)
    ]


def case_evidence(
    label: Mapping[str, Any],
    report: Mapping[str, Any],
    evidence: Evidence,
    relative_error: float,
) -> CaseEvidence:
    """Combine the label, report and evidence of a campaign.

    Args:
        relative_error: model error that the report's intervals include, see
            ``outcome.size_errors``.
    """
    truth = tuple(sorted(label["truth"]))
    noise = label.get("noise", {})
    kind = noise.get("kind", "white") if isinstance(noise, dict) else str(noise)
    stratum = (
        kind,
        str(label.get("law")),
        str(label["channels"]),
        float(label["d_requested"]),
    )
    truth = () if truth == ("none",) else truth
    sizes = tuple(size_errors(label, report, relative_error))
    return CaseEvidence(int(label["seed"]), truth, stratum, evidence, sizes)


def write_evidence(path: Path, campaigns: Iterable[CaseEvidence]) -> None:
    """Write campaigns to a file, one line of JSON each."""
    lines = [json.dumps(c.written(), separators=(",", ":")) for c in campaigns]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def read_evidence(path: Path) -> list[CaseEvidence]:
    """Read the file of ``write_evidence``; AnalysisError for an invalid line."""
    cases = []
    for i, line in enumerate(path.read_text(encoding="utf-8").splitlines()):
        try:
            data = json.loads(line)
            noise, law, channels, d = data["stratum"]
            cases.append(
                CaseEvidence(
                    int(data["seed"]),
                    tuple(data["truth"]),
                    (noise, law, channels, float(d)),
                    Evidence.read(data["evidence"]),
                    tuple((float(e), float(sd), float(size)) for e, sd, size in data["sizes"]),
                )
            )
        except (KeyError, TypeError, ValueError) as error:
            raise AnalysisError(
                f"line {i + 1} of {path} must be the evidence of a campaign, got {error}: write "
                "the file again with `gap calibrate`"
            ) from None
    return cases
