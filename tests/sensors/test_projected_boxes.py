import numpy as np
import pytest

from advercity.frames import Actor, ActorState, Frame, Lamp
from advercity.geometry import poses
from advercity.sensors.annotation import project_boxes, select_extreme_points
from advercity.sensors.sensor_frame import ProjectedBox, compute_pinhole_matrix

WIDTH, HEIGHT = 200, 100
MATRIX = compute_pinhole_matrix(WIDTH, HEIGHT, horizontal_fov_deg=90)
"""Focal length 100 px."""
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
        MATRIX,
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


def test_extreme_points_keep_the_hull() -> None:
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 7)] * 3), axis=-1).reshape(-1, 3)
    kept = select_extreme_points(grid)
    assert {tuple(point) for point in kept} == {
        (x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)
    }
