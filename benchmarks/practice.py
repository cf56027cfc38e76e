"""What a practice campaign costs, and how near its d is: ``python -m benchmarks.practice``.

Processor time of one core, compilation not counted. A cause whose largest sane size is too small
for its d is counted apart.
"""

from __future__ import annotations

import time

import numpy as np

from herringbone_sim.practice.campaign import make_campaign
from herringbone_sim.practice.plan import RequestedNoise, draw_plan

SEEDS = range(9100, 9106)
TRUTHS = ("none", "single", "pair", "random_physics")
NOISES = ("white", "filtered", "encoders", "mixture")
DETECTABILITIES = (3.0, 10.0)


def row(truth: str, noise: str) -> tuple[list[float], list[float], int]:
    """Seconds of each campaign, d of each cause over that asked for, causes that fall short."""
    seconds, ratios, short = [], [], 0
    for seed in SEEDS:
        plan = draw_plan(seed, truth, DETECTABILITIES[seed % 2], noise=RequestedNoise(noise))
        start = time.process_time()
        label = make_campaign(plan).label
        seconds.append(time.process_time() - start)
        told = [one for one in label["effects"] if one["internal"] != "channel_swap"]
        short += sum(one["capped"] for one in told)
        ratios += [one["d"] / plan.d for one in told if not one["capped"]]
    return seconds, ratios, short


def main() -> None:
    """Print a row for each kind of campaign."""
    for noise in ("white", "filtered"):  # compile
        make_campaign(draw_plan(104, "none", noise=RequestedNoise(noise)))
    print("| campaign | noise | seconds: median, most | d over that asked for | too small |")
    print("| --- | --- | --- | --- | --- |")
    for truth in TRUTHS:
        for noise in NOISES:
            seconds, ratios, short = row(truth, noise)
            spread = f"{min(ratios):.2f} .. {max(ratios):.2f}" if ratios else ""
            took = f"{np.median(seconds):.1f}, {max(seconds):.1f}"
            print(f"| {truth} | {noise} | {took} | {spread} | {short or ''} |", flush=True)


if __name__ == "__main__":
    main()
