"""ASAM OpenLABEL 1.0: objects, sensors and coordinate systems of every scenario, and tags.

    <scenario>.json

`world` is x east, y north, z up; `<agent>` and its LiDARs and radars are x forward, y left, z up;
cameras are x right, y down, z along the view. A transform leads from its `src` to its `dst`.
`uri` names the sensors' own files, relative to the folder of the dataset.
"""

import json
import math
from collections.abc import Iterable, Iterator
from typing import Any, Literal

import numpy as np
from advercity_dsl import Road, Weather
from advercity_dsl.lens import KannalaBrandtLens

from advercity.dataset.agent_view import AgentView
from advercity.dataset.reader import Dataset, FrameView, Scenario
from advercity.exports.pieces import Piece, PieceFiles, split_by_scenario
from advercity.exports.registry import Options
from advercity.geometry.poses import (
    OPTICAL_FROM_BODY,
    Matrix,
    invert_pose,
    to_quaternion,
)
from advercity.physics.extinction import compute_extinction
from advercity_exports.requirements import require_truth

SCHEMA_VERSION = "1.0.0"
WORLD = "world"
TAGS_ONTOLOGY = "0"
TAGS_URI = "https://openlabel.asam.net/V1-0-0/ontologies/openlabel_ontology_scenario_tags.ttl"
DECIMALS = 6


def list_pieces(dataset: Dataset, options: Options) -> list[Piece]:
    """Make a piece of every scenario; InputError for a layout without 2-D boxes."""
    require_truth(dataset, "openlabel")
    return split_by_scenario(dataset, _write_scenario)


def _write_scenario(scenario: Scenario, files: PieceFiles) -> None:
    frames: dict[str, Any] = {}
    objects: dict[str, dict[str, Any]] = {}
    shown: dict[str, list[int]] = {}
    for frame in files.track(scenario):
        described = _describe_objects(frame)
        for number, (kind, _) in described.items():
            shown.setdefault(number, []).append(frame.index)
            objects[number] = {"name": f"{kind}_{number}", "type": kind}
        frames[str(frame.index)] = {
            "frame_properties": {
                "timestamp": f"{frame.time_s:.{DECIMALS}f}",
                "streams": dict(_list_files(frame)),
                "transforms": {
                    f"{name}_to_{WORLD}": {
                        "src": name,
                        "dst": WORLD,
                        "transform_src_to_dst": _format_matrix(view.world_from_agent),
                    }
                    for name, view in frame.views.items()
                },
            },
            "objects": {number: {"object_data": data} for number, (_, data) in described.items()},
        }
    for number, item in objects.items():
        item["frame_intervals"] = list(_list_intervals(shown[number]))
    spec = scenario.spec
    first = scenario[0]
    document = {
        "openlabel": {
            "metadata": {
                "schema_version": SCHEMA_VERSION,
                "name": spec.id,
                "annotator": "advercity",
                "comment": "Truth of a simulation; frames are numbered as in the dataset.",
            },
            "ontologies": {TAGS_ONTOLOGY: {"uri": TAGS_URI}},
            "coordinate_systems": dict(_list_coordinate_systems(first)),
            "streams": dict(_list_streams(first)),
            "frame_intervals": list(_list_intervals(scenario.frame_numbers)),
            "frames": frames,
            "objects": objects,
            "tags": {
                str(number): tag
                for number, tag in enumerate(
                    (*list_weather_tags(spec.weather.at(0.0)), *_list_road_tags(spec.road))
                )
            },
        }
    }
    raw = json.dumps(document, separators=(",", ":"), allow_nan=False)
    files.write(f"{scenario.path.name}.json", raw + "\n")


def _describe_objects(frame: FrameView) -> dict[str, tuple[str, dict[str, Any]]]:
    """Describe the annotated objects of all agents: class and data by id."""
    found: dict[str, tuple[str, dict[str, Any]]] = {}
    for name, view in frame.views.items():
        boxes, extras = view.load_steady_boxes(), view.extras["objects"]
        for row, number in enumerate(boxes.ids.tolist()):
            # Agents share one truth: the box of an object is the same for all of them.
            cuboid = _format_cuboid(boxes.world_from_box[row], boxes.sizes[row].tolist())
            speed = {"name": "speed_m_s", "val": round(float(boxes.speeds_m_s[row]), DECIMALS)}
            parked = {"name": "is_parked", "val": bool(boxes.is_parked[row])}
            data: dict[str, Any] = {"cuboid": [cuboid], "num": [speed], "boolean": [parked]}
            if boxes.towed_by[row]:
                data["num"].append({"name": "towed_by", "val": int(boxes.towed_by[row])})
            _, data = found.setdefault(str(number), (str(boxes.classes[row]), data))
            points = {"name": f"{name}/lidar_points", "val": int(boxes.lidar_points[row])}
            data["num"].append(points)
            outlines = [
                _format_outline(f"{name}/{camera}", facts)
                for camera, facts in extras[str(number)]["cameras"].items()
            ]
            if outlines:
                data["bbox"] = [*data.get("bbox", ()), *outlines]
    return found


def _format_cuboid(pose: Matrix, size: list[float]) -> dict[str, Any]:
    w, x, y, z = to_quaternion(pose).tolist()
    numbers = [*pose[:3, 3].tolist(), x, y, z, w, *size]
    val = [round(number, 9) for number in numbers]
    return {"name": "box", "val": val, "coordinate_system": WORLD}


def _format_outline(camera: str, facts: dict[str, Any]) -> dict[str, Any]:
    """Format the outline of a box in an image: middle, width and height."""
    left, top, right, bottom = facts["outline_box"]
    middle = [(left + right) / 2, (top + bottom) / 2]
    numbers = [*middle, right - left, bottom - top]
    return {
        "name": camera,
        "val": [round(number, DECIMALS) for number in numbers],
        "coordinate_system": camera,
        "attributes": {
            "num": [
                {"name": key, "val": facts[key]}
                for key in ("visible_fraction", "occlusion", "truncation")
            ]
        },
    }


def _list_intervals(numbers: Iterable[int]) -> Iterator[dict[str, int]]:
    """List the intervals of successive numbers, which rise."""
    begin = last = None
    for number in numbers:
        if begin is None or last is None or number != last + 1:
            if begin is not None and last is not None:
                yield {"frame_start": begin, "frame_end": last}
            begin = number
        last = number
    if begin is not None and last is not None:
        yield {"frame_start": begin, "frame_end": last}


def _list_sensors(view: AgentView) -> Iterator[tuple[str, str, Matrix]]:
    """List name, type and pose (4, 4) of an agent's sensors on it."""

    def place(kind: Literal["camera", "lidar", "radar"], number: int, pose: Matrix) -> Matrix:
        return invert_pose(view.find_carrier_pose(kind, number)) @ pose

    for number in range(view.cameras):
        pose = view.world_from_camera(number) @ OPTICAL_FROM_BODY.T
        yield f"camera{number}", "camera", place("camera", number, pose)
    for number in range(view.lidars):
        pose = view.load_lidar_pose(number)
        yield f"lidar{number}", "lidar", place("lidar", number, pose)
    for number in range(view.radars):
        pose = view.load_radar_pose(number)
        yield f"radar{number}", "radar", place("radar", number, pose)


def _list_coordinate_systems(frame: FrameView) -> Iterator[tuple[str, dict[str, Any]]]:
    yield WORLD, {"type": "scene_cs", "parent": "", "children": list(frame.views)}
    for name, view in frame.views.items():
        sensors = list(_list_sensors(view))
        children = [f"{name}/{sensor}" for sensor, _, _ in sensors]
        yield name, {"type": "local_cs", "parent": WORLD, "children": children}
        for sensor, _, pose in sensors:
            yield (
                f"{name}/{sensor}",
                {
                    "type": "sensor_cs",
                    "parent": name,
                    "children": [],
                    "pose_wrt_parent": _format_matrix(pose),
                },
            )


def _format_matrix(matrix: Matrix) -> dict[str, list[float]]:
    return {"matrix4x4": [round(value, 9) + 0.0 for value in matrix.ravel().tolist()]}


def _list_streams(frame: FrameView) -> Iterator[tuple[str, dict[str, Any]]]:
    for name, view in frame.views.items():
        for sensor, kind, _ in _list_sensors(view):
            stream: dict[str, Any] = {"type": kind, "description": f"{sensor} of {name}"}
            if kind == "camera":
                number = int(sensor.removeprefix("camera"))
                stream["stream_properties"] = _describe_camera(view, number)
            yield f"{name}/{sensor}", stream


def _describe_camera(view: AgentView, camera: int) -> dict[str, Any]:
    """Describe the intrinsic parameters of a camera by its kind of lens."""
    matrix, model = view.intrinsic(camera), view.camera_model(camera)
    size = {"width_px": model.width_px, "height_px": model.height_px}
    lens = view.agent.sensors.cameras[camera].model.lens
    if isinstance(lens, KannalaBrandtLens):
        fisheye = {
            "center_x_px": float(matrix[0, 2]),
            "center_y_px": float(matrix[1, 2]),
            "focal_length_x": float(matrix[0, 0]),
            "focal_length_y": float(matrix[1, 1]),
            "lens_coeffs": list(lens.coefficients),
        }
        return {"intrinsics_fisheye": {**size, **fisheye}}
    projection = np.column_stack([matrix, np.zeros(3)])
    pinhole: dict[str, Any] = {**size, "camera_matrix": projection.ravel().tolist()}
    if lens is not None:
        pinhole["distortion_coeffs"] = list(lens.coefficients)
    return {"intrinsics_pinhole": pinhole}


def _list_files(frame: FrameView) -> Iterator[tuple[str, dict[str, Any]]]:
    """List the files of the sensors in a frame, relative to the folder of the dataset."""
    root, layout = frame.scenario.path.parent, frame.scenario.format
    for name, view in frame.views.items():
        suffixes = [f"_camera{number}.png" for number in range(view.cameras)]
        suffixes += [layout.format_cloud_suffix(number) for number in range(view.lidars)]
        suffixes += [layout.format_radar_suffix(number) for number in range(view.radars)]
        for (sensor, kind, _), suffix in zip(_list_sensors(view), suffixes, strict=True):
            uri = view.path(suffix).relative_to(root).as_posix()
            yield f"{name}/{sensor}", {"type": kind, "uri": uri}


def _build_tag(kind: str, **numbers: float) -> dict[str, Any]:
    tag: dict[str, Any] = {"type": kind, "ontology_uid": TAGS_ONTOLOGY}
    if numbers:
        data = [{"name": name, "val": round(value, 4)} for name, value in numbers.items()]
        tag["tag_data"] = {"num": data}
    return tag


def list_weather_tags(weather: Weather) -> Iterator[dict[str, Any]]:
    """List tags of BSI PAS 1883, on which ISO 34504 builds, in the units of the ontology."""
    mor_m = compute_extinction(weather).mor_m
    yield _build_tag("WeatherWind", weatherWindValue=weather.wind.speed_m_s)
    yield _build_tag("IlluminationCloudiness", illuminationCloudinessValue=weather.sky.oktas)
    if weather.time == "day":
        yield _build_tag("DaySunElevation", daySunElevationValue=weather.sun.elevation_deg)
    else:
        yield _build_tag("LowLightNight")
    if weather.rain.rate_mm_h > 0:
        yield _build_tag("WeatherRain", weatherRainValue=weather.rain.rate_mm_h)
    if weather.snow.rate_mm_h > 0 and math.isfinite(mor_m):
        yield _build_tag("WeatherSnow", weatherSnowValue=mor_m / 1000)  # visibility in km
    if weather.fog.mor_m is not None:
        yield _build_tag("ParticulatesWater", particulatesWaterValue=weather.fog.mor_m)
    if weather.dust.mor_m is not None:
        yield _build_tag("ParticulatesDust")
    conditions = {
        "SurfaceConditionWet": weather.surface.wetness,
        "SurfaceConditionStandingWater": weather.surface.puddle_coverage,
        "SurfaceConditionSnow": weather.snow.road_coverage,
        "SurfaceConditionIcy": weather.surface.ice_mm,
    }
    yield from (_build_tag(name) for name, amount in conditions.items() if amount > 0)


def _list_road_tags(road: Road) -> Iterator[dict[str, Any]]:
    if road.junction == "intersection":
        yield _build_tag("JunctionIntersection")
    if road.alignment == "straight":
        yield _build_tag("HorizontalStraights")
    if road.profile == "level":
        yield _build_tag("LongitudinalLevelPlane")
