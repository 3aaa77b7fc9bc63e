"""Vectors of the plan as complex numbers, east + i north, rounded alike by all processors.

NumPy selects its loops for `abs` of complex numbers, `angle`, roots, powers and most trigonometric
functions by the processor's vector instructions; with AVX-512 the last bits differ. Traces are
computed with these functions, `sqrt` and products instead. They agree on x86
processors with AVX2 and FMA, made since 2013; older ones round a few angles otherwise.
"""

import math

import numpy as np
from numpy.typing import NDArray


def compute_lengths(vectors: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Compute the lengths (n,) of vectors (n,)."""
    return np.hypot(vectors.real, vectors.imag)


def compute_headings(vectors: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Compute the headings (n,) of vectors (n,) in rad, from east, from -pi to pi."""
    components = zip(vectors.imag.tolist(), vectors.real.tolist(), strict=True)
    return np.array([math.atan2(north, east) for north, east in components], np.float64)


def compute_directions(headings: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Compute the unit vectors (n,) of headings (n,) in rad from east."""
    return np.exp(1j * headings)
