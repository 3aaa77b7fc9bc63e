import numpy as np

from advercity.compiler import (
    to_json,
)
from tests.builders import Compile

SUITE = "kind: suite\nid: small\nrig: one_camera\ncatalogue: one_car\n"
FOG = "kind: weather\nid: fog\ntime: day\n"


def test_a_uniform_number_is_drawn_within_its_bounds_and_recorded(compile_small: Compile) -> None:
    spec = compile_small(fog=FOG + "fog: {mor_m: {uniform: [50, 0.15 km]}}\n")["lane_fog_sparse"]
    assert spec.weather.fog.mor_m is not None
    assert 50 <= spec.weather.fog.mor_m <= 150
    assert to_json(spec).count('"uniform": [50.0, 150.0]') == 1


def test_another_weather_does_not_change_the_draws(compile_small: Compile) -> None:
    fog = FOG + "fog: {mor_m: {uniform: [50, 150]}}\n"
    alone = compile_small(fog=fog)["lane_fog_sparse"]
    other = fog.replace("id: fog", "id: aaa")
    assert to_json(compile_small(fog=fog, aaa=other)["lane_fog_sparse"]) == to_json(alone)


def test_each_scenario_and_field_has_its_own_draw(compile_small: Compile) -> None:
    fog = FOG + "fog: {mor_m: {uniform: [50, 150]}, depth_m: {uniform: [50, 150]}}\n"
    dense = "kind: density\nid: dense\nvehicles: 2\nwalkers: 2\n"
    specs = compile_small(fog=fog, dense=dense)
    drawn = [
        value
        for name in ("lane_fog_sparse", "lane_fog_dense")
        for value in (specs[name].weather.fog.mor_m, specs[name].weather.fog.depth_m)
    ]
    assert len(set(drawn)) == 4


def test_each_repeat_has_its_own_weather_and_its_own_traffic(compile_small: Compile) -> None:
    fog = FOG + "fog: {mor_m: {uniform: [50, 150]}}\nrain: {rate_mm_h: {uniform: [1, 9]}}\n"
    specs = compile_small(fog=fog, suite=SUITE + "repeats: 4\n")
    repeats = [specs[f"lane_fog_sparse_r{number}"] for number in range(1, 5)]
    assert len({spec.weather.fog.mor_m for spec in repeats}) == 4
    assert len({spec.weather.rain.rate_mm_h for spec in repeats}) == 4
    assert len({spec.seeds.traffic for spec in repeats}) == 4


def test_draws_depend_on_the_seed_of_the_suite(compile_small: Compile) -> None:
    fog = FOG + "fog: {mor_m: {uniform: [50, 150]}}\n"
    one = compile_small(fog=fog)["lane_fog_sparse"]
    other = compile_small(fog=fog, suite=SUITE + "seeds: {weather: 2}\n")["lane_fog_sparse"]
    assert one.weather.fog.mor_m != other.weather.fog.mor_m
    assert one.seeds.traffic == other.seeds.traffic


def test_draws_follow_their_distributions(compile_small: Compile) -> None:
    bell = "{normal: {mean: 100, sd: 10, within: [90, 120]}}"
    fog = FOG + f"fog: {{mor_m: {{uniform: [50, 150]}}, depth_m: {bell}}}\n"
    fog += "sky: {oktas: {choice: [2, 7]}}\n"
    seeds = [SUITE + f"seeds: {{weather: {seed}}}\n" for seed in range(120)]
    drawn = [compile_small(fog=fog, suite=seed)["lane_fog_sparse"].weather for seed in seeds]
    visibility = np.array([weather.fog.mor_m for weather in drawn])
    depth = np.array([weather.fog.depth_m for weather in drawn])
    assert abs(visibility.mean() - 100) < 4 * 29 / np.sqrt(120)
    assert visibility.min() < 60
    assert visibility.max() > 140
    assert depth.min() >= 90
    assert depth.max() <= 120
    assert 2.5 < depth.std() < 9
    assert {weather.sky.oktas for weather in drawn} == {2, 7}
