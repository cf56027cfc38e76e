"""Compiled integration of many motions of a gear with effects from given states and phases."""

from __future__ import annotations

from herringbone_sim.core.packed import TWO_PI
from herringbone_sim.effects.law import PHASE, law
from herringbone_sim.effects.run import forces_of_state, slope_of


@law
def roll(e, site, theta, gear, p, si, now, y, cycle, phase, h, parts, w, g, states, force):
    """Integrate s motions over k samples each by Runge-Kutta steps.

    Args:
        e, site, theta: compiled laws of the effects, their loci and parameters, see ``Laws``.
        gear, p, si: ``gear_table``, packed model and SI scales, see
            ``effects.run.forces_of_state``.
        now: (5,) phase [rad], mesh frequency [rad/s], delta_T [K], T_1 [N m] and K; the phase is
            overwritten.
        y: (s, size) initial states, dimensionless, then states of effects; overwritten.
        cycle, phase: (s,) initial mesh phase as whole mesh cycles and a remainder [rad].
        h: step in 1 / omega_n.
        parts: steps per sample.
        w, g: work arrays ``effects.gear.Scratch`` and ``simulator._Scratch``.
        states: (s, k, size) output, dimensionless states at the samples.
        force: (s, k, n) output, mesh forces at the samples [N].
    """
    samples = states.shape[1]
    for i in range(y.shape[0]):
        for k in range(samples):
            at = phase[i] + k * parts * h * p.Omega
            now[PHASE] = TWO_PI * cycle[i] + at
            forces_of_state(e, site, theta, gear, p, si, now, y[i], w, g)
            for j in range(y.shape[1]):
                states[i, k, j] = y[i, j]
            for m in range(w.force.size):
                force[i, k, m] = w.force[m]
            for part in range(parts if k + 1 < samples else 0):
                here = at + part * h * p.Omega
                rk4(e, site, theta, gear, p, si, now, cycle[i], here, h, y[i], w, g)


@law
def rk4(e, site, theta, gear, p, si, now, cycle, phase, h, y, w, g):
    """Advance y (size,) in place by one classical Runge-Kutta step of h; arguments as ``roll``."""
    for stage in range(4):
        part = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
        for k in range(y.size):
            g.stage[k] = y[k] + (part * h * g.rate[stage - 1, k] if stage > 0 else 0.0)
        at = phase + part * h * p.Omega
        slope_of(e, site, theta, gear, p, si, now, cycle, at, g.stage, w, g, g.rate[stage])
    for k in range(y.size):
        inner = g.rate[1, k] + g.rate[2, k]
        y[k] += h / 6.0 * (g.rate[0, k] + 2.0 * inner + g.rate[3, k])
