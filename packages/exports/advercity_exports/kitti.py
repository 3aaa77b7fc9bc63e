"""KITTI's layout of the 3-D object benchmark: a sample for every frame of every agent.

    training/image_2/000000.png      first camera
    training/velodyne/000000.bin     first LiDAR: x, y, z, intensity as float32
    training/calib/000000.txt        P0 to P3, R0_rect, Tr_velo_to_cam, Tr_imu_to_velo
    training/label_2/000000.txt      objects shown by the image, or hidden in it
    training/oxts/000000.txt         position and motion, in the 30 columns of the raw recordings
    training/samples.csv             which agent and frame a sample is of
    ImageSets/trainval.txt           all samples; of a dataset in splits also train, val and test

Frames of the calibration: `velo` x forward, y left, z up, as here; `cam` x right, y down, z along
the view; `rect` is `cam` turned so its y axis is the LiDAR's z axis downwards. Labels have a
single angle, so upright objects fit in `rect` only. KITTI's cameras look straight ahead, and
`rect` is `cam` but for a fraction of a degree; cameras of a roadside unit look down: there,
`R0_rect` has the tilt and `P2` takes it back: `P2 @ R0_rect @ Tr_velo_to_cam` is the projection.
"""

import csv
import io
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from advercity.dataset.agent_view import AgentView
from advercity.dataset.boxes import Boxes
from advercity.dataset.reader import Dataset, FrameView
from advercity.exports.pieces import Piece, PieceFiles, make_common_piece, split_by_frame
from advercity.exports.registry import Options
from advercity.geometry import poses
from advercity.geometry.poses import Matrix
from advercity_exports.oxts import format_oxts
from advercity_exports.requirements import require_pinholes, require_truth

TYPES = {
    "car": "Car",
    "van": "Van",
    "truck": "Truck",
    "pedestrian": "Pedestrian",
    "bicycle": "Cyclist",
    "motorcycle": "Misc",
}
"""KITTI's types by class; it has none for motorcycles."""
TRAILER = "Misc"
"""KITTI's type of objects without a type; its authors name trailers as an example."""
PARTLY_OCCLUDED, LARGELY_OCCLUDED = 0.25, 0.6
"""Least hidden fractions of partly and largely occluded outlines. KITTI gives no numbers."""
SPLIT_LISTS = {"train": "train", "validate": "val", "test": "test"}
"""KITTI's lists by the folders of `advercity split`."""


def list_pieces(dataset: Dataset, options: Options) -> list[Piece]:
    """Make a piece of every frame, and one of the lists of samples.

    Raises:
        InputError: A scenario has the original's layout, or a front camera has a lens.
    """
    require_truth(dataset, "kitti")
    require_pinholes(dataset, "kitti", lambda agent: range(1))
    return [
        *split_by_frame(dataset, _write_frame, count_samples=lambda one: len(one.agents)),
        make_common_piece(dataset, "samples", lambda files: _write_lists(dataset, files)),
    ]


def _write_frame(frame: FrameView, number: int, files: PieceFiles) -> None:
    for sample, view in enumerate(frame.views.values(), start=number):
        name = f"{sample:06d}"
        calibration = Calibration.from_view(view)
        files.copy(view.path("_camera0.png"), f"training/image_2/{name}.png")
        files.write(f"training/velodyne/{name}.bin", _encode_points(view))
        files.write(f"training/calib/{name}.txt", calibration.format())
        files.write(f"training/label_2/{name}.txt", _format_labels(view, calibration))
        files.write(f"training/oxts/{name}.txt", format_oxts(frame, view))


@dataclass(frozen=True, eq=False)
class Calibration:
    """Calibration of a sample.

    Attributes:
        image_from_rect: (3, 4), to columns, rows and 1, times the depth.
        rect_from_cam: (4, 4).
        cam_from_velo: (4, 4).
        velo_from_imu: (4, 4); `imu` is the origin of the vehicle, on the ground.
        cam_from_world: (4, 4).
    """

    image_from_rect: Matrix
    rect_from_cam: Matrix
    cam_from_velo: Matrix
    velo_from_imu: Matrix
    cam_from_world: Matrix

    @property
    def rect_from_world(self) -> Matrix:
        """Pose (4, 4) of the world in the frame of labels."""
        return self.rect_from_cam @ self.cam_from_world

    @staticmethod
    def from_view(view: AgentView) -> "Calibration":
        """Build the calibration of an agent's first camera and first LiDAR in a frame."""
        cam_from_world = poses.OPTICAL_FROM_BODY @ poses.invert_pose(view.world_from_camera(0))
        velo_from_world = poses.invert_pose(view.world_from_lidar)
        cam_from_velo = cam_from_world @ view.world_from_lidar
        rect_from_cam = _turn_upright(cam_from_velo[:3, 2])
        projection = np.zeros((3, 4))
        projection[:, :3] = view.intrinsic(0) @ rect_from_cam[:3, :3].T
        return Calibration(
            image_from_rect=projection,
            rect_from_cam=rect_from_cam,
            cam_from_velo=cam_from_velo,
            velo_from_imu=velo_from_world @ view.world_from_agent,
            cam_from_world=cam_from_world,
        )

    def format(self) -> str:
        """Format it as KITTI's devkit reads it; the other three cameras repeat the first."""
        rows = {
            **{f"P{number}": self.image_from_rect for number in range(4)},
            "R0_rect": self.rect_from_cam[:3, :3],
            "Tr_velo_to_cam": self.cam_from_velo[:3],
            "Tr_imu_to_velo": self.velo_from_imu[:3],
        }
        lines = [f"{key}: {' '.join(f'{x:.12e}' for x in m.flat)}" for key, m in rows.items()]
        return "\n".join([*lines, ""])


def _turn_upright(up: NDArray[np.float64]) -> Matrix:
    """Build the rotation (4, 4) of optical axes from `up` (3,) to -y.

    The view stays ahead. If `up` is -y already it is the identity, to the last bit.
    """
    down = -up
    if np.allclose(down, (0.0, 1.0, 0.0), atol=1e-9):
        return np.eye(4)
    ahead = np.array([0.0, 0.0, 1.0]) - down[2] * down
    ahead /= np.linalg.norm(ahead)
    result = np.eye(4)
    result[:3, :3] = np.cross(down, ahead), down, ahead
    return result


def _encode_points(view: AgentView) -> bytes:
    """Encode the first LiDAR's points: x, y, z in its frame, and intensity from 0 to 1."""
    cloud = view.cloud
    return (
        np.column_stack([cloud[name] for name in ("x", "y", "z", "intensity")])
        .astype("<f4")
        .tobytes()
    )


def _format_labels(view: AgentView, calibration: Calibration) -> str:
    """Format a line for every object whose outline overlaps the image."""
    boxes, extras = view.boxes, view.extras["objects"]
    lines: list[str] = []
    for row, number in enumerate(boxes.ids.tolist()):
        shown = extras[str(number)]["cameras"].get("camera0")
        if shown is not None:
            lines.append(_format_label(boxes, row, shown, calibration))
    return "".join(f"{line}\n" for line in lines)


def _format_label(
    boxes: Boxes, row: int, shown: Mapping[str, Any], calibration: Calibration
) -> str:
    """Format an object: type, truncation, occlusion, alpha, image box, size, place, angle."""
    rect_from_box = calibration.rect_from_world @ boxes.world_from_box[row]
    length, width, height = boxes.sizes[row]
    # The middle of the bottom of an upright box.
    x, y, z = rect_from_box[:3, 3] + (0.0, height / 2, 0.0)
    ahead = rect_from_box[:3, 0]
    angle = math.atan2(-ahead[2], ahead[0])
    alpha = math.remainder(angle - math.atan2(x, z), math.tau)
    in_image = " ".join(f"{edge:.2f}" for edge in shown["outline_box"])
    in_space = " ".join(f"{value:.6f}" for value in (height, width, length, x, y, z, angle))
    kind = TRAILER if boxes.towed_by[row] else TYPES[boxes.classes[row]]
    return (
        f"{kind} {shown['truncation']:.4f} {_grade_occlusion(shown)}"
        f" {alpha:.6f} {in_image} {in_space}"
    )


def _grade_occlusion(shown: Mapping[str, Any]) -> int:
    """Grade how much is hidden: 0 little, 1 a part, 2 most of it."""
    hidden = shown["occlusion"]
    return int(hidden >= PARTLY_OCCLUDED) + int(hidden >= LARGELY_OCCLUDED)


def _write_lists(dataset: Dataset, files: PieceFiles) -> None:
    """Write the table of samples, and readers' lists of sample numbers."""
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(["sample", "scenario", "agent", "frame", "time_s"])
    lists: dict[str, list[str]] = {"trainval": []}
    for scenario in dataset.scenarios:
        split = SPLIT_LISTS.get(scenario.path.parent.name)
        for frame in scenario:
            for view in frame.views.values():
                name = f"{len(lists['trainval']):06d}"
                row = (name, scenario.path.name, view.agent.id, frame.index, f"{frame.time_s:g}")
                writer.writerow(row)
                lists["trainval"].append(name)
                if split is not None:
                    lists.setdefault(split, []).append(name)
    files.write("training/samples.csv", table.getvalue())
    for name, samples in lists.items():
        files.write(f"ImageSets/{name}.txt", "".join(f"{sample}\n" for sample in samples))
