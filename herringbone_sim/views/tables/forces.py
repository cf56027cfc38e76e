"""Table of the mesh forces that a diagnosis reconstructs from few channels."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from herringbone_sim.gap.observations.reconstructed_forces import ReconstructedForces
from herringbone_sim.views.tables.csv_file import write_csv


def write_forces(path: Path, forces: ReconstructedForces | None) -> None:
    """Write CSV, a row per sample: time [s], mesh forces [N], half-widths of 90 % bands [N].

    Without forces, remove the file of an earlier diagnosis.
    """
    if forces is None:
        path.unlink(missing_ok=True)
        return
    head = ["t_s", *(f"F_{m}_n" for m in forces.meshes), *(f"half_{m}_n" for m in forces.meshes)]
    write_csv(path, head, np.column_stack([forces.times, forces.force, forces.half]))
