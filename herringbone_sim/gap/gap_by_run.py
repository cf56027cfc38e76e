"""Measure the gap of every run as the residual of one observation.

Each run is compared with the nominal gear, with the calibrated gear and with the calibrated gear
with effects; all coefficients are those fitted to the fit runs.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from herringbone_sim.arrays import Array, rms
from herringbone_sim.diagnosis.fits import FittedExplanation
from herringbone_sim.diagnosis.search import amplitudes
from herringbone_sim.gap.data.noise import spectral_floor
from herringbone_sim.gap.data.prepared import PreparedCampaign
from herringbone_sim.gap.observations import force_law, trajectory
from herringbone_sim.gap.observations.machine import GearMachine
from herringbone_sim.gap.verification.verify import Gap, RunGap


def metric_of(
    none: FittedExplanation, best: FittedExplanation | None, counts: Mapping[str, float]
) -> str:
    """Name of the observation in which to measure the gap.

    That in which the best explanation lowers chi2 most. Where it lowers chi2 in none, that with
    the largest chi2 above the expectation by noise.

    Args:
        none: fit without effects.
        best: fit of the best explanation; None: there is none.
        counts: number of whitened values, by observation.
    """
    before = {o: float(rows.sum()) for o, rows in none.score.chi2_by_row.items()}
    falls: dict[str, float] = {}
    if best is not None:
        falls = {o: before[o] - float(best.score.chi2_by_row[o].sum()) for o in before}
    if max(falls.values(), default=0.0) <= 0.0:
        falls = {o: before[o] - counts[o] for o in before}
    return max(falls, key=lambda o: falls[o])


def gap_of(
    machine: GearMachine,
    campaign: PreparedCampaign,
    metric: str,
    none: FittedExplanation,
    best: FittedExplanation | None,
    other: FittedExplanation | None = None,
    noise: Array | float = 1.0,
) -> Gap:
    """Measure the gap of the runs of a campaign in one observation.

    If the campaign does not give the noise, or if rotations lack their mean, the floor of force
    law and trajectory is at most the residual of the best explanation, and of the force law at
    most the white part of that.

    Args:
        machine: of all runs of the campaign, at every sample, ordered for ``best``.
        campaign: as prepared.
        metric: name of the observation.
        none: fit without effects.
        best: fit of the verdict's explanation; None: that without effects.
        other: fit of the runner-up; None: its residual is NaN.
        noise: (fit runs, R) actual over assumed noise of each of the R rows of the observation.
    """
    after = {"recalibrated": none, "augmented": best or none, "runner_up": other}
    # Before any fit: only runs without one may be reordered.
    machines = dict.fromkeys(after, machine)
    if other is not None:
        machines["runner_up"] = machine.ordered_for(other.hypotheses, other.score.mean)
    estimated = not campaign.noise_known or any(run.detrended for run in campaign.runs)
    bounded = estimated and metric in (force_law.NAME, trajectory.NAME)
    row_noise = np.sqrt(np.mean(np.square(np.atleast_2d(noise)), axis=0))
    rms_by_fit = {
        name: _residual_rms(machines[name], metric, fit, row_noise, bounded)
        for name, fit in after.items()
        if fit is not None
    }
    before = _residual_rms(machine, metric, None, row_noise, bounded)
    nan = [(float("nan"),) * 2] * len(campaign.runs)
    return Gap(
        metric,
        tuple(
            RunGap(
                run.name, run.role, n[0], a[0], min(n[1], a[1]) if bounded else n[1], r[0], c[0]
            )
            for run, n, a, r, c in zip(
                campaign.runs,
                before,
                rms_by_fit["augmented"],
                rms_by_fit.get("runner_up", nan),
                rms_by_fit["recalibrated"],
                strict=True,
            )
        ),
    )


def _residual_rms(
    machine: GearMachine,
    metric: str,
    fit: FittedExplanation | None,
    noise: Array,
    bounded: bool,
) -> list[tuple[float, float]]:
    """RMS of the residual and RMS of its noise for each run; NaN without the observation.

    Args:
        machine: with the runs.
        metric: name of the observation.
        fit: of an explanation; None: residual of the nominal gear.
        noise: (R,) actual over assumed noise of each row of the observation.
        bounded: whether to bound the noise by the residual, of the force law by its white part.
    """
    extended, hypotheses = machine.transferred(() if fit is None else fit.hypotheses)
    fitted: Mapping[str, Mapping[str, Array]] = {}
    if fit is not None:
        coefficients = (*extended.base, *(c for h in hypotheses for c in h.coefficients))
        fitted = amplitudes(coefficients, fit.score.mean, extended.runs, extended.rows)
    result = []
    for block in extended.blocks(fitted, {}, (metric,)):
        if metric not in block:
            result.append((float("nan"), float("nan")))
            continue
        b = block[metric]
        known = np.any(b.residual != 0.0, axis=0)
        # Rows beyond those of the fit runs get the RMS of the factors.
        factor = np.pad(noise, (0, len(known) - len(noise)), constant_values=rms(noise))
        left, floor = b.residual[:, known], rms((b.sigma * factor)[:, known])
        if bounded:
            floor = min(floor, rms(left))
        if bounded and metric == force_law.NAME:
            floor = min(floor, rms(spectral_floor(left)))
        result.append((rms(left), floor))
    return result
