"""Simulate a damper with an effect, diagnose it from its recordings, and print the verdict."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.diagnosis.evidence import Evidence, evidence_of
from herringbone_sim.diagnosis.examine import Examined, Found, examine
from herringbone_sim.diagnosis.judge import NAMES, chances, fit
from herringbone_sim.examples.damper.machine import Damper
from herringbone_sim.examples.damper.simulate import MODERATE, simulate

WEIGHTS = Path(__file__).with_name("weights.json")
OUTSIDE = ("maxwell", "smooth")
FIRST = 1000  # seed of practice
PENALTY = 0.1  # precision of the weights about zero: they are of order one


def probabilities(
    evidence: Evidence, weights: NDArray[np.float64]
) -> dict[tuple[str, ...], float]:
    """Of explanations, with all shapes of an effect together, most probable first."""
    found: dict[tuple[str, ...], float] = {}
    for one in chances(evidence, weights):
        found[one.effects] = found.get(one.effects, 0.0) + one.probability
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def practise(rigs: int) -> NDArray[np.float64]:
    """Weights of the judge from some rigs of every cause, those outside the catalogue too."""
    evidence, truths = [], []
    for cause in ("none", *MODERATE):
        truth = () if cause == "none" else ("unknown",) if cause in OUTSIDE else (cause,)
        for seed in range(FIRST, FIRST + rigs):
            evidence.append(evidence_of(examine(Damper(simulate(cause, seed)))))
            truths.append(truth)
    return fit(evidence, truths, PENALTY)


def kept_weights() -> NDArray[np.float64]:
    """Those of the last practice; a number that the judge did not look at then weighs nothing."""
    data = json.loads(WEIGHTS.read_text(encoding="utf-8"))
    return np.array([data.get(name, 0.0) for name in NAMES])


def verdict(found: Examined, weights: NDArray[np.float64]) -> str:
    """Probabilities, and the numbers of the best single effect."""
    lines = []
    for effects, p in probabilities(evidence_of(found), weights).items():
        if p >= 0.001:
            lines.append(f"{100.0 * p:6.1f} %  {' and '.join(effects) or 'none'}")
    best, n = found.singles[0], found.count
    left = f"{found.none.energy / n:.2f} without it, {best.energy / n:.2f} with it"
    lines.append(f"best effect: {described(best)}")
    return "\n".join([*lines, f"mean square left over the noise: {left}"])


def described(one: Found) -> str:
    """An effect with its options and fitted numbers."""
    h, score = one.hypotheses[0], one.score
    own = slice(len(score.mean) - len(h.coefficients), None)
    sd = np.sqrt(np.diag(score.spread()))
    values = zip(score.coefficients[own], score.mean[own], sd[own], strict=True)
    fitted = ", ".join(f"{c.name} = {value:.3g} +- {sd:.1g}" for c, value, sd in values)
    return ", ".join([h.effect, *(f"{name} {value}" for name, value in h.options), fitted])


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m herringbone_sim.examples.damper")
    parser.add_argument("--effect", choices=("none", *MODERATE), default="stribeck")
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--practice", type=int, metavar="RIGS", help="first fit the judge anew")
    given = parser.parse_args(arguments)
    if given.practice:
        weights = dict(zip(NAMES, practise(given.practice).tolist(), strict=True))
        WEIGHTS.write_text(json.dumps(weights, indent=2) + "\n", encoding="utf-8")
    print(verdict(examine(Damper(simulate(given.effect, given.seed))), kept_weights()))


if __name__ == "__main__":
    main()
