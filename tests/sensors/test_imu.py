"""Specific force, angular rate and compass, and their noise."""

import math
from itertools import pairwise

import numpy as np
import pytest
from advercity_dsl import Imu

from advercity.frames import AT_REST, BodyMotion
from advercity.geometry.poses import Matrix, pose_matrix
from advercity.sensors.imu import measure_imu
from advercity.sensors.measurements import ImuSample

TICK_S = 0.1


HIGH_GRADE_BIAS = 3.6e-6 / 0.6174


HIGH_GRADE_WHITE = 4.2e-7 / math.sqrt(TICK_S)


IDEAL = Imu()


STILL = pose_matrix((1, 2, 0))


def moving(acceleration: tuple[float, ...], rate: tuple[float, ...] = (0, 0, 0)) -> BodyMotion:
    return BodyMotion(np.zeros(3), np.array(acceleration), np.array(rate))


def measure(
    imu: Imu,
    world_from_body: tuple[Matrix, Matrix],
    motions: tuple[BodyMotion, BodyMotion],
    tick_s: float,
    *,
    key: tuple[int | str, ...],
    frame: int,
) -> ImuSample:
    found = measure_imu(imu, world_from_body, motions, tick_s, key=key, frame=frame)
    assert found is not None
    return found


def sample(
    pose: Matrix, imu: Imu = IDEAL, *, motion: BodyMotion = AT_REST, frame: int = 0
) -> ImuSample:
    return measure(imu, (pose, pose), (motion, motion), TICK_S, key=(7, "ego"), frame=frame)


AT_STANDSTILL = (STILL, STILL), (AT_REST, AT_REST)


def test_at_rest_only_gravity_is_measured() -> None:
    found = sample(STILL)
    np.testing.assert_allclose(found.specific_force, [0, 0, 9.81], atol=1e-9)
    np.testing.assert_allclose(found.angular_rate, 0, atol=1e-12)


def test_nose_up_gravity_pushes_forward() -> None:
    pitched = pose_matrix((0, 0, 0), pitch=-math.radians(5))
    np.testing.assert_allclose(sample(pitched).specific_force, [0.855, 0, 9.7727], atol=1e-3)


def test_a_left_turn_accelerates_and_rotates_left() -> None:
    rate, radius = 0.5, 20.0
    inward = -(rate**2) * radius * math.sin(1.0), rate**2 * radius * math.cos(1.0), 0.0
    turn = pose_matrix((radius * math.sin(1.0), -radius * math.cos(1.0), 0), yaw=1.0)
    found = sample(turn, motion=moving(inward, (0, 0, rate)))
    np.testing.assert_allclose(found.specific_force, [0, 5.0, 9.81], atol=1e-9)
    np.testing.assert_allclose(found.angular_rate, [0, 0, 0.5], atol=1e-9)


def test_speeding_up_pushes_forward() -> None:
    found = sample(STILL, motion=moving((3.0, 0, 0)))
    np.testing.assert_allclose(found.specific_force, [3.0, 0, 9.81], atol=1e-9)


@pytest.mark.parametrize(
    ("yaw_deg", "compass_deg"), [(90, 0), (0, 90), (-90, 180), (180, 270), (45, 45)]
)
def test_the_compass_runs_clockwise_from_north(yaw_deg: float, compass_deg: float) -> None:
    facing = pose_matrix((0, 0, 0), yaw=math.radians(yaw_deg))
    turned = math.degrees(sample(facing).compass_rad) - compass_deg
    assert (turned + 180) % 360 - 180 == pytest.approx(0, abs=1e-9)
    assert 0 <= sample(facing).compass_rad < 2 * math.pi


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
            measure(
                Imu(grade="high"), *AT_STANDSTILL, TICK_S, key=(unit,), frame=frame
            ).specific_force[0]
            for unit in range(400)
        ]
    )


def test_the_bias_has_its_spread_from_the_start_and_keeps_it() -> None:
    expected = math.hypot(HIGH_GRADE_BIAS, HIGH_GRADE_WHITE)
    assert forces_at_rest(0).std() == pytest.approx(expected, rel=0.1)
    assert forces_at_rest(2000).std() == pytest.approx(expected, rel=0.1)


def test_the_bias_drifts_slowly_and_forgets_in_the_end() -> None:
    first, next_tick, much_later = (forces_at_rest(frame) for frame in (0, 1, 5000))
    assert (next_tick - first).std() == pytest.approx(math.sqrt(2) * HIGH_GRADE_WHITE, rel=0.1)
    assert abs(np.corrcoef(first, much_later)[0, 1]) < 0.15


def test_a_fast_unit_samples_between_the_frames() -> None:
    imu = Imu(rate_hz=100)
    poses = STILL, pose_matrix((1.1, 2, 0))
    motions = moving((1.0, 0, 0)), moving((2.0, 0, 0))
    found = measure(imu, poses, motions, TICK_S, key=("fast",), frame=2)
    assert len(found.earlier) == 9
    np.testing.assert_allclose([one.time_s for one in found.earlier], np.arange(-9, 0) / 100)
    forces = [one.specific_force for one in (*found.earlier, found)]
    between = np.arange(1.1, 2.05, 0.1)
    np.testing.assert_allclose(forces, [[force, 0, 9.81] for force in between], atol=1e-9)


def test_a_compass_has_the_noise_of_its_rig() -> None:
    imu = Imu(compass_noise_deg=2.0)
    headings = np.degrees([sample(STILL, imu, frame=frame).compass_rad for frame in range(2000)])
    assert headings.std() == pytest.approx(2.0, rel=0.05)
    assert headings.mean() == pytest.approx(90.0, abs=0.2)


def test_noise_is_as_dense_at_a_second_as_the_data_sheet_says() -> None:
    """Allan deviation at 1 s of an hour at 100 Hz; the bias starts anew each second."""
    imu = Imu(grade="low", rate_hz=100)
    hour = 3600
    rows: list[np.ndarray] = []
    for frame in range(0, hour * 10, 10):
        found = measure(imu, *AT_STANDSTILL, TICK_S, key=("allan", frame), frame=0)
        ten = [np.r_[one.specific_force, one.angular_rate] for one in (*found.earlier, found)]
        rows.append(np.mean(ten, axis=0) / math.sqrt(10))
    means = np.array(rows) - np.mean(rows, axis=0)
    deviation = np.sqrt((np.diff(means, axis=0) ** 2).mean(axis=0) / 2)
    np.testing.assert_allclose(deviation[:3], 8.33e-4, rtol=0.1)
    np.testing.assert_allclose(deviation[3:], 2.18e-4, rtol=0.1)


Drive = tuple[list[Matrix], list[BodyMotion]]


def drive(ticks: int) -> Drive:
    """Twenty seconds over a hill and through bends, at 3 to 17 m/s; nose along the way."""
    fine = 20
    time_s = np.arange(-2 * fine, (ticks + 2) * fine) * (TICK_S / fine)
    speed = 10 + 7 * np.sin(0.4 * time_s)
    yaw = 0.6 * np.sin(0.5 * time_s) + 0.05 * time_s
    pitch = -0.06 * np.sin(0.3 * time_s)
    steps = (speed * TICK_S / fine)[:, None] * np.column_stack(
        [np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch)]
    )
    places = np.cumsum(steps, axis=0)
    velocity = np.gradient(places, TICK_S / fine, axis=0)
    acceleration = np.gradient(velocity, TICK_S / fine, axis=0)
    turning, nodding = (np.gradient(angle, TICK_S / fine) for angle in (yaw, pitch))
    rate = np.column_stack([-turning * np.sin(pitch), nodding, turning * np.cos(pitch)])
    ticks_at = range(0, len(time_s), fine)
    return (
        [pose_matrix(places[at], yaw=yaw[at], pitch=pitch[at]) for at in ticks_at],
        [BodyMotion(velocity[at], acceleration[at], rate[at]) for at in ticks_at],
    )


def dead_reckon(imu: Imu, way: Drive, key: str) -> Matrix:
    """Where the unit's samples lead from the first pose, at the speed that it has there."""
    step_s = TICK_S if imu.rate_hz is None else 1 / imu.rate_hz
    poses, motions = way
    where, velocity = poses[2].copy(), motions[2].velocity
    last: ImuSample | None = None
    for tick in range(2, len(poses) - 1):
        found = measure(
            imu,
            (poses[tick - 1], poses[tick]),
            (motions[tick - 1], motions[tick]),
            TICK_S,
            key=(key,),
            frame=tick,
        )
        samples = [found] if last is None else [*found.earlier, found]
        for one in samples:
            if last is not None:
                turn = (last.angular_rate + one.angular_rate) / 2 * step_s
                size = float(np.linalg.norm(turn))
                turned = where[:3, :3] @ rotation_about(turn, size)
                gravity = np.array([0, 0, 9.81])
                was = where[:3, :3] @ last.specific_force - gravity
                now = turned @ one.specific_force - gravity
                where[:3, 3] += velocity * step_s + (2 * was + now) / 6 * step_s**2
                velocity = velocity + (was + now) / 2 * step_s
                where[:3, :3] = turned
            last = one
    return where


def rotation_about(vector: np.ndarray, angle: float) -> np.ndarray:
    x, y, z = vector
    across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return (
        np.eye(3)
        + np.sinc(angle / np.pi) * across
        + 0.5 * np.sinc(angle / 2 / np.pi) ** 2 * across @ across
    )


@pytest.mark.parametrize("rate_hz", [None, 100])
def test_an_ideal_unit_gives_the_path_of_twenty_seconds_back(rate_hz: float | None) -> None:
    way = drive(200)
    end = dead_reckon(Imu(rate_hz=rate_hz), way, "ideal")
    poses = way[0]
    travelled = sum(float(np.linalg.norm(b[:3, 3] - a[:3, 3])) for a, b in pairwise(poses))
    off = end[:3, 3] - poses[-2][:3, 3]
    assert travelled > 150
    assert np.linalg.norm(off) < 0.005 * travelled
    np.testing.assert_allclose(end[:3, :3], poses[-2][:3, :3], atol=2e-3)


def test_a_cheap_unit_gives_the_path_back_within_its_noise() -> None:
    """Of twenty units: the gyroscopes' bias tilts gravity, t³/6; the rest is less."""
    way = drive(200)
    exact = dead_reckon(Imu(), way, "exact")[:3, 3]
    ends = [dead_reckon(Imu(grade="low"), way, f"unit {unit}")[:3, 3] for unit in range(20)]
    spread = np.sqrt(((np.array(ends) - exact) ** 2).mean(axis=0))
    time_s, gravity = 20.0, 9.81
    by_bias = gravity * math.radians(10 / 3600) * time_s**3 / 6
    by_gyro_noise = gravity * 2.18e-4 * math.sqrt(time_s**5 / 20)
    by_noise = 8.33e-4 * math.sqrt(time_s**3 / 3)
    expected = math.sqrt(by_bias**2 + by_gyro_noise**2 + by_noise**2)
    assert 0.4 * expected < np.linalg.norm(spread[:2]) / math.sqrt(2) < 1.8 * expected
    assert spread[2] < expected
