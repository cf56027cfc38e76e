"""Pages of an analysed run and of an import: texts and ranges that they show."""

from __future__ import annotations

import math
import re

import numpy as np
from analysis_support import harmonic_series

from herringbone_sim.analysis.pipeline import analyze_series
from herringbone_sim.recording.importing.campaign import ImportedChannel, ImportedRun
from herringbone_sim.views.pages.imported import ranges_by_quantity
from herringbone_sim.views.pages.report import Report, report_html


def test_reasons_stand_in_the_order_of_the_segments_first_of_the_period() -> None:
    """Their order does not depend on how texts are hashed; there are at most twelve."""
    cycles, levels = 4, 7
    K = np.repeat(np.arange(levels) / 10, cycles * 16)
    series = harmonic_series(cycles * levels, {1.0: 1e-5}, K=np.append(K, K[-1]))
    page = report_html(Report("run_00", (), analyze_series(series)), (), ())
    reasons = re.findall(r"Segment (\d): 3 cycles are too few(: a period)?", page)
    assert reasons == [(str(n), text) for n in range(1, levels) for text in (": a period", "")]


def test_a_channel_without_values_does_not_hide_the_range_of_the_others() -> None:
    def channel(name: str, low: float, high: float) -> ImportedChannel:
        return ImportedChannel(name, "m", "", 1e4, low, high)

    nothing = (math.nan, math.nan)
    taken = (channel("x_sp_L", *nothing), channel("x_sp_R", -2.0, 3.0), channel("T_1", *nothing))
    run = ImportedRun("run_00", "fit", 100, 1e4, 10.0, taken, (), ())
    ranges = ranges_by_quantity(run)
    assert ranges["x"] == ("m", -2.0, 3.0)
    assert np.isnan(ranges["T_1"][1:]).all()
