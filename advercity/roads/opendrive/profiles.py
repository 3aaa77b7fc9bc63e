"""Cubic polynomials along a line, each valid from where it begins to the next."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float64]


@dataclass(frozen=True)
class Cubic:
    """The polynomial a + b d + c d^2 + d d^3 of the distance d from where it begins."""

    begins_m: float
    coefficients: tuple[float, float, float, float]

    @property
    def negated(self) -> "Cubic":
        """The polynomial of the opposite sign."""
        a, b, c, d = self.coefficients
        return Cubic(self.begins_m, (-a, -b, -c, -d))


Profile = tuple[Cubic, ...]
"""Polynomials in the order in which they begin."""


def evaluate_cubic(coefficients: Sequence[float], at: Values) -> Values:
    """Evaluate a + b x + c x^2 + d x^3 at x (...)."""
    a, b, c, d = coefficients
    return a + at * (b + at * (c + at * d))


def differentiate_cubic(coefficients: Sequence[float]) -> tuple[float, float, float, float]:
    """Compute the coefficients of a cubic's derivative."""
    return coefficients[1], 2 * coefficients[2], 3 * coefficients[3], 0.0


def differentiate(profile: Profile) -> Profile:
    """Compute the slope of a profile."""
    return tuple(Cubic(item.begins_m, differentiate_cubic(item.coefficients)) for item in profile)


def evaluate_profile(profile: Profile, at_m: Values) -> Values:
    """Evaluate a profile at distances (n,); 0 before its first polynomial and if it has none."""
    found = np.zeros_like(at_m)
    # Polynomials with one begin replace each other: the last one holds.
    for cubic in profile:
        here = at_m >= cubic.begins_m
        found[here] = evaluate_cubic(cubic.coefficients, at_m[here] - cubic.begins_m)
    return found


def evaluate_piece(profile: Profile, at_m: Values, within_m: float) -> Values:
    """Evaluate at distances (n,) the polynomials that begin up to `within_m`.

    A stretch with its end at a polynomial's begin thus ends with the value before it.
    """
    early = tuple(item for item in profile if item.begins_m <= within_m)
    return evaluate_profile(early or profile[:1], at_m)
