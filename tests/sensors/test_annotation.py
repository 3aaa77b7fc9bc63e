from dataclasses import fields, replace

import numpy as np
import pytest

from advercity.dataset.boxes import parse_boxes
from advercity.dataset.frame_documents import build_frame_description
from advercity.frames import Actor, ActorState, Lamp
from advercity.geometry import poses
from advercity.geometry.boxes import Box
from advercity.sensors.annotation import Annotation, annotate_actors
from advercity.sensors.measurements import PointCloud, PointKind, RadarDetections
from advercity.sensors.sensor_frame import CameraImage, RadarScan, SensorFrame
from tests.builders import SensorFramesOf


@pytest.fixture
def ego(sensor_frames_of: SensorFramesOf) -> SensorFrame:
    return sensor_frames_of(0)[0]


def annotated(reading: SensorFrame) -> dict[int, Annotation]:
    return {item.state.actor.id: item for item in annotate_actors(reading)}


def among(reading: SensorFrame, *states: ActorState, hits: int = 1) -> SensorFrame:
    """The same agent, level at the origin and facing north, with only itself and these."""
    own = replace(reading.frame.get_state(reading.agent.number), world_from_body=north)
    return replace(
        reading,
        frame=replace(reading.frame, states=(own, *states)),
        world_from_agent=north,
    ).with_readings(
        lidar=(replace(reading.lidar_scans[0], hits={state.actor.id: hits for state in states}),)
    )


north = poses.pose_matrix((0, 0, 0), yaw=np.pi / 2)


def car_at(x: float, y: float, *, yaw: float = 0.0, number: int = 300) -> ActorState:
    actor = Actor(number, "car", "sedan", "car_paint_red", (4.0, 2.0, 1.5))
    return ActorState(actor, poses.pose_matrix((x, y, 0), yaw=yaw), 5.0, 0.0, Lamp.LOW_BEAM)


def test_every_other_actor_that_is_hit_and_near_is_annotated(ego: SensorFrame) -> None:
    assert set(annotated(ego)) == {102, 103, 201, 202, 203}


def test_roadside_units_annotate_all_connected_vehicles(sensor_frames_of: SensorFramesOf) -> None:
    assert {101, 102, 103} <= set(annotated(sensor_frames_of(0)[3]))


def test_an_actor_without_hits_is_not_annotated(ego: SensorFrame) -> None:
    assert set(
        annotated(ego.with_readings(lidar=(replace(ego.lidar_scans[0], hits={201: 1, 202: 0}),)))
    ) == {201}


@pytest.mark.parametrize(("distance_m", "expected"), [(199.9, {300}), (200.0, set[int]())])
def test_lidar_range_is_an_open_bound(
    ego: SensorFrame, distance_m: float, expected: set[int]
) -> None:
    assert set(annotated(among(ego, car_at(0, distance_m)))) == expected


def test_distance_is_from_the_true_pose_of_a_drifting_unit(
    sensor_frames_of: SensorFramesOf,
) -> None:
    unit = sensor_frames_of(0)[3]
    assert not np.allclose(unit.estimated_world_from_agent, unit.world_from_agent)
    car = annotated(unit)[103]
    expected = np.linalg.norm(car.location - unit.world_from_agent[:3, 3])
    assert car.distance_m == pytest.approx(float(expected))


@pytest.mark.parametrize(
    ("x", "y", "bearing_deg"), [(0, 30, 0), (-30, 0, 90), (30, 0, -90), (20, 20, -45)]
)
def test_bearing_is_the_direction_from_the_agent(
    ego: SensorFrame, x: float, y: float, bearing_deg: float
) -> None:
    item = annotated(among(ego, car_at(x, y)))[300]
    assert np.rad2deg(item.bearing_rad) == pytest.approx(bearing_deg)


@pytest.mark.parametrize(
    ("x", "y", "bearing_deg"), [(0, 30, 0), (-30, 0, 90), (20, 20, -45), (-20, -20, 135)]
)
def test_bearing_is_horizontal_on_a_tilted_mast(
    ego: SensorFrame, x: float, y: float, bearing_deg: float
) -> None:
    tilted = poses.pose_matrix((0, 0, 6), yaw=np.pi / 2, pitch=0.5, roll=0.2)
    item = annotated(replace(among(ego, car_at(x, y)), world_from_agent=tilted))[300]
    assert np.rad2deg(item.bearing_rad) == pytest.approx(bearing_deg)


def test_a_box_follows_the_stride_and_its_location_does_not(ego: SensorFrame) -> None:
    """A person walks with 1.4 m/s; its box swings by 0.1 m, as differences of its middles do."""
    actor = Actor(300, "pedestrian", "person", "cloth_red", (0.8, 0.5, 1.7))
    found: list[Annotation] = []
    for tick, swing_m in enumerate((0.0, 0.1, -0.1, 0.05)):
        pose = poses.pose_matrix((10, 0.14 * tick, 0.15), yaw=np.pi / 2)
        box = Box((0.4 + swing_m, 0.5, 1.7), (swing_m, 0.0, 0.85))
        walks = ActorState(actor, pose, 1.4, 0.0, Lamp(0), pose_box=box)
        found.append(annotated(among(ego, walks))[300])

    locations = np.array([item.location for item in found])
    np.testing.assert_allclose(np.diff(locations, axis=0), [[0, 0.14, 0]] * 3, atol=1e-12)
    np.testing.assert_allclose(locations[0], [10, 0, 0.15 + 0.85])
    described = [
        build_frame_description(among(ego, item.state), [item])["walkers"][300] for item in found
    ]
    tight = parse_boxes(dict(enumerate(described)))
    assert tight.world_from_box[1, :3, 3] == pytest.approx([10, 0.14 + 0.1, 1.0])
    steady = tight.steady(dict.fromkeys(range(4), actor.size))
    np.testing.assert_allclose(steady.world_from_box[:, :3, 3], locations, atol=1e-9)
    np.testing.assert_allclose(steady.sizes, [actor.size] * 4)


def points_on(reading: SensorFrame, kinds: list[PointKind]) -> SensorFrame:
    """The same reading with a point of each of these kinds on actor 300."""
    count, cloud = len(kinds), reading.point_cloud
    points = PointCloud(
        *(getattr(cloud, item.name)[:count].copy() for item in fields(PointCloud)),
    )
    points.instance[:], points.kind[:] = 300, kinds
    return reading.with_readings(lidar=(replace(reading.lidar_scans[0], point_cloud=points),))


def test_points_of_mirror_images_are_counted_apart(ego: SensorFrame) -> None:
    kinds = [PointKind.SURFACE] * 3 + [PointKind.GHOST] * 2
    item = annotated(points_on(among(ego, car_at(0, 20)), kinds))[300]
    assert (item.lidar_points, item.lidar_ghosts) == (3, 2)


@pytest.mark.parametrize(("min_points", "expected"), [(0, {300}), (3, {300}), (4, set[int]())])
def test_actors_with_fewer_points_than_asked_for_are_not_annotated(
    ego: SensorFrame, min_points: int, expected: set[int]
) -> None:
    kinds = [PointKind.SURFACE] * 3 + [PointKind.GHOST] * 2
    reading = points_on(among(ego, car_at(0, 20)), kinds)
    assert set(annotated(replace(reading, min_points=min_points))) == expected


@pytest.mark.parametrize(
    ("yaw_deg", "relative_deg"), [(90, 0), (0, -90), (180, 90), (-90, 180), (-80, -170)]
)
def test_relative_yaw_is_a_difference_of_headings(
    ego: SensorFrame, yaw_deg: float, relative_deg: float
) -> None:
    item = annotated(among(ego, car_at(10, 10, yaw=np.deg2rad(yaw_deg))))[300]
    assert np.rad2deg(item.relative_yaw_rad) == pytest.approx(relative_deg)


def test_location_is_below_a_vehicle_and_in_the_middle_of_a_pedestrian(ego: SensorFrame) -> None:
    objects = annotated(ego)
    van, walker = objects[201], objects[203]
    assert np.linalg.norm(van.centre - van.location) == pytest.approx(2.55 / 2)
    np.testing.assert_array_equal(walker.centre, walker.location)


def test_hits_are_counted(ego: SensorFrame) -> None:
    assert annotated(among(ego, car_at(0, 20), hits=17))[300].lidar_hits == 17


def test_a_roadside_unit_has_no_speed(sensor_frames_of: SensorFramesOf) -> None:
    ego, *_, unit = sensor_frames_of(0)
    assert (ego.speed_m_s, unit.speed_m_s) == (10.0, 0.0)


def test_intrinsics_follow_the_size_of_the_image(ego: SensorFrame) -> None:
    image = replace(ego.camera_images[0], image=np.zeros((1080, 1920, 3), np.uint8))
    full = ego.with_readings(camera=(image,))
    assert full.agent.sensors.cameras[0].model.horizontal_fov_deg == 100
    expected = [[805.5356459, 0, 960], [0, 805.5356459, 540], [0, 0, 1]]
    np.testing.assert_allclose(full.build_camera_model(0).matrix, expected)


def test_without_a_lidar_pixels_and_echoes_decide(ego: SensorFrame) -> None:
    """One pixel is enough, of any image; an outline without a pixel, or an unknown id, is not."""
    whole = next(iter(ego.camera_images[0].projected_boxes.values()))

    def show(image: CameraImage, **visible_px: int) -> CameraImage:
        boxes = {int(k[1:]): replace(whole, visible_px=px) for k, px in visible_px.items()}
        return replace(image, projected_boxes=boxes)

    first, second = ego.camera_images[:2]
    images = (show(first, a102=1, a103=0), show(second, a201=7, a999=5))
    blind = ego.with_readings(lidar=(), camera=images)
    assert set(annotated(blind)) == {102, 201}
    assert {item.lidar_hits + item.lidar_points for item in annotated(blind).values()} == {0}
    none = np.zeros(0, np.float32)
    ids, kinds = np.zeros(0, np.int32), np.zeros(0, np.uint8)
    nothing = RadarDetections(none.reshape(0, 3), none, none, none, ids, kinds)
    radar = RadarScan(north, nothing, seen_actors=frozenset({203}))
    assert set(annotated(blind.with_readings(radar=(radar,)))) == {102, 201, 203}
    assert annotated(ego.with_readings(lidar=(), camera=())) == {}
    assert set(annotated(replace(blind, seen_actors={103}))) == {103}
