"""Lanes with their borders."""

import numpy as np
import pytest

from advercity.roads.lane_segments import build_lane_segments
from advercity.roads.layout import RoadLayout
from advercity.roads.streets import sumo_edge_id

NAMES = ("ui", "unj", "ri", "rsnj", "rcnj")


@pytest.mark.parametrize("name", NAMES)
def test_lanes_for_maps_have_ids_and_borders_at_their_width(
    layouts: dict[str, RoadLayout], name: str
) -> None:
    found = build_lane_segments(layouts[name])
    assert len({lane.id for lane in found}) == len(found)
    declared = {
        f"{sumo_edge_id(street.id, along=along)}.{band.lane_number}": band.width_m
        for street in layouts[name].streets.values()
        for along in (True, False)
        for band in street.strips_in_direction(along=along)
        if band.lane_number
    }
    for lane in found:
        if lane.id in declared:
            width = np.linalg.norm(lane.left - lane.right, axis=1)
            np.testing.assert_allclose(width, declared.pop(lane.id), atol=1e-9)
            forward, across = lane.left[1] - lane.left[0], lane.right[0] - lane.left[0]
            assert forward[0] * across[1] < forward[1] * across[0]
    assert not declared
