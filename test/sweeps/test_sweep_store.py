"""The folder of a sweep."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from sweep_support import assert_same, run, small

from herringbone_sim.errors import AnalysisError
from herringbone_sim.sweeps import array_cache
from herringbone_sim.sweeps.chains import job_of, observe_parts
from herringbone_sim.sweeps.store import (
    NOT_RUN,
    _array,
    _column,
    checksum,
    load_result,
    load_store,
    open_store,
)


def test_a_part_comes_back_as_it_was_written(tmp_path: Path) -> None:
    store = open_store(tmp_path, small("up"))
    table = observe_parts([job_of(store.sweep, 0)])[0]
    store.write(0, table)
    found = store.read_part(0)
    assert found.keys() == table.keys()
    for name, values in table.items():
        assert found[name].shape == values.shape
        assert found[name].tolist() == values.tolist() or np.isnan(values.astype(float)).any()
    assert store.missing() == [1, 2]


def test_other_programs_read_the_parts(tmp_path: Path) -> None:
    run(tmp_path, small(), workers=1)
    table = pq.read_table(tmp_path / "parts")
    assert table.num_rows == 12
    assert {"delta_T", "K", "period", "exponent", "reason"} <= set(table.column_names)


def test_a_folder_of_another_sweep_is_refused(tmp_path: Path) -> None:
    open_store(tmp_path, small())
    with pytest.raises(AnalysisError, match=r"another sweep \(xi: 0.07, 0.1\): choose another"):
        open_store(tmp_path, small(xi=0.1))
    assert load_store(tmp_path).sweep == small()


def test_an_unfinished_part_does_not_count(tmp_path: Path) -> None:
    store = open_store(tmp_path, small())
    (tmp_path / "parts" / "00001.partial").write_bytes(b"PAR1 cut off")
    assert store.missing() == [0, 1, 2]
    assert (load_result(store).reasons == NOT_RUN).all()
    run(tmp_path, small(), workers=1)
    assert store.missing() == []
    assert len(list((tmp_path / "parts").glob("*.parquet"))) == 3


@pytest.mark.parametrize("start", ["fixed", "up", "down"])
def test_damaged_and_foreign_parts_are_computed_again(tmp_path: Path, start: str) -> None:
    whole = run(tmp_path, small(start), workers=1)
    store = open_store(tmp_path, small(start))
    good = store.path(1).read_bytes()
    for bad in (good[:-100], good[:200] + bytes(len(good) - 400) + good[-200:], b""):
        store.path(1).write_bytes(bad)
        assert store.missing() == [1]
        assert (load_result(store).reasons[1] == NOT_RUN).all()
        assert_same(whole, run(tmp_path, small(start), workers=1))
    store.path(1).write_bytes(store.path(0).read_bytes())
    assert_same(whole, run(tmp_path, small(start), workers=1))


def resealed(path: Path, column: str, value: float, metadata: dict[bytes, bytes] | None) -> None:
    """Write a part again with one value altered, as valid Parquet."""
    table = pq.read_table(path)
    at = table.column_names.index(column)
    values = table.column(column).to_numpy().copy()
    values[1] = value
    altered = table.set_column(at, column, [values]).replace_schema_metadata(metadata)
    pq.write_table(altered, path)


def test_an_altered_part_is_named_and_computed_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = run(tmp_path, small(), workers=1)
    store = open_store(tmp_path, small())
    sealed = pq.read_schema(store.path(1)).metadata
    capsys.readouterr()
    for metadata in (sealed, None, {}):
        resealed(store.path(1), "exponent", 0.123, metadata)
        assert store.missing() == [1]
        assert_same(whole, run(tmp_path, small(), workers=1))
        told = capsys.readouterr().err
        assert "00001.parquet" in told
        assert "computed again" in told
        assert "00000.parquet" not in told
    run(tmp_path, small(), workers=1)
    assert "can't be believed" not in capsys.readouterr().err


def test_a_part_of_another_shape_or_type_is_not_believed(tmp_path: Path) -> None:
    run(tmp_path, small(), workers=1)
    store = open_store(tmp_path, small())
    table = pq.read_table(store.path(0))
    lists = pa.array([[1, 2]] * len(table))
    narrow = pa.array(table.column("period").to_numpy().astype(np.float32))
    for column, values in (("reason", lists), ("period", narrow), ("index", lists)):
        at = table.column_names.index(column)
        pq.write_table(table.set_column(at, column, values), store.path(0))
        assert store.missing() == [0]


def test_every_kind_of_value_keeps_its_checksum() -> None:
    other_nan = np.frombuffer(b"\x01\0\0\0\0\0\xf8\x7f")[0]
    x = np.tile([0.0, -0.0, np.nan, other_nan, np.inf, 1e-310], 30)
    table = {
        "x": x,
        "points": np.stack([x, -x], axis=1),
        "reason": np.array(["", "é, \0"] * 90, dtype=object),
        "index": np.arange(180),
    }
    columns = pa.table({name: _column(values) for name, values in table.items()})
    packed = io.BytesIO()
    pq.write_table(columns, packed, compression="zstd")
    found = pq.read_table(packed)
    read = {name: _array(found.column(name)) for name in found.column_names}
    assert checksum(read) == checksum(table)
    assert checksum(table | {"x": x[::-1]}) != checksum(table)
    assert checksum(table | {"x": -x}) != checksum(table)
    assert checksum({"y" if name == "x" else name: one for name, one in table.items()}) != (
        checksum(table)
    )


def test_a_sweep_of_another_kernel_is_not_gone_on_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = run(tmp_path, small(), workers=1)
    monkeypatch.setattr(array_cache, "_sources", lambda: ("another",))
    old = open_store(tmp_path, small())
    assert_same(load_result(old), whole)
    old.path(1).unlink()
    with pytest.raises(AnalysisError, match="another version of the program"):
        open_store(tmp_path, small())
    for part in (0, 2):
        old.path(part).unlink()
    assert open_store(tmp_path, small()).kernel != old.kernel


def test_a_folder_without_a_sweep_is_told(tmp_path: Path) -> None:
    with pytest.raises(AnalysisError, match="give the folder of a sweep"):
        load_store(tmp_path)
    (tmp_path / "sweep.json").write_text("{}")
    with pytest.raises(AnalysisError, match="no description of a sweep"):
        load_store(tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(AnalysisError, match="can be written"):
        open_store(tmp_path / "file" / "under", small())
