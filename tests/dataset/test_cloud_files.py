import struct
from dataclasses import fields
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from advercity.dataset import cloud_files
from advercity.errors import InputError
from advercity.run_options import CloudEncoding
from advercity.sensors.measurements import PointCloud
from tests.builders import SensorFramesOf


@pytest.mark.parametrize("encoding", get_args(CloudEncoding))
def test_the_table_has_every_field_of_a_point(
    sensor_frames_of: SensorFramesOf, tmp_path: Path, encoding: CloudEncoding
) -> None:
    cloud = sensor_frames_of(0)[0].point_cloud
    path = tmp_path / "points.pcd"
    path.write_bytes(cloud_files.encode_pcd(cloud, raw=True, encoding=encoding))
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
    header, _, body = cloud_files.encode_pcd(cloud, encoding="binary").partition(b"DATA binary\n")
    assert len(body) == 36 * len(cloud.points)
    assert b"raw" not in header


def test_the_same_cloud_gives_the_same_bytes(sensor_frames_of: SensorFramesOf) -> None:
    cloud = sensor_frames_of(1)[2].point_cloud
    assert cloud_files.encode_pcd(cloud) == cloud_files.encode_pcd(cloud)


@pytest.mark.parametrize(
    "content",
    [
        b"something else",
        b"DATA binary\n",
        b"POINTS x\nDATA binary\n",
        b"FIELDS x y\nSIZE 4 4\nTYPE F F F\nPOINTS 0\nDATA binary\n",
        b"FIELDS x y z\nSIZE 4 4\nTYPE F F\nPOINTS 0\nDATA binary\n",
        b"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nPOINTS 0\nDATA binary\n",
        b"FIELDS x y z\nSIZE 4 <<: 4\nTYPE F F F\nPOINTS 0\nDATA binary\n",
        b"FIELDS x y z\nSIZE 4 4, 4\nTYPE F F F\nPOINTS 0\nDATA binary\n",
        b"FIELDS x y z\nSIZE 4 3 4\nTYPE F F F\nPOINTS 0\nDATA binary\n",
        b"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nPOINTS\nDATA binary\n",
    ],
)
def test_another_file_is_refused_as_a_cloud(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "points.pcd"
    path.write_bytes(content)
    with pytest.raises(InputError, match="not a point cloud"):
        cloud_files.read_pcd(path)


def test_a_cloud_with_a_misspelt_field_is_refused_by_name(
    lidar_like: PointCloud, tmp_path: Path
) -> None:
    path = tmp_path / "points.pcd"
    path.write_bytes(cloud_files.encode_pcd(lidar_like).replace(b"object_id", b"objectXid"))
    with pytest.raises(InputError, match="no field 'object_id' of type <i4"):
        cloud_files.read_pcd(path)


@pytest.fixture
def lidar_like() -> PointCloud:
    """A level sweep of 32 channels at one range, whose fields repeat as those of a scan do."""
    azimuth = np.repeat(np.linspace(0.0, 6.0, 500), 32).astype(np.float32)
    flat = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros_like(azimuth)], axis=1) * 20.0
    count = len(azimuth)
    return PointCloud(
        points=flat,
        raw=flat,
        intensity=np.full(count, 0.5, np.float32),
        ring=np.tile(np.arange(32, dtype=np.uint16), 500),
        time_s=np.zeros(count, np.float32),
        range_m=np.full(count, 20.0, np.float32),
        semantic=np.ones(count, np.uint8),
        instance=np.zeros(count, np.int32),
        kind=np.zeros(count, np.uint8),
    )


def test_open3d_reads_a_compressed_cloud(lidar_like: PointCloud, tmp_path: Path) -> None:
    open3d = pytest.importorskip("open3d", reason="install the extra bench for Open3D")
    path = tmp_path / "points.pcd"
    path.write_bytes(cloud_files.encode_pcd(lidar_like, encoding="binary_compressed"))
    found = open3d.io.read_point_cloud(str(path))
    np.testing.assert_array_equal(np.asarray(found.points), lidar_like.points * (1, -1, 1))
    np.testing.assert_allclose(np.asarray(found.colors)[:, 0], 128 / 255)


def test_compressed_data_are_blocks_of_fields(lidar_like: PointCloud) -> None:
    """PCD's `binary_compressed`: two sizes, then the LZF data of all x, all y, and so on."""
    header, _, body = cloud_files.encode_pcd(lidar_like).partition(b"DATA binary_compressed\n")
    assert b"FIELDS x y z rgb" in header
    packed, unpacked = struct.unpack_from("<II", body)
    assert (packed, unpacked) == (len(body) - 8, 36 * len(lidar_like.points))
    assert packed < unpacked / 3
    fields = decompress_lzf(body[8:])
    columns = np.frombuffer(fields, "<f4", 3 * len(lidar_like.points)).reshape(3, -1)
    np.testing.assert_array_equal(columns.T, lidar_like.points * (1, -1, 1))
    assert len(fields) == unpacked


def decompress_lzf(data: bytes) -> bytes:
    """Decompress as LibLZF documents its format: runs of literals, and references backwards."""
    out, at = bytearray(), 0
    while at < len(data):
        control, at = data[at], at + 1
        if control < 32:
            out += data[at : at + control + 1]
            at += control + 1
            continue
        length = control >> 5
        if length == 7:
            length, at = length + data[at], at + 1
        back, at = ((control & 31) << 8 | data[at]) + 1, at + 1
        for _ in range(length + 2):
            out.append(out[-back])
    return bytes(out)


@pytest.mark.parametrize("encoding", get_args(CloudEncoding))
def test_a_cloud_without_points_is_read(
    lidar_like: PointCloud, tmp_path: Path, encoding: CloudEncoding
) -> None:
    none = PointCloud(*(getattr(lidar_like, item.name)[:0] for item in fields(PointCloud)))
    path = tmp_path / "points.pcd"
    path.write_bytes(cloud_files.encode_pcd(none, encoding=encoding))
    assert len(cloud_files.read_pcd(path)) == 0


def test_a_compressed_cloud_that_is_damaged_or_cut_off_is_refused(
    lidar_like: PointCloud, tmp_path: Path
) -> None:
    path, whole = tmp_path / "points.pcd", cloud_files.encode_pcd(lidar_like)
    head = whole.index(b"compressed\n") + len("compressed\n")
    sizes = struct.pack("<II", 100, 2**32 - 36)
    bomb = whole[:head].replace(b"POINTS 16000", b"POINTS 119304646") + sizes + bytes(100)
    lying = whole[:head] + bytes(8) + whole[head + 8 :]
    cut = whole[: head + 8] + b"\xff" * 100
    for content in (whole[:-1], whole[: head + 4], cut, bomb, lying):
        path.write_bytes(content)
        with pytest.raises(InputError, match="not a point cloud"):
            cloud_files.read_pcd(path)


HEADER = """# .PCD v0.7 - Point Cloud Data file format
VERSION 0.7
FIELDS {fields}
SIZE {sizes}
TYPE {types}
COUNT {counts}
WIDTH {points}
HEIGHT 1
VIEWPOINT 0 0 0 1 0 0 0
POINTS {points}
DATA {encoding}
"""


def write_pcd(
    path: Path,
    body: bytes,
    *,
    points: int,
    encoding: str,
    fields: str = "x y z rgb",
    types: str = "F F F F",
    counts: str = "1 1 1 1",
) -> None:
    sizes = " ".join("4" for _ in fields.split())
    header = HEADER.format(**{**locals(), "sizes": sizes})
    path.write_bytes(header.encode() + body)


@pytest.mark.parametrize(
    ("types", "colours"),
    [
        ("F F F U", ("16711680", "3368703")),  # 255 << 16, and 51 << 16 | 103 << 8 | 255
        ("F F F F", ("16711680", "3368703")),  # as PCL writes floats of colours
        ("F F F F", ("2.3418052e-38", "4.720558e-39")),  # as Open3D writes them
    ],
)
def test_text_of_others_gives_points_and_the_red_channel_as_intensity(
    tmp_path: Path, types: str, colours: tuple[str, str]
) -> None:
    path = tmp_path / "points.pcd"
    body = f"1 2 -3.5 {colours[0]}\r\n-0.25 1e1 6 {colours[1]}\n".encode()
    write_pcd(path, body, points=2, encoding="ascii", types=types)
    table = cloud_files.read_foreign_pcd(path)
    columns = np.column_stack([table[name] for name in "xyz"])
    np.testing.assert_array_equal(columns, [[1, 2, -3.5], [-0.25, 10, 6]])
    np.testing.assert_allclose(table["intensity"], [1.0, 51 / 255], rtol=1e-6)


def test_fields_of_several_values_and_those_that_fill_up_are_skipped(tmp_path: Path) -> None:
    path = tmp_path / "points.pcd"
    rows = [
        struct.pack("<3f4s8s", *point, b"\0" * 4, b"\7" * 8) for point in ((1, 2, 3), (4, 5, 6))
    ]
    write_pcd(
        *(path, b"".join(rows)),
        points=2,
        encoding="binary",
        fields="x y z _ normal",
        types="F F F U U",
        counts="1 1 1 1 2",
    )
    table = cloud_files.read_foreign_pcd(path)
    assert table["z"].tolist() == [3.0, 6.0]
    assert "intensity" not in (table.dtype.names or ())


@pytest.mark.parametrize("encoding", ["ascii", "binary", "binary_compressed"])
@pytest.mark.parametrize("points", [-1, 3, 10**9, 10**30])
def test_a_cloud_with_a_wrong_number_of_points_takes_no_memory_for_them(
    tmp_path: Path, encoding: str, points: int
) -> None:
    path = tmp_path / "points.pcd"
    body = b"1 2 3 4\n5 6 7 8\n" if encoding == "ascii" else bytes(32)
    write_pcd(path, body, points=points, encoding=encoding)
    with pytest.raises(InputError, match=f"{path.name}: not a point cloud"):
        cloud_files.read_foreign_pcd(path)


def test_a_field_of_a_billion_values_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "points.pcd"
    write_pcd(path, b"", points=0, encoding="binary", counts="1 1 1 1000000000")
    with pytest.raises(InputError, match="COUNT is not from 1 to 4096"):
        cloud_files.read_foreign_pcd(path)


def test_words_in_place_of_numbers_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "points.pcd"
    write_pcd(path, b"1 2 nothing 3\n", points=1, encoding="ascii")
    with pytest.raises(InputError, match="not a point cloud"):
        cloud_files.read_foreign_pcd(path)
