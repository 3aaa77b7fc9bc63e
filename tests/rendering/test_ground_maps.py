"""The map of wear by the tracks of tyres."""

import numpy as np
import pytest

from advercity.rendering.ground_maps import NEUTRAL_WEAR, WEAR_TONE, build_wear_map
from advercity.roads.lane_segments import LaneSegment

POLISH, TONE = 0, 1


def lane(kind: str = "driving", *, name: str = "road.+1", in_junction: bool = False) -> LaneSegment:
    """From (0, 0) 50 m to the east, 3.5 m wide, its middle at y = 0."""
    x = np.array([0.0, 50.0])
    left, right = (np.column_stack([x, np.full(2, y), np.zeros(2)]) for y in (1.75, -1.75))
    return LaneSegment(name, kind, left, right, in_junction=in_junction)


def worn(x: float, y: float, channel: int, *lanes: LaneSegment) -> float:
    """Polish of tyres in [-1, 1], or change of the albedo, at a place."""
    found = build_wear_map(lanes or [lane()])
    height, width, _ = found.texels.shape
    column = int((x - found.corner[0]) / found.size[0] * width)
    row = int((y - found.corner[1]) / found.size[1] * height)
    steps = (float(found.texels[row, column, channel]) - NEUTRAL_WEAR) / 127
    return steps * (WEAR_TONE if channel == TONE else 1.0)


def test_tyres_polish_two_tracks_of_a_lane():
    assert worn(25, 0.78, POLISH) > 0.4
    assert worn(25, -0.78, POLISH) == pytest.approx(worn(25, 0.78, POLISH), abs=0.3)
    assert worn(25, 0, POLISH) < -0.2
    assert worn(25, 1.9, POLISH) == pytest.approx(0, abs=0.3)


def test_rubber_darkens_tracks_and_oil_the_middle_most_where_vehicles_wait():
    body = worn(10, 1.5, TONE)
    assert worn(10, 0.78, TONE) < body - 0.15
    assert worn(10, 0, TONE) < body - 0.1
    assert worn(48, 0, TONE) < worn(10, 0, TONE) - 0.1


def test_lanes_are_of_paving_of_different_age():
    tones = {worn(10, 1.5, TONE, lane(name=f"road.+{number}")) for number in (1, 2)}
    # One lane alone is the mean; each of two differs from it.
    assert len(tones) == 1
    x = np.array([0.0, 50.0])
    left, right = (np.column_stack([x, np.full(2, y), np.zeros(2)]) for y in (5.25, 1.75))
    other = LaneSegment("road.-1", "driving", left, right)
    assert worn(10, 1.4, TONE, lane(), other) != worn(10, 2.1, TONE, lane(), other)


def test_where_paths_cross_both_tracks_show():
    x = np.array([0.0, 50.0])
    across = LaneSegment(
        "across",
        "driving",
        *(np.column_stack([np.full(2, at), x - 25.0, np.zeros(2)]) for at in (23.25, 26.75)),
        in_junction=True,
    )
    along = lane(in_junction=True)
    both = [worn(*at, POLISH, along, across) for at in ((20, 0.78), (25.78, 3), (25.78, 0.78))]
    assert min(both) > 0.4


def test_wear_leaves_the_mean_of_a_lane_alone():
    found = build_wear_map([lane()])
    assert found.texels[..., POLISH].mean() == pytest.approx(NEUTRAL_WEAR, abs=1.5)
    assert found.texels[..., TONE].mean() == pytest.approx(NEUTRAL_WEAR, abs=1.5)


def test_only_driving_lanes_wear():
    assert (build_wear_map([lane("sidewalk")]).texels == NEUTRAL_WEAR).all()
