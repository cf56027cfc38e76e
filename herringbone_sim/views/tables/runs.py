"""Tables of an analysis as CSV: segments, section points, spectra, lines, bifurcation."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from herringbone_sim.analysis.bifurcation import BifurcationDiagram
from herringbone_sim.analysis.pipeline import SegmentResult
from herringbone_sim.views.tables.csv_file import write_csv

Cell = str | int | float | None


def segment_row(result: SegmentResult) -> dict[str, Cell]:
    """One row of ``segments.csv``, by column."""
    meshes = result.motion.meshes
    off = result.off_lines if len(result.off_lines) else np.full(len(meshes), np.nan)
    return {
        "segment": result.number,
        "start_s": result.span_s[0],
        "stop_s": result.span_s[1],
        "cycles": result.segment.cycles,
        "dropped_cycles": result.dropped_cycles,
        **result.segment.point,
        "ramp": result.segment.ramp,
        "period": result.period.value,
        "period_residual": result.period.residual,
        "period_reason": result.period.reason,
        "exponent_per_cycle": result.exponent.value,
        "exponent_low": result.exponent.low,
        "exponent_high": result.exponent.high,
        "exponent_reach": result.exponent.reach,
        "exponent_reason": result.exponent.reason,
        "model_exponent_per_cycle": result.model_exponent[0],
        "model_exponent_error": result.model_exponent[1],
        "cycles_per_tau": result.cycles_per_tau,
        "noise": result.noise,
        **{f"off_lines_{mesh}": share for mesh, share in zip(meshes, off.tolist(), strict=True)},
        **{
            f"{name}_{c.mesh}": getattr(c, name)
            for c in result.contact
            for name in ("drive", "separated", "back")
        },
        "notes": "; ".join(result.notes),
    }


def write_segments(path: Path, results: Sequence[SegmentResult]) -> None:
    """Write a CSV table with a row per segment, columns of ``segment_row``."""
    rows = [segment_row(result) for result in results]
    write_csv(path, list(rows[0]), (row.values() for row in rows))


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
