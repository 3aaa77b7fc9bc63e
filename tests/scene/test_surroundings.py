from collections.abc import Mapping

import numpy as np
import pytest
import shapely
from advercity_dsl import Road, RoadsideUnit
from advercity_dsl.road import BuildingUse, LampType, Surrounding, SurroundingKind
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray
from pydantic import ValidationError

from advercity.assets.glyphs import build_glyph
from advercity.errors import InputError
from advercity.geometry import poses
from advercity.geometry.mesh import Mesh
from advercity.materials import MATERIALS, Texture
from advercity.rendering.panes import PANE_MATERIALS
from advercity.roads.layout import lay_out_road
from advercity.roads.road_network import build_road
from advercity.scene import terrain
from advercity.scene.site import GroundHeight
from advercity.scene.street_furniture import build_street_furniture
from advercity.scene.surroundings import build_surroundings
from advercity.semantics import Semantic
from tests.shipped import LIBRARY

ROADS = LIBRARY.get_declarations(Road)
every_road = pytest.mark.parametrize("name", ROADS)
PAVED = shapely.box(-100, -5, 100, 5)


EGO = {
    "kind": "vehicle",
    "role": "ego",
    "spawn_m": (-90, -1.75),
    "heading_deg": 0,
    "destination_m": (90, -1.75),
    "max_speed_km_h": 50,
}


def beside(kind: str, **place: object) -> Surrounding:
    """Something beside the street, on both sides of all of it unless said otherwise."""
    item = {key: place.pop(key) for key in ("spacing_m", "species", "seed") if key in place}
    where = {"street": "road", "side": "both", **place}
    return Surrounding.model_validate({"kind": kind, "beside": where, **item})


def level(points: np.ndarray) -> np.ndarray:
    return np.zeros(len(points))


def sloping(points: np.ndarray) -> np.ndarray:
    return 0.05 * points[:, 0]


def street(*items: Surrounding, bend: Mapping[str, object] | None = None, **agents: object) -> Road:
    """A street with the given surroundings, straight along x from -100 to 100 without `bend`."""
    section = {
        "left": [{"kind": "lane", "width_m": 3.5}],
        "right": [{"kind": "lane", "width_m": 3.5}],
    }
    axis = {
        "begins": "west",
        "ends": "east",
        "start_m": (-100, 0),
        "heading_deg": 0,
        "path": [{"line_m": 200}],
        "section": "lanes",
        "speed_limit_km_h": 50,
        **(bend or {}),
    }
    shares = dict.fromkeys(("car", "van", "truck", "bicycle", "motorcycle"), 0.2)
    return Road.model_validate(
        {
            "id": "street",
            "land_use": "rural",
            "junction": "non_junction",
            "alignment": "straight",
            "profile": "level",
            "sections": {"lanes": section},
            "streets": {"road": axis},
            "surroundings": [item.model_dump() for item in items],
            "agents": {"cav1": EGO, **agents},
            "traffic": {
                "vehicles_per_area": 1,
                "walkers": 0,
                "around_agent_m": 50,
                "around_path_m": 10,
                "classes": shares,
            },
        }
    )


def built(item: Surrounding, ground: GroundHeight = level) -> list[Mesh]:
    return build_surroundings(build_road(street(item)), ground, PAVED)[0]


def points(meshes: list[Mesh], *classes: Semantic) -> np.ndarray:
    chosen = [mesh.vertices for mesh in meshes if not classes or mesh.semantic in classes]
    return np.concatenate(chosen).astype(np.float64)


def triangles(meshes: list[Mesh]) -> int:
    return sum(len(mesh.triangles) for mesh in meshes)


def roadway(road: Road):
    parts = []
    for item in lay_out_road(road).streets.values():
        left = item.offset_line(
            max(band.outer_t for band in item.left_strips) if item.left_strips else 0.0
        )
        right = item.offset_line(
            min(band.outer_t for band in item.right_strips) if item.right_strips else 0.0
        )
        parts.append(shapely.Polygon(np.concatenate([left, right[::-1]])[:, :2]).buffer(0))
    parts += [
        shapely.Polygon(j.roadway_outline[:, :2]).buffer(0)
        for j in lay_out_road(road).junctions.values()
    ]
    return shapely.union_all(parts)


def trunk_points(meshes: list[Mesh]) -> NDArray[np.float64]:
    """Points of trunks; branches begin higher."""
    bark = points([mesh for mesh in meshes if mesh.material == "bark"])
    return bark[bark[:, 2] < 0.6]


def test_trees_keep_off_the_road_and_fill_their_area():
    item = Surrounding(kind=SurroundingKind.TREES, area_m=((-60, -30), (60, 30)))
    meshes = built(item)
    trunks = trunk_points(meshes)
    assert {mesh.semantic for mesh in meshes} == {Semantic.VEGETATION}
    distance = shapely.distance(PAVED, shapely.points(trunks[:, :2]))
    assert distance.min() > 2.0
    assert (np.abs(trunks[:, :2]).max(axis=0) > (50, 24)).all()


def test_trees_outgrow_a_person_and_have_few_triangles_each():
    area = ((-60, 20), (60, 90))
    wide = built(Surrounding(kind=SurroundingKind.TREES, area_m=area, spacing_m=10))
    trees = 12 * 7
    assert 200 * trees <= triangles(wide) <= 1800 * trees
    assert 5 < points(wide)[:, 2].max() < 16


def test_hedges_have_leaves_on_their_sides():
    hedge = built(Surrounding(kind=SurroundingKind.HEDGE, line_m=((20, 20), (40, 20))))
    inside, leaves = (
        next(mesh for mesh in hedge if mesh.material == material)
        for material in ("inner_leaves", "leaves")
    )
    assert len(leaves.triangles) > 2000
    low, high = (
        reduce(leaves.vertices, 0) - reduce(inside.vertices, 0) for reduce in (np.min, np.max)
    )
    # Roots are up to 0.4 leaves of 0.25 m off the sides; the longest leaf is 1.35 times as long.
    assert np.all((low < 0.0) & (low > -0.44))
    assert np.all((high > 0.0) & (high < 0.44))


def test_a_forest_has_no_more_than_four_hundred_trees():
    area = ((-500, 20), (500, 520))
    item = Surrounding(kind=SurroundingKind.TREES, area_m=area, spacing_m=4)
    assert triangles(built(item)) <= 400 * 1300


def test_objects_follow_sloping_ground():
    area = ((20, 20), (90, 60))
    trees = built(Surrounding(kind=SurroundingKind.TREES, area_m=area), sloping)
    bark = points([mesh for mesh in trees if mesh.material == "bark"])
    above = bark[:, 2] - sloping(bark)
    assert -0.3 < above.min() < 0.0
    house = points(built(Surrounding(kind=SurroundingKind.HOUSES, area_m=area), sloping))
    assert (house[:, 2] - sloping(house)).min() < 0


@pytest.mark.parametrize(("use", "slope"), [("industrial", 0.25), ("residential", 4.5 / 8.0)])
def test_a_wide_building_has_the_gables_it_declares(use: BuildingUse, slope: float):
    """18 m by 16 m and 10 m high: no more than 4.5 m of it are roof, which 0.75 would exceed."""
    outline = ((-9, 20), (9, 20), (9, 36), (-9, 36))
    item = Surrounding(
        kind=SurroundingKind.BUILDINGS, line_m=outline, use=use, roof="gabled", height_m=10
    )
    at = points(built(item), Semantic.BUILDING)
    beyond = at[np.abs(at[:, 0]) > 9.2]
    assert set(np.sign(beyond[beyond[:, 2] > 9.9][:, 0])) == {-1.0, 1.0}, "a ridge, end to end"
    walls = at[(np.abs(at[:, 0]) < 9.2) & (at[:, 2] > 9.9)]
    assert walls[:, 1] == pytest.approx(28.0)
    ridge_m, eaves_m = (float(beyond[np.abs(beyond[:, 1] - y) < 0.5, 2].max()) for y in (28, 36.4))
    assert (ridge_m - eaves_m) / 8.4 == pytest.approx(slope, abs=0.01)


@pytest.mark.parametrize("kind", [SurroundingKind.HOUSES, SurroundingKind.BUILDINGS])
def test_buildings_stay_off_the_road_and_inside_their_area(kind: SurroundingKind):
    meshes = built(Surrounding(kind=kind, area_m=((-80, -40), (80, 40))))
    feet = points(meshes, Semantic.BUILDING)
    feet = feet[feet[:, 2] < 0.3]
    assert shapely.distance(PAVED, shapely.points(feet[:, :2])).min() > 0.5
    assert (np.abs(feet[:, :2]).max(axis=0) < (82, 42)).all()
    assert {"glass", "wood"} <= {mesh.material for mesh in meshes}


def test_houses_have_gardens():
    area = ((-80, 10), (80, 40))
    meshes = built(Surrounding(kind=SurroundingKind.HOUSES, area_m=area))
    green = points(meshes, Semantic.VEGETATION)
    assert 4 < green[:, 2].max() < 8
    assert shapely.distance(PAVED, shapely.points(green[green[:, 2] < 1, :2])).min() > 0.5


def test_town_blocks_are_six_to_twenty_metres_high():
    item = Surrounding(kind=SurroundingKind.BUILDINGS, area_m=((-90, 10), (90, 60)))
    top = points(built(item))[:, 2].max()
    assert 10 < top < 30


def test_a_declared_height_is_kept_by_town_blocks():
    area = ((-90, 10), (90, 60))
    low = Surrounding(kind=SurroundingKind.BUILDINGS, area_m=area, height_m=6.2)
    panes = points([mesh for mesh in built(low) if mesh.material in PANE_MATERIALS])[:, 2]
    # Windows of a third storey would begin at 7.5 m, those of dormers begin above 8.5 m.
    assert panes[panes < 8.4].max() == pytest.approx(2 * 3.1 - 0.3, abs=0.3)


def test_crops_cover_their_field_but_no_road():
    item = Surrounding(kind=SurroundingKind.CROPS, area_m=((-50, -30), (50, 30)), height_m=0.8)
    meshes = built(item)
    field = points(meshes)
    assert {mesh.semantic for mesh in meshes} == {Semantic.VEGETATION}
    assert shapely.distance(PAVED, shapely.points(field[:, :2])).min() > 0.3
    assert 0.8 < field[:, 2].max() < 1.6
    assert field[:, 1].min() < -28
    assert field[:, 1].max() > 28


def test_a_wall_follows_its_line_at_the_declared_height():
    item = Surrounding(kind=SurroundingKind.WALL, line_m=((0, 10), (40, 10)), height_m=8)
    meshes = built(item)
    wall = points(meshes)
    assert {mesh.semantic for mesh in meshes} == {Semantic.WALL}
    assert wall[:, 2].max() == pytest.approx(8, abs=0.01)
    np.testing.assert_allclose((wall[:, 0].min(), wall[:, 0].max()), (0, 40), atol=0.01)
    assert np.abs(wall[:, 1] - 10).max() < 0.5


def test_walls_low_enough_to_look_over_are_of_brick():
    line = ((0, 10), (40, 10))
    low = built(Surrounding(kind=SurroundingKind.WALL, line_m=line, height_m=1.5))
    assert "brick" in {mesh.material for mesh in low}


def test_street_lamps_extend_over_the_road_and_emit_light():
    item = Surrounding(kind=SurroundingKind.LAMP, line_m=((-60, 6), (60, 6)), spacing_m=30)
    meshes, lamps, _ = build_surroundings(build_road(street(item)), level, PAVED)
    assert {mesh.semantic for mesh in meshes} == {Semantic.POLE}
    np.testing.assert_allclose(
        [lamp.position[0] for lamp in lamps], (-60, -30, 0, 30, 60), atol=1e-9
    )
    for lamp in lamps:
        assert lamp.position[1] == pytest.approx(6 - 1.6)
        assert 7.5 < lamp.position[2] < 8.1


@pytest.mark.parametrize(
    ("lamp", "height_m", "arm_m"),
    [("arm", 8.0, 1.6), ("lantern", 4.2, 0.2), ("wooden_pole", 8.0, 1.6), ("column", 12.0, 2.4)],
)
def test_the_light_of_every_type_of_lamp_is_below_its_head(
    lamp: LampType, height_m: float, arm_m: float
):
    item = Surrounding(kind=SurroundingKind.LAMP, at_m=((0, 6),), lamp=lamp)
    meshes, (light,), _ = build_surroundings(build_road(street(item)), level, PAVED)
    assert light.position == pytest.approx((0.0, 6.0 - arm_m, height_m - 0.1))
    glass = np.concatenate([mesh.vertices for mesh in meshes if mesh.material == "lamp_white"])
    middle = (glass.min(axis=0) + glass.max(axis=0)) / 2
    np.testing.assert_allclose(middle[:2], light.position[:2], atol=0.21)
    assert glass[:, 2].min() > light.position[2]  # nothing of the lamp shades its light
    assert abs(middle[2] - light.position[2]) < 0.35
    assert height_m < points(meshes)[:, 2].max() < height_m + 0.8


def test_lamps_are_of_the_type_of_their_place():
    item = Surrounding(kind=SurroundingKind.LAMP, at_m=((0, 6),))
    seen: dict[tuple[str, float], tuple[bool, float]] = {}
    for land_use, limit_km_h in (("urban", 50), ("rural", 50), ("rural", 100)):
        declared = street(item).model_dump(mode="json", exclude_none=True)
        for one in declared["streets"].values():
            one["speed_limit_km_h"] = limit_km_h
        road = Road.model_validate(declared | {"land_use": land_use})
        meshes, (light,), _ = build_surroundings(build_road(road), level, PAVED)
        has_wood = "wood" in {mesh.material for mesh in meshes}
        seen[land_use, limit_km_h] = has_wood, round(light.position[2], 1)
    assert list(seen.values()) == [(False, 7.9), (True, 7.9), (False, 11.9)]


def test_only_lamps_have_a_type_of_lamp():
    with pytest.raises(ValidationError, match="only lamps have a type 'lamp'"):
        Surrounding(kind=SurroundingKind.POLE, at_m=((0, 6),), lamp="lantern")


def test_a_pole_and_a_tower_are_as_high_as_declared():
    for kind, semantic in (
        (SurroundingKind.POLE, Semantic.POLE),
        (SurroundingKind.TOWER, Semantic.STATIC),
    ):
        meshes = built(Surrounding(kind=kind, at_m=((10, 12),), height_m=7.8), sloping)
        assert {mesh.semantic for mesh in meshes} == {semantic}
        assert points(meshes)[:, 2].max() == pytest.approx(0.5 + 7.8, abs=0.02)


def test_a_bus_stop_is_open_to_the_road():
    meshes = built(Surrounding(kind=SurroundingKind.BUS_STOP, at_m=((0, 8),)))
    back = points([mesh for mesh in meshes if mesh.material == "glass"])
    assert back[:, 1].max() > 8.6
    assert points(meshes)[:, 1].min() < 7.1
    assert points(meshes)[:, 2].max() > 2.4


@pytest.mark.parametrize(
    ("kind", "needed"),
    [
        (SurroundingKind.HOUSES, "area_m"),
        (SurroundingKind.CROPS, "area_m"),
        (SurroundingKind.WALL, "line_m"),
    ],
)
def test_a_surrounding_without_placement_is_an_error(kind: SurroundingKind, needed: str):
    with pytest.raises(ValidationError, match=needed):
        Surrounding(kind=kind, height_m=2)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"kind": "wall", "at_m": [(0, 20)]}, "wall has at_m; give it 'beside' or 'line_m'"),
        ({"kind": "fence", "species": ["oak"], "line_m": [(0, 9), (9, 9)]}, "only trees"),
        ({"kind": "plateau", "line_m": [(0, 9), (9, 9)], "height_m": 2}, "three points"),
        ({"kind": "crops", "beside": {"street": "road", "side": "left"}}, "two offsets"),
        ({"kind": "woods", "beside": {"street": "road", "side": "left"}}, "two offsets"),
        ({"kind": "wall", "line_m": [(0, 9), (9, 9)], "limit_km_h": 30}, "only a speed sign"),
        (
            {"kind": "trees", "beside": {"street": "road", "side": "left", "offset_m": (9, 4)}},
            "nearer border",
        ),
        (
            {"kind": "hedge", "beside": {"street": "road", "side": "left", "from_m": 9, "to_m": 4}},
            "greater than",
        ),
    ],
)
def test_an_invalid_placement_is_an_error(wrong: dict[str, object], message: str):
    with pytest.raises(ValidationError, match=message):
        Surrounding.model_validate(wrong)


def test_an_unknown_street_is_an_error_that_lists_the_known_ones():
    with pytest.raises(
        ValidationError, match=r"surroundings.0.beside.street: unknown name 'raod'.*'road'"
    ):
        street(beside("hedge", street="raod"))


def test_a_placement_beyond_the_end_of_its_street_is_an_error():
    with pytest.raises(InputError, match=r"surroundings.0: from_m is 250.*'road' is only 200.0 m"):
        built(beside("hedge", from_m=250))


def test_trees_along_a_street_fill_their_band_on_the_declared_side():
    band = {"side": "left", "from_m": 50, "to_m": 150, "offset_m": (10, 40)}
    meshes = built(beside("trees", spacing_m=6, species=["oak"], **band))
    trunks = trunk_points(meshes)
    assert trunks[:, 0].min() > -50.5
    assert trunks[:, 0].max() < 50.5
    assert (trunks[:, 1].min() > 13, trunks[:, 1].max() < 44) == (True, True)
    assert np.ptp(trunks[:, :2], axis=0) == pytest.approx((100, 30), abs=7)
    assert "needles" not in {mesh.material for mesh in meshes}


def test_another_seed_gives_other_trees():
    first, second = (
        points(built(beside("trees", seed=seed, offset_m=(10, 40)))) for seed in (0, 1)
    )
    assert first.shape != second.shape or not np.allclose(first, second)


def test_lamps_on_both_sides_of_a_street_alternate():
    item = beside("lamp", spacing_m=40, from_m=20, offset_m=2)
    _, lamps, _ = build_surroundings(build_road(street(item)), level, PAVED)
    places = np.array([lamp.position[:2] for lamp in lamps])
    left, right = places[places[:, 1] > 0], places[places[:, 1] < 0]
    np.testing.assert_allclose(left[:, 0], (-80, -40, 0, 40, 80), atol=1e-9)
    np.testing.assert_allclose(right[:, 0], (-60, -20, 20, 60, 100))
    np.testing.assert_allclose(np.abs(places[:, 1]), 3.5 + 2 - 1.6)


def test_houses_along_a_street_face_it_with_their_doors():
    meshes = built(beside("houses", side="right", offset_m=8))
    doors = points([m for m in meshes if m.name == "surroundings_building_wood"])
    walls = points([m for m in meshes if m.semantic is Semantic.BUILDING])
    assert doors[:, 1].min() == doors[:, 1].max() == pytest.approx(-11.7, abs=0.1)
    assert walls[:, 1].max() < -10


def test_a_fence_lets_side_streets_through():
    paved = shapely.union(PAVED, shapely.box(-10, 0, 10, 50))
    fence = build_surroundings(
        build_road(street(beside("fence", side="left", offset_m=4))), level, paved
    )[0]
    assert {mesh.semantic for mesh in fence} == {Semantic.FENCE}
    x = points(fence)[:, 0]
    assert np.abs(x).min() > 10
    assert (x.min(), x.max()) == pytest.approx((-100, 100), abs=0.1)


def test_nothing_folds_over_on_the_inside_of_a_bend():
    bend = {"path": [{"arc_m": 60, "radius_m": 20, "turn": "left"}], "start_m": (0, -20)}
    item = beside("crops", side="left", offset_m=(2, 60))
    road = street(item, bend=bend)
    axis = lay_out_road(road).streets["road"].axis[:, :2]
    field = points(
        build_surroundings(build_road(road), level, shapely.LineString(axis).buffer(3.5))[0]
    )
    assert shapely.distance(shapely.LineString(axis), shapely.points(field[:, :2])).min() > 4


def test_a_speed_sign_faces_the_traffic_on_its_side():
    for side, sign in (("right", 1), ("left", -1)):
        item = Surrounding.model_validate(
            {
                "kind": "speed_sign",
                "beside": {"street": "road", "side": side, "from_m": 60, "offset_m": 1},
                "limit_km_h": 70,
            }
        )
        meshes = built(item)
        digits = next(m for m in meshes if m.name == "surroundings_traffic_sign_black_plastic")
        np.testing.assert_allclose(
            digits.vertices[:, :2].mean(axis=0), (-40, -sign * 4.5), atol=0.1
        )
        assert digits.normals is not None
        np.testing.assert_allclose(digits.normals @ (1, 0, 0), -sign, atol=1e-6)
        # Seen from in front, the few corners of the 7 are left of the many of the 0.
        aside = (digits.vertices[:, 1] + sign * 4.5) * -sign
        glyphs = [build_glyph(digit).surface for digit in "70"]
        corners = [0 if one is None else len(one.vertices) for one in glyphs]
        assert corners[0] < corners[1]
        assert [(aside < 0).sum(), (aside > 0).sum()] == corners


def test_a_speed_sign_shows_the_limit_of_its_street_by_default():
    where = {"street": "road", "side": "right", "from_m": 60}
    kind = {"kind": "speed_sign", "beside": where}
    own, same, other = (
        points(built(Surrounding.model_validate(kind | limit)), Semantic.TRAFFIC_SIGN)
        for limit in ({}, {"limit_km_h": 50}, {"limit_km_h": 80})
    )
    np.testing.assert_array_equal(own, same)
    assert own.shape != other.shape


def test_woods_keep_off_the_road_and_have_ragged_edges():
    item = Surrounding(kind=SurroundingKind.WOODS, area_m=((-60, -40), (60, 40)))
    wood = points(built(item))
    assert shapely.distance(PAVED, shapely.points(wood[:, :2])).min() > 4
    assert 8 < wood[:, 2].max() < 12
    assert shapely.MultiPoint(wood[:, :2]).convex_hull.area < 0.97 * 120 * 80


def test_a_wood_has_trees_on_the_side_of_its_street():
    item = Surrounding(kind=SurroundingKind.WOODS, area_m=((-60, 30), (60, 110)))
    high, low = 0.6 * 11, 1.0
    wood = points([mesh for mesh in built(item) if mesh.material.endswith("needles")])
    assert wood[wood[:, 2] < low, 1].max() < 90, "spruces"
    leaves = points([mesh for mesh in built(item) if mesh.material == "leaves"])
    assert (leaves[:, 2] > high).sum() > 500
    assert (leaves[:, 2] < low).sum() > 500, "down to the ground"
    assert leaves[:, 1].max() < 95


def test_a_driveway_begins_at_the_edge_of_the_paving():
    band = {"street": "road", "side": "left", "from_m": 50, "to_m": 57, "offset_m": (0, 8)}
    (mesh,) = built(Surrounding.model_validate({"kind": "driveway", "beside": band}))
    assert mesh.semantic is Semantic.ROAD
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    np.testing.assert_allclose(low, (-50, 3.5, 0.015), atol=1e-3)
    np.testing.assert_allclose(high, (-43, 11.5, 0.015), atol=1e-3)


@pytest.mark.parametrize(
    ("side_m", "height_m", "declared", "slope"),
    [
        (12, 7, {}, True),
        (12, 7, {"roof": "flat"}, False),
        (12, 12, {}, False),
        (24, 7, {}, False),
        (24, 12, {"use": "residential"}, False),
        (24, 12, {"use": "residential", "roof": "hipped"}, True),
        (24, 7, {"use": "commercial"}, False),
    ],
)
def test_houses_have_pitched_roofs_and_larger_buildings_flat_ones(
    side_m: int, height_m: float, declared: dict[str, str], slope: bool
):
    """Houses have less than 220 m2 and at most 9 m."""
    corners = [(-50, 20), (-50 + side_m, 20), (-50 + side_m, 20 + side_m), (-50, 20 + side_m)]
    outline = {"kind": "buildings", "line_m": corners, "height_m": height_m}
    meshes = built(Surrounding.model_validate(outline | declared))
    at = np.concatenate([mesh.vertices[mesh.triangles] for mesh in meshes]).astype(float)
    normals = np.cross(at[:, 1] - at[:, 0], at[:, 2] - at[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    rises = normals[:, 2] / np.maximum(areas, 1e-12)
    assert bool(areas[(rises > 0.3) & (rises < 0.97)].sum() / 2 > 0.8 * side_m**2) is slope


def test_nothing_grows_into_a_building():
    house = Surrounding(kind=SurroundingKind.HOUSES, area_m=((-6, 20), (6, 30)))
    forest = Surrounding(kind=SurroundingKind.TREES, area_m=((-30, 8), (30, 50)), spacing_m=4)
    meshes, *_ = build_surroundings(build_road(street(forest, house)), level, PAVED)
    walls = points(meshes, Semantic.BUILDING)[:, :2]
    trunks = points([mesh for mesh in meshes if mesh.material == "bark"])[:, :2]
    footprint = shapely.MultiPoint(walls).convex_hull
    assert footprint.area > 60
    assert shapely.distance(footprint, shapely.points(trunks)).min() > 1.0


def test_a_plateau_rises_behind_its_outline_and_meets_the_street_that_climbs_to_it():
    outline = ((-50, 20), (50, 20), (50, 90), (-50, 90))
    plateau = Surrounding(kind=SurroundingKind.PLATEAU, line_m=outline, height_m=8)
    level_rim = np.array([(-100.0, 5.0, 0.0), (100.0, 5.0, 0.0)])
    climbing_rim = np.array([(0.0, 21.0, 1.0), (0.0, 60.0, 8.0)])
    asked = np.array([(-40.0, 19.9), (-40.0, 22.0), (40.0, 60.0), (0.5, 30.0)])
    rims = [level_rim, climbing_rim]
    plateaus = terrain.find_plateaus(street(plateau))
    height = terrain.GroundModel.from_edges(rims, plateaus).height_at(asked)
    without = terrain.GroundModel.from_edges(rims).height_at(asked)
    assert height[0] == pytest.approx(without[0])
    np.testing.assert_allclose(height[1:3], 8, atol=0.05)
    assert height[3] == pytest.approx(1 + 7 * 9 / 39, abs=0.1)


def test_the_same_road_gives_the_same_bytes():
    item = Surrounding(kind=SurroundingKind.TREES, area_m=((-60, -30), (60, 30)))
    for first, second in zip(built(item), built(item), strict=True):
        assert first.vertices.tobytes() == second.vertices.tobytes()


@every_road
def test_shipped_roads_keep_to_the_budget_in_few_sound_meshes(name: str):
    road = ROADS[name]
    meshes, *_ = build_surroundings(build_road(road), level, roadway(road))
    fixed, _ = build_street_furniture(build_road(road), level)
    everything = [*meshes, *fixed]
    # Renderers draw a quarter of the leaves, or fewer, where a pixel is as large as half a leaf.
    assert triangles(everything) < 1_000_000
    assert len(everything) < 70
    assert len({mesh.name for mesh in everything}) == len(everything)
    for mesh in everything:
        assert mesh.material in MATERIALS
        assert np.isfinite(mesh.vertices).all()
        assert mesh.normals is not None
        np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-5)


@every_road
def test_nothing_grows_or_is_built_on_a_shipped_road(name: str):
    road = ROADS[name]
    keep_off = roadway(road)
    meshes, *_ = build_surroundings(build_road(road), level, keep_off)
    rooted = [m for m in meshes if m.semantic is Semantic.BUILDING or m.material == "bark"]
    low = points(rooted)
    low = low[low[:, 2] < 0.3]
    shapely.prepare(keep_off)
    assert not shapely.contains_xy(keep_off, low[:, 0], low[:, 1]).any()


@every_road
def test_every_signal_head_faces_the_traffic_of_its_street(name: str):
    road = ROADS[name]
    _, lamps = build_street_furniture(build_road(road), level)
    heads = {
        f"{junction}/{head.street}": head
        for junction, declared in road.junctions.items()
        if declared.signals
        for head in declared.signals.heads
    }
    lamps = [lamp for lamp in lamps if lamp.governs == "vehicles"]
    assert [lamp.id for lamp in lamps] == list(heads)
    plan = lay_out_road(road)
    for lamp in lamps:
        junction, approach = lamp.id.split("/")
        arm = plan.junctions[junction].find_arm(approach)
        assert np.hypot(*lamp.facing) == pytest.approx(1)
        comes_from = arm.axis_end[:2] + 30 * arm.outward_direction - np.array(lamp.position[:2])
        assert np.dot(comes_from, lamp.facing) > 0
        offset = np.subtract(lamp.position[:2], heads[lamp.id].at_m[:2])
        assert np.linalg.norm(offset) < 0.5


def test_lenses_are_red_over_yellow_over_green():
    meshes, lamps = build_street_furniture(build_road(ROADS["ui"]), level)
    lens = {mesh.material: mesh.vertices for mesh in meshes if mesh.material.startswith("signal_")}
    heights = [lens[f"signal_{colour}"][:, 2].mean() for colour in ("red", "yellow", "green")]
    assert heights == sorted(heights, reverse=True)
    assert heights[1] == pytest.approx(lamps[0].position[2], abs=0.01)
    housing = [mesh for mesh in meshes if mesh.material == "black_plastic"]
    assert {mesh.semantic for mesh in housing} == {Semantic.TRAFFIC_LIGHT}


@pytest.mark.parametrize("kind", [SurroundingKind.BUILDINGS, SurroundingKind.HOUSES])
def test_nothing_but_roads_has_the_worn_paint_of_roads(kind: SurroundingKind) -> None:
    furniture, _ = build_street_furniture(build_road(ROADS["rsnj"]), level)
    block = built(Surrounding(kind=kind, area_m=((-90, 10), (90, 60))))
    materials = {mesh.material for mesh in (*furniture, *block)}
    assert not {name for name in materials if MATERIALS[name].texture is Texture.MARKING}


def test_signs_face_the_traffic_that_yields():
    road = ROADS["rsnj"]
    meshes, _ = build_street_furniture(build_road(road), level)
    white = next(mesh for mesh in meshes if mesh.name == "furniture_traffic_sign_sign_white")
    arm = lay_out_road(road).junctions["j_south"].find_arm("south_road")
    sign = next(s for s in road.junctions["j_south"].signs if s.street == "south_road")
    near = np.linalg.norm(white.vertices[:, :2] - sign.at_m, axis=1) < 1
    assert white.normals is not None
    facing = white.normals[near][:, :2] @ arm.outward_direction
    assert (facing > 0.99).sum() > 40
    assert white.vertices[near, 2].min() > 1.5


def beams(unit: RoadsideUnit) -> np.ndarray:
    """(n, 3) directions of a shipped unit's LiDAR, to 25 degrees below the horizon."""
    upper = 15 if unit.lidar_upper_deg is None else unit.lidar_upper_deg
    yaw, up = np.meshgrid(
        np.radians(np.arange(0, 360, 0.5)), np.radians(np.linspace(-25, upper, 32))
    )
    rays = np.stack([np.cos(up) * np.cos(yaw), np.cos(up) * np.sin(yaw), np.sin(up)], axis=-1)
    return rays.reshape(-1, 3)


def picture_rays(unit: RoadsideUnit) -> np.ndarray:
    """(n, 3) directions of the pixels of a shipped unit's four cameras."""
    half = np.tan(np.radians(50))
    aside, upward = np.meshgrid(
        np.linspace(-half, half, 160), np.linspace(-half, half, 90) * 9 / 16
    )
    pixels = np.stack([np.ones_like(aside), -aside, upward], axis=-1).reshape(-1, 3)
    turns = [
        poses.pose_matrix(
            (0, 0, 0), yaw=np.radians(unit.yaw_deg + yaw), pitch=np.radians(unit.pitch_deg)
        )
        for yaw in (0, 90, 180, 270)
    ]
    return np.concatenate([pixels @ turn[:3, :3].T for turn in turns])


@every_road
def test_carriers_of_roadside_units_are_outside_their_views(name: str):
    road = ROADS[name]
    place = build_road(road)
    plateaus = terrain.find_plateaus(road)
    ground = terrain.GroundModel.from_edges(place.paved_edges, plateaus).height_at
    carriers = ("pole", "tower")
    alone = road.model_copy(
        update={"surroundings": tuple(i for i in road.surroundings if i.kind in carriers)}
    )
    around, fixed = (
        build_surroundings(build_road(alone), ground, place.paved_area)[0],
        build_street_furniture(build_road(road), ground)[0],
    )
    unit_count = 0
    for unit in road.agents.values():
        if not isinstance(unit, RoadsideUnit):
            continue
        unit_count += 1
        gaps = [
            np.subtract(head.position_m[:2], unit.position_m[:2]) for head in place.traffic_lights
        ]
        is_over_a_road = any(np.linalg.norm(gap) < 1.5 for gap in gaps)
        for rays in (beams(unit), picture_rays(unit)):
            seen = nearby(unit, rays, [*around, *fixed])
            # A signal's arm has to cross the view; what it carries need not.
            arms = nearby(unit, rays, [m for m in fixed if m.name == "furniture_pole_metal"])
            assert (seen & ~arms).sum() == 0
            assert arms.mean() < (0.02 if is_over_a_road else 1e-9)
        down = nearby(unit, np.array([[0.01, 0.01, -1.0]]), [*around, *fixed], within_m=12)
        assert down.all()
    assert unit_count == 2


def nearby(
    unit: RoadsideUnit, rays: np.ndarray, meshes: list[Mesh], within_m: float = 4
) -> np.ndarray:
    """Which rays from a unit meet a mesh close by."""
    scene = EmbreeScene()
    for mesh in meshes:
        TriangleMesh(scene, mesh.vertices, mesh.triangles)
    origins = np.tile(unit.position_m, (len(rays), 1)).astype(np.float32)
    unit_rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    hit = scene.run(origins, unit_rays.astype(np.float32), output=1)
    return (np.asarray(hit["geomID"]) >= 0) & (np.asarray(hit["tfar"]) < within_m)


def test_a_roadside_unit_without_a_carrier_gets_a_mast():
    unit = {"kind": "roadside_unit", "position_m": (0, 10, 6), "yaw_deg": 0}
    meshes, _ = build_street_furniture(build_road(street(rsu=unit)), level)
    mast = points(meshes)
    assert mast[:, 2].max() == pytest.approx(5.7)
    assert np.linalg.norm(mast[mast[:, 2] > 1, :2] - (0, 10), axis=1).max() < 0.1


def test_a_roadside_unit_on_a_pole_gets_no_mast():
    pole = Surrounding(kind=SurroundingKind.POLE, at_m=((0, 10.5),), height_m=5.7)
    unit = {"kind": "roadside_unit", "position_m": (0, 10, 6), "yaw_deg": 0}
    assert build_street_furniture(build_road(street(pole, rsu=unit)), level)[0] == []
