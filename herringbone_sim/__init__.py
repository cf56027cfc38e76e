"""Herringbone planetary gear dynamics: stream, steer, record, analyse, diagnose."""

from herringbone_sim.version import VERSION as __version__

__all__ = ["__version__"]
