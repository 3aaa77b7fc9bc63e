import json
from pathlib import Path

import numpy as np
import pytest
import shapely
from advercity_dsl import Road
from advercity_dsl.road import Surrounding, SurroundingKind
from pydantic import ValidationError

from advercity.compiler.surrounding_styles import grow_surroundings
from advercity.geometry.mesh import Mesh
from advercity.roads.road_network import build_road
from advercity.scene.surroundings import build_surroundings
from advercity.semantics import Semantic
from tests.shipped import LIBRARY

REPOSITORY = Path(__file__).parents[2]
ROADS = LIBRARY.get_declarations(Road)
every_road = pytest.mark.parametrize("name", ROADS)
SHAPES = dict.fromkeys(("car", "van", "truck", "bicycle", "motorcycle"), 0.2)
SIDE = [{"kind": "lane", "width_m": 3.5}, {"kind": "sidewalk", "width_m": 2}]


def street(*items: dict[str, object], style: str | None = None) -> Road:
    """A street of 200 m along x with sidewalks from 3.5 to 5.5 m on either side."""
    return Road.model_validate(
        {
            "id": "street",
            "land_use": "urban",
            "junction": "non_junction",
            "alignment": "straight",
            "profile": "level",
            "style": style,
            "sections": {"town": {"left": SIDE, "right": SIDE}},
            "streets": {
                "road": {
                    "begins": "west",
                    "ends": "east",
                    "start_m": (-100, 0),
                    "heading_deg": 0,
                    "path": [{"line_m": 200}],
                    "section": "town",
                    "speed_limit_km_h": 50,
                }
            },
            "surroundings": items,
            "agents": {
                "cav1": {
                    "kind": "vehicle",
                    "role": "ego",
                    "spawn_m": (-90, -1.75),
                    "heading_deg": 0,
                    "destination_m": (90, -1.75),
                    "max_speed_km_h": 50,
                }
            },
            "traffic": {
                "vehicles_per_area": 1,
                "walkers": 0,
                "around_agent_m": 50,
                "around_path_m": 10,
                "classes": SHAPES,
            },
        }
    )


def beside(kind: str, side: str = "left", offset_m: object = 0.5, **more: object):
    where = {"street": "road", "side": side, "offset_m": offset_m}
    return {"kind": kind, "beside": where, **more}


def build(road: Road) -> list[Mesh]:
    network = build_road(road)
    return build_surroundings(network, lambda points: np.zeros(len(points)), network.paved_area)[0]


def points(meshes: list[Mesh], *classes: Semantic) -> np.ndarray:
    chosen = [mesh.vertices for mesh in meshes if mesh.semantic in classes]
    return np.concatenate([np.empty((0, 3)), *chosen]).astype(np.float64)


def count_pieces(corners: np.ndarray) -> int:
    """Count clusters of corners that are over a quarter of a metre apart."""
    return len(shapely.get_parts(shapely.MultiPoint(corners[:, :2]).buffer(0.45)))


def test_a_street_has_as_many_pieces_as_its_density_says():
    item = beside("furniture", "both", per_100_m={"hydrant": 4})
    assert count_pieces(points(build(street(item)), Semantic.STATIC)) == 16


def test_furniture_is_on_the_ground_behind_sidewalks_and_faces_the_street():
    item = beside("furniture", per_100_m={"bench": 3, "bin": 3, "hoarding": 1})
    corners = points(build(street(item)), Semantic.STATIC, Semantic.POLE)
    assert corners[:, 1].min() >= 5.5 + 0.2
    assert corners[:, 1].max() < 5.5 + 1.2
    assert -0.5 < corners[:, 2].min() < 0
    bench = street(beside("furniture", per_100_m={"bench": 1}))
    wood = next(mesh.vertices for mesh in build(bench) if mesh.material == "wood")
    back, seat = wood[wood[:, 2] > 0.5], wood[wood[:, 2] < 0.5]
    assert back[:, 1].min() > seat[:, 1].max()


def test_furniture_leaves_out_what_has_no_room_before_a_wall():
    wall = beside("wall", offset_m=0.6, height_m=1)
    benches = beside("furniture", per_100_m={"bench": 5})
    assert not len(points(build(street(wall, benches)), Semantic.STATIC))


def test_what_hides_pedestrians_keeps_off_the_ends_of_streets():
    low, high = (
        points(build(street(beside("furniture", per_100_m={kind: 40}))), Semantic.STATIC)
        for kind in ("hydrant", "hoarding")
    )
    assert np.abs(high[:, 0]).max() <= 100 - 15 + 1.35
    assert np.abs(low[:, 0]).max() > 95


def test_bicycles_stand_upright_at_the_hoops_of_their_stand():
    meshes = build(street(beside("furniture", per_100_m={"bicycle_stand": 3})))
    bicycles = points(meshes, Semantic.VEHICLE)
    tyres = next(mesh.vertices for mesh in meshes if mesh.name.endswith("vehicle_rubber"))
    hoops = points(meshes, Semantic.STATIC)
    assert tyres[:, 2].min() == pytest.approx(0.015, abs=0.01)
    assert 0.9 < bicycles[:, 2].max() < 1.2
    assert bicycles[:, 1].min() > 5.5 + 0.2
    assert shapely.distance(shapely.MultiPoint(hoops[:, :2]), shapely.points(bicycles)).max() < 0.9
    # Three in five hoops of six stands.
    frames = points([mesh for mesh in meshes if "vehicle_car_paint" in mesh.name], Semantic.VEHICLE)
    assert 12 <= count_bicycles(frames) <= 24


def count_bicycles(frames: np.ndarray) -> int:
    """Count frames, which are narrower than the gap between hoops."""
    return len(shapely.get_parts(shapely.MultiPoint(frames[:, :2]).buffer(0.2)))


def test_works_are_behind_a_barrier_with_reflecting_cones_before_it():
    meshes = build(street(beside("furniture", per_100_m={"works": 1})))
    cones, boards = (
        next(mesh.vertices for mesh in meshes if mesh.name.endswith(name))
        for name in ("dynamic_plastic_orange", "dynamic_sign_red")
    )
    trench = next(mesh.vertices for mesh in meshes if mesh.material == "soil")
    assert count_pieces(cones) == 8
    assert cones[:, 2].max() == pytest.approx(0.765, abs=0.01)
    assert boards[:, 2].max() == pytest.approx(1.03, abs=0.01)
    assert boards[:, 1].min() < trench[:, 1].min() < trench[:, 1].max() < boards[:, 1].max()
    assert cones[:, 1].min() > 5.5 + 0.2


def test_the_same_furniture_has_the_same_bytes():
    road = street(
        beside(
            "furniture",
            "both",
            per_100_m={"bench": 2, "planter": 2, "bicycle_stand": 1, "works": 1},
        )
    )
    for first, second in zip(build(road), build(road), strict=True):
        assert first.vertices.tobytes() == second.vertices.tobytes()


def test_a_guard_rail_is_as_high_as_declared_and_its_beam_is_on_the_side_of_the_street():
    meshes = build(street(beside("guard_rail", offset_m=1, height_m=0.8)))
    rail = points(meshes, Semantic.GUARD_RAIL)
    assert rail[:, 2].max() == pytest.approx(0.8)
    beam = rail[rail[:, 1] < 6.5]
    assert beam[:, 1].min() == pytest.approx(6.42, abs=0.01)
    assert beam[:, 2].min() > 0.4


def test_wires_hang_above_every_vehicle():
    meshes = build(street(beside("power_line", offset_m=3)))
    wires = points(meshes, Semantic.STATIC)
    assert 6.5 < wires[:, 2].min() < wires[:, 2].max() < 9
    assert np.ptp(wires[:, 0]) > 150


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_sign_faces_the_traffic_on_its_side(side: str):
    item = beside("sign", side, sign="pedestrian_crossing")
    blue = next(mesh for mesh in build(street(item)) if mesh.material == "sign_blue")
    assert blue.semantic is Semantic.TRAFFIC_SIGN
    assert blue.vertices[:, 2].min() > 1.5
    assert blue.normals is not None
    # Vehicles on the right of a street drive along it and see what looks back at them.
    area = np.cross(*(np.diff(blue.vertices[blue.triangles], axis=1).swapaxes(0, 1)))
    front = area[:, 0] * (1 if side == "left" else -1)
    assert front.max() == pytest.approx(np.abs(area).max())


@pytest.mark.parametrize(
    ("item", "message"),
    [
        (beside("sign"), "has a 'sign'"),
        (beside("furniture"), "has 'per_100_m'"),
        (beside("furniture", per_100_m={"bench": 500}), "less than or equal to 50"),
        (beside("furniture", per_100_m={"sofa": 1}), "Extra inputs"),
    ],
)
def test_a_declaration_without_sense_is_refused(item: dict[str, object], message: str):
    with pytest.raises(ValidationError, match=message):
        Surrounding.model_validate(item)


def find_fixed(road: Road) -> np.ndarray:
    """Low points (n, 3) of all fixed things but fields and plants."""
    fixed = (Semantic.STATIC, Semantic.POLE, Semantic.GUARD_RAIL, Semantic.TRAFFIC_SIGN)
    corners = points(build(road), *fixed, Semantic.DYNAMIC, Semantic.VEHICLE)
    return corners[corners[:, 2] < 2.2]


def find_lanes(road: Road) -> shapely.Geometry:
    lanes = [lane for lane in build_road(road).lanes if lane.kind == "driving"]
    outlines = [np.concatenate([lane.left, lane.right[::-1]])[:, :2] for lane in lanes]
    area = shapely.union_all([shapely.Polygon(line).buffer(0) for line in outlines])
    shapely.prepare(area)
    return area


@every_road
def test_nothing_fixed_is_in_a_lane_of_a_shipped_road(name: str):
    corners = find_fixed(ROADS[name])
    assert not shapely.contains_xy(find_lanes(ROADS[name]), corners[:, 0], corners[:, 1]).any()


@every_road
def test_furniture_of_a_shipped_road_is_clear_of_paving_and_of_staged_paths(name: str):
    road = ROADS[name]
    kinds = ("furniture", "wall", "hedge", "fence", "guard_rail", "bollards", "sign")
    kept = tuple(item for item in road.surroundings if item.kind in kinds)
    corners = find_fixed(road.model_copy(update={"surroundings": kept}))
    places = shapely.points(corners[:, :2])
    assert (shapely.distance(build_road(road).paved_area, places) > 0.1).all()
    paths = {
        tuple(map(tuple, actor["path_m"]))
        for spec in (REPOSITORY / "compiled").glob(f"{name}_*.json")
        for conflict in json.loads(spec.read_text()).get("conflicts", ())
        for actor in conflict["actors"]
        if len(actor.get("path_m", ())) > 1
    }
    staged = shapely.MultiLineString([np.array(path)[:, :2] for path in paths])
    assert not shapely.dwithin(staged, places, 0.4).any()


def test_a_road_with_a_style_has_furniture_off_its_paving():
    road = grow_surroundings(street(style="downtown"))
    assert SurroundingKind.FURNITURE in {item.kind for item in road.surroundings}
    kept = tuple(item for item in road.surroundings if item.kind is SurroundingKind.FURNITURE)
    corners = find_fixed(road.model_copy(update={"surroundings": kept}))
    assert len(corners)
    assert np.abs(corners[:, 1]).min() > 5.6


def test_paving_covers_the_ground_from_the_sidewalk_to_its_far_border():
    slabs = points(build(street(beside("paving", offset_m=[0, 4]))), Semantic.SIDEWALK)
    assert slabs[:, 1].min() == pytest.approx(5.5 - 0.15, abs=0.01)
    assert slabs[:, 1].max() == pytest.approx(5.5 + 4, abs=0.01)
    assert slabs[:, 2].max() < 0.03


def test_paving_is_not_laid_where_other_streets_are():
    """As between the carriageways of a map, whose ways lie a few metres apart."""
    where = {"street": "road", "side": "left", "offset_m": [1, 2.5], "from_m": 10, "to_m": 190}
    road = street({"kind": "paving", "beside": where})
    other = road.streets["road"].model_copy(
        update={"begins": "w", "ends": "e", "start_m": (-100.0, 11.2)}
    )
    road = road.model_copy(update={"streets": {**road.streets, "other": other}})

    slabs = points(build(road), Semantic.SIDEWALK)

    assert len(slabs) == 0
