"""Recordings of folders of other programs, read back with Rerun's own reader."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from rerun.chunk import RrdReader

from advercity.errors import InputError
from advercity.viewer.foreign_recording import write_foreign_recording
from tests.dataset.foreign_folder import describe_opv2v, describe_v2v4real, write_frame


def read(file: Path, entity: str, component: str) -> list[Any]:
    """Values of a component in the order of frames."""
    found: list[Any] = []
    for chunk in RrdReader(file).stream():
        batch = chunk.to_record_batch()
        if chunk.entity_path == entity and component in batch.schema.names:
            found += batch.column(component).to_pylist()
    return [value for value in found if value is not None]


def test_boxes_points_and_images_are_where_the_files_have_them(tmp_path: Path) -> None:
    scenario, file = tmp_path / "drive", tmp_path / "drive.rrd"
    for name in ("000068", "000070"):
        write_frame(scenario / "641", name, describe_opv2v())
        image = np.full((600, 800, 3), 90, np.uint8)
        cv2.imwrite(str(scenario / "641" / f"{name}_camera0.png"), image)
    write_foreign_recording(scenario, "opv2v", file)
    centres = read(file, "/world/actors/641", "Boxes3D:centers")
    np.testing.assert_allclose(centres, [[[110.0, -70.0, 0.75]]] * 2, atol=1e-5)
    assert read(file, "/world/actors/641", "Boxes3D:labels") == [["vehicle 7"]] * 2
    points = read(file, "/world/641/lidar0", "Points3D:positions")
    np.testing.assert_allclose(points, [[[10.0, -1.0, -1.0]]] * 2, atol=1e-5)
    assert len(read(file, "/world/641/camera0", "EncodedImage:blob")) == 2


def test_a_release_without_images_shows_its_points(tmp_path: Path) -> None:
    write_frame(tmp_path / "drive" / "0", "000000", describe_v2v4real())
    write_frame(tmp_path / "drive" / "1", "000000", describe_opv2v())
    write_foreign_recording(tmp_path / "drive", "opv2v", tmp_path / "drive.rrd")
    for agent in "01":
        assert read(tmp_path / "drive.rrd", f"/world/{agent}/lidar0", "Points3D:positions")


def test_one_of_several_scenarios_has_to_be_named(tmp_path: Path) -> None:
    for name in ("first", "second"):
        write_frame(tmp_path / "data" / name / "641", "000068", describe_opv2v())
    with pytest.raises(InputError, match=r"has 2 scenarios; name one, as .*first"):
        write_foreign_recording(tmp_path / "data", "opv2v", tmp_path / "drive.rrd")
    assert not (tmp_path / "drive.rrd").exists()
