"""Heights along a path in time, against SciPy's splines."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BSpline

from advercity.traffic.motion_spline import PROFILE_STEP_M, HeightProfile, MotionSpline

TICK_S = 0.1


@given(seed=st.integers(0, 10**6), speed_m_s=st.floats(-20, 20), count=st.integers(4, 30))
def test_a_height_moves_with_the_profile_below_it(seed: int, speed_m_s: float, count: int) -> None:
    draw = np.random.default_rng(seed)
    profile = HeightProfile(draw.uniform(-5, 5, count), first_m=float(draw.uniform(-9, 9)))
    knots = profile.first_m + PROFILE_STEP_M * np.arange(-2.0, count + 2)
    height = BSpline(knots, profile.controls, 3)
    # Stations where four controls are around each.
    first, last = profile.first_m + PROFILE_STEP_M, profile.first_m + PROFILE_STEP_M * (count - 2)
    middle = draw.uniform(first, last, 8)
    steps = speed_m_s * TICK_S + draw.normal(0, 0.1, (2, 8))
    for before, here, after in zip(middle - steps[0], middle, middle + steps[1], strict=True):
        station = MotionSpline(np.array([before, here, after]), TICK_S)
        at, rate, acceleration = station.derivatives[:, 0]
        if first <= at <= last:
            expected = [
                height(at),
                height(at, 1) * rate,
                height(at, 2) * rate**2 + height(at, 1) * acceleration,
            ]
            found = profile.compute_derivatives(station)[:, 0]
            np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-7)


@given(grade=st.floats(-0.1, 0.1), height_m=st.floats(-50, 50), length_m=st.floats(1, 200))
def test_a_steady_grade_is_kept_along_a_path_and_beyond(
    grade: float, height_m: float, length_m: float
) -> None:
    stations = np.linspace(0, length_m, 7)
    profile = HeightProfile.from_samples(
        stations, height_m + grade * stations, first_m=-6.0, first_grade=grade
    )
    at = MotionSpline(np.linspace(-4.0, length_m, 12), TICK_S)
    found = profile.compute_derivatives(at)
    np.testing.assert_allclose(found[0], height_m + grade * at.values, atol=1e-9)
    np.testing.assert_allclose(found[1], grade * at.rates, atol=1e-9)
