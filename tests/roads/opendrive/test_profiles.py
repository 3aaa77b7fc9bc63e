"""Cubic polynomials of OpenDRIVE: elevation, superelevation, offsets and widths."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from advercity.roads.opendrive.profiles import (
    Cubic,
    differentiate,
    differentiate_cubic,
    evaluate_cubic,
    evaluate_profile,
)

NUMBERS = st.floats(-2, 2)


@given(st.tuples(NUMBERS, NUMBERS, NUMBERS, NUMBERS), st.floats(-5, 5))
def test_a_derivative_is_the_slope_of_the_cubic(
    coefficients: tuple[float, float, float, float], at: float
) -> None:
    before, after = evaluate_cubic(coefficients, np.array([at - 1e-4, at + 1e-4]))
    slope = evaluate_cubic(differentiate_cubic(coefficients), np.array([at]))
    assert slope[0] == pytest.approx((after - before) / 2e-4, abs=1e-4)


def test_the_slope_of_a_profile_is_that_of_the_polynomial_at_a_place() -> None:
    """5 + 0.1 s up to 20 m, then 7 + 0.1 s + 0.01 s^2 - 0.002 s^3 from there."""
    profile = (Cubic(0.0, (5.0, 0.1, 0.0, 0.0)), Cubic(20.0, (7.0, 0.1, 0.01, -0.002)))
    at_m = np.array([0.0, 19.0, 20.0, 30.0])
    assert evaluate_profile(profile, at_m) == pytest.approx([5.0, 6.9, 7.0, 7.0])
    assert evaluate_profile(differentiate(profile), at_m) == pytest.approx([0.1, 0.1, 0.1, -0.3])
