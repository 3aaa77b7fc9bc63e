"""Effects of water, snow and mirrored lamps on the ground, for both shader packs."""

from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from advercity_sapien import SapienBackend
from numpy.typing import ArrayLike, NDArray

from advercity.frames import Actor, ActorState, Frame, Lamp
from advercity.geometry.mesh import Mesh
from advercity.geometry.poses import pose_matrix, transform_points
from advercity.materials import MATERIALS
from advercity.physics import water
from advercity.physics.atmosphere import Atmosphere
from advercity.rendering.backend import CameraCapture, CameraView, RenderProfile
from advercity.roads.lane_segments import LaneSegment
from advercity.semantics import Semantic
from advercity.world import Body, StreetLamp, World
from tests.render_builders import (
    LUMINANCE,
    PACKS,
    build_box,
    build_clear_air,
    set_matt_materials,
)

pytestmark = pytest.mark.render

Kind = Literal["raster", "ray_traced"]
# Of the module, to sort tests by it: shaders of the raster pack stay compiled.
both = pytest.mark.parametrize("kind", PACKS, scope="module")

BLACK, GREY, WHITE = "wood", "concrete", "plaster"
UNLIT = Lamp(0)
AHEAD = pose_matrix((0.0, 0.0, 1.5))
ROAD = (0.0, 0.0, -0.5), (600.0, 600.0, 1.0), "asphalt"


@pytest.fixture(autouse=True)
def ideal_surfaces(monkeypatch: pytest.MonkeyPatch) -> None:
    # Under names known to the ray caster.
    set_matt_materials(monkeypatch, **{BLACK: 0.0, GREY: 0.5, WHITE: 1.0})


def box(middle: ArrayLike, size: ArrayLike, material: str) -> Mesh:
    semantic = Semantic.ROAD if material == "asphalt" else Semantic.BUILDING
    return build_box(middle, size, material, semantic)


def world_of(*static: Mesh, **more: Any) -> World:
    part = replace(box((0, 0, 1), (2, 2, 2), GREY), semantic=Semantic.VEHICLE)
    body = Body((part,), (2.0, 2.0, 2.0))
    return replace(World("test", static, {"box": body}, lanes=(), network=Path("none")), **more)


def state(at: ArrayLike, *, lamps: Lamp = UNLIT) -> ActorState:
    actor = Actor(1, "car", "box", "car_paint_white", (2.0, 2.0, 2.0))
    return ActorState(actor, pose_matrix(at), 0.0, 0.0, lamps)


def shot(
    kind: Kind,
    world: World,
    air: Atmosphere,
    *states: ActorState,
    at: NDArray[np.float64] = AHEAD,
    size: tuple[int, int] = (96, 72),
    samples: int = 16,
    hide: frozenset[int] = frozenset(),
) -> CameraCapture:
    profile = RenderProfile("test", 1.0, kind, samples=samples, path_depth=1)
    with SapienBackend().open(world, air, profile) as renderer:
        renderer.place(Frame(0, 0.0, states, {}))
        return renderer.render_camera(CameraView(at, *size, np.radians(90.0), hide))


def luminance(capture: CameraCapture) -> NDArray[np.float64]:
    return (capture.radiance @ LUMINANCE).astype(np.float64)


def downwards(height_m: float, x: float = 0.0, y: float = 0.0) -> NDArray[np.float64]:
    return pose_matrix((x, y, height_m), pitch=np.pi / 2)


def fresnel(cosine: float, index: float = 1.333) -> float:
    """Fresnel reflectance of unpolarised light."""
    inside = np.sqrt(1.0 - (1.0 - cosine**2) / index**2)
    across = (cosine - index * inside) / (cosine + index * inside)
    along = (index * cosine - inside) / (index * cosine + inside)
    return float(across**2 + along**2) / 2.0


@both
def test_puddles_lie_where_the_lidar_finds_them(kind: Kind) -> None:
    world = world_of(box(*ROAD))
    above = downwards(12.0)
    dry, wet = (
        shot(
            kind,
            world,
            build_clear_air(1000.0, wetness=0.01, puddle_coverage=share),
            at=above,
            samples=8,
        )
        for share in (0.0, 0.35)
    )
    row, column = np.indices(dry.depth.shape) + 0.5
    rays = np.stack([np.ones_like(row), (48.0 - column) / 48.0, (36.0 - row) / 48.0], axis=-1)
    points = transform_points(above, (rays * dry.depth[..., None]).reshape(-1, 3))
    expected = water.is_in_puddle(points, 0.35)
    change = luminance(wet).ravel() / luminance(dry).ravel()
    apart = np.abs(water.puddle_field_height(points) - water.puddle_water_level(0.35)) > 0.1
    darker = change < np.median(change[expected & apart]) / 2 + np.median(change[~expected]) / 2
    assert (darker == expected)[apart].mean() > 0.97


@both
def test_the_road_under_a_deck_is_dry(kind: Kind) -> None:
    # From 8 to 32 m ahead, and wider than the view.
    deck = replace(box((20.0, 0.0, 6.0), (24.0, 200.0, 1.0), GREY), semantic=Semantic.BRIDGE)
    dry, wet = (
        luminance(
            shot(
                kind,
                world_of(box(*ROAD), deck),
                build_clear_air(1000.0, wetness=wetness, puddle_coverage=wetness / 2),
                samples=16,
            )
        )
        for wetness in (0.0, 1.0)
    )
    # The road in row r is 1.5 m x 48 / (r - 36) away; before the deck it is darker, or mirrors.
    under, before = (
        np.abs(wet - dry)[rows, 20:76].mean() / dry[rows, 20:76].mean()
        for rows in (slice(39, 42), slice(50, 72))
    )
    assert under < 0.1
    assert before > 0.2


@both
@pytest.mark.parametrize("row", [27, 30, 36])
def test_standing_water_has_fresnel_reflectance(
    kind: Kind, row: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(MATERIALS, "asphalt", replace(MATERIALS["asphalt"], albedo=(0.0, 0.0, 0.0)))
    wall = box((21.0, 0.0, 40.0), (2.0, 400.0, 80.0), BLACK)
    air = build_clear_air(1000.0, wetness=1.0, puddle_coverage=1.0)
    sky, dark = (
        luminance(shot(kind, world_of(box(*ROAD), *walls), air, size=(49, 49)))
        for walls in ((), (wall,))
    )
    cosine = np.sin(np.arctan((row + 0.5 - 24.5) / 24.5))
    assert sky[row, 22:27].mean() == pytest.approx(1000.0 * fresnel(cosine), rel=0.1)
    assert dark[row, 22:27].mean() < 0.1 * sky[row, 22:27].mean()


@both
def test_a_wet_road_mirrors_the_brake_lamps_ahead(kind: Kind) -> None:
    ahead = state((26.0, 0.0, 0.0), lamps=Lamp.BRAKE)
    world, columns = world_of(box(*ROAD)), slice(46, 50)
    below = 36 + round(48 * (1.5 + 0.65) / 24.9)
    seen = [
        shot(kind, world, build_clear_air(0.02, night=True, wetness=wetness), ahead, samples=32)
        for wetness in (0.0, 1.0)
    ]
    dry, wet = (capture.radiance[below - 1 : below + 2, columns, 0].mean() for capture in seen)
    beside = seen[1].radiance[below - 1 : below + 2, :8, 0].mean()
    assert wet > 8.0 * dry
    assert wet > 20.0 * beside


def test_lamps_too_far_to_light_the_road_are_mirrored_in_it() -> None:
    lamp = StreetLamp((200.0, 0.0, 8.0))
    air = build_clear_air(0.01, night=True, wetness=1.0)
    lit, unlit = (
        luminance(shot("raster", world_of(box(*ROAD), street_lamps=lamps), air))
        for lamps in ((lamp,), ())
    )
    row = 36 + round(48 * 9.5 / 200.0)
    mirrored = (lit - unlit)[row - 1 : row + 2]
    assert mirrored[:, 46:50].mean() > 10.0 * mirrored[:, :20].mean()
    assert mirrored[:, 46:50].mean() > unlit[row - 1 : row + 2].mean()


@both
def test_two_hundred_lamps_light_the_road_as_each_of_them_would(kind: Kind) -> None:
    lamps = tuple(
        StreetLamp((25.0 * (n % 20) - 240.0, 25.0 * (n // 20) - 120.0, 6.0), 8000.0)
        for n in range(200)
    )
    road = box((0.0, 0.0, -0.5), (600.0, 600.0, 1.0), WHITE)
    at = downwards(5.0, *lamps[110].position[:2])
    one, all_of_them = (
        shot(
            kind,
            world_of(road, street_lamps=some),
            build_clear_air(0.0, night=True),
            at=at,
            size=(17, 17),
        )
        for some in ((lamps[110],), lamps)
    )
    places = np.array([lamp.position for lamp in lamps])
    away = np.linalg.norm(places - [*lamps[110].position[:2], 0.0], axis=1)
    expected = float((8000.0 / np.pi * 36.0 / away**4).sum() / np.pi)
    assert luminance(one)[8, 8] == pytest.approx(8000.0 / np.pi / 36.0 / np.pi, rel=0.02)
    assert luminance(all_of_them)[8, 8] == pytest.approx(expected, rel=0.02)


@both
def test_a_hidden_carrier_casts_its_shadow(kind: Kind) -> None:
    ground = box((0.0, 0.0, -0.5), (200.0, 200.0, 1.0), WHITE)
    air = build_clear_air(0.0, sun_lx=5e4)
    # The sun stands behind: the shadow of the two metres reaches from 1.0 to 2.5 m ahead.
    seen = [
        shot(
            kind, world_of(ground), air, *states, at=downwards(8.0, x=2.0), hide=hide, size=(33, 33)
        )
        for states, hide in (((state((0, 0, 0)),), frozenset({1})), ((), frozenset()))
    ]
    shaded, lit = (luminance(capture)[16, 16] for capture in seen)
    assert lit == pytest.approx(5e4 * 0.8 / np.pi, rel=0.01)
    assert shaded < 0.01 * lit
    assert not (seen[0].instance == 1).any()


def snow(**more: Any) -> Atmosphere:
    return build_clear_air(1000.0, snow_depth_m=0.03, **more)


@both
def test_snow_lies_on_what_faces_up_and_not_on_walls_or_under_roofs(kind: Kind) -> None:
    ground = box((0.0, 0.0, -0.5), (80.0, 80.0, 1.0), BLACK)
    roof = box((0.0, 20.0, 4.25), (12.0, 12.0, 0.5), BLACK)
    world = world_of(ground, roof)
    places = {
        "open": downwards(3.0),
        "roof": downwards(8.0, y=20.0),
        "under": downwards(3.0, y=20.0),
        "wall": pose_matrix((-6.5, 20.0, 4.25)),
    }
    seen = {
        name: luminance(shot(kind, world, snow(), at=at, size=(9, 9)))[4, 4]
        for name, at in places.items()
    }
    assert seen["open"] == pytest.approx(880.0, rel=0.03)
    assert seen["roof"] == pytest.approx(880.0, rel=0.03)
    assert seen["wall"] == 0.0
    assert seen["under"] < 20.0


@both
@pytest.mark.parametrize("cover", [0.3, 0.6])
@pytest.mark.parametrize("height_m", [15.0, 200.0])
def test_snow_covers_the_authored_fraction_of_the_road(
    kind: Kind, cover: float, height_m: float
) -> None:
    bare, snowed = (
        luminance(shot(kind, world_of(box(*ROAD)), air, at=downwards(height_m), samples=4)).mean()
        for air in (build_clear_air(1000.0), snow(road_snow_cover=cover, rut_snow_cover=0.2))
    )
    # Without lanes there are no ruts: the snow between them makes up for them.
    between = (cover - 0.3 * 0.2) / 0.7
    assert (snowed - bare) / (880.0 - bare) == pytest.approx(between, abs=0.08)


def test_wheels_keep_ruts_free_of_snow() -> None:
    x = np.linspace(-100.0, 100.0, 41)
    lane = LaneSegment(
        "a.+1",
        "driving",
        left=np.stack([x, np.full_like(x, 1.75), np.zeros_like(x)], axis=1),
        right=np.stack([x, np.full_like(x, -1.75), np.zeros_like(x)], axis=1),
    )
    world = world_of(box(*ROAD), lanes=(lane,))
    seen = luminance(
        shot("raster", world, snow(road_snow_cover=0.6, rut_snow_cover=0.1), at=downwards(24.0))
    )
    # Columns run against y, two of them a metre.
    across = seen.mean(axis=0)
    rut, middle = across[[46, 49]].mean(), across[[47, 48]].mean()
    assert rut < 0.75 * middle
