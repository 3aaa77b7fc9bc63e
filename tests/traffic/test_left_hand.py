"""Traffic on the left: the mirror image of its plan; what turns left and right in the world."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml
from advercity_dsl import Conflict, Road, Spec
from numpy.typing import NDArray

from advercity.compiler.crossing import compile_library
from advercity.compiler.library import load_library
from advercity.conflicts.binding import match_conflict
from advercity.conflicts.outcome import evaluate_outcomes
from advercity.frames import Lamp, Trace
from advercity.pipeline.descriptions import describe_road, describe_spec
from advercity.roads.mirrored_traffic import mirror_trace
from advercity.roads.plan_frame import mirror_conflict, mirror_place, mirror_road
from tests.roads.imported_roads import AT_JUNCTION, compiled_suite

EGO = 101


@pytest.fixture(scope="module")
def right(library: Path, tmp_path_factory: pytest.TempPathFactory) -> Spec:
    """A left turn across oncoming traffic at the crossroads of a right-hand map."""
    folder = tmp_path_factory.mktemp("crossroads")
    suite = {"roads": ["imported"], "cross_conflicts": ["ltap_od_ego_turns"]}
    (spec,) = compiled_suite(library, folder, AT_JUNCTION, **suite).values()
    return spec


@pytest.fixture(scope="module")
def left(right: Spec) -> Spec:
    """The same in the mirrored world, whose network is that of the map still."""
    changes = {
        "road": mirror_road(right.road),
        "agents": tuple(
            agent.model_copy(update={"place": mirror_place(agent.place)}) for agent in right.agents
        ),
        "conflicts": tuple(map(mirror_conflict, right.conflicts)),
    }
    return right.model_copy(update=changes)


Simulate = Callable[[Spec], Trace]


@pytest.mark.sumo
def test_the_trace_is_the_mirror_image(left: Spec, right: Spec, simulate: Simulate):
    trace, image = simulate(left), simulate(right)

    assert trace.compute_sha256() != image.compute_sha256()
    assert mirror_trace(trace).compute_sha256() == image.compute_sha256()
    for state, other in zip(
        trace.build_frame(40).states, image.build_frame(40).states, strict=True
    ):
        assert np.linalg.det(state.world_from_body[:3, :3]) == pytest.approx(1)
        assert state.box_centre == pytest.approx(other.box_centre * (1, -1, 1))


@pytest.mark.sumo
def test_the_crossing_turn_goes_to_the_right(left: Spec, simulate: Simulate):
    trace = simulate(left)
    _, ego = trace.get_track(EGO)

    assert left.conflicts[0].manoeuvre == "right"
    assert [item.missed for item in evaluate_outcomes(left, trace)] == [()]
    yaw = np.unwrap(ego["yaw"])
    assert yaw[-1] - yaw[0] == pytest.approx(-np.pi / 2, abs=0.2)
    turning = np.abs(ego["yaw_rate"]) > 0.2
    assert turning.any()
    assert (ego["yaw_rate"][turning] < 0).all()
    assert (ego["steering"][turning] < 0).all()
    rates = np.gradient(yaw, trace.tick_s)
    assert ego["yaw_rate"][turning] == pytest.approx(rates[turning], abs=0.15)
    assert (ego["lamps"] & Lamp.RIGHT).any()
    assert not (ego["lamps"] & Lamp.LEFT).any()


@pytest.mark.sumo
def test_vehicles_keep_left(left: Spec, simulate: Simulate):
    """On the arms, whose axes are those of the world: east of x = 30 is that of the east."""
    states = simulate(left).states
    vehicles = states[states["speed"] > 5]

    for along, across, first, second in (("x", "y", 0.0, np.pi), ("y", "x", np.pi / 2, -np.pi / 2)):
        on_arm = vehicles[(np.abs(vehicles[along]) > 30) & (np.abs(vehicles[across]) < 6)]
        sign = 1 if along == "x" else -1
        assert (sign * select(on_arm, first)[across] > 0).all()
        assert (sign * select(on_arm, second)[across] < 0).all()


def select(states: NDArray[np.void], heading: float) -> NDArray[np.void]:
    return states[np.cos(states["yaw"] - heading) > 0.99]


@pytest.fixture(scope="module")
def compiled_left(library: Path, tmp_path_factory: pytest.TempPathFactory) -> Spec:
    """A shipped road, mirrored by its declaration, with the same conflict."""
    folder = tmp_path_factory.mktemp("left")
    road = mirror_road(load_library(library).get_declarations(Road)["ri"])
    suite = {
        "kind": "suite",
        "id": "left",
        "roads": ["left"],
        "weathers": ["clear_day"],
        "densities": ["sparse"],
        "rig": "adver_city",
        "catalogue": "adver_city",
        "cross_conflicts": ["ltap_od_ego_turns"],
    }
    data = road.model_copy(update={"id": "left"}).model_dump(mode="json", exclude_none=True)
    for name, declared in (("road", data), ("suite", suite)):
        (folder / f"{name}.yaml").write_text(yaml.safe_dump(declared), encoding="utf-8")
    (spec,) = compile_library(library, folder, suite="left")
    return spec


def test_a_declared_road_is_compiled_in_its_world(compiled_left: Spec):
    (conflict,) = compiled_left.conflicts
    ego = compiled_left.road.ego

    assert compiled_left.road.driving_side == "left"
    assert conflict.manoeuvre == "right"
    # Where the ego goes from and to, and where it meets the other, are in one world.
    assert np.linalg.norm(np.subtract(ego.spawn_m, conflict.point_m)) < 150
    assert compiled_left.agents[0].place == ego
    assert describe_spec(compiled_left)["driving side"] == "left"
    assert describe_road(compiled_left.road)["driving side"] == "left"


def test_a_conflict_without_a_route_names_the_turn_of_the_world(library: Path):
    shipped = load_library(library)
    conflict = shipped.get_declarations(Conflict)["ltap_od_ego_turns"]
    road = shipped.get_declarations(Road)["ri"]
    through = road.ego_routes["straight"]
    ego = road.ego.model_copy(update=through.model_dump())
    agents = {name: ego if place is road.ego else place for name, place in road.agents.items()}
    road = road.model_copy(update={"agents": agents, "ego_routes": {}})

    for place, word in ((road, "left"), (mirror_road(road), "right")):
        found = match_conflict(conflict, place, called_for=True)

        assert found.standing == "invalid"
        assert found.reason.startswith(f"no route of the ego goes {word} ")
