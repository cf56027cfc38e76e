"""Compare a campaign (a folder of runs with campaign.yaml) with the nominal model: the residual
F - (k(t) f(x) + c v) of every run by mesh; which effect explains it, with probability and size;
and how far the augmented model closes the gap on runs of role held_out, which are used in no fit:
by residual, by prediction over a horizon short against the Lyapunov time, and by attractor.
Writes residual.csv, report.json, augmented.yaml (parameters for the node, recalibrated and with
the effects), report.html, and of few sensors forces.csv: the forces of all meshes in a run, with
90 % bands.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import numpy as np

from herringbone_sim.cli.arguments import Alone
from herringbone_sim.cli.options import FORMS, File, Out, mirror_target, progress
from herringbone_sim.cli.show import wait_for_interrupt
from herringbone_sim.core.layout import KINDS
from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.errors import HerringboneError
from herringbone_sim.gap.data.prepare import prepare
from herringbone_sim.gap.data.screen import finding_texts
from herringbone_sim.gap.diagnose import Diagnosis, diagnose
from herringbone_sim.gap.observations.reconstructed_forces import ReconstructedForces
from herringbone_sim.gap.report import Estimate, Report
from herringbone_sim.gap.report_file import write_report
from herringbone_sim.gap.residuals.force_residual import ForceResidual, force_residual
from herringbone_sim.gap.verdict.augmented import save_augmented
from herringbone_sim.gap.verdict.next_experiment import NextExperiment
from herringbone_sim.gap.verification.residual_gap import Gap
from herringbone_sim.gap.verification.serialise import forces_to_dict
from herringbone_sim.recording.campaign import Campaign, CampaignRun, read_campaign
from herringbone_sim.recording.parameter_file import load_parameters
from herringbone_sim.recording.reader import read_recording
from herringbone_sim.sweeps.output import make_folder
from herringbone_sim.views.figures.gap_arrays import gap_arrays
from herringbone_sim.views.mirror.target import MirrorTarget
from herringbone_sim.views.pages.gap.page import write_gap_page
from herringbone_sim.views.tables.csv_file import write_csv
from herringbone_sim.views.tables.forces import write_forces

EXAMPLES = """\
python -m herringbone_sim rig make --out rigs/pin --seed 7 \\
    --effect pin_position@all/2/all:offset=1.5e-5
python -m herringbone_sim gap rigs/pin --nominal config/rig.yaml --out gap_pin
"""
STEPS = 16  # of a diagnosis, about, besides one per run
CLOSE_S = 60.0
POINT = {"delta_T": " K", "T_1": " N m", "Omega": "", "K": ""}


def run(
    campaign: Annotated[Path, "CAMPAIGN", "folder of runs"],
    /,
    *,
    nominal: Annotated[File, "parameters of the rig"],
    out: Out,
    rerun: Annotated[
        str | None,
        "[WHERE]",
        Alone("save"),
        f"mirror to the Rerun viewer: {FORMS} [save; save writes DIR/gap.rrd]",
    ] = None,
) -> int:
    """Diagnose a campaign: print residuals and verdict, write the files of the report to ``out``.

    The diagnosis uses the model ``full``, also if the file ``nominal`` names ``reduced``. With
    ``rerun`` the result also goes to the Rerun viewer, or to a file that it can open.

    Returns:
        Exit code 0.
    """
    target = mirror_target(rerun, out / "gap.rrd")
    runs = read_campaign(campaign)
    gear = load_parameters(nominal).changed({"model": "full"})
    make_folder(out)
    residual_table(runs, gear, out / "residual.csv")
    prepared = prepare(campaign, gear)
    with progress(STEPS + len(prepared.runs)) as step:
        diagnosis = diagnose(prepared, step)
    write_report(out / "report.json", diagnosis.report)
    save_augmented(out / "augmented.yaml", gear, diagnosis.augmented, prepared.rig)
    arrays = gap_arrays(diagnosis.calibrated, diagnosis.report.forces)
    page = write_gap_page(diagnosis.report, out, arrays, nominal)
    print(summary(diagnosis.report))
    names = ["residual.csv", "report.json", "augmented.yaml"]
    write_forces(out / "forces.csv", diagnosis.report.forces)
    if diagnosis.report.forces is not None:
        names.append("forces.csv")
    print(f"written: {', '.join(str(out / name) for name in names)}, {page}")
    if target is not None:
        print(mirror_gap(target, diagnosis))
    return 0


def residual_table(campaign: Campaign, nominal: Parameters, path: Path) -> None:
    """Print the RMS residual of the nominal model for each run, and write it by mesh to a CSV.

    Of a run without a residual, the reason is printed and nothing is written.
    """
    print(f"{'run':10s} {'role':9s} {'residual [N]':>13s} {'of force':>9s}  largest mesh (share)")
    printed: set[str] = set()
    rows: list[list[str]] = []
    for run in campaign.runs:
        try:
            model = build(nominal.changed(run.point))
            residual = force_residual(model, read_recording(run.path).samples)
        except HerringboneError as error:
            text = str(error)
            print(f"{run.path.name:10s} {run.role:9s} {'as above' if text in printed else text}")
            printed.add(text)
            continue
        print(residual_line(run, residual))
        force = np.nanmean(residual.force_n**2, axis=0) ** 0.5
        for mesh, *sizes in zip(
            residual.meshes, residual.rms_n, force, residual.shares, strict=True
        ):
            rows.append([run.path.name, run.role, mesh, *(f"{v:.6g}" for v in sizes)])
    write_csv(path, ["run", "role", "mesh", "residual_rms_n", "force_rms_n", "share"], rows)


def residual_line(run: CampaignRun, residual: ForceResidual) -> str:
    """Line on a run: RMS residual [N], its ratio to the RMS force, and the worst mesh."""
    total = float(np.nanmean(residual.residual_n**2) ** 0.5)
    force = float(np.nanmean(residual.force_n**2) ** 0.5)
    worst = int(residual.shares.argmax())
    return (
        f"{run.path.name:10s} {run.role:9s} {total:13.1f} {total / force:8.2%}  "
        f"{residual.meshes[worst]} ({residual.shares[worst]:.0%})"
    )


def summary(report: Report) -> str:
    """Text of a diagnosis: verdict, likeliest causes, gap before and after, open questions."""
    verdict, gap = report.verdict, report.gap
    lines = [f"verdict: {verdict.verdict}  {', '.join(verdict.effects)}".rstrip()]
    for cause in report.causes[:4]:
        values = ", ".join(_value(name, value) for name, value in cause.parameters.items())
        lines.append(f"  {cause.probability:7.2%}  {cause.effect:22s} {cause.place:10s} {values}")
    if math.isfinite(gap.rms("nominal")):
        lines.append(
            f"{gap.metric} on held-out runs: nominal {gap.rms('nominal'):.4g}, augmented "
            f"{gap.rms('augmented'):.4g}, floor {gap.rms('floor'):.4g}, closure "
            f"{gap.closure:.1%}"
        )
    runner_up = gap.closed("runner_up")
    if math.isfinite(runner_up):
        lines.append(f"  runner-up as a control: closure {runner_up:.1%}")
    if report.senses is not None:
        others = (report.senses.prediction, report.senses.attractor)
        lines += [sense_line(gap) for gap in others if math.isfinite(gap.rms("nominal"))]
    if report.forces is not None:
        lines.append(forces_line(report.forces))
    lines += [f"wrong with the recording: {text}" for text in finding_texts(report.findings)]
    said = {finding.text for finding in report.findings}
    open_ = [text for text in report.undecidable if text not in said]
    lines += [f"can't tell: {text}" for text in open_]
    return "\n".join([*lines, next_line(report.next_experiment)])


def _value(name: str, value: Estimate) -> str:
    """Text of a parameter of an effect with its 90 % interval, or of an option."""
    if value.ci90 is None:
        shown = list(value.value) if isinstance(value.value, tuple) else value.value
        return f"{name} {shown}"
    low, high = value.ci90
    return f"{name} {value.value:.4g} {value.unit} [{low:.4g}, {high:.4g}]"


def forces_line(reconstructed: ReconstructedForces) -> str:
    """Line on the reconstructed forces: largest RMS and half 90 % band of sun and ring meshes."""
    parts, forces = [], forces_to_dict(reconstructed)
    for kind in KINDS:
        of = [mesh for name, mesh in forces["meshes"].items() if name.startswith(kind)]
        size, half = (max(mesh[key] for mesh in of) for key in ("rms", "half_width_90"))
        parts.append(f"{kind} {size:.4g} RMS, band +-{half:.2g}")
    return f"mesh forces of {forces['run']} [N], largest: {'; '.join(parts)}"


def next_line(experiment: NextExperiment) -> str:
    """Line with the operating point to measure next, and the reason."""
    point = ", ".join(f"{name} {experiment.point[name]:g}{unit}" for name, unit in POINT.items())
    return f"next to run: {point}; {experiment.why}"


def sense_line(gap: Gap) -> str:
    """One line on a gap over the held-out runs: its size and how much of it is closed.

    RMS of the nominal gear and of the augmented model, and that expected from noise alone, in the
    unit of the gap; closure of the augmented model and of the runner-up [%].
    """
    values = ", ".join(f"{name} {gap.rms(name):.3g}" for name in ("nominal", "augmented", "floor"))
    return (
        f"{gap.metric} on held-out runs [{gap.unit}]: {values}, closure {gap.closure:.1%}, "
        f"runner-up {gap.closed('runner_up'):.1%}"
    )


def mirror_gap(target: MirrorTarget, diagnosis: Diagnosis) -> str:
    """Send a diagnosis to the Rerun viewer; return a line on where it went or why that failed."""
    try:
        from herringbone_sim.views.mirror.gap import mirror
        from herringbone_sim.views.mirror.sink import open_sink

        sink = open_sink(target)
        try:
            mirror(diagnosis, sink)
            if target.mode == "serve":
                wait_for_interrupt(sink.address)
        finally:
            sink.close(CLOSE_S)
    except Exception as error:
        # The report is written already: a failing viewer must not end the verb with an error.
        return f"not mirrored: {error}"
    return f"mirrored to {sink.address}"
