"""Sensor errors by consistency alone, before any law of the gear is asked.

Each kind of error on each group of channels is tried against what the sensors say of each other
(``consistency``); the best one is fitted against the prediction of all other channels, those of
the group are dropped, and what is left is searched again. Forces are not checked here: nothing
but the law tells of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from herringbone_sim.effects.effect import Active, Locus
from herringbone_sim.effects.registry import effects as known_effects
from herringbone_sim.gap.data.geometry import bodies_to_coordinates
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.data.screen import Finding
from herringbone_sim.gap.residuals.fusion import fuse
from herringbone_sim.gap.sensors.clock import Clock, find_clock, lateness, set_right
from herringbone_sim.gap.sensors.consistency import KINDS, Consistency, channel_arrays, consistency
from herringbone_sim.gap.sensors.corrected import corrected, drop
from herringbone_sim.gap.sensors.groups import Group, groups_of
from herringbone_sim.gap.sensors.swaps import find_swap

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

UNITS = {"sensor_gain": "-", "sensor_delay": "s", "clock_drift": "ppm"}
SIGNIFICANT = 6.0  # sigma, of the best of some four hundred patterns
SHARE = 0.002  # of all squares, likewise: violent motion between samples is not followed exactly
PART = 0.1  # of the inconsistency that an error must explain: the integral of v is not exact


@dataclass(frozen=True)
class SensorFinding:
    """One sensor error.

    Attributes:
        effect: id of the catalogue: sensor_gain, sensor_bias, sensor_delay, clock_drift or
            channel_swap.
        group: channels concerned.
        value: gain error (0.01 reads 1 % high), bias [SI], delay [s], drift [ppm], 1 for a swap.
        sigma: standard deviation of the value.
        unit: of the value.
        share: part of the inconsistency above the noise that it explains.
        alike: other groups on which the same error would read the same.
    """

    effect: str
    group: Group
    value: float
    sigma: float
    unit: str
    share: float
    alike: tuple[Group, ...]

    @property
    def active(self) -> Active:
        """The effect with its size, on the channels concerned."""
        effect, group = known_effects()[self.effect], self.group
        rest = 1.0 if self.effect == "sensor_gain" else 0.0
        mesh = group.mesh if group.mesh in ("sp", "rp") else "all"
        theta = (rest + self.value,) if effect.parameters else ()
        chosen = (("channels", group.names),) if effect.options else ()
        inside = tuple(float(v) for v in np.clip(theta, *effect.bounds))
        return Active(effect, inside, Locus(mesh, group.planet, group.side), chosen)


@dataclass(frozen=True)
class SensorCheck:
    """Consistency of the sensors of some runs.

    Attributes:
        before, after: mean square of the inconsistency over its noise, 1 where all agree, with
            all channels and without those found wrong; NaN where nothing can be compared.
        corrected: the same with those channels put right by what was found: where more is left
            than without them, they err in another way.
        geometry: as ``after``, of what geometry alone says: the rest holds only as far as v is
            followed between samples.
        findings: the largest first.
    """

    before: float
    after: float
    corrected: float
    geometry: float
    findings: tuple[SensorFinding, ...]

    @property
    def wrong(self) -> tuple[str, ...]:
        """Channels found wrong; a clock is put right instead."""
        found = (f for f in self.findings if f.group.quantity != "xvu")
        return tuple(name for finding in found for name in finding.group.names)


def contradictions(check: SensorCheck) -> list[Finding]:
    """Sensors found wrong, and what was done about them."""
    found = []
    for one in check.findings:
        names = ("t",) if one.group.quantity == "xvu" else one.group.names
        size = f" of {one.value:.3g} {one.unit}".removesuffix(" -")
        kind = one.effect + ("" if one.effect == "channel_swap" else size)
        many = len(names) > 1
        does, they = ("contradict", "they are") if many else ("contradicts", "it is")
        done = "times are put right" if names == ("t",) else f"{they} left out of all runs"
        text = f"{', '.join(names)} {does} the other channels, most like {kind}: {done}"
        found.append(Finding("sensor", "", names, None, text))
    return found


def find_sensor_errors(runs: Sequence[PreparedRun], most: int = 3) -> SensorCheck:
    """The sensor errors of some runs.

    Args:
        runs: fit runs of one rig; a group of channels is judged by the runs that have all of it.
        most: errors looked for.
    """
    findings: list[SensorFinding] = []
    clock = find_clock(runs)
    early = late = 0.0
    if clock is not None:
        findings.append(_drift(runs, clock))
        early, late = lateness(runs), lateness(runs, clock.ppm)
        runs = [set_right(run, clock.ppm) for run in runs]
    first = now = consistency(runs)
    whole = runs
    while len(findings) < most and now.count > 0.0:
        finding = _largest(runs, now)
        if finding is None:
            break
        runs = [drop(run, finding.group.names) for run in runs]
        after = consistency(runs)
        excess = max(now.energy - now.count, 1.0)
        share = 1.0 - max(after.energy - after.count, 0.0) / excess
        findings.append(replace(finding, share=max(share, 0.0)))
        now = after
    right = consistency([_put_right(run, findings) for run in whole])
    sums = _with(first, early), _with(now, late), _with(right, late)
    return SensorCheck(*sums, now.chi2_of_geometry, tuple(findings))


def _put_right(run: PreparedRun, findings: Sequence[SensorFinding]) -> PreparedRun:
    """The run with what was found undone; a clock of some channels alone can only be left out."""
    for one in findings:
        if one.effect != "clock_drift":
            run = corrected(run, (one.active,))
        elif one.group.quantity != "xvu":
            run = drop(run, one.group.names)
    return run


def _drift(runs: Sequence[PreparedRun], clock: Clock) -> SensorFinding:
    """A drift of all channels alike."""
    every = next(g for g in groups_of(runs[0].model.layout) if g.quantity == "xvu")
    return SensorFinding("clock_drift", every, clock.ppm, clock.sigma, "ppm", 1.0, ())


def _with(found: Consistency, drift: float) -> float:
    """Mean square of the inconsistency with that of a clock; without channels to compare, 1."""
    return (found.chi2 if found.count > 0.0 or drift == 0.0 else 1.0) + drift


def _largest(runs: Sequence[PreparedRun], found: Consistency) -> SensorFinding | None:
    patterns, groups = _patterns(runs)
    normal = np.einsum("pi,ij,pj->p", patterns, found.normal, patterns)
    theta = patterns @ found.right / np.where(normal > 0.0, normal, np.inf)
    fall = np.where(_possible(groups), theta**2 * normal, 0.0)
    swap, swap_fall = find_swap(runs)
    top = float(fall.max())
    beyond_chance = found.energy - found.count - 3.0 * np.sqrt(2.0 * found.count)
    least = max(SIGNIFICANT**2, PART * beyond_chance, SHARE * found.energy)
    if max(top, swap_fall) < least:
        return None
    exchanged = None
    if swap is not None and swap_fall >= least:
        exchanged = SensorFinding("channel_swap", swap, 1.0, 0.0, "-", 0.0, ())
    if top < least:
        return exchanged
    other = _error(runs, found, fall, theta)
    if exchanged is None:
        return other
    return min(
        (exchanged, other),
        key=lambda one: consistency([_put_right(r, (one,)) for r in runs]).energy,
    )


def _error(
    runs: Sequence[PreparedRun], found: Consistency, fall: Array, theta: Array
) -> SensorFinding:
    """The error of a group with the largest fall (p,) and what it is fitted to be."""
    patterns, groups = _patterns(runs)
    normal = np.einsum("pi,ij,pj->p", patterns, found.normal, patterns)
    top = float(fall.max())
    alike = np.flatnonzero(fall > top - max(1e-3 * top, SIGNIFICANT))
    best = min(alike, key=lambda i: len(groups[i // len(KINDS)].names))
    group, kind = groups[best // len(KINDS)], KINDS[best % len(KINDS)]
    others = tuple(
        groups[i // len(KINDS)]
        for i in alike
        if i % len(KINDS) == best % len(KINDS) and i // len(KINDS) != best // len(KINDS)
    )
    cases = [_case(run, group) for run in runs if _has(run, group)]
    if cases and all(case is not None for case in cases):
        finding = _fitted([case for case in cases if case is not None], group)
    else:
        value = theta[best] / (1.0 - theta[best]) if kind == "sensor_gain" else theta[best]
        scale = float(patterns[best] @ found.scale) / len(group.names)
        sigma = float(np.sqrt(max(found.chi2, 1.0) / normal[best]))
        finding = _finding(kind, group, value * scale, sigma * scale)
    return replace(finding, alike=others)


def _possible(groups: Sequence[Group]) -> Mask:
    """Which patterns (p,) can be told: of all channels at once, a clock alone shows."""
    every = np.array([group.quantity == "xvu" for group in groups])
    clock = np.array([kind == "clock_drift" for kind in KINDS])
    possible: Mask = (~every[:, None] | clock[None, :]).ravel()
    return possible


def _finding(kind: str, group: Group, value: float, sigma: float) -> SensorFinding:
    size = 1e6 if kind == "clock_drift" else 1.0
    unit = UNITS.get(kind, group.unit)
    return SensorFinding(kind, group, float(value) * size, float(sigma) * size, unit, 0.0, ())


def _has(run: PreparedRun, group: Group) -> bool:
    there = np.concatenate([run.x.there, run.v.there, run.u.there])
    return not bool((group.members & ~there).any())


def _patterns(runs: Sequence[PreparedRun]) -> tuple[Array, list[Group]]:
    """Patterns (p, 4 J), kinds fastest, of the groups whose channels are all there in a run."""
    every = groups_of(runs[0].model.layout)
    groups = [g for g in every if any(_has(run, g) for run in runs)]
    rows = [np.kron(group.members, np.eye(len(KINDS))) for group in groups]
    return np.concatenate([np.asarray(row).reshape(len(KINDS), -1) for row in rows]), groups


def _fitted(cases: Sequence[_Case], group: Group) -> SensorFinding:
    """The kind of error that explains a group best, against the prediction of all others."""
    fits = [_fit(cases, kind) for kind in KINDS]
    kind = int(np.argmin([fit[2] for fit in fits]))
    return _finding(KINDS[kind], group, *fits[kind][:2])


@dataclass(frozen=True)
class _Case:
    """Channels of a group in a run: measured (n, g), predicted by the others, sigma (g,)."""

    times: Array
    measured: Array
    predicted: CubicSpline
    sigma: Array


def _case(run: PreparedRun, group: Group) -> _Case | None:
    """None where the other channels can't predict those of the group."""
    measured, sigma = channel_arrays(run)
    predicted = predict(drop(run, group.names))[:, group.members]
    if not np.isfinite(predicted).all():
        return None
    spline = CubicSpline(run.times, predicted)
    return _Case(run.times, measured[:, group.members], spline, sigma[group.members])


def predict(run: PreparedRun) -> Array:
    """Channels x, v, u (n, J) from the fused coordinates; the rigid rotation of u from u."""
    fused = fuse(run)
    B = bodies_to_coordinates(run.model)
    rigid = np.ones(B.shape[1])
    rigid[:2] = 2.0
    shape = fused.z @ np.linalg.pinv(B).T
    on = run.u.there
    if on.any():
        weight = rigid[on] / (rigid[on] @ rigid[on])
        shape = shape + np.outer((run.u.values[:, on] - shape[:, on]) @ weight, rigid)
    return np.hstack([fused.x, fused.v, shape])


def _fit(cases: Sequence[_Case], kind: str) -> tuple[float, float, float]:
    """Value, its sigma and the sum of squares left, by Gauss-Newton."""
    value, sigma, left = 0.0, np.inf, np.inf
    for _ in range(4):
        normal = right = left = 0.0
        for case in cases:
            expected, slope = _erring(case, kind, value)
            J, r = slope / case.sigma, (case.measured - expected) / case.sigma
            normal += float(np.sum(J * J))
            right += float(np.sum(J * r))
            left += float(np.sum(r * r))
        value += right / max(normal, 1e-300)
        sigma = 1.0 / np.sqrt(max(normal, 1e-300))
    count = sum(case.measured.size for case in cases)
    return value, sigma * np.sqrt(max(left / count, 1.0)), left


def _erring(case: _Case, kind: str, value: float) -> tuple[Array, Array]:
    """What a channel with an error reads, and its derivative by the error."""
    t = case.times
    if kind == "sensor_gain":
        return (1.0 + value) * case.predicted(t), case.predicted(t)
    if kind == "sensor_bias":
        return case.predicted(t) + value, np.ones_like(case.measured)
    if kind == "sensor_delay":
        return case.predicted(t - value), -case.predicted(t - value, 1)
    late = t * (1.0 - value)
    return case.predicted(late), -t[:, None] * case.predicted(late, 1)
