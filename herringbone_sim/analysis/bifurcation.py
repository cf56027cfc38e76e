"""Bifurcation diagram from recorded segments: section points and exponents over one parameter."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from herringbone_sim.analysis.pipeline import SegmentResult
from herringbone_sim.analysis.segments import FREQUENCY
from herringbone_sim.arrays import Array, Flags
from herringbone_sim.errors import AnalysisError

MAX_POINTS = 400
LEAST_VALUES = 3


@dataclass(frozen=True)
class BifurcationDiagram:
    """Long-term motion over one parameter.

    Attributes:
        parameter: its name, as in the operating points.
        values: (n,) its values, in the order of the segments.
        points: n arrays of section displacements of one mesh, m.
        point_values: n arrays of the parameter value at each point, which changes within a ramp.
        mesh: name such as ``sp_L``.
        exponents: (n, 3) estimated from the data: value and 90 % interval (low, high), per mesh
            cycle.
        model_exponents: (n, 2) of the nominal model: value, standard error, per mesh cycle.
        periods: n periods in mesh cycles, 0 = aperiodic, None where none could be determined.
        cycles_per_tau: (n,) Omega / 2 pi, NaN if unknown.
    """

    parameter: str
    values: Array
    points: tuple[Array, ...]
    point_values: tuple[Array, ...]
    mesh: str
    exponents: Array
    model_exponents: Array
    periods: tuple[int | None, ...]
    cycles_per_tau: Array

    @property
    def falling(self) -> Flags:
        """(n,) whether each value was reached from a larger one, as on a downward branch."""
        falling = np.zeros(len(self.values), dtype=bool)
        for i in range(1, len(self.values)):
            step = self.values[i] - self.values[i - 1]
            falling[i] = falling[i - 1] if step == 0 else step < 0
        return falling


def bifurcation_diagram(
    results: Sequence[SegmentResult], mesh: str | None = None
) -> BifurcationDiagram:
    """Bifurcation diagram over the parameter with the most values, from analysed segments.

    The other parameters must be equal; where they differ, the segments with their most frequent
    combination are used.

    Args:
        results: segments of one run, or of several.
        mesh: the mesh whose displacement is shown; the first by default.

    Raises:
        AnalysisError: no parameter takes three values, or several differ from run to run.
    """
    used = [result for result in results if len(result.section)]
    parameter, chosen = _one_parameter(used)
    mesh = mesh or chosen[0].motion.meshes[0]
    if any(mesh not in result.motion.meshes for result in chosen):
        raise AnalysisError(
            f"a bifurcation diagram needs one mesh in every run, got runs without x_{mesh}: "
            "hand in runs with the same meshes"
        )
    exponents = [(r.exponent.value, r.exponent.low, r.exponent.high) for r in chosen]
    points = tuple(_points(result, mesh) for result in chosen)
    return BifurcationDiagram(
        parameter,
        np.array([r.segment.point[parameter] for r in chosen]),
        points,
        tuple(_point_values(result, parameter) for result in chosen),
        mesh,
        np.array(exponents),
        np.array([r.model_exponent for r in chosen]),
        tuple(r.period.value for r in chosen),
        np.array([r.cycles_per_tau for r in chosen]),
    )


def _points(result: SegmentResult, mesh: str) -> Array:
    """Up to ``MAX_POINTS`` section displacements (k,) [m] of a mesh in a segment.

    The last successive ones if the segment is periodic; else (aperiodic, a ramp, or no period
    found) evenly spaced ones, so that they cover almost the whole segment.
    """
    x = result.section.x[:, result.motion.meshes.index(mesh)]
    points: Array = x[_shown(result)].copy()
    return points


def _shown(result: SegmentResult) -> slice:
    """Section points of a segment that are shown, see ``_points``."""
    stride = 1 if result.period.value else max(len(result.section) // MAX_POINTS, 1)
    return slice(-MAX_POINTS * stride, None, stride)


def _point_values(result: SegmentResult, parameter: str) -> Array:
    """Parameter value at each of the points of ``_points``."""
    times = result.section.times[_shown(result)]
    if result.segment.ramp == parameter:
        return np.interp(times, result.span_s, result.segment.ramp_ends)
    return np.full(len(times), result.segment.point[parameter])


def _one_parameter(results: Sequence[SegmentResult]) -> tuple[str, list[SegmentResult]]:
    """Name of the parameter with the most values, and the segments in which only it differs."""
    keys = [{name: _key(name, value) for name, value in r.segment.point.items()} for r in results]
    names = list(dict.fromkeys(name for key in keys for name in key))
    counts = {name: len({key.get(name) for key in keys}) for name in names}
    parameter = max(names, key=lambda name: counts[name], default="")
    if not parameter or counts[parameter] < LEAST_VALUES:
        raise AnalysisError(
            f"a bifurcation diagram needs {LEAST_VALUES} different values of one parameter, got "
            f"{_list(counts)}: hand in a ramp, a staircase, or runs that differ in one parameter"
        )
    rests = [tuple(key.get(name) for name in names if name != parameter) for key in keys]
    commonest = Counter(rests).most_common(1)[0][0]
    chosen = [r for r, rest in zip(results, rests, strict=True) if rest == commonest]
    if len({_key(parameter, r.segment.point[parameter]) for r in chosen}) < LEAST_VALUES:
        raise AnalysisError(
            f"several parameters differ at once ({_list(counts)}): hand in runs that differ in "
            "one parameter only"
        )
    return parameter, chosen


def _list(counts: dict[str, int]) -> str:
    """Text with the number of values of each parameter that has more than one."""
    many = [f"{name}: {count} values" for name, count in counts.items() if count > 1]
    return ", ".join(many) or "no parameter that differs"


def _key(name: str, value: float) -> float | None:
    """Value rounded so that equal settings have equal keys; None for NaN.

    Settings are rounded to 6 significant digits, the measured mesh frequency to 4.
    """
    if not np.isfinite(value):
        return None
    digits = 4 if name == FREQUENCY else 6
    return float(f"{value:.{digits - 1}e}")
