"""The runs of a gear and what their channels determine, for any force law."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.arrays import Array
from herringbone_sim.diagnosis.machine import Amplitudes
from herringbone_sim.diagnosis.parallel import parallel_map
from herringbone_sim.diagnosis.products import Block
from herringbone_sim.gap.data.folds import slice_run
from herringbone_sim.gap.data.prepared import Measured, PreparedRun
from herringbone_sim.gap.observations import consistency, force_law, torque_balance
from herringbone_sim.gap.observations.runs import GearRun, gear_run
from herringbone_sim.gap.observations.windows import trajectory
from herringbone_sim.gap.observations.windows.channels import window_channels
from herringbone_sim.gap.observations.windows.integrator import BODIES
from herringbone_sim.gap.observations.windows.memory import StateMemory
from herringbone_sim.gap.observations.windows.sensor_errors import SWAP_PREFIX
from herringbone_sim.gap.observations.windows.trajectory import Trajectory
from herringbone_sim.gap.observations.windows.windows import N_WINDOWS
from herringbone_sim.gap.residuals.fusion import fuse
from herringbone_sim.gap.sensors.correction import without_sensor_error
from herringbone_sim.gap.sensors.swaps import find_swap

G = TypeVar("G", bound="RecordedGear")


class FittedInParallel(NamedTuple):
    """Memories of the states that a copy of a gear fitted.

    Attributes:
        runs: by number of the run.
        swapped: of runs with exchanged channels put back, by number of the run and exchange.
    """

    runs: Mapping[int, StateMemory]
    swapped: Mapping[tuple[int, str], StateMemory]


class RecordedGear:
    """Runs of a gear, and the observations that their channels allow.

    Args:
        runs: of one rig.
        stride: the force law is compared at every ``stride``-th sample.
        swap: motion channels that may have been swapped; None: searched for.
        gain_tolerance: (n_mesh,) of force sensors as given by the campaign; empty: none.

    Attributes:
        modelled: (n_mesh,) meshes whose force is not recorded in all runs and comes from the law.
        force_known: (n_mesh,) meshes whose force is recorded in at least one run.
        windows: most windows that are fitted to a run.
    """

    def __init__(
        self,
        runs: Sequence[PreparedRun],
        stride: int = 1,
        swap: tuple[str, str] | None = None,
        gain_tolerance: Sequence[float] = (),
    ) -> None:
        self.model = runs[0].model
        self.stride = stride
        self.gain_tolerance = tuple(gain_tolerance) or (0.0,) * self.model.layout.n_mesh
        self.runs = tuple(gear_run(run, stride) for run in runs)
        known = [np.isfinite(g.motion.F).all(axis=0) for g in self.runs]
        self.modelled: NDArray[np.bool_] = ~np.logical_and.reduce(known)
        self.force_known: NDArray[np.bool_] = np.logical_or.reduce(known)
        self.swap = find_swap(runs) if swap is None else swap
        self._forget_windows(N_WINDOWS)

    def _forget_windows(self, windows: int) -> None:
        """Set the number of windows of a run, with no window fitted."""
        self.windows = windows
        self._trajectories: dict[int, Trajectory] = {}  # shared by all copies
        self._swapped_trajectories: dict[tuple[int, str], Trajectory] = {}
        self._formed: dict[int, Trajectory] = {}  # of which the latest block of a run was formed

    def take_observations(self, other: RecordedGear) -> None:
        """Form the observations of another gear of the rig, so that what is fitted to it applies.

        A run that lacks a channel for one of them has no block of it.
        """
        self.modelled, self.force_known = other.modelled, other.force_known
        rows = max(self.n_relations, other.n_relations)
        of = ("means_known", "has_balance", "has_force_law", "uses_windows", "rms_by_quantity")
        for name in of:
            self.__dict__[name] = getattr(other, name)
        self.__dict__["recorded_motion"] = other.recorded_motion
        self.__dict__["n_relations"] = rows if other.n_relations else 0
        if other.uses_windows:
            self.__dict__["followed_channels"] = other.followed_channels

    def has_balance_of(self, r: int) -> bool:
        """Whether the channels of run r allow the torque balance."""
        return self._is_balanced(self.runs[r])

    def has_windows_of(self, r: int) -> bool:
        """Whether windows are fitted to run r."""
        return self.uses_windows and self.runs[r].run.shafts_known

    @cached_property
    def means_known(self) -> bool:
        """Whether all recorded rotations contain their mean; if not, only windows are fitted."""
        return all(g.run.means_known for g in self.runs)

    @cached_property
    def has_balance(self) -> bool:
        """Whether the balance is formed: in all runs rates of all coordinates are known, and of
        each mesh the force, or x for the force law.

        Not where rotations alone are recorded: their differences are mostly noise, and windows
        need none.
        """
        rotations = all(g.run.rotations_alone for g in self.runs)
        return self.means_known and not rotations and all(map(self._is_balanced, self.runs))

    def _is_balanced(self, g: GearRun) -> bool:
        """Whether a run has all rates and, of each mesh, the force or x for the law."""
        x, F = (np.isfinite(a).all(axis=0) for a in (g.motion.x, g.motion.F))
        known = np.where(self.modelled, x, F)
        return bool(known.all() and np.isfinite(g.fused.z_rate).all())

    @cached_property
    def has_force_law(self) -> bool:
        """Whether the force law is an observation: a mesh has F and x known in all runs.

        Not if a recorded rotation lacks its mean (``means_known``).
        """
        known = [np.isfinite(g.motion.x).all(axis=0) for g in self.runs]
        there = (~self.modelled & np.logical_and.reduce(known)).any()
        return bool(self.means_known and there)

    @cached_property
    def uses_windows(self) -> bool:
        """Whether trajectories are fitted: where neither force law nor balance is formed.

        They know gears of three planets only.
        """
        few = not self.has_force_law and not self.has_balance
        three = len(self.model.layout.bodies) == BODIES
        return few and three and all(g.run.shafts_known for g in self.runs)

    @property
    def observation_names(self) -> tuple[str, ...]:
        """Names of the observations that the recorded channels allow."""
        there = {
            force_law.NAME: self.has_force_law,
            torque_balance.NAME: self.has_balance,
            consistency.NAME: self.n_relations > 0,
            trajectory.NAME: self.uses_windows,
        }
        return tuple(name for name, known in there.items() if known)

    @cached_property
    def followed_channels(self) -> tuple[str, ...]:
        """Names of the channels to which windows are fitted in any run."""
        return tuple(dict.fromkeys(n for g in self.runs for n in window_channels(g.run).names))

    @property
    def gauges(self) -> tuple[str, ...]:
        """Names of force channels to which windows are fitted; empty without windows."""
        return tuple(n for n in self.followed_channels if n[0] == "F") if self.uses_windows else ()

    def trajectory_of(self, r: int) -> Trajectory:
        """Windows of run r, shared by all copies."""
        if r not in self._trajectories:
            self._trajectories[r] = Trajectory(self.runs[r].run, self.windows)
        return self._trajectories[r]

    @property
    def trajectories(self) -> tuple[Trajectory, ...]:
        """Windows of every run, in the order of ``runs``; those not built before are built."""
        return tuple(parallel_map(self.trajectory_of, range(len(self.runs))))

    def trajectory_under(self, r: int, amplitudes: Amplitudes) -> Trajectory:
        """Windows of run r; with channels swapped back if the amplitudes contain a swap."""
        for f, a in amplitudes.get(trajectory.NAME, {}).items():
            if f.startswith(SWAP_PREFIX) and a[r][0] != 0.0:
                return self.swapped_trajectory(r, f)
        return self.trajectory_of(r)

    def swapped_trajectory(self, r: int, swap: str) -> Trajectory:
        """Windows of run r with the channels of the function ``swap`` swapped back."""
        key = r, swap
        if key not in self._swapped_trajectories:
            names = swap.removeprefix(SWAP_PREFIX).split(" and ")
            run = without_sensor_error(self.runs[r].run, "swap", names, 1.0)
            self._swapped_trajectories[key] = Trajectory(run, self.windows, True)
        return self._swapped_trajectories[key]

    def with_own_states(self: G) -> G:
        """Copy whose fits this gear does not know of until ``learn_states``."""
        gear = copy.copy(self)
        gear._trajectories = {r: t.with_own_memory() for r, t in self._trajectories.items()}
        gear._swapped_trajectories = {
            swap: t.with_own_memory() for swap, t in self._swapped_trajectories.items()
        }
        gear._formed = {}
        return gear

    def states_since(self, before: RecordedGear) -> FittedInParallel:
        """States fitted since this gear was copied from ``before`` by ``with_own_states``."""

        def new(trajectory: Trajectory, known: Trajectory | None) -> StateMemory:
            return trajectory.memory.since(StateMemory() if known is None else known.memory)

        runs, swapped = before._trajectories, before._swapped_trajectories
        return FittedInParallel(
            {r: new(t, runs.get(r)) for r, t in self._trajectories.items()},
            {key: new(t, swapped.get(key)) for key, t in self._swapped_trajectories.items()},
        )

    def learn_states(self, fitted: FittedInParallel) -> None:
        """Remember what a copy fitted."""
        for r, memory in fitted.runs.items():
            self.trajectory_of(r).memory.add(memory)
        for (r, swap), memory in fitted.swapped.items():
            self.swapped_trajectory(r, swap).memory.add(memory)

    @cached_property
    def omegas(self) -> Array:
        """(runs,) mesh frequencies [rad/s]."""
        return np.array([g.motion.omega for g in self.runs])

    @cached_property
    def rms_by_quantity(self) -> dict[str, float]:
        """RMS over all channels and runs of each recorded quantity: x, v, u, F and pin."""
        rms = {}
        for q in ("x", "v", "u", "F", "pin"):
            by_run: list[Measured] = [getattr(g.run, q) for g in self.runs]
            squares = [
                np.nanmean(measured.values**2) for measured in by_run if measured.recorded.any()
            ]
            if squares:
                rms[q] = float(np.sqrt(np.mean(squares)))
        return rms

    @cached_property
    def recorded_motion(self) -> NDArray[np.bool_]:
        """Mask (J,) of the channels x, v and u that are recorded in at least one run."""
        recorded = [(g.run.x.recorded, g.run.v.recorded, g.run.u.recorded) for g in self.runs]
        return np.asarray(np.logical_or.reduce([np.concatenate(flags) for flags in recorded]))

    @cached_property
    def n_relations(self) -> int:
        """Number of rows of the consistency observation, of the run that has most."""
        if not self.means_known:
            return 0
        starts = [slice_run(g.run, slice(0, 64), g.run.name) for g in self.runs]
        blocks = [consistency.block(start, fuse(start), self.swap) for start in starts]
        return max(0 if block is None else block.residual.shape[1] for block in blocks)

    @cached_property
    def relations(self) -> list[Block | None]:
        """Consistency block of every run as recorded; None for a run without rows."""
        n = self.n_relations
        return [consistency.block(g.run, g.fused, self.swap, n) for g in self.runs]

    @cached_property
    def delta_T(self) -> Array:
        """(runs,) temperature rises [K]."""
        return np.array([g.motion.point["delta_T"] for g in self.runs])

    @cached_property
    def T_1(self) -> Array:
        """(runs,) input torques [N m]."""
        return np.array([g.motion.point["T_1"] for g in self.runs])

    @cached_property
    def number_of(self) -> dict[str, int]:
        """Index of each run, by name."""
        return {g.motion.name: r for r, g in enumerate(self.runs)}

    def corrected_run(self, r: int, errors: Mapping[str, Array]) -> GearRun:
        """Run r with errors of motion sensors undone.

        Args:
            errors: amplitudes (runs, rows), equal in all rows, by name of the function
                (``consistency.function_names``); any of ``swap`` but zero undoes the swap.
        """
        g, run = self.runs[r], self.runs[r].run
        for name, a in errors.items():
            value = float(a[r][0])
            if value == 0.0:
                continue
            kind, _, channel = name.partition(" of ")
            names = self.swap or () if name == "swap" else (channel,)
            run = without_sensor_error(run, kind, names, value)
        if run is g.run:
            return g
        return gear_run(run, self.stride)
