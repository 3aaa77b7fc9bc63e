"""Metadata that mlcroissant validates and loads, and the card of a dataset."""

import json
import os
import shutil
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path

import pytest

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
