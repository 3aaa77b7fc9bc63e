"""Folders of data sets as their publishers lay them out."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from advercity_benchmark.study.recordings import open_recordings

from advercity.errors import InputError

ECHO = [3.0, 4.0, 12.0, 51.0]


def write_picture(path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    picture = np.zeros((4, 6, 3), np.uint8)
    picture[..., 2] = 200  # red, in OpenCV's order
    cv2.imwrite(str(path), picture)


def write_sweep(path: Path, row: list[float]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(np.array([row, row], "<f4").tobytes())


@pytest.mark.parametrize(
    ("layout", "picture", "sweep", "row", "intensity"),
    [
        ("kitti", "training/image_2/000001.png", "training/velodyne/000001.bin", [], 51.0),
        (
            "kitti",
            "d/2011_09_26_drive_0001_sync/image_02/data/0000000000.png",
            "d/2011_09_26_drive_0001_sync/velodyne_points/data/0000000000.bin",
            [],
            51.0,
        ),
        ("nuscenes", "samples/CAM_FRONT/a.jpg", "samples/LIDAR_TOP/a.pcd.bin", [7.0], 0.2),
        (
            "cadc",
            "2019_02_27/0003/labeled/image_00/data/0000000000.png",
            "2019_02_27/0003/labeled/lidar_points/data/0000000000.bin",
            [],
            51.0,
        ),
        ("boreas", "boreas-2021/camera/1.png", "boreas-2021/lidar/1.bin", [7.0, 0.5], 0.2),
    ],
)
def test_layouts_of_real_sets_are_found(
    tmp_path: Path, layout: str, picture: str, sweep: str, row: list[float], intensity: float
) -> None:
    write_picture(tmp_path / picture)
    write_sweep(tmp_path / sweep, ECHO + row)
    (found,) = open_recordings([f"real={tmp_path}"])
    assert (found.name, found.layout) == ("real", layout)
    (load_picture,), (load_sweep,) = found.picture_loaders, found.sweep_loaders
    red = load_picture()[..., 0]
    assert red.shape == (4, 6)
    assert red.mean() == pytest.approx(200, abs=2)
    loaded = load_sweep()
    np.testing.assert_allclose(loaded.points, [ECHO[:3], ECHO[:3]])
    np.testing.assert_allclose(loaded.intensity, intensity, rtol=1e-6)


def test_a_folder_of_pictures_has_no_sweeps_and_its_own_name(tmp_path: Path) -> None:
    write_picture(tmp_path / "street" / "b.png")
    write_picture(tmp_path / "street" / "a.jpg")
    (tmp_path / "street" / "notes.txt").touch()
    (found,) = open_recordings([str(tmp_path / "street")])
    assert (found.name, found.layout) == ("street", "pictures")
    assert (len(found.picture_loaders), len(found.sweep_loaders)) == (2, 0)


def test_of_many_files_some_are_taken_evenly_with_the_first_and_the_last(tmp_path: Path) -> None:
    for number in range(9):
        write_sweep(tmp_path / f"velodyne/{number}.bin", [number + 1.0, 0.0, 0.0, 0.0])
    (found,) = open_recordings([str(tmp_path)])
    thin = [load().points[0, 0] for load in found.thin(3).sweep_loaders]
    assert thin == [1.0, 5.0, 9.0]
    assert len(found.thin(9).sweep_loaders) == 9


def test_folders_that_cannot_be_compared_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has no pictures and no LiDAR sweeps where one of these"):
        open_recordings([str(tmp_path)])
    with pytest.raises(InputError, match="no: is no folder"):
        open_recordings([str(tmp_path / "no")])
    with pytest.raises(InputError, match="=x: has no name before '='; give one, such as ours=x"):
        open_recordings(["=x"])
    write_picture(tmp_path / "one" / "a.png")
    write_picture(tmp_path / "x" / "one" / "a.png")
    with pytest.raises(InputError, match="two folders are called 'one'; name them"):
        open_recordings([str(tmp_path / "one"), str(tmp_path / "x" / "one")])


def test_damaged_files_are_named(tmp_path: Path) -> None:
    (tmp_path / "velodyne").mkdir()
    (tmp_path / "velodyne" / "a.bin").write_bytes(b"123")
    (tmp_path / "image_2").mkdir()
    (tmp_path / "image_2" / "a.png").touch()
    (found,) = open_recordings([str(tmp_path)])
    with pytest.raises(InputError, match=r"a\.bin: has 3 bytes, which are no rows of 4 float32"):
        found.sweep_loaders[0]()
    with pytest.raises(InputError, match=r"a\.png: is no picture"):
        found.picture_loaders[0]()
