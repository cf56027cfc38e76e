"""Texts for the parts of a gap report: effects, places, numbers; ``not known`` for absent ones.

Reports are read from JSON, perhaps of another version, so every look-up allows for what is absent.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from herringbone_sim.effects.registry import effects

Part = Mapping[str, Any]  # a report, or an object in it
NOT_KNOWN = "not known"
MAX_ITEMS = 12  # of a list as text

PHRASES = {
    "none": "no gap beyond tolerance and noise",
    "unknown": "a cause that is not in the catalogue",
    "mean_stiffness": "mesh stiffness off by a factor",
    "stiffness_harmonic": "mesh stiffness varies over the mesh cycle in another way",
    "stagger": "left and right halves mesh out of step",
    "planet_phase": "one planet meshes out of phase",
    "tooth_crack": "cracked tooth (softer, in proportion to load)",
    "tooth_spall": "spalled tooth (a bump or pit, whatever the load)",
    "runout": "run-out, once a revolution of one gear",
    "pin_position": "a planet's pin is off its place",
    "backlash_offset": "more or less backlash than nominal",
    "thermal_backlash": "backlash changes with temperature at another rate",
    "thermal_stiffness": "mesh stiffness falls with temperature",
    "tooth_friction": "sliding friction between the teeth",
    "contact_nonlinearity": "mesh stiffness grows with load (Hertz)",
    "damping_law": "mesh damping follows another law",
    "profile_error": "tooth profile error (transmission error of mesh order)",
    "ring_flexibility": "the ring gives way on a spring of its own",
    "bearing_clearance": "clearance in a planet's bearing",
    "torque_ripple": "the input torque is not constant",
    "sensor_gain": "a sensor's gain is wrong",
    "sensor_bias": "a sensor reads with an offset",
    "sensor_delay": "a sensor reads late",
    "clock_drift": "the recorder's clock runs fast or slow",
    "channel_swap": "two channels are swapped",
}
METRICS = {
    "force_law": "residual of the force law in the meshes",
    "torque_balance": "residual of the bodies' torque balance",
    "trajectory": "residual of short windows of the motion",
    "consistency": "contradiction of the channels with each other",
}
UNITS = {"force_law": "N", "torque_balance": "m/s²", "consistency": "σ", "trajectory": "σ"}
ACTIONS = {  # by kind of verdict, what closes the gap
    "none": "recalibrating within the tolerance",
    "unknown": "what can be explained",
    "ambiguous": "adding the likeliest of them",
    "pair": "adding both",
}
PLACES = {  # of effects that sit at no mesh
    "torque_ripple": "input shaft",
    "ring_flexibility": "ring",
    "clock_drift": "clock of the recorder",
    "sensor_gain": "sensors",
    "sensor_bias": "sensors",
    "sensor_delay": "sensors",
    "channel_swap": "recorded channels",
}
ROLES = {"fit": "fit", "held_out": "held out"}
DISPLAY_UNITS = {  # factor and name
    "m": (1e6, "µm"),
    "m/K": (1e6, "µm/K"),
    "s": (1e6, "µs"),
    "N/m": (1e-6, "N/µm"),
    "1/K": (1e6, "10⁻⁶/K"),
    "-": (1.0, ""),
}


def mapping(value: object) -> Part:
    """The value if it is a mapping, else an empty one."""
    return value if isinstance(value, Mapping) else {}


def sequence(value: object) -> Sequence[Any]:
    """The value if it is a list, else an empty one."""
    return value if isinstance(value, Sequence) and not isinstance(value, str) else ()


def known(value: object) -> float | None:
    """The value as a float if it is a finite number, else None."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value) if math.isfinite(value) else None


def word(value: object, absent: str = NOT_KNOWN) -> str:
    """The value as text if it is a name or an integer, else ``absent``."""
    return str(value) if isinstance(value, str | int) and value != "" else absent


def effect_words(effect: object) -> str:
    """Phrase for the id of an effect; for an effect of the user its own text."""
    name = word(effect)
    if name in PHRASES:
        return PHRASES[name]
    own = effects().get(name)
    return own.text if own else name.replace("_", " ")


def capital(text: str) -> str:
    """First letter in upper case, the rest as it is."""
    return text[:1].upper() + text[1:]


def percent(value: object) -> str:
    """A share in percent; one that is neither 0 nor 1 is not rounded to 0 or 100 %."""
    share = known(value)
    if share is None:
        return NOT_KNOWN
    if 0 < share < 0.001:
        return "< 0.1 %"
    if 0.999 < share < 1:
        return "> 99.9 %"
    size = abs(share)
    digits = 0 if 0.0995 < size < 0.995 or size in (0.0, 1.0) or size >= 1 else 1
    return f"{100 * share:.{digits}f} %"


def figure(value: object, digits: int = 3) -> str:
    """A number with some significant digits."""
    number = known(value)
    if number is None:
        return NOT_KNOWN
    return f"{number:.0f}" if 10**digits <= abs(number) < 1e6 else f"{number:.{digits}g}"


def locus_words(locus: object) -> str:
    """Text of a locus, as ``sun mesh of planet 2, left side``."""
    place = mapping(locus)
    if not place:
        return "place " + NOT_KNOWN
    kind, planet, side = (word(place.get(key), "all") for key in ("mesh", "planet", "side"))
    if (kind, planet, side) == ("all", "all", "all"):
        words = "all meshes"
    else:
        words = f"{_meshes(kind, planet)}, {_sides(side)}"
    more = [f"{k} {plain(v)}" for k, v in place.items() if k not in ("mesh", "planet", "side")]
    return ", ".join([words, *more])


def _meshes(kind: str, planet: str) -> str:
    name = {"sp": "sun mesh", "rp": "ring mesh"}.get(kind)
    if planet == "all":
        return f"all {name}es" if name else "all meshes"
    return f"{name} of planet {planet}" if name else f"sun and ring mesh of planet {planet}"


def _sides(side: str) -> str:
    return {"L": "left side", "R": "right side"}.get(side, "both sides")


def place_words(cause: Part) -> str:
    """Text of the place of a cause: its locus and member, or a place without a mesh."""
    effect, locus = word(cause.get("effect")), cause.get("locus")
    meshes = locus_words(locus)
    everywhere = meshes == "all meshes"
    if effect in PLACES:
        place = PLACES[effect]
        return place if everywhere or not mapping(locus) else f"{place}, {meshes}"
    part = member(cause)
    if part:
        return part if everywhere else f"{meshes}, on the {part}"
    return meshes


def member(cause: Part) -> str:
    """Member of a cause, such as ``sun`` or ``ring``; empty if none is given."""
    given = mapping(cause.get("parameters")).get("member", cause.get("member"))
    return word(mapping(given).get("value", given), "")


def plain(value: object) -> str:
    """Any value of a report as text."""
    if isinstance(value, str):
        return value
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {plain(one)}" for key, one in value.items())
    if isinstance(value, Sequence):
        rest = len(value) - MAX_ITEMS
        more = [f"and {rest} more"] if rest > 0 else []
        return ", ".join([*(plain(one) for one in value[:MAX_ITEMS]), *more])
    if isinstance(value, bool):
        return "yes" if value else "no"
    return figure(value, 4)


def parameter_words(name: str, parameter: object) -> str:
    """Text of a parameter with its 90 % interval, as ``height 12 µm (11.2 … 12.7)``."""
    given = mapping(parameter)
    label = name.replace("_", " ")
    value = given.get("value") if given else parameter
    if isinstance(value, str):
        return f"{label} {value}"
    number = known(value)
    if number is None:
        return f"{label} {plain(value) if sequence(value) else NOT_KNOWN}"
    unit = word(given.get("unit"), "-")
    factor, shown_unit = DISPLAY_UNITS.get(unit, (1.0, unit))
    ends = [known(end) for end in sequence(given.get("ci90"))]
    low, high = ends if len(ends) == 2 else (None, None)
    digits = _digits(number, low, high)
    text = f"{label} {figure(factor * number, digits)}" + (f" {shown_unit}" if shown_unit else "")
    if isinstance(value, int) and not isinstance(value, bool):
        return text  # an option, without an interval
    if low is None or high is None:
        return f"{text} (interval {NOT_KNOWN})"
    return f"{text} ({figure(factor * low, digits)} … {figure(factor * high, digits)})"


def _digits(value: float, low: float | None, high: float | None) -> int:
    """Significant digits at which the width of an interval has two; 4 to 9."""
    if low is None or high is None or high <= low or value == 0:
        return 4
    return min(max(math.ceil(math.log10(abs(value) / (high - low))) + 2, 4), 9)


def closure_words(closure: object, verdict: str) -> str:
    """How much of the gap on held-out runs closes, with what closes it.

    Args:
        closure: share of the gap.
        verdict: its kind, see ``verdict.kind``.
    """
    value, action = known(closure), ACTIONS.get(verdict, "adding it")
    if value is None and verdict == "none":
        return "there is no gap to close"
    if value is None:
        return "how much of the gap closes on held-out runs is not known"
    if value < 0:
        return f"{action} makes the gap on held-out runs larger, not smaller"
    return f"{action} closes {percent(min(value, 1.0))} of the gap on held-out runs"


def residual_words(value: object, gap: Part) -> str:
    """A residual with the unit of the gap that it belongs to."""
    unit = word(gap.get("unit"), UNITS.get(word(gap.get("metric")), ""))
    return figure(value) + (f" {unit}" if unit and known(value) is not None else "")
