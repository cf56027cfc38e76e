"""Orders of the planets in fitted windows.

Channels of suns and carrier do not tell the planets of a side apart, so the states of a run are
fitted with its planets in an arbitrary order, left and right apart. See ``diagnosis.orders``.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.arrays import Indices
from herringbone_sim.core.layout import Layout
from herringbone_sim.diagnosis.machine import Amplitudes
from herringbone_sim.diagnosis.parallel import parallel_map
from herringbone_sim.gap.observations.gear import GearObservations
from herringbone_sim.gap.observations.windows import trajectory

ROUNDS = 2  # Levenberg-Marquardt steps in which an order is tried; chosen for run time


def orders(layout: Layout) -> list[Indices]:
    """Every order of the planets on both sides: (bodies,) indices, the present order first."""
    n = layout.n_classes
    sides = list(permutations(range(n)))
    return [
        np.array([0, 1, 2, *(3 + p for p in left), *(3 + n + p for p in right)])
        for left, right in product(sides, sides)
    ]


def renaming(layout: Layout, order: Indices, functions: Sequence[str]) -> dict[str, str]:
    """Names of functions of meshes, ``NAME of MESH``, and of those that replace them in an order.

    The meshes of the planet at a place become those of the planet that takes it.
    """
    planets = order[3:] - 3
    meshes = np.concatenate([planets, len(planets) + planets])
    names = {}
    for name in functions:
        head, _, mesh = name.rpartition(" of ")
        if head and mesh.isdecimal():
            names[name] = f"{head} of {meshes[int(mesh)]}"
    return names


def reorderable(gear: GearObservations) -> NDArray[np.bool_]:
    """(runs,) whether planets are out of step, and every order fits the nominal law as well."""
    every = orders(gear.model.layout)

    def is_free(r: int) -> bool:
        if not gear.has_windows_of(r):
            return False
        of_run = gear.trajectory_of(r)
        return of_run.is_out_of_step() and all(map(of_run.is_alike, every))

    return np.array(parallel_map(is_free, range(len(gear.runs))), dtype=bool)


def best_orders(gear: GearObservations, amplitudes: Amplitudes) -> list[Indices]:
    """The order of the planets of each run that amplitudes fit best; as it is for fitted runs.

    One side after the other, each from the order found so far. Where amplitudes do not tell
    planets apart, all stay as they are.
    """
    layout = gear.model.layout
    every = orders(layout)
    best = [every[0]] * len(gear.runs)
    of = amplitudes.get(trajectory.NAME, {})
    renamings = [renaming(layout, order, list(of)) for order in every]
    if all(np.array_equal(of[f], of.get(g, 0.0)) for x in renamings for f, g in x.items()):
        return best
    fresh = [
        gear.has_windows_of(r) and not gear.trajectory_of(r).is_fitted
        for r in range(len(gear.runs))
    ]
    n = layout.n_classes
    for r in np.flatnonzero(reorderable(gear) & fresh).tolist():
        of_run = gear.trajectory_of(r)
        for side in (slice(3, 3 + n), slice(3 + n, None)):
            rest = np.delete(np.arange(len(every[0])), side)
            others = [o for o in every if np.array_equal(o[rest], best[r][rest])]
            costs = [gear.chi2_from(r, of_run.in_order(o), amplitudes, ROUNDS) for o in others]
            best[r] = others[int(np.argmin(costs))]
    return best
