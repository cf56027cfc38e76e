"""A sweep in a folder: ``sweep.json`` and one Parquet file per part, each written atomically.

Each part stores the checksum of its values in the metadata of its schema; a part without a valid
checksum counts as missing.
"""

from __future__ import annotations

import hashlib
import json
import numbers
import re
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from herringbone_sim.arrays import Array
from herringbone_sim.core.parameters import to_mapping
from herringbone_sim.errors import AnalysisError, ParameterError
from herringbone_sim.recording.safe_json import JsonError, json_text, parse_json
from herringbone_sim.sweeps.array_cache import digest
from herringbone_sim.sweeps.grid import Axis, Sweep
from herringbone_sim.sweeps.grid_json import sweep_from_json
from herringbone_sim.sweeps.observe import SCALARS, Table
from herringbone_sim.sweeps.output import make_folder, whole_file

FILE = "sweep.json"
CHECKSUM = b"sha256"  # key in the metadata of the schema of a part
NOT_RUN = "not run yet"
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+\.?\d*(e[-+]?\d+)?")


@dataclass(frozen=True)
class Store:
    """Folder of one sweep.

    Attributes:
        folder: contains ``sweep.json`` and ``parts/00000.parquet``, ...
        sweep: the sweep described there.
        kernel: digest of the package's sources that computed its parts.
    """

    folder: Path
    sweep: Sweep
    kernel: str = ""

    def path(self, part: int) -> Path:
        """File of a part."""
        return self.folder / "parts" / f"{part:05d}.parquet"

    def missing(self) -> list[int]:
        """Numbers of the parts that are not stored, or whose file is damaged; reads all files."""
        return [part for part in range(self.sweep.n_parts) if self.read_part(part) is None]

    def write(self, part: int, table: Table) -> None:
        """Write the table of a part atomically, with its checksum."""
        columns = {name: _column(values) for name, values in table.items()}
        sealed = pa.table(columns, metadata={CHECKSUM: checksum(table)})
        with whole_file(self.path(part)) as file:
            pq.write_table(sealed, file, compression="zstd")

    def read_part(self, part: int) -> Table | None:
        """Table of one part as it was written; None if it is missing or damaged."""
        try:
            stored = pq.read_table(self.path(part))
            table = {name: _array(stored.column(name)) for name in stored.column_names}
            sealed = (stored.schema.metadata or {}).get(CHECKSUM) == checksum(table).encode()
            mine = np.array_equal(table["index"], self.sweep.part(part))
        except (pa.ArrowException, OSError, KeyError, ValueError):
            return None
        return table if sealed and mine else None


@dataclass(frozen=True)
class Failure:
    """Values of a sweep that failed for the same reason, whose texts may differ in their numbers.

    Attributes:
        count: number of values.
        ranges: smallest and largest value on each axis, by name.
        reason: of the first of these values.
    """

    count: int
    ranges: dict[str, tuple[float, float]]
    reason: str

    def __str__(self) -> str:
        places = (
            f"{name} = {low:g}" if low == high else f"{name} = {low:g} to {high:g}"
            for name, (low, high) in self.ranges.items()
        )
        return f"{self.count} failed at {', '.join(places)}: {self.reason}"


@dataclass(frozen=True)
class Result:
    """Results of a sweep as arrays in the shape of its grid.

    Attributes:
        sweep: definition of the sweep.
        columns: by name, (*shape,) or (*shape, k), see ``observe``; NaN where a value failed.
        reasons: (*shape,) texts, empty where nothing failed.
    """

    sweep: Sweep
    columns: dict[str, Array]
    reasons: NDArray[np.object_]

    def __getitem__(self, name: str) -> Array:
        return self.columns[name]

    @property
    def axes(self) -> tuple[Axis, ...]:
        return self.sweep.axes

    def failures(self) -> list[Failure]:
        """Failed values grouped by reason, the largest group first; empty if none failed.

        Reasons that differ only in the numbers in their text are one group.
        """
        kinds: dict[str, list[int]] = {}
        for index, reason in enumerate(self.reasons.flat):
            if reason:
                kinds.setdefault(NUMBER.sub("#", str(reason)), []).append(index)
        failures = [self._failure(indices) for indices in kinds.values()]
        return sorted(failures, key=lambda failure: -failure.count)

    def _failure(self, indices: list[int]) -> Failure:
        """Group the failed values at some flat indices, which share a reason."""
        places = np.unravel_index(indices, self.sweep.shape)
        ranges = {
            axis.name: (axis.values[int(at.min())], axis.values[int(at.max())])
            for axis, at in zip(self.axes, places, strict=True)
        }
        return Failure(len(indices), ranges, str(self.reasons.flat[indices[0]]))


def open_store(folder: Path | str, sweep: Sweep) -> Store:
    """Create the folder of a sweep, or open it to continue the same sweep.

    A sweep that another version of the program has completed is opened as it is.

    Raises:
        AnalysisError: the folder holds another sweep, or an unfinished one of another version of
            the program, or can't be written.
    """
    store = Store(Path(folder), sweep, digest([]))
    described = store.folder / FILE
    if described.exists():
        begun = load_store(folder)
        if begun.sweep != sweep:
            raise AnalysisError(
                f"{folder} holds another sweep ({'; '.join(differences(begun.sweep, sweep))}): "
                "choose another folder, or repeat that sweep as it was"
            )
        if begun.kernel != store.kernel and _complete_by_other_version(begun):
            return begun
    make_folder(store.folder / "parts")
    with whole_file(described) as file:
        file.write(_described(store).encode())
    return store


def differences(first: Sweep, second: Sweep) -> list[str]:
    """Differences between two sweeps, as texts ``name: value, value``."""
    pairs = zip(_flat(first).items(), _flat(second).values(), strict=True)
    return [f"{name}: {_short(a)}, {_short(b)}" for (name, a), b in pairs if a != b]


def _flat(sweep: Sweep) -> dict[str, Any]:
    base = to_mapping(sweep.base) | asdict(sweep.observation)
    more = {name: getattr(sweep, name) for name in ("axes", "start", "chunk", "effects")}
    return base | more


def _short(value: Any) -> str:
    if isinstance(value, tuple) and value and isinstance(value[0], Axis):
        return " x ".join(f"{a.name}={a.values[0]:g}:{a.values[-1]:g}:{len(a)}" for a in value)
    return f"{value:g}" if isinstance(value, numbers.Real) else str(value)


def _complete_by_other_version(store: Store) -> bool:
    """Whether a sweep of another version is complete; False if none of its parts are stored.

    Raises:
        AnalysisError: only some of its parts are stored.
    """
    missing = len(store.missing())
    if 0 < missing < store.sweep.n_parts:
        raise AnalysisError(
            f"{store.folder} was begun by another version of the program, and what is missing "
            "would not match: choose another folder, or delete this one to run it all again"
        )
    return not missing


def _described(store: Store) -> str:
    """Text of ``sweep.json``."""
    return json.dumps(json.loads(store.sweep.to_json()) | {"kernel": store.kernel}, indent=1)


def load_store(folder: Path | str) -> Store:
    """Open the folder of an existing sweep; AnalysisError if it holds none."""
    described = Path(folder) / FILE
    try:
        text = json_text(described)
        sweep = sweep_from_json(text)
        return Store(Path(folder), sweep, str(parse_json(text).get("kernel", "")))
    except OSError as error:
        raise AnalysisError(f"{described}: {error.strerror}: give the folder of a sweep") from None
    except (ParameterError, JsonError) as error:
        raise AnalysisError(f"{described}: {error}: choose another folder") from None


def load_result(store: Store) -> Result:
    """Read the results stored so far.

    Values without a stored part, or with a damaged one, are NaN with the reason ``not run yet``.
    """
    sweep = store.sweep
    columns = {name: np.full(sweep.size, np.nan) for name in SCALARS}
    reasons = np.full(sweep.size, NOT_RUN, dtype=object)
    look = sweep.observation
    if look.mesh:
        columns["points"] = np.full((sweep.size, look.points), np.nan)
    for part in range(sweep.n_parts):
        table, rows = store.read_part(part), sweep.part(part)
        if table is not None:
            for name, column in columns.items():
                column[rows.start : rows.stop] = table[name]
            reasons[rows.start : rows.stop] = table["reason"]
    shaped = {name: x.reshape(*sweep.shape, *x.shape[1:]) for name, x in columns.items()}
    return Result(sweep, shaped, reasons.reshape(sweep.shape))


def checksum(table: Table) -> str:
    """SHA-256 of the names, types, shapes and values of a table; all NaNs count as equal."""
    sha256 = hashlib.sha256()
    for name, values in sorted(table.items()):
        content = _content(values)
        sha256.update(f"{name} {values.dtype} {values.shape} {len(content)} ".encode())
        sha256.update(content)
    return sha256.hexdigest()


def _content(values: NDArray[Any]) -> bytes:
    """Bytes of a column for the checksum, all NaNs made equal."""
    if values.dtype == object:
        return json.dumps(values.tolist(), default=str).encode()
    if values.dtype.kind == "f":
        values = np.where(np.isnan(values), np.nan, values)
    return values.tobytes()


def _column(values: NDArray[Any]) -> Any:
    """Arrow array of a column, (n,) or (n, k)."""
    if values.ndim == 1:
        return pa.array(values)
    return pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), values.shape[1])


def _array(column: Any) -> Any:
    """NumPy array of an Arrow column."""
    whole = column.combine_chunks()
    if pa.types.is_fixed_size_list(whole.type):
        flat = whole.flatten().to_numpy(zero_copy_only=False)
        return flat.reshape(-1, whole.type.list_size)
    return whole.to_numpy(zero_copy_only=False)
