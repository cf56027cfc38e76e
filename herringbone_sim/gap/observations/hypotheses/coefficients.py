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
        every = inertia_parts(gear.model).sum(0).T
        self._reach = [(np.flatnonzero(row).tolist(), row[row != 0.0]) for row in every]

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
        placed: dict[str, tuple[list[int], list[str], list[Array]]] = {}
        for key, weight in weights.items():
            o, function = (force_law.NAME, key) if isinstance(key, str) else key
            self._append(placed, o, function, np.asarray(weight, dtype=float))
        parts = {
            o: Placement(tuple(rows), tuple(functions), np.concatenate(columns).T)
            for o, (rows, functions, columns) in placed.items()
        }
        return Coefficient(name, sd, bound, parts, center)

    def _append(
        self,
        placed: dict[str, tuple[list[int], list[str], list[Array]]],
        o: str,
        function: str,
        weight: Array,
    ) -> None:
        """Add rows, functions and weights (k, runs), and those that follow, to ``placed``."""

        def add(o: str, rows: list[int], functions: list[str], columns: Array) -> None:
            of_rows, of_functions, of_columns = placed.setdefault(o, ([], [], []))
            of_rows += rows
            of_functions += functions
            of_columns.append(columns)

        w = np.empty((self.rows(o), self.runs))
        w.T[:] = weight
        rows = np.flatnonzero(w[:, 0] if weight.ndim < 2 else w.any(axis=1)).tolist()
        if not rows:
            return
        add(o, rows, [function] * len(rows), w[rows])
        if o != force_law.NAME:
            return
        in_meshes = [f"{function} of {row}" for row in rows]
        if self.gear.uses_windows:
            add(trajectory.NAME, [0] * len(rows), in_meshes, w[rows])
        if force_law.of_force_sensor(function):
            return
        for row, name in zip(rows, in_meshes, strict=True):
            if self.gear.modelled[row]:
                moved, reach = self._reach[row]
                columns = reach[:, None] * w[row]
                add(torque_balance.NAME, moved, [name] * len(moved), columns)

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
