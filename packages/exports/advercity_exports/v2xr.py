"""V2X-R's folders, for readers with fusion of LiDAR and 4-D radar.

    train/<scenario>/+101/000060.yaml          as in the dataset: poses, calibration, objects
    train/<scenario>/+101/000060.pcd           first LiDAR, as in the dataset
    train/<scenario>/+101/000060_radar.pcd     all radars of the agent in the first LiDAR's frame
    train/<scenario>/+101/000060_camera0.png   cameras, as in the dataset

Radar points are left-handed as everything there. `rgb` has the signal-to-noise ratio in its red
channel, where loaders of OPV2V look for intensities.
"""

import numpy as np
from numpy.typing import NDArray

from advercity.dataset.agent_view import AgentView
from advercity.dataset.cloud_files import encode_pcd_table
from advercity.dataset.reader import Dataset, FrameView
from advercity.exports.pieces import Piece, PieceFiles, split_by_frame
from advercity.exports.registry import Options
from advercity.geometry import poses
from advercity_exports.requirements import require_truth

SPLITS = ("train", "validate", "test")
DEFAULT_SPLIT = "train"
FULL_SCALE_DB = 60.0
"""Signal-to-noise ratio of the brightest red."""
RADAR_POINT = np.dtype(
    [
        *((name, "<f4") for name in ("x", "y", "z")),
        ("rgb", "<u4"),
        *((name, "<f4") for name in ("velocity", "rcs", "snr")),
    ]
)


def list_pieces(dataset: Dataset, options: Options) -> list[Piece]:
    """Make a piece of every frame.

    Raises:
        InputError: A scenario has the original's layout.
    """
    require_truth(dataset, "v2xr")
    return split_by_frame(dataset, _write_frame)


def _write_frame(frame: FrameView, number: int, files: PieceFiles) -> None:
    scenario = frame.scenario
    parent = scenario.path.parent.name
    split = parent if parent in SPLITS else DEFAULT_SPLIT
    for view in frame.views.values():
        folder = scenario.format.format_folder(view.agent)
        stem = f"{split}/{scenario.path.name}/{folder}/{frame.name}"
        for suffix in (".pcd", *(f"_camera{number}.png" for number in range(view.cameras))):
            files.copy(view.path(suffix), f"{stem}{suffix}")
        files.write(f"{stem}_radar.pcd", encode_pcd_table(_merge_radars(view), "binary"))
        # Last, since loaders take a frame for existing when they find it.
        files.copy(view.path(".yaml"), f"{stem}.yaml")


def _merge_radars(view: AgentView) -> NDArray[np.void]:
    """Merge the detections (n,) of all radars of an agent, right-handed in the LiDAR's frame."""
    tables: list[NDArray[np.void]] = [np.empty(0, RADAR_POINT)]
    lidar_from_world = poses.invert_pose(view.world_from_lidar)
    for radar in range(view.radars):
        found = view.load_radar(radar)
        points = np.column_stack([found[axis] for axis in "xyz"])
        lidar_from_radar = lidar_from_world @ view.load_radar_pose(radar)
        table = np.empty(len(found), RADAR_POINT)
        table["x"], table["y"], table["z"] = poses.transform_points(lidar_from_radar, points).T
        red = np.clip(found["snr"] / FULL_SCALE_DB, 0.0, 1.0) * 255.0
        table["rgb"] = np.rint(red).astype(np.uint32) << 16
        for name in ("velocity", "rcs", "snr"):
            table[name] = found[name]
        tables.append(table)
    return np.concatenate(tables)
