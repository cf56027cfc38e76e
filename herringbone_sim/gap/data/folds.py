"""Folds for leave-one-out scores: the fit runs, or parts of a single fit run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from herringbone_sim.core.layout import QUANTITIES
from herringbone_sim.gap.data.mesh_excitation import Waves
from herringbone_sim.gap.data.prepared import Measured, PreparedRun

PARTS = 3


def leave_out_folds(runs: Sequence[PreparedRun]) -> tuple[PreparedRun, ...]:
    """Return the runs as folds; a single run is cut into ``PARTS`` folds of about equal length.

    Parts of one run share load, temperature and speed, so how an effect depends on those three is
    not tested.
    """
    if len(runs) != 1:
        return tuple(runs)
    edges = np.linspace(0, len(runs[0]), PARTS + 1).astype(int)
    return tuple(
        slice_run(runs[0], slice(int(a), int(b)), f"{runs[0].name} part {i + 1}")
        for i, (a, b) in enumerate(pairwise(edges))
    )


def slice_run(run: PreparedRun, rows: slice, name: str) -> PreparedRun:
    """Return the samples ``rows`` of a run as a run with the name ``name``.

    Times and phase are not shifted; noise, delay and findings stay those of the whole run.
    """

    def cut(measured: Measured) -> Measured:
        return replace(measured, values=measured.values[rows])

    w = run.waves
    cuts: dict[str, Any] = {q: cut(getattr(run, q)) for q in QUANTITIES}
    return replace(
        run,
        name=name,
        times=run.times[rows],
        phase=run.phase[rows],
        **cuts,
        waves=Waves(w.k[rows], w.e[rows], w.e_rate[rows]),
        recorded_point={q: values[rows] for q, values in run.recorded_point.items()},
    )
