"""Candidate operating points of the next run, and the recording predicted at one of them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.integrate import simulate
from herringbone_sim.core.model import Model, build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.errors import HerringboneError
from herringbone_sim.gap.attribution.effect_forces import FusedRun, fused_run
from herringbone_sim.gap.data.mesh_excitation import waves
from herringbone_sim.gap.data.prepared import Measured, PreparedRun
from herringbone_sim.gap.observations.runs import fuse_with_rates
from herringbone_sim.recording.campaign import POINT

# Decimals to which a point is rounded; small values keep two significant digits.
DIGITS = {"delta_T": 1, "K": 2, "T_1": 0, "Omega": 3}
LEVELS = 16
GENERATORS = (3, 7, 5, 6)  # of the lattice: each level of each quantity occurs once
MARGIN = 0.2  # beyond the values of the runs on either side, over their range
LEAST_MARGIN = {"delta_T": 20.0, "K": 0.1}  # [K], [-]
LEAST_MARGIN_SHARE = {"T_1": 0.4, "Omega": 0.2}  # of the mean
LOWEST_SHARE = 0.5  # lowest torque and speed over the smallest of the runs
# Mesh cycles before a recording, and recorded: a turn of every member against the carrier.
TRANSIENT, CYCLES = 60, 80


@dataclass(frozen=True)
class PredictedRun:
    """A run predicted at an operating point, and its largest absolute mesh force [N]."""

    point: dict[str, float]
    case: FusedRun
    peak_n: float


def value_ranges(points: Sequence[Mapping[str, float]]) -> dict[str, tuple[float, float]]:
    """Range (low, high) to try of each quantity of ``POINT``: that of the runs with a margin.

    Torque and speed stay above ``LOWEST_SHARE`` of their smallest value, the others above 0.
    """
    ranges = {}
    for name in POINT:
        values = [float(p[name]) for p in points if name in p] or [0.0]
        low, high = min(values), max(values)
        share = LEAST_MARGIN_SHARE.get(name, 0.0)
        size = abs(float(np.mean(values)))
        margin = max(MARGIN * (high - low), LEAST_MARGIN.get(name, share * size))
        floor = min(low, LOWEST_SHARE * low if name in LEAST_MARGIN_SHARE else 0.0)
        ranges[name] = (max(low - margin, floor), high + margin)
    return ranges


def candidate_points(points: Sequence[Mapping[str, float]]) -> list[dict[str, float]]:
    """``LEVELS`` operating points in ``value_ranges``; each level of a quantity occurs once.

    Levels of torque are equidistant in its logarithm; the lower half of those of K is 0. A rank-1
    lattice modulo a prime: Korobov, Number-Theoretic Methods in Approximate Analysis (1963).
    """
    ranges = value_ranges(points)
    candidates = []
    for i in range(1, LEVELS + 1):
        shares = {
            name: ((i * g) % (LEVELS + 1) - 1) / (LEVELS - 1)
            for name, g in zip(POINT, GENERATORS, strict=True)
        }
        candidates.append({n: rounded(n, _level(n, s, *ranges[n])) for n, s in shares.items()})
    return candidates


def rounded(name: str, value: float) -> float:
    """Value of a quantity rounded to ``DIGITS``, but to two significant digits at least."""
    if value == 0.0:
        return 0.0
    return round(value, max(DIGITS[name], 1 - math.floor(math.log10(abs(value)))))


def _level(name: str, share: float, low: float, high: float) -> float:
    """Value of a quantity at the fraction ``share``, 0 ... 1, of its range."""
    if name == "K":
        return max(2.0 * share - 1.0, 0.0) * high
    if name == "T_1" and low > 0.0:
        return float(low * (high / low) ** share)
    return low + share * (high - low)


def predict_run(
    cases: Sequence[FusedRun],
    nominal: Parameters,
    gear: Parameters,
    factors: Array,
    point: dict[str, float],
) -> PredictedRun | None:
    """Simulate the calibrated gear at an operating point and record it as the fit runs were.

    Args:
        cases: fit runs, for the recorded channels and the ratio of their noise to their RMS.
        nominal: parameters of the nominal gear, full model.
        gear: parameters of the calibrated gear, which is simulated.
        factors: (6,) of the calibrated gear on k, c and e.
        point: delta_T [K], K, T_1 [N m], Omega.

    Returns:
        The run; None where the gear can't be simulated at the point.
    """
    try:
        model = build(gear.changed(point))
        _, settled = simulate(model, TRANSIENT)
        series, _ = simulate(model, CYCLES, settled)
        run = _recorded([c.run for c in cases], series, build(nominal.changed(point)), factors)
        forces = series.columns(model.layout.channels_of("F"))
        return PredictedRun(
            point, fused_run(run, fuse_with_rates(run)), float(np.abs(forces).max())
        )
    except (HerringboneError, np.linalg.LinAlgError):
        return None


def _recorded(
    runs: Sequence[PreparedRun], series: TimeSeries, model: Model, factors: Array
) -> PreparedRun:
    """A simulated motion as a run with x, v, F and u of the fit runs; neither noise nor delay.

    Recorded x and v are relative to the nominal e(t), those of the simulation to the calibrated,
    which ``factors`` (6,) on k, c and e give; ``model`` is the nominal one.
    """
    phase, layout = series["phase"], model.layout
    omega = model.parameters.Omega * model.scales.omega_n
    w = waves(model, phase, omega)
    e = np.repeat(factors[4:6] - 1.0, layout.n_mesh // 2)
    x, v, force, u = (series.columns(layout.channels_of(q)) for q in "xvFu")
    return PreparedRun(
        name="predicted",
        role=runs[0].role,
        point={name: getattr(model.parameters, name) for name in POINT},
        times=series.times - series.times[0],
        phase=phase.copy(),
        x=_as_recorded(x + e * w.e, [r.x for r in runs]),
        v=_as_recorded(v + e * w.e_rate, [r.v for r in runs]),
        F=_as_recorded(force, [r.F for r in runs]),
        u=_as_recorded(u, [r.u for r in runs]),
        a=_not_recorded(len(phase), len(layout.bodies)),
        pin=_not_recorded(len(phase), len(layout.planets)),
        model=model,
        waves=w,
    )


def _as_recorded(values: Array, runs: Sequence[Measured]) -> Measured:
    """Values (n, k) of channels recorded in all runs, with their median ratio of noise to RMS."""
    there = np.logical_and.reduce([m.recorded for m in runs])
    rms = [np.sqrt(np.mean(np.nan_to_num(m.values) ** 2, axis=0)) for m in runs]
    shares = [m.sigma / np.maximum(r, 1e-300) for m, r in zip(runs, rms, strict=True)]
    share = np.median(shares, axis=0)
    sigma = share * np.sqrt(np.mean(values**2, axis=0))
    return Measured(np.where(there, values, np.nan), there, np.where(there, sigma, np.nan))


def _not_recorded(n: int, channels: int) -> Measured:
    """Values (n, channels) of channels that are not recorded."""
    nothing = np.full((n, channels), np.nan)
    return Measured(nothing, np.zeros(channels, dtype=bool), nothing[0])
