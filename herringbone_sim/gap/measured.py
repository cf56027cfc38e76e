"""How far the gap shrinks on every run, in the observation that counts, by the engine itself.

A run is compared with the nominal machine, with the calibrated one (the tolerances put right) and
with the effect besides; held-out runs are measured with what the fit runs gave.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.diagnosis.examine import FittedExplanation
from herringbone_sim.diagnosis.search import amplitudes
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.observations.machine import GearMachine
from herringbone_sim.gap.verification.verify import Gap, RunGap

Array = NDArray[np.float64]


def metric_of(
    none: FittedExplanation, best: FittedExplanation | None, counts: Mapping[str, float]
) -> str:
    """The observation whose squares the best explanation lowers most.

    Where it lowers none, the one with most squares above what noise leaves.

    Args:
        counts: whitened values, by observation.
    """
    before = {o: float(rows.sum()) for o, rows in none.score.energy_by_row.items()}
    falls: dict[str, float] = {}
    if best is not None:
        falls = {o: before[o] - float(best.score.energy_by_row[o].sum()) for o in before}
    if max(falls.values(), default=0.0) <= 0.0:
        falls = {o: before[o] - counts[o] for o in before}
    return max(falls, key=lambda o: falls[o])


def gap_of(
    machine: GearMachine,
    runs: Sequence[PreparedRun],
    metric: str,
    none: FittedExplanation,
    best: FittedExplanation | None,
    other: FittedExplanation | None = None,
    noise: Array | float = 1.0,
) -> Gap:
    """The gap of all runs in an observation.

    Args:
        machine: of the fit runs.
        runs: all of the campaign, at every sample.
        metric: name of the observation.
        none, best, other: calibrated machine, the verdict's and the runner-up's explanation.
        noise: (fit runs, R) of the observation, over what it was taken for.
    """
    whole = machine.for_runs(runs)
    after = {"recalibrated": none, "augmented": best or none, "runner_up": other}
    rows = np.sqrt(np.mean(np.square(np.atleast_2d(noise)), axis=0))
    left = {name: _left(whole, metric, f, rows) for name, f in after.items() if f is not None}
    before = _left(whole, metric, None, rows)
    nan = [(float("nan"),) * 2] * len(runs)
    return Gap(
        metric,
        tuple(
            RunGap(run.name, run.role, n[0], a[0], n[1], r[0], c[0])
            for run, n, a, r, c in zip(
                runs,
                before,
                left["augmented"],
                left.get("runner_up", nan),
                left["recalibrated"],
                strict=True,
            )
        ),
    )


def _left(
    machine: GearMachine, metric: str, found: FittedExplanation | None, noise: Array
) -> list[tuple[float, float]]:
    """RMS of what an explanation leaves of each run, and of the noise, rows of it as given."""
    there, same = machine.transferred(() if found is None else found.hypotheses)
    made: Mapping[str, Mapping[str, Array]] = {}
    if found is not None:
        coefficients = (*there.base, *(c for h in same for c in h.coefficients))
        made = amplitudes(coefficients, found.score.mean, there.runs, there.rows)
    result = []
    for block in there.blocks(made, {}, (metric,)):
        if metric not in block:
            result.append((float("nan"), float("nan")))
            continue
        b = block[metric]
        known = np.any(b.residual != 0.0, axis=0)
        result.append((_rms(b.residual[:, known]), _rms((b.sigma * noise)[:, known])))
    return result


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")
