"""Block tridiagonal systems of windows, against dense ones of NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from herringbone_sim.gap.observations.windows.elimination import BlockTridiagonal

W, N = 5, 4


@pytest.fixture
def blocks() -> tuple[np.ndarray, np.ndarray]:
    """Blocks (W, N, N) on the diagonal and (W - 1, N, N) below it, positive definite together."""
    rng = np.random.default_rng(0)
    root = rng.standard_normal((W, N, N))
    own = root @ root.transpose(0, 2, 1) + 10.0 * np.eye(N)
    return own, rng.standard_normal((W - 1, N, N))


def test_solutions_are_those_of_the_dense_matrix(blocks: tuple[np.ndarray, np.ndarray]) -> None:
    own, below = blocks
    dense = np.zeros((W * N, W * N))
    for w in range(W):
        at = slice(w * N, w * N + N)
        dense[at, at] = own[w]
        if w:
            before = slice(w * N - N, w * N)
            dense[at, before], dense[before, at] = below[w - 1], below[w - 1].T
    right = np.random.default_rng(1).standard_normal((W, N, 3))
    kept = right.copy()
    found = BlockTridiagonal(own, below).solve(right)
    assert found.reshape(W * N, 3) == pytest.approx(np.linalg.solve(dense, kept.reshape(-1, 3)))
    assert np.array_equal(right, kept)


def test_an_indefinite_matrix_is_refused(blocks: tuple[np.ndarray, np.ndarray]) -> None:
    own, below = blocks
    own[2] = -np.eye(N)
    with pytest.raises(np.linalg.LinAlgError):
        BlockTridiagonal(own, below)


def test_states_that_diverged_give_solutions_that_are_not_numbers(
    blocks: tuple[np.ndarray, np.ndarray],
) -> None:
    """A diagnosis passes over an explanation under which windows diverge; it does not end."""
    own, below = blocks
    own[3, 0, 0] = np.inf
    assert np.isnan(BlockTridiagonal(own, below).solve(np.ones((W, N, 1)))).all()
