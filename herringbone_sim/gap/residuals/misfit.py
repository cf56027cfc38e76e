"""Runs of another gear, and a nominal file of another rig.

A gear tells itself by its mesh frequency, by the geometry between bodies and meshes with the mesh
error that its encoders' program takes off, and by its force law. Effects of the catalogue bend
the last one; so that one alone says little, and only where it misses the force on every mesh.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.gap.data.geometry import bodies_to_coordinates, coordinates_to_meshes
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.data.screen import Finding
from herringbone_sim.gap.residuals.fusion import Fused
from herringbone_sim.gap.residuals.recalibrate import force_law

Array = NDArray[np.float64]

SPEED = 2e-3  # share by which a mesh frequency may be off that of the other runs
GEOMETRY = 0.2  # by which the scale of u or of e(t) may differ from the other runs
LEAST = 0.5  # share of the square of u, and of its slope, that must be motion
ALIKE = 0.9  # square of the correlation of u and e(t) from which they can't be told apart
MISSED = 0.5  # share of the force that the nominal law misses from which it is another law
FOUND = 0.1  # and below which the other runs follow it


def speed_ratio(run: PreparedRun) -> float:
    """Mesh frequency over the nominal Omega omega_n."""
    p, s = run.model.parameters, run.model.scales
    return run.omega_rad_per_s / (p.Omega * s.omega_n)


def common_ratio(ratios: Sequence[float]) -> float:
    """The ratio that most runs share; the one nearest to 1 where none does."""
    values = np.array(ratios)
    friends = (np.abs(values[:, None] / values - 1.0) < SPEED).sum(axis=1)
    most = values[friends == friends.max()]
    return float(most[np.abs(np.log(most)).argmin()])


def other_speed(run: PreparedRun, ratio: float, common: float) -> Finding | None:
    """A run whose mesh does not turn as that of the other runs."""
    if abs(ratio / common - 1.0) < SPEED:
        return None
    text = (
        f"the mesh of {run.name} turns at {run.omega_rad_per_s:.6g} rad/s, {ratio:.4f} of the "
        f"nominal Omega omega_n, the other runs at {common:.4f} of it: a run of another gear, or "
        "another Omega than campaign.yaml has; it is left out"
    )
    at = float(run.times[0])
    return Finding("other_gear", run.name, ("phase",), at, text, fatal=True)


def other_geometry(runs: Sequence[PreparedRun]) -> list[Finding]:
    """Runs whose x, u and e(t) fit together in another way than in most runs.

    A sensor that errs, errs in all of them.
    """
    scales = np.array([geometry_scales(run) for run in runs])
    seen = np.isfinite(scales).all(axis=1)
    if seen.sum() < 3:
        return []
    usual = np.median(scales[seen], axis=0)
    found = []
    for run, (of_u, of_e), known in zip(runs, scales, seen, strict=True):
        if known and max(abs(of_u - usual[0]), abs(of_e - usual[1])) > GEOMETRY:
            text = (
                f"x of {run.name} is {of_u:.3f} of what u says plus {of_e:.3f} of the nominal "
                f"e(t), {usual[0]:.3f} and {usual[1]:.3f} in the other runs: a run of another "
                "gear or with other sensors; it is left out"
            )
            channels = tuple(f"x_{mesh}" for mesh in run.model.layout.meshes)
            at = float(run.times[0])
            found.append(Finding("other_gear", run.name, channels, at, text, fatal=True))
    return found


def geometry_scales(run: PreparedRun) -> tuple[float, float]:
    """(g, h) of x + e = g G u + h e over the meshes, in the median: 1 and 0; NaN where unknown.

    A delay between the two is fitted beside it. The noise of u is taken off its own square, which
    it would make too large.
    """
    if not (run.u.complete and run.x.there.any()):
        return np.nan, np.nan
    G = coordinates_to_meshes(run.model.layout) @ bodies_to_coordinates(run.model)
    given = run.u.values @ G.T
    noise = (G**2) @ run.u.sigma**2
    pairs = []
    for j in np.flatnonzero(run.x.there):
        s, e, late = given[:, j], run.waves.e[:, j], run.waves.e_rate[:, j]
        J = np.stack([s, e, late * run.cycle_s, np.gradient(s)], axis=1)
        J = J - J.mean(axis=0)
        square = J.T @ J
        whole, slope, cross = square[0, 0], square[3, 3], abs(square[0, 1])
        square[0, 0] -= len(s) * noise[j]
        square[3, 3] -= 0.5 * len(s) * noise[j]
        # Noise as large as the motion, or a motion that is e(t) itself, tells nothing.
        quiet = square[0, 0] <= LEAST * whole or square[3, 3] <= LEAST * slope
        if quiet or cross**2 > ALIKE * whole * square[1, 1]:
            continue
        pairs.append(np.linalg.solve(square, J.T @ (run.x.values[:, j] + e))[:2])
    if not pairs:
        return np.nan, np.nan
    of_u, of_e = np.median(pairs, axis=0)
    return float(of_u), float(of_e)


def missed_shares(run: PreparedRun, fused: Fused) -> Array:
    """Share (n_mesh,) of the force's RMS that the nominal law misses beyond the noise."""
    law = force_law(run, fused, np.ones(6))
    beyond = np.mean(law.residual_n**2, axis=0) - np.mean(law.sigma_n**2, axis=0)
    share: Array = np.sqrt(np.maximum(beyond, 0.0) / np.mean(run.F.values**2, axis=0))
    return share


def other_laws(runs: Sequence[PreparedRun], shares: Mapping[str, Array]) -> list[Finding]:
    """Runs whose forces miss the law on every mesh while all other runs follow it.

    One within the range of loads, temperatures and speeds of the others is another gear; outside
    of it an effect may wake there. Held-out runs are told, never chosen by their residual.
    """
    if len(runs) < 4:
        return []
    found = []
    for run in runs:
        others = [r for r in runs if r is not run and r.role == "fit"]
        least = float(np.min(shares[run.name]))
        most = max((float(np.median(shares[r.name])) for r in others), default=np.inf)
        if not (least > MISSED and most < FOUND):
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
        channels = tuple(f"F_{mesh}" for mesh in run.model.layout.meshes)
        found.append(
            Finding("other_gear", run.name, channels, float(run.times[0]), text, fatal=out)
        )
    return found


def other_nominal(common: float, shares: Sequence[Array]) -> Finding | None:
    """A nominal file that is not that of the rig.

    Args:
        common: mesh frequency over the nominal one.
        shares: of the force that the law misses, of each fit run with forces.
    """
    text = ""
    if abs(common - 1.0) > SPEED:
        text = f"all runs turn at {common:.4f} of the nominal Omega omega_n"
    elif shares and min(float(np.median(share)) for share in shares) > MISSED:
        least, most = (f([float(np.median(s)) for s in shares]) for f in (min, max))
        text = f"the nominal force law misses {least:.0%} to {most:.0%} of the force in every run"
    if not text:
        return None
    text += (
        ": the nominal file does not match this rig (stiffness, inertia, teeth, backlash or mesh "
        "error); no effect is named against it; name the right one with --nominal"
    )
    return Finding("nominal", "", (), None, text, fatal=True)
