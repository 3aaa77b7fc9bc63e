"""Flow of walls, cars, limbs and the sky, against shifts computed by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
from advercity_dsl import Camera, Mount
from advercity_dsl.lens import KannalaBrandtLens

from advercity.frames import ActorState, Frame
from advercity.geometry.mesh import Mesh
from advercity.geometry.poses import Matrix, pose_matrix
from advercity.physics.constants import GOLDEN_FRACTION
from advercity.rendering.backend import CameraCapture, CameraView
from advercity.rendering.raycaster import Raycaster
from advercity.semantics import Semantic
from advercity.sensors.camera.lens_map import build_lens_map
from advercity.sensors.camera_model import CameraModel
from advercity.sensors.measurements import OpticalFlow
from advercity.sensors.optical_flow import CameraMotion, build_point_mover, measure_optical_flow
from advercity.testing import (
    CAR,
    build_box,
    build_flat_world,
    make_actor_state,
    make_capture,
    make_frame,
)
from advercity.world import Body, Gait, World
from tests.sensors.cast_renderer import CastRenderer
from tests.sensors.opencv_lens import find_rays, project_points

MODEL = CameraModel(80, 60, 100.0)
EYE = pose_matrix((0.0, 0.0, 1.5))
WALL = build_box((1.0, 100.0, 100.0), (20.5, 0.0, 0.0))
"""Its face is 20 m ahead of `EYE`."""


def look(
    world: World, frame: Frame, eye: Matrix = EYE, model: CameraModel = MODEL
) -> CameraCapture:
    """Cast a ray through the middle of every pixel of the plane that a backend would render."""
    (width, height), renderer = model.rendered_size, CastRenderer(world)
    renderer.place(frame)
    return renderer.render_camera(
        CameraView(eye, width, height, 2 * math.atan(width / (2 * model.focal_px)))
    )


def measure(
    world: World,
    frames: tuple[Frame, Frame] = (make_frame(), make_frame()),
    *,
    then: Matrix = EYE,
    model: CameraModel = MODEL,
    seen: CameraCapture | None = None,
) -> OpticalFlow:
    """Measure the flow from `EYE` to another pose."""
    raycaster = Raycaster(world)
    raycaster.place(frames[1])
    motion = CameraMotion(model, (EYE, then), frames)
    found = look(world, frames[0], model=model) if seen is None else seen
    return measure_optical_flow(found, motion, raycaster, build_point_mover(world.bodies))


def build_wall_world() -> World:
    return World("wall", (WALL,), {"car": CAR}, lanes=(), network=build_flat_world().network)


def test_a_camera_that_moves_sideways_shifts_a_wall_by_focal_length_over_distance() -> None:
    flow = measure(build_wall_world(), then=pose_matrix((0.0, 1.0, 1.5)))
    np.testing.assert_allclose(flow.shift_px, np.broadcast_to((5.0, 0.0), (60, 80, 2)), atol=1e-3)
    # The five columns that leave the image at the right are not in the next one.
    np.testing.assert_array_equal(flow.occluded, np.tile(np.arange(80) >= 75, (60, 1)))


def test_a_camera_that_moves_ahead_makes_images_grow_about_their_middle() -> None:
    flow = measure(build_wall_world(), then=pose_matrix((4.0, 0.0, 1.5)))
    row, column = np.indices((60, 80)) + 0.5
    # At 20 m the wall grows to 20/16 of its size.
    grown = np.stack([column - 40, row - 30], axis=-1) / 4
    np.testing.assert_allclose(flow.shift_px, grown, atol=1e-3)


def test_a_camera_that_turns_left_shifts_the_sky_to_the_right() -> None:
    turned = pose_matrix(EYE[:3, 3], yaw=0.1)
    sky = make_capture(81, 61, depth_m=np.inf)
    flow = measure(
        build_flat_world(), model=replace(MODEL, width_px=81, height_px=61), seen=sky, then=turned
    )
    np.testing.assert_allclose(flow.shift_px[30, 40], (100 * np.tan(0.1), 0.0), atol=1e-4)
    # A pixel that was 0.1 rad to the left is now in the middle.
    left = 40 - 100 * np.tan(0.1)
    assert flow.shift_px[30, round(left), 0] == pytest.approx(100 * np.tan(0.1), abs=0.2)


def test_cars_move_and_hide_what_they_come_before() -> None:
    # Its face is 10 m ahead; it goes 1 m to the left, 10 pixels.
    now, then = (make_actor_state(7, 12.0, y_m) for y_m in (0.0, 1.0))
    flow = measure(build_wall_world(), (make_frame(now), make_frame(then)))
    row, before = 35, np.arange(80)
    # The car is 2 m wide: columns 30 to 49, then 20 to 39.
    on_car = (before >= 30) & (before < 50)
    expected = np.where(on_car[:, None], (-10.0, 0.0), (0.0, 0.0))
    np.testing.assert_allclose(flow.shift_px[row], expected, atol=1e-3)
    np.testing.assert_array_equal(flow.occluded[row], (before >= 20) & (before < 30))


def test_points_of_a_car_that_turns_go_around_its_middle() -> None:
    now = make_actor_state(7, 12.0)
    then = replace(now, world_from_body=pose_matrix((12.0, 0.0, 0.0), yaw=np.pi))
    point = np.array([[10.0, 0.4, 1.0]])
    moved = build_point_mover({"car": CAR})(point, now, then)
    np.testing.assert_allclose(moved, [[14.0, -0.4, 1.0]], atol=1e-9)


def test_what_the_camera_passes_or_what_leaves_has_no_place_in_the_next_image() -> None:
    world = build_wall_world()
    passed = measure(world, then=pose_matrix((30.0, 0.0, 1.5)))
    assert np.isnan(passed.shift_px).all()
    assert passed.occluded.all()
    gone = measure(world, (make_frame(make_actor_state(7, 12.0)), make_frame()))
    np.testing.assert_array_equal(np.isnan(gone.shift_px[35, :, 0]), gone.occluded[35])
    assert gone.occluded[35].sum() == 20


def build_swinging_body() -> Body:
    """A trunk, and a leg that is 0.3 m further ahead in the second of four poses."""
    parts: list[Mesh] = []
    for bone, (name, x_m) in enumerate((("trunk", 0.0), ("leg", 1.0))):
        box = build_box((0.4, 0.4, 0.8), (x_m, 0.0, 0.4), semantic=Semantic.PEDESTRIAN)
        weights = np.zeros((len(box.vertices), 2), np.float32)
        weights[:, bone] = 1
        parts.append(replace(box, name=name, weights=weights))
    transforms = np.zeros((4, 2, 3, 4), np.float32)
    transforms[..., :3] = np.eye(3)
    transforms[1, 1, 0, 3] = 0.3
    return Body(tuple(parts), (2.0, 1.0, 1.0), Gait(1.6, transforms, returns_to_rest=False))


def test_limbs_move_with_the_nearest_vertex_of_the_body() -> None:
    def walk(x_m: float, turns: float) -> ActorState:
        state = make_actor_state(1, x_m, blueprint="walker", actor_class="pedestrian")
        return replace(state, travelled_m=1.6 * (turns + 1 - GOLDEN_FRACTION), speed_m_s=4.0)

    now, then = walk(10.0, 0.0), walk(10.4, 0.25)
    points = np.array([[10.0, 0.2, 0.7], [11.0, 0.2, 0.1]])
    moved = build_point_mover({"walker": build_swinging_body()})(points, now, then)
    # Both go 0.4 m with the body, and the leg 0.3 m further.
    np.testing.assert_allclose(moved, [[10.4, 0.2, 0.7], [11.7, 0.2, 0.1]], atol=1e-6)


def test_a_still_scene_has_no_flow_and_hides_nothing() -> None:
    posts = [build_box((0.2, 0.2, 3.0), (x_m, x_m / 3, 1.5)) for x_m in (5.0, 9.0, 30.0)]
    frame = make_frame(make_actor_state(7, 14.0))
    flow = measure(build_flat_world(*posts), (frame, frame))
    np.testing.assert_allclose(flow.shift_px, 0, atol=1e-5)
    assert not flow.occluded.any()


def test_flow_of_a_lens_is_that_of_points_projected_by_opencv() -> None:
    lens = KannalaBrandtLens(model="kannala_brandt", k1=-0.02, k2=0.004)
    camera = Camera(width_px=80, height_px=60, horizontal_fov_deg=100, lens=lens, mounts=(Mount(),))
    model, then = CameraModel.build(camera, 80, 60), pose_matrix((0.3, 1.0, 1.5))
    world = build_wall_world()
    plane = look(world, make_frame(), model=model)
    lens_map = build_lens_map(model)
    assert lens_map is not None
    flow = measure(world, model=model, then=then, seen=lens_map.select(plane))
    rays = find_rays(model, lens).reshape(-1, 3)
    before, after = 20.0 * rays, 20.0 * rays - (0.3, 1.0, 0.0)
    shift = project_points(model, lens, after) - project_points(model, lens, before)
    np.testing.assert_allclose(flow.shift_px, shift.reshape(60, 80, 2), atol=0.02)
