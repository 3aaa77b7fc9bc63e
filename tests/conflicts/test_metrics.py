"""How near actors come to each other, against numbers worked out by hand."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from advercity.conflicts.metrics import (
    ActorTrack,
    Encounter,
    find_overlaps,
    measure_encounter,
)
from advercity.frames import STATE_DTYPE, Actor, Trace
from advercity.geometry.polyline import StationedPolyline

TICK_S = 0.1
Way = Callable[[NDArray[np.float64]], Sequence[NDArray[np.float64]]]


def straight(x: float, y: float, heading_deg: float, speed: float) -> Way:
    """Steady along a line: x, y, yaw, speed and way travelled at times."""
    yaw = np.radians(heading_deg)

    def way(time: NDArray[np.float64]) -> Sequence[NDArray[np.float64]]:
        same = np.ones_like(time)
        along = speed * time
        return x + along * np.cos(yaw), y + along * np.sin(yaw), yaw * same, speed * same, along

    return way


def circle(radius: float, heading_deg: float, speed: float) -> Way:
    """Steady and counter-clockwise around the origin, starting with a heading."""

    def way(time: NDArray[np.float64]) -> Sequence[NDArray[np.float64]]:
        yaw = np.radians(heading_deg) + np.sign(radius) * speed * time / abs(radius)
        at = radius * np.exp(1j * (yaw - np.pi / 2))
        return at.real, at.imag, yaw, speed * np.ones_like(time), speed * time

    return way


def trace_of(*ways: Way, ticks: int = 40, size: tuple[float, float] = (4.0, 2.0)) -> Trace:
    time: NDArray[np.float64] = np.linspace(0, (ticks - 1) * TICK_S, ticks)
    rows = np.zeros((ticks, len(ways)), STATE_DTYPE)
    for index, way in enumerate(ways):
        rows["tick"][:, index], rows["actor"][:, index] = np.arange(ticks), index
        names = ("x", "y", "yaw", "speed", "travelled")
        for name, column in zip(names, way(time), strict=True):
            rows[name][:, index] = column
        rows["vx"][:, index] = rows["speed"][:, index] * np.cos(rows["yaw"][:, index])
        rows["vy"][:, index] = rows["speed"][:, index] * np.sin(rows["yaw"][:, index])
    actors = [
        Actor(index + 1, "car", "saloon", "car_paint_blue", (*size, 1.5))
        for index in range(len(ways))
    ]
    return Trace(TICK_S, 60, tuple(actors), rows.ravel(), (), np.zeros((ticks, 0), np.uint8))


def met(*ways: Way, ticks: int = 40) -> Encounter:
    found = measure_encounter(trace_of(*ways, ticks=ticks), 1, 2)
    assert found is not None
    return found


def test_a_car_closes_on_a_stationary_one_by_gap_over_speed():
    found = met(straight(0, 0, 0, 10), straight(60, 0, 0, 0))

    # 60 m between middles less 4 m of cars, and 39 ticks of driving: 56 - 39 = 17 m at the end.
    assert found.distance_m.value == pytest.approx(17.0)
    assert found.time_to_collision_s is not None
    assert found.time_to_collision_s.value == pytest.approx(1.7)
    assert found.time_to_collision_s.tick == 39
    assert found.post_encroachment_s is None


def test_cars_side_by_side_that_keep_apart_never_collide():
    found = met(straight(0, 0, 0, 10), straight(0, 3, 0, 12))

    assert found.distance_m.value == pytest.approx(1.0)
    assert found.time_to_collision_s is None
    assert found.time_to_collision_on_way_s is None


def test_crossing_cars_collide_only_if_they_are_in_one_place_at_one_time():
    # Both 20 m before the crossing at 10 m/s: their boxes (4 x 2 m) touch at 17 m, 1.7 s on.
    together = met(straight(-20, 0, 0, 10), straight(0, -20, 90, 10), ticks=1)
    assert together.time_to_collision_s is not None
    assert together.time_to_collision_s.value == pytest.approx(1.7)

    # The second is 10 m later: the first has left (at 3 m) before it comes.
    apart = met(straight(-20, 0, 0, 10), straight(0, -30, 90, 10))
    assert apart.time_to_collision_s is None
    # First out at -20 + 10 t - 2 = 1, 2.3 s; second in at -30 + 10 t + 2 = -1, 2.7 s.
    assert apart.post_encroachment_s is not None
    assert apart.post_encroachment_s.value == pytest.approx(0.4, abs=TICK_S)


def test_oncoming_cars_in_a_bend_meet_by_their_velocities_but_not_on_their_ways():
    found = met(circle(50, 0, 10), circle(-53.5, 270, 10), ticks=60)

    assert found.time_to_collision_s is not None
    assert found.time_to_collision_on_way_s is None
    assert found.distance_m.value > 0.5


def test_a_vehicle_that_turns_across_a_path_meets_on_the_path():
    # On an arc of 20 m radius a quarter turn takes 31.4 m; the other comes straight at its end.
    found = met(circle(20, 0, 10), straight(20, 34, 270, 10), ticks=31)

    # They touch with middles 4 m apart, (34 + 31.4 - 4) m / 20 m/s = 3.07 s after the start.
    assert found.time_to_collision_on_way_s is not None
    assert found.time_to_collision_on_way_s.value == pytest.approx(0.1)
    assert found.time_to_collision_on_way_s.tick == 30


def test_actors_who_are_never_there_together_do_not_meet():
    trace = trace_of(straight(0, 0, 0, 1), straight(9, 0, 0, 1), ticks=10)
    early, late = (trace.states["actor"] == 0), (trace.states["actor"] == 1)
    apart = (early & (trace.states["tick"] < 5)) | (late & (trace.states["tick"] >= 5))
    trace = Trace(TICK_S, 60, trace.actors, trace.states[apart], (), trace.signals)

    assert measure_encounter(trace, 1, 2) is None
    with pytest.raises(KeyError):
        measure_encounter(trace, 1, 3)


def test_overlaps_name_who_when_and_how_much():
    # Middles 3.5 m apart in one line: 0.5 m of 2 m wide cars lies in both.
    trace = trace_of(straight(0, 0, 0, 0), straight(3.5, 0, 0, 0), straight(0, 9, 0, 0), ticks=2)

    found = list(find_overlaps(trace))

    assert [(one.first, one.second, one.tick) for one in found] == [(1, 2, 0), (1, 2, 1)]
    assert found[0].area_m2 == pytest.approx(1.0)
    assert not list(find_overlaps(trace, min_area_m2=1.5))


@given(
    x=st.floats(-50, 50),
    y=st.floats(-50, 50),
    heading=st.floats(0, 360),
    speeds=st.tuples(st.floats(0.1, 20), st.floats(0.1, 20)),
)
def test_meeting_is_mutual_and_steady_cars_touch_when_they_were_to(
    x: float, y: float, heading: float, speeds: tuple[float, float]
):
    ways = straight(0, 0, 0, speeds[0]), straight(x, y, heading, speeds[1])
    here, there = met(*ways), met(*ways[::-1])

    assert here.distance_m.value == pytest.approx(there.distance_m.value, abs=1e-6)
    assert (here.time_to_collision_s is None) == (there.time_to_collision_s is None)
    touched = [one.tick for one in find_overlaps(trace_of(*ways))]
    first = measure_encounter(trace_of(*ways, ticks=1), 1, 2)
    if touched:
        assert first is not None and first.time_to_collision_s is not None
        assert first.time_to_collision_s.value <= touched[0] * TICK_S + 1e-6


def test_a_track_that_ends_rolls_on_parallel_to_its_lane():
    lane = StationedPolyline.from_points(np.array([(0.0, 0.0), (10.0, 0.0), (10.0, 30.0)]))
    ending = trace_of(straight(0.0, 0.5, 0.0, 5.0), ticks=11)

    on = ActorTrack.from_trace(ending, 1).roll_on(lane, 2.0, TICK_S)

    # At 5 m/s it is at (5, 0.5) after 1 s; of 10 m more, 5 m are before the corner.
    assert on.rows["tick"][-1] == 30
    assert on.centres[-1] == pytest.approx([10.0, 5.5])
    assert on.rows["travelled"][-1] == pytest.approx(15.0)
    assert on.rows["yaw"][-1] == pytest.approx(np.pi / 2)


@pytest.mark.parametrize(
    ("above_m", "meets"), [(0.0, True), (2.4, True), (2.6, False), (-6, False)]
)
def test_actors_on_streets_above_each_other_never_meet(above_m: float, meets: bool) -> None:
    """Both pass the origin after 2 s, at right angles."""
    trace = trace_of(straight(-20, 0, 0, 10), straight(0, -20, 90, 10))
    trace.states["z"][trace.states["actor"] == 1] = above_m

    encounter = measure_encounter(trace, 1, 2)

    assert (encounter is not None) == meets
    assert bool(list(find_overlaps(trace))) == meets
