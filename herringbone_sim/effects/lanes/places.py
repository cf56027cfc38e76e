"""Rows of ``LaneTrial.lane`` and of ``LaneTrial.place``: where in its run each lane is."""

from __future__ import annotations

CYCLE, ANGLE, BOUND_LOW, BOUND_HIGH = range(4)  # mesh cycle run; of the control at phase 0
GRID, GRID_LEFT, PIECE, REACH, DONE = range(4, 9)  # phases [rad] and dimensionless times
WANT, STEP, TRIED, ERROR = range(9, 13)  # lengths of steps; error over the tolerance
LOW, HIGH, LAST, COUNT = range(13, 17)  # of the bracket in which a border is looked for
MODE, STALE, TAKEN = range(17, 20)  # see ``machine``; whether stage 0 is; a step was taken
GROWN = 20  # whether the motion has left all range
NOW, PACE, JUMPS = range(21, 24)  # phase [rad]; of a mesh that switches; whether tangents jump
ROWS = 24

VALUE, STARTED, INDEX, SWITCHED = range(4)  # of ``place``: -1 where idle, and where no mesh does
