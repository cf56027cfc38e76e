"""A live comparison as text: a table for a terminal, a line for a log, plain data for a topic."""

from __future__ import annotations

import math
from typing import Any

from herringbone_sim.gap.stream.comparison import ComparisonResult, StreamStatus
from herringbone_sim.gap.stream.stretch import NOISE_LIMIT, MotionStatistics, Residual

SCHEMA = "herringbone_sim/gap-live/1"
BAR = 20
EIGHTHS = " ▏▎▍▌▋▊▉█"
UNITS = {"force_law": "N", "torque_balance": "m/s²"}
METRICS = {"force_law": "force law", "torque_balance": "accelerations"}
FACTORS = ("kind", "side", "planet", "contact")


def table(picture: ComparisonResult) -> str:
    """The whole picture, one line a mesh."""
    lines = [_heard("rig", picture.rig), _heard("simulator", picture.simulator)]
    found = picture.residual
    if found is not None:
        lines += [_point(found), "", headline(found), "", *_rows(picture, found), "", _by(found)]
    elif picture.rig_motion is not None:
        lines += ["", *_motions(picture)]
    lines += [f"! {text}" for text in picture.remarks]
    return "\n".join(lines)


def line(picture: ComparisonResult) -> str:
    """One line: where the residual is, or why there is none."""
    found = picture.residual
    if found is None:
        return "no residual: " + ("; ".join(picture.remarks) or "no samples yet")
    text = f"t = {found.t_s:.4f} s  {headline(found)}  {_worst(found)}"
    stale = [remark for remark in picture.remarks if remark not in found.remarks]
    return "; ".join([text, *stale])


def headline(found: Residual) -> str:
    """Size of the residual before and after recalibration, and whether it is more than noise."""
    unit = UNITS[found.metric]
    nominal, after, floor = (found.rms(q) for q in ("nominal", "recalibrated", "floor"))
    word = "a gap" if gap_there(found) else "within the noise"
    return (
        f"{METRICS[found.metric]}: residual {nominal:.4g} {unit} nominal, {after:.4g} {unit} "
        f"recalibrated, floor {floor:.4g} {unit} ({found.total_chi:.2f} floors): {word}"
    )


def gap_there(found: Residual) -> bool:
    """Whether any place is above the noise."""
    return bool(found.shares.any())


def data(picture: ComparisonResult) -> dict[str, Any]:
    """The picture as plain data for the topic ``~/place``; what is not known is left out."""
    content: dict[str, Any] = {
        "schema": SCHEMA,
        "rig": _heard_data(picture.rig),
        "simulator": _heard_data(picture.simulator),
        "remarks": list(picture.remarks),
    }
    found = picture.residual
    if found is not None:
        content |= {
            "t": found.t_s,
            "point": dict(found.point),
            "metric": found.metric,
            "unit": "N" if found.metric == "force_law" else "m/s^2",
            "samples": found.count,
            "gap": gap_there(found),
            "floors": found.total_chi,
            "residual": {q: found.rms(q) for q in ("nominal", "recalibrated", "floor", "signal")},
            "shares": {"mesh" if found.metric == "force_law" else "coordinate": _shares(found)}
            | {factor: found.shares_by(factor) for factor in FACTORS if found.shares_by(factor)},
        }
    if picture.comparable and picture.rig_motion and picture.simulator_motion:
        content["statistics"] = {
            mesh: _statistics(picture.rig_motion, picture.simulator_motion, j)
            for j, mesh in enumerate(picture.rig_motion.meshes)
        }
    return content


def bar(share: float, width: int = BAR) -> str:
    """A bar of a share in eighths of a character."""
    eighths = round(min(max(share, 0.0), 1.0) * width * 8)
    whole, part = divmod(eighths, 8)
    return (EIGHTHS[8] * whole + (EIGHTHS[part] if part else "")).ljust(width)


def _heard(name: str, heard: StreamStatus) -> str:
    if heard.age_s is None:
        return f"{name:9s} {heard.topic}: waiting"
    state = "" if heard.fresh else f", silent for {heard.age_s:.0f} s"
    return (
        f"{name:9s} {heard.topic}: t = {heard.t_s:.4f} s, {heard.received} samples, "
        f"{heard.lost} lost, {heard.restarts} restarts{state}"
    )


def _point(found: Residual) -> str:
    p = found.point
    return (
        f"point     delta_T {p['delta_T']:.4g} K, T_1 {p['T_1']:.4g} N m, K {p['K']:.3g}, "
        f"Omega {p['Omega']:.4g}"
    )


def _rows(picture: ComparisonResult, found: Residual) -> list[str]:
    """One line a place; bars are drawn against the largest share."""
    unit = UNITS[found.metric]
    title = f"{'mesh' if found.metric == 'force_law' else 'place':6s} {'share of the gap':{BAR}s}"
    title += f" {'':>6s} {'floors':>7s} {'residual':>14s}"
    rows = [title + _motion_title(picture)]
    top = max(float(found.shares.max()), 1e-300)
    columns = zip(found.places, found.shares, found.chi, found.rms_of_place, strict=True)
    for place, share, chi, rms in columns:
        text = f"{place:6s} {bar(share / top)} {share:6.1%} {chi:7.2f} {f'{rms:.4g} {unit}':>14s}"
        rows.append(text + _motion_cells(picture, place))
    return rows


def _motions(picture: ComparisonResult) -> list[str]:
    motion = picture.rig_motion
    meshes = motion.meshes if motion else ()
    rows = [f"{mesh:6s}{_motion_cells(picture, mesh)}" for mesh in meshes]
    return [f"{'mesh':6s}{_motion_title(picture)}", *rows]


def _motion_title(picture: ComparisonResult) -> str:
    if picture.rig_motion is None:
        return ""
    beside = " sim" if picture.comparable else ""
    return f"  F RMS rig{beside} [N]   contact rig{beside}   back rig{beside}"


def _motion_cells(picture: ComparisonResult, mesh: str) -> str:
    rig, other = picture.rig_motion, picture.simulator_motion if picture.comparable else None
    if rig is None or mesh not in rig.meshes:
        return ""
    j = rig.meshes.index(mesh)
    sides = [rig] if other is None else [rig, other]
    force = " ".join(_number(float(one.force_rms_n[j]), ".0f", 8) for one in sides)
    drive = " ".join(_number(float(one.contact_shares[j, 2]), ".3f", 6) for one in sides)
    back = " ".join(_number(float(one.contact_shares[j, 0]), ".3f", 6) for one in sides)
    return f"  {force}   {drive}   {back}"


def _number(value: float, form: str, width: int) -> str:
    return f"{value:{width}{form}}" if math.isfinite(value) else "-".rjust(width)


def _by(found: Residual) -> str:
    parts = []
    for factor in FACTORS:
        shares = found.shares_by(factor)
        if any(shares.values()):
            told = "  ".join(f"{name} {share:.0%}" for name, share in shares.items())
            parts.append(f"{factor}: {told}")
    return "   ".join(parts) or f"no place above {math.sqrt(NOISE_LIMIT):.2f} floors"


def _worst(found: Residual) -> str:
    if not gap_there(found):
        return ""
    order = sorted(zip(found.shares, found.places, strict=True), reverse=True)[:3]
    return " ".join(f"{place} {share:.0%}" for share, place in order if share > 0.0)


def _shares(found: Residual) -> dict[str, float]:
    return {place: float(s) for place, s in zip(found.places, found.shares, strict=True)}


def _heard_data(heard: StreamStatus) -> dict[str, Any]:
    content: dict[str, Any] = {"topic": heard.topic, "fresh": heard.fresh}
    content |= {"samples": heard.received, "lost": heard.lost, "restarts": heard.restarts}
    if math.isfinite(heard.t_s):
        content["t"] = heard.t_s
    return content | ({"trouble": heard.trouble} if heard.trouble else {})


def _statistics(rig: MotionStatistics, simulator: MotionStatistics, j: int) -> dict[str, float]:
    told: dict[str, float] = {}
    for name, one in (("rig", rig), ("simulator", simulator)):
        back, apart, drive = (float(v) for v in one.contact_shares[j])
        told |= {
            f"force_rms_{name}": float(one.force_rms_n[j]),
            f"contact_{name}": drive,
            f"separated_{name}": apart,
            f"back_contact_{name}": back,
        }
    return {key: value for key, value in told.items() if math.isfinite(value)}
