"""Rows of ``LaneTrial.progress`` and ``LaneTrial.counters``: the progress of each lane.

Phases are in rad within the mesh cycle, lengths of steps in tau.
"""

from __future__ import annotations

# Mesh cycle, argument of the control at its phase 0, phases between which laws are evaluated.
CYCLE, ANGLE, BOUND_LOW, BOUND_HIGH = range(4)
# Rest of the grid step, phase at the start of the piece, its length, done of it.
GRID_LEFT, PIECE_START, PIECE_LENGTH, DONE = range(4, 8)
# Longest step by error control, whole step tried, present trial, its error over the tolerance.
WANT, STEP, TRIED, ERROR = range(8, 12)
LOW, HIGH, LAST, COUNT = range(12, 16)  # bracket around an edge, last trial, number of trials
# See ``decide``; stage 0: 0 valid, 1 contact may switch, 2 piece begins; whether step is accepted.
MODE, STALE, TAKEN = range(16, 19)
GROWN = 19  # whether the motion has diverged
# Phase evaluated; margin rate at a switch; see ``see_jumps``.
NOW, SWITCH_RATE, JUMPS = range(20, 23)
ROWS = 23

# Rows of ``counters``: index of the value or -1, cycles done, grid step, mesh that switched or -1.
VALUE, STARTED, INDEX, SWITCHED = range(4)
