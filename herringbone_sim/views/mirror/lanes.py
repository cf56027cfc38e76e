"""Contact state of each mesh over the last mesh cycles, as a coloured horizontal stripe."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from herringbone_sim.arrays import Array, Indices
from herringbone_sim.views.mirror.block import STATES, contact_states
from herringbone_sim.views.mirror.frame import TICK_X, TITLE_Y, send_box, words
from herringbone_sim.views.mirror.palette import LANE, STATE_COLOURS, UNKNOWN, WORDS, Colour
from herringbone_sim.views.mirror.plane import Axes, ticks

COLUMNS, ROWS = 300, 84
UNKNOWN_CLASS, GAP_CLASS = len(STATES), len(STATES) + 1


class ContactLanes:
    """Image of the contact states over time, a horizontal stripe per mesh.

    Contact on the drive and on the back flank has a colour each; dark: the teeth are apart; grey:
    x was not recorded then.

    Args:
        recording: a ``rerun.RecordingStream``.
        colours: mesh -> colour of its name; the stripes are in this order.
    """

    def __init__(self, recording: Any, colours: Mapping[str, Colour]) -> None:
        self.recording = recording
        self.colours = dict(colours)
        self._lane = max(2, ROWS // len(colours))
        self._span_s = 0.0
        classes = [(i, state, lane_colour(state)) for i, state in enumerate(STATES)]
        context = rr.AnnotationContext(
            [*classes, (UNKNOWN_CLASS, "not known", UNKNOWN), (GAP_CLASS, "", LANE)]
        )
        recording.log("contact", context, static=True)

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the image."""
        return float(COLUMNS), float(self._lane * len(self.colours))

    def send(self, times: Array, x: Mapping[str, Array], b_half: Mapping[str, float]) -> None:
        """Draw the contact states of the meshes.

        Args:
            times: (n,) rising [s].
            x: displacements (n,) [m] by mesh.
            b_half: half backlash [m] by mesh kind.
        """
        self._send_frame(float(np.ptp(times)))
        states = np.stack([contact_states(x[m], b_half[m[:2]]) for m in self.colours])
        image = rr.SegmentationImage(painted(states, times, self._lane), opacity=1.0, draw_order=0)
        self.recording.log("contact/lanes", image)

    def _send_frame(self, span_s: float) -> None:
        """Send names and time axis if the time span has changed by a tenth or more."""
        if self._span_s and abs(span_s - self._span_s) < 0.1 * self._span_s:
            return
        self._span_s = span_s
        width, height = self.size
        axes = Axes((-1e3 * max(span_s, 1e-9), 0.0), (0.0, 1.0), width, height)
        send_box(self.recording, "contact", axes)
        self._send_names()
        at = ticks(axes.x, 8)
        ticks_at = [(axes.vertical(value)[0, 0], height + TICK_X) for value in at]
        texts = [f"{value:.4g} ms" for value in at]
        self.recording.log("contact/frame/ticks", words(ticks_at, texts))

    def _send_names(self) -> None:
        """Write the mesh names, in two columns if more than six, and the key of states."""
        count = len(self.colours)
        left = [-20.0 if count > 6 and i % 2 else -8.0 for i in range(count)]
        at = [(left[i], (i + 0.5) * self._lane - 3.0) for i in range(count)]
        names = words(at, list(self.colours), list(self.colours.values()))
        self.recording.log("contact/frame/names", names)
        keys_at = [(20.0 + 40.0 * i, TITLE_Y) for i in range(len(STATES))]
        colours = [WORDS if state == "separated" else STATE_COLOURS[state] for state in STATES]
        self.recording.log("contact/frame/keys", words(keys_at, list(STATES), colours))


def painted(states: Indices, times: Array, lane: int) -> NDArray[np.uint8]:
    """Return the class image (n_mesh * lane, COLUMNS) of states (n_mesh, n) at times (n,).

    A mesh has ``lane`` rows, the last of which is a dark line.
    """
    pick = np.searchsorted(times, np.linspace(times[0], times[-1], COLUMNS))
    image = np.repeat(states[:, pick].astype(np.uint8), lane, axis=0)
    image[lane - 1 :: lane] = GAP_CLASS
    return image


def lane_colour(state: str) -> Colour:
    """Return the colour of a contact state in the image."""
    return LANE if state == "separated" else STATE_COLOURS[state]
