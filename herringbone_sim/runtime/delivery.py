"""Data that the loop delivers: a block of samples, and the changes at its first sample."""

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
    """Parameter values that changed, and the time [s] of the first sample with them.

    The time is that of the sensors' clock, as in the samples.
    """

    t_s: float
    values: Mapping[str, Any]


@dataclass(frozen=True)
class Delivery:
    """A block of samples with the model, effects and changes that belong to it.

    Attributes:
        block: samples with the effects of the sensors applied, and the states at both ends.
        model: model that was integrated.
        changes: changes of parameters at the first sample of the block.
        restarted: whether the run was reset right before this block.
        actives: effects of the gear and its sensors.
        clock: reading of the sensors' clock from which its times are computed.
    """

    block: Block
    model: Model
    changes: tuple[Change, ...]
    restarted: bool
    actives: tuple[Active, ...] = ()
    clock: Clock = field(default_factory=Clock)
