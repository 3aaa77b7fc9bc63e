from pathlib import Path

import pytest
from advercity_dsl import Spec

from advercity.compiler import (
    find_weather,
    to_json,
    with_weather,
)
from tests.builders import Compile

WEATHERS = (
    *("clear_day", "clear_night", "soft_rain_day", "soft_rain_night", "heavy_rain_day"),
    *("heavy_rain_night", "fog_day", "fog_night", "foggy_heavy_rain_day"),
    *("foggy_heavy_rain_night", "glare_day"),
)
FOG = "kind: weather\nid: fog\ntime: day\n"


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
def test_demand_is_that_of_the_original_dataset(
    specs: dict[str, Spec], name: str, vehicles: int, walkers: int
) -> None:
    assert (specs[name].demand.vehicles, specs[name].demand.walkers) == (vehicles, walkers)


def test_every_road_is_at_a_place_of_its_own(specs: dict[str, Spec]) -> None:
    roads = {spec.road.id: spec.road for spec in specs.values()}
    degrees = {(road.origin_lat_deg, road.origin_lon_deg) for road in roads.values()}
    assert len(degrees) == len(roads) == 5
    assert all(36 < lat < 45 and -98 < lon < -81 for lat, lon in degrees)  # in the United States


def test_weathers_of_one_road_and_density_have_one_traffic_seed(specs: dict[str, Spec]) -> None:
    seeds = {specs[f"ui_{weather}_sparse"].seeds.traffic for weather in WEATHERS}
    assert len(seeds) == 1
    assert specs["ui_fog_day_dense"].seeds.traffic not in seeds


def test_a_spec_under_another_weather_is_what_the_suite_compiles(specs: dict[str, Spec]) -> None:
    other = find_weather("glare_day")
    assert to_json(with_weather(specs["ri_fog_day_dense"], other)) == to_json(
        specs["ri_glare_day_dense"]
    )


def test_another_weather_with_draws_is_what_the_suite_compiles(
    compile_small: Compile, tmp_path: Path
) -> None:
    fog = FOG + "fog: {mor_m: {uniform: [50, 150]}}\n"
    specs = compile_small(fog=fog)
    entry = find_weather(str(tmp_path / "library" / "fog.yaml"))
    again = with_weather(specs["lane_clear_day_sparse"], entry)
    assert to_json(again) == to_json(specs["lane_fog_sparse"])
