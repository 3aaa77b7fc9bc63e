import json
from collections.abc import Callable
from pathlib import Path

import pytest
from advercity_dsl import Spec, Suite, Typology
from advercity_dsl.suite import Coverage, Selection

from advercity.compiler import (
    DiagnosticsError,
    describe_spec_differences,
    find_weather,
    load_library,
    read_spec,
    to_json,
    with_weather,
    write_specs,
)
from advercity.compiler.crossing import compile_library
from advercity.compiler.suites import find_required_categories, is_selected
from advercity.errors import InputError

ROADS = ("ui", "unj", "ri", "rsnj", "rcnj")
WEATHERS = (
    *("clear_day", "clear_night", "soft_rain_day", "soft_rain_night", "heavy_rain_day"),
    *("heavy_rain_night", "fog_day", "fog_night", "foggy_heavy_rain_day"),
    *("foggy_heavy_rain_night", "glare_day"),
)

SMALL = {
    path.name: path.read_text()
    for path in sorted((Path(__file__).parents[1] / "compiler" / "base").iterdir())
}
"""A library of one scenario."""

Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Writes the small library, with some files replaced, and returns its folder."""

    def write_library(**files: str) -> Path:
        texts = SMALL | {f"{name}.yaml": text for name, text in files.items()}
        for name, text in texts.items():
            (tmp_path / name).write_text(text)
        return tmp_path

    return write_library


def complaint(folder: Path) -> str:
    with pytest.raises(InputError) as caught:
        compile_library(folder)
    found = caught.value
    lines = (
        [problem.headline for problem in found.diagnostics]
        if isinstance(found, DiagnosticsError)
        else [str(found)]
    )
    return "\n".join(lines).replace(f"{folder}/", "")


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


def test_same_library_same_bytes(library: Path, specs: dict[str, Spec]) -> None:
    again = compile_library(library)
    assert [to_json(spec) for spec in again] == [to_json(spec) for spec in specs.values()]


def test_the_rule_selects_the_four_groups_of_the_paper(library: Path) -> None:
    typologies = load_library(library).get_declarations(Typology).values()
    selected = {item.id for item in typologies if is_selected(item, Selection())}
    assert selected == {"pedestrian", "pedalcyclist", "opposite_direction", "crossing_paths"}


@pytest.mark.parametrize(
    "rule",
    [
        Selection(fatality_rate_percent=0.13),
        Selection(fatality_rate_percent=0.35),
        Selection(bad_visibility_percent=2.01),
        Selection(bad_visibility_percent=4),
        Selection(vehicles_per_crash=1.17),
        Selection(vehicles_per_crash=1.88),
    ],
)
def test_the_selection_is_not_knife_edge(library: Path, rule: Selection) -> None:
    typologies = load_library(library).get_declarations(Typology).values()
    assert sum(is_selected(item, rule) for item in typologies) == 4


def test_road_departure_would_be_selected_without_the_partner_rule(library: Path) -> None:
    departure = load_library(library).get_declarations(Typology)["road_departure"]
    rule = Selection(vehicles_per_crash=1.0, bad_visibility_percent=2)
    assert is_selected(departure, rule)
    assert not is_selected(departure, Selection(bad_visibility_percent=2))


def test_required_places_are_those_of_the_paper(library: Path) -> None:
    typologies = load_library(library).get_declarations(Typology)
    cells = {
        name: sorted(str(cell) for cell in find_required_categories(typologies[name], Coverage()))
        for name in ("pedestrian", "pedalcyclist", "opposite_direction", "crossing_paths")
    }
    assert cells == {
        "pedestrian": ["urban intersection", "urban non_junction"],
        "pedalcyclist": ["rural intersection", "urban intersection"],
        "opposite_direction": ["rural non_junction curved", "rural non_junction straight"],
        "crossing_paths": ["rural intersection", "urban intersection"],
    }


def test_each_road_carries_the_groups_it_is_here_for(specs: dict[str, Spec]) -> None:
    groups = {
        road: {group.typology for group in specs[f"{road}_clear_day_sparse"].groups}
        for road in ROADS
    }
    assert groups == {
        "ui": {"pedestrian", "pedalcyclist", "crossing_paths"},
        "unj": {"pedestrian"},
        "ri": {"pedalcyclist", "crossing_paths"},
        "rsnj": {"opposite_direction"},
        "rcnj": {"opposite_direction"},
    }


@pytest.mark.parametrize(
    ("name", "vehicles", "walkers"),
    [
        ("ui_clear_day_sparse", 48, 60),
        ("ui_clear_day_dense", 128, 140),
        ("unj_clear_day_dense", 104, 140),
        ("ri_clear_day_dense", 40, 28),
        ("rsnj_clear_day_dense", 40, 0),
        ("rcnj_clear_day_sparse", 24, 0),
        ("rcnj_clear_day_dense", 56, 0),
    ],
)
def test_counts_are_the_originals(
    specs: dict[str, Spec], name: str, vehicles: int, walkers: int
) -> None:
    assert (specs[name].demand.vehicles, specs[name].demand.walkers) == (vehicles, walkers)


def test_weathers_of_one_road_and_density_share_the_traffic_seed(specs: dict[str, Spec]) -> None:
    seeds = {specs[f"ui_{weather}_sparse"].seeds.traffic for weather in WEATHERS}
    assert len(seeds) == 1
    assert specs["ui_fog_day_dense"].seeds.traffic not in seeds


def test_a_spec_under_another_weather_is_what_the_suite_compiles(specs: dict[str, Spec]) -> None:
    other = find_weather("glare_day")
    assert to_json(with_weather(specs["ri_fog_day_dense"], other)) == to_json(
        specs["ri_glare_day_dense"]
    )


def test_specs_are_read_back_as_they_were_written(specs: dict[str, Spec], tmp_path: Path) -> None:
    spec = specs["rcnj_fog_night_dense"]
    write_specs([spec], tmp_path)
    assert read_spec(tmp_path / f"{spec.id}.json") == spec


def test_a_spec_stays_below_forty_kilobytes(specs: dict[str, Spec]) -> None:
    assert max(len(to_json(spec)) for spec in specs.values()) < 40_000


def test_writing_removes_old_specs_of_the_suite_and_nothing_else(
    write: Write, tmp_path: Path
) -> None:
    (spec,) = compile_library(write())
    folder = tmp_path / "compiled"
    write_specs([spec.model_copy(update={"id": "gone"}), spec], folder)
    (folder / "mine.json").write_text('{"mine": 1}')
    write_specs([spec], folder)
    assert sorted(path.name for path in folder.iterdir()) == [
        "lane_clear_day_sparse.json",
        "mine.json",
    ]


def test_check_names_missing_and_stale_specs(write: Write, tmp_path: Path) -> None:
    (spec,) = compile_library(write())
    folder = tmp_path / "compiled"
    assert describe_spec_differences([spec], folder) == [
        f"{folder}/lane_clear_day_sparse.json: is missing"
    ]
    write_specs([spec], folder)
    assert describe_spec_differences([spec], folder) == []
    (folder / "lane_clear_day_sparse.json").write_text("{}")
    assert "differs" in describe_spec_differences([spec], folder)[0]


def test_extends_merges_mappings_and_replaces_the_rest(write: Write) -> None:
    folder = write(
        weather="kind: weather\nid: fog_day\ntime: day\nfog: {mor_m: 75, droplet_um: 20}\n",
        thick="kind: weather\nid: thick\nextends: fog_day\nfog: {mor_m: 40 m}\n",
    )
    weathers = {spec.weather.id: spec.weather for spec in compile_library(folder)}
    assert (weathers["thick"].fog.mor_m, weathers["thick"].fog.droplet_um) == (40, 20)


def test_a_misspelt_key_gets_its_place_and_the_nearest_name(write: Write) -> None:
    folder = write(weather="kind: weather\nid: fog_day\ntime: day\nfog:\n  mor: 75\n")
    assert complaint(folder) == ("weather.yaml:5:3: fog.mor: no such field; did you mean 'mor_m'?")


def test_a_wrong_unit_is_named_with_those_that_fit(write: Write) -> None:
    folder = write(weather="kind: weather\nid: fog_day\ntime: day\nfog: {mor_m: 75 deg}\n")
    assert complaint(folder) == (
        "weather.yaml:4:14: fog.mor_m: 'deg' is a unit of angle; units of length: um, mm, cm, m, km"
    )


def test_a_missing_reference_gets_the_nearest_name(write: Write) -> None:
    folder = write(suite="kind: suite\nid: small\nrig: one_camra\ncatalogue: one_car\n")
    assert complaint(folder) == (
        "suite.yaml:3:6: rig: unknown rig 'one_camra'; did you mean 'one_camera'?"
    )


def test_all_problems_of_all_files_are_told_at_once_in_order(write: Write) -> None:
    folder = write(
        weather="kind: weather\nid: w\ntime: noon\nrain: {rate_mm_h: -1}\nwnd: {}\n",
        density="kind: density\nid: sparse\nvehicles: many\nwalkers: 1\n",
    )
    lines = complaint(folder).splitlines()
    assert [line.split(" ")[0] for line in lines] == [
        "density.yaml:3:11:",
        "weather.yaml:3:7:",
        "weather.yaml:4:19:",
        "weather.yaml:5:1:",
    ]


def test_a_bomb_of_aliases_is_told_and_not_built(write: Write) -> None:
    rows = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    rows += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 9)]
    text = complaint(write(weather="\n".join(["kind: weather", "id: x", *rows])))
    assert "aliases (*) expand to more than 100000 values" in text


def test_on_and_off_are_text_and_exponents_are_numbers(write: Write) -> None:
    folder = write(weather="kind: weather\nid: w\ntime: day\ntitle: on\nair: {mor_m: 2e4}\n")
    (spec,) = compile_library(folder)
    assert (spec.weather.title, spec.weather.air.mor_m) == ("on", 20_000)


def test_a_place_that_no_road_is_stops_the_suite(write: Write) -> None:
    folder = write(road=SMALL["road.yaml"].replace("rural", "urban"))
    text = complaint(folder)
    assert "requires a kind of road that is missing: rural non_junction" in text
    assert "no selected typology requires this kind of road" in text


def test_a_suite_must_be_named_where_there_are_two(write: Write) -> None:
    other = "kind: suite\nid: other\nrig: one_camera\ncatalogue: one_car\n"
    folder = write(other=other)
    assert "select one with --suite: other, small" in complaint(folder)
    assert len(compile_library(folder, suite="other")) == 1


def test_a_road_needs_one_ego(write: Write) -> None:
    folder = write(road=SMALL["road.yaml"].replace("role: ego", "role: other"))
    assert complaint(folder) == (
        "road.yaml:19:3: agents: 0 agents have the role 'ego'; exactly one is required"
    )


def test_beams_open_upwards(write: Write) -> None:
    road = SMALL["road.yaml"].replace("pitch_deg: 10", "pitch_deg: 10, lidar_upper_deg: -30")
    assert "lidar_upper_deg: -30 is not above the rig's lower_deg -25" in complaint(
        write(road=road)
    )
    rig = SMALL["rig.yaml"].replace("lidar: {mount", "lidar: {upper_deg: -30, mount")
    assert "upper_deg -30 is not above lower_deg -25" in complaint(write(rig=rig))


def test_a_scenario_keeps_three_frames_at_least(write: Write) -> None:
    suite = SMALL["suite.yaml"] + "timing: {warm_up_ticks: 59, max_ticks: 60}\n"
    assert "leaves fewer than three frames" in complaint(write(suite=suite))


@pytest.mark.parametrize("field", ["id", "number"])
def test_agents_of_a_spec_are_told_apart(write: Write, tmp_path: Path, field: str) -> None:
    (spec,) = compile_library(write())
    data = json.loads(to_json(spec))
    data["agents"][1][field] = data["agents"][0][field]
    path = tmp_path / "twins.json"
    path.write_text(json.dumps(data))
    with pytest.raises(InputError, match=f"two agents have the same {field}"):
        read_spec(path)


def test_an_empty_folder_is_no_library(tmp_path: Path) -> None:
    assert "no declarations" in complaint(tmp_path)


def test_a_truncated_spec_is_told_with_its_place(write: Write, tmp_path: Path) -> None:
    (spec,) = compile_library(write())
    path = tmp_path / "cut.json"
    path.write_text(to_json(spec)[:-200])
    with pytest.raises(InputError, match=r"cut\.json:\d+:\d+: is not a spec.*is it truncated\?"):
        read_spec(path)


def test_a_spec_with_a_wrong_value_is_told_with_its_place(write: Write, tmp_path: Path) -> None:
    (spec,) = compile_library(write())
    data = json.loads(to_json(spec))
    data["weather"]["rain"]["rate_mm_h"] = 1000
    path = tmp_path / "wet.json"
    path.write_text(json.dumps(data, indent=1))
    with pytest.raises(
        DiagnosticsError, match=r"wet\.json:\d+:\d+: weather\.rain\.rate_mm_h: .*150"
    ):
        read_spec(path)


def test_numbers_that_json_does_not_know_are_refused(write: Write, tmp_path: Path) -> None:
    path = tmp_path / "nan.json"
    path.write_text('{"spec_version": NaN}')
    with pytest.raises(InputError, match="NaN is not a number in JSON"):
        read_spec(path)


def test_a_suite_has_its_rules_in_the_library(library: Path) -> None:
    suite = load_library(library).get_declarations(Suite)["adver_city"]
    assert (suite.selection.fatality_rate_percent, suite.coverage.junction_percent) == (0.3, 50)
