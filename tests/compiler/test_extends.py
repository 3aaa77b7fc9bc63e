from advercity.compiler.crossing import compile_library
from tests.builders import Compile, Write

FOG = "kind: weather\nid: fog\ntime: day\n"


def test_extends_merges_mappings_and_replaces_the_rest(write: Write) -> None:
    folder = write(
        weather="kind: weather\nid: fog_day\ntime: day\nfog: {mor_m: 75, droplet_um: 20}\n",
        thick="kind: weather\nid: thick\nextends: fog_day\nfog: {mor_m: 40 m}\n",
    )
    weathers = {spec.weather.id: spec.weather for spec in compile_library(folder)}
    assert (weathers["thick"].fog.mor_m, weathers["thick"].fog.droplet_um) == (40, 20)


def test_a_declaration_may_extend_several_that_agree(compile_small: Compile) -> None:
    specs = compile_small(
        fog=FOG + "title: Fog\nfog: {mor_m: 75, depth_m: 20}\n",
        windy="kind: weather\nid: windy\ntime: day\nwind: {speed_m_s: 9}\n",
        both="kind: weather\nid: both\nextends: [fog, windy]\nfog: {mor_m: 40}\n",
    )
    weather = specs["lane_both_sparse"].weather
    assert (weather.fog.mor_m, weather.fog.depth_m, weather.wind.speed_m_s) == (40, 20, 9)
    assert weather.title == ""


def test_null_removes_an_inherited_component(compile_small: Compile) -> None:
    specs = compile_small(
        fog=FOG + "fog: {mor_m: 75}\n",
        none="kind: weather\nid: none\nextends: fog\nfog: null\n",
    )
    assert specs["lane_none_sparse"].weather.fog.mor_m is None
