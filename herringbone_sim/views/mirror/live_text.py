"""A live comparison of rig and simulator as a table, as a line, and as plain data."""

from __future__ import annotations

import math
from typing import Any

from herringbone_sim.gap.stream.comparison import ComparisonResult, StreamStatus
from herringbone_sim.gap.stream.stretch import NOISE_LIMIT, MotionStatistics, Residual

SCHEMA = "herringbone_sim/gap-live/1"
BAR = 20
EIGHTHS = " ▏▎▍▌▋▊▉█"
UNITS = {"force_law": "N", "torque_balance": "m/s²"}
METRIC_NAMES = {"force_law": "force law", "torque_balance": "accelerations"}
FACTORS = ("kind", "side", "planet", "contact")


def table(picture: ComparisonResult) -> str:
    """Return the whole comparison as text, one line per mesh or coordinate."""
    lines = [_source_line("rig", picture.rig), _source_line("simulator", picture.simulator)]
    residual = picture.residual
    if residual is not None:
        lines += [
            _point(residual),
            "",
            headline(residual),
            "",
            *_rows(picture, residual),
            "",
            _factor_line(residual),
        ]
    elif picture.rig_motion is not None:
        lines += ["", *_motions(picture)]
    lines += [f"! {text}" for text in picture.remarks]
    return "\n".join(lines)


def line(picture: ComparisonResult) -> str:
    """Return one line: size of the residual and where most of it is, or why there is none."""
    residual = picture.residual
    if residual is None:
        why = "; ".join(picture.remarks) or "too few samples at one operating point yet"
        return f"no residual: {why}"
    text = f"t = {residual.t_s:.4f} s  {headline(residual)}  {_largest_shares(residual)}"
    stale = [remark for remark in picture.remarks if remark not in residual.remarks]
    return "; ".join([text, *stale])


def headline(residual: Residual) -> str:
    """Return a line with the RMS residual before and after recalibration, and the noise floor."""
    metric, unit = METRIC_NAMES[residual.metric], UNITS[residual.metric]
    nominal, after, floor = (residual.rms(q) for q in ("nominal", "recalibrated", "floor"))
    word = "a gap" if exceeds_noise(residual) else "within the noise"
    return (
        f"{metric}: residual {nominal:.4g} {unit} nominal, {after:.4g} {unit} "
        f"recalibrated, floor {floor:.4g} {unit} ({residual.total_chi:.2f} floors): {word}"
    )


def exceeds_noise(residual: Residual) -> bool:
    """Whether the residual exceeds the noise at any place."""
    return bool(residual.shares.any())


def data(picture: ComparisonResult) -> dict[str, Any]:
    """Return a comparison of rig and simulator as a JSON-like dict, for the topic ``~/place``.

    Always: schema, state of both streams, remarks. With a residual: time [s], operating point,
    metric and unit, RMS residual (nominal, recalibrated, floor, signal), whether it exceeds the
    noise, and its distribution over places, kinds, sides, planets and contact. With comparable
    motions: RMS force [N] and fractions of the time in each contact state, by mesh. Unknown
    values are left out.
    """
    content: dict[str, Any] = {
        "schema": SCHEMA,
        "rig": _source_data(picture.rig),
        "simulator": _source_data(picture.simulator),
        "remarks": list(picture.remarks),
    }
    residual = picture.residual
    if residual is not None:
        content |= {
            "t": residual.t_s,
            "point": dict(residual.point),
            "metric": residual.metric,
            "unit": "N" if residual.metric == "force_law" else "m/s^2",
            "samples": residual.count,
            "gap": exceeds_noise(residual),
            "floors": residual.total_chi,
            "residual": {
                q: residual.rms(q) for q in ("nominal", "recalibrated", "floor", "signal")
            },
            "shares": {
                "mesh" if residual.metric == "force_law" else "coordinate": _shares(residual)
            }
            | {
                factor: residual.shares_by(factor)
                for factor in FACTORS
                if residual.shares_by(factor)
            },
        }
    if picture.comparable and picture.rig_motion and picture.simulator_motion:
        content["statistics"] = {
            mesh: _statistics(picture.rig_motion, picture.simulator_motion, j)
            for j, mesh in enumerate(picture.rig_motion.meshes)
        }
    return content


def bar(share: float, width: int = BAR) -> str:
    """Return a text bar of a fraction from 0 to 1, in eighths of a character."""
    eighths = round(min(max(share, 0.0), 1.0) * width * 8)
    whole, part = divmod(eighths, 8)
    return (EIGHTHS[8] * whole + (EIGHTHS[part] if part else "")).ljust(width)


def _source_line(name: str, heard: StreamStatus) -> str:
    if heard.age_s is None:
        return f"{name:9s} {heard.topic}: waiting"
    state = "" if heard.fresh else f", silent for {heard.age_s:.0f} s"
    return (
        f"{name:9s} {heard.topic}: t = {heard.t_s:.4f} s, {heard.received} samples, "
        f"{heard.lost} lost, {heard.restarts} restarts{state}"
    )


def _point(residual: Residual) -> str:
    p = residual.point
    return (
        f"point     delta_T {p['delta_T']:.4g} K, T_1 {p['T_1']:.4g} N m, K {p['K']:.3g}, "
        f"Omega {p['Omega']:.4g}"
    )


def _rows(picture: ComparisonResult, residual: Residual) -> list[str]:
    """Return a head and one line per place; bars are relative to the largest fraction."""
    unit = UNITS[residual.metric]
    title = (
        f"{'mesh' if residual.metric == 'force_law' else 'place':6s} {'share of the gap':{BAR}s}"
    )
    title += f" {'':>6s} {'floors':>7s} {'residual':>14s}"
    rows = [title + _motion_title(picture)]
    top = max(float(residual.shares.max()), 1e-300)
    columns = zip(
        residual.places, residual.shares, residual.chi, residual.rms_by_place, strict=True
    )
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
    force = " ".join(_number(float(motion.force_rms_n[j]), ".0f", 8) for motion in sides)
    drive = " ".join(_number(float(motion.contact_shares[j, 2]), ".3f", 6) for motion in sides)
    back = " ".join(_number(float(motion.contact_shares[j, 0]), ".3f", 6) for motion in sides)
    return f"  {force}   {drive}   {back}"


def _number(value: float, form: str, width: int) -> str:
    return f"{value:{width}{form}}" if math.isfinite(value) else "-".rjust(width)


def _factor_line(residual: Residual) -> str:
    parts = []
    for factor in FACTORS:
        shares = residual.shares_by(factor)
        if any(shares.values()):
            text = "  ".join(f"{name} {share:.0%}" for name, share in shares.items())
            parts.append(f"{factor}: {text}")
    return "   ".join(parts) or f"no place above {math.sqrt(NOISE_LIMIT):.2f} floors"


def _largest_shares(residual: Residual) -> str:
    if not exceeds_noise(residual):
        return ""
    order = sorted(zip(residual.shares, residual.places, strict=True), reverse=True)[:3]
    return " ".join(f"{place} {share:.0%}" for share, place in order if share > 0.0)


def _shares(residual: Residual) -> dict[str, float]:
    return {place: float(s) for place, s in zip(residual.places, residual.shares, strict=True)}


def _source_data(heard: StreamStatus) -> dict[str, Any]:
    content: dict[str, Any] = {"topic": heard.topic, "fresh": heard.fresh}
    content |= {"samples": heard.received, "lost": heard.lost, "restarts": heard.restarts}
    if math.isfinite(heard.t_s):
        content["t"] = heard.t_s
    return content | ({"trouble": heard.trouble} if heard.trouble else {})


def _statistics(rig: MotionStatistics, simulator: MotionStatistics, j: int) -> dict[str, float]:
    """Return RMS force [N] and contact fractions of mesh number ``j`` in both motions; no NaN."""
    values: dict[str, float] = {}
    for name, motion in (("rig", rig), ("simulator", simulator)):
        back, apart, drive = (float(v) for v in motion.contact_shares[j])
        values |= {
            f"force_rms_{name}": float(motion.force_rms_n[j]),
            f"contact_{name}": drive,
            f"separated_{name}": apart,
            f"back_contact_{name}": back,
        }
    return {key: value for key, value in values.items() if math.isfinite(value)}
