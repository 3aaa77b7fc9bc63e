"""A rendered frame as OpenCOOD, HEAL and CoBEVT load it: a loader written from their rules alone.

It shares no code with the writer: folders are ordered, poses multiplied, boxes merged and points
projected as those loaders do it.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from advercity_dsl import Spec
from numpy.typing import NDArray

from advercity.compiler import find_weather, with_weather
from advercity.pipeline import RunOptions, run_scenario

pytestmark = [pytest.mark.render, pytest.mark.sumo]

Array = NDArray[Any]
RADIO_RANGE_M = 70.0
BODY = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""Optical axes of body axes: x is y, y is -z, z is x."""
VEHICLE_BGR, PEDESTRIAN_BGR = (142, 0, 0), (60, 20, 220)
LOW_BGR = ((40, 40, 100), (160, 190, 110))
"""Fences and static things, over which a LiDAR on a roof sees more than the cameras below it."""


@dataclass(frozen=True)
class Agent:
    """What a loader has of one agent in one frame."""

    folder: Path
    stem: str
    said: dict[str, Any]
    points: Array
    intensity: Array

    def from_lidar(self, other: "Agent") -> Array:
        """(4, 4) from the other's LiDAR into this one's."""
        own, theirs = (matrix(one.said["lidar_pose"]) for one in (self, other))
        return np.linalg.inv(own) @ theirs


def matrix(pose: list[float]) -> Array:
    """Sensor to world, `T Ryaw Rpitch Rroll`, left-handed."""
    x, y, z, *angles = pose
    roll, yaw, pitch = (math.radians(angle) for angle in angles)
    cr, sr, cy, sy = math.cos(roll), math.sin(roll), math.cos(yaw), math.sin(yaw)
    cp, sp = math.cos(pitch), math.sin(pitch)
    turned_yaw = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    turned_pitch = np.array([[cp, 0, -sp], [0, 1, 0], [sp, 0, cp]])
    turned_roll = np.array([[1, 0, 0], [0, cr, sr], [0, -sr, cr]])
    result = np.eye(4)
    result[:3, :3] = turned_yaw @ turned_pitch @ turned_roll
    result[:3, 3] = (x, y, z)
    return result


def moved(pose: Array, points: Array) -> Array:
    return points @ pose[:3, :3].T + pose[:3, 3]


def load(scenario: Path, frame: str) -> list[Agent]:
    """All agents, the ego first; as text, then the first moved behind if it is negative."""
    names = sorted(path.name for path in scenario.iterdir() if path.is_dir())
    if int(names[0]) < 0:
        names.append(names.pop(0))
    return [agent(scenario / name, frame) for name in names]


def agent(folder: Path, frame: str) -> Agent:
    header, _, body = (folder / f"{frame}.pcd").read_bytes().partition(b"DATA binary\n")
    lines = dict(line.split(" ", 1) for line in header.decode().splitlines() if " " in line)
    sizes = [int(size) for size in lines["SIZE"].split()]
    assert lines["FIELDS"].split()[:4] == ["x", "y", "z", "rgb"]
    assert sizes[:4] == [4] * 4
    point: Any = {
        "names": ["x", "y", "z", "rgb"],
        "formats": ["<f4", "<f4", "<f4", "<u4"],
        "offsets": [0, 4, 8, 12],
        "itemsize": sum(sizes),
    }
    table = np.frombuffer(body, np.dtype(point))
    assert len(table) == int(lines["POINTS"])
    return Agent(
        folder=folder,
        stem=frame,
        said=yaml.safe_load((folder / f"{frame}.yaml").read_text()),
        points=np.stack([table["x"], table["y"], table["z"]], axis=1).astype(np.float64),
        intensity=(table["rgb"] >> 16 & 255) / 255,
    )


def boxes_of(agents: list[Agent]) -> dict[int, Array]:
    """Corners (8, 3) in the ego's LiDAR frame of what agents in radio range list, first come."""
    ego = agents[0]
    merged: dict[int, Array] = {}
    for one in agents:
        apart = np.subtract(one.said["lidar_pose"][:2], ego.said["lidar_pose"][:2])
        if np.hypot(*apart) > RADIO_RANGE_M:
            continue
        for number, item in one.said["vehicles"].items():
            unit = np.array(
                [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float
            )
            centre = np.add(item["location"], item["center"])
            world_from_box = matrix([*centre, *item["angle"]])
            lidar_from_world = np.linalg.inv(matrix(ego.said["lidar_pose"]))
            corners = moved(lidar_from_world @ world_from_box, unit * item["extent"])
            merged.setdefault(number, corners)
    return merged


def share_of_box(corners: Array, points: Array) -> Array:
    """Points (n, 3) in half sizes from a box's middle."""
    centre = corners.mean(axis=0)
    axes = np.stack([corners[4] - corners[0], corners[2] - corners[0], corners[1] - corners[0]]) / 2
    return (points - centre) @ axes.T / (axes**2).sum(axis=1)


@pytest.fixture(scope="module")
def agents(specs: dict[str, Spec], tmp_path_factory: pytest.TempPathFactory) -> list[Agent]:
    """One frame of a scenario in clear air, loaded."""
    spec = with_weather(specs["ri_fog_day_sparse"], find_weather("clear_day"))
    options = RunOptions(
        output=tmp_path_factory.mktemp("loaded"),
        profile="preview",
        scale=0.2,
        frames=slice(20, 21),
        clouds="binary",
    )
    return load(run_scenario(spec, options), "000080")


def test_the_ego_is_a_vehicle_and_both_units_are_infrastructure(agents: list[Agent]) -> None:
    assert [int(one.folder.name) for one in agents] == [101, -1, -2, 102, 103]
    assert [one.said["RSU"] for one in agents] == [False, True, True, False, False]


def test_boxes_are_filled_by_the_points_of_all(agents: list[Agent]) -> None:
    """Of the points above the road in a box, nearly all are within its sides and extend to them."""
    ego = agents[0]
    cloud = np.concatenate([moved(ego.from_lidar(one), one.points) for one in agents])
    checked = 0
    boxes = boxes_of(agents)
    for number, corners in boxes.items():
        others = [share_of_box(box, cloud) for key, box in boxes.items() if key != number]
        # A semi-trailer is as near to its tractor unit as points beside a box are looked for.
        is_others = np.any([(np.abs(share) < 1.05).all(axis=1) for share in others], axis=0)
        share = share_of_box(corners, cloud[~is_others])
        nearby = share[(np.abs(share[:, :2]) < 1.3).all(axis=1) & (np.abs(share[:, 2]) < 1.3)]
        standing = nearby[nearby[:, 2] > -0.6]
        if len(standing) < 200:
            continue
        assert np.mean((np.abs(standing) < 1.05).all(axis=1)) > 0.95
        assert np.abs(standing[:, :2]).max() > 0.8
        checked += 1
    assert checked >= 3


def test_the_clouds_of_all_coincide_in_the_frame_of_the_ego(agents: list[Agent]) -> None:
    """Where two agents both meet the road, they meet it at the same height."""
    ego = agents[0]
    heights: dict[tuple[int, int], list[float]] = {}
    for one in agents:
        placed = moved(ego.from_lidar(one), one.points)
        low = placed[(np.abs(placed[:, :2]) < 40).all(axis=1) & (np.abs(placed[:, 2] + 1.9) < 0.5)]
        cells, index = np.unique(np.floor(low[:, :2]).astype(int), axis=0, return_inverse=True)
        lowest = np.full(len(cells), np.inf)
        np.minimum.at(lowest, index.ravel(), low[:, 2])
        for cell, height in zip(map(tuple, cells), lowest, strict=True):
            heights.setdefault(cell, []).append(height)
    apart = np.array([max(values) - min(values) for values in heights.values() if len(values) > 1])
    assert len(apart) > 100
    assert np.percentile(apart, 90) < 0.15


@pytest.mark.parametrize("position", range(5))
def test_boxes_project_onto_the_pixels_of_their_objects(agents: list[Agent], position: int) -> None:
    """HEAL's chain: LiDAR to camera by `cords`, then optical axes, then the intrinsics."""
    one = agents[position]
    world_from_lidar = matrix(one.said["lidar_pose"])
    own_boxes = [
        np.linalg.inv(world_from_lidar) @ matrix([*np.add(i["location"], i["center"]), *i["angle"]])
        for i in one.said["vehicles"].values()
    ]
    inside = np.zeros(len(one.points), bool)
    for box, item in zip(own_boxes, one.said["vehicles"].values(), strict=True):
        share = moved(np.linalg.inv(box), one.points) / item["extent"]
        inside |= (np.abs(share) < 1).all(axis=1) & (share[:, 2] > -0.7)
    hits = seen = 0
    for index in range(4):
        camera = one.said[f"camera{index}"]
        camera_from_lidar = np.linalg.inv(matrix(camera["cords"])) @ world_from_lidar
        np.testing.assert_allclose(camera["extrinsic"], camera_from_lidar, atol=1e-6)
        image = cv2.imread(str(one.folder / f"{one.stem}_semantic{index}.png"))
        assert image is not None
        optical = moved(camera_from_lidar, one.points[inside]) @ BODY.T
        optical = optical[optical[:, 2] > 1.0]
        pixels = optical @ np.array(camera["intrinsic"]).T
        column, row = (pixels[:, :2] / pixels[:, 2:]).astype(int).T
        height, width = image.shape[:2]
        shown = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        colours = image[row[shown], column[shown]]
        colours = colours[~(colours[:, None] == LOW_BGR).all(axis=2).any(axis=1)]
        hits += int(np.isin(colours, (VEHICLE_BGR, PEDESTRIAN_BGR)).all(axis=1).sum())
        seen += len(colours)
    assert seen > 50
    assert hits / seen > 0.85


def test_intensity_fills_its_range(agents: list[Agent]) -> None:
    for one in agents:
        assert 0 <= one.intensity.min() < 0.1
        assert 0.2 < one.intensity.max() <= 1


def test_heal_keeps_the_boxes_that_its_mask_shows(agents: list[Agent]) -> None:
    """A label is kept where the mask is not black under its middle, in the LiDAR's frame."""
    kept = listed = 0
    for one in agents:
        mask = cv2.imread(str(one.folder / f"{one.stem}_bev_visibility.png"), cv2.IMREAD_GRAYSCALE)
        assert mask is not None
        assert mask.shape == (256, 256)
        lidar_from_world = np.linalg.inv(matrix(one.said["lidar_pose"]))
        for item in one.said["vehicles"].values():
            x, y, _ = moved(lidar_from_world, np.add(item["location"], item["center"]))
            if abs(x) > 45 or abs(y) > 45:
                continue
            listed += 1
            kept += mask[127 - int(x / 0.39), 127 + int(y / 0.39)] > 0
    assert listed >= 5
    assert kept / listed > 0.7


def test_cameras_and_depths_are_as_heal_stacks_them(agents: list[Agent]) -> None:
    for one in agents:
        for index in range(4):
            colour, depth = (
                cv2.imread(str(one.folder / f"{one.stem}_{kind}{index}.png"), cv2.IMREAD_UNCHANGED)
                for kind in ("camera", "depth")
            )
            assert colour is not None
            assert depth is not None
            assert colour.shape == (*depth.shape, 3)
            assert colour.dtype == depth.dtype == np.uint8
            assert depth.min() < 30
