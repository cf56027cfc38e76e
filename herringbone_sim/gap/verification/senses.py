"""The gap in three senses: as residual, as short-horizon prediction and as attractor.

Prediction and attractor show whether the augmented model moves like the rig, over a horizon short
against the Lyapunov time and in the statistics of long motion; the residual can't.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from herringbone_sim.analysis.lyapunov import largest_exponent as exponent_of_data
from herringbone_sim.arrays import Array
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.residuals.balance_without_forces import SEED, fused_noise
from herringbone_sim.gap.residuals.fusion import Fused, fuse
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
from herringbone_sim.gap.verification.residual_gap import Correction, Gap, RunGap
from herringbone_sim.gap.verification.short_prediction import (
    horizon_of,
    largest_exponent,
    prediction_error,
    prediction_floor,
)
from herringbone_sim.gap.verification.simulator import GearSimulator, simulator_of

Say = Callable[[str], None]
SENSES = ("residual", "prediction", "attractor")
MODELS = ("nominal", "augmented", "runner_up")


@dataclass(frozen=True)
class Senses:
    """The gap of all runs in three senses.

    Attributes:
        residual: in the metric of the verdict.
        prediction: RMS error of the mesh displacements over a short horizon [m].
        attractor: distance of the Poincare sections [sigma].
        horizon_cycles: horizon of each run [mesh cycles].
        exponents: largest Lyapunov exponent of the augmented model at the operating point of each
            run, and its standard error [1 / mesh cycle].
        numbers: statistics and distances of the attractors, by ``measured``, ``floor`` or model,
            and by run, see ``serialise.attractor_to_dict``.
        unknown: sentences on runs without prediction and attractor.
    """

    residual: Gap
    prediction: Gap
    attractor: Gap
    horizon_cycles: Mapping[str, float] = field(default_factory=dict)
    exponents: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    numbers: Mapping[str, Any] = field(default_factory=dict)
    unknown: tuple[str, ...] = ()

    @property
    def gaps(self) -> dict[str, Gap]:
        """The three gaps by name of the sense."""
        return {name: getattr(self, name) for name in SENSES}


@dataclass(frozen=True)
class _RunSenses:
    """Gap of one run as prediction and attractor; attributes as in ``Senses``, for this run."""

    prediction: RunGap
    attractor: RunGap
    horizon: float
    exponent: tuple[float, float]
    numbers: Mapping[str, Any]


def measure_senses(
    runs: Sequence[PreparedRun],
    correct: Correction,
    residual: Gap,
    model: Augmented,
    other: Augmented | None = None,
    say: Say = lambda text: None,
) -> Senses:
    """Measure the gap of runs as prediction and attractor, beside their residual.

    Args:
        runs: as recorded; the nominal model is compared with uncorrected runs.
        correct: removes the sensor effects of the verdict from a run.
        residual: gap of the same runs in the metric of the verdict.
        model: augmented model.
        other: model of the runner-up, as a control; None: there is none.
        say: called with a line of progress for each run.
    """
    nan = float("nan")
    by_run: dict[str, _RunSenses] = {}
    unknown = []
    for run in runs:
        say(f"{run.name}: prediction and attractor")
        corrected = correct(run)
        fused = fuse(corrected)
        raw = fused if corrected is run else fuse(run)
        if fused.complete:
            raw = raw if raw.complete else fused
            by_run[run.name] = _senses_of_run(run, corrected, raw, fused, model, other)
        else:
            unknown.append(run.name)
            none = RunGap(run.name, run.role, nan, nan, nan)
            by_run[run.name] = _RunSenses(none, none, nan, (nan, nan), {})
    names = ("measured", "floor", *MODELS[: 2 if other is None else 3])
    reason = (
        f"{', '.join(unknown)}: neither prediction nor attractor, for which x (or u) and v must "
        "give every coordinate"
    )
    return Senses(
        residual=residual,
        prediction=Gap("prediction", tuple(s.prediction for s in by_run.values())),
        attractor=Gap("attractor", tuple(s.attractor for s in by_run.values())),
        horizon_cycles={n: s.horizon for n, s in by_run.items()},
        exponents={n: s.exponent for n, s in by_run.items()},
        numbers={
            name: {n: s.numbers[name] for n, s in by_run.items() if name in s.numbers}
            for name in names
        },
        unknown=(reason,) if unknown else (),
    )


def _senses_of_run(
    run: PreparedRun,
    corrected: PreparedRun,
    raw: Fused,
    fused: Fused,
    model: Augmented,
    other: Augmented | None,
) -> _RunSenses:
    """Measure prediction and attractor of a run.

    Args:
        run: as recorded.
        corrected: the run without the sensor effects of the verdict.
        raw, fused: fused motion of ``run`` and of ``corrected``.
        model: augmented model.
        other: model of the runner-up; None: there is none.
    """
    noise = fused_noise(corrected, np.random.default_rng(SEED))
    models = {"nominal": (run, raw, nominal_model()), "augmented": (corrected, fused, model)}
    if other is not None:
        models["runner_up"] = (corrected, fused, other)
    simulators = {name: simulator_of(r, m) for name, (r, _, m) in models.items()}
    exponent = largest_exponent(
        corrected, fused, simulators["augmented"], np.random.default_rng(SEED)
    )
    horizon = horizon_of(corrected, exponent[0])
    predicted = {
        name: prediction_error(r, f, simulators[name], horizon)
        for name, (r, f, _) in models.items()
    }
    floor = prediction_floor(corrected, fused, noise, simulators["augmented"], horizon)
    numbers = _attractors(models, simulators, noise)
    numbers["augmented"] |= {"exponent": {"value": exponent[0], "sigma": exponent[1]}}
    section = {name: numbers[name]["distance"]["section"] for name in ("floor", *models)}
    return _RunSenses(
        _gap(run, predicted, floor),
        _gap(run, section, section["floor"]),
        horizon.cycles,
        exponent,
        numbers,
    )


def _gap(run: PreparedRun, values: Mapping[str, float], floor: float) -> RunGap:
    """Return the gap of a run from ``values``, by name of the model, and the noise floor."""
    nominal, augmented = values["nominal"], values["augmented"]
    other = values.get("runner_up", float("nan"))
    return RunGap(run.name, run.role, nominal, augmented, floor, other)


def _attractors(
    models: Mapping[str, tuple[PreparedRun, Fused, Augmented]],
    simulators: Mapping[str, GearSimulator],
    noise: Fused,
) -> dict[str, Any]:
    """Compute statistics of the motion of each model and its distance from the rig's motion.

    Args:
        models: run, fused motion and model, by name of the model.
        simulators: simulator of each model, by name.
        noise: a realisation of the noise of the fused motion.

    Returns:
        Plain data by name of the model; those of the rig under ``measured``, the distance between
        the halves of its motion under ``floor``.
    """
    run, fused, _ = models["augmented"]
    scale = scale_of(fused)
    rig = measured_motion(run, fused)
    pieces = half_statistics(run, rig, scale)
    whole = statistics(run, rig, slice(None), scale)
    meshes = run.model.layout.meshes
    result: dict[str, Any] = {
        "measured": {
            **statistics_to_dict(whole, meshes),
            "exponent": _exponent_of_data(whole, fused, scale),
        },
        "floor": {"distance": distances(*pieces)},
    }
    for name, (its_run, start, model) in models.items():
        motion = model_motion(its_run, start, noise, simulators[name], model.actives)
        own = scale if start is fused else scale_of(start)
        against = (
            pieces
            if start is fused
            else half_statistics(its_run, measured_motion(its_run, start), own)
        )
        result[name] = {
            **statistics_to_dict(statistics(its_run, motion, slice(None), own), meshes),
            "distance": mean_distances(half_statistics(its_run, motion, own), against),
        }
    return result


def _exponent_of_data(stats: Statistics, fused: Fused, scale: Array) -> dict[str, Any]:
    """Estimate the largest Lyapunov exponent from the measured Poincare section at phase 0."""
    variance = np.concatenate([np.diag(fused.z_cov), np.diag(fused.z_rate_cov)]) / scale**2
    noise = float(np.sqrt(variance.mean()))
    exponent = exponent_of_data(stats.points[0], np.random.default_rng(SEED), noise)
    return {
        "value": exponent.value,
        "low": exponent.low,
        "high": exponent.high,
        "reason": exponent.reason,
    }
