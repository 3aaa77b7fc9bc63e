"""Parked cars: poses, gaps, and spaces that staged actors need."""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import pytest
import shapely
from advercity_dsl import Blueprint, Road, Spec
from advercity_dsl.road import SurroundingKind

from advercity.conflicts.metrics import ActorTrack
from advercity.frames import ActorState, Lamp, Trace
from advercity.geometry.poses import transform_points
from advercity.roads.layout import lay_out_road
from advercity.roads.road_network import build_road
from advercity.scene.parking import PARKING_SPACE_M, place_parked_cars

BLUEPRINTS = {
    "small": Blueprint(actor_class="car", length_m=3.8, width_m=1.8, height_m=1.5),
    "walker": Blueprint(actor_class="pedestrian", length_m=0.4, width_m=0.4, height_m=1.8),
}


def road(
    side: str = "right", *, bay_m: float | None = None, width_m: float = 2.5, climb_m: float = 0.0
) -> Road:
    strips: list[dict[str, Any]] = [
        {"kind": "lane", "width_m": 3},
        {"kind": "parking", "width_m": width_m, "bay_m": bay_m},
    ]
    return Road.model_validate(
        {
            "id": "street",
            "land_use": "urban",
            "junction": "non_junction",
            "alignment": "straight",
            "profile": "level",
            "sections": {"parking": {"left": strips, "right": strips}},
            "streets": {
                "road": {
                    "begins": "west",
                    "ends": "east",
                    "start_m": (0, 0),
                    "heading_deg": 0,
                    "path": [{"line_m": 200}],
                    "heights": [{"at_m": 0, "z_m": 0}, {"at_m": 200, "z_m": climb_m}],
                    "section": "parking",
                    "speed_limit_km_h": 30,
                }
            },
            "surroundings": [
                {
                    "kind": "parked_cars",
                    "beside": {"street": "road", "side": side, "from_m": 20, "to_m": 180},
                }
            ],
            "agents": {},
            "traffic": {
                "vehicles_per_area": 1,
                "walkers": 0,
                "around_agent_m": 50,
                "around_path_m": 10,
                "classes": dict.fromkeys(("car", "van", "truck", "bicycle", "motorcycle"), 0.2),
            },
        }
    )


def boxes(states: Iterable[ActorState], place_m: float) -> dict[int, np.ndarray]:
    """Corners (2, 3), low and high, of the car in every place that has one."""
    corners = [transform_points(state.world_from_body, state.box.corners) for state in states]
    return {
        int((points[:, 0].mean() - 20) // place_m): np.stack([points.min(0), points.max(0)])
        for points in corners
    }


@pytest.mark.parametrize(("side", "low", "high"), [("right", -5.5, -3), ("left", 3, 5.5)])
def test_cars_are_in_their_strip_with_gaps_between(side: str, low: float, high: float) -> None:
    found = boxes(place_parked_cars(build_road(road(side)), BLUEPRINTS), PARKING_SPACE_M)
    assert 12 < len(found) < 25
    for first, last in found.values():
        np.testing.assert_allclose(last - first, (3.8, 1.8, 1.5), atol=0.01)
        assert low <= first[1] and last[1] <= high
        assert first[0] >= 20 and last[0] <= 180
        assert first[2] == pytest.approx(0, abs=1e-3)


def test_parked_cars_are_at_rest_and_dark() -> None:
    for state in place_parked_cars(build_road(road()), BLUEPRINTS):
        assert state.is_parked
        assert (state.speed_m_s, state.lamps, state.actor.actor_class) == (0.0, Lamp(0), "car")


def test_ids_of_parked_cars_are_those_of_their_spaces_and_of_no_traffic(
    specs: dict[str, Spec],
) -> None:
    spec = specs["ui_clear_day_dense"]
    ids = [car.actor.id for car in place_parked_cars(build_road(spec.road), spec.blueprints)]
    assert len(set(ids)) == len(ids) > 40
    assert min(ids) > 1_000_000


def test_cars_are_parked_across_bays_one_in_each() -> None:
    place = road(bay_m=2.6, width_m=5)
    found = boxes(place_parked_cars(build_road(place), BLUEPRINTS), 2.6)
    assert 30 < len(found) < 55
    for index, (first, last) in found.items():
        np.testing.assert_allclose(last - first, (1.8, 3.8, 1.5), atol=0.01)
        assert (first[0] + last[0]) / 2 == pytest.approx(20 + 2.6 * (index + 0.5), abs=0.01)


def test_cars_lean_with_a_hill() -> None:
    cars = place_parked_cars(build_road(road(climb_m=30)), BLUEPRINTS)
    assert cars
    for car in cars:
        corners = transform_points(car.world_from_body, car.box.corners)
        above = (corners[:, 2] - 0.15 * corners[:, 0]) / np.hypot(1, 0.15)
        assert above.min() == pytest.approx(0, abs=0.01)
        assert above.max() == pytest.approx(1.5, abs=0.01)


def test_a_street_without_a_parking_strip_is_refused() -> None:
    declared = road().model_dump(mode="json")
    for side in ("left", "right"):
        declared["sections"]["parking"][side].pop()
    with pytest.raises(ValueError, match=r"'road' has no parking strip on its right"):
        Road.model_validate(declared)


@pytest.mark.parametrize("path", [((55, -8), (55, 8)), ((80, -4.5), (84, -4.5))])
def test_spaces_on_the_path_of_a_staged_actor_stay_empty(
    specs: dict[str, Spec], path: tuple[tuple[float, float], ...]
) -> None:
    """The paths cross the street, or run along its kerb."""
    conflict, *_ = specs["unj_clear_day_sparse"].conflicts
    actor = conflict.actors[0].model_copy(update={"blueprint": "small", "path_m": path})
    staged = conflict.model_copy(update={"actors": (actor,)})

    network = build_road(road())
    without = boxes(place_parked_cars(network, BLUEPRINTS), PARKING_SPACE_M)
    clear = boxes(place_parked_cars(network, BLUEPRINTS, [staged]), PARKING_SPACE_M)

    swept = shapely.LineString(path).buffer(0.9 + 0.4)
    on_it = {
        place
        for place, ((left, low, _), (right, high, _)) in without.items()
        if swept.intersects(shapely.box(left, low, right, high))
    }
    assert len(on_it) >= 1
    assert without.keys() - clear.keys() == on_it
    for place, corners in clear.items():
        np.testing.assert_array_equal(corners, without[place])


@pytest.mark.sumo
@pytest.mark.parametrize(
    "name",
    ["rsnj", *(pytest.param(name, marks=pytest.mark.slow) for name in ("ui", "unj"))],
)
def test_no_actor_passes_through_a_parked_car(
    specs: dict[str, Spec], name: str, simulate: Callable[[Spec], Trace]
) -> None:
    spec = specs[f"{name}_clear_day_dense"]
    strips = shapely.union_all(
        [
            shapely.Polygon(
                np.vstack([street.offset_line(inner), street.offset_line(outer)[::-1]])[:, :2]
            )
            for street in lay_out_road(spec.road).streets.values()
            for band in (*street.left_strips, *street.right_strips)
            if band.kind == "parking"
            for inner, outer in [sorted((band.inner_t, band.outer_t))]
        ]
    )
    declared = [i for i in spec.road.surroundings if i.kind is SurroundingKind.PARKED_CARS]
    assert declared
    shapely.prepare(strips)
    trace = simulate(spec)
    staged = {actor.number for one in spec.conflicts for actor in one.actors if actor.path_m}
    numbers = np.array([actor.id for actor in trace.actors])
    rows = trace.states[~np.isin(numbers[trace.states["actor"]], list(staged))]
    inside = shapely.contains_xy(shapely.buffer(strips, -0.3), rows["x"], rows["y"])
    assert not inside.any()
    cars = ground(place_parked_cars(build_road(spec.road), spec.blueprints, spec.conflicts))
    shapely.prepare(cars)
    for number in staged:
        assert not shapely.intersects(cars, ActorTrack.from_trace(trace, number).boxes).any()


def ground(states: Iterable[ActorState]) -> shapely.Geometry:
    """Union of the plan views of cars."""
    corners = [transform_points(state.world_from_body, state.box.corners) for state in states]
    return shapely.union_all([shapely.MultiPoint(points[:, :2]).convex_hull for points in corners])
