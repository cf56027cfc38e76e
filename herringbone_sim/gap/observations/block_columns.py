"""Evaluate a linear block at other amplitudes, select its columns, join those of two blocks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.diagnosis.products import Block


def linear_block_at(
    block: Block,
    amplitudes: Mapping[str, Array],
    r: int,
    wanted: Mapping[str, Sequence[str]] | None,
) -> Block:
    """Return the linear block of run r with the residual at given amplitudes and wanted columns.

    Columns on which shared nuisances act are always included.

    Args:
        block: with the residual at amplitudes of zero.
        amplitudes: (runs, R) by function.
        wanted: names of columns, by observation; None: all.
    """
    residual = block.residual
    own, common = block.columns.shape[2], block.common_columns
    for name, a in amplitudes.items():
        q = block.functions.index(name)
        column = block.columns[:, :, q] if common is None or q < own else common[:, q - own, None]
        residual = residual - column * a[r]
    if wanted is None:
        return replace(block, residual=residual)
    names = set(wanted.get(block.observation, ()))
    shared = np.any(block.shared != 0.0, axis=(0, 1))
    keep = [i for i, f in enumerate(block.functions) if f in names or shared[i]]
    return replace(
        block,
        residual=residual,
        functions=tuple(block.functions[i] for i in keep),
        columns=block.columns[:, :, [i for i in keep if i < own]],
        shared=block.shared[:, :, keep],
        common_columns=None if common is None else common[:, [i - own for i in keep if i >= own]],
    )


def with_common_columns(block: Block, other: Block) -> Block:
    """Return ``block`` with common columns of ``other``, a block of the same rows, appended."""
    assert block.common_columns is not None
    assert other.common_columns is not None
    assert not other.columns.size
    return replace(
        block,
        functions=(*block.functions, *other.functions),
        shared=np.concatenate([block.shared, other.shared], axis=2),
        common_columns=np.hstack([block.common_columns, other.common_columns]),
    )
