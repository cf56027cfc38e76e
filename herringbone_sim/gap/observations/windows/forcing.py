"""Windows of a run, and the forces on them under a change of the law."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache, cached_property

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import mean_stiffness
from herringbone_sim.gap.data.folds import slice_run
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.observations.basis import Function
from herringbone_sim.gap.observations.body_motion import body_loads
from herringbone_sim.gap.observations.windows.columns import BodyForce, body_forces
from herringbone_sim.gap.observations.windows.integrator import STATES, Forcing
from herringbone_sim.gap.observations.windows.sensor_errors import with_sensor_errors
from herringbone_sim.gap.observations.windows.shooting import (
    FittedStates,
    WindowSolution,
    evaluated,
    symmetric_starts,
)
from herringbone_sim.gap.observations.windows.windows import (
    N_WINDOWS,
    Windows,
    window_samples,
    windows_of_run,
)
from herringbone_sim.gap.residuals.mesh_law import LawChange, MeshMotion, law
from herringbone_sim.gap.residuals.torque_balance import hermite_interpolation

# Windows at the start of a run that only the filter uses (``starts``); in nine it converged from
# all initial states tried.
LEAD_WINDOWS = 12


class ForcedWindows:
    """Windows of a run with the forces on them.

    Args:
        run: with rotations or accelerations of suns and carrier.
        lead: most windows at the start that only the filter uses.
        windows: most windows that are fitted, after those of the lead.

    Attributes:
        recorded: windows as recorded.
        windows: windows with the sensor errors of the last change.
        lead_windows: number of windows of the lead.
    """

    def __init__(
        self, run: PreparedRun, lead: int = LEAD_WINDOWS, windows: int = N_WINDOWS
    ) -> None:
        samples = window_samples(run)
        least = min(windows, N_WINDOWS)  # more windows don't shorten the lead
        self.run, self.lead_windows = run, max(0, min(lead, (len(run) - 1) // samples - least))
        part = slice_run(run, slice(self.lead_windows * samples, None), run.name)
        self.recorded: Windows = windows_of_run(part, windows)
        self.windows = self.recorded
        self.model = run.model

    @cached_property
    def _nominal(self) -> tuple[Array, Array, Array]:
        """Nominal k [N/m], e [m] and rate of e [m/s], each (half steps, n_mesh).

        They are late by the common delay of the run's channels; e is not reduced by ``e_share``, a
        property of recorded x, which windows don't use.
        """
        s = self.windows
        w = replace(s.run, e_share=1.0).waves_at(s.phase)
        return w.k, w.e, w.e_rate

    def forcing(
        self, change: LawChange, masses: Array, pushes: Sequence[tuple[BodyForce, float]]
    ) -> Forcing:
        """Return the coefficients of the equation of motion of the windows under a change.

        Args:
            change: of the law, at every half step.
            masses: (9,) factors on 1/M.
            pushes: forces on bodies with their amplitudes.
        """
        s = self.windows
        k, e, rate = self._nominal
        m = self.model
        ones = np.ones_like(k)
        tau = body_loads(m, s.phase - s.run.delay_rad)
        for push, a in pushes:
            tau = tau + a * push.size[:, None] * push.direction
        return Forcing(
            s.G,
            s.inverse_masses * masses,
            tau,
            k * (1.0 + change.kappa) + mean_stiffness(m.parameters) * change.mean_kappa,
            m.damping_n_s_per_m * (1.0 + change.gamma) * ones,
            change.d - e,
            change.d_rate - rate,
            np.maximum(m.half_backlash_m + change.b_plus, 0.0) * ones,
            np.maximum(m.half_backlash_m + change.b_minus, 0.0) * ones,
            change.extra_force * ones,
        )

    def motion(self, states: Array, phase: Array) -> MeshMotion:
        """Mesh motion at states (n, 18) and recorded phases (n,) [rad], without forces, noise."""
        s, m = self.windows, self.model
        waves_at = replace(s.run, e_share=1.0, delay_rad=0.0).waves_at  # see ``_nominal``
        late = phase - s.run.delay_rad
        w = waves_at(late)
        half = STATES // 2
        n, meshes = len(states), m.layout.n_mesh
        nothing = np.zeros(meshes)
        return MeshMotion(
            s.run.name,
            late,
            (phase - s.run.phase[0]) / s.run.omega_rad_per_s,
            s.run.omega_rad_per_s,
            dict(s.run.point),
            states[:, :half] @ s.G.T - w.e,
            states[:, half:] @ s.G.T - w.e_rate,
            np.full((n, meshes), np.nan),
            nothing,
            nothing,
            nothing,
            w.k,
            w.e,
            w.e_rate,
            waves_at,
            mean_stiffness(m.parameters),
            m.damping_n_s_per_m,
            m.half_backlash_m,
        )

    def _motion_at_half_steps(self, solution: WindowSolution | FittedStates) -> MeshMotion:
        """Mesh motion at every half step of all windows, interpolated between the steps."""
        half, steps = STATES // 2, solution.states_of_all
        u, rate = hermite_interpolation(steps[:, :half], steps[:, half:], self.windows.h, 2)
        return self.motion(np.hstack([u, rate]), self.windows.phase)

    def in_step_forcing(
        self,
        change_of: Callable[[MeshMotion], LawChange],
        other_amplitudes: Mapping[str, float],
        on_carrier: Sequence[Function],
    ) -> Forcing:
        """Return ``forcing_under`` a change, at the motion with all unmeasured planets alike."""
        forcing_at = self.forcing_under(change_of, other_amplitudes, on_carrier)
        s = self.windows
        return forcing_at(
            evaluated(s, symmetric_starts(s), self.forcing(LawChange(), self.masses({}), ()))
        )

    def forcing_under(
        self,
        change_of: Callable[[MeshMotion], LawChange],
        other_amplitudes: Mapping[str, float],
        on_carrier: Sequence[Function],
    ) -> Callable[[WindowSolution | FittedStates], Forcing]:
        """Return the forcing under a change as a function of the states; sets ``windows``.

        Args:
            change_of: change of the law as a function of the motion.
            other_amplitudes: those of masses, sensor errors, friction, ripple and ``on_carrier``.
            on_carrier: functions that are forces on the carrier.
        """
        self.windows = with_sensor_errors(self.recorded, other_amplitudes)
        masses = self.masses(other_amplitudes)

        def forcing_at(solution: WindowSolution | FittedStates) -> Forcing:
            m = self._motion_at_half_steps(solution)
            change = change_of(m)
            now = cache(lambda: law(m, change))
            pushes = [
                (push, other_amplitudes[push.name])
                for push in body_forces(self.run, m, now, other_amplitudes, on_carrier)
            ]
            return self.forcing(change, masses, pushes)

        return forcing_at

    def masses(self, other_amplitudes: Mapping[str, float]) -> Array:
        """(9,) factors on 1/M by the amplitudes of ``M_s``, ``M_c`` and ``M_p``."""
        s, c, p = (1.0 + other_amplitudes.get(f"M_{body}", 0.0) for body in "scp")
        return np.array([s, s, c, *[p] * (STATES // 2 - 3)])
