"""The tables of nuScenes, written row by row while the frames are read once."""

from __future__ import annotations

import json
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import numpy as np
from advercity_dsl.road import Road
from numpy.typing import NDArray

from advercity.dataset.agent_view import AgentView
from advercity.dataset.boxes import Boxes
from advercity.dataset.reader import Dataset, FrameView, Scenario
from advercity.digests import compute_json_digest
from advercity.exports.pieces import JsonList, PieceFiles
from advercity.geometry.poses import Matrix
from advercity.roads.road_network import build_road
from advercity.sensors.measurements import PointKind
from advercity_exports.nuscenes_scene import (
    Channel,
    Scene,
    list_scenes,
    make_token,
    quaternion_of,
    translation_of,
)

VERSION = "v1.0-trainval"
TABLES = (
    *("attribute", "calibrated_sensor", "category", "ego_pose", "instance", "log", "map"),
    *("sample", "sample_annotation", "sample_data", "scene", "sensor", "visibility"),
    "cooperation",
)
CATEGORIES = {
    "car": "vehicle.car",
    "van": "vehicle.car",
    "truck": "vehicle.truck",
    "bicycle": "vehicle.bicycle",
    "motorcycle": "vehicle.motorcycle",
    "pedestrian": "human.pedestrian.adult",
}
"""Categories by class; a van is a car there."""
TRAILER = "vehicle.trailer"
VISIBILITY_LEVELS = ("v0-40", "v40-60", "v60-80", "v80-100")
MOVING_FROM_M_S = 0.2
METRES_PER_PX = 0.1
MAP_MARGIN_M = 50.0
MAP_GRID_M = 10.0


@dataclass(frozen=True)
class MapExtent:
    """Extent of the mask of a road.

    nuScenes' positions are positive, from the lower left corner of the mask on.

    Attributes:
        path: Path of the mask.
        offset: Added to x and y of the world.
        width_px: Width of the mask.
        height_px: Height of the mask.
    """

    path: str
    offset: tuple[float, float]
    width_px: int
    height_px: int

    @staticmethod
    def from_road(road: Road) -> MapExtent:
        """Find the extent of a road's lanes with a margin, on a grid of 10 m."""
        points = np.concatenate(
            [border[:, :2] for lane in build_road(road).lanes for border in (lane.left, lane.right)]
        )
        lower = np.floor((points.min(axis=0) - MAP_MARGIN_M) / MAP_GRID_M) * MAP_GRID_M
        upper = np.ceil((points.max(axis=0) + MAP_MARGIN_M) / MAP_GRID_M) * MAP_GRID_M
        width, height = np.rint((upper - lower) / METRES_PER_PX).astype(int).tolist()
        digest = compute_json_digest(road.model_dump(mode="json"))
        path = f"maps/{road.id}_{digest[:8]}.png"
        return MapExtent(path, (-float(lower[0]), -float(lower[1])), width, height)

    def to_pixels(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Convert points (n, 2) of the world to columns and rows (n, 2)."""
        x, y = (points + self.offset).T / METRES_PER_PX
        return np.column_stack([x, self.height_px - y])


def write_tables(
    dataset: Dataset,
    extents: Mapping[str, MapExtent],
    files: PieceFiles,
    *,
    only_some_are_key: bool,
) -> None:
    """Write all tables.

    Args:
        dataset: The dataset.
        extents: Extents of the masks by the names of the scenarios.
        files: Takes the files.
        only_some_are_key: Whether key frames are half a second apart; else every frame is one.
    """
    with ExitStack() as stack:
        tables = {
            name: stack.enter_context(files.open_list(f"{VERSION}/{name}.json")) for name in TABLES
        }
        _write_kinds(tables)
        splits: dict[str, list[str]] = {"all": []}
        sensors: dict[str, str] = {}
        for scenario in dataset.scenarios:
            if not len(scenario):
                continue
            scenes = list_scenes(scenario, only_some_are_key=only_some_are_key)
            names = [scene.name for scene in scenes]
            splits["all"] += names
            splits.setdefault(scenario.path.parent.name, []).extend(names)
            sensors |= {c.name: c.modality for scene in scenes for c in scene.channels}
            _write_scenario(scenario, scenes, extents[scenario.path.name], tables, files)
        for name, modality in sensors.items():
            tables["sensor"].append(
                {"token": make_token("sensor", name), "channel": name, "modality": modality}
            )
        _write_maps(dataset, extents, tables["map"])
    files.write(f"{VERSION}/splits.json", json.dumps(splits, indent=1) + "\n")


def _write_kinds(tables: Mapping[str, JsonList]) -> None:
    for name in dict.fromkeys((*CATEGORIES.values(), TRAILER)):
        row = {"token": make_token("category", name), "name": name, "description": ""}
        tables["category"].append(row)
    for name in ATTRIBUTES:
        row = {"token": make_token("attribute", name), "name": name, "description": ""}
        tables["attribute"].append(row)
    for number, level in enumerate(VISIBILITY_LEVELS, start=1):
        text = f"largest fraction shown by one of the cameras, in percent: {level[1:]}"
        tables["visibility"].append({"token": str(number), "level": level, "description": text})


def _write_maps(dataset: Dataset, extents: Mapping[str, MapExtent], table: JsonList) -> None:
    logs: dict[MapExtent, list[str]] = {}
    for scenario in dataset.scenarios:
        if len(scenario):
            name = scenario.path.name
            logs.setdefault(extents[name], []).append(make_token("log", name))
    for extent, tokens in logs.items():
        table.append(
            {
                "token": make_token("map", extent.path),
                "log_tokens": tokens,
                "category": "semantic_prior",
                "filename": extent.path,
                "world_offset": extent.offset,
            }
        )


def _write_scenario(
    scenario: Scenario,
    scenes: list[Scene],
    extent: MapExtent,
    tables: Mapping[str, JsonList],
    files: PieceFiles,
) -> None:
    name = scenario.path.name
    spec = scenario.spec
    log = make_token("log", name)
    tables["log"].append(
        {
            "token": log,
            "logfile": name,
            "vehicle": "",
            "date_captured": "",
            "location": spec.road.id,
            "weather": scenario.manifest.weather.model_dump(mode="json"),
        }
    )
    writers = [_SceneWriter(scene, extent, tables) for scene in scenes]
    for frame in files.track(scenario):
        for writer in writers:
            writer.add(frame)
        if scenes[0].is_key(frame):
            tables["cooperation"].append(
                {
                    "token": make_token("cooperation", name, frame.index),
                    "log_token": log,
                    "timestamp": scenes[0].compute_timestamp_us(frame.time_s),
                    "sample_tokens": {
                        scene.agent.id: scene.make_sample_token(frame.index) for scene in scenes
                    },
                }
            )
    for writer in writers:
        writer.finish(log)


class _SceneWriter:
    """Writes the rows of a scene; a row naming its successor waits for it."""

    def __init__(self, scene: Scene, extent: MapExtent, tables: Mapping[str, JsonList]) -> None:
        self._scene, self._extent, self._tables = scene, extent, tables
        self._last_annotation: dict[int, dict[str, Any]] = {}
        self._instances: dict[int, dict[str, Any]] = {}

    def add(self, frame: FrameView) -> None:
        scene = self._scene
        view = frame[scene.agent.id]
        world_from_ego = scene.compute_world_from_ego(view)
        if frame.index == scene.scenario.frame_numbers[0]:
            self._write_calibrations(view)
        time_us = scene.compute_timestamp_us(frame.time_s)
        ego_pose = make_token("ego_pose", scene.name, frame.index)
        self._write_ego_pose(ego_pose, time_us, world_from_ego)
        for channel in scene.channels:
            stamp_us = scene.find_stamp_us(view, channel)
            if stamp_us is None:
                self._write_reading(frame, view, channel, ego_pose, time_us)
                continue
            pose = make_token("ego_pose", scene.name, frame.index, channel.name)
            self._write_ego_pose(pose, stamp_us, scene.compute_world_from_ego(view, channel))
            self._write_reading(frame, view, channel, pose, stamp_us)
        if scene.is_key(frame):
            before, after = _find_neighbours(scene.key_frames, frame.index)
            self._tables["sample"].append(
                {
                    "token": scene.make_sample_token(frame.index),
                    "timestamp": time_us,
                    "prev": "" if before is None else scene.make_sample_token(before),
                    "next": "" if after is None else scene.make_sample_token(after),
                    "scene_token": scene.token,
                }
            )
            self._write_annotations(frame, view)

    def finish(self, log: str) -> None:
        for row in self._last_annotation.values():
            self._tables["sample_annotation"].append(row)
        for row in self._instances.values():
            self._tables["instance"].append(row)
        scene, keys = self._scene, self._scene.key_frames
        kind = scene.agent.place.kind.replace("_", " ")
        self._tables["scene"].append(
            {
                "token": scene.token,
                "log_token": log,
                "nbr_samples": len(keys),
                "first_sample_token": scene.make_sample_token(keys[0]),
                "last_sample_token": scene.make_sample_token(keys[-1]),
                "name": scene.name,
                "description": f"{scene.scenario.path.name}, as {kind} {scene.agent.id} senses it",
            }
        )

    def _describe_pose(self, world_from_body: Matrix) -> dict[str, list[float]]:
        return {
            "translation": translation_of(world_from_body, self._extent.offset),
            "rotation": quaternion_of(world_from_body),
        }

    def _write_ego_pose(self, token: str, time_us: int, world_from_ego: Matrix) -> None:
        pose = {"token": token, "timestamp": time_us, **self._describe_pose(world_from_ego)}
        self._tables["ego_pose"].append(pose)

    def _write_calibrations(self, view: AgentView) -> None:
        for channel in self._scene.channels:
            pose = channel.compute_ego_from_sensor(self._scene, view)
            is_camera = channel.modality == "camera"
            self._tables["calibrated_sensor"].append(
                {
                    "token": self._scene.make_calibration_token(channel),
                    "sensor_token": make_token("sensor", channel.name),
                    "translation": translation_of(pose),
                    "rotation": quaternion_of(pose),
                    "camera_intrinsic": view.intrinsic(channel.number).tolist()
                    if is_camera
                    else [],
                }
            )

    def _write_reading(
        self, frame: FrameView, view: AgentView, channel: Channel, ego_pose: str, time_us: int
    ) -> None:
        scene = self._scene
        before, after = _find_neighbours(scene.scenario.frame_numbers, frame.index)
        keys = scene.key_frames
        key = keys[min(bisect_left(keys, frame.index), len(keys) - 1)]
        model = view.camera_model(channel.number) if channel.modality == "camera" else None
        self._tables["sample_data"].append(
            {
                "token": scene.make_data_token(channel, frame.index),
                # Of a sweep: the sample after it.
                "sample_token": scene.make_sample_token(key),
                "ego_pose_token": ego_pose,
                "calibrated_sensor_token": scene.make_calibration_token(channel),
                "timestamp": time_us,
                "fileformat": channel.file_format.partition(".")[0],
                "is_key_frame": scene.is_key(frame),
                "height": 0 if model is None else model.height_px,
                "width": 0 if model is None else model.width_px,
                "filename": scene.format_path(channel, frame),
                "prev": "" if before is None else scene.make_data_token(channel, before),
                "next": "" if after is None else scene.make_data_token(channel, after),
            }
        )

    def _write_annotations(self, frame: FrameView, view: AgentView) -> None:
        boxes, velocities = view.load_steady_boxes(), view.load_velocities()
        radar_points = count_radar_points(view, boxes.ids)
        for row, number in enumerate(boxes.ids.tolist()):
            token = make_token("sample_annotation", self._scene.name, number, frame.index)
            before = self._last_annotation.get(number)
            if before is not None:
                self._tables["sample_annotation"].append({**before, "next": token})
            self._last_annotation[number] = {
                "token": token,
                "sample_token": self._scene.make_sample_token(frame.index),
                "instance_token": self._note_instance(boxes, row, token),
                "visibility_token": str(_grade_visibility(boxes.visible_fraction[row])),
                "attribute_tokens": [make_token("attribute", _name_attribute(boxes, row))],
                **self._describe_pose(boxes.world_from_box[row]),
                "size": boxes.sizes[row][[1, 0, 2]].tolist(),
                "prev": "" if before is None else before["token"],
                "next": "",
                "num_lidar_pts": int(boxes.lidar_points[row]),
                "num_radar_pts": int(radar_points[row]),
                "velocity": velocities[row].tolist(),
                "visible_fraction": float(boxes.visible_fraction[row]),
            }

    def _note_instance(self, boxes: Boxes, row: int, annotation: str) -> str:
        """Count an annotation of an object, and return the token of the object."""
        scene, number, actor_class = self._scene, int(boxes.ids[row]), str(boxes.classes[row])
        towed_by = int(boxes.towed_by[row])
        category = TRAILER if towed_by else CATEGORIES[actor_class]
        token = make_token("instance", scene.name, number)
        instance = self._instances.setdefault(
            number,
            {
                "token": token,
                "category_token": make_token("category", category),
                "nbr_annotations": 0,
                "first_annotation_token": annotation,
                "last_annotation_token": annotation,
                # The same in the scenes of all agents of a scenario.
                "object_token": make_token("object", scene.scenario.path.name, number),
                "object_id": number,
                "class": actor_class,
                **({"towed_by": towed_by} if towed_by else {}),
            },
        )
        instance["nbr_annotations"] += 1
        instance["last_annotation_token"] = annotation
        return token


ATTRIBUTES = (
    *("vehicle.moving", "vehicle.stopped", "vehicle.parked"),
    *("cycle.with_rider", "pedestrian.moving", "pedestrian.standing"),
)


def _name_attribute(boxes: Boxes, row: int) -> str:
    moves = boxes.speeds_m_s[row] >= MOVING_FROM_M_S
    match boxes.classes[row]:
        case "pedestrian":
            return "pedestrian.moving" if moves else "pedestrian.standing"
        case "bicycle" | "motorcycle":
            return "cycle.with_rider"
        case _ if boxes.is_parked[row]:
            return "vehicle.parked"
        case _:
            return "vehicle.moving" if moves else "vehicle.stopped"


def _grade_visibility(fraction: float) -> int:
    """Grade a visible fraction: 1 up to 40 %, 2 to 60 %, 3 to 80 %, 4 above."""
    return 1 + sum(fraction > limit for limit in (0.4, 0.6, 0.8))


def count_radar_points(view: AgentView, ids: NDArray[np.int64]) -> NDArray[np.int64]:
    """Count the detections of objects (n,) by all radars of an agent, without mirror images."""
    counts = np.zeros(len(ids), np.int64)
    for radar in range(view.radars):
        found = view.load_radar(radar)
        own = found["object_id"][found["kind"] == PointKind.SURFACE]
        counts += (own[None, :] == ids[:, None]).sum(axis=1)
    return counts


def _find_neighbours(numbers: Sequence[int], number: int) -> tuple[int | None, int | None]:
    position = bisect_left(numbers, number)
    before = numbers[position - 1] if position else None
    after = numbers[position + 1] if position + 1 < len(numbers) else None
    return before, after
