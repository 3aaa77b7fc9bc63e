"""Articulated lorries: SUMO drives one vehicle, the trace has a tractor unit and what it tows."""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from advercity_dsl import Blueprint, Catalogue, Spec
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from pydantic import ValidationError

from advercity.conflicts.case import ParticipantSampler
from advercity.conflicts.metrics import find_overlaps
from advercity.conflicts.report import build_traffic_report
from advercity.frames import Actor, Trace
from advercity.recordings.bodies import select_blueprint
from advercity.roads.lane_graph import read_lane_graph
from advercity.roads.sumo_network import write_sumo_network
from advercity.traffic.demand import draw_demand
from advercity.traffic.route_file import write_route_file
from advercity.traffic.semitrailers import TowedTrailer, build_towed_trailer
from advercity.traffic.vehicle_motion import compute_lorry_states, compute_vehicle_states
from tests.shipped import CATALOGUE
from tests.traffic.front_tracks import track

LENGTH_M = 6.1
BACK_M = 6.1 / 2 - 4.5
"""x of the fifth wheel in the body frame of the tractor unit."""
AHEAD_M = 13.6 / 2 - 1.6
"""x of the kingpin in the body frame of the semi-trailer."""
WHEELBASE_M = 7.7
TRAILER = TowedTrailer(
    Actor(101_001, "truck", "curtain_semitrailer", "car_paint_blue", (13.6, 2.55, 4.0), 1001),
    fifth_wheel_m=4.5,
    kingpin_m=1.6,
    wheelbase_m=WHEELBASE_M,
)
STEADY = slice(-80, -20)
"""Ticks of a long turn; a drive goes straight on after its last tick, which is smoothed."""
Rows = NDArray[np.void]


def drive(fronts: Rows) -> tuple[Rows, Rows]:
    heading = float(fronts["yaw"][0])
    return compute_lorry_states(fronts, LENGTH_M, TRAILER, tick_s=0.1, trailer_heading_rad=heading)


def circle(radius_m: float, speed_m_s: float = 4.0, ticks: int = 900, grade: float = 0.0) -> Rows:
    angle = speed_m_s * 0.1 * np.arange(ticks) / radius_m
    return track(
        x=radius_m * np.sin(angle),
        y=radius_m * (1 - np.cos(angle)),
        z=grade * radius_m * angle,
        yaw=angle,
        slope=np.full(ticks, np.arctan(grade)),
        speed=np.full(ticks, speed_m_s),
    )


def places(rows: Rows, x_m: float) -> NDArray[np.float64]:
    """World places (n, 3) of a point on the ground under x of a body."""
    yaw, pitch = rows["yaw"], rows["pitch"]
    ahead = np.column_stack(
        [np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch)]
    )
    return np.column_stack([rows[name] for name in "xyz"]) + x_m * ahead


def measure_gap(tractor: Rows, trailer: Rows) -> float:
    """Greatest distance in m between fifth wheel and kingpin."""
    apart = places(tractor, BACK_M) - places(trailer, AHEAD_M)
    return float(np.linalg.norm(apart, axis=1).max())


def test_the_shipped_lorry_has_the_lengths_of_the_directive():
    tractor = Actor.from_blueprint(
        1001, "lorry_tractor", CATALOGUE.blueprints["lorry_tractor"], "car_paint_red"
    )
    assert tractor.size[0] == LENGTH_M
    # 4.5 m to the kingpin and 12 m from there to the rear.
    assert TRAILER.lorry_length_m == pytest.approx(16.5)
    trailer = CATALOGUE.blueprints["curtain_semitrailer"]
    assert trailer.semitrailer is not None
    front_m = np.hypot(trailer.semitrailer.kingpin_m, trailer.width_m / 2)
    assert front_m < 2.05  # 2.04 m to any point of its front, whose corners are round
    assert trailer.length_m - trailer.semitrailer.kingpin_m == pytest.approx(12.0)
    assert trailer.size == TRAILER.actor.size


def test_on_a_straight_road_both_are_in_line():
    along = np.arange(0.0, 100.0)
    tractor, trailer = drive(track(x=along, speed=np.full(100, 10.0)))

    np.testing.assert_allclose(trailer["yaw"], 0.0, atol=1e-12)
    np.testing.assert_allclose(trailer["y"], 0.0, atol=1e-12)
    # 1.45 m from the tractor's middle to the coupling, 5.2 m on to the trailer's.
    np.testing.assert_allclose(tractor["x"] - trailer["x"], 6.65, atol=1e-9)
    np.testing.assert_allclose(trailer["speed"], 10.0)
    assert not trailer["steering"].any()


@pytest.mark.parametrize("radius_m", [14.0, 25.0, 60.0])
def test_in_a_steady_turn_the_angle_is_that_of_its_wheelbase_in_the_circle(radius_m: float):
    tractor, trailer = drive(circle(radius_m))

    # The kingpin goes on a circle of radius r; the axles behind it on one of sqrt(r² - L²).
    kingpin = places(trailer, AHEAD_M)[STEADY]
    r = np.hypot(kingpin[:, 0], kingpin[:, 1] - radius_m)
    # Over the rear axle of the tractor a body moves straight ahead; the coupling is 0.38 m before.
    towards = tractor["yaw"][STEADY] + np.arcsin((BACK_M + 0.3 * LENGTH_M) / r)
    angle = np.arcsin(WHEELBASE_M / r)
    np.testing.assert_allclose(towards - trailer["yaw"][STEADY], angle, atol=2e-3)
    axles = places(trailer, AHEAD_M - WHEELBASE_M)[STEADY]
    inner = np.hypot(axles[:, 0], axles[:, 1] - radius_m)
    np.testing.assert_allclose(inner, np.sqrt(r**2 - WHEELBASE_M**2), rtol=2e-3)


def test_around_a_corner_too_tight_for_it_the_lorry_stays_coupled_and_does_not_fold():
    """Imported maps have such corners: 120 degrees to the right around 4.4 m."""
    turned = np.clip(0.02 * (np.arange(600) - 200), 0.0, np.radians(120.0))
    x, y = np.zeros(600), np.zeros(600)
    ahead = 4.4 * 0.02
    x[1:] = np.cumsum(ahead * np.cos(turned[1:]))
    y[1:] = -np.cumsum(ahead * np.sin(turned[1:]))
    fronts = track(x=x, y=y, yaw=-turned, speed=np.full(600, 10 * ahead))

    tractor, trailer = drive(fronts)

    angle = np.degrees(np.unwrap(tractor["yaw"]) - np.unwrap(trailer["yaw"]))
    assert measure_gap(tractor, trailer) < 1e-6
    assert 60.0 < np.abs(angle).max() < 100.0
    assert np.abs(np.diff(np.unwrap(trailer["yaw"]))).max() < np.radians(2.0)
    axles = places(trailer, AHEAD_M - WHEELBASE_M)
    along = np.column_stack([np.cos(trailer["yaw"]), np.sin(trailer["yaw"])])
    assert np.sum(np.diff(axles[:, :2], axis=0) * along[1:], axis=1).min() > -0.01


@pytest.mark.parametrize("name", [n for n, made in CATALOGUE.blueprints.items() if made.tows])
def test_every_lorry_is_16_5_m_long_and_can_turn_its_trailer(name: str) -> None:
    coupling = CATALOGUE.blueprints[name].tows
    assert coupling is not None
    trailer = CATALOGUE.blueprints[coupling.trailer]
    assert trailer.semitrailer is not None
    length_m = coupling.behind_front_m + trailer.length_m - trailer.semitrailer.kingpin_m
    assert length_m == pytest.approx(16.5)
    # Directive 96/53/EC, Annex I, 4.4: the front corners within 2.04 m of the kingpin, but for the
    # rounding of refrigerated bodies, which are 5 cm wider.
    assert np.hypot(trailer.semitrailer.kingpin_m, trailer.width_m / 2) < 2.07


def test_it_turns_within_the_circles_of_the_directive():
    """With its outer front corner on a circle of 12.5 m, nothing is within one of 5.3 m."""
    half_m = 2.55 / 2
    # The front axle goes on the circle, 1.22 m behind the corner and 3.66 m before the rear axle.
    rear_m = np.sqrt(12.5**2 - (1.22 + 3.66) ** 2) - half_m
    radius_m = np.hypot(rear_m, 3.66)

    tractor, trailer = drive(circle(radius_m, speed_m_s=1.0, ticks=1500))

    centre = np.array([0.0, radius_m])
    corner = places(tractor, LENGTH_M / 2)[-20, :2]
    right = np.array([np.sin(tractor["yaw"][-20]), -np.cos(tractor["yaw"][-20])])
    assert np.linalg.norm(corner + half_m * right - centre) == pytest.approx(12.5, abs=0.05)
    axles = places(trailer, AHEAD_M - WHEELBASE_M)[-20, :2]
    assert np.linalg.norm(axles - centre) - half_m > 5.3


def test_the_axles_roll_and_never_slide():
    _, trailer = drive(circle(20.0))

    axles = places(trailer, AHEAD_M - WHEELBASE_M)
    across = np.column_stack([-np.sin(trailer["yaw"]), np.cos(trailer["yaw"])])
    moved = (axles[2:, :2] - axles[:-2, :2]) / 0.2
    sideways = np.sum(moved * across[1:-1], axis=1)
    assert np.abs(sideways).max() < 0.01


@pytest.mark.parametrize("grade", [0.0, 0.06, -0.04])
def test_the_kingpin_is_in_the_fifth_wheel_at_every_tick_of_a_turn(grade: float):
    tractor, trailer = drive(circle(18.0, grade=grade))

    assert measure_gap(tractor, trailer) < 0.01
    np.testing.assert_allclose(trailer["pitch"][300:], -np.arctan(grade), atol=0.01)


def test_over_a_crest_both_ends_of_the_trailer_are_on_the_road():
    along = 0.1 * np.arange(600.0)
    fronts = track(x=along, z=-np.maximum(along - 20.0, 0.0) * 0.1, speed=np.full(600, 1.0))

    tractor, trailer = drive(fronts)

    assert measure_gap(tractor, trailer) < 0.01
    # At tick 300 the front is 10 m past the crest, the axles 12.2 m behind it: 2.2 m before.
    axles = places(trailer, AHEAD_M - WHEELBASE_M)
    assert axles[300, 2] == pytest.approx(0.0, abs=0.01)
    # The coupling, 5.5 m past the crest, is 0.55 m below it: (0.55 m)/(7.7 m).
    assert trailer["pitch"][300] == pytest.approx(np.arctan(0.55 / 7.7), abs=0.002)


def test_the_tractor_unit_moves_as_it_would_alone():
    alone = compute_vehicle_states(circle(30.0), LENGTH_M, tick_s=0.1)
    tractor, _ = drive(circle(30.0))

    for name in ("x", "y", "yaw", "speed", "steering"):
        np.testing.assert_allclose(tractor[name], alone[name], atol=1e-9)


@given(
    bends=st.lists(st.floats(-0.06, 0.06), min_size=3, max_size=6),
    speeds=st.lists(st.floats(0.0, 14.0), min_size=3, max_size=6),
)
def test_wherever_it_drives_it_stays_coupled_and_its_motion_agrees(
    bends: list[float], speeds: list[float]
):
    count = 240
    at = np.arange(count)

    def knots(values: list[float]) -> NDArray[np.float64]:
        return np.interp(at, np.linspace(0, count, len(values)), values)

    speed = knots(speeds)
    yaw = np.cumsum(knots(bends) * speed * 0.1)
    moves = 0.1 * speed * np.exp(1j * yaw)
    fronts = track(x=np.cumsum(moves.real), y=np.cumsum(moves.imag), yaw=yaw, speed=speed)

    tractor, trailer = drive(fronts)

    assert measure_gap(tractor, trailer) < 1e-6
    np.testing.assert_array_equal(trailer["lamps"], tractor["lamps"])
    for value, rate, error in (("x", "vx", 0.05), ("vx", "ax", 0.3), ("yaw", "yaw_rate", 0.02)):
        change = (trailer[value][2:] - trailer[value][:-2]) / 0.2
        assert np.abs(change - trailer[rate][1:-1]).max() < error
    angle = np.angle(np.exp(1j * (tractor["yaw"] - trailer["yaw"])))
    assert np.abs(angle).max() < np.pi / 2


def test_a_lorry_that_stands_does_not_turn():
    speed = np.where(np.arange(200) < 100, 4.0, 0.0)
    angle = np.cumsum(0.1 * speed) / 20.0
    fronts = track(x=20 * np.sin(angle), y=20 - 20 * np.cos(angle), yaw=angle, speed=speed)

    _, trailer = drive(fronts)

    for name in ("x", "y", "yaw"):
        assert not np.diff(trailer[name][120:]).any()
    assert trailer["yaw"][120] < angle[-1] - 0.2


# In traffic.


@pytest.fixture(scope="module")
def networks(specs: dict[str, Spec], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("networks")
    return {
        road: write_sumo_network(specs[f"{road}_clear_day_sparse"].road, folder)
        for road in ("ui", "rcnj")
    }


@pytest.fixture(scope="module", params=["ui_clear_day_sparse", "rcnj_clear_day_dense"])
def shipped(
    request: pytest.FixtureRequest, specs: dict[str, Spec], simulate: Callable[[Spec], Trace]
) -> tuple[Spec, Trace]:
    return specs[request.param], simulate(specs[request.param])


def pairs_of(trace: Trace) -> list[tuple[Actor, Rows, Actor, Rows]]:
    trailers = [actor for actor in trace.actors if actor.towed_by]
    return [(*trace.get_track(one.towed_by), *trace.get_track(one.id)) for one in trailers]


@pytest.mark.sumo
def test_in_a_trace_every_semitrailer_is_coupled_to_its_tractor_unit(
    shipped: tuple[Spec, Trace],
):
    _, trace = shipped
    pairs = pairs_of(trace)
    assert pairs
    for tractor, front, trailer, behind in pairs:
        assert (tractor.blueprint, trailer.blueprint) == ("lorry_tractor", "curtain_semitrailer")
        assert trailer.id == 100_000 + tractor.id
        np.testing.assert_array_equal(front["tick"], behind["tick"])
        np.testing.assert_array_equal(front["lamps"], behind["lamps"])
        assert measure_gap(front, behind) < 0.01
    towing = {tractor.id for tractor, *_ in pairs}
    assert towing == {one.id for one in trace.actors if one.blueprint == "lorry_tractor"}


@pytest.mark.sumo
def test_a_lorry_is_one_vehicle_and_does_not_collide_with_itself(shipped: tuple[Spec, Trace]):
    spec, trace = shipped
    assert not list(find_overlaps(trace))

    report = build_traffic_report(spec, trace, trace.compute_sha256())

    trucks = Counter(one.actor_class for one in trace.actors if not one.towed_by)["truck"]
    assert report.actors["truck"] == trucks
    assert not report.overlaps


@pytest.mark.sumo
def test_a_trace_keeps_who_tows_whom(shipped: tuple[Spec, Trace], tmp_path: Path):
    _, trace = shipped
    trace.save(tmp_path / "trace.npz")

    read = Trace.load(tmp_path / "trace.npz")

    assert read.actors == trace.actors
    assert read.compute_sha256() == trace.compute_sha256()
    untowed = replace(trace, actors=tuple(replace(one, towed_by=0) for one in trace.actors))
    assert untowed.compute_sha256() != trace.compute_sha256()


@pytest.mark.sumo
def test_half_of_the_trucks_are_lorries_and_the_other_vehicles_stay(
    specs: dict[str, Spec], networks: dict[str, Path]
):
    spec, graph = specs["ui_clear_day_dense"], read_lane_graph(networks["ui"])
    usual = {name: one for name, one in spec.blueprints.items() if not one.tows}
    counts = Counter[bool]()
    for seed in range(20):
        seeded = spec.model_copy(update={"seeds": spec.seeds.model_copy(update={"traffic": seed})})
        without = draw_demand(seeded.model_copy(update={"blueprints": usual}), graph).vehicles
        others = {trip.actor.id: trip.actor for trip in without}
        for trip in draw_demand(seeded, graph).vehicles:
            assert (trip.trailer is None) == (trip.actor.blueprint in usual)
            if trip.trailer is None:
                assert trip.actor == others[trip.actor.id]
            if trip.actor.actor_class == "truck":
                counts[trip.trailer is not None] += 1
    assert counts.total() > 200
    assert counts[True] / counts.total() == pytest.approx(0.5, abs=0.1)


@pytest.mark.sumo
def test_sumo_drives_the_whole_length(
    specs: dict[str, Spec], networks: dict[str, Path], tmp_path: Path
):
    demand = draw_demand(specs["ui_clear_day_dense"], read_lane_graph(networks["ui"]))
    lorries = [trip for trip in demand.vehicles if trip.trailer]
    write_route_file(demand, tmp_path / "routes.xml")

    written = (tmp_path / "routes.xml").read_text()

    assert lorries
    for trip in lorries:
        assert f'<vType id="{trip.actor.id}" vClass="truck" length="16.500"' in written
        assert trip.trailer is not None
        assert f'id="{trip.trailer.actor.id}"' not in written
        # Blame falls on the lorry whichever of its actors blocks another.
        assert demand.select_background([trip.trailer.actor.id]) == {trip.actor.id}


@pytest.mark.sumo
def test_in_a_bend_a_lorry_starts_over_the_middle_of_its_lane(
    specs: dict[str, Spec], networks: dict[str, Path]
):
    demand = draw_demand(specs["rcnj_clear_day_dense"], read_lane_graph(networks["rcnj"]))
    graph = read_lane_graph(networks["rcnj"])
    seen = 0
    for trip in demand.vehicles:
        if trip.trailer is None or trip.front_position_m is None:
            continue
        line = graph.lanes[f"{trip.edges[0]}_{trip.lane}"].line
        coupling = line.points_at(trip.front_position_m - 4.5)[:2]
        ahead = np.array([np.cos(trip.trailer_heading_rad), np.sin(trip.trailer_heading_rad)])
        axles = line.points_at(trip.front_position_m - 12.2)[:2]
        assert np.linalg.norm(coupling - WHEELBASE_M * ahead - axles) < 0.1
        seen += 1
    assert seen > 0


def test_a_tractor_unit_without_its_semitrailer_in_the_spec_is_bad_input(spec: Spec):
    missing = {k: v for k, v in spec.blueprints.items() if k != "curtain_semitrailer"}
    bare = spec.model_copy(update={"blueprints": missing})
    tractor = Actor.from_blueprint(1, "lorry_tractor", missing["lorry_tractor"], "car_paint_red")
    with pytest.raises(Exception, match="tows 'curtain_semitrailer', which is no semi-trailer"):
        build_towed_trailer(bare, tractor)


WRONG = {
    "a car that tows": (
        "lorry_tractor",
        {"actor_class": "car", "fraction": None},
        "are for trucks",
    ),
    "a tractor without fraction": ("lorry_tractor", {"fraction": None}, "has a `fraction`"),
    "a fifth wheel in the air": (
        "lorry_tractor",
        {"tows": {"trailer": "curtain_semitrailer", "behind_front_m": 7}},
        "fifth wheel is behind",
    ),
    "axles in the air": (
        "curtain_semitrailer",
        {"semitrailer": {"kingpin_m": 2, "wheelbase_m": 12}},
        "axles are behind",
    ),
    "a trailer with fraction": ("curtain_semitrailer", {"fraction": 0.1}, "has no `fraction`"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_lorry_that_cannot_be_is_refused(case: str):
    name, change, message = WRONG[case]
    data = CATALOGUE.blueprints[name].model_dump() | change
    with pytest.raises(ValidationError, match=message):
        Blueprint.model_validate(data)


def test_a_catalogue_has_the_semitrailers_of_its_tractor_units():
    data = CATALOGUE.model_dump()
    for name, message in (("box_truck", "no semi-trailer"), ("nobody", "no semi-trailer")):
        towing = data["blueprints"]["lorry_tractor"] | {
            "tows": {"trailer": name, "behind_front_m": 4.5}
        }
        changed = data["blueprints"] | {"lorry_tractor": towing}
        with pytest.raises(ValidationError, match=message):
            Catalogue.model_validate(data | {"blueprints": changed})
    with pytest.raises(ValidationError, match="connected vehicles are rigid"):
        Catalogue.model_validate(data | {"ego": "lorry_tractor"})


def test_staged_and_recorded_trucks_are_rigid():
    blueprints = CATALOGUE.blueprints
    for number in range(60):
        staged = ParticipantSampler(blueprints, number, "ui").draw_actor(["truck"])
        assert staged.blueprint.is_usual
        for size in ((6.1, 2.83, 3.8), (13.6, 2.55, 4.0)):
            assert blueprints[select_blueprint(blueprints, "truck", size, number)].is_usual
