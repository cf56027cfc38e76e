"""Evaluate a linear block at other amplitudes, select its columns, join those of two blocks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

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
    for name, a in amplitudes.items():
        residual = residual - block.columns[:, :, block.functions.index(name)] * a[r]
    if wanted is None:
        return replace(block, residual=residual)
    names = set(wanted.get(block.observation, ()))
    shared = np.any(block.shared != 0.0, axis=(0, 1))
    keep = [i for i, f in enumerate(block.functions) if f in names or shared[i]]
    return replace(
        block,
        residual=residual,
        functions=tuple(block.functions[i] for i in keep),
        columns=block.columns[:, :, keep],
        shared=block.shared[:, :, keep],
        common_columns=None if block.common_columns is None else block.common_columns[keep],
    )


def joined(block: Block, other: Block) -> Block:
    """Return ``block`` with the columns of ``other``, a block of the same rows, appended."""
    return replace(
        block,
        functions=(*block.functions, *other.functions),
        columns=np.concatenate([block.columns, other.columns], axis=2),
        shared=np.concatenate([block.shared, other.shared], axis=2),
        common_columns=np.concatenate([_common_columns(block), _common_columns(other)]),
    )


def _common_columns(block: Block) -> NDArray[np.bool_]:
    """Mask (Q,) of common columns of a block, all false where it has none."""
    return (
        np.zeros(len(block.functions), bool)
        if block.common_columns is None
        else block.common_columns
    )
