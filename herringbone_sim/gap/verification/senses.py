"""The gap in three senses: residual, short-horizon prediction, attractor; before and after.

Prediction and attractor ask what the residual can't: whether the augmented model moves as the rig
does, over a horizon short against the Lyapunov time, and in the statistics of long motion.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.analysis.lyapunov import largest_exponent as exponent_of_data
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.residuals.fusion import Fused, fuse
from herringbone_sim.gap.residuals.motion import SEED, fused_noise
from herringbone_sim.gap.verdict.augmented import Augmented, nominal_model
from herringbone_sim.gap.verification.attractor import (
    Statistics,
    distances,
    half_statistics,
    mean_distances,
    measured_motion,
    model_motion,
    scale_of,
    statistics,
    statistics_to_dict,
)
from herringbone_sim.gap.verification.horizon import (
    horizon_of,
    largest_exponent,
    prediction_error,
    prediction_floor,
)
from herringbone_sim.gap.verification.simulator import GearSimulator, simulator_of
from herringbone_sim.gap.verification.verify import Gap, Mend, RunGap

Array = NDArray[np.float64]
Say = Callable[[str], None]
MODELS = ("nominal", "augmented", "runner_up")


@dataclass(frozen=True)
class Senses:
    """How far runs are from their models in every sense.

    Attributes:
        residual: of the metric that counts, force law, torque balance or consistency.
        prediction: RMS error of the mesh displacements over a short horizon [m].
        attractor: distance of the densities of the Poincare sections [sigma].
        horizon_cycles: of each run [mesh cycles].
        exponents: largest Lyapunov exponent of the augmented model at each run and its standard
            error [1 / mesh cycle].
        numbers: statistics and distances of the attractors by model and run.
        unknown: why a run has no prediction and attractor.
    """

    residual: Gap
    prediction: Gap
    attractor: Gap
    horizon_cycles: Mapping[str, float] = field(default_factory=dict)
    exponents: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    numbers: Mapping[str, Any] = field(default_factory=dict)
    unknown: tuple[str, ...] = ()


@dataclass(frozen=True)
class _RunSenses:
    """Of one run: prediction, attractor, and what is told beside."""

    prediction: RunGap
    attractor: RunGap
    horizon: float
    exponent: tuple[float, float]
    numbers: Mapping[str, Any]


def measure_senses(
    runs: Sequence[PreparedRun],
    mend: Mend,
    residual: Gap,
    model: Augmented,
    other: Augmented | None = None,
    say: Say = lambda text: None,
) -> Senses:
    """Prediction and attractor of some runs beside their residual.

    Args:
        runs: as recorded; the nominal model is held against them as they are.
        mend: takes from a run what the sensors were found to add.
        residual: gap of the same runs in the residual that counts.
        model, other: augmented model, and the runner-up as a control.
        say: told of each run.
    """
    told, unknown = [], []
    for run in runs:
        say(f"{run.name}: prediction and attractor")
        right = mend(run)
        fused = fuse(right)
        raw = fused if right is run else fuse(run)
        if _seen(fused):
            raw = raw if _seen(raw) else fused
            told.append(_of_run(run, right, raw, fused, model, other))
        else:
            unknown.append(run.name)
            told.append(_nothing(run))
    names = ("measured", "floor", *MODELS[: 2 if other is None else 3])
    return Senses(
        residual=residual,
        prediction=Gap("prediction", tuple(one.prediction for one in told)),
        attractor=Gap("attractor", tuple(one.attractor for one in told)),
        horizon_cycles={r.name: one.horizon for r, one in zip(runs, told, strict=True)},
        exponents={r.name: one.exponent for r, one in zip(runs, told, strict=True)},
        numbers={
            name: {
                r.name: one.numbers[name]
                for r, one in zip(runs, told, strict=True)
                if name in one.numbers
            }
            for name in names
        },
        unknown=_why(unknown),
    )


def _why(unknown: Sequence[str]) -> tuple[str, ...]:
    if not unknown:
        return ()
    return (
        f"{', '.join(unknown)}: neither prediction nor attractor, for which x (or u) and v must "
        "give every coordinate",
    )


def _seen(fused: Fused) -> bool:
    return bool(np.isfinite(fused.z).all() and np.isfinite(fused.z_rate).all())


def _nothing(run: PreparedRun) -> _RunSenses:
    nan = float("nan")
    none = RunGap(run.name, run.role, nan, nan, nan)
    return _RunSenses(none, none, nan, (nan, nan), {})


def _of_run(
    run: PreparedRun,
    right: PreparedRun,
    raw: Fused,
    fused: Fused,
    model: Augmented,
    other: Augmented | None,
) -> _RunSenses:
    noise = fused_noise(right, np.random.default_rng(SEED))
    sides = {"nominal": (run, raw, nominal_model()), "augmented": (right, fused, model)}
    if other is not None:
        sides["runner_up"] = (right, fused, other)
    machines = {name: simulator_of(r, m) for name, (r, _, m) in sides.items()}
    exponent = largest_exponent(right, fused, machines["augmented"], np.random.default_rng(SEED))
    ahead = horizon_of(right, exponent[0])
    predicted = {
        name: prediction_error(r, f, machines[name], ahead) for name, (r, f, _) in sides.items()
    }
    floor = prediction_floor(right, fused, noise, machines["augmented"], ahead)
    numbers = _attractors(sides, machines, noise)
    numbers["augmented"] |= {"exponent": {"value": exponent[0], "sigma": exponent[1]}}
    section = {name: numbers[name]["distance"]["section"] for name in ("floor", *sides)}
    return _RunSenses(
        _gap(run, predicted, floor),
        _gap(run, section, section["floor"]),
        ahead.cycles,
        exponent,
        numbers,
    )


def _gap(run: PreparedRun, found: Mapping[str, float], floor: float) -> RunGap:
    nominal, augmented = found["nominal"], found["augmented"]
    other = found.get("runner_up", float("nan"))
    return RunGap(run.name, run.role, nominal, augmented, floor, other)


def _attractors(
    sides: Mapping[str, tuple[PreparedRun, Fused, Augmented]],
    machines: Mapping[str, GearSimulator],
    noise: Fused,
) -> dict[str, Any]:
    """Statistics and distances by model; ``measured`` and ``floor`` beside."""
    run, fused, _ = sides["augmented"]
    scale = scale_of(fused)
    rig = measured_motion(run, fused)
    pieces = half_statistics(run, rig, scale)
    whole = statistics(run, rig, 0, scale)
    meshes = run.model.layout.meshes
    found: dict[str, Any] = {
        "measured": {
            **statistics_to_dict(whole, meshes),
            "exponent": _of_data(whole, fused, scale),
        },
        "floor": {"distance": distances(*pieces)},
    }
    for name, (its, start, model) in sides.items():
        path = model_motion(its, start, noise, machines[name], model.actives)
        own = scale if start is fused else scale_of(start)
        against = (
            pieces if start is fused else half_statistics(its, measured_motion(its, start), own)
        )
        found[name] = {
            **statistics_to_dict(statistics(its, path, 0, own), meshes),
            "distance": mean_distances(half_statistics(its, path, own), against),
        }
    return found


def _of_data(whole: Statistics, fused: Fused, scale: Array) -> dict[str, Any]:
    """Largest exponent of the measured section by data alone, or why there is none."""
    variance = np.concatenate([np.diag(fused.z_cov), np.diag(fused.z_rate_cov)]) / scale**2
    noise = float(np.sqrt(variance.mean()))
    found = exponent_of_data(whole.points[0], np.random.default_rng(SEED), noise)
    return {"value": found.value, "low": found.low, "high": found.high, "reason": found.reason}
