"""Point clouds of datasets as Open3D and pypcd4 read them."""

import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from advercity.dataset.cloud_files import PCD_POINT, encode_pcd_table
from advercity.run_options import CloudEncoding
from tests.exports.readers import PYTHON, needs_readers, run_reader

pytestmark = [
    needs_readers,
    pytest.mark.parametrize("encoding", ["binary", "binary_compressed"]),
]
FIELDS = ("intensity", "range", "time", "object_id", "ring", "tag", "kind")


@pytest.fixture
def table() -> NDArray[np.void]:
    """A cloud with values of every field drawn at random."""
    draw, found = np.random.default_rng(1), np.zeros(200, PCD_POINT)
    for name in ("x", "y", "z", "intensity", "range", "time"):
        found[name] = draw.normal(0, 30, len(found))
    for name in ("object_id", "ring", "tag", "kind"):
        found[name] = draw.integers(0, 200, len(found))
    found["rgb"] = draw.integers(0, 256, len(found)) << 16
    return found


def read(reader: str, table: NDArray[np.void], encoding: CloudEncoding, folder: Path) -> Any:
    tried = subprocess.run(
        [PYTHON, "-c", f"import {reader}"], capture_output=True, text=True, check=False
    )
    if tried.returncode:
        pytest.skip(f"{reader} cannot be imported: {tried.stderr.splitlines()[-1]}")
    path = folder / "cloud.pcd"
    path.write_bytes(encode_pcd_table(table, encoding))
    found = run_reader("read_clouds.py", reader, path, *FIELDS)
    np.testing.assert_array_equal(found["points"], np.column_stack([table[a] for a in "xyz"]))
    return found


def test_open3d_reads_places_and_colours(
    encoding: CloudEncoding, table: NDArray[np.void], tmp_path: Path
) -> None:
    found = read("open3d", table, encoding, tmp_path)
    np.testing.assert_allclose(found["red"], (table["rgb"] >> 16) / 255, atol=1e-6)


def test_pypcd4_reads_every_field(
    encoding: CloudEncoding, table: NDArray[np.void], tmp_path: Path
) -> None:
    found = read("pypcd4", table, encoding, tmp_path)
    for name in FIELDS:
        np.testing.assert_allclose(found[name], table[name], rtol=1e-6)
