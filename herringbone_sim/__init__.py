"""Herringbone planetary gear dynamics: stream, steer, record, analyse, diagnose."""

from herringbone_sim.version import VERSION

__version__ = VERSION
