"""Texts for the parts of a gap report: effects, places, parameters; ``not known`` for NaN."""

from __future__ import annotations

import math
from collections.abc import Sequence

from herringbone_sim.effects.effect import Locus
from herringbone_sim.effects.registry import effects
from herringbone_sim.gap.report import Cause, Estimate
from herringbone_sim.views.numbers import NOT_KNOWN, figure, percent

MAX_ITEMS = 12  # that a text lists; the others are counted

PHRASES = {
    "none": "no gap beyond tolerance and noise",
    "unknown": "a cause that is not in the catalogue",
    "mean_stiffness": "mesh stiffness off by a factor",
    "stiffness_harmonic": "mesh stiffness varies over the mesh cycle in another way",
    "stagger": "left and right halves mesh out of step",
    "planet_phase": "one planet meshes out of phase",
    "tooth_crack": "cracked tooth (softer, in proportion to load)",
    "tooth_spall": "spalled tooth (a bump or pit, whatever the load)",
    "runout": "run-out by the turn of one gear",
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
    "m/s^2": (1.0, "m/s²"),
    "sigma": (1.0, "σ"),
    "-": (1.0, ""),
}


def effect_words(name: str) -> str:
    """Return the phrase for an effect id; for a user-defined effect the text of its definition."""
    if name in PHRASES:
        return PHRASES[name]
    own = effects().get(name)
    return own.text if own else name.replace("_", " ")


def capital(text: str) -> str:
    """Return a text with its first letter in upper case."""
    return text[:1].upper() + text[1:]


def locus_words(locus: Locus) -> str:
    """Return a locus as text, such as ``sun mesh of planet 2, left side``."""
    if locus == Locus():
        return "all meshes"
    return f"{_meshes(locus.mesh, locus.planet)}, {_sides(locus.side)}"


def _meshes(kind: str, planet: str) -> str:
    name = {"sp": "sun mesh", "rp": "ring mesh"}.get(kind)
    if planet == "all":
        return f"all {name}es" if name else "all meshes"
    return f"{name} of planet {planet}" if name else f"sun and ring mesh of planet {planet}"


def _sides(side: str) -> str:
    return {"L": "left side", "R": "right side"}.get(side, "both sides")


def place_words(cause: Cause) -> str:
    """Return where a cause acts, such as ``sun mesh of planet 2, left side, on the planet``.

    The text has the meshes of the locus and the member that the cause names; for an effect of
    ``PLACES``, the text given there and the meshes. If the locus is all meshes, they are mentioned
    only where there is neither a member nor an entry in ``PLACES``.
    """
    meshes, everywhere = locus_words(cause.locus), cause.locus == Locus()
    if cause.effect in PLACES:
        place = PLACES[cause.effect]
        return place if everywhere else f"{place}, {meshes}"
    part = member(cause)
    if part:
        return part if everywhere else f"{meshes}, on the {part}"
    return meshes


def member(cause: Cause) -> str:
    """Return the gear member that a cause names, such as ``sun``; empty if it names none."""
    given = cause.parameters.get("member")
    return "" if given is None else str(given.value)


def listed(texts: Sequence[str]) -> str:
    """Join the first ``MAX_ITEMS`` texts by commas, and the number of the others."""
    rest = len(texts) - MAX_ITEMS
    return ", ".join([*texts[:MAX_ITEMS], *([f"and {rest} more"] if rest > 0 else [])])


def parameter_words(name: str, parameter: Estimate) -> str:
    """Return a parameter with its 90 % interval as text: ``height 12 µm (11.2 … 12.7)``."""
    label, value, ends = name.replace("_", " "), parameter.value, parameter.ci90
    if isinstance(value, tuple):
        return f"{label} {listed(value)}"
    if isinstance(value, str) or (ends is None and isinstance(value, int)):
        return f"{label} {value}"
    factor, unit = DISPLAY_UNITS.get(parameter.unit, (1.0, parameter.unit))
    low, high = ends or (math.nan, math.nan)
    digits = _digits(value, low, high)
    text = f"{label} {figure(factor * value, digits)}" + (f" {unit}" if unit else "")
    if not math.isfinite(high - low):
        return f"{text} (interval {NOT_KNOWN})"
    return f"{text} ({figure(factor * low, digits)} … {figure(factor * high, digits)})"


def _digits(value: float, low: float, high: float) -> int:
    """Return the significant digits, 4 to 9, that give the width of an interval two digits."""
    if not 0.0 < high - low < math.inf or not 0.0 < abs(value) < math.inf:
        return 4
    return min(max(math.ceil(math.log10(abs(value) / (high - low))) + 2, 4), 9)


def closure_words(closure: float, verdict: str) -> str:
    """Return a clause that tells which change closes how much of the gap on held-out runs.

    Args:
        closure: closed fraction of the gap above noise; NaN if unknown.
        verdict: kind of the verdict, see ``verdict.kind``.
    """
    action = ACTIONS.get(verdict, "adding it")
    if not math.isfinite(closure):
        if verdict == "none":
            return "there is no gap to close"
        return "how much of the gap closes on held-out runs is not known"
    if closure < 0:
        return f"{action} makes the gap on held-out runs larger, not smaller"
    return f"{action} closes {percent(min(closure, 1.0))} of the gap on held-out runs"


def residual_words(value: float, unit: str) -> str:
    """Return a residual with its unit as text; ``not known`` if it is not finite."""
    return figure(value) + (f" {unit}" if math.isfinite(value) else "")
