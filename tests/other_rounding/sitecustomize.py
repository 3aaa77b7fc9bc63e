"""Round NumPy's functions as on a processor with other vector instructions.

A child process with this folder in PYTHONPATH adds a last bit to about half of the results of
functions that NumPy computes otherwise with AVX-512, as `numpy.lib.introspect` lists them.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

DISPATCHED = (
    *("sin", "cos", "tan", "arcsin", "arccos", "arctan", "arctan2", "sinh", "cosh", "tanh"),
    *("exp", "exp2", "expm1", "log", "log2", "log10", "log1p", "cbrt", "power", "angle"),
    *("abs", "absolute"),
)


def round_otherwise(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function whose float64 results, exact ones excepted, may be one bit larger."""

    def compute(*args: Any, **options: Any) -> Any:
        result = function(*args, **options)
        is_exact = function in EXACT and not np.iscomplexobj(args[0])
        if is_exact or options or getattr(result, "dtype", None) != np.float64:
            return result
        bits = np.asarray(result).view(np.int64) >> 3
        return np.where(bits & 1 == 1, np.nextafter(result, np.inf), result)[()]

    return compute


EXACT = (np.abs,)
"""Functions of which only the complex variant rounds."""
for name in DISPATCHED:
    setattr(np, name, round_otherwise(getattr(np, name)))
