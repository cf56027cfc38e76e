"""Measure the gap of every run as the residual of one observation.

Each run is compared with the nominal gear, with the calibrated gear and with the calibrated gear
with effects; all coefficients are those fitted to the fit runs.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from herringbone_sim.arrays import Array, rms
from herringbone_sim.diagnosis.coefficients import amplitudes
from herringbone_sim.diagnosis.fits import FittedExplanation
from herringbone_sim.diagnosis.products import Block, residual_without_nuisance, with_offsets
from herringbone_sim.gap.data.noise import spectral_floor
from herringbone_sim.gap.data.prepared import PreparedCampaign
from herringbone_sim.gap.observations import force_law
from herringbone_sim.gap.observations.gear_machine import GearMachine
from herringbone_sim.gap.observations.windows import trajectory
from herringbone_sim.gap.verification.residual_gap import Gap, RunGap


class RowErrors(NamedTuple):
    """Noise and constant errors of the R rows of an observation, as the diagnosis learned them.

    Attributes:
        noise: (fit runs, R) actual over assumed noise; None: 1.
        offsets: (R,) standard deviation of a constant error over the assumed noise; None: none.
    """

    noise: Array | None = None
    offsets: Array | None = None


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
    errors: RowErrors | None = None,
) -> Gap:
    """Measure the gap of the runs of a campaign in one observation.

    What drift, hum and encoders off centre make of each run under ``best`` is taken off all
    residuals of that run alike (of the trajectory, each fit takes off its own): it is neither a
    gap nor noise.

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
        errors: of the rows of the observation; None: none is known.
    """
    after = {"recalibrated": none, "augmented": best or none, "runner_up": other}
    # Before any fit: only runs without one may be reordered.
    machines = dict.fromkeys(after, machine)
    if other is not None:
        machines["runner_up"] = machine.ordered_for(other.hypotheses, other.score.mean)
    estimated = not campaign.noise_known or any(run.detrended for run in campaign.runs)
    bounded = estimated and metric in (force_law.NAME, trajectory.NAME)
    noise, offsets = errors or RowErrors()
    row_noise = np.ones(1) if noise is None else np.sqrt(np.mean(np.square(noise), axis=0))
    by_fit = {
        name: _blocks(machines[name], metric, fit, row_noise, offsets)
        for name, fit in after.items()
        if fit is not None
    }
    of_sensors = [None if b is None else _sensor_errors(b) for b in by_fit["augmented"]]
    before = _blocks(machine, metric, None, row_noise, offsets)
    rms_by_fit = {
        name: [_residual_rms(b, e, bounded) for b, e in zip(blocks, of_sensors, strict=True)]
        for name, blocks in (*by_fit.items(), ("nominal", before))
    }
    nan = [(float("nan"),) * 2] * len(campaign.runs)
    return Gap(
        metric,
        tuple(
            RunGap(
                run.name, run.role, n[0], a[0], min(n[1], a[1]) if bounded else n[1], r[0], c[0]
            )
            for run, n, a, r, c in zip(
                campaign.runs,
                rms_by_fit["nominal"],
                rms_by_fit["augmented"],
                rms_by_fit.get("runner_up", nan),
                rms_by_fit["recalibrated"],
                strict=True,
            )
        ),
    )


def _blocks(
    machine: GearMachine,
    metric: str,
    fit: FittedExplanation | None,
    noise: Array,
    offsets: Array | None,
) -> list[Block | None]:
    """Return the residual of each run from an explanation as a ``Block`` with the actual noise.

    None for a run without the observation.

    Args:
        machine: of all runs.
        metric: name of the observation.
        fit: of the explanation; None: the nominal gear.
        noise: (R,) actual over assumed noise of each row, or (1,) for all rows.
        offsets: (R,) as ``RowErrors.offsets``.
    """
    extended, hypotheses = machine.transferred(() if fit is None else fit.hypotheses)
    fitted: Mapping[str, Mapping[str, Array]] = {}
    if fit is not None:
        coefficients = (*extended.base, *(c for h in hypotheses for c in h.coefficients))
        fitted = amplitudes(coefficients, fit.score.mean, extended.runs, extended.rows)
    made = [b.get(metric) for b in extended.blocks(fitted, {}, (metric,))]
    return [
        b
        if b is None
        else with_offsets(
            b,
            None if offsets is None else _for_rows(offsets, b.residual.shape[1]),
            _for_rows(noise, b.residual.shape[1]),
        )
        for b in made
    ]


def _for_rows(values: Array, rows: int) -> Array:
    """Values (R,) of the rows of the fit runs; rows beyond those get their RMS."""
    return np.pad(values[:rows], (0, max(0, rows - len(values))), constant_values=rms(values))


def _sensor_errors(block: Block) -> Array:
    """Part (n, R) of a residual that drift, hum and encoders off centre make, in its unit."""
    if block.observation == trajectory.NAME:  # eliminated in the block
        return np.zeros_like(block.residual)
    return np.asarray(block.residual - residual_without_nuisance(block) * block.sigma)


def _residual_rms(block: Block | None, errors: Array | None, bounded: bool) -> tuple[float, float]:
    """RMS of the residual of a run and RMS of its noise; NaN without the observation.

    Args:
        block: of the run.
        errors: (n, R) error of the sensors in the residual; None without the observation.
        bounded: whether to bound the noise by the residual, of the force law by its white part.
    """
    if block is None or errors is None:
        return float("nan"), float("nan")
    known = np.any(block.residual != 0.0, axis=0)
    left = (block.residual - errors)[:, known]
    floor = rms(block.sigma[:, known])
    if bounded:
        floor = min(floor, rms(left))
    if bounded and block.observation == force_law.NAME:
        floor = min(floor, rms(spectral_floor(left)))
    return rms(left), floor
