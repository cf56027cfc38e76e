"""Option ``gap --rerun``: a diagnosis in the Rerun viewer."""

from __future__ import annotations

from herringbone_sim.cli.show import wait_for_interrupt
from herringbone_sim.gap.data.prepared import PreparedCampaign
from herringbone_sim.gap.diagnose import Diagnosis
from herringbone_sim.views.mirror.target import MirrorTarget

CLOSE_S = 60.0


def mirror_gap(target: MirrorTarget, campaign: PreparedCampaign, diagnosis: Diagnosis) -> str:
    """Send a diagnosis to the viewer; a line that says where it went, or why that failed."""
    try:
        from herringbone_sim.views.mirror.gap import mirror
        from herringbone_sim.views.mirror.sink import open_sink

        sink = open_sink(target.mode, target.address, target.path, target.memory_limit)
        try:
            mirror(campaign, diagnosis, sink)
            if target.mode == "serve":
                wait_for_interrupt(sink.address)
        finally:
            sink.close(CLOSE_S)
    except Exception as error:
        # A failure of the viewer must not end the program before the report is complete.
        return f"not mirrored: {error}"
    return f"mirrored to {sink.address}"
