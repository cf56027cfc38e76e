"""Our kernel against its peers: one command, one table, every row in one run on the same work.

    python -m benchmarks.peers [--quick] [--only a b c]

(a) error against cost per mesh cycle on a periodic orbit that loses contact (the rig, xi 0.07,
    delta_T 90, 20 cycles; the reference is order 24 with 128 steps);
(b) a bifurcation diagram: 400 values of delta_T from 0 to 100 of ``config/paper.yaml``, each from
    rest, 300 mesh cycles left out and 100 kept; the error is the median over the periodic values;
(c) the largest exponent at 100 of those values, 300 cycles left out and 300 averaged over; the
    error is the median over the values with a negative one. The first tangent vector is the same
    in all rows but those of our batches and of pynamicalsys, whose error is that of the choice.
Costs are processor time where one core is used, time on the wall for two; compilation is not
counted. Left and right are alike in all three works: rows called half integrate one for both, as
our batches do by themselves and the peers by equations written for it. Peers that are missing are
named and left out (``bash scripts/setup.sh bench``).
"""

from __future__ import annotations

import argparse
import importlib
import platform
import warnings
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from types import ModuleType
from typing import Any

import numpy as np

from benchmarks.peers import measure, ours
from benchmarks.peers.measure import Row, cost_at
from benchmarks.peers.problem import EXPONENT_CYCLES, FINE, orbit_end, temperatures
from herringbone_sim.core.parameters import ParameterWarning

PEERS = ("scipy", "numbalsoda", "heyoka", "pynamicalsys")
ERROR = 1e-8
LANES = ("in lanes", "in lanes, half")
HALF = ", half"
TARGETS = (("SciPy", 150.0), ("heyoka", 3.0))


def available() -> tuple[list[ModuleType], list[str]]:
    """Modules of the peers that are installed, and the names of those that are not."""
    found, missing = [], []
    for name in PEERS:
        try:
            importlib.import_module(name)
        except ImportError:
            missing.append(name)
        else:
            found.append(importlib.import_module(f"benchmarks.peers.with_{name}"))
    return found, missing


def methods_of(modules: Sequence[ModuleType], kind: str, *options: int) -> list[Any]:
    """Methods of one work of all modules that have any."""
    return [
        method
        for module in modules
        if hasattr(module, kind)
        for method in getattr(module, kind)(*options)
    ]


def print_rows(title: str, unit: str, rows: Sequence[Row], base: Row) -> None:
    """One work's part of the table; ratios are to the cost of ``base``."""
    print(
        f"\n{title}\n{'method':34} {'setting':28} {'error':>8} {unit:>10} {'+-':>7} {'ratio':>8}"
    )
    for row in rows:
        cost = f"{row.cost:10.4g} {row.spread:7.2g} {row.cost / base.cost:8.2f}"
        print(f"{row.family:34} {row.setting:28} {row.error:8.1e} {cost}  {row.note}".rstrip())


def families(rows: Sequence[Row]) -> dict[str, float]:
    """Cost of each family at an error of 1e-8."""
    names = dict.fromkeys(row.family for row in rows)
    return {name: cost_at([row for row in rows if row.family == name], ERROR) for name in names}


def print_ratios(rows: Sequence[Row]) -> None:
    """Cost of each family at an error of 1e-8, and over ours: whole over whole, half over half."""
    costs = families(rows)
    one, whole, half = (costs[f"ours, {how}"] for how in ("one at a time", *LANES))
    print(f"\ncost at an error of {ERROR:g} (interpolated), over ours on the same work")
    print(f"{'method':34} {'us/cycle':>10} {'one at a time':>14} {'in lanes':>10}")
    for name, cost in costs.items():
        same = half if name.endswith(HALF) else whole
        alone = "" if name.endswith(HALF) else f"{cost / one:.2f}"
        print(f"{name:34} {cost:10.4g} {alone:>14} {cost / same:10.2f}")
    for who, wanted in TARGETS:
        print_target(who, wanted, costs, (whole, half))


def print_target(
    who: str, wanted: float, costs: dict[str, float], ours_at: tuple[float, float]
) -> None:
    """The best of one peer over ours in lanes."""
    known = {n: c for n, c in costs.items() if n.startswith(who) and np.isfinite(c)}
    if known:
        whole = min(c for n, c in known.items() if not n.endswith(HALF)) / ours_at[0]
        half = min(c for n, c in known.items() if n.endswith(HALF)) / ours_at[1]
        print(
            f"best of {who}: {whole:.1f} times ours in lanes, {half:.1f} as one half; "
            f"wanted {wanted:g}"
        )


def orbit_part(modules: Sequence[ModuleType], quick: bool) -> None:
    """Work (a)."""
    methods = methods_of([ours, *modules], "orbit_methods")
    rows = measure.orbit_rows(methods, 3 if quick else 7)
    base = next(r for r in rows if (r.family, r.setting) == ("ours, in lanes, half", ours.DEFAULT))
    print_rows("(a) periodic orbit that loses contact", "us/cycle", rows, base)
    print_ratios(rows)
    best = min(
        (row for row in rows if row.family.startswith("heyoka")),
        key=lambda r: r.error,
        default=None,
    )
    if best is not None:
        print(
            f"the reference (size {np.abs(orbit_end()).max():.2f}) and {best.family}, "
            f"{best.setting}, agree to {best.error:.1e}"
        )


def diagram_part(modules: Sequence[ModuleType], quick: bool) -> None:
    """Work (b)."""
    values = temperatures(400)
    judge = measure.judge_sections(ours.sections_in_lanes(values, **FINE))
    methods = methods_of([ours, *modules], "diagram_methods")
    rows = measure.sweep_rows(methods, values, judge, 1 if quick else 3, 0.25 if quick else 1.0)
    print_rows("(b) bifurcation diagram, 400 values, 300 + 100 cycles", "s", rows, rows[0])


def exponent_part(modules: Sequence[ModuleType], quick: bool) -> None:
    """Work (c)."""
    values = temperatures(100)
    reference = ours.exponents_one_by_one(values, EXPONENT_CYCLES, **FINE)
    methods = methods_of([ours, *modules], "exponent_methods", EXPONENT_CYCLES)
    judge = measure.judge_exponents(reference)
    rows = measure.sweep_rows(methods, values, judge, 1 if quick else 3, 0.25 if quick else 1.0)
    title = f"(c) largest exponent, 100 values, 300 + {EXPONENT_CYCLES} cycles"
    print_rows(title, "s", rows, rows[0])


def print_machine(missing: Sequence[str]) -> None:
    """Versions, machine, and the peers that are missing."""
    names = ("numpy", "numba", *PEERS)
    told = []
    for name in names:
        try:
            told.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            continue
    print(f"Python {platform.python_version()}, {', '.join(told)}; {measure.cpu_name()}")
    if missing:
        print(f"not installed and left out: {', '.join(missing)} (bash scripts/setup.sh bench)")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer rounds and values")
    parser.add_argument("--only", nargs="+", choices="abc", default=list("abc"), help="works")
    options = parser.parse_args()
    warnings.simplefilter("ignore", ParameterWarning)
    modules, missing = available()
    print_machine(missing)
    parts = {"a": orbit_part, "b": diagram_part, "c": exponent_part}
    for work in options.only:
        parts[work](modules, options.quick)
    for module in modules:
        if hasattr(module, "note"):
            print(module.note())


if __name__ == "__main__":
    main()
