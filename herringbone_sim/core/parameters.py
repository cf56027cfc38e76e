"""Every symbol of the model once: name, default, unit, range and meaning, checked when built.

One name everywhere: the field here is YAML key, ROS parameter and recorded metadata. Defaults are
the nominal rig (``config/rig.yaml``); ``config/paper.yaml`` is the set of the paper. Lists over
meshes have length 1 (all equal) or 4 N, in the order of ``layout``: sun-planet left 1..N, right
1..N, then ring-planet the same (N = 1 in the reduced model). Lists over planet halves: left 1..N,
right 1..N.

Over 300 lines: half of it is the table of the parameters.
"""

from __future__ import annotations

import math
import numbers
import warnings
from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, fields
from typing import Any

from herringbone_sim.core.layout import Layout
from herringbone_sim.errors import ParameterError, shown

Value = bool | int | float | str | tuple[float, ...]
INFINITY = math.inf


class ParameterWarning(UserWarning):
    """The parameters can be simulated, but no such gear can be built or assembled."""


@dataclass(frozen=True)
class Meaning:
    """Description of a parameter: unit, text, range or choices, whether it may change in a run."""

    unit: str
    text: str
    low: float = -INFINITY
    high: float = INFINITY
    choices: tuple[str, ...] = ()
    live: bool = False


def _p(default: Any, unit: str, text: str, *bounds: float, **more: Any) -> Any:
    """Dataclass field of a parameter with its description; ``bounds`` are low and high."""
    low, high = bounds if bounds else (-INFINITY, INFINITY)
    return field(default=default, metadata={"meaning": Meaning(unit, text, low, high, **more)})


@dataclass(frozen=True)
class Parameters:
    """Parameters of a herringbone planetary gear and of its integration; see ``meaning`` for each.

    A gear that can't be assembled gives a ``ParameterWarning``.

    Raises:
        ParameterError: a value out of its range, or values that contradict each other.
    """

    model: str = _p(
        "reduced",
        "-",
        "reduced: identical planets, Eq. (18); full: every planet and side, Eqs. (12)-(16)",
        choices=("reduced", "full"),
    )
    n_planets: int = _p(3, "-", "number of planets N", 1, 12)
    z_s: int = _p(27, "-", "teeth of the sun, Table 1", 5, 1000)
    z_p: int = _p(25, "-", "teeth of a planet, Table 1", 5, 1000)
    z_r: int = _p(77, "-", "teeth of the ring, Table 1", 5, 3000)
    m_n: float = _p(4e-3, "m", "normal module, Table 1; m_t = m_n / cos beta", 1e-5, 1.0)
    alpha_n: float = _p(20.0, "deg", "normal pressure angle, Table 1", 1.0, 45.0)
    beta: float = _p(16.0, "deg", "helix angle, Table 1", 0.0, 45.0)
    planet_angle: tuple[float, ...] = _p(
        (), "deg", "angle of each planet on the carrier; empty: equally spaced"
    )
    phasing: str = _p(
        "in_phase",
        "-",
        "mesh phase of the planets: in_phase (the paper), or geometric (z_s, z_r times the angle)",
        choices=("in_phase", "geometric"),
    )
    I_s: float = _p(0.008, "kg m^2", "inertia of one sun half, Table 1", 1e-12, 1e6)
    I_p: float = _p(0.007, "kg m^2", "inertia of one planet half, Table 1", 1e-12, 1e6)
    I_c: float = _p(0.22, "kg m^2", "inertia of the carrier, Table 1", 1e-12, 1e6)
    I_r: float = _p(0.125, "kg m^2", "inertia of one ring half; in Eq. (11) only", 1e-12, 1e6)
    m_p: float = _p(4.485, "kg", "mass of a planet in I_ce = I_c + N m_p r_bc^2", 0.0, 1e6)
    I_s_factor: tuple[float, ...] = _p((1.0,), "-", "factor on I_s: 1 value or left, right")
    I_p_factor: tuple[float, ...] = _p((1.0,), "-", "factor on I_p: 1 value or 2 N")
    k_m_sp: float = _p(1.5e9, "N/m", "mean stiffness of a sun-planet mesh, Table 2", 1.0, 1e15)
    k_m_rp: float = _p(1.2e9, "N/m", "mean stiffness of a ring-planet mesh, Table 2", 1.0, 1e15)
    k_amp: tuple[float, ...] = _p(
        (0.25,), "-", "harmonics of k(t), orders 1, 2, ..., as shares of the mean, Eqs. (7), (8)"
    )
    k_factor: tuple[float, ...] = _p((1.0,), "-", "factor on k of each mesh")
    phi_a: tuple[float, ...] = _p((0.0,), "rad", "phase of k(t) of each mesh, Eqs. (7), (8)")
    e_m: float = _p(0.35, "b_c", "amplitude of the mesh error, Sec. 3", 0.0, 1e4)
    e_amp: tuple[float, ...] = _p(
        (1.0,), "-", "harmonics of e(t), orders 1, 2, ..., as shares of e_m, Eqs. (9), (10)"
    )
    e_mean: float = _p(0.0, "b_c", "mean of the mesh error, Eq. (9)", -1e4, 1e4)
    e_factor: tuple[float, ...] = _p((1.0,), "-", "factor on the harmonics of e of each mesh")
    e_offset: tuple[float, ...] = _p((0.0,), "m", "constant displacement of each mesh")
    phi_b: tuple[float, ...] = _p((0.0,), "rad", "phase of e(t) of each mesh, Eqs. (9), (10)")
    mesh_phase: tuple[float, ...] = _p(
        (0.0,),
        "rad",
        "shift of k(t) and e(t) together, of each mesh: order j shifts by j times it",
    )
    xi: float = _p(0.07, "-", "mesh damping ratio, Eq. (11)", 0.0, 2.0, live=True)
    c_factor: tuple[float, ...] = _p((1.0,), "-", "factor on the damping c of each mesh")
    b: float = _p(0.6, "b_c", "initial half-backlash, Eq. (3), Sec. 3", 0.0, 1e4)
    b_offset: tuple[float, ...] = _p((0.0,), "m", "more half-backlash of each mesh")
    b_c: float = _p(1e-4, "m", "displacement scale, Eq. (17)", 1e-9, 1.0)
    gamma: float = _p(1.18e-5, "1/K", "linear expansion, Eq. (2)", 0.0, 1e-2)
    alpha_w: float = _p(20.0, "deg", "working pressure angle alpha' in Eq. (2)", 0.0, 60.0)
    thermal_rp: str = _p(
        "own",
        "-",
        "backlash that ring meshes lose: their own by Eq. (2), or that of the sun meshes",
        choices=("own", "sun"),
    )
    projection: str = _p(
        "mesh_and_torque",
        "-",
        "where cos beta stands in Eq. (18): mesh_and_torque as printed, or torque alone",
        choices=("mesh_and_torque", "torque"),
    )
    T_1: float = _p(220.0, "N m", "input torque on the sun, Sec. 3", -1e7, 1e7, live=True)
    T_2: float = _p(0.0, "N m", "output torque; 0: balances T_1, 2 T_1 r_bc / r_bs", -1e8, 1e8)
    delta_T: float = _p(50.0, "K", "temperature rise, Eq. (2)", -200.0, 1000.0, live=True)
    Omega: float = _p(1.0, "-", "mesh frequency over omega_n, Eq. (17)", 1e-3, 100.0, live=True)
    omega_n: float = _p(0.0, "rad/s", "natural frequency; 0: that of Eq. (17)", 0.0, 1e9)
    K: float = _p(0.0, "-", "amplitude of the control, Eqs. (19)-(22)", -10.0, 10.0, live=True)
    control_phase: float = _p(0.0, "rad", "phase of the control", -100.0, 100.0, live=True)
    control_order: float = _p(1.0, "-", "control frequency over mesh frequency", 0.0, 100.0)
    control_on: tuple[float, ...] = _p(
        (1.0, 1.0, 1.0, 1.0),
        "-",
        "shares of K on the equations of sp_L, sp_R, rp_L, rp_R: the vector K of Eq. (22)",
    )
    initial_x: tuple[float, ...] = _p(
        (0.0,), "b_c", "initial displacement: 1 value or sp_L, sp_R, rp_L, rp_R"
    )
    initial_v: tuple[float, ...] = _p(
        (0.0,), "b_c omega_n", "initial velocity: 1 value or sp_L, sp_R, rp_L, rp_R"
    )
    initial_noise: float = _p(
        0.0, "b_c", "RMS of a random addition to the initial displacements", 0.0, 1e3
    )
    seed: int = _p(0, "-", "seed of the random addition", 0, 2**31 - 1)
    method: str = _p(
        "taylor",
        "-",
        "taylor: series with located switching; rk4: the paper's, steps over the kinks",
        choices=("taylor", "rk4"),
    )
    order: int = _p(12, "-", "order of the Taylor series", 4, 30)
    steps_per_cycle: int = _p(
        16,
        "-",
        "least steps a mesh cycle; taylor takes more at Omega below 1 and for higher harmonics",
        4,
        100000,
    )
    samples_per_cycle: int = _p(16, "-", "samples recorded a mesh cycle", 1, 10000, live=True)

    def __post_init__(self) -> None:
        _check_all(self, names())
        _warn(obstacles(self), stacklevel=4)

    @property
    def layout(self) -> Layout:
        """Names and sizes of the model."""
        if self.model == "reduced":
            return Layout(n_classes=1, numbered=False)
        return Layout(n_classes=self.n_planets, numbered=True)

    @property
    def steps(self) -> int:
        """Integration steps per mesh cycle: the least sufficient multiple of
        ``samples_per_cycle``.

        The error of the Taylor step is bounded if it is short compared with the natural period (at
        small Omega a mesh cycle contains many) and with the highest harmonic of the excitation.
        """
        least: float = self.steps_per_cycle
        if self.method == "taylor":
            orders = (len(self.k_amp), len(self.e_amp), self.control_order)
            least *= max(1.0 / self.Omega, *orders, 1.0)
        return self.samples_per_cycle * math.ceil(least / self.samples_per_cycle - 1e-9)

    def changed(self, values: Mapping[str, Any]) -> Parameters:
        """Return a copy with changed values, converted by ``coerce``; ParameterError if wrong.

        Warnings that this set has given already are not repeated.
        """
        known: dict[str, Any] = {name: coerce(name, value) for name, value in values.items()}
        changed = copy(self)
        vars(changed).update(known)
        _check_all(changed, known)
        said = obstacles(self)
        _warn([rule for rule in obstacles(changed) if rule not in said], stacklevel=3)
        return changed


def names() -> tuple[str, ...]:
    """Names of all parameters, in the order of the class."""
    return tuple(item.name for item in fields(Parameters))


def live_names() -> tuple[str, ...]:
    """Names of the parameters that may change during a run."""
    return tuple(name for name in names() if meaning(name).live)


def meaning(name: str) -> Meaning:
    """Return the description of a parameter; ParameterError for an unknown name."""
    item = Parameters.__dataclass_fields__.get(name)
    if item is None:
        raise ParameterError(f"no parameter {shown(name)}; there are {', '.join(names())}")
    description: Meaning = item.metadata["meaning"]
    return description


def coerce(name: str, value: Any) -> Value:
    """Return a value converted to the type of the parameter ``name``.

    An integer is accepted for a float, a number for a list. The range is not checked.

    Raises:
        ParameterError: the value can't be read as that type.
    """
    meaning(name)
    default = Parameters.__dataclass_fields__[name].default
    try:
        if isinstance(default, tuple):
            many = (value,) if isinstance(value, (numbers.Real, str)) else tuple(value)
            if any(isinstance(v, (bool, str)) for v in many):
                raise TypeError
            return tuple(float(v) for v in many)
        if isinstance(default, str):
            return str(value)
        if isinstance(value, (bool, str)):
            raise TypeError
        if isinstance(default, int):
            if float(value) != int(value):
                raise TypeError
            return int(value)
        return float(value)
    except (TypeError, ValueError, OverflowError):
        kind = "a list of numbers" if isinstance(default, tuple) else type(default).__name__
        raise ParameterError(
            f"{name} must be {kind}, got {shown(value)}: give it as in config/rig.yaml"
        ) from None


def from_mapping(values: Mapping[str, Any]) -> Parameters:
    """Build parameters from values by name, as in YAML or recorded metadata, see ``coerce``.

    Raises:
        ParameterError: an unknown key, or a wrong type, range or combination of values.
    """
    known: dict[str, Any] = {name: coerce(name, value) for name, value in values.items()}
    return Parameters(**known)


def to_mapping(parameters: Parameters) -> dict[str, Any]:
    """Return all values by name, tuples as lists, for YAML, JSON and ROS."""
    values = {name: getattr(parameters, name) for name in names()}
    return {k: list(v) if isinstance(v, tuple) else v for k, v in values.items()}


def spread(values: Sequence[float], n: int) -> list[float]:
    """Return n values: a list of length 1 repeated n times, any other list as it is."""
    return list(values) * n if len(values) == 1 else list(values)


def _check_all(p: Parameters, changed: Iterable[str]) -> None:
    """Raise ParameterError unless the changed values are valid, each and together with others."""
    for name in changed:
        _check(name, getattr(p, name), meaning(name))
    _check_lists(p)
    _check_gear(p)


def _check(name: str, value: Any, about: Meaning) -> None:
    """Raise ParameterError for a wrong type, a value that is not finite, or one out of range."""
    if about.choices:
        check_value(name, value, about)
        return
    default = Parameters.__dataclass_fields__[name].default
    number: Any = numbers.Integral if isinstance(default, int) else numbers.Real
    if isinstance(value, tuple) is not isinstance(default, tuple):
        raise ParameterError(f"{name} must be {type(default).__name__}, got {shown(value)}")
    for entry in value if isinstance(value, tuple) else (value,):
        if isinstance(entry, bool) or not isinstance(entry, number):
            raise ParameterError(f"{name} must be {number.__name__.lower()}, got {shown(entry)}")
        check_value(name, entry, about)


def check_value(name: str, value: Any, about: Meaning) -> None:
    """Raise ParameterError for a value not among the choices, not finite, or out of range."""
    if about.choices:
        if value not in about.choices:
            raise ParameterError(
                f"{name} must be one of {', '.join(about.choices)}, got {shown(value)}"
            )
    elif not math.isfinite(value):
        raise ParameterError(f"{name} [{about.unit}] must be finite, got {shown(value)}")
    elif not about.low <= value <= about.high:
        raise ParameterError(
            f"{name} [{about.unit}] must lie in {about.low:g} .. {about.high:g}, "
            f"got {shown(value)}: choose a value inside"
        )


def lengths(p: Parameters) -> dict[str, tuple[int, int]]:
    """Return the two allowed lengths of each list over meshes, bodies or planets, by name."""
    n = p.layout.n_mesh
    allowed = {"I_s_factor": (1, 2), "I_p_factor": (1, n // 2), "planet_angle": (0, p.n_planets)}
    allowed |= dict.fromkeys(("control_on", "initial_x", "initial_v"), (1, 4))
    of_meshes = ("k_factor", "phi_a", "e_factor", "e_offset", "phi_b", "mesh_phase")
    return allowed | dict.fromkeys((*of_meshes, "c_factor", "b_offset"), (1, n))


def _check_lists(p: Parameters) -> None:
    """Raise ParameterError for a list of a wrong length or with a factor of a wrong sign."""
    for name, allowed in lengths(p).items():
        if len(getattr(p, name)) not in allowed:
            raise ParameterError(
                f"{name} must have {allowed[0]} or {allowed[1]} values in the {p.model} model, "
                f"got {len(getattr(p, name))}"
            )
    if min(p.c_factor) < 0.0:
        raise ParameterError(f"c_factor must not be negative, got {min(p.c_factor)}")
    for name in ("I_s_factor", "I_p_factor", "k_factor"):
        if min(getattr(p, name)) <= 0.0:
            raise ParameterError(f"{name} must be positive, got {min(getattr(p, name))}")


def _least_gap_deg(p: Parameters) -> float:
    """Return the smallest angle between neighbouring planets [deg]."""
    if not p.planet_angle:
        return 360.0 / p.n_planets
    angles = sorted(angle % 360.0 for angle in p.planet_angle)
    following = [*angles[1:], angles[0] + 360.0]
    return min(b - a for a, b in zip(angles, following, strict=True))


def _check_gear(p: Parameters) -> None:
    """Raise ParameterError for a stiffness that turns negative, or a ring not above the sun."""
    if sum(abs(share) for share in p.k_amp) >= 1.0:
        raise ParameterError(
            f"k_amp must sum to less than 1 or stiffness turns negative, got {shown(p.k_amp)}"
        )
    if p.z_r <= p.z_s:
        raise ParameterError(
            f"the ring must be larger than the sun: z_r > z_s, got {p.z_r} and "
            f"{p.z_s}: the ratio 1 + z_r / z_s needs a planet between them"
        )


def obstacles(p: Parameters) -> list[str]:
    """Return a text for each rule of assembly that the parameters violate; none is an error."""
    rules = []
    if p.z_r != p.z_s + 2 * p.z_p:
        rules.append(
            f"concentric axes without profile shift need z_r = z_s + 2 z_p = "
            f"{p.z_s + 2 * p.z_p}, got {p.z_r}"
        )
    if not p.planet_angle and (p.z_s + p.z_r) % p.n_planets:
        rules.append(
            f"{p.n_planets} equally spaced planets need (z_s + z_r) / N to be whole, got "
            f"{p.z_s + p.z_r} / {p.n_planets} = {(p.z_s + p.z_r) / p.n_planets:.3f}"
        )
    for angle in p.planet_angle:
        turns = (p.z_s + p.z_r) * (angle - p.planet_angle[0]) / 360.0
        if abs(turns - round(turns)) > 1e-6:
            rules.append(
                f"a planet at {angle:g} deg from one at {p.planet_angle[0]:g} deg needs "
                f"(z_s + z_r) times the angle over 360 to be whole, got {turns:.3f}"
            )
    apart = (p.z_s + p.z_p) * math.sin(math.radians(_least_gap_deg(p)) / 2.0)
    if p.n_planets > 1 and apart <= p.z_p + 2:
        rules.append(
            f"neighbouring planets touch: (z_s + z_p) sin(gap / 2) = {apart:.1f} must exceed "
            f"z_p + 2 = {p.z_p + 2}"
        )
    return rules


def obstacle_text(rule: str) -> str:
    """Return the text of the warning about a violated rule of ``obstacles``."""
    return f"no such gear can be assembled: {rule}; it runs all the same"


def _warn(rules: Sequence[str], stacklevel: int) -> None:
    for rule in rules:
        warnings.warn(obstacle_text(rule), ParameterWarning, stacklevel)
