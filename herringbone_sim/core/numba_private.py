"""All that the package uses of Numba beyond its public interface, and why.

Numba guarantees none of this, so requirements.txt fixes the minor version that the tests run with.
To take a new one, change ``TESTED`` and that line together once the tests pass.

- ``COMPILED``: option ``_nrt=False`` disables Numba's reference counting. Nothing can then be
  allocated in compiled code. Counting a dozen arrays a call took a third of the kernel's time.
- ``UNWRAPPED``: options that leave out the wrappers by which Python and C call a function.
- ``ir``, ``cgutils``, ``make_array``: vectors of sixteen float64 as a type, for
  ``core.lanes.vector``. Numba has no public type of that kind, and its compiler does not
  vectorise loops over lanes.
- ``Conversion``: allows one number to stand for sixteen, in the same file.
- ``entry_point``: a compiled function without the check of its argument types, which for a gear
  by laws takes longer than a mesh cycle (``effects.law_stepper``).
- ``event``: reports when a compilation begins, for the node's ``compiling`` in /diagnostics.
- ``wrapper_address``: a compiled function as a pointer that another takes as argument
  (``effects.gear``). The public ``cfunc`` compiles a second time and is not cached on disk.
- ``NumbaExperimentalFeatureWarning``: Numba's warning at every call of such a pointer.
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
    "UNWRAPPED",
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
UNWRAPPED = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}


def entry_point(function: Any, kinds: tuple[Any, ...]) -> Any:
    """A compiled function for arguments of these Numba types, compiled if necessary."""
    function.compile(kinds)
    return function.overloads[kinds].entry_point
