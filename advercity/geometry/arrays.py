"""Short names for NumPy arrays by element type.

Functions give the shapes of their arrays in their docstrings.
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
