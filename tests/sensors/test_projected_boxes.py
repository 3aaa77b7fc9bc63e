import numpy as np
import pytest
from advercity_dsl import Camera, Mount
from advercity_dsl.lens import BrownConradyLens, KannalaBrandtLens

from advercity.frames import Actor, ActorState, Frame, Lamp
from advercity.geometry import poses
from advercity.geometry.arrays import Float64Array
from advercity.sensors.annotation import project_boxes, select_extreme_points
from advercity.sensors.camera_model import CameraModel
from advercity.sensors.sensor_frame import ProjectedBox
from tests.sensors.opencv_lens import find_rays

WIDTH, HEIGHT = 200, 100
CAMERA = CameraModel(WIDTH, HEIGHT, focal_px=100)
SIZE = (2.0, 2.0, 2.0)


def seen(x: float, y: float, *, hidden_px: int = 0) -> ProjectedBox | None:
    """A cube whose near face is at `x`, wholly drawn but for some columns, by a camera at 1 m."""
    actor = Actor(7, "car", "cube", "car_paint_red", SIZE)
    pose = poses.pose_matrix((x + 1, y, 0))
    frame = Frame(0, 0.0, (ActorState(actor, pose, 0.0, 0.0, Lamp(0)),), {})
    instance = np.zeros((HEIGHT, WIDTH), np.int32)
    middle, half = WIDTH / 2 - 100 * y / x, 100 / x
    left, right = max(0, round(middle - half)) + hidden_px, round(middle + half)
    instance[max(0, round(HEIGHT / 2 - half)) : round(HEIGHT / 2 + half), left:right] = 7
    found = project_boxes(
        instance,
        poses.pose_matrix((0, 0, 1)),
        CAMERA,
        frame,
        lambda state: state.box.corners,
    )
    return found.get(7)


def test_a_cube_in_the_open_is_entirely_visible() -> None:
    cube = seen(10, 0)
    assert cube is not None
    assert cube.visible_px == 400
    assert cube.outline_px == pytest.approx(400, rel=1e-4)
    assert cube.visible_box == (90, 40, 110, 60)
    assert cube.outline_box == pytest.approx((90, 40, 110, 60), abs=1e-3)
    assert (cube.truncation, cube.occlusion) == pytest.approx((0, 0), abs=1e-3)
    assert cube.visible_fraction == pytest.approx(1, abs=1e-3)


def test_a_hidden_quarter_is_occlusion() -> None:
    cube = seen(10, 0, hidden_px=5)
    assert cube is not None
    assert cube.occlusion == pytest.approx(0.25, abs=1e-3)
    assert cube.visible_fraction == pytest.approx(0.75, abs=1e-3)
    assert cube.visible_box == (95, 40, 110, 60)


def test_the_part_outside_the_image_is_truncation() -> None:
    """The near face reaches from 110 px left of the middle to 90: half of it is in the image.

    The far face, at 12 m, spans 75 to 91.7 px: within, so the outline is near face and a trapezium.
    """
    cube = seen(10, 10)
    assert cube is not None
    near, strip = 20 * 20, (20 + 100 / 6) / 2 * (90 - 75)
    assert cube.truncation == pytest.approx(10 * 20 / (near + strip), rel=1e-3)
    assert cube.outline_box[0] == 0
    assert cube.visible_fraction < 1 - cube.truncation + 1e-6


def test_actors_behind_or_outside_the_view_are_absent() -> None:
    assert seen(-10, 0) is None
    assert seen(10, 40) is None


def test_an_actor_across_the_cameras_plane_is_cut() -> None:
    """The cube reaches from behind the camera to 0.5 m ahead, 2 to 4 m to the left: out of sight.

    At 1.5 to 3.5 m ahead it would show.
    """
    assert seen(-1.5, 3) is None
    ahead = seen(1.5, 3)
    assert ahead is not None
    assert 0 < ahead.truncation < 1


def test_a_hidden_actor_has_an_outline_but_no_pixels() -> None:
    cube = seen(10, 0, hidden_px=20)
    assert cube is not None
    assert (cube.visible_px, cube.visible_box, cube.occlusion) == (0, None, 1.0)


BARREL = BrownConradyLens(model="brown_conrady", k1=-0.3, k2=0.1, p1=0.002, p2=-0.003)
FISHEYE = KannalaBrandtLens(model="kannala_brandt", k1=-0.02, k2=0.004)


@pytest.fixture(
    scope="module", params=[(BARREL, 85.0), (FISHEYE, 110.0)], ids=["barrel", "fisheye"]
)
def seen_rays(request: pytest.FixtureRequest) -> tuple[CameraModel, Float64Array]:
    """A camera of 240 x 150 pixels with a lens, and their rays in body axes as by OpenCV."""
    lens, fov_deg = request.param
    camera = Camera(
        width_px=240, height_px=150, horizontal_fov_deg=fov_deg, lens=lens, mounts=(Mount(),)
    )
    model = CameraModel.build(camera, 240, 150)
    return model, find_rays(model, lens)


@pytest.mark.parametrize(
    "at",
    [(6.0, 0.0), (2.6, 1.5), (4.0, -5.0), (1.7, -1.2), (9.0, 7.0), (2.5, 2.6)],
    ids=["middle", "near", "right", "lower right", "left", "cut by the edge"],
)
def test_boxes_lie_on_what_rays_through_a_lens_meet(
    seen_rays: tuple[CameraModel, Float64Array], at: tuple[float, float]
) -> None:
    model, rays = seen_rays
    state = ActorState(
        Actor(7, "car", "cube", "car_paint_red", SIZE),
        poses.pose_matrix((*at, 0), yaw=0.6),
        0.0,
        0.0,
        Lamp(0),
    )
    eye = np.array([0, 0, 1.4])
    body_from_world = poses.invert_pose(state.world_from_body)
    rays = rays @ body_from_world[:3, :3].T
    start = poses.transform_points(body_from_world, eye[None])[0]
    low, high = state.box.corners.min(axis=0), state.box.corners.max(axis=0)
    # A ray is in the box between its last entry to a slab and its first exit from one.
    ends = np.stack([(side - start) / rays for side in (low, high)])
    hit = ends.min(axis=0).max(axis=-1) < ends.max(axis=0).min(axis=-1)
    assert hit.any()
    found = project_boxes(
        np.where(hit, 7, 0).astype(np.int32),
        poses.pose_matrix(tuple(eye)),
        model,
        Frame(0, 0.0, (state,), {}),
        lambda state: state.box.corners,
    )[7]
    assert found.visible_box is not None
    np.testing.assert_allclose(found.outline_box, found.visible_box, atol=1)
    assert found.outline_px == pytest.approx(hit.sum(), rel=0.01, abs=20)
    assert found.occlusion < 0.02
    rows, columns = np.nonzero(hit)
    for nearest, begin in zip((columns.min(), rows.min()), found.outline_box, strict=False):
        assert nearest > 0 or begin == 0
    cut = min(rows.min(), columns.min(), 149 - rows.max(), 239 - columns.max()) == 0
    assert (found.truncation > 0.01) == cut


def test_extreme_points_keep_the_hull() -> None:
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 7)] * 3), axis=-1).reshape(-1, 3)
    kept = select_extreme_points(grid)
    assert {tuple(point) for point in kept} == {
        (x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)
    }
