"""Linearise the force law about the errors that encoders have once a revolution.

Such errors are marginalised as small displacements. But an encoder of the data sheet is off by up
to 1.5 um at the base circle, as much as the deflection under a light load: a mesh in contact is
then read as separated, where no small displacement shows in the force. So each run's errors are
estimated, with its tolerances, by Gauss-Newton on the force law of the nominal gear, and taken
off. ``force_law.block`` adds what they would do to the linearised force: they stay marginalised,
with the same prior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.diagnosis.coefficients import functions_used
from herringbone_sim.diagnosis.parallel import parallel_map
from herringbone_sim.diagnosis.products import Block, products, shared_nuisances
from herringbone_sim.diagnosis.search import CHANCE_CHI2
from herringbone_sim.gap.data.kinematics import bodies_to_meshes, cycles_per_shaft_turn
from herringbone_sim.gap.data.prepared import PreparedRun, deciding
from herringbone_sim.gap.observations import force_law
from herringbone_sim.gap.observations.gear import SHAFT_NAMES, GearObservations
from herringbone_sim.gap.observations.gear_machine import GearMachine
from herringbone_sim.gap.residuals.mesh_law import MeshMotion, law

# Chi2 per value up to which the calibrated gear without effects fits: what it lacks is no larger
# than the noise (d = 1).
NULL_FITS_CHI2 = 2.0
MAX_ROUNDS = 8
SETTLED = 0.1  # change of a displacement over its noise below which the estimate is final


def without_encoder_errors(
    runs: Sequence[PreparedRun], gain_tolerance: Sequence[float], stride: int
) -> tuple[PreparedRun, ...]:
    """Estimate the errors of encoders once a revolution, and take them off u or x.

    A run is corrected if it has u of all bodies and no x, or x of all meshes and no u, unless that
    raises its chi2 by more than chance. All runs are returned as they are if

    - no force law can be formed from them (``has_force_law``), as where a run lacks forces;
    - the nominal law still leaves one of the corrected fit runs (of all, if none is a fit run) a
      chi2 per value above ``NULL_FITS_CHI2``: a part of an effect may then look like such errors.

    Args:
        runs: of one rig.
        gain_tolerance: (n_mesh,) of force sensors; empty: none.
        stride: samples from one value of the force law to the next.
    """
    if not any(_has_either_u_or_x(run) for run in runs):
        return tuple(runs)
    gear = GearObservations(runs, stride=stride, gain_tolerance=gain_tolerance)
    if not gear.has_force_law:
        return tuple(runs)
    base = GearMachine(gear).base
    used = {*functions_used(base).get(force_law.NAME, ()), *SHAFT_NAMES}
    chosen = tuple(f for f in gear.law_functions if f.name in used)

    def block(motion: MeshMotion, r: int) -> Block:
        """Residual of the nominal law, with tolerances as shared nuisances behind the errors."""
        made = force_law.block(motion, law(motion), gear.model, chosen)
        weights = np.zeros((len(base), made.residual.shape[1], len(chosen)))
        for i, c in enumerate(base):
            if force_law.NAME in c.placements:
                for row, f, w in c.placements[force_law.NAME].entries:
                    weights[i, row, made.functions.index(f)] += w[r]
        return replace(
            made,
            shared=np.concatenate([made.shared, weights]),
            shared_sd=np.append(made.shared_sd, [c.sd for c in base]),
        )

    def corrected(r: int) -> tuple[PreparedRun, bool]:
        """Return run r without its errors, and whether the nominal law then fits."""
        run, motion = gear.runs[r].run, gear.runs[r].strided
        if not _has_either_u_or_x(run):
            return run, True
        of_bodies = bodies_to_meshes(gear.model)
        waves = _waves(run, motion.phase + run.delay_rad)
        now = before = block(motion, r)
        errors = np.zeros(2 * of_bodies.shape[1])
        moved = np.zeros_like(motion.x)
        for _ in range(MAX_ROUNDS):
            last, errors = moved, shared_nuisances(now)[: len(errors)]
            moved = _of_bodies(waves, errors) @ of_bodies.T
            now = block(replace(motion, x=motion.x - moved, encoder_errors=errors), r)
            if np.all(np.abs(moved - last) < SETTLED * motion.sigma_x):
                break
        left, count = _chi2(now)
        fits = left <= NULL_FITS_CHI2 * count
        if not left < _chi2(before)[0] + CHANCE_CHI2:
            return run, fits
        off = _of_bodies(_waves(run, run.phase), errors)
        u = replace(run.u, values=run.u.values - off)
        x = replace(run.x, values=run.x.values - off @ of_bodies.T)
        return replace(run, u=u, x=x, encoder_errors=errors), fits

    made = parallel_map(corrected, range(len(runs)))
    decide = {run.name for run in deciding(runs)}
    fits = all(ok for run, ok in made if run.name in decide)
    return tuple(run for run, _ in made) if fits else tuple(runs)


def _has_either_u_or_x(run: PreparedRun) -> bool:
    """Whether u of all bodies is recorded and no x, or x of all meshes and no u."""
    return (run.u.complete and not run.x.recorded.any()) or (
        run.x.complete and not run.u.recorded.any()
    )


def _waves(run: PreparedRun, phase: Array) -> Array:
    """cos and sin (n, n_bodies, 2) of the turn of each body's shaft at mesh phases (n,)."""
    cycles = cycles_per_shaft_turn(run.model)
    turns = phase[:, None] / np.array([cycles[body[0]] for body in run.model.layout.bodies])
    return np.stack([np.cos(turns), np.sin(turns)], axis=2)


def _of_bodies(waves: Array, errors: Array) -> Array:
    """Errors of rotations (n, n_bodies) [m] by amplitudes (2 n_bodies,) of cos, sin by body."""
    return np.asarray(np.einsum("njt,jt->nj", waves, errors.reshape(-1, 2)))


def _chi2(block: Block) -> tuple[float, float]:
    """Chi2 with nuisances marginalised, and the number of values in recorded rows."""
    p = products(block)
    return float(p.chi2_without_nuisance.sum()), p.values
