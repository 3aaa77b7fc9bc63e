"""Metadata that mlcroissant validates and loads, and the card of a dataset."""

import csv
import json
import os
import shutil
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from advercity_exports.croissant import TABLES
from numpy.typing import NDArray

from advercity.dataset.reader import open_dataset
from advercity.exports.exporting import export_dataset
from advercity.geometry import poses
from tests.exports.readers import needs_readers, run_reader


@pytest.fixture(scope="module")
def exported(two_roads: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("croissant")
    return export_dataset("croissant", two_roads, root / "out").output


@needs_readers
def test_mlcroissant_finds_no_fault_and_loads_the_records(exported: Path, two_roads: Path) -> None:
    read = run_reader("read_croissant.py", exported)
    assert read["errors"] == []
    assert read["warnings"] == []
    dataset = open_dataset(two_roads)
    views = [view for frame in dataset for view in frame.views.values()]
    assert read["frames"] == len(views) == 30
    assert read["objects"] == sum(len(view.boxes) for view in views)
    frame, view = dataset[0], dataset[0]["cav1"]
    found = read["first_frame"]
    name = frame.scenario.path.name
    assert (found["scenario"], found["agent"], found["frame"]) == (name, "cav1", 0)
    assert found["stem"] == f"{name}/+101/{frame.name}"
    assert found["x_m"] == pytest.approx(view.world_from_agent[0, 3], abs=1e-6)
    assert (found["objects"], found["speed_m_s"]) == (len(view.boxes), view.speed_m_s)
    weather = frame.scenario.manifest.weather
    assert (found["weather"], found["mor_m"]) == (weather.id, pytest.approx(weather.mor_m))
    box, pose = read["first_object"], view.boxes.world_from_box[0]
    assert (box["object_id"], box["class"]) == (view.boxes.ids[0], view.boxes.classes[0])
    assert box["yaw_rad"] == pytest.approx(poses.to_yaw_pitch_roll(pose)[0], abs=1e-6)
    assert box["length_m"] == pytest.approx(view.boxes.sizes[0, 0], abs=1e-6)
    assert box["parked"] is False


def test_each_view_and_each_box_is_a_row_with_its_own_numbers(
    exported: Path, two_roads: Path
) -> None:
    def place(pose: NDArray[np.float64]) -> list[float]:
        return [*pose[:3, 3], np.arctan2(pose[1, 0], pose[0, 0])]

    frames: list[list[float]] = []
    objects: list[list[float]] = []
    keys: list[tuple[str, ...]] = []
    for frame in open_dataset(two_roads):
        for view in frame.views.values():
            boxes = view.load_steady_boxes()
            keys.append((frame.scenario.path.name, view.agent.id, str(frame.index)))
            pose = place(view.world_from_agent)
            frames.append([frame.time_s, *pose, view.speed_m_s, len(boxes)])
            objects += [
                [
                    *(boxes.ids[row], *place(boxes.world_from_box[row]), *boxes.sizes[row]),
                    *(boxes.speeds_m_s[row], boxes.distances_m[row], boxes.lidar_points[row]),
                ]
                for row in range(len(boxes))
            ]

    texts = [(exported / f"{name}.csv").read_text().splitlines() for name in TABLES]
    tables = [list(csv.DictReader(lines)) for lines in texts]
    at = ["x_m", "y_m", "z_m", "yaw_rad"]
    size = ["length_m", "width_m", "height_m"]
    names = [
        ["time_s", *at, "speed_m_s", "objects"],
        ["object_id", *at, *size, "speed_m_s", "distance_m", "lidar_points"],
    ]
    assert [(row["scenario"], row["agent"], row["frame"]) for row in tables[0]] == keys
    for table, columns, expected in zip(tables, names, (frames, objects), strict=True):
        found = [[float(row[name]) for name in columns] for row in table]
        np.testing.assert_allclose(found, expected, atol=1e-6)


def test_the_date_is_that_of_the_last_manifest(two_roads: Path, tmp_path: Path) -> None:
    dataset = shutil.copytree(two_roads, tmp_path / "data")
    for day, path in enumerate(sorted(dataset.glob("*/manifest.json"))):
        made_s = datetime(2026, 3, 1 + day, 23, 59, tzinfo=UTC).timestamp()
        os.utime(path, (made_s, made_s))
    output = export_dataset("croissant", dataset, tmp_path / "out").output
    found = json.loads((output / "croissant.json").read_text())
    assert found["datePublished"] == "2026-03-02"


def test_the_card_counts_objects_once_a_frame_and_names_the_recipe(
    exported: Path, two_roads: Path
) -> None:
    text = (exported / "README.md").read_text()
    dataset = open_dataset(two_roads)
    lines = text.splitlines()
    (head,) = [line for line in lines if line.startswith("| scenario |")]
    classes = [cell.strip() for cell in head.split("|")[5:-1]]
    for scenario in dataset.scenarios:
        counts: Counter[str] = Counter()
        for frame in scenario:
            boxes = [view.boxes for view in frame.views.values()]
            pairs = {pair for one in boxes for pair in zip(one.ids, one.classes, strict=True)}
            counts.update(str(kind) for _, kind in pairs)
        (row,) = [line for line in lines if line.startswith(f"| {scenario.path.name} |")]
        cells = [cell.strip() for cell in row.split("|")[2:-1]]
        assert cells[:3] == [scenario.spec.road.id, scenario.spec.density.id, "3"]
        assert cells[3:] == [str(counts[name]) for name in classes]
        assert counts["car"] == 9
        assert scenario.manifest.identity.spec_sha256[:12] in text
        assert scenario.manifest.weather.id in text
    assert "The publisher of the data chooses their licence." in text
