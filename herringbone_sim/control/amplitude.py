"""The least amplitude K at which a motion of a target period is reached, over another parameter.

Motions coexist, so a target names the starts from which the motion must be reached. A motion that
a control reaches at some K may be lost again at a larger K, so there are three numbers: the least
K, the least K of a range at least 0.1 wide, and the least K above which the motion is always
reached.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from herringbone_sim.arrays import Array, Flags, Indices
from herringbone_sim.control.runs import MotionRunner, Motions, RunSettings, repeats
from herringbone_sim.control.starts import Starts, start_states
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.dynamics.flow import cycles_of
from herringbone_sim.errors import ParameterError
from herringbone_sim.sweeps.grid import Axis

START_GROUPS = {  # kinds of starts, see ``Starts``, by name of the group
    "zero": ("zero",),
    "running": ("running",),
    "alike": ("zero", "running", "alike"),
    "all": ("zero", "running", "alike", "parted"),
}
HALVINGS = 4
FIRM = 0.1  # least width in K of a firm range
ROUNDING = 1e-9


@dataclass(frozen=True)
class Target:
    """A motion that a control shall reach.

    Attributes:
        period: the motion repeats after so many periods of the forcing (of mesh and control
            together); a motion of period 1 also fulfils 2.
        starts: key of ``START_GROUPS``; the motion must be reached from all of these starts.
    """

    period: int
    starts: str


@dataclass(frozen=True)
class Staircase:
    """Amplitudes K at which a motion is reached.

    Attributes:
        least: smallest of them; NaN = none.
        firm: first K of the first pocket at least ``FIRM`` wide; NaN = no such pocket.
        held: smallest K above which it is reached at all values; NaN = not at the largest.
        pockets: first and last K of each range in which it is reached.
        share: fraction of the values of K at which it is reached.
    """

    least: float
    firm: float
    held: float
    pockets: tuple[tuple[float, float], ...]
    share: float


@dataclass(frozen=True)
class Survey:
    """Motions over another parameter (n values), K (m) and starts (s).

    Attributes:
        base: the gear.
        axis: values of the other parameter.
        K: (m,) amplitudes, increasing.
        starts: kinds and number of starts.
        states: (n, s, n_state) states at phase 0 at which the control is switched on.
        settings: length of the runs.
        motions: of the n m s runs, in this order.
        forcing: period of the effects in mesh cycles; 1 without effects.
    """

    base: Parameters
    axis: Axis
    K: Array
    starts: Starts
    states: Array
    settings: RunSettings
    motions: Motions
    forcing: int = 1

    def of(self, name: str) -> Array:
        """An attribute of ``Motions`` by name, as an array (n, m, s)."""
        shape = (len(self.axis), len(self.K), len(self.starts.names))
        return np.asarray(getattr(self.motions, name)).reshape(shape)

    def columns(self, target: Target) -> list[int]:
        """Indices of the starts from which a target must be reached."""
        kinds = START_GROUPS[target.starts]
        return [i for i, name in enumerate(self.starts.names) if name in kinds]

    def reached(self, target: Target) -> Flags:
        """(n, m) whether the target is reached from all of its starts."""
        repeated = self.repeats(target.period)[:, :, self.columns(target)]
        return np.asarray(repeated.all(axis=2), dtype=bool)

    def repeats(self, period: int) -> Flags:
        """(n, m, s) whether each motion repeats after some periods of the forcing."""
        cycles = np.where(self.K == 0.0, self.forcing, self.forcing_cycles[:, None])
        return repeats(self.of("period"), period * cycles[:, :, None])

    @cached_property
    def forcing_cycles(self) -> Indices:
        """(n,) period of effects and control together [mesh cycles]; 0 if they have none."""
        gears = (self.base.changed({self.axis.name: value}) for value in self.axis.values)
        return np.array([target_cycles(gear, 1, self.forcing) for gear in gears])


@dataclass(frozen=True)
class LeastAmplitude:
    """Least amplitudes at one value of the other parameter.

    Attributes:
        value: of the other parameter.
        target: motion to reach.
        staircase: over K; least, firm and held are refined by bisection.
        half_width: uncertainty of these three numbers.
    """

    value: float
    target: Target
    staircase: Staircase
    half_width: float


def target_cycles(gear: Parameters, period: int, forcing: int = 1) -> int:
    """Mesh cycles in ``period`` periods of the forcing, that of effects and control together.

    0 if they have no common period.

    Args:
        forcing: period of the effects in mesh cycles.
    """
    try:
        return period * math.lcm(forcing, cycles_of(gear.control_order))
    except ParameterError:
        return 0


def run_survey(
    runner: MotionRunner,
    base: Parameters,
    axis: Axis,
    K: Array,
    starts: Starts | None = None,
    settings: RunSettings | None = None,
) -> Survey:
    """Integrate the gear at every value of the axis with every K (m,) from every start."""
    starts, settings = starts or Starts(), settings or RunSettings()
    gears = [base.changed({axis.name: value}) for value in axis.values]
    states = start_states(runner, gears, starts)
    sets = [gear.changed({"K": k}) for gear in gears for k in K for _ in starts.names]
    begin = np.repeat(states[:, None], len(K), axis=1).reshape(len(sets), -1)
    motions = runner.run(sets, begin, settings)
    return Survey(base, axis, K, starts, states, settings, motions, runner.effect_period(gears[0]))


def least_amplitudes(runner: MotionRunner, survey: Survey, target: Target) -> list[LeastAmplitude]:
    """Find the least amplitudes that reach a target, at each value of the axis of a survey.

    ``HALVINGS`` bisections refine the distance between two K of the survey.
    """
    K = survey.K
    stairs = refined(
        K, survey.reached(target), lambda i, k: _reached(runner, survey, target, i, k), HALVINGS
    )
    half = float(np.diff(K).max()) / 2.0 ** (HALVINGS + 1) if len(K) > 1 else 0.0
    pairs = zip(survey.axis.values, stairs, strict=True)
    return [LeastAmplitude(value, target, stair, half) for value, stair in pairs]


def staircase(K: Array, reached: Flags) -> Staircase:
    """Staircase from amplitudes (m,) and flags (m,) whether the motion is reached."""
    steps = np.diff(np.concatenate([[False], reached, [False]]).astype(int))
    first, last = np.flatnonzero(steps == 1), np.flatnonzero(steps == -1) - 1
    pockets = tuple((float(K[a]), float(K[b])) for a, b in zip(first, last, strict=True))
    least = pockets[0][0] if pockets else np.nan
    firm = next((a for a, b in pockets if b - a >= FIRM - ROUNDING), np.nan)
    held = pockets[-1][0] if pockets and reached[-1] else np.nan
    return Staircase(least, firm, held, pockets, float(np.mean(reached)))


def refined(
    K: Array, rows: Flags, reached: Callable[[Indices, Array], Flags], halvings: int
) -> list[Staircase]:
    """Staircases of n rows, with their edges least, firm and held bisected, all rows together.

    Args:
        K: (m,) amplitudes.
        rows: (n, m) whether the motion is reached.
        reached: function of row indices (l,) and amplitudes (l,) that tells whether it is reached.
        halvings: number of bisections.
    """
    stairs = [staircase(K, row) for row in rows]
    edges = [(i, j) for i, stair in enumerate(stairs) for j in _edges(K, stair)]
    index, above = np.array(edges, dtype=np.int64).reshape(-1, 2).T
    low, high = K[above - 1], K[above]
    for _ in range(halvings if edges else 0):
        middle = (low + high) / 2.0
        inside = reached(index, middle)
        low, high = np.where(inside, low, middle), np.where(inside, middle, high)
    moved = {(i, K[j]): value for (i, j), value in zip(edges, (low + high) / 2.0, strict=True)}
    return [
        _moved(stair, {k: float(v) for (i, k), v in moved.items() if i == row})
        for row, stair in enumerate(stairs)
    ]


def _edges(K: Array, stair: Staircase) -> set[int]:
    """Indices into K of least, firm and held, except 0: there is nothing to bisect below."""
    ends = [edge for edge in (stair.least, stair.firm, stair.held) if edge > K[0]]
    return {int(np.searchsorted(K, edge)) for edge in ends}


def _moved(stair: Staircase, to: Mapping[float, float]) -> Staircase:
    least, firm, held = (to.get(edge, edge) for edge in (stair.least, stair.firm, stair.held))
    return Staircase(least, firm, held, stair.pockets, stair.share)


def _reached(
    runner: MotionRunner, survey: Survey, target: Target, index: Indices, K: Array
) -> Flags:
    """(l,) whether a target is reached at indices (l,) of the axis with amplitudes K (l,)."""
    columns = survey.columns(target)
    gears = [
        survey.base.changed({survey.axis.name: survey.axis.values[i], "K": float(k)})
        for i, k in zip(index, K, strict=True)
    ]
    starts = survey.states[index][:, columns].reshape(len(gears) * len(columns), -1)
    sets = [gear for gear in gears for _ in columns]
    periods = runner.run(sets, starts, survey.settings).period.reshape(len(gears), -1)
    cycles = [target_cycles(gear, target.period, survey.forcing) for gear in gears]
    rows = [repeats(row, n) for row, n in zip(periods, cycles, strict=True)]
    return np.asarray(np.all(rows, axis=1), dtype=bool)


def windows(K: Array, periods: Array) -> list[tuple[int, float, float]]:
    """Ranges of successive control amplitudes with equal period: period, first and last K.

    Args:
        K: (m,) control amplitudes, ascending.
        periods: (m,) period of the motion at each K [mesh cycles]; 0 = aperiodic. NaN (a run
            failed, or has too few points to tell) belongs to no range and ends one.
    """
    edges = [0, *(np.flatnonzero(np.diff(periods)) + 1), len(K)]
    return [
        (int(periods[a]), float(K[a]), float(K[b - 1]))
        for a, b in pairwise(edges)
        if np.isfinite(periods[a])
    ]
