"""Left-hand roads: their right-hand twins, and their networks in the world."""

from pathlib import Path

import numpy as np
import pytest
import shapely
from advercity_dsl import MapNetwork, Road, RoadsideUnit, Spec, Vehicle
from pydantic import ValidationError

from advercity.compiler.agent_places import complete_routes, find_place_problems, place_agents
from advercity.compiler.library import load_library
from advercity.geometry.mesh import Mesh
from advercity.roads.junction_arms import JunctionArms, MisplacedPartError
from advercity.roads.plan_frame import mirror_road, to_plan_frame, to_plan_spec
from advercity.roads.road_network import build_road
from tests.roads.imported_roads import AT_JUNCTION, compiled_suite
from tests.roads.left_hand_roads import AXIS_Y_M, STREET, build_street


@pytest.fixture(scope="module")
def crossroads(library: Path, tmp_path_factory: pytest.TempPathFactory) -> Road:
    """The crossroads of a right-hand map, its agents placed by arms."""
    specs = compiled_suite(library, tmp_path_factory.mktemp("crossroads"), AT_JUNCTION)
    return next(iter(specs.values())).road


def as_left_hand(road: Road, **changes: object) -> Road:
    """The road with its map's network taken for that of a mirrored left-hand map."""
    assert isinstance(road.imported, MapNetwork)
    imported = road.imported.model_copy(update={"driving_side": "left"})
    return road.model_copy(update={"imported": imported, **changes})


def test_the_mirror_image_of_a_mirror_image_is_the_road(library: Path, crossroads: Road):
    shipped = load_library(library).get_declarations(Road).values()
    for road in (*shipped, build_street(), crossroads):
        mirrored = mirror_road(road)

        assert mirrored != road
        assert mirrored.is_left_hand != road.is_left_hand
        assert mirror_road(mirrored) == road


def test_right_hand_roads_and_specs_are_their_own_plan(specs: dict[str, Spec]):
    spec = specs["ui_clear_day_sparse"]

    assert to_plan_spec(spec) is spec
    assert to_plan_frame(spec.road) is spec.road


def test_a_left_hand_road_is_mirrored_once():
    road = build_street()
    plan = to_plan_frame(road)

    assert plan is to_plan_frame(road)
    assert not plan.is_left_hand
    assert to_plan_frame(plan) is plan


def test_lanes_of_a_left_hand_street_are_left_of_its_axis():
    lanes = {lane.id: lane for lane in build_road(build_street()).lanes}

    along, against = lanes["main+.1"], lanes["main-.1"]
    assert along.left[0] == pytest.approx([-120, AXIS_Y_M + 3.5, 0])
    assert along.right[0] == pytest.approx([-120, AXIS_Y_M, 0])
    # Against the axis, which has turned to the south by its end.
    assert against.right[-1] == pytest.approx([-120, AXIS_Y_M, 0])
    assert against.left[-1] == pytest.approx([-120, AXIS_Y_M - 3, 0])
    assert along.left[-1, 1] < 0
    assert lanes["main+.parking1"].left[0] == pytest.approx([-120, AXIS_Y_M + 6, 0])


def test_the_network_of_a_left_hand_road_is_the_mirror_image_of_its_plan():
    road = build_street()
    network, plan = build_road(road), build_road(to_plan_frame(road))

    assert network.declaration is road
    assert network.paved_area.bounds == pytest.approx(mirror_bounds(plan.paved_area.bounds))
    assert network.roadway_level_area.area == pytest.approx(plan.roadway_level_area.area)
    assert network.street_axes.bounds == pytest.approx((-120, -17.6, 90.5, AXIS_Y_M), abs=0.1)
    for mesh in network.meshes:
        if mesh.semantic.name == "ROAD":
            assert (compute_normals(mesh)[:, 2] > 0).all(), "roadways are seen from above"
    for edge in network.paved_edges:
        middle, step = (edge[0] + edge[1])[:2] / 2, (edge[1] - edge[0])[:2]
        inside = middle + 0.1 * np.array([-step[1], step[0]]) / np.linalg.norm(step)
        assert shapely.contains_xy(network.paved_area, *inside), "paving is on the left"


def mirror_bounds(bounds: tuple[float, ...]) -> tuple[float, ...]:
    west, south, east, north = bounds
    return west, -north, east, -south


def compute_normals(mesh: Mesh) -> np.ndarray:
    a, b, c = (mesh.vertices[mesh.triangles[:, corner]] for corner in range(3))
    return np.cross(b - a, c - a)


def test_lights_and_signs_of_a_left_hand_map_are_mirrored(crossroads: Road):
    left, right = build_road(as_left_hand(crossroads)), build_road(crossroads)

    assert len(left.traffic_lights) == len(right.traffic_lights) > 4
    for one, other in zip(left.traffic_lights, right.traffic_lights, strict=True):
        assert one.id == other.id
        assert one.position_m == pytest.approx(np.multiply(other.position_m, (1, -1, 1)))
        assert one.mast_foot_m == pytest.approx(np.multiply(other.mast_foot_m, (1, -1)))
        assert one.facing == pytest.approx(np.multiply(other.facing, (1, -1)))
    for one, other in zip(left.traffic_signs, right.traffic_signs, strict=True):
        assert one.position_m == pytest.approx(np.multiply(other.position_m, (1, -1)))


def test_a_vehicle_on_the_wrong_side_is_told_where_the_lanes_are():
    agents = {"cav1": STREET["agents"]["cav1"] | {"spawn_m": [-100, AXIS_Y_M - 6]}}
    road = build_street(agents=agents)

    with pytest.raises(MisplacedPartError) as caught:
        complete_routes(road)

    text = str(caught.value)
    assert "no driving lane at -100, 4 leads 0 degrees from east" in text
    assert "main.1 at [-100.0, 8.5] heading 180" in text


def test_vehicles_on_the_left_have_a_place_and_a_route():
    road = complete_routes(build_street())

    assert not list(find_place_problems(road))
    assert road.agents["cav1"] == Vehicle.model_validate(
        STREET["agents"]["cav1"] | {"route": ("main",)}
    )


def test_arms_and_turns_are_those_of_the_world(crossroads: Road):
    declared = Road.model_validate(AT_JUNCTION | {"imported": crossroads.imported}).at_junction
    road = as_left_hand(crossroads, agents={}, at_junction=declared, ego_routes={})

    ([(placed, *_)], _) = place_agents(road)

    ego, other, unit = (placed.agents[name] for name in ("cav1", "cav2", "rsu"))
    assert isinstance(ego, Vehicle)
    assert isinstance(other, Vehicle)
    assert isinstance(unit, RoadsideUnit)
    # From the south, on the left, straight on.
    assert ego.heading_deg % 360 == pytest.approx(90, abs=1)
    assert ego.spawn_m == pytest.approx((-1.6, ego.spawn_m[1]), abs=0.3)
    assert ego.spawn_m[1] < -20
    assert ego.destination_m[1] > 20
    # From the arm at its left, which is the west, and to the right, which is the south.
    assert other.heading_deg % 360 == pytest.approx(0, abs=1)
    assert other.spawn_m[1] > 0
    assert other.destination_m[1] < -20
    # At the nearside of those who come from the north.
    assert unit.position_m[0] > 0
    assert unit.position_m[1] > 0
    turn = placed.ego_routes["left"]
    assert turn.destination_m[0] < -20
    arms = JunctionArms.of_road(placed, ego.junction or "").describe()
    assert f"{ego.route[0]} (south)" in arms


def test_a_map_has_its_own_driving_side(crossroads: Road):
    data = crossroads.model_dump(mode="json") | {"driving_side": "left"}

    with pytest.raises(ValidationError, match="'driving_side' comes from the map"):
        Road.model_validate(data)
