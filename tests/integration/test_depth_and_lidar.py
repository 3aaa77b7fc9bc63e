"""Cameras and LiDARs see one world: ranges of rays are the depths of pixels."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from advercity_dsl import Spec

from advercity.frames import Signal
from advercity.geometry.arrays import Float64Array
from advercity.geometry.poses import pose_matrix
from advercity.physics.atmosphere import compute_atmosphere
from advercity.rendering.backend import RENDER_PROFILES, CameraView
from advercity.rendering.raycaster import Raycaster, Rays
from advercity.roads.road_network import build_road
from advercity.scene.build import build_world
from advercity.testing import make_frame
from advercity.world import World
from tests.requirements import require
from tests.roads.declared_levels import declare_two_levels
from tests.roads.imported_roads import BEND, TWO_LEVELS, compiled
from tests.roads.left_hand_roads import STREET

WIDTH_PX, HEIGHT_PX, FOCAL_PX = 160, 96, 80.0
MAX_RANGE_M, TOLERANCE_M = 100.0, 0.05
NAMES = ("ui", "unj", "ri", "rsnj", "rcnj")


def list_poses(spec: Spec) -> list[Float64Array]:
    """Poses of cameras at drivers' height along three lanes, tilted a little up and down."""
    lanes = [lane for lane in build_road(spec.road).lanes if lane.kind == "driving"]
    found = []
    for number, pitch in ((0, 0.1), (len(lanes) // 2, -0.15), (len(lanes) - 1, 0.0)):
        lane = lanes[number]
        middle = (lane.left + lane.right) / 2
        start, end = middle[len(middle) // 3], middle[len(middle) // 3 + 1]
        yaw = float(np.arctan2(*(end - start)[1::-1]))
        found.append(pose_matrix((*start[:2], start[2] + 1.6), yaw=yaw, pitch=pitch))
    return found


def measure_agreement(world: World, spec: Spec, poses: list[Float64Array]) -> float:
    """Fraction of rays through the middles of pixels whose depth is that of the image.

    At edges, a pixel's middle may be beside the surface that the ray hits: a depth between the
    least and the greatest of the pixel and its eight neighbours counts, to within 5 cm.
    """
    caster, agreed, total = Raycaster(world), 0, 0
    frame = replace(make_frame(), signals={lamp.id: Signal.RED for lamp in world.signal_lamps})
    caster.place(frame)
    rows, columns = np.mgrid[0:HEIGHT_PX, 0:WIDTH_PX] + 0.5
    left, up = (WIDTH_PX / 2 - columns) / FOCAL_PX, (HEIGHT_PX / 2 - rows) / FOCAL_PX
    directions = np.stack([np.ones_like(left), left, up], axis=-1).reshape(-1, 3)
    length = np.linalg.norm(directions, axis=1)
    air = compute_atmosphere(spec.weather, spec.road.land_use)
    backend = require("advercity_sapien.backend").SapienBackend()
    with backend.open(world, air, RENDER_PROFILES["preview"]) as renderer:
        renderer.place(frame)
        for pose in poses:
            fov_rad = 2 * np.arctan(WIDTH_PX / (2 * FOCAL_PX))
            view = CameraView(pose, WIDTH_PX, HEIGHT_PX, fov_rad)
            depth = np.where(
                np.isfinite(seen := renderer.render_camera(view).depth), seen, np.float32(1e6)
            )
            turned = ((directions / length[:, None]) @ pose[:3, :3].T).astype(np.float32)
            origins = np.broadcast_to(pose[:3, 3].astype(np.float32), turned.shape)
            hits = caster.cast(Rays(origins, turned), MAX_RANGE_M)
            measured = (hits.range_m / length).reshape(depth.shape)
            near = np.isfinite(measured)
            around = np.ones((3, 3), np.uint8)
            agrees = measured > cv2.erode(depth, around) - TOLERANCE_M
            agrees &= measured < cv2.dilate(depth, around) + TOLERANCE_M
            agreed, total = agreed + int(agrees[near].sum()), total + int(near.sum())
    assert total > 0.3 * len(poses) * WIDTH_PX * HEIGHT_PX
    return agreed / total


UNDER_AND_BESIDE_A_DECK = (
    pose_matrix((-3, -1.6, 1.5), yaw=0.2, pitch=-0.9),
    pose_matrix((-20, -1.6, 1.6)),
    pose_matrix((-10, 9, 3), yaw=-0.6),
)


@pytest.mark.parametrize(("road", "more"), [(BEND, ()), (TWO_LEVELS, UNDER_AND_BESIDE_A_DECK)])
def test_imports_and_decks_are_seen_alike(
    library: Path, tmp_path: Path, road: dict[str, object], more: tuple[Float64Array, ...]
) -> None:
    spec = compiled(library, tmp_path, road)
    world = build_world(spec, Path("none"))
    assert measure_agreement(world, spec, [*list_poses(spec), *more]) > 0.99


@pytest.mark.slow
@pytest.mark.parametrize("road", [declare_two_levels(), STREET], ids=["levels", "left-hand"])
def test_declared_sites_are_seen_alike(
    library: Path, tmp_path: Path, road: dict[str, object]
) -> None:
    spec = compiled(library, tmp_path, road | {"id": "imported"})
    world = build_world(spec, Path("none"))
    assert measure_agreement(world, spec, [*list_poses(spec), *UNDER_AND_BESIDE_A_DECK]) > 0.99


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_shipped_sites_are_seen_alike(name: str, specs: dict[str, Spec]) -> None:
    spec = specs[f"{name}_clear_day_sparse"]
    world = build_world(spec, Path("none"))
    assert measure_agreement(world, spec, list_poses(spec)) > 0.99
