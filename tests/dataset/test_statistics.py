"""Statistics of a small dataset, as tables and as plots."""

import csv
import itertools
import sys
from collections.abc import Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from advercity.dataset.facts import OBJECT_FACT, ScenarioFacts, collect_dataset_facts
from advercity.dataset.statistics import StatisticsTable, compute_tables, write_tables
from advercity.dataset.statistics_plots import draw_table, write_plots
from advercity.dataset.weather_truth import WeatherTruth
from advercity.errors import InputError, RunError
from advercity.sensors.measurements import PointKind
from tests.builders import SLOPE_RAD, TWO_ROADS_FRAMES


@pytest.fixture(scope="module")
def facts(two_roads: Path) -> list[ScenarioFacts]:
    return collect_dataset_facts(two_roads)


def named(found: list[StatisticsTable], name: str) -> dict[str, list[Any]]:
    return next(
        {key: list(values) for key, values in table.columns.items()}
        for table in found
        if table.name == name
    )


def test_speeds_of_nobody_are_one_bin_without_any(facts: list[ScenarioFacts]) -> None:
    empty = [replace(item, speeds_km_h=item.speeds_km_h[:0]) for item in facts]
    found = named(compute_tables(empty), "num_frames_per_ego_speed")
    assert found == {"speed_km_h": [0], "frames": [0]}


def test_an_object_counts_once_per_frame(facts: list[ScenarioFacts]) -> None:
    """All but the truck, which is far, the ego by grace of the others."""
    for one in facts:
        assert one.num_annotations.tolist() == [6] * TWO_ROADS_FRAMES
        assert sorted(one.objects["id"][:6].tolist()) == [101, 102, 103, 201, 202, 203]
        np.testing.assert_allclose(one.speeds_km_h, [[36.0, 28.8, 0.0]] * TWO_ROADS_FRAMES)


def test_the_ego_does_not_annotate_itself(facts: list[ScenarioFacts]) -> None:
    objects = facts[0].objects
    assert np.isnan(objects["ego_distance_m"][objects["id"] == 101]).all()
    van = objects[objects["id"] == 201][0]
    assert van["ego_distance_m"] == pytest.approx(13.0)
    assert van["ego_bearing_rad"] == pytest.approx(np.arctan2(5, 12 * np.cos(SLOPE_RAD)))
    assert (van["ego_points"], van["ego_hits"]) == (35, 40)


def test_roads_are_summarised(facts: list[ScenarioFacts]) -> None:
    roads = named(compute_tables(facts), "stats")
    assert roads["road"] == ["rcnj", "ui", "total"]
    assert roads["scenarios"] == [1, 1, 2]
    assert roads["frames"] == [3, 3, 6]
    assert roads["vehicles"] == [5, 5, 10]
    assert roads["pedestrians"] == [1, 1, 2]
    assert roads["annotations_per_frame"] == [6, 6, 6]
    assert roads["traffic_speed_km_h_mean"] == pytest.approx([16.2] * 3)
    assert roads["cav_speed_km_h_mean"] == pytest.approx([21.6] * 3)


def test_frames_are_counted_by_weather_and_time_of_day(facts: list[ScenarioFacts]) -> None:
    found = compute_tables(facts)
    assert named(found, "weather") == {"weather": ["clear", "fog"], "frames": [3, 3]}
    assert named(found, "time_of_day") == {"time_of_day": ["day", "night"], "frames": [3, 3]}
    assert named(found, "visibility_by_weather")["mor_m"][0] == pytest.approx(75, rel=0.01)


def seen_at(
    *places: tuple[float, float], parked: int = 0, detections: Sequence[int] = ()
) -> ScenarioFacts:
    """A frame in which the ego annotates cars at these distances and bearings in degrees.

    With a number of radar detections for each, the ego has a radar and a unit another one.
    """
    objects = np.zeros(len(places), OBJECT_FACT)
    objects["class"] = "car"
    objects["id"] = np.arange(len(places))
    objects["ego_distance_m"] = [distance for distance, _ in places]
    objects["ego_bearing_rad"] = np.deg2rad([bearing for _, bearing in places])
    objects["ego_hits"], objects["ego_points"] = 10, 5
    objects["ego_detections"] = detections or np.nan
    weather = WeatherTruth.model_validate(
        dict.fromkeys(WeatherTruth.model_fields, 0.0) | {"id": "fog_day", "time": "day"}
    )
    cars = np.zeros(parked, OBJECT_FACT)
    cars["class"], cars["id"] = "car", np.arange(parked) + 1_000_001
    numbers, speeds = np.array([len(places)]), np.zeros((1, 3))
    kinds = np.zeros((1, len(PointKind)), np.int64)
    kinds[0, PointKind.SURFACE], kinds[0, PointKind.GHOST] = sum(detections), 1
    return ScenarioFacts(
        road="ui",
        density="dense",
        weather="fog_day",
        weathers=(weather,),
        objects=objects,
        parked=cars,
        num_annotations=numbers,
        speeds_km_h=speeds,
        radars=2 if detections else 0,
        radar_detections=kinds,
    )


def test_parked_cars_are_counted_apart() -> None:
    moving, with_parked = (
        compute_tables([seen_at((30.0, 0.0), (50.0, 0.0), parked=count)]) for count in (0, 3)
    )
    assert named(with_parked, "stats")["parked_cars"] == [3, 3]
    classes = named(with_parked, "class_histogram")
    assert classes == {"class": ["parked car", "car"], "annotations": [3, 2]}
    for ours, theirs in zip(with_parked, moving, strict=True):
        if ours.name not in ("stats", "class_histogram"):
            assert str(ours.rows) == str(theirs.rows)
    counts = named(with_parked, "stats")
    assert (counts["vehicles"], counts["annotations"]) == ([2, 2], [2, 2])


def test_distances_fall_into_bins_of_20_m() -> None:
    found = compute_tables([seen_at((0.0, 0), (19.9, 0), (20.0, 0), (199.9, 0))])
    ranges = named(found, "density_by_range_to_ego")
    assert ranges["distance_m_from"] == [20.0 * k for k in range(10)]
    assert ranges["dense"] == [2, 1, 0, 0, 0, 0, 0, 0, 0, 1]
    assert named(found, "echoes_by_range")["fog_day"][0] == 0.5


def test_radar_detections_are_counted_by_kind_and_objects_by_distance() -> None:
    frame = seen_at((5.0, 0), (10.0, 0), (30.0, 0), detections=(4, 0, 2))
    # Scenarios without a radar do not count.
    found = compute_tables([frame, frame, seen_at((5.0, 0))])
    kinds = named(found, "radar_by_kind")
    assert kinds["weather"] == ["fog_day"]
    assert (kinds["surface"], kinds["ghost"], kinds["rain"]) == ([3.0], [0.5], [0.0])
    fractions = named(found, "radar_detected_by_range")["fog_day"]
    assert fractions[:2] == [0.5, 1.0]
    assert np.isnan(fractions[2:]).all()


def test_a_dataset_without_radars_has_no_table_of_them(facts: list[ScenarioFacts]) -> None:
    assert not [table for table in compute_tables(facts) if "radar" in table.name]


def test_the_polar_map_shows_where_objects_are() -> None:
    polar = named(
        compute_tables([seen_at((30.0, 95.0), (30.0, 99.0), (199.0, -180.0))]), "polar_density_map"
    )
    rows = zip(polar["bearing_deg_from"], polar["distance_m_from"], polar["objects"], strict=True)
    assert [row for row in rows if row[2]] == [(-180.0, 187.5, 1), (90.0, 25.0, 2)]


def test_counts_of_annotations_fall_into_tens() -> None:
    found = compute_tables([seen_at(*[(10.0, 0.0)] * 10), seen_at(*[(10.0, 0.0)] * 9)])
    assert named(found, "num_keyframes_per_num_annotations") == {
        "annotations_from": [0, 10],
        "frames": [1, 1],
    }


def test_every_table_is_a_csv_and_all_but_one_a_plot(
    facts: list[ScenarioFacts], tmp_path: Path
) -> None:
    found = compute_tables(facts)
    write_tables(found, tmp_path)
    write_plots(found, tmp_path)
    names = {table.name for table in found}
    assert {path.stem for path in tmp_path.glob("*.csv")} == names
    assert {path.stem for path in tmp_path.glob("*.png")} == names - {"stats"}
    with (tmp_path / "class_histogram.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert rows[0] == {"class": "car", "annotations": "18"}
    for path in tmp_path.glob("*.png"):
        image = cv2.imread(str(path))
        assert image is not None
        # Axes and texts are grey; what is drawn of the data is not.
        assert (np.ptp(image.astype(int), axis=2) > 30).sum() > 100, path.name


def test_weathers_of_ones_own_have_colours_of_their_own_and_labels_apart() -> None:
    names = ["clear", "own_mist", "my_snow", "sandstorm", "fog"]
    table = StatisticsTable("weather", "Frames", {"weather": names, "frames": [95, 2, 1, 1, 1]})
    figure = draw_table(table)
    (axes,) = figure.axes
    assert len({patch.get_facecolor() for patch in axes.patches}) == len(names)
    figure.draw_without_rendering()
    legend = axes.get_legend()
    assert legend is not None
    texts = legend.get_texts()
    assert [text.get_text() for text in texts][:2] == ["clear: 95.0 %", "own mist: 2.0 %"]
    boxes = [text.get_window_extent() for text in texts]
    assert not any(a.overlaps(b) for a, b in itertools.combinations(boxes, 2))


def test_points_per_beam_are_no_fraction() -> None:
    """Two returns of a beam give up to two points."""
    columns = {"distance_m_from": [0, 10], "clear": [1.1, 0.4]}
    (axes,) = draw_table(StatisticsTable("echoes_by_range", "Points", columns)).axes
    assert axes.get_ylabel() == "points per beam"


def test_a_plot_of_no_classes_has_no_bars() -> None:
    """As of a frame or two in which nobody is seen."""
    (table,) = (it for it in compute_tables([seen_at()]) if it.name == "class_histogram")
    assert list(table.columns["class"]) == []
    (axes,) = draw_table(table).axes
    assert not axes.patches


def test_a_plot_that_cannot_be_written_is_named(facts: list[ScenarioFacts], tmp_path: Path) -> None:
    (tmp_path / "weather.png").mkdir()
    tables = [table for table in compute_tables(facts) if table.name in ("roads", "weather")]
    with pytest.raises(InputError, match=r"weather\.png: is a folder"):
        write_plots(tables, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["weather.png"]


def test_a_table_of_others_stays(facts: list[ScenarioFacts], tmp_path: Path) -> None:
    (tmp_path / "weather.csv").write_text("mine")
    with pytest.raises(InputError, match=r"weather\.csv: exists, and there is no record"):
        write_tables(compute_tables(facts), tmp_path)
    assert [path.read_text() for path in tmp_path.iterdir()] == ["mine"]


def test_plots_without_matplotlib_name_the_extra(
    facts: list[ScenarioFacts], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(InputError, match=r"pip install 'advercity\[stats\]'"):
        draw_table(compute_tables(facts)[1])


def test_a_process_that_cannot_read_a_scenario_is_reported(
    two_roads: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def end(*_: object) -> None:
        raise BrokenProcessPool

    monkeypatch.setattr("concurrent.futures.ProcessPoolExecutor.map", end)
    with pytest.raises(RunError, match=f"{two_roads}: a process that read it has ended"):
        collect_dataset_facts(two_roads)
