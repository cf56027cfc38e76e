"""Tables of ``control`` as CSV."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from herringbone_sim.control.amplitude import Least, Survey
from herringbone_sim.control.realisation import BODIES, MESHES, Actuator, Needed
from herringbone_sim.control.robustness import Gathered, Survival
from herringbone_sim.control.shape import Shape
from herringbone_sim.views.tables.csv_file import write_csv


def write_runs(path: Path, over: Survey) -> None:
    """A row a run of a survey."""
    names = ("period", "exponent", "within", "transverse", "asymmetry", "contact_loss", "apart")
    columns = [getattr(over.motions, name) for name in names]
    places = (
        (value, K, f"{kind} {i}")
        for value in over.axis.values
        for K in over.K
        for i, kind in enumerate(over.starts.names)
    )
    rows = ((*p, *c) for p, c in zip(places, zip(*columns, strict=True), strict=True))
    write_csv(path, [over.axis.name, "K", "start", *names], rows)


def write_least(path: Path, name: str, found: Sequence[Least]) -> None:
    """A row a least amplitude; pockets as ``first-last`` on the grid of K."""
    rows = (
        [
            *(one.value, one.wanted, one.who, one.staircase.least, one.staircase.firm),
            *(one.staircase.held, one.half_width, one.staircase.share),
            ";".join(f"{a:g}-{b:g}" for a, b in one.staircase.pockets),
        ]
        for one in found
    )
    head = [name, "wanted", "starts", "least_K", "firm_from_K", "held_from_K", "half_width"]
    head += ["share", "pockets"]
    write_csv(path, head, rows)


def write_shape(path: Path, found: Shape) -> None:
    """A row a value and K."""
    names = ("period", "exponent", "exponent_error", "transverse", "chaotic", "apart")
    rows = (
        [value, K, *(getattr(found, name)[i, j] for name in names)]
        for i, value in enumerate(found.axis.values)
        for j, K in enumerate(found.K)
    )
    write_csv(path, [found.axis.name, "K", *names], rows)


def write_needed(path: Path, found: Sequence[Needed]) -> None:
    """A row an actuator, motion, kind of starts and phase."""
    rows = (
        [n.actuator.name, n.wanted, n.who, n.phase, n.K, n.largest, n.torque_n_m] for n in found
    )
    head = ["actuator", "wanted", "starts", "phase", "K", "largest_K", "torque_n_m"]
    write_csv(path, head, rows)


def write_actuators(path: Path, ways: Sequence[Actuator]) -> None:
    """A row an actuator: shares of K on the meshes, N m at K = 1 on the bodies."""
    head = ["actuator", *(f"share_{m}" for m in MESHES), *(f"n_m_per_K_{b}" for b in BODIES)]
    write_csv(path, head, ([one.name, *one.pattern, *one.torques_n_m] for one in ways))


def write_shares(path: Path, shares: Sequence[Gathered]) -> None:
    """CSV of the share of random starts that reach the wanted motion, a row per parameter point.

    Columns: parameter values, wanted period, starts, reached (left = right), parted (left and
    right differ), share of ``reached`` and its 95 % Wilson interval low, high.
    """
    names = ("wanted", "starts", "reached", "parted", "share", "low", "high")
    rows = ([*one.values.values(), *(getattr(one, name) for name in names)] for one in shares)
    write_csv(path, [*shares[0].values, *names], rows)


def write_survival(path: Path, lasting: Sequence[Survival]) -> None:
    """CSV of whether controlled motions survive left/right differences, a row per case.

    A case is a motion, a parameter set apart between the halves (key of
    ``robustness.DIFFERENCES``) and the size of the difference. Columns: fields of ``Survival``.
    """
    write_csv(path, list(vars(lasting[0])), (vars(one).values() for one in lasting))
