"""Trajectories with derivatives by the start state and by parameters, for fits by shooting."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.arrays import Array
from herringbone_sim.core.integrate import Stepper
from herringbone_sim.core.model import Model
from herringbone_sim.core.sensitivity import Direction, in_units_of, need_series
from herringbone_sim.effects.sensitivity import directions

NUDGE = 1e-6  # b_c or b_c omega_n: half of the central difference of states in ``by_reading``


@dataclass(frozen=True)
class Trajectory:
    """Samples and their derivatives with respect to the first state and to p parameters.

    States are dimensionless (b_c, b_c omega_n).

    Attributes:
        model: the gear with all named effects.
        directions: the p parameters theta.
        states: (n, n_state) at each sample.
        transition: (n, n_state, n_state) dy/dy(first sample).
        columns: (n, p, n_state) dy/dtheta at the same mesh phase, see ``core.sensitivity``.
        grid_points: (n, 2) mesh cycle and grid step of each sample.
    """

    model: Model
    directions: tuple[Direction, ...]
    states: Array
    transition: Array
    columns: Array
    grid_points: NDArray[np.int64]

    @cached_property
    def rows(self) -> Array:
        """(n, n_channels) samples as ``Layout.channels``, SI units; t from mesh cycle 0 on."""
        return Stepper(self.model).read(self.states, self.grid_points)

    @cached_property
    def by_reading(self) -> Array:
        """(n, n_channels, n_state) derivatives of each sample [SI] by the state at it."""
        stepper, n = Stepper(self.model), self.model.n_state
        moved = NUDGE * np.eye(n)[:, None, :]
        sides = [
            [stepper.read(self.states + s * nudge, self.grid_points) for nudge in moved]
            for s in (1, -1)
        ]
        derivatives: Array = np.subtract(*np.array(sides)).transpose(1, 2, 0) / (2.0 * NUDGE)
        return derivatives

    @cached_property
    def by_start(self) -> Array:
        """(n, n_channels, n_state) derivatives of ``rows`` [SI] by the first state."""
        derivatives: Array = self.by_reading @ self.transition
        return derivatives

    @cached_property
    def by_parameters(self) -> Array:
        """(n, n_channels, p) derivatives of ``rows`` by the parameters, first state fixed."""
        direct = [self._direct(direction) for direction in self.directions]
        through = self.by_reading @ self.columns.transpose(0, 2, 1)
        total: Array = through + np.array(direct).reshape(-1, *self.rows.shape).transpose(1, 2, 0)
        return total

    def _direct(self, direction: Direction) -> Array:
        """Return the derivative (n, n_channels) of ``rows`` by a parameter, SI states fixed."""
        sides = []
        for gear in (direction.plus, direction.minus):
            states = in_units_of(gear, self.model, self.states)
            sides.append(Stepper(gear).read(states, self._grid_points_in(gear)))
        whole: Array = (sides[0] - sides[1]) / (2.0 * direction.step)
        return whole

    def _grid_points_in(self, gear: Model) -> NDArray[np.int64]:
        """Return ``grid_points`` of the same mesh phases on the grid of another gear."""
        steps, others = self.model.parameters.steps, gear.parameters.steps
        grid_points: NDArray[np.int64] = (
            self.grid_points * np.array([1, others]) // np.array([1, steps])
        )
        return grid_points


def trajectory(
    model: Model,
    y: Array,
    n_samples: int,
    names: Sequence[str] = (),
    cycle: int = 0,
    sample: int = 0,
) -> Trajectory:
    """Integrate from a state, with derivatives by that state and by named parameters.

    Args:
        y: (n_state,) dimensionless state of the first sample.
        names: parameters to differentiate by, as in ``effects.sensitivity``.
        cycle, sample: mesh cycle of ``y`` and sample within that cycle.

    Raises:
        ParameterError: an unknown name, ``method: rk4``, or effects by their own laws.
    """
    need_series(model, "derivatives")
    gear, along = directions(model, names)
    stepper, p = Stepper(gear, along), gear.parameters
    begin = stepper.start(gear.n_state)
    now = replace(
        begin,
        y=np.array(y, dtype=float),
        cycle=cycle,
        index=sample * (p.steps // p.samples_per_cycle),
        tangents=np.eye(gear.n_state),
    )
    states, tangents, columns, grid_points = stepper.trace(now, n_samples)
    return Trajectory(
        gear, tuple(along), states, tangents.transpose(0, 2, 1), columns, grid_points
    )
