"""Chi2 of a residual that measured quantities predict: cross-validated nonparametric regression.

Model: a sum of factors (constant, spring force, damper force) times smooth functions of one to
three measured quantities, as random Fourier features (Rahimi and Recht, NIPS 2007). Each row is
regressed on every other block of mesh cycles of all runs and scored on the remaining blocks, and
the reverse. Where causes act through the motion, the features are responses to forces of many
shapes instead. Noise can't be predicted; anything that repeats can, whatever its law. What repeats
with the turn of a member may have finer structure than few features follow, so waves of every
order of each angle are tried too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from herringbone_sim.arrays import Array, Flags, Indices
from herringbone_sim.diagnosis.parallel import parallel_map

# Chosen, not fitted:
N_FEATURES = 200
MAX_INPUTS = 3  # measured quantities that one feature depends on
MAX_HARMONIC = 4  # of an angle; of the fastest angle for waves of every order
RIDGES = (1e1, 1e3)  # penalties of the regressions on all features, for features of unit RMS
SPARSE_SIZES = (10, 40)  # features of the sparse regressions
ROUNDS = 8  # in each of which waves are added, as many as the least of ``SPARSE_SIZES``
PATIENCE = 2  # rounds without a smaller error after which no more are tried
MAX_SAMPLES = 30 * N_FEATURES  # of a row


@dataclass(frozen=True)
class RegressionInputs:
    """Inputs of the regression for one observation of one run: n samples, R rows.

    Attributes:
        values: (n, R, D) measured quantities, of any unit.
        angles: (n, A) [rad]; functions depend on integer multiples of them. The first is the
            fastest, that of the mesh.
        factors: (n, R, M) factors of the functions, in units of the residual's noise.
        responses: (n, R, P) whitened linear responses to forces of many shapes, used instead of
            the above where causes act through the motion; None: not used.
    """

    values: Array
    angles: Array
    factors: Array
    responses: Array | None = None

    def at(self, samples: Indices) -> RegressionInputs:
        """Copy restricted to the given indices of samples."""
        responses = None if self.responses is None else self.responses[samples]
        return RegressionInputs(
            self.values[samples], self.angles[samples], self.factors[samples], responses
        )


@dataclass(frozen=True)
class Predictable:
    """Part of a residual that the regression predicts out of sample.

    Attributes:
        chi2: (runs, R) chi2 of the rows.
        left: (runs, R) chi2 after subtracting the prediction; may exceed ``chi2``.
        count: (runs, R) number of values used; 0 where a row is not recorded.
        weight: number of independent values that each value used stands for, (runs, 1) or of all.
    """

    chi2: Array
    left: Array
    count: Array
    weight: Array | float = 1.0

    @property
    def predicted(self) -> float:
        """Predicted chi2 of all rows and all independent values, at least 0."""
        return max(0.0, float((self.weight * (self.chi2 - self.left)).sum()))

    def with_noise_scaled(self, noise: Array) -> Predictable:
        """Copy for a noise larger by the factor ``noise`` (runs, R)."""
        return Predictable(self.chi2 / noise**2, self.left / noise**2, self.count, self.weight)


def predicted_chi2(remainder: Mapping[str, Predictable]) -> float:
    """Predictable chi2, summed over the observations."""
    return sum(p.predicted for p in remainder.values())


def _random_features(D: int, A: int, M: int) -> Callable[[Array, Array, Array], Array]:
    """Draw random Fourier features: cosines of weighted sums of values and angles, times a factor.

    Args:
        D, A, M: number of values, of angles and of factors; together the random seed.

    Returns:
        Function of (n, D) values, (n, A) angles [rad] and (n, M) factors of a row, which gives
        the (n, N_FEATURES) features.
    """
    rng = np.random.default_rng([D, A, M])
    weights = np.zeros((D + A, N_FEATURES))
    for f in range(N_FEATURES):
        some = rng.choice(D + A, min(D + A, int(rng.integers(1, MAX_INPUTS + 1))), replace=False)
        for i in some:
            if i < D:
                weights[i, f] = rng.normal() * 2.0 ** rng.uniform(-2.0, 1.0)
            else:
                sign = rng.choice([-1.0, 1.0])
                weights[i, f] = sign * rng.integers(1, MAX_HARMONIC + 1)
    phase = rng.uniform(0.0, 2.0 * np.pi, N_FEATURES)

    def features(values: Array, angles: Array, factors: Array) -> Array:
        inputs = np.concatenate([values, angles % (2.0 * np.pi)], axis=1).astype(np.float32)
        made = np.cos(inputs @ weights.astype(np.float32) + phase.astype(np.float32))
        return np.asarray(made * factors[:, np.arange(N_FEATURES) % M])

    return features


def predict_residuals(
    residuals: Sequence[Array],
    inputs: Sequence[RegressionInputs],
    blocks: Sequence[Indices],
    independent_share: Array | float = 1.0,
) -> Predictable:
    """Predict whitened residuals by cross-validated regression.

    Args:
        residuals: (n, R) for each run, whitened; a row of zeros is not recorded.
        inputs: for each run.
        blocks: (n,) number of the block of cycles of each sample, for each run. Even and odd
            blocks predict each other.
        independent_share: number of independent values over the number of samples, (runs,) or of
            all.
    """
    first = inputs[0]
    features = _random_features(
        first.values.shape[2], first.angles.shape[1], first.factors.shape[2]
    )
    runs, R = len(residuals), residuals[0].shape[1]
    thin = max(1, sum(len(r) for r in residuals) // MAX_SAMPLES)
    if thin > 1:
        used = [_thinned(len(r), thin) for r in residuals]
        residuals = [r[i] for r, i in zip(residuals, used, strict=True)]
        blocks = [b[i] for b, i in zip(blocks, used, strict=True)]
        inputs = [s.at(i) for s, i in zip(inputs, used, strict=True)]
    chi2, left = np.zeros((runs, R)), np.zeros((runs, R))
    of_run = np.repeat(np.arange(runs), [len(r) for r in residuals])
    fold = np.concatenate(blocks) % 2
    angles = np.concatenate([s.angles for s in inputs])
    halves = []
    if first.responses is None and angles.size:
        waves = _waves_of_turns(angles)
        every = [
            [np.flatnonzero((of_run == r) & (fold == h)) for h in (0, 1)] for r in range(runs)
        ]
        halves = [[(at, waves[:, at]) for at in of_halves] for of_halves in every]

    def predict_row(row: int) -> None:
        y = np.concatenate([r[:, row] for r in residuals])
        if not np.any(y):
            return
        responses = [s.responses[:, row] for s in inputs if s.responses is not None]
        if responses:
            P = _unit_rms(np.concatenate(responses))
        else:
            values = _unit_rms(np.concatenate([s.values[:, row] for s in inputs]))
            factors = _unit_rms(np.concatenate([s.factors[:, row] for s in inputs]))
            P = features(values, angles, factors)
        off = _cross_predict(P, y, fold, of_run)
        if halves:
            by_turns = _cross_predict_by_turns(halves, factors, y)
            off = min(off, by_turns, key=lambda error: float(error @ error))
        chi2[:, row] = np.bincount(of_run, y**2, runs)
        left[:, row] = np.bincount(of_run, off**2, runs) * (chi2[:, row] > 0.0)

    parallel_map(predict_row, range(R))
    count = np.bincount(of_run, minlength=runs)[:, None] * (chi2 > 0.0)
    weight = thin * np.broadcast_to(independent_share, runs)[:, None]
    return Predictable(chi2, left, count.astype(float), weight)


def _waves_of_turns(angles: Array) -> Array:
    """Cosines and sines (W, n) of the multiples of angles (n, A).

    They go up to the rate of the harmonic ``MAX_HARMONIC`` of the first angle.
    """
    spans = np.ptp(angles, axis=0)
    multiples = [
        np.outer(np.arange(1, round(MAX_HARMONIC * spans[0] / span) + 1), angle)
        for angle, span in zip(angles.T, spans, strict=True)
    ]
    turned = np.concatenate(multiples) % (2.0 * np.pi)
    waves: Array = np.concatenate([np.cos(turned), np.sin(turned)]).astype(np.float32)
    return waves


def _cross_predict_by_turns(
    halves: Sequence[Sequence[tuple[Indices, Array]]], factors: Array, y: Array
) -> Array:
    """(n,) error of y predicted across the halves of each run by waves times factors.

    Each round adds the ``SPARSE_SIZES[0]`` products that correlate most with what the others leave
    (orthogonal matching pursuit, Pati et al. 1993), in all halves. The error of the round with the
    least squares is returned.

    Args:
        halves: the two of each run: samples, and waves of them as from ``_waves_of_turns``.
        factors: (n, M) those of the features.
        y: (n,) as in ``_cross_predict``.
    """
    factors = factors.T.astype(np.float32)
    ways = [way for pair in halves for way in (pair, pair[::-1])]
    left = [y[others] for _, (others, _) in ways]
    used = [np.zeros(0, dtype=int)] * len(ways)
    least, best, since = np.inf, y, 0
    for _ in range(ROUNDS):
        off = y.copy()
        for i, ((at, w), (others, v)) in enumerate(ways):
            f = factors[:, others]
            size = np.linalg.norm(f, axis=1)[:, None].clip(1e-12)  # mean square of a wave: 1/2
            fit = (f * left[i].astype(f.dtype)) @ v.T / size
            used[i] = np.union1d(used[i], _largest(np.abs(fit.ravel()), SPARSE_SIZES[0]))
            factor, wave = np.unravel_index(used[i], fit.shape)
            P = v[wave] * f[factor]
            weights = np.linalg.solve(P @ P.T + np.eye(len(P)), P @ y[others])
            left[i] = y[others] - weights @ P
            off[at] -= weights @ (w[wave] * factors[np.ix_(factor, at)])
        squares, since = float(off @ off), since + 1
        if squares < least:
            least, best, since = squares, off, 0
        if since == PATIENCE:
            break
    return best


def _thinned(n: int, thin: int) -> Indices:
    """Indices of one out of every ``thin`` of n samples, evenly spread over the mesh phase.

    Its position among the ``thin`` samples follows multiples of the golden ratio.
    """
    i = np.arange(-(-n // thin))
    shift = np.floor(thin * (i * 0.5 * (5.0**0.5 - 1.0) % 1.0)).astype(int)
    return np.asarray(np.minimum(thin * i + shift, n - 1))


def _unit_rms(values: Array) -> Array:
    """Return the columns of ``values`` scaled to unit RMS; columns of zeros stay zero."""
    size = np.sqrt(np.mean(values**2, axis=0))
    return np.asarray(values / np.where(size > 0.0, size, 1.0))


def _cross_predict(P: Array, y: Array, fold: Indices, run: Indices) -> Array:
    """(n,) error of y predicted across the halves, by the best of a few regressions, or none.

    Args:
        P: (n, F) features.
        fold, run: (n,) half (0 or 1) and run of each sample.
    """

    def part(inside: Flags) -> tuple[Indices, Array, Array, Array]:
        """Samples ``inside`` (n,), their features P, P'P and P'y."""
        at = np.flatnonzero(inside)
        p = P[at]
        return at, p, p.T @ p, p.T @ y[at]

    # Run by run, too: dependence on quantities constant within a run need not be smooth.
    alone = [[[part((run == r) & (fold == h))] for h in (0, 1)] for r in np.unique(run)]
    all_runs = [[[pair[h][0] for pair in alone] for h in (0, 1)]]
    # Pairs of halves, number of features used (those most correlated with y), penalty.
    tried = [(all_runs, P.shape[1], ridge) for ridge in RIDGES]
    tried += [(all_runs, size, 1.0) for size in SPARSE_SIZES]
    tried += [(alone, SPARSE_SIZES[0], 1.0)]
    best = y
    for pairs, size, ridge in tried:
        off = y.copy()
        for pair in pairs:
            for parts, others in (pair, pair[::-1]):
                A = np.sum([gram for _, _, gram, _ in others], axis=0)
                b = np.sum([product for _, _, _, product in others], axis=0)
                use = _largest(b**2 / np.maximum(np.diag(A), 1e-12), size)
                weights = np.linalg.solve(A[np.ix_(use, use)] + ridge * np.eye(len(use)), b[use])
                for at, own, _, _ in parts:
                    off[at] = y[at] - own[:, use] @ weights
        best = off if float(off @ off) < float(best @ best) else best
    return best


def _largest(values: Array, size: int) -> Indices:
    """Indices of the ``size`` largest of some values (n,), in any order; of all, if n is less."""
    if size >= len(values):
        return np.arange(len(values))
    return np.argpartition(-values, size)[:size]
