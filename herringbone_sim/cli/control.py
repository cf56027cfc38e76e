"""Study the control K cos(order Omega tau + phase) beyond the paper: the least K that reaches a
period at each temperature rise, and from which starts (amplitude); the effect of phase and
frequency (shape); torques on the bodies that realise it (realisation); whether the controlled
motion persists when left and right differ (robustness). Tables and figures go to DIR. Finished
runs are stored in DIR/data: repeat the command to continue one that was stopped.

K is varied in every part, delta_T in amplitude and robustness, the phase in shape and
realisation, the order in shape. All other parameters are those of the gear.
"""

from __future__ import annotations

from typing import Annotated

from tqdm import tqdm

from herringbone_sim.cli.control_parts import FULL, PARTS, QUICK
from herringbone_sim.cli.options import Names, Out, Workers
from herringbone_sim.cli.parameter_options import (
    GearOptions,
    gear_from,
    print_gear_notes,
    settings,
)
from herringbone_sim.control.runs import MotionRunner
from herringbone_sim.effects.assemble import build_with
from herringbone_sim.errors import AnalysisError
from herringbone_sim.sweeps.grid import with_sweep_steps

EXAMPLES = """\
python -m herringbone_sim control --quick --set xi=0.085 \\
    --parameters config/paper.yaml --out control
"""


def run(
    *,
    gear: GearOptions = GearOptions(),
    out: Out,
    only: Annotated[Names, "PARTS", f"of {', '.join(PARTS)} (default: all)"] = (),
    quick: Annotated[bool, "coarse grids and short runs"] = False,
    workers: Workers = 2,
) -> int:
    """Run the parts of ``--only``, or all, and print their summaries; exit code 0.

    Raises:
        AnalysisError: no such part, or the model ``full``.
        ParameterError: a gear that can't be built.
    """
    if unknown := set(only) - set(PARTS):
        raise AnalysisError(f"--only takes {', '.join(PARTS)}, got {', '.join(sorted(unknown))}")
    base, actives = gear_from(gear)
    base = with_sweep_steps(base, settings(gear.set))
    if base.model != "reduced":
        raise AnalysisError("control needs model: reduced, got full: its K is that of Eq. (22)")
    print_gear_notes(build_with(base, actives))
    for part in only or PARTS:
        with tqdm(desc=part, unit="run", total=0, disable=None) as bar:
            runner = MotionRunner(out / "data", workers, bar, actives)
            lines = PARTS[part](runner, base, QUICK if quick else FULL, out)
        print("\n".join([part, *(f"  {line}" for line in lines)]))
    print(f"written: {out}")
    return 0
