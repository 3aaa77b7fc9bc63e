import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from advercity_dsl import DECLARATIONS, Spec

from advercity.compiler import (
    DiagnosticsError,
    compare_specs,
    explain_spec,
    find_weather,
    load_library,
    read_spec,
    to_json,
    validate_path,
    with_weather,
)
from advercity.compiler.authoring import format_starter, write_starter
from advercity.compiler.crossing import compile_library
from advercity.compiler.schema import build_schema
from advercity.errors import InputError

BASE = Path(__file__).parent / "base"
SUITE = "kind: suite\nid: small\nrig: one_camera\ncatalogue: one_car\n"
FOG = "kind: weather\nid: fog\ntime: day\n"
Compile = Callable[..., dict[str, Spec]]


@pytest.fixture
def compiled(tmp_path: Path) -> Compile:
    """Compiles the small library with more files, or others in place of its own."""

    def compile_with(**files: str) -> dict[str, Spec]:
        folder = tmp_path / "library"
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(BASE, folder)
        for name, text in files.items():
            (folder / f"{name}.yaml").write_text(text)
        return {spec.id: spec for spec in compile_library(folder)}

    return compile_with


def test_a_uniform_number_is_drawn_within_its_ends_and_recorded(compiled: Compile) -> None:
    spec = compiled(fog=FOG + "fog: {mor_m: {uniform: [50, 0.15 km]}}\n")["lane_fog_sparse"]
    assert spec.weather.fog.mor_m is not None
    assert 50 <= spec.weather.fog.mor_m <= 150
    assert to_json(spec).count('"uniform": [50.0, 150.0]') == 1


def test_another_weather_does_not_reshuffle_the_draws(compiled: Compile) -> None:
    fog = FOG + "fog: {mor_m: {uniform: [50, 150]}}\n"
    alone = compiled(fog=fog)["lane_fog_sparse"]
    other = fog.replace("id: fog", "id: aaa")
    assert to_json(compiled(fog=fog, aaa=other)["lane_fog_sparse"]) == to_json(alone)


def test_each_scenario_and_field_has_a_draw_of_its_own(compiled: Compile) -> None:
    fog = FOG + "fog: {mor_m: {uniform: [50, 150]}, depth_m: {uniform: [50, 150]}}\n"
    dense = "kind: density\nid: dense\nvehicles: 2\nwalkers: 2\n"
    specs = compiled(fog=fog, dense=dense)
    drawn = [
        value
        for name in ("lane_fog_sparse", "lane_fog_dense")
        for value in (specs[name].weather.fog.mor_m, specs[name].weather.fog.depth_m)
    ]
    assert len(set(drawn)) == 4


def test_draws_follow_the_seed_of_the_suite(compiled: Compile) -> None:
    fog = FOG + "fog: {mor_m: {uniform: [50, 150]}}\n"
    one = compiled(fog=fog)["lane_fog_sparse"]
    other = compiled(fog=fog, suite=SUITE + "seeds: {weather: 2}\n")["lane_fog_sparse"]
    assert one.weather.fog.mor_m != other.weather.fog.mor_m
    assert one.seeds.traffic == other.seeds.traffic


def test_draws_are_spread_as_their_distributions_say(compiled: Compile) -> None:
    bell = "{normal: {mean: 100, sd: 10, within: [90, 120]}}"
    fog = FOG + f"fog: {{mor_m: {{uniform: [50, 150]}}, depth_m: {bell}}}\n"
    fog += "sky: {oktas: {choice: [2, 7]}}\n"
    seeds = [SUITE + f"seeds: {{weather: {seed}}}\n" for seed in range(120)]
    drawn = [compiled(fog=fog, suite=seed)["lane_fog_sparse"].weather for seed in seeds]
    visibility = np.array([weather.fog.mor_m for weather in drawn])
    depth = np.array([weather.fog.depth_m for weather in drawn])
    assert abs(visibility.mean() - 100) < 4 * 29 / np.sqrt(120)
    assert visibility.min() < 60
    assert visibility.max() > 140
    assert depth.min() >= 90
    assert depth.max() <= 120
    assert 2.5 < depth.std() < 9
    assert {weather.sky.oktas for weather in drawn} == {2, 7}


def test_a_drawn_weather_in_a_replay_is_what_the_suite_compiles(
    compiled: Compile, tmp_path: Path
) -> None:
    fog = FOG + "fog: {mor_m: {uniform: [50, 150]}}\n"
    specs = compiled(fog=fog)
    entry = find_weather(str(tmp_path / "library" / "fog.yaml"))
    again = with_weather(specs["lane_clear_day_sparse"], entry)
    assert to_json(again) == to_json(specs["lane_fog_sparse"])


def test_a_sweep_names_its_steps_by_value_and_keeps_the_traffic(compiled: Compile) -> None:
    sweep = "sweep: {field: weather.fog.mor_m, from: 20 m, to: 1 km, count: 3, log: true}\n"
    specs = compiled(suite=SUITE + sweep)
    assert {name: spec.weather.fog.mor_m for name, spec in specs.items()} == {
        "lane_clear_day_sparse_mor_m_20": 20,
        "lane_clear_day_sparse_mor_m_141": 141,
        "lane_clear_day_sparse_mor_m_1000": 1000,
    }
    assert len({spec.seeds.traffic for spec in specs.values()}) == 1


def test_a_sweep_may_change_any_number_of_what_is_crossed(compiled: Compile) -> None:
    for field, value, path in (
        ("road.streets.main.path.0.line_m", 180, "road.streets.main.path.0.line_m"),
        ("density.vehicles", 2.5, "density.vehicles"),
        ("rig.vehicle.camera.mounts.0.z_m", 1.2, "agents.0.sensors.camera.mounts.0.z_m"),
    ):
        suite = SUITE + f"sweep: {{field: {field}, values: [{value}]}}\n"
        (spec,) = compiled(suite=suite).values()
        (plain,) = compiled().values()
        found = {change: after for change, _, after in compare_specs(plain, spec)}
        assert found[path] == value


def test_a_suite_keeps_only_what_its_conditions_hold_for(compiled: Compile) -> None:
    night = "kind: weather\nid: dark\ntime: night\nsun: {elevation_deg: -30}\n"
    thick, thin = (
        FOG.replace("id: fog", f"id: fog{metres}") + f"fog: {{mor_m: {metres}}}\n"
        for metres in (40, 400)
    )
    weathers = {"dark": night, "thick": thick, "thin": thin}

    def kept(where: str) -> set[str]:
        specs = compiled(suite=SUITE + f"where: {{{where}}}\n", **weathers)
        return {spec.weather.id for spec in specs.values()}

    assert kept("weather.time: night") == {"dark"}
    assert kept("weather.time: [day, night]") == {"dark", "clear_day", "fog40", "fog400"}
    assert kept("weather.fog.mor_m: {at_most: 0.1 km}") == {"fog40"}
    assert kept("weather.fog.mor_m: {at_least: 10}, road.land_use: rural") == {"fog40", "fog400"}


def test_roads_that_are_named_need_not_be_all_that_is_called_for(
    library: Path, tmp_path: Path
) -> None:
    suite = SUITE.replace("one_camera", "adver_city").replace("one_car", "adver_city")
    (tmp_path / "suite.yaml").write_text(suite + "roads: [ui]\nweathers: [fog_day]\n")
    specs = compile_library(library, tmp_path, suite="small")
    assert {spec.road.id for spec in specs} == {"ui"}


def test_a_declaration_may_extend_several_that_agree(compiled: Compile) -> None:
    specs = compiled(
        fog=FOG + "title: Fog\nfog: {mor_m: 75, depth_m: 20}\n",
        windy="kind: weather\nid: windy\ntime: day\nwind: {speed_m_s: 9}\n",
        both="kind: weather\nid: both\nextends: [fog, windy]\nfog: {mor_m: 40}\n",
    )
    weather = specs["lane_both_sparse"].weather
    assert (weather.fog.mor_m, weather.fog.depth_m, weather.wind.speed_m_s) == (40, 20, 9)
    assert weather.title == ""


def test_a_file_may_extend_the_one_beside_it(tmp_path: Path) -> None:
    (tmp_path / "fog.yaml").write_text(FOG + "extends: clear_day\nfog: {mor_m: 75}\n")
    (tmp_path / "thick.yaml").write_text(FOG.replace("fog", "thick") + "extends: fog\n")
    (tmp_path / "broken.yaml").write_text("kind: weather\n- nothing\n")
    assert find_weather(str(tmp_path / "thick.yaml")).declaration.fog.mor_m == 75


def test_null_takes_an_inherited_component_away(compiled: Compile) -> None:
    specs = compiled(
        fog=FOG + "fog: {mor_m: 75}\n",
        none="kind: weather\nid: none\nextends: fog\nfog: null\n",
    )
    assert specs["lane_none_sparse"].weather.fog.mor_m is None


@pytest.mark.parametrize("name", ["snow_day", "snow_night", "dust_day"])
def test_an_example_dropped_into_the_library_makes_ten_more_specs(
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


@pytest.mark.parametrize("kind", DECLARATIONS)
def test_a_new_declaration_is_valid_and_never_overwrites(kind: str, tmp_path: Path) -> None:
    path = write_starter(kind, "mine", tmp_path)
    validate_path(path)
    assert (tmp_path / ".advercity" / f"{kind}.schema.json").is_file()
    assert path.read_text().splitlines()[0].startswith("# yaml-language-server: $schema=")
    with pytest.raises(InputError, match="already exists"):
        write_starter(kind, "mine", tmp_path)


def test_new_things_compile_along_with_the_library(library: Path, tmp_path: Path) -> None:
    copy = tmp_path / "library"
    shutil.copytree(library, copy)
    for kind in DECLARATIONS:
        write_starter(kind, f"my_{kind}", copy)
    assert len(compile_library(copy, suite="my_suite")) == 2 * 8


def test_a_folder_that_is_too_large_for_a_library_is_not_read_through(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("advercity.compiler.library.MAX_FILES", 5)
    shutil.copytree(BASE, tmp_path / "deep" / "library")
    with pytest.raises(InputError, match="more than 5 files and folders; is it a library folder"):
        load_library(tmp_path)


def test_a_name_that_is_no_id_is_refused() -> None:
    with pytest.raises(InputError, match=r"'\.\./x' is not an id"):
        format_starter("weather", "../x")


def test_every_value_of_a_spec_is_explained(library: Path, specs: dict[str, Spec]) -> None:
    spec = specs["ui_glare_day_sparse"]
    origins = {item.path: item.text for item in explain_spec(spec, load_library(library))}
    sun = (library / "nhtsa" / "weather" / "glare_day.yaml").read_text().splitlines()
    place = origins["weather.sun.elevation_deg"].split("glare_day.yaml:")[1]
    line, column = map(int, place.split(":"))
    assert sun[line - 1][column - 1 :].startswith(f"{spec.weather.sun.elevation_deg:g},")
    assert origins["weather.fog.mor_m"] == "default"
    assert origins["demand.vehicles"].startswith("rule: ")
    assert all(origins.values())


def test_a_changed_library_is_not_taken_for_the_origin(
    compiled: Compile, specs: dict[str, Spec], tmp_path: Path
) -> None:
    compiled()
    with pytest.raises(InputError, match="is not in this library; compile"):
        explain_spec(specs["ui_fog_day_sparse"], load_library(tmp_path / "library"))


def test_specs_are_compared_by_meaning(specs: dict[str, Spec]) -> None:
    changes = compare_specs(specs["ui_fog_day_sparse"], specs["ui_fog_day_dense"])
    assert ("demand.vehicles", 48, 128) in changes
    assert not any(path.startswith(("weather", "road")) for path, _, _ in changes)


@pytest.mark.parametrize(("version", "way_out"), [(0, "compile its library"), (2, "upgrade")])
def test_a_spec_of_another_version_is_told_the_way_out(
    specs: dict[str, Spec], tmp_path: Path, version: int, way_out: str
) -> None:
    data = json.loads(to_json(specs["ui_fog_day_sparse"])) | {"spec_version": version}
    path = tmp_path / "spec.json"
    path.write_text(json.dumps(data))
    with pytest.raises(DiagnosticsError, match=f"has version {version}; this .* {way_out}"):
        read_spec(path)


@pytest.mark.parametrize("kind", DECLARATIONS)
def test_schemas_have_what_every_declaration_has(kind: str) -> None:
    assert build_schema(kind)["properties"].keys() >= {"id", "kind", "extends", "source"}


def test_the_schema_tells_units_and_ranges() -> None:
    rate = build_schema("weather")["$defs"]["Rain"]["properties"]["rate_mm_h"]
    assert rate["unit"] == "mm/h"
    assert rate["description"].startswith("Rate of rain: light below 2.5")
    assert {"type": "number", "minimum": 0, "maximum": 150} in rate["anyOf"]


@pytest.mark.parametrize("kind", DECLARATIONS)
def test_the_schema_describes_every_field(kind: str) -> None:
    schema = build_schema(kind)
    for definition in [schema, *schema.get("$defs", {}).values()]:
        fields: dict[str, Any] = definition.get("properties", {})
        assert [name for name, field in fields.items() if "description" not in field] == []
