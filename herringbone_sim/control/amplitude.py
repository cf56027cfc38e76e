"""The least amplitude K that reaches a wanted period, at each value of another parameter.

"Reaches" is said with its start, because motions coexist, and as three numbers, because what a
control reaches at some K it may lose again above: the least K at which it is reached (perhaps in
a pocket only), the one from which it is reached over 0.1 at least, and the one above which it is
held up to the largest K tried.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.control.runs import Look, Motions, Runs, repeats
from herringbone_sim.control.starts import Starts, start_states
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.dynamics.flow import cycles_of
from herringbone_sim.errors import ParameterError
from herringbone_sim.sweeps.grid import Axis

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Reached = Callable[[NDArray[np.int64], Array], Flags]

FROM = {
    "zero": ("zero",),
    "running": ("running",),
    "alike": ("zero", "running", "alike"),
    "all": ("zero", "running", "alike", "parted"),
}
HALVINGS = 4
FIRM = 0.1  # of K
ROUNDING = 1e-9


@dataclass(frozen=True)
class Staircase:
    """Where along K a motion is reached.

    Attributes:
        least: smallest K at which it is; NaN = at none.
        firm: first K of the first pocket that is at least ``FIRM`` wide; NaN = of none.
        held: smallest K above which it is at all values; NaN = not at the largest.
        pockets: first and last K of each run of values at which it is.
        share: of the values at which it is.
    """

    least: float
    firm: float
    held: float
    pockets: tuple[tuple[float, float], ...]
    share: float


@dataclass(frozen=True)
class Survey:
    """Motions over another parameter, over K, and over starts.

    Attributes:
        base: the gear.
        axis: the other parameter, n values.
        K: (m,) amplitudes, increasing.
        starts: kinds and number, s in all.
        states: (n, s, n_state) what they are.
        look: how long each motion was looked at.
        motions: of all runs, flattened from (n, m, s).
        forcing: mesh cycles after which effects repeat; 1 without.
    """

    base: Parameters
    axis: Axis
    K: Array
    starts: Starts
    states: Array
    look: Look
    motions: Motions
    forcing: int = 1

    def of(self, name: str) -> Array:
        """An attribute of the motions as (n, m, s)."""
        shape = (len(self.axis), len(self.K), len(self.starts.names))
        found: Array = np.asarray(getattr(self.motions, name)).reshape(shape)
        return found

    def reached(self, wanted: int, who: str) -> Flags:
        """Whether all starts of a kind lead to a motion that repeats (n, m), see ``wanted``."""
        chosen = [i for i, name in enumerate(self.starts.names) if name in FROM[who]]
        periods = self.of("period")[:, :, chosen]
        rows = [
            repeats(row, self.wanted_at({self.axis.name: value}, wanted))
            for value, row in zip(self.axis.values, periods, strict=True)
        ]
        return np.asarray(np.all(rows, axis=2), dtype=bool)

    def wanted_at(self, values: Mapping[str, float], wanted: int) -> int:
        """``cycles_wanted`` where these values vary."""
        return cycles_wanted(self.base.changed(values), wanted, self.forcing)


@dataclass(frozen=True)
class Least:
    """Least amplitudes at one value of the other parameter.

    Attributes:
        value: of the other parameter.
        wanted: the motion repeats after so many periods of the forcing.
        who: key of ``FROM``, the starts all of which must lead to it.
        staircase: over K; least, firm and held refined.
        half_width: of the bisection.
    """

    value: float
    wanted: int
    who: str
    staircase: Staircase
    half_width: float


def cycles_wanted(gear: Parameters, wanted: int, forcing: int = 1) -> int:
    """Mesh cycles of so many periods of the forcing; 0 where mesh and control share no period.

    Args:
        forcing: mesh cycles after which effects repeat.
    """
    try:
        return wanted * math.lcm(forcing, cycles_of(gear.control_order))
    except ParameterError:
        return 0


def survey(
    runs: Runs,
    base: Parameters,
    axis: Axis,
    K: Array,
    starts: Starts | None = None,
    look: Look | None = None,
) -> Survey:
    """Run every value of the axis with every K from every start."""
    starts, look = starts or Starts(), look or Look()
    gears = [base.changed({axis.name: value}) for value in axis.values]
    states = start_states(runs, gears, starts)
    sets = [gear.changed({"K": k}) for gear in gears for k in K for _ in starts.names]
    begin = np.repeat(states[:, None], len(K), axis=1).reshape(len(sets), -1)
    motions = runs.observe(sets, begin, look)
    return Survey(base, axis, K, starts, states, look, motions, runs.forcing(gears[0]))


def least_amplitudes(
    runs: Runs, over: Survey, wanted: int, who: str, halvings: int = HALVINGS
) -> list[Least]:
    """Least amplitudes at each value of a survey, refined by bisection.

    Args:
        wanted: periods of the forcing (of mesh and control together) after which the motion
            repeats; a motion of period 1 repeats after 2 and 4 as well.
        who: key of ``FROM``.
        halvings: of the distance between two K of the survey.
    """
    found = over.reached(wanted, who)
    stairs = refined(over.K, found, lambda i, K: _reached(runs, over, wanted, who, i, K), halvings)
    half = float(np.diff(over.K).max()) / 2.0 ** (halvings + 1) if len(over.K) > 1 else 0.0
    values = zip(over.axis.values, stairs, strict=True)
    return [Least(value, wanted, who, one, half) for value, one in values]


def staircase(K: Array, reached: Flags) -> Staircase:
    """Pockets (m,) of one row: where along K a motion is reached."""
    steps = np.diff(np.concatenate([[False], reached, [False]]).astype(int))
    first, last = np.flatnonzero(steps == 1), np.flatnonzero(steps == -1) - 1
    pockets = tuple((float(K[a]), float(K[b])) for a, b in zip(first, last, strict=True))
    least = pockets[0][0] if pockets else np.nan
    firm = next((a for a, b in pockets if b - a >= FIRM - ROUNDING), np.nan)
    held = pockets[-1][0] if pockets and reached[-1] else np.nan
    return Staircase(least, firm, held, pockets, float(np.mean(reached)))


def refined(K: Array, rows: Flags, reached: Reached, halvings: int) -> list[Staircase]:
    """Staircases of many rows (n, m), their three edges bisected, all together.

    Args:
        reached: takes rows (l,) and amplitudes (l,) to whether the motion is reached there.
    """
    stairs = [staircase(K, row) for row in rows]
    edges = [(i, j) for i, one in enumerate(stairs) for j in _edges(K, one)]
    index, above = np.array(edges, dtype=np.int64).reshape(-1, 2).T
    low, high = K[above - 1], K[above]
    for _ in range(halvings if edges else 0):
        middle = (low + high) / 2.0
        there = reached(index, middle)
        low, high = np.where(there, low, middle), np.where(there, middle, high)
    found = {(i, K[j]): value for (i, j), value in zip(edges, (low + high) / 2.0, strict=True)}
    return [
        _moved(one, {k: float(v) for (i, k), v in found.items() if i == row})
        for row, one in enumerate(stairs)
    ]


def _edges(K: Array, stairs: Staircase) -> set[int]:
    """Places of the first K of the pockets that count, except where it is the first of all."""
    ends = [one for one in (stairs.least, stairs.firm, stairs.held) if one > K[0]]
    return {int(np.searchsorted(K, one)) for one in ends}


def _moved(stairs: Staircase, to: Mapping[float, float]) -> Staircase:
    least, firm, held = (to.get(one, one) for one in (stairs.least, stairs.firm, stairs.held))
    return Staircase(least, firm, held, stairs.pockets, stairs.share)


def _reached(
    runs: Runs, over: Survey, wanted: int, who: str, index: NDArray[np.int64], K: Array
) -> Flags:
    """Whether all starts lead there at values (l,) of the axis and amplitudes (l,)."""
    chosen = [i for i, name in enumerate(over.starts.names) if name in FROM[who]]
    gears = [
        over.base.changed({over.axis.name: over.axis.values[i], "K": float(k)})
        for i, k in zip(index, K, strict=True)
    ]
    starts = over.states[index][:, chosen].reshape(len(gears) * len(chosen), -1)
    sets = [gear for gear in gears for _ in chosen]
    periods = runs.observe(sets, starts, over.look).period.reshape(len(gears), -1)
    cycles = [cycles_wanted(gear, wanted, over.forcing) for gear in gears]
    rows = [repeats(row, one) for row, one in zip(periods, cycles, strict=True)]
    return np.asarray(np.all(rows, axis=1), dtype=bool)


def windows(K: Array, periods: Array) -> list[tuple[int, float, float]]:
    """Runs of one period along K (m,): period (0 aperiodic), first and last K; failed left out."""
    edges = [0, *(np.flatnonzero(np.diff(periods)) + 1), len(K)]
    return [
        (int(periods[a]), float(K[a]), float(K[b - 1]))
        for a, b in pairwise(edges)
        if np.isfinite(periods[a])
    ]
