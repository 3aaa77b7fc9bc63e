from collections import Counter
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest
from advercity_dsl import Blueprint
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from advercity.assets.bodies import build_body
from advercity.assets.body_pose import BodyShape
from advercity.assets.rigged_bodies import pose_body
from advercity.geometry.mesh import Mesh, MeshLayer
from advercity.materials import MATERIALS, Texture
from advercity.semantics import Semantic
from advercity.traffic.paints import draw_paint
from advercity.world import Body
from tests.shipped import CATALOGUE, ShippedBodies

BODIES = ShippedBodies()
TWO_WHEELERS = ("bicycle", "motorcycle")
every_blueprint = pytest.mark.parametrize("name", CATALOGUE.blueprints)


def triangles(whole: Body) -> int:
    return sum(len(part.triangles) for part in whole.parts)


def corners(parts: Iterable[Mesh]) -> np.ndarray:
    return np.concatenate([part.vertices[part.triangles] for part in parts]).astype(np.float64)


def volume(parts: tuple[Mesh, ...]) -> float:
    a, b, c = corners(parts).transpose(1, 0, 2)
    return float(np.sum(a * np.cross(b, c)) / 6)


OURS = {
    "delivery_van",
    "box_truck",
    "daf_tractor",
    "lorry_tractor",
    "curtain_semitrailer",
    "refrigerated_semitrailer",
}
"""Beyond the models of the original."""


def test_the_catalogue_has_the_models_of_the_original_three_vans_and_more_trucks():
    classes = {name: made.actor_class for name, made in CATALOGUE.blueprints.items()}
    original = Counter(kind for name, kind in classes.items() if name not in OURS)
    assert original.pop("pedestrian") >= 12
    assert original == {"car": 24, "van": 2, "truck": 2, "bicycle": 3, "motorcycle": 4}
    everything = Counter(classes.values())
    assert everything["van"] >= 3
    assert everything["truck"] >= 3


def test_only_the_fire_truck_is_limited_to_urban_roads():
    bound = [name for name, made in CATALOGUE.blueprints.items() if made.land_use != "any"]
    assert bound == ["carlamotors_firetruck"]
    assert CATALOGUE.blueprints["carlamotors_firetruck"].land_use == "urban"


def test_connected_vehicles_are_lincolns_of_the_documented_size():
    assert CATALOGUE.ego == "lincoln_mkz_2017"
    ego = CATALOGUE.blueprints[CATALOGUE.ego]
    half = (2.4508416652679443, 1.0641621351242065, 0.7553732395172119)
    assert (ego.length_m / 2, ego.width_m / 2, ego.height_m / 2) == pytest.approx(half, abs=1e-4)


@every_blueprint
def test_the_poses_of_a_body_together_fill_its_box(name: str):
    made, gait = CATALOGUE.blueprints[name], BODIES[name].gait
    poses = [None, *range(len(gait.bone_transforms) if gait else 0)]
    points = np.concatenate(
        [corners(pose_body(BODIES[name], pose)).reshape(-1, 3) for pose in poses]
    )
    # A walker is put up to half the way between two poses ahead or back.
    sway = (
        gait.cycle_length_m / len(gait.bone_transforms) / 2
        if gait and gait.returns_to_rest
        else 0.0
    )
    size = np.array([made.length_m, made.width_m, made.height_m])
    assert BODIES[name].size == tuple(size)
    low = points.min(axis=0) - np.array([sway, 0, 0])
    high = points.max(axis=0) + np.array([sway, 0, 0])
    np.testing.assert_allclose(low, size * (-0.5, -0.5, 0.0), atol=1e-3)
    np.testing.assert_allclose(high, size * (0.5, 0.5, 1.0), atol=1e-3)


@every_blueprint
def test_meshes_of_a_body_are_sound(name: str):
    parts = BODIES[name].parts
    assert len({part.name for part in parts}) == len(parts)
    assert len({(part.material, part.semantic, part.wheel, part.layer) for part in parts}) == len(
        parts
    )
    for part in parts:
        assert part.material == "paint" or part.material in MATERIALS
        assert part.vertices.dtype == np.float32
        assert part.triangles.dtype == np.int32
        assert np.isfinite(part.vertices).all()
        assert part.normals is not None
        np.testing.assert_allclose(np.linalg.norm(part.normals, axis=1), 1.0, atol=1e-5)
        assert part.triangles.min() >= 0
        assert part.triangles.max() < len(part.vertices)


@every_blueprint
def test_normals_point_to_the_side_of_their_faces(name: str):
    for part in BODIES[name].parts:
        points = part.vertices[part.triangles].astype(np.float64)
        face = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
        assert part.normals is not None
        agreement = np.einsum("ij,ikj->ik", face, part.normals[part.triangles])
        assert (agreement > 0).all()


@every_blueprint
def test_a_body_shows_its_outside_from_every_direction(name: str):
    assert volume(BODIES[name].parts) > 0
    scene = EmbreeScene()
    points = corners(BODIES[name].parts)
    TriangleMesh(scene, points.astype(np.float32))
    directions = np.random.default_rng(0).normal(size=(4000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    size = np.array(BODIES[name].size)
    inside = np.random.default_rng(1).uniform(-0.5, 0.5, (4000, 3)) * size + (0, 0, size[2] / 2)
    origins = inside - 20 * directions
    face = np.asarray(scene.run(origins.astype(np.float32), directions.astype(np.float32)))
    struck = points[face[face >= 0]]
    normal = np.cross(struck[:, 1] - struck[:, 0], struck[:, 2] - struck[:, 0])
    from_behind = np.sum(normal * directions[face >= 0], axis=1) > 0
    assert (face >= 0).sum() > 400
    assert from_behind.mean() < 0.002


@every_blueprint
def test_people_are_pedestrians_and_machines_are_vehicles(name: str):
    actor_class = CATALOGUE.blueprints[name].actor_class
    found = {part.semantic for part in BODIES[name].parts}
    if actor_class == "pedestrian":
        assert found == {Semantic.PEDESTRIAN}
    elif actor_class in TWO_WHEELERS:
        assert found == {Semantic.PEDESTRIAN, Semantic.VEHICLE}
    else:
        assert found == {Semantic.VEHICLE}


@pytest.mark.parametrize(
    "name", [n for n, made in CATALOGUE.blueprints.items() if made.actor_class in TWO_WHEELERS]
)
def test_a_rider_sits_on_top_of_the_machine(name: str):
    by_class = {
        semantic: corners(tuple(p for p in BODIES[name].parts if p.semantic is semantic))
        for semantic in (Semantic.PEDESTRIAN, Semantic.VEHICLE)
    }
    height = BODIES[name].size[2]
    assert by_class[Semantic.PEDESTRIAN][..., 2].max() == pytest.approx(height, abs=1e-3)
    assert by_class[Semantic.VEHICLE][..., 2].min() == pytest.approx(0, abs=1e-3)
    assert by_class[Semantic.VEHICLE][..., 2].max() < 0.8 * height


@every_blueprint
def test_every_actor_but_the_fire_truck_shows_its_paint(name: str):
    materials = {part.material for part in BODIES[name].parts}
    if name == "carlamotors_firetruck":
        assert "car_paint_red" in materials
    else:
        assert "paint" in materials


def test_no_actor_has_the_worn_paint_of_roads() -> None:
    for name in CATALOGUE.blueprints:
        for part in BODIES[name].parts:
            if part.material != "paint":
                assert MATERIALS[part.material].texture is not Texture.MARKING, name


@pytest.mark.parametrize(
    "name", [n for n, made in CATALOGUE.blueprints.items() if made.actor_class != "pedestrian"]
)
def test_white_lamps_shine_ahead_and_red_ones_behind(name: str):
    lamps = {part.material: corners((part,)) for part in BODIES[name].parts}
    quarter = BODIES[name].size[0] / 5
    blueprint = CATALOGUE.blueprints[name]
    # A lorry has white lamps on its tractor unit, red ones on its semi-trailer.
    assert ("lamp_white" in lamps) == (blueprint.semitrailer is None)
    assert ("lamp_red" in lamps) == (blueprint.tows is None)
    assert blueprint.semitrailer or lamps["lamp_white"][..., 0].min() > quarter / 2
    assert blueprint.tows or lamps["lamp_red"][..., 0].max() < -quarter / 2


@pytest.mark.parametrize(
    "name",
    [
        n
        for n, made in CATALOGUE.blueprints.items()
        if made.actor_class not in ("pedestrian", *TWO_WHEELERS)
    ],
)
def test_licence_plates_face_ahead_and_behind(name: str):
    plates = [part for part in BODIES[name].parts if part.material == "licence_plate"]
    x = corners(tuple(plates))[..., 0]
    length = BODIES[name].size[0]
    assert x.max() > 0.48 * length or CATALOGUE.blueprints[name].semitrailer
    assert x.min() < -0.48 * length


def test_a_car_has_a_driver_unless_it_is_parked():
    driven = BodyShape("nissan_micra").build_meshes(BODIES)
    parked = BodyShape("nissan_micra", is_parked=True).build_meshes(BODIES)
    driver = [mesh for mesh in driven if mesh not in parked]
    assert {"skin", "skin_brown", "skin_dark"} & {mesh.material for mesh in driver}
    points = corners(driver).reshape(-1, 3)
    length, width, height = BODIES["nissan_micra"].size
    # The driver sits on the left, behind the wheel, with the head below the roof.
    assert points[:, 1].min() > 0.0 and points[:, 1].max() < width / 2
    assert -0.25 * length < points[:, 0].mean() < 0.25 * length
    assert 0.75 * height < points[:, 2].max() < 0.97 * height


@pytest.mark.parametrize("name", ["nissan_micra", "volkswagen_t2", "carlamotors_carlacola"])
def test_a_beam_through_the_windscreen_meets_the_driver(name: str):
    points = corners(mesh for mesh in BODIES[name].parts if mesh.material != "glass")
    layers = [m.layer for m in BODIES[name].parts if m.material != "glass" for _ in m.triangles]
    driver = points[np.array(layers) == MeshLayer.OCCUPANT].reshape(-1, 3)
    head = driver[driver[:, 2] > driver[:, 2].max() - 0.15].mean(axis=0)
    scene = EmbreeScene()
    TriangleMesh(scene, points.astype(np.float32))
    start = head + np.array([20.0, 0.0, 0.6])
    face = scene.run(start[None].astype(np.float32), (head - start)[None].astype(np.float32))
    assert layers[int(face[0])] is MeshLayer.OCCUPANT


@every_blueprint
def test_bodies_keep_to_their_budget_of_triangles(name: str):
    near = {"pedestrian": 3500, "bicycle": 5000, "motorcycle": 6400}
    actor_class, looks = CATALOGUE.blueprints[name].actor_class, CATALOGUE.blueprints[name].looks
    if looks and looks.attachment != "none":
        near["pedestrian"] = 8500 if looks.attachment == "pushed_wheelchair" else 6000
    far = {**near, "truck": 6000}
    assert triangles(BODIES[name]) <= near.get(actor_class, 9000)
    shape = [part for part in BODIES[name].parts if part.layer is MeshLayer.SHAPE]
    assert triangles(replace(BODIES[name], parts=tuple(shape))) <= far.get(actor_class, 4700)


@pytest.mark.parametrize(
    "name", [n for n, made in CATALOGUE.blueprints.items() if made.semitrailer]
)
def test_semitrailers_of_a_blueprint_are_of_several_hauliers_in_boxes_of_one_size(name: str):
    first, *others = (BODIES[name], *BODIES[name].others)
    assert len(others) == 2
    written = {
        tuple(triangles(replace(body, parts=(part,))) for part in body.parts)
        for body in (first, *others)
    }
    assert len(written) == 3
    for body in others:
        points = corners(body.parts).reshape(-1, 3)
        np.testing.assert_allclose(np.ptp(points, axis=0), first.size, atol=1e-3)
        assert points[:, 2].min() == pytest.approx(0.0, abs=1e-3)
        assert triangles(body) <= 6000


def test_building_a_body_is_deterministic():
    for name in ("ford_mustang", "vespa_zx125", "pedestrian_0013"):
        again = build_body(name, CATALOGUE.blueprints[name])
        for first, second in zip(BODIES[name].parts, again.parts, strict=True):
            assert first.vertices.tobytes() == second.vertices.tobytes()
            assert first.triangles.tobytes() == second.triangles.tobytes()


def test_a_user_blueprint_gets_a_body_of_its_size():
    made = Blueprint(actor_class="car", length_m=3.1, width_m=1.6, height_m=1.6)
    points = corners(build_body("city_car", made).parts).reshape(-1, 3)
    np.testing.assert_allclose(np.ptp(points, axis=0), (3.1, 1.6, 1.6), atol=1e-3)


def test_saloons_are_lower_at_the_back_than_hatchbacks():
    def height_near_the_tail(name: str) -> float:
        points = corners(BODIES[name].parts).reshape(-1, 3)
        length, _, height = BODIES[name].size
        return float(points[points[:, 0] < -0.33 * length, 2].max() / height)

    assert height_near_the_tail("lincoln_mkz_2017") < 0.75
    assert height_near_the_tail("nissan_micra") > 0.9


def test_paint_depends_on_the_key_alone():
    assert draw_paint("car", 7, "car_12") == draw_paint("car", 7, "car_12")
    assert len({draw_paint("car", 7, f"car_{k}") for k in range(60)}) >= 5


def test_coats_are_of_many_colours_and_most_are_dark_or_muted() -> None:
    drawn = Counter(draw_paint("pedestrian", "coats", k) for k in range(2000))
    bright = sum(drawn[f"cloth_{name}"] for name in ("red", "green", "yellow", "white"))
    assert len(drawn) >= 10
    assert all(name.startswith("cloth_") for name in drawn)
    assert max(drawn.values()) < 0.25 * 2000
    assert 0.1 * 2000 < bright < 0.2 * 2000


def test_paints_have_the_frequencies_of_traffic():
    drawn = Counter(draw_paint("car", "shares", k) for k in range(2000))
    white, red = (
        sum(drawn[f"car_paint_{name}"] for name in names) / 2000
        for names in (("white", "pearl"), ("red", "wine"))
    )
    assert white == pytest.approx(0.34, abs=0.05)
    assert red == pytest.approx(0.05, abs=0.03)
    assert set(drawn) <= set(MATERIALS)


def test_a_blueprint_may_declare_its_paints():
    drawn = Counter(
        draw_paint("car", "own", k, paints={"black": 0.5, "white": 0.25}) for k in range(600)
    )
    assert set(drawn) == {"car_paint_black", "car_paint_white"}
    assert drawn["car_paint_black"] / 600 == pytest.approx(2 / 3, abs=0.07)


def test_a_blueprint_says_only_what_does_not_go_without_saying():
    made = Blueprint(actor_class="car", length_m=3.1, width_m=1.6, height_m=1.6)
    told = {"actor_class": "car", "length_m": 3.1, "width_m": 1.6, "height_m": 1.6}
    assert made.model_dump(mode="json") == told
    assert Blueprint.model_validate(told) == made
