"""What the loop hands to its sinks: a block of samples, and what changed at its first one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from herringbone_sim.core.integrate import Block
from herringbone_sim.core.model import Model
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.sensors import Clock


@dataclass(frozen=True)
class Change:
    """An accepted change of parameters and the time [s] of the sample at which it took effect."""

    t_s: float
    values: Mapping[str, Any]


@dataclass(frozen=True)
class Delivery:
    """A block with all that a sink needs beside it.

    Attributes:
        block: samples as the sensors show them, and the states around them.
        model: the model that made it.
        changes: what changed at the first sample of the block.
        restarted: whether the run was reset right before this block.
        actives: effects that the gear and its sensors have.
        clock: that of the sensors.
    """

    block: Block
    model: Model
    changes: tuple[Change, ...]
    restarted: bool
    actives: tuple[Active, ...] = ()
    clock: Clock = field(default_factory=Clock)
