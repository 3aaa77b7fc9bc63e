"""What one viewpoint saw in one frame, read from its files.

Everything comes back in the right-handed frames that the rest of advercity uses, whatever the
layout of the files: world x east, y north, z up; bodies x forward, y left, z up; metres and
radians.
"""

import json
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from advercity_dsl import Agent
from numpy.typing import NDArray

from advercity import poses
from advercity.dataset.boxes import M_S_PER_KM_H, Boxes, boxes_of
from advercity.dataset.carla_frame import matrix_from_pose
from advercity.dataset.damage import REMEDY, damage_told
from advercity.dataset.formats import Format
from advercity.dataset.images import unpainted
from advercity.errors import InputError
from advercity.poses import Matrix


class View:
    """One viewpoint in one frame; every property reads its file when it is asked for.

    Args:
        agent: Whose viewpoint it is.
        index: Of the frame, counted from the first kept one.
        layout: Of the files.
        stem: Path that all its files' paths begin with.
    """

    def __init__(self, agent: Agent, index: int, layout: Format, stem: Path) -> None:
        self.agent = agent
        self.index = index
        self._format = layout
        self._stem = stem

    @property
    def cameras(self) -> int:
        """How many there are."""
        return len(self.agent.sensors.camera.mounts)

    def image(self, camera: int) -> NDArray[np.uint8]:
        """RGB picture (h, w, 3) of a camera."""
        return self._picture(f"_camera{camera}.png", cv2.IMREAD_COLOR_RGB)

    def semantic(self, camera: int) -> NDArray[np.uint8]:
        """Tags (h, w) of `Semantic` of a camera's pixels."""
        return unpainted(self._picture(f"_semantic{camera}.png", cv2.IMREAD_COLOR_RGB))

    def depth(self, camera: int) -> NDArray[np.uint8]:
        """Whole metres (h, w) along a camera's optical axis; 255 for that and all beyond."""
        return self._picture(f"_depth{camera}.png", cv2.IMREAD_UNCHANGED)

    def bird_view(self, kind: str) -> NDArray[np.uint8]:
        """Map (256, 256): dynamic, static, lane, visibility or visibility_corp."""
        return self._picture(f"_bev_{kind}.png", cv2.IMREAD_GRAYSCALE)

    @property
    def cloud(self) -> NDArray[np.void]:
        """The points as a table, with at least `x`, `y`, `z` in the LiDAR's frame, `intensity`.

        In the OPV2V layout also `range` in metres, `time` in seconds against the frame's, `ring`,
        `tag` of `Semantic`, `object_id`, `kind` of `PointKind`, and `raw_x`, `raw_y`, `raw_z`
        where the rig lets the LiDAR turn.
        """
        table = self._format.read_cloud(self.path(self._format.cloud)).copy()
        for name in {"y", "raw_y"} & set(table.dtype.names or ()):
            table[name] *= -1
        return table

    @property
    def points(self) -> NDArray[np.float32]:
        """Points (n, 3) in the LiDAR's frame."""
        return _columns(self.cloud, "x", "y", "z")

    @property
    def measured(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Points (n, 3) as the moving LiDAR saw them, and the time (n,) of each in seconds.

        In the order of `points`; where the rig does not let the LiDAR turn, those and zeros.
        """
        table = self.cloud
        if "raw_x" in (table.dtype.names or ()):
            return _columns(table, "raw_x", "raw_y", "raw_z"), table["time"]
        return _columns(table, "x", "y", "z"), np.zeros(len(table), np.float32)

    @cached_property
    def description(self) -> dict[str, Any]:
        """The frame's YAML as it stands in the file: left-handed, degrees, km/h."""
        path = self.path(".yaml")
        with damage_told(path):
            return yaml.load(path.read_bytes(), Loader=yaml.CSafeLoader)

    @property
    def extras(self) -> dict[str, Any]:
        """What more is known of each object, as it stands in `_objects.json`."""
        path = self.path("_objects.json")
        with damage_told(path):
            return json.loads(path.read_bytes())

    @property
    def world_from_agent(self) -> Matrix:
        """(4, 4) of the vehicle's origin on the ground, or of the roadside unit."""
        return self._pose("true_ego_pos")

    @property
    def world_from_lidar(self) -> Matrix:
        """(4, 4)."""
        return self._pose("lidar_pose")

    def world_from_camera(self, camera: int) -> Matrix:
        """(4, 4), body axes: x along the view, y left, z up."""
        return self._pose(f"camera{camera}", "cords")

    def intrinsic(self, camera: int) -> NDArray[np.float64]:
        """Pinhole matrix (3, 3) in pixels; optical axes x right, y down, z along the view."""
        with damage_told(self.path(".yaml")):
            return np.reshape(self._said(f"camera{camera}", "intrinsic"), (3, 3)).astype(np.float64)

    def pixels(self, camera: int, points_world: NDArray[np.float64]) -> NDArray[np.float64]:
        """Column, row and depth in metres (n, 3) of points (n, 3) of the world in a picture."""
        camera_from_world = poses.inverse(self.world_from_camera(camera))
        ahead, left, up = poses.transform(camera_from_world, points_world).T
        column, row, depth = self.intrinsic(camera) @ np.stack([-left, -up, ahead])
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.stack([column / depth, row / depth, depth], axis=1)

    @property
    def speed_m_s(self) -> float:
        """Of the vehicle; 0 for a roadside unit."""
        with damage_told(self.path(".yaml")):
            return float(self._said("ego_speed")) * M_S_PER_KM_H

    @property
    def boxes(self) -> Boxes:
        """Whom it annotates: vehicles first, then pedestrians."""
        with damage_told(self.path(".yaml")):
            return boxes_of(self._said("vehicles") | self._said("walkers"))

    def path(self, suffix: str) -> Path:
        """The file of this viewpoint and frame whose name ends so, as `.pcd`."""
        return self._stem.with_name(self._stem.name + suffix)

    def _pose(self, *keys: str) -> Matrix:
        with damage_told(self.path(".yaml")):
            return matrix_from_pose(self._said(*keys))

    def _said(self, *keys: str) -> Any:
        value: Any = self.description
        try:
            for key in keys:
                value = value[key]
        except (LookupError, TypeError) as error:
            path = self.path(".yaml")
            raise InputError(f"{path}: says nothing of {'.'.join(keys)}") from error
        return value

    def _picture(self, suffix: str, mode: int) -> NDArray[np.uint8]:
        path = self.path(suffix)
        image: Any = cv2.imread(str(path), mode)
        if image is None:
            raise InputError(f"{path}: is missing or no picture; {REMEDY}")
        return image


def _columns(table: NDArray[np.void], *names: str) -> NDArray[np.float32]:
    return np.column_stack([table[name] for name in names])
