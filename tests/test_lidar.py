import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from advercity_dsl import Lidar, Weather
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from advercity.compiler.library import load_declaration
from advercity.poses import pose, transform
from advercity.randomness import generator
from advercity.rendering.casting import MATERIAL_NAMES, Caster, Hits
from advercity.semantics import Semantic
from advercity.sensors.lidar import (
    PointCloud,
    beams,
    detection_margin,
    echo,
    elevations_rad,
    fresnel,
    shoot,
    sweep,
    visible_counts,
    wet_factor,
)
from advercity.traffic.trace import Actor, ActorState, Frame, Lamp
from advercity.weather.derivation import atmosphere_of
from advercity.world.scene import Body, Mesh, World

Array = NDArray[np.float64]
CLEAR = {"air": {"mor_m": 20_000}}
ROADSIDE = Lidar(
    range_noise_m=0.02,
    dropoff_rate=0.3,
    dropoff_intensity_limit=0.7,
    dropoff_zero_intensity=0.4,
)


def atmosphere(**parts: Any) -> Any:
    return atmosphere_of(
        Weather.model_validate({"id": "tried", "time": "day"} | CLEAR | parts), "rural"
    )


def half_detected_m(reflected: float, extinction: float) -> float:
    """Where an echo is lost as often as found, by bisection."""
    near, far = 1.0, 1000.0
    for _ in range(60):
        middle = (near + far) / 2
        power = echo(np.array(middle), np.array(reflected), extinction)
        near, far = (middle, far) if detection_margin(power) > 0 else (near, middle)
    return near


def panel(range_m: float, count: int, material: str = "concrete") -> Hits:
    """Hits of a wall that faces the sensor, the same for every beam."""
    hits = Hits.misses(count)
    hits.range_m[:] = range_m
    hits.normal[:, 0] = -1
    hits.cosine[:] = 1
    hits.material[:] = MATERIAL_NAMES.index(material)
    hits.semantic[:] = Semantic.WALL
    return hits


def plate(name: str, corners: list[tuple[float, float, float]], material: str) -> Mesh:
    triangles = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    return Mesh(name, np.array(corners, np.float32), triangles, material, Semantic.ROAD)


GROUND = plate(
    "ground", [(-300, -300, 0), (300, -300, 0), (300, 300, 0), (-300, 300, 0)], "plaster"
)
TARGET = Body(
    (plate("panel", [(0, -2, 0), (0, 2, 0), (0, 2, 3), (0, -2, 3)], "plaster"),), (1, 4, 3)
)


def world_with(*positions: tuple[float, float]) -> Caster:
    caster = Caster(World("tried", (GROUND,), {"panel": TARGET}, (), Path("none")))
    states = tuple(
        ActorState(
            Actor(number, "van", "panel", "plaster", TARGET.size),
            pose((x, y, 0)),
            0.0,
            0.0,
            Lamp(0),
        )
        for number, (x, y) in enumerate(positions, start=1)
    )
    caster.place(Frame(0, 0.0, states, {}))
    return caster


def cloud(lidar: Lidar, hits: Hits, *key: int, **weather: Any) -> PointCloud:
    return sweep(lidar, hits, atmosphere(**weather), generator("test", *key))


def test_channels_and_azimuths_are_the_original_ones() -> None:
    channels = np.degrees(elevations_rad(Lidar()))
    assert len(channels) == 32
    assert (channels[0], channels[-1]) == (pytest.approx(-25), pytest.approx(15))
    np.testing.assert_allclose(np.diff(channels), 1.290323, atol=1e-6)
    directions = beams(Lidar()).reshape(3750, 32, 3)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1.0, atol=1e-12)
    azimuth = np.degrees(np.arctan2(directions[:3, 7, 1], directions[:3, 7, 0]))
    np.testing.assert_allclose(azimuth, [0, 0.096, 0.192], atol=1e-9)


def test_a_raised_roadside_lidar_looks_down() -> None:
    channels = np.degrees(elevations_rad(Lidar(upper_deg=-1)))
    np.testing.assert_allclose(np.diff(channels), 24 / 31)


def test_ten_per_cent_are_seen_to_80_m_in_clear_air() -> None:
    assert half_detected_m(0.10, math.log(20) / 20_000) == pytest.approx(80.0, rel=1e-6)


@pytest.mark.parametrize(("mor_m", "range_m"), [(50, 21.0), (100, 30.8), (200, 42.2)])
def test_fog_shortens_the_sight_of_ten_per_cent(mor_m: float, range_m: float) -> None:
    foggy = atmosphere(air={"mor_m": None}, fog={"mor_m": mor_m})
    assert half_detected_m(0.10, foggy.extinction_905nm) == pytest.approx(range_m, rel=0.01)


def test_heavy_rain_shortens_the_sight_of_fifty_per_cent() -> None:
    rainy = atmosphere(air={"mor_m": None}, rain={"rate_mm_h": 50})
    assert half_detected_m(0.50, rainy.extinction_905nm) == pytest.approx(112.3, rel=0.01)
    assert math.exp(-2 * rainy.extinction_905nm * 100) == pytest.approx(0.424, rel=0.01)


def test_light_crosses_fog_twice() -> None:
    foggy = atmosphere(air={"mor_m": None}, fog={"mor_m": 75})
    found = cloud(Lidar(), panel(25.0, 1000, "paint_white"), air={"mor_m": None}, fog={"mor_m": 75})
    assert math.exp(-2 * foggy.extinction_905nm * 25) == pytest.approx(0.1357, abs=1e-3)
    np.testing.assert_allclose(found.intensity, 0.7 * 0.1357, atol=1e-3)


def test_an_echo_at_the_threshold_is_reported_every_other_time() -> None:
    share = len(
        cloud(Lidar(), panel(half_detected_m(0.35, atmosphere().extinction_905nm), 100_000)).points
    )
    assert share / 100_000 == pytest.approx(0.5, abs=0.008)


def test_one_standard_deviation_above_the_threshold_is_reported_84_times_in_100() -> None:
    threshold = echo(np.array(80.0), np.array(0.1), math.log(20) / 20_000)
    np.testing.assert_allclose(
        detection_margin(threshold * np.array([0.8, 1, 1.2])), [-1, 0, 1], atol=1e-9
    )


@pytest.mark.parametrize(
    ("angle_deg", "reflected"), [(0, 0.0204), (60, 0.0597), (80, 0.3479), (85, 0.5835)]
)
def test_water_reflects_as_fresnel_says(angle_deg: float, reflected: float) -> None:
    cosine = np.array(math.cos(math.radians(angle_deg)))
    assert fresnel(cosine, 1.333) == pytest.approx(reflected, abs=1e-4)


@pytest.mark.parametrize(
    ("angle_deg", "factor"), [(0, 0.586), (45, 0.578), (70, 0.460), (80, 0.261), (87, 0.048)]
)
def test_a_film_of_water_takes_the_echo(angle_deg: float, factor: float) -> None:
    cosine = np.array(math.cos(math.radians(angle_deg)))
    assert wet_factor(np.array(0.15), cosine) == pytest.approx(factor, abs=1.5e-3)


@pytest.mark.parametrize(("wet", "range_m"), [(False, 25.4), (True, 13.6)])
def test_a_wet_road_is_lost_sooner(wet: bool, range_m: float) -> None:
    along = np.linspace(5.0, 40.0, 3501)
    slant = np.hypot(along, 1.9)
    cosine = 1.9 / slant
    reflected = 0.15 * cosine * (wet_factor(np.array(0.15), cosine) if wet else 1.0)
    seen = detection_margin(echo(slant, reflected, math.log(20) / 20_000)) > 0
    assert along[seen][-1] == pytest.approx(range_m, rel=0.02)


def test_wetness_takes_the_road_and_leaves_the_walls() -> None:
    lidar = Lidar()
    hits = shoot(lidar, pose((0, 0, 1.9)), world_with((10.0, 0.0)))
    dry = cloud(lidar, hits)
    wet = cloud(lidar, hits, surface={"wetness": 1})
    farthest = [found.range_m[found.instance == 0].max() for found in (dry, wet)]
    on_panel = [int((found.instance == 1).sum()) for found in (dry, wet)]
    assert farthest[1] < 0.7 * farthest[0]
    assert on_panel[1] == on_panel[0] > 0


def test_points_lie_on_what_was_hit_in_the_lidars_own_frame() -> None:
    world_from_lidar = pose((3.0, -2.0, 1.9), yaw=0.7, pitch=0.03)
    found = cloud(Lidar(), shoot(Lidar(), world_from_lidar, world_with((15.0, 4.0))))
    world = transform(world_from_lidar, found.points)
    ground, target = world[found.instance == 0], world[found.instance == 1]
    assert len(ground) > 1000
    assert len(target) > 100
    np.testing.assert_allclose(ground[:, 2], 0.0, atol=1e-3)
    np.testing.assert_allclose(target[:, 0], 15.0, atol=1e-3)
    assert (np.abs(target[:, 1] - 4.0) < 2.001).all()
    np.testing.assert_allclose(np.linalg.norm(found.points, axis=1), found.range_m, atol=1e-3)


def test_rings_count_from_the_lowest_channel() -> None:
    found = cloud(Lidar(), shoot(Lidar(), pose((0, 0, 1.9)), world_with((10.0, 0.0))))
    elevation = np.arcsin(found.points[:, 2] / found.range_m)
    np.testing.assert_allclose(elevation, elevations_rad(Lidar())[found.ring], atol=1e-5)


def test_intensity_is_reflectance_times_cosine_on_a_clear_day() -> None:
    found = cloud(Lidar(), panel(10.0, 100, "paint_white"))
    clear = atmosphere().extinction_905nm
    np.testing.assert_allclose(found.intensity, 0.7 * math.exp(-20 * clear), rtol=1e-5)


def test_range_noise_lies_along_the_beam() -> None:
    lidar = Lidar(range_noise_m=0.02)
    found = cloud(lidar, panel(30.0, 120_000))
    assert found.range_m.std() == pytest.approx(0.02, rel=0.02)
    assert found.range_m.mean() == pytest.approx(30.0, abs=1e-3)
    bearing = np.cross(found.points / found.range_m[:, None], beams(lidar))
    assert np.abs(bearing).max() < 1e-5


def test_the_roadside_units_drop_off_keeps_sixty_per_cent_at_200_m() -> None:
    lidar = ROADSIDE.model_copy(update={"azimuths": 31_250, "range_noise_m": 0.0})
    hits = panel(200.0, 1_000_000, "sign_red")
    air = {"mor_m": None}
    kept = len(cloud(lidar, hits, air=air).points) / 1_000_000
    kept_whole = len(cloud(Lidar(azimuths=31_250), hits, air=air).points) / 1_000_000
    assert kept / kept_whole == pytest.approx(0.7 * 0.857, rel=0.005)


def test_an_ideal_lidar_in_clear_air_drops_nothing_near() -> None:
    assert len(cloud(Lidar(), panel(20.0, 10_000)).points) == 10_000


def test_beams_are_counted_by_actor_whatever_the_weather() -> None:
    hits = shoot(Lidar(), pose((0, 0, 1.9)), world_with((10.0, 0.0), (20.0, 30.0), (30.0, 0.0)))
    counts = visible_counts(hits)
    assert set(counts) == {1, 2}
    assert counts[1] == (hits.instance == 1).sum() > counts[2] > 0


def test_the_same_key_gives_the_same_points() -> None:
    hits = panel(50.0, 5000)
    one, same, other = cloud(ROADSIDE, hits, 1), cloud(ROADSIDE, hits, 1), cloud(ROADSIDE, hits, 2)
    np.testing.assert_array_equal(one.points, same.points)
    assert len(one.points) != len(other.points) or (one.points != other.points).any()


@given(range_m=st.floats(1, 200), mor_m=st.floats(10, 10_000), clearer=st.floats(1, 5))
def test_more_fog_never_strengthens_an_echo(range_m: float, mor_m: float, clearer: float) -> None:
    thick, thin = (
        echo(np.array(range_m), np.array(0.3), math.log(20) / visibility)
        for visibility in (mor_m, mor_m * clearer)
    )
    assert thick <= thin


def test_worse_weather_never_gives_more_points(library: Path) -> None:
    lidar = Lidar()
    places = [(float(x), float(y)) for x in (8, 25, 45, 70) for y in (-30, -9, 0, 9, 30)]
    hits = shoot(lidar, pose((0, 0, 1.9)), world_with(*places))
    folder = library / "nhtsa" / "weather"
    weathers = [
        load_declaration(folder / f"{name}.yaml", Weather)
        for name in ("clear_day", "soft_rain_day", "heavy_rain_day", "foggy_heavy_rain_day")
    ]
    counts = [
        len(sweep(lidar, hits, atmosphere_of(weather, "urban"), generator("test")).points)
        for weather in weathers
    ]
    assert counts == sorted(set(counts), reverse=True)
    assert counts[-1] > 0
