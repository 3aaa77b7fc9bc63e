"""Streets that lead over others: seen from above, from below and from beside."""

from pathlib import Path

import numpy as np
import pytest
import shapely
from advercity_dsl import Road, Spec
from numpy.typing import NDArray

from advercity.geometry.mesh import Mesh
from advercity.rendering.raycaster import Raycaster, RayHits, Rays
from advercity.roads.lane_segments import LaneSegment
from advercity.roads.road_network import build_road
from advercity.scene.build import build_world
from advercity.scene.decks import find_decks
from advercity.semantics import Semantic
from advercity.testing import make_frame
from advercity.world import World
from tests.roads.declared_levels import declare_two_levels
from tests.roads.imported_roads import TWO_LEVELS, compiled

RISE_M, SLAB_M = 5.5, 0.9
Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def two_levels(library: Path, tmp_path_factory: pytest.TempPathFactory) -> Spec:
    return compiled(library, tmp_path_factory.mktemp("two_levels"), TWO_LEVELS)


@pytest.fixture(scope="module")
def world(two_levels: Spec) -> World:
    return build_world(two_levels, Path("none"))


@pytest.fixture(scope="module")
def solid(world: World) -> Raycaster:
    """Paving, decks and ground alone."""
    names = ("asphalt", "sidewalk", "kerb", "decks", "ground")
    meshes = tuple(mesh for mesh in world.static if mesh.name in names)
    caster = Raycaster(World("solid", meshes, {}, (), Path("none")))
    caster.place(make_frame())
    return caster


def cast(caster: Raycaster, points: Array, direction: tuple[float, float, float]) -> RayHits:
    directions = np.tile(np.array(direction, np.float32), (len(points), 1))
    return caster.cast(Rays(points.astype(np.float32), directions), 100.0)


def grid_under_deck(z: float) -> Array:
    """Points (n, 3) over the lower street with its sidewalks, under the deck."""
    along, across = np.meshgrid(np.linspace(-5, 5, 21), np.linspace(-7, 7, 29))
    # The upper street runs at 60 degrees.
    x = along / np.sin(np.pi / 3) * 0.8 + across / np.tan(np.pi / 3)
    return np.column_stack([x.ravel(), across.ravel(), np.full(x.size, z)])


def test_a_deck_has_an_underside(solid: Raycaster) -> None:
    hits = cast(solid, grid_under_deck(2.0), (0, 0, 1))
    assert (hits.semantic == Semantic.BRIDGE).all()
    np.testing.assert_allclose(2.0 + hits.range_m, RISE_M - SLAB_M, atol=1e-3)
    np.testing.assert_allclose(hits.normal[:, 2], -1.0, atol=1e-3)


def test_the_ground_below_is_closed_and_level_with_the_lower_street(solid: Raycaster) -> None:
    points = grid_under_deck(2.0)
    hits = cast(solid, points, (0, 0, -1))
    z = 2.0 - hits.range_m
    assert (np.abs(z) < 0.2).all()
    roadway = np.abs(points[:, 1]) < 3.0
    assert (hits.semantic[roadway] == Semantic.ROAD).all()
    np.testing.assert_allclose(z[roadway], 0.0, atol=1e-3)
    walked = (np.abs(points[:, 1]) > 3.5) & (np.abs(points[:, 1]) < 4.9)
    assert (hits.semantic[walked] == Semantic.SIDEWALK).all()
    np.testing.assert_allclose(z[walked], 0.15, atol=1e-3)


def test_the_upper_street_is_paved_through(solid: Raycaster) -> None:
    along = np.linspace(-30, 30, 61)
    ahead, left = np.array([0.5, np.sqrt(3) / 2]), np.array([-np.sqrt(3) / 2, 0.5])
    for off_m, semantic, lift_m in ((1.6, Semantic.ROAD, 0.0), (4.2, Semantic.SIDEWALK, 0.15)):
        for side in (-off_m, off_m):
            plan = along[:, None] * ahead + side * left
            hits = cast(solid, np.column_stack([plan, np.full(61, 20.0)]), (0, 0, -1))
            np.testing.assert_allclose(20.0 - hits.range_m, RISE_M + lift_m, atol=1e-3)
            assert (hits.semantic == semantic).all()


def test_abutments_close_the_filled_ground_behind_them(solid: Raycaster) -> None:
    points = grid_under_deck(2.0)
    for side in (1.0, -1.0):
        hits = cast(solid, points, (side * 0.5, side * np.sqrt(3) / 2, 0))
        assert np.isfinite(hits.range_m).all()
        reached = points[:, 1] + side * np.sqrt(3) / 2 * hits.range_m
        # The margin beyond the sidewalk, 2.5 m wide.
        np.testing.assert_allclose(side * reached, 5.05 + 2.5, atol=0.3)
        assert (hits.semantic == Semantic.BRIDGE).mean() > 0.95


def test_parapets_stand_beside_the_upper_street(solid: Raycaster) -> None:
    middle = np.column_stack([np.zeros((1, 2)), np.full(1, RISE_M + 0.7)])
    for side in (1.0, -1.0):
        hits = cast(solid, middle, (side * np.sqrt(3) / 2, -side * 0.5, 0))
        assert hits.semantic[0] == Semantic.BRIDGE
        assert hits.range_m[0] == pytest.approx(5.05, abs=0.05)
        over = cast(solid, middle + np.array([0, 0, 0.5]), (side * np.sqrt(3) / 2, -side * 0.5, 0))
        assert not over.range_m[0] < 20


def test_no_strip_of_ground_stands_before_an_abutment(world: World) -> None:
    soil = [mesh for mesh in world.static if mesh.name.startswith("verge_") and len(mesh.triangles)]
    heights = [
        np.ptp(mesh.vertices[mesh.triangles][..., 2], axis=1).max()
        for mesh in soil
        if "soil" in mesh.material
    ]
    assert heights
    assert max(heights) < 0.5


def test_a_deck_is_closed(world: World) -> None:
    (decks,) = (mesh for mesh in world.static if mesh.name == "decks")
    assert enclosed_m3(decks) > 100


def enclosed_m3(mesh: Mesh) -> float:
    """Volume that faces which look outward enclose."""
    a, b, c = (mesh.vertices[mesh.triangles[:, k]].astype(float) for k in range(3))
    return float(np.sum(a * np.cross(b, c)) / 6)


def lane(heading_deg: float, height_m: float, name: str = "lane") -> LaneSegment:
    turn = np.radians(heading_deg)
    ahead = np.array([np.cos(turn), np.sin(turn)])
    left = np.array([-ahead[1], ahead[0]])
    line = np.linspace(-60, 60, 13)[:, None] * ahead
    z = np.full((13, 1), height_m)
    return LaneSegment(
        name, "driving", np.hstack([line + 2 * left, z]), np.hstack([line - 2 * left, z])
    )


@pytest.mark.parametrize(("rise_m", "slab_m"), [(2.1, 0.525), (3.0, 0.75), (7.0, 0.9)])
def test_a_lane_that_rises_over_another_has_a_deck(rise_m: float, slab_m: float) -> None:
    for lanes in ((lane(0, 0), lane(90, rise_m)), (lane(90, 40 + rise_m), lane(0, 40))):
        (deck,) = find_decks(lanes)
        assert deck.slab_m == pytest.approx(slab_m)
        # Four metres of each lane, and the margins before the abutments.
        assert deck.carried.area == pytest.approx(4 * (4 + 2 * 2.5), rel=0.01)
        assert shapely.Point(0, 4.4).within(deck.carried)
        top_m = max(item.left[0, 2] for item in lanes)
        np.testing.assert_allclose(deck.heights.height_at(np.zeros((1, 2))), top_m)


@pytest.mark.parametrize("high_m", [6.5, 2.1, -5.0])
def test_a_declared_street_leads_over_or_under_another(high_m: float) -> None:
    (deck,) = find_decks(build_road(Road.model_validate(declare_two_levels(high_m))).lanes)
    # Where both axes cross, the deck carries the upper one.
    height_m = deck.heights.height_at(np.zeros((1, 2)))
    np.testing.assert_allclose(height_m, max(high_m, 0.0), atol=0.01)


@pytest.mark.parametrize("rise_m", [0.0, 0.5, 1.9])
def test_lanes_that_meet_have_no_deck(rise_m: float) -> None:
    assert find_decks((lane(0, 0), lane(90, rise_m))) == ()


def test_each_level_of_a_stack_has_a_deck_of_its_own() -> None:
    decks = find_decks((lane(0, 0), lane(90, 6), lane(45, 12)))
    heights = sorted(float(deck.heights.height_at(np.zeros((1, 2)))[0]) for deck in decks)
    np.testing.assert_allclose(heights, [6, 12], atol=1e-6)


def test_shipped_roads_have_no_decks(specs: dict[str, Spec]) -> None:
    roads: dict[str, Road] = {spec.road.id: spec.road for spec in specs.values()}
    assert len(roads) >= 5
    assert all(find_decks(build_road(road).lanes) == () for road in roads.values())
