"""Types of arrays, as annotations name them, and their root mean square."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
Flags: TypeAlias = NDArray[np.bool_]
Indices: TypeAlias = NDArray[np.int64]


def rms(values: Array) -> float:
    """Root mean square of all values; NaN of none."""
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else float("nan")
