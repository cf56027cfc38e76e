"""All that the package uses of Numba beyond its public interface, and why.

Numba guarantees none of this, so requirements.txt fixes the minor version that the tests run with.
For a new version, change ``TESTED`` and that line together once the tests pass.

- ``COMPILED``: option ``_nrt=False`` disables Numba's reference counting. Nothing can then be
  allocated in compiled code. Counting a dozen arrays a call took a third of the kernel's time.
- ``LINKED``: options for functions that only compiled code calls. They get no wrappers for calls
  from Python and C, and are only linked into their callers (``LinkedCompiler``). Otherwise Numba
  optimises each function together with all that it calls, and generates its machine code: a
  function ten calls deep is compiled ten times.
- ``ir``, ``cgutils``, ``make_array``: vectors of sixteen float64 as a type, for
  ``core.lanes.vector``. Numba has no public type of that kind, and its compiler does not
  vectorise loops over lanes.
- ``Conversion``: allows one number to stand for sixteen, in the same file.
- ``intrinsic``: Numba's function of that name looks through all registries at each call.
- ``AttributeTemplate``, ``populate_array``, ``as_dtype``, ``from_dtype``: arrays behind a pointer,
  for ``core.reference``.
- ``entry_point``: calls a compiled function without the check of its argument types, which for a
  gear by laws takes longer than a mesh cycle (``effects.law_stepper``).
- ``event``: reports when a compilation begins, for the node's ``compiling`` in /diagnostics.
- ``wrapper_address``: a compiled function as a pointer that is an argument of another
  (``effects.gear``). The public ``cfunc`` compiles a second time and is not cached on disk.
- ``NumbaExperimentalFeatureWarning``: Numba's warning where such a pointer is an argument.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils, event
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.errors import NumbaExperimentalFeatureWarning
from numba.core.typeconv import Conversion
from numba.core.typing.templates import AbstractTemplate, AttributeTemplate, infer_global
from numba.experimental.function_type import _get_wrapper_address as wrapper_address
from numba.extending import lower_builtin
from numba.np.arrayobj import make_array, populate_array
from numba.np.numpy_support import as_dtype, from_dtype

__all__ = [
    "COMPILED",
    "LINKED",
    "TESTED",
    "AttributeTemplate",
    "Conversion",
    "NumbaExperimentalFeatureWarning",
    "as_dtype",
    "cgutils",
    "entry_point",
    "event",
    "from_dtype",
    "intrinsic",
    "ir",
    "make_array",
    "populate_array",
    "wrapper_address",
]


class _Unloaded:
    """Code generator of a library without machine code; passes on all but ``set_env``."""

    def __init__(self, codegen: Any) -> None:
        self._codegen = codegen

    def __getattr__(self, name: str) -> Any:
        return getattr(self._codegen, name)

    def set_env(self, name: str, env: Any) -> None:
        """Do nothing: only machine code has an environment."""


class LinkedLibrary(JITCodeLibrary):  # type: ignore[misc]
    """Code that is only linked into callers: neither optimised nor turned into machine code."""

    @property
    def codegen(self) -> Any:
        """Code generator."""
        return _Unloaded(self._codegen)

    def get_pointer_to_function(self, name: str) -> int:
        """Return 0, no address: there is no machine code."""
        self._ensure_finalized()
        return 0

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalized = True


class LinkedCompiler(Compiler):  # type: ignore[misc]
    """Compiler of functions that are only linked into their callers."""

    def define_pipelines(self) -> Any:
        """Return Numba's pipelines, after a ``LinkedLibrary`` is set for them to write into."""
        codegen = self.state.targetctx.codegen()
        self.state.library = LinkedLibrary(codegen, self.state.func_id.func_qualname)
        return super().define_pipelines()


TESTED = "0.68"  # minor version of Numba, as in requirements.txt
COMPILED: dict[str, Any] = {"nogil": True, "error_model": "numpy", "_nrt": False}
LINKED = {
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
    "pipeline_class": LinkedCompiler,
}


def entry_point(function: Any, kinds: tuple[Any, ...]) -> Any:
    """Compile a function for these Numba types; return it without the check of its arguments."""
    function.compile(kinds)
    return function.overloads[kinds].entry_point


def intrinsic(define: Callable[..., Any]) -> Any:
    """Return a function of compiled code, as Numba's ``intrinsic``, whose calls compile faster.

    Args:
        define: (typing, argument types) -> signature and code generator.
    """

    def function(*_: Any) -> Any:
        raise NotImplementedError(f"{define.__name__} is for compiled code")

    function.__name__, function.__doc__ = define.__name__, define.__doc__
    signatures: dict[tuple[Any, ...], Any] = {}

    class _Template(AbstractTemplate):  # type: ignore[misc]
        key = function

        def generic(self, args: tuple[Any, ...], _: Any) -> Any:
            if args not in signatures:
                signature, code = define(self.context, *args)
                lower_builtin(function, *signature.args)(code)
                signatures[args] = signature
            return signatures[args]

    infer_global(function, types.Function(_Template))
    return function
