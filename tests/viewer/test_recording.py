"""What a recording holds, read back with Rerun's own reader."""

import socket
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from advercity_dsl import Spec
from advercity_dsl.conflict import OutcomeCriteria, StagedActor, StagedConflict
from rerun.chunk import RrdReader

from advercity.conflicts.events import ConflictEvent, find_conflict_events
from advercity.errors import InputError, RunError
from advercity.frames import STATE_DTYPE, Actor, Trace
from advercity.geometry.poses import Matrix
from advercity.roads.lane_segments import LaneSegment
from advercity.semantics import PALETTE
from advercity.sensors.measurements import PointKind
from advercity.viewer.archetypes import LocalGeoMap
from advercity.viewer.cloud_colours import KIND_COLOURS, colour_points
from advercity.viewer.recording import RerunRecording
from tests.builders import SensorFramesOf

FRAMES = 2
LANES = (
    LaneSegment(
        "a.+1",
        "driving",
        left=np.array([[0, 0, 0], [9, 0, 1.0]]),
        right=np.array([[0, -3, 0], [9, -3, 1.0]]),
    ),
)
EVENTS = (
    ConflictEvent(1, "conflict_1: they come near", (3.0, 4.0)),
    ConflictEvent(7, "conflict_2: not as declared", (5.0, 6.0), is_failure=True),
)


@pytest.fixture(scope="module")
def recorded(
    tmp_path_factory: pytest.TempPathFactory, spec: Spec, sensor_frames_of: SensorFramesOf
) -> RrdReader:
    path = tmp_path_factory.mktemp("viewer") / "made" / "on_the_way.rrd"
    with RerunRecording(spec, LANES, file=path, events=EVENTS) as recording:
        for index in range(FRAMES):
            recording.log_frame(sensor_frames_of(index))
    return RrdReader(path)


def logged(recorded: RrdReader, entity: str, component: str) -> dict[int | None, Any]:
    """Values of a component by frame; under None what holds always."""
    found: dict[int | None, Any] = {}
    for chunk in recorded.stream():
        batch = chunk.to_record_batch()
        if chunk.entity_path == f"/{entity}" and component in batch.schema.names:
            static = chunk.is_static
            frames = [None] if static else batch.column("frame").to_pylist()
            found |= dict(zip(frames, batch.column(component).to_pylist(), strict=True))
    return found


def pose_of(recorded: RrdReader, entity: str, frame: int) -> Matrix:
    matrix = np.eye(4)
    columns = np.reshape(logged(recorded, entity, "Transform3D:mat3x3")[frame][0], (3, 3))
    matrix[:3, :3] = columns.T
    matrix[:3, 3] = logged(recorded, entity, "Transform3D:translation")[frame][0]
    return matrix


def test_the_recording_has_the_id_of_the_spec(recorded: RrdReader, spec: Spec) -> None:
    (entry,) = recorded.recordings()
    assert (entry.application_id, entry.recording_id) == ("advercity", spec.id)


def test_the_recording_has_a_blueprint(recorded: RrdReader) -> None:
    assert len(recorded.blueprints()) == 1


def test_every_agent_has_cameras_semantics_and_points(recorded: RrdReader, spec: Spec) -> None:
    paths = set(recorded.store().schema().entity_paths())
    for agent in spec.agents:
        assert f"/world/{agent.id}/lidar" in paths
        assert {f"/world/{agent.id}/camera{index}" for index in range(4)} <= paths
        assert {f"/semantic/{agent.id}/camera{index}" for index in range(4)} <= paths


@pytest.mark.parametrize("number", range(5))
def test_sensors_are_at_their_poses(
    recorded: RrdReader, sensor_frames_of: SensorFramesOf, number: int
) -> None:
    reading = sensor_frames_of(1)[number]
    path = f"world/{reading.agent.id}"
    world_from_agent = pose_of(recorded, path, 1)
    lidar = world_from_agent @ pose_of(recorded, f"{path}/lidar", 1)
    camera = world_from_agent @ pose_of(recorded, f"{path}/camera2", 1)
    np.testing.assert_allclose(lidar, reading.world_from_lidar, atol=1e-4)
    np.testing.assert_allclose(camera, reading.camera_images[2].world_from_camera, atol=1e-4)


def test_points_are_those_of_the_lidar(
    recorded: RrdReader, sensor_frames_of: SensorFramesOf
) -> None:
    points = logged(recorded, "world/cav2/lidar", "Points3D:positions")
    np.testing.assert_array_equal(points[1], sensor_frames_of(1)[1].point_cloud.points)


def test_points_are_coloured_by_intensity_class_or_kind(sensor_frames_of: SensorFramesOf) -> None:
    cloud = sensor_frames_of(0)[0].point_cloud
    np.testing.assert_array_equal(colour_points(cloud, "class"), PALETTE[cloud.semantic])
    by_kind = colour_points(cloud, "kind")
    ghosts = cloud.kind == PointKind.GHOST
    assert ghosts.any()
    assert (by_kind[ghosts] == KIND_COLOURS[PointKind.GHOST]).all()
    assert (by_kind[~ghosts] == KIND_COLOURS[PointKind.SURFACE]).all()
    warm, cold = np.argmax(cloud.intensity), np.argmin(cloud.intensity)
    by_intensity = colour_points(cloud, "intensity").astype(int)
    assert (by_intensity[warm] - by_intensity[cold])[0] > (by_intensity[warm] - by_intensity[cold])[
        2
    ]


def test_images_are_complete_and_semantics_exact(
    recorded: RrdReader, sensor_frames_of: SensorFramesOf
) -> None:
    image = sensor_frames_of(0)[4].camera_images[3]
    assert decoded(recorded, "world/rsu2/camera3").shape == image.image.shape
    np.testing.assert_array_equal(
        decoded(recorded, "semantic/rsu2/camera3"), PALETTE[image.semantic]
    )


def decoded(recorded: RrdReader, entity: str) -> Any:
    blob = np.array(logged(recorded, entity, "EncodedImage:blob")[0][0], dtype=np.uint8)
    image = cv2.imdecode(blob, cv2.IMREAD_COLOR)
    assert image is not None
    return image[..., ::-1]


def test_actors_are_boxes_annotated_or_not(
    recorded: RrdReader, sensor_frames_of: SensorFramesOf
) -> None:
    seen = logged(recorded, "world/actors/seen", "Boxes3D:labels")[0]
    unseen = logged(recorded, "world/actors/unseen", "Boxes3D:labels")[0]
    assert "pedestrian 203" in seen
    assert unseen == ["truck 204"]
    assert len(seen) + len(unseen) == len(sensor_frames_of(0)[0].frame.states)


def test_boxes_enclose_their_actors(recorded: RrdReader, sensor_frames_of: SensorFramesOf) -> None:
    states = sensor_frames_of(1)[0].frame.states
    seen = [state for state in states if state.actor.id != 204]
    entity = "world/actors/seen"
    centres = logged(recorded, entity, "Boxes3D:centers")[1]
    halves = logged(recorded, entity, "Boxes3D:half_sizes")[1]
    turns = logged(recorded, entity, "Boxes3D:quaternions")[1]
    for state, centre, half, turn in zip(seen, centres, halves, turns, strict=True):
        np.testing.assert_allclose(centre, state.box_centre, atol=1e-5)
        np.testing.assert_allclose(half, np.divide(state.actor.size, 2), rtol=1e-6)
        ahead = turned((1.0, 0.0, 0.0), turn)
        np.testing.assert_allclose(ahead, state.world_from_body[:3, 0], atol=1e-6)
        up = turned((0.0, 0.0, 1.0), turn)
        np.testing.assert_allclose(up, state.world_from_body[:3, 2], atol=1e-6)


def turned(vector: tuple[float, float, float], xyzw: list[float]) -> Any:
    """A vector under a unit quaternion: v + 2 q x (q x v + w v)."""
    axis, w = np.array(xyzw[:3]), xyzw[3]
    return vector + 2 * np.cross(axis, np.cross(axis, vector) + w * np.array(vector))


def test_the_road_is_static(recorded: RrdReader) -> None:
    strips = logged(recorded, "world/road", "LineStrips3D:strips")[None]
    np.testing.assert_array_equal(strips, [LANES[0].left, LANES[0].right])


def test_motion_is_plotted_for_vehicles_only(recorded: RrdReader) -> None:
    assert logged(recorded, "plots/speed/cav1", "Scalars:scalars") == {0: [10.0], 1: [10.0]}
    assert logged(recorded, "plots/acceleration/cav1", "Scalars:scalars")[0] == [0.5, 0.25, 9.81]
    assert logged(recorded, "plots/latitude/cav3", "Scalars:scalars")[1] == [49.000001]
    paths = recorded.store().schema().entity_paths()
    assert not [path for path in paths if path.startswith("/plots") and "rsu" in path]


def test_vehicles_have_past_and_planned_trajectories(
    recorded: RrdReader, sensor_frames_of: SensorFramesOf
) -> None:
    entity = "world/trajectories/driven/cav1"
    driven = logged(recorded, entity, "LineStrips3D:strips")
    origins = [sensor_frames_of(index)[0].world_from_agent[:3, 3] for index in range(FRAMES)]
    assert driven[0] == []
    np.testing.assert_allclose(driven[1], [origins], atol=1e-4)
    planned = logged(recorded, "world/trajectories/planned/cav1", "LineStrips3D:strips")[1]
    path = [point[:2] for point in sensor_frames_of(1)[0].planned_trajectory]
    np.testing.assert_allclose(np.array(planned[0])[1:, :2], path, atol=1e-4)
    paths = recorded.store().schema().entity_paths()
    assert not [path for path in paths if path.startswith("/world/trajectories") and "rsu" in path]


def test_receivers_are_on_the_plan_of_the_road(recorded: RrdReader, spec: Spec) -> None:
    assert len(logged(recorded, "map/cav3", "Points2D:positions")) == FRAMES
    tracks = logged(recorded, "map/cav3/track", "LineStrips2D:strips")
    assert [len(strips) for strips in tracks.values()] == [0, 1]
    left, _ = logged(recorded, "map/road", "LineStrips2D:strips")[None]
    np.testing.assert_allclose(left, [(x, -y) for x, y, _ in LANES[0].left], atol=1e-4)
    around = LocalGeoMap.around_road(spec.road)
    points = np.array([(30.0, -40.0, 0.0), (0.0, 200.0, 0.0)])
    fixes = [(row[0], row[1]) for row in around.to_degrees(points).tolist()]
    np.testing.assert_allclose(around.to_metres(fixes), points[:, :2], atol=1e-6)


def test_with_map_tiles_receivers_and_road_are_in_degrees(
    tmp_path: Path, sensor_frames_of: SensorFramesOf, spec: Spec
) -> None:
    path = tmp_path / "tiles.rrd"
    with RerunRecording(spec, LANES, file=path, map_tiles=True) as recording:
        for index in (0, 1):
            recording.log_frame(sensor_frames_of(index))
    tiled = RrdReader(path)
    fixes = logged(tiled, "map/cav3", "GeoPoints:positions")
    assert [fix[0][0] for fix in fixes.values()] == pytest.approx([49.0, 49.000001], abs=1e-7)
    tracks = logged(tiled, "map/cav3/track", "GeoLineStrings:line_strings")
    assert [len(strips) for strips in tracks.values()] == [0, 1]
    left, _ = logged(tiled, "map/road", "GeoLineStrings:line_strings")[None]
    origin = (spec.road.origin_lat_deg, spec.road.origin_lon_deg)
    assert left[0] == pytest.approx(origin)
    east_deg = 9.0 / (111_319.5 * np.cos(np.deg2rad(origin[0])))
    assert left[1][1] - origin[1] == pytest.approx(east_deg, rel=0.01)


def test_only_returns_of_surfaces_are_large(
    recorded: RrdReader, sensor_frames_of: SensorFramesOf
) -> None:
    radii = np.abs(logged(recorded, "world/cav1/lidar", "Points3D:radii")[0])
    is_surface = sensor_frames_of(0)[0].point_cloud.kind == PointKind.SURFACE
    assert radii[~is_surface].max() < radii[is_surface].min() / 2


def test_marks_of_conflicts_hide_their_labels(recorded: RrdReader) -> None:
    assert logged(recorded, "world/conflicts", "Points3D:show_labels")[1] == [False]


def test_the_weather_is_plotted_in_every_frame(recorded: RrdReader, spec: Spec) -> None:
    visibility = logged(recorded, "weather/visibility_m", "Scalars:scalars")
    assert spec.weather.fog.mor_m is not None
    assert visibility[0] == visibility[1]
    assert visibility[0][0] == pytest.approx(spec.weather.fog.mor_m, rel=0.1)
    assert logged(recorded, "weather/rain_mm_h", "Scalars:scalars")[1] == [0.0]
    (illuminance,) = logged(recorded, "weather/illuminance_lx", "Scalars:scalars")[0]
    assert 1_000 < illuminance < 120_000


def test_conflicts_are_logged_when_they_happen(recorded: RrdReader) -> None:
    assert logged(recorded, "events", "TextLog:text") == {1: ["conflict_1: they come near"]}
    mark = logged(recorded, "world/conflicts", "Points3D:positions")
    assert list(mark) == [1]
    assert mark[1][0][:2] == [3.0, 4.0]


def test_times_are_those_of_the_scenario(recorded: RrdReader) -> None:
    times = logged(recorded, "world/cav1", "time")
    assert [value.total_seconds() for value in times.values()] == [6.0, 6.1]


def test_events_are_the_extremes_of_an_encounter(spec: Spec) -> None:
    """The ego goes east at 10 m/s through the origin at 2 s, a walker north a second later."""
    ego, walker, ticks, tick_s = 101, 4001, 60, 0.1
    time_s = np.arange(ticks) * tick_s
    rows = np.zeros((ticks, 2), STATE_DTYPE)
    rows["tick"], rows["actor"] = np.arange(ticks)[:, None], np.arange(2)
    rows["x"][:, 0], rows["speed"][:, 0] = 10 * time_s - 20, 10
    rows["y"][:, 1], rows["speed"][:, 1] = 2 * (time_s - 3), 2
    rows["travelled"] = np.column_stack([10 * time_s, 2 * time_s])
    rows["yaw"][:, 1] = np.pi / 2
    actors = (
        Actor(ego, "car", "saloon", "car_paint_blue", (4.0, 2.0, 1.5)),
        Actor(walker, "pedestrian", "adult", "cloth_dark", (0.5, 0.5, 1.8)),
    )
    trace = Trace(tick_s, 60, actors, rows.ravel(), (), np.zeros((ticks, 0), np.uint8))
    staged = StagedConflict.model_construct(
        id="conflict_1",
        conflict="ped_crossing",
        stages=("nhtsa2019:10",),
        actors=(
            StagedActor.model_construct(
                number=walker, behaviour="stops_short", path_m=((0.0, -6.0), (0.0, 6.0))
            ),
        ),
        point_m=(0.0, 0.0),
        parameters={"arrival_offset_s": 1.0},
        outcome=OutcomeCriteria(
            arrival_tolerance_s=0.3, time_to_collision_below_s=6.0, post_encroachment_s=None
        ),
    )
    events = find_conflict_events(spec.model_copy(update={"conflicts": (staged,)}), trace)
    assert [event.frame for event in events] == sorted(event.frame for event in events)
    assert all(event.point_m == (0.0, 0.0) for event in events)
    (failure,) = [event for event in events if event.is_failure]
    assert failure.frame == 20
    assert "conflict_1 (ped_crossing), actor 4001: not as declared" in failure.text
    (nearest,) = [event for event in events if "minimum distance" in event.text]
    # At 2.2 s the ego's rear is at x = 0 and the walker's front at y = -1.35, 0.35 m from its side.
    assert nearest.frame == 22
    assert nearest.text.endswith("0.35 m")


def test_a_frame_without_annotations_clears_the_boxes(
    tmp_path: Path, spec: Spec, sensor_frames_of: SensorFramesOf
) -> None:
    path = tmp_path / "nobody.rrd"
    blind = [
        reading.with_readings(lidar=(replace(reading.lidar_scans[0], hits={}),))
        for reading in sensor_frames_of(1)
    ]
    with RerunRecording(spec, (), file=path) as recording:
        recording.log_frame(sensor_frames_of(0))
        recording.log_frame(blind)
    labels = logged(RrdReader(path), "world/actors/seen", "Boxes3D:labels")
    assert len(labels[0]) == 6
    assert labels[1] == []


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def test_viewers_on_this_machine_can_connect_while_it_is_open(
    spec: Spec, sensor_frames_of: SensorFramesOf
) -> None:
    port = free_port()
    with RerunRecording(spec, LANES, serve=True, port=port) as recording:
        assert recording.address == f"rerun+http://127.0.0.1:{port}/proxy"
        recording.log_frame(sensor_frames_of(0))
        connect(port)
        with (
            pytest.raises(RunError, match=f"port {port} is taken"),
            RerunRecording(spec, LANES, serve=True, port=port),
        ):
            pass


def test_a_recording_can_be_sent_to_a_running_server(
    spec: Spec, sensor_frames_of: SensorFramesOf
) -> None:
    port = free_port()
    with RerunRecording(spec, LANES, serve=True, port=port):
        connect(port)
        with RerunRecording(spec, LANES, connect=f"127.0.0.1:{port}") as sender:
            assert sender.address is None
            sender.log_frame(sensor_frames_of(0))


def connect(port: int) -> None:
    for _ in range(100):
        try:
            return socket.create_connection(("127.0.0.1", port), timeout=1).close()
        except ConnectionRefusedError:
            time.sleep(0.05)
    raise AssertionError("nobody listens")


def test_an_absent_viewer_is_reported_at_once(spec: Spec) -> None:
    with pytest.raises(RunError, match="no Rerun viewer answers"):
        RerunRecording(spec, LANES, connect=f"127.0.0.1:{free_port()}")


@pytest.mark.parametrize("address", ["http://here", "127.0.0.1:many", "ftp://127.0.0.1:9/proxy"])
def test_an_invalid_address_is_refused(spec: Spec, address: str) -> None:
    with pytest.raises(InputError, match="not an address of a Rerun viewer"):
        RerunRecording(spec, LANES, connect=address)


def test_a_folder_is_refused_as_a_recording(spec: Spec, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=f"{tmp_path}: is a folder"):
        RerunRecording(spec, LANES, file=tmp_path)


def test_a_spec_is_not_overwritten_by_a_recording(spec: Spec, tmp_path: Path) -> None:
    path = tmp_path / "spec.json"
    path.write_text("{}")
    with pytest.raises(InputError, match=r"name a file ending in \.rrd"):
        RerunRecording(spec, LANES, file=path)
    assert path.read_text() == "{}"


def test_a_recording_replaces_no_file_of_others(spec: Spec, tmp_path: Path) -> None:
    mine = {"scene.rrd": "mine", "scene.rrd.partial": "mine, too"}
    for name, text in mine.items():
        (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=r"scene\.rrd: exists, and there is no record"):
        RerunRecording(spec, LANES, file=tmp_path / "scene.rrd")
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == mine


def test_a_file_that_cannot_be_written_is_named(spec: Spec, tmp_path: Path) -> None:
    (tmp_path / "in the way").write_text("")
    with pytest.raises(RunError, match="in the way"):
        RerunRecording(spec, LANES, file=tmp_path / "in the way" / "scene.rrd")


def test_two_recordings_of_a_run_have_equal_content(
    spec: Spec, sensor_frames_of: SensorFramesOf, tmp_path: Path
) -> None:
    """By Rerun's own comparison; row ids, which are times, and the order of rows mean nothing."""
    for name in ("first.rrd", "second.rrd"):
        with RerunRecording(spec, LANES, file=tmp_path / name, events=EVENTS) as recording:
            recording.log_frame(sensor_frames_of(0))
    command = [sys.executable, "-m", "rerun", "rrd", "compare", "--unordered"]
    subprocess.run([*command, "first.rrd", "second.rrd"], cwd=tmp_path, check=True)


def test_a_recording_is_complete_or_absent(spec: Spec, tmp_path: Path) -> None:
    file = tmp_path / "scene.rrd"
    with pytest.raises(KeyError), RerunRecording(spec, LANES, file=file):
        raise KeyError
    assert list(tmp_path.iterdir()) == []
    with RerunRecording(spec, LANES, file=file):
        assert not file.exists()
    assert list(tmp_path.iterdir()) == [file]
