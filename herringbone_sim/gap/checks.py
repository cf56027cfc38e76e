"""What is wrong with a campaign, by name, channel and time, and what can still be said of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.gap.data.prepared import PreparedCampaign, PreparedRun
from herringbone_sim.gap.data.screen import Finding
from herringbone_sim.gap.data.units import clock_unit, mark_not_recorded, wrong_units
from herringbone_sim.gap.residuals.fusion import Fused, fuse
from herringbone_sim.gap.residuals.misfit import (
    mesh_speed_mismatch,
    most_common_ratio,
    nominal_mismatch,
    runs_with_other_force_law,
    runs_with_other_geometry,
    speed_ratio,
    unexplained_force_shares,
)

Array = NDArray[np.float64]

FEWEST_CYCLES = 8.0
SHORT = 0.5  # of the usual number of mesh cycles
TORQUE_TOLERANCE = 0.7
FORCED, MOVING, FEW = 2, 1, 0  # what a run can tell: forces on some mesh, all motions, less


def check(campaign: PreparedCampaign) -> tuple[PreparedCampaign, tuple[Finding, ...]]:
    """Everything odd about a campaign, and the campaign without what can't be used.

    Channels in a wrong unit are left out of their run, runs of another gear out of the campaign.
    Sensor errors proper (``sensors``) come after.
    """
    findings = [*_missing(campaign), *(f for run in campaign.runs for f in run.findings)]
    runs = _kept(campaign.runs, _copies(campaign.runs), findings)
    runs, common = _same_clock(runs, findings)
    runs = _kept(runs, _too_short(runs), findings)
    sound = []
    for run in runs:
        findings += _point(run)
        run, units = wrong_units(run)
        findings += [*units, *_torque(run)]
        sound.append(run)
    runs = _kept(sound, runs_with_other_geometry(sound), findings)
    fused = {run.name: fuse(run) for run in runs}
    shares = {r.name: _known_shares(r, fused[r.name]) for r in runs if r.F.there.any()}
    shares = {name: share for name, share in shares.items() if share.size}
    runs = _kept(
        runs, runs_with_other_force_law([r for r in runs if r.name in shares], shares), findings
    )
    nominal = nominal_mismatch(common, [shares[r.name] for r in runs if r.name in shares])
    findings += [nominal] if nominal else []
    runs = _alike(runs, fused, findings)
    campaign = replace(campaign, runs=tuple(runs))
    return campaign, (*findings, *_campaign(campaign))


def _missing(campaign: PreparedCampaign) -> list[Finding]:
    return [
        Finding("missing", name, (), None, f"{name} is not used: {reason}", fatal=True)
        for name, reason in campaign.missing
    ]


def _kept(
    runs: Sequence[PreparedRun], found: Sequence[Finding], findings: list[Finding]
) -> list[PreparedRun]:
    """Runs that no finding rules out; the findings are noted."""
    findings += found
    out = {finding.run for finding in found if finding.fatal}
    return [run for run in runs if run.name not in out]


def _same_clock(
    runs: Sequence[PreparedRun], findings: list[Finding]
) -> tuple[list[PreparedRun], float]:
    """Runs with the mesh frequency of most, and what that is of the nominal one."""
    ratios = {run.name: speed_ratio(run) for run in runs}
    units = [clock_unit(run, ratios[run.name]) for run in runs]
    runs = _kept(runs, [unit for unit in units if unit], findings)
    if not runs:
        return [], 1.0
    common = most_common_ratio([ratios[run.name] for run in runs])
    others = [mesh_speed_mismatch(run, ratios[run.name], common) for run in runs]
    return _kept(runs, [other for other in others if other], findings), common


def _too_short(runs: Sequence[PreparedRun]) -> list[Finding]:
    cycles = [float((run.phase[-1] - run.phase[0]) / (2.0 * np.pi)) for run in runs]
    found = []
    for run, own in zip(runs, cycles, strict=True):
        usual, out = float(np.median(cycles)), own < FEWEST_CYCLES
        if not out and own >= SHORT * usual:
            continue
        end = float(run.times[-1])
        text = f"{run.name} ends at {end:.6g} s after {own:.1f} mesh cycles" + (
            f", {FEWEST_CYCLES:g} are needed: it is left out"
            if out
            else f", the usual run has {usual:.1f}: it is used as far as it goes"
        )
        found.append(Finding("short", run.name, ("t",), end, text, fatal=out))
    return found


def _copies(runs: Sequence[PreparedRun]) -> list[Finding]:
    found = []
    for one, other in combinations(runs, 2):
        same = len(one) == len(other) and all(
            np.array_equal(getattr(one, q).values, getattr(other, q).values, equal_nan=True)
            for q in ("x", "v", "F", "u", "a", "pin")
        )
        if same:
            text = f"{other.name} holds the same samples as {one.name}: it is left out"
            found.append(Finding("copy", other.name, (), float(other.times[0]), text, fatal=True))
    return found


def _point(run: PreparedRun) -> list[Finding]:
    """The operating point of campaign.yaml against the recorded one."""
    found = []
    for name, values in run.recorded_point.items():
        told = run.point[name]
        away = ~(np.abs(values - told) <= 1e-3 * max(abs(told), 1.0))
        if away.any():
            at = int(away.argmax())
            text = (
                f"{name} of {run.name} is {values[at]:.6g} at {run.times[at]:.6g} s, "
                f"campaign.yaml has {told:.6g}: that of campaign.yaml is used; mend the wrong one"
            )
            found.append(Finding("point", run.name, (name,), float(run.times[at]), text))
    return found


def _torque(run: PreparedRun) -> list[Finding]:
    p, s = run.model.parameters, run.model.scales
    half = run.F.there.size // 2
    if not run.F.there[:half].all():
        return []
    expected = p.T_1 / (2.0 * s.r_bs * s.cos_beta * p.n_planets)
    sun = run.F.values[:, :half]
    # One wrong sensor leaves the median of the meshes right, a planet off its place their mean.
    of_meshes = sun.mean(axis=0)
    both = (float(np.median(of_meshes)), float(of_meshes.mean()))
    mean = min(both, key=lambda value: abs(value - expected))
    spread = float(sun.std()) / np.sqrt(max(len(run) * run.step_s / run.cycle_s, 1.0))
    if abs(mean - expected) < TORQUE_TOLERANCE * abs(expected) + spread:
        return []
    text = (
        f"the sun meshes of {run.name} carry {mean:.5g} N in the mean, T_1 = {p.T_1:g} N m asks "
        f"for {expected:.5g} N: another torque or unit of T_1, another gear, or forces with an "
        "offset or in another unit"
    )
    channels = ("T_1", *(f"F_{mesh}" for mesh in run.model.layout.meshes[:half]))
    return [Finding("torque", run.name, channels, float(run.times[0]), text)]


def _known_shares(run: PreparedRun, fused: Fused) -> Array:
    share = unexplained_force_shares(run, fused)
    return share[np.isfinite(share)]


def _alike(
    runs: Sequence[PreparedRun], fused: dict[str, Fused], findings: list[Finding]
) -> list[PreparedRun]:
    """Fit runs that tell as much as most of them do; the evidence is of one kind only."""
    fit = [run for run in runs if run.role == "fit"]
    tells = {run.name: _tells(run, fused[run.name]) for run in fit}
    if len(set(tells.values())) < 2:
        return list(runs)
    level = next(
        level
        for level in (FORCED, MOVING, FEW)
        if 2 * sum(t >= level for t in tells.values()) >= len(fit)
    )
    words = {FORCED: "forces with the motion of their meshes", MOVING: "the motion of all meshes"}
    found, kept = [], []
    for run in runs:
        if run.role == "fit" and tells[run.name] < level:
            text = f"{run.name} lacks {words[level]}, which most runs have: it is left out"
            found.append(Finding("channels", run.name, (), None, text, fatal=True))
        elif run.role == "fit" and tells[run.name] == FORCED > level:
            names = tuple(f"F_{mesh}" for mesh in run.model.layout.meshes)
            text = f"most runs lack forces: those of {run.name} are not used"
            found.append(Finding("channels", run.name, names, None, text))
            run = mark_not_recorded(run, "F", np.ones_like(run.F.there))
        kept.append(run)
    return _kept(kept, found, findings)


def _tells(run: PreparedRun, fused: Fused) -> int:
    seen = np.isfinite(fused.x).all(axis=0) & np.isfinite(fused.v).all(axis=0)
    if (seen & run.F.there).any():
        return FORCED
    return MOVING if seen.all() else FEW


def _campaign(campaign: PreparedCampaign) -> list[Finding]:
    found = []
    if not campaign.noise_known:
        text = (
            "campaign.yaml tells no noise: it was taken from the spectra, from what channels say "
            "of each other and from what the force law leaves; smaller effects are not seen, and "
            "closure is as sure as that"
        )
        found.append(Finding("noise", "", (), None, text, limit=True))
    fit, held_out = campaign.of_role("fit"), campaign.of_role("held_out")
    if not fit:
        text = "no run has the role fit: nothing can be learnt from this campaign"
        found.append(Finding("no_fit", "", (), None, text, fatal=True))
    if not held_out:
        text = "no run is held out: whether the gap shrinks on new data is not known"
        found.append(Finding("no_held_out", "", (), None, text, limit=True))
    if len(fit) == 1:
        text = (
            f"{fit[0].name} is the only run to fit: thirds of it take the place of runs left out, "
            "and effects of load, heat and speed can't be told from constant ones"
        )
        found.append(Finding("one_run", fit[0].name, (), None, text, limit=True))
    return found + _scope(fit)


def _scope(runs: Sequence[PreparedRun]) -> list[Finding]:
    """What can't be decided with the quantities that are there."""
    limits = []
    forced = any(run.F.there.any() or run.pin.there.any() for run in runs)
    if runs and not forced:
        limits.append(
            "there are no mesh forces: law and balance show only together, by accelerations; "
            "errors of force sensors can't be seen, nor a single mesh on its own"
        )
    elif runs and not all(run.F.complete or run.pin.there.any() for run in runs):
        names = runs[0].model.layout.meshes
        absent = [
            n for n, *on in zip(names, *(r.F.there for r in runs), strict=True) if not all(on)
        ]
        limits.append(
            f"forces of {', '.join(absent)} are not there in every run: less can be told of these "
            "meshes"
        )
    if runs and not all(run.v.complete or not run.x.there.any() for run in runs):
        limits.append("rates are not all there: damping rests on differences of displacements")
    if runs and not any(run.x.there.any() and run.u.there.any() for run in runs):
        limits.append(
            "x and u don't check each other: an error of a motion sensor shows against the law of "
            "the gear alone"
            if all(run.shafts_known for run in runs)
            else "x and u don't check each other: sensor errors can't be told from motion"
        )
    return [Finding("scope", "", (), None, text, limit=True) for text in limits]
