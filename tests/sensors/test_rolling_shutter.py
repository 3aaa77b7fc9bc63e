"""Rolling shutters, blur and rates against places computed by hand, through a scenario's rig."""

import math
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from advercity_dsl import Camera, Exposure, Mount, Shutter, Spec
from advercity_dsl.lens import KannalaBrandtLens
from pydantic import ValidationError

from advercity.compiler import with_digest
from advercity.dataset.reader import open_dataset
from advercity.exports.exporting import export_dataset
from advercity.frames import STATE_DTYPE, Actor, Trace
from advercity.geometry.mesh import Mesh
from advercity.geometry.poses import interpolate_poses, invert_pose, transform_points
from advercity.pipeline.preparation import PreparedScenario, TrafficResult
from advercity.pipeline.sensing import SensorRig
from advercity.rendering.backend import RenderProfile
from advercity.sensors.camera_model import CameraModel
from advercity.sensors.sensor_frame import CameraImage
from advercity.testing import CAR, FakeBackend, build_box, build_flat_world, load_example_spec
from tests.builders import write_scenario
from tests.sensors.cast_renderer import CastRenderer

EGO, OTHER = 101, 7
READOUT_MS, SPEED_M_S, DISTANCE_M = 30.0, 15.0, 10.0
WIDTH, HEIGHT, FOV_DEG = 160, 120, 30.0
FOCAL_PX = WIDTH / (2 * math.tan(math.radians(FOV_DEG / 2)))
FINE = Shutter(readout_ms=READOUT_MS, bands=40)
"""Bands of three rows."""


DOWN = Mount(z_m=1.5, pitch_deg=8)


def make_camera(shutter: Shutter | None, **fields: object) -> Camera:
    """A camera 1.5 m over the origin of its carrier, level."""
    return Camera.model_validate(
        {
            "width_px": WIDTH,
            "height_px": HEIGHT,
            "horizontal_fov_deg": FOV_DEG,
            "shutter": shutter,
            "mounts": (Mount(z_m=1.5),),
            **fields,
        }
    )


def make_trace(*rows: dict[str, float]) -> Trace:
    """Three ticks of cars that keep speed and rate of turn; values are those of the middle one."""
    actors = tuple(
        Actor(int(row["id"]), "car", "car", "car_paint_red", (4.0, 2.0, 1.5)) for row in rows
    )
    states = np.zeros((3, len(rows)), STATE_DTYPE)
    states["tick"], states["actor"] = np.arange(3)[:, None], np.arange(len(rows))
    for column, row in enumerate(rows):
        for tick, time_s in enumerate((-0.1, 0.0, 0.1)):
            one = states[tick : tick + 1, column]
            for name, value in row.items():
                if name != "id":
                    one[name] = value
            for place, speed in (("x", "vx"), ("y", "vy"), ("yaw", "yaw_rate")):
                one[place] += time_s * row.get(speed, 0.0)
    return Trace(0.1, 0, actors, states.ravel(), (), np.zeros((3, 0), np.uint8))


def open_rig(camera: Camera, trace: Trace, *static: Mesh) -> tuple[SensorRig, CastRenderer, Spec]:
    """Open a scenario of the ego alone, with one kind of camera and a small LiDAR."""
    spec = load_example_spec("ui_clear_day_sparse")
    ego = next(agent for agent in spec.agents if agent.number == EGO)
    lidar = ego.sensors.lidars[0].model_copy(
        update={"channels": 1, "azimuths": 16, "channel_table": "uniform"}
    )
    sensors = ego.sensors.model_copy(
        update={"camera": camera, "more_cameras": {}, "lidar": lidar, "more_lidars": {}}
    )
    road = spec.road.model_copy(update={"surroundings": ()})
    alone = {"agents": (ego.model_copy(update={"sensors": sensors}),), "road": road}
    spec = with_digest(spec.model_copy(update=alone))
    world = build_flat_world(*static)
    profile = RenderProfile("cast", 1.0, "raster")
    traffic = TrafficResult(Path("none"), trace, "0" * 64)
    prepared = PreparedScenario(spec, traffic, FakeBackend(), profile, range(3))
    renderer = CastRenderer(world)
    return SensorRig(prepared, renderer, world), renderer, spec


def capture(camera: Camera, trace: Trace, *static: Mesh) -> CameraImage:
    """Capture the middle tick by the ego's camera."""
    rig, _, _ = open_rig(camera, trace, *static)
    return rig.capture_frame(1)[0].camera_images[0]


def crossing(speed_m_s: float = SPEED_M_S) -> Trace:
    """A car that crosses to the left, its side 10 m ahead of the resting ego."""
    ahead = DISTANCE_M + CAR.size[1] / 2
    return make_trace(
        {"id": EGO},
        {"id": OTHER, "x": ahead, "yaw": math.pi / 2, "vy": speed_m_s, "speed": abs(speed_m_s)},
    )


def find_edges(image: CameraImage, row: int) -> tuple[int, int]:
    """Find the first column of the crossing car in a row, and the one after its last."""
    assert image.instance is not None
    columns = np.flatnonzero(image.instance[row] == OTHER)
    return int(columns[0]), int(columns[-1]) + 1


def test_a_passing_car_leans_by_its_speed_times_the_readout() -> None:
    image = capture(make_camera(FINE, truth=("instance",)), crossing())
    # Its side spans 2 m to both sides, and moves 0.45 m, or 13.4 pixels, in the readout.
    assert pytest.approx(13.44, abs=0.01) == FOCAL_PX * SPEED_M_S * READOUT_MS / 1000 / DISTANCE_M
    for row in (65, 80, 100):
        moved_m = SPEED_M_S * READOUT_MS / 1000 * ((row + 0.5) / HEIGHT - 0.5)
        left, right = find_edges(image, row)
        # What is to the left has smaller columns.
        assert left == pytest.approx(WIDTH / 2 - FOCAL_PX * (2 + moved_m) / DISTANCE_M, abs=1)
        assert right == pytest.approx(WIDTH / 2 + FOCAL_PX * (2 - moved_m) / DISTANCE_M, abs=1)


def test_poles_lean_as_the_ego_turns() -> None:
    rate = 0.8
    trace = make_trace({"id": EGO, "yaw_rate": rate})
    pole = build_box((0.2, 0.2, 20.0), (20.0, 0.0, 5.0))
    image = capture(make_camera(FINE), trace, pole)
    for row in (5, 30, 60):
        columns = np.flatnonzero(image.depth_cm[row] < 2100)
        turned = rate * READOUT_MS / 1000 * ((row + 0.5) / HEIGHT - 0.5)
        # The ego turns left, so the pole moves right.
        assert columns.mean() + 0.5 == pytest.approx(
            WIDTH / 2 + FOCAL_PX * math.tan(turned), abs=0.5
        )


@pytest.mark.parametrize("lens", [None, KannalaBrandtLens(model="kannala_brandt", k1=-0.02)])
def test_boxes_and_points_land_on_rolling_pictures(lens: KannalaBrandtLens | None) -> None:
    """The car approaches obliquely while the ego turns and drives: everything moves."""
    trace = make_trace(
        {"id": EGO, "vx": 12.0, "yaw_rate": -0.5, "speed": 12.0},
        {"id": OTHER, "x": 20.0, "y": 2.0, "yaw": 2.5, "vx": -12.0, "vy": 9.0, "speed": 15.0},
    )
    corner = build_box((0.3, 0.3, 0.3), (13.0, -1.5, 0.4))
    camera = make_camera(FINE, truth=("instance",), lens=lens, mounts=(DOWN,))
    image = capture(camera, trace, corner)
    box = image.projected_boxes[OTHER]
    assert box.visible_box is not None
    np.testing.assert_allclose(box.outline_box, box.visible_box, atol=1)
    # A global shutter's box is elsewhere.
    still = capture(camera.model_copy(update={"shutter": None}), trace, corner)
    box_at_instant = still.projected_boxes[OTHER].outline_box
    assert np.abs(np.subtract(box_at_instant, box.visible_box)).max() > 2

    assert image.rolling is not None
    model = CameraModel.build(camera, WIDTH, HEIGHT)
    points = np.array([(13.0, -1.5, 0.4)]) + 0.15 * np.array(
        [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    )
    placed = image.rolling.place_points(points, model)
    pixels = model.pixels_from_camera(placed)
    # The box is concrete on asphalt: its pixels are those nearer than the ground and the car.
    is_box = image.semantic == 1
    row, column = np.nonzero(is_box)
    found = column.min(), row.min(), column.max() + 1, row.max() + 1
    np.testing.assert_allclose((*pixels.min(axis=0), *pixels.max(axis=0)), found, atol=1)


def test_a_camera_50_ms_behind_the_frame_shows_where_a_car_was() -> None:
    shown = [
        capture(make_camera(None, truth=("instance",), **rate), crossing())
        for rate in ({}, {"rate_hz": 10, "offset_ms": 50})
    ]
    # It drives to the left, so it was 0.75 m further to the right: 22.4 pixels.
    moved_px = FOCAL_PX * SPEED_M_S * 0.05 / DISTANCE_M
    now, then = (find_edges(image, 80)[0] for image in shown)
    assert then - now == pytest.approx(moved_px, abs=1)
    now, then = (image.projected_boxes[OTHER].outline_box[0] for image in shown)
    assert then - now == pytest.approx(moved_px, abs=1e-3)
    assert [image.time_s for image in shown] == [None, pytest.approx(0.05)]


def test_rolling_images_between_frames_are_of_one_motion() -> None:
    """Braking and turning cars are where a car that is advanced once would be."""
    trace = make_trace(
        {"id": EGO, "vx": 12.0, "ax": -6.0, "yaw_rate": -0.5, "speed": 12.0},
        {"id": OTHER, "x": 20.0, "y": 2.0, "yaw": 2.5, "vx": -9.0, "vy": 7.0, "ay": 8.0},
    )
    rate = {"rate_hz": 10, "offset_ms": 40}
    camera = make_camera(FINE, truth=("instance",), mounts=(DOWN,), **rate)
    rig, renderer, _ = open_rig(camera, trace)
    image = rig.capture_frame(1)[0].camera_images[0]
    box = image.projected_boxes[OTHER]
    assert box.visible_box is not None
    np.testing.assert_allclose(box.outline_box, box.visible_box, atol=1)
    assert image.rolling is not None
    frame = renderer.frames[0]
    for placed in renderer.frames[1:]:
        once = frame.advance(placed.time_s - frame.time_s).get_state(OTHER)
        found = placed.get_state(OTHER)
        np.testing.assert_allclose(found.world_from_body, once.world_from_body, atol=1e-9)
    assert renderer.times_s[1:] == pytest.approx(
        0.04 + READOUT_MS / 1000 * ((np.arange(40) + 0.5) / 40 - 0.5), abs=1e-9
    )


def test_a_scene_at_rest_is_that_of_a_global_shutter() -> None:
    trace = make_trace({"id": EGO}, {"id": OTHER, "x": 12.0, "y": 1.0})
    rolling, still = (
        capture(make_camera(shutter, truth=("instance", "normal")), trace)
        for shutter in (FINE, None)
    )
    for name in ("image", "semantic", "depth_cm", "instance", "normal"):
        np.testing.assert_array_equal(getattr(rolling, name), getattr(still, name), err_msg=name)
    box, still_box = (image.projected_boxes[OTHER].outline_box for image in (rolling, still))
    np.testing.assert_allclose(box, still_box, atol=1e-3)


def test_the_scene_is_rendered_once_for_each_band() -> None:
    camera = make_camera(Shutter(readout_ms=READOUT_MS, bands=4))
    rig, renderer, _ = open_rig(camera, crossing())
    rig.capture_frame(1)
    # The first is the frame's own instant, as for other cameras.
    offsets_ms = 1000 * (np.array(renderer.times_s) - renderer.times_s[0])
    np.testing.assert_allclose(offsets_ms, (0, -11.25, -3.75, 3.75, 11.25), atol=1e-9)
    assert camera.renders == 4


def test_bands_are_off_by_half_of_what_moves_in_one() -> None:
    image = capture(
        make_camera(Shutter(readout_ms=READOUT_MS, bands=4), truth=("instance",)), crossing()
    )
    exact = capture(make_camera(FINE, truth=("instance",)), crossing())
    rows = range(62, 104)
    off_px = [find_edges(image, row)[0] - find_edges(exact, row)[0] for row in rows]
    assert 1 <= np.abs(off_px).max() <= 13.44 / (2 * 4) + 1


@pytest.mark.parametrize(("bands", "samples"), [(1, 17), (4, 9)])
def test_a_passing_car_is_blurred_by_its_speed_times_the_exposure(bands: int, samples: int) -> None:
    """Its edges are ramps, whose middles are where a car without blur has them."""
    shutter = {"readout_ms": READOUT_MS, "bands": bands} if bands > 1 else {}
    exposure = Exposure(mode="manual", shutter_s=0.02)
    sharp, blurred = (
        make_camera(Shutter.model_validate({**shutter, "blur_samples": count}), exposure=exposure)
        for count in (1, samples)
    )
    seen = []
    for camera in (sharp, blurred):
        rig, _, spec = open_rig(camera, crossing())
        seen.append(rig.capture_camera(spec.ego, 0, 1))
    for name in ("depth", "normal", "semantic", "instance"):
        np.testing.assert_array_equal(*(getattr(item, name) for item in seen), err_msg=name)
    length_px = FOCAL_PX * SPEED_M_S * 0.02 / DISTANCE_M
    assert length_px == pytest.approx(8.96, abs=0.01)
    row = 70
    left_px, right_px = (edge for edge in np.flatnonzero(np.diff(seen[0].instance[row])) + 1)
    columns = np.arange(WIDTH) + 0.5
    # The renderer's light is the actor's id.
    fraction = seen[1].radiance[row, :, 0] / OTHER
    for edge_px, sign in ((left_px, 1), (right_px, -1)):
        near = np.abs(columns - edge_px) < 12
        ramp = np.clip(0.5 + sign * (columns - edge_px) / length_px, 0, 1)
        np.testing.assert_allclose(fraction[near], ramp[near], atol=0.5 / length_px + 1 / samples)


def test_a_camera_that_moves_its_shutter_blurs_for_the_time_that_it_meters() -> None:
    camera = make_camera(Shutter(blur_samples=3), exposure=Exposure(mode="sensor"))
    rig, renderer, spec = open_rig(camera, crossing())
    rig.capture_image(spec.ego, 0, 1)
    # The renderer's scene is so dark that the shutter opens to 1/30 s.
    offsets_s = np.array(renderer.times_s) - renderer.times_s[0]
    np.testing.assert_allclose(offsets_s, (0, -1 / 90, 0, 1 / 90), atol=1e-9)
    assert camera.renders == 4


def test_signals_flicker_from_band_to_band_in_short_exposures_only() -> None:
    trace = replace(crossing(), signal_ids=("a",), signals=np.zeros((3, 1), np.uint8))
    found: list[list[float]] = []
    for shutter_s in (1e-4, 1 / 120):
        shutter = Shutter(readout_ms=READOUT_MS, bands=18, led_flicker=True)
        camera = make_camera(shutter, exposure=Exposure(mode="manual", shutter_s=shutter_s))
        rig, renderer, spec = open_rig(camera, trace)
        rig.capture_image(spec.ego, 0, 1)
        found.append([frame.signal_light_ratios["a"] for frame in renderer.frames[1:]])
    # Five bands are a period of 120 Hz: two or three of them are dark.
    is_dark = np.array(found[0]) == 0
    assert set(np.round(found[0], 3)) == {0.0, 2.0}
    np.testing.assert_array_equal(is_dark[5:], is_dark[:-5])
    np.testing.assert_allclose(found[1], 1.0, atol=1e-9)


def test_normals_are_in_the_axes_of_the_camera_at_their_rows_time() -> None:
    rate = 0.8
    wall = build_box((1.0, 100.0, 100.0), (20.5, 0.0, 0.0))
    trace = make_trace({"id": EGO, "yaw_rate": rate})
    image = capture(make_camera(FINE, truth=("normal",)), trace, wall)
    assert image.normal is not None
    turned = rate * READOUT_MS / 1000 * ((np.arange(50) + 0.5) / HEIGHT - 0.5)
    # A wall that faces a camera turned left has a normal that points to its left.
    np.testing.assert_allclose(image.normal[:50, 80, 0], -np.sin(turned), atol=1e-3)


def test_readers_and_calibrations_have_the_times_of_rows(tmp_path: Path) -> None:
    trace = make_trace({"id": EGO, "vx": 12.0, "yaw_rate": -0.5, "speed": 12.0})
    camera = make_camera(Shutter(readout_ms=READOUT_MS, bands=2), mounts=(DOWN,))
    rig, _, spec = open_rig(camera, trace)
    taken = rig.capture_frame(1)
    write_scenario(tmp_path / "data", spec, lambda index: taken, frames=1)
    view = open_dataset(tmp_path / "data")[0][taken[0].agent.id]
    np.testing.assert_allclose(view.row_times(0)[[0, 60, 119]], (-0.014875, 1.25e-4, 0.014875))

    rolling = taken[0].camera_images[0].rolling
    points = np.array([(13.0, -1.5, 0.0), (30.0, 4.0, 2.0)])
    assert rolling is not None
    model = view.camera_model(0)
    expected = model.pixels_from_camera(rolling.place_points(points, model))
    pixels = view.pixels(0, points)
    np.testing.assert_allclose(pixels[:, :2], expected, atol=1e-4)
    # Each point is where the pose of its row shows it.
    for point, pixel in zip(points, pixels, strict=True):
        fraction = pixel[1] / HEIGHT
        pose = interpolate_poses(rolling.upper, rolling.lower, [fraction])[0]
        seen = model.pixels_from_camera(transform_points(invert_pose(pose), point[None]))
        np.testing.assert_allclose(seen[0], pixel[:2], atol=1e-3)

    found = export_dataset("calibration", tmp_path / "data", tmp_path / "out").output
    described = yaml.safe_load(next(found.rglob("camchain.yaml")).read_text())["cam0"]
    assert described["line_delay"] == pytest.approx(0.03 / HEIGHT)
    storage = cv2.FileStorage(str(next(found.rglob("camera0.yaml"))), cv2.FILE_STORAGE_READ)
    assert storage.getNode("line_delay").real() == pytest.approx(0.03 / HEIGHT)
    assert storage.getNode("first_row_time").real() == pytest.approx(-0.014875)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"shutter": {"bands": 4}}, "has no effect without readout_ms"),
        ({"truth": ("flow",), "rate_hz": 10}, "camera with a rate of its own"),
        ({"shutter": {"blur_samples": 4}}, "is even"),
        ({"shutter": {"blur_samples": 3}, "exposure": {"shutter_s": 0.2}}, "longer than 0.1 s"),
        ({"shutter": {"readout_ms": 120}}, "less than or equal to 100"),
        ({"shutter": {"readout_ms": 30}, "truth": ["flow"]}, "images of a rolling shutter"),
    ],
)
def test_shutters_that_cannot_be_are_refused(fields: dict[str, object], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        Camera.model_validate({"mounts": [{}], **fields})
