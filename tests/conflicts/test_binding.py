"""How conflicts match roads, and how roads change for them."""

from pathlib import Path

import pytest
from advercity_dsl import Conflict, Road, Vehicle

from advercity.compiler import load_library
from advercity.conflicts.binding import match_conflict, with_ego_manoeuvre
from advercity.roads.routes import RoutePlanner

NHTSA = Path(__file__).parents[2] / "library" / "nhtsa"


def test_a_conflict_reports_how_it_fits_a_road():
    library = load_library(NHTSA)
    conflicts, roads = library.get_declarations(Conflict), library.get_declarations(Road)

    drift, turn = conflicts["od_drift"], conflicts["ped_left_turn"]
    overtaking = match_conflict(conflicts["od_overtake"], roads["unj"], called_for=True)

    assert match_conflict(drift, roads["rsnj"], called_for=True).standing == "primary"
    assert match_conflict(turn, roads["ri"], called_for=False).standing == "extension"
    assert overtaking.standing == "invalid"
    assert overtaking.reason == "a median divides it"
    assert (
        match_conflict(turn, roads["unj"], called_for=True).reason
        == "it is away from junctions, not an intersection"
    )


@pytest.mark.parametrize(
    ("road", "leader"), {"unj": "cav3", "rsnj": "cav3", "rcnj": "cav2"}.items()
)
def test_where_no_vehicle_may_lead_the_ego_the_leader_starts_25_to_30_m_behind(
    road: str, leader: str
):
    library = load_library(NHTSA)
    declared = library.get_declarations(Road)[road]
    moved = with_ego_manoeuvre(declared, library.get_declarations(Conflict)["od_overtake"])
    assert moved is not None

    ego, follower, original = moved.agents["cav1"], moved.agents[leader], declared.agents[leader]
    assert isinstance(ego, Vehicle)
    assert isinstance(follower, Vehicle)
    assert isinstance(original, Vehicle)
    way = RoutePlanner(moved).build_path(follower.route)

    assert (
        24.9
        <= way.find_nearest_station(ego.spawn_m) - way.find_nearest_station(follower.spawn_m)
        <= 30.1
    )
    assert follower.destination_m == original.destination_m
    assert [name for name in moved.agents if moved.agents[name] != declared.agents[name]] == [
        leader
    ]
