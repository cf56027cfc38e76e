"""Lists and ranges of seeds as text."""

from __future__ import annotations

from herringbone_sim.errors import ParameterError


def parse_seeds(text: str) -> tuple[int, ...]:
    """Seeds from ``2000:2200`` (end excluded), ``1,5,9``, or both; each once, sorted.

    Raises:
        ParameterError: another form, a negative seed, or none.
    """
    found: set[int] = set()
    try:
        for part in text.split(","):
            first, colon, end = part.strip().partition(":")
            found |= set(range(int(first), int(end))) if colon else {int(first)}
    except ValueError:
        raise ParameterError(
            f"seeds are numbers and ranges, got {text!r}: write them like 2000:2200 or 1,5,9"
        ) from None
    if not found or min(found) < 0:
        raise ParameterError(f"seeds must be one or more, none below 0, got {text!r}")
    return tuple(sorted(found))
