"""Degradation curves: ranges of sensors and precision of detectors over a swept number."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from advercity.dataset.facts import ScenarioFacts, collect_scenario_facts
from advercity.dataset.reader import Dataset, Scenario, format_swept_value
from advercity.dataset.scenario_folders import no_frames_error
from advercity.dataset.statistics import StatisticsTable
from advercity.dataset.statistics_plots import make_figure
from advercity.errors import InputError
from advercity.geometry.arrays import Float64Array
from advercity_benchmark.evaluation import (
    EvaluationOptions,
    evaluate_predictions,
)
from advercity_benchmark.truth import VEHICLES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BIN_M = 10.0
FARTHEST_M = 150.0
MIN_POINTS = 5
RADAR_BEARING_RAD = np.deg2rad(45.0)
"""Evaluated angle to either side of a radar in the bumper."""
LOGARITHMIC_RATIO = 20.0
"""Ratio of the highest swept value to the lowest from which the axis is logarithmic."""


def tabulate_degradation(
    dataset: Path, predictions: Sequence[Path] = (), options: EvaluationOptions | None = None
) -> StatisticsTable:
    """Tabulate ranges of the ego's sensors, and average precisions, by the swept value.

    A sensor's range ends at the first 10 m in which it detects less than half of the vehicles
    within reach of the LiDAR's beams in clear weather. A LiDAR must return five points of vehicles
    within reach of five beams; a radar needs one detection, up to 45 degrees to the side.

    Args:
        dataset: Dataset of a suite with a sweep.
        predictions: Files of predictions on it; a column each.
        options: Options of the evaluation; ranges are over all frames.

    Raises:
        InputError: The scenarios are not of one sweep, or predictions cannot be evaluated.
    """
    scenarios = [scenario for scenario in Dataset(dataset).scenarios if len(scenario)]
    if not scenarios:
        raise no_frames_error(dataset)
    field, by_value = _group_by_value(scenarios)
    columns: dict[str, list[Any]] = {field: list(by_value)}
    ranges = [_compute_ranges(found) for found in by_value.values()]
    columns["lidar_range_m"] = [lidar_m for lidar_m, _ in ranges]
    if not np.isnan([radar_m for _, radar_m in ranges]).all():
        columns["radar_range_m"] = [radar_m for _, radar_m in ranges]
    for path in predictions:
        table = evaluate_predictions(path, dataset, options).table
        rows = [dict(zip(table.columns, row, strict=True)) for row in table.rows]
        found = {row["cell"]: row["ap_50"] for row in rows if row["by"] == "sweep"}
        columns[f"ap_50 {path.stem}"] = [found[format_swept_value(value)] for value in by_value]
    return StatisticsTable("degradation", f"Sensors and detectors by {field}", columns)


def _group_by_value(scenarios: Sequence[Scenario]) -> tuple[str, dict[float, list[ScenarioFacts]]]:
    """Group the facts of scenarios by the swept value, lowest first, and name the field."""
    swept = [scenario.spec.provenance.sweep_points for scenario in scenarios]
    fields = {point.field for points in swept for point in points}
    if len(fields) != 1 or not all(swept):
        found = ", ".join(sorted(fields)) or "none"
        raise InputError(
            f"{scenarios[0].path.parent}: its scenarios are not those of one sweep"
            f" (swept: {found}); run the specs of a suite with one, as degradation_rain"
        )
    pairs = [(point.value, scenario) for (point,), scenario in zip(swept, scenarios, strict=True)]
    grouped: dict[float, list[ScenarioFacts]] = {}
    for value, scenario in sorted(pairs, key=lambda pair: pair[0]):
        grouped.setdefault(value, []).append(collect_scenario_facts(scenario))
    return fields.pop(), grouped


def _compute_ranges(facts: Sequence[ScenarioFacts]) -> tuple[float, float]:
    """Compute the ranges of the ego's LiDAR and radars; NaN without radars."""
    objects = np.concatenate([*(item.objects for item in facts), *(item.parked for item in facts)])
    objects = objects[np.isin(objects["class"], VEHICLES) & ~np.isnan(objects["ego_hits"])]
    visible = objects[objects["ego_hits"] >= MIN_POINTS]
    ahead = objects[np.abs(objects["ego_bearing_rad"]) <= RADAR_BEARING_RAD]
    lidar_m = compute_range_m(visible["ego_distance_m"], visible["ego_points"] >= MIN_POINTS)
    if np.isnan(ahead["ego_detections"]).all():
        return lidar_m, np.nan
    return lidar_m, compute_range_m(ahead["ego_distance_m"], ahead["ego_detections"] > 0)


def compute_range_m(distance_m: Float64Array, is_detected: Any) -> float:
    """Compute the range up to which at least half of the objects (n,) are detected.

    It is a multiple of 10 m; bins without objects do not end it. At most 150 m.
    """
    bins = np.floor(distance_m / BIN_M).astype(int)
    for number in range(round(FARTHEST_M / BIN_M)):
        inside = bins == number
        if inside.any() and np.mean(is_detected[inside]) < 0.5:
            return number * BIN_M
    return min(FARTHEST_M, (int(bins.max(initial=-1)) + 1) * BIN_M)


def draw_degradation(table: StatisticsTable) -> "Figure":
    """Draw the ranges and the average precisions over the swept value.

    Raises:
        InputError: matplotlib is not installed.
    """
    (field, values), *series = table.columns.items()
    figure = make_figure()
    axes = figure.subplots()
    precision = axes.twinx()
    for number, (name, heights) in enumerate(series):
        is_precision = name.startswith("ap_50")
        (precision if is_precision else axes).plot(
            values,
            np.array(heights) * (100.0 if is_precision else 1.0),
            "--s" if is_precision else "-o",
            color=f"C{number}",
            label=name.removeprefix("ap_50 ") if is_precision else name.split("_")[0],
        )
    if values[0] > 0 and values[-1] / values[0] >= LOGARITHMIC_RATIO:
        axes.set_xscale("log")
    axes.set_xlabel(field)
    axes.set_ylabel("range of the ego's sensors in m (lines)")
    precision.set_ylabel("AP@50 in percent (dashed)")
    axes.set_ylim(0, None)
    precision.set_ylim(0, 100)
    figure.legend(loc="outside upper center", ncols=4, fontsize="small")
    return figure
