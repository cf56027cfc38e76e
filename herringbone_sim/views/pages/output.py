"""Files of an analysed run: figures, tables, the page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from herringbone_sim.analysis.bifurcation import BifurcationDiagram, bifurcation_diagram
from herringbone_sim.analysis.pipeline import SegmentResult
from herringbone_sim.errors import AnalysisError
from herringbone_sim.sweeps.output import make_folder
from herringbone_sim.views.figures import motion as figures
from herringbone_sim.views.figures import style
from herringbone_sim.views.figures.style import Scale
from herringbone_sim.views.pages.html import write_page
from herringbone_sim.views.pages.report import Report, report_html
from herringbone_sim.views.picture import Picture
from herringbone_sim.views.tables import runs as tables


def write_run(
    folder: Path,
    report: Report,
    mesh: str,
    scale: Scale,
) -> Path:
    """Write CSV tables, ``figures/`` and ``report.html`` of one run; return the page's path.

    Args:
        folder: made if new; files of an earlier analysis are overwritten.
        report: results of the run.
        mesh: name of the mesh in the figures.
        scale: units of the axes.

    Raises:
        AnalysisError: the folder can't be written.
    """
    make_folder(folder / "figures")
    results = report.results
    chosen = figures.representatives(results)
    written = _tables(folder, results, chosen)
    pictures = []
    notes = list(report.notes)
    try:
        diagram = bifurcation_diagram(results, mesh)
    except AnalysisError as error:
        notes.append(f"no bifurcation diagram: {error}")
    else:
        paths = write_diagram(folder, diagram, scale)
        written.append("bifurcation.csv")
        pictures.append(Picture(paths[1], _diagram_caption(diagram)))
    pictures += [_motion_picture(folder, result, mesh, scale) for result in chosen]
    if len(chosen) < len(results):
        numbers = ", ".join(str(result.number) for result in chosen)
        notes.append(
            f"figures show {len(chosen)} of {len(results)} segments (number {numbers}): one of "
            "each period first, then the longest"
        )
    written += ["figures/*.png", "figures/*.svg"]
    html = report_html(replace(report, notes=notes), pictures, written)
    return write_page(folder / "report.html", html)


def write_diagram(
    folder: Path, diagram: BifurcationDiagram, scale: Scale
) -> tuple[Path, Path, Path]:
    """Write ``bifurcation.csv``, ``figures/bifurcation.png`` and ``.svg``; return the paths."""
    make_folder(folder / "figures")
    table = folder / "bifurcation.csv"
    tables.write_bifurcation(table, diagram)
    figure = figures.bifurcation_figure(diagram, scale)
    return table, *style.save(figure, folder / "figures", "bifurcation")


def _tables(
    folder: Path, results: Sequence[SegmentResult], chosen: Sequence[SegmentResult]
) -> list[str]:
    """Write the tables, spectra of the chosen segments only; return the file names."""
    tables.write_segments(folder / "segments.csv", results)
    tables.write_poincare(folder / "poincare.csv", results)
    tables.write_lines(folder / "lines.csv", results)
    tables.write_spectrum(folder / "spectrum.csv", results[0].motion.meshes, chosen)
    return ["segments.csv", "poincare.csv", "lines.csv", "spectrum.csv"]


def _motion_picture(folder: Path, result: SegmentResult, mesh: str, scale: Scale) -> Picture:
    figure = figures.motion_figure(result, mesh, scale)
    path, _ = style.save(figure, folder / "figures", f"segment_{result.number:03d}")
    band = "; grey: flanks apart" if result.half_backlash_m else ""
    return Picture(
        path,
        f"Segment {result.number}, {result.label}: time course, phase portrait, Poincaré "
        f"section and spectrum of x_{mesh}{band}; {result.dropped_cycles} cycles dropped",
    )


def _diagram_caption(diagram: BifurcationDiagram) -> str:
    below = " above the largest exponent" if figures.has_exponents(diagram) else ""
    return f"Bifurcation diagram of x_{diagram.mesh} over {diagram.parameter}{below}"
