"""What ``gap plan`` foretells, beside what a diagnosis says of rigs at sizes about those told.

For each effect a rig is made with it at half of its places' size, below and above, recorded by the
sensors at the operating points of the plan, and diagnosed. Probabilities of the effect should pass
from little to most between the two columns; a table is printed, row by row.

  python -m benchmarks.plan --effects backlash_offset,thermal_stiffness
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
import time
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

from herringbone_sim.core.parameters import Parameters, ParameterWarning
from herringbone_sim.effects.effect import Active, active
from herringbone_sim.effects.registry import effects
from herringbone_sim.gap.data.prepare import prepare
from herringbone_sim.gap.diagnose import diagnose
from herringbone_sim.gap.planning.plan import Detectability, plan
from herringbone_sim.gap.planning.summary import place_text
from herringbone_sim.gap.planning.synthetic import SensorNoise
from herringbone_sim.recording.campaign import read_campaign
from herringbone_sim.recording.rig import RigPlan, make_campaign

TRIED = (
    "backlash_offset,thermal_stiffness,thermal_backlash,mean_stiffness,profile_error,"
    "tooth_friction,planet_phase,pin_position,runout"
)
FACTORS = (0.4, 2.5)  # of the size that is told


def with_effect(one: Detectability, size: float) -> Active:
    """An effect of the catalogue at the place of a detectability."""
    effect = effects()[one.effect]
    first = next(p for p in effect.parameters if p.neutral is not None)
    values: dict[str, Any] = {k: v for k, v in one.options if k in ("order", "member")}
    values |= {p.name: 0.0 for p in effect.parameters if p.name in ("cos", "sin")}
    values[first.name] = (first.neutral or 0.0) + size
    return active(effect, one.locus, values)


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--sensors", default="u_s_L,u_s_R,u_c")
    parser.add_argument("--effects", default=TRIED)
    parser.add_argument("--seed", type=int, default=7, help="of the rig and its operating points")
    args = parser.parse_args()
    warnings.simplefilter("ignore", ParameterWarning)
    sensors = tuple(args.sensors.split(","))
    nominal = Parameters(model="full", samples_per_cycle=24)
    rig = RigPlan(nominal, seed=args.seed, channels=sensors)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        make_campaign(folder / "healthy", rig, "healthy")
        points = [r.point for r in read_campaign(folder / "healthy").runs if r.role == "fit"]
        told = plan(nominal, points, sensors, SensorNoise(), rig.cycles)
        head = "".join(f"{f'at {f:g} times':>28s}" for f in FACTORS)
        print(f"{'effect':20s}{'place':>24s}{'named from':>12s}{head}")
        for effect in args.effects.split(","):
            of = sorted(told.of_effect(effect), key=lambda o: o.named_from)
            one = of[(len(of) - 1) // 2]
            print(f"{effect:20s}{place_text(one):>24s}{one.named_from:12.3g}", end="")
            for i, factor in enumerate(FACTORS if math.isfinite(one.named_from) else ()):
                where = folder / f"{effect}_{i}"
                make_campaign(
                    where,
                    replace(rig, actives=(with_effect(one, factor * one.named_from),)),
                    effect,
                )
                start = time.monotonic()
                found = diagnose(prepare(where, nominal), senses=False)
                p = found.verdict.probabilities.get(effect, 0.0)
                first = max(found.verdict.probabilities.items(), key=lambda e: e[1])
                beside = "" if first[0] == effect else f" {first[0]}"
                text = f"{p:.2f}{beside} ({time.monotonic() - start:.0f} s)"
                print(f"{text:>28s}", end="", flush=True)
            print(flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
