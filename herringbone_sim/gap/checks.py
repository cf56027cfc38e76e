"""What is wrong with a campaign, by name, channel and time, and what can still be said of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.mesh import backlash
from herringbone_sim.gap.geometry import bodies_to_coordinates, coordinates_to_meshes
from herringbone_sim.gap.prepared import Measured, PreparedCampaign, PreparedRun
from herringbone_sim.gap.screen import Finding

Array = NDArray[np.float64]

UNIT_STEPS = {3: "thousand", -3: "thousandth", 6: "million", -6: "millionth"}
SPEED_TOLERANCE = 2e-3
TORQUE_TOLERANCE = 0.5


def check(campaign: PreparedCampaign) -> tuple[PreparedCampaign, tuple[Finding, ...]]:
    """Everything odd about a campaign, and the campaign without what can't be used.

    Channels in a wrong unit are left out of their run, runs of another gear out of the campaign.
    Sensor errors proper (``sensors``) come after.
    """
    findings = [*_missing(campaign)]
    kept = []
    ratios = [_speed_ratio(run) for run in campaign.runs]
    common = float(np.median(ratios))
    for run, ratio in zip(campaign.runs, ratios, strict=True):
        other = _other_gear(run, ratio, common)
        findings += [*run.findings, *([other] if other else []), *_point(run)]
        if other is None:
            run, units = _units(run)
            findings += units
            kept.append(run)
    findings += _campaign(replace(campaign, runs=tuple(kept)), common)
    return replace(campaign, runs=tuple(kept)), tuple(findings)


def _missing(campaign: PreparedCampaign) -> list[Finding]:
    return [
        Finding("missing", name, (), None, f"{name} is not used: {reason}", fatal=True)
        for name, reason in campaign.missing
    ]


def _speed_ratio(run: PreparedRun) -> float:
    p, s = run.model.parameters, run.model.scales
    return run.omega_rad_per_s / (p.Omega * s.omega_n)


def _other_gear(run: PreparedRun, ratio: float, common: float) -> Finding | None:
    if abs(ratio / common - 1.0) < SPEED_TOLERANCE:
        return None
    text = (
        f"the mesh of {run.name} turns at {run.omega_rad_per_s:.6g} rad/s, {ratio:.4f} of the "
        f"nominal Omega omega_n, the other runs at {common:.4f} of it: a run of another gear, or "
        "another Omega than campaign.yaml has; it is left out"
    )
    return Finding("other_gear", run.name, ("phase",), None, text, fatal=True)


def _point(run: PreparedRun) -> list[Finding]:
    """The operating point of campaign.yaml against the recorded one."""
    found = []
    for name, values in run.recorded_point.items():
        told = run.point[name]
        away = np.abs(values - told) > 1e-3 * max(abs(told), 1.0)
        if away.any():
            at = int(away.argmax())
            text = (
                f"{name} of {run.name} is {values[at]:.6g} at {run.times[at]:.6g} s, "
                f"campaign.yaml has {told:.6g}: that of campaign.yaml is used; mend the wrong one"
            )
            found.append(Finding("point", run.name, (name,), float(run.times[at]), text))
    if run.F.complete:
        found += _torque(run)
    return found


def _torque(run: PreparedRun) -> list[Finding]:
    p, s = run.model.parameters, run.model.scales
    half = run.F.there.size // 2
    expected = p.T_1 / (2.0 * s.r_bs * s.cos_beta * p.n_planets)
    mean = float(run.F.values[:, :half].mean())
    spread = float(run.F.values[:, :half].std()) / np.sqrt(run.times[-1] / run.cycle_s)
    if abs(mean - expected) < TORQUE_TOLERANCE * abs(expected) + spread:
        return []
    text = (
        f"the sun meshes of {run.name} carry {mean:.5g} N in the mean, T_1 = {p.T_1:g} N m asks "
        f"for {expected:.5g} N: another torque, another gear, or forces in another unit"
    )
    return [Finding("torque", run.name, (), None, text)]


def _units(run: PreparedRun) -> tuple[PreparedRun, list[Finding]]:
    """Quantities that are a thousand times off, by the others; the channels are left out."""
    D, B = coordinates_to_meshes(run.model.layout), bodies_to_coordinates(run.model)
    names = run.model.layout.meshes
    x, v = run.x.values.std(axis=0), run.v.values.std(axis=0) / run.omega_rad_per_s
    sizes = {"x": x, "v": v}
    if run.u.complete:
        sizes["u"] = (run.u.values @ (D @ B).T - run.waves.e).std(axis=0)
    if run.F.there.any():
        nominal = run.waves.k * backlash(run.x.values, run.model.half_backlash_m)
        bent = run.F.values.std(axis=0) / np.maximum(nominal.std(axis=0), 1e-300)
        sizes["F"] = np.where(nominal.std(axis=0) > 0.0, bent, np.nan) * x
    known = np.concatenate([s[np.isfinite(s)] for s in sizes.values()])
    if known.size == 0:
        return run, []
    usual = float(np.median(known))
    found = []
    for q, size in sizes.items():
        power = np.round(np.log10(size / usual) / 3.0) * 3.0
        off = np.isfinite(power) & (power != 0.0)
        if not off.any():
            continue
        if q == "F" and np.array_equal(off, _off(sizes["x"], usual)):
            continue
        factor = UNIT_STEPS.get(int(np.median(power[off])), "power of ten")
        wrong = _channels(run, q, names, off)
        text = (
            f"{wrong[0]}{' and others' if len(wrong) > 1 else ''} of {run.name} read about a "
            f"{factor} times what the other channels say: another unit than SI; left out of this "
            "run, not rescaled"
        )
        found.append(Finding("unit", run.name, wrong, None, text))
        run = _without(run, q, np.ones_like(run.u.there) if q == "u" else off)
    return run, found


def _off(size: Array, usual: float) -> NDArray[np.bool_]:
    power = np.round(np.log10(size / usual) / 3.0)
    off: NDArray[np.bool_] = np.isfinite(power) & (power != 0.0)
    return off


def _channels(
    run: PreparedRun, q: str, names: Sequence[str], off: NDArray[np.bool_]
) -> tuple[str, ...]:
    if q == "u":
        return tuple(f"u_{b}" for b in run.model.layout.bodies)
    return tuple(f"{q}_{n}" for n, o in zip(names, off, strict=True) if o)


def _without(run: PreparedRun, q: str, off: NDArray[np.bool_]) -> PreparedRun:
    old: Measured = getattr(run, q)
    values = np.where(off, np.nan, old.values)
    fewer = Measured(values, old.there & ~off, np.where(off, np.nan, old.sigma))
    parts = {"x": run.x, "v": run.v, "F": run.F, "u": run.u, q: fewer}
    return replace(run, x=parts["x"], v=parts["v"], F=parts["F"], u=parts["u"])


def _campaign(campaign: PreparedCampaign, common: float) -> list[Finding]:
    found = []
    if abs(common - 1.0) > SPEED_TOLERANCE:
        text = (
            f"all runs turn at {common:.4f} of the nominal Omega omega_n: the nominal file is not "
            "that of this rig (k_m_sp, I_s, I_p or the teeth); name the right one"
        )
        found.append(Finding("nominal", "", (), None, text))
    fit, held_out = campaign.of_role("fit"), campaign.of_role("held_out")
    if not fit:
        text = "no run has the role fit: nothing can be learnt from this campaign"
        found.append(Finding("no_fit", "", (), None, text, fatal=True))
    if not held_out:
        text = "no run is held out: whether the gap shrinks on new data is not known"
        found.append(Finding("no_held_out", "", (), None, text, limit=True))
    if len(fit) == 1:
        text = "there is one run to fit: effects of load, heat and speed can't be told apart"
        found.append(Finding("one_run", fit[0].name, (), None, text, limit=True))
    return found + _scope(fit)


def _scope(runs: Sequence[PreparedRun]) -> list[Finding]:
    """What can't be decided with the quantities that are there."""
    limits = []
    if runs and not all(run.F.complete for run in runs):
        limits.append(
            "mesh forces are not all there: law and balance show only together, by accelerations; "
            "errors of force sensors can't be seen, nor a single mesh on its own"
        )
    if runs and not all(run.v.complete for run in runs):
        limits.append("rates are not all there: damping rests on differences of displacements")
    if runs and not all(run.x.there.any() and run.u.there.any() for run in runs):
        limits.append("x and u don't check each other: sensor errors can't be told from motion")
    return [Finding("scope", "", (), None, text, limit=True) for text in limits]
