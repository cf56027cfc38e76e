"""Simulate a damper with an effect, diagnose it from its recordings, and print the verdict."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.diagnosis.evidence import Evidence, evidence_of
from herringbone_sim.diagnosis.examine import Examination, examine
from herringbone_sim.diagnosis.fits import FittedExplanation
from herringbone_sim.diagnosis.judge import NAMES, chances
from herringbone_sim.diagnosis.judge_weights import fit
from herringbone_sim.examples.damper.machine import Damper
from herringbone_sim.examples.damper.simulate import MODERATE_SIZES, simulate

WEIGHTS = Path(__file__).with_name("weights.json")
OUTSIDE_CATALOGUE = ("maxwell", "smooth")
FIRST_SEED = 1000  # seed of the first practice rig
PENALTY = 0.1  # prior precision of the judge's weights about 0; chosen, as they are of order 1


def probabilities(evidence: Evidence, weights: Array) -> dict[tuple[str, ...], float]:
    """Probability by ids of the effects, summed over options of an effect, most probable first."""
    by_effects: dict[tuple[str, ...], float] = {}
    for chance in chances(evidence, weights):
        by_effects[chance.effects] = by_effects.get(chance.effects, 0.0) + chance.probability
    return dict(sorted(by_effects.items(), key=lambda item: -item[1]))


def train_judge(rigs: int) -> Array:
    """Fit the judge's weights (len(NAMES),) to simulated rigs.

    Args:
        rigs: number of rigs of each cause: none, every effect, and those of no catalogue.
    """
    evidence, truths = [], []
    for cause in ("none", *MODERATE_SIZES):
        truth = () if cause == "none" else ("unknown",) if cause in OUTSIDE_CATALOGUE else (cause,)
        for seed in range(FIRST_SEED, FIRST_SEED + rigs):
            evidence.append(evidence_of(examine(Damper(simulate(cause, seed)))))
            truths.append(truth)
    return fit(evidence, truths, PENALTY)


def load_weights() -> Array:
    """Read the judge's weights (len(NAMES),) that ``--practice`` wrote to ``WEIGHTS``.

    Weights that the file does not name are 0. FileNotFoundError: there is no file.
    """
    data = json.loads(WEIGHTS.read_text(encoding="utf-8"))
    return np.array([data.get(name, 0.0) for name in NAMES])


def verdict(examination: Examination, weights: Array) -> str:
    """Text with probabilities of 0.1 % or more, and the best single effect with its fit."""
    lines = []
    for effects, p in probabilities(evidence_of(examination), weights).items():
        if p >= 0.001:
            lines.append(f"{100.0 * p:6.1f} %  {' and '.join(effects) or 'none'}")
    best, n = examination.singles[0], examination.count
    squares_left = f"{examination.none.loss / n:.2f} without it, {best.loss / n:.2f} with it"
    lines.append(f"best effect: {describe(best)}")
    return "\n".join([*lines, f"mean square left over the noise: {squares_left}"])


def describe(explanation: FittedExplanation) -> str:
    """Text of an explanation by one effect: options, fitted values and standard deviations."""
    h, score = explanation.hypotheses[0], explanation.score
    own = slice(len(score.mean) - len(h.coefficients), None)
    sd = np.sqrt(np.diag(score.covariance_with_jackknife()))
    values = zip(score.coefficients[own], score.mean[own], sd[own], strict=True)
    fitted = ", ".join(f"{c.name} = {value:.3g} +- {sd:.1g}" for c, value, sd in values)
    return ", ".join([h.effect, *(f"{name} {value}" for name, value in h.options), fitted])


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m herringbone_sim.examples.damper")
    parser.add_argument("--effect", choices=("none", *MODERATE_SIZES), default="stribeck")
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--practice", type=int, metavar="RIGS", help="first fit the judge anew")
    given = parser.parse_args(arguments)
    if given.practice:
        weights = dict(zip(NAMES, train_judge(given.practice).tolist(), strict=True))
        WEIGHTS.write_text(json.dumps(weights, indent=2) + "\n", encoding="utf-8")
    print(verdict(examine(Damper(simulate(given.effect, given.seed))), load_weights()))


if __name__ == "__main__":
    main()
