import pytest
from advercity_dsl import Spec

from advercity.compiler import (
    compare_specs,
)
from advercity.errors import InputError
from tests.builders import Compile, Write, describe_errors

SUITE = "kind: suite\nid: small\nrig: one_camera\ncatalogue: one_car\n"
FOG = "kind: weather\nid: fog\ntime: day\n"


def test_a_sweep_names_its_steps_by_value_and_keeps_the_traffic(compile_small: Compile) -> None:
    sweep = "sweep: {field: weather.fog.mor_m, from: 20 m, to: 1 km, count: 3, log: true}\n"
    specs = compile_small(suite=SUITE + sweep)
    assert {name: spec.weather.fog.mor_m for name, spec in specs.items()} == {
        "lane_clear_day_sparse_mor_m_20": 20,
        "lane_clear_day_sparse_mor_m_141": 141,
        "lane_clear_day_sparse_mor_m_1000": 1000,
    }
    assert len({spec.seeds.traffic for spec in specs.values()}) == 1


def test_two_sweeps_are_crossed(compile_small: Compile) -> None:
    sweeps = (
        "sweep: [{field: weather.fog.mor_m, values: [50 m, 90 m]},"
        " {field: density.vehicles, from: 1, to: 3, count: 3}]\n"
    )
    specs = compile_small(suite=SUITE + sweeps)
    assert {name: (s.weather.fog.mor_m, s.density.vehicles) for name, s in specs.items()} == {
        f"lane_clear_day_sparse_mor_m_{metres}_vehicles_{factor}": (metres, factor)
        for metres in (50, 90)
        for factor in (1, 2, 3)
    }
    spec = specs["lane_clear_day_sparse_mor_m_90_vehicles_2"]
    points = {point.field: point.value for point in spec.provenance.sweep_points}
    assert points == {"weather.fog.mor_m": 90, "density.vehicles": 2}
    assert Spec.model_validate_json(spec.model_dump_json()) == spec


@pytest.mark.parametrize(
    ("second", "message"),
    [
        ("{field: weather.fog.mor_m, values: [7]}", "sweep.1.field: 'weather.fog.mor_m' is swept"),
        ("{field: density.walkers, from: 1, to: 2, count: 101}", "sweep: crosses to 1,010 steps"),
        ("{field: density.vehicle, values: [1]}", "sweep.1.field: no such field"),
        ("{field: density.vehicles}", "sweep.1: has no values"),
    ],
)
def test_what_two_sweeps_cannot_be_is_told_at_the_one_at_fault(
    write: Write, second: str, message: str
) -> None:
    first = "{field: weather.fog.mor_m, from: 10, to: 100, count: 10}"
    assert message in describe_errors(write(suite=SUITE + f"sweep: [{first}, {second}]\n"))


@pytest.mark.parametrize(
    ("field", "ends", "values"),
    [
        ("weather.fog.mor_m", "from: 100, to: 0.4 km, count: 4", [100, 200, 300, 400]),
        ("weather.fog.mor_m", "from: 50, to: 20, count: 2", [50, 20]),
        ("rig.vehicle.lidar.channels", "from: 16, to: 33, count: 3", [16, 24, 33]),
    ],
)
def test_the_steps_of_a_sweep_are_equal_and_whole_where_the_field_is(
    compile_small: Compile, field: str, ends: str, values: list[float]
) -> None:
    suite = SUITE + f"sweep: {{field: {field}, {ends}}}\n"
    steps = {f"{value:g}" for value in values}
    assert {name.rsplit("_", 1)[1] for name in compile_small(suite=suite)} == steps


def test_a_sweep_may_vary_any_number_of_a_crossed_declaration(compile_small: Compile) -> None:
    for field, value, path in (
        ("road.streets.main.path.0.line_m", 180, "road.streets.main.path.0.line_m"),
        ("density.vehicles", 2.5, "density.vehicles"),
        ("rig.vehicle.camera.mounts.0.z_m", 1.2, "agents.0.sensors.camera.mounts.0.z_m"),
    ):
        suite = SUITE + f"sweep: {{field: {field}, values: [{value}]}}\n"
        (spec,) = compile_small(suite=suite).values()
        (plain,) = compile_small().values()
        found = {change: after for change, _, after in compare_specs(plain, spec)}
        assert found[path] == value


def test_a_suite_keeps_only_scenarios_that_meet_its_conditions(compile_small: Compile) -> None:
    night = "kind: weather\nid: dark\ntime: night\nsun: {elevation_deg: -30}\n"
    thick, thin = (
        FOG.replace("id: fog", f"id: fog{metres}") + f"fog: {{mor_m: {metres}}}\n"
        for metres in (40, 400)
    )
    weathers = {"dark": night, "thick": thick, "thin": thin}

    def kept(where: str) -> set[str]:
        specs = compile_small(suite=SUITE + f"where: {{{where}}}\n", **weathers)
        return {spec.weather.id for spec in specs.values()}

    assert kept("weather.time: night") == {"dark"}
    assert kept("weather.time: [day, night]") == {"dark", "clear_day", "fog40", "fog400"}
    assert kept("weather.fog.mor_m: {at_most: 0.1 km}") == {"fog40"}
    assert kept("weather.fog.mor_m: {at_least: 10}, road.land_use: rural") == {"fog40", "fog400"}


@pytest.mark.parametrize(("pairing", "seeds"), [("weather", 1), ("none", 2)])
def test_scenarios_that_are_not_paired_are_samples_of_their_own(
    compile_small: Compile, pairing: str, seeds: int
) -> None:
    specs = compile_small(suite=SUITE + f"pairing: {pairing}\n", fog=FOG)

    assert len(specs) == 2
    assert len({spec.seeds.traffic for spec in specs.values()}) == seeds
    assert len({spec.seeds.sensors for spec in specs.values()}) == seeds


def test_an_inherited_weather_to_react_in_is_removed_by_null(compile_small: Compile) -> None:
    paired = SUITE.replace("small", "paired") + "reaction_weather: clear_day\n"
    apart = "kind: suite\nid: small\nextends: paired\npairing: none\ndefault: true\n"

    specs = compile_small(paired=paired, suite=apart + "reaction_weather: null\n", fog=FOG)

    assert len({spec.seeds.traffic for spec in specs.values()}) == 2
    with pytest.raises(InputError, match="remove it \\(`null` where it is inherited\\)"):
        compile_small(paired=paired, suite=apart, fog=FOG)
