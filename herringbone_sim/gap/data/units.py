"""Channels in another unit than SI, detected by their size.

x, v / omega and D B u (``data.geometry``) are displacements near the size of the nominal mesh
error; the forces balance the input torque and follow the displacements. A channel that is off
by a power of a thousand is in another unit; it is left out, not rescaled.
"""

from __future__ import annotations

import numpy as np

from herringbone_sim.arrays import Array, Flags
from herringbone_sim.core.mesh import backlash
from herringbone_sim.core.model import mean_sun_force
from herringbone_sim.gap.data.kinematics import bodies_to_meshes
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.data.screen import Finding

POWERS = {3: "a thousand", -3: "a thousandth of", 6: "a million", -6: "a millionth of"}
CLOCK_UNITS = {  # ratio of the apparent to the nominal mesh frequency
    1e-3: "t in milliseconds",
    1e-6: "t in microseconds",
    1e-9: "t in nanoseconds",
    180.0 / np.pi: "phase in degrees",
    0.5 / np.pi: "phase in mesh cycles",
}
NEAR = 0.05  # relative tolerance of a speed ratio against the factor of a unit
FAR = 10.0**1.5  # ratio of sizes from which one of two channels is in another unit


def clock_unit(run: PreparedRun, ratio: float) -> Finding | None:
    """Return a fatal finding if the time or phase of a run is in another unit.

    ``ratio``: mesh frequency of the run over the nominal one; a unit changes it by its factor.
    """
    for factor, words in CLOCK_UNITS.items():
        if abs(ratio / factor - 1.0) < NEAR:
            text = (
                f"the mesh of {run.name} seems to turn at {ratio:.4g} of the nominal speed: "
                f"{words}, not in SI; the run is left out, not rescaled"
            )
            channels = (words.split()[0],)
            return Finding("unit", run.name, channels, float(run.times[0]), text, fatal=True)
    return None


def wrong_units(run: PreparedRun) -> tuple[PreparedRun, list[Finding]]:
    """Remove channels in another unit than SI; also return a finding for each such quantity."""
    findings = []
    for q, powers in {**_displacements(run), "F": _forces(run)}.items():
        off = powers != 0.0
        if not off.any():
            continue
        wrong = _channels(run, q, off)
        factor = POWERS.get(int(np.median(powers[off])), "a power of ten times")
        others = f" and {len(wrong) - 1} more" if len(wrong) > 1 else ""
        text = (
            f"{wrong[0]}{others} of {run.name} read about {factor} "
            f"{'times ' if 'of' not in factor else ''}what the other channels give: another unit "
            "than SI, throughout; left out of this run, not rescaled"
        )
        findings.append(Finding("unit", run.name, wrong, float(run.times[0]), text))
        run = run.without(q, np.ones_like(run.u.recorded) if q == "u" else off)
    return run, findings


def _displacements(run: PreparedRun) -> dict[str, Array]:
    """Return the powers of ten (n_mesh,) by which x, v and (if complete) D B u are off.

    By quantity (``x``, ``v``, ``u``); multiples of 3, see ``_powers``; 0 where not recorded. Each
    standard deviation (of v over omega) is compared with ``_usual_sizes``, widened to the median
    of those within ``FAR`` of them.
    """
    sizes = {
        "x": run.x.values.std(axis=0),
        "v": run.v.values.std(axis=0) / run.omega_rad_per_s,
    }
    if run.u.complete:
        sizes["u"] = (run.u.values @ bodies_to_meshes(run.model).T).std(axis=0)
    least, most = _usual_sizes(run)
    known = np.concatenate([s[np.isfinite(s) & (s > 0.0)] for s in sizes.values()])
    near = known[(known > least / FAR) & (known < most * FAR)]
    if near.size:
        usual = float(np.median(near))
        least, most = min(least, usual), max(most, usual)
    return {
        q: _powers(size / np.clip(size, max(least, np.finfo(float).tiny), most))
        for q, size in sizes.items()
    }


def _usual_sizes(run: PreparedRun) -> tuple[float, float]:
    """Return the smallest and the largest usual standard deviation [m] of a displacement.

    Teeth that stay in contact move by what k(t) makes of the deflection under the load, whatever
    e(t) is; teeth that part, by e(t), by what the control asks for, or through the backlash.
    """
    model = run.model
    e = float(run.waves.e.std(axis=0).mean())
    load = abs(mean_sun_force(model)) * float((1.0 / run.waves.k).std(axis=0).mean())
    swing = abs(model.parameters.K) * model.scales.b_c
    return min(e, load), max(e, load, swing, float(np.mean(model.half_backlash_m)))


def _forces(run: PreparedRun) -> Array:
    """Return the powers of ten (n_mesh,) by which forces are off, by their mean against the load.

    Where displacements are recorded, the comparison of the standard deviation with that of the
    nominal force law must give the same sign; else the power is 0.
    """
    nominal = run.waves.k * backlash(run.x.values, run.model.half_backlash_m)
    with np.errstate(divide="ignore", invalid="ignore"):
        by_law = _powers(run.F.values.std(axis=0) / nominal.std(axis=0))
        values = run.F.values
        mean = np.nansum(values, axis=0) / np.isfinite(values).sum(axis=0)  # gauges may have gaps
        by_load = _powers(np.abs(mean) / abs(mean_sun_force(run.model)))
    no_displacement = ~np.isfinite(run.x.values).all(axis=0)
    agree = no_displacement | (by_law * by_load > 0.0)
    powers: Array = np.where(agree, by_load, 0.0)
    return powers


def _powers(ratio: Array) -> Array:
    """Return log10 of the power of a thousand nearest to each ratio; 0 where it is unknown."""
    known = np.isfinite(ratio) & (ratio > 0.0)
    powers: Array = np.round(np.log10(np.where(known, ratio, 1.0)) / 3.0) * 3.0
    return powers


def _channels(run: PreparedRun, q: str, off: Flags) -> tuple[str, ...]:
    """Return names of the channels of ``q`` where ``off`` (n_mesh,) is set; if ``q`` is u, all."""
    names = run.model.layout.channels_of(q)
    return names if q == "u" else tuple(n for n, o in zip(names, off, strict=True) if o)
