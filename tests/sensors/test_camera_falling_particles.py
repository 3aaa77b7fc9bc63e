"""Drops and flakes between camera and scene."""

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from advercity_dsl import Camera, Exposure, Mount, Weather
from advercity_dsl.weather_components import Wind
from numpy.typing import NDArray

from advercity.frames import Frame
from advercity.geometry.poses import pose_matrix
from advercity.physics.atmosphere import Atmosphere, compute_atmosphere
from advercity.physics.extinction import compute_extinction
from advercity.physics.lamp_beams import LampPattern, LightSource
from advercity.physics.precipitation import (
    wind_at_height,
)
from advercity.physics.weather_parts.rain import compute_speed_m_s
from advercity.randomness import create_generator
from advercity.rendering.backend import CameraCapture, CameraView
from advercity.rendering.cover import Cover
from advercity.semantics import Semantic
from advercity.sensors.camera import (
    CameraConditions,
    CameraExposure,
    add_air_effects,
    meter_exposure,
    render_image,
)
from advercity.sensors.camera.falling_particles import ParticleBlock, build_particle_blocks
from advercity.sensors.camera.motion_streaks import project_streaks
from advercity.sensors.camera.scene_light import lamp_luminance
from advercity.testing import build_box

FOV_RAD = math.radians(100.0)
SKY = {"oktas": 8}
BOX = np.array([[1, 0, 0, 0], [-1, 0, 0, 10], [0, 1, 0, 0], [0, -1, 0, 5], [0, 0, 1, 0]])
PLANES = np.vstack([BOX, [0, 0, -1, 2]]).astype(float)
CORNERS = np.array([[x, y, z] for x in (0, 10) for y in (0, 5) for z in (0, 2)], float)
"""Of a box of 100 m³."""


def weather(**parts: Any) -> Weather:
    return Weather.model_validate({"id": "tried", "time": "day", "sky": SKY} | parts)


def camera_conditions(said: Weather) -> CameraConditions:
    return CameraConditions.build(compute_atmosphere(said, "rural"), said.lens, "test")


def particle_blocks(said: Weather) -> tuple[ParticleBlock, ...]:
    return build_particle_blocks(compute_atmosphere(said, "rural"), "test")


def zenith_airlight(air: Atmosphere) -> NDArray[np.float64]:
    middle = air.airlight.shape[1] // 2
    texel = air.airlight[4, middle, middle]
    return texel[:3] * (1.0 + texel[3])


def rainy(rate_mm_h: float = 50.0, wind_m_s: float = 0.0) -> Weather:
    wind = {"speed_m_s": wind_m_s, "from_deg": 270}
    return weather(rain={"rate_mm_h": rate_mm_h}, wind=wind)


def snowy(wind_m_s: float = 0.0) -> Weather:
    return weather(
        snow={"rate_mm_h": 1.5}, temperature_c=-3, wind={"speed_m_s": wind_m_s, "from_deg": 270}
    )


def shot(
    width_px: int = 480,
    *,
    at: Any = (0.0, 0.0, 1.5),
    time_s: float = 0.0,
    velocity: Any = (0, 0, 0),
) -> CameraExposure:
    view = CameraView(pose_matrix(at), width_px, width_px * 9 // 16, FOV_RAD)
    camera = Camera(mounts=(Mount(),))
    return CameraExposure(view, camera, Frame(0, time_s, (), {}), np.asarray(velocity, float))


def capture(luminance: float, depth_m: float = 50.0, width_px: int = 480) -> CameraCapture:
    size = width_px * 9 // 16, width_px
    return CameraCapture(
        radiance=np.full((*size, 3), luminance, np.float32),
        depth=np.full(size, depth_m, np.float32),
        normal=np.zeros((*size, 3), np.float32),
        semantic=np.zeros(size, np.uint8),
        instance=np.zeros(size, np.int32),
    )


def through(said: Weather, seen: CameraCapture, taken: CameraExposure) -> NDArray[np.float32]:
    air = camera_conditions(said)
    return add_air_effects(seen, taken, air).radiance


def in_box(
    block: ParticleBlock, time_s: float = 0.0, around: Any = (40.0, -7.0, 3.0)
) -> NDArray[Any]:
    """Diameters of what is within the box of 100 m³."""
    found = block.find_particles(PLANES, CORNERS, np.asarray(around), time_s)
    inside = (found.position @ PLANES[:, :3].T + PLANES[:, 3] >= 0.0).all(axis=1)
    return found.diameter_m[inside]


def test_three_planes_of_the_visible_volume_meet_in_each_of_its_corners() -> None:
    view = CameraView(np.eye(4), 200, 100, math.radians(90.0))
    exposure = CameraExposure(view, Camera(mounts=(Mount(),)), Frame(0, 0.0, (), {}), np.zeros(3))
    planes, corners = exposure.frustum(2.0, 10.0)
    assert {tuple(corner) for corner in corners.round(9).tolist()} == {
        (x, y * x, z * x / 2) for x in (2, 10) for y in (-1, 1) for z in (-1, 1)
    }
    inside_m = corners @ planes[:, :3].T + planes[:, 3]
    assert (inside_m > -1e-9).all()
    assert (inside_m < 1e-9).sum(axis=1).tolist() == [3] * 8
    # Ten metres ahead: sides at 45 degrees, above and below at a slope of one half.
    ahead_m = planes @ [10.0, 0.0, 0.0, 1.0]
    np.testing.assert_allclose(ahead_m, [7.0711, 7.0711, 4.4721, 4.4721, 8.0, 0.0], atol=1e-4)


@pytest.mark.parametrize(
    ("said", "least_mm", "widest"), [("rainy", 0.5, 1.41), ("snowy", 0.4, 5.1)]
)
def test_bands_of_sizes_follow_each_other_and_hold_all_that_is_large_enough_to_see(
    said: str, least_mm: float, widest: float
) -> None:
    weather = {"rainy": rainy, "snowy": snowy}[said]()
    (falling,) = compute_extinction(weather).precipitation
    sizes = falling.sizes
    blocks = particle_blocks(weather)
    bands = sorted({(block.band.low_mm, block.band.high_mm) for block in blocks})
    assert bands[0][0] == least_mm
    assert bands[-1][1] == sizes.max_melted_mm
    assert all(low == high for (_, high), (low, _) in pairwise(bands))
    assert sum(block.number_m3 for block in blocks) == pytest.approx(
        float(sizes.number_concentration_above(least_mm))
    )
    # Of nearly one size each, but for the few largest flakes.
    assert max(high / low for low, high in bands) < widest
    assert all(high / low < 1.7 for low, high in bands[:-1])


def test_a_third_each_of_the_flakes_falls_slower_and_faster_by_three_tenths() -> None:
    (flakes,) = compute_extinction(snowy()).precipitation
    blocks = particle_blocks(snowy())
    speeds = sorted({round(block.fall_speed_m_s / flakes.speed_m_s, 6) for block in blocks})
    assert speeds == [0.7, 1.0, 1.3]
    first = [block for block in blocks if block.band.low_mm == 0.4]
    assert len({block.number_m3 for block in first}) == 1
    assert len({block.band.key for block in blocks}) == len(blocks)


def test_a_block_has_65536_particles_in_16_cells_along_each_edge() -> None:
    """Sixteen a cell, so a cell holds 16 / number of cubic metres; glints have a mean of 1."""
    block = of_two_millimetres(rainy())
    assert len(block.cell_starts) == 16**3 + 1
    assert len(block.diameter_m) == pytest.approx(2**16, rel=0.02)
    assert block.cell_m**3 == pytest.approx(16 / block.number_m3)
    assert block.offset_m.min() >= 0.0
    assert 0.99 * block.cell_m < block.offset_m.max() <= block.cell_m
    assert block.glint.mean() == pytest.approx(1.0, rel=0.03)
    assert np.log(block.glint).std() == pytest.approx(1.0, rel=0.02)


@pytest.mark.parametrize(("rate_mm_h", "expected"), [(10, 25_200), (50, 73_010)])
def test_as_many_large_drops_fly_as_marshall_and_palmer_counted(
    rate_mm_h: float, expected: float
) -> None:
    blocks = particle_blocks(rainy(rate_mm_h))
    diameter_m = np.concatenate([in_box(block, time_s=12.3) for block in blocks])
    assert int((diameter_m > 1e-3).sum()) == pytest.approx(expected, abs=3 * math.sqrt(expected))
    (drops,) = compute_extinction(rainy(rate_mm_h)).precipitation
    larger_m3 = float(drops.sizes.number_concentration_above(1.0))
    assert larger_m3 * 100 == pytest.approx(expected, rel=0.003)


@pytest.mark.parametrize(
    ("diameter_mm", "speed_m_s"), [(0.1, 0), (0.5, 2.02), (1, 4.00), (2, 6.55), (5, 9.14)]
)
def test_drops_fall_as_fast_as_their_size_lets_them(diameter_mm: float, speed_m_s: float) -> None:
    assert compute_speed_m_s(diameter_mm) == pytest.approx(speed_m_s, abs=0.01)


def of_two_millimetres(said: Weather) -> ParticleBlock:
    return next(block for block in particle_blocks(said) if block.max_diameter_m > 2e-3)


def test_a_drop_of_two_millimetres_streaks_33_millimetres_which_are_26_pixels_at_a_metre() -> None:
    falling = of_two_millimetres(rainy())
    assert falling.fall_speed_m_s == pytest.approx(6.55, rel=0.01)
    taken = shot(1920)
    planes, corners = taken.frustum(0.9, 1.1)
    seen = project_streaks(falling.find_particles(planes, corners, taken.position, 0.0), taken)
    row, column = seen.begin[:, 1], seen.begin[:, 0]
    middle = (abs(row - 540) < 100) & (abs(column - 960) < 300)
    length_at_1_m = seen.length_px[middle] * seen.depth_m[middle]
    np.testing.assert_allclose(length_at_1_m, 26.4, rtol=0.01)
    assert taken.camera.exposure.shutter_s * falling.fall_speed_m_s == pytest.approx(
        0.0327, rel=0.01
    )


@pytest.mark.parametrize(("shutter_s", "length_px"), [(1 / 60, 87.9), (1 / 2000, 2.64)])
def test_a_drop_streaks_as_far_as_it_falls_while_the_shutter_is_open(
    shutter_s: float, length_px: float
) -> None:
    falling = of_two_millimetres(rainy())
    taken = shot(1920).with_shutter(shutter_s)
    planes, corners = taken.frustum(0.9, 1.1)
    seen = project_streaks(falling.find_particles(planes, corners, taken.position, 0.0), taken)
    middle = (abs(seen.begin[:, 1] - 540) < 100) & (abs(seen.begin[:, 0] - 960) < 300)
    length_at_1_m = seen.length_px[middle] * seen.depth_m[middle]
    np.testing.assert_allclose(length_at_1_m, length_px, rtol=0.01)


def test_no_drop_is_drawn_under_a_deck() -> None:
    """The deck is from 1 to 3 m ahead, and 2 m up."""
    deck = build_box((2, 40, 1), (2, 0, 4), material="concrete", semantic=Semantic.BRIDGE)
    falling = of_two_millimetres(rainy())
    particles = falling.find_particles(*shot().frustum(0.3, 5.0), shot().position, 0.0)
    taken = replace(shot(), cover=Cover.from_meshes([deck]))
    seen, covered = (project_streaks(particles, one) for one in (shot(), taken))
    under = [(one.position[:, 0] > 1) & (one.position[:, 0] < 3) for one in (seen, covered)]
    assert under[0].sum() > 100
    assert not under[1].any()
    np.testing.assert_array_equal(covered.position, seen.position[~under[0]])


def test_a_shutter_open_for_longer_draws_no_fewer_drops_and_thinner_ones() -> None:
    falling = of_two_millimetres(rainy())
    particles = falling.find_particles(*shot().frustum(0.3, 3.0), shot().position, 0.0)
    usual, longer = (
        project_streaks(particles, shot().with_shutter(open_s)) for open_s in (0.005, 1 / 60)
    )
    assert len(longer.depth_m) >= len(usual.depth_m) > 100
    assert longer.opacity.max() < usual.opacity.max()


def picture(said: Weather, seen: CameraCapture, **exposure: Any) -> NDArray[np.uint8]:
    """What a camera takes from a car that drives 10 m/s."""
    taken = shot(velocity=(10.0, 0.0, 0.0))
    camera = taken.camera.model_copy(update={"exposure": Exposure(**exposure)})
    air = camera_conditions(said)
    rng = create_generator("electronics")
    return render_image(seen, replace(taken, camera=camera), air, rng, mount=Mount()).image


def test_by_night_a_sensor_streaks_rain_for_a_30th_of_a_second() -> None:
    said, dark = rainy().model_copy(update={"time": "night"}), capture(0.01)
    taken = picture(said, dark, mode="sensor")
    by_hand = {"mode": "manual", "iso": 10_000}
    np.testing.assert_array_equal(taken, picture(said, dark, **by_hand, shutter_s=1 / 30))
    assert (taken != picture(said, dark, **by_hand, shutter_s=1 / 30.1)).any()


@pytest.mark.parametrize("said", [rainy(), snowy()], ids=["rain", "snow"])
def test_by_day_a_sensor_freezes_what_falls_with_the_shutter_that_it_metered(
    said: Weather,
) -> None:
    bright = capture(50_000.0)
    card = camera_conditions(said).white_card_cd_m2
    setting = meter_exposure(bright.radiance, Exposure(mode="sensor"), white_card_cd_m2=card)
    assert setting.shutter_s < 0.001
    taken = picture(said, bright, mode="sensor")
    frozen = picture(said, bright, mode="manual", shutter_s=setting.shutter_s)
    np.testing.assert_array_equal(taken, frozen)
    as_light = {"mode": "manual", "shutter_s": 0.005, "iso": 100 * setting.shutter_s / 0.005}
    assert (taken != picture(said, bright, **as_light)).any()


def test_rain_slants_with_the_wind() -> None:
    wind = Wind(speed_m_s=5.0 / 0.5373, from_deg=270)
    np.testing.assert_allclose(wind_at_height(wind, 2.5), [5.0, 0.0, 0.0], atol=1e-2)
    falling = of_two_millimetres(rainy(wind_m_s=wind.speed_m_s))
    slant = math.degrees(math.atan2(falling.velocity[0], falling.fall_speed_m_s))
    assert slant == pytest.approx(37.4, abs=0.5)


def test_a_moving_camera_sees_rain_come_towards_it() -> None:
    still, moving = shot(), shot(velocity=(15.0, 0.0, 0.0))
    falling = of_two_millimetres(rainy())
    particles = falling.find_particles(*still.frustum(0.3, 3.0), still.position, 0.0)
    outwards = []
    for taken in (still, moving):
        seen = project_streaks(particles, taken)
        from_middle = seen.begin - [240, 135]
        outwards.append(np.mean(np.sign(np.sum((seen.end - seen.begin) * from_middle, axis=1))))
    assert abs(outwards[0]) < 0.2
    assert outwards[1] > 0.6


@pytest.mark.parametrize("said", [rainy(wind_m_s=8.0), snowy(wind_m_s=4.0)], ids=["rain", "snow"])
def test_all_cameras_see_the_same_particles_at_every_time(said: Weather) -> None:
    block = particle_blocks(said)[6]
    here, there = np.array([3.0, 4.0, 1.0]), np.array([5.0, 3.0, 1.5])
    for time_s in (0.0, 5.9, 177.7):
        places = []
        for around in (here, there):
            low, high = here - around, here + 6.0 - around
            planes = np.vstack(
                [np.column_stack([np.eye(3), -low]), np.column_stack([-np.eye(3), high])]
            )
            found = block.find_particles(planes, np.array([low, high]), around, time_s)
            within = (found.position @ planes[:, :3].T + planes[:, 3] >= 0.01).all(axis=1)
            places.append(found.position[within] + around)
        assert len(places[0]) > 10
        ordered = [part[np.lexsort(part.round(2).T)] for part in places]
        np.testing.assert_allclose(ordered[0], ordered[1], atol=2e-3)


@pytest.mark.parametrize("said", [rainy(wind_m_s=5.0), snowy(wind_m_s=5.0)])
def test_particles_fly_on_from_frame_to_frame(said: Weather) -> None:
    block = particle_blocks(said)[6]
    around = np.array([0.0, 0.0, 2.0])
    planes, corners = PLANES, CORNERS
    first = block.find_particles(planes, corners, around, 3.0)
    second = block.find_particles(planes, corners, around, 3.01)
    expected = first.position + first.velocity * 0.01
    inner = ((expected > [1, 1, 0.5]) & (expected < [9, 4, 1.5])).all(axis=1)
    gap = np.linalg.norm(expected[inner][:200, None] - second.position[None], axis=2).min(axis=1)
    assert gap.max() < 1e-3


def test_gusts_sway_flakes_by_three_tenths_of_the_wind() -> None:
    """Of 10 m/s at 10 m, 5.372 are left at the height of cameras, ln(2.5 / 0.5) / ln(10 / 0.5)."""
    block = particle_blocks(snowy(wind_m_s=10.0))[6]
    flakes = block.find_particles(PLANES, CORNERS, np.array([0.0, 0.0, 2.0]), 3.0)
    assert len(flakes.velocity) > 300
    assert flakes.velocity[:, 0].mean() == pytest.approx(5.372, abs=0.3)
    assert flakes.velocity[:, 0].std() == pytest.approx(0.3 * 5.372, rel=0.1)


def test_flakes_sway_on_without_a_jump() -> None:
    """Each sway repeats after 12.5 s, ten cycles of 0.8 Hz, as its three frequencies do."""
    block = particle_blocks(snowy(wind_m_s=10.0))[6]
    still = replace(block, velocity=np.zeros(3))
    around = np.array([0.0, 0.0, 2.0])

    def swayed(time_s: float) -> NDArray[Any]:
        return still.find_particles(PLANES, CORNERS, around, time_s).position

    times_s = np.arange(0.0, 13.0, 0.02)
    steps_m = [np.abs(swayed(time_s + 0.02) - swayed(time_s)).max() for time_s in times_s.tolist()]
    fastest_m_s = 2 * np.pi * 0.8 * block.sway_m * 1.3
    assert max(steps_m) < 1.01 * 0.02 * fastest_m_s
    np.testing.assert_allclose(swayed(12.5 + 3.0), swayed(3.0), atol=1e-3)
    assert np.abs(swayed(6.25 + 3.0) - swayed(3.0)).max() > 0.1 * block.sway_m


def test_rain_brightens_the_dark_and_is_lost_before_the_sky() -> None:
    said = rainy()
    sky = camera_conditions(said).ambient_light
    drop = sky.drop_luminance(np.array([[1.0, 0.0, 0.0]])).mean()
    contrast = []
    for behind in (0.05 * drop, drop):
        seen = through(said, capture(float(behind)), shot())
        contrast.append(float((seen / behind - 1.0).mean()))
    assert contrast[0] > 0.03
    assert abs(contrast[1]) < 0.05 * contrast[0]


def test_more_rain_draws_more_streaks_but_never_a_curtain() -> None:
    black = capture(0.0)
    covered = [
        float((through(rainy(rate), black, shot()) > 0).mean()) for rate in (4.0, 25.0, 50.0, 100.0)
    ]
    assert covered == sorted(covered)
    seen = through(rainy(50), black, shot())
    drop = (
        seen.max()
        / camera_conditions(rainy(50))
        .ambient_light.drop_luminance(np.array([[1.0, 0.0, 0.0]]))
        .max()
    )
    assert 0.03 < drop < 0.8
    assert np.percentile(seen, 99) < 0.15 * seen.max() / drop


def test_what_is_nearer_than_a_drop_hides_it() -> None:
    black = capture(0.0, depth_m=0.2)
    assert not through(rainy(), black, shot()).any()
    half = capture(0.0)
    half.depth[:, :240] = 0.2
    seen = through(rainy(), half, shot())
    assert not seen[:, :240].any()
    assert seen[:, 240:].any()


def test_drops_before_a_lamp_are_ten_times_as_bright_and_flakes_are_not() -> None:
    """Seen halfway to a lamp 10 m ahead, at twice the angle off it that the place has."""
    lamp = LightSource(LampPattern.LENS, (10.0, 0.0, 0.0), (-1.0, 0.0, 0.0), 4e3, (1.0, 1.0, 1.0))
    aside = 5.0 * np.tan(np.radians([0.0, 2.5, 5.0, 10.0, 15.0]))
    points = np.column_stack([np.full(5, 5.0), aside, np.zeros(5)])
    drops, flakes = (
        lamp_luminance([lamp], points, np.zeros(3), per_lx=0.5, forward_scattering=is_drop)
        for is_drop in (True, False)
    )
    np.testing.assert_allclose(flakes[0], 0.5 * 4e3 / 25, rtol=1e-5)
    ratio = (drops / flakes)[:, 0]
    np.testing.assert_allclose(ratio, [10.0, 8.594, 5.5, 1.0, 1.0], rtol=1e-3)


def test_flakes_are_dots_where_drops_are_streaks() -> None:
    taken = shot(1920)
    lengths = []
    for said in (rainy(), snowy()):
        block = max(particle_blocks(said), key=lambda block: -abs(block.max_diameter_m - 3e-3))
        seen = project_streaks(
            block.find_particles(*taken.frustum(1.0, 2.0), taken.position, 0.0), taken
        )
        lengths.append(float(np.median(seen.length_px / seen.width_px)))
    assert lengths[0] > 8.0
    assert lengths[1] < 3.0


def test_flakes_are_dark_before_the_sky_and_bright_before_dark_things() -> None:
    said = snowy()
    zenith = float(np.mean(zenith_airlight(compute_atmosphere(said, "rural"))))
    assert through(said, capture(zenith), shot()).mean() < zenith
    assert through(said, capture(0.02 * zenith), shot()).mean() > 0.02 * zenith


def test_without_precipitation_the_picture_stays_as_it_is() -> None:
    seen = capture(123.0)
    assert add_air_effects(seen, shot(), camera_conditions(weather())) is seen


def test_streaks_do_not_depend_on_what_was_seen_before() -> None:
    black, said = capture(0.0), rainy()
    taken, other = shot(time_s=9.1), shot(at=(4.0, 2.0, 1.5), time_s=2.0)
    first = through(said, black, taken)
    through(said, black, other)
    np.testing.assert_array_equal(first, through(said, black, taken))
    assert (first != through(said, black, replace(taken, frame=Frame(1, 9.2, (), {})))).any()
