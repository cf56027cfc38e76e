"""Herringbone planetary gear dynamics: stream, steer, record, analyse, diagnose."""

__version__ = "0.1.0"
