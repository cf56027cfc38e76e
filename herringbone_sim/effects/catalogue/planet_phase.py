"""Planet phase: the mesh phase of one planet is advanced, k(phase + angle), e(phase + angle).

Source: the phase of Eqs. (7), (9); harmonic j shifts by j times the angle. Recorded x contains the
nominal e(t), so the change of e appears as a displacement d.
"""

from __future__ import annotations

from herringbone_sim.effects.catalogue.stagger import excite, fill
from herringbone_sim.effects.effect import Effect, Parameter

EFFECT = Effect(
    id="planet_phase",
    text="mesh phase error of one planet: k and e shift together",
    level="mesh",
    parameters=(Parameter("phase", "rad", "how far these are ahead", -3.1416, 3.1416, 0.1),),
    loci=(("all", "*", "all"),),
    fill=fill,
    excite=excite,
)
