"""Follow a periodic orbit over a parameter by pseudo-arclength continuation, through its folds and
where it is unstable, and the orbits of twice the period that leave it. Every boundary is located
and named:

  flip            a multiplier passes -1: the period doubles
  fold            a multiplier passes +1 and the branch turns back
  crossing        a multiplier passes +1 and the branch goes on
  Neimark-Sacker  a complex pair passes the unit circle
  transverse      left and right part, while the motion within symmetry stays
                  what it is
  grazing         a mesh touches a border of its backlash; contact appears or
                  is lost

DIR then holds orbits.png and .svg, branches.csv (one line an orbit), sections.csv (its states at
phase 0) and boundaries.csv.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from cyclopts import Parameter, Token
from tqdm import tqdm

from herringbone_sim.cli.options import Count, Cycles, High, Low, Mesh, Out, flattened
from herringbone_sim.cli.parameter_options import GearOptions, gear_from, print_gear_notes
from herringbone_sim.dynamics.cascade import CascadeOptions, trace_cascade
from herringbone_sim.dynamics.flow import GearFlow
from herringbone_sim.dynamics.gear_family import SWEPT, GearCache, gear_family
from herringbone_sim.dynamics.starts import find_start
from herringbone_sim.sweeps.output import make_folder
from herringbone_sim.views.figures.orbits import orbit_figure
from herringbone_sim.views.figures.style import save
from herringbone_sim.views.tables.orbits import summary, write_orbits

MAX_PERIOD = 64
Start = tuple[float, int | None]  # value, and periods of the forcing
EXAMPLES = """\
python -m herringbone_sim orbits --over delta_T --from 70 --to 90 --start 85 72 \\
    --parameters config/paper.yaml --out orbits
"""


def _starts(_: Any, tokens: Sequence[Token]) -> tuple[Start, ...]:
    """Parse texts such as ``85`` or ``85:2``, which cyclopts passes as tokens.

    Returns:
        Pairs of the value of the parameter and the period in periods of the forcing; None for a
        text without a period.

    Raises:
        ValueError: another text, or a period outside 1 .. ``MAX_PERIOD``.
    """
    starts: list[Start] = []
    for token in tokens:
        value, colon, n = token.value.partition(":")
        try:
            start = float(value), int(n) if colon else None
        except ValueError:
            raise ValueError("must be values such as 85 or 85:2") from None
        if not math.isfinite(start[0]) or not (start[1] is None or 1 <= start[1] <= MAX_PERIOD):
            raise ValueError(f"must be finite values with periods in 1 .. {MAX_PERIOD}")
        starts.append(start)
    return tuple(starts)


@flattened
@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Options: the range of the parameter and the starts of the orbits."""

    over: Annotated[str, Parameter(choices=SWEPT), "parameter"]
    low: Annotated[Low, "first value"]
    high: Annotated[High, "last value, above the first"]
    start: Annotated[
        tuple[Start, ...],
        "VALUE[:N] ...",
        Parameter(converter=_starts, consume_multiple=1, n_tokens=1),
        "value at which an orbit is sought: the motion there, which must be periodic, or "
        "with :N an orbit of N periods of the forcing near it, stable or not",
    ]
    max_period: Annotated[Count, "largest period of doubled orbits"] = 4
    asymmetric: Annotated[bool, "follow orbits whose left and right differ too"] = False
    settle: Annotated[Cycles, "mesh cycles to discard before an orbit is sought at --start"] = 1000
    mesh: Mesh = None
    out: Out


def run(*, gear: GearOptions = GearOptions(), options: Options) -> int:
    """Follow the orbits, write tables and figure, print a summary; exit code 0.

    Raises:
        ParameterError: a gear that can't be built, no such mesh, or a start out of range.
        AnalysisError: no orbit at a start.
    """
    (p, actives), over, out = gear_from(gear), options.over, options.out
    family, watch = gear_family(p, over, options.low, options.high, actives)
    mesh = 0 if options.mesh is None else p.layout.mesh_index(options.mesh, "--")
    gears = GearCache(p, over, actives)
    _print_notes(gears(options.low))
    starts = [(v, find_start(gears, family, v, n, options.settle)) for v, n in options.start]
    make_folder(out)
    cascade = CascadeOptions(max_period=options.max_period, asymmetric=options.asymmetric)
    with tqdm(desc="branches", unit="", disable=None) as bar:
        branches = trace_cascade(family, starts, watch, cascade, lambda _: bar.update())
    write_orbits(out, branches, p)
    save(orbit_figure(branches, over, mesh, p.layout.meshes[mesh]), out, "orbits")
    print(summary(branches, over))
    if len(branches) == cascade.branches:
        print(f"stopped at {len(branches)} branches: lower --max-period, or the range")
    print(f"written: {out / 'orbits.png'}")
    return 0


def _print_notes(flow: GearFlow) -> None:
    print_gear_notes(flow.model)
    if flow.cycles > 1:
        print(f"the forcing repeats after {flow.cycles} mesh cycles: P1 takes as many")
