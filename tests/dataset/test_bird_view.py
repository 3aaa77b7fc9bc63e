"""Masks as CoBEVT and HEAL look them up, by the published rules."""

from dataclasses import replace

import numpy as np
import pytest

from advercity.dataset.bird_view import draw_bird_views, find_visible_actors
from advercity.geometry import poses
from advercity.roads.lane_segments import LaneSegment
from advercity.sensors.sensor_frame import SensorFrame
from tests.builders import SensorFramesOf


@pytest.fixture
def readings(sensor_frames_of: SensorFramesOf) -> tuple[SensorFrame, ...]:
    return sensor_frames_of(0)


def place(reading: SensorFrame, number: int) -> tuple[int, int]:
    """Row and column of the middle of an actor's footprint: ahead is up, right is right."""
    is_unit = reading.agent.number < 0
    centre = reading.world_from_lidar if is_unit else reading.world_from_agent
    level = poses.pose_matrix(centre[:3, 3], yaw=poses.to_yaw_pitch_roll(centre)[0])
    origin = reading.frame.get_state(number).world_from_body[:3, 3]
    x, y, _ = poses.transform_points(poses.invert_pose(level), origin)
    return int(128 - x / 0.390625), int(128 - y / 0.390625)


def test_other_vehicles_are_drawn_at_their_positions(readings: tuple[SensorFrame, ...]) -> None:
    for reading, maps in zip(readings, draw_bird_views(readings, ()), strict=True):
        drawn = {
            number
            for number in (101, 102, 103, 201, 202)
            if maps["dynamic"][place(reading, number)] == 255
        }
        assert drawn == {101, 102, 103, 201, 202} - {reading.agent.number}


def test_footprints_have_their_size(readings: tuple[SensorFrame, ...]) -> None:
    """Four vehicles: 2 of 4.9 x 2.06 m, 5.9 x 2 m, 1.5 x 0.86 m, drawn half a pixel wider."""
    area_px = np.count_nonzero(draw_bird_views(readings, ())[0]["dynamic"])
    metres = (4.9 * 2.06 * 2, 5.9 * 2.0, 1.5 * 0.86)
    assert area_px == pytest.approx(sum(metres) / 0.390625**2, rel=0.35)


def test_pedestrians_are_not_drawn(readings: tuple[SensorFrame, ...]) -> None:
    assert draw_bird_views(readings, ())[0]["dynamic"][place(readings[0], 203)] == 0


def test_vehicles_visible_only_to_other_agents_are_in_the_shared_map_only(
    readings: tuple[SensorFrame, ...],
) -> None:
    blind = readings[0].with_readings(
        camera=tuple(replace(one, projected_boxes={}) for one in readings[0].camera_images)
    )
    own, *_ = draw_bird_views((blind, *readings[1:]), ())
    assert not own["visibility"].any()
    seen = find_visible_actors(image for one in readings[1:] for image in one.camera_images)
    for number in (102, 103, 201, 202):
        shown = own["visibility_corp"][place(blind, number)] == 255
        assert shown == (number in seen)
    assert seen & {102, 103, 201, 202}


def test_lanes_are_filled_and_their_borders_drawn_outside_junctions(
    readings: tuple[SensorFrame, ...],
) -> None:
    reading = readings[0]
    line = np.linspace(-20.0, 20.0, 9)
    zeros = np.zeros_like(line)

    def lane(first_y: float, last_y: float, *, in_junction: bool) -> LaneSegment:
        left, right = (
            poses.transform_points(
                reading.world_from_agent, np.stack([line, zeros + y, zeros], axis=1)
            )
            for y in (first_y, last_y)
        )
        return LaneSegment("a", "driving", left, right, in_junction=in_junction)

    lanes = (lane(2.0, -2.0, in_junction=False), lane(12.0, 8.0, in_junction=True))
    maps = draw_bird_views((reading,), lanes)[0]
    row = 128
    ahead, aside = maps["static"][row], maps["lane"][row]
    assert ahead[128] == ahead[128 - round(10 / 0.390625)] == 255
    assert ahead[128 + round(4 / 0.390625)] == 0
    assert aside[128] == 0
    assert aside[128 - 7 : 128 - 3].any()
    assert not aside[: 128 - round(7 / 0.390625)].any()
    assert not maps["static"][:60].any()
