"""What inertial units err by, against Allan deviations, hand-computed cases and integration."""

import math

import allantools
import numpy as np
import pytest
from advercity_dsl.inertial import (
    IMU_GRADES,
    AccelerometerErrors,
    GyroscopeErrors,
    Imu,
    ImuErrors,
    RoadVibration,
)
from scipy import stats

from advercity.frames import AT_REST, BodyMotion
from advercity.geometry.poses import pose_matrix
from advercity.sensors.imu import ImuConditions, measure_imu
from advercity.sensors.imu_errors import apply_errors
from advercity.sensors.measurements import ImuSample
from advercity.sensors.road_vibration import compute_vibration
from advercity.sensors.sample_times import SampleTimes

G = 9.80665
DEG_H = math.radians(1) / 3600


def apply(
    errors: ImuErrors,
    force: np.ndarray,
    rate: np.ndarray | None = None,
    *,
    warmer_c: float = 0.0,
    unit: int = 0,
    rate_hz: float = 100.0,
) -> tuple[np.ndarray, np.ndarray]:
    count = len(force)
    return apply_errors(
        errors,
        force,
        np.zeros((count, 3)) if rate is None else rate,
        SampleTimes(0, np.ones(count), 1 / rate_hz),
        temperature_c=np.full(count, errors.calibrated_at_c + warmer_c),
        key=("test", unit),
        frame=0,
    )


def find_deviations(values: np.ndarray, rate_hz: float, taus_s: list[float]) -> np.ndarray:
    """Overlapping Allan deviations of three axes by allantools, as their mean square."""
    axes = [
        allantools.oadev(axis, rate=rate_hz, data_type="freq", taus=taus_s)[1] for axis in values.T
    ]
    return np.sqrt(np.mean(np.square(axes), axis=0))


def test_noise_has_the_random_walks_of_the_data_sheet() -> None:
    errors = ImuErrors(
        accelerometer=AccelerometerErrors(noise_m_s_rth=0.06),
        gyroscope=GyroscopeErrors(noise_deg_rth=0.15),
    )
    force, rate = apply(errors, np.zeros((200_000, 3)))
    taus_s = [0.1, 1.0, 10.0]
    expected = 1 / np.sqrt(taus_s) / 60
    np.testing.assert_allclose(find_deviations(force, 100, taus_s), 0.06 * expected, rtol=0.08)
    in_deg_s = np.degrees(find_deviations(rate, 100, taus_s))
    np.testing.assert_allclose(in_deg_s, 0.15 * expected, rtol=0.08)


def test_white_noise_is_normal_and_independent_by_axis_and_sample() -> None:
    """Of 20,000 samples, a correlation of 0.036 is five sigma."""
    errors = ImuErrors(
        accelerometer=AccelerometerErrors(noise_m_s_rth=0.06),
        gyroscope=GyroscopeErrors(noise_deg_rth=0.15),
    )
    noise = np.hstack(apply(errors, np.zeros((20_000, 3)), unit=5))
    both = np.hstack([noise[:-1], noise[1:]])
    np.testing.assert_allclose(np.corrcoef(both.T), np.eye(12), atol=0.036)
    for values in noise.T:
        assert stats.kstest(values / values.std(), "norm").pvalue > 1e-4


def test_the_floor_of_the_allan_deviation_is_the_bias_instability() -> None:
    """Its peak is at 1.89 correlation times of 100 s (IEEE Std 952)."""
    errors = ImuErrors(gyroscope=GyroscopeErrors(bias_instability_deg_h=8))
    _, rate = apply(errors, np.zeros((100_000, 3)), rate_hz=1.0)
    found = find_deviations(rate, 1.0, [20.0, 189.0, 2000.0]) / DEG_H
    assert found[1] == pytest.approx(8, rel=0.08)
    assert found[0] < 0.8 * found[1] > found[2]


def test_a_walking_bias_grows_with_the_root_of_time() -> None:
    errors = ImuErrors(accelerometer=AccelerometerErrors(bias_walk_ug_rth=100))
    force, _ = apply(errors, np.zeros((100_000, 3)), rate_hz=1.0)
    taus_s = [10.0, 100.0, 1000.0]
    expected = 100 * G * 1e-6 / 60 * np.sqrt(np.array(taus_s) / 3)
    np.testing.assert_allclose(find_deviations(force, 1.0, taus_s), expected, rtol=0.15)


def measure_units(
    errors: ImuErrors, force: tuple[float, ...], *, warmer_c: float = 0.0
) -> np.ndarray:
    """Errors (1000, 6) of units at rest in a specific force."""
    at_rest = np.array([force])
    found = [apply(errors, at_rest, unit=unit, warmer_c=warmer_c) for unit in range(1000)]
    return np.array([np.r_[one[0][0] - force, one[1][0]] for one in found])


def test_units_differ_by_the_standard_deviations_of_their_sheet() -> None:
    accelerometer = AccelerometerErrors(scale_ppm=1000, misalignment_mrad=2)
    spread = measure_units(ImuErrors(accelerometer=accelerometer), (0, 0, 10)).std(axis=0)
    np.testing.assert_allclose(spread, [0.02, 0.02, 0.01, 0, 0, 0], rtol=0.08)
    errors = ImuErrors(
        accelerometer=AccelerometerErrors(turn_on_bias_ug=1000, rectification_ug_g2=500),
        gyroscope=GyroscopeErrors(turn_on_bias_deg_h=100, g_sensitivity_deg_h_g=50),
    )
    spread = measure_units(errors, (0, 0, 2 * G)).std(axis=0)
    found = np.r_[spread[:3] / (G * 1e-6), spread[3:] / DEG_H]
    tilted = math.hypot(1000, 4 * 500)
    np.testing.assert_allclose(found, [1000, 1000, tilted, 100, 100, 100 * 2**0.5], rtol=0.08)


def test_warmth_moves_bias_and_scale_in_proportion() -> None:
    gyroscope = GyroscopeErrors(bias_deg_h_per_c=5, scale_ppm_per_c=100)
    errors, turning = ImuErrors(gyroscope=gyroscope), np.array([[0.0, 0.0, 1.0]])
    cold, warm, hot = (
        apply(errors, np.zeros((1, 3)), turning, warmer_c=by)[1] - turning for by in (0, 10, 20)
    )
    np.testing.assert_array_equal(cold, 0)
    np.testing.assert_allclose(hot, 2 * warm)
    spread = measure_units(errors, (0, 0, 0), warmer_c=10).std(axis=0)[3:] / DEG_H
    np.testing.assert_allclose(spread, 50, rtol=0.08)


def measure_at_rest(imu: Imu, conditions: ImuConditions) -> ImuSample:
    still = pose_matrix((0, 0, 0))
    found = measure_imu(
        imu, (still, still), (AT_REST, AT_REST), 0.1, key=("u",), frame=3, conditions=conditions
    )
    assert found is not None
    return found


def test_a_unit_warms_up_by_its_time_constant() -> None:
    gyroscope = GyroscopeErrors(bias_deg_h_per_c=100)
    errors = ImuErrors(gyroscope=gyroscope, self_heating_c=10, warm_up_s=60)
    imu = Imu(errors=errors)
    start, later = (
        measure_at_rest(imu, ImuConditions(air_c=25, running_s=after)).angular_rate
        for after in (0.0, 60.0)
    )
    np.testing.assert_array_equal(start, 0)
    unit = measure_at_rest(imu, ImuConditions(air_c=26)).angular_rate
    np.testing.assert_allclose(later / unit, 10 * (1 - math.exp(-1)))


def test_better_grades_err_less_at_rest() -> None:
    grades = [IMU_GRADES[name] for name in ("consumer", "automotive", "tactical")]
    spread = np.array([measure_units(one, (0, 0, G), warmer_c=-10).std(axis=0) for one in grades])
    assert (spread[:-1] > 1.2 * spread[1:]).all()


def test_an_ideal_unit_measures_what_is_there() -> None:
    force = np.array([[1.0, -2.0, 9.81]])
    found, _ = apply(ImuErrors(), force)
    np.testing.assert_array_equal(found, force)


def integrate_quarter_car(road: np.ndarray, step_s: float) -> np.ndarray:
    """Accelerations of the sprung mass over a road's heights, by Runge and Kutta."""

    def derive(state: np.ndarray, height: float) -> np.ndarray:
        body, wheel, body_speed, wheel_speed = state
        suspension = 63.3 * (wheel - body) + 6.0 * (wheel_speed - body_speed)
        tyre = 653.0 * (height - wheel)
        return np.array([body_speed, wheel_speed, suspension, (tyre - suspension) / 0.15])

    state, found = np.zeros(4), []
    for at in range(0, len(road) - 2, 2):
        a = derive(state, road[at])
        b = derive(state + step_s / 2 * a, road[at + 1])
        c = derive(state + step_s / 2 * b, road[at + 1])
        d = derive(state + step_s * c, road[at + 2])
        found.append(a[2])
        state = state + step_s / 6 * (a + 2 * b + 2 * c + d)
    return np.array(found)


def test_a_body_shakes_as_the_quarter_car_on_a_road_of_its_class() -> None:
    """Root mean squares of a class B road at 20 m/s, against a road of other waves, integrated."""
    speed, rate_hz, count = 20.0, 400.0, 9_000
    cycles = np.geomspace(0.011, 9.0, 160) * 1.01
    phases = np.random.default_rng(3).uniform(0, 2 * np.pi, len(cycles))
    heights = np.sqrt(2 * 64e-6 * (cycles / 0.1) ** -2.0 * np.gradient(cycles))
    at_m = np.arange(2 * count) * speed / rate_hz / 2
    road = np.zeros(len(at_m))
    for wave, phase, height in zip(cycles, phases, heights, strict=True):
        road += height * np.cos(2 * np.pi * wave * at_m + phase)
    integrated = integrate_quarter_car(road, 1 / rate_hz)[1000:]
    found = compute_vibration(
        RoadVibration(road="b", horizontal_fraction=0.5),
        at_m[::2],
        np.full(count, speed),
        rate_hz=rate_hz,
        key=("road",),
    )
    spread = found.std(axis=0)
    assert spread[2] == pytest.approx(integrated.std(), rel=0.1)
    assert 0.3 < spread[2] < 3.0  # m/s²
    np.testing.assert_allclose(spread[:2], spread[2] / 2, rtol=0.15)


def test_vibration_grows_with_speed_and_roughness_and_ends_at_standstill() -> None:
    def shake(road: str, speed: float) -> float:
        at = np.linspace(0, 500, 2000)
        imu = RoadVibration.model_validate({"road": road})
        speeds = np.full(2000, speed)
        return float(compute_vibration(imu, at, speeds, rate_hz=200, key=(1,))[:, 2].std())

    assert shake("a", 0.0) == 0.0
    # Four times the spectral density is twice the acceleration.
    assert shake("c", 15.0) == pytest.approx(2 * shake("b", 15.0))
    # The road's velocity is white noise, whose density grows with the speed.
    assert shake("b", 20.0) == pytest.approx(2**0.5 * shake("b", 10.0), rel=0.25)


def test_vibration_depends_on_the_frame_alone() -> None:
    imu = Imu(rate_hz=100, vibration=RoadVibration())
    still, moving = pose_matrix((0, 0, 0)), BodyMotion(np.array([10.0, 0, 0]), *np.zeros((2, 3)))

    def measure(frame: int) -> np.ndarray:
        found = measure_imu(
            imu,
            (still, still),
            (moving, moving),
            0.1,
            key=("one",),
            frame=frame,
            conditions=ImuConditions(travelled_m=(frame - 1.0, float(frame))),
        )
        assert found is not None
        return np.array([one.specific_force for one in (*found.earlier, found)])

    assert measure(7).shape == (10, 3)
    np.testing.assert_array_equal(measure(7), measure(7))
    assert np.abs(measure(7) - [0, 0, 9.81]).max() > 0.05
