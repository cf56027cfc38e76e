"""Texts for effects and for lists of names in sentences."""

from __future__ import annotations

from collections.abc import Sequence

from herringbone_sim.effects.effect import Active


def effect_names(actives: Sequence[Active]) -> str:
    """Join the ids of effects that act together as ``a with b``; ``none`` without effects."""
    return " with ".join(a.effect.id for a in actives) or "none"


def in_words(names: Sequence[str], last: str = " and ") -> str:
    """Join names as ``a, b and c``; ``last``: text before the last name."""
    return last.join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
