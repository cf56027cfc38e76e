"""Weights of the judge, fitted on practice campaigns, and the evidence that anyone can fit again.

The evidence of a campaign is a line of JSON: seed, truth, stratum, numbers. Weights are those with
the largest penalised likelihood; the penalty is the one that predicts campaigns best that were
left out, in five folds.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from herringbone_sim.diagnosis import judge
from herringbone_sim.diagnosis.evidence import Evidence
from herringbone_sim.errors import AnalysisError
from herringbone_sim.practice.intervals import calibration_error
from herringbone_sim.practice.outcome import size_errors
from herringbone_sim.practice.stored import stored_evidence

Array = NDArray[np.float64]

FOLDS = 5
HELD = 0.9  # of the sizes in their intervals
PENALTIES = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0)


@dataclass(frozen=True)
class Practised:
    """A practice campaign as the judge sees it.

    Attributes:
        seed: of the campaign.
        truth: effects; empty for none, ``("unknown",)`` for a cause outside the catalogue.
        stratum: noise, law, channels and d.
        evidence: numbers.
        sizes: error, standard deviation and true size of each parameter of the right effects.
    """

    seed: int
    truth: tuple[str, ...]
    stratum: tuple[str, str, str, float]
    evidence: Evidence
    sizes: tuple[tuple[float, float, float], ...] = ()

    def written(self) -> dict[str, Any]:
        return {
            "seed": self.seed,
            "truth": list(self.truth),
            "stratum": list(self.stratum),
            "evidence": self.evidence.written(),
            "sizes": [list(one) for one in self.sizes],
        }


def practised(folder: Path) -> list[Practised]:
    """Every finished campaign of a bench; see ``stored.stored_evidence`` for what it raises."""
    return [
        practised_of(label, report, evidence)
        for label, report, evidence in stored_evidence(folder)
    ]


def practised_of(
    label: Mapping[str, Any], report: Mapping[str, Any], evidence: Evidence
) -> Practised:
    """A campaign by its label, its report and its evidence."""
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
    sizes = tuple(size_errors(label, report))
    return Practised(int(label["seed"]), truth, stratum, evidence, sizes)


def write_evidence(path: Path, campaigns: Iterable[Practised]) -> None:
    """A line of JSON each."""
    lines = [json.dumps(c.written(), separators=(",", ":")) for c in campaigns]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def read_evidence(path: Path) -> list[Practised]:
    """What ``write_evidence`` wrote; AnalysisError for a line that is none of it."""
    found = []
    for i, line in enumerate(path.read_text(encoding="utf-8").splitlines()):
        try:
            data = json.loads(line)
            noise, law, channels, d = data["stratum"]
            found.append(
                Practised(
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
    return found


@dataclass(frozen=True)
class Calibrated:
    """Fitted weights, the penalty, and figures of campaigns that were left out of the fit.

    Attributes:
        relative: standard deviation of what models miss of a size, as a share of it.
        covered: share of the true sizes in 90 % intervals of campaigns left out of its fit.
    """

    weights: Array
    penalty: float
    figures: dict[str, dict[str, float]]
    relative: float
    covered: float


def calibrate(campaigns: Sequence[Practised]) -> Calibrated:
    """Weights and penalty of some campaigns.

    Raises:
        AnalysisError: fewer campaigns than folds.
    """
    if len(campaigns) < 2 * FOLDS:
        raise AnalysisError(
            f"calibration needs {2 * FOLDS} campaigns or more, got {len(campaigns)}: run more"
        )
    chances = {p: left_out(campaigns, p) for p in PENALTIES}
    loss = {p: -float(np.mean(np.log(np.maximum(c[:, 0], 1e-6)))) for p, c in chances.items()}
    penalty = min(loss, key=lambda p: loss[p])
    weights = judge.fit([c.evidence for c in campaigns], [c.truth for c in campaigns], penalty)
    sizes = [np.array(c.sizes).reshape(-1, 3) for c in campaigns]
    fold = np.arange(len(campaigns)) % FOLDS
    held = []
    for f in range(FOLDS):
        others, own = (
            np.concatenate([z for z, k in zip(sizes, fold, strict=True) if bool(k == f) == mine])
            for mine in (False, True)
        )
        held.append(_misses(own, missed(others)) <= 1.0)
    covered = float(np.mean(np.concatenate(held))) if any(map(len, held)) else float("nan")
    return Calibrated(
        weights,
        penalty,
        by_stratum(campaigns, chances[penalty]),
        missed(np.concatenate(sizes)),
        covered,
    )


def missed(sizes: Array) -> float:
    """What models miss of a size, as a share of it, so that nine in ten intervals hold it.

    Args:
        sizes: (n, 3) error, standard deviation and size.
    """

    def uncovered(relative: float) -> float:
        return float(np.mean(_misses(sizes, relative) <= 1.0)) - HELD

    if not len(sizes) or uncovered(0.0) >= 0.0:
        return 0.0
    if uncovered(1.0) <= 0.0:
        return 1.0
    return float(brentq(uncovered, 0.0, 1.0, xtol=1e-5))


def _misses(sizes: Array, relative: float) -> Array:
    """Errors over half of the 90 % interval."""
    error, sd, size = sizes.T
    return np.asarray(np.abs(error) / (judge.HALF_90 * np.hypot(sd, relative * size) + 1e-300))


def by_stratum(campaigns: Sequence[Practised], chances: Array) -> dict[str, dict[str, float]]:
    """Headline figures of all campaigns, and by noise, truth and channels."""
    told = np.array([c.evidence.told for c in campaigns])
    healthy = np.array([not c.truth for c in campaigns])
    foreign = np.array([c.truth == ("unknown",) for c in campaigns])
    strata = {
        "all": np.ones(len(campaigns), dtype=bool),
        "noise told": told,
        "noise not told": ~told,
        "healthy": healthy,
        "outside cause": foreign,
        "effects": ~healthy & ~foreign,
    }
    channels = np.array([c.stratum[2] for c in campaigns])
    strata |= {name: channels == name for name in sorted(set(channels.tolist()))}
    return {name: headline(chances[on]) for name, on in strata.items() if on.any()}


def left_out(campaigns: Sequence[Practised], penalty: float) -> Array:
    """(n, 3) probability on the truth, of the first explanation, and whether that is true.

    Each campaign is judged by weights of the other folds.
    """
    fold = np.random.default_rng(0).permutation(len(campaigns)) % FOLDS
    found = np.zeros((len(campaigns), 3))
    for f in range(FOLDS):
        others = [c for c, k in zip(campaigns, fold, strict=True) if k != f]
        weights = judge.fit([c.evidence for c in others], [c.truth for c in others], penalty)
        for i in np.flatnonzero(fold == f).tolist():
            found[i] = judged(campaigns[i], weights)
    return found


def judged(one: Practised, weights: Array) -> tuple[float, float, float]:
    """Probability on the truth, of the first explanation, and whether that is true."""
    told = judge.chances(one.evidence, weights)
    truth = tuple(sorted(one.truth))
    effects = [tuple(sorted(c.effects)) for c in told]
    on_truth = sum(c.probability for c, e in zip(told, effects, strict=True) if e == truth)
    groups: dict[tuple[str, ...], float] = {}
    for c, e in zip(told, effects, strict=True):
        groups[e] = groups.get(e, 0.0) + c.probability
    first = max(groups, key=lambda e: groups[e])
    return on_truth, groups[first], float(first == truth)


def headline(chances: Array) -> dict[str, float]:
    """Probability on the truth, share right first, and the calibration error."""
    return {
        "log loss": -float(np.mean(np.log(np.maximum(chances[:, 0], 1e-6)))),
        "probability on the truth": float(chances[:, 0].mean()),
        "right first": float(chances[:, 2].mean()),
        "calibration error": calibration_error(chances[:, 1:]),
        "campaigns": float(len(chances)),
    }


def write_weights(
    path: Path, found: Calibrated, campaigns: Sequence[Practised], sources: str
) -> None:
    """The file of the judge: weights, where they come from, and what they reach."""
    seeds = sorted({c.seed for c in campaigns})
    content = {
        "weights": dict(zip(judge.NAMES, map(float, found.weights), strict=True)),
        "relative error of a size": found.relative,
        "coverage of 90 % intervals, left out": found.covered,
        "penalty": found.penalty,
        "seeds": [[seeds[0], seeds[-1] + 1]],
        "sources": sources,
        "figures of campaigns left out": found.figures,
    }
    path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
