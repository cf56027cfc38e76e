"""Robustness of a controlled motion against differences of left and right.

Three measures: the transverse exponent; the fraction of starts with unequal halves that lead to
the motion, with its interval; and whether the motion persists in a gear whose halves differ.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from herringbone_sim.arrays import Array, Flags
from herringbone_sim.control.runs import MotionRunner, RunSettings
from herringbone_sim.control.starts import Starts, start_states
from herringbone_sim.core.parameters import Parameters, spread
from herringbone_sim.dynamics.basins import random_starts, wilson

SHARES = (0.01, 0.02, 0.05, 0.10)


@dataclass(frozen=True)
class StartShares:
    """Motions reached from random starts with unequal halves at one set of parameters.

    Attributes:
        values: the parameters that vary, by name.
        wanted: mesh cycles (periods of the effects) after which the motion must repeat.
        starts: number of starts.
        reached: number that lead to such a motion with left = right.
        parted: number that lead to such a motion whose halves differ.
        share, low, high: fraction ``reached / starts``, and its 95 % interval (Wilson).
    """

    values: Mapping[str, float]
    wanted: int
    starts: int
    reached: int
    parted: int
    share: float
    low: float
    high: float


@dataclass(frozen=True)
class Survival:
    """Whether a controlled motion persists in a gear whose halves differ.

    Attributes:
        what: parameter that differs, key of ``DIFFERENCES``.
        difference: of the halves, relative; of a phase as a fraction of a mesh cycle.
        wanted: mesh cycles (periods of the effects) after which the motion must repeat.
        period: of the motion from the zero start, in the same unit; 0 = aperiodic, NaN = failed.
        from_zero, from_running: whether such a motion is reached from these starts.
        parted: number of random starts with unequal halves that reach it.
        starts: number of these starts.
        distance: RMS left-right difference [b_c] of the motion from the zero start, else from the
            running gear; NaN if it is reached from neither.
    """

    what: str
    difference: float
    wanted: int
    period: float
    from_zero: bool
    from_running: bool
    parted: int
    starts: int
    distance: float


def _sides(name: str, kinds: int = 2) -> Any:
    """Function from a gear and a difference to changes {name: values} of its halves.

    Left lies above and right below the gear's own values, ``kinds`` times in a row: factors by
    half of the difference, phases [rad] by pi times it.
    """

    def changes(base: Parameters, difference: float) -> dict[str, list[float]]:
        own = spread(getattr(base, name), 2 * kinds)
        half = np.tile([0.5 * difference, -0.5 * difference], kinds)
        changed = own * (1.0 + half) if name.endswith("_factor") else own + 2.0 * np.pi * half
        return {name: [float(value) for value in changed]}

    return changes


DIFFERENCES: dict[str, Callable[[Parameters, float], dict[str, list[float]]]] = {
    "k_factor": _sides("k_factor"),
    "e_factor": _sides("e_factor"),
    "I_s_factor": _sides("I_s_factor", kinds=1),
    "I_p_factor": _sides("I_p_factor", kinds=1),
    "phi_a": _sides("phi_a"),
    "mesh_phase": _sides("mesh_phase"),
}


def start_shares(
    runner: MotionRunner,
    base: Parameters,
    places: Sequence[Mapping[str, float]],
    periods: Sequence[int],
    starts: int,
    settings: RunSettings,
) -> list[StartShares]:
    """Count the random starts with unequal halves that reach each motion, for sets of parameters.

    Args:
        places: sets of changes of the base's parameters.
        periods: periods of the motions, in periods of the effects.
        starts: number of starts, the same states for each set.
        settings: length of the runs.

    Returns:
        For each period the counts of all sets.
    """
    gears = [base.changed(place) for place in places]
    begin = [random_starts(runner.build(g), starts, np.random.default_rng(0)) for g in gears]
    sets = [gear for gear in gears for _ in range(starts)]
    motions = runner.run(sets, np.concatenate(begin), settings)
    alike, forcing = motions.alike.reshape(-1, starts), runner.effect_period(gears[0])
    return [
        _gathered(place, period, int((t & a).sum()), int((t & ~a).sum()), starts)
        for period in periods
        for place, t, a in zip(
            places, motions.repeats(period * forcing).reshape(-1, starts), alike, strict=True
        )
    ]


def _gathered(
    place: Mapping[str, float], wanted: int, reached: int, parted: int, n: int
) -> StartShares:
    return StartShares(place, wanted, n, reached, parted, reached / n, *wilson(reached, n))


def survival(
    runner: MotionRunner,
    base: Parameters,
    wanted: int,
    settings: RunSettings,
    differences: Sequence[float] = SHARES,
    starts: int = 8,
) -> list[Survival]:
    """Test a motion in gears with each kind and size of difference of the halves.

    Args:
        base: the controlled gear with equal halves.
        wanted: periods of the effects (mesh cycles without) after which the motion repeats.
        settings: length of the runs.
        differences: sizes, see ``Survival.difference``.
        starts: number of random starts, beside the zero start and the running gear.
    """
    cases = [(what, size) for what in DIFFERENCES for size in differences]
    gears = [base.changed(DIFFERENCES[what](base, size)) for what, size in cases]
    states = start_states(runner, gears, Starts(alike=0, parted=starts))
    sets = [gear for gear in gears for _ in range(states.shape[1])]
    motions = runner.run(sets, states.reshape(len(sets), -1), settings)
    forcing = runner.effect_period(gears[0])
    period = motions.period.reshape(len(gears), -1) / forcing
    reached = motions.repeats(wanted * forcing).reshape(len(gears), -1)
    asymmetry = motions.asymmetry.reshape(len(gears), -1)
    return [
        _survival(what, size, wanted, *rows)
        for (what, size), *rows in zip(cases, period, reached, asymmetry, strict=True)
    ]


def _survival(
    what: str, size: float, wanted: int, period: Array, reached: Flags, apart: Array
) -> Survival:
    zero, running = bool(reached[0]), bool(reached[1])
    distance = apart[0] if zero else apart[1] if running else np.nan
    counts = (int(reached[2:].sum()), len(reached) - 2)
    return Survival(what, size, wanted, float(period[0]), zero, running, *counts, float(distance))
