"""The mirror of a diagnosis, as ``gap --rerun`` asks for it."""

from __future__ import annotations

from herringbone_sim.cli.rerun_option import Where
from herringbone_sim.cli.show import wait_for_interrupt
from herringbone_sim.gap.data.prepared import PreparedCampaign
from herringbone_sim.gap.diagnose import Diagnosis

MEMORY = "1GB"
CLOSE_S = 60.0


def mirror_gap(where: Where, campaign: PreparedCampaign, found: Diagnosis) -> str:
    """Mirror a diagnosis; what became of it, in a line.

    A viewer that fails is said and never costs the report.
    """
    try:
        from herringbone_sim.views.mirror.gap import mirror
        from herringbone_sim.views.mirror.sink import open_sink

        sink = open_sink(where.mode, where.address, where.path, MEMORY)
        try:
            mirror(campaign, found, sink)
            if where.mode == "serve":
                wait_for_interrupt(sink.address)
        finally:
            sink.close(CLOSE_S)
    except Exception as error:
        # Whatever a viewer or a drawing does: the report is worth more.
        return f"not mirrored: {error}"
    return f"mirrored to {sink.address}"
