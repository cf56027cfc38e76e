"""Summary of an examination in a few numbers, the only input of the judge.

Small enough to be stored for every practice campaign, so that verdicts and the weights of the
judge can be recomputed without a new diagnosis.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from herringbone_sim.diagnosis.examine import Examination
from herringbone_sim.diagnosis.fits import FittedExplanation
from herringbone_sim.diagnosis.flexible import predicted_chi2
from herringbone_sim.diagnosis.machine import with_slices


@dataclass(frozen=True)
class Candidate:
    """Numbers of one fitted explanation of the gap: no effect, one effect, or two.

    Attributes:
        effects: ids; empty for none.
        places: place of each effect, as text.
        chi2: whitened sum of squares left, each run predicted from the others.
        in_sample: whitened sum of squares left with all runs fitted.
        size: number of coefficients of the effects, without tolerances.
        strain: mean square of the departures from the catalogue's curve over that of the effect's
            own coefficients, each over its prior: 1 as expected; 0 without departures. Of two
            effects the larger.
        worst: largest mean square of whitened residuals left in one observation with all runs
            fitted; noise alone: 1.
        log_density: sum of the log predictive densities of the left-out runs; None where
            explanations are compared by chi2, see ``Score.loss``.
    """

    effects: tuple[str, ...]
    places: tuple[str, ...]
    chi2: float
    in_sample: float
    size: int
    strain: float
    worst: float
    log_density: float | None = None

    @property
    def loss(self) -> float:
        """Leave-one-run-out loss, see ``Score.loss``."""
        return self.chi2 if self.log_density is None else -2.0 * self.log_density


@dataclass(frozen=True)
class Evidence:
    """Evidence of one campaign; field names are keys of stored evidence files.

    Attributes:
        count: number of whitened values.
        candidates: none, single effects, pairs; each kind best first.
        remains: chi2 that the flexible regression predicts, out of sample, in the residual of
            ``none``, of the best ``single`` and of the best ``pair``.
        screened: least loss of each effect in the linear screen, by its id.
        told: whether the campaign gives the noise.
        uneven: largest noise variance estimated for a row over the median of the rows of its
            observation; 1 where the noise is known.
    """

    count: float
    candidates: tuple[Candidate, ...]
    remains: Mapping[str, float]
    screened: Mapping[str, float]
    told: bool = True
    uneven: float = 1.0

    @property
    def by_density(self) -> bool:
        """Whether explanations are compared by predictive density instead of chi2."""
        return any(c.log_density is not None for c in self.candidates)

    def written(self) -> dict[str, Any]:
        """The evidence as plain data for JSON."""
        return asdict(self)

    @classmethod
    def read(cls, data: Mapping[str, Any]) -> Evidence:
        """Restore evidence from the plain data of ``written``, also after a passage through JSON.

        KeyError, TypeError or ValueError: a field is missing, or the data have another
        structure. The types of a candidate's numbers are not checked.
        """
        candidates = tuple(
            Candidate(**{**c, "effects": tuple(c["effects"]), "places": tuple(c["places"])})
            for c in data["candidates"]
        )
        remains, screened = dict(data["remains"]), dict(data["screened"])
        noise_known, uneven = bool(data["told"]), float(data["uneven"])
        return cls(float(data["count"]), candidates, remains, screened, noise_known, uneven)


def evidence_of(examination: Examination, noise_known: bool = True) -> Evidence:
    """Summarise an examination as evidence; ``noise_known``: whether the campaign gives noise."""
    explanations = (examination.none, *examination.singles, *examination.pairs)
    remains = {name: predicted_chi2(left) for name, left in examination.flexible.items()}
    candidates = tuple(_candidate(f, examination.counts) for f in explanations)
    rows = [np.mean(n**2, axis=0) for n in examination.noise.values()]
    uneven = max((float(n.max() / np.median(n)) for n in rows), default=1.0)
    return Evidence(
        examination.count, candidates, remains, dict(examination.screened), noise_known, uneven
    )


def _candidate(explanation: FittedExplanation, counts: Mapping[str, float]) -> Candidate:
    """Summarise one explanation; ``counts``: number of whitened values, by observation."""
    score = explanation.score
    return Candidate(
        tuple(h.effect for h in explanation.hypotheses),
        tuple(str(h.locus) for h in explanation.hypotheses),
        float(score.chi2.sum()),
        score.in_sample,
        sum(len(h.coefficients) for h in explanation.hypotheses),
        _strain(explanation),
        max(
            float(rows.sum()) / counts[o]
            for o, rows in score.chi2_by_row.items()
            if counts[o] > 0.0
        ),
        score.log_density if score.by_density else None,
    )


def _strain(explanation: FittedExplanation) -> float:
    """Largest ``Candidate.strain`` over the effects of an explanation."""
    mean = explanation.score.mean
    strains = [0.0]
    for h, own in with_slices(explanation.hypotheses, len(mean)):
        squares = (mean[own] / np.array([c.sd for c in h.coefficients])) ** 2
        if len(squares) > h.n_own:
            strains.append(
                float(squares[h.n_own :].mean() / max(squares[: h.n_own].mean(), 1e-12))
            )
    return max(strains)
