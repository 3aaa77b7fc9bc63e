from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from advercity.dataset import point_table
from advercity.dataset.reading import Reading
from advercity.errors import InputError

ReadingsOf = Callable[[int], tuple[Reading, ...]]


def test_a_table_comes_back_as_it_was_written(readings_of: ReadingsOf, tmp_path: Path) -> None:
    cloud = readings_of(0)[0].cloud
    path = tmp_path / "points.npz"
    path.write_bytes(point_table.encode(cloud))
    raw, time_s = point_table.read(path)
    np.testing.assert_array_equal(raw, cloud.raw)
    np.testing.assert_array_equal(time_s, cloud.time_s)


def test_the_same_cloud_gives_the_same_bytes(readings_of: ReadingsOf) -> None:
    cloud = readings_of(1)[2].cloud
    assert point_table.encode(cloud) == point_table.encode(cloud)


def test_another_file_is_no_point_table(tmp_path: Path) -> None:
    path = tmp_path / "points.npz"
    path.write_bytes(b"something else")
    with pytest.raises(InputError, match="not a point table"):
        point_table.read(path)
