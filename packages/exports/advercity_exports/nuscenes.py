"""nuScenes: tables, key frames and sweeps of every agent, masks of the roads.

v1.0-trainval/*.json      the tables, splits.json, and cooperation.json: who saw an object when
samples/CAM_FRONT/*.png   key frames of a sensor; LiDARs .pcd.bin, radars .pcd
sweeps/CAM_FRONT/*.png    the frames between
maps/*.png                masks of lanes and sidewalks, 0.1 m a pixel
"""

import cv2
import numpy as np
from advercity_dsl.road import Road
from numpy.typing import NDArray

from advercity.dataset.agent_view import AgentView
from advercity.dataset.cloud_files import format_pcd_header
from advercity.dataset.image_codec import encode_label_png
from advercity.dataset.reader import Dataset, FrameView
from advercity.exports.pieces import Piece, PieceFiles, make_common_piece, split_by_frame
from advercity.exports.registry import Options
from advercity.roads.road_network import build_road
from advercity_exports.nuscenes_scene import Channel, list_scenes
from advercity_exports.nuscenes_tables import MapExtent, write_tables
from advercity_exports.requirements import require_pinholes, require_truth

MAX_INTENSITY = 255.0
RADAR_RECORD = np.dtype(
    [
        *((name, "<f4") for name in ("x", "y", "z")),
        ("dyn_prop", "i1"),
        ("id", "<i2"),
        *((name, "<f4") for name in ("rcs", "vx", "vy", "vx_comp", "vy_comp")),
        *((name, "i1") for name in ("is_quality_valid", "ambig_state", "x_rms", "y_rms")),
        *((name, "i1") for name in ("invalid_state", "pdh0", "vx_rms", "vy_rms")),
    ]
)
"""A detection, by the names of nuScenes."""
MOVING, STATIONARY, UNAMBIGUOUS = 0, 1, 3
MOVING_FROM_M_S = 0.5


def list_pieces(dataset: Dataset, options: Options) -> list[Piece]:
    """Make a piece of every frame, one of every road's mask, and one of the tables.

    Raises:
        InputError: A scenario has the original's layout, or a camera has a lens.
    """
    require_truth(dataset, "nuscenes")
    require_pinholes(dataset, "nuscenes")
    some = options["key_frames"] == "2hz"
    extents: dict[str, MapExtent] = {}
    roads: dict[str, Road] = {}
    for scenario in dataset.scenarios:
        extent = MapExtent.from_road(scenario.spec.road)
        extents[scenario.path.name] = extent
        roads[extent.path] = scenario.spec.road

    def write_frame(frame: FrameView, number: int, files: PieceFiles) -> None:
        for scene in list_scenes(frame.scenario, only_some_are_key=some):
            view = frame[scene.agent.id]
            for channel in scene.channels:
                _write_reading(view, channel, scene.format_path(channel, frame), files)

    return [
        *split_by_frame(dataset, write_frame),
        *(
            make_common_piece(dataset, path, lambda files, road=road: _write_map(road, files))
            for path, road in sorted(roads.items())
        ),
        make_common_piece(
            dataset,
            "tables",
            lambda files: write_tables(dataset, extents, files, only_some_are_key=some),
        ),
    ]


def _write_reading(view: AgentView, channel: Channel, path: str, files: PieceFiles) -> None:
    if channel.modality == "camera":
        files.copy(view.path(f"_camera{channel.number}.png"), path)
    elif channel.modality == "lidar":
        files.write(path, _encode_lidar(view, channel.number))
    else:
        files.write(path, _encode_radar(view, channel.number))


def _encode_lidar(view: AgentView, lidar: int) -> bytes:
    """Encode points: x right, y forward, z up, intensity from 0 to 255, ring."""
    cloud = view.load_cloud(lidar)
    table = np.empty((len(cloud), 5), "<f4")
    table[:, 0], table[:, 1], table[:, 2] = -cloud["y"], cloud["x"], cloud["z"]
    table[:, 3] = cloud["intensity"] * MAX_INTENSITY
    table[:, 4] = cloud["ring"]
    return table.tobytes()


def _encode_radar(view: AgentView, radar: int) -> bytes:
    """Encode detections; the velocity of each is its radial one, along the line of sight.

    Compensated velocities are over ground: without the part of the agent's own motion.
    """
    found = view.load_radar(radar)
    table = np.zeros(max(1, len(found)), RADAR_RECORD)
    if not len(found):
        table["x"] = np.nan  # nuScenes' mark of an empty cloud
        return _encode_records(table)
    points = np.column_stack([found[axis] for axis in "xyz"]).astype(np.float64)
    sight = points / np.maximum(np.linalg.norm(points, axis=1, keepdims=True), 1e-6)
    own = view.speed_m_s * view.world_from_agent[:3, 0] @ view.load_radar_pose(radar)[:3, :3]
    over_ground = found["velocity"] + sight @ own
    table["x"], table["y"], table["z"] = points.T
    table["id"] = np.arange(len(found)) % np.iinfo(np.int16).max
    table["rcs"] = found["rcs"]
    table["vx"], table["vy"] = (found["velocity"][:, None] * sight[:, :2]).T
    table["vx_comp"], table["vy_comp"] = (over_ground[:, None] * sight[:, :2]).T
    table["dyn_prop"] = np.where(np.abs(over_ground) >= MOVING_FROM_M_S, MOVING, STATIONARY)
    table["is_quality_valid"], table["ambig_state"] = 1, UNAMBIGUOUS
    return _encode_records(table)


def _encode_records(table: NDArray[np.void]) -> bytes:
    # The devkit asks for at least a byte behind the last record.
    header = format_pcd_header(len(table), table.dtype, "binary")
    return header.encode("ascii") + table.tobytes() + b"\n"


def _write_map(road: Road, files: PieceFiles) -> None:
    """Write the mask of a road: 255 on lanes, sidewalks and crossings."""
    extent = MapExtent.from_road(road)
    image = np.zeros((extent.height_px, extent.width_px), np.uint8)
    shift = 4
    for lane in build_road(road).lanes:
        outline = np.concatenate([lane.left, lane.right[::-1]])[:, :2]
        pixels = extent.to_pixels(outline) - 0.5  # OpenCV counts from the middle of pixel 0
        corners = np.rint(pixels * 2**shift).astype(np.int32)
        cv2.fillPoly(image, [corners], 255, shift=shift)
    files.write(extent.path, encode_label_png(image))
