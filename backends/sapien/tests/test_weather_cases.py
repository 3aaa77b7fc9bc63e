"""Verification cases of the weather reference, by rendered images."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from advercity_dsl import Camera, Mount, Weather
from advercity_sapien import SapienBackend
from advercity_sapien.renderer import SapienRenderer
from numpy.typing import NDArray

from advercity.compiler import find_weather
from advercity.frames import Frame
from advercity.geometry.mesh import Mesh
from advercity.geometry.poses import pose_matrix
from advercity.physics.atmosphere import Atmosphere, compute_atmosphere
from advercity.physics.sky import build_airlight_cubemap
from advercity.rendering.backend import CameraCapture, CameraView, RenderProfile
from advercity.sensors.camera import CameraConditions, CameraExposure, add_air_effects
from advercity.world import World
from tests.render_builders import (
    LUMINANCE,
    PACKS,
    build_box,
    set_matt_materials,
)

pytestmark = pytest.mark.render

Open = Callable[..., AbstractContextManager[SapienRenderer]]
Floats = NDArray[np.floating]
SIDES = ((1, "card"), (-1, "black"))
STRIP = np.arange(-3, 4)
NAMES = ["clear_day", "soft_rain_day", "heavy_rain_day", "fog_day", "foggy_heavy_rain_day"]


@pytest.fixture(autouse=True)
def ideal_surfaces(monkeypatch: pytest.MonkeyPatch) -> None:
    set_matt_materials(monkeypatch, black=0.0, grey=0.3, card=0.8, white=1.0)


@pytest.fixture(scope="module", params=PACKS)
def opened(request: pytest.FixtureRequest) -> Open:
    return opening(request.param)


@pytest.fixture
def rasterised() -> Open:
    return opening("raster")


def opening(renderer: Literal["raster", "ray_traced"]) -> Open:
    def open_it(
        world: World, air: Atmosphere, *, samples: int = 1, path_depth: int = 1
    ) -> AbstractContextManager[SapienRenderer]:
        profile = RenderProfile("test", 1.0, renderer, samples=samples, path_depth=path_depth)
        return SapienBackend().open(world, air, profile)

    return open_it


def world_of(*static: Mesh) -> World:
    return World("test", static, {}, lanes=(), network=Path("none"))


def weather(**parts: object) -> Weather:
    return Weather.model_validate({"id": "tried", "time": "day"} | parts)


def view_of(at: NDArray[np.float64], size: tuple[int, int] = (160, 90)) -> CameraView:
    return CameraView(at, *size, np.radians(90.0))


def luminance(capture: CameraCapture) -> Floats:
    return capture.radiance @ LUMINANCE


def rendered(
    opened: Open, world: World, air: Atmosphere, view: CameraView, *, samples: int = 1
) -> CameraCapture:
    with opened(world, air, samples=samples, path_depth=samples) as renderer:
        renderer.place(Frame(0, 5.0, (), {}))
        return renderer.render_camera(view)


def card(distance_m: float) -> World:
    """A black card straight ahead."""
    return world_of(build_box((distance_m + 0.5, 0.0, 0.0), (1.0, distance_m, distance_m), "black"))


def airlight_ahead(air: Atmosphere) -> float:
    """A level view along +x into empty space."""
    middle = slice(air.airlight.shape[1] // 2 - 1, air.airlight.shape[1] // 2 + 1)
    red, green, blue, rise = air.airlight[0, middle, middle].mean(axis=(0, 1))
    return float((1.0 + rise) * (np.array([red, green, blue]) @ LUMINANCE))


@pytest.mark.parametrize(
    ("distance_m", "left"), [(10, 0.671), (20, 0.450), (25, 0.368), (50, 0.136), (75, 0.050)]
)
def test_fog_leaves_of_a_cards_contrast_what_koschmieder_says(
    opened: Open, distance_m: float, left: float
) -> None:
    foggy = compute_atmosphere(weather(air={"mor_m": None}, fog={"mor_m": 75}), "rural")
    clear = compute_atmosphere(weather(air={"mor_m": None}, sky={"oktas": 8}), "rural")
    ahead = view_of(pose_matrix((0.0, 0.0, 0.0)), (101, 51))
    contrasts: list[float] = []
    horizon = airlight_ahead(foggy)
    for air, behind in ((foggy, horizon), (clear, 1.0)):
        seen = luminance(rendered(opened, card(distance_m), air, ahead))
        contrasts.append((behind - float(seen[25, 50])) / behind)
    assert contrasts[1] == pytest.approx(1.0)
    assert contrasts[0] == pytest.approx(left, rel=0.02)


@pytest.mark.parametrize(
    ("distance_m", "expected"), [(5, 453), (10, 823), (20, 1375), (40, 1994), (75, 2375)]
)
def test_a_black_card_in_fog_shines_with_the_airlight_before_it(
    opened: Open, distance_m: float, expected: float
) -> None:
    foggy = compute_atmosphere(weather(air={"mor_m": None}, fog={"mor_m": 75}), "rural")
    seen = luminance(
        rendered(opened, card(distance_m), foggy, view_of(pose_matrix((0, 0, 0)), (101, 51)))
    )
    horizon = airlight_ahead(foggy)
    assert float(seen[25, 50]) * 2500.0 / horizon == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("dust", [{"mor_m": 60}, {"mor_m": 300}], ids=["storm", "dust"])
def test_far_things_in_dust_are_lost_in_the_sky_behind_them(
    rasterised: Open, dust: dict[str, object]
) -> None:
    """By Koschmieder's law 0.006 of a black object's contrast is left at 1.7 visibilities."""
    dusty = compute_atmosphere(weather(air={"mor_m": None}, dust=dust, sky={"oktas": 3}), "rural")
    distance_m = 1.7 * dusty.mor_m
    size = distance_m / 4.0
    things = world_of(build_box((distance_m + 0.5, 0.0, 0.0), (1.0, size, size), "black"))
    ahead = view_of(pose_matrix((0, 0, 0)), (101, 51))
    seen = [
        float(luminance(rendered(rasterised, world, dusty, ahead))[25, 50])
        for world in (things, world_of())
    ]
    assert 1.0 - seen[0] / seen[1] == pytest.approx(0.006, abs=0.03)


def test_white_things_in_white_fog_under_a_white_dome_are_not_to_be_seen(opened: Open) -> None:
    dome = 1000.0
    foggy = compute_atmosphere(weather(air={"mor_m": None}, fog={"mor_m": 50}), "rural")
    white = replace(
        foggy,
        sky=np.full_like(foggy.sky, dome),
        sky_lx=np.pi * dome,
        sun_lx=0.0,
        airlight=build_airlight_cubemap((dome, dome, dome), (dome, dome, dome)),
    )
    things = world_of(
        build_box((20.0, 0.0, 0.0), (4.0, 6.0, 6.0), "white"),
        build_box((60.0, 30.0, 5.0), (8.0, 8.0, 8.0), "white"),
    )
    view = view_of(pose_matrix((0.0, 0.0, 1.0)), (80, 45))
    seen = luminance(rendered(opened, things, white, view, samples=12))
    np.testing.assert_allclose(seen, dome, rtol=0.01)


def test_a_white_card_under_a_clear_sky_shines_with_26_kcd(opened: Open) -> None:
    air = compute_atmosphere(weather(air={"mor_m": None}), "rural")
    ground = world_of(build_box((0.0, 0.0, -0.5), (200.0, 200.0, 1.0), "card"))
    down = view_of(pose_matrix((0.0, 0.0, 5.0), pitch=np.pi / 2), (32, 18))
    seen = luminance(rendered(opened, ground, air, down, samples=16))
    assert float(seen.mean()) == pytest.approx(25_900.0, rel=0.03)


def street() -> World:
    """Dark and bright posts and walls along a road, near and far."""
    posts = [
        build_box((x, side * 4.0, 1.5), (0.3, 0.3, 3.0), paint)
        for x in (6.0, 10.0, 16.0, 25.0, 40.0, 60.0, 90.0)
        for side, paint in ((-1.0, "black"), (1.0, "card"))
    ]
    walls = [build_box((30.0 * n, 12.0, 3.0), (8.0, 2.0, 6.0), "grey") for n in range(1, 7)]
    return world_of(build_box((0.0, 0.0, -0.5), (400.0, 60.0, 1.0), "asphalt"), *posts, *walls)


def through_air(
    opened: Open, world: World, said: Weather, size: tuple[int, int] = (160, 90)
) -> CameraCapture:
    air = compute_atmosphere(said, "rural")
    view = view_of(pose_matrix((0.0, 0.0, 1.5)), size)
    shot = CameraExposure(view, Camera(mounts=(Mount(),)), Frame(0, 5.0, (), {}), np.zeros(3))
    return add_air_effects(
        rendered(opened, world, air, view), shot, CameraConditions.build(air, said.lens, "test")
    )


def test_weathers_cost_contrast_in_the_order_of_their_names(rasterised: Open) -> None:
    energy: list[float] = []
    for name in NAMES:
        seen = luminance(
            through_air(rasterised, street(), find_weather(name).declaration, (480, 270))
        )
        relative = np.log(seen[90:])
        energy.append(float(np.mean(np.abs(np.diff(relative, axis=1)))))
    clear, soft, heavy, fog, foggy_rain = energy
    assert clear > soft > heavy > fog
    assert foggy_rain < heavy


def far_contrast(opened: Open, said: Weather) -> float:
    """Contrast of a white card 60 m away against a black one, in the camera's light."""
    sides = [build_box((60.5, side * 10.0, 0.0), (1.0, 12.0, 20.0), paint) for side, paint in SIDES]
    seen = luminance(through_air(opened, world_of(*sides), said))
    bright, dark = (float(np.median(seen[40:50, 80 - 13 * side + STRIP])) for side, _ in SIDES)
    return (bright - dark) / (bright + dark)


def test_more_fog_never_shows_more_of_what_is_far(opened: Open) -> None:
    found = [
        far_contrast(opened, weather(sky={"oktas": 8}, fog={"mor_m": mor_m}))
        for mor_m in (None, 300, 75, 50)
    ]
    assert found == sorted(found, reverse=True)
    assert found[0] > 10.0 * found[-1] > 0.0


def test_more_rain_never_lets_one_see_farther(opened: Open) -> None:
    found = [
        far_contrast(opened, weather(sky={"oktas": 8}, rain={"rate_mm_h": rate}))
        for rate in (0, 25, 100)
    ]
    assert found == sorted(found, reverse=True)


def test_every_component_of_weather_can_be_disabled(opened: Open) -> None:
    size = 64, 36
    clear = {"sky": {"oktas": 8, "diffuse_lx": 9000.0}, "air": {"mor_m": None}}
    plain = through_air(opened, street(), weather(**clear), size)
    off: dict[str, dict[str, object]] = {
        "fog": {"mor_m": None},
        "rain": {"rate_mm_h": 0},
        "snow": {"rate_mm_h": 0, "depth_mm": 0},
        "dust": {"mor_m": None},
        "surface": {"wetness": 0, "puddle_coverage": 0, "film_mm": 0},
        "lens": {"enabled": False},
        "wind": {"speed_m_s": 12},
    }
    on: dict[str, dict[str, object]] = {
        "fog": {"mor_m": 200},
        "rain": {"rate_mm_h": 20},
        "dust": {"mor_m": 500},
        "surface": {"wetness": 1},
    }
    for name, setting in off.items():
        same = through_air(opened, street(), weather(**clear | {name: setting}), size)
        np.testing.assert_array_equal(same.radiance, plain.radiance)
    for name, setting in on.items():
        other = through_air(opened, street(), weather(**clear | {name: setting}), size)
        assert (other.radiance != plain.radiance).any(), name
