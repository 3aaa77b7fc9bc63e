"""Staged conflicts: what the library stages, and what becomes of it in SUMO."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from advercity_dsl import Spec

from advercity.traffic import Trace, simulate
from advercity.traffic.encounters import overlaps
from advercity.traffic.outcomes import outcomes
from advercity.world.network import build_network

pytestmark = pytest.mark.sumo
ROADS = ("ui", "unj", "ri", "rsnj", "rcnj")
Simulated = Callable[[str], Trace]


@pytest.fixture(scope="module")
def simulated(specs: dict[str, Spec], tmp_path_factory: pytest.TempPathFactory) -> Simulated:
    """The trace of a spec."""
    folder = tmp_path_factory.mktemp("staged")
    traces: dict[str, Trace] = {}

    def trace(name: str) -> Trace:
        if name not in traces:
            traces[name] = simulate(specs[name], build_network(specs[name].road, folder))
        return traces[name]

    return trace


@pytest.mark.parametrize("road", ROADS)
def test_the_conflicts_of_a_road_happen_and_nobody_touches_anybody(
    road: str, specs: dict[str, Spec], simulated: Simulated
):
    spec = specs[f"{road}_clear_day_sparse"]

    trace = simulated(spec.id)

    assert [(item.conflict, item.missed) for item in outcomes(spec, trace)] == [
        (conflict.conflict, ()) for conflict in spec.conflicts
    ]
    assert list(overlaps(trace)) == []


def test_staging_leaves_as_many_people_and_vehicles_as_were_asked_for(
    specs: dict[str, Spec], simulated: Simulated
):
    spec = specs["unj_clear_day_sparse"]

    classes = [actor.actor_class for actor in simulated(spec.id).actors]

    assert classes.count("pedestrian") == spec.demand.walkers
    assert len(classes) - classes.count("pedestrian") <= spec.demand.vehicles + 3


def test_staging_is_the_same_on_every_run(specs: dict[str, Spec], tmp_path: Path):
    spec = specs["ri_clear_day_sparse"]
    network = build_network(spec.road, tmp_path)

    first, second = simulate(spec, network), simulate(spec, network)

    np.testing.assert_array_equal(first.states, second.states)
    assert first.actors == second.actors


def test_every_weather_of_a_road_and_density_stages_the_same(specs: dict[str, Spec]):
    for road in ROADS:
        for density in ("sparse", "dense"):
            first, *others = (
                spec.conflicts
                for spec in specs.values()
                if spec.road.id == road and spec.density.id == density
            )
            assert len(first) >= 1
            assert others == [first] * 10


def test_every_spec_stages_each_group_that_its_road_is_there_for(specs: dict[str, Spec]):
    for spec in specs.values():
        staged = {conflict.typology for conflict in spec.conflicts}
        assert staged == {group.typology for group in spec.groups}


def test_an_actor_that_stops_short_lets_the_ego_go_first(
    specs: dict[str, Spec], simulated: Simulated
):
    spec = specs["ri_clear_day_sparse"]
    trace = simulated(spec.id)
    numbers = np.array([actor.id for actor in trace.actors])[trace.states["actor"]]

    for conflict in spec.conflicts:
        passes = [
            np.argmin(np.hypot(*(_middles(trace, numbers, number) - conflict.point_m).T))
            for number in (101, conflict.actors[0].number)
        ]
        assert passes[0] < passes[1]


def _middles(trace: Trace, numbers: np.ndarray, number: int) -> np.ndarray:
    rows = trace.states[numbers == number]
    return np.column_stack([rows["x"], rows["y"]])
