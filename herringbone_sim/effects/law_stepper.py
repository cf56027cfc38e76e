"""Stepper of gears with an effect that no slot represents: integrates the effects' laws.

The Taylor series of the core need the force law in closed form. Here the method is Runge-Kutta of
order 5 with error control, and steps end at kinks, see ``effects.located``.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import typeof
from numpy.typing import NDArray

from herringbone_sim.arrays import Array, Indices
from herringbone_sim.core.integrate import Stepper, carrier_row
from herringbone_sim.core.model import Model
from herringbone_sim.core.numba_private import entry_point
from herringbone_sim.core.packed import of_one_type
from herringbone_sim.core.run import StateArrays
from herringbone_sim.effects.dormand_prince import CompiledGear, trial
from herringbone_sim.effects.gear import gear_table, laws, pointers_allowed, scratch
from herringbone_sim.effects.rows import advance_cycles, run


class _Stage(NamedTuple):
    """Work arrays for an evaluation of dy/dtau; n = n_mesh."""

    x: Array  # (n,) deflection with the nominal error [m]
    v: Array  # (n,) its rate [m/s]
    scaled: Array  # (n,) mesh forces, dimensionless
    projection: float  # see ``core.scaling.Scales``


class LawStepper(Stepper):
    """Stepper of a model that is integrated by the laws of its effects.

    The state ``y`` is that of the layout followed by the states of the effects, displacement over
    b_c and rate over b_c omega_n alternating.

    Args:
        model: see ``assemble.by_laws``.

    Raises:
        ParameterError: a locus that the gear lacks, or a mesh without the effect's member.
    """

    def __init__(self, model: Model) -> None:
        p, s, layout = model.parameters, model.scales, model.layout
        self.model = model
        self._entries: dict[Any, Any] = {}
        self._directions = None
        effect_laws = laws(model, model.effects)
        n, n_added_states = layout.n_mesh, effect_laws.n_added_states
        x, v, scaled = np.zeros((3, n))
        force = s.b_c * s.omega_n**2 / s.projection
        unit = np.ones(layout.n_state + n_added_states)
        unit[layout.n_state :] = np.resize([s.b_c, s.velocity_m_per_s], n_added_states)
        self.gear = CompiledGear(
            e=effect_laws.kernel,
            site=effect_laws.site,
            theta=effect_laws.theta,
            gear=gear_table(model),
            p=of_one_type(model.packed),
            si=np.array([s.b_c, s.velocity_m_per_s, force, s.b_c / s.cos_beta, s.omega_n]),
            now=np.array([0.0, p.Omega * s.omega_n, p.delta_T, p.T_1, p.K]),
            w=scratch(model, n_added_states),
            g=_Stage(x, v, scaled, s.projection),
            r=trial(n, unit.size),
            unit=unit,
            carrier=carrier_row(model) * s.b_c,
            n_state=layout.n_state,
            reacts=bool(effect_laws.kernel.acts[:, 1].any()),
        )

    @property
    def is_compiled(self) -> bool:
        """Whether this process has compiled ``rows.run``."""
        return bool(getattr(run, "signatures", True))

    @property
    def _code(self) -> Any:
        return run

    def _sample(
        self, arrays: StateArrays, t: float, rows: Array
    ) -> tuple[float, int, int, NDArray[Any]]:
        """Fill rows and advance ``arrays`` in place.

        Returns time [s], rows filled, contact switches, and the time (n_mesh, 3) in back contact,
        separated and in drive contact, in sample periods.
        """
        p = self.model.parameters
        spent = self.gear.r.spent
        spent[:] = 0.0
        stride = p.steps // p.samples_per_cycle
        y, tangents, _, growth, grid_point = arrays
        end, filled, switches = self._call(
            run, y, tangents, growth, grid_point, t, p.steps, stride, rows
        )
        sample = 2.0 * np.pi / (p.Omega * p.samples_per_cycle)
        return end, filled, switches, spent / sample

    def advance_cycles(
        self, y: Array, tangents: Array, cycle: int, cycles: int
    ) -> tuple[Array, Array]:
        y, tangents = np.array(y, dtype=float), np.array(tangents, dtype=float, order="C")
        self._call(advance_cycles, y, tangents, cycle, cycles, self.model.parameters.steps)
        return y, tangents

    def _call(self, kernel: Any, *args: Any) -> Any:
        """Call a compiled function with the gear and ``args``; return what it returns.

        Argument types are found at its first call and not checked later: they must not change.
        Numba needs half a millisecond for the type of a gear, more than to integrate a mesh cycle.
        """
        if kernel not in self._entries:
            self._entries[kernel] = kernel
            if hasattr(kernel, "compile"):
                with pointers_allowed():
                    kinds = tuple(typeof(argument) for argument in (self.gear, *args))
                    self._entries[kernel] = entry_point(kernel, kinds)
        return self._entries[kernel](self.gear, *args)

    def _added_order(self) -> Indices:
        return np.arange(self.model.n_state - self.model.layout.n_state)
