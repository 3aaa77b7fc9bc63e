"""Splits, statistics and films of a small dataset."""

import csv
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from advercity_dsl import Spec

from advercity.cli import main
from advercity.dataset import overview_images
from advercity.dataset.facts import OBJECT_FACT, ScenarioFacts, collect_dataset_facts
from advercity.dataset.index import link_splits
from advercity.dataset.manifest import Identity, WeatherTruth
from advercity.dataset.overview_images import write_videos
from advercity.dataset.reader import open_dataset
from advercity.dataset.statistics import StatisticsTable, compute_tables, write_tables
from advercity.dataset.statistics_plots import draw_table, write_plots
from advercity.dataset.verification import verify_dataset
from advercity.dataset.writer import ScenarioWriter
from advercity.errors import InputError, RunError
from advercity.sensors.sensor_frame import SensorFrame

ReadingsOf = Callable[[int], tuple[SensorFrame, ...]]
FRAMES = 3


@pytest.fixture(scope="module")
def dataset(
    tmp_path_factory: pytest.TempPathFactory,
    spec: Spec,
    specs: dict[str, Spec],
    readings_of: ReadingsOf,
) -> Path:
    """Two scenarios of the same pictures, said to be of two roads and densities."""
    root = tmp_path_factory.mktemp("dataset")
    for one in (spec, specs["ui_clear_night_dense"]):
        identity = Identity.for_spec(one, trace_sha256="0" * 64, renderer={})
        with ScenarioWriter(root, one, identity, length=FRAMES) as writer:
            for index in range(FRAMES):
                writer.write_frame(index, readings_of(index))
            writer.finish()
    return root


def test_scenarios_are_linked_by_road(dataset: Path, tmp_path: Path) -> None:
    found = link_splits(dataset, tmp_path)
    expected = {
        "train": [],
        "validate": ["rcnj_fog_day_sparse"],
        "test": ["ui_clear_night_dense"],
    }
    assert found == expected
    assert json.loads((tmp_path / "splits.json").read_text()) == expected
    assert (tmp_path / "test" / "ui_clear_night_dense" / "+101" / "000060.pcd").is_file()
    assert verify_dataset(tmp_path) == []
    assert len(open_dataset(tmp_path)) == 2 * FRAMES


def test_links_are_brought_up_to_date(dataset: Path, tmp_path: Path) -> None:
    link_splits(dataset, tmp_path)
    link_splits(dataset, tmp_path, {"train": ["ui"], "validate": ["rcnj"], "test": []})
    assert [path.name for path in (tmp_path / "train").iterdir()] == ["ui_clear_night_dense"]
    assert list((tmp_path / "test").iterdir()) == []


@pytest.mark.parametrize(
    ("roads", "message"),
    [
        ({"train": ["rcnj"]}, "road 'ui' is in no split"),
        ({"train": ["ui", "rcnj"], "test": ["ui"]}, "road 'ui' is in two splits"),
    ],
)
def test_a_road_belongs_to_one_split(
    dataset: Path, tmp_path: Path, roads: dict[str, list[str]], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        link_splits(dataset, tmp_path, roads)


@pytest.fixture(scope="module")
def facts(dataset: Path) -> list[ScenarioFacts]:
    return collect_dataset_facts(dataset)


def named(found: list[StatisticsTable], name: str) -> dict[str, list[Any]]:
    return next(
        {key: list(values) for key, values in table.columns.items()}
        for table in found
        if table.name == name
    )


def test_an_object_counts_once_per_frame(facts: list[ScenarioFacts]) -> None:
    """All but the truck, which is far, the ego by grace of the others."""
    for one in facts:
        assert one.num_annotations.tolist() == [6] * FRAMES
        assert sorted(one.objects["id"][:6].tolist()) == [101, 102, 103, 201, 202, 203]
        np.testing.assert_allclose(one.speeds_km_h, [[36.0, 28.8, 0.0]] * FRAMES)


def test_the_ego_does_not_see_itself(facts: list[ScenarioFacts]) -> None:
    objects = facts[0].objects
    assert np.isnan(objects["ego_distance_m"][objects["id"] == 101]).all()
    van = objects[objects["id"] == 201][0]
    assert van["ego_distance_m"] == pytest.approx(13.0)
    assert van["ego_bearing_rad"] == pytest.approx(np.arctan2(5, 12))
    assert van["ego_points"] == van["ego_hits"] == 40


def test_roads_are_summed_up(facts: list[ScenarioFacts]) -> None:
    roads = named(compute_tables(facts), "stats")
    assert roads["road"] == ["rcnj", "ui", "total"]
    assert roads["scenarios"] == [1, 1, 2]
    assert roads["frames"] == [3, 3, 6]
    assert roads["vehicles"] == [5, 5, 10]
    assert roads["pedestrians"] == [1, 1, 2]
    assert roads["annotations_per_frame"] == [6, 6, 6]
    assert roads["traffic_speed_km_h_mean"] == pytest.approx([16.2] * 3)
    assert roads["cav_speed_km_h_mean"] == pytest.approx([21.6] * 3)


def test_shares_of_weather_and_daytime(facts: list[ScenarioFacts]) -> None:
    found = compute_tables(facts)
    assert named(found, "weather") == {"weather": ["clear", "fog"], "frames": [3, 3]}
    assert named(found, "time_of_day") == {"time_of_day": ["day", "night"], "frames": [3, 3]}
    assert named(found, "visibility_by_weather")["mor_m"][0] == pytest.approx(75, rel=0.01)


def seen_at(*places: tuple[float, float]) -> ScenarioFacts:
    """A frame in which the ego annotates cars at these distances and bearings in degrees."""
    objects = np.zeros(len(places), OBJECT_FACT)
    objects["class"] = "car"
    objects["id"] = np.arange(len(places))
    objects["ego_distance_m"] = [distance for distance, _ in places]
    objects["ego_bearing_rad"] = np.deg2rad([bearing for _, bearing in places])
    objects["ego_hits"], objects["ego_points"] = 10, 5
    weather = WeatherTruth.model_validate(
        dict.fromkeys(WeatherTruth.model_fields, 0.0) | {"id": "fog_day", "time": "day"}
    )
    return ScenarioFacts("ui", "dense", weather, objects, np.array([len(places)]), np.zeros((1, 3)))


def test_distances_fall_into_bins_of_20_m() -> None:
    found = compute_tables([seen_at((0.0, 0), (19.9, 0), (20.0, 0), (199.9, 0))])
    ranges = named(found, "density_by_range_to_ego")
    assert ranges["distance_m_from"] == [20.0 * k for k in range(10)]
    assert ranges["dense"] == [2, 1, 0, 0, 0, 0, 0, 0, 0, 1]
    assert named(found, "echoes_by_range")["fog_day"][0] == 0.5


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


def test_every_table_is_a_csv_and_all_but_one_a_picture(
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
        assert image.std() > 5


def test_a_plot_that_cannot_be_written_is_named(facts: list[ScenarioFacts], tmp_path: Path) -> None:
    (tmp_path / "weather.png").mkdir()
    with pytest.raises(RunError, match=r"weather\.png: cannot be written: "):
        write_plots(compute_tables(facts), tmp_path)


@pytest.mark.parametrize("name", ["stats", "video", "sheet", "view"])
def test_a_scenario_without_frames_is_told_how_to_get_them(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    spec: Spec,
    name: str,
) -> None:
    identity = Identity.for_spec(spec, trace_sha256="0" * 64, renderer={})
    with ScenarioWriter(tmp_path, spec, identity, length=FRAMES) as writer:
        writer.finish()
    code, out, err = command(monkeypatch, capsys, name, tmp_path / spec.id)
    assert (code, out) == (2, "")
    assert err.endswith("no frames here yet; `advercity run` with its spec makes them\n")
    assert len(err.splitlines()) == 1


def test_plots_without_matplotlib_say_what_to_install(
    facts: list[ScenarioFacts], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(InputError, match=r"pip install 'advercity\[stats\]'"):
        draw_table(compute_tables(facts)[1])


def test_films_have_a_picture_per_frame(dataset: Path, tmp_path: Path) -> None:
    import av

    written = write_videos(dataset / "ui_clear_night_dense", tmp_path)
    assert len(written) == 8
    for path in written:
        with av.open(str(path)) as container:
            frames = list(container.decode(video=0))
            assert len(frames) == FRAMES
            assert container.streams.video[0].average_rate == 10
            assert np.std(frames[0].to_ndarray(format="rgb24")) > 5
    assert {path.name for path in tmp_path.iterdir()} == {path.name for path in written}


def test_an_unknown_film_is_told(dataset: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such video; front, mosaic, semantic, lidar"):
        write_videos(dataset, tmp_path, ["drone"])


def test_boxes_are_drawn_around_what_they_stand_for(dataset: Path) -> None:
    """What is drawn lies on or around the pixels of actors, where all of them are ahead."""
    view = open_dataset(dataset)[0]["cav1"]
    drawn = (overview_images.draw_camera_boxes(view, 0) != view.image(0)).any(axis=-1)
    is_actor = np.isin(view.semantic(0), (4, 10))
    around = cv2.dilate(is_actor.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    assert np.count_nonzero(drawn) > 20
    assert np.count_nonzero(drawn & around) / np.count_nonzero(drawn) > 0.9


def test_clouds_from_above_are_centred_on_the_first_viewpoint(dataset: Path) -> None:
    picture = overview_images.draw_top_view(open_dataset(dataset)[0], 200)
    assert tuple(picture[100, 100]) == overview_images.AGENT_VIEW_COLOURS[0]


def command(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *arguments: str | Path
) -> tuple[int, str, str]:
    """Exit code, data and messages of a command."""
    monkeypatch.setattr("sys.argv", ["advercity", *map(str, arguments)])
    with pytest.raises(SystemExit) as left:
        main()
    captured = capsys.readouterr()
    return (left.value.code if isinstance(left.value.code, int) else 0), captured.out, captured.err


@pytest.mark.parametrize("name", ["verify", "repair", "stats", "video", "split", "sheet"])
def test_commands_refuse_what_is_no_dataset(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path, name: str
) -> None:
    code, out, err = command(monkeypatch, capsys, name, tmp_path)
    assert (code, out) == (2, "")
    assert "so not a dataset" in err
    assert len(err.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["verify", "repair", "stats", "video", "split", "sheet", "view"])
def test_commands_tell_a_missing_folder_and_a_file_from_a_dataset(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path, name: str
) -> None:
    notes = tmp_path / "notes"
    notes.touch()
    missing = command(monkeypatch, capsys, name, tmp_path / "no")
    file = command(monkeypatch, capsys, name, notes)
    assert missing == (
        2,
        "",
        f"error: {tmp_path / 'no'}: no such folder; is the path right?\n",
    )
    assert file == (2, "", f"error: {notes}: is a file; name the folder of a dataset\n")


@pytest.mark.parametrize("name", ["sheet", "view"])
def test_commands_on_one_scenario_name_those_of_a_dataset(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    dataset: Path,
    name: str,
) -> None:
    code, out, err = command(monkeypatch, capsys, name, dataset)
    assert (code, out) == (2, "")
    assert "name one of its scenarios: rcnj_fog_day_sparse, ui_clear_night_dense" in err


@pytest.mark.parametrize("name", ["stats", "video", "split"])
def test_an_output_that_is_a_file_is_bad_input(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    dataset: Path,
    tmp_path: Path,
    name: str,
) -> None:
    notes = tmp_path / "notes"
    notes.write_text("mine")
    code, out, err = command(monkeypatch, capsys, name, dataset, "--output", notes)
    assert (code, out) == (2, "")
    assert "is a file" in err
    assert notes.read_text() == "mine"


def test_commands_say_what_they_wrote(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    dataset: Path,
) -> None:
    code, out, err = command(monkeypatch, capsys, "split", dataset, "--output", tmp_path)
    assert (code, err) == (0, "")
    assert out.splitlines() == [
        f"{tmp_path / 'train'}: 0",
        f"{tmp_path / 'validate'}: 1",
        f"{tmp_path / 'test'}: 1",
    ]
    films = tmp_path / "films"
    code, out, _ = command(
        *(monkeypatch, capsys, "video", tmp_path / "test", "--kind", "lidar", "--output", films)
    )
    assert (code, out.strip()) == (0, str(films / "ui_clear_night_dense_lidar.mp4"))
    code, out, err = command(monkeypatch, capsys, "repair", dataset)
    assert (code, out, err) == (0, "", "")
