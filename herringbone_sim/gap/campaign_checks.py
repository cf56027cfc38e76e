"""Check a campaign: find problems of the data by run, channel and time, and limits on results."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.layout import QUANTITIES
from herringbone_sim.core.model import mean_sun_force
from herringbone_sim.gap.data.prepared import PreparedCampaign, PreparedRun, deciding
from herringbone_sim.gap.data.screen import Finding
from herringbone_sim.gap.data.units import clock_unit, wrong_units
from herringbone_sim.gap.residuals.foreign_runs import (
    mesh_speed_mismatch,
    most_common_ratio,
    nominal_mismatch,
    runs_with_other_force_law,
    runs_with_other_geometry,
    speed_ratio,
    unexplained_force_shares,
)
from herringbone_sim.gap.residuals.fusion import Fused, fuse
from herringbone_sim.gap.result_limits import limit_findings
from herringbone_sim.gap.sensors.detrended import settle_detrended
from herringbone_sim.gap.sensors.noise import without_wrong_noise

FEWEST_CYCLES = 8.0  # shortest usable run in mesh cycles
SHORT = 0.5  # fraction of the median number of mesh cycles below which a run is reported
TORQUE_TOLERANCE = 0.7  # relative, of the mean sun force against the input torque
# Classes of a run's channels: force and motion of a mesh, motion of all meshes, fewer.
FORCED, MOVING, FEW = 2, 1, 0


def check(campaign: PreparedCampaign) -> tuple[PreparedCampaign, tuple[Finding, ...]]:
    """Check a campaign, and remove runs and channels that can't be used.

    Removed are, among others, channels in a wrong unit, runs that are too short or copies, and
    runs of another gear. Sensor errors are not sought here, see ``sensors``. Rotations that lack
    their mean get that of the nominal gear, or are removed (``settle_detrended``).

    Returns:
        The campaign without unusable runs and channels, and all findings.
    """
    findings = [*_unreadable_runs(campaign), *(f for run in campaign.runs for f in run.findings)]
    runs = _without_fatal(campaign.runs, _copies(campaign.runs), findings)
    runs, common = _same_speed(runs, findings)
    runs = _without_fatal(runs, _short_runs(runs), findings)
    in_si = []
    for run in runs:
        findings += _other_operating_point(run)
        run, units = wrong_units(run)
        findings += [*units, *_wrong_torque(run)]
        in_si.append(run)
    settled = settle_detrended(in_si)
    findings += [f for pair in zip(in_si, settled, strict=True) for f in _lost_rotations(*pair)]
    in_si = settled
    runs = _without_fatal(in_si, runs_with_other_geometry(in_si), findings)
    campaign, noise_ratio = without_wrong_noise(replace(campaign, runs=tuple(runs)))
    runs = list(campaign.runs)
    fused = {run.name: fuse(run) for run in runs}
    shares = {r.name: _finite_shares(r, fused[r.name]) for r in runs if r.F.recorded.any()}
    shares = {name: share for name, share in shares.items() if share.size}
    forced = [r for r in runs if r.name in shares]
    runs = _without_fatal(runs, runs_with_other_force_law(forced, shares), findings)
    nominal = nominal_mismatch(
        common, [shares[r.name] for r in deciding(runs) if r.name in shares]
    )
    findings += [nominal] if nominal else []
    runs = _same_channel_class(runs, fused, findings)
    campaign = replace(campaign, runs=tuple(runs))
    return campaign, (*findings, *limit_findings(campaign, noise_ratio))


def _unreadable_runs(campaign: PreparedCampaign) -> list[Finding]:
    """Return a fatal finding for each run that could not be read."""
    return [
        Finding("missing", name, (), None, f"{name} is not used: {reason}", fatal=True)
        for name, reason in campaign.missing
    ]


def _without_fatal(
    runs: Sequence[PreparedRun], new: Sequence[Finding], findings: list[Finding]
) -> list[PreparedRun]:
    """Append ``new`` to ``findings``; return the runs without a fatal finding among ``new``."""
    findings += new
    out = {finding.run for finding in new if finding.fatal}
    return [run for run in runs if run.name not in out]


def _same_speed(
    runs: Sequence[PreparedRun], findings: list[Finding]
) -> tuple[list[PreparedRun], float]:
    """Runs with the most common ratio of mesh frequency to the nominal one, and that ratio.

    Findings on the other runs, and on time or phase in another unit than SI, are appended to
    ``findings``. Without runs the ratio is 1.
    """
    ratios = {run.name: speed_ratio(run) for run in runs}
    units = [clock_unit(run, ratios[run.name]) for run in runs]
    runs = _without_fatal(runs, [unit for unit in units if unit], findings)
    if not runs:
        return [], 1.0
    common = most_common_ratio([ratios[run.name] for run in deciding(runs)])
    others = [mesh_speed_mismatch(run, ratios[run.name], common) for run in runs]
    return _without_fatal(runs, [other for other in others if other], findings), common


def _short_runs(runs: Sequence[PreparedRun]) -> list[Finding]:
    """Findings for runs that are too short (fatal), or much shorter than the median run."""
    cycles = [run.cycles for run in runs]
    findings = []
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
        findings.append(Finding("short", run.name, ("t",), end, text, fatal=out))
    return findings


def _copies(runs: Sequence[PreparedRun]) -> list[Finding]:
    """Return a fatal finding for each run with the same samples as an earlier run."""
    findings = []
    for earlier, later in combinations(runs, 2):
        same = len(earlier) == len(later) and all(
            np.array_equal(getattr(earlier, q).values, getattr(later, q).values, equal_nan=True)
            for q in QUANTITIES
        )
        if same:
            text = f"{later.name} holds the same samples as {earlier.name}: it is left out"
            findings.append(
                Finding("copy", later.name, (), float(later.times[0]), text, fatal=True)
            )
    return findings


def _other_operating_point(run: PreparedRun) -> list[Finding]:
    """Findings for recorded quantities of the operating point that contradict campaign.yaml."""
    findings = []
    for name, values in run.recorded_point.items():
        stated = run.point[name]
        away = np.isfinite(values) & ~(np.abs(values - stated) <= 1e-3 * max(abs(stated), 1.0))
        if away.any():
            at = int(away.argmax())
            text = (
                f"{name} of {run.name} is {values[at]:.6g} at {run.times[at]:.6g} s, "
                f"campaign.yaml has {stated:.6g}: that of campaign.yaml is used; correct the "
                "wrong one"
            )
            findings.append(Finding("point", run.name, (name,), float(run.times[at]), text))
    return findings


def _wrong_torque(run: PreparedRun) -> list[Finding]:
    """A finding, if forces of all sun meshes are recorded and don't balance the input torque."""
    half = run.F.recorded.size // 2
    if not run.F.recorded[:half].all():
        return []
    expected = mean_sun_force(run.model)
    sun = run.F.values[:, :half]
    # The median is robust to one wrong sensor, the mean to a displaced planet.
    of_meshes = np.nanmean(sun, axis=0)  # gauges may have gaps
    both = (float(np.median(of_meshes)), float(of_meshes.mean()))
    mean = min(both, key=lambda value: abs(value - expected))
    spread = float(np.nanstd(sun)) / np.sqrt(max(len(run) * run.step_s / run.cycle_s, 1.0))
    if abs(mean - expected) < TORQUE_TOLERANCE * abs(expected) + spread:
        return []
    text = (
        f"the sun meshes of {run.name} carry {mean:.5g} N in the mean, "
        f"T_1 = {run.model.parameters.T_1:g} N m asks for {expected:.5g} N: another "
        "torque or unit of T_1, another gear, or forces with an offset or in another unit"
    )
    channels = ("T_1", *run.model.layout.channels_of("F")[:half])
    return [Finding("torque", run.name, channels, float(run.times[0]), text)]


def _lost_rotations(before: PreparedRun, after: PreparedRun) -> list[Finding]:
    """A finding, if rotations without their mean were marked as not recorded."""
    lost = before.u.recorded & ~after.u.recorded
    if not lost.any():
        return []
    names = before.model.layout.channels_of("u")
    names = tuple(n for n, off in zip(names, lost, strict=True) if off)
    text = (
        f"rotations of {before.name} lack their mean, as those of encoders that count from any "
        "mark: beside the other channels of the campaign they are not used"
    )
    return [Finding("no_mean", before.name, names, float(before.times[0]), text)]


def _finite_shares(run: PreparedRun, fused: Fused) -> Array:
    """``unexplained_force_shares`` of the meshes where they are finite."""
    share = unexplained_force_shares(run, fused)
    return share[np.isfinite(share)]


def _same_channel_class(
    runs: Sequence[PreparedRun], fused: dict[str, Fused], findings: list[Finding]
) -> list[PreparedRun]:
    """Restrict the fit runs to the highest class of channels that at least half of them reach.

    All fit runs must allow the same observations: fit runs of a lower class are left out, and
    forces that most fit runs lack are not used. Classes are ``FORCED``, ``MOVING`` and ``FEW``,
    see ``_channel_class``.

    Args:
        runs: of both roles; held-out runs stay as they are.
        fused: by name of the run, at least for the fit runs; not changed.
        findings: findings on runs left out (fatal) and on forces not used are appended.

    Returns:
        All remaining runs, in the order of ``runs``; those whose forces are not used are copies.
    """
    fit = [run for run in runs if run.role == "fit"]
    levels = {run.name: _channel_class(run, fused[run.name]) for run in fit}
    if len(set(levels.values())) < 2:
        return list(runs)
    level = next(
        level
        for level in (FORCED, MOVING, FEW)
        if 2 * sum(own >= level for own in levels.values()) >= len(fit)
    )
    words = {FORCED: "forces with the motion of their meshes", MOVING: "the motion of all meshes"}
    new, restricted = [], []
    for run in runs:
        if run.role == "fit" and levels[run.name] < level:
            text = f"{run.name} lacks {words[level]}, which most runs have: it is left out"
            new.append(Finding("channels", run.name, (), None, text, fatal=True))
        elif run.role == "fit" and levels[run.name] == FORCED > level:
            names = run.model.layout.channels_of("F")
            text = f"most runs lack forces: those of {run.name} are not used"
            new.append(Finding("channels", run.name, names, None, text))
            run = run.without("F", np.ones_like(run.F.recorded))
        restricted.append(run)
    return _without_fatal(restricted, new, findings)


def _channel_class(run: PreparedRun, fused: Fused) -> int:
    """Class of the channels of a run: ``FORCED``, ``MOVING`` or ``FEW``."""
    if (fused.known_meshes & run.F.recorded).any():
        return FORCED
    return MOVING if fused.known_meshes.all() else FEW
