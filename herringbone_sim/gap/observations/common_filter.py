"""Effect of a low-pass filter common to all channels on the force law.

The filter smooths displacements and forces alike, but the force of a smoothed displacement is not
the smoothed force, as k(t) varies and backlash is nonlinear. The displacement before a low-pass
1 / (1 + t_1 s + t_2 s^2) is x + t_1 dx/dt + t_2 d2x/dt2; its force is filtered again. The common
delay t_1 is in k(t) and e(t) already, see ``common_delay``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.signal import cont2discrete, lfilter, lfilter_zi

from herringbone_sim.arrays import Array
from herringbone_sim.gap.residuals.mesh_law import MeshMotion, law
from herringbone_sim.gap.sensors.filter_delay import CORNER

# t_1 and t_2 times powers of the corner frequency: first order, and Butterworth of second order.
# One of second order with damping ratio d is nearly Butterworth's plus 2 (2 d^2 - 1) times the
# first-order one.
FILTERS = ((1.0,), (2.0**0.5, 1.0))
MAX_FILTER_COEFFICIENTS = (2.0, 1.0)  # bounds of their amplitudes: damping ratio 0.5 to 1


def with_filter_responses(m: MeshMotion, omega_n: float) -> MeshMotion:
    """Return a motion with ``filtered`` set: change of the mesh forces by each of ``FILTERS`` [N].

    Corner frequencies are the lowest of the data sheet, ``CORNER`` times ``omega_n``.

    Args:
        m: motion at fine equal steps, x and v as recorded.
        omega_n: natural frequency [rad/s].
    """
    plain = law(m).force
    corner = CORNER * omega_n
    shown = []
    for over_corner in FILTERS:
        terms = [t / corner ** (i + 1) for i, t in enumerate(over_corner)]
        shown.append(_lowpass(law(_unfiltered(m, terms)).force, m, terms) - plain)
    return replace(m, filtered=np.stack(shown))


def _unfiltered(m: MeshMotion, terms: list[float]) -> MeshMotion:
    """Motion before a filter with ``terms`` (t_1 [s], t_2 [s^2]); k(t) is advanced by t_1."""
    step = float(m.times[1] - m.times[0])
    x, v, slope = m.x, m.v, m.v
    for term in terms:
        x = x + term * slope
        slope = np.gradient(slope, step, axis=0)
        v = v + term * slope
    return replace(m, x=x, v=v, k=m.waves_at(m.phase + m.omega * terms[0]).k)


def _lowpass(values: Array, m: MeshMotion, terms: list[float]) -> Array:
    """Filter values (n, k) with ``terms`` (t_1 [s], t_2 [s^2]), from steady state."""
    step = float(m.times[1] - m.times[0])
    b, a, _ = cont2discrete(([1.0], [*reversed(terms), 1.0]), step, method="foh")
    start = lfilter_zi(b.ravel(), a)[:, None] * values[:1]
    return np.asarray(lfilter(b.ravel(), a, values, axis=0, zi=start)[0])
