"""Tables of a dataset, as the original has them with their definitions put right, and more.

An object counts once per frame, however many viewpoints annotate it, in all tables alike;
connected vehicles are objects, where others annotate them, but not traffic. Vehicles and
pedestrians of a scenario are those that were annotated, not those asked for. Bearings are where the
ego sees an object, not how it is turned.
"""

import csv
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from advercity.dataset.facts import ScenarioFacts
from advercity.errors import RunError
from advercity.geometry.arrays import Float64Array

RANGE_M = 200.0
RANGE_BIN_M = 20.0
POLAR_RANGE_BIN_M = 12.5
POLAR_BIN_DEG = 10.0
ANNOTATION_BIN = 10


@dataclass(frozen=True)
class StatisticsTable:
    """Columns of equal length, under their names, with what they show."""

    name: str
    title: str
    columns: Mapping[str, Sequence[Any]]

    @property
    def rows(self) -> list[tuple[Any, ...]]:
        """Its rows."""
        return list(zip(*self.columns.values(), strict=True))


def compute_tables(facts: Sequence[ScenarioFacts]) -> list[StatisticsTable]:
    """Every table of a dataset."""
    return [
        _tabulate_roads(facts),
        _tabulate_frames_by(facts, "weather", "Frames by weather", _weather_without_time),
        _tabulate_frames_by(
            facts, "time_of_day", "Frames by time of day", lambda item: item.weather.time
        ),
        _tabulate_classes(facts),
        _tabulate_vehicle_speeds(facts),
        _tabulate_ranges(facts),
        _tabulate_ego_speeds(facts),
        _tabulate_annotation_counts(facts),
        _tabulate_polar_density(facts),
        _tabulate_visibility(facts),
        _tabulate_returns_by_range(facts),
        _tabulate_visible_fraction(facts),
    ]


def write_tables(found: Iterable[StatisticsTable], folder: Path) -> None:
    """Write each table as `<name>.csv`; RunError if the folder does not take them."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for table in found:
            with (folder / f"{table.name}.csv").open("w", newline="") as stream:
                writer = csv.writer(stream, lineterminator="\n")
                writer.writerow(table.columns)
                writer.writerows([_format_value(value) for value in row] for row in table.rows)
    except OSError as error:
        raise RunError(
            f"{error.filename or folder}: cannot be written: {error.strerror}"
        ) from error


def _format_value(value: Any) -> Any:
    return f"{value:.3f}".rstrip("0").rstrip(".") if isinstance(value, float) else value


def _tabulate_roads(facts: Sequence[ScenarioFacts]) -> StatisticsTable:
    """The original's `stats.csv`: a line per road, then one of all."""
    roads = sorted({item.road for item in facts})
    groups = [[item for item in facts if item.road == road] for road in roads]
    rows = [
        _summarise_group(name, group)
        for name, group in zip([*roads, "total"], [*groups, facts], strict=True)
    ]
    columns = {key: [row[key] for row in rows] for key in rows[0]}
    return StatisticsTable("stats", "Scenarios by road", columns)


def _summarise_group(name: str, facts: Sequence[ScenarioFacts]) -> dict[str, Any]:
    frames = np.array([item.num_frames for item in facts])
    vehicles = np.array([_count_distinct_actors(item, on_foot=False) for item in facts])
    pedestrians = np.array([_count_distinct_actors(item, on_foot=True) for item in facts])
    traffic = np.concatenate([_traffic_speeds(item) for item in facts])
    connected = np.concatenate([item.speeds_km_h.ravel() for item in facts])
    annotations = np.concatenate([item.num_annotations for item in facts])
    return {
        "road": name,
        "scenarios": len(facts),
        **_summarise_counts("frames", frames),
        **_summarise_counts("vehicles", vehicles),
        **_summarise_counts("pedestrians", pedestrians),
        "annotations": int(annotations.sum()),
        "annotations_per_frame": float(annotations.mean()),
        "traffic_speed_km_h_mean": _mean(traffic),
        "traffic_speed_km_h_std": _std(traffic),
        "cav_speed_km_h_mean": _mean(connected),
        "cav_speed_km_h_std": _std(connected),
    }


def _summarise_counts(name: str, values: NDArray[np.integer]) -> dict[str, Any]:
    return {
        f"{name}_mean": float(values.mean()),
        f"{name}_std": float(values.std()),
        name: int(values.sum()),
    }


def _mean(values: Float64Array) -> float:
    return float(values.mean()) if len(values) else float("nan")


def _std(values: Float64Array) -> float:
    return float(values.std()) if len(values) else float("nan")


def _count_distinct_actors(facts: ScenarioFacts, *, on_foot: bool) -> int:
    chosen = (facts.objects["class"] == "pedestrian") == on_foot
    return len(np.unique(facts.objects["id"][chosen]))


def _traffic_speeds(facts: ScenarioFacts) -> Float64Array:
    objects = facts.objects
    return objects["speed_km_h"][(objects["class"] != "pedestrian") & ~objects["connected"]]


def _tabulate_frames_by(
    facts: Sequence[ScenarioFacts], name: str, title: str, key: Callable[[ScenarioFacts], str]
) -> StatisticsTable:
    counts: dict[str, int] = {}
    for item in facts:
        counts[key(item)] = counts.get(key(item), 0) + item.num_frames
    ordered = dict(sorted(counts.items(), key=lambda entry: (-entry[1], entry[0])))
    return StatisticsTable(name, title, {name: list(ordered), "frames": list(ordered.values())})


def _weather_without_time(facts: ScenarioFacts) -> str:
    """The weather without its time of day."""
    return facts.weather.id.removesuffix(f"_{facts.weather.time}")


def _tabulate_classes(facts: Sequence[ScenarioFacts]) -> StatisticsTable:
    classes, counts = np.unique(_concatenate_column(facts, "class"), return_counts=True)
    order = np.argsort(-counts, kind="stable")
    columns = {"class": classes[order].tolist(), "annotations": counts[order].tolist()}
    return StatisticsTable("class_histogram", "Annotated objects by class, once per frame", columns)


def _tabulate_vehicle_speeds(facts: Sequence[ScenarioFacts]) -> StatisticsTable:
    speeds = np.concatenate([_traffic_speeds(item) for item in facts])
    columns = _count_by_integer(speeds, "speed_km_h", "vehicles")
    return StatisticsTable(
        "vehicles_per_speed", "Traffic by speed, vehicles of all frames", columns
    )


def _tabulate_ego_speeds(facts: Sequence[ScenarioFacts]) -> StatisticsTable:
    speeds = np.concatenate([item.speeds_km_h[:, 0] for item in facts])
    columns = _count_by_integer(speeds, "speed_km_h", "frames")
    return StatisticsTable("num_frames_per_ego_speed", "Frames by the ego's speed", columns)


def _count_by_integer(values: Float64Array, name: str, counted: str) -> dict[str, Sequence[Any]]:
    """Counts of values by the nearest whole number, from 0."""
    counts = np.bincount(np.rint(values).astype(np.int64)) if len(values) else np.zeros(1, np.int64)
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
    """Mean number per frame, so that densities of unequal share can be compared."""
    edges = np.arange(0.0, RANGE_M + RANGE_BIN_M, RANGE_BIN_M)
    columns: dict[str, Sequence[Any]] = {"distance_m_from": edges[:-1].tolist()}
    for density in sorted({item.density for item in facts}):
        chosen = [item for item in facts if item.density == density]
        counts, _ = np.histogram(_concatenate_column(chosen, "ego_distance_m"), edges)
        columns[density] = (counts / sum(item.num_frames for item in chosen)).tolist()
    title = "Objects in the ego's line of sight by distance, mean per frame"
    return StatisticsTable("density_by_range_to_ego", title, columns)


def _tabulate_polar_density(facts: Sequence[ScenarioFacts]) -> StatisticsTable:
    bearings = np.arange(-180.0, 180.0 + POLAR_BIN_DEG, POLAR_BIN_DEG)
    ranges = np.arange(0.0, RANGE_M + POLAR_RANGE_BIN_M, POLAR_RANGE_BIN_M)
    seen = np.degrees(_concatenate_column(facts, "ego_bearing_rad"))
    counts, _, _ = np.histogram2d(
        seen, _concatenate_column(facts, "ego_distance_m"), [bearings, ranges]
    )
    bearing, distance = np.meshgrid(bearings[:-1], ranges[:-1], indexing="ij")
    columns = {
        "bearing_deg_from": bearing.ravel().tolist(),
        "distance_m_from": distance.ravel().tolist(),
        "objects": counts.astype(np.int64).ravel().tolist(),
    }
    return StatisticsTable("polar_density_map", "Where the ego sees objects", columns)


def _tabulate_visibility(facts: Sequence[ScenarioFacts]) -> StatisticsTable:
    """`echoing_share` is that of the ego's annotated objects which return it at least one point."""
    rows: list[tuple[Any, ...]] = []
    for weather, group in _by_weather(facts):
        _, points = _hits_and_points(group)
        rows.append(
            (
                weather,
                group[0].weather.mor_m if group[0].weather.mor_m is not None else float("inf"),
                group[0].weather.rain_mm_h,
                sum(item.num_frames for item in group),
                float(np.concatenate([item.num_annotations for item in group]).mean()),
                _mean((points > 0).astype(np.float64)),
            )
        )
    names = ("weather", "mor_m", "rain_mm_h", "frames", "annotations_per_frame", "echoing_share")
    rows.sort(key=lambda row: row[1])
    columns = {name: [row[k] for row in rows] for k, name in enumerate(names)}
    return StatisticsTable("visibility_by_weather", "Visibility by weather", columns)


def _tabulate_returns_by_range(facts: Sequence[ScenarioFacts]) -> StatisticsTable:
    """Of the rays that would meet an object in no weather, how many come back in this one."""
    edges = np.arange(0.0, RANGE_M + RANGE_BIN_M, RANGE_BIN_M)
    columns: dict[str, Sequence[Any]] = {"distance_m_from": edges[:-1].tolist()}
    for weather, group in _by_weather(facts):
        hits, points = _hits_and_points(group)
        distance = _concatenate_column(group, "ego_distance_m")[_has_point_counts(group)]
        with np.errstate(invalid="ignore"):
            sums = [np.histogram(distance, edges, weights=values)[0] for values in (points, hits)]
            columns[weather] = (sums[0] / sums[1]).tolist()
    title = "Rays on objects that come back to the ego, by distance"
    return StatisticsTable("echoes_by_range", title, columns)


def _tabulate_visible_fraction(facts: Sequence[ScenarioFacts]) -> StatisticsTable:
    edges = np.linspace(0.0, 1.0, 11)
    shown = _concatenate_column(facts, "visible_fraction")
    counts, _ = np.histogram(shown[np.isfinite(shown)], edges)
    columns = {
        "visible_fraction_from": edges[:-1].round(1).tolist(),
        "annotations": counts.tolist(),
    }
    title = "Annotated objects by the most that any camera shows of them"
    return StatisticsTable("visible_fraction", title, columns)


def _by_weather(facts: Sequence[ScenarioFacts]) -> list[tuple[str, list[ScenarioFacts]]]:
    names = sorted({item.weather.id for item in facts})
    return [(name, [item for item in facts if item.weather.id == name]) for name in names]


def _has_point_counts(facts: Sequence[ScenarioFacts]) -> NDArray[np.bool_]:
    return np.isfinite(_concatenate_column(facts, "ego_points"))


def _hits_and_points(facts: Sequence[ScenarioFacts]) -> tuple[Float64Array, Float64Array]:
    told = _has_point_counts(facts)
    return _concatenate_column(facts, "ego_hits")[told], _concatenate_column(facts, "ego_points")[
        told
    ]


def _concatenate_column(facts: Sequence[ScenarioFacts], name: str) -> NDArray[Any]:
    return np.concatenate([item.objects[name] for item in facts])
