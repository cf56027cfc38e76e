"""Rigs with a known difference, recorded as rigs do: nominal e(t), noise on every channel."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from herringbone_sim.core.model import Model, build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.diagnosis.score import Score
from herringbone_sim.effects.effect import Active, Locus
from herringbone_sim.effects.registry import effects as known_effects
from herringbone_sim.effects.stepper import simulate
from herringbone_sim.gap.data.mesh_excitation import waves
from herringbone_sim.gap.data.prepare import prepare_run
from herringbone_sim.gap.data.prepared import Measured, PreparedCampaign, PreparedRun
from herringbone_sim.gap.observations.gear import GearObservations
from herringbone_sim.gap.observations.gear_machine import GearMachine
from herringbone_sim.gap.observations.windows.columns import window_columns
from herringbone_sim.gap.observations.windows.shooting import WindowSolution
from herringbone_sim.gap.observations.windows.trajectory import Trajectory
from herringbone_sim.gap.report import SCHEMA, Report
from herringbone_sim.gap.report_file import METRICS
from herringbone_sim.gap.residuals.mesh_law import LawChange
from herringbone_sim.gap.verdict.decide import Verdict
from herringbone_sim.gap.verdict.next_experiment import NextExperiment
from herringbone_sim.gap.verification.residual_gap import Gap, RunGap
from herringbone_sim.gap.verification.senses import SENSES
from herringbone_sim.gap.verification.serialise import NUMBERS
from herringbone_sim.practice.arrays import as_prepared
from herringbone_sim.practice.campaign import PracticeCampaign, make_campaign
from herringbone_sim.practice.plan import draw_plan
from herringbone_sim.practice.record import SAMPLES_PER_CYCLE
from herringbone_sim.recording.campaign import CampaignRun
from herringbone_sim.recording.channels import Channels
from herringbone_sim.recording.reader import Recording

NOMINAL = Parameters(model="full", samples_per_cycle=24)
OMEGA_N = build(NOMINAL).scales.omega_n
POINTS = (
    {"delta_T": 85.0, "K": 0.0, "T_1": 283.0, "Omega": 0.942},
    {"delta_T": 72.0, "K": 0.0, "T_1": 2150.0, "Omega": 0.314},
    {"delta_T": 37.0, "K": 0.05, "T_1": 1145.0, "Omega": 0.615},
)
ROLES = ("fit", "fit", "held_out")
REPORT_KEYS = (
    "schema",
    "campaign",
    "verdict",
    "effects",
    "where",
    "causes",
    "ambiguous_with",
    "gap",
    "attractor",
    "undecidable",
    "next_experiment",
)


def sampled(
    own: Mapping[str, Any],
    point: Mapping[str, float],
    cycles: int = 40,
    actives: Sequence[Active] = (),
) -> TimeSeries:
    """A run of the rig with its own parameters and effects, without noise.

    x and v hold the nominal e(t).
    """
    nominal = build(NOMINAL.changed(point))
    rig = build(NOMINAL.changed({**point, "omega_n": OMEGA_N, **own}))
    _, state = simulate(rig, actives, 60)
    series, _ = simulate(rig, actives, cycles, state)
    return with_nominal_error(series, rig, nominal)


def with_nominal_error(series: TimeSeries, rig: Model, nominal: Model) -> TimeSeries:
    """x + e_own - e_nominal, and v likewise: what encoders and the nominal e(t) give."""
    omega = nominal.parameters.Omega * nominal.scales.omega_n
    its, ours = (waves(m, series["phase"], omega) for m in (rig, nominal))
    data = series.data.copy()
    for j, name in enumerate(rig.layout.meshes):
        data[:, series.names.index(f"x_{name}")] += (its.e - ours.e)[:, j]
        data[:, series.names.index(f"v_{name}")] += (its.e_rate - ours.e_rate)[:, j]
    return TimeSeries(series.times, data, series.names)


def noisy(series: TimeSeries, share: float, seed: int) -> TimeSeries:
    """White noise of a share of each channel's RMS on all but the head."""
    data = series.data.copy()
    rms = np.sqrt(np.mean(data[:, 5:] ** 2, axis=0))
    data[:, 5:] += share * rms * np.random.default_rng(seed).normal(size=data[:, 5:].shape)
    return TimeSeries(series.times, data, series.names)


def prepared(
    series: TimeSeries,
    point: Mapping[str, float],
    role: str = "fit",
    share: float | None = 0.01,
    name: str = "run",
    nominal: Parameters = NOMINAL,
) -> PreparedRun:
    recording = Recording(Path(name), name, series, Channels(), (), True, ())
    return prepare_run(CampaignRun(Path(name), point, role), recording, nominal, share)


def rig(
    own: Mapping[str, Any],
    share: float = 0.01,
    seed: int = 7,
    cycles: int = 40,
    actives: Sequence[Active] = (),
) -> PreparedCampaign:
    """Three runs of a rig, the last one held out."""
    shown = [
        noisy(sampled(own, p, cycles, actives), share, seed + i) for i, p in enumerate(POINTS)
    ]
    runs = tuple(
        prepared(series, point, role, share, f"run_{i:02d}")
        for i, (series, point, role) in enumerate(zip(shown, POINTS, ROLES, strict=True))
    )
    return PreparedCampaign("planted", NOMINAL, runs, ())


def with_few_runs(campaign: PreparedCampaign) -> PreparedCampaign:
    """Of a practice campaign, which has five to fit and three held out, three and one."""
    fitted, held_out = campaign.of_role("fit")[:3], campaign.of_role("held_out")[:1]
    return replace(campaign, runs=(*fitted, *held_out))


def shortened(made: PracticeCampaign, cycles: int) -> PracticeCampaign:
    """The first mesh cycles of each recording of a practice campaign."""
    kept = cycles * SAMPLES_PER_CYCLE
    series = [TimeSeries(s.times[:kept], s.data[:kept], s.names) for s in made.series]
    return replace(made, series=tuple(series))


def without(m: Measured, names: Sequence[str], gone: Sequence[str]) -> Measured:
    """Channels without some of them."""
    out = np.array([name in gone for name in names])
    values = np.where(out, np.nan, m.values)
    return Measured(values, m.recorded & ~out, np.where(out, np.nan, m.sigma))


def of_shafts(run: PreparedRun) -> PreparedRun:
    """The run as the rotations of suns and carrier alone show it."""
    layout = run.model.layout
    planets = tuple(b for b in layout.bodies if b.startswith("p"))
    parts = {q: without(getattr(run, q), layout.meshes, layout.meshes) for q in "xvF"}
    return replace(run, u=without(run.u, layout.bodies, planets), **parts)


def a_report(verdict: Verdict | None = None, **more: Any) -> Report:
    """A report of a gap of one held-out run; by default of a verdict of no effect."""
    nothing = Verdict("none", (), {"none": 1.0}, {}, (), "force_law", None, None, ())
    gap = Gap("force_law", (RunGap("run_00", "held_out", 3.0, 1.2, 1.0),))
    point = {"delta_T": 70.0, "K": 0.0, "T_1": 440.0, "Omega": 0.6}
    asked = NextExperiment(point, "at twice the load a crack grows and a spall does not")
    plain = Report("rig", verdict or nothing, [(Locus(), 1.0)], gap, [], asked)
    return replace(plain, **more)


def practised(seed: int, effect: str, runs: int = 5) -> GearMachine:
    """Some runs of a practice rig of which three rotations are recorded, d = 10."""
    made = as_prepared(make_campaign(draw_plan(seed, effect, d=10.0, channels="few")))
    return GearMachine(GearObservations(made.of_role("fit")[:runs]))


def no_effect(machine: GearMachine) -> Score:
    """Nothing wrong at all, one square left."""
    n = len(machine.base)
    none = np.zeros((0, 0))
    return Score(machine.base, np.zeros(n), none, none, none, 1.0, 0.0, 1.0, {})


def column_of(
    trajectory: Trajectory, gear: GearObservations, shot: WindowSolution, name: str
) -> np.ndarray:
    """Response (rows,) of windows to a function, at states that are kept."""
    trajectory.block(shot, lambda m: LawChange(), gear.law_functions, (name,))
    solution, now, m = trajectory.last_linearisation
    made = window_columns(trajectory.windows, solution, m, now, gear.law_functions, (name,))
    return made[:, 0]


def check_report(data: Mapping[str, Any]) -> list[str]:
    """Texts of the rules of the schema that a report violates; empty if it is valid."""
    missing = [f"{key} is missing" for key in REPORT_KEYS if key not in data]
    if missing:
        return missing
    ids = {*known_effects(), "none", "unknown"}
    causes = data["causes"]
    chances = [cause["probability"] for cause in causes]
    rules = {
        f"schema must be {SCHEMA}": data["schema"] == SCHEMA,
        "verdict must be an effect, none, unknown or ambiguous": data["verdict"]
        in {*ids, "ambiguous"},
        "effects are at most two of the catalogue": len(data["effects"]) <= 2
        and set(data["effects"]) <= ids - {"none", "unknown"},
        "none has no effects": data["verdict"] != "none" or not data["effects"],
        "causes must hold every effect, none and unknown once": sorted(ids)
        == sorted(cause["effect"] for cause in causes),
        "probabilities must fall and sum to 1": chances == sorted(chances, reverse=True)
        and math.isclose(sum(chances), 1.0, abs_tol=1e-6),
        "ambiguous names two to four": len(data["ambiguous_with"])
        in ((2, 3, 4) if data["verdict"] == "ambiguous" else (0,)),
        "the verdict follows the probabilities": data["verdict"]
        in (causes[0]["effect"], "ambiguous"),
        f"metric must be one of {METRICS}": data["gap"]["metric"] in METRICS,
        "a gap has nominal, augmented, noise_floor, closure, runs": {
            "nominal",
            "augmented",
            "noise_floor",
            "closure",
            "runs",
        }
        <= set(data["gap"]),
    }
    return [rule for rule, holds in rules.items() if not holds] + senses_errors(data["gap"])


def senses_errors(gap: Mapping[str, Any]) -> list[str]:
    """Return violations of the report's format in ``senses`` of a gap; empty if there are none."""
    senses = gap.get("senses")
    if senses is None:
        return []
    errors = [f"senses lacks {name}" for name in SENSES if name not in senses]
    runs = [run["path"] for run in gap["runs"]]
    for name, sense in senses.items():
        missing = {*NUMBERS, "metric", "unit", "runner_up", "runs"} - set(sense)
        if missing:
            errors.append(f"{name} lacks {', '.join(sorted(missing))}")
        elif [run["path"] for run in sense["runs"]] != runs:
            errors.append(f"{name} must have the same runs as the gap")
    if "residual" in senses and any(senses["residual"].get(k) != gap[k] for k in NUMBERS):
        errors.append("the residual among the senses must be the gap itself")
    return errors
