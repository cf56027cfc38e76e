"""States of a gear from few channels: an unscented filter, and what it is surprised at.

S. J. Julier, J. K. Uhlmann, Proc. IEEE 92 (2004) 401: 2 d sigma points carry mean and covariance
through the exact law, kinks and all. It starts far apart, so a motion that nobody saw the
beginning of is found, and it is drawn to the samples, so chaos does not carry it away. Planets are
identical here and move in step: nothing tells their differences.

With the gains kept, the innovations of a gear with other parameters or effects are a matter of one
run of its mean: that is what an attribution regresses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.gear import pointers_allowed
from herringbone_sim.errors import AnalysisError
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.filtering.gear import Gear, gear_of, reduced, seen
from herringbone_sim.gap.filtering.kernel import drawn, unscented

Array = NDArray[np.float64]

SIZE = 10  # q_L, q_R, r_L, r_R, their rates, rigid rotation and its rate
STEP = 0.15  # of the method in dimensionless time
APART = 2.0  # of a coordinate [b_c] and a rate [b_c omega_n] at the start


class _Out(NamedTuple):
    gain: Array
    spread: Array
    innovation: Array
    state: Array


class _Points(NamedTuple):
    points: Array
    root: Array
    line: Array


@dataclass(frozen=True)
class Filtered:
    """A run as the filter saw it; k channels that are there, d = 10 states.

    Attributes:
        gain: (n, d, k) of each channel in turn. spread: (n, k) of the innovations [SI].
        innovation: (n, k) measured minus expected, each after the channels before it.
        state: (n, d) dimensionless.
        first: (d,) state at the first sample, before any channel.
    """

    gain: Array
    spread: Array
    innovation: Array
    state: Array
    first: Array

    @property
    def white(self) -> Array:
        """Innovations (n, k) over their spread: white and of variance 1 where the model holds."""
        white: Array = self.innovation / self.spread
        return white


def steps_of(run: PreparedRun) -> int:
    """Steps of the method between two samples."""
    turn = float(np.median(np.diff(run.phase)))
    Omega = run.omega_rad_per_s / run.model.scales.omega_n
    return max(int(np.ceil(turn / Omega / STEP)), 1)


def filtered(run: PreparedRun, factors: Array, inverse: Array, unsteady: Array) -> Filtered:
    """Filter a run with the calibrated gear.

    Args:
        factors, inverse: (6,) and (3,) calibration.
        unsteady: (10,) standard deviation that each state gains between samples.

    Raises:
        AnalysisError: no channel of x, v or u.
    """
    gear = gear_of(run, reduced(run.model), factors, inverse)
    values, noise = seen(run)
    if not noise.size:
        raise AnalysisError(
            f"{run.name} has no channel of x, v or u, so no motion to filter: record u_s and u_c"
        )
    n, k = values.shape
    out = _Out(np.zeros((n, SIZE, k)), np.ones((n, k)), np.zeros((n, k)), np.zeros((n, SIZE)))
    y, P = gear.start.copy(), np.diag(np.full(SIZE, APART**2))
    P[8, 8] = P[9, 9] = 0.3**2
    first = y.copy()
    points = _Points(np.zeros((2 * SIZE, SIZE)), np.zeros((SIZE, SIZE)), np.zeros(SIZE))
    with pointers_allowed():
        unscented(
            *head(gear),
            run.phase,
            steps_of(run),
            gear.H,
            values,
            noise,
            unsteady**2,
            y,
            P,
            points,
            gear.w,
            gear.g,
            out,
        )
    return Filtered(*out[:3], out.state, first)


def innovations(
    run: PreparedRun,
    by: Filtered,
    factors: Array,
    inverse: Array,
    actives: Sequence[Active] = (),
    full: bool = False,
) -> Array:
    """Innovations (n, k) over their spread, of another gear that is drawn by the same gains.

    Args:
        full: planets apart, for effects that tell them apart.
    """
    model = run.model if full else reduced(run.model)
    gear = gear_of(run, model, factors, inverse, actives)
    values, _ = seen(run)
    left = np.empty_like(values)
    with pointers_allowed():
        drawn(
            *head(gear),
            run.phase,
            steps_of(run),
            gear.H,
            values,
            by.gain,
            gear.to,
            gear.start.copy(),
            gear.w,
            gear.g,
            left,
        )
    white: Array = left / by.spread
    return white


def head(g: Gear) -> tuple[object, ...]:
    return g.laws.kernel, g.laws.site, g.laws.theta, g.table, g.packed, g.si, g.push, g.now
