import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from advercity_dsl import Lidar, Weather
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from pydantic import ValidationError

from advercity.compiler import find_weather
from advercity.frames import Actor, ActorState, Frame, Lamp
from advercity.geometry.mesh import Mesh
from advercity.geometry.poses import Matrix, pose_matrix, transform_points
from advercity.physics.atmosphere import compute_atmosphere
from advercity.physics.extinction import extinction_from_mor
from advercity.physics.water import fresnel_reflectance
from advercity.randomness import create_generator
from advercity.rendering.raycaster import MATERIAL_NAMES, Raycaster, RayHits
from advercity.semantics import Semantic
from advercity.sensors.annotation import count_lidar_hits
from advercity.sensors.lidar import (
    LidarConditions,
    ScanHits,
    beam_directions,
    cast_scan,
    channel_elevations_rad,
    derive_lidar_conditions,
    measure_point_cloud,
)
from advercity.sensors.lidar.beams import BeamGrid
from advercity.sensors.lidar.received_power import (
    daylight_noise_factor,
    detection_margin_sigma,
    received_power,
    wet_reflectance_ratio,
)
from advercity.sensors.lidar.returns import ReturnMode, Returns, select_reported
from advercity.sensors.measurements import PointCloud, PointKind
from advercity.world import Body, World

Array = NDArray[np.float64]
CLEAR = {"air": {"mor_m": 20_000}}
VACUUM = {"air": {"mor_m": None}}
DARK = Lidar(sunlight_noise=False)
EXACT = Lidar(sunlight_noise=False, detection="step")
ROADSIDE = Lidar(
    sunlight_noise=False,
    range_noise_m=0.02,
    dropoff_rate=0.3,
    dropoff_intensity_limit=0.7,
    dropoff_zero_intensity=0.4,
)


def air(**parts: Any) -> LidarConditions:
    weather = Weather.model_validate({"id": "tried", "time": "day"} | CLEAR | parts)
    return derive_lidar_conditions(compute_atmosphere(weather, "rural"), weather.lens)


def with_(lidar: Lidar, **fields: Any) -> Lidar:
    return Lidar.model_validate(lidar.model_dump() | fields)


def scanned(hits: RayHits) -> ScanHits:
    return ScanHits(hits, (), np.empty(0, np.intp), None, np.eye(4), None)


def half_detected_m(reflected: float, extinction: float) -> float:
    """Where an echo is lost as often as found, by bisection."""
    near, far = 1.0, 1000.0
    for _ in range(60):
        middle = (near + far) / 2
        power = received_power(np.array([middle]), np.array([reflected]), extinction)
        near, far = (middle, far) if detection_margin_sigma(power)[0] > 0 else (near, middle)
    return near


def misses(count: int) -> RayHits:
    """That many rays that met nothing."""
    return RayHits(
        range_m=np.full(count, np.inf, np.float32),
        normal=np.zeros((count, 3), np.float32),
        cosine=np.zeros(count, np.float32),
        material=np.zeros(count, np.int16),
        semantic=np.zeros(count, np.uint8),
        instance=np.zeros(count, np.int32),
    )


def panel(range_m: float, lidar: Lidar = DARK, material: str = "concrete") -> RayHits:
    """Hits of a wall that faces the sensor, the same for every beam."""
    hits = misses(lidar.azimuths * lidar.channels * lidar.sub_rays)
    hits.range_m[:] = range_m
    hits.normal[:, 0] = -1
    hits.cosine[:] = 1
    hits.material[:] = MATERIAL_NAMES.index(material)
    hits.semantic[:] = Semantic.WALL
    return hits


def plate(
    name: str, corners: Sequence[tuple[float, float, float]], material: str, tag: Semantic
) -> Mesh:
    triangles = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    return Mesh(name, np.array(corners, np.float32), triangles, material, tag)


def upright(x: float, half: float, height: float, material: str = "plaster") -> Mesh:
    corners = [(x, -half, 0), (x, half, 0), (x, half, height), (x, -half, height)]
    return plate(f"wall{x}", corners, material, Semantic.WALL)


def ground(material: str = "plaster") -> Mesh:
    corners = [(-300, -300, 0), (300, -300, 0), (300, 300, 0), (-300, 300, 0)]
    return plate("ground", corners, material, Semantic.ROAD)


TARGET = Body((upright(0, 2, 3),), (1, 4, 3))


def frame_with(*positions: tuple[float, float], speed_m_s: float = 0.0) -> Frame:
    states = tuple(
        ActorState(
            Actor(number, "van", "panel", "plaster", TARGET.size),
            pose_matrix((x, y, 0)),
            speed_m_s,
            0.0,
            Lamp(0),
        )
        for number, (x, y) in enumerate(positions, start=1)
    )
    return Frame(0, 0.0, states, {})


def caster_of(*static: Mesh) -> Raycaster:
    return Raycaster(World("tried", static, {"panel": TARGET}, (), Path("none")))


def world_with(*positions: tuple[float, float]) -> Raycaster:
    caster = caster_of(ground())
    caster.place(frame_with(*positions))
    return caster


STAND = pose_matrix((0, 0, 1.9))


def cloud(lidar: Lidar, seen: RayHits | ScanHits, *key: int, **weather: Any) -> PointCloud:
    scan = scanned(seen) if isinstance(seen, RayHits) else seen
    return measure_point_cloud(lidar, scan, air(**weather), create_generator("test", *key))


def share_of(found: PointCloud, kind: PointKind, lidar: Lidar = EXACT) -> float:
    """Share of beams that report a point of a kind, one a beam at most."""
    return float((found.kind == kind).sum()) / (lidar.azimuths * lidar.channels)


def sky(lidar: Lidar = EXACT) -> RayHits:
    """Nothing but air."""
    return misses(lidar.azimuths * lidar.channels)


def test_channels_and_azimuths_are_the_original_ones() -> None:
    channels = np.degrees(channel_elevations_rad(Lidar()))
    assert len(channels) == 32
    assert (channels[0], channels[-1]) == (pytest.approx(-25), pytest.approx(15))
    np.testing.assert_allclose(np.diff(channels), 1.290323, atol=1e-6)
    directions = beam_directions(Lidar()).reshape(3750, 32, 3)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1.0, atol=1e-6)
    azimuth = np.degrees(np.arctan2(directions[:3, 7, 1], directions[:3, 7, 0]))
    np.testing.assert_allclose(azimuth, [0, 0.096, 0.192], atol=1e-5)


def test_a_raised_roadside_lidar_looks_down() -> None:
    channels = np.degrees(channel_elevations_rad(Lidar(upper_deg=-1)))
    np.testing.assert_allclose(np.diff(channels), 24 / 31)


@pytest.mark.parametrize(
    ("table", "lowest", "highest"), [("hdl_32e", -30.67, 10.67), ("vlp_32c", -25.0, 15.0)]
)
def test_real_sensors_have_their_own_channels(table: str, lowest: float, highest: float) -> None:
    lidar = with_(Lidar(), channel_table=table)
    channels = np.degrees(channel_elevations_rad(lidar))
    assert len(channels) == 32
    assert (np.diff(channels) > 0).all()
    assert (channels[0], channels[-1]) == (pytest.approx(lowest), pytest.approx(highest))
    elevation = np.arcsin(beam_directions(lidar).reshape(3750, 32, 3)[5, :, 2])
    np.testing.assert_allclose(elevation, channel_elevations_rad(lidar), atol=1e-6)


def test_a_vlp_32c_looks_aside_with_some_channels() -> None:
    directions = beam_directions(with_(Lidar(), channel_table="vlp_32c")).reshape(3750, 32, 3)[0]
    aside = np.degrees(np.arctan2(directions[:, 1], directions[:, 0]))
    np.testing.assert_allclose(np.unique(np.abs(aside).round(3)), [1.4, 4.2])
    assert aside[0] == pytest.approx(-1.4, abs=1e-4)


def test_a_real_sensor_with_other_channels_is_refused() -> None:
    with pytest.raises(ValidationError, match="hdl_32e has 32 channels, not 64"):
        with_(Lidar(), channel_table="hdl_32e", channels=64)


def test_ten_per_cent_are_seen_to_80_m_in_clear_air() -> None:
    assert half_detected_m(0.10, math.log(20) / 20_000) == pytest.approx(80.0, rel=1e-6)


@pytest.mark.parametrize(("mor_m", "range_m"), [(50, 21.0), (100, 30.8), (200, 42.2)])
def test_fog_shortens_the_sight_of_ten_per_cent(mor_m: float, range_m: float) -> None:
    foggy = air(air={"mor_m": None}, fog={"mor_m": mor_m})
    assert half_detected_m(0.10, foggy.extinction_per_m) == pytest.approx(range_m, rel=0.01)


def test_heavy_rain_shortens_the_sight_of_fifty_per_cent() -> None:
    rainy = air(air={"mor_m": None}, rain={"rate_mm_h": 50})
    assert half_detected_m(0.50, rainy.extinction_per_m) == pytest.approx(112.3, rel=0.01)
    assert math.exp(-2 * rainy.extinction_per_m * 100) == pytest.approx(0.424, rel=0.01)


def test_light_crosses_fog_twice() -> None:
    fog = {"air": {"mor_m": None}, "fog": {"mor_m": 75}}
    lidar = with_(DARK, soft_gain=0, azimuths=100)
    found = cloud(lidar, panel(25.0, lidar, "plaster"), **fog)
    assert math.exp(-2 * air(**fog).extinction_per_m * 25) == pytest.approx(0.1357, abs=1e-3)
    np.testing.assert_allclose(found.intensity, 0.6 * 0.1357, atol=1e-3)


def test_an_echo_at_the_threshold_is_reported_every_other_time() -> None:
    range_m = half_detected_m(0.35, air().extinction_per_m)
    assert len(cloud(DARK, panel(range_m)).points) / 120_000 == pytest.approx(0.5, abs=0.008)


def test_without_noise_an_echo_is_there_or_not() -> None:
    range_m = half_detected_m(0.35, air().extinction_per_m)
    counts = [len(cloud(EXACT, panel(range_m + step)).points) for step in (-0.01, 0.01)]
    assert counts == [120_000, 0]


def test_one_standard_deviation_above_the_threshold_is_reported_84_times_in_100() -> None:
    threshold = received_power(np.array([80.0]), np.array([0.1]), extinction_from_mor(20_000))
    np.testing.assert_allclose(
        detection_margin_sigma(threshold * np.array([0.8, 1, 1.2])), [-1, 0, 1], atol=1e-9
    )


def test_sunlight_takes_eleven_per_cent_of_the_range() -> None:
    near, far = 1.0, 200.0
    for _ in range(50):
        middle = (near + far) / 2
        power = received_power(np.array([middle]), np.array([0.1]), 0.0) / daylight_noise_factor(
            100_000
        )
        near, far = (middle, far) if power[0] > 1 else (near, middle)
    assert near / 80.0 == pytest.approx(0.89, abs=0.015)
    assert daylight_noise_factor(0.0) == 1.0


def test_beams_into_the_sun_see_nothing() -> None:
    sun = {"elevation_deg": 8, "azimuth_deg": 90}
    lidar = with_(Lidar(), azimuths=3750)
    found = cloud(lidar, panel(10.0), sun=sun)
    towards = air(sun=sun).sun_direction
    assert towards is not None
    off = beam_directions(lidar) @ towards
    blind = set(np.flatnonzero(off > math.cos(math.radians(1.0))).tolist())
    assert len(found.points) == 120_000 - len(blind)
    assert len(blind) > 10
    assert len(cloud(DARK, panel(10.0), sun=sun).points) == 120_000


@pytest.mark.parametrize(
    ("angle_deg", "reflected"), [(0, 0.0204), (60, 0.0597), (80, 0.3479), (85, 0.5835)]
)
def test_water_reflects_as_fresnel_says(angle_deg: float, reflected: float) -> None:
    cosine = np.array([math.cos(math.radians(angle_deg))], np.float32)
    assert fresnel_reflectance(cosine, 1.333)[0] == pytest.approx(reflected, abs=1e-4)


@pytest.mark.parametrize(
    ("angle_deg", "factor"), [(0, 0.586), (45, 0.578), (70, 0.460), (80, 0.261), (87, 0.048)]
)
def test_a_film_of_water_takes_the_echo(angle_deg: float, factor: float) -> None:
    cosine = np.array([math.cos(math.radians(angle_deg))], np.float32)
    reflectance = np.array([0.15], np.float32)
    assert wet_reflectance_ratio(reflectance, cosine)[0] == pytest.approx(factor, abs=1.5e-3)


@pytest.mark.parametrize(("wet", "range_m"), [(False, 25.4), (True, 13.6)])
def test_a_wet_road_is_lost_sooner(wet: bool, range_m: float) -> None:
    along = np.linspace(5.0, 40.0, 3501, dtype=np.float32)
    slant = np.hypot(along, np.float32(1.9))
    cosine = 1.9 / slant
    film = wet_reflectance_ratio(np.full_like(cosine, 0.15), cosine) if wet else 1.0
    seen = (
        detection_margin_sigma(
            received_power(slant, 0.15 * cosine * film, extinction_from_mor(20_000))
        )
        > 0
    )
    assert along[seen][-1] == pytest.approx(range_m, rel=0.02)


def test_wetness_takes_the_road_and_leaves_the_walls() -> None:
    scan = cast_scan(DARK, STAND, world_with((10.0, 0.0)))
    dry, wet = cloud(DARK, scan), cloud(DARK, scan, surface={"wetness": 1})
    farthest = [found.range_m[found.instance == 0].max() for found in (dry, wet)]
    on_panel = [int((found.instance == 1).sum()) for found in (dry, wet)]
    assert farthest[1] < 0.7 * farthest[0]
    assert on_panel[1] == on_panel[0] > 0


def test_snow_covers_the_ground_and_not_the_walls() -> None:
    caster = caster_of(ground("asphalt"), upright(10, 5, 4, "brick"))
    scan = cast_scan(EXACT, STAND, caster)
    snow = {"temperature_c": -3, "snow": {"depth_mm": 30, "road_coverage": 0.5}}
    bare, covered = cloud(EXACT, scan), cloud(EXACT, scan, **snow)
    on_wall = [found.intensity[found.semantic == Semantic.WALL] for found in (bare, covered)]
    np.testing.assert_array_equal(on_wall[0], on_wall[1])
    farthest = [found.range_m[found.semantic == Semantic.ROAD].max() for found in (bare, covered)]
    assert farthest[1] > 1.2 * farthest[0]


@pytest.mark.parametrize(("mor_m", "limit_m"), [(50, 8.7), (75, 8.4), (150, 5.7)])
def test_fog_alone_sends_echoes_from_close_by(mor_m: float, limit_m: float) -> None:
    found = cloud(EXACT, sky(), air={"mor_m": None}, fog={"mor_m": mor_m})
    assert share_of(found, PointKind.FOG) == 1.0
    assert found.range_m.max() == pytest.approx(limit_m, abs=0.2)
    assert found.range_m.min() < 0.6
    assert not found.semantic.any()


def test_light_fog_sends_no_echo() -> None:
    found = cloud(EXACT, sky(), air={"mor_m": None}, fog={"mor_m": 500})
    assert len(found.points) == 0


@pytest.mark.parametrize(("material", "limit_m"), [("sign", 19.2), ("concrete", 29.9)])
def test_fog_outshines_what_is_far(material: str, limit_m: float) -> None:
    fog = {"air": {"mor_m": None}, "fog": {"mor_m": 75}}
    reflected = 0.10 if material == "sign" else 0.50
    near, far = (panel(limit_m + step, EXACT, "wood") for step in (-1.0, 1.0))
    for hits in (near, far):
        hits.cosine[:] = reflected / 0.5
    assert share_of(cloud(EXACT, near, **fog), PointKind.SURFACE) == 1.0
    assert share_of(cloud(EXACT, far, **fog), PointKind.FOG) == 1.0


def test_the_last_echo_looks_through_fog() -> None:
    fog = {"air": {"mor_m": None}, "fog": {"mor_m": 75}}
    scan = panel(28.0, EXACT, "brick")
    strongest, last, dual = (
        cloud(with_(EXACT, echoes=report), scan, **fog) for report in ("strongest", "last", "dual")
    )
    assert set(strongest.kind) == {PointKind.FOG}
    assert set(last.kind) == {PointKind.SURFACE}
    assert len(dual.points) == 240_000
    np.testing.assert_array_equal(dual.ring[::2], dual.ring[1::2])
    assert (dual.range_m[::2] < dual.range_m[1::2]).all()


@pytest.mark.parametrize("report", ["strongest", "last", "dual"])
def test_two_echoes_told_apart_at_once_are_those_that_sorting_finds(report: ReturnMode) -> None:
    one, other = echoes_of_every_beam(1), echoes_of_every_beam(2)
    third = echoes_of_every_beam(3).select(np.arange(len(one)) % 5 == 0)
    quick = select_reported([one, other], [third], len(one), report)
    slow = select_reported([], [one, other, third], len(one), report)
    assert len(slow) > 1000
    for column in ("beam", "range_m", "power", "kind"):
        np.testing.assert_array_equal(getattr(quick, column), getattr(slow, column))


def echoes_of_every_beam(kind: int, beams: int = 4000) -> Returns:
    """One echo a beam at most, some of which overlap others; the kind tells them apart."""
    rng = create_generator("echoes", kind)
    power = rng.uniform(0.3, 3.0, beams) * (rng.random(beams) < 0.8)
    return Returns(
        beam=np.arange(beams, dtype=np.int32),
        range_m=rng.uniform(5.0, 9.0, beams).astype(np.float32),
        power=power.astype(np.float32),
        noise=rng.standard_normal(beams, np.float32),
        kind=np.full(beams, kind, np.uint8),
        semantic=np.zeros(beams, np.uint8),
        instance=np.zeros(beams, np.int32),
    )


def test_dust_sends_its_own_kind() -> None:
    found = cloud(DARK, sky(), air={"mor_m": None}, dust={"mor_m": 30})
    assert set(found.kind) == {PointKind.DUST}
    assert len(found.points) > 50_000


@pytest.mark.parametrize(
    ("weather", "kind", "share", "median_m"),
    [
        ({"rain": {"rate_mm_h": 50}}, PointKind.RAIN, 0.024, 1.7),
        ({"rain": {"rate_mm_h": 10}}, PointKind.RAIN, 0.0028, 1.4),
        ({"snow": {"rate_mm_h": 1}, "temperature_c": -3}, PointKind.SNOW, 0.32, 4.1),
        ({"snow": {"rate_mm_h": 2.5}, "temperature_c": -3}, PointKind.SNOW, 0.50, 5.6),
    ],
)
def test_particles_stand_in_the_sky(
    weather: dict[str, Any], kind: PointKind, share: float, median_m: float
) -> None:
    found = cloud(EXACT, sky(), air={"mor_m": None}, **weather)
    assert set(found.kind) == {kind}
    assert share_of(found, kind) == pytest.approx(share, rel=0.10)
    assert np.median(found.range_m) == pytest.approx(median_m, rel=0.10)


def test_flakes_are_met_as_often_as_their_number_says() -> None:
    """Per beam and metre, in snow of 1 mm/h: every flake that passes the threshold."""
    (table,) = air(**VACUUM, snow={"rate_mm_h": 1}, temperature_c=-3).particles
    _, range_m, power = table.sample(1_000_000, create_generator("test"))
    detected = range_m[power >= 1.0]
    at = (1.0, 2.0, 3.0, 5.0, 7.0, 10.0)
    rates = [(np.abs(detected - middle) < 0.1).sum() / 1_000_000 / 0.2 for middle in at]
    np.testing.assert_allclose(rates, [0.050, 0.054, 0.054, 0.045, 0.029, 0.010], rtol=0.03)


def test_no_drop_is_seen_behind_a_wall() -> None:
    found = cloud(DARK, panel(3.0), rain={"rate_mm_h": 100})
    assert set(found.kind) <= {PointKind.SURFACE, PointKind.RAIN}
    assert found.range_m.max() <= 3.0 + 1e-4


def test_switching_rain_off_leaves_all_other_numbers_alone() -> None:
    lidar = with_(ROADSIDE, range_noise_model="signal", echoes="dual")
    scan = panel(20.0, lidar, "brick")
    rainy = air(**VACUUM, rain={"rate_mm_h": 50})
    wet = measure_point_cloud(lidar, scanned(scan), rainy, create_generator("test"))
    dry = measure_point_cloud(
        lidar, scanned(scan), replace(rainy, particles=()), create_generator("test")
    )
    assert (wet.kind == PointKind.RAIN).any()
    surface = wet.kind == PointKind.SURFACE
    assert set(map(tuple, wet.points[surface])) <= set(map(tuple, dry.points))


def test_a_pane_lets_most_light_through() -> None:
    glass = upright(5, 5, 4, "glass")
    behind = upright(9, 50, 20, "plaster_white")
    level = with_(EXACT, channels=1, lower_deg=0, upper_deg=1)
    shaded, plain = (
        cloud(level, cast_scan(level, STAND, caster_of(*walls)), **VACUUM)
        for walls in ((glass, behind), (behind,))
    )
    ahead = [np.flatnonzero(np.abs(found.points[:, 1]) < 1e-3) for found in (shaded, plain)]
    for found, rows in zip((shaded, plain), ahead, strict=True):
        assert found.range_m[rows[0]] == pytest.approx(9.0, abs=2e-3)
    intensity = [
        found.intensity[rows[0]] for found, rows in zip((shaded, plain), ahead, strict=True)
    ]
    assert intensity[0] / intensity[1] == pytest.approx(0.85**2, abs=1e-3)


@pytest.mark.parametrize("material", ["sign_red", "sign_yellow", "licence_plate"])
def test_signs_and_licence_plates_shine_farther_than_anything(material: str) -> None:
    found = cloud(EXACT, panel(199.0, EXACT, material))
    assert len(found.points) == 120_000
    assert (found.intensity == 1.0).all()
    assert len(cloud(EXACT, panel(199.0, EXACT, "plaster")).points) == 0


def test_lane_paint_is_seen_where_asphalt_is_not() -> None:
    farthest = [
        cloud(EXACT, cast_scan(EXACT, STAND, caster_of(ground(name)))).range_m.max()
        for name in ("asphalt", "paint_white")
    ]
    assert farthest[1] > 1.5 * farthest[0]


def test_puddles_hide_the_road_and_mirror_walls() -> None:
    caster = caster_of(ground("asphalt"), upright(12, 40, 10))
    scan = cast_scan(EXACT, STAND, caster, puddle_coverage=0.98)
    found = cloud(EXACT, scan, surface={"wetness": 1, "puddle_coverage": 0.98})
    ghosts = found.kind == PointKind.GHOST
    assert ghosts.sum() > 100
    assert (found.points[ghosts, 2] < -1.9).all()
    assert (found.semantic[ghosts] == Semantic.WALL).all()
    # Seen through the mirror, the wall goes on below the ground.
    np.testing.assert_allclose(found.points[ghosts, 0], 12.0, atol=5e-3)
    dry = cloud(EXACT, cast_scan(EXACT, STAND, caster))
    left, before = ((one.semantic == Semantic.ROAD).sum() for one in (found, dry))
    assert 0 < left < 0.05 * before


def test_puddles_cover_the_share_that_is_asked_for() -> None:
    scan = cast_scan(Lidar(), STAND, caster_of(ground("asphalt")), puddle_coverage=0.35)
    road = (scan.hits.semantic == Semantic.ROAD).sum()
    assert len(scan.puddle_rays) / road == pytest.approx(0.35, abs=0.1)


@pytest.mark.parametrize("middle", [(9, 2, 1), (-15, 0.1, 0), (0.5, 12, 3), (12, -9, 4), (0, 1, 0)])
def test_a_fan_finds_every_beam_that_meets_a_box(middle: tuple[float, float, float]) -> None:
    lidar = with_(DARK, channel_table="vlp_32c", azimuths=720)
    stand = pose_matrix((1, 2, 0.5), yaw=2.0, pitch=0.08, roll=-0.05)
    low, high = np.subtract(middle, (2, 1, 1)), np.add(middle, (2, 1, 1))
    corners = np.array([[x, y, z] for x, y, z in product(*zip(low, high, strict=True))])
    slope = 1.0 / (beam_directions(lidar) @ stand[:3, :3].T)
    one, other = (low - stand[:3, 3]) * slope, (high - stand[:3, 3]) * slope
    enter, leave = np.minimum(one, other).max(axis=1), np.maximum(one, other).min(axis=1)
    meets = np.flatnonzero(leave > np.maximum(enter, 0.0))
    found = BeamGrid.from_lidar(lidar, stand).find_beams_towards(corners)
    assert len(meets) > 20
    assert set(meets) <= set(found)


def test_spray_hangs_behind_fast_vehicles_alone() -> None:
    plumes = {"surface": {"wetness": 1, "film_mm": 0.8}}
    scan = cast_scan(EXACT, STAND, world_with((9.0, 0.0)))

    def found_at(speed_m_s: float, soft_gain: float) -> PointCloud:
        states = frame_with((9.0, 0.0), speed_m_s=speed_m_s).states
        lidar = with_(EXACT, soft_gain=soft_gain)
        return measure_point_cloud(
            lidar, scan, air(**plumes), create_generator("test"), states=states
        )

    slow, fast = found_at(5.0, 20), found_at(25.0, 20)
    spray = fast.kind == PointKind.SPRAY
    assert not (slow.kind == PointKind.SPRAY).any()
    assert spray.sum() > 10
    assert (fast.points[spray, 0] < 8.6).all()
    assert (np.abs(fast.points[spray, 1]) < 2.01).all()
    deaf = [found_at(speed, 0) for speed in (5.0, 25.0)]
    low = [(found.instance == 1) & (found.points[:, 2] < -0.9) for found in deaf]
    behind = [found.intensity[rows].mean() for found, rows in zip(deaf, low, strict=True)]
    assert 0 < behind[1] < 0.9 * behind[0]


def test_a_covered_window_dims_and_blocks() -> None:
    lens = {"enabled": True, "coverage": {"front": 0.1, "side": 0.0, "rear": 0.0}}
    found = cloud(DARK, panel(10.0, DARK, "plaster"), lens=lens)
    clean = cloud(DARK, panel(10.0, DARK, "plaster"))
    front = np.abs(np.arctan2(found.points[:, 1], found.points[:, 0])) < math.pi / 4
    assert 0.6 < front.sum() / 30_000 < 0.95
    assert (~front).sum() == pytest.approx(90_000, abs=64)
    dimmed = found.intensity[front].mean() / clean.intensity.mean()
    assert dimmed == pytest.approx(0.97**2, rel=1e-3)


def test_points_lie_on_what_was_hit_in_the_lidars_own_frame() -> None:
    world_from_lidar = pose_matrix((3.0, -2.0, 1.9), yaw=0.7, pitch=0.03)
    found = cloud(DARK, cast_scan(DARK, world_from_lidar, world_with((15.0, 4.0))))
    world = transform_points(world_from_lidar, found.points)
    on_ground, target = world[found.instance == 0], world[found.instance == 1]
    assert len(on_ground) > 1000
    assert len(target) > 100
    np.testing.assert_allclose(on_ground[:, 2], 0.0, atol=1e-3)
    np.testing.assert_allclose(target[:, 0], 15.0, atol=1e-3)
    assert (np.abs(target[:, 1] - 4.0) < 2.001).all()
    np.testing.assert_allclose(np.linalg.norm(found.points, axis=1), found.range_m, atol=1e-3)
    np.testing.assert_array_equal(found.raw, found.points)
    assert not found.time_s.any()


def test_rings_count_from_the_lowest_channel() -> None:
    found = cloud(DARK, cast_scan(DARK, STAND, world_with((10.0, 0.0))))
    elevation = np.arcsin(found.points[:, 2] / found.range_m)
    np.testing.assert_allclose(elevation, channel_elevations_rad(DARK)[found.ring], atol=1e-5)


def test_intensity_is_reflectance_times_cosine_on_a_clear_day() -> None:
    for lidar in (DARK, Lidar()):
        found = cloud(lidar, panel(10.0, lidar, "plaster"))
        np.testing.assert_allclose(
            found.intensity, 0.6 * math.exp(-20 * air().extinction_per_m), rtol=1e-4
        )


def test_range_noise_lies_along_the_beam() -> None:
    lidar = with_(DARK, range_noise_m=0.02)
    found = cloud(lidar, panel(30.0, lidar))
    assert found.range_m.std() == pytest.approx(0.02, rel=0.02)
    assert found.range_m.mean() == pytest.approx(30.0, abs=1e-3)
    bearing = np.cross(found.points / found.range_m[:, None], beam_directions(lidar))
    assert np.abs(bearing).max() < 1e-5


def test_weak_echoes_are_ranged_badly() -> None:
    lidar = with_(EXACT, range_noise_m=0.02, range_noise_model="signal")
    spread = []
    for power in (1.0, 10.0):
        hits = panel(80.0, lidar)
        hits.cosine[:] = power * 0.1001 / 0.35
        spread.append(cloud(lidar, hits).range_m.std())
    assert spread == pytest.approx([math.hypot(0.02, 0.15), math.hypot(0.02, 0.015)], rel=0.02)


def test_the_roadside_units_drop_off_keeps_sixty_per_cent_at_200_m() -> None:
    lidar = with_(ROADSIDE, azimuths=31_250, range_noise_m=0.0)
    hits = panel(200.0, lidar, "sign_red")
    kept = len(cloud(lidar, hits, **VACUUM).points) / 1_000_000
    assert kept == pytest.approx(0.7 * 0.857, rel=0.005)


def test_an_ideal_lidar_in_clear_air_drops_nothing_near() -> None:
    assert len(cloud(DARK, panel(20.0)).points) == 120_000


def test_beams_are_counted_by_actor_whatever_the_weather() -> None:
    caster = world_with((10.0, 0.0), (20.0, 30.0), (30.0, 0.0))
    scan = cast_scan(Lidar(), STAND, caster)
    counts = count_lidar_hits(scan, Lidar())
    assert set(counts) == {1, 2}
    assert counts[1] == (scan.hits.instance == 1).sum() > counts[2] > 0
    fine = with_(Lidar(), sub_rays=7)
    assert count_lidar_hits(cast_scan(fine, STAND, caster), fine) == counts


def test_a_beam_that_straddles_an_edge_echoes_twice() -> None:
    caster = caster_of(upright(10, 2, 6), upright(14, 50, 20))
    twice: list[int] = []
    for sub_rays in (1, 7):
        lidar = with_(EXACT, sub_rays=sub_rays, echoes="dual", upper_deg=5, lower_deg=1)
        found = cloud(lidar, cast_scan(lidar, STAND, caster))
        twice.append(int((np.diff(found.ring.astype(int)) == 0).sum()))
    assert twice[0] == 0
    assert twice[1] >= 32


def test_the_power_of_sub_rays_adds_up() -> None:
    fine = with_(EXACT, sub_rays=7)
    found = cloud(fine, panel(20.0, fine, "plaster"), **VACUUM)
    assert len(found.points) == 120_000
    np.testing.assert_allclose(found.intensity, 0.6, rtol=1e-4)
    np.testing.assert_allclose(found.range_m, 20.0, atol=1e-4)


WALL_AHEAD = upright(20.0, 400.0, 60.0)
MOVING = with_(EXACT, motion_distortion=True, lower_deg=0, upper_deg=15)
FORWARD_M = 40 / 3.6 * 0.1
"""What 40 km/h is in a turn."""


def scan_between(before: Matrix, now: Matrix, *walls: Mesh) -> ScanHits:
    return cast_scan(MOVING, now, caster_of(*walls), previous_world_from_lidar=before)


def test_a_wall_ahead_breaks_where_a_turn_of_a_driving_lidar_ends() -> None:
    scan = scan_between(pose_matrix((-FORWARD_M, 0, 1.9)), STAND, WALL_AHEAD)
    found = cloud(MOVING, scan)
    ahead = np.flatnonzero(np.abs(found.raw[:, 1]) < 0.1)
    first, last = found.raw[ahead[0], 0], found.raw[ahead[-1], 0]
    assert first - last == pytest.approx(1.11, rel=0.01)
    assert found.time_s[ahead[0]] == pytest.approx(-0.1, abs=1e-3)
    assert found.time_s[ahead[-1]] == pytest.approx(0.0, abs=1e-3)
    np.testing.assert_allclose(found.points[:, 0], 20.0, atol=0.02)


def test_a_wall_is_flat_again_after_a_turning_drive() -> None:
    before = pose_matrix((-FORWARD_M, 0.05, 1.9), yaw=-math.radians(2), pitch=0.01)
    found = cloud(MOVING, scan_between(before, STAND, WALL_AHEAD))
    near = np.linalg.norm(found.points, axis=1) < 100
    assert np.ptp(found.raw[near, 0]) > 1.0
    np.testing.assert_allclose(found.points[near, 0], 20.0, atol=0.02)


def test_a_turning_lidar_shifts_what_is_far() -> None:
    scan = scan_between(
        pose_matrix((0, 0, 1.9), yaw=-math.radians(2)), STAND, upright(50.0, 400, 60)
    )
    found = cloud(MOVING, scan)
    first = np.flatnonzero((found.time_s == found.time_s.min()) & (found.ring == 0))[0]
    shift = found.points[first] - found.raw[first]
    assert np.linalg.norm(shift) == pytest.approx(50 * math.radians(2), rel=0.02)


def test_a_moving_car_is_where_it_was_when_the_beam_met_it() -> None:
    caster = caster_of()
    caster.place(frame_with((-20.0, 8.0)), previous_frame=frame_with((-20.0, 0.0)))
    found = cloud(MOVING, cast_scan(MOVING, STAND, caster))
    # Straight behind, half the turn is over, and so is half of its way.
    middle = (found.points[:, 1].min() + found.points[:, 1].max()) / 2
    assert middle == pytest.approx(8.0 * (math.pi + math.atan2(-4, 20)) / (2 * math.pi), abs=0.25)
    np.testing.assert_allclose(found.points[:, 0], -20.0, atol=1e-3)


def test_without_motion_distortion_all_is_seen_at_once() -> None:
    lidar = with_(MOVING, motion_distortion=False)
    caster = caster_of(WALL_AHEAD)
    found = cloud(
        lidar,
        cast_scan(
            lidar, STAND, caster, previous_world_from_lidar=pose_matrix((-FORWARD_M, 0, 1.9))
        ),
    )
    np.testing.assert_allclose(found.raw[:, 0], 20.0, atol=1e-3)


def test_the_same_key_gives_the_same_points() -> None:
    hits = panel(50.0, ROADSIDE)
    one, same, other = (cloud(ROADSIDE, hits, key, rain={"rate_mm_h": 50}) for key in (1, 1, 2))
    np.testing.assert_array_equal(one.points, same.points)
    assert len(one.points) != len(other.points) or (one.points != other.points).any()


@given(range_m=st.floats(1, 200), mor_m=st.floats(10, 10_000), clearer=st.floats(1, 5))
def test_more_fog_never_strengthens_an_echo(range_m: float, mor_m: float, clearer: float) -> None:
    thick, thin = (
        received_power(np.array([range_m]), np.array([0.3]), extinction_from_mor(visibility))
        for visibility in (mor_m, mor_m * clearer)
    )
    assert thick[0] <= thin[0]


def test_worse_weather_never_shows_more_of_the_world() -> None:
    places = [(float(x), float(y)) for x in (8, 25, 45, 70) for y in (-30, -9, 0, 9, 30)]
    caster = world_with(*places)
    counts: list[int] = []
    for name in ("clear", "soft_rain", "heavy_rain", "foggy_heavy_rain"):
        weather = find_weather(f"{name}_day").declaration
        met = derive_lidar_conditions(compute_atmosphere(weather, "urban"), weather.lens)
        scan = cast_scan(Lidar(), STAND, caster, puddle_coverage=met.puddle_coverage)
        found = measure_point_cloud(Lidar(), scan, met, create_generator("test"))
        counts.append(int((found.kind == PointKind.SURFACE).sum()))
    assert counts == sorted(counts, reverse=True)
    assert counts[-1] > 0
