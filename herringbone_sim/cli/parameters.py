"""List every parameter of the model: name, default, unit, range or choices, meaning with its
equation in the paper. A star marks those that may change while the node runs; the others are set
in a parameter file such as config/rig.yaml. Those of the node itself (real_time_factor, record,
mirror, ...) are in docs/ros2.md.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

from herringbone_sim.cli.options import File
from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters, meaning, names, obstacle_text, obstacles
from herringbone_sim.effects.sensors import check_effects
from herringbone_sim.effects.written import effects_text
from herringbone_sim.errors import ParameterError
from herringbone_sim.recording.node_parameters import gear_of_node

EXAMPLES = """\
python -m herringbone_sim parameters
python -m herringbone_sim parameters --check config/rig.yaml
"""


def run(
    *,
    check: Annotated[
        File | None, "instead: read a parameter file, describe its gear and what is unusual in it"
    ] = None,
) -> int:
    """Print the table of all parameters, or check a parameter file; exit code 0."""
    return check_file(check) if check else print_table()


def check_file(file: Path) -> int:
    """Print the gear that a ROS node would build from a parameter file, with notes; exit code 0.

    Raises:
        ParameterError: the file can't be read, or no model can be built from it and its effects.
    """
    p, actives, warnings = gear_of_node(file)
    try:
        model = build(p)
        check_effects(model, actives)
    except ParameterError as error:
        raise ParameterError(f"{file}: {error}") from None
    teeth = f"{p.z_s}, {p.z_p} and {p.z_r} teeth"
    effects = f", with {effects_text(actives)}" if actives else ""
    print(f"{file}: {p.model} model, {p.n_planets} planets, {teeth}{effects}")
    g = model.scales
    radii = f"r_bs {g.r_bs:.6g}, r_bp {g.r_bp:.6g}, r_br {g.r_br:.6g}, r_bc {g.r_bc:.6g} m"
    print(f"omega_n {g.omega_n:.6g} rad/s; base radii {radii}")
    for warning in warnings:
        print(f"note: {warning}")
    for rule in obstacles(p):
        print(f"note: {obstacle_text(rule)}")
    return 0


def print_table() -> int:
    """Print all parameters, a star before those that may change during a run; exit code 0."""
    for name in names():
        about = meaning(name)
        default = Parameters.__dataclass_fields__[name].default
        value = list(default) if isinstance(default, tuple) else default
        limits = ", ".join(about.choices)
        if math.isfinite(about.low):
            limits = f"{about.low:g} .. {about.high:g}"
        star = "*" if about.live else " "
        print(f"{star} {name:18s} {value!s:22s} {about.unit:12s} {limits}\n    {about.text}")
    return 0
