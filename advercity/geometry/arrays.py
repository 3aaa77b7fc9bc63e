"""Names for NumPy arrays by element type, so that signatures stay short.

Shapes are in the docstring of whatever takes or returns an array.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.floating[Any]]
"""Floating-point numbers of any width."""

Float64Array = NDArray[np.float64]
Float32Array = NDArray[np.float32]
Uint8Array = NDArray[np.uint8]

IndexArray = NDArray[np.intp]
"""Row numbers, as `np.flatnonzero` gives them."""
