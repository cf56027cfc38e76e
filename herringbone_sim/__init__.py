"""Simulation of a herringbone planetary gear, analysis of its motions, diagnosis of a rig.

``import herringbone_sim as hb`` offers the names in ``herringbone_sim.api.NAMES``. The module of
a name is imported on first access, so that the import of the package itself takes no time.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from herringbone_sim.version import VERSION

if TYPE_CHECKING:
    from herringbone_sim.api.basins import basins as basins
    from herringbone_sim.api.bifurcation import bifurcation as bifurcation
    from herringbone_sim.api.diagnosis import Campaign as Campaign
    from herringbone_sim.api.diagnosis import catalogue as catalogue
    from herringbone_sim.api.diagnosis import diagnose as diagnose
    from herringbone_sim.api.exponent import exponents as exponents
    from herringbone_sim.api.exponent import largest_exponent as largest_exponent
    from herringbone_sim.api.orbits import orbits as orbits
    from herringbone_sim.api.run import Run as Run
    from herringbone_sim.api.run import read_run as read_run
    from herringbone_sim.api.run import simulate as simulate
    from herringbone_sim.core.parameters import Parameters as Parameters
    from herringbone_sim.errors import HerringboneError as HerringboneError
    from herringbone_sim.recording.parameter_file import load_gear as load_gear

__version__ = VERSION


def __getattr__(name: str) -> Any:
    from herringbone_sim.api import NAMES

    if name not in NAMES:
        raise AttributeError(f"module 'herringbone_sim' has no attribute {name!r}")
    return getattr(import_module(NAMES[name]), name)


def __dir__() -> list[str]:
    from herringbone_sim.api import NAMES

    return sorted([*globals(), *NAMES])
