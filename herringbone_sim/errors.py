"""The errors of this package: what is wrong, by which rule, the value got, what to do."""


class HerringboneError(Exception):
    """Base of every error that a user of this package can provoke."""


class ParameterError(HerringboneError, ValueError):
    """A parameter, or a set of them, that no gear or no integrator can have."""


class RecordingError(HerringboneError, OSError):
    """A recording that can't be written, read or recovered."""


class AnalysisError(HerringboneError, ValueError):
    """Data from which the wanted result can't be had."""


class DivergenceError(HerringboneError, ArithmeticError):
    """An integration that left the range of any physical motion."""
