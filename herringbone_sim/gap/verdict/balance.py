"""What the torque balance says, of the bodies and of the force sensors, once a law is fitted."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.effects.effect import Active, Effect
from herringbone_sim.gap.attribution.bodies import (
    FEWEST_WHOLE,
    BodyFit,
    balance_of,
    balances_known,
    body_fits,
    free_pins,
    peak,
)
from herringbone_sim.gap.attribution.fit import Fit
from herringbone_sim.gap.attribution.hypothesis import Case, expected, name_of

Array = NDArray[np.float64]
Say = Callable[[str], None]

SETTLED = 0.5  # of the excess of the balance left, by forces put right or an effect on the bodies
CLEAR = 0.4  # excess from which such an effect is taken off before force sensors are judged


@dataclass(frozen=True)
class BalanceEvidence:
    """What the torque balance says, see ``Evidence``; nothing where it is not known."""

    fits: tuple[BodyFit, ...] = ()
    excess: float = 0.0
    by_force: dict[str, float] = field(default_factory=dict)
    peak: float = 0.0
    settled: float = 0.0
    pinned: float = 0.0

    def left(self, one: Fit) -> float:
        """What a fit leaves of runs left out, in its law and in the balance."""
        return one.left_out + unsettled(one, self.excess, self.by_force)


def unsettled(one: Fit, excess: float, by_force: Mapping[str, float]) -> float:
    """What a hypothesis on the forces leaves in the balance, above the one that leaves least.

    A force sensor is right only where it settles most of the balance: what acts on the bodies is
    in it as well.

    Args:
        excess: of the balance with the forces as measured.
        by_force: the same by name of a hypothesis, with the forces that it puts right.
    """
    least = min((excess, *by_force.values()))
    least = least if least < SETTLED * excess else excess
    return max(by_force.get(name_of(one.actives), excess) - least, 0.0)


def balance_evidence(
    cases: Sequence[Case], options: Sequence[Fit], effects: Sequence[Effect], say: Say
) -> BalanceEvidence:
    """The balance with the forces as the best hypothesis on the law has them.

    Force sensors are judged with the best effect on the bodies taken off: it may hide them.
    """
    whole = tuple(c for c in cases if balances_known((c,)))
    if len(whole) < FEWEST_WHOLE:
        return BalanceEvidence()
    say("torque balance")
    machines = [f for f in options if all(a.effect.level != "sensor" for a in f.actives)]
    machine = _machine(whole, machines)
    fits, highest = _bodies(whole, machine, effects)
    sensors = [f for f in options if any(a.effect.level == "sensor" for a in f.actives)]
    body = _clear(fits)
    excess = _balance_excess(whole, machine, body)
    by_force = {name_of(one.actives): _balance_excess(whole, one, body) for one in sensors}
    found = BalanceEvidence(fits, excess, by_force, highest)
    best = min((machine, *sensors), key=found.left)
    if best is not machine:
        fits, highest = _bodies(whole, best, effects)
    body = _clear(fits)
    settled = _settled(whole, best, body, best.actives)
    pinned = _settled(whole, best, body, free_pins(whole[0], best.actives))
    return replace(found, fits=fits, peak=highest, settled=settled, pinned=pinned)


def _machine(cases: Sequence[Case], options: Sequence[Fit]) -> Fit:
    """The best fit of one effect, or that of two where the balance bears it."""
    ranked = sorted(options, key=lambda f: f.left_out)
    one = next(f for f in ranked if len(f.actives) < 2)
    two = ranked[0]
    if two is one:
        return one
    return min((one, two), key=lambda f: f.left_out + _balance_excess(cases, f, ()))


def _clear(fits: Sequence[BodyFit]) -> tuple[Active, ...]:
    """The best effect on the bodies, if it explains most of what the balance shows."""
    nominal, *rest = fits
    excess = nominal.left_out - 1.0
    clear = rest and excess > CLEAR and rest[0].left_out - 1.0 < SETTLED * excess
    return rest[0].actives if clear else ()


def _bodies(
    cases: Sequence[Case], best: Fit, effects: Sequence[Effect]
) -> tuple[tuple[BodyFit, ...], float]:
    """Fits of the balance, the nominal one first, and its largest residual."""
    balances = [balance_of(c, best.factors, _true_forces(c, best), best.actives) for c in cases]
    nominal, *rest = body_fits(cases, best.factors, balances, effects)
    ranked = sorted(rest, key=lambda one: one.left_out)
    return (nominal, *ranked), peak(balances, nominal)


def _balance_excess(cases: Sequence[Case], one: Fit, body: tuple[Active, ...]) -> float:
    """How far the balance is above its floor, with the forces as a hypothesis has them."""
    balances = [
        balance_of(c, one.factors, _true_forces(c, one), (*one.actives, *body)) for c in cases
    ]
    return max(body_fits(cases, one.factors, balances, ())[0].left_out - 1.0, 0.0)


def _settled(
    cases: Sequence[Case], best: Fit, body: tuple[Active, ...], some: Sequence[Active]
) -> float:
    """Excess of the balance that some of the effects of a fit take off it."""
    if not some:
        return 0.0
    others = tuple(a for a in best.actives if a not in some)
    without = _balance_excess(cases, replace(best, actives=others), body)
    return max(without - _balance_excess(cases, best, body), 0.0)


def _true_forces(c: Case, one: Fit) -> Array:
    """Measured forces (n, n_mesh) less what the force sensors add by a hypothesis [N]."""
    machine = tuple(a for a in one.actives if a.effect.level != "sensor")
    if machine == one.actives:
        return c.run.F.values
    error = expected(c, one.factors, one.actives) - expected(c, one.factors, machine)
    true: Array = c.run.F.values - error
    return true
