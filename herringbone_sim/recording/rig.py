"""Simulate a rig: a campaign of recordings of a gear within its tolerances, with or without
effects.

``campaign.read_campaign`` reads the campaign; the true effects are in a separate file, the label.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator

from herringbone_sim.arrays import rms
from herringbone_sim.core.layout import HEAD, describe
from herringbone_sim.core.model import Model, build, errors_at
from herringbone_sim.core.parameters import Parameters, spread
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.effects.channels import distort
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.stepper import simulate
from herringbone_sim.effects.written import parameter_values
from herringbone_sim.errors import RecordingError
from herringbone_sim.recording.campaign import write_campaign
from herringbone_sim.recording.writer import RunWriter, split_rows

SCHEMA = "rig/label/1"
FULL_SCALE = 2.0  # full scale of the converter over the largest absolute value of a channel

# Ranges of delta_T [K], K, T_1 [N m] and Omega; run i uses row i % 8. Periodic and chaotic motion.
POINTS = (
    ((75.0, 95.0), (0.0, 0.0), (205.0, 320.0), (0.93, 1.05)),
    ((15.0, 45.0), (0.0, 0.0), (220.0, 480.0), (0.91, 1.12)),
    ((20.0, 80.0), (0.0, 0.0), (1650.0, 2150.0), (0.33, 0.36)),
    ((40.0, 70.0), (0.2, 0.35), (300.0, 900.0), (0.65, 0.85)),
    ((15.0, 80.0), (0.05, 0.15), (930.0, 1650.0), (1.05, 1.3)),
    ((45.0, 80.0), (0.0, 0.0), (315.0, 800.0), (0.75, 0.95)),
    ((10.0, 40.0), (0.05, 0.3), (970.0, 1800.0), (0.5, 0.75)),
    ((60.0, 90.0), (0.1, 0.35), (300.0, 1280.0), (1.0, 1.2)),
)


@dataclass(frozen=True)
class RigPlan:
    """Settings of a simulated campaign.

    Attributes:
        nominal: parameters of the gear by its data sheet, full model.
        actives: effects of the rig, beside its tolerances.
        runs, held_out: number of runs, of which the last ``held_out`` are held-out runs.
        cycles, transient: mesh cycles recorded, and mesh cycles simulated before them.
        noise_share: RMS of the noise over the RMS of each channel.
        bits: resolution of the analogue-to-digital converter; 0: no rounding.
        tolerance: largest relative deviation of a parameter from the data sheet.
        seed: seed of tolerances, operating points, initial states and noise.
        later: 0, or 1, 2, ... for further campaigns of the same rig with other operating points,
            initial states and noise.
        channels: mesh and body channels that are recorded; empty: all.

    Raises:
        RecordingError: ``later`` is negative, a channel is unknown, or no run is left to fit.
    """

    nominal: Parameters
    actives: tuple[Active, ...] = ()
    runs: int = 8
    held_out: int = 3
    cycles: int = 120
    transient: int = 60
    noise_share: float = 0.01
    bits: int = 16
    tolerance: float = 0.02
    seed: int = 0
    later: int = 0
    channels: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.later < 0:
            raise RecordingError(
                f"later numbers the days after the first one, from 1 on, got {self.later}"
            )
        foreign = [n for n in self.channels if n not in self.nominal.layout.channels]
        if foreign:
            raise RecordingError(
                f"channels to record are some of {', '.join(self.nominal.layout.channels[5:8])} "
                f"... {self.nominal.layout.channels[-1]}, got {foreign[0]!r}"
            )
        if not 0 <= self.held_out < self.runs:
            raise RecordingError(
                f"a campaign needs runs to fit: held_out below runs, got {self.held_out} of "
                f"{self.runs}: keep fewer out"
            )


def make_campaign(folder: Path, plan: RigPlan, name: str) -> dict[str, Any]:
    """Simulate a campaign; write its runs and ``campaign.yaml``.

    Args:
        folder: folder of the campaign.
        plan: settings of the campaign.
        name: name of the rig.

    Returns:
        Label with the true effects and parameters, for ``write_label``.

    Raises:
        RecordingError: a run exists, or can't be written.
        DivergenceError: the state left the range of any physical motion.
    """
    rng = np.random.default_rng([plan.seed, 2])
    own, factors = within_tolerance(plan.nominal, plan.tolerance, rng)
    if plan.later:
        rng = np.random.default_rng([plan.seed, 2, plan.later])
    points = [_point(i, rng) for i in range(plan.runs)]
    entries = []
    for i, point in enumerate(points):
        role = "held_out" if i >= plan.runs - plan.held_out else "fit"
        series = make_run(plan, own, point, rng)
        _write(folder, f"run_{i:02d}", series, name)
        entries.append({"path": f"run_{i:02d}", **point, "role": role})
    noise = {"kind": "white", "rms_share": plan.noise_share}
    write_campaign(folder, name, entries, noise)
    return _label(plan, factors, entries)


def within_tolerance(
    nominal: Parameters, tolerance: float, rng: Generator
) -> tuple[Parameters, dict[str, float]]:
    """Draw the parameters of a built gear within ``tolerance`` of its data sheet.

    Stiffness and error of sun and ring meshes (separately), inertias, planet mass and damping
    ratio are multiplied by factors within 1 - tolerance .. 1 + tolerance. The natural frequency
    that Omega and K refer to stays that of the data sheet.

    Returns:
        Parameters of the built gear, and name -> factor.
    """
    names = ("k_m_sp", "k_m_rp", "I_s", "I_p", "I_c", "m_p", "I_r", "xi", "e_sp", "e_rp")
    factors = {name: float(rng.uniform(1.0 - tolerance, 1.0 + tolerance)) for name in names}
    n = nominal.layout.n_mesh
    e = np.array(spread(nominal.e_factor, n)) * np.repeat(
        [factors["e_sp"], factors["e_rp"]], n // 2
    )
    changed: dict[str, Any] = {
        parameter: getattr(nominal, parameter) * factors[parameter]
        for parameter in names
        if not parameter.startswith("e_")
    }
    changed |= {"e_factor": e.tolist(), "omega_n": build(nominal).scales.omega_n}
    return nominal.changed(changed), factors


def make_run(
    plan: RigPlan, built_gear: Parameters, point: dict[str, float], rng: Generator
) -> TimeSeries:
    """Simulate a run; return its samples as sensors and converter of the rig record them.

    x and v are computed from encoder readings with the nominal mesh error e(t), and the control
    torque with the nominal inertia of the carrier.

    Args:
        plan: settings of the campaign.
        built_gear: its parameters.
        point: operating point delta_T [K], K, T_1 [N m], Omega.
        rng: source of initial state and noise.

    Raises:
        DivergenceError: the state left the range of any physical motion.
    """
    nominal = build(plan.nominal.changed(point))
    ratio = nominal.scales.M_c / build(built_gear).scales.M_c
    start = {"initial_noise": 0.05, "seed": int(rng.integers(2**31 - 1))}
    model = build(built_gear.changed({**point, **start, "K": point["K"] * ratio}))
    of_gear = [
        active_effect for active_effect in plan.actives if active_effect.effect.level != "sensor"
    ]
    _, settled = simulate(model, of_gear, plan.transient)
    series, _ = simulate(model, of_gear, plan.cycles, settled)
    shown = _as_encoders(series, model, nominal, point["K"])
    seen = _digitised(distort(shown, plan.actives), plan, rng)
    names = tuple(n for n in seen.names if n in HEAD or not plan.channels or n in plan.channels)
    return TimeSeries(seen.times, seen.columns(names), names)


def _as_encoders(series: TimeSeries, own: Model, nominal: Model, K: float) -> TimeSeries:
    """Return samples with the nominal mesh error in x and v, the nominal K, and time from 0."""
    data, names = series.data.copy(), series.names
    s, n = own.scales, own.layout.n_mesh
    for row in data:
        e, rate = errors_at(own, row[1])
        known, known_rate = errors_at(nominal, row[1])
        row[5 : 5 + n] += (e - known) * s.b_c
        row[5 + n : 5 + 2 * n] += (rate - known_rate) * s.velocity_m_per_s
    data[:, names.index("t")] -= series.times[0]
    data[:, names.index("K")] = K
    return TimeSeries(data[:, 0].copy(), data, names)


def _digitised(series: TimeSeries, plan: RigPlan, rng: Generator) -> TimeSeries:
    """Add white noise to all channels except ``HEAD``, and round to the steps of the converter."""
    data = series.data.copy()
    for j, name in enumerate(series.names):
        if name not in HEAD:
            clean = data[:, j].copy()
            data[:, j] += plan.noise_share * rms(clean) * rng.normal(size=len(clean))
            if plan.bits:
                step = 2.0 * FULL_SCALE * np.abs(clean).max() / 2.0**plan.bits
                data[:, j] = np.round(data[:, j] / step) * step if step > 0.0 else data[:, j]
    return TimeSeries(series.times, data, series.names)


def _point(i: int, rng: Generator) -> dict[str, float]:
    """Draw the operating point of run i from its ranges in ``POINTS``."""
    hot, control, torque, speed = (rng.uniform(*bounds) for bounds in POINTS[i % len(POINTS)])
    return {
        "delta_T": round(float(hot), 1),
        "K": round(float(control), 2),
        "T_1": float(round(float(torque))),
        "Omega": round(float(speed), 3),
    }


def _write(folder: Path, name: str, series: TimeSeries, rig: str) -> None:
    """Write a run as the bag ``name`` in a folder."""
    channels = {"channels": [describe(channel) for channel in series.names], "source": rig}
    writer = RunWriter.create(folder, name, f"/{rig}", channels, series.names, 0)
    for rows in split_rows(len(series), series.names):
        writer.write_samples(series.data[rows])
        writer.flush()  # an interruption then leaves all rows before it
    writer.close()


def _label(
    plan: RigPlan, factors: dict[str, float], entries: Sequence[dict[str, Any]]
) -> dict[str, Any]:
    """Return the label of a campaign: seed, noise, true effects, factors and operating points.

    Args:
        plan: settings of the campaign, with the true effects.
        factors: parameter -> built over nominal value, from ``within_tolerance``.
        entries: path, operating point and role of each run.
    """
    return {
        "schema": SCHEMA,
        "seed": plan.seed,
        "later": plan.later,
        "truth": sorted({active_effect.effect.id for active_effect in plan.actives}) or ["none"],
        "effects": [
            {
                "effect": active_effect.effect.id,
                "locus": vars(active_effect.locus).copy(),
                "parameters": _with_units(active_effect),
            }
            for active_effect in plan.actives
        ],
        "noise_share": plan.noise_share,
        "tolerance": factors,
        "operating_points": list(entries),
    }


def _with_units(active_effect: Active) -> dict[str, Any]:
    units = {p.name: p.unit for p in active_effect.effect.parameters}
    values = parameter_values(active_effect)
    return {name: {"value": v, "unit": units.get(name, "-")} for name, v in values.items()}


def write_label(folder: Path, name: str, label: dict[str, Any]) -> str:
    """Write ``NAME.json`` to a folder of labels; return its SHA-256, to prove it unchanged.

    Raises:
        RecordingError: the label exists, or the folder can't be written.
    """
    text = json.dumps(label, indent=1, allow_nan=False) + "\n"
    file = folder / f"{name}.json"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with file.open("x", encoding="utf-8") as out:
            out.write(text)
    except OSError as error:
        raise RecordingError(
            f"can't write the label {file} ({error.strerror}): choose another --labels or --out"
        ) from None
    return hashlib.sha256(text.encode()).hexdigest()
