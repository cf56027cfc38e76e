"""What a filter that all channels pass does to the force law.

It delays and smooths displacements and forces alike, but the force of a smoothed displacement is
not the smoothed force: k(t) and the edges of the backlash lie between. The displacement before a
low-pass 1 + t_1 s + t_2 s^2 is x + t_1 dx/dt + t_2 d2x/dt2; its force is passed through the filter
again. The common delay t_1 is in k(t) and e(t) already, see ``common_delay``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter, lfilter_zi

from herringbone_sim.gap.observations.law import Motion, law
from herringbone_sim.gap.sensors.filter_delay import CORNER

Array = NDArray[np.float64]

# t_1 and t_2 times powers of the corner: a filter of first order, and Butterworth's of second.
# Others of second order, damping ratio d, act as 2 (2 d^2 - 1) of the first and some of the last.
FILTERS = ((1.0,), (2.0**0.5, 1.0))
MOST = (2.0, 1.0)  # of each, for damping ratios from one half to one


def with_filters(m: Motion, omega_n: float) -> Motion:
    """A motion between samples with what each of ``FILTERS`` does to its forces.

    Args:
        m: its x and v as they were recorded.
        omega_n: natural frequency [rad/s].
    """
    plain = law(m).force
    corner = CORNER * omega_n
    shown = []
    for over_corner in FILTERS:
        terms = [t / corner ** (i + 1) for i, t in enumerate(over_corner)]
        shown.append(_passed(law(_before(m, terms)).force, m, terms) - plain)
    return replace(m, filtered=np.stack(shown))


def _before(m: Motion, terms: list[float]) -> Motion:
    """The motion before a filter; k(t) is that of the time before it."""
    step = float(m.times[1] - m.times[0])
    x, v, slope = m.x, m.v, m.v
    for term in terms:
        x = x + term * slope
        slope = np.gradient(slope, step, axis=0)
        v = v + term * slope
    return replace(m, x=x, v=v, k=m.waves_at(m.phase + m.omega * terms[0]).k)


def _passed(values: Array, m: Motion, terms: list[float]) -> Array:
    """Values (n, k) behind a filter that was at rest at the first of them."""
    step = float(m.times[1] - m.times[0])
    b, a, _ = cont2discrete(([1.0], [*reversed(terms), 1.0]), step, method="foh")
    start = lfilter_zi(b.ravel(), a)[:, None] * values[:1]
    return np.asarray(lfilter(b.ravel(), a, values, axis=0, zi=start)[0])
