"""Simulated and recorded runs in Python."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from herringbone_sim.analysis.known_gear import effect_texts, gear_of, numbers_of
from herringbone_sim.analysis.pipeline import Options, SegmentResult, analyze_series
from herringbone_sim.api.gear import Gear, any_gear, model_of
from herringbone_sim.api.shown import NotebookResult, Picture, data_frame, library
from herringbone_sim.arrays import Array
from herringbone_sim.core import integrate
from herringbone_sim.core.layout import unit_of
from herringbone_sim.core.model import Model
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.effects.assemble import build_with
from herringbone_sim.effects.stepper import change
from herringbone_sim.effects.written import read_effects
from herringbone_sim.errors import AnalysisError, ParameterError, shown
from herringbone_sim.recording.parameter_file import EFFECTS, gear_of_values, values_of_gear
from herringbone_sim.recording.reader import ParameterChange, read_recording
from herringbone_sim.views.figures.motion import motion_figure
from herringbone_sim.views.figures.style import Scale


@dataclass(frozen=True, repr=False)
class Run(NotebookResult):
    """Samples of a gear over time.

    Attributes:
        name: of the run.
        samples: of every channel, SI units; ``run["x_sp_L"]`` gives one channel (n,).
        parameters: of the gear by name, ``effects`` as a text; empty when unknown.
        changes: of parameters during the run.
        notes: remarks on a recording, a sentence each.
        end: state after the last sample, for ``simulate`` to continue; None for a recording.
    """

    name: str
    samples: TimeSeries
    parameters: Mapping[str, Any]
    changes: tuple[ParameterChange, ...] = ()
    notes: tuple[str, ...] = ()
    end: integrate.State | None = field(default=None, compare=False)

    def __getitem__(self, channel: str) -> Array:
        return self.samples[channel]

    @property
    def t(self) -> Array:
        """Time (n,) [s]."""
        return self.samples.times

    @cached_property
    def segments(self) -> list[SegmentResult]:
        """Period, exponent, spectrum and contact of each stretch of constant parameters, in order.

        Contact is that of the gear without effects where one of them is not installed.

        Raises:
            AnalysisError: the run has no phase or no displacement, or is too short.
            ParameterError: no gear can have the recorded parameters.
        """
        numbers = [(change.t_s, numbers_of(change, self._effects)) for change in self.changes]
        return analyze_series(self.samples, numbers, Options(), self._gear)

    @cached_property
    def _effects(self) -> list[str]:
        return effect_texts(self.parameters, self.changes)

    @cached_property
    def _gear(self) -> Any:
        try:
            sets = [read_effects(text) for text in self._effects]
        except ParameterError:  # an effect of the user that is not installed here
            sets = [()] * len(self._effects)
        gear = gear_of(self.parameters, with_model=False, sets=sets)
        # Sets of effects are numbered at the operating points only where they change.
        base = {name: value for name, value in gear.base.items() if name != EFFECTS}
        return replace(gear, base=base | ({EFFECTS: 0.0} if self._effects[1:] else {}))

    def to_pandas(self) -> Any:
        """All channels [SI] as columns of a ``pandas.DataFrame``, with the time [s] as its index.

        AnalysisError: pandas is not installed.
        """
        columns = {name: self.samples[name] for name in self.samples.names}
        table = data_frame(columns)
        table.index = library("pandas").Index(self.t, name="time")
        return table

    def to_xarray(self) -> Any:
        """All channels as an ``xarray.Dataset`` over ``time``, with their units."""
        xarray = library("xarray")
        columns = {name: ("time", self.samples[name], _units(name)) for name in self.samples.names}
        time = ("time", self.t, {"units": "s"})
        return xarray.Dataset(columns, {"time": time}, {"name": self.name})

    def title(self) -> str:
        return f"run {self.name}"

    def facts(self) -> list[tuple[str, str]]:
        span = float(self.t[-1] - self.t[0])
        try:
            motions = ", ".join(segment.label for segment in self.segments)
        except (AnalysisError, ParameterError) as error:
            motions = f"not known: {error}"
        facts = [
            (
                "samples",
                f"{len(self.samples)} of {len(self.samples.names)} channels, {span:.4g} s",
            ),
            ("motion", motions),
        ]
        effects = self.parameters.get("effects")
        return [*facts, *([("effects", str(effects))] if effects else []), *self._note_rows()]

    def _note_rows(self) -> list[tuple[str, str]]:
        return [("note", note) for note in self.notes]

    def plot(self, mesh: str | None = None, segment: int = -1) -> Picture:
        """Figure with time course, phase portrait, Poincaré section and spectrum of one mesh.

        Args:
            mesh: name such as ``sp_L``; the first by default.
            segment: index into ``segments``; the last by default.

        Raises:
            AnalysisError: no such mesh or segment.
        """
        if not -len(self.segments) <= segment < len(self.segments):
            raise AnalysisError(
                f"segment must be the index of one of {len(self.segments)}, got {segment}"
            )
        result = self.segments[segment]
        if mesh is not None and mesh not in result.motion.meshes:
            names = ", ".join(result.motion.meshes)
            raise AnalysisError(f"mesh must be one of {names}, got {shown(mesh)}")
        scale = Scale.of(self._gear.b_c_m, self._gear.omega_n)
        return Picture(motion_figure(result, mesh or result.motion.meshes[0], scale))


def _units(channel: str) -> dict[str, str]:
    """Attributes of a channel in ``to_xarray``: its unit; none for a name of another program."""
    try:
        return {"units": unit_of(channel)}
    except KeyError:
        return {}


@any_gear()
def simulate(
    gear: Gear = None,
    cycles: int = 500,
    effects: str | None = None,
    start: Run | None = None,
    **changes: Any,
) -> Run:
    """Simulate a gear for some mesh cycles.

    Args:
        gear: parameters, a parameter file, or None for Tables 1 and 2 of the paper.
        cycles: mesh cycles.
        effects: text such as ``runout@rp:amplitude=2e-5,member=ring`` that replaces the effects
            of the file; None for those of the file.
        start: a simulated run of the same model to continue; the initial state by default.
        changes: parameters by name, as ``delta_T=20.0``.

    Raises:
        ParameterError: a value out of range, no such effect, no cycles, or a recorded run as
            ``start``.
        DivergenceError: the motion diverges.
    """
    if start is not None and start.end is None:
        raise ParameterError(
            f"start must be a run of simulate, got the recording {start.name}: it holds no state "
            "to go on from"
        )
    if cycles < 1:
        raise ParameterError(f"cycles must be at least 1, got {cycles}: take more")
    model = model_of(gear, effects, changes)
    samples, end = integrate.simulate(model, cycles, _continued(start, model))
    name = ", ".join(f"{name} {value}" for name, value in changes.items())
    values = values_of_gear(model.parameters, model.effects)
    return Run(name or "simulated", samples, values, end=end)


def _continued(start: Run | None, model: Model) -> integrate.State | None:
    """Return the end of a run as the start of a gear: relative displacements and rates stay.

    Raises:
        ParameterError: the gear has another model, or other states that effects add.
    """
    if start is None or start.end is None:
        return None
    old, y = build_with(*gear_of_values(start.parameters)), start.end.y
    if old.layout != model.layout or len(y) != model.n_state:
        raise ParameterError(
            f"start must be a run of a gear with {model.n_state} states, got {len(y)}: continue "
            "it with the same model and the same rings and pins that move"
        )
    return change(integrate.stepper(old), integrate.stepper(model), start.end)


@any_gear()
def read_run(path: Path | str) -> Run:
    """Read a recorded run: a run folder or a .mcap file, of this simulator or of a rig.

    Raises:
        RecordingError: no such file, or none that can be read.
    """
    read = read_recording(path)
    return Run(read.name, read.samples, read.channels.parameters, read.changes, read.notes)
