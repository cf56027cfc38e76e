"""The gear as a machine that the engine can diagnose: its observations, tolerances and places."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import count

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.diagnosis.flexible import Surroundings
from herringbone_sim.diagnosis.products import Block
from herringbone_sim.diagnosis.threads import each
from herringbone_sim.gap.data.folds import slice_run
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.observations import balance, consistency, force_law, trajectory
from herringbone_sim.gap.observations.basis import Function
from herringbone_sim.gap.observations.changes import Changes, Part
from herringbone_sim.gap.observations.law import Change, Law, Motion, law
from herringbone_sim.gap.observations.runs import GearRun, gear_run
from herringbone_sim.gap.observations.shooting import Shot
from herringbone_sim.gap.observations.surroundings import about_meshes, about_rows
from herringbone_sim.gap.observations.trajectory import Trajectory
from herringbone_sim.gap.observations.window_channels import Channels as Followed
from herringbone_sim.gap.observations.window_channels import channels
from herringbone_sim.gap.observations.window_sensors import SWAP
from herringbone_sim.gap.residuals.balance import FINE, window_of
from herringbone_sim.gap.residuals.fusion import fuse
from herringbone_sim.gap.sensors.correction import without_sensor_error
from herringbone_sim.gap.sensors.swaps import find_swap

Array = NDArray[np.float64]
Amplitudes = Mapping[str, Mapping[str, Array]]  # observation -> function -> (runs, rows)
WIDTH = 0.12  # of the balance's window, mesh cycles: order 1 passes with 0.75, order 3 with 0.08


class Gear:
    """Observations of a gear's runs, linear about any change of the law.

    Args:
        runs: of one rig.
        drift: RMS of drift and hum over that of the noise.
        stride: samples from one comparison of the force law to the next.
        swap: motion channels that may have been exchanged; None: sought.
        gain_tolerance: (n_mesh,) of force sensors, as the campaign tells.
    """

    def __init__(
        self,
        runs: Sequence[PreparedRun],
        drift: float = force_law.DRIFT_SHARE,
        stride: int = 1,
        swap: tuple[str, str] | None = None,
        gain_tolerance: Sequence[float] = (),
    ) -> None:
        self.width = WIDTH
        self.model = runs[0].model
        self.drift, self.stride = drift, stride
        self.gain_tolerance = tuple(gain_tolerance) or (0.0,) * self.model.layout.n_mesh
        self.runs = tuple(gear_run(run, stride) for run in runs)
        known = [np.isfinite(g.motion.F).all(axis=0) for g in self.runs]
        self.modelled: NDArray[np.bool_] = ~np.logical_and.reduce(known)
        self.swap = find_swap(runs) if swap is None else swap
        self.fine = False
        self.body_functions: tuple[Function, ...] = ()
        self._changes = Changes(self.model, force_law.functions(self.model), {})
        self._parts_about: Amplitudes = {}
        self._plain_balances: list[Block] = []  # made once for all copies
        self._trajectories: dict[int, Trajectory] = {}  # and these
        self._exchanged: dict[tuple[int, str], Trajectory] = {}
        self.part_numbers = count()  # one label for each part among all copies

    @property
    def law_functions(self) -> tuple[Function, ...]:
        """Those of the force law."""
        return self._changes.functions

    @cached_property
    def functions(self) -> dict[str, tuple[str, ...]]:
        """Names of all functions by observation."""
        laws = tuple(f.name for f in self.law_functions)
        return {
            force_law.NAME: laws,
            balance.NAME: balance.function_names(
                self.model,
                self.modelled,
                self.law_functions,
                [f.name for f in self.body_functions],
            ),
            consistency.NAME: consistency.function_names(self.model.layout, self.swap),
            trajectory.NAME: trajectory.function_names(
                self.model, (*self.law_functions, *self.body_functions), self.followed.names
            )
            if self.by_windows
            else (),
        }

    @cached_property
    def has_force_law(self) -> bool:
        """Whether force and displacement are recorded of one mesh at least."""
        known = [np.isfinite(g.motion.x).all(axis=0) for g in self.runs]
        return bool((~self.modelled & np.logical_and.reduce(known)).any())

    @cached_property
    def by_windows(self) -> bool:
        """Whether states are estimated over windows: where neither law nor balance is formed."""
        few = not self.has_force_law and not self.balanced
        return few and all(g.run.shafts_known for g in self.runs)

    @cached_property
    def followed(self) -> Followed:
        """Channels of the first run that windows follow."""
        return channels(self.runs[0].run)

    @property
    def gauges(self) -> tuple[str, ...]:
        """Force channels that windows follow."""
        return self.followed.gauges if self.by_windows else ()

    def windows_of(self, r: int) -> Trajectory:
        """Windows of a run, made once for all copies."""
        if r not in self._trajectories:
            self._trajectories[r] = trajectory.trajectory(self.runs[r].run)
        return self._trajectories[r]

    @property
    def trajectories(self) -> tuple[Trajectory, ...]:
        return tuple(each(self.windows_of, range(len(self.runs))))

    def of_runs(self, runs: Sequence[PreparedRun]) -> Gear:
        """The same rig in other runs, at every sample; windows of runs known here are kept."""
        found = Gear(runs, self.drift, 1, self.swap, self.gain_tolerance)
        known = {id(g.run): self._trajectories.get(r) for r, g in enumerate(self.runs)}
        kept = {r: known.get(id(run)) for r, run in enumerate(runs)}
        found._trajectories.update({r: t for r, t in kept.items() if t is not None})
        found.part_numbers = self.part_numbers
        return found

    @cached_property
    def omegas(self) -> Array:
        return np.array([g.motion.omega for g in self.runs])

    @cached_property
    def sizes(self) -> dict[str, float]:
        """RMS of each quantity over all runs; those without any channel are left out."""
        return {
            q: float(
                np.sqrt(np.nanmean([np.nanmean(getattr(g.run, q).values ** 2) for g in self.runs]))
            )
            for q in "xvu"
            if any(getattr(g.run, q).there.any() for g in self.runs)
        }

    @cached_property
    def relations(self) -> int:
        """Rows of the consistency of motion sensors."""
        few = slice_run(self.runs[0].run, slice(0, 64), self.runs[0].run.name)
        found = consistency.block(few, fuse(few), self.drift, self.swap)
        return 0 if found is None else len(found.rows)

    @cached_property
    def _consistency(self) -> list[Block | None]:
        return [consistency.block(g.run, g.fused, self.drift, self.swap) for g in self.runs]

    @cached_property
    def delta_T(self) -> Array:
        return np.array([g.motion.point["delta_T"] for g in self.runs])

    @cached_property
    def T_1(self) -> Array:
        return np.array([g.motion.point["T_1"] for g in self.runs])

    @cached_property
    def _quadrature(self) -> list[Array | None]:
        """Integral minus sum of the nominal forces over the balance's window."""
        return [self._between(r, {}) for r in range(len(self.runs))]

    def _between(self, r: int, of_law: Mapping[str, Array]) -> Array | None:
        """Integral minus sum of the forces of a law over the balance's window (k, n_mesh) [N]."""
        g = self.runs[r]
        dense = g.dense
        if dense is None:
            return None
        force = self.law_of(dense, of_law, ()).force
        look = window_of(g.run, self.width)
        fine = look.finer(FINE)
        reach = len(look.mean) // 2
        first = reach * FINE - len(fine.mean) // 2
        whole = fine.average(force)[first::FINE][: len(g.run) - 2 * reach]
        return np.asarray(whole - look.average(force[::FINE]))

    def finely(self) -> Gear:
        """The same, its balance with forces between samples by the law with all changes."""
        found = copy.copy(self)
        found.fine = True
        return found

    @cached_property
    def _balances(self) -> list[Block]:
        """Balances of the runs as measured, which no law enters but for parts that move."""
        if not self._plain_balances:
            self._plain_balances += [
                self._balance(r, g, law(g.motion), self.law_functions)
                for r, g in enumerate(self.runs)
            ]
        if not self.body_functions:
            return self._plain_balances
        names = [f.name for f in self.body_functions]
        found = []
        for r, (g, plain) in enumerate(zip(self.runs, self._plain_balances, strict=True)):
            of_law = {f: a[r] for f, a in self._parts_about.get(force_law.NAME, {}).items()}
            now = self.law_of(g.motion, of_law)
            more = self._balance(r, g, now, self.law_functions, names)
            found.append(
                replace(
                    plain,
                    functions=(*plain.functions, *more.functions),
                    columns=np.concatenate([plain.columns, more.columns], axis=2),
                    shared=np.concatenate([plain.shared, more.shared], axis=2),
                    alike=np.concatenate([_alike(plain), _alike(more)]),
                )
            )
        return found

    def _balance(
        self,
        r: int,
        g: GearRun,
        now: Law,
        chosen: Sequence[Function],
        wanted: Sequence[str] | None = None,
    ) -> Block:
        return balance.block(
            g.run,
            g.fused,
            g.motion,
            now,
            self.modelled,
            chosen,
            self._quadrature[r],
            self.width,
            self.body_functions,
            wanted,
            self.drift,
        )

    def _put_right(self, r: int, errors: Mapping[str, Array]) -> GearRun:
        """A run without errors of its motion sensors."""
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

    def law_of(
        self, m: Motion, amplitudes: Mapping[str, Array], wanted: Sequence[str] | None = None
    ) -> Law:
        """The law of a run with functions at amplitudes (n_mesh,).

        Args:
            wanted: functions whose columns will be formed (None: all).
        """
        return law(m, self.change_of(m, amplitudes, wanted))

    def change_of(
        self, m: Motion, amplitudes: Mapping[str, Array], wanted: Sequence[str] | None = ()
    ) -> Change:
        """What functions at amplitudes (n_mesh,) do to the law of a run."""
        r = self._number.get(m.name)
        between = None if r is None or not self._changes.parts else self.runs[r].dense
        return self._changes.of(m, m if self.by_windows else between, amplitudes, wanted)

    @cached_property
    def _number(self) -> dict[str, int]:
        return {g.motion.name: r for r, g in enumerate(self.runs)}

    def linear(self, amplitudes: Amplitudes) -> tuple[str, ...]:
        """The consistency always; the balance unless its forces or its motion change."""
        motion = any(np.any(a) for a in amplitudes.get(consistency.NAME, {}).values())
        if motion or self.modelled.any() or self.fine:
            return (consistency.NAME,) if self.relations else ()
        known = (balance.NAME,) if self.balanced else ()
        return (*known, consistency.NAME) if self.relations else known

    @cached_property
    def balanced(self) -> bool:
        """Whether rates of all coordinates are known."""
        return all(bool(np.isfinite(g.fused.z_rate).all()) for g in self.runs)

    def blocks(
        self,
        amplitudes: Amplitudes,
        wanted: Mapping[str, Sequence[str]] | None,
        observations: Sequence[str],
    ) -> list[dict[str, Block]]:
        """Some observations of all runs about a change, with the columns wanted (None: all)."""
        return each(
            lambda r: self._blocks(r, amplitudes, wanted, observations), range(len(self.runs))
        )

    def _blocks(
        self,
        r: int,
        amplitudes: Amplitudes,
        wanted: Mapping[str, Sequence[str]] | None,
        observations: Sequence[str],
    ) -> dict[str, Block]:
        found: dict[str, Block] = {}
        relations = self._consistency[r] if consistency.NAME in observations else None
        if relations is not None:
            found[consistency.NAME] = _about(
                relations, amplitudes.get(consistency.NAME, {}), r, wanted
            )
        if trajectory.NAME in observations and self.by_windows:
            found[trajectory.NAME] = self._windows(r, amplitudes, wanted)
        if not {force_law.NAME, balance.NAME} & set(observations):
            return found
        g = self._put_right(r, amplitudes.get(consistency.NAME, {}))
        of_law = {f: a[r] for f, a in amplitudes.get(force_law.NAME, {}).items()}
        chosen = self.law_functions
        if wanted is not None:
            used = {*wanted.get(force_law.NAME, ()), *SHAFT_NAMES}
            chosen = tuple(f for f in chosen if f.name in used)
        asked = [f.name for f in chosen]
        if force_law.NAME in observations and self.has_force_law:
            now = self.law_of(g.some, of_law, asked)
            found[force_law.NAME] = force_law.block(g.some, now, self.model, chosen, self.drift)
        if balance.NAME in observations and self.balanced:
            # Functions of laws stand in the forces already.
            own = set(balance.function_names(self.model, np.zeros_like(self.modelled), ()))
            own |= {f.name for f in self.body_functions}
            given = amplitudes.get(balance.NAME, {})
            of_balance = {name: a for name, a in given.items() if name in own}
            gratings = [f"{f} of {j}" for f in SHAFT_NAMES for j in np.flatnonzero(self.modelled)]
            names = None
            if wanted is not None:
                names = [*wanted.get(balance.NAME, ()), *of_balance, *gratings]
            cached = g is self.runs[r] and not self.modelled.any()
            full = (
                self._balances[r]
                if cached
                else self._balance(r, g, self.law_of(g.motion, of_law, asked), chosen, names)
            )
            if self.fine and self._quadrature[r] is not None:
                full = balance.corrected(
                    full, self._between(r, of_law), self._quadrature[r], g.run
                )
            found[balance.NAME] = _about(full, of_balance, r, wanted)
        return found

    def _windows(
        self,
        r: int,
        amplitudes: Amplitudes,
        wanted: Mapping[str, Sequence[str]] | None,
    ) -> Block:
        """Windows of a run about a change, at the states that fit it."""
        names_of = self.functions if wanted is None else wanted
        every = names_of.get(trajectory.NAME, ())
        functions = [f.name for f in self.law_functions]
        if wanted is not None:
            used = {name.rpartition(" of ")[0] for name in every}
            functions = [name for name in functions if name in used]
        change_of = self._windows_change(r, amplitudes, functions)[0]
        shot = self.states(r, amplitudes)
        one = self.windows_about(r, amplitudes)
        every_one = (*self.law_functions, *self.body_functions)
        return one.block(shot, change_of, every_one, tuple(every))

    def states(self, r: int, amplitudes: Amplitudes) -> Shot:
        """States of the windows of a run that fit a change."""
        key = sorted(f for f, a in amplitudes.get(trajectory.NAME, {}).items() if np.any(a[r]))
        one = self.windows_about(r, amplitudes)
        return one.solved(tuple(key), *self._windows_change(r, amplitudes))

    def windows_about(self, r: int, amplitudes: Amplitudes) -> Trajectory:
        """Windows of a run; of the channels put back where a change says they are exchanged."""
        for f, a in amplitudes.get(trajectory.NAME, {}).items():
            if f.startswith(SWAP) and a[r][0] != 0.0:
                key = r, f
                if key not in self._exchanged:
                    names = f.removeprefix(SWAP).split(" and ")
                    run = without_sensor_error(self.runs[r].run, "swap", names, 1.0)
                    self._exchanged[key] = trajectory.trajectory(run)
                return self._exchanged[key]
        return self.windows_of(r)

    def squares_near(self, r: int, near: Shot, amplitudes: Amplitudes, rounds: int) -> float:
        """Squares that some rounds leave of the windows of a run, from states near by."""
        one = self.windows_about(r, amplitudes)
        return one.cost_near(near, *self._windows_change(r, amplitudes), rounds)

    def _windows_change(
        self, r: int, amplitudes: Amplitudes, wanted: Sequence[str] = ()
    ) -> tuple[Callable[[Motion], Change], dict[str, float], tuple[Function, ...]]:
        """What amplitudes do to the law of a run, those of bodies and sensors, their functions.

        Args:
            wanted: functions of the law whose columns will be formed.
        """
        of_law = {f: a[r] for f, a in amplitudes.get(force_law.NAME, {}).items()}
        names = {f.name for f in self.law_functions}
        of_bodies = {
            f: float(a[r][0])
            for f, a in amplitudes.get(trajectory.NAME, {}).items()
            if np.any(a[r]) and f.rpartition(" of ")[0] not in names
        }
        return (lambda m: self.change_of(m, of_law, wanted)), of_bodies, self.body_functions

    def with_functions(
        self,
        extra: Sequence[Function],
        on_bodies: Sequence[Function] = (),
        parts: Mapping[str, Part] | None = None,
        about: Amplitudes | None = None,
    ) -> Gear:
        """The same with further functions of the force law and of the balance.

        Args:
            parts: that move by themselves, by the label that their functions begin with.
            about: amplitudes of all else, by which parts move that push a body as well.
        """
        found = copy.copy(self)
        every = {**self._changes.parts, **(parts or {})}
        found._changes = Changes(self.model, (*self.law_functions, *extra), every)
        found.body_functions = (*self.body_functions, *on_bodies)
        found._parts_about = self._parts_about if about is None else about
        for name in ("functions", "_balances"):
            found.__dict__.pop(name, None)
        return found

    def surroundings(self, observation: str, r: int, block: Block) -> Surroundings:
        """What is measured about the rows of a block of a run."""
        if observation == trajectory.NAME:
            return self.windows_of(r).surroundings(block, self.law_functions)
        g = self.runs[r]
        cycles = (1.0, *force_law.members(self.model).values())
        if observation == force_law.NAME:
            return about_meshes(g.some, cycles, block)
        own: Sequence[Array] = (g.fused.z, g.fused.z_rate)
        relations = self._consistency[r]
        if observation == consistency.NAME and relations is not None:
            own = consistency.shown(relations)
        return about_rows(g.motion, own, cycles, block)


SHAFT_NAMES = tuple(f"shaft {s} 1 {trig}" for s in "scp" for trig in ("cos", "sin"))


def _about(
    block: Block,
    amplitudes: Mapping[str, Array],
    r: int,
    wanted: Mapping[str, Sequence[str]] | None,
) -> Block:
    """A linear block with its residual at some amplitudes, and the columns wanted.

    Columns that shared nuisances are made of stay.
    """
    residual = block.residual
    for name, a in amplitudes.items():
        residual = residual - block.columns[:, :, block.functions.index(name)] * a[r]
    if wanted is None:
        return replace(block, residual=residual)
    names = set(wanted.get(block.observation, ()))
    shared = np.any(block.shared != 0.0, axis=(0, 1))
    keep = [i for i, f in enumerate(block.functions) if f in names or shared[i]]
    return replace(
        block,
        residual=residual,
        functions=tuple(block.functions[i] for i in keep),
        columns=block.columns[:, :, keep],
        shared=block.shared[:, :, keep],
        alike=None if block.alike is None else block.alike[keep],
    )


def _alike(block: Block) -> NDArray[np.bool_]:
    return np.zeros(len(block.functions), bool) if block.alike is None else block.alike
