"""Lanes, meshes and signals of roads that are imported from maps."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import shapely
from advercity_dsl import Road, Spec

from advercity.pipeline.descriptions import describe_road
from advercity.roads.lane_segments import LaneSegment
from advercity.roads.network_file import read_signal_groups
from advercity.roads.plan_drawing import (
    BACKGROUND_COLOUR,
    LANE_COLOURS,
    PAINT_COLOUR,
    PlanCanvas,
    draw_plan,
)
from advercity.roads.road_meshes import KERB_HEIGHT_M
from advercity.roads.road_network import RoadNetwork, build_road
from advercity.roads.sumo_network import write_sumo_network
from advercity.semantics import Semantic
from tests.roads.probing import looking_down, on_lane, road_meshes


def lane_near(road: RoadNetwork, x: float, y: float, kind: str = "driving") -> LaneSegment:
    """The lane between junctions whose middle is nearest to a point."""

    def gap(lane: LaneSegment) -> float:
        middle = (lane.left + lane.right)[:, :2] / 2
        return float(shapely.LineString(middle).distance(shapely.Point(x, y)))

    return min((lane for lane in road.lanes if lane.kind == kind), key=gap)


def test_opendrive_lanes_lie_where_the_map_has_them(bend: Spec) -> None:
    road = build_road(bend.road)

    right = lane_near(road, 50, -1.75)
    left = lane_near(road, 50, 1.75)
    walk = lane_near(road, 50, -4.5, "sidewalk")

    np.testing.assert_allclose(right.left[:, 1], 0, atol=0.005)
    np.testing.assert_allclose(right.right[:, 1], -3.5, atol=0.005)
    np.testing.assert_allclose(left.right[:, 1], 3.5, atol=0.005)
    np.testing.assert_allclose(walk.right[:, 1], -5.5, atol=0.005)
    assert right.left[0, 0] < right.left[-1, 0]
    assert left.left[0, 0] > left.left[-1, 0]


def test_opendrive_bends_and_grades_are_kept(bend: Spec) -> None:
    outer = lane_near(build_road(bend.road), 125.5, 3.9)
    from_centre = np.linalg.norm(outer.left[:, :2] - (100, 60), axis=1)
    turned = np.arctan2(outer.left[:, 0] - 100, 60 - outer.left[:, 1])

    np.testing.assert_allclose(from_centre, 60, atol=0.02)
    np.testing.assert_allclose(outer.left[:, 2], 0.05 * 60 * turned, atol=0.02)


def test_osm_lanes_lie_around_the_declared_origin(crossroads: Spec) -> None:
    road = build_road(crossroads.road)

    east = lane_near(road, 100, -1.6)
    ends = (east.left + east.right)[:, :2] / 2

    # One degree of longitude on WGS84 at 48 degrees north is 74 625 m, of latitude 111 200 m.
    assert ends[:, 0].max() == pytest.approx(0.0027 * 74_625, abs=0.3)
    np.testing.assert_allclose(ends[:, 1], -1.6, atol=0.02)
    assert max(lane.left[:, 1].max() for lane in road.lanes) == pytest.approx(
        0.0018 * 111_200, abs=0.5
    )
    assert {lane.kind for lane in road.lanes} == {"driving", "sidewalk", "crossing"}


def test_a_sumo_network_comes_back_as_it_was(authored: Spec, reimported: Spec) -> None:
    def middles(road: Road) -> list[shapely.LineString]:
        return [
            shapely.LineString((lane.left + lane.right)[:, :2] / 2)
            for lane in build_road(road).lanes
            if lane.kind == "driving" and not lane.in_junction
        ]

    ours, theirs = middles(authored.road), middles(reimported.road)

    assert len(theirs) == len(ours)
    for line in ours:
        gaps = [line.hausdorff_distance(other) for other in theirs]
        assert min(gaps) < 0.05


@pytest.mark.parametrize("name", ["bend", "crossroads", "reimported"])
def test_every_lane_is_on_asphalt_at_its_height(
    name: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    spec: Spec = request.getfixturevalue(name)
    below = looking_down(road_meshes(spec, tmp_path))
    walkable = (Semantic.SIDEWALK.value, Semantic.ROAD_LINE.value, Semantic.ROAD.value)

    for lane in build_road(spec.road).lanes:
        points = on_lane(lane)
        z, found = below(points)
        if lane.kind == "sidewalk":
            np.testing.assert_allclose(z, points[:, 2] + KERB_HEIGHT_M, atol=0.03)
            assert (found == Semantic.SIDEWALK.value).all(), lane.id
        elif lane.in_junction:
            assert np.isin(found, walkable).all(), lane.id
            assert np.abs(z - points[:, 2]).max() < 0.2, lane.id
        elif lane.kind == "driving":
            assert np.isin(found, (Semantic.ROAD.value, Semantic.ROAD_LINE.value)).all(), lane.id
            np.testing.assert_allclose(z, points[:, 2], atol=0.02)


def test_the_ground_meets_the_edge_of_an_imported_road(bend: Spec, tmp_path: Path) -> None:
    below = looking_down(road_meshes(bend, tmp_path))

    north, south = np.array([[50.0, 4.0]]), np.array([[50.0, -6.0]])

    assert below(north)[1] == below(south)[1] == Semantic.TERRAIN.value
    assert below(north)[0] == pytest.approx(0.0, abs=0.03)
    assert below(south)[0] == pytest.approx(KERB_HEIGHT_M, abs=0.03)


def test_every_approach_to_imported_signals_has_a_head_that_faces_it(
    crossroads: Spec, tmp_path: Path
) -> None:
    road = build_road(crossroads.road)
    groups = read_signal_groups(write_sumo_network(crossroads.road, tmp_path))

    over_roads = [head for head in road.traffic_lights if head.governs == "vehicles"]
    assert len(over_roads) == 4
    for head in over_roads:
        assert head.id in groups
        # Traffic comes from the side that the head looks to, and stops short of the crossing.
        assert np.dot(head.position_m[:2], head.facing) < -5
        assert not shapely.Point(head.mast_foot_m).within(road.roadway_level_area)
        assert 5 < head.position_m[2] < 7


def test_crossings_of_imported_signals_have_two_heads_off_the_roadway(
    crossroads: Spec, tmp_path: Path
) -> None:
    road = build_road(crossroads.road)
    groups = read_signal_groups(write_sumo_network(crossroads.road, tmp_path))
    at_crossings = [head for head in road.traffic_lights if head.governs == "pedestrians"]

    assert Counter(head.id for head in at_crossings) == {
        name: 2 for name in groups if name.endswith("/crossing")
    }
    assert len(at_crossings) == 8
    for head in at_crossings:
        assert not shapely.Point(head.mast_foot_m).within(road.roadway_level_area)


def test_the_plan_of_an_imported_road_shows_it(crossroads: Spec) -> None:
    plan = draw_plan(build_road(crossroads.road))
    colours = {tuple(colour) for colour in np.unique(plan.reshape(-1, 3), axis=0).tolist()}

    assert {LANE_COLOURS["driving"], LANE_COLOURS["sidewalk"], PAINT_COLOUR} <= colours
    assert (plan == LANE_COLOURS["driving"]).all(axis=2).mean() > 0.01


def test_the_plan_of_a_road_without_agents_has_coordinates(crossroads: Spec) -> None:
    bare = crossroads.road.model_copy(update={"agents": {}})

    plan = draw_plan(build_road(bare))

    # No road is in the margin, but the lines of the grid.
    lines = (plan[:60] != BACKGROUND_COLOUR).any(axis=2).all(axis=0)
    # The site is 433 m wide with its margins: a line of a pixel or two every 50 m.
    assert 8 <= lines.sum() <= 40


def test_the_plan_of_a_road_without_agents_names_its_lanes(
    crossroads: Spec, monkeypatch: pytest.MonkeyPatch
) -> None:
    texts: list[str] = []

    def keep(_: PlanCanvas, at: object, label: str, *colour: object, needed: bool = False) -> None:
        texts.append(label)

    monkeypatch.setattr(PlanCanvas, "text", keep)

    draw_plan(build_road(crossroads.road.model_copy(update={"agents": {}})))

    # Four streets with a driving lane each way, beside their sidewalk, which has the index 0.
    assert texts.count("+_1") == texts.count("-_1") == 4
    assert "grosse_strasse_1" in texts
    assert "150 m" in texts


def test_the_junctions_of_a_map_are_listed_with_their_arms(crossroads: Spec) -> None:
    facts = describe_road(crossroads.road)

    assert "grosse_strasse_1" in facts["streets"]
    assert facts["junction j1"].startswith("signals: ")
    assert "road_12_2 (east)" in facts["junction j1"]


def test_a_two_way_street_has_a_yellow_line_between_and_white_ones_at_its_edges(
    bend: Spec, tmp_path: Path
) -> None:
    """The lanes of the straight part lie from -3.5 to 3.5 m; lines at edges are 0.1 m inside."""
    found: dict[str, set[float]] = {}
    for mesh in road_meshes(bend, tmp_path):
        middle = mesh.vertices[mesh.triangles].mean(axis=1)
        straight = middle[(middle[:, 0] > 20) & (middle[:, 0] < 80)]
        found[mesh.material] = set(np.round(straight[:, 1].astype(float), 1).tolist())
    assert found["paint_white"] == {-3.4, 3.4}
    assert found["paint_yellow"] == {0.0}
