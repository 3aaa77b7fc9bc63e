"""LiDARs in a dataset: their clouds and poses."""

from functools import partial
from typing import Any

import numpy as np
from advercity_dsl import Agent
from numpy.typing import NDArray

from advercity.dataset import cloud_files
from advercity.dataset.agent_view import AgentView, extract_measured
from advercity.dataset.carla_frame import carla_pose_from_matrix, mirror_points
from advercity.dataset.formats import ADVER_CITY, DatasetFormat
from advercity.dataset.plain_documents import to_plain
from advercity.dataset.sensor_files import EncodingJobs, FileOptions, SensorFiles
from advercity.sensors.measurements import PointCloud
from advercity.sensors.sensor_frame import LidarScan, SensorFrame


def _list_suffixes(agent: Agent, number: int, layout: DatasetFormat) -> tuple[str, ...]:
    return (layout.format_cloud_suffix(number),)


def _encode(item: SensorFrame, number: int, options: FileOptions) -> EncodingJobs:
    cloud = item.lidar_scans[number].point_cloud
    if options.layout == ADVER_CITY:
        job = partial(_encode_ply, cloud)
    else:
        raw = item.agent.sensors.lidars[number].motion_distortion
        job = partial(cloud_files.encode_pcd, cloud, raw=raw, encoding=options.clouds)
    return {options.layout.format_cloud_suffix(number): job}


def _encode_ply(cloud: PointCloud) -> bytes:
    return cloud_files.encode_ply(mirror_points(cloud.points), intensity=cloud.intensity)


def _describe(item: SensorFrame, number: int) -> dict[str, Any]:
    pose = item.lidar_scans[number].world_from_lidar
    return {f"lidar{number or ''}_pose": to_plain(carla_pose_from_matrix(pose))}


def _read(view: AgentView, number: int) -> LidarScan:
    """Read a scan; the first has the hits of all LiDARs, which are kept as sums."""
    boxes = view.boxes
    hits = dict(zip(boxes.ids.tolist(), boxes.lidar_hits.tolist(), strict=True))
    return LidarScan(
        view.load_lidar_pose(number),
        _read_point_cloud(view, number),
        {} if number else hits,
        view.stamps.get(f"lidar{number}"),
    )


def _read_point_cloud(view: AgentView, number: int) -> PointCloud:
    """Read a point cloud; columns missing in the layout are zero."""
    table = view.load_cloud(number)
    points = np.column_stack([table["x"], table["y"], table["z"]])
    kept = table.dtype.names or ()
    nothing = np.zeros(len(table))
    raw, time_s = extract_measured(table)

    def column(name: str, kind: type[np.generic]) -> NDArray[Any]:
        return (table[name] if name in kept else nothing).astype(kind)

    return PointCloud(
        points=points,
        raw=raw,
        intensity=table["intensity"],
        ring=column("ring", np.uint16),
        time_s=time_s,
        range_m=np.linalg.norm(raw, axis=1),
        semantic=column("tag", np.uint8),
        instance=column("object_id", np.int32),
        kind=column("kind", np.uint8),
    )


FILES = SensorFiles(
    read=_read,
    list_suffixes=_list_suffixes,
    encode=_encode,
    describe=_describe,
    locate=AgentView.load_lidar_pose,
)
