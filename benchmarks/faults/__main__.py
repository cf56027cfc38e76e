"""Faults by the thousand: ``python -m benchmarks.faults [--hours H] [--campaign NAME]``.

Every campaign takes its seeds in turn until the time is over, and a table says what it tried, what
survived, and the worst that it met; each failure is printed with the seed that repeats it.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

from tqdm import tqdm

from benchmarks.faults import CAMPAIGNS
from benchmarks.faults.trial import Trial


def main() -> int:
    """Exit code 1 when any trial failed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.faults", description=__doc__)
    parser.add_argument("--hours", type=float, default=0.1, help="time for all, default 0.1")
    parser.add_argument("--campaign", choices=sorted(CAMPAIGNS), action="append", help="only this")
    parser.add_argument("--seed", type=int, default=0, help="first seed of each campaign")
    args = parser.parse_args()
    names = args.campaign or list(CAMPAIGNS)
    found = {name: run(name, args.seed, args.hours * 3600 / len(names)) for name in names}
    print(table(found))
    return int(any(trial.failures() for trials in found.values() for trial in trials))


def run(name: str, seed: int, seconds: float) -> list[Trial]:
    """All trials of a campaign that fit into so many seconds, one at least."""
    end, trials = time.monotonic() + seconds, list[Trial]()
    with tqdm(desc=name, unit="trial", disable=None) as bar:
        while not trials or time.monotonic() < end:
            number = seed + len(trials)
            with tempfile.TemporaryDirectory() as folder:
                trial = CAMPAIGNS[name](number, Path(folder))
            trials.append(trial)
            bar.update()
            for failure in trial.failures():
                tqdm.write(f"{name}, seed {number}, {trial.fault}: {failure}")
    return trials


def table(found: dict[str, list[Trial]]) -> str:
    """A row a campaign, as Markdown."""
    lines = [
        "| campaign | tried | survived | worst loss | altered | tracebacks | slowest | memory |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for name, trials in found.items():
        lines.append(
            f"| {name} | {len(trials)} | {sum(not t.failures() for t in trials)} "
            f"| {max(t.lost_s for t in trials):.2f} s | {sum(t.altered for t in trials)} "
            f"| {sum(bool(t.traceback) for t in trials)} "
            f"| {worst(max(t.seconds for t in trials), '.1f', 's')} "
            f"| {worst(max(t.peak_bytes for t in trials) / 2**20, '.0f', 'MiB')} |"
        )
    return "\n".join(lines)


def worst(value: float, form: str, unit: str) -> str:
    """A value with its unit; a dash for 0, which stands for what was not measured."""
    return f"{value:{form}} {unit}" if value else "-"


if __name__ == "__main__":
    raise SystemExit(main())
