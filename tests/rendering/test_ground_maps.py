"""The map of wear by the tracks of tyres."""

import numpy as np
import pytest

from advercity.rendering.ground_maps import NEUTRAL_WEAR, build_wear_map
from advercity.roads.lane_segments import LaneSegment


def lane(kind: str = "driving") -> LaneSegment:
    """From (0, 0) 50 m to the east, 3.5 m wide, its middle at y = 0."""
    x = np.array([0.0, 50.0])
    left, right = (np.column_stack([x, np.full(2, y), np.zeros(2)]) for y in (1.75, -1.75))
    return LaneSegment("road.+1", kind, left, right)


def worn(x: float, y: float) -> float:
    """Wear at a place, in [-1, 1]."""
    found = build_wear_map([lane()])
    height, width = found.texels.shape
    column = int((x - found.corner[0]) / found.size[0] * width)
    row = int((y - found.corner[1]) / found.size[1] * height)
    return (float(found.texels[row, column]) - NEUTRAL_WEAR) / 127


def test_tyres_polish_two_tracks_and_stain_what_lies_between():
    assert worn(25, 0.78) > 0.4
    assert worn(25, -0.78) == pytest.approx(worn(25, 0.78), abs=0.3)
    assert worn(25, 0) < -0.3
    assert worn(25, 1.9) == pytest.approx(0, abs=0.3)


def test_wear_leaves_the_mean_of_a_lane_alone():
    found = build_wear_map([lane()])
    assert found.texels.mean() == pytest.approx(NEUTRAL_WEAR, abs=1.5)


def test_only_driving_lanes_wear():
    assert (build_wear_map([lane("sidewalk")]).texels == NEUTRAL_WEAR).all()
