"""Does a controlled motion bear that left and right are not alike?

Three questions: do small differences of the two halves die out (transverse exponent), do starts
with unlike halves lead to the wanted motion (share with interval), and does the motion survive in
a gear whose halves are made unlike.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.control.amplitude import Survey, survey
from herringbone_sim.control.runs import Look, Runs, repeats
from herringbone_sim.control.starts import Starts, start_states
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.dynamics.basins import random_starts, wilson
from herringbone_sim.sweeps.grid import Axis

Array = NDArray[np.float64]

SHARES = (0.01, 0.02, 0.05, 0.10)


@dataclass(frozen=True)
class Gathered:
    """Where random starts with unlike halves lead to at one set of parameters.

    Attributes:
        values: the parameters that vary, by name.
        wanted: the motion repeats after so many mesh cycles, or periods of the effects.
        starts: how many.
        reached: how many repeat so, left and right alike.
        parted: how many repeat so, left and right apart.
        share, low, high: of ``reached``, and its 95 % interval (Wilson).
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
    """What becomes of a controlled motion in a gear whose halves differ.

    Attributes:
        what: key of ``DIFFERENCES``.
        difference: of the halves: a share, of a phase the share of a mesh cycle.
        wanted: the motion is to repeat after so many mesh cycles, or periods of the effects.
        period: of the motion from the zero start, in the same; 0 aperiodic, NaN failed.
        from_zero, from_running: whether it repeats so, from these starts.
        parted: how many of so many random starts with unlike halves lead to it.
        starts: how many these were.
        distance: RMS of left less right [b_c] of the motion that repeats, from zero or else from
            the running gear; NaN where neither reached it.
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


def _sides(name: str, scale: float = 1.0, centre: float = 1.0, kinds: int = 2) -> Any:
    """Changes that set a parameter of the halves apart by a difference, its mean kept."""

    def changes(difference: float) -> dict[str, list[float]]:
        half = 0.5 * scale * difference
        return {name: [centre + half, centre - half] * kinds}

    return changes


DIFFERENCES: dict[str, Callable[[float], dict[str, list[float]]]] = {
    "k_factor": _sides("k_factor"),
    "e_factor": _sides("e_factor"),
    "I_s_factor": _sides("I_s_factor", kinds=1),
    "I_p_factor": _sides("I_p_factor", kinds=1),
    "phi_a": _sides("phi_a", 2.0 * np.pi, 0.0),
    "mesh_phase": _sides("mesh_phase", 2.0 * np.pi, 0.0),
}


def transverse_map(runs: Runs, base: Parameters, axis: Axis, K: Array, look: Look) -> Survey:
    """Motions within left-right symmetry from the zero start, with their transverse exponents."""
    return survey(runs, base, axis, K, Starts(0, 0, running=False), look)


def gathered(
    runs: Runs,
    base: Parameters,
    places: Sequence[Mapping[str, float]],
    wanted: Sequence[int],
    starts: int,
    look: Look,
    seed: int = 0,
) -> list[Gathered]:
    """How many of the same random starts with unlike halves reach each motion at each place."""
    gears = [base.changed(place) for place in places]
    begin = [random_starts(runs.build(g), starts, np.random.default_rng(seed)) for g in gears]
    sets = [gear for gear in gears for _ in range(starts)]
    motions = runs.observe(sets, np.concatenate(begin), look)
    alike, forcing = motions.alike.reshape(-1, starts), runs.forcing(gears[0])
    return [
        _gathered(place, one, int((t & a).sum()), int((t & ~a).sum()), starts)
        for one in wanted
        for place, t, a in zip(
            places, motions.repeats(one * forcing).reshape(-1, starts), alike, strict=True
        )
    ]


def _gathered(
    place: Mapping[str, float], wanted: int, reached: int, parted: int, n: int
) -> Gathered:
    return Gathered(place, wanted, n, reached, parted, reached / n, *wilson(reached, n))


def survival(
    runs: Runs,
    base: Parameters,
    wanted: int,
    look: Look,
    differences: Sequence[float] = SHARES,
    starts: int = 8,
) -> list[Survival]:
    """Survival of the motion under each kind and size of difference.

    Args:
        base: the controlled gear with equal halves.
        wanted: mesh cycles after which the motion repeats.
        look: how long each motion is looked at.
        differences: of the halves.
        starts: random ones, beside the zero start and the running gear.
    """
    cases = [(what, size) for what in DIFFERENCES for size in differences]
    gears = [base.changed(DIFFERENCES[what](size)) for what, size in cases]
    states = start_states(runs, gears, Starts(alike=0, parted=starts))
    sets = [gear for gear in gears for _ in range(states.shape[1])]
    motions = runs.observe(sets, states.reshape(len(sets), -1), look)
    period = motions.period.reshape(len(gears), -1) / runs.forcing(gears[0])
    asymmetry = motions.asymmetry.reshape(len(gears), -1)
    return [
        _survival(what, size, wanted, p, a)
        for (what, size), p, a in zip(cases, period, asymmetry, strict=True)
    ]


def _survival(what: str, size: float, wanted: int, period: Array, apart: Array) -> Survival:
    there = repeats(period, wanted)
    zero, running = bool(there[0]), bool(there[1])
    distance = apart[0] if zero else apart[1] if running else np.nan
    counts = (int(there[2:].sum()), len(there) - 2)
    seen = (float(period[0]), zero, running, *counts)
    return Survival(what, size, wanted, *seen, float(distance))
