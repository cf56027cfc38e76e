"""Detect runs of another gear, and a nominal file of another rig.

A gear is recognised by its mesh frequency, by the relation x = D B u - e(t), and by its force law.
Effects of the catalogue change the force law as well, so that a run is rejected by its force law
only where the law fails on every mesh.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.gap.data.kinematics import bodies_to_meshes, cycles_per_shaft_turn
from herringbone_sim.gap.data.prepared import PreparedRun, deciding
from herringbone_sim.gap.data.screen import Finding
from herringbone_sim.gap.residuals.fusion import Fused
from herringbone_sim.gap.residuals.recalibrate import force_law

SPEED_TOLERANCE = 2e-3  # relative, of a mesh frequency against that of the other runs
GEOMETRY_TOLERANCE = 0.2  # of ``geometry_scales`` against those of the other runs
LEAST_MOTION = 0.5  # least fraction of motion, not noise, in the squares of u and of its slope
COLLINEAR = 0.9  # squared correlation of u and e(t) from which their scales can't be separated
OTHER_LAW = 0.5  # unexplained fraction of the force above which a run has another law
SAME_LAW = 0.1  # unexplained fraction below which a run follows the nominal law


def speed_ratio(run: PreparedRun) -> float:
    """Return the mesh frequency of a run over the nominal Omega omega_n."""
    p, s = run.model.parameters, run.model.scales
    return run.omega_rad_per_s / (p.Omega * s.omega_n)


def most_common_ratio(ratios: Sequence[float]) -> float:
    """Return the ratio that most others agree with to ``SPEED_TOLERANCE``; if tied, nearest 1."""
    values = np.array(ratios)
    agreeing = (np.abs(values[:, None] / values - 1.0) < SPEED_TOLERANCE).sum(axis=1)
    most = values[agreeing == agreeing.max()]
    return float(most[np.abs(np.log(most)).argmin()])


def mesh_speed_mismatch(run: PreparedRun, ratio: float, common: float) -> Finding | None:
    """Return a fatal finding if a run's ``speed_ratio`` differs by more than ``SPEED_TOLERANCE``.

    ratio, common: mesh frequency over the nominal, of this run and of most runs [-].
    """
    if abs(ratio / common - 1.0) < SPEED_TOLERANCE:
        return None
    text = (
        f"the mesh of {run.name} turns at {run.omega_rad_per_s:.6g} rad/s, {ratio:.4f} of the "
        f"nominal Omega omega_n, the other runs at {common:.4f} of it: a run of another gear, or "
        "another Omega than campaign.yaml has; it is left out"
    )
    at = float(run.times[0])
    return Finding("other_gear", run.name, ("phase",), at, text, fatal=True)


def runs_with_other_geometry(runs: Sequence[PreparedRun]) -> list[Finding]:
    """Return a fatal finding for each run whose ``geometry_scales`` differ from most runs.

    A sensor error is the same in all runs, and so doesn't show here. With scales of
    fewer than three runs there are no findings.
    """
    scales = np.array([geometry_scales(run) for run in runs]).reshape(-1, 2)
    known = np.isfinite(scales).all(axis=1)
    if known.sum() < 3:
        return []
    decides = known & np.isin([run.name for run in runs], [r.name for r in deciding(runs)])
    # Of two fit runs that differ, neither could be called usual.
    usual = np.median(scales[decides if decides.sum() >= 3 else known], axis=0)
    findings = []
    for run, (of_u, of_e), finite in zip(runs, scales, known, strict=True):
        off = max(abs(of_u - usual[0]), abs(of_e - usual[1]))
        if finite and off > GEOMETRY_TOLERANCE:
            text = (
                f"x of {run.name} is {of_u:.3f} of what u gives plus {of_e:.3f} of the nominal "
                f"e(t), {usual[0]:.3f} and {usual[1]:.3f} in the other runs: a run of another "
                "gear or with other sensors; it is left out"
            )
            channels = run.model.layout.channels_of("x")
            at = float(run.times[0])
            findings.append(Finding("other_gear", run.name, channels, at, text, fatal=True))
    return findings


def geometry_scales(run: PreparedRun) -> tuple[float, float]:
    """Fit x + e = g G u + h e, with G = D B, at each recorded x; return the medians (g, h).

    Ideally they are (1, 0). Delays of u and e are fitted too, and one oscillation per revolution
    of each body, as eccentric gratings cause. The noise of u is subtracted from the normal
    equations, as it would bias g. A mesh is left out where the motion is too small, collinear
    with e, or so close to a sine of the mesh frequency, as e is, that noise could move g by half
    of ``GEOMETRY_TOLERANCE``. Where e is constant, h is 0. (NaN, NaN) if no mesh is left, or u is
    incomplete.
    """
    if not (run.u.complete and run.x.recorded.any()):
        return np.nan, np.nan
    G = bodies_to_meshes(run.model)
    given = run.u.values @ G.T
    noise = (G**2) @ run.u.sigma**2
    lines = once_a_turn(run)
    pairs = []
    for j in np.flatnonzero(run.x.recorded):
        s, e, late = given[:, j], run.waves.e[:, j], run.waves.e_rate[:, j]
        of_e = [e, late * run.cycle_s] if np.ptp(e) > 0.0 else []
        J = np.stack([s, np.gradient(s), *of_e], axis=1)
        J = J - lines @ (lines.T @ J)
        square = J.T @ J
        whole, slope = square[0, 0], square[1, 1]
        square[0, 0] -= len(s) * noise[j]
        square[1, 1] -= 0.5 * len(s) * noise[j]
        quiet = square[0, 0] <= LEAST_MOTION * whole or square[1, 1] <= LEAST_MOTION * slope
        if quiet or (of_e and square[0, 2] ** 2 > COLLINEAR * whole * square[2, 2]):
            continue
        # Error of g by the noise, where x is worked out of u: it is part of x then.
        inverse = np.linalg.inv(square)
        by_noise = len(s) * noise[j] * inverse[0, 0]
        if not 0.0 <= by_noise < 0.5 * GEOMETRY_TOLERANCE:
            continue
        # Of e: where the control drives u at the mesh frequency, e is all but one of its waves.
        if of_e and (noise[j] + run.x.sigma[j] ** 2) * inverse[2, 2] > (
            (0.25 * GEOMETRY_TOLERANCE) ** 2
        ):
            continue
        fitted = np.linalg.solve(square, J.T @ (run.x.values[:, j] + e))
        pairs.append((fitted[0], fitted[2] if of_e else 0.0))
    if not pairs:
        return np.nan, np.nan
    of_u, of_e = np.median(pairs, axis=0)
    return float(of_u), float(of_e)


def once_a_turn(run: PreparedRun) -> Array:
    """Return orthonormal columns (n, 7) that span a constant and once-per-revolution oscillations.

    Revolutions of suns, carrier and planets, with a cosine and a sine each.
    """
    angles = [run.phase / cycles for cycles in cycles_per_shaft_turn(run.model).values()]
    waves = [wave(angle) for angle in angles for wave in (np.cos, np.sin)]
    return np.linalg.qr(np.stack([np.ones(len(run)), *waves], axis=1))[0]


def unexplained_force_shares(run: PreparedRun, fused: Fused) -> Array:
    """Return the RMS residual of the nominal force law beyond its noise, over the RMS force.

    (n_mesh,), NaN at meshes without x, v or F.
    """
    law = force_law(run, fused, np.ones(6))
    beyond = np.mean(law.residual_n**2, axis=0) - np.mean(law.sigma_n**2, axis=0)
    share: Array = np.sqrt(np.maximum(beyond, 0.0) / np.mean(run.F.values**2, axis=0))
    return share


def runs_with_other_force_law(
    runs: Sequence[PreparedRun], shares: Mapping[str, Array]
) -> list[Finding]:
    """Return findings on runs whose force law fails on every mesh while other fit runs follow it.

    Inside the range of operating points of the fit runs this is another gear; outside, it may be
    an effect that acts only there. The finding is fatal only for a fit run inside the range:
    held-out runs must not be selected by their residual.

    Args:
        runs: runs with forces; with fewer than four there are no findings.
        shares: finite values of ``unexplained_force_shares``, by name of the run.
    """
    if len(runs) < 4:
        return []
    findings = []
    for run in runs:
        others = [r for r in runs if r is not run and r.role == "fit"]
        least = float(np.min(shares[run.name]))
        most = max((float(np.median(shares[r.name])) for r in others), default=np.inf)
        if not (least > OTHER_LAW and most < SAME_LAW):
            continue
        inside = all(
            min(r.point[q] for r in others) <= run.point[q] <= max(r.point[q] for r in others)
            for q in ("delta_T", "T_1", "Omega")
        )
        out = inside and run.role == "fit"
        text = (
            f"the force law misses {least:.0%} or more of the force on every mesh of {run.name}, "
            f"{most:.0%} or less in the other runs: a run of another gear"
            + ("" if inside else ", or an effect that only its operating point shows")
            + ("; it is left out" if out else "; it is kept")
        )
        channels = run.model.layout.channels_of("F")
        findings.append(
            Finding("other_gear", run.name, channels, float(run.times[0]), text, fatal=out)
        )
    return findings


def nominal_mismatch(common: float, shares: Sequence[Array]) -> Finding | None:
    """Return a finding, fatal for the campaign, if the nominal file doesn't describe the rig.

    Args:
        common: ``speed_ratio`` of most runs.
        shares: finite values of ``unexplained_force_shares`` of each run with forces.
    """
    text = ""
    if abs(common - 1.0) > SPEED_TOLERANCE:
        text = f"all runs turn at {common:.4f} of the nominal Omega omega_n"
    elif shares and min(float(np.median(share)) for share in shares) > OTHER_LAW:
        least, most = (f([float(np.median(s)) for s in shares]) for f in (min, max))
        text = f"the nominal force law misses {least:.0%} to {most:.0%} of the force in every run"
    if not text:
        return None
    text += (
        ": the nominal file does not match this rig (stiffness, inertia, teeth, backlash or mesh "
        "error); no effect is named against it; name the right one with --nominal"
    )
    return Finding("nominal", "", (), None, text, fatal=True)
