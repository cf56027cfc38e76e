"""Stagger: the mesh phase of one side is advanced, k(phase + angle) and e(phase + angle).

Source: the phase of Eqs. (7), (9); harmonic j shifts by j times the angle. Recorded x contains the
nominal e(t), so the change of e appears as a displacement d.
"""

from __future__ import annotations

from herringbone_sim.arrays import Array
from herringbone_sim.effects.effect import Effect, Options, Parameter
from herringbone_sim.effects.law import law, shift_phase
from herringbone_sim.effects.slots import Slots


@law
def excite(theta, site, gear, now, added_states, law):
    """Advance k and e of the meshes by the angle."""
    for m in range(law.shape[1]):
        if site[0, m] != 0.0:
            shift_phase(gear, now, m, theta[0], law)


def fill(slots: Slots, theta: tuple[float, ...], mask: Array, options: Options) -> None:
    """Advance k and e of the meshes by the angle."""
    slots.shift_phase(mask, theta[0])


EFFECT = Effect(
    id="stagger",
    text="left/right mesh phase error: k and e shift together",
    level="mesh",
    parameters=(Parameter("phase", "rad", "how far these are ahead", -3.1416, 3.1416, 0.1),),
    loci=(("all", "all", "*"),),
    fill=fill,
    excite=excite,
)
