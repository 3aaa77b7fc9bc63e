"""The atmosphere of the shipped weathers and of others."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from advercity_dsl import Weather
from numpy.typing import NDArray

from advercity.compiler import find_weather, list_weathers
from advercity.physics import photometry, sky
from advercity.physics.atmosphere import Atmosphere, compute_atmosphere

NAMES = [
    *(f"{air}_{time}" for air in ("clear", "soft_rain", "heavy_rain") for time in ("day", "night")),
    *(f"{air}_{time}" for air in ("fog", "foggy_heavy_rain") for time in ("day", "night")),
    "glare_day",
]


MOR_M = {"clear": 20_000, "soft_rain": 2554, "heavy_rain": 613, "fog": 75, "foggy_heavy_rain": 79.7}


DAYLIGHT_LX = {
    "clear_day": 101_900,
    "soft_rain_day": 20_000,
    "heavy_rain_day": 8_000,
    "fog_day": 15_000,
    "foggy_heavy_rain_day": 6_800,
}


def weather(time: str = "day", **parts: Any) -> Weather:
    sun = {"elevation_deg": 60 if time == "day" else -30}
    return Weather.model_validate({"id": "tried", "time": time, "sun": sun} | parts)


def shipped(name: str) -> Weather:
    return find_weather(name).declaration


def luminance(colour: Any) -> float:
    return float(np.asarray(colour) @ [0.2126, 0.7152, 0.0722])


def zenith_airlight(air: Atmosphere) -> NDArray[np.float64]:
    """Airlight (3,) in cd/m² along an infinite ray to the zenith."""
    middle = air.airlight.shape[1] // 2
    texels = air.airlight[4, middle - 1 : middle + 1, middle - 1 : middle + 1].reshape(-1, 4)
    return (texels[:, :3] * (1.0 + texels[:, 3:])).mean(axis=0, dtype=np.float64)


def horizontal_lx(atmosphere: Atmosphere) -> float:
    return atmosphere.sun_lx * max(0.0, atmosphere.sun_direction[2]) + atmosphere.sky_lx


def test_all_weathers_of_the_library_are_exactly_the_eleven(library: Path) -> None:
    assert {entry.declaration.id for entry in list_weathers(library)} == set(NAMES)
    assert all(shipped(name).id == name for name in NAMES)


def test_visibility_in_a_vacuum_is_infinite() -> None:
    assert compute_atmosphere(weather(air={"mor_m": None}), "rural").mor_m == math.inf


@pytest.mark.parametrize("name", NAMES)
def test_shipped_weather_has_the_visibility_of_its_table(name: str) -> None:
    expected = 15_000 if name == "glare_day" else MOR_M[name.rsplit("_", 1)[0]]
    assert compute_atmosphere(shipped(name), "urban").mor_m == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize(("name", "lux"), DAYLIGHT_LX.items())
def test_shipped_days_are_as_bright_as_their_table(name: str, lux: float) -> None:
    assert horizontal_lx(compute_atmosphere(shipped(name), "rural")) == pytest.approx(lux, rel=0.01)


def test_a_white_card_on_a_clear_day_has_26_kcd() -> None:
    lux = horizontal_lx(compute_atmosphere(weather(), "rural"))
    assert lux == pytest.approx(101_900, rel=0.03)
    assert 0.8 * lux / math.pi == pytest.approx(25_900, rel=0.03)


def test_authored_light_overrides_the_model() -> None:
    said = weather(sky={"oktas": 8, "diffuse_lx": 1234, "direct_lx": 567})
    found = compute_atmosphere(said, "rural")
    assert found.sun_lx == 567
    assert found.sky_lx == pytest.approx(1234, rel=1e-6)


@pytest.mark.parametrize(
    ("road", "carla_yaw_deg", "altitude_deg"),
    # Behind the turn, the ego of ui drives on to the east, where the original's ends.
    [("ui", 0, 8), ("unj", -178.7, 5), ("ri", -90, 10), ("rsnj", -90, 11), ("rcnj", -80, 22)],
)
def test_the_glare_comes_from_where_the_original_has_it_and_no_higher(
    road: str, carla_yaw_deg: float, altitude_deg: float
) -> None:
    sun = shipped("glare_day").sun_at[road]
    towards = sky.direction_from_elevation_azimuth(sun.elevation_deg, sun.azimuth_deg)
    apart = math.remainder(
        math.atan2(-towards[1], towards[0]) - math.radians(carla_yaw_deg), math.tau
    )
    assert abs(math.degrees(apart)) < 9.0
    assert 5.0 <= sun.elevation_deg <= altitude_deg


@pytest.mark.parametrize("name", NAMES)
def test_the_sky_cubemap_integrates_to_the_diffuse_illuminance(name: str) -> None:
    found = compute_atmosphere(shipped(name), "urban")
    assert found.sky.shape[0] == 6
    assert found.sky.dtype == np.float32
    assert found.sky.min() > 0
    assert photometry.horizontal_illuminance(found.sky.astype(float)) == pytest.approx(
        found.sky_lx, rel=1e-4
    )


def test_light_falls_slowly_and_evenly_from_haze_over_mist_to_fog() -> None:
    lux = [
        horizontal_lx(compute_atmosphere(weather(fog={"mor_m": mor_m}), "rural"))
        for mor_m in (9999, 5000, 1818, 1001, 900)
    ]
    assert lux == sorted(lux, reverse=True)
    assert lux[0] < 1.03 * lux[-1]


def test_an_overcast_sky_is_three_times_brighter_overhead_than_at_the_horizon() -> None:
    sun = sky.direction_from_elevation_azimuth(60, 180)
    both = sky.cie_relative_luminance(np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]), sun, 1)
    assert both[0] / both[1] == pytest.approx(2.99, rel=0.005)


def test_the_clear_sky_is_blue_at_the_zenith_and_brightest_near_the_sun() -> None:
    found = compute_atmosphere(weather(), "rural")
    red, _, blue = zenith_airlight(found)
    assert blue > 2 * red
    directions = photometry.cubemap_directions(found.sky.shape[1])
    brightest = directions[np.unravel_index(found.sky[..., 1].argmax(), directions.shape[:3])]
    assert brightest @ found.sun_direction > math.cos(math.radians(1))


@pytest.mark.parametrize(("elevation_deg", "sine"), [(30, 0.5), (90, 1.0)])
def test_clouds_are_lit_from_below_by_what_level_ground_reflects(
    elevation_deg: float, sine: float
) -> None:
    """A tenth of the light of the sky, and of the sun's by the sine of its elevation."""
    found = compute_atmosphere(
        weather(sun={"elevation_deg": elevation_deg}, sky={"oktas": 3}), "urban"
    )
    assert found.clouds is not None
    assert found.sun_lx > 10_000
    ground_lx = found.sky_lx + found.sun_lx * sine
    assert found.clouds.ground_lx == pytest.approx(0.1 * ground_lx, rel=1e-6)


def test_distant_objects_in_fog_fade_to_the_colour_of_the_sky() -> None:
    found = compute_atmosphere(weather(air={"mor_m": None}, fog={"mor_m": 75}), "rural")
    for side in range(4):
        level = found.airlight[side, 31:33, 31:33].mean(axis=(0, 1))
        endless = level[:3] * (1.0 + level[3])
        np.testing.assert_allclose(found.sky[side, 127:129, 127].mean(axis=0), endless, rtol=0.02)
    np.testing.assert_allclose(found.sky[4, 127, 127], zenith_airlight(found), rtol=0.02)


def test_thick_fog_hides_the_sun() -> None:
    clear, thin, thick = (
        compute_atmosphere(weather(fog={"mor_m": mor_m, "depth_m": 100}), "rural")
        for mor_m in (None, 500, 75)
    )
    assert thick.sun_lx / clear.sun_lx == pytest.approx(0.00992, rel=0.01)
    assert horizontal_lx(clear) > horizontal_lx(thin) > horizontal_lx(thick)


def test_a_night_has_its_glow_and_its_street_lamps_and_no_sun() -> None:
    found = compute_atmosphere(shipped("clear_night"), "rural")
    assert found.night
    assert found.sun_lx == 0
    assert found.street_lx == 0.5
    assert luminance(found.sky[4, 128, 128]) == pytest.approx(0.0005, rel=0.3)
    assert compute_atmosphere(shipped("clear_night"), "urban").street_lx == 12
    assert compute_atmosphere(shipped("clear_day"), "urban").street_lx == 0


def test_ten_lux_of_street_light_make_an_airlight_of_1_7_candelas() -> None:
    night = {"glow_cd_m2": {"urban": 0, "rural": 0}, "street_lx": {"urban": 10, "rural": 0}}
    foggy = weather("night", air={"mor_m": None}, fog={"mor_m": 75}, night=night)
    assert luminance(compute_atmosphere(foggy, "urban").horizon_airlight) == pytest.approx(
        1.75, rel=0.01
    )


@pytest.mark.parametrize(
    "parts",
    [
        {"fog": {"mor_m": 5000}, "air": {"mor_m": 1000}},
        {"fog": {"mor_m": 5}},
        {"rain": {"rate_mm_h": 200}},
        {"snow": {"rate_mm_h": 1}, "temperature_c": 10},
        {"sun": {"elevation_deg": -5}},
    ],
)
def test_impossible_weather_is_refused(parts: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"clearer|greater than|less than|snows|the sun is at"):
        weather(**parts)


def test_dust_absorbs_blue_and_leaves_an_ochre_dimmer_day() -> None:
    """A storm of a visibility of 60 m hides the sun: 15 optical depths, straight down."""
    clean, dusty, storm = (
        compute_atmosphere(weather(air={"mor_m": None}, dust={"mor_m": mor_m}), "rural")
        for mor_m in (None, 300, 60)
    )
    red, green, blue = dusty.horizon_airlight
    assert red > 1.15 * green > 1.3 * blue
    assert dusty.sun_lx < 0.06 * clean.sun_lx
    assert storm.sun_lx < 1.0
    assert clean.ground_lx > 1.5 * dusty.ground_lx > 3.0 * storm.ground_lx > 0.0


def low(found: Atmosphere, azimuth_deg: float) -> tuple[float, float]:
    """Luminance of the sky within 1.4 degrees above the horizon, and of endless air before it."""
    face = {90.0: 0, 270.0: 1, 0.0: 2, 180.0: 3}[azimuth_deg]
    horizon, middle = found.sky.shape[1] // 2, found.airlight.shape[1] // 2
    texels = horizon // middle
    columns = slice(horizon - texels, horizon + texels)
    seen = luminance(found.sky[face, horizon - texels : horizon, columns].mean(axis=(0, 1)))
    air = found.airlight[face, middle - 1, middle - 1 : middle + 1].mean(axis=0)
    return float(seen), float(luminance(air[:3]) * (1.0 + air[3]))


@pytest.mark.parametrize("azimuth_deg", [0.0, 90.0, 270.0])
@pytest.mark.parametrize(
    "parts",
    [
        {"dust": {"mor_m": 60}},
        {"dust": {"mor_m": 300}, "fog": {"mor_m": 200}},
        {"dust": {"mor_m": 3000}},
        {"air": {"mor_m": 1500}, "sky": {"oktas": 3}},
        {"rain": {"rate_mm_h": 30}, "sky": {"oktas": 8}},
        {"snow": {"rate_mm_h": 2, "depth_mm": 30}, "sky": {"oktas": 8}, "temperature_c": -3},
        {"rain": {"rate_mm_h": 10}, "fog": {"mor_m": 400}, "sky": {"oktas": 8}},
        {"snow": {"rate_mm_h": 1}, "dust": {"mor_m": 500}, "temperature_c": -3},
    ],
    ids=lambda parts: " and ".join(parts),
)
def test_contrast_falls_by_koschmieders_law_in_every_mixture_by_day(
    parts: dict[str, Any], azimuth_deg: float
) -> None:
    """Of black things against the low sky behind them, at three fractions of the visibility."""
    found = compute_atmosphere(weather("day", **{"air": {"mor_m": None}} | parts), "rural")
    behind, air = low(found, azimuth_deg)
    for fraction in (0.3, 0.6, 1.0):
        left = math.exp(-found.extinction.at_550nm * fraction * found.mor_m)
        contrast = 1.0 - air * (1.0 - left) / behind
        assert contrast == pytest.approx(left, abs=0.03)


def test_grey_dust_and_little_dust_colour_little() -> None:
    grey = {"mor_m": 300, "ssa_rgb": [0.9, 0.9, 0.9]}
    red, _, blue = compute_atmosphere(
        weather(dust=grey, sky={"oktas": 8}), "rural"
    ).horizon_airlight
    assert red == pytest.approx(blue, rel=0.03)
    little = compute_atmosphere(weather(dust={"mor_m": 50_000}), "rural")
    clean = compute_atmosphere(weather(), "rural")
    assert little.horizon_airlight == pytest.approx(clean.horizon_airlight, rel=0.05)
