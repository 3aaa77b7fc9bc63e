"""Names of streets and junctions of imported maps."""

from advercity_dsl import Spec

from advercity.roads.routes import RoutePlanner


def test_streets_take_the_name_or_the_id_that_the_map_has_for_them(crossroads: Spec) -> None:
    planner = RoutePlanner(crossroads.road)

    assert set(planner.streets) == {
        "grosse_strasse_1",
        "grosse_strasse_2",
        "road_12_1",
        "road_12_2",
    }
    assert planner.controls["j1"] == "signals"
    # From each arm traffic goes straight on, left and right, in the only lane.
    assert len(planner.movements["j1"]) == 12


def test_a_network_with_names_keeps_them(authored: Spec, reimported: Spec) -> None:
    ours, theirs = RoutePlanner(authored.road), RoutePlanner(reimported.road)

    assert set(theirs.streets) == set(ours.streets)
    for name, street in ours.streets.items():
        found = theirs.streets[name]
        assert (found.begins, found.ends) == (street.begins, street.ends)
        assert [strip.lane_number for strip in found.right_strips if strip.lane_number] == [
            strip.lane_number for strip in street.right_strips if strip.lane_number
        ]
    assert {name: set(items) for name, items in theirs.movements.items()} == {
        name: set(items) for name, items in ours.movements.items()
    }
