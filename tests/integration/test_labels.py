"""Labels of rendered images: every part of a body is its actor's; no sensor sees its own."""

from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from advercity_dsl import Camera, Mount, RoadsideUnit, Spec
from advercity_dsl.lens import KannalaBrandtLens

from advercity.assets.bodies import build_body
from advercity.compiler import find_weather
from advercity.frames import STATE_DTYPE, Actor, ActorState, Frame, Lamp, Trace
from advercity.geometry import poses
from advercity.geometry.mesh import Mesh
from advercity.physics.atmosphere import compute_atmosphere
from advercity.pipeline.preparation import PreparedScenario, TrafficResult
from advercity.pipeline.sensing import SensorRig
from advercity.rendering.backend import CameraView, RenderProfile
from advercity.rendering.raycaster import MATERIAL_NAMES, Raycaster, RayHits, Rays
from advercity.semantics import Semantic
from advercity.sensors.sensor_frame import SensorFrame
from advercity.world import World
from tests.requirements import require
from tests.shipped import CATALOGUE, ShippedBodies

pytestmark = pytest.mark.render

CAST = {
    1: ("lincoln_mkz_2017", -13.0),
    2: ("carlamotors_carlacola", -6.0),
    3: ("delivery_van", 1.0),
    4: ("gazelle_omafiets", 6.0),
    5: ("yamaha_yzf", 9.0),
    6: ("pedestrian_0003", 11.5),
}
"""Blueprint of each actor, and its x in a row seen from the left."""
VEHICLE, PERSON = Semantic.VEHICLE, Semantic.PEDESTRIAN
PARTS = {
    1: {"rubber": VEHICLE, "metal": VEHICLE, "glass": VEHICLE, "car_paint_red": VEHICLE},
    2: {"rubber": VEHICLE, "glass": VEHICLE, "car_paint_white": VEHICLE, "black_plastic": VEHICLE},
    3: {"rubber": VEHICLE, "metal": VEHICLE, "glass": VEHICLE, "car_paint_red": VEHICLE},
    4: {"rubber": VEHICLE, "car_paint_red": VEHICLE, "skin": PERSON, "cloth_denim": PERSON},
    5: {"rubber": VEHICLE, "metal": VEHICLE, "car_paint_red": VEHICLE, "cloth_black": PERSON},
    6: {"cloth_blue": PERSON, "cloth_grey": PERSON, "skin": PERSON, "cloth_red": PERSON},
}
"""Visible materials of each actor, umbrella included, with their semantic classes."""
WIDTH_PX, HEIGHT_PX, FOV_RAD = 640, 140, np.radians(70.0)


@pytest.fixture(scope="module", params=["raster", "ray_traced"])
def pictures(request: pytest.FixtureRequest) -> tuple[np.ndarray, np.ndarray, RayHits]:
    """Semantic and instance image of the row, and the hits of rays through its pixels."""
    backend = require("advercity_sapien.backend").SapienBackend()
    renderer: Literal["raster", "ray_traced"] = request.param
    bodies = {name: ShippedBodies()[name] for name, _ in CAST.values()}
    world = World("row", (ground(),), bodies=bodies, lanes=(), network=Path("none"))
    frame = Frame(0, 0.0, tuple(standing(number) for number in CAST), {})
    eye = poses.pose_matrix((0.0, 20.0, 2.5), yaw=-np.pi / 2, pitch=0.06)
    air = compute_atmosphere(find_weather("clear_day").declaration, "urban")
    with backend.open(world, air, RenderProfile("labels", 1.0, renderer)) as opened:
        opened.place(frame)
        shown = opened.render_camera(CameraView(eye, WIDTH_PX, HEIGHT_PX, FOV_RAD))
    caster = Raycaster(world)
    caster.place(frame)
    return shown.semantic.ravel(), shown.instance.ravel(), caster.cast(pixel_rays(eye), 100.0)


def ground() -> Mesh:
    corners = 9999.0 * np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], np.float32)
    triangles = np.array([(0, 1, 2), (0, 2, 3)], np.int32)
    return Mesh("ground", corners, triangles, "asphalt", Semantic.ROAD)


def standing(number: int) -> ActorState:
    name, x = CAST[number]
    made = CATALOGUE.blueprints[name]
    paint = "cloth_blue" if made.actor_class == "pedestrian" else "car_paint_red"
    size = (made.length_m, made.width_m, made.height_m)
    actor = Actor(number, made.actor_class, name, paint, size)
    return ActorState(actor, poses.pose_matrix((x, 0, 0)), 0.0, 0.0, Lamp(0), umbrella=True)


def pixel_rays(eye: np.ndarray) -> Rays:
    """Rays through the centres of the pixels, row by row."""
    focal = WIDTH_PX / 2 / np.tan(FOV_RAD / 2)
    column, row = np.meshgrid(np.arange(WIDTH_PX) + 0.5, np.arange(HEIGHT_PX) + 0.5)
    left, up = (WIDTH_PX / 2 - column) / focal, (HEIGHT_PX / 2 - row) / focal
    ahead = np.stack([np.ones_like(left), left, up], axis=-1).reshape(-1, 3)
    ahead = ahead / np.linalg.norm(ahead, axis=1, keepdims=True) @ eye[:3, :3].T
    origins = np.broadcast_to(eye[:3, 3], ahead.shape)
    return Rays(origins.astype(np.float32), ahead.astype(np.float32))


def test_every_part_of_a_body_bears_its_actors_id_and_class(
    pictures: tuple[np.ndarray, np.ndarray, RayHits],
):
    semantic, instance, met = pictures
    for number, parts in PARTS.items():
        own = met.instance == number
        assert set(np.unique(met.semantic[own]).tolist()) == {int(kind) for kind in parts.values()}
        for material, kind in parts.items():
            part = own & (met.material == MATERIAL_NAMES.index(material))
            assert part.sum() >= 5, f"{CAST[number][0]}: {material} is not in the picture"
            assert (met.semantic[part] == kind).all()
            # Rays meet wheels and people as pictures show them, but for edges of pixels.
            assert (instance[part] == number).mean() > 0.85, f"{CAST[number][0]}: {material}"
            shown = semantic[part & (instance == number)]
            assert (shown == kind).mean() > 0.85, f"{CAST[number][0]}: {material}"


def test_images_and_rays_agree_on_the_position_of_actors(
    pictures: tuple[np.ndarray, np.ndarray, RayHits],
):
    semantic, instance, met = pictures
    for number in CAST:
        both = ((instance == number) & (met.instance == number)).sum()
        assert both / ((instance == number) | (met.instance == number)).sum() > 0.93
    moving = np.isin(semantic, [VEHICLE, PERSON])
    assert ((instance > 0) == moving).all()


def test_a_rider_belongs_to_the_vehicle_and_is_a_person(
    pictures: tuple[np.ndarray, np.ndarray, RayHits],
):
    semantic, instance, _ = pictures
    for number in (4, 5):
        labels = semantic[instance == number]
        assert 0.25 < (labels == PERSON).mean() < 0.75
        assert set(labels.tolist()) == {VEHICLE, PERSON}


FAR_M = 4000.0
"""Distance between the connected vehicles, so that they cannot see each other."""


@pytest.fixture(scope="module")
def readings(specs: dict[str, Spec]) -> tuple[SensorFrame, ...]:
    """Sensor frames of connected vehicles far from each other, one near a roadside unit."""
    return capture_far_apart(without_surroundings(specs["ui_clear_day_sparse"]), scale=0.1)


def capture_far_apart(spec: Spec, scale: float) -> tuple[SensorFrame, ...]:
    backend = require("advercity_sapien.backend").SapienBackend()
    air = compute_atmosphere(spec.weather, spec.road.land_use)
    profile = RenderProfile("own", scale, "raster")
    vehicles = {agent.number: agent.blueprint for agent in spec.agents if agent.blueprint}
    world = World(
        id="alone",
        static=(ground(),),
        bodies={name: build_body(name, spec.blueprints[name]) for name in vehicles.values()},
        lanes=(),
        network=Path("none"),
    )
    traffic = TrafficResult(Path("none"), parked_far_apart(spec, vehicles), "0" * 64)
    prepared = PreparedScenario(spec, traffic, backend, profile, range(3))
    with backend.open(world, air, profile) as renderer:
        return SensorRig(prepared, renderer, world).capture_frame(1)


def without_surroundings(spec: Spec) -> Spec:
    """The same scenario without parked cars, buildings and all else beside its road."""
    road = spec.road.model_copy(update={"surroundings": ()})
    return spec.model_copy(update={"road": road})


def parked_far_apart(spec: Spec, vehicles: dict[int, str]) -> Trace:
    unit = next(agent.place for agent in spec.agents if isinstance(agent.place, RoadsideUnit))
    sizes = {n: (b.length_m, b.width_m, b.height_m) for n, b in spec.blueprints.items()}
    actors = tuple(
        Actor(number, "car", name, "car_paint_blue", sizes[name])
        for number, name in vehicles.items()
    )
    rows = np.zeros((3, len(actors)), STATE_DTYPE)
    rows["tick"], rows["actor"] = np.arange(3)[:, None], np.arange(len(actors))
    yaw = np.radians(unit.yaw_deg)
    rows["x"] = unit.position_m[0] + 15.0 * np.cos(yaw)
    rows["y"] = unit.position_m[1] + 15.0 * np.sin(yaw) + FAR_M * np.arange(len(actors))
    return Trace(0.1, 0, actors, rows.ravel(), (), np.zeros((3, 0), np.uint8))


def test_no_sensor_of_a_connected_vehicle_sees_its_own_body(readings: tuple[SensorFrame, ...]):
    connected = [reading for reading in readings if reading.agent.place.kind == "vehicle"]
    assert len(connected) == 3
    for reading in connected:
        assert len(reading.camera_images) == 4
        assert not any((picture.semantic == VEHICLE).any() for picture in reading.camera_images)
        assert not (reading.point_cloud.instance > 0).any()
        assert not reading.lidar_hits
        assert len(reading.point_cloud.points) > 1000


def test_others_see_the_vehicle_that_does_not_see_itself(readings: tuple[SensorFrame, ...]):
    unit = next(r for r in readings if r.lidar_hits)
    assert unit.agent.place.kind == "roadside_unit"
    assert list(unit.lidar_hits) == [101]
    assert (unit.point_cloud.instance == 101).sum() > 20
    assert sum(int((picture.semantic == VEHICLE).sum()) for picture in unit.camera_images) > 50


@pytest.mark.slow
def test_boxes_lie_on_pictures_through_a_fisheye(specs: dict[str, Spec]):
    spec = without_surroundings(specs["ui_clear_day_sparse"])
    unit = next(agent for agent in spec.agents if isinstance(agent.place, RoadsideUnit))
    ego = next(agent for agent in spec.agents if agent.number == 101)
    camera = Camera(
        width_px=640,
        height_px=400,
        horizontal_fov_deg=110,
        lens=KannalaBrandtLens(model="kannala_brandt", k1=-0.02, k2=0.003),
        mounts=(Mount(yaw_deg=30), Mount(yaw_deg=-45)),
    )
    sensors = unit.sensors.model_copy(update={"camera": camera, "more_cameras": {}})
    agents = tuple(agent.model_copy(update={"sensors": sensors}) for agent in (ego, unit))
    _, reading = capture_far_apart(spec.model_copy(update={"agents": agents}), scale=1.0)
    for picture in reading.camera_images:
        box = picture.projected_boxes[101]
        assert picture.image.shape == (400, 640, 3)
        assert box.visible_px == (picture.semantic == VEHICLE).sum() > 500
        assert box.visible_box is not None
        np.testing.assert_allclose(box.outline_box, box.visible_box, atol=1)
