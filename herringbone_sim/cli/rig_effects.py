"""List the effects with their parameters, units and bounds."""

from __future__ import annotations

from herringbone_sim.effects.registry import effects

EXAMPLES = """\
python -m herringbone_sim rig effects
"""


def run() -> int:
    """Print every effect with its parameters and options; exit code 0."""
    for effect in effects().values():
        print(f"{effect.id} ({effect.level}): {effect.text}")
        for p in effect.parameters:
            print(f"    {p.name} [{p.unit}] {p.low:g} .. {p.high:g}: {p.text}")
        for o in effect.options:
            choices = ", ".join(str(choice) for choice in o.choices)
            print(f"    {o.name}: {o.text}{f' ({choices})' if choices else ''}")
    return 0
