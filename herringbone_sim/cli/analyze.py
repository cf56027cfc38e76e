"""Analyse the motion in each segment of a recorded run. A segment ends where a parameter changes;
its transient is discarded. The analysis gives

  period             P1, P2, ... in mesh cycles, or aperiodic
  largest exponent   of the data with a 90 % interval, and of the model for the
                     same parameters; above 0 the motion is chaotic
  spectrum           with the lines h / n of the mesh frequency
  Poincare section   one point per mesh cycle
  contact            share of time in drive contact, apart, in back contact

A run (or several) over which one parameter takes three or more values gives a bifurcation diagram
with the exponents below it. Works on runs of this simulator and of any rig, without ROS.

DIR then holds report.html (open this first), figures/*.png and *.svg, and tables as CSV. With
more than one RUN each has its own folder in DIR.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

from herringbone_sim.analysis.bifurcation import bifurcation_diagram
from herringbone_sim.analysis.known_gear import effect_texts, gear_of, numbers_of
from herringbone_sim.analysis.motion import with_phase
from herringbone_sim.analysis.pipeline import Options as Settings
from herringbone_sim.analysis.pipeline import SegmentResult, analyze_series
from herringbone_sim.cli.options import Count, Cycles, File, Mesh, Out, flattened, limits
from herringbone_sim.effects.written import read_effects
from herringbone_sim.errors import AnalysisError, HerringboneError
from herringbone_sim.recording.parameter_file import load_gear, values_of_gear
from herringbone_sim.recording.reader import Recording, read_recording
from herringbone_sim.views.figures.style import Scale
from herringbone_sim.views.pages.html import number
from herringbone_sim.views.pages.output import write_diagram, write_run
from herringbone_sim.views.pages.report import Report, changing
from herringbone_sim.views.tables.text import aligned

MAX_LINES = 42
EXAMPLES = """\
python -m herringbone_sim run --ros-args -p record:=true -p record_name:=first
python -m herringbone_sim analyze runs/first --out analysis
"""


@dataclass(frozen=True)
class Analysed:
    """Results of the analysis of one run, without its samples.

    Attributes:
        name: name of the run; also of its folder if several runs are analysed.
        folder: folder with the report, figures and tables of the run.
        results: one result per segment.
        scale: units of the axes.
        mesh: name of the mesh in the figures.
        effects: a text line per set of effects that was in force during the run.
    """

    name: str
    folder: Path
    results: list[SegmentResult]
    scale: Scale
    mesh: str
    effects: list[str]


@flattened
@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Options of the analysis."""

    out: Out
    mesh: Mesh = None
    transient: Annotated[
        Cycles | None,
        "mesh cycles to discard after each change (default: measured, given in the report)",
    ] = None
    noise: Annotated[
        float | None,
        "SHARE",
        limits(gte=0.0, lt=1.0),
        "measurement noise as a share of each channel's RMS, as 0.01 (default: estimated)",
    ] = None
    max_period: Annotated[Count, limits(gte=1), "largest period looked for, in mesh cycles"] = 16
    parameters: Annotated[
        File | None, "parameter file of the gear, for runs that do not hold its parameters"
    ] = None
    no_model: Annotated[bool, "compute no exponent of the model"] = False
    mesh_frequency: Annotated[
        float | None, "HZ", limits(gt=0.0), "mesh frequency of a run that has no phase channel"
    ] = None


def run(
    runs: Annotated[tuple[Path, ...], "RUN ...", "run folder, or a .mcap file"],
    /,
    *,
    options: Options,
) -> int:
    """Analyse the runs, write reports and print a summary of each; exit code 0.

    Raises:
        AnalysisError: runs that can't be read or analysed, or have no such mesh; after all others.
    """
    names, out = _folder_names(runs), options.out
    several = len(runs) > 1
    folders = [out / name if several else out for name in names]
    analysed, failed = [], []
    for path, name, folder in zip(runs, names, folders, strict=True):
        try:
            analysed.append(_analyse(path, name, folder, options))
        except HerringboneError as error:
            failed.append(f"{name}: {error}" if several else str(error))
    for result in analysed:
        print(_summary(result))
    if len(analysed) > 1:
        _joint_diagram(analysed, out)
    if failed:
        head = f"{len(failed)} of {len(runs)} runs can't be analysed: " if several else ""
        raise AnalysisError(head + "; ".join(failed))
    return 0


def _analyse(path: Path, name: str, folder: Path, options: Options) -> Analysed:
    recording = read_recording(path)
    series = recording.samples
    if options.mesh_frequency is not None:
        if "phase" in series:
            raise AnalysisError(
                f"--mesh-frequency is for runs without a phase channel, and {name} has one: leave "
                "it out"
            )
        series = with_phase(series, options.mesh_frequency)
    parameters = _parameters(recording, options.parameters)
    texts = effect_texts(parameters, recording.changes)
    sets = [read_effects(text) for text in texts]
    gear = gear_of(parameters, with_model=not options.no_model, sets=sets)
    settings = Settings(options.transient, options.noise, max_period=options.max_period)
    changes = [(change.t_s, numbers_of(change, texts)) for change in recording.changes]
    results = analyze_series(series, changes, settings, gear, _progress(name))
    mesh = _mesh(options.mesh, results)
    scale = Scale.of(gear.b_c_m, gear.omega_n)
    facts = [*_facts(recording, results), *_effect_lines(texts)]
    write_run(folder, Report(name, facts, results, recording.notes), mesh, scale)
    # Only sections are needed from here on; the samples of many runs would fill the memory.
    slim = [replace(result, motion=result.motion.rows(0, 2)) for result in results]
    return Analysed(name, folder, slim, scale, mesh, _effect_lines(texts))


def _parameters(recording: Recording, path: Path | None) -> Mapping[str, Any]:
    if path:
        return values_of_gear(*load_gear(path))
    return recording.channels.parameters


def _effect_lines(texts: Sequence[str]) -> list[str]:
    if texts == [""]:
        return []
    return [f"effects {number}: {text or 'none'}" for number, text in enumerate(texts)]


def _mesh(name: str | None, results: Sequence[SegmentResult]) -> str:
    meshes = results[0].motion.meshes
    if name is not None and name not in meshes:
        raise AnalysisError(
            f"--mesh must be one of {', '.join(meshes)}, got {name!r}: take a mesh of this run"
        )
    return name or meshes[0]


def _facts(recording: Recording, results: Sequence[SegmentResult]) -> list[str]:
    samples = recording.samples
    cycles = sum(result.segment.cycles for result in results)
    span = float(samples.times[-1] - samples.times[0])
    return [
        f"{span:.6g} s",
        f"{len(samples)} samples of {len(samples.names)} channels",
        f"{cycles:.0f} mesh cycles",
        f"{len(results)} segments" if len(results) > 1 else "1 segment",
        "finished" if recording.complete else "not whole, read as far as it goes",
    ]


def _joint_diagram(analysed: Sequence[Analysed], out: Path) -> None:
    """Write the bifurcation diagram of all runs, or print why there is none."""
    results = [result for run in analysed for result in run.results]
    try:
        diagram = bifurcation_diagram(results, analysed[0].mesh)
    except AnalysisError as error:
        print(f"no joint bifurcation diagram: {error}")
        return
    paths = write_diagram(out, diagram, analysed[0].scale)
    print(f"joint bifurcation diagram over {diagram.parameter}: {', '.join(map(str, paths))}")


def _summary(run: Analysed) -> str:
    """Text table of the segments of a run, and the path of its report.

    Of more than ``MAX_LINES`` lines those in the middle are left out.
    """
    point = changing(run.results)
    rows = [["segment", "start [s]", "cycles", "dropped", *point, "motion", "exponent", "model"]]
    rows += [_summary_row(result, point) for result in run.results]
    lines = aligned(rows, right=True)
    if len(lines) > MAX_LINES:
        lines[MAX_LINES // 2 : -MAX_LINES // 2] = [f"... {len(lines) - MAX_LINES} more"]
    return "\n".join(
        [run.name, *run.effects, *lines, f"written: {run.folder / 'report.html'}", ""]
    )


def _summary_row(result: SegmentResult, point: Sequence[str]) -> list[str]:
    return [
        str(result.number),
        number(result.span_s[0]),
        f"{result.segment.cycles:.0f}",
        str(result.dropped_cycles),
        *(number(result.segment.point[name]) for name in point),
        result.label,
        number(result.exponent.value, 3),
        number(result.model_exponent[0], 3),
    ]


def _folder_names(paths: Sequence[Path]) -> list[str]:
    """Folder name for each run: that of its file or folder, repeated names as ``NAME~2``, ..."""
    names: list[str] = []
    for path in paths:
        stem = path.stem if path.suffix == ".mcap" else Path(os.path.abspath(path)).name
        name, number = stem, 1
        while name in names:
            number += 1
            name = f"{stem}~{number}"
        names.append(name)
    return names


def _progress(name: str) -> Any:
    """Callback (done, total) that prints the progress over the segments on a terminal."""

    def show(done: int, total: int) -> None:
        if sys.stderr.isatty():
            end = "\n" if done == total else ""
            print(f"\r{name}: segment {done} of {total}", end=end, file=sys.stderr, flush=True)

    return show
