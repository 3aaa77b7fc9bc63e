"""Metadata of a dataset: Croissant (MLCommons, JSON-LD), tables of frames and objects, and a card.

croissant.json   description of the tables, with checksums and types of their columns
frames.csv       a row for every frame of every agent: files, pose, weather, number of objects
objects.csv      a row for every annotated object of every agent in every frame
README.md        the card: licence, attribution, weather, counts, how to make the data again
"""

from __future__ import annotations

import csv
import io
import json
from collections import Counter
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from typing import Any

from advercity import __version__
from advercity.dataset.agent_view import AgentView
from advercity.dataset.attribution import format_attribution
from advercity.dataset.boxes import Boxes
from advercity.dataset.partial_files import FileRecord
from advercity.dataset.reader import Dataset, FrameView, Scenario
from advercity.dataset.scenario_folders import MANIFEST_FILE
from advercity.dataset.weather_truth import WeatherTruth
from advercity.exports.pieces import Piece, PieceFiles, make_common_piece
from advercity.exports.registry import Options
from advercity.geometry import poses
from advercity.physics.timeline import WeatherTimeline

TEXT, INTEGER, FLOAT, BOOLEAN = "sc:Text", "sc:Integer", "sc:Float", "sc:Boolean"
FRAME_COLUMNS = {
    "scenario": (TEXT, "folder of the scenario"),
    "agent": (TEXT, "id of the agent"),
    "frame": (INTEGER, "number of the frame, from the first kept one"),
    "time_s": (FLOAT, "seconds since the start of the simulation"),
    "stem": (TEXT, "beginning of the paths of the agent's files in the frame, in the dataset"),
    "x_m": (FLOAT, "agent's origin in the world, east"),
    "y_m": (FLOAT, "agent's origin in the world, north"),
    "z_m": (FLOAT, "agent's origin in the world, up"),
    "yaw_rad": (FLOAT, "agent's heading, counter-clockwise from east"),
    "speed_m_s": (FLOAT, "agent's speed"),
    "objects": (INTEGER, "objects annotated by the agent"),
    "weather": (TEXT, "id of the weather"),
    "time_of_day": (TEXT, "day, night, ..."),
    "mor_m": (FLOAT, "meteorological optical range; empty in perfectly clear air"),
    "rain_mm_h": (FLOAT, "rate of rain"),
    "snow_mm_h": (FLOAT, "rate of snow, as water"),
}
OBJECT_COLUMNS = {
    "scenario": (TEXT, "folder of the scenario"),
    "agent": (TEXT, "id of the annotating agent"),
    "frame": (INTEGER, "number of the frame"),
    "object_id": (INTEGER, "the same in all frames and agents of a scenario"),
    "class": (TEXT, "car, van, truck, bicycle, motorcycle or pedestrian"),
    "x_m": (FLOAT, "middle of the box in the world, east"),
    "y_m": (FLOAT, "middle of the box in the world, north"),
    "z_m": (FLOAT, "middle of the box in the world, up"),
    "yaw_rad": (FLOAT, "heading, counter-clockwise from east"),
    "length_m": (FLOAT, "length of the box"),
    "width_m": (FLOAT, "width of the box"),
    "height_m": (FLOAT, "height of the box"),
    "speed_m_s": (FLOAT, "speed"),
    "distance_m": (FLOAT, "distance from the agent"),
    "lidar_points": (INTEGER, "points on it in this weather"),
    "visible_fraction": (FLOAT, "largest fraction shown by a camera of the agent"),
    "parked": (BOOLEAN, "whether it is a parked car"),
}
TABLES = {"frames": FRAME_COLUMNS, "objects": OBJECT_COLUMNS}
CONTEXT: dict[str, Any] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    **{
        name: f"cr:{name}"
        for name in (
            *("citeAs", "column", "equivalentProperty", "extract", "field", "fileProperty"),
            *("fileObject", "fileSet", "format", "includes", "isLiveDataset", "jsonPath", "key"),
            *("md5", "parentField", "path", "recordSet", "references", "regex", "repeated"),
            *("replace", "samplingRate", "separator", "source", "subField", "transform"),
        )
    },
    "conformsTo": "dct:conformsTo",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "sc": "https://schema.org/",
}
LICENCE_NOTE = (
    "The publisher of the data chooses their licence."
    " Third-party models and photographs in images keep their authors' licences, below."
)


def list_pieces(dataset: Dataset, options: Options) -> list[Piece]:
    """Make one piece: tables, metadata and card are of the whole dataset."""
    return [make_common_piece(dataset, "metadata", lambda files: _write_metadata(dataset, files))]


def _write_metadata(dataset: Dataset, files: PieceFiles) -> None:
    counts: dict[str, Counter[str]] = {}
    with (
        _open_table(files, "frames") as frames,
        _open_table(files, "objects") as objects,
    ):
        for scenario in dataset.scenarios:
            counts[scenario.path.name] = _write_rows(scenario, files, frames, objects)
    document = _describe(dataset, {f"{name}.csv": files.records[f"{name}.csv"] for name in TABLES})
    files.write("croissant.json", json.dumps(document, indent=1) + "\n")
    files.write("README.md", _format_card(dataset, counts))


@contextmanager
def _open_table(files: PieceFiles, name: str) -> Generator[Any]:
    with files.open(f"{name}.csv") as stream:
        text = io.TextIOWrapper(stream, encoding="utf-8", newline="", write_through=True)
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(TABLES[name])
        yield writer
        text.detach()


def _write_rows(scenario: Scenario, files: PieceFiles, frames: Any, objects: Any) -> Counter[str]:
    """Write the rows of a scenario, and count its objects by class, each once per frame."""
    timeline = WeatherTimeline.from_spec(scenario.spec)
    counts: Counter[str] = Counter()
    for frame in files.track(scenario):
        weather = WeatherTruth.from_weather(timeline.weather_at(frame.index))
        seen: dict[int, str] = {}
        for view in frame.views.values():
            boxes = view.load_steady_boxes()
            frames.writerow(_list_frame_values(frame, view, len(boxes), weather))
            for row in range(len(boxes)):
                objects.writerow(_list_object_values(frame, view, boxes, row))
            seen |= dict(zip(boxes.ids.tolist(), boxes.classes.tolist(), strict=True))
        counts.update(seen.values())
    return counts


def _list_frame_values(
    frame: FrameView, view: AgentView, objects: int, weather: WeatherTruth
) -> Sequence[Any]:
    name = frame.scenario.path.name
    pose = view.world_from_agent
    folder = frame.scenario.format.format_folder(view.agent)
    return (
        *(name, view.agent.id, frame.index, round(frame.time_s, 6)),
        f"{name}/{folder}/{frame.name}",
        *(round(value, 6) for value in (*pose[:3, 3].tolist(), poses.to_yaw_pitch_roll(pose)[0])),
        *(round(view.speed_m_s, 6), objects, weather.id, weather.time),
        *(weather.mor_m, weather.rain_mm_h, weather.snow_mm_h),
    )


def _list_object_values(frame: FrameView, view: AgentView, boxes: Boxes, row: int) -> Sequence[Any]:
    pose = boxes.world_from_box[row]
    numbers = (
        *(*pose[:3, 3].tolist(), poses.to_yaw_pitch_roll(pose)[0], *boxes.sizes[row].tolist()),
        *(float(boxes.speeds_m_s[row]), float(boxes.distances_m[row])),
    )
    return (
        *(frame.scenario.path.name, view.agent.id, frame.index),
        *(int(boxes.ids[row]), str(boxes.classes[row])),
        *(round(value, 6) for value in numbers),
        *(int(boxes.lidar_points[row]), float(boxes.visible_fraction[row])),
        bool(boxes.is_parked[row]),
    )


def _describe(dataset: Dataset, tables: dict[str, FileRecord]) -> dict[str, Any]:
    names = [one.path.name for one in dataset.scenarios]
    return {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.0",
        "name": f"advercity-{names[0]}" if len(names) == 1 else "advercity",
        "description": (
            f"Simulated V2X driving data in adverse weather by {len(names)} scenarios of advercity"
            f" {__version__}: {', '.join(names)}."
        ),
        "license": LICENCE_NOTE,
        "url": "README.md",
        "version": __version__,
        "datePublished": _find_date(dataset),
        "citeAs": f"@software{{advercity, title = {{advercity}}, version = {{{__version__}}}}}",
        "creator": {"@type": "sc:Organization", "name": f"advercity {__version__}"},
        "keywords": ["V2X", "autonomous driving", "adverse weather", "LiDAR", "camera"],
        "isLiveDataset": False,
        "distribution": [
            {
                "@type": "cr:FileObject",
                "@id": path,
                "name": path,
                "contentUrl": path,
                "contentSize": f"{record.size} B",
                "encodingFormat": "text/csv",
                "sha256": record.sha256,
            }
            for path, record in tables.items()
        ],
        "recordSet": [
            {
                "@type": "cr:RecordSet",
                "@id": name,
                "name": name,
                "field": [
                    {
                        "@type": "cr:Field",
                        "@id": f"{name}/{column}",
                        "name": column,
                        "description": text,
                        "dataType": kind,
                        "source": {
                            "fileObject": {"@id": f"{name}.csv"},
                            "extract": {"column": column},
                        },
                    }
                    for column, (kind, text) in columns.items()
                ],
            }
            for name, columns in TABLES.items()
        ],
    }


def _find_date(dataset: Dataset) -> str:
    """Find the day, UTC, on which the last scenario was made, by its manifest."""
    times_s = [(one.path / MANIFEST_FILE).stat().st_mtime for one in dataset.scenarios]
    return datetime.fromtimestamp(max(times_s), UTC).date().isoformat()


def _format_card(dataset: Dataset, counts: dict[str, Counter[str]]) -> str:
    """Format the card, with the front matter read by model hubs."""
    classes = sorted({name for found in counts.values() for name in found})
    scenarios = [
        f"| {one.path.name} | {one.spec.road.id} | {one.spec.density.id} | {len(one)} |"
        f" {' | '.join(str(counts[one.path.name][name]) for name in classes)} |"
        for one in dataset.scenarios
    ]
    weathers = {one.manifest.weather.id: one.manifest.weather for one in dataset.scenarios}
    return "\n".join(
        [
            "---",
            "license: other",
            "license_name: see-licence-below",
            "task_categories: [object-detection, image-segmentation]",
            "tags: [v2x, autonomous-driving, adverse-weather, lidar, simulation]",
            "---",
            "",
            "# V2X driving data in adverse weather",
            "",
            f"Simulated by advercity {__version__}. Every scenario is driven by connected vehicles"
            " and watched by roadside units; `frames.csv` and `objects.csv` list measurements"
            " and truth, `croissant.json` describes both.",
            "",
            "## Scenarios",
            "",
            "Objects are counted once per frame, whichever agents annotate them.",
            "",
            f"| scenario | road | density | frames | {' | '.join(classes)} |",
            f"|---|---|---|---|{'---|' * len(classes)}",
            *scenarios,
            "",
            "## Weather",
            "",
            "| weather | time | visibility (MOR) | rain | snow | wind | sun's elevation |",
            "|---|---|---|---|---|---|---|",
            *map(_format_weather, weathers.values()),
            "",
            "## Recipe",
            "",
            "Each scenario is made again, byte for byte, from the spec in its `manifest.json` by"
            " the versions listed there, on the same kind of device:",
            "",
            *(f"- {_format_recipe(one)}" for one in dataset.scenarios),
            "",
            "## Licence",
            "",
            LICENCE_NOTE,
            "",
            *_list_attributions(dataset),
        ]
    )


def _format_weather(weather: WeatherTruth) -> str:
    visibility = "unlimited" if weather.mor_m is None else f"{weather.mor_m:.0f} m"
    return (
        f"| {weather.id} | {weather.time} | {visibility} | {weather.rain_mm_h:g} mm/h |"
        f" {weather.snow_mm_h:g} mm/h | {weather.wind_m_s:g} m/s |"
        f" {weather.sun_elevation_deg:.1f}° |"
    )


def _format_recipe(scenario: Scenario) -> str:
    identity = scenario.manifest.identity
    versions = ", ".join(f"{name} {version}" for name, version in identity.versions.items())
    backend = identity.renderer.get("backend", "unknown")
    return (
        f"`{scenario.path.name}`: spec {identity.spec_sha256[:12]}, code"
        f" {identity.code_sha256[:12]}, backend {backend}; {versions}"
    )


def _list_attributions(dataset: Dataset) -> Iterator[str]:
    """List the attributions of third-party content in images, each text once."""
    texts = (format_attribution(one.spec, one.manifest.identity) for one in dataset.scenarios)
    for text in dict.fromkeys(filter(None, texts)):
        yield text.replace("# Attribution", "## Attribution", 1)
