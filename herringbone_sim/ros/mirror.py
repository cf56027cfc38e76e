"""Pass deliveries of the loop to the mirror in the Rerun viewer."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from herringbone_sim.analysis.monitor import Regime
from herringbone_sim.core.model import Model
from herringbone_sim.core.parameters import live_names
from herringbone_sim.ros.parameters import path_of
from herringbone_sim.ros.session import half_backlash
from herringbone_sim.runtime import Delivery
from herringbone_sim.views.mirror.block import Drawing, MirrorBlock, Scale
from herringbone_sim.views.mirror.mirror import RerunMirror
from herringbone_sim.views.mirror.target import MirrorTarget


class Mirror(RerunMirror):
    """Mirror of the deliveries of a node; does nothing with the parameter ``mirror: off``.

    Args:
        model: model at the start of the run.
        options: values of the parameters ``mirror*`` by name.
        report: called with a text on each failure.
    """

    def __init__(
        self, model: Model, options: Mapping[str, Any], report: Callable[[str], None]
    ) -> None:
        s = model.scales
        target = MirrorTarget(
            options["mirror"],
            options["mirror_address"],
            path_of("mirror_path", options["mirror_path"])
            if options["mirror"] == "save"
            else None,
            options["mirror_memory"],
        )
        drawing = Drawing(model.layout, Scale(s.b_c, half_backlash(model), s.omega_n))
        self._label = ""
        super().__init__(target, drawing, report=lambda text: report(f"mirror {text}"))

    def show(self, deliveries: list[Delivery], regime: Regime) -> None:
        """Queue deliveries, with the regime at their end, for the viewer without waiting."""
        if self.mode == "off":
            return
        last = deliveries[-1]
        names, p = last.model.layout.channels, last.model.parameters
        sections = np.vstack([d.block.rows[d.block.section] for d in deliveries])
        block = MirrorBlock(
            wall_ns=time.time_ns(),
            names=names,
            rows=np.vstack([d.block.rows for d in deliveries]),
            sections=sections,
            contact_shares=dict(
                zip(last.model.layout.meshes, map(float, regime.contact[:, 2]), strict=False)
            ),
            parameters={name: float(getattr(p, name)) for name in live_names()},
            events=self._events(deliveries, regime),
            regime=regime.label,
            exponent=regime.exponent,
            b_half=half_backlash(last.model),
        )
        self.put(block)

    def _events(self, deliveries: list[Delivery], regime: Regime) -> tuple[str, ...]:
        """Texts on the parameter changes of deliveries, and on a change of the regime."""
        lines = [
            f"t = {change.t_s:.6f} s: " + ", ".join(f"{k} = {v}" for k, v in change.values.items())
            for delivery in deliveries
            for change in delivery.changes
        ]
        if regime.label != self._label:
            self._label = regime.label
            lines.append(f"t = {deliveries[-1].block.end.t:.6f} s: {regime.label}")
        return tuple(lines)
