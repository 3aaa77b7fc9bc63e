"""Traffic on the shipped roads: it starts where it should, moves as it can, and ends."""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from advercity_dsl import Spec, Vehicle
from numpy.typing import NDArray

from advercity.errors import InputError, RunError
from advercity.frames import Actor, Frame, Lamp, Signal, Trace
from advercity.geometry.poses import to_yaw_pitch_roll
from advercity.roads.lane_graph import read_lane_graph
from advercity.roads.network_file import LaneConnection, read_network
from advercity.roads.sumo_network import write_sumo_network
from advercity.traffic.demand import draw_demand
from advercity.traffic.simulation import simulate_in_subprocess

pytestmark = pytest.mark.sumo
ROADS = ("ui", "unj", "ri", "rsnj", "rcnj")
EGO = 101
Simulated = Callable[[str], Trace]


@pytest.fixture(scope="module")
def networks(specs: dict[str, Spec], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("networks")
    return {
        road: write_sumo_network(specs[f"{road}_clear_day_sparse"].road, folder) for road in ROADS
    }


@pytest.fixture(scope="module")
def simulated(specs: dict[str, Spec], simulate: Callable[[Spec], Trace]) -> Simulated:
    """Trace of a road and density under a clear sky."""

    def load_trace(name: str) -> Trace:
        road, density = name.split("_")
        return simulate(specs[f"{road}_clear_day_{density}"])

    return load_trace


def with_timing(spec: Spec, **timing: int) -> Spec:
    """A spec with other times; it stages nothing, since the ego may not get that far."""
    timed = spec.timing.model_copy(update=timing)
    return spec.model_copy(update={"timing": timed, "conflicts": ()})


def with_demand(spec: Spec, **demand: float) -> Spec:
    return spec.model_copy(update={"demand": spec.demand.model_copy(update=demand)})


def ego_of(spec: Spec) -> Vehicle:
    return spec.road.ego


def track(trace: Trace, actor: Actor) -> NDArray[np.void]:
    return trace.states[trace.states["actor"] == trace.actors.index(actor)]


def actor(trace: Trace, number: int) -> Actor:
    return next(actor for actor in trace.actors if actor.id == number)


def vehicles(trace: Trace) -> list[Actor]:
    return [actor for actor in trace.actors if actor.actor_class != "pedestrian"]


def boxes(frame: Frame) -> list[shapely.Polygon]:
    found: list[shapely.Polygon] = []
    for state in frame.states:
        length, width, _ = state.actor.size
        corners = np.array([[1, 1, 0, 2], [1, -1, 0, 2], [-1, -1, 0, 2], [-1, 1, 0, 2]]) / 2
        world = corners * [length, width, 1, 1] @ state.world_from_body.T
        found.append(shapely.Polygon(world[:, :2]))
    return found


@pytest.mark.parametrize("density", ["sparse", "dense"])
@pytest.mark.parametrize("road", ROADS)
def test_connected_vehicles_are_there_in_every_frame(simulated: Simulated, road: str, density: str):
    trace = simulated(f"{road}_{density}")

    numbers = np.array([actor.id for actor in trace.actors])[trace.states["actor"]]
    for connected in (101, 102, 103):
        ticks = trace.states["tick"][numbers == connected]
        np.testing.assert_array_equal(ticks, np.arange(len(trace)))


def test_a_trace_does_not_depend_on_the_processor(
    specs: dict[str, Spec],
    networks: dict[str, Path],
    simulated: Simulated,
    request: pytest.FixtureRequest,
):
    here = simulated("rcnj_sparse")

    request.getfixturevalue("older_processor")
    elsewhere = simulate_in_subprocess(specs["rcnj_clear_day_sparse"], networks["rcnj"])

    assert elsewhere.compute_sha256() == here.compute_sha256()


@pytest.mark.parametrize("road", ROADS)
def test_connected_vehicles_start_at_rest_where_they_were_put(
    road: str, specs: dict[str, Spec], networks: dict[str, Path]
):
    spec = with_timing(specs[f"{road}_clear_day_sparse"], warm_up_ticks=0, max_ticks=3)

    frame = simulate_in_subprocess(spec, networks[road]).build_frame(0)

    graph = read_lane_graph(networks[road])
    for agent in spec.agents:
        if isinstance(agent.place, Vehicle):
            lane, position = graph.find_lane(
                agent.place.spawn_m, np.radians(agent.place.heading_deg)
            )
            pose = frame.get_state(agent.number).world_from_body
            turned = to_yaw_pitch_roll(pose)[0] - lane.line.headings_at(position)
            assert np.linalg.norm(pose[:2, 3] - lane.line.points_at(position)[:2]) < 0.3
            assert abs(np.angle(np.exp(1j * turned), deg=True)) < 2.0
            # A change of 2.5 m/s² in acceleration begins 0.6 s early.
            assert frame.get_state(agent.number).speed_m_s < 0.4


@pytest.mark.parametrize("road", ROADS)
def test_the_scenario_ends_as_a_connected_vehicle_comes_near_its_destination(
    road: str, specs: dict[str, Spec], simulated: Simulated
):
    spec, trace = specs[f"{road}_clear_day_sparse"], simulated(f"{road}_sparse")

    assert 50 < len(trace) < spec.timing.max_ticks - spec.timing.warm_up_ticks
    # Any of the connected vehicles ends it, since all take part in every frame.
    beyond_m: list[float] = []
    for agent in spec.agents:
        if isinstance(agent.place, Vehicle):
            last = track(trace, actor(trace, agent.number))[-1]
            gap = np.abs(np.array([last["x"], last["y"]]) - agent.place.destination_m).max()
            assert last["tick"] == len(trace) - 1
            beyond_m.append(gap - 1.5 * last["speed"] * trace.tick_s)
    assert min(beyond_m) < 10.0
    assert trace.build_frame(0).time_s == pytest.approx(6.0)


@pytest.mark.parametrize("road", ROADS)
def test_no_vehicle_jumps_spins_or_moves_as_none_can(
    road: str, specs: dict[str, Spec], simulated: Simulated
):
    spec, trace = specs[f"{road}_clear_day_sparse"], simulated(f"{road}_sparse")
    fastest = max(street.speed_limit_km_h for street in spec.road.streets.values()) / 3.6 * 1.4

    for one in trace.actors:
        rows = track(trace, one)
        assert (np.diff(rows["tick"]) == 1).all(), one
        steps = np.hypot(np.diff(rows["x"]), np.diff(rows["y"]))
        turns = np.abs((np.diff(rows["yaw"]) + np.pi) % (2 * np.pi) - np.pi)
        assert (steps <= 1.3 * rows["speed"][1:] * trace.tick_s + 0.12).all(), one
        assert turns.max(initial=0) < np.radians(18.1), one
        if one.actor_class != "pedestrian":
            # SUMO counts along the lane's middle: outside of a bend a vehicle goes farther.
            assert rows["speed"].max() <= 1.02 * fastest, one
            assert rows["acceleration"].min() >= -7.1 and rows["acceleration"].max() <= 2.9, one


@pytest.mark.parametrize("road", ROADS)
def test_connected_vehicles_keep_to_their_cruising_speed(
    road: str, specs: dict[str, Spec], simulated: Simulated
):
    trace = simulated(f"{road}_sparse")

    for agent in specs[f"{road}_clear_day_sparse"].agents:
        if isinstance(agent.place, Vehicle):
            speeds = track(trace, actor(trace, agent.number))["speed"]
            assert speeds.max() <= (agent.place.max_speed_km_h - 1) / 3.6 + 0.01


@pytest.mark.parametrize("name", [*(f"{road}_sparse" for road in ROADS), "ui_dense"])
def test_boxes_of_vehicles_never_overlap(name: str, simulated: Simulated):
    trace = simulated(name)

    for index in range(0, len(trace), 20):
        frame = trace.build_frame(index)
        pairs = [
            (box, state.actor.towed_by or state.actor.id)
            for box, state in zip(boxes(frame), frame.states, strict=True)
            if state.actor.actor_class != "pedestrian"
        ]
        solid, ids = [box for box, _ in pairs], [number for _, number in pairs]
        for first, second in shapely.STRtree(solid).query(solid, predicate="overlaps").T:
            if ids[first] == ids[second]:
                continue  # a semi-trailer lies over its tractor unit
            overlap = solid[first].intersection(solid[second]).area
            assert overlap < 0.02, (index, first, second)


@pytest.mark.parametrize("road", ROADS)
def test_vehicles_are_on_their_lane(road: str, networks: dict[str, Path], simulated: Simulated):
    trace, graph = simulated(f"{road}_sparse"), read_lane_graph(networks[road])
    lanes = [lane for lane in graph.lanes.values() if lane.permits("passenger")]

    for state in trace.build_frame(0).states:
        if state.actor.actor_class != "pedestrian":
            x, y, z = state.world_from_body[:3, 3].tolist()
            lane = min(lanes, key=lambda lane: lane.line.project_point((x, y))[1])
            assert z == pytest.approx(
                lane.line.points_at(lane.line.project_point((x, y))[0])[2], abs=0.1
            )


def test_the_same_spec_gives_the_same_bytes_under_any_weather(
    specs: dict[str, Spec], networks: dict[str, Path], simulated: Simulated, tmp_path: Path
):
    simulated("rcnj_sparse").save(tmp_path / "clear.npz")
    simulate_in_subprocess(specs["rcnj_fog_night_sparse"], networks["rcnj"]).save(
        tmp_path / "fog.npz"
    )

    assert (tmp_path / "clear.npz").read_bytes() == (tmp_path / "fog.npz").read_bytes()


def test_another_seed_gives_other_traffic(specs: dict[str, Spec], networks: dict[str, Path]):
    spec = with_timing(specs["ri_clear_day_dense"], max_ticks=70)
    other = spec.model_copy(update={"seeds": spec.seeds.model_copy(update={"traffic": 7})})

    first, second = (simulate_in_subprocess(each, networks["ri"]) for each in (spec, other))

    assert first.actors != second.actors


def test_almost_everybody_who_is_asked_for_takes_part(specs: dict[str, Spec], simulated: Simulated):
    for density in ("sparse", "dense"):
        trace, demand = simulated(f"ui_{density}"), specs[f"ui_clear_day_{density}"].demand
        numbers = [one.id for one in trace.actors]

        assert numbers[:3] == [101, 102, 103]
        background = sum(1000 < number < 5000 for number in numbers)
        assert 0.85 * demand.vehicles <= background <= demand.vehicles
        assert sum(5000 < number < 10_000 for number in numbers) == demand.walkers


def test_vehicles_are_drawn_from_the_catalogue_that_fits_the_place(
    specs: dict[str, Spec], simulated: Simulated
):
    urban, rural = simulated("ui_dense"), simulated("ri_sparse")
    blueprints = specs["ui_clear_day_dense"].blueprints

    assert {one.actor_class for one in vehicles(urban)} == {
        "car",
        "van",
        "truck",
        "bicycle",
        "motorcycle",
    }
    assert all(blueprints[one.blueprint].land_use != "urban" for one in vehicles(rural))


def test_the_ego_comes_at_red_and_turns_left_on_green(simulated: Simulated):
    trace = simulated("ui_sparse")
    rows = track(trace, actor(trace, EGO))
    stop_line_y = -118.3
    crosses = int(np.argmax(rows["y"] < stop_line_y))

    # The lights are timed for its conflict: it has green before it would have to stop. As long as
    # they are red, it could stop in front of the line with little more than its usual 3 m/s2.
    assert rows["speed"][:crosses].min() < 0.5 * rows["speed"][:crosses].max()
    light = trace.signals[:, trace.signal_ids.index("j_main/north_road")]
    red = rows[: int(np.argmax(light != Signal.RED))]
    room_m = red["y"] - actor(trace, EGO).size[0] / 2 - stop_line_y
    assert len(red) > 30 and room_m.min() > 0
    assert (red["speed"] ** 2 / (2 * room_m)).max() < 3.5
    assert trace.build_frame(0).signals["j_main/north_road"] is Signal.RED
    assert trace.build_frame(crosses).signals["j_main/north_road"] is Signal.GREEN
    assert trace.build_frame(crosses).get_state(EGO).lamps & Lamp.LEFT
    assert not trace.build_frame(len(trace) - 1).get_state(EGO).lamps & Lamp.LEFT
    assert np.degrees(rows["yaw"][-1] - rows["yaw"][0]) % 360 == pytest.approx(90, abs=5)


def test_one_approach_has_green_at_a_time_or_two_opposite_ones(simulated: Simulated):
    trace = simulated("ui_sparse")
    main = [
        number
        for number, name in enumerate(trace.signal_ids)
        if name.startswith("j_main/") and not name.endswith("/crossing")
    ]

    assert len(main) == 4
    pairs = {frozenset(np.flatnonzero(row)) for row in trace.signals[:, main] != Signal.RED}
    # Two approaches at most, and always the same two, which are opposite.
    assert max(map(len, pairs)) <= 2
    assert len([pair for pair in pairs if len(pair) == 2]) <= 1


def test_brake_lamps_are_lit_when_stationary_or_braking_and_out_when_accelerating(
    simulated: Simulated,
):
    trace = simulated("ui_dense")
    motor = [
        number
        for number, one in enumerate(trace.actors)
        if one.actor_class in ("car", "van", "truck", "motorcycle") and not one.towed_by
    ]
    rows = trace.states[np.isin(trace.states["actor"], motor)]
    braking = rows["lamps"] & Lamp.BRAKE > 0

    assert braking[rows["acceleration"] < -0.5].all()
    assert not braking[rows["acceleration"] > 0.5].any()
    assert braking[(rows["speed"] == 0) & (rows["acceleration"] < 0.2)].all()
    assert (rows["lamps"] & ~(Lamp.BRAKE | Lamp.LEFT | Lamp.RIGHT) == 0).all()


def test_the_ego_changes_lane_before_its_lane_turns_off(
    simulated: Simulated, networks: dict[str, Path], specs: dict[str, Spec]
):
    trace, graph = simulated("unj_sparse"), read_lane_graph(networks["unj"])
    rows = track(trace, actor(trace, EGO))
    ego = ego_of(specs["unj_clear_day_sparse"])
    started, _ = graph.find_lane(ego.spawn_m, np.radians(ego.heading_deg))
    before = rows[rows["x"] > 96.0][-1]
    later, _ = graph.find_lane((before["x"], before["y"]), before["yaw"])

    assert later.index == started.index + 1


def test_a_pedestrian_that_may_not_cross_stays_off_the_road(
    specs: dict[str, Spec], networks: dict[str, Path]
):
    spec = with_demand(specs["ri_clear_day_dense"], crossing_share=0.0, vehicles=0)

    trace = simulate_in_subprocess(spec, networks["ri"])

    roadway = shapely.union_all(
        [
            shapely.LineString(lane.shape[:, :2]).buffer(1.5, cap_style="flat")
            for lane in read_lane_graph(networks["ri"]).lanes.values()
            if lane.permits("passenger")
        ]
    )
    walkers = [number for number, one in enumerate(trace.actors) if one.id > 5000]
    rows = trace.states[np.isin(trace.states["actor"], walkers)]
    assert len(walkers) == spec.demand.walkers
    assert not shapely.contains_xy(roadway, rows["x"], rows["y"]).any()
    assert 0.8 < rows["speed"].mean() < 2.0


def test_no_pedestrian_walks_where_no_sidewalk_exists(
    specs: dict[str, Spec], networks: dict[str, Path]
):
    spec = with_timing(with_demand(specs["rsnj_clear_day_sparse"], walkers=10), max_ticks=70)

    found = simulate_in_subprocess(spec, networks["rsnj"]).actors
    assert not any(one.actor_class == "pedestrian" for one in found)


def test_no_vehicle_enters_where_no_street_leads_in(
    specs: dict[str, Spec], networks: dict[str, Path]
):
    spec = specs["ri_clear_day_dense"].model_copy(update={"conflicts": ()})
    graph = read_lane_graph(networks["ri"])
    left = {link.origin for link in graph.driving_connections}
    ends = [lane for lane in graph.driving_lanes if lane.id not in left]
    back = [LaneConnection(ends[0].id, lane.id, None, "s") for lane in graph.entry_lanes]

    rides = draw_demand(spec, replace(graph, connections=(*graph.connections, *back))).vehicles

    assert 0 < len(rides) < len(draw_demand(spec, graph).vehicles) == spec.demand.vehicles
    assert all(ride.depart_s == 0 for ride in rides)


def test_blueprints_with_a_fraction_have_it_and_change_nobody_else(
    specs: dict[str, Spec], networks: dict[str, Path]
):
    spec, graph = specs["ui_clear_day_dense"], read_lane_graph(networks["ui"])
    usual = {name: one for name, one in spec.blueprints.items() if one.fraction is None}
    counts = Counter[str]()
    for seed in range(6):
        seeded = spec.model_copy(update={"seeds": spec.seeds.model_copy(update={"traffic": seed})})
        without = draw_demand(seeded.model_copy(update={"blueprints": usual}), graph).walkers
        for one, other in zip(draw_demand(seeded, graph).walkers, without, strict=True):
            counts[one.actor.blueprint] += 1
            has_fraction = one.actor.blueprint not in usual
            assert has_fraction or one == other
            assert (one.edge, one.start_m, one.legs) == (other.edge, other.start_m, other.legs)
    assert counts.total() > 700
    for name, blueprint in spec.blueprints.items():
        if blueprint.actor_class == "pedestrian" and blueprint.fraction is not None:
            assert counts[name] / counts.total() == pytest.approx(blueprint.fraction, abs=0.02)


def test_traffic_that_has_no_room_on_the_lanes_is_refused_before_it_is_drawn(
    specs: dict[str, Spec], networks: dict[str, Path]
):
    graph = read_lane_graph(networks["rsnj"])
    lane_m = sum(lane.length_m for lane in graph.driving_lanes)
    spec = with_demand(specs["rsnj_clear_day_sparse"], vehicles=20_000)

    with pytest.raises(InputError, match=rf"20000 vehicles do not fit on {lane_m:.0f} m of lanes"):
        draw_demand(spec, graph)


def test_a_route_that_no_movement_allows_is_bad_input(
    specs: dict[str, Spec], networks: dict[str, Path]
):
    spec = specs["ui_clear_day_sparse"]
    ego = spec.agents[0]
    stray = ego.place.model_copy(update={"route": ("north_road", "far_west_road")})
    agents = (ego.model_copy(update={"place": stray}), *spec.agents[1:])

    with pytest.raises(InputError, match="no movement leads from 'north_road' into"):
        simulate_in_subprocess(spec.model_copy(update={"agents": agents}), networks["ui"])


def test_what_sumo_cannot_read_is_an_error_that_says_so(specs: dict[str, Spec], tmp_path: Path):
    (tmp_path / "net.xml").write_text("<net></net>")

    with pytest.raises(InputError, match="do not fit on 0 m of lanes"):
        simulate_in_subprocess(specs["ui_clear_day_sparse"], tmp_path / "net.xml")
    with pytest.raises(RunError, match="not a SUMO network"):
        simulate_in_subprocess(specs["ui_clear_day_sparse"], tmp_path / "missing.xml")


def test_front_wheels_point_along_the_circle_that_a_vehicle_drives(simulated: Simulated):
    rows = track(simulated("ri_sparse"), actor(simulated("ri_sparse"), EGO))
    wheelbase = 0.6 * actor(simulated("ri_sparse"), EGO).size[0]
    turning = (rows["yaw_rate"] > 0.1) & (rows["speed"] > 2)

    radius = rows["speed"][turning] / rows["yaw_rate"][turning]

    assert turning.sum() > 10
    np.testing.assert_allclose(np.tan(rows["steering"][turning]), wheelbase / radius, rtol=0.15)
    assert np.abs(rows["steering"]).max() <= np.radians(40.0)


@pytest.mark.parametrize("road", ["ui", "rsnj"])
def test_the_distance_travelled_is_what_wheels_and_legs_have_gone(road: str, simulated: Simulated):
    trace = simulated(f"{road}_sparse")

    for one in trace.actors:
        rows = track(trace, one)
        way = np.hypot(np.diff(rows["x"]), np.diff(rows["y"])).sum()
        gone = rows["travelled"][-1] - rows["travelled"][0]
        assert (np.diff(rows["travelled"]) >= 0).all(), one
        assert gone == pytest.approx(way, rel=0.06, abs=0.3), one


def off_heading(rows: NDArray[np.void], back_m: float) -> NDArray[np.float64]:
    """Degrees between heading and motion of a point behind the middle, above 1 m/s."""
    forward = np.exp(1j * rows["yaw"])
    places = rows["x"] + 1j * rows["y"] - back_m * forward
    moved = places[2:] - places[:-2]
    off = np.abs(np.angle(moved / forward[1:-1], deg=True))
    return off[(np.abs(moved) > 0.2) & (rows["speed"][1:-1] > 1)]


@pytest.mark.parametrize("name", [*(f"{road}_sparse" for road in ROADS), "rsnj_dense"])
def test_rear_wheels_roll_where_they_point(name: str, simulated: Simulated):
    trace = simulated(name)

    for one in vehicles(trace):
        rows = track(trace, one)
        # Axles are 0.6 lengths apart, so the rear one is 0.3 behind the middle; those of the
        # semi-trailer are 7.7 m behind its kingpin, which is 5.2 m before the middle.
        back_m = 2.5 if one.towed_by else 0.3 * one.size[0]
        if len(rows) > 2:
            assert off_heading(rows, back_m).max(initial=0) < 5.0, one


@pytest.mark.parametrize("road", ["ui", "unj", "ri"])
def test_people_look_where_they_walk(road: str, simulated: Simulated):
    trace = simulated(f"{road}_sparse")

    off = np.concatenate(
        [
            off_heading(track(trace, one), 0.0)
            for one in trace.actors
            if one.actor_class == "pedestrian"
        ]
    )

    assert len(off) > 500
    # People who cross turn at kerbs, faster than bodies follow.
    assert np.mean(off < 5.0) > 0.994


@pytest.mark.parametrize("name", ["ri_sparse", "ri_dense", "ui_sparse", "ui_dense"])
def test_turns_are_announced_in_good_time(
    name: str, simulated: Simulated, networks: dict[str, Path]
):
    """Streets may bend as sharply as turns, so turns are those that begin in a junction."""
    trace = simulated(name)
    outlines = (item.outline for item in read_network(networks[name.split("_")[0]]).junctions)
    inside = shapely.union_all([shapely.Polygon(one[:, :2]) for one in outlines if len(one) > 3])
    turns = 0
    for number, one in enumerate(trace.actors):
        if one.actor_class in ("pedestrian", "bicycle", "motorcycle"):
            continue
        rows = trace.states[trace.states["actor"] == number]
        yaw, way = np.unwrap(rows["yaw"]), rows["travelled"]
        turned = np.interp(way + 22.0, way, yaw) - np.interp(way - 3.0, way, yaw)
        bent = np.abs(yaw - np.interp(way - 3.0, way, yaw)) > np.radians(8)
        bent &= shapely.contains_xy(inside, rows["x"], rows["y"]) & (
            np.abs(turned) > np.radians(55)
        )
        if not bent.any():
            continue
        begins = int(bent.argmax())
        lamp = Lamp.LEFT if turned[begins] > 0 else Lamp.RIGHT
        ticks = np.arange(len(rows))
        # 3 s and 30 m before at the latest, whichever is later.
        late = (ticks >= begins - 30) & (way >= way[begins] - 30.0) & (ticks <= begins)
        assert (rows["lamps"][late] & lamp).all(), one
        turns += 1
    assert turns >= 4
