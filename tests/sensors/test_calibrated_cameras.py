"""Cameras with the focal lengths and principal point of a calibration, against OpenCV."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from advercity_dsl import Camera, Mount, Spec
from advercity_dsl.lens import BrownConradyLens, CameraLens, Intrinsics, KannalaBrandtLens
from pydantic import ValidationError

from advercity.geometry import poses
from advercity.geometry.arrays import Float64Array
from advercity.rendering.backend import RENDER_PROFILES
from advercity.sensors.annotation import project_boxes
from advercity.sensors.camera.driver import build_camera_view
from advercity.sensors.camera.lens_map import build_lens_map
from advercity.sensors.camera_model import CameraModel
from advercity.testing import build_flat_world, make_actor_state, make_frame
from tests.sensors.cast_renderer import CastRenderer

WIDTH, HEIGHT = 400, 240
BARREL = BrownConradyLens(model="brown_conrady", k1=-0.25, k2=0.06, p1=0.001, p2=-0.002)
FISHEYE = KannalaBrandtLens(model="kannala_brandt", k1=-0.02, k2=0.003)
CAMERAS = [
    (Intrinsics(fx_px=300, fy_px=300, cx_px=170.5, cy_px=131), None),
    (Intrinsics(fx_px=300, fy_px=155, cx_px=0, cy_px=0), None),
    (Intrinsics(fx_px=210, fy_px=400, cx_px=399, cy_px=239), None),
    (Intrinsics(fx_px=320, fy_px=290, cx_px=230, cy_px=95.25), BARREL),
    (Intrinsics(fx_px=230, fy_px=250, cx_px=165, cy_px=140), FISHEYE),
]


def camera_of(intrinsics: Intrinsics, lens: CameraLens | None) -> Camera:
    return Camera(
        width_px=WIDTH, height_px=HEIGHT, intrinsics=intrinsics, lens=lens, mounts=(Mount(),)
    )


def project_by_opencv(
    intrinsics: Intrinsics, lens: CameraLens | None, points: Float64Array
) -> Float64Array:
    """Project points (n, 3) in body axes; the middle of the upper left pixel is (0.5, 0.5)."""
    optical = np.stack([-points[:, 1], -points[:, 2], points[:, 0]], axis=1)[:, None]
    matrix = np.array(
        [
            [intrinsics.fx_px, 0, intrinsics.cx_px],
            [0, intrinsics.fy_px, intrinsics.cy_px],
            [0, 0, 1],
        ]
    )
    still = np.zeros(3)
    coefficients = np.zeros(5) if lens is None else np.array(lens.coefficients)
    function = (
        cv2.fisheye.projectPoints if isinstance(lens, KannalaBrandtLens) else cv2.projectPoints
    )
    pixels, _ = function(optical, still, still, matrix, coefficients)
    return pixels.reshape(-1, 2).astype(np.float64) + 0.5


def list_rays(model: CameraModel, columns: int, rows: int) -> Float64Array:
    """Rays (n, 3) in body axes through a grid over the image."""
    grid = np.meshgrid(np.linspace(0.08, 0.92, columns), np.linspace(0.12, 0.88, rows))
    places = np.stack(grid, axis=-1).reshape(-1, 2)
    pixels = model.undistort(places * (model.width_px, model.height_px))
    return np.column_stack([np.ones(len(pixels)), -model.plane_from_pixels(pixels)])


@pytest.mark.parametrize("scale", [1.0, 0.5])
@pytest.mark.parametrize(("intrinsics", "lens"), CAMERAS)
def test_points_are_where_opencv_projects_them(
    intrinsics: Intrinsics, lens: CameraLens | None, scale: float
) -> None:
    model = CameraModel.build(
        camera_of(intrinsics, lens), round(WIDTH * scale), round(HEIGHT * scale)
    )
    rays = list_rays(model, 20, 15)
    expected = project_by_opencv(intrinsics, lens, rays) * scale
    np.testing.assert_allclose(model.pixels_from_camera(rays), expected, atol=2e-3)
    # The rays were chosen by the inverse: they fill the image.
    ends = np.array([(0.08, 0.12), (0.92, 0.88)]) * (WIDTH, HEIGHT) * scale
    np.testing.assert_allclose([expected.min(axis=0), expected.max(axis=0)], ends, atol=0.01)


@pytest.mark.parametrize(("intrinsics", "lens"), CAMERAS)
def test_images_and_boxes_show_actors_where_opencv_projects_them(
    intrinsics: Intrinsics, lens: CameraLens | None, spec: Spec
) -> None:
    camera = camera_of(intrinsics, lens)
    agent = spec.ego.model_copy(
        update={"sensors": spec.ego.sensors.model_copy(update={"camera": camera})}
    )
    model, eye = CameraModel.build(camera, WIDTH, HEIGHT), poses.pose_matrix((0, 0, 1000.0))
    rays = list_rays(model, 3, 2)
    states = tuple(
        replace(make_actor_state(number, 0.0), world_from_body=poses.pose_matrix((x, y, 1000 + z)))
        for number, (x, y, z) in enumerate(40.0 * rays, start=1)
    )
    frame = make_frame(*states)
    renderer = CastRenderer(build_flat_world())
    renderer.place(frame)
    view = build_camera_view(agent, 0, eye, RENDER_PROFILES["full"])
    lens_map = build_lens_map(model)
    assert lens_map is not None
    seen = lens_map.select(renderer.render_camera(view))
    boxes = project_boxes(seen.instance, eye, model, frame, lambda state: state.box.corners)
    for state in states:
        corners = poses.transform_points(state.world_from_body, state.box.corners) - eye[:3, 3]
        outline = project_by_opencv(intrinsics, lens, corners)
        edges = np.concatenate([outline.min(axis=0), outline.max(axis=0)])
        edges = np.clip(edges, 0, (WIDTH, HEIGHT, WIDTH, HEIGHT))
        box = boxes[state.actor.id]
        np.testing.assert_allclose(box.outline_box, edges, atol=0.5)
        assert box.visible_box is not None
        np.testing.assert_allclose(box.visible_box, edges, atol=1.01)


def test_a_plain_camera_by_intrinsics_is_the_one_by_its_field_of_view() -> None:
    half = math.tan(math.radians(35))
    focal = WIDTH / 2 / half
    plain = Camera(width_px=WIDTH, height_px=HEIGHT, horizontal_fov_deg=70, mounts=(Mount(),))
    middle = Intrinsics(fx_px=focal, fy_px=focal, cx_px=WIDTH / 2 - 0.5, cy_px=HEIGHT / 2 - 0.5)
    given = camera_of(middle, None)
    assert given.side_angles_rad == pytest.approx(plain.side_angles_rad)
    model = CameraModel.build(given, WIDTH, HEIGHT)
    assert build_lens_map(model) is None
    np.testing.assert_allclose(model.matrix, CameraModel.build(plain, WIDTH, HEIGHT).matrix)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"horizontal_fov_deg": 80.0}, "follows from `intrinsics`"),
        ({"intrinsics": {"cx_px": 400}}, "cx_px is not in the image, whose pixels are 0 to 399"),
        ({"intrinsics": {"cy_px": 239.5}}, "cy_px is not in the image, whose pixels are 0 to 239"),
        ({"intrinsics": {"fy_px": 601}}, "fy_px differs from fx_px by more than a factor of 2"),
        ({"intrinsics": {"fx_px": 12, "fy_px": 12}}, "deg from corner to corner"),
        (
            {"intrinsics": {"fx_px": 80, "fy_px": 80}, "lens": {"model": "kannala_brandt"}},
            "shows more than 150 deg from corner to corner",
        ),
        ({"calibrated_camera": "cam1"}, "has no effect without `calibration`"),
    ],
)
def test_intrinsics_that_contradict_the_camera_are_refused(
    fields: dict[str, object], message: str
) -> None:
    intrinsics = {"fx_px": 300, "fy_px": 300, "cx_px": 200, "cy_px": 120}
    given = fields.get("intrinsics", {})
    assert isinstance(given, dict)
    camera = {"width_px": WIDTH, "height_px": HEIGHT, "mounts": [{}], **fields}
    with pytest.raises(ValidationError, match=message):
        Camera.model_validate(camera | {"intrinsics": intrinsics | given})
