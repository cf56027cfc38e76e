"""Operating points that could be run next, and what the calibrated gear would record there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.integrate import simulate
from herringbone_sim.core.model import Model, build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.errors import HerringboneError
from herringbone_sim.gap.attribution.hypothesis import Case, case
from herringbone_sim.gap.data.prepared import Measured, PreparedRun
from herringbone_sim.gap.data.waves import waves
from herringbone_sim.gap.residuals.fusion import fuse

Array = NDArray[np.float64]

NAMES = ("delta_T", "K", "T_1", "Omega")
DIGITS = {"delta_T": 1, "K": 2, "T_1": 0, "Omega": 3}
LEVELS = 16
GENERATORS = (3, 7, 5, 6)  # of the lattice: every level of every quantity once
BEYOND = 0.2  # of the range of the runs, on either side of it
LEAST_BEYOND = {"delta_T": 20.0, "K": 0.1}  # [K], [-]
LEAST_SHARE = {"T_1": 0.4, "Omega": 0.2}  # of the mean
LOWEST_SHARE = 0.5  # of the least torque and speed that were run
TRANSIENT, CYCLES = 60, 80  # mesh cycles: one turn of every member against the carrier


@dataclass(frozen=True)
class Trial:
    """A point that was not run: the case that it would be, and its largest mesh force [N]."""

    point: dict[str, float]
    case: Case
    peak_n: float


def reach(points: Sequence[Mapping[str, float]]) -> dict[str, tuple[float, float]]:
    """Lowest and highest value of each quantity: those that were run and somewhat beyond."""
    found = {}
    for name in NAMES:
        values = [float(p[name]) for p in points if name in p] or [0.0]
        low, high = min(values), max(values)
        least = LEAST_BEYOND.get(name, LEAST_SHARE.get(name, 0.0) * float(np.mean(values)))
        margin = max(BEYOND * (high - low), least)
        floor = min(low, LOWEST_SHARE * low if name in LEAST_SHARE else 0.0)
        found[name] = (max(low - margin, floor), high + margin)
    return found


def candidates(points: Sequence[Mapping[str, float]]) -> list[dict[str, float]]:
    """Operating points (LEVELS) in reach, every level of each quantity once; half of them K = 0.

    Torques are spread evenly in their logarithm. A rank-1 lattice modulo a prime: Korobov, Number-
    Theoretic Methods in Approximate Analysis (1963).
    """
    ranges = reach(points)
    found = []
    for i in range(1, LEVELS + 1):
        shares = {
            name: ((i * g) % (LEVELS + 1) - 1) / (LEVELS - 1)
            for name, g in zip(NAMES, GENERATORS, strict=True)
        }
        found.append({n: round(_between(n, s, *ranges[n]), DIGITS[n]) for n, s in shares.items()})
    return found


def _between(name: str, share: float, low: float, high: float) -> float:
    if name == "K":
        return max(2.0 * share - 1.0, 0.0) * high
    if name == "T_1" and low > 0.0:
        return float(low * (high / low) ** share)
    return low + share * (high - low)


def trial(
    cases: Sequence[Case],
    nominal: Parameters,
    gear: Parameters,
    factors: Array,
    point: dict[str, float],
) -> Trial | None:
    """What the sensors of some runs would record at another point.

    None where the gear can't run, or stands still.

    Args:
        cases: fit runs: which channels there are, and their noise as a share of the RMS.
        nominal: of the full model.
        gear: the calibrated one, which moves.
        factors: (6,) its factors on k, c and e.
        point: where.
    """
    try:
        model = build(gear.changed(point))
        _, settled = simulate(model, TRANSIENT)
        series, _ = simulate(model, CYCLES, settled)
        run = _recorded([c.run for c in cases], series, build(nominal.changed(point)), factors)
        forces = series.columns(tuple(f"F_{mesh}" for mesh in model.layout.meshes))
        return Trial(point, case(run, fuse(run)), float(np.abs(forces).max()))
    except (HerringboneError, np.linalg.LinAlgError):
        return None


def _recorded(
    runs: Sequence[PreparedRun], series: TimeSeries, model: Model, factors: Array
) -> PreparedRun:
    """A clean motion as encoders with the nominal e(t) show it, with the channels of the runs."""
    phase, layout = series["phase"], model.layout
    omega = model.parameters.Omega * model.scales.omega_n
    w = waves(model, phase, omega)
    e = np.repeat(factors[4:6] - 1.0, layout.n_mesh // 2)
    x, v, force = (series.columns(tuple(f"{q}_{m}" for m in layout.meshes)) for q in "xvF")
    u = series.columns(tuple(f"u_{body}" for body in layout.bodies))
    return replace(
        runs[0],
        name="trial",
        point={name: getattr(model.parameters, name) for name in NAMES},
        times=series.times - series.times[0],
        phase=phase.copy(),
        x=_seen(x + e * w.e, [r.x for r in runs]),
        v=_seen(v + e * w.e_rate, [r.v for r in runs]),
        F=_seen(force, [r.F for r in runs]),
        u=_seen(u, [r.u for r in runs]),
        model=model,
        waves=w,
        recorded_point={},
        findings=(),
    )


def _seen(values: Array, runs: Sequence[Measured]) -> Measured:
    """Clean values (n, k) with the channels and the noise shares that the runs have."""
    there = np.logical_and.reduce([m.there for m in runs])
    rms = [np.sqrt(np.mean(np.nan_to_num(m.values) ** 2, axis=0)) for m in runs]
    shares = [m.sigma / np.maximum(r, 1e-300) for m, r in zip(runs, rms, strict=True)]
    share = np.median(shares, axis=0)
    sigma = share * np.sqrt(np.mean(values**2, axis=0))
    return Measured(np.where(there, values, np.nan), there, np.where(there, sigma, np.nan))
