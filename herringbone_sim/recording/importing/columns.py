"""Read columns of a file: one small reader for each kind of file, behind ``read_columns``."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.errors import RecordingError, listed, shown
from herringbone_sim.recording.importing.bags import bag_columns
from herringbone_sim.recording.importing.units import package

Values = NDArray[Any]
Read = Callable[[], Values]


@dataclass(frozen=True)
class Columns:
    """Columns of a file.

    Attributes:
        values: name -> (n,) of the wanted columns: float64, NaN for an empty cell, or
            datetime64[ns] for dates.
        stamps: name -> (n,) times of columns whose clock is in the file, [s] or datetime64[ns].
        names: names of all columns in the file.
    """

    values: Mapping[str, Values]
    stamps: Mapping[str, Values]
    names: tuple[str, ...]


def read_columns(
    path: Path, kind: str, column_names: Sequence[str], options: Mapping[str, Any]
) -> Columns:
    """Read the wanted columns of a file.

    Args:
        path: the file, or folder of a bag.
        kind, options: as in ``FileSpec``.
        column_names: names of the wanted columns.

    Raises:
        RecordingError: the file is not of its kind or can't be read, a package is missing, or a
            column is missing or not numeric.
    """
    try:
        if kind == "rosbag2":
            there, stamps, names = bag_columns(path, column_names)
        else:
            readers, stamps = _READERS[kind](path, options)
            names = tuple(readers)
            there = {name: readers[name]() for name in column_names if name in readers}
    except RecordingError:
        raise
    except Exception as error:  # each package has errors of its own for files that are broken
        raise RecordingError(
            f"{path} can't be read as {kind} ({type(error).__name__}: {shown(str(error))}): give "
            "the kind that it is, or mend the file"
        ) from error
    lacking = [name for name in column_names if name not in there]
    if lacking:
        raise RecordingError(
            f"{path} has no column {shown(lacking[0])}, it has {listed(names)}: mend the spec"
        )
    values = {name: _numbers(path, name, column) for name, column in there.items()}
    return Columns(values, {name: stamps[name] for name in there if name in stamps}, names)


def _numbers(path: Path, name: str, values: Values) -> Values:
    """Return a column as float64 or datetime64[ns]; RecordingError if it is neither."""
    values = np.asarray(values)
    if values.dtype.kind == "M":
        return values.astype("datetime64[ns]")
    if values.dtype.kind not in "fiub" or values.ndim != 1:
        raise RecordingError(
            f"column {shown(name)} of {path} must hold numbers in a row, got {values.dtype} of "
            f"shape {values.shape}: name another column"
            + (" or, of text, its decimal mark" if values.dtype.kind in "OSU" else "")
        )
    return values.astype(np.float64)


# Column -> function that reads it; column -> its times (n,) [s], if the file has them.
_Found = tuple[dict[str, Read], dict[str, Values]]


def _arrow(path: Path, table: Any) -> dict[str, Read]:
    """Return readers of the columns of an Arrow table."""
    return {name: partial(_of_arrow, path, table, name) for name in table.column_names}


def _of_arrow(path: Path, table: Any, name: str) -> Values:
    """Read a column, NaN if all its cells are empty; RecordingError if two have its name."""
    count = table.column_names.count(name)
    if count > 1:
        raise RecordingError(
            f"{path} must have one column {shown(name)}, got {count}: give them names of their own"
        )
    column = table.column(name)
    if 0 < column.null_count == len(column):
        return np.full(len(column), np.nan)
    values: Values = column.to_numpy()
    return values


def _csv(path: Path, options: Mapping[str, Any]) -> _Found:
    """Return readers of the columns of a text table."""
    csv = package("pyarrow.csv", "pyarrow", "tables of text")
    table = csv.read_csv(
        path,
        csv.ReadOptions(
            skip_rows=options["skip"],
            skip_rows_after_names=options["skip_after_names"],
            encoding=options["encoding"],
        ),
        csv.ParseOptions(delimiter=options["delimiter"]),
        csv.ConvertOptions(decimal_point=options["decimal"]),
    )
    return _arrow(path, table), {}


def _parquet(path: Path, _: Mapping[str, Any]) -> _Found:
    file = package("pyarrow.parquet", "pyarrow", "Parquet files").ParquetFile(path)
    return _arrow(path, file.read()), {}


def _mat(path: Path, _: Mapping[str, Any]) -> _Found:
    """Return readers of the arrays of a MATLAB file, v5 or v7.3."""
    with path.open("rb") as file:
        if file.read(10) == b"MATLAB 7.3":
            return _of_hdf5(path, matlab=True), {}
    content = package("scipy.io", "scipy", "MAT files").loadmat(path, simplify_cells=True)
    named = {k: v for k, v in content.items() if not k.startswith("__")}
    return dict(_leaves(named, "", matlab=True)), {}


def _leaves(content: Mapping[str, Any], prefix: str, matlab: bool) -> Iterator[tuple[str, Read]]:
    """Yield (name, reader) of the arrays in a nested mapping, keys joined by dots."""
    for key, value in content.items():
        if isinstance(value, dict):
            yield from _leaves(value, f"{prefix}{key}.", matlab)
        elif isinstance(value, np.ndarray):
            yield from _parted(f"{prefix}{key}", value.shape, partial(np.asarray, value), matlab)


def _hdf5(path: Path, _: Mapping[str, Any]) -> _Found:
    return _of_hdf5(path, matlab=False), {}


def _of_hdf5(path: Path, matlab: bool) -> dict[str, Read]:
    """Return readers of all datasets of an HDF5 file, named in MATLAB style if ``matlab``."""
    h5py = package("h5py", "h5py", "HDF5 and MAT v7.3 files")
    readers: dict[str, Read] = {}

    def take(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.shape is not None and name[:1] != "#":
            shape = item.shape[::-1] if matlab else item.shape  # MATLAB stores columns as rows
            shown_name = name.replace("/", ".") if matlab else name
            readers.update(
                _parted(shown_name, shape, partial(_dataset, path, name, matlab), matlab)
            )

    with h5py.File(path) as file:
        file.visititems(take)
    return readers


def _dataset(path: Path, name: str, turned: bool) -> Values:
    """Read a dataset, transposed if ``turned``: MATLAB files store columns as rows."""
    with package("h5py", "h5py", "HDF5 and MAT v7.3 files").File(path) as file:
        values: Values = file[name][()]
        return values.T if turned else values


def _parted(
    name: str, shape: tuple[int, ...], read: Read, matlab: bool
) -> Iterator[tuple[str, Read]]:
    """Yield (name, reader) of a vector, or of each column of a matrix: ``(:,2)`` or ``[:,1]``."""
    if len(shape) != 2 or 1 in shape:
        yield name, partial(_flat, read)
        return
    for j in range(shape[1]):
        yield f"{name}(:,{j + 1})" if matlab else f"{name}[:,{j}]", partial(_column, read, j)


def _flat(read: Read) -> Values:
    values = read()
    return values.ravel() if values.ndim == 2 else values


def _column(read: Read, j: int) -> Values:
    values: Values = read()[:, j]
    return values


def _tdms(path: Path, _: Mapping[str, Any]) -> _Found:
    """Return readers and clocks [s] of the channels of a TDMS file."""
    file = package("nptdms", "npTDMS", "TDMS files").TdmsFile.read(path, raw_timestamps=True)
    every = {f"{c.group_name}/{c.name}": c for group in file.groups() for c in group.channels()}
    clocks = {
        name: c.properties.get("wf_start_offset", 0.0)
        + np.arange(len(c)) * float(c.properties["wf_increment"])
        for name, c in every.items()
        if c.properties.get("wf_increment")
    }
    return {name: partial(_of_tdms, c) for name, c in every.items()}, clocks


def _of_tdms(channel: Any) -> Values:
    """Read a channel; times to the nanosecond, where npTDMS would cut them to microseconds."""
    values = channel[:]
    dates = getattr(values, "as_datetime64", None)
    read: Values = values if dates is None else dates("ns")
    return read


_READERS: Mapping[str, Callable[[Path, Mapping[str, Any]], _Found]] = {
    "csv": _csv,
    "parquet": _parquet,
    "mat": _mat,
    "hdf5": _hdf5,
    "tdms": _tdms,
}
