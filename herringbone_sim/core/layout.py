"""Indices and names of sides, planets, meshes, bodies, states and recorded channels.

Arrays over meshes have the axes (kind, side, planet), flattened in this order: kind 0 is
sun-planet ``sp``, kind 1 is ring-planet ``rp``; side 0 is ``L``, side 1 is ``R``. The state ``y``
holds ``2 + 2 * n_classes`` displacements, then as many velocities (see ``Layout.state_names``).
"""

from __future__ import annotations

from dataclasses import dataclass

from herringbone_sim.errors import ParameterError

KINDS = ("sp", "rp")
SIDES = ("L", "R")
HEAD = ("t", "phase", "K", "delta_T", "T_1")
QUANTITIES = ("x", "v", "F", "u", "a", "pin")  # of channels, see ``Layout.channels_of``
UNITS = {"t": "s", "phase": "rad", "K": "-", "delta_T": "K", "T_1": "N m"}
PREFIX_UNITS = {"x": "m", "v": "m/s", "F": "N", "u": "m", "a": "m/s^2"}
MEANINGS = {
    "t": "time of the sample",
    "phase": "mesh phase, unwrapped: its slope is the mesh frequency",
    "K": "control amplitude in force",
    "delta_T": "temperature rise in force",
    "T_1": "input torque",
    "x": "relative displacement along the line of action (Eqs. 15, 16) of mesh",
    "v": "rate of the relative displacement of mesh",
    "F": "normal mesh force k f(x) + c v of mesh",
    "u": "rotation times base radius, rigid rotation removed, of body",
    "a": "angular acceleration times base radius of body",
    "pin": "sum of the normal mesh forces of both halves of planet",
}


@dataclass(frozen=True)
class Layout:
    """Names and sizes of a model with ``n_classes`` distinguished planets.

    The reduced model has one class that represents all planets; its names have no number.

    Attributes:
        n_classes: number of distinguished planets, 1 in the reduced model.
        numbered: whether names contain the number of the planet (full model).
    """

    n_classes: int
    numbered: bool

    @property
    def planets(self) -> tuple[str, ...]:
        """Numbers of the planets as texts; in the reduced model one empty text."""
        return tuple(str(i + 1) for i in range(self.n_classes)) if self.numbered else ("",)

    @property
    def n_mesh(self) -> int:
        """Number of meshes."""
        return 4 * self.n_classes

    @property
    def n_coordinate(self) -> int:
        """Number of displacements in the state."""
        return 2 + 2 * self.n_classes

    @property
    def n_state(self) -> int:
        """Length of the state."""
        return 2 * self.n_coordinate

    @property
    def meshes(self) -> tuple[str, ...]:
        """Names such as ``sp1_L`` (``sp_L`` when reduced), in the order of mesh arrays."""
        return tuple(f"{k}{p}_{s}" for k in KINDS for s in SIDES for p in self.planets)

    def mesh_index(self, name: str, prefix: str = "") -> int:
        """Index of a mesh in mesh arrays; ParameterError, after ``prefix``, if there is none."""
        if name not in self.meshes:
            known = ", ".join(self.meshes)
            raise ParameterError(f"{prefix}mesh must be one of {known}, got {name!r}: choose one")
        return self.meshes.index(name)

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names such as ``s_L``, ``c``, ``p1_L``, in the order of arrays over bodies."""
        planets = tuple(f"p{p}_{s}" for s in SIDES for p in self.planets)
        return ("s_L", "s_R", "c", *planets)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the state: displacements q_S, r_pS of side S and planet p, then their rates.

        ``q_S = (u_s_S - 2 u_c) cos beta`` is the path through one planet from sun to ring,
        ``r_pS = (u_p_S - u_c) cos beta``; then ``x_sp = q - r - e_sp`` and ``x_rp = r - e_rp``.
        """
        q = tuple(f"q_{s}" for s in SIDES)
        r = tuple(f"r{p}_{s}" for s in SIDES for p in self.planets)
        return (*q, *r, *(f"d{name}" for name in q + r))

    @property
    def channels(self) -> tuple[str, ...]:
        """Recorded channels in order: head, x, v and F of the meshes, u of the bodies."""
        return (*HEAD, *(name for quantity in "xvFu" for name in self.channels_of(quantity)))

    def channels_of(self, quantity: str) -> tuple[str, ...]:
        """Names of the channels of a quantity: x, v, F of meshes; u, a of bodies; pin forces."""
        if quantity == "pin":
            return tuple(f"F_pin{planet}" for planet in self.planets)
        places = self.bodies if quantity in "ua" else self.meshes
        return tuple(f"{quantity}_{place}" for place in places)


def unit_of(channel: str) -> str:
    """Return the unit of a recorded channel, ``-`` if it has none; KeyError: unknown name."""
    return UNITS[channel] if channel in UNITS else PREFIX_UNITS[channel.split("_")[0]]


def describe(channel: str) -> dict[str, str]:
    """Return name, unit and meaning of one of ``Layout.channels_of``, for the ``channels`` topic.

    KeyError: unknown name.
    """
    prefix, _, rest = channel.partition("_")
    if channel.startswith("F_pin"):
        planet = rest.removeprefix("pin")
        if planet and not planet.isdecimal():
            raise KeyError(channel)
        prefix, rest = "pin", planet or "(all alike)"
    meaning = MEANINGS[channel] if channel in MEANINGS else f"{MEANINGS[prefix]} {rest}"
    return {"name": channel, "unit": unit_of(channel), "meaning": meaning}
