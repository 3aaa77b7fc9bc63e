"""The reported points of a scan."""

import math
from dataclasses import replace

import numpy as np
import pytest
from advercity_dsl import Lidar

from advercity.compiler import find_weather
from advercity.geometry.poses import pose_matrix, transform_points
from advercity.physics.atmosphere import compute_atmosphere
from advercity.physics.extinction import AirExtinction, extinction_from_mor
from advercity.physics.weather_parts.part import Suspension
from advercity.randomness import create_generator
from advercity.semantics import Semantic
from advercity.sensors.lidar import (
    beam_directions,
    cast_scan,
    channel_elevations_rad,
    derive_lidar_conditions,
    measure_point_cloud,
)
from advercity.sensors.lidar.received_power import detection_margin_sigma
from advercity.sensors.measurements import PointKind
from tests.sensors.lidar.builders import (
    DARK,
    EXACT,
    ROADSIDE,
    STAND,
    VACUUM,
    air,
    ground,
    half_detection_range_m,
    measure,
    panel,
    raycaster_of,
    raycaster_with,
    received_power,
    scanned,
    upright,
    vary,
)


def test_a_return_at_the_threshold_is_reported_every_other_time() -> None:
    range_m = half_detection_range_m(0.35, air().extinction_per_m)
    assert len(measure(DARK, panel(range_m)).points) / 120_000 == pytest.approx(0.5, abs=0.008)


def test_without_noise_the_threshold_is_sharp() -> None:
    range_m = half_detection_range_m(0.35, air().extinction_per_m)
    counts = [len(measure(EXACT, panel(range_m + step)).points) for step in (-0.01, 0.01)]
    assert counts == [120_000, 0]


def test_one_standard_deviation_above_the_threshold_is_reported_84_times_in_100() -> None:
    threshold = received_power(np.array([80.0]), np.array([0.1]), extinction_from_mor(20_000))
    np.testing.assert_allclose(
        detection_margin_sigma(threshold * np.array([0.8, 1, 1.2])), [-1, 0, 1], atol=1e-9
    )


def test_beams_into_the_sun_detect_nothing() -> None:
    sun = {"elevation_deg": 8, "azimuth_deg": 90}
    lidar = vary(Lidar(), azimuths=3750)
    found = measure(lidar, panel(10.0), sun=sun)
    towards = air(sun=sun).sun_direction
    assert towards is not None
    off = beam_directions(lidar) @ towards
    blind = set(np.flatnonzero(off > math.cos(math.radians(1.0))).tolist())
    assert len(found.points) == 120_000 - len(blind)
    assert len(blind) > 10
    assert len(measure(DARK, panel(10.0), sun=sun).points) == 120_000


def test_wetness_darkens_the_road_but_not_the_walls() -> None:
    scan = cast_scan(DARK, STAND, raycaster_with((10.0, 0.0)))
    dry, wet = measure(DARK, scan), measure(DARK, scan, surface={"wetness": 1})
    farthest = [found.range_m[found.instance == 0].max() for found in (dry, wet)]
    on_panel = [int((found.instance == 1).sum()) for found in (dry, wet)]
    assert farthest[1] < 0.7 * farthest[0]
    assert on_panel[1] == on_panel[0] > 0


FLAT = vary(EXACT, lower_deg=-10, upper_deg=-0.6, channels=128, azimuths=100)
"""Rings on the ground from 11 to 180 m."""


def test_snow_covers_the_ground_and_not_the_walls() -> None:
    caster = raycaster_of(ground("asphalt"), upright(10, 5, 4, "brick"))
    scan = cast_scan(FLAT, STAND, caster)
    snow = {"temperature_c": -3, "snow": {"depth_mm": 30, "road_coverage": 0.5}}
    bare, covered = measure(FLAT, scan), measure(FLAT, scan, **snow)
    on_wall = [found.intensity[found.semantic == Semantic.WALL] for found in (bare, covered)]
    np.testing.assert_array_equal(on_wall[0], on_wall[1])
    farthest = [found.range_m[found.semantic == Semantic.ROAD].max() for found in (bare, covered)]
    assert farthest[1] > 1.2 * farthest[0]


def test_switching_rain_off_leaves_all_other_numbers_alone() -> None:
    lidar = vary(ROADSIDE, range_noise_model="signal", echoes="dual")
    scan = panel(20.0, lidar, "brick")
    rainy = air(**VACUUM, rain={"rate_mm_h": 50})
    wet = measure_point_cloud(lidar, scanned(scan), rainy, create_generator("test"))
    # Without drops to detect, in air as thick: a haze takes as much of the light.
    grey = Suspension("air", rainy.extinction["rain"])
    hazy = replace(rainy, extinction=AirExtinction((grey,)))
    dry = measure_point_cloud(lidar, scanned(scan), hazy, create_generator("test"))
    assert (wet.kind == PointKind.RAIN).any()
    surface = wet.kind == PointKind.SURFACE
    assert set(map(tuple, wet.points[surface])) <= set(map(tuple, dry.points))


@pytest.mark.parametrize("material", ["sign_red", "sign_white", "sign_yellow", "licence_plate"])
def test_signs_and_licence_plates_are_detected_farther_than_anything(material: str) -> None:
    found = measure(EXACT, panel(199.0, EXACT, material))
    assert len(found.points) == 120_000
    assert (found.intensity == 1.0).all()
    assert len(measure(EXACT, panel(199.0, EXACT, "plaster")).points) == 0


def test_lane_paint_is_detected_where_asphalt_is_not() -> None:
    farthest = [
        measure(FLAT, cast_scan(FLAT, STAND, raycaster_of(ground(name)))).range_m.max()
        for name in ("asphalt", "paint_white")
    ]
    assert farthest[1] > 1.5 * farthest[0]


def test_a_covered_window_attenuates_and_blocks() -> None:
    lens = {"enabled": True, "coverage": {"front": 0.1, "side": 0.0, "rear": 0.0}}
    found = measure(DARK, panel(10.0, DARK, "plaster"), lens=lens)
    clean = measure(DARK, panel(10.0, DARK, "plaster"))
    front = np.abs(np.arctan2(found.points[:, 1], found.points[:, 0])) < math.pi / 4
    assert 0.6 < front.sum() / 30_000 < 0.95
    assert (~front).sum() == pytest.approx(90_000, abs=64)
    dimmed = found.intensity[front].mean() / clean.intensity.mean()
    assert dimmed == pytest.approx(0.97**2, rel=1e-3)


@pytest.mark.parametrize("yaw_deg", [0.0, 90.0, -120.0, 180.0])
def test_the_front_of_a_covered_window_is_the_carriers(yaw_deg: float) -> None:
    """A mount that turns left has the carrier's front on its right."""
    lens = {"enabled": True, "coverage": {"front": 0.1, "side": 0.0, "rear": 0.0}}
    scan, covered = scanned(panel(10.0, DARK, "plaster")), air(lens=lens)
    found = measure_point_cloud(
        *(DARK, scan, covered, create_generator("test")), mount_yaw_deg=yaw_deg
    )
    bearing_deg = np.degrees(np.arctan2(found.points[:, 1], found.points[:, 0])) + yaw_deg
    in_front = np.abs((bearing_deg + 180.0) % 360.0 - 180.0) < 45.0
    assert 0.6 < in_front.sum() / 30_000 < 0.95
    assert (~in_front).sum() == pytest.approx(90_000, abs=64)


def test_a_drop_on_the_window_blocks_the_same_beams_in_every_scan() -> None:
    scan, lidar = scanned(panel(10.0, DARK, "plaster")), DARK
    coverage = {"front": 0.3, "side": 0.2, "rear": 0.1}

    def find_seen(frame: int, *window: int, **more: float) -> set[tuple[int, int]]:
        met = air(lens={"enabled": True, "coverage": coverage | more})
        rng = create_generator("test", frame)
        found = measure_point_cloud(lidar, scan, met, rng, window_key=window)
        bearing_deg = np.degrees(np.arctan2(found.points[:, 1], found.points[:, 0]))
        return set(zip(np.rint(bearing_deg * 100).tolist(), found.ring.tolist(), strict=True))

    first = find_seen(0, 7)
    assert find_seen(1, 7) == find_seen(90, 7) == first
    assert find_seen(0, 8) != first
    assert find_seen(0, 7, front=0.4, rear=0.25) < first  # more drops, and the first stay


def test_points_lie_on_surfaces_in_the_lidar_frame() -> None:
    world_from_lidar = pose_matrix((3.0, -2.0, 1.9), yaw=0.7, pitch=0.03)
    found = measure(DARK, cast_scan(DARK, world_from_lidar, raycaster_with((15.0, 4.0))))
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
    found = measure(DARK, cast_scan(DARK, STAND, raycaster_with((10.0, 0.0))))
    elevation = np.arcsin(found.points[:, 2] / found.range_m)
    np.testing.assert_allclose(elevation, channel_elevations_rad(DARK)[found.ring], atol=1e-5)


def test_intensity_is_reflectance_times_cosine_on_a_clear_day() -> None:
    for lidar in (DARK, Lidar()):
        found = measure(lidar, panel(10.0, lidar, "plaster"))
        np.testing.assert_allclose(
            found.intensity, 0.6 * math.exp(-20 * air().extinction_per_m), rtol=1e-4
        )


def test_range_noise_is_along_the_beam() -> None:
    lidar = vary(DARK, range_noise_m=0.02)
    found = measure(lidar, panel(30.0, lidar))
    assert found.range_m.std() == pytest.approx(0.02, rel=0.02)
    assert found.range_m.mean() == pytest.approx(30.0, abs=1e-3)
    bearing = np.cross(found.points / found.range_m[:, None], beam_directions(lidar))
    assert np.abs(bearing).max() < 1e-5


def test_weak_returns_have_uncertain_ranges() -> None:
    lidar = vary(EXACT, range_noise_m=0.02, range_noise_model="signal")
    spread = []
    for power in (1.0, 10.0):
        hits = panel(80.0, lidar, "wood")
        hits.cosine[:] = power * 0.1001 / 0.5
        spread.append(measure(lidar, hits).range_m.std())
    assert spread == pytest.approx([math.hypot(0.02, 0.15), math.hypot(0.02, 0.015)], rel=0.02)


def test_the_roadside_units_drop_off_keeps_sixty_per_cent_at_200_m() -> None:
    lidar = vary(ROADSIDE, azimuths=31_250, range_noise_m=0.0)
    hits = panel(200.0, lidar, "sign_red")
    kept = len(measure(lidar, hits, **VACUUM).points) / 1_000_000
    assert kept == pytest.approx(0.7 * 0.857, rel=0.005)


def test_an_ideal_lidar_in_clear_air_drops_nothing_near() -> None:
    assert len(measure(DARK, panel(20.0)).points) == 120_000


def test_the_same_key_gives_the_same_points() -> None:
    hits = panel(50.0, ROADSIDE)
    one, same, other = (measure(ROADSIDE, hits, key, rain={"rate_mm_h": 50}) for key in (1, 1, 2))
    np.testing.assert_array_equal(one.points, same.points)
    assert len(one.points) != len(other.points) or (one.points != other.points).any()


def test_worse_weather_never_shows_more_of_the_world() -> None:
    places = [(float(x), float(y)) for x in (8, 25, 45, 70) for y in (-30, -9, 0, 9, 30)]
    caster = raycaster_with(*places)
    counts: list[int] = []
    for name in ("clear", "soft_rain", "heavy_rain", "foggy_heavy_rain"):
        weather = find_weather(f"{name}_day").declaration
        met = derive_lidar_conditions(compute_atmosphere(weather, "urban"), weather.lens)
        scan = cast_scan(Lidar(), STAND, caster, puddle_coverage=met.puddle_coverage)
        found = measure_point_cloud(Lidar(), scan, met, create_generator("test"))
        counts.append(int((found.kind == PointKind.SURFACE).sum()))
    assert counts == sorted(counts, reverse=True)
    assert counts[-1] > 0
