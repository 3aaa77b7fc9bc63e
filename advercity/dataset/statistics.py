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

from advercity.dataset.facts import Facts
from advercity.errors import RunError

RANGE_M = 200.0
RANGE_BIN_M = 20.0
POLAR_RANGE_BIN_M = 12.5
POLAR_BIN_DEG = 10.0
ANNOTATION_BIN = 10
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Table:
    """Columns of equal length, under their names, with what they show."""

    name: str
    title: str
    columns: Mapping[str, Sequence[Any]]

    @property
    def rows(self) -> list[tuple[Any, ...]]:
        """Its rows."""
        return list(zip(*self.columns.values(), strict=True))


def tables(facts: Sequence[Facts]) -> list[Table]:
    """Every table of a dataset."""
    return [
        _roads(facts),
        _shares(facts, "weather", "Frames by weather", _condition),
        _shares(facts, "time_of_day", "Frames by time of day", lambda item: item.weather.time),
        _classes(facts),
        _vehicle_speeds(facts),
        _ranges(facts),
        _ego_speeds(facts),
        _annotations(facts),
        _polar(facts),
        _visibility(facts),
        _echoes(facts),
        _visible(facts),
    ]


def write_tables(found: Iterable[Table], folder: Path) -> None:
    """Write each table as `<name>.csv`; RunError if the folder does not take them."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for table in found:
            with (folder / f"{table.name}.csv").open("w", newline="") as stream:
                writer = csv.writer(stream, lineterminator="\n")
                writer.writerow(table.columns)
                writer.writerows([_rounded(value) for value in row] for row in table.rows)
    except OSError as error:
        raise RunError(
            f"{error.filename or folder}: cannot be written: {error.strerror}"
        ) from error


def _rounded(value: Any) -> Any:
    return f"{value:.3f}".rstrip("0").rstrip(".") if isinstance(value, float) else value


def _roads(facts: Sequence[Facts]) -> Table:
    """The original's `stats.csv`: a line per road, then one of all."""
    roads = sorted({item.road for item in facts})
    groups = [[item for item in facts if item.road == road] for road in roads]
    rows = [
        _summary(name, group)
        for name, group in zip([*roads, "total"], [*groups, facts], strict=True)
    ]
    columns = {key: [row[key] for row in rows] for key in rows[0]}
    return Table("stats", "Scenarios by road", columns)


def _summary(name: str, facts: Sequence[Facts]) -> dict[str, Any]:
    frames = np.array([item.frames for item in facts])
    vehicles = np.array([_distinct(item, on_foot=False) for item in facts])
    pedestrians = np.array([_distinct(item, on_foot=True) for item in facts])
    traffic = np.concatenate([_traffic_speeds(item) for item in facts])
    connected = np.concatenate([item.speeds_km_h.ravel() for item in facts])
    annotations = np.concatenate([item.annotations for item in facts])
    return {
        "road": name,
        "scenarios": len(facts),
        **_spread("frames", frames),
        **_spread("vehicles", vehicles),
        **_spread("pedestrians", pedestrians),
        "annotations": int(annotations.sum()),
        "annotations_per_frame": float(annotations.mean()),
        "traffic_speed_km_h_mean": _mean(traffic),
        "traffic_speed_km_h_std": _std(traffic),
        "cav_speed_km_h_mean": _mean(connected),
        "cav_speed_km_h_std": _std(connected),
    }


def _spread(name: str, values: NDArray[np.integer]) -> dict[str, Any]:
    return {
        f"{name}_mean": float(values.mean()),
        f"{name}_std": float(values.std()),
        name: int(values.sum()),
    }


def _mean(values: Floats) -> float:
    return float(values.mean()) if len(values) else float("nan")


def _std(values: Floats) -> float:
    return float(values.std()) if len(values) else float("nan")


def _distinct(facts: Facts, *, on_foot: bool) -> int:
    chosen = (facts.objects["class"] == "pedestrian") == on_foot
    return len(np.unique(facts.objects["id"][chosen]))


def _traffic_speeds(facts: Facts) -> Floats:
    objects = facts.objects
    return objects["speed_km_h"][(objects["class"] != "pedestrian") & ~objects["connected"]]


def _shares(facts: Sequence[Facts], name: str, title: str, key: Callable[[Facts], str]) -> Table:
    counts: dict[str, int] = {}
    for item in facts:
        counts[key(item)] = counts.get(key(item), 0) + item.frames
    ordered = dict(sorted(counts.items(), key=lambda entry: (-entry[1], entry[0])))
    return Table(name, title, {name: list(ordered), "frames": list(ordered.values())})


def _condition(facts: Facts) -> str:
    """The weather without its time of day."""
    return facts.weather.id.removesuffix(f"_{facts.weather.time}")


def _classes(facts: Sequence[Facts]) -> Table:
    classes, counts = np.unique(_column(facts, "class"), return_counts=True)
    order = np.argsort(-counts, kind="stable")
    columns = {"class": classes[order].tolist(), "annotations": counts[order].tolist()}
    return Table("class_histogram", "Annotated objects by class, once per frame", columns)


def _vehicle_speeds(facts: Sequence[Facts]) -> Table:
    speeds = np.concatenate([_traffic_speeds(item) for item in facts])
    columns = _by_whole_number(speeds, "speed_km_h", "vehicles")
    return Table("vehicles_per_speed", "Traffic by speed, vehicles of all frames", columns)


def _ego_speeds(facts: Sequence[Facts]) -> Table:
    speeds = np.concatenate([item.speeds_km_h[:, 0] for item in facts])
    columns = _by_whole_number(speeds, "speed_km_h", "frames")
    return Table("num_frames_per_ego_speed", "Frames by the ego's speed", columns)


def _by_whole_number(values: Floats, name: str, counted: str) -> dict[str, Sequence[Any]]:
    """Counts of values by the nearest whole number, from 0."""
    counts = np.bincount(np.rint(values).astype(np.int64)) if len(values) else np.zeros(1, np.int64)
    return {name: list(range(len(counts))), counted: counts.tolist()}


def _annotations(facts: Sequence[Facts]) -> Table:
    counts = np.bincount(np.concatenate([item.annotations for item in facts]) // ANNOTATION_BIN)
    columns = {
        "annotations_from": [ANNOTATION_BIN * k for k in range(len(counts))],
        "frames": counts.tolist(),
    }
    return Table("num_keyframes_per_num_annotations", "Frames by annotated objects", columns)


def _ranges(facts: Sequence[Facts]) -> Table:
    """Mean number per frame, so that densities of unequal share can be compared."""
    edges = np.arange(0.0, RANGE_M + RANGE_BIN_M, RANGE_BIN_M)
    columns: dict[str, Sequence[Any]] = {"distance_m_from": edges[:-1].tolist()}
    for density in sorted({item.density for item in facts}):
        chosen = [item for item in facts if item.density == density]
        counts, _ = np.histogram(_column(chosen, "ego_distance_m"), edges)
        columns[density] = (counts / sum(item.frames for item in chosen)).tolist()
    title = "Objects in the ego's line of sight by distance, mean per frame"
    return Table("density_by_range_to_ego", title, columns)


def _polar(facts: Sequence[Facts]) -> Table:
    bearings = np.arange(-180.0, 180.0 + POLAR_BIN_DEG, POLAR_BIN_DEG)
    ranges = np.arange(0.0, RANGE_M + POLAR_RANGE_BIN_M, POLAR_RANGE_BIN_M)
    seen = np.degrees(_column(facts, "ego_bearing_rad"))
    counts, _, _ = np.histogram2d(seen, _column(facts, "ego_distance_m"), [bearings, ranges])
    bearing, distance = np.meshgrid(bearings[:-1], ranges[:-1], indexing="ij")
    columns = {
        "bearing_deg_from": bearing.ravel().tolist(),
        "distance_m_from": distance.ravel().tolist(),
        "objects": counts.astype(np.int64).ravel().tolist(),
    }
    return Table("polar_density_map", "Where the ego sees objects", columns)


def _visibility(facts: Sequence[Facts]) -> Table:
    """`echoing_share` is that of the ego's annotated objects which return it at least one point."""
    rows: list[tuple[Any, ...]] = []
    for weather, group in _by_weather(facts):
        _, points = _echo_counts(group)
        rows.append(
            (
                weather,
                group[0].weather.mor_m if group[0].weather.mor_m is not None else float("inf"),
                group[0].weather.rain_mm_h,
                sum(item.frames for item in group),
                float(np.concatenate([item.annotations for item in group]).mean()),
                _mean((points > 0).astype(np.float64)),
            )
        )
    names = ("weather", "mor_m", "rain_mm_h", "frames", "annotations_per_frame", "echoing_share")
    rows.sort(key=lambda row: row[1])
    columns = {name: [row[k] for row in rows] for k, name in enumerate(names)}
    return Table("visibility_by_weather", "Visibility by weather", columns)


def _echoes(facts: Sequence[Facts]) -> Table:
    """Of the rays that would meet an object in no weather, how many come back in this one."""
    edges = np.arange(0.0, RANGE_M + RANGE_BIN_M, RANGE_BIN_M)
    columns: dict[str, Sequence[Any]] = {"distance_m_from": edges[:-1].tolist()}
    for weather, group in _by_weather(facts):
        hits, points = _echo_counts(group)
        distance = _column(group, "ego_distance_m")[_is_told(group)]
        with np.errstate(invalid="ignore"):
            sums = [np.histogram(distance, edges, weights=values)[0] for values in (points, hits)]
            columns[weather] = (sums[0] / sums[1]).tolist()
    title = "Rays on objects that come back to the ego, by distance"
    return Table("echoes_by_range", title, columns)


def _visible(facts: Sequence[Facts]) -> Table:
    edges = np.linspace(0.0, 1.0, 11)
    shown = _column(facts, "visible_fraction")
    counts, _ = np.histogram(shown[np.isfinite(shown)], edges)
    columns = {
        "visible_fraction_from": edges[:-1].round(1).tolist(),
        "annotations": counts.tolist(),
    }
    title = "Annotated objects by the most that any camera shows of them"
    return Table("visible_fraction", title, columns)


def _by_weather(facts: Sequence[Facts]) -> list[tuple[str, list[Facts]]]:
    names = sorted({item.weather.id for item in facts})
    return [(name, [item for item in facts if item.weather.id == name]) for name in names]


def _is_told(facts: Sequence[Facts]) -> NDArray[np.bool_]:
    return np.isfinite(_column(facts, "ego_points"))


def _echo_counts(facts: Sequence[Facts]) -> tuple[Floats, Floats]:
    told = _is_told(facts)
    return _column(facts, "ego_hits")[told], _column(facts, "ego_points")[told]


def _column(facts: Sequence[Facts], name: str) -> NDArray[Any]:
    return np.concatenate([item.objects[name] for item in facts])
