"""A sweep in a folder: ``sweep.json`` and one Parquet file a part, each written whole or not."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from herringbone_sim.errors import AnalysisError, ParameterError
from herringbone_sim.sweeps.grid import Axis, Sweep, differences, sweep_from_json
from herringbone_sim.sweeps.kept import make_folder, whole
from herringbone_sim.sweeps.observe import SCALARS, Array, Table

FILE = "sweep.json"
NOT_RUN = "not run yet"


@dataclass(frozen=True)
class Store:
    """Folder of one sweep.

    Attributes:
        folder: holds ``sweep.json`` and ``parts/00000.parquet``, ...
        sweep: what is described there.
    """

    folder: Path
    sweep: Sweep

    def path(self, part: int) -> Path:
        return self.folder / "parts" / f"{part:05d}.parquet"

    def has(self, part: int) -> bool:
        return self.path(part).is_file()

    def missing(self) -> list[int]:
        """Numbers of the parts that are not there."""
        return [part for part in range(self.sweep.n_parts) if not self.has(part)]

    def write(self, part: int, table: Table) -> None:
        """Write a part, whole or not at all."""
        columns = {name: _column(values) for name, values in table.items()}
        with whole(self.path(part)) as file:
            pq.write_table(pa.table(columns), file, compression="zstd")

    def read_part(self, part: int) -> Table:
        """The table of one part, as it was written.

        Raises:
            AnalysisError: the file is no part of this sweep.
        """
        try:
            found = pq.read_table(self.path(part))
            table = {name: _array(found.column(name)) for name in found.column_names}
        except (pa.ArrowException, OSError) as error:
            raise AnalysisError(
                f"{self.path(part)} can't be read ({error}): delete it and run the sweep again"
            ) from None
        if list(table["index"]) != list(self.sweep.part(part)):
            raise AnalysisError(
                f"{self.path(part)} holds other values than this sweep: delete it and run again"
            )
        return table


@dataclass(frozen=True)
class Result:
    """All that a sweep found, as arrays in the shape of its grid.

    Attributes:
        sweep: what was run.
        columns: name -> (*shape,) or (*shape, k) array, see ``observe``; NaN where it failed.
        reasons: (*shape,) texts, empty where all went well.
    """

    sweep: Sweep
    columns: dict[str, Array]
    reasons: NDArray[np.object_]

    def __getitem__(self, name: str) -> Array:
        return self.columns[name]

    @property
    def axes(self) -> tuple[Axis, ...]:
        return self.sweep.axes

    def failures(self) -> dict[str, int]:
        """How often each reason to fail was met, the commonest first; values are left out."""
        told = (str(reason).split(" leaves mesh ")[0] for reason in self.reasons.flat if reason)
        return dict(Counter(told).most_common())


def open_store(folder: Path | str, sweep: Sweep) -> Store:
    """Folder for a sweep: a new one, or the one in which the same sweep was begun.

    Raises:
        AnalysisError: the folder holds another sweep, or can't be written.
    """
    store = Store(Path(folder), sweep)
    described = store.folder / FILE
    if described.exists():
        other = load_store(folder).sweep
        if other != sweep:
            raise AnalysisError(
                f"{folder} holds another sweep ({'; '.join(differences(other, sweep))}): "
                "choose another folder, or repeat that sweep as it was"
            )
    make_folder(store.folder / "parts")
    with whole(described) as file:
        file.write(sweep.to_json().encode())
    return store


def load_store(folder: Path | str) -> Store:
    """Folder of a sweep that was begun; AnalysisError when there is none in it."""
    described = Path(folder) / FILE
    try:
        return Store(Path(folder), sweep_from_json(described.read_text(encoding="utf-8")))
    except OSError as error:
        raise AnalysisError(f"{described}: {error.strerror}: give the folder of a sweep") from None
    except ParameterError as error:
        raise AnalysisError(f"{described}: {error}: choose another folder") from None


def load_result(store: Store) -> Result:
    """All that is in a folder so far; values that were not run are NaN with that reason."""
    sweep = store.sweep
    columns = {name: np.full(sweep.size, np.nan) for name in SCALARS}
    reasons = np.full(sweep.size, NOT_RUN, dtype=object)
    look = sweep.observation
    if look.mesh:
        columns["points"] = np.full((sweep.size, look.points), np.nan)
    for part in range(sweep.n_parts):
        if store.has(part):
            table, rows = store.read_part(part), sweep.part(part)
            for name, column in columns.items():
                column[rows.start : rows.stop] = table[name]
            reasons[rows.start : rows.stop] = table["reason"]
    shaped = {name: x.reshape(*sweep.shape, *x.shape[1:]) for name, x in columns.items()}
    return Result(sweep, shaped, reasons.reshape(sweep.shape))


def _column(values: NDArray[Any]) -> Any:
    if values.ndim == 1:
        return pa.array(values)
    return pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), values.shape[1])


def _array(column: Any) -> Any:
    whole = column.combine_chunks()
    if pa.types.is_fixed_size_list(whole.type):
        flat = whole.flatten().to_numpy(zero_copy_only=False)
        return flat.reshape(-1, whole.type.list_size)
    return whole.to_numpy(zero_copy_only=False)
