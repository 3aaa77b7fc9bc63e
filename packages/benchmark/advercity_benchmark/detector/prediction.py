"""Predictions of a trained detector on a dataset."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from advercity.dataset.reader import FrameView
from advercity.errors import InputError
from advercity.geometry import poses
from advercity.geometry.arrays import Float64Array
from advercity.geometry.poses import Matrix
from advercity.output_files import check_output
from advercity_benchmark.detector.boxes import (
    Area,
    FoundBoxes,
    compute_cell_centres,
    drop_overlapping,
    fuse_sensors,
)
from advercity_benchmark.detector.checkpoint import TrainingRecord, load_detector
from advercity_benchmark.detector.clouds import Fusion, StationCloud, check_frames, load_clouds
from advercity_benchmark.detector.images import CAMERA_AREA, check_cameras, load_images
from advercity_benchmark.detector.pytorch import Tensor, functional, select_device, torch
from advercity_benchmark.detector.samples import EGO_AREA, STATION_AREA, merge_clouds
from advercity_benchmark.frame_selection import select_frames
from advercity_benchmark.predictions import FrameKey, FramePredictions, write_predictions

_TRAINED_BY: dict[Fusion, Fusion] = {"late": "none", "early": "none"}
"""Other fusion a detector may have been trained with: it sees the boxes or the points of others."""
_OF_BOXES: tuple[Fusion, ...] = ("none", "late")
"""Fusions in which each station finds boxes by itself."""
MAX_BOXES = 200
LOWEST_SCORE = 0.05


def predict_dataset(
    detector: Path,
    dataset: Path,
    output: Path,
    *,
    camera: Path | None = None,
    fusion: Fusion | None = None,
    is_ideal: bool = False,
    frames: slice = slice(None),
    device: str = "cpu",
) -> int:
    """Write the predictions of a detector on the frames of a dataset; return their number.

    Args:
        detector: File of a trained detector.
        dataset: Frames to predict.
        output: File of predictions.
        camera: File of a detector trained on images, whose boxes are fused with the first
            detector's boxes in the cloud of the same station.
        fusion: By default the detector's; one trained without fusion can also use `late` and
            `early`.
        is_ideal: Whether all stations in range arrive at once and with their true poses.
        frames: Used frames of each scenario.
        device: As PyTorch names it.

    Raises:
        InputError: The detector or the dataset cannot be used, or the file may not be replaced.
    """
    check_output(output)
    place = select_device(device)
    network, record = load_detector(detector)
    fusion = fusion or record.fusion
    _check_detector(detector, record, fusion)
    networks = [network]
    if camera is not None:
        networks.append(_load_second(camera, record, fusion))
    chosen = select_frames(dataset, frames)
    check_frames(chosen, fusion, is_ideal=is_ideal)
    if any(one.has_cameras for one in networks):
        check_cameras(chosen)
    for one in networks:
        one.to(place)
    found: dict[FrameKey, FramePredictions] = {}
    for frame in chosen:
        found[frame.scenario.spec.id, frame.index] = predict_frame(
            networks, frame, fusion, is_ideal=is_ideal
        )
    sensors = record.sensor if camera is None else "lidar and camera"
    write_predictions(output, found, model=f"advercity baseline, {sensors}, {fusion} fusion")
    return len(chosen)


def _check_detector(path: Path, record: TrainingRecord, fusion: Fusion) -> None:
    """Raise an InputError if a detector cannot predict with a fusion."""
    if record.fusion != fusion and record.fusion != _TRAINED_BY.get(fusion):
        message = f"was trained with --fusion {record.fusion}, which cannot predict with {fusion}"
        raise InputError(f"{path}: {message}")
    if record.sensor == "camera" and fusion not in _OF_BOXES:
        raise InputError(f"{path}: sees images, which have no {fusion} fusion; give none or late")


def _load_second(path: Path, first: TrainingRecord, fusion: Fusion) -> Any:
    """Load the detector of images, for fusion with the boxes of the first."""
    network, record = load_detector(path)
    if record.sensor != "camera":
        raise InputError(f"{path}: sees clouds; --camera takes one of `train --sensor camera`")
    if first.sensor != "lidar":
        raise InputError(
            f"{path}: --camera adds to a detector of clouds, and the first sees images"
        )
    if fusion not in _OF_BOXES:
        raise InputError(f"--camera: fuses boxes, as fusion none and late have, not {fusion}")
    return network


def predict_frame(
    networks: Sequence[Any], frame: FrameView, fusion: Fusion, *, is_ideal: bool = False
) -> FramePredictions:
    """Predict the boxes of a frame in the ego's LiDAR frame.

    Args:
        networks: One detector; or one of clouds, then one of images.
        frame: The frame.
        fusion: Kind of messages.
        is_ideal: Whether they arrive at once and with true poses.
    """
    clouds = load_clouds(frame, fusion, is_ideal=is_ideal)
    if fusion == "early":
        clouds = [merge_clouds(clouds)]
    areas = [EGO_AREA, *[STATION_AREA] * (len(clouds) - 1)]
    with torch.inference_mode():
        if fusion == "intermediate":
            boxes, scores = _detect_in_maps(networks[0], clouds, areas)
        else:
            found = [
                _detect_at_station(networks, cloud, area)
                for cloud, area in zip(clouds, areas, strict=True)
            ]
            boxes, scores = _merge_boxes(found, clouds)
    boxes[:, 2] += clouds[0].ground_m
    return FramePredictions(boxes, scores)


def _detect_in_maps(network: Any, clouds: list[StationCloud], areas: list[Area]) -> FoundBoxes:
    maps = [network.encode(one.points, area) for one, area in zip(clouds, areas, strict=True)]
    fused = network.fuse(maps, [one.ego_from_station for one in clouds], areas)
    return _detect(network, fused, areas[0])


def _detect_at_station(networks: Sequence[Any], cloud: StationCloud, area: Area) -> FoundBoxes:
    """Detect objects at a station by itself, in its own frame."""
    found: list[FoundBoxes] = []
    for network in networks:
        if network.has_cameras:
            maps = network.encode(load_images(cloud, np.eye(4)), CAMERA_AREA)
            found.append(_detect(network, maps, CAMERA_AREA))
        else:
            found.append(_detect(network, network.encode(cloud.points, area), area))
    return fuse_sensors(*found) if len(found) > 1 else found[0]


def _detect(network: Any, features: Tensor, area: Area) -> FoundBoxes:
    heat, learned = network.predict(features)
    return read_boxes(heat, learned, area)


def read_boxes(heat: Tensor, learned: Tensor, area: Area) -> FoundBoxes:
    """Read boxes (n, 7) and their scores (n,) off the predicted maps (1, nx, ny), (8, nx, ny).

    Boxes are the peaks of the heat, without overlaps with better ones.
    """
    scores = torch.sigmoid(heat)
    is_peak = scores == functional.max_pool2d(scores, 3, stride=1, padding=1)
    ranked = (scores * is_peak).flatten()
    best, places = torch.topk(ranked, min(MAX_BOXES, ranked.numel()))
    places, best = places[best >= LOWEST_SCORE], best[best >= LOWEST_SCORE]
    rows = learned.flatten(1)[:, places].T.double().cpu().numpy()
    centres = compute_cell_centres(area).reshape(-1, 2)[places.cpu().numpy()]
    found = np.column_stack(
        [
            centres + rows[:, :2],
            rows[:, 2],
            np.exp(np.clip(rows[:, 3:6], -2.0, 3.5)),
            0.5 * np.arctan2(rows[:, 6], rows[:, 7]),
        ]
    )
    return drop_overlapping(found, best.double().cpu().numpy())


def _merge_boxes(found: list[FoundBoxes], clouds: list[StationCloud]) -> FoundBoxes:
    """Merge the boxes of all stations in the ego's frame."""
    moved = [
        _move_boxes(boxes, cloud.ego_from_station)
        for (boxes, _), cloud in zip(found, clouds, strict=True)
    ]
    return drop_overlapping(np.concatenate(moved), np.concatenate([scores for _, scores in found]))


def _move_boxes(boxes: Float64Array, pose: Matrix) -> Float64Array:
    moved = boxes.copy()
    moved[:, :3] = poses.transform_points(pose, boxes[:, :3])
    moved[:, 6] += poses.to_yaw_pitch_roll(pose)[0]
    return moved
