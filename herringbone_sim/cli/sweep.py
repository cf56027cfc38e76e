"""Motion over the values of a parameter: period, Lyapunov exponents, contact and section points of
each, and a bifurcation diagram. A value is reached

  fixed  from the initial state of the gear, each by itself
  up     from the final state of the value below it: a continuation, which
         follows its motion
  down   from the final state of the value above it
  both   up and down: where they differ, there is hysteresis
  held   fixed, up and down
  ramp   while the parameter moves a little every mesh cycle, --cycles of them
         from one value to the next, up and down, through the same change that
         the node makes
  all    all of these

Repeat the command to continue a sweep that was interrupted; the diagram shows every way that DIR
holds. Several --over make a grid, without a diagram. Each way has a folder DIR/START with
sweep.json and Parquet tables (parts/).
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

from herringbone_sim.cli.options import Mesh, Out
from herringbone_sim.cli.parameter_options import GearOptions
from herringbone_sim.cli.sweep_options import (
    SweepOptions,
    observation_of_gear,
    print_shares,
    run_all,
    swept_gear,
)
from herringbone_sim.errors import AnalysisError
from herringbone_sim.sweeps.diagram import Diagram, diagram_of
from herringbone_sim.sweeps.grid import STARTS, Sweep, axis_from_text
from herringbone_sim.sweeps.store import FILE, Store, load_result, load_store, open_store
from herringbone_sim.views.figures.diagram import write_diagram

Way = Literal["fixed", "up", "down", "both", "held", "ramp", "all"]
WAYS: dict[Way, tuple[str, ...]] = {
    "fixed": ("fixed",),
    "up": ("up",),
    "down": ("down",),
    "both": ("up", "down"),
    "held": ("fixed", "up", "down"),
    "ramp": ("ramp_up", "ramp_down"),
    "all": ("fixed", "up", "down", "ramp_up", "ramp_down"),
}
EXAMPLES = """\
python -m herringbone_sim sweep --over delta_T=0:100:200 \\
    --parameters config/paper.yaml --out diagram
python -m herringbone_sim sweep --over K=0:0.6:40 --set xi=0.085 --start both --out over_K
"""


def run(
    *,
    gear: GearOptions = GearOptions(),
    over: Annotated[
        tuple[str, ...],
        "NAME=LOW:HIGH:COUNT",
        "values of a parameter, or NAME=VALUE,VALUE,...; continuations follow the first",
    ],
    start: Annotated[Way, "how to get to a value"] = "fixed",
    mesh: Mesh = None,
    out: Out,
    sweep: SweepOptions = SweepOptions(),
) -> int:
    """Run the sweeps, print a summary, draw the diagram; exit code 0."""
    axes = tuple(axis_from_text(text) for text in over)
    base, actives = swept_gear(gear, axes)
    mesh = mesh or base.layout.meshes[0]
    observation = observation_of_gear(sweep, (base, actives), axes, mesh)
    stores = []
    for way in WAYS[start]:
        one = Sweep.of_gear(base, actives, axes, observation, way, sweep.chunk)
        stores.append(open_store(out / way, one))
    run_all(stores, sweep)
    for store in stores:
        print_shares(load_result(store))
    if len(axes) == 1:
        every = _same_but_start(out, stores)
        diagram = diagram_of([load_result(store) for store in every])
        _print_hysteresis(diagram)
        paths = write_diagram(out, diagram)
        print(f"written: {', '.join(map(str, paths))}")
    return 0


def _same_but_start(folder: Path, own: Sequence[Store]) -> list[Store]:
    """All stored sweeps in a folder that equal those of ``own`` but for start and chunk size."""
    kernels, sweep = {store.kernel for store in own}, own[0].sweep
    stores = []
    for way in STARTS:
        with contextlib.suppress(AnalysisError):  # one that can't be read is not of this diagram
            if (folder / way / FILE).exists():
                stores.append(load_store(folder / way))
    return [
        s
        for s in stores
        if s.kernel in kernels
        and replace(sweep, start=s.sweep.start, chunk=s.sweep.chunk) == s.sweep
    ]


def _print_hysteresis(diagram: Diagram) -> None:
    if len(diagram.compared) > 1:
        count = int(diagram.hysteresis().sum())
        print(f"different motions by different ways at {count} of {len(diagram.axis)} values")
