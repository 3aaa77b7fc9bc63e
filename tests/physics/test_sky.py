"""Daylight and its distribution over the sky."""

import math

import numpy as np
import pytest

from advercity.geometry.arrays import Float64Array
from advercity.physics import photometry, sky
from advercity.physics.sky import air_mass, clear_daylight, cloudy_daylight


@pytest.mark.parametrize(
    ("elevation_deg", "mass", "direct_lx", "diffuse_lx"),
    [
        (5, 10.31, 14_600, 5_400),
        (10, 5.586, 39_500, 7_300),
        (20, 2.903, 69_300, 9_900),
        (60, 1.154, 100_100, 15_200),
    ],
)
def test_clear_daylight_follows_its_table(
    elevation_deg: float, mass: float, direct_lx: float, diffuse_lx: float
) -> None:
    light = clear_daylight(elevation_deg)
    assert air_mass(elevation_deg) == pytest.approx(mass, rel=1e-3)
    assert light.direct_lx == pytest.approx(direct_lx, rel=5e-3)
    assert light.diffuse_lx == pytest.approx(diffuse_lx, rel=1e-2)


def test_clouds_hide_the_sun_before_they_darken_the_day() -> None:
    total = [
        light.direct_lx * math.sin(math.radians(60)) + light.diffuse_lx
        for light in (cloudy_daylight(60, oktas=oktas) for oktas in (0, 2, 4, 6, 8))
    ]
    np.testing.assert_allclose(np.array(total) / total[0], [1, 0.99, 0.93, 0.72, 0.25], atol=0.006)
    assert cloudy_daylight(60, oktas=8).direct_lx == 0
    assert cloudy_daylight(60, oktas=8, precipitating=True).diffuse_lx == pytest.approx(
        total[-1] / 2
    )


@pytest.mark.parametrize(
    ("elevation_deg", "azimuth_deg", "direction"),
    [(0, 0, (0, 1, 0)), (0, 90, (1, 0, 0)), (0, 180, (0, -1, 0)), (90, 0, (0, 0, 1))],
)
def test_azimuth_runs_clockwise_from_north(
    elevation_deg: float, azimuth_deg: float, direction: tuple[float, float, float]
) -> None:
    np.testing.assert_allclose(
        sky.direction_from_elevation_azimuth(elevation_deg, azimuth_deg), direction, atol=1e-12
    )


@pytest.mark.parametrize(
    ("cie_type", "elevation_deg", "expected"),
    [
        (1, 60, 0.408),
        (3, 60, 0.361),
        (5, 60, 0.3183),
        (7, 30, 0.272),
        (11, 60, 0.335),
        (12, 10, 0.138),
        (12, 60, 0.313),
        (13, 30, 0.143),
    ],
)
def test_zenith_luminance_of_the_general_sky_follows_its_table(
    cie_type: int, elevation_deg: float, expected: float
) -> None:
    directions = photometry.cubemap_directions(128)
    relative = sky.cie_relative_luminance(
        directions, sky.direction_from_elevation_azimuth(elevation_deg, 40), cie_type
    )
    illuminance = photometry.horizontal_illuminance(relative[..., None] * np.ones(3))
    assert 1 / illuminance == pytest.approx(expected, rel=0.005)


@pytest.mark.parametrize("cie_type", [1, 3, 5, 7, 8, 11, 12, 13])
def test_every_sky_gives_the_illuminance_that_it_is_scaled_to(cie_type: int) -> None:
    sun, directions = (
        sky.direction_from_elevation_azimuth(45.0, 120.0),
        photometry.cubemap_directions(128),
    )
    relative = sky.cie_relative_luminance(directions, sun, cie_type)[..., None] * np.ones(3)
    scaled = relative * (12_345.0 / photometry.horizontal_illuminance(relative))
    fine = photometry.cubemap_directions(256)
    finer = sky.cie_relative_luminance(fine, sun, cie_type)[..., None] * np.ones(3)
    ratio = photometry.horizontal_illuminance(scaled) / photometry.horizontal_illuminance(relative)
    assert ratio * photometry.horizontal_illuminance(finer) == pytest.approx(12_345.0, rel=0.005)


@pytest.mark.parametrize(
    ("cie_type", "near", "away"),
    [
        (1, 0.665158, 0.665158),
        (3, 0.817853, 0.817853),
        (5, 1.0, 1.0),
        (7, 1.0, 0.403724),
        (8, 1.0, 0.300620),
        (11, 1.576950, 0.474062),
        (12, 1.726149, 0.518914),
        (13, 1.726149, 0.391653),
    ],
)
def test_luminance_relative_to_the_zenith_is_that_of_the_standard(
    cie_type: int, near: float, away: float
) -> None:
    """Computed by hand from ISO 15469:2004: sun and views are 30 and 60 degrees from the zenith."""
    np.testing.assert_allclose(see_both_sides(cie_type), [near, away], atol=1e-6)


@pytest.mark.parametrize(
    ("cie_type", "constant", "aureole", "rayleigh"), [(12, 0.91, 10, 0.45), (13, 0.856, 16, 0.3)]
)
def test_clear_skies_are_those_of_kittler_and_of_gusev(
    cie_type: int, constant: float, aureole: float, rayleigh: float
) -> None:
    """CIE 22-1973, older than the general sky and with constants of their own."""

    def scatter(angle: float) -> float:
        return constant + aureole * math.exp(-3 * angle) + rayleigh * math.cos(angle) ** 2

    gradation = (1 - math.exp(-0.32 / math.cos(math.pi / 3))) / 0.27385
    expected = [gradation * scatter(angle) / scatter(math.pi / 6) for angle in (0.5236, 1.5708)]
    np.testing.assert_allclose(see_both_sides(cie_type), expected, rtol=1e-3)


def test_the_overcast_sky_is_that_of_moon_and_spencer() -> None:
    """30 degrees above the horizon it is (1 + 2 sin 30) / 3 of the zenith; CIE 1955."""
    np.testing.assert_allclose(see_both_sides(1), 2 / 3, rtol=5e-3)


def see_both_sides(cie_type: int) -> Float64Array:
    """Luminance 30 degrees above the horizon below a sun 60 degrees high, and on the other side."""
    sun, near, away = (
        sky.direction_from_elevation_azimuth(*place) for place in ((60, 0), (30, 0), (30, 180))
    )
    return sky.cie_relative_luminance(np.array([near, away]), sun, cie_type)


@pytest.mark.parametrize(
    ("oktas", "turbidity", "cie_type"), [(0, 3, 12), (0, 5, 13), (2, 6, 13), (8, 3, 1), (8, 9, 1)]
)
def test_haze_pollutes_clear_skies_only_and_full_cover_is_the_overcast_sky(
    oktas: int, turbidity: float, cie_type: int
) -> None:
    assert sky.cie_sky_type(oktas, turbidity=turbidity) == cie_type


@pytest.mark.parametrize(
    ("elevation_deg", "least_lx", "most_lx"),
    [(-0.83, 375, 585), (-6, 2.0, 3.5), (-12, 0.006, 0.01), (-18, 5e-4, 7e-4)],
)
def test_twilight_is_as_bright_as_the_glossary_of_meteorology_has_it(
    elevation_deg: float, least_lx: float, most_lx: float
) -> None:
    """AMS Glossary of Meteorology, "civil", "nautical" and "astronomical twilight", clear skies."""
    assert least_lx <= cloudy_daylight(elevation_deg).diffuse_lx <= most_lx


def test_light_and_colour_of_the_sky_change_evenly_through_dusk() -> None:
    """From 6 degrees above to 12 below the horizon, light by day falls by a factor a degree."""
    low, above = np.array([0.995, 0.0, 0.1]), np.array([0.0, 0.0, 1.0])
    colours = []
    for elevation_deg in np.arange(6.0, -12.1, -0.25):
        sun = sky.direction_from_elevation_azimuth(float(elevation_deg), 90.0)
        colours.append(sky.sky_colour(np.stack([low, above]), sun, cloud_fraction=0.0))
    steps = np.abs(np.diff(colours, axis=0))
    assert steps.max() < 0.06
    warm, blue = (colour[0] / colour[2] for colour in colours[-1])
    assert warm > 1.5 > 0.7 > blue


@pytest.mark.parametrize(
    ("elevation_deg", "colour"),
    [
        (2, (1.87, 0.83, 0.12)),
        (7.5, (1.70, 0.87, 0.225)),
        (20, (1.32, 0.95, 0.54)),
        (40, (1.255, 0.96, 0.64)),
        (60, (1.19, 0.97, 0.74)),
        (90, (1.19, 0.97, 0.74)),
    ],
)
def test_the_sun_is_redder_the_lower_it_is(
    elevation_deg: float, colour: tuple[float, float, float]
) -> None:
    """Colours of Hosek and Wilkie's disc at 5, 10, 20 and 60 degrees, and midway between."""
    found = sky.sun_colour(elevation_deg)
    assert found == pytest.approx(colour)
    assert np.array(found) @ [0.2126, 0.7152, 0.0722] == pytest.approx(1.0, abs=0.01)
