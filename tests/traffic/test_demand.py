"""Who takes part in traffic, where they start, how fast they go and where their bodies are."""

from pathlib import Path

import numpy as np
import pytest
from advercity_dsl import Spec

from advercity.errors import InputError, RunError
from advercity.frames import FRONT_DTYPE, Actor, Lamp
from advercity.roads.lane_graph import LaneGraph, read_lane_graph
from advercity.traffic.demand import VehicleTrip
from advercity.traffic.kinematics import compute_vehicle_states, compute_walker_states
from advercity.traffic.placement import (
    LaneOccupancy,
    StartArea,
    compute_start_areas,
    iterate_start_positions,
)
from advercity.traffic.speed_profile import (
    BRAKING_M_S2,
    LATERAL_ACCELERATION_M_S2,
    SpeedLimiter,
    SpeedProfile,
)

ARC = [(100 + 20 * np.sin(turn), 20 - 20 * np.cos(turn)) for turn in np.linspace(0, np.pi / 2, 40)]
BEND = " ".join(f"{x:.3f},{y:.3f},1" for x, y in ARC)
NETWORK = f"""<net>
<edge id="west"><lane id="west_0" index="0" speed="10" length="100" shape="0,-5,1 100,-5,1"
    allow="pedestrian"/>
  <lane id="west_1" index="1" speed="10" length="100" shape="0,0,1 100,0,1"
    disallow="pedestrian"/></edge>
<edge id=":j_0" function="internal"><lane id=":j_0_0" index="0" speed="10" length="31.4"
    shape="{BEND}"/></edge>
<edge id=":j_w0" function="walkingarea"><lane id=":j_w0_0" index="0" speed="1" length="3"
    allow="pedestrian" shape="100,-5 103,-5"/></edge>
<edge id=":j_c0" function="crossing"><lane id=":j_c0_0" index="0" speed="1" length="7"
    allow="pedestrian" shape="103,-5 103,5"/></edge>
<edge id=":j_w1" function="walkingarea"><lane id=":j_w1_0" index="0" speed="1" length="3"
    allow="pedestrian" shape="103,5 106,5"/></edge>
<edge id="north"><lane id="north_0" index="0" speed="10" length="50" shape="120,20,1 120,70,3"
    disallow="pedestrian"/></edge>
<edge id="path"><lane id="path_0" index="0" speed="1" length="40" shape="103,5,1 103,45,1"
    allow="pedestrian"/></edge>
<edge id="back"><lane id="back_0" index="0" speed="1" length="40" shape="100,-5,1 100,-45,1"
    allow="pedestrian"/></edge>
<connection from="west" to="north" fromLane="1" toLane="0" via=":j_0_0" dir="l"/>
<connection from=":j_0" to="north" fromLane="0" toLane="0" dir="l"/>
<connection from="west" to=":j_w0" fromLane="0" toLane="0" dir="s"/>
<connection from=":j_w0" to="back" fromLane="0" toLane="0" dir="s"/>
<connection from=":j_w0" to=":j_c0" fromLane="0" toLane="0" dir="s"/>
<connection from=":j_c0" to=":j_w1" fromLane="0" toLane="0" dir="s"/>
<connection from=":j_w1" to="path" fromLane="0" toLane="0" dir="s"/>
</net>"""


@pytest.fixture
def graph(tmp_path: Path) -> LaneGraph:
    (tmp_path / "net.xml").write_text(NETWORK)
    return read_lane_graph(tmp_path / "net.xml")


def test_what_is_no_network_is_refused(tmp_path: Path):
    (tmp_path / "net.xml").write_text("<net><edge>")

    with pytest.raises(RunError, match="not a SUMO network"):
        read_lane_graph(tmp_path / "net.xml")


def test_lanes_are_told_apart_by_who_may_use_them(graph: LaneGraph):
    assert [lane.id for lane in graph.driving_lanes] == ["west_1", "north_0"]
    assert [lane.id for lane in graph.entry_lanes] == ["west_1"]
    assert set(graph.sidewalks) == {"west", "path", "back"}


def test_a_pose_finds_the_lane_that_leads_its_way(graph: LaneGraph):
    lane, position = graph.find_lane((40.0, 0.6), 0.1)

    assert (lane.id, position) == ("west_1", pytest.approx(40.0))
    with pytest.raises(InputError, match=r"no driving lane at 40, 0\.6"):
        graph.find_lane((40.0, 0.6), np.pi)


def test_crossings_are_walked_only_where_that_is_allowed(graph: LaneGraph):
    assert graph.find_adjacent_sidewalks(use_crossings=False)["west"] == ("back",)
    assert graph.find_adjacent_sidewalks(use_crossings=True)["west"] == ("back", "path")
    assert graph.find_adjacent_sidewalks(use_crossings=True)["path"] == ("back", "west")


def test_there_is_an_area_around_every_agent_and_along_every_path(specs: dict[str, Spec]):
    found = compute_start_areas(specs["ui_clear_day_sparse"])

    assert len(found) == 8
    assert found[0].low == pytest.approx((-56.44, -96.45))
    assert found[0].high == pytest.approx((43.56, 3.55))
    assert found[5].low == pytest.approx((-6.44 - 15, -134.08 - 15))
    assert found[5].high == pytest.approx((64.96 + 15, -46.45 + 15))


def test_places_lie_in_the_areas_a_grid_step_apart(graph: LaneGraph):
    places = list(iterate_start_positions(graph.driving_lanes, [StartArea((10, -1), (40, 1))], 8.0))

    assert [(lane.id, position) for lane, position in places] == [
        ("west_1", position) for position in (12.0, 20.0, 28.0, 36.0)
    ]


def test_vehicles_start_five_metres_apart_and_clear_of_junctions(graph: LaneGraph):
    lane, occupancy = graph.driving_lanes[0], LaneOccupancy()
    occupancy.occupy(lane, 50.0, 4.0)

    assert occupancy.has_room(lane, 59.0, 4.0)
    assert not occupancy.has_room(lane, 58.9, 4.0)
    assert not occupancy.has_room(lane, 41.1, 4.0)
    assert occupancy.has_room(lane, 95.5, 4.0)
    assert not occupancy.has_room(lane, 95.6, 4.0)
    assert not occupancy.has_room(lane, 4.4, 4.0)


def test_a_bend_is_taken_at_bearable_speed_and_braked_for_in_time(graph: LaneGraph):
    car = Actor(1001, "car", "sedan", "car_paint_red", (4.0, 1.8, 1.5))
    profile = SpeedProfile.from_trip(
        VehicleTrip(car, ("west", "north"), 1, 10.0, 0.0, 0.0, 1.0, 30.0), graph
    )
    in_bend = np.sqrt(LATERAL_ACCELERATION_M_S2 * 20.0)

    def limit(edge: str, position_m: float) -> float | None:
        return SpeedLimiter(profile, 40.0, lambda: (edge, position_m)).update(0.0)

    before = np.sqrt(in_bend**2 + 2 * BRAKING_M_S2 * 30.0)
    assert limit(":j_0", 15.0) == pytest.approx(in_bend, rel=0.03)
    assert limit("west", 70.0) == pytest.approx(before, rel=0.03)
    assert (limit("north", 30.0) or 0.0) > 30.0
    assert limit("elsewhere", 0.0) == 40.0


def test_a_vehicle_is_located_only_when_it_may_have_left_its_edge():
    profile = SpeedProfile(
        {"first": 0.0, "next": 10.0}, {"first": 10.0, "next": 20.0}, [20.0, *range(30)]
    )
    positions, located = iter([("first", 2.0), ("first", 9.5), ("next", 0.5)]), list[str]()

    def locate() -> tuple[str, float]:
        edge, position_m = next(positions)
        located.append(edge)
        return edge, position_m

    limiter = SpeedLimiter(profile, 12.5, locate)
    assert (limiter.update(0.0), len(located)) == (1.0, 1)
    assert (limiter.update(1.5), len(located)) == (2.5, 1)
    assert (limiter.update(0.0), len(located)) == (None, 1)
    assert (limiter.update(6.5), len(located)) == (8.5, 2)
    assert (limiter.update(1.0), len(located)) == (9.5, 3)
    assert (limiter.update(4.0), len(located)) == (12.5, 3)
    assert (limiter.update(0.5), len(located)) == (None, 3)


def track(**columns: np.ndarray) -> np.ndarray:
    fronts = np.zeros(len(next(iter(columns.values()))), dtype=FRONT_DTYPE)
    fronts["tick"] = np.arange(len(fronts))
    for name, column in columns.items():
        fronts[name] = column
    return fronts


def test_a_body_on_a_slope_hangs_between_its_bumpers():
    slope, along = np.arctan(0.1), np.arange(0.0, 20.0)
    climbing = track(x=along, z=0.1 * along, slope=np.full(20, slope), speed=np.full(20, 10.0))

    states = compute_vehicle_states(climbing, 4.0, tick_s=0.1)

    np.testing.assert_allclose(states["x"], along - 2.0, atol=0.02)
    np.testing.assert_allclose(states["z"], 0.1 * (along - 2.0), atol=0.005)
    np.testing.assert_allclose(states["pitch"], -slope, rtol=0.01)


def test_a_body_noses_over_a_crest_when_its_front_does():
    along = np.arange(0.0, 20.0)
    over = track(x=along, z=-np.maximum(along - 10.0, 0.0) * 0.1, speed=np.full(20, 10.0))

    states = compute_vehicle_states(over, 4.0, tick_s=0.1)

    # With axles 0.8 and 3.2 m behind the front, the front one is 1.2 m past the crest at tick 12.
    np.testing.assert_allclose(states["pitch"][:11], 0.0, atol=1e-12)
    assert states["pitch"][12] == pytest.approx(np.arcsin(0.12 / 2.4))
    assert states["z"][12] == pytest.approx(-0.06)


def test_a_vehicle_that_stands_neither_slides_nor_turns():
    sliding = track(y=0.05 * np.arange(20.0), yaw=0.1 * np.arange(20.0))

    states = compute_vehicle_states(sliding, 4.0, tick_s=0.1)

    np.testing.assert_allclose(states["x"], -2.0)
    np.testing.assert_allclose(states["y"], 0.0)
    np.testing.assert_allclose(states["yaw"], 0.0)


def test_brake_lamps_say_whether_the_brakes_are_on():
    acceleration = np.array([0.0] * 5 + [-2.0] * 10 + [0.0] * 5 + [1.0] * 5)
    speed = np.array([10.0] * 5 + [5.0] * 10 + [0.0] * 5 + [0.1, 0.2, 0.3, 0.4, 0.5])
    moving = track(acceleration=acceleration, speed=speed, lamps=np.full(25, Lamp.LEFT))

    lamps = compute_vehicle_states(moving, 4.0, tick_s=0.1)["lamps"]

    assert (lamps & Lamp.LEFT > 0).all()
    # The mean over five ticks passes -0.3 m/s² two ticks before it brakes, and 0.3 one tick before
    # it moves off.
    assert (lamps & Lamp.BRAKE > 0).tolist() == [False] * 3 + [True] * 16 + [False] * 6


def test_people_neither_hop_nor_spin():
    hopping = np.where(np.arange(60) < 20, 0.0, 2.0)
    yaw = np.where(np.arange(60) < 40, 0.0, np.pi)

    states = compute_walker_states(
        track(x=0.1 * np.arange(60.0), y=hopping, yaw=yaw),
        0.4,
        speed_m_s=1.0,
        tick_s=0.1,
        kerb_height=lambda places: np.where(places.real < 3.0, 0.15, 0.0),
    )

    steps = np.hypot(np.diff(states["x"]), np.diff(states["y"]))
    assert steps.max() <= 0.13 + 1e-9
    np.testing.assert_allclose(states["speed"][1:], steps / 0.1)
    assert np.abs(np.diff(states["yaw"])).max() <= np.pi * 0.1 + 1e-9
    assert (states["z"][0], states["z"][-1]) == (pytest.approx(0.15), 0.0)
    assert states["y"][50] == pytest.approx(2.0, abs=0.05)


def test_whoever_stands_keeps_looking_the_same_way():
    states = compute_walker_states(
        track(x=np.zeros(10), yaw=np.full(10, 1.0)),
        0.4,
        speed_m_s=1.0,
        tick_s=0.1,
        kerb_height=lambda places: np.zeros(len(places)),
    )

    np.testing.assert_allclose(states["yaw"], 1.0)
    np.testing.assert_allclose(states["speed"], 0.0)
