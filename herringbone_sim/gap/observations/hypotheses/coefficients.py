"""Build coefficients: their weights on the functions and rows of a gear's observations."""

from __future__ import annotations

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.diagnosis.coefficients import Coefficient, Placement
from herringbone_sim.gap.observations import force_law, torque_balance
from herringbone_sim.gap.observations.gear import GearObservations
from herringbone_sim.gap.observations.windows import trajectory
from herringbone_sim.gap.residuals.torque_balance import inertia_parts

DEPARTURE_SHARE = 0.25  # prior SD of a departure over the size of the effect; chosen
Weights = dict[str | tuple[str, str], float | Array]


class CoefficientBuilder:
    """Builds coefficients for the observations of a gear.

    A function of the force law also acts in the balance, through meshes without recorded force,
    and in the trajectory observation; weights for these are added here.
    """

    def __init__(self, gear: GearObservations) -> None:
        self.gear = gear
        self.runs = len(gear.runs)
        self._reach = inertia_parts(gear.model).sum(0)

    @property
    def window_observation(self) -> tuple[str, ...]:
        """Tuple of the name of the trajectory observation; empty if it is not formed."""
        return (trajectory.NAME,) if self.gear.uses_windows else ()

    def coefficient(
        self, name: str, weights: Weights, sd: float, bound: float = np.inf, center: float = 0.0
    ) -> Coefficient:
        """Return a coefficient with given weights and those that follow from them.

        Args:
            weights: by function of the force law, or by (observation, function): amplitude of the
                function for a coefficient of 1; a number, (rows,) or (runs, rows).
            sd, bound, center: see ``Coefficient``.
        """
        placed: dict[str, list[tuple[int, str, Array]]] = {}
        for key, weight in weights.items():
            o, function = (force_law.NAME, key) if isinstance(key, str) else key
            self._append(placed, o, function, np.asarray(weight, dtype=float))
        parts = {
            o: Placement(
                tuple(row for row, _, _ in all_),
                tuple(f for _, f, _ in all_),
                np.array([w for _, _, w in all_]).T.reshape(self.runs, -1),
            )
            for o, all_ in placed.items()
        }
        return Coefficient(name, sd, bound, parts, center)

    def _append(
        self, placed: dict[str, list[tuple[int, str, Array]]], o: str, function: str, weight: Array
    ) -> None:
        """Append (row, function, weights (runs,)), and those that follow, to ``placed``."""
        rows = self.rows(o)
        w = np.broadcast_to(weight, (self.runs, rows))
        for row in np.flatnonzero(w[0] if weight.ndim < 2 else w.any(axis=0)):
            placed.setdefault(o, []).append((int(row), function, w[:, row]))
            if o == force_law.NAME and self.gear.uses_windows:
                at = f"{function} of {row}"
                placed.setdefault(trajectory.NAME, []).append((0, at, w[:, row]))
            if (
                o == force_law.NAME
                and self.gear.modelled[row]
                and not force_law.of_force_sensor(function)
            ):
                at = f"{function} of {row}"
                for z in np.flatnonzero(self._reach[:, row]):
                    entry = (int(z), at, self._reach[z, row] * w[:, row])
                    placed.setdefault(torque_balance.NAME, []).append(entry)

    def rows(self, o: str) -> int:
        """Number of rows of observation ``o``."""
        if o == force_law.NAME:
            return self.gear.model.layout.n_mesh
        if o == trajectory.NAME:
            return 1
        return (
            self.gear.model.layout.n_coordinate
            if o == torque_balance.NAME
            else self.gear.n_relations
        )
