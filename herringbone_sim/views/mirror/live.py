"""Live comparison of rig and simulator in the Rerun viewer."""

from __future__ import annotations

from typing import Any

import numpy as np

from herringbone_sim.core.layout import KINDS, Layout
from herringbone_sim.errors import HerringboneError
from herringbone_sim.gap.stream.comparison import ComparisonResult
from herringbone_sim.views.mirror.live_text import headline, table
from herringbone_sim.views.mirror.target import MirrorTarget

CLOSE_S = 5.0
SMALL = 1e-2
EVERY_MESH = tuple(m for layout in (Layout(1, False), Layout(3, True)) for m in layout.meshes)


class LiveMirror:
    """Sends comparisons to a viewer; after a failure of the viewer it sends nothing more.

    Args:
        target: viewer, server or file to send to; not ``off``.

    Attributes:
        state: ``running`` or ``failed: reason``.
    """

    def __init__(self, target: MirrorTarget) -> None:
        self.state = "running"
        self._sink: Any = None
        self._places: tuple[str, ...] = ()
        self._arranged = False
        try:
            from herringbone_sim.views.mirror.sink import open_sink

            self._sink = open_sink(target)
        except (HerringboneError, ModuleNotFoundError) as error:
            self._fail(error)

    def show(self, picture: ComparisonResult, topics: tuple[str, ...] = ()) -> None:
        """Send a comparison; ``topics`` is unused but passed to every output of ``gap live``."""
        if self._sink is None:
            return
        try:
            self._send(picture)
            self._sink.deliver()
        except (HerringboneError, RuntimeError) as error:
            self._fail(error)
        except Exception as error:
            # This comparison can't be drawn; the next one perhaps can.
            self.state = f"failed: {error}"
        else:
            self.state = "running"

    def close(self) -> str:
        """Close the connection; return a line with its address or the reason of a failure."""
        if self._sink is None:
            return f"mirror {self.state}"
        address = self._sink.address
        try:
            self._sink.close(CLOSE_S)
        except RuntimeError as error:
            self._fail(error)
            return f"mirror {self.state}"
        return f"mirrored to {address}"

    def _fail(self, error: Exception) -> None:
        self.state = f"failed: {error}"
        self._sink = None

    def _send(self, picture: ComparisonResult) -> None:
        import rerun as rr

        from herringbone_sim.views.mirror.gear import send_shares

        recording, residual = self._sink.recording, picture.residual
        recording.set_time("wall_time", timestamp=np.datetime64("now", "ms"))
        if np.isfinite(picture.rig.t_s):
            recording.set_time("rig_time", duration=picture.rig.t_s)
        text = f"```\n{table(picture)}\n```"
        recording.log("text", rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))
        if residual is None:
            self._arrange(())
            return
        self._arrange(residual.places)
        recording.log("events", rr.TextLog(headline(residual)))
        if residual.metric == "force_law":
            shares = dict(zip(residual.places, map(float, residual.shares), strict=True))
            send_shares(recording, "gear", shares)
        for kind, at in _groups(residual.places).items():
            values = np.maximum(residual.chi[at], SMALL)
            recording.log(f"floors/{kind}", rr.Scalars(values))
        beside = picture.simulator_motion if picture.comparable else None
        for name, motion in (("rig", picture.rig_motion), ("sim", beside)):
            if motion is not None:
                for kind, at in _groups(motion.meshes).items():
                    force = 1e-3 * motion.force_rms_n[at]
                    recording.log(f"force/{kind}/{name}", rr.Scalars(force))

    def _arrange(self, places: tuple[str, ...]) -> None:
        """Send names, colours and the blueprint if the places have changed."""
        from herringbone_sim.views.mirror.live_blueprint import arrange

        if places != self._places or not self._arranged:
            self._places, self._arranged = places, True
            arrange(self._sink.recording, places, _groups(places))


def _groups(places: tuple[str, ...]) -> dict[str, list[int]]:
    """Return the indices of meshes by kind; of coordinates all under ``bodies``."""
    of_meshes = [p for p in places if p in EVERY_MESH]
    if len(of_meshes) < len(places):
        return {"bodies": list(range(len(places)))}
    groups = {k: [j for j, p in enumerate(places) if p.startswith(k)] for k in KINDS}
    return {kind: at for kind, at in groups.items() if at}
