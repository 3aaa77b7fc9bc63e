"""The baseline: what it learns from, its training and its predictions, by the public way in."""

import sys
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest
from advercity_benchmark.detector.boxes import (
    compute_cell_centres,
    count_cells,
    draw_targets,
    drop_overlapping,
    fuse_sensors,
)
from advercity_benchmark.detector.clouds import load_cloud, load_clouds
from advercity_benchmark.detector.images import CAMERA_AREA, check_cameras, load_images
from advercity_benchmark.detector.samples import make_sample, merge_clouds
from advercity_benchmark.predictions import load_predictions

from advercity.dataset.agent_view import AgentView
from advercity.dataset.reader import Dataset
from advercity.errors import InputError
from advercity.geometry.poses import pose_matrix, transform_points
from advercity.randomness import create_generator
from advercity.semantics import Semantic
from tests.command_line import Command, Ran

HINT = "install the extra benchmark for PyTorch, in an environment of its own"
AREA = (16.0, 8.0)
BOXES = np.array(
    [
        [3.3, 1.8, 0.8, 4.5, 1.9, 1.6, 0.4],
        [-7.6, -4.1, 1.4, 8.0, 2.5, 2.8, -1.2],
    ]
)


def test_a_target_has_its_peaks_at_the_middles_and_no_say_at_ignored_boxes() -> None:
    heat, learned, weights = draw_targets(BOXES[:1], BOXES[1:], AREA)
    assert heat.shape == weights.shape == count_cells(AREA) == (32, 16)
    cell = np.unravel_index(heat.argmax(), heat.shape)
    centre = compute_cell_centres(AREA)[cell]
    assert np.abs(centre - BOXES[0, :2]).max() <= 0.5
    np.testing.assert_allclose(learned[:2, *cell] + centre, BOXES[0, :2], atol=1e-6)
    np.testing.assert_allclose(np.exp(learned[3:6, *cell]), BOXES[0, 3:6], rtol=1e-6)
    near = np.hypot(*np.moveaxis(compute_cell_centres(AREA) - BOXES[1, :2], -1, 0)) < 4.0
    assert not weights[near].any()
    assert weights[cell] == 1.0


def test_of_boxes_that_overlap_the_one_with_the_highest_score_stays() -> None:
    moved = BOXES + np.array([0.5, 0, 0, 0, 0, 0, 0.1])
    boxes, scores = drop_overlapping(np.concatenate([BOXES, moved]), np.array([0.5, 0.9, 0.7, 0.2]))
    assert scores.tolist() == [0.9, 0.7]
    np.testing.assert_array_equal(boxes, [BOXES[1], moved[0]])


def test_what_lidar_and_camera_both_find_is_where_the_lidar_has_it_and_more_certain() -> None:
    seen = BOXES[[0, 0, 1]] + np.array([[1.5, -1, 0, 0, 0, 0, 0], [0.1] * 7, [9.0] * 7])
    boxes, scores = fuse_sensors((BOXES, np.array([0.6, 0.3])), (seen, np.array([0.5, 0.2, 0.4])))
    np.testing.assert_array_equal(boxes, [*BOXES, seen[2]])
    np.testing.assert_allclose(scores, [1 - 0.4 * 0.5, 0.3, 0.4])
    alone, _ = fuse_sensors((BOXES[:0], np.empty(0)), (BOXES, np.ones(2)))
    np.testing.assert_array_equal(alone, BOXES)


@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_the_cell_of_a_vehicle_is_where_the_images_show_it(two_roads: Path, mirror: float) -> None:
    frame = Dataset(two_roads)[0]
    moved = np.diag([1.0, mirror, 1.0, 1.0]) @ pose_matrix((0, 0, 0), yaw=0.2)
    shown = 0
    for view in frame.views.values():
        cloud, boxes = load_cloud(view), view.boxes
        map_from_world = moved @ np.linalg.inv(
            view.world_from_lidar @ pose_matrix((0, 0, cloud.ground_m))
        )
        places = load_images(cloud, moved).places[:, 1]
        for row in np.flatnonzero((boxes.visible_fraction > 0.9) & (boxes.classes != "pedestrian")):
            middle = transform_points(map_from_world, boxes.world_from_box[row, :3, 3])
            cell = np.floor(middle[:2] + CAMERA_AREA).astype(int)
            if not ((cell >= 0) & (cell < count_cells(CAMERA_AREA))).all():
                continue
            for camera, place in enumerate(places[:, *cell]):
                if np.abs(place).max() < 0.9:
                    tags = view.semantic(camera)
                    x, y = (place * [mirror, 1.0] + 1.0) / 2.0 * tags.shape[::-1]
                    shown += tags[int(y), int(x)] == Semantic.VEHICLE
    assert shown >= 5


def test_images_that_show_nothing_are_named(
    two_roads: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames = list(Dataset(two_roads))
    check_cameras(frames)
    for image, message in (
        (np.zeros((16, 16, 3), np.uint8), "images of 16x16 pixels, too few"),
        (np.zeros((90, 160, 3), np.uint8), "images of one colour; generate it with a rig"),
    ):
        monkeypatch.setattr(AgentView, "image", MagicMock(return_value=image))
        with pytest.raises(InputError, match=message):
            check_cameras(frames)


def test_an_ideal_exchange_puts_the_clouds_of_all_stations_in_one_frame(two_roads: Path) -> None:
    frame = Dataset(two_roads)[0]
    clouds = load_clouds(frame, "early", is_ideal=True)
    ego = frame[frame.scenario.spec.ego.id]
    assert clouds[0].view.agent.id == ego.agent.id
    assert len(clouds) == 5
    # Every station sees the van, whose middle has to be the same for the ego.
    middles: list[Any] = []
    for cloud in clouds:
        boxes = cloud.view.boxes
        (row,) = np.flatnonzero(boxes.ids == 201)
        world_from_station = cloud.view.world_from_lidar @ pose_matrix((0, 0, cloud.ground_m))
        middle = np.linalg.inv(world_from_station) @ boxes.world_from_box[row]
        middles.append(transform_points(cloud.ego_from_station, middle[:3, 3]))
    np.testing.assert_allclose(middles, np.broadcast_to(middles[0], (5, 3)), atol=0.01)
    merged = merge_clouds(clouds)
    assert len(merged.points) == sum(len(cloud.points) for cloud in clouds)


def test_a_station_finds_the_ground_below_fog_that_returns_most_of_its_points(
    two_roads: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (view,) = (item for name, item in Dataset(two_roads)[0].views.items() if name == "rsu1")
    table, clear_m = view.cloud, load_cloud(view).ground_m
    fog = np.repeat(table, 9)
    fog["z"] += np.linspace(0.0, 6.0, len(fog))
    monkeypatch.setattr(AgentView, "cloud", np.concatenate([table, fog]))
    assert load_cloud(view).ground_m == pytest.approx(clear_m, abs=0.3)


def test_a_sample_turns_and_mirrors_points_and_boxes_alike(two_roads: Path) -> None:
    frame = Dataset(two_roads)[0]
    seen: set[float] = set()
    for number in range(4):
        rng = create_generator("a test", number)
        sample = make_sample(frame, "intermediate", rng, is_ideal=True)
        peaks = compute_cell_centres(sample.areas[0])[sample.heat == 1.0]
        assert len(peaks) == 3
        clouds = [np.asarray(item) for item in sample.recorded]
        own = clouds[0][:, :2]
        for station, pose in zip(clouds[1:], sample.poses[1:], strict=True):
            assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
            own = np.concatenate([own, transform_points(pose, station[:, :3])[:, :2]])
        for peak in peaks:  # points of the vehicle are around it, wherever it was moved
            assert (np.abs(own - peak).max(axis=1) < 3.0).sum() >= 20
        seen.add(round(float(peaks[0, 0]), 1))
    assert len(seen) > 1


@pytest.mark.parametrize("sensor", ["lidar", "camera"])
def test_training_goes_on_after_a_kill_with_the_weights_of_a_run_without(
    two_roads: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sensor: Any
) -> None:
    torch = pytest.importorskip("torch", reason=HINT)
    from advercity_benchmark.detector import training
    from advercity_benchmark.detector.checkpoint import TrainingRecord, load_checkpoint

    monkeypatch.setattr(training, "SAVE_EVERY", 1)
    record = TrainingRecord(sensor=sensor, steps=3, batch=1, channels=8)
    training.train_detector(two_roads, tmp_path / "whole.pt", record)

    def stop(progress: Any) -> None:
        raise KeyboardInterrupt

    path = tmp_path / "cut.pt"
    with pytest.raises(KeyboardInterrupt):
        training.train_detector(two_roads, path, record, report=stop)
    assert load_checkpoint(path).step == 1
    training.train_detector(two_roads, path, record)
    whole, cut = (load_checkpoint(tmp_path / f"{name}.pt").weights for name in ("whole", "cut"))
    assert all(torch.equal(cut[name], value) for name, value in whole.items())
    assert not torch.equal(
        whole["head.0.weight"], training.build_detector(record).state_dict()["head.0.weight"]
    )


def test_a_trained_detector_predicts_with_every_fusion(
    two_roads: Path, tmp_path: Path, advercity: Command
) -> None:
    pytest.importorskip("torch", reason=HINT)
    single, fused = tmp_path / "single.pt", tmp_path / "fused.pt"

    def run(*arguments: str | Path) -> None:
        ran = advercity("benchmark", *arguments)
        assert ran.code == 0, ran.err

    small = ("--steps", "2", "--batch", "1", "--channels", "8", "--ideal-channel")
    run("train", two_roads, "--output", single, *small)
    attention = ("--fusion", "intermediate", "--start", single)
    run("train", two_roads, "--output", fused, *attention, *small)
    some = ("--frames", "1:")
    for detector, fusion in ((single, "none"), (single, "late"), (single, "early"), (fused, None)):
        path = tmp_path / f"{fusion}.jsonl"
        chosen = () if fusion is None else ("--fusion", fusion)
        run("predict", detector, two_roads, "--output", path, "--ideal-channel", *some, *chosen)
        assert {frame for _, frame in load_predictions(path).frames} == {1, 2}
        run("evaluate", path, two_roads, *some)


def test_boxes_of_cameras_are_added_to_those_of_the_cloud_of_each_station(
    two_roads: Path, tmp_path: Path, advercity: Command
) -> None:
    pytest.importorskip("torch", reason=HINT)
    cloud, images = tmp_path / "cloud.pt", tmp_path / "images.pt"

    def train(output: Path, *arguments: str) -> None:
        small = ("--steps", "2", "--batch", "1", "--channels", "8")
        ran = advercity("benchmark", "train", two_roads, "--output", output, *small, *arguments)
        assert ran.code == 0, ran.err

    def predict(name: str, *arguments: str | Path) -> Ran:
        end = ("--output", tmp_path / name, "--frames", "1:2", "--ideal-channel")
        return advercity("benchmark", "predict", *arguments, *end)

    train(cloud)
    train(images, "--sensor", "camera")
    assert predict("none", images, two_roads).code == 0
    assert predict("late", cloud, two_roads, "--camera", images, "--fusion", "late").code == 0
    assert len(load_predictions(tmp_path / "late").frames) == 2
    for message, arguments in (
        ("sees images, which have no early fusion", (images, two_roads, "--fusion", "early")),
        ("sees clouds; --camera takes one", (cloud, two_roads, "--camera", cloud)),
        ("and the first sees images", (images, two_roads, "--camera", images)),
        ("not early", (cloud, two_roads, "--camera", images, "--fusion", "early")),
    ):
        ran = predict("failed", *arguments)
        assert ran.code == 2
        assert message in " ".join(ran.err.split())


def test_training_starts_from_no_detector_of_another_kind(
    two_roads: Path, tmp_path: Path, advercity: Command
) -> None:
    pytest.importorskip("torch", reason=HINT)
    first = tmp_path / "first.pt"
    train = ("benchmark", "train", two_roads, "--steps", "1", "--batch", "1")
    assert advercity(*train, "--output", first, "--channels", "8").code == 0
    for message, arguments in (
        ("was trained with --channels 8, not 16", ("--channels", "16")),
        ("was trained with --sensor lidar, not camera", ("--channels", "8", "--sensor", "camera")),
    ):
        ran = advercity(*train, "--start", first, "--output", tmp_path / "second.pt", *arguments)
        assert ran.code == 2
        assert message in " ".join(ran.err.split())


def test_targets_are_read_back_as_the_boxes_that_they_are_of() -> None:
    torch = pytest.importorskip("torch", reason=HINT)
    from advercity_benchmark.detector.prediction import read_boxes

    heat, learned, _ = draw_targets(BOXES, BOXES[:0], AREA)
    logits = torch.logit(torch.from_numpy(heat)[None].clamp(1e-4, 1 - 1e-4))
    found, scores = read_boxes(logits, torch.from_numpy(learned), AREA)
    assert (scores > 0.99).all()
    order = np.argsort(-found[:, 0])
    np.testing.assert_allclose(found[order], BOXES, atol=1e-5)


def test_vehicles_on_a_hill_are_used_and_crowns_of_trees_are_not() -> None:
    torch = pytest.importorskip("torch", reason=HINT)
    from advercity_benchmark.detector.network import Pillars

    rng = create_generator("a test")
    x_m, y_m = rng.uniform(-80, 80, 20_000), rng.uniform(-8, 8, 20_000)
    uphill = np.column_stack([x_m, y_m, 0.08 * x_m, np.zeros(len(x_m))])
    roof, crown = [70.25, 0.25, 0.08 * 70 + 1.5, 0.0], [60.25, 0.25, 0.08 * 60 + 7.0, 0.0]
    mirrored = [-60.25, 0.25, -0.08 * 60 - 5.0, 0.0]
    pillars, area = Pillars(8).eval(), (80.0, 8.0)

    def fill(*more: list[float]) -> Any:
        points = torch.from_numpy(np.vstack([uphill, *more]).astype(np.float32))
        return pillars(points, area)[0].abs().sum(0)

    with torch.no_grad():
        changed = (fill(roof, crown, mirrored) != fill()).nonzero().tolist()
    assert changed == [[300, 16]]  # at x 70.25 m, y 0.25 m, in pillars of 0.5 m


def test_a_station_s_features_arrive_where_the_ego_sees_its_place() -> None:
    torch = pytest.importorskip("torch", reason=HINT)
    from advercity_benchmark.detector.network import Detector

    network = Detector(8, has_attention=True)
    ego, station = torch.zeros(1, 8, *count_cells(AREA)), torch.zeros(1, 8, 16, 16)
    station[:, :, 10, 4] = 1.0  # at x 2.5 m, y -3.5 m of a map of 8 m around
    pose = pose_matrix((-4.0, 2.0, 0.0), yaw=np.pi / 2)
    fused = network.fuse([ego, station], [np.eye(4), pose], [AREA, (8.0, 8.0)])[0, 0]
    place = transform_points(pose, [2.5, -3.5, 0.0])[:2]
    cell = np.unravel_index(int(fused.argmax()), count_cells(AREA))
    np.testing.assert_allclose(compute_cell_centres(AREA)[cell], place, atol=1e-5)
    assert float((fused > 1e-3).sum()) == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("train", "{data}", "--fusion", "late"), "--fusion late: no such fusion"),
        (("train", "{data}", "--sensor", "sonar"), "--sensor sonar: no such sensor"),
        (("train", "{data}", "--sensor", "camera", "--fusion", "early"), "no such fusion"),
        (("train", "{data}", "--fusion", "early"), "has no messages: its suite names no channel"),
        (("train", "{data}", "--frames", "90:"), "has no frame among those of --frames"),
        (("train", "{data}", "--device", "cuda:99"), "--device cuda:99: cannot be used"),
        (("train", "{data}", "--start", "{data}/none.pt"), "none.pt: cannot be read"),
        (("predict", "{junk}", "{data}"), "is no detector, or is damaged"),
        (("predict", "{data}/none.pt", "{data}"), "none.pt: cannot be read"),
    ],
)
def test_what_cannot_be_used_is_named(
    two_roads: Path, tmp_path: Path, advercity: Command, arguments: tuple[str, ...], message: str
) -> None:
    pytest.importorskip("torch", reason=HINT)
    junk = tmp_path / "junk.pt"
    junk.write_bytes(b"PK\x03\x04 no weights")
    filled = [item.format(data=two_roads, junk=junk) for item in arguments]
    ran = advercity("benchmark", *filled, "--output", tmp_path / "made.pt")
    assert ran.code == 2
    assert message in " ".join(ran.err.split())


def test_without_pytorch_the_commands_say_what_to_install(
    two_roads: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, advercity: Command
) -> None:
    for name in [name for name in sys.modules if name.startswith("advercity_benchmark.detector")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "torch", None)
    ran = advercity("benchmark", "train", two_roads, "--output", tmp_path / "a.pt")
    assert ran.code == 2
    assert "pip install 'advercity[benchmark]'" in ran.err
