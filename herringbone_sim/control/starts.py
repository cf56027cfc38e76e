"""Initial states from which a control is tested."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.control.runs import MotionRunner, RunSettings
from herringbone_sim.core.model import initial_state, state, with_added_states
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.dynamics.basins import random_starts

SETTLE = RunSettings(transient=800, cycles=1)


@dataclass(frozen=True)
class Starts:
    """Kinds and numbers of states at phase 0 at which a control is switched on.

    ``zero``: the initial state of the gear, which the paper seems to use. ``running``: the state
    without control after the whole periods of the effects that contain 800 mesh cycles, and one
    more. ``alike``: random with left = right. ``parted``: random, left and right drawn
    independently. Random states are the same for every gear: displacements up to b_c, and rates
    up to b_c omega_n.

    Attributes:
        alike, parted: number of states of these kinds.
        running: whether to include ``running``.
    """

    alike: int = 2
    parted: int = 2
    running: bool = True

    @property
    def names(self) -> tuple[str, ...]:
        """Kind of each start, in the order of ``start_states``."""
        running = ("running",) * self.running
        return ("zero", *running, *("alike",) * self.alike, *("parted",) * self.parted)


def start_states(runner: MotionRunner, sets: Sequence[Parameters], starts: Starts) -> Array:
    """States (n, n_start, n_state) at phase 0 of n gears, in the order of ``Starts.names``.

    At all of them the effects, if they have a period, are at the phase of mesh cycle 0. NaN where
    the run without control failed, or no gear can have the parameters; ParameterError if none can.
    """
    every = [runner.built(p) for p in sets]
    there = [model is not None for model in every]
    if not any(there):
        runner.build(sets[0])  # raises with the reason
    models = [model for model in every if model is not None]
    known = [p for p, built in zip(sets, there, strict=True) if built]
    columns = [np.array([initial_state(model) for model in models])]
    if starts.running:
        free = [p.changed({"K": 0.0}) for p in known]
        period = runner.effect_period(known[0])
        settings = replace(SETTLE, transient=-(-SETTLE.transient // period) * period)
        columns.append(runner.run(free, columns[0], settings).end)
    rng = np.random.default_rng(0)
    n_class = models[0].layout.n_classes
    for _ in range(starts.alike):
        x, v = np.tile(rng.uniform(-1.0, 1.0, (2, 2, 1, n_class)), (1, 1, 2, 1))
        columns.append(np.array([state(model, x.ravel(), v.ravel(), 0.0) for model in models]))
    for i in range(starts.parted):
        draws = (np.random.default_rng([0, 1 + i]) for _ in models)
        pairs = zip(models, draws, strict=True)
        columns.append(np.array([random_starts(m, 1, g)[0] for m, g in pairs]))
    # States that effects add are at rest, unless the gear was running.
    states = np.stack([with_added_states(models[0], states) for states in columns], axis=1)
    whole = np.full((len(sets), *states.shape[1:]), np.nan)
    whole[there] = states
    return whole
