"""Tracks of recordings: cut, turned and chosen."""

import math
from collections.abc import Sequence

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from advercity.recordings.tracks import Track, cut_tracks, find_connected


def make_track(name: str, times_s: Sequence[float], place: complex = 0) -> Track:
    """A track at 3 m/s to the east, from a place as east + i north."""
    times = np.array(times_s)
    east = place.real + 3 * times
    places = np.stack([east, np.full(len(times), place.imag)], axis=1)
    return Track(name, "car", (4.5, 1.8, 1.5), times, places, np.zeros(len(times)))


@given(begins_s=st.integers(0, 30), count=st.integers(2, 20), from_s=st.integers(0, 40))
def test_a_cut_keeps_the_samples_of_its_time_and_one_around_them(
    begins_s: int, count: int, from_s: int
) -> None:
    to_s = from_s + 5
    times = [begins_s + number for number in range(count)]
    found = cut_tracks([make_track("a", times)], from_s + 0.5, to_s + 0.5)

    kept = [time for time in times if from_s <= time <= to_s + 1]
    if len(kept) < 2:
        assert found == []
        return
    (track,) = found
    assert track.times_s.tolist() == kept
    assert track.places[:, 0].tolist() == [3 * time for time in kept]
    assert len(track.headings_rad) == len(kept)


@given(
    turn_rad=st.floats(-math.pi, math.pi),
    east_m=st.floats(-900, 900),
    north_m=st.floats(-900, 900),
)
def test_a_track_is_turned_around_the_origin_and_then_moved(
    turn_rad: float, east_m: float, north_m: float
) -> None:
    track = make_track("a", [0.0, 1.0, 2.5], place=7 - 4j)
    found = track.transform(east_m=east_m, north_m=north_m, turn_rad=turn_rad)
    places = track.places @ (1, 1j) * np.exp(1j * turn_rad) + complex(east_m, north_m)
    np.testing.assert_allclose(found.places @ (1, 1j), places, atol=1e-9)
    np.testing.assert_allclose(found.headings_rad, turn_rad)
    mirrored = found.mirror()
    np.testing.assert_allclose(mirrored.places @ (1, 1j), np.conj(places), atol=1e-9)
    np.testing.assert_allclose(mirrored.headings_rad, -turn_rad)


def test_connected_are_the_vehicles_nearest_to_the_ego_that_are_there_all_the_time() -> None:
    times = [0.0, 5.0, 10.0]
    ego = make_track("ego", times)
    others = [make_track(f"{north}", times, 1j * north) for north in (40, -10, 25, -60)]
    late = make_track("late", [0.1, 5.0, 10.0], 1j)
    found = find_connected([late, *others, ego], ego, count=3, from_s=0.0, to_s=10.0)
    assert [track.id for track in found] == ["-10", "25", "40"]
