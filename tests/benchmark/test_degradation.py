"""Curves over a swept number: ranges of sensors and average precisions."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from advercity_benchmark.degradation import compute_range_m, tabulate_degradation
from advercity_benchmark.predictions import FramePredictions, write_predictions
from advercity_benchmark.truth import load_frame_truth
from advercity_dsl import Spec
from advercity_dsl.spec import SweepPoint

from advercity.compiler import with_digest
from advercity.dataset.reader import Dataset
from advercity.errors import InputError
from tests.builders import SensorFramesOf, write_scenario
from tests.command_line import Command

MOR_M = (20.0, 200.0, 1000.0)


@pytest.fixture(scope="module")
def swept(
    tmp_path_factory: pytest.TempPathFactory, spec: Spec, sensor_frames_of: SensorFramesOf
) -> Path:
    root = tmp_path_factory.mktemp("swept")
    for value in MOR_M:
        point = SweepPoint(field="weather.fog.mor_m", value=value)
        provenance = spec.provenance.model_copy(update={"sweep": point})
        changed = {"id": f"{spec.id}_mor_m_{value:g}", "provenance": provenance}
        write_scenario(root, with_digest(spec.model_copy(update=changed)), sensor_frames_of)
    return root


def test_a_range_ends_where_less_than_half_is_detected() -> None:
    distance_m = np.array([5.0, 6.0, 25.0, 26.0, 27.0, 41.0, 42.0, 55.0])
    detected = np.array([True, True, True, True, False, True, False, False])
    assert compute_range_m(distance_m, detected) == 50.0
    assert compute_range_m(distance_m, ~detected) == 0.0
    assert compute_range_m(distance_m, np.ones(8, np.bool_)) == 60.0
    assert compute_range_m(distance_m[:0], detected[:0]) == 0.0


def test_a_curve_has_a_row_for_each_value_and_a_column_for_each_file_of_predictions(
    swept: Path, tmp_path: Path, advercity: Command
) -> None:
    found: dict[tuple[str, int], FramePredictions] = {}
    for frame in Dataset(swept):
        truth = load_frame_truth(frame)
        boxes = truth.boxes[truth.is_counted]
        if not frame.scenario.spec.id.endswith("mor_m_20"):
            found[frame.scenario.spec.id, frame.index] = FramePredictions(
                boxes, np.ones(len(boxes))
            )
    write_predictions(tmp_path / "mine.jsonl", found)
    ran = advercity(
        *("benchmark", "degradation", swept, "--predictions", tmp_path / "mine.jsonl"),
        *("--output", tmp_path / "curve"),
    )
    assert ran.code == 0, ran.err
    rows = (tmp_path / "curve" / "degradation.csv").read_text().splitlines()
    assert rows[0].split(",") == ["weather.fog.mor_m", "lidar_range_m", "ap_50 mine"]
    assert [float(row.split(",")[0]) for row in rows[1:]] == list(MOR_M)
    assert [float(row.split(",")[2]) for row in rows[1:]] == [0.0, 1.0, 1.0]
    picture = cv2.imread(str(tmp_path / "curve" / "degradation.png"))
    assert picture is not None
    assert picture.std() > 5


def test_a_dataset_without_a_sweep_has_no_curve(two_roads: Path) -> None:
    with pytest.raises(InputError, match=r"not those of one sweep \(swept: none\); run the specs"):
        tabulate_degradation(two_roads)
