"""One agent's files of a frame written by another program."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from advercity.dataset.agent_view import AgentView, report_read_errors
from advercity.dataset.boxes import Boxes
from advercity.dataset.carla_frame import mirror_columns
from advercity.dataset.foreign_descriptions import (
    audit_description,
    complete_description,
    count_sensors,
    has_matrices,
)
from advercity.dataset.formats import DatasetFormat
from advercity.errors import InputError
from advercity.foreign.ledger import Ledger
from advercity.geometry import poses
from advercity.sensors.camera_model import CameraModel


class ForeignView(AgentView):
    """The data of one agent of a foreign folder in one frame.

    Properties are as in `AgentView` if there are files for them. Numbers missing in the
    folder are NaN. `description` is completed to advercity's fields.

    Args:
        number: Number of the agent.
        index: Number of the frame in the scenario.
        layout: Layout of the files.
        stem: Beginning of the paths of all its files.
        is_ego: Whether the agent is the ego.
    """

    hint = "take it again from where the folder comes from"

    def __init__(
        self, number: int, index: int, layout: DatasetFormat, stem: Path, *, is_ego: bool
    ) -> None:
        super().__init__(None, index, layout, stem)
        self._number, self._is_ego = number, is_ego
        self._is_right_handed = False

    @property
    def id(self) -> str:
        """Number of the agent as text."""
        return str(self._number)

    @property
    def number(self) -> int:
        """Number of the agent; negative for roadside units."""
        return self._number

    @property
    def is_ego(self) -> bool:
        """Whether the agent is the ego."""
        return self._is_ego

    @property
    def is_roadside_unit(self) -> bool:
        """Whether the agent is a roadside unit, by its negative number."""
        return self._number < 0

    def count(self, kind: str) -> int:
        """Count the sensors of a kind, such as `radar`, described by the frame."""
        return count_sensors(self.description, kind)

    def has_truth(self, kind: str, camera: int) -> bool:
        """Return whether a camera has images of truth of a kind: `instance`, `normal`, `flow`."""
        return self.path(f"_{kind}{camera}.png").is_file()

    def load_cloud(self, lidar: int) -> NDArray[np.void]:
        """Load the point table (n,) of a LiDAR: `x`, `y`, `z` and the other fields of its file."""
        table = super().load_cloud(lidar)
        if self._is_right_handed:
            mirror_columns(table)  # back: these points are right-handed in the file
        return table

    def camera_model(self, camera: int) -> CameraModel:
        """Return the projection of a camera, a pinhole, for the image in its file.

        Raises:
            InputError: Its description has a lens or skewed pixels, or there is no image.
        """
        matrix = self.intrinsic(camera)
        has_lens = "distortion_model" in self.description[f"camera{camera}"]
        if has_lens or matrix[0, 1] or not matrix[0, 0]:
            raise InputError(
                f"{self.path('.yaml')}: camera{camera} is no pinhole with rectangular pixels;"
                " project with `intrinsic` and its lens yourself"
            )
        height, width = self.image(camera).shape[:2]
        column, row = (matrix[:2, 2] - (width / 2, height / 2)).tolist()
        return CameraModel(
            width,
            height,
            float(matrix[0, 0]),
            pixel_aspect=float(matrix[1, 1] / matrix[0, 0]),
            offset_px=(column, row),
        )

    @property
    def boxes(self) -> Boxes:
        """The annotated objects: vehicles first, then pedestrians.

        Without them in the folder, `lidar_points` are counted in the box; `lidar_hits` are -1.
        """
        boxes = super().boxes
        if not len(boxes) or boxes.lidar_points.min() >= 0:
            return boxes
        return replace(boxes, lidar_points=self._count_points(boxes))

    def audit(self, ledger: Ledger) -> None:
        """Record which keys of the frame are not read."""
        with report_read_errors(self.path(".yaml"), self.hint):
            audit_description(self._load_file(), ledger)

    def _count_points(self, boxes: Boxes) -> NDArray[np.int64]:
        """Count the points (n,) of the first LiDAR in boxes."""
        points = poses.transform_points(self.world_from_lidar, self.points)
        inside = [
            np.abs(poses.transform_points(poses.invert_pose(pose), points)) <= size / 2
            for pose, size in zip(boxes.world_from_box, boxes.sizes, strict=True)
        ]
        return np.array([int(rows.all(axis=1).sum()) for rows in inside], np.int64)

    def _check_asked(self, kind: str, camera: int, declaration: str) -> None:
        """Leave it to the file of the image, which may be missing."""

    def _has_motion_file(self) -> bool:
        return self.path(self._format.motion_suffix).is_file()

    def _load_file(self) -> dict[str, Any]:
        """Load the frame's YAML as it is in the file."""
        return super()._load_description()

    def _load_description(self) -> dict[str, Any]:
        found = self._load_file()
        with report_read_errors(self.path(".yaml"), self.hint):
            self._is_right_handed = has_matrices(found)
            return complete_description(found, number=self._number)
