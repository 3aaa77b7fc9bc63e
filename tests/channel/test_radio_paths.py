"""Paths on flat ground, with a building, lorries and people where a sketch has them."""

from dataclasses import replace

import numpy as np
import pytest

from advercity.channel.propagation import PathState, RadioPath
from advercity.channel.radio_paths import Antenna, RadioPaths
from advercity.frames import ActorState
from advercity.geometry.poses import pose_matrix
from advercity.semantics import Semantic
from advercity.testing import CAR, build_box, build_flat_world, make_actor_state, make_frame
from advercity.world import Body

LORRY = Body(
    (build_box((8.0, 2.5, 3.5), (0.0, 0.0, 1.75), semantic=Semantic.VEHICLE),), (8, 2.5, 3.5)
)
BODIES = {"car": CAR, "lorry": LORRY}
HOUSE = build_box((10.0, 10.0, 8.0), (50.0, 30.0, 4.0))
HEDGE = build_box((1.0, 10.0, 4.0), (50.0, -30.0, 2.0), semantic=Semantic.VEGETATION)
POLE = build_box((0.3, 0.3, 9.0), (50.0, -30.0, 4.5), semantic=Semantic.POLE)


def find_path(
    first: tuple[float, float, float],
    second: tuple[float, float, float],
    *states: ActorState,
    carriers: tuple[int, int] = (0, 0),
) -> RadioPath:
    paths = RadioPaths(build_flat_world(HOUSE, HEDGE, POLE, bodies=BODIES))
    antennas = [
        Antenna(np.array(place), carrier)
        for place, carrier in zip((first, second), carriers, strict=True)
    ]
    (found,) = paths.find(make_frame(*states), [(antennas[0], antennas[1])])
    return found


def make_lorry(actor_id: int, x_m: float, y_m: float = 0.0) -> ActorState:
    return make_actor_state(
        actor_id, x_m, y_m, actor_class="truck", blueprint="lorry", size=LORRY.size
    )


def test_nothing_is_on_an_open_road() -> None:
    found = find_path((0.0, 0.0, 1.6), (30.0, 40.0, 1.6))
    assert found == RadioPath(PathState.LOS, 50.0, (1.6, 1.6))


def test_a_house_is_in_the_way_and_plants_and_poles_are_not() -> None:
    assert find_path((0.0, 30.0, 1.6), (100.0, 30.0, 1.6)).state is PathState.NLOS
    assert find_path((0.0, -30.0, 1.6), (100.0, -30.0, 1.6)).state is PathState.LOS
    # Over its roof.
    assert find_path((0.0, 30.0, 9.0), (100.0, 30.0, 9.0)).state is PathState.LOS


def test_the_tallest_of_the_vehicles_between_counts_with_heights_over_its_road() -> None:
    tall, low = make_lorry(7, 40.0), make_actor_state(8, 60.0)
    found = find_path((0.0, 0.0, 1.4), (100.0, 0.0, 1.4), tall, low)
    assert found.state is PathState.NLOSV
    assert (found.blocker, found.blocker_height_m) == (7, 3.5)
    assert found.antenna_heights_m == pytest.approx((1.4, 1.4))
    # Over the car's roof, 1.5 m high.
    assert find_path((0.0, 0.0, 1.6), (100.0, 0.0, 1.6), low).state is PathState.LOS


def test_neither_carriers_nor_people_nor_what_is_behind_the_antennas_are_on_the_path() -> None:
    carriers = make_actor_state(1, 0.0), make_actor_state(2, 50.0)
    behind = make_lorry(3, -10.0), make_lorry(4, 62.0)
    walker = make_actor_state(5, 25.0, actor_class="pedestrian")
    found = find_path(
        (0.0, 0.0, 1.4), (50.0, 0.0, 1.4), *carriers, *behind, walker, carriers=(1, 2)
    )
    assert found.state is PathState.LOS


def test_pairs_of_different_lengths_do_not_see_what_is_behind_them() -> None:
    """The first ends 5 m before the house, which the second passes through."""
    paths = RadioPaths(build_flat_world(HOUSE, bodies=BODIES))
    near, behind, far = (Antenna(np.array([x_m, 30.0, 1.6]), 0) for x_m in (0.0, 40.0, 200.0))
    found = paths.find(make_frame(), [(near, behind), (near, far)])
    assert [path.state for path in found] == [PathState.LOS, PathState.NLOS]


def test_on_a_hill_heights_are_over_the_road_of_the_blocker() -> None:
    lorry = replace(make_lorry(7, 40.0), world_from_body=pose_matrix((40.0, 0.0, 10.0)))
    found = find_path((0.0, 0.0, 11.4), (100.0, 0.0, 12.0), lorry)
    assert found.blocker == 7
    assert found.antenna_heights_m == pytest.approx((1.4, 2.0))


def test_a_path_is_the_same_from_both_ends() -> None:
    states = (make_lorry(7, 40.0), make_actor_state(8, 60.0))
    first, second = (0.0, 0.0, 1.4), (100.0, 1.0, 5.0)
    there, back = find_path(first, second, *states), find_path(second, first, *states)
    assert (there.state, there.blocker) == (back.state, back.blocker)
    assert there.antenna_heights_m == pytest.approx(back.antenna_heights_m[::-1])
