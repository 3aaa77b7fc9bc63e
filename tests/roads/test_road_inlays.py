"""Repairs of roadways, and covers and gratings in them."""

from pathlib import Path

import numpy as np
import pytest
import shapely

from advercity.compiler import read_spec
from advercity.geometry.mesh import build_ribbon
from advercity.roads.ironwork import COVER_RADII_M, place_ironwork
from advercity.roads.lane_segments import LaneSegment
from advercity.roads.pavement_repairs import place_repairs
from advercity.roads.road_inlays import RoadInlay, build_inlay_meshes
from advercity.roads.road_network import RoadNetwork, build_road
from advercity.semantics import Semantic


def lane(kind: str = "driving", y: float = 0.0, name: str = "road+.1") -> LaneSegment:
    """From (0, y) 300 m to the east, 3.5 m wide, climbing by 5 %."""
    x = np.array([0.0, 300.0])
    left, right = (np.column_stack([x, np.full(2, y + t), 0.05 * x]) for t in (1.75, -1.75))
    return LaneSegment(name, kind, left, right)


@pytest.fixture(scope="module")
def town() -> RoadNetwork:
    return build_road(read_spec(Path("compiled/ui_clear_day_dense.json")).road)


def test_inlays_lie_on_the_asphalt_below_paint():
    ground = lane()
    asphalt = build_ribbon(ground.left, ground.right).to_mesh("asphalt", "asphalt", Semantic.ROAD)
    inlays = [
        *place_repairs([ground], "key"),
        RoadInlay("cast_iron", shapely.box(9, 0, 10, 1), 0.5),
    ]
    for mesh in build_inlay_meshes(inlays, [asphalt]):
        assert mesh.semantic is Semantic.ROAD
        lift = mesh.vertices[:, 2] - 0.05 * mesh.vertices[:, 0]
        np.testing.assert_allclose(lift, 0.0045, atol=1e-5)
        assert np.abs(mesh.vertices[:, 1]).max() < 1.75 + 0.05


def test_an_inlay_over_another_road_is_on_neither():
    ground = lane()
    asphalt = build_ribbon(ground.left, ground.right).to_mesh("asphalt", "asphalt", Semantic.ROAD)
    assert not build_inlay_meshes([RoadInlay("bitumen", shapely.box(9, 0, 10, 1), 20.0)], [asphalt])


def test_repairs_keep_clear_of_crossings_and_of_the_borders_of_lanes():
    across = np.array([[150.0, -4.0, 7.5], [150.0, 4.0, 7.5]])
    wide = np.array([20.0, 0.0, 0.0])
    crossing = LaneSegment("j/road", "crossing", across - wide, across + wide)
    found = place_repairs([lane(), crossing], "key")
    assert found
    x = np.concatenate([shapely.get_coordinates(item.outline)[:, 0] for item in found])
    assert not ((x > 130) & (x < 170)).any()
    patches = [item for item in found if item.outline.area > 0.3]
    assert patches
    for patch in patches:
        assert np.abs(shapely.get_coordinates(patch.outline)[:, 1]).max() < 1.6


def test_no_repair_lies_over_another_one_or_on_what_is_reserved():
    found = place_repairs([lane()], "key", shapely.box(100, -2, 120, 2))
    assert not any(shapely.intersects(item.outline, shapely.box(100, -2, 120, 2)) for item in found)
    patches = [item.outline for item in found if item.material != "bitumen"]
    bands = [item.outline for item in found if item.material == "bitumen"]
    overlap = shapely.area(shapely.intersection(shapely.union_all(patches), bands))
    assert overlap.max() < 1e-6


def test_streets_of_different_age_have_different_numbers_of_repairs():
    counts = {len(place_repairs([lane(name=f"street{n}+.1")], "key")) for n in range(6)}
    assert max(counts) > 2 * min(counts)


def test_repairs_depend_on_key_and_lane_alone():
    first, again = (place_repairs([lane(), lane(y=9, name="b+.1")], "key") for _ in range(2))
    assert [item.outline for item in first] == [item.outline for item in again]
    other = place_repairs([lane()], "another")
    assert [item.outline for item in first[: len(other)]] != [item.outline for item in other]


def test_covers_are_round_and_in_built_up_streets_alone():
    assert not place_ironwork([lane()], "key")
    found = place_ironwork([lane(), lane("sidewalk", y=-4.0, name="road+.sidewalk1")], "key")
    covers = [item for item in found if item.material == "cast_iron" and item.outline.area > 0.2]
    assert 5 <= len(covers) <= 8
    for cover in covers:
        x, y, right, top = cover.outline.bounds
        assert right - x == pytest.approx(2 * COVER_RADII_M[0], rel=0.01)
        assert top - y == pytest.approx(2 * COVER_RADII_M[0], rel=0.01)
        assert abs(y + top) / 2 < 0.4


def test_gratings_are_on_the_roadway_before_a_kerb():
    sidewalk = lane("sidewalk", y=-4.0, name="road+.sidewalk1")
    gratings = place_ironwork([sidewalk], "key")
    assert gratings
    y = np.concatenate([shapely.get_coordinates(item.outline)[:, 1] for item in gratings])
    assert -2.25 < y.min() < y.max() < -1.8


def test_a_town_has_all_of_them_on_its_roadways(town: RoadNetwork):
    inlays = [*place_repairs(town.lanes, "ui"), *place_ironwork(town.lanes, "ui")]
    meshes = build_inlay_meshes(inlays, town.meshes)
    assert {mesh.material for mesh in meshes} == {
        "bitumen",
        "asphalt_new",
        "asphalt_aged",
        "cast_iron",
    }
    roadway = shapely.buffer(town.roadway_level_area, 0.02)
    for mesh in meshes:
        assert shapely.contains_xy(roadway, *mesh.vertices[:, :2].T).mean() > 0.999


def test_a_road_without_roadways_has_none():
    assert not build_inlay_meshes(place_repairs([], "key"), [])
