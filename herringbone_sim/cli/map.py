"""Period, largest Lyapunov exponent and loss of contact over two parameters: a table (Parquet) and
pictures (PNG, SVG). Values at which no gear can be built or the motion diverges stay white; the
reasons are counted. Repeat the command to continue a map that was interrupted.
"""

from __future__ import annotations

from typing import Annotated, Literal

from herringbone_sim.cli.options import Count, Out, one_of
from herringbone_sim.cli.parameter_options import GearOptions
from herringbone_sim.cli.sweep_options import (
    SweepOptions,
    observation_of_gear,
    print_shares,
    run_all,
    swept_gear,
)
from herringbone_sim.errors import ParameterError
from herringbone_sim.sweeps.grid import Sweep, axis_from_text
from herringbone_sim.sweeps.store import load_result, open_store
from herringbone_sim.views.figures.maps import write_maps

Kind = Literal["delta_T-K", "delta_T-xi", "Omega-T_1"]
KINDS: dict[Kind, tuple[str, str]] = {
    "delta_T-K": ("delta_T=0:100", "K=0:0.6"),
    "delta_T-xi": ("delta_T=0:100", "xi=0.02:0.2"),
    "Omega-T_1": ("Omega=0.2:2", "T_1=10:2000"),
}
LISTED = ", ".join(f"{kind} ({' x '.join(axes)})" for kind, axes in KINDS.items())
SIZE = 200  # values along each axis of --kind
AXES = one_of("axes, one of")
EXAMPLES = """\
python -m herringbone_sim map --kind delta_T-K --size 40 \\
    --parameters config/paper.yaml --out map
python -m herringbone_sim map --over delta_T=0:100:40 --over xi=0.02:0.2:40 \\
    --set K=0.3 --out map_xi
"""


def run(
    *,
    gear: GearOptions = GearOptions(),
    over: Annotated[
        tuple[str, ...],
        "NAME=LOW:HIGH:COUNT",
        AXES,
        "values of a parameter, given twice: to the right, then upwards",
    ] = (),
    kind: Annotated[Kind | None, AXES, f"ready-made axes: {LISTED}"] = None,
    size: Annotated[Count | None, f"values along each axis of --kind [{SIZE}]"] = None,
    start: Annotated[
        Literal["fixed", "up", "down"],
        "each value from the initial state, or by continuation from the final state of its "
        "neighbour on the first axis, on one core",
    ] = "fixed",
    out: Out,
    sweep: SweepOptions = SweepOptions(),
) -> int:
    """Compute the map, print a summary, draw the pictures; exit code 0.

    Raises:
        ParameterError: there are not exactly two axes with two values or more.
    """
    if size is not None and not kind:
        raise ParameterError("--size must come with --kind, got --over: give its COUNT there")
    count = SIZE if size is None else size
    texts = [f"{axis}:{count}" for axis in KINDS[kind]] if kind else over
    if len(texts) != 2:
        raise ParameterError(f"a map has two axes, got {len(texts)}: give --over twice")
    axes = tuple(axis_from_text(text) for text in texts)
    if min(map(len, axes)) < 2:
        sizes = " x ".join(str(len(axis)) for axis in axes)
        raise ParameterError(
            f"a map needs two values or more on each axis, got {sizes}: raise --size or give more"
        )
    swept = swept_gear(gear, axes)
    observation = observation_of_gear(sweep, swept, axes, mesh="")
    store = open_store(out, Sweep.of_gear(*swept, axes, observation, start, sweep.chunk))
    run_all([store], sweep)
    result = load_result(store)
    print_shares(result)
    print("written:", *(str(path) for path in write_maps(out, result)), sep="\n  ")
    return 0
