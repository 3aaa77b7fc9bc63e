"""Air and light of the frames of a weather that changes."""

import math

import numpy as np
import pytest
from advercity_dsl import Weather
from advercity_dsl.keyframes import replace_value

from advercity.physics import sky
from advercity.physics.atmosphere import compute_atmosphere
from advercity.physics.timeline import WeatherTimeline, compare_light


def build_weather(*keyframes: dict[str, object], **values: object) -> Weather:
    common = {"kind": "weather", "id": "mine", "time": "day", "keyframes": keyframes}
    return Weather.model_validate(common | values)


DUSK = build_weather(
    {"at_s": 2, "sun": {"elevation_deg": -8, "azimuth_deg": 262}, "rain": {"rate_mm_h": 8}},
    sun={"elevation_deg": 2, "azimuth_deg": 250},
    wind={"speed_m_s": 4},
    sky={"oktas": 8},
)


def test_a_constant_weather_has_one_atmosphere():
    timeline = WeatherTimeline(build_weather(rain={"rate_mm_h": 3}), 0.1)

    assert not timeline.is_changing
    assert timeline.atmosphere_at(0, "urban") is timeline.atmosphere_at(77, "urban")


def test_air_is_of_the_frame_and_light_of_the_last_change():
    timeline = WeatherTimeline(DUSK, 0.001)
    frame = next(index for index in range(50, 200) if timeline.find_light_frame(index) < index)
    light = timeline.find_light_frame(frame)
    found, made = timeline.atmosphere_at(frame, "urban"), timeline.atmosphere_at(light, "urban")

    assert found.sky is made.sky
    assert found.rain_mm_h == pytest.approx(8 * frame / 2000)
    assert compare_light(timeline.weather_at(light), timeline.weather_at(frame)) < 1
    alone = compute_atmosphere(timeline.weather_at(light), "urban")
    np.testing.assert_array_equal(found.sky, alone.sky)


def test_frames_are_the_same_in_any_order():
    forward, backward = WeatherTimeline(DUSK, 0.1), WeatherTimeline(DUSK, 0.1)
    frames = list(range(0, 26, 5))
    before = {frame: forward.atmosphere_at(frame, "rural") for frame in frames}
    for frame in reversed(frames):
        again = backward.atmosphere_at(frame, "rural")
        np.testing.assert_array_equal(again.sky, before[frame].sky)
        assert again.extinction == before[frame].extinction
        path = forward.compute_air_path_m(frame)
        np.testing.assert_array_equal(backward.compute_air_path_m(frame), path)


def test_light_falls_through_twilight_without_a_step():
    dusk = build_weather({"at_s": 8, "sun": {"elevation_deg": -6}}, sun={"elevation_deg": 2})
    lux = [sky.derive_daylight(dusk.at(0.05 * step)).diffuse_lx for step in range(161)]

    # Steepest at sunset, to which the formula of a day falls by the root of the sun's height:
    # from 800 + 15500 sqrt(sin(0.05 deg)) lx to 800.
    falls = -np.diff(np.log(lux))
    assert falls.min() > 0
    assert falls.max() == pytest.approx(math.log(1.5723), abs=1e-3)
    assert sky.twilight_illuminance(0) == pytest.approx(800)
    assert sky.twilight_illuminance(-3) == pytest.approx(math.sqrt(800 * 3.4))
    assert sky.twilight_illuminance(-18.1) == 0


def test_a_night_soon_after_sunset_has_twilight():
    night = compute_atmosphere(DUSK.at(2), "rural")

    # A third of the way from 3.4 to 0.008 lx by logarithm, of which clouds leave a quarter and
    # rain half; the glow of the sky has 0.0005 cd/m2.
    twilight = 3.4 * (0.008 / 3.4) ** (1 / 3) / 8
    assert night.street_lx == 0.5
    assert night.ground_lx == pytest.approx(twilight + math.pi * 0.0005, rel=0.2)


def test_the_wind_carries_flakes_as_far_as_it_blew():
    gusty = build_weather(
        {"at_s": 10, "wind": {"speed_m_s": 0, "from_deg": 270}},
        wind={"speed_m_s": 10, "from_deg": 270},
    )
    path_m = WeatherTimeline(gusty, 0.1).compute_air_path_m(100)

    # 5 m/s on average at 10 m, of which ln(2.5 / 0.5) / ln(10 / 0.5) is left at 2.5 m.
    assert path_m == pytest.approx([50 * math.log(5) / math.log(20), 0, -10], abs=0.3)


def test_mist_lets_the_sky_show_and_fog_hides_it():
    blue = []
    for mor_m in (900, 1500, 4000, None):
        weather = build_weather(fog={"mor_m": mor_m}, air={"mor_m": None}, sky={"oktas": 1})
        zenith = compute_atmosphere(weather, "rural").sky[4, 128, 128]
        blue.append(float(zenith[2] / zenith[0]))

    assert blue[0] == pytest.approx(1)
    assert blue == sorted(blue)
    assert blue[-1] > 1.5


@pytest.mark.parametrize(
    ("before", "field", "value", "tolerances"),
    [
        # Optical depths of 1.498 and 1.648: exp(-1.498) - exp(-1.648), over 0.05.
        ({"fog": {"mor_m": 200, "depth_m": 100}}, ("fog", "depth_m"), 110, 0.6224),
        # Of 9.986 and 14.979: the logarithm of 2 + 0.13 times that.
        ({"fog": {"mor_m": 30, "depth_m": 100}}, ("fog", "depth_m"), 150, 3.593),
        # A third of the way in extinction from 10 to 1 km, from 0.2593 of it.
        ({"dust": {"mor_m": 3000}}, ("dust", "mor_m"), 2500, 1.4815),
        # 300 m of dust have an optical depth of 1.797 and 1.997.
        ({"dust": {"mor_m": 500}}, ("dust", "mor_m"), 450, 1.379),
        ({"sky": {"turbidity": 3.0}}, ("sky", "turbidity"), 3.1, 0.6558),
        # Half a degree of arc: at 60 degrees, a degree of azimuth.
        ({"sun": {"elevation_deg": 60, "azimuth_deg": 180}}, ("sun", "azimuth_deg"), 181, 0.5),
        ({"sky": {"direct_lx": 1e4, "diffuse_lx": 1e4}}, ("sky", "direct_lx"), 1.1e4, 1.906),
        ({"sky": {"direct_lx": 0.0, "diffuse_lx": 1e4}}, ("sky", "direct_lx"), 0.1, 1.906),
        ({"sky": {"direct_lx": 1e4, "diffuse_lx": 1e4}}, ("sky", "diffuse_lx"), 1.1e4, 1.906),
        # 2 mm leave 1/e of bare ground of 0.1 among snow of 0.85.
        ({"snow": {"depth_mm": 2}, "temperature_c": -3}, ("snow", "depth_mm"), 1.8, 0.5804),
    ],
)
def test_light_changes_by_hand_computed_multiples_of_the_tolerance(
    before: dict[str, object], field: tuple[str, str], value: float, tolerances: float
):
    high = {"sun": {"elevation_deg": 60, "azimuth_deg": 180}}
    first = build_weather(**(high | before))
    assert compare_light(first, first) == 0
    assert compare_light(first, replace_value(first, field, value)) == pytest.approx(
        tolerances, rel=2e-3
    )


def test_lamps_of_the_night_light_air_over_100_m():
    """A visibility of 300 m leaves 0.3684 of it, of 330 m 0.4034."""
    night = {"time": "night", "sun": {"elevation_deg": -30}, "fog": {"mor_m": 300, "depth_m": 1}}
    first = build_weather(**night, air={"mor_m": None})
    clearer = replace_value(first, ("fog", "mor_m"), 330)
    assert compare_light(first, clearer) == pytest.approx(0.7002, rel=2e-3)
    for lamps in ("glow_cd_m2", "street_lx"):
        pair = getattr(first.night, lamps)
        for place in ("urban", "rural"):
            brighter = pair.model_copy(update={place: 1.1 * getattr(pair, place)})
            changed = first.model_copy(
                update={"night": first.night.model_copy(update={lamps: brighter})}
            )
            expected = math.log((getattr(brighter, place) + 1e-4) / (getattr(pair, place) + 1e-4))
            assert compare_light(first, changed) == pytest.approx(expected / 0.05, rel=1e-6)


def test_other_clouds_and_the_lamps_of_vehicles_are_another_light():
    heaps, deck = (build_weather(sky={"oktas": oktas}) for oktas in (6, 7))
    assert compare_light(heaps, deck) == math.inf
    assert compare_light(heaps, heaps.model_copy(update={"time": "night"})) == math.inf
    raining = deck.model_copy(update={"rain": deck.rain.model_copy(update={"rate_mm_h": 0.1})})
    assert compare_light(deck, raining) == math.inf


def test_what_falls_is_listed_at_eight_moments_between_keyframes():
    rising = build_weather({"at_s": 4, "rain": {"rate_mm_h": 8}}, rain={"rate_mm_h": 0})
    found = WeatherTimeline(rising, 0.1).list_precipitation()
    slopes = [part.sizes.slope_per_mm for part in found]
    assert slopes == pytest.approx([4.1 * rate_mm_h**-0.21 for rate_mm_h in range(1, 9)])
