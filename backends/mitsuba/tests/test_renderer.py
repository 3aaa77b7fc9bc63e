"""Pictures of Mitsuba agree with SAPIEN's and with the core's rays."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from advercity_dsl import Weather
from advercity_mitsuba import MitsubaBackend
from numpy.typing import NDArray

from advercity.frames import Actor, ActorState, Frame, Lamp
from advercity.geometry.mesh import Mesh
from advercity.geometry.poses import pose_matrix
from advercity.materials import ACTOR_PAINT
from advercity.physics.atmosphere import Atmosphere, compute_atmosphere
from advercity.physics.extinction import AirExtinction
from advercity.physics.weather_parts.part import Extinction, Suspension
from advercity.rendering.backend import (
    Backend,
    CameraCapture,
    CameraView,
    RenderProfile,
    load_backend,
)
from advercity.rendering.raycaster import Raycaster, Rays
from advercity.scene.rooms import CURTAINS, NO_COVER, code_blinds, code_panes
from advercity.semantics import Semantic
from advercity.testing import BackendContract
from advercity.world import Body, StreetLamp, World
from tests.lamp_glow import integrate_street_glow
from tests.render_builders import LUMINANCE, build_box, build_clear_air, set_matt_materials

pytestmark = pytest.mark.render

SIZE = 64, 36
EYE = pose_matrix((0.0, 0.0, 1.5))
CAR_SIZE = (4.0, 1.8, 1.5)
STATIC = (
    build_box((0, 0, -0.5), (400, 400, 1), "gravel", Semantic.ROAD),
    build_box((16, 3, 2), (2, 6, 4), "plaster"),
    build_box((7, -3, 0.75), (1.5, 1.5, 1.5), "plaster", Semantic.STATIC),
)


@pytest.fixture(autouse=True)
def matt(monkeypatch: pytest.MonkeyPatch) -> None:
    set_matt_materials(monkeypatch, gravel=0.3, plaster=0.6, grey=0.5)


def build_world(static: tuple[Mesh, ...] = STATIC, lamps: tuple[StreetLamp, ...] = ()) -> World:
    car = build_box((0, 0, 0.75), CAR_SIZE, "grey", Semantic.VEHICLE)
    body = Body((car,), CAR_SIZE)
    return World("test", static, {"car": body}, lanes=(), network=Path("none"), street_lamps=lamps)


def build_frame(*positions: tuple[float, float, float]) -> Frame:
    actors = [Actor(n, "car", "car", "plaster", CAR_SIZE) for n in range(1, 1 + len(positions))]
    states = [
        ActorState(actor, pose_matrix(at, yaw=0.4), 0.0, 0.0, Lamp(0))
        for actor, at in zip(actors, positions, strict=True)
    ]
    return Frame(0, 0.0, tuple(states), {})


def render(
    backend: Backend,
    air: Atmosphere,
    *,
    world: World | None = None,
    frame: Frame | None = None,
    hide: frozenset[int] = frozenset(),
    samples: int = 64,
    denoise: bool = False,
) -> CameraCapture:
    profile = RenderProfile(
        "test", 1.0, "ray_traced", samples=samples, path_depth=5, denoise=denoise
    )
    with backend.open(world or build_world(), air, profile) as renderer:
        renderer.place(frame or build_frame((11.0, 0.5, 0.0)))
        return renderer.render_camera(CameraView(EYE, *SIZE, math.radians(90.0), hide))


def brightness(capture: CameraCapture) -> NDArray[np.float32]:
    return capture.radiance @ LUMINANCE


DAY = build_clear_air(2000.0, sun_lx=20_000.0)


def test_what_is_seen_is_what_sapien_sees(backend: MitsubaBackend) -> None:
    found, expected = render(backend, DAY), render(load_backend("sapien"), DAY)
    for name in ("semantic", "instance"):
        assert (getattr(found, name) == getattr(expected, name)).mean() > 0.999, name
    np.testing.assert_allclose(found.depth, expected.depth, rtol=1e-4)
    np.testing.assert_allclose(found.normal, expected.normal, atol=1e-4)


def test_daylight_is_as_bright_as_sapiens(backend: MitsubaBackend) -> None:
    found, expected = render(backend, DAY), render(load_backend("sapien"), DAY)
    for semantic in np.unique(expected.semantic):
        where = expected.semantic == semantic
        mean = brightness(expected)[where].mean()
        assert brightness(found)[where].mean() == pytest.approx(mean, rel=0.04), semantic


def test_a_field_of_crops_has_the_patches_of_sapiens(backend: MitsubaBackend) -> None:
    world = build_world((build_box((0, 0, -0.5), (400, 400, 1), "crops", Semantic.TERRAIN),))
    found, expected = (
        brightness(render(one, build_clear_air(2000.0), world=world, frame=build_frame()))[20:]
        for one in (backend, load_backend("sapien"))
    )
    np.testing.assert_allclose(found[6:], expected[6:], rtol=0.06)
    assert np.corrcoef(found.ravel(), expected.ravel())[0, 1] > 0.98


def test_a_crown_has_the_leaves_of_sapiens(backend: MitsubaBackend) -> None:
    world = build_world((build_box((6, 0, 1.5), (1, 30, 9), "inner_leaves", Semantic.VEGETATION),))
    found, expected = (
        brightness(render(one, build_clear_air(2000.0), world=world, frame=build_frame()))
        for one in (backend, load_backend("sapien"))
    )
    assert found.mean() == pytest.approx(expected.mean(), rel=0.04)
    assert np.corrcoef(found.ravel(), expected.ravel())[0, 1] > 0.98


@pytest.mark.parametrize("extinction", [0.0, 0.003, 0.01], ids=["clear", "mist", "fog"])
def test_lamps_are_as_bright_as_sapiens(backend: MitsubaBackend, extinction: float) -> None:
    fog = AirExtinction((Suspension("fog", Extinction(at_550nm=extinction)),))
    night = build_clear_air(night=True, extinction=fog)
    world = build_world(lamps=(StreetLamp((4.0, 3.0, 6.0)), StreetLamp((10.0, -5.0, 6.0))))
    empty = build_frame()
    found = render(backend, night, world=world, frame=empty)
    expected = render(load_backend("sapien"), night, world=world, frame=empty)
    assert brightness(found).mean() == pytest.approx(brightness(expected).mean(), rel=0.03)


@pytest.mark.parametrize(("led", "is_left_hand"), [(False, False), (True, False), (False, True)])
def test_headlamps_have_the_pattern_that_sensors_know(
    backend: MitsubaBackend, led: bool, is_left_hand: bool
) -> None:
    (state,) = build_frame((-3.0, 0.0, 0.0)).states
    lit = replace(state, lamps=Lamp.LOW_BEAM, has_led_headlamps=led)
    frame, night = Frame(0, 0.0, (lit,), {}), build_clear_air(night=True)
    found, expected = (
        render(one, night, world=replace(build_world(), is_left_hand=is_left_hand), frame=frame)
        for one in (backend, load_backend("sapien"))
    )
    ahead = brightness(expected) > 0.05 * brightness(expected).max()
    assert np.count_nonzero(ahead) > 50
    ratio = brightness(found)[ahead].mean() / brightness(expected)[ahead].mean()
    assert ratio == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("extinction", [2e-4, 0.03], ids=["clear", "fog"])
def test_a_street_lamp_glows_as_an_integral_along_rays(
    backend: MitsubaBackend, extinction: float
) -> None:
    lamp = StreetLamp((12.0, 4.0, 8.0))
    fog = AirExtinction((Suspension("fog", Extinction(at_550nm=extinction)),))
    night = build_clear_air(night=True, extinction=fog)
    world = build_world(STATIC[:1], lamps=(lamp,))
    seen = render(backend, night, world=world, frame=Frame(0, 0.0, (), {}), samples=256)
    width, height = SIZE
    row, column = (index.ravel() for index in np.mgrid[0:16:3, 1:width:6])
    rays = np.stack(
        [np.full(row.shape, width / 2), width / 2 - column - 0.5, height / 2 - row - 0.5]
    )
    rays = rays.T / np.linalg.norm(rays, axis=0)[:, None]
    intensity = lamp.flux_lm / math.pi
    expected = integrate_street_glow(lamp.position, intensity, extinction, EYE[:3, 3], rays)
    # The lens itself, and the steep glow beside it, are of whole pixels.
    away = np.subtract(lamp.position, EYE[:3, 3])
    beside = rays @ away / np.linalg.norm(away) < math.cos(math.radians(4.0))
    ratio = brightness(seen)[row, column][beside] / expected[beside]
    assert ratio == pytest.approx(1.0, abs=0.06)


def test_beams_in_fog_glow_as_sapiens(backend: MitsubaBackend) -> None:
    fog = AirExtinction((Suspension("fog", Extinction(at_550nm=0.03)),))
    (state,) = build_frame((-3.0, 0.0, 0.0)).states
    own = replace(state, world_from_body=pose_matrix((-3.0, 0.0, 0.0)), lamps=Lamp.LOW_BEAM)
    frame, night = Frame(0, 0.0, (own,), {}), build_clear_air(night=True, extinction=fog)
    found, expected = (
        render(one, night, world=build_world(STATIC[:1]), frame=frame)
        for one in (backend, load_backend("sapien"))
    )
    sky = expected.semantic == Semantic.SKY
    mean = brightness(expected)[sky].mean()
    assert brightness(found)[sky].mean() == pytest.approx(mean, rel=0.1)


def test_a_lamp_among_bright_ones_that_face_away_makes_no_noise(backend: MitsubaBackend) -> None:
    # The far lamp makes the cells large in which lamps are drawn.
    world = build_world(lamps=(StreetLamp((6.0, 0.0, 6.0)), StreetLamp((800.0, 0.0, 6.0))))
    away = [pose_matrix((-3.0 * n, 0.0, 0.0), yaw=math.pi) for n in range(1, 6)]
    actors = build_frame(*[(0.0, 0.0, 0.0)] * len(away)).states
    states = tuple(
        replace(state, world_from_body=pose, lamps=Lamp.LOW_BEAM)
        for state, pose in zip(actors, away, strict=True)
    )
    frame, night = Frame(0, 0.0, states, {}), build_clear_air(night=True)
    few, many = (
        render(backend, night, world=world, frame=frame, samples=samples) for samples in (4, 256)
    )
    lit = many.semantic == Semantic.ROAD
    error = brightness(few)[lit] / brightness(many)[lit] - 1.0
    assert np.median(np.abs(error)) < 0.1


def test_the_sky_in_a_pane_makes_no_noise(
    backend: MitsubaBackend, monkeypatch: pytest.MonkeyPatch
) -> None:
    set_matt_materials(monkeypatch, black=0.0)
    corners = np.array([[x, y, x + 2.7] for x in (-2.5, -1.5) for y in (-0.9, 0.9)], np.float32)
    triangles = np.array([[0, 1, 3], [0, 3, 2]], np.int32)
    pane = Mesh("pane", corners, triangles, "glass", Semantic.VEHICLE)
    inside = build_box((0.5, 0, 0.75), (3, 1.8, 1.5), "black", Semantic.VEHICLE)
    world = replace(build_world(), bodies={"car": Body((pane, inside), CAR_SIZE)})
    (state,) = build_frame((8.0, 0.0, 0.0)).states
    ahead = Frame(0, 0.0, (replace(state, world_from_body=pose_matrix((8.0, 0.0, 0.0))),), {})
    few, many = (
        brightness(render(backend, DAY, world=world, frame=ahead, samples=samples))
        for samples in (16, 256)
    )
    # The pane without its edges.
    mirrored = few[20:25, 28:36], many[20:25, 28:36]
    assert 50.0 < mirrored[1].min() < mirrored[1].max() < 400.0
    assert np.std(mirrored[0] / mirrored[1]) < 0.1


def test_the_denoiser_leaves_lenses_as_they_are(backend: MitsubaBackend) -> None:
    lens = build_box((-2.01, 0.5, 0.6), (0.02, 0.2, 0.2), "lamp_white", Semantic.VEHICLE)
    car = build_world().bodies["car"]
    world = replace(build_world(), bodies={"car": replace(car, parts=(*car.parts, lens))})
    (state,) = build_frame((14.0, 0.5, 0.0)).states
    lit = replace(state, world_from_body=pose_matrix((14.0, 0.5, 0.0)), lamps=Lamp.LOW_BEAM)
    fog = AirExtinction((Suspension("fog", Extinction(at_550nm=0.02)),))
    night, frame = build_clear_air(night=True, extinction=fog), Frame(0, 0.0, (lit,), {})
    traced, denoised = (
        brightness(render(backend, night, world=world, frame=frame, samples=4, denoise=denoise))
        for denoise in (False, True)
    )
    shines = traced > 0.1 * traced.max()
    assert 0 < np.count_nonzero(shines) < 20
    np.testing.assert_allclose(denoised[shines], traced[shines], rtol=0.01)
    assert denoised[~shines].max() < 0.1 * traced.max()


@pytest.mark.usefixtures("backend")
@pytest.mark.parametrize("angle_deg", [0, 30, 60, 80])
def test_a_pane_mirrors_by_both_faces(angle_deg: float) -> None:
    """Two faces of index 1.52 whose light is reflected between them: 2 r / (1 + r) by Fresnel."""
    from advercity_mitsuba.reflection import compute_pane_reflectance
    from advercity_mitsuba.variant import mi

    cosine = math.cos(math.radians(angle_deg))
    inside = math.sqrt(1 - (math.sin(math.radians(angle_deg)) / 1.52) ** 2)
    across = ((cosine - 1.52 * inside) / (cosine + 1.52 * inside)) ** 2
    along = ((1.52 * cosine - inside) / (1.52 * cosine + inside)) ** 2
    face = (across + along) / 2
    found = compute_pane_reflectance(mi.Float(cosine))
    assert np.array(found)[0] == pytest.approx(2 * face / (1 + face), rel=1e-4)


def test_static_panes_are_seen_through_as_sapiens_are(backend: MitsubaBackend) -> None:
    shelter = build_box((8, 1, 1), (0.02, 3, 2), "glass", Semantic.STATIC)
    window = build_box((8, -3, 1), (0.02, 3, 2), "glass", Semantic.BUILDING)
    world, empty = build_world((*STATIC, shelter, window)), build_frame()
    found, expected = (
        render(each, DAY, world=world, frame=empty) for each in (backend, load_backend("sapien"))
    )
    for at in ((17, 30), (17, 44)):
        assert found.semantic[at] == expected.semantic[at]
        seen, right = brightness(found)[at], brightness(expected)[at]
        assert seen == pytest.approx(right, rel=0.1), at


@pytest.mark.parametrize(("night", "luminance_cd_m2"), [(True, 8.0), (False, 0.0)])
def test_windows_of_rooms_shine_by_night(
    backend: MitsubaBackend, night: bool, luminance_cd_m2: float
) -> None:
    world = build_world((build_box((10, 0, 0), (1, 40, 40), "room_cool"),))
    air, empty = build_clear_air(night=night), build_frame()
    seen = brightness(render(backend, air, world=world, frame=empty))
    assert seen[SIZE[1] // 2, SIZE[0] // 2] == pytest.approx(luminance_cd_m2, rel=0.01, abs=0.1)


@pytest.mark.parametrize("across", [1.0, -1.0], ids=["from the front", "from behind"])
def test_blades_of_crops_are_lit_as_their_field(backend: MitsubaBackend, across: float) -> None:
    y = [across, -across, 0.0]
    blade = Mesh(
        "blade",
        np.column_stack([[5.0] * 3, y, [0.5, 0.5, 3.0]]).astype(np.float32),
        np.array([[0, 1, 2]], np.int32),
        "crops",
        Semantic.VEGETATION,
        normals=np.tile(np.array([0.0, 0.0, 1.0], np.float32), (3, 1)),
    )
    field = build_box((0, 0, -0.5), (400, 400, 1), "crops", Semantic.ROAD)
    world, empty = build_world((field, blade)), build_frame()
    found = render(backend, DAY, world=world, frame=empty, samples=16)
    mean = brightness(found)[found.semantic == Semantic.VEGETATION].mean()
    assert mean == pytest.approx(brightness(found)[-4:].mean(), rel=0.25)


def test_a_painted_body_is_of_its_paint_alone(backend: MitsubaBackend) -> None:
    plain, painted = (
        replace(
            build_world(),
            bodies={
                "car": Body(
                    (build_box((0, 0, 0.75), CAR_SIZE, material, Semantic.VEHICLE),), CAR_SIZE
                )
            },
        )
        for material in ("plaster", ACTOR_PAINT)
    )
    soaked = replace(DAY, wetness=1.0, puddle_coverage=0.5)
    first, second = (render(backend, soaked, world=world) for world in (plain, painted))
    np.testing.assert_array_equal(first.radiance, second.radiance)


def test_the_road_under_a_deck_is_dry(backend: MitsubaBackend) -> None:
    """The deck is from 6 to 16 m ahead; the camera sees dry road there and wet road before it."""
    deck = build_box((11, 0, 6.0), (10, 200, 1.0), "concrete", Semantic.BRIDGE)
    world = build_world((replace(STATIC[0], material="asphalt"), deck))
    empty = build_frame()
    dry, wet = (
        brightness(render(backend, air, world=world, frame=empty, samples=32))
        for air in (DAY, replace(DAY, wetness=1.0, puddle_coverage=0.5))
    )
    road = render(backend, DAY, world=world, frame=empty, samples=1)
    is_road = road.semantic == Semantic.ROAD
    depth = np.where(np.isfinite(road.depth), road.depth, 0)
    change = np.abs(wet - dry) / dry
    assert change[is_road & (depth > 8) & (depth < 14)].mean() < 0.1
    assert change[is_road & (depth < 5)].mean() > 0.2


WEATHERS = {
    "fog": {"fog": {"mor_m": 75}, "air": {"mor_m": None}},
    "soaked": {"surface": {"wetness": 1.0, "puddle_coverage": 0.3}, "rain": {"rate_mm_h": 30}},
    "snow": {"snow": {"rate_mm_h": 0, "depth_mm": 40, "road_coverage": 0.7}, "temperature_c": -3},
}


@pytest.mark.parametrize("name", WEATHERS)
def test_weather_is_as_bright_as_sapiens(backend: MitsubaBackend, name: str) -> None:
    weather = Weather.model_validate({"id": "w", "time": "day", **WEATHERS[name]})
    air = compute_atmosphere(weather, "rural")
    static = replace(STATIC[0], material="asphalt"), *STATIC[1:]
    world = build_world(static)
    found, expected = (render(each, air, world=world) for each in (backend, load_backend("sapien")))
    for semantic in (Semantic.ROAD, Semantic.BUILDING, Semantic.SKY):
        where = expected.semantic == semantic
        mean = brightness(expected)[where].mean()
        assert brightness(found)[where].mean() == pytest.approx(mean, rel=0.05), semantic


def test_rays_of_the_core_hit_what_pixels_show(backend: MitsubaBackend) -> None:
    world, frame = build_world(), build_frame((11.0, 0.5, 0.0), (6.0, 3.0, 0.0))
    capture = render(backend, DAY, world=world, frame=frame, samples=1)
    width, height = SIZE
    row, column = np.indices((height, width)) + 0.5
    rays = np.stack(
        [np.ones((height, width)), 1 - 2 * column / width, (height - 2 * row) / width], axis=-1
    ).reshape(-1, 3)
    length = np.linalg.norm(rays, axis=1)
    caster = Raycaster(world)
    caster.place(frame)
    eye = np.broadcast_to(EYE[:3, 3], rays.shape).astype(np.float32)
    hits = caster.cast(Rays(eye, (rays / length[:, None]).astype(np.float32)), 1000.0)
    assert (capture.instance.ravel() == hits.instance).mean() > 0.999
    seen = np.isfinite(hits.range_m)
    assert (capture.semantic.ravel()[seen] == hits.semantic[seen]).mean() > 0.999
    near = np.isclose(capture.depth.ravel(), hits.range_m / length, rtol=1e-3)
    assert near[seen].mean() > 0.999


def test_a_hidden_actor_casts_its_shadow_still(backend: MitsubaBackend) -> None:
    frame = build_frame((5.0, 0.0, 0.0))
    hidden = render(backend, DAY, frame=frame, hide=frozenset({1}))
    empty = render(backend, DAY, frame=build_frame())
    assert not hidden.instance.any()
    np.testing.assert_array_equal(hidden.semantic, empty.semantic)
    assert brightness(hidden).min() < 0.5 * brightness(empty).min()


def test_the_same_frame_gives_the_same_bytes(backend: MitsubaBackend) -> None:
    first, second = render(backend, DAY, samples=4), render(backend, DAY, samples=4)
    np.testing.assert_array_equal(first.radiance, second.radiance)


def test_frames_come_in_any_order(backend: MitsubaBackend) -> None:
    near, far = build_frame((8.0, 0.0, 0.0)), build_frame((12.0, -1.0, 0.0), (9.0, 2.0, 0.0))
    profile = RenderProfile("test", 1.0, "ray_traced", samples=2, path_depth=2)
    view = CameraView(EYE, *SIZE, math.radians(90.0))
    with backend.open(build_world(), DAY, profile) as renderer:
        renderer.place(near)
        (first,) = renderer.render_cameras([view])
        renderer.place(far)
        assert set(np.unique(renderer.render_camera(view).instance)) == {0, 1, 2}
        renderer.place(near)
        np.testing.assert_array_equal(renderer.render_camera(view).radiance, first.radiance)


@pytest.mark.usefixtures("backend")
class TestContract(BackendContract):
    """Promises of every backend."""

    def make_backend(self) -> Backend:
        return MitsubaBackend()


Pack = Literal["raster", "ray_traced"]
PANE_M = 3.0
"""Width and height of a pane, 6 m ahead."""


def show_room(
    backend: str, pack: Pack, material: str, cover: int, y: float = 0.0, *, night: bool = True
) -> NDArray[np.float64]:
    """Luminance (h, w) of a pane before a room, seen straight on from y aside."""
    half = PANE_M / 2
    sides = np.array([(half, -half), (-half, -half), (-half, half), (half, half)])
    corners = np.column_stack([np.full(4, 6.0), sides + np.array([0.0, 1.5])]).astype(np.float32)
    pane = Mesh(
        "pane",
        corners,
        np.array([(0, 1, 2), (0, 2, 3)], np.int32),
        material,
        Semantic.BUILDING,
        uv=code_panes(np.array([9]), np.array([cover])).astype(np.float32),
    )
    world = World("room", (pane,), {}, lanes=(), network=Path("none"))
    profile = RenderProfile("test", 1.0, pack, samples=16, path_depth=1)
    air = build_clear_air(0.0 if night else 1000.0, night=night)
    with load_backend(backend).open(world, air, profile) as renderer:
        renderer.place(Frame(index=0, time_s=0.0, states=(), signals={}))
        # The pane fills the image from straight ahead, but for its edges.
        view = CameraView(pose_matrix((0.0, y, 1.5)), 96, 96, math.radians(26.0))
        return renderer.render_camera(view).radiance.astype(np.float64) @ LUMINANCE


@pytest.mark.usefixtures("backend")
@pytest.mark.parametrize("pack", ["raster", "ray_traced"])
@pytest.mark.parametrize(
    ("material", "cover", "night"),
    [
        ("room_warm", NO_COVER, True),
        ("room_cool", CURTAINS, True),
        ("room_shop", NO_COVER, True),
        ("room_dark", int(code_blinds(np.array(5))), False),
        ("shop_dark", NO_COVER, False),
    ],
)
def test_a_room_behind_a_pane_is_that_of_sapien(
    pack: Pack, material: str, cover: int, night: bool
) -> None:
    ours = show_room("mitsuba", "ray_traced", material, cover, night=night)
    theirs = show_room("sapien", pack, material, cover, night=night)
    assert ours.mean() == pytest.approx(theirs.mean(), rel=0.05)
    # Samples within a pixel average edges, which the raster pack's single one does not.
    assert np.median(np.abs(ours - theirs) / theirs.mean()) < 0.03


@pytest.mark.usefixtures("backend")
def test_what_is_in_a_room_moves_less_than_its_pane() -> None:
    """0.5 m aside, a blind just behind a pane moves as it does; the far wall does not."""
    moved_px = round(0.5 / 6.0 * 48 / math.tan(math.radians(13.0)))

    def change(cover: int) -> float:
        still, aside = (show_room("mitsuba", "ray_traced", "room_shop", cover, y) for y in (0, 0.5))
        back = np.roll(aside, -moved_px, axis=1)[:, 24 : 72 - moved_px]
        return float(np.abs(back - still[:, 24 : 72 - moved_px]).mean() / still.mean())

    assert change(NO_COVER) > 0.1
    assert change(int(code_blinds(np.array(8)))) < 0.02
