"""Forces that a hypothesis expects: the calibrated gear with effects at the recorded motion.

The laws are those that the simulation runs with. What effects add is taken between the law with
and without them on fused x and v, and put on the law smoothed over the noise of x, so that errors
in x do not bend it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.mesh import backlash
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.effects.channels import distort, on_channels
from herringbone_sim.effects.effect import Active, Locus, Parameter
from herringbone_sim.effects.gear import gear_table, laws, pointers_allowed, scratch
from herringbone_sim.effects.instant import recorded
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.data.waves import waves
from herringbone_sim.gap.residuals.balance import FineLaw
from herringbone_sim.gap.residuals.fusion import Fused
from herringbone_sim.gap.residuals.recalibrate import Law, fine_law, force_law

Array = NDArray[np.float64]
SUBSTEPS = 8


@dataclass(frozen=True)
class Case:
    """A run with what is known of it before any hypothesis.

    Attributes:
        run, fused: measured, and its best displacements.
        now: (n, 5) phase [rad], mesh frequency [rad/s], delta_T [K], T_1 [N m], K.
        usable: (n_mesh,) meshes with x, v and F.
        floor: (n, n_mesh) noise of the force residual under the nominal law [N].
    """

    run: PreparedRun
    fused: Fused
    now: Array
    usable: NDArray[np.bool_]
    floor: Array


def case(run: PreparedRun, fused: Fused) -> Case:
    """A run and its fused motion as a case."""
    p = run.model.parameters
    columns = (run.phase, run.omega_rad_per_s, p.delta_T, p.T_1, p.K)
    now = np.stack([np.broadcast_to(column, run.phase.shape) for column in columns], axis=1)
    seen = np.isfinite(fused.x).all(axis=0) & np.isfinite(fused.v).all(axis=0)
    usable: NDArray[np.bool_] = np.logical_and(seen, np.isfinite(run.F.values).all(axis=0))
    floor = force_law(run, fused, np.ones(6)).sigma_n
    return Case(run, fused, np.ascontiguousarray(now, dtype=float), usable, floor)


def expected(
    one: Case,
    factors: Array,
    actives: Sequence[Active],
    law: Law | None = None,
    substeps: int = SUBSTEPS,
) -> Array:
    """Forces (n, n_mesh) [N] that the rig's sensors would show.

    Args:
        factors: (6,) of the nominal parameters, see ``recalibrate``.
        actives: effects in the meshes or on the force sensors; others change nothing here.
        law: that of the factors, if it is at hand.
        substeps: of a sample, in which states of effects follow the measured forces.
    """
    law = law or force_law(one.run, one.fused, factors)
    force = law.modelled_n
    if any(a.effect.level == "mesh" for a in actives):
        force = force + added(one, factors, law, actives, substeps)[0]
    names = tuple(f"F_{m}" for m in one.run.model.layout.meshes)
    sensors = on_channels(names, actives)
    if sensors:
        known = np.isfinite(force)
        shown = distort(TimeSeries(one.run.times, np.where(known, force, 0.0), names), sensors)
        force = np.where(known, shown.columns(names), np.nan)
    return force


def added(
    one: Case,
    factors: Array,
    law: Law,
    actives: Sequence[Active],
    substeps: int = SUBSTEPS,
) -> tuple[Array, Array]:
    """What effects add to forces (n, n_mesh) [N] and to torques (n, n_bodies) [N]."""
    moved = _Motion(
        one.run.times,
        one.now,
        np.nan_to_num(law.x_m),
        np.nan_to_num(law.v_m_per_s),
        _known(one.run.F.values, law.modelled_n),
        one.run.waves.k,
    )
    return _added(one, factors, moved, actives, substeps)


def fine_law_with(one: Case, factors: Array, actives: Sequence[Active]) -> FineLaw:
    """The calibrated law with effects between samples, as ``balance.quadrature`` takes it."""
    plain = fine_law(one.run, factors)
    machine = tuple(a for a in actives if a.effect.level == "mesh")
    if not machine:
        return plain

    def law(phase: Array, deflection: Array, rate: Array) -> Array:
        at = np.linspace(0.0, len(one.run) - 1.0, len(phase))
        index = np.arange(len(one.run))
        now = one.now[np.minimum(np.rint(at).astype(int), len(one.run) - 1)].copy()
        now[:, 0] = phase
        w = waves(one.run.model, phase, one.run.omega_rad_per_s)
        e = np.repeat(factors[4:6], deflection.shape[1] // 2)
        measured = np.stack([np.interp(at, index, f) for f in one.run.F.values.T], axis=1)
        modelled = plain(phase, deflection, rate)
        moved = _Motion(
            np.interp(at, index, one.run.times),
            now,
            deflection - e * w.e,
            rate - e * w.e_rate,
            _known(measured, modelled),
            w.k,
        )
        return modelled + _added(one, factors, moved, machine)[0]

    return law


def _known(measured: Array, modelled: Array) -> Array:
    """Measured forces, and the law's where none were: they drive what moves by itself."""
    known: Array = np.nan_to_num(np.where(np.isfinite(measured), measured, modelled))
    return known


@dataclass(frozen=True)
class _Motion:
    """Times (n,), now (n, 5), x and v (n, n_mesh) relative to the own e(t), forces, nominal k."""

    times: Array
    now: Array
    x: Array
    v: Array
    force: Array
    k: Array


def _added(
    one: Case,
    factors: Array,
    moved: _Motion,
    actives: Sequence[Active],
    substeps: int = SUBSTEPS,
) -> tuple[Array, Array]:
    model = one.run.model
    found = laws(model, actives)
    gear = calibrated_gear(one, factors)
    force = np.empty_like(moved.x)
    torque = np.empty((len(moved.x), len(model.layout.bodies)))
    with pointers_allowed():
        recorded(
            found.kernel,
            found.site,
            found.theta,
            gear,
            moved.times,
            moved.now,
            moved.x,
            moved.v,
            moved.force,
            np.zeros(found.n_own),
            scratch(model, found.n_own),
            substeps,
            force,
            torque,
        )
    k = moved.k * np.repeat(factors[:2], moved.x.shape[1] // 2)
    without = k * backlash(moved.x, gear[2]) + gear[1] * moved.v
    return force - without, torque


def calibrated_gear(one: Case, factors: Array) -> Array:
    """``effects.gear.gear_table`` with the factors on k, c and e."""
    table = gear_table(one.run.model)
    k, c, e = (np.repeat(factors[i : i + 2], table.shape[1] // 2) for i in (0, 2, 4))
    table[0] *= k
    table[1] *= c
    table[3] *= e
    for row in range(4, len(table)):
        table[row] *= k if (row - 4) % 4 < 2 else e
    return table


def with_law_forces(c: Case, law: Law) -> Case:
    """A case whose forces are the law's where none is measured: they drive rings and pins."""
    values = np.where(np.isfinite(c.run.F.values), c.run.F.values, law.modelled_n)
    return replace(c, run=replace(c.run, F=replace(c.run.F, values=values)))


def calibration_columns(c: Case, law: Law, factors: Array) -> list[Array]:
    """Change of the force (n, n_mesh) by the factors on k, c and e of each mesh."""
    n = law.f_m.shape[1]
    k = c.run.waves.k * np.repeat(factors[:2], n // 2)
    damping = c.run.model.damping_n_s_per_m * np.repeat(factors[2:4], n // 2)
    return [
        c.run.waves.k * law.f_m,
        c.run.model.damping_n_s_per_m * law.v_m_per_s,
        -(k * law.contact * c.run.waves.e + damping * c.run.waves.e_rate),
    ]


def step_of(p: Parameter) -> float:
    """A small step of a parameter: a thousandth of a moderate value of it."""
    neutral = 0.0 if p.neutral is None or np.isinf(p.neutral) else p.neutral
    size = abs(p.start - neutral)
    return 1e-3 * size if size > 0.0 else min(1.0, 1e-4 * (p.high - p.low))


def name_of(actives: Sequence[Active]) -> str:
    """Effects and places in words."""
    return " + ".join(
        f"{a.effect.id}{dict(a.options) or ''} {a.locus.mesh}/{a.locus.planet}/{a.locus.side}"
        for a in actives
    )


def everywhere(one: Active) -> Locus:
    """The widest locus that the laws of an effect allow: its response on every mesh at once."""
    member = one.chosen.get("member")
    return Locus({"sun": "sp", "ring": "rp"}.get(str(member), "all"))
