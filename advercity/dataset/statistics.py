"""Tabulate statistics of a dataset: Adver-City's with corrected definitions, and more.

An object counts once per frame in all tables, however many agents annotate it. Connected vehicles
count as objects if others annotate them, but not as traffic. Vehicles and pedestrians of a scenario
are the annotated ones, not those asked for; a lorry counts as tractor unit and as semi-trailer.
Parked cars have a column and classes of their own, and are in no other table. Bearings are
directions from the ego to an object, not headings of the object.
"""

import csv
import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from advercity.dataset.facts import ScenarioFacts
from advercity.dataset.weather_truth import WeatherTruth
from advercity.errors import RunError, describe_cause
from advercity.geometry.arrays import Float64Array
from advercity.output_files import open_output_folder
from advercity.sensors.messages import LossReason
from advercity.sensors.point_kinds import list_point_kinds

RANGE_M = 200.0
RANGE_BIN_M = 20.0
POLAR_RANGE_BIN_M = 12.5
POLAR_BIN_DEG = 10.0
ANNOTATION_BIN = 10
RANGE_EDGES_M = np.arange(0.0, RANGE_M + RANGE_BIN_M, RANGE_BIN_M)
POLAR_RANGE_EDGES_M = np.arange(0.0, RANGE_M + POLAR_RANGE_BIN_M, POLAR_RANGE_BIN_M)
POLAR_EDGES_DEG = np.arange(-180.0, 180.0 + POLAR_BIN_DEG, POLAR_BIN_DEG)
FRACTION_EDGES = np.linspace(0.0, 1.0, 11)


@dataclass(frozen=True)
class StatisticsTable:
    """A table with a file name, a title and columns of equal length by name."""

    name: str
    title: str
    columns: Mapping[str, Sequence[Any]]

    @property
    def rows(self) -> list[tuple[Any, ...]]:
        """Rows of the table."""
        return list(zip(*self.columns.values(), strict=True))


def compute_tables(facts: Sequence[ScenarioFacts]) -> list[StatisticsTable]:
    """Compute every table of a dataset; tables about weather need scenarios with a weather."""
    traffic = np.concatenate([_traffic_speeds(item) for item in facts])
    ego = np.concatenate([item.speeds_km_h[:, :1].ravel() for item in facts])
    return [
        _tabulate_roads(facts),
        _tabulate_classes(facts),
        StatisticsTable(
            "vehicles_per_speed",
            "Traffic by speed, vehicles of all frames",
            _count_by_integer(traffic, "speed_km_h", "vehicles"),
        ),
        _tabulate_ranges(facts),
        StatisticsTable(
            "num_frames_per_ego_speed",
            "Frames by the ego's speed",
            _count_by_integer(ego, "speed_km_h", "frames"),
        ),
        _tabulate_annotation_counts(facts),
        _tabulate_polar_density(facts),
        *(_tabulate_weathers(facts) if any(item.weathers for item in facts) else ()),
        *(_tabulate_radars(facts) if any(item.radars for item in facts) else ()),
        *(_tabulate_messages(facts) if any(len(item.messages) for item in facts) else ()),
    ]


def _tabulate_weathers(facts: Sequence[ScenarioFacts]) -> list[StatisticsTable]:
    """Tabulate frames by weather and time of day, and the weather's effects on sensors."""
    return [
        _tabulate_frames_by(facts, "weather", "Frames by weather", _weather_without_time),
        _tabulate_frames_by(facts, "time_of_day", "Frames by time of day", attrgetter("time")),
        _tabulate_visibility(facts),
        _tabulate_returns_by_range(facts),
        _tabulate_visible_fraction(facts),
    ]


def write_tables(tables: Iterable[StatisticsTable], folder: Path) -> None:
    """Write each table as `<name>.csv`, all or none.

    Raises:
        InputError: A file of that name exists and may not be replaced.
        RunError: The folder is full or not writable.
    """
    try:
        with open_output_folder(folder) as made:
            save_tables(tables, made)
    except OSError as error:
        raise RunError(f"{folder}: cannot be written: {describe_cause(error)}") from error


def save_tables(tables: Iterable[StatisticsTable], folder: Path) -> None:
    """Save each table as `<name>.csv` in the staging folder of an output."""
    for table in tables:
        with (folder / f"{table.name}.csv").open("w", newline="") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(table.columns)
            writer.writerows([_format_value(value) for value in row] for row in table.rows)


def _format_value(value: Any) -> Any:
    return f"{value:.3f}".rstrip("0").rstrip(".") if isinstance(value, float) else value


def _group_by(
    facts: Sequence[ScenarioFacts], key: Callable[[ScenarioFacts], str]
) -> dict[str, list[ScenarioFacts]]:
    """Group scenarios by a key, sorted by it."""
    groups: dict[str, list[ScenarioFacts]] = {name: [] for name in sorted(set(map(key, facts)))}
    for item in facts:
        groups[key(item)].append(item)
    return groups


def _by_weather(facts: Sequence[ScenarioFacts]) -> dict[str, list[ScenarioFacts]]:
    return _group_by(facts, lambda item: item.weather)


def _weather_without_time(weather: WeatherTruth) -> str:
    return weather.id.removesuffix("_day").removesuffix("_night")


def _to_columns(rows: Sequence[Mapping[str, Any]]) -> dict[str, list[Any]]:
    return {name: [row[name] for row in rows] for name in rows[0]}


def _concatenate_column(facts: Sequence[ScenarioFacts], name: str) -> NDArray[Any]:
    return np.concatenate([item.objects[name] for item in facts])


def _tabulate_roads(facts: Sequence[ScenarioFacts]) -> StatisticsTable:
    """Tabulate the original's `stats.csv`: a line per road, then the total."""
    groups = {**_group_by(facts, lambda item: item.road), "total": facts}
    rows = [_summarise_group(name, group) for name, group in groups.items()]
    return StatisticsTable("stats", "Scenarios by road", _to_columns(rows))


def _summarise_group(name: str, facts: Sequence[ScenarioFacts]) -> dict[str, Any]:
    traffic = np.concatenate([_traffic_speeds(item) for item in facts])
    connected = np.concatenate([item.speeds_km_h.ravel() for item in facts])
    annotations = np.concatenate([item.num_annotations for item in facts])
    return {
        "road": name,
        "scenarios": len(facts),
        **_summarise_counts("frames", [item.num_frames for item in facts]),
        **_summarise_counts(
            "vehicles", [_count_distinct_actors(item, on_foot=False) for item in facts]
        ),
        **_summarise_counts("parked_cars", [len(np.unique(item.parked["id"])) for item in facts]),
        **_summarise_counts(
            "pedestrians", [_count_distinct_actors(item, on_foot=True) for item in facts]
        ),
        "annotations": int(annotations.sum()),
        "annotations_per_frame": float(annotations.mean()),
        "traffic_speed_km_h_mean": _mean(traffic),
        "traffic_speed_km_h_std": _std(traffic),
        "cav_speed_km_h_mean": _mean(connected),
        "cav_speed_km_h_std": _std(connected),
    }


def _summarise_counts(name: str, counts: Sequence[int]) -> dict[str, Any]:
    """Summarise counts; the deviation is the population's, as all of them are known."""
    return {
        f"{name}_mean": float(np.mean(counts)),
        f"{name}_std": float(np.std(counts)),
        name: sum(counts),
    }


def _mean(values: Float64Array) -> float:
    return float(np.nanmean(values)) if np.isfinite(values).any() else float("nan")


def _mean_if_different(values: Sequence[float]) -> float:
    """Compute a mean; of equal values, exactly their value."""
    return values[0] if len(set(values)) == 1 else sum(values) / len(values)


def _std(values: Float64Array) -> float:
    return float(np.nanstd(values)) if np.isfinite(values).any() else float("nan")


def _count_distinct_actors(facts: ScenarioFacts, *, on_foot: bool) -> int:
    of_kind = (facts.objects["class"] == "pedestrian") == on_foot
    return len(np.unique(facts.objects["id"][of_kind]))


def _traffic_speeds(facts: ScenarioFacts) -> Float64Array:
    objects = facts.objects
    return objects["speed_km_h"][(objects["class"] != "pedestrian") & ~objects["connected"]]


def _tabulate_frames_by(
    facts: Sequence[ScenarioFacts], name: str, title: str, key: Callable[[WeatherTruth], str]
) -> StatisticsTable:
    counts = Counter(key(weather) for item in facts for weather in item.weathers)
    # Equal counts are sorted by name.
    ordered = sorted(counts, key=lambda group: (-counts[group], group))
    columns = {name: ordered, "frames": [counts[group] for group in ordered]}
    return StatisticsTable(name, title, columns)


def _tabulate_classes(facts: Sequence[ScenarioFacts]) -> StatisticsTable:
    parked = [f"parked {name}" for item in facts for name in item.parked["class"].tolist()]
    names = [*_concatenate_column(facts, "class").tolist(), *parked]
    classes, counts = np.unique(np.array(names, dtype=np.str_), return_counts=True)
    order = np.argsort(-counts, kind="stable")
    columns = {"class": classes[order].tolist(), "annotations": counts[order].tolist()}
    return StatisticsTable("class_histogram", "Annotated objects by class, once per frame", columns)


def _count_by_integer(values: Float64Array, name: str, counted: str) -> dict[str, Sequence[Any]]:
    """Count values by the nearest whole number, from 0; NaN (unknown) does not count."""
    whole = np.rint(values[np.isfinite(values)]).astype(np.int64)
    counts = np.bincount(whole, minlength=1)
    return {name: list(range(len(counts))), counted: counts.tolist()}


def _tabulate_annotation_counts(facts: Sequence[ScenarioFacts]) -> StatisticsTable:
    counts = np.bincount(np.concatenate([item.num_annotations for item in facts]) // ANNOTATION_BIN)
    columns = {
        "annotations_from": [ANNOTATION_BIN * k for k in range(len(counts))],
        "frames": counts.tolist(),
    }
    return StatisticsTable(
        "num_keyframes_per_num_annotations", "Frames by annotated objects", columns
    )


def _tabulate_ranges(facts: Sequence[ScenarioFacts]) -> StatisticsTable:
    """Tabulate means per frame, to compare densities with different numbers of frames."""
    columns: dict[str, Sequence[Any]] = {"distance_m_from": RANGE_EDGES_M[:-1].tolist()}
    for density, group in _group_by(facts, lambda item: item.density).items():
        counts, _ = np.histogram(_concatenate_column(group, "ego_distance_m"), RANGE_EDGES_M)
        columns[density] = (counts / sum(item.num_frames for item in group)).tolist()
    title = "Objects in the ego's line of sight by distance, mean per frame"
    return StatisticsTable("density_by_range_to_ego", title, columns)


def _tabulate_polar_density(facts: Sequence[ScenarioFacts]) -> StatisticsTable:
    counts, _, _ = np.histogram2d(
        np.degrees(_concatenate_column(facts, "ego_bearing_rad")),
        _concatenate_column(facts, "ego_distance_m"),
        [POLAR_EDGES_DEG, POLAR_RANGE_EDGES_M],
    )
    bearing, distance = np.meshgrid(POLAR_EDGES_DEG[:-1], POLAR_RANGE_EDGES_M[:-1], indexing="ij")
    columns = {
        "bearing_deg_from": bearing.ravel().tolist(),
        "distance_m_from": distance.ravel().tolist(),
        "objects": counts.astype(np.int64).ravel().tolist(),
    }
    return StatisticsTable("polar_density_map", "Where the ego sees objects", columns)


def _tabulate_visibility(facts: Sequence[ScenarioFacts]) -> StatisticsTable:
    """Tabulate weathers; `echoing_share` is the fraction of the ego's objects with points.

    The visibility is from the mean extinction of all frames, which differ in a changing weather.
    """
    rows: list[dict[str, Any]] = []
    for weather, group in _by_weather(facts).items():
        _, _, points = _select_counted(group)
        weathers = [weather for item in group for weather in item.weathers]
        clearness = _mean_if_different([1.0 / (item.mor_m or math.inf) for item in weathers])
        rows.append(
            {
                "weather": weather,
                "mor_m": 1.0 / clearness if clearness else math.inf,
                "rain_mm_h": _mean_if_different([item.rain_mm_h for item in weathers]),
                "frames": sum(item.num_frames for item in group),
                "annotations_per_frame": float(
                    np.concatenate([item.num_annotations for item in group]).mean()
                ),
                "echoing_share": _mean((points > 0).astype(np.float64)),
            }
        )
    rows.sort(key=lambda row: row["mor_m"])
    return StatisticsTable("visibility_by_weather", "Visibility by weather", _to_columns(rows))


def _tabulate_returns_by_range(facts: Sequence[ScenarioFacts]) -> StatisticsTable:
    """Tabulate the points per beam on objects in each weather; dual returns may give two."""
    columns: dict[str, Sequence[Any]] = {"distance_m_from": RANGE_EDGES_M[:-1].tolist()}
    for weather, group in _by_weather(facts).items():
        distance, hits, points = _select_counted(group)
        returned, hit = (
            np.histogram(distance, RANGE_EDGES_M, weights=values)[0] for values in (points, hits)
        )
        with np.errstate(invalid="ignore"):  # 0 / 0 without objects: NaN
            columns[weather] = (returned / hit).tolist()
    title = "LiDAR points of the ego per beam on objects, by distance"
    return StatisticsTable("echoes_by_range", title, columns)


def _select_counted(
    facts: Sequence[ScenarioFacts],
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Select distances, hits and points (n,) of the objects annotated by the ego."""
    names = ("ego_distance_m", "ego_hits", "ego_points")
    distance, hits, points = (_concatenate_column(facts, name) for name in names)
    counted = np.isfinite(points)
    return distance[counted], hits[counted], points[counted]


def _tabulate_radars(facts: Sequence[ScenarioFacts]) -> list[StatisticsTable]:
    """Tabulate a scan's detections by kind, and the fraction of objects the ego detects."""
    kinds: list[dict[str, Any]] = []
    fractions: dict[str, Sequence[Any]] = {"distance_m_from": RANGE_EDGES_M[:-1].tolist()}
    for weather, group in _by_weather([item for item in facts if item.radars]).items():
        scans = sum(item.num_frames * item.radars for item in group)
        total = np.concatenate([item.radar_detections for item in group]).sum(axis=0)
        means = {name: float(total[kind] / scans) for kind, name in list_point_kinds().items()}
        kinds.append({"weather": weather, **means})
        distance, detections = (
            _concatenate_column(group, name) for name in ("ego_distance_m", "ego_detections")
        )
        fractions[weather] = _compute_fractions(distance, detections > 0, ~np.isnan(detections))
    return [
        StatisticsTable("radar_by_kind", "Detections of a radar per scan", _to_columns(kinds)),
        StatisticsTable(
            "radar_detected_by_range",
            "Fraction of the ego's objects that its radars detect, by distance",
            fractions,
        ),
    ]


def _tabulate_messages(facts: Sequence[ScenarioFacts]) -> list[StatisticsTable]:
    """Tabulate the fate of messages at their receivers, by weather and kind, and by distance."""
    rows: list[dict[str, Any]] = []
    fractions: dict[str, Sequence[Any]] = {"distance_m_from": RANGE_EDGES_M[:-1].tolist()}
    for weather, group in _by_weather([item for item in facts if len(item.messages)]).items():
        messages = np.concatenate([item.messages for item in group])
        ages = np.concatenate([item.message_ages for item in group])
        rows += [
            {
                "weather": weather,
                "kind": kind,
                **_summarise_messages(messages[messages["kind"] == kind]),
                "ego_age_s_mean": _mean(ages["age_s"][ages["kind"] == kind]),
            }
            for kind in np.unique(messages["kind"]).tolist()
        ]
        is_all = np.ones(len(messages), np.bool_)
        arrived = messages["lost"] == ""
        fractions[weather] = _compute_fractions(messages["distance_m"], arrived, is_all)
    return [
        StatisticsTable("messages", "Messages at their receivers", _to_columns(rows)),
        StatisticsTable(
            "messages_by_range", "Fraction of messages that arrive, by distance", fractions
        ),
    ]


def _summarise_messages(messages: NDArray[np.void]) -> dict[str, Any]:
    """Summarise messages (n,) of one kind: fractions lost by reason, delays, errors of poses."""
    lost, delays_s = messages["lost"], messages["delay_s"][messages["lost"] == ""]
    squared_m2, squared_rad2 = (
        float(np.mean(messages[name] ** 2)) for name in ("position_error_m", "heading_error_rad")
    )
    return {
        "messages": len(messages),
        "received": float(np.mean(lost == "")),
        **{f"lost_{reason.value}": float(np.mean(lost == reason.value)) for reason in LossReason},
        "delay_s_mean": _mean(delays_s),
        "delay_s_95_percent": float(np.quantile(delays_s, 0.95)) if len(delays_s) else math.nan,
        "position_error_m_rms": math.sqrt(squared_m2),
        "heading_error_deg_rms": math.degrees(math.sqrt(squared_rad2)),
    }


def _compute_fractions(
    distance_m: Float64Array, found: NDArray[np.bool_], counted: NDArray[np.bool_]
) -> list[float]:
    """Compute the found fraction of the counted rows by range; NaN without any."""
    some, all_ = (
        np.histogram(distance_m[rows], RANGE_EDGES_M)[0] for rows in (found & counted, counted)
    )
    with np.errstate(invalid="ignore"):
        return (some / all_).tolist()


def _tabulate_visible_fraction(facts: Sequence[ScenarioFacts]) -> StatisticsTable:
    fractions = _concatenate_column(facts, "visible_fraction")
    counts, _ = np.histogram(fractions[np.isfinite(fractions)], FRACTION_EDGES)
    columns = {
        "visible_fraction_from": FRACTION_EDGES[:-1].round(1).tolist(),
        "annotations": counts.tolist(),
    }
    title = "Annotated objects by the most that any camera shows of them"
    return StatisticsTable("visible_fraction", title, columns)
