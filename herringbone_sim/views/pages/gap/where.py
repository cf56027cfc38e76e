"""Drawing of the gear in a gap report: meshes coloured by share, named places marked."""

from __future__ import annotations

from markupsafe import Markup

from herringbone_sim.core.layout import SIDES
from herringbone_sim.gap.report import Cause, Report
from herringbone_sim.views.gear_geometry import PLANETS
from herringbone_sim.views.pages.gap import words
from herringbone_sim.views.pages.gap.verdict import located_causes
from herringbone_sim.views.pages.gear_drawing import covered, gear_svg, mesh_shares

ON_PLANETS = ("bearing_clearance", "pin_position", "planet_phase")


def where_values(report: Report) -> tuple[Markup, list[str]]:
    """Return the drawing of the gear as SVG, and sentences on the limits of what it shows."""
    shares = mesh_shares(report.where)
    causes = located_causes(report)
    sites = [covered(cause.locus) for cause in causes]
    # Rims around all twelve meshes mark no place.
    rims = {mesh for site in sites if len(site) < len(shares) for mesh in site}
    drawing = gear_svg(shares, rims, {body for cause in causes for body in bodies(cause)})
    return drawing, _remarks(report, shares)


def _remarks(report: Report, shares: dict[str, tuple[float | None, bool]]) -> list[str]:
    remarks = []
    if all(share is None for share, _ in shares.values()):
        remarks.append("How the residual is shared among the meshes is not known.")
    if any(share is not None and not own for share, own in shares.values()):
        remarks.append("Where the report gives one share for several meshes it is spread evenly.")
    metric = report.gap.metric
    if metric in ("torque_balance", "consistency", "trajectory"):
        remarks.append(f"What counts here is not the meshes but the {words.METRICS[metric]}.")
    return remarks


def bodies(cause: Cause) -> set[str]:
    """Return the bodies at which a cause acts, such as ``sun_L``, ``planet2_R``; may be empty."""
    planet, side = cause.locus.planet, cause.locus.side
    part = "ring" if cause.effect == "ring_flexibility" else words.member(cause)
    part = "planet" if cause.effect in ON_PLANETS else part
    numbers = PLANETS if planet == "all" else (planet,)
    names = [f"planet{number}" for number in numbers] if part == "planet" else [part]
    sides = SIDES if side == "all" else (side,)
    return {f"{name}_{half}" for name in names for half in sides if name}
