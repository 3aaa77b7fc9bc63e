"""Optics of water surfaces, and puddles."""

import numpy as np
import pytest

from advercity.geometry.arrays import FloatArray
from advercity.physics import water
from advercity.physics.water import (
    DIFFUSE_EXTERNAL_REFLECTANCE,
    DIFFUSE_INTERNAL_REFLECTANCE,
    WATER_REFRACTIVE_INDEX,
    fresnel_reflectance,
)

PLACES = np.random.default_rng(3).uniform(-400.0, 400.0, (200_000, 2))
NODE, WEIGHT = np.polynomial.legendre.leggauss(300)


@pytest.mark.parametrize("coverage", [0.05, 0.35, 0.9])
def test_water_covers_the_fraction_that_is_asked_for(coverage: float) -> None:
    assert water.is_in_puddle(PLACES, coverage).mean() == pytest.approx(coverage, abs=0.01)


def test_dry_ground_has_no_puddles() -> None:
    assert not water.is_in_puddle(PLACES, 0.0).any()


def test_more_water_covers_whatever_less_covers() -> None:
    little, much = (water.is_in_puddle(PLACES, coverage) for coverage in (0.1, 0.4))
    assert np.all(much[little])


def test_the_ground_between_texels_is_linear() -> None:
    heights = water.build_puddle_height_field()
    at = np.array([[0.0, 0.0], [0.0, water.PUDDLE_TEXEL_M], [water.PUDDLE_TEXEL_M / 2, 0.0]])
    expected = [heights[0, 0], heights[1, 0], (heights[0, 0] + heights[0, 1]) / 2]
    assert water.puddle_field_height(at) == pytest.approx(expected)


@pytest.mark.parametrize(("angle_deg", "reflected"), [(0, 0.0204), (60, 0.0597), (80, 0.3479)])
def test_water_reflects_more_at_grazing_incidence(angle_deg: float, reflected: float) -> None:
    cosine = np.cos(np.radians([angle_deg]))
    assert float(fresnel_reflectance(cosine, WATER_REFRACTIVE_INDEX)[0]) == pytest.approx(
        reflected, abs=1e-4
    )


def wet_albedo(albedo: FloatArray) -> FloatArray:
    """Compute the albedo (n,) of a Lambertian surface under a film of water (Angstrom 1925).

    The film reflects part of the surface's light back to it, where more is absorbed. The specular
    reflection of the film itself, `DIFFUSE_EXTERNAL_REFLECTANCE`, comes on top.
    """
    return (
        (1.0 - DIFFUSE_EXTERNAL_REFLECTANCE)
        * (1.0 - DIFFUSE_INTERNAL_REFLECTANCE)
        * albedo
        / (1.0 - albedo * DIFFUSE_INTERNAL_REFLECTANCE)
    )


def test_a_film_of_water_darkens_as_angstrom_found() -> None:
    body = float(wet_albedo(np.array([0.30]))[0])
    assert body == pytest.approx(0.1716, rel=0.01)
    assert body + DIFFUSE_EXTERNAL_REFLECTANCE == pytest.approx(0.2380, rel=0.01)


def test_diffuse_reflection_of_water_is_the_mean_over_its_angles() -> None:
    cosine, weight = (NODE + 1.0) / 2.0, WEIGHT / 2.0
    assert 2.0 * np.sum(
        weight * cosine * fresnel_reflectance(cosine, WATER_REFRACTIVE_INDEX)
    ) == pytest.approx(DIFFUSE_EXTERNAL_REFLECTANCE, abs=2e-4)
    assert pytest.approx(0.4746, abs=1e-4) == DIFFUSE_INTERNAL_REFLECTANCE
