"""Daylight in fog: what energy, symmetry and two streams say of it."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from advercity.geometry.arrays import FloatArray
from advercity.physics.fog_transfer import (
    FogBank,
    FogRadiance,
    Scatterer,
    ScatteringLayer,
    Streams,
    compute_fog_radiance,
)
from advercity.physics.photometry import cubemap_directions, horizontal_illuminance
from advercity.physics.scattering import PhaseLobes
from advercity.physics.sky import direction_from_elevation_azimuth

Array = NDArray[np.float64]
ALL_ROUND = cubemap_directions(32)
LEVEL = np.array([[math.cos(turn), math.sin(turn), 0.0] for turn in np.arange(8) * math.pi / 4])
SOUTH_AT_60 = direction_from_elevation_azimuth(60, 180)


def fog(
    depth: float, *, albedo: float = 0.1, direct_lx: float = 0.0, sky_cd_m2: float = 1000.0
) -> FogRadiance:
    """100 m of fog of an optical depth, under an even sky and the sun."""

    def even(directions: Array) -> Array:
        return np.full(directions.shape[:-1], sky_cd_m2)

    droplets = Scatterer(1.0, PhaseLobes.from_diameter_um(12.0))
    bank = FogBank(depth / 100.0, 100.0, albedo, (droplets,))
    return compute_fog_radiance(bank, sun=SOUTH_AT_60, direct_lx=direct_lx, sky=even)


def lux(light: FogRadiance) -> float:
    """On level ground, the sun included."""
    dome = light.sky_luminance(cubemap_directions(128))[..., None] * np.ones(3)
    return horizontal_illuminance(dome) + light.sun_lx * SOUTH_AT_60[2]


@pytest.mark.parametrize("depth", [0.1, 1.0, 4.0, 12.0])
def test_white_ground_under_fog_and_an_even_sky_is_as_bright_as_the_sky(depth: float) -> None:
    light = fog(depth, albedo=1.0)
    np.testing.assert_allclose(light.sky_luminance(ALL_ROUND), 1000.0, rtol=2e-3)
    np.testing.assert_allclose(light.airlight_luminance(ALL_ROUND), 1000.0, rtol=2e-3)
    np.testing.assert_allclose(light.airlight_growth(ALL_ROUND), 0.0, atol=5e-3)


def test_a_bank_of_three_shares_of_the_same_droplets_is_as_bright_as_the_whole() -> None:
    lobes = PhaseLobes.from_diameter_um(20.0)
    shares = tuple(Scatterer(fraction, lobes, 0.9) for fraction in (0.5, 0.3, 0.2))
    whole, mixed = (
        compute_fog_radiance(
            FogBank(0.03, 100.0, 0.1, scatterers),
            sun=SOUTH_AT_60,
            direct_lx=50_000.0,
            sky=lambda up: np.full(up.shape[:-1], 1000.0),
        )
        for scatterers in ((Scatterer(1.0, lobes, 0.9),), shares)
    )
    for light in (whole, mixed):
        assert light.sun_lx == pytest.approx(50_000.0 * math.exp(-3.0 / SOUTH_AT_60[2]))
    np.testing.assert_allclose(
        mixed.sky_luminance(ALL_ROUND), whole.sky_luminance(ALL_ROUND), rtol=1e-9
    )
    np.testing.assert_allclose(
        mixed.airlight_luminance(ALL_ROUND), whole.airlight_luminance(ALL_ROUND), rtol=1e-9
    )


@pytest.mark.parametrize("depth", [1.0, 3.0, 6.0])
def test_fog_lets_down_about_what_two_streams_let_down(depth: float) -> None:
    """Bohren 1987: T = 2 / (2 + (1 - g) depth), and what the ground sends back; coarse."""
    through = 2.0 / (2.0 + 0.13 * depth)
    expected = math.pi * 1000.0 * through / (1.0 - 0.1 * (1.0 - through))
    assert lux(fog(depth)) == pytest.approx(expected, rel=0.15)


def test_black_ground_under_no_fog_sees_the_sky_as_it_is() -> None:
    light = fog(1e-6, albedo=0.0, direct_lx=50_000.0)
    assert light.sun_lx == pytest.approx(50_000.0, rel=1e-5)
    up, down = np.array([0.0, 0.6, 0.8]), np.array([0.0, 0.6, -0.8])
    np.testing.assert_allclose(light.sky_luminance(np.array([up, down])), [1000.0, 0.0], atol=1.0)


def test_what_the_sun_loses_in_its_aureole_and_more_reaches_the_ground() -> None:
    """Droplets turn half of what they scatter by little, so thin fog hardly dims the ground."""
    light = fog(0.5, albedo=0.0, direct_lx=50_000.0, sky_cd_m2=0.0)
    sine = SOUTH_AT_60[2]
    assert light.sun_lx == pytest.approx(50_000.0 * math.exp(-0.5 / sine), rel=1e-6)
    assert 0.93 < lux(light) / (50_000.0 * sine) < 1.0


def test_fog_shines_most_where_the_sun_is_and_least_towards_the_ground() -> None:
    light = fog(3.0, direct_lx=50_000.0)
    rays = np.array([SOUTH_AT_60, [0, -1, 0], [0, 1, 0], [0, 0, -1]], np.float64)
    towards_sun, below_it, away, down = light.airlight_luminance(rays)
    assert towards_sun > 2.0 * below_it > 2.0 * away > 2.0 * down > 0.0


def test_level_rays_fade_into_the_sky_behind_them() -> None:
    light = fog(4.0, direct_lx=50_000.0)
    np.testing.assert_allclose(
        light.airlight_luminance(LEVEL), light.sky_luminance(LEVEL), rtol=0.02
    )


def test_climbing_rays_fade_into_the_sky_behind_them() -> None:
    light = fog(8.0)
    rays = np.stack([np.cos([0.2, 0.6, 1.2]), np.zeros(3), np.sin([0.2, 0.6, 1.2])], axis=-1)
    endless = light.airlight_luminance(rays) * (1.0 + light.airlight_growth(rays))
    np.testing.assert_allclose(endless, light.sky_luminance(rays), rtol=0.02)


def test_thicker_fog_is_darker_down_to_the_ground() -> None:
    found = [lux(fog(depth, direct_lx=50_000.0)) for depth in (0.1, 0.5, 2.0, 6.0, 15.0)]
    assert found == sorted(found, reverse=True)


def test_a_thin_layer_scatters_sunlight_once_by_its_phase_function() -> None:
    """Towards and away from the sun's azimuth, of a phase function 1 + c/2 of the cosine c."""

    def phase(cosine: FloatArray) -> FloatArray:
        return (1.0 + 0.5 * cosine) / (4.0 * math.pi)

    sun = 0.6
    streams = Streams.from_sun_cosine(sun, phase)
    layer = ScatteringLayer.from_optical_depth(1e-5, streams)
    _, transmitted = layer.scatter_sunlight(50_000.0)
    level = np.sqrt(1.0 - streams.cosine**2) * 0.8
    towards, away = (streams.cosine * sun + sign * level for sign in (1.0, -1.0))
    signs = (-1.0) ** np.arange(len(transmitted))
    np.testing.assert_allclose(
        transmitted.sum(0) / (signs @ transmitted), phase(towards) / phase(away), rtol=1e-3
    )
