"""Radar detections and cubes, written and read back."""

import zipfile
from dataclasses import fields
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from advercity.dataset import radar_codec
from advercity.dataset.cloud_files import read_pcd
from advercity.errors import InputError
from advercity.run_options import CloudEncoding
from advercity.sensors.measurements import RadarCube, RadarDetections


def draw_detections(count: int, seed: int) -> RadarDetections:
    """Draw detections in which every number differs from every other."""
    generator = np.random.default_rng(seed)
    columns = generator.normal(0, 50, (6, count)).astype(np.float32)
    return RadarDetections(
        points=columns[:3].T,
        velocity_m_s=columns[3],
        rcs_dbsm=columns[4],
        snr_db=columns[5],
        instance=generator.integers(-(2**31), 2**31, count).astype(np.int32),
        kind=generator.integers(0, 256, count).astype(np.uint8),
    )


@given(
    count=st.integers(0, 40),
    seed=st.integers(0, 10**6),
    encoding=st.sampled_from(get_args(CloudEncoding)),
)
@settings(max_examples=15)
def test_a_file_of_detections_has_each_number_in_left_handed_axes(
    count: int, seed: int, encoding: CloudEncoding, tmp_path_factory: pytest.TempPathFactory
) -> None:
    written = draw_detections(count, seed)
    path = tmp_path_factory.mktemp("radar") / "a.pcd"
    path.write_bytes(radar_codec.encode_detections(written, encoding))

    table = read_pcd(path, radar_codec.RADAR_POINT).copy()
    np.testing.assert_array_equal(table["x"], written.points[:, 0])
    np.testing.assert_array_equal(table["y"], -written.points[:, 1])
    np.testing.assert_array_equal(table["z"], written.points[:, 2])
    table["y"] *= -1
    read = radar_codec.parse_detections(table)
    for field in fields(RadarDetections):
        np.testing.assert_array_equal(getattr(read, field.name), getattr(written, field.name))


def test_a_cube_is_read_as_it_was_written(tmp_path: Path) -> None:
    generator = np.random.default_rng(3)
    power_db, velocity_m_s = generator.normal(size=(2, 5, 3, 2)).astype(np.float16)
    cube = RadarCube(power_db, velocity_m_s)
    path = tmp_path / "a.npz"
    path.write_bytes(radar_codec.encode_cube(cube))
    read = radar_codec.load_cube(path)
    np.testing.assert_array_equal(read.power_db, cube.power_db)
    np.testing.assert_array_equal(read.velocity_m_s, cube.velocity_m_s)
    assert radar_codec.encode_cube(read) == path.read_bytes()
    with zipfile.ZipFile(path) as archive:
        assert archive.namelist() == ["power_db.npy", "velocity_m_s.npy"]


def test_a_cube_of_other_arrays_is_an_error(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", power_db=np.zeros(3))
    with pytest.raises(InputError, match=r"a\.npz: has no array 'velocity_m_s'"):
        radar_codec.load_cube(tmp_path / "a.npz")
