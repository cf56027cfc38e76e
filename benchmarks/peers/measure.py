"""Timing in rounds, errors against the reference, and the cost of a family at one error.

Costs on one core are processor time, which a busy machine changes less than time on the wall;
those on two cores are time on the wall.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.peers.methods import OrbitMethod, SweepMethod
from benchmarks.peers.problem import ORBIT_CYCLES, orbit_end, spread_over
from herringbone_sim.analysis.periods import find_period
from herringbone_sim.arrays import Array

LEAST_RUN_S = 0.05
MOST_CYCLES = 4000


@dataclass(frozen=True)
class Row:
    """One line of the table.

    Attributes:
        family, setting: as of the method.
        error: against the reference, of the kind that the work states.
        cost: median over the rounds: us per mesh cycle in (a), s for the whole in (b) and (c).
        spread: interquartile range of the cost.
        note: what the reader must know beside.
    """

    family: str
    setting: str
    error: float
    cost: float
    spread: float
    note: str = ""


def seconds(work: Callable[[], object], cores: int = 1) -> float:
    """Time of one call [s]."""
    clock = time.thread_time if cores == 1 else time.perf_counter
    start = clock()
    work()
    return clock() - start


def in_rounds(works: Sequence[tuple[Callable[[], object], int]], rounds: int) -> Array:
    """Times (rounds, n) of works on so many cores: every one once a round, so a slow spell
    strikes all alike."""
    return np.array([[seconds(*work) for work in works] for _ in range(rounds)])


def summary(costs: Array) -> tuple[float, float]:
    """Median and interquartile range."""
    low, middle, high = np.percentile(costs, [25, 50, 75])
    return float(middle), float(high - low)


def orbit_rows(methods: Iterable[OrbitMethod], rounds: int) -> list[Row]:
    """Rows of work (a)."""
    ready = []
    for method in methods:
        error = float(np.abs(method.run(ORBIT_CYCLES) - orbit_end()).max())
        once = seconds(lambda run=method.run: run(ORBIT_CYCLES))
        repeats = np.clip(np.ceil(LEAST_RUN_S / once), 1, MOST_CYCLES // ORBIT_CYCLES)
        ready.append((method, error, ORBIT_CYCLES * int(repeats)))
    works = [(lambda m=method, n=cycles: m.run(n), 1) for method, _, cycles in ready]
    times = in_rounds(works, rounds)
    rows = []
    for (method, error, cycles), taken in zip(ready, times.T, strict=True):
        cost, spread = summary(taken / (cycles * method.lanes) * 1e6)
        rows.append(Row(method.family, method.setting, error, cost, spread))
    return rows


def sweep_rows(
    methods: Sequence[SweepMethod],
    values: Array,
    judge: Callable[[Array, Array], tuple[float, str]],
    rounds: int,
    share: float = 1.0,
) -> list[Row]:
    """Rows of works (b) and (c); ``judge`` takes indices of values and what came out of them.

    Args:
        share: of ``SweepMethod.most`` that is taken, for a quick run.
    """
    takes = [spread_over(values, max(int(m.most * share), 2)) for m in methods]
    for method, take in zip(methods, takes, strict=True):
        method.run(values[take[:8]])
    results: list[Array] = [np.zeros(0)] * len(methods)

    def work(i: int) -> None:
        results[i] = methods[i].run(values[takes[i]])

    works = [(lambda i=i: work(i), method.cores) for i, method in enumerate(methods)]
    times = in_rounds(works, rounds)
    rows = []
    for i, method in enumerate(methods):
        scale = len(values) / len(takes[i])
        cost, spread = summary(times[:, i] * scale)
        error, note = judge(takes[i], results[i])
        told = [f"{method.cores} cores", method.remark()] if method.cores > 1 else []
        told += [f"scaled up from {len(takes[i])} values"] if scale > 1.0 else []
        note = ", ".join([*told, note])
        rows.append(Row(method.family, method.setting, error, cost, spread, note))
    return rows


def periods(sections: Array) -> Array:
    """Period of each section (n, m, 8) in mesh cycles (n,), 0 where aperiodic."""
    return np.array([find_period(points / np.ptp(points)).value or 0 for points in sections])


def judge_sections(reference: Array) -> Callable[[Array, Array], tuple[float, str]]:
    """Errors of sections: median over the periodic values of the largest distance.

    The transient is chaotic, so which point of the period comes first is chance: the nearest of
    its cyclic shifts counts. A value that lands on another period is not compared but counted.
    """
    known = periods(reference)

    def judge(take: Array, sections: Array) -> tuple[float, str]:
        of = [i for i, index in enumerate(take) if known[index] > 0]
        found = periods(sections)
        same = [i for i in of if found[i] == known[take[i]]]
        errors = [nearest_shift(sections[i], reference[take[i]], found[i]) for i in same]
        note = f"same period at {len(same)} of {len(of)} periodic values"
        return float(np.median(errors)) if errors else float("nan"), note

    return judge


def nearest_shift(points: Array, reference: Array, period: int) -> float:
    """Least over the cyclic shifts of the largest distance of the last points."""
    last = reference[-period:]
    return min(float(np.abs(np.roll(points[-period:], k, 0) - last).max()) for k in range(period))


def judge_exponents(reference: Array) -> Callable[[Array, Array], tuple[float, str]]:
    """Errors of exponents: median over the values with a negative one; signs of all compared."""

    def judge(take: Array, exponents: Array) -> tuple[float, str]:
        known = reference[take]
        regular = known < 0.0
        alike = int(np.sum(np.sign(exponents) == np.sign(known)))
        note = f"same sign at {alike} of {len(take)} values"
        errors = np.abs(exponents - known)[regular]
        return float(np.median(errors)) if errors.size else float("nan"), note

    return judge


def cost_at(rows: Sequence[Row], error: float) -> float:
    """Least cost of one family at an error, straight between neighbours on logarithmic axes.

    NaN when none of its rows is that good; the cheapest row when all are.
    """
    front: list[Row] = []
    for row in sorted(rows, key=lambda row: row.cost):
        if not front or row.error < front[-1].error:
            front.append(row)
    good = [row for row in front if row.error <= error]
    if not good:
        return float("nan")
    place = front.index(good[0])
    if place == 0:
        return good[0].cost
    one, other = front[place - 1], good[0]
    position = np.log(error / one.error) / np.log(other.error / one.error)
    return float(one.cost * (other.cost / one.cost) ** position)


def cpu_name() -> str:
    """Cores and widest vectors of this machine, as Linux tells them."""
    with open("/proc/cpuinfo", encoding="ascii") as file:
        flags = next(line for line in file if line.startswith("flags")).split()
    widest = next((f for f in ("avx512f", "avx2", "avx") if f in flags), "no AVX")
    return f"{os.cpu_count()} cores, {widest.upper().replace('512F', '-512')}"
