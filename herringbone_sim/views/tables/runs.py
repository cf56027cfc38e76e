"""Tables of an analysis as CSV: segments, section points, spectra, lines, bifurcation."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from herringbone_sim.analysis.bifurcation import BifurcationDiagram
from herringbone_sim.analysis.pipeline import SegmentResult
from herringbone_sim.views.tables.csv_file import write_csv

Cell = str | int | float | None


def segment_columns(results: Sequence[SegmentResult]) -> list[str]:
    """Return the column names of ``segments.csv``."""
    meshes = results[0].motion.meshes
    shares = [f"{share}_{mesh}" for mesh in meshes for share in ("drive", "separated", "back")]
    return [
        *("segment", "start_s", "stop_s", "cycles", "dropped_cycles", *results[0].segment.point),
        *("ramp", "period", "period_residual", "period_reason"),
        *("exponent_per_cycle", "exponent_low", "exponent_high", "exponent_reach"),
        *(
            "exponent_reason",
            "model_exponent_per_cycle",
            "model_exponent_error",
            "cycles_per_tau",
            "noise",
        ),
        *(f"off_lines_{mesh}" for mesh in meshes),
        *shares,
        "notes",
    ]


def segment_row(result: SegmentResult) -> list[Cell]:
    """One row of ``segments.csv``, in the order of ``segment_columns``."""
    off = result.off_lines if len(result.off_lines) else np.full(len(result.contact), np.nan)
    return [
        *(result.number, *result.span_s, result.segment.cycles, result.dropped_cycles),
        *result.segment.point.values(),
        *(result.segment.ramp, result.period.value, result.period.residual, result.period.reason),
        *(result.exponent.value, result.exponent.low, result.exponent.high),
        *(
            result.exponent.reach,
            result.exponent.reason,
            *result.model_exponent,
            result.cycles_per_tau,
            result.noise,
        ),
        *off.tolist(),
        *(share for c in result.contact for share in (c.drive, c.separated, c.back)),
        "; ".join(result.notes),
    ]


def write_segments(path: Path, results: Sequence[SegmentResult]) -> None:
    """Write a CSV table with a row per segment, columns of ``segment_columns``."""
    write_csv(path, segment_columns(results), (segment_row(result) for result in results))


def write_poincare(path: Path, results: Sequence[SegmentResult]) -> None:
    """Write CSV, a row per section point: segment, cycle, t [s], x [m], v [m/s] of all meshes."""
    meshes = results[0].motion.meshes
    names = ["segment", "cycle", "t", *(f"x_{m}" for m in meshes), *(f"v_{m}" for m in meshes)]
    parts = [
        np.column_stack((np.full(len(r.section), r.number), r.section.cycles, r.section.times))
        for r in results
    ]
    states = [np.hstack((r.section.x, r.section.v)) for r in results]
    data = np.hstack((np.vstack(parts), np.vstack(states)))
    formats = ["%d", "%d", "%.12g"] + ["%.9g"] * (2 * len(meshes))
    np.savetxt(path, data, fmt=formats, delimiter=",", header=",".join(names), comments="")


def write_spectrum(path: Path, meshes: Sequence[str], results: Sequence[SegmentResult]) -> None:
    """Write the amplitude spectra [m] of the meshes as CSV, a row per segment and mesh order.

    Segments without a spectrum have no rows.
    """
    names = ["segment", "order", *(f"x_{mesh}" for mesh in meshes)]
    spectra = [(r.number, r.spectrum) for r in results if r.spectrum is not None]
    rows: Iterable[Sequence[Cell]] = (
        [number, order, *amplitudes]
        for number, s in spectra
        for order, amplitudes in zip(s.orders.tolist(), s.amplitudes.tolist(), strict=True)
    )
    write_csv(path, names, rows)


def write_lines(path: Path, results: Sequence[SegmentResult]) -> None:
    """Write CSV, a row per spectral line: amplitude [m] of a mesh at order h / n, period n."""
    rows: Iterable[Sequence[Cell]] = (
        [r.number, line.mesh, line.h, line.n, line.label, line.order, line.amplitude]
        for r in results
        for line in r.lines
    )
    write_csv(path, ["segment", "mesh", "h", "n", "h/n", "order", "amplitude_m"], rows)


def write_bifurcation(path: Path, diagram: BifurcationDiagram) -> None:
    """Write CSV, a row per section point: parameter, x [m], period, exponents of its segment."""
    names = [
        *(diagram.parameter, f"x_{diagram.mesh}", "period", "exponent_per_cycle"),
        *("exponent_low", "exponent_high", "model_exponent_per_cycle", "model_exponent_error"),
    ]
    rows: Iterable[Sequence[Cell]] = (
        [value, x, diagram.periods[i], *diagram.exponents[i], *diagram.model_exponents[i]]
        for i, points in enumerate(diagram.points)
        for value, x in zip(diagram.point_values[i], points, strict=True)
    )
    write_csv(path, names, rows)
