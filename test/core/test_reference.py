"""References: compiled code reads from them what the named tuple holds, and nothing else."""

from __future__ import annotations

import copy
import pickle
from typing import Any, NamedTuple

import numpy as np
import pytest

from herringbone_sim.core.packed import compiled, make_work
from herringbone_sim.core.reference import Reference, call, row_of, tables


class Inner(NamedTuple):
    """A tuple within a tuple."""

    flags: Any  # (n,)
    cube: Any  # (a, b, c)


class Outer(NamedTuple):
    """All kinds of fields."""

    lengths: tuple[int, ...]
    half: float
    count: int
    on: bool
    inner: Inner | None
    table: Any  # (n, m)


def outer(**changes: Any) -> Outer:
    inner = Inner(np.array([True, False]), np.arange(24.0).reshape(2, 3, 4))
    whole = Outer((0, 0, 0), 0.5, -3, True, inner, np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]))
    return whole._replace(**changes)


@compiled
def read_inner(inner, out):
    """Write what the inner tuple holds, if there is one."""
    if inner is not None:
        out[4] = inner.cube[1, 2, 3]
        out[5] = 1.0 if inner.flags[0] and not inner.flags[1] else 0.0
        out[6] = inner.cube.shape[1]


@compiled
def read(r, out):
    """Write what a reference holds to ``out``, and -1 into the last entry of its table."""
    out[0] = len(r.lengths)
    out[1] = r.half
    out[2] = r.count
    out[3] = 1.0 if r.on else 0.0
    read_inner(r.inner, out)
    out[7] = r.table[2, 0]
    out[8] = r.table[-1, -1]
    r.table[-1, -1] = -1.0


@compiled
def read_k(w, out):
    """Write the first entry of k."""
    out[0] = w.k[0]


@compiled
def read_row(like, rows, i, out):
    """Write number and first entry of the table of row i."""
    row = row_of(like, rows, i)
    out[0] = row.half
    out[1] = row.table[0, 0]


def test_compiled_code_reads_and_writes_what_the_tuple_holds() -> None:
    whole, out = outer(), np.zeros(9)
    call(read, Reference(whole), out)
    np.testing.assert_array_equal(out, [3, 0.5, -3, 1, 23, 1, 3, 5, 6])
    assert whole.table[2, 1] == -1.0


def test_references_of_other_types_are_compiled_anew_and_of_other_values_are_not() -> None:
    out = np.zeros(9)
    call(read, Reference(outer()), out)
    known = len(read.signatures)
    call(read, Reference(outer(half=-7.25, on=False, table=np.full((4, 9), 2.0))), out)
    np.testing.assert_array_equal(out[[1, 3, 7, 8]], [-7.25, 0.0, 2.0, 2.0])
    assert len(read.signatures) == known
    for changes, at in (({"lengths": (0,)}, 0), ({"inner": None}, 1)):
        out[:] = 0.0
        call(read, Reference(outer(**changes)), out)
        known += 1
        assert len(read.signatures) == known
        assert (out[0], out[4]) == ((1, 23), (3, 0))[at]  # lengths, then entry of the inner tuple


def test_rows_of_a_table_are_references() -> None:
    values = [outer(half=h, table=np.full((1, 1), 10.0 * h)) for h in (1.5, 2.5)]
    out = np.zeros(2)
    for i, whole in enumerate(values):
        call(read_row, Reference(outer()), tables(values), i, out)
        np.testing.assert_array_equal(out, [whole.half, 10.0 * whole.half])


@pytest.mark.parametrize(
    "changes", [{"table": np.zeros((3, 4)).T}, {"lengths": (0, 1)}, {"half": "0.5"}]
)
def test_what_no_table_holds_is_refused(changes: dict[str, Any]) -> None:
    with pytest.raises(TypeError, match="must be a C-ordered array, a number or zeros"):
        Reference(outer(**changes))


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])
def test_a_copied_reference_has_a_table_of_its_own_arrays(duplicate: Any) -> None:
    one = Reference(make_work(2, 3))
    other = duplicate(one)
    assert other.address != one.address
    other.k[:] = 5.0
    out = np.zeros(1)
    for reference, value in ((one, 0.0), (other, 5.0)):
        call(read_k, reference, out)
        assert out[0] == value
