from pathlib import Path

import numpy as np
import pytest

from advercity.dataset import cloud_files
from advercity.errors import InputError
from tests.builders import SensorFramesOf


def test_the_table_has_every_field_of_a_point(
    sensor_frames_of: SensorFramesOf, tmp_path: Path
) -> None:
    cloud = sensor_frames_of(0)[0].point_cloud
    path = tmp_path / "points.pcd"
    path.write_bytes(cloud_files.encode_pcd(cloud, raw=True))
    table = cloud_files.read_pcd(path)
    for name, column in {
        "intensity": cloud.intensity,
        "range": cloud.range_m,
        "time": cloud.time_s,
        "ring": cloud.ring,
        "tag": cloud.semantic,
        "object_id": cloud.instance,
        "kind": cloud.kind,
        "x": cloud.points[:, 0],
        "y": -cloud.points[:, 1],
        "raw_y": -cloud.raw[:, 1],
        "raw_z": cloud.raw[:, 2],
    }.items():
        np.testing.assert_array_equal(table[name], column, err_msg=name)


def test_a_scan_without_motion_takes_36_bytes_a_point(sensor_frames_of: SensorFramesOf) -> None:
    cloud = sensor_frames_of(0)[0].point_cloud
    header, _, body = cloud_files.encode_pcd(cloud).partition(b"DATA binary\n")
    assert len(body) == 36 * len(cloud.points)
    assert b"raw" not in header


def test_the_same_cloud_gives_the_same_bytes(sensor_frames_of: SensorFramesOf) -> None:
    cloud = sensor_frames_of(1)[2].point_cloud
    assert cloud_files.encode_pcd(cloud) == cloud_files.encode_pcd(cloud)


@pytest.mark.parametrize(
    "content", [b"something else", b"DATA binary\n", b"POINTS x\nDATA binary\n"]
)
def test_another_file_is_refused_as_a_cloud(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "points.pcd"
    path.write_bytes(content)
    with pytest.raises(InputError, match="not a binary point cloud"):
        cloud_files.read_pcd(path)
