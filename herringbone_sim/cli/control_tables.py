"""Tables of ``control`` as CSV."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from herringbone_sim.control.amplitude import LeastAmplitude, Survey
from herringbone_sim.control.realisation import BODIES, MESHES, Actuator, TorqueDemand
from herringbone_sim.control.robustness import StartShares, Survival
from herringbone_sim.control.shape import ShapeMap
from herringbone_sim.views.tables.csv_file import write_csv


def write_runs(path: Path, survey: Survey) -> None:
    """Write a CSV with a row per run of a survey: parameter, K, start and the resulting motion."""
    names = ("period", "exponent", "within", "transverse", "asymmetry", "contact_loss", "apart")
    columns = [getattr(survey.motions, name) for name in names]
    places = (
        (value, K, f"{kind} {i}")
        for value in survey.axis.values
        for K in survey.K
        for i, kind in enumerate(survey.starts.names)
    )
    rows = ((*p, *c) for p, c in zip(places, zip(*columns, strict=True), strict=True))
    write_csv(path, [survey.axis.name, "K", "start", *names], rows)


def write_least(path: Path, name: str, amplitudes: Sequence[LeastAmplitude]) -> None:
    """Write a CSV with a row per least amplitude; ranges of K in ``pockets`` as ``first-last``.

    Args:
        name: name of the parameter that varies.
    """
    rows = (
        [
            *(a.value, a.target.period, a.target.starts, a.staircase.least, a.staircase.firm),
            *(a.staircase.held, a.half_width, a.staircase.share),
            ";".join(f"{low:g}-{high:g}" for low, high in a.staircase.pockets),
        ]
        for a in amplitudes
    )
    head = [name, "wanted", "starts", "least_K", "firm_from_K", "held_from_K", "half_width"]
    write_csv(path, [*head, "share", "pockets"], rows)


def write_shape(path: Path, shape: ShapeMap) -> None:
    """Write a CSV of a map of motions, a row per value of its axis and per K."""
    names = ("period", "exponent", "exponent_error", "transverse", "chaotic", "apart")
    rows = (
        [value, K, *(getattr(shape, name)[i, j] for name in names)]
        for i, value in enumerate(shape.axis.values)
        for j, K in enumerate(shape.K)
    )
    write_csv(path, [shape.axis.name, "K", *names], rows)


def write_demands(path: Path, demands: Sequence[TorqueDemand]) -> None:
    """Write a CSV of the torques needed, a row per actuator, target and control phase."""
    rows = (
        [d.actuator.name, d.target.period, d.target.starts, d.phase, d.K, d.largest, d.torque_n_m]
        for d in demands
    )
    head = ["actuator", "wanted", "starts", "phase", "K", "largest_K", "torque_n_m"]
    write_csv(path, head, rows)


def write_actuators(path: Path, actuators: Sequence[Actuator]) -> None:
    """Write a CSV, a row per actuator: fractions of K on the meshes, torques [N m] at K = 1."""
    head = ["actuator", *(f"share_{m}" for m in MESHES), *(f"n_m_per_K_{b}" for b in BODIES)]
    write_csv(path, head, ([a.name, *a.pattern, *a.torques_n_m] for a in actuators))


def write_shares(path: Path, shares: Sequence[StartShares]) -> None:
    """Write a CSV of the fraction of random starts that reach a motion, a row per parameter point.

    Columns: parameter values, wanted period, number of starts, of those that reach it with
    left = right (``reached``) and with left and right different (``parted``), fraction reached and
    its 95 % Wilson interval.
    """
    names = ("wanted", "starts", "reached", "parted", "share", "low", "high")
    rows = ([*s.values.values(), *(getattr(s, name) for name in names)] for s in shares)
    write_csv(path, [*shares[0].values, *names], rows)


def write_survival(path: Path, cases: Sequence[Survival]) -> None:
    """Write a CSV of whether controlled motions survive left-right differences, a row per case.

    A case is a motion, a parameter that differs between the halves (key of
    ``robustness.DIFFERENCES``) and the size of the difference. Columns: fields of ``Survival``.
    """
    write_csv(path, list(vars(cases[0])), (vars(case).values() for case in cases))
