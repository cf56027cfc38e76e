"""Convert units as people write them to the SI unit of a channel, by pint."""

from __future__ import annotations

import functools
import importlib
import math
from collections.abc import Callable
from tokenize import TokenError
from typing import Any

from herringbone_sim.core.layout import PREFIX_UNITS, UNITS, Layout
from herringbone_sim.errors import RecordingError, shown

# Channels of sensors on a rig that ``core.layout`` does not have.
_OF_RIGS = {"a": "m/s^2", "angle": "rad", "T_in": "N m", "T_out": "N m"}


def package(name: str, pip_name: str, reads: str) -> Any:
    """Import an optional module; RecordingError names the package to install if it is missing.

    Args:
        name: name of the module.
        pip_name: name of the package.
        reads: what needs the package, such as ``TDMS files``.
    """
    try:
        return importlib.import_module(name)
    except ImportError:
        raise RecordingError(
            f"{reads} need the package {pip_name}, which is not there: pip install {pip_name}"
        ) from None


def channel_names(layout: Layout) -> tuple[str, ...]:
    """Return the names of all channels that a spec may define; the time is not among them."""
    angles = (f"angle_{body}" for body in layout.bodies)
    others = (*angles, *layout.channels_of("a"), *layout.channels_of("pin"))
    return (*layout.channels[1:], *others, "T_in", "T_out")


def si_unit(channel: str) -> str:
    """Return the SI unit of a channel in ``channel_names``; ``-`` for a dimensionless channel."""
    known = UNITS | PREFIX_UNITS | _OF_RIGS
    return known[channel] if channel in known else known[channel.split("_")[0]]


@functools.cache
def _registry() -> Any:
    return package("pint", "pint", "units").UnitRegistry()


def factor(unit: str, si: str) -> float:
    """Return the size of ``unit`` in ``si``, as 1000 for kN in N; ValueError if impossible."""
    rule = f"a unit of {si} that pint knows"
    return _converted(rule, unit, si, lambda r: r.Quantity(1.0, _bare(unit)))


def quantity(value: object, si: str) -> float:
    """Convert a number in ``si`` or a text such as ``220 N m`` to a float in ``si``.

    Raises:
        ValueError: anything else, or another dimension.
    """
    rule = number_of(si)
    if isinstance(value, str) and "," in value:  # pint would drop it: 12,5 N were 125 N
        raise ValueError(f"{rule}, got {shown(value)}: write a decimal point, no comma")
    if isinstance(value, str):
        return _converted(rule, value, si, lambda r: r.Quantity(1.0) * r.parse_expression(value))
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{rule}, got {shown(value)}: mend it")
    return float(value)


def number_of(si: str) -> str:
    """Return what a quantity in ``si`` must be, for error messages."""
    if si == "-":
        return "a number without a unit"
    return f"a number in {si}, or a text with a unit that pint knows"


def _bare(unit: str) -> str:
    return "" if unit == "-" else unit


def _converted(rule: str, text: str, si: str, read: Callable[[Any], Any]) -> float:
    """Convert to ``si`` what ``read`` makes with pint's registry; ValueError on any failure."""
    registry, errors = _registry(), package("pint.errors", "pint", "units")
    try:
        value = read(registry)
        from_zero = not registry.Quantity(0.0, value.units).to_base_units().magnitude
        size = float(value.to(_bare(si)).magnitude)
    except errors.DimensionalityError as error:
        raise ValueError(f"{rule}, got {shown(text)}: {error}; write the unit it has") from None
    except errors.OffsetUnitCalculusError:
        from_zero = False
    except (AssertionError, ArithmeticError, AttributeError, TypeError, ValueError, TokenError):
        # pint raises AttributeError for an unknown unit, the others for malformed texts.
        raise ValueError(f"{rule}, got {shown(text)}: mend it") from None
    if not from_zero:
        raise ValueError(
            f"{rule}, got {shown(text)}, a scale that does not begin at zero: write a difference, "
            "as delta_degC"
        )
    return size
