"""The damper as a machine of the diagnosis engine: two observations of every run.

Force law: measured F minus (K g(x) + C v). Impulse: impulse of the drive minus that of measured F,
minus the gain of momentum; needs no force law, so of the effects only an error of F appears there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import ndtr

from herringbone_sim.arrays import Array, Indices
from herringbone_sim.diagnosis.flexible import RegressionInputs
from herringbone_sim.diagnosis.machine import Amplitudes, Hypothesis, Machine
from herringbone_sim.diagnosis.products import Block
from herringbone_sim.examples.damper import effects
from herringbone_sim.examples.damper.effects import (
    FUNCTIONS,
    IMPULSE,
    LAW,
    LINEAR,
    NONLINEAR,
    TRAVELS,
)
from herringbone_sim.examples.damper.simulate import OFFSET, PLAY, SIGMA, STEP, C, K, M, Run

SIMPSON_WEIGHTS = STEP / 3.0 * np.array([1.0, 4.0, 2.0, 4.0, 2.0, 4.0, 2.0, 4.0, 1.0])  # [s]


def smoothed_play(x: Array, play: float) -> tuple[Array, Array, Array]:
    """Expected displacement beyond the play, its derivative by the play, probability of contact.

    All (n,); expectations over the noise of the measured x (n,) [m], ``play`` in m.
    """
    sigma = SIGMA["x"]
    beyond, odds = [], []
    for over in (x - play, -x - play):
        odds.append(ndtr(over / sigma))
        bell = sigma * np.exp(-0.5 * (over / sigma) ** 2) / np.sqrt(2.0 * np.pi)
        beyond.append(over * odds[-1] + bell)
    return beyond[0] - beyond[1], odds[1] - odds[0], odds[0] + odds[1]


def presliding(v: Array, force: float, longer: float, travel: float) -> dict[str, Array]:
    """Dahl friction with the travel ``travel`` exp(longer / force), and its derivatives.

    ``longer`` acts linearly beyond a factor e of the travel, and where ``force`` is zero.

    Args:
        v: (n,) velocity [m/s].
        force: friction force [N].
        longer: logarithm of the factor on the travel, times the force [N].
        travel: travel [m] at ``longer`` 0.

    Returns:
        Arrays (n,): ``force``, the friction [N]; ``slip`` and ``longer``, its derivatives by
        ``force`` and ``longer``.
    """
    share = float(np.clip(longer / force, -1.0, 1.0)) if force else 0.0
    at = travel * np.exp(share)
    h = effects.dahl_state(v, at)
    bend = (effects.dahl_state(v, 1.01 * at) - effects.dahl_state(v, at / 1.01)) / (
        2.0 * np.log(1.01)
    )
    slip = h - share * bend
    return {"force": force * slip + longer * bend, "slip": slip, "longer": bend}


class Damper(Machine):
    """Recorded runs of a damper, as the engine needs them: see ``diagnosis.machine.Machine``."""

    functions: Mapping[str, tuple[str, ...]] = FUNCTIONS

    def __init__(self, recorded: Sequence[Run]) -> None:
        self.recorded, self.runs = tuple(recorded), len(recorded)
        self.base = effects.tolerances(self.runs)
        self.rows = dict.fromkeys(FUNCTIONS, 1)
        self._linear_columns = [{name: f(r) for name, f in LINEAR.items()} for r in self.recorded]

    def hypotheses(self) -> list[Hypothesis]:
        return effects.hypotheses(self.runs)

    def regression_inputs(self, observation: str, r: int, block: Block) -> RegressionInputs:
        run = self.recorded[r]
        values = np.stack([run.x, run.v, np.full(len(run.x), run.P / 50.0)], axis=1)[:, None, :]
        at = slice(None) if block.sample_index is None else block.sample_index
        factors = np.ones((len(block.residual), 1, 1))
        return RegressionInputs(values[at], run.phase[at, None], factors)

    def cycles(self, observation: str, r: int) -> Array:
        phase = self.recorded[r].phase
        return np.asarray((phase - phase[0]) / (2.0 * np.pi))

    def linear_observations(self, amplitudes: Amplitudes) -> tuple[str, ...]:
        """Both observations, but not the force law with amplitudes of play or presliding."""
        law = amplitudes.get(LAW, {})
        bent = any(np.any(law[f]) for f in NONLINEAR if f in law)
        return (IMPULSE,) if bent else (LAW, IMPULSE)

    def blocks(
        self,
        amplitudes: Amplitudes,
        wanted: Mapping[str, Sequence[str]] | None,
        observations: Sequence[str],
    ) -> list[dict[str, Block]]:
        block_of = {LAW: self._law, IMPULSE: self._impulse}
        by_run = []
        for r in range(self.runs):
            of_run = {}
            for o in observations:
                a = {f: float(values[r, 0]) for f, values in amplitudes.get(o, {}).items()}
                names = FUNCTIONS[o] if wanted is None else tuple(wanted.get(o, ()))
                of_run[o] = block_of[o](r, a, names)
            by_run.append(of_run)
        return by_run

    def _law(self, r: int, a: Mapping[str, float], names: tuple[str, ...]) -> Block:
        run, fixed = self.recorded[r], self._linear_columns[r]
        k = K * (1.0 + a.get("k", 0.0))
        out, slope, contact = smoothed_play(run.x, PLAY + a.get("play", 0.0))
        columns = {**fixed, "k": K * out, "play": k * slope}
        force = k * out + C * run.v + sum(a[f] * fixed[f] for f in a if f in fixed)
        for t in TRAVELS:
            both = f"slip {t}", f"longer {t}"
            if {*both} & {*names, *a}:
                own = presliding(run.v, a.get(both[0], 0.0), a.get(both[1], 0.0), t)
                force = force + own["force"]
                columns |= {both[0]: own["slip"], both[1]: own["longer"]}
        sigma = np.sqrt(SIGMA["F"] ** 2 + (K * SIGMA["x"]) ** 2 * contact + (C * SIGMA["v"]) ** 2)
        return _block(LAW, run.F - force, sigma, {f: columns[f] for f in names}, 1.0)

    def _impulse(self, r: int, a: Mapping[str, float], names: tuple[str, ...]) -> Block:
        run, n = self.recorded[r], len(SIMPSON_WEIGHTS)
        at = np.arange(0, len(run.F) - n + 1, n)
        F, P = (
            np.lib.stride_tricks.sliding_window_view(q, n)[at] @ SIMPSON_WEIGHTS
            for q in (run.F, run.P * np.cos(run.phase))
        )
        gained = M * (run.v[at + n - 1] - run.v[at])
        columns = {"mass": gained, "gain": -F}
        residual = P - F - gained - sum(a[f] * columns[f] for f in a)
        noise = 2.0 * (M * SIGMA["v"]) ** 2 + SIGMA["F"] ** 2 * float(
            SIMPSON_WEIGHTS @ SIMPSON_WEIGHTS
        )
        sigma = np.full(len(at), np.sqrt(noise))
        columns = {f: columns[f] for f in names}
        return _block(IMPULSE, residual, sigma, columns, float(SIMPSON_WEIGHTS.sum()), at + n // 2)


def _block(
    observation: str,
    residual: Array,
    sigma: Array,
    columns: Mapping[str, Array],
    offset: float,
    at: Indices | None = None,
) -> Block:
    """Block of one row; the offset of F, times ``offset``, is a nuisance of its residual."""
    n, q = len(residual), len(columns)
    return Block(
        observation,
        residual[:, None],
        sigma[:, None],
        tuple(columns),
        np.stack(list(columns.values()), axis=1)[:, None, :] if q else np.zeros((n, 1, 0)),
        np.full((n, 1, 1), offset),
        np.array([[OFFSET]]),
        np.zeros((0, 1, q)),
        np.zeros(0),
        sample_index=at,
    )
