"""Effect of the phase and the frequency of the control at each amplitude.

A control of the mesh frequency on all four equations adds to the inertia term of the mesh error,
e_m Omega^2 sin(Omega tau) - K cos(Omega tau + phase): together they act as a mesh error of another
amplitude and phase (``equivalent_error``), and at one K and phase they cancel (``cancelling``). A
control of another frequency has no equivalent mesh error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from herringbone_sim.arrays import Array, Flags, Indices
from herringbone_sim.control.amplitude import Survey, run_survey
from herringbone_sim.control.runs import LEAST_EXPONENT, MotionRunner, RunSettings
from herringbone_sim.control.starts import Starts
from herringbone_sim.core.model import Model
from herringbone_sim.core.parameters import Parameters, meaning
from herringbone_sim.sweeps.grid import Axis

NEAR = 0.02  # rad, and share of K, about the control that cancels the mesh error; chosen
IRRATIONAL = (0.6180339887498949, 1.4142135623730951, 2.2360679774997896)
ORDERS = tuple(sorted([*(i / 8 for i in range(25)), *IRRATIONAL]))


@dataclass(frozen=True)
class ShapeMap:
    """Motions over a parameter of the control and over K, from the zero start.

    Attributes:
        axis: control_phase or control_order, n values.
        K: (m,).
        period: (n, m) in periods of the forcing (of mesh and control together); 0 = not periodic.
        exponent, exponent_error: (n, m) largest Lyapunov exponent per tau.
        transverse: (n, m) exponent of left-right differences; NaN if the halves differ.
        chaotic: (n, m) not periodic, with a positive exponent of symmetric perturbations. A motion
            that is neither is quasi-periodic, or its period longer than sought.
        apart: (n, m) fraction of the time without contact.
    """

    axis: Axis
    K: Array
    period: Array
    exponent: Array
    exponent_error: Array
    transverse: Array
    chaotic: Flags
    apart: Array


def phases(n: int) -> tuple[float, ...]:
    """n phases [rad] at even distances from -pi to below pi."""
    return tuple(float(-np.pi + 2.0 * np.pi * i / n) for i in range(n))


def shape_map(
    runner: MotionRunner, base: Parameters, axis: Axis, K: Array, settings: RunSettings
) -> ShapeMap:
    """Integrate from the zero start at every value of an axis of the control and every K.

    Args:
        runner: integrates the runs.
        base: parameters of the gear.
        axis: values of ``control_phase`` [rad] or ``control_order``.
        K: (m,) amplitudes.
        settings: lengths of the runs.
    """
    survey = run_survey(runner, base, axis, K, Starts(0, 0, running=False), settings)
    names = ("exponent", "exponent_error", "transverse", "within", "apart")
    exponent, error, transverse, within, apart = (survey.of(name)[:, :, 0] for name in names)
    period = zero_start_periods(survey)
    own = np.where(np.isnan(within), exponent, within)
    chaotic = (period == 0) & (own > np.maximum(2.0 * error, LEAST_EXPONENT))
    return ShapeMap(axis, K, period, exponent, error, transverse, chaotic, apart)


def zero_start_periods(survey: Survey) -> Array:
    """Periods (n, m) of the motions from the zero start, in periods of the forcing."""
    cycles, unit = survey.of("period")[:, :, 0], survey.forcing_cycles[:, None]
    return in_periods(cycles, unit, survey.K, survey.forcing)


def in_periods(cycles: Array, unit: Indices, K: Array, free: int = 1) -> Array:
    """Convert periods (n, m) from mesh cycles to periods of the forcing.

    Args:
        cycles: (n, m) periods in mesh cycles; 0 = aperiodic, NaN = failed.
        unit: (n, 1) period of the forcing in mesh cycles; 0 if mesh and control have none.
        K: (m,) amplitudes.
        free: unit at K = 0.

    Returns:
        (n, m); 0 also for a period that is no multiple of the unit: it is a coincidence within
        the tolerance.
    """
    unit = np.where(K == 0.0, free, unit)
    whole = (unit > 0) & (np.mod(cycles, np.maximum(unit, 1)) == 0)
    result: Array = np.where(np.isnan(cycles), np.nan, np.where(whole, cycles, 0.0))
    return result / np.maximum(unit, 1)


def best(values: Array, least: Array) -> tuple[float, float]:
    """Element of ``values`` (n,) where ``least`` (n,) is smallest, and that minimum; or NaN."""
    if not np.isfinite(least).any():
        return np.nan, np.nan
    at = int(np.nanargmin(least))
    return float(values[at]), float(least[at])


def equivalent_error(p: Parameters) -> tuple[float, float]:
    """Amplitude e_m [b_c] and phase phi_b [rad] of a mesh error that acts as error plus control.

    From e_m Omega^2 sin(a) - K cos(a + phase) = e_m' Omega^2 sin(a + phi_b'): the same motion in
    the relative displacements x, for order 1 on all four equations and a mesh error that all
    meshes have alike.
    """
    amplitude, angle = _first_harmonic(p)
    inertia = amplitude * p.Omega**2
    steady = inertia * np.cos(angle) + p.K * np.sin(p.control_phase)
    across = inertia * np.sin(angle) - p.K * np.cos(p.control_phase)
    return float(np.hypot(steady, across) / p.Omega**2), float(np.arctan2(across, steady))


def cancelling(p: Parameters) -> tuple[float, float]:
    """K and phase [rad] at which the control cancels the inertia term of the mesh error.

    K is not negative; the phase lies from -pi to below pi.
    """
    amplitude, angle = _first_harmonic(p)
    phase = angle - np.pi / 2.0 + (np.pi if amplitude < 0.0 else 0.0)
    return float(abs(amplitude) * p.Omega**2), float((phase + np.pi) % (2.0 * np.pi) - np.pi)


def cancels(p: Parameters, model: Model) -> bool:
    """Whether a control of this gear, within its bounds, cancels all that varies of its error e.

    Not one of another order, nor on some of the equations alone, nor where the error has further
    harmonics, differs from mesh to mesh, or is changed by effects.

    Args:
        p: parameters of the gear.
        model: the same gear with its effects.
    """
    K, phase = cancelling(p)
    one = p.control_order == 1.0 and set(p.control_on) == {1.0} and not any(p.e_amp[1:])
    alike = all(len(set(values)) == 1 for values in (p.e_factor, p.phi_b, p.mesh_phase))
    changes = (model.packed.d_cos, model.packed.d_sin, model.packed.event_d)
    alike &= not any(np.any(values) for values in changes)
    bounds = ((meaning("K"), (1.0 + NEAR) * K), (meaning("control_phase"), abs(phase) + NEAR))
    return bool(one and alike and K > 0.0 and all(value <= known.high for known, value in bounds))


def _first_harmonic(p: Parameters) -> tuple[float, float]:
    """Amplitude [b_c] and phase [rad] of the mesh error at mesh order, of all meshes alike."""
    share = p.e_amp[0] if p.e_amp else 0.0
    return p.e_m * share * p.e_factor[0], p.phi_b[0] + p.mesh_phase[0]


def around_cancelling(
    runner: MotionRunner, base: Parameters, n: int, settings: RunSettings
) -> Survey:
    """Survey of motions from all kinds of starts near the control that cancels the mesh error.

    Args:
        n: odd number of phases within ``NEAR`` rad, and of amplitudes within that share.
    """
    K, phase = cancelling(base)
    near = Axis("control_phase", tuple(map(float, phase + np.linspace(-NEAR, NEAR, n))))
    return run_survey(
        runner, base, near, K * np.linspace(1.0 - NEAR, 1.0 + NEAR, n), Starts(1, 1), settings
    )


def quiet(survey: Survey) -> Flags:
    """(n, m, s) whether the motions of a survey have period 1 and never lose contact."""
    still = (survey.of("period") == survey.forcing) & (survey.of("contact_loss") == 0)
    return np.asarray(still, dtype=bool)
