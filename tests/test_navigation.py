import math

import numpy as np
import pytest
from advercity_dsl import Gnss, Imu
from hypothesis import given
from hypothesis import strategies as st

from advercity.poses import Matrix, pose, rotation
from advercity.randomness import generator
from advercity.sensors.geodesy import Geodetic, enu_from_geodetic, geodetic_from_enu
from advercity.sensors.gnss import fix
from advercity.sensors.imu import ImuSample, measure, rotation_vector

ORIGIN = Geodetic(49.0, 8.0, 110.0)
TICK_S = 0.1
HIGH_GRADE_BIAS = 3.6e-6
HIGH_GRADE_WHITE = 4.2e-7 / math.sqrt(TICK_S)
IDEAL = Imu()


def still(where: Matrix) -> tuple[Matrix, Matrix, Matrix]:
    return where, where, where


STILL = still(pose((1, 2, 0)))


def sample(poses: tuple[Matrix, Matrix, Matrix], imu: Imu = IDEAL, *, frame: int = 0) -> ImuSample:
    return measure(imu, poses, TICK_S, key=(7, "ego"), frame=frame)


def moving(position: list[tuple[float, float, float]]) -> tuple[Matrix, Matrix, Matrix]:
    before, now, after = (pose(place) for place in position)
    return before, now, after


@pytest.mark.parametrize(
    ("enu", "expected"),
    [
        ((1000, 1000, 10), (49.008991032, 8.013668672, 120.1567)),
        ((100, 0, 0), (48.999999992, 8.001366623, 110.0008)),
        ((-250, 400, 2), (49.003596692, 7.996583197, 112.0174)),
        ((0, 0, 0), (49.0, 8.0, 110.0)),
    ],
)
def test_places_on_the_ellipsoid_are_exact(
    enu: tuple[float, float, float], expected: tuple[float, float, float]
) -> None:
    place = geodetic_from_enu(enu, ORIGIN)
    assert place.latitude_deg == pytest.approx(expected[0], abs=1e-9)
    assert place.longitude_deg == pytest.approx(expected[1], abs=1e-9)
    assert place.altitude_m == pytest.approx(expected[2], abs=1e-4)


@given(
    east=st.floats(-2000, 2000),
    north=st.floats(-2000, 2000),
    up=st.floats(-50, 200),
    latitude=st.floats(-85, 85),
    longitude=st.floats(-179, 179),
)
def test_there_and_back_again_is_the_same_place(
    east: float, north: float, up: float, latitude: float, longitude: float
) -> None:
    origin = Geodetic(latitude, longitude, 30.0)
    back = enu_from_geodetic(geodetic_from_enu((east, north, up), origin), origin)
    np.testing.assert_allclose(back, (east, north, up), atol=1e-3)


def test_an_ideal_receiver_reports_where_it_is() -> None:
    found = fix(Gnss(), (100, 0, 0), origin=ORIGIN, time_s=6.0, rng=generator("test"))
    assert found.longitude_deg == pytest.approx(8.001366623, abs=1e-9)
    assert found.time_s == 6.0


def test_noise_in_degrees_is_a_third_of_a_metre_at_the_equator() -> None:
    origin = Geodetic(0.0, 0.0)
    gnss = Gnss(latitude_noise_deg=3e-6, longitude_noise_deg=3e-6, altitude_noise_m=0.05)
    fixes = [
        fix(gnss, (50, 20, 1), origin=origin, time_s=0.0, rng=generator("test", number))
        for number in range(10_000)
    ]
    places = np.array(
        [
            enu_from_geodetic(
                Geodetic(found.latitude_deg, found.longitude_deg, found.altitude_m), origin
            )
            for found in fixes
        ]
    )
    np.testing.assert_allclose(places.std(axis=0), [0.334, 0.332, 0.05], rtol=0.03)
    np.testing.assert_allclose(places.mean(axis=0), [50, 20, 1], atol=0.015)


def test_at_rest_only_gravity_is_felt() -> None:
    found = sample(STILL)
    np.testing.assert_allclose(found.specific_force, [0, 0, 9.81], atol=1e-9)
    np.testing.assert_allclose(found.angular_rate, 0, atol=1e-12)


def test_nose_up_gravity_pushes_forward() -> None:
    pitched = still(pose((0, 0, 0), pitch=-math.radians(5)))
    np.testing.assert_allclose(sample(pitched).specific_force, [0.855, 0, 9.7727], atol=1e-3)


def test_a_circle_to_the_left_pushes_left_and_turns_left() -> None:
    rate, radius = 0.5, 20.0
    turn = [
        pose((radius * math.sin(angle), -radius * math.cos(angle), 0), yaw=angle)
        for angle in (1.0 - rate * TICK_S, 1.0, 1.0 + rate * TICK_S)
    ]
    found = sample((turn[0], turn[1], turn[2]))
    np.testing.assert_allclose(found.specific_force, [0, 5.0, 9.81], atol=2e-3)
    np.testing.assert_allclose(found.angular_rate, [0, 0, 0.5], atol=1e-9)


def test_speeding_up_pushes_forward() -> None:
    poses = moving([(0, 0, 0), (1.0, 0, 0), (2.03, 0, 0)])
    np.testing.assert_allclose(sample(poses).specific_force, [3.0, 0, 9.81], atol=1e-9)


@pytest.mark.parametrize(
    ("yaw_deg", "compass_deg"), [(90, 0), (0, 90), (-90, 180), (180, 270), (45, 45)]
)
def test_the_compass_runs_clockwise_from_north(yaw_deg: float, compass_deg: float) -> None:
    facing = still(pose((0, 0, 0), yaw=math.radians(yaw_deg)))
    turned = math.degrees(sample(facing).compass_rad) - compass_deg
    assert (turned + 180) % 360 - 180 == pytest.approx(0, abs=1e-9)
    assert 0 <= sample(facing).compass_rad < 2 * math.pi


@given(x=st.floats(-1.7, 1.7), y=st.floats(-1.7, 1.7), z=st.floats(-1.7, 1.7))
def test_a_rotation_gives_its_axis_and_angle_back(x: float, y: float, z: float) -> None:
    vector = np.array([x, y, z])
    angle = float(np.linalg.norm(vector))
    across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turned = (
        np.eye(3)
        + np.sinc(angle / np.pi) * across
        + 0.5 * np.sinc(angle / 2 / np.pi) ** 2 * across @ across
    )
    np.testing.assert_allclose(rotation_vector(turned), vector, atol=1e-6)


def test_a_yaw_is_a_turn_about_the_vertical() -> None:
    np.testing.assert_allclose(rotation_vector(rotation(yaw=0.3)), [0, 0, 0.3], atol=1e-12)


def errors(grade: str, frames: range) -> tuple[np.ndarray, np.ndarray]:
    imu = Imu.model_validate({"grade": grade})
    found = [sample(STILL, imu, frame=frame) for frame in frames]
    force = np.array([one.specific_force - [0, 0, 9.81] for one in found])
    return force, np.array([one.angular_rate for one in found])


def test_a_cheap_unit_is_as_noisy_as_its_data_sheet() -> None:
    force, rate = errors("low", range(2000))
    np.testing.assert_allclose(np.diff(force, axis=0).std() / math.sqrt(2), 2.634e-3, rtol=0.03)
    np.testing.assert_allclose(np.diff(rate, axis=0).std() / math.sqrt(2), 6.894e-4, rtol=0.03)


def test_better_grades_are_quieter() -> None:
    spread = [errors(grade, range(200))[0].std() for grade in ("low", "mid", "high", "ideal")]
    assert spread == sorted(set(spread), reverse=True)
    assert spread[-1] == pytest.approx(0, abs=1e-12)


def test_an_error_depends_on_its_frame_alone() -> None:
    forward, _ = errors("low", range(5))
    alone, _ = errors("low", range(4, 5))
    np.testing.assert_array_equal(forward[4], alone[0])
    assert (forward[3] != forward[4]).all()


def forces_at_rest(frame: int) -> np.ndarray:
    """Errors of the forward accelerometer of 400 good units."""
    return np.array(
        [
            measure(Imu(grade="high"), STILL, TICK_S, key=(unit,), frame=frame).specific_force[0]
            for unit in range(400)
        ]
    )


def test_the_bias_has_its_spread_from_the_start_and_keeps_it() -> None:
    expected = math.hypot(HIGH_GRADE_BIAS, HIGH_GRADE_WHITE)
    assert forces_at_rest(0).std() == pytest.approx(expected, rel=0.1)
    assert forces_at_rest(2000).std() == pytest.approx(expected, rel=0.1)


def test_the_bias_wanders_slowly_and_forgets_in_the_end() -> None:
    first, next_tick, much_later = (forces_at_rest(frame) for frame in (0, 1, 5000))
    assert (next_tick - first).std() == pytest.approx(math.sqrt(2) * HIGH_GRADE_WHITE, rel=0.1)
    assert abs(np.corrcoef(first, much_later)[0, 1]) < 0.15
