"""Numbers and fractions as text, on pages and in figures."""

from __future__ import annotations

import math

NOT_KNOWN = "not known"
NEAR_WHOLE = (  # fractions that would be rounded to 0 % or 100 %
    (-0.001, 0.0, "> -0.1 %"),
    (0.0, 0.001, "< 0.1 %"),
    (0.999, 1.0, "> 99.9 %"),
    (1.0, 1.001, "> 100 %"),
)


def percent(share: float) -> str:
    """Return a fraction in percent as text; only 0 and 1 themselves are 0 % and 100 %."""
    if not math.isfinite(share):
        return NOT_KNOWN
    for low, high, text in NEAR_WHOLE:
        if low < share < high:
            return text
    size = abs(share)
    digits = 0 if 0.0995 < size < 0.995 or size in (0.0, 1.0) or size > 1.005 else 1
    return f"{100 * share + 0.0:.{digits}f} %"


def figure(number: float, digits: int = 3) -> str:
    """Return a number with ``digits`` significant digits as text; ``not known`` if not finite.

    Digits before the decimal point are all shown below 1e6.
    """
    if not math.isfinite(number):
        return NOT_KNOWN
    rounded = abs(float(f"{number:.{digits}g}"))
    whole = 10**digits <= rounded and abs(number) < 1e6
    return f"{number:.0f}" if whole else f"{number:.{digits}g}"
