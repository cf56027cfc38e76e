"""Real-time loop: integrates a model at the pace of a clock and delivers blocks of samples."""

from herringbone_sim.runtime.delivery import Change, Delivery
from herringbone_sim.runtime.loop import Loop
from herringbone_sim.runtime.pace import Pace, WallTime, check_pace, sample_period_s
from herringbone_sim.runtime.stepping import Stepped

__all__ = [
    "Change",
    "Delivery",
    "Loop",
    "Pace",
    "Stepped",
    "WallTime",
    "check_pace",
    "sample_period_s",
]
