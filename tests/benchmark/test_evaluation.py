"""Predictions made from the annotations of a dataset, evaluated by the public way in."""

import json
import math
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from advercity_benchmark.evaluation import EvaluationOptions, evaluate_predictions
from advercity_benchmark.predictions import FramePredictions, load_predictions, write_predictions
from advercity_benchmark.truth import load_frame_truth
from numpy.typing import NDArray

from advercity.dataset.reader import Dataset, FrameView
from advercity.errors import InputError
from tests.benchmark.test_matching import average_precision_by_steps, overlap_by_opencv
from tests.builders import TWO_ROADS_FRAMES
from tests.command_line import Command

Boxes = NDArray[np.float64]
Row = dict[str, Any]
SCENES = ("rcnj_fog_day_sparse", "ui_clear_night_dense")


def predict(
    dataset: Path, change: Callable[[Boxes, FrameView], Boxes] = lambda boxes, frame: boxes
) -> dict[tuple[str, int], FramePredictions]:
    """Predict what has to be found, changed, with scores that fall with the distance."""
    found: dict[tuple[str, int], FramePredictions] = {}
    for frame in Dataset(dataset):
        truth = load_frame_truth(frame)
        boxes = change(truth.boxes[truth.is_counted], frame)
        scores = 1.0 / (1.0 + 0.01 * np.hypot(boxes[:, 0], boxes[:, 1]))
        found[frame.scenario.spec.id, frame.index] = FramePredictions(boxes, scores)
    return found


def shift(boxes: Boxes, *, along: float = 0.0, across: float = 0.0) -> Boxes:
    """Shift boxes by parts of their length and width."""
    moved = boxes.copy()
    cos, sin = np.cos(boxes[:, 6]), np.sin(boxes[:, 6])
    moved[:, 0] += along * boxes[:, 3] * cos - across * boxes[:, 4] * sin
    moved[:, 1] += along * boxes[:, 3] * sin + across * boxes[:, 4] * cos
    return moved


def evaluate(
    dataset: Path,
    folder: Path,
    predictions: dict[tuple[str, int], FramePredictions],
    coordinates: Any = "lidar",
    **options: Any,
) -> dict[tuple[str, str], Row]:
    path = folder / "predictions.jsonl"
    path.unlink(missing_ok=True)
    write_predictions(path, predictions, coordinates=coordinates)
    table = evaluate_predictions(path, dataset, EvaluationOptions(**options)).table
    rows = [dict(zip(table.columns, row, strict=True)) for row in table.rows]
    return {(row["by"], row["cell"]): row for row in rows}


def test_truth_as_prediction_scores_1_in_every_cell(two_roads: Path, tmp_path: Path) -> None:
    rows = evaluate(two_roads, tmp_path, predict(two_roads))
    cuts = {by for by, _ in rows}
    assert cuts == {"all", "weather", "time", "density", "road", "distance", "points"}
    assert {cell for by, cell in rows if by == "weather"} == {"fog_day", "clear_night"}
    filled = [row for row in rows.values() if row["objects"]]
    assert len(filled) >= 11
    for row in filled:
        assert (row["ap_30"], row["ap_50"], row["ap_70"], row["recall_50"]) == (1, 1, 1, 1)
        assert row["predictions"] == row["objects"]
    # Three connected vehicles and a van, without the ego; the truck is 320 m away.
    assert rows["all", "all"]["objects"] == 2 * TWO_ROADS_FRAMES * 3
    for row in rows.values():
        assert row["objects"] or math.isnan(row["ap_50"])


@pytest.mark.parametrize(
    ("along", "across", "expected"),
    [
        (0.25, 0.0, (1, 1, 0)),  # 3/5
        (0.0, 0.5, (1, 0, 0)),  # 1/3
        (0.1, 0.0, (1, 1, 1)),  # 9/11
        (0.5, 0.5, (0, 0, 0)),  # 1/7
    ],
)
def test_shifted_boxes_score_what_geometry_says(
    two_roads: Path, tmp_path: Path, along: float, across: float, expected: tuple[int, int, int]
) -> None:
    shifted = predict(two_roads, lambda boxes, _: shift(boxes, along=along, across=across))
    row = evaluate(two_roads, tmp_path, shifted)["all", "all"]
    assert (row["ap_30"], row["ap_50"], row["ap_70"]) == expected


def test_every_frame_of_coordinates_gives_the_same(two_roads: Path, tmp_path: Path) -> None:
    def to_world(boxes: Boxes, frame: FrameView) -> Boxes:
        annotated = {
            number: (view.boxes.world_from_box[row], view.boxes.sizes[row])
            for view in frame.views.values()
            for row, number in enumerate(view.boxes.ids.tolist())
        }
        truth = load_frame_truth(frame)
        return np.array(
            [
                [*pose[:3, 3], *size, math.atan2(pose[1, 0], pose[0, 0])]
                for pose, size in (annotated[n] for n in truth.ids[truth.is_counted].tolist())
            ]
        )

    world = evaluate(two_roads, tmp_path, predict(two_roads, to_world), "world")
    mirror = np.array([1, -1, 1, 1, 1, 1, -1.0])
    mirrored = predict(two_roads, lambda boxes, _: boxes * mirror)
    left_handed = evaluate(two_roads, tmp_path, mirrored, "lidar_left_handed")
    for rows in (world, left_handed):
        assert rows["all", "all"]["ap_70"] == 1.0
    as_right_handed = evaluate(two_roads, tmp_path, mirrored)
    assert as_right_handed["all", "all"]["ap_30"] < 1.0


def test_what_is_not_found_costs_its_part_and_what_is_not_there_the_precision(
    two_roads: Path, tmp_path: Path
) -> None:
    """One of two scenes found: recall 1/2. As many wrong ones with higher scores: precision 1/2."""
    predictions = predict(two_roads)
    half = {key: found for key, found in predictions.items() if key[0] == SCENES[0]}
    rows = evaluate(two_roads, tmp_path, half)
    assert rows["all", "all"]["ap_70"] == pytest.approx(0.5)
    assert rows["weather", "fog_day"]["ap_70"] == 1.0
    assert rows["weather", "clear_night"]["ap_70"] == 0.0
    assert (rows["all", "all"]["ap_70_low"], rows["all", "all"]["ap_70_high"]) == (0.0, 1.0)
    wrong = np.array([[60.0, 30.0, 0, 4, 2, 1.5, 0.0]])
    with_ghosts = {
        key: FramePredictions(
            np.concatenate([found.boxes, np.repeat(wrong, len(found), axis=0)]),
            np.concatenate([found.scores, np.ones(len(found))]),
        )
        for key, found in predictions.items()
    }
    rows = evaluate(two_roads, tmp_path, with_ghosts)
    assert rows["all", "all"]["ap_70"] == pytest.approx(0.5)
    # The ghosts are 67 m away; nothing is there to be found.
    assert rows["distance", "0 to 30 m"]["ap_70"] == 1.0
    assert rows["distance", "50 to 100 m"]["objects"] == 0
    assert rows["distance", "50 to 100 m"]["predictions"] == len(SCENES) * TWO_ROADS_FRAMES * 3


def test_the_ego_people_and_what_is_out_of_the_area_are_neither_right_nor_wrong(
    two_roads: Path, tmp_path: Path
) -> None:
    def add_all(boxes: Boxes, frame: FrameView) -> Boxes:
        truth = load_frame_truth(frame)
        assert 101 in truth.ids
        assert not truth.is_counted[truth.ids == 101].any()
        assert truth.is_counted[truth.ids == 201].all()
        assert not truth.is_counted[truth.ids == 203].any()
        return truth.boxes

    row = evaluate(two_roads, tmp_path, predict(two_roads, add_all))["all", "all"]
    assert row["ap_70"] == 1.0
    assert row["predictions"] == row["objects"]
    few = evaluate(two_roads, tmp_path, predict(two_roads), range_m=(15.0, 40.0))["all", "all"]
    assert 0 < few["objects"] < row["objects"]
    assert few["ap_70"] == 1.0
    none = evaluate(two_roads, tmp_path, predict(two_roads), min_points=10**6)["all", "all"]
    assert none["objects"] == 0


def test_who_is_out_of_the_range_of_communication_does_not_add_objects(two_roads: Path) -> None:
    frame = Dataset(two_roads)[0]
    together, alone = (
        load_frame_truth(frame, communication_range_m=range_m) for range_m in (70.0, 1.0)
    )
    both = np.isin(together.ids, alone.ids)
    assert (together.points[both] >= alone.points).all()
    assert together.points.sum() > 2 * alone.points.sum()


def test_an_independent_evaluation_agrees(two_roads: Path, tmp_path: Path) -> None:
    """Loops over boxes in the world, overlaps by OpenCV, precision by steps."""
    rng = np.random.default_rng(7)

    def disturb(boxes: Boxes, frame: FrameView) -> Boxes:
        copies = np.repeat(boxes, 3, axis=0)
        copies[:, :2] += rng.normal(0, 0.35, (len(copies), 2))
        copies[:, 6] += rng.normal(0, 0.1, len(copies))
        return copies

    predictions = predict(two_roads, disturb)
    for key, found in predictions.items():
        predictions[key] = FramePredictions(found.boxes, rng.permutation(1000)[: len(found)] / 1e3)
    row = evaluate(two_roads, tmp_path, predictions)["all", "all"]
    for percent in (30, 50, 70):
        hits: list[bool] = []
        scores: list[float] = []
        for frame in Dataset(two_roads):
            truth = load_frame_truth(frame)
            left = list(truth.boxes[truth.is_counted])
            found = predictions[frame.scenario.spec.id, frame.index]
            for number in np.argsort(-found.scores).tolist():
                overlaps = [overlap_by_opencv(found.boxes[number], other) for other in left]
                is_hit = max(overlaps, default=0.0) >= percent / 100
                hits.append(is_hit)
                scores.append(float(found.scores[number]))
                if is_hit:
                    left.pop(int(np.argmax(overlaps)))
        expected = average_precision_by_steps(hits, scores, row["objects"])
        assert row[f"ap_{percent}"] == pytest.approx(expected, abs=1e-9)
        assert 0.05 < expected < 0.95


HEADER = '{"format": "advercity-predictions", "version": 1}'
LINE = {"scenario": SCENES[0], "frame": 0, "boxes": [[9, 0, 0, 4, 2, 1.5, 0]], "scores": [0.5]}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", ":1: not valid JSON"),
        ('{"format": "coco"}', ':1: format: Input should be .*the first line is {"format"'),
        (f"{HEADER}\n{{", ":2: not valid JSON"),
        (f"{HEADER}\n{json.dumps(LINE | {'scores': [1.5]})}", r":2: scores\.0: .*less than or"),
        (f"{HEADER}\n{json.dumps(LINE | {'scores': []})}", ":2: 0 scores for 1 boxes"),
        (f"{HEADER}\n{json.dumps(LINE | {'boxes': [[1, 2]]})}", r":2: boxes\.0"),
        (f"{HEADER}\n\n{json.dumps(LINE)}\n{json.dumps(LINE)}", ":4: frame 0 of .* is repeated"),
        (f"{HEADER}\n{json.dumps(LINE | {'frame': 99})}", "frame 99 of .* is not in"),
        (f"{HEADER}\n{json.dumps(LINE | {'score': 1})}", ":2: score: Extra inputs"),
        (f"{HEADER}\n{json.dumps(LINE | {'classes': ['car' + chr(0)]})}", r":2: classes\.0"),
    ],
)
def test_a_wrong_line_is_named(two_roads: Path, tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "predictions.jsonl"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        evaluate_predictions(path, two_roads)


def test_a_pipe_or_a_device_in_place_of_predictions_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", Path("/dev/zero")):
        with pytest.raises(InputError, match="is not a regular file"):
            load_predictions(path)


def test_an_unknown_class_is_refused_with_one_that_exists(two_roads: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="unknown class 'cars'; did you mean 'car'"):
        evaluate(two_roads, tmp_path, {}, classes=("cars",))


@pytest.mark.parametrize("area", [(math.nan, 40.0), (0.0, 40.0), (140.0, -1.0), (math.inf, 1.0)])
def test_an_area_without_extent_is_refused(
    two_roads: Path, tmp_path: Path, area: tuple[float, float]
) -> None:
    with pytest.raises(InputError, match="`area` must be two lengths above 0 m"):
        evaluate(two_roads, tmp_path, {}, range_m=area)


def test_predictions_of_classes_that_do_not_count_are_left_out(
    two_roads: Path, tmp_path: Path
) -> None:
    ghosts = FramePredictions(
        np.array([[60.0, 30.0, 0, 4, 2, 1.5, 0.0]]), np.ones(1), np.array(["bicycle"])
    )
    rows = evaluate(two_roads, tmp_path, {(SCENES[0], 0): ghosts})
    assert rows["all", "all"]["predictions"] == 0
    rows = evaluate(two_roads, tmp_path, {(SCENES[0], 0): ghosts}, classes=("car", "bicycle"))
    assert rows["all", "all"]["predictions"] == 1


def test_predictions_are_read_as_they_were_written(tmp_path: Path) -> None:
    boxes = np.array([[1.5, -2, 0.25, 4, 2, 1.5, 0.1]])
    path = tmp_path / "predictions.jsonl"
    written = FramePredictions(boxes, np.array([0.75]), np.array(["car"]))
    write_predictions(path, {("scene", 3): written}, coordinates="world", model="mine")
    loaded = load_predictions(path)
    assert (loaded.header.coordinates, loaded.header.model) == ("world", "mine")
    found = loaded.frames["scene", 3]
    np.testing.assert_array_equal(found.boxes, boxes)
    assert found.classes is not None
    assert (found.scores.tolist(), found.classes.tolist()) == ([0.75], ["car"])


def test_the_command_prints_a_table_and_names_frames_without_a_line(
    two_roads: Path, tmp_path: Path, advercity: Command
) -> None:
    path, output = tmp_path / "predictions.jsonl", tmp_path / "results"
    predictions = predict(two_roads)
    predictions.pop((SCENES[0], 1))
    write_predictions(path, predictions)

    command = ("benchmark", "evaluate", path, two_roads)
    ran = advercity(*command, "--output", output)
    assert ran.code == 0
    assert "83.3 (66.7 to 100.0)" in ran.out
    assert "1 of 6 frames have no line" in ran.err
    assert (output / "benchmark.csv").read_text().startswith("by,cell,objects,ap_30,")
    assert json.loads(advercity(*command, "--json").out)[0]["ap_50"] == pytest.approx(5 / 6)


def test_the_page_writes_predictions_that_score_1(
    two_roads: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = (Path(__file__).parents[2] / "docs" / "benchmark.md").read_text()
    code, merging, assigning = re.findall(r"^```python\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    (tmp_path / "output").symlink_to(two_roads)
    monkeypatch.chdir(tmp_path)
    exec(code, {})
    found = evaluate_predictions(tmp_path / "predictions.jsonl", two_roads)
    assert found.missing_frames == 0
    assert set(found.table.columns["ap_70"][:1]) == {1.0}
    (example,) = re.findall(r"^```json\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    (tmp_path / "example.jsonl").write_text(example)
    assert len(load_predictions(tmp_path / "example.jsonl").frames["ui_fog_day_sparse", 0]) == 1
    (tmp_path / "examples").symlink_to(Path(__file__).parents[2] / "examples")
    base = tmp_path / "OpenCOOD/opencood/hypes_yaml/point_pillar_intermediate_fusion.yaml"
    base.parent.mkdir(parents=True)
    base.write_text("preprocess: {args: {voxel_size: [0.4, 0.4, 4], max_points_per_voxel: 32}}")
    exec(merging, {})
    settings = yaml.safe_load((tmp_path / "advercity.yaml").read_text())
    args = {"voxel_size": [0.4, 0.4, 11], "max_points_per_voxel": 32}
    assert settings["preprocess"]["args"] == args
    lowest, highest = settings["preprocess"]["cav_lidar_range"][2::3]
    assert highest - lowest == settings["preprocess"]["args"]["voxel_size"][2]
    (tmp_path / "splits").mkdir()
    (tmp_path / "splits" / "train").symlink_to(two_roads)
    exec(assigning, {})
    assigned = json.loads((tmp_path / "assignment.json").read_text())
    assert set(assigned) == set(SCENES)
    agents = {path.name for path in (two_roads / SCENES[0]).iterdir() if path.is_dir()}
    assert assigned[SCENES[0]] == dict.fromkeys(agents, "m1")


def test_the_ranges_for_heal_are_whole_voxels_and_the_same_everywhere() -> None:
    changes = yaml.safe_load((Path(__file__).parents[2] / "examples" / "heal.yaml").read_text())
    lidar = changes["heter"]["modality_setting"]["m1"]["preprocess"]
    encoder = changes["model"]["args"]["m1"]["encoder_args"]
    ranges = [changes["cav_lidar_range"], lidar["cav_lidar_range"], encoder["lidar_range"]]
    assert ranges[1:] == ranges[:-1]
    voxel = np.array(lidar["args"]["voxel_size"])
    cells = (np.array(ranges[0][3:]) - ranges[0][:3]) / voxel
    assert encoder["voxel_size"] == voxel.tolist()
    assert cells.round(9).tolist() == [704, 512, 1]  # 704 and 512 are halved four times and more


def test_only_the_chosen_frames_are_evaluated(two_roads: Path, tmp_path: Path) -> None:
    predictions = {key: found for key, found in predict(two_roads).items() if key[1] == 1}
    row = evaluate(two_roads, tmp_path, predictions, frames=slice(1, 2))["all", "all"]
    assert (row["objects"], row["ap_70"]) == (2 * 3, 1)
    assert evaluate(two_roads, tmp_path, predictions)["all", "all"]["recall_50"] < 0.5
