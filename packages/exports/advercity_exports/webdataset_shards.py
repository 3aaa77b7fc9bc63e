"""WebDataset: shards of samples for training, a sample for every frame of every agent.

    shards/000000.tar      up to 50 frames of a scenario, with all agents of a frame together
    index.json             the shards with their numbers of samples, as `wids` reads it

A sample's key is `<scenario>-<frame>-<agent>`. Its members are `camera<k>.png` and, where the
dataset has them, `semantic<k>.png`, `depth<k>.png` (16 bits, centimetres) and `instance<k>.png`;
`lidar.npy` (n, 4) of x, y, z, intensity, and further ones `lidar<k>.npy`; `radar<k>.npy` (n, 6) of
x, y, z, velocity, rcs, snr; `boxes.json` and `calib.json`. Everything is right-handed, in metres
and radians: bodies x forward, y left, z up, cameras x right, y down, z along the view.
"""

import io
import json
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from advercity.dataset.agent_view import AgentView
from advercity.dataset.reader import Dataset, FrameView, Scenario
from advercity.exports.pieces import Piece, PieceFiles, make_common_piece, read_image_file
from advercity.exports.registry import Options
from advercity.geometry import poses
from advercity.geometry.poses import Matrix
from advercity.sensors.measurements import KELVIN_PER_COUNT
from advercity_exports.libraries import load_library

FRAMES_PER_SHARD = 50
IMAGE_MEMBERS = {"camera": "camera", "semantic": "semantic", "depth_cm": "depth"}
"""Names of members by kinds of images."""


def list_pieces(dataset: Dataset, options: Options) -> list[Piece]:
    """Make a piece of every shard, and one of the index.

    Raises:
        InputError: webdataset is not installed.
    """
    load_library("webdataset", "webdataset")
    pieces: list[Piece] = []
    counts: list[int] = []
    for scenario in dataset.scenarios:
        for start in range(0, len(scenario), FRAMES_PER_SHARD):
            positions = range(start, min(start + FRAMES_PER_SHARD, len(scenario)))
            numbers = [scenario.frame_numbers[position] for position in positions]
            path = f"shards/{len(pieces):06d}.tar"
            pieces.append(
                Piece(
                    name=f"{scenario.path.name} from frame {numbers[0]}",
                    inputs=f"{path}: {', '.join(map(str, numbers))}",
                    scenario=scenario.path.name,
                    frames=len(numbers),
                    write=partial(_write_shard, scenario, positions, path),
                )
            )
            counts.append(len(numbers) * len(scenario.agents))
    index = make_common_piece(dataset, "index", partial(_write_index, counts))
    return [*pieces, index]


def _write_index(counts: list[int], files: PieceFiles) -> None:
    shards = [
        {"url": f"shards/{number:06d}.tar", "nsamples": count}
        for number, count in enumerate(counts)
    ]
    document = {"__kind__": "wids-shard-index-v1", "wids_version": 1, "shardlist": shards}
    files.write("index.json", json.dumps(document, indent=1) + "\n")


def _write_shard(scenario: Scenario, positions: range, path: str, files: PieceFiles) -> None:
    library = load_library("webdataset", "webdataset")
    with files.open(path) as stream:
        # No clock: equal datasets give equal shards.
        writer = library.TarWriter(stream, encoder=False, mtime=0)
        for frame in files.track(scenario[position] for position in positions):
            for view in frame.views.values():
                key = f"{scenario.path.name}-{frame.name}-{view.agent.id}"
                writer.write({"__key__": key, **dict(_encode_members(frame, view))})
        writer.close()


def _encode_members(frame: FrameView, view: AgentView) -> Iterator[tuple[str, bytes]]:
    for camera in range(view.cameras):
        for kind, member in IMAGE_MEMBERS.items():
            if view.has_truth(kind, camera):
                yield f"{member}{camera}.png", read_image_file(view.path(f"_{kind}{camera}.png"))
        if view.has_truth("instance", camera):
            path = view.path(f"_instance{camera}.png")
            yield f"instance{camera}.png", read_image_file(path)
    for thermal in range(view.thermals):
        yield f"thermal{thermal}.png", read_image_file(view.path(f"_thermal{thermal}.png"))
    for lidar in range(view.lidars):
        cloud = view.load_cloud(lidar)
        yield f"lidar{lidar or ''}.npy", _encode_columns(cloud, "x", "y", "z", "intensity")
    for radar in range(view.radars):
        found = view.load_radar(radar)
        columns = ("x", "y", "z", "velocity", "rcs", "snr")
        yield f"radar{radar}.npy", _encode_columns(found, *columns)
    yield "boxes.json", _encode_json(_describe_boxes(view))
    yield "calib.json", _encode_json(_describe_calibration(frame, view))


def _encode_columns(table: NDArray[np.void], *names: str) -> bytes:
    stream = io.BytesIO()
    np.save(stream, np.column_stack([table[name] for name in names]).astype(np.float32))
    return stream.getvalue()


def _encode_json(document: Any) -> bytes:
    return json.dumps(document, allow_nan=False).encode()


def _describe_boxes(view: AgentView) -> dict[str, Any]:
    """Describe objects: boxes in the first LiDAR's frame as x, y, z, length, width, height, yaw."""
    boxes = view.boxes
    lidar_from_box = poses.invert_pose(view.world_from_lidar) @ boxes.world_from_box
    yaws = np.arctan2(lidar_from_box[:, 1, 0], lidar_from_box[:, 0, 0])
    return {
        "ids": boxes.ids.tolist(),
        "classes": boxes.classes.tolist(),
        "boxes": np.column_stack([lidar_from_box[:, :3, 3], boxes.sizes, yaws]).tolist(),
        "world_from_box": boxes.world_from_box.tolist(),
        "speeds_m_s": boxes.speeds_m_s.tolist(),
        "lidar_points": boxes.lidar_points.tolist(),
        "visible_fraction": boxes.visible_fraction.tolist(),
        "is_parked": boxes.is_parked.tolist(),
    }


def _describe_thermals(view: AgentView) -> dict[str, Any]:
    numbers, optical = range(view.thermals), poses.invert_pose(poses.OPTICAL_FROM_BODY)
    return {
        "world_from_thermal": [(view.load_thermal_pose(n) @ optical).tolist() for n in numbers],
        "thermal_intrinsic": [view.load_thermal_model(n).matrix.tolist() for n in numbers],
        "kelvin_per_count": KELVIN_PER_COUNT,
    }


def _describe_calibration(frame: FrameView, view: AgentView) -> dict[str, Any]:
    """Describe poses (4, 4) in the world, and pinhole matrices (3, 3) of cameras."""

    def to_optical(world_from_camera: Matrix) -> list[list[float]]:
        return (world_from_camera @ poses.invert_pose(poses.OPTICAL_FROM_BODY)).tolist()

    return {
        "scenario": frame.scenario.path.name,
        "agent": view.agent.id,
        "frame": frame.index,
        "time_s": frame.time_s,
        **({"stamps": view.stamps} if view.stamps else {}),
        "world_from_agent": view.world_from_agent.tolist(),
        "world_from_lidar": [view.load_lidar_pose(n).tolist() for n in range(view.lidars)],
        "world_from_radar": [view.load_radar_pose(n).tolist() for n in range(view.radars)],
        "world_from_camera": [to_optical(view.world_from_camera(n)) for n in range(view.cameras)],
        "intrinsic": [view.intrinsic(n).tolist() for n in range(view.cameras)],
        **(_describe_thermals(view) if view.thermals else {}),
        "has_lens": [one.model.lens is not None for one in view.agent.sensors.cameras],
    }
