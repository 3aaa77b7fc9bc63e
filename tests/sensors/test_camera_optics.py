"""Spray, glass, ghosts, vignetting and white balance."""

import math
import os
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from advercity_dsl import Camera, Dirt, Exposure, Mount, Weather
from advercity_dsl.weather_components import Lens

from advercity.compiler import find_weather
from advercity.frames import Actor, ActorState, Frame, Lamp
from advercity.geometry.poses import pose_matrix
from advercity.physics.atmosphere import compute_atmosphere
from advercity.physics.lamp_beams import (
    HIGH_BEAM,
    LED_LOW_BEAM,
    LOW_BEAM,
    LampBeam,
    LampPattern,
    LightSource,
)
from advercity.randomness import create_generator
from advercity.rendering.backend import CameraCapture, CameraView
from advercity.rendering.light_sources import HIGH_BEAM_CD, LED_LOW_BEAM_RATIO
from advercity.sensors.camera import CameraConditions, CameraExposure, render_image
from advercity.sensors.camera.electronics import find_white_point
from advercity.sensors.camera.optics import (
    add_lens_ghosts,
    apply_glass,
    apply_vignetting,
    glass_coverage,
)
from advercity.sensors.camera.scene_light import AmbientLight
from advercity.sensors.camera.spray_veil import add_spray
from advercity.testing import make_capture, make_frame

WIDTH, HEIGHT = 240, 135
FOV_RAD = math.radians(100.0)


def sprayed_by(
    seen: CameraCapture, taken: CameraExposure, said: Weather, ambience: AmbientLight
) -> CameraCapture:
    return add_spray(seen, taken, ambience, water_film_mm=said.surface.film_mm)


def shot(
    *states: ActorState, lamps: tuple[LightSource, ...] = (), flare: float = 1.0
) -> CameraExposure:
    view = CameraView(pose_matrix((0.0, 0.0, 1.45)), WIDTH, HEIGHT, FOV_RAD)
    camera = Camera(mounts=(Mount(),), flare=flare)
    return CameraExposure(view, camera, Frame(0, 0.0, states, {}), np.zeros(3), lamps)


def capture(luminance: float, depth_m: float = np.inf) -> CameraCapture:
    return CameraCapture(
        radiance=np.full((HEIGHT, WIDTH, 3), luminance, np.float32),
        depth=np.full((HEIGHT, WIDTH), depth_m, np.float32),
        normal=np.zeros((HEIGHT, WIDTH, 3), np.float32),
        semantic=np.zeros((HEIGHT, WIDTH), np.uint8),
        instance=np.zeros((HEIGHT, WIDTH), np.int32),
    )


def shipped(name: str) -> Weather:
    return find_weather(name).declaration


def driving(speed_m_s: float, at: Any = (20.0, 0.0, 0.0)) -> ActorState:
    return ActorState(
        Actor(1, "car", "car", "paint", (4.4, 1.8, 1.5)), pose_matrix(at), speed_m_s, 0.0, Lamp(0)
    )


@pytest.mark.parametrize(("exponent", "edge"), [(0, 1.0), (1, 0.643), (4, 0.171)])
def test_pictures_darken_towards_their_edge_by_the_cosine(exponent: float, edge: float) -> None:
    light = np.ones((HEIGHT, WIDTH, 3), np.float32)
    focal_px = WIDTH / 2.0 / math.tan(FOV_RAD / 2.0)
    found = apply_vignetting(light, focal_px, exponent)
    assert found[67, 120, 0] == pytest.approx(1.0, abs=1e-3)
    assert found[67, 0, 0] == pytest.approx(edge, rel=0.02)


@pytest.mark.parametrize("name", ["heavy_rain_day", "fog_day", "clear_night", "fog_night"])
def test_grey_is_grey_in_the_light_of_its_weather(name: str) -> None:
    atmosphere = compute_atmosphere(shipped(name), "urban")
    light = np.asarray(atmosphere.horizon_airlight)
    shown = light / find_white_point(atmosphere)
    np.testing.assert_allclose(shown / shown[1], 1.0, atol=0.05)


def test_a_sunlit_road_is_grey_with_a_little_warmth_at_most() -> None:
    atmosphere = compute_atmosphere(shipped("clear_day"), "rural")
    upward = math.sin(math.radians(60.0)) * atmosphere.sun_lx
    sky = atmosphere.sky_lx * np.array([0.85, 1.0, 1.4])
    shown = (upward * np.asarray(atmosphere.sun_colour) + sky) / find_white_point(atmosphere)
    assert 0.9 < shown[0] / shown[2] < 1.25


# UN R112, class B, right-hand traffic: degrees to the right and up, least and most candela. UN R149
# has the same for class C, which LEDs may meet.
R112_POINTS = {
    "B50L": (-3.43, 0.57, 0, 350),
    "BR": (2.5, 1.0, 0, 1750),
    "75R": (1.15, -0.57, 10_100, None),
    "75L": (-3.43, -0.57, 0, 10_600),
    "50L": (-3.43, -0.86, 0, 13_200),
    "50R": (1.72, -0.86, 10_100, None),
    "50V": (0.0, -0.86, 5_100, None),
    "25L": (-9.0, -1.72, 1_700, None),
    "25R": (9.0, -1.72, 1_700, None),
    "zone III, left": (-8.0, 0.5, 0, 625),
    "zone III, middle": (0.0, 2.0, 0, 625),
    "zone IV, left": (-5.15, -1.72, 2_500, None),
    "zone IV, right": (5.15, -1.72, 2_500, None),
    "sign, point 7": (-8.0, 0.0, 65, 625),
    "sign, point 8": (-4.0, 0.0, 125, 625),
}


HALOGEN, LED = (LOW_BEAM, 20e3), (LED_LOW_BEAM, 20e3 * LED_LOW_BEAM_RATIO)


@pytest.mark.parametrize(("beam", "peak_cd"), [HALOGEN, LED])
@pytest.mark.parametrize("name", R112_POINTS)
def test_a_low_beam_is_within_the_limits_of_its_regulation(
    name: str, beam: LampBeam, peak_cd: float
) -> None:
    h_deg, v_deg, least, most = R112_POINTS[name]
    assert least <= peak_cd * beam_fraction(beam, h_deg, v_deg) <= (most or 44_100)


@pytest.mark.parametrize("beam", [LOW_BEAM, LED_LOW_BEAM])
def test_a_low_beam_does_not_light_the_road_before_it_more_than_twice_as_much_as_ahead(
    beam: LampBeam,
) -> None:
    """Zone I of UN R112: at most twice the intensity at 50R."""
    near = [beam_fraction(beam, h_deg, v_deg) for h_deg in (-9, 0, 9) for v_deg in (-1.72, -3, -6)]
    assert max(near) <= 2.0 * beam_fraction(beam, 1.72, -0.86)


def sharpness(beam: LampBeam) -> float:
    """UN R112, annex 9: the largest fall of the logarithm in 0.1 degrees, 2.5 degrees left."""
    candela = [beam_fraction(beam, -2.5, -0.55 + 0.01 * step) for step in range(200)]
    return float(np.max(np.log10(candela[:-10]) - np.log10(candela[10:])))


def test_leds_have_a_sharper_cutoff_within_the_limits_of_their_regulation() -> None:
    assert 0.13 < sharpness(LOW_BEAM) < sharpness(LED_LOW_BEAM) < 0.40


def test_leds_light_both_sides_of_the_road_more() -> None:
    for h_deg in (-25, 25, 35):
        halogen, led = (
            peak_cd * beam_fraction(beam, h_deg, -2.0) for beam, peak_cd in (HALOGEN, LED)
        )
        assert led > 1.2 * halogen


@pytest.mark.parametrize(
    ("right_deg", "least_cd"), [(0, 40_500), (-2.5, 20_300), (2.5, 20_300), (-5, 5_100), (5, 5_100)]
)
def test_a_high_beam_is_within_the_limits_of_its_regulation(
    right_deg: float, least_cd: float
) -> None:
    """UN R112, driving beam of class B; at most 215 kcd, and 80 % of that straight ahead."""
    peak_cd = HIGH_BEAM_CD["car"] / 2.0
    candela = peak_cd * beam_fraction(HIGH_BEAM, right_deg, 0.0)
    assert least_cd <= candela <= 215_000
    assert beam_fraction(HIGH_BEAM, 0.0, 0.0) >= 0.8


@pytest.mark.parametrize(
    ("aside_deg", "least_cd"), [(3, 17_500), (6, 5_000), (9, 3_400), (12, 1_500)]
)
def test_a_high_beam_is_as_wide_as_the_newer_regulation_demands(
    aside_deg: float, least_cd: float
) -> None:
    """UN R149, 01 series of amendments, table 5: driving beam of class B, level."""
    peak_cd = HIGH_BEAM_CD["car"] / 2.0
    for right_deg in (-aside_deg, aside_deg):
        assert peak_cd * beam_fraction(HIGH_BEAM, right_deg, 0.0) >= least_cd


def test_a_high_beam_shines_as_far_up_as_down() -> None:
    for up_deg in (1.0, 3.0, 6.0):
        up, down = (beam_fraction(HIGH_BEAM, 0.0, side * up_deg) for side in (1, -1))
        assert up == pytest.approx(down, rel=0.01)


@pytest.mark.parametrize(("beam", "peak_cd"), [HALOGEN, LED])
def test_a_low_beam_lights_signs_as_its_regulation_demands(beam: LampBeam, peak_cd: float) -> None:
    """Points 1 to 3, 4 degrees up, and 4 to 6, 2 degrees up, together."""
    upper, lower = (
        sum(peak_cd * beam_fraction(beam, h_deg, v_deg) for h_deg in (-side_deg, 0.0, side_deg))
        for side_deg, v_deg in ((8.0, 4.0), (4.0, 2.0))
    )
    assert upper >= 190
    assert lower >= 375


def beam_fraction(beam: LampBeam, h_deg: float, v_deg: float) -> float:
    h, v = math.radians(h_deg), math.radians(v_deg)
    ray = np.array([[math.cos(v) * math.cos(h), -math.cos(v) * math.sin(h), math.sin(v)]])
    return float(beam.relative_intensity(np.array([1.0, 0.0, 0.0]), ray)[0])


def test_the_sun_throws_ghosts_to_the_other_side_of_the_picture() -> None:
    sun = {"elevation_deg": 12.0, "azimuth_deg": 70.0}
    glare = Weather.model_validate({"id": "tried", "time": "day", "sun": sun})
    atmosphere = compute_atmosphere(glare, "rural")
    black = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    added = add_lens_ghosts(black, capture(0.0), shot(), atmosphere)
    # The sun stands up to the left, so most of it goes down to the right.
    assert added[70:, 125:].sum() > added[:65, :115].sum() > 0.0
    # The smallest disc, of 1.5 degrees: 5e-5 of the light over pi * 0.02618^2 steradian.
    brightest = 0.02322 * atmosphere.sun_lx * np.array(atmosphere.sun_colour)
    np.testing.assert_allclose(added.max(axis=(0, 1)), brightest, rtol=1e-3)
    assert add_lens_ghosts(black, capture(0.0), shot(flare=0.0), atmosphere) is black
    assert not add_lens_ghosts(black, capture(0.0, depth_m=30.0), shot(), atmosphere).any()


def test_a_lamp_throws_fainter_ghosts_the_farther_it_is() -> None:
    atmosphere = compute_atmosphere(shipped("clear_night"), "rural")
    black = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    sums: list[float] = []
    for away_m in (10.0, 20.0):
        lamp = LightSource(
            LampPattern.LENS, (away_m, away_m / 5.0, 1.45), (-1.0, 0.0, 0.0), 4e3, (1.0, 1.0, 1.0)
        )
        sums.append(
            float(add_lens_ghosts(black, capture(0.0), shot(lamps=(lamp,)), atmosphere).sum())
        )
    assert sums[0] == pytest.approx(4.0 * sums[1], rel=0.02)


def test_wheels_throw_up_spray_where_the_road_is_wet_and_they_are_fast() -> None:
    wet, dry = shipped("heavy_rain_day"), shipped("clear_day")
    ambience = AmbientLight.from_atmosphere(compute_atmosphere(wet, "urban"))
    dark = capture(0.0, depth_m=60.0)
    fast, slow = shot(driving(13.0)), shot(driving(5.0))
    assert sprayed_by(dark, fast, dry, ambience) is dark
    assert sprayed_by(dark, slow, wet, ambience) is dark
    sprayed = sprayed_by(dark, fast, wet, ambience).radiance
    # Behind the car, and no higher than its plume.
    assert sprayed[75, 120].min() > 0.0
    assert not sprayed[:60].any()
    assert sprayed.max() < 0.5 * float(ambience.mean_luminance.max())
    hidden = sprayed_by(capture(0.0, depth_m=2.0), fast, wet, ambience).radiance
    assert not hidden.any()


def test_faster_wheels_throw_up_more() -> None:
    wet = shipped("heavy_rain_day")
    ambience = AmbientLight.from_atmosphere(compute_atmosphere(wet, "urban"))
    dark = capture(0.0, depth_m=60.0)
    thick = [
        float(sprayed_by(dark, shot(driving(speed)), wet, ambience).radiance.sum())
        for speed in (9.0, 18.0)
    ]
    assert thick[1] == pytest.approx(4.0 * thick[0], rel=0.15)


@pytest.mark.parametrize("kind", ["water", "dust", "snow"])
def test_covered_glass_hides_the_fraction_that_is_covered(kind: str) -> None:
    lens = Lens.model_validate({"enabled": True, "kind": kind, "coverage": {"front": 0.3}})
    light = np.full((HEIGHT, WIDTH, 3), 100.0, np.float32)
    light[:, ::8] = 900.0
    coverage = glass_coverage(lens, Mount())
    assert coverage == 0.3
    assert glass_coverage(lens, Mount(yaw_deg=180)) == 0.0
    found = [
        apply_glass(light, shot(), lens.kind, coverage, create_generator("test", key))
        for key in (1, 1, 2)
    ]
    np.testing.assert_array_equal(found[0], found[1])
    assert (found[0] != found[2]).any()
    even = np.full_like(light, 100.0)
    covered = apply_glass(even, shot(), lens.kind, coverage, create_generator("test"))
    # Water shows what is around it, which here is the same; dust and snow show themselves.
    spot = {"water": 100.0, "dust": 30.0, "snow": 90.0}[kind]
    expected = 100.0 - coverage * (100.0 - spot)
    assert float(covered.mean()) == pytest.approx(expected, abs=0.15 * (100.0 - spot) + 0.01)


def test_a_clean_lens_leaves_the_picture_alone() -> None:
    light = np.ones((HEIGHT, WIDTH, 3), np.float32)
    lens = Lens.model_validate({"coverage": {"front": 0.3}})
    assert glass_coverage(lens, Mount()) == 0.0
    assert apply_glass(light, shot(), lens.kind, 0.0, create_generator("test")) is light


def test_dirt_stays_in_its_place_through_weathers_and_frames() -> None:
    """Grey light shows only it, where a linear image is darker than the same without."""
    size = {"width_px": WIDTH, "height_px": HEIGHT, "mounts": (Mount(),), "noise": False}
    view, even = shot().view, make_capture(WIDTH, HEIGHT, radiance_cd_m2=1000.0)

    def find_dark(dirt: Dirt | None, weather: str, index: int = 0, carrier: str = "") -> Any:
        """Find the light that is lost, relative to that of a clean camera."""
        declared = find_weather(weather).declaration
        air = compute_atmosphere(declared, "urban")
        conditions = CameraConditions.build(air, declared.lens, weather)
        taken: list[Any] = []
        for one in (dirt, None):
            manual = Exposure(mode="manual", shutter_s=0.001)
            camera = Camera.model_validate(size | {"dirt": one, "hdr": True, "exposure": manual})
            frame = make_frame(index=index, time_s=0.1 * index)
            exposure = CameraExposure(view, camera, frame, np.zeros(3))
            rng = create_generator("test", index)
            found = render_image(
                even, exposure, conditions, rng, mount=Mount(), carrier=carrier
            ).hdr
            assert found is not None
            taken.append(found.astype(float)[..., 1])
        return 1 - taken[0] / taken[1]

    dirt = Dirt(coverage=0.1, seed=3)
    dark = find_dark(dirt, "clear_day")
    # A spot shows 0.3 of the mean light; the lens scatters a little of the rest over it.
    assert dark.mean() == pytest.approx(0.1 * 0.7, rel=0.25)
    assert dark.max() > 0.4
    same = find_dark(dirt, "glare_day", index=9)
    assert np.corrcoef(dark.ravel(), same.ravel())[0, 1] > 0.95
    for other in (find_dark(Dirt(coverage=0.1), "clear_day"), find_dark(dirt, "clear_day", 0, "b")):
        assert abs(np.corrcoef(dark.ravel(), other.ravel())[0, 1]) < 0.3


def test_grey_stays_grey_while_the_sun_sets_and_lamps_go_on() -> None:
    whites = [
        find_white_point(compute_atmosphere(Weather.model_validate(weather), "urban"))
        for weather in (
            {"id": "before", "time": "day", "sun": {"elevation_deg": 0.3}},
            {"id": "after", "time": "night", "sun": {"elevation_deg": -0.3}},
        )
    ]
    assert whites[0] == pytest.approx(whites[1], rel=0.03)


def test_a_white_point_does_not_depend_on_the_number_of_threads() -> None:
    program = (
        "from advercity.compiler import find_weather\n"
        "from advercity.physics.atmosphere import compute_atmosphere\n"
        "from advercity.sensors.camera.electronics import find_white_point\n"
        "weather = find_weather('heavy_rain_night').declaration\n"
        "print(find_white_point(compute_atmosphere(weather, 'rural')).tolist())\n"
    )
    printed = {
        subprocess.run(
            [sys.executable, "-c", program],
            env=os.environ | {"OPENBLAS_NUM_THREADS": threads, "OMP_NUM_THREADS": threads},
            capture_output=True,
            check=True,
        ).stdout
        for threads in ("1", "2", "3")
    }
    assert len(printed) == 1
