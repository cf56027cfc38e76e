"""All that the package takes from Numba beyond its public interface, and why.

Numba gives no promise on any of this, so requirements.txt holds it to the minor version that the
tests run with. A new one is taken by changing ``TESTED`` and that line together, once the tests
pass.

- ``COMPILED``: option ``_nrt=False`` leaves out Numba's reference counting. Nothing can then be
  allocated within compiled code, and nothing is counted: the counting of a dozen arrays a call
  took a third of the kernel's time.
- ``ir``, ``cgutils``, ``make_array``: vectors of sixteen float64 as a type, for
  ``core.lanes.vector``. Numba has no public type of that kind, and its compiler makes no vectors
  of loops over lanes.
- ``Conversion``: that one number may stand for sixteen, in the same file.
- ``entry_point``: a compiled function without the look at the types of its arguments, which of a
  gear by its laws takes longer than a mesh cycle (``effects.law_stepper``).
- ``event``: tells when something begins to compile, for the node's ``compiling`` in /diagnostics.
- ``wrapper_address``: a compiled function as a pointer that another takes as argument
  (``effects.gear``). The public ``cfunc`` compiles a second time and is not kept on disk.
- ``NumbaExperimentalFeatureWarning``: what Numba says of such pointers at every call.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import cgutils, event
from numba.core.errors import NumbaExperimentalFeatureWarning
from numba.core.typeconv import Conversion
from numba.experimental.function_type import _get_wrapper_address as wrapper_address
from numba.np.arrayobj import make_array

__all__ = [
    "COMPILED",
    "TESTED",
    "Conversion",
    "NumbaExperimentalFeatureWarning",
    "cgutils",
    "entry_point",
    "event",
    "ir",
    "make_array",
    "wrapper_address",
]

TESTED = "0.68"  # minor version of Numba, as in requirements.txt
COMPILED: dict[str, Any] = {"nogil": True, "error_model": "numpy", "_nrt": False}


def entry_point(function: Any, kinds: tuple[Any, ...]) -> Any:
    """A compiled function for arguments of these types of Numba, compiled where it is not yet."""
    function.compile(kinds)
    return function.overloads[kinds].entry_point
