"""Curves that a diagnosis fits to effects whose law has a free shape, for the report."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.diagnosis.machine import Hypothesis
from herringbone_sim.gap.observations.basis import LOADS_M
from herringbone_sim.gap.observations.friction import FRICTION, OF_COULOMB, friction_shapes
from herringbone_sim.gap.observations.hypotheses.damaged_teeth import BUMP, KNOTS


@dataclass(frozen=True)
class LearnedLaw:
    """The curve of an effect as fitted to the data.

    Attributes:
        effect: id.
        x_name, x_unit, y_name, y_unit: names and units of the axes.
        x, y: (n,) points of the curve.
        low, high: (n,) limits of its 90 % band.
    """

    effect: str
    x_name: str
    x_unit: str
    y_name: str
    y_unit: str
    x: Array
    y: Array
    low: Array
    high: Array

    def to_dict(self) -> dict[str, object]:
        """The curve as plain data for ``report.json``."""
        return {
            "effect": self.effect,
            "x": {"name": self.x_name, "unit": self.x_unit, "values": self.x.tolist()},
            "y": {
                "name": self.y_name,
                "unit": self.y_unit,
                "values": self.y.tolist(),
                "low": self.low.tolist(),
                "high": self.high.tolist(),
            },
        }


def learned_law(h: Hypothesis, mean: Array, draws: Array) -> LearnedLaw | None:
    """The fitted curve of an effect with its 90 % band; None if its law has no free shape.

    Args:
        h: hypothesis with the coefficients of the curve.
        mean: (k,) fitted coefficients.
        draws: (n, k) random draws of them, for the band.
    """
    make = CURVES.get(h.effect)
    if make is None:
        return None
    x, matrix, axes = make(h)
    y = matrix @ mean
    band = np.quantile(draws @ matrix.T, [0.05, 0.95], axis=0)
    return LearnedLaw(h.effect, *axes, x, y, np.minimum(band[0], y), np.maximum(band[1], y))


# x (n,), matrix (n, k) from the coefficients to y, and names and units of the axes
Curve = tuple[Array, Array, tuple[str, str, str, str]]
PHASES = np.linspace(0.0, 2.0 * np.pi, 97)


def _trig(name: str) -> Array:
    """Cosine or sine (97,) over ``PHASES`` for a coefficient named such as ``2 sin``."""
    order, _, trig = name.partition(" ")
    return np.asarray({"cos": np.cos, "sin": np.sin}[trig](float(order) * PHASES))


def _over_angle(x_name: str, y_name: str, y_unit: str) -> Callable[[Hypothesis], Curve]:
    """Return a function of a hypothesis that makes the curve of waves over an angle, 0 to 2 pi.

    Coefficients named such as ``2 sin`` are of that order, ``cos`` and ``sin`` of the option
    ``order``.

    Args:
        x_name: name of the angle; ``{NAME}`` stands for an option of the hypothesis.
        y_name, y_unit: of the values.
    """

    def make(h: Hypothesis) -> Curve:
        options = dict(h.options)
        names = [
            c.name if " " in c.name else f"{options['order']} {c.name}" for c in h.coefficients
        ]
        matrix = np.stack([_trig(n) for n in names], axis=1)
        return PHASES, matrix, (x_name.format(**options), "rad", y_name, y_unit)

    return make


def _over_window(y_name: str, y_unit: str) -> Callable[[Hypothesis], Curve]:
    """Return a function that gives the ``Curve`` of a tooth event, the same for every hypothesis.

    Its values are over mesh cycles from the middle of the contact (``KNOTS``); columns are the
    raised cosine ``BUMP`` and a departure at each knot. ``y_name``, ``y_unit``: of the values.
    """

    def make(h: Hypothesis) -> Curve:
        matrix: Array = np.column_stack([BUMP, np.eye(len(KNOTS))])
        return KNOTS, matrix, ("mesh cycles from the event", "cycles", y_name, y_unit)

    return make


def _over_load(h: Hypothesis) -> Curve:
    """Curve of the stiffness factor minus 1 over the deflection ``LOADS_M`` [m]."""
    slope = np.log(LOADS_M / 1e-5)
    matrix = np.column_stack([slope, np.ones(len(LOADS_M)), np.eye(len(LOADS_M))])
    return LOADS_M, matrix, ("deflection", "m", "stiffness factor less 1", "-")


def _damping(h: Hypothesis) -> Curve:
    """Curve of the damping factor minus 1 over the deflection in contact ``LOADS_M`` [m]."""
    slope, bend = LOADS_M / 1e-5, np.eye(len(LOADS_M))
    in_contact = dict(h.options)["law"] == "contact"
    main = [np.zeros_like(slope)] if in_contact else [slope - 1.0, slope]
    matrix = np.column_stack([*main, bend])
    return LOADS_M, matrix, ("deflection", "m", "damping factor less 1", "-")


TEMPERATURES = np.linspace(0.0, 100.0, 21)


def _over_temperature(y_name: str, y_unit: str, sign: float) -> Callable[[Hypothesis], Curve]:
    """Return a function of a hypothesis that makes ``sign`` times the curve over delta_T [K]."""

    def make(h: Hypothesis) -> Curve:
        T = TEMPERATURES
        columns = {"rate": T, "curvature": T * (T / 50.0 - 1.0)}
        matrix = sign * np.stack([columns.get(c.name, 0.0 * T) for c in h.coefficients], axis=1)
        return T, matrix, ("temperature rise", "K", y_name, y_unit)

    return make


def _friction(h: Hypothesis) -> Curve:
    """Curve of the coefficient of friction, with the sign of sliding, over the mesh phase."""
    s = np.linspace(-np.pi, np.pi, 96)
    shapes = friction_shapes(s)
    departures = FRICTION[len(OF_COULOMB) :]
    columns = [shapes.get(g, np.zeros(len(s))) for g in ("sign", *departures)]
    matrix = np.stack(columns, axis=1)
    return s, matrix, ("mesh phase from the pitch point", "rad", "coefficient of friction", "-")


CURVES: Mapping[str, Callable[[Hypothesis], Curve]] = {
    "stiffness_harmonic": _over_angle("mesh phase", "stiffness share of the mean", "-"),
    "profile_error": _over_angle("mesh phase", "mesh error", "m"),
    "runout": _over_angle("turn of the {member}", "mesh error", "m"),
    "torque_ripple": _over_angle("{order} times the turn of the input shaft", "torque share", "-"),
    "tooth_crack": _over_window("stiffness share lost", "-"),
    "tooth_spall": _over_window("mesh error", "m"),
    "contact_nonlinearity": _over_load,
    "damping_law": _damping,
    "thermal_backlash": _over_temperature("half-backlash", "m", 1.0),
    "thermal_stiffness": _over_temperature("stiffness factor less 1", "-", -1.0),
    "tooth_friction": _friction,
}
