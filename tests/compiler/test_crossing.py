import shutil
import time
from pathlib import Path

import pytest
from advercity_dsl import DECLARATIONS, Spec

from advercity.compiler import (
    describe_spec_differences,
    find_weather,
    list_weathers,
    to_json,
    validate_paths,
    with_digest,
    with_weather,
    write_specs,
)
from advercity.compiler.authoring import write_starter
from advercity.compiler.crossing import compile_library
from advercity.errors import InputError
from advercity.physics.stopping import compute_stopping_distance
from tests.builders import SMALL_LIBRARY, Write, describe_errors

ROADS = ("ui", "unj", "ri", "rsnj", "rcnj")
WEATHERS = (
    *("clear_day", "clear_night", "soft_rain_day", "soft_rain_night", "heavy_rain_day"),
    *("heavy_rain_night", "fog_day", "fog_night", "foggy_heavy_rain_day"),
    *("foggy_heavy_rain_night", "glare_day"),
)
SUITE = "kind: suite\nid: small\nrig: one_camera\ncatalogue: one_car\n"


@pytest.fixture(scope="module")
def specs(library: Path) -> dict[str, Spec]:
    """Every spec of the shipped library as it ships, with models."""
    return {spec.id: spec for spec in compile_library(library)}


def test_the_small_library_compiles_to_one_scenario(write: Write) -> None:
    (spec,) = compile_library(write())
    assert spec.id == "lane_clear_day_sparse"
    assert [agent.number for agent in spec.agents] == [101, -1]
    assert spec.demand.vehicles == 16


def test_the_shipped_library_compiles_to_the_110_scenarios(specs: dict[str, Spec]) -> None:
    names = {f"{r}_{w}_{d}" for r in ROADS for w in WEATHERS for d in ("sparse", "dense")}
    assert set(specs) == names
    assert len(names) == 110


def test_committed_specs_are_what_the_library_compiles_to(specs: dict[str, Spec]) -> None:
    folder = Path(__file__).parents[2] / "compiled"
    assert describe_spec_differences(list(specs.values()), folder) == []


def test_the_same_library_compiles_to_the_same_bytes(library: Path, specs: dict[str, Spec]) -> None:
    again = compile_library(library)
    assert [to_json(spec) for spec in again] == [to_json(spec) for spec in specs.values()]


def test_repeats_are_scenarios_that_differ_in_traffic_and_share_it_over_weathers(
    library: Path, specs: dict[str, Spec], tmp_path: Path
) -> None:
    suite = (library / "nhtsa" / "suites" / "adver_city.yaml").read_text()
    suite = suite.replace("id: adver_city", "id: twice", 1).replace("default: true", "repeats: 2")
    suite = suite.replace("weathers: all", "weathers: [fog_day, clear_night]")
    (tmp_path / "twice.yaml").write_text(suite)

    twice = {spec.id: spec for spec in compile_library(library, tmp_path, suite="twice")}

    assert len(twice) == 5 * 2 * 2 * 2
    first, second = twice["ri_fog_day_dense_r1"], twice["ri_fog_day_dense_r2"]
    assert (first.provenance.repeat, second.provenance.repeat) == (1, 2)
    without = specs["ri_fog_day_dense"]
    assert (first.seeds, first.conflicts) == (without.seeds, without.conflicts)
    assert second.seeds.traffic != first.seeds.traffic
    assert second.conflicts[0].parameters != first.conflicts[0].parameters
    other = twice["ri_clear_night_dense_r2"]
    assert (other.seeds.traffic, other.conflicts) == (second.seeds.traffic, second.conflicts)
    assert to_json(with_weather(second, find_weather("clear_night"))) == to_json(other)


def test_at_the_limit_an_ego_cannot_always_stop_in_sight(library: Path, tmp_path: Path) -> None:
    """At 90 km/h, 1.5 s and 0.8 g take 77.4 m; fog_day has a visibility of 75 m."""
    header = "kind: suite\nid: fast\nextends: free_flow\nroads: [ui, rsnj]\n"
    (tmp_path / "fast.yaml").write_text(header + "weathers: [clear_day, fog_day]\n")

    compiled = compile_library(library, tmp_path, suite="fast")
    fast = [spec for spec in compiled if spec.provenance.repeat == 1]

    stopping = {spec.id: compute_stopping_distance(spec) for spec in fast}
    assert {name: found.can_stop_in_sight for name, found in stopping.items()} == {
        "ui_clear_day_free_flow_r1": True,
        "ui_fog_day_free_flow_r1": True,
        "rsnj_clear_day_free_flow_r1": True,
        "rsnj_fog_day_free_flow_r1": False,
    }
    assert stopping["rsnj_clear_day_free_flow_r1"].distance_m == pytest.approx(77.4, abs=0.5)
    assert {street.speed_limit_km_h for spec in fast for street in spec.road.streets.values()} == {
        50,
        90,
    }


def test_each_road_has_the_crash_groups_that_require_it(specs: dict[str, Spec]) -> None:
    groups = {
        road: {
            group.typology
            for density in ("sparse", "dense")
            for group in specs[f"{road}_clear_day_{density}"].groups
        }
        for road in ROADS
    }
    assert groups == {
        "ui": {"pedestrian", "pedalcyclist", "crossing_paths"},
        "unj": {"pedestrian"},
        "ri": {"pedalcyclist", "crossing_paths"},
        "rsnj": {"opposite_direction"},
        "rcnj": {"opposite_direction"},
    }


def test_a_required_kind_of_road_that_is_missing_is_an_error(write: Write) -> None:
    folder = write(road=(SMALL_LIBRARY / "road.yaml").read_text().replace("rural", "urban"))
    text = describe_errors(folder)
    assert "requires a kind of road that is missing: rural non_junction" in text
    assert "no selected typology requires this kind of road" in text


def test_one_of_two_suites_must_be_selected(write: Write) -> None:
    other = "kind: suite\nid: other\nrig: one_camera\ncatalogue: one_car\n"
    folder = write(other=other)
    assert "select one with `suite`: other, small" in describe_errors(folder)
    assert len(compile_library(folder, suite="other")) == 1


def test_a_suite_with_named_roads_need_not_cover_every_required_kind(
    library: Path, tmp_path: Path
) -> None:
    suite = SUITE.replace("one_camera", "adver_city").replace("one_car", "adver_city")
    (tmp_path / "suite.yaml").write_text(suite + "roads: [ui]\nweathers: [fog_day]\n")
    specs = compile_library(library, tmp_path, suite="small")
    assert {spec.road.id for spec in specs} == {"ui"}


@pytest.mark.parametrize("name", ["snow_day", "snow_night", "dust_day"])
def test_an_example_copied_into_the_library_adds_ten_specs(
    library: Path, specs: dict[str, Spec], tmp_path: Path, name: str
) -> None:
    copy = tmp_path / "library"
    shutil.copytree(library, copy)
    shutil.copy(library / "examples" / f"{name}.yaml", copy / "nhtsa" / "weather")
    made = {spec.id: spec for spec in compile_library(copy)}
    more = made.keys() - specs.keys()
    assert {made[item].weather.id for item in more} == {name}
    assert len(more) == 10
    assert all(to_json(made[item]) == to_json(specs[item]) for item in specs)


def test_two_scenarios_of_one_id_are_an_error_that_names_both(write: Write) -> None:
    road = (SMALL_LIBRARY / "road.yaml").read_text()
    weather = "kind: weather\nid: {}\ntime: day\n"
    folder = write(
        longer=road.replace("id: lane\n", "id: lane_mist\n"),
        rain=weather.format("rain"),
        mist_rain=weather.format("mist_rain"),
    )

    text = describe_errors(folder)

    assert (
        "two scenarios have the id 'lane_mist_rain_sparse': of road lane, weather mist_rain and of"
        " road lane_mist, weather rain"
    ) in text


def test_ids_tell_the_values_of_a_sweep_apart_to_twelve_digits(write: Write) -> None:
    sweep = "sweep: {field: road.origin_lat_deg, values: [45.00001, 45.00002]}\n"
    ids = {spec.id[-8:] for spec in compile_library(write(suite=SUITE + sweep))}
    assert ids == {"45p00001", "45p00002"}

    sweep = "sweep: {field: road.origin_lat_deg, values: [45, 45.0000000000001]}\n"
    text = describe_errors(write(suite=SUITE + sweep))
    assert "of road.origin_lat_deg 45.0 and of road.origin_lat_deg 45.0000000000001" in text


def test_a_suite_of_too_many_scenarios_is_refused_at_once(write: Write) -> None:
    sweep = "sweep: {field: road.origin_lat_deg, from: 1, to: 2, count: 100}\nrepeats: 1000\n"
    folder = write(suite=SUITE + sweep, rain="kind: weather\nid: rain\ntime: day\n")
    begin_s = time.process_time()
    assert "crosses to 200,000 scenarios; the limit is 100,000" in describe_errors(folder)
    assert time.process_time() - begin_s < 1


def test_all_weathers_are_those_that_are_not_optional(write: Write) -> None:
    folder = write(
        drizzle="kind: weather\nid: drizzle\ntime: day\n",
        sleet="kind: weather\nid: sleet\ntime: day\noptional: true\n",
        wet="kind: suite\nid: wet\nextends: small\nweathers: [sleet]\n",
    )
    compiled = {spec.weather.id for spec in compile_library(folder, suite="small")}
    assert "drizzle" in compiled
    assert "sleet" not in compiled
    assert {weather.declaration.id for weather in list_weathers(folder)} == compiled
    (spec,) = compile_library(folder, suite="wet")
    assert spec.weather.id == "sleet"


def test_starters_compile_together_with_the_library(library: Path, tmp_path: Path) -> None:
    copy = tmp_path / "library"
    shutil.copytree(library, copy)
    for kind in DECLARATIONS:
        write_starter(kind, f"my_{kind}", copy)
    assert len(compile_library(copy, suite="my_suite")) == 2 * 8


def test_several_folders_are_validated_as_the_one_library_that_they_compile_to(
    write: Write, tmp_path: Path
) -> None:
    folder, other = write(), tmp_path / "other"
    other.mkdir()
    (folder / "weather.yaml").rename(other / "weather.yaml")
    assert len(compile_library(folder, other)) == 1
    assert validate_paths(folder, other) == "7 declarations, 1 scenario"
    assert validate_paths(other / "weather.yaml") == "1 declaration"


def test_validation_reports_the_errors_of_every_path(write: Write, tmp_path: Path) -> None:
    folder = write(bad="kind: weather\nid: bad\ntime: noon\n")
    spec = tmp_path / "spec.json"
    spec.write_text("{")
    with pytest.raises(InputError) as caught:
        validate_paths(spec, folder)
    assert f"{spec}:1:2: not valid JSON" in str(caught.value)
    assert f"{folder / 'bad.yaml'}:3:7: time: 'noon'" in str(caught.value)


def test_writing_specs_says_what_changed(write: Write, tmp_path: Path) -> None:
    specs, folder = compile_library(write()), tmp_path / "specs"
    assert write_specs(specs, folder) == "1 new"
    assert write_specs(specs, folder) == "1 unchanged"
    assert validate_paths(*folder.iterdir()) == "1 spec"
    earlier = with_digest(specs[0].model_copy(update={"id": "earlier"}))
    assert write_specs([earlier], folder) == "1 new, 1 removed"
    (folder / "earlier.json").rename(folder / "mine.json")
    assert write_specs(specs, folder) == "1 new"
    assert (folder / "mine.json").exists()


def test_a_weather_is_found_by_its_name_in_the_library_that_is_named(write: Write) -> None:
    folder = write(mist="kind: weather\nid: my_mist\ntime: day\n")
    assert find_weather("my_mist", folder).declaration.id == "my_mist"
    with pytest.raises(
        InputError, match=r"unknown weather 'my_mist': neither a file, nor a name in"
    ):
        find_weather("my_mist")


def test_the_file_of_an_example_is_named_where_a_weather_is_sought() -> None:
    with pytest.raises(InputError, match=r"is an example; give its file: (.*)") as told:
        find_weather("hail_day")
    assert find_weather(str(told.value).partition("its file: ")[2]).declaration.id == "hail_day"
