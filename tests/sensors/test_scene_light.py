"""The light on drops and flakes, by numbers computed by hand."""

import math

import numpy as np
import pytest

from advercity.compiler import find_weather
from advercity.geometry.arrays import Float64Array
from advercity.physics.atmosphere import compute_atmosphere
from advercity.physics.photometry import cubemap_solid_angles
from advercity.sensors.camera.scene_light import AmbientLight

SUN_LX = np.array([1000.0, 2000.0, 3000.0])
AHEAD = np.array([[1.0, 0.0, 0.0]])


def from_two(towards: Float64Array, *, sun: bool = False) -> AmbientLight:
    """100 cd/m² from one direction, and nothing from behind."""
    return AmbientLight(
        directions=np.array([towards, [-1.0, 0.0, 0.0]]),
        luminance=np.array([[100.0] * 3, [0.0] * 3]),
        solid_angle_fraction=np.array([0.5, 0.5]),
        sun=np.array([1.0, 0.0, 0.0]),
        sun_lx=SUN_LX * sun,
    )


def aside(angle_deg: float) -> Float64Array:
    angle = math.radians(angle_deg)
    return np.array([math.cos(angle), math.sin(angle), 0.0])


@pytest.mark.parametrize(("off_deg", "expected"), [(0, 97.0), (82, 97.0), (83, 3.0)])
def test_a_drop_shows_the_half_space_before_the_eye_and_a_little_of_all(
    off_deg: float, expected: float
) -> None:
    """94 % is the mean within 82.5 degrees, 6 % that of all directions, 50."""
    directions = np.array([aside(off_deg), AHEAD[0], [-1.0, 0.0, 0.0]])
    light = AmbientLight(
        directions=directions,
        luminance=np.array([[100.0] * 3, [0.0] * 3, [0.0] * 3]),
        solid_angle_fraction=np.array([0.5, 1e-9, 0.5]),
        sun=AHEAD[0],
        sun_lx=np.zeros(3),
    )
    np.testing.assert_allclose(light.drop_luminance(AHEAD)[0], expected, rtol=1e-6)


@pytest.mark.parametrize(
    ("off_deg", "boost"), [(0, 10.0), (10, 5.5), (19.99, 1.0), (21, 1.0), (170, 1.0)]
)
def test_a_drop_before_the_sun_is_ten_times_as_bright_as_aside_of_it(
    off_deg: float, boost: float
) -> None:
    """0.1 / pi per lux; between, the gain falls smoothly to 1 at 20 degrees."""
    lit, dark = (from_two(AHEAD[0], sun=sun) for sun in (True, False))
    rays = aside(off_deg)[None]
    by_sun = lit.drop_luminance(rays) - dark.drop_luminance(rays)
    np.testing.assert_allclose(by_sun[0], boost * 0.1 / math.pi * SUN_LX, rtol=1e-4)


def test_a_flake_is_a_white_ball() -> None:
    """It reflects 0.9 of the mean of all around it, and of the sun as a ball on the average."""
    flakes = from_two(AHEAD[0], sun=True).flake_luminance(np.repeat(AHEAD, 2, axis=0))
    expected = 0.9 * 50.0 + 0.9 / (4 * math.pi) * SUN_LX
    np.testing.assert_allclose(flakes, [expected, expected])


def test_the_light_of_an_atmosphere_is_that_of_its_sky_and_its_sun() -> None:
    air = compute_atmosphere(find_weather("clear_day").declaration, "urban")
    light = AmbientLight.from_atmosphere(air)
    np.testing.assert_allclose(light.sun_lx, air.sun_lx * np.array(air.sun_colour))
    assert light.sun_lx[0] > light.sun_lx[2] > 0.0
    np.testing.assert_allclose(light.sun, air.sun_direction)
    solid_angle = np.tile(cubemap_solid_angles(256)[None, ..., None], (6, 1, 1, 1))
    mean = (air.sky * solid_angle).sum(axis=(0, 1, 2)) / solid_angle.sum()
    np.testing.assert_allclose(light.mean_luminance, mean, rtol=0.01)
    assert light.luminance.shape == (6 * 8 * 8, 3)
