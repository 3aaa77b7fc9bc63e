"""When stations send, and whether what they say errs as they say."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from advercity_dsl import Channel, Spec
from advercity_dsl.channel import PerceptionMessage

from advercity.channel.impairments import ChannelRandomness
from advercity.channel.stations import describe_station, find_cam_ticks, perceive_objects
from advercity.frames import STATE_DTYPE, Actor, Trace
from advercity.geometry import poses
from tests.builders import SensorFramesOf

CAV1 = Actor(101, "car", "saloon", "car_paint_white", (4.9, 1.9, 1.5))


def make_trace(x_m: list[float], yaw_deg: list[float], speed_m_s: list[float]) -> Trace:
    states = np.zeros(len(x_m), STATE_DTYPE)
    states["tick"], states["x"] = np.arange(len(x_m)), x_m
    states["yaw"], states["speed"] = np.radians(yaw_deg), speed_m_s
    return Trace(0.1, 60, (CAV1,), states, (), np.zeros((len(x_m), 0), np.uint8))


def find_ticks(spec: Spec, trace: Trace, agent: int = 0) -> list[int]:
    return sorted(find_cam_ticks(spec.agents[agent], trace))


def test_a_vehicle_at_rest_sends_a_cam_every_second(spec: Spec) -> None:
    trace = make_trace([0.0] * 31, [0.0] * 31, [0.0] * 31)
    assert find_ticks(spec, trace) == [0, 10, 20, 30]
    assert find_ticks(spec, trace, agent=3) == [0, 10, 20, 30]


def test_a_vehicle_at_15_m_s_sends_after_more_than_4_m(spec: Spec) -> None:
    """1.5 m a tick: after 3 ticks it has driven 4.5 m."""
    trace = make_trace([1.5 * k for k in range(13)], [0.0] * 13, [15.0] * 13)
    assert find_ticks(spec, trace) == [0, 3, 6, 9, 12]


def test_turns_and_changes_of_speed_are_sent_at_once_and_three_times_more(spec: Spec) -> None:
    """5 deg at tick 2: then at its interval, 0.2 s, three times, and after that every second."""
    trace = make_trace([0.0] * 20, [0.0] * 2 + [5.0] * 18, [0.0] * 20)
    assert find_ticks(spec, trace) == [0, 2, 4, 6, 8, 18]
    braked = make_trace([0.0] * 20, [0.0] * 20, [0.6] * 5 + [0.0] * 15)
    assert find_ticks(spec, braked) == [0, 5, 10, 15]
    # Across the seam of angles, 359.9 and 0.1 deg are no turn.
    seam = make_trace([0.0] * 8, [179.9, -179.9] * 4, [0.0] * 8)
    assert find_ticks(spec, seam) == [0]


def randomness_of(spec: Spec, **fields: Any) -> tuple[Channel, ChannelRandomness]:
    channel = Channel.model_validate({"id": "tested", **fields})
    return channel, ChannelRandomness(spec, channel, duration_s=10.0)


def test_a_station_says_where_it_is_without_pitch_and_with_the_errors_it_was_given(
    spec: Spec, sensor_frames_of: SensorFramesOf
) -> None:
    ego, *_, unit = sensor_frames_of(0)
    channel, randomness = randomness_of(
        spec, pose_error={"white_noise_m": 3, "wander_m": 4, "heading_noise_deg": 2}
    )
    said = describe_station(ego, channel, randomness)
    offset, turn_rad = randomness.draw_pose_error("cav1", 0)
    true_yaw, true_pitch, _ = poses.to_yaw_pitch_roll(ego.world_from_agent)
    yaw, pitch, roll = poses.to_yaw_pitch_roll(said.world_from_station)
    assert abs(true_pitch) > 0.05
    assert (yaw - true_yaw, pitch, roll) == pytest.approx((turn_rad, 0.0, 0.0))
    place = ego.world_from_agent[:3, 3] + offset
    np.testing.assert_allclose(said.world_from_station[:3, 3], place)
    assert said.position_sd_m == pytest.approx((5.0, 5.0, 0.0))
    assert said.heading_sd_rad == pytest.approx(math.radians(2))
    assert (said.station_type, said.speed_m_s, said.size_m) == (5, 10.0, (4.9, 2.06, 1.51))
    surveyed = describe_station(unit, channel, randomness)
    np.testing.assert_allclose(
        surveyed.world_from_station[:3, 3], unit.world_from_agent[:3, 3], atol=1e-12
    )
    assert (surveyed.station_type, surveyed.size_m) == (15, None)
    surveyed_too = channel.model_copy(
        update={"pose_error": channel.pose_error.model_copy(update={"roadside_units": True})}
    )
    moved = describe_station(unit, surveyed_too, randomness).world_from_station
    assert np.linalg.norm(moved[:3, 3] - unit.world_from_agent[:3, 3]) > 0.5


def test_perceived_objects_are_the_annotated_ones_with_enough_points_in_the_stations_frame(
    spec: Spec, sensor_frames_of: SensorFramesOf
) -> None:
    """The street rises by 4 deg; the van is 12 m along it and 5 m to its left, and 2.55 m tall."""
    ego = sensor_frames_of(0)[0]
    _, randomness = randomness_of(spec)
    found = perceive_objects(ego, PerceptionMessage(), randomness)
    assert found.ids.tolist() == [202, 201, 203, 103, 102]
    van = found.ids.tolist().index(201)
    slope = math.radians(4.0)
    ahead_m = 12 * math.cos(slope) - 1.275 * math.sin(slope)
    up_m = 12 * math.sin(slope) + 1.275 * math.cos(slope)
    assert found.centres[van] == pytest.approx((ahead_m, 5.0, up_m), abs=1e-9)
    assert found.classes[van] == "van"
    # It comes at 5 m/s, 5 deg off the opposite direction.
    assert found.velocities_m_s[van] == pytest.approx(
        (-5 * math.cos(math.radians(5)) * math.cos(slope), 5 * math.sin(math.radians(5))), abs=1e-9
    )
    assert not found.position_covariances_m2.any()
    few = perceive_objects(ego, PerceptionMessage(max_objects=2), randomness)
    assert few.ids.tolist() == [202, 201]
    assert not len(perceive_objects(ego, PerceptionMessage(min_points=1000), randomness))


def test_errors_of_bearing_are_across_the_line_of_sight(
    spec: Spec, sensor_frames_of: SensorFramesOf
) -> None:
    """At d metres, 2 deg are a deviation of 0.0349 d across and of nothing along."""
    ego = sensor_frames_of(0)[0]
    _, randomness = randomness_of(spec)
    truth = perceive_objects(ego, PerceptionMessage(), randomness)
    found = perceive_objects(ego, PerceptionMessage(bearing_noise_deg=2), randomness)
    for place, moved, covariance in zip(
        truth.centres[:, :2],
        found.centres[:, :2],
        found.position_covariances_m2,
        strict=True,
    ):
        distance_m = np.linalg.norm(place)
        assert (moved - place) @ place == pytest.approx(0.0, abs=1e-9)
        np.testing.assert_allclose(covariance @ place, 0.0, atol=1e-9)
        assert np.trace(covariance) == pytest.approx((math.radians(2) * distance_m) ** 2)


def test_objects_err_as_their_covariances_say(spec: Spec, sensor_frames_of: SensorFramesOf) -> None:
    """Squared errors of 800 frames and 5 objects, over the covariances, are chi-square."""
    ego = sensor_frames_of(0)[0]
    message = PerceptionMessage(
        range_noise_m=0.5, bearing_noise_deg=2, heading_noise_deg=3, speed_noise_m_s=0.4
    )
    _, randomness = randomness_of(spec)
    truth = perceive_objects(ego, PerceptionMessage(), randomness)
    found = [
        perceive_objects(replace(ego, frame=replace(ego.frame, index=index)), message, randomness)
        for index in range(800)
    ]
    errors = np.array([one.centres - truth.centres for one in found])
    inverse = np.linalg.inv(found[0].position_covariances_m2)
    squared = np.einsum("fni,nij,fnj->fn", errors[..., :2], inverse, errors[..., :2])
    # Chi-square of two degrees has mean 2 and variance 4.
    assert squared.mean() == pytest.approx(2.0, abs=4 * 2.0 / math.sqrt(4000))
    van = truth.ids.tolist().index(201)
    sample = np.cov(errors[:, van, :2].T)
    np.testing.assert_allclose(sample, found[0].position_covariances_m2[van], atol=0.05)
    assert not errors[..., 2].any()
    headings = np.array([one.headings_rad - truth.headings_rad for one in found])
    assert np.degrees(headings.std()) == pytest.approx(3.0, rel=4 / math.sqrt(8000))
    speeds = np.array([one.velocities_m_s - truth.velocities_m_s for one in found])
    assert speeds.std() == pytest.approx(0.4, rel=4 / math.sqrt(16000))
    assert found[0].velocity_sd_m_s == 0.4
