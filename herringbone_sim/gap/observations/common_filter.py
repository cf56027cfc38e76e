"""Effect of a low-pass filter common to all channels on the force law.

The filter smooths displacements and forces alike, but the force of a smoothed displacement is not
the smoothed force, as k(t) and backlash are nonlinear. The displacement before a low-pass
1 / (1 + t_1 s + t_2 s^2) is x + t_1 dx/dt + t_2 d2x/dt2; its force is filtered again. The common
delay t_1 is in k(t) and e(t) already, see ``common_delay``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.signal import cont2discrete, lfilter, lfilter_zi

from herringbone_sim.arrays import Array
from herringbone_sim.gap.observations.law import MeshMotion, law
from herringbone_sim.gap.sensors.filter_delay import CORNER

# t_1 and t_2 times powers of the corner frequency: first order, and Butterworth of second order.
# Others of second order, damping ratio d, are nearly combinations: 2 (2 d^2 - 1) of the first.
FILTERS = ((1.0,), (2.0**0.5, 1.0))
MAX_FILTER_COEFFICIENTS = (2.0, 1.0)  # bounds of both amplitudes, for damping ratios from 0.5 to 1


def with_filter_responses(m: MeshMotion, omega_n: float) -> MeshMotion:
    """Set ``filtered`` of a motion: change of the force by each of ``FILTERS``.

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
    """Motion before a filter with coefficients ``terms`` (t_1 [s], t_2 [s^2]), k(t) advanced."""
    step = float(m.times[1] - m.times[0])
    x, v, slope = m.x, m.v, m.v
    for term in terms:
        x = x + term * slope
        slope = np.gradient(slope, step, axis=0)
        v = v + term * slope
    return replace(m, x=x, v=v, k=m.waves_at(m.phase + m.omega * terms[0]).k)


def _lowpass(values: Array, m: MeshMotion, terms: list[float]) -> Array:
    """Filter values (n, k), in steady state at the first sample."""
    step = float(m.times[1] - m.times[0])
    b, a, _ = cont2discrete(([1.0], [*reversed(terms), 1.0]), step, method="foh")
    start = lfilter_zi(b.ravel(), a)[:, None] * values[:1]
    return np.asarray(lfilter(b.ravel(), a, values, axis=0, zi=start)[0])
