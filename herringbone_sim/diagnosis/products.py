"""Products of whitened columns, once for all hypotheses.

A block is what one observation says of one run: rows (residuals over time) and columns (what one
unit of each function would add to a row). A hypothesis is a sum of functions on rows, so its
normal equations are sums of entries of the products. Nuisances of a row (drift, hum) and of a run
(gratings off centre) have a prior of known size and are integrated out of the products here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Block:
    """One observation of one run.

    Attributes:
        observation, run: names.
        rows: names of the residuals; those that can't be formed are left out.
        residual, sigma: (n, R) measured minus expected, and its noise, same unit.
        functions: names of the columns.
        columns: (n, R, Q) per unit of each function.
        nuisance: (n, R, S) columns that belong to a row of this run alone.
        nuisance_sd: (R, S) prior of their coefficients.
        shared: (T, R, Q) weights of functions that make the nuisances shared by all rows.
        shared_sd: (T,).
        independent: share of the samples that are independent of each other.
        at: (n,) samples of the run that the residual stands at; None for all.
        alike: (Q,) functions whose column is the same in all rows, whose noise does not change in
            time and whose nuisances are the same: their products are taken once. None: none.
    """

    observation: str
    run: str
    rows: tuple[str, ...]
    residual: Array
    sigma: Array
    functions: tuple[str, ...]
    columns: Array
    nuisance: Array
    nuisance_sd: Array
    shared: Array
    shared_sd: Array
    independent: float = 1.0
    at: NDArray[np.int64] | None = None
    alike: NDArray[np.bool_] | None = None


@dataclass(frozen=True)
class Products:
    """Products of one block, row nuisances integrated out.

    Attributes:
        observation, run, rows, functions: as in the block.
        G: (R, Q, Q) of whitened columns.
        c: (R, Q) with the whitened residual.
        energy: (R,) of the whitened residual.
        count: (R,) independent values.
        cross: (T, R, Q) of shared nuisances with columns, over the root of their normal matrix.
        cross_y: (T,) the same with the residual.
    """

    observation: str
    run: str
    rows: tuple[str, ...]
    functions: tuple[str, ...]
    G: Array
    c: Array
    energy: Array
    count: Array
    cross: Array
    cross_y: Array

    @property
    def cleared_energy(self) -> Array:
        """(R,) of the residual less what nuisances shared by all rows take, in proportion."""
        whole = float(self.energy.sum())
        shared = float(self.cross_y @ self.cross_y)
        return self.energy * (1.0 - shared / whole) if whole > 0.0 else self.energy


def products(block: Block) -> Products:
    """Products of a block."""
    n, R, Q = block.columns.shape
    G, c = np.empty((R, Q, Q)), np.empty((R, Q))
    energy = np.empty(R)
    for row, (whole, with_N, own) in enumerate(_grams(block)):
        if len(own):
            normal = own + np.diag(block.nuisance_sd[row] ** -2.0)
            whole = whole - with_N.T @ np.linalg.solve(normal, with_N)
        G[row], c[row], energy[row] = whole[:Q, :Q], whole[:Q, Q], whole[Q, Q]
    cross, cross_y = _shared(block, G, c)
    return Products(
        block.observation,
        block.run,
        block.rows,
        block.functions,
        G,
        c,
        energy,
        np.full(R, n * block.independent),
        cross,
        cross_y,
    )


Gram = tuple[Array, Array, Array]


def _grams(block: Block) -> Iterator[Gram]:
    """Row by row, whitened: columns and residual with themselves (Q+1, Q+1), nuisances with them
    (S, Q+1), nuisances with themselves (S, S).
    """
    if block.alike is not None:
        yield from _grams_alike(block, block.alike)
        return
    root = np.sqrt(block.independent)
    for row in range(block.columns.shape[1]):
        w = root / block.sigma[:, row]
        X = np.column_stack([block.columns[:, row] * w[:, None], block.residual[:, row] * w])
        N = block.nuisance[:, row] * w[:, None]
        yield X.T @ X, N.T @ X, N.T @ N


def _grams_alike(block: Block, alike: NDArray[np.bool_]) -> Iterator[Gram]:
    """The same where most columns are the same in all rows."""
    Q, N = len(alike), block.nuisance[:, 0]
    C = np.ascontiguousarray(block.columns[:, 0, alike])
    of_C, N_C, N_N = C.T @ C, N.T @ C, N.T @ N
    first, then = np.flatnonzero(alike), np.append(np.flatnonzero(~alike), Q)
    for row in range(block.columns.shape[1]):
        D = np.column_stack([block.columns[:, row, ~alike], block.residual[:, row]])
        whole, with_N = np.empty((Q + 1, Q + 1)), np.empty((len(N_N), Q + 1))
        whole[np.ix_(first, first)] = of_C
        whole[np.ix_(first, then)] = C.T @ D
        whole[np.ix_(then, first)] = whole[np.ix_(first, then)].T
        whole[np.ix_(then, then)] = D.T @ D
        with_N[:, first], with_N[:, then] = N_C, N.T @ D
        square = block.independent / block.sigma[0, row] ** 2
        yield square * whole, square * with_N, square * N_N


def _shared(block: Block, G: Array, c: Array) -> tuple[Array, Array]:
    """Cross products of the shared nuisances, whitened by their own normal matrix."""
    T = len(block.shared_sd)
    if not T:
        return np.zeros((0, *c.shape)), np.zeros(0)
    cross = np.einsum("trq,rqs->trs", block.shared, G)
    normal = np.einsum("trs,urs->tu", cross, block.shared) + np.diag(block.shared_sd**-2.0)
    cross_y = np.einsum("trq,rq->t", block.shared, c)
    root = np.linalg.cholesky(normal)
    whitened = np.linalg.solve(root, cross.reshape(T, -1)).reshape(cross.shape)
    return whitened, np.linalg.solve(root, cross_y)


def cleared(block: Block) -> Array:
    """(n, R) whitened residual less what its nuisances most likely make of it."""
    root = np.sqrt(block.independent)
    w = (root / block.sigma)[:, :, None]
    shared = np.einsum("nrq,trq->nrt", block.columns, block.shared)
    every = np.concatenate([block.residual[:, :, None], shared], axis=2) * w
    free = np.stack([clearing(block, row)(every[:, row]) for row in range(every.shape[1])], axis=1)
    normal = np.einsum("nrt,nru->tu", every[:, :, 1:], free)
    mean = np.linalg.solve(normal[:, 1:] + np.diag(block.shared_sd**-2.0), normal[:, 0])
    return np.asarray((free[:, :, 0] - free[:, :, 1:] @ mean) / root)


def clearing(block: Block, row: int) -> Callable[[Array], Array]:
    """Function that subtracts the ridge fit of a row's nuisances from whitened values (n, ...)."""
    N = block.nuisance[:, row] * (np.sqrt(block.independent) / block.sigma[:, row])[:, None]
    normal = cho_factor(N.T @ N + np.diag(block.nuisance_sd[row] ** -2.0)) if N.size else None

    def clear(values: Array) -> Array:
        return values if normal is None else values - N @ cho_solve(normal, N.T @ values)

    return clear


def moved(p: Products, a: Array) -> Products:
    """Products of a linear observation about amplitudes a (R, Q) of its functions."""
    along = np.einsum("rqs,rs->rq", p.G, a)
    return replace(
        p,
        c=p.c - along,
        energy=p.energy - 2.0 * np.sum(p.c * a, axis=1) + np.sum(along * a, axis=1),
        cross_y=p.cross_y - np.einsum("trq,rq->t", p.cross, a),
    )


@dataclass(frozen=True)
class Part:
    """Where a coefficient acts in one observation: k rows, k functions, (runs, k) weights."""

    rows: tuple[int, ...]
    functions: tuple[str, ...]
    weights: Array

    @cached_property
    def entries(self) -> list[tuple[int, str, Array]]:
        """Row, function and weights (runs,) one by one."""
        return list(zip(self.rows, self.functions, self.weights.T, strict=True))


@dataclass(frozen=True)
class Coefficient:
    """One number of a hypothesis.

    Attributes:
        name: as in reports.
        sd: prior standard deviation, in the unit of the coefficient.
        bound: largest magnitude.
        parts: by observation.
        center: of the prior; 1 for an exchange, which is there or not.
        departs: of how many coefficients, those before the first departure from it, it lets the
            curve depart; its prior goes with their size. 0 for an effect's own and tolerances.
        sized: whether its prior goes with the size of the effect; a stiffness in series does not.
    """

    name: str
    sd: float
    bound: float
    parts: dict[str, Part]
    center: float = 0.0
    departs: int = 0
    sized: bool = True


class Campaign:
    """Products of all runs, and the normal equations of any set of coefficients.

    Args:
        runs: products of every run, by observation; all runs have the same observations, rows
            and functions, rows that a run lacks are zero.
        base: coefficients of every hypothesis: the tolerances.
    """

    def __init__(self, runs: Sequence[dict[str, Products]], base: Sequence[Coefficient]) -> None:
        self.runs = tuple(runs)
        self.base = tuple(base)
        self.observations = tuple(runs[0])
        self._at = {o: {name: i for i, name in enumerate(p.functions)} for o, p in runs[0].items()}
        self._G = {o: np.stack([r[o].G for r in runs]) for o in self.observations}
        self._c = {o: np.stack([r[o].c for r in runs]) for o in self.observations}
        self._x = {o: np.stack([r[o].cross for r in runs]) for o in self.observations}
        self._y = {o: np.stack([r[o].cross_y for r in runs]) for o in self.observations}
        self.energy = np.array(
            [sum(float(p.cleared_energy.sum()) for p in r.values()) for r in runs]
        )
        self.count = np.array([sum(float(p.count.sum()) for p in r.values()) for r in runs])
        self._of_base()

    def _of_base(self) -> None:
        """Products of the base with all functions: (runs, base, R, Q), and with the nuisances."""
        runs, p = len(self.runs), len(self.base)
        self._base_G, self._base_x = {}, {}
        self.base_A, self.base_b = np.zeros((runs, p, p)), np.zeros((runs, p))
        for o in self.observations:
            G, c = self._G[o], self._c[o]
            products = np.zeros((runs, p, *c.shape[1:]))
            nuisances = np.zeros((runs, p, self._x[o].shape[1]))
            for i, one in enumerate(self.base):
                for row, f, w in self._entries(one, o):
                    products[:, i, row] += w[:, None] * G[:, row, f]
                    nuisances[:, i] += w[:, None] * self._x[o][:, :, row, f]
            self._base_G[o], self._base_x[o] = products, nuisances
            self._sum_up(o, self.base, products, nuisances, self.base_A, self.base_b)
            self.base_A -= nuisances @ nuisances.transpose(0, 2, 1)

    def _sum_up(
        self,
        o: str,
        coefficients: Sequence[Coefficient],
        products: Array,
        nuisances: Array,
        A: Array,
        b: Array,
    ) -> None:
        """Add products (runs, p, R, Q) with coefficients to A (runs, p, q) and b (runs, q)."""
        for i, one in enumerate(coefficients):
            for row, f, w in self._entries(one, o):
                A[:, :, i] += products[:, :, row, f] * w[:, None]
                b[:, i] += self._c[o][:, row, f] * w
                b[:, i] -= np.einsum("rt,rt->r", self._x[o][:, :, row, f], self._y[o]) * w

    def normal(self, coefficients: Sequence[Coefficient]) -> tuple[Array, Array]:
        """A (runs, p, p) and b (runs, p) of the base and these coefficients."""
        n, p, runs = len(self.base), len(self.base) + len(coefficients), len(self.runs)
        A, b = np.zeros((runs, p, p)), np.zeros((runs, p))
        A[:, :n, :n], b[:, :n] = self.base_A, self.base_b
        for o in self.observations:
            used: dict[int, dict[int, int]] = {}
            for one in coefficients:
                for row, f, _ in self._entries(one, o):
                    at = used.setdefault(row, {})
                    at.setdefault(f, len(at))
            if used:
                self._add(o, coefficients, used, A, b)
        A[:, n:, :n] = A[:, :n, n:].transpose(0, 2, 1)
        return A, b

    def _add(
        self,
        o: str,
        coefficients: Sequence[Coefficient],
        used: Mapping[int, Mapping[int, int]],
        A: Array,
        b: Array,
    ) -> None:
        """Add the entries used, by row and function, to A (runs, p, p) and b (runs, p)."""
        n, runs, q = len(self.base), len(self.runs), len(coefficients)
        X = np.zeros((runs, q, self._x[o].shape[1]))
        for row, places in used.items():
            index = np.array(list(places))
            W = np.zeros((runs, q, len(index)))
            for i, one in enumerate(coefficients):
                for at_row, f, w in self._entries(one, o):
                    if at_row == row:
                        W[:, i, places[f]] += w
            T = W.transpose(0, 2, 1)
            A[:, n:, n:] += W @ self._G[o][:, row][:, index[:, None], index[None, :]] @ T
            A[:, :n, n:] += self._base_G[o][:, :, row, index] @ T
            b[:, n:] += (W @ self._c[o][:, row, index][:, :, None])[:, :, 0]
            X += W @ self._x[o][:, :, row, index].transpose(0, 2, 1)
        A[:, n:, n:] -= X @ X.transpose(0, 2, 1)
        A[:, :n, n:] -= self._base_x[o] @ X.transpose(0, 2, 1)
        b[:, n:] -= (X @ self._y[o][:, :, None])[:, :, 0]

    def _entries(self, one: Coefficient, o: str) -> list[tuple[int, int, Array]]:
        """Row, function and weights (runs,) of a coefficient in an observation."""
        part = one.parts.get(o)
        if part is None:
            return []
        return [(row, self._at[o][f], w) for row, f, w in part.entries]
