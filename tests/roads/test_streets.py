"""Ids of streets in the SUMO network."""

import pytest

from advercity.roads.streets import parse_edge_id, sumo_edge_id


def test_edge_ids_are_read_back() -> None:
    assert parse_edge_id(sumo_edge_id("north_road", along=True)) == ("north_road", True)
    assert parse_edge_id(sumo_edge_id("north_road", along=False)) == ("north_road", False)
    with pytest.raises(KeyError):
        parse_edge_id(":j_main_0")
