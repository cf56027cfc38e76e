"""Type aliases of NumPy arrays for annotations, and the root mean square."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
Flags: TypeAlias = NDArray[np.bool_]
Indices: TypeAlias = NDArray[np.int64]


def rms(values: Array) -> float:
    """Return the root mean square of all values of an array; NaN if it is empty."""
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else float("nan")
